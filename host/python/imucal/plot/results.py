# SPDX-License-Identifier: MIT
"""One figure for a result of any program: what it is, its members tell.

Every function takes a result (its --json, or a table) and returns a figure."""
import numpy as np

from ..direction import directions
from ..errors import DataError
from ..strict import N_TEMPERATURES
from ..table import gyro_names
from ..units import unit_of_axis
from . import subplots, tidy
from .calibration import draw_predicted
from .fields import Fields
from .marks import CURVE, INK, LIKELIHOOD, MUTED, draw_directions
from .prediction import NAMES
from .profiles import temperature_curve

_MEAN_S = 60  # of what is drawn of a log
_MARKERS = "o^svDx"
_KNOWN = "a table, or the --json of calibrate fit, dp, errormodel expect, fit or check, profile error or optimize"


def _polynomial(axis, temp_degc):
    tn = (np.asarray(temp_degc, float) - axis["t0_degc"]) / axis["range_degc"]
    return np.polynomial.polynomial.polyval(tn, axis["coeff_dph"])


def _minutes(log, axis):
    """(temperature, rate, direction) of one-minute means."""
    minute = ((log.t_s - log.t_s[0]) // _MEAN_S).astype(int)
    known = np.isfinite(log.rates[axis]) & np.isfinite(log.temp_degc)
    n = np.maximum(np.bincount(minute[known], minlength=minute[-1] + 1), 1)
    is_full = 2 * n >= _MEAN_S
    temp, rate = (np.bincount(minute[known], values[known], minute[-1] + 1) / n for values in (log.temp_degc, log.rates[axis]))
    t_s = _MEAN_S * np.arange(len(n))[is_full]
    return temp[is_full], rate[is_full], directions(t_s, temp[is_full])


def _axis_of_table(top, below, axis, logs, is_first):
    """Rate and polynomial above; what the polynomial leaves, and the error that was predicted of it, below."""
    unit = unit_of_axis(axis["axis"])
    temp_degc = np.array(axis.get("temp_degc") or np.linspace(*axis["span_degc"], N_TEMPERATURES), float)
    grid = np.linspace(temp_degc.min(), temp_degc.max(), 100)
    if axis.get("sigma_dph"):
        draw_predicted(below, temp_degc, axis["sigma_dph"])
        below.axhline(0, color=INK, lw=0.6)
    for log in logs:
        if axis["axis"] in log.rates and log.has_temperature:
            temp, rate, moves = _minutes(log, axis["axis"])
            draw_directions(top, temp, rate, moves, label=is_first and log is logs[0])
            draw_directions(below, temp, rate - _polynomial(axis, temp), moves)
    top.plot(grid, _polynomial(axis, grid), color=CURVE, lw=1.6, label="polynomial" if is_first else None)
    name = axis["axis"].rpartition("_")[0]
    tidy(top, "", f"{name}, {unit}", f"{axis['axis']}: polynomial of order {axis['order']}" + (", 1-min means" if logs else ""))
    tidy(below, "temperature, °C", f"{name} less polynomial, {unit}")


def table_figure(table, logs=()):
    """A calibration table, or the result of `calibrate fit`, with the logs that it was made of."""
    axes = [gyro_names(axis) for axis in table["axes"]]
    figure, grid = subplots(2, len(axes), size=(4.2 * len(axes) + 0.6, 6.4), squeeze=False, sharex="col", layout="constrained")
    for column, axis in enumerate(axes):
        _axis_of_table(grid[0][column], grid[1][column], axis, list(logs), column == 0)
    below = grid[1][0].get_legend_handles_labels()
    handles, labels = (list(a) + list(b) for a, b in zip(grid[0][0].get_legend_handles_labels(), below))
    figure.legend(handles, labels, loc="outside upper left", ncol=len(labels), frameon=False, fontsize=8)
    return figure


def curves_figure(result):
    """Curves of `dp` with their 95 % intervals."""
    figure, ax = subplots(size=(7.5, 4.8), layout="constrained")
    curves = result["curves"]
    for k, curve in enumerate(curves):
        tau, value = np.array(curve["tau_s"], float), np.array(curve["dp_dph"], float)
        line = ax.loglog(tau, value, f"{_MARKERS[k % len(_MARKERS)]}-", ms=3, lw=1, label=f"{curve['log']}, {curve['axis']}")[0]
        if curve.get("ci95_dph"):
            low, high = np.array([pair or [np.nan, np.nan] for pair in curve["ci95_dph"]], float).T
            ax.fill_between(tau, low, high, color=line.get_color(), alpha=0.15, lw=0)
    unit = curves[0].get("unit", "dph")
    tidy(ax, "averaging time, s" if curves[0]["type"] == "av" else "prediction time, s", f"{NAMES[curves[0]['type']]}, {unit}",
         f"{NAMES[curves[0]['type']]} with 95 % intervals")
    ax.legend(frameon=False, fontsize=8)
    return figure


def model_figure(result):
    """A curve of the data and that of a model (`errormodel fit`, `check`), or of the model alone (`expect`)."""
    has_data = result.get("data_dp_dph") is not None
    rows = 2 if has_data else 1
    figure, panels = subplots(rows, 1, size=(7.5, 2.6 + 1.8 * rows), squeeze=False, sharex=True, layout="constrained",
                              height_ratios=[2.2, 1][:rows])
    top, tau = panels[0][0], np.array(result["tau_s"], float)
    model = np.array(result["model_dp_dph"] if has_data else result["dp_dph"], float)
    if has_data:
        data = np.array(result["data_dp_dph"], float)
        top.loglog(tau, data, "o-", ms=2.5, lw=1, color=CURVE, label="data")
        panels[1][0].semilogx(tau, model / data, color=LIKELIHOOD, lw=1.4)
        panels[1][0].axhline(1, color=MUTED, lw=0.8)
        tidy(panels[1][0], "averaging time, s", "model / data")
    top.loglog(tau, model, color=LIKELIHOOD, lw=1.4, label="model")
    name = NAMES[result["type"]]
    tidy(top, "" if has_data else "averaging time, s", f"{name}, {result.get('unit', 'dph')}", name)
    top.legend(frameon=False, fontsize=8)
    return figure


def profile_figure(result):
    """Predicted calibration error of a profile with its bounds, below the profile itself where the result holds one."""
    has_profile, unit = result.get("profile") is not None, result.get("unit", "dph")
    rows = 2 if has_profile else 1
    figure, panels = subplots(rows, 1, size=(7.5, 1.8 + 2.6 * rows), squeeze=False, layout="constrained")
    ax = panels[-1][0]
    ax.plot(result["temp_degc"], result["sigma_dph"], color=CURVE, lw=1.6, label="this profile")
    ax.axhline(result["bound_dph"], color=MUTED, ls="--", lw=1,
               label=f"slow ramps: the worst error is at least {result['bound_dph']:.3g}")
    if result.get("proven_bound_dph"):
        ax.axhline(result["proven_bound_dph"], color=MUTED, ls=":", lw=1.2,
                   label=f"any profile: the worst error is at least {result['proven_bound_dph']:.3g}")
    ax.set_ylim(0, None)
    tidy(ax, "temperature, °C", f"predicted error, one sigma, {unit}",
         f"Calibration error of the profile, worst {result['worst_dph']:.3g} {unit}")
    ax.legend(frameon=False, fontsize=8)
    if has_profile:
        panels[0][0].plot(*temperature_curve(result["profile"]), color=CURVE, lw=1.6)
        tidy(panels[0][0], "time, min", "temperature, °C", "Profile")
    return figure


def _check_table(result):
    for axis in result.objects("axes"):
        unit = "mg" if "coeff_mg" in axis else "dph"
        axis.text("axis")
        for name in ("order", "t0_degc", "range_degc"):
            axis.number(name)
        axis.numbers(f"coeff_{unit}")
        n = axis.numbers("temp_degc") if "temp_degc" in axis else axis.numbers("span_degc", 2) and N_TEMPERATURES
        if f"sigma_{unit}" in axis:
            axis.numbers(f"sigma_{unit}", n)


def _check_curves(result):
    for curve in result.objects("curves"):
        curve.text("log")
        curve.text("axis")
        curve.text("type", NAMES)
        n = curve.numbers("tau_s")
        curve.numbers("dp_dph", n, gaps=True)
        if "ci95_dph" in curve:
            curve.pairs("ci95_dph", n)


def _check_model(result):
    result.text("type", NAMES)
    n = result.numbers("tau_s")
    for name in ("data_dp_dph", "model_dp_dph") if "data_dp_dph" in result else ("dp_dph",):
        result.numbers(name, n, gaps=True)


def _check_profile(result):
    result.numbers("sigma_dph", result.numbers("temp_degc"), gaps=True)
    result.number("bound_dph")
    result.number("worst_dph")
    if "proven_bound_dph" in result:
        result.number("proven_bound_dph")
    if "profile" not in result:
        return
    profile = result.inner("profile")
    profile.number("start_degc")
    profile.whole("repeat", default=1)
    for segment in profile.objects("segments"):
        segment.number("duration_s" if segment.number("rate_degc_per_min") == 0 else "to_degc")


def _first(result, name):
    """The first of a list of objects; an empty one where there is no such list."""
    values = result.get(name)
    return values[0] if isinstance(values, list) and values and isinstance(values[0], dict) else {}


def result_figure(result, name, logs=()):
    """The figure of a result; DataError where it is none that has a figure, or has a field that is none of a result."""
    if not isinstance(result, dict):
        raise DataError(f"{name}: no result of a program; expected {_KNOWN}")
    axis = _first(result, "axes")
    if "coeff_dph" in axis or "coeff_mg" in axis:
        _check_table(Fields(name, result))
        return table_figure(result, logs)
    if "verdict" in axis:
        raise DataError(f"{name}: a diagnosis has a page of its own: imucal report {name} -o report.html")
    if "dp_dph" in _first(result, "curves"):
        _check_curves(Fields(name, result))
        return curves_figure(result)
    if "tau_s" in result and ("dp_dph" in result or "data_dp_dph" in result):
        _check_model(Fields(name, result))
        return model_figure(result)
    if "sigma_dph" in result and "bound_dph" in result:
        _check_profile(Fields(name, result))
        return profile_figure(result)
    raise DataError(f"{name}: there is no figure of this; expected {_KNOWN}")
