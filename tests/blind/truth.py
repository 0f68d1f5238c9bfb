# SPDX-License-Identifier: MIT
"""What the effects that were named really remove of the held-out gap: from the noise-free truth, not from the logs.

Both models get the constants (and start states) of a held-out run for nothing; the slopes of temperature come from the
training runs.  Measures: "deviance" (expected, whitened by the true noise; noise counts by its Whittle divergence),
"power" 1 - R1^2/R0^2 and "rms" 1 - R1/R0 of the mean residual in dph.  Written from the contract's parameters alone.
"""
from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from . import cases, causes, gauge, noise, outside
from .gauge import blocks
from .sensor import low_pass

TONES = ("sinusoid", "drifting_tone")  # faster than the block means: counted with the noise
SCALE_WITHOUT_MODEL = (30.0, 30.0)  # t0, range [degC]
NO_GAP_DEVIANCE = 4.0  # less than this in all held-out runs is no gap that anything could shrink


CLAIMABLE = causes.SLOW + ("white_noise_vs_temperature", "noise_parameters")


class Unscorable(Exception):
    """The claim has no form here (a family without a member, an effect between axes)."""


def claimed_member(effect):
    """Name and parameters; a family stands for the first member of its set where its parameters fit."""
    name, p = effect["name"], dict(effect.get("parameters") or {})
    if name in causes.FAMILIES and name not in causes.FAMILY_OF:
        members = [s["name"] for s in effect.get("set", []) if s["name"] in causes.FAMILY_OF]
        fitting = [m for m in members if set(causes.SIZE.get(m, ("?",))) <= set(p)]
        if not fitting:
            raise Unscorable(f"family {name} without parameters")
        name = fitting[0]
    return {"name": name, "p": {k: v for k, v in p.items() if v is not None}}


def smoothed(shown_degc):
    """Thermometer without most of its noise, and no later: a delay would count as one of the answer."""
    return 0.5 * (low_pass(shown_degc, 5.0) + low_pass(shown_degc[::-1], 5.0)[::-1])


def delays_of(claims):
    return [c["p"]["tau_s"] for c in claims if c["name"] == "thermal_lag"]


def slopes_of(device, run, claims):
    """Columns whose coefficients are common to the runs."""
    shown = run.shown_degc if not delays_of(claims) else low_pass(smoothed(run.shown_degc), delays_of(claims)[0])
    if any(c["name"] == "temperature_sensor_quantization" for c in claims):
        shown = run.temp_degc  # the best a model of the step could do
    x = device.x(shown)
    return blocks(np.stack([x, x**2, x**3], 1))


def own_columns(device, run, claims, is_foretold=False):
    """Columns a run has for itself: constant, start states, phases.

    What differs from run to run by chance is free in the runs that teach the slopes; other runs foretell nothing of it.
    """
    t, temp = run.t_s, smoothed(run.shown_degc)
    columns = [np.ones(run.n)]
    for c in claims:
        name, p = c["name"], c["p"]
        if name == "thermal_lag":
            decay = np.exp(-t / p["tau_s"])
            columns += [decay, decay * device.x(temp)]
        elif name == "thermal_hysteresis":
            r = max(p["width_degc"], 0.01)
            columns.append((causes.play(temp, r, 1) - causes.play(temp, r, -1)) / (2 * r))
        elif name == "thermal_creep":
            columns += [np.exp(-t / p["tau_first_s"]), np.exp(-t / p["tau_last_s"])]
        elif name == "thermal_step" and p.get("width_degc", 0) > 0:
            columns.append(causes.step_state(p, temp, 1.0) - causes.step_state(p, temp, -1.0))
        elif name == "warm_up":
            columns.append(np.exp(-t / p["tau_s"]))
        elif name == "sinusoid":
            f = p["frequency_hz"] + p.get("slope_hz_per_degc", 0.0) * (temp - device.t0_degc)
            columns += [np.cos(2 * np.pi * np.cumsum(f)), np.sin(2 * np.pi * np.cumsum(f))]
        elif name == "run_to_run" and not is_foretold:
            x = device.x(temp)
            columns += [x, x**2]
    columns = blocks(np.stack(columns, 1))
    return columns[:, np.concatenate([[True], np.ptp(columns[:, 1:], axis=0) > 1e-9])]


def fixed_part(device, r, claims, scale):
    """Signature with the claimed parameters, start states in the middle.  scale: t0 and range of normalised temperatures."""
    run = device.runs[r]
    total = np.zeros(run.n)
    smooth = type(run)(run.t_s, smoothed(run.shown_degc), run.shown_degc, run.keep, run.aux)
    stand_in = type(device)(device.profile, [smooth] * (r + 1), [], *scale, device.lsb_degc)
    for c in claims:
        if c["name"] in causes.REPEATABLE and c["name"] != "thermal_lag" or c["name"] in ("auxiliary_channel", "bias_step"):
            total += causes.signature(c, stand_in, r, np.zeros(4))
    return blocks(total)


def residuals(case, axis, claims, meter, scale):
    """Mean residual on the held-out runs under a model: whitened (own columns out) and raw block means."""
    device = case.device
    n_train = len(device.train)
    target, own, common = [], [], []
    for r, run in enumerate(device.runs):
        curve, extra = cases.clean_signal(case, axis, r, TONES)
        target.append(blocks(curve + extra) - fixed_part(device, r, claims, scale))
        own.append(own_columns(device, run, claims))
        common.append(slopes_of(device, run, claims))
    white = lambda v: gauge.solve_triangular(meter.factor[: len(v), : len(v)], v, lower=True)
    rows, right = [], []
    for r in range(n_train):
        q = gauge.basis(white(own[r]))
        drop = lambda v, q=q: v - q @ (q.T @ v)
        rows.append(drop(white(common[r])))
        right.append(drop(white(target[r])))
    slopes = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=1e-9)[0]
    energy, raw = 0.0, []
    for r in range(n_train, len(device.runs)) if device.hold else range(n_train):
        left, mine = target[r] - common[r] @ slopes, own_columns(device, device.runs[r], claims, is_foretold=True)
        beta = np.linalg.lstsq(white(mine), white(left), rcond=1e-9)[0]
        left = left - mine @ beta
        energy += float(np.sum(white(left) ** 2))
        raw.append(left)
    return energy, float(np.sqrt(np.mean(np.concatenate(raw) ** 2)))


# ---- noise -----------------------------------------------------------------------------------------------

def true_density(case, axis, f):
    """(m, f) density of the whole noise of an axis, and what is not Gaussian of it as strength d."""
    total, extra = case.base.density(f)[None, :], 0.0
    for cause in case.found[axis]:
        if cause["name"] in causes.SLOW + ("white_noise_vs_temperature", "noise_parameters"):
            total = gauge.local_density(cause, case.device, case.base, f)
        elif cause["name"] in outside.NOISES and cause["name"] != "bursts":
            total = total + outside.density(cause)(f)[None]
        elif cause["name"] in ("outliers", "bursts"):
            extra = cases.strength(cause, case.device, case.base, case.bias[axis], None)
    return total, extra


def claimed_noise(claims, device, base, f):
    """Function of (white, sigma, tau): density under the claims, base parameters free."""
    added = [causes.added_density(c) for c in claims if causes.added_density(c)]
    varying = [c for c in claims if c["name"] in ("white_noise_vs_temperature", "markov_sigma_vs_temperature",
                                                  "markov_tau_vs_temperature")]

    def density(theta):
        white, sigma, tau = np.exp(np.clip(theta, -12, 12))
        own = noise.Noise(white, [(sigma, tau)])
        total = gauge.local_density(varying[0], device, own, f) if varying else own.density(f)[None, :]
        return total + sum(a(f)[None, :] for a in added)

    return density


def noise_deviance(case, axis, claims, lengths):
    """2 x expected loss of the nominal noise, or of the best noise of the claimed form where a noise is claimed."""
    f, weight = noise.grid(lengths)
    truth, extra = true_density(case, axis, f)
    share = sum(lengths) / sum(r.n for r in case.device.train)
    left = tones_left(case, axis, claims) * share
    if extra and not any(c["name"] == "outliers" for c in claims):
        left += extra**2 * share
    if not any(c["name"] in CLAIMABLE for c in claims):
        return left + 2 * noise.divergence(truth, case.base.density(f)[None], weight[None] / truth.shape[0])
    return left + 2 * best_claimed(case, claims, truth, f, weight)


def best_claimed(case, claims, truth, f, weight):
    """Least divergence [nats] with the base's parameters free."""
    density = claimed_noise(claims, case.device, case.base, f)
    m = max(truth.shape[0], density(np.zeros(3)).shape[0])
    cost = lambda th: noise.divergence(np.broadcast_to(truth, (m, f.size)), density(th), weight[None, :] / m)
    sigma, tau = case.base.markov[0]
    starts = [np.log([case.base.white_dph, s, t]) for s, t in
              {(sigma, tau), noise.first_guess(truth, f[None], weight[None] / truth.shape[0], case.base)}]
    best = min(minimize(cost, s, method="Nelder-Mead", options={"maxfev": 400, "fatol": 0.01}).fun for s in starts)
    return max(best, 0.0)


def tones_left(case, axis, claims):
    """Deviance of the tones that no claimed tone follows."""
    left = 0.0
    for cause in case.found[axis]:
        if cause["name"] in TONES:
            drifts, f0 = cause["name"] == "drifting_tone", cause["p"].get("_f_hz", cause["p"].get("frequency_hz"))
            near = [c for c in claims if c["name"] == "sinusoid" and abs(c["p"]["frequency_hz"] - f0) < 2e-3 * (1 + 20 * drifts)]
            followed = any(not drifts or any("degc" in k for k in c["p"]) for c in near)
            left += 0.0 if followed else cases.strength(cause, case.device, case.base, case.bias[axis], None) ** 2
    return left


def reduction(case, axis, effects, has_model=True):
    """{"deviance", "power", "rms"} of what the claimed effects remove; {"no_gap": True} where nothing is there to remove.

    has_model: whether the answer knew a polynomial; without one it tells normalised temperatures as (T - 30 degC)/30 degC
    (host/formats.md, `bias`).
    """
    claims = [claimed_member(e) for e in effects]
    if any(c["name"] == "common_mode" for c in claims):
        raise Unscorable("common_mode")
    marks = [c["name"] for f in case.found.values() for c in f if c["name"] in causes.OUTPUT]
    if marks or case.spec.get("beside"):
        raise Unscorable("marks of the output stage")
    device = case.device
    meter = gauge.Gauge(type(device)(device.profile, device.runs, [], device.t0_degc, device.range_degc, device.lsb_degc),
                        case.base.density)
    lengths = [r.n for r in (device.hold or device.train)]
    scale = (device.t0_degc, device.range_degc) if has_model else SCALE_WITHOUT_MODEL
    before, raw0 = residuals(case, axis, [], meter, scale)
    after, raw1 = residuals(case, axis, claims, meter, scale)
    before += noise_deviance(case, axis, [], lengths)
    after += noise_deviance(case, axis, claims, lengths)
    out = {"no_gap": before < NO_GAP_DEVIANCE, "deviance_before": before, "deviance_after": after, "rms_before_dph": raw0,
           "rms_after_dph": raw1}
    noise_only = not any(cases.is_signal(c) and c["name"] not in TONES for c in case.found[axis])
    out["deviance"] = 1 - after / max(before, 1e-9)
    out["power"] = out["deviance"] if noise_only else 1 - (raw1 / raw0) ** 2
    out["rms"] = out["deviance"] if noise_only else 1 - raw1 / raw0
    return out


def judge(task):
    """Redraws a case and scores claims: task = (label, [(key, axis, effects, has_model)]) -> {key + axis: reduction or reason}."""
    label, claims = task
    case = cases.build(label["seed"], label["index"], label["planned"])
    if any(not np.allclose(case.bias[a], b) for a, b in label["bias_dph"].items()):
        return {f"{key}/{axis}": {"unscorable": "drawn by another version of the check"} for key, axis, *_ in claims}
    out = {}
    for key, axis, effects, has_model in claims:
        try:
            out[f"{key}/{axis}"] = reduction(case, axis, effects, has_model)
        except (Unscorable, KeyError, ValueError, np.linalg.LinAlgError) as problem:
            out[f"{key}/{axis}"] = {"unscorable": f"{type(problem).__name__}: {problem}"}
    return out
