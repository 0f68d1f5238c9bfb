# SPDX-License-Identifier: MIT
"""What the package's functions take and tell beside their results: the programs' own choices, their notes, one thing by itself."""
import json
import os
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest

import imucal
from reference import BASIC, MODEL
from where import BIN

os.environ.setdefault("IMUCAL_BIN", str(BIN))
SENSOR = {**MODEL, "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 300, 150, -100]}}
SHORT = {"imucal_profile": 1, "start_degc": 10, "segments": [{"rate_degc_per_min": 4, "to_degc": 50}, {"rate_degc_per_min": -4, "to_degc": 10}]}


@pytest.fixture(scope="module")
def thermal():
    """A log whose rate follows the temperature."""
    return imucal.simulate(SENSOR, BASIC, seed=7)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Paths of three short runs of a device with two gyros."""
    folder = tmp_path_factory.mktemp("runs")
    for i in range(3):
        imucal.write_log(folder / f"run{i}.csv", imucal.simulate(SENSOR, SHORT, n_axes=2, seed=3, log_index=i, n_logs=3))
    return [str(folder / f"run{i}.csv") for i in range(3)]


def diagnosis(logs, *args, **options):
    """Of one kind of gap: it is not the search that is tested."""
    return imucal.diagnose(logs, *args, **{"only": ["thermal_hysteresis"], "threads": 1, **options})


def test_a_fit_takes_the_trend_out_as_the_program_does_and_says_so(thermal):
    with pytest.warns(imucal.DataWarning, match=r"^note: array|^note: .*the rate follows the temperature.*a cubic is taken out") as told:
        fit = imucal.fit_error_model(thermal)
    assert fit.model["markov"][0]["sigma_dph"] < 40 and fit.details["detrend"] == "poly:3"
    assert told[0].filename == __file__ and "/tmp/" not in str(told[0].message).replace(thermal.path, "")
    with pytest.warns(imucal.DataWarning, match="with --detrend mean that counts as noise"):
        assert imucal.fit_error_model(thermal, detrend="mean").model["markov"][0]["sigma_dph"] > 80


def test_a_check_takes_the_trend_out_as_the_program_does(thermal):
    with pytest.warns(imucal.DataWarning, match="a cubic is taken out"):
        assert imucal.check_bound(thermal, {**MODEL, "arw_deg_rt_h": 0.9, "markov": [{"sigma_dph": 40, "tau_s": 100}]}, tau_s="2:400:20").bounded


def test_nothing_is_told_where_there_is_nothing_to_tell(thermal):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        imucal.fit_error_model(thermal, detrend="poly:3")
        imucal.calibrate(thermal, model=MODEL)


def test_the_number_of_markov_terms_can_be_left_to_the_program(thermal):
    chosen = imucal.fit_error_model(thermal, markov=None, detrend="poly:3")
    assert len(chosen.details["by_terms"]) > 2 and len(chosen.model["markov"]) == 1


def test_what_is_accepted_is_told():
    rate = np.random.default_rng(6).normal(0, 36, 4000)
    rate[2000] = 1e5
    with pytest.warns(imucal.DataWarning, match="^accepted: array: axis gx_dph: outliers"):
        imucal.fit_error_model(rate, accept="outliers")


def test_errors_name_what_was_given_and_no_file_of_the_package():
    with pytest.raises(imucal.DataError, match="^model: arw_deg_rt_h"):
        imucal.expect({"imucal_model": 1, "arw_deg_rt_h": "loud"}, [1, 2])
    with pytest.raises(imucal.DataError, match="^array: "):
        imucal.calibrate(np.random.default_rng(1).normal(0, 36, 3000))


def test_one_name_by_itself_is_no_list_of_letters(runs):
    assert imucal.fit_error_model(runs, axes="gy_dph", detrend="poly:3").model == imucal.fit_error_model(runs, axes=["gy_dph"], detrend="poly:3").model
    assert list(imucal.calibrate(runs, axes="gy_dph", model=MODEL).axes) == ["gy_dph"]
    assert imucal.check_bound(runs, MODEL, axes="gx_dph", detrend="poly:3", tau_s=[2, 20]).details["unit"] == "dph"


def test_diagnose_needs_no_model(runs):
    found = diagnosis(runs, axes="gx_dph")
    assert found["model"] is None and len(found["axes"]) == 1 and found["axes"][0]["verdict"] in ("no_gap", "explained", "partly_explained", "unexplained")


def test_diagnose_takes_a_data_sheet_in_the_place_of_a_model(runs):
    sheet = diagnosis(runs, axes="gx_dph", arw=0.6, instability=(20, 100))
    text = diagnosis(runs, axes="gx_dph", arw=0.6, instability="20:100")
    model = diagnosis(runs, {**MODEL, "turn_on_sigma_dph": 0}, axes="gx_dph")
    of_sheet, of_text, of_model = (result["axes"][0] for result in (sheet, text, model))
    assert of_sheet["noise"] == of_text["noise"] and of_sheet["verdict"] == of_model["verdict"]
    assert sheet["model"] is None and model["model"] == "model"
    with pytest.raises(imucal.UsageError, match="data sheet"):
        diagnosis(runs, MODEL, arw=0.6)


@pytest.mark.parametrize("as_given", [str, Path, imucal.read_log, lambda path: [path]])
def test_one_held_out_log_by_itself(runs, as_given):
    found = diagnosis(runs[:2], MODEL, holdout=as_given(runs[2]), axes="gx_dph", only="thermal_hysteresis")
    assert len(found["held_out_logs"]) == 1 and len(found["logs"]) == 2


def test_an_axis_that_cannot_be_judged_is_told(runs):
    logs = [imucal.read_log(path) for path in runs]
    for log in logs:
        log.rates["gy_dph"][:] = 7.0
    with pytest.warns(imucal.DataWarning, match="gy_dph"):
        found = diagnosis(logs)
    assert [("refused" in axis) for axis in found["axes"]] == [False, True] and found["logs"] == runs


def test_a_curve_without_a_nominal_model_is_the_allan_deviation():
    rate = np.random.default_rng(1).normal(0, 36, 3000)
    assert imucal.direct_predictor(rate, tau_s=[1, 10]).dp_dph.tolist() == imucal.allan_deviation(rate, tau_s=[1, 10]).adev_dph.tolist()
    predicted = imucal.direct_predictor(rate, tau_s=[1, 10], nominal=MODEL)
    assert predicted.dp_dph.tolist() == imucal.direct_predictor(rate, tau_s=[1, 10], type="dp2", nominal=MODEL).dp_dph.tolist()
    with pytest.raises(imucal.DataError, match="needs nominal, the model"):
        imucal.direct_predictor(rate, type="dp2")


def test_calibration_error_judges_the_span_asked_for_and_takes_several_runs(runs):
    whole, inner = imucal.calibration_error(BASIC, MODEL), imucal.calibration_error(BASIC, MODEL, range_degc=(10, 50))
    assert (inner.temp_degc[0], inner.temp_degc[-1]) == (10, 50) and inner.worst_dph < whole.worst_dph
    twice = imucal.calibration_error([BASIC, BASIC], MODEL)
    assert twice.worst_dph == pytest.approx(whole.worst_dph / np.sqrt(2), rel=0.02)
    assert imucal.calibration_error(runs, MODEL, order=2).worst_dph > 0


def test_calibrate_takes_the_scale_the_limit_and_logs_without_a_restart(runs):
    found = imucal.calibrate(runs, model=MODEL, axes="gx_dph", range_degc=(5, 45), serial="A7")
    axis = found.axes["gx_dph"]
    assert (axis.t0_degc, axis.range_degc, found.table["serial"]) == (25, 20, "A7")
    shared = imucal.calibrate(runs, model={**MODEL, "turn_on_sigma_dph": 50}, axes="gx_dph", shared_turn_on=True)
    assert "turn_on_dph" not in shared.details["axes"][0]
    with pytest.raises(imucal.DataError, match="gx_dph: error: "):
        imucal.calibrate(runs, model=MODEL, axes="gx_dph", max_error_dph=1e-3)


def test_one_gyro_of_each_model_is_simulated():
    loud = {**MODEL, "arw_deg_rt_h": 6}
    log = imucal.simulate([MODEL, loud], SHORT)
    spread = [np.std(np.diff(rate)) for rate in log.rates.values()]
    assert log.axes == ["gx_dph", "gy_dph"] and spread[1] > 5 * spread[0]


def test_defaults_are_those_of_the_programs(thermal, tmp_path):
    """A function without options gives what its command line gives without options."""
    imucal.write_log(tmp_path / "log.csv", thermal)
    with pytest.warns(imucal.DataWarning):
        fit = imucal.fit_error_model(str(tmp_path / "log.csv"), criterion="bound", markov=None)
    done = subprocess.run([BIN / "errormodel", "fit", tmp_path / "log.csv", "--json", "-"], capture_output=True, text=True, check=True)
    assert fit.model == json.loads(done.stdout)["model"]


def test_the_curve_of_a_model_has_the_program_s_taus():
    curve = imucal.expect(MODEL, type="av")
    assert (curve.tau_s[0], curve.tau_s[-1]) == (2, 600)


def test_the_shortest_profile_that_reaches_an_error():
    found = imucal.optimize_profile(MODEL, (0, 60), 2, required_error_dph=9)
    assert 8 < found.worst_dph <= 9.01 and found.duration_s < 7000
    for wrong in ({}, {"duration_s": 8000, "required_error_dph": 9}):
        with pytest.raises(imucal.UsageError, match="either --duration-s or --required-error"):
            imucal.optimize_profile(MODEL, (0, 60), 2, **wrong)


def test_two_columns_of_one_axis_are_told(tmp_path):
    (tmp_path / "log.csv").write_text("t_s,temp_degc,gx_dps,gx_dph\n1,20,1,2\n2,20,1,2\n")
    with pytest.raises(imucal.DataError, match='two columns are the axis gx_dph, "gx_dph" is the second'):
        imucal.read_log(tmp_path / "log.csv")
