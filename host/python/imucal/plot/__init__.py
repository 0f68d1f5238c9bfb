# SPDX-License-Identifier: MIT
"""Plots of logs, curves and calibrations (matplotlib without pyplot: no window system, little to load).

Here stand the first look at a log and what all share; `calibration`, `diagnosis`, `prediction` (Direct Predictor curves) and
`profiles` draw the results of the programs, from their JSON."""
import base64
import html
import importlib
import io
import os
import sys
import types

import numpy as np

from ..errors import DataError

INK, MUTED, GRID = "#1d2733", "#66727f", "#dfe4ea"
RISING, FALLING, SOAK, LINE = "#c8502d", "#2b6cb0", "#7a8794", "#1d3557"
_MAX_POINTS = 1500


def load():
    """Load matplotlib; the first figure does, who likes may before.

    Its parts come without its three-dimensional axes and without the text of every artist's set(): that text alone is a third of
    the time of the import.  Who has matplotlib loaded already keeps his own."""
    if "matplotlib.figure" in sys.modules:
        return
    import matplotlib.artist
    words, matplotlib.artist.kwdoc = matplotlib.artist.kwdoc, lambda artist: ""
    empty = types.ModuleType("mpl_toolkits.mplot3d")
    empty.Axes3D = None  # how matplotlib itself says that there are none
    no_3d = sys.modules.setdefault("mpl_toolkits.mplot3d", empty) is empty
    try:
        importlib.import_module("matplotlib.figure")
        importlib.import_module("matplotlib.backends.backend_agg")
    finally:
        matplotlib.artist.kwdoc = words
        if no_3d:
            del sys.modules["mpl_toolkits.mplot3d"]


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


def _tick_texts(axis):
    """(places inside the view, their texts, what all are multiplied by or counted from)."""
    low, high = sorted(axis.get_view_interval())
    places = [p for p in axis.get_major_locator().tick_values(low, high) if low <= p <= high]
    formatter = axis.get_major_formatter()
    return places, formatter.format_ticks(places), formatter.get_offset()


def _light_axis(ax, axis, is_x):
    places, texts, offset = _tick_texts(axis)
    colour = axis.majorTicks[0].label1.get_color()
    across = ax.get_xaxis_transform() if is_x else ax.get_yaxis_transform()
    on_right = axis.get_label_position() == "right"
    box = ax.get_position()
    size_pt = 72 * (ax.figure.get_figheight() * box.height if is_x else ax.figure.get_figwidth() * box.width)
    edge, sign = (1, 1) if on_right else (0, -1)

    def at(place, pt):
        return (place, edge + sign * pt / size_pt) if is_x else (edge + sign * pt / size_pt, place)
    if not on_right:
        lines = np.array([(at(p, 0), at(p, -size_pt), (np.nan, np.nan)) for p in places]).reshape(-1, 2)
        ax.plot(*lines.T, color=GRID, lw=0.6, transform=across, zorder=0.5, scalex=False, scaley=False)
    ax.plot(*np.array([at(p, 1.5) for p in places]).reshape(-1, 2).T, ls="", marker=2 if is_x else 1 if on_right else 0, ms=3, mew=0.8, color=colour,
            transform=across, clip_on=False, scalex=False, scaley=False)
    sides = {"ha": "center", "va": "top"} if is_x else {"ha": "left" if on_right else "right", "va": "center_baseline"}
    for place, text in zip(places, texts):
        ax.text(*at(place, 5), text, transform=across, fontsize=7, color=colour, **sides)
    label = axis.label.get_text() + (f" ({offset})" if offset else "")
    beyond = 15 if is_x else 9 + 4.6 * max(map(len, texts), default=0)
    ax.text(*at(0.5, beyond), label, transform=ax.transAxes, fontsize=8, color=axis.label.get_color(), rotation=0 if is_x else 90,
            ha="center" if is_x else "left" if on_right else "right", va="top" if is_x else "center")
    axis.set_visible(False)


def light_axes(figure):
    """Grid, ticks and labels of all axes as few plain artists: matplotlib's own make more objects than all data, and more than
    half of the time of drawing a page.  To be called when the limits are final."""
    for ax in figure.axes:
        if ax.get_shared_x_axes().get_siblings(ax)[0] is ax or ax.yaxis.get_label_position() != "right":
            _light_axis(ax, ax.xaxis, True)
        _light_axis(ax, ax.yaxis, False)


def _thinned(n):
    return slice(None, None, max(1, n // _MAX_POINTS))


def rate_against_time(ax, log, axis, unit="dph"):
    """Rate (left) and temperature (right) against time."""
    every = _thinned(len(log.t_s))
    hours = (log.t_s - log.t_s[0])[every] / 60
    ax.plot(hours, log.rates[axis][every], ".", ms=1.2, color=MUTED)
    tidy(ax, "time, min", f"{axis.rpartition('_')[0]}, {unit}", f"{axis}: raw")
    if log.has_temperature:
        other = ax.twinx()
        other.plot(hours, log.temp_degc[every], color=RISING, lw=1)
        other.tick_params(labelsize=7, colors=RISING)
        other.set_ylabel("degC", fontsize=8, color=RISING)


def _by_direction(ax, x, y, direction, size=2.0):
    for value, colour in ((0, SOAK), (1, RISING), (-1, FALLING)):
        these = direction == value
        ax.plot(x[these], y[these], ".", ms=size, color=colour)


def rate_against_temperature(ax, look):
    """Rate against temperature, rising red, falling blue, with the polynomial; smoothed over half a minute."""
    every = _thinned(len(look.t_s))
    _by_direction(ax, look.temp_degc[every], look.rate[every], look.direction[every], 1.5)
    if len(look.poly) > 1:
        tn = np.linspace(-1, 1, 100)
        ax.plot(look.t0_degc + look.range_degc * tn, np.polynomial.polynomial.polyval(tn, look.poly), color=LINE, lw=1.3)
    tidy(ax, "temperature, degC", look.unit, f"order {len(look.poly) - 1}; red rising, blue falling")


def residual_plot(ax, look, against_time):
    """The smoothed residual."""
    every = _thinned(len(look.t_s))
    if against_time:
        ax.plot((look.t_s - look.t_s[0])[every] / 60, look.smooth[every], color=LINE, lw=0.9)
    else:
        _by_direction(ax, look.temp_degc[every], look.smooth[every], look.direction[every])
    ax.axhline(0, color=INK, lw=0.5)
    tidy(ax, "time, min" if against_time else "temperature, degC", look.unit, "residual, 61-s mean")


def allan_plot(ax, tau_s, adev, unit="dph", label=None, white=None):
    """Allan deviation, and the line of the white noise that was read off."""
    ax.loglog(tau_s, adev, "o-", ms=2.5, lw=1, color=LINE, label=label)
    if white:
        ax.loglog(tau_s, white / np.sqrt(tau_s), "--", lw=0.8, color=MUTED)
    tidy(ax, "tau, s", unit, "Allan deviation of the residual")


def look_page(log, looks):
    """The page of `imucal look`: a row per axis."""
    has_temp = log.has_temperature
    figure = new_figure(17 if has_temp else 11, 2.7 * len(looks))
    columns = 5 if has_temp else 3
    figure.subplots_adjust(left=0.045, right=0.985, bottom=0.16 / len(looks) ** 0.8, top=1 - 0.1 / len(looks), wspace=0.45, hspace=0.5)
    for row, look in enumerate(looks):
        places = [figure.add_subplot(len(looks), columns, row * columns + i + 1) for i in range(columns)]
        rate_against_time(places[0], log, look.axis, look.unit)
        if has_temp:
            rate_against_temperature(places[1], look)
            residual_plot(places[2], look, False)
        residual_plot(places[-2], look, True)
        allan_plot(places[-1], look.allan_tau_s, look.allan, look.unit, white=look.white)
    figure.allan_places = [ax for ax in figure.axes if ax.get_title(loc="left").startswith("Allan")]
    return figure


def add_likelihood(figure, looks):
    """The Allan deviation the maximum-likelihood noise expects, over the measured one."""
    from ..export.noise import Noise
    for ax, look in zip(figure.allan_places, looks):
        if look.ml.get("arw_deg_rt_h") is None:
            continue
        markov = [(look.ml["sigma_dph"], look.ml["tau_s"])] if look.ml.get("sigma_dph") else []
        ax.loglog(look.allan_tau_s, Noise(look.ml["arw_deg_rt_h"], markov, 0, None, [], "").allan_dph(look.allan_tau_s), color=RISING, lw=1)


def save_page(figure, path, title, lines):
    """PNG, or one HTML file with the picture and the text."""
    folder = os.path.dirname(path) or "."
    if not os.path.isdir(folder):
        raise DataError(f"{path}: there is no folder {folder}")
    picture = io.BytesIO()
    figure.savefig(picture, format="png", pil_kwargs={"compress_level": 1})
    data = picture.getvalue()
    if path.endswith((".html", ".htm")):
        text = "\n".join(html.escape(line) for line in lines)
        data = (f"<!doctype html><meta charset=utf-8><title>{html.escape(title)}</title><style>body{{font:14px/1.5 sans-serif;color:{INK};margin:2em}}"
                f"pre{{white-space:pre-wrap}}img{{max-width:100%}}</style><h1>{html.escape(title)}</h1><pre>{text}</pre>"
                f"<img alt='plots of {html.escape(title)}' src='data:image/png;base64,{base64.b64encode(data).decode()}'>\n").encode()
    temporary = f"{path}.tmp{os.getpid()}"
    try:
        with open(temporary, "wb") as file:
            file.write(data)
        os.replace(temporary, path)
    except OSError as error:
        raise DataError(f"{path}: cannot write: {error.strerror}") from None


def calibration_figure(report):
    """A calibration before and after, against temperature (imucal.plot.calibration says what a report holds)."""
    from .calibration import calibration_figure as draw
    return draw(report)
