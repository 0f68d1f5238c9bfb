# SPDX-License-Identifier: MIT
"""What a model is worth on runs the fit never saw: held-out deviance, computed independently of the engine.

The nuisance (polynomial) is fitted on the training runs under the model in question, the effects have the
parameters given (the true ones for the oracle, the reported ones to check a diagnosis), the turn-on constant
of the held-out run is integrated over N(0, 300^2), random coefficients and phases over their distribution.
"""
from __future__ import annotations

import numpy as np

from . import simulate, strength, whiten

TURN_ON_PRIOR_DPH = 300.0
NO_ORACLE = simulate.OUTPUT + simulate.BETWEEN_AXES + ("unknown_spectrum",)


def _random_columns(group, run, effects):
    """Columns whose coefficients are random in every run, with their variances."""
    columns, variances = [np.ones(run.n)], [TURN_ON_PRIOR_DPH**2]
    x = group.x(run.shown_degc)
    for effect in effects:
        p = effect["parameters"]
        if effect["name"] == "run_to_run":
            columns += [x, (x**2 - 1 / 3) / 2]
            variances += [p["sigma_dph"] ** 2] * 2
        elif effect["name"] == "sinusoid":
            phase = 2 * np.pi * p["frequency_hz"] * run.t_s
            columns += [np.cos(phase), np.sin(phase)]
            variances += [0.5 * p["amplitude_dph"] ** 2 + 1e-12] * 2
    return np.stack(columns, 1), np.array(variances)


def _fixed_mean(group, run, index, effects, bias):
    """Repeatable part with known parameters (random phases and coefficients are integrated instead)."""
    skip = ("run_to_run", "sinusoid", "temperature_sensor_quantization")
    total = np.zeros(run.n)
    for effect in effects:
        if effect["name"] in simulate.MEAN and effect["name"] not in skip:
            total += simulate.signature(effect, group, run, index, bias)
        if effect["name"] == "temperature_sensor_quantization":  # the true curve, where the fit has the shown one
            total += simulate.polynomial(bias, group.x(run.temp_degc)) - simulate.polynomial(
                bias, group.x(run.shown_degc))
    return total


def _fit_slopes(group, series, effects, bias, noise):
    """GLS slopes of the shown temperature, random columns as ridge terms."""
    runs = group.train
    columns, counts = [], []
    for i, run in enumerate(runs):
        x = group.x(run.shown_degc)
        random, variances = _random_columns(group, run, effects)
        y = series[i] - _fixed_mean(group, run, i, effects, bias)
        columns.append(np.column_stack([y, *(x**j for j in range(1, group.nominal.order + 1)), random]))
        counts.append(variances)
    e, _ = whiten.kalman(whiten.pad(columns)[0], noise, whiten.run_mask(runs))
    order, b = group.nominal.order, len(runs)
    n_random = counts[0].size
    rows, target = [], []
    for i in range(b):
        block = np.zeros((e.shape[1], order + b * n_random))
        block[:, :order] = e[i, :, 1: 1 + order]
        block[:, order + i * n_random: order + (i + 1) * n_random] = e[i, :, 1 + order:]
        rows.append(block)
        target.append(e[i, :, 0])
        prior = np.zeros((n_random, order + b * n_random))
        prior[:, order + i * n_random: order + (i + 1) * n_random] = np.diag(1 / np.sqrt(counts[i]))
        rows.append(prior)
        target.append(np.zeros(n_random))
    design, target = np.vstack(rows), np.concatenate(target)
    scale = np.linalg.norm(design, axis=0)
    return (np.linalg.lstsq(design / scale, target, rcond=None)[0] / scale)[:order]


def held_out_deviance(group, series, effects, bias, believed=None):
    """-2 log-likelihood of the held-out runs (constants of 2 pi left out), one value per run.

    effects=[]: the nominal model (with the noise diagnose was told).  series: all runs, training first.
    """
    nominal_group = group if believed is None else believed
    train, hold = group.train, group.hold
    slopes = _fit_slopes(group, series, effects, bias, strength.noise_model(nominal_group, train, effects))
    columns, variances = [], []
    n_train = len(train)
    for i, run in enumerate(hold):
        x = group.x(run.shown_degc)
        random, v = _random_columns(group, run, effects)
        y = series[n_train + i] - _fixed_mean(group, run, n_train + i, effects, bias)
        y = y - sum(s * x ** (j + 1) for j, s in enumerate(slopes))
        columns.append(np.column_stack([y, random]))
        variances.append(v)
    padded, _ = whiten.pad(columns)
    keep = whiten.run_mask(hold)
    noise = strength.noise_model(nominal_group, hold, effects)
    e, log_s = whiten.kalman(padded, noise, keep)
    special = [x for x in effects if x["name"] in ("outliers", "telegraph_noise")]
    out = []
    for i in range(len(hold)):
        y, u, v = e[i, :, 0], e[i, :, 1:], variances[i]
        gram = u.T @ u
        inner = np.linalg.solve(gram + np.diag(1 / v), u.T @ y)
        deviance = float(np.sum(log_s[i]) + y @ y - (u.T @ y) @ inner + np.linalg.slogdet(
            np.eye(v.size) + np.sqrt(v)[:, None] * gram * np.sqrt(v)[None])[1])
        if special:  # not Gaussian: correct by the likelihood ratio of the series without its constant
            clean = (padded[i, :, 0] - padded[i, :, 1:] @ inner)[None, :, None]
            deviance -= 2 * _non_gaussian_excess(nominal_group, special[0], clean, keep[i: i + 1], hold[i: i + 1],
                                                 effects)
        out.append(deviance)
    return np.array(out)


def _non_gaussian_excess(group, effect, y, keep, runs, effects):
    """log p(mixture) - log p(its Gaussian twin)."""
    sigma, tau = np.array(group.nominal.markov).T
    r, p = group.nominal.white_dph**2, effect["parameters"]
    if effect["name"] == "outliers":
        full = whiten.outlier_log_likelihood(y, r, sigma, tau, p["probability"], np.array([p["sigma_dph"]]), keep)
    else:
        full = whiten.telegraph_log_likelihood(y, r, sigma, tau, p["amplitude_dph"], p["tau_s"], keep)
    twin = whiten.gaussian_log_likelihood(y, strength.noise_model(group, runs, [effect]), keep)
    return float((full - twin)[0, 0])


def held_out_gain(group, effects, bias, series):
    """{"nominal": deviance, "true": deviance, "hours"} of the held-out runs, or None where it has no meaning."""
    if not effects or not group.hold or any(e["name"] in NO_ORACLE for e in effects):
        return None
    if sum(e["name"] in ("outliers", "telegraph_noise") for e in effects) and len(effects) > 1:
        return None  # the mixture likelihood here knows no second effect
    before = held_out_deviance(group, series, [], bias)
    after = held_out_deviance(group, series, effects, bias)
    hours = sum(int(r.keep.sum()) for r in group.hold) / 3600.0
    return {"nominal": before.tolist(), "true": after.tolist(), "hours": hours}
