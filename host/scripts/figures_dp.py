#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The paper's figures 1-6 and 13, 15-21 from our own results, as PNG in build/figures.

Figures 1-6 from simulated tests; 13-18 on the recorded animal-tag log, 19-21 on the nine recorded ADIS16405 axes (the
paper used recordings of its own).  Every curve comes from the JSON of dp, errormodel or gyrosim and is drawn by
imucal.plot.prediction.
"""
import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))
import imucal  # noqa: E402
from imucal.plot import prediction as draw  # noqa: E402

NOMINAL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}]}
TEST_PROFILE = {"imucal_profile": 1, "start_degc": 0, "segments": [{"rate_degc_per_min": 0.6, "to_degc": 60}]}


def model(arw, *terms):
    return {"imucal_model": 1, "arw_deg_rt_h": arw, "markov": [{"sigma_dph": s, "tau_s": t} for s, t in terms]}


class Tools:
    """Runs the programs; models are written into the folder of the figures."""

    def __init__(self, build, out, data, seed):
        self.bin, self.out, self.data, self.seed = Path(build) / "bin", Path(out), Path(data), seed
        self.out.mkdir(parents=True, exist_ok=True)

    def file(self, name, content):
        path = self.out / f"{name}.json"
        path.write_text(json.dumps(content, indent=1))
        return path

    def run(self, *args):
        command = [str(self.bin / args[0]), *map(str, args[1:])]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode not in (0, 1):
            sys.exit(f"{' '.join(command)}: {done.stderr}")
        return done.stdout

    def json(self, *args):
        return json.loads(self.run(*args, "--json", "-"))

    def save(self, fig, number, title):
        fig.suptitle(title, fontsize=10)
        fig.tight_layout()
        fig.savefig(self.out / f"fig{number:02d}.png", dpi=120)
        print(self.out / f"fig{number:02d}.png")


def figures_1_2(tools):
    nominal, profile = tools.file("nominal", NOMINAL), tools.file("profile", TEST_PROFILE)
    for number in (1, 2):
        log = tools.out / f"test{number}.csv"
        tools.run("gyrosim", "log", "--model", nominal, "--profile", profile, "--seed", tools.seed + number, "-o", log)
        found = {}
        for kind in draw.NAMES:
            found[kind] = (tools.json("dp", log, "--type", kind, "--nominal", nominal, "--tau", "2:600:2", "--no-ratios")["curves"][0],
                           tools.json("errormodel", "expect", nominal, "--type", kind, "--nominal", nominal, "--tau", "2:600:2", "--duration-s", 6000))
        fig = draw.curves_and_expectation(found)
        tools.save(fig, number, f"Fig. {number}: nominal model, one simulated test of 6000 s (seed {tools.seed + number})")


def figures_3_5(tools):
    nominal, other = tools.file("nominal", NOMINAL), tools.file("nominal_50s", model(0.6, (20, 50)))
    r = tools.json("errormodel", "separation", "--model", nominal, "--versus", other, "--nominal", nominal, "--draws", 200,
                   "--seed", tools.seed, "--tau", "2:600:2")
    paper = {"av": 80, "dp2": 140, "dp3": 75}
    for number, kind in ((3, "av"), (4, "dp2"), (5, "dp3")):
        fig = draw.separation(r["tau_s"], r["types"][kind], ("100 s", "50 s"), paper[kind])
        tools.save(fig, number, f"Fig. {number}: {draw.NAMES[kind]}: 5+5 tests of 6000 s; right: 200 such draws")


def figure_6(tools):
    nominal, other = tools.file("nominal", NOMINAL), tools.file("nominal_50s", model(0.6, (20, 50)))
    r = tools.json("errormodel", "sensitivity", "--model", nominal, "--versus", other, "--nominal", nominal, "--tau", "10:200")
    fig = draw.sensitivity(r)
    tools.save(fig, 6, "Fig. 6: relative difference of the expected curves, time constant 50 s against 100 s (closed form)")


def figure_13(tools, log, axis, order):
    n = 120
    fig = draw.smoothed_residual(imucal.read_log(log), axis, order, n)
    tools.save(fig, 13, f"Fig. 13: {log.name} {axis}: residual of a polynomial of order {order}, means of {n} s")


def figure_15(tools, log, axis, nominal, detrend):
    r = tools.json("dp", log, "--axis", axis, "--nominal", nominal, "--detrend", detrend, "--tau", "2:600:4")["ratios"][0]
    fig = draw.ratios(r)
    tools.save(fig, 15, f"Fig. 15: {log.name} {axis}: {r['statement']}")


def bound_figure(tools, number, title, data, models, nominal, detrend, like, axis_args=()):
    """DP2 of data (tau_s, dp) with the expected curves of models, each allowed for the same detrending."""
    expected = []
    for label, m in models:
        expected.append((label, tools.json("errormodel", "expect", tools.file(f"fig{number}_model", m), "--type", "dp2", "--nominal", nominal, "--like",
                                           like, *axis_args, "--detrend", detrend, "--tau", ",".join(map(str, data[0])))))
    fig = draw.bounds(*data, expected)
    tools.save(fig, number, title)


def text_of(m):
    return f"{m['arw_deg_rt_h']:.2f} deg/sqrt(h)" + "".join(f", {t['sigma_dph']:.0f} deg/h at {t['tau_s']:.0f} s" for t in m["markov"])


def figures_16_18(tools, log, axis, detrend):
    base = ("errormodel", "fit", log, "--axis", axis, "--detrend", detrend, "--tau", "log:2:9000:20", "--bootstrap", 0)
    first = tools.json(*base, "--criterion", "ls", "--markov", 1)["model"]
    nominal = tools.file("cats_nominal", first)
    figure_15(tools, log, axis, nominal, detrend)
    fits = {n: tools.json(*base, "--criterion", "bound", "--markov", n, "--type", "dp2", "--nominal", nominal) for n in (1, 2, 3)}
    data = (fits[1]["tau_s"], np.asarray(fits[1]["data_dp_dph"]))
    sigma, arw = first["markov"][0]["sigma_dph"], first["arw_deg_rt_h"]
    for number, factor in ((16, 1.0), (17, 1.1)):
        trial = [model(factor * arw, (sigma, t)) for t in (300, 1000, 3000, 10000)]
        bound_figure(tools, number, f"Fig. {number}: {log.name} {axis}: trial and error with one Markov process, white noise x {factor}",
                     data, [(text_of(m), m) for m in trial], nominal, detrend, log, ("--axis", axis))
    bound_figure(tools, 18, f"Fig. 18: {log.name} {axis}: tightest bounds by optimisation (mean excess "
                 + ", ".join(f"{100 * f['excess']['mean']:.2f} %" for f in fits.values()) + ")",
                 data, [(f"{n} Markov: {text_of(f['model'])}", f["model"]) for n, f in fits.items()], nominal, detrend, log, ("--axis", axis))


def figures_19_21(tools, logs):
    base = ("errormodel", "fit", *logs, "--tau", "log:2:1000:25", "--bootstrap", 0)
    nominal = tools.file("adis_nominal", tools.json(*base, "--criterion", "ls", "--markov", 1)["model"])
    r = tools.json("dp", *logs, "--nominal", nominal, "--tau", "log:2:1000:25", "--no-ratios")
    fig = draw.across(r)
    tools.save(fig, 19, "Fig. 19: DP type 2 of nine recorded ADIS16405 axes (3 runs of 10,000 s)")
    for number, terms in ((20, 1), (21, 2)):
        models = []
        for across in ("rms", "max"):
            f = tools.json(*base, "--criterion", "bound", "--markov", terms, "--type", "dp2", "--nominal", nominal, "--across", across)
            models.append((f"bounds {across} (mean excess {100 * f['excess']['mean']:.1f} %): {text_of(f['model'])}", f["model"]))
            if across == "rms":
                data = (f["tau_s"], np.asarray(f["data_dp_dph"]))
        bound_figure(tools, number, f"Fig. {number}: rms of nine ADIS16405 axes and tightest bounds with {terms} Markov process(es)",
                     data, models, nominal, "mean", logs[0], ("--axis", "gx_dph"))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", default="build")
    parser.add_argument("--data", default=str(Path(__file__).resolve().parents[3] / "shared" / "data"))
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    tools = Tools(args.build, Path(args.build) / "figures", args.data, args.seed)
    figures_1_2(tools)
    figures_3_5(tools)
    figure_6(tools)
    cats, adis = tools.data / "cats_p1.csv", sorted(tools.data.glob("adis16405_imu*.csv"))
    if cats.exists():
        figure_13(tools, cats, "gy_dph", 3)
        figures_16_18(tools, cats, "gy_dph", "poly:3")
    else:
        print(f"SKIP: figures 13-18: {cats} is not here")
    if adis:
        figures_19_21(tools, adis)
    else:
        print(f"SKIP: figures 19-21: no adis16405_imu*.csv in {tools.data}")


if __name__ == "__main__":
    main()
