# SPDX-License-Identifier: MIT
"""What stands behind each sensor driver, as a table (make sensor-table): lines of driver and model, tests and checks of its
unit tests, and faults injected into the bus of a running device (posix port, tests/emu/sensor_server.c) against those that were
counted, told by an event, and kept out of every row that carries no mark.  Then what each port takes.  Exit status 1 where a fault
was missed."""
import re
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/system"))
import test_firmware_sensors as sensors  # noqa: E402

FAULTS = [("identity:0:20", "wrong_identity", "another chip"), ("zeros:100:110", "bus_errors", "bus fails"),
          ("ones:100:110", "bus_errors", "bus fails"), ("errors:100:110", "bus_errors", "bus fails"),
          ("reset:100", "resets", "reset itself"), ("overrun:100", "overruns", "overran"),
          ("temperature:20:150", "stuck_temp", "temperature stands still")]


def lines(*paths):
    return sum(len((ROOT / path).read_text().splitlines()) for path in paths)


def is_found(name, fault, count, text, chamber, folder):
    rows, result, sensor = sensors.record_with(fault, chamber, folder, name)
    if not fault.startswith("temperature"):
        sensors.assert_no_unmarked_row_is_wrong(rows, chamber)
    elif not any(int(row["gx_flags"] or 0) & 4 for row in rows):
        return False
    return sensor[count] >= 1 and text in (result["sensor_trouble"] or "")


def counts_of(name):
    """Lines of the driver and of its model, unit tests, their checks, the faults."""
    test = (ROOT / ("tests/firmware/test_%s.c" % name)).read_text()
    # The BMI088's thermometer moves in steps of 0.125 degC: its limit is a day.
    faults = [f for f in FAULTS if name != "bmi088" or not f[0].startswith("temperature")]
    return (lines("firmware/sensors/%s.c" % name, "firmware/sensors/%s.h" % name), lines("tests/emu/%s.h" % name),
            len(re.findall(r"^static void test_", test, re.M)), len(re.findall(r"\bassert_\w+\(", test)), faults)


def row_of(name, chamber, folder):
    *counts, faults = counts_of(name)
    found = 0
    for i, fault in enumerate(faults):
        (folder / str(i)).mkdir(parents=True)
        if is_found(name, *fault, chamber, folder / str(i)):
            found += 1
        else:
            print("missed: %s %s" % (name, fault[0]), file=sys.stderr)
    print("| `%s` | %d | %d | %d / %d | %d | %d |" % (name, *counts, len(faults), found), flush=True)
    return len(faults) - found


def chamber_in(folder):
    folder.mkdir()
    factory = type("Factory", (), {"mktemp": staticmethod(lambda _: folder)})
    return sensors.chamber.__wrapped__(factory)


PORTS = ("riscv_virt", "nrf51", "stm32f405")


def size_of_port(port):
    """Files and lines of a port's own."""
    files = [p for p in sorted((ROOT / "firmware/port" / port).iterdir()) if p.suffix in (".c", ".h", ".ld", ".mk")]
    return len(files), lines(*files)


def main():
    missed = 0
    print("| driver | lines | model, lines | unit tests / checks | faults injected into a running device | counted, told, kept out |")
    print("| --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        chamber = chamber_in(Path(folder) / "chamber")
        for name in ("icm42688p", "mpu6050", "lsm6dso", "bmi088"):
            missed += row_of(name, chamber, Path(folder) / name)
    for port in PORTS:
        print("port %s: %d files, %d lines" % (port, *size_of_port(port)))
    print("faults missed: %d" % missed)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
