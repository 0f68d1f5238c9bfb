# SPDX-License-Identifier: MIT
"""Which samples of a stream are taken, and when each of them was measured.

A row that stands twice is one sample.  Rows that share a time stamp and differ are so many samples under a clock that is too
coarse for them: where its stamps come evenly the samples are spread over them, else nobody can tell their times.  A sample
before newer ones is left out, as in the core (common/sum.h).
"""
from dataclasses import dataclass

import numpy as np

from .diagnosis_words import many
from .seconds import in_order, nominal_rate_hz

#: more than this part of the samples, and more than so many, are not left out in silence
MOST_LOST_PART, MOST_LOST = 0.01, 5
#: of a coarse clock: steps are multiples of the usual one within a part of it, and stamps hold samples alike, but for some
_STEP_ERROR, _COUNT_ERROR, _ODD_PART, _FEWEST_STAMPS = 0.25, 0.25, 0.1, 5
#: over so many samples they are spread evenly: the first of a stamp may have come anywhere within a sample's time
_FEWEST_IN_A_PIECE = 20


@dataclass
class Clock:
    """The samples that are taken and their times.

    Attributes
    ----------
    rows : int array (m,), or None    places in the stream; None: all of them
    t_us : int64 array (m,)           increasing
    rate_hz : float                   samples per second
    n_empty, n_duplicate, n_same, n_late : int    rows without rates; rows that stand twice; left out with the time of another sample, or one before it
    notes : list of str               what the user should know
    is_made : bool                    the times are not the stamps of the file
    problem : str                     why the samples cannot be used, and what to do; empty: they can
    """

    rows: np.ndarray
    t_us: np.ndarray
    rate_hz: float = 0.0
    n_empty: int = 0
    n_duplicate: int = 0
    n_same: int = 0
    n_late: int = 0
    notes: list = None
    problem: str = ""
    is_made: bool = False


def too_many(n_lost, n_all):
    """Are these more than may be left out with a count alone?"""
    return n_lost > max(MOST_LOST, MOST_LOST_PART * n_all)


def _finite_rows(stream):
    """Places of the rows with rates, or None where all have; a row of 1-s means may miss an axis, a sample may not."""
    if np.issubdtype(stream.values.dtype, np.integer):
        return None
    finite = np.isfinite(stream.values)
    return None if finite.all() else np.flatnonzero((np.any if stream.is_seconds else np.all)(finite, axis=1))


def _equal_to_the_one_before(stream, rows, places):
    """For each of the places in rows: is it the same row as the one before, temperature included?"""
    columns = [stream.values] + ([stream.temp_degc[:, None]] if stream.temp_t_us is stream.t_us else [])
    same = np.ones(len(places), bool)
    for values in columns:
        a, b = (values[i if rows is None else rows[i]] for i in (places, places - 1))
        same &= ((a == b) | ((a != a) & (b != b))).all(axis=1)
    return same


def _spread(t_us):
    """(times, usual step) of samples whose stamps, not falling, are coarse and come evenly; None where they do not."""
    first = np.flatnonzero(np.diff(t_us, prepend=t_us[0] - 1))
    stamps, counts = t_us[first], np.diff(first, append=len(t_us))
    if len(stamps) < _FEWEST_STAMPS:
        return None
    steps = np.diff(stamps)
    usual_us, usual_count = float(np.median(steps)), float(np.median(counts[1:-1]))
    multiples = steps / usual_us
    odd = np.mean(np.abs(multiples - np.maximum(np.rint(multiples), 1)) > _STEP_ERROR)
    uneven = np.mean(np.abs(counts[1:-1] - usual_count) > 1 + _COUNT_ERROR * usual_count)
    if max(odd, uneven) > _ODD_PART:
        return None
    each = int(np.ceil(_FEWEST_IN_A_PIECE / usual_count))
    times = _by_stamps(t_us, first, counts, usual_us, usual_count) if each == 1 else _by_pieces(stamps, counts, usual_us, each)
    return np.rint(times).astype(np.int64), usual_us


def _by_stamps(t_us, first, counts, usual_us, usual_count):
    """Times of samples of which many share a stamp: evenly over it.  A recording begins and ends within a stamp: the samples lie at its
    end, and at its beginning."""
    stamps = t_us[first].astype(float)
    width_us = np.minimum(np.append(np.diff(stamps), usual_us), (1 + _STEP_ERROR) * usual_us)
    period_us = width_us / counts
    for end in (0, -1):
        if counts[end] < usual_count:
            period_us[end] = usual_us / usual_count
    if counts[0] < usual_count:
        stamps[0] += max(width_us[0] - counts[0] * period_us[0], 0.0)
    place = np.arange(len(t_us)) - np.repeat(first, counts)
    return np.repeat(stamps, counts) + place * np.repeat(period_us, counts)


def _by_pieces(stamps, counts, usual_us, each):
    """The same where a stamp holds few, now one more and now one less: evenly over `each` stamps that follow one another."""
    index = np.concatenate([[0], np.cumsum(counts)])
    after_gap = np.flatnonzero(np.diff(stamps) > 1.5 * usual_us) + 1
    times = np.empty(index[-1])
    for a, b in zip([0, *after_gap], [*after_gap, len(stamps)]):
        knots = np.arange(a, max(b - each // 2, a + 1), each)
        end_us = stamps[b - 1] + usual_us
        times[index[a]:index[b]] = np.interp(np.arange(index[a], index[b]), np.append(index[knots], index[b]), np.append(stamps[knots], end_us))
    return times


def _without_late(clock, n_all):
    """Takes the samples out that lie before newer ones."""
    newest = np.maximum.accumulate(clock.t_us)
    late = clock.t_us < newest
    clock.n_late = int(np.count_nonzero(late))
    if clock.n_late == 0:
        return
    if too_many(clock.n_late, n_all):
        at = int(np.argmax(late))
        clock.problem = (f"{clock.n_late} of {many(n_all, 'sample')} lie before newer ones (the first is number {at + 1}, at {clock.t_us[at] / 1e6:.6f} s, after "
                         f"one at {newest[at] / 1e6:.6f} s): sort the file by its times or, where the clock was set back, cut it there")
    _take(clock, np.flatnonzero(~late))


def _take(clock, places):
    clock.rows = places if clock.rows is None else clock.rows[places]
    clock.t_us = clock.t_us[places]


def _untangle(stream, clock, rate_hz):
    """Settles the samples with the time of the one before them; places holds these."""
    places = np.flatnonzero(np.diff(clock.t_us) == 0) + 1
    if len(places) == 0:
        return
    n, equal = len(clock.t_us), _equal_to_the_one_before(stream, clock.rows, places)
    n_differ = int(np.count_nonzero(~equal))
    if too_many(n_differ, n):
        _spread_or_count(clock, rate_hz, n_differ)
        return
    clock.n_duplicate, clock.n_same = len(places) - n_differ, n_differ
    if too_many(clock.n_duplicate, n):
        clock.notes.append(f"{clock.n_duplicate} of {many(n, 'row')} stand twice, time and values: each is taken once")
    if n_differ:
        clock.notes.append(f"{many(n_differ, 'sample')} with the time of another, and other values, left out")
    _take(clock, np.delete(np.arange(n), places))


def _spread_or_count(clock, rate_hz, n_differ):
    """Of samples that share their stamps: their times, or the problem."""
    n_stamps = 1 + int(np.count_nonzero(np.diff(clock.t_us)))
    spread = _spread(clock.t_us)
    if spread:
        clock.t_us, clock.is_made = spread[0], True
        clock.notes.append(f"the time stamps are coarse: {many(len(clock.t_us), 'sample')} share {many(n_stamps, 'stamp')}, usually {spread[1] / 1e6:g} s apart; they are "
                           "spread evenly over the time of each stamp. Where another column holds finer times name it with --time; --rate HZ states the rate")
    elif rate_hz:
        clock.notes.append(f"{many(len(clock.t_us), 'sample')} share {many(n_stamps, 'time stamp')}: they are counted instead, at --rate {rate_hz:g} Hz from the first stamp "
                           "on; a gap could not be seen")
        clock.is_made, clock.t_us = True, clock.t_us[0] + np.rint(np.arange(len(clock.t_us)) * (1e6 / rate_hz)).astype(np.int64)
    else:
        why = "too few to tell the rate" if n_stamps < _FEWEST_STAMPS else "which do not come evenly"
        clock.problem = (f"{many(len(clock.t_us), 'sample')} share {many(n_stamps, 'time stamp')}, {why}, and {n_differ} differ from the sample before with the "
                         "same stamp: the times of the samples cannot be known. Name a column of finer times (--time COLUMN), or give the sample rate, "
                         "and the samples are counted: --rate HZ")


def clock_of(stream, rate_hz=None):
    """The Clock of a Stream; rate_hz: as the user gave it."""
    rows = _finite_rows(stream)
    clock = Clock(rows, np.asarray(stream.t_us, np.int64) if rows is None else stream.t_us[rows], notes=[])
    n_rated = len(clock.t_us)
    if len(clock.t_us) > 1 and not (np.diff(clock.t_us) > 0).all():
        _without_late(clock, len(clock.t_us))
        if not clock.problem:
            _untangle(stream, clock, rate_hz)
    stamps = in_order(clock.t_us)  # where there is a problem some stand in another order, or twice
    clock.rate_hz = stream.rate_hz or (nominal_rate_hz(stamps) if len(stamps) > 1 else 0.0)
    if n_rated < len(stream.t_us):
        _count_empty(stream, clock, len(stream.t_us), n_rated)
    return clock


def _count_empty(stream, clock, n_rows, n_rated):
    """Says which rows have no rate.  Samples that were lost are missing at the rate of the rows, and their seconds are flagged; a gyro that is written
    into every k-th row has a rate of its own."""
    clock.n_empty = n_rows - n_rated
    text = f"{clock.n_empty} of {many(n_rows, 'row')} {'has' if clock.n_empty == 1 else 'have'} no rate"
    steps = np.diff(clock.t_us)
    if not stream.is_seconds and not stream.rate_hz and len(steps) and not clock.problem:
        usual = float(np.median(steps))
        is_even = np.mean(np.abs(steps - usual) > _STEP_ERROR * usual) <= _ODD_PART and abs(1e6 / usual / clock.rate_hz - 1) < _STEP_ERROR
        of_rows = nominal_rate_hz(in_order(np.asarray(stream.t_us, np.int64))) if not clock.is_made else clock.rate_hz * n_rows / n_rated
        if is_even and clock.rate_hz < (1 - _STEP_ERROR) * of_rows:
            text += f": the rates come at {clock.rate_hz:.4g} Hz, the rows at {of_rows:.4g} Hz"
        else:
            clock.rate_hz = of_rows
    clock.notes.append(text)
