# SPDX-License-Identifier: MIT
"""`calibrate` from outside against the firmware as a process: the whole run over each kind of port, and every
subcommand."""
import csv
import json
import os
import signal
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from imu import GYROSIM, Imu, wait_until
from noisy_line import NoisyLine
from reference import BASIC, COEFF_DPH, MODEL, NOISE, QUICK
from where import BUILD, ROOT


@pytest.fixture
def imu(tmp_path):
    device = Imu(tmp_path)
    yield device
    device.close()


def rows(path):
    with open(path) as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def column(path, name):
    return np.array([float(row[name]) for row in rows(path)])


# ---- the whole run, over every kind of port ----

def through_libserialport(imu, tmp_path):
    """Port name and environment under which libserialport opens a pseudo-terminal (host/README.md)."""
    (tmp_path / "imu0").symlink_to(imu.port)
    shim = BUILD / "tests/tty_shim.so"
    assert shim.exists(), f"{shim} is missing: make {shim}"
    # a sanitized build wants its runtime first, before what is preloaded
    return f"/dev/../../..{tmp_path}/imu0", {**os.environ, "LD_PRELOAD": str(shim), "ASAN_OPTIONS": "verify_asan_link_order=0"}


@pytest.mark.parametrize("kind", ["tcp", "pty", "serial"])
def test_run_learns_flashes_and_verifies_over_each_kind_of_port(tmp_path, kind):
    imu = Imu(tmp_path, serial="tcp:0" if kind == "tcp" else "pty")
    try:
        port, env = through_libserialport(imu, tmp_path) if kind == "serial" else (imu.port, None)
        imu.sense(BASIC, options=["-o", "truth.csv"])
        result = imu.run("--profile", "profile.json", "--record", "log.csv", port=port, env=env)

        assert [axis["axis"] for axis in result["axes"]] == ["gx_dph", "gy_dph", "gz_dph"]
        for axis in result["axes"]:
            # reference figures A, tests/README.md: worst 6.93 dph, at the ends; within 1 %
            assert max(axis["sigma_dph"]) == pytest.approx(6.93, rel=0.01)
            assert 0.9 < axis["mean_nis"] < 1.1
            temp = np.array(axis["temp_degc"])
            tn = (temp - axis["t0_degc"]) / axis["range_degc"]
            error = np.polynomial.polynomial.polyval(tn, axis["coeff_dph"]) - np.polynomial.polynomial.polyval(
                (temp - 30) / 30, COEFF_DPH)
            assert np.all(np.abs(error) < 4.5 * np.array(axis["sigma_dph"])), error
        assert result["made_by"] == "device" and result["link"]["lost_records"] == 0
        # the log recorded through firmware and line is the sensor's, up to the counts
        assert len(rows(tmp_path / "log.csv")) == 8400
        assert np.abs(column(tmp_path / "log.csv", "gy_dph") - column(tmp_path / "truth.csv", "gy_dph")).max() < 0.5
        assert imu.calibrate("verify", "table.json", port=port, env=env)[0] == 0
    finally:
        imu.close()


def test_run_through_libserialport_is_really_libserialport(tmp_path):
    imu = Imu(tmp_path, serial="pty")
    try:
        port, _ = through_libserialport(imu, tmp_path)
        status, _, err = imu.calibrate("info", port=port)  # without the shim the library cannot open it
        assert status == 4 and port in err
    finally:
        imu.close()


def test_run_then_power_cut_table_stays_and_compensates(imu, tmp_path):
    imu.sense(BASIC)
    imu.run("--profile", "profile.json")
    imu.power_off()
    imu.power_on()
    assert imu.calibrate("verify", "table.json")[0] == 0
    imu.sense(BASIC, options=["--log-index", "1"])
    status, out, err = imu.calibrate("record", "-o", "raw.csv", "--compensated", "out.csv")
    assert status == 0, err
    raw, out = column(tmp_path / "raw.csv", "gx_dph"), column(tmp_path / "out.csv", "gx_dph")
    table = imu.json("table.json")["axes"][0]
    learned = np.polynomial.polynomial.polyval((column(tmp_path / "raw.csv", "temp_degc") - 30) / 30, table["coeff_dph"])
    # B(T) is applied per sample; the polynomial of the mean temperature is the mean within a hundredth
    assert np.abs(raw - learned - out).max() < 0.6  # half a count of quantised output and temperature steps
    assert np.sqrt(np.mean(raw**2)) > 200 and np.sqrt(np.mean(out**2)) < 50


def test_run_ends_when_the_error_asked_for_is_reached(imu):
    imu.sense(QUICK, options=["--speed", "400"])  # paced: see test_run_ends_after_the_duration
    result = imu.run("--profile", "profile.json", "--until-error", "60")
    assert result["ended_by"] == "the predicted error is reached" and result["seconds"] < 720
    assert max(axis["worst_sigma"] for axis in result["axes"]) <= 60.5


def test_run_two_markov_terms_are_judged_by_the_whole_model(imu):
    """A sensor that is as its model says is flashed, though the filter has one state; one whose fast noise is twice as large is not."""
    two = {**MODEL, "arw_deg_rt_h": 0.2, "markov": [{"sigma_dph": 40, "tau_s": 3}, {"sigma_dph": 20, "tau_s": 100}]}
    imu.sense(BASIC, model=two)
    result = imu.run("--profile", "profile.json")
    assert result["flashed"] and not result["judgement"]["reasons"]
    assert all(axis["error_factor"] < 1.5 and axis["mean_nis"] > 2 for axis in result["axes"])
    loud = {**two, "markov": [{"sigma_dph": 80, "tau_s": 3}, two["markov"][1]]}
    imu.power_off()
    imu.power_on()
    imu.sense(BASIC, model=loud)
    (imu.folder / "two.json").write_text(json.dumps(two))
    status, _, err = imu.calibrate("--json", "r.json", "run", "--order", 3, "--model", "two.json", "--profile", "profile.json",
                                   "--accept", "nis", "--accept", "rejects", "--accept", "residual", "--accept", "lag1", "-o", "t.json")
    assert status == 0 and "times the variance that the model predicts" in err
    axis = imu.json("t.json")["axes"][0]
    assert "nis" in axis["accepted"] and axis["error_factor"] > 1.5
    status, out, err = imu.calibrate("flash", "t.json")
    assert status == 0 and "gx_dph was accepted although rules spoke against it" in out


def test_run_error_not_reached_is_a_negative_answer_with_a_table(imu):
    imu.sense(QUICK)
    status, out, _ = imu.calibrate("run", "--order", 3, "--model", "model.json", "--until-error", "1", "-o", "t.json")
    assert status == 1 and "not reached" in out
    assert imu.calibrate("verify", "t.json")[0] == 0


def test_run_says_that_the_turn_on_constant_sits_in_b0(imu):
    imu.sense(QUICK, model={**MODEL, "turn_on_sigma_dph": 50})
    status, out, err = imu.calibrate("--json", "run.json", "run", "--model", "model.json", "-o", "t.json")
    assert status == 0, err
    assert out.count("b0 holds the turn-on constant (50 dph from run to run)") == 1
    assert [axis["turn_on_sigma_dph"] for axis in imu.json("run.json")["axes"]] == [50] * 3


def test_run_ends_after_the_duration(imu):
    # Paced, so that the device cannot run far ahead of a busy host: 200 s of sensor time are half a second.
    imu.sense(QUICK, options=["--speed", "400"])
    result = imu.run("--range", "0:60", "--duration-s", "400")
    assert result["ended_by"] == "the duration is over" and 400 <= result["seconds"] < 600


def test_run_partial_range_table_is_valid_where_the_temperature_was(imu):
    imu.sense(QUICK)
    result = imu.run("--range=-20:60")
    assert result["made_by"] == "host" and any("covered" in note for note in result["notes"])
    assert imu.json("table.json")["axes"][0]["span_degc"] == pytest.approx([0, 60], abs=0.1)
    assert imu.calibrate("verify", "table.json")[0] == 0


def test_run_without_any_range_uses_what_it_saw(imu):
    imu.sense(QUICK, model=MODEL)
    (imu.folder / "bare.json").write_text(json.dumps(NOISE))
    status, out, err = imu.calibrate("run", "--order", "3", "--model", "bare.json", "-o", "t.json")
    assert status == 0, err
    assert imu.json("t.json")["axes"][2]["span_degc"] == pytest.approx([0, 60], abs=0.1)


def interrupted_run(imu, *options):
    """Ctrl-C after some 480 s of sensor time, at 42 degC."""
    imu.sense(QUICK, options=["--speed", "400"])
    process = imu.start("run", "--order", "2", "--range", "0:60", "--model", "model.json", "--record", "log.csv", "-o", "t.json", *options)
    wait_until(lambda: (imu.folder / "log.csv.part").exists())
    time.sleep(1.2)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=10)
    return process.returncode, out, err


def test_run_interrupted_flashes_nothing_and_keeps_the_record(imu):
    status, out, err = interrupted_run(imu)
    assert status == 130 and "nothing flashed" in err and "--keep-partial" in err, out + err
    assert not (imu.folder / "t.json").exists() and len(rows(imu.folder / "log.csv")) > 200
    info = imu.info()
    assert info["session"] == "idle" and info["has_table"] is False


def test_run_interrupted_with_keep_partial_makes_a_table_of_what_it_has(imu):
    status, out, err = interrupted_run(imu, "--keep-partial")
    assert status == 0 and "interrupted" in out, out + err
    lo, hi = imu.json("t.json")["axes"][0]["span_degc"]
    assert lo == 0 and 20 < hi < 59
    assert len(rows(imu.folder / "log.csv")) > 200
    assert imu.info()["session"] == "idle"


@pytest.mark.parametrize("order", [1, 2, 4, 5])
def test_run_every_order(imu, order):
    bias = {**MODEL["bias"], "coeff_dph": COEFF_DPH[:order + 1]}  # what a lower order leaves would be told
    imu.sense(QUICK, model={**MODEL, "bias": bias})
    result = imu.run("--range", "0:60", order=order)
    assert all(len(axis["coeff_dph"]) == order + 1 for axis in result["axes"])


def test_run_one_axis_leaves_the_others_uncalibrated(imu):
    imu.sense(QUICK)
    result = imu.run("--range", "0:60", "--axis", "gy_dph")
    assert [axis["axis"] for axis in result["axes"]] == ["gy_dph"]
    assert [axis["order"] for axis in imu.json("table.json")["axes"]] == [0, 3, 0]


def test_run_six_channels_gyros_and_accelerometers(tmp_path):
    imu = Imu(tmp_path, options=["--channels", "6"])
    try:
        mg = {**MODEL, "unit": "mg", "arw_deg_rt_h": 0.02, "markov": [{"sigma_dph": 0.5, "tau_s": 100}],
              "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [5, 10, 2, -1]}}
        (tmp_path / "accel.json").write_text(json.dumps(mg))
        imu.sense(BASIC, options=["--accel-model", "accel.json"] * 3)
        models = ["--model", "model.json"] * 3 + ["--model", "accel.json"] * 3
        status, out, err = imu.calibrate("--json", "run.json", "run", "--order", "3", *models, "--range", "0:60", "-o", "t.json")
        assert status == 0, out + err
        az = imu.json("run.json")["axes"][5]
        assert az["axis"] == "az_mg" and az["coeff_mg"] == pytest.approx([5, 10, 2, -1], abs=5 * max(az["sigma_mg"]))
        assert "residual_rms_mg" in az and out.count("b0 holds gravity") == 3
    finally:
        imu.close()


# ---- the sensor's flaws ----

def test_run_missing_samples_and_seconds_are_bridged(imu):
    imu.sense(QUICK, options=["--missing", "0.05", "--missing-seconds", "0.1", "--jitter-s", "0.002"])
    result = imu.run("--range", "0:60", "--record", "log.csv")
    assert result["seconds"] < 690
    assert all(axis["bridged_s"] > 30 and axis["measurements"] > 550 for axis in result["axes"])
    flags = column(imu.folder / "log.csv", "gx_flags")
    assert set(flags) <= {0, 2} and 0.95 < np.mean(flags == 2) < 1  # one second in 170 is whole: 0.95^100


def with_rate(imu, rate_hz):
    imu.power_off()
    imu.options += ["--rate", str(rate_hz)]
    imu.power_on()


def test_serve_feeds_the_log_that_gyrosim_writes(imu, tmp_path):
    imu.sense(QUICK, seed=5, options=["--log-index", "2"])
    status, _, err = imu.calibrate("record", "-o", "fed.csv")
    assert status == 0, err
    subprocess.run([GYROSIM, "log", "--model", "model.json", "--axes", "3", "--profile", "profile.json", "--seed", "5",
                    "--log-index", "2", "-o", "written.csv"], cwd=tmp_path, check=True, capture_output=True)
    for name in ("gx_dph", "gy_dph", "gz_dph"):
        difference = column(tmp_path / "fed.csv", name) - column(tmp_path / "written.csv", name)
        assert np.std(difference) < 0.04  # rounding of 100 counts of 1 dph: 1/sqrt(12*100) = 0.029


def test_replay_gives_the_recorded_means_back_with_its_gaps(imu, tmp_path):
    with_rate(imu, 20)
    rng = np.random.default_rng(1)
    times = [t for t in range(100, 700) if not 300 <= t < 340]
    with open(tmp_path / "recorded.csv", "w") as file:
        file.write("# imucal-log = 1\nt_s,temp_degc,gx_dph,gy_dph,gz_dph\n")
        for t in times:
            file.write(f"{t},{t / 20:.3f}," + ",".join(f"{v:.3f}" for v in rng.normal(1000, 300, 3)) + "\n")
    imu.replay("recorded.csv", ["--rate-hz", "20"])
    status, _, err = imu.calibrate("record", "-o", "again.csv")
    assert status == 0, err
    first, again = tmp_path / "recorded.csv", tmp_path / "again.csv"
    assert list(column(again, "t_s")) == [t - 99 for t in times]
    for name, tolerance in (("gx_dph", 1 / 20), ("gz_dph", 1 / 20), ("temp_degc", 0.01 / 20)):
        assert np.abs(column(first, name) - column(again, name)).max() <= tolerance * 1.001


def test_replay_of_a_recorded_log_calibrates(imu):
    log = ROOT / "../shared/data/cats_p1.csv"
    if not log.exists():
        pytest.skip(f"SKIP: {log} is not there")
    with_rate(imu, 10)
    model = {"imucal_model": 1, "arw_deg_rt_h": 6, "markov": [{"sigma_dph": 50, "tau_s": 1500}]}
    (imu.folder / "model.json").write_text(json.dumps(model))
    imu.replay(log, ["--rate-hz", "10"])
    result = imu.run("--range", "4.8:17.4", "--axis", "gy_dph")
    # data/README.md: y slope 92 to 96 dph/degC
    axis = result["axes"][0]
    slope = axis["coeff_dph"][1] / axis["range_degc"]
    assert 70 < slope < 110 and result["seconds"] == 92041


def test_run_fed_over_tcp(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    imu = Imu(tmp_path, options=["--feed", f"tcp:127.0.0.1:{port}"])
    try:
        (tmp_path / "feed").unlink()
        imu.feed = f"tcp-listen:{port}"
        imu.sense(QUICK)
        wait_until(lambda: is_listening(port))
        assert imu.run("--range", "0:60")["seconds"] == 720
    finally:
        imu.close()


def is_listening(port):
    hexadecimal = f"0100007F:{port:04X} 00000000:0000 0A"  # 127.0.0.1:port, state LISTEN
    return hexadecimal in Path("/proc/net/tcp").read_text()


def test_run_live_sensor_at_its_own_pace(tmp_path):
    """As with a real sensor: samples come whether anybody listens or not."""
    imu = Imu(tmp_path, options=["--live"])
    try:
        imu.sense(QUICK, options=["--speed", "400"])
        result = imu.run("--profile", "profile.json")
        assert result["ended_by"] in ("the sensor's data ended", "the duration is over")
        assert 600 < result["seconds"] <= 720 and result["link"]["lost_records"] == 0
        assert imu.calibrate("verify", "table.json")[0] == 0
    finally:
        imu.close()


def test_fit_of_the_recorded_log_gives_the_device_its_own_table_bit_for_bit(imu):
    imu.sense(BASIC, options=["--missing-seconds", "0.02"])
    run = imu.run("--profile", "profile.json", "--record", "log.csv")
    status, out, err = imu.calibrate("fit", "log.csv", "--method", "kf", "--order", "3", "--model", "model.json", "--range", "0:60",
                                     "-o", "fitted.json")
    assert status == 0, err
    fitted = imu.json("fitted.json")
    for learned, offline in zip(run["axes"], fitted["axes"]):
        assert offline["coeff_dph"] == learned["coeff_dph"] and learned["bridged_s"] > 100
    assert imu.calibrate("flash", "fitted.json")[0] == 0
    assert imu.calibrate("verify", "fitted.json")[0] == 0


# ---- the other subcommands ----

def test_flash_dump_rollback_erase(imu):
    imu.sense(QUICK)
    imu.run("--range", "0:60")
    first = imu.json("table.json")
    second = json.loads(json.dumps(first))
    second["axes"][0]["coeff_dph"][0] += 1
    (imu.folder / "second.json").write_text(json.dumps(second))

    assert imu.calibrate("flash", "second.json")[0] == 0
    assert imu.calibrate("verify", "second.json")[0] == 0
    status, out, _ = imu.calibrate("verify", "table.json")
    assert status == 1 and "gx_dph coeff_dph[0]" in out
    assert imu.calibrate("dump", "-o", "dumped.json")[0] == 0
    assert imu.json("dumped.json")["axes"] == second["axes"] and imu.json("dumped.json")["sequence"] == 2
    assert imu.calibrate("dump", "-o", "dumped.bin")[0] == 0
    assert imu.calibrate("verify", "dumped.bin")[0] == 0

    assert imu.calibrate("rollback")[0] == 0
    assert imu.calibrate("verify", "table.json")[0] == 0
    status, _, err = imu.calibrate("rollback")
    assert status == 4 and "no other" in err.lower()

    assert imu.calibrate("erase")[0] == 0
    assert imu.info()["has_table"] is False
    assert imu.calibrate("verify", "table.json")[0] == 1
    status, _, err = imu.calibrate("dump", "-o", "none.json")
    assert status == 4 and "no table" in err and not (imu.folder / "none.json").exists()


def test_info_says_who_and_what(imu):
    info = imu.info()
    assert info["device"] == "posix" and info["serial"] == "0001" and info["has_table"] is False
    assert [c["axis"] for c in info["channels"]] == ["gx_dph", "gy_dph", "gz_dph"]
    status, out, _ = imu.calibrate("info")
    assert status == 0 and "runs uncompensated" in out


@pytest.fixture
def fast(tmp_path):
    """A board with few samples a second, fed as fast as it takes them: many seconds come in one piece."""
    device = Imu(tmp_path, options=("--rate", "2"))
    device.sense(options=("--rate-hz", 2))
    yield device
    device.close()


def test_monitor_prints_every_second(fast):
    status, out, err = fast.calibrate("monitor", "--duration-s", "20")
    assert status == 0, err
    lines = out.splitlines()
    assert "temp_degc" in lines[0] and len(lines) == 21


def test_a_recording_ends_with_the_second_that_was_asked_for(fast):
    status, out, err = fast.calibrate("--json", "result.json", "record", "--duration-s", "100", "-o", "log.csv", "--compensated", "clean.csv")
    assert status == 0, err
    for name in ("log.csv", "clean.csv"):
        recorded = rows(fast.folder / name)
        assert len(recorded) == 100 and float(recorded[-1]["t_s"]) - float(recorded[0]["t_s"]) == 99
    assert fast.json("result.json")["seconds"] == 100 and "100 seconds recorded" in out


def test_list_works_without_a_port(imu):
    status, out, _ = imu.calibrate("--json", "-", "list", port="unused")
    assert status == 0 and isinstance(json.loads(out)["ports"], list)


# ---- a bad line ----

def test_run_over_a_noisy_line_learns_the_same_table(tmp_path):
    (tmp_path / "clean").mkdir()
    (tmp_path / "noisy").mkdir()
    clean, noisy = Imu(tmp_path / "clean"), Imu(tmp_path / "noisy")
    try:
        clean.sense(QUICK)
        wanted = clean.run("--range", "0:60")
        noisy.sense(QUICK)
        with NoisyLine(noisy.port, corrupt=3e-4, double=3e-4, lose=3e-4, seed=1) as line:
            got = noisy.run("--range", "0:60", "--timeout-s", "0.1", "--tries", "20", port=line.port)
            assert line.n_hit > 10  # the line was bad indeed
        # the filters run on the device: a bad line loses records, and nothing else
        assert got["link"]["spoilt_frames"] > 5 and got["link"]["lost_records"] > 5
        for a, b in zip(wanted["axes"], got["axes"]):
            assert a["coeff_dph"] == b["coeff_dph"] and a["sigma_dph"] == b["sigma_dph"]
        assert noisy.calibrate("verify", "table.json")[0] == 0
    finally:
        clean.close()
        noisy.close()


def test_flash_over_a_noisy_line_arrives_whole(imu):
    imu.sense(QUICK)
    imu.run("--range", "0:60")
    for seed in range(5):
        table = imu.json("table.json")
        table["axes"][1]["coeff_dph"][1] += 1 + seed
        (imu.folder / "next.json").write_text(json.dumps(table))
        with NoisyLine(imu.port, corrupt=1e-3, double=1e-3, lose=1e-3, seed=seed) as line:
            status, out, err = imu.calibrate("--timeout-s", "0.05", "--tries", "30", "flash", "next.json", port=line.port)
            assert status == 0, out + err
            assert line.n_hit > 0
        assert imu.calibrate("verify", "next.json")[0] == 0
