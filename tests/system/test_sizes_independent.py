# SPDX-License-Identifier: MIT
"""Are the sizes of what is named true within their standard errors?  Logs that this file simulates itself.

A device has a cubic bias over temperature, a constant of every run, white noise of 35 dph per second and one process of
15 dph and 120 s, which the program is told (`--model`).  Beside these it has one cause:

- a thermal loop, rate += A (P - T)/r.  P is what a body with a slack of +- r degC is dragged to by the temperature T; every
  run starts anywhere inside the slack.  `ramps`: every log goes one way, once.  `turning`: logs of 1 to 2.5 h that turn
  round several times.  `strong`: the same with A of 180 to 1300 dph.
- a warm-up, rate += B exp(-t/tau) from the start of every run.  `heating`: every run starts cold, with one B.  `late`: some
  runs start cold, in others the device was still warm, and what is left of B is 0.3 to 0.7 of it.

Thermometers read 0.01 degC beside the truth from second to second.  No code is shared with the programs.  Counts may be as
low (or high) as comes in 1 of 1000 draws at the rate that a test states.

    python tests/system/test_sizes_independent.py [-v] [--share SHARE] CASE N [DIAGNOSE [FIRST]]

counts N devices of a case from device FIRST on, and tells every one of them with -v; SHARE as in `Device`."""
import argparse
import math
import re
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from asking import DIAGNOSE, axes_of, least_by_chance, model_of, model_option, most_by_chance, run, write_log

WHITE, SLOW, TAU_S = 35.0, 15.0, 120.0  # dph of a second's mean, dph, s
THERMOMETER_DEGC = 0.01
TURN_ON = 30.0
LOOPS, WARM_UPS = ["ramps", "turning", "strong"], ["heating", "late"]
CASES = LOOPS + WARM_UPS
TRUE_NAME = {**dict.fromkeys(LOOPS, "thermal_hysteresis"), **dict.fromkeys(WARM_UPS, "warm_up")}
TWO_SIGMA = math.erf(2 / math.sqrt(2))
FAR, FAR_RATE = 3.5, 0.99  # standard errors are those of a quadratic: more than 1 of 2000 may be so far
RIGHT_RATE = 0.98
VISIBLE = 12.0  # strength from which on the cause must stand first
FALSE_RATE = 0.01  # what an answer states (`false_alarm_rate`)
DIFFER_RATE = 0.02  # of warm-ups whose starts are equal and said to differ
LEAST_RATE = 0.95  # of the least widths that are told
CHANCE = 0.001
N_LONG = 20


# ---- temperatures


def follows(x, tau_s):
    """A body that starts at the first value and follows with this time constant."""
    phi = math.exp(-1 / tau_s)
    return lfilter([1 - phi], [1, -phi], x, zi=[phi * x[0]])[0]


def through(corners, seconds, rng):
    """The temperature of a device in air that goes straight from corner (s, degC) to corner."""
    return follows(np.interp(np.arange(seconds), *zip(*corners)), rng.uniform(20, 80))


def one_way(rng, cold, hot):
    """A soak, one ramp up or down, a soak."""
    soaks, speed = rng.uniform(120, 1200, 2), rng.uniform(0.6, 2.5) / 60
    start, end = (cold, hot) if rng.random() < 0.5 else (hot, cold)
    ramp_s = (hot - cold) / speed
    corners = [(0, start), (soaks[0], start), (soaks[0] + ramp_s, end)]
    return through(corners, int(soaks.sum() + ramp_s), rng)


def there_and_back(rng, cold, hot):
    """1 to 2.5 h from turn to turn; half of the way or more each, some soaks."""
    seconds, degc = int(rng.uniform(3600, 9000)), rng.uniform(cold, hot)
    t, up, corners = rng.uniform(0, 400), rng.random() < 0.5, [(0, degc)]
    corners.append((t, degc))
    while t < seconds:
        end = hot - rng.uniform(0, 0.45) * (hot - cold) if up else cold + rng.uniform(0, 0.45) * (hot - cold)
        t += abs(end - degc) / (rng.uniform(1, 4) / 60) + 1
        corners.append((t, end))
        if rng.random() < 0.4:
            t += rng.uniform(60, 700)
            corners.append((t, end))
        degc, up = end, not up
    return through(corners, seconds, rng)


# ---- what devices do


def dragged(degc, slack, start):
    """Where a body with this slack on either side is dragged to by the temperature; it starts `start` degC from it."""
    at, out = degc[0] + start, []
    for x in degc.tolist():
        at = max(x - slack, min(x + slack, at))
        out.append(at)
    return np.array(out)


def wander(rng, n):
    """The process that every device has."""
    phi = math.exp(-1 / TAU_S)
    news = math.sqrt(1 - phi * phi) * rng.standard_normal(n)
    news[0] = rng.standard_normal()
    return SLOW * lfilter([1], [1, -phi], news)


def log_uniform(rng, low, high):
    return math.exp(rng.uniform(math.log(low), math.log(high)))


class Device:
    """Two to four logs, often one held out, and the truth of its cause.  Case and seed say everything; with a share the runs
    of a loop start at this share of the slack, on one side and the other in turn, and all else is as without."""
    def __init__(self, case, seed, share=None):
        rng = np.random.default_rng([20291, CASES.index(case), seed])
        self.case, self.seed = case, seed
        cold = rng.uniform(-25, 5)
        hot = cold + rng.uniform(40, 75)
        self.n_fitted = int(rng.integers(2, 5))
        n = self.n_fitted + int(rng.random() < 0.6)
        walk = one_way if case == "ramps" else there_and_back
        self.degc = [walk(rng, cold, hot) for _ in range(n)]
        sign = rng.choice([-1, 1])
        if case in LOOPS:
            amplitude = sign * log_uniform(rng, *{"ramps": (60, 250), "turning": (40, 150), "strong": (180, 1300)}[case])
            width = log_uniform(rng, 1.5, 15)
            self.truth = {"amplitude_dph": amplitude, "width_degc": width}
            self.starts = width * rng.uniform(-1, 1, n)
            if share is not None:
                self.starts = width * share * (-1.0) ** (np.arange(n) + seed)
            self.added = [amplitude / width * (dragged(t, width, s) - t) for t, s in zip(self.degc, self.starts)]
        else:
            amplitude, tau_s = sign * log_uniform(rng, 100, 500), log_uniform(rng, 100, 1200)
            self.truth = {"amplitude_dph": amplitude, "tau_s": tau_s}
            self.starts = np.ones(n)
            if case == "late":
                warm = 1 + rng.permutation(self.n_fitted - 1)[:rng.integers(1, self.n_fitted)]
                warm = (warm + rng.integers(self.n_fitted)) % self.n_fitted  # at least one fitted log starts cold
                self.starts[warm] = rng.uniform(0.3, 0.7, len(warm))
                self.starts[self.n_fitted:] = rng.uniform(0.3, 1, n - self.n_fitted)
            self.added = [amplitude * s * np.exp(-np.arange(len(t)) / tau_s) for t, s in zip(self.degc, self.starts)]
        slopes = rng.normal(0, [300, 120, 60])
        self.rates, self.read = [], []
        for t, more in zip(self.degc, self.added):
            x = (t - 25) / 40
            bias = slopes[0] * x + slopes[1] * x ** 2 + slopes[2] * x ** 3 + TURN_ON * rng.standard_normal()
            self.rates.append(bias + more + wander(rng, len(t)) + WHITE * rng.standard_normal(len(t)))
            self.read.append(t + THERMOMETER_DEGC * rng.standard_normal(len(t)))

    def ask(self, folder, program=DIAGNOSE):
        """The axis that the program tells of this device."""
        logs = [write_log(folder / f"{i}.csv", np.arange(1, len(r) + 1), t, r, form="%d,%.3f,%.3f")
                for i, (t, r) in enumerate(zip(self.read, self.rates))]
        options = model_option(folder / "model.json", model_of(WHITE, (SLOW, TAU_S), t0_degc=25))
        axis, = axes_of(run(program, options, logs[:self.n_fitted], logs[self.n_fitted:])[0])
        return axis


def first_contact_s(device, log):
    """When the body in the slack is dragged along for the first time; None for never."""
    gap = np.abs(device.added[log]) - 0.9999 * abs(device.truth["amplitude_dph"])
    return int(np.argmax(gap > 0)) if (gap > 0).any() else None


# ---- strength: root of twice the gain of log-likelihood, the noise known, constants of the runs and a cubic free


BLOCK_S = 20


def blocks(x):
    n = len(x) // BLOCK_S
    return x[:n * BLOCK_S].reshape(n, BLOCK_S).mean(axis=1)


def whitened(columns):
    """Rows of one run; the process hardly changes within a block."""
    steps = BLOCK_S * np.abs(np.subtract.outer(np.arange(len(columns)), np.arange(len(columns))))
    cov = SLOW ** 2 * np.exp(-steps / TAU_S) + WHITE ** 2 / BLOCK_S * np.eye(len(columns))
    return np.linalg.solve(np.linalg.cholesky(cov), columns)


def strength(device):
    runs = range(device.n_fitted)
    rows = []
    for i in runs:
        x, own = (blocks(device.degc[i]) - 25) / 40, [float(i == j) for j in runs]
        rows.append(whitened(np.column_stack([np.tile(own, (len(x), 1)), x, x ** 2, x ** 3, blocks(device.added[i])])))
    rows = np.vstack(rows)
    basis, _ = np.linalg.qr(rows[:, :-1])
    return float(np.linalg.norm(rows[:, -1] - basis @ (basis.T @ rows[:, -1])))


# ---- what is told, beside the truth


SLOPE = re.compile(r"amplitude/width = (\S+) \+- (\S+) dph/degC: the width, at least (\S+) degC")
WARMER = "others began warmer"
WARM_START = re.compile(r"log (\d+) at (\S+) \+- (\S+?)[, ]")


def size_of(effect):
    """Of a false name, in dph: of its largest step, or what it adds; of other noise what its slow process has."""
    steps = effect["parameters"].get("steps")
    if steps:
        return max(abs(step["amplitude_dph"]) for step in steps)
    return effect["rms_dph"] or abs(effect["parameters"].get("sigma_dph") or 0)


@dataclass
class Told:
    """Of one device: names, and (told - truth)/error of every size that has an error."""
    seed: int
    strength: float
    first: str = ""
    is_right: bool = False
    verdict: str = ""
    false: list = field(default_factory=list)  # (name, dph)
    z: dict = field(default_factory=dict)
    off: dict = field(default_factory=dict)  # told - truth
    is_least_width_right: bool | None = None
    starts_differ: bool = False


def judge(device, axis):
    name = TRUE_NAME[device.case]
    told = Told(device.seed, strength(device), verdict=axis["verdict"])
    effects = [e for e in axis["effects"] if not e["is_note"]]
    true = [e for e in effects if name in (e["name"], e.get("member"))]  # a family has a member, of which its parameters are
    told.false = [(e["name"], size_of(e)) for e in effects if e not in true and name not in [m["name"] for m in e["set"]]]
    told.false += [("held-out jump", abs(j["size_dph"])) for j in axis["gap"].get("jumps_of_held_out_logs", [])]
    told.first = effects[0]["name"] if effects else ""
    told.is_right = bool(true) and true[0] is effects[0]
    if true:
        judge_sizes(device, true[0], told)
    return told


def judge_sizes(device, effect, told):
    text = " ".join(effect["remarks"])
    told.starts_differ = WARMER in text
    slope = SLOPE.search(text)
    if slope:
        ratio, error, least = map(float, slope.groups())
        told.off["slope"] = ratio - device.truth["amplitude_dph"] / device.truth["width_degc"]
        told.z["slope"] = told.off["slope"] / error
        told.is_least_width_right = least <= 1.02 * device.truth["width_degc"]
    for key, value in device.truth.items():
        error = effect["std_errors"].get(key)
        if error is None:
            continue
        told.off[key] = effect["parameters"][key] - value
        if key == "amplitude_dph" and device.case == "late" and not told.starts_differ:  # one start for all: one of the true ones
            sizes = value * device.starts[:device.n_fitted]
            told.off[key] = effect["parameters"][key] - np.clip(effect["parameters"][key], sizes.min(), sizes.max())
        told.z[key] = told.off[key] / error
    for log, size, error in WARM_START.findall(text + " ") if told.starts_differ else []:
        told.z[f"start of log {log}"] = (float(size) - device.truth["amplitude_dph"] * device.starts[int(log) - 1]) / float(error)


def ask_all(case, seeds, folder, program=DIAGNOSE, tell=None, share=None):
    out = []
    for seed in seeds:
        device = Device(case, seed, share)
        axis = device.ask(folder, program)
        out.append(judge(device, axis))
        if tell:
            tell(device, axis, out[-1])
    return out


def gathered(tolds):
    """z of every size, by its name."""
    out = {}
    for told in tolds:
        for key, z in told.z.items():
            out.setdefault("start" if key.startswith("start") else key, []).append(z)
    return out


def out_of_bounds(tolds):
    """Sizes whose standard errors do not hold, each with its counts."""
    wrong = []
    for key, z in gathered(tolds).items():
        for limit, rate in ((2, TWO_SIGMA), (FAR, FAR_RATE)):
            within = int((np.abs(z) < limit).sum())
            if within < least_by_chance(len(z), rate, CHANCE):
                wrong.append((key, f"{within} of {len(z)} within {limit} errors", np.round(z, 1).tolist()))
    return wrong


def wrong_names(tolds, rate=RIGHT_RATE):
    """Visible causes that do not stand first, if there are more than chance allows."""
    seen = [told for told in tolds if told.strength >= VISIBLE]
    missed = [(told.seed, told.first) for told in seen if not told.is_right]
    return missed if len(missed) > most_by_chance(len(seen), 1 - rate, CHANCE) else []


def false_names(tolds):
    false = [(told.seed, told.false) for told in tolds if told.false]
    return false if len(false) > most_by_chance(len(tolds), FALSE_RATE, CHANCE) else []


def everything_wrong(tolds):
    wrong = {"names": wrong_names(tolds), "false names": false_names(tolds), "sizes": out_of_bounds(tolds)}
    return {what: devices for what, devices in wrong.items() if devices}


def short_and_all(*few):
    """The short form takes devices with two fitted logs, which are soon asked."""
    return pytest.mark.parametrize("seeds", [few, pytest.param(range(N_LONG), marks=pytest.mark.long)], ids=["short", "all"])


@short_and_all(0, 3)
def test_a_loop_in_logs_that_go_one_way(tmp_path, seeds):
    """Where the far side of the loop is not seen, amplitude over width is told instead, and how wide it is at least."""
    tolds = ask_all("ramps", seeds, tmp_path)
    least = [told.is_least_width_right for told in tolds if told.is_least_width_right is not None]
    assert everything_wrong(tolds) == {}
    assert sum(least) >= least_by_chance(len(least), LEAST_RATE, CHANCE), least


@short_and_all(2, 8)
def test_a_loop_in_logs_that_turn(tmp_path, seeds):
    tolds = ask_all("turning", seeds, tmp_path)
    assert everything_wrong(tolds) == {}


@short_and_all(0, 2)
def test_a_strong_loop(tmp_path, seeds):
    """Nothing stands beside it, neither steps where the body is dragged along for the first time nor slow noise."""
    tolds = ask_all("strong", seeds, tmp_path)
    assert everything_wrong(tolds) == {}


@pytest.mark.long
@pytest.mark.parametrize("share", [0, 0.25, 0.5, 0.75, 0.9, 1])
def test_a_strong_loop_whose_runs_start_anywhere_in_it(tmp_path, share):
    """Where in its slack the body stands at the start of a run is a number like any other: no place is better than another."""
    assert everything_wrong(ask_all("strong", range(16), tmp_path, share=share)) == {}


@short_and_all(4)
def test_a_warm_up_from_cold(tmp_path, seeds):
    """One size for all logs: that they differ is not said."""
    tolds = ask_all("heating", seeds, tmp_path)
    differ = [told.seed for told in tolds if told.starts_differ]
    assert everything_wrong(tolds) == {}
    assert len(differ) <= most_by_chance(len(tolds), DIFFER_RATE, CHANCE), differ


@short_and_all(4)
def test_a_warm_up_of_a_device_that_was_still_warm(tmp_path, seeds):
    """The amplitude is that of a cold start, and what the other logs are said to have is what they have."""
    tolds = ask_all("late", seeds, tmp_path)
    assert everything_wrong(tolds) == {}


# ---- more devices, by hand


def tell_device(device, axis, told):
    truth = ", ".join(f"{key} {value:.4g}" for key, value in device.truth.items())
    print(f"{device.case} {device.seed}: {truth}; strength {told.strength:.0f}, {device.n_fitted} of {len(device.degc)} logs "
          f"fitted, starts {np.round(device.starts, 2).tolist()}, {axis['verdict']}")
    for e in axis["effects"]:
        print("   ", e["name"], e["parameters"], "errors", e["std_errors"], f"{e['evidence_nats']:.1f} nats", *e["remarks"])
    if device.case in LOOPS:
        print("    first dragged along at", [first_contact_s(device, i) for i in range(len(device.degc))], "s")
    print("    false:", told.false, " z:", {key: round(float(z), 2) for key, z in told.z.items()}, flush=True)


def tell_sizes(tolds):
    for key, z in gathered(tolds).items():
        z, off = np.array(z), [told.off[key] for told in tolds if key in told.off]
        print(f"    {key}: {len(z)} told, |z| < 2 in {(abs(z) < 2).sum()}, < {FAR} in {(abs(z) < FAR).sum()}; "
              f"mean z {z.mean():.2f}, rms {np.sqrt((z ** 2).mean()):.2f}, largest {z[np.argmax(abs(z))]:.1f}"
              + (f"; told - truth: mean {np.mean(off):.3g}, median {np.median(off):.3g}" if off else ""))


def tell_case(case, tolds):
    seen = [told for told in tolds if told.strength >= VISIBLE]
    wrong = [(t.seed, t.first, round(t.strength)) for t in tolds if not t.is_right]
    print(f"{case}: first is right in {sum(t.is_right for t in seen)} of {len(seen)} visible ones, "
          f"{sum(t.is_right for t in tolds)} of all {len(tolds)}; wrong: {wrong}")
    verdicts = dict(Counter(t.verdict for t in tolds))
    print(f"    verdicts: {verdicts}; starts said to differ: {sum(t.starts_differ for t in tolds)}")
    false = [t for t in tolds if t.false]
    print(f"    false names in {len(false)}:", [(t.seed, [(name, round(size)) for name, size in t.false]) for t in false])
    tell_sizes(tolds)
    least = [t.is_least_width_right for t in tolds if t.is_least_width_right is not None]
    print(f"    least widths right: {sum(least)} of {len(least)}")
    print("    fails:", everything_wrong(tolds) or "nothing")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("-v", dest="tell", action="store_const", const=tell_device)
    parser.add_argument("--share", type=float)
    parser.add_argument("case", choices=CASES)
    parser.add_argument("n", type=int)
    parser.add_argument("program", type=Path, nargs="?", default=DIAGNOSE)
    parser.add_argument("first", type=int, nargs="?", default=0)
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tell_case(a.case, ask_all(a.case, range(a.first, a.first + a.n), Path(folder), a.program, a.tell, a.share))


if __name__ == "__main__":
    main()
