# SPDX-License-Identifier: MIT
"""Which draws of a test `make test` asks, and which it leaves to `make test-long`."""
import pytest


def long_after(n, cases):
    """The first n cases of `make test`, and those that are left to `make test-long`."""
    return [case if i < n else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.long)
            for i, case in enumerate(cases)]
