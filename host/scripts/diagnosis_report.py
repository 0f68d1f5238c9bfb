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
from imucal.check import check_json  # noqa: E402
from imucal.diagnosis_words import (Library, chip, gap_sentence, has_curve, has_steps, headline, held_out_sentence, held_out_text, in_reading_order,  # noqa: E402
                                    is_told, joined, many, means_text, number, open_sentences, picture_sentence, plain, sentence, titled, typeset,
                                    unit_of, where_sentence)
from imucal.errors import DataError  # noqa: E402
from imucal.inputs import plain_file  # noqa: E402
from imucal.log import keep_input, metadata_of, write_text  # noqa: E402
from imucal.plot import diagnosis as draw  # noqa: E402
from imucal.plot import record as draw_of_record  # noqa: E402

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


def record_caption(plots, has_temperature):
    data = plots.get("residual") or {}
    text = "Pale: the rows as they were logged. " if plots.get("record") else ""
    if has_raw(data):
        text += means_text(data.get("mean_s") or 60).capitalize() + (" coloured by the direction of the temperature." if has_temperature else ": dark.")
    n_hits = data.get("n_hits") or 0
    if n_hits and not plots.get("record"):  # a diagnosis from before the record was written
        text += f" Without {many(n_hits, 'sample')} out of all noise."
    return text + draw_of_record.left_out_sentence(plots)


def has_line_over_temperature(axis):
    """What was found can be followed against temperature: jumps in time and slow noise go to and fro."""
    return all(e.get("family") not in ("slow_noise", "function_of_time") and "steps" not in (e.get("parameters") or {})
               for e in axis.get("effects") or [] if e.get("has_curve", True))


def branches_sentence(axis, library):
    """What it means that rising and falling branches part, in this case."""
    loop = loop_of(axis)
    if loop is None:
        return ""
    if not is_told(loop):
        return "" if has_curve(axis) else " The branches of rising and falling temperature part by no more than their scatter."
    causes = [library.label(e["name"]) for e in in_reading_order(axis) if e.get("has_curve", True) and not e.get("is_note")]
    if causes:
        return f" The branches part; what was found: {joined(dict.fromkeys(causes))}."
    return " The branches part: a memory of the temperature's past, a jump, slow noise or a warm-up can do that."


def raw_figures(axis, library):
    """The record first: against time, against temperature, less polynomial, less what was found where that has a mean to draw."""
    plots, unit, curve = dict(axis.get("plots") or {}), unit_of(axis), has_curve(axis)
    data = plots.get("residual") or {}
    if not has_raw(data):
        plots.pop("residual", None)
    has_temperature = any(t is not None for t in data.get("temp_degc") or []) or any(
        t is not None for log in plots.get("record") or [] for t in log.get("temp_degc") or [])
    key = "record" if plots.get("record") else "residual"
    rate = "rate" if unit == "dph" else "specific force"
    wanted = [(key, f"The record: {rate} {'and temperature ' if has_temperature else ''}against time", record_caption(plots, has_temperature),
               lambda d: draw_of_record.draw_record(plots, unit, curve), "wide")]
    if has_raw(data) and any(t is not None for t in data["temp_degc"]):
        follows = has_line_over_temperature(axis)
        wanted.append(("residual", f"{rate.capitalize()} against temperature", "Each log without its own constant." + branches_sentence(axis, library)
                       + (" Middle and right have one scale." if curve else ""),
                       lambda d: draw_of_record.draw_against_temperature(plots, unit, curve, follows), "wide"))
    out = drawn(plots, wanted)
    held = plots.get("held_out") or {}
    if axis.get("verdict") != "no_gap" and held.get("unit"):
        curve_foretold = curve and (axis.get("gap") or {}).get("has_mean", True)
        out += drawn(plots, [("held_out", "On data not used in the fit", held_out_text(axis).capitalize() + "; " + means_text(held.get("mean_s") or 60)
                              + ("; jumps in time are taken out." if has_steps(axis) else "."),
                              lambda d: draw_of_record.draw_held_out(d, unit, curve_foretold), "wide")])
    return out


def has_holes(plots):
    maps = [plots.get(key) or {} for key in ("gap_map", "gap_map_after")]
    return any(z is None for a_map in maps for row in a_map.get("z") or [] for z in row)


def dp2_caption(dp2):
    if dp2.get("data_after_dph"):
        return ("Hollow: the logs, less the polynomial. Full: less what was found too; the answer is right where the full points lie on its curve, "
                "the believed model where the hollow ones lie on its own.")
    return "The model is right where its curve runs through the logs."


def evidence_figures(axis):
    plots = dict(axis.get("plots") or {})
    if not axis.get("effects"):  # nothing was added: after is before
        plots.pop("gap_map_after", None)
        if isinstance(plots.get("dp2"), dict):
            plots["dp2"] = {k: v for k, v in plots["dp2"].items() if k not in ("model_after_dph", "data_after_dph")}
    dp2 = plots.get("dp2") or {}
    named = [e.get("member") or e["name"] for e in in_reading_order(axis)]
    return drawn(plots, [
        ("gap_map", "Where: averaging time and temperature",
         "Variance of the standardised residual beyond what the model allows; white is as expected, a number marks more than "
         "three standard errors." + (" Hatched: no data." if has_holes(plots) else ""), lambda d: draw.draw_gap_map(plots), "wide"),
        ("dp2", "Prediction error (DP2): logs against model", dp2_caption(dp2), lambda d: draw.draw_dp2(d, unit_of(axis)), ""),
        ("candidates", "Evidence of the candidates",
         "Each candidate judged alone, over the believed model. Right of the red line: more than chance gives at the stated "
         "false-alarm rate. Dark, bold and on top: named. Hatched: tests that assume no cause.",
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


WHERE_HEADERS = {"tau_s": "averaging time [s]", "temp_degc": "temperature [°C]", "phase": "phase", "log": "log",
                 "excess": "excess of squares (0: as the model has it)", "n": "coefficients", "z": "excess [standard errors]",
                 "noise_floor": "standard error of the excess", "mean_z": "mean [standard errors]"}


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
        text += (f" Distance of the logs from the DP2 curve of the believed model: {number(dp2['before'])} {unit_of(axis)}; less what was found, "
                 f"from that of the answer: {number(dp2.get('after'))} {unit_of(axis)}.")
    return fold("Likelihoods and tests", ("effect", "evidence [nats]", "held-out gain [deviance/h], start states apart",
                                          "cannot be excluded instead (evidence)"), body, evidence_figures(axis), text)


def where_folds(axis):
    where = axis.get("where") or {}
    out = []
    found = where.get("findings") or []
    if found:
        out.append(fold("What tests that assume no cause saw", ("what was seen", "test", "evidence [nats]", "probability on a right model", "after what was found"), [
            (f.get("statement", ""), plain(str(f.get("probe", ""))), number(f.get("evidence_nats")),
             "< 1e-300" if f.get("p_value") == 0 else number(f.get("p_value"), 2),
             {True: "still there", False: "gone"}.get(f.get("remains_after"), "–")) for f in found]))
    cell = lambda v: (" … ".join(number(x) for x in v) if isinstance(v, list) else os.path.basename(v) if isinstance(v, str) else number(v))
    for key, title in (("by_tau", "averaging time"), ("by_temperature", "temperature"), ("by_phase", "phase"), ("by_log", "log")):
        lines = [line for line in where.get(key) or [] if isinstance(line, dict)]
        if lines:
            header = list(lines[0])
            value = lambda line, h: cell(line[h] + 1 if h == "log" and isinstance(line.get(h), int) else line.get(h))  # people count from 1
            out.append(fold(f"The gap by {title}", [WHERE_HEADERS.get(h, plain(h)) for h in header], [[value(line, h) for h in header] for line in lines]))
    return out


def advised_profile(axis):
    """The figure of the profile; None where no advice says what it would show, or only the recorder is at fault: that needs no other
    temperatures."""
    profile = axis.get("advised_profile")
    effects = [e for e in axis.get("effects") or [] if not e.get("is_note")]
    is_said = any("advised profile" in text for text in axis.get("advice") or [])
    if not profile or not profile.get("segments") or not is_said or (effects and all(e.get("family") == "structural" for e in effects)):
        return None
    return figure("The advised profile", "What runs of it would show stands above.", draw.draw_profile(profile), "small")


def findings_title(axis):
    effects = axis.get("effects") or []
    is_open = effects and all((e.get("evidence_nats") or 0) <= 0 for e in effects if not e.get("is_note"))
    return "What it may be" if is_open else "What was found"


def axis_view(axis, n_logs, library):
    title, color = titled(axis)
    sentences = [picture_sentence(axis, loop_of(axis)), *open_sentences(axis), where_sentence(axis.get("where"), n_logs),
                 held_out_sentence(axis), gap_sentence(axis), *(axis.get("notes") or [])]
    return {"name": axis["axis"], "title": title, "color": color, "headline": headline(axis, library),
            "chip": chip(axis, library), "findings": findings_title(axis),
            "sentences": list(dict.fromkeys(sentence(library.in_words(s)) for s in sentences if s)), "effects": effect_rows(axis, library),
            "figures": raw_figures(axis, library), "next": next_steps(axis, library), "profile": advised_profile(axis),
            "folds": [*limit_folds(axis, library), evidence_fold(axis), *where_folds(axis)]}


# ---- page -------------------------------------------------------------------------------------------------

def device_text(path):
    """'ADIS16405, serial 17; run up-2': what a log says of itself, the device first; empty: it says nothing, or is no log."""
    try:
        metadata = metadata_of(path)
    except (DataError, OSError):
        return ""
    said = lambda *keys: ", ".join(f"{key} {metadata[key]}" for key in keys if metadata.get(key))  # noqa: E731
    device = ", ".join(text for text in (metadata.get("device"), said("serial")) if text)
    return "; ".join(text for text in (device, said("run", "date")) if text)


def file_row(path, role, folder):
    """Name, role, device and hash of a file, looked for from here and beside the diagnosis."""
    for place in (path, os.path.join(folder, path), os.path.join(folder, os.path.basename(path))):
        if os.path.isfile(place) and os.path.getsize(place) <= LARGEST_HASHED_BYTES:
            with open(place, "rb") as f:
                content = f.read()
            return path, role, device_text(place) or "–", hashlib.sha256(content).hexdigest()[:16]
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
    written = ""
    if os.path.isfile(source):
        moment = datetime.datetime.fromtimestamp(os.path.getmtime(source), datetime.timezone.utc)
        written = f"diagnosed {moment:%Y-%m-%d %H:%M} UTC"
        lines.append(f"Diagnosis written {moment:%Y-%m-%d %H:%M} UTC.")
    return files, lines, written


def subtitle(diagnosis):
    """What was fitted and what was held out."""
    logs, held = diagnosis.get("logs") or [], diagnosis.get("held_out_logs") or []
    rate = diagnosis.get("false_alarm_rate")
    sub = f"{many(len(logs), 'log')} fitted, " + (f"{len(held)} held out" if held else "each held out in turn" if len(logs) != 1
                                                  else "its quarters held out in turn")
    if rate is not None:
        sub += f"; false-alarm rate {100 * rate:g} % over all axes and candidates"
    return sub


def head(diagnosis, files, written):
    """(title, line below it): of which device, of which logs, when; two reports on a desk must be told apart."""
    devices = list(dict.fromkeys(device.split(";")[0] for _, role, device, _ in files if device != "–" and role != "believed model"))
    of = ", ".join(devices[:2]) + (f" and {len(devices) - 2} more" if len(devices) > 2 else "") or "a device that its logs do not name"
    names = [os.path.basename(str(p)) for p in [*(diagnosis.get("logs") or []), *(diagnosis.get("held_out_logs") or [])]]
    logs = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
    what = "What the error model leaves out" if diagnosis.get("model") else "What plain noise does not explain"
    return f"{what}: {of}", " · ".join(text for text in (logs, written) if text)


def shown(value):
    """Text of the page with the signs and units of a page; markup and file names as they are."""
    return typeset(value) if isinstance(value, str) and not isinstance(value, markupsafe.Markup) else value


def page(diagnosis, source):
    """The whole page as text."""
    draw.style()
    folder = os.path.dirname(os.path.abspath(source))
    files, lines, written = provenance(diagnosis, source, folder)
    title, of_logs = head(diagnosis, files, written)
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(TEMPLATES), autoescape=True, trim_blocks=True,
                                     undefined=jinja2.StrictUndefined, finalize=shown)
    with open(os.path.join(TEMPLATES, "diagnosis.css"), encoding="utf-8") as f:
        css = markupsafe.Markup(f.read())
    n_logs = len(diagnosis.get("logs") or [])
    axes = [axis_view(a, n_logs, Library(diagnosis, unit_of(a))) for a in diagnosis["axes"]]
    return environment.get_template("diagnosis.html.j2").render(
        source=os.path.basename(source), css=css, title=title, of_logs=markupsafe.escape(of_logs), sub=subtitle(diagnosis),
        warnings=diagnosis.get("warnings") or [], axes=axes,
        files=[tuple(map(markupsafe.escape, row)) for row in files], provenance=[markupsafe.escape(line) for line in lines])


def load(path):
    """(the diagnosis, checked as far as the page needs it, and its text)."""
    try:
        with plain_file(path) as source, open(source.path, encoding="utf-8-sig") as f:
            text = f.read()
        diagnosis = json.loads(text)
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
    return diagnosis, text


def page_of(path):
    """The page of a file; what it is no page of is told by its schema."""
    diagnosis, text = load(path)
    name = "standard input" if path == "-" else path
    try:
        return page(diagnosis, name)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, jinja2.TemplateError):
        _, messages = check_json(name, text)
        if not messages:  # a fault of ours
            raise
        raise BadInput("\n".join(messages)) from None


def main(argv=None):
    parser = argparse.ArgumentParser(description="HTML page of a diagnosis.")
    parser.add_argument("diagnosis", help="file written by diagnose --json, plain or gzip; - for standard input")
    parser.add_argument("-o", "--output", required=True, help="page to write")
    args = parser.parse_args(argv)
    try:
        keep_input(args.diagnosis, args.output)
        write_text(args.output, page_of(args.diagnosis))
    except (BadInput, DataError) as problem:
        print(f"diagnosis_report: {problem}", file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
