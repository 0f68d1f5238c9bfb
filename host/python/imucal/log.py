# SPDX-License-Identifier: MIT
"""Logs in imucal's own format (CSV, one row per second): reading and writing."""
import math
import os
import re
import warnings
from dataclasses import dataclass, field

import numpy as np

from .errors import DataError, DataWarning
from .inputs import CR_ENDS, ends_in_cr, other_coding, plain_file
from .units import DPH_PER_DPS, DPH_PER_RADPS, MG_PER_MS2

_UNITS = {"dph": 1.0, "dps": DPH_PER_DPS, "radps": DPH_PER_RADPS, "mg": 1.0, "ms2": MG_PER_MS2}
# What no log holds (host/lib/io/log.cpp has the same limits: what the programs refuse is no valid log).
TEMP_DEGC = (-273.15, 2000.0)
_LARGEST = 1e12
LONGEST_JUMP_S, _LONGEST_S = 7 * 86400.0, 366 * 86400.0
_FEW_ROWS, _STEP_ERROR, _IRREGULAR_PART = 10, 0.25, 0.1
_SECOND_ERROR = 0.05
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)
#: said of a last row without line end
CUT_ROW = "the last row has no line end, as where writing was cut off, and is left out; end it with a line end if it is whole"


@dataclass
class Log:
    """A log: 1-s means at rest.

    Attributes
    ----------
    t_s : float array (n,)       end of each second, increasing; a jump is a gap
    temp_degc : float array (n,) NaN where missing
    rates : dict                 axis name -> array (n,) in dph (names ending in _dph) or mg (_mg); NaN where missing
    flags : dict                 axis name -> int array (n,): 1 saturated, 2 samples missing, 4 sensor fault
    metadata : dict of str
    path : str
    """

    t_s: np.ndarray
    temp_degc: np.ndarray
    rates: dict
    flags: dict = field(default_factory=dict)
    metadata: dict = field(default_factory=dict)
    path: str = ""

    @property
    def axes(self):
        """Names of the axes."""
        return list(self.rates)

    @property
    def has_temperature(self):
        """At least one finite temperature."""
        return bool(np.isfinite(self.temp_degc).any())


def _metadata(line, into):
    for part in re.split(r"  +(?=[^=]*=)", line[1:].strip()):
        key, equals, value = part.partition("=")
        if equals:
            into[key.strip()] = value.strip()


def metadata_of(path):
    """What the `#` lines at the head of a log say: 'key = value' pairs."""
    out = {}
    with plain_file(path) as source, open(source.path, encoding="utf-8-sig", errors="replace") as f:
        for line in f:
            if line.strip() and not line.startswith("#"):
                break
            _metadata(line, out)
    return out


def _number(text, path, line, column):
    text = text.strip()
    if not text:
        return math.nan
    if not _NUMBER.fullmatch(text):
        raise DataError(f"{path}:{line}: column {column}: expected a number, found \"{text}\"")
    value = float(text)
    if not math.isfinite(value):
        raise DataError(f"{path}:{line}: column {column}: is not a finite number; leave a missing value empty")
    return value


def _rows(path, lines, columns):
    """Parse the rows: fast where every field is a number, line by line where one is not."""
    try:
        table = np.loadtxt([text for _, text in lines], delimiter=",", ndmin=2, comments=None)
        if table.shape[1] == len(columns) and np.isfinite(table).all():
            return table
    except ValueError:
        pass
    rows = []
    for number, text in lines:
        fields = text.split(",")
        if len(fields) != len(columns):
            commas = ": a decimal comma makes two fields of one number; write points, or export with another separator and let imucal import read it" \
                if len(fields) > len(columns) and not rows and "." not in text else ""
            raise DataError(f"{path}:{number}: expected {len(columns)} fields, found {len(fields)}{commas}")
        rows.append([_number(f, path, number, c) for f, c in zip(fields, columns)])
    return np.array(rows)


def _check_header(path, number, columns, metadata):
    """The names and the version."""
    version = metadata.get("imucal-log", "1")
    if version != "1":
        raise DataError(f"{path}:{number}: log version {version} is not known to this program (it knows 1)")
    if any("\r" in name for name in columns):
        raise DataError(f"{path}:{number}: {CR_ENDS}")
    for i, name in enumerate(columns, 1):
        if not name or not name.isprintable():
            raise DataError(f"{path}:{number}: column {i} has no printable name")
        if name in columns[:i - 1]:
            raise DataError(f"{path}:{number}: column \"{name}\" is given twice")
    axes = [name for name in columns if name.rpartition("_")[2] in _UNITS]
    for name in columns:
        of_name = _axes_of_flags(name, axes) if name.endswith("_flags") else [name]
        if not of_name:
            raise DataError(f"{path}:{number}: column \"{name}\" belongs to no axis")
        if len(of_name) > 1:
            raise DataError(f"{path}:{number}: column \"{name}\" belongs to {' and to '.join(of_name)}: give each of the two a name of its own")


def _refuse(path, lines, bad, words):
    """DataError at the first row that is bad."""
    if bad.any():
        raise DataError(f"{path}:{lines[int(np.argmax(bad))][0]}: {words}")


def _check_values(path, columns, table, lines):
    temp = table[:, 1]
    _refuse(path, lines, (temp < TEMP_DEGC[0]) | (temp > TEMP_DEGC[1]), "temp_degc is no temperature in degrees Celsius")
    for i, name in enumerate(columns[2:], 2):
        value = table[:, i]
        _refuse(path, lines, np.abs(value) > _LARGEST, f"column {name}: is beyond +-1e12")
        if name.endswith("_flags"):
            is_bits = np.isnan(value) | ((value >= 0) & (value <= 255) & (value == np.floor(value)))
            _refuse(path, lines, ~is_bits, f"column {name}: expected whole bits 0..255")


def _even_step_s(usual_s):
    """Means over it would have rows enough in each: two of the usual steps and more, in whole seconds as people count them."""
    return next((s for s in (1, 2, 5, 10, 20, 30, 60, 120, 300, 600) if s >= 2 * usual_s), 3600)


def _check_steps(path, t_s, lines):
    """Jumps are a clock that was set; the other steps are multiples of the usual one."""
    step = np.diff(t_s, prepend=t_s[0])
    far = step > LONGEST_JUMP_S
    days = step[np.argmax(far)] / 86400
    _refuse(path, lines, far, f"t_s jumps by {days:.6g} days; cut the log where its clock was set, or bring its times to seconds")
    _refuse(path, lines, t_s - t_s[0] > _LONGEST_S, "the log spans more than 366 days; cut it")
    if len(t_s) < _FEW_ROWS:
        return
    usual = np.median(step[1:])
    steps = step[1:] / usual
    odd = np.concatenate([[False], (steps < 0.5) | (np.abs(steps - np.round(steps)) > _STEP_ERROR)])
    if odd.sum() > _IRREGULAR_PART * (len(t_s) - 1):
        _refuse(path, lines, odd, f"the rows are irregular: {odd.sum()} of {len(t_s) - 1} steps are no multiple of the usual "
                f"{usual:g} s; average the log to even steps, of {_even_step_s(usual)} s for instance")


def other_step_s(t_s):
    """The usual step of a log's rows where it is another than a second, or None."""
    if len(t_s) < _FEW_ROWS:
        return None
    usual_s = float(np.median(np.diff(t_s)))
    return None if abs(usual_s - 1) <= _SECOND_ERROR else usual_s


def need_one_a_second(path, t_s):
    """DataError where a log's usual step is not a second: its rows would be taken for means of one, or its steps for gaps."""
    usual_s = other_step_s(t_s)
    if usual_s is None:
        return
    remedy = "are these milliseconds? t_s is in seconds" if abs(usual_s / 1000 - 1) <= _SECOND_ERROR else \
        "average them to seconds, or, where t_s is in another unit, bring it to seconds" if usual_s < 1 else \
        "a missing row is a gap, and here nearly every second would be one: record one row a second"
    raise DataError(f"{path}: rows are {usual_s:g} s apart, and a log has one row a second: {remedy}")


def need_readable(path, log):
    """DataError where a log that was made of another file would be refused by every program.

    Parameters
    ----------
    path : str                   of the other file, for the message
    log : Log
    """
    def at(place):
        return f"{log.t_s[place] + float(log.metadata.get('t_s_origin_s', 0)):.15g} s"

    steps = np.diff(log.t_s)
    if (steps > LONGEST_JUMP_S).any():
        place = int(np.argmax(steps > LONGEST_JUMP_S))
        raise DataError(f"{path}: the times jump by {steps[place] / 86400:.6g} days after {at(place)}; cut the record there, "
                        "where its clock was set")
    if len(log.t_s) and log.t_s[-1] - log.t_s[0] > _LONGEST_S:
        raise DataError(f"{path}: the record spans more than 366 days; cut it")
    with np.errstate(invalid="ignore"):
        temp = log.temp_degc
        found = [("temperature", temp, (temp < TEMP_DEGC[0]) | (temp > TEMP_DEGC[1]), "is none in degrees Celsius")]
        found += [(f"axis {name}", rate, np.abs(rate) > _LARGEST, "is beyond +-1e12; are unit and scale right?")
                  for name, rate in log.rates.items()]
    for name, values, bad, words in found:
        if bad.any():
            place = int(np.argmax(bad))
            raise DataError(f"{path}: {name}: {values[place]:g}, the mean of the second to {at(place)}, {words}")


def _axes_of_flags(name, axes):
    stem = name.removesuffix("_flags")
    return [axis for axis in axes if axis.rpartition("_")[0] == stem]


def _leave_out_cut_row(path, number, line):
    """A row without line end may be cut off inside its last number, which then is another one: nobody can see it."""
    if line.strip() and not line.startswith("#"):
        warnings.warn(f"{path}:{number}: {CUT_ROW}", DataWarning, stacklevel=3)


def read_log(path):
    """Read an imucal log (CSV).

    A last row without line end is left out with a DataWarning: it may be cut off inside a number.

    Parameters
    ----------
    path : str                   plain or gzip; "-": standard input

    Returns
    -------
    Log : rates in dph, accelerations in mg, whatever unit the file uses

    Raises
    ------
    DataError : names file and line
    """
    with plain_file(path) as source:
        log = _read(source.path)
        log.path = source.name
    return log


def _read(path):
    metadata, columns, lines = {}, None, []
    try:
        with open(path, encoding="utf-8-sig", errors="backslashreplace", newline="\n") as file:
            for number, whole_line in enumerate(file, 1):
                line = whole_line.rstrip("\r\n")
                if columns is not None and not whole_line.endswith("\n"):
                    _leave_out_cut_row(path, number, line)
                elif line.startswith("#"):
                    _metadata(line, metadata)
                elif not line.strip():
                    continue
                elif columns is None:
                    columns, header_line = [c.strip() for c in line.split(",")], number
                    if columns[:2] == ["t_s", "temp_degc"] and any(c.endswith("_counts") for c in columns):
                        return _read_raw(path)
                else:
                    lines.append((number, line))
    except OSError as error:
        raise DataError(f"{path}: cannot open: {error.strerror}") from None
    if columns is None or columns[:2] != ["t_s", "temp_degc"]:
        _refuse_header(path, columns)
    _check_header(path, header_line, columns, metadata)
    if not lines:
        raise DataError(f"{path}: empty log: a header and no whole row")
    return _log_of(path, metadata, columns, _rows(path, lines, columns), lines)


def _refuse_header(path, columns):
    """DataError: what a file is that does not begin as a log."""
    with open(path, "rb") as file:
        head = file.read(4096)
    if coding := other_coding(head):
        raise DataError(f"{path}: {coding}")
    if ends_in_cr(head.decode(errors="replace")):
        raise DataError(f"{path}: {CR_ENDS}")
    try:
        head.decode()
        is_text = True
    except UnicodeDecodeError as error:
        is_text = error.start > len(head) - 4  # a character of which the rest was not read
    if not is_text:
        raise DataError(f"{path}: not text: not an imucal log; imucal import {path} -o LOG.csv reads other formats")
    if columns is None:
        raise DataError(f"{path}: empty log: no header line (t_s,temp_degc,…)")
    raise DataError(f"{path}: the header begins with t_s,temp_degc, found \"{','.join(columns[:2])}\"; "
                    f"imucal import {path} -o LOG.csv reads other tables")


def _check_times(path, t_s, lines):
    if np.isnan(t_s).any():
        raise DataError(f"{path}:{lines[int(np.flatnonzero(np.isnan(t_s))[0])][0]}: t_s is empty")
    back = np.flatnonzero(np.diff(t_s) <= 0)
    if len(back):
        raise DataError(f"{path}:{lines[int(back[0]) + 1][0]}: t_s does not increase; sort the log or cut it where the clock was set back")


def _log_of(path, metadata, columns, table, lines):
    _check_times(path, table[:, 0], lines)
    _check_steps(path, table[:, 0], lines)
    _check_values(path, columns, table, lines)
    log = Log(table[:, 0].copy(), table[:, 1].copy(), {}, {}, metadata, path)
    for i, name in enumerate(columns[2:], 2):
        stem, _, unit = name.rpartition("_")
        if unit in _UNITS:
            internal = f"{stem}_{'mg' if unit in ('mg', 'ms2') else 'dph'}"
            if internal in log.rates:
                raise DataError(f"{path}: two columns are the axis {internal}, \"{name}\" is the second: leave one of them out, or rename it")
            log.rates[internal] = table[:, i] * _UNITS[unit]
    for i, name in enumerate(columns[2:], 2):
        if name.endswith("_flags"):
            axis, = _axes_of_flags(name, log.rates)
            log.flags[axis] = np.nan_to_num(table[:, i]).astype(int)
    if not log.rates:
        raise DataError(f"{path}: no axis column; names end in their unit: _dph, _dps, _radps, _mg or _ms2")
    return log


def _odd_field(path):
    """Words on the first field that is no UTF-8, which the reader's own words repeat and so are none."""
    columns = None
    with open(path, encoding="utf-8-sig", errors="backslashreplace", newline="\n") as text, open(path, "rb") as raw:
        for number, (line, given) in enumerate(zip(text, raw), 1):
            if not line.strip() or line.startswith("#"):
                continue
            fields = line.rstrip("\r\n").split(",")
            columns = columns or fields
            for column, field_, bytes_ in zip(columns, fields, given.split(b",")):
                if bytes_.decode(errors="replace").count("\ufffd"):
                    return f"{path}:{number}: column {column}: expected a number, found \"{field_}\""
    return f"{path}: a raw log that cannot be read"


def _read_raw(path):
    """A raw log of counts, by the programs' own reader: one rule and one rounding for what is a sample and what is a second."""
    from .native import core

    try:
        t_s, temp_degc, axes, metadata, notices = core().read_log(path)
    except ValueError as error:
        raise DataError(str(error) or _odd_field(path)) from None
    for text in notices:
        warnings.warn(text, DataWarning, stacklevel=3)
    return Log(t_s, temp_degc, {name: rate for name, (rate, _) in axes.items()}, {name: flags.astype(int) for name, (_, flags) in axes.items()},
               metadata, path)


def _text(values, digits):
    """Shortest text of each value rounded to `digits` decimals; empty for NaN."""
    return ["" if v != v else repr(v)[:-2] if v == int(v) and abs(v) < 1e15 else repr(v) for v in np.round(values, digits).tolist()]


def write_bytes(path, data):
    """Write a whole file or nothing: to a temporary name in the same folder, then renamed; through a link, its target.  A device
    or pipe is written to as it is: renaming onto it would take it away."""
    path = os.fspath(path)
    in_place = os.path.exists(path) and not os.path.isfile(path)
    target = os.path.realpath(path)
    temporary = target if in_place else f"{target}.tmp{os.getpid()}"
    try:
        with open(temporary, "wb") as file:
            file.write(data)
        if not in_place:
            os.replace(temporary, target)
    except OSError as error:
        if not in_place and os.path.exists(temporary):
            os.unlink(temporary)
        folder = "; does the folder exist?" if isinstance(error, FileNotFoundError) else ""
        raise DataError(f"{path}: cannot write: {error.strerror}{folder}") from None


def write_text(path, text):
    """write_bytes of a text; "-" is standard output."""
    if path == "-":
        print(text, end="")
        return
    write_bytes(path, text.encode("utf-8"))


def keep_input(source, *outputs):
    """DataError where a result is named as the file that it comes from: a record cannot be had again."""
    for output in outputs:
        if output and output != "-" and os.path.exists(output) and os.path.exists(source) and os.path.samefile(source, output):
            raise DataError(f"{output}: cannot write: it is the file that is read; give another name")


def write_log(path, log):
    """Write a log; rates with 1e-6 dph (or mg), times and temperatures with 1e-6.

    Parameters
    ----------
    path : str                   "-": standard output
    log : Log

    Returns
    -------
    None

    Raises
    ------
    DataError : a file that cannot be written, or arrays of different lengths
    """
    flags = {f"flags of {axis}": bits for axis, bits in log.flags.items()}
    for name, values in {"temp_degc": log.temp_degc, **log.rates, **flags}.items():
        if len(values) != len(log.t_s):
            raise DataError(f"{path}: cannot write: t_s has {len(log.t_s)} rows, {name} {len(values)}")
    header, columns = ["t_s", "temp_degc"], [_text(log.t_s, 6), _text(log.temp_degc, 6)]
    for name, values in log.rates.items():
        header.append(name)
        columns.append(_text(values, 6))
        if name in log.flags and np.any(log.flags[name]):
            header.append(name.rpartition("_")[0] + "_flags")
            columns.append([str(int(f)) for f in log.flags[name]])
    lines = ["# imucal-log = 1"]
    lines += [f"# {key} = {' '.join(str(value).split())}" for key, value in log.metadata.items() if key != "imucal-log"]
    lines.append(",".join(header))
    lines += map(",".join, zip(*columns))
    write_text(path, "\n".join(lines) + "\n")
