# SPDX-License-Identifier: MIT
"""The check itself: draw -> seal -> diagnose -> open -> score.  Each step can be taken up again."""
from __future__ import annotations

import json
import os
import secrets
import shutil
import sys
import time
from concurrent.futures import ProcessPoolExecutor

from . import dev, plan, report, runner, score, seal


def say(text):
    print(f"[{time.strftime('%H:%M:%S')}] {text}", file=sys.stderr, flush=True)


def draw(args, seed):
    """Logs of all cases, labels sealed; returns the digest."""
    kinds = args.kinds and args.kinds.split(",")
    specs = plan.make(args.cases, args.gap_free, seed, kinds)
    logs = os.path.join(args.out, "logs")
    for old in (logs, os.path.join(args.out, "results")):
        shutil.rmtree(old, ignore_errors=True)
    os.makedirs(logs)
    tasks = [(seed, i, {**s, **({"seconds": args.seconds} if args.seconds else {})}, logs) for i, s in enumerate(specs)]
    with ProcessPoolExecutor(args.processes) as pool:
        labels = [label for label in pool.map(plan.draw_one, tasks, chunksize=4) if label]
    digest = seal.seal({"seed": seed, "labels": labels, "unreachable": len(tasks) - len(labels)}, os.path.join(args.out, "labels"))
    with open(os.path.join(args.out, "labels.sha256"), "w", encoding="utf-8") as out:
        out.write(digest + "\n")
    say(f"drew {len(labels)} cases; labels sealed: sha256 {digest}")
    return digest


def kept_digest(args):
    with open(os.path.join(args.out, "labels.sha256"), encoding="utf-8") as f:
        return f.read().strip()


def ask(args, program, logs, folder, options, only=None):
    """Diagnoses of all questions that have no answer in the folder yet, with a cache of noise calibrations beside them; -> answers, skipped."""
    results = os.path.join(folder, "results")
    deadline = None if args.minutes is None else time.time() + 60 * args.minutes
    extra = [f"--cache={os.path.abspath(os.path.join(results, 'cache'))}", *options]
    os.makedirs(results, exist_ok=True)
    answers, skipped = runner.run_all({"diagnose": os.path.abspath(program), "errormodel": os.path.abspath(args.errormodel)},
                                      logs, results, extra, args.processes, say=say, deadline=deadline, only=only)
    for ability, n in skipped.items():
        say(f"SKIP: {n} questions with noise '{ability}': this program offers no such option yet")
    with open(os.path.join(folder, "answers.json"), "w", encoding="utf-8") as out:
        json.dump({"answers": answers, "skipped": skipped}, out)
    return answers, skipped


def judge(args, digest):
    """Opens the labels, counts, writes blind.json and blind.md."""
    sealed = seal.unseal(os.path.join(args.out, "labels"), digest)
    with open(os.path.join(args.out, "answers.json"), encoding="utf-8") as f:
        kept = json.load(f)
    labels = {label["case"]: label for label in sealed["labels"]}
    result = score.everything(labels, kept["answers"], args.processes, redraw=not args.no_truth)
    asked = sum(len(label["regimes"]) for label in labels.values())
    meta = {"seed": sealed["seed"], "labels_sha256": digest, "n_cases": len(labels), "n_asked": asked,
            "n_answered": len(kept["answers"]), "skipped": kept["skipped"], "unreachable": sealed["unreachable"], "options": args.option}
    with open(os.path.join(args.out, "blind.json"), "w", encoding="utf-8") as out:
        json.dump({**meta, "score": result, "labels": labels}, out, indent=1, default=float)
    with open(os.path.join(args.out, "questions.txt"), "w", encoding="utf-8") as out:
        out.write("\n".join(score.every_question(labels, kept["answers"])) + "\n")
    page = report.markdown(meta, result)
    with open(os.path.join(args.out, "blind.md"), "w", encoding="utf-8") as out:
        out.write(page)
    print(page)
    print(f"seed {sealed['seed']}: repeat with `make blind BLIND_SEED={sealed['seed']}`")


def is_there(tool):
    if os.path.isfile(tool) and os.access(tool, os.X_OK):
        return True
    print(f"blind: {tool}: no such program: build it with `make`, or name another one", file=sys.stderr)
    return False


def main(args):
    steps = args.steps.split(",")
    if "run" in steps and not all(is_there(tool) for tool in (args.diagnose, args.errormodel)):
        return 2
    os.makedirs(args.out, exist_ok=True)
    resumed = args.resume and os.path.exists(os.path.join(args.out, "labels.sha256"))
    if "draw" in steps and not resumed:
        seed = args.seed if args.seed is not None else secrets.randbits(60) + dev.DEVELOPMENT_SEEDS
        digest = draw(args, seed)
    else:
        digest = kept_digest(args)
    if "run" in steps:
        ask(args, args.diagnose, os.path.join(args.out, "logs"), args.out, args.option)
    if "score" in steps:
        judge(args, digest)
        if not args.keep_logs:
            shutil.rmtree(os.path.join(args.out, "logs"), ignore_errors=True)
    return 0
