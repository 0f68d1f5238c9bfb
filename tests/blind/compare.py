# SPDX-License-Identifier: MIT
"""Another build of `diagnose` on the very questions of a kept draw: both programs side by side, and question by question.

The program gets the logs alone, as in the check; its answers have a folder and a cache of their own.  The labels must be
those whose digest was printed.  What is right is what score.py says.
"""
from __future__ import annotations

import hashlib
import json
import os
import sys

from . import check, plan, report, score, seal
from .intervals import paired_p

NO_FITTED_MODEL = -2  # status of an answer that ended before the program was asked


class Refused(Exception):
    """What is given is no kept draw, or not the one that was asked before."""


def load(path):
    with open(path, encoding="utf-8") as f:
        return json.load(f)


def digest_of(path):
    with open(path, "rb") as f:
        return hashlib.sha256(f.read()).hexdigest()


# ---- what is kept -----------------------------------------------------------------------------------------

def kept_draw(args):
    """{"digest", "seed", "labels", "answers", "options"} of the draw, of the wanted kinds."""
    logs = os.path.join(args.out, "logs")
    if not os.path.isdir(logs):
        raise Refused(f"{logs}: no kept logs: draw with `check --keep-logs` (make blind BLIND_ARGS=--keep-logs)")
    try:
        digest = check.kept_digest(args)
        sealed = seal.unseal(os.path.join(args.out, "labels"), digest)
        answers = load(os.path.join(args.out, "answers.json"))["answers"]
    except (OSError, ValueError, KeyError) as problem:
        raise Refused(f"{args.out}: no draw with labels and answers: {problem}") from problem
    kinds = args.kinds.split(",") if args.kinds else plan.KINDS
    if not set(kinds) <= set(plan.KINDS):
        raise Refused(f"--kinds {args.kinds}: the kinds are {','.join(plan.KINDS)}")
    labels = {label["case"]: label for label in sealed["labels"] if label["kind"] in kinds}
    answers = {key: answer for key, answer in answers.items() if key.rsplit("_", 1)[0] in labels}
    lost = [key for key in answers if not os.path.exists(os.path.join(logs, key.rsplit("_", 1)[0], f"ask{key.rsplit('_', 1)[1]}.json"))]
    if lost:
        raise Refused(f"{logs}: no logs for {len(lost)} of {len(answers)} questions, {lost[0]} among them: these are not the logs of this draw")
    if not answers:
        raise Refused(f"{args.out}: no answered question of these kinds")
    summary = os.path.join(args.out, "blind.json")
    return {"digest": digest, "seed": sealed["seed"], "labels": labels, "answers": answers,
            "options": load(summary)["options"] if os.path.exists(summary) else []}


def claim_folder(args, digest):
    """Folder of the other program's answers; refused where it holds those of another draw or of a third program."""
    folder = args.before_out or os.path.join(args.out, "before")
    if os.path.realpath(folder) == os.path.realpath(args.out):
        raise Refused(f"--before-out {folder}: there are the answers to compare with")
    mark, own = os.path.join(folder, "asked.json"), {"labels_sha256": digest, "program_sha256": digest_of(args.before)}
    if os.path.exists(mark):
        for key, value in load(mark).items():
            if own[key] != value:
                what = "draw" if key == "labels_sha256" else "program"
                raise Refused(f"{folder}: holds answers of another {what} ({value[:12]}…): name another folder with --before-out")
    elif os.path.exists(os.path.join(folder, "results")):
        raise Refused(f"{folder}: holds answers of an unknown program: name another folder with --before-out")
    os.makedirs(folder, exist_ok=True)
    with open(mark, "w", encoding="utf-8") as out:
        json.dump(own, out)
    return folder


# ---- side by side -----------------------------------------------------------------------------------------

def pairing(labels, before, now):
    """[(kind of question, n, both, only before, only now, neither, p)]"""
    rows, old = [], score.rights(labels, before)
    for kind, new in score.rights(labels, now).items():
        count = lambda b, n: sum(old[kind][key] == b and new[key] == n for key in new)
        lost, won = count(True, False), count(False, True)
        rows.append((kind, len(new), count(True, True), lost, won, count(False, False), paired_p(lost, won)))
    return rows


def turned(labels, before, now):
    """{question: "only now right" or "only before right"}"""
    out, old = {}, score.rights(labels, before)
    for kind, new in score.rights(labels, now).items():
        out.update({key: "only now right" if new[key] else "only before right" for key in new if new[key] != old[kind][key]})
    return out


def changes(labels, before, now):
    """A line for every question and axis whose names or verdict changed."""
    lines, mark = [], turned(labels, before, now)
    for label in labels.values():
        for k, regime in enumerate(label["regimes"]):
            for axis in label["truth"] if f"{label['case']}_{k}" in now else ():
                answers = [side[f"{label['case']}_{k}"] for side in (before, now)]
                old, new = (score.reading(a, axis, regime, keep_tuning=True) for a in answers)
                if (old["verdict"], old["names"]) != (new["verdict"], new["names"]):
                    key = score.key_of(label, k, axis)
                    lines.append((score.there(label, axis, regime), f"- {key} {score.there(label, axis, regime)}: before: "
                                  f"{score.said(answers[0], axis, regime)} | now: {score.said(answers[1], axis, regime)}"
                                  + (f" ({mark[key]})" if key in mark else "")))
    return [line for _, line in sorted(lines)]


def summary(old, new):
    """Each line of the report's summary with both figures."""
    rows = [[b[0], b[1], n[1], b[2]] for b, n in zip(report.must_show(old), report.must_show(new), strict=True)]
    return rows + [["questions without an answer", len(old["failures"]), len(new["failures"]), ""]]


def markdown(meta, labels, before, now, processes, redraw):
    """The page; both sides hold answers to the same questions."""
    old, new = (score.everything(labels, side, processes, redraw=redraw) for side in (before, now))
    out = ["# The same questions to two programs", "", meta, "", *report.table(("what it must show", "before", "now", "aim"), summary(old, new))]
    out += ["## Question by question", "", "p: exact two-sided McNemar test on the questions that only one of the two has right.", ""]
    out += report.table(("questions", "n", "right with both", "only before", "only now", "with neither", "p"),
                        [[*row[:-1], f"{row[-1]:.3g}"] for row in pairing(labels, before, now)])
    lines = changes(labels, before, now)
    return "\n".join(out + [f"## Names or verdict changed: {len(lines)}", "", *(lines or ["None."])]) + "\n"


def compare(args):
    draw = kept_draw(args)
    folder = claim_folder(args, draw["digest"])
    unfitted = {key: answer for key, answer in draw["answers"].items() if answer["status"] == NO_FITTED_MODEL}
    before, skipped = check.ask(args, args.before, os.path.join(args.out, "logs"), folder, draw["options"], set(draw["answers"]) - set(unfitted))
    before.update(unfitted)  # the believed noise is part of the question
    now = {key: answer for key, answer in draw["answers"].items() if key in before}
    meta = (f"Before: `{args.before}` (sha256 `{digest_of(args.before)[:12]}`). Now: the answers kept in `{args.out}`. {len(now)} of "
            f"{len(draw['answers'])} questions answered by both" + "".join(f"; {n} skipped: no option for noise '{k}'" for k, n in skipped.items())
            + f"; seed `{draw['seed']}`, labels sealed as sha256 `{draw['digest']}`. Intervals: 95 % Clopper-Pearson.")
    page = markdown(meta, draw["labels"], before, now, args.processes, not args.no_truth)
    with open(os.path.join(folder, "compare.md"), "w", encoding="utf-8") as out:
        out.write(page)
    print(page)


def main(args):
    if not all(check.is_there(tool) for tool in (args.before, args.errormodel)):
        return 2
    try:
        compare(args)
    except Refused as problem:
        print(f"blind compare: {problem}", file=sys.stderr)
        return 2
    return 0
