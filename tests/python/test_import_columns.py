# SPDX-License-Identifier: MIT
"""Columns of tables: which is the temperature, in which unit, and times that are dates."""
import numpy as np
import pytest

import imucal
from imucal.__main__ import main
from imucal.errors import DataError

N = 3000


def table(path, time=lambda t: f"{t:.3f}", time_name="time_s", **columns):
    """100 Hz, three gyros, and columns of temperature by name: functions of degC."""
    rng = np.random.default_rng(4)
    gyro = 0.01 * rng.standard_normal((N, 3))
    temp = 20 + np.arange(N) / 1000
    lines = [",".join([time_name, "gx_dps", "gy_dps", "gz_dps", *columns])]
    lines += [",".join([time(i / 100), *(f"{v:.6f}" for v in gyro[i]), *(f"{of(temp[i]):.3f}" for of in columns.values())]) for i in range(N)]
    path.write_text("\n".join(lines) + "\n")
    return path


SAME = float
KELVIN, FAHRENHEIT = (lambda c: c + 273.15), (lambda c: 1.8 * c + 32)


@pytest.mark.parametrize("columns, named", [({"temp_baro": SAME, "temp_gyro": SAME}, "temp_baro, temp_gyro"), ({"t_board_temp": SAME, "supply_v": SAME}, "t_board_temp"),
                                            ({"Thermometer 1": SAME, "Thermistor": SAME}, "Thermometer 1, Thermistor")])
def test_columns_that_may_be_the_temperature_are_listed_with_the_option(tmp_path, capsys, columns, named):
    path = table(tmp_path / "board.csv", **columns)
    assert main(["import", str(path), "-o", str(tmp_path / "o.csv")]) == 3
    said = capsys.readouterr().err
    first = named.split(", ")[0]
    assert named in said and (f'--temp "{first}"' if " " in first else f"--temp {first}") in said
    assert main(["import", str(path), "-o", str(tmp_path / "o.csv"), "--temp", first]) == 0


def test_no_column_that_may_be_one_lists_all(tmp_path, capsys):
    path = table(tmp_path / "board.csv", pressure=SAME)
    assert main(["import", str(path), "-o", str(tmp_path / "o.csv")]) == 3
    said = capsys.readouterr().err
    assert "pressure" in said and "--temp COLUMN" in said and "--without-temp" in said


@pytest.mark.parametrize("name, of, unit", [
    ("temp_k", KELVIN, "kelvin"), ("temp [K]", KELVIN, "kelvin"), ("temperature_kelvin", KELVIN, "kelvin"), ("temp_f", FAHRENHEIT, "Fahrenheit"),
    ("Temperature (°F)", FAHRENHEIT, "Fahrenheit"), ("temp_degf", FAHRENHEIT, "Fahrenheit"), ("temp_degc", SAME, None), ("temp [°C]", SAME, None), ("temp_c", SAME, None)])
@pytest.mark.parametrize("way", ["found", "named"])
def test_unit_that_a_column_of_temperature_states_is_converted_and_said(tmp_path, name, of, unit, way):
    path = table(tmp_path / "board.csv", **{name: of})
    if way == "found" and name in ("temp_k", "temp_f"):  # "f" may be "filtered"
        with pytest.raises(DataError, match=f"columns that may be one: {name}; choose: --temp {name}"):
            imucal.import_log(path)
        return
    result = imucal.import_log(path, **({"temp": name} if way == "named" else {}))
    np.testing.assert_allclose(result.log.temp_degc, 20.0495 + 0.1 * np.arange(30), atol=2e-3)
    assert bool([n for n in result.notes if unit and unit in n]) == bool(unit)


@pytest.mark.parametrize("name, of, unit", [("t1", KELVIN, "K"), ("temp_f", SAME, "C"), ("t1", FAHRENHEIT, "f")])
def test_unit_may_be_named_with_the_column(tmp_path, name, of, unit):
    result = imucal.import_log(table(tmp_path / "board.csv", **{name: of}), temp=f"{name}:{unit}")
    np.testing.assert_allclose(result.log.temp_degc, 20.0495 + 0.1 * np.arange(30), atol=2e-3)


ISO = [("2026-11-28T10:%02d:%09.6fZ", "UTC"), ("2026-11-28T10:%02d:%09.6f", "plain"), ("2026-11-28 10:%02d:%09.6f", "blank"),
       ("2026-11-28T15:%02d:%09.6f+05:00", "zone")]


@pytest.mark.parametrize("form", [f for f, _ in ISO], ids=[i for _, i in ISO])
def test_dates_of_iso_8601_are_times(tmp_path, form):
    plain = imucal.import_log(table(tmp_path / "s.csv", temp=SAME))
    result = imucal.import_log(table(tmp_path / "iso.csv", time=lambda t: form % (t // 60, t % 60), time_name="time", temp=SAME))
    np.testing.assert_array_equal(result.log.t_s, plain.log.t_s)
    np.testing.assert_allclose(result.log.rates["gx_dph"], plain.log.rates["gx_dph"], atol=1e-9)
    assert result.log.metadata["t_s_origin_s"] == int(np.datetime64("2026-11-28T10:00:00", "s").astype(int))


def test_times_that_are_words_are_refused_with_both_ways_out(tmp_path):
    path = table(tmp_path / "words.csv", time=lambda t: f"{t:.2f} s", time_name="time", temp=SAME)
    with pytest.raises(DataError, match=r"time.*\"0\.00 s\".*--time COLUMN.*--rate HZ"):
        imucal.import_log(path)
    result = imucal.import_log(path, rate_hz=100)
    assert len(result.log.t_s) == 30 and [n for n in result.notes if "counted" in n and "time" in n]


@pytest.mark.parametrize("value", [1e308, -999, 1e9])
def test_reading_that_is_no_temperature_is_refused_with_the_row(tmp_path, capsys, value):
    """One of them spoils its second, or is no number at all in the log."""
    path = table(tmp_path / "board.csv", temp=lambda c: value if c == 20.7 else c)
    assert main(["import", str(path), "-o", str(tmp_path / "o.csv")]) == 3
    said = capsys.readouterr().err
    assert f"board.csv:702: column temp: {value:g} is no temperature in degrees Celsius" in said and "leave it empty" in said
    assert not (tmp_path / "o.csv").exists()


def test_rates_beyond_those_of_any_log_are_refused(tmp_path, capsys):
    path = table(tmp_path / "board.csv", temp=SAME)
    path.write_text(path.read_text().replace("gx_dps", "gx").replace("gy_dps", "gy").replace("gz_dps", "gz"))
    options = ["--unit", "counts", "--scale", "1e300", "--keep-moving"]
    assert main(["import", str(path), *options, "-o", str(tmp_path / "o.csv")]) == 3
    assert "axis gx_dph: " in (said := capsys.readouterr().err) and "beyond +-1e12" in said and not (tmp_path / "o.csv").exists()


@pytest.mark.parametrize("options, words", [
    (["--temp", "gx_dps"], "no gyro columns found among time_s, gy_dps, gz_dps, temp (gx_dps is named by --temp)"),
    (["--temp", "time_s"], "no time column found among gx_dps, gy_dps, gz_dps, temp (time_s is named by --temp)"),
    (["--temp", "time_s:C"], "(time_s is named by --temp)"), (["--time", "gx_dps"], "(gx_dps is named by --time)"),
    (["--gyro", "time_s,gx_dps,gy_dps", "--unit", "dps"], "(time_s, gx_dps, gy_dps are named by --gyro)")])
def test_column_that_an_option_names_is_not_found_as_something_else(tmp_path, capsys, options, words):
    path = table(tmp_path / "board.csv", temp=SAME)
    assert main(["import", str(path), *options, "-o", str(tmp_path / "o.csv")]) == 3
    assert words in capsys.readouterr().err and not (tmp_path / "o.csv").exists()


def test_name_that_an_option_gives_rules_over_what_is_found(tmp_path):
    """A column "t" is the time, unless it is said to be the temperature."""
    path = table(tmp_path / "board.csv", t=SAME)
    log = imucal.import_log(path, temp="t").log
    assert log.t_s[-1] == 30 and 22.9 < log.temp_degc[-1] < 23


@pytest.mark.parametrize("options", [["--gyro", "gx_dps, gy_dps", "--temp", "gy_dps"],
                                     ["--gyro", "gx_dps,temp ", "--temp", "temp:K", "--unit", "dps"]])
def test_column_that_two_options_name_with_blanks_between_is_refused(tmp_path, capsys, options):
    path = table(tmp_path / "board.csv", temp=SAME)
    assert main(["import", str(path), *options, "-o", str(tmp_path / "o.csv")]) == 2
    assert "is named twice" in capsys.readouterr().err


def test_field_of_a_struct_that_two_options_name_is_refused(tmp_path, capsys):
    savemat = pytest.importorskip("scipy.io").savemat
    t_s = np.arange(N) / 100
    gyro = 0.01 * np.random.default_rng(1).standard_normal((N, 3))
    savemat(tmp_path / "log.mat", {"log": {"t_s": t_s, "gyro": gyro, "temp": 20 + t_s}})
    options = ["--gyro", "log.gyro", "--temp", "gyro_x", "--unit", "dps"]
    assert main(["import", str(tmp_path / "log.mat"), *options, "-o", str(tmp_path / "o.csv")]) == 2
    assert "column gyro_x is named twice" in capsys.readouterr().err


@pytest.mark.parametrize("column", ["gx_dps", "temp"])
def test_column_of_truth_values_is_no_column_of_numbers(tmp_path, capsys, column):
    path = table(tmp_path / "board.csv", temp=SAME)
    names, *rows = [line.split(",") for line in path.read_text().splitlines()]
    for row in rows:
        row[names.index(column)] = "true"
    path.write_text("\n".join(map(",".join, [names, *rows])) + "\n")
    assert main(["import", str(path), "-o", str(tmp_path / "o.csv")]) == 3
    assert f'board.csv:2: column {column}: expected a number, found "true"' in capsys.readouterr().err
