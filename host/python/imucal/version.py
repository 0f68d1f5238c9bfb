# SPDX-License-Identifier: MIT
"""The version of the package.  Its one home is common/version.h; an installed package has a copy of it."""
import pathlib
import re

HERE = pathlib.Path(__file__).resolve().parent


def read_version() -> str:
    """The version as text, from the header beside this file or the one of the checkout."""
    for header in (HERE / "version.h", HERE.parents[2] / "common" / "version.h"):
        if header.exists():
            return re.search(r'^#define IMUCAL_VERSION "(.*)"', header.read_text(), re.M).group(1)
    raise ImportError(f"{HERE}: version.h is missing: install the package again (pip install ./host/python)")


VERSION = read_version()
