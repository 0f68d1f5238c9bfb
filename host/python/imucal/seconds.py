# SPDX-License-Identifier: MIT
"""1-s means of samples, by the rules of the C core's summation (common/sum.h).

Second k holds the samples with k <= t < k+1 and ends at t_s = k+1.  A sample with the time of the one before it, or an
earlier one, is counted and left out.  A second is flagged where two neighbours lie more than 1.5 nominal periods apart
and a sample was due in it; one with fewer than half of its nominal samples is a gap.
"""
from dataclasses import dataclass

import numpy as np

from .native import core_or_none

_core = core_or_none()  # does the same without large arrays in between

FLAG_MISSING = 2
_US = 1_000_000


@dataclass
class Seconds:
    """Seconds that hold at least one sample.

    Attributes
    ----------
    end_s : int64 array (m,)     the second's end
    first : int64 array (m,)     index of its first sample among the kept ones
    n : int64 array (m,)         samples
    is_missing, is_gap : bool arrays (m,)
    """

    end_s: np.ndarray
    first: np.ndarray
    n: np.ndarray
    is_missing: np.ndarray
    is_gap: np.ndarray

    def mean(self, values):
        """Means over the seconds of kept samples, shape (m,) or (m, k); NaN where a value is NaN."""
        values = np.asarray(values, np.float64)
        n = self.n if values.ndim == 1 else self.n[:, None]
        return np.add.reduceat(values, self.first, axis=0) / n

    def nanmean(self, values):
        """The same over the finite values of each second."""
        finite = np.isfinite(values)
        sums = np.add.reduceat(np.where(finite, values, 0.0), self.first)
        count = np.add.reduceat(finite.astype(np.int64), self.first)
        return np.divide(sums, count, out=np.full(len(sums), np.nan), where=count > 0)

    def mean_and_std(self, values):
        """Means, and sample standard deviations within the seconds (0 for a second of one sample); values (m, k)."""
        values = np.ascontiguousarray(values, np.float64)
        if _core:
            return _core.spread_of_seconds(values, self.first.astype(np.int64), self.n.astype(np.int64))
        mean = self.mean(values)
        deviation = values - np.repeat(mean, self.n, axis=0)
        return mean, np.sqrt(np.add.reduceat(deviation * deviation, self.first, axis=0) / np.maximum(self.n - 1, 1)[:, None])

    def mean_of_counts(self, counts, scale):
        """Means of int32 counts in a unit, with the core's rounding bit for bit (2^-16 count, then float32)."""
        sums = np.add.reduceat(np.asarray(counts, np.int64), self.first, axis=0)
        n = self.n if sums.ndim == 1 else self.n[:, None]
        whole, rest = np.divmod(sums, n)
        part, left = np.divmod(rest * 65536, n)
        part += (2 * left > n) | ((2 * left == n) & (part % 2 == 1))
        in_counts = (whole * 65536 + part).astype(np.float32) * np.float32(2.0 ** -16)
        return (in_counts * np.float32(scale)).astype(np.float64)


def unwrap(ticks, bits):
    """Time of a counter that rolls over at 2**bits, as int64 ticks without the steps back."""
    ticks = np.asarray(ticks, np.int64)
    turns = np.cumsum(np.diff(ticks, prepend=ticks[:1]) < -(1 << (bits - 1)))
    return ticks + (turns << bits)


def keep_in_order(t_us):
    """Mask of the samples the core takes, and counts of duplicates and of steps back."""
    newest = np.maximum.accumulate(t_us)
    keep = np.ones(len(t_us), bool)
    keep[1:] = t_us[1:] > newest[:-1]
    n_duplicate = int(np.count_nonzero(t_us[1:] == newest[:-1]))
    return keep, n_duplicate, int(len(t_us) - np.count_nonzero(keep) - n_duplicate)


def in_order(t_us):
    """The times in order, each once.  Nearly all are in order already, which this way of sorting makes use of."""
    rising = np.sort(t_us, kind="stable")
    return rising[np.diff(rising, prepend=rising[:1] - 1) > 0]


def _run_lengths(values):
    edges = np.flatnonzero(np.diff(values)) + 1
    return np.diff(edges, prepend=0, append=len(values))


def nominal_rate_hz(t_us):
    """Samples per second: the median number in a second that has any; robust against gaps, jitter and bursts."""
    if len(t_us) < 2:
        return 1.0
    found = _core.steps_and_counts(np.ascontiguousarray(t_us, np.int64)) if _core else None
    step, counts = found or (float(np.median(np.diff(t_us))), _run_lengths(in_order(t_us) // _US))
    by_step = _US / step
    inner = counts[1:-1]
    if len(inner) < 3 or by_step < 2:
        return by_step
    by_count = float(np.median(inner))
    return by_step if abs(by_step - by_count) <= 1.0 + 0.02 * by_count else by_count


def cut_seconds(t_us, rate_hz):
    """Cut increasing times (int64 us, >= 0) into seconds."""
    rate = max(1, int(np.floor(rate_hz + 0.5)))
    hole_us = _US // rate + _US // (2 * rate)
    period_us = hole_us - hole_us // 3
    second = t_us // _US
    first = np.flatnonzero(np.diff(second, prepend=second[0] - 1))
    n = np.diff(first, append=len(t_us))
    is_missing = np.zeros(len(first), bool)
    before = np.flatnonzero(np.diff(t_us) > hole_us)  # index of the sample before a hole
    left = np.searchsorted(first, before, side="right") - 1
    right = np.searchsorted(first, before + 1, side="right") - 1
    same = left == right
    is_missing[left[same]] = True
    last_us, next_us = t_us[before[~same]], t_us[before[~same] + 1]
    due_left = last_us + period_us < (second[before[~same]] + 1) * _US
    due_right = next_us - period_us >= second[before[~same] + 1] * _US
    is_missing[left[~same][due_left]] = True
    is_missing[right[~same][due_right]] = True
    if t_us[0] - second[0] * _US > hole_us:
        is_missing[0] = True
    if (second[-1] + 1) * _US - t_us[-1] > hole_us:
        is_missing[-1] = True
    return Seconds(second[first] + 1, first, n, is_missing, 2 * n < rate)
