# SPDX-License-Identifier: MIT
"""A port of one's own, as firmware/README.md says: a folder with its make file, and no list of the project edited."""
import os
import re
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def compiled(source, *flags):
    return subprocess.run(["gcc", "-std=c99", "-Icommon", *flags, "-fsyntax-only", source], cwd=ROOT, capture_output=True, text=True, timeout=60)


def test_core_refuses_fast_math():
    """Every source of the core that computes with floats."""
    sources = [p for p in sorted((ROOT / "common").glob("*.c")) if re.search(r"\bfloat\b", p.read_text())]
    assert len(sources) >= 6
    for source in sources:
        assert compiled(source).returncode == 0
        refused = compiled(source, "-ffast-math")
        assert refused.returncode != 0 and "the core gives other results with -ffast-math" in refused.stderr, source


def test_driver_of_the_sensors_readme_compiles(tmp_path):
    chapter = (ROOT / "firmware/sensors/README.md").read_text().partition("## A driver of your own")[2].partition("\n## ")[0]
    (tmp_path / "mine.c").write_text(re.search(r"```c\n(.*?)```", chapter, re.S).group(1))
    made = compiled(tmp_path / "mine.c", "-Ifirmware", "-Wall", "-Wextra", "-Wconversion", "-Werror")
    assert made.returncode == 0, made.stderr


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
