# SPDX-License-Identifier: MIT
"""How simulated devices of the independent tests ask `diagnose`: their logs, what is believed of their noise, the call, and how
many wrong answers are chance.

Nothing here knows what a device does: every test simulates its own."""
import json
import math
import os
import subprocess

import numpy as np
from scipy.stats import binom

from where import BIN

DIAGNOSE = BIN / "diagnose"


def write_log(path, t_s, degc, *rates, axes=("gx_dph",), form="%d,%.3f,%.2f"):
    """A log of axes and other columns; `form` is that of a row, and what is not a number stays empty."""
    columns = [np.asarray(x, float).tolist() for x in (t_s, degc, *rates)]
    rows = "".join(form % row + "\n" for row in zip(*columns, strict=True)).replace("nan", "")
    path.write_text("# imucal-log = 1\n" + ",".join(["t_s", "temp_degc", *axes]) + "\n" + rows)
    return path


def model_of(white, *processes, t0_degc=20, range_degc=40):
    """A model without bias: white noise in dph of one second, and (dph, s) of every first-order process."""
    return {"imucal_model": 1, "arw_deg_rt_h": white / 60, "markov": [{"sigma_dph": s, "tau_s": t} for s, t in processes],
            "bias": {"t0_degc": t0_degc, "range_degc": range_degc, "coeff_dph": [0, 0, 0, 0]}}


def model_option(path, model):
    """Options that make a model believed, which is written; none for none."""
    if model is None:
        return []
    path.write_text(json.dumps(model))
    return ["--model", path]


def belief(path, rng, number, white, sigma, tau_s):
    """Options for one device: the true noise with even numbers, then in turn a data sheet (each figure wrong by up to 1.5)
    and nothing.  `white` and `sigma` in dph, of one second; the model is written beside `path`."""
    if number % 2 == 0:
        return model_option(path.with_suffix(".json"), model_of(white, (sigma, tau_s), t0_degc=27.5, range_degc=27.5))
    wrong = np.exp(rng.uniform(-math.log(1.5), math.log(1.5), 3))
    if number % 4 == 3:
        return []
    arw, sigma, tau_s = np.array([white / 60, sigma, tau_s]) * wrong
    return ["--arw", f"{arw:.3f}", "--instability", f"{sigma:.2f}:{tau_s:.1f}"]


def sheet_option(factor, white, sigma, tau_s):
    """Options of a data sheet whose white noise and process are wrong by a factor; none for None."""
    if factor is None:
        return []
    return ["--arw", f"{factor * white / 60:.4f}", "--instability", f"{factor * sigma:.3f}:{tau_s:.1f}"]


def run(program, options, fitted, held_out=(), timeout_s=120, cache=None):
    """What the program did with these logs, its answer on standard output; and the command."""
    kept = ["--cache", cache] if cache else ["--no-cache"]
    command = [str(c) for c in (program, "--threads", "1", *kept, "--quiet", "--json", "-", *options, "--log", *fitted,
                                *(["--holdout", *held_out] if held_out else []))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, env={**os.environ, "OMP_NUM_THREADS": "1"})
    return done, " ".join(command)


def axes_of(done):
    """The axes of an answer, complete or not."""
    assert done.returncode in (0, 1), done.stderr
    return json.loads(done.stdout)["axes"]


def axis_of(done):
    """The one axis, or in words why there is none: the logs, or the axis, are refused."""
    if done.returncode == 3:
        return done.stderr
    axis, = axes_of(done)
    return axis.get("refused") or axis


def axis_told(program, options, fitted, held_out=(), **how):
    """What the program says of the one axis of these logs."""
    done, _ = run(program, options, fitted, held_out, **how)
    assert done.returncode == 0, done.stderr
    axis, = json.loads(done.stdout)["axes"]
    return axis


def at_most_wrong(most, devices, is_right):
    """Asks all devices; at most so many may be wrong."""
    wrong = [k for k in devices if not is_right(k)]
    assert len(wrong) <= most, (wrong, "of", len(devices))


def most_by_chance(n, rate, chance=0.01):
    """More than these of n come in less than 1 of 100 draws (or at this chance) where each has this probability."""
    return int(binom.ppf(1 - chance, n, rate))


def least_by_chance(n, rate, chance=0.01):
    """Fewer than these of n, likewise."""
    return int(binom.ppf(chance, n, rate))


def names(axis):
    """What is named."""
    return [e["name"] for e in axis["effects"]]


def with_members(axis):
    """What is named, and what it may be as well."""
    return {name for e in axis["effects"] for name in [e["name"], *(member["name"] for member in e["set"])]}


def found(axis):
    """For people who read the output of a test."""
    return [(e["name"], e["parameters"], [m["name"] for m in e["set"]]) for e in axis["effects"]]
