# SPDX-License-Identifier: MIT
"""Time stamps as loggers write them: coarse, frozen, set back.  A sample is lost with a word, and not by the thousand."""
import json

import numpy as np
import pytest

import foreign
import imucal
from imucal.__main__ import main

N, RATE_HZ = 12000, 100
HEAD = "time_s,gx_dps,gy_dps,gz_dps,temp\n"


def samples():
    """(times of N samples at 100 Hz, text of their other columns)."""
    rng = np.random.default_rng(1)
    gyro = 0.01 * rng.standard_normal((N, 3)) + [0.1, -0.2, 0.05]
    return np.arange(N) / RATE_HZ, [f"{x:.6f},{y:.6f},{z:.6f},{20 + i / 1000:.3f}" for i, (x, y, z) in enumerate(gyro)]


def table(path, times, rows):
    path.write_text(HEAD + "".join(f"{t},{row}\n" for t, row in zip(times, rows)))
    return path


def taken(path, capsys, *options, expect=0):
    """(log or None, JSON or None, standard error) of `imucal import`."""
    out, result = path.with_suffix(".out"), path.with_suffix(".json")
    status = main(["import", str(path), "-o", str(out), "--json", str(result), *options])
    said = capsys.readouterr()
    assert status == expect, said
    assert out.exists() == result.exists() == (expect == 0)
    return (imucal.read_log(out), json.loads(result.read_text()), said.err) if expect == 0 else (None, None, said.err)


def coarse(t_s, resolution_s):
    return [f"{np.floor(t / resolution_s + 1e-9) * resolution_s:.3f}" for t in t_s]


def bursts(t_s):
    """The times at which a buffer was emptied, now and then."""
    at = np.concatenate([[0.0], np.sort(np.random.default_rng(5).uniform(0, t_s[-1], 60))])
    return at[np.searchsorted(at, t_s, side="right") - 1]


@pytest.mark.parametrize("resolution_s", [1.0, 0.1, 0.016, 2.0])
def test_samples_that_share_a_coarse_stamp_are_spread_over_it(tmp_path, capsys, resolution_s):
    t_s, rows = samples()
    fine, _, _ = taken(table(tmp_path / "fine.csv", [f"{t:.3f}" for t in t_s], rows), capsys)
    log, result, said = taken(table(tmp_path / "coarse.csv", coarse(t_s, resolution_s), rows), capsys)
    assert "time stamps are coarse" in said and f"{resolution_s:g} s" in said and "--rate" in said
    assert result["duplicates"] == 0 and result["sensors"][0]["rate_hz"] == pytest.approx(RATE_HZ, rel=0.03)
    np.testing.assert_array_equal(log.t_s, fine.t_s)
    inner = slice(3, -3)
    tolerance = 1e-6 if resolution_s in (1.0, 0.1) else 0.3 * 0.01 * 3600  # a few of a hundred samples lie in the second beside
    np.testing.assert_allclose(log.rates["gx_dph"][inner], fine.rates["gx_dph"][inner], atol=tolerance)
    assert not log.flags


def test_recording_that_begins_and_ends_within_a_stamp_keeps_its_place(tmp_path, capsys):
    t_s, rows = samples()
    t_s = t_s + 7.63
    fine, _, _ = taken(table(tmp_path / "fine.csv", [f"{t:.3f}" for t in t_s], rows), capsys)
    log, _, _ = taken(table(tmp_path / "coarse.csv", coarse(t_s, 1.0), rows), capsys)
    np.testing.assert_array_equal(log.t_s, fine.t_s)
    np.testing.assert_allclose(log.rates["gx_dph"], fine.rates["gx_dph"], atol=1e-6)


@pytest.mark.parametrize("name, times, words", [
    ("frozen", lambda t: ["5.0"] * N, "1 time stamp"),
    ("of float32 since 1970", lambda t: [f"{float(np.float32(1.7643e9 + v)):.1f}" for v in t], "time stamp"),
    ("in bursts", lambda t: [f"{v:.3f}" for v in bursts(t)], "time stamp")])
def test_stamps_that_tell_no_time_are_refused_and_the_rate_is_the_remedy(tmp_path, capsys, name, times, words):
    t_s, rows = samples()
    path = table(tmp_path / "log.csv", times(t_s), rows)
    _, _, said = taken(path, capsys, expect=3)
    assert "log.csv" in said and words in said and "--rate HZ" in said and "differ" in said
    log, result, said = taken(path, capsys, "--rate", "100")
    fine, _, _ = taken(table(tmp_path / "fine.csv", [f"{t:.3f}" for t in t_s], rows), capsys)
    assert "counted" in said and len(log.t_s) == N // RATE_HZ
    np.testing.assert_allclose(log.rates["gx_dph"], fine.rates["gx_dph"], atol=1e-6)


def test_rows_that_stand_twice_are_taken_once(tmp_path, capsys):
    t_s, rows = samples()
    stamps = [f"{t:.3f}" for t in t_s]
    once, _, _ = taken(table(tmp_path / "once.csv", stamps, rows), capsys)
    log, result, said = taken(table(tmp_path / "twice.csv", np.repeat(stamps, 2), np.repeat(rows, 2)), capsys)
    assert result["duplicates"] == N and "rate_hz" in result["sensors"][0] and result["sensors"][0]["rate_hz"] == RATE_HZ
    assert "stand twice" in said
    np.testing.assert_array_equal(log.rates["gx_dph"], once.rates["gx_dph"])


@pytest.mark.parametrize("name, order", [("backwards", np.arange(N)[::-1]), ("second half first", np.r_[N // 2:N, :N // 2]),
                                         ("shuffled", np.random.default_rng(3).permutation(N))])
def test_record_of_which_much_would_be_lost_as_late_is_refused(tmp_path, capsys, name, order):
    t_s, rows = samples()
    _, _, said = taken(table(tmp_path / "log.csv", [f"{t_s[i]:.3f}" for i in order], [rows[i] for i in order]), capsys, expect=3)
    assert "log.csv" in said and "before newer ones" in said and "sort" in said and "cut" in said


def test_a_few_late_samples_and_doubled_stamps_are_left_out_and_counted(tmp_path, capsys):
    t_s, rows = samples()
    stamps = [f"{t:.3f}" for t in t_s]
    stamps[500], stamps[700] = stamps[499], stamps[690]
    log, result, said = taken(table(tmp_path / "log.csv", stamps, rows), capsys)
    assert (result["duplicates"], result["same_stamps"], result["steps_back"]) == (0, 1, 1)
    assert "1 sample with the time of another" in said and len(log.t_s) == N // RATE_HZ


def test_look_says_what_became_of_the_stamps(tmp_path, capsys):
    t_s, rows = samples()
    path = table(tmp_path / "coarse.csv", coarse(t_s, 1.0), rows)
    assert main(["look", str(path), "-o", str(tmp_path / "p.png"), "--no-ml"]) == 0
    assert "time stamps are coarse" in capsys.readouterr().err


# --- the rate, and samples without values ---

@pytest.mark.parametrize("rate_hz, expect", [("1000", 3), ("210", 3), ("45", 3), ("120", 0), ("100", 0)])
def test_rate_that_contradicts_the_stamps_is_refused(tmp_path, capsys, rate_hz, expect):
    t_s, rows = samples()
    log, _, said = taken(table(tmp_path / "log.csv", [f"{t:.3f}" for t in t_s], rows), capsys, "--rate", rate_hz, expect=expect)
    if expect:
        assert f"--rate {rate_hz}" in said and "100 Hz" in said and "leave --rate out" in said
    else:
        assert np.isfinite(log.rates["gx_dph"]).all()


@pytest.mark.parametrize("seed", range(3))
def test_samples_without_a_value_are_counted_and_their_seconds_flagged(tmp_path, capsys, seed):
    rng = np.random.default_rng(seed)
    t_s, rows = samples()
    empty = rng.uniform(size=N) < 1 / 3
    rows = ["," + row.split(",", 1)[1] if e else row for row, e in zip(rows, empty)]
    log, result, said = taken(table(tmp_path / "log.csv", [f"{t:.3f}" for t in t_s], rows), capsys)
    assert result["sensors"][0]["rate_hz"] == RATE_HZ and result["empty_samples"] == empty.sum()
    assert f"{empty.sum()} of {N} rows have no rate" in said
    assert (log.flags["gx_dph"] & 2).all() and np.isfinite(log.rates["gx_dph"]).all()


def test_seconds_with_less_than_half_of_their_samples_have_no_rate(tmp_path, capsys):
    t_s, rows = samples()
    rows = [",,," + row.rsplit(",", 1)[1] if i % 100 >= 30 and 20 <= t_s[i] < 40 else row for i, row in enumerate(rows)]
    log, result, _ = taken(table(tmp_path / "log.csv", [f"{t:.3f}" for t in t_s], rows), capsys)
    np.testing.assert_array_equal(np.isnan(log.rates["gx_dph"]), (log.t_s > 20) & (log.t_s <= 40))


def test_gyro_in_every_other_row_of_a_table_is_a_gyro_at_half_the_rate(tmp_path, capsys):
    t_s, rows = samples()
    rows = [",,," + row.rsplit(",", 1)[1] if i % 2 else row for i, row in enumerate(rows)]
    log, result, said = taken(table(tmp_path / "log.csv", [f"{t:.3f}" for t in t_s], rows), capsys)
    assert result["sensors"][0]["rate_hz"] == RATE_HZ / 2 and "come at 50 Hz" in said and not log.flags


def test_a_log_without_any_rate_is_refused(tmp_path, capsys):
    t_s, rows = samples()
    rows = [row if i % 100 < 30 else ",,," + row.rsplit(",", 1)[1] for i, row in enumerate(rows)]
    _, _, said = taken(table(tmp_path / "log.csv", [f"{t:.3f}" for t in t_s], rows), capsys, expect=3)
    assert "no second has half of its" in said and "log.csv" in said


@pytest.mark.parametrize("rows_without_time", [[0], [0, 1, 5000], [N - 1], list(range(2000, 2040))])
def test_rows_without_a_time_are_left_out_and_said(tmp_path, capsys, rows_without_time):
    """An empty time was -1 s: in the first row it moved the whole log by a second."""
    t_s, rows = samples()
    stamps = [f"{t:.3f}" for t in t_s]
    there = np.delete(np.arange(N), rows_without_time)
    without, _, _ = taken(table(tmp_path / "without.csv", [stamps[i] for i in there], [rows[i] for i in there]), capsys)
    for i in rows_without_time:
        stamps[i] = ""
    log, result, said = taken(table(tmp_path / "empty.csv", stamps, rows), capsys)
    np.testing.assert_array_equal(log.t_s, without.t_s)
    np.testing.assert_array_equal(log.rates["gx_dph"], without.rates["gx_dph"])
    np.testing.assert_allclose(log.temp_degc, without.temp_degc, atol=1e-9)
    assert f"{len(rows_without_time)} row" in said and "no time" in said and "t_s_origin_s" not in log.metadata


def test_words_of_one_are_of_one(tmp_path, capsys):
    t_s, rows = samples()
    rows[77] = ",,," + rows[77].rsplit(",", 1)[1]
    _, _, said = taken(table(tmp_path / "log.csv", [f"{t:.3f}" for t in t_s], rows), capsys)
    assert f"1 of {N} rows has no rate" in said
    _, _, said = taken(table(tmp_path / "frozen.csv", ["5.0"] * N, rows), capsys, expect=3)
    assert "1 time stamp, too few to tell" in said


def test_clock_that_is_set_amid_a_table_is_refused_with_the_row(tmp_path, capsys):
    """No program reads a log that jumps by more than a week."""
    t_s, rows = samples()
    is_late = np.arange(N) > 5000
    _, _, said = taken(table(tmp_path / "set.csv", [f"{t:.3f}" for t in t_s + 1.7e9 * is_late], rows), capsys, expect=3)
    assert "set.csv:5003: the time jumps by 19675.9 days" in said and "cut the table" in said
    t_s[5001] = 2e9
    _, _, said = taken(table(tmp_path / "one.csv", [f"{t:.3f}" for t in t_s], rows), capsys, expect=3)
    assert "one.csv:5003: the time jumps by 23148.1 days" in said and "remove that row" in said


def test_clock_that_is_set_amid_a_flight_log_is_refused_with_its_second(tmp_path, capsys):
    rec = foreign.recording(duration_s=60)
    rec.t_us[3000:] += 10 ** 13
    foreign.write_ulog(tmp_path / "log.ulg", [rec])
    _, _, said = taken(tmp_path / "log.ulg", capsys, expect=3)
    assert "log.ulg: the times jump by 115.7" in said and "after 143 s" in said and "cut the record" in said


def test_table_of_more_than_a_year_is_refused(tmp_path, capsys):
    t_s, rows = samples()
    days = np.floor(t_s / 2) * 6.9 * 86400
    _, _, said = taken(table(tmp_path / "log.csv", [f"{a + b:.3f}" for a, b in zip(days, t_s % 2)], rows), capsys, expect=3)
    assert "log.csv: the record spans more than 366 days" in said
