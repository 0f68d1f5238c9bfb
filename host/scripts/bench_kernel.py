#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The overlapping Allan deviation alone, array to array, in one process: imucal.allan_deviation (without its intervals) and
allantools.oadev (which has none) take turns on the same record, at the same taus.

Prints least processor times of the turns and the median of their ratios; exits 1 where a value differs by more than 1e-9
relative.  One thread."""
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
import allantools  # noqa: E402
import numpy as np  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))
import imucal  # noqa: E402

# (samples, taus, turns, at least as many times as fast as asked for; None: for comparison)
ROWS = [(10_000_000, "octave", 3, 15), (10_000_000, np.unique(np.geomspace(1, 1_000_000, 34).astype(int)), 2, None),
        (1_000_000, np.unique(np.geomspace(1, 300_000, 400).astype(int))[:300], 3, 10), (6000, np.arange(2, 602, 2), 5, 10)]


def once(function):
    """Processor seconds and value."""
    start = time.process_time()
    value = function()
    return time.process_time() - start, value


def row(n, taus, turns, wanted):
    """One comparison; whether the values agree."""
    rate = np.random.default_rng(n).normal(0, 36, n) + 3
    imucal.allan_deviation(rate[:4000])
    m = imucal.allan_deviation(rate, tau_s=taus).tau_s
    ours, theirs = [], []
    for _ in range(turns):
        seconds, curve = once(lambda: imucal.allan_deviation(rate, tau_s=m, intervals=False))
        ours.append(seconds)
        seconds, other = once(lambda: allantools.oadev(rate, rate=1.0, data_type="freq", taus=m)[1])
        theirs.append(seconds)
    worst = float(np.max(np.abs(curve.adev_dph / other - 1)))
    ratio = float(np.median(np.array(theirs) / np.array(ours)))
    asked = f"asked for: {wanted}" if wanted else ""
    print(f"kernel, {n:>10,} samples, {len(m):3d} taus: allantools {1e3 * min(theirs):9.1f} ms, imucal {1e3 * min(ours):7.1f} ms, {ratio:5.1f} times; "
          f"values within {worst:.0e}   {asked}", flush=True)
    return worst < 1e-9


def main():
    """Print the rows."""
    print(f"allantools {allantools.__version__}, numpy {np.__version__}")
    return 0 if all([row(*r) for r in ROWS]) else 1


if __name__ == "__main__":
    sys.exit(main())
