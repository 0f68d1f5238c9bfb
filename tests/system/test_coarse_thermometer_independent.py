# SPDX-License-Identifier: MIT
"""Thermometers with steps of 0.5, 1 and 2 degC, in logs that this file simulates itself.

A chamber goes in ramps of 0.3 to 1 degC/min with soaks and reversals, 100 minutes a log; it was soaked before the log
starts.  A block follows its air.  Without a lag the gyro sits in the block and the thermometer follows it 0 to 6 s later;
with one the thermometer is in the block and the gyro follows it 300 to 600 s later.  The thermometer has a noise of its own
before it rounds.  The bias is a cubic of the gyro's own temperature; its noise is white noise and one first-order process,
and the model that is believed has just these.  No code is shared with the programs.

What the data can tell is reckoned here with the noise and the temperatures that are true: a lead of seconds is worth less
than 1 nat in all logs together, even to who reads the thermometer without steps; a lag of minutes is worth more than 30 to
who reads the steps and fits each of them a bias of its own."""
import functools
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest

from asking import DIAGNOSE, axis_told, model_option, names, with_members, write_log

SECONDS = 6000
WHITE, SLOW, TAU_S = 36.0, 8.0, 120.0  # dph per second's mean, dph, s
T0_DEGC, RANGE_DEGC = 20, 40
COEFF_DPH = {"gentle": [-90, 170, -60, 40], "steep": [60, -420, 110, 80]}  # about 4 and 10 dph/degC
STEPS_DEGC = (0.5, 1.0, 2.0)
PLACES = [(step, slope) for step in STEPS_DEGC for slope in COEFF_DPH]
COARSE = [("coarse", *place, 0) for place in PLACES[1:]]
LAG = [("lag", step, "gentle", 0) for step in STEPS_DEGC]


def chamber(rng):
    """Set temperature: a soak, then ramps and soaks in turn; about one ramp in three turns round with no soak."""
    t, degc, towards = 0.0, rng.uniform(-10, 45), rng.choice([-1, 1])
    at = [(t, degc)]
    while t < SECONDS:
        if len(at) == 1 or rng.random() < 2 / 3:
            t += rng.uniform(300, 900)
            at.append((t, degc))
        goal = min(max(degc + towards * rng.uniform(12, 35), -20), 60)
        t += abs(goal - degc) / rng.uniform(0.3, 1.0) * 60
        at.append((t, goal))
        degc, towards = goal, -towards
    return np.interp(np.arange(SECONDS) + 0.5, *zip(*at))


def follows(degc, tau_s):
    """Newton cooling: exact from second to second where the other body moves in a straight line between them."""
    if tau_s == 0:
        return degc.copy()
    phi = math.exp(-1 / tau_s)
    mean = tau_s * (1 - phi)
    out = np.empty(len(degc))
    out[0] = degc[0]
    for k in range(1, len(degc)):
        out[k] = phi * out[k - 1] + (mean - phi) * degc[k - 1] + (1 - mean) * degc[k]
    return out


def cubic(degc, coeff):
    return np.polynomial.polynomial.polyval((degc - T0_DEGC) / RANGE_DEGC, coeff)


def first_order(rng):
    phi = math.exp(-1 / TAU_S)
    out = np.empty(SECONDS)
    out[0] = SLOW * rng.standard_normal()
    drive = SLOW * math.sqrt(1 - phi ** 2) * rng.standard_normal(SECONDS)
    for k in range(1, SECONDS):
        out[k] = phi * out[k - 1] + drive[k]
    return out


class Log:
    def __init__(self, rng, step_degc, coeff, lead_s, lag_s):
        block = follows(chamber(rng), rng.uniform(60, 150))
        self.gyro = follows(block, lag_s)
        self.place = follows(block, lead_s)
        read = self.place + rng.uniform(0.01, 0.05) * rng.standard_normal(SECONDS)
        self.read = np.round(read / step_degc) * step_degc
        self.rate = cubic(self.gyro, coeff) + WHITE * rng.standard_normal(SECONDS) + first_order(rng)


@functools.lru_cache(maxsize=None)
def simulate(kind, step_degc, slope, seed):
    rng = np.random.default_rng([seed, round(10 * step_degc), list(COEFF_DPH).index(slope), kind == "lag"])
    lead_s, lag_s = (0.0, rng.uniform(300, 600)) if kind == "lag" else (rng.uniform(0, 6), 0.0)
    return [Log(rng, step_degc, COEFF_DPH[slope], lead_s, lag_s) for _ in range(3 + seed % 2)], lead_s, lag_s


def whitened(columns):
    """Innovations of the Kalman filter of the noise, in their standard deviations."""
    phi, out = math.exp(-1 / TAU_S), np.empty_like(columns)
    state, variance = np.zeros(columns.shape[1]), SLOW ** 2
    for k, row in enumerate(columns):
        total = variance + WHITE ** 2
        out[k] = (row - state) / math.sqrt(total)
        state = phi * (state + variance / total * (row - state))
        variance = phi ** 2 * variance * WHITE ** 2 / total + SLOW ** 2 * (1 - phi ** 2)
    return out


def nats(logs, missed, bases):
    """Log-likelihood that the mean left out (one array a log) costs who fits the columns of `bases` instead."""
    both = np.vstack([whitened(np.column_stack([m, b])) for m, b in zip(missed, bases)])
    gram = both.T @ both
    return (gram[0, 0] - gram[0, 1:] @ np.linalg.solve(gram[1:, 1:], gram[1:, 0])) / 2


def worth_of_lead(logs, coeff):
    missed = [cubic(log.gyro, coeff) - cubic(log.place, coeff) for log in logs]
    return nats(logs, missed, [np.vander((log.place - T0_DEGC) / RANGE_DEGC, 4) for log in logs])


def worth_of_lag(logs, coeff):
    levels = np.unique(np.concatenate([log.read for log in logs]))
    return nats(logs, [cubic(log.gyro, coeff) for log in logs],
                [(log.read[:, None] == levels).astype(float) for log in logs])


@functools.lru_cache(maxsize=None)
def answer(case):
    """The axis of the answer to one case."""
    logs, _, _ = simulate(*case)
    model = {"imucal_model": 1, "arw_deg_rt_h": WHITE / 60, "markov": [{"sigma_dph": SLOW, "tau_s": TAU_S}],
             "bias": {"t0_degc": T0_DEGC, "range_degc": RANGE_DEGC, "coeff_dph": COEFF_DPH[case[2]]}}
    with tempfile.TemporaryDirectory() as folder:
        paths = [write_log(Path(folder) / f"log{i}.csv", np.arange(1, SECONDS + 1), log.read, log.rate, form="%d,%.3f,%.3f")
                 for i, log in enumerate(logs)]
        return axis_told(DIAGNOSE, model_option(Path(folder) / "model.json", model), paths)


@pytest.mark.parametrize("case", COARSE, ids=str)
def test_a_coarse_thermometer_is_no_thermal_lag(case):
    logs, lead_s, _ = simulate(*case)
    assert worth_of_lead(logs, COEFF_DPH[case[2]]) < 1
    told = [(e["name"], e["parameters"]) for e in answer(case)["effects"]]
    assert "thermal_lag" not in names(answer(case)), (lead_s, told)


@pytest.mark.parametrize("case", LAG, ids=str)
def test_a_lag_of_minutes_is_told_with_a_coarse_thermometer(case):
    logs, _, lag_s = simulate(*case)
    assert worth_of_lag(logs, COEFF_DPH[case[2]]) > 30
    told = [(e["name"], e["family"], e["parameters"]) for e in answer(case)["effects"]]
    assert "thermal_memory" in [family for _, family, _ in told], (lag_s, told)


@pytest.mark.parametrize("case", COARSE + LAG, ids=str)
def test_names_stand_once_and_are_not_called_undetectable(case):
    axis = answer(case)
    assert len(names(axis)) == len(set(names(axis))), names(axis)
    for effect in axis["effects"]:
        members = [member["name"] for member in effect["set"]]
        assert len(members) == len(set(members)), members
    hidden = {entry["name"] for entry in axis["not_detectable_here"]}
    assert not with_members(axis) & hidden, (with_members(axis), hidden)
