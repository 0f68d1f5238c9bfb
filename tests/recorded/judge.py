# SPDX-License-Identifier: MIT
"""One row against the answers under every believed noise."""
from __future__ import annotations

from blind import causes
from blind.score import entry_of, family_of

HONEST_SLACK = 0.15  # between claimed shrinkage and what the held-out rms shows, as a share


def names_of(entry):
    return [e["name"] for e in entry.get("effects") or []]


def said(entry):
    """Names, what their sets hold, and the families of the names."""
    out = set(names_of(entry))
    for effect in entry.get("effects") or []:
        out |= {s["name"] for s in effect.get("set") or []} if effect.get("set") and effect["name"] in causes.FAMILIES else set()
    return out


def first_cause(entry):
    """First name but for re-tuned noise, which is a remark; the verdict where there is none."""
    names = [n for n in names_of(entry) if n != "noise_parameters"]
    return names[0] if names else f"({entry.get('verdict')})"


def families_left_open(entry):
    """Families that one effect's set, or one line of `indistinguishable`, holds together."""
    groups = [[s["name"] for s in e.get("set") or []] + [e["name"]] for e in entry.get("effects") or []]
    groups += entry.get("indistinguishable") or []
    return [{family_of(n) for n in g if family_of(n)} for g in groups]


def honest(entry):
    """Claimed shrinkage against rms before and after on held-out data: shrinkage s leaves at most sqrt(1 - s) of the rms that
    is not noise; without the noise floor in the file: the residual must not grow, and a claim above one half must show."""
    gap = entry.get("gap") or {}
    claim, rms = gap.get("shrinkage"), gap.get("residual_rms_dph") or {}
    if claim is None or rms.get("before") is None or rms.get("after") is None:
        return None
    part = 1 - (rms["after"] / max(rms["before"], 1e-9)) ** 2
    if rms["after"] > 1.02 * rms["before"]:
        return f"residual grows {rms['before']:.0f} -> {rms['after']:.0f} dph beside a claim of {claim:.2f}"
    if claim > 0.5 and claim - part > 0.5 + HONEST_SLACK:
        return f"claims {claim:.2f}, held-out rms {rms['before']:.0f} -> {rms['after']:.0f} dph"
    return None


def one(row, answer):
    """Complaints about one answer (empty: holds)."""
    entry = entry_of(answer, row.axis)
    if answer["status"] not in (0, 1) or entry is None:
        return [f"no answer (exit {answer['status']}): {answer.get('error', '').strip()[-120:]}"]
    out, names = [], names_of(entry)
    if row.gap and entry.get("verdict") == "no_gap":
        out.append("says no gap")
    for group in row.must:
        if not set(group) & said(entry):
            out.append(f"none of {'/'.join(group[:3])}{'…' if len(group) > 3 else ''}")
    wrong = [n for n in names if n in row.must_not]
    if wrong:
        out.append("names " + ", ".join(wrong))
    if row.open_between and not any(set(row.open_between) <= families for families in families_left_open(entry)):
        out.append("does not leave open " + " or ".join(row.open_between))
    if row.first and names and first_cause(entry) not in row.first:
        out.append(f"first is {first_cause(entry)}")
    if row.honest and honest(entry):
        out.append(honest(entry))
    return out


def judge(row, answers):
    """answers: {believed noise: answer} -> {"row", "holds", "complaints": {noise: [..]}, "got": {noise: text}}."""
    complaints = {k: one(row, a) for k, a in answers.items()}
    got = {k: ", ".join(names_of(entry_of(a, row.axis) or {})) or f"({(entry_of(a, row.axis) or {}).get('verdict', 'no answer')})"
           for k, a in answers.items()}
    if row.invariant:
        firsts = {k: first_cause(entry_of(a, row.axis) or {}) for k, a in answers.items()}
        if len(set(firsts.values())) > 1:
            complaints["all"] = ["first cause changes: " + ", ".join(sorted(set(firsts.values())))]
    return {"row": row.row, "axis": row.axis, "logs": list(row.logs), "sees": row.sees, "holds": not any(complaints.values()),
            "complaints": {k: v for k, v in complaints.items() if v}, "got": got}
