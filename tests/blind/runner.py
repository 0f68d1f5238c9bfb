# SPDX-License-Identifier: MIT
"""Runs the built `diagnose` on logs alone and measures its time."""
from __future__ import annotations

import json
import os
import random
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor


def command(diagnose, case_dir, result, extra=()):
    """Command line for one case: everything it gives away is in the log files and the believed model."""
    files = sorted(os.listdir(case_dir))
    line = [diagnose, "--model", os.path.join(case_dir, "model.json")]
    for name in files:
        if name.endswith(".csv"):
            line += ["--log" if name.startswith("train") else "--holdout", os.path.join(case_dir, name)]
    return line + ["--json", result, "--quiet", "--threads", "1", *extra]


def run_one(line, result, cwd, timeout_s):
    """-> {"status", "cpu_s", "wall_s", "error"}; status is the exit code, -1 on time-out."""
    start = time.monotonic()
    with open(result + ".err", "wb") as err:
        child = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=err, cwd=cwd)
    deadline = start + timeout_s
    while True:
        pid, status, usage = os.wait4(child.pid, os.WNOHANG)
        if pid:
            break
        if time.monotonic() > deadline:
            child.kill()
            pid, status, usage = os.wait4(child.pid, 0)
            child.returncode = -9
            return {"status": -1, "cpu_s": usage.ru_utime + usage.ru_stime, "wall_s": time.monotonic() - start,
                    "error": f"no answer within {timeout_s:.0f} s"}
        time.sleep(0.005)
    child.returncode = os.waitstatus_to_exitcode(status)
    with open(result + ".err", encoding="utf-8", errors="replace") as f:
        text = f.read()
    return {"status": child.returncode, "cpu_s": usage.ru_utime + usage.ru_stime,
            "wall_s": time.monotonic() - start, "rss_mb": usage.ru_maxrss / 1024.0,
            "error": text[-500:] if child.returncode not in (0, 1) else ""}


def run_job(task):
    """One diagnosis; None when the time for the round is over."""
    diagnose, case_dir, out_dir, case, tag, extra, timeout_s, deadline = task
    if deadline is not None and time.time() > deadline:
        return case + tag, None
    result = os.path.join(out_dir, f"{case}{tag}.json")
    record = os.path.join(out_dir, f"{case}{tag}.answer")
    if os.path.exists(record):  # of an earlier, interrupted round
        with open(record, encoding="utf-8") as f:
            return case + tag, json.load(f)
    answer = run_one(command(diagnose, case_dir, result, extra), result, out_dir, timeout_s)
    try:
        with open(result, encoding="utf-8") as f:
            answer["diagnosis"] = json.load(f)
    except (OSError, ValueError) as problem:
        answer["error"] = answer["error"] or f"no readable result: {problem}"
    with open(record + ".part", "w", encoding="utf-8") as f:
        json.dump(answer, f)
    os.replace(record + ".part", record)
    return case + tag, answer


def run_all(diagnose, logs, out_dir, jobs_by_group, processes=2, timeout_s=900.0, progress=None, deadline=None):
    """jobs_by_group: {group id: [(case id, tag, [extra options]), …]} -> {case id + tag: answer}.

    One call per group goes first, so that its calibration is in the cache for the rest; the rest goes in random
    order, so that what a deadline (time.time()) leaves undone is a random sample and not the hard cases.
    """
    os.makedirs(out_dir, exist_ok=True)
    diagnose, out_dir = os.path.abspath(diagnose), os.path.abspath(out_dir)
    first, rest = [], []
    for group, jobs in jobs_by_group.items():
        tasks = [(diagnose, os.path.abspath(os.path.join(logs, group, case)), out_dir, case, tag, extra, timeout_s, deadline)
                 for case, tag, extra in jobs]
        first += tasks[:1]
        rest += tasks[1:]
    random.SystemRandom().shuffle(rest)
    answers = {}
    with ThreadPoolExecutor(processes) as pool:
        for tasks in (first, rest):
            for i, (name, answer) in enumerate(pool.map(run_job, tasks)):
                if answer is not None:
                    answers[name] = answer
                if progress and i % 50 == 49:
                    progress(f"{len(answers)} diagnoses done")
    return answers


def blind_jobs(logs, extra=()):
    """Every case of the log folder, known by its name only."""
    return {g: [(c, "", list(extra)) for c in sorted(os.listdir(os.path.join(logs, g)))]
            for g in sorted(os.listdir(logs))}
