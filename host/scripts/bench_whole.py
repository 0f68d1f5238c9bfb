#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Times whole commands where people wait, beside what a user of numpy and allantools types for the same result.

Processor times of whole processes (user and system, their start included), one thread against one, the least of several
repeats.  Prints one row for each work, with the limit that this machine sets where one is known.  No row can fail: times
are for people; the values are compared by tests and by bench_dp.py.
"""
import argparse
import json
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

PEER = """
import json, sys
import numpy as np, allantools
table = np.loadtxt(sys.argv[1], delimiter=",", skiprows=2)
taus = np.asarray(json.loads(sys.argv[2]))
for column in (2, 3, 4):
    rate = table[:, column]
    allantools.oadev(rate - rate.mean(), rate=1.0, data_type="freq", taus=taus)
"""


def cost(command, repeats):
    """Least processor time of a command, in s."""
    times = []
    for _ in range(repeats):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env={**os.environ, "OMP_NUM_THREADS": "1"})
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(times)


def markov(rng, n, dt_s, sigma_dph, tau_s):
    """A first-order Markov process from one filter of scipy."""
    import numpy as np
    from scipy.signal import lfilter
    phi = np.exp(-dt_s / tau_s)
    drive = sigma_dph * np.sqrt(1 - phi * phi) * rng.standard_normal(n)
    drive[0] = sigma_dph * rng.standard_normal()
    return lfilter([1], [1, -phi], drive)


def write_log(*log):
    """In a process of its own: what Linux says of a child's memory starts with the most that its parent ever held."""
    writer = multiprocessing.get_context("fork").Process(target=make_log, args=log)
    writer.start()
    writer.join()
    if writer.exitcode != 0:
        sys.exit(f"{log[0]} was not written")


def make_log(path, n, dt_s, axes, white_dph, seed):
    """A log of white noise and a Markov process, its temperature a slow wave."""
    import numpy as np
    rng = np.random.default_rng(seed)
    t_s = dt_s * np.arange(1, n + 1)
    columns = [t_s, 20 + 15 * np.sin(2 * np.pi * np.arange(n) / n)]
    columns += [white_dph * rng.standard_normal(n) + markov(rng, n, dt_s, 20.0, 100.0) for _ in axes]
    with open(path, "w") as out:
        out.write("# imucal-log = 1\nt_s,temp_degc," + ",".join(axes) + "\n")
        np.savetxt(out, np.column_stack(columns), fmt=["%.2f", "%.3f"] + ["%.4f"] * len(axes), delimiter=",")


def row(work, now_s, beside_s=None, limit="", target=""):
    ratio = f"{beside_s / now_s:6.1f} x" if beside_s else "       -"
    print(f"{work:58s} {'' if beside_s is None else f'{beside_s:8.3f} s':>10s} {now_s:8.3f} s {ratio}   {target:14s} {limit}", flush=True)


def reading(build, log, repeats):
    found = json.loads(subprocess.run([f"{build}/tests/bench_log", log, str(repeats)], check=True, capture_output=True, text=True).stdout)
    limit = f"the bytes once, lines counted: {found['count_lines_s']:.3f} s"
    row(f"read {found['rows']:.0e} rows x 5 columns", found["read_log_s"], None, limit, "<= 0.15 s")
    row("the same onto an even grid (dp, errormodel)", found["load_series_s"], None, limit)


def dp(build, log, repeats):
    command = [f"{build}/bin/dp", log, "--quiet", "--threads", "1"]
    for tau, name, target in (([], "20 taus per decade", ">= 4 x"), (["--tau", "octave"], "octaves", "")):
        result = json.loads(subprocess.run([*command, *tau, "--json", "-"], check=True, capture_output=True, text=True).stdout)
        peer = cost([sys.executable, "-c", PEER, log, json.dumps(result["curves"][0]["tau_s"])], repeats)
        row(f"dp, 3 axes, {name}: with ratios and intervals", cost(command + tau, repeats), peer, target=target)


def memory(build, log, n_rows):
    """Most memory that dp holds, over that of the three series."""
    for threads in (1, 2):
        process = subprocess.Popen([f"{build}/bin/dp", log, "--quiet", "--threads", str(threads)], stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        if status != 0:
            sys.exit(f"dp ended with status {status}")
        print(f"dp, 3 axes, {threads} thread{'s' * (threads > 1)}: {usage.ru_maxrss / 1000:.0f} MB, {usage.ru_maxrss * 1024 / (24 * n_rows):.1f} times the series")


def scaling(build, folder, repeats):
    """Growth exponents of dp: the power of length, taus, axes, logs and threads that its time grows with, between two sizes."""
    import math
    base = [f"{build}/bin/dp", "--quiet"]

    def exponent(name, few, many, commands):
        times = [cost([*base, *command, *([] if "--threads" in command else ["--threads", "1"])], repeats) for command in commands]
        print(f"dp: processor time grows with {name}^{math.log(times[1] / times[0], many / few):.2f} ({few} to {many}: {times[0]:.2f} s to {times[1]:.2f} s)", flush=True)

    short, long, three = (f"{folder}/{name}.csv" for name in ("short", "length", "three"))
    write_log(short, 250_000, 1.0, ["gx_dph"], 36.0, 2)
    write_log(long, 1_000_000, 1.0, ["gx_dph"], 36.0, 2)
    write_log(three, 250_000, 1.0, ["gx_dph", "gy_dph", "gz_dph"], 36.0, 2)
    taus = ["--tau", "log:1:20000:20"]
    exponent("length", 250_000, 1_000_000, [[short, *taus], [long, *taus]])
    exponent("taus", 40, 160, [[long, "--tau", f"log:64:100000:{k}"] for k in (40, 160)])
    exponent("axes", 1, 3, [[three, *taus, "--axis", "gx_dph"], [three, *taus]])
    exponent("logs", 1, 4, [[short, *taus], [*[short] * 4, *taus]])
    exponent("threads", 1, 2, [[three, *taus, "--threads", str(k)] for k in (1, 2)])


def errormodel(build, folder, data, repeats):
    command = [f"{build}/bin/errormodel", "fit", "--markov", "1", "--quiet", "--threads", "1"]
    write_log(f"{folder}/test.csv", 8400, 1.0, ["gx_dph"], 36.0, 3)
    row("errormodel fit, 140 min, poly:3, 40 refits", cost([*command, f"{folder}/test.csv", "--detrend", "poly:3"], repeats), target="< 0.5 s")
    write_log(f"{folder}/fast.csv", 720_000, 0.01, ["gx_dph"], 300.0, 4)
    for detrend in ("mean", "poly:3"):
        row(f"errormodel fit, 2 h at 100 Hz, {detrend}, 40 refits", cost([*command, f"{folder}/fast.csv", "--detrend", detrend], 1), target="< 2 s")
    logs = [str(Path(data) / f"cats_p{k}.csv") for k in (1, 2)]
    if all(Path(log).exists() for log in logs):
        row("errormodel fit, two 25-h logs x 3 axes, 40 refits", cost([*command, *logs], 1), target="< 20 s")
    else:
        print(f"the two 25-h logs are not in {data}: left out")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", default="build")
    parser.add_argument("--data", default="../shared/data")
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", choices=["reading", "dp", "scaling", "errormodel"])
    args = parser.parse_args()
    print(f"{'work':58s} {'beside':>10s} {'now':>10s} {'ratio':>8s}   {'aim':14s} limit")
    with tempfile.TemporaryDirectory() as folder:
        log = f"{folder}/long.csv"
        if args.only in (None, "reading", "dp"):
            write_log(log, args.rows, 1.0, ["gx_dph", "gy_dph", "gz_dph"], 36.0, 1)
        if args.only in (None, "reading"):
            reading(args.build, log, args.repeats)
        if args.only in (None, "dp"):
            dp(args.build, log, args.repeats)
            memory(args.build, log, args.rows)
        if args.only in (None, "scaling"):
            scaling(args.build, folder, args.repeats)
        if args.only in (None, "errormodel"):
            errormodel(args.build, folder, args.data, args.repeats)
    return 0


if __name__ == "__main__":
    sys.exit(main())
