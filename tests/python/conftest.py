# SPDX-License-Identifier: MIT
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "host/python"))
sys.path.insert(0, str(Path(__file__).parent))
os.environ["PYTHONPATH"] = f"{ROOT / 'host/python'}:{os.environ.get('PYTHONPATH', '')}"
