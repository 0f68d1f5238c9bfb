# SPDX-License-Identifier: MIT
"""Devices that read a modelled sensor through its driver, register by register (tests/emu/sensor_server.c), the sensor in
gyrosim's chamber: whole calibrations by the command line, the same table on every processor, and every kind of bad input counted,
told and kept out."""
import csv
import json
import os
import shutil
import subprocess
import time

import pytest

import reference
from child import Child
from device_link import Device
from where import BIN, BUILD, ROOT

MODEL = {**reference.MODEL, "markov": [{"sigma_dph": 5, "tau_s": 100}]}
PROFILE = {"imucal_profile": 1, "start_degc": 0, "segments": [
    {"rate_degc_per_min": 0, "duration_s": 40}, {"rate_degc_per_min": 4, "to_degc": 60},
    {"rate_degc_per_min": 0, "duration_s": 60}]}
RECORD_S = 200  # of 1000
RISCV_MISSING = [n for n in ("riscv64-unknown-elf-gcc", "qemu-system-riscv32") if not shutil.which(n)]


def simulated_chamber(folder):
    """The folder with model, profile and the log that is the world of every sensor here."""
    (folder / "model.json").write_text(json.dumps(MODEL))
    (folder / "profile.json").write_text(json.dumps(PROFILE))
    subprocess.run([BIN / "gyrosim", "log", "--model", folder / "model.json", "--profile", folder / "profile.json",
                    "--axes", "3", "--seed", "4", "-q", "-o", folder / "log.csv"], check=True)
    return folder


@pytest.fixture(scope="module")
def chamber(tmp_path_factory):
    return simulated_chamber(tmp_path_factory.mktemp("chamber"))


class Sensor(Child):
    """The model's process; its pipes begin with .prefix."""

    def __init__(self, chamber, folder, name, *options):
        self.name, self.prefix = name, folder / ("bus-" + name)
        super().__init__(BUILD / "tests/emu/sensor_server", name, self.prefix, "--log", chamber / "log.csv", "--clock-error", "0.01",
                         "--noise-dps", 0.03, *options)
        assert self.process.stdout.readline() == "ready\n"

    def options(self, port):
        pair = {"sensor": self.name, "bus": self.prefix}
        return [a for k, v in pair.items() for a in ("--" + k, v)] if port == "posix" else ["%s=%s" % p for p in pair.items()]


def hang_up(device):
    """The test's own end of the line is closed: calibrate takes its place."""
    if device.port == "posix":
        os.close(device.line.fd)
    else:
        os.close(device.line.socket.detach())


def calibrate(device, *arguments, status=0):
    done = subprocess.run([str(a) for a in (BIN / "calibrate", "--port", device.name, *arguments)],
                          capture_output=True, text=True, timeout=120)
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout


def run_arguments(chamber, *more):
    """Ends with the chamber's log, so that every device learns from the same seconds."""
    return ["--json", "-", "-q", "run", "--order", 3, "--model", chamber / "model.json", "--range", "0:60",
            "--max-error", 1000, *more]


def info(device):
    return json.loads(calibrate(device, "--json", "-", "-q", "info"))


# ---- the whole job ----

def learn_table(port, name, chamber, folder):
    """Table as JSON without its time of making, and what info says of the sensor."""
    with Sensor(chamber, folder, name) as sensor, \
            Device(port, folder / (port + ".flash"), extra=sensor.options(port)) as device:
        hang_up(device)
        calibrate(device, *run_arguments(chamber, "-o", folder / (port + ".json")))
        table = json.loads((folder / (port + ".json")).read_text())
        return {k: v for k, v in table.items() if k != "created"}, info(device)["sensor"]


def assert_table_is_the_chambers(table, tolerance_dph=20):
    truth = MODEL["bias"]["coeff_dph"]
    for axis in table["axes"][:3]:
        for tn in (-0.8, 0, 0.8):
            error = sum((a - b) * tn ** k for k, (a, b) in enumerate(zip(axis["coeff_dph"], truth)))
            assert abs(error) < tolerance_dph, (axis["axis"], tn, error)


def assert_nothing_went_wrong(sensor):
    assert sensor["status"] == 0 and sensor["starts"] == 1
    assert not any(sensor[key] for key in ("wrong_identity", "bus_errors", "overruns", "lost", "invalid", "resets",
                                           "stuck_temp", "stuck_data", "saturated", "supply_refused"))


@pytest.mark.parametrize("name, identity", [("mpu6050", 0x68), ("mpu6500", 0x70), ("lsm6dso", 0x6C), ("bmi088", 0x0F),
                                            ("icm42688p", 0x47)])
def test_each_driver_calibrates_its_modelled_sensor(name, identity, chamber, tmp_path):
    table, sensor = learn_table("posix", name, chamber, tmp_path)
    assert_table_is_the_chambers(table)
    assert_nothing_went_wrong(sensor)
    assert sensor["identity"] == identity
    assert abs(sensor["clock_ppm"] - 10000) < 100


def test_the_mpu6050_driver_gives_the_same_table_on_host_cortex_m4f_and_riscv(chamber, tmp_path):
    ports = ["posix", "stm32f405_qemu"] + ([] if RISCV_MISSING else ["riscv_virt"])
    if not RISCV_MISSING:
        subprocess.run(["make", "-C", str(ROOT), "BUILD=%s" % BUILD, "firmware-riscv"], check=True, capture_output=True)
    tables = {port: learn_table(port, "mpu6050", chamber, tmp_path) for port in ports}
    for port in ports[1:]:
        assert tables[port] == tables["posix"], port
    if RISCV_MISSING:
        pytest.skip("RISC-V was left out: %s missing: apt-get install gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf "
                    "qemu-system-misc" % ", ".join(RISCV_MISSING))


def test_the_stm32f405_is_calibrated_flashed_reset_and_verified_by_the_command_line(chamber, tmp_path):
    table = tmp_path / "table.json"
    with Sensor(chamber, tmp_path, "icm42688p") as sensor, \
            Device("stm32f405_qemu", tmp_path / "flash", extra=sensor.options("stm32f405_qemu")) as device:
        hang_up(device)
        before = info(device)
        assert before["device"] == "qemu stm32f405" and not before["has_table"]
        calibrate(device, *run_arguments(chamber, "-o", table))
        assert_table_is_the_chambers(json.loads(table.read_text()))
        after = info(device)
        assert after["has_table"] and after["sequence"] == 1
        assert_nothing_went_wrong(after["sensor"])
        calibrate(device, "flash", table)
        line = device.__enter__().line
        assert line.done("reboot", reserved=0) == 0
        os.close(line.socket.detach())
        time.sleep(0.5)
        calibrate(device, "verify", table)
        again = info(device)
        assert again["has_table"] and again["table_origin"] == "flashed by a host" and again["uptime_s"] < 60


# ---- bad input ----

def record_with(fault, chamber, folder, name):
    """Seconds of a recording, its result, and what info says then; the calibration's notes are not needed here."""
    with Sensor(chamber, folder, name, "--fault", fault) as sensor, Device("posix", extra=sensor.options("posix")) as device:
        hang_up(device)
        log = folder / "log.csv"
        result = json.loads(calibrate(device, "--json", "-", "-q", "record", "--stall-s", 30, "--duration-s", RECORD_S,
                                      "-o", log))
        with open(log) as lines:
            rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
        return rows, result, info(device)["sensor"]


def assert_no_unmarked_row_is_wrong(rows, chamber):
    """A row without a flag says what the chamber did, to some sigma of noise and the time stamp's fraction of a second."""
    with open(chamber / "log.csv") as lines:
        truth = [r for r in csv.DictReader(line for line in lines if not line.startswith("#"))]
    unmarked = 0
    for row in rows:
        if not row["gx_dph"] or int(row["gx_flags"] or 0) & 4:
            continue
        unmarked += 1
        near = truth[max(0, int(row["t_s"]) - 3):int(row["t_s"]) + 2]
        lo, hi = (f(float(r["gx_dph"]) for r in near) for f in (min, max))
        assert lo - 60 < float(row["gx_dph"]) < hi + 60, row
        lo, hi = (f(float(r["temp_degc"]) for r in near) for f in (min, max))
        assert lo - 0.3 < float(row["temp_degc"]) < hi + 0.3, row
    return unmarked


FAULTS = [("zeros:100:110", "bus_errors", "bus fails"), ("reset:100", "resets", "reset itself"),
          ("overrun:100", "overruns", "overran")]
BUS_FAULTS = [("ones:100:110", "bus_errors", "bus fails"), ("errors:100:110", "bus_errors", "bus fails")]


@pytest.mark.parametrize("name, fault, count, text",
                         [(name, *fault) for name in ("mpu6050", "icm42688p", "lsm6dso", "bmi088") for fault in FAULTS] +
                         [("mpu6050", *fault) for fault in BUS_FAULTS])
def test_a_fault_in_the_middle_is_counted_told_and_kept_out(name, fault, count, text, chamber, tmp_path):
    rows, result, sensor = record_with(fault, chamber, tmp_path, name)
    assert sensor[count] >= 1 and sensor["lost"] > 0
    assert sensor["status"] == 0  # it works again
    assert text in result["sensor_trouble"] and "samples were lost" in result["sensor_trouble"]
    assert assert_no_unmarked_row_is_wrong(rows, chamber) > RECORD_S - 30


@pytest.mark.parametrize("name", ["mpu6050", "icm42688p", "lsm6dso"])
def test_a_temperature_that_never_changes_marks_its_seconds(name, chamber, tmp_path):
    rows, result, sensor = record_with("temperature:20:150", chamber, tmp_path, name)
    assert sensor["stuck_temp"] == 1 and "temperature stands still" in result["sensor_trouble"]
    marked = [row for row in rows if int(row["gx_flags"] or 0) & 4]
    assert 65 < len(marked) < 75  # from its 60th second on


@pytest.mark.parametrize("name", ["mpu6050", "icm42688p", "lsm6dso", "bmi088"])
def test_another_chip_is_named_and_nothing_of_it_is_taken(name, chamber, tmp_path):
    rows, result, sensor = record_with("identity:0:20", chamber, tmp_path, name)
    assert sensor["wrong_identity"] >= 10 and sensor["starts"] > 10 and sensor["status"] == 0
    assert "another chip answers" in result["sensor_trouble"]
    assert int(rows[0]["t_s"]) >= 20
    assert assert_no_unmarked_row_is_wrong(rows, chamber) > RECORD_S - 30


def test_info_says_in_words_what_the_sensor_met(chamber, tmp_path):
    with open(chamber / "log.csv") as log:  # 40 seconds
        (tmp_path / "log.csv").write_text("".join([line for line in log][:60]))
    with Sensor(tmp_path, tmp_path, "mpu6050", "--fault", "identity:0:1000") as sensor, \
            Device("posix", extra=sensor.options("posix")) as device:
        hang_up(device)
        assert "another chip answers in the sensor's place" in calibrate(device, "record", "-o", tmp_path / "raw.csv")
        text = calibrate(device, "info")
        assert "sensor mpu6050: sensor fault or no data, identity 0x12" in text
        assert "wrong identities" in text
