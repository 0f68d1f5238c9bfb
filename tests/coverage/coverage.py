# SPDX-License-Identifier: MIT
"""Lines and branches of the core and of the firmware's app that their unit tests run (gcov).

usage: coverage.py [--build DIR] [--verbose] [FILE ...]

Every line of common/*.c and firmware/app/*.c must be run.  A branch that no test takes must stand in uncovered.txt with
the reason why none can; an entry whose branch is taken, or is no more, is an error too.  Exit status: 0 so it is, 1 not."""
import argparse
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
CC = os.environ.get("CC", "gcc")
FLAGS = "-std=c99 -ffp-contract=off -O0 -g -w -D_GNU_SOURCE -Icommon -Ifirmware -Itests".split()
TESTS = ["tests/common/test_*.c", "tests/firmware/test_app_*.c", "tests/firmware/test_board.c"]
SIMULATED = ["firmware/port/sim/nor.c", "firmware/port/sim/sample_stream.c", "firmware/port/sim/board_options.c"]


def run(command):
    done = subprocess.run([str(c) for c in command], cwd=ROOT, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit("coverage: %s\n%s" % (" ".join(map(str, command)), (done.stdout + done.stderr)[-3000:]))
    return done.stdout


def compile_all(sources, folder, more):
    """Objects of the sources, beside whose names gcov finds its notes."""
    objects = [folder / (str(source).replace("/", "-")[:-2] + ".o") for source in sources]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(lambda pair: run([CC, *FLAGS, *more, "-c", pair[0], "-o", pair[1]]), zip(sources, objects)))
    return objects


def run_tests(folder, measured):
    """Build and run every unit test of the core and of the app; counters add up in folder."""
    objects = compile_all(measured, folder, ["--coverage"])
    others = compile_all(SIMULATED + ["tests/firmware/bench.c"], folder, [])
    tests = sorted(path.relative_to(ROOT) for pattern in TESTS for path in ROOT.glob(pattern))
    programs = compile_all(tests, folder, [])
    for test, program in zip(tests, programs):
        run([CC, "--coverage", program, *objects, *others, "-lcmocka", "-lm", "-o", folder / test.stem])
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(lambda test: run([folder / test.stem]), tests))
    return objects


def measure(folder, measured, objects):
    """{file: (lines, lines run, branches, [(line number, text, arm) not taken], [line number, text not run])}"""
    found = {}
    for source, made in zip(measured, objects):
        report = json.loads(run(["gcov", "--stdout", "--json-format", "--branch-probabilities", made.with_suffix(".gcda")]))
        text = (ROOT / source).read_text().splitlines()
        squeeze = lambda n: " ".join(text[n - 1].split())
        lines = {}
        for entry in next(f for f in report["files"] if f["file"] == str(source))["lines"]:
            at = lines.setdefault(entry["line_number"], [0, []])
            at[0] += entry["count"]
            at[1].append([branch["count"] for branch in entry["branches"]])
        branches = {n: [sum(counts) for counts in zip(*arms)] for n, (_, arms) in lines.items() if arms and arms[0]}
        found[str(source)] = (len(lines), sum(at[0] > 0 for at in lines.values()), sum(map(len, branches.values())),
                              [(n, squeeze(n)) for n, arms in sorted(branches.items()) for count in arms if count == 0],
                              [(n, squeeze(n)) for n, at in sorted(lines.items()) if at[0] == 0])
    return found


def read_argued(path):
    """{(file, line, "lines" or "branches"): number}: three lines each: file, number and which, the line, why."""
    argued, entry = {}, []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if not line.strip() or line.startswith("# "):
            continue
        entry.append(line.strip())
        if len(entry) < 3:
            continue
        head = entry[0].split()
        if not entry[2].startswith("because ") or len(head) != 3 or not head[1].isdigit() or head[2] not in ("lines", "branches"):
            sys.exit("coverage: %s:%d: expected 'FILE NUMBER lines|branches', the line, 'because ...'" % (path, number))
        argued[head[0], entry[1], head[2]] = int(head[1])
        entry = []
    return argued


def judge(found, argued):
    """Complaints: lines not run, branches not argued, entries out of date."""
    complaints, missed = [], {}
    for name, (_, _, _, not_taken, not_run) in found.items():
        for what, at in (("lines", not_run), ("branches", not_taken)):
            for n, text in at:
                missed.setdefault((name, text, what), []).append(n)
    for (name, text, what), numbers in sorted(missed.items()):
        allowed = argued.pop((name, text, what), 0)
        if len(numbers) != allowed:
            complaints.append("%s:%d: %d %s not run, %d argued: %s" % (name, numbers[0], len(numbers), what, allowed, text))
    return complaints + ["uncovered.txt: run, or no such line: %s: %s (%s)" % key for key in argued if key[0] in found]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, help="measure these (common/*.c firmware/app/*.c)")
    parser.add_argument("--build", type=Path, default=ROOT / "build")
    args = parser.parse_args()
    measured = [path.relative_to(ROOT) for folder in ("common", "firmware/app") for path in sorted((ROOT / folder).glob("*.c"))]
    folder = args.build.resolve() / "coverage"
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.gcda"):
        old.unlink()
    objects = run_tests(folder, measured)
    found = measure(folder, measured, objects)
    if args.files:
        found = {name: found[name] for name in map(str, args.files)}
    argued = read_argued(HERE / "uncovered.txt")
    n_argued = sum(argued.values())
    complaints = judge(found, argued)
    print("%-26s %6s %6s %9s %10s" % ("file", "lines", "run", "branches", "not taken"))
    for name, (n_lines, n_run, n_branches, not_taken, _) in found.items():
        print("%-26s %6d %6d %9d %10d" % (name, n_lines, n_run, n_branches, len(not_taken)))
    print("coverage: %d of %d lines, %d of %d branches, %d argued; %d complaints" % (
        sum(f[1] for f in found.values()), sum(f[0] for f in found.values()),
        sum(f[2] - len(f[3]) for f in found.values()), sum(f[2] for f in found.values()), n_argued, len(complaints)))
    print("\n".join(complaints))
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
