# SPDX-License-Identifier: MIT
"""Two simulators written apart, `gyrosim` and the blind check's own, mean the same by the contract's names."""
import csv
import json
import os
import subprocess
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.join(os.path.dirname(__file__), ".."))
from blind import campaign, simulate, strength, whiten  # noqa: E402

GYROSIM = os.path.join(os.environ.get("BUILD", "build"), "bin", "gyrosim")
PROFILE = {"imucal_profile": 1, "start_degc": 0, "repeat": 1, "segments": [
    {"rate_degc_per_min": 0, "duration_s": 300}, {"rate_degc_per_min": 2, "to_degc": 40},
    {"rate_degc_per_min": 0, "duration_s": 400}, {"rate_degc_per_min": 1, "to_degc": 15},
    {"rate_degc_per_min": 2, "to_degc": 60}, {"rate_degc_per_min": 1.5, "to_degc": 20}]}
BIAS = [80.0, 300.0, 150.0, -100.0]


def gyrosim_log(folder, effects, arw=1e-4, markov=(), seed=3):
    """One simulated log: (temperature, rate)."""
    model = {"imucal_model": 1, "arw_deg_rt_h": arw, "markov": [{"sigma_dph": s, "tau_s": t} for s, t in markov],
             "turn_on_sigma_dph": 0, "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": BIAS}}
    for name, content in (("model", model), ("profile", PROFILE), ("effects", effects)):
        (folder / f"{name}.json").write_text(json.dumps(content))
    subprocess.run([GYROSIM, "log", "--model", folder / "model.json", "--profile", folder / "profile.json", "--effects",
                    folder / "effects.json", "--seed", str(seed), "-o", folder / "log.csv", "--quiet"], check=True)
    with open(folder / "log.csv", encoding="utf-8") as f:
        rows = list(csv.reader(line for line in f if not line.startswith("#")))
    table = np.array([[float(v) for v in row[:3]] for row in rows[1:]])
    return table[:, 1], table[:, 2]


def campaign_of(temp, nominal=None):
    nominal = nominal or campaign.Nominal(0.6, [(20.0, 100.0)], 30.0, 30.0)
    run = campaign.Run(np.arange(temp.size, dtype=float), temp, temp, True)
    return campaign.Group("x", "x", nominal, nominal, [run], [])


@pytest.mark.parametrize("name, parameters, relative", [
    ("temperature_rate", {"k_dph_per_degc_min": 15.0}, 0.1),
    ("thermal_hysteresis", {"amplitude_dph": 20.0, "width_degc": 5.0}, 0.1),
    ("thermal_lag", {"tau_s": 150.0}, 0.1),
    ("thermal_anomaly", {"amplitude_dph": 40.0, "center_degc": 33.0, "width_degc": 3.0}, 0.02),
    ("higher_order_polynomial", {"p4_dph": 30.0, "p5_dph": -20.0}, 0.02),
    ("rate_ramp", {"ramp_dph_per_h": 25.0}, 0.02),
    ("warm_up", {"amplitude_dph": 60.0, "tau_s": 400.0}, 0.02)])
def test_signatures_agree(tmp_path, name, parameters, relative):
    """Up to a constant (a turn-on constant is fitted anyway): rms difference relative to the signature's rms."""
    temp, plain = gyrosim_log(tmp_path, [])
    temp_with, changed = gyrosim_log(tmp_path, [{"name": name, "parameters": parameters}])
    np.testing.assert_allclose(temp, temp_with, atol=1e-6)
    group = campaign_of(temp)
    mine = simulate.signature({"name": name, "parameters": parameters}, group, group.train[0], 0, np.array(BIAS))
    theirs = changed - plain
    difference = (theirs - theirs.mean()) - (mine - mine.mean())
    assert np.std(difference) < relative * np.std(mine), (np.std(difference), np.std(mine))


@pytest.mark.parametrize("name, parameters", [
    ("second_markov", {"sigma_dph": 25.0, "tau_s": 12.0}), ("rate_random_walk", {"k_dph_per_rt_s": 2.0}),
    ("flicker_noise", {"b_dph": 30.0}), ("white_noise_vs_temperature", {"slope": 0.9}),
    ("markov_sigma_vs_temperature", {"slope": 1.5}), ("markov_tau_vs_temperature", {"slope": -1.5}),
    ("noise_parameters", {"arw_deg_rt_h": 0.5, "sigma_dph": 35.0, "tau_s": 30.0})])
def test_noise_of_gyrosim_is_white_under_this_noise_model(tmp_path, name, parameters):
    """Standardised innovations of gyrosim's noise under the model here have variance 1 and no correlation; under
    the nominal model they do not."""
    effect = {"name": name, "parameters": parameters}
    temp, rate = gyrosim_log(tmp_path, [effect], 0.6, [(20.0, 100.0)])
    group = campaign_of(temp)
    y, keep = whiten.pad([(rate - simulate.polynomial(np.array(BIAS), group.x(temp)))[:, None]])
    e, _ = whiten.kalman(y, strength.noise_model(group, group.train, [effect]), keep)
    e = e[0, :, 0]
    n = e.size
    assert abs(np.mean(e**2) - 1) < 4 * np.sqrt(2 / n)
    assert abs(np.mean(e[1:] * e[:-1])) < 4 / np.sqrt(n)
    half = group.x(temp) > 0
    assert abs(np.mean(e[half] ** 2) - 1) < 4 * np.sqrt(2 / half.sum())
    right = whiten.gaussian_log_likelihood(y, strength.noise_model(group, group.train, [effect]), keep)
    wrong = whiten.gaussian_log_likelihood(y, whiten.nominal_noise(group.nominal), keep)
    assert (right - wrong)[0, 0] > 10
