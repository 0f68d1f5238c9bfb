# SPDX-License-Identifier: MIT
"""`imucal check` on models, profiles and tables: it says of a file what the programs say that read it; and `imucal export` writes
nothing of what it refuses."""
import copy
import json
import re
import subprocess

import pytest

from imucal.__main__ import main
from where import BIN, ROOT

EXAMPLES = dict(re.findall(r"<!-- example: (\S+) -->\n```\w*\n(.*?)```", (ROOT / "host/formats.md").read_text(encoding="utf-8"), re.S))
MODEL, PROFILE, TABLE = (json.loads(EXAMPLES[name]) for name in ("model.json", "chamber.json", "table.json"))


def but(example, **changes):
    """A copy with members changed: a name such as axes__0__order is a path; None takes a member away."""
    result = copy.deepcopy(example)
    for path, value in changes.items():
        *way, last = [int(k) if k.isdigit() else k for k in path.split("__")]
        place = result
        for key in way:
            place = place[key]
        if value is None:
            del place[last]
        else:
            place[last] = value
    return json.dumps(result, indent=1)


def says(program, folder, name):
    """(status, words) of the program that reads this kind."""
    (folder / "good.json").write_text(EXAMPLES["model.json"])
    words = {"model": ["gyrosim", "log", "--model", name, "--profile", "good_profile.json", "-o", "/dev/null", "--quiet"],
             "profile": ["profile", "error", name, "--model", "good.json", "--order", "1", "--json", "/dev/null", "--quiet"],
             "table": ["calibrate", "--port", str(folder / "no port"), "verify", name]}[program]
    (folder / "good_profile.json").write_text('{"imucal_profile": 1, "start_degc": 20, "segments": [{"rate_degc_per_min": 0, "duration_s": 60}]}')
    done = subprocess.run([BIN / words[0], *words[1:]], cwd=folder, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stderr


def two_fields(text, name):
    """The member again, at the end of the file's first object."""
    member = re.search(rf'"{name}": [^,\n]+', text).group(0)
    return text[:text.rstrip().rindex("}")] + f", {member}}}\n"


# name: (kind, text, valid?, word of the message)
FILES = {
    "model": ("model", but(MODEL), True, ""),
    "model with a comment": ("model", but(MODEL, comment="from the data sheet", _seen="2026-11-21"), True, ""),
    "model of an accelerometer": ("model", EXAMPLES["accel.json"], True, ""),
    "model with NaN": ("model", but(MODEL).replace("0.6", "NaN"), False, "NaN"),
    "model with -Infinity": ("model", but(MODEL).replace("0.6", "-Infinity"), False, "-Infinity"),
    "model with a field twice": ("model", two_fields(but(MODEL), "arw_deg_rt_h"), False, "twice"),
    "model with a huge ARW": ("model", but(MODEL, arw_deg_rt_h=1e9), False, "arw_deg_rt_h"),
    "model with 1e999": ("model", but(MODEL).replace("0.6", "1e999"), False, "1e999"),
    "model with a number of 5000 digits": ("model", but(MODEL).replace("0.6", "9" * 5000), False, "is too large"),
    "model with an unknown effect": ("model", but(MODEL, effects__0__name="thermal_hysteresys"), False, "thermal_hysteresys"),
    "model with an effect's parameter of another name": ("model", but(MODEL, effects__0__parameters={"amplitude": 3}), False, "amplitude"),
    "model with a short time constant": ("model", but(MODEL, markov__0__tau_s=1e-9), False, "markov[0].tau_s"),
    "model with a range of nearly 0": ("model", but(MODEL, bias__range_degc=1e-9), False, "bias.range_degc"),
    "model 200 lists deep": ("model", but(MODEL, effects__0__parameters={"x": json.loads("[" * 200 + "]" * 200)}), False, "deep"),
    "profile": ("profile", but(PROFILE), True, ""),
    "profile of a furnace": ("profile", but(PROFILE, segments__1__to_degc=5000), False, "to_degc"),
    "profile of years": ("profile", but(PROFILE, segments__0__duration_s=9e8), False, "days"),
    "profile without time": ("profile", but(PROFILE, segments=[{"rate_degc_per_min": 0, "duration_s": 0.5}]), False, "less than one second"),
    "profile with NaN": ("profile", but(PROFILE).replace("1200", "NaN", 1), False, "NaN"),
    "table": ("table", but(TABLE), True, ""),
    "table with NaN": ("table", but(TABLE).replace("300", "NaN"), False, "NaN"),
    "table with a field twice": ("table", two_fields(but(TABLE), "sequence"), False, "twice"),
    "table with too few coefficients": ("table", but(TABLE, axes__0__coeff_dph=[1, 2, 3]), False, "coeff_dph"),
    "table of order 9": ("table", but(TABLE, axes__0__order=9), False, "order"),
    "table with a negative sigma": ("table", but(TABLE, axes__0__sigma_dph=[-1] * 9), False, "sigma_dph"),
    "table with a huge coefficient": ("table", but(TABLE, axes__0__coeff_dph=[80, 300, 1e30, -100]), False, "coeff_dph"),
    "table with a span turned round": ("table", but(TABLE, axes__0__span_degc=[60, 0]), False, "span_degc"),
    "table with a span far beyond its polynomial": ("table", but(TABLE, axes__0__span_degc=[-500, 600]), False, "span"),
    "table without errors": ("table", but(TABLE, axes__0__sigma_dph=None), False, "sigma_dph"),
    "table without a model": ("table", but(TABLE, axes__0__model=None), False, "model"),
    "table with an unknown field": ("table", but(TABLE, axes__0__colour="red"), False, "colour"),
}
#: refused by check alone: the programs read less of a table than it says
ONLY_CHECK = {
    "table with an axis twice": ("table", but(TABLE, axes=[TABLE["axes"][0]] * 2), False, "gx_dph"),
    "table with temperatures out of order": ("table", but(TABLE, axes__0__temp_degc=[0, 60, 15, 22.5, 30, 37.5, 45, 52.5, 7.5]), False, "temp_degc"),
    "table with temperatures of another span": ("table", but(TABLE, axes__0__temp_degc=[10 * i for i in range(9)]), False, "temp_degc"),
}
ALL = {**FILES, **ONLY_CHECK}


@pytest.mark.parametrize("name", FILES)
def test_check_and_the_programs_agree(tmp_path, name, capsys):
    kind, text, is_valid, word = FILES[name]
    path = tmp_path / "file.json"
    path.write_text(text)
    status, words = says(kind, tmp_path, "file.json")
    assert (status == 3) == (not is_valid), words
    assert main(["check", str(path)]) == (0 if is_valid else 3)
    said = capsys.readouterr()
    assert is_valid and "a valid " + kind in said.out or re.search(r"file\.json:\d+: ", said.err) and word in said.err, said


@pytest.mark.parametrize("command", [["export", "--to", "px4"], ["export", "--to", "kalibr"], ["plot"]], ids=" ".join)
def test_a_log_in_the_place_of_json_is_named_with_the_remedy(tmp_path, command, capsys):
    path = tmp_path / "log.csv"
    path.write_text("# imucal-log = 1\nt_s,temp_degc,gx_dph\n1,25,3\n")
    assert main([command[0], str(path), *command[1:], "-o", str(tmp_path / "out.png")]) == 3
    assert f"log.csv:1: no JSON (column 1: Expecting value); imucal check {path} tells what it is" in capsys.readouterr().err


@pytest.mark.parametrize("text, words", [
    (but(TABLE, serial=None), 'field "serial" is missing'), (but(MODEL, tau=5), 'unknown field "tau" (known: imucal_model, '),
    (but(MODEL, markov__0=3), "markov[0]: expected an object, found 3"),
    (but(TABLE, axes=[]), "axes: expected 1 or more, found 0"),
    (but(TABLE, axes__0__temp_degc=[1, 2]), "axes[0].temp_degc: expected 9 or more, found 2"),
    (but(TABLE, axes__0__span_degc=[0, 30, 60]), "axes[0].span_degc: expected 2 at most, found 3"),
    (but(TABLE, axes__0__order="3"), 'axes[0].order: expected a whole number, found "3"')])
def test_what_is_wrong_with_a_file_is_said_in_the_programs_words(tmp_path, text, words, capsys):
    (tmp_path / "file.json").write_text(text)
    assert main(["check", str(tmp_path / "file.json")]) == 3
    assert re.search(rf"file\.json:\d+: {re.escape(words)}", capsys.readouterr().err)


def test_json_in_another_coding_is_refused_with_its_line(tmp_path, capsys):
    path = tmp_path / "file.json"
    path.write_bytes(b'{"imucal_model": 1,\n "name": "M\xfcller"}\n')
    assert says("model", tmp_path, "file.json")[0] == 3
    for command in (["check"], ["export", "--to", "kalibr", "-o", str(tmp_path / "out")]):
        assert main([command[0], str(path), *command[1:]]) == 3
        assert "file.json:2: the byte \\xfc is no UTF-8; save the file as UTF-8" in capsys.readouterr().err


@pytest.mark.parametrize("name", ONLY_CHECK)
def test_check_refuses_what_contradicts_itself(tmp_path, name, capsys):
    (tmp_path / "file.json").write_text(ONLY_CHECK[name][1])
    assert main(["check", str(tmp_path / "file.json")]) == 3
    said = capsys.readouterr().err
    assert re.search(r"file\.json:\d+: ", said) and ONLY_CHECK[name][3] in said


@pytest.mark.parametrize("name", [n for n, file in ALL.items() if file[0] != "profile"])
def test_export_writes_what_is_valid_and_nothing_else(tmp_path, name, capsys):
    kind, text, is_valid, word = ALL[name]
    path, out = tmp_path / "file.json", tmp_path / "out"
    path.write_text(text)
    for target in ("c-header", "json") if kind == "table" else ("kalibr", "ros", "matlab", "datasheet"):
        status = main(["export", str(path), "--to", target, "-o", str(out)])
        said = capsys.readouterr()
        assert status == (0 if is_valid else 3), (target, said)
        if not is_valid:
            assert re.search(r"file\.json:\d+: ", said.err) and word.removesuffix("_dph") in said.err and not out.exists(), said


NULL = object()


@pytest.mark.parametrize("example, way", [("model.json", ("markov",)), ("model.json", ("turn_on_sigma_dph",)),
                                          ("table.json", ("axes", 0, "scale_coeff"))])
def test_a_member_that_is_null_is_left_out_as_the_programs_take_it(tmp_path, example, way):
    data = json.loads(EXAMPLES[example])
    place = data
    for key in way[:-1]:
        place = place[key]
    texts = []
    for value in (None, NULL):
        place[way[-1]] = value
        if value is NULL:
            del place[way[-1]]
        (tmp_path / "in.json").write_text(json.dumps(data))
        target = "c-header" if example == "table.json" else "datasheet"
        assert main(["export", str(tmp_path / "in.json"), "--to", target, "-o", str(tmp_path / "out")]) == 0
        texts.append((tmp_path / "out").read_text())
    assert texts[0] == texts[1]


@pytest.mark.parametrize("temp_degc", [5, [None] * 9, ["0"] * 9])
def test_temperatures_of_a_table_that_are_none_are_refused(tmp_path, temp_degc, capsys):
    (tmp_path / "table.json").write_text(but(TABLE, axes__0__temp_degc=temp_degc))
    assert main(["export", str(tmp_path / "table.json"), "--to", "json", "-o", str(tmp_path / "out")]) == 3
    assert "axes[0].temp_degc: expected nine temperatures evenly" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_the_accelerometer_s_model_beside_the_gyro_s_is_checked_too(tmp_path, capsys):
    (tmp_path / "gyro.json").write_text(EXAMPLES["model.json"])
    (tmp_path / "accel.json").write_text(EXAMPLES["accel.json"].replace("0.15", "NaN"))
    assert main(["export", str(tmp_path / "gyro.json"), "--accel", str(tmp_path / "accel.json"), "--to", "kalibr", "-o", str(tmp_path / "out")]) == 3
    assert "accel.json" in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize("options, words", [(["--rate-hz", "-5"], "--rate-hz -5"), (["--rate-hz", "0"], "--rate-hz 0"), (["--rate-hz", "nan"], "--rate-hz nan"),
                                            (["--rate-hz", "inf"], "--rate-hz inf")])
def test_a_rate_that_cannot_be_is_a_usage_error(tmp_path, options, words, capsys):
    (tmp_path / "model.json").write_text(EXAMPLES["model.json"])
    for target in ("kalibr", "ros", "matlab"):
        assert main(["export", str(tmp_path / "model.json"), "--to", target, "-o", str(tmp_path / "out"), *options]) == 2
        assert words in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize("prefix", ["9cal", "my cal", "a-b"])
def test_a_prefix_that_is_no_name_in_c_is_a_usage_error(tmp_path, prefix, capsys):
    (tmp_path / "table.json").write_text(EXAMPLES["table.json"])
    assert main(["export", str(tmp_path / "table.json"), "--to", "c-header", "--prefix", prefix, "-o", str(tmp_path / "out")]) == 2
    assert "--prefix" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_read_table_refuses_what_check_refuses(tmp_path):
    import imucal
    for name in [n for n, file in ALL.items() if file[0] == "table" and not file[2]]:
        (tmp_path / "table.json").write_text(ALL[name][1])
        with pytest.raises(imucal.DataError, match="table.json"):
            imucal.read_table(tmp_path / "table.json")


@pytest.mark.parametrize("target, option", [("json", ["--prefix", "cal"]), ("px4", ["--prefix", "cal"]), ("ardupilot", ["--device-id", "5"]), ("c-header", ["--instance", "1"]),
                                            ("json", ["--rate-hz", "100"]), ("datasheet", ["--rate-hz", "100"]), ("matlab", ["--accel", "x.json"]), ("kalibr", ["--instance", "1"])])
def test_an_option_of_another_target_is_a_usage_error(tmp_path, target, option, capsys):
    is_table = target in ("json", "px4", "ardupilot", "c-header")
    (tmp_path / "in.json").write_text(EXAMPLES["table.json" if is_table else "model.json"])
    assert main(["export", str(tmp_path / "in.json"), "--to", target, "-o", str(tmp_path / "out"), *option]) == 2
    said = capsys.readouterr().err
    assert option[0] in said and f"--to {target}" in said and not (tmp_path / "out").exists()
