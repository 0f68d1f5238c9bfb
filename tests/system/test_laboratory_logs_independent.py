# SPDX-License-Identifier: MIT
"""Logs as laboratories make them: what does `diagnose` say of faults of recorder, thermometer and engineer?

The simulator and the faults are those of an engineer who had read neither the engine of `diagnose` nor the blind check.  On logs
like these the program named a lag for one wrong reading of the thermometer, a rate of temperature for a pause that time stamps
hide, a curve for a log in kelvin, white noise over temperature beside a few wrong samples, a dead band for logs printed with
other digits, and lost loops and lags beside a fan.  It was mended on his logs.  The seeds here are others, and what is
demanded was written down before the first run.

Four logs of 1.5 to 3 h over 0 to 60 degC, the last held out: white noise of 36 dph, a process of 20 dph and 100 s, a cubic, and
50 dph from turn-on to turn-on.  Causes: none, a play of half width 3 to 6 degC and 60 dph, a lag of 150 to 300 s.  With even
numbers the noise is believed as it is, else none is given.

Without a cause nothing may be named (but hits, where there are hits, and rounding of a log); with one it is named.  Records
given in parts, and fitted logs without temperatures beside others, are refused with the file and the remedy.
"""
import json

import numpy as np
import pytest
from scipy.signal import lfilter

from asking import DIAGNOSE, model_option, run, write_log
from reference import MODEL

SEED, PLAY, LAG = 3409, "thermal_hysteresis", "thermal_lag"
LO, HI = 0.0, 60.0


def profile(rng, kind):
    """Where the chamber starts, and (soak in s, None) or (None, (target degC, degC/min))."""
    rate, soak, to = rng.uniform(0.9, 1.4), lambda s: (s, None), lambda degc, r: (None, (degc, r))
    if kind == "triangles":
        turns = [to(degc, rate) for degc in (HI, rng.uniform(18, 30), 55, LO, 30)]
        return 30.0, [soak(300), *turns, soak(300)]
    if kind == "stairs":
        levels = [15, 30, 45, 60, 45, 30, 15, 0]
        return LO, [leg for degc in levels for leg in (soak(500), to(degc, 2.0))] + [soak(500)]
    first, last = (LO, HI) if kind == "up" else (HI, LO)
    return first, [soak(1200), to(last, rate), soak(1200), to(first, rate), soak(600)]


def low_pass(x, tau_s, start):
    a = 1 - np.exp(-1 / tau_s)
    return lfilter([a], [1, a - 1], x, zi=[(1 - a) * start])[0]


def process(rng, n, sigma, tau_s):
    phi = np.exp(-1 / tau_s)
    return lfilter([1], [1, -phi], sigma * np.sqrt(1 - phi**2) * rng.standard_normal(n), zi=[phi * sigma * rng.standard_normal()])[0]


def temperature(rng, kind):
    at, legs = profile(rng, kind)
    wanted = [at]
    for soak_s, ramp in legs:
        n = soak_s if ramp is None else max(1, int(abs(ramp[0] - wanted[-1]) / ramp[1] * 60))
        wanted.extend(np.linspace(wanted[-1], wanted[-1] if ramp is None else ramp[0], int(n) + 1)[1:])
    return low_pass(np.array(wanted) + process(rng, len(wanted), 0.15, 600), 150, at)


def play(degc, half, start):
    out, at = np.empty(len(degc)), start
    for i, t in enumerate(degc):
        at = out[i] = min(max(at, t - half), t + half)
    return out


def curve(degc):
    x = (degc - 30) / 30
    return 80 + 300 * x + 150 * x**2 - 100 * x**3


class Device:
    def __init__(self, fault, cause, number):
        self.rng = rng = np.random.default_rng([SEED, number, *map(ord, fault + cause)])
        half, tau_s = rng.uniform(3, 6), rng.uniform(150, 300)
        self.read, self.rate = [], []
        for kind in ("triangles", "up", "stairs", "down"):
            degc = temperature(rng, kind)
            mean = curve(degc)
            if cause == PLAY:
                mean = mean + 60 * (play(degc, half, degc[0] + rng.uniform(-half, half)) - degc) / half
            if cause == LAG:
                mean = curve(low_pass(degc, tau_s, degc[0] + rng.uniform(-3, 3)))
            n = len(degc)
            self.rate.append(mean + 50 * rng.standard_normal() + 36 * rng.standard_normal(n) + process(rng, n, 20, 100))
            self.read.append(degc + 0.01 * rng.standard_normal(n))
        FAULTS[fault](self)

    def cut(self, i, first, end=None):
        self.read[i], self.rate[i] = self.read[i][first:end], self.rate[i][first:end]


def wrong_readings(value, n, at_start):
    def fault(d):
        for degc in d.read:
            degc[:at_start] = value
            degc[d.rng.integers(100, len(degc), n)] = value
    return fault


def hidden_pause(d):
    """The recorder stops for an hour while the chamber goes on; the time stamps know nothing of it."""
    for i, degc in enumerate(d.read):
        rows = np.r_[:len(degc) // 3, len(degc) // 3 + 3600:len(degc)]
        d.read[i], d.rate[i] = degc[rows], d.rate[i][rows]


def read_seldom(d):
    """Not among the faults of the first run: he had named it, and it was mended later."""
    for i, degc in enumerate(d.read):
        d.read[i] = degc[np.arange(len(degc)) // 60 * 60]


def kelvin(d):
    d.read[1] += 273.15


def fan(d):
    for i in (0, 2):
        n = len(d.rate[i])
        d.rate[i][n // 2:] += 20 * d.rng.standard_normal(n - n // 2)


def wrong_samples(d):
    for rate in d.rate:
        rate[d.rng.integers(0, len(rate), 4)] = d.rng.choice([-1e4, 1e4], 4)


def one_sample(d):
    """Not among his faults: added when samples of any size had been mended."""
    for rate in d.rate:
        rate[d.rng.integers(0, len(rate))] = d.rng.choice([-1e6, 1e6])


def digits(d):
    for rate, step in zip(d.rate, (0.0001, 0.01, 0.1, 0.5)):
        rate[:] = step * np.round(rate / step)


def parts(d):
    d.read, d.rate = [d.read[0].copy() for _ in range(4)], [d.rate[0].copy() for _ in range(4)]
    for i, (first, step) in enumerate(((0, 0.0001), (30, 0.01), (60, 0.1), (17, 0.5))):
        d.cut(i, first)
        d.rate[i] = step * np.round(d.rate[i] / step)


def windows(d):
    degc, rate, n = d.read[2], d.rate[2], len(d.read[2])
    d.read, d.rate = ([x[k * n // 5:k * n // 5 + 2 * n // 5] for k in range(4)] for x in (degc, rate))


def no_temperature(d):
    d.read[0] = np.full(len(d.read[0]), np.nan)


FAULTS = {"nothing": lambda d: None, "power-up": wrong_readings(85, 0, 2), "unread": wrong_readings(0, 3, 0),
          "disconnected": wrong_readings(-127, 1, 0), "now and then": wrong_readings(85, 5, 2), "hidden pause": hidden_pause,
          "read seldom": read_seldom, "kelvin": kelvin, "fan": fan, "wrong samples": wrong_samples, "one sample": one_sample,
          "digits": digits, "parts": parts, "windows": windows, "no temperature": no_temperature}
MAY_STAND = {"wrong samples": {"outliers", "fast_noise"}, "one sample": {"outliers", "fast_noise"}, "digits": {"quantization"}}
REFUSED = {"parts": "one record", "windows": "one record", "no temperature": "without temperatures"}


def ask(folder, fault, cause, number):
    d = Device(fault, cause, number)
    paths = []
    for i, (degc, rate) in enumerate(zip(d.read, d.rate)):
        path = folder / f"{fault}-{cause}-{number}-{i}.csv".replace(" ", "-")
        paths.append(write_log(path, np.arange(1, len(rate) + 1), degc, rate, form="%d,%.2f,%.4f"))
    options = model_option(folder / "model.json", MODEL if number % 2 == 0 else None)
    return run(DIAGNOSE, options, paths[:3], paths[3:4])[0], paths


def is_right(folder, fault, cause, number):
    done, paths = ask(folder, fault, cause, number)
    if fault in REFUSED:
        print(done.returncode, done.stderr)
        return done.returncode == 3 and REFUSED[fault] in done.stderr and any(str(p) in done.stderr for p in paths)
    assert done.returncode == 0, done.stderr
    axis, = json.loads(done.stdout)["axes"]
    names = [e["name"] for e in axis["effects"]]
    print(fault, cause, number, axis["verdict"], "|", axis["title"], names)
    if cause != "none":
        return cause in names
    return set(names) <= MAY_STAND.get(fault, set()) and len(names) <= 1


QUESTIONS = ([(f, "none") for f in FAULTS if f != "fan"] + [(f, c) for f in FAULTS if f not in REFUSED for c in (PLAY, LAG)])
BESIDE_PAUSE = [("hidden pause", PLAY), ("hidden pause", LAG)]
# The program before it was mended fails each of these.
SHORT = [("power-up", "none"), ("unread", "none"), ("disconnected", "none"), ("kelvin", "none"), ("read seldom", "none"),
         ("wrong samples", "none"), ("parts", "none"), ("no temperature", "none"), ("fan", PLAY)]


@pytest.mark.parametrize("fault, cause", SHORT)
def test_a_fault_is_no_cause_and_hides_none(fault, cause, tmp_path):
    assert is_right(tmp_path, fault, cause, 0)


def are_right(folder, questions):
    wrong = [(f, c, n) for n in range(1, 7) for f, c in questions if not is_right(folder, f, c, n)]
    assert len(wrong) <= 0.05 * 6 * len(questions), wrong


@pytest.mark.long
def test_many_faults(tmp_path):
    """A twentieth may be missed: a play or lag of this size is missed now and then without a fault."""
    are_right(tmp_path, [q for q in QUESTIONS if q not in BESIDE_PAUSE])


@pytest.mark.long
@pytest.mark.xfail(strict=True, reason="known: a memory beside a hidden pause may be told as a jump in time there")
def test_causes_beside_a_hidden_pause(tmp_path):
    """In the first run 3 of 12 were named, 9 since the states after the pause are free."""
    are_right(tmp_path, BESIDE_PAUSE)
