# SPDX-License-Identifier: MIT
"""Devices of three axes: one sick axis between healthy ones, what the axes share, what one axis follows, a lost axis.

A chamber goes by ramps of 1.5 to 3 degC/min and soaks between -20 and 60 degC and overshoots; a row is a second, a log
5000 to 9000 of them, a device has 2 to 4 logs and up to 2 held-out ones.  The bias of an axis is a cubic of the
temperature, with a constant of its own in every log; its noise is white noise and one first-order process.  The
thermometer has a noise of 0.01 degC.  Whatever remembers starts every log with a past of its own.  All of it is
simulated by this file; no code is shared with the programs.

The strength d of a cause is the square root of twice the log-likelihood that the fitted logs gain, on the average, to
who knows its form and the noise, beside a free cubic and free constants: generalised least squares (whitened).
Seeds were chosen before the first run, limits by the chances that are stated.  `make test` asks some of the devices,
`make test-long` the others."""
import math
import re

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.signal import lfilter

from asking import DIAGNOSE, axes_of, model_of, model_option, most_by_chance, names, run, write_log

SEED = 20270824
COLD, HOT = -20.0, 60.0
AXES = ["gx", "gy", "gz"]
FALSE_ALARM = 0.01  # stated by the program: a name where there is no gap, all axes of a question counted
MISSED = 0.05  # of causes that are clearly visible
MISSED_WEAK = 0.10  # of causes of d = 7 to 12

FAMILY = {"play": "thermal_memory", "preisach": "thermal_memory", "lag": "thermal_memory", "creep": "thermal_memory",
          "rate": "thermal_memory", "warm_up": "function_of_time", "bump": "function_of_temperature"}
CAUSES = list(FAMILY)


def draw(*question):
    return np.random.default_rng([SEED, *question])


# ---- physics


def follows(x, tau_s, start=None):
    """A body that is warmed by another one: Newton cooling, settled at the start or at a temperature of its own."""
    phi = math.exp(-1 / tau_s)
    out, _ = lfilter([1 - phi], [1, -phi], x, zi=[phi * (x[0] if start is None else start)])
    return out


def chamber(rng):
    """The temperature of the device, every second: soaks and ramps in turn, air that overshoots, a body behind it."""
    n = int(rng.integers(5000, 9001))
    t, degc = 0.0, rng.choice([COLD, HOT, 20.0])
    is_rising, at = degc < HOT and (degc == COLD or rng.random() < 0.5), []
    while t < n:
        soak_end = t + rng.uniform(200, 800)
        at += [(t, degc), (soak_end, degc)]
        goal = degc + rng.uniform(0.6, 1) * ((HOT if is_rising else COLD) - degc)
        t = soak_end + abs(goal - degc) / rng.uniform(1.5, 3) * 60
        degc, is_rising = goal, not is_rising
    wanted = np.interp(np.arange(n) + 0.5, *zip(*at, (t, degc)))
    pole = 2 * math.pi / rng.uniform(300, 600) * np.exp(1j * math.acos(rng.uniform(0.5, 0.8)))  # 2 to 16 %
    step = np.exp(-pole)
    a = np.array([1, -2 * step.real, abs(step) ** 2])
    air = wanted[0] + lfilter([a.sum()], a, wanted - wanted[0])
    return follows(air, rng.uniform(30, 80))


def before(rng, degc):
    """The past of a device: a few temperatures that it went to before the log, and the first one of the log."""
    ends = [*rng.uniform(COLD, HOT, 3), degc[0]]
    return np.concatenate([np.linspace(a, b, 60) for a, b in zip(ends, ends[1:])])


def play(degc, radius, past):
    """Backlash: follows the temperature when pushed.  What is returned lies within +-radius of the temperature."""
    x, path = past[0], np.concatenate([past, degc])
    out = np.empty(len(path))
    for i, value in enumerate(path):
        x = min(max(x, value - radius), value + radius)
        out[i] = x
    return out[len(past):]


def preisach(degc, rng_device, past):
    """400 relays, each with a centre and a half-width of its own; up or down is +-1, their mean is returned."""
    centre, half = rng_device.uniform(COLD - 5, HOT + 5, 400), rng_device.uniform(3, 15, 400)
    path, state, last = np.concatenate([past, degc]), np.where(past[0] > centre, 1.0, -1.0), None
    out = np.empty(len(path))
    for i, value in enumerate(path):
        if last is None or abs(value - last) > 0.02:
            state = np.where(value > centre + half, 1.0, np.where(value < centre - half, -1.0, state))
            last, mean = value, state.mean()
        out[i] = mean
    return out[len(past):]


def cubic(degc, coeff):
    return np.polynomial.polynomial.polyval((degc - 20) / 40, coeff)


def shapes(cause, rng, runs, coeff, is_weak=False):
    """What the cause adds to the bias in every run, of a size that is set later.  A lag adds B(behind) - B(read)."""
    own = np.random.default_rng(rng.integers(2 ** 32))
    half, tau = rng.uniform(4, 10), math.exp(rng.uniform(*np.log([300, 1200])))
    centre, width = rng.uniform(0, 40), rng.uniform(3, 7)
    lag, out = rng.uniform(*((40, 120) if is_weak else (100, 500))), []
    taus = np.geomspace(60, 4000, 8)
    relays = own.integers(2 ** 32)
    for degc in runs:
        past, wait = before(rng, degc), math.exp(rng.uniform(*np.log([60, 4000])))
        if cause == "play":
            x = degc - play(degc, half, past)
        elif cause == "preisach":
            x = preisach(degc, np.random.default_rng(relays), past)
        elif cause == "lag":
            x = cubic(follows(degc, lag, degc[0] + rng.normal(0, 4)), coeff) - cubic(degc, coeff)
        elif cause == "creep":
            x = degc - np.mean([follows(degc, s, degc[0] + (past[0] - degc[0]) * math.exp(-wait / s)) for s in taus], 0)
        elif cause == "rate":
            x = np.gradient(degc) * 60
        elif cause == "warm_up":
            x = rng.uniform(0.5, 1) * np.exp(-np.arange(len(degc)) / tau)
        elif cause == "bump":
            x = np.exp(-0.5 * ((degc - centre) / width) ** 2)
        out.append(x)
    return out


def noise(rng, n, white, slow, tau_s):
    phi = math.exp(-1 / tau_s)
    drive = slow * rng.standard_normal(n)
    drive[1:] *= math.sqrt(1 - phi ** 2)
    return white * rng.standard_normal(n) + lfilter([1], [1, -phi], drive)


def draw_noise(rng):
    """White (dph per second's mean), slow (dph) and its time constant (s)."""
    return rng.uniform(30, 60), rng.uniform(10, 20), math.exp(rng.uniform(*np.log([60, 300])))


# ---- generalised least squares


def whitened(x, white, slow, tau_s):
    """White plus first-order noise of these parameters comes out white with a standard deviation of 1."""
    phi = math.exp(-1 / tau_s)
    q, r = slow ** 2 * (1 - phi ** 2), white ** 2
    b = r * (1 - phi ** 2) - q
    s = (-b + math.sqrt(b * b + 4 * q * r)) / 2 + r
    return lfilter([1, -phi], [1, -phi * r / s], x, axis=0) / math.sqrt(s)


def nuisance(runs):
    """Free constants of the runs and one free cubic."""
    x = []
    for i, degc in enumerate(runs):
        u = (degc - 20) / 40
        x.append(np.column_stack([*(np.full(len(u), float(i == k)) for k in range(len(runs))), u, u ** 2, u ** 3]))
    return x


def strength(signals, runs, own):
    a = np.concatenate([whitened(x, *own) for x in nuisance(runs)])
    b = np.concatenate([whitened(x, *own) for x in signals])
    left = b - a @ np.linalg.lstsq(a, b, rcond=None)[0]
    return math.sqrt(left @ left)


# ---- devices


class Device:
    """Logs of three axes in memory: runs (temperatures), what every axis reads in them, and the noise of each axis."""

    def __init__(self, rng, is_one_noise=True):
        self.n_fitted, n_held_out = int(rng.integers(2, 5)), int(rng.integers(0, 3))
        self.runs = [chamber(rng) for _ in range(self.n_fitted + n_held_out)]
        one = draw_noise(rng)
        self.noise = {a: one if is_one_noise else draw_noise(rng) for a in AXES}
        self.coeff = {a: rng.normal(0, [300, 300, 150, 80]) for a in AXES}
        self.rates = {a: [cubic(t, self.coeff[a]) + rng.normal(0, 30) + noise(rng, len(t), *self.noise[a])
                          for t in self.runs] for a in AXES}
        self.auxiliary, self.causes, self.added = {}, {}, {}

    def add(self, axis, cause, signals, d=None):
        """The signals, made d strong."""
        fitted = slice(self.n_fitted)
        scale = d / strength(signals[fitted], self.runs[fitted], self.noise[axis]) if d else 1
        self.rates[axis] = [y + scale * x for y, x in zip(self.rates[axis], signals)]
        self.causes[axis], self.added[axis] = cause, [scale * x for x in signals]

    def add_cause(self, rng, axis, cause, d):
        """A lag of this strength comes from the slope of the cubic: the cubic grows with it."""
        old = self.coeff[axis] * [0, 1, 1, 1]
        old[1] = math.copysign(max(abs(old[1]), 150), old[1])
        signals = shapes(cause, rng, self.runs, old, is_weak=d < 15)
        sign = rng.choice([-1, 1])
        self.add(axis, cause, [sign * x for x in signals], d)
        if cause == "lag":
            fitted = slice(self.n_fitted)
            scale = sign * d / strength(signals[fitted], self.runs[fitted], self.noise[axis])
            self.rates[axis] = [y + cubic(t, scale * old) - cubic(t, self.coeff[axis] * [0, 1, 1, 1])
                                for y, t in zip(self.rates[axis], self.runs)]

    def write(self, folder, rng, axes=AXES):
        """Logs and held-out logs; not a number is a missing rate."""
        files = []
        for i, degc in enumerate(self.runs):
            read = degc + 0.01 * rng.standard_normal(len(degc))
            names = [*(a + "_dph" for a in axes), *self.auxiliary]
            columns = [*(self.rates[a][i] for a in axes), *(v[i] for v in self.auxiliary.values())]
            files.append(write_log(folder / f"run{i}.csv", np.arange(1, len(degc) + 1), read, *columns, axes=names,
                                   form="%d" + ",%.4f" * (1 + len(names))))
        return files[:self.n_fitted], files[self.n_fitted:]


def believed(device, belief, rng):
    """The model of a belief: exact, wrong by 3 in sigma and tau, or None."""
    own = device.noise["gx"]
    if belief == "wrong":
        own = own[0], own[1] * rng.choice([1 / 3, 3]), own[2] * rng.choice([1 / 3, 3])
    return None if belief == "absent" else model_of(own[0], own[1:])


def diagnose(folder, logs, held_out=(), model=None, *more):
    """The whole answer."""
    done, command = run(DIAGNOSE, [*model_option(folder / "model.json", model), *more], logs, held_out, timeout_s=240)
    (folder / "command.txt").write_text(command + "\n")
    (folder / "answer.json").write_text(done.stdout)
    return {axis["axis"].removesuffix("_dph"): axis for axis in axes_of(done)}


def first_family(axis):
    return axis["effects"][0]["family"] if axis["effects"] else axis["verdict"]


def ask(device, belief, folder, rng):
    folder.mkdir(parents=True, exist_ok=True)
    logs, held_out = device.write(folder, rng)
    return diagnose(folder, logs, held_out, believed(device, belief, rng))


# ---- the devices of the questions


BELIEFS = ["exact", "wrong", "absent"]


def one_sick(cause, k):
    """One axis with a cause of d = 35 to 70, two healthy ones."""
    rng = draw(1, CAUSES.index(cause), k)
    device, sick = Device(rng), AXES[rng.integers(3)]
    device.add_cause(rng, sick, cause, math.exp(rng.uniform(*np.log([35, 70]))))
    return device, rng


def all_healthy(k, is_one_noise):
    rng = draw(2, k)
    return Device(rng, is_one_noise), rng


def all_weak(cause, k):
    """The same cause on all axes, d = 7 to 12, its sign and size by axis; play, relays and past are each axis' own."""
    rng = draw(3, CAUSES.index(cause), k)
    device = Device(rng)
    for axis in AXES:
        device.add_cause(rng, axis, cause, rng.uniform(7, 12))
    return device, rng


PAIRS = [("lag", "warm_up"), ("play", "bump"), ("creep", "warm_up"), ("rate", "bump"), ("preisach", "lag"),
         ("warm_up", "bump")]


def two_sick(k):
    rng = draw(4, k)
    device, axes = Device(rng), rng.permutation(AXES)
    for axis, cause in zip(axes, PAIRS[k % len(PAIRS)]):
        device.add_cause(rng, axis, cause, math.exp(rng.uniform(*np.log([35, 70]))))
    return device, rng


def shared_noise(k):
    """White noise that all axes read, 0.5 to 0.8 of the white noise of each."""
    rng = draw(5, 0, k)
    device = Device(rng)
    shared = rng.uniform(0.5, 0.8) * device.noise["gx"][0]
    common = [shared * rng.standard_normal(len(t)) for t in device.runs]
    for axis in AXES:
        device.add(axis, "common", common)
    return device, rng


def slow_noise(kind, k):
    """One axis jumps between two levels 80 to 120 dph apart, after 200 to 400 s on the average, or walks at random by
    1 to 2 dph per root second."""
    rng = draw(5, 1 + ["telegraph", "walk"].index(kind), k)
    device, sick, signals = Device(rng), AXES[rng.integers(3)], []
    step, dwell, pace = rng.uniform(80, 120), rng.uniform(200, 400), rng.uniform(1, 2)
    for degc in device.runs:
        if kind == "telegraph":
            signals.append(step * ((np.cumsum(rng.random(len(degc)) < 1 / dwell) + rng.integers(2)) % 2))
        else:
            signals.append(pace * np.cumsum(rng.standard_normal(len(degc))))
    device.add(sick, kind, signals)
    return device, rng


def supply(rng, n):
    """Volts: a level of the day, load steps of 20 to 100 mV, slow wander and the noise of the converter."""
    steps = np.interp(np.arange(n), np.sort(rng.uniform(0, n, 12)), rng.uniform(-0.1, 0.1, 12), left=0)
    held = np.repeat(rng.uniform(-0.1, 0.1, n // 400 + 1), 400)[:n]
    return 5 + rng.normal(0, 0.02) + steps / 2 + held + 0.002 * rng.standard_normal(n)


def acceleration(rng, n):
    """g: rests at the gravity of the pose of the day, with a table that creeps and a noise of 1 mg."""
    pose, creep = rng.normal(0, 0.01), 0.01 * np.cumsum(rng.standard_normal(n)) / math.sqrt(n)
    return pose + creep + 0.001 * rng.standard_normal(n)


def second_thermometer(degc, rng):
    """degC: on the board, 90 s behind and 3 degC warmer."""
    return follows(degc, 90) + 3 + 0.05 * rng.standard_normal(len(degc))


def with_a_column(k, is_followed):
    """A supply voltage (even devices) or an acceleration beside the rates; followed, d = 35 to 70, by one axis or none.
    Where nobody follows, a third of the devices has a second thermometer in its place."""
    rng = draw(6, int(is_followed), k)
    device = Device(rng)
    if not is_followed and k % 3 == 2:
        device.auxiliary["board_degc"] = [second_thermometer(t, rng) for t in device.runs]
    elif k % 2 == 0:
        device.auxiliary["supply_v"] = [supply(rng, len(t)) for t in device.runs]
    else:
        device.auxiliary["ax_g"] = [acceleration(rng, len(t)) for t in device.runs]
    if is_followed:
        (column,) = device.auxiliary.values()
        follower, d = AXES[rng.integers(3)], math.exp(rng.uniform(*np.log([35, 70])))
        device.add(follower, "auxiliary", [x - x[0] for x in column], d)
    return device, rng


LOST = ["stuck", "stuck_half", "empty", "empty_half", "holes", "zero"]


def one_lost(k):
    """gx, gy or gz is lost in a way of the list, one of the others has a strong cause, the last is healthy."""
    rng = draw(7, k)
    device, (lost, sick, _), way = Device(rng), rng.permutation(AXES), LOST[k % len(LOST)]
    device.add_cause(rng, sick, ["lag", "bump", "warm_up", "play"][k % 4], math.exp(rng.uniform(*np.log([35, 70]))))
    for i, y in enumerate(device.rates[lost]):
        y, n = y.copy(), len(y)
        if way in ("stuck", "zero"):
            y[:] = 123.0 if way == "stuck" else 0.0
        elif way == "empty" or (way == "empty_half" and i % 2 == 0):
            y[:] = math.nan
        elif way in ("stuck_half", "empty_half"):
            y[n // 2:] = y[n // 2] if way == "stuck_half" else math.nan
        elif way == "holes":
            y[rng.random(n) < 0.7] = math.nan
        device.rates[lost][i] = y
    device.causes[lost] = way
    return device, rng


# ---- one sick axis between healthy ones


# Noise parameters that are off are what a wrong model has.
HEALTHY_NAMES = {"exact": set(), "absent": set(), "wrong": {"noise_parameters"}}
ALL = [(cause, k) for cause in CAUSES for k in (0, 1)]


def not_healthy(device, belief, answer):
    """The axes without a cause that get a name, or a gap where the model holds or none is given."""
    told = {a: names(answer[a]) or answer[a]["verdict"] for a in AXES if a not in device.causes}
    return {a: t for a, t in told.items()
            if t != "no_gap" and not (isinstance(t, list) and set(t) <= HEALTHY_NAMES[belief])}


@pytest.mark.parametrize("belief, asked", [
    pytest.param("exact", [("rate", 1)], id="exact-some"), pytest.param("wrong", [("warm_up", 1)], id="wrong-some"),
    *(pytest.param(belief, ALL, id=f"{belief}-all", marks=pytest.mark.long) for belief in BELIEFS)])
def test_a_sick_axis_is_named_and_its_neighbours_are_not(tmp_path, belief, asked):
    """d = 35 to 70 is 600 nats and more.  Of 14 devices more than 3 are missed in 0.4 % of draws at the rate of 5 %;
    false names on a healthy axis, in more than 1 device at the stated rate in 0.8 %.  A name beside the cause on the
    sick axis is false as well, but for Preisach's relays, which are more than one play."""
    missed, false, beside = {}, {}, {}
    for cause, k in asked:
        device, rng = one_sick(cause, k)
        answer = ask(device, belief, tmp_path / f"{cause}{k}", rng)
        (sick,) = device.causes
        families = [e["family"] for e in answer[sick]["effects"] if e["name"] not in HEALTHY_NAMES[belief]]
        if families[:1] != [FAMILY[cause]]:
            missed[cause, k] = names(answer[sick])
        elif len(families) > 1 and cause != "preisach":
            beside[cause, k] = names(answer[sick])
        false.update({(cause, k, a): told for a, told in not_healthy(device, belief, answer).items()})
    n = len(asked)
    assert len(missed) <= (most_by_chance(n, MISSED) if n > 1 else 0), missed
    assert len({key[:2] for key in false}) <= (most_by_chance(n, FALSE_ALARM) if n > 1 else 0), false
    assert len(beside) <= (most_by_chance(n, FALSE_ALARM) if n > 1 else 0), beside


@pytest.mark.parametrize("k", [0, 1])
@pytest.mark.long
def test_healthy_neighbours_get_what_they_get_alone(tmp_path, k):
    """A healthy axis has no gap if it is asked for by --axis beside a sick one that is in the logs only."""
    device, rng = one_sick("play", k)
    logs, held_out = device.write(tmp_path, rng)
    healthy = [a for a in AXES if a not in device.causes]
    model = believed(device, "exact", rng)
    answer = diagnose(tmp_path, logs, held_out, model, "--axis", *(a + "_dph" for a in healthy))
    assert sorted(answer) == healthy
    assert not not_healthy(device, "exact", {**answer, **dict.fromkeys(device.causes)})


# ---- bumps of every width


@pytest.mark.parametrize("belief", ["exact", "absent"])
@pytest.mark.long
def test_a_bump_is_an_anomaly_whatever_its_width(tmp_path, belief):
    """Three bumps of d = 50, with standard deviations of 5.5, 6.5 and 7.5 degC (the library states 0.05 to 200), one
    on each axis.  The Gaussian is what the device does, so a free curve gains nothing beside it but noise; terms of
    the fourth and fifth order fall short of it by 100 nats and more.  Of 12 more than 3 are missed in 0.2 % of draws
    at the rate of 5 %."""
    missed = {}
    for k in range(4):
        rng = draw(8, k)
        device = Device(rng)
        for axis, width in zip(AXES, (5.5, 6.5, 7.5)):
            centre = rng.uniform(10, 30)
            device.add(axis, "bump", [np.exp(-0.5 * ((t - centre) / width) ** 2) for t in device.runs], 50)
        assert all(lost_by_two_more_orders(device, axis) > 100 for axis in AXES)
        answer = ask(device, belief, tmp_path / str(k), rng)
        for axis, width in zip(AXES, (5.5, 6.5, 7.5)):
            if names(answer[axis]) != ["thermal_anomaly"] or answer[axis]["verdict"] != "explained":
                missed[k, width] = answer[axis]["verdict"], names(answer[axis])
    assert len(missed) <= most_by_chance(12, MISSED), missed


def lost_by_two_more_orders(device, axis):
    """Nats of the added bias that a polynomial of the fifth order cannot follow, with the noise known."""
    n, own = device.n_fitted, device.noise[axis]
    x = [np.column_stack([a, ((t - 20) / 40) ** 4, ((t - 20) / 40) ** 5])
         for a, t in zip(nuisance(device.runs[:n]), device.runs)]
    a = np.concatenate([whitened(v, *own) for v in x])
    b = np.concatenate([whitened(v, *own) for v in device.added[axis][:n]])
    left = b - a @ np.linalg.lstsq(a, b, rcond=None)[0]
    return left @ left / 2


# ---- healthy axes


@pytest.mark.parametrize("is_one_noise, ks", [
    pytest.param(True, range(1), id="model-some"),
    pytest.param(True, range(12), id="model-all", marks=pytest.mark.long),
    pytest.param(False, range(100, 112), id="absent-all", marks=pytest.mark.long)])
def test_three_healthy_axes_have_no_names(tmp_path, is_one_noise, ks):
    """With the exact model; without one, every axis with a noise of its own.  At the stated rate names come in more
    than 1 of 12 devices in 0.6 % of draws."""
    false = {}
    for k in ks:
        device, rng = all_healthy(k, is_one_noise)
        belief = "exact" if is_one_noise else "absent"
        told = not_healthy(device, belief, ask(device, belief, tmp_path / str(k), rng))
        if told:
            false[k] = told
    assert len(false) <= (most_by_chance(len(ks), FALSE_ALARM) if len(ks) > 1 else 0), false


# ---- the same weak cause on all axes


@pytest.mark.parametrize("belief", ["exact", "absent"])
@pytest.mark.long
def test_a_weak_cause_of_all_axes_is_named(tmp_path, belief):
    """d = 7 to 12 on each axis.  The logs can tell where the true form gains 20 nats beside noise that is fitted to the
    same logs; only such axes count.  Of 30 more than 7 are missed in 1 % of draws at the rate of 10 %."""
    told = {}
    for cause, k in ALL:
        device, rng = all_weak(cause, k)
        answer = ask(device, belief, tmp_path / f"{cause}{k}", rng)
        for axis in AXES:
            if gain_beside_free_noise(device, axis) >= 20:
                told[cause, k, axis] = first_family(answer[axis])
    missed = {key: family for key, family in told.items() if family != FAMILY[key[0]]}
    assert len(missed) <= most_by_chance(len(told), MISSED_WEAK), missed


def log_likelihood(noise_of, ys, xs):
    white, slow, tau_s = noise_of
    phi = math.exp(-1 / tau_s)
    a = np.concatenate([whitened(x, *noise_of) for x in xs])
    b = np.concatenate([whitened(y, *noise_of) for y in ys])
    left = b - a @ np.linalg.lstsq(a, b, rcond=None)[0]
    q, r = slow ** 2 * (1 - phi ** 2), white ** 2
    c = r * (1 - phi ** 2) - q
    return -0.5 * (left @ left + len(left) * math.log((-c + math.sqrt(c * c + 4 * q * r)) / 2 + r))


def gain_beside_free_noise(device, axis):
    """Nats that the true form gains, of a free size, the noise's three parameters fitted with it and without it."""
    n = device.n_fitted
    ys, without = device.rates[axis][:n], nuisance(device.runs[:n])
    with_it = [np.column_stack([x, s]) for x, s in zip(without, device.added[axis])]

    def best(xs):
        def cost(x):
            return -log_likelihood(np.exp(x), ys, xs) if np.all(np.abs(x - start) < 4) else 1e12
        start = np.log(device.noise[axis])
        return -minimize(cost, start, method="Nelder-Mead", options={"maxfev": 100, "xatol": 1e-2, "fatol": 0.05}).fun
    return best(with_it) - best(without)


# ---- two axes with a cause each


@pytest.mark.parametrize("belief, ks", [pytest.param("exact", range(6), id="exact", marks=pytest.mark.long),
                                        pytest.param("absent", range(6), id="absent", marks=pytest.mark.long)])
def test_two_axes_with_causes_of_their_own(tmp_path, belief, ks):
    """Of 12 causes more than 3 are missed in 0.2 % of draws at the rate of 5 %; a false name on the third axis in more
    than 1 of 6 in 0.1 %."""
    missed, false = {}, {}
    for k in ks:
        device, rng = two_sick(k)
        answer = ask(device, belief, tmp_path / str(k), rng)
        for axis, cause in device.causes.items():
            if first_family(answer[axis]) != FAMILY[cause]:
                missed[k, axis, cause] = names(answer[axis])
        if not_healthy(device, belief, answer):
            false[k] = not_healthy(device, belief, answer)
    assert len(missed) <= most_by_chance(2 * len(ks), MISSED), missed
    assert len(false) <= most_by_chance(len(ks), FALSE_ALARM), false


# ---- noise: shared, between two levels, at random


@pytest.mark.parametrize("belief, k", [
    pytest.param(belief, k, marks=[pytest.mark.long] * ((belief, k) != ("absent", 0)))
    for belief in ("absent", "exact") for k in range(3)])
def test_shared_white_noise_is_common_mode_on_every_axis(tmp_path, belief, k):
    """A correlation of 0.2 to 0.4 between rates of over 10,000 seconds is 20 of its standard errors and more.  The
    white noise of the exact model is that without the shared part: its parameters are off too, and may be named."""
    device, rng = shared_noise(k)
    answer = ask(device, belief, tmp_path, rng)
    own = device.noise["gx"][0]
    shared = np.std(np.concatenate(device.added["gx"][:device.n_fitted]))
    for axis in AXES:
        assert set(names(answer[axis])) - {"noise_parameters", "slow_noise"} == {"common_mode"}, names(answer[axis])
        (common,) = (e for e in answer[axis]["effects"] if e["name"] == "common_mode")
        # Two neighbours estimate it to 3 %; the slow noise is in the rates but not in the shared part.
        assert common["parameters"]["sigma_dph"] == pytest.approx(shared, rel=0.1)
        told = float(re.search(r"correlation (-?[\d.]+)", common["statement"])[1])
        assert told == pytest.approx(shared ** 2 / (shared ** 2 + own ** 2), abs=0.05)


@pytest.mark.parametrize("kind", ["telegraph", "walk"])
@pytest.mark.parametrize("k", [0, 1, 2])
@pytest.mark.long
def test_slow_noise_of_one_axis_stays_there(tmp_path, kind, k):
    """Beside the exact model either gains 40 nats and more, which no shape in time or temperature does.  Levels 80 dph
    apart are told from Gaussian noise.  Without a model a walk is not asked for: one process with free parameters fits
    it as well to 4 nats (computed)."""
    device, rng = slow_noise(kind, k)
    answer = ask(device, "exact", tmp_path, rng)
    (sick,) = device.causes
    assert first_family(answer[sick]) == "slow_noise"
    assert kind == "walk" or "telegraph_noise" in names(answer[sick])
    assert not not_healthy(device, "exact", answer)


# ---- an auxiliary column


@pytest.mark.parametrize("belief, k", [
    pytest.param(belief, k, marks=[pytest.mark.long] * ((belief, k) != ("absent", 1)))
    for belief in ("exact", "absent") for k in range(3)])
def test_the_column_that_one_axis_follows_is_named(tmp_path, belief, k):
    """d = 35 to 70; the gain is estimated to 1/d.  The column is named, the gain within five of its errors."""
    device, rng = with_a_column(k, True)
    answer = ask(device, belief, tmp_path, rng)
    (sick,), ((column, values),) = device.causes, device.auxiliary.items()
    assert names(answer[sick]) == ["auxiliary_channel"]
    effect = answer[sick]["effects"][0]
    true = np.ptp(device.added[sick][0]) / np.ptp(values[0])
    true *= np.sign(np.corrcoef(device.added[sick][0], values[0])[0, 1])
    assert effect["parameters"]["gain"] == pytest.approx(true, rel=5 / 35)
    assert effect["parameters"]["channel"] == column
    assert not not_healthy(device, belief, answer)


@pytest.mark.parametrize("belief", ["exact", "absent"])
@pytest.mark.long
def test_a_column_that_nobody_follows_is_not_named(tmp_path, belief):
    """Supply, acceleration, a second thermometer.  At the stated rate more than 1 of 6 devices in 0.1 % of draws."""
    false = {}
    for k in range(6):
        device, rng = with_a_column(k, False)
        told = not_healthy(device, belief, ask(device, belief, tmp_path / str(k), rng))
        if told:
            false[k] = told
    assert len(false) <= most_by_chance(6, FALSE_ALARM), false


# ---- a lost axis


@pytest.mark.parametrize("k", [pytest.param(k, marks=[pytest.mark.long] * (k != 2)) for k in range(len(LOST))])
def test_the_good_axes_beside_a_lost_one_are_answered(tmp_path, k):
    """All the time stuck, from the half on, empty, empty in every second log, 7 of 10 seconds missing, zero: the lost
    axis has no effect on what the others get, and no cause of physics, but for the one with holes, which is healthy."""
    device, rng = one_lost(k)
    answer = ask(device, "exact", tmp_path, rng)
    assert sorted(answer) == AXES
    for axis, cause in device.causes.items():
        if cause in FAMILY:
            assert first_family(answer[axis]) == FAMILY[cause]
        elif cause in ("stuck", "zero", "empty"):
            assert answer[axis]["refused"] and not names(answer[axis])
        elif cause != "holes":  # a name of 1 in 100 is within the stated rate
            assert answer[axis].get("refused") or set(names(answer[axis])) <= {"held_samples"}
    assert not not_healthy(device, "exact", answer)
