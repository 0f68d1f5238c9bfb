# SPDX-License-Identifier: MIT
"""A sample of `make mutate`: do the unit tests of the core see small errors?  Rooms whose tests take well under a second."""
import os
import re
import shlex
import subprocess
import sys

import pytest

from where import ROOT

MUTATE = ROOT / "tests/mutate/mutate.py"
QUICK_ROOMS = ["crc", "sample", "sum", "track", "learn", "table"]


def mutate(*arguments):
    return subprocess.run([sys.executable, MUTATE, *map(str, arguments)], capture_output=True, text=True, timeout=300)


@pytest.fixture
def build(tmp_path):
    return ["--build", tmp_path]


def test_sample_of_mutants_is_killed(build):
    result = mutate(*QUICK_ROOMS, "--sample", 24, "--seed", 1, "--at-least", "0.9", *build)
    assert result.returncode == 0, result.stdout + result.stderr
    killed, judged = map(int, re.search(r"mutate: (\d+) of (\d+) killed", result.stdout).groups())
    assert judged >= 20 and killed >= 0.9 * judged


def test_missing_tests_are_noticed(build, tmp_path):
    """A test of nothing: then mutants survive, and the answer is no."""
    tests = tmp_path / "tests"
    tests.mkdir()
    (tests / "test_sum.c").write_text("int main(void) { return 0; }\n")
    result = mutate("sum", "--sample", 4, "--tests", tests, *build)
    assert result.returncode == 1, result.stdout + result.stderr
    assert "survived:" in result.stdout and "mutate: 0 of" in result.stdout


def test_every_room_has_mutants_and_every_judged_one_exists():
    """An entry of equivalent.txt whose line was edited is out of date."""
    listed = mutate("--list").stdout
    pairs = set(re.findall(r"(?m)^(\w+\.c):\d+: \w+\n    (.*)\n -> (.*)$", listed))
    assert {name for name, _, _ in pairs} == {path.name for path in (ROOT / "common").glob("*.c")} - {"status.c"}
    lines = [line.strip() for line in (MUTATE.parent / "equivalent.txt").read_text().splitlines()
             if line.strip() and not line.startswith("# ")]
    entries = list(zip(lines[0::4], lines[1::4], (line[3:] for line in lines[2::4])))
    assert entries and not [entry for entry in entries if entry not in pairs]


def words_of_make_mutate(*knobs):
    """What `make mutate` would run."""
    environment = {key: value for key, value in os.environ.items() if key not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL", "ROOMS")}
    printed = subprocess.run(["make", "-n", "mutate", *knobs], cwd=ROOT, env=environment, check=True, capture_output=True,
                             text=True).stdout
    (line,) = [line for line in printed.splitlines() if "mutate.py" in line]
    return shlex.split(line.split("mutate.py", 1)[1])


@pytest.mark.parametrize("knobs, rooms", [([], {path.stem for path in (ROOT / "common").glob("*.c")} - {"status"}),
                                          (["ROOMS=crc sum"], {"crc", "sum"})], ids=["all", "some"])
def test_make_mutate_asks_rooms_of_the_core(knobs, rooms):
    listed = mutate(*words_of_make_mutate(*knobs), "--list")
    assert listed.returncode == 0, listed.stderr
    assert set(re.findall(r"(?m)^(\w+)\.c:\d+: ", listed.stdout)) == rooms
