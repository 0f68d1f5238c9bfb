# SPDX-License-Identifier: MIT
"""What host/README.md says that all programs share, of every command that they have."""
import re
import subprocess

import pytest

from where import BIN

PROGRAMS = ("calibrate", "dp", "errormodel", "profile", "montecarlo", "gyrosim", "diagnose")
OF_THE_PACKAGE = ("import", "look", "check", "export", "example")


def helped(*words):
    done = subprocess.run([BIN / words[0], *words[1:], "--help"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


def commands():
    """Every program, or each of its subcommands and, where it works without one, itself."""
    for program in PROGRAMS:
        text = helped(program)
        below = re.findall(r"^  ([a-z]+)  ", text.partition("\nSubcommands:\n")[2], re.M)
        if not below or "[SUBCOMMAND]" in text:
            yield (program,)
        yield from ((program, name) for name in below)
    yield from (("imucal", name) for name in OF_THE_PACKAGE)


COMMANDS = list(commands())


def test_every_program_is_asked():
    assert {words[0] for words in COMMANDS} == {*PROGRAMS, "imucal"} and len(COMMANDS) > 30


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_command_takes_threads_quiet_and_json(words):
    shared = helped(*words) + helped(words[0]) if words[0] == "calibrate" else helped(*words)  # its options stand before the subcommand too
    assert all(re.search(rf"{option}[ ,]", shared) for option in ("--threads", "--quiet", "--json"))
    for value in ("2", "0"):
        assert "--threads" not in said(*words, "--threads", value)
    assert "--threads" in said(*words, "--threads", "many")
    assert "--threads" in said(*words, "--threads=1025")


def said(*words):
    """What a command complains of; it cannot begin: it is given an option that nobody has."""
    done = subprocess.run([BIN / words[0], *words[1:], "--no-such-option"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2, done
    return done.stderr.partition("(try ")[0].replace("[--threads N]", "")


def test_threads_before_and_behind_the_subcommand_give_the_same_bound(tmp_path):
    (tmp_path / "model.json").write_text('{"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}]}')
    rest = ["--model", tmp_path / "model.json", "--order", "3", "--duration-s", "8400"]
    texts = [subprocess.run([BIN / "profile", *words, *rest], capture_output=True, text=True, check=True).stdout
             for words in (["bound"], ["bound", "--threads", "3"], ["--threads", "3", "bound"])]
    assert texts[0] == texts[1] == texts[2] and "6.22" in texts[0]
