# SPDX-License-Identifier: MIT
import collections
import signal

import pytest


def pytest_configure():
    # A shell without job control starts what it puts into the background with SIGINT ignored, and that is inherited.
    # Tests that interrupt a program need it as on a terminal, whatever started `make test`.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(trylast=True)  # after `-m` has left out its tests
def pytest_collection_modifyitems(items):
    """Files that ask `diagnose` first, those with most tests before the others: they take longest, and the short files fill the
    last gaps between the processes.  The order within a file stays."""
    tests_in = collections.Counter(item.path for item in items)
    asks = {path: "diagnose" in path.read_text(encoding="utf-8") for path in tests_in}
    items.sort(key=lambda item: (not asks[item.path], -tests_in[item.path], item.path))
