# SPDX-License-Identifier: MIT
"""``imucal export``."""
import importlib
import sys

from .cli import common_options, finish_json, parser_of
from .errors import DataError
from .log import keep_input, write_text
from .table import read_json, read_table

_TABLE = {"px4": "px4", "ardupilot": "ardupilot", "c-header": "c_header", "json": "plain_json"}
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


def _export(given):
    if given.to in _TABLE:
        module = importlib.import_module(f".export.{_TABLE[given.to]}", __package__)
        return module.export(read_table(given.file), given)
    from .export.noise import TARGETS, read_noise
    if "imucal_table" in read_json(given.file):
        raise DataError(f"{given.file}: a calibration table; --to {given.to} needs an error model: imucal errormodel fit LOG.csv --markov 1 "
                        "--criterion ml -o model.json")
    return TARGETS[given.to](read_noise(given.file), given)


def run(arguments):
    """Run the command; returns the exit status."""
    given = _parser().parse_args(arguments)
    keep_input(given.file, given.output, given.json)
    text, notes = _export(given)
    write_text(given.output, text)
    for note in notes:
        print(f"imucal export: note: {note}", file=sys.stderr)
    finish_json(given.json, {"file": given.file, "to": given.to, "output": given.output, "notes": notes})
    return 0
