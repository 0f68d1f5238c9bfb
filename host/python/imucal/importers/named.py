# SPDX-License-Identifier: MIT
"""From named columns (CSV, Parquet, MATLAB) to a Stream: which column is what, and in which unit.

A name the user gives rules.  Otherwise names are matched as evaluation boards and blackboxes write them; what stays
unclear is an error that names the option.
"""
import re

import numpy as np

from ..errors import DataError
from ..log import LONGEST_JUMP_S, TEMP_DEGC
from ..stream import Motion, Stream
from ..units import ACCEL_UNITS, RATE_UNITS, STANDARD_GRAVITY_MS2, TEMP_UNITS, TIME_UNITS, temp_unit_in_name, unit_in_name
from . import named_twice

#: times are microseconds in 64 bits; this is three thousand years
MAX_TIME_US = 1e17
#: of a row without one
NO_TIME = -(2 ** 62)
_TIME = [r"t_s", r"t", r"time[_ ]?stamp(_?sample)?", r"time", r"timeus", r"sample[_ ]?time[_ ]?fine", r"packetcounter", r"datetime", r"date", r"sec(onds)?"]
_TEMP = [r"temp(erature)?(_?degc)?", r"t(emp)?_?c", r"imu_?temp(erature)?", r"gyro_?temp(erature)?", r"(die|chip|sensor)_?temp(erature)?", r"temp_?out",
         r"sens0temp"]
_GYRO = ["gyro", "gyr", "gyroscope", "gyrounfilt", "gyroraw", "gyroadc", "g", "w", "omega", "angular_velocity", "angularvelocity", "rate", "gyrodata",
         "gyro_rad", "rotation_rate"]
_ACCEL = ["accel", "acc", "accelerometer", "a", "linear_acceleration", "acceleration", "accsmooth"]

_DATE = re.compile(r"\s*(\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:\.\d+)?)?)(Z|[+-]\d\d:?\d\d)?\s*")


_A_DATE = "2026-11-28T10:00:00.25"


class Columns(dict):
    """Named columns of a text table; first_line: the file's line of the first row, for messages."""

    first_line = None


def _plain(name):
    """A name without its unit in brackets, in lower case."""
    return re.sub(r"\s*[\[(][^\])]*[\])]\s*$", "", name.strip()) .strip().lower()


def _find(names, patterns):
    for pattern in patterns:
        for name in names:
            plain = re.sub(r"_(s|ms|us|ns|degc|c|degf|fahrenheit|degk|kelvin)$", "", _plain(name))
            if re.fullmatch(pattern, plain) or re.fullmatch(pattern, _plain(name)):
                return name
    return None


def _axis_columns(names, stems):
    """Three columns x, y, z of the first stem that has them; [] where none has."""
    keyed = {}
    for name in names:
        plain = re.sub(r"_(dph|mdps|dps|radps|deg_s|rad_s|mg|ms2|g)$", "", _plain(name))
        keyed.setdefault(re.sub(r"[ ._\-]", "", plain), name)
        bracket = re.fullmatch(r"\s*(\w+)\[([012])\].*", name)
        if bracket:
            keyed.setdefault(f"{bracket.group(1).lower()}{'xyz'[int(bracket.group(2))]}", name)
    order = ["gyrounfilt"] + stems if "gyro" in stems else stems  # the unfiltered gyro is nearer to the sensor
    for stem in order:
        flat = stem.replace("_", "")
        for form in ("{s}{a}", "{a}{s}", "{s}{a}out", "{a}{s}out"):
            columns = [keyed.get(form.format(s=flat, a=a)) for a in "xyz"]
            if all(columns):
                return columns
    return []


def _given(path, names, text, what):
    columns = [c.strip() for c in text.split(",")]
    for column in columns:
        if column not in names:
            raise DataError(f"{path}: no column \"{column}\" for {what} (there are: {', '.join(names)})")
    return columns


def _time_scale(path, name, values, unit):
    """us per unit of the time column."""
    if unit:
        return TIME_UNITS[unit]
    stated = re.search(r"(?:[\[(]\s*|_)(us|ms|ns|s|sec|µs|seconds|milliseconds|microseconds)\s*[\])]?$", name.strip(), re.I)
    if stated:
        word = stated.group(1).lower().replace("µs", "us")
        return TIME_UNITS[{"sec": "s", "seconds": "s", "milliseconds": "ms", "microseconds": "us"}.get(word, word)]
    if re.fullmatch("timeus", name.strip(), re.I):
        return 1.0
    step = float(np.median(np.diff(values))) if len(values) > 1 else 0.0
    likely = [u for u, f in TIME_UNITS.items() if step > 0 and 0.9 <= 1e6 / (step * f) <= 8500]
    if len(likely) == 1:
        return TIME_UNITS[likely[0]]
    raise DataError(f"{path}: the unit of the time column \"{name}\" is not clear (median step {step:g}): give it as --time \"{name}:s\" "
                    "(s, ms, us or ns)")


def _counted(n, rate_hz):
    """Times of n samples, in us, at a rate."""
    return np.rint(np.arange(n) * (1e6 / rate_hz)).astype(np.int64)


def _dates(values):
    """Microseconds since 1970 of texts that are dates of ISO 8601, or None."""
    parts = [_DATE.fullmatch(str(value)) for value in values]
    if not all(parts):
        return None
    try:
        times = np.array([part[1].replace(" ", "T") for part in parts], "datetime64[us]").astype(np.int64)
    except ValueError:  # a thirteenth month
        return None
    offsets_min = [0 if part[2] in (None, "Z") else int(part[2][0] + "1") * (60 * int(part[2][1:3]) + int(part[2][-2:])) for part in parts]
    return times - 60_000_000 * np.array(offsets_min, np.int64)


def _split_temp(columns, text):
    """(column, unit or None) that --temp names."""
    name, _, unit = text.rpartition(":")
    return (text, None) if text in columns or unit.upper() not in TEMP_UNITS or name not in columns else (name, unit)


def _split_time(columns, text):
    """(column, unit or "") that --time names."""
    name, _, unit = text.partition(":")
    return (text, "") if name and name not in columns and text in columns else (name, unit)


def _named_by_options(columns, options):
    """{column: the option that names it}, of those that are there; UsageError where two options name one."""
    named = [(column.strip(), option) for option, text in (("--gyro", options.gyro), ("--accel-columns", options.accel))
             for column in (text or "").split(",")]
    named += [(_split_time(columns, options.time or "")[0], "--time"), (_split_temp(columns, options.temp or "")[0], "--temp")]
    found = {}
    for column, option in named:
        if column in columns and column in found:
            raise named_twice(column)
        if column in columns:
            found[column] = option
    return found


def _free(columns, named):
    """What is left to be found by its name, and a remark on what is not."""
    options = dict.fromkeys(named.values())
    said = [(option, [column for column in named if named[column] == option]) for option in options]
    remark = "; ".join(f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} named by {option}" for option, names in said)
    return [name for name in columns if name not in named], f" ({remark})" if remark else ""


def _is_date(value):
    return _dates([value]) is not None


def _refuse_odd_time(path, columns, name):
    """DataError where all times but a few are numbers, or dates: the first that is not."""
    values = columns[name]
    for what, test in (("a number", _is_number), (f"a date as {_A_DATE}", _is_date)):
        is_one = np.array([value is None or test(value) for value in values])
        if np.mean(is_one) > 0.5 and any(value is not None for value in values):
            bad = int(np.argmin(is_one))
            raise DataError(f"{_row(path, columns, bad)}: {unexpected(name, values[bad], what)}")


def _temperature(path, columns, options, others):
    """(name or None, readings in degC, note or None): the column that is named, or found among those that are not `others`."""
    if options.temp:
        name, unit = _split_temp(columns, options.temp)
        _given(path, columns, name, "--temp")
    else:
        name, unit = _find([n for n in columns if n not in others], _TEMP), None
    if name is None:
        return None, None, None
    unit = unit.upper() if unit else temp_unit_in_name(name) or "C"
    degree, zero, words = TEMP_UNITS[unit]
    raw = np.full(len(columns[name]), np.nan) if _is_empty(columns[name]) else numbers(path, columns, name).astype(float)
    readings = raw if unit == "C" else degree * raw + zero
    _refuse_far_readings(path, columns, name, raw, readings)
    return name, readings, \
        f"column {name} is taken as {words} and converted; if it is in degC: --temp \"{name}:C\"" if unit != "C" else None


def _temp_hint(columns, others):
    """Where a temperature may be found."""
    free = [name for name in columns if name not in others]
    likely = [name for name in free if re.search("temp|therm|kelvin|celsius|fahrenheit|deg_?c", name, re.I)]
    if not likely:
        return f"no column is named so; its other columns: {', '.join(free[:20]) or 'none'}; name one: --temp COLUMN"
    first = f"\"{likely[0]}\"" if re.search(r"\W", likely[0]) else likely[0]
    return f"columns that may be one: {', '.join(likely)}; choose: --temp {first}"


def _times(path, columns, options, free, taken):
    """(int64 us, name of the column or None, us per unit or None); free, taken: of _free."""
    n = len(next(iter(columns.values())))
    text, unit = _split_time(columns, options.time or "")
    if unit and unit not in TIME_UNITS:
        raise DataError(f"{path}: --time {options.time}: unit {unit} is none of s, ms, us, ns")
    name = _given(path, columns, text, "--time")[0] if text else _find(free, _TIME)
    if name is None:
        if options.rate_hz:
            return _counted(n, options.rate_hz), None, None
        raise DataError(f"{path}: no time column found among {', '.join(free)}{taken}; name it: --time COLUMN, or give the "
                        "sample rate: --rate HZ")
    values = columns[name]
    if np.issubdtype(values.dtype, np.datetime64):
        return values.astype("datetime64[us]").astype(np.int64), name, None
    if values.dtype.kind not in "iuf":
        dates = _dates(values)
        if dates is not None:
            return dates, name, None
        if options.rate_hz and not text:
            return _counted(n, options.rate_hz), None, None
        _refuse_odd_time(path, columns, name)
        raise DataError(f"{path}: the time column \"{name}\" holds neither numbers nor dates as {_A_DATE} (first: "
                        f"\"{values[0]}\"); name another: --time COLUMN, or count the samples: --rate HZ")
    fine = values[np.isfinite(values.astype(float))]
    scale = _time_scale(path, name, fine.astype(float), unit)
    _refuse_far_times(path, columns, name, scale)
    if values.dtype.kind in "iu":
        from ..seconds import unwrap
        whole = values.astype(np.int64)
        if whole.max() < 2 ** 32 and len(whole) > 1 and np.diff(whole).min() < -(2 ** 31):
            whole = unwrap(whole, 32)
        return np.rint(whole * scale).astype(np.int64) if scale < 1 else whole * np.int64(scale), name, scale
    there = np.isfinite(values)
    return np.where(there, np.rint(np.where(there, values, 0) * scale).astype(np.int64), NO_TIME), name, scale


def _unit_of(path, gyro, options, default):
    """(unit, factor to dph)."""
    if options.unit == "counts":
        if not options.scale:
            raise DataError(f"{path}: counts need their scale: --unit counts --scale DPH_PER_COUNT (16.4 counts per deg/s: --scale 219.512)")
        return "counts", options.scale
    stated = {unit_in_name(name) for name in gyro} - {None}
    unit = options.unit or (stated.pop() if len(stated) == 1 else default)
    if unit not in RATE_UNITS:
        raise DataError(f"{path}: the unit of {', '.join(gyro)} is not stated: give --unit dph, dps, radps or counts")
    return unit, RATE_UNITS[unit]


def _refuse_far_times(path, columns, name, scale):
    """DataError where a time lies beyond what microseconds in 64 bits can hold; a time that is not a number is left to the caller."""
    values = columns[name].astype(float)
    bad = np.flatnonzero(np.isfinite(values) & (np.abs(values) * scale > MAX_TIME_US))
    if len(bad):
        raise DataError(f"{_row(path, columns, int(bad[0]))}: time {values[bad[0]]:g} in column {name} is out of range; correct or remove that row")


def _refuse_jump(path, columns, t_us, is_rated):
    """DataError where the clock was set amid the rows with rates: no program reads a log with such a jump.  Where nearly every
    step is as long the unit is wrong, of which the caller knows more to say."""
    rows = np.flatnonzero(is_rated & (t_us != NO_TIME))
    if len(rows) < 2:
        return
    step_s = np.diff(np.maximum.accumulate(t_us[rows])) / 1e6
    if step_s.max() > LONGEST_JUMP_S >= np.median(step_s):
        at = int(np.argmax(step_s > LONGEST_JUMP_S))
        place = _row(path, columns, int(rows[at + 1]))
        raise DataError(f"{place}: the time jumps by {step_s[at] / 86400:.6g} days; cut the table "
                        "where its clock was set, or remove that row if it is alone")


def _refuse_far_readings(path, columns, name, raw, readings):
    """DataError where a reading is no temperature; of a column that holds none at all the caller knows more to say."""
    with np.errstate(invalid="ignore"):
        bad = (readings < TEMP_DEGC[0]) | (readings > TEMP_DEGC[1])
    if bad.any() and not bad[np.isfinite(readings)].all():
        at = int(np.argmax(bad))
        raise DataError(f"{_row(path, columns, at)}: column {name}: {raw[at]:g} is no temperature in degrees Celsius; "
                        "mend it, leave it empty, or name another column: --temp COLUMN[:UNIT]")


def _row(path, columns, number):
    """Place of row `number`, from 0, for people."""
    first_line = getattr(columns, "first_line", None)
    return f"{path}:{first_line + number}" if first_line else f"{path}, row {number + 1}"


def numbers(path, columns, name):
    values = columns[name]
    if values.dtype.kind in "iuf":
        return values
    if _is_empty(values):
        raise DataError(f"{path}: column {name} holds no number in any row; name another: --gyro X,Y,Z for the gyro's")
    bad = next((i for i, v in enumerate(values) if not _is_number(v)), 0)
    found = str(values[bad]).lower() if _is_truth(values[bad]) else values[bad]
    raise DataError(f"{_row(path, columns, bad)}: {unexpected(name, found)}")


def unexpected(name, value, what="a number"):
    """What is wrong with a field of a column."""
    if value == name:
        return "the names of the columns stand here again; remove that line"
    return f"column {name}: expected {what}, found \"{value}\""


def _is_empty(values):
    return values.dtype.kind not in "iuf" and all(value is None for value in values)


def _is_truth(value):
    return isinstance(value, (bool, np.bool_))


def _is_number(value):
    try:
        float(value)
        return not _is_truth(value)
    except (TypeError, ValueError):
        return value is None


def _accel(path, columns, options, free):
    """(names, values, factors, unit), or None where there is none or its unit is unknown and not needed."""
    names = _given(path, columns, options.accel, "--accel-columns") if options.accel else _axis_columns(free, _ACCEL)
    if len(names) != 3:
        return None
    unit = unit_in_name(names[0])
    values = np.stack([numbers(path, columns, n).astype(float) for n in names], axis=1)
    if unit not in ACCEL_UNITS:
        # At rest an accelerometer reads one g: its own size tells the unit.
        size = float(np.nanmedian(np.linalg.norm(values, axis=1)))
        unit = next((u for u, g in (("g", 1.0), ("ms2", STANDARD_GRAVITY_MS2), ("mg", 1000.0)) if 0.8 < size / g < 1.2), None)
        if unit is None:
            return (names, values, 1000.0 / size, None) if size > 0 else None
    return names, values, ACCEL_UNITS[unit], unit


def _axis_stems(names):
    if len(names) == 3:
        return ["gx", "gy", "gz"]
    stems = [re.sub(r"_(dph|mdps|dps|radps|counts)$", "", re.sub(r"\W+", "_", _plain(n)).strip("_")) for n in names]
    return [s if s and not s.startswith("a") else f"g{i}" for i, s in enumerate(stems)]


def stream_of(path, columns, options, name, default_unit=None, metadata=None):
    """One stream from named columns of equal length."""
    if not columns or len(next(iter(columns.values()))) == 0:
        raise DataError(f"{path}: a header and no whole row")
    if options.gyro is None and "gyro" in columns and columns["gyro"].ndim == 2:
        raise DataError(f"{path}: column gyro is a matrix")
    named = _named_by_options(columns, options)
    free, taken = _free(columns, named)
    gyro = _given(path, columns, options.gyro, "--gyro") if options.gyro else _axis_columns(free, _GYRO)
    if not gyro:
        raise DataError(f"{path}: no gyro columns found among {', '.join(free[:40])}{taken}; name them: --gyro X,Y,Z --unit dps")
    unit, factor = _unit_of(path, gyro, options, default_unit)
    t_us, time_name, us_per_unit = _times(path, columns, options, free, taken)
    parts = [numbers(path, columns, n) for n in gyro]
    whole = options.unit == "counts" and all(p.dtype.kind in "iu" for p in parts)
    values = np.stack([p.astype(np.int64 if whole else np.float64) for p in parts], axis=1)
    _refuse_jump(path, columns, t_us, np.isfinite(values).any(axis=1))
    timeless = t_us == NO_TIME
    if timeless.any():  # a row without a rate is left out
        values = np.where(timeless[:, None], np.nan, values)
        whole = False
    stream = Stream(0, name, _axis_stems(gyro), t_us, values, np.full(len(gyro), factor), unit,
                    metadata={"columns": " ".join(f"{a}={n}" for a, n in zip(_axis_stems(gyro), gyro)), **(metadata or {})})
    stated = {unit_in_name(n) for n in gyro} - {None, options.unit}
    if options.unit and stated:
        stream.notes.append(f"--unit {options.unit} is taken, though the columns {', '.join(gyro)} say {' and '.join(sorted(stated))}")
    stream.time_column = (time_name, us_per_unit) if us_per_unit else None
    if timeless.any():
        n = int(timeless.sum())
        stream.notes.append("1 row has no time, and is left out" if n == 1 else f"{n} rows have no time, and are left out")
    if time_name is None:
        stream.notes.append(f"no column of times: the samples are counted, at {options.rate_hz:g} Hz; a gap could not be seen")
    temp, readings, note = _temperature(path, columns, options, [*named, *gyro, time_name])
    if temp:
        stream.temp_t_us, stream.temp_degc = t_us, readings
        stream.metadata["columns"] += f" temp={temp}"
        stream.notes += [note] if note else []
    else:
        stream.temp_hint = _temp_hint(columns, gyro + [time_name])
    accel = _accel(path, columns, options, [n for n in free if n not in (time_name, temp)])
    if accel and set(accel[0]).isdisjoint(gyro):
        _attach_accel(path, stream, accel, options, whole)
    if options.with_accel and "ax" not in stream.axes:
        raise DataError(f"{path}: no accelerometer columns found; name them: --accel-columns X,Y,Z")
    _take_seconds(stream)
    return stream


def _attach_accel(path, stream, accel, options, whole):
    names, values, factor, unit = accel
    if not options.with_accel:
        stream.motion.append(Motion("accel", stream.t_us, values * factor))
        return
    if unit is None:
        raise DataError(f"{path}: the unit of {', '.join(names)} is not clear: write it behind the names, as in \"acc_x [g]\"")
    stream.values = np.hstack([stream.values * (stream.to_internal if whole else 1), values])
    stream.to_internal = np.concatenate([np.ones(stream.values.shape[1] - 3) if whole else stream.to_internal, np.full(3, factor)])
    stream.axes, stream.unit = stream.axes + ["ax", "ay", "az"], f"{stream.unit}, {unit}"


def _take_seconds(stream):
    """Rows that come once a second, on the second, are 1-s means as they stand."""
    steps = np.diff(stream.t_us)
    if len(steps) and abs(float(np.median(steps)) - 1e6) < 2e4 and np.mean((np.abs(steps - np.rint(steps / 1e6) * 1e6) < 2e5) & (steps > 5e5)) > 0.9:
        stream.is_seconds, stream.rate_hz = True, 1.0
        stream.notes.append("one row a second: taken as 1-s means as they stand; single samples would carry their full noise")
