# SPDX-License-Identifier: MIT
"""Temperature profiles: the error they leave over temperature, the best ones with their bounds, and what they can tell apart.

Every function takes results of `profile` (its --json) and returns a figure."""
import numpy as np

from . import subplots

# Okabe and Ito's colours: told apart by everybody.
BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#777777"
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, GREY)
SIGNATURES = (("lag", "s"), ("dT/dt", "°/h per °C/min"), ("hysteresis", "°/h"), ("turn-on", "°/h"), ("ageing", "°/h per h"), ("4th order", "°/h"))


def temperature_curve(profile):
    """Corners (t_min, temp_degc) of a profile."""
    t_s, temp = [0.0], [profile["start_degc"]]
    for s in profile["segments"] * (profile.get("repeat") or 1):
        rate = s.get("rate_degc_per_min")
        if rate:
            t_s.append(t_s[-1] + 60 * abs((s["to_degc"] - temp[-1]) / rate))
            temp.append(s["to_degc"])
        else:
            t_s.append(t_s[-1] + s["duration_s"])
            temp.append(temp[-1])
    return np.array(t_s) / 60, temp


def _plain(ax):
    ax.grid(alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)


def _axes(title, x="temperature [°C]", y="one-sigma calibration error [°/h]", size=(7, 4.5)):
    figure, ax = subplots(size=size, layout="constrained")
    ax.set(title=title, xlabel=x, ylabel=y)
    _plain(ax)
    return figure, ax


def calibration_errors(title, results, ylim=(0, None), **legend):
    """Error over temperature of several profiles: results are (label or None, result of `profile error`)."""
    figure, ax = _axes(title)
    for (label, e), colour in zip(results, COLOURS):
        ax.plot(e["temp_degc"], e["sigma_dph"], color=colour, label=label)
    if any(label for label, _ in results):
        ax.legend(frameon=False, **legend)
    ax.set_ylim(*ylim)
    return figure


def best_profiles(results):
    """Profiles and their errors with the bounds: results are (largest degC per minute, result of `profile optimize`)."""
    figure, (top, below) = subplots(2, 1, size=(7.5, 8), layout="constrained")
    top.set(title="Best profile found for 240 min", xlabel="time [min]", ylabel="temperature [°C]")
    below.set(xlabel="temperature [°C]", ylabel="one-sigma calibration error [°/h]")
    for (rate, r), colour in zip(results, COLOURS):
        top.plot(*temperature_curve(r["profile"]), color=colour, lw=1.2, label=f"at most {rate:g} °C/min")
        below.plot(r["temp_degc"], r["sigma_dph"], color=colour, label=f"{rate:g} °C/min: worst {r['worst_dph']:.2f}")
        below.axhline(r["proven_bound_dph"], color=colour, ls=":", lw=1.2)
    below.plot([], [], color=GREY, ls=":", label="proven bound for that rate")
    bound_dph = results[-1][1]["bound_dph"]
    below.axhline(bound_dph, color=GREY, ls="--", lw=1.2, label=f"slow-ramp bound {bound_dph:.2f}")
    for ax in (top, below):
        _plain(ax)
        ax.legend(frameon=False, fontsize=8)
    below.set_ylim(0, 6)
    return figure


def trade_off(results, minutes, slow_density_dph2_s, n_coefficients=4):
    """Worst error against duration: results are (largest degC per minute, [(minutes, result of `profile optimize`)])."""
    figure, ax = _axes("What a test of a given duration can reach (order 3, 0 to 60 °C)", "duration [min]", "worst calibration error [°/h]", (7.5, 5))
    for (rate, found), colour in zip(results, COLOURS):
        m = [x for x, _ in found]
        ax.plot(m, [r["worst_dph"] for _, r in found], "o-", ms=3, color=colour, label=f"best found, {rate:g} °C/min")
        ax.plot(m, [r["paper"]["worst_dph"] for _, r in found], "x--", ms=4, lw=0.8, color=colour, label=f"ramps, equal end soaks, {rate:g} °C/min")
        ax.plot(m, [r["proven_bound_dph"] for _, r in found], ":", color=colour, label=f"proven bound, {rate:g} °C/min")
    ax.plot(minutes, np.sqrt(n_coefficients * slow_density_dph2_s / (60 * minutes)), color=GREY, lw=0.8, label="slow-ramp bound")
    ax.set(xscale="log", yscale="log")
    ticks = [60, 80, 100, 140, 180, 240, 340, 480]
    ax.set_xticks(ticks, [str(m) for m in ticks], minor=False)
    ax.set_xticks([], minor=True)
    ax.set_yticks([3, 4, 5, 6, 8, 10, 13], ["3", "4", "5", "6", "8", "10", "13"])
    ax.set_yticks([], minor=True)
    ax.legend(frameon=False, fontsize=8)
    return figure


def _correlations(ax, r):
    c = np.abs(np.array(r["tell_apart"]["correlation"]))
    ax.imshow(c, cmap="Blues", vmin=0, vmax=1)
    for i in range(len(c)):
        for j in range(len(c)):
            if i != j:
                ax.text(j, i, f"{c[i, j]:.2f}", ha="center", va="center", fontsize=8, color="white" if c[i, j] > 0.6 else "black")
    ax.set_xticks(range(len(c)), [name for name, _ in SIGNATURES], rotation=30, ha="right")
    needed = [e["needed_to_name"] for e in r["tell_apart"]["effects"]]
    ax.set_yticks(range(len(c)), [f"{n}\n(from {v:.3g} {u})" if v else f"{n}\n(not visible)" for (n, u), v in zip(SIGNATURES, needed)], fontsize=8)
    ax.set_title(f"|correlation| of signatures, worst {r['worst_correlation']:.2f}")


def tell_apart(cases):
    """Profiles over the correlation of the signatures they leave: cases are (title, result of `profile optimize --tell-apart`)."""
    figure, grid = subplots(2, 3, size=(14, 8), layout="constrained")
    for column, (title, r) in enumerate(cases):
        ax = grid[0, column]
        ax.plot(*temperature_curve(r["profile"]), color=BLUE)
        ax.set_title(f"{title}: worst {r['worst_dph']:.3f} °/h", fontsize=11)
        ax.set(xlabel="time [min]", ylabel="temperature [°C]")
        _plain(ax)
        _correlations(grid[1, column], r)
    return figure
