# SPDX-License-Identifier: MIT
"""``imucal look``: one page and ten lines about a log of any format, raw first."""
import gc
import sys
import warnings

import numpy as np

from . import look_words
from .ahead import ahead
from .cli import common_options, finish_json, parser_of
from .diagnosis_words import many
from .direction import directions
from .errors import DataError, DataWarning, UsageError
from .firstlook import look_at_axis
from .importers import Options, check_options, detect, import_log
from .inputs import plain_file
from .log import keep_input, need_one_a_second, read_log
from .look_programs import Asked
from .plot import look_page, save_page
from .plot.loading import load_renderer


_FEWEST_S = 100
_MOST_AXES = 6
_PAGES = (".png", ".html", ".htm")
_NO_RATE = 1 | 4  # flags: saturated, sensor fault


def _parser():
    parser = parser_of("look", "The first thing to do with a log: one page (PNG, or HTML with the text) and ten lines.")
    parser.add_argument("file", metavar="FILE", help="a log of any format imucal import knows")
    parser.add_argument("-o", "--output", metavar="PAGE.png|PAGE.html", help="page to write (default: FILE's name with .look.png, in this folder)")
    parser.add_argument("--order", type=int, default=3, choices=range(0, 6), metavar="N", help="of the polynomial (default 3)")
    parser.add_argument("--axis", action="append", metavar="NAME", help="axis, repeatable; default: all; six are the most")
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
    axes = list(dict.fromkeys(wanted or log.axes))
    if beyond := axes[_MOST_AXES:]:
        warnings.warn(f"{log.path}: a page has room for six axes: {', '.join(beyond)} left out; choose with --axis", DataWarning,
                      stacklevel=2)
    return axes[:_MOST_AXES]


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


def text_lines(given, source, log, looks, imported, refused_by_fit):
    """The lines for people."""
    name, importing = given.file, ""
    if imported:
        name = source.stem + ".csv"
        instance = f" --instance {imported.chosen}" if len(imported.sensors) > 1 else ""
        importing = f"imucal import {given.file}{instance} -o {name}; "
    moving = [look for look in looks if not look.is_constant]
    lines = [look_words.head_line(source.name, log, imported), look_words.gap_line(log, imported),
             look_words.steps_line(log, looks)]
    lines += [look_words.axis_line(look) for look in looks]
    if any(look.unit == "mg" for look in looks):
        lines.append("accelerometer: the mean, and b0 of the polynomial, hold gravity as it lay: a static test cannot tell it from the bias")
    lines += [look_words.noise_line(look) for look in moving]
    return lines + look_words.suspicion_lines(log, looks) + [look_words.next_line(log, looks, name, importing, refused_by_fit)]


def _result(lines, looks, log, imported):
    axes = [{"axis": k.axis, "unit": k.unit, "coeff": k.poly, "t0_degc": k.t0_degc, "range_degc": k.range_degc, "arw_deg_rt_h": k.arw_deg_rt_h if k.unit == "dph" else None,
             "white_1s": k.white, "instability": k.slow_sigma, "instability_tau_s": k.slow_tau_s, "likelihood": k.ml, "lattice": k.lattice,
             "n_outliers": len(k.outlier_rows), "clipped_share": k.clipped_share,
             "jumps": [{"t_s": t_s, "size": size} for t_s, size in k.jumps],
             "loop": k.loop, "loop_share": k.loop_share, "has_loop": k.has_loop,
             "warm_up": k.warm_up, "warm_up_z": k.warm_up_z, "has_warm_up": k.has_warm_up,
             "is_constant": k.is_constant, "frozen_s": k.frozen_s, "repeats": k.repeats,
             "allan": {"tau_s": k.allan_tau_s, "adev": k.allan, "ci95": k.allan_ci95, "expected": k.expected,
                       "minimum": k.allan_minimum}} for k in looks]
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
    if not output.lower().endswith(_PAGES):
        raise UsageError(f"-o {output}: expected a name that ends in {', '.join(_PAGES)}")
    keep_input(given.file, output, given.json)
    matplotlib_is_there = ahead(load_renderer)  # takes as long as reading the log
    log, imported = _load(given, source)
    axes = _axes(log, given.axis)
    if len(log.t_s) < _FEWEST_S:
        raise DataError(f"{source.path}: {len(log.t_s)} s at rest are too short to look at; record at least some minutes (a calibration: an hour or more)")
    axes = _usable(source.path, log, axes)
    moves = directions(log.t_s, log.temp_degc)
    looks = [look_at_axis(log, axis, given.order, moves) for axis in axes]
    asked = Asked(source.path, log, looks, bool(imported), not given.no_ml, look_words.calibration(log, looks))
    try:
        for look in looks:
            look.ml = asked.likelihood(look)
            look.expected = asked.expected_allan(look)
        matplotlib_is_there()
        picture = look_page(log, looks, source.base).png()  # while the calibration is tried
        lines = text_lines(given, source, log, looks, imported, asked.refused)
    finally:
        asked.close()
    save_page(picture, output, source.base, lines)
    if not given.quiet and given.json != "-":
        print("\n".join(lines + [f"page: {output}"]))
    for note in imported.notes if imported else ():
        print(f"imucal look: {source.base}: note: {note}", file=sys.stderr)
    finish_json(given.json, _result(lines, looks, log, imported))
    return 0
