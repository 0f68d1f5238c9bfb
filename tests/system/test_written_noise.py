# SPDX-License-Identifier: MIT
"""`diagnose --model-out` where the believed noise is estimated again: what gyrosim makes of the written model scatters as the
noise that was found, and as the sensor whose logs it was.

The models believed have two Markov processes, or 1/f noise; they are three times too large, or three times too small.
Measured: the Allan deviation from 1 to 512 s of a simulated day of steady temperature, with what it would be from the closed
form of `axes[].noise` (white noise, processes sampled every second, as the filter has them)."""
import json
import math
import subprocess

import numpy as np
import pytest

from where import BIN

ARW = 0.05  # white noise of 3 dph
TWO = [{"sigma_dph": 2.0, "tau_s": 60}, {"sigma_dph": 1.5, "tau_s": 900}]
STEADY = {"imucal_profile": 1, "start_degc": 30, "segments": [{"rate_degc_per_min": 0, "duration_s": 100000}]}
MOVING = {"imucal_profile": 1, "start_degc": 0, "segments": [
    {"rate_degc_per_min": 1, "to_degc": 50}, {"rate_degc_per_min": 0, "duration_s": 600}, {"rate_degc_per_min": 1, "to_degc": 0}]}
TAUS_S = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512]
SCATTER = 0.2  # of a deviation from a day, at 512 s: 100 differences of two means


def model(markov, effects=(), arw=ARW):
    return {"imucal_model": 1, "arw_deg_rt_h": arw, "markov": markov, "turn_on_sigma_dph": 20,
            "bias": {"t0_degc": 25, "range_degc": 25, "coeff_dph": [10, 20, 5, 1]}, "effects": list(effects)}


def two_processes(times, effects=()):
    return model([{**m, "sigma_dph": times * m["sigma_dph"]} for m in TWO], effects, times * ARW)


def one_over_f(times, effects=()):
    return model([], [{"name": "flicker_noise", "parameters": {"b_dph": 2.0 * times}}, *effects], times * ARW)


def write(path, content):
    path.write_text(json.dumps(content))
    return path


def simulated(folder, path, profile, seed, index=0, axes=1):
    out = folder / f"{path.stem}_{seed}_{index}.csv"
    profile = write(folder / "profile.json", profile)
    subprocess.run([BIN / "gyrosim", "log", "--model", path, "--profile", profile, "--axes", str(axes), "--seed", str(seed),
                    "--log-index", str(index), "--n-logs", "4", "-q", "-o", out], check=True)
    return out


def diagnosed(folder, believed, logs, *extra):
    out, written = folder / "answer.json", folder / f"found_beside_{believed.stem}.json"
    done = subprocess.run([BIN / "diagnose", "--model", believed, "--log", *logs, "--threads", "1", "--cache", folder / "cache",
                           "--json", out, "--model-out", written, *extra], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(out.read_text())["axes"], written, done.stdout


def deviation(rates, tau_s):
    """Of overlapping means."""
    sums = np.concatenate(([0], np.cumsum(rates)))
    means = (sums[tau_s:] - sums[:-tau_s]) / tau_s
    return math.sqrt(0.5 * np.mean((means[tau_s:] - means[:-tau_s]) ** 2))


def expected(noise, tau_s):
    """Half the variance of the difference of two means of tau_s samples next to each other."""
    k, apart = np.arange(1, tau_s), np.arange(1, 2 * tau_s)
    variance = (60 * noise["arw_deg_rt_h"]) ** 2 / tau_s
    for m in noise["markov"]:
        phi = math.exp(-1 / m["tau_s"])
        of_mean = (tau_s + 2 * np.sum((tau_s - k) * phi ** k)) / tau_s ** 2
        between = np.sum(np.minimum(apart, 2 * tau_s - apart) * phi ** apart) / tau_s ** 2
        variance += m["sigma_dph"] ** 2 * (of_mean - between)
    return math.sqrt(variance)


def column(path, name):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    at = lines[0].split(",").index(name)
    return np.array([float(line.split(",")[at]) for line in lines[1:]])


def assert_scatters_as(path, axis, folder, truth):
    again, sensor = simulated(folder, path, STEADY, 77), simulated(folder, truth, STEADY, 78)
    for tau_s in TAUS_S:
        got = deviation(column(again, axis["axis"]), tau_s)
        assert got == pytest.approx(expected(axis["noise"], tau_s), rel=SCATTER), (tau_s, axis["noise"], path.read_text())
        if tau_s <= 256:  # what the logs themselves know of it is within a third
            assert got == pytest.approx(deviation(column(sensor, axis["axis"]), tau_s), rel=0.35), (tau_s, axis["noise"])


@pytest.mark.parametrize("times", [3, 1 / 3])
@pytest.mark.parametrize("kind", [two_processes, one_over_f])
def test_the_noise_that_was_found_is_written_whole(tmp_path, kind, times):
    truth, believed = write(tmp_path / "truth.json", kind(1)), write(tmp_path / "believed.json", kind(times))
    logs = [simulated(tmp_path, truth, MOVING, 5, i) for i in range(4)]
    (axis,), written, text = diagnosed(tmp_path, believed, logs)
    assert "noise_parameters" in [e["name"] for e in axis["effects"]], text
    assert_scatters_as(written, axis, tmp_path, truth)
    # Believed in its turn, it fits the logs.
    (again,), _, text = diagnosed(tmp_path, written, logs)
    assert again["verdict"] == "no_gap", text


@pytest.mark.parametrize("kind", [two_processes, one_over_f])
def test_of_several_axes_each_has_its_own_noise_in_the_model(tmp_path, kind):
    """The second axis is as believed: what the others have is not its own."""
    loud = {"name": "noise_parameters", "parameters": {"arw_deg_rt_h": 3 * ARW, "sigma_dph": 6.0, "tau_s": 20}, "axis": "gx"}
    truth, believed = write(tmp_path / "truth.json", kind(1, [loud])), write(tmp_path / "believed.json", kind(1))
    logs = [simulated(tmp_path, truth, MOVING, 6, i, axes=3) for i in range(4)]
    (x, y), written, text = diagnosed(tmp_path, believed, logs, "--axis", "gx_dph", "--axis", "gy_dph")
    assert x["effects"] and y["verdict"] == "no_gap", text
    again, sensor = (simulated(tmp_path, path, STEADY, seed, axes=3) for path, seed in ((written, 77), (truth, 78)))
    for tau_s in TAUS_S:
        assert deviation(column(again, "gx_dph"), tau_s) == pytest.approx(expected(x["noise"], tau_s), rel=SCATTER), tau_s
        for name in ("gy_dph", "gz_dph"):  # the third was not asked: it keeps what is believed of it
            got, truth = (deviation(column(path, name), tau_s) for path in (again, sensor))
            assert got == pytest.approx(truth, rel=0.25), (tau_s, name)


def test_one_of_several_processes_is_not_told_as_the_noise(tmp_path):
    for kind, said in ((two_processes, " with a time constant of "), (one_over_f, "1/f noise of instability B ")):
        truth, believed = write(tmp_path / "truth.json", kind(1)), write(tmp_path / "believed.json", kind(3))
        logs = [simulated(tmp_path, truth, MOVING, 5, i) for i in range(4)]
        (axis,), _, text = diagnosed(tmp_path, believed, logs)
        (effect,) = [e for e in axis["effects"] if e["name"] == "noise_parameters"]
        assert list(effect["parameters"]) == ["arw_deg_rt_h"] and "sigma_dph" not in text, text
        assert said in effect["in_words"] and effect["in_words"] in text
        if kind is one_over_f:  # B of 2 dph
            strength = float(effect["in_words"].split("instability B ")[1].split(" dph")[0])
            assert strength == pytest.approx(2.0, rel=0.2), text
        else:
            assert effect["in_words"].count(" with a time constant of ") == len(axis["noise"]["markov"]) == 2
