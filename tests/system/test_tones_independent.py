# SPDX-License-Identifier: MIT
"""Tones in logs that this file simulates itself, with numpy alone: gyrosim shares its formulas with diagnose.

A tone is averaged over each second by adding 50 of its values.  What the logs can tell of amplitude, frequency and drift
follows from the Fisher information of the samples in narrow-band noise, whose density at the tone is that of the model."""
import math

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from asking import DIAGNOSE, axis_told, model_option, write_log
from draws import long_after

ARW, SIGMA, TAU_S = 0.6, 20.0, 100.0
MODEL = {"imucal_model": 1, "arw_deg_rt_h": ARW, "markov": [{"sigma_dph": SIGMA, "tau_s": TAU_S}],
         "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [0, 0, 0, 0]}}
SECONDS = 5000
NYQUIST_HZ = 0.5


def temperature(n, cycles):
    """Soak, rise, soak, fall, soak; corners as a chamber has them not: sharp."""
    phase = np.arange(n) / n * cycles % 1
    return np.round(60 * np.interp(phase, [0, 0.075, 0.425, 0.575, 0.925, 1], [0, 0, 1, 1, 0, 0]), 3)


def noise(rng, n):
    phi = math.exp(-1 / TAU_S)
    drive = SIGMA * math.sqrt(1 - phi * phi) * rng.standard_normal(n)
    drive[0] = SIGMA * rng.standard_normal()
    return 60 * ARW * rng.standard_normal(n) + lfilter([1], [1, -phi], drive)


def phase_cycles(temp, hz, drift):
    """Cycles at the start of every second; the frequency is constant within it."""
    f = hz + drift * temp
    return np.concatenate([[0], np.cumsum(f)[:-1]]), f


def tone_means(temp, amplitude, hz, drift, phase):
    start, f = phase_cycles(temp, hz, drift)
    within = (np.arange(50) + 0.5) / 50
    return amplitude * np.sin(2 * np.pi * (start[:, None] + f[:, None] * within) + phase).mean(axis=1)


def loop(rng, temp, opening, width):
    """Friction: the state follows the temperature at a distance of at most `width`."""
    state, out = temp[0] + rng.uniform(-width, width), np.empty(len(temp))
    for k, degc in enumerate(temp):
        state = min(max(state, degc - width), degc + width)
        out[k] = opening * (state - degc) / width
    return out


def write_logs(folder, tones, seed=1, logs=2, opening=0.0, where=None, has_temperature=True, lost=0.0):
    rng = np.random.default_rng(seed)
    paths, kept = [], []
    for i in range(logs):
        temp = temperature(SECONDS, 1 + 0.5 * (i % 2))
        x = (temp - 30) / 30
        rate = 30 * rng.standard_normal() + noise(rng, SECONDS)
        if has_temperature:
            rate += 80 + 300 * x + 150 * x ** 2 - 100 * x ** 3
        if opening:
            rate += loop(rng, temp, opening, 5.0)
        for tone in tones:
            phase = rng.uniform(0, 2 * np.pi)
            if where is None or i in where:
                rate += tone_means(temp, *tone, phase)
        keep = np.flatnonzero(rng.random(SECONDS) >= lost)
        shown = temp[keep] if has_temperature else np.full(len(keep), math.nan)
        paths.append(write_log(folder / f"run{i}.csv", keep + 1, shown, rate[keep], form="%d,%r,%.4f"))
        kept.append((temp, keep))
    return paths, kept


def diagnose(folder, paths, held_out=(), model=True):
    options = model_option(folder / "model.json", MODEL if model else None)
    return axis_told(DIAGNOSE, options, paths, held_out, cache=folder.parent / "cache")


def density(hz):
    """Noise density per sample at a frequency, dph^2: white noise and the sampled Markov process."""
    phi = math.exp(-1 / TAU_S)
    return (60 * ARW) ** 2 + SIGMA ** 2 * (1 - phi ** 2) / (1 - 2 * phi * math.cos(2 * math.pi * hz) + phi ** 2)


def fisher_errors(kept, amplitude, hz, drift):
    """Least errors of frequency (and drift), and of the root mean square amplitude: each run has its own amplitude and phase."""
    shared = 2 if drift else 1
    size = shared + 2 * len(kept)
    information = np.zeros((size, size))
    for r, (temp, keep) in enumerate(kept):
        start, f = phase_cycles(temp, hz, drift)
        angle = 2 * np.pi * (start + f / 2)
        slope = [2 * np.pi * (np.arange(len(temp)) + 0.5)]
        if drift:
            slope.append(2 * np.pi * (np.cumsum(temp) - temp / 2))
        columns = np.zeros((len(keep), size))
        for j, d in enumerate(slope):
            columns[:, j] = (amplitude * np.cos(angle) * d)[keep]
        columns[:, shared + 2 * r] = np.sin(angle)[keep]
        columns[:, shared + 2 * r + 1] = amplitude * np.cos(angle)[keep]
        information += columns.T @ columns / density(hz + 30 * drift)
    scale = 1 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    of_amplitudes = [covariance[shared + 2 * r, shared + 2 * r] for r in range(len(kept))]
    return math.sqrt(covariance[0, 0]), math.sqrt(covariance[1, 1]) if drift else 0, math.sqrt(np.mean(of_amplitudes) / len(kept))


def alias_of(hz):
    return abs((hz + NYQUIST_HZ) % (2 * NYQUIST_HZ) - NYQUIST_HZ)


def in_means(amplitude, hz):
    return amplitude * abs(np.sinc(hz))


def tones_of(axis):
    return sorted((e for e in axis["effects"] if e["name"] == "sinusoid"), key=lambda e: e["parameters"]["frequency_hz"])


def other_names(axis):
    return sorted(e["name"] for e in axis["effects"] if e["name"] != "sinusoid")


def expect_tone(effect, kept, amplitude, hz, drift=0.0, share=1.0):
    """Within four of the program's own errors, which are those that the samples allow within a fifth."""
    p, errors = effect["parameters"], effect["std_errors"]
    seen = in_means(amplitude, hz + 30 * drift)
    least_hz, least_drift, least_amplitude = fisher_errors(kept, seen, alias_of(hz), drift)
    assert p["amplitude_dph"] == pytest.approx(seen * share, abs=4 * errors["amplitude_dph"])
    assert errors["amplitude_dph"] == pytest.approx(least_amplitude, rel=0.2)
    assert p["frequency_hz"] == pytest.approx(alias_of(hz), abs=4 * errors["frequency_hz"])
    if share == 1:
        assert errors["frequency_hz"] == pytest.approx(least_hz, rel=0.2)
    if drift:
        assert p["drift_hz_per_degc"] == pytest.approx(drift, abs=4 * errors["drift_hz_per_degc"])
        assert errors["drift_hz_per_degc"] == pytest.approx(least_drift, rel=0.2)
    else:
        assert "drift_hz_per_degc" not in p


@pytest.mark.parametrize("amplitude, hz", [(20, 0.1234567), (20, 0.4500317), (60, 1.2345), (45, 0.78123), (15, 0.0331),
                                            (250, 2.31377)])
def test_a_tone_is_told_at_any_frequency_or_at_its_alias(tmp_path, amplitude, hz):
    paths, kept = write_logs(tmp_path, [(amplitude, hz, 0)])
    axis = diagnose(tmp_path, paths)
    assert axis["verdict"] == "explained" and other_names(axis) == [] and len(tones_of(axis)) == 1
    expect_tone(tones_of(axis)[0], kept, amplitude, hz)


@pytest.mark.parametrize("period_s", [123.4, 163.9, 211.7, 303.7, 391])
@pytest.mark.parametrize("seed", long_after(1, [3, 1]))
def test_a_slow_tone_is_no_slow_noise(tmp_path, period_s, seed):
    """The tone is in the mean: what a repeatable cause would have to take is what is left without it."""
    paths, kept = write_logs(tmp_path, [(40, 1 / period_s, 0)], seed=seed)
    axis = diagnose(tmp_path, paths)
    assert axis["verdict"] == "explained" and other_names(axis) == [] and len(tones_of(axis)) == 1
    found = tones_of(axis)[0]["parameters"]
    assert found["frequency_hz"] == pytest.approx(1 / period_s, abs=0.2 / SECONDS)
    assert found["amplitude_dph"] == pytest.approx(40, rel=0.15)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_tone_of_one_log_of_three_is_said_to_be_there(tmp_path, seed):
    """The amplitude is the root mean square over the logs: those without a tone add little but the square of their errors."""
    paths, kept = write_logs(tmp_path, [(20, 0.0417, 0)], logs=3, where=[1], seed=seed)
    axis = diagnose(tmp_path, paths)
    assert other_names(axis) == [] and len(tones_of(axis)) == 1
    assert axis["where"]["logs"] == [1]
    expect_tone(tones_of(axis)[0], kept, 20, 0.0417, share=1 / math.sqrt(3))


@pytest.mark.parametrize("amplitude, hz, drift", [(20, 0.08, 2.1e-4), (20, 0.33, -3.3e-4), (18, 0.2, 4.1e-5)])
def test_a_tone_that_drifts_is_told_with_its_drift(tmp_path, amplitude, hz, drift):
    paths, kept = write_logs(tmp_path, [(amplitude, hz, drift)], seed=4)
    axis = diagnose(tmp_path, paths)
    assert other_names(axis) == [] and len(tones_of(axis)) == 1
    expect_tone(tones_of(axis)[0], kept, amplitude, hz, drift)


@pytest.mark.parametrize("draws", [6, pytest.param(12, marks=pytest.mark.long)])
def test_errors_of_frequency_and_drift_are_those_that_are_made(tmp_path, draws):
    """The sum of squares of the errors in their own units lies between the 0.1 % points of chi-square."""
    apart = []
    for seed in range(20, 20 + draws):
        paths, _ = write_logs(tmp_path, [(20, 0.08, 2.1e-4)], seed=seed)
        e = tones_of(diagnose(tmp_path, paths))[0]
        apart.append([(e["parameters"]["frequency_hz"] - 0.08) / e["std_errors"]["frequency_hz"],
                      (e["parameters"]["drift_hz_per_degc"] - 2.1e-4) / e["std_errors"]["drift_hz_per_degc"]])
    square = np.sum(np.square(apart), axis=0)
    assert np.all(square > chi2.ppf(1e-3, draws)) and np.all(square < chi2.isf(1e-3, draws)), square


@pytest.mark.parametrize("lost", [0.15, 0.4])
def test_missing_rows_shift_no_phase(tmp_path, lost):
    paths, kept = write_logs(tmp_path, [(25, 0.2711, 0)], lost=lost)
    axis = diagnose(tmp_path, paths)
    assert other_names(axis) == [] and len(tones_of(axis)) == 1
    expect_tone(tones_of(axis)[0], kept, 25, 0.2711)


@pytest.mark.parametrize("model", [True, False])
def test_logs_without_a_temperature_tell_their_tone(tmp_path, model):
    paths, kept = write_logs(tmp_path, [(20, 0.0871, 0)], has_temperature=False)
    axis = diagnose(tmp_path, paths, model=model)
    assert other_names(axis) == [] and len(tones_of(axis)) == 1
    expect_tone(tones_of(axis)[0], kept, 20, 0.0871)


@pytest.mark.parametrize("hz, drift, seed", [(0.0331, 0, 1), (0.0331, 0, 2), (0.0057, 0, 3), (0.21, 1.2e-4, 4)])
def test_a_tone_beside_a_loop_gets_no_name_of_noise(tmp_path, hz, drift, seed):
    paths, kept = write_logs(tmp_path, [(25, hz, drift)], opening=45, seed=seed)
    axis = diagnose(tmp_path, paths)
    assert other_names(axis) == ["thermal_hysteresis"] and len(tones_of(axis)) == 1
    p, errors = tones_of(axis)[0]["parameters"], tones_of(axis)[0]["std_errors"]
    assert p["frequency_hz"] + 30 * p.get("drift_hz_per_degc", 0) == pytest.approx(hz + 30 * drift, abs=0.1 / SECONDS)
    assert p["amplitude_dph"] == pytest.approx(in_means(25, hz + 30 * drift), abs=4 * errors["amplitude_dph"])
    found = next(e for e in axis["effects"] if e["name"] == "thermal_hysteresis")
    assert found["parameters"]["amplitude_dph"] == pytest.approx(45, abs=4 * found["std_errors"]["amplitude_dph"])


def test_two_tones_three_beats_apart_are_two(tmp_path):
    paths, kept = write_logs(tmp_path, [(20, 0.1, 0), (20, 0.1007, 0)])
    axis = diagnose(tmp_path, paths)
    assert other_names(axis) == [] and len(tones_of(axis)) == 2
    for effect, hz in zip(tones_of(axis), (0.1, 0.1007)):
        assert effect["parameters"]["frequency_hz"] == pytest.approx(hz, abs=4 * effect["std_errors"]["frequency_hz"])
        assert effect["parameters"]["amplitude_dph"] == pytest.approx(in_means(20, hz), abs=4 * effect["std_errors"]["amplitude_dph"])


@pytest.mark.parametrize("cycles", [1.3, 2.3, 5.3])
def test_a_period_near_the_length_of_a_run_is_no_tone_of_another_frequency(tmp_path, cycles):
    """No line: too slow.  But 60 dph are a gap."""
    axis = diagnose(tmp_path, write_logs(tmp_path, [(60, cycles / SECONDS, 0)])[0])
    assert axis["verdict"] != "no_gap"
    assert all(abs(e["parameters"]["frequency_hz"] - cycles / SECONDS) < 1 / SECONDS for e in tones_of(axis))


def test_a_held_out_log_confirms_the_tone(tmp_path):
    paths, kept = write_logs(tmp_path, [(20, 0.1234567, 0)], logs=3)
    axis = diagnose(tmp_path, paths[:2], paths[2:])
    assert axis["verdict"] == "explained" and other_names(axis) == []
    expect_tone(tones_of(axis)[0], kept[:2], 20, 0.1234567)


@pytest.mark.parametrize("seeds", [range(100, 110), pytest.param(range(110, 120), marks=pytest.mark.long)], ids=str)
def test_logs_without_a_tone_name_none(tmp_path, seeds):
    """One per cent of such logs may get a name: two of 10 would, in 4 of 1000 runs of this test.  None is a tone."""
    named = 0
    for seed in seeds:
        axis = diagnose(tmp_path, write_logs(tmp_path, [], seed=seed)[0], model=seed % 4 > 0)
        assert tones_of(axis) == []
        named += axis["verdict"] != "no_gap"
    assert named <= 1
