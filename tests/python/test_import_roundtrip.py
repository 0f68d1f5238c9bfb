# SPDX-License-Identifier: MIT
"""A recording written into each format and imported again gives the 1-s means of its samples."""
import math

import foreign
import numpy as np
import pytest
from foreign import write

import imucal
from imucal.errors import DataError
from imucal.importers import detect
from imucal.log import read_log, write_log

EPOCH_FREE = ["ulog", "bin", "hex", "csv", "st", "parquet", "blackbox", "mat5", "mat5struct", "mat73"]
BAGS = ["bag1", "bag2db3", "bag2mcap"]


@pytest.fixture(scope="module")
def rec():
    return foreign.recording()


@pytest.fixture(scope="module")
def short():
    return foreign.recording(duration_s=75)


def check(result, expected, temp_tolerance=1e-9, rate_tolerance=1e-7):
    log = result.log
    assert log.t_s.tolist() == sorted(expected)
    want = np.array([expected[int(t)] for t in log.t_s])
    np.testing.assert_allclose(log.temp_degc, want[:, 0], atol=temp_tolerance, rtol=0)
    for i, axis in enumerate(("gx_dph", "gy_dph", "gz_dph")):
        np.testing.assert_allclose(log.rates[axis], want[:, 1 + i], atol=rate_tolerance, rtol=1e-12)


@pytest.mark.parametrize("kind", EPOCH_FREE)
def test_import_of_each_format_gives_the_means_of_its_samples(kind, tmp_path, rec):
    if kind == "bin":
        pytest.importorskip("pymavlink")
    result = imucal.import_log(write(kind, tmp_path, rec), unit="radps" if kind.startswith("mat") else None)
    expected = foreign.expected_seconds(rec)
    if kind == "hex":  # the counter's zero is not the recording's
        shift = int(result.log.t_s[0]) - min(expected)
        expected = {k + shift: v for k, v in expected.items()}
    check(result, expected, 0.06 if kind == "blackbox" else 1e-9, 2e-6 if kind in ("csv", "st", "parquet", "blackbox") else 1e-7)
    assert result.moving_seconds == 5
    assert (result.n_duplicate, result.n_backward) == (1, 1)
    assert result.gaps == 2 and result.gap_seconds == 5 + 3


@pytest.mark.parametrize("kind", BAGS)
def test_import_of_bags_counts_from_the_first_second_of_the_epoch(kind, tmp_path, short):
    result = imucal.import_log(write(kind, tmp_path, short))
    expected = foreign.expected_seconds(short)
    origin = min(expected) - 1
    check(result, {k - origin: v for k, v in expected.items()})
    assert result.log.metadata["t_s_origin_s"] == 1_700_000_000 + origin
    assert result.format == ("rosbag1" if kind == "bag1" else "rosbag2")


def test_format_is_known_by_content_and_not_by_name(tmp_path, short):
    foreign.write_ulog(tmp_path / "flight.csv", [short])
    assert detect(tmp_path / "flight.csv")[0] == "px4-ulog"
    foreign.write_table(tmp_path / "table.ulg", short, "csv")
    assert detect(tmp_path / "table.ulg")[0] == "csv"


def test_written_log_reads_back_within_its_last_digit(tmp_path, short):
    log = imucal.import_log(write("csv", tmp_path, short)).log
    write_log(tmp_path / "log.csv", log)
    again = read_log(tmp_path / "log.csv")
    for name in log.rates:
        np.testing.assert_allclose(again.rates[name], log.rates[name], atol=5.1e-7, rtol=0)
    assert again.metadata["source_sha256"] == log.metadata["source_sha256"]
    whole = np.isfinite(log.rates["gx_dph"])
    assert imucal.import_log(tmp_path / "log.csv").log.t_s.tolist() == log.t_s[whole].tolist()


def test_second_instance_is_the_second_sensor(tmp_path, short):
    other = foreign.Recording(short.t_us, -2 * short.gyro_radps, short.accel_ms2, short.temp_degc + 10, short.moving_s)
    foreign.write_ulog(tmp_path / "two.ulg", [short, other])
    with pytest.raises(DataError, match="2 sensors and none chosen.*--instance 0"):
        imucal.import_log(tmp_path / "two.ulg")
    result = imucal.import_log(tmp_path / "two.ulg", instance=1)
    check(result, foreign.expected_seconds(other))
    assert result.log.metadata["px4_device_id"] == 1001
    assert [s["instance"] for s in result.sensors] == [0, 1]


def test_second_imu_of_an_ardupilot_log_is_the_second_sensor_and_told_where_it_is_corrected(tmp_path, short):
    pytest.importorskip("pymavlink")
    foreign.write_ardupilot(tmp_path / "two.bin", short, per_instance=True, parameters=[("INS_TCAL2_ENABLE", 1)])
    result = imucal.import_log(tmp_path / "two.bin", instance=1)
    other = foreign.Recording(short.t_us, -short.gyro_radps, short.accel_ms2, short.temp_degc, short.moving_s)
    check(result, foreign.expected_seconds(other))
    assert [s["instance"] for s in result.sensors] == [0, 1] and result.log.metadata["INS_TCAL2_ENABLE"] == "1"
    assert any("INS_TCAL2_ENABLE = 1: these rates are already corrected" in note for note in result.notes)
    check(imucal.import_log(tmp_path / "two.bin", instance=0), foreign.expected_seconds(short))


def test_accelerometer_axes_come_in_mg(tmp_path, short):
    foreign.write_ulog(tmp_path / "a.ulg", [short])
    result = imucal.import_log(tmp_path / "a.ulg", with_accel=True)
    assert result.log.axes == ["gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"]
    still = [t for t in result.log.t_s if not math.isnan(result.log.rates["az_mg"][result.log.t_s.tolist().index(t)])]
    assert len(still) > 60
    assert np.nanmean(result.log.rates["az_mg"]) == pytest.approx(-9.8 / 9.80665e-3, abs=1)


def test_time_column_that_wraps_at_32_bits_goes_on(tmp_path, short):
    import polars
    t = (short.t_us + 2 ** 32 - 130_000_000) % 2 ** 32
    g = short.gyro_radps.astype(float)
    polars.DataFrame({"t_us": t, "gx": g[:, 0], "gy": g[:, 1], "gz": g[:, 2], "temp": short.temp_degc.astype(float)}).write_csv(tmp_path / "w.csv")
    result = imucal.import_log(tmp_path / "w.csv", unit="radps")
    assert len(result.log.t_s) > 60 and np.all(np.diff(result.log.t_s) > 0)
    assert result.n_backward <= 1  # the sample that was old in the recording, not the wrap


def test_one_row_a_second_is_taken_as_it_stands(tmp_path):
    t = np.arange(100, 160)
    rates = 50 + np.arange(60) * 0.25
    (tmp_path / "one.csv").write_text("time_s,gyro_z_dph,temp\n" + "".join(f"{a},{b},{20 + a / 100}\n" for a, b in zip(t, rates)))
    result = imucal.import_log(tmp_path / "one.csv", gyro="gyro_z_dph")
    assert result.log.t_s.tolist() == t.tolist()
    assert result.log.rates["gyro_z_dph"].tolist() == rates.tolist()
