# SPDX-License-Identifier: MIT
"""``imucal check``: is a file one of ours, and valid?  Messages name file and line."""
import json
import re
import warnings
from pathlib import Path

import numpy as np

from .cli import common_options, finish_json, parser_of
from .errors import DataError, DataWarning
from .inputs import not_utf8, plain_file
from .limits import judge
from .log import keep_input, other_step_s, read_log
from .strict import line_of, parse, positions, refusal

KINDS = {"imucal_model": "model", "imucal_profile": "profile", "imucal_table": "table", "imucal_diagnosis": "diagnosis",
         "imucal_limits": "limits"}
_LONGEST_WORDS = 200
_SCHEMAS = Path(__file__).with_name("schema")


def _dotted(path):
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


_KIND_WORDS = {"object": "an object", "array": "a list", "number": "a number", "integer": "a whole number", "string": "a text"}


def _unknown(error):
    """The fields that a schema does not know, and those that it does."""
    known, patterns = error.schema.get("properties", {}), error.schema.get("patternProperties", {})
    odd = [name for name in error.instance if name not in known and not any(re.search(p, name) for p in patterns)]
    return f"unknown field {', '.join(json.dumps(name) for name in odd)} (known: {', '.join(known)})"


def _words(error):
    """What a schema finds, in the words of the programs; the library's own, shortened, where they have none."""
    value, found = error.validator_value, _shortened(json.dumps(error.instance, ensure_ascii=False))
    if error.validator in ("anyOf", "oneOf") and not isinstance(error.instance, dict):
        return f"expected an object, found {found}"
    if error.validator in ("anyOf", "oneOf"):
        names = [choice["required"][0] for choice in value]
        given = [name for name in names if name in error.instance]
        return f"{' and '.join(given)} are the same: give one of them" if len(given) > 1 else f"{names[0]} (or {names[1]}) is missing"
    if error.validator == "required":
        missing = re.match("'(.*)' is a required", error.message)[1]
        return f"field {json.dumps(missing)} is missing"
    if error.validator == "additionalProperties":
        return _unknown(error)
    if error.validator == "const":
        return f"expected {value}, found {found}"
    if error.validator == "type":
        kinds = [value] if isinstance(value, str) else value
        return f"expected {' or '.join(_KIND_WORDS.get(kind, kind) for kind in kinds)}, found {found}"
    if error.validator in ("minItems", "maxItems"):
        return f"expected {value} {'or more' if error.validator == 'minItems' else 'at most'}, found {len(error.instance)}"
    return _shortened(error.message)


def _shortened(text):
    return text if len(text) < _LONGEST_WORDS else text[:_LONGEST_WORDS] + " …"


def check_json(path, text):
    """(kind, list of messages) of a JSON file."""
    try:
        data = parse(path, text)
    except DataError as error:
        return "json", [str(error)]
    kind = next((k for tag, k in KINDS.items() if isinstance(data, dict) and tag in data), None)
    if kind is None:
        return "json", [f"{path}:1: a JSON file, but none of ours: it has none of the members {', '.join(KINDS)}"]
    try:
        from jsonschema import Draft202012Validator
    except ImportError:
        raise DataError(f"{path}: checking needs the Python library jsonschema: pip install jsonschema") from None
    validator = Draft202012Validator(json.loads((_SCHEMAS / f"{kind}.json").read_text(encoding="utf-8")))
    places, messages = positions(text), []
    for error in sorted(validator.iter_errors(data), key=lambda e: places.get(tuple(e.absolute_path), 0)):
        at = tuple(error.absolute_path)
        messages.append(f"{path}:{line_of(text, places.get(at, 0))}: {_dotted(at) + ': ' if at else ''}{_words(error)}")
    return kind, list(dict.fromkeys(messages)) or _beyond_schema(path, kind, data, places, text)


def _beyond_schema(path, kind, data, places, text):
    """What a schema cannot say: names of a unit, numbers of coefficients, an order, the limits of the programs."""
    beyond = {"model": _accelerometer_names, "table": _numbers_of_coefficients, "limits": _limits_of_nothing}.get(kind)
    found = beyond(path, data, places, text) if beyond else []
    if found or kind not in ("model", "profile", "table"):
        return found
    message = refusal(path, data, text, kind)
    return [message] if message else _beyond_full_scale(path, data, places, text) if kind == "table" else []


def _beyond_full_scale(path, data, places, text):
    """A bias that the sensor cannot have shown: it would stand at its full scale."""
    found = []
    for i, axis in enumerate(data["axes"]):
        unit = "dph" if "coeff_dph" in axis else "mg"
        per_count, counts = axis.get(f"{unit}_per_count"), axis.get("full_scale_counts")
        if per_count is None or counts is None:
            continue
        temp_degc = np.linspace(*axis["span_degc"], 1001)
        bias = np.polynomial.polynomial.polyval((temp_degc - axis["t0_degc"]) / axis["range_degc"], axis[f"coeff_{unit}"])
        at = int(np.argmax(np.abs(bias)))
        if abs(bias[at]) > counts * per_count:
            line = line_of(text, places[("axes", i, "full_scale_counts")])
            found.append(f"{path}:{line}: axes[{i}].full_scale_counts: {counts} counts are {counts * per_count:.4g} {unit}, "
                         f"less than the bias of {abs(bias[at]):.4g} {unit} at {temp_degc[at]:.4g} degC")
    return found


def _numbers_of_coefficients(path, data, places, text):
    found = []
    for i, axis in enumerate(data["axes"]):
        key = "coeff_dph" if "coeff_dph" in axis else "coeff_mg"
        if len(axis[key]) != axis["order"] + 1:
            found.append(f"{path}:{line_of(text, places[('axes', i, key)])}: axes[{i}].{key}: {len(axis[key])} coefficients for order {axis['order']}: "
                         f"{axis['order'] + 1} are expected")
        if not axis["span_degc"][0] < axis["span_degc"][1]:
            found.append(f"{path}:{line_of(text, places[('axes', i, 'span_degc')])}: axes[{i}].span_degc: the lower temperature comes first")
    return found


def _limits_of_nothing(path, data, places, text):
    """Limits that a table cannot break: a production line would take every table for a good one."""
    span = data.get("span_degc")
    if span and not span[0] < span[1]:
        line = line_of(text, places[("span_degc",)])
        return [f"{path}:{line}: span_degc: the lower temperature comes first, found {json.dumps(span)}"]
    if len(data) == 1:
        return [f"{path}:{line_of(text, places[()])}: no limit is given, so every table would keep it: give span_degc, "
                "max_sigma, max_bias or max_slope_per_degc"]
    return []


def _accelerometer_names(path, data, places, text):
    """Names in mg belong to a model that says so."""
    if data.get("unit") == "mg":
        return []
    found = []
    for at in places:
        if at and at[0] != "effects" and str(at[-1]).endswith(("_mg", "_mg_rt_hz")):
            found.append(f"{path}:{line_of(text, places[at])}: {_dotted(at)}: only in a model with \"unit\": \"mg\"")
    return found


def check_file(path):
    """(kind, list of messages); an empty list: valid."""
    with plain_file(path) as source:
        kind, messages = _check(source.path)
        return kind, [source.said(message) for message in messages]


def _check(path):
    try:
        with open(path, "rb") as file:
            raw = file.read()
    except OSError as error:
        raise DataError(f"{path}: cannot open: {error.strerror}") from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("utf-8-sig", "backslashreplace")
        if text.lstrip().startswith(("{", "[")):
            return "json", [not_utf8(path, "not a JSON file (no text)")]
        from .importers import detect
        kind = detect(path)[0]
        if kind != "imucal-log":
            return kind, [f"{path}: not one of imucal's own files: imucal import {path} -o LOG.csv reads it"]
    if text.lstrip().startswith(("{", "[")):
        return check_json(path, text)
    try:
        log = read_log(path)
        _remark_step(path, other_step_s(log.t_s))
        if not any(np.isfinite(rate).any() for rate in log.rates.values()):
            raise DataError(f"{path}: no axis has a rate in any second; are the columns empty, or is rate_hz of a raw log too high?")
    except DataError as error:
        return "log", [str(error)]
    return "log", []


def _remark_step(path, step_s):
    """A remark on rows that are no seconds.  dp, errormodel, diagnose and calibrate take them and say the same; import and look
    refuse them."""
    if step_s is not None:
        warnings.warn(f"{path}: rows are {step_s:.6g} s apart, not 1 s: each is taken as the mean over {step_s:.6g} s"
                      f"{'; are these milliseconds? t_s is in seconds' if abs(step_s / 1000 - 1) < 0.05 else ''}", DataWarning, stacklevel=2)


def _need_limits(path):
    """DataError where a file holds no valid limits."""
    kind, messages = check_file(path)
    if kind != "limits" and not messages:
        messages = [f"{path}: a {kind}, not limits (no \"imucal_limits\": 1)"]
    if messages:
        raise DataError("\n".join(messages))


def run(arguments):
    """Run the command: 0 valid, 1 valid but beyond the limits, 3 not valid."""
    parser = parser_of("check", "Is this file one of ours (log, model, profile, table, diagnosis, limits), and valid? Does a table keep its limits?")
    parser.add_argument("files", nargs="+", metavar="FILE")
    parser.add_argument("--limits", metavar="LIMITS.json", help="limits that the tables among the files must keep (exit 1: they do not)")
    common_options(parser)
    given = parser.parse_args(arguments)
    results = []
    for path in [*given.files, given.limits or ""]:
        keep_input(path, given.json)
    if given.limits:
        _need_limits(given.limits)
    for path in given.files:
        with plain_file(path) as source:
            kind, messages = check_file(source)
            results.append({"file": path, "kind": kind, "valid": not messages, "messages": [source.said(message) for message in messages]})
            if given.limits and kind == "table" and not messages:
                results[-1]["beyond_limits"] = judge(source, given.limits)
            if not messages and not given.quiet and given.json != "-":
                print(f"{source.name}: a valid {kind}")
    finish_json(given.json, {"files": results})
    bad = [m for r in results for m in r["messages"]]
    if bad:
        raise DataError("\n".join(bad))
    if given.limits and not any("beyond_limits" in r for r in results):
        raise DataError(f"{given.limits}: limits are of tables, and none of the files is one")
    beyond = [f"{r['file']}: {text}" for r in results for text in r.get("beyond_limits", [])]
    if not given.quiet and given.json != "-":
        for line in beyond or ([f"{given.limits}: kept"] if given.limits else []):
            print(line)
    return 1 if beyond else 0
