# SPDX-License-Identifier: MIT
"""One or two jumps of a gyro's bias at single moments: told where they are, alone and beside a thermal cause, and never made up.

A row is a second; the logs of a device last 80 to 120 min, and half of them lack one to three pieces of 1 to 3 min.  A chamber
goes by one ramp between two soaks, by stairs, or by ways up and down, 0 to 55 degC, and a body follows it by 40 to 120 s.  Of
every device are drawn: white noise (15 to 40 dph in a second), one first-order process (5 to 12 dph, 60 to 200 s), a cubic of
the temperature, and a constant for every log.  Of four logs the last is held out, and none jumps there; of three none is.
A) one or two jumps in the fitted logs, moments drawn evenly in 5 to 95 % of a log, strengths d in 7 to 15.  Every jump with a
d of 8 or more must be told among the steps of `bias_step` or of the family of slow noise, and nothing else may be named than
these and noise.  B) the same jumps beside one cause with a d of 20 to 35: an element that lags its thermometer by 200 to 600 s
(from a state up to 3 degC off at the start), or a bump over temperature of 2 to 5 degC (sigma).  The cause must be named, as
itself or as its family, and jumps with a d of 9 or more must be told.  C) no jump, and with every third device hits of 8 sigma
of the white noise in single rows, 1 in 2000: neither fitted nor held-out logs may be told to jump.

Strength d is sqrt(2 gain) under the true noise, beside constants of the logs, a common cubic, and whatever else was drawn
(the other jump, the cause, its start states).  Limits.  Moment: a step of the true height at another moment costs q²/2 nats;
how far a moment may be off is where q² passes 32 (argmax of a Brownian motion with drift: 1 miss in 700), plus 3 s for
rows.  Size: four standard errors, which are size / d (1 miss in 16 000).  The believed noise is the true model with even
devices, a data sheet with every figure wrong by up to 1.5 with every other odd one, and nothing with the rest.

Counts, chosen with the seed before the first run: none of the first devices may miss; of more of them 23 of 24 (A: who misses
1 in 100 fails 1 time in 40) and 14 of 16 (B) must be right.  Of 100 devices without a jump none may be told one: 3 in 100
would be seen 19 times in 20.  All of it is simulated by this file; no code is shared with the programs."""
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from asking import DIAGNOSE, at_most_wrong, axis_told, belief, found, write_log

SEED = 20330419
KINDS = ["jumps", "beside", "none"]
MOMENT_COST, SIZE_ERRORS = 32, 4  # q² and standard errors: see above
NOISE = {"slow_noise", "fast_noise"}
SHIFTS_S = np.unique(np.round(1.25 ** np.arange(41))).astype(int)  # 1 s to two hours


# ---- temperatures, and what a bias makes of them


def newton(x, tau_s, start):
    """A body that follows x, a value a second, from this start."""
    phi = math.exp(-1 / tau_s)
    return lfilter([1 - phi], [1, -phi], x, zi=[phi * start])[0]


def chamber(rng, n):
    ends = np.array([rng.uniform(0, 8), rng.uniform(47, 55)])[::rng.choice([-1, 1])]
    shape = rng.choice(["ramp", "stairs", "ways"])
    if shape == "ramp":
        at, levels = [0, rng.uniform(0.08, 0.25) * n, rng.uniform(0.7, 0.92) * n, n], np.repeat(ends, 2)
    elif shape == "stairs":
        levels = np.linspace(*ends, rng.integers(3, 6))
        levels = np.append(levels, levels[-2::-1])
        begin = (np.arange(len(levels)) + np.append(0, rng.uniform(-0.2, 0.2, len(levels) - 1))) * n / len(levels)
        soaked = np.append(begin[1:], n)
        way_s = np.append(0, abs(np.diff(levels))) / rng.uniform(2, 4) * 60
        at, levels = np.ravel([begin + way_s, np.maximum(soaked, begin + way_s + 1)], order="F"), np.repeat(levels, 2)
    else:
        at, levels, goal = [0.0], [rng.uniform(5, 50)], rng.integers(2)
        while at[-1] < n:
            levels.append(ends[goal] + rng.uniform(0, 3) * np.sign(27.5 - ends[goal]))
            at.append(at[-1] + (abs(levels[-1] - levels[-2]) / rng.uniform(0.9, 2) + rng.uniform(0, 5)) * 60)
            goal = 1 - goal
    air = np.interp(np.arange(n) + 0.5, at, levels)
    return newton(air, rng.uniform(40, 120), air[0])


def normed(degc):
    return (degc - 27.5) / 27.5


def cubic(coeff, degc):
    return np.polynomial.polynomial.polyval(normed(degc), coeff)


def step(n, moment_s):
    """The share of every second that lies after the moment."""
    return np.clip(np.arange(1, n + 1) - moment_s, 0, 1)


def left_beside(column, others):
    q = np.linalg.qr(others)[0]
    return column - q @ (q.T @ column)


# ---- devices


class Device:
    def __init__(self, folder, kind, number):
        self.rng = rng = np.random.default_rng([SEED, KINDS.index(kind), number])
        self.path, self.number, self.note = folder / f"{kind}{number}", number, ""
        self.white, self.sigma, self.tau_s = rng.uniform(15, 40), rng.uniform(5, 12), math.exp(rng.uniform(*np.log([60, 200])))
        self.lengths = rng.integers(4800, 7201, rng.integers(3, 5))
        self.n_fitted = 3
        self.degc = [chamber(rng, n) for n in self.lengths]
        self.rows = [self.rows_kept(n) for n in self.lengths]
        self.coeff = rng.normal(0, [0, 250, 120, 60])
        self.bias = [cubic(self.coeff, t) + rng.normal(0, 30) for t in self.degc]
        self.jumps, self.shapes, self.starts = [], [], []

    def rows_kept(self, n):
        kept = np.ones(n, dtype=bool)
        for _ in range(self.rng.integers(1, 4) if self.rng.random() < 0.5 else 0):
            start = self.rng.integers(0.05 * n, 0.9 * n)
            kept[start:start + self.rng.integers(60, 181)] = False
        return np.flatnonzero(kept)

    def whitened(self, rows, columns):
        """Innovations in standard deviations: Kalman filter of white noise and the first-order process, gaps bridged."""
        mean, var, out = np.zeros(columns.shape[1]), self.sigma ** 2, np.empty((len(rows), columns.shape[1]))
        for i, (row, dt) in enumerate(zip(columns[rows], np.diff(rows, prepend=rows[0]).tolist())):
            phi = math.exp(-dt / self.tau_s)
            mean, var = phi * mean, phi ** 2 * var + (1 - phi ** 2) * self.sigma ** 2
            total = var + self.white ** 2
            miss = row - mean
            out[i] = miss / math.sqrt(total)
            mean, var = mean + var / total * miss, var * self.white ** 2 / total
        return out

    def nuisance(self, i):
        tn, ones = normed(self.degc[i]), np.zeros((self.lengths[i], self.n_fitted))
        ones[:, i] = 1
        return [*ones.T, tn, tn ** 2, tn ** 3]

    def cause_columns(self, i):
        own = [self.starts[i] * (k == i) for k in range(self.n_fitted)] if self.starts else []
        return [self.shapes[i], *own] if self.shapes else []

    def columns(self, i):
        """Of a log: jumps of height 1, the cause and its start states, the nuisance; then every jump at other moments."""
        def own(jump, later_s=0):
            return step(self.lengths[i], jump["t_s"] + later_s) * (jump["log"] == i)
        shifted = [own(j, s) for j in self.jumps for s in (*SHIFTS_S, *-SHIFTS_S)]
        return np.column_stack([*map(own, self.jumps), *self.cause_columns(i), *self.nuisance(i), *shifted])

    def draw_jumps(self):
        """One or two jumps; of each its log, moment, strength, height, and the time by which it may be told wrong."""
        rng, n_shifts = self.rng, 2 * len(SHIFTS_S)
        for _ in range(rng.integers(1, 3)):
            log = int(rng.integers(self.n_fitted))
            self.jumps.append({"log": log, "t_s": rng.uniform(0.05, 0.95) * self.lengths[log], "d": rng.uniform(7, 15)})
        x = np.concatenate([self.whitened(self.rows[i], self.columns(i)) for i in range(self.n_fitted)])
        base, shifted = np.split(x, [-n_shifts * len(self.jumps)], axis=1)
        for k, j in enumerate(self.jumps):
            mine = np.column_stack([base[:, k], shifted[:, k * n_shifts:(k + 1) * n_shifts]])
            left = left_beside(mine, np.delete(base, k, axis=1))
            own, moved = left[:, 0], left[:, 1:]
            j["size"] = rng.choice([-1, 1]) * j["d"] / np.linalg.norm(own)
            power = np.maximum((moved ** 2).sum(axis=0), 1e-6 * (own @ own))
            cost = j["size"] ** 2 * (own @ own - (own @ moved) ** 2 / power)
            j["within_s"] = 3 + max(SHIFTS_S[np.argmax(c >= MOMENT_COST)] for c in cost.reshape(2, -1))
            self.bias[j["log"]] = self.bias[j["log"]] + j["size"] * step(self.lengths[j["log"]], j["t_s"])
            self.note += f" jump {j['log']}:{j['t_s']:.0f}s±{j['within_s']:.0f} {j['size']:+.1f} dph d {j['d']:.1f};"
        return base

    def draw_jumps_and_cause(self, goal):
        """The factor that gives the shapes a strength of this."""
        base, k = self.draw_jumps(), len(self.jumps)
        return self.rng.choice([-1, 1]) * goal / np.linalg.norm(left_beside(base[:, k], np.delete(base, k, axis=1)))

    def noise(self, n):
        phi = math.exp(-1 / self.tau_s)
        drive = self.sigma * self.rng.standard_normal(n)
        drive[1:] *= math.sqrt(1 - phi ** 2)
        return self.white * self.rng.standard_normal(n) + lfilter([1], [1, -phi], drive)

    def answer(self, program, hits=False):
        paths = []
        for i, (n, rows) in enumerate(zip(self.lengths, self.rows)):
            rate = self.bias[i] + self.noise(n)
            if hits:
                rate = rate + 8 * self.white * self.rng.choice([-1, 1], n) * (self.rng.random(n) < 1 / 2000)
            paths.append(Path(f"{self.path}_{i}.csv"))
            degc = self.degc[i] + 0.01 * self.rng.standard_normal(n)
            write_log(paths[-1], np.arange(1, n + 1)[rows], degc[rows], rate[rows])
        options = belief(self.path, self.rng, self.number, self.white, self.sigma, self.tau_s)
        axis = axis_told(program, options, paths[:self.n_fitted], paths[self.n_fitted:])
        knows = "none" if self.number % 4 == 3 else "sheet" if self.number % 2 else "true"
        drawn = f"{len(self.lengths)} logs, white {self.white:.0f}, slow {self.sigma:.1f} dph {self.tau_s:.0f} s, belief {knows}"
        print(f"{self.path.name}: {drawn};{self.note}:", axis["verdict"], "|", axis["title"], *found(axis), own_jumps(axis) or "")
        return axis


# ---- devices: whether the answer is right


def own_jumps(axis):
    return (axis["gap"] or {}).get("jumps_of_held_out_logs") or []


def told_steps(axis):
    return [s for e in axis["effects"] if e["name"] == "bias_step" or e["family"] == "slow_noise"
            for s in e["parameters"].get("steps", [])]


def are_told(d, axis, least):
    """Every jump that is at least this strong is among the steps told, in its log, near its moment and of its size."""
    def is_told(j):
        return any(s["log"] == j["log"] and abs(s["t_s"] - j["t_s"]) <= j["within_s"]
                   and abs(s["amplitude_dph"] - j["size"]) <= SIZE_ERRORS * abs(j["size"]) / j["d"] for s in told_steps(axis))
    return all(is_told(j) for j in d.jumps if j["d"] >= least)


def jumps_are_right(folder, number, program=DIAGNOSE):
    d = Device(folder, "jumps", number)
    d.draw_jumps()
    axis = d.answer(program)
    return are_told(d, axis, 8) and all(e["name"] == "bias_step" or e["family"] in NOISE for e in axis["effects"])


def lag_beside(d):
    """An element that lags its thermometer; the bias but for its scale."""
    rng, tau_s = d.rng, d.rng.uniform(200, 600)
    coeff = np.array([0, rng.choice([-1, 1]) * rng.uniform(0.6, 1), rng.normal(0, 0.3), rng.normal(0, 0.15)])
    settled = [cubic(coeff, newton(t, tau_s, t[0])) for t in d.degc]
    real = [cubic(coeff, newton(t, tau_s, t[0] + rng.uniform(-3, 3))) for t in d.degc]
    d.shapes = [s - cubic(coeff, t) for s, t in zip(settled, d.degc)]
    d.starts = [r - s for r, s in zip(real, settled)]
    d.bias = [np.full(n, rng.normal(0, 30)) for n in d.lengths]
    d.note += f" lag {tau_s:.0f} s"
    return real


def bump_beside(d):
    centre, sigma = d.rng.uniform(10, 45), d.rng.uniform(2, 5)
    d.shapes = [np.exp(-((t - centre) / sigma) ** 2 / 2) for t in d.degc]
    d.note += f" bump {centre:.1f}±{sigma:.1f} degC"
    return d.shapes


def beside_is_right(folder, number, program=DIAGNOSE):
    d, is_lag = Device(folder, "beside", number), number // 4 % 2 == 0
    cause = {"thermal_lag", "thermal_memory"} if is_lag else {"thermal_anomaly", "function_of_temperature"}
    whole, goal = lag_beside(d) if is_lag else bump_beside(d), d.rng.uniform(20, 35)
    scale = d.draw_jumps_and_cause(goal)
    d.note += f" cause {scale:+.0f} dph d {goal:.1f}"
    d.bias = [b + scale * w for b, w in zip(d.bias, whole)]
    axis = d.answer(program)
    return are_told(d, axis, 9) and any(e["name"] in cause for e in axis["effects"])


def none_is_right(folder, number, program=DIAGNOSE):
    axis = Device(folder, "none", number).answer(program, hits=number % 3 == 1)
    has_steps = any(e["name"] == "bias_step" or "steps" in e["parameters"] for e in axis["effects"])
    return not has_steps and not own_jumps(axis)


def check(kind, devices, least, folder):
    at_most_wrong(len(devices) - least, devices, lambda k: kind(folder, k))


def known(reason):
    return pytest.mark.xfail(strict=True, reason=f"known: {reason}")


@pytest.mark.parametrize("devices, least", [
    (range(2), 2), pytest.param(range(2, 26), 23, marks=[pytest.mark.long, known("22 of 24: run to run in place of a jump, a curve that is not there")])])
def test_single_jumps_are_told(devices, least, tmp_path):
    check(jumps_are_right, devices, least, tmp_path)


@pytest.mark.parametrize("devices, least", [
    (range(1), 1), pytest.param(range(1, 17), 14, marks=pytest.mark.long)])
def test_cause_and_jumps_beside_it_are_told(devices, least, tmp_path):
    check(beside_is_right, devices, least, tmp_path)


@pytest.mark.parametrize("devices, least", [(range(2), 2), pytest.param(range(2, 102), 100, marks=pytest.mark.long)])
def test_no_jump_is_made_up(devices, least, tmp_path):
    check(none_is_right, devices, least, tmp_path)
