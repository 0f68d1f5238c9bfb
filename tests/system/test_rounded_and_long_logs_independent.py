# SPDX-License-Identifier: MIT
"""Logs that are rounded, long, or held out with stronger noise: are the figures that `diagnose` tells those of the simulator?

The simulator is that of an engineer who had read the formats and the README of `diagnose`, and neither its engine nor other
tests but those of laboratory logs.  Each device has white noise, a slow process, a cubic over temperature, a constant per log,
and no cause, a play or a lag; its last log is held out.  With even numbers the noise is believed as it is (without rounding),
else a data sheet wrong by up to 1.5, or nothing.

gyro, accel  four logs of 2.6 to 3.2 h, each rounded to another step, one in each of 0.001 to 0.01, to 0.1, to 0.8 and to 3 times
             the white noise: decimal steps, or any with the lattice beside zero.  The mean of an accelerometer is 1e3 to 1e6
             times its noise.
long         12 to 45 h in 2 to 5 logs, rows of 1 s; a slow process of up to 0.3 times the white noise, and 100 to 1000 s
rows         four logs of 4 to 9 h, rows of 2 s or 5 s, with such a process
stronger     the noise of the held-out log is 1.5 to 3 times as strong
changed      its loop or lag is 0.6 to 0.9 times that of the fitted logs, so that the true shrinkage is not near 1

Demanded, written down before the first run (of `changed`, before its own):

named        the true cause, and nothing else but rounding (`changed`: something else may be).  Steps that are told are true
             to 1 %, and those above the white noise are told
noise        of the held-out means over `residual_mean_s`, by formula or draws of the simulator: within 5 % and once the scatter
             that the fitted logs leave (`stronger`: 15 %); the median of all devices of a kind within 3 %
noise_error  within a factor of 1.5 of the scatter of draws
after        within three times that scatter of: noise, and what the model of --model-out leaves of the mean without noise
before       within 5 % and three times that scatter of: noise, and what a cubic of least squares leaves
shrinkage    the true one lies in `ci95`, half a percent on either side allowed (`changed`: where there is a figure)
strength     stronger noise is told where it is, `times` within 15 %, and nowhere else

Chance: a program that tells the truth is outside in 1 of 20 (names without a cause, steps, after, before: 1 of 100); a set of
devices fails where so many come by chance in less than 1 of 50 sets.  The few of the short form have no allowance.

In the first run (108 devices) all causes were named and nothing else was; all steps and all `times` (the worst 11 % off) were
right.  Outside were noise 3, noise_error 1 (null), after 2, before 2 and shrinkage 1, no more than chance: of noise and after
the noise as drawn was unlike its expectation by as much, and `before` was what a cubic beside slow noise leaves.  Without the
half percent 28 of 72 true shrinkages lie above their intervals, by at most 0.0011 but for one, none below: an answer that is
right to a thousandth is told as a little worse.  `changed`: the intervals held 6 of 6.  Of 12 causes 3 were told as a family
only, and there the model of --model-out was not what had been found: for one play it left 256 dph where the plain cubic leaves
13.  That is mended.  `residual_mean_s` was 50 to 78 s in long logs, and not always the whole rows that come nearest to a minute.
"""
import functools
import json
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from asking import DIAGNOSE, most_by_chance, names, run, write_log

SEED, PLAY, LAG, NONE = 7717, "thermal_hysteresis", "thermal_lag", "none"
ROUNDING = "quantization"


# --- the device ---------------------------------------------------------------------------------------------------------------
def low_pass(x, tau_s, start):
    a = 1 - math.exp(-1 / tau_s)
    return lfilter([a], [1, a - 1], x, zi=[(1 - a) * start])[0]


def play_from(degc, half, start):
    out, at = [], start
    for t in degc.tolist():
        at = min(max(at, t - half), t + half)
        out.append(at)
    return np.array(out)


def play(degc, half, start):
    """Any start lies between the lowest and the highest, and moves only where one of those two pushes it."""
    return np.clip(start, play_from(degc, half, degc[0] - half), play_from(degc, half, degc[0] + half))


def rows_of(x, n):
    """Means over n neighbours along the last axis; what is left over at the end is dropped."""
    return x[..., :x.shape[-1] // n * n].reshape(*x.shape[:-1], -1, n).mean(-1)


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


def chamber(rng, seconds, lo, hi):
    """Ramps of 0.5 to 1.5 degC/min between drawn temperatures, with soaks; both ends are reached in the first 2.5 h."""
    times, degc, ends = [0.0], [rng.uniform(20, 40)], [lo, hi][::rng.choice([1, -1])]
    while times[-1] < seconds:
        to = ends.pop(0) if ends else rng.uniform(lo, hi)
        rate = rng.uniform(1.1, 1.5) if len(times) < 5 else rng.uniform(0.5, 1.5)
        soak = rng.uniform(300, 600) if len(times) < 5 else rng.uniform(300, 2400)
        times += [times[-1] + abs(to - degc[-1]) / rate * 60 + 1, 0]
        times[-1] = times[-2] + soak
        degc += [to, to]
    return low_pass(np.interp(np.arange(seconds), times, degc), 150, degc[0])


def decimal(step):
    """The nearest of 1, 2, 5 times a power of ten that is not above it."""
    power = 10.0 ** math.floor(math.log10(step))
    return power * max(k for k in (1, 2, 5) if k <= step / power * (1 + 1e-9))


class Device:
    """kind: gyro-decimal, gyro-adc, accel-decimal, accel-adc, long, rows-2, rows-5, stronger, changed."""

    def __init__(self, kind, cause, number):
        self.kind, self.cause, self.number = kind, cause, number
        self.rng = rng = np.random.default_rng([SEED, number, *map(ord, kind + cause)])
        is_rounded, self.is_accel = "-" in kind and not kind.startswith("rows"), kind.startswith("accel")
        self.row_s = int(kind[-1]) if kind.startswith("rows") else 1
        self.white = 1000 / 10 ** rng.uniform(3, 6) if self.is_accel else rng.uniform(20, 60)
        if kind == "long":
            n, hours = int(rng.integers(2, 6)), rng.uniform(12, 45)
            lengths = hours * 3600 / n * np.exp(rng.uniform(-0.2, 0.2, n))
        else:
            lengths = rng.uniform(*((4, 9) if kind.startswith("rows") else (2.6, 3.2)), 4) * 3600
        is_long = kind == "long" or kind.startswith("rows")
        self.slow = self.white * (rng.uniform(0.08, 0.3) if is_long else rng.uniform(0.1, 0.15))
        self.tau_s = math.exp(rng.uniform(math.log(100), math.log(1000))) if is_long else rng.uniform(60, 200)
        self.strength = np.ones(len(lengths))
        if kind == "stronger":
            self.strength[-1] = rng.uniform(1.5, 3)
        self.curve = self.white * np.array([2, 8, 4, -3]) * np.exp(rng.uniform(-0.3, 0.3, 4))
        if self.is_accel:
            self.curve[0] = rng.choice([-1000, 1000])
        self.half, self.lag_s = rng.uniform(3, 6), rng.uniform(100, 300)
        self.loop = self.white * math.exp(rng.uniform(math.log(0.5), math.log(2)))
        self.step, self.offset = np.zeros(len(lengths)), np.zeros(len(lengths))
        if is_rounded:
            edges = np.log([1e-3, 1e-2, 0.1, 0.8, 3])
            self.step = self.white * np.exp([rng.uniform(edges[k], edges[k + 1]) for k in rng.permutation(4)])
            if kind.endswith("decimal"):
                self.step = np.array([decimal(s) for s in self.step])
            else:
                self.offset = rng.uniform(0, 1, 4)
        self.degc, self.mean, self.read, self.rate = [], [], [], []
        for i, seconds in enumerate(lengths):
            lo, hi = (rng.uniform(0, 4), rng.uniform(56, 60)) if i < len(lengths) - 1 else (5, 55)
            degc = chamber(rng, int(seconds) // self.row_s * self.row_s, lo, hi)
            if kind == "changed" and i == len(lengths) - 1:
                share = rng.uniform(0.6, 0.9)
                self.loop, self.lag_s = self.loop * share, self.lag_s * share
            mean = self.mean_of(degc) + 1.4 * self.white * rng.standard_normal()
            self.degc.append(degc)
            self.mean.append(mean)
            self.read.append(rows_of(degc + 0.01 * rng.standard_normal(len(degc)), self.row_s))
            self.rate.append(self.recorded(i, mean + self.noise(i, 1)[0]))

    def polynomial(self, degc):
        return np.polyval(self.curve[::-1], (degc - 30) / 30)

    def mean_of(self, degc):
        if self.cause == LAG:
            return self.polynomial(low_pass(degc, self.lag_s, degc[0] + self.rng.uniform(-3, 3)))
        if self.cause == PLAY:
            at = play(degc, self.half, degc[0] + self.rng.uniform(-self.half, self.half))
            return self.polynomial(degc) + self.loop * (at - degc) / self.half
        return self.polynomial(degc)

    def noise(self, i, draws):
        """Noise of log i, by the second."""
        n, phi = len(self.degc[i]), math.exp(-1 / self.tau_s)
        start = phi * self.slow * self.rng.standard_normal((draws, 1))
        slow = lfilter([self.slow * math.sqrt(1 - phi**2)], [1, -phi], self.rng.standard_normal((draws, n)), zi=start)[0]
        return self.strength[i] * (slow + self.white * self.rng.standard_normal((draws, n)))

    def recorded(self, i, by_second):
        rows = rows_of(by_second, self.row_s)
        if not self.step[i]:
            return rows
        return self.step[i] * (np.round(rows / self.step[i] - self.offset[i]) + self.offset[i])

    def drawn_squares(self, i, mean_s, draws, beside=0.0):
        """Mean squares of the noise of means over mean_s in log i, rounding included, its own constant apart: one per draw."""
        squares = []
        for _ in range(0, draws, 10):
            rows = self.recorded(i, self.mean[i] + self.noise(i, 10)) - rows_of(self.mean[i] - beside, self.row_s)
            means = rows_of(rows, round(mean_s / self.row_s))
            squares.extend(np.mean((means - means.mean(-1, keepdims=True))**2, -1))
        return np.array(squares)

    def noise_of_means(self, mean_s):
        """The exact standard deviation of means over mean_s, of a log that is neither rounded nor stronger."""
        k = np.arange(1, round(mean_s))
        slow = (mean_s + 2 * np.sum((mean_s - k) * math.exp(-1 / self.tau_s)**k)) / mean_s**2
        return math.sqrt(self.white**2 / mean_s + self.slow**2 * slow)

    def believed(self, folder):
        """Even numbers: the noise as it is, without rounding; then in turn a data sheet wrong by up to 1.5, and nothing."""
        white, slow = ("white_mg_rt_hz", "sigma_mg") if self.is_accel else ("arw_deg_rt_h", "sigma_dph")
        if self.number % 2 == 0:
            (folder / "model.json").write_text(json.dumps({
                "imucal_model": 1, "unit": "mg" if self.is_accel else "dph", white: self.white / (1 if self.is_accel else 60),
                "markov": [{slow: self.slow, "tau_s": self.tau_s}]}))
            return ["--model", folder / "model.json"]
        if self.number % 4 == 3:
            return []
        w, s, tau_s = np.array([self.white, self.slow, self.tau_s]) * np.exp(self.rng.uniform(-math.log(1.5), math.log(1.5), 3))
        sheet = ["--white", f"{w:.6g}"] if self.is_accel else ["--arw", f"{w / 60:.6g}"]
        return [*sheet, "--instability", f"{s:.6g}:{tau_s:.4g}"]

    def write(self, folder):
        """The logs."""
        axes = ["ax_mg" if self.is_accel else "gx_dph"]
        return [write_log(folder / f"log{i}.csv", self.row_s * np.arange(1, len(rate) + 1), degc, rate, axes=axes,
                          form="%d,%.3f,%.15g" if self.step[i] else "%d,%.3f,%.4f")
                for i, (degc, rate) in enumerate(zip(self.read, self.rate))]


# --- what is true of an answer ------------------------------------------------------------------------------------------------
def left_by(device, found):
    """What the model that was found leaves of the held-out log by the second, without noise; its start state is the best."""
    bias, degc, mean = found["bias"], device.degc[-1], device.mean[-1]
    coeff = bias.get("coeff_mg") or bias["coeff_dph"]
    parameters = {e["name"]: e["parameters"] for e in found.get("effects", [])}

    def polynomial(t):
        return np.polyval(coeff[::-1], (t - bias["t0_degc"]) / bias["range_degc"])

    def left(answer):
        return mean - answer - np.mean(mean - answer)

    def best(answer_from, lowest, highest):
        start = minimize_scalar(lambda s: rms(left(answer_from(s))), bounds=(lowest, highest), method="bounded").x
        return left(answer_from(start))

    if LAG in parameters:
        tau_s = parameters[LAG]["tau_s"]
        lagged, fading = low_pass(degc, tau_s, degc[0]), math.exp(-1 / tau_s)**np.arange(1, len(degc) + 1)
        return best(lambda start: polynomial(lagged + start * fading), -10, 10)
    if PLAY in parameters:
        half = parameters[PLAY]["width_degc"]
        amplitude = next(v for k, v in parameters[PLAY].items() if k.startswith("amplitude"))
        lowest, highest = (play_from(degc, half, degc[0] + s) for s in (-half, half))
        loop = amplitude / half
        return best(lambda start: polynomial(degc) + loop * (np.clip(degc[0] + start, lowest, highest) - degc), -half, half)
    return left(polynomial(degc))


def left_by_polynomial(device):
    """The same of a cubic and one constant per log, fitted by least squares to the rates of the fitted logs."""
    columns, rates = [], []
    for degc, rate in zip(device.read[:-1], device.rate[:-1]):
        x = (rows_of(degc, 10) - 30) / 30
        powers, rate = np.column_stack([x, x**2, x**3]), rows_of(rate, 10)
        columns.append(powers - powers.mean(0))
        rates.append(rate - rate.mean())
    fitted = np.linalg.lstsq(np.vstack(columns), np.concatenate(rates), rcond=None)[0]
    x = (device.degc[-1] - 30) / 30
    rest = device.mean[-1] - np.column_stack([x, x**2, x**3]) @ fitted
    return rest - rest.mean()


class Answer:
    def __init__(self, kind, cause, number):
        self.device = d = Device(kind, cause, number)
        with tempfile.TemporaryDirectory() as folder:
            folder, paths = Path(folder), d.write(Path(folder))
            done, _ = run(DIAGNOSE, ["--model-out", folder / "found.json", *d.believed(folder)], paths[:-1], paths[-1:])
            assert done.returncode == 0, done.stderr
            self.found = json.loads((folder / "found.json").read_text())
        self.axis, = json.loads(done.stdout)["axes"]
        self.gap, self.told = self.axis["gap"], self.axis["gap"]["residual_rms_dph"]
        self.names = names(self.axis)
        mean_s, draws = self.gap["residual_mean_s"], [30] * (len(d.rate) - 1) + [40 if kind[:4] in ("long", "rows") else 100]
        squares = [d.drawn_squares(i, mean_s, n) for i, n in enumerate(draws)]
        self.noise = math.sqrt(squares[-1].mean())
        if not d.step[-1] and d.strength[-1] == 1:
            self.noise = math.sqrt(d.noise_of_means(mean_s)**2 - d.noise_of_means(len(d.degc[-1]))**2)
        self.scatter = float(np.std(np.sqrt(squares[-1])))
        lengths = np.array([len(m) for m in d.degc[:-1]])
        fitted = np.array([s.mean() for s in squares[:-1]])
        self.fitted_scatter = 0.5 * math.sqrt(sum((n * s.std())**2 for n, s in zip(lengths, squares))) / (lengths @ fitted)
        self.times = self.noise / math.sqrt(lengths @ fitted / lengths.sum())
        rest = left_by(d, self.found)
        self.left, self.left_before = rms(rest), rms(left_by_polynomial(d))
        self.scatter_after = self.scatter
        if kind == "changed":
            self.scatter_after = float(np.std(np.sqrt(d.drawn_squares(-1, mean_s, 100, rest))))
        self.after, self.before = math.hypot(self.noise, self.left), math.hypot(self.noise, self.left_before)
        self.shrinkage = 1 - (self.left / self.left_before)**2
        self.wrong = [name for name, demand in DEMANDS.items() if demand(self) not in (True, None)]
        print(self)

    def __str__(self):
        d, t = self.device, self.told
        steps = [float(round(s / d.white, 4)) for s in d.step] if d.step.any() else ""
        lsb = [round(e["parameters"]["lsb_dph"] / d.white, 4) for e in self.axis["effects"] if e["name"] == ROUNDING]
        stronger = [round(s["times"], 2) for s in self.gap["stronger_noise_of_held_out_logs"]]
        return (f"{d.kind} {d.cause} {d.number}: {self.names} steps {steps} told {lsb};"
                f" by {self.gap['residual_mean_s']:g} s, of the truth: noise {t['noise'] / self.noise:.3f}"
                f" after {t['after'] / self.after:.3f} before {t['before'] / self.before:.3f}"
                f" (scatter {self.scatter / self.noise:.3f}, told {(t['noise_error'] or 0) / self.noise:.3f},"
                f" fitted {self.fitted_scatter:.3f}); shrinkage {self.shrinkage:.4f}"
                f" told {self.gap['shrinkage']} {self.gap['ci95']}; times {self.times:.2f} told {stronger} WRONG {self.wrong}")


# --- what is demanded: True, False, or None where it does not apply -------------------------------------------------------------
def is_named(a):
    return None if a.device.cause == NONE else a.device.cause in a.names


def is_nothing_else_named(a):
    if a.device.kind == "changed":
        return None
    return set(a.names) <= {a.device.cause, *([ROUNDING] if a.device.step.any() else [])}


def are_steps_told(a):
    steps = a.device.step
    if not steps.any():
        return None
    told = np.array([e["parameters"]["lsb_dph"] for e in a.axis["effects"] if e["name"] == ROUNDING])
    return (all(np.any(abs(steps / s - 1) < 0.01) for s in told)
            and all(np.any(abs(told / s - 1) < 0.01) for s in steps if s >= a.device.white))


def is_noise_right(a):
    allowed = 0.15 if a.device.kind == "stronger" else 0.05 + a.fitted_scatter
    return abs(a.told["noise"] / a.noise - 1) <= allowed


def is_noise_error_right(a):
    return a.told["noise_error"] is not None and 1 / 1.5 <= a.told["noise_error"] / a.scatter <= 1.5


def is_after_right(a):
    return abs(a.told["after"] - a.after) <= 3 * a.scatter_after


def is_before_right(a):
    return abs(a.told["before"] - a.before) <= 0.05 * a.before + 3 * a.scatter


def is_shrinkage_right(a):
    """Half a percent more on either side: what is printed has no more digits, and a start state may be fitted in several ways."""
    if not is_named(a) or a.device.kind == "changed" and a.gap["ci95"] is None:
        return None
    return a.gap["ci95"] is not None and a.gap["ci95"][0] - 0.005 <= a.shrinkage <= a.gap["ci95"][1] + 0.005


def is_strength_right(a):
    told = [s["times"] for s in a.gap["stronger_noise_of_held_out_logs"]]
    if a.device.kind == "stronger":
        return len(told) == 1 and abs(told[0] / a.times - 1) <= 0.15
    if a.device.step[-1] <= a.device.white:
        return not told
    return not told or abs(told[0] / a.times - 1) <= 0.15


DEMANDS = {"named": is_named, "nothing else named": is_nothing_else_named, "steps": are_steps_told, "noise": is_noise_right,
           "noise_error": is_noise_error_right, "after": is_after_right, "before": is_before_right,
           "shrinkage": is_shrinkage_right, "strength": is_strength_right}
# How often a program that tells the truth may be outside by chance.
CHANCE = {"named": 0.05, "nothing else named": 0.01, "steps": 0.01, "noise": 0.05, "noise_error": 0.05, "after": 0.01,
          "before": 0.01, "shrinkage": 0.05, "strength": 0.05}
GROUPS = {"gyro": (["gyro-decimal", "gyro-adc"], 4), "accel": (["accel-decimal", "accel-adc"], 4), "long": (["long"], 6),
          "rows": (["rows-2", "rows-5"], 3), "stronger": (["stronger"], 8), "changed": (["changed"], 6)}
SHORT = [("accel-adc", LAG, 103), ("rows-5", PLAY, 102), ("stronger", LAG, 102)]


@functools.cache
def answer(kind, cause, number):
    return Answer(kind, cause, number)


@pytest.mark.parametrize("kind, cause, number", SHORT)
def test_figures_are_those_of_the_simulator(kind, cause, number):
    assert not answer(kind, cause, number).wrong


def answers(group):
    kinds, n = GROUPS[group]
    return [answer(kind, cause, number) for kind in kinds for cause in (NONE, PLAY, LAG) for number in range(n)
            if (kind, cause) != ("changed", NONE)]


KNOWN = {("changed", "named"): "known: a loop or lag that the held-out log has weaker may leave only its family named"}
APPLIES = [pytest.param(g, d, marks=[pytest.mark.xfail(strict=True, reason=KNOWN[g, d])] if (g, d) in KNOWN else [])
           for g in GROUPS for d in DEMANDS
           if (d != "steps" or g in ("gyro", "accel")) and (d != "nothing else named" or g != "changed")]


@pytest.mark.long
@pytest.mark.parametrize("group, demand", APPLIES)
def test_many_logs(group, demand):
    judged = [(a, DEMANDS[demand](a)) for a in answers(group) if DEMANDS[demand](a) is not None]
    wrong = [str(a) for a, is_right in judged if not is_right]
    assert len(judged) >= len(answers(group)) / 2
    assert len(wrong) <= most_by_chance(len(judged), CHANCE[demand], 0.02), "\n".join(wrong)


@pytest.mark.long
@pytest.mark.parametrize("group", GROUPS)
def test_noise_is_right_in_the_middle(group):
    """The median over devices, in which chance is small, within 3 %."""
    assert abs(np.median([a.told["noise"] / a.noise for a in answers(group)]) - 1) <= 0.03
