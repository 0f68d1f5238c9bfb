# SPDX-License-Identifier: MIT
"""Causes that no library has.  Each carries the family a careful reader could give it (None: only abstention is right)."""
from __future__ import annotations

import numpy as np

from .noise import F_MIN_HZ, coloured_path
from .sensor import log_uniform, low_pass

SIGNALS = ("random_function", "saw_tooth", "drifting_tone", "slip_in_temperature", "ageing_slope", "wander_in_temperature")
NOISES = ("power_law", "bursts", "random_spectrum")
KINDS = SIGNALS + NOISES
INPUTS = ("temperature", "time", "temperature_rate", "direction", "delayed_temperature")
FAMILY_OF_INPUT = {"temperature": "function_of_temperature", "time": "function_of_time"}


def draw(kind, rng, device):
    """-> {"name": kind, "p": {...}, "families": those that may be named}."""
    n, p, families = len(device.runs), {"_size": 1.0}, []
    if kind == "random_function":
        p.update(draw_function(rng))
        kinds = {FAMILY_OF_INPUT.get(i, "thermal_memory") for i in p["_inputs"]}
        memory_too = "thermal_memory" in kinds and kinds <= {"thermal_memory", "function_of_temperature"}
        families = ["thermal_memory"] if memory_too else sorted(kinds) if len(kinds) == 1 else []
    elif kind == "saw_tooth":
        p.update(_period_s=log_uniform(rng, 300, 3000), _jitter=rng.uniform(0.05, 0.3), _seed=int(rng.integers(2**31)))
        families = ["slow_noise", "function_of_time"]
    elif kind == "drifting_tone":
        p.update(_f_hz=log_uniform(rng, 0.01, 0.4), _k=rng.choice([-1, 1]) * log_uniform(rng, 2e-5, 1e-3),
                 _phase=rng.uniform(0, 2 * np.pi, n).tolist())
        families = ["tone"]
    elif kind == "slip_in_temperature":  # jumps at temperatures that differ from run to run
        p.update(_seed=int(rng.integers(2**31)), _slips=int(rng.integers(2, 6)))
        families = ["slow_noise", "function_of_time"]
    elif kind == "ageing_slope":  # the slope over temperature grows with time
        p.update(_power=float(rng.uniform(0.5, 1.5)))
    elif kind == "wander_in_temperature":  # repeatable rough curve over temperature
        p.update(_knots=rng.standard_normal(40).tolist())
        families = ["function_of_temperature"]
    elif kind == "power_law":
        p.update(_alpha=float(rng.uniform(0.3, 0.8) if rng.random() < 0.5 else rng.uniform(1.2, 1.75)))
        families = ["slow_noise"]
    elif kind == "bursts":
        p.update(_rate_per_h=log_uniform(rng, 1, 10), _length_s=log_uniform(rng, 15, 120), _dof=float(rng.uniform(2.2, 4)))
        families = ["fast_noise"]
    elif kind == "random_spectrum":
        p.update(_centre_hz=log_uniform(rng, 0.002, 0.2), _width=rng.uniform(0.15, 0.5), _notch=float(rng.uniform(-1.5, 1.5)))
        families = ["slow_noise", "fast_noise"]
    return {"name": kind, "p": p, "families": families}


def draw_function(rng):
    """Sum of random cosines over some inputs: about a Gaussian-process draw."""
    inputs = [INPUTS[i] for i in rng.permutation(5)[: rng.integers(1, 4)]]
    inputs = ["direction", "temperature"] if inputs == ["direction"] else inputs
    scale = rng.uniform(0.35, 1.2, len(inputs))
    return {"_inputs": inputs, "_weights": (rng.standard_normal((24, len(inputs))) / scale).tolist(),
            "_offsets": rng.uniform(0, 2 * np.pi, 24).tolist(), "_heights": rng.standard_normal(24).tolist(),
            "_delay_s": log_uniform(rng, 150, 1500), "_start": rng.normal(0, 6, 12).tolist()}


def function(p, device, r):
    run = device.runs[r]
    rate = low_pass(np.gradient(run.temp_degc) * 60.0, 20.0)
    slow = low_pass(run.temp_degc, p["_delay_s"], run.temp_degc[0] + p["_start"][r % 12])
    table = {"temperature": device.x(run.temp_degc), "time": 2 * run.t_s / 8000.0 - 1, "temperature_rate": rate,
             "direction": np.tanh(rate / 0.15), "delayed_temperature": device.x(slow)}
    u = np.stack([table[name] for name in p["_inputs"]], 1)
    return np.cos(u @ np.asarray(p["_weights"]).T + p["_offsets"]) @ np.asarray(p["_heights"]) / np.sqrt(12)


def saw_tooth(p, n, r):
    rng = np.random.default_rng([p["_seed"], r])
    lengths = p["_period_s"] * np.exp(p["_jitter"] * rng.standard_normal(int(n / p["_period_s"] * 3) + 4))
    edges = np.cumsum(lengths) - lengths[0] * rng.random()
    k = np.searchsorted(edges, np.arange(n), side="right")
    return (np.arange(n) - np.concatenate([[0], edges])[k]) / lengths[np.minimum(k, lengths.size - 1)]


def slips(p, run, r):
    """Stick and slip: the reading jumps as the temperature passes places drawn anew in every run."""
    rng = np.random.default_rng([p["_seed"], r])
    places = rng.uniform(run.temp_degc.min(), run.temp_degc.max(), p["_slips"])
    total = np.zeros(run.n)
    for place, height in zip(places, rng.standard_normal(p["_slips"])):
        crossing = np.flatnonzero(np.diff(np.sign(run.temp_degc - place)))
        if crossing.size:
            total[crossing[0] + 1:] += height
    return total


def signature(cause, device, r):
    """Mean change of the reading [dph] of run r."""
    kind, p, run = cause["name"], cause["p"], device.runs[r]
    if kind == "random_function":
        return p["_size"] * function(p, device, r)
    if kind == "saw_tooth":
        return p["_size"] * saw_tooth(p, run.n, r)
    if kind == "drifting_tone":
        f = p["_f_hz"] + p["_k"] * (run.temp_degc - device.t0_degc)
        return p["_size"] * np.cos(2 * np.pi * np.cumsum(f) + p["_phase"][r])
    if kind == "slip_in_temperature":
        return p["_size"] * slips(p, run, r)
    if kind == "ageing_slope":
        return p["_size"] * device.x(run.temp_degc) * (run.t_s / 7200.0) ** p["_power"]
    x = np.clip((device.x(run.temp_degc) + 1) / 2, 0, 1) * (len(p["_knots"]) - 1)
    return p["_size"] * np.interp(x, np.arange(len(p["_knots"])), p["_knots"])


def density(cause):
    """Density of a noise kind as a function of f (bursts: None, they are not stationary)."""
    kind, p = cause["name"], cause["p"]
    if kind == "power_law":
        return lambda f: p["_size"] ** 2 * (np.maximum(f, F_MIN_HZ) / 0.01) ** -p["_alpha"]
    if kind == "random_spectrum":
        def bump(f):
            u = np.log10(np.maximum(f, F_MIN_HZ) / p["_centre_hz"]) / p["_width"]
            return p["_size"] ** 2 * (np.exp(-0.5 * u**2) + 0.3 * np.exp(-0.5 * (u - 3 * p["_notch"]) ** 2))
        return bump
    return None


def burst_gain(p, n, rng):
    """0/1: seconds inside a burst."""
    inside = np.zeros(n, bool)
    for _ in range(rng.poisson(p["_rate_per_h"] * n / 3600.0)):
        at = int(rng.integers(n))
        inside[at: at + 1 + int(rng.exponential(p["_length_s"]))] = True
    return inside


def path(cause, n, rng):
    if cause["name"] == "bursts":
        return cause["p"]["_size"] * burst_gain(cause["p"], n, rng) * rng.standard_t(cause["p"]["_dof"], n)
    return coloured_path(density(cause), n, rng)


