#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""What the firmware costs on its microcontrollers: flash and RAM, worst stack, instructions.

usage: cost.py size|stack|cycles|save|diff --build BUILD [--cross arm-none-eabi-]
  size    flash of each core object as linked into the image (what nobody calls is left out), the same objects before
          linking, library functions of the whole image; RAM of the core's structures
  stack   deepest path through the whole program: stack of each function (-fstack-usage) along the call graph;
          and what a painted stack shows of the core's functions in QEMU
  cycles  instructions of the core's functions, counted by QEMU (-icount shift=0) with a timer of the chip
  save    write all figures to firmware/cost_baseline.json
  diff    compare all figures with that file; exit status 1 where one grew by more than 2 %
"""
import argparse
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BASELINE = ROOT / "firmware/cost_baseline.json"
PORTS = {"mps2_an386": ("mps2-an386", "Cortex-M4F", "-mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16"),
         "nrf51": ("microbit", "Cortex-M0", "-mcpu=cortex-m0 -mthumb")}
STRUCTS = {"kf state: both filters' numbers": "((imucal_kf_t*)0)->e, ((imucal_kf_t*)0)->e_variance, "
           "((imucal_kf_t*)0)->one_plus_v0, ((imucal_kf_t*)0)->v, ((imucal_kf_t*)0)->row, ((imucal_kf_t*)0)->r",
           "imucal_kf_t (with configuration and statistics)": "imucal_kf_t", "imucal_learn_t (kf and counts)": "imucal_learn_t", "imucal_health_t": "imucal_health_t", "imucal_comp_t": "imucal_comp_t",
           "imucal_app_channel_t (learn + health + comp + session)": "imucal_app_channel_t",
           "imucal_clock_t": "imucal_clock_t", "imucal_sum_t (all channels)": "imucal_sum_t", "imucal_table_t (all channels)": "imucal_table_t",
           "imucal_app_t (everything, six channels)": "imucal_app_t"}
RATE_HZ = 100


def run(*command):
    return subprocess.run([str(c) for c in command], check=True, capture_output=True, text=True, cwd=ROOT).stdout


# ---- size ----

def linked_bytes(map_file):
    """{object: {section kind: bytes}} of what the linker kept."""
    text = map_file.read_text().split("Linker script and memory map")[1]
    sizes = {}
    pattern = r"^ (\.(?:text|rodata|data|bss)\S*)\s+0x([0-9a-f]+)\s+0x([0-9a-f]+)\s+(\S+\.o)\)?$"
    for section, _, size, name in re.findall(pattern, text, re.M):
        kind = section.split(".")[1]
        sizes.setdefault(name, {}).setdefault(kind, 0)
        sizes[name][kind] += int(size, 16)
    return sizes


def flash_table(build, cross, port):
    sizes = linked_bytes(build / "firmware" / port / "imucal.map")
    flash = {}
    for name, kinds in sizes.items():
        if "/common/" in name:
            flash[Path(name).stem] = kinds.get("text", 0) + kinds.get("rodata", 0) + kinds.get("data", 0)
    flash["whole core"] = sum(flash.values())
    flash["whole core without the texts of status"] = flash["whole core"] - flash.get("status", 0)
    objects = sorted((build / "obj" / port / "common").glob("*.o"))
    flash["whole core, objects before linking"] = sum(int(line.split()[0]) for line in
                                                      run(cross + "size", *objects).splitlines()[1:])
    flash["libgcc and libc in the image"] = sum(k.get("text", 0) + k.get("rodata", 0) for n, k in sizes.items() if ".a(" in n)
    flash["app"] = sum(k.get("text", 0) + k.get("rodata", 0) for n, k in sizes.items() if "/firmware/app/" in n)
    return flash


def struct_table(cross, port):
    """Sizes by the compiler itself: one array of that size per structure."""
    lines = ['#include "app/app.h"']
    for i, (_, what) in enumerate(STRUCTS.items()):
        size = " + ".join("sizeof(%s)" % part for part in what.split(", "))
        lines.append("char size_%d[%s];" % (i, size))
    with tempfile.TemporaryDirectory() as folder:
        source, out = Path(folder) / "sizes.c", Path(folder) / "sizes.o"
        source.write_text("\n".join(lines) + "\n")
        run(cross + "gcc", *PORTS[port][2].split(), "-std=c99", "-Icommon", "-Ifirmware", "-fno-common", "-c", source, "-o", out)
        found = dict((name, int(size, 16)) for size, name in re.findall(r" ([0-9a-f]+) B (size_\d+)", run(cross + "nm", "-S", out)))
    return {label: found["size_%d" % i] for i, label in enumerate(STRUCTS)}


def size(build, cross):
    return {port: dict({"flash " + k: v for k, v in flash_table(build, cross, port).items()},
                       **{"RAM " + k: v for k, v in struct_table(cross, port).items()}) for port in PORTS}


# ---- stack ----

# Where calls through a pointer lead to, by caller (or the part of the program it was inlined into).
INDIRECT = [(r"nor_|save_torn_byte|check_erased", r"load|save"), (r"sample_stream|refill|semihost_sample_read", r"feed_refill"),
            (r"", r"port_\w+")]


def frames_by_disassembly(body):
    """Bytes pushed and reserved by one function, for library code without .su files."""
    total = 0
    for registers in re.findall(r"\b(?:push|stmdb\s+sp!,)\s*\{([^}]*)\}", body):
        total += 4 * sum(1 if "-" not in r else int(r.split("-")[1][1:]) - int(r.split("-")[0].strip()[1:]) + 1
                         for r in registers.split(","))
    for registers in re.findall(r"\bvpush\s*\{([^}]*)\}", body):
        first, _, last = registers.partition("-")
        n = int(last.strip()[1:]) - int(first.strip()[1:]) + 1 if last else 1
        total += n * (8 if first.strip().startswith("d") else 4)
    total += sum(int(n) for n in re.findall(r"\bsub(?:\.w)?\s+sp, (?:sp, )?#(\d+)", body))
    return total


def call_graph(build, cross, port):
    """{function: (frame bytes, set of callees)} of the linked image."""
    su = {}
    for path in (build / "obj" / port).rglob("*.su"):
        for line in path.read_text().splitlines():
            place, n, _ = line.split("\t")
            name = place.split(":")[-1]
            su[name] = max(su.get(name, 0), int(n))
    graph = {}
    text = run(cross + "objdump", "-d", "--no-show-raw-insn", build / "firmware" / port / "imucal.elf")
    for name, body in re.findall(r"^[0-9a-f]+ <([^>]+)>:\n(.*?)(?=^\n|\Z)", text, re.M | re.S):
        callees = {callee for callee in re.findall(r"\b(?:bl|b(?:\.[nw])?)\s+[0-9a-f]+ <([^>+]+)>", body) if callee != name}
        plain = re.sub(r"\.(isra|part|constprop|cold)\.?\d*", "", name)
        has_pointer = re.search(r"\bblx\s+\w|\bbx\s+r\d", body) is not None
        graph[name] = (su.get(name, su.get(plain, frames_by_disassembly(body))), callees, has_pointer)

    def targets(caller):
        target = next(target for who, target in INDIRECT if re.match(who, caller))
        return {name for name in graph if re.fullmatch(target, name)}

    return {name: (frame, callees | (targets(name) if has_pointer and not name.startswith("__") else set()))
            for name, (frame, callees, has_pointer) in graph.items()}


def deepest(graph, name, path=()):
    """(bytes, path): the deepest call from here; a pointer back into the path (no function here recurs) is left out."""
    frame, callees = graph.get(name, (0, set()))
    best = (0, ())
    for callee in callees:
        if callee in graph and callee not in path:
            best = max(best, deepest(graph, callee, path + (name,)), key=lambda b: b[0])
    return frame + best[0], (name,) + best[1]


def run_check(build, port, mode):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.txt"
        arguments = ["enable=on", "target=native", "arg=check", "arg=mode=" + mode, "arg=out=%s" % out]
        run("qemu-system-arm", "-M", PORTS[port][0], "-kernel", build / "firmware" / port / "check.elf", "-display", "none",
            "-monitor", "none", "-serial", "none", "-icount", "shift=0", "-semihosting-config", ",".join(arguments))
        lines = out.read_text().splitlines()
    if lines[-1] != "end":
        sys.exit("cost: the check in QEMU reports '%s'" % lines[-1])
    return {line.rsplit(" ", 1)[0]: int(line.rsplit(" ", 1)[1]) for line in lines[:-1]}


def stack(build, cross, paths=None):
    result = {}
    for port in PORTS:
        total, path = deepest(call_graph(build, cross, port), "main")
        result[port] = {"whole program, deepest path": total}
        result[port].update({"measured " + name: n for name, n in run_check(build, port, "stack").items()})
        if paths is not None:
            paths[port] = path
    return result


# ---- cycles ----

def cycles(build, _cross):
    result = {}
    for port in PORTS:
        counts = run_check(build, port, "cycles")
        per_sample = counts["sum_add channels 6"] / 6
        counts["sum per channel and second (100 Hz, mean and unit included)"] = round(
            RATE_HZ * per_sample + counts["mean_q16 + unit_from_q16"])
        counts["kf order 3 per channel and second"] = counts["kf_update order 3"]
        counts["comp order 3 per channel and second (100 Hz)"] = RATE_HZ * counts["comp_apply order 3"]
        result[port] = counts
    return result


# ---- tables ----

def print_table(title, figures, unit, baseline=None):
    names = list(dict.fromkeys(name for port in PORTS for name in figures[port]))
    width = max(map(len, names)) + 2
    print("%-*s%s   [%s]" % (width, title, "".join("%22s" % PORTS[port][1] for port in PORTS), unit))
    for name in names:
        cells = []
        for port in PORTS:
            value, old = figures[port].get(name), (baseline or {}).get(port, {}).get(name)
            change = "" if old in (None, value) or value is None else " (%+d)" % (value - old)
            cells.append("%22s" % ("-" if value is None else "%d%s" % (value, change)))
        print("%-*s%s" % (width, name, "".join(cells)))
    print()


def compare(figures, baseline):
    """Prints what changed; True where nothing grew by more than 2 %."""
    grown = []
    for kind in figures:
        for port in PORTS:
            for name, value in figures[kind][port].items():
                old = baseline.get(kind, {}).get(port, {}).get(name)
                if old is not None and value > old * 1.02:
                    grown.append("%s %s: %s was %d, is %d" % (kind, port, name, old, value))
        print_table(kind, figures[kind], "change against " + BASELINE.name, baseline.get(kind))
    print("\n".join(grown) if grown else "nothing grew by more than 2 %")
    return not grown


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["size", "stack", "cycles", "save", "diff"])
    parser.add_argument("--build", type=Path, default=ROOT / "build")
    parser.add_argument("--cross", default="arm-none-eabi-")
    args = parser.parse_args()
    build = args.build.resolve()
    if args.what == "size":
        print_table("size as linked", size(build, args.cross), "bytes")
    elif args.what == "stack":
        paths = {}
        print_table("stack", stack(build, args.cross, paths), "bytes")
        for port in PORTS:
            print("%s: %s" % (PORTS[port][1], " > ".join(paths[port])))
    elif args.what == "cycles":
        print_table("cycles", cycles(build, args.cross), "instructions per call, call included")
    else:
        figures = {"size": size(build, args.cross), "stack": stack(build, args.cross), "cycles": cycles(build, args.cross)}
        if args.what == "save":
            BASELINE.write_text(json.dumps(figures, indent=1) + "\n")
        elif not BASELINE.exists():
            sys.exit("cost: no %s to compare with; make one with: firmware/cost.py save" % BASELINE.name)
        elif not compare(figures, json.loads(BASELINE.read_text())):
            sys.exit(1)


if __name__ == "__main__":
    main()
