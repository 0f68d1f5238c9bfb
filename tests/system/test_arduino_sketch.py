# SPDX-License-Identifier: MIT
"""The Arduino sketch for the MPU-6050, compiled for this machine (tests/emu/arduino/native.cpp): `calibrate` works with it over
a pseudo-terminal as with a board."""
import csv
import json
import subprocess

from child import Child
from device_link import Line
from where import BIN, BUILD


class Sketch(Child):
    def __init__(self, eeprom, *options):
        super().__init__(BUILD / "tests/emu/sketch", eeprom, *options)
        self.name = self.process.stdout.readline().split()[1]


def calibrate(sketch, *arguments):
    done = subprocess.run([str(a) for a in (BIN / "calibrate", "--port", sketch.name, "--json", "-", "-q", *arguments)],
                          capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_info_and_record_work_with_the_sketch(tmp_path):
    with Sketch(tmp_path / "eeprom") as sketch:
        info = json.loads(calibrate(sketch, "info"))
        assert info["device"] == "arduino mpu6050" and info["serial"] == "hobby-1" and not info["has_table"]
        calibrate(sketch, "record", "--duration-s", 30, "-o", tmp_path / "log.csv")
        with open(tmp_path / "log.csv") as lines:
            rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))[2:]
        assert len(rows) > 20
        for row in rows:
            t_s = float(row["t_s"]) - 0.5
            assert abs(float(row["gx_dph"]) - 3600 - 7.2 * t_s) < 100 and abs(float(row["gy_dph"]) + 7200) < 100
            assert abs(float(row["temp_degc"]) - 20 - 0.1 * t_s) < 0.2
        sensor = json.loads(calibrate(sketch, "info"))["sensor"]
        assert sensor["name"] == "mpu6050" and sensor["identity"] == 0x68 and sensor["status"] == 0
        assert sensor["wrong_identity"] == sensor["resets"] == sensor["invalid"] == 0


def test_a_table_is_flashed_verified_and_outlives_the_power(tmp_path):
    table = tmp_path / "table.json"
    model = tmp_path / "model.json"
    model.write_text(json.dumps({"imucal_model": 1, "arw_deg_rt_h": 0.22, "markov": [{"sigma_dph": 2, "tau_s": 100}],
                                 "bias": {"t0_degc": 30, "range_degc": 10, "coeff_dph": [0]}}))
    with Sketch(tmp_path / "eeprom") as sketch:
        calibrate(sketch, "run", "--order", 1, "--model", model, "--range", "20:40", "--duration-s", 200,
                  "--accept", "temp-ramp", "-o", table)  # a hurried chamber
        calibrate(sketch, "verify", table)
    with Sketch(tmp_path / "eeprom") as sketch:
        info = json.loads(calibrate(sketch, "info"))
        assert info["has_table"] and info["sequence"] == 1
        calibrate(sketch, "verify", table)
        calibrate(sketch, "record", "--duration-s", 20, "-o", tmp_path / "raw.csv", "--compensated",
                  tmp_path / "log.csv")
        with open(tmp_path / "log.csv") as lines:
            rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))[2:]
        assert all(abs(float(row["gx_dph"])) < 100 for row in rows)  # 3600 before


def test_each_start_is_counted_and_reboot_is_one(tmp_path):
    boot_ids = []
    for _ in range(2):
        with Sketch(tmp_path / "eeprom") as sketch:
            line = Line(sketch.name).greet()
            boot_ids.append(line.hello["boot_id"])
            assert line.done("reboot", reserved=0) == 0
            boot_ids.append(line.greet().hello["boot_id"])
    assert boot_ids == [boot_ids[0] + i for i in range(4)]


def test_without_a_sensor_the_line_works_and_info_says_why(tmp_path):
    with Sketch(tmp_path / "eeprom", "--no-sensor") as sketch:
        info = json.loads(calibrate(sketch, "info"))
        assert info["sensor"]["status"] == -48 and info["sensor"]["bus_errors"] >= 1
