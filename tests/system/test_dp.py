# SPDX-License-Identifier: MIT
"""dp and errormodel from outside: contracts, bad input, recorded logs."""
import json
import math
import subprocess

import numpy as np
import pytest

from reference import NOISE as NOMINAL
from where import BIN, DATA



def run(*args, expect=0):
    done = subprocess.run([str(BIN / args[0]), *map(str, args[1:])], capture_output=True, text=True, timeout=120)
    assert done.returncode == expect, f"{args}: exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


def result(*args, expect=0):
    return json.loads(run(*args, "--json", "-", expect=expect).stdout)


@pytest.fixture
def nominal(tmp_path):
    path = tmp_path / "nominal.json"
    path.write_text(json.dumps(NOMINAL))
    return path


def write_log(path, *columns, names=("gx_dph",), t_s=None, temp_degc=None):
    n = len(columns[0])
    t_s = range(n) if t_s is None else t_s
    temp_degc = [""] * n if temp_degc is None else temp_degc
    with open(path, "w") as out:
        out.write("# imucal-log = 1\nt_s,temp_degc," + ",".join(names) + "\n")
        for row in zip(t_s, temp_degc, *columns):
            out.write(",".join(str(v) for v in row) + "\n")
    return path


def markov_noise(n, seed, arw=0.6, sigma=20.0, tau_s=100.0):
    rng = np.random.default_rng(seed)
    phi = math.exp(-1 / tau_s)
    state, drive = sigma * rng.standard_normal(), sigma * math.sqrt(1 - phi * phi)
    out = 60 * arw * rng.standard_normal(n)
    for k in range(n):
        out[k] += state
        state = phi * state + drive * rng.standard_normal()
    return out


def naive_oadev(x, n):
    sums = np.concatenate([[0], np.cumsum(x - x.mean(), dtype=np.longdouble)])
    d = (sums[2 * n:] - 2 * sums[n:-n] + sums[:-2 * n]) / n
    return float(np.sqrt(0.5 * np.mean(d * d)))


def test_av_equals_definition_to_1e_9(tmp_path):
    x = np.round(markov_noise(5000, 1) + np.linspace(0, 3000, 5000) + 2e4, 3)
    curve = result("dp", write_log(tmp_path / "a.csv", x), "--type", "av", "--tau", "1:500:7")["curves"][0]
    for tau, dp in zip(curve["tau_s"], curve["dp_dph"]):
        assert dp == pytest.approx(naive_oadev(x, int(tau)), rel=1e-9)


@pytest.mark.parametrize("name", ["adis16405_imu1.csv", "cats_p1.csv"])
def test_av_of_recorded_logs_equals_definition_to_1e_9(name):
    if not (DATA / name).exists():
        pytest.skip(f"SKIP: {DATA / name} is not here")
    x = np.loadtxt(DATA / name, delimiter=",", comments=["#", "t"], usecols=3)
    curve = result("dp", DATA / name, "--type", "av", "--axis", "gy_dph", "--tau", "octave")["curves"]
    for tau, dp in zip(curve[0]["tau_s"], curve[0]["dp_dph"]):
        assert dp == pytest.approx(naive_oadev(x, int(tau)), rel=1e-9)


def test_json_fields_of_the_contract(tmp_path, nominal):
    temp = np.round(np.linspace(0, 60, 4000), 2)
    log = write_log(tmp_path / "a.csv", markov_noise(4000, 2), markov_noise(4000, 3), names=("gx_dph", "gy_dph"),
                    temp_degc=temp)
    r = result("dp", log, "--type", "dp2", "--nominal", nominal, "--tau", "2:300:10", "--estimator", "p95",
               "--estimator", "rms", "--detrend", "poly:3")
    assert len(r["curves"]) == 4 and len(r["ratios"]) == 2
    for curve in r["curves"]:
        assert {"log", "axis", "type", "estimator", "tau_s", "dp_dph", "ci95_dph", "n"} <= set(curve)
        assert all(lo < dp < hi for dp, (lo, hi) in zip(curve["dp_dph"], curve["ci95_dph"]))
    for ratios in r["ratios"]:
        assert ratios["verdict"] == "gaussian" and ratios["outliers"] == []
        assert ratios["p95_over_rms"][0] == pytest.approx(0.998, abs=0.05)
    assert len(r["across"]["rms_dph"]) == len(r["curves"][0]["tau_s"])


def test_a_single_wrong_second_is_named_and_not_the_one_after(tmp_path, nominal):
    """The errors of predicting it, and of predicting from it, are the same in size: either may be the larger one."""
    for seed in range(12):
        x = markov_noise(2000, seed)
        x[700 + 37 * seed] += 3000 * (-1) ** seed
        log = write_log(tmp_path / "spike.csv", x, t_s=range(100, 2100))
        for options in ("--type av --tau 1:100:3", "--type av --tau 2:100:3", "--type dp2 --tau 1:100:3"):
            r = result("dp", log, "--nominal", nominal, *options.split())["ratios"][0]
            assert r["outliers"][0]["t_s"] == 800 + 37 * seed, (seed, options)
    # A jump is between two seconds: the first one behind it.
    x = markov_noise(2000, 5) + np.where(np.arange(2000) >= 900, 3000, 0)
    r = result("dp", write_log(tmp_path / "jump.csv", x), "--type", "av", "--tau", "1:100:3")["ratios"][0]
    assert r["outliers"][0]["t_s"] == 900


def test_outliers_are_found_in_time_and_temperature(tmp_path, nominal):
    temp = np.round(30 + 30 * np.sin(np.arange(8000) / 8000 * 4 * np.pi), 2)
    x = markov_noise(8000, 4)
    spiked = x.copy()
    spiked[5000] += 400
    r = result("dp", write_log(tmp_path / "a.csv", spiked, temp_degc=temp), "--nominal", nominal, "--tau", "2:300:5")["ratios"][0]
    assert r["verdict"] == "outliers"
    assert r["outliers"][0]["t_s"] == 5000 and r["outliers"][0]["temp_degc"] == pytest.approx(temp[5000])
    # The same jump at 45 degC on every passage is a thermal singularity.
    jumpy = x + np.where(np.abs(temp - 45) < 0.25, 250, 0)
    r = result("dp", write_log(tmp_path / "b.csv", jumpy, temp_degc=temp), "--nominal", nominal, "--tau", "2:300:5")["ratios"][0]
    assert r["verdict"] == "singularity", r["statement"]
    assert all(abs(o["temp_degc"] - 45) < 4 for o in r["outliers"])


def test_verdict_keeps_its_false_alarm_rate(tmp_path, nominal):
    verdicts = []
    for block in range(4):
        columns = [np.round(markov_noise(4000, 1000 + 25 * block + k), 2) for k in range(25)]
        log = write_log(tmp_path / "a.csv", *columns, names=[f"g{k}_dph" for k in range(25)])
        verdicts += [r["verdict"] for r in result("dp", log, "--nominal", nominal, "--tau", "2:300:20", "--ci-model", nominal)["ratios"]]
    assert len(verdicts) == 100
    assert sum(v != "gaussian" for v in verdicts) <= 5  # 1 % stated: P(more than 5 of 100) < 1e-3


def test_gaps_shorten_the_statistics_and_invent_nothing(tmp_path):
    x = np.round(markov_noise(4000, 5), 3)
    keep = [k for k in range(4000) if not 1000 <= k < 1500]
    gap = write_log(tmp_path / "gap.csv", x[keep], t_s=keep)
    left = result("dp", gap, "--type", "av", "--tau", "100", "--detrend", "none")["curves"][0]
    sums = np.concatenate([[0], np.cumsum(x)])
    d = [(sums[t + 100] - 2 * sums[t] + sums[t - 100]) / 100 for t in range(100, 3901) if t + 100 <= 1000 or t - 100 >= 1500]
    assert left["n"] == [len(d)]
    assert left["dp_dph"][0] == pytest.approx(np.sqrt(0.5 * np.mean(np.square(d))), rel=1e-9)


def test_bad_input_is_refused_with_its_place(tmp_path, nominal):
    log = write_log(tmp_path / "a.csv", markov_noise(500, 6))
    cases = [
        (["dp", log, "--axis", "gz_dph"], 3, "gz_dph"),
        (["dp", log, "--type", "av", "--tau", "300"], 3, "beyond the record"),
        (["dp", log, "--type", "dp2"], 2, "--nominal"),
        (["dp", log, "--type", "dp9"], 2, "dp9"),
        (["dp", log, "--type", "av", "--tau", "0:5"], 2, "--tau"),
        (["dp", log, "--type", "av", "--detrend", "poly:2"], 3, "no temperature"),
        (["dp", write_log(tmp_path / "c.csv", [7] * 100), "--type", "av"], 3, "constant"),
        (["dp", write_log(tmp_path / "o.csv", [7]), "--type", "av"], 3, "at least two"),
        (["dp", write_log(tmp_path / "n.csv", [1, 2, "nan", 4]), "--type", "av"], 3, "n.csv:5"),
        (["dp", write_log(tmp_path / "i.csv", [1, 2, "inf", 4]), "--type", "av"], 3, "i.csv:5"),
        (["dp", write_log(tmp_path / "e.csv", []), "--type", "av"], 3, "empty log"),
        (["dp", tmp_path / "none.csv", "--type", "av"], 3, "none.csv"),
    ]
    for bad in ({"arw_deg_rt_h": -1}, {"markov": [{"sigma_dph": -2, "tau_s": 3}]}, {"markov": [{"sigma_dph": 2, "tau_s": 0}]}):
        model = tmp_path / f"bad{len(cases)}.json"
        model.write_text(json.dumps({"imucal_model": 1, "arw_deg_rt_h": 1, **bad}))
        cases.append((["errormodel", "expect", model, "--type", "av"], 3, "outside"))
    walk = tmp_path / "walk.json"
    walk.write_text(json.dumps({**NOMINAL, "effects": [{"name": "rate_random_walk", "parameters": {"k_dph_per_rt_s": 0.5}}]}))
    cases += [
        (["errormodel", "expect", walk, "--type", "dp2", "--nominal", nominal], 2, "--duration-s"),
        (["errormodel", "fit", log, "--criterion", "best"], 2, "best"),
        (["errormodel", "fit", write_log(tmp_path / "c2.csv", [7] * 100), "--criterion", "ml"], 3, "constant"),
        (["errormodel", "check", log], 2, "--model"),
    ]
    for args, code, text in cases:
        done = run(*args, expect=code)
        assert text in done.stderr, f"{args}: {done.stderr}"


def test_taus_between_samples_are_remarked(tmp_path):
    log = write_log(tmp_path / "a.csv", markov_noise(600, 1))
    done = run("dp", log, "--tau", "1.5,4", "--no-ratios")
    assert "1.5 s is taken as 2 s" in done.stderr
    for tau in ("1,4", "1:20:2", "octave", "log:1:50:20"):
        assert "is taken as" not in run("dp", log, "--tau", tau, "--no-ratios").stderr, tau


def test_expect_reproduces_the_paper_model(tmp_path, nominal):
    model = tmp_path / "m.json"
    model.write_text(json.dumps({"imucal_model": 1, "arw_deg_rt_h": 1.1, "markov": [{"sigma_dph": 14, "tau_s": 20}, {"sigma_dph": 14, "tau_s": 70}]}))
    r = result("errormodel", "expect", model, "--type", "dp2", "--nominal", nominal, "--tau", "2,5,10,20,50,100,200,400,600")
    assert r["type"] == "dp2"
    assert r["dp_dph"] == pytest.approx([34.85, 23.77, 18.79, 15.93, 14.33, 13.99, 13.88, 13.75, 13.65], rel=5e-4)


@pytest.mark.parametrize("criterion", ["bound", "ls", "ml"])
def test_fit_and_check(tmp_path, nominal, criterion):
    log = write_log(tmp_path / "a.csv", markov_noise(6000, 7))
    out = tmp_path / "fit.json"
    r = result("errormodel", "fit", log, "--markov", "1", "--criterion", criterion, "--nominal", nominal, "--tau", "2:600:5",
               "--bootstrap", "12", "-o", out)
    assert {"model", "criterion", "bounded", "excess", "std_errors", "identifiable", "log_likelihood"} <= set(r)
    assert json.loads(out.read_text()) == r["model"]
    # The tightest bound may need more white noise than there is; the others estimate it.
    assert 0.57 < r["model"]["arw_deg_rt_h"] < (0.95 if criterion == "bound" else 0.63)
    assert r["std_errors"]["arw_deg_rt_h"] < 0.3
    assert set(r["identifiable"]) == {"arw_deg_rt_h", "markov[0].sigma_dph", "markov[0].tau_s"}
    if criterion == "bound":
        assert r["bounded"]
    c = result("errormodel", "check", log, "--model", out, "--nominal", nominal, "--tau", "2:600:5", expect=0 if r["bounded"] else 1)
    assert c["bounded"] == r["bounded"]
    assert c["worst_ratio"] == pytest.approx(r["worst_ratio"], rel=1e-9)
    quiet = tmp_path / "quiet.json"
    quiet.write_text(json.dumps({"imucal_model": 1, "arw_deg_rt_h": 0.3, "markov": [{"sigma_dph": 20, "tau_s": 100}]}))
    c = result("errormodel", "check", log, "--model", quiet, "--nominal", nominal, "--tau", "2:600:5", expect=1)
    assert not c["bounded"] and c["at_tau_s"] < 10 and c["worst_ratio"] < 0.8


def test_results_do_not_depend_on_threads(tmp_path, nominal):
    versus = tmp_path / "versus.json"
    versus.write_text(json.dumps({**NOMINAL, "markov": [{"sigma_dph": 20, "tau_s": 50}]}))
    args = ["errormodel", "separation", "--model", nominal, "--versus", versus, "--nominal", nominal, "--draws", "6",
            "--tau", "2:300:4", "--seed", "5"]
    assert result(*args, "--threads", "1") == result(*args, "--threads", "3")


def test_stream_gives_the_same_curves(tmp_path, nominal):
    x = np.round(markov_noise(5000, 8), 3)
    keep = [k for k in range(5000) if k % 1700]
    log = write_log(tmp_path / "a.csv", x[keep], t_s=keep)
    for kind in ("av", "dp2"):
        args = ["dp", log, "--type", kind, "--nominal", nominal, "--tau", "2:300:20"]
        whole, stream = result(*args, "--no-ratios")["curves"][0], result(*args, "--stream")["curves"][0]
        assert stream["n"] == whole["n"]
        assert stream["dp_dph"] == pytest.approx(whole["dp_dph"], rel=1e-9)
    done = run("dp", log, "--type", "av", "--stream", "--estimator", "max", expect=2)
    assert "--stream" in done.stderr
    with open(log) as text:  # which cannot be read twice
        done = subprocess.run([BIN / "dp", "-", "--stream"], stdin=text, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "standard input" in done.stderr, done.stderr


# ---- text ----

def test_only_a_fit_that_was_asked_to_bound_says_whether_it_does(tmp_path):
    log = write_log(tmp_path / "a.csv", markov_noise(6000, 3))
    likely = run("errormodel", "fit", log, "--markov", "1", "--criterion", "ml").stdout
    assert "bound" not in likely and "times the logs at least" in likely and "on average" in likely
    assert "bounds the av curve" in run("errormodel", "fit", log, "--markov", "1").stdout


def test_an_expected_curve_has_a_header_and_even_steps_of_the_logarithm(nominal):
    lines = run("errormodel", "expect", nominal).stdout.splitlines()
    assert lines[0].split() == ["tau_s", "dp_dph", "(av)"]
    tau = [float(line.split()[0]) for line in lines[1:]]
    assert tau[0] == 2 and tau[-1] == 600 and 20 <= len(tau) <= 31
    assert sum(t <= 20 for t in tau) >= 8  # two fifths of the logarithm
    assert len(result("errormodel", "expect", nominal)["tau_s"]) == 599  # all of them
    assert len(run("errormodel", "expect", nominal, "--tau", "2:10").stdout.splitlines()) == 10


def test_a_curve_has_no_more_digits_than_its_interval_leaves(tmp_path):
    log = write_log(tmp_path / "a.csv", markov_noise(20000, 3))
    for line in run("dp", log, "--type", "av", "--tau", "1:1000:200").stdout.splitlines():
        cells = line.split()
        if len(cells) != 5 or not cells[0].isdigit():
            continue
        dp, lo, hi = cells[1:4]
        error = (float(hi) - float(lo)) / 2
        places = {len(cell.partition(".")[2]) for cell in (dp, lo, hi)}
        assert len(places) == 1
        assert 0.9 <= error * 10 ** places.pop() < 105, line  # two digits of the error
