# SPDX-License-Identifier: MIT
"""Seconds on a grid: means that know what is missing, and how long noise remembers."""
import numpy as np

SMOOTH_S = 61


def rows_of(t_s):
    """Place of each row on a grid of whole seconds that begins at the first."""
    return np.rint(t_s - t_s[0]).astype(int)


def filled(t_s, values):
    """Values on a whole-second grid from the first to the last row; NaN where a row is missing."""
    index = rows_of(t_s)
    grid = np.full(index[-1] + 1, np.nan)
    grid[index] = values
    return grid


def sums_of(grid):
    """(sums, counts) of what is there before each second and after the last."""
    present = np.isfinite(grid)
    return np.concatenate([[0.0], np.cumsum(np.where(present, grid, 0.0))]), np.concatenate([[0], np.cumsum(present)])


def moving_mean(grid, width):
    """Centred mean over what is there; NaN where less than half of the window is."""
    sums, counts = sums_of(grid)
    lo = np.maximum(np.arange(len(grid)) - width // 2, 0)
    hi = np.minimum(np.arange(len(grid)) + width // 2 + 1, len(grid))
    n = counts[hi] - counts[lo]
    return np.divide(sums[hi] - sums[lo], n, out=np.full(len(grid), np.nan), where=2 * n >= hi - lo)


def window_means(grid, width, least_part):
    """(means of all windows of this width, are they full enough): NaN where a window has less than this part of its seconds."""
    sums, counts = sums_of(grid)
    n = counts[width:] - counts[:-width]
    is_full = (n >= least_part * width) & (n > 0)
    return np.divide(sums[width:] - sums[:-width], n, out=np.full(len(n), np.nan), where=is_full), is_full


def correlation_time_s(smooth, white_left):
    """Lag at which the autocorrelation of a smoothed record falls to 1/e, between lags; 0 where it never does."""
    x = smooth[np.isfinite(smooth)] - np.nanmean(smooth)
    if len(x) < 200:
        return 0.0
    n = 1 << (2 * len(x) - 1).bit_length()
    spectrum = np.fft.rfft(x, n)
    acf = np.fft.irfft(spectrum * np.conj(spectrum), n)[:len(x) // 2] / len(x)
    power = max(acf[0] - white_left, 1e-12)
    below = np.flatnonzero(acf[SMOOTH_S // 2:] < power / np.e)
    return float(below[0] + SMOOTH_S // 2) if len(below) else 0.0
