#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""How well does it calibrate?  The tables of host/lib/analysis/montecarlo/README.md: simulated calibration tests through the C core.

usage: validation.py MONTECARLO [--runs N] [--seed N] [--out FOLDER] [--check] [--save FILE.md] [--short]

Every line is a campaign of `montecarlo`; its JSON stays in FOLDER.  --check: exit with 1 where the empirical error leaves
0.97 … 1.03 of the predicted one, NEES or NIS their 95 % intervals, or coverage its interval at 99 % for all temperatures
together (N = 4000 and more; fewer runs scatter more).  --save: the tables as the README shows them; tests hold the README to
the saved file, and a --short run, of a few tests only, to its own."""

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path

MODEL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}], "turn_on_sigma_dph": 50,
         "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 300, 150, -100]}}
SLOW = {**MODEL, "markov": [{"sigma_dph": 20, "tau_s": 1000}]}
STEEP = {**MODEL, "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 3000, 150, -100]}}
SOAK = {"rate_degc_per_min": 0, "duration_s": 1200}
BASIC = {"imucal_profile": 1, "start_degc": 0, "segments": [SOAK, {"rate_degc_per_min": 0.6, "to_degc": 60}, SOAK]}
FLAWS = ["--jitter-s", "0.01", "--missing-samples", "0.01", "--missing-seconds", "0.01", "--temp-noise-degc", "0.02"]


def filter_model(sigma_dph, tau_s):
    return {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": sigma_dph, "tau_s": tau_s}]}


class Campaigns:
    """Runs montecarlo with files of its own folder."""

    def __init__(self, program, folder, seed):
        self.program, self.folder, self.seed = program, Path(folder), seed
        self.folder.mkdir(parents=True, exist_ok=True)
        self.write("basic", BASIC)

    def write(self, name, content):
        path = self.folder / f"{name}.json"
        path.write_text(json.dumps(content, indent=1) + "\n")
        return str(path)

    def run(self, name, runs, *arguments, model=MODEL, order=3, filter_model=None):
        command = [self.program, "--model", self.write(f"{name}_model", model), "--profile", str(self.folder / "basic.json"),
                   "--order", str(order), "--runs", str(runs), "--seed", str(self.seed), *arguments]
        if filter_model:
            command += ["--filter-model", self.write(f"{name}_filter", filter_model)]
        return self.result(name, command)

    def result(self, name, command):
        path = self.folder / f"{name}.json"
        subprocess.run([*command, "--json", str(path), "--quiet"], check=True)
        result = json.loads(path.read_text())
        if result.get("interrupted"):
            sys.exit("validation: stopped")
        return result


def interval_text(part):
    lo, hi = part["ci95"]
    return f"{part['mean']:.5g} in [{lo:.5g}, {hi:.5g}]" + ("" if lo <= part["mean"] <= hi else " NO")


def consistency_table(rows):
    print(f"{'campaign':<44}{'tests':>6} {'emp./pred.':>14} {'NEES':>26} {'NIS':>32} {'1 sigma':>14} {'2 sigma':>14}")
    for name, r in rows:
        one, two = (r["coverage"][band]["part"] for band in ("one_sigma", "two_sigma"))
        print(f"{name:<44}{r['runs']:>6} {r['ratio_range'][0]:>6.3f}…{r['ratio_range'][1]:<6.3f} {interval_text(r['nees']):>27}"
              f" {interval_text(r['nis']):>32}  {min(one):.3f}…{max(one):.3f}  {min(two):.3f}…{max(two):.3f}")
    print(f"{'expected':<44}{'':>6} {'1':>10} {'':>60} {'0.683':>12} {'0.954':>14}")


def sigma_table(r):
    names = ("temp_degc", "predicted_sigma_dph", "empirical_sigma_dph")
    for name in names:
        print(f"{name:<24}" + "".join(f"{x:8.2f}" for x in r[name]))


def failures(name, r):
    """What --check objects to."""
    out = []
    if not 0.97 <= r["ratio_range"][0] <= r["ratio_range"][1] <= 1.03:
        out.append(f"{name}: empirical/predicted {r['ratio_range']}")
    for part in ("nees", "nis"):
        if not r[part]["ci95"][0] <= r[part]["mean"] <= r[part]["ci95"][1]:
            out.append(f"{name}: {part} {r[part]}")
    for band, values in r["coverage"].items():
        # 99 % for all temperatures together: 3.4 standard errors each (Bonferroni over 13).
        half = 3.4 * math.sqrt(values["expected"] * (1 - values["expected"]) / r["runs"])
        out += [f"{name}: {band} coverage {x}" for x in values["part"] if abs(x - values["expected"]) > half]
    return out


def markdown(header, rows):
    """A table of a README."""
    return ["| " + " | ".join(row) + " |" for row in [header, ["---"] * len(header), *rows]]


def span(lo, hi, digits=3):
    return f"{lo:.{digits}f} … {hi:.{digits}f}"


def consistency_markdown(rows):
    out = []
    for name, r in rows:
        one, two = (r["coverage"][band]["part"] for band in ("one_sigma", "two_sigma"))
        nees, nis = r["nees"], r["nis"]
        out.append([name, str(r["runs"]), span(*r["ratio_range"]), f"{nees['mean']:.3f} ({span(*nees['ci95'])})",
                    f"{nis['mean']:.4f} ({span(*nis['ci95'], 4)})", span(min(one), max(one)), span(min(two), max(two))])
    return markdown(["campaign", "tests", "empirical/predicted error, 13 temperatures", "NEES (95 % interval)", "NIS (95 % interval)",
                     "1 σ cover", "2 σ cover"], out)


def mismatch_markdown(found):
    """Columns: what the filter assumes, {(sigma, tau): (believed, truth covariance, found)}, tests."""
    results, runs = found
    names = [f"{sigma}, {tau} s" for sigma, tau in results]
    return markdown(["filter assumes", *names], [[name, *(f"{r[i]:.2f}" for r in results.values())]
                    for i, name in enumerate(("it believes", "truth covariance", f"found, {runs} tests"))])


def methods_markdown(result):
    def cell(score):
        return f"{score['worst_dph']:.1f} / {score['rms_dph']:.1f}"
    rows = []
    for scenario in result["scenarios"]:
        coarse = scenario["temp_lsb_degc"] > 0.1
        rows.append([scenario["scenario"].split(",")[0], "1 degC" if coarse else "fine", *(cell(score) for score in scenario["methods"])])
    return markdown(["profile", "thermometer", "Kalman", "least squares", "rising 0.5-degC bins", "rising maximum"], rows)


def mismatch_table(campaigns, runs):
    results = {}
    print("\nA filter that assumes another error model (truth 20 dph, 100 s); worst one-sigma error over temperature, dph")
    print(f"{'filter assumes':<24}{'it believes':>12}{'truth covariance':>18}{'found':>8}{'found/truth':>16}")
    for sigma, tau in ((20, 100), (10, 30), (10, 250), (5, 100), (40, 100), (40, 250)):
        r = campaigns.run(f"mismatch_{sigma}_{tau}", runs, "--core-only", filter_model=filter_model(sigma, tau))
        results[(sigma, tau)] = [max(r[name]) for name in ("predicted_sigma_dph", "truth_sigma_dph", "empirical_sigma_dph")]
        print(f"{sigma:>5} dph, {tau:>4} s       {max(r['predicted_sigma_dph']):>11.2f}{max(r['truth_sigma_dph']):>18.2f}"
              f"{max(r['empirical_sigma_dph']):>8.2f}{r['ratio_to_truth_range'][0]:>9.3f}…{r['ratio_to_truth_range'][1]:.3f}")
    return results, runs


def thermometer_table(campaigns, runs):
    rows = []
    print("\nThermometer with a quantum of 1 degC and 0.02 degC noise; worst one-sigma error over temperature, dph")
    print(f"{'gyro':<24}{'fine thermometer':>18}{'1 degC, tracked':>18}{'1 degC, as read':>18}")
    for name, model in (("10 dph/degC", MODEL), ("100 dph/degC", STEEP)):
        worst = [max(campaigns.run(f"thermometer_{name.split()[0]}_{i}", runs, "--core-only", "--temp-noise-degc", "0.02",
                                   *arguments, model=model)["empirical_sigma_dph"])
                 for i, arguments in enumerate((["--temp-lsb-degc", "0.01"], ["--temp-lsb-degc", "1"],
                                                ["--temp-lsb-degc", "1", "--no-track"]))]
        rows.append([name, *(f"{x:.2f}" for x in worst)])
        print(f"{name:<24}" + "".join(f"{x:18.2f}" for x in worst))
    return markdown(["gyro", "fine thermometer", "1 degC, tracked", "1 degC, as read"], rows)


def method_tables(campaigns, runs):
    for title, name, model in (("Markov 20 dph, 100 s", "compare", MODEL), ("Markov 20 dph, 1000 s", "compare_slow", SLOW)):
        print(f"\nMethods ({title})", flush=True)
        command = [campaigns.program, "compare", "--model", campaigns.write(f"{name}_model", model), "--order", "3", "--runs",
                   str(runs), "--seed", str(campaigns.seed), "--json", str(campaigns.folder / f"{name}.json")]
        subprocess.run(command, check=True)
    return methods_markdown(json.loads((campaigns.folder / "compare.json").read_text()))


def sentences(rows):
    """Figures that stand in the text of that README."""
    double = [r["double_reference"] for _, r in rows[:2]]
    apart = [r["least_squares"]["mean_largest_difference_dph"] for _, r in rows[:2]]
    return [f"- B(T) within {max(d['largest_bias_difference_dph'] for d in double):.1g} dph, "
            f"sigma within {max(d['largest_sigma_difference_rel'] for d in double):.2g}",
            f"- within {max(r['compensation']['largest_error_lsb'] for _, r in rows):.2f} LSB of the table",
            f"- the two differ by {apart[0]:.1f} dph at the worst temperature (order 5: {apart[1]:.1f})"]


def residual_table(r):
    print("\nResidual after compensation, a fresh test of the same device: DP type 2, dph")
    for name, key in (("tau_s", "tau_s"), ("found", "dp_dph"), ("standard error", "std_error_dph"), ("model alone", "model_dph"),
                      ("model + calibration", "expected_dph")):
        print(f"{name:<24}" + "".join(f"{x:9.3f}" if key != "tau_s" else f"{x:9d}" for x in r["residual_dp"][key]))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("program")
    parser.add_argument("--runs", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", default="build/validation")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--save", metavar="FILE.md", help="write the tables as the README shows them")
    parser.add_argument("--short", action="store_true", help="16 tests, and 8 where a whole run takes a quarter: for the tests, to see the same digits again")
    options = parser.parse_args()
    campaigns, few = Campaigns(options.program, options.out, options.seed), max(100, options.runs // 4)
    if options.short:
        options.runs, few = 16, 8
    rows = [("basic profile, order 3", campaigns.run("order3", options.runs)),
            ("basic profile, order 5", campaigns.run("order5", options.runs, order=5)),
            ("order 3, 100 Hz raw samples", campaigns.run("raw100", few, "--core-only", "--rate-hz", "100")),
            ("order 3, jitter, losses, thermometer noise", campaigns.run("flaws", few, "--core-only", *FLAWS))]
    print(f"Calibration error of the C core, basic profile (140 min), seed {options.seed}; 95 % intervals")
    consistency_table(rows)
    print("\nOne-sigma calibration error over temperature, order 3, dph")
    sigma_table(rows[0][1])
    first = rows[0][1]
    print(f"\nKalman filter - least squares: {first['least_squares']['mean_largest_difference_dph']:.2f} dph at the worst temperature "
          f"(mean over tests; order 5: {rows[1][1]['least_squares']['mean_largest_difference_dph']:.2f})")
    print(f"float32 core - double filter: B(T) {max(r['double_reference']['largest_bias_difference_dph'] for _, r in rows[:2]):.3f} "
          f"dph, sigma {max(r['double_reference']['largest_sigma_difference_rel'] for _, r in rows[:2]):.1e} relative, at most")
    print(f"compensation - table: {max(r['compensation']['largest_error_lsb'] for _, r in rows):.2f} LSB at most")
    correlation = [c / h for c, h in zip(first["whiteness"]["correlation"], first["whiteness"]["ci95_half_width"])]
    print(f"innovation correlation at {first['whiteness']['lag_s']} s: "
          + " ".join(f"{c:+.2f}" for c in correlation) + " (in units of its 95 % interval)")
    residual_table(first)
    names = ("order 3", "order 5", "order 3, 100 raw samples/s", "order 3, jitter, 1 % losses")
    tables = [consistency_markdown([(name, r) for name, (_, r) in zip(names, rows)]), mismatch_markdown(mismatch_table(campaigns, few))]
    thermometers = thermometer_table(campaigns, few)
    tables += [method_tables(campaigns, 4 if options.short else max(50, options.runs // 8)), thermometers, sentences(rows)]
    if options.save:
        command = f"make validation RUNS={options.runs}" if not options.short else "the short form of make validation"
        text = "\n\n".join("\n".join(table) for table in tables)
        Path(options.save).write_text(f"<!-- {command}, seed {options.seed}: written by host/scripts/validation.py -->\n{text}\n", encoding="utf-8")
    objections = [text for name, r in rows[:2] for text in failures(name, r)]
    if options.check:
        print("\n" + ("\n".join(objections) if objections else "check: all inside"))
    return 1 if options.check and objections else 0


if __name__ == "__main__":
    sys.exit(main())
