# SPDX-License-Identifier: MIT
"""``imucal report``: the result of diagnose as one HTML page (host/scripts/diagnosis_report.py)."""
import os
import subprocess
import sys
from pathlib import Path

from .errors import DataError

_PLACES = [Path(__file__).resolve().parents[2] / "scripts", Path(__file__).resolve().parents[1] / "scripts"]


def run(arguments):
    """Run the script; returns its exit status."""
    for folder in _PLACES:
        script = folder / "diagnosis_report.py"
        if script.exists():
            return subprocess.run([sys.executable, str(script), *arguments], env={**os.environ}).returncode
    raise DataError("diagnosis_report.py is not installed beside the package; run it from the source tree: host/scripts/diagnosis_report.py")
