# SPDX-License-Identifier: MIT
"""python -m blind: draw, seal, diagnose, open, score.  `--help` lists the options."""
from __future__ import annotations

import argparse
import json
import os
import secrets
import shutil
import sys
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from . import coverage, draw, report, runner, score


def arguments(argv):
    p = argparse.ArgumentParser(prog="blind", description="Blind check of diagnose on fresh simulated cases.")
    p.add_argument("--diagnose", default="build/bin/diagnose", help="the program under test")
    p.add_argument("--out", default="build/blind", help="folder for logs, sealed labels, results and report")
    p.add_argument("--cases", type=int, default=400, help="about how many cases with an effect")
    p.add_argument("--gap-free", type=int, default=300, help="how many cases without")
    p.add_argument("--seed", type=int, default=None, help="repeat a draw (default: operating-system entropy)")
    p.add_argument("--seconds", type=float, default=8400.0, help="length of a run")
    p.add_argument("--processes", type=int, default=2)
    p.add_argument("--steps", default="draw,run,score", help="which steps; later ones use what earlier ones left in --out")
    p.add_argument("--groups", default=None, help="only these campaign groups (comma-separated), for development")
    p.add_argument("--option", action="append", default=[], help="further option for diagnose, e.g. --option=--nulls=100")
    p.add_argument("--no-withheld", action="store_true", help="skip the runs with --without and the 5 %% runs")
    p.add_argument("--resume", action="store_true", help="keep the diagnoses of an interrupted run of the same program")
    p.add_argument("--minutes", type=float, default=None,
                   help="time for the diagnoses; half of it for the blind part; a random sample is left undone and reported")
    p.add_argument("--keep-logs", action="store_true", help="keep the logs after scoring")
    return p.parse_args(argv)


def say(text):
    print(f"[{time.strftime('%H:%M:%S')}] {text}", file=sys.stderr, flush=True)


def plan_of(recipe):
    """Plans of a draw from what the sealed labels keep of it."""
    groups = draw.GROUPS
    if recipe["groups"]:
        groups = tuple(g for g in groups if g[0] in recipe["groups"].split(","))
    return draw.make_plan(recipe["cases"], recipe["gap_free"], np.random.SeedSequence(recipe["seed"]), groups,
                          recipe["seconds"])


def do_draw(args, seed):
    recipe = {"seed": seed, "cases": args.cases, "gap_free": args.gap_free, "groups": args.groups,
              "seconds": args.seconds}
    plans = plan_of(recipe)
    logs = os.path.join(args.out, "logs")
    shutil.rmtree(logs, ignore_errors=True)
    os.makedirs(logs)
    drawn = []
    plans.sort(key=lambda p: -len(p.jobs))
    with ProcessPoolExecutor(args.processes) as pool:
        for part in pool.map(draw.draw_cases, plans, [logs] * len(plans)):
            say(f"drew {len(part['labels'])} cases on profiles '{part['family']}' ({part['unreachable']} redrawn: no sensible "
                "amplitude has that strength there)")
            drawn.append(part)
    digest = draw.seal({"seed": seed, "recipe": recipe, "groups": drawn}, os.path.join(args.out, "labels"))
    with open(os.path.join(args.out, "labels.sha256"), "w", encoding="utf-8") as out:
        out.write(digest + "\n")
    say(f"labels sealed: sha256 {digest}")
    return digest


def second_round(sealed, option, answers):
    """Runs that need the label, in two parts: gap-free cases (those the time limit left out, 5 %, fitted noise said to be
    fitted), then the true effect withheld."""
    gap_free, withheld = {}, {}
    for part in sealed["groups"]:
        quiet, cut = gap_free.setdefault(part["group_id"], []), withheld.setdefault(part["group_id"], [])
        fitted = [] if all(label["noise_known"] for label in part["labels"]) else [
            f"--model-seconds={4 * sealed['recipe']['seconds']:.0f}"]
        for label in part["labels"]:
            case = label["case"]
            if label["kind"] == "single" and label["target"] >= 10:
                cut.append((case, "@w", option + ["--without", label["effects"][0]["name"]]))
            if label["kind"] == "no_gap":
                if case not in answers:
                    quiet.append((case, "", option))
                quiet.append((case, "@5", option + ["--false-alarm-rate", "0.05", *fitted]))
                if fitted:
                    quiet.append((case, "@m", option + fitted))
    return gap_free, withheld


def do_run(args, digest):
    logs, results = os.path.join(args.out, "logs"), os.path.join(args.out, "results")
    if not args.resume:
        shutil.rmtree(results, ignore_errors=True)
    os.makedirs(results, exist_ok=True)
    start = time.time()
    until = lambda share: None if args.minutes is None else start + 60 * share * args.minutes
    option = [f"--cache={os.path.abspath(os.path.join(results, 'cache'))}", *args.option]
    answers = runner.run_all(args.diagnose, logs, results, runner.blind_jobs(logs, option), args.processes, progress=say,
                             deadline=until(0.5))
    say("blind part done; opening the labels")
    sealed = draw.open_sealed(os.path.join(args.out, "labels"), digest)
    if not args.no_withheld:
        for jobs, share in zip(second_round(sealed, option, answers), (0.8, 1.0)):
            answers.update(runner.run_all(args.diagnose, logs, results, jobs, args.processes, progress=say,
                                          deadline=until(share)))
    with open(os.path.join(args.out, "answers.json"), "w", encoding="utf-8") as out:
        json.dump(answers, out)


def do_score(args, digest):
    sealed = draw.open_sealed(os.path.join(args.out, "labels"), digest)
    labels = {label["case"]: label for part in sealed["groups"] for label in part["labels"]}
    with open(os.path.join(args.out, "answers.json"), encoding="utf-8") as f:
        answers = json.load(f)
    drawn = len(labels)
    labels = {c: label for c, label in labels.items() if c in answers}
    result = score.everything(labels, answers)
    logs = os.path.join(args.out, "logs")
    if os.path.isdir(logs):
        wanted = {label["group"] for label in labels.values() if label["kind"] == "single"}
        groups = {p.name: draw.draw_group_of(p)[:2] for p in plan_of(sealed["recipe"]) if p.name in wanted}
        result["interval"], result["interval_by_case"] = coverage.interval_coverage(groups, labels, answers, logs, sealed["seed"])
    n_gap_free = sum(l["kind"] == "no_gap" for l in labels.values())
    meta = {"seed": sealed["seed"], "labels_sha256": digest, "n_cases": len(labels), "n_gap_free": n_gap_free,
            "n_effect": len(labels) - n_gap_free, "n_runs": len(answers), "n_not_reached": drawn - len(labels), "options": args.option}
    with open(os.path.join(args.out, "blind.json"), "w", encoding="utf-8") as out:
        json.dump({**meta, "score": result, "labels": labels}, out, indent=1)
    page = report.markdown(meta, result)
    with open(os.path.join(args.out, "blind.md"), "w", encoding="utf-8") as out:
        out.write(page)
    print(page)
    print(f"seed {sealed['seed']}: repeat with `make blind BLIND_SEED={sealed['seed']}`")
    return result


def main(argv=None):
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    args = arguments(argv)
    steps = args.steps.split(",")
    if "run" in steps and not os.access(args.diagnose, os.X_OK):
        print(f"blind: {args.diagnose}: no such program: build it with `make` or give --diagnose", file=sys.stderr)
        return 2
    os.makedirs(args.out, exist_ok=True)
    if "draw" in steps:
        digest = do_draw(args, args.seed if args.seed is not None else secrets.randbits(64))
    else:
        with open(os.path.join(args.out, "labels.sha256"), encoding="utf-8") as f:
            digest = f.read().strip()
    if "run" in steps:
        do_run(args, digest)
    if "score" in steps:
        do_score(args, digest)
        if not args.keep_logs:
            shutil.rmtree(os.path.join(args.out, "logs"), ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
