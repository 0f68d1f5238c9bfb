# SPDX-License-Identifier: MIT
"""A bias with a relay of the temperature: named with its height, whatever it began with, and never made of one jump in time.

The relay adds A where the temperature has risen above `up`, until it falls below `up - band` (1 to 6 degC); between the two it
keeps its state, and a log that begins there begins on or off as drawn: the device is never reset.  A row is a second; a device
has 3 or 4 logs of 80 to 120 min, the fourth held out.  A chamber goes by one ramp between two soaks, by stairs, or by
ways up and down after a soak, 0 to 55 degC, and the body follows it by 40 to 120 s.  Every second log (drawn) begins inside the
band, 1/10 of it or more from its edges.  Chambers and thresholds are drawn until the relay of the fitted logs has switched
twice or more each way.  Of every device are drawn: white noise (15 to 40 dph in a second), one first-order process (5 to 12 dph,
60 to 200 s), a cubic of the temperature, and a constant for every log.  Belief as in asking.py.
A) such a relay with a d of 12 to 30.  `thermal_step` or the family `function_of_temperature` must be told, once, and nothing else
but noise; a told height of a step must be within 5 standard errors, which are size / d (by chance 1 miss in 1.7 million: what is
left of this is for a believed noise that is wrong by 1.5, and for thresholds that are searched for).
B) the same devices without the relay: one element lags its thermometer by 200 to 600 s (d 20 to 35; its state is up to 3 degC
off at the start of a log), and the bias jumps once, in one log, with a d of 9 to 15, within 4 min after the chamber has left a
soak of 3 min or more.  `thermal_step` must not be named for itself; it may stand in the set of another name.  A device where a
relay can do the same is drawn again: beside the lag, the best of relays with a threshold within 1 degC of the temperature of
the moment must leave 8 nats or more of the jump (a margin of 4 sigma), whatever their start states.

d is sqrt(2 gain) under the true noise beside constants of the logs and a common cubic; for A also beside a free start state of
every log that begins in the band, for B beside the other cause and the start states of the lag.
Counts, chosen before the first run: of the first two devices none may miss, of 16 more 15 must be right (A and B:
who misses 1 in 50 fails 1 time in 25, who misses 1 in 5 passes 1 time in 7).  No code is shared with the programs."""
import math

import numpy as np
import pytest
from scipy.signal import lfilter

from asking import DIAGNOSE, at_most_wrong, axis_told, belief, found, write_log

SEED, N_FITTED, SIZE_ERRORS, LEFT_NATS = 20330607, 3, 5, 8
FAMILY, NOISE = "function_of_temperature", {"slow_noise", "fast_noise"}
OFF_DEGC, BANDS_DEGC = [-1, -0.5, -0.2, 0, 0.2, 0.5, 1], [0, 1, 3, 6, 12, 24]  # of the relays that could be taken for a jump


def newton(x, tau_s, start):
    phi = math.exp(-1 / tau_s)
    return lfilter([1 - phi], [1, -phi], x, zi=[phi * start])[0]


def chamber(rng, n, start):
    """The air of every second, from this start (or any), and when it leaves a soak."""
    ends = np.array([rng.uniform(0, 8), rng.uniform(47, 55)])[::rng.choice([-1, 1])]
    shape, first = rng.choice(["ramp", "stairs", "ways"]), ends[0] if start is None else start
    if shape == "ramp":
        at, levels = [0, rng.uniform(0.08, 0.25) * n, rng.uniform(0.7, 0.92) * n, n], np.repeat([first, ends[1]], 2)
    elif shape == "stairs":
        k = rng.integers(3, 6)
        levels = np.append(np.linspace(first, ends[1], k), np.linspace(*ends[::-1], k)[1:])
        begin = (np.arange(len(levels)) + np.append(0, rng.uniform(-0.2, 0.2, len(levels) - 1))) * n / len(levels)
        there = begin + np.append(0, abs(np.diff(levels))) / rng.uniform(2, 4) * 60
        at, levels = np.ravel([there, np.maximum(np.append(begin[1:], n), there + 1)], order="F"), np.repeat(levels, 2)
    else:
        at, levels = [0, rng.uniform(180, 600)], [rng.uniform(5, 50) if start is None else start] * 2
        while at[-1] < n:
            levels.append(ends[len(at) % 2] + rng.uniform(0, 3) * np.sign(27.5 - ends[len(at) % 2]))
            at.append(at[-1] + (abs(levels[-1] - levels[-2]) / rng.uniform(0.9, 2) + rng.uniform(0, 5)) * 60)
    left = [b for a, b, x, y in zip(at, at[1:], levels, levels[1:]) if x == y and b - a >= 180 and b < n - 600]
    return np.interp(np.arange(n) + 0.5, at, levels), left


def relay(degc, up, band, begins_on):
    """1 where it is on; `begins_on` counts where it begins inside the band only."""
    inside = (degc <= up) & (degc >= up - band)
    state = np.where(inside, begins_on, degc > up)
    return 1.0 * state[np.maximum.accumulate(np.where(inside, 0, np.arange(len(degc))))]


def cubic(coeff, degc):
    return np.polynomial.polynomial.polyval((degc - 27.5) / 27.5, coeff)


def left_beside(column, others):
    q = np.linalg.qr(others)[0]
    return column - q @ (q.T @ column)


class Device:
    def __init__(self, folder, kind, number, attempt=0):
        self.rng = rng = np.random.default_rng([SEED, number, attempt])  # the same devices for A and the first attempts of B
        self.path, self.number = folder / f"{kind}{number}", number
        self.white, self.sigma, self.tau_s = rng.uniform(15, 40), rng.uniform(5, 12), math.exp(rng.uniform(*np.log([60, 200])))
        self.lengths = rng.integers(4800, 7201, rng.integers(3, 5))
        switches = [0, 0]
        while min(switches) < 2:
            self.up, self.band = rng.uniform(15, 45), rng.uniform(1, 6)
            starts = [self.up - self.band * rng.uniform(0.1, 0.9) if rng.random() < 0.5 else None for _ in self.lengths]
            airs, self.left = zip(*map(lambda n, start: chamber(rng, n, start), self.lengths, starts))
            self.degc = [newton(air, rng.uniform(40, 120), air[0]) for air in airs]
            self.begins_on = rng.integers(0, 2, len(self.lengths))
            self.state = [relay(t, self.up, self.band, on) for t, on in zip(self.degc, self.begins_on)]
            switches = [sum(sum(np.diff(s) == way) for s in self.state[:N_FITTED]) for way in (1, -1)]
        in_band = [i for i, t in enumerate(self.degc) if self.up - self.band <= t[0] <= self.up]
        self.note = f"up {self.up:.1f} band {self.band:.1f} degC, {switches} switches, logs {in_band} begin in the band;"
        self.coeff = rng.normal(0, [0, 250, 120, 60])

    def whitened(self, parts):
        """Innovations in standard deviations, the fitted logs one after another."""
        phi, out = math.exp(-1 / self.tau_s), []
        for i in range(N_FITTED):
            columns = np.column_stack([column for part in parts for column in part[i]])
            mean, var = 0, self.sigma ** 2
            for row in columns:
                total, miss = var + self.white ** 2, row - mean
                out.append(miss / math.sqrt(total))
                mean, var = phi * (mean + var / total * miss), var * self.white ** 2 / total
                var = phi ** 2 * var + (1 - phi ** 2) * self.sigma ** 2
        return np.array(out)

    def of_log(self, i, column):
        """A part: of every fitted log a list of columns.  Here one, nothing but in log i."""
        return [[column if k == i else np.zeros(self.lengths[k])] for k in range(N_FITTED)]

    def nuisance(self):
        """The common cubic, and constants of the logs."""
        powers = [[((t - 27.5) / 27.5) ** p for p in (1, 2, 3)] for t in self.degc[:N_FITTED]]
        return [powers, *(self.of_log(i, np.ones(self.lengths[i])) for i in range(N_FITTED))]

    def relay_columns(self, up, band, begins_on):
        """A relay, and the free start states of the logs that begin inside its band."""
        starts = [self.of_log(i, relay(t, up, band, 1) - relay(t, up, band, 0))
                  for i, t in enumerate(self.degc[:N_FITTED]) if up - band <= t[0] <= up]
        return [[[relay(t, up, band, on)] for t, on in zip(self.degc[:N_FITTED], begins_on)], *starts]

    def noise(self, n):
        phi = math.exp(-1 / self.tau_s)
        drive = self.sigma * self.rng.standard_normal(n) * np.append(1, np.full(n - 1, math.sqrt(1 - phi ** 2)))
        return self.white * self.rng.standard_normal(n) + lfilter([1], [1, -phi], drive)

    def answer(self, program, bias):
        paths = [self.path.with_name(f"{self.path.name}_{i}.csv") for i in range(len(self.lengths))]
        for path, n, degc, rate in zip(paths, self.lengths, self.degc, bias):
            write_log(path, np.arange(1, n + 1), degc + 0.01 * self.rng.standard_normal(n), rate + self.noise(n))
        options = belief(self.path, self.rng, self.number, self.white, self.sigma, self.tau_s)
        axis = axis_told(program, options, paths[:N_FITTED], paths[N_FITTED:])
        drawn = f"{len(paths)} logs, white {self.white:.0f}, slow {self.sigma:.1f} dph {self.tau_s:.0f} s, {options[:1]}"
        print(f"{self.path.name}: {drawn}; {self.note}:", axis["verdict"], "|", axis["title"], *found(axis))
        return axis


def relay_is_right(folder, number, program=DIAGNOSE):
    d = Device(folder, "relay", number)
    strength = d.rng.uniform(12, 30)
    x = d.whitened([*d.nuisance(), *d.relay_columns(d.up, d.band, d.begins_on)])  # six of nuisance, the relay, its starts
    size = d.rng.choice([-1, 1]) * strength / np.linalg.norm(left_beside(x[:, 6], np.delete(x, 6, axis=1)))
    bias = [cubic(d.coeff, t) + d.rng.normal(0, 30) + size * s for t, s in zip(d.degc, d.state)]
    d.note += f" {size:+.1f} dph d {strength:.1f}"
    axis = d.answer(program, bias)
    told = [e for e in axis["effects"] if e["name"] in ("thermal_step", FAMILY)]
    heights = [e["parameters"]["amplitude_dph"] for e in told if e["name"] != FAMILY or "temp_degc" in e["parameters"]]
    return (len(told) == 1 and all(abs(h - size) <= SIZE_ERRORS * abs(size) / strength for h in heights)
            and all(e in told or e["family"] in NOISE for e in axis["effects"]))


def jump_beside_a_lag(folder, number, attempt):
    """A device of B, the bias of every log, and what the best relay leaves of the jump, in nats."""
    d = Device(folder, "jump", number, attempt)
    rng, tau_s, goal, strength = d.rng, d.rng.uniform(200, 600), d.rng.uniform(20, 35), d.rng.uniform(9, 15)
    coeff = np.array([0, rng.choice([-1, 1]) * rng.uniform(0.6, 1), rng.normal(0, 0.3), rng.normal(0, 0.15)])
    settled = [cubic(coeff, newton(t, tau_s, t[0])) for t in d.degc]
    real = [cubic(coeff, newton(t, tau_s, t[0] + rng.uniform(-3, 3))) for t in d.degc]
    starts = [d.of_log(i, real[i] - settled[i]) for i in range(N_FITTED)]
    x = d.whitened([*d.nuisance(), *starts, [[s - cubic(coeff, t)] for s, t in zip(settled, d.degc)]])  # the lag is last
    log = int(rng.choice([i for i in range(N_FITTED) if d.left[i]]))
    moment_s = rng.choice(d.left[log]) + rng.uniform(0, 240)
    shape, at_degc = 1.0 * (np.arange(1, d.lengths[log] + 1) > moment_s), d.degc[log][int(moment_s)]
    relays = [d.relay_columns(at_degc + off + higher, band, np.zeros(N_FITTED))
              for off in OFF_DEGC for band in BANDS_DEGC for higher in {0, band}]
    more = d.whitened([d.of_log(log, shape), *sum(relays, [])])
    jump, ends = left_beside(more[:, 0], x), np.cumsum([1, *map(len, relays)])
    size = rng.choice([-1, 1]) * strength / np.linalg.norm(jump)
    left = min(np.linalg.norm(size * left_beside(jump, np.column_stack([x, more[:, a:b]]))) ** 2 / 2
               for a, b in zip(ends, ends[1:]))
    scale = rng.choice([-1, 1]) * goal / np.linalg.norm(left_beside(x[:, -1], np.column_stack([x[:, :-1], more[:, 0]])))
    bias = [scale * r + rng.normal(0, 30) + (i == log) * size * (np.arange(1, len(r) + 1) > moment_s) for i, r in enumerate(real)]
    d.note += f" lag {tau_s:.0f} s d {goal:.1f}, jump {log}:{moment_s:.0f}s {at_degc:.1f} degC {size:+.1f} dph d {strength:.1f}"
    return d, bias, left


def jump_is_no_relay(folder, number, program=DIAGNOSE):
    for attempt in range(100):  # what a relay can do as well is drawn again, the device too: on some it always can
        d, bias, left = jump_beside_a_lag(folder, number, attempt)
        if left >= LEFT_NATS:
            return all(e["name"] != "thermal_step" for e in d.answer(program, bias)["effects"])
    raise AssertionError(f"device {number}: a relay could do the same in every draw")


def check(kind, devices, least, folder):
    at_most_wrong(len(devices) - least, devices, lambda k: kind(folder, k))


DEVICES = pytest.mark.parametrize("devices, least", [(range(2), 2), pytest.param(range(2, 18), 15, marks=pytest.mark.long)])


@DEVICES
def test_relay_is_named_with_its_height(devices, least, tmp_path):
    check(relay_is_right, devices, least, tmp_path)


@pytest.mark.parametrize("devices, least", [(range(1), 1), pytest.param(range(1, 18), 16, marks=pytest.mark.long)])
def test_jump_beside_a_lag_is_no_relay(devices, least, tmp_path):
    check(jump_is_no_relay, devices, least, tmp_path)
