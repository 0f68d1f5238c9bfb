# SPDX-License-Identifier: MIT
"""`calibrate fit`: logs in, table and result out; bad input ends with the right status and its reason."""
import json
import math
import subprocess

import pytest

from reference import BASIC, COEFF_DPH, MODEL
from where import BIN


def run(*arguments):
    return subprocess.run([str(a) for a in arguments], capture_output=True, text=True, timeout=60)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("fit")
    (path / "model.json").write_text(json.dumps(MODEL))
    (path / "profile.json").write_text(json.dumps(BASIC))
    for i in (1, 2):  # two runs of one device
        result = run(BIN / "gyrosim", "log", "--model", path / "model.json", "--profile", path / "profile.json",
                     "--axes", 2, "--seed", 1, "--log-index", i, "-o", path / f"log{i}.csv")
        assert result.returncode == 0, result.stderr
    return path


def truth(axis, temp):
    tn = (temp - 30) / 30
    return sum(b * tn**i for i, b in enumerate(COEFF_DPH))


@pytest.mark.parametrize("method", ["kf", "poly"])
@pytest.mark.parametrize("logs", [[1], [1, 2]])
def test_fit_gives_contract_fields_and_predicted_error(folder, method, logs):
    out, table = folder / "out.json", folder / "table.json"
    result = run(BIN / "calibrate", "fit", *[folder / f"log{i}.csv" for i in logs], "--method", method, "--order", 3,
                 "--model", folder / "model.json", "-o", table, "--json", out)
    assert result.returncode == 0, result.stderr
    axes = json.loads(out.read_text())["axes"]
    assert [a["axis"] for a in axes] == ["gx_dph", "gy_dph"]
    for axis in axes:
        assert (axis["order"], axis["t0_degc"], axis["range_degc"]) == (3, 30, 30)
        assert len(axis["coeff_dph"]) == 4 and len(axis["sigma_dph"]) == len(axis["temp_degc"])
        # reference figures A, tests/README.md: 6.93 dph for one log; with a constant of its own per log the mean over two is 1/sqrt(2) of it
        assert max(axis["sigma_dph"]) == pytest.approx(6.93 / len(logs) ** 0.5, rel=0.03)
        assert axis["residual_rms_dph"] == pytest.approx(41.2, rel=0.06)
    written = json.loads(table.read_text())
    assert written["axes"][0]["coeff_dph"] == pytest.approx(axes[0]["coeff_dph"], rel=1e-6)


def test_both_methods_agree_below_3_dph(folder):  # paper, Fig. 14
    coefficients = {}
    for method in ("kf", "poly"):
        result = run(BIN / "calibrate", "fit", folder / "log1.csv", "--method", method, "--model", folder / "model.json", "--json", "-")
        coefficients[method] = json.loads(result.stdout)["axes"][0]["coeff_dph"]
    for k in range(61):
        tn = (k - 30) / 30
        difference = sum((a - b) * tn**i for i, (a, b) in enumerate(zip(coefficients["kf"], coefficients["poly"])))
        assert abs(difference) < 3


def edited(folder, name, change):
    lines = (folder / "log1.csv").read_text().splitlines()
    header = next(i for i, line in enumerate(lines) if line.startswith("t_s"))
    path = folder / name
    path.write_text("\n".join(change(lines, header)) + "\n")
    return path


def still(lines, header):
    return lines[: header + 1] + [f"{i},20,1,1" for i in range(1, 500)]


def with_text(lines, header):
    lines[header + 5] = "5,warm,1,1"
    return lines


def with_gap(lines, header):
    return lines[: header + 1000] + lines[header + 1600 :]


def test_bad_input_ends_with_status_3_and_its_reason(folder):
    model = ["--model", folder / "model.json"]
    cases = [
        ([edited(folder, "still.csv", still), *model], 3, "never moves"),
        ([edited(folder, "text.csv", with_text), *model], 3, "warm"),
        ([folder / "absent.csv", *model], 3, "absent.csv"),
        ([folder / "log1.csv"], 2, "--model"),
        ([folder / "log1.csv", "--order", 6, *model], 2, "order"),
        ([folder / "log1.csv", "--axis", "gq_dph", *model], 3, "gq_dph"),
        ([folder / "log1.csv", "--range", "60:0", *model], 2, "60:0"),
        ([folder / "log1.csv", "--serial", "two words", "-o", folder / "x.json", *model], 3, "two words"),
    ]
    for arguments, status, reason in cases:
        result = run(BIN / "calibrate", "fit", *arguments)
        assert result.returncode == status, (arguments, result.stderr)
        assert reason in result.stderr, result.stderr
    assert not (folder / "x.json").exists()


def test_a_gap_in_the_log_is_bridged(folder):
    result = run(BIN / "calibrate", "fit", edited(folder, "gap.csv", with_gap), "--model", folder / "model.json", "--json", "-")
    assert result.returncode == 0, result.stderr
    axis = json.loads(result.stdout)["axes"][0]
    assert axis["n_missing"] == 600
    for temp in range(0, 61, 5):
        got = sum(b * ((temp - 30) / 30) ** i for i, b in enumerate(axis["coeff_dph"]))
        assert abs(got - truth(axis, temp)) < 5 * max(axis["sigma_dph"])


def test_raw_log_is_decimated(folder):
    path = folder / "raw.csv"
    rows = ["# rate_hz = 10", "# gx_counts_scale_dph = 18", "t_s,temp_degc,gx_counts"]
    rows += [f"{k / 10 + 0.05:.2f},{k / 100:.2f},{round((100 + k / 10) / 18)}" for k in range(6000)]
    path.write_text("\n".join(rows) + "\n")
    result = run(BIN / "calibrate", "fit", path, "--method", "poly", "--order", 1, "--range", "0:60", "--json", "-")
    assert result.returncode == 0, result.stderr
    axis = json.loads(result.stdout)["axes"][0]
    assert axis["axis"] == "gx_dph" and axis["n_used"] == 600
    assert axis["coeff_dph"] == pytest.approx([400, 300], abs=1)


# ---- the judgement ----

def fit(folder, *arguments):
    result = run(BIN / "calibrate", "fit", *arguments, "--json", folder / "j.json", "-q")
    return result, json.loads((folder / "j.json").read_text()) if result.returncode in (0, 1) else None


def test_prior_sigma_has_its_unit_in_its_name_and_the_old_name_works(folder):
    log, model = folder / "log1.csv", ["--model", folder / "model.json"]
    priors = (["--prior-sigma-dph", 99], ["--prior-sigma", 99], [])
    new, old, default = (fit(folder, log, *model, *prior)[1]["axes"] for prior in priors)
    assert new == old != default
    for command in ("fit", "run"):
        shown = run(BIN / "calibrate", command, "--help").stdout
        assert "--prior-sigma-dph " in shown and "--prior-sigma " not in shown


def test_a_healthy_log_is_accepted_and_a_contradicted_model_is_not(folder):
    model = ["--model", folder / "model.json"]
    result, out = fit(folder, folder / "log1.csv", *model)
    assert result.returncode == 0 and out["judgement"] == {"accepted": True, "reasons": []}
    (folder / "small.json").write_text(json.dumps(dict(MODEL, arw_deg_rt_h=0.06, markov=[{"sigma_dph": 2, "tau_s": 100}])))
    table = folder / "contradicted.json"
    arguments = [folder / "log1.csv", "--model", folder / "small.json", "-o", table]
    result, out = fit(folder, *arguments)
    assert result.returncode == 1 and not table.exists()
    found = {(r["axis"], r["rule"]): r for r in out["judgement"]["reasons"]}
    nis = found["gx_dph", "nis"]
    assert 80 < nis["value"] < 120 and nis["limit"] < 1.4 and "times too small" in nis["text"]
    assert ("gy_dph", "slow") in found and ("gx_dph", "residual") in found
    # a tenth of the noise: the claimed error is ten times too small, the rescaled one is right
    axis = out["axes"][0]
    assert max(axis["rescaled_sigma_dph"]) == pytest.approx(6.93, rel=0.35)
    assert "--accept" in result.stderr and "gx_dph" in result.stderr
    rules = sorted({r["rule"] for r in out["judgement"]["reasons"]})
    result, out = fit(folder, *arguments, *[a for rule in rules for a in ("--accept", rule)])
    assert result.returncode == 0 and table.exists() and out["judgement"]["accepted"] is True
    assert {r["rule"] for r in out["judgement"]["reasons"]} == set(rules)


def test_an_unknown_rule_is_refused_with_the_nearest(folder):
    result = run(BIN / "calibrate", "fit", folder / "log1.csv", "--model", folder / "model.json", "--accept", "nsi")
    assert result.returncode == 2 and '"nis"' in result.stderr


def test_logs_of_different_devices_make_no_table(folder):
    (folder / "other.csv").write_text((folder / "log2.csv").read_text().replace("serial = 1.0", "serial = 9"))
    other = folder / "other.csv"
    arguments = [folder / "log1.csv", other, "--model", folder / "model.json"]
    result, _ = fit(folder, *arguments)
    assert result.returncode == 3 and "other.csv" in result.stderr and "serial = 9" in result.stderr and "--ignore-metadata" in result.stderr
    assert fit(folder, *arguments, "--ignore-metadata")[0].returncode == 0


def rows_changed(folder, name, change):
    """The log with every row's fields through change(i, fields)."""
    def edit(lines, header):
        rows = [change(i, line.split(",")) for i, line in enumerate(lines[header + 1:])]
        return lines[:header + 1] + [",".join(str(f) for f in row) for row in rows]
    return edited(folder, name, edit)


def bump(i, fields):
    return fields[:2] + [float(fields[2]) + 50000] + fields[3:] if 4000 <= i < 4020 else fields


def test_a_bump_is_left_out_and_counted(folder):
    result, out = fit(folder, rows_changed(folder, "bump.csv", bump), "--model", folder / "model.json")
    assert result.returncode == 0, result.stderr
    assert out["axes"][0]["n_rejected"] == 20 and out["axes"][1]["n_rejected"] == 0
    _, clean = fit(folder, folder / "log1.csv", "--model", folder / "model.json")
    assert out["axes"][0]["coeff_dph"] == pytest.approx(clean["axes"][0]["coeff_dph"], abs=6)


def test_one_bad_temperature_widens_nothing(folder):
    for at in (0, 4000, 8399):
        path = rows_changed(folder, "hot.csv", lambda i, f, at=at: [f[0], -40 if at == 4000 else 85, *f[2:]] if i == at else f)
        result, out = fit(folder, path, "--model", folder / "model.json")
        assert result.returncode == 0, result.stderr
        assert out["axes"][0]["span_degc"] == pytest.approx([0, 60], abs=0.1) and out["axes"][0]["n_bad_temperature"] <= 10
        assert max(out["axes"][0]["sigma_dph"]) == pytest.approx(6.93, rel=0.03)


@pytest.mark.parametrize("rule, change", [
    ("no-noise", lambda i, f: [f[0], f[1], 0, f[3]]),
    ("repeated", lambda i, f: [f[0], f[1], 100 if 3000 <= i < 3100 else f[2], f[3]]),
    ("temp-stuck", lambda i, f: [f[0], 20 if i >= 3200 else f[1], f[2], f[3]]),
    ("temp-jump", lambda i, f: [f[0], float(f[1]) + (8 if 4000 <= i < 5000 else 0), f[2], f[3]]),
    ("temp-spikes", lambda i, f: [f[0], 85 if i % 50 == 9 else f[1], f[2], f[3]]),
    ("measurements", lambda i, f: [f[0], f[1], "" if i > 5000 else f[2], f[3]]),
    ("residual", lambda i, f: [f[0], f[1], float(f[2]) + (300 if i % 2000 < 1000 else 0), f[3]]),
    ("rejects", lambda i, f: [f[0], f[1], float(f[2]) + (3000 if i > 5000 else 0), f[3]]),
])
def test_a_sick_axis_makes_no_table(folder, rule, change):
    table = folder / f"sick_{rule}.json"
    result, out = fit(folder, rows_changed(folder, "sick.csv", change), "--model", folder / "model.json", "-o", table)
    assert result.returncode == 1 and not table.exists(), result.stderr
    assert rule in {r["rule"] for r in out["judgement"]["reasons"]}, result.stderr
    if rule != "temp-stuck" and not rule.startswith("temp"):
        assert {r["axis"] for r in out["judgement"]["reasons"]} == {"gx_dph"}


def test_a_ramp_too_fast_or_a_span_hardly_seen_makes_no_table(folder):
    for profile, rule in (([{"rate_degc_per_min": 0, "duration_s": 1200}, {"rate_degc_per_min": 20, "to_degc": 60},
                            {"rate_degc_per_min": 0, "duration_s": 1200}], "temp-ramp"),
                          ([{"rate_degc_per_min": 0.3, "to_degc": 20}], "span")):
        (folder / "p.json").write_text(json.dumps({"imucal_profile": 1, "start_degc": 0, "segments": profile}))
        run(BIN / "gyrosim", "log", "--model", folder / "model.json", "--profile", folder / "p.json", "-o", folder / "p.csv")
        result, out = fit(folder, folder / "p.csv", "--model", folder / "model.json", "--method", "poly")
        assert result.returncode == 1 and rule in {r["rule"] for r in out["judgement"]["reasons"]}, result.stderr


def with_rates(folder, name, change, axis="gx_dph"):
    """log1.csv with `change(seconds since the start, rate)` in the place of an axis' rates."""
    def rows(lines, header):
        column = lines[header].split(",").index(axis)
        out = lines[: header + 1]
        for k, line in enumerate(lines[header + 1:]):
            cells = line.split(",")
            cells[column] = repr(change(k, float(cells[column])))
            out.append(",".join(cells))
        return out
    return edited(folder, name, rows)


@pytest.mark.parametrize("method", [["--method", "poly"], ["--model", "model.json"]])
def test_single_wild_seconds_are_named_and_no_thermometer_is_blamed(folder, method):
    wild = {5, *range(400, 8000, 400)}
    log = with_rates(folder, "wild.csv", lambda k, rate: rate + (2e4 if k in wild else 0))
    result = subprocess.run([BIN / "calibrate", "fit", log.name, *method, "-o", "never.json", "--json", "wild.json"], cwd=folder,
                            capture_output=True, text=True, timeout=60)
    assert result.returncode == 1 and not (folder / "never.json").exists()
    first = [line for line in log.read_text().splitlines() if line[0].isdigit()][5].split(",")[0]
    assert f"gx_dph: 20 seconds lie far off the polynomial (the first: wild.csv at {first} s)" in result.stderr
    for wrong in ("a minute and more", "is the thermometer stuck", "identify the model anew", "the polynomial misses"):
        assert wrong not in result.stderr
    told = json.loads((folder / "wild.json").read_text())
    assert told["axes"][0]["far_off"] == {"n": 20, "first": f"wild.csv at {first} s"} and "far_off" not in told["axes"][1]
    assert "rejects" in {reason["rule"] for reason in told["judgement"]["reasons"]}


def test_a_bias_that_steps_is_still_a_knock_of_a_minute_and_more(folder):
    log = with_rates(folder, "step.csv", lambda k, rate: rate + (2e3 if k >= 4000 else 0))
    result = run(BIN / "calibrate", "fit", log, "--model", folder / "model.json")
    assert result.returncode == 1 and "knocks of a minute and more" in result.stderr and "far off" not in result.stderr


def test_a_dead_axis_gets_no_coefficients_and_no_predicted_error(folder):
    log = with_rates(folder, "dead.csv", lambda k, rate: 123.4)
    result = run(BIN / "calibrate", "fit", log, "--method", "poly")
    dead, alive = result.stdout.split("gx_dph ")[1].split("gy_dph ")
    assert result.returncode == 1 and "no noise: not a calibration, so no coefficients" in dead
    assert "predicted" not in dead and "B(T)" not in dead and "predicted" in alive
    insisted = run(BIN / "calibrate", "fit", log, "--method", "poly", "--accept", "no-noise", "--accept", "repeated")
    assert insisted.returncode == 0 and insisted.stdout.count("predicted one-sigma error") == 2


def test_a_fit_says_what_it_wrote_and_what_comes_next(folder):
    table = folder / "said.json"
    said = run(BIN / "calibrate", "fit", folder / "log1.csv", "--model", folder / "model.json", "-o", table).stdout
    assert said.endswith(f"written to {table}; next: calibrate --port PORT flash {table}\n")
    said = run(BIN / "calibrate", "fit", folder / "log1.csv", "--model", folder / "model.json").stdout
    assert said.endswith("no table written: -o TABLE.json writes one\n")
    log = with_rates(folder, "dead.csv", lambda k, rate: 123.4)
    assert "written" not in run(BIN / "calibrate", "fit", log, "--model", folder / "model.json", "-o", folder / "never.json").stdout


def test_without_a_model_a_jump_and_a_warm_up_are_told(folder):
    def notes(log):
        result = run(BIN / "calibrate", "fit", log, "--method", "poly", "--json", folder / "shape.json")
        assert result.returncode in (0, 1), result.stderr  # a warm-up during a soak is refused too
        warnings = json.loads((folder / "shape.json").read_text()).get("warnings", [])
        assert all(f"calibrate: note: {w}\n" in result.stderr for w in warnings)
        return [w for w in warnings if w.startswith("gx_dph: the ")]
    assert notes(folder / "log1.csv") == notes(folder / "log2.csv") == []
    (told,) = notes(with_rates(folder, "jump.csv", lambda k, rate: rate + (200 if k >= 4000 else 0)))
    assert abs(float(told.split(" s of ")[0].split()[-1]) - 4000) < 100 and abs(float(told.split("about ")[1].split()[0]) - 200) < 40
    (told,) = notes(with_rates(folder, "warm.csv", lambda k, rate: rate + 400 * math.exp(-k / 800)))
    assert "a warm-up?" in told and "the first 128 s of" in told
    assert notes(with_rates(folder, "one.csv", lambda k, rate: rate + (3e4 if k == 4000 else 0))) == []


def test_the_turn_on_constant_is_said_to_sit_in_b0(folder):
    """No static run tells it from the bias, and another run has another one: the predicted error does not count it."""
    (folder / "turn_on.json").write_text(json.dumps({**MODEL, "turn_on_sigma_dph": 50}))
    for model, words in (("turn_on.json", "b0 holds the turn-on constant (50 dph from run to run)"), ("model.json", None)):
        for method in ("kf", "poly"):
            fit = run(BIN / "calibrate", "fit", folder / "log1.csv", "--method", method, "--model", folder / model, "--json", folder / "said.json")
            axes = json.loads((folder / "said.json").read_text())["axes"]
            assert fit.returncode == 0 and [axis.get("turn_on_sigma_dph") for axis in axes] == [50 if words else None] * 2
            assert fit.stdout.count(words or "turn-on") == (2 if words else 0)


def test_one_axis_has_one_name_in_every_program(folder):
    """Whatever the unit of its column; --axis takes the column's name too."""
    text = (folder / "log1.csv").read_text().splitlines()
    at = next(i for i, line in enumerate(text) if line.startswith("t_s,"))
    head = text[at].replace("gx_dph", "gx_dps").replace("gy_dph", "ay_ms2")
    rows = [line.split(",") for line in text[at + 1:]]
    lines = [",".join([r[0], r[1], repr(float(r[2]) / 3600), repr(float(r[3]) / 1e5)]) for r in rows]
    (folder / "units.csv").write_text("\n".join([*text[:at], head, *lines]) + "\n")
    asked = {"dp": ["dp", "units.csv", "--tau", "1,10"], "errormodel": ["errormodel", "check", "units.csv", "--model", "model.json", "--tau", "2,20"],
             "calibrate": ["calibrate", "fit", "units.csv", "--method", "poly"],
             "diagnose": ["diagnose", "--log", "units.csv", "--model", "model.json", "--only", "thermal_hysteresis", "--threads", "1"]}
    for program, words in asked.items():
        for given in ([], ["--axis", "gx_dps"], ["--axis", "gx_dph"]):
            done = subprocess.run([str(BIN / words[0]), *words[1:], *given, "--json", "-"], capture_output=True, text=True, timeout=120, cwd=folder)
            assert done.returncode in (0, 1), done.stderr
            result = json.loads(done.stdout)
            names = {entry["axis"] for entry in result.get("curves", result.get("axes"))}
            assert names == ({"gx_dph", "ay_mg"} if program == "dp" and not given else {"gx_dph"}), (program, given, names)
