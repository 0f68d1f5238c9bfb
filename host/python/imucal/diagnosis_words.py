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
MUTED, WEAK = "#66727f", "#b7791f"
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
        self.n_logs = len(diagnosis.get("logs") or [])
        self.units = {p["name"]: p.get("unit") or "" for e in self.effects.values() for p in e.get("parameters") or []}

    def label(self, name):
        return self.effects.get(name, {}).get("label") or self.families.get(name) or plain(name)

    def in_words(self, text):
        """The text with names and sizes as people write them: thermal creep for thermal_creep, tau 320 s for tau_s 320."""
        sizes = sorted([n for n, unit in self.units.items() if unit and "_" in n], key=len, reverse=True)
        if sizes:
            text = re.sub(r"\b(" + "|".join(map(re.escape, sizes)) + r") ([+-]?\d[\d.]*(?:e[+-]?\d+)?)(?![\w])",
                          lambda m: self.parameter_text(m[1], float(m[2].rstrip("."))) + "." * m[2].endswith("."), text)
        known = sorted([n for n in [*self.effects, *self.families] if "_" in n], key=len, reverse=True)
        return re.sub(r"\b(" + "|".join(map(re.escape, known)) + r")\b", lambda m: plain(m[0]), text) if known else text

    def hardware_causes(self, name):
        return self.effects.get(name, {}).get("hardware_causes") or []

    def parameter_text(self, name, value, error=None):
        """'width 5.1 ± 0.3 °C' from width_degc = 5.1: the unit is the library's, its ending leaves the name."""
        if isinstance(value, list):
            errors = error if isinstance(error, list) else []
            return f"{plain(name)}: " + "; ".join(
                self.step_text(item, errors[i] if i < len(errors) else {}) if isinstance(item, dict) else number(item)
                for i, item in enumerate(value))
        unit = self.units.get(name, "")
        stem = name
        if unit:  # the ending of the name is the unit, written with underscores: as many words as the label keeps
            for ending in sorted(_endings(self.units), key=len, reverse=True):
                if name.endswith(ending) and len(name) > len(ending):
                    stem = name[: -len(ending)]
                    break
        spread = f" ± {number(error, 2)}" if isinstance(error, (int, float)) else ""
        return f"{plain(stem)} {number(value)}{spread}{' ' + UNIT_TEXT.get(unit, unit) if unit else ''}"

    def step_text(self, item, errors):
        """'amplitude 427.9 ± 62 dph at 93024 s of log 2': logs count from 1 for people."""
        values = {k: v for k, v in item.items() if k not in ("t_s", "log")}
        text = ", ".join(self.parameter_text(k, v, (errors or {}).get(k)) for k, v in values.items())
        text += f" at {number(item['t_s'], 6)} s" if "t_s" in item else ""
        return text + (f" of log {item['log'] + 1}" if "log" in item and self.n_logs != 1 else "")

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
    if where.get("sentence"):  # as the program says it: it knows which of the ranges below are places
        said = where["sentence"].replace("degC", "°C")
        return sentence(said if said.startswith("no ") else f"the gap shows {said}")
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
        parts += ["in every log"] if n_logs > 1 else []
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
    """The one sentence that all figures below have to agree with: as the program says it."""
    if axis.get("statement"):
        return sentence(library.in_words(axis["statement"]))
    title = VERDICTS.get(axis["verdict"], (plain(axis["verdict"]), ""))[0]
    words = cause_words(axis, library)
    if axis.get("refused"):
        return f"No answer: {axis['refused']}"
    if axis["verdict"] == "no_gap":
        hidden = axis.get("not_detectable_here") or []
        return title + (f"; {many(len(hidden), 'effect')} would stay unseen on these profiles" if hidden else "") + "."
    return f"{title}: {words}." if words else f"{title}."


def means_text(gap):
    """What the residuals of a gap are means of."""
    mean_s = gap.get("residual_mean_s") or 60
    return "one-minute means" if round(mean_s) == 60 else f"means over {mean_s:.0f} s"


def size_sentence(axis, loop):
    """What the gap costs, in dph; `loop`: (dph, degC) of the measured branches, or None."""
    rms = (axis.get("gap") or {}).get("residual_rms_dph") or {}
    before, after, noise = rms.get("before"), rms.get("after"), rms.get("noise")
    parts = []
    if loop and axis["verdict"] != "no_gap":
        parts.append(f"Rising and falling temperature differ by up to {number(loop[0], 2)} dph (at {number(loop[1], 2)} °C)")
    if before is not None and axis["verdict"] != "no_gap":
        temps = ((axis.get("plots") or {}).get("residual") or {}).get("temp_degc") or [0]
        off = "the polynomial" if any(t is not None for t in temps) else "their mean"
        quarters = str((axis.get("gap") or {}).get("method", "")).startswith("quarters")
        unseen = "in quarters of the one log, each predicted from the others but for its own constant" if quarters else "on data that were not fitted"
        text = f"{means_text(axis['gap'])} lie {number(before, 2)} dph rms off {off} {unseen}"
        has_mean = (axis.get("gap") or {}).get("has_mean", True)  # else the statement of the gap says what a noise would leave
        if noise is not None and (has_mean or not axis.get("effects")):
            with_found = any(e.get("family") == "slow_noise" for e in axis.get("effects") or [])
            text += f"; {'the noise, with the slow noise found,' if with_found else 'noise alone'} would leave {number(noise, 2)} dph"
        if after is not None and axis.get("effects") and has_mean:
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
    left = str(gap.get("remainder") or "").rstrip(".")
    left = f" Remainder: {left}." if left else ""
    if gap.get("shrinkage") is None:
        if gap.get("stand_in_shrinkage") is not None:
            return f"A flexible stand-in {removes(gap['stand_in_shrinkage'])} on held-out data: that is not an explanation." + left
        said = gap.get("statement") or ""
        return ((said and f"On data that were not fitted{', ' if said.startswith(means_text(gap)) else ': '}{said}.") + left).strip()
    text = f"Adding what was found {removes(gap['shrinkage'])} on held-out data"
    ci = gap.get("ci95")
    if ci and None not in ci:
        sign = 1 if gap["shrinkage"] >= 0 else -1
        lo, hi = sorted(100 * sign * part for part in ci)
        text += f" (95 % interval {lo:.0f} to {hi:.0f} %)"
    return text + "." + left


def in_reading_order(axis):
    """What adds most first, notes last, as the program orders them."""
    effects, order = axis.get("effects") or [], axis.get("reading_order") or []
    return [effects[i] for i in order] if sorted(order) == list(range(len(effects))) else effects


def open_sentences(axis):
    """How sure each name is and what else it may be, as the program says it."""
    effects = in_reading_order(axis)
    if any("remarks" in e for e in effects):
        return [f"{plain(e['name'])}: {remark}" for e in effects for remark in e.get("remarks") or []]
    out = [e["statement"] for e in effects if e.get("statement")]
    for e in effects[:1]:
        rivals = [c["name"] for c in e.get("set") or [] if c["name"] not in (e["name"], e.get("member"))]
        if rivals:
            out.append("These logs cannot exclude " + joined(plain(r) for r in dict.fromkeys(rivals)) + " instead")
    return out


def titled(axis):
    """Badge and colour: the words of the program, those of the verdict where it gives none."""
    words, color = VERDICTS.get(axis["verdict"], (plain(axis["verdict"]), MUTED))
    if axis.get("refused"):  # the verdict is one for want of another
        return "No answer", MUTED
    title = axis.get("title") or words
    return title[0].upper() + title[1:], WEAK if axis.get("is_weak") else color


def chip(axis, library):
    """The headline without what the profiles would not show."""
    return headline(axis, library).split("; not detectable")[0].rstrip(".")
