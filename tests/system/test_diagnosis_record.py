# SPDX-License-Identifier: MIT
"""What `diagnose --json` gives for the eye: the rows as they were logged, why some are left out, and what was judged where."""
import json
import subprocess

import numpy as np
import pytest

from where import BIN

LIMIT_DPH, HOLE_S, WILD_S, DAY_S = 420.0, (5000, 8600), (1501, 9007), 10800
MODEL = {"imucal_model": 1, "arw_deg_rt_h": 0.3, "markov": [{"sigma_dph": 5, "tau_s": 200}]}


def write_log(path, seed, is_spoilt):
    """Four axes over one loop of temperature: gx clipped where it is hot, gy with hysteresis, gz dead, gw with two wild seconds."""
    rng = np.random.default_rng(seed)
    t = np.arange(1, DAY_S + 1)
    temp = 60 * (1 - np.abs(2 * t / DAY_S - 1))
    slow = np.zeros(t.size)
    for k in range(1, t.size):
        slow[k] = np.exp(-1 / 200) * slow[k - 1] + 5 * np.sqrt(1 - np.exp(-2 / 200)) * rng.standard_normal()
    play = np.clip(temp, temp - 6, temp + 6).copy()
    play[0] = 6
    for k in range(1, t.size):
        play[k] = min(max(play[k - 1], temp[k] - 6), temp[k] + 6)
    gx = 5 * temp + 150 + slow + 18 * rng.standard_normal(t.size)
    gy = 100 + temp + 60 * (play - temp) / 6 + slow + 18 * rng.standard_normal(t.size)
    gx = np.minimum(gx, LIMIT_DPH) if is_spoilt else gx
    gw = 50 - temp + slow[::-1] + 18 * rng.standard_normal(t.size)
    for at, value in zip(WILD_S, (20000, -9e5)) if is_spoilt else ():
        gw[at - 1] = value
    rows = (t <= HOLE_S[0]) | (t > HOLE_S[1]) if is_spoilt else np.ones(t.size, bool)
    lines = "".join(f"{a},{b:.3f},{c:.3f},{d:.3f},123.4,{e:.3f}\n" for a, b, c, d, e in zip(t[rows], temp[rows], gx[rows], gy[rows], gw[rows]))
    path.write_text("# imucal-log = 1\n# device = D  serial = 3\nt_s,temp_degc,gx_dph,gy_dph,gz_dph,gw_dph\n" + lines)
    return {"t_s": t[rows], "temp_degc": temp[rows], "gx_dph": np.round(gx[rows], 3), "gy_dph": np.round(gy[rows], 3), "gw_dph": np.round(gw[rows], 3)}


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """(axes by their names, the fitted log, the held-out one)"""
    folder = tmp_path_factory.mktemp("record")
    logs = write_log(folder / "a.csv", 1, True), write_log(folder / "b.csv", 2, False)
    (folder / "model.json").write_text(json.dumps(MODEL))
    done = subprocess.run([BIN / "diagnose", "--model", "model.json", "--log", "a.csv", "--holdout", "b.csv", "--cache", "cache", "--json", "d.json"],
                          cwd=folder, capture_output=True, text=True)
    assert done.returncode == 1, done.stderr  # gz is refused
    return ({axis["axis"]: axis for axis in json.loads((folder / "d.json").read_text())["axes"]}, *logs)


def test_every_row_is_drawn_or_left_out_with_its_reason(asked):
    axes, fitted, held = asked
    for name in ("gx_dph", "gy_dph", "gw_dph"):
        for log, truth in zip(axes[name]["plots"]["record"], (fitted, held)):
            n_left_out = sum(rows["n"] for rows in log["left_out"])
            assert len(log["t_s"]) == -(-(truth["t_s"].size - n_left_out) // log["every"])
            place = {t: k for k, t in enumerate(truth["t_s"])}
            for rows in [log, *log["left_out"]]:
                at = [place[t] for t in rows["t_s"]]
                np.testing.assert_allclose(rows["rate_dph"], truth[name][at], rtol=1e-6)
                np.testing.assert_allclose(rows["temp_degc"], truth["temp_degc"][at], atol=1e-3)


def test_clipped_and_wild_seconds_are_counted_and_placed(asked):
    axes, fitted, _ = asked
    log, held = axes["gx_dph"]["plots"]["record"]
    left = {rows["why"]: rows for rows in log["left_out"]}
    assert not log["is_held_out"] and held["is_held_out"] and not held["left_out"]
    assert left["saturation"]["n"] == np.sum(fitted["gx_dph"] == LIMIT_DPH) and set(left["saturation"]["rate_dph"]) == {LIMIT_DPH}
    assert left["saturation"]["label"] == "readings clipped at a limit" and left["neighbour"]["n"] > 0
    wild = {rows["why"]: rows for rows in axes["gw_dph"]["plots"]["record"][0]["left_out"]}
    assert wild["hit"]["t_s"] == list(WILD_S) and wild["hit"]["rate_dph"] == [20000, -9e5] and set(wild) == {"hit"}


def test_an_axis_without_an_answer_has_its_record(asked):
    axes = asked[0]
    assert axes["gz_dph"]["refused"] and set(axes["gz_dph"]["plots"]) == {"record"}
    assert set(axes["gz_dph"]["plots"]["record"][0]["rate_dph"]) == {123.4}


def test_no_mean_goes_over_a_hole(asked):
    """Of rows that follow each other: mean rate and time are of one minute of the log."""
    axes, fitted, _ = asked
    residual = axes["gw_dph"]["plots"]["residual"]
    at = np.array(residual["t_s"])
    assert np.all((at <= HOLE_S[0]) | (at > HOLE_S[1]))
    assert HOLE_S[0] - at[at <= HOLE_S[0]].max() < 60 and at[at > HOLE_S[1]].min() - HOLE_S[1] <= 31
    good = np.abs(fitted["gw_dph"]) < 1000
    for t, temp, rate in zip(at, residual["temp_degc"], residual["rate_dph"]):
        near = good & (np.abs(fitted["t_s"] - t) <= 30)
        assert abs(rate - fitted["gw_dph"][near].mean()) < 4
        assert abs(temp - 60 * (1 - abs(2 * t / DAY_S - 1))) < 0.1


def test_cells_of_the_map_without_a_second_are_empty(asked):
    """No second of the hot end counts where gx is clipped."""
    gap_map = asked[0]["gx_dph"]["plots"]["gap_map"]
    edges, z = np.array(gap_map["temp_edges_degc"]), gap_map["z"]
    used = np.array(asked[0]["gx_dph"]["plots"]["record"][0]["temp_degc"])
    empty = [k for k in range(len(edges) - 1) if not np.any((used >= edges[k] - 0.5) & (used < edges[k + 1] + 0.5))]
    assert empty and all(row[k] is None for row in z for k in empty)
    assert sum(v is not None for v in z[0]) > 6


def test_what_was_judged_is_what_is_drawn(asked):
    axis = asked[0]["gy_dph"]
    assert axis["effects"][0]["family"] == "thermal_memory" and axis["gap"]["has_mean"]
    held, rms = axis["plots"]["held_out"], axis["gap"]["residual_rms_dph"]
    assert held["are_logs"] and set(held["log"]) == {0} and set(held["unit"]) == {0}
    for key in ("before", "after"):
        assert np.sqrt(np.mean(np.square(held[f"{key}_dph"]))) == pytest.approx(rms[key], rel=1e-4)
    place = {t: k for k, t in enumerate(asked[2]["t_s"])}
    for t, rate in list(zip(held["t_s"], held["rate_dph"]))[::20]:
        middle = place[round(t)]
        assert abs(rate - asked[2]["gy_dph"][middle - 30:middle + 30].mean()) < 6


def test_dp2_of_the_logs_without_the_cause_is_told_beside_its_distance(asked):
    axis = asked[0]["gy_dph"]
    dp2, apart = axis["plots"]["dp2"], axis["gap"]["dp2_distance_dph"]
    for logs, model, key in (("data_dph", "model_before_dph", "before"), ("data_after_dph", "model_after_dph", "after")):
        off = np.array(dp2[logs], float) - np.array(dp2[model], float)
        assert np.sqrt(np.nanmean(off**2)) == pytest.approx(apart[key], rel=1e-6)
    assert dp2["data_after_dph"][-1] < 0.5 * dp2["data_dph"][-1]
