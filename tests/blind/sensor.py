# SPDX-License-Identifier: MIT
"""Chamber, housing, sensing element and thermometer of one device: what a test campaign is before any gap.

Air follows the set point as an under-damped loop does (overshoot), with a compressor's ripple and a slow wander.
The housing follows the air; the sensing element and the thermometer each follow the housing with a time constant
of their own.  The thermometer has fresh noise in every run and a step of its own.  No thermal state is reset
between runs: the housing starts where earlier, unrecorded minutes left it.
"""
from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.signal import bilinear, lfilter, lfilter_zi

PROFILES = ("staircase", "triangle", "up_down", "mixed", "up_only", "freezer")
BEFORE_S = 1500  # unrecorded time before each run: thermal states there are never those of a fresh start


@dataclass
class Run:
    """One run.  t_s, element temperature, what the log shows [degC], rows that are kept."""

    t_s: np.ndarray
    temp_degc: np.ndarray
    shown_degc: np.ndarray
    keep: np.ndarray
    aux: np.ndarray

    @property
    def n(self):
        return self.t_s.size


@dataclass
class Device:
    """Runs for fitting, runs held out, and the normalisation of B(T)."""

    profile: str
    train: list
    hold: list
    t0_degc: float
    range_degc: float
    lsb_degc: float
    note: dict = field(default_factory=dict)

    @property
    def runs(self):
        return self.train + self.hold

    def x(self, temp_degc):
        return (temp_degc - self.t0_degc) / self.range_degc


def log_uniform(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def low_pass(signal, tau_s, start=None):
    """First-order lag; `start` is its state before the first sample (default: settled)."""
    if tau_s <= 0.05:
        return signal.copy()
    a = np.exp(-1.0 / tau_s)
    first = signal[0] if start is None else start
    return lfilter([1 - a], [1, -a], signal, zi=[a * first])[0]


def trace(start, points):
    """Set point [degC] per second through ("soak", s) and ("to", degc, degc_per_min)."""
    parts, now = [np.array([start])], start
    for point in points:
        if point[0] == "soak":
            parts.append(np.full(max(int(point[1]), 1), now))
        else:
            n = max(int(round(abs(point[1] - now) / point[2] * 60)), 1)
            parts.append(now + (point[1] - now) * np.arange(1, n + 1) / n)
            now = point[1]
    return np.concatenate(parts)


def _staircase(lo, hi, seconds, rng, mirrored):
    place = (lambda u: hi - u * (hi - lo)) if mirrored else (lambda u: lo + u * (hi - lo))
    rate = (hi - lo) / 60.0 * 8600.0 / seconds  # the advised run lasts 8600 s over 60 degC
    soak = lambda s: ("soak", s * seconds / 8600.0 * rng.uniform(0.8, 1.2))
    steps = [soak(400)]
    for u in (1 / 3, 2 / 3, 1.0):
        steps += [("to", place(u), 2 * rate), soak(500)]
    for u in (2 / 3, 1 / 3, 0.0):
        steps += [("to", place(u), rate), soak(500)]
    return trace(place(0.0), steps[:-1] + [soak(300)])


def _triangle(lo, hi, seconds, rng, mirrored):
    a, b = (hi, lo) if mirrored else (lo, hi)
    ends, share = rng.uniform(0.02, 0.1) * seconds, rng.uniform(0.35, 0.65)
    minutes = (seconds - 2 * ends) / 60
    return trace(a, [("soak", ends), ("to", b, (hi - lo) / (minutes * share)), ("soak", 90),
                     ("to", a, (hi - lo) / (minutes * (1 - share))), ("soak", ends)])


def _one_way(lo, hi, seconds, rng, mirrored):
    a, b = (hi, lo) if mirrored else (lo, hi)
    soak = rng.uniform(0.05, 0.2) * seconds
    return trace(a, [("soak", soak), ("to", b, (hi - lo) / ((seconds - 2 * soak) / 60)), ("soak", soak)])


def _mixed(lo, hi, seconds, rng, mirrored):
    now = hi if mirrored else lo
    path = trace(now, [("soak", rng.uniform(100, 600))])
    while path.size < seconds:
        middle = 0.5 * (lo + hi)
        end = float(rng.uniform(lo, hi)) if rng.random() < 0.5 else (hi if path[-1] < middle else lo)
        path = np.concatenate([path, trace(path[-1], [("to", end, rng.uniform(0.6, 2.5)),
                                                      ("soak", rng.uniform(60, 800))])])
    return path[: int(seconds)]


def _freezer(lo, hi, seconds, rng, mirrored):
    """A cold device put on the table: one exponential up (mirrored: a hot one, down)."""
    a, b = (hi, lo) if mirrored else (lo, hi)
    return b + (a - b) * np.exp(-np.arange(int(seconds)) / (seconds * rng.uniform(0.2, 0.35)))


def set_point(profile, lo, hi, seconds, rng, index):
    """Set temperature of run `index` of a profile family."""
    mirrored = index % 2 == 1 and profile not in ("up_only", "freezer")
    if profile in ("triangle", "mixed"):
        mirrored = rng.random() < 0.5
    shape = {"staircase": _staircase, "triangle": _triangle, "up_down": _one_way, "up_only": _one_way,
             "mixed": _mixed, "freezer": _freezer}[profile]
    return shape(lo, hi, seconds, rng, mirrored)


def air(target, rng, room):
    """Air of the chamber: second-order loop with overshoot, ripple and wander; `room` holds its constants."""
    w, damping = 1.0 / room["tau_s"], room["damping"]
    b, a = bilinear([w * w], [1, 2 * damping * w, w * w], 1.0)
    out = lfilter(b, a, target, zi=lfilter_zi(b, a) * target[0])[0]
    wander = room["wander_degc"] * unit_wander(target.size, rng, room["wander_tau_s"])
    phase = 2 * np.pi * (np.arange(target.size) / room["ripple_s"] + rng.random())
    return out + wander + room["ripple_degc"] * np.sin(phase)


def unit_wander(n, rng, tau_s):
    """Smooth wander of unit variance."""
    a, b = np.exp(-1.0 / tau_s), np.exp(-4.0 / tau_s)
    z = lfilter([1.0], [1, -a], rng.standard_normal(n + int(6 * tau_s)))
    z = lfilter([1 - b], [1, -b], z)[-n:]
    return z * np.sqrt(1 - a * a) / np.sqrt(0.8)


def draw_room(rng):
    return {"tau_s": log_uniform(rng, 15, 70), "damping": rng.uniform(0.4, 1.1), "wander_degc": log_uniform(rng, 0.02, 0.3),
            "wander_tau_s": rng.uniform(200, 900), "ripple_degc": log_uniform(rng, 0.005, 0.1),
            "ripple_s": rng.uniform(60, 300), "housing_tau_s": log_uniform(rng, 20, 200),
            "element_tau_s": log_uniform(rng, 1, 12), "thermometer_tau_s": log_uniform(rng, 1, 12)}


def draw_run(profile, lo, hi, seconds, rng, index, room, meter, gaps, constant=False):
    """One run: element and thermometer after the housing; the thermometer's noise is fresh."""
    length = seconds * rng.uniform(0.9, 1.1)
    target = np.full(int(length), lo) if constant else set_point(profile, lo, hi, length, rng, index)
    before = np.full(BEFORE_S, target[0]) + (0 if constant else rng.normal(0, 4)) * np.exp(-np.arange(BEFORE_S) / 800.0)
    quiet = {**room, "wander_degc": 0.0, "ripple_degc": 0.0} if constant else room
    housing = low_pass(air(np.concatenate([before, target]), rng, quiet), room["housing_tau_s"])
    element = low_pass(housing, room["element_tau_s"])[BEFORE_S:]
    seen = low_pass(housing, room["thermometer_tau_s"])[BEFORE_S:]
    shown = seen + meter["noise_degc"] * rng.standard_normal(seen.size)
    shown = np.round(np.round(shown / meter["lsb_degc"]) * meter["lsb_degc"], 4)
    if constant:
        element, shown = np.full(seen.size, lo), np.full(seen.size, lo)
    return Run(np.arange(seen.size, dtype=float), element, shown, kept_rows(seen.size, rng, gaps),
               5.0 + 0.1 * unit_wander(seen.size, rng, 900.0))


def kept_rows(n, rng, gaps):
    keep = np.ones(n, bool)
    if gaps:
        keep = rng.random(n) > 0.001
        hole = int(rng.integers(n // 8, 3 * n // 4))
        keep[hole: hole + int(rng.integers(20, 120))] = False
    keep[[0, -1]] = True
    return keep


def draw_meter(rng):
    """Step and noise of the thermometer; one in six is coarse."""
    if rng.random() < 1 / 6:
        return {"lsb_degc": float(rng.choice([0.25, 0.5])), "noise_degc": log_uniform(rng, 0.02, 0.2)}
    return {"lsb_degc": float(rng.choice([0.001, 0.01, 0.0625])), "noise_degc": log_uniform(rng, 0.002, 0.04)}


def draw_device(rng, n_train, n_hold, profile=None, seconds=None, constant=False, lsb_degc=None):
    """A device's campaign; all is drawn, nothing is shared between cases."""
    profile = profile or str(rng.choice(PROFILES, p=[0.25, 0.2, 0.2, 0.2, 0.08, 0.07]))
    lo, hi = float(rng.uniform(-25, 5)), float(rng.uniform(45, 75))
    if constant:
        lo = hi = float(np.round(rng.uniform(15, 45), 2))
    seconds = seconds or float(rng.uniform(5000, 9000))
    room, meter, gaps = draw_room(rng), draw_meter(rng), rng.random() < 0.25
    if lsb_degc:
        meter = {"lsb_degc": float(f"{lsb_degc:.2f}"), "noise_degc": 0.01}
    runs = [draw_run(profile, lo, hi, seconds, rng, i if i < n_train else i - n_train, room, meter, gaps, constant)
            for i in range(n_train + n_hold)]
    low = min(r.shown_degc.min() for r in runs) - 0.5
    high = max(r.shown_degc.max() for r in runs) + 0.5
    t0, half = (lo, 10.0) if constant else (0.5 * (low + high), 0.5 * (high - low))
    return Device("constant" if constant else profile, runs[:n_train], runs[n_train:], float(f"{t0:.3f}"),
                  float(f"{half:.3f}"), meter["lsb_degc"], {"room": room, "meter": meter, "gaps": bool(gaps)})
