# SPDX-License-Identifier: MIT
"""A log has one row a second.  Rows at another step are remarked by check; they, and times in another unit, are refused by import and look."""
import numpy as np
import pytest

from imucal.__main__ import main

N = 1200


def log(path, times):
    rng = np.random.default_rng(1)
    rate = 300 + 36 * rng.standard_normal(len(times))
    path.write_text("# imucal-log = 1\nt_s,temp_degc,gx_dph\n" + "".join(f"{t:.6g},{20 + 0.01 * i:.2f},{r:.2f}\n" for i, (t, r) in enumerate(zip(times, rate))))
    return str(path)


ONES = np.arange(1, N + 1.0)
GAPS = ONES[(ONES < 400) | (ONES > 900)]


@pytest.mark.parametrize("name, times, words", [
    ("every seventh", 7 * ONES, "7 s apart"), ("a kilohertz", 0.001 * ONES, "0.001 s apart"), ("half seconds", 0.5 * ONES, "0.5 s apart"),
    ("ten a second", 0.1 * ONES, "0.1 s apart"), ("milliseconds", 1000 * ONES, "milliseconds"), ("one in ten seconds", 10 * ONES, "10 s apart")])
def test_rows_that_are_not_a_second_apart_are_refused(tmp_path, name, times, words, capsys):
    path = log(tmp_path / "log.csv", times)
    for command in (["import", path, "-o", str(tmp_path / "o.csv")], ["look", path, "-o", str(tmp_path / "p.png"), "--no-ml"]):
        assert main(command) == 3, command
        said = capsys.readouterr().err
        assert "log.csv" in said and words in said and "one row a second" in said, said
    assert main(["check", path]) == 0  # the programs take it, and say so too
    said = capsys.readouterr().err
    assert "log.csv" in said and words in said and "not 1 s" in said, said
    assert not (tmp_path / "o.csv").exists() and not (tmp_path / "p.png").exists()


@pytest.mark.parametrize("times", [ONES, GAPS, ONES + 0.37, ONES[np.arange(N) % 4 != 0], ONES[:4]],
                         ids=["seconds", "a gap", "not on the second", "every fourth missing", "few"])
def test_seconds_with_gaps_are_a_log(tmp_path, times, capsys):
    path = log(tmp_path / "log.csv", times)
    assert main(["check", path]) == 0
    assert main(["import", path, "-o", str(tmp_path / "o.csv")]) == 0
    if len(times) > 100:
        assert main(["look", path, "-o", str(tmp_path / "p.png"), "--no-ml"]) == 0


def table(path, column, factor, step_s=0.01, n=6000):
    rng = np.random.default_rng(2)
    path.write_text(f"{column},gx_dps,gy_dps,gz_dps,temp\n" + "".join(
        f"{i * step_s * factor:.9g},{a:.5f},{b:.5f},{c:.5f},{20 + i / 1000:.3f}\n" for i, (a, b, c) in enumerate(0.01 * rng.standard_normal((n, 3)))))
    return str(path)


@pytest.mark.parametrize("column, factor, step_s, words, remedy", [
    ("time_s", 1e6, 0.01, "10000 s apart", "time_s:us"), ("time_s", 1e3, 0.01, "10 s apart", "time_s:ms"), ("time_s", 1e9, 0.01, "1e+07 s apart", "time_s:ns"),
    ("time_ms", 1, 0.01, "1e+05 a second", "time_ms:s"), ("time_s", 1, 5, "5 s apart", "once a second")])
def test_table_whose_time_unit_is_wrong_is_refused_with_the_unit(tmp_path, column, factor, step_s, words, remedy, capsys):
    path = table(tmp_path / "board.csv", column, factor, step_s)
    for command in (["import", path, "-o", str(tmp_path / "o.csv")], ["look", path, "-o", str(tmp_path / "p.png"), "--no-ml"]):
        assert main(command) == 3
        said = capsys.readouterr().err
        assert "board.csv" in said and words in said and remedy in said, said
    if ":" in remedy:
        assert main(["import", path, "-o", str(tmp_path / "o.csv"), "--time", remedy]) == 0
        assert "60 s at rest" in capsys.readouterr().out
