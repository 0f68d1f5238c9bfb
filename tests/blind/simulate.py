# SPDX-License-Identifier: MIT
"""Independent simulator: nominal sensor, every effect of diagnosis.md, and effects no library knows.

An effect is {"name", "parameters"}; parameters whose name starts with "_" are drawn shapes that the
contract leaves open (phases, start values, a mixture of two hysteresis widths).
Three kinds:  MEAN adds a repeatable signature, NOISE changes or adds random noise, OUTPUT acts on the
complete reading.
"""
from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from . import unknown
from .campaign import draw_bias, polynomial  # noqa: F401  (re-exported for the callers)

MEAN = ("temperature_rate", "thermal_hysteresis", "thermal_lag", "thermal_anomaly", "higher_order_polynomial",
        "rate_ramp", "warm_up", "sinusoid", "bias_step", "run_to_run", "auxiliary_channel",
        "temperature_sensor_quantization", "unknown_function")
NOISE = ("noise_parameters", "second_markov", "rate_random_walk", "flicker_noise", "white_noise_vs_temperature",
         "markov_sigma_vs_temperature", "markov_tau_vs_temperature", "outliers", "telegraph_noise",
         "unknown_spectrum", "unknown_modulation")
OUTPUT = ("quantization", "saturation", "dead_band", "held_samples")
BETWEEN_AXES = ("common_mode",)

AMPLITUDE = {  # the parameters that scale with strength
    "temperature_rate": ["k_dph_per_degc_min"], "thermal_hysteresis": ["amplitude_dph"], "thermal_lag": ["tau_s"],
    "thermal_anomaly": ["amplitude_dph"], "higher_order_polynomial": ["p4_dph", "p5_dph"],
    "rate_ramp": ["ramp_dph_per_h"], "warm_up": ["amplitude_dph"], "sinusoid": ["amplitude_dph"],
    "run_to_run": ["sigma_dph"], "auxiliary_channel": ["gain"], "second_markov": ["sigma_dph"],
    "rate_random_walk": ["k_dph_per_rt_s"], "flicker_noise": ["b_dph"], "white_noise_vs_temperature": ["slope"],
    "markov_sigma_vs_temperature": ["slope"], "markov_tau_vs_temperature": ["slope"], "outliers": ["sigma_dph"],
    "telegraph_noise": ["amplitude_dph"], "unknown_function": ["_amplitude_dph"],
    "unknown_spectrum": ["_amplitude"], "unknown_modulation": ["_amplitude"], "noise_parameters": ["_size"],
}


def scaled(effect, factor, group=None):
    """The same effect, `factor` times as strong."""
    p = dict(effect["parameters"])
    if effect["name"] == "bias_step":
        p["steps"] = [{**s, "amplitude_dph": s["amplitude_dph"] * factor} for s in p["steps"]]
    else:
        for key in AMPLITUDE[effect["name"]]:
            p[key] = p[key] * factor
    if effect["name"] == "noise_parameters":
        p = mistuned(p, group)
    return {"name": effect["name"], "parameters": p}


def mistuned(p, group):
    """Noise parameters a factor exp(size * direction) off the believed ones."""
    off = np.exp(p["_size"] * np.asarray(p["_direction"])).tolist()
    sigma, tau = group.nominal.markov[0]
    return {**p, "arw_deg_rt_h": group.nominal.arw_deg_rt_h * off[0], "sigma_dph": sigma * off[1],
            "tau_s": tau * off[2]}


# ---- repeatable signatures -------------------------------------------------------------------------------

def play(temp, r, start):
    """Backlash operator of half-width r."""
    out = np.empty(temp.size)
    state = start
    for k, value in enumerate(temp):
        if state < value - r:
            state = value - r
        elif state > value + r:
            state = value + r
        out[k] = state
    return out


def smooth_rate(temp, width_s=20):
    """dT/dt [degC/min] of the true temperature."""
    return np.gradient(temp) * 60.0 if width_s <= 1 else lagged(np.gradient(temp) * 60.0, width_s / 4)


def lagged(temp, tau_s):
    if tau_s <= 0:
        return temp.copy()
    a = np.exp(-1.0 / tau_s)
    return lfilter([1 - a], [1, -a], temp, zi=[a * temp[0]])[0]


def signature(effect, group, run, index, bias):
    """Mean change of the reading [dph] of one run; `index` counts the runs, training first."""
    name, p = effect["name"], effect["parameters"]
    temp, x = run.temp_degc, group.x(run.temp_degc)
    if name == "temperature_rate":
        return p["k_dph_per_degc_min"] * smooth_rate(temp)
    if name == "thermal_hysteresis":
        total = np.zeros(temp.size)
        for share, factor in p.get("_mixture", [[1.0, 1.0]]):
            r = p["width_degc"] * factor
            start = temp[0] + r if run.starts_cold else temp[0] - r
            total += share * (play(temp, r, start) - temp) / r
        return p["amplitude_dph"] * total
    if name == "thermal_lag":
        return polynomial(bias, group.x(lagged(temp, p["tau_s"]))) - polynomial(bias, x)
    if name == "thermal_anomaly":
        return p["amplitude_dph"] * np.exp(-0.5 * ((temp - p["center_degc"]) / p["width_degc"]) ** 2)
    if name == "higher_order_polynomial":
        return np.polynomial.legendre.legval(x, [0, 0, 0, 0, p["p4_dph"], p["p5_dph"]])
    if name == "rate_ramp":
        return p["ramp_dph_per_h"] * run.t_s / 3600.0
    if name == "warm_up":
        return p["amplitude_dph"] * np.exp(-run.t_s / p["tau_s"])
    if name == "sinusoid":
        return p["amplitude_dph"] * np.cos(2 * np.pi * p["frequency_hz"] * run.t_s + p["_phase"][index])
    if name == "bias_step":
        return sum((s["amplitude_dph"] * (run.t_s >= s["t_s"]) for s in p["steps"] if s["log"] == index),
                   np.zeros(run.n))
    if name == "run_to_run":
        a, b = p["_draws"][index]
        return p["sigma_dph"] * (a * x + b * (x**2 - 1 / 3) / 2)
    if name == "auxiliary_channel":
        return p["gain"] * (run.aux - 5.0)
    if name == "temperature_sensor_quantization":
        return np.zeros(run.n)  # the log's temperature carries it
    if name == "unknown_function":
        return p["_amplitude_dph"] * unknown.function(p, group, run)
    raise ValueError(f"{name} has no signature")


# ---- noise ------------------------------------------------------------------------------------------------

def levels(effects, group, run):
    """White standard deviation and Markov terms (sigma, tau), per second where an effect makes them vary."""
    white = group.nominal.white_dph
    markov = [list(pair) for pair in group.nominal.markov]
    x = group.x(run.temp_degc)
    for effect in effects:
        name, p = effect["name"], effect["parameters"]
        if name == "noise_parameters":
            white = 60.0 * p["arw_deg_rt_h"]
            markov[0] = [p["sigma_dph"], p["tau_s"]]
        elif name == "white_noise_vs_temperature":
            white = white * np.exp(0.5 * p["slope"] * x)
        elif name == "markov_sigma_vs_temperature":
            markov = [[s * np.exp(0.5 * p["slope"] * x), t] for s, t in markov]
        elif name == "markov_tau_vs_temperature":
            markov = [[s, t * np.exp(p["slope"] * x)] for s, t in markov]
        elif name == "unknown_modulation":
            gain = np.exp(0.5 * p["_amplitude"] * unknown.function(p, group, run))
            if p["_of"] == "white":
                white = white * gain
            else:
                markov = [[s * gain, t] for s, t in markov]
    return white, markov


def unit_markov(tau, n, rng):
    """Stationary unit-variance Gauss-Markov path; tau may vary in time."""
    w = rng.standard_normal(n)
    if np.ndim(tau) == 0:
        a = np.exp(-1.0 / tau)
        start = w[0]
        w = np.sqrt(1 - a * a) * w
        w[0] = start
        return lfilter([1.0], [1.0, -a], w)
    a = np.exp(-1.0 / np.asarray(tau))
    out = np.empty(n)
    out[0] = w[0]
    for k in range(1, n):
        out[k] = a[k - 1] * out[k - 1] + np.sqrt(1 - a[k - 1] ** 2) * w[k]
    return out


def coloured(n, psd, rng, factor=2):
    """Gaussian noise of a one-sided power density psd(f) [dph^2/Hz] at 1 Hz sampling."""
    size = int(factor * n)
    f = np.fft.rfftfreq(size)
    f[0] = f[1]
    amplitude = np.sqrt(psd(f) * size / 2.0)
    z = (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)) / np.sqrt(2)
    spectrum = amplitude * z
    spectrum[0] = 0
    return np.fft.irfft(spectrum, size)[:n]


def added_noise(effect, n, rng, group):
    name, p = effect["name"], effect["parameters"]
    if name == "second_markov":
        return p["sigma_dph"] * unit_markov(p["tau_s"], n, rng)
    if name == "rate_random_walk":
        return p["k_dph_per_rt_s"] * np.concatenate([[0], np.cumsum(rng.standard_normal(n - 1))])
    if name == "flicker_noise":  # true 1/f (IEEE Std 952: B^2/(2 pi f), two-sided), no sum of Markov processes
        return coloured(n, lambda f: p["b_dph"] ** 2 / (np.pi * f), rng, 4)
    if name == "outliers":
        hit = rng.random(n) < p["probability"]
        return hit * p["sigma_dph"] * rng.standard_normal(n)
    if name == "telegraph_noise":
        flips = rng.random(n) < 0.5 * (1 - np.exp(-1.0 / p["tau_s"]))
        flips[0] = rng.random() < 0.5
        return p["amplitude_dph"] * (1 - 2 * (np.cumsum(flips) % 2))
    if name == "unknown_spectrum":
        return p["_amplitude"] * coloured(n, lambda f: unknown.spectrum(p, f, group), rng)
    return None


def noise_series(group, run, effects, rng):
    """All noise of one run [dph]."""
    white, markov = levels(effects, group, run)
    out = white * rng.standard_normal(run.n)
    for sigma, tau in markov:
        out = out + sigma * unit_markov(tau, run.n, rng)
    for effect in effects:
        extra = added_noise(effect, run.n, rng, group)
        if extra is not None:
            out = out + extra
    return out


def nominal_series(group, run, rng):
    return noise_series(group, run, [], rng)


def output_stage(effect, rate, rng):
    name, p = effect["name"], effect["parameters"]
    if name == "quantization":
        return p["lsb_dph"] * np.round(rate / p["lsb_dph"])
    if name == "saturation":
        return np.clip(rate, -p["limit_dph"], p["limit_dph"])
    if name == "dead_band":
        return np.where(np.abs(rate) < p["width_dph"], 0.0, rate)
    if name == "held_samples":
        held = rng.random(rate.size) < p["probability"]
        held[0] = False
        last = np.maximum.accumulate(np.where(held, 0, np.arange(rate.size)))
        return rate[last]
    return rate


def simulate_axis(group, bias, effects, rng, turn_on_sigma_dph=100.0, rotated=None):
    """Readings of every run (training, then held out) of one axis; `rotated` adds a prepared common part."""
    out = []
    for index, run in enumerate(group.train + group.hold):
        rate = polynomial(bias, group.x(run.temp_degc)) + turn_on_sigma_dph * rng.standard_normal()
        for effect in effects:
            if effect["name"] in MEAN:
                rate = rate + signature(effect, group, run, index, bias)
        rate = rate + (noise_series(group, run, effects, rng) if rotated is None else rotated[index])
        for effect in effects:
            rate = output_stage(effect, rate, rng)
        out.append(rate)
    return out
