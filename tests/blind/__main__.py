# SPDX-License-Identifier: MIT
"""python -m blind: draw, seal, diagnose, open, score; dev: cases with open labels; compare: another program's answers."""
import os
import sys

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from .command import main  # noqa: E402  (numpy reads the thread counts when it is loaded)

if __name__ == "__main__":
    sys.exit(main())
