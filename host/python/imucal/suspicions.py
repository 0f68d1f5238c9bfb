# SPDX-License-Identifier: MIT
"""What is odd about an axis at a first look: seconds that are no measurement, jumps, a warm-up, a loop.

A first look cannot tell causes apart; `diagnose` weighs them.  The limits of jumps and warm-ups come from simulated healthy
logs (30 min to 8 h, with white noise alone and with slow noise of up to 2000 s).  Of 100 such axes at most one is said to
jump; at most one is said to warm up, if its noise forgets within a tenth of the log.
"""
import numpy as np

from .grid import SMOOTH_S, correlation_time_s, filled, moving_mean, rows_of, window_means

_NEAR_S = 9
_OUTLIER_SIGMA = 6
#: a run of one value is frozen where it is so long, and so many times as long as any other
_FROZEN_S, _FROZEN_TIMES = 30, 5
_NO_NOISE = 1e-9  # of the largest rate
_STAIRS = 2       # times the noise: in coarser steps a polynomial leaves stairs, which are no jumps
#: a largest or smallest value is a stop where it holds this part of the seconds, and this many times those of the next value
_CLIPPED_SHARE, _CLIPPED_TIMES = 0.01, 5
#: neighbouring means of a jump: of this length, or a twentieth of the log; their difference over that of all others
JUMP_S, _FEWEST_JUMP_S, JUMP_LIMIT, _MOST_JUMPS = 300, 60, 5.5, 6
_TURNS, _LET_GO = 10, 4.7  # of the fit that lets jumps go; beyond this many times the usual
#: a warm-up: the first quarter of an hour against what the log without its first 15 % predicts
_EARLY_S, _EARLY_PART = 900, 0.15
_FEWEST_DEGREES = 3  # of freedom: independent stretches of the rest, less its coefficients
#: a loop is suspected above this share of the smoothed residual's variance, if an F test of 1 % sees it too, or if it is this
#: many times the white noise of the smoothed residual: then only slow noise of that size could look the same
LOOP_SHARE, _PLAIN_LOOP, _FEWEST_OF_LOOP = 0.5, 10, 8


def white_of(grid):
    """Standard deviation of a second: 1.4826 MAD (outliers do not widen it); the 9-s mean takes a ninth of the variance away."""
    noise = grid - moving_mean(grid, _NEAR_S)
    return 1.4826 * float(np.nanmedian(np.abs(noise - np.nanmedian(noise)))) / np.sqrt(1 - 1 / _NEAR_S)


def has_noise(look):
    """More than rounding."""
    return look.white > _NO_NOISE * np.nanmax(np.abs(look.rate), initial=1e-300)


# --- what is no measurement

def outliers_of(grid):
    """Places of seconds beyond 6 sigma of the median of the nine about them.  A wrong second carries its 9-s mean to its
    neighbours: that mean finds who is asked."""
    noise, white, half = grid - moving_mean(grid, _NEAR_S), white_of(grid), _NEAR_S // 2
    if white <= _NO_NOISE * np.nanmax(np.abs(grid), initial=1e-300):
        return []
    limit = _OUTLIER_SIGMA * white
    asked = np.flatnonzero(np.abs(noise) > limit / 2)
    return [i for i in asked if abs(grid[i] - np.nanmedian(grid[max(i - half, 0):i + half + 1])) > limit]


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


def _clipping(look):
    """A largest or smallest value where far too many seconds stand: the end of a range."""
    values, counts = np.unique(look.rate[np.isfinite(look.rate)], return_counts=True)
    if look.is_constant or len(values) < 3:
        return
    for end, next_to_it in ((-1, -2), (0, 1)):
        share = counts[end] / counts.sum()
        if share > max(_CLIPPED_SHARE, look.clipped_share) and counts[end] > _CLIPPED_TIMES * counts[next_to_it]:
            look.clipped_share, look.clipped_at = float(share), float(values[end])


def leave_out(look):
    """Find the seconds that are no measurement and take them out of look.used."""
    _repeats(look)
    if look.is_constant:
        return
    if look.frozen_s:
        look.used[look.frozen_from:look.frozen_from + look.frozen_s] = np.nan
    else:  # a value that is frozen may be the largest
        _clipping(look)
    if look.clipped_share:
        look.used[look.rate == look.clipped_at] = np.nan
    grid = filled(look.t_s, look.used)
    places = outliers_of(grid)
    look.outlier_rows = np.flatnonzero(np.isin(rows_of(look.t_s), places)) if len(places) else np.empty(0, int)
    look.used[look.outlier_rows] = np.nan


# --- what the rates do

def _early(look):
    """(rows of the start, rows of the rest that predicts it)."""
    since, duration = look.t_s - look.t_s[0], np.ptp(look.t_s)
    return since < min(_EARLY_S, _EARLY_PART * duration), since >= _EARLY_PART * duration


def _powers(look):
    """Columns of the polynomial at each row."""
    if look.powers is None:
        look.powers = _columns(look)
    return look.powers


def _columns(look):
    return np.polynomial.polynomial.polyvander(look.tn, look.order) if look.order else np.ones((len(look.t_s), 1))


def _with_jumps(look, times):
    """The polynomial's columns and a step for each jump."""
    return np.column_stack([_powers(look)] + [look.t_s >= t_s for t_s in times])


def _left(look, columns, rows):
    """(coefficients, what they leave at each row) of a fit to these rows."""
    rows = rows & np.isfinite(look.used) & np.isfinite(columns).all(axis=1)
    coefficients = np.linalg.lstsq(columns[rows], look.used[rows], rcond=None)[0]
    return coefficients, look.used - columns @ coefficients


def _differences(look, rows):
    """(end of the first mean, differences of neighbouring means of the rates, those of the polynomial's columns, a mean's length)
    at each second where both means are there; None where the log is too short."""
    width = int(min(JUMP_S, np.ptp(look.t_s) / 20))
    if width < _FEWEST_JUMP_S:
        return None
    columns = [np.where(rows, column, np.nan) for column in (look.used, *_powers(look).T[1:])]
    columns = [np.where(np.isfinite(look.used), column, np.nan) for column in columns]
    means = [window_means(filled(look.t_s, column), width, 0.5)[0] for column in columns]
    steps = np.column_stack([mean[width:] - mean[:-width] for mean in means])
    there = np.isfinite(steps).all(axis=1)
    if there.sum() < 10 * width:
        return None
    return look.t_s[0] + np.flatnonzero(there) + width, steps[there, 0], steps[there, 1:], width


def _without_polynomial(steps, columns, every):
    """Differences less those of a polynomial.  A jump is in few of them: least squares with weights that let those go."""
    some, x = steps[::every], columns[::every]
    if not x.shape[1]:
        return steps
    weights = np.ones(len(some))
    for turn in range(_TURNS):
        coefficients = np.linalg.lstsq(x * weights[:, None], some * weights, rcond=None)[0]
        left = np.abs(some - x @ coefficients)
        usual = max(1.4826 * float(np.median(left)), 1e-300)
        if turn < _TURNS // 2:
            weights = 1 / np.sqrt(np.maximum(left / usual, 0.1))
        else:
            weights = np.clip(1 - (left / (_LET_GO * usual)) ** 2, 0, None)
    return steps - columns @ coefficients


def _find_jumps(look, rows):
    """[(t_s, size)] where neighbouring means differ by far more than they do elsewhere; sizes by one fit with the polynomial."""
    found = _differences(look, rows)
    if not found:
        return []
    t_s, steps, columns, width = found
    left = np.abs(_without_polynomial(steps, columns, max(width // 10, 1)))
    limit = JUMP_LIMIT * 1.4826 * float(np.median(left))
    times = []
    while limit > 0 and left.max() > limit and len(times) < _MOST_JUMPS:
        at = int(left.argmax())
        times.append(float(t_s[at]))
        left[np.abs(t_s - t_s[at]) < 1.5 * width] = 0
    if not times:
        return []
    coefficients, _ = _left(look, _with_jumps(look, sorted(times)), rows)
    return [(at, float(size)) for at, size in zip(sorted(times), coefficients[look.order + 1:])]


def _warm_up(look):
    """The start against a fit and a noise that do not know it."""
    columns = _with_jumps(look, [t_s for t_s, _ in look.jumps])
    fine = np.isfinite(look.used) & np.isfinite(columns).all(axis=1)
    early, rest = (rows & fine for rows in _early(look))
    if rest.sum() < 10 * SMOOTH_S:
        return
    columns = columns[:, [0] + [k for k in range(1, columns.shape[1]) if np.ptp(columns[rest, k]) > 0]]
    if look.order:  # a polynomial predicts nothing beyond the temperatures it was fitted to
        known, room = look.temp_degc[rest], 0.02 * np.ptp(look.temp_degc[rest])
        early &= (look.temp_degc >= known.min() - room) & (look.temp_degc <= known.max() + room)
    if early.sum() < SMOOTH_S:
        return
    _, left = _left(look, columns, rest)
    smooth, white_left = moving_mean(filled(look.t_s[rest], left[rest]), SMOOTH_S), look.white ** 2 / SMOOTH_S
    slow = max(float(np.nanvar(smooth)) - white_left, 0.0)
    tau_s = correlation_time_s(smooth, white_left) or 0.1 * np.ptp(look.t_s)
    stretches = rest.sum() / (2 * tau_s + 1)
    degrees = stretches - columns.shape[1]
    if degrees < _FEWEST_DEGREES:
        return
    density = look.white ** 2 + 2 * slow * tau_s * stretches / degrees
    mean = columns[early].mean(axis=0)
    spread = mean @ np.linalg.solve(columns[rest].T @ columns[rest], mean)
    look.warm_up = float(np.mean(left[early]))
    look.warm_up_z = look.warm_up / float(np.sqrt(density * (1 / early.sum() + spread)))
    look.has_warm_up = abs(look.warm_up_z) > 3 + 20 / degrees


def _loop(look):
    """(rms, share of the smoothed residual's variance, does it stand out) of a part that changes sign with the direction of the
    temperature, beside jumps and without a warm-up."""
    both = (look.direction != 0) & np.isfinite(look.smooth)
    if look.has_warm_up:
        both &= _early(look)[1]
    if min(np.sum(both & (look.direction == side)) for side in (1, -1)) < 0.1 * len(both):
        return 0.0, 0.0, False
    tn, smooth, side = look.tn[both], look.smooth[both], look.direction[both]
    even = np.column_stack([np.polynomial.polynomial.polyvander(tn, 3)] + [look.t_s[both] >= t_s for t_s, _ in look.jumps])
    odd = side[:, None] * np.polynomial.polynomial.polyvander(tn, 2)
    some = slice(None, None, SMOOTH_S // 6)  # what is smooth needs no more
    rest = [smooth - m @ np.linalg.lstsq(m[some], smooth[some], rcond=None)[0] for m in (even, np.hstack([even, odd]))]
    before, after = (float(np.mean(r * r)) for r in rest)
    if not before > after > 0:
        return 0.0, 0.0, False
    share = 1 - after / before
    memory_s = correlation_time_s(filled(look.t_s[both], rest[1]), 0.0) or 0.1 * np.ptp(look.t_s)
    degrees = np.sum(both) / (2 * memory_s) - even.shape[1] - odd.shape[1]
    rms, enough = float(np.sqrt(before - after)), degrees >= _FEWEST_OF_LOOP
    is_sure = enough and share / odd.shape[1] > (1 - share) / degrees * (3.8 + 230 / degrees ** 2)
    return rms, share, bool(share > LOOP_SHARE and (is_sure or rms > _PLAIN_LOOP * look.white / np.sqrt(SMOOTH_S)))


def ask(look):
    """Jumps, a warm-up, a loop."""
    if look.is_constant or not has_noise(look) or look.lattice > _STAIRS * look.white:  # rounding is no finding
        return
    found = look.jumps = _find_jumps(look, np.ones(len(look.t_s), bool))
    if found:  # a warm-up is steep where the log begins: are there jumps without it?
        look.jumps = _find_jumps(look, _early(look)[1])
    _warm_up(look)
    if not look.has_warm_up:
        look.jumps = found
    if look.order:
        look.loop, look.loop_share, look.has_loop = _loop(look)
