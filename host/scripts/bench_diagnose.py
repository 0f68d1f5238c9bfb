# SPDX-License-Identifier: MIT
"""Time and memory of `diagnose` on simulated logs of one axis: by kind of gap, by length, with and without the threshold of
names in the cache.  CPU seconds of one thread.  --count also runs the first cases under callgrind, whose instruction counts do
not depend on what else the machine does; --before FOLDER shows the programs of another build beside."""
import argparse
import json
import re
import statistics
import subprocess
import tempfile
from pathlib import Path

MODEL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}],
         "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 300, 150, -100]}}
EFFECTS = {
    "no gap": [],
    "hysteresis": [{"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 40, "width_degc": 5}}],
    "random walk": [{"name": "rate_random_walk", "parameters": {"k_dph_per_rt_s": 0.9}}],
    "lag": [{"name": "thermal_lag", "parameters": {"tau_s": 400}}],
    "creep": [{"name": "thermal_creep", "parameters": {"amplitude_dph_per_degc": 3, "tau_first_s": 300, "tau_last_s": 6000}}],
    "anomaly": [{"name": "thermal_anomaly", "parameters": {"amplitude_dph": 120, "center_degc": 25, "width_degc": 5}}],
    "jump at a temperature": [{"name": "thermal_step", "parameters": {"amplitude_dph": 120, "temp_degc": 35, "width_degc": 4}}],
    "warm-up": [{"name": "warm_up", "parameters": {"amplitude_dph": 150, "tau_s": 600}}],
    "run to run": [{"name": "run_to_run", "parameters": {"sigma_dph": 60}}],
    "second Markov process": [{"name": "second_markov", "parameters": {"sigma_dph": 40, "tau_s": 900}}],
    "telegraph noise": [{"name": "telegraph_noise", "parameters": {"amplitude_dph": 60, "tau_s": 200}}],
    "tone": [{"name": "sinusoid", "parameters": {"amplitude_dph": 30, "frequency_hz": 0.11}}],
}
CYCLE = (1200, 60 / 100)  # s of each soak, degC/min: up once in 140 min
LONG_CYCLE = (1800, 0.5)


def profile(cycles, soak_s, rate_degc_min, returns):
    segments = []
    for _ in range(cycles):
        segments += [{"rate_degc_per_min": 0, "duration_s": soak_s}, {"rate_degc_per_min": rate_degc_min, "to_degc": 60},
                     {"rate_degc_per_min": 0, "duration_s": soak_s}]
        segments += [{"rate_degc_per_min": -rate_degc_min, "to_degc": 0}] if returns else []
    return {"imucal_profile": 1, "start_degc": 0, "segments": segments}


SHORT, DAY, LONG = profile(1, *CYCLE, False), profile(5, *LONG_CYCLE, True), profile(50, 2800, 0.5, True)


def simulate(folder, programs, name, runs, on, gap):
    """Logs of one case: their paths."""
    (folder / "profile.json").write_text(json.dumps(on))
    (folder / "effects.json").write_text(json.dumps(EFFECTS[gap]))
    logs = []
    for i in range(runs):
        logs.append(str(folder / f"{name}-{i}.csv"))
        subprocess.run([programs / "gyrosim", "log", "--model", folder / "model.json", "--profile", folder / "profile.json",
                        "--effects", folder / "effects.json", "--seed", "1", "--log-index", str(i), "--n-logs", str(runs), "-q",
                        "-o", logs[-1]], check=True)
    return logs


def measure(command):
    """CPU seconds and largest memory [MB] of a command, by a process of its own."""
    code = ("import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True); "
            "u = resource.getrusage(resource.RUSAGE_CHILDREN); print(u.ru_utime + u.ru_stime, u.ru_maxrss / 1024)")
    out = subprocess.run(["python3", "-c", code, *map(str, command)], check=True, capture_output=True, text=True).stdout
    return tuple(float(x) for x in out.split())


def instructions(command, folder):
    """Executed instructions [1e9], of what callgrind takes for the processor (AVX2)."""
    err = subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/callgrind.out", *map(str, command)],
                         check=True, capture_output=True, text=True).stderr
    return int(re.search(r"refs:\s+([\d,]+)", err).group(1).replace(",", "")) / 1e9


def row(folder, builds, logs, what, cached, counted):
    """One line of the table, a figure per build; returns the CPU seconds of the last."""
    cells, seconds = [], 0.0
    for programs in builds:
        cache = ["--cache", str(folder / f"cache-{builds.index(programs)}")] if cached else ["--no-cache"]
        command = [programs / "diagnose", "--model", folder / "model.json", "--log", *logs, "--threads", "1", *cache, "-q"]
        if cached:
            subprocess.run(command, check=True)
        seconds, memory = measure(command)
        count = f"{instructions(command, folder):.2f}" if counted else "-"
        cells.append((count, f"{seconds:.2f}", f"{memory:.0f}"))
    print("| " + " | ".join([what] + [", ".join(column) for column in zip(*cells)]) + " |", flush=True)
    return seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bin", type=Path, default=Path("build/bin"))
    parser.add_argument("--before", type=Path, help="folder of programs of another build, shown first")
    parser.add_argument("--count", action="store_true", help="instructions of the first three cases, by callgrind")
    parser.add_argument("--long", action="store_true", help="logs of 25 h and of a million seconds too")
    options = parser.parse_args()
    builds = ([options.before] if options.before else []) + [options.bin]
    print("| case, one axis | 1e9 instructions | CPU s | largest memory MB |\n| --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "model.json").write_text(json.dumps(MODEL))
        logs = simulate(folder, options.bin, "none", 4, SHORT, "no gap")
        row(folder, builds, logs, "4 x 140 min, no gap, threshold in the cache", True, options.count)
        row(folder, builds, logs, "the same, threshold drawn anew", False, options.count)
        seconds = []
        for gap in list(EFFECTS)[1:]:
            logs = simulate(folder, options.bin, "gap", 4, SHORT, gap)
            seconds.append(row(folder, builds, logs, f"4 x 140 min, {gap}", True, options.count and gap == "hysteresis"))
        if options.long:
            row(folder, builds, simulate(folder, options.bin, "day", 2, DAY, "hysteresis"), "2 x 25 h, hysteresis", False, False)
            row(folder, builds, simulate(folder, options.bin, "long", 1, LONG, "no gap"), "1e6 s, no gap", False, False)
            row(folder, builds, simulate(folder, options.bin, "long", 1, LONG, "hysteresis"), "1e6 s, hysteresis", False, False)
    print(f"\nwith a gap: median {statistics.median(seconds):.2f} s, largest {max(seconds):.2f} s")


if __name__ == "__main__":
    main()
