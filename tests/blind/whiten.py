# SPDX-License-Identifier: MIT
"""Whitening by Kalman filter in numpy: the second way to what `gauge.py` does by dense algebra, and where noise varies in time.

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


def gaussian_log_likelihood(y, noise, keep):
    e, log_s = kalman(y, noise, keep)
    count = keep.sum(1)
    return -0.5 * (np.sum(e**2, 1) + log_s.sum(1)[:, None] + np.log(2 * np.pi) * count[:, None])
