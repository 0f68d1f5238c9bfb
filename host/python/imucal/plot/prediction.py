# SPDX-License-Identifier: MIT
"""Direct Predictor and Allan curves: of a test against what its model expects, of two models apart, ratios that show outliers,
and models that bound what was recorded.

Every function takes results of `dp` or `errormodel` (their --json) and returns a figure."""
import pathlib

import numpy as np

from . import subplots

NAMES = {"av": "Allan deviation", "dp1": "DP type 1 (20 s)", "dp2": "DP type 2", "dp3": "DP type 3"}
COLORS = {"av": "#4c72b0", "dp1": "#937860", "dp2": "#c44e52", "dp3": "#55a868"}
RED, BLUE, ORANGE = "#c44e52", "#4c72b0", "#dd8452"


def _axes(ylabel="prediction error [deg/h]", xlabel="prediction time [s]", size=(7, 4.2)):
    fig, ax = subplots(size=size)
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)
    ax.grid(alpha=0.3)
    return fig, ax


def curves_and_expectation(found):
    """Curves of one test (solid) and what its model expects (dotted): {type: (curve of `dp`, result of `errormodel expect`)}."""
    fig, ax = _axes()
    for kind, (r, e) in found.items():
        ax.plot(r["tau_s"], r["dp_dph"], color=COLORS[kind], label=NAMES[kind])
        ax.plot(e["tau_s"], e["dp_dph"], color=COLORS[kind], ls=":", lw=1)
    ax.set_ylim(0, 30)
    ax.legend(title="solid: this test; dotted: expected")
    return fig


def separation(tau_s, t, labels, paper_s):
    """Curves of two models and how long they stay apart: t is one of the `types` of `errormodel separation`."""
    fig, (ax, side) = subplots(1, 2, size=(9.5, 4), width_ratios=(2, 1))
    for curves, color, label in ((t["model_curves"], BLUE, labels[0]), (t["versus_curves"], ORANGE, labels[1])):
        for k, curve in enumerate(curves):
            ax.plot(tau_s, curve, color=color, lw=1, label=f"time constant {label}" if k == 0 else None)
    ax.fill_between(tau_s, 0, 5 * np.asarray(t["separated_frac"]), color="0.6", alpha=0.5, label="part of 200 draws separated here (height 5 = all)")
    ax.set(xlabel="prediction time [s]", ylabel="prediction error [deg/h]", ylim=(0, 30))
    ax.legend(fontsize=8)
    side.hist(t["longest_s"], bins=24, color="0.6")
    side.axvline(paper_s, color="k", ls="--", label=f"paper's one draw: {paper_s} s")
    side.axvline(t["spread"]["mean"], color=RED, label=f"mean {t['spread']['mean']:.0f} s, sd {t['spread']['sd']:.0f} s")
    side.set(xlabel="longest separated stretch [s]", ylabel="draws")
    side.legend(fontsize=8)
    return fig


def sensitivity(r):
    """Relative sensitivity of the curve types: the result of `errormodel sensitivity`."""
    fig, ax = _axes("relative sensitivity")
    for kind, values in r["sensitivity"].items():
        ax.plot(r["tau_s"], values, color=COLORS[kind], label=NAMES[kind])
    ax.legend()
    return fig


def smoothed_residual(log, axis, order, n):
    """Means over n rows of what a polynomial of the temperature leaves, against temperature and against time."""
    t, temp, x = log.t_s, log.temp_degc, log.rates[axis]
    tn = (temp - temp.mean()) / (np.ptp(temp) / 2)
    residual = x - np.polynomial.chebyshev.chebval(tn, np.polynomial.chebyshev.chebfit(tn, x, order))
    smooth = np.convolve(residual, np.ones(n) / n, "valid")
    fig, ax = subplots(2, 1, size=(8, 6))
    ax[0].plot(temp[n // 2:n // 2 + len(smooth)], smooth, lw=0.5, color=BLUE)
    ax[0].set_xlabel("temperature [degC]")
    ax[1].plot(t[n // 2:n // 2 + len(smooth)] / 3600, smooth, lw=0.6, color=BLUE)
    ax[1].set_xlabel("time [h]")
    for a in ax:
        a.set_ylabel("residual [deg/h]")
        a.grid(alpha=0.3)
    return fig


def ratios(r):
    """Largest and 95.4th percentile over rms: one of the `ratios` of `dp`."""
    fig, ax = _axes("ratio to rms")
    ax.plot(r["tau_s"], r["max_over_rms"], color=RED, label="max/3")
    ax.plot(r["tau_s"], r["p95_over_rms"], color=BLUE, label="95.4th percentile/2")
    ax.plot(r["tau_s"], r["max_limit"], "k:", label="limit of max/3 for a Gaussian error (1 % false alarms)")
    ax.axhspan(0.9, 1.1, color="0.9", label="0.9 ... 1.1 of the paper (for 5000 s)")
    ax.legend(title=f"verdict: {r['verdict']}", loc=(0.3, 0.5), fontsize=8)
    return fig


def bounds(tau_s, dp_dph, models):
    """A recorded curve with those that models expect, and their ratios: models are (label, result of `errormodel expect`)."""
    fig, (ax, ratio) = subplots(2, 1, size=(7.5, 6.2), height_ratios=(2.2, 1), sharex=True)
    ax.plot(tau_s, dp_dph, "k", lw=2, label="recorded")
    for label, e in models:
        line = ax.plot(e["tau_s"], e["dp_dph"], label=label)[0]
        ratio.plot(e["tau_s"], np.asarray(e["dp_dph"]) / dp_dph, color=line.get_color())
    ratio.axhline(1, color="k", lw=2)
    ratio.set(xlabel="prediction time [s]", ylabel="model / recorded", ylim=(0.85, 1.3))
    ax.set(ylabel="DP type 2 [deg/h]", xscale="log", yscale="log")
    ax.legend(fontsize=8)
    for a in (ax, ratio):
        a.grid(alpha=0.3)
    return fig


def across(r):
    """Curves of several axes with their largest and their rms: the result of `dp` of several logs."""
    fig, ax = _axes("DP type 2 [deg/h]", size=(7.5, 4.6))
    for c in r["curves"]:
        ax.plot(c["tau_s"], c["dp_dph"], lw=1, label=f"{pathlib.Path(c['log']).stem[-4:]} {c['axis'][:2]}")
    ax.plot(r["across"]["tau_s"], r["across"]["max_dph"], "k--", lw=2, label="max")
    ax.plot(r["across"]["tau_s"], r["across"]["rms_dph"], "k", lw=2, label="rms")
    ax.set_xscale("log")
    ax.legend(fontsize=8, ncol=2)
    return fig
