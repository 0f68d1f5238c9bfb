# SPDX-License-Identifier: MIT
"""Plans a campaign of cases, draws it group by group, writes logs without labels and seals the labels."""
from __future__ import annotations

import hashlib
import json
import os
import secrets
import zlib
from dataclasses import dataclass, field

import numpy as np

from . import cases
from .campaign import draw_group
from .strength import Unreachable

# name, family, options of draw_group, share of the ordinary cases (single, pair, unknown)
GROUPS = (
    ("mixed", "mixed", {"aux": True}, 1.0),
    ("staircase", "staircase", {"standard_span": True, "paper_noise": True}, 1.0),  # the advised run of section 6
    ("triangle", "triangle", {"missing": True}, 1.0),
    ("up_and_down", "up_and_down", {}, 1.0),
    ("up_only", "up_only", {}, 0.35),
    ("thermometer", "mixed", {"lsb_degc": "draw"}, 0.0),
    ("fitted_staircase", "staircase", {"noise_known": False}, 0.0),
    ("fitted_mixed", "mixed", {"noise_known": False}, 0.0),
    ("fitted_up_only", "up_only", {"noise_known": False}, 0.0),
)
GAP_FREE = ("mixed", "staircase", "up_only", "fitted_staircase", "fitted_mixed", "fitted_up_only")


@dataclass
class Job:
    kind: str
    name: object = None
    target: float = 0.0


@dataclass
class GroupPlan:
    name: str
    family: str
    options: dict
    seed: np.random.SeedSequence = None
    jobs: list = field(default_factory=list)


def make_plan(n_cases, n_gap_free, seed, groups=GROUPS, seconds=8400.0):
    """About `n_cases` cases with an effect and `n_gap_free` without, spread over the groups."""
    rng = np.random.default_rng(seed.spawn(1)[0])
    plans = {g[0]: GroupPlan(g[0], g[1], dict(g[2], seconds=seconds)) for g in groups}
    ordinary = [g[0] for g in groups]
    share = np.array([g[3] for g in groups])
    share = share / share.sum()

    def place(job):
        plans[str(rng.choice(ordinary, p=share))].jobs.append(job)

    unit = n_cases / 400.0
    count = lambda n: int(round(n * unit))
    for target in cases.STRENGTHS:
        deck = []
        while len(deck) < count(40):
            deck += [cases.SINGLES[i] for i in rng.permutation(len(cases.SINGLES))]
        for name in deck[: count(40)]:
            place(Job("single", name, target))
        if "mixed" in plans:
            plans["mixed"].jobs += [Job("single", "auxiliary_channel", target)] * count(2)
        if "thermometer" in plans:
            plans["thermometer"].jobs += [Job("thermometer", None, target)] * count(2)
    for name in ("quantization", "saturation", "dead_band", "held_samples"):
        for _ in range(count(4)):
            place(Job("structural", name))
    repeatable = [n for n in cases.SINGLES[:8]]
    noisy = ["noise_parameters", "second_markov", "rate_random_walk", "flicker_noise", "white_noise_vs_temperature",
             "markov_sigma_vs_temperature", "outliers"]
    for i in range(count(66)):
        kind = rng.random()
        if kind < 0.4:
            names = rng.choice(repeatable, 2, replace=False)
        elif kind < 0.85:
            names = [rng.choice(repeatable), rng.choice(noisy)]
        else:
            names = rng.choice(noisy[:-1], 2, replace=False)
        place(Job("pair", [str(n) for n in names], 20.0 if i % 2 else 40.0))
    for name, n in (("unknown_function", 42), ("unknown_spectrum", 20), ("unknown_modulation", 18)):
        for i in range(count(n)):
            place(Job("unknown", name, (10.0, 20.0, 40.0)[i % 3]))
    if "staircase" in plans:
        names = [cases.SINGLES[i] for i in rng.permutation(len(cases.SINGLES))[: max(count(8), 1)]]
        plans["staircase"].jobs += [Job("multi_axis", n, (10.0, 20.0)[i % 2]) for i, n in enumerate(names)]
        plans["staircase"].jobs += [Job("between_axes")] * count(4)
    for i in range(count(27)):
        name = list(cases.PHYSICAL)[i % 3]
        if "up_only" in plans:
            plans["up_only"].jobs.append(Job("up_only", name))
        if "staircase" in plans:
            plans["staircase"].jobs.append(Job("advised", name))
    here = [g for g in GAP_FREE if g in plans] or list(plans)
    for i in range(n_gap_free):
        plans[here[i % len(here)]].jobs.append(Job("no_gap"))
    out = [p for p in plans.values() if p.jobs]
    for p, s in zip(out, seed.spawn(len(out))):
        p.seed = s
    return out


def paper_noise(group):
    """The paper's noise on the paper's span, where diagnosis.md states amplitudes."""
    group.nominal.arw_deg_rt_h, group.nominal.markov = 0.6, [(20.0, 100.0)]


def draw_group_of(plan):
    """The group's profiles and noise, and the generator where it stands after them: repeatable from the plan."""
    rng = np.random.default_rng(plan.seed)
    options = dict(plan.options)
    fixed_noise = options.pop("paper_noise", False)
    if options.get("lsb_degc") == "draw":
        options["lsb_degc"] = float(f"{rng.uniform(0.25, 1.5):.2f}")
    group = draw_group(plan.name, plan.family, rng, **options)
    if fixed_noise:
        paper_noise(group)
    return group, f"g{rng.integers(16**6):06x}", rng


def draw_cases(plan, folder):
    """Draws one group; writes its logs under folder/<group id>/<case id>.  Returns labels and a note."""
    group, group_id, rng = draw_group_of(plan)
    labels, unreachable = [], 0
    order = rng.permutation(len(plan.jobs))
    for i in order:
        job = plan.jobs[i]
        case_id = f"c{rng.integers(16**8):08x}"
        for _ in range(10):
            try:
                case = make_case(group, rng, job, case_id)
                break
            except Unreachable:
                unreachable += 1
                if job.kind == "single":
                    job = Job("single", str(rng.choice(cases.SINGLES)), job.target)
                elif job.kind == "pair":
                    job = Job("pair", [str(n) for n in rng.choice(cases.SINGLES[:8], 2, replace=False)], job.target)
        else:
            continue
        path = case.write(os.path.join(folder, group_id))
        wrong = rng.standard_normal(group.nominal.order + 1) * 100  # a wrong polynomial is no gap
        bias = group.cache.setdefault("believed_bias", wrong)  # one model file per group: one calibration
        with open(os.path.join(path, "model.json"), "w", encoding="utf-8") as out:
            json.dump(group.believed.to_json(bias.round(2).tolist()), out)
        labels.append(case.label)
    return {"group_id": group_id, "group": plan.name, "family": plan.family, "labels": labels,
            "unreachable": unreachable, "believed": group.believed.to_json([]), "lsb_degc": group.lsb_degc}


def make_case(group, rng, job, case_id):
    if job.kind == "single":
        return cases.single(group, rng, job.name, job.target, case_id)
    if job.kind == "structural":
        return cases.structural(group, rng, job.name, case_id)
    if job.kind == "pair":
        return cases.pair(group, rng, job.name, job.target, case_id)
    if job.kind == "unknown":
        return cases.unknown_case(group, rng, job.name, job.target, case_id)
    if job.kind == "multi_axis":
        return cases.multi_axis(group, rng, job.name, job.target, case_id)
    if job.kind == "between_axes":
        return cases.common_mode(group, rng, case_id)
    if job.kind == "thermometer":
        return cases.thermometer(group, rng, job.target, case_id)
    if job.kind in ("up_only", "advised"):
        return cases.physical(group, rng, job.name, case_id, job.kind)
    return cases.gap_free(group, rng, case_id)


# ---- sealing ----------------------------------------------------------------------------------------------

def _stream(key, size):
    blocks = (hashlib.sha256(key + i.to_bytes(8, "little")).digest() for i in range(size // 32 + 1))
    return np.frombuffer(b"".join(blocks)[:size], np.uint8)


def seal(labels, folder):
    """Encrypts the labels with a one-time key; returns the digest that is printed before scoring."""
    os.makedirs(folder, exist_ok=True)
    plain = zlib.compress(json.dumps(labels).encode())
    key = secrets.token_bytes(32)
    hidden = (np.frombuffer(plain, np.uint8) ^ _stream(key, len(plain))).tobytes()
    with open(os.path.join(folder, "labels.sealed"), "wb") as out:
        out.write(hidden)
    handle = os.open(os.path.join(folder, "labels.key"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(handle, "wb") as out:
        out.write(key)
    return hashlib.sha256(hidden).hexdigest()


def open_sealed(folder, digest=None):
    """Labels again; refuses a file that is not the one whose digest was printed."""
    with open(os.path.join(folder, "labels.sealed"), "rb") as f:
        hidden = f.read()
    if digest is not None and hashlib.sha256(hidden).hexdigest() != digest:
        raise ValueError(f"{folder}/labels.sealed changed after sealing: draw the cases again")
    with open(os.path.join(folder, "labels.key"), "rb") as f:
        key = f.read()
    plain = (np.frombuffer(hidden, np.uint8) ^ _stream(key, len(hidden))).tobytes()
    return json.loads(zlib.decompress(plain))
