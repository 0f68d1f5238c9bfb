# SPDX-License-Identifier: MIT
"""Plots of logs, curves and calibrations (matplotlib without pyplot: no window system, little to load).

Here stand the first look at a log and what all share; `calibration`, `diagnosis`, `prediction` (Direct Predictor curves) and
`profiles` draw the results of the programs, from their JSON."""
import base64
import html

import numpy as np

from ..log import write_bytes
from .loading import load
from .marks import CURVE, DIRECTIONS, GRID, INK, LIKELIHOOD, MUTED, TEMPERATURE, WARNING, draw_directions
from .page import Page, Panel, log_locator

_MAX_POINTS = 1500
_GAP_S = 30           # a longer gap cuts a line
_FLAT = 2.0           # a scale that has to grow by more than this for values that are no measurement leaves them out
_ROW_IN, _HEAD_IN = 2.7, 0.6


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
    for scale, axis, limits in ((ax.get_xscale(), ax.xaxis, ax.get_xlim()), (ax.get_yscale(), ax.yaxis, ax.get_ylim())):
        if scale == "log":  # plain numbers: mathematical type setting takes a third of the page's time
            axis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_major_locator(log_locator(*limits))
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
    """Places of the dots to draw: every n-th value, one beside it where it is missing, and the 100 values that lie farthest from
    their neighbours.  So no lone value is lost."""
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


def _cut(t_s, rows, *values):
    """Values at these rows with a NaN where more than _GAP_S are missing: no line is drawn through a gap."""
    longer = np.concatenate([[0], np.cumsum(np.diff(t_s) > _GAP_S)])[rows]
    cuts = np.flatnonzero(np.diff(longer)) + 1
    return [np.insert(value[rows].astype(float), cuts, np.nan) for value in values]


def _scaled(ax, x, y, used):
    """Limits that follow the measurements where others would flatten them: what lies beyond is an arrow at the edge."""
    low, high = np.nanmin(used), np.nanmax(used)
    beyond = (y < low) | (y > high)
    if not high > low or not beyond.any() or np.nanmax(y) - np.nanmin(y) < _FLAT * (high - low):
        return
    margin = 0.2 * (high - low)
    ax.set_ylim(low - margin, high + margin)
    for side, marker, edge, farthest in ((1, "^", high + 0.8 * margin, np.nanmax), (-1, "v", low - 0.8 * margin, np.nanmin)):
        these = np.flatnonzero(y > high + margin if side > 0 else y < low - margin)
        if len(these):
            ax.plot(x[these], np.full(len(these), edge), marker=marker, ls="none", color=WARNING, ms=4, mew=0)
            words = f"{farthest(y[these]):.0f}"
            words = f"{words} at {x[these[0]]:.0f} min" if len(these) == 1 else f"{len(these)} values, to {words}"
            ax.text(x[0], edge - side * 0.4 * margin, words, color=WARNING, fontsize=7, ha="left",
                    va="top" if side > 0 else "bottom")


def _name(axis):
    return axis.rpartition("_")[0]


def rate_against_time(ax, log, look):
    """Rate (left) and temperature (right) against time."""
    shown, minutes = _shown(look.rate), (log.t_s - log.t_s[0]) / 60
    ax.plot(minutes[shown], look.rate[shown], ".", ms=1.6, color=MUTED)
    left_out = np.flatnonzero(np.isfinite(look.rate) & np.isnan(look.used))
    if len(left_out) and not look.is_constant:
        left_out = left_out[_shown(look.rate[left_out])]
        ax.plot(minutes[left_out], look.rate[left_out], ".", ms=3, color=WARNING)
    title = f"{look.axis}: raw"
    if look.is_constant:
        value = look.rate[np.isfinite(look.rate)][0]
        ax.set_ylim(value - max(1, 0.01 * abs(value)), value + max(1, 0.01 * abs(value)))
        title = f"{look.axis}: constant, {value:g} {look.unit} in every second"
    else:
        _scaled(ax, minutes, look.rate, look.used)
    tidy(ax, "time, min", f"{_name(look.axis)}, {look.unit}", title)
    if log.has_temperature:
        _beside(ax, *_cut(log.t_s, _every(len(minutes)), minutes, log.temp_degc), "temperature, °C", TEMPERATURE)


def rate_against_temperature(ax, look):
    """Rate against temperature, each direction with its mark, and the polynomial."""
    rows = np.flatnonzero(np.isfinite(look.used))
    rows = rows[_shown(look.used[rows])]
    draw_directions(ax, look.temp_degc[rows], look.used[rows], look.direction[rows], 2.4)
    if look.order:
        tn = np.linspace(-1, 1, 100)
        ax.plot(look.t0_degc + look.range_degc * tn, np.polynomial.polynomial.polyval(tn, look.poly), color=CURVE, lw=1.6)
    title = f"{look.axis}: polynomial of order {look.order}" if look.order else f"{look.axis}: no polynomial"
    tidy(ax, "temperature, °C", f"{_name(look.axis)}, {look.unit}", title)


def residual_plot(ax, look, against_time):
    """The smoothed residual."""
    every = _every(len(look.t_s))
    if against_time:
        ax.plot(*_cut(look.t_s, every, (look.t_s - look.t_s[0]) / 60, look.smooth), color=CURVE, lw=0.9)
    else:
        draw_directions(ax, look.temp_degc[every], look.smooth[every], look.direction[every])
    ax.axhline(0, color=INK, lw=0.5)
    tidy(ax, "time, min" if against_time else "temperature, °C", f"{_name(look.axis)} residual, {look.unit}",
         f"{look.axis}: less polynomial, 61-s means" if look.order else f"{look.axis}: less mean, 61-s means")


def allan_plot(ax, tau_s, adev, unit="dph", name="", ci95=None, white=None, expected=None):
    """Allan deviation with its 95 % interval.  white: the noise that was read off, drawn as a line.  expected: the curve that the
    most likely noise would give in such a log, at the same tau_s."""
    if ci95 is not None and len(tau_s) > 1:
        ax.fill_between(tau_s, ci95[:, 0], ci95[:, 1], color=CURVE, alpha=0.15, lw=0)
    ax.loglog(tau_s, adev, "o-", ms=2.5, lw=1, color=CURVE)
    if white:
        ax.loglog(tau_s, white / np.sqrt(tau_s), "--", lw=0.8, color=MUTED)
    if expected is not None:
        ax.loglog(tau_s, expected, color=LIKELIHOOD, lw=1.2)
    tidy(ax, "averaging time, s", f"{name} Allan dev., {unit}".strip(),
         f"{name}: Allan deviation of the residual" if name else "Allan deviation")


def draw_row(panels, log, look):
    """One axis of a log in five panels (or matplotlib's axes); three where it has no temperature, one where it never changes."""
    rate_against_time(panels[0], log, look)
    if look.is_constant:
        return
    if log.has_temperature:
        rate_against_temperature(panels[1], look)
        residual_plot(panels[2], look, False)
    residual_plot(panels[-2], look, True)
    allan_plot(panels[-1], look.allan_tau_s, look.allan, look.unit, _name(look.axis), look.allan_ci95, look.white, look.expected)


def _legend(log, looks):
    """(word, how it is drawn) of what the page shows."""
    found = [("measured second", {"style": ".", "ms": 4, "color": MUTED})]
    if any(np.isnan(look.used[np.isfinite(look.rate)]).any() for look in looks):
        found.append(("left out", {"style": ".", "ms": 6, "color": WARNING}))
    if log.has_temperature:
        found.append(("temperature", {"style": "-", "color": TEMPERATURE}))
        found += [(mark.word, mark.style(5)) for mark in (DIRECTIONS[k] for k in (1, -1, 0))]
        found.append(("polynomial", {"style": "-", "lw": 1.6, "color": CURVE}))
    found.append(("Allan deviation, 95 % interval", {"style": "o-", "ms": 4, "color": CURVE}))
    found.append(("white noise alone", {"style": "--", "lw": 0.8, "color": MUTED}))
    if any(look.expected is not None for look in looks):
        found.append(("expected of the likely noise", {"style": "-", "lw": 1.2, "color": LIKELIHOOD}))
    return [(word, {k: v for k, v in how.items() if k != "mew"}) for word, how in found]


def look_page(log, looks, name=""):
    """The Page of `imucal look`: title and legend, and a row per axis."""
    columns = 5 if log.has_temperature else 3
    width_in = 17 if log.has_temperature else 11
    rows, height_in = len(looks), _ROW_IN * len(looks) + _HEAD_IN
    page = Page(width_in, height_in)
    seconds = np.ptp(log.t_s) + 1
    page.title = ", ".join(filter(None, [name, log.metadata.get("device", ""), log.metadata.get("date", ""),
                                         f"{seconds / 60:.0f} min ({seconds:.0f} s)"]))
    page.legend = _legend(log, looks)
    for row, look in enumerate(looks):
        boxes = [_place(width_in, height_in, row, rows, column, columns) for column in range(columns)]
        draw_row([page.panel(*box) for box in (boxes[:1] if look.is_constant else boxes)], log, look)
    return page


def _place(width_in, height_in, row, rows, column, columns):
    """(left, bottom, right, top) as parts of the page.  Room for words: 0.8 inch on the left; beside each panel half of its width, half of
    its height; title and legend above."""
    first, last, below = 0.8 / width_in, 0.985, 1 - _HEAD_IN / height_in
    wide, high = (last - first) / (columns + 0.5 * (columns - 1)), (1 - 0.1 / rows - 0.16 / rows ** 0.8) / (rows + 0.5 * (rows - 1))
    left, top = first + 1.5 * wide * column, 1 - 0.1 / rows - 1.5 * high * row
    return left, (top - high) * below, left + wide, top * below


def save_page(picture, path, title, lines):
    """The bytes of a PNG file as they are, or one HTML file with the picture and the text."""
    data = picture
    if path.lower().endswith((".html", ".htm")):
        text = "\n".join(html.escape(line) for line in lines)
        data = (f"<!doctype html><meta charset=utf-8><title>{html.escape(title)}</title><style>body{{font:14px/1.5 sans-serif;color:{INK};margin:2em}}"
                f"pre{{white-space:pre-wrap}}img{{max-width:100%}}</style><h1>{html.escape(title)}</h1>"
                f"<img alt='plots of {html.escape(title)}' src='data:image/png;base64,{base64.b64encode(picture).decode()}'>"
                f"<pre>{text}</pre>\n").encode()
    write_bytes(path, data)


def calibration_figure(report):
    """A calibration before and after, against temperature (imucal.plot.calibration says what a report holds)."""
    from .calibration import calibration_figure as draw
    return draw(report)
