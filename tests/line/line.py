# SPDX-License-Identifier: MIT
"""make line: flash, run, dump and record of the built programs through a bad line, at set rates.

    python tests/line/line.py [--rounds N] [--seed N] [--rates 0.0003,0.001,0.003]

Bytes are changed, doubled and lost, each at the rate given; chunks of up to 64 bytes are held up, or overtaken by the next, at
ten times that rate; the line goes silent for a while or for good; the host is cut off.  What `calibrate flash` and `calibrate
run` report as done must rule after a restart of the device, and the table of `run` be the one of a clean line, bit for bit;
what they report as failed must leave the old or the new table; what `dump` writes must be the ruling table; `record` may lose
rows but no row may be wrong; nothing may take longer than its limit.  One line for each command, the last counts; exit status
1 where something does not hold."""

import argparse
import csv
import json
import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "system"))
from imu import Imu  # noqa: E402
from noisy_line import NoisyLine  # noqa: E402
from reference import QUICK  # noqa: E402

LIMIT_S = 120.0
PATIENT = ["--timeout-s", "0.05", "--tries", "40"]
COUNTS = dict(sessions=0, done=0, failed=0, hit_bytes=0, bytes=0, delayed=0, reordered=0, disconnects=0, stalls=0, not_in_flash=0, wrong=0, wrong_status=0, hangs=0)


BY_COMMAND = Counter()  # (command, status)


def through(imu, rate, rng, *arguments):
    """One program through the bad line: (status, output).  Sometimes the line goes silent or the host is cut off."""
    draw = rng.random()
    COUNTS["sessions"] += 1
    start_s = time.monotonic()
    with NoisyLine(imu.port, corrupt=rate, double=rate, lose=rate, delay=10 * rate, reorder=10 * rate, seed=rng.randrange(1 << 30)) as line:
        process = imu.start(*PATIENT, *arguments, port=line.port)
        if draw < 0.15:
            time.sleep(rng.random() * 0.2)
            line.silent = True
            COUNTS["stalls"] += 1
            if draw < 0.1:
                time.sleep(0.3)
                line.silent = False
        elif draw < 0.25:
            time.sleep(rng.random() * 0.2)
            process.kill()
            COUNTS["disconnects"] += 1
        out, err = process.communicate(timeout=LIMIT_S)
        COUNTS["hit_bytes"] += line.n_hit
        COUNTS["bytes"] += line.n_bytes
        COUNTS["delayed"] += line.n_delayed
        COUNTS["reordered"] += line.n_reordered
    COUNTS["hangs"] += time.monotonic() - start_s > LIMIT_S
    status = process.returncode
    COUNTS["done" if status == 0 else "failed"] += 1
    BY_COMMAND[arguments[0], status] += 1
    COUNTS["wrong_status"] += status not in (0, 1, 4, -9)
    if status not in (0, 1, 4, -9):
        print("status", status, arguments, out, err)
    return status


def ruling(imu):
    status, _, err = imu.calibrate("dump", "-o", "ruling.json")
    assert status == 0, err
    return imu.json("ruling.json")["axes"]


def flash_round(imu, rate, rng, table, number):
    before = ruling(imu)
    table["axes"][1]["coeff_dph"][1] = 100.0 + number
    (imu.folder / "next.json").write_text(json.dumps(table))
    status = through(imu, rate, rng, "flash", "next.json")
    imu.power_off()
    imu.power_on()
    after = ruling(imu)
    if status == 0 and after != table["axes"]:
        COUNTS["not_in_flash"] += 1
    if after not in (before, table["axes"]):
        COUNTS["wrong"] += 1


def coefficients(axes):
    return [(axis["axis"], axis["coeff_dph"], axis["sigma_dph"], axis["n_seconds"]) for axis in axes]


def run_round(imu, rate, rng, clean_table):
    """The sensor delivers what it delivered to the clean run."""
    before = ruling(imu)
    (imu.folder / "noisy_table.json").unlink(missing_ok=True)
    imu.sense(QUICK)
    status = through(imu, rate, rng, "run", "--order", "3", "--model", "model.json", "--range", "0:60", "-o", "noisy_table.json")
    imu.stop_sensor()
    imu.power_off()
    imu.power_on()
    after = ruling(imu)
    if status == 0 and (after != imu.json("noisy_table.json")["axes"] or coefficients(after) != coefficients(clean_table["axes"])):
        COUNTS["not_in_flash"] += 1
    if coefficients(after) not in (coefficients(before), coefficients(clean_table["axes"])):
        COUNTS["wrong"] += 1


def dump_round(imu, rate, rng):
    (imu.folder / "dumped.json").unlink(missing_ok=True)
    status = through(imu, rate, rng, "dump", "-o", "dumped.json")
    if status == 0 and imu.json("dumped.json")["axes"] != ruling(imu):
        COUNTS["wrong"] += 1


def rows(path):
    with open(path) as file:
        return {row["t_s"]: row for row in csv.DictReader(line for line in file if not line.startswith("#"))}


def record_round(imu, rate, rng, clean):
    for name in ("noisy.csv", "noisy.csv.part"):
        (imu.folder / name).unlink(missing_ok=True)
    imu.sense(QUICK)
    through(imu, rate, rng, "record", "--duration-s", "200", "-o", "noisy.csv")
    imu.stop_sensor()
    imu.power_off()
    imu.power_on()
    if (imu.folder / "noisy.csv").exists():
        COUNTS["wrong"] += sum(clean.get(t_s) != row for t_s, row in rows(imu.folder / "noisy.csv").items())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rates", default="0.0003,0.001,0.003")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        imu = Imu(folder)
        try:
            imu.sense(QUICK)
            imu.run("--range", "0:60")
            table, clean_table = imu.json("table.json"), imu.json("table.json")
            imu.sense(QUICK)
            status, _, err = imu.calibrate("record", "--duration-s", "720", "-o", "clean.csv")
            assert status == 0, err
            clean = rows(imu.folder / "clean.csv")
            for rate in map(float, options.rates.split(",")):
                for number in range(options.rounds):
                    flash_round(imu, rate, rng, table, number)
                    dump_round(imu, rate, rng)
                    record_round(imu, rate, rng, clean)
                    run_round(imu, rate, rng, clean_table)
        finally:
            imu.close()
    for command in sorted({command for command, _ in BY_COMMAND}):
        print("%-7s %s" % (command, ", ".join("%d with status %d" % (n, status) for (of, status), n in sorted(BY_COMMAND.items()) if of == command)))
    print("line: seed %d, rates %s per byte and kind, " % (options.seed, options.rates) +
          ", ".join("%s %d" % (name.replace("_", " "), value) for name, value in COUNTS.items()))
    return any(COUNTS[name] for name in ("not_in_flash", "wrong", "wrong_status", "hangs"))


if __name__ == "__main__":
    sys.exit(main())
