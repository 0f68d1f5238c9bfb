# SPDX-License-Identifier: MIT
"""What `calibrate` says of a board that a newcomer may build: a thermometer that stands still, a sensor that delivers faults only."""
import csv
import pathlib
import re
import sys

import pytest

from device_link import Device
from imu import Imu
from test_firmware_sensors import Sensor, chamber, hang_up  # noqa: F401 (chamber is a fixture)

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from sick.device import DeviceBench, as_bytes, change  # noqa: E402


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


def run_on_sensor(chamber, folder, fault, *arguments):  # noqa: F811
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

def test_run_thermometer_that_stands_still_ends_the_run_after_faulty_s_and_is_named_first(chamber, tmp_path):  # noqa: F811
    status, err = run_on_sensor(chamber, tmp_path, "temperature:100:9000", "--faulty-s", 100)
    assert status == 4, err
    assert any("note: from 16" in line and "temperature stands still" in line for line in err), err
    assert err[-1].index("temperature stands still since 16") < err[-1].index("every second is faulty")
    assert len(recorded(tmp_path)) > 250


def test_run_that_ends_for_another_reason_tells_what_the_device_told(chamber, tmp_path):  # noqa: F811
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
    assert status == 4 and "from 201 s on every second is faulty" in err[-1] and 600 <= int(re.search(r"(\d+) s by now", err[-1])[1]) < 1100, err
    assert any("note: at 20" in line and "reported a fault" in line for line in err[:-1])
    assert len(recorded(folder)) >= 800


def test_run_faults_of_one_axis_or_of_less_than_faulty_s_do_not_end_the_run(bench):
    for fault in (lambda s: (s["t_s"] >= 200).astype("u1"), lambda s: ((s["t_s"] >= 200) & (s["t_s"] < 790)).astype("u1") * 7):
        status, _, err, _ = calibrate_run(bench, change(fault=fault)(bench.healthy))
        assert status == 1 and "faults in" in " ".join(err).replace("fault in", "faults in"), err
