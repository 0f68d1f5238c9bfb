# SPDX-License-Identifier: MIT
"""Effects that nobody picked by hand: random smooth functions and random noise shapes, drawn by a program."""
from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

INPUTS = ("temperature", "time", "temperature_rate", "direction", "delayed_temperature")


def draw_function(rng, inputs=None):
    """A random function: a sum of 24 random cosines over a random subset of the inputs, which approximates a
    draw of a Gaussian process with a squared-exponential kernel of random length scale."""
    if inputs is None:
        inputs = [INPUTS[i] for i in rng.permutation(len(INPUTS))[: rng.integers(1, 4)]]
        if inputs == ["direction"]:
            inputs = ["direction", "temperature"]
    n = 24
    scale = rng.uniform(0.35, 1.2, len(inputs))
    return {"_inputs": list(inputs), "_weights": (rng.standard_normal((n, len(inputs))) / scale).tolist(),
            "_offsets": rng.uniform(0, 2 * np.pi, n).tolist(), "_heights": rng.standard_normal(n).tolist(),
            "_delay_s": float(np.exp(rng.uniform(np.log(150), np.log(1500))))}


def inputs_of(p, group, run):
    """The inputs, each scaled to about [-1, 1]."""
    temp = run.temp_degc
    rate = np.gradient(temp) * 60.0
    a = np.exp(-1.0 / 15.0)
    rate = lfilter([1 - a], [1, -a], rate)
    b = np.exp(-1.0 / p["_delay_s"])
    delayed = lfilter([1 - b], [1, -b], temp, zi=[b * temp[0]])[0]
    table = {"temperature": group.x(temp), "time": 2 * run.t_s / 8400.0 - 1, "temperature_rate": rate,
             "direction": np.tanh(rate / 0.15), "delayed_temperature": group.x(delayed)}
    return np.stack([table[name] for name in p["_inputs"]], 1)


def function(p, group, run):
    u = inputs_of(p, group, run)
    phase = u @ np.asarray(p["_weights"]).T + np.asarray(p["_offsets"])
    return np.cos(phase) @ np.asarray(p["_heights"]) / np.sqrt(12.0)


def draw_spectrum(rng):
    """Random log-density over log-frequency: a smooth random curve through 11 knots."""
    return {"_knots": (rng.standard_normal(11) * rng.uniform(1.0, 3.0)).tolist()}


def spectrum(p, f, group):
    """Power density [dph^2/Hz, one-sided] at amplitude 1, as a factor on the nominal density."""
    from scipy.interpolate import PchipInterpolator

    knots = np.linspace(np.log(2e-4), np.log(0.5), 11)
    factor = np.exp(PchipInterpolator(knots, p["_knots"])(np.log(np.clip(f, 2e-4, 0.5))))
    return factor * nominal_density(group, f)


def nominal_density(group, f):
    """One-sided density of the believed noise [dph^2/Hz] at 1 Hz sampling."""
    total = np.full_like(np.asarray(f, float), 2 * group.nominal.white_dph**2)
    for sigma, tau in group.nominal.markov:
        phi = np.exp(-1.0 / tau)
        total += 2 * sigma**2 * (1 - phi**2) / (1 - 2 * phi * np.cos(2 * np.pi * f) + phi**2)
    return total
