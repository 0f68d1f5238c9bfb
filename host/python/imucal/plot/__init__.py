# SPDX-License-Identifier: MIT
"""Plots of logs, curves and calibrations (matplotlib without pyplot: no window system, little to load).

Here stand the first look at a log and what all share; `calibration`, `diagnosis`, `prediction` (Direct Predictor curves) and
`profiles` draw the results of the programs, from their JSON."""
import base64
import html
import os

import numpy as np

from ..errors import DataError
from ..log import write_bytes
from .loading import load
from .page import GRID, INK, Page, Panel

MUTED = "#66727f"
RISING, FALLING, SOAK, LINE = "#c8502d", "#2b6cb0", "#7a8794", "#1d3557"
_MAX_POINTS = 1500


def new_figure(width_in, height_in, dpi=80):
    """A figure that draws without a screen."""
    load()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    figure = Figure(figsize=(width_in, height_in), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def subplots(rows=1, columns=1, *, size=None, layout=None, dpi=None, **axes):
    """(figure, axes) as pyplot's subplots gives them, without pyplot; size in inches."""
    load()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    figure = Figure(figsize=size, layout=layout, dpi=dpi)
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, **axes)


def tidy(ax, x, y, title=None):
    """Labels and a light grid."""
    if isinstance(ax, Panel):
        ax.name(x, y, title)
        return
    ax.set_xlabel(x, fontsize=8, color=INK)
    ax.set_ylabel(y, fontsize=8, color=INK)
    ax.tick_params(labelsize=7, colors=INK)
    ax.grid(True, color=GRID, lw=0.6)
    ax.set_axisbelow(True)
    ax.minorticks_off()
    for scale, axis in ((ax.get_xscale(), ax.xaxis), (ax.get_yscale(), ax.yaxis)):
        if scale == "log":  # plain numbers: mathematical type setting takes a third of the page's time
            axis.set_major_formatter(lambda value, _: f"{value:g}")
    ax.locator_params(nbins=5) if ax.get_xscale() == "linear" else None
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    if title:
        ax.set_title(title, fontsize=9, color=INK, loc="left", y=1.0)  # a place that is given need not be searched


def _beside(ax, x, y, label, color):
    """A curve with its own scale on the right."""
    other = ax.twinx()
    other.plot(x, y, color=color, lw=1)
    if isinstance(other, Panel):
        other.name(None, label, color=color)
        return
    other.tick_params(labelsize=7, colors=color)
    other.set_ylabel(label, fontsize=8, color=color)


def _every(n):
    """Places of every n-th value: what is smooth needs no more."""
    return np.arange(0, n, max(1, n // _MAX_POINTS))


def _shown(values):
    """Places of the dots to draw: every n-th, and the 100 that lie farthest from their neighbours, and one of those where the n-th
    is missing: no lone value is lost."""
    step = max(1, len(values) // _MAX_POINTS)
    every = _every(len(values))
    if step == 1:
        return every
    blocks = np.concatenate([values, np.full(-len(values) % step, np.nan)]).reshape(-1, step)
    there = np.isfinite(blocks)
    off = np.abs(blocks - np.nanmedian(np.where(there.any(axis=1, keepdims=True), blocks, 0.0), axis=1, keepdims=True))
    hidden = np.flatnonzero(~there[:, 0] & there.any(axis=1))  # the n-th is missing, another is there
    shown = np.concatenate([every, np.argsort(-np.nan_to_num(off).ravel())[:100], hidden * step + there[hidden].argmax(axis=1)])
    return np.unique(shown[shown < len(values)])


def rate_against_time(ax, log, axis, unit="dph"):
    """Rate (left) and temperature (right) against time."""
    shown = _shown(log.rates[axis])
    minutes = (log.t_s - log.t_s[0]) / 60
    ax.plot(minutes[shown], log.rates[axis][shown], ".", ms=1.2, color=MUTED)
    tidy(ax, "time, min", f"{axis.rpartition('_')[0]}, {unit}", f"{axis}: raw")
    if log.has_temperature:
        every = _every(len(minutes))
        _beside(ax, minutes[every], log.temp_degc[every], "degC", RISING)


def _by_direction(ax, x, y, direction, size=2.0):
    for value, colour in ((0, SOAK), (1, RISING), (-1, FALLING)):
        these = direction == value
        ax.plot(x[these], y[these], ".", ms=size, color=colour)


def rate_against_temperature(ax, look):
    """Rate against temperature, rising red, falling blue, with the polynomial; smoothed over half a minute."""
    shown = _shown(look.rate)
    _by_direction(ax, look.temp_degc[shown], look.rate[shown], look.direction[shown], 1.5)
    if len(look.poly) > 1:
        tn = np.linspace(-1, 1, 100)
        ax.plot(look.t0_degc + look.range_degc * tn, np.polynomial.polynomial.polyval(tn, look.poly), color=LINE, lw=1.3)
    tidy(ax, "temperature, degC", look.unit, f"order {len(look.poly) - 1}; red rising, blue falling")


def residual_plot(ax, look, against_time):
    """The smoothed residual."""
    every = _every(len(look.t_s))
    if against_time:
        ax.plot((look.t_s - look.t_s[0])[every] / 60, look.smooth[every], color=LINE, lw=0.9)
    else:
        _by_direction(ax, look.temp_degc[every], look.smooth[every], look.direction[every])
    ax.axhline(0, color=INK, lw=0.5)
    tidy(ax, "time, min" if against_time else "temperature, degC", look.unit, "residual, 61-s mean")


def allan_plot(ax, tau_s, adev, unit="dph", label=None, white=None, expected=None):
    """Allan deviation; the line of the white noise that was read off; and what a model expects at the same tau_s."""
    ax.loglog(tau_s, adev, "o-", ms=2.5, lw=1, color=LINE, label=label)
    if white:
        ax.loglog(tau_s, white / np.sqrt(tau_s), "--", lw=0.8, color=MUTED)
    if expected is not None:
        ax.loglog(tau_s, expected, color=RISING, lw=1)
    tidy(ax, "tau, s", unit, "Allan deviation of the residual")


def likely_allan(look):
    """The Allan deviation that the maximum-likelihood noise of a look expects; None where there is none."""
    if look.ml.get("arw_deg_rt_h") is None:
        return None
    from ..export.noise import Noise
    markov = [(look.ml["sigma_dph"], look.ml["tau_s"])] if look.ml.get("sigma_dph") else []
    return Noise(look.ml["arw_deg_rt_h"], markov, 0, None, [], "").allan_dph(look.allan_tau_s)


def draw_row(panels, log, look):
    """One axis of a log in five panels (or matplotlib's axes); in three where it has no temperature."""
    rate_against_time(panels[0], log, look.axis, look.unit)
    if log.has_temperature:
        rate_against_temperature(panels[1], look)
        residual_plot(panels[2], look, False)
    residual_plot(panels[-2], look, True)
    allan_plot(panels[-1], look.allan_tau_s, look.allan, look.unit, white=look.white, expected=likely_allan(look))


def look_page(log, looks):
    """The Page of `imucal look`: a row per axis."""
    columns = 5 if log.has_temperature else 3
    width_in = 17 if log.has_temperature else 11
    page = Page(width_in, 2.7 * len(looks))
    for row, look in enumerate(looks):
        draw_row([page.panel(*_place(width_in, row, len(looks), column, columns)) for column in range(columns)], log, look)
    return page


def _place(width_in, row, rows, column, columns):
    """(left, bottom, right, top) as parts of the page.  Room for words: 0.8 inch on the left; beside each panel half of its width, half of
    its height."""
    first, last = 0.8 / width_in, 0.985
    wide, high = (last - first) / (columns + 0.5 * (columns - 1)), (1 - 0.1 / rows - 0.16 / rows ** 0.8) / (rows + 0.5 * (rows - 1))
    left, top = first + 1.5 * wide * column, 1 - 0.1 / rows - 1.5 * high * row
    return left, top - high, left + wide, top


def save_page(page, path, title, lines):
    """PNG, or one HTML file with the picture and the text."""
    folder = os.path.dirname(path) or "."
    if not os.path.isdir(folder):
        raise DataError(f"{path}: there is no folder {folder}")
    data = page.png()
    if path.endswith((".html", ".htm")):
        text = "\n".join(html.escape(line) for line in lines)
        data = (f"<!doctype html><meta charset=utf-8><title>{html.escape(title)}</title><style>body{{font:14px/1.5 sans-serif;color:{INK};margin:2em}}"
                f"pre{{white-space:pre-wrap}}img{{max-width:100%}}</style><h1>{html.escape(title)}</h1><pre>{text}</pre>"
                f"<img alt='plots of {html.escape(title)}' src='data:image/png;base64,{base64.b64encode(data).decode()}'>\n").encode()
    write_bytes(path, data)


def calibration_figure(report):
    """A calibration before and after, against temperature (imucal.plot.calibration says what a report holds)."""
    from .calibration import calibration_figure as draw
    return draw(report)
