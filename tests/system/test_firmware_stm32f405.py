# SPDX-License-Identifier: MIT
"""The STM32F405 image in QEMU's netduinoplus2: it serves the link over its USART, learns the same bits as the posix port,
and the command-line programs flash, verify, reset and run it."""
import json
import os
import re
import shutil
import subprocess
import time

import pytest

from device_link import Device
from test_firmware_devices import DURATION_S, learn, make_feed, options, store, worst_means
from where import BIN, BUILD, ROOT

PORT = "stm32f405_qemu"


@pytest.fixture(scope="module")
def feed(tmp_path_factory):
    return make_feed(tmp_path_factory.mktemp("feed") / "samples.bin")


def calibrate(device, *arguments, timeout=60):
    return subprocess.run([str(a) for a in (BIN / "calibrate", "--port", device.name, *arguments)],
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


IMAGES = ("stm32f405", "stm32f405_mpu6050", "stm32f405_w25q", "stm32f405_mpu6050_w25q")


def test_the_images_leave_the_slots_alone():
    """Sectors 1 and 2 hold the tables: neither image has a byte there."""
    for image in IMAGES + (PORT,):
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


# ---- make flash: there is no board here, but its command line can be seen ----

def make_flash(folder, *arguments, tools=("openocd", "dfu-util")):
    """make flash with stand-ins for the tools that write down how they were called: (result, calls)."""
    folder.mkdir()
    calls = folder / "calls"
    for tool in tools:
        (folder / tool).write_text('#!/bin/sh\nprintf "%%s\\n" "$(basename "$0")" "$@" -- >> "%s"\n' % calls)
        (folder / tool).chmod(0o755)
    path = "%s:%s" % (folder, os.environ["PATH"])
    result = subprocess.run(["make", "-s", "flash", *arguments], cwd=ROOT, capture_output=True, text=True,
                            env=dict(os.environ, PATH=path, BUILD=str(BUILD)))
    words = calls.read_text().split("\n--\n") if calls.exists() else []
    return result, [call.split("\n") for call in words if call]


def test_flash_by_openocd_writes_the_image_that_was_asked_for(tmp_path):
    for sensor, tables, image in (("icm42688p", "chip", "stm32f405"), ("mpu6050", "chip", "stm32f405_mpu6050"),
                                 ("icm42688p", "w25q", "stm32f405_w25q"), ("mpu6050", "w25q", "stm32f405_mpu6050_w25q")):
        result, calls = make_flash(tmp_path / image, "SENSOR=" + sensor, "STORE=" + tables)
        assert result.returncode == 0, result.stderr
        elf = BUILD / "firmware" / image / "imucal.elf"
        assert elf.exists()
        assert calls == [["openocd", "-f", "interface/stlink.cfg", "-f", "target/stm32f4x.cfg", "-c",
                          "program %s verify reset exit" % elf]]


def test_flash_by_dfu_writes_both_parts_and_the_vectors_last(tmp_path):
    result, calls = make_flash(tmp_path / "dfu", "FLASHER=dfu")
    assert result.returncode == 0, result.stderr
    device = ["dfu-util", "-d", "0483:df11", "-a", "0", "-s"]
    folder = BUILD / "firmware/stm32f405"
    assert calls == [device + ["0x0800C000", "-D", str(folder / "program.bin")],
                     device + ["0x08000000:leave", "-D", str(folder / "vectors.bin")]]
    whole = (folder / "imucal.bin").read_bytes()  # from 0x08000000 on, the slots between the two parts filled up
    program, vectors = (folder / "program.bin").read_bytes(), (folder / "vectors.bin").read_bytes()
    assert len(vectors) <= 0x4000 and whole.startswith(vectors) and whole[0xC000:] == program


def test_flash_dry_run_prints_what_it_would_do_and_does_nothing(tmp_path):
    for flasher, words in (("openocd", "openocd -f interface/stlink.cfg"), ("dfu", "dfu-util -d 0483:df11 -a 0 -s 0x0800C000")):
        result, calls = make_flash(tmp_path / flasher, "FLASHER=" + flasher, "DRY=1")
        assert result.returncode == 0 and words in result.stdout and calls == [], result.stdout + result.stderr


def test_flash_names_what_is_missing_or_unknown(tmp_path):
    for i, arguments in enumerate((["SENSOR=mpu9250"], ["STORE=eeprom"], ["FLASHER=jlink"])):
        result, calls = make_flash(tmp_path / str(i), *arguments)
        assert result.returncode == 2 and arguments[0] + " is unknown; it may be:" in result.stderr and calls == []
    tool = "openocd" if shutil.which("openocd") is None else "dfu-util" if shutil.which("dfu-util") is None else None
    if tool is None:
        pytest.skip("openocd and dfu-util are both installed: a missing tool cannot be shown")
    for dry in ([], ["DRY=1"]):  # which looks for the tool too, and runs nothing that would fail without it
        result, _ = make_flash(tmp_path / ("no%d" % len(dry)), "FLASHER=" + {"openocd": "openocd", "dfu-util": "dfu"}[tool], *dry, tools=())
        assert result.returncode == 2 and tool + " is missing; install it: apt-get install " + tool in result.stderr
