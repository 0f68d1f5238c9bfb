# SPDX-License-Identifier: MIT
"""imucal.plot.*: from results of the programs to figures; the scripts draw with nothing of their own."""
import json
import re
import subprocess

import numpy as np
import pytest

from imucal.log import Log
from imucal.plot import prediction, profiles
from reference import NOISE
from where import BIN, ROOT

RAMP = {"imucal_profile": 1, "start_degc": 0, "segments": [{"rate_degc_per_min": 0.6, "to_degc": 60}, {"rate_degc_per_min": 0, "duration_s": 600}]}


@pytest.fixture
def result(tmp_path):
    """result("profile", "error", …) -> the program's JSON, beside a model and a profile."""
    (tmp_path / "model.json").write_text(json.dumps(NOISE))
    (tmp_path / "ramp.json").write_text(json.dumps(RAMP))
    subprocess.run([BIN / "gyrosim", "log", "--model", "model.json", "--profile", "ramp.json", "-o", "log.csv", "-q"], cwd=tmp_path, check=True)

    def run(*words):
        done = subprocess.run([BIN / words[0], *map(str, words[1:]), "--json", "-"], cwd=tmp_path, capture_output=True, text=True, check=True)
        return json.loads(done.stdout)
    return run


def drawn(ax):
    """{label: y of its line}"""
    return {line.get_label(): np.asarray(line.get_ydata()) for line in ax.get_lines()}


def test_curves_and_their_expectation_are_the_programs(result):
    curve = result("dp", "log.csv", "--type", "dp2", "--nominal", "model.json", "--tau", "2:100:2", "--no-ratios")["curves"][0]
    expected = result("errormodel", "expect", "model.json", "--type", "dp2", "--nominal", "model.json", "--tau", "2:100:2")
    figure = prediction.curves_and_expectation({"dp2": (curve, expected)})
    lines = figure.axes[0].get_lines()
    np.testing.assert_array_equal(lines[0].get_ydata(), curve["dp_dph"])
    np.testing.assert_array_equal(lines[1].get_ydata(), expected["dp_dph"])
    assert [t.get_text() for t in figure.axes[0].get_legend().get_texts()] == ["DP type 2"]


def test_bounds_show_the_ratio_to_what_was_recorded():
    tau, dp = [1, 10, 100], np.array([30.0, 20.0, 10.0])
    figure = prediction.bounds(tau, dp, [("twice", {"tau_s": tau, "dp_dph": (2 * dp).tolist()})])
    assert list(drawn(figure.axes[0])) == ["recorded", "twice"]
    np.testing.assert_allclose(figure.axes[1].get_lines()[0].get_ydata(), 2)


def test_smoothed_residual_takes_the_polynomial_out():
    t = np.arange(4000.0)
    temp = 20 + t / 100
    figure = prediction.smoothed_residual(Log(t, temp, {"gx_dph": 5 + 0.1 * temp ** 3}), "gx_dph", 3, 120)
    assert np.max(np.abs(figure.axes[1].get_lines()[0].get_ydata())) < 1e-6


def test_calibration_error_and_profile_are_the_programs(result):
    error = result("profile", "error", "ramp.json", "--model", "model.json", "--order", 3)
    figure = profiles.calibration_errors("a ramp", [("ramp", error)])
    np.testing.assert_array_equal(drawn(figure.axes[0])["ramp"], error["sigma_dph"])
    minutes, temp = profiles.temperature_curve(RAMP)
    assert minutes.tolist() == [0, 100, 110] and temp == [0, 60, 60]
    minutes, temp = profiles.temperature_curve({**RAMP, "repeat": 2})
    assert minutes.tolist() == [0, 100, 110, 110, 120] and temp == [0, 60, 60, 60, 60]


@pytest.mark.parametrize("script", ["figures_dp.py", "figures_profile.py", "diagnosis_report.py", "plot_calibration.py", "demo.py"])
def test_scripts_draw_with_nothing_of_their_own(script):
    text = (ROOT / "host/scripts" / script).read_text(encoding="utf-8")
    assert not re.search(r"import matplotlib|pyplot|\.plot\([^)]*,|ax\.|axhline|fill_between", text), script
    assert "imucal.plot" in text or "plot_calibration" in text
