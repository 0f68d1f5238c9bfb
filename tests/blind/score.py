# SPDX-License-Identifier: MIT
"""Opens nothing itself: takes labels and answers, counts, and says how sure the counts are."""
from __future__ import annotations

from collections import Counter, defaultdict

import numpy as np

from .intervals import rate
from .simulate import OUTPUT

OUTCOMES = ("named", "in_set", "no_gap", "abstains", "wrong", "failed")


def reading(answer, axis="gx_dph"):
    """What the diagnosis says of one axis: verdict, names in order, every name that is not excluded."""
    diagnosis = answer.get("diagnosis")
    if not diagnosis or answer["status"] not in (0, 1):
        return {"verdict": "failed", "names": [], "candidates": set(), "entry": None}
    for entry in diagnosis.get("axes", []):
        if entry.get("axis") == axis:
            effects = entry.get("effects") or []
            names = [e["name"] for e in effects]
            possible = set(names) | {c["name"] for e in effects for c in e.get("set") or []}
            return {"verdict": entry["verdict"], "names": names, "candidates": possible, "entry": entry}
    return {"verdict": "failed", "names": [], "candidates": set(), "entry": None}


def outcome(read, truth):
    """One of OUTCOMES for a case whose causes are `truth` (a list of names; empty: outside the library)."""
    if read["verdict"] == "failed":
        return "failed"
    if read["verdict"] == "no_gap":
        return "no_gap"
    if read["verdict"] == "unexplained" or not read["names"]:
        return "abstains"  # even where it lists re-tuned noise beside the gap that it cannot explain
    if read["names"][0] in truth:
        return "named"
    return "in_set" if read["candidates"] & set(truth) else "wrong"


def names_of(label):
    return [e["name"] for e in label["effects"] if not e["name"].startswith("unknown")]


def tally(cases, labels, answers, tag="", axis="gx_dph"):
    """Outcome counts of some cases."""
    counts = Counter(outcome(reading(answers[c + tag], axis), names_of(labels[c])) for c in cases)
    n = len(cases)
    out = {"n": n, **{o: counts[o] for o in OUTCOMES}}
    out["top1"] = rate(counts["named"], n)
    out["set"] = rate(counts["named"] + counts["in_set"], n)
    out["abstention"] = rate(counts["abstains"], n)
    return out


def singles(labels, answers):
    """Tables over strength, family, effect; and only where the profile can tell the effect from its rivals."""
    chosen = [c for c, l in labels.items() if l["kind"] == "single"]
    table = {"by_strength": {}, "by_strength_separable": {}, "by_family": {}, "by_effect": {}, "structural": None}
    for d in sorted({labels[c]["target"] for c in chosen}):
        here = [c for c in chosen if labels[c]["target"] == d]
        table["by_strength"][str(d)] = tally(here, labels, answers)
        clear = [c for c in here if labels[c].get("separable", True)]
        table["by_strength_separable"][str(d)] = tally(clear, labels, answers)
    strong = [c for c in chosen if labels[c]["target"] >= 10]
    for key, field in (("by_family", lambda c: labels[c]["family"]), ("by_effect", lambda c: names_of(labels[c])[0])):
        groups = defaultdict(list)
        for c in strong:
            groups[field(c)].append(c)
        table[key] = {k: tally(v, labels, answers) for k, v in sorted(groups.items())}
    table["structural"] = tally([c for c, l in labels.items() if l["kind"] == "structural"], labels, answers)
    extra = [c for c in strong if len(reading(answers[c])["names"]) > 1]
    table["with_a_further_name"] = rate(len(extra), len(strong))
    return table


def confusion(labels, answers):
    """Truth -> first name (or verdict) of single effects."""
    table = defaultdict(Counter)
    for c, label in labels.items():
        if label["kind"] in ("single", "structural"):
            read = reading(answers[c])
            said = read["names"][0] if read["names"] else {"no_gap": "(no gap)", "failed": "(failed)"}.get(
                read["verdict"], "(unknown)")
            table[names_of(label)[0]][said] += 1
    return {k: dict(v.most_common()) for k, v in sorted(table.items())}


def pairs(labels, answers):
    out = {}
    chosen = [c for c, l in labels.items() if l["kind"] == "pair"]
    for d in sorted({labels[c]["target"] for c in chosen}):
        here = [c for c in chosen if labels[c]["target"] == d]
        out[str(d)] = pair_counts(here, labels, answers)
    out["all"] = pair_counts(chosen, labels, answers)
    return out


def pair_counts(chosen, labels, answers):
    both = exactly = one = in_set = 0
    for c in chosen:
        truth, read = set(names_of(labels[c])), reading(answers[c])
        both += truth <= set(read["names"])
        exactly += truth == set(read["names"])
        one += len(truth & set(read["names"])) == 1
        in_set += truth <= read["candidates"]
    n = len(chosen)
    return {"both": rate(both, n), "exactly_both": rate(exactly, n), "only_one": rate(one, n),
            "both_in_sets": rate(in_set, n)}


def gap_free(labels, answers):
    """False names and false gaps per stated rate, profiles and knowledge of the noise."""
    out = {}
    chosen = [c for c, l in labels.items() if l["kind"] == "no_gap"]
    for stated, choose in (("0.01", lambda c: c + ("@m" if c + "@m" in answers else "")), ("0.05", lambda c: c + "@5"),
                           ("0.01, fitted noise taken for known", lambda c: c)):
        present = [c for c in chosen if choose(c) in answers]
        if "taken" in stated:
            present = [c for c in present if not labels[c]["noise_known"]]
        groups = {"all": present}
        for known in (True, False):
            groups["noise known" if known else "noise fitted"] = [c for c in present if labels[c]["noise_known"] == known]
        for c in present:
            groups.setdefault(f"{labels[c]['family']}, {'known' if labels[c]['noise_known'] else 'fitted'}", []).append(c)
        out[stated] = {}
        for name, members in groups.items():
            reads = [reading(answers[choose(c)]) for c in members]
            false_names = sum(bool(r["names"]) for r in reads)
            any_gap = sum(r["verdict"] not in ("no_gap",) for r in reads)
            physical = sum(any(x != "noise_parameters" for x in r["names"]) for r in reads)
            out[stated][name] = {"false_names": rate(false_names, len(members)), "any_gap": rate(any_gap, len(members)),
                                 "false_names_besides_noise_parameters": rate(physical, len(members))}
    out["named"] = dict(Counter(n for c in chosen if c in answers for n in reading(answers[c])["names"]).most_common())
    return out


def withheld(labels, answers):
    """(a) library effects taken out with --without, (b) effects no library has."""
    out = {"library": {}, "unknown": {}}
    cut = [c for c in labels if c + "@w" in answers]
    for d in sorted({labels[c]["target"] for c in cut}):
        here = [c for c in cut if labels[c]["target"] == d]
        out["library"][str(d)] = outside(here, labels, answers, "@w")
        clear = [c for c in here if labels[c].get("separable", True)]
        out["library"][f"{d} separable"] = outside(clear, labels, answers, "@w")
    by = defaultdict(list)
    for c in cut:
        if labels[c]["target"] >= 20:
            by[names_of(labels[c])[0]].append(c)
    out["library_by_effect"] = {k: outside(v, labels, answers, "@w") for k, v in sorted(by.items())}
    new = [c for c, l in labels.items() if l["kind"] == "unknown"]
    for d in sorted({labels[c]["target"] for c in new}):
        here = [c for c in new if labels[c]["target"] == d]
        out["unknown"][str(d)] = outside(here, labels, answers)
        clear = [c for c in here if labels[c]["d_left"] >= 4]
        out["unknown"][f"{d} separable"] = outside(clear, labels, answers)
    by = defaultdict(list)
    for c in new:
        if labels[c]["target"] >= 20:
            by[labels[c]["effects"][0]["name"]].append(c)
    out["unknown_by_kind"] = {k: outside(v, labels, answers) for k, v in sorted(by.items())}
    return out


def outside(chosen, labels, answers, tag=""):
    """unexplained: abstains.  partly: names something and says that more remains.  named: names and is content."""
    verdicts = Counter()
    for c in chosen:
        read = reading(answers[c + tag])
        verdict = read["verdict"]
        if verdict in ("explained", "partly_explained") and not read["names"]:
            verdict = "unexplained"
        verdicts[verdict] += 1
    n = len(chosen)
    return {"n": n, "abstains": rate(verdicts["unexplained"], n), "partly": rate(verdicts["partly_explained"], n),
            "misnamed": rate(verdicts["explained"], n), "no_gap": rate(verdicts["no_gap"], n),
            "abstains_or_partly": rate(verdicts["unexplained"] + verdicts["partly_explained"], n),
            "failed": verdicts["failed"]}


def up_only(labels, answers):
    """Rate, hysteresis and lag of fixed size: told apart on the advised profile, honest on up-only ones."""
    out = {}
    for kind in ("up_only", "advised"):
        chosen = [c for c, l in labels.items() if l["kind"] == kind]
        if not chosen:
            continue
        honest = 0
        for c in chosen:
            read, truth = reading(answers[c]), names_of(labels[c])[0]
            entry = read["entry"] or {}
            listed = {n["name"] for n in entry.get("not_detectable_here") or []}
            listed |= {n for pair in entry.get("indistinguishable") or [] for n in pair}
            honest += truth in listed or truth in read["candidates"]
        out[kind] = {**tally(chosen, labels, answers), "named_or_warned": rate(honest, len(chosen))}
        for name in sorted({names_of(labels[c])[0] for c in chosen}):
            out[f"{kind} {name}"] = tally([c for c in chosen if names_of(labels[c])[0] == name], labels, answers)
    return out


def multi_axis(labels, answers):
    out = {"axes": 0, "named": 0, "false_common_mode": 0}
    for c, label in labels.items():
        if label["kind"] != "multi_axis":
            continue
        for axis, effects in label["effects_by_axis"].items():
            read = reading(answers[c], axis)
            out["axes"] += 1
            out["named"] += bool(read["names"]) and read["names"][0] == effects[0]["name"]
            out["false_common_mode"] += "common_mode" in read["names"]
    out["top1"] = rate(out.pop("named"), out["axes"])
    shared = [c for c, l in labels.items() if l["kind"] == "between_axes"]
    hits = sum(any("common_mode" in reading(answers[c], a)["candidates"] for a in ("gx_dph", "gy_dph")) for c in shared)
    out["common_mode"] = rate(hits, len(shared))
    return out


# ---- how far ----------------------------------------------------------------------------------------------

def closure(labels, answers):
    """Reported held-out gain over the oracle's (true effect, true parameters), per strength."""
    values = defaultdict(list)
    detail = {}
    for c, label in labels.items():
        gains = (label.get("oracle") or {}).get("gx_dph")
        if label["kind"] not in ("single", "pair") or not gains or names_of(label)[0] == "bias_step":
            continue
        entry = reading(answers[c])["entry"]
        gap = (entry or {}).get("gap") or {}
        best = sum(gains["nominal"]) - sum(gains["true"])
        if gap.get("before") is None or gap.get("after") is None or best < 10:
            continue
        value = (gap["before"] - gap["after"]) * gains["hours"] / best
        values[(label["kind"], label["target"])].append(value)
        detail[c] = value
    table = {}
    for (kind, d), v in sorted(values.items()):
        v = np.array(v)
        table[f"{kind} d={d:g}"] = {"n": v.size, "median": float(np.median(v)),
                                    "quartiles": [float(q) for q in np.quantile(v, [0.25, 0.75])]}
    return table, detail


def parameter_coverage(labels, answers, level=1.96):
    """Share of named single effects whose true parameters lie within 1.96 stated standard errors."""
    counts = defaultdict(lambda: [0, 0])
    for c, label in labels.items():
        if label["kind"] != "single" or label["effects"][0]["name"] in OUTPUT + ("bias_step",):
            continue
        effect = label["effects"][0]
        if "_mixture" in effect["parameters"]:
            continue  # two widths: no single true value
        entry = reading(answers[c])["entry"]
        for said in (entry or {}).get("effects") or []:
            if said["name"] != effect["name"]:
                continue
            for key, error in (said.get("std_errors") or {}).items():
                truth = effect["parameters"].get(key)
                if isinstance(error, (int, float)) and error > 0 and isinstance(truth, (int, float)):
                    off = abs(said["parameters"][key] - truth) / error
                    if key.startswith("amplitude") and effect["name"] in ("sinusoid", "telegraph_noise"):
                        off = abs(abs(said["parameters"][key]) - abs(truth)) / error
                    for name in ("all", f"{effect['name']}.{key}"):
                        counts[name][0] += off <= level
                        counts[name][1] += 1
    return {k: rate(*v) for k, v in sorted(counts.items())}


def cost(answers, labels):
    """CPU seconds per axis once the nulls are in the cache, and of the first call of each group."""
    per_axis, first, rss, seen = [], [], [], set()
    for c, label in labels.items():
        answer = answers.get(c)
        if not answer or answer["status"] not in (0, 1):
            continue
        rss.append(answer.get("rss_mb", 0.0))
        n_axes = max(len(answer["diagnosis"].get("axes", [])), 1)
        per_axis.append((answer["cpu_s"] / n_axes, label["group"], n_axes))
    quick = []
    for group in {g for _, g, _ in per_axis}:
        times = [t for t, g, _ in per_axis if g == group]
        typical = np.median(times)
        quick += [t for t in times if t <= 10 * typical + 1]
        first += [t for t in times if t > 10 * typical + 1]
        seen.add(group)
    q = lambda v, p: float(np.quantile(v, p)) if len(v) else None
    return {"cpu_s_per_axis_median": q(quick, 0.5), "cpu_s_per_axis_p95": q(quick, 0.95),
            "calls_with_calibration": len(first), "calibration_cpu_s_median": q(first, 0.5),
            "rss_mb_median": q(rss, 0.5), "groups": len(seen)}


def failures(answers):
    return [{"case": c, "status": a["status"], "error": a.get("error", "")} for c, a in answers.items()
            if a["status"] not in (0, 1) or "diagnosis" not in a]


def shape_problems(answers):
    """Where an answer does not have the shape of design 1.6."""
    problems = Counter()
    for answer in answers.values():
        d = answer.get("diagnosis")
        if not d:
            continue
        for key in ("imucal_diagnosis", "model", "logs", "false_alarm_rate", "seed", "axes"):
            problems[f"top level: no {key}"] += key not in d
        for entry in d.get("axes", []):
            for key in ("axis", "verdict", "effects", "not_detectable_here", "indistinguishable", "advice", "gap"):
                problems[f"axis: no {key}"] += key not in entry
            problems["verdict outside the contract"] += entry.get("verdict") not in (
                "no_gap", "explained", "partly_explained", "unexplained")
            if entry.get("verdict") == "no_gap":
                problems["no_gap with effects"] += bool(entry.get("effects"))
            for effect in entry.get("effects") or []:
                for key in ("name", "parameters", "evidence_nats", "set"):
                    problems[f"effect: no {key}"] += key not in effect
                first = (effect.get("set") or [{}])[0].get("name")
                problems["winner is not first in its set"] += first != effect.get("name")
            gap = entry.get("gap") or {}
            if gap.get("shrinkage") is not None and gap.get("ci95"):
                lo, hi = gap["ci95"]
                problems["shrinkage outside its own interval"] += not lo <= gap["shrinkage"] <= hi
    return {k: v for k, v in problems.items() if v}


def everything(labels, answers):
    closures, detail = closure(labels, answers)
    return {"single": singles(labels, answers), "confusion": confusion(labels, answers), "pair": pairs(labels, answers),
            "gap_free": gap_free(labels, answers), "withheld": withheld(labels, answers),
            "up_only": up_only(labels, answers), "multi_axis": multi_axis(labels, answers), "closure": closures,
            "closure_by_case": detail, "parameter_coverage": parameter_coverage(labels, answers),
            "cost": cost(answers, labels), "failures": failures(answers), "shape_problems": shape_problems(answers)}
