# SPDX-License-Identifier: MIT
"""Builds the compiled part with the project's own make rule, so that its flags have one home."""
import os
import re
import shutil
import subprocess
import sys

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

HERE = os.path.dirname(os.path.abspath(__file__))
HEADER = os.path.join(os.path.dirname(os.path.dirname(HERE)), "common/version.h")  # the one home of the version


class WithVersion(build_py):
    """Puts a copy of the header beside the package (imucal/version.py reads it)."""

    def run(self):
        super().run()
        shutil.copy(HEADER, os.path.join(self.build_lib, "imucal", "version.h"))


class MakeCore(build_ext):
    """make build/python/_core.so, then copy it to where setuptools wants the extension."""

    def build_extension(self, ext):
        top = os.path.dirname(os.path.dirname(HERE))
        build = os.environ.get("IMUCAL_BUILD", os.path.join(top, "build"))
        subprocess.run(["make", "--no-print-directory", "-C", top, f"BUILD={os.path.relpath(build, top)}", f"PYTHON={sys.executable}", "python-core"], check=True)
        target = self.get_ext_fullpath(ext.name)
        os.makedirs(os.path.dirname(target), exist_ok=True)
        shutil.copy(os.path.join(build, "python/_core.so"), target)


with open(HEADER) as header:
    VERSION = re.search(r'^#define IMUCAL_VERSION "(.*)"', header.read(), re.M).group(1)

setup(version=VERSION, ext_modules=[Extension("imucal._core", [])], cmdclass={"build_ext": MakeCore, "build_py": WithVersion})
