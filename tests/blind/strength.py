# SPDX-License-Identifier: MIT
"""Strength d of an effect: sqrt(2 x expected log-likelihood gain of the true effect over the fitted nominal
model, 4 runs), and the amplitude that has a wanted strength.

Repeatable signatures: d is the norm of the whitened signature after the nuisance is projected away (exact).
Coefficients that change from run to run: analytic, from the eigenvalues.  Noise effects: mean over drawn
records of the restricted log-likelihood ratio.  Outliers and telegraph noise: the same with the mixture and
two-mode likelihoods, after the nuisance is removed.  Random spectra: Whittle's form of the divergence.
"""
from __future__ import annotations

import numpy as np

from . import simulate, unknown, whiten
from .whiten import Noise, markov_part

LIMITS = {  # largest size that still makes sense, in the unit of the first amplitude parameter
    "temperature_rate": 500, "thermal_hysteresis": 600, "thermal_lag": 1500, "thermal_anomaly": 600,
    "higher_order_polynomial": 600, "rate_ramp": 3000, "warm_up": 1500, "sinusoid": 200, "bias_step": 600,
    "run_to_run": 300, "auxiliary_channel": 3000, "second_markov": 300, "rate_random_walk": 20,
    "flicker_noise": 100, "white_noise_vs_temperature": 3, "markov_sigma_vs_temperature": 4,
    "markov_tau_vs_temperature": 2.5, "outliers": 5000, "telegraph_noise": 300, "unknown_function": 3000,
    "unknown_spectrum": 300, "unknown_modulation": 5, "noise_parameters": 1.6,
}


class Unreachable(Exception):
    """No amplitude within sensible limits has the wanted strength."""


def noise_model(group, runs, effects):
    """Gaussian state-space model of the noise with these effects (per run and row where it varies)."""
    n = max(r.n for r in runs)

    def table(values):
        if all(np.ndim(v) == 0 for v in values):
            return np.array(values, float)
        out = np.ones((len(values), n))
        for i, v in enumerate(values):
            v = np.broadcast_to(v, (runs[i].n,))
            out[i, : v.size] = v
            out[i, v.size:] = v[-1]
        return out

    per_run = [simulate.levels(effects, group, r) for r in runs]
    parts = []
    for i in range(len(per_run[0][1])):
        # a unit process with time-varying weight: the same physics as the simulator
        tau = table([p[1][i][1] for p in per_run])
        sigma = table([p[1][i][0] for p in per_run])
        phi, q, p0, _ = markov_part(1.0, tau)
        parts.append((phi, q, p0, sigma))
    for effect in effects:
        name, p = effect["name"], effect["parameters"]
        if name == "second_markov":
            parts.append(markov_part(p["sigma_dph"], p["tau_s"]))
        elif name == "telegraph_noise":  # second-order twin
            parts.append(markov_part(p["amplitude_dph"], p["tau_s"]))
        elif name == "rate_random_walk":
            parts.append((1.0, p["k_dph_per_rt_s"] ** 2, 0.0, 1.0))
        elif name == "flicker_noise":
            part_variance = p["b_dph"] ** 2 * np.log(4.0) / np.pi
            parts += [markov_part(np.sqrt(part_variance), 2.0 * 4.0**k) for k in range(7)]
    return Noise(table([np.square(p[0]) for p in per_run]), parts)


def stacked(noises, b, n):
    """Several models side by side (one per amplitude)."""
    def merge(values):
        if any(np.ndim(v) == 2 for v in values):
            full = []
            for v in values:
                v = np.asarray(v, float)
                full.append(np.broadcast_to(v[:, None] if v.ndim == 1 else v, (b, n)))
            return np.concatenate(full)
        return np.concatenate([np.broadcast_to(np.asarray(v, float), (b,)) for v in values])

    parts = [tuple(merge([noise.parts[i][j] for noise in noises]) for j in range(4))
             for i in range(len(noises[0].parts))]
    return Noise(merge([noise.r for noise in noises]), parts)


def nominal_whitener(group):
    if "whitener" not in group.cache:
        group.cache["whitener"] = whiten.Whitener(group, group.train, whiten.nominal_noise(group.nominal))
    return group.cache["whitener"]


def signature_columns(group, effect, bias):
    return [simulate.signature(effect, group, r, i, bias)[:, None] for i, r in enumerate(group.train)]


def believed_curve(group, bias):
    """What a coarse thermometer leaves: B at the true temperature (the fit has only the shown one)."""
    return [simulate.polynomial(bias, group.x(r.temp_degc))[:, None] for r in group.train]


def mean_strength(group, effect, bias, whitener=None, against=()):
    """d of a repeatable effect; `against`: other signatures whose amplitude is free as well."""
    whitener = whitener or nominal_whitener(group)
    name = effect["name"]
    if name == "run_to_run":
        return run_to_run_strength(group, effect, whitener)
    columns = believed_curve(group, bias) if name == "temperature_sensor_quantization" else \
        signature_columns(group, effect, bias)
    z = whitener.perpendicular(columns)[:, 0]
    if against:
        other = np.column_stack([whitener.perpendicular(signature_columns(group, e, bias))[:, 0] for e in against])
        q, _ = np.linalg.qr(other / np.linalg.norm(other, axis=0))
        z = z - q @ (q.T @ z)
    return float(np.linalg.norm(z))


def run_to_run_strength(group, effect, whitener):
    """Random x and (x^2-1/3)/2 per run: expected gain 1/2 sum(s^2 l - log(1 + s^2 l))."""
    if "run_to_run" not in group.cache:
        b = len(group.train)
        columns = []
        for i, r in enumerate(group.train):
            x = group.x(r.temp_degc)
            block = np.zeros((r.n, 2 * b))
            block[:, 2 * i], block[:, 2 * i + 1] = x, (x**2 - 1 / 3) / 2
            columns.append(block)
        z = whitener.perpendicular(columns)
        group.cache["run_to_run"] = np.clip(np.linalg.eigvalsh(z.T @ z), 0, None)
    lam = group.cache["run_to_run"] * effect["parameters"]["sigma_dph"] ** 2
    return float(np.sqrt(np.sum(lam - np.log1p(lam))))


def series(group, effects, rng_seed, draws, runs=None):
    """Noise records with common random numbers: (B, N, draws)."""
    runs = runs or group.train
    out = []
    for i, run in enumerate(runs):
        columns = [simulate.noise_series(group, run, effects, np.random.default_rng([rng_seed, i, k]))
                   for k in range(draws)]
        out.append(np.stack(columns, 1))
    return whiten.pad(out)[0]


def gaussian_gain(group, variants, base, rng_seed, draws):
    """Mean REML gain of each variant (list of effects) over the model `base`, data drawn from the variant."""
    runs = group.train
    b, n = len(runs), max(r.n for r in runs)
    y = np.concatenate([series(group, v, rng_seed, draws) for v in variants])
    full = whiten.reml(group, runs, stacked([noise_model(group, runs, v) for v in variants], b, n), y, len(variants))
    if base is None:
        less = whiten.reml(group, runs, stacked([whiten.nominal_noise(group.nominal)] * len(variants), b, n), y,
                           len(variants))
    else:
        less = whiten.reml(group, runs, stacked([noise_model(group, runs, v) for v in base], b, n), y, len(variants))
    return (full - less).mean(1)


def mixture_gain(group, variants, rng_seed, draws):
    """The same for outliers and telegraph noise, whose likelihood is not Gaussian."""
    runs, nominal = group.train, group.nominal
    keep = whiten.run_mask(runs)
    sigma, tau = np.array(nominal.markov).T
    kind = variants[0][-1]["name"]
    y = []
    for variant in variants:
        noisy = series(group, variant, rng_seed, draws)
        y.append(whiten.profile_nuisance(group, runs, noise_model(group, runs, variant), noisy))
    y = np.concatenate(y)
    b, copies = len(runs), len(variants)
    keep = np.tile(keep, (copies, 1))
    sizes = np.repeat([v[-1]["parameters"][simulate.AMPLITUDE[kind][0]] for v in variants], b)
    p = variants[0][-1]["parameters"]
    if kind == "outliers":
        full = whiten.outlier_log_likelihood(y, nominal.white_dph**2, sigma, tau, p["probability"], sizes, keep)
    else:
        full = whiten.telegraph_log_likelihood(y, nominal.white_dph**2, sigma, tau, sizes, p["tau_s"], keep)
    less = whiten.gaussian_log_likelihood(y, whiten.nominal_noise(nominal), keep)
    return (full - less).reshape(copies, b, -1).sum(1).mean(1)


def spectrum_strength(group, effect):
    p = effect["parameters"]
    total = 0.0
    for run in group.train:
        f = np.arange(3, run.n // 2) / run.n  # the lowest frequencies go to the constants
        ratio = p["_amplitude"] ** 2 * unknown.spectrum(p, f, group) / unknown.nominal_density(group, f)
        total += 2 * np.sum(ratio - np.log1p(ratio))
    return float(np.sqrt(total))


def noise_strengths(group, effect, factors, rng_seed, draws, others=()):
    """d at several sizes of a noise effect."""
    variants = [[*others, simulate.scaled(effect, f, group)] for f in factors]
    if effect["name"] == "unknown_spectrum":
        return np.array([spectrum_strength(group, v[-1]) for v in variants])
    if effect["name"] in ("outliers", "telegraph_noise"):
        gain = mixture_gain(group, variants, rng_seed, draws)
    else:
        gain = gaussian_gain(group, variants, [list(others)] * len(variants) if others else None, rng_seed, draws)
    return np.sqrt(2 * np.maximum(gain, 1e-3))


def limit_factor(effect):
    """How far the effect may be scaled before it leaves what makes sense."""
    name, p = effect["name"], effect["parameters"]
    size = max(abs(s["amplitude_dph"]) for s in p["steps"]) if name == "bias_step" else \
        max(abs(p[k]) for k in simulate.AMPLITUDE[name])
    return LIMITS[name] / size


def interpolate(factors, strengths, target):
    """Size at which d = target, on log-log axes; Unreachable outside the table."""
    s = np.maximum.accumulate(strengths)
    if not s[0] <= target <= s[-1]:
        return None
    keep = np.concatenate([[True], np.diff(s) > 0])
    return float(np.exp(np.interp(np.log(target), np.log(s[keep]), np.log(np.asarray(factors)[keep]))))


def to_strength(group, effect, target, bias, rng_seed, whitener=None, against=(), others=(), draws=3):
    """Scales an effect until its strength is `target`; returns (effect, strength computed)."""
    name = effect["name"]
    top = limit_factor(effect)
    if name in simulate.MEAN:
        if name in ("thermal_lag", "run_to_run"):
            factors = np.geomspace(top * 1e-4, top, 14 if name == "thermal_lag" else 60)
            table = np.array([mean_strength(group, simulate.scaled(effect, f, group), bias, whitener, against)
                              for f in factors])
            factor = interpolate(factors, table, target)
        else:
            factor = target / max(mean_strength(group, effect, bias, whitener, against), 1e-12)
        if factor is None or factor > top:
            raise Unreachable(f"{name} at d={target}")
        result = simulate.scaled(effect, factor, group)
        return result, mean_strength(group, result, bias, whitener, against)
    if name == "unknown_spectrum":
        factors = np.geomspace(1e-4, 100, 100)
        factor = interpolate(factors, noise_strengths(group, effect, factors, rng_seed, 1), target)
        return simulate.scaled(effect, factor, group), float(target)
    factors = np.geomspace(top * 2e-3, top, 6)
    coarse = noise_strengths(group, effect, factors, rng_seed, 1, others)
    factor = interpolate(factors, coarse, target)
    if factor is None:
        raise Unreachable(f"{name} at d={target}")
    factors = np.minimum(factor * np.array([0.6, 0.85, 1.2, 1.7]), top)
    fine = noise_strengths(group, effect, factors, rng_seed + 1, draws, others)
    better = interpolate(factors, fine, target)
    if better is not None:
        factor, reached = better, target
    else:  # outside the narrow table: take its nearest end and say what d that is
        i = int(np.argmin(np.abs(np.log(fine / target))))
        factor, reached = float(factors[i]), float(fine[i])
        if not 0.7 < reached / target < 1.4:
            raise Unreachable(f"{name} at d={target}")
    return simulate.scaled(effect, factor, group), reached


# ---- what this profile can tell apart ---------------------------------------------------------------------

def rival_columns(group):
    """Whitened columns of the library's repeatable effects, {name: [block, ...]}, projected; for separability."""
    if "rivals" in group.cache:
        return group.cache["rivals"]
    whitener = nominal_whitener(group)
    bias = np.zeros(4)
    blocks = {}

    def add(name, parameters):
        blocks.setdefault(name, []).append(
            [simulate.signature({"name": name, "parameters": parameters}, group, r, i, bias)[:, None]
             for i, r in enumerate(group.train)])

    add("temperature_rate", {"k_dph_per_degc_min": 1})
    add("rate_ramp", {"ramp_dph_per_h": 1})
    for r in (1, 2, 3.5, 5.5, 8, 11, 15, 20, 26):
        add("thermal_hysteresis", {"amplitude_dph": 1, "width_degc": r})
    for tau in (40, 80, 160, 320, 640, 1280):
        add("warm_up", {"amplitude_dph": 1, "tau_s": tau})
    lo, hi = group.nominal.t0_degc - group.nominal.range_degc, group.nominal.t0_degc + group.nominal.range_degc
    for width in (0.8, 1.6, 3.0, 5.5):
        for center in np.arange(lo + 1, hi, max(2.0, width)):
            add("thermal_anomaly", {"amplitude_dph": 1, "center_degc": center, "width_degc": width})
    names, columns = [], []
    for name, items in blocks.items():
        names += [name] * len(items)
        columns += items
    joined = [np.concatenate([c[i] for c in columns], 1) for i in range(len(group.train))]
    z = whitener.perpendicular(joined)
    out = {name: [z[:, [i]] for i, n in enumerate(names) if n == name] for name in blocks}
    poly = [np.stack([np.polynomial.legendre.legval(group.x(r.temp_degc), [0, 0, 0, 0, 1]),
                      np.polynomial.legendre.legval(group.x(r.temp_degc), [0, 0, 0, 0, 0, 1])], 1)
            for r in group.train]
    out["higher_order_polynomial"] = [whitener.perpendicular(poly)]
    lag_spaces = []
    for tau in (30, 60, 120, 240, 480, 960, 1500):
        shape = [np.stack([group.x(simulate.lagged(r.temp_degc, tau)) ** j for j in range(4)], 1)
                 for r in group.train]
        lag_spaces.append(whiten.Projector(whiten.kalman(whiten.pad(shape)[0], whitener.noise, whitener.keep)[0]))
    group.cache["rivals"] = (out, lag_spaces)
    return group.cache["rivals"]


def most_confusable(group, effect, bias):
    """(name, rho2): the other repeatable library effect that explains most of this one on this profile."""
    whitener = nominal_whitener(group)
    columns = believed_curve(group, bias) if effect["name"] == "temperature_sensor_quantization" else \
        signature_columns(group, effect, bias)
    raw = whitener.whiten(columns)[:, 0]
    s = whitener.project(raw[:, None])[:, 0]
    energy = float(s @ s)
    rivals, lag_spaces = rival_columns(group)
    best = ("none", 0.0)
    for name, blocks in rivals.items():
        if name == effect["name"]:
            continue
        for z in blocks:
            norm = np.linalg.norm(z, axis=0)
            if np.any(norm < 1e-9):
                continue
            q, _ = np.linalg.qr(z / norm)
            share = float(np.sum((q.T @ s) ** 2)) / energy
            if share > best[1]:
                best = (name, share)
    if effect["name"] != "thermal_lag":
        curve = whitener.whiten(believed_curve(group, bias))[:, 0]
        target = raw if effect["name"] == "temperature_sensor_quantization" else raw + curve
        for space in lag_spaces:
            share = 1.0 - float(np.sum(space(target[:, None])[:, 0] ** 2)) / energy
            if share > best[1]:
                best = ("thermal_lag", share)
    return best[0], float(min(max(best[1], 0.0), 1.0))


def library_noise_left(group, effect):
    """d that remains of a random spectrum or modulation after the nearest library noise is fitted to it.

    Spectrum: Whittle divergence to re-tuned noise plus a second Markov process plus flicker noise.
    Modulation: share of the log-variance that a constant and a slope over temperature do not explain.
    """
    from scipy.optimize import minimize

    p = effect["parameters"]
    if effect["name"] == "unknown_modulation":
        shape = np.concatenate([unknown.function(p, group, r) for r in group.train])
        x = np.concatenate([group.x(r.temp_degc) for r in group.train])
        design = np.column_stack([np.ones_like(x), x])
        rest = shape - design @ np.linalg.lstsq(design, shape, rcond=None)[0]
        # strength is second order in the log-variance about the believed level, so the mean counts as well
        return float(np.sqrt(np.mean(rest**2) / np.mean(shape**2)))
    n = sum(r.n for r in group.train)
    f = np.geomspace(4 / 8400, 0.4999, 400)
    weight = np.gradient(f) * n  # independent frequencies per grid point
    truth = unknown.nominal_density(group, f) + p["_amplitude"] ** 2 * unknown.spectrum(p, f, group)

    def density(theta):
        white, *rest = np.exp(np.clip(theta, -12, 12))
        total = np.full_like(f, 2 * white**2)
        for sigma, tau in zip(rest[0:4:2], rest[1:4:2]):
            phi = np.exp(-1.0 / tau)
            total += 2 * sigma**2 * (1 - phi**2) / (1 - 2 * phi * np.cos(2 * np.pi * f) + phi**2)
        return total + rest[4] ** 2 / (2 * np.pi * f)

    def divergence(theta):
        ratio = truth / density(theta)
        return float(np.sum(weight * (ratio - 1 - np.log(ratio))))

    sigma, tau = group.nominal.markov[0]
    best = np.inf
    for tau2 in (8.0, 800.0):
        start = np.log([group.nominal.white_dph, sigma, tau, 0.5 * sigma, tau2, 0.05 * sigma])
        best = min(best, minimize(divergence, start, method="Nelder-Mead",
                                  options={"maxfev": 1500, "fatol": 0.05, "adaptive": True}).fun)
    return float(np.sqrt(2 * max(best, 0.0)))
