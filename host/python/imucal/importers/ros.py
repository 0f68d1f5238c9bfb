# SPDX-License-Identifier: MIT
"""ROS 1 and ROS 2 bags: sensor_msgs/Imu (rad/s, m/s2) and sensor_msgs/Temperature (degC), by rosbags."""
import contextlib
import tempfile
from pathlib import Path

import numpy as np

from ..errors import DataError
from ..stream import Motion, Stream
from ..units import DPH_PER_RADPS, MG_PER_MS2
from . import cause, need

IMU, TEMPERATURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature"


def _stamp_us(message, log_ns):
    """The sample's own time; the recorder's where the driver leaves the stamp empty."""
    stamp = message.header.stamp
    own_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
    return (own_ns or log_ns) // 1000


_SUFFIXES = {b"#ROS": ".bag", b"SQLi": ".db3", b"\x89MCAP": ".mcap"}


@contextlib.contextmanager
def _named_right(path):
    """The library goes by the name's ending: a file with another one gets a link that has it."""
    path = Path(path)
    if path.is_dir():
        yield path
        return
    with open(path, "rb") as file:
        head = file.read(5)
    suffix = next((s for magic, s in _SUFFIXES.items() if head.startswith(magic[:4])), path.suffix)
    if path.suffix == suffix:
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / f"bag{suffix}"
        link.symlink_to(path.resolve())
        yield link


def _read(path):
    highlevel = need("rosbags.highlevel", "rosbags", path, "a ROS bag")
    typesys = need("rosbags.typesys", "rosbags", path, "a ROS bag")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    samples = {}
    try:
        with _named_right(path) as named, highlevel.AnyReader([named], default_typestore=store) as reader:
            topics = {c.topic: c.msgtype for c in reader.connections}
            wanted = [c for c in reader.connections if c.msgtype in (IMU, TEMPERATURE)]
            for connection, log_ns, raw in reader.messages(connections=wanted) if wanted else ():
                message = reader.deserialize(raw, connection.msgtype)
                rows = samples.setdefault((connection.topic, connection.msgtype), [])
                if connection.msgtype == IMU:
                    rate, accel = message.angular_velocity, message.linear_acceleration
                    rows.append((_stamp_us(message, log_ns), rate.x, rate.y, rate.z, accel.x, accel.y, accel.z))
                else:
                    rows.append((_stamp_us(message, log_ns), message.temperature))
    except DataError:
        raise
    except Exception as error:  # the library's readers raise their own and sqlite's, yaml's, struct's
        raise DataError(f"{path}: a ROS bag that cannot be read ({cause(error)}); a bag cut short is mended by "
                        "ros2 bag reindex, or rosbag reindex") from None
    return topics, {key: np.array(rows) for key, rows in samples.items()}


def _choose_temperature(path, topic, temperatures, options):
    """The temperature topic of an IMU: the one named, the only one, or the one in the same namespace."""
    if options.temp:
        if options.temp not in temperatures:
            raise DataError(f"{path}: no temperature topic {options.temp} (there are: {', '.join(temperatures) or 'none'})")
        return temperatures[options.temp]
    if len(temperatures) == 1:
        return next(iter(temperatures.values()))
    beside = [t for t in temperatures if t.rsplit("/", 1)[0] == topic.rsplit("/", 1)[0]]
    return temperatures[beside[0]] if len(beside) == 1 else None


def streams(path, options):
    """One stream per Imu topic."""
    topics, samples = _read(path)
    imus = {t: rows for (t, kind), rows in samples.items() if kind == IMU and (options.topic in (None, t))}
    temperatures = {t: rows for (t, kind), rows in samples.items() if kind == TEMPERATURE}
    if not imus:
        there = sorted(t for t, kind in samples if kind == IMU)
        if options.topic and there:
            raise DataError(f"{path}: no topic {options.topic} of sensor_msgs/Imu (there are: {', '.join(there)})")
        listed = ", ".join(f"{t} ({k})" for t, k in sorted(topics.items())[:12]) or "none"
        raise DataError(f"{path}: a ROS bag without sensor_msgs/Imu; its topics: {listed}")
    found = []
    for i, (topic, rows) in enumerate(sorted(imus.items())):
        t_us = rows[:, 0].astype(np.int64)
        stream = Stream(i, topic, ["gx", "gy", "gz"], t_us, rows[:, 1:4], np.full(3, DPH_PER_RADPS), "rad/s", None, None,
                        metadata={"device": topic, "axes_frame": "as published (header.frame_id)"})
        if np.abs(rows[:, 4:7]).max() > 0:
            stream.motion = [Motion("accel", t_us, rows[:, 4:7] * MG_PER_MS2)]
            if options.with_accel:
                stream.values, stream.axes = rows[:, 1:7], ["gx", "gy", "gz", "ax", "ay", "az"]
                stream.to_internal = np.repeat([DPH_PER_RADPS, MG_PER_MS2], 3)
                stream.unit = "rad/s, m/s2"
        chosen = _choose_temperature(path, topic, temperatures, options)
        if chosen is not None:
            stream.temp_t_us, stream.temp_degc = chosen[:, 0].astype(np.int64), chosen[:, 1]
        elif len(temperatures) > 1:
            stream.notes.append(f"several temperature topics ({', '.join(temperatures)}): choose one with --temp")
        found.append(stream)
    return found
