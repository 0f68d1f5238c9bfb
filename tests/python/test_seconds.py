# SPDX-License-Identifier: MIT
"""Seconds, flags and means against the C core's own summation (common/sum.c), bit for bit."""
import ctypes
import subprocess

import numpy as np
import pytest

from imucal import seconds, still
from imucal.seconds import cut_seconds, in_order, keep_in_order, nominal_rate_hz, unwrap
from where import ROOT

PROBE = r"""
#include "sum.h"
/* Feeds samples of one channel; returns the number of seconds. */
int probe(int n, const long long* t_us, const int* counts, int rate_hz, float scale, long long* end_s, float* mean, int* flags, int* gap, int* dropped) {
  imucal_sum_t sum; imucal_second_t s; int m = 0;
  if (imucal_sum_init(&sum, 1, (unsigned)rate_hz) != IMUCAL_OK) return -1;
  for (int i = 0; i <= n; i++) {
    imucal_status status;
    if (i < n) { imucal_sample_t x = {0}; x.t_us = (unsigned long long)t_us[i]; x.n_channels = 1; x.counts[0] = counts[i]; status = imucal_sum_add(&sum, &x, &s); }
    else status = imucal_sum_flush(&sum, &s);
    if (status != IMUCAL_SECOND_READY) continue;
    end_s[m] = s.t_s; flags[m] = s.flags[0]; gap[m] = s.is_gap;
    mean[m++] = imucal_unit_from_q16(imucal_mean_q16_rne(s.sum[0], s.n_samples), scale, 0.0f);
  }
  dropped[0] = (int)sum.n_duplicate; dropped[1] = (int)sum.n_backward;
  return m;
}
"""


@pytest.fixture(scope="module")
def core(tmp_path_factory):
    folder = tmp_path_factory.mktemp("core")
    (folder / "probe.c").write_text(PROBE)
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-std=c99", "-ffp-contract=off", f"-I{ROOT / 'common'}", str(folder / "probe.c"),
                    *map(str, (ROOT / "common" / n for n in ("sum.c", "num.c"))), "-o", str(folder / "probe.so")], check=True)
    return ctypes.CDLL(str(folder / "probe.so"))


def by_core(core, t_us, counts, rate_hz, scale):
    n = len(t_us)
    t, c = np.ascontiguousarray(t_us, np.int64), np.ascontiguousarray(counts, np.int32)
    end, mean, flags, gap, dropped = np.zeros(n, np.int64), np.zeros(n, np.float32), np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(2, np.int32)
    pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (end, mean, flags, gap, dropped)]
    m = core.probe(n, t.ctypes.data_as(ctypes.c_void_p), c.ctypes.data_as(ctypes.c_void_p), rate_hz, ctypes.c_float(scale), *pointers)
    return end[:m], mean[:m].astype(float), flags[:m], gap[:m].astype(bool), dropped


@pytest.mark.parametrize("seed", range(12))
def test_seconds_of_any_stream_equal_the_core(core, seed):
    rng = np.random.default_rng(seed)
    rate = int(rng.choice([1, 2, 3, 10, 37, 100, 400]))
    n = 40 * rate
    t = (np.arange(n) / rate + rng.uniform(0, 3) + rng.uniform(-0.7, 0.7, n) / rate * rng.choice([0.1, 1, 2])).clip(0) * 1e6
    t_us = np.rint(t).astype(np.int64)[rng.uniform(size=n) > rng.choice([0, 0.02, 0.3])]
    t_us = t_us[(t_us < 12e6) | (t_us > 12e6 + rng.integers(0, 6) * 1e6)]
    t_us[rng.integers(1, len(t_us), 3)] -= 1_500_000 * (t_us.min() > 2_000_000)
    t_us = t_us[t_us >= 0]
    t_us = np.repeat(t_us, 1 + (rng.uniform(size=len(t_us)) < 0.02))
    counts = rng.integers(-2 ** 31, 2 ** 31, len(t_us))
    end, mean, flags, gap, dropped = by_core(core, t_us, counts, rate, 18.25)
    keep, n_duplicate, n_backward = keep_in_order(t_us)
    seconds = cut_seconds(t_us[keep], rate)
    np.testing.assert_array_equal(seconds.end_s, end)
    np.testing.assert_array_equal(np.where(seconds.is_missing, 2, 0), flags)
    np.testing.assert_array_equal(seconds.is_gap, gap)
    np.testing.assert_array_equal(seconds.mean_of_counts(counts[keep], 18.25), mean)
    assert (n_duplicate, n_backward) == tuple(dropped)


def test_counter_of_32_bits_goes_on_over_its_wrap():
    ticks = (np.arange(0, 10 ** 10, 10 ** 8) + 2 ** 31) % 2 ** 32
    assert np.all(np.diff(unwrap(ticks, 32)) == 10 ** 8)


@pytest.mark.parametrize("rate_hz", [1, 5, 50, 104, 200, 1000])
def test_nominal_rate_stands_jitter_losses_and_gaps(rate_hz):
    rng = np.random.default_rng(rate_hz)
    t = (np.arange(60 * rate_hz) + 0.2 * rng.uniform(-1, 1, 60 * rate_hz)) / rate_hz
    t = t[(rng.uniform(size=len(t)) > 0.02) & ~((t > 20) & (t < 31))]
    assert nominal_rate_hz(np.rint(t * 1e6 + 1e6).astype(np.int64)) == pytest.approx(rate_hz, rel=0.03)


def test_times_in_order_each_once():
    t = np.array([5, 7, 7, 3, 9, -2, 9], np.int64)
    assert in_order(t).tolist() == [-2, 3, 5, 7, 9] and in_order(t[:0]).tolist() == [] and in_order(t[:1]).tolist() == [5]
    assert nominal_rate_hz(np.sort(np.concatenate([1_000_000 * np.repeat(np.arange(9), 50) + np.tile(np.arange(50) * 2000, 9)]))) == 50


def awkward_times(rng):
    """Increasing times with jitter, gaps and bursts."""
    steps = rng.choice([1, 900, 10_000, 10_001, 33_000, 2_500_000], int(rng.integers(2, 3000)), p=[0.1, 0.2, 0.4, 0.2, 0.09, 0.01])
    return np.cumsum(steps).astype(np.int64) + int(rng.integers(0, 3_000_000))


@pytest.mark.parametrize("seed", range(30))
def test_the_compiled_part_finds_what_numpy_finds(seed, monkeypatch):
    core = pytest.importorskip("imucal._core")
    rng = np.random.default_rng(seed)
    t_us = awkward_times(rng)
    values = rng.normal(1e4, 3.0, (len(t_us), 3))
    cut = cut_seconds(t_us, 100)
    width = int(rng.choice([1, 3, 61]))
    mean, std = cut.mean_and_std(values)
    medians, rate = still.running_median(np.round(values), width), nominal_rate_hz(t_us)
    np.testing.assert_allclose(mean, cut.mean(values), rtol=1e-13)  # the order of the sums may differ
    assert core.steps_and_counts(t_us)[1].sum() == len(t_us)
    monkeypatch.setattr(seconds, "_core", None)
    monkeypatch.setattr(still, "_core", None)
    np.testing.assert_allclose(std, cut.mean_and_std(values)[1], rtol=1e-9, atol=1e-11)
    np.testing.assert_array_equal(medians, still.running_median(np.round(values), width))
    assert rate == nominal_rate_hz(t_us)


def test_times_that_do_not_increase_and_wrong_seconds_are_refused_by_the_compiled_part():
    core = pytest.importorskip("imucal._core")
    assert core.steps_and_counts(np.array([1, 3, 3])) is None and core.steps_and_counts(np.array([-1, 3])) is None
    for first, n in ((-1, 1), (0, 0), (3, 2), (5, 1)):
        with pytest.raises(ValueError):
            core.spread_of_seconds(np.zeros((4, 2)), np.array([first]), np.array([n]))
