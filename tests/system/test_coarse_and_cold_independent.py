# SPDX-License-Identifier: MIT
"""Coarse thermometers, short lags, and held-out logs that go where no fitted log was.

A log has 80 to 130 min, a row a second.  The air goes one way, there and back, by stairs or by triangles in 0 to 55 degC, the
body follows by 40 to 120 s.  Drawn are white noise (10 to 60 dph in a second), one first-order process (3 to 15 dph, 30 to
200 s), a cubic of the gyro's temperature and a constant for every log.  Belief and call are asking.py's; no other code is
shared.  A fine thermometer has steps of 0.001 to 0.03 degC, of a rounding of less than d 2, and noise of 0.002 to 0.01 degC.
Q) The thermometer has steps of 0.3 to 0.8 degC and a noise of 0.01 degC before it rounds; the gyro feels the body.  The air
rests less than 4 min at a time: a soak hides where inside a step the temperature is.  Of devices in turn 1, 2 and 3 to 6
logs are fitted, none to 2 held out.  `temperature_sensor_quantization` must be named, or stand in the set of what is named
first, and no thermal_lag of less than 15 s.  F) The thermometer is fine, and lags the gyro (tau_s < 0) or leads it by 4 to
12 s, both at rest at first; as many logs.  `thermal_lag` must be named, tau_s within 5 of its standard errors (1 miss in
1.7 million by chance), and no temperature_sensor_quantization.  E) Nothing: 1 to 3 fitted logs cover 20 to 30 degC, 1 or 2
held-out logs go 5 to 25 degC beyond, all on one side.  Nothing but noise_parameters may be named; no held-out log may be said
to be noisier or to jump.  J) As E, but the bias of one held-out log jumps, 2 degC or more inside the fitted temperatures,
12 min or more from its ends and from all its rows outside them.  Just this jump must be told of held-out logs, within 30 s.

Strength d is the norm of what an effect adds to the rates, whitened by the true noise, after constants of the logs and one
cubic of the shown temperature.  Q, F: 12 to 30 in the fitted logs, by the size of the cubic.  J: 10 to 20 in its log alone.
Drawn again are lags of which a drift with the rate, warm-ups or powers 4 and 5 leave less than d 6, and jumps that differ
from the same 30 s off by less (the wrong time would win 1 time in 700).  Drawn again too (F, Q) are cubics over 600 dph/degC
or by which the thermometer's noise is over a tenth of the white noise (no rule at the first run: one F had 3000 dph/degC).

Counts: of the first two devices of a kind none may miss, of 62 more 3.  Who misses 1 in 50 fails 1 time in 25 and 1 in 28, who
misses 1 in 5 passes the long form 1 time in 1000.  At first 14 more were asked (1 miss, J 2): J, Q and F failed; then, with
other devices, all passed, J by luck.  So few cannot tell, and what is known to fail is marked."""
import math

import numpy as np
import pytest
from scipy.signal import lfilter

from asking import DIAGNOSE, at_most_wrong, axis_told, belief, found, write_log

SEED, FAR_S, JUMP_S, COARSE, STEPS = 20340214, 720, 30, "temperature_sensor_quantization", [0.001, 0.002, 0.005, 0.01, 0.02, 0.03]


def follows(x, tau_s):
    """Newton cooling from rest, exact where x moves in a straight line from second to second."""
    phi, mean = math.exp(-1 / tau_s), tau_s * (1 - math.exp(-1 / tau_s))
    return x[0] + lfilter([1 - mean, mean - phi], [1, -phi], x - x[0])


def body(rng, n, ends, longest_rest_s):
    shape, (first, last) = rng.choice(["way", "back", "stairs", "triangles"]), np.array(ends)[::rng.choice([-1, 1])]
    legs = {"way": 1, "back": 2, "stairs": rng.integers(2, 6), "triangles": rng.integers(3, 8)}[shape]
    levels = np.linspace(first, last, legs + 1) if shape == "stairs" else np.where(np.arange(legs + 1) % 2, last, first)
    if shape == "triangles":
        levels[2:] += rng.uniform(0, 4, legs - 1) * np.sign(np.mean(ends) - levels[2:])
    rests = rng.uniform(30, min(longest_rest_s, n / (2 * legs + 2)), legs + 1)
    ways = np.abs(np.diff(levels)) / rng.uniform(0.7, 1.4, legs)
    lasts = np.ravel([rests, np.append(ways / ways.sum() * (n - rests.sum()), 0)], order="F")[:-1]
    air = np.interp(np.arange(n), np.append(0, np.cumsum(lasts)), np.repeat(levels, 2))
    return follows(air, rng.uniform(40, 120)), f"{shape}{legs} {first:.0f}:{last:.0f}"


def whitened(own, x):
    """By the steady filter of white noise and a first-order process, which is (1 - phi L) / (1 - theta L)."""
    (white, sigma, _), phi = own, math.exp(-1 / own[2])
    b = (sigma ** 2 * (1 - phi ** 2) / white ** 2 + 1 + phi ** 2) / (2 * phi)
    theta = b - math.sqrt(b * b - 1)
    return lfilter([1, -phi], [1, -theta], x, axis=0) / (white * math.sqrt(phi / theta))


def strength(own, shown, effect, others=None):
    """d of lists of one array a log; `others`: columns of each log beside the constants and the cubic."""
    rows = np.vstack([whitened(own, np.column_stack([e, np.vander((t - 27.5) / 27.5, 4)[:, :3], np.tile(
        np.arange(len(shown)) == i, (len(t), 1))] + ([others[i]] if others else [])))
                      for i, (t, e) in enumerate(zip(shown, effect))])
    rows[:, 1:] /= np.linalg.norm(rows[:, 1:], axis=0)
    return np.linalg.norm(rows[:, 0] - rows[:, 1:] @ np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=1e-10)[0])


def noise(rng, n, white, sigma, tau_s):
    phi, drive = math.exp(-1 / tau_s), rng.standard_normal(n)
    drive[1:] *= math.sqrt(1 - phi ** 2)
    return white * rng.standard_normal(n) + sigma * lfilter([1], [1, -phi], drive)


class Device:
    def __init__(self, folder, kind, number):
        self.kind, self.number, self.path = kind, number, folder / f"{kind}{number}"
        self.rng, is_drawn = np.random.default_rng([SEED, ord(kind), number]), False
        while not is_drawn:
            is_drawn = self.is_drawn()

    def ends(self):
        rng = self.rng
        if self.kind in "QF":
            self.n_fitted, n_held_out, cold = [1, 2, rng.integers(3, 7)][self.number % 3], rng.integers(0, 3), rng.uniform(0, 20)
            hot = rng.uniform(cold + 30, 55)
            return [(cold + rng.uniform(0, 4), hot - rng.uniform(0, 4)) for _ in range(self.n_fitted + n_held_out)]
        self.n_fitted, n_held_out, width = rng.integers(1, 4), rng.integers(1, 3), rng.uniform(20, 30)
        beyond = rng.uniform(5, 25, n_held_out)
        cold = rng.uniform(0, 55 - width - max(beyond))
        ends = [(cold + rng.uniform(0, 2) * (i > 0), cold + width - rng.uniform(0, 2) * (i > 0)) for i in range(self.n_fitted)]
        ends += [(cold + rng.uniform(0, 4), cold + width + b) for b in beyond]
        return ends if rng.random() < 0.5 else [(55 - hot, 55 - cold) for cold, hot in ends]

    def is_drawn(self):
        """False where it has to be drawn again."""
        rng, kind = self.rng, self.kind
        self.own = own = rng.uniform(10, 60), rng.uniform(3, 15), math.exp(rng.uniform(*np.log([30, 200])))
        bodies, shapes = zip(*(body(rng, rng.integers(4800, 7801), e, 225 if kind == "Q" else 900) for e in self.ends()))
        self.tau = rng.choice([-1, 1]) * rng.uniform(4, 12) if kind == "F" else 0
        moved = [follows(t, abs(self.tau)) for t in bodies] if kind == "F" else bodies
        place, gyro = (bodies, moved) if self.tau > 0 else (moved, bodies)
        step, blur = (round(rng.uniform(0.3, 0.8), 3), 0.01) if kind == "Q" else (rng.choice(STEPS), rng.uniform(0.002, 0.01))
        self.read = [step * np.round((t + blur * rng.standard_normal(len(t))) / step) for t in place]
        self.d, cubic = rng.uniform(10, 20) if kind == "J" else rng.uniform(12, 30), np.polynomial.Polynomial(
            rng.normal(0, [0, 250, 120, 60]), [0, 55])
        if kind in "QF":
            shown = (self.read if kind == "Q" else place)[:self.n_fitted]
            miss = [cubic(g) - cubic(s) for g, s in zip(gyro, shown)]
            scale = self.d / strength(own, shown, miss)
            cubic, steepest = cubic * scale, max(np.abs(scale * cubic.deriv()(t)).max() for t in bodies)
            if steepest > 600 or blur * steepest > own[0] / 10:
                return False
        if kind != "Q" and strength(own, place, [cubic(t) - cubic(step * np.round(t / step)) for t in place]) > 2:
            return False
        if kind == "F":
            others = [[np.gradient(t) for t in shown], [((t[:, None] - 27.5) / 27.5) ** [4, 5] for t in shown],
                      *([np.exp(-np.arange(len(t)) / s) for t in shown] for s in (100, 300, 1000))]
            if min(scale * strength(own, shown, miss, o) for o in others) < 6:
                return False
        self.rate = [cubic(t) + rng.normal(0, 30) + noise(rng, len(t), *own) for t in gyro]
        self.note = (f"white, process {np.round(own, 1)}, {self.n_fitted} of {len(place)} logs fitted: {', '.join(shapes)}; step "
                     f"{step} blur {blur:.4f}, cubic {np.round(cubic.coef[1:])}, d {self.d:.1f} (E: 0) tau {self.tau:+.2f} s")
        return kind != "J" or self.is_jump_drawn(place)

    def is_jump_drawn(self, place):
        rng, self.log, inside = self.rng, self.rng.integers(len(place) - self.n_fitted), np.concatenate(place[:self.n_fitted])
        t, lo, hi = place[self.n_fitted + self.log], inside.min(), inside.max()
        beyond, at = np.append(0, np.cumsum((t < lo) | (t > hi))), np.arange(FAR_S, len(t) - FAR_S)
        at = at[(beyond[at + FAR_S] == beyond[at - FAR_S]) & (t[at] > lo + 2) & (t[at] < hi - 2)]
        if not len(at):
            return False
        self.jump = rng.choice(at)
        before, step, after = (1.0 * (np.arange(len(t)) >= self.jump + s) for s in (-JUMP_S, 0, JUMP_S))
        size = rng.choice([-1, 1]) * self.d / strength(self.own, [t], [step])
        self.rate[self.n_fitted + self.log] += size * step
        self.note += f", held-out log {self.log} jumps by {size:.1f} dph at {self.jump + 1} s, {t[self.jump]:.1f} degC"
        return min(abs(size) * strength(self.own, [t], [step - s]) for s in (before, after)) >= 6


def is_right(folder, kind, number, program=DIAGNOSE, more=()):
    d = Device(folder, kind, number)
    paths = [folder / f"{kind}{number}_{i}.csv" for i in range(len(d.read))]
    for path, read, rate in zip(paths, d.read, d.rate):
        write_log(path, np.arange(1, len(read) + 1), read, rate)
    options = belief(d.path, d.rng, number, *d.own)
    axis = axis_told(program, [*options, *more], paths[:d.n_fitted], paths[d.n_fitted:])
    jumps, louder = ((axis["gap"] or {}).get(f"{k}_of_held_out_logs", []) for k in ("jumps", "stronger_noise"))
    print(f"{kind}{number}: {d.note}; {options[:1]}:", axis["verdict"], "|", axis["title"], *found(axis), jumps, louder)
    names, lags = [e["name"] for e in axis["effects"]], [e for e in axis["effects"] if e["name"] == "thermal_lag"]
    if kind == "Q":
        return ((COARSE in names or COARSE in [m["name"] for e in axis["effects"][:1] for m in e["set"]])
                and all(abs(e["parameters"]["tau_s"]) >= 15 for e in lags))
    if kind == "F":
        return (len(lags) == 1 and abs(lags[0]["parameters"]["tau_s"] - d.tau) <= 5 * lags[0]["std_errors"]["tau_s"]
                and COARSE not in names)
    if kind == "E":
        return all(n == "noise_parameters" for n in names) and not jumps and not louder
    return len(jumps) == 1 and jumps[0]["log"] == d.log and abs(jumps[0]["t_s"] - d.jump - 1) <= JUMP_S


def check(kind, devices, most, folder):
    at_most_wrong(most, devices, lambda k: is_right(folder, kind, k))


@pytest.mark.parametrize("kind", "QFEJ")
def test_coarse_thermometers_short_lags_and_logs_beyond_the_fitted_ones(kind, tmp_path):
    check(kind, range(2), 0, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("kind", [
    "Q", "E", "J",
    pytest.param("F", marks=pytest.mark.xfail(strict=True, reason="known: some lags of 5 s are told by their family alone"))])
def test_many_of_the_same(kind, tmp_path):
    check(kind, range(2, 64), 3, tmp_path)
