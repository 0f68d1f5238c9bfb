# SPDX-License-Identifier: MIT
"""The blind check's own mathematics: whitening, strengths, logs, sealing, scoring.  Needs no built program."""
import json
import os
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.join(os.path.dirname(__file__), ".."))
from blind import campaign, cases, coverage, draw, intervals, oracle, runner, score, simulate, strength, whiten  # noqa: E402


@pytest.fixture(scope="module")
def group():
    return campaign.draw_group("t", "triangle", np.random.default_rng(11), seconds=1500, aux=True)


def dense_covariance(n, noise_sigma, markov):
    k = np.arange(n)
    cov = noise_sigma**2 * np.eye(n)
    for sigma, tau in markov:
        cov += sigma**2 * np.exp(-np.abs(k[:, None] - k[None]) / tau)
    return cov


def test_kalman_against_dense_cholesky_with_missing_rows():
    n, markov = 80, [(20.0, 10.0), (9.0, 40.0)]
    rng = np.random.default_rng(0)
    keep = rng.random(n) > 0.2
    y = rng.standard_normal((n, 2))
    cov = dense_covariance(n, 7.0, markov)[np.ix_(keep, keep)]
    factor = np.linalg.cholesky(cov)
    noise = whiten.Noise(49.0, [whiten.markov_part(s, t) for s, t in markov])
    e, log_s = whiten.kalman(y[None], noise, keep[None])
    np.testing.assert_allclose(e[0][keep], np.linalg.solve(factor, y[keep]), atol=1e-9)
    assert np.isclose(log_s.sum(), np.linalg.slogdet(cov)[1])
    assert np.all(e[0][~keep] == 0)


def test_restricted_likelihood_against_dense_algebra(group):
    short = campaign.Group("s", "x", group.nominal, group.nominal, group.train[:2], [])
    y, keep = whiten.pad([np.random.default_rng(i).standard_normal((r.n, 1)) * 50 for i, r in enumerate(short.train)])
    blocks = [dense_covariance(r.n, group.nominal.white_dph, group.nominal.markov) for r in short.train]
    base, _ = whiten.pad(whiten.nuisance(short, short.train))
    x = whiten.spread(base).reshape(2, -1, 5)
    total, information = 0.0, np.zeros((5, 5))
    vector = np.zeros(5)
    for i, r in enumerate(short.train):
        xi, yi = x[i, : r.n], y[i, : r.n, 0]
        inverse = np.linalg.inv(blocks[i])
        total += np.linalg.slogdet(blocks[i])[1] + yi @ inverse @ yi
        information += xi.T @ inverse @ xi
        vector += xi.T @ inverse @ yi
    expected = -0.5 * (total - vector @ np.linalg.solve(information, vector) + np.linalg.slogdet(information)[1])
    got = whiten.reml(short, short.train, whiten.nominal_noise(group.nominal), y)[0, 0]
    assert np.isclose(got, expected, rtol=1e-8)


def test_strength_of_a_signature_is_the_mean_gain_of_fitting_it(group):
    """2 x gain of fitting the amplitude has mean d^2 + 1 (noncentral chi-square of one degree)."""
    rng = np.random.default_rng(5)
    bias = campaign.draw_bias(rng, group)
    effect = {"name": "thermal_hysteresis", "parameters": {"amplitude_dph": 1.0, "width_degc": 6.0}}
    effect, d = strength.to_strength(group, effect, 6.0, bias, 1)
    assert np.isclose(d, 6.0)
    draws = 200
    y = []
    for i, run in enumerate(group.train):
        fixed = simulate.polynomial(bias, group.x(run.shown_degc)) + simulate.signature(effect, group, run, i, bias)
        noise = np.stack([simulate.nominal_series(group, run, rng) for _ in range(draws)], 1)
        y.append(fixed[:, None] + 100.0 * rng.standard_normal(draws) + noise)
    w = strength.nominal_whitener(group)
    z = w.perpendicular(strength.signature_columns(group, effect, bias))[:, 0]
    gain2 = (z @ w.perpendicular(y)) ** 2 / (z @ z)
    # standard error of the mean of a noncentral chi-square: sqrt((2 + 4 d^2)/draws)
    assert abs(gain2.mean() - (36 + 1)) < 4 * np.sqrt((2 + 4 * 36) / draws)


@pytest.mark.parametrize("name, parameters", [("second_markov", {"sigma_dph": 1.0, "tau_s": 8.0}),
                                              ("white_noise_vs_temperature", {"slope": 0.5})])
def test_strength_of_noise_repeats_on_fresh_records(group, name, parameters):
    effect = {"name": name, "parameters": parameters}
    effect, d = strength.to_strength(group, effect, 10.0, np.zeros(4), 3, draws=6)
    gains = [strength.gaussian_gain(group, [[effect]], None, 1000 + k, 6)[0] for k in range(4)]
    spread = np.std(gains) / 2 + 50.0 * 0.15  # of this mean, and of the 6 records behind the amplitude
    assert d == 10.0 and abs(np.mean(gains) - 50.0) < 3 * spread


def test_strength_of_run_to_run_is_the_mean_marginal_gain(group):
    rng = np.random.default_rng(8)
    effect, d = strength.to_strength(group, {"name": "run_to_run", "parameters": {"sigma_dph": 1.0, "_draws": []}},
                                     5.0, np.zeros(4), 1)
    s = effect["parameters"]["sigma_dph"]
    w = strength.nominal_whitener(group)
    columns = []
    for i, r in enumerate(group.train):
        x = group.x(r.temp_degc)
        block = np.zeros((r.n, 8))
        block[:, 2 * i], block[:, 2 * i + 1] = x, (x**2 - 1 / 3) / 2
        columns.append(block)
    z = w.perpendicular(columns)
    # marginal model N(0, I + s^2 Z Z'): gain of the truth over the nominal for drawn data
    lam, u = np.linalg.eigh(z.T @ z)
    gains = []
    for _ in range(4000):
        e = rng.standard_normal(8) * np.sqrt(np.clip(lam, 0, None)) + s * lam * (u.T @ rng.standard_normal(8))
        gains.append(np.sum(-0.5 * np.log1p(s**2 * lam) + 0.5 * s**2 * e**2 / (1 + s**2 * lam)))
    assert abs(np.mean(gains) - d**2 / 2) < 4 * np.std(gains) / np.sqrt(4000)


def test_whittle_strength_of_a_spectrum_agrees_with_the_kalman_likelihood(group, monkeypatch):
    effect = {"name": "second_markov", "parameters": {"sigma_dph": 0.5 * group.nominal.white_dph, "tau_s": 3.0}}
    sigma, tau = effect["parameters"]["sigma_dph"], 3.0
    phi = np.exp(-1 / tau)
    monkeypatch.setattr(strength.unknown, "spectrum", lambda p, f, g: 2 * sigma**2 * (1 - phi**2) / (
        1 - 2 * phi * np.cos(2 * np.pi * f) + phi**2))
    whittle = strength.spectrum_strength(group, {"parameters": {"_amplitude": 1.0}})
    exact = np.sqrt(2 * strength.gaussian_gain(group, [[effect]], None, 1, 20)[0])
    assert abs(whittle / exact - 1) < 0.1


def test_confusable_pair_is_recognised():
    """A ramp in time and a slow warm-up are nearly the same thing; an anomaly is nothing like them."""
    rng = np.random.default_rng(2)
    g = campaign.draw_group("t", "up_and_down", rng, seconds=3000)
    ramp = {"name": "rate_ramp", "parameters": {"ramp_dph_per_h": 10.0}}
    assert strength.most_confusable(g, ramp, np.zeros(4))[1] > 0.8
    bump = {"name": "thermal_anomaly", "parameters": {"amplitude_dph": 10.0, "center_degc": 35.0, "width_degc": 1.0}}
    assert strength.most_confusable(g, bump, np.zeros(4))[1] < 0.6


@pytest.mark.parametrize("family", campaign.FAMILIES)
def test_profiles_stay_in_the_span_of_the_model_and_last_as_asked(family):
    g = campaign.draw_group("t", family, np.random.default_rng(4), seconds=2400)
    for run in g.train + g.hold:
        assert np.all(np.abs(g.x(run.shown_degc)) <= 1 + 1e-9)
        assert family == "staircase" or 0.85 * 2400 < run.n < 1.3 * 2400
    if family in ("up_ramp", "up_soak", "up_only"):
        assert all(np.all(np.diff(r.temp_degc[::300]) > -0.3) for r in g.train)


def test_logs_follow_the_contract_and_hide_the_cause(tmp_path):
    g = campaign.draw_group("t", "mixed", np.random.default_rng(6), seconds=1200, missing=True, aux=True)
    case = cases.single(g, np.random.default_rng(7), "warm_up", 10, "c1")
    path = case.write(str(tmp_path))
    assert sorted(os.listdir(path)) == ["hold4.csv", "hold5.csv"] + [f"train{i}.csv" for i in range(4)]
    for i, run in enumerate(g.train):
        with open(os.path.join(path, f"train{i}.csv"), encoding="utf-8") as f:
            text = f.read()
        head, *rows = [line for line in text.splitlines() if not line.startswith("#")]
        assert head == "t_s,temp_degc,gx_dph,supply_v" and "warm" not in text
        assert text.startswith("# imucal-log = 1\n")
        t = [float(r.split(",")[0]) for r in rows]
        assert len(t) == run.keep.sum() < run.n and np.all(np.diff(t) > 0)
        np.testing.assert_allclose([float(r.split(",")[1]) for r in rows], run.shown_degc[run.keep], atol=6e-4)


def test_seal_hides_opens_and_notices_changes(tmp_path):
    labels = {"seed": 1, "groups": [{"labels": [{"effects": ["thermal_hysteresis"]}]}]}
    digest = draw.seal(labels, str(tmp_path))
    hidden = (tmp_path / "labels.sealed").read_bytes()
    assert b"thermal" not in hidden
    assert draw.open_sealed(str(tmp_path), digest) == labels
    (tmp_path / "labels.sealed").write_bytes(hidden[:-1] + bytes([hidden[-1] ^ 1]))
    with pytest.raises(ValueError, match="changed after sealing"):
        draw.open_sealed(str(tmp_path), digest)


def answer(verdict, *names, rivals=()):
    effects = [{"name": n, "parameters": {}, "evidence_nats": 9, "set": [{"name": n}, *({"name": r} for r in rivals)]}
               for n in names]
    return {"status": 0, "cpu_s": 0.5, "diagnosis": {"axes": [{"axis": "gx_dph", "verdict": verdict, "effects": effects}]}}


def test_score_counts_what_was_said():
    one = lambda name, d=20: {"kind": "single", "target": d, "family": "mixed", "group": "m", "noise_known": True,
                              "effects": [{"name": name, "parameters": {}}]}
    labels = {"a": one("rate_ramp"), "b": one("rate_ramp"), "c": one("warm_up"), "d": one("warm_up"), "e": one("warm_up"),
              "n": {"kind": "no_gap", "target": 0, "family": "mixed", "group": "m", "noise_known": True, "effects": []},
              "u": {"kind": "unknown", "target": 20, "family": "mixed", "group": "m", "noise_known": True, "d_left": 9,
                    "effects": [{"name": "unknown_function", "parameters": {}}]},
              "p": {**one("rate_ramp"), "kind": "pair",
                    "effects": [{"name": "rate_ramp", "parameters": {}}, {"name": "outliers", "parameters": {}}]}}
    answers = {"a": answer("explained", "rate_ramp"), "b": answer("explained", "warm_up", rivals=["rate_ramp"]),
               "c": answer("explained", "outliers"), "d": answer("no_gap"), "e": answer("unexplained"),
               "n": answer("explained", "outliers"), "u": answer("unexplained"),
               "p": answer("explained", "outliers", "rate_ramp")}
    s = score.everything(labels, answers)
    row = s["single"]["by_strength"]["20"]
    assert (row["named"], row["in_set"], row["wrong"], row["no_gap"], row["abstains"]) == (1, 1, 1, 1, 1)
    assert s["pair"]["all"]["exactly_both"]["k"] == 1
    assert s["gap_free"]["0.01"]["all"]["false_names"]["k"] == 1
    assert s["withheld"]["unknown"]["20"]["abstains"]["k"] == 1
    assert s["confusion"]["warm_up"] == {"outliers": 1, "(no gap)": 1, "(unknown)": 1}


def test_intervals_are_the_exact_ones():
    lo, hi = intervals.clopper_pearson(0, 300)
    assert lo == 0 and np.isclose(hi, 1 - 0.025 ** (1 / 300))
    lo, hi = intervals.clopper_pearson(8, 10)
    assert np.isclose(lo, 0.4439045) and np.isclose(hi, 0.9747893)


def test_oracle_gains_on_held_out_runs_and_a_wrong_model_loses(group):
    rng = np.random.default_rng(9)
    bias = campaign.draw_bias(rng, group)
    effect, _ = strength.to_strength(group, cases.draw_effect("rate_ramp", rng, group), 30, bias, 1)
    series = simulate.simulate_axis(group, bias, [effect], rng)
    before = oracle.held_out_deviance(group, series, [], bias).sum()
    after = oracle.held_out_deviance(group, series, [effect], bias).sum()
    wrong = oracle.held_out_deviance(group, series, [simulate.scaled(effect, -1.0)], bias).sum()
    assert after < before - 100 < wrong


@pytest.mark.parametrize("factor, low, high", [(1.0, 0.99, 1.01), (0.5, 0.6, 0.9), (-1.0, -9.0, 0.0)])
def test_fresh_runs_tell_what_a_reported_model_is_worth(group, tmp_path, factor, low, high):
    """The true parameters reach 1, half the amplitude about 3/4 (1 - (1/2)^2), the wrong sign makes it worse."""
    case = cases.single(group, np.random.default_rng(12), "thermal_anomaly", 30, "c")
    training = coverage.read_training(case.write(str(tmp_path)), group)
    said = {"effects": [simulate.scaled(case.label["effects"][0], factor)]}
    got, best = coverage.shrinkage_on_fresh_runs(group, case.label, said, training, np.random.default_rng(1))
    assert best > 0 and low <= got / best <= high


def test_whole_chain_with_a_stand_in(tmp_path):
    """draw -> seal -> run -> open -> score with a program that always answers the same."""
    stand_in = tmp_path / "diagnose"
    stand_in.write_text(
        "#!" + sys.executable + "\n"
        "import json, sys\na = sys.argv\nlogs = [a[i + 1] for i, v in enumerate(a) if v == '--log']\n"
        "name = [] if '--without' in a else ['rate_ramp']\n"
        "effects = [{'name': n, 'parameters': {}, 'evidence_nats': 5, 'set': [{'name': n}]} for n in name]\n"
        "axes = [{'axis': 'gx_dph', 'verdict': 'explained' if name else 'unexplained', 'effects': effects, 'gap': {}}]\n"
        "json.dump({'axes': axes, 'logs': logs}, open(a[a.index('--json') + 1], 'w'))\n")
    stand_in.chmod(0o755)
    from blind.__main__ import main

    out = tmp_path / "out"
    main(["--diagnose", str(stand_in), "--out", str(out), "--cases", "20", "--gap-free", "2", "--seed", "3", "--seconds", "900",
          "--groups", "up_and_down", "--processes", "1"])
    result = json.loads((out / "blind.json").read_text())
    truths = [label for label in result["labels"].values() if label["kind"] == "single"]
    named = sum(row["named"] for row in result["score"]["single"]["by_strength"].values())
    assert named == sum(label["effects"][0]["name"] == "rate_ramp" for label in truths)
    assert result["score"]["gap_free"]["0.01"]["all"]["false_names"]["rate"] == 1.0
    assert result["score"]["withheld"]["library"]["20"]["abstains"]["rate"] == 1.0
    assert "# Blind check" in (out / "blind.md").read_text()
    assert not (out / "logs").exists()
