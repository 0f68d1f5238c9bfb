# SPDX-License-Identifier: MIT
"""The shape of the project: what stands at the top, and that dependencies point one way."""
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def tracked():
    return subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()


def includes(path):
    text = (ROOT / path).read_text(errors="replace")
    return re.findall(r'^\s*#\s*include\s+[<"]([^>"]+)[>"]', text, re.M)


def test_top_level_holds_the_agreed_entries_only():
    top = {name.split("/")[0] for name in tracked()}
    assert {name for name in top if not name.startswith(".")} == {
        "firmware", "host", "common", "tests", "Makefile", "README.md", "LICENSE"}


def test_common_is_freestanding():
    allowed = {"stdint.h", "stddef.h", "stdbool.h", "limits.h", "float.h", "string.h"}
    rooms = {Path(name).name for name in tracked() if name.startswith("common/")}
    for name in tracked():
        if name.startswith("common/") and name.endswith((".c", ".h")):
            for include in includes(name):
                assert include in allowed or include in rooms, f"{name} includes {include}"


def test_host_and_firmware_do_not_know_each_other():
    host_rooms = ("io/", "sim/", "base/", "cli/", "effects/", "dp/", "errormodel/", "diagnose/", "fit/")
    for name in tracked():
        if not name.endswith((".c", ".h", ".cpp")):
            continue
        for include in includes(name):
            if name.startswith("host/"):
                assert "firmware" not in include and not include.startswith(("app/", "port/")), f"{name}: {include}"
            if name.startswith("firmware/"):
                assert not include.startswith(host_rooms), f"{name}: {include}"


def test_sources_carry_a_licence_tag():
    bare = [name for name in tracked() if name.endswith((".c", ".h", ".cpp", ".py"))
            and "SPDX-License-Identifier" not in (ROOT / name).read_text(errors="replace")[:400]]
    assert not bare


def test_recorded_data_stays_outside():
    for name in tracked():
        if name.endswith(".csv"):
            text = (ROOT / name).read_text(errors="replace")[:2000]
            assert "imudata" not in text and "diveMove" not in text, f"{name} holds recorded data"
