# SPDX-License-Identifier: MIT
"""Figures of a diagnosis, as inline SVG: the record itself first, then what was made of it.

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

import matplotlib.ticker  # isort: skip  (after imucal.plot, which loads it without what no page needs)
from matplotlib.colors import BoundaryNorm, ListedColormap  # isort: skip

DATA, BEFORE, AFTER = "#1d2733", "#d1662a", "#2b6cb0"
MOVES = {"soak": RESTING, "down": FALLING, "up": RISING}
MANY_POINTS = 600  # of one record: more are drawn as pixels
SMOOTHEST_ORDER = 5  # of the curve that stands for the polynomial of the answer, whatever its own order


def style():
    matplotlib.rcParams.update({
        "font.family": "DejaVu Sans", "font.size": 9, "axes.edgecolor": GRID, "axes.labelcolor": INK,
        "axes.titlesize": 9.5, "axes.titlecolor": INK, "axes.titlelocation": "left", "axes.titleweight": "bold",
        "axes.grid": True, "grid.color": GRID, "grid.linewidth": 0.6, "axes.axisbelow": True,
        "axes.spines.top": False, "axes.spines.right": False, "xtick.color": MUTED, "ytick.color": MUTED,
        "legend.frameon": False, "legend.fontsize": 8, "svg.fonttype": "path", "figure.dpi": 100})


def dense(record):
    """Options of the points of long records: thousands of them as curves would make a page of many megabytes."""
    return {"rasterized": record.t_s.size > MANY_POINTS}


def legend_above(ax, columns, above=1.0):
    """Beside the points and not over them: lines above the axes."""
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, above), ncols=columns, borderaxespad=0.2, columnspacing=1.2, handlelength=1.6)


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


def directions_of(data):
    """{"soak", "down", "up": mask} of the means of all logs, each log by itself."""
    t_s, temp, log = array(data["t_s"]), array(data["temp_degc"]), array(data["log"])
    moves = np.zeros(log.size, int)
    for k in np.unique(log):
        moves[log == k] = directions(t_s[log == k], temp[log == k])
    return {name: moves == value for name, value in MOVES.items()}


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
        mesh = ax.pcolormesh(np.arange(len(tau) + 1), np.arange(len(temp) + 1), z, cmap=cmap,
                             norm=BoundaryNorm(levels, len(colors)), edgecolors="white", linewidth=0.8)
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


def branches(data, key, n_bins=14):
    """Means of a residual by temperature and direction: {direction: (temp, mean, standard error)}.

    The standard error allows for the correlation of neighbouring means: sqrt((1 + rho)/(1 - rho)).
    """
    temp, y, log = (array(data[k]) for k in ("temp_degc", key, "log"))
    rest = y - y.mean()
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

    `curve_dph` is the polynomial at each mean without the constants of the logs, `offset_dph` those constants: rates less
    their log's constant lie on one curve whatever the log."""

    def __init__(self, data):
        self.log, self.t_s, self.rate_dph = array(data["log"]), array(data["t_s"]), array(data["rate_dph"])
        self.before_dph, self.after_dph = array(data["before_dph"]), array(data["after_dph"])
        self.polynomial_dph = array(data["polynomial_dph"])
        self.temp_degc = array(data["temp_degc"])
        self.has_temperature = bool(np.isfinite(self.temp_degc).any())
        self.logs = list(dict.fromkeys(self.log.tolist()))
        self.believed_mean = "polynomial" if self.has_temperature else "mean of the log" if len(self.logs) == 1 else "mean of each log"
        self.chosen = directions_of(data)
        self.cause_dph = self.before_dph - self.after_dph
        self._split()

    def _split(self):
        """Polynomial and constants: least squares of a smooth curve and one constant for each log."""
        columns = [self.log == k for k in self.logs]
        span = np.ptp(self.temp_degc) if self.has_temperature else 0
        if span > 0:
            x = 2 * (self.temp_degc - self.temp_degc.min()) / span - 1
            columns += [x**k - np.mean(x**k) for k in range(1, SMOOTHEST_ORDER + 1)]
        design = np.array(columns, float).T
        beta = np.linalg.lstsq(design, self.polynomial_dph, rcond=None)[0]
        n = len(self.logs)
        self.offset_dph = design[:, :n] @ beta[:n] - beta[:n].mean()
        self.curve_dph = self.polynomial_dph - self.offset_dph


def placed(record):
    """Hours with the logs one after the other, a little apart, and where each begins."""
    hours, begin, now = np.empty(record.t_s.size), [], 0.0
    for k in record.logs:
        own = record.log == k
        t = record.t_s[own] / 3600
        begin.append(now)
        hours[own] = t - t[0] + now
        now += (t[-1] - t[0]) * 1.03 + 0.02
    return hours, begin


def draw_record(data):
    """(a) Rate and temperature against time."""
    r = Record(data)
    hours, begin = placed(r)
    rows = 2 if r.has_temperature else 1
    fig, axes = subplots(rows, 1, size=(9.6, 2.6 + 1.2 * (rows - 1)), sharex=True, squeeze=False, layout="constrained",
                             height_ratios=[2.2, 1][:rows])
    top = axes[0][0]
    for name, chosen in r.chosen.items():
        if chosen.any():
            plain_dot = {"marker": ".", "ls": "none", "ms": 3.2, "color": DATA}
            how = DIRECTIONS[MOVES[name]].style(3) if r.has_temperature else plain_dot
            top.plot(hours[chosen], r.rate_dph[chosen], **how, **dense(r))
    for i, k in enumerate(r.logs):
        own = r.log == k
        top.plot(hours[own], r.polynomial_dph[own], color=INK, linewidth=0.9, linestyle="--", label=r.believed_mean if i == 0 else None)
        if np.any(np.abs(r.cause_dph) > 0):
            top.plot(hours[own], (r.polynomial_dph + r.cause_dph)[own], color=INK, linewidth=1.1, label="with the cause" if i == 0 else None)
        if len(r.logs) > 1:
            top.text(begin[i], 1.0, f"log {k + 1:.0f}", transform=top.get_xaxis_transform(), fontsize=7.5, color=MUTED, va="bottom")
    top.set_ylabel("rate [dph]")
    legend_above(top, 2, 1.06 if len(r.logs) > 1 else 1.0)
    if rows == 2:
        for name, chosen in r.chosen.items():
            axes[1][0].plot(hours[chosen], r.temp_degc[chosen], **DIRECTIONS[MOVES[name]].style(2.4), **dense(r))
        axes[1][0].set_ylabel("temperature [°C]")
    axes[-1][0].set_xlabel("time [h]" + (", logs one after the other" if len(r.logs) > 1 else ""))
    return svg_image(fig, "Rate and temperature against time, one-minute means coloured by the direction of the temperature"
                     if r.has_temperature else "Rate against time, one-minute means")


def paths(x, y, groups):
    """x, y with NaN where the group changes: one line that does not jump from log to log."""
    cut = np.flatnonzero(np.diff(groups) != 0) + 1
    return np.insert(x.astype(float), cut, np.nan), np.insert(y.astype(float), cut, np.nan)


def draw_against_temperature(data, what):
    """(b), (c) against temperature, coloured by direction.  what: raw, before, after."""
    r = Record(data)
    y = {"raw": r.rate_dph - r.offset_dph, "before": r.before_dph, "after": r.after_dph}[what]
    base = r.curve_dph if what == "raw" else np.zeros(y.size)
    fig, ax = subplots(size=(4.2, 3.2), layout="constrained")
    for name, chosen in r.chosen.items():
        if chosen.any():
            mark = DIRECTIONS[MOVES[name]]
            ax.plot(r.temp_degc[chosen], y[chosen], label=mark.word, **mark.style(3), **dense(r))
    order = np.argsort(r.temp_degc)
    ax.plot(r.temp_degc[order], base[order], color=INK, linewidth=1.1, linestyle="--", label="polynomial")
    if what != "after" and np.any(np.abs(r.cause_dph) > 0):
        ax.plot(*paths(r.temp_degc, base + r.cause_dph, r.log), color=INK, linewidth=1.1, label="with the cause")
    if what != "raw":  # one scale for both
        limit = 1.08 * max(np.max(np.abs(r.before_dph)), np.max(np.abs(r.after_dph)), 1e-9)
        ax.set_ylim(-limit, limit)
    ax.set(xlabel="temperature [°C]", ylabel="rate [dph]" if what == "raw" else "rate less polynomial [dph]" if what == "before"
           else "rate less polynomial and cause [dph]")
    legend_above(ax, 3)
    return svg_image(fig, f"Rate against temperature by direction: {what}")


def loop_dph(data, n_bins=10):
    """Largest distance of the rising from the falling branch of what was measured, with the temperature where it is:
    (dph, degC), or None where no temperature was passed in both directions."""
    branch = branches(data, "before_dph", n_bins)
    if not {"up", "down"} <= set(branch):
        return None
    up, down = branch["up"], branch["down"]
    lo, hi = max(up[0].min(), down[0].min()), min(up[0].max(), down[0].max())
    if not hi > lo:
        return None
    at = np.linspace(lo, hi, 50)
    apart = np.interp(at, up[0], up[1]) - np.interp(at, down[0], down[1])
    k = int(np.argmax(np.abs(apart)))
    return float(abs(apart[k])), float(at[k])


def draw_dp2(data):
    """DP2 of the data against both models with the spread simulation gives."""
    tau = array(data["tau_s"])
    fig, ax = subplots(size=(5.0, 3.5), layout="constrained")
    for key, color, label in (("before", BEFORE, "believed model"), ("after", AFTER, "with what was found")):
        if data.get(f"envelope_{key}_dph"):
            band = array(data[f"envelope_{key}_dph"])
            ax.fill_between(tau, band[:, 0], band[:, 1], color=color, alpha=0.15, linewidth=0)
        if data.get(f"model_{key}_dph"):
            ax.plot(tau, array(data[f"model_{key}_dph"]), color=color, linewidth=1.8, label=label,
                    linestyle="--" if key == "before" else "-")
    curves = data.get("data_dph") or []
    curves = curves if curves and isinstance(curves[0], list) else [curves]
    for i, curve in enumerate(c for c in curves if c):
        ax.plot(tau, array(curve), color=DATA, linewidth=1.1, marker="o", markersize=2.4, alpha=0.85,
                label="logs" if i == 0 else None)
    ax.set(xscale="log", yscale="log", xlabel="averaging time [s]", ylabel="DP2 [dph]")
    ax.yaxis.set_major_formatter(matplotlib.ticker.FuncFormatter(lambda v, _: f"{v:g}"))
    ax.yaxis.set_minor_formatter(matplotlib.ticker.LogFormatter(minor_thresholds=(1.5, 0.4)))
    ax.grid(True, which="both")
    legend_above(ax, 3)
    return svg_image(fig, "DP2 prediction error of the logs against the model before and after")


def draw_candidates(candidates, tests=(), named=()):
    """What every candidate and every library-free test gains over its false-alarm threshold."""
    rows = [dict(c) for c in candidates]
    rows += [{"name": f"test: {t['name']}", "gain_nats": t["evidence_before_nats"] + t["threshold_nats"],
              "threshold_nats": t["threshold_nats"], "library": False} for t in tests]
    rows = [c for c in rows if c.get("gain_nats") is not None and (c.get("threshold_nats") or 0) > 0]
    rows.sort(key=lambda c: -c["gain_nats"] / c["threshold_nats"])
    rows = rows[:18][::-1]
    fig, ax = subplots(size=(5.2, 0.22 * len(rows) + 0.9), layout="constrained")
    ratio = [max(c["gain_nats"], 0.05) / c["threshold_nats"] for c in rows]
    floor = 0.05
    for i, (c, r) in enumerate(zip(rows, ratio)):
        known = c.get("library", True)
        color = (AFTER if c["name"] in named else "#8fb3d9") if known else "#b9bfc6"
        ax.barh(i, max(r, floor * 1.02) - floor, left=floor, color=color, height=0.68,
                hatch=None if known else "////", edgecolor="white", linewidth=0)
        ax.text(max(r, floor * 1.02) * 1.06, i, f"{number(c['gain_nats'])}", va="center", fontsize=7, color=MUTED)
    ax.axvline(1, color="#c53030", linewidth=1.2)
    ax.set_yticks(range(len(rows)), [plain(c["name"]) for c in rows], fontsize=7.5)
    ax.set(xscale="log", xlabel="gain over its false-alarm threshold (red); numbers: gain in nats")
    ax.set_xlim(floor, max(max(ratio, default=1) * 2.2, 3))
    ax.xaxis.set_major_formatter(matplotlib.ticker.FuncFormatter(lambda v, _: f"{v:g}"))
    ax.grid(False, axis="y")
    ax.tick_params(axis="y", length=0)
    return svg_image(fig, "Evidence of each candidate relative to its threshold; hatched: library-free tests")


def draw_profile(profile):
    """The temperature profile that is advised."""
    now, t, times, temps = float(profile["start_degc"]), 0.0, [0.0], [float(profile["start_degc"])]
    for segment in profile["segments"] * int(profile.get("repeat") or 1):
        rate = segment.get("rate_degc_per_min", 0)
        if rate:
            t += abs(segment["to_degc"] - now) / abs(rate) * 60
            now = float(segment["to_degc"])
        else:
            t += float(segment["duration_s"])
        times.append(t / 60)
        temps.append(now)
    fig, ax = subplots(size=(4.6, 2.0), layout="constrained")
    ax.plot(times, temps, color=AFTER, linewidth=1.8)
    ax.set(xlabel="time [min]", ylabel="temperature [°C]")
    return svg_image(fig, f"Advised profile of {times[-1]:.0f} minutes")
