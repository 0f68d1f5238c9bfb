# SPDX-License-Identifier: MIT
"""Speed of the importers: MB of file per second of processor time, and a ULog's import against pyulog alone.

    bench_import.py [--samples N]
"""
import argparse
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "host/python"), str(ROOT / "tests/python")]

import foreign  # noqa: E402

import imucal  # noqa: E402


def seconds(work):
    """Processor time of the second of two runs: libraries are loaded by the first."""
    work()
    start = time.process_time()
    work()
    return time.process_time() - start


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=100_000)
    n = parser.parse_args().samples
    rec = foreign.recording(duration_s=n // 100)
    print(f"{'format':12} {'MB':>8} {'s':>8} {'MB/s':>8} {'samples/s':>11}")
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder)
        makers = {"ulog": lambda p: foreign.write_ulog(p, [rec]), "bin": lambda p: foreign.write_ardupilot(p, rec),
                  "bag1": lambda p: foreign.write_rosbag(p, rec, 1), "bag2 mcap": lambda p: foreign.write_rosbag(p, rec, 2, "mcap"),
                  "mat 5": lambda p: foreign.write_matlab(p, rec), "mat 7.3": lambda p: foreign.write_matlab(p, rec, "7.3"),
                  **{k: (lambda p, k=k: foreign.write_table(p, rec, k)) for k in ("csv", "parquet", "blackbox", "hex")}}
        for name, make in makers.items():
            path = where / name.replace(" ", "_")
            make(path)
            size = sum(f.stat().st_size for f in path.rglob("*")) if path.is_dir() else path.stat().st_size
            took = seconds(lambda: imucal.import_log(path, unit="radps" if name.startswith("mat") else None))
            print(f"{name:12} {size / 1e6:8.2f} {took:8.3f} {size / 1e6 / took:8.1f} {n / took:11.0f}", flush=True)
        import pyulog
        alone = seconds(lambda: pyulog.ULog(str(where / "ulog")))
        ours = seconds(lambda: imucal.import_log(where / "ulog"))
        print(f"ULog: pyulog alone {alone:.3f} s, import {ours:.3f} s: {ours / alone:.2f} times")


if __name__ == "__main__":
    main()
