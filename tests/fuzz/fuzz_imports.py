# SPDX-License-Identifier: MIT
"""Damaged files of other programs into the importers, and damaged JSON into `imucal check`.

A good file of each format is made, then hurt at random: bytes changed, bits flipped, pieces taken out, doubled, moved, cut off,
numbers at the edge put in.  What is taken must be a log whose times rise and whose values are finite or missing; what is not taken
must be refused by an error that names the file.  Anything else (another exception, a crash, a time-out) is a finding; its file is kept.
Files are tried in child processes, so that a crash of a library is a finding and not the end.

    python tests/fuzz/fuzz_imports.py --runs 20000 --seed 1 --keep build/fuzz_imports
"""
import argparse
import os
import pickle
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests/python"), str(ROOT / "host/python")]

KINDS = ["ulog", "bin", "hex", "csv", "st", "parquet", "blackbox", "mat5", "mat5struct", "mat73", "bag1", "bag2db3", "bag2mcap"]
JSONS = ["model", "profile", "table", "limits"]
EDGES = [b"\x00" * 4, b"\xff" * 4, b"\x7f\xff\xff\xff", b"\x80\x00\x00\x00", b"nan", b"inf", b"-1", b"1e999", b"99999999999999999999", b",", b"\n", b"\xef\xbb\xbf"]
BATCH = 400
LIMIT_S = 20
MEMORY_BYTES = 6 << 30

STATUS_TAKEN, STATUS_REFUSED, STATUS_FOUND = range(3)


def hurt(data, rng):
    """The bytes with one to four damages."""
    data = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at, length = rng.randrange(len(data) + 1), min(1 << rng.randint(0, 9), max(len(data) // 2, 1))
        kind = rng.randrange(6)
        if kind == 0:
            data[at:at + 1] = bytes([rng.randrange(256)])
        elif kind == 1 and data:
            data[at % len(data)] ^= 1 << rng.randrange(8)
        elif kind == 2:
            del data[at:at + length]
        elif kind == 3:
            data[at:at] = data[at:at + length]
        elif kind == 4:
            edge = rng.choice(EDGES)
            data[at:at + len(edge)] = edge
        elif rng.randrange(4) == 0:
            del data[at:]
    return bytes(data)


def seeds(folder):
    """[(kind, path to give to the reader, file to hurt)]"""
    import foreign
    rec = foreign.recording(duration_s=24)
    found = []
    for kind in KINDS:
        path = foreign.write(kind, folder, rec)
        inner = path if path.is_file() else next(p for p in sorted(path.iterdir()) if p.suffix in (".db3", ".mcap"))
        found.append((kind, path, inner))
    for name, text in json_examples().items():
        path = folder / f"{name}.json"
        path.write_text(text)
        (folder / f"good.{name}.json").write_text(text)
        found.append((name, path, path))
    return found


def json_examples():
    """The example files of the formats' own document."""
    import re
    text = (ROOT / "host/formats.md").read_text(encoding="utf-8")
    found = {}
    for name in ("model", "profile", "table"):
        mark = {"profile": "chamber"}.get(name, name)
        found[name] = re.search(r"<!-- example: %s\.json -->\n```json\n(.*?)```" % mark, text, re.S).group(1)
    found["limits"] = '{ "imucal_limits": 1, "span_degc": [0, 50], "max_sigma": 10, "max_bias": 1000, "max_slope_per_degc": 20 }\n'
    return found


def read(kind, path):
    """STATUS_TAKEN or STATUS_REFUSED; raises what must not happen."""
    import numpy as np

    import imucal
    from imucal.check import check_file
    from imucal.errors import ImucalError
    from imucal.limits import judge
    try:
        if kind in JSONS:
            messages = check_file(str(path))[1]
            if not messages and kind in ("limits", "table"):
                other = str(path.parent / ("good.table.json" if kind == "limits" else "good.limits.json"))
                judge(*((other, str(path)) if kind == "limits" else (str(path), other)))
            assert all(path.name in message for message in messages), f"a message does not name the file: {messages}"
            return STATUS_REFUSED if messages else STATUS_TAKEN
        log = imucal.import_log(path, unit="radps" if kind.startswith("mat") else None).log
    except ImucalError as error:
        assert str(path) in str(error) or path.name in str(error), f"the error does not name the file: {error}"
        return STATUS_REFUSED
    assert (np.diff(log.t_s) > 0).all(), "times do not rise"
    assert np.isfinite(log.t_s).all() and not any(np.isinf(rate).any() for rate in log.rates.values()), "values are not finite"
    return STATUS_TAKEN


def try_one(kind, path):
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return read(kind, path), ""
    except BaseException:  # every other way out is what we look for
        return STATUS_FOUND, traceback.format_exc(limit=-3)


def child(cases):
    """In a process of its own: one line per case, written before the next one begins."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    answers = os.dup(1)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.dup2(null, 2)
    for kind, path, inner, data in cases:
        inner.write_bytes(data)
        signal.alarm(LIMIT_S)  # its default action ends the process
        status, text = try_one(kind, path)
        os.write(answers, f"{status}\t{text.splitlines()[-1] if text else ''}\n".encode(errors="replace"))


def run_batch(work, cases):
    """[(status, text)] of the cases; a case that ended its process is found, and those behind it go on in a new one."""
    done = []
    while len(done) < len(cases):
        (Path(work) / "cases").write_bytes(pickle.dumps(cases[len(done):]))
        run = subprocess.run([sys.executable, __file__, "--child", Path(work) / "cases"], stdout=subprocess.PIPE, text=True, errors="replace")
        answers = [line.split("\t", 1) for line in run.stdout.splitlines()]
        done += [(int(status), text) for status, text in answers]
        if len(done) < len(cases):
            done.append((STATUS_FOUND, f"the process ended with status {run.returncode} (a signal where negative; 14: after {LIMIT_S} s)"))
    return done


def fuzz(runs, seed, keep, kinds=None, show=None):
    """{kind: [taken, refused, found]}; what is found is kept as keep/KIND-NUMBER with its reason beside it."""
    rng = random.Random(seed)
    counts = {}
    with tempfile.TemporaryDirectory() as folder:
        good = [s for s in seeds(Path(folder)) if not kinds or s[0] in kinds]
        whole = {kind: inner.read_bytes() for kind, _, inner in good}
        for kind, path, inner in good:
            assert try_one(kind, path)[0] == STATUS_TAKEN, f"the good file of {kind} is not taken: {try_one(kind, path)[1]}"
            counts[kind] = [0, 0, 0]
        for first in range(0, runs, BATCH):
            cases = [(kind, path, inner, hurt(whole[kind], rng)) for kind, path, inner in rng.choices(good, k=min(BATCH, runs - first))]
            for number, ((kind, _, _, data), (status, text)) in enumerate(zip(cases, run_batch(folder, cases))):
                counts[kind][status] += 1
                if status == STATUS_FOUND:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{kind}-{first + number}").write_bytes(data)
                    (keep / f"{kind}-{first + number}.txt").write_text(text)
                    if show:
                        show(f"found  {kind}-{first + number}  {text}")
    return counts


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--runs", type=int, default=20000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("build/fuzz_imports"), help="folder for what is found")
    parser.add_argument("--kinds", nargs="*", choices=KINDS + JSONS)
    options = parser.parse_args()
    if options.keep.exists():
        shutil.rmtree(options.keep)
    counts = fuzz(options.runs, options.seed, options.keep, options.kinds, lambda line: print(line, flush=True))
    print(f"{'format':12}{'taken':>8}{'refused':>9}{'found':>7}")
    for kind, row in counts.items():
        print(f"{kind:12}{row[0]:8}{row[1]:9}{row[2]:7}")
    total = [sum(row[i] for row in counts.values()) for i in range(3)]
    print(f"{'all':12}{total[0]:8}{total[1]:9}{total[2]:7}   seed {options.seed}")
    return 1 if total[STATUS_FOUND] else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        sys.exit(child(pickle.loads(Path(sys.argv[2]).read_bytes())))
    sys.exit(main())
