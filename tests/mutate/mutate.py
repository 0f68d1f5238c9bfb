# SPDX-License-Identifier: MIT
"""Do the unit tests of the core catch errors?  Makes small errors in common/*.c, one at a time, and runs the unit test of
that room alone.  Prints how many were found (killed) and which were not (survived).

usage: mutate.py [ROOM ...] [--sample N --seed S] [--at-least 0.95] [--jobs N] [--list] [--verbose]

An error that cannot change what the room does is no error: mutants whose object code is the same are left out, and
those that a person has judged equal stand in equivalent.txt, each with its reason.  Exit status: 0 enough were killed,
1 not, 2 usage, 3 a room's own test fails before anything was changed."""
import argparse
import concurrent.futures
import hashlib
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
CC = os.environ.get("CC", "cc")
# Compiles in a twentieth of the time: what it kills is dead (the room's test passes with it), the rest goes to CC.
QUICK = shutil.which(os.environ.get("QUICK_CC", "tcc"))
CFLAGS = "-std=c99 -ffp-contract=off -fno-common -w".split()
# An index beyond its array or a signed overflow ends the program, as under `make sanitize`.
CHECKED = "-fsanitize=undefined -fsanitize-undefined-trap-on-error".split()
TEST_CFLAGS = "-std=c99 -ffp-contract=off -w -D_GNU_SOURCE".split()
# Rooms whose test has another name than test_<room>.c.
TEST_OF = {"crc": "num", "sample": "num"}
# Only texts: nothing to mutate but the words.
SKIPPED = {"status"}

# ---- mutants ----

CODE = re.compile(r"""
    (?P<skip>/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'|\#\s*(?:include|if|ifdef|ifndef|elif|else|endif|error)[^\n]*
      |typedef\s+char[^;]*;|\[\s*\d+\s*\])
  | (?P<float>(?<![\w.])(?:0x[0-9a-fA-F.]+p[+-]?\d+|\d+\.\d*(?:[eE][+-]?\d+)?|\d+[eE][+-]?\d+)f?)
  | (?P<int>(?<![\w.])(?:0x[0-9a-fA-F]+|\d+)(?:[uUlL]*)(?![\w.]))
  | (?P<word>[A-Za-z_]\w*)
  | (?P<op>->|<<=|>>=|\+\+|--|<<|>>|<=|>=|==|!=|&&|\|\||\+=|-=|\*=|/=|%=|&=|\|=|\^=|[-+*/%&|^!<>~])
""", re.X | re.S)
SWAPS = {"<": ["<=", ">="], ">": [">=", "<="], "<=": ["<", ">"], ">=": [">", "<"], "==": ["!="], "!=": ["=="],
         "&&": ["||"], "||": ["&&"], "+": ["-"], "-": ["+"], "*": ["/"], "/": ["*"], "%": ["*"], "<<": [">>"], ">>": ["<<"],
         "&": ["|"], "|": ["&"], "^": ["|"], "+=": ["-="], "-=": ["+="], "*=": ["/="], "/=": ["*="], "|=": ["&="],
         "&=": ["|="], "^=": ["|="], "++": ["--"], "--": ["++"], "<<=": [">>="], ">>=": ["<<="], "!": [""]}
STATEMENT = re.compile(r"(?m)(?<=[;{})])[ \t]*(?:\n[ \t]*)*((?:\*+)?[A-Za-z_][\w.\[\]>*+\- ]*(?:\[[^\]\n]*\])?[\w.>\-]*\s*"
                       r"(?:=|\+=|-=|\*=|/=|\|=|\^=|<<=|>>=)\s*[^;{}]+;|(?:\+\+|--)[\w.>\-\[\]]+;|[\w.>\-\[\]]+(?:\+\+|--);"
                       r"|[a-z_]\w*\([^;{}]*\);|break;|continue;)")
DECLARATION = re.compile(r"^(?:const |static |typedef |return\b|else\b|(?:unsigned |u?int\d+_t|float|bool|size_t|double|char|"
                         r"imucal_\w+_t|\w+_t)\b[ *])")


def masked(text):
    """The text with comments, strings and directives blanked: same length."""
    blank = lambda m: re.sub(r"[^\n]", " ", m.group()) if m.lastgroup == "skip" else m.group()
    return CODE.sub(blank, text)


def changed_numbers(token, is_float):
    if is_float:
        suffix = "f" if token.endswith("f") else ""
        value = float.fromhex(token.rstrip("f")) if token.startswith("0x") else float(token.rstrip("f"))
        return ["1.0" + suffix] if value == 0 else ["%.9e%s" % (value * 1.01, suffix)]
    digits = re.match(r"0x[0-9a-fA-F]+|\d+", token).group()
    suffix, value = token[len(digits):], int(digits, 0)
    return [str(v) + suffix for v in (value + 1, value - 1) if v >= 0]


def closing(text, at):
    """Index of the parenthesis that closes the one at `at`."""
    depth = 0
    for i in range(at, len(text)):
        depth += {"(": 1, ")": -1}.get(text[i], 0)
        if depth == 0:
            return i
    return None


def edits(text):
    """[(begin, end, new text, kind)] over the whole file."""
    code = masked(text)
    found = []
    for match in CODE.finditer(text):
        kind, token = match.lastgroup, match.group()
        if kind == "skip" or kind == "word":
            if token in ("if", "while"):
                begin = code.index("(", match.end())
                end = closing(code, begin)
                found.append((begin, end + 1, "(!" + text[begin:end + 1] + ")", "condition"))
            continue
        if kind in ("float", "int"):
            found += [(match.start(), match.end(), new, "constant") for new in changed_numbers(token, kind == "float")]
        elif token != "->":
            found += [(match.start(), match.end(), new, "operator") for new in SWAPS.get(token, [])]
    for match in STATEMENT.finditer(code):
        if not DECLARATION.match(match.group(1)):
            found.append((match.start(1), match.end(1), ";", "statement"))
    return found


class Mutant:
    def __init__(self, source, text, edit):
        begin, end, new, self.kind = edit
        self.source, self.text = source, text[:begin] + new + text[end:]
        self.line = text.count("\n", 0, begin) + 1
        first = text.rfind("\n", 0, begin) + 1
        last = text.find("\n", end)
        squeeze = lambda s: " ".join(s.split())
        self.old = squeeze(text[first:last])
        self.new = squeeze(text[first:begin] + new + text[end:last])
        self.result, self.name = None, hashlib.sha1((source.name + str(edit)).encode()).hexdigest()[:12]

    def __str__(self):
        return "%s:%d: %s\n    %s\n -> %s" % (self.source.name, self.line, self.kind, self.old, self.new)


def mutants_of(source):
    text = source.read_text()
    return [Mutant(source, text, edit) for edit in edits(text)]


# ---- building and running ----

def run(command, **options):
    return subprocess.run([str(c) for c in command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **options)


class Bench:
    """Objects of the core and of the tests, compiled once."""

    def __init__(self, folder, tests):
        self.folder, self.tests = folder, tests
        self.cpu_s = {}
        self.original = {}
        self.is_quick = {}
        for old in (folder / "mutants", folder / "base"):
            shutil.rmtree(old, ignore_errors=True)
            old.mkdir(parents=True)

    def compile(self, source, out, flags):
        return run([CC, *flags, "-I" + str(ROOT / "common"), "-I" + str(ROOT / "tests"), "-I" + str(ROOT / "firmware"), "-c", source,
                    "-o", out]).returncode == 0

    def prepare(self, rooms):
        for source in sorted((ROOT / "common").glob("*.c")):
            if not self.compile(source, self.folder / "base" / (source.stem + ".o"), ["-O1"] + CFLAGS):
                sys.exit("mutate: %s does not compile" % source)
        for test in {TEST_OF.get(room, room) for room in rooms}:
            if not self.compile(self.tests / "test_{}.c".format(test), self.folder / "base" / ("test_%s.o" % test),
                                ["-O2"] + TEST_CFLAGS):
                sys.exit("mutate: %s/test_%s.c does not compile" % (self.tests, test))

    def link(self, room, object_file, program, linker=CC):
        objects = [path for path in sorted((self.folder / "base").glob("*.o"))
                   if not path.name.startswith("test_") and path.stem != room]
        test = self.folder / "base" / ("test_%s.o" % TEST_OF.get(room, room))
        return run([linker, test, object_file, *objects, "-lcmocka", "-lm", "-o", program]).returncode == 0

    def execute(self, program, cpu_s):
        """'passed', 'failed' or 'time'."""
        def limit():
            resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
            resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        environment = dict(os.environ, CMOCKA_TEST_ABORT="1", IMUCAL_QUICK="1")
        try:
            code = run([program], preexec_fn=limit, env=environment, timeout=60 * cpu_s, cwd=ROOT).returncode
        except subprocess.TimeoutExpired:
            return "time"
        return "passed" if code == 0 else "time" if code == -24 else "failed"

    def baseline(self, room):
        """Processor seconds that the room's test takes; it must pass."""
        program = self.folder / "base" / ("program_" + room)
        if not self.link(room, self.folder / "base" / (room + ".o"), program):
            sys.exit("mutate: the test of %s does not link" % room)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        if self.execute(program, 300) != "passed":
            print("mutate: the test of %s fails before anything was changed" % room, file=sys.stderr)
            sys.exit(3)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        self.cpu_s[room] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        source = ROOT / "common" / (room + ".c")
        self.is_quick[room] = QUICK is not None and self.quick(source, room, program) == "passed"
        self.original[room] = self.code_of(source, room)

    def quick(self, source, room, program):
        object_file = self.folder / "mutants" / (program.name + ".quick.o")
        try:
            if run([QUICK, "-I" + str(ROOT / "common"), "-c", source, "-o", object_file]).returncode != 0:
                return "no code"
            if not self.link(room, object_file, program, QUICK):
                return "no code"
            return self.execute(program, int(3 * self.cpu_s[room]) + 2)
        finally:
            object_file.unlink(missing_ok=True)

    def code_of(self, source, room):
        """The machine code at -O2, to see that nothing has changed."""
        out = self.folder / "mutants" / (room + "_%s.s" % hashlib.sha1(str(source).encode()).hexdigest()[:12])
        run([CC, "-O2", *CFLAGS, "-I" + str(ROOT / "common"), "-S", source, "-o", out])
        text = re.sub(r"(?m)^\t\.(file|ident).*$", "", out.read_text()) if out.exists() else None
        out.unlink(missing_ok=True)
        return text

    def judge(self, mutant):
        room = mutant.source.stem
        stem = self.folder / "mutants" / mutant.name
        source, object_file, program = (stem.with_suffix(s) for s in (".c", ".o", ".exe"))
        source.write_text(mutant.text)
        if self.is_quick[room] and self.quick(source, room, program) in ("failed", "time"):
            mutant.result = "killed"
        elif not self.compile(source, object_file, ["-O1"] + CFLAGS + CHECKED):
            mutant.result = "no code"
        elif not self.link(room, object_file, program):
            mutant.result = "no code"
        else:
            outcome = self.execute(program, int(3 * self.cpu_s[room]) + 2)
            mutant.result = "survived" if outcome == "passed" else "killed"
            if mutant.result == "survived" and self.code_of(source, room) == self.original[room]:
                mutant.result = "same code"
        for path in (source, object_file, program):
            path.unlink(missing_ok=True)
        return mutant


# ---- judged equal by a person ----

def read_equivalents(path):
    """{(file, old line, new line): reason}; four lines each: file, old, -> new, because."""
    table, entry = {}, []
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if not line.strip() or line.startswith("# "):
            continue
        entry.append(line.strip())
        if len(entry) < 4:
            continue
        if not (entry[2].startswith("-> ") and entry[3].startswith("because ")):
            sys.exit("mutate: %s:%d: expected file, old line, '-> new line', 'because ...'" % (path, number))
        table[entry[0], entry[1], entry[2][3:]] = entry[3][8:]
        entry = []
    if entry:
        sys.exit("mutate: %s ends in the middle of an entry" % path)
    return table


def report(mutants, equivalents, seconds, at_least, verbose):
    key_of = lambda m: (m.source.name, m.old, m.new)
    alive = {key_of(m) for m in mutants if m.result == "survived"}
    for mutant in mutants:
        if mutant.result == "survived" and key_of(mutant) in equivalents:
            mutant.result = "equivalent"
        elif mutant.result == "killed" and key_of(mutant) in equivalents and key_of(mutant) not in alive:
            print("mutate: killed, though listed as equivalent: %s" % mutant)
    print("%-10s %8s %8s %9s %11s %10s %8s" % ("file", "mutants", "killed", "survived", "equivalent", "same code", "killed %"))
    survivors = [m for m in mutants if m.result == "survived"]
    total = [0, 0]
    for source in sorted({m.source for m in mutants}):
        count = {r: sum(m.source == source and m.result == r for m in mutants)
                 for r in ("killed", "survived", "equivalent", "same code")}
        judged = count["killed"] + count["survived"]
        total = [total[0] + count["killed"], total[1] + judged]
        print("%-10s %8d %8d %9d %11d %10d %8.1f" % (source.name, sum(count.values()), count["killed"], count["survived"],
              count["equivalent"], count["same code"], 100 * count["killed"] / max(1, judged)))
    if verbose or survivors:
        print("\n".join(["survived:"] * bool(survivors) + [str(m) for m in survivors]))
    share = total[0] / max(1, total[1])
    print("mutate: %d of %d killed, %.1f %% (at least %.1f %% asked), %.0f s"
          % (total[0], total[1], 100 * share, 100 * at_least, seconds))
    return share >= at_least and total[1] > 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help="rooms of common/ (all)")
    parser.add_argument("--sample", type=int, help="so many mutants, drawn at random")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--at-least", type=float, default=0.95, help="share to be killed (0.95)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--build", type=Path, default=ROOT / "build")
    parser.add_argument("--tests", type=Path, default=ROOT / "tests/common", help="folder of test_ROOM.c")
    parser.add_argument("--list", action="store_true", help="print the mutants, run nothing")
    parser.add_argument("--line", type=int, help="only this line")
    parser.add_argument("--verbose", action="store_true")
    args = parser.parse_args()
    known = [s.stem for s in sorted((ROOT / "common").glob("*.c")) if s.stem not in SKIPPED]
    rooms = args.rooms or known
    if set(rooms) - set(known):
        parser.error("no such room: %s (there are: %s)" % (", ".join(sorted(set(rooms) - set(known))), " ".join(known)))
    mutants = [m for room in rooms for m in mutants_of(ROOT / "common" / (room + ".c"))
               if args.line is None or m.line == args.line]
    if args.sample is not None:
        mutants = random.Random(args.seed).sample(mutants, min(args.sample, len(mutants)))
    if args.list:
        print("\n".join(map(str, mutants)))
        return 0
    equivalents = read_equivalents(HERE / "equivalent.txt")
    begin = time.monotonic()
    bench = Bench(args.build.resolve() / "mutate" / str(os.getpid()), args.tests.resolve())
    rooms = sorted({m.source.stem for m in mutants})
    bench.prepare(rooms)
    for room in rooms:
        bench.baseline(room)
    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        for i, mutant in enumerate(pool.map(bench.judge, mutants)):
            if sys.stderr.isatty():
                print("\r%d of %d" % (i + 1, len(mutants)), end="", file=sys.stderr)
            if args.verbose and mutant.result == "survived":
                print(mutant, flush=True)
    shutil.rmtree(bench.folder)
    judged = [m for m in mutants if m.result != "no code"]
    return 0 if report(judged, equivalents, time.monotonic() - begin, args.at_least, args.verbose) else 1


if __name__ == "__main__":
    sys.exit(main())
