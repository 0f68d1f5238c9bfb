#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Speed that keeps itself: the host's kernels (tests/bench/kernels.cpp) and the core on its microcontrollers.

usage: kept.py measure|diff|save [--build BUILD] [--out FILE] [--counts-only] [--saved FILE] [--measured FILE]
  measure  writes FILE (build/bench.json): instructions of each kernel under callgrind, instructions of the core's calls
           in QEMU, and processor times over that of a reference kernel of the same process
  diff     compares FILE with tests/bench/saved.json: exit status 1 where a count is more than 20 % above the saved one
           (counts of kernels and of the core's calls decide; times are printed: they are of a busy machine)
  save     measures and writes tests/bench/saved.json
Instructions depend on the compiler and on how wide the vectors are that the emulated processor offers: both are saved, and
another compiler is said beside a loss."""
import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SAVED = Path(__file__).resolve().parent / "saved.json"
KERNELS = ["dp_oadev", "whiten", "normals", "normals_of_8", "kf_chain", "montecarlo", "comp", "log_reading"]
# The core's calls that run with every sample and every second.
MCU_CALLS = ["kf_update order 3", "kf_update order 5", "sum_add channels 6", "mean_q16 + unit_from_q16", "clock_take",
             "learn: learn_checked order 3, kf_update and health included", "comp_apply order 3",
             "comp_apply order 5, scale factor order 2", "crc32 100 bytes"]
LOSS = 0.20


def run(*command, **more):
    return subprocess.run([str(c) for c in command], check=True, capture_output=True, text=True, **more)


def compiler():
    return run(os.environ.get("CXX", "c++"), "--version").stdout.splitlines()[0]


def kernel_counts(build):
    """Instructions of one call of each kernel."""
    if not shutil.which("valgrind"):
        sys.exit("kept: valgrind is not installed; `make deps` installs it")
    counts = {}
    with tempfile.TemporaryDirectory() as folder:
        for kernel in KERNELS:
            done = run("valgrind", "--tool=callgrind", "--toggle-collect=kernel_call", "--callgrind-out-file=/dev/null",
                       build / "bench/kernels", folder, kernel)
            counts[kernel] = int(re.search(r"Collected : (\d+)", done.stderr).group(1))
    return counts


def mcu_counts(build):
    """Instructions of the core's calls by port, as `make cycles` prints them."""
    sys.path.insert(0, str(ROOT / "firmware"))
    import cost  # pylint: disable=import-outside-toplevel
    found = {}
    for port, (_, processor, _) in cost.PORTS.items():
        cycles = cost.run_check(build, port, "cycles")
        found[processor] = {name: cycles[name] for name in MCU_CALLS}
    return found


def measure(build, counts_only):
    result = {"compiler": compiler(), "instructions": {"host": kernel_counts(build), **mcu_counts(build)}}
    if not counts_only:
        with tempfile.TemporaryDirectory() as folder:
            result["times"] = json.loads(run(build / "bench/kernels", folder).stdout)
    return result


def rows(saved, now):
    """(where, name, saved, now) of every count."""
    for where, counts in saved["instructions"].items():
        for name, count in counts.items():
            yield where, name, count, now["instructions"].get(where, {}).get(name)


def compare(saved, now):
    """Prints the table; the names of what was lost."""
    lost = []
    print("%-12s%-62s%12s%12s%8s" % ("", "instructions", "saved", "now", ""))
    for where, name, before, after in rows(saved, now):
        if after is None:
            lost.append("%s %s: no longer measured" % (where, name))
            continue
        change = after / before - 1
        print("%-12s%-62s%12d%12d%+7.1f%%" % (where, name, before, after, 100 * change))
        if change > LOSS:
            lost.append("%s %s: %d instructions, were %d (%+.0f %%)" % (where, name, after, before, 100 * change))
    for name, time in now.get("times", {}).items():
        if "over_reference" in time and name in saved.get("times", {}):
            before = saved["times"][name]["over_reference"]
            print("%-12s%-62s%12.3f%12.3f%+7.1f%%" % ("time", name + " over the reference kernel", before,
                                                     time["over_reference"], 100 * (time["over_reference"] / before - 1)))
    return lost


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["measure", "diff", "save"])
    parser.add_argument("--build", type=Path, default=ROOT / "build")
    parser.add_argument("--out", type=Path, help="default: BUILD/bench.json")
    parser.add_argument("--saved", type=Path, default=SAVED)
    parser.add_argument("--measured", type=Path, help="diff: compare this file of `measure`, measure nothing")
    parser.add_argument("--counts-only", action="store_true", help="no times")
    args = parser.parse_args()
    build = args.build.resolve()
    out = args.out or build / "bench.json"
    if args.measured:
        now = json.loads(args.measured.read_text())
    else:
        now = measure(build, args.counts_only)
        out.write_text(json.dumps(now, indent=1) + "\n")
    if args.what == "save":
        args.saved.write_text(json.dumps(now, indent=1) + "\n")
    if args.what != "diff":
        return
    saved = json.loads(args.saved.read_text())
    lost = compare(saved, now)
    if not lost:
        print("no count grew by more than 20 %")
        return
    if saved["compiler"] != now["compiler"]:
        print("saved with %s, now %s" % (saved["compiler"], now["compiler"]))
    print("slower by more than 20 %; `tests/bench/kept.py save` where that is meant:\n  " + "\n  ".join(lost))
    sys.exit(1)


if __name__ == "__main__":
    main()
