# SPDX-License-Identifier: MIT
"""Writers of other programs' formats, made from their specifications and not from the readers' libraries where a format is
simple; and a recording to write, with what loggers do to it: jitter, a gap, duplicates, steps back, motion."""
import struct
from dataclasses import dataclass

import numpy as np


@dataclass
class Recording:
    """Samples at rest and moving; float32, as most loggers hold them."""

    t_us: np.ndarray
    gyro_radps: np.ndarray
    accel_ms2: np.ndarray
    temp_degc: np.ndarray
    moving_s: tuple


RATE_HZ, START_S = 100, 112.0


def recording(seed=1, duration_s=90):
    rng, start_s = np.random.default_rng(seed), START_S
    n = duration_s * RATE_HZ
    t_us = np.rint((start_s + np.arange(n) / RATE_HZ + 0.001 * rng.uniform(-1, 1, n)) * 1e6).astype(np.int64)
    temp = np.linspace(20, 26, n)
    gyro = np.array([0.01, -0.02, 0.005]) + 1e-4 * (temp - 20)[:, None] + 0.002 * rng.standard_normal((n, 3))
    accel = np.array([0.1, -0.2, -9.8]) + 0.03 * rng.standard_normal((n, 3))
    moving = (start_s + 40 <= t_us / 1e6) & (t_us / 1e6 < start_s + 43)
    gyro[moving] += 1.0 * rng.standard_normal((moving.sum(), 3))
    keep = ~((start_s + 60.3 < t_us / 1e6) & (t_us / 1e6 < start_s + 64.6))  # a gap
    keep &= rng.uniform(size=n) > 0.01
    order = np.flatnonzero(keep)
    order = np.insert(order, 700, order[699])    # a duplicate
    order = np.insert(order, 2000, order[1990])  # an old sample again
    single = np.float32
    return Recording(t_us[order], gyro[order].astype(single), accel[order].astype(single), temp[order].astype(single), (start_s + 40, start_s + 43))


def expected_seconds(rec):
    """{end of second: (temperature, three rates)}, sample by sample in plain Python: what the import must give.
    The moving seconds and their neighbours are left out; a second with fewer than half its samples has no rate."""
    import math
    values, to_dph = rec.gyro_radps.astype(float), 3600 * 180 / np.pi
    sums, newest = {}, -1
    for t, rate, temp in zip(rec.t_us.tolist(), values.tolist(), rec.temp_degc.astype(float).tolist()):
        if t > newest:
            newest = t
            sums.setdefault(t // 1_000_000 + 1, []).append((temp, *rate))
    result = {}
    for end_s, rows in sums.items():
        if rec.moving_s[0] - 1 < end_s <= rec.moving_s[1] + 1:
            continue
        mean = [math.fsum(c) / len(rows) for c in zip(*rows)]
        rates = [m * to_dph for m in mean[1:]] if 2 * len(rows) >= RATE_HZ else [math.nan] * 3
        result[end_s] = (mean[0], *rates)
    return result


# --- PX4 ULog: header, definitions, data (PX4 user guide, "ULog file format") ---

def _ulog_message(kind, payload):
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def write_ulog(path, recs, with_gyro=True, temperature=True):
    """One sensor_gyro and one sensor_accel instance per recording."""
    gyro = "sensor_gyro:uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;" \
        + ("float temperature;" if temperature else "") + "uint32_t error_count;"
    accel = "sensor_accel:uint64_t timestamp;float x;float y;float z;"
    out = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), _ulog_message("B", bytes(40))]
    key = b"char[10] ver_hw"
    out.append(_ulog_message("I", bytes([len(key)]) + key + b"PX4_FMU_V6"))
    out += [_ulog_message("F", text.encode()) for text in (gyro, accel)]
    body = []
    for i, rec in enumerate(recs):
        if with_gyro:
            body.append((0, _ulog_message("A", struct.pack("<BH", i, 2 * i) + b"sensor_gyro")))
        body.append((0, _ulog_message("A", struct.pack("<BH", i, 2 * i + 1) + b"sensor_accel")))
        for t, g, a, temp in zip(rec.t_us.tolist(), rec.gyro_radps, rec.accel_ms2, rec.temp_degc):
            if with_gyro:
                data = struct.pack("<HQQIfff", 2 * i, t + 250, t, 1000 + i, *g)
                data += struct.pack("<f", temp) if temperature else b""
                body.append((t, _ulog_message("D", data + struct.pack("<I", 0))))
            body.append((t, _ulog_message("D", struct.pack("<HQfff", 2 * i + 1, t, *a))))
    if len(recs) > 1:
        body.sort(key=lambda item: item[0])
    with open(path, "wb") as file:
        file.write(b"".join(out) + b"".join(m for _, m in body))


# --- ArduPilot dataflash: FMT messages describe the others (AP_Logger/LogStructure.h) ---

def write_ardupilot(path, rec, with_imu=True, per_instance=False, parameters=()):
    def fmt(kind, length, name, letters, columns):
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, length, name.encode(), letters.encode(), columns.encode())

    letters = "QBffffffIIfBBHH" if per_instance else "QffffffIIfBBHH"
    columns = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
    columns = columns if per_instance else columns.replace("I,", "", 1)
    pack = "<QBffffffIIfBBHH" if per_instance else "<QffffffIIfBBHH"
    out = [fmt(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"), fmt(131, 3 + struct.calcsize(pack), "IMU", letters, columns),
           fmt(64, 3 + struct.calcsize("<Q16sf"), "PARM", "QNf", "TimeUS,Name,Value")]
    for name, value in parameters:
        out.append(b"\xa3\x95\x40" + struct.pack("<Q16sf", 1, name.encode(), value))
    for t, g, a, temp in zip(rec.t_us.tolist(), rec.gyro_radps, rec.accel_ms2, rec.temp_degc):
        instances = (0, 1) if per_instance else (None,)
        for i in instances if with_imu else ():
            head = (t,) if i is None else (t, i)
            out.append(b"\xa3\x95\x83" + struct.pack(pack, *head, *(g if not i else -g), *a, 0, 0, temp, 1, 1, 1000, 1000))
    with open(path, "wb") as file:
        file.write(b"".join(out))


# --- ROS bags, by rosbags' writers ---

def write_rosbag(path, rec, version, storage="sqlite3", with_imu=True):
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore
    epoch_s = 1_700_000_000
    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    types = store.types
    header_t, time_t = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]

    def header(t_us):
        stamp = time_t(sec=int(t_us // 1_000_000) + epoch_s, nanosec=int(t_us % 1_000_000) * 1000)
        return header_t(seq=0, stamp=stamp, frame_id="imu") if version == 1 else header_t(stamp=stamp, frame_id="imu")

    def raw(message, kind):
        return store.serialize_ros1(message, kind) if version == 1 else store.serialize_cdr(message, kind)

    writer = Writer1(path) if version == 1 else Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3)
    nine, orientation = np.zeros(9), quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    with writer:
        imu = writer.add_connection("/imu/data_raw", "sensor_msgs/msg/Imu", typestore=store)
        other = writer.add_connection("/imu/temperature", "sensor_msgs/msg/Temperature", typestore=store)
        for t, g, a, temp in zip(rec.t_us.tolist(), rec.gyro_radps.astype(float), rec.accel_ms2.astype(float), rec.temp_degc.astype(float)):
            log_ns = (t + epoch_s * 1_000_000) * 1000
            if with_imu:
                message = types["sensor_msgs/msg/Imu"](header=header(t), orientation=orientation, orientation_covariance=nine,
                                                       angular_velocity=vector(*g), angular_velocity_covariance=nine,
                                                       linear_acceleration=vector(*a), linear_acceleration_covariance=nine)
                writer.write(imu, log_ns, raw(message, "sensor_msgs/msg/Imu"))
            message = types["sensor_msgs/msg/Temperature"](header=header(t), temperature=float(temp), variance=0.0)
            writer.write(other, log_ns, raw(message, "sensor_msgs/msg/Temperature"))


# --- MATLAB ---

def write_matlab(path, rec, version="5", as_struct=False):
    arrays = {"t": rec.t_us / 1e6, "gyro": rec.gyro_radps.astype(float), "temperature": rec.temp_degc.astype(float)}
    if version == "7.3":
        import h5py
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, array in arrays.items():
                file[name] = np.atleast_2d(array).T if array.ndim == 2 else array[None, :]  # MATLAB's column order
        with open(path, "r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
        return
    from scipy.io import savemat
    savemat(path, {"log": arrays} if as_struct else arrays)


def matlab_object(name, class_name):
    """A MATLAB 5 file with one object, as save() writes a timetable (MAT-File Format, "Level 5"; class 17 is an object that
    only MATLAB knows: its name, its type system, its class and references)."""
    def element(kind, data):
        return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)

    def matrix(flags_class, *parts):
        return element(14, element(6, struct.pack("<II", flags_class, 0)) + b"".join(parts))

    references = matrix(13, element(5, struct.pack("<ii", 6, 1)), element(1, b""), element(6, struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1)))
    body = matrix(17, element(1, name.encode()), element(1, b"MCOS"), element(1, class_name.encode()), references)
    return b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + struct.pack("<H", 0x0100) + b"IM" + body


# --- tables ---

def write_table(path, rec, kind):
    """kind: parquet, csv (names with units), blackbox (Betaflight), st (MEMS Studio like, mdps and us), hex (CXD5602PWBIMU)."""
    g = rec.gyro_radps.astype(float)
    if kind == "hex":
        ticks = ((rec.t_us + 110_000_000) * 96 // 5) % (1 << 32)  # rolls over in the second second
        words = np.column_stack([rec.temp_degc, rec.gyro_radps, rec.accel_ms2]).astype(np.float32).view(np.uint32)
        lines = [",".join(f"{w:08x}" for w in (t, *row)) for t, row in zip(ticks.tolist(), words.tolist())]
        with open(path, "w") as file:
            file.write("\n".join(lines) + "\n")
        return
    import polars
    columns = {"timestamp [us]": rec.t_us, "G_x [mdps]": np.degrees(g[:, 0]) * 1e3, "G_y [mdps]": np.degrees(g[:, 1]) * 1e3,
               "G_z [mdps]": np.degrees(g[:, 2]) * 1e3, "Temperature [C]": rec.temp_degc.astype(float)}
    if kind == "csv":
        columns = {"time_s": rec.t_us / 1e6, "gyro_x (rad/s)": g[:, 0], "gyro_y (rad/s)": g[:, 1], "gyro_z (rad/s)": g[:, 2],
                   "temp": rec.temp_degc.astype(float)}
    if kind == "blackbox":
        dps = np.degrees(g)
        columns = {"loopIteration": np.arange(len(g)), "time (us)": rec.t_us, **{f"gyroADC[{i}] (deg/s)": dps[:, i] for i in range(3)},
                   "IMUTemperature": np.rint(rec.temp_degc * 10).astype(int)}
    frame = polars.DataFrame(columns)
    frame.write_parquet(path) if kind == "parquet" else frame.write_csv(path)


def write(kind, folder, rec):
    """A recording as a file log.KIND: ulog, bin, bag1, bag2db3, bag2mcap, mat5, mat5struct, mat73, or a table's kind."""
    path = folder / f"log.{kind}"
    if kind == "ulog":
        write_ulog(path, [rec])
    elif kind == "bin":
        write_ardupilot(path, rec)
    elif kind == "bag1":
        write_rosbag(path, rec, 1)
    elif kind.startswith("bag2"):
        write_rosbag(path, rec, 2, "mcap" if kind == "bag2mcap" else "sqlite3")
    elif kind.startswith("mat"):
        write_matlab(path, rec, "7.3" if kind == "mat73" else "5", kind == "mat5struct")
    else:
        write_table(path, rec, kind)
    return path
