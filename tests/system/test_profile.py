# SPDX-License-Identifier: MIT
"""The program `profile` from outside: the contract's fields, exit states, files that fit together."""
import json
import os
import subprocess
import sys

import pytest

from reference import BASIC, NOISE
from where import BIN

PROFILE = str(BIN / "profile")


def run(*args):
    return subprocess.run([PROFILE, *map(str, args)], capture_output=True, text=True, timeout=120)


def result_of(*args):
    done = run(*args, "--json", "-")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture
def files(tmp_path):
    def write(name, content):
        path = tmp_path / name
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return path

    write("model.json", NOISE)
    write("silent.json", {"imucal_model": 1, "arw_deg_rt_h": 0})
    write("basic.json", {**BASIC, "repeat": 1})
    write("two_soaks.json", {"imucal_profile": 1, "start_degc": 20, "segments": [
        {"rate_degc_per_min": 0, "duration_s": 1200}], "repeat": 1})
    return write, tmp_path


def test_profile_error_contract_and_figures(files):
    _, d = files
    r = result_of("error", d / "basic.json", "--model", d / "model.json", "--order", 3)
    assert abs(r["worst_dph"] / 6.934 - 1) < 0.001 and abs(r["bound_dph"] / 6.222 - 1) < 0.001
    assert abs(r["efficiency"] - r["bound_dph"] / r["worst_dph"]) < 1e-9 and r["duration_s"] == 8400
    assert r["temp_degc"][0] == 0 and r["temp_degc"][-1] == 60 and len(r["temp_degc"]) == len(r["sigma_dph"]) == 61
    assert r["believed_sigma_dph"] == r["sigma_dph"] and r["rms_dph"] < r["worst_dph"]


def test_profile_error_filter_model_changes_what_is_believed(files):
    write, d = files
    other = write("other.json", {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 40, "tau_s": 250}]})
    r = result_of("error", d / "basic.json", "--model", d / "model.json", "--order", 3, "--filter-model", other)
    assert abs(r["worst_dph"] / 7.13 - 1) < 0.001 and r["believed_worst_dph"] > 2 * r["worst_dph"]


def test_profile_error_reads_the_temperatures_of_a_log(files):
    write, d = files
    rows = ["# imucal-log = 1", "t_s,temp_degc,gx_dph"]
    for k in range(1, 8401):
        t = k - 0.5
        temp = 0 if t < 1200 else 60 if t > 7200 else (t - 1200) * 0.01
        rows.append(f"{k},{temp:.6f},0")
    log = write("log.csv", "\n".join(rows) + "\n")
    r = result_of("error", log, "--model", d / "model.json", "--order", 3, "--range", "0:60")
    assert abs(r["worst_dph"] / 6.9344 - 1) < 1e-4


def test_profile_bound_contract(files):
    _, d = files
    r = result_of("bound", "--model", d / "model.json", "--order", 3, "--duration-s", 8400)
    assert abs(r["bound_dph"] / 6.222 - 1) < 0.001 and len(r["assumptions"]) >= 3
    limited = result_of("bound", "--model", d / "model.json", "--order", 3, "--duration-s", 8400, "--max-rate", 0.6,
                        "--range", "0:60")
    assert limited["bound_dph"] == r["bound_dph"]
    assert r["proven_bound_dph"] < limited["proven_bound_dph"] < 6.934


def test_profile_optimize_writes_a_profile_that_error_confirms(files):
    _, d = files
    out = d / "best.json"
    r = result_of("optimize", "--model", d / "model.json", "--order", 3, "--range", "-10:50", "--max-rate", 2,
                  "--duration-s", 8400, "--seed", 5, "-o", out)
    e = result_of("error", out, "--model", d / "model.json", "--order", 3)
    assert abs(e["worst_dph"] - r["worst_dph"]) < 1e-6 and abs(e["worst_correlation"] - r["worst_correlation"]) < 1e-9
    assert r["worst_dph"] < 6.25 and r["efficiency"] > 0.98 and r["seed"] == 5
    assert r["proven_bound_dph"] < r["worst_dph"] <= r["paper"]["worst_dph"]
    assert json.loads(out.read_text())["start_degc"] in (-10, 50)


def test_an_effect_that_the_profile_hides_is_named_from_no_amplitude_on(files):
    """One ramp up: its rate, and time, are a function of temperature there."""
    _, d = files
    (d / "ramp.json").write_text(json.dumps({"imucal_profile": 1, "start_degc": 0, "segments": [{"rate_degc_per_min": 0.6, "to_degc": 60}]}))
    table = result_of("error", d / "ramp.json", "--model", d / "model.json", "--order", 3)["tell_apart"]
    needed = {e["name"]: e["needed_to_name"] for e in table["effects"]}
    assert table["not_visible"] and {name for name, value in needed.items() if value is None} >= set(table["not_visible"])
    assert all(value is None or value > 0 for value in needed.values()) and any(needed.values())


@pytest.mark.parametrize("args, code, says", [
    (["optimize", "--range", "0:60", "--max-rate", "0.6", "--duration-s", "3600"], 2, "--duration-s 6000"),
    (["optimize", "--range", "60:0", "--max-rate", "0.6", "--duration-s", "9000"], 2, "--range 0:60"),
    (["optimize", "--range", "0:60", "--max-rate", "0", "--duration-s", "9000"], 2, "above 0"),
    (["optimize", "--range", "0:60", "--max-rate", "1"], 2, "either --duration-s or --required-error"),
    (["optimize", "--range", "0:60", "--max-rate", "1", "--duration-s", "9000", "--tell-apart", "gremlins,warm_up"], 2,
     "thermal_hysteresis"),
    (["bound", "--duration-s", "8400", "--max-rate", "1"], 2, "--range"),
    (["error", "two_soaks.json"], 3, "--order 0"),
    (["error", "missing.json"], 3, "missing.json"),
    (["error", "basic.json", "--order", "7"], 2, "0 to 5"),
])
def test_profile_impossible_requests_say_what_to_change(files, args, code, says):
    _, d = files
    args = [str(d / a) if a.endswith(".json") else a for a in args]
    if "--order" not in args:
        args += ["--order", "3"]
    done = run(*args, "--model", d / "model.json")
    assert done.returncode == code, done.stderr
    assert says in done.stderr and done.stderr.startswith("profile: ")


def test_profile_zero_noise_is_refused_everywhere(files):
    _, d = files
    for args in (["error", d / "basic.json"], ["bound", "--duration-s", 100],
                 ["optimize", "--range", "0:60", "--max-rate", 1, "--duration-s", 9000]):
        done = run(*args, "--order", 3, "--model", d / "silent.json")
        assert done.returncode == 3 and "arw_deg_rt_h > 0" in done.stderr


def test_profile_unreachable_correlation_is_a_negative_answer(files):
    _, d = files
    done = run("optimize", "--order", 3, "--model", d / "model.json", "--range", "0:60", "--max-rate", 0.6,
               "--duration-s", 6000, "--tell-apart", "all", "--max-correlation", 0.3, "--json", "-")
    assert done.returncode == 1 and "--max-correlation" in done.stderr
    assert json.loads(done.stdout)["meets_correlation"] is False


@pytest.mark.parametrize("options, most", [((), 11_500), (("--tell-apart", "all", "--no-proof"), 7_500)])
def test_optimize_takes_the_evaluations_that_its_time_stands_on(files, options, most):
    """The dearest case of `make profile-table`; counts are the same on every machine, times are not."""
    folder = files[1]
    result = result_of("optimize", "--model", folder / "model.json", "--order", 3, "--range", "0:60", "--max-rate", 2, "--duration-s", 28800, "--seed", 1,
                       *options)
    assert 1000 < result["evaluations"] < most
    assert result["worst_dph"] < 3.41


def test_oscillations_gain_little_about_inner_soaks_and_lose_at_the_ends():
    done = subprocess.run([sys.executable, "host/scripts/profile_oscillations.py"], capture_output=True, text=True, timeout=120,
                          env={**os.environ, "PROFILE": PROFILE})
    assert done.returncode == 0, done.stderr
    rows = [line.replace("%", "").split() for line in done.stdout.splitlines() if line.endswith("%") and "open" not in line]
    inner, ends = [float(r[1]) for r in rows], [float(r[2]) for r in rows]
    assert len(rows) == 6 and -0.6 < min(inner) < -0.1 and min(ends) > 0.5


# ---- the limits of `optimize`, by hand from the segments of the profile it writes ----

SHORT_SOAKS = [  # order, range, heating, cooling degC/min, duration s, soaks from, to s, seed
    (3, (-20, 25), 0.6, 0.45, 24000, 0, 33.3, 22), (1, (0, 30), 1, None, 14700, 0, 33.3, 25), (2, (-32.5, 12.5), 0.7333337, 0.3, 18000, 120, 120, 26),
    (4, (-40, -32.7), 1, 0.45, 1992.8, 0, 40, 28), (3, (5, 65), 3, 0.3, 14200, 0, 90, 35), (3, (-20, 40), 5, None, 1080, 0, 60, 39),
    (2, (0, 100), 1 / 3, None, 40000, 10, 60, 40), (1, (5, 50), 5, 0.45, 7600, 33.3, 33.3, 53)]
BROKE = [  # once: too long by 44, 153, 20 s; soaks of 57.2 for 60, 109.8 for 120, 6.8 for 10, 8.5 for 20 s
    (3, (-32.5, 67.5), 0.7333337, 0.6666667, 40000, 0, 20, 196), (4, (5, 50), 1 / 3, 1, 40000, 10, 20, 122), (4, (-10, 35), 0.7333337, 0.45, 40000, 0, 40, 374),
    (3, (-40, -32.7), 1 / 3, 0.45, 1614, 60, 60, 139), (4, (0, 30), 0.6, 1, 6300, 120, 120, 153), (3, (-40, 60), 0.7333337, 2, 8345.45, 10, 20, 367),
    (5, (5, 50), 1 / 3, 0.45, 40000, 20, 20, 346)]


def faults_of(profile, span, heating, cooling, duration_s, min_soak_s, max_soak_s):
    """What a profile breaks, segment by segment (formats.md, Profile): a list of words."""
    temp, faults, temps, total_s = profile["start_degc"], [], [profile["start_degc"]], 0
    for segment in profile["segments"] * profile["repeat"]:
        rate = segment["rate_degc_per_min"]
        if "to_degc" not in segment:
            took_s = segment["duration_s"]
            faults += [f"soak of {took_s} s"] if rate != 0 or not min_soak_s - 1 <= took_s <= max_soak_s + 1 else []
        else:
            step = segment["to_degc"] - temp
            took_s = 60 * abs(step / rate)
            faults += [f"ramp of {rate} degC/min by {step}"] if step == 0 or abs(rate) > (heating if step > 0 else cooling) * (1 + 1e-12) else []
            temp += step
            temps.append(segment["to_degc"])
        total_s += took_s
    faults += [f"from {min(temps)} to {max(temps)} degC"] if (min(temps), max(temps)) != span else []
    return faults + ([f"{total_s} s"] if not duration_s - 2 <= total_s <= duration_s + 0.5 else [])


@pytest.mark.parametrize("case", SHORT_SOAKS + BROKE, ids=str)
def test_optimize_keeps_duration_soaks_rates_and_range(files, case):
    """With soaks this short the rest of the time must go to slower ramps."""
    order, span, heating, cooling, duration_s, min_soak_s, max_soak_s, seed = case
    out = files[1] / "limited.json"
    done = run("optimize", "--model", files[1] / "model.json", "--order", order, "--range", f"{span[0]}:{span[1]}", "--max-rate", heating,
               *(["--max-cooling-rate", cooling] if cooling else []), "--duration-s", duration_s, "--min-soak-s", min_soak_s,
               "--max-soak-s", max_soak_s, "--seed", seed, "--no-proof", "-q", "-o", out)
    assert done.returncode == 0, done.stderr
    assert faults_of(json.loads(out.read_text()), span, heating, cooling or heating, duration_s, min_soak_s, max_soak_s) == []


@pytest.mark.parametrize("change, says", [
    (lambda s: s[0].update(duration_s=62), "soak"), (lambda s: s[0].update(duration_s=18), "soak"), (lambda s: s[1].update(rate_degc_per_min=1.01), "ramp"),
    (lambda s: s[3].update(rate_degc_per_min=-0.51), "ramp"), (lambda s: s[1].update(to_degc=29), "from"), (lambda s: s[1].update(to_degc=31), "from"),
    (lambda s: s[1].update(rate_degc_per_min=0.999), " s"), (lambda s: s[0].update(duration_s=57), " s")])
def test_the_judge_of_profiles_sees_each_fault(change, says):
    segments = [{"rate_degc_per_min": 0, "duration_s": 60}, {"rate_degc_per_min": 1, "to_degc": 30}, {"rate_degc_per_min": 0, "duration_s": 20},
                {"rate_degc_per_min": -0.5, "to_degc": 0}]
    profile = {"start_degc": 0, "segments": segments, "repeat": 1}
    limits = (0, 30), 1, 0.5, 60 + 1800 + 20 + 3600, 20, 60
    assert faults_of(profile, *limits) == []
    change(segments)
    assert any(says in fault for fault in faults_of(profile, *limits))
