# SPDX-License-Identifier: MIT
"""`imucal check` names the line, and `imucal example` makes files that are valid."""
import json
import os
import subprocess

import pytest

from imucal.__main__ import main
from imucal.check import check_file, positions
from where import BIN

MODEL = '{\n "imucal_model": 1,\n "arw_deg_rt_h": 0.6,\n "markov": [\n  {"sigma_dph": 20, "tau_s": 100},\n  {"sigma_dph": 3,\n   "tau_s": 10}\n ]\n}\n'
TABLE = json.dumps({"imucal_table": 1, "serial": "x", "sequence": 1, "created": "2026-11-21T06:22:00Z", "degc_per_count": 0.01, "degc_at_zero": 25,
                    "axes": [{"axis": "gx_dph", "order": 3, "t0_degc": 25, "range_degc": 50, "coeff_dph": [1, 2, 3, 4], "span_degc": [-20, 70],
                              "sigma_dph": [6, 5, 4, 4, 4, 4, 4, 5, 5], "model": {"arw_deg_rt_h": 0.6, "markov": []}, "dph_per_count": 18,
                              "full_scale_counts": 32767, "n_seconds": 8400}]}, indent=1)


@pytest.mark.parametrize("text, line, words", [
    (MODEL.replace("100", "-100"), 5, "markov[0].tau_s"), (MODEL.replace('"tau_s": 10}', '"tau_s": "ten"}'), 7, 'markov[1].tau_s: expected a number, found "ten"'),
    (MODEL.replace('"sigma_dph": 3,', '"sigma": 3,'), 6, "markov[1]"), (MODEL.replace("0.6,", "0.6"), 4, "delimiter"), ("{}", 1, "none of ours"),
    (MODEL.replace('l": 1', 'l": 2'), 2, "expected 1, found 2"), (TABLE.replace('"order": 3', '"order": 2'), 14, "4 coefficients for order 2"),
    (TABLE.replace('"gx_dph"', '"gx"'), 10, "axes[0].axis"), (TABLE.replace('"coeff_dph"', '"coeff"'), 9, "coeff_dph (or coeff_mg) is missing"),
    ("t_s,temp_degc,gx_dph\n1,20,5\n2,20,x\n", 3, "expected a number, found \"x\""), ("t_s,temp_degc,gx_dph\n2,20,5\n1,20,5\n", 3, "does not increase"),
    ("t_s,temp_degc,gx_dph\n1,20,5\n2,20\n", 3, "expected 3 fields"), ("t_s,temp_degc,pressure\n1,20,5\n", None, "no axis column")])
def test_message_names_the_line_and_the_fault(tmp_path, text, line, words):
    (tmp_path / "f").write_text(text)
    _, messages = check_file(tmp_path / "f")
    assert messages and words in messages[0], messages
    assert line is None or messages[0].startswith(f"{tmp_path / 'f'}:{line}:"), messages


@pytest.mark.parametrize("full_scale, per_count, is_valid", [(1, 10, True), (1, 5, False), (32767, 18, True)])
def test_table_whose_bias_the_sensor_could_not_have_shown_is_refused(tmp_path, full_scale, per_count, is_valid):
    """8.146 dph at 70 degC are more than a full scale of 1 count of 5 dph, and less than one of 1 count of 10 dph."""
    table = json.loads(TABLE)
    table["axes"][0].update(full_scale_counts=full_scale, dph_per_count=per_count)
    (tmp_path / "f").write_text(json.dumps(table, indent=1))
    _, messages = check_file(tmp_path / "f")
    words = "axes[0].full_scale_counts: 1 counts are 5 dph, less than the bias of 8.146 dph at 70 degC"
    assert not messages if is_valid else words in messages[0]


@pytest.mark.parametrize("text, kind", [(MODEL, "model"), (TABLE, "table"), ("t_s,temp_degc,gx_dph\n1,20,5\n2,,\n", "log")])
def test_valid_files_pass(tmp_path, text, kind):
    (tmp_path / "f").write_text(text)
    assert check_file(tmp_path / "f") == (kind, [])


def test_positions_find_every_value():
    text = '{"a": [1, {"b": "x, ]}"}, null], "c": {}, "d": []}'
    found = positions(text)
    assert {p: text[i] for p, i in found.items()} == {(): "{", ("a",): "[", ("a", 0): "1", ("a", 1): "{", ("a", 1, "b"): '"', ("a", 2): "n", ("c",): "{", ("d",): "["}


def test_example_is_valid_and_its_script_is_what_is_documented(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("IMUCAL_BIN", str(BIN))
    assert main(["example", str(tmp_path / "ex")]) == 0
    for name in ("model.json", "profile.json", "run1.csv", "run2.csv", "run3.csv"):
        assert check_file(tmp_path / "ex" / name)[1] == []
    assert (tmp_path / "ex/run1.csv").read_text() != (tmp_path / "ex/run2.csv").read_text()
    assert main(["example", str(tmp_path / "ex")]) == 3
    assert "not empty" in capsys.readouterr().err


def test_example_that_cannot_be_made_says_why(tmp_path, capsys):
    (tmp_path / "log.csv").write_text("t_s\n")
    for folder, words in ((tmp_path / "log.csv", "log.csv: is no folder"),
                          (tmp_path / "log.csv/ex", "cannot make the folder: Not a directory"),
                          ("/proc/nope", "/proc/nope: cannot make the folder: ")):
        assert main(["example", str(folder)]) == 3
        said = capsys.readouterr().err
        assert words in said and "name a" in said and said.count("\n") == 1
    assert (tmp_path / "log.csv").read_text() == "t_s\n"


def test_example_ends_in_the_fault_that_was_put_in_and_no_other(tmp_path, monkeypatch):
    monkeypatch.setenv("IMUCAL_BIN", str(BIN))
    main(["example", str(tmp_path), "-q"])
    words = next(line for line in (tmp_path / "run.sh").read_text().splitlines() if " diagnose " in line).split()[1:]
    subprocess.run([str(BIN / "diagnose"), *words[1:], "--quiet", "--threads", "1"], cwd=tmp_path, check=True)
    axis, = json.loads((tmp_path / "diagnosis.json").read_text())["axes"]
    assert axis["verdict"] == "explained" and [e["name"] for e in axis["effects"]] == ["thermal_hysteresis"]
    effect = axis["effects"][0]
    for name, true in (("amplitude_dph", 60), ("width_degc", 10)):
        assert abs(effect["parameters"][name] - true) < 2.5 * effect["std_errors"][name]


def test_example_script_leads_to_a_table_that_names_no_missing_step(tmp_path, monkeypatch):
    """All of run.sh but the diagnosis, whose minutes belong to its own tests."""
    monkeypatch.setenv("IMUCAL_BIN", str(BIN))
    main(["example", str(tmp_path / "ex"), "-q"])
    script = (tmp_path / "ex/run.sh").read_text()
    assert "diagnose --model model.json" in script
    short = "\n".join(line for line in script.splitlines() if not any(w in line for w in ("diagnose", "report", "look")))
    done = subprocess.run(["sh", "-c", short.replace('cd "$(dirname "$0")"', f"cd {tmp_path / 'ex'}")], capture_output=True, text=True,
                          env={**os.environ, "IMUCAL": str(BIN / "imucal")})
    assert done.returncode == 0, done.stderr
    assert check_file(tmp_path / "ex/table.json") == ("table", []) and "bias_fixed" in (tmp_path / "ex/table.h").read_text()


def _limits(tmp_path, **limits):
    table = json.loads(TABLE)
    table["axes"][0].update(temp_degc=[-20 + 11.25 * i for i in range(9)])
    (tmp_path / "table.json").write_text(json.dumps(table))
    (tmp_path / "limits.json").write_text(json.dumps({"imucal_limits": 1, **limits}))
    return main(["check", str(tmp_path / "table.json"), "--limits", str(tmp_path / "limits.json")])


# Of 1 + 2 Tn + 3 Tn^2 + 4 Tn^3 over Tn = -0.9 to 0.9: 8.146 at 70 degC; its slope there (2 + 6 Tn + 12 Tn^2)/50 = 0.3424.
@pytest.mark.parametrize("limits, words", [
    ({"span_degc": [-30, 60]}, "valid from -20 to 70 degC, wanted -30 to 60"), ({"max_sigma": 5.5}, "predicted error 6 dph at -20.0 degC, limit 5.5"),
    ({"max_bias": 8.1}, "bias 8.146 dph at 70.0 degC, limit 8.1"), ({"max_slope_per_degc": 0.3}, "slope 0.34"), ({"axes": ["gz_dph"]}, "gz_dph: the table has no such axis")])
def test_table_beyond_a_limit_is_an_answer(tmp_path, capsys, limits, words):
    assert _limits(tmp_path, **limits) == 1
    assert words in capsys.readouterr().out


def test_accepted_findings_make_the_error_larger(tmp_path, capsys, monkeypatch):
    table = json.loads(TABLE)
    table["axes"][0].update(accepted=["slow"], error_factor=2.5)
    monkeypatch.setitem(globals(), "TABLE", json.dumps(table))
    assert _limits(tmp_path, max_sigma=14) == 1
    said = capsys.readouterr().out
    assert "predicted error, 2.5 times what the table says (slow accepted), 15 dph" in said and "limit 14" in said
    assert _limits(tmp_path, max_sigma=15.1) == 0


@pytest.mark.parametrize("change, words", [({"error_factor": 0.5}, "error_factor"), ({"accepted": "slow"}, "accepted")])
def test_notes_of_a_table_that_are_not_valid_are_refused(tmp_path, change, words):
    table = json.loads(TABLE)
    table["axes"][0].update(change)
    (tmp_path / "t.json").write_text(json.dumps(table))
    assert any(words in message for message in check_file(tmp_path / "t.json")[1])


def test_table_within_its_limits_is_said_to_keep_them(tmp_path, capsys):
    assert _limits(tmp_path, span_degc=[-20, 70], max_sigma=6, max_bias=8.2, max_slope_per_degc=0.35, axes=["gx_dph"]) == 0
    assert "limits.json: kept" in capsys.readouterr().out


@pytest.mark.parametrize("limits, words", [
    ({"max_sigma": -1}, "max_sigma: -1"), ({"max_bais": 5}, "max_bais"), ({}, "no limit"),
    ({"span_degc": [60, 0]}, "span_degc: the lower temperature comes first"),
    ({"span_degc": [20, 20], "max_sigma": 6}, "span_degc: the lower temperature comes first")])
def test_limits_that_are_not_valid_are_refused(tmp_path, capsys, limits, words):
    """Limits that every table keeps would open the gate for all."""
    assert _limits(tmp_path, **limits) == 3
    said = capsys.readouterr().err
    assert "limits.json:1" in said and words in said


def test_limits_need_a_table(tmp_path, capsys):
    (tmp_path / "m.json").write_text(MODEL)
    _limits(tmp_path, max_sigma=6)
    assert main(["check", str(tmp_path / "m.json"), "--limits", str(tmp_path / "limits.json")]) == 3
    assert "none of the files is one" in capsys.readouterr().err


@pytest.mark.parametrize("seed", ["-1", "1.5", "99999999999999999999999"])
def test_an_example_with_a_seed_that_cannot_be_leaves_no_folder(tmp_path, seed, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["example", str(tmp_path / "play"), f"--seed={seed}"])
    assert ended.value.code == 2 and not (tmp_path / "play").exists()
    assert f'argument --seed: expected a whole number 0 .. 2^64 - 1, found "{seed}"' in capsys.readouterr().err


def test_an_example_without_the_simulator_leaves_no_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("imucal.programs.os.access", lambda *_: False)
    monkeypatch.setenv("PATH", "")
    assert main(["example", str(tmp_path / "play")]) == 3
    assert "the program gyrosim is not found" in capsys.readouterr().err and not (tmp_path / "play").exists()
