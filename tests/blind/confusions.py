# SPDX-License-Identifier: MIT
"""Why an answer fell short: for every single and pair that was not named, the best hypothesis with exactly the true causes
(`oracle` of tests/bench) against what the search chose and what was said.

search:   the true causes are more likely than what the search chose: it did not come to them
rule:     the search chose them, and a rule after it took a name away or opened it to its family
evidence: the logs themselves prefer something else, or nothing, to the true causes in the library's shape
seconds:  the cause is one of the seconds (tones, fast noise) or jumps; block means do not decide on it
"""
from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from . import causes, dev, runner, score, seal

NOT_SLOW = ("sinusoid", "bias_step", "outliers", "white_noise_vs_temperature", "telegraph_noise", "noise_parameters", "run_to_run")
MARGIN_NATS = 1.0  # polishing stops within this


def questions(labels, answers):
    """(label, axis, k, regime, read) of singles of d >= 10 and pairs whose names are not all said."""
    for label, axis, k, regime, answer in score.questions(labels, answers, ("single", "memory", "invariance", "pair")):
        want, read = label["truth"][axis], score.reading(answer, axis, regime)
        if label["kind"] == "pair":
            right = set(want) <= set(read["names"])
        else:
            if want[0] in causes.SLOW and not read["names"]:
                read = score.reading(answer, axis, regime, keep_tuning=True)
            right = label["target"] < 10 or score.outcome(read, want[0], label["told"][axis][0]) in score.RIGHT
        if not right:
            yield label, axis, k, regime, read


def ask(args, label, axis, k, folder):
    """What the oracle says of one question."""
    case_dir = os.path.abspath(os.path.join(args.out, "logs", label["case"]))
    asked = runner.asks_of(case_dir)[k]
    line = runner.command(os.path.abspath(args.oracle), case_dir, asked, "-")
    drop = {"--json", "-", "--quiet", "--threads", "1"}
    line = [line[0], axis, "+".join(label["truth"][axis])] + [x for x in line[1:] if x not in drop] + ["--cache", folder]
    child = subprocess.run(line, capture_output=True, text=True, check=False)
    if child.returncode:
        return {"failed": child.stderr.strip()[-200:]}
    return json.loads(child.stdout)


def names_of(model):
    """Names, kinds of noise and jumps of a hypothesis."""
    names = [n["name"] for n in model["names"]] + ([model["noise"]] if model["noise"] else [])
    return names + (["bias_step"] if model["steps"] else [])


def rule_of(found, want):
    """Which rule kept the true names from the answer, though the search chose them."""
    dropped = [e["name"] for e in found["dropped"]]
    lost = [w for w in want if w not in [e["name"] for e in found["effects"]]]
    if any(w in dropped for w in lost):
        return "held-out"
    opened = {1: "member open", 2: "shape open", 3: "slow noise would do"}
    for e in found["effects"]:
        if e["doubt"] in opened and (e["member"] in lost or score.is_family(e["name"])):
            return opened[e["doubt"]]
    if not set(lost) <= set(names_of(found["kept"])):
        return "all logs together"
    return "stand-in"


def reason(found, want):
    """(class, detail) of one question."""
    if "failed" in found or "refused" in found:
        return "failed", found.get("failed", found.get("refused"))
    searched, oracle = found["searched"], found["oracle"]
    if set(want) <= set(names_of(searched)):
        return "rule", rule_of(found, want)
    if any(w in NOT_SLOW for w in want) or oracle is None:
        return "seconds", "+".join(names_of(searched)) or "nothing"
    margin = oracle["score_nats"] - searched["score_nats"]
    against = "+".join(names_of(searched)) or "nothing"
    if margin > MARGIN_NATS:
        return "search", f"{margin:.0f} nats over {against}"
    return "evidence", f"{-margin:.1f} nats behind {against}"


def row_of(label, axis, k, regime, read, found):
    want = label["truth"][axis]
    kind, detail = reason(found, want)
    said = "+".join(read["names"]) or read["verdict"]
    told = label["told"][axis][0]
    return {"case": f"{label['case']}_{k}", "kind": label["kind"], "truth": "+".join(want), "d": label["target"], "regime": regime,
            "profile": f"{label['profile']} {label['n_train']}+{label['n_hold']}", "said": said, "class": kind, "detail": detail,
            "tells_member": told.get("can_tell_member", True), "found": found}


def table(rows, n_asked):
    """Counts by kind and class, then every question."""
    kinds = ("search", "rule", "evidence", "seconds", "failed")
    lines = ["| asked | not named | " + " | ".join(kinds) + " |", "| --- |" * 1 + " --- |" * (len(kinds) + 1)]
    for kind, n in n_asked.items():
        part = [r for r in rows if r["group"] == kind]
        lines.append(f"| {kind}: {n} | {len(part)} | " + " | ".join(str(sum(r["class"] == c for r in part)) for c in kinds) + " |")
    lines += ["", "| there | d | logs | said | why | |", "| --- | --- | --- | --- | --- | --- |"]
    for r in sorted(rows, key=lambda r: (r["class"], r["detail"])):
        lines.append(f"| {r['truth']} | {r['d']} | {r['profile']}, {r['regime']} | {r['said']} | {r['class']} | {r['detail']} |")
    return "\n".join(lines)


def group(label):
    return "pairs" if label["kind"] == "pair" else "one cause, d = 10" if label["target"] == 10 else "one cause, d >= 20"


def main(args):
    sealed = seal.unseal(os.path.join(args.out, "labels"))
    if not 0 <= sealed["seed"] < dev.DEVELOPMENT_SEEDS:
        print(f"blind confusions: seed {sealed['seed']} judges: only seeds below {dev.DEVELOPMENT_SEEDS} may be looked at", file=sys.stderr)
        return 2
    with open(os.path.join(args.out, "answers.json"), encoding="utf-8") as f:
        answers = json.load(f)["answers"]
    labels = {label["case"]: label for label in sealed["labels"]}
    n_asked = {}
    for label, *_ in score.questions(labels, answers, ("single", "memory", "invariance", "pair")):
        if label["target"] >= 10:
            n_asked[group(label)] = n_asked.get(group(label), 0) + 1
    tasks = list(questions(labels, answers))
    folder = os.path.abspath(os.path.join(args.out, "results", "cache"))
    with ThreadPoolExecutor(args.processes) as pool:
        found = list(pool.map(lambda t: ask(args, t[0], t[1], t[2], folder), tasks))
    rows = [{**row_of(*task, one), "group": group(task[0])} for task, one in zip(tasks, found)]
    with open(os.path.join(args.out, "confusions.json"), "w", encoding="utf-8") as out:
        json.dump(rows, out, indent=1)
    print(table(rows, n_asked))
    return 0
