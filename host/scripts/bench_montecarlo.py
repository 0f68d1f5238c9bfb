#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Throughput of the whole chain (simulate, raw counts, 1-s sums, Kalman filter, score) in simulated seconds per second
and core: the C core in `montecarlo` against the same chain in numpy + scipy, measured in one run on this machine.

usage: bench_montecarlo.py MONTECARLO [--runs N] [--rate-hz N] [--json FILE]

The fair peer is numpy with the runs batched through one shared covariance, at the batch size that suits it best: it only works
while no second is missing.  Beside it numpy test by test, as the core runs.  Processor time, the best of some rounds: it is not
free of other load, which takes caches and half of a core's units."""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

ARW, SIGMA, TAU, ORDER, PRIOR, SCALE, TEMP_LSB = 0.6, 20.0, 100.0, 3, 1e4, 1.0, 0.01
COEFF = np.array([80.0, 300.0, 150.0, -100.0])
SOAK_S, RATE_DEGC_S = 1200, 0.01


def temperatures():
    ramp = (np.arange(6000) + 0.5) * RATE_DEGC_S
    return np.concatenate([np.zeros(SOAK_S), ramp, np.full(SOAK_S, 60.0)])


def simulate_means(rng, temp, rate_hz, n_runs=1):
    """Raw counts at rate_hz, quantised, summed to 1-s means: rates [n_runs, n] and temperatures [n]."""
    n, phi = len(temp), np.exp(-1 / TAU)
    drive = rng.standard_normal((n_runs, n)) * SIGMA * np.sqrt(1 - phi * phi)
    drive[:, 0] = SIGMA * rng.standard_normal(n_runs)
    rate = lfilter([1], [1, -phi], drive, axis=1) + np.polyval(COEFF[::-1], (temp - 30) / 30)
    raw = rate[:, :, None] + 60 * ARW * np.sqrt(rate_hz) * rng.standard_normal((n_runs, n, rate_hz))
    counts = np.rint(raw / SCALE).astype(np.int64)
    temp_counts = np.rint((np.repeat(temp[:, None], rate_hz, axis=1) - 25) / TEMP_LSB).astype(np.int64)
    return counts.sum(axis=2) * (SCALE / rate_hz), temp_counts.sum(axis=1) * (TEMP_LSB / rate_hz) + 25


def kalman(z, temp, rate_hz):
    """z [n_runs, n]; one covariance for all.  Returns coefficients [n_runs, p] and their covariance."""
    p = ORDER + 1
    h_all = np.ones((len(temp), p + 1))
    h_all[:, :p] = np.vander((temp - 30) / 30, p, increasing=True)
    phi = np.exp(-1 / TAU)
    q, r = SIGMA**2 * (1 - phi * phi), (60 * ARW)**2 + SCALE**2 / 12 / rate_hz
    cov = np.diag([PRIOR**2] * p + [SIGMA**2])
    x = np.zeros((len(z), p + 1))
    # The innovation statistics that the core keeps.
    nis, weighted, inverse, lag1, last = 0.0, 0.0, 0.0, 0.0, 0.0
    for k, h in enumerate(h_all):
        x[:, p] *= phi
        cov[p] *= phi
        cov[:, p] *= phi
        cov[p, p] += q
        ph = cov @ h
        s = h @ ph + r
        gain = ph / s
        innovation = z[:, k] - x @ h
        normalised = innovation / s
        nis = nis + innovation * normalised
        weighted = weighted + normalised
        inverse += 1 / s
        lag1 = lag1 + last * normalised
        last = innovation
        x += np.outer(innovation, gain)
        cov -= np.outer(gain, ph)
    return x[:, :p], cov[:p, :p], (nis, weighted, inverse, lag1)


def numpy_chain(n_runs, batch, rate_hz):
    """Simulated seconds per second of processor time, and the predicted sigma at 60 degC."""
    temp, rng = temperatures(), np.random.default_rng(1)
    start = time.process_time()
    for _ in range(n_runs // batch):
        z, measured = simulate_means(rng, temp, rate_hz, batch)
        _, cov, _ = kalman(z, measured, rate_hz)
    spent = time.process_time() - start
    return n_runs * len(temp) / spent, float(np.sqrt(np.ones(4) @ cov @ np.ones(4)))


def numpy_best(rate_hz):
    """(simulated seconds per second, batch size): the best of some batch sizes, two rounds each."""
    sizes = [max(2, n // rate_hz) for n in (500, 1000, 2000, 4000)]
    return max((numpy_chain(n, n, rate_hz)[0], n) for n in sizes * 2)


def core_chain(program, folder, n_runs, rate_hz, threads):
    model = {"imucal_model": 1, "arw_deg_rt_h": ARW, "markov": [{"sigma_dph": SIGMA, "tau_s": TAU}],
             "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": COEFF.tolist()}}
    soak = {"rate_degc_per_min": 0, "duration_s": SOAK_S}
    profile = {"imucal_profile": 1, "start_degc": 0, "segments": [soak, {"rate_degc_per_min": 0.6, "to_degc": 60}, soak]}
    for name, content in (("model", model), ("profile", profile)):
        (folder / f"{name}.json").write_text(json.dumps(content))
    command = [program, "--model", str(folder / "model.json"), "--profile", str(folder / "profile.json"), "--order", "3",
               "--runs", str(n_runs), "--core-only", "--rate-hz", str(rate_hz), "--threads", str(threads), "--json", "-"]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("program")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--rate-hz", type=int, nargs="*", default=[10, 100])
    parser.add_argument("--json")
    options = parser.parse_args()
    results = []
    with tempfile.TemporaryDirectory() as name:
        for rate_hz in options.rate_hz:
            n = max(10, options.runs * 10 // rate_hz)
            rounds = [core_chain(options.program, Path(name), n, rate_hz, 1) for _ in range(5)]
            one = max(rounds, key=lambda result: result["samples_per_s_per_core"])
            both = [core_chain(options.program, Path(name), 2 * n, rate_hz, 2) for _ in range(5)]
            two = max(both, key=lambda result: result["samples_per_s_per_core"])
            batched, batch = numpy_best(rate_hz)
            single, sigma = numpy_chain(3, 1, rate_hz)
            if abs(one["predicted_sigma_dph"][-1] / sigma - 1) > 1e-3:
                sys.exit(f"the chains disagree: sigma {one['predicted_sigma_dph'][-1]} and {sigma} dph")
            core = one["samples_per_s_per_core"]
            results.append({"rate_hz": rate_hz, "core_per_s": core, "numpy_batched_per_s": batched, "numpy_batch": batch,
                            "fair_ratio": core / batched, "numpy_per_s": single, "ratio": core / single,
                            "two_threads_wall": max(b["samples_per_s"] for b in both) / max(r["samples_per_s"] for r in rounds),
                            "two_threads_cpu": two["samples_per_s_per_core"] / core})
            print(f"{rate_hz:4d} raw samples per second: core {core:.3g} simulated s per s and core, {core / batched:.1f} times numpy "
                  f"in its best batches ({batch} runs, {batched:.3g}), {core / single:.0f} times numpy + scipy run by run "
                  f"({single:.3g}); two threads {results[-1]['two_threads_wall']:.2f} times one (wall; on two idle cores, by "
                  f"processor time, {2 * results[-1]['two_threads_cpu']:.2f})")
    if options.json:
        Path(options.json).write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
