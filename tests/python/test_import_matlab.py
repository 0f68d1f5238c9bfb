# SPDX-License-Identifier: MIT
"""MATLAB files: structs by field, a timetable exported as struct, and objects that only MATLAB can read."""
import foreign
import numpy as np
import pytest
from scipy.io import savemat

import imucal
from imucal.__main__ import main
from imucal.errors import DataError
from imucal.importers import Options


@pytest.fixture(scope="module")
def rec():
    return foreign.recording(duration_s=75)


def arrays(rec):
    return {"Time": rec.t_us / 1e6, "AngularVelocity": rec.gyro_radps.astype(float), "Temperature": rec.temp_degc.astype(float)}


def means_of(log, rec):
    expected = foreign.expected_seconds(rec)
    assert log.t_s.tolist() == sorted(expected)
    for i, axis in enumerate(log.axes):
        np.testing.assert_allclose(log.rates[axis], [expected[int(t)][1 + i] for t in log.t_s], atol=1e-7, rtol=1e-12)


def test_timetable_exported_as_struct(tmp_path, rec):
    savemat(tmp_path / "log.mat", {"s": arrays(rec)})
    means_of(imucal.import_log(tmp_path / "log.mat", unit="radps").log, rec)


def test_two_structs_with_the_same_fields_are_chosen_by_field(tmp_path, rec):
    other = {**arrays(rec), "AngularVelocity": 2 * rec.gyro_radps.astype(float)}
    savemat(tmp_path / "log.mat", {"imu0": arrays(rec), "imu1": other})
    first = imucal.import_log(tmp_path / "log.mat", unit="radps", gyro="imu0.AngularVelocity", time="imu0.Time:s", temp="imu0.Temperature").log
    means_of(first, rec)
    second = imucal.import_log(tmp_path / "log.mat", unit="radps", gyro="imu1.AngularVelocity", time="imu1.Time", temp="imu1.Temperature").log
    for one, two in zip(first.rates.values(), second.rates.values()):
        np.testing.assert_allclose(two, 2 * one, rtol=1e-12)
    with pytest.raises(DataError, match="imu0.AngularVelocity_x"):  # none chosen: the names there are
        imucal.import_log(tmp_path / "log.mat", unit="radps")


def test_fields_are_given_on_the_command_line(tmp_path, rec, capsys):
    savemat(tmp_path / "log.mat", {"a": {"w": rec.gyro_radps.astype(float), "clock": rec.t_us / 1e6, "die": rec.temp_degc.astype(float)}, "note": "x"})
    assert main(["import", str(tmp_path / "log.mat"), "--gyro", "a.w", "--time", "a.clock:s", "--temp", "a.die", "--unit", "radps", "-o",
                 str(tmp_path / "log.csv")]) == 0
    assert len(imucal.read_log(tmp_path / "log.csv").t_s) == len(foreign.expected_seconds(rec))
    assert main(["import", str(tmp_path / "log.mat"), "--gyro", "a.v", "--unit", "radps", "-o", str(tmp_path / "no.csv")]) == 3
    assert 'no column "a.v"' in capsys.readouterr().err and not (tmp_path / "no.csv").exists()


@pytest.mark.parametrize("class_name", ["timetable", "table"])
def test_a_real_timetable_is_refused_with_the_lines_that_export_it(tmp_path, class_name, capsys):
    (tmp_path / "log.mat").write_bytes(foreign.matlab_object("TT", class_name))
    assert main(["import", str(tmp_path / "log.mat"), "-o", str(tmp_path / "log.csv")]) == 3
    said = capsys.readouterr().err
    assert f"TT is a MATLAB {class_name}" in said and "table2struct(timetable2table(TT), 'ToScalar', true)" in said and "seconds(" in said
    assert not (tmp_path / "log.csv").exists()


def test_a_timetable_of_matlab_7_3_is_refused_too(tmp_path):
    import h5py
    with h5py.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        file["TT"] = np.array([[0xDD000000, 2, 1, 1, 1, 1]], dtype=np.uint32)
        file["TT"].attrs["MATLAB_class"] = np.bytes_("timetable")
        file["TT"].attrs["MATLAB_object_decode"] = np.int32(3)
    with open(tmp_path / "log.mat", "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    with pytest.raises(DataError, match="TT is a MATLAB timetable.*table2struct"):
        imucal.import_log(tmp_path / "log.mat")


def test_a_struct_whose_time_stayed_a_duration_says_how_to_mend_it(tmp_path, rec):
    import h5py
    with h5py.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        group = file.create_group("s")
        group["AngularVelocity"] = rec.gyro_radps.astype(float).T
        group["Time"] = np.array([[0xDD000000, 2, 1, 1, 1, 2]], dtype=np.uint32)
        group["Time"].attrs["MATLAB_class"] = np.bytes_("duration")
        group["Time"].attrs["MATLAB_object_decode"] = np.int32(3)
    with open(tmp_path / "log.mat", "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    with pytest.raises(DataError, match=r"s.Time is a MATLAB duration.*s.Time = seconds\(s.Time - s.Time\(1\)\)"):
        imucal.import_log(tmp_path / "log.mat", unit="radps")


def test_options_of_the_caller_stay_as_they_were(tmp_path, rec):
    savemat(tmp_path / "log.mat", {"a": {"w": rec.gyro_radps.astype(float), "t": rec.t_us / 1e6, "temp": rec.temp_degc.astype(float)}})
    options = Options(gyro="a.w", unit="radps")
    imucal.import_log(tmp_path / "log.mat", options)
    assert options.gyro == "a.w"
