# SPDX-License-Identifier: MIT
"""How strong a cause is, and what the profile can tell it from.

d = sqrt(2 x log-likelihood that the true cause gains over the fitted nominal model), true noise, training runs.
Repeatable causes: norm of the whitened signature (with its drawn start states) after constants and cubic are projected
out, on means over 20 s.  Noise: Whittle divergence from the nominal noise.  Also:
  rho2    share of the signature that the nearest other library member explains when its own start states are free;
  d_noise what is left of d when white noise and one Markov process are estimated anew (they may take a smooth signature);
  d_library the same over every noise of the library: also a second Markov process, random walk, flicker; outliers for bursts.
"""
from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz

from . import causes, noise
from .sensor import low_pass

BLOCK_S = 20
TELL = 4.0  # d sqrt(1 - rho2) above which two causes can be told apart (8 nats)


class Unreachable(Exception):
    """No sensible size has the wanted strength on this profile."""


def blocks(signal, length=BLOCK_S):
    n = signal.shape[0] // length
    return signal[: n * length].reshape(n, length, *signal.shape[1:]).mean(1)


def covariance_row(density, n, length=BLOCK_S):
    """First row of the covariance of `n` means over `length` seconds."""
    size = 2**17
    f = np.fft.rfftfreq(size)
    f[0] = f[1]
    gain = (np.sin(np.pi * f * length) / (length * np.sin(np.pi * f))) ** 2
    return np.fft.irfft(density(f) * gain, size)[: n * length: length]


class Gauge:
    """Whitening of the training runs under one noise, with the nuisance (and what is known besides) projected away."""

    def __init__(self, device, density, known=None):
        self.device, self.runs, self.known = device, device.train, known
        self.sizes = [r.n // BLOCK_S for r in self.runs]
        self.factor = cholesky(toeplitz(covariance_row(density, max(self.sizes))), lower=True)
        self.columns = [self.nuisance(i, r) for i, r in enumerate(self.runs)]
        self.q = basis(self.whiten(self.columns))

    def nuisance(self, i, run):
        """A constant for every run, slopes for all, what is known: columns of run i."""
        x = self.device.x(blocks(run.shown_degc))
        known = [] if self.known is None else [blocks(self.known[i])]
        return np.stack([*np.eye(len(self.runs))[i][:, None] * np.ones_like(x), x, x**2, x**3, *known], 1)

    def whiten(self, per_run):
        """Columns on block means, one array (n_blocks, k) per run -> stacked whitened columns."""
        return np.concatenate([solve_triangular(self.factor[:n, :n], c, lower=True, check_finite=False)
                               for n, c in zip(self.sizes, per_run)])

    def perpendicular(self, per_run):
        z = self.whiten(per_run)
        return z - self.q @ (self.q.T @ z)

    def signature(self, signals):
        """Whitened, projected signature of per-run signals at one second."""
        return self.perpendicular([blocks(s)[:, None] for s in signals])[:, 0]


def basis(design):
    """Orthonormal basis of the columns; what a profile does not move drops out."""
    scale = np.linalg.norm(design, axis=0)
    u, s, _ = np.linalg.svd(design[:, scale > 1e-9] / scale[scale > 1e-9], full_matrices=False)
    return u[:, s > 1e-6 * s[0]]


# ---- what a profile can tell -----------------------------------------------------------------------------

def each_own(columns):
    """One column per run, zero in the other runs."""
    n = len(columns)
    return [np.eye(n)[i][None, :] * c[:, None] for i, c in enumerate(columns)]


def join(*groups):
    return [np.concatenate(parts, 1) for parts in zip(*groups)]


def rivals(device, bias):
    """{library name: [per-run column groups]}, start states free, on block means."""
    temps = [blocks(r.temp_degc) for r in device.train]
    times = [blocks(r.t_s) for r in device.train]
    one = lambda make: [make(t, s)[:, None] for t, s in zip(temps, times)]
    decay = lambda tau: each_own([np.exp(-s / tau) for s in times])
    rate = lambda t, s: low_pass(np.gradient(t), 1.0)
    out = {"temperature_rate": [one(rate)], "rate_ramp": [one(lambda t, s: s / 3600)]}
    out["thermal_hysteresis"] = [
        join(one(lambda t, s: (causes.play(t, r, 0) - t) / r),
             each_own([(causes.play(t, r, 1) - causes.play(t, r, -1)) / (2 * r) for t in temps])) for r in (2, 3.5, 6, 10, 16)]
    slope = np.polynomial.polynomial.polyder(bias)
    out["thermal_lag"] = [
        join(one(lambda t, s: causes.polynomial(bias, device.x(low_pass(t, tau / BLOCK_S))) - causes.polynomial(bias, device.x(t))),
             each_own([np.exp(-s / tau) * causes.polynomial(slope, device.x(t)) for t, s in zip(temps, times)]))
        for tau in (60, 180, 500, 1200)]
    settle = {"tau_first_s": 6.0, "tau_last_s": 300.0}
    out["thermal_creep"] = [join(one(lambda t, s: causes.creep(settle, t, 0)), decay(300.0), decay(3000.0))]
    out["warm_up"] = [decay(tau) for tau in (100.0, 300.0, 1000.0)]
    lo, hi = device.t0_degc - device.range_degc, device.t0_degc + device.range_degc
    places = np.linspace(lo + 4, hi - 4, 12)
    out["thermal_anomaly"] = [one(lambda t, s: np.exp(-0.5 * ((t - c) / w) ** 2)) for c in places for w in (1.5, 4.0)]
    step = lambda c, w: one(lambda t, s: causes.step_state({"temp_degc": c, "width_degc": w}, t, -1.0))
    out["thermal_step"] = [step(c, w) for c in places for w in (0.0, 4.0)]
    legendre = lambda t, s: np.polynomial.legendre.legvander(device.x(t), 5)[:, 4:]
    out["higher_order_polynomial"] = [[legendre(t, s) for t, s in zip(temps, times)]]
    return out


def nearest(gauge, s, bias, name):
    """{"sibling": (name, rho2), "other": (name, rho2)}: nearest member of the own family and of the others."""
    energy, family = float(s @ s), causes.FAMILY_OF.get(name)
    best = {"sibling": ("none", 0.0), "other": ("none", 0.0)}
    for rival, groups in rivals(gauge.device, bias).items():
        if rival == name:
            continue
        kind = "sibling" if causes.FAMILY_OF[rival] == family else "other"
        for columns in groups:
            z = gauge.perpendicular(columns)
            if np.linalg.norm(z, axis=0).max() < 1e-9:
                continue
            share = float(np.sum((basis(z).T @ s) ** 2)) / energy
            if share > best[kind][1]:
                best[kind] = (rival, min(share, 1.0))
    return best


def left_under(device, base, signals, densities, known=None):
    """d of signals over the best of some noises (exact, by dense algebra): expected restricted likelihood, in which constants
    and slopes are free under both noises, so that slow noise pays nothing for constants it would make vary."""
    truth = Gauge(device, base.density, known)
    free = basis(np.concatenate(truth.columns, 0))
    cuts = np.cumsum(truth.sizes)[:-1]
    least = np.inf

    def deviance(g):
        q, r = np.linalg.qr(g.whiten(np.split(free, cuts)))
        per_run = np.cumsum(np.log(np.diag(g.factor)))
        return 2 * sum(per_run[n - 1] for n in g.sizes) + 2 * np.sum(np.log(np.abs(np.diag(r)))), np.split(q, cuts)

    reference = deviance(truth)[0] + sum(truth.sizes) - free.shape[1]
    for density in densities:
        g = Gauge(device, density, known)
        mix = solve_triangular(g.factor, truth.factor, lower=True, check_finite=False)
        rows, (fixed, q) = np.cumsum(np.sum(mix**2, 1)), deviance(g)
        trace = sum(rows[n - 1] - np.sum((part.T @ mix[:n, :n]) ** 2) for n, part in zip(g.sizes, q))
        s = g.signature(signals)
        least = min(least, fixed + trace + float(s @ s))
    return float(np.sqrt(max(least - reference, 0.0)))


def left_by_noise(device, base, signals, known=None):
    """d over the best re-estimated white + Markov noise (on a grid of sigma and tau)."""
    sigma, tau = base.markov[0]
    models = [noise.Noise(base.white_dph, [(sigma * grow, tau * slow), *base.markov[1:]], base.others)
              for grow in (1.0, 1.7, 3.5, 8.0) for slow in (1.0, 5.0, 40.0)]
    return left_under(device, base, signals, [m.density for m in models], known)


def periodogram(device, signals, bins=240):
    """Power of per-run signals free of constants and cubic: frequencies, mean power, number of ordinates."""
    f, power = [], []
    for run, s in zip(device.train, signals):
        e = np.vander(device.x(run.temp_degc), 4)
        rest = s - e @ np.linalg.lstsq(e, s, rcond=None)[0]
        f.append(np.arange(1, s.size // 2) / s.size)
        power.append(np.abs(np.fft.rfft(rest)[1: s.size // 2]) ** 2 / s.size)
    f, power = np.concatenate(f), np.concatenate(power)
    order, first = np.argsort(f), np.unique(np.geomspace(1, f.size, bins).astype(int)) - 1
    count = np.diff(np.append(first, f.size))
    mean = lambda v: np.add.reduceat(v[order], first) / count
    return mean(f), mean(power), count.astype(float)


def left_by_library_noise(device, base, signals, known=None):
    """d over the best noise that the library knows: found by Whittle divergence for each form, then gauged exactly."""
    f, power, weight = periodogram(device, signals)
    truth = base.density(f) + power
    return left_under(device, base, signals, [noise.closest(truth, f, weight, base, form)[1] for form in noise.FAMILY_FITS], known)


# ---- strength of noise -----------------------------------------------------------------------------------

def temperatures(device, count=40):
    """Temperatures of the training runs that stand for equal shares of time, as Tn."""
    x = np.concatenate([device.x(r.temp_degc) for r in device.train])
    return np.quantile(x, (np.arange(count) + 0.5) / count)


def local_density(cause, device, base, f):
    """Density of the whole noise at 40 temperatures: (40, f) (stationary noise: (1, f))."""
    name, p = cause["name"], cause["p"]
    if name == "noise_parameters":
        return noise.Noise(*causes.mistuned(p, base.white_dph, base.markov)).density(f)[None, :]
    if name not in ("white_noise_vs_temperature", "markov_sigma_vs_temperature", "markov_tau_vs_temperature"):
        extra = causes.added_density(cause)
        return (base.density(f) + extra(f))[None, :]
    x = temperatures(device)[:, None]
    grow = np.exp(0.5 * p["slope"] * x)
    white = base.white_dph * (grow if name.startswith("white") else 1.0)
    total = white**2 + np.zeros((x.size, f.size))
    for sigma, tau in base.markov:
        total = total + noise.markov_density(f[None, :], sigma * (grow if name.startswith("markov_sigma") else 1.0),
                                             tau * (grow**2 if name.startswith("markov_tau") else 1.0))
    return total


def of_density(truth, f, weight, base, form="nominal"):
    """d of a true density (m, f) over the best noise of a form."""
    nats, _ = noise.least_divergence(truth, f[None, :], weight[None, :] / truth.shape[0], base, form)
    return float(np.sqrt(2 * nats))


def of_outliers(p, white_dph, seconds):
    """Mixture against one Gaussian of the same variance, per sample, times samples."""
    a, s0 = p["probability"], white_dph
    s1 = np.hypot(s0, p["sigma_dph"])
    total = np.sqrt((1 - a) * s0**2 + a * s1**2)
    y = np.sinh(np.linspace(-8, 8, 20001)) / np.sinh(8) * 8 * s1
    normal = lambda s: np.exp(-0.5 * (y / s) ** 2) / (s * np.sqrt(2 * np.pi))
    mix = (1 - a) * normal(s0) + a * normal(s1)
    safe = np.maximum(mix, 1e-300)
    gain = np.trapezoid(mix * (np.log(safe) + 0.5 * (y / total) ** 2 + np.log(total * np.sqrt(2 * np.pi))), y)
    return float(np.sqrt(2 * max(gain, 0) * seconds))


def of_bursts(p, white_dph, seconds):
    """Seconds inside a burst known, against one variance for all."""
    share = min(p["_rate_per_h"] * p["_length_s"] / 3600, 0.5)
    inside = white_dph**2 + p["_size"] ** 2 * p["_dof"] / (p["_dof"] - 2)
    mean = (1 - share) * white_dph**2 + share * inside
    gain = np.log(mean) - (1 - share) * np.log(white_dph**2) - share * np.log(inside)
    return float(np.sqrt(seconds * max(gain, 0.0)))


def left_by_outliers(p, white_dph, seconds):
    """What the best outliers of the library, drawn anew every second, leave of the bursts of `of_bursts`."""
    share = min(p["_rate_per_h"] * p["_length_s"] / 3600, 0.5)
    wide = np.sqrt(white_dph**2 + p["_size"] ** 2 * p["_dof"] / (p["_dof"] - 2))
    y = np.sinh(np.linspace(-8, 8, 4001)) / np.sinh(8) * 10 * wide
    log_normal = lambda s: -0.5 * (y / s) ** 2 - np.log(s * np.sqrt(2 * np.pi))
    least = np.inf
    for a in np.geomspace(share / 10, min(3 * share, 0.9), 24):
        for s in np.geomspace(white_dph, 3 * wide, 40):
            mix = np.logaddexp(np.log1p(-a) + log_normal(white_dph), np.log(a) + log_normal(s))
            loss = sum(part * np.trapezoid(np.exp(log_normal(own)) * (log_normal(own) - mix), y)
                       for part, own in ((1 - share, white_dph), (share, wide)))
            least = min(least, loss)
    return float(np.sqrt(2 * max(least, 0.0) * seconds))


def of_run_to_run(gauge, sigma):
    columns = []
    for i, r in enumerate(gauge.runs):
        x = gauge.device.x(blocks(r.temp_degc))
        both = np.zeros((x.size, 2 * len(gauge.runs)))
        both[:, 2 * i], both[:, 2 * i + 1] = x, (x**2 - 1 / 3) / 2
        columns.append(both)
    z = gauge.perpendicular(columns)
    gain = sigma**2 * np.clip(np.linalg.eigvalsh(z.T @ z), 0, None)
    return float(np.sqrt(np.sum(gain - np.log1p(gain))))


def of_tone(amplitude_dph, frequency_hz, base, seconds):
    return float(amplitude_dph * np.sqrt(seconds / 2 / base.density(np.array([frequency_hz]))[0]))


def solve_size(strength, target, low, high, steps=18):
    """Size between low and high whose strength is the target (bisection in the logarithm)."""
    if strength(high) < target:
        raise Unreachable(f"d = {target} needs more than {high:g}")
    if strength(low) > target:
        raise Unreachable(f"d = {target} needs less than {low:g}")
    for _ in range(steps):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if strength(middle) < target else (low, middle)
    return float(np.sqrt(low * high))
