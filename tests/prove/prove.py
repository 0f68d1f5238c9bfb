# SPDX-License-Identifier: MIT
"""Frama-C Eva on the core and the app: is there an input within the stated ranges that overflows, leaves an array or divides by zero?

usage: prove.py [--build DIR] [--jobs N] [ENTRY ...]        an entry is a function prove_* of prove.c or prove_app.c (all)

Every alarm must stand in argued.txt with the reason why it cannot happen; an argument without its alarm is an error too
when all entries are run.  Exit status: 0 so it is, 1 not, 3 no Frama-C."""
import argparse
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
OPTIONS = ["-machdep", "gcc_x86_32", "-cpp-extra-args=-Icommon -Ifirmware", "-eva",
           "-warn-special-float", "none", "-eva-no-show-progress", "-eva-msg-key=-initial-state,-final-states"]
# Eva alone: the plug-in inout of version 25 stops at an initialiser of a struct whose array is as long as an enum constant says
# (imucal_kf_init), and what it is for only saves time.
ONLY_EVA = ["-no-autoload-plugins", "-load-module", "eva"]
# Loops of known length one round at a time.
UNROLL = ["-eva-auto-loop-unroll", "64"]
CORE = ["-eva-precision", "2"]
# In the app paths are many and numbers few: precision 0, but the outcomes of a contract are kept apart.
APP = ["-eva-precision", "0", "-eva-interprocedural-splits"]
ALARM = re.compile(r"\[eva:alarm\] (\S+):(\d+): Warning:\s+(.*?)(?=\n\[|\Z)", re.S)


def entries_of(name):
    """The functions prove_* of prove.c or prove_app.c."""
    return re.findall(r"(?m)^void (prove_\w+)\(void\)", (HERE / name).read_text())


def kind_of(message):
    """'signed overflow', 'out of bounds write', ..."""
    return " ".join(re.split(r"\bassert\b|\.", " ".join(message.split()))[0].split())


def analyse(entry, folder):
    """(alarms {(file, line text, kind)}, the whole output, did it come to its end?)"""
    is_app = entry in entries_of("prove_app.c")
    sources = ["tests/prove/prove_app.c", "tests/prove/core_contracts.c", "common/num.c"] if is_app else ["tests/prove/prove.c"]
    sources += [str(p.relative_to(ROOT)) for p in sorted((ROOT / ("firmware/app" if is_app else "common")).glob("*.c"))]
    options = [*(ONLY_EVA if is_app or entry == "prove_kf_init" else []), *OPTIONS, *(APP if is_app else CORE), *UNROLL]
    done = subprocess.run(["frama-c", *options, "-main", entry, *sources], cwd=ROOT, capture_output=True, text=True)
    (folder / (entry + ".txt")).write_text(done.stdout + done.stderr)
    alarms = set()
    for name, line, message in ALARM.findall(done.stdout):
        text = " ".join((ROOT / name).read_text().splitlines()[int(line) - 1].split())
        alarms.add((name, text, kind_of(message)))
    return alarms, done.returncode == 0 and "ANALYSIS SUMMARY" in done.stdout


def read_argued(path):
    """{(file, line, kind): reason}: four lines each: the file, the line, the alarm, because ..."""
    lines = [line.strip() for line in path.read_text().splitlines() if line.strip() and not line.startswith("# ")]
    if len(lines) % 4 or any(not line.startswith("because ") for line in lines[3::4]):
        sys.exit("prove: %s: expected four lines each: file, line, alarm, because ..." % path)
    return {tuple(lines[i:i + 3]): lines[i + 3][8:] for i in range(0, len(lines), 4)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = entries_of("prove.c") + entries_of("prove_app.c")
    parser.add_argument("entries", nargs="*", metavar="ENTRY", help=" ".join(known))
    parser.add_argument("--build", type=Path, default=ROOT / "build")
    parser.add_argument("--jobs", type=int, default=2)
    args = parser.parse_args()
    if set(args.entries) - set(known):
        parser.error("no such entry: %s" % ", ".join(sorted(set(args.entries) - set(known))))
    if not shutil.which("frama-c"):
        print("prove: no frama-c; install it with: apt-get install --no-install-recommends frama-c-base", file=sys.stderr)
        return 3
    folder = args.build.resolve() / "prove"
    folder.mkdir(parents=True, exist_ok=True)
    argued = read_argued(HERE / "argued.txt")
    entries = args.entries or known
    seen, complaints = set(), []
    with ThreadPoolExecutor(args.jobs) as pool:
        for entry, (alarms, is_whole) in zip(entries, pool.map(lambda e: analyse(e, folder), entries)):
            new = sorted(alarms - set(argued))
            seen |= alarms
            print("%-26s %3d alarms, %3d of them argued%s" % (entry, len(alarms), len(alarms) - len(new),
                                                              "" if is_whole else "; DID NOT FINISH"), flush=True)
            complaints += ["%s: %s: %s: %s" % (entry, *alarm) for alarm in new]
            complaints += [] if is_whole else ["%s: frama-c stopped: see %s" % (entry, folder / (entry + ".txt"))]
    if not args.entries:
        complaints += ["argued.txt: no such alarm any more: %s: %s: %s" % key for key in sorted(set(argued) - seen)]
    print("prove: %d entries, %d alarms, %d to be argued or mended" % (len(entries), len(seen), len(complaints)))
    print("\n".join(complaints))
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
