# SPDX-License-Identifier: MIT
"""From the samples of a Stream to a log of 1-s means at rest."""
import os
from dataclasses import dataclass, field

import numpy as np

from .clock import clock_of
from .errors import DataError
from .log import Log
from .seconds import FLAG_MISSING, cut_seconds, keep_in_order, nominal_rate_hz
from .still import accel_moves, gyro_moves, widen
from .units import TIME_UNITS

#: a temperature is interpolated between readings no further apart than this
MAX_TEMP_GAP_S = 120.0
#: a boot-relative clock stays below this; larger ones are epochs, and the log then counts from its first second
MAX_BOOT_S = 1e8
#: samples further apart make no mean of every second, and no gyro gives more of them
MAX_STEP_S, MAX_RATE_HZ = 1.5, 5e4
MIN_LIKELY_STEP_S = 1 / 8500


@dataclass
class Imported:
    """A log and what happened on the way to it."""

    log: Log
    format: str
    sensors: list
    chosen: int
    gaps: int
    gap_seconds: int
    moving_seconds: int
    n_empty: int
    n_duplicate: int
    n_same: int
    n_backward: int
    source_sha256: str
    notes: list = field(default_factory=list)

    def to_json(self):
        """The fields of the contract and more."""
        return {"format": self.format, "sensors": self.sensors, "chosen": self.chosen, "seconds": len(self.log.t_s),
                "gaps": self.gaps, "gap_seconds": self.gap_seconds, "moving_seconds": self.moving_seconds,
                "empty_samples": self.n_empty, "duplicates": self.n_duplicate, "same_stamps": self.n_same, "steps_back": self.n_backward, "source_sha256": self.source_sha256,
                "has_temperature": self.log.has_temperature, "axes": self.log.axes, "notes": self.notes}


def usable_temperature(temp_degc):
    """Reason why these readings are no measurement, or None."""
    finite = temp_degc[np.isfinite(temp_degc)]
    if len(finite) == 0:
        return "its temperature is not a number (NaN) throughout"
    if np.all(finite == 0):
        return "its temperature is exactly 0 throughout, which no thermometer reads: a simulation or a driver without one"
    if np.all((finite < -100) | (finite > 300)):
        return f"its temperature reads {finite[0]:g} throughout, which is no temperature in degC"
    return None


def describe(stream, rate_hz=None):
    """One entry of "sensors" in the JSON of import; rate_hz: as the user gave it."""
    has = stream.temp_degc is not None and usable_temperature(stream.temp_degc) is None
    return {"instance": stream.instance, "name": stream.name, "axes": list(stream.axes), "rate_hz": round(_clock(stream, rate_hz).rate_hz, 4),
            "has_temperature": bool(has)}


def _clock(stream, rate_hz):
    """The stream's clock, found once."""
    if stream.clock is None:
        stream.clock = clock_of(stream, rate_hz)
    return stream.clock


def _seconds_temperature(stream, seconds):
    """Mean temperature of each second; between slower readings, interpolated."""
    temp_t, temp = stream.temp_t_us, stream.temp_degc
    if temp_t is stream.t_us:
        mean = seconds.nanmean(temp)
        if np.isfinite(mean).all():
            return mean
    fine = np.isfinite(temp)
    temp_t, temp = temp_t[fine], temp[fine]
    in_order, _, _ = keep_in_order(temp_t)
    temp_t, temp = temp_t[in_order], temp[in_order]
    temp_t = temp_t / 1e6
    edges = np.searchsorted(temp_t, np.stack([seconds.end_s - 1, seconds.end_s]))
    inside = edges[1] > edges[0]
    total = np.concatenate([[0.0], np.cumsum(temp)])
    mean = np.divide(total[edges[1]] - total[edges[0]], edges[1] - edges[0], out=np.full(len(inside), np.nan), where=inside)
    middle = seconds.end_s - 0.5
    nearest = np.clip(np.searchsorted(temp_t, middle), 1, max(len(temp_t) - 1, 1))
    before, after = temp_t[nearest - 1], temp_t[min(len(temp_t) - 1, 1) if len(temp_t) < 2 else nearest]
    near = (middle >= before - 2) & (middle <= after + 2) & (after - before <= MAX_TEMP_GAP_S)
    return np.where(inside, mean, np.where(near, np.interp(middle, temp_t, temp), np.nan))


def _finite_rows(values):
    """Mask of the rows whose values are finite; None where all are, as nearly always: that is seen in a third of the time."""
    finite = np.isfinite(values)
    return None if finite.all() else finite.all(axis=1)


def _motion_of(stream, seconds, t_us, values, is_gyro):
    """Moving seconds, by the sensor itself and by what else the file tells."""
    internal = values * stream.to_internal
    moves = np.zeros(len(seconds.n), bool)
    if is_gyro.any():
        moves |= gyro_moves(seconds, internal if is_gyro.all() else internal[:, is_gyro])
    if (~is_gyro).sum() == 3:
        moves |= accel_moves(seconds, internal[:, ~is_gyro])
    for other in stream.motion:
        keep, _, _ = keep_in_order(other.t_us)
        keep &= other.t_us >= 0
        v = np.asarray(other.values, float)[keep]
        finite = _finite_rows(v)
        t, v = (other.t_us[keep], v) if finite is None else (other.t_us[keep][finite], v[finite])
        if len(t) < 2:
            continue
        cut = cut_seconds(t, nominal_rate_hz(t))
        found = (gyro_moves if other.kind == "gyro" else accel_moves)(cut, v)
        moves |= np.isin(seconds.end_s, cut.end_s[found])
    return widen(moves, seconds.end_s)


def _gaps(t_s):
    steps = np.rint(np.diff(t_s)).astype(int)
    return int(np.count_nonzero(steps > 1)), int(np.sum(steps[steps > 1] - 1))


def _axis_names(stream):
    units = stream.axis_units
    return np.array([unit == "dph" for unit in units]), [f"{axis}_{unit}" for axis, unit in zip(stream.axes, units)]


def _offset_s(t_us):
    """Whole seconds taken off the clock: a negative one, or an epoch."""
    first = int(t_us.min())
    return first // 1_000_000 if first < 0 or first / 1e6 > MAX_BOOT_S else 0


def _refuse_moving(path, n_moving, n_all):
    raise DataError(f"{path}: the device moves throughout: {n_moving} of {n_all} s show motion, and a static calibration needs rest; "
                    f"record it lying still, or, if this is no motion, run: imucal import {path} -o LOG.csv --keep-moving")


def _check_temperature(path, stream, wanted):
    """Readings to use or None; DataError where a temperature is wanted and there is none."""
    reason = "it has no temperature" if stream.temp_degc is None else usable_temperature(np.asarray(stream.temp_degc, float))
    if reason is None:
        return True
    reason += f" ({stream.temp_hint})" if stream.temp_hint else ""
    if wanted:
        raise DataError(f"{path}: sensor {stream.instance} ({stream.name}): {reason}. A thermal calibration needs one. "
                        f"Without (Allan deviation, noise): imucal import {path} -o LOG.csv {stream.chosen_by} --without-temp")
    stream.notes.append(f"{reason}; temp_degc is left empty")
    return False


def _as_seconds(stream, keep_t, values):
    """Rows that are 1-s means already."""
    n = np.ones(len(keep_t), np.int64)
    from .seconds import Seconds
    none = np.zeros(len(keep_t), bool)
    return Seconds(keep_t // 1_000_000, np.arange(len(keep_t)), n, none, none)


def _settle(stream, clock, has_temperature):
    """Leaves the stream with the samples that are taken, at their times less whole seconds, which are returned."""
    offset_s = 0 if stream.is_seconds else _offset_s(clock.t_us)
    before, rows = stream.t_us, clock.rows
    stream.t_us = clock.t_us - offset_s * 1_000_000
    own_times, all_have_rates = stream.temp_t_us is before, rows is None or len(rows) == len(before)
    if has_temperature:
        stream.temp_degc = np.asarray(stream.temp_degc, float)
        if not own_times:
            stream.temp_t_us = stream.temp_t_us - offset_s * 1_000_000
        else:
            stream.temp_t_us, stream.temp_degc = stream.t_us, stream.temp_degc if all_have_rates else stream.temp_degc[rows]
    for other in stream.motion:
        if other.t_us is before:
            other.t_us, other.values = stream.t_us, other.values if all_have_rates else other.values[rows]
        else:
            other.t_us = other.t_us - offset_s * 1_000_000
    stream.values = stream.values if all_have_rates else stream.values[rows]
    stream.flags = stream.flags if stream.flags is None or all_have_rates else stream.flags[rows]
    return offset_s


def _check_step(path, stream, clock):
    """DataError where the samples come more seldom than once a second, or faster than from any gyro: there is no mean of them, or
    their times are in another unit."""
    if stream.is_seconds or len(clock.t_us) < 3:
        return
    step_s = float(np.median(np.diff(clock.t_us))) / 1e6
    if step_s <= MAX_STEP_S and clock.rate_hz <= MAX_RATE_HZ:
        return
    shown = f"samples are {step_s:g} s apart" if step_s > MAX_STEP_S else f"there are {clock.rate_hz:.4g} a second"
    remedies = ["record at least one sample once a second"] if step_s > MAX_STEP_S else []
    name, us_per_unit = stream.time_column or (None, None)
    likely = [u for u, us in TIME_UNITS.items() if us_per_unit and us != us_per_unit and MIN_LIKELY_STEP_S <= step_s * us / us_per_unit <= 1.1]
    remedies += [f"if the times are in {unit}: --time {name}:{unit}" for unit in likely] or ["if the times are in another unit: --time COLUMN:UNIT"]
    raise DataError(f"{path}: sensor {stream.instance} ({stream.name}): {shown}, and a log holds a mean of every second: {'; '.join(remedies)}")


def _rate(path, clock, given_hz):
    """Nominal samples per second: as given where the stamps do not contradict it, else what they show."""
    shown_hz = clock.rate_hz or 1.0
    if given_hz and not 0.5 <= given_hz / shown_hz <= 2:
        raise DataError(f"{path}: --rate {given_hz:g} contradicts the time stamps, which show {shown_hz:.4g} Hz: leave --rate out, or, where the stamps are in another "
                        "unit, name it: --time COLUMN:UNIT")
    return given_hz or shown_hz


def to_log(path, stream, rate_hz=None, temperature=True, keep_moving=False):
    """1-s means of a stream at rest.

    Returns
    -------
    log : Log
    counts : dict    gaps, gap_seconds, moving_seconds, n_empty, n_duplicate, n_same, n_backward
    """
    if len(stream.t_us) == 0:
        raise DataError(f"{path}: sensor {stream.instance} ({stream.name}) has no samples")
    has_temperature = _check_temperature(path, stream, temperature)
    clock = _clock(stream, rate_hz)
    if clock.problem:
        raise DataError(f"{path}: sensor {stream.instance} ({stream.name}): {clock.problem}")
    if len(clock.t_us) == 0:
        raise DataError(f"{path}: sensor {stream.instance} ({stream.name}) has no finite samples")
    _check_step(path, stream, clock)
    stream.notes += clock.notes
    offset_s = _settle(stream, clock, has_temperature)
    t_us, values = stream.t_us, stream.values
    rate = _rate(path, clock, rate_hz)
    seconds = _as_seconds(stream, t_us, values) if stream.is_seconds else cut_seconds(t_us, rate)
    is_gyro, names = _axis_names(stream)
    moves = _motion_of(stream, seconds, t_us, values, is_gyro) if not keep_moving else np.zeros(len(seconds.n), bool)
    if moves.all() or (~moves).sum() < min(3, len(moves)):
        _refuse_moving(path, int(moves.sum()), len(moves))
    still = ~moves
    if np.issubdtype(values.dtype, np.integer):
        mean = np.stack([seconds.mean_of_counts(values[:, i], f) for i, f in enumerate(stream.to_internal)], axis=1)
    else:
        mean = seconds.mean(values) * stream.to_internal
    mean[seconds.is_gap] = np.nan
    if seconds.is_gap.all():
        raise DataError(f"{path}: sensor {stream.instance} ({stream.name}): no second has half of its {rate:.4g} samples, so none has a rate; is the sample rate "
                        "right (--rate HZ), are the gyro's columns nearly empty?")
    temp = _seconds_temperature(stream, seconds) if has_temperature else np.full(len(seconds.n), np.nan)
    t_s = t_us / 1e6 if stream.is_seconds else seconds.end_s.astype(float)
    flags = np.repeat(np.where(seconds.is_missing, FLAG_MISSING, 0)[:, None], len(names), axis=1) if stream.flags is None else stream.flags
    log = Log(t_s[still], temp[still], {n: mean[still, i] for i, n in enumerate(names)}, {n: flags[still, i] for i, n in enumerate(names)}, dict(stream.metadata),
              os.fspath(path))
    if offset_s:
        log.metadata["t_s_origin_s"] = offset_s
    stream.notes += [f"axis {name} has no value in any second" for name, rate in log.rates.items() if np.isnan(rate).all()]
    gaps, gap_seconds = _gaps(log.t_s)
    log.metadata.update(source_unit=stream.unit, source_rate_hz=f"{rate:g}")
    return log, {"gaps": gaps, "gap_seconds": gap_seconds, "moving_seconds": int(moves.sum()), "n_empty": clock.n_empty, "n_duplicate": clock.n_duplicate,
                 "n_same": clock.n_same, "n_backward": clock.n_late}
