# SPDX-License-Identifier: MIT
"""Tables of plain numbers by the compiled part: what polars reads of them, value for value; anything else is left to polars."""
import csv
import decimal
import math
import random
import struct

import numpy as np
import pytest

import imucal
from imucal.errors import DataError
from imucal.importers import columns

pytest.importorskip("imucal._core")


def both(path, text):
    """What either way reads of a table whose header is the first line."""
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    layout = columns._layout(path)
    return columns._plain_table(path, layout.at, layout.delimiter), columns._any_table(path, layout)


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


# ---- against Python's own csv, int() and float(): no polars, and no parser of numpy ----

AWKWARD = ["5e-324", "2.4703282292062328e-324", "-4.9406564584124654e-324", "2.2250738585072011e-308", "2.2250738585072012e-308",
           "2.2250738585072014e-308", "1e308", "-1e308", "1.7976931348623157e308", "1.7976931348623158e+308", "-0.0", "-0e7", "0e999999", "0.0e-400",
           "9007199254740993.0", "9007199254740992.99999999", "9007199254740993.00000000001", "1.00000000000000011102230246251565",
           "1.00000000000000011102230246251565404236316680908203125", "1.00000000000000011102230246251565404236316680908203126",
           "1.00000000000000011102230246251565404236316680908203124", "00012.5", "-007.25e+02", "1E5", "1e+05", "1e-05", "1.", ".5", "-.5", "3.E-3",
           "6.02214076e+23", "8.5e-0022", "179769313486231570000000000000000000", "0.000000000000000000000000000000000000123456789012345678",
           "7.038531e-26", "9214843084008499.0", "0.500000000000000166533453693773481063544750213623046875", "123456789012345678901234567890e-20"]
WHOLE = ["0", "-0", "7", "-7", "007", "-00012", "9007199254740993", "-9007199254740993", "9223372036854775807", "-9223372036854775808",
         "1000000000000000000", "0000000000000000001"]
MISSING = ["", "NaN", "nan", "null", "NA"]


def is_int64(field):
    digits = field.removeprefix("-")
    return digits.isdecimal() and len(digits.lstrip("0")) < 20 and -2 ** 63 <= int(field[:1].strip("0123456789") + (digits.lstrip("0") or "0")) < 2 ** 63


def by_python(path, delimiter):
    """{name: (is every field whole and of 64 bits, [value])}: whole columns by int(), all others by float()."""
    with open(path, newline="") as file:
        names, *rows = csv.reader(file, delimiter=delimiter)
    columns_of = {}
    for name, fields in zip(names, zip(*rows, strict=True)):
        is_whole = all(map(is_int64, fields))
        columns_of[name] = is_whole, [int(f) if is_whole else math.nan if f in MISSING else float(f) for f in fields]
    return columns_of


def check_bits(path, delimiter=","):
    """Every value of the compiled part has the bits that Python's own reading has; the number of values compared."""
    found, note = columns._plain_table(path, 0, delimiter)
    expected = by_python(path, delimiter)
    assert list(found) == list(expected) and note is None
    for name, (is_whole, values) in expected.items():
        assert found[name].dtype == (np.int64 if is_whole else np.float64), name
        code = "<q" if is_whole else "<d"
        read = found[name].astype(found[name].dtype.newbyteorder("<")).tobytes()
        assert read == b"".join(struct.pack(code, value) for value in values), name
    return sum(len(values) for _, values in expected.values())


def half_between_doubles(rng):
    """A number half-way between two neighbouring doubles, in all its digits; or a hair beside it."""
    x = struct.unpack("<d", struct.pack("<Q", rng.randrange(0x3C00 << 48, 0x4400 << 48)))[0]
    half = (decimal.Decimal(x) + decimal.Decimal(math.nextafter(x, math.inf))) / 2
    return f"{half:f}" + rng.choice(["", "0", "1"]) if x % 1 else f"{half:f}"


def awkward_number(rng):
    kind = rng.randrange(6)
    if kind == 0:
        return rng.choice(AWKWARD)
    if kind == 1:
        return half_between_doubles(rng)
    digits = "".join(rng.choices("0123456789", k=rng.randint(17, 25)))
    place = rng.randint(0, len(digits) - 1)
    exponent = rng.choice(["", f"e{rng.randint(-280, 270)}", f"E{rng.randint(-280, 270):+04d}"]) if kind > 2 else ""
    return rng.choice(["", "-"]) + digits[:place] + "." + digits[place:] + exponent


@pytest.fixture(autouse=True)
def exact_decimals():
    with decimal.localcontext(prec=1200):
        yield


@pytest.mark.parametrize("field", AWKWARD + WHOLE)
def test_each_awkward_number_has_the_bits_of_python(tmp_path, field):
    path = tmp_path / "t.csv"
    path.write_text(f"t,x\n1,{field}\n2,{field}\n")
    assert check_bits(path) == 4


@pytest.mark.parametrize("seed", range(6))
def test_tables_of_awkward_numbers_have_the_bits_of_python(tmp_path, seed):
    rng = random.Random(seed)
    delimiter, end = rng.choice(",;\t"), rng.choice(["\n", "\r\n"])
    rows = [[str(k), awkward_number(rng), awkward_number(rng), rng.choice(WHOLE), rng.choice([*MISSING, *WHOLE]) if k % 50 == 7 else rng.choice(WHOLE)]
            for k in range(1500)]
    path = tmp_path / "t.csv"
    path.write_text(end.join(delimiter.join(row) for row in [["t", "x", "y", "n", "part"], *rows]) + end, newline="")
    assert check_bits(path, delimiter) == 5 * 1500


@pytest.mark.parametrize("shift", range(9))
def test_rows_over_the_boundaries_of_pieces_have_the_bits_of_python(tmp_path, shift):
    """A row stands over each boundary of 1 MiB, from another place of it each time."""
    rng = random.Random(100 + shift)
    long_rows = [f"{k},{awkward_number(rng)},{awkward_number(rng)}\n" for k in range(4000)]
    text, k = ["t,x,y\n", "1." + "0" * shift + ",1,2\n"], 0
    size = sum(map(len, text))
    while size < (2 << 20) + 5000:
        text.append(long_rows[k % 4000])
        size, k = size + len(text[-1]), k + 1
    path = tmp_path / "t.csv"
    path.write_text("".join(text))
    assert check_bits(path) == 3 * (k + 1)


@pytest.mark.parametrize("n_zeros", [0, 1200, 2500])
def test_rows_as_long_as_a_piece_have_the_bits_of_python(tmp_path, n_zeros):
    """Rows of up to 1.2 and 2.5 MB, of numbers with very many leading zeros: each begins in a piece and ends in a later one."""
    rng = random.Random(n_zeros)
    numbers = ["0" * n_zeros + awkward_number(rng).lstrip("-") for _ in range(2000)]
    rows = [",".join(numbers[1000 * r:1000 * (r + 1)]) for r in range(2)]
    path = tmp_path / "t.csv"
    path.write_text("\n".join([",".join(f"c{k}" for k in range(1000)), *rows]) + "\n")
    assert check_bits(path) == 2000 and (n_zeros == 0 or len(rows[0]) > 1 << 20)


@pytest.mark.parametrize("field", ["1e-400", "-1e-400", "2.4703282292062327e-324", "1e400", "1" * 400, "1_000", "\u0663"])
def test_what_no_double_holds_is_never_read_as_another_number(tmp_path, field):
    """Left to polars, or the bits of Python."""
    path = tmp_path / "t.csv"
    path.write_text(f"t,x\n1,{field}\n2,2.5\n")
    if columns._plain_table(path, 0, ",") is not None:
        check_bits(path)
        assert math.isfinite(float(field))
