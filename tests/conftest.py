# SPDX-License-Identifier: MIT
import signal


def pytest_configure(config):
    config.addinivalue_line("markers", "long: many more draws of a test that has a short form; `make test` leaves them to `make test-long`")
    # A shell without job control starts what it puts into the background with SIGINT ignored, and that is inherited.
    # Tests that interrupt a program need it as on a terminal, whatever started `make test`.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
