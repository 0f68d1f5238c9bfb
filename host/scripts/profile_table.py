# SPDX-License-Identifier: MIT
"""Table of bounds, best profiles and efficiencies: 100, 140, 240, 480 min at 0.6 and 2 degC/min (model 0.6
deg/sqrt(h), 20 dph, 100 s; order 3; 0..60 degC).  Runs the program PROFILE."""
import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile

MODEL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}]}


def program(*args):
    """The result of the program PROFILE; ends the script where there is none."""
    path = os.environ.get("PROFILE", "build/bin/profile")
    try:
        done = subprocess.run([path, *map(str, args), "--json", "-"], capture_output=True, text=True)
    except OSError as error:
        sys.exit(f"{path}: cannot be run: {error.strerror}; build it (make host) and name it: PROFILE=build/bin/profile")
    if done.returncode > 1:
        sys.exit(done.stderr)
    return json.loads(done.stdout)


def timed(*args):
    """The same, and its processor seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    result = program(*args)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return result, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def ramp_and_soak(rate_degc_per_min, soak_s):
    return {"imucal_profile": 1, "start_degc": 0, "repeat": 1, "segments": [
        {"rate_degc_per_min": 0, "duration_s": soak_s}, {"rate_degc_per_min": rate_degc_per_min, "to_degc": 60},
        {"rate_degc_per_min": 0, "duration_s": soak_s}]}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--markdown", action="store_true")
    options = parser.parse_args()
    folder = tempfile.mkdtemp()
    model = os.path.join(folder, "model.json")
    with open(model, "w") as file:
        json.dump(MODEL, file)
    base = ("--model", model, "--order", 3)
    head = ["min", "degC/min", "slow-ramp bound", "proven bound", "best found", "of slow", "of proven",
            "1 ramp+soaks", "of slow", "n ramps+soaks", "of slow", "told apart", "corr", "cost"]
    rows, best_s, apart_s = [], [], []
    for rate in (0.6, 2.0):
        for minutes in (100, 140, 240, 480):
            request = ("optimize", *base, "--range", "0:60", "--max-rate", rate, "--duration-s", 60 * minutes,
                       "--seed", options.seed)
            best, took_s = timed(*request)
            best_s.append(took_s)
            apart, took_s = timed(*request, "--tell-apart", "all", "--no-proof")
            apart_s.append(took_s)
            path = os.path.join(folder, "paper.json")
            with open(path, "w") as file:
                json.dump(ramp_and_soak(rate, (60 * minutes - 3600 / rate) / 2), file)
            one = program("error", path, *base)
            paper = best["paper"]
            rows.append([minutes, rate, best["bound_dph"], best["proven_bound_dph"], best["worst_dph"],
                         best["efficiency"], best["proven_efficiency"], one["worst_dph"], one["efficiency"],
                         f"{paper['worst_dph']:.3f} ({paper['passes']})", paper["efficiency"], apart["worst_dph"],
                         apart["worst_correlation"], apart["worst_dph"] / best["worst_dph"] - 1])
    percent = {5, 6, 8, 10, 13}
    cells = [[f"{100 * v:.1f} %" if i in percent else v if isinstance(v, str) else f"{v:g}" if i < 2 else f"{v:.3f}"
              for i, v in enumerate(row)] for row in rows]
    widths = [max(len(r[i]) for r in [head, *cells]) for i in range(len(head))]
    join = " | " if options.markdown else "  "
    for n, row in enumerate([head, *cells]):
        line = join.join(v.rjust(w) for v, w in zip(row, widths))
        print(f"| {line} |" if options.markdown else line)
        if n == 0 and options.markdown:
            print("|" + "|".join("-" * (w + 1) + ":" for w in widths) + "|")
    print(f"\nErrors in dph, worst one-sigma over 0..60 degC, order 3, seed {options.seed}.  'n ramps+soaks (n)': best "
          "number of passes with equal soaks.\n'told apart': lag, dT/dt, hysteresis, turn-on, ageing, 4th order with "
          "correlation at most 0.75; cost against 'best found'.")
    print(f"Processor time, the longest of the cases: optimize {max(best_s):.2f} s, with --tell-apart all {max(apart_s):.2f} s.")


if __name__ == "__main__":
    main()
