# SPDX-License-Identifier: MIT
"""What can be wrong with tables, logs, models, ports and devices: each ends in a clear message and the right exit
status, and the device keeps its last good table."""
import json
import time

import pytest

from imu import GYROSIM, IMPATIENT, Imu, wait_until
from noisy_line import NoisyLine
from reference import MODEL, QUICK, RESTING


@pytest.fixture
def imu(tmp_path):
    """A device with a table."""
    device = Imu(tmp_path)
    device.sense(QUICK)
    device.run("--range", "0:60")
    (tmp_path / "good.json").write_text((tmp_path / "table.json").read_text())
    yield device
    device.close()


def keeps_its_table(imu):
    status, out, err = imu.calibrate("verify", "good.json")
    return status == 0 or pytest.fail(out + err)


def refused(imu, status, *parts, command):
    """The command ends with `status`; its message has all `parts`, in one line of plain text."""
    got, out, err = imu.calibrate(*command)
    assert got == status, (got, out, err)
    assert err.startswith("calibrate: ") and err.count("\n") == 1, err
    for part in parts:
        assert part in err, f"'{part}' is not in: {err}"


# ---- tables ----

def spoil_version(table):
    table["imucal_table"] = 2


def spoil_serial(table):
    table["serial"] = "0002"


def spoil_nan(table):
    table["axes"][1]["coeff_dph"][2] = float("nan")  # json writes NaN, which is no JSON


def spoil_null(table):
    table["axes"][1]["coeff_dph"][2] = None


def spoil_huge(table):
    table["axes"][1]["coeff_dph"][2] = 1e30


def spoil_span(table):
    table["axes"][2]["span_degc"].reverse()


def spoil_text(table):
    table["axes"][0]["t0_degc"] = "thirty"


def spoil_order(table):
    table["axes"][0]["order"] = 9


def spoil_count(table):
    table["axes"][0]["coeff_dph"].append(1.0)


def spoil_range(table):
    table["axes"][0]["range_degc"] = -30


def spoil_sigma(table):
    table["axes"][0]["sigma_dph"][3] = -1


def spoil_name(table):
    table["axes"][0]["axis"] = "gq_dph"


def spoil_scale(table):
    table["axes"][0]["dph_per_count"] = 2.0


def spoil_typing_error(table):
    table["axes"][0]["coef_dph"] = [0]


def spoil_missing(table):
    del table["axes"][0]["span_degc"]


def spoil_axes(table):
    table["axes"].pop()


BAD_TABLES = [
    (spoil_version, "imucal_table", "version not known"),
    (spoil_serial, "serial", "0002", "0001"),
    (spoil_nan, "bad.json", "line"),
    (spoil_null, "axes[1].coeff_dph[2]", "number"),
    (spoil_huge, "axes[1]", "coeff"),
    (spoil_span, "axes[2]", "span"),
    (spoil_text, "axes[0].t0_degc", "number"),
    (spoil_order, "axes[0].order",),
    (spoil_count, "axes[0].coeff_dph", "5 numbers"),
    (spoil_range, "axes[0]", "range_degc"),
    (spoil_sigma, "axes[0]", "sigma"),
    (spoil_name, "axes[0]", "gq_dph", "gx_dph"),
    (spoil_scale, "axes[0]", "count"),
    (spoil_typing_error, "coef_dph",),
    (spoil_missing, "span_degc",),
    (spoil_axes, "axes", "2"),
]


@pytest.mark.parametrize("spoil, parts", [(bad[0], bad[1:]) for bad in BAD_TABLES], ids=[b[0].__name__ for b in BAD_TABLES])
def test_flash_bad_table_is_refused_by_field(imu, spoil, parts):
    table = imu.json("good.json")
    spoil(table)
    (imu.folder / "bad.json").write_text(json.dumps(table))
    refused(imu, 3, "bad.json", *parts, command=["flash", "bad.json"])
    assert keeps_its_table(imu)
    assert imu.info()["sequence"] == 1  # nothing was written


@pytest.mark.parametrize("name, spoil, part", [
    ("crc", lambda b: b[:100] + bytes([b[100] ^ 1]) + b[101:], "crc"),
    ("version", lambda b: b[:4] + b"\x09" + b[5:], "version"),
    ("length", lambda b: b[:-10], "length"),
    ("magic", lambda b: b"\0" + b[1:], "not a table"),
    ("empty", lambda b: b"", "header"),
])
def test_flash_bad_binary_is_refused(imu, name, spoil, part):
    assert imu.calibrate("dump", "-o", "good.bin")[0] == 0
    (imu.folder / "bad.bin").write_bytes(spoil((imu.folder / "good.bin").read_bytes()))
    refused(imu, 3, "bad.bin", part, command=["flash", "bad.bin"])
    assert keeps_its_table(imu)


def test_flash_file_that_is_no_json_or_is_missing(imu):
    (imu.folder / "bad.json").write_text('{"imucal_table": 1,\n "serial": }')
    refused(imu, 3, "bad.json", "line 2", command=["flash", "bad.json"])
    refused(imu, 3, "absent.json", command=["verify", "absent.json"])


def test_boot_with_a_spoilt_newest_slot_falls_back_and_says_why(imu):
    table = imu.json("good.json")
    table["axes"][0]["coeff_dph"][0] += 5
    (imu.folder / "second.json").write_text(json.dumps(table))
    assert imu.calibrate("flash", "second.json")[0] == 0
    imu.power_off()
    flash = bytearray((imu.folder / "imu.flash").read_bytes())
    flash[4096 + 60] ^= 0x10  # the second table stands in the second slot
    (imu.folder / "imu.flash").write_bytes(flash)
    imu.power_on()
    info = imu.info()
    assert info["sequence"] == 1 and "CRC" in info["slots"][1]["status"]
    assert keeps_its_table(imu)


# ---- runs that cannot give a table ----

def test_run_profile_that_never_moves_is_refused(imu):
    imu.sense(RESTING)
    refused(imu, 3, "moved only from 25.00 to 25.0", "order 3", command=["run", "--model", "model.json", "--range", "0:60"])
    assert keeps_its_table(imu) and imu.info()["session"] == "idle"
    (imu.folder / "rest.json").write_text(json.dumps(RESTING))
    refused(imu, 3, "the profile moved only", command=["run", "--model", "model.json", "--profile", "rest.json"])
    assert keeps_its_table(imu)


def test_run_reversed_range_is_a_usage_error(imu):
    refused(imu, 2, "60:0", "is reversed", command=["run", "--model", "model.json", "--range", "60:0"])
    refused(imu, 2, "LOW:HIGH", command=["run", "--model", "model.json", "--range", "warm"])


@pytest.mark.parametrize("model, part", [
    ({**MODEL, "arw_deg_rt_h": 0}, "arw_deg_rt_h"),
    ({**MODEL, "arw_deg_rt_h": "much"}, "arw_deg_rt_h"),
    ({**MODEL, "imucal_model": 7}, "imucal_model"),
    ({**MODEL, "markov": [{"sigma_dph": 20, "tau_s": -1}]}, "tau_s"),
])
def test_run_bad_model_is_refused_by_field(imu, model, part):
    (imu.folder / "bad_model.json").write_text(json.dumps(model))
    refused(imu, 3, part, command=["run", "--model", "bad_model.json", "--range", "0:60"])
    assert keeps_its_table(imu)


def test_run_unknown_axis_lists_those_there_are(imu):
    refused(imu, 2, "gw_dph", "gx_dph gy_dph gz_dph", command=["run", "--model", "model.json", "--range", "0:60", "--axis", "gw_dph"])


def test_run_axis_given_twice_starts_nothing(imu):
    refused(imu, 2, "gy_dph", "twice", command=["run", "--model", "model.json", "--range", "0:60", *["--axis", "gy_dph"] * 2])
    assert ", idle" in imu.calibrate("info")[1]


def test_run_record_that_cannot_be_written(imu):
    imu.sense(QUICK)
    refused(imu, 3, "no/such/folder", command=["run", "--model", "model.json", "--range", "0:60", "--record", "no/such/folder/x.csv"])
    assert keeps_its_table(imu)


def test_run_sensor_that_delivers_nothing_is_said(imu):
    imu.stop_sensor()  # a feed without a writer
    refused(imu, 4, "sensor has delivered nothing", command=["run", "--model", "model.json", "--range", "0:60", "--stall-s", "1"])
    assert keeps_its_table(imu)


def test_replay_bad_logs_name_line_and_field(imu):
    import subprocess
    for text, parts in [("t_s,temp_degc,gx_dph\n1,20,5\n2,20,many\n", ["bad.csv", "3", "many"]),
                        ("t_s,temp_degc,gx_dph\n1,20,5\n5,20,5\n9,20,5\n", ["bad.csv", "4.0", "one per second"]),
                        ("t_s,temp_degc,gx_dph\n1,,5\n2,,5\n", ["bad.csv", "temperature"])]:
        (imu.folder / "bad.csv").write_text(text)
        done = subprocess.run([GYROSIM, "replay", "bad.csv", "--to", "out"], cwd=imu.folder, capture_output=True, text=True)
        assert done.returncode == 3, done.stderr
        for part in parts:
            assert part in done.stderr, done.stderr


# ---- ports ----

def test_port_that_does_not_exist(imu):
    for port in ("/dev/ttyNOSUCH0", "/dev/pts/9999", "serial:/dev/ttyNOSUCH0"):
        status, _, err = imu.calibrate("info", port=port)
        assert status == 4 and port in err and "no such port" in err


def test_port_nobody_listens(imu):
    status, _, err = imu.calibrate("info", port="tcp:127.0.0.1:1")
    assert status == 4 and "cannot connect" in err


def test_port_malformed_is_a_usage_error(imu):
    assert imu.calibrate("info", port="tcp:nowhere")[0] == 2


def test_port_in_use_is_refused(tmp_path):
    imu = Imu(tmp_path, serial="pty")
    try:
        imu.sense(QUICK, options=["--speed", "100"])
        first = imu.start("record", "-o", "log.csv")
        wait_until(lambda: (tmp_path / "log.csv.part").exists())
        status, _, err = imu.calibrate("info")
        assert status == 4 and "in use" in err
        first.terminate()
        first.communicate(timeout=10)
        assert first.returncode == 0
        assert imu.info()["serial"] == "0001"
    finally:
        imu.close()


def test_port_without_an_imu_behind_it(tmp_path, imu):
    with NoisyLine(imu.port) as line:
        line.silent = True
        status, _, err = imu.calibrate(*IMPATIENT, "info", port=line.port)
        assert status == 4 and "does not answer" in err and "HELLO" in err


# ---- devices that stop ----

def mid_run(imu, *options):
    """A run whose sensor goes at a pace, a while after its start."""
    imu.sense(QUICK, options=["--speed", "200"])
    process = imu.start(*IMPATIENT, "run", "--model", "model.json", "--range", "0:60", "--record", "log.csv", *options)
    wait_until(lambda: (imu.folder / "log.csv.part").exists())
    time.sleep(0.3)
    return process


def test_run_device_that_falls_silent(imu):
    process = mid_run(imu)
    imu.pause()
    start = time.monotonic()
    out, err = process.communicate(timeout=20)
    assert process.returncode == 4 and "does not answer" in err and "last good table" in err
    assert time.monotonic() - start < 10
    assert (imu.folder / "log.csv").exists()  # what was recorded is kept
    imu.resume()
    imu.stop_sensor()
    assert keeps_its_table(imu)


@pytest.mark.parametrize("command", [["run", "--model", "model.json", "--range", "0:60"], ["record", "-o", "silent.csv"]], ids=lambda c: c[0])
def test_wholly_silent_device_is_noticed_within_3_s(imu, command):
    """With the options as they are; a second and a half more for a busy machine."""
    imu.sense(QUICK, options=["--speed", "50"])
    process = imu.start(*command, "--json", "silent.json")
    time.sleep(1.5)
    imu.pause()
    start = time.monotonic()
    out, err = process.communicate(timeout=20)
    took_s = time.monotonic() - start
    imu.resume()
    imu.stop_sensor()
    assert process.returncode == 4 and "does not answer" in err, err
    assert 2.5 < took_s < 4.5


def test_run_device_whose_power_fails(imu):
    process = mid_run(imu)
    imu.power_off()
    out, err = process.communicate(timeout=20)
    assert process.returncode == 4 and "gone" in err
    imu.power_on()
    assert keeps_its_table(imu)


def slow_flash(imu):
    """The device again, with a flash that takes ten milliseconds a word: 1.1 s a table."""
    imu.power_off()
    imu.power_on(["--flash-delay-us", "10000"])
    table = imu.json("good.json")
    table["axes"][0]["coeff_dph"][0] += 5
    (imu.folder / "next.json").write_text(json.dumps(table))
    process = imu.start("--timeout-s", "0.3", "--tries", "3", "flash", "next.json")
    before = (imu.folder / "imu.flash").read_bytes()
    wait_until(lambda: (imu.folder / "imu.flash").read_bytes() != before)
    return process


def test_flash_device_that_falls_silent_keeps_the_old_table(imu):
    process = slow_flash(imu)
    imu.pause()
    out, err = process.communicate(timeout=20)
    assert process.returncode == 4 and "does not answer" in err and "last good table" in err
    imu.power_off()  # in the middle of programming
    imu.power_on()
    assert keeps_its_table(imu)


def test_flash_power_fails_keeps_the_old_table_and_the_next_flash_works(imu):
    process = slow_flash(imu)
    imu.power_off()
    out, err = process.communicate(timeout=20)
    assert process.returncode == 4 and "gone" in err
    imu.power_on()
    assert keeps_its_table(imu)
    assert imu.calibrate("flash", "next.json")[0] == 0
    assert imu.calibrate("verify", "next.json")[0] == 0


def test_flash_slow_device_is_waited_for(imu):
    process = slow_flash(imu)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 0, err
    assert imu.calibrate("verify", "next.json")[0] == 0
