# SPDX-License-Identifier: MIT
"""The demonstration's picture keeps what depends on the direction of the temperature: a loop stays a loop."""
import numpy as np

from imucal.plot import calibration as plot_calibration

UP, TOP = np.linspace(0, 60, 100), np.full(15, 60.0)
TEMP_DEGC = np.concatenate([UP, TOP, UP[::-1]])
LOOP_DPH = np.concatenate([np.full(100, 20.0), np.full(15, 20.0), np.full(100, -20.0)])


def test_directions_follow_the_slope():
    masks = plot_calibration.by_direction(TEMP_DEGC)
    assert masks[1][50] and masks[-1][170] and masks[0][107]
    assert np.all(sum(m.astype(int) for m in masks.values()) == 1)


def test_a_loop_is_drawn_as_two_branches_not_as_their_mean():
    _, ax = plot_calibration.subplots()
    plot_calibration.draw_directions(ax, {"temp_degc": TEMP_DEGC, "rate_dph": LOOP_DPH}, means=True)
    lines = {line.get_label(): line for line in ax.get_lines()}
    assert np.allclose(lines["mean, rising"].get_ydata()[:-1], 20)
    assert np.allclose(lines["mean, falling"].get_ydata()[:-1], -20)
    assert lines["rising"].get_color() != lines["falling"].get_color()
    assert lines["rising"].get_marker() != lines["falling"].get_marker(), "a grey print tells them apart"
