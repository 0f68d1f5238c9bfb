# SPDX-License-Identifier: MIT
"""Development cases with open labels: for whoever works on the engine.  Seeds below 1000 are kept for this."""
from __future__ import annotations

import json
import os
import shlex
import sys
from concurrent.futures import ProcessPoolExecutor

from . import plan, runner

DEVELOPMENT_SEEDS = 1000  # judging draws never take a seed below this


def short(label):
    """One line that says what is in a case."""
    d = ", ".join(f"{a}: {'+'.join(n)} d={'/'.join('-' if v is None else f'{v:.0f}' for v in label['d'].get(a, []))}"
                  for a, n in label["truth"].items() if n)
    told = [t for v in label["told"].values() for t in v if t]
    hint = "" if not told or "sibling" not in told[0] else (
        f" | tells member {told[0]['can_tell_member']}, family {told[0]['can_tell_family']} (nearest {told[0]['sibling']} "
        f"{told[0]['rho2_sibling']:.2f}, {told[0]['other']} {told[0]['rho2_other']:.2f}; d over slow noise {told[0]['d_noise']:.0f})")
    return (f"{label['case']} {label['kind']}: {d or 'no gap'} | {label['profile']}, {label['n_train']}+{label['n_hold']} runs, "
            f"{label['n_axes']} axes | {','.join(label['regimes'])}{hint}")


def write_extras(folder, label, tools):
    """label.json, run<k>.sh (one command for each believed noise), models fitted to the logs."""
    case_dir = os.path.join(folder, label["case"])
    with open(os.path.join(case_dir, "label.json"), "w", encoding="utf-8") as out:
        json.dump(label, out, indent=1, default=float)
    for k, ask in runner.asks_of(case_dir).items():
        if ask["fit"]:
            try:
                runner.fit_model(tools["errormodel"], case_dir, ask)
            except (OSError, RuntimeError) as problem:
                print(f"{label['case']}: no fitted model: {problem}", file=sys.stderr)
        line = runner.command("${DIAGNOSE:-build/bin/diagnose}", os.path.abspath(case_dir), ask, "-")
        with open(os.path.join(case_dir, f"run{k}_{label['regimes'][k]}.sh"), "w", encoding="utf-8") as out:
            out.write(line[0] + " " + shlex.join(line[1:]) + ' "$@"\n')


def main(args):
    if not 0 <= args.seed < DEVELOPMENT_SEEDS:
        print(f"blind dev: seed {args.seed}: development seeds are 0 to {DEVELOPMENT_SEEDS - 1}; others judge", file=sys.stderr)
        return 2
    specs = plan.make(max(args.cases * 2 // 3, 1), args.cases // 3, args.seed, args.kinds and args.kinds.split(","))
    if args.names:
        specs = [s for s in specs if set(s.get("names", [])) & set(args.names.split(","))]
    tasks = [(args.seed, i, s, args.out) for i, s in enumerate(specs[: args.cases])]
    os.makedirs(args.out, exist_ok=True)
    with ProcessPoolExecutor(args.processes) as pool, open(os.path.join(args.out, "index.txt"), "w", encoding="utf-8") as index:
        for label in pool.map(plan.draw_one, tasks):
            if label is None:
                continue
            write_extras(args.out, label, {"errormodel": args.errormodel})
            print(short(label), file=index, flush=True)
            print(short(label), flush=True)
    print(f"{args.out}/<case>/: logs, model<k>.json, label.json, run<k>_<regime>.sh (DIAGNOSE=path sh run0_*.sh); list in index.txt")
    return 0
