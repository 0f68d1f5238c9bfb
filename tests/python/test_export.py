# SPDX-License-Identifier: MIT
"""Exports, evaluated with the targets' own formulas in their own precision, against the table."""
import json
import re
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest

from imucal.__main__ import main
from imucal.errors import DataError
from imucal.export import ardupilot, c_header, noise, plain_json, px4
from imucal.export.cubic import single
from imucal.table import read_table
from imucal.units import DPH_PER_RADPS
from reference import DRIFTING as MODEL

F = np.float32
NOTHING = SimpleNamespace(instance=None, device_id=None, prefix=None, rate_hz=None)


def table_json(order=3, seed=1, names=("gx_dph", "gy_dph", "gz_dph"), span=(-20.0, 70.0), scale=(0.0,)):
    rng = np.random.default_rng(seed)
    return {"imucal_table": 1, "serial": "DEMO-1", "sequence": 3, "created": "2026-11-21T06:22:00Z", "degc_per_count": 0.01, "degc_at_zero": 25,
            "axes": [{"axis": n, "order": order, "t0_degc": 25.0, "range_degc": 50.0,
                      f"coeff_{n[-3:] if n.endswith('dph') else 'mg'}": [float(F(v)) for v in rng.normal(0, 500, order + 1)] if order else [0.0],
                      "scale_coeff": list(scale), "span_degc": list(span), "temp_degc": np.linspace(*span, 9).tolist(),
                      f"sigma_{'dph' if n.endswith('dph') else 'mg'}": [5.0] * 9, "model": {"arw_deg_rt_h": 0.6, "markov": []},
                      f"{'dph' if n.endswith('dph') else 'mg'}_per_count": 18.0, "full_scale_counts": 32767, "n_seconds": 8400} for n in names]}


def valid_from(axis, lo, hi):
    """Gives an axis a span, and a polynomial that reaches over it."""
    axis.update(span_degc=[lo, hi], temp_degc=np.linspace(lo, hi, 9).tolist(), t0_degc=(lo + hi) / 2, range_degc=(hi - lo) / 2)


@pytest.fixture
def table(tmp_path):
    def make(**kwargs):
        (tmp_path / "table.json").write_text(json.dumps(table_json(**kwargs)))
        return read_table(tmp_path / "table.json")
    return make


U = 2.0 ** -24  # a rounding to float32, relative


def exact(powers, d):
    """The terms of a polynomial whose coefficients are the written numbers, in double."""
    return np.stack([float(c) * d ** k for k, c in enumerate(powers)])


def held(written, exported_terms, own_arithmetic, table_curve):
    """Two bounds.  In exact arithmetic the written numbers give the table within one rounding of each coefficient: nothing
    better can be written.  The target's own float32 adds its own roundings, counted operation by operation in
    `own_arithmetic` (terms weighed by the roundings each of them passes)."""
    size = np.abs(exported_terms)
    assert np.all(np.abs(exported_terms.sum(axis=0) - table_curve) <= 1.000001 * U * size.sum(axis=0))
    assert np.all(np.abs(written.astype(float) - exported_terms.sum(axis=0)) <= 1.00001 * U * (np.asarray(own_arithmetic, float)[:, None] * size).sum(axis=0))


# Temperatures that float32 holds: a sensor gives no others.
TEMPS = np.linspace(-40, 90, 2001).astype(F).astype(float)


def px4_offset(params, i, temp):
    """calc_thermal_offsets_3D of PX4's TemperatureCompensation.cpp, in float32; and its terms in exact arithmetic."""
    g = {k: F(v) for k, v in params.items()}
    clipped = np.clip(temp.astype(F), g["TC_G0_TMIN"], g["TC_G0_TMAX"])
    d = clipped - g["TC_G0_TREF"]
    d2 = d * d
    d3 = d2 * d
    x = [g[f"TC_G0_X{k}_{i}"] for k in range(4)]
    return x[0] + x[1] * d + x[2] * d2 + x[3] * d3, exact(x, clipped.astype(float) - float(g["TC_G0_TREF"]))


# Roundings that x0, x1 d, x2 d^2, x3 d^3 pass: d itself once per power, the products, the sums after them.
PX4_ROUNDINGS = (3, 5, 6, 7)


@pytest.mark.parametrize("seed, order", [(1, 3), (2, 2), (3, 1), (4, 0), (5, 3), (6, 3)])
def test_px4_parameters_give_the_table_in_px4_s_own_formula(table, seed, order):
    t = table(seed=seed, order=order)
    text, notes = px4.export(t, SimpleNamespace(instance=0, device_id=2424842, prefix=None, rate_hz=None))
    rows = [line.split("\t") for line in text.splitlines() if not line.startswith("#")]
    assert all(len(r) == 5 and r[:2] == ["1", "1"] and len(r[2]) <= 16 for r in rows)
    params = {r[2]: r[3] for r in rows}
    assert params["TC_G0_ID"] == "2424842" and params["TC_G_ENABLE"] == "1" and not notes
    for i, channel in enumerate(t.channels):
        held(*px4_offset(params, i, TEMPS), PX4_ROUNDINGS, channel.bias(TEMPS) / DPH_PER_RADPS)


def test_px4_says_what_a_cubic_cannot_hold(table):
    t = table(order=5, scale=(0.0, 0.01))
    text, notes = px4.export(t, NOTHING)
    params = {r[2]: r[3] for r in (line.split("\t") for line in text.splitlines() if not line.startswith("#"))}
    stated = [float(re.search(r"up to ([0-9.e+]+) dph", n).group(1)) for n in notes if "order 5" in n]
    assert len(stated) == 3 and any("scale factor" in n for n in notes) and any("TC_G0_ID is 0" in n for n in notes)
    inside = np.linspace(-20, 70, 1001)
    for i, channel in enumerate(t.channels):
        found = np.abs(px4_offset(params, i, inside)[0] * DPH_PER_RADPS - channel.bias(inside)).max()
        assert found == pytest.approx(stated[i], rel=0.02)


def ap_correct(params, axis, temp, imu=1):
    """correct_sensor of ArduPilot's AP_InertialSensor_tempcal.cpp on v = 0, then INS_GYROFFS, in float32; and the terms of
    what it takes off, in exact arithmetic: three of the temperature, three of CALTEMP, the offset."""
    p = {k: F(v) for k, v in params.items()}
    c = [p[f"INS_TCAL{imu}_GYR{k}_{axis}"] for k in (1, 2, 3)]

    def evaluate(d):
        return (c[0] + (c[1] + c[2] * d) * d) * d * F(1e-6)
    lo, hi = p[f"INS_TCAL{imu}_TMIN"], p[f"INS_TCAL{imu}_TMAX"]
    at, cal = np.clip(temp.astype(F), lo, hi), np.clip(p[f"INS_GYR{imu}_CALTEMP"], lo, hi)
    v = F(0) - evaluate(at - F(35))
    v = v + evaluate(cal - F(35))
    offset = p["INS_GYR{}OFFS_{}".format("" if imu == 1 else imu, axis)]
    scaled = [0.0] + [float(k) * 1e-6 for k in c]
    terms = np.concatenate([exact(scaled, at.astype(float) - 35)[1:], -exact(scaled, np.full(at.shape, float(cal) - 35))[1:], np.full((1,) + at.shape, float(offset))])
    return -(v - offset), terms


# Roundings of c1 d, c2 d^2, c3 d^3 by Horner (each d, each product, each sum, 1e-6 and its product), of the two sums
# after them; the same for CALTEMP; of the offset.
AP_ROUNDINGS = (7, 10, 12, 7, 10, 12, 1)


@pytest.mark.parametrize("span", [(-20.0, 70.0), (-10.0, 25.0)])
def test_ardupilot_parameters_give_the_table_in_ardupilot_s_own_formula(table, span):
    t = table(span=span)
    text, _ = ardupilot.export(t, SimpleNamespace(instance=1, device_id=None, prefix=None, rate_hz=None))
    params = dict(line.split() for line in text.splitlines() if not line.startswith("#"))
    assert params["INS_TCAL2_ENABLE"] == "1" and all(len(n) <= 16 for n in params)
    for axis, channel in zip("XYZ", t.channels):
        held(*ap_correct(params, axis, TEMPS, imu=2), AP_ROUNDINGS, channel.bias(TEMPS) / DPH_PER_RADPS)


def test_ardupilot_has_one_span_for_gyro_and_accelerometer(table, tmp_path):
    content = table_json(names=("gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"))
    for axis in content["axes"][3:]:
        valid_from(axis, -5.0, 80.0)
    (tmp_path / "two.json").write_text(json.dumps(content))
    text, notes = ardupilot.export(read_table(tmp_path / "two.json"), NOTHING)
    params = dict(line.split() for line in text.splitlines() if not line.startswith("#"))
    assert (params["INS_TCAL1_TMIN"], params["INS_TCAL1_TMAX"]) == ("-5", "70")
    assert any("one span for gyro and accelerometer" in n and "-5 to 70" in n for n in notes)


def test_axes_without_a_common_span_are_refused(table, tmp_path):
    content = table_json()
    valid_from(content["axes"][1], 75.0, 85.0)
    (tmp_path / "apart.json").write_text(json.dumps(content))
    for module in (px4, ardupilot):
        with pytest.raises(DataError, match="no temperature in common"):
            module.export(read_table(tmp_path / "apart.json"), NOTHING)


def test_accelerometer_goes_out_in_ms2(table):
    t = table(names=("gx_dph", "gy_dph", "gz_dph", "ax_mg", "ay_mg", "az_mg"))
    text, notes = px4.export(t, NOTHING)
    params = {r[2]: float(r[3]) for r in (line.split("\t") for line in text.splitlines() if not line.startswith("#"))}
    assert params["TC_A0_X0_1"] == pytest.approx(t.channels[4].bias(25.0) * 9.80665e-3, rel=1e-6)
    assert any("gravity" in n for n in notes)
    params = dict(line.split() for line in ardupilot.export(t, NOTHING)[0].splitlines() if not line.startswith("#"))
    assert float(params["INS_TCAL1_ACC1_Z"]) == pytest.approx(t.channels[5].powers(35.0)[1] * 9.80665e-3 * 1e6, rel=1e-6)


HARNESS = """
#include <stdio.h>
#include "table.h"
int main(void) {{
  for (int mdegc = -40000; mdegc <= 90000; mdegc += 65) {{
    float degc = (float)mdegc / 1000.0f;
    printf("%d", mdegc);
{calls}
    printf("\\n");
  }}
  return 0;
}}
"""


@pytest.mark.parametrize("order", [0, 3, 5])
def test_c_header_compiles_cleanly_and_computes_the_table(table, tmp_path, order):
    t = table(order=order, scale=(0.002, -0.001))
    text, notes = c_header.export(t, SimpleNamespace(prefix="cal"))
    (tmp_path / "table.h").write_text(text)
    calls = "\n".join(f'    printf(" %.9g %.9g %ld %d", (double)cal_{n}_bias(degc), (double)cal_{n}_compensate(1000.0f, degc), '
                      f'(long)cal_{n}_bias_fixed(mdegc), CAL_{n.upper()}_FRAC_BITS);' for n in ("gx", "gy", "gz"))
    (tmp_path / "main.c").write_text(HARNESS.format(calls=calls))
    subprocess.run(["cc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror", "-ffp-contract=off",
                    "-fsanitize=undefined", "-fno-sanitize-recover=all", str(tmp_path / "main.c"), "-o", str(tmp_path / "main")], check=True)
    rows = np.array([line.split() for line in subprocess.run([str(tmp_path / "main")], capture_output=True, text=True, check=True).stdout.splitlines()], float)
    temp = rows[:, 0] / 1000
    assert len(notes) == 3
    for i, channel in enumerate(t.channels):
        bias, compensated, fixed, bits = rows[:, 1 + 4 * i:5 + 4 * i].T
        size = np.abs(channel.coeff).sum()
        # Tn^k carries the roundings of T itself, of T - t0 and of the quotient, k times; Horner two for each power; b_k one.
        clipped = np.clip(temp, *channel.span_degc)
        tn = (clipped - channel.t0_degc) / channel.range_degc
        of_temp = np.abs(clipped) / channel.range_degc  # T's own rounding, seen in Tn
        k = np.arange(order + 1)[:, None]
        powers = np.abs(channel.coeff)[:, None] * np.abs(tn) ** k
        slope = (np.abs(channel.coeff)[1:, None] * k[1:] * np.abs(tn) ** (k[1:] - 1)).sum(axis=0)
        assert np.all(np.abs(bias - channel.bias(temp)) <= 1.00001 * U * ((4 * k + 2) * powers).sum(axis=0) + 1.00001 * U * slope * of_temp)
        want = (1000 - channel.bias(temp)) * channel.scale(temp)
        assert np.abs(compensated - want).max() <= 16 * 2.0 ** -24 * (size + 1000)
        slope = np.abs(channel.coeff * np.arange(order + 1)).sum() * 2.0 ** -29  # of Tn's rounding
        assert np.abs(fixed / 2.0 ** bits - channel.bias(temp)).max() <= (order + 1) * 2.0 ** -bits[0] + slope


def test_c_header_compiles_whatever_the_axes_and_the_device_are_called(tmp_path, table):
    data = table_json(names=("g-x_dph", "g.y_dph", "gz_dph"))
    data["serial"] = "/*A*/B"
    (tmp_path / "table.json").write_text(json.dumps(data))
    text, notes = c_header.export(read_table(tmp_path / "table.json"), SimpleNamespace(prefix="cal"))
    assert "cal_g_x_bias(float temp_degc)" in text and "g-x_dph is called g_x in C" in notes and len(notes) == 2
    (tmp_path / "table.h").write_text(text)
    subprocess.run(["cc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wno-unused-function", "-Werror", "-fsyntax-only", "-x",
                    "c", str(tmp_path / "table.h")], check=True)


def test_axes_that_would_be_one_name_in_c_are_refused(table):
    with pytest.raises(DataError, match="table.json: g-x_dph and G.X_dph would both be called g_x in C: rename one"):
        c_header.export(table(names=("g-x_dph", "G.X_dph")), SimpleNamespace(prefix="cal"))


@pytest.mark.parametrize("device", [-5, 2 ** 31, 99999999999999])
def test_a_device_id_that_px4_cannot_hold_is_a_usage_error(table, tmp_path, device, capsys):
    table()
    words = ["export", str(tmp_path / "table.json"), "--to", "px4", "--device-id", str(device)]
    assert main([*words, "-o", str(tmp_path / "out")]) == 2
    assert f"--device-id {device}: expected a whole number 0 .. 2147483647" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_json_holds_the_curve_three_ways(table):
    data = json.loads(plain_json.export(table(order=4), NOTHING)[0])
    for axis in data["axes"]:
        temp = np.array(axis["temp_degc"])
        np.testing.assert_allclose(np.polyval(axis["matlab_polyval"], temp - axis["t_ref_degc"]), axis["bias"], rtol=1e-12, atol=1e-9)


# --- models ---


@pytest.fixture
def model(tmp_path):
    (tmp_path / "model.json").write_text(json.dumps(MODEL))
    return noise.read_noise(tmp_path / "model.json")


def values_of(yaml_text):
    return {k.strip(): v.split("#")[0].strip() for k, v in (line.split(":", 1) for line in yaml_text.splitlines() if ":" in line and not line.startswith("#"))}


def test_kalibr_densities_reproduce_the_noise_by_kalibr_s_own_discretisation(model):
    """sigma_d = density / sqrt(dt), bias step = walk sqrt(dt) (Kalibr, IMU noise model): 1-s means and the growth of the bias."""
    text, notes = noise.kalibr(model, NOTHING)
    v = values_of(text)
    rate = float(v["update_rate"])
    white_1s = float(v["gyroscope_noise_density"]) * np.sqrt(rate) / np.sqrt(rate)
    assert white_1s * DPH_PER_RADPS == pytest.approx(36.0, rel=1e-6)
    growth_10s = float(v["gyroscope_random_walk"]) * np.sqrt(10) * DPH_PER_RADPS
    exact = 20 * np.sqrt(2 * (1 - np.exp(-10 / 100)))  # rms change of the Markov term in 10 s
    assert growth_10s == pytest.approx(exact, rel=0.03)
    assert any("random walk only" in n for n in notes)


def test_ros_covariance_is_of_one_sample(model):
    v = values_of(noise.ros(model, SimpleNamespace(rate_hz=100))[0])
    variance = float(v["angular_velocity_covariance"].strip("[]").split(",")[0])
    assert np.sqrt(variance / 100) * DPH_PER_RADPS == pytest.approx(36.0, rel=1e-6)  # a hundred samples make a 1-s mean
    assert float(v["gtsam_gyroscopeCovariance"]) == pytest.approx(float(v["gyro_noise_density"]) ** 2, rel=1e-6)


def test_matlab_filter_has_the_instability_s_spread_and_memory(model):
    text = noise.matlab(model, SimpleNamespace(rate_hz=10))[0]
    sigma = float(re.search(r"BiasInstability = ([0-9.e+-]+)", text).group(1))
    phi = float(re.search(r"% ([0-9.]+) at 10 Hz", text).group(1))
    response = np.sqrt(1 - phi ** 2) * phi ** np.arange(20000)
    assert sigma * np.sqrt(np.sum(response ** 2)) * DPH_PER_RADPS == pytest.approx(20, rel=1e-5)
    assert -1 / (10 * np.log(phi)) == pytest.approx(100, rel=1e-5)
    slope = float(re.search(r"TemperatureBias = ([0-9.e+-]+)", text).group(1)) * DPH_PER_RADPS
    tn = (25 - 30) / 30
    assert slope == pytest.approx((300 + 300 * tn - 300 * tn ** 2) / 30, rel=1e-6)


def test_datasheet_figures_follow_ieee_952(model):
    figures = noise.datasheet_figures(model)
    assert figures["arw_deg_rt_h"] == 0.6
    assert figures["rate_random_walk_dph_rt_h"] == pytest.approx(20 * np.sqrt(2 / 100) * 60)
    flicker = noise.Noise(0.6, [], 0, None, [], "x")
    assert noise.datasheet_figures(flicker)["bias_instability_dph"] is None
    slow = noise.Noise(0.6, [(20, 5000)], 0, None, [], "x")  # white until the walk takes over: N^2/tau + K^2 tau/3
    walk = 20 * np.sqrt(2 / 5000)
    found = noise.datasheet_figures(slow)
    assert found["bias_instability_tau_s"] == pytest.approx(36 * np.sqrt(3) / walk, rel=0.03)
    assert found["bias_instability_dph"] == pytest.approx(np.sqrt(2 * 36 * walk / np.sqrt(3)) / 0.664, rel=0.03)


def test_allan_of_a_model_tends_to_its_asymptotes():
    n = noise.Noise(0.6, [(20, 100)], 0, None, [], "x")
    assert n.allan_dph(0.01) == pytest.approx(36 / np.sqrt(0.01), rel=1e-3)
    only = noise.Noise(0.0, [(20, 100)], 0, None, [], "x")
    assert only.allan_dph(1.0) == pytest.approx(20 * np.sqrt(2 / 100) * np.sqrt(1 / 3), rel=0.01)    # K sqrt(tau/3)
    assert only.allan_dph(189.0) == pytest.approx(0.437 * np.sqrt(2 / 100) * 20 * np.sqrt(100), rel=0.01)  # IEEE 952, C.1.5: maximum at 1.89 Tc


@pytest.mark.parametrize("content, to, words", [
    (MODEL, "px4", "not a calibration table"), (table_json(), "kalibr", "needs an error model"),
    (table_json(names=("gx_dph", "gy_dph")), "px4", "no axis gz"), (table_json(names=("temp_dph",)), "ardupilot", "no axes gx, gy, gz"),
    ({"imucal_table": 1, "axes": [{"axis": "gx_dph"}]}, "px4", 'field "serial" is missing')])
def test_export_of_the_wrong_file_says_so_and_writes_nothing(tmp_path, capsys, content, to, words):
    (tmp_path / "f.json").write_text(json.dumps(content))
    assert main(["export", str(tmp_path / "f.json"), "--to", to, "-o", str(tmp_path / "out")]) == 3
    assert words in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_single_is_the_nearest_float32():
    assert single(0.1) == float(np.float32(0.1))


ACCEL = {"imucal_model": 1, "unit": "mg", "white_mg_rt_hz": 0.15, "markov": [{"sigma_mg": 0.08, "tau_s": 200}],
         "bias": {"t0_degc": 30, "range_degc": 30, "coeff_mg": [1000, 4, 2, -1]}}


@pytest.fixture
def accel(tmp_path):
    (tmp_path / "accel.json").write_text(json.dumps(ACCEL))
    return tmp_path / "accel.json"


def test_accelerometer_densities_are_in_metres_per_second_squared(accel):
    density, walk = 0.15e-3 * 9.80665, 0.08e-3 * 9.80665 * np.sqrt(2 / 200)
    v = values_of(noise.kalibr(noise.read_noise(accel), NOTHING)[0])
    assert float(v["accelerometer_noise_density"]) == pytest.approx(density, rel=1e-6) and "gyroscope_noise_density" not in v
    assert float(v["accelerometer_random_walk"]) == pytest.approx(walk, rel=1e-6)
    v = values_of(noise.ros(noise.read_noise(accel), SimpleNamespace(rate_hz=100))[0])
    assert float(v["gtsam_accelerometerCovariance"]) == pytest.approx(density ** 2, rel=1e-6)
    text, notes = noise.matlab(noise.read_noise(accel), NOTHING)
    assert "p = accelparams;" in text and f"p.NoiseDensity = {density:.9g};" in text and any("gravity" in n for n in notes)
    slope = (4 + 2 * 2 * (-5 / 30) - 3 * (5 / 30) ** 2) / 30 * 9.80665e-3
    assert float(re.search(r"p.TemperatureBias = (\S+);", text).group(1)) == pytest.approx(slope, rel=1e-6)
    text, _ = noise.datasheet(noise.read_noise(accel), NOTHING)
    assert "velocity random walk 0.0883 m/s/sqrt(h)" in text and "150 ug/sqrt(Hz)" in text and "deg" not in text


def test_kalibr_takes_the_accelerometer_beside_the_gyro(model, accel):
    v = values_of(noise.kalibr(model, SimpleNamespace(rate_hz=None, accel=str(accel)))[0])
    assert float(v["accelerometer_noise_density"]) == pytest.approx(0.15e-3 * 9.80665, rel=1e-6)
    assert float(v["gyroscope_noise_density"]) == pytest.approx(model.density, rel=1e-6)
    with pytest.raises(DataError, match="accelerometer's model"):
        noise.kalibr(noise.read_noise(accel), SimpleNamespace(rate_hz=None, accel=str(accel)))
