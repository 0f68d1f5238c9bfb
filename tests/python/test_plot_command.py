# SPDX-License-Identifier: MIT
"""`imucal plot`: the results of the programs, each as the picture that belongs to it."""
import json
import subprocess

import numpy as np
import pytest

from imucal.__main__ import main
from imucal.log import read_log
from imucal.plot import results
from reference import NOISE
from where import BIN

RAMP = {"imucal_profile": 1, "start_degc": 0, "segments": [
    {"rate_degc_per_min": 2, "to_degc": 60}, {"rate_degc_per_min": 0, "duration_s": 600},
    {"rate_degc_per_min": -2, "to_degc": 0}]}
GONE = object()
MODEL = {**NOISE, "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [100, 200, 50, -30]}}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("plot")
    (path / "model.json").write_text(json.dumps(MODEL))
    (path / "ramp.json").write_text(json.dumps(RAMP))
    for words in (["gyrosim", "log", "--model", "model.json", "--profile", "ramp.json", "--axes", "2", "-o", "log.csv", "-q"],
                  ["calibrate", "fit", "log.csv", "--method", "poly", "--order", "3", "-o", "table.json", "--json", "fit.json"],
                  ["dp", "log.csv", "--type", "av", "--json", "dp.json", "-q"],
                  ["errormodel", "expect", "model.json", "--type", "av", "--tau", "octave:1:1000", "--json", "expect.json", "-q"],
                  ["errormodel", "fit", "log.csv", "--axis", "gx_dph", "--markov", "1", "--criterion", "ml", "-o", "m.json",
                   "--json", "errormodel.json"],
                  ["profile", "error", "ramp.json", "--model", "model.json", "--order", "3", "--json", "profile.json", "-q"]):
        subprocess.run([BIN / words[0], *words[1:]], cwd=path, check=True, capture_output=True)
    return path


def shown(ax, label):
    return next(line for line in ax.get_lines() if line.get_label() == label)


@pytest.mark.parametrize("name", ["table", "fit"])
def test_a_table_shows_the_rates_its_polynomial_and_what_is_left(folder, name):
    data, log = json.loads((folder / f"{name}.json").read_text()), read_log(folder / "log.csv")
    figure = results.table_figure(data, [log])
    above, _, below, _ = figure.axes
    curve, axis = shown(above, "polynomial"), data["axes"][0]
    tn = (np.asarray(curve.get_xdata()) - axis["t0_degc"]) / axis["range_degc"]
    np.testing.assert_allclose(curve.get_ydata(), np.polyval(axis["coeff_dph"][::-1], tn))
    dots = [line for line in above.get_lines() if line.get_linestyle() == "None"]
    minutes = sum(len(line.get_xdata()) for line in dots)
    assert len(log.t_s) / 60 - 1 <= minutes <= len(log.t_s) / 60 + 1 and {line.get_marker() for line in dots} >= {"^", "o"}
    left = np.concatenate([line.get_ydata() for line in below.get_lines() if line.get_linestyle() == "None"])
    assert abs(left.mean()) < 5 and left.std() < 30
    assert len(results.table_figure(data).axes) == 4, "without a log too"


def test_curves_models_and_profiles_show_the_numbers_of_the_programs(folder):
    def figure_of(name):
        data = json.loads((folder / f"{name}.json").read_text())
        return data, results.result_figure(data, name)
    data, figure = figure_of("dp")
    for line, curve in zip(figure.axes[0].get_lines(), data["curves"]):
        np.testing.assert_array_equal(line.get_ydata(), curve["dp_dph"])
        assert curve["axis"] in line.get_label()
    data, figure = figure_of("expect")
    np.testing.assert_array_equal(shown(figure.axes[0], "model").get_ydata(), data["dp_dph"])
    data, figure = figure_of("errormodel")
    np.testing.assert_array_equal(shown(figure.axes[0], "data").get_ydata(), data["data_dp_dph"])
    np.testing.assert_allclose(figure.axes[1].get_lines()[0].get_ydata(), np.divide(data["model_dp_dph"], data["data_dp_dph"]))
    data, figure = figure_of("profile")
    np.testing.assert_array_equal(shown(figure.axes[0], "this profile").get_ydata(), data["sigma_dph"])
    _, figure = (data, results.result_figure({**data, "profile": RAMP}, "optimized"))
    assert figure.axes[0].get_lines()[0].get_ydata()[1] == 60


def test_a_table_of_an_accelerometer_is_drawn_in_its_unit(folder):
    text = (folder / "table.json").read_text()
    figure, gyro = (results.result_figure(json.loads(t), "table") for t in (text.replace("dph", "mg"), text))
    for ax, same in zip(figure.axes, gyro.axes):
        assert ax.get_ylabel() == same.get_ylabel().replace("dph", "mg") and ax.get_ylabel().endswith(", mg")
        for line, other in zip(ax.get_lines(), same.get_lines(), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), other.get_ydata())


@pytest.mark.parametrize("name, head", [("t.png", b"\x89PNG"), ("t.svg", b"<?xml"), ("t.pdf", b"%PDF")])
def test_the_command_writes_a_picture(folder, name, head, capsys):
    assert main(["plot", str(folder / "table.json"), "--log", str(folder / "log.csv"), "-o", str(folder / name)]) == 0
    assert (folder / name).read_bytes().startswith(head) and name in capsys.readouterr().out


@pytest.mark.parametrize("text, words", [("{}", "there is no figure of this"), ("[1]", "no result of a program"),
                                         ('{"axes": [{"axis": "gx_dph", "verdict": "no_gap"}]}', "imucal report")])
def test_what_has_no_figure_is_refused_with_what_has_one(folder, text, words, capsys):
    (folder / "other.json").write_text(text)
    assert main(["plot", str(folder / "other.json"), "-o", str(folder / "no.png")]) == 3
    said = capsys.readouterr().err
    assert "other.json" in said and words in said and not (folder / "no.png").exists()
    assert main(["plot", str(folder / "table.json"), "-o", str(folder / "no.jpeg")]) == 2


@pytest.mark.parametrize("name, way, value, words", [
    ("table", "axes", 5, "there is no figure of this"),
    ("table", "axes.0.axis", None, "axes[0].axis: expected a text, found null"),
    ("table", "axes.0.t0_degc", "30", 'axes[0].t0_degc: expected a number, found "30"'),
    ("fit", "axes.1", [], "axes[1]: expected an object"),
    ("fit", "axes.0.range_degc", GONE, "axes[0].range_degc: expected a number, found nothing"),
    ("fit", "axes.0.coeff_dph", [], "axes[0].coeff_dph: expected a list of numbers"),
    ("fit", "axes.0.sigma_dph", [1, 2], "axes[0].sigma_dph: expected 9 numbers, found [1, 2]"),
    ("dp", "curves.1", None, "curves[1]: expected an object, found null"),
    ("dp", "curves.0.log", GONE, "curves[0].log: expected a text"),
    ("dp", "curves.0.type", "adev", "curves[0].type: expected one of av, dp1, dp2, dp3"),
    ("dp", "curves.0.dp_dph.0", {}, "curves[0].dp_dph: expected a list of numbers"),
    ("dp", "curves.0.ci95_dph.0", 5, "curves[0].ci95_dph"),
    ("expect", "type", [], "type: expected one of"), ("expect", "tau_s", [1.0], "dp_dph: expected 1 numbers"),
    ("errormodel", "model_dp_dph", GONE, "model_dp_dph: expected a list of numbers, found nothing"),
    ("errormodel", "data_dp_dph.0", True, "data_dp_dph: expected a list of numbers"),
    ("profile", "temp_degc", None, "temp_degc: expected a list of numbers"),
    ("profile", "worst_dph", "x", "worst_dph: expected a number"),
    ("profile", "profile", {**RAMP, "segments": [{}]}, "profile.segments[0].rate_degc_per_min: expected a number"),
    ("profile", "profile", {**RAMP, "repeat": 1.5}, "profile.repeat: expected a whole number")])
def test_a_damaged_result_is_refused_by_its_field(folder, name, way, value, words, capsys):
    data = place = json.loads((folder / f"{name}.json").read_text())
    *before, last = [int(key) if key.isdigit() else key for key in way.split(".")]
    for key in before:
        place = place[key]
    place[last] = value
    if value is GONE:
        del place[last]
    (folder / "damaged.json").write_text(json.dumps(data))
    assert main(["plot", str(folder / "damaged.json"), "-o", str(folder / "no.png")]) == 3
    assert f"damaged.json: {words}" in capsys.readouterr().err and not (folder / "no.png").exists()


def test_a_table_without_its_temperatures_is_drawn_over_its_span(folder):
    table = json.loads((folder / "table.json").read_text())
    figure = results.result_figure(table, "table")
    for axis in table["axes"]:
        del axis["temp_degc"]
    for ax, same in zip(results.result_figure(table, "table").axes, figure.axes, strict=True):
        for line, other in zip(ax.get_lines(), same.get_lines(), strict=True):
            np.testing.assert_allclose(line.get_xdata(), other.get_xdata())
