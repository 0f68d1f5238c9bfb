# SPDX-License-Identifier: MIT
"""Two programs on the questions of a kept draw (`python -m blind compare`): nothing changes against itself, counts known by hand, refusals."""
import json
import os
import shutil
import sys

import pytest

from blind import causes, intervals, seal
from blind.command import main
from where import BIN

TOOLS = {name: str(BIN / name) for name in ("diagnose", "errormodel")}

# A program that says of each case (the folder of its logs) what a table holds, and notes that it was asked.
STAND_IN = """#!{python}
import json, os, sys
a = sys.argv
if "--help" in a:
    print("--model")
    sys.exit(0)
case = os.path.basename(os.path.dirname(a[a.index("--log") + 1]))
open({asked!r}, "a").write(case + "\\n")
json.dump(json.load(open({table!r}))[case], open(a[a.index("--json") + 1], "w"))
"""


def diagnosis(verdict, *names):
    effects = [{"name": n, "parameters": {}, "evidence_nats": 9, "set": [{"name": n}]} for n in names]
    return {"axes": [{"axis": "gx_dph", "verdict": verdict, "where": None, "effects": effects, "gap": {}, "advice": []}]}


def label(case, kind, names, d=20, regime="exact"):
    return {"case": case, "kind": kind, "truth": {"gx_dph": names}, "sick": ["gx_dph"] if names else [], "regimes": [regime], "target": d,
            "told": {"gx_dph": [{"can_tell_member": True, "can_tell_family": True}] * len(names)}, "d": {"gx_dph": [d] * len(names)},
            "n_axes": 1, "n_train": 4, "profile": "mixed", "causes": {"gx_dph": [{"name": n, "p": {}} for n in names]}, "beside": None,
            "families": {"gx_dph": [[causes.FAMILY_OF.get(n)] for n in names]}, "noise": {"markov": [(20.0, 100.0)]}}


RIGHT, WRONG, OPEN = ("explained", "rate_ramp"), ("explained", "warm_up"), ("unexplained",)
QUESTIONS = (  # case, kind, truth, said before, said now
    [(f"both{i}", "single", ["rate_ramp"], RIGHT, RIGHT) for i in range(3)] + [("lost", "single", ["rate_ramp"], RIGHT, WRONG)]
    + [(f"won{i}", "single", ["rate_ramp"], WRONG, RIGHT) for i in range(7)] + [("none", "single", ["rate_ramp"], WRONG, OPEN)]
    + [("pair", "pair", ["rate_ramp", "outliers"], RIGHT, ("explained", "outliers", "rate_ramp")),
       ("outside", "outside", ["ageing_slope"], OPEN, ("explained", "thermal_creep")),
       ("same", "outside", ["ageing_slope"], OPEN, OPEN), ("gap0", "no_gap", [], WRONG, ("no_gap",)), ("gap1", "no_gap", [], ("no_gap",), ("no_gap",))])


@pytest.fixture
def draw(tmp_path):
    """A kept draw made by hand, and the program before it."""
    out, table = tmp_path / "out", tmp_path / "table.json"
    answers = {}
    for case, _, _, _, now in QUESTIONS:
        (out / "logs" / case).mkdir(parents=True)
        (out / "logs" / case / "train0.csv").write_text("t_s\n")
        (out / "logs" / case / "model0.json").write_text("{}")
        (out / "logs" / case / "ask0.json").write_text(json.dumps({"options": [], "fit": False, "model": "model0.json"}))
        answers[f"{case}_0"] = {"status": 0, "cpu_s": 0.5, "rss_mb": 20, "error": "", "diagnosis": diagnosis(*now)}
    digest = seal.seal({"seed": 3, "labels": [label(case, kind, names) for case, kind, names, _, _ in QUESTIONS]}, str(out / "labels"))
    (out / "labels.sha256").write_text(digest + "\n")
    (out / "answers.json").write_text(json.dumps({"answers": answers, "skipped": {}}))
    table.write_text(json.dumps({case: diagnosis(*before) for case, _, _, before, _ in QUESTIONS}))
    program = tmp_path / "diagnose"
    program.write_text(STAND_IN.format(python=sys.executable, asked=str(tmp_path / "asked"), table=str(table)))
    program.chmod(0o755)
    return tmp_path


def line(folder, *more):
    program = str(folder / "diagnose")
    return ["compare", "--out", str(folder / "out"), "--before", program, "--errormodel", program, "--no-truth", *more]


def rows_of(page):
    return [[c.strip() for c in row.strip("|").split("|")] for row in page.splitlines() if row.startswith("|")]


def in_summary(page, first):
    """What stands behind the first cell of the one row of the summary that begins so."""
    (found,) = [row[1:] for row in rows_of(page.split("## Question by question")[0]) if row[0] == first]
    return found


def paired(page, first):
    """The same of the paired counts: n, both, only before, only now, neither, p."""
    (found,) = [row[1:] for row in rows_of(page.split("## Question by question")[1]) if row[0] == first]
    return found


def changed(page):
    return [row for row in page.splitlines() if row.startswith("- ")]


def test_counts_known_by_hand(draw, capsys):
    assert main(line(draw)) == 0
    page = capsys.readouterr().out
    assert paired(page, "one cause, d = 20: named first") == ["12", "3", "1", "7", "1", "0.0703"]  # 2 (C(8,0) + C(8,1)) / 2^8
    assert paired(page, "pairs: both as members") == ["1", "0", "0", "1", "0", "1"]
    assert paired(page, "outside causes, d = 20: abstains or right family only") == ["2", "1", "1", "0", "0", "1"]
    assert paired(page, "no gap: no name") == ["2", "1", "0", "1", "0", "1"]
    before, now, aim = in_summary(page, "one cause, d ≥ 20, named first (member, or family where the profile cannot tell)")
    assert ("(4/12)" in before, "(10/12)" in now, aim) == (True, True, "≥ 0.95")
    rows = {row.split()[1].split("_")[0]: row for row in changed(page)}
    assert set(rows) == {"lost", "none", "pair", "outside", "gap0"} | {f"won{i}" for i in range(7)} and len(changed(page)) == len(rows)
    assert rows["lost"].endswith("single rate_ramp d=20 mixed 4 logs, exact: before: explained: rate_ramp [rate_ramp] | now: explained: "
                                 "warm_up [warm_up] (only before right)")
    assert rows["won3"].endswith("(only now right)") and rows["none"].endswith("now: unexplained: no name")
    assert (draw / "out/before/compare.md").read_text() in page


def test_kinds_are_chosen_and_answers_are_not_asked_again(draw, capsys):
    assert main(line(draw, "--kinds", "no_gap")) == 0
    assert sorted((draw / "asked").read_text().split()) == ["gap0", "gap1"] and "one cause, d = 20" not in capsys.readouterr().out
    (draw / "out/before/results/gap1_0.answer").unlink()
    assert main(line(draw)) == 0
    asked = (draw / "asked").read_text().split()[2:]
    assert sorted(asked) == sorted(case for case, *_ in QUESTIONS if case != "gap0")


def test_logs_without_a_fitted_model_stay_failed_for_both(draw, capsys):
    kept = json.loads((draw / "out/answers.json").read_text())
    kept["answers"]["both0_0"] = {"status": -2, "cpu_s": None, "rss_mb": None, "error": "no fitted model"}
    (draw / "out/answers.json").write_text(json.dumps(kept))
    assert main(line(draw)) == 0
    page = capsys.readouterr().out
    assert "both0" not in (draw / "asked").read_text()
    assert paired(page, "one cause, d = 20: named first") == ["12", "2", "1", "7", "2", "0.0703"]
    assert in_summary(page, "questions without an answer") == ["1", "1", ""]


def other_labels(draw):
    seal.seal({"seed": 4, "labels": []}, str(draw / "out/labels"))


def other_logs(draw):
    (draw / "out/logs/won3").rename(draw / "out/logs/c0000")


def other_draw_asked(draw):
    assert main(line(draw, "--kinds", "no_gap")) == 0
    kept = seal.unseal(str(draw / "out/labels"))
    (draw / "out/labels.sha256").write_text(seal.seal(kept, str(draw / "out/labels")) + "\n")


def other_program_asked(draw):
    assert main(line(draw, "--kinds", "no_gap")) == 0
    (draw / "diagnose").write_text((draw / "diagnose").read_text() + "# another build\n")


@pytest.mark.parametrize("spoil, says", [
    (lambda d: shutil.rmtree(d / "out/logs"), "no kept logs"), (other_labels, "changed after sealing"), (other_logs, "not the logs of this draw"),
    (lambda d: (d / "out/answers.json").unlink(), "no draw with labels and answers"), (lambda d: (d / "diagnose").unlink(), "no such program"),
    (lambda d: shutil.rmtree(d / "out"), "no kept logs"), (other_draw_asked, "answers of another draw"),
    (other_program_asked, "answers of another program")])
def test_what_is_no_kept_draw_is_refused(draw, capsys, spoil, says):
    spoil(draw)
    (draw / "asked").unlink(missing_ok=True)
    assert main(line(draw)) == 2
    assert says in capsys.readouterr().err and not (draw / "asked").exists()


@pytest.mark.parametrize("more, says", [(["--kinds", "singles"], "the kinds are single,"), (["--before-out", "out"], "the answers to compare with")])
def test_unsuitable_options_are_refused(draw, capsys, monkeypatch, more, says):
    monkeypatch.chdir(draw)
    assert main(line(draw, *more)) == 2
    assert says in capsys.readouterr().err and not (draw / "asked").exists()


@pytest.mark.parametrize("lost, won, p", [(0, 0, 1.0), (3, 3, 1.0), (0, 5, 2 / 32), (7, 1, 2 * 9 / 256), (2, 10, 2 * (1 + 12 + 66) / 4096)])
def test_paired_test_is_that_of_tossed_coins(lost, won, p):
    assert intervals.paired_p(lost, won) == pytest.approx(p)


def test_the_built_program_says_the_same_twice(tmp_path, capsys):
    for path in TOOLS.values():
        if not os.access(path, os.X_OK):
            pytest.skip(f"SKIP: {path} is not built: run make")
    out, tools = str(tmp_path / "out"), ["--errormodel", TOOLS["errormodel"], "--no-truth"]
    assert main(["check", "--diagnose", TOOLS["diagnose"], "--out", out, "--cases", "6", "--gap-free", "2", "--seed", "985", "--seconds", "1500",
                 "--kinds", "single,outside,healthy,no_gap", "--keep-logs", *tools]) == 0
    capsys.readouterr()
    assert main(["compare", "--out", out, "--before", TOOLS["diagnose"], *tools]) == 0
    page = capsys.readouterr().out
    assert changed(page) == [] and "## Names or verdict changed: 0\n\nNone.\n" in page
    rows = rows_of(page.split("## Question by question")[1])[2:]
    assert sum(int(row[1]) for row in rows) >= 6
    for _, n, both, lost, won, neither, p in rows:
        assert (lost, won, p) == ("0", "0", "1") and int(both) + int(neither) == int(n) > 0
