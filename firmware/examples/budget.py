#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Flash of an application's core as linked, without the C library's and libgcc's functions, which stand beside it.

usage: budget.py LIMIT_BYTES NM COMPENSATE_ELF COMPENSATE_ELF_WITHOUT_LTO CALIBRATE_ELF DEVICE_ELF ...
Exit status 1 where an application that only compensates takes more than LIMIT_BYTES, with or without link-time optimisation."""
import re
import subprocess
import sys

NAMES = ("compensates only", "compensates only, no -flto", "compensates and learns, no link", "whole device, drivers, no -flto",
         "the same, tables in a W25Q")
LIBRARY = re.compile(r"^(_*aeabi|__|mem(cpy|set|move|cmp)|str|_)")


def sizes(nm, elf):
    """(bytes of ours, bytes of libraries) in flash: code and constants."""
    ours = library = 0
    for line in subprocess.run([nm, "-S", elf], check=True, capture_output=True, text=True).stdout.splitlines():
        fields = line.split()
        if len(fields) == 4 and fields[2] in "TtRrWwDd":
            size = int(fields[1], 16)
            if LIBRARY.match(fields[3]):
                library += size
            else:
                ours += size
    return ours, library


def main(limit, nm, *elfs):
    print("flash, bytes (Cortex-M4F, -Os -flto)          core and example   libgcc, libc")
    status = 0
    for name, elf in zip(NAMES, elfs):
        ours, library = sizes(nm, elf)
        print("%-44s %12d %14d" % (name, ours, library))
        if elf in elfs[:2] and ours > int(limit):
            print("budget: %s: the limit is %s bytes" % (name, limit), file=sys.stderr)
            status = 1
    return status


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
