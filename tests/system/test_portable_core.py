# SPDX-License-Identifier: MIT
"""The core on a big-endian 32-bit machine (mips under qemu-user): the short form of `make portable-core`."""
import os
import shlex
import shutil
import subprocess

import pytest

from where import ROOT

QUICK = "test_link test_table test_num test_sum test_learn test_track"


def make(*words):
    environment = {key: value for key, value in os.environ.items() if key not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    return subprocess.run(["make", "--no-print-directory", *words, "BUILD=" + os.environ.get("BUILD", "build")],
                          cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)


@pytest.mark.skipif(not (shutil.which("mips-linux-gnu-gcc") and shutil.which("qemu-mips")),
                    reason="no compiler or emulator for mips: apt-get install gcc-mips-linux-gnu libc6-dev-mips-cross qemu-user")
def test_core_big_endian_same_tests_and_same_bits():
    result = make("-j2", "portable-core", "PORTABLE_CORE=mips", "T=" + QUICK)
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    assert "mips bits: " in result.stdout and "6 test programs and the bits of one log, 0 lost" in result.stdout


def asked_of_run_core(*words):
    result = make("-n", "portable-core", "PORTABLE_CORE=mips", *words)
    (line,) = [line for line in result.stdout.splitlines() if "run_core" in line]
    return shlex.split(line)[4:]


def test_t_is_part_of_a_name_as_in_every_other_target():
    assert asked_of_run_core("T=link") == ["test_link"]
    assert sorted(asked_of_run_core("T=link _num")) == ["test_link", "test_num"]
    assert len(asked_of_run_core()) >= 10


def test_t_that_no_test_has_is_an_error():
    for target in ("portable-core", "portable-clang"):
        result = make("-n", target, "T=thermomether")
        assert result.returncode != 0 and "T=thermomether is part of no name" in result.stderr


def test_no_test_at_all_is_no_pass():
    result = subprocess.run([ROOT / "tests/portable/run_core", "mips", "qemu-mips", "build"], capture_output=True, text=True)
    assert result.returncode == 2 and "no test named" in result.stderr
