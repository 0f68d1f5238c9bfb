# SPDX-License-Identifier: MIT
"""Text tables as Excel and loggers write them: read, or refused with the cause and what to do."""
import numpy as np
import pytest

import imucal
from imucal.__main__ import main

NAMES = ["time_s", "gx_dps", "gy_dps", "gz_dps", "temp"]
OWN = ["t_s", "temp_degc", "gx_dph"]


def rows(n=3000, step_s=0.01):
    rng = np.random.default_rng(4)
    gyro = 0.01 * rng.standard_normal((n, 3))
    return [[f"{i * step_s:.3f}", *(f"{v:.6f}" for v in gyro[i]), f"{20 + i / 1000:.3f}"] for i in range(n)]


def text(names, lines, separator=",", point=".", head=""):
    body = "".join(separator.join(value.replace(".", point) for value in line) + "\n" for line in lines)
    return head + (separator.join(names) + "\n" if names else "") + body


def refused(path, capsys, *commands):
    words = []
    for command in commands or (["import", "-o"], ["look", "--no-ml", "-o"]):
        out = path.with_name("out.png")
        assert main([command[0], str(path), *command[1:], *([str(out)] if command[-1] == "-o" else [])]) == 3, command
        words.append(capsys.readouterr().err)
        assert path.name in words[-1] and "Traceback" not in words[-1] and not out.exists()
    return words


@pytest.mark.parametrize("coding", ["utf-16", "utf-16-be"])
@pytest.mark.parametrize("names", [NAMES, OWN], ids=["table", "our log"])
def test_utf16_is_named_with_the_remedy(tmp_path, capsys, coding, names):
    path = tmp_path / "log.csv"
    path.write_bytes((b"\xfe\xff" if coding == "utf-16-be" else b"") + text(names, rows(300)).encode(coding))
    for words in refused(path, capsys, ["import", "-o"], ["look", "-o"], ["check"]):
        assert "the file is UTF-16; save it as UTF-8" in words


def test_json_in_utf16_is_named_with_the_remedy(tmp_path, capsys):
    path = tmp_path / "model.json"
    path.write_bytes('{"imucal_model": 1, "arw_deg_rt_h": 0.6}'.encode("utf-16"))
    for words in refused(path, capsys, ["check"], ["export", "--to", "ros", "-o"]):
        assert "the file is UTF-16; save it as UTF-8" in words


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("head", ["", "Messung vom 28.11.2026\n\n"], ids=["plain", "with a preface"])
def test_decimal_commas_between_other_separators_are_read_and_said(tmp_path, separator, head):
    (tmp_path / "point.csv").write_text(text(NAMES, rows()))
    (tmp_path / "comma.csv").write_text(text(NAMES, rows(), separator, ",", head))
    point, comma = (imucal.import_log(tmp_path / name) for name in ("point.csv", "comma.csv"))
    for axis, rates in point.log.rates.items():
        np.testing.assert_allclose(comma.log.rates[axis], rates, atol=1e-9)
    np.testing.assert_allclose(comma.log.temp_degc, point.log.temp_degc, atol=1e-9)
    assert [n for n in comma.notes if "decimal comma" in n] and not [n for n in point.notes if "decimal comma" in n]


def test_commas_that_are_decimal_and_group_digits_are_refused(tmp_path, capsys):
    lines = [[f"{i / 100:.2f}".replace(".", ","), "1.000,5", "2,5", "3,5", "20,5"] for i in range(300)]
    (tmp_path / "both.csv").write_text(text(NAMES, lines, ";"))
    for words in refused(tmp_path / "both.csv", capsys):
        assert "1.000,5" in words and "group" in words


@pytest.mark.parametrize("first", [0, 1])
def test_points_and_commas_in_one_table_are_refused(tmp_path, capsys, first):
    """1,234 may be a thousand: who writes 0.5 elsewhere means it so."""
    values = ["0.5", "1,234"]
    lines = [[f"{i}", values[first], values[1 - first], "3", "20"] for i in range(300)]
    (tmp_path / "both.csv").write_text("\n".join(";".join(line) for line in [NAMES, *lines]) + "\n")
    for words in refused(tmp_path / "both.csv", capsys):
        assert "both for the decimals" in words


def test_decimal_commas_between_commas_are_named(tmp_path, capsys):
    (tmp_path / "table.csv").write_text(text(NAMES, rows(300), point=","))
    (tmp_path / "own.csv").write_text("t_s,temp_degc,gx_dph\n" + "".join(f"{i},20,5,1{i % 7},5\n" for i in range(1, 300)))
    for name in ("table.csv", "own.csv"):
        for words in refused(tmp_path / name, capsys):
            assert "decimal comma" in words and "separator" in words


@pytest.mark.parametrize("names", [NAMES, OWN, ["sample", "voltage"]], ids=["table", "our log", "another"])
def test_a_header_without_rows_is_named(tmp_path, capsys, names):
    (tmp_path / "empty.csv").write_text(text(names, []))
    for words in refused(tmp_path / "empty.csv", capsys):
        assert "a header and no" in words


@pytest.mark.parametrize("head", ["", "# device = X\n"], ids=["plain", "with comments"])
@pytest.mark.parametrize("separator, point", [(",", "."), (";", ".")])
def test_rows_without_names_are_named(tmp_path, capsys, head, separator, point):
    (tmp_path / "bare.csv").write_text(text(None, rows(300), separator, point, head))
    for words in refused(tmp_path / "bare.csv", capsys):
        assert "no line of names above" in words and "time_s" in words and "gx_dps" in words


def test_one_row_that_is_too_long_is_no_matter_of_decimal_commas(tmp_path, capsys):
    body = "".join(f"{i},20,1{i % 7}\n" for i in range(1, 300))
    (tmp_path / "long.csv").write_text("t_s,temp_degc,gx_dph\n" + body.replace("200,20,", "200,20,5,"))
    for words in refused(tmp_path / "long.csv", capsys):
        assert "long.csv:201: expected 3 fields, found 4" in words and "decimal comma" not in words


def put(path, row, column, value, n=3000):
    lines = rows(n)
    lines[row][column] = value
    path.write_text(text(NAMES, lines))
    return path


@pytest.mark.parametrize("row", [3, 700, 2500])  # the kinds of the columns are told from the first 2000 rows
def test_time_that_is_no_number_is_named_with_its_row(tmp_path, capsys, row):
    said = refused(put(tmp_path / "log.csv", row, 0, "0x10"), capsys)
    assert all(f'log.csv:{row + 2}: column time_s: expected a number, found "0x10"' in words for words in said)


@pytest.mark.parametrize("n", [1500, 2500])
def test_header_that_stands_again_is_named_with_its_line(tmp_path, capsys, n):
    (tmp_path / "log.csv").write_text(text(NAMES, [*rows(n), NAMES, *rows(n)]))
    for words in refused(tmp_path / "log.csv", capsys):
        assert f"log.csv:{n + 2}: the names of the columns stand here again; remove that line" in words


def test_date_that_is_none_is_named_with_its_row(tmp_path, capsys):
    dates = [[f"2026-11-28T10:00:{i // 100:02d}.{i % 100:02d}Z", *row[1:]] for i, row in enumerate(rows())]
    for i, value in ((5, "yesterday"), (2500, "2026-13-28T10:00:25.00Z")):
        lines = [*dates[:i], [value, *dates[i][1:]], *dates[i + 1:]]
        (tmp_path / "log.csv").write_text(text(["time", *NAMES[1:]], lines))
        assert all(f'log.csv:{i + 2}: column time: expected a date as 2026-11-28T10:00:00.25, found "{value}"' in words
                   for words in refused(tmp_path / "log.csv", capsys))


@pytest.mark.parametrize("value", ["", "nan", "NA"])
def test_column_without_any_number_is_said_to_be_empty(tmp_path, capsys, value):
    lines = rows()
    for row in lines:
        row[2] = value
    (tmp_path / "log.csv").write_text(text(NAMES, lines))
    for words in refused(tmp_path / "log.csv", capsys):
        assert "log.csv: column gy_dps holds no number in any row" in words and "--gyro" in words
    for row in lines:
        row[2], row[4] = row[1], value
    (tmp_path / "log.csv").write_text(text(NAMES, lines))
    assert "its temperature is not a number (NaN) throughout" in refused(tmp_path / "log.csv", capsys, ["import", "-o"])[0]
    imucal.import_log(tmp_path / "log.csv", temperature=False)


def test_field_that_is_empty_where_the_column_has_words_is_not_what_is_wrong(tmp_path, capsys):
    lines = rows()
    lines[10][2], lines[20][2] = "", "off"
    (tmp_path / "log.csv").write_text(text(NAMES, lines))
    for words in refused(tmp_path / "log.csv", capsys):
        assert 'log.csv:22: column gy_dps: expected a number, found "off"' in words


def test_rows_longer_than_the_names_are_no_matter_of_decimal_commas_where_there_are_points(tmp_path, capsys):
    (tmp_path / "log.csv").write_text(text(NAMES, [[*row, "1"] for row in rows()]))
    for words in refused(tmp_path / "log.csv", capsys):
        assert "log.csv:2: 5 names over 6 fields: name the columns that have none" in words and "comma" not in words
    (tmp_path / "log.csv").write_text(text(NAMES, [[f"{i}", "12", "-3", "5", "20", "1"] for i in range(3000)]))
    for words in refused(tmp_path / "log.csv", capsys):
        assert "log.csv:2: 5 names over 6 fields: name the columns that have none, or" in words and "decimal comma" in words
    (tmp_path / "log.csv").write_text(text(OWN, [["1", "20.5", "3.5", "7"], ["2", "20.5", "3.5", "7"]]))
    for words in refused(tmp_path / "log.csv", capsys):
        assert "log.csv:2: expected 3 fields, found 4" in words and "comma" not in words
    (tmp_path / "log.csv").write_text(text(OWN, [["1", "20", "5", "3"], ["2", "20", "5", "3"]]))
    assert all("expected 3 fields, found 4: a decimal comma" in words for words in refused(tmp_path / "log.csv", capsys))


@pytest.mark.parametrize("names", [NAMES, OWN])
def test_line_ends_of_old_macs_are_named(tmp_path, capsys, names):
    lines = rows() if names is NAMES else [[f"{i + 1}", "20", "5"] for i in range(100)]
    for head in ("", "# imucal-log = 1\n"):
        (tmp_path / "log.csv").write_bytes((head + text(names, lines).replace("\n", "\r")).encode())
        for words in refused(tmp_path / "log.csv", capsys, ["import", "-o"], ["look", "--no-ml", "-o"], ["check"]):
            assert "the lines end in CR alone, as on old Macs" in words and "line ends of Unix or Windows" in words, words


@pytest.mark.parametrize("coding", ["utf-16-le", "utf-16-be", "utf-32", "utf-32-le", "utf-32-be"])
@pytest.mark.parametrize("names", [NAMES, OWN])
def test_coding_without_a_mark_is_named_too(tmp_path, capsys, coding, names):
    (tmp_path / "log.csv").write_bytes(text(names, [row[:len(names)] for row in rows()]).encode(coding))
    for words in refused(tmp_path / "log.csv", capsys, ["import", "-o"], ["look", "--no-ml", "-o"], ["check"]):
        assert f"log.csv: the file is {coding[:6].upper()}; save it as UTF-8" in words
