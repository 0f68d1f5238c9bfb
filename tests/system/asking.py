# SPDX-License-Identifier: MIT
"""How simulated devices of the independent tests ask `diagnose`: their logs, what is believed of their noise, the call.

Nothing here knows what a device does: every test simulates its own."""
import json
import math
import os
import subprocess

import numpy as np

from where import BIN



def write_log(path, t_s, degc, rate_dph):
    np.savetxt(path, np.column_stack([t_s, degc, rate_dph]), fmt=["%d", "%.3f", "%.2f"], delimiter=",",
               header="# imucal-log = 1\nt_s,temp_degc,gx_dph", comments="")


def belief(path, rng, number, white, sigma, tau_s):
    """Options for one device: the true noise with even numbers, then in turn a data sheet (each figure wrong by up to 1.5)
    and nothing.  `white` and `sigma` in dph, of one second; the model is written beside `path`."""
    if number % 2 == 0:
        model = path.with_suffix(".json")
        model.write_text(json.dumps({
            "imucal_model": 1, "arw_deg_rt_h": white / 60, "markov": [{"sigma_dph": sigma, "tau_s": tau_s}],
            "bias": {"t0_degc": 27.5, "range_degc": 27.5, "coeff_dph": [0, 0, 0, 0]}}))
        return ["--model", model]
    wrong = np.exp(rng.uniform(-math.log(1.5), math.log(1.5), 3))
    if number % 4 == 3:
        return []
    arw, sigma, tau_s = np.array([white / 60, sigma, tau_s]) * wrong
    return ["--arw", f"{arw:.3f}", "--instability", f"{sigma:.2f}:{tau_s:.1f}"]


def run(program, options, fitted, held_out, timeout_s=120):
    """What the program did with these logs, its answer on standard output; and the command."""
    command = [str(c) for c in (program, "--threads", "1", "--no-cache", "--quiet", "--json", "-", *options, "--log", *fitted,
                                *(["--holdout", *held_out] if held_out else []))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout_s, env={**os.environ, "OMP_NUM_THREADS": "1"})
    return done, " ".join(command)


def axis_of(done):
    """The one axis, or in words why there is none: the logs, or the axis, are refused."""
    if done.returncode == 3:
        return done.stderr
    assert done.returncode in (0, 1), done.stderr
    axis, = json.loads(done.stdout)["axes"]
    return axis.get("refused") or axis


def axis_told(program, options, fitted, held_out):
    """What the program says of the one axis of these logs."""
    done, _ = run(program, options, fitted, held_out)
    assert done.returncode == 0, done.stderr
    axis, = json.loads(done.stdout)["axes"]
    return axis


def at_most_wrong(most, devices, is_right):
    """Asks all devices; at most so many may be wrong."""
    wrong = [k for k in devices if not is_right(k)]
    assert len(wrong) <= most, (wrong, "of", len(devices))


def found(axis):
    """For people who read the output of a test."""
    return [(e["name"], e["parameters"], [m["name"] for m in e["set"]]) for e in axis["effects"]]
