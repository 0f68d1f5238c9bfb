# SPDX-License-Identifier: MIT
"""Time and memory of `diagnose` on simulated logs: by runs, by length, by kind of gap.  CPU seconds of one thread, the
calibration of the nulls taken from the cache."""
import argparse
import json
import resource
import subprocess
import tempfile
from pathlib import Path

MODEL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}],
         "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 300, 150, -100]}}
EFFECTS = {
    "no gap": [],
    "hysteresis": [{"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 40, "width_degc": 5}}],
    "random walk": [{"name": "rate_random_walk", "parameters": {"k_dph_per_rt_s": 0.9}}],
}


def profile(seconds):
    rate = 60 / (seconds - 2400) * 60
    return {"imucal_profile": 1, "start_degc": 0, "segments": [
        {"rate_degc_per_min": 0, "duration_s": 1200}, {"rate_degc_per_min": rate, "to_degc": 60},
        {"rate_degc_per_min": 0, "duration_s": 1200}]}


def cpu_seconds(command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bin", type=Path, default=Path("build/bin"))
    options = parser.parse_args()
    print("diagnose, one axis, one thread, nulls from the cache")
    print(f"{'runs':>5} {'seconds each':>13}  {'gap':<12} {'CPU s':>7} {'largest memory MB':>18}")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / "model.json").write_text(json.dumps(MODEL))
        for runs, seconds, gap in [(4, 8400, "no gap"), (4, 8400, "hysteresis"), (4, 8400, "random walk"),
                                   (2, 8400, "no gap"), (8, 8400, "no gap"), (4, 16800, "no gap")]:
            (folder / "profile.json").write_text(json.dumps(profile(seconds)))
            (folder / "effects.json").write_text(json.dumps(EFFECTS[gap]))
            logs = []
            for i in range(runs):
                logs.append(str(folder / f"run{i}.csv"))
                subprocess.run([options.bin / "gyrosim", "log", "--model", folder / "model.json", "--profile",
                                folder / "profile.json", "--effects", folder / "effects.json", "--seed", "1",
                                "--log-index", str(i), "--n-logs", str(runs), "-q", "-o", logs[-1]], check=True)
            command = [options.bin / "diagnose", "--model", folder / "model.json", "--log", *logs, "--threads", "1",
                       "--nulls", "50", "--cache", str(folder / "cache"), "-q"]
            subprocess.run(command, check=True)
            took = cpu_seconds(command)
            memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
            print(f"{runs:>5} {seconds:>13}  {gap:<12} {took:>7.2f} {memory:>18.0f}")


if __name__ == "__main__":
    main()
