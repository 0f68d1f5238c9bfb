# SPDX-License-Identifier: MIT
"""What a fault is, and how one is run: a log (or its files, or the command line) is spoilt, the built program runs, and what
came of it is one row of the table."""
import json
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Callable

from reference import BASIC
from reference import DRIFTING as MODEL



@dataclass
class Outcome:
    status: int
    rules: list          # that speak against it ("judgement"), empty where a plain error says it
    message: str         # first line of standard error
    is_flashed: bool     # a table came into being
    left_out: int = 0    # seconds that the gate or the thermometer's rule left out
    is_noted: bool = False  # a last row without line end was left out, and said so with its line


@dataclass
class Fault:
    area: str            # sensor, thermometer, clock, model, files, operator, link
    name: str
    found_by: str        # rule that must be among those found; "status N" for a plain error; "left out", "noted": learnt around
    inject: Callable     # Bench -> Outcome

    def is_found(self, outcome):
        if self.found_by == "left out":
            return outcome.status == 0 and outcome.left_out > 0
        if self.found_by == "noted":
            return outcome.status == 0 and outcome.is_noted
        if self.found_by.startswith("status "):
            return outcome.status == int(self.found_by.split()[1]) and outcome.message != ""
        return outcome.status == 1 and self.found_by in outcome.rules

    def is_safe(self, outcome):
        """Nothing wrong is flashed with status 0: what is learnt around is counted, all else leaves no table."""
        return self.found_by in ("left out", "noted") or (outcome.status != 0 and not outcome.is_flashed)


class Bench:
    """One folder with a healthy log of two axes, its model and profile, and the programs."""

    def __init__(self, folder, programs):
        self.folder, self.programs = Path(folder), Path(programs)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.write("model.json", MODEL)
        self.write("chamber.json", BASIC)
        self.simulate("healthy.csv", "--axes", 2)
        lines = (self.folder / "healthy.csv").read_text().splitlines()
        at = next(i for i, line in enumerate(lines) if line.startswith("t_s"))
        self.head, self.rows = lines[:at + 1], [line.split(",") for line in lines[at + 1:]]

    def write(self, name, content):
        (self.folder / name).write_text(content if isinstance(content, str) else json.dumps(content))
        return name

    def run(self, program, *arguments, stdin=None, stdout=subprocess.PIPE):
        return subprocess.run([str(self.programs / program), *map(str, arguments)], cwd=self.folder, input=stdin, stdout=stdout,
                              stderr=subprocess.PIPE, text=True, timeout=120, errors="replace")

    def simulate(self, name, *arguments, profile="chamber.json", model="model.json", seed=1):
        result = self.run("gyrosim", "log", "--model", model, "--profile", profile, "--seed", seed, "-o", name, "-q", *arguments)
        assert result.returncode == 0, result.stderr
        return name

    def with_rows(self, change, name="sick.csv", head=None):
        """The healthy log with every row through change(i, fields): fields, None (no row)."""
        rows = [change(i, list(row)) for i, row in enumerate(self.rows)]
        return self.write(name, "\n".join([*(head or self.head), *(",".join(map(str, row)) for row in rows if row)]) + "\n")

    def fit(self, *arguments, model="model.json", stdin=None):
        """calibrate fit with an output table; the outcome."""
        table = self.folder / "table.json"
        table.unlink(missing_ok=True)
        out = self.folder / "fit.json"
        out.unlink(missing_ok=True)
        with_model = ["--model", model] if model else ["--method", "poly"]
        result = self.run("calibrate", "fit", *arguments, *with_model, "-o", table.name, "--json", out.name, "-q", stdin=stdin)
        return self.outcome(result, table, json.loads(out.read_text()) if out.exists() else {})

    def outcome(self, result, table, answer=None):
        reasons = (answer or {}).get("judgement", {}).get("reasons", [])
        left_out = sum(a["n_rejected"] + a["n_bad_temperature"] for a in (answer or {}).get("axes", []))
        lines = [line for line in result.stderr.splitlines() if line and ": note: " not in line]
        first = lines[0] if lines else ""
        is_noted = re.search(r":\d+: the last row has no line end.* is left out", result.stderr) is not None
        return Outcome(result.returncode, sorted({r["rule"] for r in reasons}), first, Path(table).exists(), left_out, is_noted)

    def fit_rows(self, change, **options):
        return self.fit(self.with_rows(change), **options)
