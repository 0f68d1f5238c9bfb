# SPDX-License-Identifier: MIT
"""``imucal import``."""
import os
import sys

from .cli import common_options, finish_json, parser_of
from .errors import DataError, UsageError
from .importers import FORMATS, Options, describe, import_log, open_file
from .inputs import plain_file
from .log import keep_input, write_log


def _parser():
    parser = parser_of("import", "Import a log of another program: 1-s means at rest, in dph and degC. Formats, by content: " + FORMATS + ".")
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("-o", "--output", metavar="LOG.csv", help="log to write (- for standard output); default: FILE's name with .csv, in this folder")
    parser.add_argument("--list", action="store_true", help="only say which sensors the file holds")
    parser.add_argument("--instance", type=int, metavar="N", help="sensor to take where the file holds several")
    parser.add_argument("--topic", help="ROS topic, or PX4's sensor_combined instead of sensor_gyro")
    parser.add_argument("--time", metavar="COL[:UNIT]", help="time column of a table; unit s, ms, us or ns")
    parser.add_argument("--gyro", metavar="X,Y,Z", help="gyro columns of a table")
    parser.add_argument("--unit", choices=["dph", "dps", "mdps", "radps", "counts"], help="of the gyro columns")
    parser.add_argument("--scale", type=float, metavar="DPH", help="dph per count, with --unit counts")
    parser.add_argument("--temp", metavar="COL[:UNIT]", help="temperature column of a table, unit C, K or F (ROS: topic)")
    parser.add_argument("--rate", type=float, metavar="HZ", help="nominal sample rate; default: what the time stamps show")
    parser.add_argument("--accel", action="store_true", help="import the accelerometer's axes too (mg)")
    parser.add_argument("--accel-columns", metavar="X,Y,Z", help="accelerometer columns of a table")
    parser.add_argument("--keep-moving", action="store_true", help="do not leave out the seconds in which the device moves")
    parser.add_argument("--without-temp", action="store_true", help="accept a sensor without temperature; temp_degc stays empty")
    parser.add_argument("--notes-only", action="store_true", help="print only what the user must know, to standard error")
    common_options(parser)
    return parser


def _options(given):
    return Options(given.instance, given.time, given.gyro, given.accel_columns, given.unit, given.scale, given.temp, given.rate, given.topic,
                   given.accel or bool(given.accel_columns), given.keep_moving, not given.without_temp)


def _default_output(source):
    name = source.stem + ".csv"
    if source.name == "standard input":
        raise UsageError("of standard input: name the log to write: imucal import - -o LOG.csv")
    if os.path.exists(name):
        raise DataError(f"{name}: is there already; name the log to write: imucal import {source.name} -o LOG.csv")
    return name


def _print(result, output):
    log = result.log
    span = f", {log.temp_degc[log.temp_degc == log.temp_degc].min():.2f} to {log.temp_degc[log.temp_degc == log.temp_degc].max():.2f} degC" \
        if log.has_temperature else ", no temperature"
    print(f"{result.format}: sensor {log.metadata['sensor']}\n{len(log.t_s)} s at rest{span}, axes {' '.join(log.axes)}, written to {output}\n"
          f"left out: {result.moving_seconds} s moving, {result.n_duplicate} duplicate and {result.n_backward} late samples; "
          f"{result.gaps} gaps of {result.gap_seconds} s in all")


def run(arguments):
    """Run the command; returns the exit status."""
    given = _parser().parse_args(arguments)
    options = _options(given)
    with plain_file(given.file) as source:
        return _import(given, source, options)


def _import(given, source, options):
    if given.list:
        name, streams = open_file(source, options)
        sensors = [describe(s, options.rate_hz) for s in streams]
        for s in sensors:
            print(f"{s['instance']}: {s['name']}: {' '.join(s['axes'])} at {s['rate_hz']:g} Hz, "
                  f"{'with' if s['has_temperature'] else 'without'} temperature")
        finish_json(given.json, {"format": name, "sensors": sensors})
        return 0
    output = given.output or _default_output(source)
    keep_input(given.file, output, given.json)
    result = import_log(source, options)
    write_log(output, result.log)
    if not given.notes_only and not given.quiet and output != "-" and given.json != "-":
        _print(result, output)
    for note in result.notes:
        print(f"imucal import: {source.base}: note: {note}", file=sys.stderr)
    finish_json(given.json, result.to_json())
    return 0
