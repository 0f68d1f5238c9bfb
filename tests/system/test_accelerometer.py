# SPDX-License-Identifier: MIT
"""An accelerometer, from log to table to compensation and diagnosis: in mg throughout, gravity stated, m/s2 the same as mg."""
import json
import subprocess

import numpy as np
import pytest

from reference import BASIC
from reference import MODEL as GYRO
from where import BIN

BIAS_MG = [1000, 4, 2, -1]  # b0 holds 1 g
MODEL = {"imucal_model": 1, "unit": "mg", "white_mg_rt_hz": 0.15, "markov": [{"sigma_mg": 0.08, "tau_s": 200}],
         "bias": {"t0_degc": 30, "range_degc": 30, "coeff_mg": BIAS_MG}}
MG_PER_MS2 = 1000 / 9.80665


def run(folder, *words, status=0):
    done = subprocess.run([BIN / words[0], *map(str, words[1:])], cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == status, done.stdout + done.stderr
    return done.stdout + done.stderr


def answer(folder, *words, status=0):
    """Text and JSON."""
    text = run(folder, *words, "--json", "out.json", status=status)
    return text, json.loads((folder / "out.json").read_text())


def rewritten(source, target, columns):
    """The log with its columns after the temperature renamed and scaled: {old: (new, factor)}; others are left out."""
    lines = source.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("t_s,"))
    names = lines[at].split(",")
    rows = np.loadtxt(lines[at + 1:], delimiter=",")
    out = [*lines[:at], ",".join(["t_s", "temp_degc", *(new for new, _ in columns.values())])]
    for row in rows:
        values = [repr(float(row[names.index(old)] * factor)) for old, (_, factor) in columns.items()]
        out.append(",".join([repr(float(row[0])), repr(float(row[1])), *values]))
    target.write_text("\n".join(out) + "\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("accel")
    for name, content in (("accel.json", MODEL), ("gyro.json", GYRO), ("chamber.json", BASIC)):
        (path / name).write_text(json.dumps(content))
    run(path, "gyrosim", "log", "--model", "accel.json", "--profile", "chamber.json", "--axes", 3, "--seed", 3, "-o", "mg.csv")
    run(path, "gyrosim", "log", "--model", "gyro.json", "--model", "accel.json", "--profile", "chamber.json", "--seed", 4, "-o", "both.csv")
    rewritten(path / "mg.csv", path / "ms2.csv", {f"a{a}_mg": (f"a{a}_ms2", 1 / MG_PER_MS2) for a in "xyz"})
    return path


def no_gyro_words(text):
    return not any(word in text for word in ("dph", "deg/sqrt", "deg_rt", "gyro"))


def test_simulated_accelerometer_has_its_own_names_and_unit(folder):
    header = next(line for line in (folder / "mg.csv").read_text().splitlines() if line.startswith("t_s,"))
    assert header == "t_s,temp_degc,ax_mg,ay_mg,az_mg"
    header = next(line for line in (folder / "both.csv").read_text().splitlines() if line.startswith("t_s,"))
    assert header == "t_s,temp_degc,gx_dph,ax_mg"


@pytest.mark.parametrize("log", ["mg.csv", "ms2.csv"])
@pytest.mark.parametrize("method", ["kf", "poly"])
def test_calibrate_fit_learns_in_mg_and_states_gravity(folder, log, method):
    text, result = answer(folder, "calibrate", "fit", log, "--method", method, "--model", "accel.json", "--serial", "A1", "-o", "table.json")
    assert no_gyro_words(text) and "b0 holds gravity along the axis, as it lay" in text
    table = json.loads((folder / "table.json").read_text())
    for axis, channel in zip(result["axes"], table["axes"]):
        assert axis["unit"] == "mg" and "gravity" in axis["b0_holds"] and channel["axis"] == axis["axis"]
        tn = (np.array(axis["temp_degc"]) - 30) / 30
        error = np.polynomial.polynomial.polyval(tn, channel["coeff_mg"]) - np.polynomial.polynomial.polyval(tn, BIAS_MG)
        assert np.abs(error / channel["sigma_mg"]).max() < 4 and max(channel["sigma_mg"]) < 0.1


def test_log_in_metres_per_second_squared_ends_as_the_one_in_mg(folder):
    from imucal import compensate, read_log, read_table
    clean = {}
    for name in ("mg", "ms2"):
        run(folder, "calibrate", "fit", f"{name}.csv", "--model", "accel.json", "--serial", "A1", "-o", f"table_{name}.json")
        table, log = read_table(folder / f"table_{name}.json"), read_log(folder / f"{name}.csv")
        assert log.axes == ["ax_mg", "ay_mg", "az_mg"] and [c.unit for c in table.channels] == ["mg"] * 3
        clean[name] = [compensate(log.rates[c.axis], log.temp_degc, c) for c in table.channels]
    for in_mg, in_ms2 in zip(clean["mg"], clean["ms2"]):
        assert np.abs(in_mg - in_ms2).max() < 2e-4  # float32 of 1000 mg is 6e-5
        assert np.sqrt(np.mean(in_mg ** 2)) == pytest.approx(np.hypot(0.15, 0.08), rel=0.1)


def test_two_models_make_one_table_of_gyros_and_accelerometers(folder):
    _, result = answer(folder, "calibrate", "fit", "both.csv", "--model", "accel.json", "--model", "gyro.json", "--serial", "A1", "-o", "six.json")
    assert [(a["axis"], a["unit"]) for a in result["axes"]] == [("gx_dph", "dph"), ("ax_mg", "mg")]
    gyro, accel = json.loads((folder / "six.json").read_text())["axes"]
    assert gyro["model"]["markov"] == [{"sigma_dph": 20, "tau_s": 100}] and accel["model"]["markov"] == [{"sigma_mg": 0.08, "tau_s": 200}]
    assert "two models of one kind" in run(folder, "calibrate", "fit", "both.csv", "--model", "gyro.json", "--model", "gyro.json", status=2)


def test_model_of_the_other_sensor_is_refused(folder):
    text = run(folder, "calibrate", "fit", "both.csv", "--model", "accel.json", "--axis", "gx_dph", status=3)
    assert "the model is an accelerometer's" in text and "axis gx_dph" in text and "--axis" in text
    assert "accelerometer's" in run(folder, "errormodel", "check", "both.csv", "--axis", "gx_dph", "--model", "accel.json", status=3)
    assert "accelerometer's" in run(folder, "diagnose", "--model", "accel.json", "--axis", "gx_dph", "--log", "both.csv", status=3)
    assert "accelerometer's" in run(folder, "dp", "both.csv", "--axis", "gx_dph", "--nominal", "accel.json", status=3)


def test_model_that_does_not_say_its_unit_is_taken_and_told(folder):
    silent = {**MODEL, "arw_deg_rt_h": 0.15 / 60, "markov": [{"sigma_dph": 0.08, "tau_s": 200}], "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": BIAS_MG}}
    del silent["unit"], silent["white_mg_rt_hz"]
    (folder / "silent.json").write_text(json.dumps(silent))
    text, result = answer(folder, "calibrate", "fit", "mg.csv", "--axis", "az_mg", "--model", "silent.json")
    assert "does not state its unit" in text and '"unit": "mg"' in text
    _, stated = answer(folder, "calibrate", "fit", "mg.csv", "--axis", "az_mg", "--model", "accel.json")
    assert result["axes"][0]["coeff_dph"] == stated["axes"][0]["coeff_dph"]
    for status, *words in ((0, "dp", "mg.csv", "--nominal", "silent.json", "--type", "dp2"), (1, "errormodel", "check", "mg.csv", "--model", "silent.json")):
        text, _ = answer(folder, *words, "--axis", "az_mg", status=status)
        assert text.count("silent.json: the model does not state its unit") == 1, text


@pytest.mark.parametrize("log", ["mg.csv", "ms2.csv"])
def test_dp_and_errormodel_speak_of_mg(folder, log):
    axis = "az_" + log[:-4]
    text, result = answer(folder, "dp", log, "--axis", axis, "--detrend", "poly:3")
    assert no_gyro_words(text) and "dp_mg" in text and result["curves"][0]["unit"] == "mg"
    assert result["curves"][0]["dp_dph"][0] == pytest.approx(np.hypot(0.15, 0.01), rel=0.05)
    text, result = answer(folder, "errormodel", "fit", log, "--axis", axis, "--markov", 1, "--criterion", "ml", "--detrend", "poly:3", "-o", "found.json")
    assert no_gyro_words(text.replace("its arw_deg_rt_h is", "")) and "mg/sqrt(Hz)" in text and result["unit"] == "mg"
    found = json.loads((folder / "found.json").read_text())
    assert found["unit"] == "mg" and 60 * found["arw_deg_rt_h"] == pytest.approx(0.15, rel=0.05)
    text, result = answer(folder, "errormodel", "check", log, "--axis", axis, "--model", "found.json", "--detrend", "poly:3", status=1)
    assert no_gyro_words(text) and result["unit"] == "mg"
    run(folder, "calibrate", "fit", log, "--axis", axis, "--model", "found.json")  # what was identified calibrates


def test_default_axes_of_one_model_are_of_one_kind(folder):
    _, result = answer(folder, "errormodel", "fit", "both.csv", "--markov", 1, "--criterion", "ml")
    assert result["unit"] == "dph" and result["n_records"] == 1
    text = run(folder, "errormodel", "fit", "both.csv", "--axis", "gx_dph", "--axis", "ax_mg", "--markov", 1, status=3)
    assert "axis gx_dph is in dph, axis ax_mg in mg" in text
    _, result = answer(folder, "dp", "both.csv")
    assert result["across"] is None and [c["unit"] for c in result["curves"]] == ["dph", "mg"]


def test_profile_and_expected_curve_speak_of_mg(folder):
    text, result = answer(folder, "profile", "error", "chamber.json", "--model", "accel.json", "--order", 3)
    assert no_gyro_words(text) and result["unit"] == "mg" and 0.01 < result["worst_dph"] < 0.1
    text, result = answer(folder, "profile", "bound", "--model", "accel.json", "--order", 3, "--duration-s", 8400)
    assert no_gyro_words(text) and result["unit"] == "mg"
    text, result = answer(folder, "errormodel", "expect", "accel.json", "--tau", "2:20")
    assert no_gyro_words(text) and result["unit"] == "mg"


def test_diagnose_finds_in_mg_what_it_finds_in_dph(folder):
    effects = [{"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 0.4, "width_degc": 8}}]
    (folder / "effects.json").write_text(json.dumps(effects))
    cycle = {**BASIC, "segments": [{"rate_degc_per_min": 1, "to_degc": 60}, {"rate_degc_per_min": -1, "to_degc": 0}], "repeat": 2}
    (folder / "cycle.json").write_text(json.dumps(cycle))
    run(folder, "gyrosim", "log", "--model", "accel.json", "--profile", "cycle.json", "--effects", "effects.json", "--seed", 5, "-o", "loop.csv")
    rewritten(folder / "loop.csv", folder / "loop_rate.csv", {"ax_mg": ("gx_dph", 240.0)})
    rate = {**GYRO, "arw_deg_rt_h": 0.15 * 240 / 60, "markov": [{"sigma_dph": 0.08 * 240, "tau_s": 200}],
            "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [240 * b for b in BIAS_MG]}}
    (folder / "rate.json").write_text(json.dumps(rate))
    text, result = answer(folder, "diagnose", "--model", "accel.json", "--log", "loop.csv", "--no-cache", "--nulls", 50)
    _, same = answer(folder, "diagnose", "--model", "rate.json", "--log", "loop_rate.csv", "--no-cache", "--nulls", 50)
    axis, twin = result["axes"][0], same["axes"][0]
    assert no_gyro_words(text) and axis["axis"] == "ax_mg" and axis["unit"] == "mg" and axis["gap"]["unit"].startswith("mg^2")
    assert axis["effects"][0]["family"] == "thermal_memory" and twin["unit"] == "dph"
    assert (axis["verdict"], axis["effects"][0]["name"]) == (twin["verdict"], twin["effects"][0]["name"])
    assert axis["effects"][0]["evidence_nats"] == pytest.approx(twin["effects"][0]["evidence_nats"], rel=0.02)
    assert 240 * axis["gap"]["residual_rms_dph"]["before"] == pytest.approx(twin["gap"]["residual_rms_dph"]["before"], rel=0.02)


def test_names_in_mg_need_the_unit_and_one_of_two_names(folder):
    from imucal.check import check_file
    for change, words in (({"unit": "g"}, '"dph" (a gyro) or "mg"'), ({"unit": None}, "arw_deg_rt_h"),
                          ({"arw_deg_rt_h": 1}, "give one of the two")):
        bad = {key: value for key, value in {**MODEL, **change}.items() if value is not None}
        (folder / "bad.json").write_text(json.dumps(bad, indent=1))
        assert words in run(folder, "errormodel", "expect", "bad.json", status=3)
    kind, messages = check_file(folder / "accel.json")
    assert kind == "model" and not messages
    (folder / "bad.json").write_text(json.dumps({k: v for k, v in MODEL.items() if k != "unit"}, indent=1))
    assert check_file(folder / "bad.json")[1]
