# SPDX-License-Identifier: MIT
"""``imucal export``."""
import importlib
import math
import re
import sys

from .cli import common_options, finish_json, parser_of
from .errors import DataError, UsageError
from .inputs import plain_file
from .log import keep_input, write_text
from .strict import read_json
from .table import read_table

_TABLE = {"px4": "px4", "ardupilot": "ardupilot", "c-header": "c_header", "json": "plain_json"}
#: what a target takes besides
_OPTIONS = {"px4": ("instance", "device_id"), "ardupilot": ("instance",), "c-header": ("prefix",), "kalibr": ("accel", "rate_hz"), "ros": ("accel", "rate_hz"),
            "matlab": ("rate_hz",)}
_LARGEST_ID = 2**31 - 1  # PX4's parameter TC_G*_ID is an INT32
_MODEL = ["kalibr", "ros", "matlab", "datasheet"]


def _parser():
    parser = parser_of("export", "Write a calibration table for an autopilot or firmware, or an error model as other programs state noise.")
    parser.add_argument("file", metavar="TABLE.json|MODEL.json")
    parser.add_argument("--to", required=True, choices=[*_TABLE, *_MODEL], help="px4, ardupilot, c-header, json: of a table; the others: of a model")
    parser.add_argument("-o", "--output", default="-", metavar="FILE", help="file to write (default -: standard output)")
    parser.add_argument("--instance", type=int, metavar="N", help="sensor number on the autopilot, from 0")
    parser.add_argument("--device-id", type=int, metavar="ID", help="PX4's id of the sensor (TC_G*_ID)")
    parser.add_argument("--prefix", metavar="NAME", help="of the names in the C header (default imucal_table)")
    parser.add_argument("--accel", metavar="MODEL.json", help="the accelerometer's model beside the gyro's (kalibr, ros)")
    parser.add_argument("--rate-hz", type=float, metavar="HZ", help="sample rate, for formats that state one")
    common_options(parser)
    return parser


def _check_options(given):
    """UsageError: what the target does not take, or no target could hold."""
    for option in ("instance", "device_id", "prefix", "accel", "rate_hz"):
        if getattr(given, option) is not None and option not in _OPTIONS.get(given.to, ()):
            raise UsageError(f"--{option.replace('_', '-')} says nothing to --to {given.to}; leave it out")
    if given.device_id is not None and not 0 <= given.device_id <= _LARGEST_ID:
        raise UsageError(f"--device-id {given.device_id}: expected a whole number 0 .. {_LARGEST_ID}")
    if given.rate_hz is not None and not 0 < given.rate_hz < math.inf:
        raise UsageError(f"--rate-hz {given.rate_hz:g}: expected the samples per second, more than 0")
    if given.prefix is not None and not re.fullmatch(r"[A-Za-z_]\w*", given.prefix, re.ASCII):
        raise UsageError(f"--prefix {given.prefix}: expected letters, digits and _, and no digit first: names in C begin with it")


def _export(given, source):
    if given.to in _TABLE:
        module = importlib.import_module(f".export.{_TABLE[given.to]}", __package__)
        return module.export(read_table(source), given)
    from .export.noise import TARGETS, read_noise
    data = read_json(source)
    if isinstance(data, dict) and "imucal_table" in data:
        raise DataError(f"{source.path}: a calibration table; --to {given.to} needs an error model: imucal errormodel fit LOG.csv --markov 1 "
                        "--criterion ml -o model.json")
    return TARGETS[given.to](read_noise(source), given)


def run(arguments):
    """Run the command; returns the exit status."""
    given = _parser().parse_args(arguments)
    _check_options(given)
    keep_input(given.file, given.output, given.json)
    with plain_file(given.file) as source:
        text, notes = _export(given, source)
        notes = [source.said(note) for note in notes]
    write_text(given.output, text)
    for note in notes:
        print(f"imucal export: note: {note}", file=sys.stderr)
    finish_json(given.json, {"file": given.file, "to": given.to, "output": given.output, "notes": notes})
    return 0
