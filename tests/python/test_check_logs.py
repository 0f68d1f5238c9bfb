# SPDX-License-Identifier: MIT
"""`imucal check` on logs as hostile users have them: it and the programs say the same of a file, and of the same line."""
import re

import numpy as np
import pytest

from imucal import read_log
from imucal.__main__ import main
from programs_say import check_all_name_the_field, dp_says

N = 400
HEAD = "t_s,temp_degc,gx_dph,gy_dph"


def healthy():
    rng = np.random.default_rng(1)
    rate = np.round(400 + 36 * rng.standard_normal((N, 2)), 2)
    return [[str(i + 1), f"{25 + 0.01 * i:.2f}", repr(float(rate[i, 0])), repr(float(rate[i, 1]))] for i in range(N)]


def text(rows, head=HEAD, meta="# imucal-log = 1\n", end="\n"):
    return meta + head + end + end.join(",".join(row) for row in rows) + end


def put(column, value, row=100):
    rows = healthy()
    rows[row][column] = value
    return text(rows)


def times(of):
    return text([[repr(of(i)), *row[1:]] for i, row in enumerate(healthy())])


# name: (text, line that is at fault or None where the log is valid)
LINE = 103  # of row 100: metadata, header and 100 rows stand before it
LOGS = {
    "healthy": (text(healthy()), None),
    "byte order mark": ("\ufeff" + text(healthy()), None),
    "ends of Windows": (text(healthy(), end="\r\n"), None),
    "blank lines": (text(healthy(), end="\n\n"), None),
    "empty fields": (put(2, ""), None),
    "spaces around": (put(2, " 12.5 "), None),
    "plus sign": (put(2, "+12.5"), None),
    "an hour missing": (times(lambda i: i + 1.0 + (3600 if i > 200 else 0)), None),
    "time of 1970": (times(lambda i: 1.7e9 + i), None),
    "ends of old Macs": (text(healthy(), end="\r"), 2),
    "nan": (put(2, "nan"), LINE),
    "inf": (put(2, "inf"), LINE),
    "-Infinity": (put(3, "-Infinity"), LINE),
    "overflow": (put(2, "1e999"), LINE),
    "huge": (put(2, "1e300"), LINE),
    "hex": (put(2, "0x1F"), LINE),
    "underscore": (put(2, "1_000"), LINE),
    "thousands": (put(2, "1 000"), LINE),
    "decimal comma": (put(2, "12,5"), LINE),
    "word": (put(2, "n/a"), LINE),
    "quotes": (put(2, '"12.5"'), LINE),
    "absolute zero": (put(1, "-300"), LINE),
    "furnace": (put(1, "25000"), LINE),
    "no time": (put(0, ""), LINE),
    "twice": (put(0, "100"), LINE),
    "back": (put(0, "50"), LINE),
    "clock set": (times(lambda i: i + 1.0 + (1e6 if i >= 100 else 0)), LINE),
    "microseconds": (times(lambda i: 1e6 * (i + 1.0)), 4),
    "two years": (times(lambda i: 2e5 * (i + 1.0)), 3 + 159),  # 366 days are 158.1 steps
    "no rhythm": (times(lambda i: float(np.cumsum(np.random.default_rng(2).uniform(0.3, 3, N))[i])), 4),
    "field too many": (put(3, "1,2"), LINE),
    "field too few": (text([row[:3] if i == 100 else row for i, row in enumerate(healthy())]), LINE),
    "second header": (text(healthy()[:100] + [HEAD.split(",")] + healthy()[100:]), LINE),
    "column twice": (text(healthy(), head="t_s,temp_degc,gx_dph,gx_dph"), 2),
    "column without name": (text(healthy(), head="t_s,temp_degc,gx_dph,"), 2),
    "version 2": (text(healthy(), meta="# imucal-log = 2\n"), 2),
    "flags of words": (text([[*row[:3], "ok"] for row in healthy()], head="t_s,temp_degc,gx_dph,gx_flags"), 3),
    "flags below zero": (text([[*row[:3], "-1"] for row in healthy()], head="t_s,temp_degc,gx_dph,gx_flags"), 3),
    "flags in part": (text([[*row[:3], "0.5"] for row in healthy()], head="t_s,temp_degc,gx_dph,gx_flags"), 3),
    "flags of no axis": (text([[*row[:3], "0"] for row in healthy()], head="t_s,temp_degc,gx_dph,g_flags"), 2),
    "flags of two axes": (text([[*row, "0"] for row in healthy()], head="t_s,temp_degc,x_dph,x_mg,x_flags"), 2),
    "flags between axes that begin alike": (text([[*row, "2"] for row in healthy()], head="t_s,temp_degc,gx_raw_dph,gx_dph,gx_flags"), None),
    "a bit of our own": (text([[*row[:3], "128"] for row in healthy()], head="t_s,temp_degc,gx_dph,gx_flags"), None),
}


def test_a_log_without_any_rate_is_refused_as_dp_does(tmp_path, capsys):
    path = tmp_path / "log.csv"
    path.write_text(text([[*row[:2], "", ""] for row in healthy()]))
    assert dp_says(path)[0] == 3
    assert main(["check", str(path)]) == 3
    assert "log.csv: no axis has a rate in any second" in capsys.readouterr().err


@pytest.mark.parametrize("row", [3, 399])
def test_byte_of_another_coding_in_a_row_is_named_as_by_the_programs(tmp_path, row, capsys):
    path = tmp_path / "log.csv"
    path.write_bytes(put(2, "\0", row).encode().replace(b"\0", b"12\xff5"))
    check_all_name_the_field(path, row + 3, "gx_dph", r"12\xff5", capsys)


def test_remark_in_another_coding_is_no_fault_of_a_log(tmp_path, capsys):
    for n in (5, N):
        (tmp_path / "log.csv").write_bytes(text(healthy()[:n], meta="# imucal-log = 1\n# who = M\u00fcller\n").encode("latin-1"))
        assert dp_says(tmp_path / "log.csv")[0] == 0
        assert main(["check", str(tmp_path / "log.csv")]) == 0
        assert main(["import", str(tmp_path / "log.csv"), "-o", str(tmp_path / "out.csv")]) == 0


@pytest.mark.parametrize("name", LOGS)
def test_check_and_the_programs_agree_on_a_log(tmp_path, name, capfd):
    content, line = LOGS[name]
    path = tmp_path / "log.csv"
    path.write_bytes(content.encode())
    status, words = dp_says(path)
    assert status in (0, 3), words
    assert main(["check", str(path)]) == status
    said = capfd.readouterr()
    if status == 0:
        assert line is None and "a valid log" in said.out and said.err == ""
        return
    assert "log.csv" in said.err and "Traceback" not in said.err
    of_check, of_dp = (re.search(r"log\.csv:(\d+)", w) for w in (said.err, words))
    assert of_check and int(of_check[1]) == line, said.err
    assert int(of_dp[1]) == line if of_dp else "at t_s = " in words and "average the log to even seconds" in words, words


def test_flags_are_of_the_axis_of_their_whole_name(tmp_path):
    (tmp_path / "log.csv").write_text(LOGS["flags between axes that begin alike"][0])
    log = read_log(str(tmp_path / "log.csv"))
    assert list(log.flags) == ["gx_dph"] and set(log.flags["gx_dph"]) == {2}
