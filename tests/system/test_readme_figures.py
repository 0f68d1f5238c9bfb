# SPDX-License-Identifier: MIT
"""The tables of the READMEs hold what the programs print: each is printed again here, or, where that takes long, compared with
the result that its command saved in tests/saved, whose short form is run again and must print the same digits.

Not compared: speeds, which are of a machine; the draws of `make blind`, which begin with fresh entropy and run for hours
(tests/blind/README.md and HISTORY.md say which seed gives which cases); the counts of campaigns of an hour (`make torn`, `soak`, `month`, …)."""
import os
import re
import subprocess
import sys

import pytest

from where import BIN, BUILD, ROOT

SAVED = ROOT / "tests/saved"


def rows_of(path, heading=None):
    """The table rows of a file, of one of its chapters, without rulers."""
    text = path.read_text(encoding="utf-8")
    if heading:
        text = re.search(r"(?ms)^#+ %s$(.*?)(?=^## |\Z)" % re.escape(heading), text).group(1)
    return [line for line in text.splitlines() if line.startswith("|") and not line.startswith("| ---")]


def cells(row):
    return [cell.strip() for cell in row.strip("|").split("|")]


# ---- make validation ----

def test_tables_of_make_validation_are_those_it_saved():
    chapter, room = "How well does it calibrate?", ROOT / "host/lib/analysis/montecarlo/README.md"
    saved = rows_of(SAVED / "validation.md")
    assert rows_of(room, chapter) == saved
    assert rows_of(ROOT / "README.md", chapter) == saved[:5]  # the campaigns
    text = " ".join(room.read_text(encoding="utf-8").split())
    stated = re.findall(r"(?m)^- (.*)$", (SAVED / "validation.md").read_text(encoding="utf-8"))
    assert len(stated) == 3 and [part for part in stated if part not in text] == []
    front = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    kalman, bins = re.search(r"worst error over temperature is ([\d.]+) dph, where the bins .*? have ([\d.]+);", front).groups()
    soaks, = (cells(row) for row in saved if row.startswith("| ramp and 20-min soaks | fine |"))
    assert (kalman, bins) == (soaks[2].split(" / ")[0], soaks[4].split(" / ")[0])


def test_validation_prints_the_same_digits_for_the_same_seed(tmp_path):
    """A few tests of each campaign; the columns that no draw enters are also those of the long run."""
    out = subprocess.run([sys.executable, ROOT / "host/scripts/validation.py", BIN / "montecarlo", "--short", "--out", tmp_path, "--save",
                          tmp_path / "short.md"], capture_output=True, text=True, timeout=120)
    assert out.returncode == 0, out.stderr
    short, long = rows_of(tmp_path / "short.md"), rows_of(SAVED / "validation.md")
    assert short == rows_of(SAVED / "validation_short.md"), "other digits: make validation SAVE=1, and its tables into the README"
    assert [cells(row)[0] for row in short if "tests" not in row] == [cells(row)[0] for row in long if "tests" not in row]
    for name in ("it believes", "truth covariance"):
        assert [row for row in short if row.startswith(f"| {name} ")] == [row for row in long if row.startswith(f"| {name} ")] != []


# ---- make blind ----

def test_figures_of_the_blind_check_are_those_of_its_own_readme():
    """The front page copies some of them; each stands there as `n/m` and here as `n of m`, with its interval."""
    table = " ".join(rows_of(ROOT / "tests/blind/README.md", "Figures"))
    rows = [cells(row) for row in rows_of(ROOT / "README.md", "How well does it diagnose?")]
    figures = [row for row in rows if row[0] != "question"]
    assert len(figures) == 10
    for question, figure, aim in figures:
        n, m, interval = re.fullmatch(r"(\d+) of (\d+) (\[[\d., ]+\])", figure).groups()
        assert re.search(r"\b%s(?:/| of )%s\b" % (n, m), table), question
        assert interval in table and aim in table, question
    seed, = re.findall(r"`BLIND_SEED=(\d+)`", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert f"BLIND_SEED={seed}" in (ROOT / "tests/blind/README.md").read_text(encoding="utf-8")


# ---- what it costs on the microcontroller ----

@pytest.fixture(scope="module")
def cost():
    """{(what, line of the table): (Cortex-M4F, Cortex-M0)} as `make size`, `stack` and `cycles` print it."""
    found = {}
    for what in ("size", "stack", "cycles"):
        out = subprocess.run([sys.executable, ROOT / "firmware/cost.py", what, "--build", BUILD], capture_output=True, text=True, timeout=200)
        assert out.returncode == 0, out.stderr
        for line in out.stdout.splitlines():
            match = re.match(r"(\S.*?)\s+(\d+)\s+(\d+)$", line)
            if match:
                found[what, match.group(1)] = (int(match.group(2)), int(match.group(3)))
    return found


# First words of a README's row -> (form, names), a name standing for one number of each processor.
KB = "{:.1f}"
WHOLE = "{:,}"
COST_ROWS = {
    "`kf`, order 3 / 5": (WHOLE, "cycles", ["kf_update order 3", "kf_update order 5"]),
    "the same, order 3": (WHOLE, "cycles", ["learn: learn_checked order 3, kf_update and health included"]),
    "the same with everything": (WHOLE, "cycles", ["learn: learn_checked order 3, kf_update and health included"]),
    "verdict on a channel": (WHOLE, "cycles", ["health_judge"]),
    "`clock`, per sample": (WHOLE, "cycles", ["clock_take"]),
    "`sum`, per channel": (WHOLE, "cycles", ["sum per channel and second (100 Hz, mean and unit included)"]),
    "`comp`, order 3 / 5 / 5": (WHOLE, "cycles", ["comp_apply order 3", "comp_apply order 5", "comp_apply order 5, scale factor order 2"]),
    "`comp`, order 3 / 5, per": (WHOLE, "cycles", ["comp_apply order 3", "comp_apply order 5"]),
    "`comp` with a scale": (WHOLE, "cycles", ["comp_apply order 3, scale factor order 2", "comp_apply order 5, scale factor order 2"]),
    "flash of `kf` / whole": (KB, "size", ["flash kf", "flash whole core without the texts of status"]),
    "flash of `kf` / `health`": (KB, "size", ["flash kf", "flash health", "flash whole core without the texts of status"]),
    "filter state / whole filter": (WHOLE, "size", ["RAM kf state: both filters' numbers", "RAM imucal_kf_t (with configuration and statistics)",
                                                    "RAM imucal_health_t"]),
    "filter state / `imucal_kf_t`": (WHOLE, "size", ["RAM kf state: both filters' numbers", "RAM imucal_kf_t (with configuration and statistics)",
                                                     "RAM imucal_health_t"]),
    "deepest stack": (WHOLE, "stack", ["whole program, deepest path"]),
}


def numbers(cell):
    return re.findall(r"\d[\d,]*(?:\.\d+)?", cell)


@pytest.mark.parametrize("path, heading", [("README.md", "What it costs on the MCU"), ("firmware/README.md", None)])
def test_costs_are_those_that_make_size_stack_and_cycles_print(cost, path, heading):
    rows = rows_of(ROOT / path, heading)
    at = next(i for i, row in enumerate(rows) if "Cortex-M4F | Cortex-M0" in row)
    n = 0
    for row in rows[at + 1:]:
        name, *columns = cells(row)
        known = [form for start, form in COST_ROWS.items() if name.startswith(start)]
        if len(columns) != 2 or not known:
            assert n >= 5, f"{path}: a row of costs that no command here prints: {row}"
            break
        form, what, names = known[0]
        for i, column in enumerate(columns):
            values = [cost[what, k][i] for k in names]
            expected = [form.format(v / 1000 if form == KB else v) for v in values]
            if column == "the same":
                assert all(cost[what, k][0] == cost[what, k][1] for k in names)
            else:
                assert numbers(column) == expected, row
        n += 1
    assert n >= 7


def test_flash_of_the_applications_is_what_make_budget_prints():
    out = subprocess.run(["make", "--no-print-directory", "budget", f"BUILD={os.path.relpath(BUILD, ROOT)}"], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert out.returncode == 0, out.stdout + out.stderr
    printed = [re.search(r"(\d+) +(\d+)$", line).groups() for line in out.stdout.splitlines() if re.search(r"\S +\d+ +\d+$", line)]
    rows = rows_of(ROOT / "firmware/README.md")
    at = next(i for i, row in enumerate(rows) if row.startswith("| application |"))
    stated = [tuple(v.replace(",", "") for v in cells(row)[1:]) for row in rows[at + 1:at + 1 + len(printed)]]
    assert len(printed) == 5 and stated == printed


# ---- sensors ----

def test_sensor_table_counts_what_stands_there():
    """All but the last column, which test_firmware_sensors.py runs: there every fault must be found."""
    import sensor_table
    rows = rows_of(ROOT / "firmware/sensors/README.md")
    at = next(i for i, row in enumerate(rows) if row.startswith("| driver | lines | model"))
    for row in rows[at + 1:at + 5]:
        name, *stated = cells(row)
        *counts, faults = sensor_table.counts_of(name.strip("`"))
        assert stated == [str(counts[0]), str(counts[1]), f"{counts[2]} / {counts[3]}", str(len(faults)), str(len(faults))], row


def test_ports_are_as_long_as_the_readme_says():
    import sensor_table
    text = " ".join((ROOT / "firmware/README.md").read_text(encoding="utf-8").split()).partition("How little that is")[2]
    for port in sensor_table.PORTS:
        stated = re.search(r"`port/%s/`.*?(\d+) files, (\d+) lines" % port, text)
        assert stated and tuple(map(int, stated.groups())) == sensor_table.size_of_port(port), port


# ---- formats ----

def test_formats_table_is_what_the_importers_do(tmp_path):
    """All but MB/s; real files where they are beside the project."""
    import bench_import
    import foreign
    rows = {cells(row)[0]: cells(row) for row in rows_of(ROOT / "host/python/README.md")}
    recording = foreign.recording()
    expected = foreign.expected_seconds(recording)
    for kind, (name, fields, sample, options) in bench_import.FORMATS.items():
        rate, temp = bench_import.round_trip(kind, tmp_path, recording, expected)
        assert rows[name][1:4] == [fields, f"{rate:.1g}", f"{temp:.1g}"], name
        real = bench_import.real(sample, options)
        assert real == "not beside the project" or rows[name][5] == real, name


# ---- make sick ----

def test_healthy_runs_of_the_readme_are_those_that_make_sick_saved():
    from sick import healthy
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    n_runs, n_refused, n_device, n_refused_device = re.search(
        r"Of ([\d,]+) healthy runs \(fifteen kinds,.*?\) (\d+) are refused, of (\d+) in front of the emulated device (\d+) \(HEALTHY", text).groups()
    rows = [cells(row) for row in rows_of(SAVED / "sick.md")][1:]
    on_device = rows.pop()
    assert len(rows) == 8 + len(healthy.OWN) == 15
    assert {row[0] for row in rows} >= {name for name, *_ in healthy.OWN}
    assert int(n_runs.replace(",", "")) == sum(int(row[1]) for row in rows) and int(n_refused) == sum(int(row[2]) for row in rows)
    assert [n_device, n_refused_device] == on_device[1:3]
