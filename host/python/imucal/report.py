# SPDX-License-Identifier: MIT
"""``imucal report``: the result of diagnose as one HTML page (host/scripts/diagnosis_report.py)."""
import os
import signal
import subprocess
import sys
from pathlib import Path

from .errors import DataError

_PLACES = [Path(__file__).resolve().parents[2] / "scripts", Path(__file__).resolve().parents[1] / "scripts"]


def _status_of(command):
    """Exit status of a script.  Ctrl-C reaches both processes: this one ends the script, which would show where it stood."""
    script = subprocess.Popen(command, env={**os.environ}, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN))
    try:
        return script.wait()
    except KeyboardInterrupt:
        script.terminate()
        script.wait()
        raise


def run(arguments):
    """Run the script; returns its exit status."""
    for folder in _PLACES:
        script = folder / "diagnosis_report.py"
        if script.exists():
            return _status_of([sys.executable, str(script), *arguments])
    raise DataError("diagnosis_report.py is not installed beside the package; run it from the source tree: host/scripts/diagnosis_report.py")
