# SPDX-License-Identifier: MIT
"""Figures of the record of a diagnosis: rows as they were logged, their means, what polynomial and answer make of them, and
the samples that no answer rests on, with the reason.

`plots` is the member of one axis (host/formats.md, Diagnosis); rates are in `unit`, dph or mg.
"""
from __future__ import annotations

import numpy as np

from . import subplots
from ..diagnosis_words import number
from .diagnosis import AFTER, BEFORE, DATA, DIRECTION_WORD, INK, MUTED, Record, array, directions_of, mark_of, svg_image

import matplotlib.ticker  # isort: skip  (after imucal.plot, which loads it without what no page needs)

RAW = "#c3cad2"
LEFT_OUT = ("#7b2d8b", "#9a6a00", "#1f7a4d", "#a8325e", "#555e68")  # colours of the reasons, one after the other
LEFT_OUT_MARKS = ("x", "+", "1", "2", "*")
NEIGHBOUR, NEIGHBOUR_COLOUR = "neighbour", "#c9a3d1"
HELD_OUT_SHADE = "#eef1f4"
PIXELS_FROM = 600  # points of one curve: more are drawn as pixels, thousands of them as curves would make a page of megabytes
BEYOND = 0.35  # of the range of nearly all seconds: further off, a sample is an arrow at the edge
NEARLY_ALL = (0.1, 99.9)  # percent
SHORT_S = 1200  # a record up to here is drawn in seconds alone
FAR_APART = 2.5  # lengths of a mean: lines are broken where no data are for longer


def _points(x):
    return {"rasterized": len(x) > PIXELS_FROM}


def time_scale(span_s):
    """(seconds of one unit, its name): people read seconds, minutes or hours."""
    return (1.0, "s") if span_s < SHORT_S else (60.0, "min") if span_s < 7200 else (3600.0, "h")


class Stretch:
    """One log of the picture: its seconds, its means, and where it stands on the axis of time."""

    def __init__(self, key, label, is_held_out):
        self.key, self.label, self.is_held_out = key, label, is_held_out
        self.raw, self.left_out, self.every, self.means, self.why_left_out = None, [], 1, None, ""

    def times(self):
        parts = [self.raw["t_s"]] if self.raw else []
        parts += [rows["t_s"] for rows in self.left_out] + ([self.means["t_s"]] if self.means else [])
        return np.concatenate([p for p in parts if p.size]) if any(p.size for p in parts) else np.zeros(1)


def _rows(data, *keys):
    return {key: array(data.get(key) or []) for key in keys}


def _means_of_fitted(record, log):
    own = record.log == log
    return {"t_s": record.t_s[own], "temp_degc": record.temp_degc[own], "rate_dph": record.rate_dph[own],
            "believed_dph": record.polynomial_dph[own], "found_dph": (record.polynomial_dph + record.cause_dph)[own],
            "chosen": {name: chosen[own] for name, chosen in record.chosen.items()}}


def _means_of_held_out(data, log):
    own = array(data["log"]) == log
    rate, before, after = (array(data[key])[own] for key in ("rate_dph", "before_dph", "after_dph"))
    return {"t_s": array(data["t_s"])[own], "temp_degc": array(data["temp_degc"])[own], "rate_dph": rate,
            "believed_dph": rate - before, "found_dph": rate - after,
            "chosen": {name: chosen[own] for name, chosen in directions_of(data).items()}}


def _record_of(residual, has_curve):
    """Without a curve what another noise makes of the polynomial is no finding."""
    return Record(residual if has_curve else {**residual, "after_dph": residual["before_dph"]})


def stretches(plots, has_curve=True):
    """The logs in the order in which they are drawn: fitted ones, then held-out ones with what is foretold of them."""
    residual, held = plots.get("residual") or {}, plots.get("held_out") or {}
    record = _record_of(residual, has_curve) if residual.get("rate_dph") else None
    out = {}
    for log in plots.get("record") or []:
        key = (bool(log.get("is_held_out")), int(log["log"]))
        stretch = out[key] = Stretch(key, f"{'held-out ' if key[0] else ''}log {key[1] + 1}", key[0])
        stretch.raw, stretch.every = _rows(log, "t_s", "temp_degc", "rate_dph"), int(log.get("every") or 1)
        stretch.why_left_out = log.get("why_left_out") or ""
        left_out = sorted(log.get("left_out") or [], key=lambda rows: rows["why"] == NEIGHBOUR)  # told by those before them
        stretch.left_out = [{**_rows(rows, "t_s", "temp_degc", "rate_dph"), "n": rows["n"],
                             "label": rows.get("label") or rows["why"], "is_neighbour": rows["why"] == NEIGHBOUR}
                            for rows in left_out]
    for log in record.logs if record else []:
        stretch = out.setdefault((False, int(log)), Stretch((False, int(log)), f"log {log + 1:.0f}", False))
        stretch.means = _means_of_fitted(record, log)
    if held.get("are_logs"):
        for log in dict.fromkeys(held["log"]):
            stretch = out.setdefault((True, int(log)), Stretch((True, int(log)), f"held-out log {log + 1:.0f}", True))
            stretch.means = _means_of_held_out(held if has_curve else {**held, "after_dph": held["before_dph"]}, log)
    return [out[key] for key in sorted(out)]


def broken(x, y, gap):
    """x, y with NaN where x goes on by more than gap: one line that joins nothing over a hole."""
    cut = np.flatnonzero(np.diff(x) > gap) + 1
    return np.insert(x.astype(float), cut, np.nan), np.insert(y.astype(float), cut, np.nan)


def limits(logs):
    """(lowest, highest) rate of the picture: nearly all seconds, and what lies not far beyond."""
    kept = [s.raw["rate_dph"] for s in logs if s.raw] + [s.means["rate_dph"] for s in logs if s.means]
    left = [rows["rate_dph"] for s in logs for rows in s.left_out]
    values = np.concatenate([v for v in kept if v.size] or [v for v in left if v.size] or [np.zeros(1)])
    values = values[np.isfinite(values)] if np.isfinite(values).any() else np.zeros(1)
    lo, hi = np.percentile(values, NEARLY_ALL)
    reach = BEYOND * max(hi - lo, 1e-9 + 1e-6 * abs(hi))
    every = np.concatenate([values, *left])
    near = every[np.isfinite(every) & (every > lo - reach) & (every < hi + reach)]
    pad = 0.05 * max(near.max() - near.min(), reach / BEYOND)
    return near.min() - pad, near.max() + pad


def reasons(logs):
    """{label: (colour, mark, rows of all logs)} of what is left out and can be drawn; good samples beside bad ones are pale dots."""
    out = {}
    for s in logs:
        for rows in s.left_out:
            place = len(out) % len(LEFT_OUT)
            colour, mark = (NEIGHBOUR_COLOUR, ".") if rows["is_neighbour"] else (LEFT_OUT[place], LEFT_OUT_MARKS[place])
            colour, mark, n = out.get(rows["label"], (colour, mark, 0))
            out[rows["label"]] = (colour, mark, n + rows["n"])
    return out


def left_out_sentence(plots):
    """What the picture leaves out of means and lines, counted: ', without 21 rows (single seconds out of all noise)'."""
    found = reasons(stretches({"record": plots.get("record")}))
    return " Left out: " + ", ".join(f"{n} ({label})" for label, (_, _, n) in found.items()) + "." if found else ""


class _Beyond:
    """Samples beyond the edges: an arrow each, and the number and the farthest of them in words."""

    def __init__(self, lo, hi):
        self.lo, self.hi, self.n, self.farthest = lo, hi, [0, 0], [0.0, 0.0]

    def draw(self, ax, x, y, colour):
        for k, (far, edge, mark) in enumerate(((y < self.lo, self.lo, "v"), (y > self.hi, self.hi, "^"))):
            if far.any():
                ax.plot(x[far], np.full(far.sum(), edge), mark, color=colour, markersize=5, clip_on=False, zorder=5)
                self.n[k] += int(far.sum())
                most = y[far].min() if k == 0 else y[far].max()
                self.farthest[k] = most if not self.farthest[k] else (min, max)[k](most, self.farthest[k])
        return np.where((y < self.lo) | (y > self.hi), np.nan, y)

    def tell(self, ax, unit):
        for k, (edge, up) in enumerate(((self.lo, 1), (self.hi, -1))):
            if self.n[k]:
                ax.annotate(f"{self.n[k]} beyond, to {number(float(self.farthest[k]), 6)} {unit}", (0.01, edge),
                            xycoords=("axes fraction", "data"), xytext=(0, 7 * up), textcoords="offset points", fontsize=7.5,
                            color=INK, va="bottom" if up > 0 else "top",
                            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1})


def _place(logs):
    """Seconds of the axis of time at which each log begins, its first second, and the end of the last."""
    begin, now = [], 0.0
    lengths = [np.ptp(s.times()) for s in logs]
    apart = 0.02 * max(sum(lengths), 1.0)
    for s, length in zip(logs, lengths):
        begin.append((now, float(s.times().min())))
        now += length + apart
    return begin, now - apart


def _draw_rates(ax, logs, begin, scale, beyond, mean_s, has_temperature, believed, is_short):
    """Seconds, means, lines and what is left out."""
    named = set()

    def once(label):
        return None if label in named or named.add(label) else label

    marks = reasons(logs)
    for s, (now, first) in zip(logs, begin):
        at = lambda t: (t - first + now) / scale  # noqa: E731
        if s.raw and s.raw["t_s"].size:
            x = at(s.raw["t_s"])
            label = "rows as logged" + (f", one of {s.every}" if s.every > 1 else "")
            ax.plot(x, beyond.draw(ax, x, s.raw["rate_dph"], MUTED), ".", markersize=3 if is_short else 1.6,
                    color=DATA if is_short else RAW, label=once(label), zorder=1, **_points(x))
        if s.means and not is_short:
            x = at(s.means["t_s"])
            for name, chosen in s.means["chosen"].items():
                if chosen.any():
                    how = mark_of(name, 3) if has_temperature else {"marker": ".", "ls": "none", "ms": 3.4, "color": DATA}
                    label = f"means, temperature {DIRECTION_WORD[name]}" if has_temperature else "means"
                    ax.plot(x[chosen], s.means["rate_dph"][chosen], label=once(label), zorder=3, **how, **_points(x))
        for rows in s.left_out:
            colour, mark, n = marks[rows["label"]]
            x = at(rows["t_s"])
            if np.isfinite(rows["rate_dph"]).any():
                ax.plot(x, beyond.draw(ax, x, rows["rate_dph"], colour), mark, markersize=4.5, markeredgewidth=0.9, color=colour,
                        label=once(f"left out, {n}: {rows['label']}"), zorder=1.5 if rows["is_neighbour"] else 2, **_points(x))
        if s.means:
            x = at(s.means["t_s"])
            gap = FAR_APART * mean_s / scale
            line = {"color": INK, "zorder": 4}
            ax.plot(*broken(x, s.means["believed_dph"], gap), linewidth=0.9, linestyle="--", label=once(believed), **line)
            if np.any(s.means["found_dph"] != s.means["believed_dph"]):
                ax.plot(*broken(x, s.means["found_dph"], gap), linewidth=1.1, label=once("with what was found"), **line)


def _draw_temperatures(ax, logs, begin, scale, mean_s):
    for s, (now, first) in zip(logs, begin):
        if s.raw and np.isfinite(s.raw["temp_degc"]).any():
            parts = [s.raw, *s.left_out]
            t, temp = (np.concatenate([p[key] for p in parts]) for key in ("t_s", "temp_degc"))
            order = np.argsort(t, kind="stable")
            step = np.median(np.diff(s.raw["t_s"])) if s.raw["t_s"].size > 1 else 1.0
            x = (t[order] - first + now) / scale
            ax.plot(*broken(x, temp[order], max(10 * step, mean_s) / scale), color=RAW, linewidth=1.2)
        if s.means:
            for name, chosen in s.means["chosen"].items():
                ax.plot((s.means["t_s"][chosen] - first + now) / scale, s.means["temp_degc"][chosen], **mark_of(name, 2.4),
                        **_points(s.means["t_s"]))
    ax.set_ylabel("temp. [°C]")
    ax.yaxis.set_major_locator(matplotlib.ticker.MaxNLocator(4))


def has_temperatures(logs):
    return any(np.isfinite(part["temp_degc"]).any() for s in logs for part in (s.raw, s.means) if part and part["temp_degc"].size)


def legend_over(fig, columns=4):
    """One legend over all panels, and not over points."""
    entries = {}
    for ax in fig.axes:
        for handle, label in zip(*ax.get_legend_handles_labels()):
            entries.setdefault(label, handle)
    if entries:
        fig.legend(entries.values(), entries, loc="outside upper right", ncols=min(columns, len(entries)), columnspacing=1.2,
                   handlelength=1.6, markerscale=1.5)


def draw_record(plots, unit="dph", has_curve=True):
    """Rate and temperature against time, as they were logged; means, lines, and what was left out."""
    logs = stretches(plots, has_curve)
    begin, end = _place(logs)
    scale, name = time_scale(end)
    has_temperature, mean_s = has_temperatures(logs), float((plots.get("residual") or {}).get("mean_s") or 60)
    rows = 2 if has_temperature else 1
    fig, axes = subplots(rows, 1, size=(9.6, 3.1 + 1.5 * (rows - 1)), sharex=True, squeeze=False, layout="constrained",
                         height_ratios=[2.9, 1.5][:rows])
    top = axes[0][0]
    beyond = _Beyond(*limits(logs))
    believed = "polynomial" if has_temperature else "mean of the log" if len(logs) == 1 else "mean of each log"
    _draw_rates(top, logs, begin, scale, beyond, mean_s, has_temperature, believed, end <= SHORT_S and any(s.raw for s in logs))
    top.set_ylim(beyond.lo, beyond.hi)
    beyond.tell(top, unit)
    for s, (now, _) in zip(logs, begin):
        if s.is_held_out:
            for ax in axes[:, 0]:
                ax.axvspan(now / scale, (now + np.ptp(s.times())) / scale, color=HELD_OUT_SHADE, zorder=0)
        if len(logs) > 1:
            top.text(now / scale, 1.0, s.label + (" (not used)" if s.why_left_out else ""),
                     transform=top.get_xaxis_transform(), fontsize=7.5, color=MUTED, va="bottom")
    top.set_ylabel(f"rate [{unit}]" if unit == "dph" else f"specific force [{unit}]")
    if rows == 2:
        _draw_temperatures(axes[1][0], logs, begin, scale, mean_s)
    axes[-1][0].set_xlabel(f"time [{name}]" + (", logs one after the other" if len(logs) > 1 else ""))
    legend_over(fig)
    what = "Rate and temperature" if has_temperature else "Rate"
    return svg_image(fig, f"{what} against time, as logged and in means")


def _raw_behind(ax, plots, record, lo, hi):
    """Seconds of the fitted logs against their temperature, each log less its constant, and what was left out."""
    marks = reasons(stretches({"record": plots.get("record")}))
    for s in stretches({"record": plots.get("record")}):
        own = record.log == s.key[1]
        if s.is_held_out or not own.any():
            continue
        constant = float(record.offset_dph[own].mean())
        ax.plot(s.raw["temp_degc"], s.raw["rate_dph"] - constant, ".", markersize=1.4, color=RAW, zorder=1,
                **_points(s.raw["t_s"]))
        for rows in s.left_out:
            y = rows["rate_dph"] - constant
            colour, mark, _ = marks[rows["label"]]
            ax.plot(rows["temp_degc"], np.where((y < lo) | (y > hi), np.nan, y), mark, markersize=4, markeredgewidth=0.8,
                    color=colour, zorder=1.5 if rows["is_neighbour"] else 2, **_points(rows["t_s"]))


def draw_against_temperature(plots, unit="dph", has_curve=True, draws_found=True):
    """Three panels: the rate against temperature; less the polynomial; less what was found too, on the scale of the second."""
    residual = plots["residual"]
    r = _record_of(residual, has_curve)
    kinds = ["raw", "before"] + ["after"] * has_curve
    fig, axes = subplots(1, len(kinds), size=(9.6, 3.5), layout="constrained", squeeze=False)
    low, high = limits(stretches(plots, has_curve))
    spread = 1.08 * max(np.max(np.abs(r.before_dph)), np.max(np.abs(r.after_dph)), 1e-9)
    grid, curve = r.curve_on_grid()
    for ax, kind in zip(axes[0], kinds):
        y = {"raw": r.rate_dph - r.offset_dph, "before": r.before_dph, "after": r.after_dph}[kind]
        if kind == "raw":
            _raw_behind(ax, plots, r, low, high)
        for name, chosen in r.chosen.items():
            if chosen.any():
                ax.plot(r.temp_degc[chosen], y[chosen], label=DIRECTION_WORD[name], zorder=3, **mark_of(name, 3.2),
                        **_points(r.t_s))
        ax.plot(grid, curve if kind == "raw" else 0 * curve, color=INK, linewidth=1.1, linestyle="--", label="polynomial", zorder=4)
        if kind == "before" and draws_found and np.any(np.abs(r.cause_dph) > 0):
            ax.plot(*r.cause_against_temperature(), color=INK, linewidth=1.1, label="with what was found", zorder=4)
        if kind != "raw":
            ax.set_ylim(-spread, spread)
        ax.set(xlabel="temperature [°C]", title={"raw": f"as measured [{unit}]", "before": f"less the polynomial [{unit}]",
                                                 "after": f"less what was found too [{unit}]"}[kind])
    if has_curve:
        axes[0][2].sharey(axes[0][1])
    legend_over(fig, 6)
    return svg_image(fig, "Against temperature by direction: as measured, less the polynomial, less what was found")


def unit_label(data, unit):
    """'quarter 2' of the only log, 'log 3', 'held-out log 1'."""
    own = np.flatnonzero(array(data["unit"]) == unit)
    log = int(data["log"][own[0]])
    if data.get("are_logs"):
        return f"held-out log {log + 1}"
    n_units, n_logs = len(set(data["unit"])), len(set(data["log"]))
    return f"log {log + 1}" if n_logs > 1 or n_units == 1 else f"quarter {int(unit) + 1}"


def draw_held_out(data, unit="dph", has_curve=True):
    """What is left of data that were not fitted, before and after, each stretch about its own constant."""
    units = list(dict.fromkeys(data["unit"]))
    of, t_s, before, after = (array(data[key]) for key in ("unit", "t_s", "before_dph", "after_dph"))
    spans = {u: np.ptp(t_s[of == u]) for u in units}
    scale, name = time_scale(sum(spans.values()))
    fig, axes = subplots(size=(9.6, 2.5), layout="constrained", squeeze=False)
    ax, now = axes[0][0], 0.0
    for i, u in enumerate(units):
        own = of == u
        x = (t_s[own] - t_s[own][0] + now) / scale
        if i % 2:
            ax.axvspan(x[0], x[-1], color=HELD_OUT_SHADE, zorder=0)
        ax.plot(x, before[own], "o", markersize=2.8, markerfacecolor="none", markeredgewidth=0.8, color=BEFORE,
                label="less the polynomial" if i == 0 else None)
        if has_curve:
            ax.plot(x, after[own], ".", markersize=3.6, color=AFTER, label="less what was found too" if i == 0 else None)
        ax.text(x[0], 1.0, unit_label(data, u), transform=ax.get_xaxis_transform(), fontsize=7.5, color=MUTED, va="bottom")
        now += spans[u] * 1.02 + 0.005 * sum(spans.values())
    ax.axhline(0, color=INK, linewidth=0.8, linestyle="--")
    ax.set(xlabel=f"time [{name}], one after the other", ylabel=f"left [{unit}]")
    legend_over(fig)
    return svg_image(fig, "What is left of data that were not fitted, before and after")
