# SPDX-License-Identifier: MIT
"""The importers' table: what each format holds, error of a round trip, a real file read, MB of file per second of processor
time; the import of a large ULog against pyulog alone; and how long `imucal look` takes for a log at 100 samples a second.

    bench_import.py [--samples N] [--ulog-mb MB] [--look-s SECONDS]
"""
import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "host/python"), str(ROOT / "tests/python")]

import foreign  # noqa: E402

import imucal  # noqa: E402

NATIVE = ROOT.parent / "shared/data/native"
RECORDING_S = 90  # of the tests' recording at 100 samples a second (foreign.recording): a longer one begins alike
# kind -> (name, fields taken, a real file and how it is read)
FORMATS = {
    "ulog": ("PX4 ULog", "gyro, accel, temperature, id, parameters", "px4_cubeorange_rest.ulg", {"instance": 0}),
    "bin": ("ArduPilot .bin", "gyro, accel, temperature, VIBE", "ap_v382_1s.bin", {"instance": 0, "keep_moving": True}),
    "bag1": ("ROS 1 bag", "gyro, accel, temperature topic", None, {}),
    "bag2db3": ("ROS 2 db3", "gyro, accel, temperature topic", None, {}),
    "bag2mcap": ("ROS 2 mcap", "gyro, accel, temperature topic", None, {}),
    "mat5": ("MATLAB 5", "arrays of equal length", None, {}),
    "mat73": ("MATLAB 7.3", "arrays of equal length", None, {}),
    "csv": ("CSV", "columns by name or option", None, {}),
    "st": ("CSV, mdps, us", "columns by name", None, {}),
    "blackbox": ("blackbox CSV", "gyro, temperature (0.1 degC)", None, {}),
    "parquet": ("Parquet", "columns by name or option", None, {}),
    "hex": ("CXD5602 hex", "gyro, accel, temperature", "cxd5602_hex_045deg_rollover.txt", {}),
}


def seconds(work):
    """Least processor time of three runs, after one that loads the libraries."""
    times = []
    for _ in range(4):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times[1:])


def unit_of(kind):
    """MATLAB arrays carry no unit."""
    return {"unit": "radps"} if kind.startswith("mat") else {}


def round_trip(kind, folder, rec, expected):
    """Largest differences of the imported 1-s means from those of the samples: (dph, degC)."""
    log = imucal.import_log(foreign.write(kind, folder, rec), **unit_of(kind)).log
    want = np.array([expected[k] for k in sorted(expected)])
    if len(want) != len(log.t_s):
        raise SystemExit(f"{kind}: {len(log.t_s)} s imported, {len(want)} expected")
    if any((np.isnan(values) != np.isnan(want[:, 1 + i])).any() for i, values in enumerate(log.rates.values())):
        raise SystemExit(f"{kind}: other seconds are missing than in the samples")
    rate = max(np.nanmax(np.abs(values - want[:, 1 + i])) for i, values in enumerate(log.rates.values()))
    return rate, np.abs(log.temp_degc - want[:, 0]).max()


def real(name, options):
    """What a real file gave."""
    if name is None:
        return "-"
    if not (NATIVE / name).exists():
        return "not beside the project"
    return f"{name}: {len(imucal.import_log(NATIVE / name, **options).log.t_s)} s"


def table(folder, n):
    """Print a row for each format."""
    short, long = foreign.recording(), foreign.recording(duration_s=n // 100)
    expected = foreign.expected_seconds(short)
    print("| format | taken | round trip, dph | degC | MB/s | real file |\n| --- | --- | --- | --- | --- | --- |")
    for kind, (name, fields, sample, options) in FORMATS.items():
        (folder / "short").mkdir(exist_ok=True)
        rate, temp = round_trip(kind, folder / "short", short, expected)
        path = foreign.write(kind, folder, long)
        size = sum(f.stat().st_size for f in path.rglob("*")) if path.is_dir() else path.stat().st_size
        took = seconds(lambda: imucal.import_log(path, **unit_of(kind)))
        print(f"| {name} | {fields} | {rate:.1g} | {temp:.1g} | {size / 1e6 / took:.0f} | {real(sample, options)} |", flush=True)


def large_ulog(folder, megabytes):
    """The import of a ULog of this size against pyulog reading the whole of it."""
    import pyulog
    rec = foreign.recording(duration_s=200)
    foreign.write_ulog(folder / "one.ulg", [rec])
    repeats = max(1, round(megabytes * 1e6 / (folder / "one.ulg").stat().st_size))
    span = rec.t_us[-1] - rec.t_us[0] + 10_000
    fields = {f: np.concatenate([getattr(rec, f)] * repeats) for f in ("gyro_radps", "accel_ms2", "temp_degc")}
    t_us = np.concatenate([rec.t_us + i * span for i in range(repeats)])
    foreign.write_ulog(folder / "large.ulg", [foreign.Recording(t_us, moving_s=rec.moving_s, **fields)])
    alone = seconds(lambda: pyulog.ULog(str(folder / "large.ulg")))
    ours = seconds(lambda: imucal.import_log(folder / "large.ulg"))
    size = (folder / "large.ulg").stat().st_size / 1e6
    print(f"ULog of {size:.0f} MB: pyulog alone {alone:.2f} s, import {ours:.2f} s ({size / ours:.0f} MB/s): {ours / alone:.2f} times")


def look_times(folder, duration_s):
    """`imucal look`, whole process: medians of five runs by the clock and of the processor."""
    program = Path(os.environ.get("IMUCAL_BIN", ROOT / "build/bin")) / "imucal"
    rec = foreign.recording(duration_s=duration_s)
    for kind in ("ulog", "csv"):
        path = foreign.write(kind, folder, rec)
        runs = []
        for _ in range(5):
            start, before = time.perf_counter(), os.times()
            subprocess.run([program, "look", path, "-o", folder / "page.png"], check=True, stdout=subprocess.DEVNULL)
            after = os.times()
            runs.append((time.perf_counter() - start, sum(after[2:4]) - sum(before[2:4])))
        clock, processor = np.median(runs, axis=0)
        print(f"look, {duration_s / 60:.0f} min at 100 Hz, {kind} of {path.stat().st_size / 1e6:.0f} MB: {clock:.2f} s by the clock, "
              f"{processor:.2f} s of processor time")


def at_least(shortest, none=False):
    """Type of an argument: a whole number of at least so many; 0 too where that stands for none."""
    def number(text):
        value = int(text)
        if value < shortest and not (none and value == 0):
            raise argparse.ArgumentTypeError(f"{value} is too short: a recording needs its {RECORDING_S} s, in which the sensor moves and samples are "
                                             f"missing; give {shortest} or more{', or 0 for none' if none else ''}")
        return value
    return number


def main():
    """Print all three."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=at_least(100 * RECORDING_S), default=60_000, help="of the files whose speed is measured")
    parser.add_argument("--ulog-mb", type=float, default=100, help="size of the large ULog; 0: none")
    parser.add_argument("--look-s", type=at_least(RECORDING_S, none=True), default=8400, help="length of the log of `imucal look`; 0: none")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        table(Path(folder), given.samples)
        if given.ulog_mb:
            large_ulog(Path(folder), given.ulog_mb)
        if given.look_s:
            look_times(Path(folder), given.look_s)


if __name__ == "__main__":
    main()
