# SPDX-License-Identifier: MIT
"""Kinds of noise that the error model leaves out: named, the same under every belief, and never as what repeats.

A chamber of second order (it overshoots) goes by ramps of 1 to 2.5 degC/min and soaks between -20 and 60 degC; a row is
a second.  The bias is a cubic of the temperature with a constant of its own in every log; the noise is white noise of
30 to 60 dph per second's mean and one first-order process of 10 to 20 dph and 60 to 300 s.  Every process starts in its
stationary state.  The strength of a cause is d = sqrt(2 x gain), the gain being the expected log-likelihood over the
best re-fitted nominal noise: Whittle's divergence, summed over classes of temperature where the noise depends on it.
No code is shared with the programs.  Seeds were chosen before the first run, limits by the chances that are stated.
`make test` asks some of the devices, `make test-long` the others."""
import functools
import math
import os
import subprocess

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.signal import lfilter

import asking
from asking import DIAGNOSE, axes_of, model_option, most_by_chance, names, run, write_log
from where import BIN

SEED = 20270613
COLD, HOT, T0_DEGC, RANGE_DEGC = -20.0, 60.0, 20.0, 40.0
FALSE_ALARM = 0.01  # stated by the program: any name where there is no gap
MISSED = 0.05  # of single causes of d = 20 and more, the README's aim
BELIEFS = ["exact", "x3", "/3", "fitted", "none"]
# Of these the mean of nothing in other logs can be predicted, and none of them is a function of temperature or time.
SLOW_KINDS = {"rate_random_walk", "flicker_noise", "second_markov", "telegraph_noise", "markov_sigma_vs_temperature",
              "markov_tau_vs_temperature", "noise_parameters", "slow_noise"}
FAST_KINDS = {"outliers", "held_samples", "white_noise_vs_temperature", "fast_noise", "quantization", "sinusoid"}
# A cause and its names.  A second process, a random walk and 1/f noise beside the first process have spectra that are
# nearly alike on logs of 2 h: a random walk is a second process of very long time constant (0 nats apart in Whittle's
# divergence), the others are 2 to 30 nats apart.  Their family is right.  Of the others only the member is.
RIGHT = {"rate_random_walk": {"rate_random_walk", "slow_noise"}, "flicker_noise": {"flicker_noise", "slow_noise"},
         "second_markov": {"second_markov", "slow_noise"}}
CAUSES = ["white_noise_vs_temperature", "outliers", "sinusoid", "held_samples", "quantization", "telegraph_noise",
          "markov_sigma_vs_temperature", "markov_tau_vs_temperature", "second_markov", "flicker_noise", "rate_random_walk"]
UNTOUCHED = CAUSES[:5]  # they leave the slow part of the noise as it is


def draw(check, device):
    return np.random.default_rng([SEED, check, device])


# ---- physics


def chamber(rng, seconds):
    t, is_rising = 0.0, rng.random() < 0.5
    degc, at = (COLD if is_rising else HOT), []
    while t < seconds:
        soak_end = t + rng.uniform(150, 700)
        at += [(t, degc), (soak_end, degc)]
        goal = degc + rng.uniform(0.5, 1) * ((HOT if is_rising else COLD) - degc)
        t = soak_end + abs(goal - degc) / rng.uniform(1, 2.5) * 60
        degc, is_rising = goal, not is_rising
    air = np.interp(np.arange(seconds) + 0.5, *zip(*at, (t, degc)))
    damping, wn = rng.uniform(0.5, 0.9), 1 / rng.uniform(25, 60)
    pole = np.exp(wn * complex(-damping, math.sqrt(1 - damping ** 2)))
    a = [1, -2 * pole.real, abs(pole) ** 2]
    return air[0] + lfilter([sum(a)], a, air - air[0])


def process(rng, n, sigma, tau_s):
    """First-order Gauss-Markov, stationary from the start; sigma and tau are numbers or one value per second."""
    drive, phi = rng.standard_normal(n), np.exp(-1 / np.broadcast_to(tau_s, n))
    drive[1:] *= np.sqrt(1 - phi[1:] ** 2)
    if np.ndim(tau_s) == 0:
        return sigma * lfilter([1], [1, -phi[0]], drive)
    for k in range(1, n):
        drive[k] += phi[k] * drive[k - 1]
    return sigma * drive


def power_law(rng, n, exponent):
    """One-sided density f^-exponent up to 4 Hz: a window of a record that is 16 times as long; means of a second."""
    m = 8 * 16 * n
    f = np.fft.rfftfreq(m, 1 / 8)
    scale = np.concatenate([[0], np.sqrt(f[1:] ** -exponent * 8 * m / 4)])
    start = rng.integers(15 * n)
    record = np.fft.irfft(scale * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))), m)
    return record.reshape(16 * n, 8).mean(axis=1)[start:start + n]


def telegraph(rng, n, amplitude, tau_s):
    """Two levels, memoryless dwell times, correlation exp(-t/tau); means of a second."""
    changes, level = [], rng.choice([-1, 1])
    while not changes or changes[-1] < n:
        changes.append((changes[-1] if changes else 0) + rng.exponential(2 * tau_s))
    parts = np.searchsorted(changes, (np.arange(10 * n) + 0.5) / 10)
    return amplitude * level * np.mean((1 - 2 * (parts % 2)).reshape(n, 10), axis=1)


# ---- strength


def spectrum(f, sigma, tau_s):
    """Two-sided, of the process sampled once a second."""
    phi = np.exp(-1 / tau_s)
    return sigma ** 2 * (1 - phi ** 2) / (1 - 2 * phi * np.cos(2 * np.pi * f) + phi ** 2)


def gain_nats(own, degc, added):
    """Expected log-likelihood over the best nominal noise; added(f, own, tn) is the spectrum at normalised temperature
    tn."""
    seconds = int(np.mean([len(t) for t in degc]))
    edges = np.unique(np.round(np.geomspace(2, seconds / 2, 200)).astype(int))
    f, weight = (edges[:-1] + (np.diff(edges) - 1) / 2) / seconds, np.diff(edges) * len(degc)
    n, edge = np.histogram((np.concatenate(degc) - T0_DEGC) / RANGE_DEGC, 8)
    true = np.array([added(f, own, tn) for tn in (edge[1:] + edge[:-1]) / 2])

    def lost(log_p):
        p = np.exp(np.clip(log_p, -10, 14))
        ratio = true / (p[0] ** 2 + spectrum(f, p[1], p[2]))
        return n / n.sum() @ (ratio - 1 - np.log(ratio)) @ weight

    starts = own, (own[0], 2 * own[1], 3 * own[2]), (own[0], 2 * own[1], own[2] / 5)
    return min(minimize(lost, np.log(s), method="Nelder-Mead", options={"fatol": 0.01}).fun for s in starts)


SPECTRA = {  # of cause, strength x and time constant tau
    "rate_random_walk": lambda f, own, tn, x, tau: nominal(f, own) + x ** 2 / (2 * np.sin(np.pi * f)) ** 2,
    "flicker_noise": lambda f, own, tn, x, tau: nominal(f, own) + x ** 2 / (2 * np.pi * f),
    "power_law": lambda f, own, tn, x, tau: nominal(f, own) + x ** 2 / 2 * f ** -1.5,
    "second_markov": lambda f, own, tn, x, tau: nominal(f, own) + spectrum(f, x, tau),
    "markov_sigma_vs_temperature": lambda f, own, tn, x, tau: nominal(f, (own[0], own[1] * np.exp(x * tn / 2), own[2])),
    "markov_tau_vs_temperature": lambda f, own, tn, x, tau: nominal(f, (own[0], own[1], own[2] * np.exp(x * tn))),
    "white_noise_vs_temperature": lambda f, own, tn, x, tau: nominal(f, (own[0] * np.exp(x * tn / 2), *own[1:])),
}
# More is not drawn: the noise of a real sensor does not change by more over temperature.
LARGEST = {"markov_sigma_vs_temperature": 5, "markov_tau_vs_temperature": 4, "white_noise_vs_temperature": 4,
           "flicker_noise": 120}


def nominal(f, own):
    return own[0] ** 2 + spectrum(f, *own[1:])


def strength_for(cause, own, degc, d, tau):
    """The smallest strength that reaches d, or the one that comes nearest: too strong a process hides the first one.

    Returned with its gain, which comes first."""
    best = 0, 0
    for x in np.geomspace(0.05, LARGEST.get(cause, 100), 24):
        best = max(best, (gain_nats(own, degc, lambda f, o, tn: SPECTRA[cause](f, o, tn, x, tau)), x))
        if best[0] >= d ** 2 / 2:
            break
    return best


# ---- devices

GAINS = {}  # nats, of check and device

@functools.cache
def device(check, number, cause, d, seconds=(5000, 9000), n_logs=None, held_out=None):
    """Noise of its own, the logs to be fitted and those held out: (degc, reading, rate) each.

    A random walk is hidden by a slow first process, and so is a slow second one: they need a first one of 8 to 16 s.
    A second process beside a slow one is drawn fast (3 to 6 s)."""
    rng = draw(check, number)
    own = rng.uniform(30, 60), rng.uniform(10, 20), math.exp(rng.uniform(math.log(60), math.log(300)))
    if cause == "rate_random_walk":
        own = rng.uniform(28, 35), rng.uniform(27, 33), rng.uniform(8, 16)
    fitted = n_logs or (5 if cause in SPECTRA else int(rng.integers(1, 6)))
    held_out = int(rng.integers(0, 3)) if held_out is None else held_out
    degc = [chamber(rng, int(rng.integers(*seconds))) for _ in range(fitted + held_out)]
    tau, p = rng.uniform(3, 6), math.exp(rng.uniform(math.log(0.003), math.log(0.02)))
    f_hz = math.exp(rng.uniform(math.log(0.02), math.log(0.45)))
    GAINS[check, number], x = strength_for(cause, own, degc[:fitted], d, tau) if cause in SPECTRA else (None, None)
    coeff, logs, n_all = rng.normal(0, [300, 200, 100, 60]), [], sum(len(t) for t in degc[:fitted])
    for t in degc:
        n, tn, (white, sigma, tau_s) = len(t), (t - T0_DEGC) / RANGE_DEGC, own
        if cause == "white_noise_vs_temperature":
            white = white * np.exp(x * tn / 2)
        if cause == "markov_sigma_vs_temperature":
            sigma = sigma * np.exp(x * tn / 2)
        if cause == "markov_tau_vs_temperature":
            tau_s = tau_s * np.exp(x * tn)
        rate = np.polynomial.polynomial.polyval(tn, coeff) + rng.normal(0, 30)
        rate = rate + white * rng.standard_normal(n) + process(rng, n, sigma, tau_s)
        if cause == "rate_random_walk":
            rate += np.cumsum(x * rng.standard_normal(n))
        if cause == "second_markov":
            rate += process(rng, n, x, tau)
        if cause == "flicker_noise":
            rate += x / math.sqrt(math.pi) * power_law(rng, n, 1)
        if cause == "power_law":
            rate += x * power_law(rng, n, 1.5)
        if cause == "telegraph_noise":
            # 100 dph between the levels, seen in 5 to 20 s beside this noise; dwell times of 400 s and more.
            rate += telegraph(rng, n, 50 + 2 * d, 200 + 100 * tau)
        if cause == "sinusoid":
            rate += d * math.sqrt(2 * nominal(f_hz, own) / n_all) * np.sin(2 * np.pi * (f_hz * np.arange(n) + rng.random()))
        if cause == "outliers":
            # Over 5 deviations: each tells ln(p) + z^2/2, 5 nats and more in the mean; there are over 50.
            rate += np.where(rng.random(n) < p, 5 * white * rng.standard_normal(n), 0)
        if cause == "held_samples":
            for k in np.flatnonzero(rng.random(n) < p):
                rate[k] = rate[max(k - 1, 0)]
        if cause == "quantization":
            rate = white * np.round(rate / white)
        logs.append((t + 0.01 * rng.standard_normal(n), rate))
    return own, logs[:fitted], logs[fitted:]


# ---- files and the programs


def write(folder, logs, name):
    return [write_log(folder / f"{name}{i}.csv", np.arange(1, len(rate) + 1), read, rate, form="%d,%.4f,%.4f")
            for i, (read, rate) in enumerate(logs)]


def model_of(white, *processes):
    return asking.model_of(white, *processes, t0_degc=T0_DEGC, range_degc=RANGE_DEGC)


def fitted_model(logs, model):
    command = [BIN / "errormodel", "fit", "--criterion", "ml", "--markov", "1", "--detrend", "poly:3", "--quiet", "--threads", "1",
               "-o", model, *logs]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=120,
                          env={**os.environ, "OMP_NUM_THREADS": "1"})
    assert done.returncode in (0, 1), done.stderr
    return ["--model", model]


def answer(folder, asked, belief):
    """The axis; a belief is one of BELIEFS or a model."""
    own, fitted, held_out = asked
    fitted, held_out, model = write(folder, fitted, "fit"), write(folder, held_out, "hold"), folder / "model.json"
    if belief == "fitted":
        options = fitted_model(fitted, model)
    elif belief == "none":
        options = []
    else:
        k = {"exact": 1, "x3": 3, "/3": 1 / 3}.get(belief) if isinstance(belief, str) else None
        options = model_option(model, model_of(own[0], (k * own[1], k * own[2])) if k else belief)
    axis, = axes_of(run(DIAGNOSE, options, fitted, held_out)[0])
    return axis


def causes(axis):
    """What is told beside "the believed noise parameters are wrong"."""
    return [name for name in names(axis) if name != "noise_parameters"]


# ---- noise of the believed kind


@pytest.mark.parametrize("belief, devices", [("exact", 1), ("none", 1), *(
    pytest.param(b, 20, marks=pytest.mark.long) for b in ("exact", "fitted", "none"))])
def test_noise_of_the_believed_kind_has_no_name(tmp_path, belief, devices):
    """At the stated rate more than 1 of 20 have a name in 1.7 % of draws, one of 1 in 1 %."""
    told = {}
    for number in range(devices):
        axis = answer(tmp_path, device(1, number, None, 0), belief)
        if axis["verdict"] != "no_gap" or names(axis):
            told[number] = axis["verdict"], names(axis)
    assert len(told) <= (1 if devices == 20 else 0), told


@pytest.mark.parametrize("belief", ["x3", "/3"])
@pytest.mark.parametrize("devices", [1, pytest.param(12, marks=pytest.mark.long)])
def test_a_wrong_belief_is_wrong_noise_parameters_and_nothing_else(tmp_path, belief, devices):
    """A factor of 3 in both is told where Whittle's divergence is over 25 nats; one short log may have less, and then
    may also have no name.  Another cause comes at the stated rate: in over 1 of 12 devices in 0.6 % of draws."""
    told, k = {}, {"x3": 3, "/3": 1 / 3}[belief]
    for number in range(devices):
        own, fitted, held_out = device(2, number, None, 0)
        f = np.arange(1, 2500) / 5000
        ratio = nominal(f, own) / nominal(f, (own[0], k * own[1], k * own[2]))
        can_tell = len(fitted) * np.sum(ratio - 1 - np.log(ratio)) > 25
        axis = answer(tmp_path, (own, fitted, held_out), belief)
        if names(axis) not in ([["noise_parameters"]] if can_tell else [["noise_parameters"], []]):
            told[number] = axis["verdict"], names(axis)
    assert len(told) <= (1 if devices == 12 else 0), told


@pytest.mark.parametrize("devices", [1, pytest.param(16, marks=pytest.mark.long)])
def test_two_believed_processes_that_are_there_have_no_name(tmp_path, devices):
    """Even devices have a second process of 4 to 20 s, odd ones of 600 to 2500 s.  At the stated rate more than 1 of 16
    have a name in 1.1 % of draws, one of 1 in 1 %."""
    told = {}
    for number in range(devices):
        rng, (own, *logs) = draw(3, 1000 + number), device(3, number, None, 0)
        second = (rng.uniform(15, 30), rng.uniform(4, 20)) if number % 2 == 0 else (
            rng.uniform(10, 40), math.exp(rng.uniform(math.log(600), math.log(2500))))
        logs = [[(read, rate + process(rng, len(rate), *second)) for read, rate in part] for part in logs]
        axis = answer(tmp_path, (own, *logs), model_of(own[0], own[1:], second))
        if axis["verdict"] != "no_gap" or names(axis):
            told[number] = second, axis["verdict"], names(axis)
    assert len(told) <= (1 if devices == 16 else 0), told


# ---- kinds of noise that the belief leaves out


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """The answer to a question, asked once."""
    folder = tmp_path_factory.mktemp("noise_kinds")

    @functools.cache
    def ask(cause, number, belief):
        return answer(folder, device(100 + CAUSES.index(cause), number, cause, 25), belief)
    return ask


def questions(numbers, beliefs):
    return [(cause, number, belief) for cause in CAUSES for number in numbers for belief in beliefs]


SHORT = [("white_noise_vs_temperature", 0, "none"), ("outliers", 0, "exact"), ("held_samples", 0, "/3"),
         ("markov_sigma_vs_temperature", 0, "none")]
BOTH = pytest.mark.parametrize("which", [SHORT, pytest.param(questions(range(2), BELIEFS), marks=pytest.mark.long)],
                               ids=["short", "all"])


@BOTH
def test_the_cause_is_named(asked, which):
    """By its member, or by its family where RIGHT says that the logs tell no more.  The answers to one device under five
    beliefs go together: what counts is the device, which is missed where one belief misses it."""
    missed = {}
    for cause, number, belief in which:
        axis = asked(cause, number, belief)
        if not causes(axis) or causes(axis)[0] not in RIGHT.get(cause, {cause}):
            missed.setdefault((cause, number), []).append((belief, axis["verdict"], names(axis)))
    devices = len({q[:2] for q in which})
    assert len(missed) <= (most_by_chance(devices, MISSED) if which is not SHORT else 0), missed


@BOTH
def test_nothing_that_repeats_is_told(asked, which):
    """Of a noise nothing else is named than noise: no memory, no function of temperature or time.  At the stated rate,
    per device."""
    false = {}
    for cause, number, belief in which:
        axis = asked(cause, number, belief)
        if set(names(axis)) - SLOW_KINDS - FAST_KINDS - {"structural", "tone"}:
            false.setdefault((cause, number), []).append((belief, names(axis)))
    assert len(false) <= most_by_chance(len({q[:2] for q in which}), FALSE_ALARM), false


@pytest.mark.long
def test_one_cause_of_the_library_leaves_no_remainder(asked):
    """It is all that these logs have: "explained".  A remainder is told at the stated rate, per device."""
    left = {}
    for cause, number, belief in questions(range(2), BELIEFS):
        axis = asked(cause, number, belief)
        if axis["verdict"] != "explained":
            left.setdefault((cause, number), []).append((belief, axis["verdict"], names(axis), axis["gap"]["remainder"]))
    assert len(left) <= most_by_chance(2 * len(CAUSES), FALSE_ALARM), left


@BOTH
def test_no_held_out_log_is_said_to_be_predicted(asked, which):
    """No other log's noise can be predicted: a shrinkage is not given, or its interval holds zero.  An interval of 95 %
    leaves it out in 5 %."""
    claims = {}
    for cause, number, belief in which:
        gap = asked(cause, number, belief)["gap"]
        if gap["shrinkage"] is not None and gap["ci95"][0] > 0:
            claims.setdefault((cause, number), []).append((belief, gap["shrinkage"], gap["ci95"]))
    assert len(claims) <= most_by_chance(len({q[:2] for q in which}), 0.05), claims


@pytest.mark.long
@pytest.mark.parametrize("belief", ["none", "exact"])
def test_a_fast_second_process_is_slow_noise_under_no_belief_and_the_exact_one(tmp_path, belief):
    """Five logs, 3 to 6 s beside 60 to 300 s.  Asked are devices of d >= 10: 50 nats over the best single process.  A
    program that misses one device of 10, as the README aims at, misses more than 2 of 6 in 1.6 % of draws."""
    missed, asked_of = {}, 0
    for number in range(20):
        own, fitted, _ = device(6, number, "second_markov", 25)
        if GAINS[6, number] < 50 or asked_of == 6:
            continue
        asked_of += 1
        axis = answer(tmp_path, (own, fitted, []), belief)
        if not causes(axis) or causes(axis)[0] not in RIGHT["second_markov"]:
            missed[number] = round(float(GAINS[6, number]), 1), axis["verdict"], names(axis)
    assert asked_of == 6
    assert len(missed) <= most_by_chance(6, 0.1), missed


@pytest.mark.long
def test_the_cause_does_not_change_with_the_belief(asked):
    """The logs are the same: what is told beside "noise_parameters" is too.  0.95 of devices is the README's aim."""
    changed = {}
    for cause in CAUSES:
        for number in range(2):
            told = {belief: tuple(sorted(causes(asked(cause, number, belief)))) for belief in BELIEFS}
            if len(set(told.values())) > 1:
                changed[cause, number] = told
    assert len(changed) <= most_by_chance(2 * len(CAUSES), 0.05), changed


@pytest.mark.parametrize("cause", [c if c == "outliers" else pytest.param(c, marks=pytest.mark.long) for c in UNTOUCHED])
def test_an_exact_belief_is_not_called_wrong_beside_fast_noise(asked, cause):
    """White noise and first process are exactly as believed, and the cause does not change them.  Three parameters that
    are fitted anew gain a chi-square of three degrees of freedom, halved: over 7 nats, which a name must gain, in 0.3 %
    of devices."""
    for number in range(1 if cause == "outliers" else 2):
        axis = asked(cause, number, "exact")
        assert "noise_parameters" not in names(axis), [(e["name"], e["parameters"]) for e in axis["effects"]]


@pytest.mark.parametrize("belief", ["none", *(pytest.param(b, marks=pytest.mark.long) for b in ("exact", "x3", "/3", "fitted"))])
def test_noise_of_f_to_the_minus_1_5_is_slow_noise_or_left_open(tmp_path, belief):
    """Outside of the library, between flicker noise and random walk: no cause of another kind."""
    for number in range(1 if belief == "none" else 3):
        axis = answer(tmp_path, device(5, number, "power_law", 15, n_logs=3), belief)
        assert axis["verdict"] != "no_gap"
        assert set(names(axis)) <= SLOW_KINDS, names(axis)
