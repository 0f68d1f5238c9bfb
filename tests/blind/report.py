# SPDX-License-Identifier: MIT
"""The score as a markdown page: first the lines that must hold, then the tables behind them."""
from __future__ import annotations

from .intervals import text

REST = ("family_though_tellable", "sibling", "other_first", "wrong", "no_gap", "noise_alone", "abstains", "failed")
OUTSIDE = ("abstains", "family_only", "partly", "names_wrong_but_says_more", "misnamed", "noise_alone", "no_gap", "failed")


def table(header, rows):
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    return lines + ["| " + " | ".join(str(v) for v in row) + " |" for row in rows] + [""]


def line(what, entry, aim, at_least=True):
    if entry is None or not entry["n"]:
        return [what, "no case", aim, "-"]
    met = entry["rate"] >= aim if at_least else entry["ci95"][0] <= aim
    return [what, text(entry), f"{'≥' if at_least else '≤'} {aim}", "met" if met else "**short**"]


def must_show(score):
    """Rows of the summary: what, figure with interval, aim, met."""
    single, outside = score["single"], score["outside"]["by_strength"]
    pick = lambda tables, key, field: tables[key][field] if key in tables else None
    rows = [line("one cause, d ≥ 20, named first (member, or family where the profile cannot tell)", pick(single["d20_up"], "all", "first"), 0.95),
            line("the same, causes the profile can tell from other families and from slow noise",
                 pick(single["d20_up_decidable"], "decidable", "first"), 0.95),
            line("one cause, d ≥ 20, truth in the set", pick(single["d20_up"], "all", "set"), 0.98),
            line("the same, causes that the logs can tell", pick(single["d20_up_decidable"], "decidable", "set"), 0.98),
            line("one cause, d = 10, named first", pick(single["by_strength"], "10", "first"), 0.90),
            line("the same, causes that the logs can tell", pick(single["by_strength_decidable"], "10", "first"), 0.90),
            line("pairs, both named (members)", score["pair"]["all"]["both"], 0.80),
            line("pairs, both named (member or family)", score["pair"]["all"]["both_or_family"], 0.80),
            line("the same, pairs of which the logs can tell each", score["pair"]["of which the logs can tell each"]["both_or_family"], 0.80)]
    for regime, entry in score["false_names"]["table"].items():
        rows.append(line(f"false names, no gap: {regime}", entry["names"], 0.01, False))
    for what in ("all", "noise that the belief can hold"):
        rows.append(line(f"the same, {what}, without names of what is there", score["false_names"]["table"][what]["not_there"], 0.01, False))
    for d, aim in (("20", 0.85), ("40", 0.95)):
        rows.append(line(f"outside causes, d = {d}: abstains or right family only", pick(outside, d, "good"), aim))
    for d, aim in (("20", 0.85), ("40", 0.95)):
        rows.append(line(f"the same, d = {d}, those that no library member comes near", pick(score["outside"]["by_strength_tellable"], d, "good"), aim))
    for d, aim in (("20", 0.85), ("40", 0.95)):
        rows.append(line(f"of these, d = {d}: abstains or names families only, be they right or not", pick(score["outside"]["by_strength_tellable"], d, "no_member"), aim))
    if score["shrinkage"]:
        tables = score["shrinkage"]["tables"]
        rows.append(line("claimed shrinkage's interval holds the true reduction, all verdicts", tables["all verdicts"]["all"], 0.90))
        rows.append(line("the same, verdicts that claim one", tables["all verdicts"]["claiming"], 0.90))
        rows.append(line("the same, outside causes", tables.get("kind: outside", {}).get("all"), 0.90))
    rows.append(line("invariance: same cause named under four believed noises", score["invariance"]["same"], 0.95))
    rows.append(line("healthy axes beside a sick one: false names", score["axes"]["healthy_false"], 0.01, False))
    rows.append(line("the same, noise that the belief can hold", score["axes"]["healthy_false_held"], 0.01, False))
    for regime, entry in score["memory"]["by_regime"].items():
        rows.append(line(f"hysteresis and lag, random starts, noise {regime}: first (member or family)", entry["family"], 0.90))
    return rows + [seconds("CPU per axis, nothing named, calibration cold", score["cost"]["without_names"]),
                   seconds("CPU per axis, something named, calibration cold", score["cost"]["with_names"])]


def seconds(what, entry):
    """A row of times; the aims hold for four runs of 140 min and a warm calibration, so that here they are only shown."""
    if not entry["n"]:
        return [what, "no case", "", "-"]
    return [what, f"median {entry['median_s']:.2f} s, 95 % below {entry['p95_s']:.2f} s ({entry['n']})", "", ""]


def outcome_rows(entries):
    return [[k, v["n"], text(v["first"]), text(v["member"]), text(v["set"]), *(v.get(o, 0) for o in REST)] for k, v in entries.items()]


HEAD = ("cases", "n", "named first", "as a member", "truth in the set", *(o.replace("_", " ") for o in REST))


def single_pages(score):
    out = ["## One cause", ""]
    for title, key in (("By strength", "by_strength"), ("By strength, only what the profile can tell from other families and slow noise",
                       "by_strength_decidable"), ("By cause, d ≥ 10", "by_cause"), ("By believed noise, d ≥ 10", "by_regime"),
                       ("By profile, d ≥ 10", "by_profile"), ("By number of logs, d ≥ 10", "by_logs")):
        out += [f"{title}:", ""] + table(HEAD, outcome_rows(score["single"][key]))
    out += [f"Marks of the output stage named: {text(score['single']['structural'])}", "", "## Hysteresis and lag, random starts", ""]
    for title, key in (("By believed noise", "by_regime"), ("By cause", "by_cause"), ("By mechanism", "by_mechanism"),
                       ("With drop-outs or 2 % clipping beside it", "beside_structure")):
        out += [f"{title}:", ""] + table(HEAD, outcome_rows(score["memory"][key]))
    return out


def other_pages(score):
    inv = score["invariance"]
    out = ["## Same logs, four believed noises", "", f"Same cause named: {text(inv['same'])}; same family: {text(inv['same_family'])}; "
           f"same and right: {text(inv['same_and_right'])}", ""]
    out += table(("truth", "d", "first name under each believed noise"),
                 [[r["truth"], r["d"], ", ".join(f"{k}: {v}" for k, v in r["first_names"].items())] for r in inv["detail"]])
    out += ["## Two causes", ""] + table(("cases", "both as members", "both, members or families", "exactly those two", "at least one"), [
        [k, text(v["both"]), text(v["both_or_family"]), text(v["exactly"]), text(v["one"])] for k, v in score["pair"].items()])
    out += ["## No gap", ""] + table(("believed noise", "false names", "of them what is there all the same", "the others", "any gap said",
                                      "re-tuned noise said", "failed"), [
        [k, text(v["names"]), v["there"], text(v["not_there"]), text(v["gap"]), text(v["tuned"]), v["failed"]] for k, v in score["false_names"]["table"].items()])
    out += [f"Names given falsely: {dict(score['false_names']['named']) or 'none'}", "", "## Outside causes", ""]
    for title, key in (("By strength", "by_strength"), ("By strength, only those that no library member comes near", "by_strength_tellable"),
                       ("By cause, d ≥ 20", "by_cause")):
        out += [f"{title}:", ""] + table(("cases", "n", "abstains or right family only", "abstains or any family only", *(o.replace("_", " ") for o in OUTSIDE)), [
            [k, v["n"], text(v["good"]), text(v["no_member"]), *(v.get(o, 0) for o in OUTSIDE)] for k, v in score["outside"][key].items()])
    out += table(("cause", "names given"), [[k, ", ".join(f"{n} {c}" for n, c in v.items()) or "none"] for k, v in score["outside"]["named"].items()])
    a = score["axes"]
    return out + ["## Several axes", "", f"False names on healthy axes: {text(a['healthy_false'])} {dict(a['healthy_named'])}, "
                  f"of them a second process or steps that are there: {a['healthy_there']}; the sick axis right: "
                  f"{text(a['sick_first'])}; a cause of d 7 to 12 on each of three axes, right per axis: {text(a['pooled_first'])}", ""]


def shrinkage_pages(score):
    if not score["shrinkage"]:
        return []
    show = lambda v: "-" if v is None else f"{v:.2f}"
    rows = [[k, text(v["all"]), text(v["claiming"]), text(v["over_claimed"]), text(v["explained_but_grew"]), show(v["median_said"]), show(v["median_true"])]
            for k, v in score["shrinkage"]["tables"].items()]
    return ["## Claimed shrinkage against the true held-out reduction", "", "True value from the noise-free truth (`truth.py`); a verdict without a "
            "figure claims nothing and counts as covered in the first column.", ""] + table(
        ("verdicts", "interval holds the truth", "of those that claim", "over-claimed by more than .3", "explained, residual grew", "median said",
         "median true"), rows) + [f"Not scored: {dict(score['shrinkage']['skipped']) or 'none'}", ""]


def markdown(meta, score):
    out = ["# Blind check of `diagnose`", "", f"{meta['n_cases']} cases, {meta['n_asked']} questions, {meta['n_answered'] - len(score['failures'])} answered"
           + "".join(f"; {n} skipped: the program has no option for noise '{k}'" for k, n in meta["skipped"].items())
           + f"; seed `{meta['seed']}`, labels sealed as sha256 `{meta['labels_sha256']}` before the first diagnosis. "
           "Intervals: 95 % Clopper-Pearson. \"met\": the figure reaches the aim; for false names, the interval reaches down to it.", ""]
    out += table(("what it must show", "figure", "aim", ""), must_show(score))
    out += single_pages(score) + other_pages(score) + shrinkage_pages(score)
    out += ["## First names of single causes, d ≥ 10", ""] + table(("truth", "first names"), [
        [k, ", ".join(f"{n} {c}" for n, c in v.items())] for k, v in score["confusion"].items()])
    c, show = score["cost"], lambda v: "-" if v is None else f"{v:.2f} s"
    out += ["## Cost (CPU per axis, noise calibrations included)", ""] + table(("answers", "n", "median", "95 % below"), [
        [k.replace("_", " "), c[k]["n"], show(c[k]["median_s"]), show(c[k]["p95_s"])] for k in ("without_names", "with_names")])
    out += [f"Memory at most {c['rss_mb_max']:.0f} MB.", "", "## Failures and departures from the contract", ""]
    out += [f"- {f['case']}: exit {f['status']}: {f['error'].strip()[:200]}" for f in score["failures"][:20]] or ["No run failed."]
    out += [f"- {k}: {v} times" for k, v in score["shape_problems"].items()]
    return "\n".join(out) + "\n"
