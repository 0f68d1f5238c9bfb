# SPDX-License-Identifier: MIT
"""The package's names against known answers and against the programs."""
import inspect
import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import imucal
from imucal.analysis import AxisCalibration
from reference import BASIC, MODEL
from where import BIN, ROOT

os.environ.setdefault("IMUCAL_BIN", str(BIN))


@pytest.fixture(scope="module")
def log():
    return imucal.simulate(MODEL, BASIC, n_axes=1, seed=7)


def test_allan_deviation_is_its_definition():
    rate = np.random.default_rng(1).normal(5, 36, 3000)
    a = imucal.allan_deviation(rate, tau_s=[1, 10, 100])
    for tau, adev in zip((1, 10, 100), a.adev_dph):
        mean = np.convolve(rate, np.ones(tau) / tau, "valid")
        assert adev == pytest.approx(np.sqrt(0.5 * np.mean((mean[tau:] - mean[:-tau]) ** 2)), rel=1e-12)
    assert np.all((a.ci95_dph[:, 0] < a.adev_dph) & (a.adev_dph < a.ci95_dph[:, 1]))
    assert a.n_windows.tolist() == [2999, 2981, 2801]


def test_allan_deviation_equals_the_program_s(log, tmp_path):
    imucal.write_log(tmp_path / "log.csv", log)
    subprocess.run([str(BIN / "dp"), str(tmp_path / "log.csv"), "--type", "av", "--tau", "2,20,200", "--json", str(tmp_path / "j"), "-q"], check=True)
    curve = json.loads((tmp_path / "j").read_text())["curves"][0]
    a = imucal.allan_deviation(imucal.read_log(tmp_path / "log.csv").rates["gx_dph"], tau_s=[2, 20, 200])
    np.testing.assert_allclose(a.adev_dph, curve["dp_dph"], rtol=1e-12)
    np.testing.assert_allclose(a.ci95_dph, curve["ci95_dph"], rtol=1e-9)


def number_printed_by(code):
    """The number that a Python process of its own prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return float(done.stdout)


@pytest.mark.parametrize("missing", [False, True])
def test_the_array_is_not_copied(missing):
    """Over the array there are the running sums, as large as it, and where samples are missing their count, half as large."""
    code = ("import numpy, resource, imucal\n"
            "def peak():\n    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
            "rate = numpy.random.default_rng(1).normal(50, 36, 8_000_000)\n"
            f"rate[1000:2000] = numpy.nan if {missing} else 1\n"
            "imucal.allan_deviation(rate[:3000], tau_s=[1, 10])\nbefore = peak()\n"
            "imucal.allan_deviation(rate, tau_s=[1, 10, 100])\nprint((peak() - before) / rate.nbytes)\n")
    assert number_printed_by(code) < (1.6 if missing else 1.1)


def test_without_intervals_the_curve_is_the_same():
    rate = np.random.default_rng(3).normal(0, 36, 3000)
    a, b = imucal.allan_deviation(rate), imucal.allan_deviation(rate, intervals=False)
    assert np.allclose(a.adev_dph, b.adev_dph, rtol=1e-13, atol=0) and np.isnan(b.ci95_dph).all() and a.ci95_dph.shape == b.ci95_dph.shape and np.isfinite(a.ci95_dph).all()


def test_a_trend_in_time_is_taken_from_a_copy():
    rate = np.random.default_rng(2).normal(0, 36, 5000) + 0.1 * np.arange(5000)
    kept = rate.copy()
    a = imucal.direct_predictor(rate, type="av", tau_s=[500], detrend="time:1")
    assert np.array_equal(rate, kept) and a.dp_dph[0] < 10 < imucal.allan_deviation(rate, tau_s=[500]).adev_dph[0]


def test_missing_samples_leave_their_windows_out():
    rate = np.random.default_rng(2).normal(0, 36, 2000)
    rate[500:700] = np.nan
    a = imucal.allan_deviation(rate, tau_s=[1, 50])
    assert a.n_windows[0] == 1999 - 201 and a.adev_dph[0] == pytest.approx(36, rel=0.05)


@pytest.mark.parametrize("call, words", [
    (lambda: imucal.allan_deviation(np.zeros((3, 2))), "shape (n,)"), (lambda: imucal.allan_deviation(np.zeros(100)), "constant"),
    (lambda: imucal.allan_deviation(np.random.rand(50), tau_s=[100]), "beyond"), (lambda: imucal.direct_predictor(np.random.rand(50), type="dp9"), "dp9"),
    (lambda: imucal.ThermalCalibrator(order=9), "order"), (lambda: imucal.ThermalCalibrator(tau_s=0), "tau_s"),
    (lambda: imucal.expect({"imucal_model": 1, "arw_deg_rt_h": 0}, [1, 2]), "no Markov term"), (lambda: imucal.read_log("no such file"), "cannot open")])
def test_wrong_arguments_are_errors_with_their_reason(call, words):
    with pytest.raises(imucal.ImucalError, match=words.replace("(", r"\(").replace(")", r"\)")):
        call()


def noise(n=1000):
    return np.random.default_rng(1).normal(0, 36, n)


def with_value(value, at=17):
    rate = noise()
    rate[at] = value
    return rate


NAN = float("nan")


@pytest.mark.parametrize("call, words", [
    (lambda: imucal.allan_deviation(with_value(np.inf)), r"rate_dph\[17\] is inf.*NaN"), (lambda: imucal.allan_deviation(with_value(-np.inf)), r"rate_dph\[17\] is -inf"),
    (lambda: imucal.direct_predictor(with_value(np.inf), type="av", estimator="max"), r"rate_dph\[17\] is inf"),
    (lambda: imucal.as_log(noise(), temp_degc=with_value(np.inf)), r"temp_degc\[17\] is inf"),
    (lambda: imucal.allan_deviation(noise(), dt_s=-1), "dt_s: -1"), (lambda: imucal.allan_deviation(noise(), dt_s=0), "dt_s: 0"),
    (lambda: imucal.allan_deviation(noise(), dt_s=NAN), "dt_s: nan"), (lambda: imucal.allan_deviation(noise(), dt_s=np.inf), "dt_s: inf"),
    (lambda: imucal.as_log(noise(), dt_s=0), "dt_s: 0"), (lambda: imucal.allan_deviation([]), "no sample.*two"), (lambda: imucal.allan_deviation([3.0]), "1 sample.*two"),
    (lambda: imucal.allan_deviation(np.full(100, NAN)), "no sample"), (lambda: imucal.allan_deviation(["a", "b"]), "rate_dph: expected numbers"),
    (lambda: imucal.allan_deviation(noise() * 1j), "rate_dph: expected numbers"), (lambda: imucal.direct_predictor(noise(), type="av", min_fill=0), "min_fill: 0"),
    (lambda: imucal.direct_predictor(noise(), type="av", min_fill=NAN), "min_fill: nan"), (lambda: imucal.direct_predictor(noise(), type="av", min_fill=1.5), "min_fill: 1.5"),
    (lambda: imucal.direct_predictor(noise(), nominal={"imucal_model": 1, "arw_deg_rt_h": NAN}), "NaN"),
    (lambda: imucal.expect({"imucal_model": 1, "arw_deg_rt_h": NAN}, [1, 2]), "NaN")])
def test_arrays_and_numbers_that_cannot_be_are_refused(call, words):
    with pytest.raises(imucal.DataError, match=words):
        call()


def test_a_mask_marks_what_is_missing():
    rate = noise(3000)
    rate[1000:1100] = 1e6
    masked = np.ma.masked_greater(rate, 1e5)
    holes = np.where(rate > 1e5, np.nan, rate)
    a, b = imucal.allan_deviation(masked), imucal.allan_deviation(holes)
    assert np.array_equal(a.adev_dph, b.adev_dph) and a.adev_dph[0] < 40
    log = imucal.as_log(masked, temp_degc=np.ma.masked_less(np.linspace(0, 60, 3000), 1))
    assert np.isnan(log.rates["gx_dph"][1000:1100]).all() and np.isnan(log.temp_degc[:10]).all()
    assert np.array_equal(imucal.allan_deviation(np.ma.masked_array(rate[:500].astype(int), mask=False)).adev_dph, imucal.allan_deviation(rate[:500].astype(int)).adev_dph)


def test_direct_predictor_of_simulated_noise_follows_its_expectation():
    rng = np.random.default_rng(3)
    n, phi = 100_000, np.exp(-1 / 100)
    from scipy.signal import lfilter
    slow = lfilter([20 * np.sqrt(1 - phi ** 2)], [1, -phi], rng.standard_normal(n))
    rate = slow + 36 * rng.standard_normal(n)
    found = imucal.direct_predictor(rate, tau_s=[2, 10, 50, 200], type="dp2", nominal=MODEL)
    wanted = imucal.expect(MODEL, [2, 10, 50, 200], type="dp2", nominal=MODEL)
    np.testing.assert_allclose(found.dp_dph, wanted.dp_dph, rtol=0.05)
    assert np.all((found.ci95_dph[:, 0] < wanted.dp_dph) & (wanted.dp_dph < found.ci95_dph[:, 1]))


def test_calibrator_gives_the_bits_of_calibrate_fit(log):
    c = imucal.ThermalCalibrator(order=3, t0_degc=30, range_degc=30, arw_deg_rt_h=0.6, sigma_dph=20, tau_s=100)
    assert c.run(log.rates["gx_dph"], log.temp_degc) == 0 and c.n == 8400
    fit = imucal.calibrate(log, order=3, model=MODEL)
    assert c.coeff_dph.tolist() == [float(np.float32(v)) for v in fit.axes["gx_dph"].coeff_dph]
    assert fit.axes["gx_dph"].sigma_dph.max() == pytest.approx(6.93, abs=0.02)  # design figure of this profile
    assert abs(c.mean_nis - 1) < 4 * np.sqrt(2 / 8400)
    one = imucal.ThermalCalibrator(order=3, t0_degc=30, range_degc=30, arw_deg_rt_h=0.6, sigma_dph=20, tau_s=100)
    for rate, temp in zip(log.rates["gx_dph"], log.temp_degc):
        assert one.update(rate, temp)
    assert one.coeff_dph.tolist() == c.coeff_dph.tolist()


def test_default_prior_is_that_of_the_programs():
    from imucal.native import core
    assert inspect.signature(imucal.ThermalCalibrator).parameters["prior_sigma_dph"].default == core().Filter.usual_prior_sigma


def test_missing_second_is_bridged_and_a_wild_one_refused():
    c = imucal.ThermalCalibrator()
    assert c.run(np.array([1.0, np.nan, 2.0, 1e9]), np.array([20.0, 20.0, np.nan, 20.0])) == 1
    assert (c.n, c.n_missed, c.n_refused) == (1, 2, 1)


def test_compensate_takes_the_polynomial_out(log):
    fit = imucal.calibrate(log, order=3, model=MODEL)
    left = imucal.compensate(log.rates["gx_dph"], log.temp_degc, fit.axes["gx_dph"])
    assert np.std(log.rates["gx_dph"]) > 150 and np.std(left) < 45 and abs(np.mean(left)) < 3


def test_fit_error_model_finds_the_noise_and_check_bound_answers(log):
    fit = imucal.fit_error_model(log, markov=1, criterion="ml", detrend="poly:3")
    assert fit.model["arw_deg_rt_h"] == pytest.approx(0.6, abs=3 * fit.std_errors["arw_deg_rt_h"])
    small = {**MODEL, "arw_deg_rt_h": 0.1, "markov": [{"sigma_dph": 5, "tau_s": 100}]}
    large = {**MODEL, "arw_deg_rt_h": 1.2, "markov": [{"sigma_dph": 60, "tau_s": 100}]}
    answers = [imucal.check_bound(log, m, detrend="poly:3", tau_s="2:400:20") for m in (small, large)]
    assert [a.bounded for a in answers] == [False, True] and answers[0].worst_ratio < 1 < answers[1].worst_ratio


def test_calibration_error_is_the_design_s():
    e = imucal.calibration_error(BASIC, MODEL, order=3)
    assert e.worst_dph == pytest.approx(6.93, abs=0.01) and e.bound_dph == pytest.approx(6.22, abs=0.05)


def test_other_threads_run_while_the_compiled_part_works():
    rate = np.random.default_rng(1).normal(size=8_000_000)  # some 0.3 s: a held lock would let one or two ticks through
    ticks, done = [0], threading.Event()

    def count():
        while not done.is_set():
            ticks[0] += 1
            time.sleep(0.001)
    thread = threading.Thread(target=count)
    thread.start()
    before = ticks[0]
    imucal.allan_deviation(rate, tau_s="log:1:100000:10")
    within = ticks[0] - before
    done.set()
    thread.join()
    assert within > 5


def test_interrupt_ends_a_program_s_work():
    """The call is repeated until the signal comes, so that no machine is too fast for it; nothing goes on behind it.  What it needs is imported before."""
    code = ("import imucal\nimucal.optimize_profile\nprint('go', flush=True)\n"
            f"while True:\n    imucal.optimize_profile({MODEL!r}, (0, 60), 0.6, 86400)\n")
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    process.stdout.readline()
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert "KeyboardInterrupt" in err and "in optimize_profile" in err and process.returncode != 0
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


@pytest.mark.parametrize("wait_s", [0.05, 0.5])
def test_ctrl_c_inside_one_curve(wait_s):
    """KeyboardInterrupt after less than a second of processor time, whatever piece it falls into."""
    code = ("import os, signal, threading, time, numpy, imucal\n"
            "rate = numpy.random.default_rng(1).normal(size=20_000_000); imucal.allan_deviation(rate[:1000])\n"
            "def stop():\n    global at; at = time.process_time(); os.kill(os.getpid(), signal.SIGINT)\n"
            f"threading.Timer({wait_s}, stop).start()\n"
            "try:\n    imucal.allan_deviation(rate, tau_s=range(1, 2000, 5)); print('never')\n"
            "except KeyboardInterrupt:\n    print(time.process_time() - at)\n")
    assert number_printed_by(code) < 1


def test_names_of_the_contract_are_there_and_stated():
    names = ["allan_deviation", "direct_predictor", "expect", "fit_error_model", "check_bound", "ThermalCalibrator", "calibrate", "compensate",
             "calibration_error", "optimize_profile", "simulate", "diagnose", "read_log", "read_table", "import_log"]
    for name in names:
        assert getattr(imucal, name).__doc__ and name in dir(imucal)
    assert callable(imucal.plot.allan_plot)


def test_scripts_read_logs_through_the_package():
    """No script parses logs by itself; the peer that dp is timed against does."""
    for script in (ROOT / "host/scripts").glob("*.py"):
        text = script.read_text(encoding="utf-8").replace("table = np.loadtxt(sys.argv[1], delimiter=\",\", skiprows=2)", "")
        assert not any(words in text for words in ("genfromtxt", "loadtxt", "startswith(\"t_s", "line[0] != \"#\"")), script.name


def test_taus_as_numbers_and_as_text_give_the_same_curve_and_wrong_numbers_are_named():
    rate = np.random.default_rng(4).normal(0, 36, 3000)
    numbers, text = imucal.allan_deviation(rate, tau_s=[8, 2, 2.2, 5]), imucal.allan_deviation(rate, tau_s="2,5,8")
    assert numbers.tau_s.tolist() == text.tau_s.tolist() == [2, 5, 8]
    np.testing.assert_array_equal(numbers.adev_dph, text.adev_dph)
    np.testing.assert_array_equal(numbers.n_windows, text.n_windows)
    for wrong in ([], [-1.0], [np.nan], [0.1, 5], [5000.0]):
        with pytest.raises(imucal.DataError, match="tau"):
            imucal.allan_deviation(rate, tau_s=wrong)


def test_sick_sensors_make_no_model_and_no_table_unless_their_rule_is_accepted():
    rng = np.random.default_rng(6)
    rate, temp = rng.normal(0, 36, 4000), 30 - 30 * np.cos(np.arange(4000) * np.pi / 2000)
    rate[2000] = 1e5
    with pytest.raises(imucal.DataError, match=r"gx_dph: outliers: .*accept=\[rule\] insists"):
        imucal.fit_error_model(rate)
    assert imucal.fit_error_model(rate, accept=["outliers"]).model["arw_deg_rt_h"] > 1
    frozen = np.where(np.arange(4000) < 2000, rng.normal(0, 36, 4000), 7.0)
    log = imucal.Log(np.arange(1.0, 4001), temp, {"gx_dph": frozen})
    with pytest.raises(imucal.DataError, match="gx_dph: repeated"):
        imucal.calibrate(log)
    assert imucal.calibrate(log, accept=["repeated"]).axes["gx_dph"].order == 3


def test_numbers_of_numpy_in_a_model_are_numbers():
    model = {**MODEL, "arw_deg_rt_h": np.float32(0.5), "markov": [{"sigma_dph": np.int64(20), "tau_s": np.array(100.0)}]}
    plain = {**MODEL, "arw_deg_rt_h": 0.5, "markov": [{"sigma_dph": 20, "tau_s": 100.0}]}
    np.testing.assert_array_equal(imucal.expect(model).dp_dph, imucal.expect(plain).dp_dph)
    with pytest.raises(imucal.DataError, match="a dict with a set in it"):
        imucal.expect({**MODEL, "markov": {1}})


@pytest.mark.parametrize("span", [(0,), (0, 30, 60), "0:60", 60, (0, "x"), (0, np.nan)])
def test_a_range_that_is_not_two_temperatures_is_refused(span):
    with pytest.raises(imucal.DataError, match="range_degc: expected the lowest and the highest temperature, found"):
        imucal.calibration_error(BASIC, MODEL, range_degc=span)


def test_arrays_of_different_lengths_are_refused(tmp_path):
    axis = AxisCalibration("gx_dph", 1, 30.0, 30.0, np.array([1.0, 2.0]), np.zeros(9), np.zeros(9), 0.0)
    with pytest.raises(imucal.DataError, match="rate has 3 samples, temp_degc 2"):
        imucal.compensate([1, 2, 3], [20, 30], axis)
    log = imucal.Log(np.arange(3.0), np.arange(3.0), {"gx_dph": np.arange(2.0)})
    with pytest.raises(imucal.DataError, match="log.csv: cannot write: t_s has 3 rows, gx_dph 2"):
        imucal.write_log(tmp_path / "log.csv", log)
    assert not (tmp_path / "log.csv").exists()
