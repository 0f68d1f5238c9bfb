# SPDX-License-Identifier: MIT
"""The long profiles of reference figures A, tests/README.md on an emulated Cortex-M4F (the short ones: tests/system/test_calibrate_figures.py)."""
import pytest
import test_calibrate_figures
from test_calibrate_figures import alternating, predicted

m4f = test_calibrate_figures.m4f  # a fixture, found by its name


@pytest.mark.parametrize("cycles, worst", [(4, 3.56), (8, 2.52)])
def test_m4f_cycles_figure_9(m4f, cycles, worst):
    assert max(predicted(m4f, alternating(cycles)).values()) == pytest.approx(worst, rel=0.01)
