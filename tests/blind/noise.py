# SPDX-License-Identifier: MIT
"""Noise of a device as a power density, its drawn paths, and how far two densities lie apart (Whittle).

Densities are two-sided, dph^2/Hz at one sample per second, so that white noise of standard deviation w has w^2.
Random walk: K^2/(4 sin^2 pi f); flicker: B^2/(2 pi f) (IEEE Std 952); Gauss-Markov: its sampled spectrum.
"""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize
from scipy.signal import lfilter

from .sensor import log_uniform

F_MIN_HZ = 2e-5  # slower than any run: what lies below is a run's constant


@dataclass
class Noise:
    """White standard deviation, Markov terms (sigma, tau), and further densities (a function of f each)."""

    white_dph: float
    markov: list
    others: list = field(default_factory=list)

    def density(self, f):
        total = np.full(np.shape(f), float(self.white_dph) ** 2)
        for sigma, tau in self.markov:
            total = total + markov_density(f, sigma, tau)
        for other in self.others:
            total = total + other(f)
        return total

    def to_json(self, t0, half, bias=(0.0, 0.0, 0.0, 0.0)):
        return {"imucal_model": 1, "arw_deg_rt_h": float(f"{self.white_dph / 60:.5g}"),
                "markov": [{"sigma_dph": float(f"{s:.5g}"), "tau_s": float(f"{t:.5g}")} for s, t in self.markov],
                "turn_on_sigma_dph": 0, "bias": {"t0_degc": t0, "range_degc": half, "coeff_dph": list(bias)}}

    def wrong(self, factor):
        """Believed sigma and tau off by a factor."""
        return Noise(self.white_dph, [(s * factor, t * factor) for s, t in self.markov])


def markov_density(f, sigma, tau):
    phi = np.exp(-1.0 / tau)
    return sigma**2 * (1 - phi**2) / (1 - 2 * phi * np.cos(2 * np.pi * f) + phi**2)


def walk_density(f, k):
    return k**2 / (4 * np.sin(np.pi * np.maximum(f, F_MIN_HZ)) ** 2)


def flicker_density(f, b):
    return b**2 / (2 * np.pi * np.maximum(f, F_MIN_HZ))


def draw_noise(rng):
    """What a good error model of the device says."""
    white = 60 * log_uniform(rng, 0.08, 1.2)
    terms = [(white * log_uniform(rng, 0.2, 0.9), log_uniform(rng, 40, 400))]
    if rng.random() < 0.15:
        terms = [(terms[0][0], log_uniform(rng, 15, 50)), (0.5 * terms[0][0], log_uniform(rng, 250, 700))]
    short = lambda v: float(f"{v:.4g}")
    return Noise(60 * short(white / 60), [(short(s), short(t)) for s, t in terms])


# ---- paths ------------------------------------------------------------------------------------------------

def markov_path(tau_s, n, rng):
    """Stationary unit-variance Gauss-Markov path; tau may vary from second to second."""
    w = rng.standard_normal(n)
    if np.ndim(tau_s) == 0:
        a = np.exp(-1.0 / tau_s)
        first, w = w[0], np.sqrt(1 - a * a) * w
        w[0] = first
        return lfilter([1.0], [1.0, -a], w)
    a, out = np.exp(-1.0 / np.asarray(tau_s)), np.empty(n)
    out[0] = w[0]
    for k in range(1, n):
        out[k] = a[k - 1] * out[k - 1] + np.sqrt(1 - a[k - 1] ** 2) * w[k]
    return out


def coloured_path(density, n, rng):
    """Gaussian path of a density, cut from one four times as long: it neither starts nor ends at zero."""
    size = 4 * n
    f = np.fft.rfftfreq(size)
    z = rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)
    z *= np.sqrt(density(np.maximum(f, f[1])) * size / 2)
    z[0] = 0
    return np.fft.irfft(z, size)[:n]


# ---- distance ---------------------------------------------------------------------------------------------

def grid(seconds):
    """Frequencies and how many periodogram ordinates of `seconds` samples each stands for."""
    f = np.geomspace(max(3.0 / max(seconds) if np.ndim(seconds) else 3.0 / seconds, 1e-4), 0.5, 240)
    return f, np.gradient(f) * float(np.sum(seconds))


def divergence(truth, model, weight):
    """Expected log-likelihood gain of the true density over a model's [nats]."""
    ratio = truth / model
    return float(np.sum(weight * (ratio - 1 - np.log(ratio))))


FAMILY_FITS = {  # which noise a fit may use: number of Markov terms, random walk, flicker
    "nominal": (1, False, False), "second_markov": (2, False, False), "rate_random_walk": (1, True, False),
    "flicker_noise": (1, False, True)}


def fitted_density(theta, f, n_markov, walk, flicker):
    v = np.exp(np.clip(theta, -14, 14))
    total = np.full(f.shape, v[0] ** 2)
    for i in range(n_markov):
        total = total + markov_density(f, v[1 + 2 * i], v[2 + 2 * i])
    k = 1 + 2 * n_markov
    if walk:
        total = total + walk_density(f, v[k])
    return total + flicker_density(f, v[k + walk]) if flicker else total


def first_guess(truth, f, weight, start):
    """White + Markov noise of a coarse grid that lies nearest: where the search starts."""
    sigma, tau = start.markov[0]
    tried = [(divergence(truth, start.white_dph**2 + markov_density(f, sigma * a, tau * b), weight), sigma * a, tau * b)
             for a in (0.5, 1, 2, 4, 8, 16) for b in (0.05, 0.2, 1, 4, 15, 50)]
    return min(tried)[1:]


def starts(truth, f, weight, start, form):
    """Where the search for the best noise of a form begins: near places of a coarse grid of what the form adds."""
    n_markov, walk, flicker = FAMILY_FITS[form]
    white, out = start.white_dph, []
    added = [()]
    if n_markov == 2:
        added = [(white * s, tau) for s in (0.03, 0.1, 0.3, 1.0) for tau in (3.0, 10.0, 40.0, 200.0, 1000.0, 4000.0)]
    elif walk or flicker:
        added = [(white * s,) for s in np.geomspace(1e-4, 0.1, 8) * (10 if flicker else 1)]
    for sigma, tau in {first_guess(truth, f, weight, start), tuple(start.markov[0])}:
        tried = [[white * w, sigma * s, tau, *more] for w in (0.7, 1.0) for s in (0.3, 1.0) for more in added]
        cost = lambda theta: divergence(truth, fitted_density(np.log(theta), f, n_markov, walk, flicker), weight)
        out += sorted(tried, key=cost)[:2] + [[white, sigma, tau, *more] for more in added[:1]]
    return out


def closest(truth, f, weight, start, form):
    """Gain of the truth over the best noise of a form; `start` is a Noise.  -> (nats, its density as a function of f)"""
    n_markov, walk, flicker = FAMILY_FITS[form]
    best, found = np.inf, None
    cost = lambda th: divergence(truth, fitted_density(th, f, n_markov, walk, flicker), weight)
    for theta in starts(truth, f, weight, start, form):
        fit = minimize(cost, np.log(theta), method="Nelder-Mead", options={"maxfev": 120 * len(theta), "fatol": 0.01,
                                                                          "xatol": 0.01, "adaptive": True})
        if fit.fun < best:
            best, found = float(fit.fun), fit.x
    return max(best, 0.0), lambda at: fitted_density(found, at, n_markov, walk, flicker)


def least_divergence(truth, f, weight, start, form="nominal"):
    """The same with the density at f."""
    nats, density = closest(truth, f, weight, start, form)
    return nats, density(f)
