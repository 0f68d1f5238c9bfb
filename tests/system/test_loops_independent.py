# SPDX-License-Identifier: MIT
"""Thermal loops of many shapes, in logs that this file simulates itself.

The bias of a device depends on the way by which a temperature was reached: a Preisach plane of 20 to 80 relays, a few
plays of different widths, a Bouc-Wen loop, a play that is wide at cold and closed at hot, or a play with rounded corners.
The program's hysteresis is one play; a loop of another shape is a thermal hysteresis all the same.  Controls have no
loop: a gyro that lags its thermometer, a function of temperature, nothing.  Every run starts anywhere inside its loop.
Noise is white noise and one first-order process.  No code is shared with the programs.

Strength d is sqrt(2 gain): the gain of log-likelihood of the true cause under the true noise, after constants of the
runs and a common cubic, from the covariance matrix of 20-s means.

    python tests/system/test_loops_independent.py [DIAGNOSE]

counts what stands first for 26 devices of each loop and 15 of each control."""
import math
import sys
import tempfile
from collections import Counter
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import cholesky, solve_triangular
from scipy.signal import lfilter

from asking import DIAGNOSE, axes_of, least_by_chance, model_option, run, write_log

WHITE, SLOW, TAU_S = 35.0, 15.0, 120.0  # dph per second's mean, dph, s
MODEL = {"imucal_model": 1, "arw_deg_rt_h": WHITE / 60, "markov": [{"sigma_dph": SLOW, "tau_s": TAU_S}],
         "bias": {"t0_degc": 25, "range_degc": 40, "coeff_dph": [0, 0, 0, 0]}}
BLOCK_S = 20
LOOPS = ["preisach", "plays", "bouc_wen", "closing", "rounded"]
CONTROLS = ["lag", "function", "nothing"]


# ---- temperatures


def ramps(rng, seconds, cold, hot):
    """Corners of ramps that turn round at both ends and sometimes between them, with or without soaks."""
    t, degc, towards = 0.0, rng.choice([cold, hot]), 0
    towards = 1 if degc == cold else -1
    at = [(t, degc)]
    while t < seconds:
        if rng.random() < 0.6:
            t += rng.uniform(100, 600)
            at.append((t, degc))
        if rng.random() < 0.7:
            goal = hot if towards > 0 else cold
        else:
            goal = degc + (0.4 + 0.5 * rng.random()) * ((hot if towards > 0 else cold) - degc)
        t += abs(goal - degc) / rng.uniform(0.015, 0.05)
        at.append((t, goal))
        degc, towards = goal, -towards
    return at


def stairs(rng, seconds, cold, hot):
    """Equal stairs up and down, or down and up: a ramp of 2 to 4 degC/min and a soak each."""
    n = rng.integers(3, 6)
    way = np.linspace(cold, hot, n + 1)
    way = np.concatenate([way, way[-2::-1]])
    if rng.random() < 0.5:
        way = np.concatenate([way[n:], way[1:n + 1]])
    speed = rng.uniform(2, 4) / 60
    soak_s = seconds / len(way) - (hot - cold) / n / speed
    t, at = 0.0, []
    for here, there in zip(way, np.append(way[1:], way[-2])):
        at += [(t, here), (t + max(soak_s, 30), here)]
        t += max(soak_s, 30) + abs(there - here) / speed
    return at


def follows(x, tau_s, start):
    phi = math.exp(-1 / tau_s)
    return lfilter([1 - phi], [1, -phi], x, zi=[phi * start])[0]


def temperature(rng, seconds, cold, hot, kind):
    at = kind(rng, seconds, cold, hot)
    set_degc = np.interp(np.arange(seconds), *zip(*at))
    return follows(set_degc, rng.uniform(20, 80), set_degc[0])


# ---- causes: what each adds to the rate of one run, of any size


def play(degc, radius, start):
    """Where a body with a slack of +- radius is pulled to; `start` is -1 to 1 of the slack.  The radius may change."""
    radius = np.broadcast_to(radius, degc.shape).tolist()
    out, at = np.empty(len(degc)), degc[0] + start * radius[0]
    for k, x in enumerate(degc.tolist()):
        at = min(max(at, x - radius[k]), x + radius[k])
        out[k] = at
    return out


def preisach(rng, cold, hot):
    n = rng.integers(20, 81)
    center, half = rng.uniform(cold, hot, n), rng.uniform(1, 18, n)
    up, down, weight = center + half, center - half, rng.exponential(1, n)

    def rate(degc, run_rng):
        state = np.where(run_rng.random(n) < 0.5, 1.0, -1.0)
        out = np.empty(len(degc))
        for k, x in enumerate(degc):
            state[x >= up] = 1
            state[x <= down] = -1
            out[k] = weight @ state
        return out
    return rate


def plays(rng, cold, hot):
    n = rng.integers(2, 5)
    radius, weight = np.exp(rng.uniform(math.log(1), math.log(16), n)), rng.uniform(0.2, 1, n)

    def rate(degc, run_rng):
        return sum(w * play(degc, r, run_rng.uniform(-1, 1)) for r, w in zip(radius, weight))
    return rate


def bouc_wen(rng, cold, hot):
    return bouc_wen_of(rng, rng.uniform(3, 15))


def bouc_wen_of(rng, scale_degc):
    """dz/dT = (1 - |z|^n (b sign(z dT) + 1 - b)) / R, z from -1 to 1; R: scale_degc."""
    n, b = rng.uniform(1, 2.5), rng.uniform(0.5, 1)

    def rate(degc, run_rng):
        z, out = run_rng.uniform(-0.9, 0.9), np.empty(len(degc))
        for k, step in enumerate(np.diff(degc, prepend=degc[0]).tolist()):
            z += step / scale_degc * (1 - abs(z) ** n * (b * math.copysign(1, z * step) + 1 - b))
            out[k] = z
        return out
    return rate


def closing(rng, cold, hot):
    radius_degc = rng.uniform(6, 18)
    closed_degc = cold + rng.uniform(0.6, 1) * (hot - cold)

    def rate(degc, run_rng):
        radius = radius_degc * np.clip((closed_degc - degc) / (closed_degc - cold), 0, None)
        return play(degc, radius, run_rng.uniform(-1, 1)) - degc
    return rate


def rounded(rng, cold, hot):
    """A play whose two sides saturate: a loop with a flat top and bottom."""
    radius_degc, wide_degc = rng.uniform(3, 12), rng.uniform(8, 25)
    center = rng.uniform(0.3, 0.7) * (hot - cold) + cold

    def rate(degc, run_rng):
        return np.tanh((play(degc, radius_degc, run_rng.uniform(-1, 1)) - center) / wide_degc)
    return rate


def cubic(degc, coeff):
    return np.polyval(coeff[::-1], (degc - 25) / 40)


def lag(rng, cold, hot):
    tau_s, coeff = math.exp(rng.uniform(math.log(200), math.log(1500))), rng.uniform(-1, 1, 4)

    def rate(degc, run_rng):
        return cubic(follows(degc, tau_s, degc[0] + run_rng.uniform(-6, 6)), coeff) - cubic(degc, coeff)
    rate.coeff = coeff  # the device's whole cubic is at the temperature that lags
    return rate


def function(rng, cold, hot):
    center, width = rng.uniform(cold + 8, hot - 8), rng.uniform(2, 6)
    return lambda degc, run_rng: np.exp(-0.5 * ((degc - center) / width) ** 2)


def nothing(rng, cold, hot):
    return lambda degc, run_rng: np.zeros(len(degc))


# ---- strength, by dense algebra on 20-s means


def blocks(x, seconds=BLOCK_S):
    n = len(x) // seconds
    return np.asarray(x)[:n * seconds].reshape(n, seconds).mean(axis=1)


def minutes(x):
    return blocks(x, 60)


@lru_cache(maxsize=16)
def root_of_covariance(n):
    """Of n means in turn: the sum of the covariances of their seconds."""
    seconds = np.abs(np.subtract.outer(np.arange(BLOCK_S), np.arange(BLOCK_S)))
    phi = math.exp(-1 / TAU_S)
    same = (phi ** seconds).mean()
    apart = np.mean(phi ** np.subtract.outer(np.arange(BLOCK_S), np.arange(BLOCK_S)).astype(float))
    steps = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    markov = np.where(steps == 0, same, apart * phi ** (BLOCK_S * steps.astype(float)))
    return cholesky(SLOW ** 2 * markov + WHITE ** 2 / BLOCK_S * np.eye(n), lower=True)


def whitened(columns_of_runs):
    """White rows of all runs; each run brings an array with a column per cause."""
    return np.vstack([solve_triangular(root_of_covariance(len(c)), c, lower=True) for c in columns_of_runs])


def constants_and_cubic(runs):
    out = []
    for i, degc in enumerate(runs):
        x = (blocks(degc) - 25) / 40
        constant = np.zeros((len(x), len(runs)))
        constant[:, i] = 1
        out.append(np.column_stack([constant, x, x ** 2, x ** 3]))
    return out


def strength(runs, rates):
    basis, _ = np.linalg.qr(whitened(constants_and_cubic(runs)))
    s = whitened([blocks(r)[:, None] for r in rates])[:, 0]
    return np.linalg.norm(s - basis @ (basis.T @ s))


# ---- devices


class Device:
    """Temperatures and rates of two to four fitted runs and one or two held out.  `seed` and mechanism say everything."""
    def __init__(self, mechanism, seed, d=25.0):
        rng = np.random.default_rng([seed, (LOOPS + CONTROLS).index(mechanism)])
        cold = rng.uniform(-25, 0)
        hot = cold + rng.uniform(50, 80)
        self.n_fitted = int(rng.integers(2, 5))
        seconds = int(rng.integers(5000, 8001))
        kinds = [(ramps, stairs)[int(rng.random() < 0.35)] for _ in range(self.n_fitted + rng.integers(1, 3))]
        self.runs = [temperature(rng, seconds, cold, hot, kind) for kind in kinds]
        cause = globals()[mechanism](rng, cold, hot)
        effect = [cause(degc, rng) for degc in self.runs]
        size = strength(self.runs[:self.n_fitted], effect[:self.n_fitted])
        gain = rng.choice([-1, 1]) * d / size if size > 0 else 0.0
        self.effect = [gain * e for e in effect]
        self.is_believed = seed % 2 == 0
        self.coeff = gain * np.array(cause.coeff) if mechanism == "lag" else rng.normal(0, [300, 150, 80, 60])
        self.measure(rng, seconds)

    def measure(self, rng, seconds):
        """Rates with the cubic, a constant of every run and noise; temperatures as read."""
        self.rates = [cubic(degc, self.coeff) + e + rng.normal(0, 30) + noise(rng, seconds)
                      for degc, e in zip(self.runs, self.effect)]
        self.read = [degc + 0.01 * rng.standard_normal(seconds) for degc in self.runs]

    def write(self, folder):
        paths = []
        for i, (degc, rate) in enumerate(zip(self.read, self.rates)):
            paths.append(write_log(folder / f"log{i}.csv", np.arange(1, len(rate) + 1), degc, rate, form="%d,%.3f,%.3f"))
        return paths[:self.n_fitted], paths[self.n_fitted:]


def noise(rng, n):
    phi = math.exp(-1 / TAU_S)
    drive = SLOW * rng.standard_normal(n)
    drive[1:] *= math.sqrt(1 - phi ** 2)
    return WHITE * rng.standard_normal(n) + lfilter([1], [1, -phi], drive)


def diagnosed(device, folder, program=DIAGNOSE):
    options = model_option(folder / "model.json", MODEL if device.is_believed else None)
    return axes_of(run(program, options, *device.write(folder))[0])[0]


def first(axis):
    return (axis["effects"][0]["name"], axis["effects"][0]["family"]) if axis["effects"] else ("", "")


# ---- shrinkage of the gap with the told play


def fitted_cubic(device, told):
    """Slopes of the cubic from the fitted runs as measured, with what is told taken away (its start states at the best of 21)."""
    runs = device.runs[:device.n_fitted]
    target = whitened([blocks(y)[:, None] for y in device.rates[:device.n_fitted]])[:, 0]
    columns = whitened(constants_and_cubic(runs))
    if told is None:
        return np.linalg.lstsq(columns, target, rcond=None)[0][-3:]
    shares = [0.0] * len(runs)
    shapes = [[blocks(shape) for shape in play_shapes(degc, *told)] for degc in runs]
    for _ in range(3):  # start states of the runs in turn
        for i in range(len(runs)):
            tried = []
            for start in range(21):
                shares[i] = start
                rest = target - whitened([shapes[j][int(shares[j])][:, None] for j in range(len(runs))])[:, 0]
                beta, rss, *_ = np.linalg.lstsq(columns, rest, rcond=None)
                tried.append((rss[0], start, beta))
            _, shares[i], best = min(tried, key=lambda entry: entry[0])
    return best[-3:]


def play_shapes(degc, amplitude, width):
    return [amplitude * (play(degc, width, s) - degc) / width for s in np.linspace(-1, 1, 21)]


def left(device, told):
    """Squares of what is left of the mean of the held-out one-minute means, constants and start states free."""
    slopes = fitted_cubic(device, told)
    fitted = np.concatenate(device.runs[:device.n_fitted])
    total = 0.0
    for i in range(device.n_fitted, len(device.runs)):
        degc = device.runs[i]
        seen = minutes((degc >= fitted.min()) & (degc <= fitted.max())) == 1
        x = (degc - 25) / 40
        rest = device.effect[i] + cubic(degc, device.coeff) - np.column_stack([x, x ** 2, x ** 3]) @ slopes
        shapes = [np.zeros(len(x))] if told is None else play_shapes(degc, *told)
        total += min(np.var(minutes(rest - shape)[seen]) * seen.sum() for shape in shapes)
    return total


def true_shrinkage(device, parameters):
    told = parameters["amplitude_dph"], parameters["width_degc"]
    return 1 - left(device, told) / left(device, None)


def named_first(folder, mechanism, seeds, program=DIAGNOSE):
    """What stands first for each seed."""
    return [first(diagnosed(Device(mechanism, seed), folder, program))[0] for seed in seeds]


@pytest.mark.parametrize("seeds", [[0, 1, 3], pytest.param([0, 1, 3, 4, 6, 8], marks=pytest.mark.long)], ids=["short", "all"])
def test_devices_that_were_named_stay_named(tmp_path, seeds):
    """Of the first 18 rounded loops these are the first that have the member first; the program before had it in 3 of the 18."""
    names = named_first(tmp_path, "rounded", seeds)
    assert names.count("thermal_hysteresis") >= len(seeds) - 1, names


@pytest.mark.long
@pytest.mark.parametrize("mechanism, n, rate", [("rounded", 18, 16 / 26), ("closing", 10, 15 / 26)])
def test_a_loop_of_another_shape_than_one_play_is_named_hysteresis(tmp_path, mechanism, n, rate):
    """Of 26 draws 16 and 15 had the member first; before, 5 and 2.  The limits, 6 of 18 and 2 of 10, are met by a program of
    these older rates in 1 of 8 and 1 of 6 draws; of these devices it had 3 and 0.  Not asked here: of 26 Preisach planes 14
    (before 10)."""
    names = named_first(tmp_path, mechanism, range(n))
    assert names.count("thermal_hysteresis") >= least_by_chance(n, rate), names


@pytest.mark.parametrize("mechanism", ["plays", "bouc_wen"])
def test_a_loop_close_to_one_play_is_named_and_its_told_play_shrinks_the_gap_as_told(tmp_path, mechanism):
    """Of 20 draws 19 had the member first, now as before, and the true shrinkage was within 0.02 of the interval in all 19.
    For other shapes it was so in 4 of 11 and too high in the others; there is no figure for them since."""
    for seed in (0, 1):
        device = Device(mechanism, seed)
        axis = diagnosed(device, tmp_path)
        assert first(axis)[0] == "thermal_hysteresis", seed
        low, high = axis["gap"]["ci95"]
        assert low - 0.02 <= true_shrinkage(device, axis["effects"][0]["parameters"]) <= high + 0.02, seed


@pytest.mark.parametrize("mechanism, seed", [pytest.param(m, s, marks=[pytest.mark.long] * (s > 0)) for m in CONTROLS for s in range(3)][:8])
def test_what_has_no_loop_is_no_hysteresis(tmp_path, mechanism, seed):
    """Of 15 draws of each none was, before or now."""
    names = [effect["name"] for effect in diagnosed(Device(mechanism, seed), tmp_path)["effects"]]
    assert "thermal_hysteresis" not in names
    assert bool(names) == (mechanism != "nothing")


if __name__ == "__main__":
    for kind, count in [(loop, 26) for loop in LOOPS] + [(control, 15) for control in CONTROLS]:
        with tempfile.TemporaryDirectory() as to:
            names = named_first(Path(to), kind, range(count), *map(Path, sys.argv[1:2]))
        print(f"{kind:9} " + ", ".join(f"{n} {name or '(nothing)'}" for name, n in Counter(names).most_common()), flush=True)
