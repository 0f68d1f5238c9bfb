# SPDX-License-Identifier: MIT
"""montecarlo: the contract's fields, the same result for any threads and shards, Ctrl-C, Dask, honest statistics."""
import json
import re
import signal
import subprocess
import sys
import time

import pytest

from reference import BASIC, MODEL, soaked_ramp
from where import BIN, ROOT

WRONG = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 5, "tau_s": 100}]}
STEEP = {**MODEL, "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 3000, 150, -100]}}


@pytest.fixture
def files(tmp_path):
    for name, content in {"model": MODEL, "wrong": WRONG, "steep": STEEP, "short": soaked_ramp(200, 3),
                          "basic": BASIC}.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    return tmp_path


def montecarlo(folder, *arguments, code=0):
    done = subprocess.run([str(BIN / "montecarlo"), *map(str, arguments)], cwd=folder, capture_output=True, text=True,
                          timeout=120)
    assert done.returncode == code, done.stderr
    return done


def campaign(folder, *arguments, model="model.json", profile="short.json", code=0):
    done = montecarlo(folder, "--model", model, "--profile", profile, "--order", 3, *arguments, "--json", "-", code=code)
    return json.loads(done.stdout)


def without_times(result):
    return {key: value for key, value in result.items() if key not in ("elapsed_s", "samples_per_s", "samples_per_s_per_core")}


def test_result_has_the_contract_fields(files):
    result = campaign(files, "--runs", 50, "--seed", 9)
    assert result["runs"] == 50 and result["seed"] == 9 and not result["interrupted"]
    n = len(result["temp_degc"])
    assert n == 13 and result["temp_degc"][0] == 0 and result["temp_degc"][-1] == 60
    for field in ("predicted_sigma_dph", "empirical_sigma_dph", "ratio_ci95"):
        assert len(result[field]) == n
    for ratio, (lo, hi) in zip(result["ratio"], result["ratio_ci95"]):
        assert lo < ratio < hi
    for field in ("nees", "nis"):
        assert set(result[field]) >= {"mean", "ci95"}
    assert result["samples_per_s"] > 0
    for name in ("coverage", "whiteness", "least_squares", "double_reference", "residual_dp", "truth_sigma_dph"):
        assert result[name]


def test_model_of_an_accelerometer_is_refused_with_its_file_and_the_remedy(files):
    """Whether it is the truth, the filter's or that of compare: its figures would be taken for deg/h."""
    (files / "accel.json").write_text(json.dumps({**MODEL, "unit": "mg"}))
    (files / "gyro.json").write_text(json.dumps({**MODEL, "unit": "dph"}))
    one_run = ["--profile", "short.json", "--order", 3, "--runs", 1, "--json", "never.json"]
    for arguments in (["--model", "accel.json", *one_run], ["--model", "model.json", "--filter-model", "accel.json", *one_run],
                      ["compare", "--model", "accel.json", "--runs", 1, "--json", "never.json"]):
        refused = montecarlo(files, *arguments, code=3)
        assert 'montecarlo: accel.json: an accelerometer\'s model ("unit": "mg")' in refused.stderr, arguments
        assert "profile error predicts the calibration error of an accelerometer" in refused.stderr
        assert refused.stdout == "" and not (files / "never.json").exists()
    assert campaign(files, "--runs", 1, "--core-only", model="gyro.json")["runs"] == 1


def test_tau_without_any_window_are_named_and_left_out(files):
    """A filter that settles slowly and a third of the seconds missing leave no window for some tau; that is no error."""
    model = json.loads((files / "model.json").read_text())
    model["markov"] = [{"sigma_dph": 20, "tau_s": 100}, {"sigma_dph": 10, "tau_s": 1000}]
    (files / "two.json").write_text(json.dumps(model))
    residual = campaign(files, "--runs", 4, "--missing-seconds", 0.3, model="two.json")["residual_dp"]
    assert residual["left_out_tau_s"] and len(residual["tau_s"]) == len(residual["dp_dph"]) == len(residual["expected_dph"])
    assert not set(residual["tau_s"]) & set(residual["left_out_tau_s"])
    assert campaign(files, "--runs", 4)["residual_dp"]["left_out_tau_s"] == []


def test_same_result_for_threads_and_shards(files):
    whole = campaign(files, "--runs", 30, "--threads", 1)
    assert without_times(campaign(files, "--runs", 30, "--threads", 3)) == without_times(whole)
    for first, runs in ((0, 7), (7, 3), (10, 20)):
        campaign(files, "--runs", runs, "--first-run", first, "--partial", f"shard{first}.json")
    merged = json.loads(montecarlo(files, "merge", "shard10.json", "shard0.json", "shard7.json", "--json", "-").stdout)
    assert without_times(merged) == without_times(whole)


def test_merge_refuses_what_does_not_belong_together(files):
    campaign(files, "--runs", 4, "--partial", "a.json")
    campaign(files, "--runs", 4, "--first-run", 3, "--partial", "b.json")
    campaign(files, "--runs", 4, "--first-run", 4, "--seed", 2, "--partial", "c.json")
    done = montecarlo(files, "merge", "a.json", "b.json", code=3)
    assert "b.json" in done.stderr and "a.json" in done.stderr and "--first-run" in done.stderr
    assert "another campaign" in montecarlo(files, "merge", "a.json", "c.json", code=3).stderr
    assert "--partial" in montecarlo(files, "merge", "model.json", code=3).stderr


def test_interrupt_ends_with_what_is_done(files):
    command = [str(BIN / "montecarlo"), "--model", "model.json", "--profile", "short.json", "--order", "3", "--runs", "1000000",
               "--json", "result.json", "--partial", "partial.json", "--threads", "2"]
    process = subprocess.Popen(command, cwd=files, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(1.5)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130, err
    result = json.loads((files / "result.json").read_text())
    assert result["interrupted"] and 0 < result["runs"] < 1000000
    assert "stopped before the end" in out
    # What is done are the first runs: the same as asking for that many.
    again = campaign(files, "--runs", result["runs"])
    assert again["empirical_sigma_dph"] == result["empirical_sigma_dph"]


def test_wrong_filter_model_is_seen(files):
    right = campaign(files, "--runs", 300, "--strict", "--seed", 1)
    assert right["nees"]["ci95"][0] < right["nees"]["mean"] < right["nees"]["ci95"][1]
    wrong = campaign(files, "--runs", 300, "--filter-model", "wrong.json", "--strict", "--seed", 1, code=1)
    assert wrong["nees"]["mean"] > 2 * wrong["nees"]["ci95"][1]
    assert min(wrong["ratio"]) > 1.2
    # Truth covariance says what this filter really achieves.
    assert 0.85 < min(wrong["ratio_to_truth"]) and max(wrong["ratio_to_truth"]) < 1.15


def test_coarse_thermometer_costs_less_than_a_tenth(files):
    """1 degC quantum, 0.02 degC noise, 100 dph/degC; the same noise in all three, so that they differ by the thermometer."""
    def sigma(*arguments):
        return campaign(files, "--runs", 250, "--core-only", "--temp-noise-degc", 0.02, *arguments, model="steep.json",
                        profile="basic.json")["empirical_sigma_dph"]
    fine, tracked, untracked = sigma("--temp-lsb-degc", 0.01), sigma("--temp-lsb-degc", 1), sigma("--temp-lsb-degc", 1, "--no-track")
    assert max(tracked) < 1.10 * max(fine)
    assert max(untracked) > 1.5 * max(fine)  # what the tracking is for


def test_compare_names_all_methods(files):
    done = montecarlo(files, "compare", "--model", "model.json", "--order", 3, "--runs", 30, "--json", "-")
    result = json.loads(done.stdout)
    assert len(result["scenarios"]) == 8
    for scenario in result["scenarios"]:
        score = {m["method"]: m for m in scenario["methods"]}
        assert set(score) == {"kalman", "least_squares", "rising_bins", "rising_maximum"}
        assert all(m["part_fitted"] == 1 for m in score.values())
        assert score["kalman"]["rms_dph"] < 1.05 * score["rising_bins"]["rms_dph"]


@pytest.mark.parametrize("arguments, code, expected", [
    (["--model", "model.json", "--order", 3], 2, "--profile"),
    (["--model", "model.json", "--profile", "short.json", "--order", 9], 2, "--order"),
    (["--model", "missing.json", "--profile", "short.json", "--order", 3], 3, "missing.json"),
    (["--model", "model.json", "--profile", "short.json", "--order", 3, "--rate-hz", 9.5], 2, "Hz"),
])
def test_bad_requests_are_named(files, arguments, code, expected):
    assert expected in montecarlo(files, *arguments, code=code).stderr


def test_dask_local_cluster_gives_the_bits_of_one_process(files):
    command = [sys.executable, str(ROOT / "host/scripts/montecarlo_dask.py"), "--runs", "30", "--shards", "4", "--workers", "2",
               "--program", str(BIN / "montecarlo"), "--json", "dask.json", "--quiet", "--", "--model", "model.json",
               "--profile=short.json", "--order", "3"]
    done = subprocess.run(command, cwd=files, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    spread = json.loads((files / "dask.json").read_text())
    assert without_times(spread) == without_times(campaign(files, "--runs", 30))


def test_dask_says_what_fails_on_a_worker(files):
    script = str(ROOT / "host/scripts/montecarlo_dask.py")
    (files / "bad.json").write_text("{}")
    command = [sys.executable, script, "--runs", "4", "--shards", "1", "--workers", "1", "--program", str(BIN / "montecarlo"),
               "--", "--model", "bad.json", "--profile", "short.json", "--order", "3"]
    done = subprocess.run(command, cwd=files, capture_output=True, text=True, timeout=120)
    assert done.returncode == 3 and "imucal_model" in done.stderr, done.stderr
    done = subprocess.run([sys.executable, script, "--runs", "4", "--scheduler", "tcp://127.0.0.1:9",
                           "--timeout-s", "1", "--", "--model", "model.json"],
                          cwd=files, capture_output=True, text=True, timeout=120)
    assert done.returncode == 4 and "scheduler" in done.stderr


def test_rows_of_compare_stand_under_each_other(files):
    lines = montecarlo(files, "compare", "--model", "model.json", "--order", 3, "--runs", 2).stdout.splitlines()[1:]
    ends = [[match.end() for match in re.finditer(r"/ *[\d.]+|no fit", line)] for line in lines[1:]]
    assert len(ends) >= 6 and all(row == ends[0] for row in ends), "\n".join(lines)
    assert [match.end() for match in re.finditer(r"\S+", lines[0])] == ends[0]
