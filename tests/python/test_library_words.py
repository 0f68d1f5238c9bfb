# SPDX-License-Identifier: MIT
"""What a library prints or warns of is not our note: the user reads our words, with the cause and what to do."""
import json
import warnings

import foreign
import numpy as np
import pytest

import imucal
from imucal.__main__ import main
from imucal.log import Log, write_log


def log_of(n=600, **rates):
    return Log(np.arange(1.0, n + 1), np.linspace(20, 30, n), {f"{k}_dph": v for k, v in rates.items()}, {}, {}, "test")


def noise(n=600, seed=1):
    return 100 + 36 * np.random.default_rng(seed).standard_normal(n)


def holes(values, *spans):
    values = values.copy()
    for a, b in spans:
        values[a:b] = np.nan
    return values


SICK = {"empty": dict(gx=np.full(600, np.nan), gy=noise()), "a long hole": dict(gx=holes(noise(), (100, 400)), gy=noise(seed=2)),
        "holes everywhere": dict(gx=holes(noise(), *((k, k + 2) for k in range(0, 600, 3)))), "zeros": dict(gx=np.zeros(600), gy=noise()),
        "constant": dict(gx=np.full(600, 12.5)), "few": dict(gx=holes(noise(), (110, 600)), gy=noise())}


@pytest.mark.parametrize("name", SICK)
@pytest.mark.parametrize("temperature", ["ramp", "none", "constant"])
def test_commands_on_sick_logs_say_nothing_of_numpy_s(tmp_path, name, temperature, capsys):
    log = log_of(**SICK[name])
    log.temp_degc = {"ramp": log.temp_degc, "none": np.full(600, np.nan), "constant": np.full(600, 25.0)}[temperature]
    write_log(tmp_path / "log.csv", log)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # as a library, too
        imucal.import_log(tmp_path / "log.csv", temperature=False)
    without = ["--without-temp"] if temperature == "none" else []
    for command in (["import", str(tmp_path / "log.csv"), "-o", str(tmp_path / "o.csv"), *without], ["look", str(tmp_path / "log.csv"), "-o", str(tmp_path / "p.png"), "--no-ml"]):
        assert main(command) in (0, 3)
        said = capsys.readouterr()
        for word in ("NaN slice", "invalid value", "divide", "Mean of empty", "RuntimeWarning", "Degrees of freedom"):
            assert word not in said.out + said.err, said


def test_warnings_of_libraries_are_no_notes(monkeypatch, tmp_path, capsys):
    import imucal.check

    def warns(path):
        warnings.warn("from a library", RuntimeWarning)
        warnings.warn("ours", imucal.errors.DataWarning)
        return "log", []
    monkeypatch.setattr(imucal.check, "check_file", warns)
    (tmp_path / "x").write_text("")
    assert main(["check", str(tmp_path / "x")]) == 0
    said = capsys.readouterr().err
    assert "note: ours" in said and "from a library" not in said


def test_empty_axis_is_remarked_by_import_and_left_out_of_the_next_command_of_look(tmp_path, capsys):
    write_log(tmp_path / "log.csv", log_of(**SICK["empty"]))
    assert main(["import", str(tmp_path / "log.csv"), "-o", str(tmp_path / "o.csv")]) == 0
    assert "note: axis gx_dph has no value in any second" in capsys.readouterr().err
    assert main(["look", str(tmp_path / "log.csv"), "-o", str(tmp_path / "p.png"), "--no-ml"]) == 0
    last = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("next"))
    assert "--axis gy_dph" in last and "gx_dph" not in last


@pytest.fixture(scope="module")
def ulog(tmp_path_factory):
    path = tmp_path_factory.mktemp("ulog") / "whole.ulg"
    foreign.write_ulog(path, [foreign.recording(duration_s=30)])
    return path.read_bytes()


@pytest.mark.parametrize("keep", [20, 30, 40, 90, 150])
@pytest.mark.parametrize("options", [[], ["--instance", "0"]])
def test_ulog_cut_before_its_data_is_said_and_pyulog_is_silent(tmp_path, ulog, keep, options, capfd):
    (tmp_path / "cut.ulg").write_bytes(ulog[:keep])
    assert main(["import", str(tmp_path / "cut.ulg"), "-o", str(tmp_path / "o.csv"), "--json", "-", *options]) == 3
    said = capfd.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and "cut.ulg" in said.err
    assert "ends before" in said.err and "copy it" in said.err and "record again" not in said.err


def test_ulog_whose_middle_is_damaged_keeps_standard_output_for_the_result(tmp_path, ulog, capfd):
    damaged = bytearray(ulog)
    damaged[len(ulog) // 2:len(ulog) // 2 + 300] = b"\xa5" * 300
    (tmp_path / "hurt.ulg").write_bytes(damaged)
    status = main(["import", str(tmp_path / "hurt.ulg"), "-o", str(tmp_path / "o.csv"), "--json", "-"])
    said = capfd.readouterr()
    if status == 0:
        json.loads(said.out)
    else:
        assert said.out == "" and "hurt.ulg" in said.err


def test_sensor_of_sensor_gyro_is_not_taken_from_sensor_combined_unasked(tmp_path, capsys, monkeypatch):
    from imucal.importers import ulog as importer
    rec = foreign.recording(duration_s=30)
    topic = {"timestamp": rec.t_us, **{f"gyro_rad[{i}]": rec.gyro_radps[:, i] for i in range(3)}, **{f"accelerometer_m_s2[{i}]": rec.accel_ms2[:, i] for i in range(3)}}
    from types import SimpleNamespace
    empty = SimpleNamespace(msg_info_dict={}, initial_parameters={}, dropouts=[], file_corruption=False)
    monkeypatch.setattr(importer, "_read", lambda path: (empty, {importer.COMBINED: {0: topic}}))
    path = tmp_path / "x.ulg"
    foreign.write_ulog(path, [rec])
    assert main(["import", str(path), "-o", str(tmp_path / "o.csv"), "--instance", "0"]) == 3
    assert "no sensor_gyro" in (said := capsys.readouterr().err) and "--topic sensor_combined" in said
    assert main(["import", str(path), "-o", str(tmp_path / "o.csv")]) == 3
    advice = capsys.readouterr().err
    assert "--topic sensor_combined --without-temp" in advice and "--instance" not in advice
    assert main(["import", str(path), "-o", str(tmp_path / "o.csv"), "--topic", "sensor_combined", "--without-temp"]) == 0
