# SPDX-License-Identifier: MIT
"""The STM32F405 image in QEMU's netduinoplus2: it serves the link over its USART, learns the same bits as the posix port,
and the command-line programs flash, verify, reset and run it."""
import json
import os
import re
import subprocess
import time

import pytest

from device_link import BUILD, ROOT, Device
from test_firmware_devices import DURATION_S, learn, make_feed, options, store, worst_means

PORT = "stm32f405_qemu"


@pytest.fixture(scope="module")
def feed(tmp_path_factory):
    return make_feed(tmp_path_factory.mktemp("feed") / "samples.bin")


def calibrate(device, *arguments, timeout=60):
    return subprocess.run([str(a) for a in (BUILD / "bin/calibrate", "--port", device.name, *arguments)],
                          capture_output=True, text=True, timeout=timeout)


@pytest.fixture(scope="module")
def run(feed, tmp_path_factory):
    """Records, table bytes and what they were after a restart, on both ports."""
    result = {}
    for port in ("posix", PORT):
        flash = tmp_path_factory.mktemp("flash") / "flash"
        with Device(port, flash, feed, extra=options(port)) as device:
            records = learn(device.line)
            store(device.line)
            table = device.line.download()
        with Device(port, flash, feed, extra=options(port)) as device:  # killed: a power cut
            result[port] = dict(records=records, table=table, after=device.line.download(), info=device.line.info(),
                                worst=worst_means(device.line))
    return result


def test_the_table_and_all_records_are_those_of_the_posix_port(run):
    assert run[PORT]["table"] == run["posix"]["table"]
    for kind in ("second", "innovation", "progress"):
        assert ([v for n, v in run[PORT]["records"] if n == kind] ==
                [v for n, v in run["posix"]["records"] if n == kind])


def test_the_table_outlives_a_power_cut_and_compensates(run):
    assert run[PORT]["after"] == run[PORT]["table"] and run[PORT]["info"]["table_status"] == 0
    raw, out = run[PORT]["worst"]
    assert raw > 350 and out < 15
    assert [n for n, _ in run[PORT]["records"]].count("second") == DURATION_S


def test_calibrate_flashes_verifies_and_reads_back_after_a_reset(run, tmp_path):
    table = tmp_path / "table.bin"
    with Device(PORT, tmp_path / "flash", extra=options(PORT)) as device:
        assert device.line.upload(run[PORT]["table"]) == 0
        os.close(device.line.socket.detach())
        dumped = calibrate(device, "dump", "-o", table)
        assert dumped.returncode == 0, dumped.stderr
        again = calibrate(device, "flash", table)
        assert again.returncode == 0, again.stderr
        line = device.__enter__().line
        assert line.done("reboot", reserved=0) == 0
        os.close(line.socket.detach())
        time.sleep(0.5)
        verified = calibrate(device, "verify", table)
        assert verified.returncode == 0, verified.stdout + verified.stderr
        info = calibrate(device, "--json", "-", "-q", "info")
        assert info.returncode == 0, info.stderr
        assert "qemu stm32f405" in info.stdout and json.loads(info.stdout)


def test_the_images_leave_the_slots_alone():
    """Sectors 1 and 2 hold the tables: neither image has a byte there."""
    for image in ("stm32f405", "stm32f405_mpu6050", PORT):
        headers = subprocess.run(["arm-none-eabi-objdump", "-h", str(BUILD / "firmware" / image / "imucal.elf")],
                                 capture_output=True, text=True, check=True).stdout
        for line in headers.splitlines():
            fields = line.split()
            if len(fields) > 5 and fields[0].isdigit() and fields[1] in (".vectors", ".text", ".data", ".ARM.exidx"):
                start = int(fields[4], 16)
                assert start + int(fields[2], 16) <= 0x08004000 or start >= 0x0800C000, line


def test_an_application_that_only_compensates_stays_within_its_budget():
    """With and without link-time optimisation; the second alone is above 4,200."""
    images = [BUILD / "firmware" / name for name in ("examples/compensate.elf", "examples/compensate_plain.elf",
                                                     "examples/calibrate.elf", "stm32f405/imucal.elf")]
    for limit, status in ((4608, 0), (4200, 1)):
        result = subprocess.run(["python3", str(ROOT / "firmware/examples/budget.py"), str(limit), "arm-none-eabi-nm",
                                 *map(str, images)], capture_output=True, text=True)
        assert result.returncode == status, result.stdout + result.stderr


def written_registers():
    """Names of the registers that port and drivers write: calls of reg_write, reg_set, reg_clear, and the sensors' settings."""
    names = set()
    for path in (ROOT / "firmware/port/stm32f405").glob("*.c"):
        text = path.read_text()
        for first in re.findall(r"reg_(?:write|set|clear)\(\s*((?:[^(),]|\([^()]*\))+),", text):
            names.add(re.findall(r"[A-Z][A-Z0-9_]*(?:\([a-z01]+\))?", first)[-1])
        names |= set(re.findall(r"^\s*((?:SCB|SYST)_\w+) \|?= ", text, re.M))
    for driver in ("icm42688p", "mpu6050"):
        text = (ROOT / ("firmware/sensors/%s.c" % driver)).read_text()
        names |= set(re.findall(r"^\s*\{([A-Z][A-Z0-9_]+),", text, re.M))
        names |= set(re.findall(r"write_reg\(sensor, ([A-Z0-9_]+)", text))
    return names


def test_the_bring_up_list_names_every_register_that_is_written():
    readme = (ROOT / "firmware/port/stm32f405/README.md").read_text().split("### Every register that the image writes")[1]
    listed = set(re.findall(r"[A-Z][A-Z0-9_]*(?:\([a-z01]+\))?", readme))
    names = written_registers()
    assert len(names) > 60
    missing = {n for n in names if n not in listed and n.split("(")[0] not in listed}
    assert not missing, missing
