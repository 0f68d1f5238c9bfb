# SPDX-License-Identifier: MIT
"""Rising, falling, at rest: one answer, whatever the speed of the log, and drawn so that a grey print keeps it."""
import re

import numpy as np
import pytest

from imucal.direction import directions
from imucal.plot.marks import DIRECTIONS
from where import ROOT

UP, REST, DOWN = 1, 0, -1


def trapezium(n, low, high):
    """Rest, up, rest, down, rest: (seconds, degrees, true direction)."""
    at = np.array([0, 0.1, 0.45, 0.55, 0.9, 1]) * n
    t = np.arange(n, dtype=float)
    truth = np.select([(t > at[1]) & (t < at[2]), (t > at[3]) & (t < at[4])], [UP, DOWN], REST)
    return t, np.interp(t, at, [low, low, high, high, low, low]), truth


@pytest.mark.parametrize("n, low, high, noise_degc, step_degc", [
    (n, low, high, *thermometer) for n, low, high in ((8400, 0, 60), (14000, 23, 26), (90000, 5, 16), (1200, -10, 70))
    for thermometer in ((0, 0), (0.01, 0), (0.01, 0.01), (0, 1)) if thermometer[1] < 0.1 * (high - low)])
def test_fast_and_slow_logs_are_told_alike(n, low, high, noise_degc, step_degc):
    t, temp, truth = trapezium(n, low, high)
    temp = temp + noise_degc * np.random.default_rng(1).standard_normal(n)
    if step_degc:
        temp = step_degc * np.round(temp / step_degc)
    assert np.mean(directions(t, temp) == truth) > 0.88


def test_night_outdoors_of_hundredths_of_a_degree_a_minute_rises():
    t = np.arange(72000.0)
    temp = 5 + 11 * t / len(t) + 0.03 * np.random.default_rng(2).standard_normal(len(t))  # 0.009 degC/min
    assert np.mean(directions(t, temp) == UP) > 0.95


@pytest.mark.parametrize("temp", [25 + 0.05 * np.random.default_rng(3).standard_normal(9000),
                                  np.round(25.4 + 0.1 * np.random.default_rng(3).standard_normal(9000)), np.full(9000, 25.0),
                                  np.full(9000, np.nan)], ids=["noisy", "coarse", "still", "none"])
def test_a_thermometer_that_rests_moves_nowhere(temp):
    assert not directions(np.arange(9000.0), temp).any()


def test_means_of_minutes_and_missing_rows_change_nothing():
    t, temp, truth = trapezium(14400, 0, 60)
    minutes = directions(t[30::60], temp[30::60])
    assert np.mean(minutes == truth[30::60]) > 0.93
    kept = np.random.default_rng(4).random(len(t)) > 0.3
    kept[5000:6500] = False
    assert np.mean(directions(t[kept], temp[kept]) == truth[kept]) > 0.93


def luminance(color):
    return np.dot([0.2126, 0.7152, 0.0722], [int(color[k:k + 2], 16) / 255 for k in (1, 3, 5)])


def test_marks_differ_in_shape_and_in_grey():
    rising, falling, rest = DIRECTIONS[UP], DIRECTIONS[DOWN], DIRECTIONS[REST]
    assert len({(m.marker, m.is_filled) for m in (rising, falling, rest)}) == 3
    assert abs(luminance(rising.color) - luminance(falling.color)) > 0.15


@pytest.mark.parametrize("module", ["__init__", "calibration", "diagnosis"])
def test_directions_have_no_colours_of_a_module_s_own(module):
    text = (ROOT / f"host/python/imucal/plot/{module}.py").read_text(encoding="utf-8")
    assert "DIRECTIONS" in text and not re.search(r"(?:RISING|FALLING|SOAK|DIRECTIONS?)\b[^\n]*= *[({]?[^\n]*#[0-9a-f]{6}", text)
    assert not re.search(r"STEADY_DEGC|RESTING_DEGC_MIN", text), "a threshold of its own"
