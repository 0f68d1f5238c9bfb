# SPDX-License-Identifier: MIT
"""Causes that `diagnose --list-effects` names, each with physics of its own and a start state drawn in every run.

A cause is {"name", "p"}; keys of p that begin with "_" are drawn shapes that the contract leaves open.
Sources: play and Prandtl-Ishlinskii, Preisach relays: Mayergoyz, Mathematical Models of Hysteresis; Bouc-Wen: Ismail et
al. 2009 (Arch. Comput. Meth. Eng. 16); log-time relaxation of stress: Nowick & Berry, Anelastic Relaxation.
"""
from __future__ import annotations

import numpy as np

from .noise import coloured_path, flicker_density, markov_density, markov_path, walk_density
from .sensor import log_uniform, low_pass

FAMILIES = {
    "thermal_memory": ("temperature_rate", "thermal_hysteresis", "thermal_lag", "thermal_creep"),
    "function_of_temperature": ("thermal_anomaly", "thermal_step", "higher_order_polynomial",
                                "temperature_sensor_quantization"),
    "function_of_time": ("rate_ramp", "warm_up", "bias_step"),
    "slow_noise": ("noise_parameters", "second_markov", "rate_random_walk", "flicker_noise",
                   "markov_sigma_vs_temperature", "markov_tau_vs_temperature", "telegraph_noise"),
    "fast_noise": ("white_noise_vs_temperature", "outliers", "held_samples"),
    "tone": ("sinusoid",), "structural": ("quantization", "saturation", "dead_band"),
    "external": ("auxiliary_channel", "common_mode"), "run_to_run": ("run_to_run",)}
FAMILY_OF = {name: family for family, names in FAMILIES.items() for name in names}

MEMORY = ("thermal_hysteresis", "thermal_lag")
REPEATABLE = ("temperature_rate", "thermal_hysteresis", "thermal_lag", "thermal_creep", "thermal_anomaly", "thermal_step",
              "higher_order_polynomial", "rate_ramp", "warm_up")
MEAN = REPEATABLE + ("sinusoid", "bias_step", "run_to_run", "auxiliary_channel", "temperature_sensor_quantization")
SLOW = ("second_markov", "rate_random_walk", "flicker_noise", "markov_sigma_vs_temperature", "markov_tau_vs_temperature",
        "telegraph_noise")
NOISY = SLOW + ("white_noise_vs_temperature", "outliers", "noise_parameters")
OUTPUT = ("quantization", "saturation", "dead_band", "held_samples")
MECHANISMS = ("play", "two_plays", "preisach", "bouc_wen", "relaxing_play")


# ---- drawing ----------------------------------------------------------------------------------------------

def draw(name, rng, device):
    """A cause of random shape and unit size."""
    sign, n = float(rng.choice([-1.0, 1.0])), len(device.runs)
    lo, hi = device.t0_degc - device.range_degc, device.t0_degc + device.range_degc
    start = rng.uniform(-1, 1, n).tolist()
    if name == "temperature_rate":
        p = {"k_dph_per_degc_min": sign}
    elif name == "thermal_hysteresis":
        p = {"amplitude_dph": sign, "width_degc": log_uniform(rng, 2, 12), **draw_mechanism(rng), "_start": start}
    elif name == "thermal_lag":
        p = {"tau_s": 1.0, "_second": rng.uniform(0, 0.4), "_ratio": rng.uniform(2, 5),
             "_start": rng.normal(0, 6, (n, 2)).tolist()}
    elif name == "thermal_creep":
        first = log_uniform(rng, 60, 300)
        p = {"amplitude_dph_per_degc": sign, "tau_first_s": first, "tau_last_s": first * log_uniform(rng, 20, 150),
             "_start": rng.normal(0, 8, (n, 8)).tolist()}
    elif name == "thermal_anomaly":
        p = {"amplitude_dph": sign, "center_degc": float(rng.uniform(lo + 6, hi - 6)), "width_degc": log_uniform(rng, 1, 5),
             "_shape": str(rng.choice(["gauss", "gauss", "lorentz", "skew"]))}
    elif name == "thermal_step":
        p = {"amplitude_dph": sign, "temp_degc": float(rng.uniform(lo + 0.25 * (hi - lo), hi - 0.25 * (hi - lo))),
             "width_degc": float(rng.choice([0.0, rng.uniform(1, 8)])), "_start": start}
    elif name == "higher_order_polynomial":
        angle = rng.uniform(0, 2 * np.pi)
        p = {"p4_dph": float(np.cos(angle)), "p5_dph": float(np.sin(angle))}
    elif name == "rate_ramp":
        p = {"ramp_dph_per_h": sign}
    elif name == "warm_up":  # a warm restart shows a part of it
        p = {"amplitude_dph": sign, "tau_s": log_uniform(rng, 100, 1200), "_start": rng.uniform(0.3, 1.2, n).tolist()}
    elif name == "sinusoid":
        p = {"amplitude_dph": 1.0, "frequency_hz": log_uniform(rng, 0.004, 0.45), "_slope_hz_per_degc": 0.0,
             "_phase": rng.uniform(0, 2 * np.pi, n).tolist()}
    elif name == "bias_step":
        p = {"steps": [draw_step(rng, device) for _ in range(int(rng.integers(1, 3)))]}
    elif name == "run_to_run":
        p = {"sigma_dph": 1.0, "_draws": rng.standard_normal((n, 2)).tolist()}
    elif name == "auxiliary_channel":
        p = {"channel": "supply_v", "gain": sign}
    else:
        p = draw_noise_cause(name, rng, sign)
    return {"name": name, "p": p}


def draw_step(rng, device):
    run = int(rng.integers(len(device.train)))
    return {"log": run, "t_s": float(int(rng.uniform(0.15, 0.85) * device.train[run].n)),
            "amplitude_dph": float(rng.choice([-1.0, 1.0]))}


def draw_mechanism(rng):
    """Shape of one hysteresis: density of a Preisach plane, constants of Bouc-Wen, share that relaxes."""
    kind = str(rng.choice(MECHANISMS))
    if kind == "preisach":
        n = 60
        return {"_kind": kind, "_half": np.sqrt(rng.random(n)).tolist(), "_centre": rng.random(n).tolist(),
                "_weight": rng.gamma(0.7, 1.0, n).tolist(), "_relays": (rng.random(n) < 0.5).tolist()}
    if kind == "bouc_wen":
        return {"_kind": kind, "_n": float(rng.uniform(1, 3)), "_gamma": float(rng.uniform(-0.4, 0.4))}
    if kind == "relaxing_play":
        return {"_kind": kind, "_share": float(rng.uniform(0.1, 0.4)), "_tau_s": log_uniform(rng, 100, 400)}
    if kind == "two_plays":
        return {"_kind": kind, "_mix": float(rng.uniform(0.3, 0.7)), "_wider": float(rng.uniform(1.3, 2.0))}
    return {"_kind": kind}


def draw_noise_cause(name, rng, sign):
    if name == "temperature_sensor_quantization":  # the device's own step; the slope of B(T) gives it its strength
        return {"lsb_degc": 0.0}
    if name == "noise_parameters":
        direction = rng.standard_normal(3) * [0.4, 1.0, 1.0]
        return {"_size": 1.0, "_direction": (direction / np.linalg.norm(direction)).tolist()}
    if name in ("second_markov", "telegraph_noise"):
        key = "sigma_dph" if name == "second_markov" else "amplitude_dph"
        return {key: 1.0, "tau_s": log_uniform(rng, 4, 15) if rng.random() < 0.5 else log_uniform(rng, 700, 2500)}
    if name == "rate_random_walk":
        return {"k_dph_per_rt_s": 1.0}
    if name == "flicker_noise":
        return {"b_dph": 1.0}
    if name in ("white_noise_vs_temperature", "markov_sigma_vs_temperature", "markov_tau_vs_temperature"):
        return {"slope": sign}
    if name == "outliers":
        return {"probability": log_uniform(rng, 1e-3, 0.02), "sigma_dph": 1.0}
    raise ValueError(f"no cause called {name!r}")


# ---- hysteresis -------------------------------------------------------------------------------------------

def play(temp, r, start):
    """Backlash of half-width r; `start` in [-1, 1] is its place in the gap."""
    out, state = np.empty(temp.size), temp[0] + start * r
    for k, value in enumerate(temp.tolist()):
        state = min(max(state, value - r), value + r)
        out[k] = state
    return out


def relays(temp, half, centre, weight, start):
    """Preisach relays: up above centre + half, down below centre - half; those undecided start by `start`.  Less the
    relays' own curve without memory, which is a function of temperature and another cause."""
    on = np.where(temp[0] > centre + half, 1.0, np.where(temp[0] < centre - half, -1.0, np.where(
        (centre - temp[0]) / np.maximum(half, 1e-9) < start, 1.0, -1.0)))
    out = np.zeros(temp.size)
    for h, c, w, state in zip(half, centre, weight, on):
        event = np.where(temp > c + h, 1, np.where(temp < c - h, -1, 0))
        last = np.maximum.accumulate(np.where(event != 0, np.arange(temp.size), -1))
        out += w * (np.where(last >= 0, event[np.maximum(last, 0)], state) - np.sign(temp - c))
    return out


def bouc_wen(temp, r, n, gamma, start):
    """z' = T' / r (1 - |z|^n ((1 - gamma) sgn(z T') + gamma)); |z| <= 1."""
    out, z = np.empty(temp.size), float(start)
    step = np.diff(temp, prepend=temp[0]) / r
    for k, d in enumerate(step.tolist()):
        z += d * (1 - abs(z) ** n * ((1 - gamma) * np.sign(z * d) + gamma))
        z = min(max(z, -1.0), 1.0)
        out[k] = z
    return out


def loop(p, temp, start):
    """Loop of unit half-height: -1 on the branch going up, +1 going down (the sign of play minus temperature)."""
    r, kind = p["width_degc"], p.get("_kind", "play")
    if kind == "preisach":
        span = 2 * r * np.asarray(p["_half"])
        as_relay, weight = np.asarray(p["_relays"]), np.asarray(p["_weight"]) / np.sum(p["_weight"])
        plays = sum(w * (play(temp, h, start) - temp) / max(h, 0.2) for h, w in zip(span[~as_relay], weight[~as_relay]))
        centre = temp.min() + np.asarray(p["_centre"]) * np.ptp(temp)
        return plays + relays(temp, span[as_relay], centre[as_relay], weight[as_relay], start)
    if kind == "bouc_wen":
        return -bouc_wen(temp, r, p["_n"], p["_gamma"], -start)
    one = (play(temp, r, start) - temp) / r
    if kind == "two_plays":
        other = (play(temp, r * p["_wider"], start) - temp) / (r * p["_wider"])
        return p["_mix"] * one + (1 - p["_mix"]) * other
    if kind == "relaxing_play":  # a part of the stress relaxes, evenly in log time
        relaxed = sum(low_pass(one, p["_tau_s"] * 3.0**k) for k in range(4)) / 4
        return one - p["_share"] * relaxed
    return one


# ---- repeatable signatures --------------------------------------------------------------------------------

def polynomial(bias_dph, x):
    return np.polynomial.polynomial.polyval(x, bias_dph)


def delayed(p, temp, r):
    """Temperature of an element behind two thermal resistances; each node's start is drawn."""
    s = p.get("_start", [[0.0, 0.0]] * (r + 1))[r]
    share, tau = p.get("_second", 0.0), p["tau_s"]
    fast = low_pass(temp, tau, temp[0] + s[0])
    return (1 - share) * fast + share * low_pass(temp, tau * p.get("_ratio", 1.0), temp[0] + s[1])


def creep(p, temp, r):
    """What has not settled yet, per degree: mean of T - low_pass(T, tau) over tau spread evenly in log time."""
    taus = np.geomspace(p["tau_first_s"], p["tau_last_s"], 8)
    start = p.get("_start", [[0.0] * 8] * (r + 1))[r]
    return sum(temp - low_pass(temp, t, temp[0] + s) for t, s in zip(taus, start)) / taus.size


def step_state(p, temp, start):
    up, down = p["temp_degc"], p["temp_degc"] - p["width_degc"]
    event = np.where(temp > up, 1, np.where(temp < down, -1, 0)) if p["width_degc"] > 0 else np.where(temp > up, 1, -1)
    last = np.maximum.accumulate(np.where(event != 0, np.arange(temp.size), -1))
    return np.where(np.where(last >= 0, event[np.maximum(last, 0)], np.sign(start)) > 0, 1.0, 0.0)


def anomaly(p, temp):
    u = (temp - p["center_degc"]) / p["width_degc"]
    shape = p.get("_shape", "gauss")
    if shape == "lorentz":
        return 1 / (1 + u**2)
    return np.exp(-0.5 * (u / (1 + 0.3 * np.sign(u))) ** 2) if shape == "skew" else np.exp(-0.5 * u**2)


def signature(cause, device, r, bias):
    """Mean change of the reading [dph] of run r (training runs first)."""
    name, p, run = cause["name"], cause["p"], device.runs[r]
    temp, start = run.temp_degc, cause["p"].get("_start")
    if name == "temperature_rate":
        return p["k_dph_per_degc_min"] * low_pass(np.gradient(temp) * 60.0, 5.0)
    if name == "thermal_hysteresis":
        return p["amplitude_dph"] * loop(p, low_pass(temp, 3.0), start[r] if start else 0.0)
    if name == "thermal_lag":
        return polynomial(bias, device.x(delayed(p, temp, r))) - polynomial(bias, device.x(temp))
    if name == "thermal_creep":
        return p["amplitude_dph_per_degc"] * creep(p, temp, r)
    if name == "thermal_anomaly":
        return p["amplitude_dph"] * anomaly(p, temp)
    if name == "thermal_step":
        return p["amplitude_dph"] * step_state(p, temp, start[r] if start else -1.0)
    if name == "higher_order_polynomial":
        return np.polynomial.legendre.legval(device.x(temp), [0, 0, 0, 0, p["p4_dph"], p["p5_dph"]])
    if name == "rate_ramp":
        return p["ramp_dph_per_h"] * run.t_s / 3600.0
    if name == "warm_up":
        return p["amplitude_dph"] * (start[r] if start else 1.0) * np.exp(-run.t_s / p["tau_s"])
    if name == "sinusoid":
        f = p["frequency_hz"] + p["_slope_hz_per_degc"] * (temp - device.t0_degc)
        return p["amplitude_dph"] * np.cos(2 * np.pi * np.cumsum(f) + p["_phase"][r])
    if name == "bias_step":
        steps = [s["amplitude_dph"] * (run.t_s >= s["t_s"]) for s in p["steps"] if s["log"] == r]
        return np.sum(steps, axis=0) if steps else np.zeros(run.n)
    if name == "run_to_run":
        a, b = p["_draws"][r]
        x = device.x(temp)
        return p["sigma_dph"] * (a * x + b * (x**2 - 1 / 3) / 2)
    if name == "auxiliary_channel":
        return p["gain"] * (run.aux - 5.0)
    if name == "temperature_sensor_quantization":
        return np.zeros(run.n)  # the temperature column of the log carries it
    raise ValueError(f"{name} has no signature")


SIZE = {"temperature_rate": ("k_dph_per_degc_min",), "thermal_hysteresis": ("amplitude_dph",), "thermal_lag": ("tau_s",),
        "thermal_creep": ("amplitude_dph_per_degc",), "thermal_anomaly": ("amplitude_dph",), "thermal_step": ("amplitude_dph",),
        "higher_order_polynomial": ("p4_dph", "p5_dph"), "rate_ramp": ("ramp_dph_per_h",), "warm_up": ("amplitude_dph",),
        "sinusoid": ("amplitude_dph",), "run_to_run": ("sigma_dph",), "auxiliary_channel": ("gain",),
        "second_markov": ("sigma_dph",), "telegraph_noise": ("amplitude_dph",), "rate_random_walk": ("k_dph_per_rt_s",),
        "flicker_noise": ("b_dph",), "white_noise_vs_temperature": ("slope",), "markov_sigma_vs_temperature": ("slope",),
        "markov_tau_vs_temperature": ("slope",), "outliers": ("sigma_dph",)}


def scaled(cause, factor):
    """The same cause, `factor` times as large."""
    p = dict(cause["p"])
    if cause["name"] == "bias_step":
        p["steps"] = [{**s, "amplitude_dph": s["amplitude_dph"] * factor} for s in p["steps"]]
    for key in SIZE.get(cause["name"], ("_size",) if cause["name"] != "bias_step" else ()):
        p[key] = p[key] * factor
    return {**cause, "p": p}


# ---- noise ------------------------------------------------------------------------------------------------

def mistuned(p, white, markov):
    """Noise off the believed one: by contract parameters, or by a drawn direction in the logarithms."""
    if "_size" not in p:
        return 60 * p["arw_deg_rt_h"], [(p["sigma_dph"], p["tau_s"])]
    off = np.exp(p["_size"] * np.asarray(p["_direction"]))
    return white * off[0], [(s * off[1], t * off[2]) for s, t in markov]


def levels(noises, device, run, base):
    """White standard deviation and Markov terms; per second where a cause makes them vary."""
    white, markov, x = base.white_dph, [tuple(m) for m in base.markov], device.x(run.temp_degc)
    for cause in noises:
        name, p = cause["name"], cause["p"]
        if name == "noise_parameters":
            white, markov = mistuned(p, white, markov)
        elif name == "white_noise_vs_temperature":
            white = white * np.exp(0.5 * p["slope"] * x)
        elif name == "markov_sigma_vs_temperature":
            markov = [(s * np.exp(0.5 * p["slope"] * x), t) for s, t in markov]
        elif name == "markov_tau_vs_temperature":
            markov = [(s, t * np.exp(p["slope"] * x)) for s, t in markov]
    return white, markov


def added_density(cause):
    """Density that a noise cause adds, as a function of f, or None."""
    name, p = cause["name"], cause["p"]
    if name in ("second_markov", "telegraph_noise"):
        return lambda f: markov_density(f, p[SIZE[name][0]], p["tau_s"])
    if name == "rate_random_walk":
        return lambda f: walk_density(f, p["k_dph_per_rt_s"])
    if name == "flicker_noise":
        return lambda f: flicker_density(f, p["b_dph"])
    return None


def added_path(cause, n, rng):
    name, p = cause["name"], cause["p"]
    if name == "second_markov":
        return p["sigma_dph"] * markov_path(p["tau_s"], n, rng)
    if name == "telegraph_noise":
        flips = rng.random(n) < 0.5 * (1 - np.exp(-1.0 / p["tau_s"]))
        return p["amplitude_dph"] * (1 - 2 * ((np.cumsum(flips) + int(rng.random() < 0.5)) % 2))
    if name == "rate_random_walk":
        return p["k_dph_per_rt_s"] * np.cumsum(rng.standard_normal(n))
    if name == "flicker_noise":
        return coloured_path(added_density(cause), n, rng)
    if name == "outliers":
        return (rng.random(n) < p["probability"]) * p["sigma_dph"] * rng.standard_normal(n)
    return np.zeros(n)


def noise_path(noises, device, run, base, rng):
    """All Gaussian-model noise of one run [dph]."""
    white, markov = levels(noises, device, run, base)
    out = white * rng.standard_normal(run.n)
    for sigma, tau in markov:
        out = out + sigma * markov_path(tau, run.n, rng)
    for cause in noises:
        out = out + added_path(cause, run.n, rng)
    return out


# ---- output stage -----------------------------------------------------------------------------------------

def output_stage(cause, rate, rng):
    name, p = cause["name"], cause["p"]
    if name == "quantization":
        return p["lsb_dph"] * np.round(rate / p["lsb_dph"])
    if name == "saturation":
        return np.clip(rate, -p["limit_dph"], p["limit_dph"])
    if name == "dead_band":
        return np.where(np.abs(rate) < p["width_dph"], 0.0, rate)
    held = rng.random(rate.size) < p["probability"]
    held[0] = False
    return rate[np.maximum.accumulate(np.where(held, 0, np.arange(rate.size)))]


def draw_output(name, rng, white_dph, curve):
    """A mark of the output stage that is there without ruling the record; `curve`: B(T) of all runs [dph]."""
    short = lambda v: float(f"{v:.3g}")
    if name == "quantization":
        return {"name": name, "p": {"lsb_dph": short(rng.uniform(0.7, 3.0) * white_dph)}}
    if name == "saturation":
        return {"name": name, "p": {"limit_dph": short(np.quantile(np.abs(curve), rng.uniform(0.9, 0.98)))}}
    if name == "dead_band":
        return {"name": name, "p": {"width_dph": short(rng.uniform(0.7, 2.5) * white_dph)}}
    return {"name": name, "p": {"probability": log_uniform(rng, 0.005, 0.1)}}
