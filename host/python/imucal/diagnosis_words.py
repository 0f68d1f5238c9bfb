# SPDX-License-Identifier: MIT
"""Words of a diagnosis: numbers with the units that the library of effects gives, and the sentences of the report.

Nothing here knows an effect by its name: labels, units and hardware causes come from the member `library` of the diagnosis,
which is what `diagnose --list-effects --json -` prints.
"""
from __future__ import annotations

import math
import os
import re

VERDICTS = {
    "no_gap": ("No gap found", "#2f855a"),
    "explained": ("Gap explained", "#2b6cb0"),
    "partly_explained": ("Gap partly explained", "#b7791f"),
    "unexplained": ("Gap, cause open", "#c53030"),
}
UNIT_TEXT = {"degC": "°C", "dph per (degC/min)": "dph per °C/min", "deg/sqrt(h)": "°/√h", "dph/sqrt(s)": "dph/√s"}


def number(value, digits=3):
    """Short decimal text; '–' for what is not there."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        if value and (abs(value) >= 1e6 or abs(value) < 1e-3):
            return f"{value:.{digits - 1}e}"
        text = f"{value:.{digits}g}"
        return f"{value:.0f}" if "e" in text else text
    return str(value)


def plain(name):
    return name.replace("_", " ")


def joined(items):
    items = list(items)
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]


def many(n, noun):
    return f"{n} {noun}{'' if n == 1 else 's'}"


def sentence(text):
    """With a capital letter and a stop, as sentences are written."""
    text = text.strip()
    return text if not text else text[0].upper() + text[1:] + ("" if text[-1] in ".!?" else ".")


class Library:
    """Labels, units and hardware causes by the names of effects and families."""

    def __init__(self, diagnosis):
        library = diagnosis.get("library") or {}
        self.effects = {e["name"]: e for e in library.get("effects") or []}
        self.families = {f["name"]: f["label"] for f in library.get("families") or []}
        self.units = {p["name"]: p.get("unit") or "" for e in self.effects.values() for p in e.get("parameters") or []}

    def label(self, name):
        return self.effects.get(name, {}).get("label") or self.families.get(name) or plain(name)

    def in_words(self, text):
        """The text with names of effects and families as people write them: thermal creep for thermal_creep."""
        known = sorted([n for n in [*self.effects, *self.families] if "_" in n], key=len, reverse=True)
        return re.sub(r"\b(" + "|".join(map(re.escape, known)) + r")\b", lambda m: plain(m[0]), text) if known else text

    def hardware_causes(self, name):
        return self.effects.get(name, {}).get("hardware_causes") or []

    def parameter_text(self, name, value, error=None):
        """'width 5.1 ± 0.3 °C' from width_degc = 5.1: the unit is the library's, its ending leaves the name."""
        if isinstance(value, list):
            return f"{plain(name)}: " + "; ".join(
                ", ".join(self.parameter_text(k, v) for k, v in item.items()) if isinstance(item, dict) else number(item)
                for item in value)
        unit = self.units.get(name, "")
        stem = name
        if unit:  # the ending of the name is the unit, written with underscores: as many words as the label keeps
            for ending in sorted(_endings(self.units), key=len, reverse=True):
                if name.endswith(ending) and len(name) > len(ending):
                    stem = name[: -len(ending)]
                    break
        spread = f" ± {number(error, 2)}" if isinstance(error, (int, float)) else ""
        return f"{plain(stem)} {number(value)}{spread}{' ' + UNIT_TEXT.get(unit, unit) if unit else ''}"

    def parameters_text(self, parameters, errors=None):
        return ", ".join(self.parameter_text(k, v, (errors or {}).get(k)) for k, v in (parameters or {}).items())


def _endings(units):
    """Endings that parameters of the same unit share, such as _dph_per_h: found from the names themselves."""
    out = set()
    by_unit = {}
    for name, unit in units.items():
        if unit:
            by_unit.setdefault(unit, []).append(name.split("_"))
    for names in by_unit.values():
        for words in names:
            for k in range(1, len(words)):
                ending = words[k:]
                if all(other[-len(ending):] == ending for other in names):
                    out.add("_" + "_".join(ending))
                    break
    return out


def where_sentence(where, n_logs=0):
    """Where the gap lies, in one sentence; empty if the diagnosis does not say."""
    if not where:
        return ""
    def span(key):  # a pair; no width: there is no such quantity in the logs
        pair = where.get(key)
        return pair if isinstance(pair, list) and len(pair) == 2 and pair[0] != pair[1] else None

    parts = []
    if span("tau_s"):
        parts.append("at averaging times of {} to {} s".format(*map(number, span("tau_s"))))
    if span("temp_degc"):
        parts.append("between {} and {} °C".format(*map(number, span("temp_degc"))))
    if span("time_s"):
        parts.append("from {} to {} s after the start".format(*map(number, span("time_s"))))
    direction = {"up": "while the temperature rises", "down": "while the temperature falls",
                 "soak": "while the temperature rests"}.get(where.get("direction"))
    if direction:
        parts.append(direction)
    logs = where.get("logs") or []
    if logs and len(logs) == n_logs:
        parts.append("in every log")
    elif logs and all(isinstance(log, int) for log in logs):
        parts.append(f"in log{'s' * (len(logs) > 1)} " + joined(str(log + 1) for log in logs))
    elif logs:
        parts.append("in " + joined(os.path.basename(str(log)) for log in logs[:4])
                     + (f" and {len(logs) - 4} more logs" if len(logs) > 4 else ""))
    return "The gap shows " + ", ".join(parts) + "." if parts else ""


def cause_words(axis, library):
    """'hysteresis …; also: …', or what is open."""
    effects = axis.get("effects") or []
    names = [library.label(e["name"]) for e in effects]
    return "; ".join(dict.fromkeys(names))


def headline(axis, library):
    """The one sentence that all figures below have to agree with."""
    title = VERDICTS.get(axis["verdict"], (plain(axis["verdict"]), ""))[0]
    words = cause_words(axis, library)
    if axis.get("refused"):
        return f"No answer: {axis['refused']}"
    if axis["verdict"] == "no_gap":
        hidden = axis.get("not_detectable_here") or []
        return title + (f"; {many(len(hidden), 'effect')} would stay unseen on these profiles" if hidden else "") + "."
    return f"{title}: {words}." if words else f"{title}."


def size_sentence(axis, loop):
    """What the gap costs, in dph; `loop`: (dph, degC) of the measured branches, or None."""
    rms = (axis.get("gap") or {}).get("residual_rms_dph") or {}
    before, after, noise = rms.get("before"), rms.get("after"), rms.get("noise")
    parts = []
    if loop and axis["verdict"] != "no_gap":
        parts.append(f"Rising and falling temperature differ by up to {number(loop[0], 2)} dph (at {number(loop[1], 2)} °C)")
    if before is not None and axis["verdict"] != "no_gap":
        text = f"one-minute means lie {number(before, 2)} dph rms off the polynomial on data that were not fitted"
        if noise is not None:
            text += f"; noise alone would leave {number(noise, 2)} dph"
        if after is not None and axis.get("effects"):
            text += f", with what was found {number(after, 2)} dph remain"
        parts.append(text[0].upper() + text[1:] if not parts else text)
    return "; ".join(parts) + "." if parts else ""


def removes(part):
    """'removes 94 % of the gap', or by how much it is larger then."""
    return f"removes {100 * part:.0f} % of the gap" if part >= 0 else f"makes the gap {-100 * part:.0f} % worse"


def gap_sentence(axis):
    """How far the held-out gap shrinks; a stand-in is called one."""
    gap = axis.get("gap") or {}
    if axis["verdict"] == "no_gap":
        return ""
    if gap.get("shrinkage") is None:
        if gap.get("stand_in_shrinkage") is not None:
            return f"A flexible stand-in {removes(gap['stand_in_shrinkage'])} on held-out data: that is not an explanation."
        return f"On data that were not fitted: {gap['statement']}." if gap.get("statement") else ""
    text = f"Adding what was found {removes(gap['shrinkage'])} on held-out data"
    ci = gap.get("ci95")
    if ci and None not in ci:
        sign = 1 if gap["shrinkage"] >= 0 else -1
        lo, hi = sorted(100 * sign * part for part in ci)
        text += f" (95 % interval {lo:.0f} to {hi:.0f} %)"
    text += "."
    if gap.get("remainder"):
        text += f" Remainder: {str(gap['remainder']).rstrip('.')}."
    return text


def open_sentence(axis, library):
    """What these logs cannot exclude instead of the first name."""
    effects = axis.get("effects") or []
    if not effects:
        return ""
    rivals = [c["name"] for c in effects[0].get("set") or [] if c["name"] not in (effects[0]["name"], effects[0].get("member"))]
    statement = effects[0].get("statement") or ""
    text = f"{statement[0].upper()}{statement[1:]}. " if statement else ""
    if rivals:
        text += "These logs cannot exclude " + joined(plain(r) for r in dict.fromkeys(rivals)) + " instead."
    return text.strip()
