# SPDX-License-Identifier: MIT
"""What `imucal look` tells of a log, against what was put in: nothing of a healthy one, and each fault by its name."""
import json
import re
import subprocess

import numpy as np
import pytest

from imucal.__main__ import main
from imucal.firstlook import look_at_axis
from imucal.log import Log, write_log
from imucal.look_words import rounded, with_error
from imucal.plot import look_page
from where import BIN

WHITE, SIGMA, TAU_S = 36.0, 15.0, 200.0


def markov(rng, n, sigma=SIGMA, tau_s=TAU_S):
    keep = np.exp(-1 / tau_s)
    drive = sigma * np.sqrt(1 - keep ** 2) * rng.standard_normal(n)
    slow = np.empty(n)
    slow[0] = sigma * rng.standard_normal()
    for k in range(1, n):
        slow[k] = keep * slow[k - 1] + drive[k]
    return slow


def healthy(seed, n=14000, span=(-10, 60)):
    """A soak, a ramp up, a soak, a ramp down, a soak."""
    rng = np.random.default_rng(seed)
    t = np.arange(1.0, n + 1)
    temp = np.interp(t / n, [0, 0.085, 0.457, 0.543, 0.915, 1], [span[0], span[0], span[1], span[1], span[0], span[0]])
    tn = (temp - 25) / 35
    rate = 300 + 200 * tn + 80 * tn ** 2 - 40 * tn ** 3 + markov(rng, n) + WHITE * rng.standard_normal(n)
    return Log(t, temp, {"gx_dph": rate}, {}, {}, "simulated")


def looked(tmp_path, capsys, log, *options, ml=False):
    """(text, JSON of the axes)."""
    path = tmp_path / "log.csv"
    write_log(path, log)
    words = ["look", str(path), "-o", str(tmp_path / "page.png"), "--json", str(tmp_path / "j"), *options]
    assert main(words if ml else [*words, "--no-ml"]) == 0
    return capsys.readouterr().out, json.loads((tmp_path / "j").read_text())["axes"]


# --- no temperature (it does not stand still: it is not there)

def test_a_log_without_temperature_is_told_so(tmp_path, capsys):
    log = healthy(1, 3000)
    text, _ = looked(tmp_path, capsys, Log(log.t_s, np.full(3000, np.nan), log.rates, {}, {}, "simulated"))
    assert text.count("no temperature in this log: ") == 2 and "record it, column temp_degc" in text
    assert "one way" not in text and "moves" not in text


# --- warm-up

@pytest.mark.parametrize("n", [7000, 14000])
def test_healthy_logs_show_nothing(n):
    """Six of a hundred would be far more than the stated one of a hundred."""
    looks = [look_at_axis(healthy(seed, n), "gx_dph") for seed in range(60)]
    found = [look for look in looks if look.jumps or look.has_warm_up or look.has_loop]
    assert len(found) <= 3


@pytest.mark.parametrize("size, tau_s", [(300, 800), (-300, 300), (200, 900)])
def test_a_warm_up_is_seen_beside_the_noise_that_holds_it(size, tau_s):
    for seed in range(5):
        log = healthy(seed)
        log.rates["gx_dph"] += size * np.exp(-log.t_s / tau_s)
        look = look_at_axis(log, "gx_dph")
        mean = size * tau_s / 900 * (1 - np.exp(-900 / tau_s))
        assert look.has_warm_up and not look.jumps and look.warm_up == pytest.approx(mean, abs=40)


def test_a_warm_up_is_told_and_calibration_is_not_advised(tmp_path, capsys):
    log = healthy(3)
    log.rates["gx_dph"] += 300 * np.exp(-log.t_s / 800)
    text, axes = looked(tmp_path, capsys, log)
    assert "suspected: gx_dph a warm-up: the start lies +" in text
    assert "next: imucal diagnose --log" in text and "calibrate" not in text
    assert axes[0]["has_warm_up"] and axes[0]["warm_up_z"] > 5


# --- jumps

@pytest.mark.parametrize("jumps", [[(4000, 180), (9000, -180)], [(7000, -110)], [(3000, 150), (6000, 150), (11000, -200)]])
def test_jumps_are_named_with_time_and_size_and_are_no_loop(jumps, tmp_path, capsys):
    log = healthy(5)
    for t_s, size in jumps:
        log.rates["gx_dph"] += size * (log.t_s > t_s)
    text, axes = looked(tmp_path, capsys, log)
    found = axes[0]["jumps"]
    assert [round(j["t_s"] / 100) for j in found] == [round(t_s / 100) for t_s, _ in jumps]
    assert all(abs(j["size"] - size) < 45 for j, (_, size) in zip(found, jumps))
    assert not axes[0]["has_loop"] and "a loop of" not in text and text.count("a jump of") == len(jumps)
    assert "next: imucal diagnose" in text


def test_a_jump_does_not_hide_a_warm_up():
    for seed in range(4):
        log = healthy(seed)
        log.rates["gx_dph"] += 200 * np.exp(-log.t_s / 800) + 250 * (log.t_s > 8000)
        look = look_at_axis(log, "gx_dph")
        assert look.has_warm_up and [round(t_s / 100) for t_s, _ in look.jumps] == [80]


# --- what is no measurement

def clipped(seed=7):
    log = healthy(seed)
    log.rates["gx_dph"] = np.minimum(log.rates["gx_dph"], 450.0)
    return log


def test_clipping_is_told_and_has_no_part_in_the_noise(tmp_path, capsys):
    text, axes = looked(tmp_path, capsys, clipped())
    assert re.search(r"gx_dph reads its largest value, 450 dph, in \d+ % of the seconds: clipped", text)
    assert "a larger range" in text and "calibrate fit" not in text
    assert axes[0]["white_1s"] == pytest.approx(WHITE, rel=0.06), "with them it is 29"
    low = clipped()
    low.rates["gx_dph"] = -low.rates["gx_dph"]
    assert "its smallest value, -450 dph" in looked(tmp_path, capsys, low)[0]


@pytest.mark.parametrize("lattice_dph", [1.0, 18.0, 100.0])
def test_a_coarse_output_is_not_clipped(lattice_dph):
    log = healthy(8)
    log.rates["gx_dph"] = lattice_dph * np.round(log.rates["gx_dph"] / lattice_dph)
    assert look_at_axis(log, "gx_dph").clipped_share == 0


@pytest.mark.parametrize("seed", range(21, 27))
def test_stairs_of_a_coarse_output_are_no_jumps(seed):
    log = healthy(seed)
    log.rates["gx_dph"] = 200 * np.round(log.rates["gx_dph"] / 200)
    look = look_at_axis(log, "gx_dph")
    assert not look.jumps and not look.has_warm_up and not look.has_loop


def test_wild_seconds_have_no_part_in_any_figure(tmp_path, capsys):
    log = healthy(9)
    plain = look_at_axis(healthy(9), "gx_dph")
    log.rates["gx_dph"][4321] = 1e6
    log.rates["gx_dph"][::700] += 20000
    text, axes = looked(tmp_path, capsys, log, ml=True)
    assert "21 outliers" in text and "1000000 dph at t_s = 4322" in text and "left out" in text
    assert "next: find out what happened" in text and "calibrate fit" not in text
    assert axes[0]["white_1s"] == pytest.approx(plain.white, rel=0.02)
    assert axes[0]["instability"] == pytest.approx(plain.slow_sigma, rel=0.05)
    np.testing.assert_allclose(axes[0]["coeff"], plain.poly, atol=3)
    assert axes[0]["likelihood"]["arw_deg_rt_h"] == pytest.approx(0.6, rel=0.03)


def test_wild_seconds_do_not_flatten_the_page():
    log = healthy(9)
    log.rates["gx_dph"][4321] = 1e6
    log.rates["gx_dph"][5000] = -3e5
    look = look_at_axis(log, "gx_dph")
    raw, against_temperature = [panel for panel in look_page(log, [look]).panels if not panel.twin_of][:2]
    usual = np.nanmax(look.used) - np.nanmin(look.used)
    for panel in (raw, against_temperature):
        scale = panel.scales()[1]
        assert scale.high - scale.low < 1.5 * usual
    arrows = {curve.marker: curve for curve in raw.curves if curve.marker in "^v"}
    assert arrows["^"].x.tolist() == [4321 / 60] and arrows["v"].x.tolist() == [5000 / 60]
    assert all(scale.low < y < scale.high for scale in [raw.scales()[1]] for y in (arrows["^"].y[0], arrows["v"].y[0]))
    assert [words[2] for words in raw.words] == ["1000000 at 72 min", "-300000 at 83 min"]


def test_a_dead_axis_has_one_panel_and_no_figures(tmp_path, capsys):
    log = healthy(10, 3000)
    log.rates["gy_dph"] = np.full(3000, 123.4)
    looks = [look_at_axis(log, axis) for axis in ("gx_dph", "gy_dph")]
    panels = [panel for panel in look_page(log, looks).panels if not panel.twin_of]
    assert len(panels) == 6 and "constant, 123.4 dph" in panels[-1].title
    scale = panels[-1].scales()[1]
    assert scale.ticks()[2] == "" and scale.high - scale.low >= 2
    text, axes = looked(tmp_path, capsys, log)
    assert "gy_dph: mean 123.4 dph, constant" in text and not re.search(r"e-1\d", text) and axes[1]["allan"]["adev"] == []


# --- Allan deviation

def test_the_expected_curve_is_of_a_log_like_this_one(tmp_path, capsys):
    """Noise alone rises where the polynomial has taken the slow part out of the data; the right curve lies in the interval."""
    inside = total = 0
    for seed in (11, 12, 13):
        _, axes = looked(tmp_path, capsys, healthy(seed), ml=True)
        allan = axes[0]["allan"]
        tau, expected, ci95 = np.array(allan["tau_s"]), np.array(allan["expected"]), np.array(allan["ci95"])
        ml = axes[0]["likelihood"]
        (tmp_path / "m.json").write_text(json.dumps({"imucal_model": 1, "arw_deg_rt_h": ml["arw_deg_rt_h"], "markov": [
            {"sigma_dph": ml["sigma_dph"], "tau_s": ml["tau_s"]}]}))
        command = [BIN / "errormodel", "expect", tmp_path / "m.json", "--type", "av", "--like", tmp_path / "log.csv",
                   "--detrend", "poly:3", "--tau", ",".join(f"{t:g}" for t in tau), "--json", "-"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        np.testing.assert_allclose(expected, json.loads(done.stdout)["dp_dph"], rtol=1e-6)
        inside += np.sum((ci95[:, 0] < expected) & (expected < ci95[:, 1]))
        total += len(tau)
        assert tau[-1] <= 14000 / 9
    assert inside / total > 0.8


def test_a_minimum_is_told_only_where_it_is_one(tmp_path, capsys):
    rng = np.random.default_rng(14)
    n = 20000
    t, temp = np.arange(1.0, n + 1), np.full(n, 25.0)
    white = Log(t, temp, {"gx_dph": 36 * rng.standard_normal(n)}, {}, {}, "simulated")
    text, axes = looked(tmp_path, capsys, white)
    assert "no clear lowest point" in text and axes[0]["allan"]["minimum"] is None
    white.rates["gx_dph"] = white.rates["gx_dph"] + markov(rng, n, 60, 3000)
    text, axes = looked(tmp_path, capsys, white)
    tau_s, value = axes[0]["allan"]["minimum"]
    assert 16 <= tau_s <= 128 and f"lowest at {tau_s:.0f} s: {rounded(value)}" in text


def test_a_second_missing_in_fifty_does_not_end_the_curve():
    log = healthy(15)
    kept = np.random.default_rng(15).random(len(log.t_s)) > 0.02
    whole = look_at_axis(log, "gx_dph")
    thinned = Log(log.t_s[kept], log.temp_degc[kept], {"gx_dph": log.rates["gx_dph"][kept]}, {}, {}, "simulated")
    some = look_at_axis(thinned, "gx_dph")
    assert some.allan_tau_s[-1] == whole.allan_tau_s[-1] == 1024
    np.testing.assert_allclose(some.allan, whole.allan, rtol=0.06)


# --- the page

def test_no_line_is_drawn_through_a_gap():
    log = healthy(16)
    kept = (log.t_s < 6000) | (log.t_s > 7500)
    log = Log(log.t_s[kept], log.temp_degc[kept], {"gx_dph": log.rates["gx_dph"][kept]}, {}, {}, "simulated")
    panels = look_page(log, [look_at_axis(log, "gx_dph")]).panels
    against_time = [panel for panel in panels if (panel.twin_of or panel).x_name == "time, min"]
    lines = [curve for panel in against_time for curve in panel.curves if curve.line == "-"]
    assert len(lines) == 2, "the temperature and the residual"
    for curve in lines:
        assert np.isnan(curve.x).sum() == 1 and np.nanmax(np.diff(curve.x)) < 1


def test_the_page_names_its_log_its_axes_and_its_colours():
    log = healthy(17, 3000)
    log.rates["gy_dph"] = log.rates["gx_dph"][::-1]
    looks = [look_at_axis(log, axis) for axis in ("gx_dph", "gy_dph")]
    page = look_page(log, looks, "run7.csv")
    assert page.title == "run7.csv, 50 min (3000 s)"
    words = {word for word, _ in page.legend}
    assert {"rising", "falling", "at rest", "temperature", "polynomial", "white noise alone"} <= words
    for row, name in enumerate(("gx", "gy")):
        for panel in [p for p in page.panels if not p.twin_of][5 * row:5 * row + 5]:
            assert panel.title.startswith(name) and panel.y_name.startswith(name) and "dph" in panel.y_name
    colours = {}
    for word, how in page.legend:
        colours.setdefault(how["color"], []).append(word)
    assert colours.pop("#1d2733") and colours.pop("#66727f"), "what is computed of the data, and the data"
    assert all(len(words) == 1 for words in colours.values()), "one colour, one meaning"


def test_html_shows_the_picture_before_the_words(tmp_path):
    write_log(tmp_path / "log.csv", healthy(18, 2000))
    assert main(["look", str(tmp_path / "log.csv"), "-o", str(tmp_path / "p.html"), "--no-ml", "-q"]) == 0
    text = (tmp_path / "p.html").read_text()
    assert text.index("<img") < text.index("<pre")


# --- words

def test_the_advised_calibration_is_accepted_and_has_the_order_that_is_drawn(tmp_path, capsys):
    for log, order in ((healthy(19), 3), (healthy(19, span=(23, 26)), 2)):
        text, axes = looked(tmp_path, capsys, log)
        command = re.search(r"next: imucal calibrate fit (.*?) -o table.json", text)[1]
        assert f"--order {order}" in command and len(axes[0]["coeff"]) == order + 1
        words = [BIN / "calibrate", "fit", *command.split(), "-o", tmp_path / "table.json", "-q"]
        assert subprocess.run(words, cwd=tmp_path).returncode == 0


def test_a_calibration_that_would_be_refused_is_not_advised(tmp_path, capsys):
    """150 s with a ramp of 1.6 degC a second."""
    log = healthy(20, 300)
    text, _ = looked(tmp_path, capsys, log)
    assert "next: record again" in text and "refused: gx_dph: " in text and "calibrate fit" not in text
    coarse = healthy(22)
    coarse.rates["gy_dph"] = 200 * np.round(coarse.rates["gx_dph"] / 200)
    text, _ = looked(tmp_path, capsys, coarse)
    assert re.search(r"next: imucal calibrate fit \S+ --axis gx_dph --method .*refused: gy_dph: ", text)


@pytest.mark.parametrize("value, error, words", [
    (732.4, 213.0, "730 ± 210"), (0.6011, 0.0037, "0.6011 ± 0.0037"),
    (14100.0, 14100.0, "not known (of the order of 10000)"), (4330.0, None, "about 4300"),
    (80.6, 410.0, "not known (of the order of 80)"), (None, None, "-"), (18.96, 0.96, "18.96 ± 0.96")])
def test_a_value_has_the_digits_that_its_error_leaves(value, error, words):
    assert with_error(value, error) == words


@pytest.mark.parametrize("value, words", [(1e6, "1000000"), (0.000123, "0.00012"), (0.0, "0"), (99.6, "100"), (-83.4, "-83")])
def test_no_value_has_an_exponent(value, words):
    assert rounded(value) == words
