# SPDX-License-Identifier: MIT
"""The core on a big-endian 32-bit machine (mips under qemu-user): the short form of `make portable-core`."""
import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
QUICK = "test_link test_table test_num test_sum test_learn test_track"


@pytest.mark.skipif(not (shutil.which("mips-linux-gnu-gcc") and shutil.which("qemu-mips")),
                    reason="no compiler or emulator for mips: apt-get install gcc-mips-linux-gnu libc6-dev-mips-cross qemu-user")
def test_core_big_endian_same_tests_and_same_bits():
    environment = {key: value for key, value in os.environ.items() if key not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    result = subprocess.run(["make", "--no-print-directory", "-j2", "portable-core", "PORTABLE_CORE=mips", "T=" + QUICK,
                             "BUILD=" + os.environ.get("BUILD", "build")],
                            cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    assert "mips bits: " in result.stdout and "6 test programs and the bits of one log, 0 lost" in result.stdout
