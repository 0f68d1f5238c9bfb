# SPDX-License-Identifier: MIT
"""One or two fitted logs, two or three held-out ones of other profiles: is the cause named, is what is told true?

A chamber goes by ramps of 1 to 2.5 degC/min and soaks between -20 and 60 degC; its controller overshoots, and a body
follows it.  A row is a second.  The bias is a cubic of the temperature, with a constant of its own in every log; the
noise is white noise and one first-order process; the state of everything is random at the start of a run.  The effect
is as strong as makes sqrt(2 * gain in log-likelihood) 15 to 25 in all logs together, to who knows the noise; the start
of a memory, the constants, the cubic and the first state of the noise are free there.  All of it is simulated by this
file; no code is shared with the programs.  Every fourth device has the model with exactly its noise, the others have
none.  Seeds were chosen before the first run, limits by the chances that are stated.  `make test` asks some of the
devices, `make test-long` all."""
import itertools
import math

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter, lfilter_zi

from asking import DIAGNOSE, axes_of, model_of, model_option, most_by_chance, run, write_log

SEED = 20270819
COLD, HOT = -20.0, 60.0
TRUE = {"play": "thermal_hysteresis", "lag": "thermal_lag", "rate": "temperature_rate", "creep": "thermal_creep",
        "bump": "thermal_anomaly", "warm_up": "warm_up"}
CAUSES, CONTROLS = list(TRUE), ["nothing", "slow_noise"]
DEVICES, HEALTHY = 8, 20
FALSE_ALARM = 0.01  # stated by the program


# ---- physics


def follows(x, tau_s, start=0.0):
    """Newton cooling; at first the body is `start` off."""
    phi = math.exp(-1 / tau_s)
    return x[0] + lfilter([1 - phi], [1, -phi], x - x[0]) + start * phi ** np.arange(len(x))


def chamber(rng, seconds):
    """From one end, soaks and ramps in turn; a ramp goes six tenths of the way to the other end or more."""
    t, degc, is_rising, at = 0.0, COLD + rng.uniform(0, 8), True, []
    if rng.random() < 0.5:
        degc, is_rising = HOT - rng.uniform(0, 8), False
    while t < seconds:
        soak_end = t + rng.uniform(200, 900)
        at += [(t, degc), (soak_end, degc)]
        goal = degc + rng.uniform(0.6, 1) * ((HOT if is_rising else COLD) - degc)
        t = soak_end + abs(goal - degc) / rng.uniform(1, 2.5) * 60
        degc, is_rising = goal, not is_rising
    wanted = np.interp(np.arange(seconds) + 0.5, *zip(*at, (t, degc)))
    w, zeta = 2 * math.pi / rng.uniform(200, 500), rng.uniform(0.5, 0.8)
    b, a = bilinear([2 * zeta * w, w * w], [1, 2 * zeta * w, w * w], 1.0)  # a controller that overshoots
    air, _ = lfilter(b, a, wanted, zi=lfilter_zi(b, a) * wanted[0])
    return follows(air, rng.uniform(40, 90), rng.normal(0, 2))


def play(degc, width, start):
    """Backlash: it stays until the temperature has gone `width` off, then it is dragged."""
    out, p = np.empty(len(degc)), degc[0] + start * width
    for i, t in enumerate(degc):
        p = min(max(p, t - width), t + width)
        out[i] = (p - t) / width
    return out


def cubic(degc, coeff):
    return np.polynomial.polynomial.polyval((degc - 20) / 40, coeff)


def effect_of(cause, rng, runs, coeff):
    """What the cause does in every log at strength 1, and the same from a start that is settled."""
    if cause == "play":
        width = rng.uniform(2, 8)
        return [[play(t, width, s) for t in runs] for s in (rng.uniform(-1, 1), 0.0)]
    if cause == "lag":
        tau = math.exp(rng.uniform(math.log(60), math.log(500)))
        off = rng.normal(0, 4, len(runs))
        return [[cubic(follows(t, tau, o * s), coeff) - cubic(t, coeff) for t, o in zip(runs, off)] for s in (1, 0)]
    if cause == "creep":
        taus = np.geomspace(60, 4000, 6)
        off = rng.normal(0, 6, (len(runs), len(taus)))
        return [[np.mean([t - follows(t, tau, x * s) for tau, x in zip(taus, o)], axis=0) for t, o in zip(runs, off)]
                for s in (1, 0)]
    if cause == "rate":
        one = [60 * np.gradient(t) for t in runs]
    elif cause == "bump":  # where the first log goes through
        low, high = runs[0].min() + 10, runs[0].max() - 10
        center, width = rng.uniform(low, high), rng.uniform(1.5, 4)
        one = [np.exp(-0.5 * ((t - center) / width) ** 2) for t in runs]
    elif cause == "warm_up":
        tau = math.exp(rng.uniform(math.log(150), math.log(1000)))
        one = [np.exp(-np.arange(len(t)) / tau) for t in runs]
    else:
        one = [np.zeros(len(t)) for t in runs]
    return [one, one]


def markov(rng, n, sigma, tau_s):
    phi = math.exp(-1 / tau_s)
    drive = sigma * rng.standard_normal(n)
    drive[1:] *= math.sqrt(1 - phi ** 2)
    return lfilter([1], [1, -phi], drive)


def whitener(white, sigma, tau_s):
    """Innovations of white noise and one Markov process; what the first state adds is a power of theta."""
    phi = math.exp(-1 / tau_s)
    r = (sigma ** 2 * (1 - phi ** 2) + white ** 2 * (1 + phi ** 2)) / (phi * white ** 2)
    theta = (r - math.sqrt(r * r - 4)) / 2
    scale = math.sqrt(phi * white ** 2 / theta)
    return (lambda x: lfilter([1, -phi], [1, -theta], x) / scale), theta


def least_squares(runs, noise, rates, free):
    """The common cubic without its constant, and what is left of the whitened rates.  A log has a constant, a first
    state of the noise, and the shapes in `free` of its own."""
    whiten, theta = whitener(*noise)
    design = np.zeros((sum(map(len, runs)), 3 + sum(2 + len(f) for f in free)))
    row, column = 0, 3
    for t, f in zip(runs, free):
        tn, rows = (t - 20) / 40, slice(row, row + len(t))
        design[rows, :3] = np.transpose([whiten(x) for x in (tn, tn ** 2, tn ** 3)])
        own = [whiten(np.ones(len(t))), theta ** np.arange(len(t)), *map(whiten, f)]
        design[rows, column:column + len(own)] = np.transpose(own)
        row, column = row + len(t), column + len(own)
    y = np.concatenate([whiten(x) for x in rates])
    found = np.linalg.lstsq(design, y, rcond=1e-9)[0]
    return found[:3], y - design @ found


def strength(runs, noise, effects, settled):
    """sqrt(2 * gain) of the effect, to who knows the noise and neither the cubic nor the start of the memory."""
    starts = [[x - y] if np.any(x != y) else [] for x, y in zip(effects, settled)]
    return np.linalg.norm(least_squares(runs, noise, effects, starts)[1])


# ---- one device, its files, and the program


class Device:
    def __init__(self, folder, cause, number):
        rng = np.random.default_rng([SEED, (CAUSES + CONTROLS).index(cause), number])
        self.cause, self.number = cause, number
        self.n_fitted = 1 if rng.random() < 0.7 else 2
        seconds = rng.integers(5000, 8001, self.n_fitted + rng.integers(2, 4))
        runs = [chamber(rng, n) for n in seconds]
        noise = rng.uniform(30, 50), rng.uniform(10, 20), math.exp(rng.uniform(math.log(60), math.log(200)))
        coeff = rng.normal(0, [300, 300, 150, 80])
        coeff[1] = rng.choice([-1, 1]) * rng.uniform(200, 500)
        with_start, settled = effect_of(cause, rng, runs, coeff)
        wanted, sign = rng.uniform(15, 25), rng.choice([-1, 1])
        factor = 0.0
        if cause in TRUE:
            factor = sign * wanted / strength(runs, noise, with_start, settled)
        if cause == "lag":  # it is the cubic that is made stronger
            coeff = abs(factor) * coeff
            factor = abs(factor)
        self.noise, self.runs, self.logs = noise, runs, []
        self.coeff, self.rates = coeff, []
        self.effect = [factor * e for e in with_start]
        folder.mkdir(parents=True, exist_ok=True)
        thermometer = rng.uniform(0.005, 0.02)
        for i, degc in enumerate(runs):
            n = len(degc)
            rate = cubic(degc, coeff) + rng.normal(0, 30) + self.effect[i]
            rate += noise[0] * rng.standard_normal(n) + markov(rng, n, noise[1], noise[2])
            if cause == "slow_noise" and number % 2 == 0:
                rate += markov(rng, n, 1.5 * noise[1], 800)
            elif cause == "slow_noise":
                rate += np.cumsum(0.5 * rng.standard_normal(n))
            self.rates.append(rate)
            read = degc + thermometer * rng.standard_normal(n)
            path = folder / f"{cause}_{number}_{'fit' if i < self.n_fitted else 'held'}{i}.csv"
            self.logs.append(write_log(path, np.arange(1, n + 1), read, rate, form="%d,%.4f,%.4f"))
        self.believed = model_option(folder / f"{cause}_{number}_model.json", model_of(noise[0], noise[1:]) if number % 4 == 3 else None)

    def ask(self):
        done, _ = run(DIAGNOSE, self.believed, self.logs[:self.n_fitted], self.logs[self.n_fitted:], timeout_s=180)
        self.axis, = axes_of(done)
        return self

    def effects(self):
        """Of every effect: what it is called, its family, and the members it can be."""
        return [(e["name"], e["family"], {e["name"], *(m["name"] for m in e["set"])}) for e in self.axis["effects"]]


def is_wrong(effect, cause):
    """It cannot be the cause: neither it, nor its family by name, nor a member beside it."""
    name, _, members = effect
    return TRUE[cause] not in members and name != FAMILY[cause]


def is_alone(effect):
    return len(effect[2]) == 1


def is_repeatable(effect):
    return effect[1] in ("thermal_memory", "function_of_temperature", "function_of_time")


FAMILY = {**dict.fromkeys(("play", "lag", "rate", "creep"), "thermal_memory"), "bump": "function_of_temperature",
          "warm_up": "function_of_time"}


# ---- the shrinkage that is true, from what was told and what was simulated


def told_effect(cause, degc, told, cubic_coeff):
    """What the told member does in one log, one for each start that is tried, and what its start may add."""
    t = np.arange(len(degc))
    if cause == "play":
        return [told["amplitude_dph"] * play(degc, told["width_degc"], s) for s in np.linspace(-1, 1, 9)], []
    if cause == "lag":
        tau = told["tau_s"]
        return [cubic(follows(degc, tau), cubic_coeff) - cubic(degc, cubic_coeff)], [np.exp(-t / tau)]
    if cause == "creep":
        ends = np.log([told["tau_first_s"], told["tau_last_s"]])
        taus = np.exp(ends[0] + (np.arange(12) + 0.5) / 12 * (ends[1] - ends[0]))
        shape = np.mean([degc - follows(degc, tau) for tau in taus], axis=0)
        return [told["amplitude_dph_per_degc"] * shape], [np.exp(-t / tau) for tau in taus[[0, 6, 11]]]
    if cause == "rate":
        return [told["k_dph_per_degc_min"] * 60 * np.gradient(degc)], []
    if cause == "bump":
        z = (degc - told["center_degc"]) / told["width_degc"]
        return [told["amplitude_dph"] * np.exp(-0.5 * z * z)], []
    return [told["amplitude_dph"] * np.exp(-t / told["tau_s"])], []


def minutes(x):
    return x[:len(x) // 60 * 60].reshape(-1, 60).mean(1)


def mean_square(device, shapes, starts):
    """One-minute means of the held-out logs, without their noise, off the cubic of the fitted logs and the shapes: at
    temperatures that were fitted.  A start is taken that suits the log best."""
    n, runs = device.n_fitted, device.runs
    fits = [least_squares(runs[:n], device.noise, [r - s for r, s in zip(device.rates, tried)], starts[:n])
            for tried in itertools.product(*shapes[:n])]
    fitted, _ = min(fits, key=lambda fit: np.sum(fit[1] ** 2))
    low, high = min(t.min() for t in runs[:n]), max(t.max() for t in runs[:n])
    squares = []
    for t, e, tried, start in list(zip(runs, device.effect, shapes, starts))[n:]:
        is_within = (minutes(t) > low) & (minutes(t) < high)
        free = np.transpose([minutes(x)[is_within] for x in (np.ones(len(t)), *start)])
        offs = [minutes(cubic(t, device.coeff) + e - shape - cubic(t, [0, *fitted]))[is_within] for shape in tried]
        offs = [off - free @ np.linalg.lstsq(free, off, rcond=None)[0] for off in offs]
        squares.append(min((off ** 2 for off in offs), key=np.sum))
    return np.concatenate(squares).mean()


def true_shrinkage(device):
    """Of the mean square, by what was told."""
    told = device.axis["effects"][0]["parameters"]
    shapes, starts = zip(*(told_effect(device.cause, t, told, device.coeff) for t in device.runs))
    nothing = [[np.zeros(len(t))] for t in device.runs]
    return 1 - mean_square(device, shapes, starts) / mean_square(device, nothing, [[] for _ in device.runs])


def claim(device):
    """Claimed shrinkage, its interval and the true one, where the right member is told alone; else None."""
    gap, told = device.axis["gap"], device.effects()
    if gap["shrinkage"] is None or len(told) != 1 or told[0][0] != TRUE[device.cause]:
        return None
    return gap["shrinkage"], gap["ci95"], true_shrinkage(device)


def is_far_off(claimed):
    _, (low, high), true = claimed
    return not low - 0.1 <= true <= high + 0.1


# ---- the questions


@pytest.mark.parametrize("cause", ["play", "bump"])
def test_the_cause_is_told(tmp_path, cause):
    """One device each.  At the aims of the program (0.90 for the family, 0.98 for the set) both pass in 80 %."""
    device = Device(tmp_path, cause, 0).ask()
    told = device.effects()
    assert told and told[0][1] == FAMILY[cause] and not is_wrong(told[0], cause), told


@pytest.mark.parametrize("control", CONTROLS)
def test_a_control_has_no_name_of_something_repeatable(tmp_path, control):
    """At the stated rate the two devices of both controls pass in 96 %."""
    for number in (0, 1):
        told = Device(tmp_path, control, number).ask().effects()
        assert not any(is_repeatable(effect) for effect in told), told


@pytest.mark.parametrize("number", [7, 21, 55])
def test_noise_of_the_fitted_log_alone_makes_no_cause(tmp_path, number):
    """Looked at: of 60 devices with slow noise these had a name while the noise was that of the fitted log alone."""
    told = Device(tmp_path, "slow_noise", number).ask().effects()
    assert not any(is_repeatable(effect) for effect in told), told


def test_a_cause_that_held_out_logs_tell_is_not_lost_to_a_free_function(tmp_path):
    """Looked at: a free function took the place of this warm-up, did not earn a name itself, and no gap was said."""
    told = Device(tmp_path, "warm_up", 3).ask().effects()
    assert [effect[0] for effect in told] == ["warm_up"], told


@pytest.fixture(scope="module")
def all_devices(tmp_path_factory):
    folder = tmp_path_factory.mktemp("one_log")
    return [Device(folder, cause, k).ask() for cause in CAUSES for k in range(DEVICES)]


@pytest.mark.long
@pytest.mark.parametrize("cause", CAUSES)
def test_the_family_is_right(all_devices, cause):
    """The family of 9 of 10 is the program's own aim; more than 3 misses of 8 come in less than 1 % then."""
    told = {d.number: d.effects() for d in all_devices if d.cause == cause}
    missed = {k: e for k, e in told.items() if not e or e[0][1] != FAMILY[cause]}
    assert len(missed) <= most_by_chance(DEVICES, 0.1), missed


@pytest.mark.long
def test_no_wrong_member_is_told_alone(all_devices):
    """2 of 100 is what the program's aim leaves for a set without the right one.  Of 48 that is 4 in all but 1 %."""
    wrong = {(d.cause, d.number): d.effects() for d in all_devices
             if any(is_wrong(e, d.cause) and is_alone(e) for e in d.effects()[:1])}
    assert len(wrong) <= most_by_chance(len(all_devices), 0.02), wrong


@pytest.mark.long
def test_the_right_member_is_in_the_set(all_devices):
    """Of 48 at 9 of 10: the strength that one log alone has is often that of d = 10, where the aim is 0.90."""
    missed = {(d.cause, d.number): d.effects() for d in all_devices
              if not any(TRUE[d.cause] in members for _, _, members in d.effects())}
    assert len(missed) <= most_by_chance(len(all_devices), 0.1), missed


@pytest.mark.long
def test_the_claimed_shrinkage_is_true(all_devices):
    """An interval of 95 %, with 0.1 at either side for what this file does in another way than the program."""
    claims = {(d.cause, d.number): c for d in all_devices if d.effects() and (c := claim(d))}
    off = {k: c for k, c in claims.items() if is_far_off(c)}
    assert len(off) <= most_by_chance(len(claims), 0.05), off


@pytest.mark.long
@pytest.mark.parametrize("control", CONTROLS)
def test_controls_have_no_name_of_something_repeatable(tmp_path, control):
    """At the stated rate more than 2 of 20 come in 0.1 % of draws, more than 1 in 1.7 %."""
    told = {k: Device(tmp_path, control, k).ask().effects() for k in range(HEALTHY)}
    false = {k: e for k, e in told.items() if any(map(is_repeatable, e))}
    assert len(false) <= most_by_chance(HEALTHY, FALSE_ALARM), false
