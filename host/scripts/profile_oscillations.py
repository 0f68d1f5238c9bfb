# SPDX-License-Identifier: MIT
"""Why the proven bound leaves 7 % open at 2 degC/min: what motion at the full rate would tell at each soak of the best profile,
and what oscillations about the soaks really gain (lib/analysis/profile/README.md).  Runs the program PROFILE.

Model 0.6 deg/sqrt(h), 20 dph, 100 s; order 3; 0..60 degC; 140 min."""
import argparse
import math
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from profile_table import MODEL, program  # pylint: disable=wrong-import-position
from profile_table import json  # pylint: disable=wrong-import-position

RATE, LOW, HIGH, DURATION_S = 2.0, 0.0, 60.0, 8400
NODES = [-1, -1 / math.sqrt(5), 1 / math.sqrt(5), 1]  # of the D-optimal cubic, a quarter of the time at each


def allowed_by_the_proof():
    """Per node: information that motion at the full rate for all time would add, over that of the soaks."""
    power = np.arange(4)
    value = np.array([np.power(float(x), power) for x in NODES])
    slope = np.array([power * np.power(float(x), np.maximum(power - 1, 0)) for x in NODES])
    inverse = np.linalg.inv(value.T @ value / 4)
    term, white = MODEL["markov"][0], (60 * MODEL["arw_deg_rt_h"]) ** 2
    slow = 2 * term["sigma_dph"] ** 2 * term["tau_s"]
    corner = math.sqrt(1 + slow / white) / term["tau_s"]  # rad/s: above it white noise hides what motion tells
    rho = RATE / 60 / ((HIGH - LOW) / 2)
    of_motion = ((slow + white) / white - 1) * (rho / corner) ** 2
    return [of_motion * float(s @ inverse @ s) / 16 for s in slope], corner


def there_and_back(at, target, other, seconds, end):
    """Segments of an oscillation about `at` between two temperatures for `seconds`."""
    out, now, left = [], at, seconds
    while abs(target - now) + abs(target - at) <= RATE / 60 * left:
        out.append({"rate_degc_per_min": RATE, "to_degc": round(target, 6)})
        left -= abs(target - now) / RATE * 60
        now, target, other = target, other, target
    if now != at:
        out.append({"rate_degc_per_min": RATE, "to_degc": at})
        left -= abs(now - at) / RATE * 60
    return out + ([{"rate_degc_per_min": 0, "duration_s": left}] if left >= 1 or end else [])


def oscillating(profile, amplitude_degc, at_ends):
    """The profile with oscillations about its inner soaks, or from the ends inwards."""
    segments, now = [], profile["start_degc"]
    for i, segment in enumerate(profile["segments"]):
        if segment["rate_degc_per_min"] != 0:
            segments.append(segment)
            now = segment["to_degc"]
            continue
        is_end = now < LOW + 1 or now > HIGH - 1
        if is_end != at_ends:
            segments.append(segment)
            continue
        inwards = amplitude_degc if now < HIGH / 2 else -amplitude_degc
        other = now if is_end else now - inwards
        segments += there_and_back(now, now + inwards, other, segment["duration_s"], i + 1 == len(profile["segments"]))
    return {**profile, "segments": segments}


def main():
    """Print both."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    allowed, corner = allowed_by_the_proof()
    ends, inner = allowed[0] + allowed[3], allowed[1] + allowed[2]
    print(f"Motion at {RATE:g} degC/min for all time, {1 / corner:.1f} s or more one way, would add to the information of four soaks {100 * ends:.1f} % at "
          f"the ends and {100 * inner:.1f} % between them:\nan error smaller by {100 * (1 - (1 + ends + inner) ** -0.5):.1f} %, of which "
          f"{100 * (1 - (1 + inner) ** -0.5):.1f} % do not ask for rest at an end and full rate at once.")
    with tempfile.TemporaryDirectory() as folder:
        model, best, tried = (Path(folder) / name for name in ("model.json", "best.json", "tried.json"))
        model.write_text(json.dumps(MODEL))
        found = program("optimize", "--model", model, "--order", 3, "--range", f"{LOW:g}:{HIGH:g}", "--max-rate", RATE, "--duration-s", DURATION_S,
                        "--seed", 1, "-o", best)
        profile = json.loads(best.read_text())
        print(f"best found {found['worst_dph']:.3f} dph, proven {found['proven_bound_dph']:.3f}: {100 * (1 - found['proven_efficiency']):.1f} % open")
        print("amplitude, degC    about the inner soaks    from the ends inwards")
        for amplitude_degc in (0.2, 0.5, 1.0, 1.5, 2.0, 3.0):
            change = []
            for at_ends in (False, True):
                tried.write_text(json.dumps(oscillating(profile, amplitude_degc, at_ends)))
                change.append(program("error", tried, "--model", model, "--order", 3)["worst_dph"] / found["worst_dph"] - 1)
            print(f"{amplitude_degc:15g}    {100 * change[0]:+19.2f} %    {100 * change[1]:+19.2f} %")


if __name__ == "__main__":
    main()
