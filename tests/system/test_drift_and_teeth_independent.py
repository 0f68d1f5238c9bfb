# SPDX-License-Identifier: MIT
"""Tones that drift fast with temperature, and teeth beside telegraph noise, in logs that this file simulates itself.

Temperature, phase and jumps are followed 20 times a second; a row is the mean of its second.  The noise is white noise and
one first-order process, the bias a cubic in temperature.  No code is shared with the programs."""
import math

import numpy as np
import pytest
from scipy.signal import lfilter

from asking import DIAGNOSE, axis_told, model_of, model_option, write_log
from draws import long_after

WHITE, SLOW, TAU_S = 39.0, 9.0, 70.0  # dph per second's mean, dph, s
MODEL = model_of(WHITE, (SLOW, TAU_S), range_degc=35)
FINE = 20  # steps of a second
T0_DEGC = 22.0
NATS = 150
# Corners in seconds and degC: ramps of several speeds, soaks between them; 6900 to 7150 s.
PROFILES = [[(0, 24), (400, 24), (1700, -12), (2500, -12), (4700, 51), (5600, 51), (6900, 20)],
            [(0, 50), (700, 50), (2900, 8), (3500, 8), (4400, -13), (5100, -13), (7150, 46)],
            [(0, -10), (300, -10), (2000, 30), (2900, 30), (3600, 52), (4300, 52), (6600, -9), (7050, -9)]]
DRAW = np.random.default_rng(20261123)
TONES = [(DRAW.uniform(0.12, 0.38), DRAW.choice([-1, 1]) * math.exp(DRAW.uniform(math.log(1.3e-4), math.log(9e-4))),
          int(DRAW.choice([2, 3])), 40 + i) for i in range(8)]  # Hz at T0, Hz/degC, logs, seed


def temperature(corners):
    """Degrees at every fine step; the chamber follows its corners as a body with a time constant of 45 s would."""
    at, degc = zip(*corners)
    raw = np.interp((np.arange(at[-1] * FINE) + 0.5) / FINE, at, degc)
    phi = math.exp(-1 / (45 * FINE))
    return raw[0] + lfilter([1 - phi], [1, -phi], raw - raw[0])


def seconds(fine):
    return fine.reshape(-1, FINE).mean(axis=1)


def noise(rng, n):
    phi = math.exp(-1 / TAU_S)
    drive = SLOW * rng.standard_normal(n)
    drive[1:] *= math.sqrt(1 - phi ** 2)
    return WHITE * rng.standard_normal(n) + lfilter([1], [1, -phi], drive)


def tone(rng, degc, amplitude, hz, drift):
    f = hz + drift * (degc - T0_DEGC)
    return amplitude / np.sinc(hz) * np.sin(2 * np.pi * np.cumsum(f) / FINE + rng.uniform(0, 2 * np.pi))


def jumps(rng, n, interval_s, height, kind):
    """Two levels in turn, or teeth: every jump goes up, the way back is slow (straight to the next jump, or exponential)."""
    at = np.cumsum(rng.exponential(interval_s, int(4 * n / FINE / interval_s) + 50)) - 5 * interval_s
    t = np.arange(n) / FINE
    last = np.searchsorted(at, t, side="right") - 1
    if kind == "telegraph":
        return height * (last % 2 - 0.5) * rng.choice([-1, 1])
    if kind == "straight":
        return height * (0.5 - (t - at[last]) / (at[last + 1] - at[last]))
    return height * sum(np.where(t >= a, np.exp(-np.maximum(t - a, 0) / interval_s), 0) for a in at if a < t[-1])


def write_logs(folder, seed, logs, added=lambda rng, degc: 0):
    rng = np.random.default_rng(seed)
    paths = []
    for i in range(logs):
        degc = temperature(PROFILES[i])
        x = (degc - 20) / 35
        rate = seconds(-240 + 410 * x - 170 * x ** 2 + 90 * x ** 3 + added(rng, degc)) + noise(rng, len(x) // FINE)
        paths.append(write_log(folder / f"log{i}.csv", np.arange(1, len(rate) + 1), seconds(degc), rate, form="%d,%.3f,%.4f"))
    return paths


def effects(folder, paths):
    return axis_told(DIAGNOSE, model_option(folder / "model.json", MODEL), paths, cache=folder.parent / "cache")["effects"]


@pytest.mark.parametrize("hz, drift, logs, seed", long_after(4, TONES))
def test_a_tone_that_drifts_fast_is_named_with_its_drift(tmp_path, hz, drift, logs, seed):
    """Five errors of the program, and half a beat over the longest log at either end of the temperatures."""
    samples = sum(PROFILES[i][-1][0] for i in range(logs))
    amplitude = WHITE * math.sqrt(4 * NATS / samples)
    found = effects(tmp_path, write_logs(tmp_path, seed, logs, lambda rng, degc: tone(rng, degc, amplitude, hz, drift)))
    assert [e["name"] for e in found] == ["sinusoid"]
    p, errors = found[0]["parameters"], found[0]["std_errors"]
    at_zero = hz - drift * T0_DEGC
    assert p["frequency_hz"] == pytest.approx(at_zero, abs=5 * errors["frequency_hz"])
    assert p["drift_hz_per_degc"] == pytest.approx(drift, abs=5 * errors["drift_hz_per_degc"])
    assert p["amplitude_dph"] == pytest.approx(amplitude, abs=5 * errors["amplitude_dph"])
    for degc in (-13, 52):
        assert p["frequency_hz"] + p["drift_hz_per_degc"] * degc == pytest.approx(at_zero + drift * degc, abs=0.5 / 7150)


@pytest.mark.parametrize("seed", long_after(4, range(80, 88)))
def test_noise_over_the_same_temperatures_is_no_tone(tmp_path, seed):
    assert "sinusoid" not in [e["name"] for e in effects(tmp_path, write_logs(tmp_path, seed, 2 + seed % 2))]


JUMPS = [(300, 90, 0), (300, 90, 1), (300, 150, 2), (700, 90, 0), (150, 60, 3000), (150, 90, 3001)]  # s, dph, seed


@pytest.mark.parametrize("kind", ["straight", "exponential"])
@pytest.mark.parametrize("sign", [1, pytest.param(-1, marks=pytest.mark.long)])
@pytest.mark.parametrize("interval_s, height, seed", long_after(2, JUMPS))
def test_teeth_are_called_neither_telegraph_noise_nor_outliers(tmp_path, interval_s, height, seed, sign, kind):
    found = effects(tmp_path, write_logs(tmp_path, seed, 2, lambda rng, degc: sign * jumps(rng, len(degc), interval_s, height, kind)))
    assert not {"telegraph_noise", "outliers", "fast_noise"} & {e["name"] for e in found}


@pytest.mark.parametrize("interval_s, height, seed, logs",
                         long_after(4, [(*j, n) for n in (1, 2, 3) for j in JUMPS if 6900 * n > 15 * j[0]]))
def test_a_telegraph_process_is_called_one_and_nothing_stands_beside_it(tmp_path, interval_s, height, seed, logs):
    """The noise of the model is exact, and there are 15 jumps or more."""
    found = effects(tmp_path, write_logs(tmp_path, seed, logs, lambda rng, degc: jumps(rng, len(degc), interval_s, height, "telegraph")))
    assert [e["name"] for e in found] == ["telegraph_noise"]
    assert found[0]["parameters"]["amplitude_dph"] == pytest.approx(height / 2, abs=5 * found[0]["std_errors"]["amplitude_dph"])


@pytest.mark.parametrize("seed", long_after(1, range(5100, 5104)))
def test_a_cause_is_told_beside_a_telegraph_process(tmp_path, seed):
    def added(rng, degc):
        return jumps(rng, len(degc), 250, 80, "telegraph") + 65 * np.exp(-0.5 * ((degc - 24) / 4.5) ** 2)
    found = {e["name"]: e for e in effects(tmp_path, write_logs(tmp_path, seed, 3, added))}
    assert set(found) == {"telegraph_noise", "thermal_anomaly"}
    p, errors = found["thermal_anomaly"]["parameters"], found["thermal_anomaly"]["std_errors"]
    for name, true in (("amplitude_dph", 65), ("center_degc", 24), ("width_degc", 4.5)):
        assert p[name] == pytest.approx(true, abs=4 * errors[name])
