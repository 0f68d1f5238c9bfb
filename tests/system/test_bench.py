# SPDX-License-Identifier: MIT
"""The short form of `make bench-diff`: no kernel and no call of the core takes 20 % more instructions than saved."""
import json
import shutil
import subprocess
import sys

import pytest

from where import BUILD, ROOT

KEPT = ROOT / "tests/bench/kept.py"


def kept(*arguments):
    return subprocess.run([sys.executable, str(KEPT), *map(str, arguments)], capture_output=True, text=True, timeout=300)


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    if not shutil.which("valgrind"):
        pytest.skip("valgrind is not installed: instructions are not counted")
    out = tmp_path_factory.mktemp("bench") / "bench.json"
    result = kept("measure", "--build", BUILD, "--counts-only", "--out", out)
    assert result.returncode == 0, result.stderr
    return out


def test_no_count_is_lost(measured):
    result = kept("diff", "--measured", measured)
    assert result.returncode == 0, result.stdout
    assert "dp_oadev" in result.stdout and "Cortex-M0" in result.stdout


@pytest.mark.parametrize("where, name", [("host", "whiten"), ("Cortex-M4F", "sum_add channels 6")])
def test_a_loss_and_a_kernel_gone_are_negative_answers(measured, tmp_path, where, name):
    now = json.loads(measured.read_text())
    saved = tmp_path / "saved.json"
    saved.write_text(measured.read_text())
    for change, outcome in ((1.15, 0), (1.25, 1)):
        now["instructions"][where][name] = round(change * json.loads(saved.read_text())["instructions"][where][name])
        (tmp_path / "now.json").write_text(json.dumps(now))
        result = kept("diff", "--measured", tmp_path / "now.json", "--saved", saved)
        assert result.returncode == outcome, result.stdout
    assert f"{where} {name}" in result.stdout
    del now["instructions"][where][name]
    (tmp_path / "now.json").write_text(json.dumps(now))
    result = kept("diff", "--measured", tmp_path / "now.json", "--saved", saved)
    assert result.returncode == 1 and "no longer measured" in result.stdout


@pytest.mark.parametrize("option, enough", [("--samples=1000", "give 9000 or more"), ("--look-s=89", "give 90 or more, or 0 for none")])
def test_a_recording_too_short_for_the_importers_table_names_the_least(option, enough):
    result = subprocess.run([sys.executable, str(ROOT / "tests/bench/bench_import.py"), option], capture_output=True, text=True, timeout=60)
    assert result.returncode == 2 and "too short" in result.stderr and enough in result.stderr, result.stderr
