# SPDX-License-Identifier: MIT
"""The long profiles of reference figures A, tests/README.md on an emulated Cortex-M4F (the short ones: tests/system/test_calibrate_figures.py)."""
import pytest
from test_calibrate_figures import alternating, m4f, predicted  # noqa: F401  (m4f is a fixture)


@pytest.mark.parametrize("cycles, worst", [(4, 3.56), (8, 2.52)])
def test_m4f_cycles_figure_9(m4f, cycles, worst):  # noqa: F811
    assert max(predicted(m4f, alternating(cycles)).values()) == pytest.approx(worst, rel=0.01)
