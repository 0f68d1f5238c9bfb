# SPDX-License-Identifier: MIT
"""Figures of temperature profiles: the paper's figures 7-10, the error over temperature with its bounds, best
profiles, the trade-off of duration against error, and what a profile can tell apart.

Usage: figures_profile.py FOLDER.  Everything is computed by the program PROFILE (environment variable)."""
import json
import os
import subprocess
import sys
import tempfile

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

NOMINAL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}]}
# Okabe and Ito's colours: told apart by everybody.
BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#777777"


class Work:
    """Temporary files and calls of the program."""

    def __init__(self):
        self.folder = tempfile.mkdtemp(prefix="imucal_figures_")
        self.model = self.file("model", NOMINAL)

    def file(self, name, content):
        path = os.path.join(self.folder, name + ".json")
        with open(path, "w") as file:
            json.dump(content, file)
        return path

    def profile(self, *args):
        done = subprocess.run([os.environ.get("PROFILE", "build/bin/profile"), *map(str, args), "--json", "-"],
                              capture_output=True, text=True)
        if done.returncode > 1:
            sys.exit(done.stderr)
        return json.loads(done.stdout)

    def error(self, profile, *args):
        return self.profile("error", self.file("profile", profile), "--model", self.model, "--order", 3, *args)

    def optimize(self, rate_degc_per_min, duration_s, *args):
        return self.profile("optimize", "--model", self.model, "--order", 3, "--range", "0:60", "--max-rate",
                            rate_degc_per_min, "--duration-s", duration_s, *args)


def ramp_and_soak(soak_s, rate_degc_per_min=0.6, passes=1):
    """Profile of ramps between 0 and 60 degC, up first, with soaks before and after each."""
    segments = []
    for i in range(passes):
        segments += [{"rate_degc_per_min": 0, "duration_s": soak_s},
                     {"rate_degc_per_min": rate_degc_per_min, "to_degc": 0 if i % 2 else 60},
                     {"rate_degc_per_min": 0, "duration_s": soak_s}]
    return {"imucal_profile": 1, "start_degc": 0, "repeat": 1,
            "segments": [s for s in segments if s.get("duration_s", 1) > 0]}


def temperature_curve(profile):
    """Corners (t_min, temp_degc) of a profile."""
    t_s, temp = [0.0], [profile["start_degc"]]
    for s in profile["segments"]:
        if s["rate_degc_per_min"] == 0:
            t_s.append(t_s[-1] + s["duration_s"])
            temp.append(temp[-1])
        else:
            t_s.append(t_s[-1] + 60 * abs((s["to_degc"] - temp[-1]) / s["rate_degc_per_min"]))
            temp.append(s["to_degc"])
    return np.array(t_s) / 60, temp


def axes(title, x="temperature [°C]", y="one-sigma calibration error [°/h]", size=(7, 4.5)):
    figure, ax = plt.subplots(figsize=size, layout="constrained")
    ax.set(title=title, xlabel=x, ylabel=y)
    ax.grid(alpha=0.3)
    ax.spines[["top", "right"]].set_visible(False)
    return figure, ax


def save(figure, folder, name):
    path = os.path.join(folder, name + ".png")
    figure.savefig(path, dpi=120)
    plt.close(figure)
    print(path)


def paper_figures(work, folder):
    colours = [BLUE, ORANGE, GREEN, RED, PURPLE, GREY]
    figure, ax = axes("Fig. 7: ramp at 0.6 °C/min, no soak (100 min)")
    e = work.error(ramp_and_soak(0))
    ax.plot(e["temp_degc"], e["sigma_dph"], color=BLUE)
    ax.set_ylim(0)
    save(figure, folder, "fig07_ramp")

    figure, ax = axes("Fig. 8: soaks at both ends")
    for soak_min, colour in zip((0, 5, 10, 20, 30), colours):
        e = work.error(ramp_and_soak(60 * soak_min))
        ax.plot(e["temp_degc"], e["sigma_dph"], color=colour, label=f"{soak_min} min: worst {e['worst_dph']:.2f}")
    ax.legend(frameon=False)
    ax.set_ylim(0)
    save(figure, folder, "fig08_soaks")

    figure, ax = axes("Fig. 9: cycles of the basic profile (20-min soaks)")
    for passes, colour in zip((1, 2, 4, 8), colours):
        e = work.error(ramp_and_soak(1200, passes=passes))
        ax.plot(e["temp_degc"], e["sigma_dph"], color=colour,
                label=f"{passes} cycle{'s' if passes > 1 else ''}: worst {e['worst_dph']:.2f}")
    ax.legend(frameon=False)
    ax.set_ylim(0)
    save(figure, folder, "fig09_cycles")

    figure, ax = axes("Fig. 10: truth covariance, basic profile, truth 20 °/h and 100 s")
    for (sigma, tau), colour in zip(((20, 100), (10, 30), (10, 250), (5, 100), (40, 100), (40, 250)), colours):
        model = {**NOMINAL, "markov": [{"sigma_dph": sigma, "tau_s": tau}]}
        e = work.error(ramp_and_soak(1200), "--filter-model", work.file("filter", model))
        ax.plot(e["temp_degc"], e["sigma_dph"], color=colour,
                label=f"filter {sigma} °/h, {tau} s: worst {e['worst_dph']:.2f}, believes {e['believed_worst_dph']:.2f}")
    ax.legend(frameon=False, fontsize=8, loc="upper center")
    ax.set_ylim(0, 10)
    save(figure, folder, "fig10_truth_covariance")


def best_profiles(work, folder):
    figure, (top, below) = plt.subplots(2, 1, figsize=(7.5, 8), layout="constrained")
    top.set(title="Best profile found for 240 min", xlabel="time [min]", ylabel="temperature [°C]")
    below.set(xlabel="temperature [°C]", ylabel="one-sigma calibration error [°/h]")
    for rate, colour in ((0.6, BLUE), (2.0, ORANGE), (5.0, GREEN)):
        r = work.optimize(rate, 14400)
        top.plot(*temperature_curve(r["profile"]), color=colour, lw=1.2, label=f"at most {rate:g} °C/min")
        below.plot(r["temp_degc"], r["sigma_dph"], color=colour, label=f"{rate:g} °C/min: worst {r['worst_dph']:.2f}")
        below.axhline(r["proven_bound_dph"], color=colour, ls=":", lw=1.2)
    below.plot([], [], color=GREY, ls=":", label="proven bound for that rate")
    below.axhline(r["bound_dph"], color=GREY, ls="--", lw=1.2, label=f"slow-ramp bound {r['bound_dph']:.2f}")
    for ax in (top, below):
        ax.grid(alpha=0.3)
        ax.spines[["top", "right"]].set_visible(False)
        ax.legend(frameon=False, fontsize=8)
    below.set_ylim(0, 6)
    save(figure, folder, "profile_best")


def trade_off(work, folder):
    figure, ax = axes("What a test of a given duration can reach (order 3, 0 to 60 °C)", "duration [min]",
                      "worst calibration error [°/h]", (7.5, 5))
    minutes = np.array([60, 80, 100, 110, 120, 140, 180, 240, 340, 480])
    for rate, colour in ((0.6, BLUE), (2.0, ORANGE)):
        results = [(m, work.optimize(rate, 60 * m)) for m in minutes if m >= 60 / rate - 1e-9]
        m = [x for x, _ in results]
        ax.plot(m, [r["worst_dph"] for _, r in results], "o-", ms=3, color=colour, label=f"best found, {rate:g} °C/min")
        ax.plot(m, [r["paper"]["worst_dph"] for _, r in results], "x--", ms=4, lw=0.8, color=colour,
                label=f"ramps, equal end soaks, {rate:g} °C/min")
        ax.plot(m, [r["proven_bound_dph"] for _, r in results], ":", color=colour, label=f"proven bound, {rate:g} °C/min")
    ax.plot(minutes, np.sqrt(4 * 81296 / (60 * minutes)), color=GREY, lw=0.8, label="slow-ramp bound")
    ax.set(xscale="log", yscale="log")
    ticks = [60, 80, 100, 140, 180, 240, 340, 480]
    ax.set_xticks(ticks, [str(m) for m in ticks], minor=False)
    ax.set_xticks([], minor=True)
    ax.set_yticks([3, 4, 5, 6, 8, 10, 13], ["3", "4", "5", "6", "8", "10", "13"])
    ax.set_yticks([], minor=True)
    ax.legend(frameon=False, fontsize=8)
    save(figure, folder, "profile_trade_off")


def tell_apart(work, folder):
    cases = (("accuracy alone", work.optimize(2, 14400, "--no-proof")),
             ("told apart, least cost", work.optimize(2, 14400, "--no-proof", "--tell-apart", "all")),
             ("told apart, 5 % spent", work.optimize(2, 14400, "--no-proof", "--tell-apart", "all", "--spend", 5)))
    figure, grid = plt.subplots(2, 3, figsize=(14, 8), layout="constrained")
    names = ["lag", "dT/dt", "hysteresis", "turn-on", "ageing", "4th order"]
    units = ["s", "°/h per °C/min", "°/h", "°/h", "°/h per h", "°/h"]
    for column, (title, r) in enumerate(cases):
        ax = grid[0, column]
        ax.plot(*temperature_curve(r["profile"]), color=BLUE)
        ax.set_title(f"{title}: worst {r['worst_dph']:.3f} °/h", fontsize=11)
        ax.set(xlabel="time [min]", ylabel="temperature [°C]")
        ax.grid(alpha=0.3)
        ax.spines[["top", "right"]].set_visible(False)
        ax = grid[1, column]
        c = np.abs(np.array(r["tell_apart"]["correlation"]))
        ax.imshow(c, cmap="Blues", vmin=0, vmax=1)
        for i in range(len(c)):
            for j in range(len(c)):
                if i != j:
                    ax.text(j, i, f"{c[i, j]:.2f}", ha="center", va="center", fontsize=8,
                            color="white" if c[i, j] > 0.6 else "black")
        ax.set_xticks(range(len(c)), names, rotation=30, ha="right")
        needed = [e["needed_to_name"] for e in r["tell_apart"]["effects"]]
        ax.set_yticks(range(len(c)), [f"{n}\n(from {v:.3g} {u})" for n, v, u in zip(names, needed, units)], fontsize=8)
        ax.set_title(f"|correlation| of signatures, worst {r['worst_correlation']:.2f}")
    save(figure, folder, "profile_tell_apart")


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    os.makedirs(sys.argv[1], exist_ok=True)
    work = Work()
    paper_figures(work, sys.argv[1])
    best_profiles(work, sys.argv[1])
    trade_off(work, sys.argv[1])
    tell_apart(work, sys.argv[1])


if __name__ == "__main__":
    main()
