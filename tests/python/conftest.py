# SPDX-License-Identifier: MIT
import os

from where import ROOT

# For the processes that tests start: they take the package from the source tree, as the tests do.
os.environ["PYTHONPATH"] = f"{ROOT / 'host/python'}:{os.environ.get('PYTHONPATH', '')}"
