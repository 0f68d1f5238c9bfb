# SPDX-License-Identifier: MIT
"""Does the stated interval of the shrinkage cover?  Judged on fresh held-out runs that nobody saw.

For a case the reported effects with their reported parameters, the nominal model and the true effect are
scored on new simulated runs of the held-out profiles.  The mean gains give the shrinkage that the reported
model really reaches; it is worked out with this package's own likelihood, so it also checks that the
reported parameters mean what the contract says.
"""
from __future__ import annotations

import copy
import csv
import os

import numpy as np

from . import oracle, simulate
from .campaign import Group
from .simulate import MEAN, NOISE

SUPPORTED = tuple(n for n in MEAN + NOISE if not n.startswith("unknown") and n not in (
    "bias_step", "temperature_sensor_quantization", "outliers", "telegraph_noise"))


def claimed_effects(entry, n_runs):
    """Reported effects in this package's form, or None where one has no likelihood here."""
    out = []
    for effect in entry.get("effects") or []:
        if effect["name"] not in SUPPORTED:
            return None
        parameters = {k: v for k, v in effect["parameters"].items() if isinstance(v, (int, float, str))}
        parameters.update(_phase=[0.0] * n_runs, _draws=[[0.0, 0.0]] * n_runs)
        out.append({"name": effect["name"], "parameters": parameters})
    return out


def read_training(path, group):
    """Training readings of a case again from its logs."""
    series = []
    for i, run in enumerate(group.train):
        with open(os.path.join(path, f"train{i}.csv"), encoding="utf-8") as f:
            rows = list(csv.DictReader(line for line in f if not line.startswith("#")))
        y = np.zeros(run.n)
        y[run.keep] = [float(r["gx_dph"]) for r in rows]
        series.append(y)
    return series


def shrinkage_on_fresh_runs(group, label, entry, training, rng, copies=4):
    """(gain of the reported model, gain of the truth) in deviance per hour over fresh held-out runs; None if
    the reported model cannot be scored here."""
    bias = np.array(label["bias_dph"]["gx_dph"])
    wide = Group(group.name, group.family, group.nominal, group.believed, group.train, group.hold * copies,
                 group.noise_known, group.lsb_degc, {})
    n_runs = len(wide.train) + len(wide.hold)
    truth = copy.deepcopy(label["effects"])
    for effect in truth:
        p = effect["parameters"]
        if "_draws" in p:
            p["_draws"] = rng.standard_normal((n_runs, 2)).tolist()
        if "_phase" in p:
            p["_phase"] = rng.uniform(0, 2 * np.pi, n_runs).tolist()
    claimed = claimed_effects(entry, n_runs)
    if claimed is None:
        return None
    series = simulate.simulate_axis(wide, bias, truth, rng)
    series[: len(training)] = training
    hours = sum(int(r.keep.sum()) for r in wide.hold) / 3600.0
    nominal = oracle.held_out_deviance(wide, series, [], bias).sum()
    best = oracle.held_out_deviance(wide, series, truth, bias).sum()
    fitted_bias = bias  # a lag's signature needs B(T); the true curve stands for the fitted one
    reported = oracle.held_out_deviance(wide, series, claimed, fitted_bias).sum()
    return (nominal - reported) / hours, (nominal - best) / hours


def interval_coverage(groups, labels, answers, logs, seed, most=150):
    """Coverage tables for single effects that were named; groups: {name: (Group, group id)}."""
    from .intervals import rate
    from .score import names_of, reading

    rng = np.random.default_rng([seed % 2**63, 77])
    counts, widths, detail = {}, {}, {}
    chosen = [c for c, l in labels.items() if l["kind"] == "single" and l["target"] >= 10
              and names_of(l)[0] in SUPPORTED]
    for c in [chosen[i] for i in rng.permutation(len(chosen))][:most]:
        label, read = labels[c], reading(answers[c])
        gap = (read["entry"] or {}).get("gap") or {}
        if not read["names"] or gap.get("shrinkage") is None or not gap.get("ci95") or None in gap["ci95"]:
            continue
        group, group_id = groups[label["group"]]
        training = read_training(os.path.join(logs, group_id, c), group)
        result = shrinkage_on_fresh_runs(group, label, read["entry"], training, rng)
        if result is None or result[1] < 5:
            continue
        true_shrinkage = min(result[0] / result[1], 1.0)  # beyond the truth there is only luck of the draw
        lo, hi = gap["ci95"]
        slow = names_of(label)[0] in NOISE + ("run_to_run",)
        entry = {"effect": names_of(label)[0], "said": gap["shrinkage"], "ci95": [lo, hi], "fresh": true_shrinkage,
                 "gain_fresh": result[0], "gain_said": (gap.get("before") or 0) - (gap.get("after") or 0)}
        gain_ci = gap.get("gain_ci95")
        if gain_ci:
            entry["gain_ci95"] = gain_ci
        detail[c] = entry
        for name in ("all", "noise" if slow else "repeatable"):
            counts.setdefault(name, []).append(lo <= true_shrinkage <= hi)
            widths.setdefault(name, []).append(hi - lo)
            if gain_ci:
                counts.setdefault(name + ", gain", []).append(gain_ci[0] <= result[0] <= gain_ci[1])
                widths.setdefault(name + ", gain", []).append((gain_ci[1] - gain_ci[0]) / max(result[0], 1e-9))
    table = {k: {"covered": rate(sum(v), len(v)), "median_width": float(np.median(widths[k]))} for k, v in counts.items()}
    return table, detail
