# SPDX-License-Identifier: MIT
"""Healthy runs, on the profiles of `make validation` and with the flaws that healthy sensors have: how many are refused."""
import json
from concurrent.futures import ThreadPoolExecutor

from reference import BASIC
from reference import DRIFTING as MODEL

STEEP = {**MODEL, "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 3000, 150, -100]}}
SLOW = {**MODEL, "markov": [{"sigma_dph": 20, "tau_s": 1000}]}
SOAK = BASIC["segments"][0]
UP = {"rate_degc_per_min": 0.6, "to_degc": 60}
DOWN = {"rate_degc_per_min": 0.6, "to_degc": 0}
# Beyond those of `make validation`: name, profile, model, arguments of gyrosim, of calibrate fit.
OWN = [("up and down with soaks", dict(BASIC, segments=[UP, SOAK, DOWN, SOAK]), MODEL, [], []),
       ("fast ramps", dict(BASIC, segments=[SOAK, {"rate_degc_per_min": 5, "to_degc": 60}, SOAK]), MODEL, [], []),
       ("order 5", BASIC, MODEL, [], ["--order", "5"]),
       ("steep gyro", BASIC, STEEP, [], []),
       ("slow instability", BASIC, SLOW, [], []),
       ("jitter, losses, thermometer noise", BASIC, MODEL, ["--temp-noise-degc", "0.02", "--missing-seconds", "0.01", "--jitter-s", "0.01"], []),
       ("coarse sensor", BASIC, MODEL, ["--temp-lsb-degc", "0.0625", "--temp-noise-degc", "0.05", "--rate-lsb-dph", "60"], [])]


def kinds(bench):
    """Every profile of `make validation`, each with its fine and its 1-degC thermometer, as `montecarlo compare` writes them, and OWN."""
    bench.write("h_model.json", MODEL)
    done = bench.run("montecarlo", "compare", "--model", "h_model.json", "--order", "3", "--runs", "2", "--json", "h_profiles.json", "-q")
    assert done.returncode == 0, done.stderr
    found = []
    for scenario in json.loads((bench.folder / "h_profiles.json").read_text())["scenarios"]:
        thermometer = ["--temp-lsb-degc", scenario["temp_lsb_degc"], "--temp-noise-degc", scenario["temp_noise_degc"]]
        span = ["--range", f"{min(scenario['temp_degc']):g}:{max(scenario['temp_degc']):g}"]
        found.append((scenario["scenario"], scenario["profile"], MODEL, thermometer, span))
    return found + OWN


def one(bench, every, index):
    """(name of the kind, rules that refused it) of healthy run `index`."""
    kind = index % len(every)
    name, _, _, of_gyrosim, of_fit = every[kind]
    names = {"model": f"h{kind}_model.json", "profile": f"h{kind}_profile.json", "log": f"h{index}.csv", "out": f"h{index}.json"}
    done = bench.run("gyrosim", "log", "--model", names["model"], "--profile", names["profile"], "--seed", 1000 + index, "-o", names["log"], "-q", *of_gyrosim)
    assert done.returncode == 0, done.stderr
    done = bench.run("calibrate", "fit", names["log"], "--model", names["model"], "--json", names["out"], "-q", *of_fit)
    assert done.returncode in (0, 1), done.stderr
    rules = [r["rule"] for r in json.loads((bench.folder / names["out"]).read_text())["judgement"]["reasons"]]
    for file in ("log", "out"):
        (bench.folder / names[file]).unlink()
    return name, rules


def campaign(bench, n, threads=2):
    """[(name of the kind, rules that refused it)] of n runs, the kinds in turn."""
    every = kinds(bench)
    for kind, (_, profile, model, _, _) in enumerate(every):
        bench.write(f"h{kind}_model.json", model)
        bench.write(f"h{kind}_profile.json", profile)
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda i: one(bench, every, i), range(n)))
