# SPDX-License-Identifier: MIT
"""Habits shared by the package's subcommands: --json, --quiet, --version, errors and exit status."""
import argparse
import json
import math

from .version import VERSION
from .log import write_text


def parser_of(name, description):
    """An argument parser that answers as the C++ programs do (usage errors: 2)."""
    parser = argparse.ArgumentParser(prog=f"imucal {name}", description=description)
    parser.add_argument("--version", action="version", version=f"imucal {name} (imucal) {VERSION}")
    return parser


def whole(most, called=None):
    """The type of an option that is a whole number from 0 to `most`, which a message may call otherwise."""
    def number(text):
        if not (text.isascii() and text.isdecimal() and int(text) <= most):
            raise argparse.ArgumentTypeError(f"expected a whole number 0 .. {called or most}, found \"{text}\"")
        return int(text)
    return number


_threads = whole(1024)  # the programs' limits (host/tools/cli/program.cpp)


def common_options(parser):
    """--json, --quiet and --threads."""
    parser.add_argument("--json", metavar="FILE", help="write the result as JSON to FILE (- for standard output)")
    parser.add_argument("-q", "--quiet", action="store_true", help="no text but errors")
    parser.add_argument("--threads", type=_threads, metavar="N", help="as for the other commands; this one chooses by itself")


def _plain(value):
    """JSON knows no NaN, and no numpy."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finish_json(path, result):
    """Write the result where --json asks for it."""
    if path:
        write_text(path, json.dumps(_plain(result), indent=2, ensure_ascii=False) + "\n")
