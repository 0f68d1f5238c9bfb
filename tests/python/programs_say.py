# SPDX-License-Identifier: MIT
"""What the programs say of a log, for tests that the package says the same."""
import subprocess

from imucal.__main__ import main
from where import BIN

DP = BIN / "dp"


def dp_says(path):
    """(status, words on standard error) of `dp`."""
    done = subprocess.run([DP, path, "--no-ratios", "--tau", "1", "--quiet"], capture_output=True, text=True, timeout=60)
    return done.returncode, done.stderr


def check_all_name_the_field(path, line, column, shown, capsys):
    """dp, check, import and look refuse a log for one field, by its line and column, with the text that is shown of it."""
    status, words = dp_says(path)
    assert status == 3 and f"{path.name}:{line}: column {column}: expected" in words and f'"{shown}"' in words, words
    out = path.with_name("out.png")
    for command in (["check", str(path)], ["import", str(path), "-o", str(out)], ["look", str(path), "-o", str(out)]):
        assert main(command) == 3
        said = capsys.readouterr().err
        assert f'{path.name}:{line}: column {column}: expected a number, found "{shown}"' in said, (command, said)
