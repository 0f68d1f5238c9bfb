# SPDX-License-Identifier: MIT
"""Extra columns that matter or only look like it, coefficients that change from run to run, logs of unlike temperatures.

A chamber goes by ramps (1.5 to 3 degC/min; 0.6 to 2 in F and G) and soaks, its air overshoots, the body follows by 50 to
150 s; thermometer noise 0.005 degC, a row a second, 80 to 130 min a log.  The bias is a cubic of the temperature and a
constant of each log, beside white noise and one first-order process.  Two of eight devices are accelerometers (mg).  The
strength d of a cause is the square root of twice the log-likelihood that the fitted logs gain on the average for who knows
its form and the noise, beside a free cubic and free constants (of D: the marginal likelihood with its true sigma); it is
drawn from 15 to 40.  Believed noise (white and slow part alike) in turn exact, 3 times, a third, none.

A) The bias follows supply_v, humidity_pct or vibration_g in a straight line, beside two to four columns that do nothing.
   Right: auxiliary_channel with that channel, its gain within 5 of its errors or 10 %; beside it noise only; not "unexplained".
B) Nothing, beside three or four of: regulator_v that follows the temperature, board_degc 60 to 300 s behind, battery_v that
   falls with time, heater_w that follows the temperature's rate.  Right: nothing or noise_parameters; not "unexplained".
C) Lag (the gyro 100 to 300 s behind its thermometer) or play (half-width 2 to 8 degC), random start, beside the columns of B.
   Right: first, noise_parameters apart, is the member or thermal_memory, and no column is named beside it.  In two of the four
   lags board_degc is the gyro's own temperature (0.02 degC of noise), in the others another one, by a factor of 1.5 at least.
   As the gain of a column takes up most of a lag, auxiliary_channel of board_degc is a fair first name where it leaves less than
   8 nats of the lag's gain (d^2 (1 - rho^2) / 2, computed here: section 6 of diagnosis.md) - whether it is the gyro's own or
   not -, if the set of the first, open_pairs or indistinguishable hold it together with a memory.  Elsewhere it is wrong.
D) Slope and curvature are drawn anew in every log; 4 to 6 are fitted, 0 to 2 held out; idle columns in half of them.  Right:
   first, noise_parameters apart, is run_to_run or its set holds it; no other log can be foretold, the true shrinkage is 0:
   that which is told is null or below 0.2, or its interval reaches 0.
E) Slope and curvature of one log of five are others; board_degc and a wandering supply_v do nothing.  Right: anything but a
   thermal_memory, function_of_temperature or auxiliary_channel of board_degc named with explained or partly_explained.
F) Nothing; each of 5 or 6 logs covers 20 degC of 70, overlapping; idle columns in half of them.  Right: as B.
G) As F with play of half-width 1.5 to 4 degC.  Right: first, noise_parameters apart, is thermal_hysteresis, thermal_memory or
   one whose set holds thermal_hysteresis.
No answer at all is wrong in every kind.

Limits, from before any result: of the first two devices of a kind none may be wrong, of 6 more one (at a rate of 5 % more
come in 3 of 100).  Nothing of the simulator or the rules was changed after a result, but that the kinds of device repeat
after 8, so that more could be drawn; the first 8 are the same with it.

Found: 8 of 8 right in every kind but F (7 of 8), and 32 of 32 in each of the numbers 8 to 39, which are not asked here.  F6 is
"unexplained" under every wrong belief (right with the exact one or none): the noise was estimated again as two processes,
one of 4 s, which are 25 nats less likely than the true single one, and the spectrum that is left was called a gap.  Twice of
20 lags auxiliary_channel of board_degc came first, with a lag in its set, where it left 1.0 and 3.6 nats (C6, C23).  The program
was then mended (two processes that are not worth their name, and that the seconds find less likely than one, go): F6 is right."""
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from asking import DIAGNOSE, at_most_wrong, axis_of, found, model_option, run, write_log

SEED, MG_OF_DPH = 20360214, 1 / 300
MEMORY = ["thermal_memory", "temperature_rate", "thermal_hysteresis", "thermal_lag", "thermal_creep"]
FAIR_NATS = 8


# ---- physics, a value a second


def follow(x, tau_s, start=None):
    """Newton cooling towards x."""
    keep, at, out = math.exp(-1 / tau_s), x[0] if start is None else start, np.empty(len(x))
    for k, value in enumerate(x):
        at = value + keep * (at - value)
        out[k] = at
    return out


def markov(rng, n, tau_s):
    """A stationary first-order process of standard deviation 1."""
    keep, at, out = math.exp(-1 / tau_s), rng.standard_normal(), np.empty(n)
    for k, drive in enumerate(math.sqrt(1 - keep ** 2) * rng.standard_normal(n)):
        out[k] = at
        at = keep * at + drive
    return out


def play(x, half, start):
    at, out = start, np.empty(len(x))
    for k, value in enumerate(x):
        at = min(max(at, value - half), value + half)
        out[k] = at
    return out


def overshooting(x, period_s, damping):
    """Air of a chamber that is controlled to x: second order."""
    w, at, speed, out = 2 * math.pi / period_s, x[0], 0.0, np.empty(len(x))
    for k, value in enumerate(x):
        speed += w * w * (value - at) - 2 * damping * w * speed
        at += speed
        out[k] = at
    return out


def place(rng, n, low, high, slowest, fastest):
    """Temperature of the body: soak, ramp, soak, ... to and fro; the first two ramps go to the very ends."""
    level = rng.choice([low, high, rng.uniform(low + 0.3 * (high - low), low + 0.7 * (high - low))])
    up = level < high if level in (low, high) else rng.random() < 0.5
    t, at, legs = 0.0, [(0.0, level)], 0
    while t < n:
        t += rng.uniform(300, 900)
        at.append((t, level))
        inset = rng.uniform(0, 0.4) * (high - low) if legs > 1 else 0
        goal = high - inset if up else low + inset
        t += abs(goal - level) / rng.uniform(slowest, fastest) * 60
        at.append((t, goal))
        level, up, legs = goal, not up, legs + 1
    wanted = np.interp(np.arange(n), *zip(*at))
    return follow(overshooting(wanted, rng.uniform(300, 600), rng.uniform(0.5, 0.8)), rng.uniform(50, 150))


def bursts(rng, n):
    """Vibration in g: now and then somebody runs a machine."""
    out, t = np.full(n, 0.01), rng.uniform(0, 600)
    while t < n:
        end = t + rng.uniform(60, 400)
        out[int(t):int(end)] += rng.uniform(0.05, 0.5)
        t = end + rng.uniform(200, 900)
    return out


def own_life(rng, name, n, setting):
    """What a column of its own life really is, and what the log shows of it."""
    if name == "supply_v":
        true = setting["level"] + 0.01 * rng.standard_normal() + setting["size"] * 0.03 * markov(rng, n, setting["tau_s"])
        return true, true + 0.001 * rng.standard_normal(n)
    if name == "humidity_pct":
        true = 40 + 5 * rng.standard_normal() + setting["size"] * 4 * markov(rng, n, 2.5 * setting["tau_s"])
        return true, true + 0.1 * rng.standard_normal(n)
    if name == "vibration_g":
        true = bursts(rng, n)
        return true, true * (1 + 0.02 * rng.standard_normal(n))
    true = 2000 + 300.0 * (np.cumsum(rng.random(n) < 1 / 500) % 2)  # fan_rpm
    return true, true + 5 * rng.standard_normal(n)


def led(rng, name, degc, setting):
    """What the log shows of a column that temperature or time leads."""
    n = len(degc)
    if name == "regulator_v":
        return 3.3 + 0.001 * setting["size"] * (degc - 25) + 0.0003 * rng.standard_normal(n)
    if name == "board_degc":
        start = degc[0] + rng.normal(0, 2)
        return 3 + follow(degc, setting["tau_s"], start) + 0.02 * rng.standard_normal(n)
    if name == "battery_v":
        fallen = (np.arange(n) / 7000) ** setting["power"]
        return 4.1 + 0.02 * rng.standard_normal() - 0.2 * setting["size"] * fallen + 0.002 * rng.standard_normal(n)
    return 10 + 4 * setting["size"] * 60 * np.gradient(degc) + 0.3 * rng.standard_normal(n)  # heater_w


# ---- generalised least squares


def whitened(columns, white, sigma, tau_s):
    """Innovations, of standard deviation 1, of white noise and one first-order process that is stationary from the start."""
    keep, p, at, out = math.exp(-1 / tau_s), sigma ** 2, np.zeros(columns.shape[1]), np.empty(columns.shape)
    for k, row in enumerate(columns):
        s, e = p + white ** 2, row - at
        out[k] = e / math.sqrt(s)
        gain = p / s
        at = keep * (at + gain * e)
        p = keep ** 2 * p * (1 - gain) + sigma ** 2 * (1 - keep ** 2)
    return out


class Device:
    """Logs of one axis in memory: `degc` is true, `rate` is read, `columns` are shown; `signal` is what the cause adds."""

    def __init__(self, kind, number):
        self.kind, self.number, self.rng = kind, number, np.random.default_rng([SEED, ord(kind), number])
        rng = self.rng
        self.is_accelerometer = number % 8 in (2, 5)
        self.unit = MG_OF_DPH if self.is_accelerometer else 1
        fitted = {"D": rng.integers(4, 7), "E": 5, "F": rng.integers(5, 7), "G": rng.integers(5, 7)}.get(kind, rng.integers(3, 6))
        self.n_fitted, n_held = int(fitted), int(rng.integers(0, 3))
        self.lasts = rng.integers(80 * 60, 130 * 60 + 1, self.n_fitted + n_held)
        self.draw_temperatures(n_held)
        white = rng.uniform(20, 60) * self.unit
        self.noise = white, white * rng.uniform(0.2, 0.7), math.exp(rng.uniform(*np.log([50, 300])))
        self.coeff = rng.uniform(5, 15) * self.half * rng.choice([-1, 1]) * self.unit * np.array(
            [1, rng.normal(0, 0.3), rng.normal(0, 0.2)])
        self.d = rng.uniform(15, 40)
        self.truth, self.columns = "nothing", {}
        self.signal = [np.zeros(n) for n in self.lasts]
        {"A": self.follow_column, "B": self.idle, "C": self.remember, "D": self.change_in_every_run,
         "E": self.change_in_one_run, "F": self.idle, "G": self.remember}[kind]()
        self.quiet = [self.bias(u) + s + rng.normal(0, 60) * self.unit + (998 if self.is_accelerometer else 0)
                      for u, s in zip(self.u, self.signal)]
        self.slow = [self.noise[1] * markov(rng, n, self.noise[2]) for n in self.lasts]
        self.rate = [q + m + self.noise[0] * rng.standard_normal(len(q)) for q, m in zip(self.quiet, self.slow)]
        self.shown = [t + 0.005 * rng.standard_normal(len(t)) for t in self.degc]

    def draw_temperatures(self, n_held):
        rng = self.rng
        if self.kind in "FG":
            low, n = rng.uniform(-30, 0), self.n_fitted
            high = low + 70
            lows = np.append(rng.permutation(np.linspace(low, high - 20, n)), rng.uniform(low, high - 20, n_held))
            self.degc = [place(rng, k, a, a + 20, 0.6, 2) for k, a in zip(self.lasts, lows)]
        else:
            low = rng.uniform(-25, 5)
            high = low + rng.uniform(45, 65)
            self.degc = [place(rng, k, low, high, 1.5, 3) for k in self.lasts]
        self.middle, self.half = (low + high) / 2, (high - low) / 2
        self.u = [(t - self.middle) / self.half for t in self.degc]

    def bias(self, u):
        return u * (self.coeff[0] + u * (self.coeff[1] + u * self.coeff[2]))

    # -- columns

    def add_own_life(self, name):
        """A column of its own life; what it really is."""
        rng = self.rng
        setting = {"level": rng.choice([3.3, 5, 12]), "size": rng.uniform(0.7, 2), "tau_s": rng.uniform(600, 2000)}
        both = [own_life(rng, name, n, setting) for n in self.lasts]
        self.columns[name] = [shown for _, shown in both]
        return [true for true, _ in both]

    def add_led(self, name, tau_s=None):
        rng = self.rng
        setting = {"size": rng.uniform(0.7, 2), "tau_s": tau_s or rng.uniform(60, 300), "power": rng.uniform(0.7, 1.3)}
        self.columns[name] = [led(rng, name, t, setting) for t in self.degc]

    def idle(self):
        if self.kind == "B":
            names = ["regulator_v", "board_degc", "battery_v", "heater_w"]
            if self.number % 3:
                names.pop(self.rng.integers(4))
            for name in names:
                self.add_led(name)
        elif self.number % 2:
            self.add_own_life("supply_v")
            self.add_led("board_degc")

    # -- causes

    def follow_column(self):
        rng, names = self.rng, ["supply_v", "humidity_pct", "vibration_g"]
        self.channel = names[self.number % 3]
        others = [n for n in (*names, "fan_rpm") if n != self.channel]
        others = [str(n) for n in rng.permutation(others)[:rng.integers(2, 4)]]
        for name in rng.permutation([self.channel, *others]):
            true = self.add_own_life(str(name))
            if name == self.channel:
                signal = [x - true[0].mean() for x in true]
        if rng.random() < 0.5:
            self.add_led("board_degc")
        self.gain = self.d / self.strength(signal) * rng.choice([-1, 1])
        self.signal = [self.gain * s for s in signal]
        self.truth = f"{self.channel} {self.gain:.4g}"

    def remember(self):
        rng, number = self.rng, self.number
        self.cause = "thermal_lag" if self.kind == "C" and number % 8 in (0, 1, 6, 7) else "thermal_hysteresis"
        if self.cause == "thermal_lag":
            self.lag()
        else:
            half = rng.uniform(2, 8) if self.kind == "C" else rng.uniform(1.5, 4)
            signal = [play(t, half, t[0] + rng.uniform(-half, half)) - t for t in self.degc]
            size = self.d / self.strength(signal) * rng.choice([-1, 1])
            self.signal = [size * s for s in signal]
            self.truth = f"play of half-width {half:.2f} degC, amplitude {size * half:.3g}"
        if self.kind == "G":
            self.idle()
            return
        for name in ("regulator_v", "battery_v", "heater_w"):
            if rng.random() < 0.7:
                self.add_led(name)
        if "board_degc" not in self.columns:
            self.add_led("board_degc")
        if self.cause == "thermal_lag":
            self.left_nats = self.strength(self.signal, self.columns["board_degc"]) ** 2 / 2
            self.truth += f", a board leaves {self.left_nats:.1f} nats"

    def lag(self):
        """The cubic grows until its lag is d strong."""
        rng = self.rng
        tau = rng.uniform(100, 300)
        own = [follow(t, tau, t[0] + rng.normal(0, 4)) for t in self.degc]
        behind = [(t - self.middle) / self.half for t in own]
        signal = [self.bias(b) - self.bias(u) for b, u in zip(behind, self.u)]
        size = self.d / self.strength(signal)
        self.signal, self.coeff = [size * s for s in signal], size * self.coeff
        self.truth = f"lag of {tau:.0f} s, slope {self.coeff[0] / self.half:.3g} per degC"
        if self.number % 8 in (1, 6):
            self.columns["board_degc"] = [t + 0.02 * rng.standard_normal(len(t)) for t in own]
            self.truth += ", board_degc is the gyro's own"
        else:
            other = tau
            while max(other / tau, tau / other) < 1.5:
                other = rng.uniform(60, 300)
            self.add_led("board_degc", other)
            self.truth += f", board_degc {other:.0f} s"

    def change_in_every_run(self):
        """sigma so that the marginal likelihood of these draws gains d^2 / 2 on the average of the noise."""
        rng, fitted = self.rng, self.n_fitted
        z = rng.standard_normal((len(self.lasts), 2))
        rows = [np.column_stack([u, u ** 2 - 1 / 3]) for u in self.u]
        design = [np.hstack([r if k == i else np.zeros_like(r) for k in range(fitted)]) for i, r in enumerate(rows[:fitted])]
        left = self.beside_nuisance(design)
        size, axes = np.linalg.eigh(left.T @ left)
        size, zeta = np.maximum(size, 0), axes.T @ z[:fitted].ravel()

        def gain(s):
            v = s * s * size
            return 0.5 * np.sum(v * (1 + v * zeta ** 2) / (1 + v) - np.log1p(v))
        low, high = 1e-3 * self.unit, 1e4 * self.unit
        while high / low > 1.0001:
            s = math.sqrt(low * high)
            low, high = (s, high) if gain(s) < self.d ** 2 / 2 else (low, s)
        self.sigma_run, self.design = s, design
        self.signal = [s * r @ zk for r, zk in zip(rows, z)]
        self.truth = f"run to run {s:.3g}"
        if self.number % 2:
            self.add_own_life("supply_v")
            self.add_led("board_degc")

    def change_in_one_run(self):
        which, (a, b) = self.rng.integers(self.n_fitted), self.rng.standard_normal(2)
        signal = [(a * u + b * (u ** 2 - 1 / 3)) * (i == which) for i, u in enumerate(self.u)]
        size = self.d / self.strength(signal)
        self.signal = [size * s for s in signal]
        self.truth = f"log {which} has slope {size * a:.3g} and curvature {size * b:.3g} more"
        self.add_own_life("supply_v")
        self.add_led("board_degc")

    # -- strength

    def beside_nuisance(self, columns, *more):
        """Columns of the fitted logs, whitened, less constants and cubic (and more columns)."""
        blocks = []
        for i, c in enumerate(columns[:self.n_fitted]):
            u = self.u[i]
            nuisance = [*(np.full(len(u), float(k == i)) for k in range(self.n_fitted)), u, u ** 2, u ** 3,
                        *(m[i] - m[0][0] for m in more)]
            blocks.append(whitened(np.column_stack([*nuisance, c]), *self.noise))
        a, b = np.split(np.vstack(blocks), [len(nuisance)], axis=1)
        a = a / np.linalg.norm(a, axis=0)
        return b - a @ np.linalg.lstsq(a, b, rcond=None)[0]

    def strength(self, signal, *more):
        return np.linalg.norm(self.beside_nuisance(signal, *more))

    # -- what is asked

    def write(self, folder):
        """Paths of the logs."""
        axis, digits = ("ax_mg", "%.5f") if self.is_accelerometer else ("gx_dph", "%.2f")
        return [write_log(folder / f"{self.kind}{self.number}_{i}.csv", np.arange(1, len(rate) + 1), self.shown[i], rate,
                          *(c[i] for c in self.columns.values()), axes=[axis, *self.columns],
                          form=f"%d,%.3f,{digits}" + ",%.6g" * len(self.columns))
                for i, rate in enumerate(self.rate)]

    def belief(self, folder):
        """Options, the model beside the logs."""
        factor = [1, 3, 1 / 3, None][self.number % 4]
        if factor is None:
            return []
        white, sigma, unit = factor * self.noise[0], factor * self.noise[1], "mg" if self.is_accelerometer else "dph"
        noise = {"white_mg_rt_hz": white} if unit == "mg" else {"arw_deg_rt_h": white / 60}
        return model_option(folder / f"{self.kind}{self.number}.json", {
            "imucal_model": 1, "unit": unit, **noise, "markov": [{f"sigma_{unit}": sigma, "tau_s": self.noise[2]}],
            "bias": {"t0_degc": self.middle, "range_degc": self.half, f"coeff_{unit}": [0, 0, 0, 0]}})


# ---- asking and judging


def told(device, folder, program):
    """The one axis, or in words why there is none; and the command."""
    paths, n = device.write(folder), device.n_fitted
    done, command = run(program, device.belief(folder), paths[:n], paths[n:])
    (folder / f"{device.kind}{device.number}_answer.json").write_text(done.stdout)
    return axis_of(done), command


def column_is_named(device, axis):
    """A."""
    columns = [e for e in axis["effects"] if e["name"] == "auxiliary_channel"]
    if len(columns) != 1 or columns[0]["parameters"]["channel"] != device.channel:
        return False
    off = abs(columns[0]["parameters"]["gain"] - device.gain)
    return off <= max(5 * (columns[0]["std_errors"].get("gain") or 0), 0.1 * abs(device.gain)) and all(
        e["name"] == "auxiliary_channel" or e["family"] in ("slow_noise", "fast_noise") for e in axis["effects"])


def memory_is_first(device, axis, first):
    """C."""
    names = [e["name"] for e in axis["effects"]]
    if first in (device.cause, "thermal_memory"):
        return "auxiliary_channel" not in names
    column = next((e for e in axis["effects"] if e["name"] == first == "auxiliary_channel"), None)
    if not column or column["parameters"]["channel"] != "board_degc" or device.cause != "thermal_lag":
        return False
    pairs = [*axis.get("indistinguishable", []), *(p["names"] for p in axis.get("open_pairs", []))]
    is_open = any(m["name"] in MEMORY for m in column["set"]) or any(
        any("auxiliary_channel" in n for n in p) and any(n in MEMORY for n in p) for p in pairs)
    return device.left_nats < FAIR_NATS and is_open and names.count("auxiliary_channel") == 1


def is_repeatable(effect):
    """Of E: what would come again in every log."""
    return (effect["family"] in ("thermal_memory", "function_of_temperature")
            or effect["name"] == "auxiliary_channel" and effect["parameters"]["channel"] == "board_degc")


def is_honest(gap):
    """Of D: that no other log is foretold."""
    shrinkage, interval = gap["shrinkage"], gap.get("ci95") or [1, 1]
    return shrinkage is None or shrinkage < 0.2 or (interval[0] is not None and interval[0] <= 0)


def judged(device, axis):
    kind, names = device.kind, [e["name"] for e in axis["effects"]]
    first = next((e for e in axis["effects"] if e["name"] != "noise_parameters"), {"name": None, "set": []})
    held = [first["name"], *(m["name"] for m in first["set"])]
    if kind == "A":
        return column_is_named(device, axis) and axis["verdict"] != "unexplained"
    if kind in "BF":
        return set(names) <= {"noise_parameters"} and axis["verdict"] != "unexplained"
    if kind == "C":
        return memory_is_first(device, axis, first["name"])
    if kind == "D":
        return "run_to_run" in held and is_honest(axis["gap"])
    if kind == "E":
        return axis["verdict"] not in ("explained", "partly_explained") or not any(map(is_repeatable, axis["effects"]))
    return "thermal_hysteresis" in held or first["name"] == "thermal_memory"


def is_right(folder, kind, number, program=DIAGNOSE):
    device = Device(kind, number)
    axis, command = told(device, folder, program)
    belief = ["exact", "x 3", "/ 3", "absent"][number % 4]
    note = f"{device.truth}, d {device.d if kind not in 'BF' else 0:.1f}, believed {belief}, columns {list(device.columns)}"
    if isinstance(axis, str):
        print(f"{kind}{number}: WRONG {note}: REFUSED {axis} {command}")
        return False
    right, gap = judged(device, axis), axis["gap"]
    print(f"{kind}{number}: {'right' if right else 'WRONG'} {note}: {axis['verdict']} | {axis['title']} |", *found(axis),
          f"| shrinkage {gap['shrinkage']} {gap.get('ci95')} rms {gap['residual_rms_dph']} {axis['seconds']:.1f} s |", command,
          flush=True)
    return right


def check(kind, devices, most, folder):
    at_most_wrong(most, devices, lambda k: is_right(folder, kind, k))


@pytest.mark.parametrize("kind", "ABCDEFG")
def test_extra_columns_and_changing_runs(kind, tmp_path):
    check(kind, range(2), 0, tmp_path)


def test_noise_of_two_processes_that_was_worse_than_one(tmp_path):
    check("F", [6], 0, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("kind", "ABCDEFG")
def test_many_of_the_same(kind, tmp_path):
    check(kind, range(2, 8), 1, tmp_path)


# ---- by hand: the simulator itself, and the whole campaign with its logs kept


def gain_of_truth(device):
    """Nats that these logs gain for who knows the cause and the noise."""
    rates, n = device.rate, device.n_fitted
    if device.kind == "D":
        left = device.beside_nuisance([np.column_stack([y, z]) for y, z in zip(rates, device.design)])
        y, z = left[:, 0], left[:, 1:]
        inner = np.eye(z.shape[1]) + device.sigma_run ** 2 * z.T @ z
        zy = z.T @ y
        return 0.5 * (device.sigma_run ** 2 * zy @ np.linalg.solve(inner, zy) - np.linalg.slogdet(inner)[1]), None
    left = device.beside_nuisance([np.column_stack([y, y - s]) for y, s in zip(rates[:n], device.signal)])
    e = left[:, 1]
    return 0.5 * (left[:, 0] @ left[:, 0] - e @ e), (e.var(), e[1:] @ e[:-1] / (e @ e) * math.sqrt(len(e)), len(e))


def check_simulator(numbers):
    """Gains of other devices than those that are asked, against d."""
    for kind in "ACDEGBF":
        for number in numbers:
            device = Device(kind, number)
            gain, rest = gain_of_truth(device)
            travel = max(np.ptp(q) for q in device.quiet) / device.unit
            away = (2 * gain - device.d ** 2) / (2 * device.d) if kind not in "BF" else gain
            print(f"{kind}{number}: d {device.d:.1f} gain's d {math.sqrt(max(2 * gain, 0)):.1f} ({away:+.2f} sigma) rest",
                  rest and [round(float(r), 4) for r in rest], f"travel {travel:.0f} "
                  f"signal rms {np.std(np.concatenate(device.signal)) / device.unit:.1f} "
                  f"white {device.noise[0] / device.unit:.0f} slow {device.noise[1] / device.unit:.0f} "
                  f"{device.noise[2]:.0f} s {device.truth}", flush=True)


def main():
    if sys.argv[1:] == ["simulator"]:
        return check_simulator(range(100, 108))
    folder, numbers = Path(sys.argv[1]), range(*map(int, sys.argv[2:]))
    folder.mkdir(parents=True, exist_ok=True)
    for kind in "ABCDEFG":
        right = [is_right(folder, kind, k) for k in numbers]
        print(f"== {kind}: {sum(right)} of {len(right)} right", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
