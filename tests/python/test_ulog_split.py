# SPDX-License-Identifier: MIT
"""ULogs whose data messages are split off before pyulog parses the rest: what pyulog alone gives, value for value."""
import struct

import numpy as np
import pytest

import foreign
from imucal.importers import ulog
from where import DATA

pyulog = pytest.importorskip("pyulog")
NATIVE = DATA / "native"


def contents(read):
    """All that the importer takes of a log, or the name of the error."""
    try:
        log = read()
    except Exception as error:  # what a broken file raises is pyulog's
        return type(error).__name__
    topics = [(t.name, t.multi_id, {k: (v.dtype.str, v.tobytes()) for k, v in t.data.items()}) for t in log.data_list]
    return topics, log.msg_info_dict, log.initial_parameters, [d.duration for d in log.dropouts]


def check(path):
    assert contents(lambda: ulog._whole(pyulog, str(path))) == contents(lambda: ulog._parse(pyulog, str(path)))


def message(kind, payload):
    return struct.pack("<HB", len(payload), ord(kind)) + payload


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("ulog") / "log.ulg"
    foreign.write_ulog(path, [foreign.recording(duration_s=23), foreign.recording(seed=2, duration_s=23)])
    return path.read_bytes()


def test_nearly_all_is_split_off(tmp_path, whole):
    (tmp_path / "a.ulg").write_bytes(whole)
    rest, blocks = ulog._split(tmp_path / "a.ulg")
    assert len(rest) < 0.05 * len(whole) and len(blocks) == 4
    check(tmp_path / "a.ulg")


def middle(whole):
    """Where a data message begins, somewhere in the middle."""
    at = 16
    while at < len(whole) // 2 or whole[at + 2] != ord("D"):
        at += 3 + whole[at] + 256 * whole[at + 1]
    return at


@pytest.mark.parametrize("piece", [
    message("O", struct.pack("<H", 120)), message("S", b"\x2F\x73\x13\x20\x25\x0C\xBB\x12"), message("L", b"6" + bytes(8) + b"hello"),
    message("D", struct.pack("<HQ", 0, 5)), message("D", struct.pack("<HQ", 999, 5)), message("X", b"unknown"), message("R", struct.pack("<H", 0)),
    b"\x00\x00\x00garbage", message("A", struct.pack("<BH", 0, 0) + b"sensor_gyro"), message("A", struct.pack("<BH", 3, 77) + b"sensor_baro"),
    message("I", b"\x0bchar[3] abcxyz")])
def test_messages_of_all_kinds_in_the_middle(tmp_path, whole, piece):
    at = middle(whole)
    (tmp_path / "a.ulg").write_bytes(whole[:at] + piece + whole[at:])
    check(tmp_path / "a.ulg")


def test_data_appended_after_a_crash_is_left_to_pyulog(tmp_path, whole):
    at = middle(whole)
    assert whole[18:19] == b"B"
    flags = bytearray(whole)
    flags[19 + 8] |= 1
    flags[19 + 16:19 + 24] = struct.pack("<Q", at)
    (tmp_path / "a.ulg").write_bytes(bytes(flags))
    assert ulog._split(tmp_path / "a.ulg") is None
    check(tmp_path / "a.ulg")


def test_broken_files_give_what_pyulog_gives(tmp_path, whole):
    rng = np.random.default_rng(5)
    for k in range(60):
        data = bytearray(whole[:int(rng.integers(10, len(whole)))] if k % 3 == 0 else whole)
        for _ in range(int(rng.integers(0, 4))):
            data[int(rng.integers(len(data) if k % 2 else min(500, len(data))))] = int(rng.integers(256))
        (tmp_path / "a.ulg").write_bytes(bytes(data))
        check(tmp_path / "a.ulg")


@pytest.mark.parametrize("name", ["px4_cubeorange_rest.ulg", "px4_sitl_temp0.ulg", "px4_v5_flight.ulg", "px4_v6c_nan_temp.ulg"])
def test_real_files_give_what_pyulog_gives(name):
    if not (NATIVE / name).exists():
        pytest.skip(f"{NATIVE / name} is not there")
    check(NATIVE / name)
