# SPDX-License-Identifier: MIT
"""Every script says what it does when asked, and does nothing else; a program that is missing is named."""
import os
import subprocess
import sys

import pytest

from where import ROOT

SCRIPTS = sorted(path for path in (ROOT / "host/scripts").glob("*.py") if "__main__" in path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_help_is_printed_and_nothing_is_made(script, tmp_path):
    done = subprocess.run([sys.executable, script, "--help"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    if "ModuleNotFoundError" in done.stderr:
        pytest.skip(f"{script.name} wants a library of make bench: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"usage: {script.name}") and not list(tmp_path.iterdir())


@pytest.mark.parametrize("name, arguments", [("figures_profile.py", ["figures"]), ("profile_oscillations.py", []), ("profile_table.py", [])])
def test_missing_program_is_named_with_the_remedy(name, arguments, tmp_path):
    done = subprocess.run([sys.executable, ROOT / "host/scripts" / name, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=60,
                          env={**os.environ, "PROFILE": "no/such/profile"})
    assert done.returncode not in (0, None) and "Traceback" not in done.stderr
    assert "no/such/profile" in done.stderr and "make host" in done.stderr and "PROFILE=" in done.stderr
