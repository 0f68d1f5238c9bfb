# SPDX-License-Identifier: MIT
"""--detrend of dp and errormodel against least squares by numpy on the record as it was written.

The Allan deviation here is the definition with loops replaced by slices: differences of the means of n samples before and
after every second, where all 2 n are there; one half of their mean square, its root.  Fits use Chebyshev polynomials of the
scaled temperature and numpy's SVD, rows with a missing value left out."""
import json
import math
import subprocess

import numpy as np
import pytest

from where import BIN

TAU_S = [1, 2, 5, 17, 60, 200]


def run(*arguments, expect=0):
    done = subprocess.run([str(BIN / arguments[0]), *map(str, arguments[1:])], capture_output=True, text=True, timeout=120)
    assert done.returncode == expect, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


def result(*arguments):
    return json.loads(run(*arguments, "--json", "-").stdout)


def write(path, t_s, temp, axes):
    head = "t_s,temp_degc," + ",".join(axes)
    rows = ["" if v != v else repr(float(v)) for column in (t_s, temp, *axes.values()) for v in column]
    n = len(t_s)
    lines = [",".join(rows[i::n]) for i in range(n)]
    path.write_text("# imucal-log = 1\n" + head + "\n" + "\n".join(lines) + "\n")
    return path


def sensor(seed, n=3000, offset=400.0, lost=0.0, empty=0.0):
    """Rising and falling temperature, a quartic bias, white and slow noise; rows lost, fields empty."""
    rng = np.random.default_rng(seed)
    t = np.arange(1.0, n + 1)
    temp = np.round(30 - 28 * np.cos(2 * np.pi * t / n * 1.3) + 0.02 * rng.standard_normal(n), 3)
    x = (temp - 30) / 30
    rate = offset + 300 * x + 150 * x ** 2 - 100 * x ** 3 + 60 * x ** 4 + 0.2 * np.cumsum(rng.standard_normal(n)) + 36 * rng.standard_normal(n)
    rate = np.round(rate, 4)
    keep = rng.random(n) >= lost
    rate[rng.random(n) < empty] = np.nan
    return t[keep], temp[keep], rate[keep]


def residual(x, y, order):
    """What least squares of this order leaves; order None: nothing is taken off."""
    if order is None:
        return y
    there = np.isfinite(y)
    low, high = x[there].min(), x[there].max()
    z = (2 * x - low - high) / (high - low) if high > low else 0 * x
    columns = np.polynomial.chebyshev.chebvander(z, order if high > low else 0)
    beta = np.linalg.lstsq(columns[there], y[there] - y[there].mean(), rcond=None)[0]
    return y - y[there].mean() - columns @ beta


def on_grid(t_s, rate):
    grid = np.full(int(t_s[-1] - t_s[0]) + 1, np.nan)
    grid[np.round(t_s - t_s[0]).astype(int)] = rate
    return grid


def deviation(grid, n):
    if 2 * n > len(grid):
        return math.nan, 0
    there = np.isfinite(grid)
    count = np.concatenate([[0], np.cumsum(there)])
    sums = np.concatenate([[0], np.cumsum(np.where(there, grid, 0), dtype=np.longdouble)])
    full = count[2 * n:] - count[:-2 * n] == 2 * n
    d = ((sums[2 * n:] - 2 * sums[n:-n] + sums[:-2 * n]) / n)[full]
    return (float(np.sqrt(np.mean(d * d) / 2)), len(d)) if len(d) else (math.nan, 0)


def expect_curve(curve, t_s, left, rel=1e-9):
    grid = on_grid(t_s, left)
    assert curve["tau_s"], curve
    for tau, dp, n in zip(curve["tau_s"], curve["dp_dph"], curve["n"]):
        want, count = deviation(grid, int(round(tau)))
        assert dp == pytest.approx(want, rel=rel), (tau, n, count)
        assert n == count


TAU = ",".join(map(str, TAU_S))
WORDS = [("none", None), ("mean", 0)] + [(f"poly:{n}", n) for n in range(6)]


@pytest.mark.parametrize("word, order", WORDS)
@pytest.mark.parametrize("offset", [0.0, 400.0, 1e6])
def test_dp_takes_off_the_polynomial_of_the_temperature(tmp_path, word, order, offset):
    t, temp, rate = sensor(1, offset=offset)
    curves = result("dp", write(tmp_path / "a.csv", t, temp, {"gx_dph": rate}), "--detrend", word, "--tau", TAU)["curves"]
    expect_curve(curves[0], t, residual(temp, rate, order))


@pytest.mark.parametrize("order", range(6))
def test_dp_takes_off_the_polynomial_of_time(tmp_path, order):
    t, temp, rate = sensor(2)
    curves = result("dp", write(tmp_path / "a.csv", t, temp, {"gx_dph": rate}), "--detrend", f"time:{order}", "--tau", TAU)["curves"]
    expect_curve(curves[0], t, residual(t, rate, order))


@pytest.mark.parametrize("word, order", [("mean", 0), ("poly:3", 3), ("poly:5", 5)])
@pytest.mark.parametrize("lost, empty", [(0.01, 0.0), (0.0, 0.01), (0.02, 0.01)])
def test_rows_and_fields_that_miss_are_fitted_around(tmp_path, word, order, lost, empty):
    t, temp, rate = sensor(3, lost=lost, empty=empty)
    log = write(tmp_path / "a.csv", t, temp, {"gx_dph": rate})
    expect_curve(result("dp", log, "--detrend", word, "--tau", "1,2,5,17")["curves"][0], t, residual(temp, rate, order))


def test_every_log_and_axis_has_a_polynomial_of_its_own(tmp_path):
    logs, truth = [], {}
    for i, offset in enumerate((-3e4, 0, 5e3)):
        t, temp, first = sensor(10 + i, n=2000 + 300 * i, offset=offset)
        second = sensor(20 + i, n=2000 + 300 * i, offset=-offset)[2]
        logs.append(write(tmp_path / f"{i}.csv", t, temp, {"gx_dph": first, "gy_dph": second}))
        truth[str(logs[-1]), "gx_dph"] = t, residual(temp, first, 3)
        truth[str(logs[-1]), "gy_dph"] = t, residual(temp, second, 3)
    curves = result("dp", *logs, "--detrend", "poly:3", "--tau", TAU)["curves"]
    assert len(curves) == 6
    for curve in curves:
        expect_curve(curve, *truth[curve["log"], curve["axis"]])


@pytest.mark.parametrize("values, order", [([25.0], 1), ([25.0], 5), ([20.0, 30.0], 2), ([20.0, 30.0, 45.0], 5)])
@pytest.mark.parametrize("program", [("dp",), ("errormodel", "fit")])
def test_a_polynomial_that_the_temperatures_do_not_tell_is_refused(tmp_path, values, order, program):
    t, _, rate = sensor(5)
    log = write(tmp_path / "a.csv", t, np.repeat(values, len(t) // len(values)), {"gx_dph": rate})
    said = run(*program, log, "--detrend", f"poly:{order}", "--tau", TAU, expect=3).stderr
    assert "a.csv" in said and "gx_dph" in said and f"{order}" in said
    assert "use --detrend mean" in said or "lower the order" in said


@pytest.mark.parametrize("values", [[25.0], [20.0, 30.0], [20.0, 30.0, 45.0]])
def test_as_many_temperatures_as_coefficients_leave_what_is_off_their_means(tmp_path, values):
    t, _, rate = sensor(5)
    temp, left = np.repeat(values, len(t) // len(values)), rate.copy()
    for value in values:
        left[temp == value] -= left[temp == value].mean()
    log = write(tmp_path / "a.csv", t, temp, {"gx_dph": rate})
    expect_curve(result("dp", log, "--detrend", f"poly:{len(values) - 1}", "--tau", TAU)["curves"][0], t, left)


@pytest.mark.parametrize("unit, factor", [("mg", 1.0), ("ms2", 1000 / 9.80665)])
def test_an_accelerometer_is_detrended_in_mg(tmp_path, unit, factor):
    t, temp, rate = sensor(6, offset=1e5)
    value = np.round(rate / 100, 6)
    curve = result("dp", write(tmp_path / "a.csv", t, temp, {f"ax_{unit}": value}), "--detrend", "poly:3", "--tau", TAU)["curves"][0]
    assert curve["unit"] == "mg"
    expect_curve(curve, t, residual(temp, value * factor, 3))


@pytest.mark.parametrize("unit, factor", [("dps", 3600.0), ("radps", 3600 * 180 / math.pi)])
def test_gyros_in_other_units_are_detrended_in_dph(tmp_path, unit, factor):
    t, temp, rate = sensor(7)
    value = rate / factor
    curve = result("dp", write(tmp_path / "a.csv", t, temp, {f"gx_{unit}": value}), "--detrend", "poly:4", "--tau", TAU)["curves"][0]
    expect_curve(curve, t, residual(temp, value * factor, 4))


def test_a_log_read_twice_is_detrended_alike(tmp_path):
    t, temp, rate = sensor(8, offset=1e6)
    log = write(tmp_path / "a.csv", t, temp, {"gx_dph": rate})
    expect_curve(result("dp", log, "--detrend", "mean", "--stream", "--no-ratios", "--tau", TAU)["curves"][0], t, residual(t, rate, 0))


# errormodel: the curve of the data that a model is fitted to, or checked against.

def fit(*arguments):
    return result("errormodel", "fit", *arguments, "--criterion", "ls", "--markov", 1, "--bootstrap", 0, "--tau", "1,2,5,17,60")


@pytest.mark.parametrize("word, order", WORDS)
@pytest.mark.parametrize("offset, lost", [(400.0, 0.0), (1e6, 0.0), (-3e4, 0.003)])
def test_errormodel_fits_the_curve_of_the_residual(tmp_path, word, order, offset, lost):
    t, temp, rate = sensor(30, offset=offset, lost=lost)
    fitted = fit(write(tmp_path / "a.csv", t, temp, {"gx_dph": rate}), "--detrend", word)
    assert fitted["detrend"] == word
    grid = on_grid(t, residual(temp, rate, order))
    for tau, dp in zip(fitted["tau_s"], fitted["data_dp_dph"]):
        assert dp == pytest.approx(deviation(grid, int(tau))[0], rel=1e-9)


@pytest.mark.parametrize("across, of", [("rms", lambda c: np.sqrt(np.mean(np.square(c), axis=0))), ("max", lambda c: np.max(c, axis=0))])
@pytest.mark.parametrize("order", [0, 3])
def test_errormodel_takes_a_polynomial_off_each_log_before_the_curves_join(tmp_path, across, of, order):
    logs, curves = [], []
    for i in range(3):
        t, temp, rate = sensor(40 + i, offset=1e4 * (i - 1))
        logs.append(write(tmp_path / f"{i}.csv", t, temp, {"gx_dph": rate}))
        grid = on_grid(t, residual(temp, rate, order))
        curves.append([deviation(grid, n)[0] for n in (1, 2, 5, 17, 60)])
    fitted = fit(*logs, "--detrend", f"poly:{order}" if order else "mean", "--across", across)
    np.testing.assert_allclose(fitted["data_dp_dph"], of(curves), rtol=1e-9)


def test_errormodel_of_an_accelerometer_in_mg(tmp_path):
    t, temp, rate = sensor(50)
    value = np.round(1000 + rate / 200, 6)
    fitted = fit(write(tmp_path / "a.csv", t, temp, {"ax_mg": value}), "--detrend", "poly:3")
    assert fitted["unit"] == "mg" and fitted["model"]["unit"] == "mg"
    grid = on_grid(t, residual(temp, value, 3))
    np.testing.assert_allclose(fitted["data_dp_dph"], [deviation(grid, n)[0] for n in (1, 2, 5, 17, 60)], rtol=1e-9)


@pytest.mark.parametrize("word, order", [("mean", 0), ("poly:3", 3)])
def test_errormodel_check_judges_by_the_residual(tmp_path, word, order):
    """A ratio of the closed form of white noise, 60 arw / root tau, over the curve of the data."""
    t, temp, rate = sensor(60)
    (tmp_path / "model.json").write_text(json.dumps({"imucal_model": 1, "arw_deg_rt_h": 0.7, "markov": []}))
    done = subprocess.run([str(BIN / "errormodel"), "check", str(write(tmp_path / "a.csv", t, temp, {"gx_dph": rate})), "--model",
                           str(tmp_path / "model.json"), "--detrend", word, "--tau", "1,2,5", "--json", "-"], capture_output=True, text=True)
    checked = json.loads(done.stdout)
    grid = on_grid(t, residual(temp, rate, order))
    np.testing.assert_allclose(checked["data_dp_dph"], [deviation(grid, n)[0] for n in (1, 2, 5)], rtol=1e-9)
    ratios = [42 / math.sqrt(n) / deviation(grid, n)[0] for n in (1, 2, 5)]
    assert checked["worst_ratio"] == pytest.approx(min(ratios), rel=2e-3)  # what the polynomial takes of white noise
    assert checked["bounded"] == (min(ratios) >= 1) and done.returncode == (0 if min(ratios) >= 1 else 1)
