# SPDX-License-Identifier: MIT
"""The lines of a first look, for people."""
import math

import numpy as np

from .diagnosis_words import many
from .firstlook import lattice_of

#: what no thermometer of a sensor reads, and where kelvin begin to be likely
_COLDEST_DEGC, _HOTTEST_DEGC, _KELVIN_FROM = -100.0, 200.0, 200.0
_MOST_REPEATS = 0.95
_MOST_NAMED = 3  # outliers
_COARSE = 0.1    # of a second's noise: finer steps are of no use to know
_WHOLE = 0.9     # of the log: noise that lasts so long is not measured by it


def rounded(value, digits=2):
    """Decimal text of a value with so many digits that count, never with an exponent."""
    if not value or not math.isfinite(value):
        return "0" if value == 0 else "-"
    places = digits - 1 - math.floor(math.log10(abs(value)))
    return f"{round(value, places):.{max(places, 0)}f}"


def _signed(value):
    return ("+" if value > 0 else "") + rounded(value)


def with_error(value, error, unit=""):
    """A value and its error with the digits that the error leaves; words where there is none left."""
    unit = f" {unit}" if unit else ""
    if value is None:
        return "-"
    if not error:
        return f"about {rounded(value)}{unit}"
    if error >= value:
        return f"not known (of the order of {rounded(value, 1)}{unit})"
    places = 1 - math.floor(math.log10(error))
    return f"{round(value, places):.{max(places, 0)}f} ± {round(error, places):.{max(places, 0)}f}{unit}"


def _white(look, value, error=None):
    """ARW of a gyro, the noise of a second of an accelerometer; value: of a 1-s mean."""
    per, unit = (60, "deg/√h") if look.unit == "dph" else (1, look.unit)
    size = with_error(value / per, error / per, unit) if error else f"{rounded(value / per, 3)} {unit}"
    return ("ARW " if look.unit == "dph" else "noise of a 1-s mean ") + size


def noise_line(look):
    """What the plots show, and the likely noise beside it."""
    ml = look.ml
    slow = "no slow noise seen"
    if look.slow_sigma and look.slow_tau_s:
        slow = f"slow noise {rounded(look.slow_sigma)} {look.unit}, {look.slow_tau_s:.0f} s"
    line = f"{look.axis}: noise from the plots: {_white(look, look.white)}, {slow}"
    if not ml:
        return line
    error = 60 * ml["arw_error"] if ml["arw_error"] else None
    line += f" | most likely: {_white(look, 60 * ml['arw_deg_rt_h'], error)}"
    if not ml["sigma_dph"]:
        return line + ", no slow noise"
    lasts = "longer than this log" if ml["tau_s"] > _WHOLE * np.ptp(look.t_s) else with_error(ml["tau_s"], ml["tau_error"], "s")
    return line + f", slow noise {with_error(ml['sigma_dph'], ml['sigma_error'], look.unit)}, {lasts}"


def odd_temperature(log):
    """What is wrong with the temperatures, or None."""
    if not log.has_temperature:
        return None
    lo, hi = np.nanmin(log.temp_degc), np.nanmax(log.temp_degc)
    if lo > _KELVIN_FROM:
        return f"temp_degc of {lo:.1f} to {hi:.1f}: are they in kelvin? temp_degc is in degrees Celsius"
    if lo < _COLDEST_DEGC or hi > _HOTTEST_DEGC:
        return f"temp_degc goes from {lo:.1f} to {hi:.1f} °C, where no sensor works: are temp_degc and an axis swapped?"
    return None


def _no_measurement(look):
    """Sentences on seconds that are no measurement."""
    if look.is_constant:
        value = look.rate[np.isfinite(look.rate)][0]
        return [f"{look.axis} never changes: {value:g} {look.unit} in every second: a dead sensor, or a wrong register or column"]
    found = []
    if look.frozen_s:
        found.append(f"{look.axis} is frozen for {look.frozen_s} s from t_s = {look.t_s[look.frozen_from]:g} on: one value, "
                     "while it moves elsewhere")
    elif look.repeats > _MOST_REPEATS:
        found.append(f"{look.axis} repeats itself: {100 * look.repeats:.1f} % of the seconds equal the one before: its steps are "
                     "far coarser than its noise, or it is frozen")
    if look.clipped_share:
        which = "largest" if look.clipped_at >= np.nanmean(look.rate) else "smallest"
        found.append(f"{look.axis} reads its {which} value, {look.clipped_at:g} {look.unit}, in "
                     f"{rounded(100 * look.clipped_share)} % of the seconds: clipped at the end of its range?")
    if len(look.outlier_rows):
        rows = look.outlier_rows[np.argsort(-np.abs(look.rate[look.outlier_rows] - np.nanmean(look.used)))][:_MOST_NAMED]
        named = ", ".join(f"{rounded(look.rate[i], 6)} {look.unit} at t_s = {look.t_s[i]:g}" for i in rows)
        some = ", among them" if len(look.outlier_rows) > _MOST_NAMED else ":"
        n = many(len(look.outlier_rows), "outlier")
        found.append(f"{look.axis} {n} beyond 6 sigma{some} {named}; left out of all figures")
    return found


def _same_axes(looks):
    """Sentences on axes that are one record."""
    found = []
    for i, look in enumerate(looks):
        if not look.is_constant:
            found += [f"{look.axis} and {other.axis} are the same in every second: one register or column taken twice?"
                      for other in looks[i + 1:] if np.array_equal(look.rate, other.rate, equal_nan=True)]
    return found


def _effects(look):
    """Sentences on what the rates do."""
    found = [f"{look.axis} a jump of {_signed(size)} {look.unit} near t_s = {t_s:.0f} ({(t_s - look.t_s[0]) / 60:.0f} min)"
             for t_s, size in look.jumps]
    if look.has_loop:
        found.append(f"{look.axis} a loop of {rounded(look.loop)} {look.unit} rms: rising and falling temperature differ; they "
                     f"make {100 * look.loop_share:.0f} % of the smoothed residual (slow noise can look the same: diagnose "
                     "weighs the two)")
    if look.has_warm_up:
        found.append(f"{look.axis} a warm-up: the start lies {_signed(look.warm_up)} {look.unit} off what the rest of the log "
                     f"predicts ({abs(look.warm_up_z):.1f} standard errors)")
    return found


def _nothing(log, looks):
    """What was looked for and not found, and what could not be seen."""
    if not log.has_temperature:
        return ("no warm-up, no jump, no outlier stands out; no temperature in this log: a loop cannot be seen (record it, "
                "column temp_degc)")
    moves = looks[0].direction
    if np.any(moves > 0) and np.any(moves < 0):
        return "no loop, no warm-up, no jump, no outlier stands out"
    why = "the temperature goes one way only" if np.any(moves) else "the temperature stands still"
    return f"no warm-up, no jump, no outlier stands out; a loop cannot be seen: {why}"


def suspicion_lines(log, looks):
    """One line for each suspicion, or one that says what does not stand out."""
    odd = odd_temperature(log)
    found = ([odd] if odd else []) + _same_axes(looks)
    for look in looks:
        found += _no_measurement(look) + _effects(look)
    return [f"suspected: {words}" for words in found] if found else [f"suspected: nothing: {_nothing(log, looks)}"]


def gap_line(log, imported):
    """What is missing."""
    steps = np.rint(np.diff(log.t_s))
    n, missing = int((steps > 1).sum()), int((steps[steps > 1] - 1).sum())
    text = f"gaps: {n}, {missing} s missing in all" if n else "gaps: none"
    empty = int(np.isnan(np.stack(list(log.rates.values()), axis=1)).any(axis=1).sum())
    if empty:
        text += f"; {empty} s without a rate"
    if imported:
        text += f"; moving: {imported.moving_seconds} s left out; "
        text += f"{imported.n_duplicate} duplicate, {imported.n_backward} late samples"
    return text


def steps_line(log, looks):
    """What is coarse."""
    parts = [f"{look.axis} in steps of {look.lattice:.3g} {look.unit}" for look in looks if look.lattice > _COARSE * look.white]
    temp = lattice_of(log.temp_degc) if log.has_temperature else 0.0
    if temp:
        parts.append(f"thermometer in steps of {temp:.3g} °C")
    return "resolution: " + ("; ".join(parts) if parts else "no steps seen")


def axis_line(look):
    """Mean, travel, residual, Allan deviation of an axis."""
    if look.is_constant:
        return f"{look.axis}: mean {look.rate[np.isfinite(look.rate)][0]:.6g} {look.unit}, constant"
    fine = np.isfinite(look.residual)
    travel = np.ptp(look.rate[fine] - look.residual[fine]) if look.order else 0.0
    least = look.allan_minimum
    allan = f"Allan deviation lowest at {least[0]:.0f} s: {rounded(least[1])}" if least else \
        "Allan deviation: no clear lowest point" if len(look.allan) else "no Allan deviation: no seconds stand side by side"
    bias = "no polynomial: no temperature"
    if look.order:
        bias = f"bias travels {rounded(travel, 3)} with the temperature (order {look.order})"
    elif np.isfinite(look.temp_degc).any():
        bias = "no polynomial: the temperature hardly moves"
    left = rounded(np.sqrt(np.nanmean(look.smooth ** 2)))
    return f"{look.axis}: mean {np.nanmean(look.used):.5g} {look.unit}, {bias}, smoothed residual {left} rms, {allan}"


def head_line(name, log, imported):
    """File, kind, length, temperatures."""
    span = f"{np.nanmin(log.temp_degc):.2f} to {np.nanmax(log.temp_degc):.2f} °C" if log.has_temperature else "no temperature"
    sensor = f"{imported.format}, sensor {log.metadata.get('sensor', '')}" if imported else "imucal log"
    seconds, n = np.ptp(log.t_s) + 1, len(log.axes)
    return f"{name}: {sensor}: {seconds:.0f} s ({seconds / 60:.0f} min), {span}, {n} {'axis' if n == 1 else 'axes'}"


def is_sick(look):
    """An axis that no program is to be given: it is dead, or holds seconds that are no measurement."""
    return bool(look.is_constant or look.frozen_s or look.clipped_share or len(look.outlier_rows))


def _remedy(looks):
    """The next step where no axis is well."""
    if all(look.is_constant or look.frozen_s for look in looks):
        return "find out why no axis changes throughout (sensor, register, column), and record again"
    steps = []
    if any(look.is_constant or look.frozen_s for look in looks):
        steps.append("find out why an axis stands still (sensor, register, column)")
    if any(look.clipped_share for look in looks):
        steps.append("give the clipped axis a larger range and record again")
    if any(len(look.outlier_rows) for look in looks):
        steps.append("find out what happened in the seconds of the outliers, leave the wrong fields empty, then look again")
    return "; ".join(steps)


def _refusals(refused):
    """What is refused, and why: each reason once."""
    whys = {}
    for axis, why in refused.items():
        whys.setdefault(why, []).append(axis)
    texts = [f"{', '.join(axes)}: {why}" if axes[0] else why for why, axes in whys.items()]
    return f"   (refused: {'; '.join(texts)})" if texts else ""


def has_effect(look):
    """Is there anything that a polynomial does not hold?"""
    return bool(look.has_loop or look.has_warm_up or look.jumps)


def calibration(log, looks):
    """(axes, order) of the calibration that is the next step, if it is accepted; None where another step comes first."""
    well = [look for look in looks if not is_sick(look)]
    if odd_temperature(log) or not well or not log.has_temperature or any(has_effect(look) for look in well):
        return None
    order = min(look.order for look in well)
    return ([look.axis for look in well], order) if order else None


def next_line(log, looks, name, importing, refused_by_fit):
    """The next step: a command that will not be refused.  refused_by_fit(axes, order): what a trial says (Asked.refused)."""
    if odd_temperature(log):
        return "next: put temp_degc right, then look again"
    well = [look for look in looks if not is_sick(look)]
    if not well:
        return f"next: {_remedy(looks)}"

    def chosen(some):
        return "" if len(some) == len(log.axes) else "".join(f" --axis {look.axis}" for look in some)
    if not log.has_temperature or min(look.order for look in well) == 0:
        why = "the temperature hardly moves" if log.has_temperature else "no temperature in this log: record it, column temp_degc"
        return (f"next: {importing}imucal errormodel fit {name}{chosen(well)} --markov 1 --criterion ml -o model.json   "
                f"(no thermal calibration: {why})")
    if any(has_effect(look) for look in well):
        return (f"next: {importing}imucal diagnose --log {name}{chosen(well)}   "
                "(names the effect; a calibration now would hold it)")
    axes, order = calibration(log, looks)
    refused = refused_by_fit(axes, order)
    accepted = [look for look in well if look.axis not in refused] if "" not in refused else []
    if refused and (not accepted or refused_by_fit([look.axis for look in accepted], order)):
        return f"next: record again, this log makes no calibration{_refusals(refused)}"
    return (f"next: {importing}imucal calibrate fit {name}{chosen(accepted)} --method poly --order {order} -o table.json"
            f"{_refusals(refused)}")
