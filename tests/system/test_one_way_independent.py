# SPDX-License-Identifier: MIT
"""Logs that go (nearly) one way, in which every run begins with something of its own; simulated by this file itself.

A freezer's door is closed, or a unit warms up: temperature approaches an end, slower and slower, and turns back once or never.
`loop`: a play or a Bouc-Wen loop, begun anywhere inside; such logs show little of it but where it began.  `fade`: an offset
of another size and sign in every run that fades over 15 to 25 degC on the way, and no loop.  `fade_anomaly`: the same beside
a true anomaly over temperature.  What begins anew in every run is no loop that was seen: a family is right, or nothing.

    python tests/system/test_one_way_independent.py [DIAGNOSE]

counts what is named for 36 devices of the first two and 85 of the last."""
import math
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import test_loops_independent as loops
from asking import DIAGNOSE, names
from draws import long_after

CASES = ["loop", "fade", "fade_anomaly"]
PROFILES = ["rises", "falls", "returns"]


def approach(rng, seconds, cold, hot, profile):
    """Temperature of a run that approaches one end; `returns`: with 3 to 10 degC back on the way."""
    t, soak, tau = np.arange(seconds, dtype=float), rng.uniform(60, 600), rng.uniform(0.2, 0.4) * seconds
    low, high = cold + rng.uniform(0, 4), hot - rng.uniform(0, 4)
    gone = (1 - np.exp(-np.clip(t - soak, 0, None) / tau)) / (1 - math.exp(-(seconds - soak) / tau))
    degc = high - (high - low) * gone if profile == "falls" else low + (high - low) * gone
    if profile == "returns":
        back, at, way = rng.uniform(3, 10), int(rng.uniform(0.35, 0.8) * seconds), int(rng.uniform(300, 800))
        head = degc[:at]
        down = head[-1] - back * np.linspace(0, 1, way)
        n = seconds - at - way
        again = down[-1] + (high - down[-1]) * (1 - np.exp(-np.arange(n) / tau)) / (1 - math.exp(-n / tau)) if n > 0 else []
        degc = np.concatenate([head, down, again])[:seconds]
    return loops.follows(degc, rng.uniform(20, 80), degc[0])


def fading(rng):
    """What every run begins with: as exp(-3 s) or 1 - s of the way s that temperature went."""
    way, is_exp = rng.uniform(15, 25), rng.random() < 0.5

    def rate(degc, of_run):
        s = np.abs(np.diff(degc, prepend=degc[0])).cumsum() / way
        return of_run.normal() * (np.exp(-3 * s) if is_exp else np.clip(1 - s, 0, None))
    return rate


class Device(loops.Device):
    """Three to six fitted runs and one or two held out; odd seeds are asked without a model."""

    def __init__(self, case, seed, d=25.0):
        rng = np.random.default_rng([seed, CASES.index(case), 4242])
        cold = rng.uniform(-25, 0)
        hot = cold + rng.uniform(50, 80)
        self.n_fitted = int(rng.integers(3, 7))
        n_held, seconds = int(rng.integers(1, 3)), int(rng.integers(5000, 8001))
        self.runs = [approach(rng, seconds, cold, hot, PROFILES[seed % 3]) for _ in range(self.n_fitted + n_held)]

        def scaled(effect):
            size = loops.strength(self.runs[:self.n_fitted], effect[:self.n_fitted])
            return [d / size * e if size > 0 else 0 * e for e in effect]

        if case == "loop":
            half = rng.uniform(4, 12)
            cause = (lambda degc, r: loops.play(degc, half, r.uniform(-1, 1)) - degc) if seed // 2 % 2 else loops.bouc_wen_of(rng, half)
        else:
            cause = fading(rng)
        sign = rng.choice([-1, 1])
        self.effect = [sign * e for e in scaled([cause(run, rng) for run in self.runs])]
        if case == "fade_anomaly":
            centre = rng.uniform(cold + 15, hot - 12)
            bump = scaled([np.exp(-0.5 * ((run - centre) / 3) ** 2) for run in self.runs])
            self.effect = [e + b for e, b in zip(self.effect, bump)]
        self.is_believed = seed % 2 == 0
        self.coeff = rng.normal(0, [300, 150, 80, 60])
        self.measure(rng, seconds)


def answer(case, seed, folder, program=DIAGNOSE):
    return loops.diagnosed(Device(case, seed), folder, program)


@pytest.mark.parametrize("seed", long_after(3, [0, 9, 10, 1]))
def test_what_fades_in_every_run_beside_an_anomaly_is_no_hysteresis(tmp_path, seed):
    axis = answer("fade_anomaly", seed, tmp_path)
    assert "thermal_anomaly" in names(axis), "the true anomaly is lost"
    assert "thermal_hysteresis" not in names(axis), "a loop is named that nobody saw"
    assert axis["verdict"] != "explained"
    family = [e for e in axis["effects"] if e["name"] == "thermal_memory"]
    assert all("begins anew in every run" in e["statement"] for e in family)


@pytest.mark.parametrize("seed", long_after(2, [2, 7, 3]))
def test_a_loop_that_such_logs_show_is_named(tmp_path, seed):
    assert names(answer("loop", seed, tmp_path)) == ["thermal_hysteresis"]


def main():
    program = sys.argv[1] if len(sys.argv) > 1 else DIAGNOSE
    for case, n in zip(CASES, (36, 36, 85)):
        count = Counter()
        for seed in range(n):
            with tempfile.TemporaryDirectory() as folder:
                said = names(answer(case, seed, Path(folder), program))
            count["hysteresis named" if "thermal_hysteresis" in said else
                  "family told" if "thermal_memory" in said else "no memory"] += 1
        print(case, dict(count), flush=True)


if __name__ == "__main__":
    main()
