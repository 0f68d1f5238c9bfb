# SPDX-License-Identifier: MIT
"""Which seconds of a recording the device was at rest.

A second moves where the spread of its samples is far above the quiet level of the recording or above what any gyro or
accelerometer shows at rest, or where its mean rate stands out of its neighbourhood.  The limits are wide on purpose: a
thermal drift must never look like motion.  One second on either side of a moving one goes with it, and rests shorter than
MIN_REST_S between two motions too.
"""
import warnings

import numpy as np

from .native import core_or_none
from .units import DPH_PER_DPS

_core = core_or_none()  # does the same in less time

#: no MEMS gyro at rest has samples spread wider, or a bias larger, than this
MAX_STILL_STD_DPH = 3.0 * DPH_PER_DPS
MAX_STILL_RATE_DPH = 25.0 * DPH_PER_DPS
#: hand-held or flying shows at least this much
MIN_MOVING_STD_DPH = 0.3 * DPH_PER_DPS
MIN_MOVING_STEP_DPH = 0.5 * DPH_PER_DPS
MAX_STILL_STD_MG = 60.0
MIN_MOVING_STD_MG = 8.0
MIN_REST_S = 5
NEIGHBOURS_S = 61


def _quiet_level(std):
    used = std[np.isfinite(std) & (std > 0)]
    return float(np.quantile(used, 0.2)) if len(used) else 0.0


def _spread_moves(std, n, floor, ceiling):
    """std (m, k) of n (m,) samples each: far above the quiet level, or above the ceiling."""
    moves = np.zeros(len(std), bool)
    factor = 2.5 * (1 + 5 / np.sqrt(2 * np.maximum(n - 1, 1)))  # a chi-square's reach beside 2.5 times the quiet spread
    for column in std.T:
        limit = np.minimum(np.maximum(factor * _quiet_level(column), floor), ceiling)
        moves |= (n > 1) & (column > limit)
    return moves


def running_median(values, width):
    """Median of a centred window (ends: of what there is), along axis 0."""
    half = width // 2
    if _core and np.isfinite(values).all():
        return _core.running_median(np.ascontiguousarray(values, np.float64), half)
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
    return (_nanmedian if np.isnan(padded).any() else np.median)(windows, axis=-1)


def _nanmedian(values, axis):
    """NaN, and no warning, where nothing is finite."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmedian(values, axis=axis)


def gyro_moves(seconds, rate_dph):
    """Moving seconds by a gyro: samples (n, k) in dph."""
    mean, std = seconds.mean_and_std(rate_dph)
    moves = _spread_moves(std, seconds.n, MIN_MOVING_STD_DPH, MAX_STILL_STD_DPH)
    moves |= (np.abs(mean) > MAX_STILL_RATE_DPH).any(axis=1)
    if len(mean) >= 5:
        step = np.abs(mean - running_median(mean, NEIGHBOURS_S))
        level = _nanmedian(step, axis=0)
        moves |= (step > np.maximum(20 * level, MIN_MOVING_STEP_DPH)).any(axis=1)
    return moves


def accel_moves(seconds, accel_mg):
    """Moving seconds by an accelerometer: samples (n, 3) in mg."""
    mean, std = seconds.mean_and_std(accel_mg)
    moves = _spread_moves(std, seconds.n, MIN_MOVING_STD_MG, MAX_STILL_STD_MG)
    turned = np.linalg.norm(np.diff(mean, axis=0), axis=1) > 60  # about 3.5 degrees from one second to the next
    moves[1:] |= turned
    moves[:-1] |= turned
    return moves


def widen(moves, end_s):
    """A second on either side moves too; so does a rest shorter than MIN_REST_S between two motions."""
    wide = moves.copy()
    beside = np.diff(end_s) == 1
    wide[1:] |= moves[:-1] & beside
    wide[:-1] |= moves[1:] & beside
    edges = np.flatnonzero(np.diff(np.concatenate([[True], wide, [True]]).astype(int)))
    for start, stop in zip(edges[::2], edges[1::2]):  # runs of rest
        inside = start > 0 and stop < len(wide)
        if inside and end_s[stop - 1] - end_s[start] + 1 < MIN_REST_S:
            wide[start:stop] = True
    return wide
