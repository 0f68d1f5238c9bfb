# SPDX-License-Identifier: MIT
"""Text of the C++ programs: wrapped with a hanging indent on a terminal, a statement a line in a file or a pipe."""
import fcntl
import json
import os
import pty
import re
import struct
import subprocess
import termios

import pytest

from reference import BASIC, MODEL
from where import BIN


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("width")
    (path / "model.json").write_text(json.dumps(MODEL))
    (path / "chamber.json").write_text(json.dumps(BASIC))
    subprocess.run([BIN / "gyrosim", "log", "--model", "model.json", "--profile", "chamber.json", "--seed", "2", "-q", "-o", "run.csv"],
                   cwd=path, check=True)
    rows = [line.split(",") for line in (path / "run.csv").read_text().splitlines()]
    for k, row in enumerate(rows):
        if row[0][0].isdigit() and k % 397 == 20:
            row[2] = "20000"
    (path / "wild.csv").write_text("\n".join(",".join(row) for row in rows) + "\n")
    return path


def on_terminal(folder, columns, *command):
    """What a terminal of so many columns (0: it does not say) gets on standard output and standard error."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    process = subprocess.Popen([BIN / command[0], *command[1:]], cwd=folder, stdout=theirs, stderr=theirs)
    os.close(theirs)
    text = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        text += part
    process.wait(timeout=60)
    os.close(ours)
    lines = re.sub(r"[^\n]*\r(?:\033\[K)?(?!\n)", "", text.decode().replace("\r\n", "\n")).split("\n")
    return [line for line in lines if line.strip()]


def in_pipe(folder, *command):
    done = subprocess.run([BIN / command[0], *command[1:]], cwd=folder, capture_output=True, text=True, timeout=60)
    return done.stdout + done.stderr


COMMANDS = [("diagnose", "--log", "wild.csv", "--nulls", "50", "--no-cache"),
            ("calibrate", "fit", "wild.csv", "--model", "model.json"),
            ("calibrate", "fit", "run.csv", "--method", "poly"),
            ("errormodel", "fit", "wild.csv", "--markov", "1", "--criterion", "ml"),
            ("dp", "wild.csv", "--type", "av", "--tau", "1:1000:200")]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: "-".join(c[:2]))
def test_no_line_is_wider_than_the_terminal_and_none_is_broken_in_a_pipe(folder, command):
    lines = on_terminal(folder, 80, *command)
    assert max(map(len, lines)) <= 80, max(lines, key=len)
    piped = in_pipe(folder, *command)
    words = lambda text: sorted(text.split())
    assert words(" ".join(lines)) == words(piped)  # the same words
    assert max(map(len, piped.splitlines())) > 80
    assert on_terminal(folder, 0, *command) == lines
    assert max(map(len, on_terminal(folder, 120, *command))) in range(81, 121)


def test_lines_hang_under_their_text(folder):
    lines = on_terminal(folder, 80, *COMMANDS[0])
    begin = next(k for k, line in enumerate(lines) if line.startswith("advice    "))
    assert lines[begin + 1].startswith(" " * 10) and lines[begin + 1][10] != " "
