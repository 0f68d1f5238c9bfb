# SPDX-License-Identifier: MIT
"""The compiled part, with a helpful word where it is missing."""
from functools import cache


@cache
def core():
    """The module imucal._core.  Kept once it is found: an import statement on the way of each call takes 20 us between other work."""
    try:
        from . import _core
    except ImportError as error:
        from .errors import ImucalError
        raise ImucalError(f"the compiled part of imucal is not there ({error}): make python-core, or pip install ./host/python") from None
    return _core


def core_or_none():
    """The same, or None where it is not there: for work that numpy or another library does too, more slowly."""
    try:
        from . import _core
    except ImportError:
        return None
    return _core
