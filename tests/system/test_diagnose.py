# SPDX-License-Identifier: MIT
"""diagnose from outside: what it says of simulated logs with known effects, of poor logs, and of wrong input."""
import json
import math
import re
import subprocess
from pathlib import Path

import pytest

from reference import DRIFTING as MODEL
from where import BIN, DATA, ROOT

# Two rates, reversals and soaks on the way: tells thermal effects apart.
PROFILE = {"imucal_profile": 1, "start_degc": 0, "segments": [
    {"rate_degc_per_min": 0, "duration_s": 300}, {"rate_degc_per_min": 3, "to_degc": 30},
    {"rate_degc_per_min": 0, "duration_s": 400}, {"rate_degc_per_min": 3, "to_degc": 60},
    {"rate_degc_per_min": 0, "duration_s": 400}, {"rate_degc_per_min": 1.5, "to_degc": 30},
    {"rate_degc_per_min": 0, "duration_s": 400}, {"rate_degc_per_min": 1.5, "to_degc": 0}]}
UP_ONLY = {"imucal_profile": 1, "start_degc": 0, "segments": [{"rate_degc_per_min": 0.6, "to_degc": 60}]}


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    return Lab(tmp_path_factory.mktemp("diagnose"))


class Lab:
    def __init__(self, folder):
        self.folder = folder
        self.model = self.write("model.json", MODEL)
        self.profile = self.write("profile.json", PROFILE)

    def write(self, name, content):
        path = self.folder / name
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return str(path)

    def logs(self, name, effects, n=4, seed=11, axes=1, profile=None, model=None):
        spec = self.write(f"{name}_effects.json", effects)
        paths = []
        for i in range(n):
            paths.append(str(self.folder / f"{name}_{i}.csv"))
            subprocess.run([BIN / "gyrosim", "log", "--model", model or self.model, "--profile",
                            profile or self.profile, "--effects", spec, "--axes", str(axes), "--seed", str(seed),
                            "--log-index", str(i), "--n-logs", str(n), "-q", "-o", paths[-1]], check=True)
        return paths

    def run(self, logs, *extra, model=None, code=0):
        """model=False: none is believed."""
        out = self.folder / "out.json"
        believed = [] if model is False else ["--model", model or self.model]
        done = subprocess.run([BIN / "diagnose", *believed, "--log", *logs, "--nulls", "150",
                               "--threads", "1", "--cache", str(self.folder / "cache"), "--json", str(out),
                               *map(str, extra)], capture_output=True, text=True)
        assert done.returncode == code, done.stderr
        self.text, self.errors = done.stdout, done.stderr
        return json.loads(out.read_text()) if code in (0, 1) else None


HYSTERESIS = [{"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 60, "width_degc": 5}}]


def names(axis):
    return [effect["name"] for effect in axis["effects"]]


def test_strong_hysteresis_is_named_located_and_shrinks_the_held_out_gap(lab):
    logs = lab.logs("hyst", HYSTERESIS, n=4)
    model_out = lab.folder / "with_effects.json"
    result = lab.run(logs[:3], "--holdout", logs[3], "--model-out", model_out)
    axis = result["axes"][0]
    assert result["imucal_diagnosis"] == 1 and axis["axis"] == "gx_dph"
    assert f'IMUCAL_VERSION "{result["version"]}"' in (ROOT / "common/version.h").read_text()
    assert axis["verdict"] == "explained"
    assert names(axis) == ["thermal_hysteresis"]
    effect = axis["effects"][0]
    error = effect["std_errors"]["amplitude_dph"]
    assert abs(effect["parameters"]["amplitude_dph"] - 60) < 4 * error + 3
    assert abs(effect["parameters"]["width_degc"] - 5) < 4 * effect["std_errors"]["width_degc"]
    assert effect["held_out_gain"] > 20
    assert effect["set"][0]["name"] == "thermal_hysteresis"
    assert axis["gap"]["shrinkage"] > 0.9
    assert axis["gap"]["residual_rms_dph"]["after"] < axis["gap"]["residual_rms_dph"]["before"]
    assert axis["gap"]["ci95"][0] > 0.3
    assert axis["where"]["tau_s"][1] > 200  # slow
    total = sum(cell["excess"] for cell in axis["where"]["by_tau"])
    for table in ("by_temperature", "by_phase", "by_log"):
        assert sum(cell["excess"] for cell in axis["where"][table]) == pytest.approx(total, abs=1e-6)
    assert len(lab.text.splitlines()) <= 24
    # The model that is written carries the effect; with it in the simulation the gap of that kind is back.
    written = json.loads(model_out.read_text())
    assert written["effects"][0]["name"] == "thermal_hysteresis"
    again = lab.logs("again", [], model=str(model_out), n=3, seed=12)
    assert names(lab.run(again)["axes"][0]) == ["thermal_hysteresis"]
    # … and with the effect in the model that is believed there is none.
    assert lab.run(again, model=str(model_out))["axes"][0]["verdict"] == "no_gap"


def test_a_name_that_held_out_logs_do_not_support_is_not_given(lab):
    fitted, held_out = lab.logs("with", HYSTERESIS, n=3), lab.logs("lacking", [], n=1, seed=31)
    axis = lab.run(fitted, "--holdout", held_out[0])["axes"][0]
    assert "thermal_hysteresis" not in names(axis)
    assert axis["verdict"] in ("unexplained", "partly_explained") and axis["gap"]["shrinkage"] is None
    assert any("thermal_hysteresis" in note and "held-out data do not support" in note for note in axis["notes"])


def test_no_gap_says_what_the_profile_could_not_show(lab):
    up = lab.write("up_only.json", UP_ONLY)
    axis = lab.run(lab.logs("up_null", [], n=2, profile=up))["axes"][0]
    hidden = {entry["name"] for entry in axis["not_detectable_here"]}
    assert axis["verdict"] == "no_gap" and {"temperature_rate", "thermal_hysteresis"} <= hidden
    assert all(name.replace("_", " ") in axis["statement"] for name in hidden)
    # The headline is short; what is hidden is the last of the advice.
    headline, told = axis["statement"].split("; not detectable on these profiles: ")
    assert f"gx_dph: {headline}\n" in lab.text
    assert lab.text.rstrip().splitlines()[-1] == f"advice    Cannot be seen in these logs: {told}."


def test_logs_of_the_model_have_no_gap_and_the_calibration_is_kept(lab):
    logs = lab.logs("null", [], n=3)
    first = lab.run(logs)
    assert first["axes"][0]["verdict"] == "no_gap"
    assert first["axes"][0]["gap"]["shrinkage"] is None and first["axes"][0]["gap"]["ci95"] is None
    assert first["axes"][0]["where"] is None and first["axes"][0]["effects"] == []
    second = lab.run(logs)
    assert second["calibration"]["from_cache"] is True
    assert second["axes"][0]["plots"]["candidates"] == first["axes"][0]["plots"]["candidates"]
    # Another profile: another calibration.
    up = lab.write("up_only.json", UP_ONLY)
    assert lab.run(lab.logs("null_up", [], n=3, profile=up))["calibration"]["from_cache"] is False


def test_what_other_questions_left_in_the_cache_changes_no_answer(lab):
    logs = lab.logs("kept", HYSTERESIS, n=2)
    for factor in (1, 1.15, 0.87, 3):
        believed = {**MODEL, "markov": [{**MODEL["markov"][0], "sigma_dph": factor * MODEL["markov"][0]["sigma_dph"]}]}
        model = lab.write("believed.json", believed)
        kept, anew = lab.run(logs, model=model)["axes"][0], lab.run(logs, "--no-cache", model=model)["axes"][0]
        assert kept["threshold_nats"] == anew["threshold_nats"] and kept["effects"] == anew["effects"]


def test_without_the_cause_the_gap_is_not_called_absent(lab):
    logs = lab.logs("withheld", [{"name": "sinusoid", "parameters": {"amplitude_dph": 9, "frequency_hz": 0.031}}], n=3)
    assert names(lab.run(logs)["axes"][0]) == ["sinusoid"]
    axis = lab.run(logs, "--without", "sinusoid")["axes"][0]
    assert axis["verdict"] in ("unexplained", "partly_explained")
    assert "sinusoid" not in names(axis)
    assert lab.run(logs, "--only", "sinusoid")["axes"][0]["effects"][0]["name"] == "sinusoid"


def test_up_only_profiles_say_what_they_cannot_show(lab):
    profile = lab.write("up.json", UP_ONLY)
    axis = lab.run(lab.logs("up", [], n=2, profile=profile))["axes"][0]
    hidden = {entry["name"] for entry in axis["not_detectable_here"]}
    assert {"temperature_rate", "thermal_hysteresis"} <= hidden
    assert axis["advised_profile"]["imucal_profile"] == 1
    separating = lab.run(lab.logs("sep", [], n=3))["axes"][0]
    assert "thermal_hysteresis" not in {entry["name"] for entry in separating["not_detectable_here"]}


def test_what_was_found_is_not_called_undetectable(lab):
    up = lab.write("up.json", UP_ONLY)
    for effect, parameters, n in (("thermal_hysteresis", {"amplitude_dph": 400, "width_degc": 10}, 3),
                                  ("warm_up", {"amplitude_dph": 400, "tau_s": 3000}, 2)):
        axis = lab.run(lab.logs("found_" + effect, [{"name": effect, "parameters": parameters}], n=n, profile=up))["axes"][0]
        found = {member["name"] for named in axis["effects"] for member in named["set"]}
        hidden = {entry["name"] for entry in axis["not_detectable_here"]}
        assert effect in found and hidden and not hidden & found
        limits = [line for line in axis["advice"] if "annot be seen in" in line]
        assert limits and all(f" {name.replace('_', ' ')} " not in line for name in found for line in limits)


def test_advice_is_about_the_answer_and_tells_sizes(lab):
    """A pair with a name that stands alone is no advice; what a profile would show comes with its size."""
    axis = lab.run(lab.logs("hyst", HYSTERESIS, n=4)[:3])["axes"][0]
    (effect,) = axis["effects"]
    assert [c["name"] for c in effect["set"]] == ["thermal_hysteresis"] and axis["open_pairs"] == []
    assert ["thermal_creep", "thermal_hysteresis"] in axis["indistinguishable"]  # on these profiles, at a smaller size
    assert "tell apart" not in lab.text and "Reversals inside a run" not in lab.text and "of a size that matters" not in lab.text
    up = lab.write("up.json", UP_ONLY)
    axis = lab.run(lab.logs("up", [], n=2, profile=up))["axes"][0]
    for entry in axis["not_detectable_here"]:
        size = next(iter(entry["smallest_detectable"].values()))
        (told,) = [line for line in axis["advice"] if line.startswith("Cannot be seen in these logs")]
        name = entry["name"].replace("_", " ")
        assert f"{name} of any size" in told or size == pytest.approx(
            float(told.split(f"{name} smaller than ")[1].split()[0]), rel=0.06)  # two digits
    assert axis["advice"].index(told) == len(axis["advice"]) - 2  # before the offsets that no log shows
    (advised,) = [line for line in axis["advice"] if "advised profile" in line]
    assert advised.startswith("Record four runs") and "They would show" in advised and "a thermal hysteresis from " in advised
    assert "mirrored (from the hottest" in advised
    there, back = axis["advised_profile"], axis["advised_profile_mirrored"]
    both = there["start_degc"] + back["start_degc"]
    assert back["start_degc"] > there["start_degc"]
    for a, b in zip(there["segments"], back["segments"]):
        assert a.get("to_degc", 0) + b.get("to_degc", both) == pytest.approx(both) if a.get("rate_degc_per_min") else a == b
    # What the advice says of the profile holds for it.
    runs = [lab.logs(f"advised_{i}", [], n=2, seed=40 + i, profile=lab.write(f"advised_{i}.json", profile))
            for i, profile in enumerate((there, back))]
    shown = {d["name"]: d["smallest_detectable"] for d in lab.run([*runs[0], *runs[1]])["axes"][0]["smallest_detectable"]}
    assert shown["thermal_hysteresis"]["amplitude_dph"] == pytest.approx(
        float(advised.split("thermal hysteresis from ")[1].split()[0]), rel=0.12)


def places(axis):
    """What is named beside averaging times."""
    return re.findall(r"between (-?\d+) and (-?\d+) degC|(from \d+ to \d+ s)|(while .*?)(?:,|$)|(in logs? .*)", axis["where"]["sentence"])


def test_a_place_is_named_where_the_rest_is_clearly_lower(lab):
    """A loop that is open everywhere and slow noise have none; a step at 35 degC has, and a log that is louder than the others."""
    loop = lab.run(lab.logs("hyst", HYSTERESIS, n=4))["axes"][0]
    assert names(loop) == ["thermal_hysteresis"] and places(loop) == [], loop["where"]["sentence"]
    assert loop["where"]["logs"] == [0, 1, 2, 3] and loop["where"]["direction"] == "any"
    walk = lab.run(lab.logs("walk", [{"name": "rate_random_walk", "parameters": {"k_dph_per_rt_s": 2}}], n=4))["axes"][0]
    assert walk["effects"] and places(walk) == [], walk["where"]["sentence"]
    step = lab.run(lab.logs("step_at", [{"name": "thermal_step", "parameters": {"amplitude_dph": 90, "temp_degc": 35, "width_degc": 4}}], n=4))["axes"][0]
    (place,) = places(step)
    assert 20 <= float(place[0]) < 35 < float(place[1]) <= 45
    logs = lab.logs("louder", [], n=3)
    rewrite(logs[2], lambda t, temp, rate: (temp, [200 + 1.5 * r for r in rate]))
    (place,) = places(lab.run(logs)["axes"][0])
    assert place[4] == "in log 3"


def test_what_a_noise_leaves_is_told_beside_what_was_believed(lab):
    effects = [{"name": "rate_random_walk", "parameters": {"k_dph_per_rt_s": 2}}]
    for model, words in ((None, "the believed noise"), (False, "the noise that was estimated without a cause")):
        axis = lab.run(lab.logs("walk", effects, n=4), model=model)["axes"][0]
        if not axis["effects"]:  # swallowed by the noise that was estimated
            continue
        rms, gap = axis["gap"]["residual_rms_dph"], axis["gap"]
        assert not gap["has_mean"] and "a noise has no mean to predict" in gap["remainder"] and "does not shrink" not in lab.text
        told = [float(x) for x in re.findall(r"would leave ([\d.]+) dph, these logs show ([\d.]+); with the noise that was found ([\d.]+) is", lab.text)[0]]
        assert words in gap["statement"] and gap["statement"] in lab.text
        expected = math.hypot(rms["noise"], rms["errors_of_fit"])
        assert told == pytest.approx([rms["believed_noise"], rms["after"], expected], abs=0.06)
    assert rms["believed_noise"] > 0
    axis = lab.run(lab.logs("walk", effects, n=4))["axes"][0]
    rms = axis["gap"]["residual_rms_dph"]
    # 20 dph and 100 s: 18 dph in one-minute means of runs of 85 min; a walk of 2 dph in the root of a second: 2 sqrt(5100 / 6).
    assert rms["believed_noise"] == pytest.approx(18.5, rel=0.05) and 40 < rms["noise"] < 90 and 30 < rms["before"] < 120


def test_logs_without_temperatures_are_advised_to_have_them(lab):
    path = lab.logs("bare", [], n=1)[0]
    rows = [line.split(",") for line in Path(path).read_text().splitlines()]
    Path(path).write_text("\n".join(",".join([row[0], "", *row[2:]] if row[0][:1].isdigit() else row) for row in rows) + "\n")
    axis = lab.run([path])["axes"][0]
    assert axis["advised_profile"] is None and axis["open_pairs"] == []
    assert "Record the temperature with the rates (column temp_degc)" in lab.text and "profile, " not in lab.text
    if axis["not_detectable_here"]:
        assert "Longer logs would show smaller ones" in lab.text


def test_less_noise_than_estimated_is_no_place(lab):
    for name, effects in (("none_est", []), ("walk_est", [{"name": "rate_random_walk", "parameters": {"k_dph_per_rt_s": 2}}])):
        lab.run(lab.logs(name, effects, n=2), model=False)
        for times in re.findall(r"the residual is ([\d.]+) times", lab.text):
            assert float(times) >= 1


def test_structural_effects_are_read_off_the_samples(lab):
    for name, parameters in (("quantization", {"lsb_dph": 60}), ("held_samples", {"probability": 0.03}),
                             ("dead_band", {"width_dph": 25}), ("saturation", {"limit_dph": 420})):
        axis = lab.run(lab.logs(name, [{"name": name, "parameters": parameters}], n=2))["axes"][0]
        assert names(axis) == [name]
        key, value = next(iter(parameters.items()))
        assert axis["effects"][0]["parameters"][key] == pytest.approx(value, rel=0.15)


def test_no_temperature_gaps_and_a_single_log(lab):
    lines = Path(lab.logs("poor", [{"name": "second_markov", "parameters": {"sigma_dph": 40, "tau_s": 20}}],
                          n=1)[0]).read_text().splitlines()
    head = [line for line in lines if line.startswith("#")] + ["t_s,temp_degc,gx_dph"]
    rows = [line.split(",") for line in lines if line[0].isdigit()]
    kept = [f"{r[0]},,{r[2]}" for i, r in enumerate(rows) if i % 50 != 7 and not 900 < i < 1200]
    path = lab.write("poor.csv", "\n".join(head + kept) + "\n")
    axis = lab.run([path])["axes"][0]
    assert axis["verdict"] != "no_gap"
    named = {c["name"] for effect in axis["effects"] for c in effect["set"]}
    assert named & {"second_markov", "telegraph_noise", "noise_parameters", "flicker_noise"}
    assert axis["gap"]["method"] == "quarters of the one log held out in turn, each with a constant of its own"
    assert not named & {"thermal_hysteresis", "temperature_rate", "thermal_lag"}


def test_rows_may_be_any_regular_step_apart(lab):
    text = Path(lab.logs("step", [], n=1)[0]).read_text()
    for step_s in (0.5, 5, 20):
        rows = [line.split(",") for line in text.splitlines()]
        slow = "\n".join(",".join([f"{float(cells[0]) * step_s:g}", *cells[1:]]) if cells[0][0].isdigit() else ",".join(cells)
                         for cells in rows)
        (axis,) = lab.run([lab.write(f"step_{step_s}.csv", slow + "\n")])["axes"]
        taus = axis["plots"]["dp2"]["tau_s"]
        assert taus == sorted(set(taus)) and taus[0] >= step_s
        assert all(tau / step_s == pytest.approx(round(tau / step_s), abs=1e-9) for tau in taus)


def with_step(lab, path, step_s):
    """The rows of a log, another time apart."""
    rows = [line.split(",") for line in Path(path).read_text().splitlines()]
    changed = [[f"{float(row[0]) * step_s:g}", *row[1:]] if row[0][0].isdigit() else row for row in rows]
    return lab.write(f"{Path(path).stem}_{step_s}.csv", "\n".join(",".join(row) for row in changed) + "\n")


def test_logs_of_different_steps_are_refused(lab):
    """At one step for all, the log of 10 Hz lasted ten times as long as it did."""
    logs = lab.logs("steps", [], n=3)
    fast, late = with_step(lab, logs[1], 0.1), with_step(lab, logs[1], 1.02)
    for given in ([logs[0], fast], [fast, logs[0]], [logs[0], "--holdout", fast], [fast, "--holdout", logs[0]]):
        lab.run(given, code=3)
        assert f"{fast} has a row every 0.1 s, {logs[0]} every 1 s" in lab.errors and "average" in lab.errors
    assert lab.run([logs[0], late], "--holdout", logs[2])["axes"][0]["verdict"] == "no_gap"  # a clock, not a rate


def test_wrong_input_is_refused_or_warned_of(lab):
    logs = lab.logs("wrong", [], n=2)
    lab.run([logs[0], logs[0]], code=3)
    assert "the same data" in lab.errors and "once" in lab.errors
    lab.run([logs[0]], "--holdout", logs[0], code=3)
    assert "held out" in lab.errors
    lab.run([logs[0]], "--axis", "gq_dph", code=3)
    assert "gq_dph" in lab.errors
    for option in ("--without", "--only"):  # a slip of the command line, as with any other option
        lab.run([logs[0]], option, "thermal_leg", code=2)
        assert f"{option} thermal_leg" in lab.errors and "thermal_lag" in lab.errors and "--list-effects" in lab.errors
    missing = subprocess.run([BIN / "diagnose", "--model", lab.model], capture_output=True, text=True)
    assert missing.returncode == 2 and "--log" in missing.stderr
    text = Path(logs[0]).read_text()
    accelerometer = lab.write("acc.csv", text.replace("gx_dph", "ax_mg"))
    assert any("does not state its unit" in w for w in lab.run([accelerometer])["warnings"])
    gyro = lab.write("gyro.json", {**json.loads(Path(lab.model).read_text()), "unit": "dph"})
    lab.run([accelerometer], model=gyro, code=3)
    assert "the model is one of a gyro" in lab.errors
    units = lab.write("units.csv", text.replace("gx_dph", "gx_dps"))
    assert any("units" in w for w in lab.run([units])["warnings"])
    other = lab.write("device.csv", text.replace("# device = simulated", "# device = another").replace(",0.", ",1."))
    assert any("different devices" in w for w in lab.run([logs[1], other])["warnings"])
    short = lab.write("short.csv", "\n".join(text.splitlines()[:250]) + "\n")
    assert any("time constant" in w for w in lab.run([short])["warnings"])


def test_an_effect_of_the_model_that_stays_in_the_rates_is_told_with_its_own_reason(lab):
    held = {"run_to_run": {"sigma_dph": 5}, "saturation": {"limit_dph": 5000}, "quantization": {"lsb_dph": 1},
            "dead_band": {"width_dph": 0.1}, "held_samples": {"probability": 0.001},
            "common_mode": {"correlation": 0.5, "sigma_dph": 1}}
    model = lab.write("held.json", {**MODEL, "effects": [{"name": n, "parameters": p} for n, p in held.items()]})
    warnings = lab.run(lab.logs("held", [], n=1), model=model)["warnings"]
    told = {name: w for name in held for w in warnings if f"its effect {name} is not taken out" in w}
    assert set(told) == set(held)
    assert [name for name in held if "by chance" in told[name]] == ["run_to_run"]
    assert "noise that axes share" in told.pop("common_mode")
    assert all("cannot be undone" in w for name, w in told.items() if name != "run_to_run")


def test_a_column_that_a_believed_effect_reads_is_not_made_up(lab):
    logs = lab.logs("lacks", [], n=2)
    with_columns(logs[0], {"supply_v": lambda t: 5 + 0.2 * math.sin(t / 400)})
    model = lab.write("supply.json", {**MODEL, "effects": [{"name": "auxiliary_channel", "parameters": {"channel": "supply_v", "gain": 300}}]})
    result = lab.run(logs, model=model)
    assert any("auxiliary_channel is not taken out" in w and "not every log has the column supply_v" in w for w in result["warnings"])
    assert result["axes"][0]["verdict"] == "no_gap", lab.text
    result = lab.run(logs[:1], "--holdout", logs[1], model=model)
    assert any("auxiliary_channel is not taken out" in w for w in result["warnings"])


def test_list_of_effects(lab):
    out = lab.folder / "effects.json"
    subprocess.run([BIN / "diagnose", "--list-effects", "-q", "--json", str(out)], check=True)
    effects = {effect["name"]: effect for effect in json.loads(out.read_text())["effects"]}
    assert len(effects) == 28
    assert effects["thermal_hysteresis"]["parameters"][0]["name"] == "amplitude_dph"


def test_recorded_log_is_answered_honestly(lab):
    path = DATA / "adis16405_imu1.csv"
    if not path.exists():
        print(f"SKIP: {path} is not here")
        pytest.skip(f"SKIP: {path} is not here")
    model = lab.write("adis.json", {"imucal_model": 1, "arw_deg_rt_h": 2.5, "markov": [{"sigma_dph": 30, "tau_s": 300}]})
    result = lab.run([str(path)], "--holdout", DATA / "adis16405_imu3.csv", model=model)
    assert [axis["axis"] for axis in result["axes"]] == ["gx_dph", "gy_dph", "gz_dph"]
    for axis in result["axes"]:
        assert axis["gap"]["remainder"]
        # Without temperatures nothing thermal may be named.
        assert not {n for n in names(axis) if n.startswith("thermal") or n.startswith("temperature")}


def test_noise_that_axes_share_is_named_on_each_of_them_and_not_where_there_is_none(lab):
    """White noise of 12 dph beside 36 dph, half of it common: covariance 72 dph^2 between all axes."""
    shared = lambda c: [{"name": "common_mode", "parameters": {"correlation": c, "sigma_dph": 12}}]
    result = lab.run(lab.logs("shared", shared(0.5), n=2, axes=2, seed=5))
    for axis in result["axes"]:
        found = [e for e in axis["effects"] if e["name"] == "common_mode"]
        assert len(found) == 1 and "shared with" in found[0]["statement"] and found[0]["measured"] == found[0]["statement"]
        assert f"common_mode: {found[0]['measured']} (evidence" in lab.text
        p = found[0]["parameters"]
        assert abs(p["correlation"] * p["sigma_dph"] ** 2 - 72) < 4 * 38**2 / 13000**0.5
    apart = lab.run(lab.logs("apart", shared(0.0), n=2, axes=2, seed=6))
    assert not [e for axis in apart["axes"] for e in axis["effects"] if e["name"] == "common_mode"]


# Tones written into the logs by hand: from a phase of their own in each log, at frequencies of no grid.
TONES = {
    "one": [(25, 1 / 37.3, 0)],
    "slow": [(30, 1 / 211.7, 0)],
    "two": [(15, 1 / 37.3, 0), (12, 1 / 5.137, 0)],
    "drifts": [(25, 0.05, 1e-4)],
    "drifts down": [(20, 0.21, -3.3e-4)],
}


def add_tones(path, tones, phase):
    """rate += A sin(2 pi int(f0 + k T) dt), T as the log gives it."""
    head, rows = [], Path(path).read_text().splitlines()
    while rows[0].startswith("#"):
        head.append(rows.pop(0))
    names, phases = rows.pop(0).split(","), [phase * (1 + i) for i in range(len(tones))]
    out, before_s = [], 0.0
    for row in rows:
        fields = row.split(",")
        t_s, temp = float(fields[0]), float(fields[names.index("temp_degc")])
        phases = [p + 2 * math.pi * (hz + drift * temp) * (t_s - before_s) for p, (_, hz, drift) in zip(phases, tones)]
        at = names.index("gx_dph")
        fields[at] = repr(float(fields[at]) + sum(a * math.sin(p) for p, (a, _, _) in zip(phases, tones)))
        out.append(",".join(fields))
        before_s = t_s
    Path(path).write_text("\n".join([*head, ",".join(names), *out]) + "\n")


@pytest.mark.parametrize("kind", TONES)
def test_tones_between_the_places_of_a_grid_are_told_to_their_errors_and_hide_nothing(lab, kind):
    """A run tells a frequency to about 0.1 of one over its length; the hysteresis beside the tones stays, no noise stands in for them."""
    logs = lab.logs("tone_" + kind.replace(" ", "_"), HYSTERESIS, n=3, seed=5)
    for i, path in enumerate(logs):
        add_tones(path, TONES[kind], 0.4 + i)
    axis = lab.run(logs[:2], "--holdout", logs[2])["axes"][0]
    found = sorted((e for e in axis["effects"] if e["name"] == "sinusoid"), key=lambda e: e["parameters"]["frequency_hz"])
    assert sorted(names(axis)) == ["sinusoid"] * len(TONES[kind]) + ["thermal_hysteresis"], lab.text
    for effect, (amplitude, hz, drift) in zip(found, sorted(TONES[kind], key=lambda tone: tone[1])):
        assert effect["parameters"]["amplitude_dph"] == pytest.approx(amplitude, abs=4 * effect["std_errors"]["amplitude_dph"])
        found_drift = effect["parameters"].get("drift_hz_per_degc", 0)
        assert found_drift == pytest.approx(drift, abs=2e-6)
        # The frequency is that at 0 degC; in the middle of the range an error of the drift does not matter.
        assert effect["parameters"]["frequency_hz"] + 30 * found_drift == pytest.approx(hz + 30 * drift, abs=0.1 / 4000)
    assert not axis["noise"]["is_retuned"] and "a line" not in lab.text


def test_words_do_not_contradict_the_names(lab):
    """A name is not among what it cannot be told from, and no advice says that these profiles would not show it."""
    logs = lab.logs("walk", [{"name": "rate_random_walk", "parameters": {"k_dph_per_rt_s": 2.5}}], n=2, profile=lab.write("up.json", UP_ONLY))
    for axis in lab.run(logs)["axes"]:
        for effect in axis["effects"]:
            member = effect.get("member", effect["name"])
            assert effect["name"] in ("slow_noise", "rate_random_walk") and f"(as {member})" in lab.text or member == effect["name"]
            said = [line for line in lab.text.splitlines() if "cannot be told from" in line or "annot be seen in" in line]
            assert said and not any(member in line.replace(" ", "_") for line in said), lab.text


def test_a_tone_in_one_of_two_logs_is_said_to_be_there_with_the_root_mean_square_of_both(lab):
    logs = lab.logs("tone_once", [], n=2, seed=7)
    add_tones(logs[0], [(25, 1 / 37.3, 0)], 0.4)
    axis = lab.run(logs)["axes"][0]
    assert names(axis) == ["sinusoid"] and axis["where"]["logs"] == [0]
    found = axis["effects"][0]
    assert found["parameters"]["amplitude_dph"] == pytest.approx(25 / math.sqrt(2), abs=4 * found["std_errors"]["amplitude_dph"])


CHAMBER = {"imucal_profile": 1, "start_degc": 0, "segments": [
    {"rate_degc_per_min": 0, "duration_s": 300}, {"rate_degc_per_min": 3, "to_degc": 40}, {"rate_degc_per_min": 0, "duration_s": 900},
    {"rate_degc_per_min": 2, "to_degc": 10}, {"rate_degc_per_min": 0, "duration_s": 900}, {"rate_degc_per_min": 1, "to_degc": 60},
    {"rate_degc_per_min": 0, "duration_s": 600}]}


def rewrite(path, change, keep=lambda k: True):
    """The rows of a log as change(times, temperatures, rates) -> (temperatures, rates) leaves them."""
    lines = Path(path).read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("t_s"))
    t, temp, rate = map(list, zip(*([float(x) for x in line.split(",")[:3]] for line in lines[at + 1:])))
    temp, rate = change(t, temp, rate)
    rows = [f"{t[k]:g},{temp[k]:.6f},{rate[k]:.6f}" for k in range(len(t)) if keep(k)]
    Path(path).write_text("\n".join([*lines[:at], "t_s,temp_degc,gx_dph", *rows]) + "\n")


def behind(temp, tau_s):
    """A place that follows the thermometer: Tg' = (T - Tg)/tau."""
    out = [temp[0]]
    for value in temp[1:]:
        out.append(out[-1] + (1 - math.exp(-1 / tau_s)) * (value - out[-1]))
    return out


def test_rate_of_temperature_is_named_where_rows_are_missing_and_the_thermometer_is_not_at_the_element(lab):
    """45 dph per degC/min of an element 8 s behind its thermometer, minutes of the record lost.  By rows that happen to stand
    next to each other, a minute that is missing was a slope of its own, and seconds between the two a shape that nobody knew."""
    def change(t, temp, rate):
        place = behind(temp, 8)
        return temp, [r + 45 * 30 * (place[min(k + 1, len(t) - 1)] - place[max(k - 1, 0)]) for k, r in enumerate(rate)]

    logs = lab.logs("rate", [], n=3, seed=21, profile=lab.write("chamber.json", CHAMBER))
    for i, path in enumerate(logs):
        rewrite(path, change, lambda k: k % 211 != 7 and not 500 + 300 * i < k < 580 + 320 * i)
    axis = lab.run(logs[:2], "--holdout", logs[2])["axes"][0]
    assert names(axis) == ["temperature_rate"], lab.text
    found = axis["effects"][0]
    assert found["parameters"]["k_dph_per_degc_min"] == pytest.approx(45, abs=4 * found["std_errors"]["k_dph_per_degc_min"])
    assert axis["verdict"] == "explained"


def test_coarse_thermometer_is_not_a_lag_where_the_element_is_seconds_behind_it(lab):
    """B at the element, the log rounded to 1.2 degC.  A lag takes B at a smooth temperature and mends the steps too."""
    model = lab.write("steep.json", {**MODEL, "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 2500, 300, -200]}})
    fine = lab.logs("steps", [{"name": "thermal_lag", "parameters": {"tau_s": 6, "start": "settled"}}], n=3, seed=22,
                    profile=lab.write("chamber.json", CHAMBER), model=model)
    for path in fine:
        rewrite(path, lambda t, temp, rate: ([1.2 * round(x / 1.2) for x in temp], rate))
    axis = lab.run(fine[:2], "--holdout", fine[2], model=model)["axes"][0]
    assert axis["effects"][0]["name"] == "temperature_sensor_quantization", lab.text
    assert axis["effects"][0]["parameters"]["lsb_degc"] == pytest.approx(1.2, abs=0.01)


def wave(amplitude_dph):
    """Of temperature and what it was ten minutes before, together."""
    def change(t, temp, rate):
        return temp, [r + amplitude_dph * math.sin((x - y) / 3 + x / 9) for x, y, r in zip(temp, behind(temp, 600), rate)]
    return change


def product(amplitude_dph):
    """Of temperature, what it was a quarter of an hour before, and the time."""
    def change(t, temp, rate):
        return temp, [r + amplitude_dph * math.sin(x / 7) * (x - y) / 10 * math.cos(s / 2500)
                      for s, x, y, r in zip(t, temp, behind(temp, 900), rate)]
    return change


@pytest.mark.parametrize("change,seed", [(product(40), 32), (wave(22), 33), pytest.param(wave(30), 31, marks=pytest.mark.long)])
def test_what_repeats_but_is_no_effect_of_the_library_has_no_name(lab, change, seed):
    """An anomaly and a function of the time since the start stood in for these before."""
    logs = lab.logs("no_effect", [], n=4, seed=seed, profile=lab.write("chamber.json", CHAMBER))
    for path in logs:
        rewrite(path, change)
    axis = lab.run(logs[:3], "--holdout", logs[3])["axes"][0]
    assert names(axis) == [] and axis["verdict"] == "unexplained", lab.text
    assert "free function of temperature" in lab.text


# ---- what held-out logs can show --------------------------------------------------------------------------

RATE = {"effects": [{"name": "temperature_rate", "parameters": {"k_dph_per_degc_min": 15}}]}
SLOW_UP = {"imucal_profile": 1, "start_degc": 0, "segments": [{"rate_degc_per_min": 0.6, "to_degc": 55}]}
HOTTER = {"imucal_profile": 1, "start_degc": 0, "segments": [
    {"rate_degc_per_min": 3, "to_degc": 80}, {"rate_degc_per_min": 3, "to_degc": 0}]}


def test_one_held_out_log_gives_an_interval_with_two_sides(lab):
    logs = lab.logs("one_held_out", RATE, n=4)
    axis = lab.run(logs[:3], "--holdout", logs[3])["axes"][0]
    assert [e["name"] for e in axis["effects"]] == ["temperature_rate"]
    lo, hi = axis["gap"]["ci95"]
    assert lo < axis["gap"]["shrinkage"] < hi and hi - lo < 0.4
    assert "the gap shrinks by" in axis["gap"]["statement"] and axis["gap"]["statement"] in lab.text


def test_a_held_out_log_that_hides_the_cause_gives_no_figure(lab):
    """A steady ramp: what follows its rate is constant there, and a constant is free in every log."""
    logs = lab.logs("hides", RATE, n=3)
    steady = lab.logs("steady", RATE, n=1, seed=12, profile=lab.write("slow_up.json", SLOW_UP))
    axis = lab.run(logs, "--holdout", steady[0])["axes"][0]
    assert [e["name"] for e in axis["effects"]] == ["temperature_rate"]
    assert axis["gap"]["shrinkage"] is None and axis["gap"]["ci95"] is None
    assert "how far the gap shrinks is hidden by noise" in lab.text and "shrinks by" not in lab.text
    assert axis["effects"][0]["is_untested"] and "the held-out logs cannot test it" in lab.text


def test_a_held_out_log_beyond_the_fitted_temperatures_is_told_and_judged_within(lab):
    effects = {"effects": [{"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 60, "width_degc": 5}}]}
    logs = lab.logs("within", effects, n=3)
    hotter = lab.logs("hotter", effects, n=1, seed=12, profile=lab.write("hotter.json", HOTTER))
    answer = lab.run(logs, "--holdout", hotter[0])
    warning = [w for w in answer["warnings"] if "degC above the temperatures of the fitted logs" in w]
    assert len(warning) == 1 and hotter[0] in warning[0] and 17 < float(warning[0].split("goes ")[1].split()[0]) < 22
    gap = answer["axes"][0]["gap"]
    assert 0.6 < gap["part_within_fitted_temperatures"] < 0.85 and gap["ci95"][1] > 0.9


def test_a_held_out_log_without_temperatures_is_refused_where_the_fitted_logs_have_them(lab):
    """Its rates were predicted at one temperature before, and its polynomial was taken for a gap that nothing shrinks."""
    logs = lab.logs("cold", HYSTERESIS, n=3)
    bare = []
    for i, path in enumerate(logs):
        rows = [line.split(",") for line in Path(path).read_text().splitlines()]
        at = next(k for k, row in enumerate(rows) if row[0] == "t_s")
        bare.append(lab.write(f"cold_bare_{i}.csv", "\n".join(",".join(row if k <= at else [row[0], "", *row[2:]])
                                                              for k, row in enumerate(rows)) + "\n"))
    lab.run(logs[:2], "--holdout", bare[2], code=3)
    assert bare[2] in lab.errors and "without temperatures" in lab.errors and "--holdout" in lab.errors
    lab.run([bare[0], logs[1]], code=3)
    assert bare[0] in lab.errors and "without temperatures" in lab.errors and "--log" in lab.errors
    assert lab.run(bare[:2], "--holdout", bare[2])["axes"]  # nothing thermal is asked


def test_where_says_how_much_larger_or_smaller_the_residual_is(lab):
    logs = lab.logs("where", {"effects": []}, n=3)
    loud = lab.write("loud.json", {**MODEL, "arw_deg_rt_h": 1.8, "markov": [{"sigma_dph": 60, "tau_s": 100}]})
    assert "where" in lab.run(logs, model=loud)["axes"][0]
    times = lab.text.split("the residual is ")[1].split(" times what the model expects there (less noise than believed)")[0]
    assert 0.3 < float(times) < 0.37
    assert "standard deviations" not in lab.text


@pytest.mark.parametrize("every", [700, 100])
def test_logs_at_full_scale_are_left_out_with_a_warning(lab, every):
    """A sensor that stands at its limit but for a few seconds: nothing of the log can be judged, the other logs are."""
    logs = lab.logs(f"limit{every}", HYSTERESIS, n=4)
    limit = 900.0
    for path in logs[:2]:
        rewrite(path, lambda t, temp, rate: (temp, [r if k % every == 0 else limit for k, r in enumerate(rate)]))
    answer = lab.run(logs)
    told = [w for w in answer["warnings"] if "this log is left out of its answer" in w]
    assert len(told) == 2 and all(any(path in w for w in told) for path in logs[:2])
    axis = answer["axes"][0]
    assert {"saturation", "thermal_hysteresis"} <= {s["name"] for e in axis["effects"] for s in e["set"]}
    assert set(axis["where"]["logs"]) <= {2, 3}


def with_rates(path, axis, rates):
    """The log with other rates of an axis: rates(row number, rate as written) -> rate as written."""
    lines = Path(path).read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("t_s"))
    column = lines[at].split(",").index(axis)
    for i in range(at + 1, len(lines)):
        fields = lines[i].split(",")
        fields[column] = rates(i - at - 1, fields[column])
        lines[i] = ",".join(fields)
    Path(path).write_text("\n".join(lines) + "\n")


STUCK, EMPTY = lambda i, rate: "7", lambda i, rate: ""
SHORT = lambda i, rate: rate if i < 30 else ""
JUMPS_AND_SHARED = [{"name": "bias_step", "parameters": {"steps": [{"log": 2, "t_s": 3000, "amplitude_dph": 120}]}},
                    {"name": "common_mode", "parameters": {"correlation": 0.5, "sigma_dph": 20}}]


def without_places(axis):
    """An answer without what counts logs and what differs between two calls."""
    told = {k: v for k, v in axis.items() if k not in ("seconds", "left_out_logs", "where", "plots")}
    told["gap"] = {k: v for k, v in axis["gap"].items() if k != "log_by_unit"}
    steps = [s for e in axis["effects"] for s in e["parameters"].get("steps", [])]
    return json.loads(json.dumps(told).replace(*(f'"log": {steps[0]["log"]}', '"log": 0') if steps else ("", "")))


def test_a_bad_log_of_one_axis_is_left_out_there_and_no_number_shifts(lab):
    logs = lab.logs("bad", JUMPS_AND_SHARED, n=4, axes=2)
    with_rates(logs[0], "gx_dph", STUCK)
    with_rates(logs[3], "gx_dph", SHORT)
    with_rates(logs[1], "gy_dph", EMPTY)
    result = lab.run(logs)
    x, y = result["axes"]
    assert "refused" not in x and "refused" not in y
    for axis, used in ((x, [1, 2]), (y, [0, 2, 3])):
        (steps,) = [e["parameters"]["steps"] for e in axis["effects"] if e["name"] == "bias_step"]
        assert [step["log"] for step in steps] == [2] and "of log 3" in lab.text
        assert [cell["log"] for cell in axis["where"]["by_log"]] == used == sorted(set(axis["plots"]["residual"]["log"]))
        assert set(axis["where"]["logs"]) <= set(used) and axis["gap"]["log_by_unit"] == used
        assert "common_mode" in names(axis)
    assert [(e["log"], e["why"].split(";")[0]) for e in x["left_out_logs"]] == [
        (logs[0], "has one and the same rate in every second: it is stuck or not connected"), (logs[3], "has 30 usable seconds")]
    assert [e["log"] for e in y["left_out_logs"]] == [logs[1]]
    told = [w for w in result["warnings"] if "left out of its answer" in w]
    assert len(told) == 3
    for log, axis, why in ((logs[0], "gx", "stuck"), (logs[3], "gx", "30 usable seconds"), (logs[1], "gy", "0 usable seconds")):
        assert [w for w in told if w.startswith(f"{log}: axis {axis}_dph has") and why in w]
    # As if those logs had not been given.
    (alone,) = lab.run(logs, "--axis", "gx_dph")["axes"]
    (without,) = lab.run(logs[1:3], "--axis", "gx_dph")["axes"]
    assert "left_out_logs" not in without and without_places(alone) == without_places(without)


def test_logs_that_are_stuck_alike_are_not_one_log_given_twice(lab):
    logs = lab.logs("alike", [], n=3, axes=2)
    for path in logs[:2]:
        with_rates(path, "gx_dph", STUCK)
    x, y = lab.run(logs)["axes"]
    assert x["gap"]["log_by_unit"] == [2, 2, 2, 2] and y["gap"]["log_by_unit"] == [0, 1, 2]  # quarters of the one log
    assert [e["log"] for e in x["left_out_logs"]] == logs[:2]
    for path in logs[:2]:
        with_rates(path, "gy_dph", STUCK)
    assert [a["gap"]["log_by_unit"] for a in lab.run(logs)["axes"]] == [[2, 2, 2, 2]] * 2
    lab.run([logs[2], logs[2]], code=3)
    assert "the same data" in lab.errors


def test_a_bad_held_out_log_is_left_out_for_its_axis(lab):
    logs = lab.logs("bad_unseen", HYSTERESIS, n=4, axes=2)
    with_rates(logs[2], "gx_dph", STUCK)
    result = lab.run(logs[:2], "--holdout", *logs[2:])
    assert [a["gap"]["log_by_unit"] for a in result["axes"]] == [[1], [0, 1]]
    assert result["axes"][0]["left_out_logs"] == [
        {"log": logs[2], "why": "has one and the same rate in every second: it is stuck or not connected"}]
    (alone,) = lab.run(logs[:2], "--holdout", *logs[2:], "--axis", "gx_dph")["axes"]
    (without,) = lab.run(logs[:2], "--holdout", logs[3], "--axis", "gx_dph")["axes"]
    assert without_places(alone) == without_places(without)
    result = lab.run(logs[:2], "--holdout", logs[2])  # none is left: as if none had been given
    assert [a["gap"]["method"] for a in result["axes"]] == ["each log held out in turn", "held-out logs"]
    assert [w for w in result["warnings"] if w.startswith("axis gx_dph: no held-out log can be used")]


def test_an_axis_without_a_usable_log_says_why_of_each(lab):
    logs = lab.logs("none_left", [], n=2)
    with_rates(logs[0], "gx_dph", STUCK)
    with_rates(logs[1], "gx_dph", SHORT)
    lab.run(logs, code=3)
    assert f"{logs[0]}: axis gx_dph has one and the same rate" in lab.errors and "--axis" in lab.errors
    assert f"{logs[1]}: axis gx_dph has 30 usable seconds" in lab.errors


@pytest.mark.parametrize("spoilt", ["stuck", "sparse"])
def test_an_axis_that_was_not_judged_looks_neither_clean_nor_explained(lab, spoilt):
    """To a script that reads the exit status, or the verdict alone."""
    logs = lab.logs(f"lost_{spoilt}", [], n=2, axes=2)
    for path in logs:
        with_rates(path, "gx_dph", STUCK if spoilt == "stuck" else lambda i, rate: rate if i % 40 < 2 else "")
    x, y = lab.run(logs, code=1)["axes"]
    assert x["refused"] and x["verdict"] == "unexplained" and x["gap"]["shrinkage"] is None
    assert "refused" not in y and y["verdict"] == "no_gap"
    assert f"gx_dph: no answer: {x['refused']}" in lab.text
    lab.run(logs, "--quiet", code=1)
    assert f"diagnose: gx_dph: no answer: {x['refused']}" in lab.errors and "gy_dph" not in lab.errors
    assert lab.run(logs, "--axis", "gy_dph")["axes"][0]["verdict"] == "no_gap"


# ---- the model that is written ----------------------------------------------------------------------------

def slow_density(markov):
    return sum(2 * m["sigma_dph"] ** 2 * m["tau_s"] for m in markov)


def test_a_kind_of_noise_stands_once_in_the_model_that_is_written(lab):
    """Believed again, the model holds the noise of the logs and no more: with the found process in it twice it was too loud."""
    written = lab.folder / "noise_once.json"
    logs = lab.logs("noise_once", [{"name": "second_markov", "parameters": {"sigma_dph": 60, "tau_s": 1500}}])
    axis = lab.run(logs, "--model-out", written, model=False)["axes"][0]
    assert axis["effects"][0].get("member", axis["effects"][0]["name"]) == "second_markov", lab.text
    model = json.loads(written.read_text())
    (found,) = (effect["parameters"] for effect in model["effects"])
    assert len(model["markov"]) == 1
    both = slow_density(axis["noise"]["markov"])
    assert slow_density([*model["markov"], found]) == pytest.approx(both, rel=0.3)


def test_the_model_that_is_written_has_the_noise_of_the_first_axis_that_was_judged(lab):
    logs = lab.logs("first_axis", [], n=2, axes=3)
    for i, path in enumerate(logs):
        rows = [line.split(",") for line in Path(path).read_text().splitlines()]
        at = next(i for i, row in enumerate(rows) if row[0] == "t_s")
        x, z = rows[at].index("gx_dph"), rows[at].index("gz_dph")
        for row in rows[at + 1:]:
            row[x], row[z] = str(7 + i), repr(3 * float(row[z]))  # stuck, and louder than y
        Path(path).write_text("\n".join(",".join(row) for row in rows) + "\n")
    written = lab.folder / "first_axis.json"
    result = lab.run(logs, "--model-out", written, model=False, code=1)
    model = json.loads(written.read_text())
    assert model["arw_deg_rt_h"] == pytest.approx(0.6, rel=0.05) and len(model["markov"]) == 1
    told = [w for w in result["warnings"] if "the model that is written has the noise of axis gy_dph" in w]
    assert len(told) == 1 and "that of axis gz_dph differs" in told[0]
    assert not [w for w in lab.run(logs, model=False, code=1)["warnings"] if "is written" in w]


def rates_of(path):
    return [float(line.split(",")[2]) for line in Path(path).read_text().splitlines() if line[0].isdigit()]


def test_a_function_of_temperature_is_written_with_its_normalisation(lab):
    """Simulated and believed again: the rates are as large as those of the logs, and there is no gap."""
    logs = lab.logs("curved", [{"name": "higher_order_polynomial", "parameters": {"p4_dph": 60, "p5_dph": -40}}])
    written = lab.folder / "curved.json"
    axis = lab.run(logs, "--model-out", written, model=False)["axes"][0]
    assert names(axis) == ["higher_order_polynomial"], lab.text
    bias = json.loads(written.read_text())["bias"]
    assert (bias["t0_degc"], bias["range_degc"]) == (30, 30) and len(bias["coeff_dph"]) == 4
    # The constant is free in every run: turn-on of 50 dph.
    assert bias["coeff_dph"] == pytest.approx(MODEL["bias"]["coeff_dph"], abs=120)
    (again,) = lab.logs("curved_again", [], n=1, model=str(written))
    rates, truth = sorted(rates_of(again)), sorted(rates_of(logs[0]))
    for place in (0.05, 0.5, 0.95):
        assert rates[int(place * len(rates))] == pytest.approx(truth[int(place * len(truth))], abs=200)
    assert lab.run(logs, model=str(written))["axes"][0]["verdict"] == "no_gap", lab.text


def test_a_believed_function_of_temperature_needs_no_polynomial_beside_it(lab):
    """What the model leaves open has the normalisation that the polynomial of the logs has."""
    effects = [{"name": "higher_order_polynomial", "parameters": {"p4_dph": 60, "p5_dph": -40}}]
    logs = lab.logs("curved_believed", effects)
    without = {key: value for key, value in MODEL.items() if key != "bias"}
    model = lab.write("no_bias.json", {**without, "effects": effects})
    assert lab.run(logs, model=model)["axes"][0]["verdict"] == "no_gap", lab.text
    # … and one that is found is written with it.
    written = lab.folder / "no_bias_found.json"
    lab.run(logs, "--model-out", written, model=lab.write("no_bias_no_effects.json", without))
    assert json.loads(written.read_text())["bias"]["range_degc"] == 30


@pytest.mark.parametrize("name, slope, words, times", [
    ("white_noise_vs_temperature", 1.2, "the white noise is {} times as large at 60 degC as at 0 degC (slope: of its log-variance", 3.32),
    ("markov_sigma_vs_temperature", -1.5, "the slow noise is {} times as large at 0 degC as at 60 degC (slope: of its log-variance", 4.48),
])
def test_noise_over_temperature_is_told_in_times(lab, name, slope, words, times):
    """exp(0.5 slope dTn) with dTn = 2 between 0 and 60 degC, and what the slope is per."""
    axis = lab.run(lab.logs(name, [{"name": name, "parameters": {"slope": slope}}], n=4))["axes"][0]
    effect = next(e for e in axis["effects"] if name in (e["name"], e.get("member")))
    said = effect["in_words"]
    assert f"          {said}\n" in lab.text and said.endswith("per unit of (T - 30 degC) / 30 degC)")
    head, tail = words.split("{}")
    number = said.removeprefix(head).split(tail)[0]
    assert said.startswith(head) and tail in said
    assert float(number.split(" +- ")[0]) == pytest.approx(times, rel=0.25)
    assert float(number.split(" +- ")[0]) == pytest.approx(math.exp(abs(effect["parameters"]["slope"])), rel=0.01)


def test_simulator_and_diagnosis_normalise_temperature_alike_without_a_polynomial(lab):
    """By (T - 30) / 30: T itself made the white noise 4e15 times as loud at 60 degC."""
    bare = lab.write("bare.json", {key: value for key, value in MODEL.items() if key != "bias"})
    effects = [{"name": "white_noise_vs_temperature", "parameters": {"slope": 1.2}}]
    logs = lab.logs("bare_noise", effects, model=bare)
    effect = next(e for e in lab.run(logs, model=bare)["axes"][0]["effects"] if e["name"] == "white_noise_vs_temperature")
    assert effect["parameters"]["slope"] == pytest.approx(1.2, abs=4 * effect["std_errors"]["slope"])
    effects = [{"name": "higher_order_polynomial", "parameters": {"p4_dph": 60, "p5_dph": -40}}]
    logs = lab.logs("bare_curve", effects, model=bare)
    believed = lab.write("bare_curve.json", {**json.loads(Path(bare).read_text()), "effects": effects})
    assert lab.run(logs, model=believed)["axes"][0]["verdict"] == "no_gap", lab.text
    found = lab.run(logs, model=bare)["axes"][0]["effects"][0]
    assert found["name"] == "higher_order_polynomial"
    assert found["parameters"]["p4_dph"] == pytest.approx(60, abs=4 * found["std_errors"]["p4_dph"])


# ---- columns of other quantities --------------------------------------------------------------------------

def with_columns(path, columns, gain=0.0):
    """The log with columns of its own; the rate follows the one named supply_v."""
    head, rows = [], Path(path).read_text().splitlines()
    while rows[0].startswith("#"):
        head.append(rows.pop(0))
    out = [",".join([rows.pop(0), *columns])]
    for row in rows:
        fields = row.split(",")
        values = {name: f(float(fields[0])) for name, f in columns.items()}
        fields[2] = repr(float(fields[2]) + gain * values.get("supply_v", 0))
        out.append(",".join([*fields, *(f"{value:.6f}" for value in values.values())]))
    Path(path).write_text("\n".join([*head, *out]) + "\n")


def test_a_column_that_one_log_lacks_is_not_taken_for_another(lab):
    """By its place among the columns of each log, accel_x of some was the supply of the others."""
    supply = {"supply_v": lambda t: 5 + 0.2 * math.sin(t / 400)}
    both = {"accel_x": lambda t: math.cos(t / 900), **supply}
    logs = lab.logs("columns", [], n=4)
    for path, columns in zip(logs, (both, supply, supply, both)):
        with_columns(path, columns, gain=200)
    result = lab.run(logs[:3], "--holdout", logs[3])
    (found,) = result["axes"][0]["effects"]
    assert found["name"] == "auxiliary_channel" and found["parameters"]["channel"] == "supply_v", lab.text
    assert found["parameters"]["gain"] == pytest.approx(200, abs=4 * found["std_errors"]["gain"])
    told = [w for w in result["warnings"] if "has no column accel_x" in w]
    assert len(told) == 2 and told[0].startswith(logs[1]) and logs[0] in told[0] and told[1].startswith(logs[2])
    # A held-out log alone may lack one, too.
    with_columns(logs[1], {"accel_x": lambda t: math.sin(t / 700)})
    result = lab.run(logs[:2], "--holdout", logs[2])
    assert result["axes"][0]["effects"][0]["parameters"]["channel"] == "supply_v", lab.text
    assert [w for w in result["warnings"] if w.startswith(f"{logs[2]} has no column accel_x")]


def test_a_column_that_hardly_moves_is_advised_to_be_varied(lab):
    """No temperature profile makes a supply move."""
    columns = {"accel_x": lambda t: math.sin(t / 300), "near_degc": lambda t: 0, "supply_v": lambda t: 5 + 0.001 * math.sin(t / 400)}
    logs = lab.logs("resting", [], n=3)
    for path in logs:
        with_columns(path, columns)
        temps = iter([line.split(",")[1] for line in Path(path).read_text().splitlines() if line[0].isdigit()])
        with_rates(path, "near_degc", lambda i, was: next(temps))
    axis = lab.run(logs)["axes"][0]
    assert {d["smallest_detectable"]["channel"] for d in axis["not_detectable_here"] if d["name"] == "auxiliary_channel"} == {
        "near_degc", "supply_v"}
    (still,) = [a for a in axis["advice"] if "supply_v" in a]
    assert "hardly moves: by 0.002 within a log at most" in still and "Vary it" in still and "profile" not in still
    (thermal,) = [a for a in axis["advice"] if "near_degc" in a]
    assert "moves by 60 within a log, but as the temperature does" in thermal and "apart from the temperature" in thermal
    assert f"advice    {still}" in lab.text and not [a for a in axis["advice"] if "accel_x" in a]
    assert not [a for a in axis["advice"] if "auxiliary_channel" in a and "profile" in a]
