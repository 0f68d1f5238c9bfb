# SPDX-License-Identifier: MIT
"""Chambers as they go: -40 to 85, -55 to 125, cold only, hot only, and 8 to 12 degC in all; with models of any range, and none.

A device has 1 to 4 fitted logs of 75 to 160 min, a row a second, and 0 to 2 held-out ones.  The chamber goes by ramps of 0.5 to
4 degC/min with rests of 2 to 25 min, some shot over by up to 2 % of the range, from either end or from within; the body
follows by 50 to 150 s and is up to 3 % of the range off at first.  The fitted logs cover 80 % of the range or more.  The
thermometer has a noise of 0.005 to 0.02 degC.  Drawn are white noise (10 to 50 dph in a second), one first-order process (3 to 12
dph, 40 to 250 s), a cubic of the temperature and a constant for every log.  Believed is in turn: a model with the true noise
whose bias has the t0 and range of the chamber (exact), 0.2 to 0.5 of its range (narrow), 2 to 5 times it (wide), a t0 that is 2
to 6 half ranges off (far), no bias at all; a data sheet (figures wrong by up to 1.5).  Every device of the long form is asked
again with nothing believed (none).

Even numbers have no cause, odd ones in turn: bump (Gaussian, 2 to 6 % of the range wide, 3 % from an end or more; two of three
within 12 % of an end), curve (powers 4 and 5), jump (relay 5 to 15 % from an end, band 0 to 3 %, three switches or more), play
(3 to 15 degC from side to side), relays (20 to 40, bands of 3 to 15 degC; in 8 to 12 degC loops are at most 0.6 of that), lag
(100 to 600 s), rate, warm (a warm-up of 100 to 1200 s in every log), loud (white noise that grows with temperature).  Loops and
lags begin anywhere.  Strength d, 15 to 40, is the norm of what the cause adds to the fitted logs, in means of 5 s whitened by the
true noise, after constants, a common cubic of the true temperature and, of loops and lags, the start state of every log.  Of
loud it is sqrt(2 gain), Whittle's divergence from the constant noise that comes nearest.  Drawn again are devices of which one of
the others (rate, ramp, powers 4 and 5, lags, plays, warm-ups, jumps, bumps up to 0.1 of the range; loops and lags with free
start states) leaves less than d 6.

Right: the first name that is no noise is the cause's or its family's (CAUSES; of relays thermal_hysteresis or thermal_memory),
and no other one is no noise (of relays none outside thermal_memory).  loud: white_noise_vs_temperature or fast_noise is the first
name beside noise_parameters, and all others are noise.  No cause: nothing but noise_parameters, and the verdict is not
"unexplained".
Changed: with and without belief the first causes have different names, or, where one is told by its family, other families.
Interval: the true shrinkage is that of the noise-free mean of held-out logs in minutes, at fitted temperatures, constants and
start states free: what the told parameters and the cubic that the fitted logs then have leave of what the cubic alone leaves.
Without held-out logs each is left out in turn, and size and cubic are learnt from the others.  It must lie within 0.02 of the
interval, 9 times in 10.  Not asked where none is claimed or what is told has no shape here.

Counts, chosen before the first run: short form, 24 devices asked once, by turns with belief and without: at most 1 wrong name and
1 missed interval.  Long form, 180 devices asked twice (180 answers with a cause, 180 without): of the healthy at most 5 wrong (a
program of the stated 1 % fails 1 time in 100), of the others 18, of 180 changes 9, of intervals a tenth.
First run, 28 November 2026: short 1 wrong (healthy, refused), long 2 of 180 healthy (refused), 25 of 180 with a cause (16 of 20
answers to relays, 9 of 20 to curves, none of the 140 others), 3 changed (2 of them refused), no interval of 121 missed (none of
7 in the short form; without the 0.02 21 of 128 miss, by 0.012 at most).  The long form failed by its limit of 18.  The refused
were a fault of this file: a t0 below -300 degC, which no model may have.  It stays above absolute zero since; seeds, limits and
logs are as they were.  The curves were a fault of the program: powers 4 and 5 were sized in the believed bias' units (30 and 30
degC without one), and where these do not fit the logs they were lost to a bump, or told with parameters that were up to 140 of
their standard errors off.  The last test asks just that; it was written after the first run, with other devices.  The program was
then mended: 16 of 180 with a cause are wrong, all relays, no healthy one of 180, 1 of 124 intervals missed.  Of the eight
relays that were wrong, in six a free function of temperature gains two to eighty times what a play does, so few relays are
stairs; four of the eight were left open ("unexplained"), which is no false name.  Another draw of the long form (SEED + 1, made
once before the mending): 5 of 180 healthy wrong (4 devices), 22 with a cause (relays 16, curves 6), 2 changed, 4 of 123
intervals missed.

    python tests/system/test_wide_temperatures_independent.py [DIAGNOSE [FOLDER]]    counts, and keeps the wrong ones' logs"""
import json
import math
import shutil
import sys
import tempfile
from collections import Counter
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

from asking import DIAGNOSE, axis_of, found, run, write_log

SEED, STEP_S, LEAST_LEFT, INTERVAL_SLACK = 20360822, 5, 6, 0.02
RANGES = {"room": (-40, 85), "wide": (-55, 125), "cold": (-40, 0), "hot": (40, 105), "narrow": None}
BELIEFS = ["exact", "narrow", "wide", "far", "no bias", "data sheet"]
CAUSES = {"bump": ("thermal_anomaly", "function_of_temperature"), "curve": ("higher_order_polynomial", "function_of_temperature"),
          "jump": ("thermal_step", "function_of_temperature"), "play": ("thermal_hysteresis", "thermal_memory"),
          "relays": ("thermal_hysteresis", "thermal_memory"), "lag": ("thermal_lag", "thermal_memory"),
          "rate": ("temperature_rate", "thermal_memory"), "warm": ("warm_up", "function_of_time"),
          "loud": ("white_noise_vs_temperature", "fast_noise")}
NOISE, ABSOLUTE_ZERO = {"slow_noise", "fast_noise"}, -273.0


# ---- physics


def recursion(x, a, start=0.0):
    """y[t] = a y[t-1] + x[t] for every column of x, y[-1] = start."""
    n, size = len(x), 64
    columns = np.reshape(x, (n, -1))
    blocks = np.vstack([columns, np.zeros((-n % size, columns.shape[1]))]).reshape(-1, size, columns.shape[1])
    away = np.subtract.outer(np.arange(size), np.arange(size))
    y, fade, last = np.where(away >= 0, a ** np.maximum(away, 0), 0) @ blocks, a ** np.arange(1, size + 1)[:, None], start
    for block in y:
        block += fade * last
        last = block[-1]
    return y.reshape(-1, columns.shape[1])[:n].reshape(np.shape(x))


def follows(x, tau_s, start):
    """Newton cooling: where a body is that begins at `start` and is warmed by x."""
    phi = math.exp(-1 / tau_s)
    return recursion((1 - phi) * x, phi, start)


def play(degc, width, share):
    """A play of this half-width; share -1 to 1 says where in it the log begins."""
    at, out = degc[0] + share * width, np.empty(len(degc))
    for i, t in enumerate(degc.tolist()):
        at = min(max(at, t - width), t + width)
        out[i] = at
    return out


def relay(degc, up, band, begins_on):
    """1 where it is on; `begins_on` counts where the log begins inside the band."""
    inside = (degc <= up) & (degc >= up - band)
    state = np.where(inside, begins_on, degc > up)
    return 1.0 * state[np.maximum.accumulate(np.where(inside, 0, np.arange(len(degc))))]


def bump(degc, center, width):
    return np.exp(-0.5 * ((degc - center) / width) ** 2)


def degc_per_min(degc):
    return 60 * np.gradient(degc)


def chamber(rng, n, ends):
    """The body of a device in a chamber: ramps, some shot over, and rests between, from an end or from within."""
    span = ends[1] - ends[0]
    rate = math.exp(rng.uniform(math.log(max(0.5, span / 60)), math.log(4)))
    level = rng.choice([ends[0], ends[1], rng.uniform(*ends)])
    goes_up = int(rng.random() < 0.5 if ends[0] < level < ends[1] else level == ends[0])
    t, at = 0.0, [(0, level)]
    while t < n:
        t += rng.uniform(120, 1500)
        at.append((t, level))
        goal = ends[goes_up] if rng.random() < 0.65 else level + rng.uniform(0.4, 0.9) * (ends[goes_up] - level)
        speed, over = min(max(rate * rng.uniform(0.7, 1.4), 0.5), 4) / 60, rng.choice([0, rng.uniform(0.005, 0.02) * span])
        t += (abs(goal - level) + over) / speed
        level = goal
        at.append((t, level + over * (1 if goes_up else -1)))
        t += rng.uniform(100, 300)
        at.append((t, level))
        goes_up = 1 - goes_up
    air = np.interp(np.arange(n) + 0.5, *zip(*at))
    return follows(air, rng.uniform(50, 150), air[0] + rng.uniform(-0.03, 0.03) * span)


# ---- devices


class Device:
    """kind: a cause or "nothing".  Lists of one array a log: `degc`, `effect`; `held` are the places of held-out logs."""

    def __init__(self, kind, chamber_range, number):
        self.kind, self.range, self.number, attempt = kind, chamber_range, number, 0
        self.belief, is_drawn = BELIEFS[(number + number // 18) % len(BELIEFS)], False
        while not is_drawn:
            self.rng, attempt = np.random.default_rng([SEED, number, attempt]), attempt + 1
            is_drawn = self.is_drawn()
        self.note = (f"{kind} in {chamber_range} {self.cold:.0f}:{self.hot:.0f} degC, {self.n_fitted} of {len(self.degc)} logs "
                     f"fitted, white, process {np.round(self.own, 1)}, {self.what}")

    def is_drawn(self):
        """False where it has to be drawn again."""
        rng = self.rng
        self.n_fitted, n_held = int(rng.integers(1, 5)), int(rng.integers(0, 3))
        if self.range == "narrow":
            cold = rng.uniform(-40, 73)
            self.ends = cold, cold + rng.uniform(8, 12)
        else:
            self.ends = RANGES[self.range]
        half, middle = np.diff(self.ends)[0] / 2, np.mean(self.ends)
        lengths = rng.integers(4500, 7001, self.n_fitted + n_held) + (2500 if half > 50 else 0)
        self.degc = [chamber(rng, n, self.ends) for n in lengths]
        fitted = np.concatenate(self.degc[:self.n_fitted])
        self.cold, self.hot = fitted.min(), fitted.max()
        if self.hot - self.cold < 0.8 * 2 * half:
            return False
        self.own = rng.uniform(10, 50), rng.uniform(3, 12), math.exp(rng.uniform(*np.log([40, 250])))
        self.cubic = np.polynomial.Polynomial(rng.normal(0, [0, 250, 120, 60]), [middle - half, middle + half])
        self.constants, self.blur = rng.normal(0, 30, len(lengths)), rng.uniform(0.005, 0.02)
        self.d, self.what, self.slope = rng.uniform(15, 40), "", 0
        self.effect = [np.zeros(n) for n in lengths]
        if self.kind == "nothing":
            return True
        if self.kind == "loud":
            return self.is_loud_drawn()
        self.starts = []  # of every log columns that say where it begins
        unit = getattr(self, f"draw_{self.kind}")()
        if unit is None:
            return False
        return self.is_sized(unit)

    def draw_bump(self):
        span = self.hot - self.cold
        place = self.rng.choice([self.rng.uniform(0.03, 0.12), self.rng.uniform(0.88, 0.97), self.rng.uniform(0.12, 0.88)])
        center, width = self.cold + place * span, min(span * self.rng.uniform(0.02, 0.06), 8)
        self.what = f"center {center:.1f} width {width:.2f} degC"
        return [bump(t, center, width) for t in self.degc]

    def draw_curve(self):
        p4, p5 = self.rng.normal(0, 1, 2)
        self.curve = np.polynomial.Legendre([0, 0, 0, 0, p4, p5], [self.cold, self.hot])
        self.what = f"P4 {p4:+.2f} P5 {p5:+.2f} times the size"
        return [self.curve(t) for t in self.degc]

    def draw_jump(self):
        """Near an end; three switches or more, and one of either way."""
        span, edge = self.hot - self.cold, self.rng.uniform(0.05, 0.15)
        up = self.cold + span * self.rng.choice([edge, 1 - edge])
        band = self.rng.choice([0, self.rng.uniform(0.005, 0.03) * span])
        self.what, on = f"up {up:.1f} band {band:.2f} degC", self.rng.integers(0, 2, len(self.degc))
        out = [relay(t, up, band, o) for t, o in zip(self.degc, on)]
        ways = [sum(np.sum(np.diff(s) == way) for s in out[:self.n_fitted]) for way in (1, -1)]
        return out if sum(ways) >= 3 and min(ways) >= 1 else None

    def loop_width(self):
        return self.rng.uniform(3, min(15, 0.6 * (self.hot - self.cold)))

    def draw_play(self):
        width = self.loop_width() / 2
        self.what = f"half-width {width:.2f} degC"
        self.starts = [[play(t, width, 1) - play(t, width, -1)] for t in self.degc]
        return [(play(t, width, s) - t) / width for t, s in zip(self.degc, self.rng.uniform(-1, 1, len(self.degc)))]

    def draw_relays(self):
        rng, widest, span = self.rng, self.loop_width(), self.hot - self.cold
        bands = rng.uniform(max(3, widest / 3), max(3.01, widest), rng.integers(20, 41))
        ups = rng.uniform(self.cold - 0.05 * span, self.hot + 0.05 * span, len(bands)) + bands / 2
        self.what = f"{len(bands)} relays of {bands.min():.1f} to {bands.max():.1f} degC"

        def total(t, share):
            return np.mean([relay(t, u, b, t[0] + share * b / 2 > u - b / 2) for u, b in zip(ups, bands)], axis=0)
        self.starts = [[total(t, 1) - total(t, -1)] for t in self.degc]
        return [total(t, s) for t, s in zip(self.degc, rng.uniform(-1, 1, len(self.degc)))]

    def draw_lag(self):
        tau_s, off = self.rng.uniform(100, 600), 0.05 * (self.hot - self.cold)
        self.what = f"tau {tau_s:.0f} s"
        self.starts = [[np.exp(-np.arange(len(t)) / tau_s)] for t in self.degc]
        return [self.cubic(follows(t, tau_s, t[0] + self.rng.uniform(-off, off))) - self.cubic(t) for t in self.degc]

    def draw_rate(self):
        return [degc_per_min(t) for t in self.degc]

    def draw_warm(self):
        tau_s = math.exp(self.rng.uniform(*np.log([100, 1200])))
        self.what = f"tau {tau_s:.0f} s"
        return [np.exp(-np.arange(len(t)) / tau_s) for t in self.degc]

    def is_sized(self, unit):
        fitted, others = self.degc[:self.n_fitted], self.others()
        columns = [[u] for u in unit[:self.n_fitted]]
        d, left = strength(self.own, fitted, columns, self.starts, others)
        size = self.rng.choice([-1, 1]) * self.d / d
        if self.kind == "lag":
            size = abs(size)
            self.cubic *= size
        if self.kind == "curve":
            self.curve *= size
        self.effect = [size * u for u in unit]
        self.what += f", size {size:.3g}, d {self.d:.1f}, left by {min(left, key=left.get)} {abs(size) * min(left.values()):.1f}"
        return abs(size) * min(left.values()) >= LEAST_LEFT

    def others(self):
        """What else could be taken for the cause: {name: of every fitted log its columns}."""
        fitted, span = self.degc[:self.n_fitted], self.hot - self.cold
        out = {"rate": [[degc_per_min(t)] for t in fitted], "ramp": [[np.arange(len(t)) / 3600] for t in fitted],
               "curve": [[((t - self.cold) / span * 2 - 1) ** p for p in (4, 5)] for t in fitted]}
        for tau_s in (60, 150, 300, 600, 1200):
            fades = [np.exp(-np.arange(len(t)) / tau_s) for t in fitted]
            out[f"warm {tau_s}"] = [[f] for f in fades]
            lagged = [(follows(t, tau_s, t[0]) - self.cold) / span * 2 - 1 for t in fitted]
            out[f"lag {tau_s}"] = [[x, x ** 2, x ** 3] + own_columns(f, i, fitted) * (self.kind != "warm")
                                   for i, (x, f) in enumerate(zip(lagged, fades))]
        for width in (1, 2, 4, 8):
            if width < 0.4 * span:
                ways = [[play(t, width, s) for s in (1, -1)] for t in fitted]
                out[f"play {width}"] = [[a - t] + own_columns(a - b, i, fitted)
                                        for i, (t, (a, b)) in enumerate(zip(fitted, ways))]
        for place in np.arange(0.02, 1, 0.04):
            at = self.cold + place * span
            out[f"jump {at:.1f}"] = [[1.0 * (t > at)] for t in fitted]
            for width in (0.02, 0.05, 0.1):
                out[f"bump {at:.1f} {width * span:.1f}"] = [[bump(t, at, width * span)] for t in fitted]
        own = {"relays": "play"}.get(self.kind, self.kind)
        return {name: columns for name, columns in out.items() if name.split()[0] != own}

    def is_loud_drawn(self):
        """The slope of the log-variance of the white noise from the coldest to the middle; it grows with temperature."""
        middle, half = (self.cold + self.hot) / 2, (self.hot - self.cold) / 2
        x, (white, sigma, tau_s) = [(t - middle) / half for t in self.degc], self.own
        low, high = 0.0, 4.0
        for _ in range(30):
            slope = (low + high) / 2
            is_weak = loud_strength(x[:self.n_fitted], white, sigma, tau_s, slope) < self.d
            low, high = (slope, high) if is_weak else (low, slope)
        self.slope, self.what = slope, f"log-variance slope {slope:.2f} of half the range, d {self.d:.1f}"
        self.loudness = [np.exp(slope * v / 2) for v in x]
        return slope < 3

    def noise(self, i):
        white, sigma, tau_s = self.own
        n, phi = len(self.degc[i]), math.exp(-1 / tau_s)
        drive = sigma * self.rng.standard_normal(n) * np.append(1, np.full(n - 1, math.sqrt(1 - phi ** 2)))
        return white * (self.loudness[i] if self.slope else 1) * self.rng.standard_normal(n) + recursion(drive, phi)

    def mean(self, i):
        return self.cubic(self.degc[i]) + self.effect[i]

    @cached_property
    def rates(self):
        return [self.mean(i) + self.constants[i] + self.noise(i) for i in range(len(self.degc))]

    def written(self, folder):
        """The logs as files, the fitted ones and the held-out ones."""
        paths = [folder / f"{i}.csv" for i in range(len(self.degc))]
        for path, degc, rate in zip(paths, self.degc, self.rates):
            write_log(path, np.arange(1, len(degc) + 1), degc + self.blur * self.rng.standard_normal(len(degc)), rate)
        return paths[:self.n_fitted], paths[self.n_fitted:]

    def options(self, folder):
        """What is believed: t0 and range of the bias, None without one (then 30 and 30 degC), and the command's options."""
        (white, sigma, tau_s), rng = self.own, np.random.default_rng([SEED, self.number, 1000])
        middle, half = np.mean(self.ends), np.diff(self.ends)[0] / 2
        if self.belief == "data sheet":
            arw, sigma, tau_s = np.array([white / 60, sigma, tau_s]) * np.exp(rng.uniform(-math.log(1.5), math.log(1.5), 3))
            return (30, 30), ["--arw", f"{arw:.3f}", "--instability", f"{sigma:.2f}:{tau_s:.1f}"]
        inside = middle + half * rng.uniform(-0.9, 0.9)
        t0, width = {"exact": (middle, half), "narrow": (inside, half * rng.uniform(0.2, 0.5)), "no bias": (30, 30),
                     "wide": (inside, half * rng.uniform(2, 5)),
                     "far": (middle + half * rng.choice([-1, 1]) * rng.uniform(2, 6), half * rng.uniform(0.5, 1.5))}[self.belief]
        t0 = max(t0, ABSOLUTE_ZERO)  # since the first run
        model = {"imucal_model": 1, "arw_deg_rt_h": white / 60, "markov": [{"sigma_dph": sigma, "tau_s": tau_s}]}
        if self.belief != "no bias":
            coeff = self.cubic.convert(domain=[t0 - width, t0 + width]).coef
            model["bias"] = {"t0_degc": t0, "range_degc": width, "coeff_dph": [float(c) for c in coeff]}
        (folder / "model.json").write_text(json.dumps(model))
        return (t0, width), ["--model", folder / "model.json"]


def own_columns(column, i, logs):
    """One column a log: nothing but in its own."""
    return [column * (k == i) for k in range(len(logs))]


# ---- strengths


def whitened(own, logs, step_s=STEP_S):
    """Columns of every log as means of `step_s`, by the steady filter of white noise and a first-order process."""
    (white, sigma, tau_s), out = own, []
    white, phi = white / math.sqrt(step_s), math.exp(-step_s / tau_s)
    b = (sigma ** 2 * (1 - phi ** 2) / white ** 2 + 1 + phi ** 2) / (2 * phi)
    theta = b - math.sqrt(b * b - 1)
    for columns in logs:
        x = np.column_stack(columns)
        x = x[:len(x) // step_s * step_s].reshape(-1, step_s, x.shape[1]).mean(axis=1)
        out.append(recursion(x - phi * np.vstack([np.zeros(x.shape[1]), x[:-1]]), theta) / (white * math.sqrt(phi / theta)))
    return np.vstack(out)


def powers(degc, middle=0.0, half=1.0):
    x = (degc - middle) / half
    return [x, x ** 2, x ** 3]


def strength(own, fitted, effect, starts, others):
    """d of the effect beside constants, cubic and its own start states, and what each of the others leaves of it."""
    cold, hot = (f(np.concatenate(fitted)) for f in (np.min, np.max))
    nuisance = [powers(t, (cold + hot) / 2, (hot - cold) / 2) + own_columns(np.ones(len(t)), i, fitted)
                for i, t in enumerate(fitted)]
    own_starts = [own_columns(s[0], i, fitted) for i, s in enumerate(starts[:len(fitted)])] or [[] for _ in fitted]
    parts = [effect, nuisance, own_starts, *others.values()]
    x = whitened(own, [sum((part[i] for part in parts), []) for i in range(len(fitted))])
    ends = np.cumsum([0, *(len(part[0]) for part in parts)])
    x[:, 1:] /= np.maximum(np.linalg.norm(x[:, 1:], axis=0), 1e-12)
    gram = x.T @ x

    def left(places):
        a, b = gram[np.ix_(places, places)], gram[places, 0]
        return math.sqrt(max(gram[0, 0] - b @ np.linalg.lstsq(a, b, rcond=1e-10)[0], 0))
    base = list(range(1, ends[3]))
    return left(base), {name: left(base + list(range(a, b))) for name, a, b in zip(others, ends[3:], ends[4:])}


def loud_strength(x, white, sigma, tau_s, slope):
    """sqrt(2 gain) by Whittle's divergence, local in temperature, from the constant noise that comes nearest."""
    share, edges = np.histogram(np.concatenate(x), 40)
    f = (np.arange(200) + 0.5) / 400
    phi, share = math.exp(-1 / tau_s), share / share.sum()
    slow = sigma ** 2 * (1 - phi ** 2) / (1 + phi ** 2 - 2 * phi * np.cos(2 * np.pi * f))
    s = white ** 2 * np.exp(slope * (edges[1:] + edges[:-1]) / 2)[:, None] + slow
    gain = sum(map(len, x)) * np.mean(np.log(share @ s) - share @ np.log(s)) / 2
    return math.sqrt(2 * gain)


# ---- the shrinkage that is true


def told_shape(effect, degc, t0_range):
    """(what is added, columns that say where the log begins, lag in s) of a told cause; None where it cannot be drawn."""
    p, name = effect["parameters"], effect["name"]
    name = effect["set"][0]["name"] if name.startswith(("thermal_memory", "function_of")) and effect["set"] else name
    try:
        if name == "thermal_anomaly":
            return p["amplitude_dph"] * bump(degc, p["center_degc"], p["width_degc"]), [], 0
        if name == "thermal_step":
            on, off = (relay(degc, p["temp_degc"], p["width_degc"], s) for s in (1, 0))
            return p["amplitude_dph"] * off, [on - off] if np.any(on != off) else [], 0
        if name == "higher_order_polynomial":
            x = (degc - t0_range[0]) / t0_range[1]
            return np.polynomial.legendre.legval(x, [0, 0, 0, 0, p["p4_dph"], p["p5_dph"]]), [], 0
        if name == "thermal_hysteresis":
            warm, cold = (play(degc, p["width_degc"], s) for s in (1, -1))
            return p["amplitude_dph"] * ((warm + cold) / 2 - degc) / p["width_degc"], [warm - cold], 0
        if name == "temperature_rate":
            return p["k_dph_per_degc_min"] * degc_per_min(degc), [], 0
        if name == "warm_up":
            return p["amplitude_dph"] * np.exp(-np.arange(len(degc)) / p["tau_s"]), [], 0
        if name == "thermal_lag" and p["tau_s"] > 0:
            return 0 * degc, [np.exp(-np.arange(len(degc)) / p["tau_s"])], p["tau_s"]
    except KeyError:
        pass
    return None


def left_of_mean(d, told, learn, judge, is_sized_anew):
    """Squares of what is left of the true mean of the judged logs in minutes, the cubic (and size) from the learnt ones as
    measured."""
    middle, half = (d.cold + d.hot) / 2, (d.hot - d.cold) / 2
    added, starts, lag = zip(*told)
    moved = [follows(t, tau, t[0]) if tau else t for t, tau in zip(d.degc, lag)]
    free = [(i, column) for i in learn for column in [np.ones(len(d.degc[i])), *starts[i]]]
    own = [[*powers(moved[i], middle, half), added[i]] for i in range(len(d.degc))]
    logs = [[d.rates[i], *own[i], *(c if k == i else np.zeros(len(d.degc[i])) for k, c in free)] for i in learn]
    x = whitened(d.own, logs)
    sizes = np.append(np.zeros(3), 1.0)
    if is_sized_anew:
        sizes = np.linalg.lstsq(x[:, 1:], x[:, 0], rcond=1e-9)[0][:4]
    else:
        sizes[:3] = np.linalg.lstsq(np.delete(x[:, 1:], 3, axis=1), x[:, 0] - x[:, 4], rcond=1e-9)[0][:3]
    seen, total = np.concatenate([d.degc[i] for i in learn]), 0.0
    for i in judge:
        n, rest = len(d.degc[i]) // 60 * 60, d.mean(i) - np.column_stack(own[i]) @ sizes
        columns = np.column_stack([rest, np.ones(len(rest)), *starts[i], d.degc[i]])[:n].reshape(n // 60, 60, -1).mean(axis=1)
        columns = columns[(columns[:, -1] >= seen.min()) & (columns[:, -1] <= seen.max())]
        if len(columns) > 10:
            y, rows = columns[:, 0], columns[:, 1:-1]
            total += np.sum((y - rows @ np.linalg.lstsq(rows, y, rcond=1e-9)[0]) ** 2)
    return total


def true_shrinkage(d, axis, t0_range):
    """None where it cannot be worked out: no other log, or a told cause that has no shape here."""
    mean = [e for e in axis["effects"] if e["family"] not in NOISE]
    shapes = [[told_shape(e, t, t0_range) for e in mean] for t in d.degc]
    n, all_logs = d.n_fitted, range(len(d.degc))
    if not mean or None in sum(shapes, []) or len(d.degc) < 2:
        return None
    told = [(sum(s[0] for s in of_log), sum((s[1] for s in of_log), []), max(s[2] for s in of_log)) for of_log in shapes]
    nothing = [(0 * t, [], 0) for t in d.degc]
    has_held_out = len(d.degc) > n
    folds = [(list(range(n)), list(all_logs[n:]))] if has_held_out else [([k for k in range(n) if k != i], [i]) for i in range(n)]
    before, after = (sum(left_of_mean(d, what, *fold, not has_held_out) for fold in folds) for what in (nothing, told))
    return 1 - after / before if before > 0 else None


# ---- answers


def causes(axis):
    return [e for e in axis["effects"] if e["name"] != "noise_parameters"]


def is_right(kind, axis):
    """As the text above says."""
    if isinstance(axis, str):
        return False
    if kind == "nothing":
        return not causes(axis) and axis["verdict"] != "unexplained"
    mean = [e for e in axis["effects"] if e["family"] not in NOISE]
    if kind == "loud":
        return not mean and bool(causes(axis)) and causes(axis)[0]["name"] in CAUSES[kind]
    if not mean or mean[0]["name"] not in CAUSES[kind]:
        return False
    return all(e["family"] == "thermal_memory" for e in mean) if kind == "relays" else len(mean) == 1


def first_cause(axis):
    if isinstance(axis, str):
        return "refused", "refused"
    found_here = [e for e in causes(axis) if e["family"] not in NOISE] or causes(axis)
    return (found_here[0]["name"], found_here[0]["family"]) if found_here else ("", "")


def is_same(one, other):
    """The same name; or, where one of the two is told by its family, the same family."""
    a, b = first_cause(one), first_cause(other)
    return a[0] == b[0] or a[1] == b[1] and (a[0] == a[1] or b[0] == b[1])


def in_interval(d, axis, t0_range):
    """(true, claimed, interval) and whether the one lies in the other; None where it is not claimed or not known."""
    gap = (isinstance(axis, dict) and axis["gap"]) or {}
    true = true_shrinkage(d, axis, t0_range) if gap.get("ci95") and gap.get("shrinkage") is not None else None
    if true is None:
        return None
    low, high = gap["ci95"]
    return bool(low - INTERVAL_SLACK <= true <= high + INTERVAL_SLACK), (round(float(true), 3), gap["shrinkage"], gap["ci95"])


def ask(folder, device, beliefs, program):
    """{belief: (axis or why there is none, the interval, the command)}; beliefs: "told" and "none"."""
    d, out = device, {}
    fitted, held_out = d.written(folder)
    for belief in beliefs:
        t0_range, options = d.options(folder) if belief == "told" else ((30, 30), [])
        done, command = run(program, options, fitted, held_out)
        axis = axis_of(done)
        out[belief] = axis, in_interval(d, axis, t0_range), command
        said = axis if isinstance(axis, str) else (axis["verdict"], axis["title"], found(axis))
        print(f"{d.kind}{d.number} {d.belief if belief == 'told' else 'none'}:", d.note, "|", said, out[belief][1])
    return out


def devices(numbers):
    """Odd numbers have a cause, even ones none; ranges in turn."""
    kinds, ranges = list(CAUSES), list(RANGES)
    for k in numbers:
        place = k // 2
        yield (kinds[place % 9] if k % 2 else "nothing"), ranges[(place + place // 45) % 5], k


def counts(folder, numbers, both, program=DIAGNOSE, keep=None):
    """Wrong names, changed causes and missed intervals: lists of what was asked, and how often each was asked."""
    wrong, asked = {"name": [], "changed": [], "interval": []}, Counter()
    for kind, chamber_range, k in devices(numbers):
        at = folder / f"{kind}{k}"
        at.mkdir()
        d = Device(kind, chamber_range, k)
        answers, bad = ask(at, d, ["told", "none"] if both else [["told", "none"][k // 2 % 2]], program), []
        for belief, (axis, interval, command) in answers.items():
            told = d.belief if belief == "told" else "none"
            bad += [("name", told, command)] if not is_right(kind, axis) else []
            bad += [("interval", told, command)] if interval and not interval[0] else []
            asked.update([("name", kind), ("range", chamber_range, kind != "nothing"), ("belief", told, kind != "nothing")])
            asked.update(["interval"] if interval else [])
        if both:
            asked.update(["changed"])
            same = is_same(*(answers[b][0] for b in ("told", "none")))
            bad += [] if same else [("changed", d.belief, answers["told"][2])]
        for what, told, _ in bad:
            wrong[what].append((kind, chamber_range, k, told))
        if bad and keep:
            shutil.copytree(at, keep / at.name, dirs_exist_ok=True)
            (keep / at.name / "COMMANDS").write_text(d.note + "\n" + "".join(
                f"# {what}, believed: {told}\n{command.replace(str(at), str(keep / at.name))}\n" for what, told, command in bad))
            print("WRONG", at.name, [b[:2] for b in bad], flush=True)
        shutil.rmtree(at)
    return wrong, asked


SHORT, LONG = range(24), range(24, 204)


def test_causes_in_chambers_as_they_go(tmp_path):
    wrong, asked = counts(tmp_path, SHORT, both=False)
    assert len(wrong["name"]) <= 1 and len(wrong["interval"]) <= 1, (wrong, asked)


@pytest.mark.long
def test_many_causes_in_chambers_as_they_go_with_and_without_a_model(tmp_path):
    wrong, asked = counts(tmp_path, LONG, both=True)
    healthy = [w for w in wrong["name"] if w[0] == "nothing"]
    assert len(healthy) <= 5 and len(wrong["name"]) - len(healthy) <= 18, (wrong, asked)
    assert len(wrong["changed"]) <= 9, (wrong["changed"], asked["changed"])
    assert len(wrong["interval"]) <= 0.1 * asked["interval"], (wrong["interval"], asked["interval"])


@pytest.mark.parametrize("chamber_range, numbers", [("narrow", [1001]), *(
    pytest.param(r, [1003, 1005], marks=pytest.mark.long) for r in ("cold", "hot", "narrow"))])
def test_the_units_of_the_believed_bias_name_no_other_cause(tmp_path, chamber_range, numbers):
    """The same logs and true noise; the bias has the t0 and range of the chamber, twice that range, 30 and 30 degC.  Powers 4 and
    5 with all below are the same curves in any of them.  Told parameters are within 5 of their standard errors."""
    for k in numbers:
        at = tmp_path / str(k)
        at.mkdir()
        d = Device("curve", chamber_range, k)
        files, (white, sigma, tau_s), half = d.written(at), d.own, np.diff(d.ends)[0] / 2
        for t0, width in ((np.mean(d.ends), half), (np.mean(d.ends), 2 * half), (30, 30)):
            (at / "model.json").write_text(json.dumps({
                "imucal_model": 1, "arw_deg_rt_h": white / 60, "markov": [{"sigma_dph": sigma, "tau_s": tau_s}],
                "bias": {"t0_degc": t0, "range_degc": width, "coeff_dph": [0, 0, 0, 0]}}))
            done, command = run(DIAGNOSE, ["--model", at / "model.json"], *files)
            axis = axis_of(done)
            assert is_right("curve", axis) and axis["verdict"] != "unexplained", (d.note, t0, width, found(axis), command)
            true, effect = d.curve.convert(domain=[t0 - width, t0 + width]).coef, causes(axis)[0]
            for name, value in (("p4_dph", true[4]), ("p5_dph", true[5])):
                if effect["name"] == "higher_order_polynomial":
                    assert abs(effect["parameters"][name] - value) <= 5 * effect["std_errors"][name], (true, effect, command)


if __name__ == "__main__":  # [DIAGNOSE [FOLDER for wrong answers]]
    with tempfile.TemporaryDirectory() as to:
        for name, group, twice in (("short", SHORT, False), ("long", LONG, True)):
            (Path(to) / name).mkdir()
            print(name, *counts(Path(to) / name, group, twice, *map(Path, sys.argv[1:3])), sep="\n", flush=True)
