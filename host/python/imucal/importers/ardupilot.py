# SPDX-License-Identifier: MIT
"""ArduPilot dataflash logs (.bin).

GYR holds raw rates where INS_RAW_LOG_OPT asks for them; IMU holds the rates ArduPilot flies with, after its offsets
(INS_GYROFFS_*) and, with INS_TCALn_ENABLE = 1, after its own temperature correction, and the temperature T.
The messages are described by FMT messages in the file; pymavlink finds them, numpy decodes them.
Source: ArduPilot AP_Logger/LogStructure.h, AP_InertialSensor/LogStructure.h.
"""
import contextlib
import io

import numpy as np

from ..errors import DataError
from ..stream import Motion, Stream
from ..units import DPH_PER_RADPS, MG_PER_MS2
from . import cause, need
from .tail import CUT, dataflash_is_cut

#: format letter -> numpy type; c C e E are hundredths (LogStructure.h)
_TYPES = {"b": "i1", "B": "u1", "M": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "f": "<f4", "d": "<f8", "q": "<i8", "Q": "<u8",
          "n": "S4", "N": "S16", "Z": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4", "a": "V64", "g": "<f2"}
_HUNDREDTHS = set("cCeE")
_HEADER = 3


class _Messages:
    """The messages of a log as numpy record arrays."""

    def __init__(self, path):
        reader = need("pymavlink.DFReader", "pymavlink", path, "an ArduPilot .bin")
        try:
            with contextlib.redirect_stdout(io.StringIO()):  # it prints what it does not know
                self._log = reader.DFReader_binary(path)
        except Exception as error:
            raise DataError(f"{path}: an ArduPilot log that cannot be read ({cause(error)}); download it again") from None
        self._bytes = np.frombuffer(self._log.data_map, np.uint8)
        self._by_name = {f.name: f for f in self._log.formats.values()}
        self.lengths = {f.type: f.len for f in self._log.formats.values()}

    def __contains__(self, name):
        return len(self.offsets(name)) > 0

    def offsets(self, name):
        """Places of the whole messages of this name."""
        if name not in self._by_name:
            return np.zeros(0, np.int64)
        offsets = np.asarray(self._log.offsets[self._by_name[name].type], np.int64)
        return offsets[offsets + self._by_name[name].len <= len(self._bytes)]

    def read(self, name):
        """{column: array} of the messages."""
        fmt, offsets = self._by_name[name], self.offsets(name)
        kind = np.dtype([(c, _TYPES[t]) for c, t in zip(fmt.columns, fmt.format)])
        body = self._bytes[offsets[:, None] + np.arange(_HEADER, _HEADER + kind.itemsize)]
        records = np.ascontiguousarray(body).view(kind).ravel()
        return {c: records[c] / 100.0 if t in _HUNDREDTHS else records[c] for c, t in zip(fmt.columns, fmt.format)}


def _split(messages, stem):
    """{instance: columns}: by the field I (4.1 and later) or by the message's name (IMU, IMU2, IMU3; GYR1 …)."""
    found = {}
    for i, name in enumerate([stem, f"{stem}2", f"{stem}3"] if stem == "IMU" else [stem]):
        if name in messages:
            data = messages.read(name)
            if "I" in data:
                for instance in np.unique(data["I"]):
                    found[int(instance)] = {c: v[data["I"] == instance] for c, v in data.items()}
            else:
                found[i] = data
    if stem != "IMU":
        for i in range(3):
            if f"{stem}{i + 1}" in messages:
                found[i] = messages.read(f"{stem}{i + 1}")
    return found


def _xyz(data, stem):
    return np.stack([data[f"{stem}{a}"].astype(np.float64) for a in "XYZ"], axis=1)


def _parameters(messages):
    if "PARM" not in messages:
        return {}
    data = messages.read("PARM")
    return {n.rstrip(b"\0").decode("ascii", "replace"): float(v) for n, v in zip(data["Name"], data["Value"])}


def _vibration(messages):
    """VIBE is an rms of acceleration in m/s2 above 5 Hz; at rest it stays well below one."""
    if "VIBE" not in messages:
        return []
    data = messages.read("VIBE")
    if "IMU" in data:
        first = data["IMU"] == data["IMU"].min()
        data = {c: v[first] for c, v in data.items()}
    moving = _xyz(data, "Vibe").max(axis=1) > 3.0
    # As an accelerometer that reads far beyond rest in the seconds where the vehicle vibrates.
    shaken = np.where(moving, 1000.0, 0.0)[:, None] * (1 - 2 * (np.arange(len(moving)) % 2))[:, None]
    return [Motion("accel", data["TimeUS"].astype(np.int64), np.repeat(shaken, 3, axis=1))]


def _stream(instance, imu, raw, parameters, messages, options):
    rates = raw if raw is not None else imu
    t_us = rates["SampleUS" if "SampleUS" in rates else "TimeUS"].astype(np.int64)
    name = f"GYR instance {instance} (raw)" if raw is not None else f"IMU instance {instance}"
    stream = Stream(instance, name, ["gx", "gy", "gz"], t_us, _xyz(rates, "Gyr"), np.full(3, DPH_PER_RADPS), "rad/s",
                    metadata={"device": "ArduPilot", "ardupilot_instance": instance, "axes_frame": "ArduPilot body (FRD)"},
                    motion=_vibration(messages))
    if imu is not None:
        imu_t = imu["TimeUS"].astype(np.int64)
        accel = _xyz(imu, "Acc")
        stream.motion.append(Motion("accel", imu_t, accel * MG_PER_MS2))
        if "T" in imu:
            stream.temp_t_us, stream.temp_degc = (t_us if raw is None and "SampleUS" not in rates else imu_t), imu["T"].astype(np.float64)
        if options.with_accel and raw is None:
            stream.values = np.hstack([stream.values, accel])
            stream.axes += ["ax", "ay", "az"]
            stream.to_internal = np.concatenate([stream.to_internal, np.full(3, MG_PER_MS2)])
            stream.unit = "rad/s, m/s2"
    _note_corrections(stream, instance, raw is not None, parameters)
    return stream


def _note_corrections(stream, instance, is_raw, parameters):
    prefix = f"INS_TCAL{instance + 1}"
    enabled = parameters.get(f"{prefix}_ENABLE", 0)
    stream.metadata[f"{prefix}_ENABLE"] = f"{enabled:g}"
    if enabled == 1 and not is_raw:
        stream.notes.append(f"{prefix}_ENABLE = 1: these rates are already corrected for temperature; set it to 0 and record again")
    if not is_raw:
        stream.notes.append("IMU rates are less ArduPilot's own offsets (INS_GYROFFS_*, set at every start): the constant is not the sensor's")


def streams(path, options):
    """One stream per IMU."""
    messages = _Messages(path)
    imu, raw, parameters = _split(messages, "IMU"), _split(messages, "GYR"), _parameters(messages)
    if not imu and not raw:
        raise DataError(f"{path}: an ArduPilot log without IMU and GYR messages (those with a gyro); "
                        "set bit 7 (IMU) of LOG_BITMASK and LOG_DISARMED = 1, and record again")
    found = [_stream(i, imu.get(i), raw.get(i), parameters, messages, options) for i in sorted(set(imu) | set(raw))]
    if dataflash_is_cut(path, messages.lengths):
        for stream in found:
            stream.notes.append(CUT)
    return found
