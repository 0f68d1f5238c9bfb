# SPDX-License-Identifier: MIT
"""`errormodel fit --criterion ml` takes logs of which many seconds are missing: no window of the curve's longer taus is whole."""
import json
import subprocess

import numpy as np
import pytest

from where import BIN

PROGRAM = BIN / "errormodel"


def write(path, keep, n=6000, white_dph=36.0, sigma_dph=25.0, tau_s=60.0):
    rng = np.random.default_rng(8)
    t = np.arange(1, n + 1)
    phi, slow = np.exp(-1 / tau_s), np.zeros(n)
    for k in range(1, n):
        slow[k] = phi * slow[k - 1] + sigma_dph * np.sqrt(1 - phi**2) * rng.standard_normal()
    rate = 100 + slow + white_dph * rng.standard_normal(n)
    rows = [f"{i},25,{r:.6f}" for i, r, there in zip(t, rate, keep(rng, n)) if there]
    path.write_text("t_s,temp_degc,gx_dph\n" + "\n".join(rows) + "\n")


def fit(tmp_path, *extra, code=0):
    done = subprocess.run([PROGRAM, "fit", tmp_path / "log.csv", "--markov", "1", "--detrend", "mean", "--json", tmp_path / "fit.json",
                           "-o", tmp_path / "model.json", *extra], capture_output=True, text=True)
    assert done.returncode == code, done.stderr
    return (json.loads((tmp_path / "fit.json").read_text()) if code in (0, 1) else None), done.stderr


def test_likelihood_takes_what_is_there_and_the_curve_ends_at_whole_windows(tmp_path):
    write(tmp_path / "log.csv", lambda rng, n: rng.random(n) > 0.3)
    found, said = fit(tmp_path, "--criterion", "ml")
    for parameter, truth in {"arw_deg_rt_h": 0.6, "markov[0].sigma_dph": 25, "markov[0].tau_s": 60}.items():
        at = next(p for p in found["parameters"] if p["name"] == parameter)
        assert abs(at["value"] - truth) < 4 * at["std_error"]
    assert "the curve ends at" in said and found["tau_s"][-1] < 30
    assert all(value > 0 for value in found["data_dp_dph"])


def test_nothing_is_said_where_windows_are_whole(tmp_path):
    write(tmp_path / "log.csv", lambda rng, n: np.arange(n) != 100)
    found, said = fit(tmp_path, "--criterion", "ml")
    assert said == "" and found["tau_s"][-1] > 500


@pytest.mark.parametrize("extra", [("--criterion", "ls"), ("--criterion", "ml", "--tau", "2:200")])
def test_a_fit_to_the_curve_and_taus_that_were_asked_for_are_refused_as_before(tmp_path, extra):
    write(tmp_path / "log.csv", lambda rng, n: rng.random(n) > 0.3)
    _, said = fit(tmp_path, *extra, code=3)
    assert "free of missing samples" in said and not (tmp_path / "model.json").exists()
