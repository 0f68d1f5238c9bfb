# SPDX-License-Identifier: MIT
"""gyrosim log: what it writes, what repeats and what differs, what it refuses."""
import json
import subprocess

import numpy as np
import pytest

import reference
from where import BIN

GYROSIM = BIN / "gyrosim"
MODEL = {**reference.MODEL, "turn_on_sigma_dph": 40}
PROFILE = {"imucal_profile": 1, "start_degc": 0,
           "segments": [{"rate_degc_per_min": 0, "duration_s": 100}, {"rate_degc_per_min": 3, "to_degc": 60}]}


@pytest.fixture
def files(tmp_path):
    (tmp_path / "model.json").write_text(json.dumps(MODEL))
    (tmp_path / "profile.json").write_text(json.dumps(PROFILE))
    return tmp_path


def gyrosim(folder, *arguments, code=0):
    command = [str(GYROSIM), "log", "--model", "model.json", "--profile", "profile.json", *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)
    assert done.returncode == code, done.stderr
    return done


def rows(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return lines[0].split(","), np.array([[float(x) for x in line.split(",")] for line in lines[1:]])


def test_log_holds_the_profile_and_the_axes(files):
    done = gyrosim(files, "--axes", 3, "--seed", 5, "-o", "a.csv", "--json", "-")
    header, data = rows(files / "a.csv")
    assert header == ["t_s", "temp_degc", "gx_dph", "gy_dph", "gz_dph"]
    assert data.shape == (1300, 5)
    assert np.array_equal(data[:, 0], np.arange(1, 1301))
    assert data[99, 1] == 0 and abs(data[-1, 1] - 59.975) < 1e-6
    report = json.loads(done.stdout)
    assert report["seed"] == 5
    tn = (data[:, 1] - 30) / 30
    for i, axis in enumerate(report["axes"]):
        residual = data[:, 2 + i] - np.polyval([-100, 150, 300, 80], tn) - axis["turn_on_dph"]
        assert abs(residual.std() / np.hypot(36, 20) - 1) < 0.15  # 1300 s of a 100-s process: 13 independent pieces
        assert abs(residual.mean()) < 4 * 20 * np.sqrt(200 / 1300)


def test_log_repeats_with_its_seed_and_differs_between_runs(files):
    for name, *arguments in (["a", "--seed", 1], ["b", "--seed", 1], ["c", "--seed", 2], ["d", "--seed", 1, "--log-index", 1],
                             ["e", "--seed", 1, "--device", 1]):
        gyrosim(files, *arguments, "-o", f"{name}.csv")
    text = {name: (files / f"{name}.csv").read_text() for name in "abcde"}
    assert text["a"] == text["b"]
    noise = {name: rows(files / f"{name}.csv")[1][:, 2] for name in "acde"}
    for other in "cde":
        assert abs(np.corrcoef(np.diff(noise["a"]), np.diff(noise[other]))[0, 1]) < 0.12  # four standard errors


def test_log_effects_by_axis_by_log_and_in_the_model(files):
    effects = [{"name": "rate_ramp", "parameters": {"ramp_dph_per_h": 3600}, "axis": "gy", "log": 1}]
    (files / "effects.json").write_text(json.dumps(effects))
    (files / "with.json").write_text(json.dumps({**MODEL, "effects": effects}))
    gyrosim(files, "--axes", 2, "--log-index", 1, "-o", "plain.csv")
    gyrosim(files, "--axes", 2, "--log-index", 1, "--effects", "effects.json", "-o", "effects.csv")
    gyrosim(files, "--axes", 2, "--log-index", 0, "--effects", "effects.json", "-o", "other.csv")
    gyrosim(files, "--axes", 2, "--log-index", 0, "-o", "other_plain.csv")
    added = rows(files / "effects.csv")[1] - rows(files / "plain.csv")[1]
    assert np.all(added[:, 2] == 0)
    assert np.allclose(np.diff(added[:, 3]), 1, atol=1e-5)
    assert (files / "other.csv").read_text() == (files / "other_plain.csv").read_text()
    command = [str(GYROSIM), "log", "--model", "with.json", "--profile", "profile.json", "--axes", "2", "--log-index", "1",
               "-o", "model.csv"]
    subprocess.run(command, cwd=files, check=True, capture_output=True)
    assert (files / "model.csv").read_text() == (files / "effects.csv").read_text()


def test_log_run_to_run_adds_another_curve_to_each_log(files):
    (files / "effects.json").write_text(json.dumps([{"name": "run_to_run", "parameters": {"sigma_dph": 30}}]))
    slopes = []
    for i in range(3):
        gyrosim(files, "--log-index", i, "-o", "plain.csv")
        gyrosim(files, "--log-index", i, "--n-logs", 3, "--effects", "effects.json", "-o", "a.csv")
        added = rows(files / "a.csv")[1] - rows(files / "plain.csv")[1]
        temp = rows(files / "a.csv")[1][:, 1]
        slopes.append(np.polyfit((temp - 30) / 30, added[:, 2], 2)[1])
    assert len({round(s, 3) for s in slopes}) == 3 and 0.1 < max(map(abs, slopes)) < 150


def metadata(path):
    lines = [line[1:].split("=", 1) for line in path.read_text().splitlines() if line.startswith("#")]
    return {key.strip(): value.strip() for key, value in lines}


MEMORY = [{"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 40, "width_degc": 5}},
          {"name": "warm_up", "parameters": {"amplitude_dph": 30, "tau_s": 200}}]


def test_log_start_is_drawn_in_every_run_and_told_in_the_log(files):
    (files / "effects.json").write_text(json.dumps(MEMORY))
    starts = []
    for i in range(4):
        gyrosim(files, "--axes", 2, "--log-index", i, "-o", "plain.csv")
        gyrosim(files, "--axes", 2, "--log-index", i, "--effects", "effects.json", "-o", "a.csv")
        told = metadata(files / "a.csv")
        play, left = (float(told[f"start.gx_dph.{key}"]) for key in ("thermal_hysteresis.play_frac", "warm_up.left_frac"))
        assert told["start.gy_dph.thermal_hysteresis.play_frac"] == told["start.gx_dph.thermal_hysteresis.play_frac"]
        added = (rows(files / "a.csv")[1] - rows(files / "plain.csv")[1])[0, 2:]
        assert np.allclose(added, 40 * play + 30 * left, atol=1e-3)  # the first second shows both starts
        starts.append((play, left))
    assert len(set(starts)) == 4


def test_log_start_cold_or_settled_is_the_same_in_every_run(files):
    (files / "effects.json").write_text(json.dumps(MEMORY))
    for word, expected in (("cold", 70), ("settled", 0)):
        for i in range(2):
            gyrosim(files, "--log-index", i, "-o", "plain.csv")
            gyrosim(files, "--log-index", i, "--effects", "effects.json", "--start", word, "-o", "a.csv")
            added = rows(files / "a.csv")[1] - rows(files / "plain.csv")[1]
            assert abs(added[0, 2] - expected) < 1e-3
    own = [{**effect, "parameters": {**effect["parameters"], "start": "settled"}} for effect in MEMORY]
    (files / "effects.json").write_text(json.dumps(own))
    gyrosim(files, "--log-index", 1, "--effects", "effects.json", "--start", "cold", "-o", "a.csv")
    assert abs((rows(files / "a.csv")[1] - rows(files / "plain.csv")[1])[0, 2]) < 1e-3
    assert "--start" in gyrosim(files, "--start", "hot", "-o", "b.csv", code=2).stderr


def fed(folder, command, *arguments):
    """The sample records that `serve` or `replay` writes into a file."""
    words = [str(GYROSIM), command, *map(str, arguments), "--to", "feed", "--rate-hz", "5", "-q"]
    subprocess.run(words, cwd=folder, check=True, timeout=60)
    return (folder / "feed").read_bytes()


def test_missing_means_samples_or_seconds_by_its_name_and_the_old_name_as_before(files):
    gyrosim(files, "-o", "whole.csv")
    gyrosim(files, "--missing-seconds", 0.3, "-o", "new.csv")
    gyrosim(files, "--missing", 0.3, "-o", "old.csv")
    new, old = ((files / name).read_bytes() for name in ("new.csv", "old.csv"))
    assert new == old and len(new) < 0.8 * (files / "whole.csv").stat().st_size
    for command, *source in (("serve", "--model", "model.json", "--profile", "profile.json"), ("replay", "whole.csv")):
        new, old, whole = (fed(files, command, *source, *flaw) for flaw in (("--missing-samples", 0.3), ("--missing", 0.3), ()))
        assert new == old and len(new) < 0.8 * len(whole)
    assert "--missing-samples" in gyrosim(files, "--missing-samples", 0.3, "-o", "a.csv", code=2).stderr  # a log has no samples
    both = gyrosim(files, "--missing-seconds", 0.3, "--missing", 0.2, "-o", "a.csv", code=2)
    assert "--missing: is the old name of --missing-seconds" in both.stderr
    for command in ("log", "serve", "replay"):
        shown = subprocess.run([str(GYROSIM), command, "--help"], capture_output=True, text=True, check=True).stdout
        assert "--missing-s" in shown and "--missing " not in shown


def test_log_flaws_of_recording(files):
    gyrosim(files, "--missing-seconds", 0.2, "--jitter-s", 0.01, "--temp-lsb-degc", 1, "--rate-lsb-dph", 180, "-o", "a.csv")
    _, data = rows(files / "a.csv")
    assert abs(len(data) - 1040) < 4 * np.sqrt(1300 * 0.16)
    assert np.all(np.diff(data[:, 0]) > 0.5)
    assert np.all(data[:, 1] == np.round(data[:, 1]))
    assert np.all(np.abs(data[:, 2] / 180 - np.round(data[:, 2] / 180)) < 1e-6)


@pytest.mark.parametrize("change, code, expected", [
    ({"model.json": '{"imucal_model": 1, "arw_deg_rt_h": "much"}'}, 3, "model.json: arw_deg_rt_h"),
    ({"model.json": '{"imucal_model": 1,\n "arw'}, 3, "model.json:2"),
    ({"profile.json": '{"imucal_profile": 1, "start_degc": 0, "segments": []}'}, 3, "profile.json"),
    ({"effects.json": '[{"name": "gremlins"}]'}, 3, "temperature_rate"),
    ({"effects.json": '[{"name": "warm_up", "parameters": {"amplitude_dph": 1, "tau_s": 9}, "axis": "gz"}]'}, 3, "--axes"),
    ({}, 2, "--axes"),
])
def test_log_bad_input_is_named(files, change, code, expected):
    for name, text in change.items():
        (files / name).write_text(text)
    arguments = ["--effects", "effects.json"] if "effects.json" in change else []
    if not change:
        arguments = ["--axes", "none"]
    done = gyrosim(files, *arguments, "-o", "a.csv", code=code)
    assert expected in done.stderr
    assert not (files / "a.csv").exists()


def test_serve_names_its_accelerometers_as_log_does(files):
    """As many as there are, also for effects; whatever unit their models state."""
    (files / "effects.json").write_text(json.dumps([{"name": "warm_up", "parameters": {"amplitude_dph": 5000, "tau_s": 60}, "axis": "az"}]))
    command = [str(GYROSIM), "serve", "--model", "model.json", "--profile", "profile.json", "--effects", "effects.json",
               "--start", "cold", "--to", "/dev/null", "-o", "run.csv", "--quiet", *["--accel-model", "model.json"] * 4]
    done = subprocess.run(command, cwd=files, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    header, data = rows(files / "run.csv")
    assert header == ["t_s", "temp_degc", "gx_dph", "ax_mg", "ay_mg", "az_mg", "a3_mg"]
    fall = data[:20].mean(axis=0) - data[-20:].mean(axis=0)
    beside = {name: abs(fall[header.index(name)] - fall[header.index("ay_mg")]) for name in ("ax_mg", "az_mg")}  # one B(T) for all
    assert beside["az_mg"] > 3000 and beside["ax_mg"] < 300
