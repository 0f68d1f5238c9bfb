# SPDX-License-Identifier: MIT
"""A table of injected faults: found by what, with which message and exit status, and was a table flashed or written?

usage: python -m sick --programs build/bin [--healthy 1000] [--out build/sick] [--only TEXT]

Exit status 0: every fault found by its rule, none flashed with status 0, at most 1 % of the healthy runs refused."""
import argparse
import sys
from collections import Counter

from sick import device, healthy, offline
from sick.case import Bench

MAX_REFUSED = 0.01


def run_faults(bench, faults):
    """Runs and prints them; the faults that were missed or flashed."""
    print(f"{'area':<12} {'fault':<48} {'found by':<13} {'status':>6} {'flashed':>8}  message")
    lost = []
    for fault in faults:
        outcome = fault.inject(bench)
        is_good = fault.is_found(outcome) and fault.is_safe(outcome)
        found_by = fault.found_by if is_good else "MISSED"
        print(f"{fault.area:<12} {fault.name:<48} {found_by:<13} {outcome.status:>6} {'yes' if outcome.is_flashed else 'no':>8}  "
              f"{outcome.message[:110] or ('last row left out' if outcome.is_noted else '%d seconds left out' % outcome.left_out)}", flush=True)
        if not is_good:
            print(f"{'':12}   wanted {fault.found_by}, found {', '.join(outcome.rules) or 'nothing'}")
            lost.append((fault, outcome))
    return lost


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--programs", default="build/bin")
    parser.add_argument("--healthy", type=int, default=1000)
    parser.add_argument("--out", default="build/sick")
    parser.add_argument("--only", default="")
    parser.add_argument("--save", help="write the table of the healthy runs to this file, for the tests")
    options = parser.parse_args()
    from pathlib import Path
    bench = Bench(options.out, Path(options.programs).resolve())
    wanted = [[f for f in room.FAULTS if options.only in f.area + " " + f.name] for room in (offline, device)]
    faults = wanted[0] + wanted[1]
    at_device = device.DeviceBench(options.out)
    lost = run_faults(bench, wanted[0]) + run_faults(at_device, wanted[1])
    flashed = sum(1 for fault, outcome in lost if not fault.is_safe(outcome) and outcome.status == 0)
    runs = healthy.campaign(bench, options.healthy)
    refused = [(kind, rules) for kind, rules in runs if rules]
    print(f"\n{'healthy runs':<48} {'runs':>6} {'refused':>8}  by")
    table = ["| healthy runs | runs | refused |", "| --- | --- | --- |"]
    for kind in dict.fromkeys(kind for kind, _ in runs):
        rules = Counter(rule for k, found in refused if k == kind for rule in set(found))
        n_refused, n_runs = (sum(1 for k, _ in of if k == kind) for of in (refused, runs))
        table.append(f"| {kind} | {n_runs} | {n_refused} |")
        print(f"{kind:<48} {n_runs:>6} {n_refused:>8}  {', '.join(f'{rule} {n}' for rule, n in rules.items())}")
    n_device = max(1, options.healthy // 20)
    refused_by_device = device.campaign(at_device, n_device)
    for seed, outcome in refused_by_device:
        print(f"healthy run {seed} refused on the device: {outcome}")
    print(f"sick: {len(faults)} faults, {len(faults) - len(lost)} found as they must be, {flashed} flashed with status 0; "
          f"healthy: {len(refused)} of {len(runs)} refused, on the device {len(refused_by_device)} of {n_device}")
    if options.save:
        table.append(f"| on the emulated device | {n_device} | {len(refused_by_device)} |")
        Path(options.save).write_text("\n".join(table) + "\n")
    n_refused, n_runs = len(refused) + len(refused_by_device), len(runs) + n_device
    return 0 if not lost and n_refused <= MAX_REFUSED * n_runs else 1


if __name__ == "__main__":
    sys.exit(main())
