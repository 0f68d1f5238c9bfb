# SPDX-License-Identifier: MIT
"""Runs the built `diagnose` on logs alone and measures its time; fits the believed noise as a user does.

Every answer is kept in a file of its own: an interrupted draw goes on where it stopped.
"""
from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor


def abilities(diagnose):
    """What the program's --help offers: {"absent": no model needed, "data_sheet": --arw}."""
    text = subprocess.run([diagnose, "--help"], capture_output=True, text=True, check=False).stdout
    return {"absent": "--arw" in text, "data_sheet": "--arw" in text}


def logs_of(case_dir, role):
    return [os.path.join(case_dir, n) for n in sorted(os.listdir(case_dir)) if n.startswith(role) and n.endswith(".csv")]


def asks_of(case_dir):
    """{k: ask}: what the program is told each time."""
    out = {}
    for name in sorted(os.listdir(case_dir)):
        if name.startswith("ask"):
            with open(os.path.join(case_dir, name), encoding="utf-8") as f:
                out[int(name[3:-5])] = json.load(f)
    return out


def fit_line(errormodel, case_dir, ask, output, detrend="poly:3"):
    return [errormodel, "fit", *logs_of(case_dir, "train"), "--criterion", "ml", "--markov", "1", "--detrend", detrend,
            "-o", output, "--quiet", "--threads", "1"]


def fit_model(errormodel, case_dir, ask):
    """Model fitted to the very logs that hold the cause, with the normalisation of temperature added."""
    path = os.path.join(case_dir, ask["model"])
    if os.path.exists(path):
        return
    run = lambda *how: subprocess.run(fit_line(errormodel, case_dir, ask, path + ".part", *how), capture_output=True, text=True, check=False)
    child = run()
    if "use --detrend mean" in child.stderr:  # constant temperature: a user does what the message says
        child = run("mean")
    if child.returncode not in (0, 1):
        raise RuntimeError(f"errormodel fit {case_dir}: {child.stderr.strip()[-300:]}")
    with open(path + ".part", encoding="utf-8") as f:
        model = json.load(f)
    model["bias"] = {"t0_degc": ask["t0_degc"], "range_degc": ask["range_degc"], "coeff_dph": [0, 0, 0, 0]}
    with open(path + ".part", "w", encoding="utf-8") as out:
        json.dump(model, out)
    os.replace(path + ".part", path)


def command(diagnose, case_dir, ask, result, extra=()):
    """Command line of one question: all it gives away is in the logs and the believed noise."""
    line = [diagnose, *(["--model", os.path.join(case_dir, ask["model"])] if ask["model"] else []), *ask["options"]]
    for role, option in (("train", "--log"), ("hold", "--holdout")):
        for path in logs_of(case_dir, role):
            line += [option, path]
    return [*line, "--json", result, "--quiet", "--threads", "1", *extra]


PATIENCE = 20  # wall time per CPU second allowed: the machine may be shared


def run_one(line, result, cwd, cpu_limit_s):
    """-> {"status", "cpu_s", "wall_s", "rss_mb", "error"}; status is the exit code, -1 on time-out (CPU time)."""
    start = time.monotonic()
    with open(result + ".err", "wb") as err:
        child = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=err, cwd=cwd)
    resource.prlimit(child.pid, resource.RLIMIT_CPU, (int(cpu_limit_s), int(cpu_limit_s) + 5))
    while True:
        pid, status, usage = os.wait4(child.pid, os.WNOHANG)
        if pid:
            break
        if time.monotonic() - start > PATIENCE * cpu_limit_s:
            child.kill()
            pid, status, usage = os.wait4(child.pid, 0)
            child.returncode = -9
            return {"status": -1, "cpu_s": usage.ru_utime + usage.ru_stime, "wall_s": time.monotonic() - start, "rss_mb": None,
                    "error": f"no answer within {PATIENCE * cpu_limit_s:.0f} s"}
        time.sleep(0.005)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode == -signal.SIGXCPU:
        return {"status": -1, "cpu_s": usage.ru_utime + usage.ru_stime, "wall_s": time.monotonic() - start, "rss_mb": None,
                "error": f"no answer within {cpu_limit_s:.0f} s of CPU time"}
    with open(result + ".err", encoding="utf-8", errors="replace") as f:
        text = f.read()
    return {"status": child.returncode, "cpu_s": usage.ru_utime + usage.ru_stime, "wall_s": time.monotonic() - start,
            "rss_mb": usage.ru_maxrss / 1024.0, "error": text[-500:] if child.returncode not in (0, 1) else ""}


def ask_once(tools, case_dir, out_dir, ask, result, extra, cpu_limit_s):
    """Fits the believed noise where it is to be fitted, then diagnoses."""
    failed = {"status": -2, "cpu_s": None, "wall_s": None, "rss_mb": None}
    try:
        if ask["fit"]:
            fit_model(tools["errormodel"], case_dir, ask)
    except (OSError, ValueError, RuntimeError) as problem:
        return {**failed, "error": f"no fitted model: {problem}"}
    answer = run_one(command(tools["diagnose"], case_dir, ask, result, extra), result, out_dir, cpu_limit_s)
    try:
        with open(result, encoding="utf-8") as f:
            answer["diagnosis"] = json.load(f)
    except (OSError, ValueError) as problem:
        answer["error"] = answer["error"] or f"no readable result: {problem}"
    return answer


def run_job(task):
    """One diagnosis; None when the time for the round is over."""
    tools, case_dir, out_dir, key, ask, extra, cpu_limit_s, deadline = task
    if deadline is not None and time.time() > deadline:
        return key, None
    result, record = os.path.join(out_dir, f"{key}.json"), os.path.join(out_dir, f"{key}.answer")
    if os.path.exists(record):  # of an earlier, interrupted round
        with open(record, encoding="utf-8") as f:
            return key, json.load(f)
    answer = ask_once(tools, case_dir, out_dir, ask, result, extra, cpu_limit_s)
    with open(record + ".part", "w", encoding="utf-8") as f:
        json.dump(answer, f)
    os.replace(record + ".part", record)
    return key, answer


def needs(ask):
    """The ability an ask needs of the program, or None."""
    return None if ask["model"] else "data_sheet" if ask["options"] else "absent"


def run_all(tools, logs, out_dir, extra=(), processes=2, cpu_limit_s=300.0, say=None, deadline=None, only=None):
    """All questions of all cases (or those of `only`) in random order -> ({key: answer}, {ability: questions skipped})."""
    os.makedirs(out_dir, exist_ok=True)
    able, skipped, tasks = abilities(tools["diagnose"]), {}, []
    for case in sorted(os.listdir(logs)):
        case_dir = os.path.abspath(os.path.join(logs, case))
        for k, ask in asks_of(case_dir).items():
            if only is not None and f"{case}_{k}" not in only:
                continue
            if needs(ask) and not able[needs(ask)]:
                skipped[needs(ask)] = skipped.get(needs(ask), 0) + 1
                continue
            tasks.append((tools, case_dir, os.path.abspath(out_dir), f"{case}_{k}", ask, list(extra), cpu_limit_s, deadline))
    random.SystemRandom().shuffle(tasks)
    answers = {}
    with ThreadPoolExecutor(processes) as pool:
        for i, (key, answer) in enumerate(pool.map(run_job, tasks)):
            if answer is not None:
                answers[key] = answer
            if say and i % 50 == 49:
                say(f"{i + 1} of {len(tasks)} diagnoses done")
    return answers, skipped
