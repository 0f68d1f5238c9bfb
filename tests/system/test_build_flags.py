# SPDX-License-Identifier: MIT
"""An object is compiled again when its flags change, and only then."""
import os
import re
import subprocess

import pytest

from where import ROOT

KNOBS = ("MAKEFLAGS", "MFLAGS", "MAKELEVEL", "DEBUG", "CFLAGS", "CXXFLAGS", "LDFLAGS", "HSE_HZ", "SANITIZE")


# Writes an empty object: what is compiled, and not how, is asked.
COMPILER = """#!/bin/sh
while [ $# -gt 1 ]; do [ "$1" = -o ] && : >"$2"; shift; done
"""


def make(folder, *words):
    environment = {key: value for key, value in os.environ.items() if key not in KNOBS}
    for name in ("cc", "c++", "arm-gcc"):
        if not (folder / name).exists():
            (folder / name).write_text(COMPILER)
            (folder / name).chmod(0o755)
    compilers = [f"CC={folder}/cc", f"CXX={folder}/c++", f"CROSS={folder}/arm-", "CCACHE="]
    return subprocess.run(["make", "--no-print-directory", f"BUILD={folder}/build", *compilers, *words], cwd=ROOT,
                          env=environment, check=True, capture_output=True, text=True).stdout


# One object of each kind: the core, the host's C++, an image's core, an image's own part; what changes it and what does not.
OBJECTS = [("obj/host/common/crc.o", ["DEBUG=1", "CFLAGS=-DNONE"], ["CXXFLAGS=-DNONE", "HSE_HZ=12000000"]),
           ("obj/host/host/lib/linear/room.o", ["DEBUG=1", "CXXFLAGS=-DNONE"], ["CFLAGS=-DNONE", "HSE_HZ=12000000"]),
           ("obj/nrf51/common/crc.o", ["DEBUG=1"], ["CFLAGS=-DNONE", "CXXFLAGS=-DNONE"]),
           ("obj/stm32f405/firmware/port/stm32f405/system.o", ["DEBUG=1", "HSE_HZ=12000000"], ["CFLAGS=-DNONE"])]


@pytest.mark.parametrize("name, changing, other", OBJECTS, ids=[name for name, _, _ in OBJECTS])
def test_object_is_compiled_again_when_its_flags_change(tmp_path, name, changing, other):
    built = tmp_path / "build" / name

    def is_compiled(*words):
        return f"-o {built}" in make(tmp_path, "V=1", *words, str(built))

    assert is_compiled()
    assert not is_compiled()
    for knob in other:
        assert not is_compiled("-n", knob), knob
    for knob in changing:
        assert is_compiled("-n", knob), knob
    assert not is_compiled()  # what was asked with -n has changed nothing
    assert is_compiled(changing[0])
    assert not is_compiled(changing[0])
    assert is_compiled()


def rules_that_compile():
    """{first line of a rule: where it stands} of all rules whose recipe compiles a source."""
    found = {}
    for path in [ROOT / "Makefile", *ROOT.glob("host/**/*.mk"), *ROOT.glob("firmware/**/*.mk"), *ROOT.glob("tests/**/*.mk")]:
        rule = ""
        for line in path.read_text().replace("\\\n", " ").splitlines():
            if re.match(r"\S[^=]*[^:]:(?![:=])", line) and not line.startswith("#"):
                rule = line
            if re.search(r" -c \$\$?<", line) and rule:
                found[rule] = path.name
    return found


def test_every_rule_that_compiles_needs_its_flags():
    rules = rules_that_compile()
    assert len(rules) > 15  # they were found at all
    assert not [(where, rule) for rule, where in rules.items() if "/flags/" not in rule]
