# SPDX-License-Identifier: MIT
"""Healthy runs, on the profiles of `make validation` and with the flaws that healthy sensors have: how many are refused."""
import json
import math
from concurrent.futures import ThreadPoolExecutor

from sick.case import BASIC, MODEL, SOAK

UP = {"rate_degc_per_min": 0.6, "to_degc": 60}
DOWN = {"rate_degc_per_min": 0.6, "to_degc": 0}


def freezer():
    """25 - 43 exp(-t/1200 s), in steps of a minute."""
    segments, last = [], -18.0
    for minute in range(1, 121):
        now = 25 - 43 * math.exp(-minute / 20)
        if now - last > 1e-3:
            segments.append({"rate_degc_per_min": now - last, "to_degc": now})
        last = now
    return {"imucal_profile": 1, "start_degc": -18, "segments": segments}


PROFILES = {"ramp": dict(BASIC, segments=[UP]), "ramp and soaks": BASIC, "up and down": dict(BASIC, segments=[UP, SOAK, DOWN, SOAK]),
            "freezer warm-up": freezer(), "fast ramps": dict(BASIC, segments=[SOAK, {"rate_degc_per_min": 5, "to_degc": 60}, SOAK], repeat=1)}
STEEP = {**MODEL, "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 3000, 150, -100]}}
SLOW = {**MODEL, "markov": [{"sigma_dph": 20, "tau_s": 1000}]}
# name of the profile, model, arguments of gyrosim, of calibrate fit
KINDS = [("ramp and soaks", MODEL, [], []), ("ramp", MODEL, [], []), ("up and down", MODEL, [], []), ("freezer warm-up", MODEL, [], ["--range", "-18:25"]),
         ("fast ramps", MODEL, [], []), ("ramp and soaks", MODEL, [], ["--order", "5"]), ("ramp and soaks", STEEP, [], []),
         ("ramp and soaks", SLOW, [], []), ("ramp and soaks", MODEL, ["--temp-noise-degc", "0.02", "--missing", "0.01", "--jitter-s", "0.01"], []),
         ("ramp and soaks", MODEL, ["--temp-lsb-degc", "0.0625", "--temp-noise-degc", "0.05", "--rate-lsb-dph", "60"], [])]


def one(bench, index):
    """(kind, rules that refused it) of healthy run `index`."""
    kind = index % len(KINDS)
    profile, model, of_gyrosim, of_fit = KINDS[kind]
    names = {"model": f"h{kind}_model.json", "profile": f"h{kind}_profile.json", "log": f"h{index}.csv", "out": f"h{index}.json"}
    done = bench.run("gyrosim", "log", "--model", names["model"], "--profile", names["profile"], "--seed", 1000 + index, "-o", names["log"], "-q", *of_gyrosim)
    assert done.returncode == 0, done.stderr
    done = bench.run("calibrate", "fit", names["log"], "--model", names["model"], "--json", names["out"], "-q", *of_fit)
    assert done.returncode in (0, 1), done.stderr
    rules = [r["rule"] for r in json.loads((bench.folder / names["out"]).read_text())["judgement"]["reasons"]]
    for name in ("log", "out"):
        (bench.folder / names[name]).unlink()
    return kind, rules


def campaign(bench, n, threads=2):
    for kind, (profile, model, _, _) in enumerate(KINDS):
        bench.write(f"h{kind}_model.json", model)
        bench.write(f"h{kind}_profile.json", PROFILES[profile])
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda i: one(bench, i), range(n)))
