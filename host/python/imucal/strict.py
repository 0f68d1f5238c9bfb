# SPDX-License-Identifier: MIT
"""JSON as the programs read it: no NaN, no member twice, and of our own kinds the programs' own fields and limits (host/lib/io, by the
compiled part).  Messages name file, line and field."""
import json
import json.decoder
import os
import re

from .errors import DataError
from .inputs import not_utf8, plain_file
from .native import core

N_TEMPERATURES = 9  # of a table's predicted error, evenly over its span
_PLACE = re.compile(r"((?:[A-Za-z_]\w*)(?:\[\d+\]|\.[A-Za-z_]\w*)*)(?: \([^)]*\) ([A-Za-z_]\w*))?")


class _Constant(ValueError):
    """NaN or an infinity, which JSON has not."""


def _no_constant(name):
    raise _Constant(name)


def _skip(text, at):
    while at < len(text) and text[at] in " \t\r\n,:":
        at += 1
    return at


def positions(text):
    """{path: index in the text} of every value of a JSON text that parses; a path is a tuple of keys and places."""
    found, decoder = {}, json.decoder.JSONDecoder()

    def walk(at, path):
        at = _skip(text, at)
        found[path] = at
        if text[at] == "{":
            at = _skip(text, at + 1)
            while text[at] != "}":
                key, at = json.decoder.scanstring(text, at + 1)
                at = _skip(text, walk(at, (*path, key)))
            return at + 1
        if text[at] == "[":
            at, i = _skip(text, at + 1), 0
            while text[at] != "]":
                at, i = _skip(text, walk(at, (*path, i))), i + 1
            return at + 1
        return decoder.raw_decode(text, at)[1]

    walk(0, ())
    return found


def line_of(text, at):
    """Number of the line that holds text[at], from 1."""
    return text.count("\n", 0, at) + 1


def _asked(path, text, kind):
    """The programs' message on a text of a kind ("" : any JSON) with file and line, or None where they take it."""
    message = core().check_json(text, kind)
    if message is None:
        return None
    stated = re.match(r":(\d+): (.*)", message, re.S)
    if stated:
        return f"{path}:{stated[1]}: {stated[2]}"
    words, places, at = message.removeprefix(": "), positions(text) if kind else {(): 0}, ()
    named = _PLACE.match(words)
    for name in re.findall(r"\w+", f"{named[1]} {named[2] or ''}") if named else ():
        deeper = [(*at, int(name) if name.isdigit() else name), (*at, f"{name}_dph"), (*at, f"{name}_mg")]  # a table's "coeff" is coeff_dph
        if not any(way in places for way in deeper):
            break
        at = next(way for way in deeper if way in places)
    return f"{path}:{line_of(text, places[at])}: {words}"


def parse(path, text):
    """The value of a JSON text; DataError where the programs would not read it."""
    data = None
    try:
        data = json.loads(text, parse_constant=_no_constant)
    except json.JSONDecodeError as error:
        place = f"column {error.colno}: {error.msg}"
        words = place if text.lstrip().startswith(("{", "[")) else f"no JSON ({place}); imucal check {path} tells what it is"
        raise DataError(f"{path}:{error.lineno}: {words}") from None
    except _Constant as error:
        at = next(m.start() for m in re.finditer(r'"(?:\\.|[^"\\])*"|NaN|-?Infinity', text, re.S) if not m[0].startswith('"'))
        raise DataError(f"{path}:{line_of(text, at)}: {error} is not a finite number, and no JSON; give a number or leave the field out") from None
    except (RecursionError, ValueError):  # the programs say how deep is too deep, and which number is too large
        pass
    message = _asked(path, text, "")
    if message:
        raise DataError(message)
    return data


def _table_contradiction(path, data, text):
    """Where a table contradicts itself, or None.  The programs do not see it: they derive temp_degc from the span, and know an
    axis by its place."""
    places, names = positions(text), set()
    for i, axis in enumerate(data["axes"]):
        if axis["axis"] in names:
            return f"{path}:{line_of(text, places[('axes', i, 'axis')])}: axes[{i}].axis: {axis['axis']} is there already; each axis has a table of its own"
        names.add(axis["axis"])
        lo, hi = axis["span_degc"]
        temp = axis.get("temp_degc")
        is_list = isinstance(temp, list) and all(isinstance(t, (int, float)) for t in temp)
        evenly = [lo + (hi - lo) * k / (N_TEMPERATURES - 1) for k in range(N_TEMPERATURES)]
        is_even = is_list and len(temp) == len(evenly) and all(abs(t - e) <= 1e-3 * (hi - lo) for t, e in zip(temp, evenly))
        if temp is not None and not is_even:
            return (f"{path}:{line_of(text, places[('axes', i, 'temp_degc')])}: axes[{i}].temp_degc: expected nine temperatures "
                    f"evenly from {lo:g} to {hi:g} degC, the span")
    return None


def refusal(path, data, text, kind):
    """Why a "model", "profile" or "table" that parses is not taken, by the programs or for what a table says twice; None: it is."""
    return _asked(path, text, kind) or (_table_contradiction(path, data, text) if kind == "table" else None)


def read_text(path):
    """A text file; DataError where it is none."""
    with plain_file(path) as source:
        return _text_of(source.path)


def _text_of(path):
    try:
        with open(path, encoding="utf-8-sig") as file:
            return file.read()
    except OSError as error:
        raise DataError(f"{path}: cannot open: {error.strerror}") from None
    except UnicodeDecodeError:
        raise DataError(not_utf8(path, "not a JSON file (no text)")) from None


def read_json(path):
    """A JSON file's value, as the programs read it."""
    path = os.fspath(path)
    return parse(path, read_text(path))


def _without_null(value):
    """The same without the members that are null: the programs take such a one for left out."""
    if isinstance(value, dict):
        return {key: _without_null(member) for key, member in value.items() if member is not None}
    return [_without_null(entry) for entry in value] if isinstance(value, list) else value


def read_valid(path, kind, tag, otherwise):
    """The dict of a "model" or "table" that the programs take; `otherwise`: what to say of a JSON file without the member `tag`."""
    path = os.fspath(path)
    text = read_text(path)
    data = parse(path, text)
    if not isinstance(data, dict) or tag not in data:
        raise DataError(f"{path}: {otherwise}; imucal check {path} tells what it is")
    message = refusal(path, data, text, kind)
    if message:
        raise DataError(message)
    return _without_null(data)
