# SPDX-License-Identifier: MIT
"""The READMEs run: every command line of them, exactly as printed, in a folder that holds only the example's files.

A command line is an indented line that begins with one of our programs; what follows three blanks or more, or stands in
round brackets at its end, is a remark.  Lines with --port talk to an emulated device with a running sensor.  A block
after "<!-- not run: why -->" is left out; the count of these is held, so that none slips out unseen.

Every `make X` of a README must be a target, its knobs must be known, and it is run here or stands in LONG with the reason.
The figures of `make demo` and the number of faults of `make sick` are compared with what is printed; tables: test_readme_figures.py."""
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys

import pytest

from imu import Imu
from reference import BASIC, DRIFTING
from where import BIN, BUILD, ROOT

SCRIPT = "build/venv/bin/python"
PROGRAMS = ("calibrate", "gyrosim", "dp", "errormodel", "profile", "montecarlo", "diagnose", "imucal", SCRIPT)
NOT_RUN = re.compile(r"<!-- not run: (\S.*) -->")


def command_lines(path):
    """[(line number, words as printed)] and the reasons of what is not run."""
    found, left_out, reason = [], [], None
    for number, line in enumerate(path.read_text().splitlines(), 1):
        mark = NOT_RUN.search(line)
        if mark:
            reason = mark.group(1)
            continue
        if line and not line.startswith("    "):
            reason = None
        if not re.match(r"    (%s) [a-z-]" % "|".join(PROGRAMS), line):
            continue
        text = re.sub(r"\s+\([^()]*\)$", "", re.split(r" {3,}", line.strip())[0])
        (left_out if reason else found).append((number, reason or text))
    return found, left_out


README_FILES = sorted(p for p in ROOT.rglob("README.md") if not {"build", ".git"} & set(p.relative_to(ROOT).parts))
LINES = [(path, number, text) for path in README_FILES for number, text in command_lines(path)[0]]


def test_command_lines_are_found_and_few_are_left_out():
    assert len(LINES) >= 10
    assert sum(len(command_lines(path)[1]) for path in README_FILES) <= 2


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What `imucal example` or the reader provides: model.json, chamber.json, logs of three runs of one device."""
    path = tmp_path_factory.mktemp("readme")
    (path / "model.json").write_text(json.dumps(DRIFTING))
    (path / "chamber.json").write_text(json.dumps(BASIC))
    for run in (1, 2, 3):
        subprocess.run([BIN / "gyrosim", "log", "--model", "model.json", "--profile", "chamber.json", "--log-index", str(run),
                        "-o", f"run{run}.csv", "-q"], cwd=path, check=True)
    (path / "log.csv").write_text((path / "run1.csv").read_text())
    (path / "gyro.json").write_text(json.dumps(DRIFTING))
    (path / "accel.json").write_text(json.dumps({"imucal_model": 1, "unit": "mg", "white_mg_rt_hz": 0.1,
                                                 "markov": [{"sigma_mg": 0.05, "tau_s": 100}]}))
    subprocess.run([BIN / "gyrosim", "log", "--model", "model.json", "--profile", "chamber.json", "--axes", "3", "-o", "triad.csv", "-q"],
                   cwd=path, check=True)
    subprocess.run([BIN / "calibrate", "fit", "triad.csv", "--model", "model.json", "-o", "table.json", "-q"], cwd=path, check=True)
    return path


@pytest.fixture(scope="module")
def device(tmp_path_factory):
    """What is behind /dev/ttyACM0: the firmware as a process, beside the files that its lines name."""
    path = tmp_path_factory.mktemp("readme_device")
    imu = Imu(path)
    (path / "chamber.json").write_text(json.dumps(BASIC))
    (path / "model.json").write_text(json.dumps(DRIFTING))
    yield imu
    imu.close()


def run_at(device, words):
    """In the order of the README: the table that `verify` compares is that of `run`."""
    if "run" in words:
        (device.folder / "log.csv").unlink(missing_ok=True)
        device.sense(BASIC, DRIFTING)
    result = subprocess.run([BIN / words[0], *(device.port if w == "/dev/ttyACM0" else w for w in words[1:])],
                            cwd=device.folder, capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, (words, result.stderr)


@pytest.mark.parametrize("path, number, text", LINES, ids=lambda x: str(x)[:50].replace(str(ROOT), ""))
def test_command_line_of_a_readme_runs_as_printed(folder, device, path, number, text):
    if "--port" in text:
        return run_at(device, shlex.split(text))
    if " | " in text:  # one of these: all of them
        head, choices = re.match(r"(.* )(\S+ (?:\| \S+ ?)+)$", text).groups()
        for choice in choices.split(" | "):
            test_command_line_of_a_readme_runs_as_printed(folder, device, path, number, head + choice.strip())
        return
    words = shlex.split(text)
    command = [sys.executable, ROOT / words[1], *words[2:]] if words[0] == SCRIPT else [BIN / words[0], *words[1:]]
    assert pathlib.Path(command[0]).exists(), words[0]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300)
    assert result.returncode in (0, 1 if words[0] == "diagnose" else 0), (text, result.stderr)
    for name in re.findall(r"(?:-o|--json) (\S+\.(?:csv|json|html))", text):
        assert (folder / name).stat().st_size > 0, name


# ---- make ----

# Run by this file, or what `make test` itself is made of.
RUN_HERE = {"demo": "test_demo_prints_the_figures_of_the_readmes", "help": "test_make_lines_run"}
# Not run by tests as they stand: campaigns of minutes, and what installs or writes outside build/.
LONG = {
    "all": "make test begins with it", "bench": "speed of an idle machine, minutes", "bench-diff": "speed of an idle machine",
    "bench-package": "speed of an idle machine", "blind": "hours", "core-figures": "minutes",
    "cost-diff": "run with every firmware change", "coverage": "run by .ci/run", "cycles": "QEMU, minutes",
    "deps": "make test begins with it", "docs": "MkDocs in a venv of its own", "figures": "minutes",
    "firmware": "make test begins with it", "flash": "needs a board; run with stand-ins for its tools", "format": "rewrites sources",
    "formats-table": "a file of 100 MB, speed of an idle machine", "fuzz": "runs for a time; compiled by make test",
    "fuzz-clang": "needs clang", "fuzz-device": "minutes", "fuzz-files": "needs clang", "fuzz-imports": "minutes",
    "firmware-riscv": "where its compiler is", "install": "writes outside build/", "line": "minutes",
    "lint": "needs clang-tidy; the rest of it is run by .ci/run", "misra": "needs cppcheck",
    "month": "minutes; compiled by make test", "mutate": "an hour", "portable": "compiles everything for two machines",
    "portable-core": "two machines", "profile-oscillations": "minutes", "profile-table": "minutes",
    "prove": "needs Frama-C; minutes",
    "python": "writes into the venv; its compiled part is python-core, which make test builds",
    "recorded": "minutes, and needs the logs", "sanitize": "run by .ci/run", "selector-table": "minutes; compiled by make test",
    "sensor-table": "counts what the sensors' unit tests run", "sick": "minutes", "size": "part of cost-diff",
    "soak": "an hour", "stack": "part of cost-diff", "test": "this is it", "test-long": "minutes", "torn": "minutes",
    "unit-test": "part of make test", "validation": "minutes"}
# What make test runs of them, or beside them: its file, and a word of what both of them run.
SHORT_FORM = {
    "blind": ("system/test_blind.py", "blind"), "budget": ("system/test_readme_figures.py", "budget"),
    "firmware-riscv": ("system/test_firmware_riscv.py", "firmware-riscv"),
    "flash": ("system/test_firmware_stm32f405.py", "openocd"), "fuzz-device": ("firmware/test_app_fuzz.c", "fuzz_device"),
    "fuzz-files": ("host/test_fuzz_files.cpp", "fuzz/corpus"), "fuzz-imports": ("python/test_fuzz_imports.py", "fuzz_imports"),
    "install": ("system/test_imucal_install.py", "install.sh"), "line": ("system/test_calibrate.py", "noisy_line"),
    "mutate": ("system/test_mutate.py", "mutate.py"), "portable-core": ("system/test_portable_core.py", "portable-core"),
    "recorded": ("system/test_recorded.py", "recorded"), "sick": ("system/test_sick.py", "sick"),
    "soak": ("common/test_store_torn.c", "torn/torn.h"), "torn": ("common/test_store_torn.c", "torn/torn.h"),
    "validation": ("system/test_readme_figures.py", "validation.py")}
# bench-whole and coverage-errormodel: as bench and coverage.
STATED = set(RUN_HERE) | set(LONG) | set(SHORT_FORM)


def make_words():
    """{(target, knobs)} of every `make ...` in back quotes or at the begin of an indented line of a README."""
    found = set()
    for path in README_FILES:
        text = path.read_text()
        lines = re.findall(r"`make ([^`]*)`", text) + [re.split(r" {3,}", line)[0] for line in re.findall(r"(?m)^    make (.*)$", text)]
        for line in lines:
            words = shlex.split(line.replace("[", " ").replace("]", " "))
            targets = [w for w in words if "=" not in w and "<" not in w] or ["all"]
            found |= {(target, tuple(w.split("=")[0] for w in words if "=" in w)) for target in targets}
    return found


def make_files():
    return [p for p in ROOT.rglob("*") if (p.suffix == ".mk" or p.name == "Makefile") and not {"build", ".git"} & set(p.relative_to(ROOT).parts)]


def make_text():
    return "\n".join(p.read_text() for p in make_files())


def rule(target):
    """A pattern of the line that makes it a target."""
    return r"(?m)^(?:[\w. -]* )?%s(?: [\w. -]*)?::?(?: |$)" % re.escape(target)


def test_make_targets_of_the_readmes_exist_and_are_run_or_stated():
    rules, words = make_text(), make_words()
    assert len(words) > 30
    for target, knobs in words:
        for knob in knobs:
            assert re.search(r"(?m)^%s *[?:]?=|\$[({]%s[)}]" % (knob, knob), rules) or knob in ("CXX", "CC"), (target, knob)
        if target.startswith("build/"):
            continue
        assert re.search(rule(target), rules), f"no target: make {target}"
        assert {target, target.split("-")[0]} & STATED, f"make {target}: run it here or say in LONG why not"
    assert STATED <= {target for target, _ in words}, "no README names these"


def test_what_is_stated_of_targets_that_are_not_run_is_so():
    for target, (name, word) in SHORT_FORM.items():
        assert word in (ROOT / "tests" / name).read_text(), (target, name)
        texts = [path.read_text() for path in make_files() if re.search(rule(target), path.read_text())]
        scripts = {script for text in texts for script in re.findall(r"\b(?:tests|host|firmware)/[\w/]+\.(?:py|sh|c|cpp)\b", text)}
        assert any(word in text for text in [*texts, *((ROOT / script).read_text() for script in scripts)]), (target, word)
    for target in (target for target, reason in LONG.items() if "run by .ci/run" in reason):
        assert re.search(r"(?m)^make (?:.* )?%s\b" % target, (ROOT / ".ci/run").read_text()), target


def test_make_lines_run():
    out = subprocess.run(["make", "--no-print-directory", "help"], cwd=ROOT, capture_output=True, text=True)
    assert out.returncode == 0 and "make demo" in out.stdout and "make test" in out.stdout
    listed = re.findall(r"(?m)^  make (\S+) ", out.stdout)
    assert len(listed) == len(set(listed)), "a target is listed twice"
    assert sorted(listed) == sorted(re.findall(r"(?m)^([a-z0-9-]+):.*## ", make_text())), "a group that HELP_GROUPS does not name"


def test_exit_statuses_are_told_where_users_look():
    known = re.search(r"enum class Exit \{(.*)\}", (ROOT / "host/lib/base/error.h").read_text()).group(1)
    statuses = re.findall(r"= (\d+)", known)
    table = (ROOT / "host/README.md").read_text().split("| exit status | meaning |")[1].split("\n\n")[0]
    assert re.findall(r"(?m)^\| (\d+) \|", table) == statuses
    readme = re.search(r"Exit status: ([^.]*)\.", (ROOT / "README.md").read_text()).group(1)
    told = subprocess.run([BUILD / "bin/imucal", "--help"], capture_output=True, text=True, check=True).stdout.split("Exit status: ")[1]
    assert [re.findall(r"(?:^|; )(\d+) ", " ".join(text.split())) for text in (readme, told)] == [statuses] * 2


# ---- figures ----

def rows_of(text, first_words):
    """{first word: the figures behind it} of lines that begin with one of the words."""
    return {line.split()[0]: line.split()[1:] for line in text.splitlines() if line.split() and line.split()[0] in first_words
            and re.match(r"[\d. ]+$", " ".join(line.split()[1:]))}


def test_demo_prints_the_figures_of_the_readmes(tmp_path):
    for name in ("bin", "firmware"):
        (tmp_path / name).symlink_to(BUILD / name)
    out = subprocess.run([os.environ.get("PYTHON", "python3") if not (BUILD / "venv/bin/python").exists() else BUILD / "venv/bin/python",
                          ROOT / "host/scripts/demo.py", "--build", tmp_path], capture_output=True, text=True, timeout=300)
    assert out.returncode == 0, out.stderr
    axes = ("gx_dph", "gy_dph", "gz_dph")
    printed = rows_of(out.stdout, axes)
    assert set(printed) == set(axes)
    for path in (ROOT / "README.md", ROOT / "host/lib/device/README.md"):
        assert rows_of(path.read_text().replace("    gx", "gx"), axes) == printed, path
    coefficients = re.search(r"gx_dph +order 3.*coefficients (\S+ \S+)", out.stdout).group(1)
    assert coefficients in (ROOT / "host/lib/device/README.md").read_text()


def test_number_of_faults_in_the_readme_is_that_of_make_sick():
    from sick import device, offline
    stated = re.search(r"(\d+) faults", " ".join((ROOT / "README.md").read_text().split())).group(1)
    assert int(stated) == len(offline.FAULTS) + len(device.FAULTS)
