# SPDX-License-Identifier: MIT
"""A program that runs beside a test and ends with it."""
import subprocess


class Child:
    """Starts `command`; killed and waited for at the end of the `with` block."""

    def __init__(self, *command):
        self.process = subprocess.Popen([str(a) for a in command], stdout=subprocess.PIPE, text=True)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
