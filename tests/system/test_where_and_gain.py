# SPDX-License-Identifier: MIT
"""Where diagnose says that a gap lies, and how much likelier its answer makes seconds that were not fitted: simulated here in
numpy, exact noise, six logs of which two are held out; gains are computed here once more."""
import json
import re
import subprocess

import numpy as np
import pytest

from where import BIN

WHITE, SIGMA, TAU = 36.0, 20.0, 100.0
MODEL = {"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": SIGMA, "tau_s": TAU}],
         "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": [80, 300, 150, -100]}}
TURNS = [(0, 0), (600, 20), (1100, 20), (1700, 40), (2200, 40), (2800, 60), (3300, 60), (4500, 40), (5000, 40), (6200, 20),
         (6700, 20), (7900, 0)]


def process(rng, n):
    phi = np.exp(-1 / TAU)
    x = np.empty(n)
    x[0] = SIGMA * rng.standard_normal()
    for k, e in enumerate(SIGMA * np.sqrt(1 - phi * phi) * rng.standard_normal(n - 1)):
        x[k + 1] = phi * x[k] + e
    return x


def logs_of(folder, cause, seed):
    """Six logs, every second one mirrored in temperature; cause(rng, temperature, t, log)."""
    rng, paths = np.random.default_rng(seed), []
    t = np.arange(1.0, 7901)
    up = np.interp(t, *np.transpose(TURNS))
    for i in range(6):
        degc = 60 - up if i % 2 else up
        x = (degc - 30) / 30
        bias = 80 + 300 * x + 150 * x**2 - 100 * x**3 + 50 * rng.standard_normal()
        rate = bias + WHITE * rng.standard_normal(t.size) + process(rng, t.size) + cause(rng, degc, t, i)
        paths.append(folder / f"{i + 1}.csv")
        rows = "".join(f"{a:.0f},{b:.3f},{c:.3f}\n" for a, b, c in zip(t, degc, rate))
        paths[-1].write_text(f"# imucal-log = 1\n# run = {i}\nt_s,temp_degc,gx_dph\n{rows}")
    return paths


def answer(folder, paths, believed=True):
    (folder / "model.json").write_text(json.dumps(MODEL))
    model = ["--model", folder / "model.json"] if believed else []
    done = subprocess.run([BIN / "diagnose", *model, "--log", *paths[:4], "--holdout", *paths[4:], "--threads", "1",
                           "--cache", folder / "cache", "--json", folder / "out.json"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    axis = json.loads((folder / "out.json").read_text())["axes"][0]
    assert axis["where"]["sentence"] in done.stdout
    assert axis["gap"]["statement"] and axis["gap"]["statement"] in done.stdout
    low, high = axis["where"]["temp_degc"]
    assert 0 <= low < high <= 60
    return axis, [e["name"] for e in axis["effects"]]


def loop(rng, degc, t, i):
    width, play, out = 6, degc[0] + rng.uniform(-6, 6), np.empty(t.size)
    for k, degree in enumerate(degc):
        play = min(max(play, degree - width), degree + width)
        out[k] = play
    return 40 * (out - degc) / width


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("believed", [True, False])
def test_a_jump_in_one_log_is_in_that_log_at_its_time(tmp_path, seed, believed):
    axis, named = answer(tmp_path, logs_of(tmp_path, lambda rng, degc, t, i: 150 * (t > 4000) * (i == 1), seed), believed)
    where = axis["where"]
    assert named == ["bias_step"] and where["logs"] == [1] and where["time_s"] == pytest.approx([4000, 4000], abs=3)
    assert where["temp_degc"] == [0, 60] and "degC" not in where["sentence"] and "in log 2" in where["sentence"]
    assert axis["gap"]["shrinkage"] is None and "is not known: jumps in time" in axis["gap"]["statement"]


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("believed", [True, False])
def test_a_bump_is_around_its_temperature(tmp_path, seed, believed):
    paths = logs_of(tmp_path, lambda rng, degc, t, i: 120 * np.exp(-((degc - 42) / 3) ** 2 / 2), seed)
    axis, named = answer(tmp_path, paths, believed)
    where = axis["where"]
    low, high = where["temp_degc"]
    assert named == ["thermal_anomaly"] and 34 < low < 42 < high < 50 and where["logs"] == [0, 1, 2, 3]
    assert sum(cell["share"] for cell in where["by_temperature"] if 35 <= cell["temp_degc"][0] < 50) > 0.8


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_loop_shows_at_slow_times_without_a_model(tmp_path, seed):
    axis, named = answer(tmp_path, logs_of(tmp_path, loop, seed), believed=False)
    where = axis["where"]
    assert named == ["thermal_hysteresis"] and where["tau_s"][0] >= 256 and where["tau_s"][1] >= 2048
    assert "times what the noise that was found expects there" in where["sentence"]
    assert where["temp_degc"] == [0, 60] and where["logs"] == [0, 1, 2, 3] and where["direction"] == "any"


def whitened(columns):
    """Innovations of white noise and the process, by its filter."""
    phi = np.exp(-1 / TAU)
    state, p, out = np.zeros(columns.shape[1]), SIGMA**2, np.empty_like(columns)
    for k, row in enumerate(columns):
        s = p + WHITE**2
        e = row - state
        out[k] = e / np.sqrt(s)
        state = phi * (state + p / s * e)
        p = phi * phi * p * (1 - p / s) + SIGMA**2 * (1 - phi * phi)
    return out


def deviance_of_tone(path, amplitude, frequency):
    """What cosine and sine, normal with this size, take off the deviance of one log beside a free cubic."""
    t, degc, rate = np.loadtxt(path, delimiter=",", skiprows=3).T
    x, angle = (degc - 30) / 30, 2 * np.pi * frequency * t
    e = whitened(np.stack([x**0, x, x**2, x**3, np.cos(angle), np.sin(angle), rate], 1))
    q, _ = np.linalg.qr(e[:, :4])
    e = e[:, 4:] - q @ (q.T @ e[:, 4:])
    size = amplitude**2 / 2
    precision, product = np.eye(2) + size * e[:, :2].T @ e[:, :2], e[:, :2].T @ e[:, 2]
    return size * product @ np.linalg.solve(precision, product) - np.linalg.slogdet(precision)[1]


def test_the_gain_of_a_tone_is_that_of_the_seconds(tmp_path):
    paths = logs_of(tmp_path, lambda rng, degc, t, i: 8 * np.sin(2 * np.pi * 0.1234 * t + rng.uniform(0, 6)), 5)
    axis, named = answer(tmp_path, paths)
    values, gap = axis["effects"][0]["parameters"], axis["gap"]
    own = [deviance_of_tone(path, values["amplitude_dph"], values["frequency_hz"]) for path in paths[4:]]
    assert named == ["sinusoid"] and gap["shrinkage"] is None and gap["gain_mean_s"] == 1
    assert gap["gain_by_unit"] == pytest.approx(own, rel=0.05) and gap["gain"] == pytest.approx(sum(own) / gap["hours"], rel=0.05)
    assert gap["gain"] > 50 and gap["statement"].startswith("how far the gap shrinks is not known: a tone has a phase of its own")
    told = float(re.search(r"likelier by ([\d.e+]+) nats", gap["statement"])[1])
    assert told == pytest.approx(sum(own) / 2, rel=0.05)


def test_the_gain_of_outliers_is_that_of_the_seconds(tmp_path):
    """Of hits the density is known here without the slow process, which hides little of them."""
    def hits(rng, degc, t, i):
        return (rng.random(t.size) < 0.003) * 400 * rng.standard_normal(t.size)

    paths = logs_of(tmp_path, hits, 9)
    axis, named = answer(tmp_path, paths)
    gap = axis["gap"]
    assert named == ["outliers"] and gap["gain_mean_s"] == 1 and gap["shrinkage"] is None and min(gap["gain_by_unit"]) > 500
    own = 0
    for path in paths[4:]:
        rate = np.loadtxt(path, delimiter=",", skiprows=3)[:, 2]
        # Less what the process is about each second: medians of its neighbours.
        level = np.array([np.median(rate[max(0, k - 20):k + 21]) for k in range(rate.size)])
        rest, plain = rate - level, WHITE**2 + SIGMA**2 / 5
        wide = plain + 400**2
        own += 2 * np.sum(np.log(0.997 + 0.003 * np.sqrt(plain / wide) * np.exp(rest**2 / 2 * (1 / plain - 1 / wide))))
    assert sum(gap["gain_by_unit"]) == pytest.approx(own, rel=0.2)
