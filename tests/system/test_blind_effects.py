# SPDX-License-Identifier: MIT
"""Two simulators written apart, `gyrosim` and the blind check's own, mean the same by the contract's names."""
import csv
import json
import subprocess

import numpy as np
import pytest

from blind import causes, noise, sensor, whiten
from where import BIN

GYROSIM = BIN / "gyrosim"
PROFILE = {"imucal_profile": 1, "start_degc": 0, "repeat": 1, "segments": [
    {"rate_degc_per_min": 0, "duration_s": 300}, {"rate_degc_per_min": 2, "to_degc": 40},
    {"rate_degc_per_min": 0, "duration_s": 400}, {"rate_degc_per_min": 1, "to_degc": 15},
    {"rate_degc_per_min": 2, "to_degc": 60}, {"rate_degc_per_min": 1.5, "to_degc": 20}]}
BIAS = [80.0, 300.0, 150.0, -100.0]


def known_effects():
    listing = subprocess.run([BIN / "diagnose", "--list-effects"], capture_output=True, text=True, check=False)
    return listing.stdout or " ".join(causes.FAMILY_OF)


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


def device_of(temp):
    """The blind check's device with one run of this temperature and the normalisation of the model file."""
    run = sensor.Run(np.arange(temp.size, dtype=float), temp, temp, np.ones(temp.size, bool), np.zeros(temp.size))
    return sensor.Device("x", [run], [], 30.0, 30.0, 0.001)


def start_columns(name, p, temp):
    """What a start state, which both draw for themselves, can change."""
    t = np.arange(temp.size)
    if name == "thermal_hysteresis":
        r = p["width_degc"]
        return [(causes.play(temp, r, 1) - causes.play(temp, r, -1)) / (2 * r)]
    taus = {"thermal_lag": ["tau_s"], "thermal_creep": ["tau_first_s", "tau_last_s"]}.get(name, [])
    return [np.exp(-t / p[k]) for k in taus] + ([np.exp(-t / p["tau_s"]) * temp] if name == "thermal_lag" else []) + (
        [np.exp(-t / np.sqrt(p["tau_first_s"] * p["tau_last_s"]))] if name == "thermal_creep" else [])


@pytest.mark.parametrize("name, parameters, relative", [
    ("temperature_rate", {"k_dph_per_degc_min": 15.0}, 0.1),
    ("thermal_hysteresis", {"amplitude_dph": 20.0, "width_degc": 5.0}, 0.1),
    ("thermal_lag", {"tau_s": 150.0}, 0.1),
    ("thermal_anomaly", {"amplitude_dph": 40.0, "center_degc": 33.0, "width_degc": 3.0}, 0.02),
    ("higher_order_polynomial", {"p4_dph": 30.0, "p5_dph": -20.0}, 0.02),
    ("rate_ramp", {"ramp_dph_per_h": 25.0}, 0.02),
    ("warm_up", {"amplitude_dph": 60.0, "tau_s": 400.0}, 0.02),
    ("thermal_step", {"amplitude_dph": 50.0, "temp_degc": 35.0, "width_degc": 4.0}, 0.1),
    ("thermal_creep", {"amplitude_dph_per_degc": 3.0, "tau_first_s": 100.0, "tau_last_s": 4000.0}, 0.1)])
def test_signatures_agree(tmp_path, name, parameters, relative):
    """Up to a constant and the start states, which are free: rms difference relative to the signature's rms."""
    if name not in known_effects():
        pytest.skip(f"SKIP: this gyrosim does not simulate {name} yet")
    temp, plain = gyrosim_log(tmp_path, [])
    temp_with, changed = gyrosim_log(tmp_path, [{"name": name, "parameters": parameters}])
    np.testing.assert_allclose(temp, temp_with, atol=1e-6)
    device = device_of(temp)
    mine = causes.signature({"name": name, "p": parameters}, device, 0, np.array(BIAS))
    if name == "warm_up":  # a warm restart shows a part of it
        share = np.polyfit(mine, changed - plain, 1)[0]
        assert 0 < share < 2
        mine = share * mine
    free = np.column_stack([np.ones(temp.size), *start_columns(name, parameters, temp)])
    difference = changed - plain - mine
    difference = difference - free @ np.linalg.lstsq(free, difference, rcond=None)[0]
    mine = mine - free @ np.linalg.lstsq(free, mine, rcond=None)[0]
    assert np.std(difference) < relative * np.std(mine), (np.std(difference), np.std(mine))


def noise_model(device, effects):
    """Kalman form of the blind check's noise levels; a unit process with a weight where sigma varies."""
    white, markov = causes.levels(effects, device, device.train[0], noise.Noise(36.0, [(20.0, 100.0)]))
    row = lambda v: np.broadcast_to(v, (1, device.train[0].n)) if np.ndim(v) else np.full(1, v)
    parts = [(*whiten.markov_part(1.0, row(tau))[:3], row(sigma)) for sigma, tau in markov]
    for cause in effects:
        p = cause["p"]
        if cause["name"] == "second_markov":
            parts.append(whiten.markov_part(p["sigma_dph"], p["tau_s"]))
        elif cause["name"] == "rate_random_walk":
            parts.append((1.0, p["k_dph_per_rt_s"] ** 2, 0.0, 1.0))
        elif cause["name"] == "flicker_noise":
            part = np.sqrt(p["b_dph"] ** 2 * np.log(2.0) / np.pi)
            parts += [whiten.markov_part(part, 0.6 * 2.0**k) for k in range(18)]
    return whiten.Noise(row(np.square(white)), parts)


@pytest.mark.parametrize("name, parameters", [
    ("second_markov", {"sigma_dph": 25.0, "tau_s": 12.0}), ("rate_random_walk", {"k_dph_per_rt_s": 2.0}),
    ("flicker_noise", {"b_dph": 30.0}), ("white_noise_vs_temperature", {"slope": 0.9}),
    ("markov_sigma_vs_temperature", {"slope": 1.5}), ("markov_tau_vs_temperature", {"slope": -1.5}),
    ("noise_parameters", {"arw_deg_rt_h": 0.5, "sigma_dph": 35.0, "tau_s": 30.0})])
def test_noise_of_gyrosim_is_white_under_this_noise_model(tmp_path, name, parameters):
    """Standardised innovations of gyrosim's noise under the model here have variance 1 and no correlation; under
    the nominal model they do not."""
    temp, rate = gyrosim_log(tmp_path, [{"name": name, "parameters": parameters}], 0.6, [(20.0, 100.0)])
    device, cause = device_of(temp), {"name": name, "p": parameters}
    y, keep = whiten.pad([(rate - causes.polynomial(np.array(BIAS), device.x(temp)))[:, None]])
    e = whiten.kalman(y, noise_model(device, [cause]), keep)[0][0, :, 0]
    n = e.size
    assert abs(np.mean(e**2) - 1) < 4 * np.sqrt(2 / n)
    assert abs(np.mean(e[1:] * e[:-1])) < 4 / np.sqrt(n)
    half = device.x(temp) > 0
    assert abs(np.mean(e[half] ** 2) - 1) < 4 * np.sqrt(2 / half.sum())
    right = whiten.gaussian_log_likelihood(y, noise_model(device, [cause]), keep)
    wrong = whiten.gaussian_log_likelihood(y, noise_model(device, []), keep)
    assert (right - wrong)[0, 0] > 10
