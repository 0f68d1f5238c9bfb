# SPDX-License-Identifier: MIT
"""A saw in time is no ramp and no switch, and a ripple of the chamber is no tone of the device.

A row is a second.  A chamber soaks and ramps between 0 and 55 degC, a body follows it; the bias is a cubic of the temperature
with a constant of its own in every log; the noise is white with one first-order process beside it.  On top of it come
A) a relaxation oscillator: the bias drifts at a steady pace and falls back to its start at once when it has reached a
threshold, with a phase of its own in every log; B) a ripple of the chamber's regulation on a device whose bias follows the
square of the rate of temperature; C) the same ripple on a device that does not, but has a true tone far from the ripple and
from its double.  A must be called a gap, but neither a drift with the rate nor a switch; B must not be called a tone; C must.
All of it is simulated by this file; no code is shared with the programs, and no model is given to them.  The last of a
device's four logs is held out.  Seeds and limits were chosen before the first run: no device may miss."""
import math

import numpy as np
import pytest

from asking import DIAGNOSE, axis_told, names, write_log

SEED = 20310822
N_LOGS = 4
WHITE = 30.0  # dph in a second: 0.5 deg/sqrt(h)
MARKOV_DPH, MARKOV_S = 10.0, 100.0
TONE_DPH = 25.0
TONE_PERIODS_S = [(9, 14), (220, 320)]  # the ripple has 60 to 120 s, its double frequency 30 to 60 s


def first_order(x, tau_s):
    out, y, a = np.empty(len(x)), x[0], 1 - math.exp(-1 / tau_s)
    for i, now in enumerate(x):
        y += a * (now - y)
        out[i] = y
    return out


def noise(rng, n):
    phi, y, slow = math.exp(-1 / MARKOV_S), MARKOV_DPH * rng.standard_normal(), np.empty(n)
    drive = MARKOV_DPH * math.sqrt(1 - phi ** 2) * rng.standard_normal(n)
    for i in range(n):
        slow[i] = y
        y = phi * y + drive[i]
    return WHITE * rng.standard_normal(n) + slow


def chamber(rng, n):
    """Soaks and ramps in turn between about 0 and 55 degC, as the body sees them."""
    t, degc, is_rising, at = 0.0, rng.uniform(0, 55), rng.random() < 0.5, []
    while t < n:
        soak_end, goal = t + rng.uniform(300, 700), rng.uniform(42, 55) if is_rising else rng.uniform(0, 13)
        at += [(t, degc), (soak_end, degc)]
        t, degc, is_rising = soak_end + abs(goal - degc) / rng.uniform(1, 2) * 60, goal, not is_rising
    return first_order(np.interp(np.arange(n), *zip(*at, (t, degc))), rng.uniform(60, 120))


def cubic(coeff, degc):
    return np.polynomial.polynomial.polyval((degc - 27.5) / 27.5, coeff)


def answer(folder, name, logs, note):
    """Names of the effects and the verdict for logs of (temperature, rate)."""
    rng, paths = np.random.default_rng([SEED, len(logs[0][0])]), []
    for i, (degc, rate) in enumerate(logs):
        n = len(degc)
        paths.append(write_log(folder / f"{name}_{i}.csv", np.arange(1, n + 1), degc + 0.01 * rng.standard_normal(n), rate))
    axis = axis_told(DIAGNOSE, [], paths[:-1], paths[-1:])
    print(name, note, names(axis), axis["verdict"], axis["title"])
    return names(axis), axis["verdict"]


def saw_device(folder, number):
    rng = np.random.default_rng([SEED, 1, number])
    coeff, per_hour, threshold = rng.normal(0, [0, 250, 120, 60]), rng.uniform(90, 150), rng.uniform(140, 220)
    lengths = rng.integers(6000, 8001, N_LOGS)
    while True:  # phases anew until the logs that are fitted have three resets
        phases = rng.uniform(0, threshold, N_LOGS)
        n_resets = [int((p + per_hour / 3600 * (n - 1)) // threshold) for p, n in zip(phases, lengths)]
        if sum(n_resets[:-1]) >= 3:
            break
    sign, logs = rng.choice([-1, 1]), []
    for n, phase in zip(lengths, phases):
        degc = chamber(rng, n)
        saw = sign * ((phase + per_hour / 3600 * np.arange(n)) % threshold)
        logs.append((degc, cubic(coeff, degc) + rng.normal(0, 30) + saw + noise(rng, n)))
    return answer(folder, f"saw{number}", logs, f"{per_hour:.0f} dph/h to {threshold:.0f} dph, resets {n_resets}")


def ripple_device(folder, number, has_tone):
    rng = np.random.default_rng([SEED, 2 + has_tone, number])
    coeff, ripple_degc, period_s = rng.normal(0, [0, 250, 120, 60]), rng.uniform(0.08, 0.2), rng.uniform(60, 120)
    rows, wave = [], 2 * math.pi / period_s
    for n in rng.integers(6000, 8001, N_LOGS):
        slow, angle = chamber(rng, n), wave * np.arange(n) + rng.uniform(0, 2 * math.pi)
        ramp, beat = np.gradient(slow) * 60, ripple_degc * wave * 60 * np.cos(angle)  # degC/min
        rows.append((slow + ripple_degc * np.sin(angle), ramp, beat))
    # The square of the rate has 2 ramp beat at the ripple's frequency and the alternating part of beat^2 at its double.
    seen = np.concatenate([2 * ramp * beat + beat ** 2 - np.mean(beat ** 2) for _, ramp, beat in rows])
    strength = rng.choice([-1, 1]) * rng.uniform(9, 14) / np.std(seen)  # dph per (degC/min)^2
    tone_s, logs = rng.uniform(*TONE_PERIODS_S[number % 2]), []
    for degc, ramp, beat in rows:
        n = len(degc)
        tone = TONE_DPH * np.sin(2 * math.pi / tone_s * np.arange(n) + rng.uniform(0, 2 * math.pi))
        extra = tone if has_tone else strength * (ramp + beat) ** 2
        logs.append((degc, cubic(coeff, degc) + rng.normal(0, 30) + extra + noise(rng, n)))
    note = f"tone {tone_s:.1f} s" if has_tone else f"{strength:.1f} dph per (degC/min)^2, seen {np.std(strength * seen):.1f} dph"
    return answer(folder, f"{'tone' if has_tone else 'square'}{number}", logs, f"{ripple_degc:.2f} degC {period_s:.0f} s, {note}")


DEVICES = pytest.mark.parametrize("n_devices", [2, pytest.param(3, marks=pytest.mark.long)])  # the first of them


@DEVICES
def test_saw_is_neither_rate_ramp_nor_telegraph_noise(tmp_path, n_devices):
    found = [saw_device(tmp_path, k) for k in range(n_devices)]
    assert not [f for f in found if {"rate_ramp", "telegraph_noise"} & set(f[0]) or f[1] == "no_gap"], found


@DEVICES
def test_ripple_of_the_chamber_is_no_tone(tmp_path, n_devices):
    found = [ripple_device(tmp_path, k, False) for k in range(n_devices)]
    assert not [f for f in found if "sinusoid" in f[0]], found


def test_true_tone_beside_the_ripple_is_named(tmp_path):
    found = [ripple_device(tmp_path, k, True) for k in range(2)]
    assert not [f for f in found if "sinusoid" not in f[0]], found
