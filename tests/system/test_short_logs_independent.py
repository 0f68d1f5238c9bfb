# SPDX-License-Identifier: MIT
"""Logs of 12 to 60 minutes of one healthy device, and a loop in one of them: what a first try on a bench records.

Up and down at 2 to 5 degC/min between soaks of two minutes; a row a second, a cubic of the temperature, white noise of 0.6
deg/sqrt(h) and one process of 15 dph and 200 s.  Ten devices of three axes are asked with the true model, ten with none.  A process
of 200 s in so short a log may look like a loop: that it could be one is no gap where the model says it.  With a model the rate of
false alarms is stated, 1 in 100 of a log's axes together: of 30 logs of three lengths two may have any (3 or more: 3 in 1000).
Without one an axis of 12 minutes may be left open; of 30 minutes and more one in eight may be said to have a gap.

Of 30 axes of 12, 30 and 60 minutes 13, 9 and 4 were said to have a gap with the model, and 22, 7 and 2 without, before the rule was
there; 1, 1 and 0 with it, and 18, 1 and 0.  So short a log of one ramp up and down, and no model, tells nearly nothing."""
import numpy as np
import pytest

from asking import DIAGNOSE, axes_of, model_of, model_option, run, write_log

SEED, WHITE, SIGMA, TAU = 20261128, 36, 15, 200
AXES = ("gx_dph", "gy_dph", "gz_dph")


def slow(rng, n):
    keep, out = np.exp(-1 / TAU), np.empty(n)
    at = rng.normal(0, SIGMA)
    for k in range(n):
        out[k] = at
        at = keep * at + rng.normal(0, SIGMA * np.sqrt(1 - keep * keep))
    return out


def up_and_down(minutes):
    ramp = np.linspace(0, 1, (minutes - 4) * 30)
    return 5 + min(45, 2.2 * (minutes - 4)) * np.concatenate([np.zeros(120), ramp, ramp[::-1], np.zeros(120)])


def play(degc, half_width):
    out, at = np.empty(len(degc)), degc[0]
    for k, t in enumerate(degc):
        at = min(max(at, t - half_width), t + half_width)
        out[k] = (at - t) / half_width
    return out


def ask(folder, rng, minutes, has_model, loop_dph=0):
    degc = up_and_down(minutes)
    u = (degc - 25) / 25
    rates = [np.polynomial.polynomial.polyval(u, rng.normal(0, [50, 200, 80, 40])) + slow(rng, len(u)) +
             WHITE * rng.standard_normal(len(u)) + loop_dph * play(degc, 3) for _ in AXES]
    log = write_log(folder / "log.csv", np.arange(len(u)), degc, *rates, axes=AXES, form="%d,%.3f,%.2f,%.2f,%.2f")
    model = model_of(WHITE, (SIGMA, TAU), t0_degc=25, range_degc=25) if has_model else None
    done, _ = run(DIAGNOSE, model_option(folder / "model.json", model), [log])
    return axes_of(done)


def healthy(folder, minutes, has_model):
    rng = np.random.default_rng([SEED, minutes, has_model])
    return [[axis["verdict"] != "no_gap" for axis in ask(folder, rng, minutes, has_model)] for _ in range(10)]


def test_what_the_model_says_is_no_gap(tmp_path):
    wrong = [any(log) for minutes in (12, 30, 60) for log in healthy(tmp_path, minutes, True)]
    assert sum(wrong) <= 2, wrong


def test_few_are_left_open_without_a_model(tmp_path):
    wrong = [axis for minutes in (30, 60) for log in healthy(tmp_path, minutes, False) for axis in log]
    assert sum(wrong) <= len(wrong) // 8, wrong


@pytest.mark.parametrize("has_model", (True, False))
def test_a_loop_in_such_a_log_is_found(tmp_path, has_model):
    rng = np.random.default_rng([SEED, 1, has_model])
    axes = ask(tmp_path, rng, 30, has_model, loop_dph=150)
    assert all(axis["verdict"] != "no_gap" for axis in axes), [axis["statement"] for axis in axes]
