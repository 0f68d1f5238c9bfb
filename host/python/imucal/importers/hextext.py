# SPDX-License-Identifier: MIT
"""Hex text of the Sony CXD5602PWBIMU board: counter at 19.2 MHz (32 bits, rolls over), temperature, gyro in rad/s and
accelerometer in m/s2 as the bits of float32.  Source: the board's sensor_imu driver, struct cxd5602pwbimu_data_s."""
import numpy as np

from ..errors import DataError
from ..seconds import unwrap
from ..stream import Motion, Stream
from ..units import DPH_PER_RADPS, MG_PER_MS2

TICK_HZ = 19_200_000


def _words(path):
    """((n, 8) uint32, was a last line cut short and left out?); one cut short in between is an error with its number."""
    with open(path, encoding="ascii", errors="replace") as file:
        lines = file.read().split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    is_cut = bool(lines) and (len(lines[-1].split(",")) != 8 or len(lines[-1].strip()) != 71)
    if is_cut:
        lines.pop()
    joined = ",".join(line.strip() for line in lines)
    try:
        return np.array([int(w, 16) for w in joined.split(",")], np.uint32).reshape(-1, 8), is_cut
    except (ValueError, OverflowError):  # a word is no number, or has more than 8 digits
        pass
    for number, line in enumerate(lines, 1):
        words = line.strip().split(",")
        if len(words) != 8 or any(len(w) != 8 for w in words) or set("".join(words).lower()) - set("0123456789abcdef"):
            raise DataError(f"{path}:{number}: expected 8 words of 8 hex digits, found \"{line[:60]}\"")
    raise DataError(f"{path}: no whole line")


def streams(path, options):
    """One stream: gyro, temperature and accelerometer share their times."""
    words, is_cut = _words(path)
    t_us = unwrap(words[:, 0], 32) * 5 // (TICK_HZ // 200_000)
    floats = words[:, 1:].copy().view(np.float32).astype(np.float64)
    accel_mg = floats[:, 4:7] * MG_PER_MS2
    stream = Stream(0, "CXD5602PWBIMU", ["gx", "gy", "gz"], t_us, floats[:, 1:4], np.full(3, DPH_PER_RADPS), "rad/s", t_us, floats[:, 0],
                    [Motion("accel", t_us, accel_mg)], {"device": "CXD5602PWBIMU", "axes_frame": "sensor"})
    if is_cut:
        stream.notes.append("the last line is cut short and left out")
    if options.with_accel:
        stream.axes += ["ax", "ay", "az"]
        stream.values = np.hstack([stream.values, floats[:, 4:7]])
        stream.to_internal = np.concatenate([stream.to_internal, np.full(3, MG_PER_MS2)])
        stream.unit, stream.motion = "rad/s, m/s2", []
    return [stream]
