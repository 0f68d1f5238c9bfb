# SPDX-License-Identifier: MIT
"""Which cases a draw holds, and drawing them side by side."""
from __future__ import annotations

import numpy as np

from . import cases, causes, outside

STRENGTHS = (5, 10, 20, 40)
ALL = ("exact", "times_3", "over_3", "fitted", "absent")
FOUR = ("exact", "times_3", "over_3", "fitted")
SHARE = {"exact": 0.3, "times_3": 0.12, "over_3": 0.12, "fitted": 0.28, "absent": 0.1, "data_sheet": 0.08}
SINGLES = causes.REPEATABLE * 2 + ("sinusoid", "bias_step", "run_to_run") + causes.NOISY + ("auxiliary_channel", "temperature_sensor_quantization")
REPLACEMENTS = tuple(n for n in SINGLES if n not in ("noise_parameters", "temperature_sensor_quantization"))
KINDS = ("single", "memory", "invariance", "pair", "outside", "healthy", "pooled", "structural", "beside", "constant", "no_gap")


def counts(n_cases, n_gap_free):
    """Cases of each kind; about `n_cases` with an effect."""
    unit = n_cases / 400.0
    out = {"single": 160, "memory": 40, "invariance": 24, "pair": 48, "outside": 72, "healthy": 32, "pooled": 8,
           "structural": 8, "beside": 8}
    out = {k: max(int(round(v * unit)), 1) for k, v in out.items()}
    return {**out, "constant": max(int(round(0.05 * n_gap_free)), 1), "no_gap": n_gap_free}


def spec_of(kind, i, rng):
    """Case i of a kind: names, strength, regimes of believed noise; `pool` replaces a name that cannot be shown."""
    one = [str(rng.choice(list(SHARE), p=list(SHARE.values())))]
    pick = lambda pool: str(rng.choice(pool))
    if kind == "single":
        name = SINGLES[int(rng.integers(len(SINGLES)))]
        regimes = ["exact"] if name == "noise_parameters" else one  # elsewhere re-tuned noise is no cause
        return {"names": [name], "target": STRENGTHS[i % 4], "regimes": regimes, "pool": list(REPLACEMENTS)}
    if kind == "memory":
        return {"names": [causes.MEMORY[i % 2]], "target": (20, 40)[i // 2 % 2], "regimes": list(ALL), "pool": list(causes.MEMORY)}
    if kind == "invariance":
        name = causes.REPEATABLE[i % len(causes.REPEATABLE)]
        return {"names": [name], "target": (20, 40)[i % 2], "regimes": list(FOUR), "pool": list(causes.REPEATABLE)}
    if kind == "pair":
        pool = list(causes.REPEATABLE)
        first, second = [str(n) for n in rng.permutation(pool)[:2]]
        if rng.random() < 0.4:
            second = pick(causes.NOISY[:-1])
        return {"names": [first, second], "target": (25, 40)[i % 2], "regimes": one, "pool": pool}
    if kind == "outside":
        pool = list(outside.KINDS) + ["random_function"] * 3
        return {"names": [pick(pool)], "target": (10, 20, 40)[i % 3], "regimes": one, "pool": pool}
    if kind in ("healthy", "pooled"):
        pool = list(causes.REPEATABLE + causes.SLOW)
        target = float(rng.uniform(20, 60)) if kind == "healthy" else float(rng.uniform(7, 12))
        axes = int(rng.integers(2, 7)) if kind == "healthy" else 3
        pool = pool if kind == "healthy" else list(causes.REPEATABLE)
        return {"names": [pick(pool)], "target": target, "regimes": one, "pool": pool, "axes": axes}
    if kind == "structural":
        return {"structural": [causes.OUTPUT[i % 4]], "regimes": one, "pool": []}
    if kind == "beside":
        return {"names": [causes.MEMORY[i // 2 % 2]], "target": (20, 40)[i % 2], "regimes": one, "pool": list(causes.MEMORY),
                "beside": ("drop_outs", "clipped")[i % 2]}
    return {"regimes": one, "pool": []}


def make(n_cases, n_gap_free, seed, kinds=None):
    """Specs of a draw in random order: a part of it is a fair sample."""
    rng = np.random.default_rng([seed % 2**63, 2**40])
    out = []
    for kind, n in counts(n_cases, n_gap_free).items():
        if kinds is None or kind in kinds:
            out += [{"kind": kind, **spec_of(kind, i, rng)} for i in range(n)]
    return [out[i] for i in rng.permutation(len(out))]


def draw_one(task):
    """Builds and writes one case; the label, or None where nothing reaches the strength."""
    seed, index, spec, folder = task
    name = f"c{np.random.default_rng([seed % 2**63, index, 2]).integers(16**8):08x}"
    try:
        case = cases.build(seed, index, spec)
    except cases.Unreachable:
        return None
    cases.write(case, folder, name)
    return {"case": name, **case.label}
