# SPDX-License-Identifier: MIT
"""The READMEs run: every command line of them, exactly as printed, in a folder that holds only the example's files.

A command line is an indented line that begins with one of our programs; what follows three blanks or more, or stands in
round brackets at its end, is a remark.  Lines with --port talk to an emulated device with a running sensor.  A block
after "<!-- not run: why -->" is left out; the count of these is held, so that none slips out unseen."""
import json
import os
import pathlib
import re
import shlex
import subprocess

import pytest
from imu import Imu

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = (ROOT / os.environ.get("BUILD", "build")).resolve()
SLOW = ("profile optimize", "montecarlo", "diagnose")  # minutes on a busy machine: with SLOW=1
PROGRAMS = ("calibrate", "gyrosim", "dp", "errormodel", "profile", "montecarlo", "diagnose")
NOT_RUN = re.compile(r"<!-- not run: (\S.*) -->")
MODEL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}], "turn_on_sigma_dph": 50,
         "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 300, 150, -100]}}
PROFILE = {"imucal_profile": 1, "start_degc": 0, "segments": [{"rate_degc_per_min": 0, "duration_s": 1200},
           {"rate_degc_per_min": 0.6, "to_degc": 60}, {"rate_degc_per_min": 0, "duration_s": 1200}]}


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
    (path / "model.json").write_text(json.dumps(MODEL))
    (path / "chamber.json").write_text(json.dumps(PROFILE))
    for run in (1, 2, 3):
        subprocess.run([BUILD / "bin/gyrosim", "log", "--model", "model.json", "--profile", "chamber.json", "--log-index", str(run),
                        "-o", f"run{run}.csv", "-q"], cwd=path, check=True)
    (path / "log.csv").write_text((path / "run1.csv").read_text())
    return path


@pytest.fixture(scope="module")
def device(tmp_path_factory):
    """What is behind /dev/ttyACM0: the firmware as a process, beside the files that its lines name."""
    path = tmp_path_factory.mktemp("readme_device")
    imu = Imu(path)
    (path / "chamber.json").write_text(json.dumps(PROFILE))
    (path / "model.json").write_text(json.dumps(MODEL))
    yield imu
    imu.close()


def run_at(device, words):
    """In the order of the README: the table that `verify` compares is that of `run`."""
    if "run" in words:
        (device.folder / "log.csv").unlink(missing_ok=True)
        device.sense(PROFILE, MODEL)
    result = subprocess.run([BUILD / "bin" / words[0], *(device.port if w == "/dev/ttyACM0" else w for w in words[1:])],
                            cwd=device.folder, capture_output=True, text=True, timeout=120)
    assert result.returncode == 0, (words, result.stderr)


@pytest.mark.parametrize("path, number, text", LINES, ids=lambda x: str(x)[:50].replace(str(ROOT), ""))
def test_command_line_of_a_readme_runs_as_printed(folder, device, path, number, text):
    if "--port" in text:
        return run_at(device, shlex.split(text))
    if text.startswith(SLOW) and not os.environ.get("SLOW"):
        pytest.skip("LOUD: %s:%d: takes long: SLOW=1 runs it" % (path.name, number))
    words = shlex.split(text)
    if not (BUILD / "bin" / words[0]).exists():
        pytest.fail("not built: " + words[0])
    result = subprocess.run([BUILD / "bin" / words[0], *words[1:]], cwd=folder, capture_output=True, text=True, timeout=300)
    assert result.returncode in (0, 1 if words[0] == "diagnose" else 0), (text, result.stderr)
    for name in re.findall(r"(?:-o|--json) (\S+\.(?:csv|json))", text):
        assert (folder / name).stat().st_size > 0, name
