# SPDX-License-Identifier: MIT
def pytest_configure(config):
    config.addinivalue_line("markers", "long: many more draws of a test that has a short form; `make test` leaves them to `make test-long`")
