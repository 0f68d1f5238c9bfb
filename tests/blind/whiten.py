# SPDX-License-Identifier: MIT
"""Whitening and exact likelihoods in numpy, independent of the engine.

A noise model is white noise of variance R plus components, each a scalar Gauss-Markov state that is
observed with weight h:  m_{k+1} = phi m_k + N(0, q),  y_k = sum h m_k + N(0, R).  Every quantity may be
a scalar, one value per run (B,), or one per run and row (B, N).  All runs (and whatever else is stacked
into the first axis) go through the filter side by side, so that the Python loop runs once over time.
"""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Noise:
    """R [dph^2] and components (phi, q, p0, h)."""

    r: object
    parts: list = field(default_factory=list)


def markov_part(sigma, tau, h=1.0):
    phi = np.exp(-1.0 / np.asarray(tau, float))
    sigma = np.asarray(sigma, float)
    return (phi, sigma**2 * (1 - phi**2), sigma**2 * np.ones_like(phi * sigma), h)


def nominal_noise(nominal):
    return Noise(nominal.white_dph**2, [markov_part(s, t) for s, t in nominal.markov])


def _table(value, b, n):
    """-> (time-varying?, array (B,) or (N, B))."""
    value = np.asarray(value, float)
    if value.ndim == 2:
        return True, np.ascontiguousarray(value.T)
    return False, np.broadcast_to(value, (b,)).astype(float)


def kalman(y, noise, keep=None):
    """Standardised innovations.

    y: (B, N, K) columns that share a run's gains; keep: (B, N) False where a row is missing or beyond the
    run's end.  Returns e (B, N, K), zero where there is no row, and log S (B, N), zero there as well.
    """
    b, n, k = y.shape
    parts = noise.parts
    m = len(parts)
    keep = np.ones((b, n), bool) if keep is None else keep
    r_varies, r = _table(noise.r, b, n)
    phi_varies, phi = zip(*[_table(p[0], b, n) for p in parts])
    q_varies, q = zip(*[_table(p[1], b, n) for p in parts])
    h_varies, h = zip(*[_table(p[3], b, n) for p in parts])
    varies = r_varies or any(phi_varies) or any(q_varies) or any(h_varies)
    weighted = any(h_varies) or any(np.any(v != 1.0) for v in h)
    stack = lambda tables, flags, t: np.stack([v[t] if f else v for v, f in zip(tables, flags)], 1)
    cov = np.zeros((b, m, m))
    for i, p in enumerate(parts):
        p0 = np.asarray(p[2], float)
        cov[:, i, i] = p0[:, 0] if p0.ndim == 2 else p0
    state = np.zeros((b, m, k))
    yt = np.ascontiguousarray(np.where(keep[:, :, None], y, 0.0).transpose(1, 0, 2))
    e = np.zeros((n, b, k))
    log_s = np.zeros((n, b))
    all_here = keep.all(0)
    phi_t, q_t, h_t = stack(phi, phi_varies, 0), stack(q, q_varies, 0), stack(h, h_varies, 0)
    r_t = r[0] if r_varies else r
    settled = False
    index = np.arange(m)
    for t in range(n):
        if varies:
            phi_t, q_t, h_t = stack(phi, phi_varies, t), stack(q, q_varies, t), stack(h, h_varies, t)
            r_t = r[t] if r_varies else r
        here = all_here[t]
        if not settled or not here:
            settled = False
            ph = (cov @ h_t[:, :, None])[:, :, 0] if weighted else cov.sum(2)
            s = ((ph * h_t).sum(1) if weighted else ph.sum(1)) + r_t
            gain = ph / s[:, None]
            root = 1.0 / np.sqrt(s)
            log_root = np.log(s)
            if not here:
                gain = gain * keep[:, t][:, None]
            updated = cov - gain[:, :, None] * ph[:, None, :]
            nxt = phi_t[:, :, None] * updated * phi_t[:, None, :]
            nxt[:, index, index] += q_t
            if here and not varies and t > 10 and t % 8 == 0:
                settled = bool(np.all(np.abs(nxt - cov) <= 1e-11 * np.abs(cov[:, index, index]).max(1)[:, None, None]))
            cov = nxt
        nu = yt[t] - ((h_t[:, :, None] * state).sum(1) if weighted else state.sum(1))
        if here:
            e[t] = nu * root[:, None]
            log_s[t] = log_root
        else:
            e[t] = nu * root[:, None] * keep[:, t][:, None]
            log_s[t] = log_root * keep[:, t]
        state = phi_t[:, :, None] * (state + gain[:, :, None] * nu[:, None, :])
    return e.transpose(1, 0, 2), log_s.T


def pad(columns):
    """Runs of different length -> (B, N, K) and keep (B, N)."""
    n = max(c.shape[0] for c in columns)
    out = np.zeros((len(columns), n, columns[0].shape[1]))
    keep = np.zeros((len(columns), n), bool)
    for i, c in enumerate(columns):
        out[i, : c.shape[0]] = c
        keep[i, : c.shape[0]] = True
    return out, keep


def run_mask(runs):
    n = max(r.n for r in runs)
    keep = np.zeros((len(runs), n), bool)
    for i, r in enumerate(runs):
        keep[i, : r.n] = r.keep
    return keep


def nuisance(group, runs):
    """What is always estimated anew: a constant and x, x^2, x^3 of the shown temperature; per-run columns."""
    return [np.stack([group.x(r.shown_degc) ** j for j in range(group.nominal.order + 1)], 1) for r in runs]


def spread(e_nuisance):
    """Whitened nuisance (B, N, 1+order) -> design (B*N, B + order): own constant per run, shared slopes."""
    b, n, k = e_nuisance.shape
    design = np.zeros((b, n, b + k - 1))
    for i in range(b):
        design[i, :, i] = e_nuisance[i, :, 0]
        design[i, :, b:] = e_nuisance[i, :, 1:]
    return design.reshape(b * n, -1)


class Projector:
    """Removes from whitened columns what the nuisance can explain."""

    def __init__(self, e_nuisance):
        design = spread(e_nuisance)
        scale = np.linalg.norm(design, axis=0)
        self.q, r = np.linalg.qr(design / scale)
        # a profile that never moves carries no slope: its columns drop out
        self.q = self.q[:, np.abs(np.diag(r)) > 1e-9]
        self.log_det = float(np.sum(np.log(np.abs(np.diag(r)) + 1e-300) + np.log(scale)))
        self.design, self.scale, self.r = design, scale, r

    def __call__(self, columns):
        flat = columns.reshape(-1, columns.shape[-1]) if columns.ndim == 3 else columns
        return flat - self.q @ (self.q.T @ flat)

    def coefficients(self, column):
        return np.linalg.lstsq(self.design / self.scale, column, rcond=None)[0] / self.scale[:, None]


class Whitener:
    """Nominal (or any Gaussian) whitening of a list of runs with the nuisance projected away."""

    def __init__(self, group, runs, noise):
        self.group, self.runs, self.noise = group, runs, noise
        self.keep = run_mask(runs)
        base, _ = pad(nuisance(group, runs))
        e, self.log_s = kalman(base, noise, self.keep)
        self.project = Projector(e)

    def whiten(self, columns):
        """columns: per run (n, K) -> (B*N, K), not yet projected."""
        e, _ = kalman(pad(columns)[0], self.noise, self.keep)
        return e.reshape(-1, e.shape[-1])

    def perpendicular(self, columns):
        return self.project(self.whiten(columns))


def reml(group, runs, noise, y, copies=1):
    """Restricted log-likelihoods of series under a Gaussian model, nuisance integrated out.

    y: (copies * B, N, K): the B runs repeated `copies` times (for instance one copy per amplitude; `noise`
    then has one value per copy and run).  Returns (copies, K).
    """
    b = len(runs)
    keep = np.tile(run_mask(runs), (copies, 1))
    base = np.tile(pad(nuisance(group, runs))[0], (copies, 1, 1))
    e, log_s = kalman(np.concatenate([y, base], 2), noise, keep)
    k = y.shape[2]
    out = np.zeros((copies, k))
    for c in range(copies):
        part = e[c * b: (c + 1) * b]
        projector = Projector(part[:, :, k:])
        rest = projector(part[:, :, :k])
        out[c] = -0.5 * (log_s[c * b: (c + 1) * b].sum() + np.sum(rest**2, 0)) - projector.log_det
    return out


def profile_nuisance(group, runs, noise, y):
    """Series without the nuisance that GLS finds in them: (B, N, K)."""
    base, _ = pad(nuisance(group, runs))
    e, _ = kalman(np.concatenate([y, base], 2), noise, run_mask(runs))
    k = y.shape[2]
    projector = Projector(e[:, :, k:])
    beta = projector.coefficients(e[:, :, :k].reshape(-1, k))
    return y - (spread(base) @ beta).reshape(y.shape)


def outlier_log_likelihood(y, r, sigma, tau, probability, amplitude, keep):
    """Markov + white noise of which a share `probability` has variance R + A^2: assumed-density filter.

    y (B, N, K); amplitude (B,) of that noise.  Returns the log-likelihood per (B, K).  One Markov term.
    """
    return _mixture(y, r, sigma, tau, keep, probability, np.broadcast_to(amplitude, (y.shape[0],)))


def _mixture(y, r, sigma, tau, keep, p, a):
    b, n, k = y.shape
    sigma, tau = np.atleast_1d(sigma).astype(float), np.atleast_1d(tau).astype(float)
    phi = np.exp(-1.0 / tau)[None, :, None]
    q = (sigma**2)[None, :, None] * (1 - phi**2)
    m = sigma.size
    state = np.zeros((b, m, k))
    cov = np.zeros((b, m, m, k))
    for i in range(m):
        cov[:, i, i] = sigma[i] ** 2
    total = np.zeros((b, k))
    extra = (a**2)[:, None]
    for t in range(n):
        ph = cov.sum(2)
        s0 = ph.sum(1) + r
        s1 = s0 + extra
        nu = y[:, t] - state.sum(1)
        l0 = np.log1p(-p) - 0.5 * (np.log(2 * np.pi * s0) + nu**2 / s0)
        l1 = np.log(p) - 0.5 * (np.log(2 * np.pi * s1) + nu**2 / s1)
        here = keep[:, t][:, None]
        both = np.logaddexp(l0, l1)
        total += here * both
        w = np.exp(l1 - both)
        g = ((1 - w) / s0 + w / s1) * nu * here
        c = ((1 - w) / s0 + w / s1 - w * (1 - w) * (nu / s0 - nu / s1) ** 2) * here
        state = phi * (state + ph * g[:, None])
        cov = cov - ph[:, :, None] * ph[:, None] * c[:, None, None]
        cov = phi[:, :, None] * cov * phi[:, None]
        for i in range(m):
            cov[:, i, i] += q[:, i]
    return total


def telegraph_log_likelihood(y, r, sigma, tau, amplitude, switch_tau, keep):
    """+-a switching with time constant switch_tau over Markov + white noise: two-mode interacting filter."""
    b, n, k = y.shape
    sigma, tau = np.atleast_1d(sigma).astype(float), np.atleast_1d(tau).astype(float)
    m = sigma.size
    phi = np.exp(-1.0 / tau)
    q = sigma**2 * (1 - phi**2)
    p_switch = 0.5 * (1 - np.exp(-1.0 / switch_tau))
    a = np.broadcast_to(np.asarray(amplitude, float), (b,))[:, None]
    sign = np.array([1.0, -1.0])
    # the Markov part's covariance is the same in both modes up to the spread of the merged means
    state = np.zeros((2, b, m, k))
    cov = np.zeros((2, b, m, m, k))
    for i in range(m):
        cov[:, :, i, i] = sigma[i] ** 2
    weight = np.full((2, b, k), 0.5)
    total = np.zeros((b, k))
    for t in range(n):
        # mixing
        prior = np.stack([weight[0] * (1 - p_switch) + weight[1] * p_switch,
                          weight[1] * (1 - p_switch) + weight[0] * p_switch])
        mixed_state, mixed_cov = np.empty_like(state), np.empty_like(cov)
        for j in range(2):
            w_same = weight[j] * (1 - p_switch) / prior[j]
            w_other = 1 - w_same
            delta = state[j] - state[1 - j]
            mixed_state[j] = w_same[:, None] * state[j] + w_other[:, None] * state[1 - j]
            mixed_cov[j] = (w_same[:, None, None] * cov[j] + w_other[:, None, None] * cov[1 - j]
                            + (w_same * w_other)[:, None, None] * delta[:, :, None] * delta[:, None])
        if t:  # propagate
            mixed_state = phi[None, None, :, None] * mixed_state
            mixed_cov = phi[None, None, :, None, None] * mixed_cov * phi[None, None, None, :, None]
            for i in range(m):
                mixed_cov[:, :, i, i] += q[i]
        here = keep[:, t][:, None]
        ph = mixed_cov.sum(3)
        s = ph.sum(2) + r
        nu = y[None, :, t] - mixed_state.sum(2) - sign[:, None, None] * a[None]
        log_like = -0.5 * (np.log(2 * np.pi * s) + nu**2 / s) + np.log(prior)
        both = np.logaddexp(log_like[0], log_like[1])
        total += here * both
        weight = np.where(here, np.exp(log_like - both), prior)
        gain = ph / s[:, :, None] * here[:, None]
        state = mixed_state + gain * nu[:, :, None]
        cov = mixed_cov - gain[:, :, :, None] * ph[:, :, None]
    return total


def gaussian_log_likelihood(y, noise, keep):
    e, log_s = kalman(y, noise, keep)
    count = keep.sum(1)
    return -0.5 * (np.sum(e**2, 1) + log_s.sum(1)[:, None] + np.log(2 * np.pi) * count[:, None])


def fit_noise(group, rng):
    """Believed noise parameters fitted by maximum likelihood to other runs of the same campaign.

    As a user would with `errormodel fit`: four gap-free runs that are never given to `diagnose`.
    """
    from scipy.optimize import minimize

    from .campaign import Nominal
    from .simulate import nominal_series

    y, _ = pad([nominal_series(group, r, rng)[:, None] for r in group.train])
    start = np.log([group.nominal.arw_deg_rt_h] + [v for pair in group.nominal.markov for v in pair])

    def cost(theta):
        value = np.exp(theta)
        pairs = list(zip(value[1::2], value[2::2]))
        noise = Noise((60 * value[0]) ** 2, [markov_part(s, t) for s, t in pairs])
        return -float(reml(group, group.train, noise, y)[0, 0])

    best = minimize(cost, start, method="Nelder-Mead",
                    options={"maxfev": 60 * len(start) // 3, "xatol": 0.01, "fatol": 0.05,
                             "initial_simplex": start + 0.15 * np.vstack([np.zeros(len(start)), np.eye(len(start))])})
    value = [float(f"{v:.4g}") for v in np.exp(best.x)]
    n = group.nominal
    return Nominal(value[0], list(zip(value[1::2], value[2::2])), n.t0_degc, n.range_degc, n.order)
