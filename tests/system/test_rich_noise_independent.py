# SPDX-License-Identifier: MIT
"""Gyros whose noise is richer than one first-order process, as the noise of real gyros is, with and without a true cause.

A device has 3 to 6 fitted logs and none to 2 held out, of 80 to 140 min with a row every second.  The set-point of the chamber
makes ramps with rests, stairs, up and down without a rest, or long soaks, a kind drawn for every log, over 35 to 50 degC; the
air follows it with overshoot (second order, 40 to 120 s, damping 0.45 to 0.9); gyro and thermometer follow the air together by
50 to 150 s.  The thermometer has white noise of 0.003 to 0.02 degC and steps of 0.01.  The bias is a cubic of the temperature,
its steepest slope 1 to 40 dph/degC (beside a lag, whatever the strength asks for), and a constant for every log (50 dph).
Thermometer noise times slope stays below a tenth of the white noise of a row.

Noise kinds, always with white noise of 10 to 45 dph a row; sigma is 0.2 to 0.8 of that, every process begins stationary:
i)   two Markov processes: sigma with 15 to 60 s, beside it 200 to 900 s of 0.8 to 1.25 sigma or (even numbers) 0.4 to 0.6;
ii)  flicker: 17 processes of one size, time constants 1.6 to 16,000 s, four a decade; its Allan floor is the Allan deviation
     of the white noise at 20 to 200 s;
iii) a Markov process of sigma with 30 to 200 s and a random walk that reaches 0.5 to 1.5 sigma in an hour;
iv)  three processes: sigma with 15 to 40 s; 80 to 250 s and 400 to 1200 s, each of 0.5 to 1.2 sigma;
v)   one process of sigma with 30 to 400 s: the control.
The believed noise is in turn: one Markov process fitted to the fitted logs (`errormodel fit --criterion ml --markov 1 --detrend
poly:3`), none, and the exact one where a model can say it (i, iv, v).

Without a cause: "wrong" is any effect but noise_parameters, slow_noise, second_markov, flicker_noise and rate_random_walk, also
the verdict "unexplained" and no answer at all; but "open" is slow noise (or noise_parameters) with something in its set that is
no slow noise; "misnamed" is telegraph_noise, markov_sigma_ or markov_tau_vs_temperature by its own name and nothing wrong.  In
the control only noise_parameters is right, and open and misnamed are wrong as well.
With a cause, beside noise of i to iii in turn: thermal_hysteresis (play of 1 to 8 degC to either side, start drawn), thermal_lag
(200 to 500 s, starting 4 degC rms off) or thermal_anomaly (1.5 to 5 degC), of strength d 12 to 25, drawn: sqrt of twice the gain
in log-likelihood of one who knows the form and the true noise, and fits the size, a cubic and the constants (from means of 10
rows).  "right": the first effect is the cause or its family, or has one of them in its set; noise_parameters is passed over
where its set holds only slow noise;
"second": not so, but a later effect is, and before it stands only slow noise, which is true too;
"wrong": some effect before that (any, where the cause is not named) is no slow noise, or no answer at all;
"open": only slow noise is named, with another cause in its set; "lost": nothing but slow noise is named, or nothing.

Limits, from before any result.  Without a cause (40 a kind, stated: 1 %): wrong at most 2 of a kind; open at most 8, misnamed
at most 4.  With a cause (12 of each): wrong at most 1, right at least 9.  Short form, the first of every kind: right with and not
wrong without a cause.  The devices are the first draw of this simulator.

Found: all 36 causes right.  Without a cause 3 of 200 wrong (i 36, iii 28, v 26), all of them "unexplained" and no name, 10 open,
none misnamed.  75 further devices that are not asked here (fitted belief; i, iii, iv, from number 40 on) were worse: 10 wrong, 7
of them among the 25 of iii; of the 10, 7 are "unexplained" and 3 name thermal_memory, bias_step and run_to_run; 7 open.  The
program was then mended: i 36 is slow noise (all logs together tell it, where the held-out ones speak against parameters that the
fitted ones told), and run_to_run is named for iii 28; the others stand."""
import json
import math
import subprocess

import numpy as np
import pytest
from scipy.linalg import solve_triangular, toeplitz
from scipy.signal import bilinear, lfilter, lfilter_zi

from asking import DIAGNOSE, axis_of, found, model_of, model_option, run, write_log
from where import BIN

SEED, BLOCK = 20360219, 10
NOISES, CAUSES = ["i", "ii", "iii", "iv", "v"], ["thermal_hysteresis", "thermal_lag", "thermal_anomaly"]
FAMILY = {"thermal_hysteresis": "thermal_memory", "thermal_lag": "thermal_memory", "thermal_anomaly": "function_of_temperature"}
THERE = {"noise_parameters", "slow_noise", "second_markov", "flicker_noise", "rate_random_walk"}
SLOW = THERE | {"telegraph_noise", "markov_sigma_vs_temperature", "markov_tau_vs_temperature"}


def log_uniform(rng, low, high):
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def followed(x, tau_s, start=None):
    """What follows x, a value a second, with a time constant; it begins at `start`, or at rest."""
    keep = math.exp(-1 / tau_s)
    return lfilter([1 - keep], [1, -keep], x, zi=[keep * (x[0] if start is None else start)])[0]


def set_point(rng, seconds, low, high):
    """Rests and ramps of the chamber, as one of four kinds of profile, begun cold or hot."""
    kind = rng.integers(4)
    if kind == 0:  # ramps and rests
        levels = np.tile([0.0, 1.0], 2)[:rng.integers(3, 5)]
        levels = np.where(levels > 0, 1 - rng.uniform(0, 0.2, len(levels)), rng.uniform(0, 0.2, len(levels)))
        at_rest = rng.uniform(0.3, 0.5)
    elif kind == 1:  # stairs, up or up and down
        levels = np.linspace(0, 1, rng.integers(4, 7))
        levels = np.append(levels, levels[-2::-1]) if rng.integers(2) else levels
        at_rest = rng.uniform(0.5, 0.7)
    elif kind == 2:  # up and down
        levels, at_rest = np.tile([0.0, 1.0], 3)[:rng.choice([3, 5])], 0.05
    else:  # soaks
        levels, at_rest = np.array([0.0, 1.0, 0.0])[:rng.integers(2, 4)], rng.uniform(0.5, 0.65)
    if rng.integers(2):
        levels = 1 - levels
    rests = rng.uniform(0.5, 1.5, len(levels))
    lasts = np.zeros(2 * len(levels))
    lasts[1::2] = rests / rests.sum() * at_rest * seconds
    lasts[2::2] = np.abs(np.diff(levels)) / np.abs(np.diff(levels)).sum() * (1 - at_rest) * seconds
    return np.interp(np.arange(seconds), np.cumsum(lasts), np.repeat(low + (high - low) * levels, 2))


def body(rng, seconds, low, high, follows_s):
    """Temperature of gyro and thermometer."""
    t, damping = rng.uniform(40, 120), rng.uniform(0.45, 0.9)
    x = set_point(rng, seconds, low, high)
    b, a = bilinear([1], [t * t, 2 * damping * t, 1], 1)
    return followed(lfilter(b, a, x, zi=lfilter_zi(b, a) * x[0])[0], follows_s)


def play(x, r, start):
    """Where a play of r to either side stands that is pushed by x."""
    at, out = x[0] + start * r, np.empty(len(x))
    for i, v in enumerate(x):
        at = out[i] = min(max(at, v - r), v + r)
    return out


class Noise:
    """White noise (dph a row), Markov processes (dph, s), a random walk (dph in a second)."""

    def __init__(self, rng, kind, even):
        self.white, self.walk = log_uniform(rng, 10, 45), 0.0
        sigma = self.white * log_uniform(rng, 0.2, 0.8)
        if kind == "i":
            slow = sigma * (rng.uniform(0.4, 0.6) if even else log_uniform(rng, 0.8, 1.25))
            self.processes = [(sigma, log_uniform(rng, 15, 60)), (slow, log_uniform(rng, 200, 900))]
        elif kind == "ii":  # the density is one / f with pi s^2 / step in the place of B^2, whose floor is 0.664 B
            floor, step = self.white / math.sqrt(log_uniform(rng, 20, 200)), math.log(10) / 4
            s = floor / 0.664 * math.sqrt(step / math.pi)
            self.processes = [(s, tau) for tau in np.geomspace(1.6, 16000, 17)]
        elif kind == "iii":
            self.processes, self.walk = [(sigma, log_uniform(rng, 30, 200))], sigma * rng.uniform(0.5, 1.5) / 60
        elif kind == "iv":
            self.processes = [(sigma, log_uniform(rng, 15, 40)), (sigma * rng.uniform(0.5, 1.2), log_uniform(rng, 80, 250)),
                              (sigma * rng.uniform(0.5, 1.2), log_uniform(rng, 400, 1200))]
        else:
            self.processes = [(sigma, log_uniform(rng, 30, 400))]

    def drawn(self, rng, n):
        y = self.white * rng.standard_normal(n) + self.walk * np.cumsum(rng.standard_normal(n))
        for sigma, tau_s in self.processes:
            keep, drive = math.exp(-1 / tau_s), rng.standard_normal(n)
            drive[1:] *= math.sqrt(1 - keep ** 2)
            y += sigma * lfilter([1], [1, -keep], drive)
        return y

    def covariance(self, blocks, m=BLOCK):
        """Of the means of `blocks` times m rows."""
        j = np.arange(1 - m, m)
        apart = np.abs(m * np.arange(blocks)[:, None] + j)
        r = sum(s ** 2 * np.exp(-apart / tau_s) for s, tau_s in self.processes) + self.white ** 2 * (apart == 0)
        c = toeplitz(r @ (m - np.abs(j)) / m ** 2)
        middle = m * np.arange(blocks) + (m + 1) / 2
        walked = np.minimum.outer(middle, middle)
        np.fill_diagonal(walked, m * np.arange(blocks) + (m + 1) * (2 * m + 1) / (6 * m))
        return c + self.walk ** 2 * walked

    def words(self):
        shown = self.processes if len(self.processes) < 9 else [self.processes[0], "..", self.processes[-1]]
        parts = [p if isinstance(p, str) else f"{p[0]:.1f} dph {p[1]:.0f} s" for p in shown]
        return f"white {self.white:.1f}, {', '.join(parts)}, walk {60 * self.walk:.1f} an hour"


def whitened(device, effect, more=None):
    """Effect and (if given) another column a log, whitened by the true noise, less their parts in a cubic and constants."""
    blocks, logs = [], len(effect)
    for i, e in enumerate(effect):
        n = len(e) // BLOCK
        x = (device.temp[i] - 30) / 40
        constants = [np.full(len(e), 1.0 * (k == i)) for k in range(logs)]
        columns = [e, x, x ** 2, x ** 3, *constants, *([] if more is None else [more[i]])]
        means = np.column_stack(columns)[:n * BLOCK].reshape(n, BLOCK, -1).mean(axis=1)
        blocks.append(solve_triangular(np.linalg.cholesky(device.noise.covariance(n)), means, lower=True))
    a = np.vstack(blocks)
    nuisance, rest = a[:, 1:4 + logs], np.column_stack([a[:, :1], a[:, 4 + logs:]])
    q = np.linalg.qr(nuisance / np.linalg.norm(nuisance, axis=0))[0]
    return rest - q @ (q.T @ rest)


class Device:
    def __init__(self, kind, number):
        """kind: one of NOISES or CAUSES."""
        self.kind, self.number = kind, number
        self.rng = np.random.default_rng([SEED, (NOISES + CAUSES).index(kind), number])
        self.cause = kind if kind in CAUSES else None
        self.noise_kind, turn = (NOISES[number % 3], number // 3) if self.cause else (kind, number)
        turns = ["fitted", "none", "exact"] if self.noise_kind in ("i", "iv", "v") else ["fitted", "none"]
        self.belief = turns[turn % len(turns)]
        self.draw()

    def draw(self):
        rng = self.rng
        self.fitted, held_out = int(rng.integers(3, 7)), int(rng.integers(0, 3))
        lasts = rng.integers(80 * 60, 140 * 60 + 1, self.fitted + held_out)
        low = rng.uniform(-5, 12)
        high, follows_s = low + rng.uniform(35, 50), rng.uniform(50, 150)
        self.temp = [body(rng, n, low, high, follows_s) for n in lasts]
        slope = np.polynomial.Polynomial([1, rng.uniform(-0.7, 0.7), rng.uniform(-0.4, 0.4)], [low, high])
        slope *= rng.choice([-1, 1]) * log_uniform(rng, 1, 40) / np.abs(slope(np.linspace(low, high, 100))).max()
        self.bias = slope.integ()
        self.noise = Noise(rng, self.noise_kind, self.number % 2 == 0)
        thermometer = log_uniform(rng, 0.003, 0.02)
        noises = [self.noise.drawn(rng, n) for n in lasts]
        self.shown = [np.round(t + thermometer * rng.standard_normal(len(t)), 2) for t in self.temp]
        what, effect = self.effect(low, high) if self.cause else ("nothing", [np.zeros(n) for n in lasts])
        self.added = effect
        self.rate = [self.bias(t) + e + y + rng.normal(0, 50) for t, e, y in zip(self.temp, effect, noises)]
        steepest = np.abs(self.bias.deriv()(np.linspace(low, high, 100))).max()
        self.note = (f"noise {self.noise_kind}: {self.noise.words()}; {self.fitted} of {len(lasts)} logs fitted, {low:.0f} to "
                     f"{high:.0f} degC, slope to {steepest:.1f}, believed {self.belief}; true: {what}")

    def effect(self, low, high):
        """Words, and the cause in every log, of the strength that is drawn."""
        rng, d = self.rng, self.rng.uniform(12, 25)
        if self.cause == "thermal_hysteresis":
            r = log_uniform(rng, 1, 8)
            effect, what = [(play(t, r, rng.uniform(-1, 1)) - t) / r for t in self.temp], f"play {r:.1f} degC"
        elif self.cause == "thermal_lag":
            tau_s = rng.uniform(200, 500)
            behind = [followed(t, tau_s, t[0] + rng.normal(0, 4)) for t in self.temp]
            effect, what = [self.bias(b) - self.bias(t) for b, t in zip(behind, self.temp)], f"lag {tau_s:.0f} s"
        else:
            at, width = low + (high - low) * rng.uniform(0.15, 0.85), rng.uniform(1.5, 5)
            effect, what = [np.exp(-0.5 * ((t - at) / width) ** 2) for t in self.temp], f"bump at {at:.0f}, {width:.1f} degC"
        scale = d / np.linalg.norm(whitened(self, effect[:self.fitted]))
        if self.cause == "thermal_lag":  # what a lag does grows with the bias
            self.bias *= scale
        else:
            scale *= rng.choice([-1, 1])
        return f"{self.cause}, {what}, size {scale:.2f}, d {d:.1f}", [scale * e for e in effect]

    def believed(self, folder, logs):
        """Options, and a model in the folder."""
        if self.belief == "none":
            return []
        path = folder / f"{self.kind}_{self.number}_model.json"
        model = model_of(self.noise.white, *self.noise.processes, t0_degc=30)
        if self.belief == "fitted":
            subprocess.run([str(c) for c in (BIN / "errormodel", "fit", *logs, "--criterion", "ml", "--markov", 1, "--detrend",
                                             "poly:3", "--quiet", "--threads", 1, "-o", path)], check=True, timeout=120)
            model = {**json.loads(path.read_text()), "bias": model["bias"]}
        return model_option(path, model)

    def written(self, folder):
        """What stands behind the name of the program to ask of this device; its files are written."""
        paths = [folder / f"{self.kind}_{self.number}_{i}.csv" for i in range(len(self.rate))]
        for path, shown, rate in zip(paths, self.shown, self.rate):
            write_log(path, np.arange(1, len(rate) + 1), shown, rate)
        fitted, held_out = paths[:self.fitted], paths[self.fitted:]
        return self.believed(folder, fitted), fitted, held_out


def meant(effect):
    return {effect["name"], *(m["name"] for m in effect["set"])}


def judged_without_cause(axis, noise_kind):
    if isinstance(axis, str) or axis["verdict"] == "unexplained":
        return "wrong"
    names = {e["name"] for e in axis["effects"]}
    if noise_kind == "v":
        return "right" if all(meant(e) <= {"noise_parameters"} for e in axis["effects"]) else "wrong"
    if not names <= SLOW:
        return "wrong"
    if any(not meant(e) <= SLOW for e in axis["effects"]):
        return "open"
    return "right" if names <= THERE else "misnamed"


def judged_with_cause(axis, cause):
    if isinstance(axis, str):
        return "wrong"
    right = {cause, FAMILY[cause]}
    effects = [e for e in axis["effects"] if e["name"] != "noise_parameters" or not meant(e) <= SLOW]
    at = next((i for i, e in enumerate(effects) if meant(e) & right), None)
    if at == 0:
        return "right"
    if any(e["name"] not in SLOW for e in effects[:at]):
        return "wrong"
    if at is not None:
        return "second"
    return "lost" if all(meant(e) <= SLOW for e in effects) else "open"


def judged(device, axis):
    return judged_with_cause(axis, device.cause) if device.cause else judged_without_cause(axis, device.noise_kind)


def answers(kind, numbers, folder, program=DIAGNOSE):
    """How the answers are judged, one word a device."""
    words = []
    for number in numbers:
        device = Device(kind, number)
        done, command = run(program, *device.written(folder))
        axis = axis_of(done)
        words.append(judged(device, axis))
        said = axis if isinstance(axis, str) else (axis["verdict"], axis["title"], *found(axis))
        print(f"{kind} {number}: {words[-1]}: {device.note} | {said} | {command}")
    return words


@pytest.mark.parametrize("kind", NOISES)
def test_first_without_cause(kind, tmp_path):
    assert answers(kind, [0], tmp_path)[0] != "wrong"


def test_slow_noise_that_held_out_logs_spoke_against(tmp_path):
    assert answers("i", [36], tmp_path) == ["right"]


@pytest.mark.parametrize("kind", CAUSES)
def test_first_with_cause(kind, tmp_path):
    assert answers(kind, [0], tmp_path) == ["right"]


@pytest.mark.long
@pytest.mark.parametrize("kind", NOISES)
def test_many_without_cause(kind, tmp_path):
    words = answers(kind, range(40), tmp_path)
    assert words.count("wrong") <= 2 and words.count("open") <= 8 and words.count("misnamed") <= 4, words


@pytest.mark.long
@pytest.mark.parametrize("kind", CAUSES)
def test_many_with_cause(kind, tmp_path):
    words = answers(kind, range(12), tmp_path)
    assert words.count("wrong") <= 1 and words.count("right") >= 9, words
