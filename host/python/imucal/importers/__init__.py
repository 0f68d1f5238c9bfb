# SPDX-License-Identifier: MIT
"""Logs of other programs, known by their content.

Each importer is a module with ``streams(path, options) -> list of Stream``; heavy libraries are imported only there.
"""
import hashlib
import importlib
import math
import os
import re
from dataclasses import dataclass

import numpy as np

from ..ahead import ahead
from ..errors import DataError, UsageError
from ..ingest import Imported, describe, to_log
from ..inputs import CR_ENDS, ends_in_cr, other_coding, plain_file
from ..log import need_readable
from ..version import VERSION

#: first bytes -> (format, module)
MAGICS = [
    (b"ULog\x01\x12\x35", "px4-ulog", "ulog"),
    (b"\xa3\x95\x80", "ardupilot", "ardupilot"),
    (b"#ROSBAG V", "rosbag1", "ros"),
    (b"SQLite format 3\0", "rosbag2", "ros"),
    (b"\x89MCAP0\r\n", "rosbag2", "ros"),
    (b"MATLAB ", "matlab", "matlab"),
    (b"\x89HDF\r\n\x1a\n", "matlab", "matlab"),
    (b"PAR1", "parquet", "columns"),
]
FORMATS = "PX4 ULog, ArduPilot .bin, ROS 1 and ROS 2 bags, MATLAB .mat, Parquet, CSV, CXD5602PWBIMU hex text, imucal logs"

_OF_TABLES = ("time", "gyro", "accel", "unit", "scale", "temp")
#: format -> what may be said of it besides --instance, --rate, --accel, --keep-moving and --without-temp
_KNOWN_OPTIONS = {"px4-ulog": ("topic",), "rosbag1": ("topic", "temp"), "rosbag2": ("topic", "temp"), "matlab": _OF_TABLES, "parquet": _OF_TABLES, "csv": _OF_TABLES}
#: of a text, of the characters that are no UTF-8
_MOST_ODD_PART = 0.1
_OPTION_NAMES = {"accel": "--accel-columns", "rate_hz": "--rate"}
_WARMER_THAN_ANY_SENSOR_DEGC = 200


def named_twice(column):
    """The UsageError."""
    return UsageError(f"column {column} is named twice: each of time, axes and temperature has a column of its own")


@dataclass
class Options:
    """What the user said of the file; None: find out."""

    instance: int = None
    time: str = None
    gyro: str = None
    accel: str = None
    unit: str = None
    scale: float = None
    temp: str = None
    rate_hz: float = None
    topic: str = None
    with_accel: bool = False
    keep_moving: bool = False
    temperature: bool = True

    def __post_init__(self):
        """UsageError: a rate or scale that cannot be, one column for two quantities."""
        if self.rate_hz is not None and not 0 < self.rate_hz < math.inf:
            raise UsageError(f"--rate {self.rate_hz:g}: expected the samples per second, more than 0")
        if self.scale is not None and not 0 < abs(self.scale) < math.inf:
            raise UsageError(f"--scale {self.scale:g}: expected the dph of one count, not 0")
        if self.scale is not None and self.unit != "counts":
            raise UsageError(f"--scale {self.scale:g}: is of counts; give --unit counts with it")
        time = (self.time or "").rpartition(":")
        named = [*(self.gyro or "").split(","), *(self.accel or "").split(","), time[0] or time[2], re.sub(r":[CKFckf]$", "", self.temp or "")]
        for name in filter(None, named):
            if named.count(name) > 1:
                raise named_twice(name)


def detect(path):
    """(format, module) of a file by its content; DataError names what was found."""
    path = os.fspath(path)
    if os.path.isdir(path):
        if os.path.exists(os.path.join(path, "metadata.yaml")):
            return "rosbag2", "ros"
        raise DataError(f"{path}: a folder without metadata.yaml: no ROS 2 bag")
    try:
        with open(path, "rb") as file:
            head = file.read(4096)
    except OSError as error:
        raise DataError(f"{path}: cannot open: {error.strerror}") from None
    if not head:
        raise DataError(f"{path}: the file is empty")
    if coding := other_coding(head, only_marks=True):
        raise DataError(f"{path}: {coding}")
    for magic, name, module in MAGICS:
        if head.startswith(magic):
            return name, module
    if head.startswith(b"BBL") or head.startswith(b"H Product:Blackbox"):
        raise DataError(f"{path}: a Betaflight/INAV blackbox in its own coding; decode it first: "
                        f"blackbox_decode --unit-rotation deg/s {path}   then   imucal import …01.csv -o LOG.csv")
    if head.startswith(b"\xfd") or head[:1] == b"\xfe":
        raise DataError(f"{path}: looks like MAVLink telemetry (.tlog), which carries too few samples; take the .bin log of the vehicle")
    return _detect_text(path, head)


def _detect_text(path, head):
    if coding := other_coding(head):
        raise DataError(f"{path}: {coding}")
    text = head[:4000].decode("utf-8-sig", errors="replace")
    is_text = text.count("\ufffd") <= _MOST_ODD_PART * len(text)  # a remark in another coding is no fault of a log
    if not is_text or any(c < " " and c not in "\r\n\t" for c in text):
        raise DataError(f"{path}: begins with the bytes {head[:8].hex(' ')}: none of the formats known here ({FORMATS})")
    if not text.strip():
        raise DataError(f"{path}: the file holds no text but blanks")
    first = text.splitlines()[0]
    fields = first.split(",")
    if len(fields) == 8 and all(len(f.strip()) == 8 and set(f.strip().lower()) <= set("0123456789abcdef") for f in fields):
        return "cxd5602-hex", "hextext"
    if first.lstrip().startswith(("{", "[")):
        raise DataError(f"{path}: a JSON file, not a log; imucal check {path} tells which")
    if ends_in_cr(text):
        raise DataError(f"{path}: {CR_ENDS}")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if lines and lines[0].replace(" ", "").startswith("t_s,temp_degc,"):
        return "imucal-log", "own"
    return "csv", "columns"


def need(module, package, path, what):
    """Import an optional library; DataError with the command that installs it."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise DataError(f"{path}: {what} is read with the Python library {package}, which is not installed: pip install {package}") from None


def cause(error):
    """What a library says of a file, in one line."""
    return ": ".join([type(error).__name__, *str(error).splitlines()[:1]])


def file_sha256(path):
    """SHA-256 of a file, or of the files of a bag's folder in order of their names."""
    digest = hashlib.sha256()
    paths = [os.path.join(path, n) for n in sorted(os.listdir(path))] if os.path.isdir(path) else [path]
    for name in paths:
        with open(name, "rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def _choose(path, streams, instance):
    names = "; ".join(f"{s.instance}: {s.name}" for s in streams)
    if instance is None:
        if len(streams) == 1:
            return streams[0]
        raise DataError(f"{path}: {len(streams)} sensors and none chosen ({names}); one log is of one sensor: "
                        f"imucal import {path} -o LOG.csv --instance {streams[0].instance}")
    for stream in streams:
        if stream.instance == instance:
            return stream
    raise DataError(f"{path}: no sensor {instance} (there are: {names})")


def check_options(path, name, options):
    """UsageError: something was said that a file of this format does not leave open."""
    known = _KNOWN_OPTIONS.get(name, ())
    for field in (*_OF_TABLES, "topic", *(["rate_hz"] if name == "imucal-log" else [])):
        if getattr(options, field) is not None and field not in known:
            raise UsageError(f"{path}: {_OPTION_NAMES.get(field, '--' + field)} {getattr(options, field)}: a {name} file states this itself; leave it out")
    if name == "px4-ulog" and options.topic not in (None, "sensor_gyro", "sensor_combined"):
        raise UsageError(f"{path}: --topic {options.topic}: of a ULog sensor_gyro or sensor_combined is read")


def open_file(path, options):
    """(format, streams) of a file."""
    name, module = detect(path)
    check_options(path, name, options)
    streams = importlib.import_module(f"{__name__}.{module}").streams(os.fspath(path), options)
    if not streams:
        raise DataError(f"{path}: {name}: no gyro found")
    return name, streams


def import_log(path, options=None, **settings):
    """Import a log of another program.

    Parameters
    ----------
    path : str                   plain or gzip; "-": standard input
    options : Options
    settings :                   the fields of Options as keywords: instance, time, gyro, unit, temp, rate_hz, …

    Returns
    -------
    Imported : the log in dph and degC, and what was found, chosen and left out

    Raises
    ------
    DataError : what was found, what is missing, the command that helps
    """
    options = options or Options(**settings)
    with plain_file(path) as source:
        return _import(source, options)


def _import(source, options):
    path = source.path
    sha256_of_file = ahead(file_sha256, source.given)
    name, streams = open_file(path, options)
    sensors = [describe(s, options.rate_hz) for s in streams]
    stream = _choose(path, streams, options.instance)
    if options.with_accel and name != "imucal-log" and "mg" not in stream.axis_units:
        raise DataError(f"{path}: sensor {stream.instance} ({stream.name}): no accelerometer is taken with it; leave --accel out")
    log, counts = to_log(path, stream, options.rate_hz, options.temperature, options.keep_moving)
    need_readable(path, log)
    sha256, log.path = sha256_of_file(), source.name
    log.metadata = {"source": source.base, "source_format": name, "source_sha256": sha256,
                    "imported_by": f"imucal {VERSION}", "sensor": f"{stream.instance} {stream.name}", **log.metadata,
                    "seconds_moving_left_out": counts["moving_seconds"], "seconds_missing": counts["gap_seconds"]}
    if log.has_temperature and np.nanmin(log.temp_degc) > _WARMER_THAN_ANY_SENSOR_DEGC:
        stream.notes.append(f"temperatures of {np.nanmin(log.temp_degc):.1f} to {np.nanmax(log.temp_degc):.1f}: are they in kelvin? temp_degc is in degrees "
                            "Celsius")
    return Imported(log, name, sensors, stream.instance, source_sha256=sha256, notes=[source.said(n) for n in stream.notes], **counts)
