# SPDX-License-Identifier: MIT
"""Commands that a tired user types: a result named as the log, one log twice, models of two sensors, times in milliseconds,
temperatures in kelvin.  A record is never written over, and no figure comes out confident and wrong without a word."""
import json
import subprocess

import numpy as np
import pytest
from scipy.signal import lfilter

from reference import MODEL
from where import BIN

PROFILE = {"imucal_profile": 1, "start_degc": 0, "segments": [{"rate_degc_per_min": 2, "to_degc": 60}, {"rate_degc_per_min": 2, "to_degc": 0}]}


def run(program, *arguments):
    return subprocess.run([str(BIN / program), *map(str, arguments)], capture_output=True, text=True, timeout=120)


def log_text(seed=1, step_s=1, kelvin=0.0, n=4000):
    rng = np.random.default_rng(seed)
    temp = np.round(30 - 30 * np.cos(2 * np.pi * np.arange(n) / n), 3)
    x, phi = (temp - 30) / 30, np.exp(-0.01)
    rate = 80 + 300 * x + 150 * x ** 2 - 100 * x ** 3 + 36 * rng.standard_normal(n)
    rate += lfilter([1], [1, -phi], 20 * np.sqrt(1 - phi ** 2) * rng.standard_normal(n))
    rows = [f"{step_s * (i + 1)},{temp[i] + kelvin:.3f},{rate[i]:.3f}" for i in range(n)]
    return "# imucal-log = 1\nt_s,temp_degc,gx_dph\n" + "\n".join(rows) + "\n"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "log.csv").write_text(log_text())
    (tmp_path / "model.json").write_text(json.dumps(MODEL))
    (tmp_path / "profile.json").write_text(json.dumps(PROFILE))
    (tmp_path / "accel.json").write_text(json.dumps({"imucal_model": 1, "unit": "mg", "white_mg_rt_hz": 0.15, "markov": []}))
    return tmp_path


ONTO = {
    "dp --json": ("dp", "{log}", "--no-ratios", "--tau", "1,10", "--json", "{to}"),
    "errormodel fit -o": ("errormodel", "fit", "{log}", "--markov", "1", "--bootstrap", "0", "-o", "{to}"),
    "errormodel check --json": ("errormodel", "check", "{log}", "--model", "{model}", "--tau", "2,20", "--json", "{to}"),
    "calibrate fit -o": ("calibrate", "fit", "{log}", "--method", "poly", "-o", "{to}"),
    "calibrate fit --json": ("calibrate", "fit", "{log}", "--method", "poly", "--json", "{to}"),
    "diagnose --json": ("diagnose", "--model", "{model}", "--log", "{log}", "--no-cache", "--nulls", "50", "--json", "{to}"),
    "diagnose --model-out": ("diagnose", "--model", "{model}", "--log", "{log}", "--no-cache", "--nulls", "50", "--model-out", "{to}"),
    "profile error --json": ("profile", "error", "{log}", "--model", "{model}", "--order", "3", "--json", "{to}"),
}


@pytest.mark.parametrize("command", ONTO)
@pytest.mark.parametrize("by", ["its name", "a link"])
def test_a_log_is_never_written_over(folder, command, by):
    log, to = folder / "log.csv", folder / "log.csv"
    if by == "a link":
        to = folder / "result.json"
        to.symlink_to(log)
    before = log.read_bytes()
    program, *arguments = [a.format(log=log, to=to, model=folder / "model.json") for a in ONTO[command]]
    done = run(program, *arguments)
    assert log.read_bytes() == before
    assert done.returncode == 3 and to.name in done.stderr and "give another name" in done.stderr, done.stderr
    assert sorted(p.name for p in folder.iterdir() if ".part" in p.name) == []


@pytest.mark.parametrize("command", [("calibrate", "fit", "--method", "poly"), ("errormodel", "fit", "--markov", "1", "--bootstrap", "0")])
def test_one_record_given_twice_is_refused(folder, command):
    """Twice the data would make the errors too small by the root of two."""
    (folder / "copy.csv").write_text(log_text())
    (folder / "other.csv").write_text(log_text(seed=2))
    for second in ("log.csv", "copy.csv"):
        done = run(*command, folder / "log.csv", folder / second)
        assert done.returncode == 3 and second in done.stderr and "give every log once" in done.stderr, done.stderr
    assert run(*command, folder / "log.csv", folder / "other.csv").returncode == 0


def test_exports_that_overlap_are_refused(folder):
    """The last 1500 s of one log are the first of another: they would count twice.  Stretches of 64 s are compared."""
    head, *rows = log_text(n=6000).split("t_s,temp_degc,gx_dph\n")
    rows = rows[0].splitlines()
    for name, part in (("first.csv", rows[:4000]), ("second.csv", rows[2500:])):
        (folder / name).write_text(head + "t_s,temp_degc,gx_dph\n" + "\n".join(part) + "\n")
    done = run("calibrate", "fit", "--method", "poly", folder / "first.csv", folder / "second.csv")
    assert done.returncode == 3 and "second.csv: its rates from 2561 s on are those of" in done.stderr, done.stderr
    assert "must not count twice" in done.stderr and done.stderr.count("\n") == 1


@pytest.mark.parametrize("counts", ["1e30", "0", "-5", "7.5"])
def test_full_scale_that_no_converter_has_is_refused(folder, counts):
    """It went into the table as a number that the machine made of it."""
    (folder / "scale.csv").write_text(log_text().replace("t_s,", f"# gx_full_scale_counts = {counts}\nt_s,"))
    done = run("calibrate", "fit", "--method", "poly", folder / "scale.csv", "--serial", "A", "-o", folder / "t.json")
    assert done.returncode == 3 and "gx_full_scale_counts: expected a whole number from 1" in done.stderr, done.stderr
    assert not (folder / "t.json").exists()


def test_a_filter_model_of_another_unit_is_refused(folder):
    done = run("profile", "error", folder / "profile.json", "--model", folder / "model.json", "--order", "3", "--filter-model", folder / "accel.json")
    assert done.returncode == 3 and "accel.json" in done.stderr and "mg" in done.stderr and "one sensor" in done.stderr


@pytest.mark.parametrize("command", ["errormodel expect model.json --nominal accel.json", "errormodel validate --model model.json --nominal accel.json --runs 2",
                                     "errormodel sensitivity --model model.json --versus accel.json --types av",
                                     "errormodel separation --model model.json --versus accel.json --types av --draws 1",
                                     "errormodel fit log.csv --markov 1 --bootstrap 0 --nominal accel.json",
                                     "errormodel check log.csv --model model.json --nominal accel.json",
                                     "dp log.csv --nominal accel.json", "dp log.csv --ci-model accel.json", "dp log.csv --stream --ci-model accel.json"])
def test_models_of_two_sensors_are_not_compared(folder, command):
    (folder / "accel.json").write_text(json.dumps({"imucal_model": 1, "unit": "mg", "white_mg_rt_hz": 0.15, "markov": [{"sigma_mg": 1, "tau_s": 100}]}))
    done = run(*[folder / word if word.endswith((".json", ".csv")) else word for word in command.split()])
    assert done.returncode == 3 and "mg" in done.stderr and "sensor" in done.stderr, done.stderr


@pytest.mark.parametrize("command", [("dp", "--no-ratios"), ("errormodel", "fit", "--markov", "1", "--bootstrap", "0"),
                                     ("calibrate", "fit", "--method", "poly")])
def test_times_in_milliseconds_are_remarked(folder, command):
    (folder / "ms.csv").write_text(log_text(step_s=1000))
    said = run(*command, folder / "ms.csv").stderr
    assert "ms.csv" in said and "1000 s apart" in said and "milliseconds" in said
    assert "1000 s apart" not in run(*command, folder / "log.csv").stderr


@pytest.mark.parametrize("command", [("dp", "--no-ratios"), ("dp", "--stream"), ("errormodel", "fit", "--markov", "1", "--bootstrap", "0"),
                                     ("calibrate", "fit", "--method", "poly")])
@pytest.mark.parametrize("step_s, words", [(7, "left out"), (0.5, "average them to seconds")])
def test_rows_that_are_no_second_apart_are_remarked(folder, command, step_s, words):
    (folder / "step.csv").write_text(log_text(step_s=step_s))
    done = run(*command, folder / "step.csv")
    assert f"step.csv: rows are {step_s} s apart, not 1 s" in done.stderr and words in done.stderr
    assert done.stderr.count("apart") == 1
    assert "apart" not in run(*command, folder / "log.csv").stderr


def test_a_table_counts_seconds_and_not_rows(folder):
    (folder / "step.csv").write_text(log_text(step_s=0.5))
    done = run("calibrate", "fit", "--method", "poly", "--serial", "1", "--max-error", "1e6", *[w for r in ("temp-ramp", "no-noise", "repeated", "span")
               for w in ("--accept", r)], folder / "step.csv", "-o", folder / "step.json")
    assert "4000 rows of 0.5 s" in done.stdout, done.stdout + done.stderr
    assert json.loads((folder / "step.json").read_text())["axes"][0]["n_seconds"] == 2000


def test_temperatures_in_kelvin_are_remarked(folder):
    (folder / "kelvin.csv").write_text(log_text(kelvin=273.15))
    assert "kelvin?" in run("calibrate", "fit", "--method", "poly", folder / "kelvin.csv").stderr
    assert "kelvin?" not in run("calibrate", "fit", "--method", "poly", folder / "log.csv").stderr
    profile_error = ("profile", "error", "--model", folder / "model.json", "--order", "3")
    assert "kelvin.csv" in (said := run(*profile_error, folder / "kelvin.csv").stderr) and "kelvin?" in said
    assert "kelvin?" not in run(*profile_error, folder / "log.csv").stderr


@pytest.mark.parametrize("given, words", [({"kelvin": 273.15}, "kelvin?"), ({"step_s": 1000}, "milliseconds?")])
def test_no_table_in_other_units_in_silence(folder, given, words):
    (folder / "units.csv").write_text(log_text(**given))
    fit = ("calibrate", "fit", "--method", "poly", folder / "units.csv", "--serial", "1", "-o", folder / "t.json", "--json", folder / "r.json")
    done = run(*fit)
    assert done.returncode == 1 and words in done.stderr and not (folder / "t.json").exists(), done.stderr
    assert [r["rule"] for r in json.loads((folder / "r.json").read_text())["judgement"]["reasons"]] == ["units"]
    assert run(*fit, "--accept", "units").returncode == 0 and (folder / "t.json").exists()


def test_a_log_that_names_no_device_is_remarked(folder):
    """Beside one that does: it may be of another device."""
    (folder / "named.csv").write_text(log_text(seed=2).replace("t_s,", "# serial = 7.0\nt_s,"))
    fit = ("calibrate", "fit", "--method", "poly")
    for logs in (("named.csv", "log.csv"), ("log.csv", "named.csv")):
        done = run(*fit, *(folder / log for log in logs))
        assert done.returncode == 0 and "log.csv: no # serial" in done.stderr and "7.0" in done.stderr, done.stderr
    assert "serial" not in run(*fit, folder / "log.csv").stderr
    assert "serial" not in run(*fit, *(folder / log for log in logs), "--ignore-metadata").stderr
