# SPDX-License-Identifier: MIT
"""allan_deviation on a million samples against the same work in C++ (build/tests/bench_dp), least processor time of some runs.

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


def least_s(work):
    """Least processor time of some runs, after one that loads the library."""
    times = []
    for _ in range(REPEATS + 1):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times[1:])


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
        done = subprocess.run([build / "tests/bench_dp", short, long, str(REPEATS)], check=True, capture_output=True, text=True)
    answer = json.loads(done.stdout)
    curve, cpp_s = answer["av_octave_1e6"], answer["av_octave_1e6_intervals"]["seconds"]
    found = imucal.allan_deviation(rate, tau_s=curve["tau_s"])
    if not np.allclose(found.adev_dph, curve["dp_dph"], rtol=1e-9):
        raise SystemExit("the two disagree")
    ours = least_s(lambda: imucal.allan_deviation(rate, tau_s=curve["tau_s"]))
    print(f"Allan deviation with intervals, 1e6 samples, {len(curve['tau_s'])} taus: C++ {1e3 * cpp_s:.1f} ms (the curve alone "
          f"{1e3 * curve['seconds']:.1f} ms), Python {1e3 * ours:.1f} ms: {ours / cpp_s:.2f} times")


if __name__ == "__main__":
    main()
