#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""How often the 95 % intervals of `errormodel fit` hold the truth where the expectation is found on a coarse record:
simulated long records whose rate was freed of a cubic in temperature, intervals by refits of simulated curves.

usage: coverage_bootstrap.py ERRORMODEL [--draws N] [--seed N] [--criterion ls|bound] [--size N]
Each draw has refits of its own (--seed of errormodel): the same refits for all draws would share their luck.
Prints a line per parameter: covered, of draws, with the 95 % Clopper-Pearson interval.  Exit status 1 where that interval
lies wholly below 0.95."""
import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from scipy.stats import binomtest

sys.path.insert(0, str(Path(__file__).resolve().parent))
from bench_whole import write_log  # pylint: disable=wrong-import-position

TRUTH = {"arw_deg_rt_h": 0.6, "markov[0].sigma_dph": 20.0, "markov[0].tau_s": 100.0}


def fitted(program, path, criterion, seed):
    command = [program, "fit", path, "--markov", "1", "--criterion", criterion, "--detrend", "poly:3", "--threads", "1",
               "--seed", str(seed), "--quiet", "--json", "-"]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)["parameters"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("program")
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--criterion", choices=["ls", "bound"], default="ls")
    parser.add_argument("--size", type=int, default=70_000, help="samples of a record, 1 s each; coarse from 65,536 on")
    options = parser.parse_args()
    covered = dict.fromkeys(TRUTH, 0)
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/draw.csv"
        for draw in range(options.draws):
            write_log(path, options.size, 1.0, ["gx_dph"], 36.0, [options.seed, draw])
            for parameter in fitted(options.program, path, options.criterion, 1000 * options.seed + draw):
                lo, hi = parameter["ci95"]
                covered[parameter["name"]] += lo <= TRUTH[parameter["name"]] <= hi
    is_low = False
    for name, k in covered.items():
        lo, hi = binomtest(k, options.draws).proportion_ci(0.95, "exact")
        is_low = is_low or hi < 0.95
        print(f"{options.criterion}, {options.size} samples, poly:3: {name:20s} {k} of {options.draws} intervals hold the truth "
              f"[{lo:.2f}, {hi:.2f}]", flush=True)
    return 1 if is_low else 0


if __name__ == "__main__":
    sys.exit(main())
