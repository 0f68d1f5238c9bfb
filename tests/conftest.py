# SPDX-License-Identifier: MIT
import collections
import signal

import pytest


def pytest_configure(config):
    config.addinivalue_line("markers", "long: many more draws of a test that has a short form; `make test` leaves them to `make test-long`")
    # A shell without job control starts what it puts into the background with SIGINT ignored, and that is inherited.
    # Tests that interrupt a program need it as on a terminal, whatever started `make test`.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(trylast=True)  # after `-m` has left out its tests
def pytest_collection_modifyitems(items):
    """Files with few tests first: these ask the longest questions, and the many short tests of the others fill the last gaps
    between two processes.  The order within a file stays."""
    tests_in = collections.Counter(item.path for item in items)
    items.sort(key=lambda item: tests_in[item.path])
