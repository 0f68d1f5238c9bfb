# SPDX-License-Identifier: MIT
"""Profiles, temperature traces and nominal models: what a test campaign is before any gap is added.

A `Group` is one campaign design: the runs' temperature traces (4 for fitting, 2 held out) and the believed
noise model.  All cases of a group share both exactly, as sensors of one production line on one chamber
programme do; `diagnose` calibrates its evidence once per group and keeps it in its cache.
"""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

FAMILIES = ("up_ramp", "up_soak", "up_only", "up_and_down", "triangle", "staircase", "mixed")
N_TRAIN, N_HOLD = 4, 2


@dataclass
class Nominal:
    """Believed noise: ARW [deg/sqrt(h)] and Markov terms [(sigma_dph, tau_s)]; normalisation of B(T)."""

    arw_deg_rt_h: float
    markov: list
    t0_degc: float
    range_degc: float
    order: int = 3

    @property
    def white_dph(self):
        return 60.0 * self.arw_deg_rt_h

    def to_json(self, bias_dph):
        return {
            "imucal_model": 1,
            "arw_deg_rt_h": self.arw_deg_rt_h,
            "markov": [{"sigma_dph": s, "tau_s": t} for s, t in self.markov],
            "turn_on_sigma_dph": 0,
            "bias": {"t0_degc": self.t0_degc, "range_degc": self.range_degc, "coeff_dph": list(bias_dph)},
        }


@dataclass
class Run:
    """One chamber run: row times, temperature at the sensor and what the thermometer shows."""

    t_s: np.ndarray
    temp_degc: np.ndarray  # true
    shown_degc: np.ndarray  # in the log
    starts_cold: bool
    aux: np.ndarray | None = None
    keep: np.ndarray = field(default=None)  # False: the row is missing in the log

    def __post_init__(self):
        if self.keep is None:
            self.keep = np.ones(self.t_s.size, bool)

    @property
    def n(self):
        return self.t_s.size


@dataclass
class Group:
    """Profiles and believed model shared by some cases."""

    name: str
    family: str
    nominal: Nominal  # what generates the noise
    believed: Nominal  # what diagnose is told
    train: list
    hold: list
    noise_known: bool = True
    lsb_degc: float = 0.0  # thermometer step (group of the thermometer cases only)
    cache: dict = field(default_factory=dict)

    def x(self, temp_degc):
        return (temp_degc - self.nominal.t0_degc) / self.nominal.range_degc


def ramp(start, points, dt=1.0):
    """Trace through (kind, value[, rate]) points: ('soak', seconds) or ('to', degc, degc_per_min)."""
    parts, now = [], start
    for point in points:
        if point[0] == "soak":
            parts.append(np.full(max(int(point[1]), 1), now))
        else:
            _, end, rate = point
            n = max(int(round(abs(end - now) / rate * 60.0 / dt)), 1)
            parts.append(now + (end - now) * np.arange(1, n + 1) / n)
            now = end
    return np.concatenate(parts)


def fit_length(start, points, seconds):
    """Repeats nothing, stretches nothing: soaks at the end (or cuts) to reach about `seconds`."""
    trace = ramp(start, points)
    if trace.size < seconds:
        trace = np.concatenate([trace, np.full(int(seconds - trace.size), trace[-1])])
    return trace


def profile_trace(family, lo, hi, seconds, rng, run_index):
    """Set temperature [degC] of one run, one value per second; random rates, soaks and starts."""
    span, minutes = hi - lo, seconds / 60.0
    cold = True
    if family == "up_only":  # with soaks and without, in turn
        family = "up_soak" if run_index % 2 else "up_ramp"
    if family == "up_ramp":
        rate = span / minutes
        return ramp(lo, [("to", hi, rate)]), True
    if family == "up_soak":
        soak = rng.uniform(0.08, 0.2) * seconds
        middle = rng.uniform(0.05, 0.15) * seconds if rng.random() < 0.5 else 0
        rate = span / ((seconds - 2 * soak - middle) / 60.0)
        mid = lo + rng.uniform(0.3, 0.7) * span
        points = [("soak", soak), ("to", mid, rate), ("soak", middle + 1), ("to", hi, rate), ("soak", soak)]
        return ramp(lo, points), True
    if family == "up_and_down":
        cold = run_index % 2 == 0
        soak = rng.uniform(0.05, 0.2) * seconds
        rate = span / ((seconds - 2 * soak) / 60.0)
        a, b = (lo, hi) if cold else (hi, lo)
        return ramp(a, [("soak", soak), ("to", b, rate), ("soak", soak)]), cold
    if family == "triangle":
        cold = rng.random() < 0.5
        a, b = (lo, hi) if cold else (hi, lo)
        ends = rng.uniform(0.02, 0.08) * seconds
        share = rng.uniform(0.3, 0.7)
        travel = (seconds - 2 * ends) / 60.0
        points = [("soak", ends), ("to", b, span / (travel * share)), ("soak", 60),
                  ("to", a, span / (travel * (1 - share))), ("soak", ends)]
        return ramp(a, points), cold
    if family == "staircase":  # the separating run of diagnosis.md section 6, half of them mirrored
        cold = run_index % 2 == 0
        steps = [("soak", 400), ("to", 1 / 3, 2), ("soak", 500), ("to", 2 / 3, 2), ("soak", 500), ("to", 1, 2),
                 ("soak", 500), ("to", 2 / 3, 1), ("soak", 500), ("to", 1 / 3, 1), ("soak", 500), ("to", 0, 1),
                 ("soak", 300)]
        place = (lambda u: lo + u * span) if cold else (lambda u: hi - u * span)
        points = [p if p[0] == "soak" else ("to", place(p[1]), p[2] * span / 60.0) for p in steps]
        return ramp(place(0.0), points), cold
    if family == "mixed":
        cold = rng.random() < 0.5
        now = lo if cold else hi
        start, points, length = now, [("soak", rng.uniform(100, 700))], 0
        while length < seconds:
            target = rng.uniform(lo, hi) if rng.random() < 0.5 else (hi if now < (lo + hi) / 2 else lo)
            rate = rng.uniform(0.5, 2.5)
            points.append(("to", target, rate))
            if rng.random() < 0.5:
                points.append(("soak", rng.uniform(100, 900)))
            now = target
            length = ramp(start, points).size
        return ramp(start, points)[: int(seconds)], cold
    raise ValueError(f"unknown profile family {family!r}")


def chamber(setpoint, rng, lag_s):
    """Air and housing follow the set temperature with inertia, and wander a little."""
    from scipy.signal import lfilter

    a = np.exp(-1.0 / lag_s)
    trace = lfilter([1 - a], [1, -a], setpoint, zi=[a * setpoint[0]])[0]
    slow = np.exp(-1.0 / 300.0)
    wander = lfilter([np.sqrt(1 - slow**2)], [1, -slow], rng.standard_normal(setpoint.size))
    return trace + 0.02 * wander


def draw_nominal(rng, lo, hi, two_markov=False):
    log_uniform = lambda a, b: float(np.exp(rng.uniform(np.log(a), np.log(b))))
    arw = log_uniform(0.25, 1.2)
    markov = [(log_uniform(0.25, 0.9) * 60 * arw, log_uniform(40, 250))]
    if two_markov:
        markov = [(markov[0][0], log_uniform(15, 40)), (0.5 * markov[0][0], log_uniform(250, 600))]
    markov = [(float(f"{s:.4g}"), float(f"{t:.4g}")) for s, t in markov]
    return Nominal(float(f"{arw:.4g}"), markov, 0.5 * (lo + hi), 0.5 * (hi - lo))


def draw_group(name, family, rng, seconds=8400.0, n_train=N_TRAIN, n_hold=N_HOLD, noise_known=True,
               two_markov=False, missing=False, aux=False, lsb_degc=0.0, standard_span=False):
    """A campaign: temperature span, runs, thermometer, noise model; fitted noise where it is not known."""
    lo, hi = (0.0, 60.0) if standard_span else (float(rng.uniform(-20, 5)), float(rng.uniform(50, 75)))
    nominal = draw_nominal(rng, lo, hi, two_markov)
    lag_s = rng.uniform(20, 90)
    runs = []
    for i in range(n_train + n_hold):
        length = seconds * rng.uniform(0.95, 1.05)
        index = i if i < n_train else i - n_train
        setpoint, cold = profile_trace(family, lo, hi, length, rng, index)
        true = np.clip(chamber(setpoint, rng, lag_s), lo, hi)
        shown = np.round(true + 0.003 * rng.standard_normal(true.size), 3)
        if lsb_degc:
            shown = lsb_degc * np.round(true / lsb_degc)
        shown = np.clip(shown, lo, hi)
        t = np.arange(true.size, dtype=float)
        run = Run(t, true, shown, cold)
        if aux:
            run.aux = np.round(5.0 + 0.1 * wandering(true.size, rng, 900.0), 4)
        if missing:
            run.keep = rng.random(true.size) > 0.001
            hole = int(rng.integers(true.size // 8, 3 * true.size // 4))
            run.keep[hole: hole + int(rng.integers(20, 90))] = False
            run.keep[[0, -1]] = True
        runs.append(run)
    group = Group(name, family, nominal, nominal, runs[:n_train], runs[n_train:], noise_known, lsb_degc)
    if not noise_known:
        from .whiten import fit_noise

        group.believed = fit_noise(group, rng)
    return group


def wandering(n, rng, tau_s):
    """Unit-variance smooth wander: an auxiliary channel such as the supply voltage."""
    from scipy.signal import lfilter

    a = np.exp(-1.0 / tau_s)
    b = np.exp(-1.0 / 30.0)
    z = lfilter([np.sqrt(1 - a * a)], [1, -a], rng.standard_normal(n + 4000))
    return lfilter([1 - b], [1, -b], z)[4000:]


def draw_bias(rng, group):
    """Thermal polynomial of one axis [dph]."""
    return rng.standard_normal(group.nominal.order + 1) * np.array([100.0, 300.0, 150.0, 100.0])


def polynomial(coeff_dph, x):
    return np.polynomial.polynomial.polyval(x, coeff_dph)
