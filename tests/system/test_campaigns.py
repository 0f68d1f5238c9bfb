# SPDX-License-Identifier: MIT
"""Programs that only a campaign runs (`make bench`, `make soak`, `make blind-confusions`) are compiled by `make test`."""
import os
import re
import subprocess

from where import ROOT


# Read by an analyser, never linked.
NOT_COMPILED = {"tests/prove/prove.c", "tests/prove/prove_app.c"}
IS_PROGRAM = re.compile(r'(?m)^(extern "C" )?int (main|LLVMFuzzerTestOneInput)\(')


def programs():
    """Sources below tests/ with a main, or with the entry of a fuzzer."""
    return {str(path.relative_to(ROOT)) for ending in ("c", "cpp") for path in ROOT.glob(f"tests/**/*.{ending}")
            if IS_PROGRAM.search(path.read_text())}


def what_make_test_compiles(build):
    """Sources named by the commands of an empty build folder, and sources that these include."""
    makefile = (ROOT / "tests/tests.mk").read_text()
    targets = re.search(r"-j2 (all unit-programs .*)", makefile).group(1).split()
    environment = {key: value for key, value in os.environ.items() if key not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    commands = subprocess.run(["make", "-n", f"BUILD={build}", *targets], cwd=ROOT, env=environment, check=True,
                              capture_output=True, text=True).stdout
    named = set(re.findall(r"(?<![\w/])tests/\S+\.c(?:pp)?\b", commands))
    included = (re.findall(r'#include "(\S+\.c(?:pp)?)"', (ROOT / name).read_text()) for name in named)
    return named | {f"tests/{name}" for names in included for name in names}


def test_make_test_compiles_every_program(tmp_path):
    assert len(programs()) > 60  # they were found at all
    assert programs() - NOT_COMPILED - what_make_test_compiles(tmp_path) == set()
