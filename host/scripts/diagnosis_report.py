#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Draws the result of `diagnose --json` as one self-contained HTML page.

    diagnosis_report.py DIAGNOSIS.json -o report.html

The record comes first: rate and temperature against time, rate against temperature by its direction, the same after what
was found; one headline; likelihoods in a fold.  Reads the contract's fields and, where present, the member `plots` of each
axis (host/formats.md, Diagnosis).  A figure whose data are missing is left out.
Exit status: 0 done, 2 usage, 3 the input is not a diagnosis.
"""
from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import os
import sys

import jinja2
import markupsafe

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[1:1] = [os.path.join(HERE, os.pardir, "python"), os.path.join(HERE, os.pardir)]  # in the source tree; as installed
from imucal.diagnosis_words import (Library, chip, gap_sentence, headline, in_reading_order, many, number, open_sentences, plain, sentence, size_sentence,  # noqa: E402
                                    titled, where_sentence)
from imucal.errors import DataError  # noqa: E402
from imucal.inputs import plain_file  # noqa: E402
from imucal.log import write_text  # noqa: E402
from imucal.plot import diagnosis as draw  # noqa: E402

branches = draw.branches  # part of this script's interface
TEMPLATES = os.path.join(HERE, "templates")
LARGEST_HASHED_BYTES = 2**30


class BadInput(Exception):
    """The file is not a diagnosis: says where and what to do."""


# ---- figures ----------------------------------------------------------------------------------------------

def figure(title, caption, image, size=""):
    return {"title": title, "caption": caption, "image": markupsafe.Markup(image), "size": size}


def drawn(plots, wanted):
    """Figures of (key of plots, title, caption, function of the data, size); a malformed one is named instead of drawn."""
    out = []
    for key, title, caption, function, size in wanted:
        data = plots.get(key)
        if not data:
            continue
        try:
            image = function(data)
            if image:
                out.append(figure(title, caption, image, size))
        except (KeyError, TypeError, ValueError, IndexError) as problem:
            out.append(figure(title, f"not drawn: plots.{key} is not as documented ({type(problem).__name__}: {problem})", ""))
    return out


def has_raw(data):
    return bool(data) and all(data.get(k) for k in ("rate_dph", "polynomial_dph", "before_dph", "after_dph"))


def without_hits(data):
    n = data.get("n_hits") or 0
    samples = "1 sample that stands" if n == 1 else f"{n} samples that stand"
    return f" without {samples} out of all noise" if n else ""


def raw_figures(axis):
    """The record first: (a) against time, (b) against temperature, (c) less polynomial, and the same after where what was found has
    a mean to draw."""
    plots = dict(axis.get("plots") or {})
    data = plots.get("residual") or {}
    if not has_raw(data):
        return []
    has_curve = any(e.get("has_curve", True) for e in axis.get("effects") or [])
    if not has_curve:  # what another noise makes of the polynomial is no finding
        data = plots["residual"] = {**data, "after_dph": data["before_dph"]}
    has_temperature = any(t is not None for t in data["temp_degc"])
    wanted = [("residual", f"The record: rate {'and temperature ' if has_temperature else ''}against time",
               f"Means over {number(data.get('mean_s', 60))} s" + without_hits(data)
               + ("; red while the temperature rises, blue while it falls, grey at rest." if has_temperature else "."),
               draw.draw_record, "wide")]
    if has_temperature:
        wanted.append(("residual", "Rate against temperature", "Each log without its own constant. Branches that part are a memory of the "
                       "temperature's past.", lambda d: draw.draw_against_temperature(d, "raw"), ""))
        wanted.append(("residual", "The same less the polynomial", "What the believed model leaves"
                       + (", and what was found drawn through it." if has_curve else "."),
                       lambda d: draw.draw_against_temperature(d, "before"), ""))
        if has_curve:
            wanted.append(("residual", "The same after what was found", "On the scale of the figure before it.",
                           lambda d: draw.draw_against_temperature(d, "after"), ""))
    return drawn(plots, wanted)


def evidence_figures(axis):
    plots = dict(axis.get("plots") or {})
    if not axis.get("effects"):  # nothing was added: after is before
        plots.pop("gap_map_after", None)
        if isinstance(plots.get("dp2"), dict):
            plots["dp2"] = {k: v for k, v in plots["dp2"].items() if k != "model_after_dph"}
    named = {e["name"] for e in axis.get("effects") or []} | {e.get("member") for e in axis.get("effects") or []}
    return drawn(plots, [
        ("gap_map", "Where: averaging time and temperature",
         "Variance of the standardised residual beyond what the model allows; white is as expected, a number marks more than "
         "three standard errors.", lambda d: draw.draw_gap_map(plots), "wide"),
        ("dp2", "Prediction error (DP2): logs against model", "The model is right where its curve runs through the logs.",
         draw.draw_dp2, ""),
        ("candidates", "Evidence of the candidates",
         "Each candidate judged alone, over the believed model. Right of the red line: more than chance gives at the stated "
         "false-alarm rate. Dark: named. Hatched: tests that assume no cause.",
         lambda d: draw.draw_candidates(d, plots.get("tests") or (), named), "")])


# ---- one axis ---------------------------------------------------------------------------------------------

def loop_of(axis):
    data = (axis.get("plots") or {}).get("residual") or {}
    if not has_raw(data) or not any(t is not None for t in data["temp_degc"]):
        return None
    try:
        return draw.loop_dph(data)
    except (KeyError, TypeError, ValueError, IndexError):
        return None


def effect_rows(axis, library):
    """Cause in words, and its size with the library's units."""
    return [(("Note: " if e.get("is_note") else "") + f"{e.get('label') or library.label(e['name'])} "
             f"({plain(e['name'])}{', as ' + plain(e['member']) if e.get('member') else ''})",
             e.get("measured") or ": ".join(t for t in (library.parameters_text(e.get("parameters"), e.get("std_errors")), e.get("in_words")) if t)
             or e.get("statement") or "–")
            for e in in_reading_order(axis)]


def next_steps(axis, library):
    """Profile to run, model to use, cause to look for in the hardware."""
    out = list(axis.get("advice") or [])
    pairs = [] if "open_pairs" in axis else axis.get("indistinguishable") or []  # the advice names those that bear on the answer
    if pairs and not any(all(name in text for pair in pairs for name in pair) for text in out):  # else it is said already
        out.insert(0, "Cannot be told apart on these profiles: " + "; ".join(" and ".join(map(plain, pair)) for pair in pairs) + ".")
    if axis.get("effects") and axis["verdict"] in ("explained", "partly_explained"):
        out.append("Simulate with it: `diagnose … --model-out MODEL.json` writes the believed model with what was found, for gyrosim and montecarlo.")
    for effect in in_reading_order(axis):
        if effect.get("is_note"):
            continue
        causes = effect.get("hardware_causes")  # as the signs of the parameters have it
        for cause in library.hardware_causes(effect.get("member") or effect["name"]) if causes is None else causes:
            out.append(f"Look for in the hardware ({plain(effect.get('member') or effect['name'])}): {cause['what']} [{cause['source']}].")
    return [library.in_words(text) for text in dict.fromkeys(out)]


def fold(title, header=(), body=(), figures=(), text=""):
    return {"title": title, "header": list(header), "body": [list(line) for line in body], "figures": list(figures), "text": text}


def limit_folds(axis, library):
    """What these profiles cannot show."""
    out = []
    for key, title in (("not_detectable_here", "Not detectable on these profiles below the sizes listed"),
                       ("smallest_detectable", "Smallest size of each effect that these profiles would show")):
        hidden = axis.get(key) or []
        if hidden:
            out.append(fold(f"{title} ({many(len(hidden), 'effect')})", ("effect", "smallest size that would show"),
                            [(plain(h["name"]), library.parameters_text(h.get("smallest_detectable")) or "none on these profiles")
                             for h in hidden]))
    pairs = axis.get("indistinguishable") or []
    if pairs:
        out.append(fold(f"Look alike on these profiles at twice those sizes ({many(len(pairs), 'pair')})", ("effect", "and"),
                        [map(plain, pair) for pair in pairs]))
    return out


def evidence_fold(axis):
    body = [(plain(e["name"]), number(e.get("evidence_nats")),
             "–" if e.get("held_out_gain") is None else number(e["held_out_gain"]),
             ", ".join(f"{plain(c['name'])} ({number(c.get('evidence_nats'))})" for c in e.get("set") or []
                       if c["name"] != e["name"]) or "none") for e in axis.get("effects") or []]
    gap = axis.get("gap") or {}
    text = "Evidence is the gain of log-likelihood in nats above its threshold; 1 nat is a likelihood ratio of 2.7."
    if gap.get("before") is not None and gap.get("after") is not None:
        text += f" Gap on held-out data: {number(gap['before'])} → {number(gap['after'])} ({gap.get('unit', '')})."
    dp2 = gap.get("dp2_distance_dph") or {}
    if dp2.get("before") is not None:
        text += f" Distance of the DP2 curves: {number(dp2['before'])} → {number(dp2.get('after'))} dph."
    return fold("Likelihoods and tests", ("effect", "evidence [nats]", "held-out gain [deviance/h], start states apart",
                                          "cannot be excluded instead (evidence)"), body, evidence_figures(axis), text)


def where_folds(axis):
    where = axis.get("where") or {}
    out = []
    found = where.get("findings") or []
    if found:
        out.append(fold("What was seen where", ("what was seen", "probe", "evidence [nats]", "p"), [
            (f.get("statement", ""), plain(str(f.get("probe", ""))), number(f.get("evidence_nats")),
             "< 1e-300" if f.get("p_value") == 0 else number(f.get("p_value"), 2)) for f in found]))
    cell = lambda v: (" … ".join(number(x) for x in v) if isinstance(v, list) else os.path.basename(v) if isinstance(v, str) else number(v))
    for key, title in (("by_tau", "averaging time"), ("by_temperature", "temperature"), ("by_phase", "phase"), ("by_log", "log")):
        lines = [line for line in where.get(key) or [] if isinstance(line, dict)]
        if lines:
            header = list(lines[0])
            value = lambda line, h: cell(line[h] + 1 if h == "log" and isinstance(line.get(h), int) else line.get(h))  # people count from 1
            out.append(fold(f"The gap by {title}", [plain(h) for h in header], [[value(line, h) for h in header] for line in lines]))
    return out


def axis_view(axis, n_logs, library):
    title, color = titled(axis)
    profile = axis.get("advised_profile")
    sentences = [*open_sentences(axis), size_sentence(axis, loop_of(axis)), where_sentence(axis.get("where"), n_logs),
                 gap_sentence(axis), *(axis.get("notes") or [])]
    return {"name": axis["axis"], "title": title, "color": color, "headline": headline(axis, library),
            "chip": chip(axis, library),
            "sentences": [sentence(library.in_words(s)) for s in sentences if s], "effects": effect_rows(axis, library), "figures": raw_figures(axis),
            "next": next_steps(axis, library),
            "profile": figure("Profile to run instead", "It separates the causes that these runs leave open.", draw.draw_profile(profile), "small")
            if profile and profile.get("segments") else None,
            "folds": [*limit_folds(axis, library), evidence_fold(axis), *where_folds(axis)]}


# ---- page -------------------------------------------------------------------------------------------------

def file_row(path, role, folder):
    """Name, role, device and hash of a file, looked for from here and beside the diagnosis."""
    for place in (path, os.path.join(folder, path), os.path.join(folder, os.path.basename(path))):
        if os.path.isfile(place) and os.path.getsize(place) <= LARGEST_HASHED_BYTES:
            with open(place, "rb") as f:
                content = f.read()
            device = [line.split(b":", 1)[1].strip().decode("utf-8", "replace") for line in content[:4096].splitlines()
                      if line.startswith((b"# device:", b"# serial:"))]
            return path, role, ", ".join(device) or "–", hashlib.sha256(content).hexdigest()[:16]
    return path, role, "–", "not found here"


def command_line(diagnosis):
    """The call that gave this diagnosis."""
    line = ["diagnose"] + (["--model", diagnosis["model"]] if isinstance(diagnosis.get("model"), str) else [])
    for option, key in (("--log", "logs"), ("--holdout", "held_out_logs")):
        for path in diagnosis.get(key) or []:
            line += [option, str(path)]
    for option, key in (("--false-alarm-rate", "false_alarm_rate"), ("--seed", "seed")):
        if diagnosis.get(key) is not None:
            line += [option, str(diagnosis[key])]
    return " ".join(line)


def provenance(diagnosis, source, folder):
    files = [file_row(p, f"log {i + 1}, fitted", folder) for i, p in enumerate(diagnosis.get("logs") or [])]
    files += [file_row(p, "held out", folder) for p in diagnosis.get("held_out_logs") or []]
    if isinstance(diagnosis.get("model"), str):
        files.append(file_row(diagnosis["model"], "believed model", folder))
    lines = [f"Command: {command_line(diagnosis)}"]
    if diagnosis.get("version"):
        lines.append(f"imucal {diagnosis['version']}.")
    if os.path.isfile(source):
        written = datetime.datetime.fromtimestamp(os.path.getmtime(source), datetime.timezone.utc)
        lines.append(f"Diagnosis written {written:%Y-%m-%d %H:%M} UTC.")
    return files, lines


def page(diagnosis, source):
    """The whole page as text."""
    draw.style()
    library, folder = Library(diagnosis), os.path.dirname(os.path.abspath(source))
    logs, held = diagnosis.get("logs") or [], diagnosis.get("held_out_logs") or []
    rate = diagnosis.get("false_alarm_rate")
    sub = f"{many(len(logs), 'log')} fitted, " + (f"{len(held)} held out" if held else "each held out in turn" if len(logs) != 1
                                                  else "its quarters held out in turn")
    if rate is not None:
        sub += f"; false-alarm rate {100 * rate:g} % over all axes and candidates"
    files, lines = provenance(diagnosis, source, folder)
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, trim_blocks=True,
                                     undefined=jinja2.StrictUndefined)
    with open(os.path.join(TEMPLATES, "diagnosis.css"), encoding="utf-8") as f:
        css = markupsafe.Markup(f.read())
    return environment.get_template("diagnosis.html.j2").render(
        source=os.path.basename(source), css=css, sub=sub, warnings=diagnosis.get("warnings") or [],
        axes=[axis_view(a, len(logs), library) for a in diagnosis["axes"]], files=files, provenance=lines)


def load(path):
    """The diagnosis, checked as far as the page needs it."""
    try:
        with plain_file(path) as source, open(source.path, encoding="utf-8-sig") as f:
            diagnosis = json.load(f)
    except DataError as problem:  # gzip that is cut short or damaged
        raise BadInput(str(problem)) from None
    except OSError as problem:
        raise BadInput(f"{path}: {problem.strerror}: give the file that `diagnose --json` wrote") from None
    except ValueError as problem:
        raise BadInput(f"{path}: not JSON ({problem}): give the file that `diagnose --json` wrote") from None
    if not isinstance(diagnosis, dict) or diagnosis.get("imucal_diagnosis") != 1:
        raise BadInput(f"{path}: field imucal_diagnosis: expected 1: give the file that `diagnose --json` wrote")
    axes = diagnosis.get("axes")
    if not isinstance(axes, list) or not all(isinstance(a, dict) and "axis" in a and "verdict" in a for a in axes):
        raise BadInput(f"{path}: field axes: expected a list of objects with axis and verdict")
    return diagnosis


def main(argv=None):
    parser = argparse.ArgumentParser(description="HTML page of a diagnosis.")
    parser.add_argument("diagnosis", help="file written by diagnose --json, plain or gzip; - for standard input")
    parser.add_argument("-o", "--output", required=True, help="page to write")
    args = parser.parse_args(argv)
    try:
        write_text(args.output, page(load(args.diagnosis), "standard input" if args.diagnosis == "-" else args.diagnosis))
    except (BadInput, DataError) as problem:
        print(f"diagnosis_report: {problem}", file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
