# SPDX-License-Identifier: MIT
"""What `calibrate` says of a board that a newcomer may build: a thermometer that stands still, a sensor that delivers faults
only, another rate than the board says, a thermometer that is renewed seldom, a flash that does not take the table."""
import csv
import json
import os
import pathlib
import pty
import re
import resource
import subprocess
import sys

import imu as imu_module
import numpy as np
import pytest

from device_link import Device
from imu import CALIBRATE, Imu
from reference import QUICK
from test_firmware_sensors import Sensor, hang_up, simulated_chamber

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from sick.case import MODEL as SICK_MODEL  # noqa: E402
from sick.device import RATE_HZ, RECORD, TEST_S, DeviceBench, as_bytes, change  # noqa: E402


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return DeviceBench(tmp_path_factory.mktemp("sick_boards"))


def calibrate_run(bench, samples, *arguments):
    """`calibrate run` on a device fed with samples: (status, standard output, lines of standard error, its folder)."""
    imu = bench.start()
    try:
        bench.feed(imu, as_bytes(samples))
        status, out, err = imu.calibrate("--json", "run.json", "run", "--order", 3, "--model", "model.json", "--range", "0:60",
                                         "--record", "log.csv", "-o", "table.json", *arguments)
        return status, out, err.splitlines(), imu.folder
    finally:
        imu.close()


@pytest.fixture(scope="module")
def chamber(tmp_path_factory):
    return simulated_chamber(tmp_path_factory.mktemp("chamber"))


def run_on_sensor(chamber, folder, fault, *arguments):
    """The same on a device that reads a modelled sensor through its driver."""
    with Sensor(chamber, folder, "mpu6050", "--fault", fault) as sensor, Device("posix", extra=sensor.options("posix")) as device:
        hang_up(device)
        imu = Imu.__new__(Imu)
        imu.folder, imu.port = folder, device.name
        status, _, err = imu.calibrate("run", "--model", chamber / "model.json", "--range", "0:60", "--record", "log.csv",
                                       *arguments, timeout_s=120)
        return status, err.splitlines()


def recorded(folder):
    with open(folder / "log.csv") as lines:
        return list(csv.DictReader(line for line in lines if not line.startswith("#")))


# ---- a thermometer that stands still ----

def test_run_thermometer_that_stands_still_ends_the_run_after_faulty_s_and_is_named_first(chamber, tmp_path):
    status, err = run_on_sensor(chamber, tmp_path, "temperature:100:9000", "--faulty-s", 100)
    assert status == 4, err
    assert any("note: from 16" in line and "temperature stands still" in line for line in err), err
    assert err[-1].index("temperature stands still since 16") < err[-1].index("every second is faulty")
    assert len(recorded(tmp_path)) > 250


def test_run_that_ends_for_another_reason_tells_what_the_device_told(chamber, tmp_path):
    with open(chamber / "log.csv") as log:  # 150 seconds: 7 degC
        (tmp_path / "world").mkdir()
        (tmp_path / "world/log.csv").write_text("".join([line for line in log][:170]))
    (tmp_path / "world/model.json").write_text((chamber / "model.json").read_text())
    fault = (tmp_path / "world", tmp_path, "temperature:0:9000")
    status, err = run_on_sensor(*fault)
    assert status == 3, err
    assert any("note: " in line and "temperature stands still" in line for line in err[:-1]), err
    assert err[-1].index("temperature stands still since") < err[-1].index("moved only from")
    status, err = run_on_sensor(*fault, "--force", "-q")
    assert status == 3 and len(err) == 1 and "temperature stands still" in err[0]


def test_run_thermometer_that_no_driver_watches_is_named_where_it_gave_one_reading(bench):
    status, _, err, _ = calibrate_run(bench, change(temp_degc=lambda s: s["temp_degc"].clip(max=1.5))(bench.healthy))
    assert status == 3, err
    assert "the thermometer has given 1.50 degC and nothing else since 32" in err[-1] and "moved only from" in err[-1]


# ---- seconds that are all faulty ----

def test_run_sensor_that_reports_faults_only_ends_the_run(bench):
    faulty = change(fault=lambda s: (s["t_s"] >= 200).astype("u1") * 7)(bench.healthy)
    status, _, err, folder = calibrate_run(bench, faulty)
    assert status == 4 and "from 201 s on every second is faulty" in err[-1], err
    assert int(re.search(r"(\d+) s by now", err[-1])[1]) >= 600
    assert any("note: at 20" in line and "reported a fault" in line for line in err[:-1])
    assert len(recorded(folder)) >= 800


def test_run_faults_of_one_axis_or_of_less_than_faulty_s_do_not_end_the_run(bench):
    for fault in (lambda s: (s["t_s"] >= 200).astype("u1"),
                  lambda s: ((s["t_s"] >= 200) & (s["t_s"] < 790)).astype("u1") * 7):
        status, _, err, _ = calibrate_run(bench, change(fault=fault)(bench.healthy))
        assert status == 1 and "faults in" in " ".join(err).replace("fault in", "faults in"), err


# ---- another rate than the board says ----

def at_rate(samples, hz):
    """The samples of a sensor that delivers so many a second: the test's 10 and, evenly between, copies of them with noise of
    their own, or a part of them."""
    n = int(TEST_S * hz)
    near = np.minimum((np.arange(n) * RATE_HZ / hz).astype(int), len(samples["t_s"]) - 1)
    taken = {name: value[near].copy() for name, value in samples.items()}
    taken["rate"] += np.random.default_rng(9).normal(0, 1, taken["rate"].shape)
    taken["stamp_us"] = (np.arange(n) * 1e6 / hz).round().astype("u8") + np.uint64(1000)
    return taken


@pytest.mark.parametrize("hz, text", [(13, "13 samples a second where the board says 10"), (8, "8 samples a second where")])
def test_run_rate_off_by_more_than_a_tenth_is_told(bench, hz, text):
    status, out, err, folder = calibrate_run(bench, at_rate(bench.healthy, hz))
    assert status in (0, 1)
    assert text in err[0] and "note: " in err[0] and "rate_hz" in err[0] and "time stamps (us)" in err[0]
    assert text in out and any(text in note for note in json.loads((folder / "run.json").read_text())["notes"])


def test_run_a_note_does_not_stand_behind_the_line_that_shows_the_progress(bench):
    imu = bench.start()
    terminal, end = pty.openpty()
    try:
        bench.feed(imu, as_bytes(at_rate(bench.healthy, 13)))
        process = subprocess.Popen([CALIBRATE, "--port", imu.port, "run", "--model", "model.json", "--range", "0:60"],
                                   cwd=imu.folder, stdout=subprocess.DEVNULL, stderr=end)
        assert process.wait(timeout=30) in (0, 1)
        assert b"\r\033[Kcalibrate: note: 13 samples" in os.read(terminal, 65536)
    finally:
        os.close(terminal)
        os.close(end)
        imu.close()


@pytest.mark.parametrize("hz", [21, 200, 4])
def test_run_rate_off_by_a_factor_2_is_refused_at_once(bench, hz):
    status, _, err, folder = calibrate_run(bench, at_rate(bench.healthy, hz))
    assert status == 4 and f"{hz} samples a second where the board says 10" in err[-1], err
    assert not (folder / "table.json").exists()


def test_record_and_info_tell_a_wrong_rate(bench):
    imu = bench.start()
    try:
        bench.feed(imu, as_bytes(at_rate(bench.healthy, 13)))
        status, _, err = imu.calibrate("--json", "record.json", "record", "-o", "log.csv")
        assert status == 0 and "note: 13 samples a second where the board says 10" in err
        assert "13 samples" in imu.json("record.json")["rate_warning"]
        assert "13 samples a second where the board says 10" in imu.info()["rate_warning"]
        assert "note: since start 13 samples" in imu.calibrate("info")[1]
    finally:
        imu.close()


def test_run_samples_whose_seconds_never_end_are_told(bench):
    """Time stamps in milliseconds: a thousand seconds go by until the first one ends."""
    samples = bench.healthy
    spoilt = {**samples, "stamp_us": samples["stamp_us"] // np.uint64(10000)}
    imu = bench.start()
    try:
        bench.feed(imu, as_bytes(spoilt), paced=len(as_bytes(samples)) / 20)
        status, _, err = imu.calibrate("run", "--model", "model.json", "--range", "0:60", "--stall-s", 1)
        assert status == 4 and "samples come, but no second of them has ended" in err and "microseconds" in err
    finally:
        imu.close()


def test_healthy_devices_are_not_told_a_wrong_rate(bench):
    """Clocks that are off by 3 %, jitter of a period, every twentieth sample missing, each at several seeds."""
    rng = np.random.default_rng(11)
    for hz in (9.7, 10.3, 10.0, 10.0):
        samples = at_rate(bench.healthy, hz)
        keep = rng.random(len(samples["t_s"])) > (0.05 if hz == 10.0 else 0)
        samples = {name: value[keep][:RATE_HZ * 60] for name, value in samples.items()}
        samples["stamp_us"] += rng.integers(0, 90_000, len(samples["stamp_us"])).astype("u8")
        imu = bench.start()
        try:
            bench.feed(imu, as_bytes(samples))
            status, _, err = imu.calibrate("record", "-o", "log.csv")
            assert status == 0 and "samples a second" not in err, (hz, err)
            assert imu.info()["rate_warning"] is None
        finally:
            imu.close()


def test_run_more_noise_beside_lost_samples_says_to_mend_the_losses(bench):
    """Five of eight samples are lost, as the flags say; the mean's noise is 1.4 times the model's."""
    samples = at_rate(bench.healthy, 10)
    keep = np.random.default_rng(5).random(len(samples["t_s"])) < 0.7
    samples = {name: value[keep] for name, value in samples.items()}
    samples["rate"] += np.random.default_rng(6).normal(0, 110, samples["rate"].shape)
    status, _, err, _ = calibrate_run(bench, samples)
    assert status == 1
    nis = next(line for line in err if "innovations have" in line)
    assert "samples are missing in" in nis and "identify the model anew" not in nis


# ---- a thermometer that is renewed seldom ----

def renewed(samples, every_s, times=1.0):
    """Its word is renewed every so many seconds (it has noise of 0.02 degC); the bias of the rates is so many times as large."""
    noisy = samples["temp_degc"] + np.random.default_rng(12).normal(0, 0.02, len(samples["t_s"]))
    step = int(every_s * RATE_HZ)
    bias = np.polynomial.polynomial.polyval((samples["temp_degc"] - 30) / 30, SICK_MODEL["bias"]["coeff_dph"])
    held = noisy[np.maximum(0, (np.arange(len(noisy)) + 3) // step * step - 3)] if step else noisy
    return {**samples, "temp_degc": held, "rate": samples["rate"] + (times - 1) * bias[:, None]}


def test_run_thermometer_renewed_seldom_is_noted_where_it_costs_little(bench):
    status, out, err, folder = calibrate_run(bench, renewed(bench.healthy, 10))
    assert status == 0, err
    assert "note: gx_dph: the thermometer is renewed only every 10 s" in out and "5 s of delay may have cost" in out
    assert any("renewed only every 10 s" in note for note in json.loads((folder / "run.json").read_text())["notes"])


def test_run_and_fit_refuse_what_a_thermometer_renewed_seldom_costs_more_than_the_predicted_error(bench):
    status, _, err, folder = calibrate_run(bench, renewed(bench.healthy, 10, times=10))
    assert status == 1 and any("gx_dph: the thermometer is renewed only every 10 s" in line for line in err), err
    reason = next(r for r in json.loads((folder / "run.json").read_text())["judgement"]["reasons"] if r["rule"] == "temp-held")
    assert 25 < reason["value"] < 45 and 5 < reason["limit"] < 25  # 5 s x 125 dph/degC x 0.06 degC/s at the steepest
    fit = subprocess.run([CALIBRATE, "fit", "log.csv", "--model", "model.json", "--json", "fit.json"], cwd=folder,
                         capture_output=True, text=True)
    assert fit.returncode == 1
    rules = [r["rule"] for r in json.loads((folder / "fit.json").read_text())["judgement"]["reasons"]]
    assert rules.count("temp-held") == 3


def test_run_healthy_and_coarse_declared_thermometers_are_not_said_to_be_renewed_seldom(bench):
    coarse = {**bench.healthy, "temp_degc": np.round(bench.healthy["temp_degc"] / 0.5) * 0.5}
    for samples, scale in ((bench.healthy, "0.01"), (renewed(bench.healthy, 0), "0.01"), (coarse, "0.5"), (coarse, "0.01")):
        imu = bench.start()
        imu.power_off()
        imu.power_on(["--temp-scale", scale])
        data = np.frombuffer(as_bytes(samples), dtype=RECORD).copy()
        data["temp"] = np.round((samples["temp_degc"] - 25) / float(scale))
        try:
            bench.feed(imu, data.tobytes())
            status, out, err = imu.calibrate("run", "--model", "model.json", "--range", "0:60")
            assert status == 0 and "renewed" not in out + err, out + err
        finally:
            imu.close()


# ---- a flash that fails at the end ----

@pytest.fixture
def imu(tmp_path, monkeypatch):
    """A device whose flash may be made to refuse: its file may not be written any more."""
    wrapper = tmp_path / "firmware.sh"
    wrapper.write_text(f'#!/bin/sh\ntrap "" XFSZ\nexec {imu_module.FIRMWARE} "$@"\n')
    wrapper.chmod(0o755)
    monkeypatch.setattr(imu_module, "FIRMWARE", wrapper)
    device = Imu(tmp_path)
    yield device
    device.close()


def set_flash(imu, works):
    resource.prlimit(imu.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY if works else 0, resource.RLIM_INFINITY))


@pytest.mark.parametrize("span", ["0:60", "-20:60"])  # a table that the device makes, and one of the host's
def test_run_flash_that_fails_keeps_the_table_in_a_file_that_can_be_flashed_later(imu, span):
    imu.sense(QUICK)
    set_flash(imu, works=False)
    status, out, err = imu.calibrate("--json", "run.json", "run", "--model", "model.json", f"--range={span}", "-o", "t.json")
    assert status == 4
    assert "flash failed: its driver, the program unit" in err and "worn cells" in err and "last good table" not in err
    assert "kept in t.json" in err and "flash t.json" in err and "flashed on" not in out
    run = imu.json("run.json")
    assert run["flashed"] is False and "flash failed" in run["flash_error"] and run["sequence"] is None
    assert imu.info()["has_table"] is False
    assert imu.calibrate("flash", "t.json")[0] == 4  # it is not mended
    set_flash(imu, works=True)
    assert imu.calibrate("flash", "t.json")[0] == 0
    assert imu.calibrate("verify", "t.json")[0] == 0
    imu.sense(QUICK)
    again = imu.run(f"--range={span}")  # as the device would have flashed it
    kept = imu.json("t.json")["axes"]
    assert [axis["coeff_dph"] for axis in again["axes"]] == [axis["coeff_dph"] for axis in kept]
    assert [axis["sigma_dph"] for axis in again["axes"]] == [axis["sigma_dph"] for axis in kept]


def test_run_flash_that_fails_without_an_output_writes_a_file_of_its_own_and_over_none(imu):
    for name in ("unflashed-0001.json", "unflashed-0001-2.json"):
        imu.sense(QUICK)
        set_flash(imu, works=False)
        status, _, err = imu.calibrate("run", "--model", "model.json", "--range", "0:60")
        assert status == 4 and f"kept in {name}" in err
        assert len(imu.json(name)["axes"][0]["coeff_dph"]) == 4


def test_run_device_that_is_gone_when_the_table_is_flashed_costs_no_table(imu):
    imu.power_off()
    imu.power_on(["--cut", "3"])
    imu.sense(QUICK)
    status, _, err = imu.calibrate("run", "--model", "model.json", "--range", "0:60", "-o", "t.json")
    assert status == 4 and "gone" in err and "kept in t.json" in err
    imu.power_off()
    imu.power_on()
    assert imu.calibrate("flash", "t.json")[0] == 0
