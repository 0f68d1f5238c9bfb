#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Times dp and errormodel against allantools and avar (PyPI) on the same records, and compares the values.

Exits 1 where a value differs by more than 1e-9 relative.  Times are processor times of one thread, the least of several repeats.
"""
import argparse
import contextlib
import importlib.metadata
import io
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
import allantools  # noqa: E402
import avar  # noqa: E402
import numpy as np  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))
import imucal  # noqa: E402


def best_s(repeats, function):
    times = []
    for _ in range(repeats):
        start = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):  # avar draws a progress bar
            value = function()
        times.append(time.process_time() - start)
    return min(times), value


def markov_record(n, seed, sigma=20.0, tau_s=100.0):
    """White noise of 36 dph and a Markov process, as float64."""
    from scipy.signal import lfilter
    rng = np.random.default_rng(seed)
    phi = np.exp(-1 / tau_s)
    drive = sigma * np.sqrt(1 - phi * phi) * rng.standard_normal(n)
    drive[0] = sigma * rng.standard_normal()
    return 36 * rng.standard_normal(n) + lfilter([1], [1, -phi], drive)


def others(x, m, repeats):
    """Overlapping Allan deviation of rates by both packages: (seconds, deviations) each."""
    taus = np.asarray(m, float)
    at_s, at = best_s(repeats, lambda: allantools.oadev(x, rate=1.0, data_type="freq", taus=taus)[1])
    av_s, av = best_s(repeats, lambda: np.sqrt(avar.variance(x, np.asarray(m))))
    return {"allantools": (at_s, at), "avar": (av_s, av)}


def compare(name, ours, x, repeats, report):
    m = np.asarray(ours["tau_s"], int)
    results = others(x - x.mean(), m, repeats)
    print(f"{name:32s} {1e3 * ours['seconds']:10.2f} ms", end="")
    worst = 0
    for package, (seconds, deviation) in results.items():
        n = min(len(deviation), len(m))
        ours_dp = np.asarray(ours["dp_dph"][:n])
        difference = np.nanmax(np.abs(ours_dp / deviation[:n] - 1))
        worst = max(worst, difference)
        print(f"   {package} {1e3 * seconds:9.1f} ms = {seconds / ours['seconds']:6.1f} x, differs {difference:.1e}", end="")
        report[name][package] = {"seconds": seconds, "ratio": seconds / ours["seconds"], "difference": float(difference)}
    print()
    return worst


def recorded_logs(build, data, report):
    worst = 0
    for path in sorted(Path(data).glob("*.csv")):
        log = imucal.read_log(path)
        if np.any(np.diff(log.t_s) != 1):
            print(f"{path.name}: has gaps; allantools knows none")
            continue
        out = subprocess.run([f"{build}/bin/dp", str(path), "--type", "av", "--tau", "octave", "--no-ratios", "--json", "-"],
                             check=True, capture_output=True, text=True).stdout
        for curve in json.loads(out)["curves"]:
            x = log.rates[curve["axis"]]
            deviation = allantools.oadev(x - x.mean(), rate=1.0, data_type="freq", taus=np.asarray(curve["tau_s"]))[1]
            difference = float(np.max(np.abs(np.asarray(curve["dp_dph"])[:len(deviation)] / deviation - 1)))
            print(f"{path.name:24s} {curve['axis']:8s} {len(deviation)} taus, differs from allantools by {difference:.1e}")
            report.setdefault("recorded", []).append({"log": path.name, "axis": curve["axis"], "difference": difference})
            worst = max(worst, difference)
    return worst


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", default="build")
    parser.add_argument("--data", default="../shared/data")
    parser.add_argument("--samples", type=int, default=10_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json")
    args = parser.parse_args()
    record, extended = markov_record(6000, args.seed), markov_record(args.samples, args.seed + 1)
    with tempfile.TemporaryDirectory() as folder:
        record.tofile(f"{folder}/short.f64")
        extended.tofile(f"{folder}/long.f64")
        ours = json.loads(subprocess.run([f"{args.build}/tests/bench_dp", f"{folder}/short.f64", f"{folder}/long.f64", str(args.repeats)],
                                         check=True, capture_output=True, text=True).stdout)
    report = {name: {"seconds": value["seconds"]} for name, value in ours.items()}
    print("; ".join(f"{p} {importlib.metadata.version(p)}" for p in ("allantools", "avar", "numpy")), f"; seed {args.seed}; one thread")
    worst = compare("av_300_taus_6000", ours["av_300_taus_6000"], record, 3 * args.repeats, report)
    for name in ("dp2_300_taus_6000", "bound_2_terms_599_taus", "ls_2_terms_599_taus", "ml_1_term_6000"):
        print(f"{name:32s} {1e3 * ours[name]['seconds']:10.2f} ms   (nothing to compare with)")
    worst = max(worst, compare("av_octave_1e6", ours["av_octave_1e6"], extended[:1000000], args.repeats, report))
    worst = max(worst, compare("av_octave_1e7", ours["av_octave_1e7"], extended, 1 if args.samples > 2_000_000 else args.repeats, report))
    worst = max(worst, recorded_logs(args.build, args.data, report))
    print(f"largest relative difference {worst:.1e} (allowed 1e-9)")
    if args.json:
        Path(args.json).write_text(json.dumps({"seed": args.seed, **report}, indent=1) + "\n")
    return 0 if worst < 1e-9 else 1


if __name__ == "__main__":
    sys.exit(main())
