# SPDX-License-Identifier: MIT
"""Where the project is, what was built of it, and the recordings that lie beside it.

BUILD is make's: a folder of the project, or any path.  IMUCAL_DATA names the folder of the recordings where it is another.
This file is not one folder up because a test that is started as a plain program must find it too."""
import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BUILD = (ROOT / os.environ.get("BUILD", "build")).resolve()
BIN = BUILD / "bin"
DATA = Path(os.environ.get("IMUCAL_DATA", ROOT.parent / "shared/data"))
