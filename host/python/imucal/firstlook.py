# SPDX-License-Identifier: MIT
"""The figures of a first look at a log: polynomial, smoothed residual, read-off noise, Allan deviation.

Reading the noise off the plots is the paper's way (Figs. 12 and 13): raw less smoothed gives the angle random walk, the
smoothed residual's size and correlation the instability.  Seconds that are no measurement (far outliers, a clipped or frozen
output) have no part in any figure; what else is odd is asked in `suspicions`.
"""
from dataclasses import dataclass, field

import numpy as np

from . import suspicions
from .direction import directions
from .errors import DataError, ImucalError
from .grid import SMOOTH_S, correlation_time_s, filled, moving_mean, rows_of

MIN_SPAN_DEGC = 1.0
#: windows of the Allan deviation may miss some seconds: one missing second in fifty would end the curve at two minutes
LEAST_FILL = 0.9


@dataclass
class AxisLook:
    """What one axis shows; rates in the axis' unit."""

    axis: str
    unit: str
    t_s: np.ndarray
    temp_degc: np.ndarray
    rate: np.ndarray               # as recorded
    used: np.ndarray               # the same; NaN where it is no measurement
    poly: np.ndarray               # coefficients in Tn, or the mean alone
    t0_degc: float = 0.0
    range_degc: float = 1.0
    residual: np.ndarray = None
    smooth: np.ndarray = None
    direction: np.ndarray = None   # 1 rising, -1 falling, 0 at rest
    white: float = 0.0             # standard deviation of a 1-s mean
    slow_sigma: float = 0.0
    slow_tau_s: float = 0.0
    allan_tau_s: np.ndarray = field(default_factory=lambda: np.empty(0))
    allan: np.ndarray = field(default_factory=lambda: np.empty(0))
    allan_ci95: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    lattice: float = 0.0
    outlier_rows: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    clipped_share: float = 0.0     # of the seconds: at the one value clipped_at, the largest or the smallest
    clipped_at: float = 0.0
    jumps: list = field(default_factory=list)  # (t_s, size)
    loop: float = 0.0              # rms of what goes with the direction of the temperature
    loop_share: float = 0.0        # its part of the smoothed residual's variance
    has_loop: bool = False
    warm_up: float = 0.0           # the start, off what the rest of the log predicts
    warm_up_z: float = 0.0         # that over its standard error
    has_warm_up: bool = False
    is_constant: bool = False      # one and the same value in every second
    frozen_s: int = 0              # longest run of one value, where it stands out; from the row frozen_from
    frozen_from: int = 0
    repeats: float = 0.0           # part of the seconds that equal the one before
    powers: np.ndarray = None      # columns of the polynomial at each row, where they were asked for
    ml: dict = field(default_factory=dict)
    expected: np.ndarray = None    # Allan deviation at allan_tau_s that the noise of ml lets expect of such a log

    @property
    def arw_deg_rt_h(self):
        """Angle random walk, for a gyro in dph."""
        return self.white / 60

    @property
    def order(self):
        """Of the polynomial."""
        return len(self.poly) - 1

    @property
    def tn(self):
        """Temperatures on the polynomial's scale."""
        return (self.temp_degc - self.t0_degc) / self.range_degc

    @property
    def allan_minimum(self):
        """(tau_s, value) of the lowest point where the curve falls before and rises after it, beyond its interval; else None."""
        if len(self.allan) < 3:
            return None
        k = int(self.allan.argmin())
        low, high = self.allan_ci95[k]
        is_one = k > 0 and np.isfinite(high) and self.allan[:k].max() > high and self.allan[k + 1:].max(initial=0.0) > high
        return (float(self.allan_tau_s[k]), float(self.allan[k])) if is_one else None


def allan_deviation_of(grid):
    """(tau_s, Allan deviation, 95 % intervals) at octaves as far as nine windows reach; empty where there are none."""
    from .analysis import direct_predictor
    nothing = np.empty(0), np.empty(0), np.empty((0, 2))
    fine = grid[np.isfinite(grid)]
    if len(fine) < 2 or np.ptp(fine) == 0:
        return nothing
    try:
        curve = direct_predictor(grid, type="av", min_fill=1.0 if len(fine) == len(grid) else LEAST_FILL)
    except DataError:
        return nothing
    except ImucalError:  # without the compiled part there is no curve
        return nothing
    known = np.isfinite(curve.dp_dph) & (curve.dp_dph > 0)
    return curve.tau_s[known], curve.dp_dph[known], curve.ci95_dph[known]


def lattice_of(values):
    """The step of values that lie on a lattice; 0 where they do not."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 3 or len(levels) > 0.5 * np.isfinite(values).sum():
        return 0.0
    step = float(np.median(np.diff(levels)))
    off = np.abs((levels - levels[0]) / step - np.rint((levels - levels[0]) / step))
    return step if np.mean(off < 0.02) > 0.9 else 0.0


def _fit(look, order):
    """Polynomial in Tn by QR (numpy's lstsq is an SVD), order cut where the span or the data are small."""
    fine = np.isfinite(look.used) & np.isfinite(look.temp_degc)
    span = np.ptp(look.temp_degc[fine]) if fine.any() else 0.0
    if span < MIN_SPAN_DEGC:
        look.poly = np.array([np.nanmean(look.used)])
        look.residual = look.used - look.poly[0]
        return
    lo, hi = look.temp_degc[fine].min(), look.temp_degc[fine].max()
    look.t0_degc, look.range_degc = (lo + hi) / 2, (hi - lo) / 2
    powers = np.polynomial.polynomial.polyvander(look.tn[fine], min(order, 1 + int(span / 3)))
    look.poly = np.linalg.lstsq(powers, look.used[fine], rcond=None)[0]
    look.residual = look.used - np.polynomial.polynomial.polyval(look.tn, look.poly)


def _noise(look):
    """Noise read off the residual, and its Allan deviation."""
    grid = filled(look.t_s, look.residual)
    smooth = moving_mean(grid, SMOOTH_S)
    look.white = suspicions.white_of(grid)
    white_left = look.white ** 2 / SMOOTH_S
    look.slow_sigma = float(np.sqrt(max(np.nanvar(smooth) - white_left, 0.0)))
    look.slow_tau_s = correlation_time_s(smooth, white_left)
    look.smooth = smooth[rows_of(look.t_s)]
    if suspicions.has_noise(look):
        look.allan_tau_s, look.allan, look.allan_ci95 = allan_deviation_of(grid)


def look_at_axis(log, axis, order=3, moves=None):
    """All figures of one axis of a Log; moves: the directions of its temperature, where they are known."""
    rate = log.rates[axis]
    look = AxisLook(axis, axis.rpartition("_")[2], log.t_s, log.temp_degc, rate, rate.copy(), None)
    look.direction = directions(log.t_s, log.temp_degc) if moves is None else moves
    look.lattice = lattice_of(rate)
    suspicions.leave_out(look)
    _fit(look, order)
    _noise(look)
    suspicions.ask(look)
    return look
