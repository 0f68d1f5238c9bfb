# SPDX-License-Identifier: MIT
"""Command lines of the blind check."""
from __future__ import annotations

import argparse

from . import check, compare, confusions, dev


def tools(p):
    p.add_argument("--errormodel", default="build/bin/errormodel", help="fits the self-fitted noise models")
    p.add_argument("--processes", type=int, default=2)
    p.add_argument("--kinds", default=None, help="only these kinds: single,memory,invariance,pair,outside,healthy,pooled,"
                   "structural,beside,constant,no_gap")


def arguments(argv):
    p = argparse.ArgumentParser(prog="blind", description="Blind check of diagnose on fresh simulated devices.")
    sub = p.add_subparsers(dest="what", required=True)
    d = sub.add_parser("dev", help="write development cases with open labels")
    d.add_argument("--out", required=True, help="folder for the cases")
    d.add_argument("--cases", type=int, default=30)
    d.add_argument("--seed", type=int, default=1, help="0 to 999")
    d.add_argument("--names", default=None, help="only cases planned with one of these causes")
    tools(d)
    c = sub.add_parser("check", help="draw, seal, diagnose, open, score")
    c.add_argument("--diagnose", default="build/bin/diagnose", help="the program under test")
    c.add_argument("--out", default="build/blind", help="folder for logs, sealed labels, results and report")
    c.add_argument("--cases", type=int, default=400, help="about how many cases with an effect")
    c.add_argument("--gap-free", type=int, default=300, help="how many cases without")
    c.add_argument("--seed", type=int, default=None, help="repeat a draw (default: operating-system entropy)")
    c.add_argument("--seconds", type=float, default=None, help="length of all runs (default: drawn, 5000 to 9000)")
    c.add_argument("--steps", default="draw,run,score", help="which steps; later ones use what earlier ones left in --out")
    c.add_argument("--option", action="append", default=[], help="further option for diagnose, e.g. --option=--nulls=100")
    c.add_argument("--resume", action="store_true", help="go on with an interrupted draw: keep its logs and answers")
    c.add_argument("--minutes", type=float, default=None, help="time for the diagnoses; a random sample is left undone and reported")
    c.add_argument("--no-truth", action="store_true", help="skip the true held-out reduction (needs every case drawn again)")
    c.add_argument("--keep-logs", action="store_true", help="keep the logs after scoring")
    tools(c)
    b = sub.add_parser("compare", help="ask another build of diagnose the questions of a kept draw (after check --keep-logs)")
    b.add_argument("--out", required=True, help="folder of the draw, with its logs and answers")
    b.add_argument("--before", required=True, help="the other program")
    b.add_argument("--before-out", default=None, help="folder for its answers, kept and gone on with (default: OUT/before)")
    b.add_argument("--minutes", type=float, default=None, help="time for its diagnoses; a random sample is left undone and reported")
    b.add_argument("--no-truth", action="store_true", help="skip the true held-out reduction (needs every case drawn again)")
    tools(b)
    w = sub.add_parser("confusions", help="why answers of a development draw fell short (after check --keep-logs)")
    w.add_argument("--out", required=True, help="folder of the draw")
    w.add_argument("--oracle", default="build/bench/oracle", help="the program told the true causes")
    w.add_argument("--processes", type=int, default=1)
    return p.parse_args(argv)


def main(argv=None):
    args = arguments(argv)
    return {"dev": dev, "check": check, "compare": compare, "confusions": confusions}[args.what].main(args)
