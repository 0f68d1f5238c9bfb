# SPDX-License-Identifier: MIT
"""Are the residuals that diagnose tells those of the held-out logs, and does nothing that it says contradict them?

A row is a second; a chamber goes by ramps of 1 to 2.5 degC/min and soaks, a body follows it.  The bias is a cubic of the
temperature with a constant of its own in every log; the noise is white, with a first-order process or more beside it.
Residuals are those of one-minute means of the held-out logs, each less its mean, at temperatures that were fitted.  All of
it is simulated and worked out by this file; no code is shared with the programs.  Seeds and limits were chosen before the
first run.  `make test` asks some of the devices, `make test-long` more."""
import json
import math
import re
import subprocess

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import fftconvolve, lfilter
from scipy.stats import chi2

from asking import DIAGNOSE, axes_of, model_of, model_option, most_by_chance, run, write_log

SEED = 20281103
COLD, HOT = -20.0, 60.0
WHITE = 36.0  # dph in a second: 0.6 deg/sqrt(h)


# ---- physics


def chamber(rng, seconds, cold=COLD, hot=HOT, rest_from=None):
    """From one end, soaks and ramps in turn; a ramp goes six tenths of the way to the other end or more."""
    t, is_rising = 0.0, rng.random() < 0.5
    degc = cold + rng.uniform(0, 6) if is_rising else hot - rng.uniform(0, 6)
    at = []
    while t < seconds:
        soak_end = t + rng.uniform(200, 700)
        goal = degc + rng.uniform(0.6, 1) * ((hot if is_rising else cold) - degc)
        at += [(t, degc), (soak_end, degc)]
        t, degc, is_rising = soak_end + abs(goal - degc) / rng.uniform(1, 2.5) * 60, goal, not is_rising
    wanted = np.interp(np.arange(seconds), *zip(*at, (t, degc)))
    if rest_from is not None:
        wanted[rest_from:] = wanted[rest_from]
    return delayed(delayed(wanted, rng.uniform(40, 90)), 30)


def delayed(x, tau_s):
    phi = math.exp(-1 / tau_s)
    return x[0] + lfilter([1 - phi], [1, -phi], x - x[0])


def markov(rng, n, sigma, tau_s):
    phi = math.exp(-1 / tau_s)
    drive = sigma * rng.standard_normal(n)
    drive[1:] *= math.sqrt(1 - phi ** 2)
    return lfilter([1], [1, -phi], drive)


def power_law(rng, n, exponent, sigma, corner_hz):
    """Density f^-exponent, that of white noise of `sigma` at the corner: white noise differenced -exponent/2 times."""
    before = 3 * n  # it does not begin with the log
    k = np.arange(1, before + n)
    response = np.cumprod(np.append(1.0, (k - 1 + exponent / 2) / k))
    noise = fftconvolve(rng.standard_normal(before + n), response)[before:before + n]
    return sigma * (2 * math.pi * corner_hz) ** (exponent / 2) * noise


def cubic(degc, coeff):
    return np.polynomial.polynomial.polyval((degc - 20) / 40, coeff)


def play(degc, width):
    """Backlash: it stays until the temperature has gone `width` off, then it is dragged."""
    out, p = np.empty(len(degc)), degc[0]
    for i, t in enumerate(degc):
        p = min(max(p, t - width), t + width)
        out[i] = (p - t) / width
    return out


# ---- a device, its files, and the program


class Lab:
    def __init__(self, folder):
        self.folder, self.answers, self.known = folder, [], {}

    def ask(self, what, runs, rates, n_fitted, noise=None, options=(), thermometers=None, axis="gx_dph", rng=None):
        """`noise` (white, sigma, tau): that of the model that is given."""
        rng = rng or np.random.default_rng([SEED, 99])
        thermometers = thermometers or [t + 0.01 * rng.standard_normal(len(t)) for t in runs]
        logs = []
        for i, (degc, rate) in enumerate(zip(thermometers, rates)):
            path = self.folder / f"{what}_{'fit' if i < n_fitted else 'held'}{i}.csv"
            logs.append(write_log(path, np.arange(1, len(degc) + 1), degc, rate, axes=[axis], form="%d,%.4f,%.4f"))
        believed = model_option(self.folder / f"{what}_model.json", model_of(noise[0], noise[1:]) if noise else None)
        done, _ = run(DIAGNOSE, [*options, *believed], logs[:n_fitted], logs[n_fitted:], timeout_s=180)
        told, = axes_of(done)
        answer = {**json.loads(done.stdout), "axis": told}
        answer["what"] = what
        self.answers.append(answer)
        for log in logs:
            log.unlink()
        return answer

    def once(self, make, *args):
        """The same device is asked once, whatever number of tests look at it."""
        key = make.__name__, *args
        if key not in self.known:
            self.known[key] = make(self, *args)
        return self.known[key]


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return Lab(tmp_path_factory.mktemp("residual"))


def names(answer):
    return [(e["name"], [m["name"] for m in e["set"]]) for e in answer["axis"]["effects"]]


def residual(answer):
    return answer["axis"]["gap"]["residual_rms_dph"]


def lengths(rng, n_logs):
    """Whole minutes, 6000 to 9000 s."""
    return [60 * int(m) for m in rng.integers(100, 151, n_logs)]


# ---- what numpy makes of the same rates


def minutes(x):
    return x.reshape(-1, 60).mean(1)


def powers(degc):
    tn = (minutes(degc) - 20) / 40
    return np.transpose([tn, tn ** 2, tn ** 3])


def less_means(per_log):
    return np.concatenate([x - x.mean(0) for x in per_log])


def within(runs, n_fitted):
    """Of every held-out log: the minutes at temperatures that were fitted, to a degree."""
    low, high = min(t.min() for t in runs[:n_fitted]) - 1, max(t.max() for t in runs[:n_fitted]) + 1
    return [(minutes(t) > low) & (minutes(t) < high) for t in runs[n_fitted:]]


def left_by_least_squares(runs, rates, n_fitted):
    """What an ordinary cubic of the fitted logs leaves in the held-out ones."""
    slopes = np.linalg.lstsq(less_means([powers(t) for t in runs[:n_fitted]]),
                             less_means([minutes(y) for y in rates[:n_fitted]]), rcond=None)[0]
    held = zip(runs[n_fitted:], rates[n_fitted:], within(runs, n_fitted))
    off = less_means([(minutes(y) - powers(t) @ slopes)[ok] for t, y, ok in held])
    return math.sqrt(np.mean(off ** 2))


def covariance(n, noise):
    """Of n one-minute means of white noise and one first-order process."""
    white, sigma, tau = noise
    lag, weight = np.arange(-59, 60), 60 - abs(np.arange(-59, 60))
    markov_part = [np.sum(weight * np.exp(-abs(60 * k + lag) / tau)) * (sigma / 60) ** 2 for k in range(n)]
    return toeplitz(markov_part) + white ** 2 / 60 * np.eye(n)


class Expected:
    """What white noise and one first-order process leave: of these rates, and by the law of the noise."""

    def __init__(self, runs, rates, n_fitted, noise):
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for t, y in zip(runs[:n_fitted], rates[:n_fitted]):
            weight = np.linalg.inv(covariance(len(t) // 60, noise))
            ones = np.ones(len(weight))
            weight -= np.outer(weight @ ones, ones @ weight) / (ones @ weight @ ones)  # a constant of its own
            normal += powers(t).T @ weight @ powers(t)
            right += powers(t).T @ weight @ minutes(y)
        slopes = np.linalg.solve(normal, right)
        ok = within(runs, n_fitted)
        x = less_means([powers(t)[k] for t, k in zip(runs[n_fitted:], ok)])
        y = less_means([minutes(y)[k] for y, k in zip(rates[n_fitted:], ok)])
        self.found = math.sqrt(np.mean((y - x @ slopes) ** 2))
        alone, at = np.zeros((len(x), len(x))), 0
        for k in ok:
            center = np.eye(k.sum()) - 1 / k.sum()
            alone[at:at + k.sum(), at:at + k.sum()] = center @ covariance(len(k), noise)[np.ix_(k, k)] @ center
            at += k.sum()
        both = [alone, alone + x @ np.linalg.solve(normal, x.T)]  # the second: with what the cubic is off
        self.rms = [math.sqrt(np.trace(c) / len(c)) for c in both]
        self.error = [math.sqrt(2 * np.sum(c * c)) / len(c) / (2 * rms) for c, rms in zip(both, self.rms)]


# ---- 1: the polynomial anybody would fit


def strong_slow_noise(lab, number):
    rng = np.random.default_rng([SEED, 1, number])
    n_fitted = 1 + number % 3
    runs = [chamber(rng, n) for n in lengths(rng, n_fitted)]
    runs += [chamber(rng, n, COLD - rng.uniform(0, 10), HOT) for n in lengths(rng, 2)]
    coeff, k = rng.normal(0, [0, 300, 150, 80]), rng.uniform(1, 3)
    tau, is_walk = rng.uniform(5000, 10000), number % 2 == 0
    rates = []
    for t in runs:
        n = len(t)
        slow = np.cumsum(k * rng.standard_normal(n)) if is_walk else markov(rng, n, rng.uniform(60, 200), tau)
        rates.append(cubic(t, coeff) + rng.normal(0, 30) + WHITE * rng.standard_normal(n) + slow)
    answer = lab.ask(f"slow{number}", runs, rates, n_fitted, rng=rng)
    return residual(answer)["before"] / left_by_least_squares(runs, rates, n_fitted)


def white_noise(lab, number):
    rng = np.random.default_rng([SEED, 2, number])
    n_fitted, noise = 1 + number % 3, (WHITE, 2.0, 100.0)
    runs = [chamber(rng, n) for n in lengths(rng, n_fitted)]
    ends = max(t.min() for t in runs), min(t.max() for t in runs)  # no minute is half beyond what was fitted
    runs += [chamber(rng, n, *ends) for n in lengths(rng, 2)]
    coeff = rng.normal(0, [0, 300, 150, 80])
    rates = [cubic(t, coeff) + rng.normal(0, 30) + WHITE * rng.standard_normal(len(t)) + markov(rng, len(t), 2.0, 100.0)
             for t in runs]
    answer = lab.ask(f"white{number}", runs, rates, n_fitted, noise, rng=rng)
    return residual(answer)["before"] / left_by_least_squares(runs, rates, n_fitted)


def check_before(lab, n_draws):
    """It may be better than ordinary least squares, and not worse by more than 5 %."""
    ratios = {k: lab.once(strong_slow_noise, k) for k in range(n_draws)}
    assert all(0.5 < r < 1.05 for r in ratios.values()), ratios


def check_before_in_white_noise(lab, n_draws):
    """Weights of minutes or of seconds, and what remains of the slow noise, move it by less than 1 %."""
    ratios = {k: lab.once(white_noise, k) for k in range(n_draws)}
    assert all(abs(r - 1) < 0.01 for r in ratios.values()), ratios


def test_before_is_not_worse_than_an_ordinary_cubic(lab):
    check_before(lab, 4)


def test_before_is_the_ordinary_cubic_in_white_noise(lab):
    check_before_in_white_noise(lab, 3)


@pytest.mark.long
def test_before_is_not_worse_than_an_ordinary_cubic_long(lab):
    check_before(lab, 36)


@pytest.mark.long
def test_before_is_the_ordinary_cubic_in_white_noise_long(lab):
    check_before_in_white_noise(lab, 15)


# ---- 2: nothing is explained while the residual is far above the noise


STRANGE = ["ageing_slope", "two_temperatures", "jumps_anew"]


def strange(kind, rng, runs):
    """What the library does not know, with a standard deviation of about 1."""
    if kind == "ageing_slope":
        return [(t - 20) / 40 * (np.arange(len(t)) / 5000) ** 1.5 for t in runs]
    if kind == "two_temperatures":
        lag = rng.uniform(300, 1200)
        waves = [(rng.normal(0, 2.5), rng.normal(0, 2.5), rng.uniform(0, 2 * math.pi)) for _ in range(8)]
        return [sum(np.cos(a * t / 40 + b * delayed(t, lag) / 40 + c) for a, b, c in waves) / 2 for t in runs]
    return [sum(rng.choice([-1, 1]) * rng.uniform(1, 2) * (t > rng.uniform(COLD + 15, HOT - 15)) for _ in range(3))
            for t in runs]


def unknown_gap(lab, kind, number):
    """Odd numbers are given the model."""
    rng = np.random.default_rng([SEED, 3, STRANGE.index(kind), number])
    n_fitted, noise = 1 + number % 3, (WHITE, rng.uniform(10, 20), rng.uniform(60, 200))
    runs = [chamber(rng, n) for n in lengths(rng, n_fitted + 2)]
    coeff, size = rng.normal(0, [0, 300, 150, 80]), rng.uniform(30, 120)
    rates = [cubic(t, coeff) + rng.normal(0, 30) + WHITE * rng.standard_normal(len(t)) + markov(rng, len(t), *noise[1:])
             + size * g for t, g in zip(runs, strange(kind, rng, runs))]
    return lab.ask(f"{kind}{number}", runs, rates, n_fitted, noise if number % 2 else None, rng=rng)


def is_far_above(r):
    return r["after"] > 1.5 * r["noise"] and r["after"] - r["noise"] >= 4 * r["noise_error"]


def check_explained(lab, n_of_each):
    answers = [lab.once(unknown_gap, kind, k) for kind in STRANGE for k in range(n_of_each)]
    answers += [lab.once(thermometer, "stops", 2 * k + 1)[0] for k in range(n_of_each // 2)]  # that of a held-out log
    wrong = {a["what"]: (a["axis"]["verdict"], residual(a), names(a)) for a in answers
             if a["axis"]["verdict"] in ("explained", "no_gap") and is_far_above(residual(a))}
    assert not wrong, (len(wrong), len(answers), wrong)


def test_nothing_is_explained_far_above_the_noise(lab):
    check_explained(lab, 2)


@pytest.mark.long
def test_nothing_is_explained_far_above_the_noise_long(lab):
    check_explained(lab, 20)


# ---- 3: noise and its error


def healthy(lab, number):
    rng = np.random.default_rng([SEED, 4, number])
    noise = WHITE * rng.uniform(0.5, 1.5), rng.uniform(10, 30), math.exp(rng.uniform(math.log(40), math.log(400)))
    runs = [chamber(rng, n) for n in lengths(rng, 5)]
    coeff = rng.normal(0, [0, 300, 150, 80])
    rates = [cubic(t, coeff) + rng.normal(0, 30) + noise[0] * rng.standard_normal(len(t)) + markov(rng, len(t), *noise[1:])
             for t in runs]
    return lab.ask(f"healthy{number}", runs, rates, 3, noise, rng=rng), Expected(runs, rates, 3, noise)


def healthy_ones(lab, n_draws):
    """One of 100 has a name, by the program's own word: those are left out."""
    draws = [lab.once(healthy, k) for k in range(n_draws)]
    kept = [(residual(a), e, a["what"]) for a, e in draws if a["axis"]["verdict"] == "no_gap"]
    assert n_draws - len(kept) <= most_by_chance(n_draws, 0.01), [names(a) for a, _ in draws]
    return kept


def check_figures(lab, n_draws):
    """The law of the noise gives all of it but what is told of the cubic's own error.  3 % and a fifth: for a noise that
    may be simulated by the program; 2 %: the cubic here is weighted by minutes, there perhaps by seconds."""
    for r, e, what in healthy_ones(lab, n_draws):
        told = what, r, e.found, e.rms, e.error
        assert 0.97 * e.rms[0] < r["noise"] < 1.03 * e.rms[1], told
        assert 0.8 * e.error[0] < r["noise_error"] < 1.25 * e.error[1], told
        assert abs(r["after"] / e.found - 1) < 0.02, told


def check_spread(lab, n_draws):
    """Three standard errors of the mean, and the cubic's own error; the spread by chi-square, 1 of 1000."""
    kept = healthy_ones(lab, n_draws)
    z = np.array([(r["after"] - r["noise"]) / r["noise_error"] for r, _, _ in kept])
    cubics = np.mean([(e.rms[1] - e.rms[0]) / e.error[0] for _, e, _ in kept])
    wider = np.mean([e.error[1] / e.error[0] for _, e, _ in kept])
    low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], len(z) - 1) / (len(z) - 1))
    assert -3 / math.sqrt(len(z)) < z.mean() < 3 / math.sqrt(len(z)) + cubics, (z.mean(), cubics)
    assert low < z.std(ddof=1) < high * wider, (z.std(ddof=1), low, high, wider)


def test_noise_and_its_error_are_those_of_the_law(lab):
    check_figures(lab, 5)


def test_after_is_off_the_noise_by_as_much_as_is_told(lab):
    check_spread(lab, 5)


@pytest.mark.long
def test_noise_and_its_error_are_those_of_the_law_long(lab):
    check_figures(lab, 60)


@pytest.mark.long
def test_after_is_off_the_noise_by_as_much_as_is_told_long(lab):
    check_spread(lab, 60)


# ---- 4: the interval of the shrinkage and the minutes


def known_and_unknown(lab, number):
    """Something that the library knows, and beside it something weaker that it does not know."""
    rng = np.random.default_rng([SEED, 5, number])
    n_fitted, noise = 1 + number % 3, (WHITE, rng.uniform(8, 15), rng.uniform(60, 200))
    runs = [chamber(rng, n) for n in lengths(rng, n_fitted + 2)]
    coeff, size = rng.normal(0, [0, 300, 150, 80]), rng.uniform(12, 30)
    width, center = rng.uniform(3, 8), rng.uniform(0, 40)
    big = [[play(t, width), 60 * np.gradient(t), np.exp(-0.5 * ((t - center) / 5) ** 2)][number // 2 % 3] for t in runs]
    factor = rng.choice([-1, 1]) * rng.uniform(60, 120) / np.std(big[0])
    rates = [cubic(t, coeff) + rng.normal(0, 30) + WHITE * rng.standard_normal(len(t)) + markov(rng, len(t), *noise[1:])
             + factor * b + size * g for t, b, g in zip(runs, big, strange(STRANGE[number % 2], rng, runs))]
    return lab.ask(f"both{number}", runs, rates, n_fitted, noise, rng=rng)


def check_interval(lab, n_both, n_of_each, at_least):
    answers = [lab.once(known_and_unknown, k) for k in range(n_both)]
    answers += [lab.once(unknown_gap, kind, k) for kind in STRANGE for k in range(n_of_each)]
    seen, wrong = 0, {}
    for a in answers:
        r, gap = residual(a), a["axis"]["gap"]
        if gap["ci95"] is None or r["after"] - r["noise"] <= 4 * r["noise_error"]:
            continue
        seen += 1
        assert r["before"] > r["noise"], (a["what"], r)
        shrinkage = 1 - (r["after"] ** 2 - r["noise"] ** 2) / (r["before"] ** 2 - r["noise"] ** 2)
        if not gap["ci95"][0] - 0.01 <= shrinkage <= gap["ci95"][1] + 0.01:
            wrong[a["what"]] = shrinkage, gap["ci95"], gap["shrinkage"], r, names(a)
    assert not wrong, (len(wrong), seen, wrong)
    assert seen >= at_least, seen  # else nothing was looked at


def test_the_interval_agrees_with_the_minutes(lab):
    check_interval(lab, 12, 2, 2)


@pytest.mark.long
def test_the_interval_agrees_with_the_minutes_long(lab):
    check_interval(lab, 36, 20, 3)


# ---- 5: a wrong data sheet


def numbers(text):
    return [float(x) for x in re.findall(r"\d+(?:\.\d+)?(?:[eE][-+]?\d+)?", text)]


def near(text, figure, part):
    return any(abs(x - figure) <= part * figure for x in numbers(text))


def data_sheet(lab, number, factor, is_accelerometer=False):
    """White noise, and in turn nothing, one process, a loop over temperature beside it.  Texts, and what was given."""
    rng = np.random.default_rng([SEED, 6, number])
    runs = [chamber(rng, n) for n in lengths(rng, 3)]
    true = 0.15 if is_accelerometer else 0.6
    white = true if is_accelerometer else 60 * true
    width, coeff = rng.uniform(3, 8), white * rng.normal(0, [0, 6, 3, 2])
    beside = [lambda t: 0, lambda t: markov(rng, len(t), 0.5 * white, 150), lambda t: 1.5 * white * play(t, width)][number % 3]
    rates = [cubic(t, coeff) + white * rng.standard_normal(len(t)) + beside(t) for t in runs]
    given = round(factor * true, 3)
    axis, option = ("ax_mg", "--white") if is_accelerometer else ("gx_dph", "--arw")
    answer = lab.ask(f"sheet{number}_{factor}_{axis}", runs, rates, 2, options=[option, given], axis=axis, rng=rng)
    texts = answer["warnings"] + answer["axis"]["notes"]
    return texts, [x for x in texts if near(x, given, 0.005) and near(x, true, 0.1)]


def is_of_white_noise(text):
    return "random walk" in text.replace("rate random walk", "") or "white noise" in text


def check_sheet(lab, number, factors, is_accelerometer=False):
    for factor in factors:
        texts, told = lab.once(data_sheet, number, factor, is_accelerometer)
        if max(factor, 1 / factor) > 2:
            assert told, (number, factor, texts)
        else:
            assert not told and not any(map(is_of_white_noise, texts)), (number, factor, texts)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_data_sheet_wrong_by_three_is_told(lab, number):
    check_sheet(lab, number, [(1 / 3, 1.38), (3, 1 / 1.38)][number % 2])


def test_a_data_sheet_of_an_accelerometer_wrong_by_three_is_told(lab):
    check_sheet(lab, 1, [1 / 3, 1.38], is_accelerometer=True)


@pytest.mark.long
@pytest.mark.parametrize("number", range(9))
def test_a_data_sheet_wrong_by_three_is_told_long(lab, number):
    check_sheet(lab, number, [1 / 3, 1 / 1.38, 1.38, 3])


# ---- 6: a thermometer that stops


THERMOMETERS = ["stops", "stops_at_rest", "rests", "coarse", "coarse_rests"]


def thermometer(lab, kind, number):
    """The first fitted log or (odd numbers) the first held-out one.  The answer; texts about a thermometer: those that name
    the log, all."""
    rng = np.random.default_rng([SEED, 7, THERMOMETERS.index(kind), number])
    n_fitted, which = 2, (0, 2)[number % 2]
    runs = []
    for i, n in enumerate(lengths(rng, 4)):
        runs.append(chamber(rng, n, rest_from=n * 2 // 3 - 600 if i == which and "rest" in kind else None))
    coeff = rng.normal(0, [0, 300, 150, 80])
    rates = [cubic(t, coeff) + rng.normal(0, 30) + WHITE * rng.standard_normal(len(t)) + markov(rng, len(t), 12, 120)
             for t in runs]
    read = [t + rng.uniform(0.01, 0.03) * rng.standard_normal(len(t)) for t in runs]
    if "coarse" in kind:
        read = [np.round(t / 0.5) * 0.5 for t in read]
    elif "stops" in kind:
        stop = len(read[which]) * 2 // 3
        read[which][stop:] = read[which][stop]
    answer = lab.ask(f"{kind}{number}", runs, rates, n_fitted, thermometers=read, rng=rng)
    name = f"{kind}{number}_{'fit' if which < n_fitted else 'held'}{which}.csv"
    texts = [x for x in answer["warnings"] if "thermometer" in x]
    return answer, [x for x in texts if name in x], texts


def check_thermometer(lab, kind, draws):
    for number in draws:
        _, told, texts = lab.once(thermometer, kind, number)
        if "stops" in kind:
            assert told, (number, texts)
        else:
            assert not texts, (number, texts)


@pytest.mark.parametrize("kind", THERMOMETERS)
def test_a_thermometer_that_stops_is_told_and_no_other(lab, kind):
    check_thermometer(lab, kind, range(2 if kind == "stops" else 1))


@pytest.mark.long
@pytest.mark.parametrize("kind", THERMOMETERS)
def test_a_thermometer_that_stops_is_told_and_no_other_long(lab, kind):
    check_thermometer(lab, kind, range(8))


# ---- 7: a power law is no second Markov process


def of_power_law(lab, number):
    """In turn without a model, and with the model of all the rest of the noise."""
    rng = np.random.default_rng([SEED, 8, number])
    exponent = (0.6, 0.8, 1.3)[number // 2 % 3]
    noise = (WHITE, 12.0, 60.0) if number % 2 else None
    runs = [chamber(rng, n) for n in lengths(rng, 3)]
    coeff, corner = rng.normal(0, [0, 300, 150, 80]), 1 / rng.uniform(20, 60)
    rates = [cubic(t, coeff) + rng.normal(0, 30) + WHITE * rng.standard_normal(len(t))
             + power_law(rng, len(t), exponent, WHITE, corner) + (markov(rng, len(t), *noise[1:]) if noise else 0)
             for t in runs]
    return lab.ask(f"power{exponent}_{number}", runs, rates, 3, noise, rng=rng)


def of_two_processes(lab, number):
    rng = np.random.default_rng([SEED, 9, number])
    noise = WHITE, rng.uniform(25, 40), 30.0
    runs = [chamber(rng, n) for n in lengths(rng, 3)]
    coeff, sigma = rng.normal(0, [0, 300, 150, 80]), rng.uniform(25, 40)
    rates = [cubic(t, coeff) + rng.normal(0, 30) + WHITE * rng.standard_normal(len(t))
             + markov(rng, len(t), *noise[1:]) + markov(rng, len(t), sigma, 1500) for t in runs]
    return lab.ask(f"two{number}", runs, rates, 3, noise if number % 2 else None, rng=rng)


def is_surely_second(answer):
    return any(name == "second_markov" and not {*members} - {"second_markov", "telegraph_noise"}
               for name, members in names(answer))


def is_second_told(answer):
    return any(e["family"] == "slow_noise" and "second_markov" in {e["name"], *(m["name"] for m in e["set"])}
               for e in answer["axis"]["effects"])


def check_power_law(lab, n_draws):
    answers = [lab.once(of_power_law, k) for k in range(n_draws)]
    wrong = {a["what"]: names(a) for a in answers if is_surely_second(a)}
    assert len(wrong) <= max(1, n_draws // 10), (len(wrong), n_draws, wrong)


def check_two_processes(lab, n_draws):
    answers = [lab.once(of_two_processes, k) for k in range(n_draws)]
    missed = {a["what"]: (a["axis"]["verdict"], names(a)) for a in answers if not is_second_told(a)}
    assert 10 * len(missed) <= 2 * n_draws, (len(missed), n_draws, missed)


def test_a_power_law_is_no_certain_second_process(lab):
    check_power_law(lab, 3)


def test_a_second_process_is_told(lab):
    check_two_processes(lab, 3)


@pytest.mark.long
def test_a_power_law_is_no_certain_second_process_long(lab):
    check_power_law(lab, 60)


@pytest.mark.long
def test_a_second_process_is_told_long(lab):
    check_two_processes(lab, 30)


# ---- 8: candidates beside a jump


# A relay, a bump over temperature and a process of two levels contain such a jump; so may a free shape, which has no name
# in the library.
HAS_JUMP = {"bias_step", "thermal_step", "thermal_anomaly", "telegraph_noise"}


def one_jump(lab, number):
    """Its temperature is passed more than once.  In turn: with and without a model, with and without other logs."""
    rng = np.random.default_rng([SEED, 10, number])
    noise = WHITE, rng.uniform(8, 15), rng.uniform(60, 150)
    runs = [chamber(rng, n) for n in [9000, *lengths(rng, 2 if number // 2 % 2 else 0)]]
    coeff, size = rng.normal(0, [0, 300, 150, 80]), rng.choice([-1, 1]) * rng.uniform(150, 300)
    rates = [cubic(t, coeff) + rng.normal(0, 30) + WHITE * rng.standard_normal(len(t)) + markov(rng, len(t), *noise[1:])
             for t in runs]
    rates[0][int(rng.uniform(0.3, 0.7) * 9000):] += size
    return lab.ask(f"jump{number}", runs, rates, 1, noise if number % 2 else None, rng=rng)


def check_jump(lab, n_draws):
    listed = json.loads(subprocess.run([str(DIAGNOSE), "--list-effects", "--json", "-"], capture_output=True,
                                       text=True, check=True).stdout)
    library = {e["name"] for e in listed["effects"]} - HAS_JUMP
    for a in (lab.once(one_jump, k) for k in range(n_draws)):
        own = [e["gain_nats"] for e in a["axis"]["effects"] if e["name"] == "bias_step"]
        assert own, (a["what"], names(a))
        high = {c["name"]: c["gain_nats"] for c in a["axis"]["plots"]["candidates"]
                if c["name"] in library and (c["gain_nats"] or 0) >= own[0] - 3}
        assert not high, (a["what"], own, high)


def test_candidates_are_told_without_the_jump(lab):
    check_jump(lab, 4)


@pytest.mark.long
def test_candidates_are_told_without_the_jump_long(lab):
    check_jump(lab, 20)


# ---- 9: sets are in order


def out_of_order(effect):
    """The evidence of a member against that of the effect, and whether the first is what was named."""
    members = [m for m in effect["set"] if (effect["name"], m["name"]) != ("bias_step", "thermal_step")]
    above = [m["name"] for m in members if m["evidence_nats"] > effect["evidence_nats"] + 3]
    first = effect["set"][0] if effect["set"] else None
    is_named = first and effect["name"] in (first["name"], first["family"])
    return above or not is_named


def check_sets(lab):
    effects = [(a["what"], e) for a in lab.answers for e in a["axis"]["effects"]]
    wrong = [(what, e["name"], e["evidence_nats"], e["set"]) for what, e in effects if out_of_order(e)]
    assert not wrong, (len(wrong), len(effects), wrong)
    assert len(effects) > 3


def test_sets_are_in_order(lab):
    for kind in STRANGE:
        lab.once(unknown_gap, kind, 0)
    for k in range(2):
        lab.once(of_power_law, k)
        lab.once(known_and_unknown, k)
    check_sets(lab)


@pytest.mark.long
def test_sets_are_in_order_long(lab):
    """Of whatever the tests above asked."""
    for kind in STRANGE:
        for k in range(20):
            lab.once(unknown_gap, kind, k)
    check_sets(lab)
