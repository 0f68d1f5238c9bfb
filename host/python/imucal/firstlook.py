# SPDX-License-Identifier: MIT
"""The figures of a first look at a log: polynomial, smoothed residual, read-off noise, Allan deviation, suspicions.

Reading the noise off the plots is the paper's way (Figs. 12 and 13): raw less smoothed gives the angle random walk, the
smoothed residual's size and correlation the instability.
"""
from dataclasses import dataclass, field

import numpy as np

SMOOTH_S = 61
MIN_SPAN_DEGC = 1.0
_NEAR_S = 9
_OUTLIER_SIGMA = 6
#: a run of one value is frozen where it is so long, and so many times as long as any other
_FROZEN_S, _FROZEN_TIMES = 30, 5
_NO_NOISE = 1e-9  # of the largest rate


@dataclass
class AxisLook:
    """What one axis shows; rates in the axis' unit."""

    axis: str
    unit: str
    t_s: np.ndarray
    temp_degc: np.ndarray
    rate: np.ndarray
    poly: np.ndarray               # coefficients in Tn, or the mean alone
    t0_degc: float = 0.0
    range_degc: float = 1.0
    residual: np.ndarray = None
    smooth: np.ndarray = None
    direction: np.ndarray = None   # 1 rising, -1 falling, 0 soak
    white: float = 0.0             # standard deviation of a 1-s mean
    slow_sigma: float = 0.0
    slow_tau_s: float = 0.0
    allan_tau_s: np.ndarray = None
    allan: np.ndarray = None
    lattice: float = 0.0
    n_outliers: int = 0
    loop: float = 0.0              # rms of what goes with the direction of the temperature
    loop_share: float = 0.0        # its part of the smoothed residual's variance
    warm_up: float = 0.0
    warm_up_z: float = 0.0
    is_constant: bool = False      # one and the same value in every second
    frozen_s: int = 0              # longest run of one value, where it stands out; from the row frozen_from
    frozen_from: int = 0
    repeats: float = 0.0           # part of the seconds that equal the one before
    ml: dict = field(default_factory=dict)

    @property
    def arw_deg_rt_h(self):
        """Angle random walk, for a gyro in dph."""
        return self.white / 60


def filled(t_s, values):
    """Values on a whole-second grid from the first to the last row; NaN where a row is missing."""
    index = np.rint(t_s - t_s[0]).astype(int)
    grid = np.full(index[-1] + 1, np.nan)
    grid[index] = values
    return grid


def moving_mean(grid, width):
    """Centred mean over what is there; NaN where less than half of the window is."""
    present = np.isfinite(grid)
    sums = np.concatenate([[0.0], np.cumsum(np.where(present, grid, 0.0))])
    counts = np.concatenate([[0], np.cumsum(present)])
    lo = np.maximum(np.arange(len(grid)) - width // 2, 0)
    hi = np.minimum(np.arange(len(grid)) + width // 2 + 1, len(grid))
    n = counts[hi] - counts[lo]
    return np.divide(sums[hi] - sums[lo], n, out=np.full(len(grid), np.nan), where=2 * n >= hi - lo)


def allan_deviation_of(grid, dt_s=1.0):
    """Overlapping Allan deviation at octaves to a third of the record; windows with a missing second are left out."""
    present = np.isfinite(grid)
    sums = np.concatenate([[0.0], np.cumsum(np.where(present, grid, 0.0))])
    holes = np.concatenate([[0], np.cumsum(~present)])
    tau, deviation = [], []
    n = 1
    while 3 * n <= len(grid):
        mean = (sums[n:] - sums[:-n]) / n
        whole = holes[n:] == holes[:-n]
        pairs = whole[n:] & whole[:-n]
        if pairs.sum() < 3:
            break
        step = (mean[n:] - mean[:-n])[pairs]
        tau.append(n * dt_s)
        deviation.append(np.sqrt(0.5 * np.mean(step * step)))
        n *= 2
    return np.array(tau), np.array(deviation)


def lattice_of(values):
    """The step of values that lie on a lattice; 0 where they do not."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 3 or len(levels) > 0.5 * np.isfinite(values).sum():
        return 0.0
    step = float(np.median(np.diff(levels)))
    off = np.abs((levels - levels[0]) / step - np.rint((levels - levels[0]) / step))
    return step if np.mean(off < 0.02) > 0.9 else 0.0


def directions(t_s, temp_degc):
    """1 rising, -1 falling, 0 soak: slope of the smoothed temperature against a tenth of the steepest."""
    grid = moving_mean(filled(t_s, temp_degc), SMOOTH_S)
    slope = np.gradient(grid)
    limit = max(0.1 * np.nanmax(np.abs(slope), initial=0.0), 0.05 / 60)
    return np.where(slope > limit, 1, np.where(slope < -limit, -1, 0))[np.rint(t_s - t_s[0]).astype(int)]


def _correlation_time(smooth, white_left):
    """Lag at which the autocorrelation falls to 1/e, between lags; 0 where it never does."""
    x = smooth[np.isfinite(smooth)] - np.nanmean(smooth)
    if len(x) < 200:
        return 0.0
    n = 1 << (2 * len(x) - 1).bit_length()
    spectrum = np.fft.rfft(x, n)
    acf = np.fft.irfft(spectrum * np.conj(spectrum), n)[:len(x) // 2] / len(x)
    power = max(acf[0] - white_left, 1e-12)
    below = np.flatnonzero(acf[SMOOTH_S // 2:] < power / np.e)
    return float(below[0] + SMOOTH_S // 2) if len(below) else 0.0


def outliers_of(grid, noise, white):
    """Places of seconds beyond 6 sigma of the median of the nine about them.  noise: grid less its 9-s mean, which one wrong
    second carries to its neighbours: it finds who is asked."""
    limit, half = _OUTLIER_SIGMA * max(white, 1e-12), _NEAR_S // 2
    asked = np.flatnonzero(np.abs(noise) > limit / 2)
    return [i for i in asked if abs(grid[i] - np.nanmedian(grid[max(i - half, 0):i + half + 1])) > limit]


def _difference(look, first, second, slow_density):
    """(difference of two groups' mean residuals, that over its standard error by the noise that was read off)."""
    n1, n2 = first.sum(), second.sum()
    if min(n1, n2) < 60:
        return 0.0, 0.0
    gap = float(np.nanmean(look.residual[first]) - np.nanmean(look.residual[second]))
    return gap, gap / np.sqrt(slow_density * (1 / n1 + 1 / n2))


def _loop(look):
    """(rms, share of the smoothed residual's variance) of a part that changes sign with the direction of the temperature.
    A first look cannot tell it from slow noise: diagnose weighs the two."""
    both = (look.direction != 0) & np.isfinite(look.smooth)
    for side in (1, -1):
        if np.mean(look.direction == side) < 0.1:
            return 0.0, 0.0
    tn = ((look.temp_degc - look.t0_degc) / look.range_degc)[both]
    smooth, side = look.smooth[both], look.direction[both]
    even = np.polynomial.polynomial.polyvander(tn, 3)
    odd = side[:, None] * np.polynomial.polynomial.polyvander(tn, 2)
    rest = [smooth - m @ np.linalg.lstsq(m, smooth, rcond=None)[0] for m in (even, np.hstack([even, odd]))]
    before, after = (float(np.mean(r * r)) for r in rest)
    return float(np.sqrt(max(before - after, 0.0))), 1 - after / before if before > 0 else 0.0


def _fit(look, order):
    """Polynomial in Tn by QR (numpy's lstsq is an SVD), order cut where the span or the data are small."""
    fine = np.isfinite(look.rate) & np.isfinite(look.temp_degc)
    span = np.ptp(look.temp_degc[fine]) if fine.any() else 0.0
    if span < MIN_SPAN_DEGC:
        look.poly = np.array([np.nanmean(look.rate)])
        look.residual = look.rate - look.poly[0]
        return
    lo, hi = look.temp_degc[fine].min(), look.temp_degc[fine].max()
    look.t0_degc, look.range_degc = (lo + hi) / 2, (hi - lo) / 2
    tn = (look.temp_degc - look.t0_degc) / look.range_degc
    powers = np.polynomial.polynomial.polyvander(tn[fine], min(order, 1 + int(span / 3)))
    look.poly = np.linalg.lstsq(powers, look.rate[fine], rcond=None)[0]
    look.residual = look.rate - np.polynomial.polynomial.polyval(tn, look.poly)


def _runs(values):
    """(first rows, lengths) of the runs of one finite value."""
    starts = np.flatnonzero(np.concatenate([[True], ~(values[1:] == values[:-1])]))
    lengths = np.diff(starts, append=len(values))
    fine = np.isfinite(values[starts])
    return starts[fine], lengths[fine]


def _repeats(look):
    """What repeats itself: a whole record, a run of one value that is far longer than any other, many seconds."""
    fine = look.rate[np.isfinite(look.rate)]
    look.is_constant = bool(np.ptp(fine) == 0)
    starts, lengths = _runs(look.rate)
    look.repeats = float((len(fine) - len(lengths)) / max(len(fine) - 1, 1))
    longest = int(np.argmax(lengths))
    others = np.delete(lengths, longest)
    if not look.is_constant and lengths[longest] >= max(_FROZEN_S, _FROZEN_TIMES * others.max(initial=1)):
        look.frozen_s, look.frozen_from = int(lengths[longest]), int(starts[longest])


def _has_noise(look):
    return look.white > _NO_NOISE * np.nanmax(np.abs(look.rate), initial=1e-300)


def _suspicions(look):
    if not _has_noise(look):  # rounding is no finding
        return
    slow_density = 2 * look.slow_sigma ** 2 * max(look.slow_tau_s, 1.0) + look.white ** 2
    if len(look.poly) > 1:
        look.loop, look.loop_share = _loop(look)
    early = look.t_s - look.t_s[0] < min(900, 0.15 * np.ptp(look.t_s))
    later = (look.t_s - look.t_s[0] >= 2 * min(900, 0.15 * np.ptp(look.t_s))) & (look.t_s - look.t_s[0] < 6 * min(900, 0.15 * np.ptp(look.t_s)))
    look.warm_up, look.warm_up_z = _difference(look, early, later, slow_density)


def look_at_axis(log, axis, order=3):
    """All figures of one axis of a Log."""
    look = AxisLook(axis, axis.rpartition("_")[2], log.t_s, log.temp_degc, log.rates[axis], None)
    _fit(look, order)
    look.direction = directions(log.t_s, log.temp_degc) if log.has_temperature else np.zeros(len(log.t_s), int)
    grid = filled(log.t_s, look.residual)
    smooth = moving_mean(grid, SMOOTH_S)
    noise = grid - moving_mean(grid, _NEAR_S)
    # 1.4826 MAD: outliers do not widen it; the 9-s mean takes a ninth of the white variance away.
    look.white = 1.4826 * float(np.nanmedian(np.abs(noise - np.nanmedian(noise)))) / np.sqrt(1 - 1 / _NEAR_S)
    look.n_outliers = len(outliers_of(grid, noise, look.white)) if _has_noise(look) else 0
    white_left = look.white ** 2 / SMOOTH_S
    look.slow_sigma = float(np.sqrt(max(np.nanvar(smooth) - white_left, 0.0)))
    look.slow_tau_s = _correlation_time(smooth, white_left)
    look.smooth = smooth[np.rint(log.t_s - log.t_s[0]).astype(int)]
    look.allan_tau_s, look.allan = allan_deviation_of(grid)
    look.lattice = lattice_of(look.rate)
    _repeats(look)
    _suspicions(look)
    return look
