# SPDX-License-Identifier: MIT
"""Files as people have them: each is read, or refused with status 3, its name and line and what to do; and results that
cannot be written end with status 3 and leave what was there."""
import gzip
import json
import pathlib
import subprocess

import pytest

from reference import BASIC, MODEL
from where import BIN

PROFILE = {"imucal_profile": 1, "start_degc": 0, "segments": [{"rate_degc_per_min": 2, "to_degc": 60}]}


def run(*arguments, stdin=None, stdout=subprocess.PIPE, cwd=None):
    return subprocess.run([str(a) for a in arguments], input=stdin, stdout=stdout, stderr=subprocess.PIPE, timeout=60, cwd=cwd)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("bad")
    (path / "model.json").write_text(json.dumps(MODEL))
    (path / "profile.json").write_text(json.dumps(PROFILE))
    result = run(BIN / "gyrosim", "log", "--model", path / "model.json", "--profile", path / "profile.json", "-o", path / "log.csv")
    assert result.returncode == 0, result.stderr
    return path


def expect(model_path, *more):
    return run(BIN / "errormodel", "expect", model_path, "--tau", "2:20:2", *more)


def refused(result, *parts):
    assert result.returncode == 3, (result.returncode, result.stderr)
    for part in parts:
        assert part.encode() in result.stderr, result.stderr
    assert b"internal error" not in result.stderr and b"out of memory" not in result.stderr
    assert not any(byte < 32 and byte not in (9, 10) for byte in result.stderr), result.stderr


# ---- JSON ----

@pytest.mark.parametrize("text, parts", [
    ('{"imucal_model": 1, "arw_deg_rt_h": 0.6,\n "markow": []}', ("bad.json", "markow", 'did you mean "markov"')),
    ('{"imucal_model": 1, "arw_deg_rt_h": 0.6,\n "markov": [{"sigma_dph": 2, "tau": 1}]}', ("markov[0]", '"tau_s"')),
    ('{"imucal_model": 1, "arw_deg_rt_h": 0.6,\n "markov": [],\n "arw_deg_rt_h": 6}', ("bad.json:3", "arw_deg_rt_h", "twice")),
    ('{"imucal_model": 1, "markov": []}', ("bad.json", "arw_deg_rt_h", "missing")),
    ('{"imucal_model": 1,\n "arw_deg_rt_h": 1e999}', ("bad.json:2", "1e999", "too large")),
    ('{"imucal_model": 1,\n "arw_deg_rt_h": "0.6"}', ("arw_deg_rt_h", "expected a number")),
    ('{"imucal_model": 1,\n "arw_deg_rt_h": }', ("bad.json:2", "not valid JSON")),
    ('{"imucal_model": 1, "arw_deg_rt_h": 0.6, "bias": {"t0_degc": 1e30, "range_degc": 1, "coeff_dph": [1]}}', ("t0_degc", "outside")),
    ('{"imucal_model": 2, "arw_deg_rt_h": 0.6}', ("version",)),
    ('{"imucal_model": 1, "arw_deg_rt_h": 0.6, "\\u001b[31mred": 1}', ("unknown field", "\\x1b")),
    ("", ("bad.json", "not valid JSON")),
    ("[1, 2]", ("expected an object",)),
])
def test_bad_models_are_refused_with_their_place(folder, text, parts):
    (folder / "bad.json").write_text(text)
    refused(expect(folder / "bad.json"), *parts)


@pytest.mark.parametrize("change, parts", [
    (lambda p: p.update(repeats=2), ("repeats", '"repeat"')),
    (lambda p: p["segments"].append({"rate_degc_per_min": 1, "to_degC": 3}), ("to_degC", '"to_degc"')),
    (lambda p: p.update(repeat=10000, segments=[{"rate_degc_per_min": 0, "duration_s": 1e9}]), ("366",)),
    (lambda p: p["segments"].append({"rate_degc_per_min": 1, "to_degc": 1e30}), ("to_degc", "outside")),
])
def test_bad_profiles_are_refused(folder, change, parts):
    profile = json.loads(json.dumps(PROFILE))
    change(profile)
    (folder / "bad_profile.json").write_text(json.dumps(profile))
    refused(run(BIN / "gyrosim", "log", "--model", folder / "model.json", "--profile", folder / "bad_profile.json", "-o", folder / "x.csv"), *parts)


def test_words_of_refusals_say_what_to_do(folder):
    """Another of our files than asked for, a syntax error in our own words, a known name once."""
    refused(expect(folder / "profile.json"), b'"imucal_model" is missing'.decode(), "a profile (imucal_profile)", "an error model")
    (folder / "syntax.json").write_text('{"imucal_model": 1,\n "arw_deg_rt_h": 0.6,,}')
    result = expect(folder / "syntax.json")
    refused(result, "syntax.json:2: not valid JSON")
    assert b"json.exception" not in result.stderr and b"parse error" not in result.stderr, result.stderr
    (folder / "unknown.json").write_text('{"imucal_model": 1, "arw_deg_rt_h": 0.6, "nothing_like_it": 1}')
    known = expect(folder / "unknown.json").stderr.decode().split("known: ")[1].split(")")[0].split(", ")
    assert len(known) == len(set(known)) and "arw_deg_rt_h" in known


@pytest.mark.parametrize("row, parts", [
    ("3,20,5,6,7", (":4:", "expected 3 fields, found 5", "header")), ("3,20", (":4:", "expected 3 fields, found 2", "header")),
    ("3,20,1e13", (":4:", "beyond +-1e12", "leave it empty"))])
def test_rows_that_are_none_say_what_to_do(folder, row, parts):
    (folder / "row.csv").write_text(f"t_s,temp_degc,gx_dph\n1,20,5\n2,20,5\n{row}\n4,20,5\n")
    refused(run(BIN / "dp", folder / "row.csv"), "row.csv", *parts)


@pytest.mark.parametrize("program", [("montecarlo", "--order", 3), ("gyrosim", "log", "-o", "x.csv")])
@pytest.mark.parametrize("rate", ["0", "-5", "nan", "inf"])
def test_raw_rates_that_cannot_be_are_usage_errors(folder, program, rate):
    result = run(BIN / program[0], *program[1:], "--model", folder / "model.json", "--profile", folder / "profile.json", f"--rate-hz={rate}", cwd=folder)
    assert result.returncode == 2 and b"--rate-hz" in result.stderr, result.stderr


def test_help_shows_the_raw_rate_that_is_taken():
    said = run(BIN / "montecarlo", "--help").stdout.decode()
    assert "--rate-hz FLOAT:POSITIVE=10 " in " ".join(said.split()) + " ", [line for line in said.splitlines() if "rate-hz" in line]
    assert "--counts-scale-dph FLOAT:POSITIVE=1 " in " ".join(said.split()) + " "


def test_byte_order_mark_gzip_and_standard_input_are_read(folder):
    text = (folder / "model.json").read_bytes()
    plain = expect(folder / "model.json").stdout
    (folder / "bom.json").write_bytes(b"\xef\xbb\xbf" + text)
    (folder / "model.json.gz").write_bytes(gzip.compress(text))
    assert expect(folder / "bom.json").stdout == plain and expect(folder / "model.json.gz").stdout == plain
    assert run(BIN / "errormodel", "expect", "-", "--tau", "2:20:2", stdin=text).stdout == plain
    log = (folder / "log.csv").read_bytes()
    curves = json.loads(run(BIN / "dp", folder / "log.csv", "--json", "-").stdout)["curves"]
    for name, content in {"bom.csv": b"\xef\xbb\xbf" + log, "crlf.csv": log.replace(b"\n", b"\r\n"), "log.csv.gz": gzip.compress(log)}.items():
        (folder / name).write_bytes(content)
        result = run(BIN / "dp", folder / name, "--json", "-")
        assert result.returncode == 0, result.stderr
        assert json.loads(result.stdout)["curves"][0]["dp_dph"] == curves[0]["dp_dph"]
    result = run(BIN / "dp", "-", "--json", "-", stdin=gzip.compress(log))
    assert json.loads(result.stdout)["curves"][0]["dp_dph"] == curves[0]["dp_dph"], result.stderr


# ---- logs ----

HEADER = "t_s,temp_degc,gx_dph\n"
ROWS = "".join(f"{i},{20 + i / 100:.2f},{(i * 37) % 11}\n" for i in range(600))


@pytest.mark.parametrize("text, parts", [
    ("", ("bad.csv:1", "no header")),
    (HEADER, ("bad.csv:1", "no whole row")),
    ("time,temp,gx\n" + ROWS, ("bad.csv:1", "header must be", "imucal import")),
    (HEADER + "0,20,warm\n", ("bad.csv:2", "gx_dph", "warm")),
    (HEADER + "0,20,1e30\n", ("bad.csv:2", "gx_dph")),
    (HEADER + "0,20,nan\n", ("bad.csv:2", "finite")),
    (HEADER + "0,1e30,1\n", ("bad.csv:2", "temp_degc")),
    (HEADER + "0,-300,1\n", ("bad.csv:2", "temp_degc")),
    (HEADER + "0,20\n", ("bad.csv:2", "fields")),
    (HEADER + "0,20,1,2\n", ("bad.csv:2",)),
    (HEADER + "0,20,1\n0,20,1\n", ("bad.csv:3", "does not increase")),
    (HEADER + ROWS + "1732190000,20,1\n", ("bad.csv:602", "jumps", "clock")),
    (HEADER + "".join(f"{i + (i * i * 7 % 10) / 11:.3f},20,{i}\n" for i in range(300)), ("bad.csv:", "irregular")),
    (HEADER + "0,20,\x1b[31mred\n", ("bad.csv:2", "\\x1b")),
    ("t_s,temp_degc,g\x1b[31mx_dph\n" + ROWS, ("bad.csv:1", "column 3")),
    (HEADER + "0,20," + "9" * 5000 + "\n", ("bad.csv:2",)),
    ("t_s,temp_degc,gx_dph,gx_flags\n0,20,1,1e11\n", ("bad.csv:2", "gx_flags")),
    ("t_s,temp_degc,gx_counts\n0,20,1\n", ("bad.csv:1", "gx_counts_scale_dph")),
    ("# rate_hz = 10\n# gx_counts_scale_dph = 1\nt_s,temp_degc,gx_counts\n0,20,1.5\n", ("bad.csv:4", "gx_dph")),
])
@pytest.mark.parametrize("program", ["fit", "dp"])
def test_bad_logs_are_refused_with_file_and_line(folder, text, parts, program):
    (folder / "bad.csv").write_text(text)
    if program == "fit":
        result = run(BIN / "calibrate", "fit", folder / "bad.csv", "--method", "poly", "-o", folder / "never.json")
    elif "irregular" in parts:
        pytest.skip("dp reads in bounded memory: it refuses rows within half a step, not uneven ones")
    else:
        result = run(BIN / "dp", folder / "bad.csv")
    refused(result, *parts)
    assert not (folder / "never.json").exists()


UNEVEN = "".join(f"{i},{20 + i / 100:.2f},{i * i * i * 7919 % 997}\n" for i in range(600))
CUT = UNEVEN + "600,26.00,3354"  # of 33541?


@pytest.mark.parametrize("arguments", [("calibrate", "fit", "LOG", "--method", "poly"), ("dp", "LOG"), ("errormodel", "fit", "LOG", "--criterion", "ml"), ("dp", "-")],
                         ids=" ".join)
def test_last_row_without_line_end_is_left_out_and_said(folder, arguments):
    """The answer is that of the log without the row, and one line of standard error names file, line and remedy."""
    answers = []
    for name, text in ("whole.csv", HEADER + UNEVEN), ("short.csv", HEADER + CUT):
        (folder / name).write_text(text)
        program, *rest = (name if a == "LOG" else a for a in arguments)
        result = run(BIN / program, *rest, "--json", "-", "-q", cwd=folder, stdin=text.encode() if "-" in arguments else None)
        assert result.returncode in (0, 1), result.stderr
        answers.append((result.stdout.decode().replace(name, "LOG"), result.stderr.decode()))
    assert answers[0][0] == answers[1][0]
    said = [line for line in answers[1][1].splitlines() if "line end" in line]
    place = "standard input:602" if "-" in arguments else "short.csv:602"
    assert len(said) == 1 and said[0].startswith(f"{arguments[0]}: note: {place}: ") and "left out; end it" in said[0]
    assert "line end" not in answers[0][1]


def test_last_sample_without_line_end_is_left_out_and_said(folder):
    head = "# imucal-log = 1\n# rate_hz = 4\n# gx_counts_scale_dph = 18\nt_s,temp_degc,gx_counts\n"
    samples = "".join(f"{i / 4:.2f},24.81,{20 + i % 3}\n" for i in range(400))
    (folder / "raw.csv").write_text(head + samples + "100.00,24.81,2")
    result = run(BIN / "dp", "raw.csv", cwd=folder)
    assert result.returncode == 0 and b"raw.csv:405: the last row has no line end" in result.stderr


@pytest.mark.parametrize("criterion", ["bound", "ls", "ml"])
def test_values_that_repeat_themselves_are_no_noise_to_fit(folder, criterion):
    (folder / "bad.csv").write_text(HEADER + "".join(f"{i},20,{i * 37 % 11}\n" for i in range(600)))
    refused(run(BIN / "errormodel", "fit", folder / "bad.csv", "--criterion", criterion), "bad.csv: axis gx_dph", "11 s", "repeat themselves")


@pytest.mark.parametrize("content, parts", [
    ("utf16", ("UTF-16",)), ("cut gzip", ("gzip", "early")), ("damaged gzip", ("cannot be read",)), ("folder", ("folder",)),
    ("absent", ("No such file",)), ("binary", ("bad.bin:1", "header")),
])
def test_files_that_are_no_text(folder, content, parts):
    path = folder / "bad.bin"
    log = (folder / "log.csv").read_bytes()
    packed = gzip.compress(log)
    data = {"utf16": log.decode().encode("utf-16"), "cut gzip": packed[: len(packed) // 2],
            "damaged gzip": packed[:200] + bytes(50) + packed[250:], "binary": bytes(range(256)) * 20}
    if content in data:
        path.write_bytes(data[content])
    else:
        path = folder if content == "folder" else folder / "absent.csv"
    refused(run(BIN / "calibrate", "fit", path, "--method", "poly"), *parts)


def test_an_unknown_axis_is_answered_with_the_nearest(folder):
    refused(run(BIN / "dp", folder / "log.csv", "--axis", "gx_dhp"), 'did you mean "gx_dph"')


# ---- numbers on the command line, options before and after ----

@pytest.mark.parametrize("words", [
    ["gyrosim", "log", "--model", "model.json", "--profile", "profile.json", "-o", "x.csv", "--seed", "-1"],
    ["gyrosim", "log", "--model", "model.json", "--profile", "profile.json", "-o", "x.csv", "--seed", "1.5"],
    ["profile", "bound", "--model", "model.json", "--order", "3", "--duration-s", "inf"],
    ["profile", "bound", "--model", "model.json", "--order", "3", "--duration-s", "nan"],
    ["errormodel", "expect", "model.json", "--dt-s", "inf"],
    ["montecarlo", "--model", "model.json", "--profile", "profile.json", "--order", "3", "--runs", "1", "--seed", "99999999999999999999"],
])
def test_numbers_that_are_none_are_a_usage_error(folder, words):
    result = run(BIN / words[0], *words[1:], cwd=folder)
    assert result.returncode == 2, (result.returncode, result.stderr)


def test_common_options_stand_before_or_after_the_subcommand(folder):
    after = run(BIN / "errormodel", "expect", folder / "model.json", "--tau", "2:20:2", "--json", "-")
    before = run(BIN / "errormodel", "--json", "-", "expect", folder / "model.json", "--tau", "2:20:2")
    assert after.returncode == before.returncode == 0, before.stderr
    assert json.loads(before.stdout) == json.loads(after.stdout)
    arguments = ["log", "--model", folder / "model.json", "--profile", folder / "profile.json", "-o", folder / "q.csv"]
    quiet = run(BIN / "gyrosim", "-q", "--seed", "5", *arguments)
    assert quiet.returncode == 0 and quiet.stdout == b""
    talking = run(BIN / "gyrosim", *arguments, "--seed", "5")
    assert b"seed 5" in talking.stdout


# ---- the temperature's part is no noise ----

def test_errormodel_takes_out_what_follows_the_temperature(folder):
    (folder / "long.json").write_text(json.dumps(BASIC))
    log = folder / "long.csv"
    run(BIN / "gyrosim", "log", "--model", folder / "model.json", "--profile", folder / "long.json", "-o", log)
    fit = [BIN / "errormodel", "fit", log, "--markov", 1, "--criterion", "ml", "--bootstrap", 0, "--json", "-"]
    default = run(*fit)
    assert default.returncode == 0 and b"follows the temperature" in default.stderr
    result = json.loads(default.stdout)
    assert result["detrend"] == "poly:3"
    assert 12 < result["model"]["markov"][0]["sigma_dph"] < 30  # truth: 20; with the trend 120 and more
    kept = run(*fit, "--detrend", "mean")
    assert b"counts as noise" in kept.stderr and json.loads(kept.stdout)["model"]["markov"][0]["sigma_dph"] > 60
    assert b"note" not in run(*fit, "--detrend", "poly:3").stderr
    # a log without a trend is left as it is
    flat = dict(MODEL, bias=dict(MODEL["bias"], coeff_dph=[80]))
    (folder / "flat.json").write_text(json.dumps(flat))
    run(BIN / "gyrosim", "log", "--model", folder / "flat.json", "--profile", folder / "long.json", "-o", log)
    assert json.loads(run(*fit).stdout)["detrend"] == "mean"


def test_dp_alone_shows_the_allan_deviation(folder):
    result = run(BIN / "dp", folder / "log.csv", "--json", "-")
    assert result.returncode == 0, result.stderr
    assert {c["type"] for c in json.loads(result.stdout)["curves"]} == {"av"}


# ---- what cannot be written ----

def test_a_result_that_cannot_be_written_is_status_3(folder):
    with open("/dev/full", "w") as full:
        for words in (["errormodel", "expect", "model.json", "--tau", "2:20:2"],
                      ["errormodel", "expect", "model.json", "--tau", "2:20:2", "--json", "-"],
                      ["gyrosim", "log", "--model", "model.json", "--profile", "profile.json", "-o", "-"]):
            result = run(BIN / words[0], *words[1:], stdout=full, cwd=folder)
            assert result.returncode == 3 and b"No space left" in result.stderr, result.stderr
    for target, reason in (("/dev/full", b"No space left"), (folder, b"folder"), (folder / "no/such/x.json", b"No such")):
        result = expect(folder / "model.json", "--json", target)
        assert result.returncode == 3 and reason in result.stderr, (target, result.stderr)
    assert expect(folder / "model.json", "--json", "/dev/null").returncode == 0 and pathlib.Path("/dev/null").is_char_device()


def test_a_link_stays_a_link_and_a_failed_run_leaves_the_old_file(folder):
    real, link = folder / "real.json", folder / "link.json"
    real.write_text("old")
    link.symlink_to(real)
    assert expect(folder / "model.json", "--json", link).returncode == 0
    assert link.is_symlink() and json.loads(real.read_text())["type"] == "av"
    table = folder / "table.json"
    table.write_text("old")
    (folder / "bad.csv").write_text(HEADER + "0,20,warm\n")
    run(BIN / "calibrate", "fit", folder / "bad.csv", "--method", "poly", "-o", table)
    assert table.read_text() == "old"
    assert not list(folder.glob("*.part*"))


def test_a_recording_that_was_cut_off_is_recovered(folder):
    part = folder / "cut.csv.part"
    part.write_text("# imucal-log = 1\n# serial = 7\nt_s,temp_degc,gx_dph\n1,20,5\n2,20,6\n3,20,")
    refused(run(BIN / "calibrate", "recover", part, "-o", folder / "log.csv"), "log.csv", "--force")
    result = run(BIN / "calibrate", "recover", part)
    assert result.returncode == 0 and b"2 seconds" in result.stdout, result.stderr
    assert (folder / "cut.csv").read_text().splitlines()[-1] == "2,20,6" and not part.exists()
    part.write_text("# imucal-log = 1\nt_s,temp_degc,gx_dph\n1,2")
    refused(run(BIN / "calibrate", "recover", part, "--force"), "no whole row")
    assert part.exists()
