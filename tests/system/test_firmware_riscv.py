# SPDX-License-Identifier: MIT
"""The smallest port, a 32-bit RISC-V without floating point in QEMU: the same table and records, bit for bit, as the posix
port.  Its compiler and emulator are not among the packages that `make deps` installs: without them this is skipped."""
import shutil
import subprocess

import pytest

from device_link import Device
from test_firmware_devices import learn, make_feed, options, store
from where import BUILD, ROOT

NEEDED = ("riscv64-unknown-elf-gcc", "qemu-system-riscv32")
MISSING = [name for name in NEEDED if not shutil.which(name)]


@pytest.mark.skipif(bool(MISSING), reason="%s missing: apt-get install gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf "
                                          "qemu-system-misc" % ", ".join(MISSING))
def test_riscv_learns_the_same_bits_and_keeps_them_over_a_power_cut(tmp_path):
    subprocess.run(["make", "-C", str(ROOT), "BUILD=%s" % BUILD, "firmware-riscv"], check=True, capture_output=True)
    feed = make_feed(tmp_path / "samples.bin")
    result = {}
    for port in ("posix", "riscv_virt"):
        flash = tmp_path / (port + ".flash")
        with Device(port, flash, feed, extra=options(port)) as device:
            records = learn(device.line)
            store(device.line)
            result[port] = (device.line.download(),
                            [(n, v) for n, v in records if n in ("second", "innovation", "progress")])
        with Device(port, flash, feed, extra=options(port)) as device:
            assert device.line.download() == result[port][0]
            assert device.line.done("reboot", reserved=0) == 0
    assert result["riscv_virt"] == result["posix"]
