# SPDX-License-Identifier: MIT
"""No command loses what is there: what it has read, another of its own results, a recording; nor does it leave half of a file behind,
take half of a file for the whole, or answer from numbers that are none."""
import gzip
import json
import os
import resource
import signal
import subprocess
import time

import numpy as np
import pytest

from reference import MODEL
from where import BIN

PROFILE = {"imucal_profile": 1, "start_degc": 0, "segments": [{"rate_degc_per_min": 2, "to_degc": 60}, {"rate_degc_per_min": 2, "to_degc": 0}]}
LIMITS = ("--duration-s", "3600", "--range", "0:60", "--max-rate", "2")


def run(program, *arguments, **how):
    return subprocess.run([str(BIN / program), *map(str, arguments)], capture_output=True, text=True, timeout=120, **how)


def log_text(n=1200, seed=1):
    rng = np.random.default_rng(seed)
    temp = 30 - 30 * np.cos(2 * np.pi * np.arange(n) / n)
    rate = 80 + 5 * temp + 36 * rng.standard_normal(n)
    return "# imucal-log = 1\nt_s,temp_degc,gx_dph\n" + "".join(f"{i + 1},{temp[i]:.3f},{rate[i]:.3f}\n" for i in range(n))


def foreign_text(n):
    return "time_s,gx_dps,gy_dps,gz_dps,temp_c\n" + "".join(f"{i},{0.01 * (i % 7)},{0.02 * (i % 5)},{0.03 * (i % 11)},{20 + i / n}\n" for i in range(n))


def raw_text(*metadata):
    rows = "".join(f"{i / 4:.2f},24.8,{22 + i % 3}\n" for i in range(400))
    return "# imucal-log = 1\n# rate_hz = 4\n" + "".join(f"# {line}\n" for line in metadata) + "t_s,temp_degc,gx_counts\n" + rows


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "log.csv").write_text(log_text())
    (tmp_path / "m.json").write_text(json.dumps(MODEL))
    (tmp_path / "p.json").write_text(json.dumps(PROFILE))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


# ---- what was read ----

@pytest.mark.parametrize("command", [
    "errormodel expect m.json --json m.json", "errormodel expect m.json --json ./m.json",
    "dp log.csv --no-ratios --type dp2 --nominal m.json --json m.json", "errormodel fit log.csv --markov 0 --bootstrap 0 --nominal m.json -o m.json",
    "calibrate fit log.csv --model m.json --serial 1 -o m.json",
    "gyrosim log --model m.json --profile p.json -o m.json", "gyrosim log --model m.json --profile p.json -o p.json",
    "diagnose --model m.json --log gone.csv --model-out m.json", "diagnose --model m.json --log gone.csv --json m.json",
    "gyrosim replay log.csv --to log.csv -q", "gyrosim serve --model m.json --profile p.json --to m.json -q",
    "profile error p.json --model m.json --order 3 --json p.json", "profile bound --model m.json --order 3 --duration-s 3600 --range 0:60 --json m.json",
    "montecarlo --model m.json --profile p.json --order 3 --runs 2 --json m.json",
    "montecarlo --model m.json --profile p.json --order 3 --runs 2 --partial p.json"])
def test_what_was_read_is_not_written_over(folder, command):
    before = contents(folder)
    done = run(*command.split())
    assert done.returncode == 3 and "it is a file that was read; give another name" in done.stderr, (done.returncode, done.stderr)
    assert contents(folder) == before


@pytest.mark.parametrize("command", ["montecarlo --model m.json --profile p.json --order 3 --runs 100000000 --json m.json",
                                     "profile optimize --model m.json --order 3 --duration-s 86400 --range 0:60 --max-rate 2 -o m.json"])
def test_that_is_found_before_the_work(folder, command):
    """Hours of it, but for the reading."""
    before = contents(folder)
    program, *words = command.split()
    done = subprocess.run([BIN / program, *words], cwd=folder, capture_output=True, text=True, timeout=10)
    assert done.returncode == 3 and "m.json: cannot write: it is a file that was read" in done.stderr and contents(folder) == before


def test_the_source_of_an_imported_log_is_not_written_over(folder):
    (folder / "other.csv").write_text(foreign_text(300))
    before = contents(folder)
    done = run("imucal", "dp", "other.csv", "--no-ratios", "--json", "other.csv")
    assert done.returncode == 3 and "other.csv: cannot write: it is a file that was read" in done.stderr and contents(folder) == before, done.stderr


def test_a_page_or_verdict_is_not_written_over_its_source(folder):
    for words in (("report", "d.json", "-o", "d.json"), ("check", "m.json", "--json", "m.json"), ("check", "t.json", "--limits", "m.json", "--json", "m.json")):
        before = contents(folder)
        done = run("imucal", *words)
        assert done.returncode != 0 and contents(folder) == before
        assert words[1] == "d.json" or "give another name" in done.stderr, done.stderr


def test_a_damaged_cache_is_written_anew(folder):
    diagnose = ("diagnose", "--model", "m.json", "--log", "log.csv", "--nulls", "50", "--cache", "kept", "-q")
    assert run(*diagnose).returncode == 0
    kept, = (folder / "kept").iterdir()
    whole = kept.read_text()
    kept.write_text(whole[:40])
    assert run(*diagnose).returncode == 0 and kept.read_text() == whole


def test_a_partial_result_is_not_written_over_by_the_merged_one(folder):
    assert run("montecarlo", "--model", "m.json", "--profile", "p.json", "--order", "3", "--runs", "2", "--partial", "a.json", "-q").returncode == 0
    before = contents(folder)
    assert run("montecarlo", "merge", "a.json", "--json", "a.json").returncode == 3 and contents(folder) == before


# ---- results of one command ----

@pytest.mark.parametrize("command", [
    "errormodel fit log.csv --markov 0 --bootstrap 0 -o x --json x", "errormodel fit log.csv --markov 0 --bootstrap 0 -o x --json ./x",
    "calibrate fit log.csv --method poly -o x --json x", "gyrosim log --model m.json --profile p.json -o x --json x",
    "gyrosim serve --model m.json --profile p.json --to x -o x", "montecarlo --model m.json --profile p.json --order 3 --runs 2 --json x --partial x",
    "calibrate --port /dev/null record -o x --compensated x --force", "calibrate --port /dev/null --json x record -o x",
    "calibrate --port /dev/null run --model m.json -o x --record x", "calibrate --port /dev/null run --model m.json --record x --record-compensated x",
    "profile optimize --model m.json --order 3 --duration-s 3600 --range 0:60 --max-rate 2 -o x --json x", "calibrate recover log.csv -o x --json x",
    "diagnose --model m.json --log log.csv --model-out x --json x"])
def test_two_results_in_one_file_are_refused_before_the_work(folder, command):
    before = contents(folder)
    done = run(*command.split())
    assert done.returncode == 2 and "name one file" in done.stderr and contents(folder) == before, (done.returncode, done.stderr)


def test_results_may_share_what_is_no_file(folder):
    assert run("calibrate", "fit", "log.csv", "--method", "poly", "-o", "/dev/null", "--json", "/dev/null").returncode == 0


@pytest.mark.parametrize("command", ["dp log.csv --no-ratios --json", "gyrosim log --model m.json --profile p.json -o", "calibrate fit log.csv --method poly -o",
                                     "montecarlo --model m.json --profile p.json --order 3 --runs 2 --partial"])
def test_a_result_without_a_name_is_refused(folder, command):
    """As an unset variable of a shell has it."""
    before = contents(folder)
    done = run(*command.split(), "")
    assert done.returncode == 2 and "the name is empty" in done.stderr and contents(folder) == before


# ---- recordings ----

@pytest.mark.parametrize("link", [None, os.symlink, os.link])
def test_recover_onto_itself_keeps_the_recording(folder, link):
    if link:
        link("log.csv", "out.csv")
    before = contents(folder)
    done = run("calibrate", "recover", "log.csv", "-o", "out.csv" if link else "log.csv", "--force")
    assert done.returncode == 3 and "give another name" in done.stderr and contents(folder) == before


def test_recover_reads_before_it_writes(folder):
    (folder / "log.csv.part").write_text(log_text(300) + "5,20,1\n6,20,1\n")
    before = contents(folder)
    for words in (("--force",), ("-o", "new.csv")):
        done = run("calibrate", "recover", "log.csv.part", *words)
        assert done.returncode == 3 and "log.csv.part:303: t_s does not increase" in done.stderr and contents(folder) == before


def test_recover_into_a_pipe_keeps_the_part(folder):
    (folder / "a.part").write_text(log_text(50))
    done = run("calibrate", "recover", "a.part", "-o", "-", "-q")
    assert done.returncode == 0 and done.stdout == log_text(50) and (folder / "a.part").exists()


def test_the_result_of_recover_is_not_written_over_it(folder):
    (folder / "a.csv.part").write_text(log_text(50))
    assert run("calibrate", "recover", "a.csv.part", "--json", "a.csv").returncode == 3 and (folder / "a.csv").read_text() == log_text(50)


# ---- half of a file ----

MEMBERS = {"two": lambda a, b: a + b, "zeros behind": lambda a, b: a + b + bytes(5000)}
DAMAGED = {"a damaged second header": lambda a, b: a + b"\x1e" + b[1:], "another byte of it": lambda a, b: a + b[:1] + b"\x8a" + b[2:],
           "cut to one byte": lambda a, b: a + b[:1], "junk behind": lambda a, b: a + b + b"junk", "cut": lambda a, b: a + b[:-4],
           "a lost byte behind zeros": lambda a, b: a + bytes(10) + b[1:]}


@pytest.mark.parametrize("name", [*MEMBERS, *DAMAGED])
def test_every_member_of_a_packed_log_counts(folder, name):
    text = log_text().encode()
    data = {**MEMBERS, **DAMAGED}[name](gzip.compress(text[:20000]), gzip.compress(text[20000:]))
    (folder / "log.csv.gz").write_bytes(data)
    for done in (run("dp", "log.csv.gz", "--no-ratios", "--json", "-", "-q"), run("dp", "-", "--no-ratios", "--json", "-", "-q", stdin=open("log.csv.gz", "rb"))):
        if name in MEMBERS:
            plain = run("dp", "log.csv", "--no-ratios", "--json", "-", "-q")
            assert done.returncode == 0 and json.loads(done.stdout)["curves"][0]["dp_dph"] == json.loads(plain.stdout)["curves"][0]["dp_dph"]
        else:
            assert done.returncode == 3 and "cannot be read: the gzip data" in done.stderr, (done.returncode, done.stderr)


@pytest.mark.parametrize("size", ["limit", "signal"])
@pytest.mark.parametrize("there", [False, True])
def test_a_write_that_ends_early_leaves_nothing(folder, size, there):
    long = {**PROFILE, "segments": [{"rate_degc_per_min": 0.01, "to_degc": 60}]}
    (folder / "long.json").write_text(json.dumps(long))
    if there:
        (folder / "out.csv").write_text("old")
    before = contents(folder)
    command = ("--model", "m.json", "--profile", "long.json", "-o", "out.csv", "-q")
    if size == "limit":
        done = run("gyrosim", "log", *command, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000)))
        assert done.returncode == 3 and "out.csv: cannot write: File too large" in done.stderr, (done.returncode, done.stderr)
    else:
        child = subprocess.Popen([BIN / "gyrosim", "log", *command])
        while child.poll() is None and not list(folder.glob("out.csv.part*")):
            time.sleep(0.0005)
        child.send_signal(signal.SIGTERM)
        assert child.wait(timeout=60) == -signal.SIGTERM
    assert contents(folder) == before


@pytest.mark.parametrize("delay_s", [0.05, 0.2, 0.5, 1])
@pytest.mark.parametrize("ends", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_import_leaves_no_folder(folder, delay_s, ends):
    (folder / "other.csv").write_text(foreign_text(40000))
    (folder / "tmp").mkdir()
    child = subprocess.Popen([BIN / "imucal", "dp", "other.csv", "-q"], env={**os.environ, "TMPDIR": str(folder / "tmp")}, stderr=subprocess.DEVNULL,
                             start_new_session=True)
    time.sleep(delay_s)
    os.killpg(child.pid, ends)
    child.wait(timeout=60)
    assert not list((folder / "tmp").iterdir())


def test_a_name_as_long_as_the_system_takes_is_written(folder):
    name = "n" * 250
    assert run("dp", "log.csv", "--no-ratios", "--json", name).returncode == 0 and json.loads((folder / name).read_text())
    assert "does the folder exist?" in run("dp", "log.csv", "--no-ratios", "--json", "none/x").stderr
    done = run("dp", "log.csv", "--no-ratios", "--json", "n" * 300)
    assert done.returncode == 3 and "too long" in done.stderr and "folder" not in done.stderr


# ---- numbers that are none ----

@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e400"])
@pytest.mark.parametrize("command", [
    "profile error p.json --model m.json --order 3 --prior-sigma-dph", "profile optimize --model m.json --order 3 {limits} --no-proof --min-soak-s",
    "profile optimize --model m.json --order 3 {limits} --max-correlation", "profile bound --model m.json --order 3 --duration-s 3600 --range 0:60 --prior-sigma-dph",
    "dp log.csv --false-alarm-rate", "errormodel fit log.csv --markov 0 --bootstrap 0 --confidence", "diagnose --model m.json --log log.csv --false-alarm-rate",
    "calibrate --port /dev/null info --timeout-s", "gyrosim serve --model m.json --profile p.json --to /dev/null --accel-scale-mg",
    "gyrosim replay log.csv --to /dev/null --temp-offset-degc", "gyrosim replay log.csv --to /dev/null --speed",
    "gyrosim log --model m.json --profile p.json -o x --temp-noise-degc", "gyrosim log --model m.json --profile p.json -o x --missing",
    "calibrate fit log.csv --model m.json --prior-sigma-dph", "montecarlo --model m.json --profile p.json --order 3 --jitter-s"])
def test_options_are_finite(folder, command, value):
    words = command.format(limits=" ".join(LIMITS)).split()
    done = run(*words, value)
    assert done.returncode == 2 and words[-1] in done.stderr and value in done.stderr, (done.returncode, done.stderr)


@pytest.mark.parametrize("option, value", [("--temp-noise-degc", 5000), ("--temp-lsb-degc", 5e-324), ("--rate-lsb-dph", 5e-324), ("--jitter-s", 0.3),
                                           ("--missing-seconds", 0.99)])
def test_no_log_is_simulated_that_nothing_reads(folder, option, value):
    done = run("gyrosim", "log", "--model", "m.json", "--profile", "p.json", "-o", "x.csv", option, value)
    assert done.returncode == 2 and option in done.stderr and not (folder / "x.csv").exists(), done.stderr


@pytest.mark.parametrize("option, value", [("--temp-noise-degc", 30), ("--temp-lsb-degc", 5), ("--rate-lsb-dph", 1e-9), ("--jitter-s", 0.07), ("--missing-seconds", 0.45)])
def test_the_furthest_simulated_log_is_read(folder, option, value):
    for seed in range(3):
        assert run("gyrosim", "log", "--model", "m.json", "--profile", "p.json", "-o", "x.csv", option, value, "--seed", seed).returncode == 0
        assert (done := run("dp", "x.csv", "--no-ratios", "--tau", "1")).returncode == 0, done.stderr


def test_whole_numbers_are_decimal(folder):
    for words, runs, seed in ((("--runs", "010"), 10, 1), (("--runs", "3", "--seed", "010"), 3, 10), (("--runs", "08"), 8, 1), (("--runs", "2", "--seed", "0"), 2, 0)):
        done = run("montecarlo", "--model", "m.json", "--profile", "p.json", "--order", "3", "--core-only", *words, "--json", "-")
        assert done.returncode == 0 and (json.loads(done.stdout)["runs"], json.loads(done.stdout)["seed"]) == (runs, seed), done.stderr


@pytest.mark.parametrize("scale", ["1e38", "1e300", "1e13", "1e-13"])
def test_a_scale_that_no_sensor_has_is_refused(folder, scale):
    (folder / "raw.csv").write_text(raw_text(f"gx_counts_scale_dph = {scale}"))
    for command in ("dp raw.csv", "calibrate fit raw.csv --method poly", "dp raw.csv --stream"):
        done = run(*command.split())
        assert done.returncode == 3 and f"raw.csv:4: # gx_counts_scale_dph: {scale} is no scale" in done.stderr, (done.returncode, done.stderr)


def test_means_that_no_rate_is_are_refused(folder):
    (folder / "raw.csv").write_text(raw_text("gx_counts_scale_dph = 1e12"))
    done = run("dp", "raw.csv")
    assert done.returncode == 3 and "raw.csv:9: " in done.stderr and "gx_dph: a mean beyond +-1e12" in done.stderr, (done.returncode, done.stderr)


def test_metadata_say_one_thing(folder):
    scale = "gx_counts_scale_dph = 18"
    for lines, words in (((scale, "gx_counts_scale_dph = 1800"), ":4: # gx_counts_scale_dph = 1800: a line before says 18"),
                         ((scale, "gx_counts_scale_dps = 1"), "gx_counts_scale_dph and # gx_counts_scale_dps"), ((scale, "rate_hz = 5"), "rate_hz = 5")):
        (folder / "raw.csv").write_text(raw_text(*lines))
        done = run("dp", "raw.csv", "--no-ratios")
        assert done.returncode == 3 and words in done.stderr and "leave the one that is right" in done.stderr, (done.returncode, done.stderr)
    (folder / "raw.csv").write_text(raw_text(scale, scale))
    assert run("dp", "raw.csv", "--no-ratios").returncode == 0


@pytest.mark.parametrize("grid", ["log:1:100:1e9", "log:1:1e9:1e6"])
def test_a_grid_without_end_is_refused_at_once(folder, grid):
    done = run("dp", "log.csv", "--no-ratios", "--tau", grid)
    assert done.returncode == 2 and grid in done.stderr and "more than a million points" in done.stderr


@pytest.mark.parametrize("command", ["errormodel expect m.json --duration-s 1e308", "profile optimize --model m.json --order 3 --range 0:60 --max-rate 2 --duration-s 1e308"])
def test_more_than_a_machine_holds_is_said_with_a_remedy(folder, command):
    done = run(*command.split())
    assert done.returncode == 3 and "internal" not in done.stderr and "give a shorter duration" in done.stderr, done.stderr


EFFECTS = {"beyond": ({"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 40, "width_degc": 1e308}}, "thermal_hysteresis.width_degc"),
           "unknown": ({"name": "x"}, 'effect "x" is not in the library')}


@pytest.mark.parametrize("name", EFFECTS)
def test_a_wrong_effect_is_named_by_file_and_place(folder, name):
    wrong, words = EFFECTS[name]
    good = {"name": "rate_ramp", "parameters": {"ramp_dph_per_h": 1}}
    (folder / "wrong.json").write_text(json.dumps({**MODEL, "effects": [good, wrong]}))
    (folder / "list.json").write_text(json.dumps([good, wrong]))
    for command, place in (("gyrosim log --model m.json --profile p.json --effects list.json -o x", "list.json[1]"),
                           ("gyrosim log --model wrong.json --profile p.json -o x", "wrong.json: effects[1]"),
                           ("montecarlo --model wrong.json --profile p.json --order 3 --runs 1", "wrong.json: effects[1]")):
        done = run(*command.split())
        assert done.returncode == 3 and place in done.stderr and words in done.stderr, done.stderr
    (folder / "form.json").write_text(json.dumps({**MODEL, "effects": [{"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 40, "width_degc": 5}}]}))
    assert "form.json: effects[0]: effect" in run("errormodel", "expect", "form.json").stderr


def test_no_table_without_end_is_read(folder):
    (folder / "d.bin").mkdir()
    (folder / "z.bin").symlink_to("/dev/zero")
    for name, words in (("d.bin", "is a folder"), ("z.bin", "z.bin: ")):
        done = run("calibrate", "--port", "/dev/null", "flash", name)
        assert done.returncode == 3 and words in done.stderr and "internal" not in done.stderr, done.stderr


# ---- shards of a campaign ----

@pytest.fixture(scope="module")
def shard(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shard")
    (folder / "m.json").write_text(json.dumps(MODEL))
    (folder / "p.json").write_text(json.dumps(PROFILE))
    for first, n in ((0, 20), (30, 5)):
        assert run("montecarlo", "--model", folder / "m.json", "--profile", folder / "p.json", "--order", 3, "--runs", n, "--first-run", first, "-q",
                   "--partial", folder / f"{first}.json").returncode == 0
    return folder


def set_at(path, value):
    def damage(partial):
        for name in path[:-1]:
            partial = partial[name]
        if value is None:
            del partial[path[-1]]
        else:
            partial[path[-1]] = value(partial[path[-1]]) if callable(value) else value
    return damage


DAMAGES = {
    "error": (("tally", "sums", "error"), []), "extra": (("tally", "sums", "residual_extra"), []), "short": (("tally", "sums", "residual_extra"), lambda x: x[:3]),
    "negative": (("tally", "sums", "error2"), lambda x: ["-" + n for n in x]), "no nees": (("tally", "sums", "nees"), None),
    "least squares": (("tally", "sums", "ls_error2"), lambda x: x[:1]), "maxima": (("tally", "maxima", "comp_lsb"), []),
    "lags": (("tally", "counts", "lags"), lambda x: x[:1]), "within": (("tally", "counts", "within1"), lambda x: [10 ** 6] * len(x)),
    "seconds": (("tally", "counts", "seconds"), [3]), "fewer points": (("campaign", "points"), 5), "many points": (("campaign", "points"), 10 ** 15),
    "no points": (("campaign", "points"), 0), "order": (("campaign", "order"), 0), "missing": (("campaign", "missing_seconds_frac"), 2),
    "below zero": (("ranges",), [[-20, 0]]), "halves": (("ranges",), [[0.5, 20.5]]), "rate": (("campaign", "raw", "rate_hz"), 0)}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_partial_is_refused(shard, name):
    path, value = DAMAGES[name]
    partial = json.loads((shard / "0.json").read_text())
    set_at(path, value)(partial)
    (shard / "bad.json").write_text(json.dumps(partial))
    (shard / "out.json").write_text("old")
    done = run("montecarlo", "merge", shard / "bad.json", "--json", shard / "out.json")
    assert done.returncode == 3 and "bad.json: " in done.stderr and "internal" not in done.stderr, (done.returncode, done.stderr)
    assert path[-1] in done.stderr or path == ("campaign", "points") and "expected 5 numbers" in done.stderr, done.stderr
    assert (shard / "out.json").read_text() == "old"


def test_runs_that_are_missing_are_told(shard):
    done = run("montecarlo", "merge", shard / "30.json", shard / "0.json")
    assert done.returncode == 0 and "runs 20 to 29 are missing" in done.stderr, done.stderr


def test_an_interrupted_campaign_says_so(shard):
    command = [BIN / "montecarlo", "--model", shard / "m.json", "--profile", shard / "p.json", "--order", "3", "--runs", "1000000", "-q",
               "--partial", shard / "cut.json", "--json", shard / "cut-result.json"]
    child = subprocess.Popen(command)
    time.sleep(1.5)
    child.send_signal(signal.SIGINT)
    assert child.wait(timeout=60) == 130
    assert json.loads((shard / "cut.json").read_text())["interrupted"] is True
    done = run("montecarlo", "merge", shard / "cut.json", "--json", shard / "merged.json")
    assert done.returncode == 0 and "cut.json: was interrupted after" in done.stderr and "of 1000000 runs" in done.stderr, done.stderr
    assert json.loads((shard / "merged.json").read_text())["interrupted"] is True and "stopped before the end" in done.stdout


def test_an_interrupted_comparison_prints_no_empty_table(shard):
    child = subprocess.Popen([BIN / "montecarlo", "compare", "--model", shard / "m.json", "--order", "3", "--runs", "20000", "--json", shard / "c.json"],
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(1)
    child.send_signal(signal.SIGINT)
    out, said = child.communicate(timeout=60)
    assert child.returncode == 130 and out == "" and "interrupted before the first profile" in said and not (shard / "c.json").exists()
