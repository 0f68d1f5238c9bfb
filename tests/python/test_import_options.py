# SPDX-License-Identifier: MIT
"""An option that a format does not know, or that the file contradicts, is said; none is ignored in silence."""
import foreign
import numpy as np
import pytest

import imucal
from imucal.__main__ import main
from imucal.errors import DataError, UsageError

OWN = "# imucal-log = 1\nt_s,temp_degc,gx_dph\n" + "".join(f"{i},{20 + i / 100:.2f},{(i * 37) % 11}\n" for i in range(1, 301))


def write(path, text):
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder, rec = tmp_path_factory.mktemp("options"), foreign.recording(duration_s=30)
    for kind in ("ulog", "bag1", "csv", "st", "hex", "mat5"):
        foreign.write(kind, folder, rec)
    (folder / "log.own").write_text(OWN)
    return folder


@pytest.mark.parametrize("kind, options, words", [
    ("ulog", ["--topic", "vehicle_imu"], "sensor_combined"), ("ulog", ["--unit", "dps"], "--unit"), ("ulog", ["--gyro", "x,y,z"], "--gyro"),
    ("ulog", ["--time", "timestamp"], "--time"), ("ulog", ["--temp", "temperature"], "--temp"), ("bag1", ["--unit", "dps"], "--unit"),
    ("bag1", ["--time", "t"], "--time"), ("csv", ["--topic", "imu"], "--topic"), ("st", ["--topic", "imu"], "--topic"), ("hex", ["--unit", "dps"], "--unit"),
    ("hex", ["--temp", "t"], "--temp"), ("own", ["--rate", "100"], "--rate"), ("own", ["--unit", "dps"], "--unit"), ("own", ["--time", "t_s"], "--time"),
    ("csv", ["--scale", "2"], "--scale"), ("csv", ["--unit", "radps", "--scale", "2"], "--scale"), ("mat5", ["--topic", "imu"], "--topic")])
def test_option_of_another_format_is_a_usage_error(files, tmp_path, kind, options, words, capsys):
    assert main(["import", str(files / f"log.{kind}"), *options, "-o", str(tmp_path / "o.csv")]) == 2
    said = capsys.readouterr().err
    assert words in said and not (tmp_path / "o.csv").exists()
    if "--topic" not in options:
        assert main(["look", str(files / f"log.{kind}"), *options, "-o", str(tmp_path / "p.png")]) == 2
        assert words in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["ulog", "bag1", "csv", "hex", "own", "mat5"])
def test_sensor_that_is_not_there_is_refused_with_those_that_are(files, kind):
    unit = {"unit": "radps"} if kind == "mat5" else {}
    with pytest.raises(DataError, match=r"no sensor 5 \(there are: 0"):
        imucal.import_log(files / f"log.{kind}", instance=5, **unit)
    assert imucal.import_log(files / f"log.{kind}", instance=0, **unit).chosen == 0


def test_unit_that_the_columns_contradict_is_taken_and_said(files):
    plain = imucal.import_log(files / "log.csv")
    other = imucal.import_log(files / "log.csv", unit="dps", keep_moving=True)
    assert [n for n in other.notes if "--unit dps" in n and "radps" in n] and not [n for n in plain.notes if "--unit" in n]
    assert not [n for n in imucal.import_log(files / "log.csv", unit="radps").notes if "--unit" in n]


def test_topic_that_a_bag_has_not_lists_those_it_has(files):
    with pytest.raises(DataError, match="no topic /other.*there are: /imu/data_raw"):
        imucal.import_log(files / "log.bag1", topic="/other")


def test_library_takes_the_same_view(files):
    with pytest.raises(UsageError, match="--unit"):
        imucal.import_log(files / "log.ulog", unit="dps")


def test_what_a_library_says_of_a_file_is_one_line(tmp_path, capsys):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag/metadata.yaml").write_text("nonsense: [")
    assert main(["import", str(tmp_path / "bag"), "-o", str(tmp_path / "log.csv")]) == 3
    said = capsys.readouterr().err
    assert "a ROS bag that cannot be read (AnyReaderError: " in said and said.count("\n") == 1


def test_axes_of_our_own_log_keep_name_and_unit_whatever_they_begin_with(tmp_path):
    log = imucal.read_log(write(tmp_path / "own.csv", OWN.replace("gx_dph", "alpha_dph")))
    log.rates["up_mg"] = log.rates["alpha_dph"] + 1000
    imucal.write_log(tmp_path / "own.csv", log)
    taken = imucal.import_log(tmp_path / "own.csv").log
    assert taken.axes == ["alpha_dph", "up_mg"]
    for name in taken.axes:
        np.testing.assert_array_equal(taken.rates[name], log.rates[name])


def test_an_accelerometer_that_cannot_be_taken_is_said(tmp_path, capsys):
    rec = foreign.recording(duration_s=30)
    rec.accel_ms2[:] = 0
    path = foreign.write("bag1", tmp_path, rec)
    assert main(["import", str(path), "-o", str(tmp_path / "log.csv"), "--accel"]) == 3
    said = capsys.readouterr().err
    assert "log.bag1: sensor 0 (/imu/data_raw): no accelerometer is taken with it; leave --accel out" in said
    assert not (tmp_path / "log.csv").exists()
