# SPDX-License-Identifier: MIT
"""PX4 ULog.

sensor_gyro holds the sensor's own rates with the temperature of the same chip.  sensor_combined and vehicle_imu hold rates
that PX4 has corrected (CAL_GYROn_*OFF and TC_G*): they serve as a fallback and to see motion.
Source: PX4 user guide, "ULog file format"; msg/SensorGyro.msg, msg/SensorCombined.msg.
"""
import contextlib
import io
import mmap
import os

import numpy as np

from ..errors import DataError
from ..native import core_or_none
from ..stream import Motion, Stream
from ..units import DPH_PER_RADPS, MG_PER_MS2
from . import cause, need
from .tail import CUT, ulog_is_cut

GYRO, ACCEL, COMBINED = "sensor_gyro", "sensor_accel", "sensor_combined"
_TYPES = {"int8_t": "i1", "uint8_t": "u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4", "uint32_t": "<u4", "int64_t": "<i8", "uint64_t": "<u8",
          "float": "<f4", "double": "<f8", "bool": "i1", "char": "i1"}
#: below this rate a 1-s mean is of too few samples to average the noise
MIN_RATE_HZ = 8.0


def _xyz(data, names):
    return np.stack([data[n].astype(np.float64) for n in names], axis=1)


def _times(data):
    """Time of the sample; the time of publication where the log has no other."""
    sample = data.get("timestamp_sample")
    return (sample if sample is not None and sample.any() else data["timestamp"]).astype(np.int64)


def _combined_motion(topics):
    motion = []
    for data in topics.get(COMBINED, {}).values():
        t_us = data["timestamp"].astype(np.int64)
        motion.append(Motion("gyro", t_us, _xyz(data, [f"gyro_rad[{i}]" for i in range(3)]) * DPH_PER_RADPS))
        motion.append(Motion("accel", t_us, _xyz(data, [f"accelerometer_m_s2[{i}]" for i in range(3)]) * MG_PER_MS2))
    return motion


def _metadata(log, device_id, instance):
    """What a report or an export later wants to know."""
    hardware, parameters = log.msg_info_dict.get("ver_hw"), log.initial_parameters
    found = {"device": hardware, "px4_device_id": device_id, "px4_instance": instance, "axes_frame": "PX4 body (FRD), as published"}
    for name in (f"CAL_GYRO{instance}_ID", f"CAL_GYRO{instance}_ROT", "TC_G_ENABLE", "IMU_GYRO_CUTOFF"):
        if name in parameters:
            found[name] = parameters[name]
    return {k: v for k, v in found.items() if v is not None}


def _accel_of(topics, instance):
    """The accelerometer beside gyro `instance`: same number."""
    data = topics.get(ACCEL, {}).get(instance)
    return None if data is None else (_times(data), _xyz(data, "xyz"))


def _gyro_stream(log, topics, instance, data, options):
    t_us = _times(data)
    device_id = int(data["device_id"][0]) if len(data.get("device_id", ())) else None
    name = f"{GYRO} instance {instance}" + (f", device id {device_id}" if device_id else "")
    stream = Stream(instance, name, ["gx", "gy", "gz"], t_us, _xyz(data, "xyz"), np.full(3, DPH_PER_RADPS), "rad/s", None, None,
                    _combined_motion(topics), _metadata(log, device_id, instance))
    if "temperature" in data:
        stream.temp_t_us, stream.temp_degc = t_us, data["temperature"].astype(np.float64)
    accel = _accel_of(topics, instance)
    if accel is not None and len(accel[0]) > 1:
        stream.motion.append(Motion("accel", accel[0], accel[1] * MG_PER_MS2))
        if options.with_accel:
            _add_accel(stream, *accel)
    return stream


def _add_accel(stream, t_us, accel):
    """Accelerometer axes at the gyro's times (the nearest sample)."""
    nearest = np.clip(np.searchsorted(t_us, stream.t_us), 0, len(t_us) - 1)
    stream.values = np.hstack([stream.values, accel[nearest]])
    stream.axes = stream.axes + ["ax", "ay", "az"]
    stream.to_internal = np.concatenate([stream.to_internal, np.full(3, MG_PER_MS2)])
    stream.unit = "rad/s, m/s2"


def _combined_stream(log, topics, data):
    """Without sensor_gyro, or on demand: what PX4 had already corrected."""
    stream = Stream(0, COMBINED, ["gx", "gy", "gz"], data["timestamp"].astype(np.int64), _xyz(data, [f"gyro_rad[{i}]" for i in range(3)]),
                    np.full(3, DPH_PER_RADPS), "rad/s", None, None, _combined_motion(topics), _metadata(log, None, 0))
    stream.option = f"--topic {COMBINED}"
    stream.notes.append("sensor_combined holds rates after PX4's own corrections (CAL_GYRO*, TC_G*): a calibration from it adds to them")
    temps = topics.get(GYRO, {})
    if len(temps) == 1 and "temperature" in temps[min(temps)]:
        only = temps[min(temps)]
        stream.temp_t_us, stream.temp_degc = _times(only), only["temperature"].astype(np.float64)
    return stream


def _split(path):
    """(file without the data messages of our topics but the first of each, {id: (bytes of a record, records)}), or None: the
    compiled part is not there, or the file is not simple."""
    core = core_or_none()
    if core is None:
        return None
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return core.split_ulog(np.frombuffer(data, np.uint8), [GYRO, ACCEL, COMBINED])


def _records(topic, block):
    """All records of a topic: those split off, of which pyulog read the first too, and what pyulog found behind them."""
    record_bytes, raw = block
    offsets = np.cumsum([0] + [np.dtype(_TYPES[f.type_str]).itemsize for f in topic.field_data])
    layout = np.dtype({"names": [f.field_name for f in topic.field_data], "formats": [_TYPES[f.type_str] for f in topic.field_data],
                       "offsets": offsets[:-1].tolist(), "itemsize": record_bytes})
    rows = np.frombuffer(raw, layout)
    return {name: rows[name] if len(values) == 1 else np.concatenate([rows[name], values[1:]]) for name, values in topic.data.items()}


def _parse(pyulog, source):
    """pyulog prints what it stumbles over, into the result on standard output too; what matters of it is said by `streams`."""
    with contextlib.redirect_stdout(io.StringIO()):
        return pyulog.ULog(source, message_name_filter_list=[GYRO, ACCEL, COMBINED], disable_str_exceptions=True)


def _whole(pyulog, path):
    """The log by pyulog, which takes messages one by one.  Nearly all bytes are messages of a few topics: of a file that is as it
    should be, these are split off first."""
    split = _split(path)
    if split:
        rest, blocks = split
        log = _parse(pyulog, io.BytesIO(rest))
        if not log.file_corruption and set(blocks) <= {topic.msg_id for topic in log.data_list}:
            for topic in log.data_list:
                if topic.msg_id in blocks:
                    topic.data = _records(topic, blocks[topic.msg_id])
            return log
    return _parse(pyulog, path)


def _read(path):
    pyulog = need("pyulog", "pyulog", path, "a PX4 ULog")
    try:
        log = _whole(pyulog, os.fspath(path))
    except Exception as error:  # pyulog raises what its parser meets: struct, index, key, type errors
        raise DataError(f"{path}: a ULog that cannot be read ({cause(error)}); it may be cut short: "
                        "copy it from the card again") from None
    topics = {}
    for data in log.data_list:
        if len(data.data["timestamp"]):
            topics.setdefault(data.name, {})[data.multi_id] = data.data
    return log, topics


def streams(path, options):
    """One stream per gyro."""
    log, topics = _read(path)
    if options.topic == COMBINED or GYRO not in topics:
        if COMBINED not in topics and GYRO not in topics and ulog_is_cut(path):
            raise DataError(f"{path}: a ULog that ends before its first gyro data, as where the card was taken out or a copy broke off: copy it from the card again")
        if options.instance is not None and options.topic is None:
            raise DataError(f"{path}: no {GYRO} in this ULog, so no sensor {options.instance}; --topic {COMBINED} takes the rates that PX4 has corrected")
        if COMBINED not in topics:
            raise DataError(f"{path}: a ULog without {GYRO} and {COMBINED} (topics that carry a gyro); "
                            "log it with SDLOG_PROFILE = 4 (thermal calibration) and record again")
        return [_combined_stream(log, topics, topics[COMBINED][min(topics[COMBINED])])]
    found = [_gyro_stream(log, topics, i, d, options) for i, d in sorted(topics[GYRO].items())]
    for stream in found:
        span_s = float(stream.t_us.max() - stream.t_us.min()) / 1e6
        if span_s and len(stream.t_us) / span_s < MIN_RATE_HZ:
            stream.notes.append(f"{GYRO} was logged at {len(stream.t_us) / span_s:.1f} Hz: a 1-s mean is one sample or two and keeps its full "
                                "noise; set SDLOG_PROFILE = 4 (thermal calibration) for the next recording")
    if ulog_is_cut(path):
        for stream in found:
            stream.notes.append(CUT)
    if log.dropouts:
        lost = sum(d.duration for d in log.dropouts)
        for stream in found:
            stream.notes.append(f"the logger lost data {len(log.dropouts)} times, {lost} ms in all")
    return found
