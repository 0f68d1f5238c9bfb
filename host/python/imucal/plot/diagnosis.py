# SPDX-License-Identifier: MIT
"""Figures of a diagnosis, as inline SVG: what was made of the record (`imucal.plot.record` draws the record itself).

Every function takes members of `plots` of one axis (host/formats.md, Diagnosis) and returns an <img> element.
"""
from __future__ import annotations

import base64
import html
import io
import math

import numpy as np

from . import subplots
from ..diagnosis_words import number, plain
from ..direction import FALLING, RESTING, RISING, directions
from .marks import DIRECTIONS, GRID, INK, MUTED
from .profiles import temperature_curve

import matplotlib.ticker  # isort: skip  (after imucal.plot, which loads it without what no page needs)
from matplotlib.colors import BoundaryNorm, ListedColormap  # isort: skip
from matplotlib.patches import Rectangle  # isort: skip

DATA, BEFORE, AFTER = "#1d2733", "#d1662a", "#2b6cb0"
MOVES = {"soak": RESTING, "down": FALLING, "up": RISING}
DIRECTION_WORD = {name: DIRECTIONS[move].word for name, move in MOVES.items()}
BRANCH_ORDER = 3  # of the curve about which a branch scatters
SMOOTHEST_ORDER = 5  # of the curve that stands for the polynomial of the answer, whatever its own order


def style():
    matplotlib.rcParams.update({
        "font.family": "DejaVu Sans", "font.size": 9, "axes.edgecolor": GRID, "axes.labelcolor": INK,
        "axes.titlesize": 9.5, "axes.titlecolor": INK, "axes.titlelocation": "left", "axes.titleweight": "bold",
        "axes.grid": True, "grid.color": GRID, "grid.linewidth": 0.6, "axes.axisbelow": True,
        "axes.spines.top": False, "axes.spines.right": False, "xtick.color": MUTED, "ytick.color": MUTED,
        "legend.frameon": False, "legend.fontsize": 8, "svg.fonttype": "path", "figure.dpi": 100})


def legend_above(ax, columns):
    """Lines above the axes: beside the points and not over them."""
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.2, columnspacing=1.2, handlelength=1.6)


def svg_image(fig, alt):
    """<img> with the figure as inline SVG: nothing outside the page is needed."""
    buffer = io.BytesIO()
    fig.savefig(buffer, format="svg", bbox_inches="tight", metadata={"Date": None}, dpi=180)  # the dpi of points that are drawn as pixels
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'<img alt="{html.escape(alt, quote=True)}" src="data:image/svg+xml;base64,{data}">'


def array(values):
    """Nested lists with null -> float array with NaN."""
    return np.array([[np.nan if v is None else v for v in row] if isinstance(row, list) else (np.nan if row is None else row)
                     for row in values], float)


def draw_gap_map(plots):
    """Excess variance of the standardised residual by averaging time and temperature, before and after."""
    before = plots["gap_map"]
    tau, edges = before["tau_s"], array(before["temp_edges_degc"])
    temp = 0.5 * (edges[1:] + edges[:-1])
    panels = [("believed model", array(before["z"]).T)]
    if (plots.get("gap_map_after") or {}).get("z"):
        panels.append(("with what was found", array(plots["gap_map_after"]["z"]).T))
    levels = [-8, -5, -3, -2, 2, 3, 5, 8]
    colors = ["#2b5f94", "#6f9fca", "#b9d2e8", "#f5f6f8", "#f8cdb4", "#e88a5b", "#c24a23"]
    cmap = ListedColormap(colors).with_extremes(under="#17406b", over="#8c2a0f", bad="#ffffff")
    fig, axes = subplots(1, len(panels), size=(4.6 * len(panels) + 0.9, 3.1), sharey=True, squeeze=False,
                             layout="constrained")
    mesh = None
    for ax, (title, z) in zip(axes[0], panels):
        ax.set_facecolor("#ffffff")
        mesh = ax.pcolormesh(np.arange(len(tau) + 1), np.arange(len(temp) + 1), z, cmap=cmap,
                             norm=BoundaryNorm(levels, len(colors)), edgecolors="white", linewidth=0.8)
        for i, j in zip(*np.where(np.isnan(z))):  # nothing was measured there
            ax.add_patch(Rectangle((j, i), 1, 1, facecolor="#ffffff", edgecolor="#aab2bb", hatch="////", linewidth=0))
        for i, j in zip(*np.where(np.abs(z) >= 3)):
            ax.text(j + 0.5, i + 0.5, f"{z[i, j]:.0f}", ha="center", va="center", fontsize=6.5,
                    color="white" if abs(z[i, j]) >= 5 else INK)
        step = max(1, math.ceil(len(tau) / 7))
        ax.set_xticks(np.arange(0, len(tau), step) + 0.5, [number(t, 4) for t in tau[::step]], fontsize=7.5)
        ax.set_yticks(np.arange(len(temp)) + 0.5, [f"{t:.0f}" for t in temp], fontsize=7.5)
        ax.set_title(title)
        ax.set_xlabel("averaging time [s]")
        ax.grid(False)
        ax.tick_params(length=0)
    axes[0][0].set_ylabel("temperature [°C]")
    bar = fig.colorbar(mesh, ax=axes[0].tolist(), extend="both", ticks=levels, shrink=0.85, aspect=25)
    bar.set_label("surplus of variance [standard errors]", fontsize=8)
    bar.outline.set_visible(False)
    return svg_image(fig, "Gap by averaging time and temperature, before and after")


def directions_of(data):
    """{"soak", "down", "up": mask} of the means of all logs, each log by itself: does the temperature rest, fall or rise?"""
    t_s, temp, log = array(data["t_s"]), array(data["temp_degc"]), array(data["log"])
    moves = np.zeros(log.size, int)
    for k in np.unique(log):
        moves[log == k] = directions(t_s[log == k], temp[log == k])
    return {name: moves == value for name, value in MOVES.items()}


def mark_of(name, size):
    """How means of such a direction are drawn: keywords of plot()."""
    return DIRECTIONS[MOVES[name]].style(size)


def branches(data, key, n_bins=14):
    """Means of a residual by temperature and direction: {direction: (temp, mean, standard error)}.

    The standard error allows for the correlation of neighbouring means: sqrt((1 + rho)/(1 - rho)).
    """
    temp, y, log = (array(data[k]) for k in ("temp_degc", key, "log"))
    rest = y - y.mean()
    for chosen in directions_of(data).values():  # what the branches themselves are is no scatter
        if chosen.sum() >= 4 * BRANCH_ORDER:
            x = (temp[chosen] - temp[chosen].mean()) / max(np.ptp(temp[chosen]), 1e-9)
            rest[chosen] = y[chosen] - np.polyval(np.polyfit(x, y[chosen], BRANCH_ORDER if np.ptp(temp[chosen]) > 0 else 0), x)
    same = log[1:] == log[:-1]
    rho = np.clip(np.sum(rest[1:] * rest[:-1] * same) / max(np.sum(rest**2), 1e-12), 0, 0.95)
    inflation = math.sqrt((1 + rho) / (1 - rho))
    edges = np.linspace(np.min(temp), np.max(temp), n_bins + 1)
    which = np.clip(np.digitize(temp, edges) - 1, 0, n_bins - 1)
    out = {}
    for name, chosen in directions_of(data).items():
        points = []
        for k in range(n_bins):
            v = y[chosen & (which == k)]
            if v.size >= 4:
                points.append((temp[chosen & (which == k)].mean(), v.mean(), inflation * v.std(ddof=1) / math.sqrt(v.size)))
        if points:
            out[name] = np.array(points).T
    return out


class Record:
    """One-minute means of all logs: rate, temperature, direction, and what polynomial and answer make of them.

    `offset_dph` is the constant of each mean's log: rates less it lie on one curve, whatever their log."""

    def __init__(self, data):
        self.log, self.t_s, self.rate_dph = array(data["log"]), array(data["t_s"]), array(data["rate_dph"])
        self.before_dph, self.after_dph = array(data["before_dph"]), array(data["after_dph"])
        self.polynomial_dph = array(data["polynomial_dph"])
        self.temp_degc = array(data["temp_degc"])
        self.logs = list(dict.fromkeys(self.log.tolist()))
        self.chosen = directions_of(data)
        self.cause_dph = self.before_dph - self.after_dph
        self._split()

    def _split(self):
        """Polynomial and constants: least squares of a smooth curve and one constant for each log."""
        columns = [self.log == k for k in self.logs]
        span = np.ptp(self.temp_degc) if np.isfinite(self.temp_degc).any() else 0
        powers = []
        if span > 0:
            powers = [(2 * (self.temp_degc - self.temp_degc.min()) / span - 1)**k for k in range(1, SMOOTHEST_ORDER + 1)]
        self._middle = [np.mean(x) for x in powers]
        design = np.array(columns + [x - m for x, m in zip(powers, self._middle)], float).T
        beta = np.linalg.lstsq(design, self.polynomial_dph, rcond=None)[0]
        n = len(self.logs)
        self._beta = beta[n:]
        self._level = beta[:n].mean()
        self.offset_dph = design[:, :n] @ beta[:n] - self._level

    def curve_on_grid(self, n=240):
        """(temperatures, polynomial there); NaN where a tenth of the range and more was not passed."""
        lo, span = self.temp_degc.min(), np.ptp(self.temp_degc)
        grid = np.linspace(lo, lo + span, n)
        x = 2 * (grid - lo) / max(span, 1e-9) - 1
        curve = self._level + sum((b * (x**(k + 1) - m) for k, (b, m) in enumerate(zip(self._beta, self._middle))), np.zeros(n))
        passed = np.sort(self.temp_degc)
        after = np.clip(np.searchsorted(passed, grid), 1, passed.size - 1) if passed.size > 1 else np.zeros(n, int)
        hole = passed[after] - passed[after - 1] > 0.1 * span if passed.size > 1 else np.zeros(n, bool)
        return grid, np.where(hole, np.nan, curve)

    def cause_against_temperature(self):
        """What was found, in the order of time: a line that does not go from log to log."""
        cut = np.flatnonzero(np.diff(self.log) != 0) + 1
        return np.insert(self.temp_degc, cut, np.nan), np.insert(self.cause_dph, cut, np.nan)


def loop_dph(data):
    """Largest distance of the rising from the falling branch of what was measured, with the temperature where it is, and the standard
    error of that distance: (dph, degC, dph), or None where no temperature was passed in both directions."""
    branch = branches(data, "before_dph", n_bins=int(np.clip(len(data["log"]) // 12, 3, 10)))
    if not {"up", "down"} <= set(branch):
        return None
    up, down = branch["up"], branch["down"]
    lo, hi = max(up[0].min(), down[0].min()), min(up[0].max(), down[0].max())
    if not hi > lo:
        return None
    at = np.linspace(lo, hi, 50)
    apart = np.interp(at, up[0], up[1]) - np.interp(at, down[0], down[1])
    error = np.hypot(np.interp(at, up[0], up[2]), np.interp(at, down[0], down[2]))
    k = int(np.argmax(np.abs(apart)))
    return float(abs(apart[k])), float(at[k]), float(error[k])


def _curves(data, key):
    curves = data.get(key) or []
    return [c for c in (curves if curves and isinstance(curves[0], list) else [curves]) if c]


def draw_dp2(data, unit="dph"):
    """DP2 of the logs against both models: less the mean of the believed model, and less that of what was found."""
    tau = array(data["tau_s"])
    fig, ax = subplots(size=(5.0, 3.5), layout="constrained")
    models = [(key, array(data[f"model_{key}_dph"])) for key in ("before", "after") if data.get(f"model_{key}_dph")]
    is_one = len(models) == 2 and np.array_equal(models[0][1], models[1][1], equal_nan=True)
    for key, curve in models[:1] if is_one else models:
        ax.plot(tau, curve, color=BEFORE if key == "before" else AFTER, linewidth=1.8, linestyle="--" if key == "before" else "-",
                label="both models" if is_one else {"before": "believed model", "after": "with what was found"}[key])
    after = _curves(data, "data_after_dph")
    for i, curve in enumerate(_curves(data, "data_dph")):
        ax.plot(tau, array(curve), color=DATA, linewidth=0.8, linestyle=":", marker="o", markersize=3.4, markerfacecolor="white",
                label=("logs, what was found still in" if after else "logs") if i == 0 else None)
    for i, curve in enumerate(after):
        ax.plot(tau, array(curve), color=DATA, linewidth=1.0, marker="o", markersize=3.0, label="logs without it" if i == 0 else None)
    ax.set(xscale="log", yscale="log", xlabel="averaging time [s]", ylabel=f"DP2 [{unit}]")
    ax.xaxis.set_major_formatter(matplotlib.ticker.FuncFormatter(lambda v, _: f"{v:g}"))
    ax.yaxis.set_major_locator(matplotlib.ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(matplotlib.ticker.FuncFormatter(lambda v, _: f"{v:g}"))
    ax.yaxis.set_minor_formatter(matplotlib.ticker.NullFormatter())
    ax.grid(True, which="major")
    legend_above(ax, 2)
    return svg_image(fig, "DP2 prediction error of the logs against the models, before and after")


def candidate_rows(candidates, tests=(), named=()):
    """(rows to draw, best last; how many others gain nothing): what was named comes first, with or without a gain of its own."""
    rows, seen = [], set()
    for c in candidates:  # a name that comes again is the same effect of a shape that its parameters do not tell
        rows.append({**c, "label": plain(c["name"]) + (" (any shape)" if c["name"] in seen else ""), "named": c["name"] in named})
        seen.add(c["name"])
    rows += [{"label": f"test: {plain(t['name'])}", "gain_nats": t["evidence_before_nats"] + t["threshold_nats"],
              "threshold_nats": t["threshold_nats"], "library": False, "named": False} for t in tests]
    rows = [c for c in rows if c.get("gain_nats") is not None and (c.get("threshold_nats") or 0) > 0]
    best = {}
    for c in rows:  # of a named effect its strongest row is the name
        if c["named"] and c["gain_nats"] >= best.get(c["name"], (-1, None))[0]:
            best[c["name"]] = (c["gain_nats"], c)
    rows = [{**c, "named": c["named"] and best[c["name"]][1] is c} for c in rows]
    elsewhere = [{"label": plain(name), "gain_nats": 0.0, "threshold_nats": 1.0, "named": True, "elsewhere": True}
                 for name in named if name not in seen]
    drawn = [c for c in rows if c["named"] or c["gain_nats"] > 0.1 * c["threshold_nats"]]
    drawn.sort(key=lambda c: (-c["named"], -c["gain_nats"] / c["threshold_nats"]))
    drawn = (elsewhere + drawn)[:18]
    return drawn[::-1], len(rows) - len([c for c in drawn if not c.get("elsewhere")])


def draw_candidates(candidates, tests=(), named=()):
    """What every candidate and every library-free test gains over its false-alarm threshold."""
    rows, n_others = candidate_rows(candidates, tests, named)
    fig, ax = subplots(size=(5.6, 0.24 * len(rows) + 1.0), layout="constrained")
    floor = 0.05
    ratio = [max(c["gain_nats"] / c["threshold_nats"], floor * 1.02) for c in rows]
    for i, (c, r) in enumerate(zip(rows, ratio)):
        known = c.get("library", True)
        color = (AFTER if c["named"] else "#8fb3d9") if known else "#b9bfc6"
        ax.barh(i, r - floor, left=floor, color=color, height=0.68, hatch=None if known else "////", edgecolor="white", linewidth=0)
        ax.text(1.02, i, "found otherwise" if c.get("elsewhere") else number(c["gain_nats"]), transform=ax.get_yaxis_transform(),
                va="center", fontsize=7, color=MUTED)
    ax.axvline(1, color="#c53030", linewidth=1.2)
    ax.set_yticks(range(len(rows)), [c["label"] for c in rows], fontsize=7.5)
    for text, c in zip(ax.get_yticklabels(), rows):
        text.set_fontweight("bold" if c["named"] else "normal")
    others = f"; {n_others} others gain nothing" if n_others else ""
    ax.set(xscale="log", xlabel=f"gain over its threshold (red){others}\nright: gain in nats")
    ax.set_xlim(floor, max(max(ratio, default=1) * 1.3, 3))
    ax.xaxis.set_major_formatter(matplotlib.ticker.FuncFormatter(lambda v, _: f"{v:g}"))
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)
    return svg_image(fig, "Evidence of each candidate relative to its threshold; hatched: library-free tests")


def draw_profile(profile):
    """The temperature profile that is advised."""
    minutes, temp_degc = temperature_curve(profile)
    fig, ax = subplots(size=(4.6, 2.0), layout="constrained")
    ax.plot(minutes / 60, temp_degc, color=AFTER, linewidth=1.8)
    ax.set(xlabel="time [h]", ylabel="temp. [°C]")
    return svg_image(fig, f"Advised profile of {minutes[-1]:.0f} minutes")
