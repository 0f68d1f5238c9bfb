# SPDX-License-Identifier: MIT
"""Words of a diagnosis: numbers with the units that the library of effects gives, and the sentences of the report.

Nothing here knows an effect by its name: labels, units and hardware causes come from the member `library` of the diagnosis,
which is what `diagnose --list-effects --json -` prints.
"""
from __future__ import annotations

import math
import os
import re

from .units import unit_of_axis

VERDICTS = {
    "no_gap": ("No gap found", "#2f855a"),
    "explained": ("Gap explained", "#2b6cb0"),
    "partly_explained": ("Gap partly explained", "#b7791f"),
    "unexplained": ("Gap, cause open", "#c53030"),
}
MUTED, WEAK = "#66727f", "#b7791f"
UNIT_TEXT = {"degC": "°C", "deg/sqrt(h)": "°/√h", "mg/sqrt(Hz)": "mg/√Hz"}
ARW_TO_WHITE = 60  # 60 arw_deg_rt_h of an accelerometer are mg/sqrt(Hz)
LONG_S = 600  # moments after it are told in hours too: the figures have hours
WORTH_TELLING = 0.3  # of the noise: errors of a fit from which on they are told
LEAST_LOOP_ERRORS = 4  # standard errors of the distance of two branches, the largest of ten, from which on it is told


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


def typeset(text):
    """Signs and units as a page writes them: ± for +-, → for ->, °C for degC."""
    text = text.replace("+-", "±").replace(" -> ", " → ").replace("dph^2", "dph²").replace("mg^2", "mg²")
    return re.sub(r"(?<![\w.])degC\b(?!\w)", "°C", text)


def hours(seconds):
    """'4000 s (1.11 h)': as the text of the program has it, and as the figures have it."""
    text = f"{seconds:.0f} s"
    return f"{text} ({seconds / 3600:.2f} h)" if seconds >= LONG_S else text


def with_hours(text):
    """'from 3601 to 9601 s (1.00 to 2.67 h)': spans of time in a sentence of the program."""
    def span(m):
        lo, hi = float(m[1]), float(m[2])
        return f"from {m[1]} to {m[2]} s ({lo / 3600:.2f} to {hi / 3600:.2f} h)" if hi >= LONG_S else m[0]
    return re.sub(r"\bfrom (\d+(?:\.\d+)?) to (\d+(?:\.\d+)?) s\b", span, text)


def unit_of(axis):
    """The unit of an axis' rates: 'dph', or 'mg' of an accelerometer."""
    return axis.get("unit") or unit_of_axis(axis["axis"])


def in_unit(unit_text, unit):
    """The unit of a parameter as the library has it, for an axis in `unit`."""
    if unit == "mg":
        unit_text = "mg/sqrt(Hz)" if unit_text == "deg/sqrt(h)" else re.sub(r"\bdph\b", "mg", unit_text)
    text = UNIT_TEXT.get(unit_text, unit_text)
    return text.replace("(degC/min)", "°C/min").replace("degC", "°C").replace("/sqrt(s)", "/√s").replace("/sqrt(h)", "/√h")


class Library:
    """Labels, units and hardware causes by the names of effects and families, for an axis whose rates are in `unit`."""

    def __init__(self, diagnosis, unit="dph"):
        library = diagnosis.get("library") or {}
        self.effects = {e["name"]: e for e in library.get("effects") or []}
        self.families = {f["name"]: f["label"] for f in library.get("families") or []}
        self.n_logs = len(diagnosis.get("logs") or [])
        self.unit = unit
        self.units = {p["name"]: p.get("unit") or "" for e in self.effects.values() for p in e.get("parameters") or []}
        self.endings = sorted(_endings(self.units), key=len, reverse=True)
        if unit == "mg":  # sentences of the program name parameters by the unit of the axis
            self.units.update({name.replace("_dph", "_mg"): text for name, text in self.units.items()})
            self.endings = [e for ending in self.endings for e in (ending, ending.replace("_dph", "_mg"))]

    def label(self, name):
        return self.effects.get(name, {}).get("label") or self.families.get(name) or plain(name)

    def in_words(self, text):
        """The text with names, sizes and signs as people write them: thermal creep for thermal_creep, tau 320 s for tau_s 320."""
        text = typeset(text)
        sizes = sorted([n for n, unit in self.units.items() if unit and "_" in n], key=len, reverse=True)
        if sizes:
            text = re.sub(r"\b(" + "|".join(map(re.escape, sizes)) + r") ([+-]?\d[\d.]*(?:e[+-]?\d+)?)(?![\w])",
                          lambda m: self.parameter_text(m[1], float(m[2].rstrip("."))) + "." * m[2].endswith("."), text)
            text = re.sub(r"(?<!column )\b(" + "|".join(map(re.escape, sizes)) + r")\b(?! ±)", lambda m: plain(self.stem(m[1])), text)
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
        factor = ARW_TO_WHITE if unit == "deg/sqrt(h)" and self.unit == "mg" else 1
        spread = f" ± {number(factor * error, 2)}" if isinstance(error, (int, float)) else ""
        value = factor * value if factor != 1 and isinstance(value, (int, float)) else value
        return f"{plain(self.stem(name))} {number(value)}{spread}{' ' + in_unit(unit, self.unit) if unit else ''}"

    def stem(self, name):
        """The name of a parameter without its unit, which is the ending that names of this unit share."""
        if self.units.get(name):
            for ending in self.endings:
                if name.endswith(ending) and len(name) > len(ending):
                    return name[: -len(ending)]
        return name

    def step_text(self, item, errors):
        """'amplitude 427.9 ± 62 dph at 93024 s of log 2': logs count from 1 for people."""
        values = {k: v for k, v in item.items() if k not in ("t_s", "log")}
        text = ", ".join(self.parameter_text(k, v, (errors or {}).get(k)) for k, v in values.items())
        text += f" at {hours(item['t_s'])}" if "t_s" in item else ""
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
        said = with_hours(typeset(where["sentence"]))
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


def means_text(mean_s):
    """What the points of a figure are means of."""
    return "one-minute means" if round(mean_s) == 60 else f"means over {mean_s:.0f} s"


def _rms(values):
    found = [v for v in values or [] if v is not None]
    return math.sqrt(sum(v * v for v in found) / len(found)) if found else None


def has_curve(axis):
    """Something that was found has a mean to draw."""
    return any(e.get("has_curve", True) for e in axis.get("effects") or [])


def has_steps(axis):
    """Jumps in time were found, which no other data foretell."""
    return any("steps" in (e.get("parameters") or {}) for e in axis.get("effects") or [])


def is_told(loop):
    """The branches part by more than their scatter."""
    return bool(loop) and loop[0] >= LEAST_LOOP_ERRORS * loop[2]


def picture_sentence(axis, loop):
    """What the figures of the record show; `loop`: (distance, degC, its standard error) of the measured branches, or None."""
    data, unit = (axis.get("plots") or {}).get("residual") or {}, unit_of(axis)
    before, after = _rms(data.get("before_dph")), _rms(data.get("after_dph"))
    if before is None:
        return ""
    has_temperature = any(t is not None for t in data.get("temp_degc") or [0])
    off = "the polynomial" if has_temperature else "their mean"
    text = f"In the figures of the record {means_text(data.get('mean_s') or 60)} lie {number(before, 3)} {unit} rms off {off}"
    if has_curve(axis) and after is not None:
        text += f", and {number(after, 3)} {unit} with what was found"
    if is_told(loop):
        text += f"; rising and falling temperature differ by up to {number(loop[0], 2)} {unit} (at {number(loop[1], 2)} °C)"
    return text + "."


def held_out_text(axis):
    """What the data were that were not fitted."""
    method = str((axis.get("gap") or {}).get("method", ""))
    if method.startswith("quarters"):
        return "quarters of the one log, each predicted from the others but for its own constant"
    if method.startswith("each log"):
        return "each log predicted from the others but for its own constant"
    return "held-out logs, but for their own constants"


def held_out_sentence(axis):
    """What the answer leaves of data that were not fitted."""
    gap, unit = axis.get("gap") or {}, unit_of(axis)
    rms = gap.get("residual_rms_dph") or {}
    before, after, noise, errors = rms.get("before"), rms.get("after"), rms.get("noise"), rms.get("errors_of_fit")
    if before is None or axis["verdict"] == "no_gap":
        return ""
    has_mean = gap.get("has_mean", True)
    text = f"On data not used in the fit ({held_out_text(axis)}{', jumps in time taken out' if has_steps(axis) else ''}) "
    text += f"{means_text(gap.get('residual_mean_s') or 60)} lie {number(before, 3)} {unit} rms off the polynomial"
    if after is not None and axis.get("effects") and has_mean:
        text += f", {number(after, 3)} {unit} with what was found"
    if noise is not None and (has_mean or not gap.get("statement")):  # else that says what a noise would leave
        with_found = any(e.get("family") == "slow_noise" for e in axis.get("effects") or [])
        text += f"; {'the noise, with the slow noise found,' if with_found else 'noise alone'} would leave {number(noise, 3)} {unit}"
        if errors and errors > WORTH_TELLING * noise and has_mean:
            text += f", errors of the fit {number(errors, 3)} {unit}"
    if errors is not None and after is not None and has_mean and errors > after:
        text += ". The errors of the fit exceed what is left there: these data cannot judge how much of it is the answer's"
    return text + "."


def removes(part):
    """'removes 94 % of the gap', or by how much it is larger then."""
    return f"removes {100 * part:.0f} % of the gap" if part >= 0 else f"makes the gap {-100 * part:.0f} % worse"


def gap_sentence(axis):
    """How far the held-out gap shrinks; a stand-in is called one."""
    gap = axis.get("gap") or {}
    if axis["verdict"] == "no_gap":
        return ""
    left = str(gap.get("remainder") or "").rstrip(".")
    left = f" What is left: {left}." if left else ""
    if gap.get("shrinkage") is None:
        if gap.get("stand_in_shrinkage") is not None:
            return f"A flexible stand-in {removes(gap['stand_in_shrinkage'])} on held-out data: that is not an explanation." + left
        said = re.sub(r"; residual of .*?(?=; the gap lies|$)", "", gap.get("statement") or "")  # the sentence before has these figures
        is_of_means = said.startswith(means_text(gap.get("residual_mean_s") or 60))
        return ((said and f"On data that were not fitted{', ' if is_of_means else ': '}{said}.") + left).strip()
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
