# SPDX-License-Identifier: MIT
"""``imucal example DIR``: a model, a profile, logs of a sensor with a fault, and a script from log to diagnosis."""
import json
import os

from .cli import common_options, finish_json, parser_of, whole
from .errors import DataError
from .log import write_text
from .programs import find, run as run_program

MODEL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}], "turn_on_sigma_dph": 50,
         "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 300, 150, -100]}}
PROFILE = {"imucal_profile": 1, "start_degc": 0, "segments": [
    {"rate_degc_per_min": 0, "duration_s": 600}, {"rate_degc_per_min": 1.5, "to_degc": 60}, {"rate_degc_per_min": 0, "duration_s": 600},
    {"rate_degc_per_min": -1.5, "to_degc": 0}, {"rate_degc_per_min": 0, "duration_s": 600}]}
LIMITS = {"imucal_limits": 1, "span_degc": [0, 60], "max_sigma": 10, "max_bias": 2000, "max_slope_per_degc": 100}
FAULT = [{"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 60, "width_degc": 10}}]
# A first look should end in what was put in.  The noise of seed 1 happens to look like bursts (p = 1.5e-4), which diagnose then names as a
# remainder beside the hysteresis: a false alarm.
SEED = 2

SCRIPT = """#!/bin/sh
# From logs to a diagnosis.  Needs imucal on the PATH, or: IMUCAL=/path/to/imucal ./run.sh
set -e
cd "$(dirname "$0")"
imucal=${IMUCAL:-imucal}
"$imucal" check model.json profile.json run1.csv run2.csv run3.csv
"$imucal" look run1.csv -o run1.png
# The logs contradict the model: calibrate says by how much and writes no table, unless told which findings to accept.
"$imucal" calibrate fit run1.csv run2.csv --method kf --order 3 --model model.json --accept slow --accept residual -o table.json
# The table carries what was accepted: its error is larger than the limit, and check says so (status 1).
"$imucal" check table.json --limits limits.json || test $? = 1
"$imucal" diagnose --model model.json --log run1.csv --log run2.csv --holdout run3.csv --json diagnosis.json
"$imucal" report diagnosis.json -o diagnosis.html
"$imucal" export table.json --to c-header -o table.h
"""

README = """A gyro with a fault, simulated (seed {seed}).

model.json     what is believed of the sensor: noise and thermal polynomial
profile.json   the chamber's temperature
limits.json    what a table must keep to leave the house, in the unit of its axes: imucal check --limits
effects.json   the fault that was put in (diagnose is not told): a thermal hysteresis
run1.csv …     three runs of the sensor, one row a second
run.sh         from the logs to table.json, diagnosis.html and table.h
"""


def _write(folder, name, content):
    path = os.path.join(folder, name)
    write_text(path, content if isinstance(content, str) else json.dumps(content, indent=2) + "\n")
    return path


def _make_folder(folder):
    """DataError where it holds something, or cannot be made."""
    if os.path.lexists(folder) and not os.path.isdir(folder):
        raise DataError(f"{folder}: is no folder; name a new one")
    try:
        os.makedirs(folder, exist_ok=True)
        if os.listdir(folder):
            raise DataError(f"{folder}: is not empty; name a new folder")
    except OSError as error:
        raise DataError(f"{folder}: cannot make the folder: {error.strerror}; name another place") from None


def run(arguments):
    """Run the command; returns the exit status."""
    parser = parser_of("example", "A folder to play with: model, profile, limits, logs of a sensor with a fault, and a script from log to diagnosis.")
    parser.add_argument("folder", metavar="DIR")
    parser.add_argument("--seed", type=whole(2**64 - 1, "2^64 - 1"), metavar="N", default=SEED, help="of the noise")
    common_options(parser)
    given = parser.parse_args(arguments)
    find("gyrosim")  # nothing is made without it
    _make_folder(given.folder)
    model, profile = _write(given.folder, "model.json", MODEL), _write(given.folder, "profile.json", PROFILE)
    _write(given.folder, "limits.json", LIMITS)
    effects = _write(given.folder, "effects.json", FAULT)
    for i in range(3):
        run_program("gyrosim", "log", "--model", model, "--profile", profile, "--effects", effects, "--axes", 1, "--seed", given.seed, "--log-index", i,
                    "--n-logs", 3, "-o", os.path.join(given.folder, f"run{i + 1}.csv"))
    _write(given.folder, "README.txt", README.format(seed=given.seed))
    os.chmod(_write(given.folder, "run.sh", SCRIPT), 0o755)
    files = sorted(os.listdir(given.folder))
    if not given.quiet and given.json != "-":
        print(f"{given.folder}: {' '.join(files)}\nnext: {os.path.join(given.folder, 'run.sh')}")
    finish_json(given.json, {"folder": given.folder, "seed": given.seed, "files": files})
    return 0
