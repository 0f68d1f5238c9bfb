# SPDX-License-Identifier: MIT
"""Tables of plain numbers by the compiled part: what polars reads of them, value for value; anything else is left to polars."""
import numpy as np
import pytest

import imucal
from imucal.errors import DataError
from imucal.importers import columns

pytest.importorskip("imucal._core")


def both(path, text):
    """What either way reads of a table whose header is the first line."""
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    at, delimiter, _ = columns._header_line(path)
    return columns._plain_table(path, at, delimiter), columns._any_table(path, at, delimiter)


def check_equal(plain, other):
    assert plain is not None
    assert list(plain[0]) == list(other[0]) and plain[1] == other[1]
    for name, values in plain[0].items():
        assert values.dtype == other[0][name].dtype, name
        np.testing.assert_array_equal(values, other[0][name], err_msg=name)


def random_table(seed):
    """Numbers as programs print them: whole, short, of 17 digits, with exponents, some missing."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 3000))
    makers = [lambda x: repr(float(x)), lambda x: f"{x:.3f}", lambda x: f"{x:.17g}", lambda x: f"{x:e}", lambda x: f"{1e-9 * x:.20f}",
              lambda x: str(int(1e15 * x)), lambda x: str(int(x))]
    fields = [[makers[c](x) for x in rng.normal(0, 10.0 ** rng.integers(-3, 4), n)] for c in rng.integers(0, len(makers), 5)]
    for k in rng.integers(0, n, n // 20):
        fields[2][k] = rng.choice(["", "NaN", "nan", "null", "NA"])
    delimiter, end = rng.choice([",", ";", "\t"]), rng.choice(["\n", "\r\n"])
    rows = [delimiter.join(row) for row in zip(*fields)]
    return end.join([delimiter.join(["time", "x [dps]", "y", "z", "temp"]), *rows, "" if seed % 4 else rows[0][:-1]])


@pytest.mark.parametrize("seed", range(25))
def test_any_table_of_plain_numbers_equals_polars(tmp_path, seed):
    text = random_table(seed)
    plain, other = both(tmp_path / "t.csv", text)
    check_equal(plain, other)


def test_a_long_table_is_cut_into_pieces_and_kept_in_order(tmp_path):
    n = 200_000
    text = "t,x,y\n" + "".join(f"{k},{k / 7!r},{-k}\n" for k in range(n))
    plain, other = both(tmp_path / "t.csv", text)
    check_equal(plain, other)
    assert len(text) > 3 << 20 and plain[0]["y"].tolist() == [-k for k in range(n)]


def test_whole_numbers_become_doubles_where_one_field_far_down_has_a_point(tmp_path):
    text = "t,x\n" + "1,2\n" * 5000 + "1,2.5\n" + "1,2\n" * 100_000
    (tmp_path / "t.csv").write_text(text)
    found, note = columns._plain_table(tmp_path / "t.csv", 0, ",")
    (tmp_path / "u.csv").write_text("t,x\n1,9223372036854775807\n2,9223372036854775808\n")
    assert columns._plain_table(tmp_path / "u.csv", 0, ",")[0]["x"].tolist() == [2.0 ** 63] * 2
    assert note is None and found["t"].dtype == np.int64 and found["x"].dtype == np.float64 and found["x"].sum() == 2 * 105_000 + 2.5


@pytest.mark.parametrize("row", ['"1",2', "a,2", "1,2,3", "1", "", "# 1,2", " 1,2", "1 ,2", "+1,2", "inf,2", "-nan,2", "1.5e,2", "0x10,2", "1e999,2",
                                 "1,2\r3", "1,-", "1,.", "1,2\0"])
def test_all_else_is_left_to_polars(tmp_path, row):
    for place in (0, 500, 999):
        rows = ["3,4"] * 1000
        rows[place] = row
        (tmp_path / "t.csv").write_text("t,x\n" + "\n".join(rows) + "\n", newline="")
        assert columns._plain_table(tmp_path / "t.csv", 0, ",") is None


@pytest.mark.parametrize("header", ['"t",x', "t,t", "t,", "t,x,y"])
def test_odd_headers_are_left_to_polars(tmp_path, header):
    (tmp_path / "t.csv").write_text(header + "\n1,2\n3,4\n")
    assert columns._plain_table(tmp_path / "t.csv", 0, ",") is None


def test_a_column_that_is_missing_throughout_is_left_to_polars(tmp_path):
    (tmp_path / "t.csv").write_text("t,x\n1,\n2,\n")
    assert columns._plain_table(tmp_path / "t.csv", 0, ",") is None


def test_text_before_the_header_and_a_byte_order_mark_are_passed_over(tmp_path):
    plain, other = both(tmp_path / "a.csv", "made by a board\nversion 3\nt,x\n1,2.5\n2,3.5\n3,4")
    check_equal(plain, other)
    assert plain[1].startswith("line 6:") and len(plain[0]["t"]) == 2
    plain, other = both(tmp_path / "b.csv", b"\xef\xbb\xbft,x\n1,2.5\n2,3.5\n")
    check_equal(plain, other)


def test_a_wrong_field_far_down_names_its_line(tmp_path):
    rows = [f"{k / 100},{k},{k},{k},20" for k in range(60_000)]
    rows[54_321] = rows[54_321].replace(",20", ",2o")
    (tmp_path / "t.csv").write_text("time_s,gyro_x,gyro_y,gyro_z,temp\n" + "\n".join(rows) + "\n")
    with pytest.raises(DataError, match=r"t\.csv:54323: .*temp.*2o"):
        imucal.import_log(tmp_path / "t.csv", unit="dps")
