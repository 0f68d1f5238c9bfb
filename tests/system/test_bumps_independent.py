# SPDX-License-Identifier: MIT
"""Bumps of the bias over temperature in shapes that no library holds, in logs that this file simulates itself.

Three logs of 100 minutes go by ramps and soaks between 0 and 60 degC.  The bias is a cubic of the temperature and one
bump; the noise is white noise and one first-order process, as in the model.  The height makes the bump worth 60 nats to who
knows its shape and fits a cubic beside it.  No code is shared with the programs."""
import itertools
import math

import numpy as np
import pytest

from asking import DIAGNOSE, axis_told, model_option, with_members, write_log

SECONDS, LOGS, NATS = 6000, 3, 60
WHITE, SLOW, TAU_S = 36.0, 20.0, 100.0  # dph per second's mean, dph, s
MODEL = {"imucal_model": 1, "arw_deg_rt_h": WHITE / 60, "markov": [{"sigma_dph": SLOW, "tau_s": TAU_S}],
         "bias": {"t0_degc": 20, "range_degc": 40, "coeff_dph": [-60, 150, -50, 40]}}
SHAPES = {  # of the distance from the centre in degC
    "lorentzian": lambda x: 1 / (1 + (x / 1.8) ** 2),
    "steep on one side": lambda x: np.where(x < 0, 1 / (1 + (x / 0.5) ** 2), np.exp(-abs(x) / 3.5)),
    "flat on top": lambda x: 1 / (1 + (x / 2.5) ** 8),
    "two lobes": lambda x: np.exp(-((x + 1.8) / 0.9) ** 2 / 2) + 0.7 * np.exp(-((x - 1.8) / 0.9) ** 2 / 2),
    "narrow": lambda x: 1 / (1 + (x / 0.5) ** 2)}
CONTROLS = {"no bump": lambda x: 0 * x, "fourth order": lambda x: (x / 30) ** 4}


def first_order(drive, tau_s, start, gain):
    phi = math.exp(-1 / tau_s)
    return np.array([*itertools.accumulate(gain * drive[1:], lambda y, d: phi * y + d, initial=start)])


def temperature(rng):
    t, degc, towards, at = 0.0, rng.uniform(0, 60), rng.choice([-1, 1]), []
    while t < SECONDS:
        at.append((t, degc))
        t += rng.choice([0, rng.uniform(200, 700)])
        at.append((t, degc))
        goal = min(max(degc + towards * rng.uniform(20, 60), 0), 60)
        t, degc, towards = t + abs(goal - degc) / rng.uniform(0.8, 2.5) * 60, goal, -towards
    air, tau_s = np.interp(np.arange(SECONDS), *zip(*at, (t, degc))), rng.uniform(60, 150)
    return first_order(air, tau_s, air[0], 1 - math.exp(-1 / tau_s))


def whitened(columns):
    """Innovations of the Kalman filter of the noise, in their standard deviations."""
    phi, state, variance, out = math.exp(-1 / TAU_S), 0.0, SLOW ** 2, np.empty_like(columns)
    for k, row in enumerate(columns):
        total, miss = variance + WHITE ** 2, row - state
        out[k], state = miss / math.sqrt(total), phi * (state + variance / total * miss)
        variance = phi ** 2 * variance * WHITE ** 2 / total + SLOW ** 2 * (1 - phi ** 2)
    return out


def answer(name, seed, folder):
    rng, curve = np.random.default_rng(seed), {**SHAPES, **CONTROLS}[name]
    centre, sign = (rng.uniform(6, 54), rng.choice([-1, 1])) if name in SHAPES else (30, 1)
    logs = [(t, sign * curve(t - centre)) for t in (temperature(rng) for _ in range(LOGS))]
    both = np.vstack([whitened(np.column_stack([c, np.vander(t / 60, 4)])) for t, c in logs])
    left = both[:, 0] - both[:, 1:] @ np.linalg.lstsq(both[:, 1:], both[:, 0], rcond=None)[0]
    height = math.sqrt(2 * NATS / (left @ left)) if name != "no bump" else 0
    paths = []
    for i, (t, c) in enumerate(logs):
        slow, white, read = (rng.standard_normal(SECONDS) for _ in range(3))
        rate = np.polyval(MODEL["bias"]["coeff_dph"][::-1], (t - 20) / 40) + height * c + WHITE * white
        rate += first_order(slow, TAU_S, SLOW * slow[0], SLOW * math.sqrt(1 - math.exp(-2 / TAU_S)))
        paths.append(write_log(folder / f"{i}.csv", np.arange(1, SECONDS + 1), t + 0.02 * read, rate, form="%.3f,%.3f,%.3f"))
    return axis_told(DIAGNOSE, model_option(folder / "model.json", MODEL), paths)


@pytest.mark.parametrize("name,seed", [(name, 31 + i) for i, name in enumerate(SHAPES)])
def test_a_clear_bump_of_any_shape_is_told_as_a_bump(name, seed, tmp_path):
    axis = answer(name, seed, tmp_path)
    told, effects = with_members(axis), axis["effects"]
    # A slope of half a degree may be told as a step.
    assert "thermal_anomaly" in told or (name == "steep on one side" and "thermal_step" in told), effects
    assert not told & {"thermal_hysteresis", "thermal_lag", "thermal_creep"}, effects


@pytest.mark.parametrize("name,seed", [("no bump", 41), ("fourth order", 42)])
def test_a_control_is_no_bump(name, seed, tmp_path):
    effects = answer(name, seed, tmp_path)["effects"]
    sets = [[member["name"] for member in e["set"]] for e in effects]
    assert ["thermal_anomaly"] not in sets and (name != "no bump" or not sets), effects
