#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Spread a Monte Carlo campaign over machines with Dask: shards of `montecarlo`, merged by `montecarlo merge`.

    build/venv/bin/python host/scripts/montecarlo_dask.py --runs 4000 --shards 16 --json result.json -- \\
        --model MODEL.json --profile PROFILE.json --order 3 --seed 1

Without --scheduler a cluster of processes on this machine is started; with --scheduler tcp://HOST:8786 that one is
used.  Input files travel with the tasks; the program itself must be on the workers (--program, a path there).  The
result is bit for bit that of one `montecarlo` call with the same seed and --runs, however it is cut.
Exit status as montecarlo: 0 done, 1 negative answer, 2 usage, 3 bad data, 4 the cluster failed."""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

FILE_OPTIONS = ("--model", "--profile", "--filter-model", "--effects")
OWN_OPTIONS = ("--runs", "--first-run", "--partial", "--threads", "--json")


class ShardFailed(Exception):
    """A shard's program ended with an error; code is its exit status."""

    def __init__(self, message, code):
        super().__init__(message, code)
        self.message, self.code = message, code


def cut(n_runs, n_shards):
    """Ranges (first, runs) that cover n_runs in at most n_shards pieces of nearly equal size."""
    n_shards = max(1, min(n_shards, n_runs))
    ends = [n_runs * i // n_shards for i in range(n_shards + 1)]
    return [(first, end - first) for first, end in zip(ends, ends[1:])]


def portable(arguments):
    """Arguments of montecarlo with the files they name replaced by their contents: [(argument, contents or None)]."""
    out, is_file = [], False
    for argument in arguments:
        name, _, value = argument.partition("=")
        if is_file:
            out.append((Path(argument).name, Path(argument).read_text()))
        elif name in FILE_OPTIONS and value:
            out += [(name, None), (Path(value).name, Path(value).read_text())]
        else:
            out.append((argument, None))
        is_file = argument in FILE_OPTIONS
    return out


def run_shard(program, arguments, first, runs):
    """On a worker: run one shard in a folder of its own, return its partial result as text."""
    with tempfile.TemporaryDirectory(prefix="imucal_shard_") as folder:
        command = [program]
        for i, (argument, contents) in enumerate(arguments):
            if contents is not None:
                path = Path(folder) / f"{i}_{argument}"
                path.write_text(contents)
                argument = str(path)
            command.append(argument)
        partial = Path(folder) / "partial.json"
        command += ["--first-run", str(first), "--runs", str(runs), "--threads", "1", "--quiet",
                    "--partial", str(partial)]
        try:
            done = subprocess.run(command, capture_output=True, text=True)
        except OSError as error:
            raise ShardFailed(f"{program}: {error.strerror} on this worker; give its path there with --program", 4)
        if not partial.exists():
            raise ShardFailed(done.stderr.strip() or f"{program} ended with {done.returncode}", done.returncode)
        return partial.read_text()


def collect(client, program, arguments, shards, say):
    """Run the shards on a Dask client; the partial results in the order they come.  Stops at Ctrl-C with what is
    done."""
    from dask.distributed import as_completed

    futures = [client.submit(run_shard, program, arguments, first, runs, pure=False, retries=1)
               for first, runs in shards]
    done = []
    try:
        for future in as_completed(futures):
            done.append(future.result())
            say(f"\r{len(done)} of {len(shards)} shards")
    except KeyboardInterrupt:
        say("\nstopped: merging what is done\n")
        client.cancel(futures)
    return done


def merge(program, partials, options):
    with tempfile.TemporaryDirectory(prefix="imucal_merge_") as folder:
        paths = []
        for i, text in enumerate(partials):
            paths.append(str(Path(folder) / f"shard{i}.json"))
            Path(paths[-1]).write_text(text)
        return subprocess.run([program, "merge", *paths, *options]).returncode


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0], formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, required=True, help="simulated tests in all")
    parser.add_argument("--shards", type=int, default=0, help="pieces to cut them into (default: four per worker)")
    parser.add_argument("--scheduler", help="address of a Dask scheduler (default: a cluster on this machine)")
    parser.add_argument("--timeout-s", type=float, default=15, help="how long to wait for the scheduler")
    parser.add_argument("--workers", type=int, default=0, help="processes of the local cluster (default: one per core)")
    parser.add_argument("--program", default=str(Path(__file__).resolve().parents[2] / "build/bin/montecarlo"),
                        help="the program montecarlo, as the workers see it")
    parser.add_argument("--json", help="write the merged result (- for standard output)")
    parser.add_argument("--quiet", action="store_true")
    parser.add_argument("arguments", nargs="*", help="-- then the arguments of montecarlo")
    options = parser.parse_args()
    for argument in options.arguments:
        if argument.partition("=")[0] in OWN_OPTIONS:
            parser.error(f"{argument}: belongs before the --")
    if options.runs < 1:
        parser.error("--runs must be at least 1")
    try:
        arguments = portable(options.arguments)
    except OSError as error:
        print(f"montecarlo_dask: {error.filename}: {error.strerror}", file=sys.stderr)
        return 3
    from dask.distributed import Client, LocalCluster

    def say(text):
        if not options.quiet and sys.stderr.isatty():
            print(text, end="", file=sys.stderr, flush=True)

    cluster = None
    try:
        if options.scheduler:
            client = Client(options.scheduler, timeout=options.timeout_s)
        else:
            cluster = LocalCluster(n_workers=options.workers or None, threads_per_worker=1, dashboard_address=None)
            client = Client(cluster)
        with client:
            n_workers = max(1, len(client.scheduler_info()["workers"]))
            partials = collect(client, options.program, arguments, cut(options.runs, options.shards or 4 * n_workers), say)
    except ShardFailed as error:
        print(f"montecarlo_dask: {error.message}", file=sys.stderr)
        return error.code
    except OSError as error:
        print(f"montecarlo_dask: {options.scheduler or 'local cluster'}: {error}; is the scheduler running?",
              file=sys.stderr)
        return 4
    finally:
        if cluster is not None:
            cluster.close()
    if not partials:
        print("montecarlo_dask: nothing was done", file=sys.stderr)
        return 4
    say("\r\033[K")
    extra = (["--json", options.json] if options.json else []) + (["--quiet"] if options.quiet else [])
    return merge(options.program, partials, extra)


if __name__ == "__main__":
    sys.exit(main())
