# SPDX-License-Identifier: MIT
"""errormodel fit on sick logs: no model in silence, the rule that speaks is named, --accept insists."""
import json
import subprocess

import numpy as np
import pytest

from where import BIN

N = 6000


def healthy(seed):
    """Temperature and two axes: the paper's noise on a ramp between soaks."""
    rng = np.random.default_rng(seed)
    temp = np.clip(np.arange(N) / 60.0 - 20, 0, 60) + 0.01 * rng.standard_normal(N)
    rates = []
    for _ in range(2):
        markov = np.empty(N)
        state = 20 * rng.standard_normal()
        for k in range(N):
            markov[k] = state
            state = np.exp(-0.01) * state + 20 * np.sqrt(1 - np.exp(-0.02)) * rng.standard_normal()
        rates.append(80 + 5 * temp + markov + 36 * rng.standard_normal(N))
    return temp, rates


def one_knock(temp, rates):
    rates[0][2000] = 1e5


def frozen_half(temp, rates):
    rates[0][3000:] = rates[0][3000]


def held_two(temp, rates):
    rates[0][1::2] = rates[0][::2]


def held_ten(temp, rates):
    rates[0][:] = np.repeat(rates[0][::10], 10)


def swapped(temp, rates):
    temp[:], rates[0][:] = rates[0].copy(), temp.copy()


def fit(folder, sicken, *options):
    temp, rates = healthy(3)
    if sicken:
        sicken(temp, rates)
    rows = "\n".join(f"{k},{temp[k]:.4f},{rates[0][k]:.3f},{rates[1][k]:.3f}" for k in range(N))
    (folder / "log.csv").write_text(f"t_s,temp_degc,gx_dph,gy_dph\n{rows}\n")
    done = subprocess.run([BIN / "errormodel", "fit", "log.csv", "--criterion", "ml", "--markov", "1", "-o", "m.json", "--json", "r.json", *options],
                          cwd=folder, capture_output=True, text=True, timeout=120)
    return done, json.loads((folder / "r.json").read_text())


def test_healthy_log_is_accepted(tmp_path):
    done, result = fit(tmp_path, None)
    assert done.returncode == 0, done.stderr
    assert result["judgement"] == {"accepted": True, "reasons": []}
    model = json.loads((tmp_path / "m.json").read_text())
    assert model["arw_deg_rt_h"] == pytest.approx(0.6, rel=0.05) and "comment" not in model


@pytest.mark.parametrize("sicken, rule, words", [(one_knock, "outliers", "t = 2000 s"), (frozen_half, "repeated", "3000"),
                                                 (held_two, "repeated", "rows of 2 s"), (held_ten, "repeated", "rows of 10 s"),
                                                 (swapped, "temp-spikes", "temperatures")])
def test_sick_log_makes_no_model_in_silence(tmp_path, sicken, rule, words):
    done, result = fit(tmp_path, sicken)
    assert done.returncode == 1, done.stdout + done.stderr
    assert f"gx_dph: {rule}: " in json.loads((tmp_path / "m.json").read_text())["comment"]
    reasons = result["judgement"]["reasons"]
    assert not result["judgement"]["accepted"] and rule in [r["rule"] for r in reasons]
    assert all({"axis", "rule", "value", "limit", "text"} <= set(r) for r in reasons)
    assert any("log.csv" in line and "gx_dph" in line and words in line for line in done.stderr.splitlines())
    assert "--accept" in done.stderr


@pytest.mark.parametrize("command", [("errormodel", "fit", "--criterion", "ml", "--markov", "1"), ("dp",),
                                     ("calibrate", "fit", "--method", "poly")])
def test_two_axes_that_are_one(tmp_path, command):
    temp, rates = healthy(3)
    rows = "\n".join(f"{k},{temp[k]:.4f},{rates[0][k]:.3f},{rates[0][k]:.3f}" for k in range(N))
    (tmp_path / "twins.csv").write_text(f"t_s,temp_degc,gx_dph,gy_dph\n{rows}\n")
    done = subprocess.run([BIN / command[0], *command[1:], "twins.csv"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == (0 if command == ("dp",) else 3), done.stderr
    assert all(word in done.stderr for word in ("twins.csv", "gx_dph", "gy_dph", "same")), done.stderr
    one = subprocess.run([BIN / command[0], *command[1:], "twins.csv", "--axis", "gy_dph"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert one.returncode == 0 and "gx_dph" not in one.stderr, one.stderr


@pytest.mark.parametrize("quantum_degc", (1, 2, 5))
def test_coarse_thermometer_is_healthy(tmp_path, quantum_degc):
    """Its steps are its quantum: no jumps, and nothing out of reach (calibrate fit takes it too)."""

    def coarse(temp, rates):
        temp[:] = quantum_degc * np.round(temp / quantum_degc)

    done, result = fit(tmp_path, coarse)
    assert result["judgement"] == {"accepted": True, "reasons": []}, done.stderr


def test_accept_insists(tmp_path):
    done, result = fit(tmp_path, one_knock, "--accept", "outliers")
    assert done.returncode == 0 and (tmp_path / "m.json").exists()
    assert result["judgement"]["accepted"] and [r["accepted"] for r in result["judgement"]["reasons"]] == [True]
    assert "accepted:" in done.stderr


def test_accept_of_a_rule_that_does_not_exist(tmp_path):
    (tmp_path / "r.json").write_text("null")
    done, _ = fit(tmp_path, None, "--accept", "outlier")
    assert done.returncode == 2 and "outliers" in done.stderr
