# SPDX-License-Identifier: MIT
"""Labels against answers: every line of what the program must show, with exact intervals.

A name is right as a *member*; where the profile cannot tell the member (label `can_tell_member`), also as its family, or
as another member of that family whose set holds the truth.  `noise_parameters` is a true remark wherever the believed noise
is not the true one, so it is not counted as a name there.
"""
from __future__ import annotations

from collections import Counter
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from . import causes, gauge, truth
from . import outside as outside_causes
from .intervals import rate

KNOWN = ("exact",)
WITHOUT_MODEL = ("absent", "data_sheet")
ONE_PROCESS = ("fitted", *WITHOUT_MODEL)  # believed noise that holds one Markov process at most
STEPS_D = 2.0  # a name takes about 10 nats, d 4.5: chance alone gives that 2000 times less often than beside a d of 2
SLACK = 0.02  # of the true reduction: polynomial of the shown temperature, start states, block means
UNIT_TO_MEASURE = (("deviance", "deviance"), ("rms", "rms"), ("dph", "power"))


# ---- reading ----------------------------------------------------------------------------------------------

def entry_of(answer, axis):
    for entry in (answer.get("diagnosis") or {}).get("axes", []):
        if entry.get("axis") == axis:
            return entry
    return None


def key_of(label, k, axis):
    return f"{label['case']}_{k}/{axis}"


def is_family(name):
    return name in causes.FAMILIES and name not in causes.FAMILY_OF


def family_of(name):
    return name if name in causes.FAMILIES else causes.FAMILY_OF.get(name)


def reading(answer, axis, regime, keep_tuning=False):
    """{"entry", "verdict", "effects", "names"}: re-tuned noise is left out where believed noise is not exact."""
    entry = entry_of(answer, axis)
    if answer["status"] not in (0, 1) or entry is None:
        return {"entry": None, "verdict": "failed", "effects": [], "names": [], "first": None, "tuned": False}
    effects = entry.get("effects") or []
    kept = effects if keep_tuning or regime in KNOWN else [e for e in effects if e["name"] != "noise_parameters"]
    names = [e["name"] for e in kept]
    return {"entry": entry, "verdict": entry.get("verdict"), "effects": kept, "names": names, "first": kept[0] if kept else None,
            "tuned": len(kept) < len(effects)}


def set_of(effect):
    return [s["name"] for s in effect.get("set") or []] + [effect["name"]]


def holds(effect, name):
    """The effect's set (or its family) does not exclude a cause."""
    return name in set_of(effect) or is_family(effect["name"]) and not effect.get("set") and family_of(name) == effect["name"]


def match(effect, name):
    """member, family (said as such), sibling (another member), or None."""
    if effect["name"] == name or is_family(effect["name"]) and causes.FAMILIES[effect["name"]] == (name,):
        return "member"
    if family_of(effect["name"]) != causes.FAMILY_OF.get(name):
        return None
    return "family" if is_family(effect["name"]) else "sibling"


def outcome(read, name, told):
    """What one question about a single cause brought."""
    if read["verdict"] == "failed":
        return "failed"
    if read["first"] is None:
        return "no_gap" if read["verdict"] == "no_gap" else "noise_alone" if read["verdict"] == "explained" else "abstains"
    kind = match(read["first"], name)
    if kind == "member":
        return "member"
    if kind and not told.get("can_tell_member", True) and (kind == "family" or holds(read["first"], name)):
        return "family_right"
    if kind:
        return "family_though_tellable" if kind == "family" else "sibling"
    return "other_first" if any(holds(e, name) for e in read["effects"]) else "wrong"


RIGHT = ("member", "family_right")
SAME_FAMILY = RIGHT + ("family_though_tellable", "sibling")


def in_set(read, name):
    return any(holds(e, name) for e in read["effects"])


def questions(labels, answers, kinds):
    """(label, axis, k, regime, answer) of all answered questions of some kinds; one axis: the sick one or the only one."""
    for case, label in labels.items():
        if label["kind"] in kinds:
            for k, regime in enumerate(label["regimes"]):
                if f"{case}_{k}" in answers:
                    axis = (label["sick"] or list(label["truth"]))[0]
                    yield label, axis, k, regime, answers[f"{case}_{k}"]


# ---- tables -----------------------------------------------------------------------------------------------

def tally(rows):
    """rows: (outcome, in set) -> counts and rates."""
    n, c = len(rows), Counter(o for o, _ in rows)
    return {**c, "n": n, "first": rate(sum(c[o] for o in RIGHT), n), "member": rate(c["member"], n),
            "family": rate(sum(c[o] for o in SAME_FAMILY), n), "set": rate(sum(s for _, s in rows), n)}


def group_by(items, key):
    out = {}
    for item in items:
        out.setdefault(str(key(item)), []).append(item)
    return dict(sorted(out.items()))


def single_rows(labels, answers, kinds=("single",)):
    out = []
    for label, axis, k, regime, answer in questions(labels, answers, kinds):
        name, told, read = label["truth"][axis][0], label["told"][axis][0], reading(answer, axis, regime)
        if name in causes.SLOW and not read["names"]:  # re-tuned noise is of that family
            read = reading(answer, axis, regime, keep_tuning=True)
        out.append({"key": key_of(label, k, axis), "label": label, "name": name, "d": label["target"], "regime": regime, "told": told, "read": read,
                    "outcome": outcome(read, name, told), "set": in_set(read, name)})
    return out


def tallies(rows, key):
    return {k: tally([(r["outcome"], r["set"]) for r in v]) for k, v in group_by(rows, key).items()}


def is_decidable(row):
    """The logs can tell a single cause from other families and from what is believed of the noise.

    Where the noise is fitted to the same logs, absent or a data sheet's, slow noise is a gap only as far as one process with
    parameters of its own does not hold it: strength counts over the fitted nominal model.
    """
    told = row["told"]
    is_swallowed = row["name"] in causes.SLOW and row["regime"] in ONE_PROCESS and told.get("d_noise", np.inf) < gauge.TELL
    return told.get("can_tell_family", True) and not is_swallowed


def singles(labels, answers):
    rows = single_rows(labels, answers)
    strong = [r for r in rows if r["d"] >= 10]
    decidable = [r for r in rows if is_decidable(r)]
    return {"by_strength": tallies(rows, lambda r: f"{r['d']:02.0f}"), "by_strength_decidable": tallies(decidable, lambda r: f"{r['d']:02.0f}"),
            "d20_up": tallies([r for r in rows if r["d"] >= 20], lambda r: "all"),
            "d20_up_decidable": tallies([r for r in decidable if r["d"] >= 20], lambda r: "decidable"),
            "by_cause": tallies(strong, lambda r: r["name"]), "by_regime": tallies(strong, lambda r: r["regime"]),
            "by_profile": tallies(strong, lambda r: r["label"]["profile"]), "by_logs": tallies(strong, lambda r: r["label"]["n_train"]),
            "structural": structural(labels, answers)}


def structural_rows(labels, answers):
    return [any(e["name"] == label["truth"][axis][0] for e in reading(a, axis, regime)["effects"])
            for label, axis, _, regime, a in questions(labels, answers, ("structural",))]


def structural(labels, answers):
    hits = structural_rows(labels, answers)
    return rate(sum(hits), len(hits))


def memory(labels, answers):
    """Hysteresis and lag with random starts in each regime of believed noise."""
    rows = single_rows(labels, answers, ("memory",))
    return {"by_regime": tallies(rows, lambda r: r["regime"]), "by_cause": tallies(rows, lambda r: r["name"]),
            "by_mechanism": tallies(rows, lambda r: mechanism(r["label"])),
            "beside_structure": tallies(single_rows(labels, answers, ("beside",)), lambda r: r["label"]["beside"])}


def mechanism(label):
    for found in label["causes"].values():
        for cause in found:
            return cause["p"].get("_kind", cause["name"])
    return "none"


def invariance_rows(labels, answers):
    """Same logs, four believed noises: is the same repeatable cause named?"""
    out = []
    rows = single_rows(labels, answers, ("memory", "invariance"))
    for case, group in group_by(rows, lambda r: r["label"]["case"]).items():
        group = [r for r in group if r["regime"] in ("exact", "times_3", "over_3", "fitted")]
        if len(group) < 4:
            continue
        names = [r["read"]["first"]["name"] if r["read"]["first"] else r["read"]["verdict"] for r in group]
        families = [family_of(x) or x for x in names]
        told = group[0]["told"].get("can_tell_member", True)
        is_same = len(set(names)) == 1 or not told and len(set(families)) == 1
        out.append({"case": case, "truth": group[0]["name"], "d": group[0]["d"], "first_names": dict(zip((r["regime"] for r in group), names)),
                    "same": is_same, "same_family": len(set(families)) == 1, "same_and_right": is_same and all(r["outcome"] in RIGHT for r in group)})
    return out


def invariance(labels, answers):
    rows = invariance_rows(labels, answers)
    return {**{key: rate(sum(r[key] for r in rows), len(rows)) for key in ("same", "same_family", "same_and_right")},
            "detail": [{key: r[key] for key in ("case", "truth", "d", "first_names")} for r in rows]}


def tells_each(told):
    """The logs can tell each of two causes where the other one is known; None where the label says nothing of it.

    Re-tuned noise is no name beside another cause, so slow noise must be more than that.
    """
    if not all({"can_tell_family", "d_noise"} <= set(t) for t in told):
        return None
    return all(t["can_tell_family"] and t["d_noise"] >= gauge.TELL for t in told)


def pair_rows(labels, answers):
    rows = []
    for label, axis, k, regime, answer in questions(labels, answers, ("pair",)):
        want, read = label["truth"][axis], reading(answer, axis, regime)
        strict = set(want) <= set(read["names"])
        kinds = [[match(e, w) if match(e, w) in ("member", "family") or match(e, w) and holds(e, w) else None for e in read["effects"]]
                 for w in want]
        loose = any(kinds[0][i] and kinds[1][j] for i in range(len(kinds[0])) for j in range(len(kinds[0])) if i != j)
        one = any(w in read["names"] for w in want)
        repeatable = all(w in causes.REPEATABLE for w in want)
        rows.append({"key": key_of(label, k, axis), "d": label["target"], "tell": tells_each(label["told"][axis]), "repeatable": repeatable,
                     "both": strict, "both_or_family": strict or loose, "exactly": strict and len(read["names"]) == 2, "one": one})
    return rows


def pairs(labels, answers):
    out, rows = {}, pair_rows(labels, answers)
    for name, keep in {"all": lambda r: True, "repeatable + repeatable": lambda r: r["repeatable"],
                       "repeatable + noise": lambda r: not r["repeatable"], "d = 25": lambda r: r["d"] == 25, "d = 40": lambda r: r["d"] == 40,
                       "of which the logs can tell each": lambda r: r["tell"]}.items():
        part = [r for r in rows if keep(r)]
        out[name] = {key: rate(sum(r[key] for r in part), len(part)) for key in ("both", "both_or_family", "exactly", "one")}
    return out


def second_process(label, regime, read):
    """(is a second process left out of the belief, is it what the answer names).

    Some devices have two Markov processes.  Where one at most is believed, the second is really left out, and slow noise whose
    set holds it is a true remark.  It is counted as a name all the same, and again as `there`.
    """
    is_left_out = regime in ONE_PROCESS and len(label["noise"]["markov"]) > 1
    is_told = all(family_of(e["name"]) == "slow_noise" and holds(e, "second_markov") for e in read["effects"])
    return is_left_out, is_left_out and bool(read["names"]) and is_told


def steps_of_thermometer(label, axis, read):
    """Does the answer name the steps of a thermometer that the device has, and nothing else, where they and not chance made it?

    Labels of older draws lack `d_steps`; there the name counts as false.
    """
    is_it = lambda e: (e["name"] == "temperature_sensor_quantization"
                       and abs(e["parameters"].get("lsb_degc", 0.0) - label["lsb_degc"]) < 0.02 * label["lsb_degc"])
    return label.get("d_steps", {}).get(axis, 0.0) >= STEPS_D and bool(read["effects"]) and all(is_it(e) for e in read["effects"])


def is_there(label, axis, regime, read):
    """(is a second process left out of the belief, is what the answer names no sick axis's cause and there all the same)."""
    is_left_out, is_second = second_process(label, regime, read)
    return is_left_out, is_second or steps_of_thermometer(label, axis, read)


def gap_free_rows(labels, answers):
    """Names and gaps where there is none."""
    rows = []
    for label, axis, k, regime, answer in questions(labels, answers, ("no_gap", "constant")):
        read = reading(answer, axis, regime)
        is_left_out, there = is_there(label, axis, regime, read)
        rows.append({"key": key_of(label, k, axis), "regime": regime, "kind": label["kind"], "name": bool(read["names"]),
                     "names": read["names"], "left_out": is_left_out, "there": there,
                     "gap": read["verdict"] not in ("no_gap", "failed") and not (read["tuned"] and read["verdict"] == "explained" and not read["names"]),
                     "failed": read["verdict"] == "failed", "tuned": read["tuned"]})
    return rows


def false_names(labels, answers):
    """Names and gaps where there is none; per regime."""
    rows = gap_free_rows(labels, answers)
    table = lambda part: {"tuned": rate(sum(r["tuned"] for r in part), len(part)), "names": rate(sum(r["name"] for r in part), len(part)),
                          "gap": rate(sum(r["gap"] for r in part), len(part)), "failed": sum(r["failed"] for r in part),
                          "there": sum(r["there"] for r in part),
                          "not_there": rate(sum(r["name"] and not r["there"] for r in part), len(part))}
    out = {"all": table([r for r in rows if r["kind"] == "no_gap"])}
    out.update({k: table(v) for k, v in group_by([r for r in rows if r["kind"] == "no_gap"], lambda r: r["regime"]).items()})
    for title, left_out in (("noise that the belief can hold", False), ("a second process left out of the belief", True)):
        out[title] = table([r for r in rows if r["kind"] == "no_gap" and r["left_out"] == left_out])
    out["constant temperature"] = table([r for r in rows if r["kind"] == "constant"])
    return {"table": out, "named": Counter(n for r in rows for n in r["names"])}


GOOD_OUTSIDE = ("abstains", "family_only")


def outside_outcome(read, families, cause):
    names = read["names"]
    if read["verdict"] in ("failed", "no_gap"):
        return read["verdict"]
    if not names:
        return "noise_alone" if read["verdict"] == "explained" else "abstains"
    allowed = lambda n: is_family(n) and n in families or causes.FAMILIES.get(families[0] if families else "") == (n,)
    if all(allowed(n) for n in names):
        return "family_only"
    if read["verdict"] in ("partly_explained", "unexplained"):
        return "partly" if all(family_of(n) in families for n in names) else "names_wrong_but_says_more"
    return "misnamed"


def tells_library(told):
    """No member of the library comes near an outside cause (labels of older draws say it by two fields)."""
    return told.get("can_tell_library", told.get("can_tell_family", True) and told.get("can_tell_member", True))


def outside_rows(labels, answers):
    rows = []
    for label, axis, k, regime, answer in questions(labels, answers, ("outside",)):
        cause, families = label["truth"][axis][0], [f for f in label["families"][axis][0] if f]
        read = reading(answer, axis, regime)
        how = outside_outcome(read, families, cause)
        no_member = how in GOOD_OUTSIDE or bool(read["names"]) and all(map(is_family, read["names"]))
        rows.append({"key": key_of(label, k, axis), "d": label["target"], "cause": cause, "regime": regime, "outcome": how,
                     "no_member": no_member, "names": read["names"], "tell": tells_library(label["told"][axis][0])})
    return rows


def outside(labels, answers):
    rows = outside_rows(labels, answers)

    def table(part):
        c = Counter(r["outcome"] for r in part)
        return {"n": len(part), "good": rate(sum(c[o] for o in GOOD_OUTSIDE), len(part)),
                "no_member": rate(sum(r["no_member"] for r in part), len(part)), **c}

    return {"by_strength": {k: table(v) for k, v in group_by(rows, lambda r: f"{r['d']:02.0f}").items()},
            "by_strength_tellable": {k: table(v) for k, v in group_by([r for r in rows if r["tell"]], lambda r: f"{r['d']:02.0f}").items()},
            "by_cause": {k: table(v) for k, v in group_by([r for r in rows if r["d"] >= 20], lambda r: r["cause"]).items()},
            "named": {k: Counter(n for r in v for n in r["names"]) for k, v in group_by(rows, lambda r: r["cause"]).items()}}


def axis_rows(labels, answers):
    """Several axes: healthy ones beside a sick one, and a cause that all share."""
    rows = []
    for label, _, k, regime, answer in questions(labels, answers, ("healthy", "pooled")):
        for axis, causes_here in label["truth"].items():
            read = reading(answer, axis, regime)
            good = outcome(read, causes_here[0], label["told"][axis][0]) in RIGHT if causes_here else not read["names"]
            what = "healthy" if not causes_here else "sick" if label["kind"] == "healthy" else "shared"
            is_left_out, there = is_there(label, axis, regime, read)
            rows.append({"key": key_of(label, k, axis), "what": what, "right": good, "names": read["names"], "left_out": is_left_out,
                         "there": there})
    return rows


def axes(labels, answers):
    rows = axis_rows(labels, answers)
    part = {what: [r for r in rows if r["what"] == what] for what in ("healthy", "sick", "shared")}
    first = lambda what: rate(sum(r["right"] for r in part[what]), len(part[what]))
    held = [r for r in part["healthy"] if not r["left_out"]]
    return {"healthy_false": rate(sum(not r["right"] for r in part["healthy"]), len(part["healthy"])),
            "healthy_false_held": rate(sum(not r["right"] for r in held), len(held)), "healthy_there": sum(r["there"] for r in part["healthy"]),
            "healthy_not_there": rate(sum(not r["right"] and not r["there"] for r in part["healthy"]), len(part["healthy"])),
            "healthy_named": Counter(n for r in part["healthy"] for n in r["names"]), "sick_first": first("sick"), "pooled_first": first("shared")}


def confusion(labels, answers):
    out = {}
    for r in single_rows(labels, answers, ("single", "memory", "invariance", "beside")):
        if r["d"] >= 10:
            said = r["read"]["first"]["name"] if r["read"]["first"] else f"({r['outcome']})"
            out.setdefault(r["name"], Counter())[said] += 1
    return {k: dict(v.most_common()) for k, v in sorted(out.items())}


def rights(labels, answers):
    """{kind of question: {question: right as the summary counts it}}: what two programs are paired by."""
    out = {}

    def put(rows, right, kind):
        for r in rows:
            out.setdefault(kind(r), {})[r.get("key") or r["case"]] = bool(right(r))

    by_strength = lambda rows: sorted(rows, key=lambda r: r["d"])
    gap_free = gap_free_rows(labels, answers)
    put(by_strength(single_rows(labels, answers)), lambda r: r["outcome"] in RIGHT, lambda r: f"one cause, d = {r['d']:g}: named first")
    put(pair_rows(labels, answers), lambda r: r["both"], lambda r: "pairs: both as members")
    put(pair_rows(labels, answers), lambda r: r["both_or_family"], lambda r: "pairs: both, member or family")
    put(by_strength(outside_rows(labels, answers)), lambda r: r["outcome"] in GOOD_OUTSIDE,
        lambda r: f"outside causes, d = {r['d']:g}: abstains or right family only")
    put(sorted(single_rows(labels, answers, ("memory",)), key=lambda r: r["regime"]), lambda r: r["outcome"] in SAME_FAMILY,
        lambda r: f"hysteresis and lag, noise {r['regime']}: first")
    put(invariance_rows(labels, answers), lambda r: r["same"], lambda r: "invariance: same cause under four believed noises")
    put([r for r in gap_free if r["kind"] == "no_gap"], lambda r: not r["name"], lambda r: "no gap: no name")
    put([r for r in gap_free if r["kind"] == "constant"], lambda r: not r["name"], lambda r: "constant temperature: no name")
    titles = {"healthy": "healthy axes beside a sick one: no name", "sick": "sick axis beside healthy ones: named first",
              "shared": "one cause on three axes: named first, per axis"}
    put(sorted(axis_rows(labels, answers), key=lambda r: list(titles).index(r["what"])), lambda r: r["right"], lambda r: titles[r["what"]])
    return out


# ---- shrinkage --------------------------------------------------------------------------------------------

def claims_of(labels, answers):
    """[(label, [(key, axis, effects, has_model)])] of everything with an answer whose truth can be worked out."""
    out = []
    for case, label in labels.items():
        claims = []
        for k, _ in enumerate(label["regimes"]):
            for axis in label["truth"]:
                entry = entry_of(answers.get(f"{case}_{k}", {}), axis)
                noise_only = label["truth"][axis] and not any(n in causes.MEAN or n in outside_causes.SIGNALS for n in label["truth"][axis])
                if noise_only and label["regimes"][k] not in KNOWN:
                    continue  # what the gap of a noise is before, hangs on the noise that is believed
                if entry is not None and label["kind"] not in ("structural", "beside", "constant"):
                    claims.append((f"{case}_{k}", axis, entry.get("effects") or [], label["regimes"][k] not in WITHOUT_MODEL))
        if claims:
            out.append((label, claims))
    return out


def measure_of(unit):
    return next((m for word, m in UNIT_TO_MEASURE if word in (unit or "deviance")), "deviance")


def covered(gap, true):
    """(claims something, covered, claimed value, true value) of one verdict."""
    said, ci = gap.get("shrinkage"), gap.get("ci95")
    value = 0.0 if true.get("no_gap") else float(np.clip(true[measure_of(gap.get("unit"))], -1, 1))
    if said is None:
        return False, True, None, value
    lo, hi = ci if ci and None not in ci else (said, said)
    return True, lo - SLACK <= value <= hi + SLACK, said, value


def shrinkage(labels, answers, processes):
    trues = {}
    tasks = claims_of(labels, answers)
    with ProcessPoolExecutor(processes) as pool:
        for part in pool.map(truth.judge, tasks, chunksize=2):
            trues.update(part)
    rows, skipped = [], Counter()
    for label, claims in tasks:
        for key, axis, *_ in claims:
            true, entry = trues[f"{key}/{axis}"], entry_of(answers[key], axis)
            if "unscorable" in true:
                skipped[true["unscorable"].split(":")[0]] += 1
                continue
            gap = entry.get("gap") or {}
            claims_it, ok, said, value = covered(gap, true)
            grew = true["rms_after_dph"] > 1.02 * true["rms_before_dph"] + 0.1
            rows.append({"kind": label["kind"], "verdict": entry.get("verdict"), "claims": claims_it, "ok": ok, "said": said, "true": value,
                         "regime": label["regimes"][int(key.rsplit("_", 1)[1])], "names": [e["name"] for e in entry.get("effects") or []],
                         "over": said is not None and said - value > 0.3, "grew": bool(grew), "key": key, "axis": axis, **true})
    return {"tables": shrinkage_tables(rows), "skipped": skipped, "rows": rows}


def shrinkage_tables(rows):
    def table(part):
        claiming = [r for r in part if r["claims"]]
        said = [r["said"] for r in claiming]
        return {"all": rate(sum(r["ok"] for r in part), len(part)), "claiming": rate(sum(r["ok"] for r in claiming), len(claiming)),
                "over_claimed": rate(sum(r["over"] for r in claiming), len(claiming)),
                "explained_but_grew": rate(sum(r["grew"] and r["verdict"] == "explained" for r in part), sum(r["verdict"] == "explained" for r in part)),
                "median_said": float(np.median(said)) if said else None,
                "median_true": float(np.median([r["true"] for r in claiming])) if claiming else None}
    return {"all verdicts": table(rows), **{f"kind: {k}": table(v) for k, v in group_by(rows, lambda r: r["kind"]).items()},
            **{f"verdict: {k}": table(v) for k, v in group_by(rows, lambda r: r["verdict"]).items()},
            **{f"believed noise: {k}": table(v) for k, v in group_by(rows, lambda r: r["regime"]).items()}}


# ---- cost, failures ---------------------------------------------------------------------------------------

def cost(labels, answers):
    quiet, gap, memory_mb = [], [], []
    for case, label in labels.items():
        for k, _ in enumerate(label["regimes"]):
            answer = answers.get(f"{case}_{k}")
            if not answer or answer.get("cpu_s") is None or answer["status"] not in (0, 1):
                continue
            found = any(e.get("effects") for e in (answer.get("diagnosis") or {}).get("axes", []))
            (gap if found else quiet).append(answer["cpu_s"] / label["n_axes"])
            memory_mb.append(answer.get("rss_mb") or 0)
    figures = lambda v: {"n": len(v), "median_s": float(np.median(v)) if v else None, "p95_s": float(np.quantile(v, 0.95)) if v else None}
    return {"without_names": figures(quiet), "with_names": figures(gap), "rss_mb_max": max(memory_mb, default=0)}


def failures(answers):
    return [{"case": k, "status": a["status"], "error": a.get("error", "")} for k, a in answers.items()
            if a["status"] not in (0, 1) or "diagnosis" not in a]


def shape_problems(answers):
    """Departures from the contract of the JSON (old and new form)."""
    problems = Counter()
    for answer in answers.values():
        for entry in (answer.get("diagnosis") or {}).get("axes", []):
            for key in ("axis", "verdict", "where", "effects", "gap", "advice"):
                problems[f"axis entry: no {key}"] += key not in entry
            problems["verdict outside the contract"] += entry.get("verdict") not in ("no_gap", "explained", "partly_explained", "unexplained")
            problems["no_gap with effects"] += entry.get("verdict") == "no_gap" and bool(entry.get("effects"))
            for effect in entry.get("effects") or []:
                problems["effect: unknown name"] += family_of(effect.get("name")) is None
                for key in ("name", "parameters", "evidence_nats", "set"):
                    problems[f"effect: no {key}"] += key not in effect
                problems["effect: another family than the contract's"] += "family" in effect and effect["family"] != family_of(effect["name"])
            gap = entry.get("gap") or {}
            if gap.get("shrinkage") is not None and gap.get("ci95") and None not in gap["ci95"]:
                problems["shrinkage outside its own interval"] += not gap["ci95"][0] - 1e-9 <= gap["shrinkage"] <= gap["ci95"][1] + 1e-9
            problems["unexplained with a shrinkage"] += entry.get("verdict") == "unexplained" and gap.get("shrinkage") is not None
    return {k: v for k, v in problems.items() if v}


def there(label, axis, regime):
    """What was there, in words."""
    strengths = "/".join("-" if d is None else f"{d:.0f}" for d in label["d"].get(axis, []))
    return (f"{label['kind']} {'+'.join(label['truth'][axis]) or 'no gap'} d={strengths or '-'} {label['profile']} "
            f"{label['n_train']} logs, {regime}")


def said(answer, axis, regime):
    """What was said, in words: verdict, names and what stands in their sets."""
    read = reading(answer, axis, regime, keep_tuning=True)
    sets = "; ".join(f"{e['name']} [{', '.join(s['name'] for s in e.get('set') or [])}]" for e in read["effects"]) or "no name"
    return f"{read['verdict']}: {sets}"


def every_question(labels, answers):
    """One line for each question and sick (or only) axis: what was there, what was said."""
    lines = []
    for label, axis, k, regime, answer in questions(labels, answers, {label["kind"] for label in labels.values()}):
        lines.append(f"{label['case']}_{k} {there(label, axis, regime)}: {said(answer, axis, regime)}")
    return sorted(lines, key=lambda x: x.split(" ", 1)[1])


def everything(labels, answers, processes=1, redraw=True):
    return {"single": singles(labels, answers), "memory": memory(labels, answers), "invariance": invariance(labels, answers),
            "pair": pairs(labels, answers), "false_names": false_names(labels, answers), "outside": outside(labels, answers),
            "axes": axes(labels, answers), "confusion": confusion(labels, answers),
            "shrinkage": shrinkage(labels, answers, processes) if redraw else None, "cost": cost(labels, answers),
            "failures": failures(answers), "shape_problems": shape_problems(answers)}
