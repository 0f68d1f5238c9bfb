#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Draws the result of `diagnose --json` as one self-contained HTML page.

    diagnosis_report.py DIAGNOSIS.json -o report.html

Reads the contract's fields (host/formats.md, Diagnosis) and, where present, the member `plots` of each axis
(host/lib/analysis/diagnose/README.md).  A plot whose data are missing is left out.  Exit status: 0 done, 2 usage,
3 the input is not a diagnosis.
"""
from __future__ import annotations

import argparse
import base64
import html
import io
import json
import math
import os
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.colors import BoundaryNorm, ListedColormap  # noqa: E402

INK, MUTED, GRID = "#1d2733", "#66727f", "#dfe4ea"
DATA, BEFORE, AFTER = "#1d2733", "#d1662a", "#2b6cb0"
DIRECTION = {"up": "#c8502d", "down": "#2b6cb0", "soak": "#7a8794"}
VERDICTS = {
    "no_gap": ("No gap found", "#2f855a", "The logs are what the believed model predicts, to the accuracy these runs allow."),
    "explained": ("Gap explained", "#2b6cb0", "There is a gap, and the effects below account for all of it that these logs show."),
    "partly_explained": ("Gap partly explained", "#b7791f", "There is a gap; the effects below account for part of it, and something remains."),
    "unexplained": ("Gap, cause unknown", "#c53030", "There is a gap that no known effect accounts for."),
}
UNITS = [("_dph_per_degc_min", "dph per °C/min"), ("_dph_per_rt_s", "dph/√s"), ("_dph_per_h", "dph/h"),
         ("_deg_rt_h", "°/√h"), ("_dph", "dph"), ("_degc", "°C"), ("_hz", "Hz"), ("_s", "s")]


class BadInput(Exception):
    """The file is not a diagnosis: says where and what to do."""


# ---- words ------------------------------------------------------------------------------------------------

def number(value, digits=3):
    """Short decimal text; '–' for what is not there."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        if value and (abs(value) >= 1e6 or abs(value) < 1e-3):
            return f"{value:.{digits - 1}e}"
        text = f"{value:.{digits}g}"
        return f"{value:.0f}" if "e" in text else text
    return str(value)


def parameter_text(name, value, error=None):
    """'width 5.1 ± 0.3 °C' from width_degc = 5.1."""
    if isinstance(value, list):
        return f"{name.replace('_', ' ')}: " + "; ".join(
            ", ".join(parameter_text(k, v) for k, v in item.items()) if isinstance(item, dict) else number(item)
            for item in value)
    stem, unit = name, ""
    for suffix, text in UNITS:
        if name.endswith(suffix):
            stem, unit = name[: -len(suffix)], " " + text
            break
    spread = f" ± {number(error, 2)}" if isinstance(error, (int, float)) else ""
    return f"{stem.replace('_', ' ')} {number(value)}{spread}{unit}"


def joined(items):
    items = list(items)
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]


def many(n, noun):
    return f"{n} {noun}{'' if n == 1 else 's'}"


def labels_of(diagnosis):
    """Plain words for every effect, as `diagnose --list-effects --json` gives them, from the diagnosis itself."""
    return {effect["name"]: effect["label"] for effect in (diagnosis.get("library") or {}).get("effects", [])}


def plain(name):
    return name.replace("_", " ")


def where_sentence(where, n_logs=0):
    """Where the gap lies, in one sentence; empty if the diagnosis does not say."""
    if not where:
        return ""
    parts = []
    span = lambda key: where.get(key) if isinstance(where.get(key), list) and len(where[key]) == 2 else None
    if span("tau_s"):
        parts.append("at averaging times of {} to {} s".format(*map(number, span("tau_s"))))
    if span("temp_degc"):
        parts.append("between {} and {} °C".format(*map(number, span("temp_degc"))))
    if span("time_s"):
        parts.append("from {} to {} s after the start".format(*map(number, span("time_s"))))
    direction = {"up": "while the temperature rises", "down": "while the temperature falls",
                 "soak": "while the temperature rests"}.get(where.get("direction"))
    if direction:
        parts.append(direction)
    logs = where.get("logs") or []
    if logs and len(logs) == n_logs:
        parts.append("in every log")
    elif logs and all(isinstance(log, int) for log in logs):
        parts.append(f"in log{'s' * (len(logs) > 1)} " + joined(str(log + 1) for log in logs))
    elif logs:
        parts.append("in " + joined(os.path.basename(str(log)) for log in logs[:4])
                     + (f" and {len(logs) - 4} more logs" if len(logs) > 4 else ""))
    return "The gap shows " + ", ".join(parts) + "." if parts else ""


def gap_sentence(gap):
    """How far the held-out gap shrinks."""
    if not gap or gap.get("shrinkage") is None:
        return ""
    text = f"Adding what was found removes {100 * gap['shrinkage']:.0f} % of the gap on held-out data"
    ci = gap.get("ci95")
    if ci and None not in ci:
        text += f" (95 % interval {100 * ci[0]:.0f} to {100 * ci[1]:.0f} %)"
    text += "."
    remainder = gap.get("remainder")
    if remainder:
        text += f" Remainder: {str(remainder).rstrip('.')}."
    return text


def cause_sentence(axis, labels):
    effects = axis.get("effects") or []
    if not effects:
        return ""
    names = [labels.get(e["name"], plain(e["name"])) for e in effects]
    text = "Most likely cause: " + names[0] + "." if len(names) == 1 else "Most likely causes: " + "; ".join(names) + "."
    rivals = [c["name"] for c in effects[0].get("set") or [] if c["name"] != effects[0]["name"]]
    if rivals:
        text += " These logs cannot exclude " + joined(plain(r) for r in rivals) + " instead."
    return text


# ---- figures ----------------------------------------------------------------------------------------------

def style():
    plt.rcParams.update({
        "font.family": "DejaVu Sans", "font.size": 9, "axes.edgecolor": GRID, "axes.labelcolor": INK,
        "axes.titlesize": 9.5, "axes.titlecolor": INK, "axes.titlelocation": "left", "axes.titleweight": "bold",
        "axes.grid": True, "grid.color": GRID, "grid.linewidth": 0.6, "axes.axisbelow": True,
        "axes.spines.top": False, "axes.spines.right": False, "xtick.color": MUTED, "ytick.color": MUTED,
        "legend.frameon": False, "legend.fontsize": 8, "svg.fonttype": "path", "figure.dpi": 100})


def svg_image(fig, alt):
    """<img> with the figure as inline SVG: nothing outside the page is needed."""
    buffer = io.BytesIO()
    fig.savefig(buffer, format="svg", bbox_inches="tight", metadata={"Date": None})
    plt.close(fig)
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
    fig, axes = plt.subplots(1, len(panels), figsize=(4.6 * len(panels) + 0.9, 3.1), sharey=True, squeeze=False,
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
    temp, rate, y, log = (array(data[k]) for k in ("temp_degc", "rate_degc_per_min", key, "log"))
    rest = y - y.mean()
    same = log[1:] == log[:-1]
    rho = np.clip(np.sum(rest[1:] * rest[:-1] * same) / max(np.sum(rest**2), 1e-12), 0, 0.95)
    inflation = math.sqrt((1 + rho) / (1 - rho))
    still = np.abs(rate) < 0.1
    edges = np.linspace(np.min(temp), np.max(temp), n_bins + 1)
    which = np.clip(np.digitize(temp, edges) - 1, 0, n_bins - 1)
    out = {}
    for name, chosen in (("up", (rate > 0) & ~still), ("down", (rate < 0) & ~still), ("soak", still)):
        points = []
        for k in range(n_bins):
            v = y[chosen & (which == k)]
            if v.size >= 4:
                points.append((temp[chosen & (which == k)].mean(), v.mean(), inflation * v.std(ddof=1) / math.sqrt(v.size)))
        if points:
            out[name] = np.array(points).T
    return out


def draw_residual(data):
    """Residual against temperature, by direction of the temperature."""
    keys = [(k, t) for k, t in (("before_dph", "believed model"), ("after_dph", "with what was found")) if data.get(k)]
    fig, axes = plt.subplots(1, len(keys), figsize=(4.8 * len(keys) + 0.5, 3.0), sharey=True, squeeze=False,
                             layout="constrained")
    drawn = [branches(data, key) for key, _ in keys]
    for ax, (_, title), parts in zip(axes[0], keys, drawn):
        ax.axhline(0, color=MUTED, linewidth=0.8)
        for name, (x, y, error) in parts.items():
            color = DIRECTION[name]
            label = {"up": "rising", "down": "falling", "soak": "resting"}[name]
            if name == "soak":
                ax.errorbar(x, y, 2 * error, color=color, fmt="s", markersize=3.5, linewidth=1, label=label)
            else:
                ax.fill_between(x, y - 2 * error, y + 2 * error, color=color, alpha=0.16, linewidth=0)
                ax.plot(x, y, color=color, linewidth=1.6, marker="o", markersize=2.5, label=label)
        ax.set_title(title)
        ax.set_xlabel("temperature [°C]")
    axes[0][0].set_ylabel("mean residual [dph]")
    axes[0][-1].legend(loc="best")
    return svg_image(fig, "Mean residual against temperature by direction, before and after; bands are two standard errors")


def draw_dp2(data):
    """DP2 of the data against both models with the spread simulation gives."""
    tau = array(data["tau_s"])
    fig, ax = plt.subplots(figsize=(5.0, 3.5), layout="constrained")
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
    ax.legend(loc="best")
    return svg_image(fig, "DP2 prediction error of the logs against the model before and after")


def draw_candidates(candidates, tests=(), named=()):
    """What every candidate and every library-free test gains over its false-alarm threshold."""
    rows = [dict(c) for c in candidates]
    rows += [{"name": f"test: {t['name']}", "gain_nats": t["evidence_before_nats"] + t["threshold_nats"],
              "threshold_nats": t["threshold_nats"], "library": False} for t in tests]
    rows = [c for c in rows if c.get("gain_nats") is not None and (c.get("threshold_nats") or 0) > 0]
    rows.sort(key=lambda c: -c["gain_nats"] / c["threshold_nats"])
    rows = rows[:18][::-1]
    fig, ax = plt.subplots(figsize=(5.2, 0.22 * len(rows) + 0.9), layout="constrained")
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
    fig, ax = plt.subplots(figsize=(4.6, 2.0), layout="constrained")
    ax.plot(times, temps, color=AFTER, linewidth=1.8)
    ax.set(xlabel="time [min]", ylabel="temperature [°C]")
    return svg_image(fig, f"Advised profile of {times[-1]:.0f} minutes")


# ---- page -------------------------------------------------------------------------------------------------

CSS = """
:root{color-scheme:light}*{box-sizing:border-box}
body{margin:0;background:#f4f6f8;color:#1d2733;font:15px/1.55 system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif}
main{max-width:1120px;margin:0 auto;padding:32px 24px 60px}
h1{font-size:27px;letter-spacing:-.01em;margin:0 0 4px}h2{font-size:20px;margin:0}h3{font-size:14px;margin:0 0 2px}
.sub{color:#66727f;margin:0 0 20px;font-size:14px}
.chips{display:flex;flex-wrap:wrap;gap:10px;margin:0 0 26px}
.chip{background:#fff;border:1px solid #dfe4ea;border-radius:10px;padding:9px 14px;text-decoration:none;color:inherit;display:flex;gap:10px;align-items:center}
.dot{width:11px;height:11px;border-radius:50%}.chip b{font-weight:600}.chip span.v{color:#66727f}
section{background:#fff;border:1px solid #dfe4ea;border-radius:14px;padding:24px 26px;margin:0 0 24px;overflow-x:auto}
.head{display:flex;align-items:center;gap:14px;margin-bottom:10px}
.badge{color:#fff;border-radius:20px;padding:3px 13px;font-size:13px;font-weight:600}
.lead{font-size:16px;margin:6px 0 4px;max-width:84ch}.lead p{margin:0 0 6px}
.numbers{display:flex;flex-wrap:wrap;gap:14px;margin:16px 0 6px}
.number{border:1px solid #dfe4ea;border-radius:10px;padding:9px 14px;min-width:140px}
.number .n{font-size:22px;font-weight:650;letter-spacing:-.01em}.number .t{font-size:12.5px;color:#66727f}
.figures{display:flex;flex-wrap:wrap;gap:22px 26px;margin:18px 0 4px;align-items:flex-start}
figure{margin:0;flex:1 1 440px;min-width:320px}figure.wide{flex-basis:100%}figure.small{max-width:520px}
figure img{width:100%;height:auto;max-width:1040px;display:block}
figcaption{font-size:13px;color:#66727f;max-width:70ch;margin-bottom:6px}
table{border-collapse:collapse;font-size:13.5px;margin:8px 0 16px;width:100%}
th{text-align:left;color:#66727f;font-weight:600;border-bottom:1px solid #dfe4ea;padding:5px 10px 5px 0;vertical-align:bottom}
td{border-bottom:1px solid #eef1f4;padding:6px 10px 6px 0;vertical-align:top}
ul{margin:6px 0 12px;padding-left:20px}li{margin:2px 0}
details{margin:12px 0 0}summary{cursor:pointer;color:#2b6cb0;font-size:14px}
.note{background:#fbf7ec;border:1px solid #efe2bf;border-radius:10px;padding:10px 16px;margin:14px 0;font-size:14px}
footer{color:#66727f;font-size:13px}code{font-size:12.5px;background:#eef1f4;padding:1px 5px;border-radius:4px;word-break:break-all}
@media print{body{background:#fff}section{break-inside:avoid;border:0;padding:12px 0}}
"""


def esc(text):
    return html.escape(str(text))


def rows(header, body):
    head = "".join(f"<th>{esc(h)}</th>" for h in header)
    lines = "".join("<tr>" + "".join(f"<td>{esc(c)}</td>" for c in line) + "</tr>" for line in body)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"


def figure(title, caption, image, size=""):
    return f"<figure class='{size}'><h3>{esc(title)}</h3><figcaption>{esc(caption)}</figcaption>{image}</figure>"


def figures(axis):
    """The plots for which there are data; a malformed one is named instead of drawn."""
    plots = dict(axis.get("plots") or {})
    if not axis.get("effects"):  # nothing was added: after is before
        plots.pop("gap_map_after", None)
        for key, drop in (("residual", "after_dph"), ("dp2", "model_after_dph")):
            if isinstance(plots.get(key), dict):
                plots[key] = {k: v for k, v in plots[key].items() if k != drop}
    named = {e["name"] for e in axis.get("effects") or []}
    wanted = [
        ("gap_map", "Where: averaging time and temperature",
         "Variance of the standardised residual beyond what the model allows; white is as expected, a number marks more than "
         "three standard errors.", lambda d: draw_gap_map(plots), "wide"),
        ("residual", "Residual against temperature by direction",
         "Mean of the residual after constants and polynomial are fitted; bands are two standard errors.  Branches that part "
         "show memory of the temperature's past.", draw_residual, "wide"),
        ("dp2", "Prediction error (DP2): logs against model",
         "The model is right where its curve runs through the logs.", draw_dp2, ""),
        ("candidates", "Evidence of the candidates",
         "Each candidate judged alone, over the believed model.  Right of the red line: more than chance gives at the stated "
         "false-alarm rate.  Dark: named.  Hatched: tests that assume no cause.",
         lambda d: draw_candidates(d, plots.get("tests") or (), named), ""),
    ]
    out = []
    for key, title, caption, draw, size in wanted:
        data = plots.get(key)
        if not data:
            continue
        try:
            out.append(figure(title, caption, draw(data), size))
        except (KeyError, TypeError, ValueError, IndexError) as problem:
            plt.close("all")
            out.append(figure(title, f"not drawn: plots.{key} is not as documented ({type(problem).__name__}: {problem})", ""))
    return f'<div class="figures">{"".join(out)}</div>' if out else ""


def number_cards(gap):
    if not gap:
        return ""
    cards = []
    if gap.get("shrinkage") is not None:
        ci = gap.get("ci95")
        note = f"95 % interval {100 * ci[0]:.0f} … {100 * ci[1]:.0f} %" if ci and None not in ci else "no interval"
        cards.append((f"{100 * gap['shrinkage']:.0f} %", f"of the held-out gap removed; {note}"))
    if gap.get("before") is not None and gap.get("after") is not None:
        cards.append((f"{number(gap['before'])} → {number(gap['after'])}", gap.get("unit", "deviance per hour, held out")))
    for key, text in (("residual_rms_dph", "residual rms [dph]"), ("dp2_distance_dph", "distance of the DP2 curves [dph]")):
        value = gap.get(key) or {}
        if value.get("before") is not None:
            cards.append((f"{number(value['before'])} → {number(value.get('after'))}", text))
    return '<div class="numbers">' + "".join(
        f'<div class="number"><div class="n">{esc(n)}</div><div class="t">{esc(t)}</div></div>' for n, t in cards) + "</div>"


def effect_table(axis):
    effects = axis.get("effects") or []
    if not effects:
        return ""
    body = []
    for e in effects:
        errors = e.get("std_errors") or {}
        body.append((plain(e["name"]), ", ".join(parameter_text(k, v, errors.get(k)) for k, v in (e.get("parameters") or {}).items()),
                     number(e.get("evidence_nats")),
                     "–" if e.get("held_out_gain") is None else number(e["held_out_gain"]),
                     ", ".join(f"{plain(c['name'])} ({number(c.get('evidence_nats'))})" for c in e.get("set") or []
                               if c["name"] != e["name"]) or "none"))
    return "<h3>Effects</h3>" + rows(("effect", "parameters ± standard error", "evidence [nats]",
                                      "held-out gain [deviance/h]; negative: those logs speak against it",
                                      "cannot be excluded instead"), body)


def limits(axis):
    """What these profiles cannot tell, and what to run instead."""
    parts = []
    for key, title in (("not_detectable_here", "Not detectable on these profiles below the sizes listed"),
                       ("smallest_detectable", "Smallest size of each thermal effect that these profiles would show")):
        hidden = axis.get(key) or []
        if not hidden:
            continue
        parts.append(f"<details><summary>{title} ({many(len(hidden), 'effect')})</summary>" + rows(("effect", "smallest size that would show"), [
                         (plain(h["name"]), ", ".join(parameter_text(k, v) for k, v in (h.get("smallest_detectable") or {}).items())
                          or "none on these profiles") for h in hidden]) + "</details>")
    pairs = axis.get("indistinguishable") or []
    if pairs:
        parts.append('<div class="note"><b>Cannot be told apart on these profiles:</b> '
                     + esc("; ".join(" and ".join(plain(n) for n in pair) for pair in pairs)) + "</div>")
    advice = axis.get("advice") or []
    if advice:
        parts.append("<h3>Advice</h3><ul>" + "".join(f"<li>{esc(a)}</li>" for a in advice) + "</ul>")
    profile = axis.get("advised_profile")
    if profile and profile.get("segments"):
        parts.append(figure("Profile to run instead", "It separates the causes that these runs leave open.", draw_profile(profile), "small"))
    return "".join(parts)


def findings(axis):
    where = axis.get("where") or {}
    found = where.get("findings") or []
    parts = ""
    if found:
        parts += "<details open><summary>Findings</summary>" + rows(
            ("what was seen", "probe", "evidence [nats]", "p"),
            [(f.get("statement", ""), plain(str(f.get("probe", ""))), number(f.get("evidence_nats")), "< 1e-300" if f.get("p_value") == 0 else number(f.get("p_value"), 2))
             for f in found]) + "</details>"
    for key, title in (("by_tau", "averaging time"), ("by_temperature", "temperature"), ("by_phase", "phase"), ("by_log", "log")):
        table = [line for line in where.get(key) or [] if isinstance(line, dict)]
        if table:
            header = list(table[0])
            cell = lambda v: (" … ".join(number(x) for x in v) if isinstance(v, list)
                              else os.path.basename(v) if isinstance(v, str) else number(v))
            parts += f"<details><summary>The gap by {title}</summary>" + rows(
                [h.replace("_", " ") for h in header], [[cell(line.get(h)) for h in header] for line in table]) + "</details>"
    return parts


def section(axis, index, n_logs, labels):
    title, color, meaning = VERDICTS.get(axis["verdict"], (plain(axis["verdict"]), MUTED, ""))
    hidden = axis.get("not_detectable_here") or []
    if axis["verdict"] == "no_gap" and hidden:
        meaning += f" {many(len(hidden), 'effect')} would stay unseen on these profiles unless larger than listed below."
    gap = axis.get("gap") if axis.get("effects") else {}
    lead = [meaning, cause_sentence(axis, labels), where_sentence(axis.get("where"), n_logs), gap_sentence(gap), *(axis.get("notes") or [])]
    return (f'<section id="axis{index}"><div class="head"><h2>{esc(axis["axis"])}</h2>'
            f'<span class="badge" style="background:{color}">{esc(title)}</span></div>'
            f'<div class="lead">{"".join(f"<p>{esc(s)}</p>" for s in lead if s)}</div>'
            + number_cards(gap) + effect_table(axis) + figures(axis) + limits(axis) + findings(axis) + "</section>")


def page(diagnosis, source):
    """The whole page as text."""
    style()
    axes = diagnosis["axes"]
    chips = "".join(
        f'<a class="chip" href="#axis{i}"><span class="dot" style="background:{VERDICTS.get(a["verdict"], ("", MUTED))[1]}"></span>'
        f'<span><b>{esc(a["axis"])}</b> <span class="v">{esc(VERDICTS.get(a["verdict"], (a["verdict"],))[0])}'
        f'{esc(": " + joined(plain(e["name"]) for e in a["effects"])) if a.get("effects") else ""}</span></span></a>'
        for i, a in enumerate(axes))
    logs, held = diagnosis.get("logs") or [], diagnosis.get("held_out_logs") or []
    rate = diagnosis.get("false_alarm_rate")
    sub = f"{len(logs)} log{'s' * (len(logs) != 1)} fitted, " + (
        f"{len(held)} held out" if held else "each held out in turn")
    if rate is not None:
        sub += f"; false-alarm rate {100 * rate:g} % over all axes and candidates"
    files = ", ".join(f"<code>{esc(f)}</code>" for f in logs) or "–"
    held_files = ", ".join(f"<code>{esc(f)}</code>" for f in held) or "none given"
    warnings = "".join(f'<div class="note">{esc(w)}</div>' for w in diagnosis.get("warnings") or [])
    model = diagnosis.get("model")
    model = model if isinstance(model, str) else json.dumps(model)
    return (f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
            f"<title>Sim-to-real gap: {esc(os.path.basename(source))}</title><style>{CSS}</style></head><body><main>"
            f'<h1>What the simulation leaves out</h1><p class="sub">{esc(sub)}</p><div class="chips">{chips}</div>{warnings}'
            + "".join(section(a, i, len(diagnosis.get("logs") or []), labels_of(diagnosis)) for i, a in enumerate(axes))
            + f"<footer><p>Believed model: <code>{esc(model)}</code>. Seed {esc(diagnosis.get('seed', '–'))}.<br>Logs: {files}.<br>"
              f"Held out: {held_files}.</p><p>Evidence is the gain of log-likelihood (in nats) above a threshold found by simulating "
              "the believed model on the very temperature profiles of these logs. 1 nat is a likelihood ratio of 2.7.</p></footer>"
              "</main></body></html>\n")


def load(path):
    """The diagnosis, checked as far as the page needs it."""
    try:
        with open(path, encoding="utf-8") as f:
            diagnosis = json.load(f)
    except OSError as problem:
        raise BadInput(f"{path}: {problem.strerror}: give the file that `diagnose --json` wrote") from None
    except ValueError as problem:
        raise BadInput(f"{path}: not JSON ({problem}): give the file that `diagnose --json` wrote") from None
    if not isinstance(diagnosis, dict) or diagnosis.get("imucal_diagnosis") != 1:
        raise BadInput(f"{path}: field imucal_diagnosis: expected 1: give the file that `diagnose --json` wrote")
    axes = diagnosis.get("axes")
    if not isinstance(axes, list) or not all(isinstance(a, dict) and "axis" in a and "verdict" in a for a in axes):
        raise BadInput(f"{path}: field axes: expected a list of objects with axis and verdict")
    return diagnosis


def main(argv=None):
    parser = argparse.ArgumentParser(description="HTML page of a diagnosis.")
    parser.add_argument("diagnosis", help="file written by diagnose --json")
    parser.add_argument("-o", "--output", required=True, help="page to write")
    args = parser.parse_args(argv)
    try:
        text = page(load(args.diagnosis), args.diagnosis)
    except BadInput as problem:
        print(f"diagnosis_report: {problem}", file=sys.stderr)
        return 3
    temporary = args.output + ".part"
    with open(temporary, "w", encoding="utf-8") as f:
        f.write(text)
    os.replace(temporary, args.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
