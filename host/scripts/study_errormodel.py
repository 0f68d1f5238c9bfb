#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""What dp and errormodel can tell, measured by simulation; with --check the stated figures are demanded (make test-long).

Prints: closed form against 10^6 simulated samples; separation of the operators; bounds of the paper's two models over many
tests; maximum likelihood over many tests and on 10^6 samples.  Seeds are printed; minutes on one core.
"""
import argparse
import json
import subprocess
import sys
from pathlib import Path

NOMINAL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}]}
FIG18 = {"imucal_model": 1, "arw_deg_rt_h": 1.1, "markov": [{"sigma_dph": 14, "tau_s": 20}, {"sigma_dph": 14, "tau_s": 70}]}
FIG21 = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 18, "tau_s": 25}, {"sigma_dph": 17, "tau_s": 60}]}
OTHER = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 50}]}


class Study:
    def __init__(self, build, seed, threads):
        self.bin, self.seed, self.threads = Path(build) / "bin", seed, threads
        self.folder = Path(build) / "studies"
        self.folder.mkdir(parents=True, exist_ok=True)
        self.failures = []
        self.paths = {}
        for name, model in (("nominal", NOMINAL), ("fig18", FIG18), ("fig21", FIG21), ("other", OTHER)):
            self.paths[name] = self.folder / f"{name}.json"
            self.paths[name].write_text(json.dumps(model))

    def run(self, *args):
        done = subprocess.run([str(self.bin / args[0]), *map(str, args[1:])], capture_output=True, text=True)
        if done.returncode not in (0, 1):
            sys.exit(f"{args}: {done.stderr}")
        return done.stdout

    def json(self, *args):
        return json.loads(self.run(*args, "--json", "-"))

    def demand(self, holds, statement):
        print(("  ok      " if holds else "  FAILED  ") + statement)
        if not holds:
            self.failures.append(statement)

    def long_log(self, name, n):
        profile = self.folder / "long_profile.json"
        profile.write_text(json.dumps({"imucal_profile": 1, "start_degc": 30, "segments": [{"rate_degc_per_min": 0, "duration_s": n}]}))
        log = self.folder / f"{name}_{n}.csv"
        self.run("gyrosim", "log", "--model", self.paths[name], "--profile", profile, "--seed", self.seed, "-o", log)
        return log


def closed_form(study, n=1_000_000):
    print(f"closed form against {n} simulated samples, tau 2 ... 100 s (seed {study.seed}), largest relative difference:")
    for name in ("nominal", "fig18", "fig21"):
        log = study.long_log(name, n)
        for kind in ("av", "dp1", "dp2", "dp3"):
            tau = "2,3,5,10,20,50,100"
            r = study.json("dp", log, "--type", kind, "--nominal", study.paths["nominal"], "--tau", tau, "--no-ratios",
                           "--ci-model", study.paths[name])["curves"][0]
            e = study.json("errormodel", "expect", study.paths[name], "--type", kind, "--nominal", study.paths["nominal"], "--tau", tau)
            worst = max(abs(a / b - 1) for a, b in zip(r["dp_dph"], e["dp_dph"]))
            inside = sum(lo <= b <= hi for (lo, hi), b in zip(r["ci95_dph"], e["dp_dph"]))
            study.demand(worst < 0.01, f"{name} {kind}: {100 * worst:.2f} % (closed form inside the 95 % interval at {inside} of 7 tau)")
        log.unlink()


def separations(study, draws):
    for tau in ("2:600", "2:200"):
        r = study.json("errormodel", "separation", "--model", study.paths["nominal"], "--versus", study.paths["other"], "--nominal",
                       study.paths["nominal"], "--draws", draws, "--seed", study.seed, "--tau", tau, "--threads", study.threads)
        print(f"longest separated stretch, 5+5 tests of 6000 s, {draws} draws, tau {tau} s (seed {study.seed}); the paper's one draw: 80, 140, 75 s")
        for kind, t in r["types"].items():
            s = t["spread"]
            print(f"  {kind:4s} mean {s['mean']:.0f} s, sd {s['sd']:.0f}, 5 % {s['q05']:.0f}, median {s['median']:.0f}, 95 % {s['q95']:.0f}")
    spread = {kind: t["spread"]["mean"] for kind, t in r["types"].items()}
    study.demand(spread["dp2"] > 1.3 * max(spread["av"], spread["dp3"]), "within 200 s DP2 separates over the longest stretch")


def bounds(study, runs):
    for name in ("fig18", "fig21"):
        r = study.json("errormodel", "validate", "--model", study.paths[name], "--criterion", "bound", "--markov", 2, "--nominal",
                       study.paths["nominal"], "--runs", runs, "--tau", "2:600", "--seed", study.seed, "--threads", study.threads)
        e, w = r["excess_mean"], r["excess_worst"]
        print(f"{name}: {runs} tests of 6000 s, two Markov terms, tau 2 ... 600 s: mean excess median {100 * e['median']:.2f} % "
              f"(5 ... 95 %: {100 * e['q05']:.2f} ... {100 * e['q95']:.2f}), worst excess median {100 * w['median']:.2f} %; "
              f"objective over the grid's: median {r['objective_over_grid']['median']:.3f}; {r['fit_ms']['median']:.0f} ms per fit")
        print(f"  bounds the truth's curve in {100 * r['bounds_truth_frac']:.0f} %, a new test in {100 * r['bounds_new_frac']:.0f} % "
              f"(smallest ratio there: median {r['new_worst_ratio']['median']:.3f}, 5 % {r['new_worst_ratio']['q05']:.3f})")
        study.demand(r["bounded_frac"] > 1 - 1e-9, f"{name}: bounds its own test in every run")


def likelihood(study, runs):
    r = study.json("errormodel", "validate", "--model", study.paths["nominal"], "--criterion", "ml", "--markov", 1, "--nominal",
                   study.paths["nominal"], "--runs", runs, "--tau", "2:600:50", "--seed", study.seed, "--threads", study.threads)
    print(f"maximum likelihood, nominal model, {runs} tests of 6000 s (seed {study.seed}), {r['fit_ms']['median']:.0f} ms per fit")
    for p in r["parameters"]:
        print(f"  {p['name']:20s} rms error of ln {p['rms_log_error']:.3f}, mean {p['log_error']['mean']:+.3f}, 95 % intervals cover {100 * p['coverage95']:.1f} %")
    study.demand(r["parameters"][2]["rms_log_error"] <= 0.26, "rms error of ln(tau) at most 0.26")
    half_width = 3 * (0.95 * 0.05 / runs) ** 0.5
    study.demand(all(abs(p["coverage95"] - 0.95) < half_width for p in r["parameters"]), f"coverage within 3 standard errors ({half_width:.3f}) of 95 %")


def million(study, n=1_000_000):
    for name, terms in (("nominal", 1), ("fig18", 2)):
        log = study.long_log(name, n)
        r = study.json("errormodel", "fit", log, "--criterion", "ml", "--markov", terms, "--tau", "log:2:600:10")
        log.unlink()
        print(f"{name}, {n} samples: {r['model']['arw_deg_rt_h']:.4f} deg/sqrt(h); " + ", ".join(
            f"{m['sigma_dph']:.2f} deg/h at {m['tau_s']:.1f} s" for m in r["model"]["markov"]))
        truth = json.loads(study.paths[name].read_text())
        values = [truth["arw_deg_rt_h"]] + [v for m in truth["markov"] for v in (m["sigma_dph"], m["tau_s"])]
        off = max(abs(p["value"] - v) / p["std_error"] for p, v in zip(r["parameters"], values))
        study.demand(off < 4, f"{name}: every parameter within {off:.1f} standard errors of the truth: no wrong optimum")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", default="build")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--check", action="store_true", help="exit 1 where a stated figure is missed")
    args = parser.parse_args()
    study = Study(args.build, args.seed, args.threads)
    closed_form(study)
    separations(study, args.draws)
    bounds(study, args.runs)
    likelihood(study, args.runs)
    million(study)
    return 1 if args.check and study.failures else 0


if __name__ == "__main__":
    sys.exit(main())
