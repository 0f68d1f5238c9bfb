# SPDX-License-Identifier: MIT
"""The score as a markdown page."""
from __future__ import annotations

from .intervals import text


def table(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    return lines + ["| " + " | ".join(str(v) for v in row) + " |" for row in rows] + [""]


def outcome_rows(entries, label=str):
    return [[label(k), v["n"], text(v["top1"]), text(v["set"]), v["no_gap"], v["abstains"], v["wrong"], v["failed"]]
            for k, v in entries.items() if v["n"]]


HEAD = ("cases", "n", "named first", "truth not excluded", "no gap", "abstains", "wrong", "failed")


def markdown(meta, score):
    out = ["# Blind check of `diagnose`", "",
           f"{meta['n_cases']} cases ({meta['n_effect']} with an effect, {meta['n_gap_free']} gap-free), "
           f"{meta['n_runs']} diagnoses, " + (f"{meta['n_not_reached']} further cases drawn but not reached in the time given "
           "(a random sample), " if meta["n_not_reached"] else "") + f"seed `{meta['seed']}`, labels sealed as sha256 `{meta['labels_sha256']}` before "
           "the first diagnosis.  Intervals are 95 % Clopper-Pearson.  Strength d: sqrt(2 x expected log-likelihood gain "
           "of the true effect over the fitted nominal model, training runs), worked out by the check's own whitening.  "
           "Cases come in groups that share chamber profiles and believed noise, as on a production line, so that one "
           "calibration of the evidence serves a group.", ""]
    single = score["single"]
    out += ["## One effect", "", "By strength, all profiles:", ""] + table(HEAD, outcome_rows(single["by_strength"], "d = {}".format))
    out += ["Only cases whose repeatable effect the profile can tell from every other repeatable library effect, "
            "d sqrt(1 - rho2) >= 4 (noise effects count as separable):", ""]
    out += table(HEAD, outcome_rows(single["by_strength_separable"], "d = {}".format))
    out += ["By family of profiles, d >= 10:", ""] + table(HEAD, outcome_rows(single["by_family"]))
    out += ["By effect, d >= 10:", ""] + table(HEAD, outcome_rows(single["by_effect"]))
    out += ["Structural effects:", ""] + table(HEAD, outcome_rows({"structural": single["structural"]}))
    out += [f"A further name beside the first one (d >= 10): {text(single['with_a_further_name'])}", ""]
    out += ["## Confusion of single effects", ""]
    out += table(("truth", "answers"), [[k, ", ".join(f"{n} {c}" for n, c in v.items())] for k, v in score["confusion"].items()])
    out += ["## Two effects", ""] + table(
        ("each at d =", "both named", "exactly both", "only one", "both not excluded"),
        [[k, text(v["both"]), text(v["exactly_both"]), text(v["only_one"]), text(v["both_in_sets"])]
         for k, v in score["pair"].items()])
    out += ["## No gap", ""]
    out += ["Fitted noise: the model's noise parameters come from four other runs and `--model-seconds` says so, except in the "
            "last table.", ""]
    for stated in ("0.01", "0.05", "0.01, fitted noise taken for known"):
        entries = score["gap_free"][stated]
        if not entries["all"]["any_gap"]["n"]:
            continue
        out += [f"Stated false-alarm rate {stated}:", ""] + table(
            ("cases", "false names", "of these not only noise parameters", "any gap"),
            [[k, text(v["false_names"]), text(v["false_names_besides_noise_parameters"]), text(v["any_gap"])]
             for k, v in entries.items()])
    out += [f"Names given falsely at 0.01: {score['gap_free']['named'] or 'none'}", ""]
    out += ["## Withheld effects", ""]
    head = ("cases", "n", "abstains", "names and says that more remains", "abstains or says so", "misnamed", "no gap", "failed")
    for key, title in (("library", "Library effects taken out with `--without`"),
                       ("library_by_effect", "The same by effect, d >= 20"),
                       ("unknown", "Random functions and random noise shapes"),
                       ("unknown_by_kind", "The same by kind, d >= 20")):
        rows = [[k, v["n"], text(v["abstains"]), text(v["partly"]), text(v["abstains_or_partly"]), text(v["misnamed"]),
                 text(v["no_gap"]), v["failed"]] for k, v in score["withheld"][key].items() if v["n"]]
        if rows:
            out += [f"{title}:", ""] + table(head, rows)
    out += ["*separable*: no library effect comes within 8 nats of it on that profile (d_left >= 4).", ""]
    if score["up_only"]:
        out += ["## Rate, hysteresis and lag of fixed size (15 per degC/min; 20 dph, 5 degC; 150 s)", ""]
        out += table(HEAD, outcome_rows(score["up_only"]))
        for kind in ("up_only", "advised"):
            if kind in score["up_only"]:
                out += [f"{kind}: the truth is named, in the set, or listed as not detectable or not distinguishable: "
                        f"{text(score['up_only'][kind]['named_or_warned'])}", ""]
    m = score["multi_axis"]
    out += ["## Several axes", "", f"Named per axis where all axes share the cause: {text(m['top1'])}; common mode between two "
            f"axes found: {text(m['common_mode'])}", ""]
    out += ["## How far the held-out gap shrinks, as a share of the oracle's gain", ""] + table(
        ("cases", "n", "median", "quartiles"),
        [[k, v["n"], f"{v['median']:.3f}", "{:.3f} … {:.3f}".format(*v["quartiles"])] for k, v in score["closure"].items()])
    if score.get("interval"):
        out += ["## Coverage of the 95 % interval of the shrinkage", "",
                "Truth: mean over fresh held-out runs that neither the fit nor the report saw.", ""]
        out += table(("cases", "covered", "median width"),
                     [[k, text(v["covered"]), f"{v['median_width']:.3f}"] for k, v in score["interval"].items()])
    out += ["## Coverage of the parameters (1.96 standard errors)", ""] + table(
        ("parameter", "covered"), [[k, text(v)] for k, v in score["parameter_coverage"].items()])
    c = score["cost"]
    show = lambda v, unit: "-" if v is None else f"{v:.2f} {unit}"
    out += ["## Cost", "", f"CPU per axis: median {show(c['cpu_s_per_axis_median'], 's')}, 95 % below "
            f"{show(c['cpu_s_per_axis_p95'], 's')}; with calibration of the evidence ({c['calls_with_calibration']} calls): median "
            f"{show(c['calibration_cpu_s_median'], 's')}; memory {show(c['rss_mb_median'], 'MB')}.", ""]
    out += ["## Failures and departures from the contract", ""]
    out += [f"- {f['case']}: exit {f['status']}: {f['error'].strip()[:200]}" for f in score["failures"][:20]] or ["No run failed."]
    out += [f"- {k}: {v} times" for k, v in score["shape_problems"].items()]
    return "\n".join(out) + "\n"
