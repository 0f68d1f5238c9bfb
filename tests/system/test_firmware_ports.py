# SPDX-License-Identifier: MIT
"""A port of one's own, as firmware/README.md says: a folder with its make file, and no list of the project edited."""
import os
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_port_with_a_make_file_of_its_own_is_built_by_its_target(tmp_path):
    """A copy of the shortest port under another name; `make -n`, so that no compiler is needed."""
    for name in ("Makefile", "host", "common", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    shutil.copytree(ROOT / "firmware", tmp_path / "firmware")
    port = tmp_path / "firmware/port/mychip"
    shutil.copytree(ROOT / "firmware/port/riscv_virt", port)
    text = (port / "riscv_virt.mk").read_text().replace("riscv_virt", "mychip").replace("firmware-riscv", "firmware-mychip")
    (port / "riscv_virt.mk").unlink()
    (port / "mychip.mk").write_text(text)
    environment = {key: value for key, value in os.environ.items() if key not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    for target, is_built in (("firmware-mychip", True), ("firmware", False)):
        made = subprocess.run(["make", "-n", target, "BUILD=build"], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
        assert made.returncode == 0 and "warning" not in made.stderr, made.stderr[-2000:]
        assert ("-c firmware/port/mychip/main.c" in made.stdout) == is_built
        assert ("-c firmware/port/stm32f405/main.c" in made.stdout) != is_built
