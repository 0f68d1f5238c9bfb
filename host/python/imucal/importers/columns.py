# SPDX-License-Identifier: MIT
"""CSV and Parquet of evaluation boards, blackboxes and scripts: plain numbers by the compiled part, all else by polars."""
import csv
import io
import mmap
import re
from dataclasses import dataclass

import numpy as np

from ..errors import DataError
from ..log import CUT_ROW
from ..native import core_or_none
from . import cause, need
from .named import Columns, numbers, stream_of, unexpected

_core = core_or_none()


def _to_numpy(frame):
    """Arrays by name; integers of 128 bits, which numpy has not, as floats."""
    columns = {name: frame[name] for name in frame.columns}
    return {name: (values.cast(float) if values.dtype.is_integer() and str(values.dtype).endswith("128") else values).to_numpy()
            for name, values in columns.items()}


_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+([eE][+-]?\d+)?\s*")
_DECIMAL_POINT = re.compile(r"\s*[+-]?\d*\.\d+([eE][+-]?\d+)?\s*")
_GROUPED = re.compile(r"\s*[+-]?\d{1,3}([.' ]\d{3})+,\d+\s*")


@dataclass
class _Layout:
    """A table's header line, its separator, whether its numbers have decimal commas, and the lines before it."""

    at: int
    delimiter: str
    has_decimal_commas: bool
    preface: list


def _fields(line, delimiter):
    """The fields of a line; none of one that is no line of a table."""
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:  # a field longer than any table has
        return []


def _is_value(text, delimiter):
    return _is_number(text) or not text.strip() or delimiter != "," and bool(_DECIMAL_COMMA.fullmatch(text) or _GROUPED.fullmatch(text))


def _delimiter(line):
    return max(",;\t", key=line.count)


def _is_header(names):
    return len(names) >= 2 and sum(not _is_number(n) for n in names) > len(names) / 2


def _layout(path):
    """The _Layout.  The header is the first line whose fields are mostly words, over a line of as many fields, mostly numbers."""
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        lines = [line for _, line in zip(range(400), file)]
    for i, line in enumerate(lines[:-1]):
        delimiter = _delimiter(line)
        if line.startswith("#") or line.count(delimiter) == 0:
            continue
        names, values = (_fields(text, delimiter) for text in (line, lines[i + 1]))
        if _is_header(names) and len(values) == len(names) and sum(_is_value(v, delimiter) for v in values) >= len(names) / 2:
            return _Layout(i, delimiter, delimiter != "," and _decimal_commas(path, i + 2, delimiter, lines[i + 1:]), lines[:i])
    raise DataError(_no_table(path, lines))


def _decimal_commas(path, number, delimiter, lines):
    """Do these rows, the first of which is line `number` of the file, have decimal commas?  DataError: some, and points beside them."""
    has_commas = has_points = False
    for line in lines:
        for value in _fields(line, delimiter):
            has_commas = has_commas or bool(_DECIMAL_COMMA.fullmatch(value))
            has_points = has_points or bool(_DECIMAL_POINT.fullmatch(value))
            if _GROUPED.fullmatch(value) or has_commas and has_points:
                raise DataError(f"{path}:{number}: \"{value.strip()}\": points or commas that group digits, or both for the decimals; export the table without "
                                "grouping, and with one of them for all decimals")
        number += 1
    return has_commas


def _no_table(path, lines):
    """Why there is no table in a text."""
    told = [(number, line.strip()) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    first = told[0][1] if told else next((line.strip() for line in lines if line.strip()), "")
    delimiter = _delimiter(first)
    names = _fields(first, delimiter)
    if len(names) >= 2 and all(_is_value(v, delimiter) for v in names):
        return f"{path}:{told[0][0]}: numbers, and no line of names above them; write one there, such as time_s,gx_dps,gy_dps,gz_dps,temp"
    if told and len(told) == 1 and _is_header(names):
        return f"{path}:{told[0][0]}: a header and no rows"
    if len(told) > 1 and _is_header(names):
        values = _fields(told[1][1], delimiter)
        if len(values) != len(names) and all(_is_value(v, delimiter) for v in values):
            return f"{path}:{told[1][0]}: {_names_over_fields(names, values, delimiter)}"
    return f"{path}: text, but no table: no line of column names over lines of numbers (first line: \"{first[:60]}\")"


def _names_over_fields(names, values, delimiter):
    """What is wrong with a header that is longer or shorter than the row below it."""
    counts = f"{len(names)} names over {len(values)} fields"
    comma = "a decimal comma makes two fields of one number; export with decimal points, or with semicolons as the separator"
    may_be_commas = delimiter == "," and len(values) > len(names) and not any("." in v for v in values)
    if may_be_commas and len(values) == 2 * len(names):
        return f"{counts}: {comma}"
    remedy = "name the columns that have none" if len(values) > len(names) else "take out the names that have no column"
    return f"{counts}: {remedy}{f', or, if they are parts of numbers: {comma}' if may_be_commas else ''}"


def _is_number(text):
    try:
        float(text)
        return True
    except ValueError:
        return False


def _plain_table(path, at, delimiter):
    """(columns, note on a row that was cut off) of a table of plain numbers, by the compiled part.  None for any other table, or
    where that part is missing: polars reads it then, and all of CSV; loading it takes as long as reading an hour at 100 Hz."""
    if _core is None:
        return None
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        begin = 3 if at == 0 and text[:3] == b"\xef\xbb\xbf" else 0
        for _ in range(at):
            begin = text.find(b"\n", begin) + 1
        rows, end = text.find(b"\n", begin) + 1, text.rfind(b"\n") + 1
        header = text[begin:rows].decode("utf-8", "replace")
        names = [name.strip() for name in header.split(delimiter)]
        if '"' in header or not all(names) or len(set(names)) < len(names) or rows == 0 or rows == end:
            return None
        columns = _core.read_numbers(np.frombuffer(text, np.uint8), rows, end, delimiter, len(names))
        is_cut = bool(text[end:].strip())
    if columns is None:
        return None
    arrays = {name: bits.view(np.int64 if is_whole else np.float64) for name, (bits, is_whole) in zip(names, columns)}
    return arrays, _cut_note(at + 2 + len(columns[0][0])) if is_cut else None


def _read_csv(path):
    """(columns, lines before the table, notes)."""
    layout = _layout(path)
    plain = None if layout.has_decimal_commas else _plain_table(path, layout.at, layout.delimiter)
    arrays, note = plain or _any_table(path, layout)
    columns = Columns(arrays)
    columns.first_line = layout.at + 2
    commas = ["the commas in its numbers are taken as decimal commas"] if layout.has_decimal_commas else []
    return columns, layout.preface, commas + ([note] if note else [])


def _any_table(path, layout):
    """The same of whatever polars reads."""
    at, delimiter = layout.at, layout.delimiter
    polars = need("polars", "polars", path, "a CSV table")
    with open(path, "rb") as file:
        body = file.read().split(b"\n", at)[-1] if at else file.seek(0) or file.read()
    options = dict(separator=delimiter, has_header=True, infer_schema_length=2000, null_values=["", "NaN", "nan", "null", "NA"],
                   decimal_comma=layout.has_decimal_commas)
    if body.startswith(b"\xef\xbb\xbf"):
        body = body[3:]
    body, note = _whole_rows(body, at)
    try:
        frame = polars.read_csv(io.BytesIO(body), comment_prefix="#", **options)
    except Exception as error:
        raise DataError(_place(path, body.replace(b",", b".") if layout.has_decimal_commas else body, at, delimiter, error)) from None
    return {name.strip(): values for name, values in _to_numpy(frame).items()}, note


def _cut_note(line):
    return f"line {line}: {CUT_ROW}"


def _whole_rows(body, at):
    """(the table without a last row that has no line end, the note that says so).

    Such a row may be cut off inside its last number, which then is another one.  Some programs write no last line end, so it
    is no fault of the file; a sample less costs nothing, a wrong one does."""
    whole, _, rest = body.rpartition(b"\n")
    if not whole or not rest.strip():
        return body, None
    return whole + b"\n", _cut_note(at + 1 + body.count(10))


def _place(path, body, at, delimiter, error):
    """The line a table breaks at; polars' own words where it cannot be found."""
    rows = csv.reader(io.StringIO(body.decode("utf-8", "replace")), delimiter=delimiter)
    try:
        return _first_odd_row(path, rows, at) or f"{path}: a table that cannot be read: {cause(error)}"
    except csv.Error as odd:
        return f"{path}:{at + rows.line_num}: {odd}; is a quotation mark opened and never closed?"


def _first_odd_row(path, rows, at):
    names = next(rows)
    kinds = None
    for number, row in enumerate(rows, at + 2):
        if not row or row[0].startswith("#"):
            continue
        if len(row) != len(names):
            return f"{path}:{number}: expected {len(names)} fields, found {len(row)}"
        kinds = kinds or [_is_number(v) for v in row]
        for name, value, numeric in zip(names, row, kinds):
            if numeric and value.strip() and not _is_number(value):
                return f"{path}:{number}: {unexpected(name, value)}"
    return None


def _blackbox_scale(preface, columns):
    """Betaflight and INAV log the gyro in deg/s; with blackbox_high_resolution in tenths."""
    high = any(re.search(r'"?blackbox_high_resolution"?\s*,\s*"?1', line) for line in preface)
    return 0.1 if high else 1.0


def streams(path, options):
    """One stream of the table's columns."""
    with open(path, "rb") as file:
        is_parquet = file.read(4) == b"PAR1"
    if is_parquet:
        polars = need("polars", "polars", path, "a Parquet table")
        try:
            columns, preface, notes = _to_numpy(polars.read_parquet(path)), [], []
        except Exception as error:
            raise DataError(f"{path}: a Parquet table that cannot be read ({cause(error)}); it may be cut short") from None
    else:
        columns, preface, notes = _read_csv(path)
    is_blackbox = any(n.startswith("gyroADC") or n.startswith("gyroUnfilt") for n in columns)
    if not is_blackbox:
        stream = stream_of(path, columns, options, "parquet" if is_parquet else "csv")
        stream.notes += notes
        return [stream]
    first_line = getattr(columns, "first_line", None)
    columns = Columns({re.sub(r"^(gyro\w+)\[", r"\1[", n): v for n, v in columns.items()})
    columns.first_line = first_line
    if "IMUTemperature" in columns:  # INAV: tenths of a degree
        columns["IMUTemperature"] = numbers(path, columns, "IMUTemperature").astype(float) / 10
    if "time" in columns and not options.time:
        columns["time_us"] = columns.pop("time")
    stream = stream_of(path, columns, options, "blackbox", "dps", {"device": "Betaflight/INAV blackbox"})
    if options.unit is None:
        stream.to_internal = stream.to_internal * _blackbox_scale(preface, columns)
    stream.notes += notes
    stream.notes.append("blackbox rates are less the flight controller's own offset, measured at every start: the constant is not the sensor's")
    return [stream]
