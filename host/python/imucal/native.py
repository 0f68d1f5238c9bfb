# SPDX-License-Identifier: MIT
"""The compiled part, with a helpful word where it is missing."""


def core():
    """The module imucal._core."""
    try:
        from . import _core
    except ImportError as error:
        from .errors import ImucalError
        raise ImucalError(f"the compiled part of imucal is not there ({error}): make python-core, or pip install ./host/python") from None
    return _core
