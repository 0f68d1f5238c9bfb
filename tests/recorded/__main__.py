# SPDX-License-Identifier: MIT
"""python -m recorded: diagnose the recorded logs under several believed noises and print the table of expectations.

Exit status: 0 every row holds (or the data is missing, said loudly), 1 rows fail, 2 usage.
"""
import argparse
import json
import os
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from blind import runner

from . import judge, table


def read(path):
    """Column names and values of a log (empty fields: nan)."""
    with open(path, encoding="utf-8") as f:
        rows = [line.strip() for line in f if not line.startswith("#")]
    values = [[float(v) if v else np.nan for v in r.split(",")] for r in rows[1:]]
    return rows[0].split(","), np.array(values)


def white_arw(paths):
    """ARW [deg/sqrt(h)] from the median difference of neighbouring seconds, all axes and logs."""
    steps = [np.abs(np.diff(values[:, 2:], axis=0)).ravel() for _, values in map(read, paths)]
    return float(1.4826 * np.median(np.concatenate(steps)) / np.sqrt(2) / 60)


def span(paths):
    """t0 and half range of the temperatures; (25, 50) where a log has none."""
    temps = np.concatenate([values[:, 1] for _, values in map(read, paths)])
    if np.all(np.isnan(temps)):
        return 25.0, 50.0
    low, high = np.nanmin(temps), np.nanmax(temps)
    return float((low + high) / 2), float((high - low) / 2 + 0.1)


def believed_models(paths, folder, errormodel):
    """{name: model file}: four fixed noises, and one fitted to the very logs."""
    t0, half = span(paths)
    bias = {"t0_degc": t0, "range_degc": half, "coeff_dph": [0, 0, 0, 0]}
    out = {}
    for sigma, tau in table.BELIEVED:
        path = os.path.join(folder, f"model_{sigma:.0f}_{tau:.0f}.json")
        with open(path, "w", encoding="utf-8") as f:
            json.dump({"imucal_model": 1, "arw_deg_rt_h": round(white_arw(paths), 4), "turn_on_sigma_dph": 0, "bias": bias,
                       "markov": [{"sigma_dph": sigma, "tau_s": tau}]}, f)
        out[f"{sigma:.0f} dph, {tau:.0f} s"] = path
    path = os.path.join(folder, "model_fitted.json")
    detrend = "poly:3" if half != 50.0 else "mean"
    line = [errormodel, "fit", *paths, "--criterion", "ml", "--markov", "1", "--detrend", detrend, "-o", path, "--quiet"]
    fitted = runner.run_one(line, path + ".log", folder, 600)
    if fitted["status"] in (0, 1) and os.path.exists(path):
        with open(path, encoding="utf-8") as f:
            model = json.load(f)
        with open(path, "w", encoding="utf-8") as f:
            json.dump({**model, "bias": bias}, f)
        out["fitted"] = path
    else:
        print(f"SKIP: no noise fitted to {', '.join(map(os.path.basename, paths))}: {fitted['error']}", file=sys.stderr)
    return out


def answers_of(args, logs):
    """{believed noise: answer} of one set of logs; None for the model where the program needs none."""
    folder = os.path.join(args.out, "+".join(os.path.splitext(n)[0] for n in logs))
    os.makedirs(folder, exist_ok=True)
    paths = [os.path.abspath(os.path.join(args.data, n)) for n in logs]
    models = {} if args.quick else believed_models(paths, folder, os.path.abspath(args.errormodel))
    if runner.abilities(args.diagnose)["absent"]:
        models["none"] = None

    def ask(item):
        name, model = item
        result = os.path.join(folder, f"{name.replace(' ', '').replace(',', '_')}.json")
        line = [os.path.abspath(args.diagnose), *(["--model", model] if model else [])]
        for p in paths:
            line += ["--log", p]
        line += ["--json", result, "--quiet", "--threads", "1", f"--cache={os.path.abspath(os.path.join(args.out, 'cache'))}"]
        if os.path.exists(result):
            os.remove(result)
        answer = runner.run_one(line, result, folder, args.cpu_limit_s)
        if os.path.exists(result):
            with open(result, encoding="utf-8") as f:
                answer["diagnosis"] = json.load(f)
        return name, answer

    with ThreadPoolExecutor(args.processes) as pool:
        return dict(pool.map(ask, models.items()))


def print_row(result):
    print(f"{'holds' if result['holds'] else 'FAILS'}  {result['row']:<14} {result['axis']:<7} {result['sees']}")
    for noise, text in result["got"].items():
        complaint = "; ".join(result["complaints"].get(noise, []))
        print(f"         {noise:<17} said {text}{'   <- ' + complaint if complaint else ''}")
    for complaint in result["complaints"].get("all", []):
        print(f"         all               <- {complaint}")


def arguments(argv):
    p = argparse.ArgumentParser(prog="recorded", description="Recorded logs: what must be said of them and what must not.")
    p.add_argument("--diagnose", default="build/bin/diagnose")
    p.add_argument("--errormodel", default="build/bin/errormodel")
    p.add_argument("--data", default=os.environ.get("IMUCAL_DATA", "../shared/data"), help="folder of the recorded logs")
    p.add_argument("--out", default="build/recorded")
    p.add_argument("--rows", default=None, help="only rows that begin with this")
    p.add_argument("--quick", action="store_true", help="only without any believed noise")
    p.add_argument("--processes", type=int, default=2)
    p.add_argument("--cpu-limit-s", type=float, default=600)
    return p.parse_args(argv)


def run(args):
    """Judged rows; rows whose logs are missing are left out, loudly."""
    rows = [r for r in table.ROWS if args.rows is None or r.row.startswith(args.rows)]
    results, seconds = [], {}
    for logs in dict.fromkeys(r.logs for r in rows):
        missing = [n for n in logs if not os.path.exists(os.path.join(args.data, n))]
        if missing:
            print(f"SKIP: {args.data}/{missing[0]} is missing: {sum(r.logs == logs for r in rows)} rows are not judged", file=sys.stderr)
            continue
        answers = answers_of(args, logs)
        seconds["+".join(logs)] = {k: a["cpu_s"] for k, a in answers.items()}
        results += [judge.judge(r, answers) for r in rows if r.logs == logs]
    return results, seconds


def main(argv=None):
    args = arguments(argv)
    for tool in (args.diagnose, args.errormodel):
        if not os.access(tool, os.X_OK):
            print(f"recorded: {tool}: no such program: build it with `make`", file=sys.stderr)
            return 2
    if not any(args.rows is None or r.row.startswith(args.rows) for r in table.ROWS):
        print(f"recorded: --rows {args.rows}: no row begins so; rows: {', '.join(r.row for r in table.ROWS)}", file=sys.stderr)
        return 2
    args.out = os.path.abspath(args.out)  # the programs run in folders of their own
    os.makedirs(args.out, exist_ok=True)
    results, seconds = run(args)
    for result in results:
        print_row(result)
    with open(os.path.join(args.out, "recorded.json"), "w", encoding="utf-8") as out:
        json.dump({"rows": results, "cpu_s": seconds}, out, indent=1)
    failed = [r["row"] for r in results if not r["holds"]]
    print(f"recorded: {len(results) - len(failed)} of {len(results)} rows hold" + (f"; fail: {', '.join(failed)}" if failed else ""))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
