# SPDX-License-Identifier: MIT
"""Does the temperature rise, fall or rest?  One answer for all pictures.

Slow and fast are relative to the log: a chamber moves at degrees a minute, a night outdoors at a hundredth of that.  The
temperature moves where its slope is more than a tenth of the log's own (the slope at which half of all travel is done), and
more than its thermometer could show at rest."""
import numpy as np

RISING, FALLING, RESTING = 1, -1, 0
_PART = 0.1               # of the log's own slope: slower is rest
_WINDOWS = 50             # slopes are of this part of the log
_SHORTEST_S, _LONGEST_S = 60, 1800
_FEWEST_ROWS = 5
_STEPS = 3                # of a coarse thermometer, in one window
_SURE_SIGMA = 4


def _coarse_step(temp):
    """The step of a thermometer that mostly repeats itself; 0 of a fine one."""
    moves = np.abs(np.diff(temp))
    moving = moves[moves > 1e-9]
    return float(np.median(moving)) if len(moving) and len(moving) < 0.5 * len(moves) else 0.0


def _window_s(t_s, temp, step_degc):
    """Long enough for some rows, and for some steps of a coarse thermometer."""
    duration_s, span_degc = t_s[-1] - t_s[0], np.ptp(temp)
    window = np.clip(duration_s / _WINDOWS, _SHORTEST_S, _LONGEST_S)
    steps = _STEPS * step_degc * duration_s / span_degc if span_degc > 0 else 0.0
    return max(window, min(steps, duration_s / 8), _FEWEST_ROWS * float(np.median(np.diff(t_s))))


def _slopes(t_s, temp, window_s):
    """(slope of a straight line through the rows of a window about each row, its standard error for noise of 1 degC)."""
    lo = np.searchsorted(t_s, t_s - window_s / 2)
    hi = np.searchsorted(t_s, t_s + window_s / 2, side="right")

    def total(values):
        sums = np.concatenate([[0.0], np.cumsum(values)])
        return sums[hi] - sums[lo]
    time, degrees, n = t_s - t_s.mean(), temp - temp.mean(), (hi - lo).astype(float)
    spread = total(time * time) - total(time) ** 2 / n
    there = (n >= 3) & (spread > 0)
    slope = np.divide(total(time * degrees) - total(time) * total(degrees) / n, spread, out=np.zeros(len(t_s)), where=there)
    return slope, np.sqrt(np.divide(1.0, spread, out=np.zeros(len(t_s)), where=there))


def _typical(slopes):
    """The slope at which half of all travel is done."""
    sorted_slopes = np.sort(np.abs(slopes))
    travel = np.cumsum(sorted_slopes)
    return sorted_slopes[np.searchsorted(travel, travel[-1] / 2)] if len(travel) else 0.0


def directions(t_s, temp_degc):
    """1 rising, -1 falling, 0 at rest, or where there is no temperature, of each row; rows in the order of time."""
    t_s, temp_degc = np.asarray(t_s, float), np.asarray(temp_degc, float)
    result = np.zeros(len(t_s), int)
    known = np.isfinite(temp_degc)
    t, temp = t_s[known], temp_degc[known]
    if len(t) < 3 or t[-1] <= t[0]:
        return result
    step = _coarse_step(temp)
    window_s = _window_s(t, temp, step)
    slope, error = _slopes(t, temp, window_s)
    noise_degc = float(np.std(np.diff(temp, 2))) / np.sqrt(6) if len(temp) > 3 and not step else 0.0
    shown_at_rest = np.maximum(_SURE_SIGMA * noise_degc * error, 1.5 * step / window_s)
    limit = np.maximum(_PART * _typical(slope[np.abs(slope) > shown_at_rest]), shown_at_rest)
    result[known] = np.where(slope > limit, RISING, np.where(slope < -limit, FALLING, RESTING))
    return result
