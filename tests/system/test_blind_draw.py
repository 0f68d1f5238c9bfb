# SPDX-License-Identifier: MIT
"""The blind check's own physics and mathematics: strengths, start states, sealing, scoring, true reductions.  Needs no built program."""
import copy
import json
import os
import sys

import numpy as np
import pytest

from blind import cases, causes, confusions, gauge, intervals, noise, outside, plan, runner, score, seal, sensor, truth, whiten

BIAS = np.array([80.0, 300.0, 150.0, -100.0])


@pytest.fixture(scope="module")
def device():
    return sensor.draw_device(np.random.default_rng(3), 3, 2, "triangle", 3000.0)


@pytest.fixture(scope="module")
def base():
    return noise.Noise(36.0, [(20.0, 100.0)])


@pytest.fixture(scope="module")
def meter(device, base):
    return gauge.Gauge(device, base.density)


def test_covariance_of_block_means_matches_the_sum_over_seconds(base):
    """Second way: sum sigma^2 phi^|i-j| over the seconds of two blocks."""
    k = np.arange(60)
    dense = 36.0**2 * np.eye(60) + 20.0**2 * np.exp(-np.abs(k[:, None] - k[None]) / 100.0)
    block = dense.reshape(3, 20, 3, 20).mean((1, 3))
    np.testing.assert_allclose(gauge.covariance_row(base.density, 3), block[0], rtol=2e-3)


def test_strength_is_the_mean_gain_of_the_true_cause_over_the_fitted_nominal_model(device, base, meter):
    """2 x gain with the amplitude free has mean d^2 + 1; noise drawn at one second, whitened by the Kalman filter."""
    rng = np.random.default_rng(5)
    cause = cases.to_strength(causes.draw("thermal_hysteresis", rng, device), 6.0, device, base, BIAS, meter)
    shape = cases.training_signals(cause, device, BIAS)
    columns, keep = [], None
    for r, run in enumerate(device.train):
        x = device.x(run.shown_degc)
        y = [causes.noise_path([], device, run, base, rng) + shape[r] + causes.polynomial(BIAS, device.x(run.temp_degc)) for _ in range(60)]
        own = np.eye(len(device.train))[r][None, :] * np.ones((run.n, 1))
        columns.append(np.column_stack([own, x, x**2, x**3, shape[r], *y]))
    padded, keep = whiten.pad(columns)
    e, _ = whiten.kalman(padded, whiten.Noise(base.white_dph**2, [whiten.markov_part(*m) for m in base.markov]), keep)
    e = e.reshape(-1, e.shape[-1])
    q = gauge.basis(e[:, :6])
    z = e[:, 6:] - q @ (q.T @ e[:, 6:])
    gains = (z[:, 1:].T @ z[:, 0]) ** 2 / (z[:, 0] @ z[:, 0])
    assert abs(np.sqrt(z[:, 0] @ z[:, 0]) / 6.0 - 1) < 0.1
    assert abs(gains.mean() - 37) < 4 * np.sqrt((2 + 4 * 36) / 60) + 6


@pytest.mark.parametrize("name", causes.REPEATABLE)
def test_every_repeatable_cause_reaches_its_strength_and_start_states_differ(device, base, meter, name):
    rng = np.random.default_rng(8)
    cause = cases.to_strength(causes.draw(name, rng, device), 10.0, device, base, BIAS, meter)
    assert np.isclose(cases.strength(cause, device, base, BIAS, meter), 10.0, rtol=0.08)
    if "_start" in cause["p"] and name != "thermal_step":
        other = copy.deepcopy(cause)
        other["p"]["_start"] = causes.draw(name, np.random.default_rng(99), device)["p"]["_start"]
        assert np.ptp(causes.signature(other, device, 0, BIAS) - causes.signature(cause, device, 0, BIAS)) > 1e-3


@pytest.mark.parametrize("kind", causes.MECHANISMS)
def test_every_mechanism_closes_a_loop_whose_falling_branch_lies_above_the_rising_one(kind):
    temp = np.concatenate([np.linspace(0, 50, 3000), np.linspace(50, 0, 3000), np.linspace(0, 50, 3000)])
    for seed in range(40):
        p = causes.draw_mechanism(np.random.default_rng(seed))
        if p["_kind"] == kind:
            break
    y = causes.loop({"width_degc": 5.0, **p}, temp, 0.3)
    up, down = np.interp(25, temp[6000:], y[6000:]), np.interp(25, temp[3000:6000][::-1], y[3000:6000][::-1])
    assert down - up > 0.5
    assert abs(np.interp(25, temp[:3000], y[:3000]) - up) < 0.5 * (down - up)


def test_thermal_step_follows_the_contract_with_its_own_hysteresis():
    p = {"amplitude_dph": 1.0, "temp_degc": 30.0, "width_degc": 4.0}
    temp = np.array([20.0, 29, 31, 29, 27, 25, 27, 31])
    np.testing.assert_array_equal(causes.step_state(p, temp, -1.0), [0, 0, 1, 1, 1, 0, 0, 1])
    assert causes.step_state(p, np.array([28.0, 29.0]), 1.0)[0] == 1 and causes.step_state(p, np.array([28.0, 29.0]), -1.0)[0] == 0


def test_strength_of_noise_is_the_gain_on_drawn_records(device, base):
    """Whittle's figure against the mean periodogram likelihood ratio of paths drawn in time."""
    rng = np.random.default_rng(2)
    cause = {"name": "second_markov", "p": {"sigma_dph": 12.0, "tau_s": 6.0}}
    f = np.fft.rfftfreq(4000)[3:-1]
    weight = np.ones(f.size)
    truth_density = base.density(f) + causes.added_density(cause)(f)
    nats, model = noise.least_divergence(truth_density, f, weight, base)
    run = sensor.Run(np.arange(4000.0), np.zeros(4000), np.zeros(4000), np.ones(4000, bool), np.zeros(4000))
    gains = []
    for _ in range(60):
        y = causes.noise_path([cause], device, run, base, rng) * np.hanning(4000) * np.sqrt(8 / 3)
        power = np.abs(np.fft.rfft(y)[3:-1]) ** 2 / 4000
        gains.append(np.sum(power / model + np.log(model) - power / truth_density - np.log(truth_density)))
    assert abs(np.mean(gains) - nats) < 4 * np.std(gains) / np.sqrt(60) + 0.1 * nats


@pytest.mark.parametrize("alpha", [0.5, 1.5])
def test_power_law_noise_has_its_slope(alpha):
    cause = {"name": "power_law", "p": {"_size": 1.0, "_alpha": alpha}}
    paths = [outside.path(cause, 4096, np.random.default_rng(i)) * np.hanning(4096) for i in range(40)]
    f, power = np.fft.rfftfreq(4096)[5:400], np.mean([np.abs(np.fft.rfft(p)[5:400]) ** 2 for p in paths], 0)
    assert abs(np.polyfit(np.log(f), np.log(power), 1)[0] + alpha) < 0.1


def test_slow_noise_takes_a_ramp_but_not_a_repeated_anomaly(device, base):
    ramp = [3.0 * r.t_s / 100 for r in device.train]
    bump = [60 * np.exp(-0.5 * ((r.temp_degc - device.t0_degc) / 1.5) ** 2) for r in device.train]
    meter = gauge.Gauge(device, base.density)
    kept = [gauge.left_by_noise(device, base, s) / np.linalg.norm(meter.signature(s)) for s in (ramp, bump)]
    assert kept[0] < 0.75 < kept[1]


def test_the_same_seed_draws_the_same_case_and_another_index_another(tmp_path):
    spec = {**plan.spec_of("no_gap", 0, np.random.default_rng(1)), "kind": "no_gap", "seconds": 1500.0}
    first, again, other = (cases.build(7, i, spec) for i in (3, 3, 4))
    np.testing.assert_array_equal(first.series["gx_dph"][0], again.series["gx_dph"][0])
    assert first.series["gx_dph"][0].size != other.series["gx_dph"][0].size or not np.array_equal(
        first.series["gx_dph"][0], other.series["gx_dph"][0])


def test_logs_follow_the_contract_and_hide_the_cause(tmp_path):
    spec = {"kind": "memory", "names": ["thermal_lag"], "target": 20, "regimes": list(cases.REGIMES), "pool": list(causes.MEMORY),
            "seconds": 2500.0, "profile": "staircase"}
    case = cases.build(11, 0, spec)
    path = cases.write(case, str(tmp_path), "c1")
    logs = sorted(n for n in os.listdir(path) if n.endswith(".csv"))
    assert len(logs) == case.label["n_train"] + case.label["n_hold"]
    for name in os.listdir(path):
        with open(os.path.join(path, name), encoding="utf-8") as f:
            assert "lag" not in f.read()
    with open(os.path.join(path, logs[-1]), encoding="utf-8") as f:
        rows = [line for line in f.read().splitlines() if not line.startswith("#")]
    assert rows[0] == "t_s,temp_degc,gx_dph" and len(rows[1].split(",")) == 3
    asks = runner.asks_of(path)
    assert [runner.needs(asks[k]) for k in range(6)] == [None, None, None, None, "absent", "data_sheet"]
    wrong = json.load(open(os.path.join(path, "model1.json"), encoding="utf-8"))["markov"][0]
    assert np.isclose(wrong["sigma_dph"], 3 * case.base.markov[0][0], rtol=1e-3)


def test_seal_hides_opens_and_notices_changes(tmp_path):
    labels = {"seed": 1, "labels": [{"truth": ["thermal_hysteresis"]}]}
    digest = seal.seal(labels, str(tmp_path))
    hidden = (tmp_path / "labels.sealed").read_bytes()
    assert b"thermal" not in hidden and seal.unseal(str(tmp_path), digest) == labels
    (tmp_path / "labels.sealed").write_bytes(hidden[:-1] + bytes([hidden[-1] ^ 1]))
    with pytest.raises(ValueError, match="changed after sealing"):
        seal.unseal(str(tmp_path), digest)


def test_development_seeds_are_refused_elsewhere(tmp_path, capsys):
    from blind.command import main

    assert main(["dev", "--out", str(tmp_path), "--seed", "1000"]) == 2
    assert "development seeds are 0 to 999" in capsys.readouterr().err


# ---- scoring ----------------------------------------------------------------------------------------------

def answer(verdict, *effects, gap=None):
    """effects: name or (name, rivals)."""
    out = []
    for e in effects:
        name, rivals = e if isinstance(e, tuple) else (e, ())
        own = [] if score.is_family(name) else [{"name": name}]
        out.append({"name": name, "parameters": {}, "evidence_nats": 9, "set": own + [{"name": r} for r in rivals]})
    return {"status": 0, "cpu_s": 0.5, "diagnosis": {"axes": [{"axis": "gx_dph", "verdict": verdict, "effects": out, "gap": gap or {}}]}}


@pytest.mark.parametrize("said, tells, expected", [
    (("explained", "thermal_lag"), True, "member"), (("explained", ("thermal_memory", ["thermal_lag"])), False, "family_right"),
    (("explained", ("thermal_memory", ["thermal_lag"])), True, "family_though_tellable"),
    (("explained", ("thermal_hysteresis", ["thermal_lag"])), False, "family_right"), (("explained", "thermal_hysteresis"), False, "sibling"),
    (("explained", "warm_up", "thermal_lag"), True, "other_first"), (("explained", "warm_up"), False, "wrong"), (("no_gap",), True, "no_gap"),
    (("unexplained",), True, "abstains"), (("explained", "noise_parameters"), True, "noise_alone"),
    (("explained", "noise_parameters", "thermal_lag"), True, "member")])
def test_outcome_of_one_question(said, tells, expected):
    read = score.reading(answer(*said), "gx_dph", "times_3")
    assert score.outcome(read, "thermal_lag", {"can_tell_member": tells}) == expected


def test_retuned_noise_is_a_name_only_where_the_noise_was_known():
    said = answer("explained", "noise_parameters")
    assert score.reading(said, "gx_dph", "exact")["names"] == ["noise_parameters"]
    assert score.reading(said, "gx_dph", "fitted")["names"] == []


@pytest.mark.parametrize("said, families, expected", [
    (("unexplained",), ["slow_noise"], "abstains"), (("explained", ("slow_noise", ["flicker_noise"])), ["slow_noise"], "family_only"),
    (("explained", "flicker_noise"), ["slow_noise"], "misnamed"), (("partly_explained", "flicker_noise"), ["slow_noise"], "partly"),
    (("explained", ("thermal_memory", ["thermal_lag"])), ["slow_noise"], "misnamed"), (("no_gap",), [], "no_gap"),
    (("explained", "sinusoid"), ["tone"], "family_only")])
def test_outcome_of_an_outside_cause(said, families, expected):
    assert score.outside_outcome(score.reading(answer(*said), "gx_dph", "exact"), families, "x") == expected


def label(case, kind, names, regimes, d=20, **more):
    return {"case": case, "kind": kind, "truth": {"gx_dph": names}, "sick": ["gx_dph"] if names else [], "regimes": regimes, "target": d,
            "told": {"gx_dph": [{"can_tell_member": True, "can_tell_family": True}] * len(names)}, "n_axes": 1, "n_train": 4,
            "profile": "mixed", "causes": {"gx_dph": [{"name": n, "p": {}} for n in names]},
            "families": {"gx_dph": [[causes.FAMILY_OF.get(n)] for n in names]}, "beside": None,
            "noise": {"markov": [(20.0, 100.0)]}, **more}


def test_everything_is_counted():
    labels = {x["case"]: x for x in [
        label("a", "single", ["rate_ramp"], ["exact"]), label("b", "single", ["rate_ramp"], ["fitted"]),
        label("m", "memory", ["thermal_lag"], ["exact", "times_3", "over_3", "fitted"]),
        label("w", "memory", ["thermal_lag"], ["exact", "times_3", "over_3", "fitted"]),
        label("p", "pair", ["rate_ramp", "outliers"], ["exact"]), label("n", "no_gap", [], ["over_3"]), label("k", "no_gap", [], ["exact"])]}
    answers = {"a_0": answer("explained", "rate_ramp"), "b_0": answer("explained", "warm_up"), "p_0": answer("explained", "outliers", "rate_ramp"),
               "n_0": answer("explained", "noise_parameters"), "k_0": answer("explained", "noise_parameters")}
    answers.update({f"m_{k}": answer("explained", "thermal_lag") for k in range(4)})
    answers.update({f"w_{k}": answer("explained", ["thermal_lag", "thermal_hysteresis"][k % 2]) for k in range(4)})
    s = score.everything(labels, answers, redraw=False)
    assert s["single"]["by_strength"]["20"]["first"]["k"] == 1 and s["single"]["by_strength"]["20"]["sibling"] == 1
    assert s["pair"]["all"]["both"]["k"] == s["pair"]["all"]["exactly"]["k"] == 1
    table = s["false_names"]["table"]
    assert (table["over_3"]["names"]["k"], table["exact"]["names"]["k"]) == (0, 1)
    assert (s["invariance"]["same"]["k"], s["invariance"]["same"]["n"]) == (1, 2) and s["invariance"]["same_family"]["k"] == 2
    assert s["memory"]["by_regime"]["times_3"]["first"]["k"] == 1
    assert s["confusion"]["rate_ramp"] == {"rate_ramp": 1, "warm_up": 1}


def test_a_second_process_that_the_belief_leaves_out_is_counted_as_a_name_and_apart():
    two = {"noise": {"markov": [(20.0, 20.0), (10.0, 300.0)]}}
    said = {"known": "exact", "slow": "fitted", "wrong": "fitted", "memory": "absent"}
    labels = {case: label(case, "no_gap", [], [regime], **two) for case, regime in said.items()}
    labels["one"] = label("one", "no_gap", [], ["fitted"])
    slow = answer("explained", ("slow_noise", ["second_markov", "flicker_noise"]))
    answers = {"known_0": slow, "slow_0": slow, "one_0": slow, "wrong_0": answer("explained", "rate_random_walk"),
               "memory_0": answer("explained", ("thermal_memory", ["thermal_lag", "second_markov"]))}
    table = score.everything(labels, answers, redraw=False)["false_names"]["table"]
    held, left_out = table["noise that the belief can hold"], table["a second process left out of the belief"]
    assert (table["all"]["names"]["k"], table["all"]["there"], table["all"]["not_there"]["k"]) == (5, 1, 4)
    assert (held["names"]["n"], held["there"], left_out["names"]["n"], left_out["there"]) == (2, 0, 3, 1)
    for x in labels.values():  # the same beside a sick axis
        x["kind"] = "healthy"
    axes = score.everything(labels, answers, redraw=False)["axes"]
    assert (axes["healthy_false"]["k"], axes["healthy_false_held"]["k"], axes["healthy_false_held"]["n"], axes["healthy_there"]) == (5, 2, 2, 1)


def test_steps_of_a_thermometer_that_are_there_are_counted_apart():
    def said(lsb_degc, *more):
        out = answer("explained", "temperature_sensor_quantization", *more)
        out["diagnosis"]["axes"][0]["effects"][0]["parameters"] = {"lsb_degc": lsb_degc}
        return out

    steps = lambda d: {"lsb_degc": 0.5, "d_steps": {"gx_dph": d}}
    labels = {c: label(c, "no_gap", [], ["exact"], **steps(d)) for c, d in (("strong", 3.0), ("weak", 1.0), ("other", 3.0), ("beside", 3.0))}
    labels["old"] = label("old", "no_gap", [], ["exact"], lsb_degc=0.5)
    answers = {"strong_0": said(0.5), "weak_0": said(0.5), "other_0": said(0.25), "beside_0": said(0.5, "thermal_lag"), "old_0": said(0.5)}
    told = score.everything(labels, answers, redraw=False)["false_names"]["table"]["all"]
    assert (told["names"]["k"], told["there"], told["not_there"]["k"]) == (5, 1, 4)


def test_strength_of_steps_is_that_of_the_error_whitened_at_one_second(base):
    """Second way: the Kalman filter at one second, and the temperature before it was rounded."""
    rng = np.random.default_rng(8)
    device = sensor.draw_device(rng, 3, 0, "triangle", 3000.0, lsb_degc=0.5)  # its thermometer has a noise of 0.01 degC
    meter, bias = gauge.Gauge(device, base.density), BIAS * 0.5
    e = cases.thermometer_error(bias, device)
    columns = []
    for r, run in enumerate(device.train):
        x = device.x(run.shown_degc)
        own = np.eye(3)[r][None, :] * np.ones((run.n, 1))
        columns.append(np.column_stack([own, x, x**2, x**3, e[r]]))
    padded, keep = whiten.pad(columns)
    white, _ = whiten.kalman(padded, whiten.Noise(base.white_dph**2, [whiten.markov_part(*m) for m in base.markov]), keep)
    white = white.reshape(-1, white.shape[-1])
    q = gauge.basis(white[:, :6])
    exact = np.linalg.norm(white[:, 6] - q @ (q.T @ white[:, 6]))
    assert cases.strength_of_steps(bias, device, meter, base.white_dph) == pytest.approx(exact, rel=0.15)
    assert cases.strength_of_steps(2 * bias, device, meter, base.white_dph) == pytest.approx(2 * exact, rel=0.15)


@pytest.mark.parametrize("gap, true, expected", [
    ({"shrinkage": 0.9, "ci95": [0.8, 1.0], "unit": "deviance per hour"}, {"deviance": 0.85, "power": 0.1}, True),
    ({"shrinkage": 0.9, "ci95": [0.8, 1.0], "unit": "rms dph"}, {"deviance": 0.85, "rms": 0.1}, False),
    ({"shrinkage": 1.0, "ci95": [0.9, 1.0]}, {"no_gap": True, "deviance": 1.0}, False), ({"shrinkage": None}, {"deviance": 0.5}, True)])
def test_claimed_shrinkage_is_held_against_its_own_measure(gap, true, expected):
    assert score.covered(gap, {"no_gap": False, **true})[1] is expected


@pytest.mark.parametrize("name, profile", [("thermal_hysteresis", "staircase"), ("thermal_lag", "mixed"), ("warm_up", "up_down"),
                                           ("thermal_creep", "staircase"), ("rate_random_walk", "mixed"), ("sinusoid", "mixed")])
def test_true_reduction_is_near_one_for_the_truth_none_for_nothing_and_negative_for_the_wrong_sign(name, profile):
    spec = {"kind": "single", "names": [name], "target": 30, "regimes": ["exact"], "pool": [name], "seconds": 4000.0, "profile": profile}
    case = cases.build(21, 1, spec)
    cause = case.found["gx_dph"][0]
    claim = lambda c: [{"name": c["name"], "parameters": c["p"]}]
    right = truth.reduction(case, "gx_dph", claim(cause))["deviance"]
    assert right > 0.85
    assert truth.reduction(case, "gx_dph", [])["deviance"] == 0.0
    if name == "thermal_hysteresis":
        wrong = truth.reduction(case, "gx_dph", claim(causes.scaled(cause, -1.0)))
        assert wrong["deviance"] < -1 and wrong["rms_after_dph"] > 1.5 * wrong["rms_before_dph"]


def test_a_polynomial_is_scored_in_the_scale_in_which_it_is_told():
    """Without a model (T - 30 degC)/30 degC, not the scale of the device; what is left of lower orders any cubic takes."""
    case = cases.build(21, 1, {"kind": "single", "names": ["higher_order_polynomial"], "target": 30, "regimes": ["absent"],
                               "pool": ["higher_order_polynomial"], "seconds": 4000.0, "profile": "mixed"})
    device, p = case.device, case.found["gx_dph"][0]["p"]
    a, b = (30 - device.t0_degc) / device.range_degc, 30 / device.range_degc  # x = a + b u; Legendre: 35/8 x^4, 63/8 x^5
    told = {"p4_dph": b**4 * (p["p4_dph"] + 9 * a * p["p5_dph"]), "p5_dph": b**5 * p["p5_dph"]}
    score_of = lambda has_model: truth.reduction(case, "gx_dph", [{"name": "higher_order_polynomial", "parameters": told}], has_model)["deviance"]
    assert score_of(False) > 0.95 and score_of(True) < 0.8, (score_of(False), score_of(True), a, b)


def test_the_scorer_does_not_delay_the_thermometer():
    """Five seconds of it, counted as a lag of the answer, made right small lags false."""
    ramp = 20 + np.arange(4000) / 60
    assert np.abs(truth.smoothed(ramp) - ramp)[60:-60].max() < 1e-5
    noise = np.random.default_rng(5).standard_normal(4000)
    assert truth.smoothed(noise).std() < 0.4


def test_a_program_that_never_answers_is_stopped_by_its_cpu_time(tmp_path):
    answer = runner.run_one([sys.executable, "-c", "while True: pass"], str(tmp_path / "x"), str(tmp_path), 1)
    assert answer["status"] == -1 and "CPU" in answer["error"]


def test_intervals_are_the_exact_ones():
    lo, hi = intervals.clopper_pearson(0, 300)
    assert lo == 0 and np.isclose(hi, 1 - 0.025 ** (1 / 300))
    lo, hi = intervals.clopper_pearson(8, 10)
    assert np.isclose(lo, 0.4439045) and np.isclose(hi, 0.9747893)


STAND_IN = """#!{python}
import json, sys
a = sys.argv
if "fit" in a:
    json.dump({{"imucal_model": 1}}, open(a[a.index("-o") + 1], "w"))
    sys.exit(0)
if "--help" in a:
    print("--model")
    sys.exit(0)
effects = [{{"name": "rate_ramp", "parameters": {{"ramp_dph_per_h": 1.0}}, "evidence_nats": 5, "set": [{{"name": "rate_ramp"}}]}}]
axes = [{{"axis": "gx_dph", "verdict": "explained", "effects": effects, "where": None, "advice": [], "gap": {{"shrinkage": 1.0, "ci95": [0.9, 1.0]}}}}]
json.dump({{"axes": axes}}, open(a[a.index("--json") + 1], "w"))
"""


def test_whole_chain_with_a_stand_in_resumes_and_skips_loudly(tmp_path, capsys):
    """draw -> seal -> run -> open -> score with a program that always answers the same and knows no missing model."""
    from blind.command import main

    stand_in, out = tmp_path / "diagnose", tmp_path / "out"
    stand_in.write_text(STAND_IN.format(python=sys.executable))
    stand_in.chmod(0o755)
    line = ["check", "--diagnose", str(stand_in), "--errormodel", str(stand_in), "--out", str(out), "--cases", "12", "--gap-free", "6",
            "--seed", "3", "--seconds", "1500", "--processes", "2", "--kinds", "single,no_gap", "--keep-logs"]
    assert main(line) == 0
    first = json.loads((out / "blind.json").read_text())
    assert first["score"]["false_names"]["table"]["all"]["names"]["rate"] == 1.0
    rows = first["score"]["shrinkage"]["rows"]
    assert rows and not any(r["ok"] for r in rows if r["kind"] == "no_gap")
    before = {p.name: p.stat().st_mtime_ns for p in (out / "results").glob("*.answer")}
    victim = sorted((out / "results").glob("*.answer"))[0]
    victim.unlink()
    assert main([*line, "--resume"]) == 0
    after = {p.name: p.stat().st_mtime_ns for p in (out / "results").glob("*.answer")}
    assert set(before) == set(after) and [n for n in before if before[n] != after[n]] == [victim.name]
    again = json.loads((out / "blind.json").read_text())
    assert again["labels_sha256"] == first["labels_sha256"]
    if again["skipped"]:
        assert "SKIP" in capsys.readouterr().err
    assert "# Blind check" in (out / "blind.md").read_text()


def hypothesis(*names, score_nats=0.0, noise="", steps=0):
    return {"names": [{"name": n, "shape": []} for n in names], "noise": noise, "steps": steps, "score_nats": score_nats}


@pytest.mark.parametrize("searched,oracle,effects,dropped,expected", [
    (hypothesis("rate_ramp", score_nats=20), hypothesis("thermal_lag", score_nats=27), ["rate_ramp"], [], ("search", "7 nats over rate_ramp")),
    (hypothesis("rate_ramp", score_nats=20), hypothesis("thermal_lag", score_nats=15), ["rate_ramp"], [], ("evidence", "5.0 nats behind rate_ramp")),
    (hypothesis("thermal_lag", "warm_up"), hypothesis("thermal_lag"), ["warm_up"], ["thermal_lag"], ("rule", "held-out")),
    (hypothesis("thermal_lag"), hypothesis("thermal_lag"), [], [], ("rule", "stand-in")),
])
def test_a_confusion_is_laid_to_search_rule_or_evidence(searched, oracle, effects, dropped, expected):
    found = {"searched": searched, "kept": searched, "oracle": oracle, "dropped": [{"name": n} for n in dropped],
             "effects": [{"name": n, "member": n, "doubt": 0} for n in effects]}
    assert confusions.reason(found, ["thermal_lag"]) == expected
    assert confusions.reason(found, ["outliers"])[0] == "seconds"


def test_confusions_of_a_draw_that_judges_are_not_shown(tmp_path, capsys):
    seal.seal({"seed": 123456, "labels": []}, str(tmp_path / "labels"))
    from blind.command import main

    assert main(["confusions", "--out", str(tmp_path)]) == 2
    assert "judges" in capsys.readouterr().err
