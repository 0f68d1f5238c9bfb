# SPDX-License-Identifier: MIT
"""Ctrl-C while `imucal report` loads its libraries: no traceback, no page, status 130."""
import os
import signal
import subprocess
import sys
import time

import pytest

import imucal.report
from imucal.__main__ import main

SCRIPT = """import pathlib, time
pathlib.Path("started").touch()
time.sleep(60)
"""


def test_interrupted_report_ends_without_a_traceback(tmp_path):
    (tmp_path / "diagnosis_report.py").write_text(SCRIPT)
    code = (f"import pathlib, sys, imucal.report as r, imucal.__main__ as m; r._PLACES = [pathlib.Path({str(tmp_path)!r})]; "
            "sys.exit(m.main(['report', 'x']))")
    command = [sys.executable, "-c", code]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        until = time.monotonic() + 30
        while not (tmp_path / "started").exists() and time.monotonic() < until:
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        _, said = process.communicate(timeout=20)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 130 and said == ""


@pytest.mark.parametrize("status", [0, 3])
def test_status_of_the_script_is_that_of_the_command(tmp_path, monkeypatch, status):
    (tmp_path / "diagnosis_report.py").write_text(f"raise SystemExit({status})")
    monkeypatch.setattr(imucal.report, "_PLACES", [tmp_path])
    assert main(["report", "x"]) == status
