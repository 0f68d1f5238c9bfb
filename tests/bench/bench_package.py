# SPDX-License-Identifier: MIT
"""allan_deviation on a million samples against the same work in C++ (build/tests/bench_dp): least processor time of some runs,
and the median ratio of turns in which both ran one after the other.

    bench_package.py --build DIR
"""
import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "host/python"))
REPEATS = 9
TURNS = 7


def least_s(work):
    """Least processor time of some runs, after one that loads the library."""
    times = []
    for _ in range(REPEATS + 1):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times[1:])


def turn(imucal, build, short, long, rate):
    """Both one after the other: seconds of the C++ curve, of curve and intervals, of the package's call."""
    done = subprocess.run([build / "tests/bench_dp", short, long, str(REPEATS), "package"], check=True, capture_output=True, text=True)
    answer = json.loads(done.stdout)
    curve = answer["av_octave_1e6"]
    found = imucal.allan_deviation(rate, tau_s=curve["tau_s"])
    if not np.allclose(found.adev_dph, curve["dp_dph"], rtol=1e-9) or len(curve["tau_s"]) != 19:
        raise SystemExit("the two disagree")
    python_s = least_s(lambda: imucal.allan_deviation(rate, tau_s=curve["tau_s"]))
    return curve["seconds"], answer["av_octave_1e6_intervals"]["seconds"], python_s


def main():
    """Print both times and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", default="build")
    build = Path(parser.parse_args().build).resolve()
    os.environ["IMUCAL_BIN"] = str(build / "bin")
    import imucal
    rate = np.random.default_rng(1).normal(0, 36, 1_000_000)
    with tempfile.TemporaryDirectory() as folder:
        short, long = Path(folder) / "short.f64", Path(folder) / "long.f64"
        rate[:6000].tofile(short)
        rate.tofile(long)
        turns = [turn(imucal, build, short, long, rate) for _ in range(TURNS)]
    curve_s, cpp_s, python_s = (min(t[k] for t in turns) for k in range(3))
    ratios = sorted(t[2] / t[1] for t in turns)
    print(f"Allan deviation with intervals, 1e6 samples, 19 taus: C++ {1e3 * cpp_s:.1f} ms (the curve alone, its samples copied before, "
          f"{1e3 * curve_s:.1f} ms), Python {1e3 * python_s:.1f} ms: {python_s / cpp_s:.2f} times; in {TURNS} turns {ratios[0]:.2f} to "
          f"{ratios[-1]:.2f}, median {ratios[TURNS // 2]:.2f}")


if __name__ == "__main__":
    main()
