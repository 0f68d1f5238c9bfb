# SPDX-License-Identifier: MIT
"""``imucal look``: one page and ten lines about a log of any format, raw first."""
import gc
import json
import os
import subprocess
import sys
import tempfile
import warnings

import numpy as np

from .ahead import ahead
from .cli import common_options, finish_json, parser_of
from .diagnosis_words import many
from .errors import DataError, DataWarning
from .firstlook import lattice_of, look_at_axis
from .importers import Options, check_options, detect, import_log
from .inputs import plain_file
from .log import keep_input, need_one_a_second, read_log, write_log
from .plot import look_page, save_page
from .plot.loading import load_renderer
from .programs import find


_FEWEST_S = 100
#: what no thermometer of a sensor reads, and where kelvin begin to be likely
_COLDEST_DEGC, _HOTTEST_DEGC, _KELVIN_FROM = -100.0, 200.0, 200.0
_MOST_REPEATS = 0.95
_NO_RATE = 1 | 4  # flags: saturated, sensor fault
#: above this share of the smoothed residual's variance a loop is suspected
LOOP_SHARE = 0.5


def _parser():
    parser = parser_of("look", "The first thing to do with a log: one page (PNG, or HTML with the text) and ten lines.")
    parser.add_argument("file", metavar="FILE", help="a log of any format imucal import knows")
    parser.add_argument("-o", "--output", metavar="PAGE.png|PAGE.html", help="page to write (default: FILE's name with .look.png, in this folder)")
    parser.add_argument("--order", type=int, default=3, choices=range(0, 6), metavar="N", help="of the polynomial (default 3)")
    parser.add_argument("--axis", action="append", metavar="NAME", help="axis, repeatable; default all, up to six")
    parser.add_argument("--instance", type=int, metavar="N")
    parser.add_argument("--time", metavar="COL[:UNIT]")
    parser.add_argument("--gyro", metavar="X,Y,Z")
    parser.add_argument("--unit", choices=["dph", "dps", "mdps", "radps", "counts"])
    parser.add_argument("--scale", type=float, metavar="DPH")
    parser.add_argument("--temp", metavar="COL[:UNIT]")
    parser.add_argument("--rate", type=float, metavar="HZ")
    parser.add_argument("--accel", action="store_true", help="the accelerometer's axes too")
    parser.add_argument("--no-ml", action="store_true", help="no maximum-likelihood noise beside what is read off")
    common_options(parser)
    return parser


def _load(given, source):
    """(log, what the import said or None)."""
    options = Options(given.instance, given.time, given.gyro, None, given.unit, given.scale, given.temp, given.rate, with_accel=given.accel,
                      temperature=False)
    if detect(source)[0] == "imucal-log":
        check_options(source.path, "imucal-log", options)
        return read_log(source), None
    result = import_log(source, options)
    return result.log, result


def _axes(log, wanted):
    for name in wanted or ():
        if name not in log.rates:
            raise DataError(f"{log.path}: no axis \"{name}\" (there are: {', '.join(log.axes)})")
    return (wanted or log.axes)[:6]


def _usable(path, log, axes):
    """The axes that can be looked at.  Seconds that are flagged as saturated or faulty lose their rate, as in all programs."""
    need_one_a_second(path, log.t_s)
    for axis in axes:
        if axis in log.flags:
            log.rates[axis] = np.where(log.flags[axis] & _NO_RATE, np.nan, log.rates[axis])
    seconds = {axis: int(np.isfinite(log.rates[axis]).sum()) for axis in axes}
    few = [axis for axis in axes if seconds[axis] < _FEWEST_S]
    words = "; ".join(f"axis {axis} has {many(seconds[axis], 'usable second')}" for axis in few)
    if len(few) == len(axes):
        raise DataError(f"{path}: {words}: too few to look at; are they empty, or flagged?")
    if few:
        warnings.warn(f"{path}: {words}: left out", DataWarning, stacklevel=2)
    return [axis for axis in axes if axis not in few]


class Likelihood:
    """Maximum-likelihood noise of each axis by `errormodel fit`, in the background."""

    def __init__(self, path, log, axes, order, imported):
        self.folder, self.runs = tempfile.TemporaryDirectory(), {}
        try:
            program = find("errormodel")
        except DataError:  # the likelihood is an extra; what is read off stands without
            return
        if imported:
            path = os.path.join(self.folder.name, "log.csv")
            write_log(path, log)
        for axis in axes:
            detrend = f"poly:{order}" if log.has_temperature and np.nanmax(log.temp_degc) - np.nanmin(log.temp_degc) >= 1 else "mean"
            # The likelihood needs no curve: two points of it are the fewest that the program makes.
            command = [program, "fit", os.fspath(path), "--axis", axis, "--markov", "1", "--criterion", "ml", "--detrend", detrend, "--bootstrap", "0",
                       "--tau", "2:4:2", "--threads", "1", "-o", os.path.join(self.folder.name, f"{axis}.json"), "--json", "-"]
            self.runs[axis] = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)

    def read(self, axis):
        """{"arw", "sigma", "tau" and their errors}; empty where it could not be had."""
        if axis not in self.runs:
            return {}
        out, _ = self.runs[axis].communicate()
        if self.runs[axis].returncode not in (0, 1):
            return {}
        result = json.loads(out)
        markov, errors = (result["model"]["markov"] or [{}])[0], result.get("std_errors", {})
        return {"arw_deg_rt_h": result["model"]["arw_deg_rt_h"], "arw_error": errors.get("arw_deg_rt_h"), "sigma_dph": markov.get("sigma_dph"),
                "sigma_error": errors.get("markov[0].sigma_dph"), "tau_s": markov.get("tau_s"), "tau_error": errors.get("markov[0].tau_s")}

    def close(self):
        """End what still runs and remove what was written."""
        for run in self.runs.values():
            if run.poll() is None:
                run.kill()
                run.communicate()
        self.folder.cleanup()


def _pm(value, error):
    return "-" if value is None else f"{value:.3g}" + (f"±{error:.2g}" if error else "")


def _noise_line(look):
    white = f"ARW {look.arw_deg_rt_h:.3g} deg/√h" if look.unit == "dph" else f"noise of a 1-s mean {look.white:.3g} {look.unit}"
    ml = look.ml
    white_ml = "" if not ml else f"ARW {_pm(ml['arw_deg_rt_h'], ml['arw_error'])}" if look.unit == "dph" else \
        _pm(60 * ml["arw_deg_rt_h"], 60 * ml["arw_error"] if ml["arw_error"] else None)
    beside = f" | likelihood: {white_ml}, {_pm(ml['sigma_dph'], ml['sigma_error'])} {look.unit} with {_pm(ml['tau_s'], ml['tau_error'])} s" if ml else ""
    return f"{look.axis}: read off: {white}, instability {look.slow_sigma:.3g} {look.unit} with {look.slow_tau_s:.0f} s{beside}"


def _odd_temperature(log):
    """What is wrong with the temperatures, or None."""
    if not log.has_temperature:
        return None
    lo, hi = np.nanmin(log.temp_degc), np.nanmax(log.temp_degc)
    if lo > _KELVIN_FROM:
        return f"temp_degc of {lo:.1f} to {hi:.1f}: are they in kelvin? temp_degc is in degrees Celsius"
    if lo < _COLDEST_DEGC or hi > _HOTTEST_DEGC:
        return f"temp_degc goes from {lo:.1f} to {hi:.1f} degC, where no sensor works: are temp_degc and an axis swapped?"
    return None


def _repetitions(look):
    """Sentences on an axis that does not move."""
    if look.is_constant:
        return [f"{look.axis} never changes: {look.rate[np.isfinite(look.rate)][0]:g} {look.unit} in every second: a dead sensor, or a wrong register or column"]
    if look.frozen_s:
        return [f"{look.axis} is frozen for {look.frozen_s} s from t_s = {look.t_s[look.frozen_from]:g} on: one value, while it moves elsewhere"]
    if look.repeats > _MOST_REPEATS:
        return [f"{look.axis} repeats itself: {100 * look.repeats:.1f} % of the seconds equal the one before: its steps are far coarser than its noise, or it is frozen"]
    return []


def _same_axes(looks):
    """Sentences on axes that are one record."""
    found = []
    for i, look in enumerate(looks):
        if not look.is_constant:
            found += [f"{look.axis} and {other.axis} are the same in every second: one register or column taken twice?" for other in looks[i + 1:]
                      if np.array_equal(look.rate, other.rate, equal_nan=True)]
    return found


def _suspicion_line(log, looks):
    odd = _odd_temperature(log)
    found = ([odd] if odd else []) + _same_axes(looks)
    for look in looks:
        found += _repetitions(look)
        if look.loop_share > LOOP_SHARE:
            found.append(f"{look.axis} a loop of {look.loop:.3g} {look.unit} rms: {100 * look.loop_share:.0f} % of the smoothed residual goes with "
                         "rising and falling (or slow noise that happens to: diagnose weighs them)")
        if abs(look.warm_up_z) > 3:
            found.append(f"{look.axis} a warm-up: the start is {look.warm_up:+.3g} {look.unit} off ({abs(look.warm_up_z):.1f} sigma)")
        if look.n_outliers:
            found.append(f"{look.axis} {many(look.n_outliers, 'outlier')} beyond 6 sigma")
    both = bool(np.any(looks[0].direction > 0) and np.any(looks[0].direction < 0))
    nothing = "no loop, no warm-up, no outliers stand out" if both else "no warm-up, no outliers stand out; a loop cannot be seen: the temperature goes one way only"
    return "suspected: " + ("; ".join(found) if found else nothing)


def _next_line(given, source, log, looks, imported):
    if _odd_temperature(log):
        return "next: put temp_degc right, then look again"
    moving = [look.axis for look in looks if not look.is_constant and not look.frozen_s]
    if not moving:
        return "next: find out why no axis changes throughout (sensor, register, column), and record again"
    axes = "" if len(moving) == len(log.axes) else "".join(f" --axis {axis}" for axis in moving)
    name = given.file
    if imported:
        name = source.stem + ".csv"
        first = f"imucal import {given.file}" + (f" --instance {imported.chosen}" if len(imported.sensors) > 1 else "") + f" -o {name}; "
    else:
        first = ""
    if not log.has_temperature or all(len(look.poly) == 1 for look in looks):
        return f"next: {first}imucal errormodel fit {name}{axes} --markov 1 --criterion ml -o model.json   (no thermal calibration: the temperature hardly moves)"
    if any(look.loop_share > LOOP_SHARE or abs(look.warm_up_z) > 3 for look in looks):
        return f"next: {first}imucal diagnose --log {name}{axes} ...   (names the effect; then imucal calibrate fit {name}{axes} --method poly --order {given.order} -o table.json)"
    return f"next: {first}imucal calibrate fit {name}{axes} --method poly --order {given.order} -o table.json"


def _gap_line(log, imported):
    steps = np.rint(np.diff(log.t_s))
    text = f"gaps: {int((steps > 1).sum())} of {int((steps[steps > 1] - 1).sum())} s in all"
    empty = int(np.isnan(np.stack(list(log.rates.values()), axis=1)).any(axis=1).sum())
    if empty:
        text += f", {empty} s without a rate"
    if imported:
        text += f"; moving: {imported.moving_seconds} s left out; {imported.n_duplicate} duplicate, {imported.n_backward} late samples"
    return text


def _lattice_line(log, looks):
    parts = [f"{look.axis} steps of {look.lattice:.3g} {look.unit}" for look in looks if look.lattice]
    temp = lattice_of(log.temp_degc) if log.has_temperature else 0.0
    if temp:
        parts.append(f"thermometer steps of {temp:.3g} degC")
    return "lattice: " + ("; ".join(parts) if parts else "none seen")


def text_lines(given, source, log, looks, imported):
    """The lines for people."""
    span = f"{np.nanmin(log.temp_degc):.2f} to {np.nanmax(log.temp_degc):.2f} degC" if log.has_temperature else "no temperature"
    sensor = f"{imported.format}, sensor {log.metadata.get('sensor', '')}" if imported else "imucal log"
    lines = [f"{source.name}: {sensor}: {np.ptp(log.t_s) + 1:.0f} s ({(np.ptp(log.t_s) + 1) / 60:.0f} min), {span}, {len(log.axes)} axes",
             _gap_line(log, imported), _lattice_line(log, looks)]
    for look in looks:
        fine = np.isfinite(look.residual)
        travel = np.ptp(look.rate[fine] - look.residual[fine]) if len(look.poly) > 1 else 0.0
        least = f"Allan minimum {look.allan.min():.3g} at {look.allan_tau_s[look.allan.argmin()]:.0f} s" if len(look.allan) else \
            "no Allan deviation: no seconds stand side by side"
        lines.append(f"{look.axis}: mean {np.nanmean(look.rate):.5g} {look.unit}, bias travel {travel:.4g} (order {len(look.poly) - 1}), smoothed residual rms "
                     f"{np.sqrt(np.nanmean(look.smooth ** 2)):.3g}, {least}")
    if any(look.unit == "mg" for look in looks):
        lines.append("accelerometer: the mean, and b0 of the polynomial, hold gravity as it lay: a static test cannot tell it from the bias")
    lines += [_noise_line(look) for look in looks if not look.is_constant]
    lines += [_suspicion_line(log, looks), _next_line(given, source, log, looks, imported)]
    return lines


def _result(lines, looks, log, imported):
    axes = [{"axis": k.axis, "unit": k.unit, "coeff": k.poly, "t0_degc": k.t0_degc, "range_degc": k.range_degc, "arw_deg_rt_h": k.arw_deg_rt_h if k.unit == "dph" else None,
             "white_1s": k.white, "instability": k.slow_sigma, "instability_tau_s": k.slow_tau_s, "likelihood": k.ml, "lattice": k.lattice,
             "n_outliers": k.n_outliers, "loop": k.loop, "loop_share": k.loop_share, "warm_up": k.warm_up, "warm_up_z": k.warm_up_z,
             "is_constant": k.is_constant, "frozen_s": k.frozen_s, "repeats": k.repeats,
             "allan": {"tau_s": k.allan_tau_s, "adev": k.allan}} for k in looks]
    return {"text": lines, "axes": axes, "seconds": len(log.t_s), "import": imported.to_json() if imported else None}


def run(arguments):
    """Run the command; returns the exit status.  A page is many small objects that live until it is drawn: the search for
    garbage among them takes a tenth of the time and finds none."""
    given = _parser().parse_args(arguments)
    was_on = gc.isenabled()
    gc.disable()
    try:
        with plain_file(given.file) as source:
            return _look(given, source)
    finally:
        if was_on:
            gc.enable()


def _look(given, source):
    output = given.output or source.stem + ".look.png"
    keep_input(given.file, output, given.json)
    matplotlib_is_there = ahead(load_renderer)  # takes as long as reading the log
    log, imported = _load(given, source)
    axes = _axes(log, given.axis)
    if len(log.t_s) < _FEWEST_S:
        raise DataError(f"{source.path}: {len(log.t_s)} s at rest are too short to look at; record at least some minutes (a calibration: an hour or more)")
    axes = _usable(source.path, log, axes)
    likelihood = Likelihood(source.path, log, [] if given.no_ml else axes, given.order, imported)
    try:
        looks = [look_at_axis(log, axis, given.order) for axis in axes]
        for look in looks:
            look.ml = likelihood.read(look.axis)
    finally:
        likelihood.close()
    lines = text_lines(given, source, log, looks, imported)
    matplotlib_is_there()
    save_page(look_page(log, looks), output, source.base, lines)
    if not given.quiet and given.json != "-":
        print("\n".join(lines + [f"page: {output}"]))
    for note in imported.notes if imported else ():
        print(f"imucal look: {source.base}: note: {note}", file=sys.stderr)
    finish_json(given.json, _result(lines, looks, log, imported))
    return 0
