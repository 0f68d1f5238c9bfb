# SPDX-License-Identifier: MIT
"""Something happens in the held-out log alone: what does `diagnose` say?

Written from physics by somebody who read neither the engine of `diagnose` nor the blind check, only its documents, its help and its
results. The simulator below is its own (numpy), not the project's. A campaign of 256 questions with other seeds came before it and
showed faults; the seeds here are new, and the limits were chosen before the first run of this file.

First run: 8 passed, 3 failed (a jump beside a jump at a temperature was not listed; jumps were listed in two loud logs without any; an
"explained" beside 2.7 times the noise, which its author then let pass and the maintainers did not). The program was mended on the
campaign, not on this file; since then all pass.

Five devices: play (hysteresis), thermal lag, warm-up, a jump at a temperature, and none. Three fitted logs each, one held out, of 100 to
180 minutes, over -10 to 60 degC; the believed noise is the true one. Into the held-out log alone goes one of: a jump of 120 to 200 dph
("jump"); a jump and its return 8 to 25 minutes later ("pulse"); noise twice as strong ("loud"); a drift or a bump of 108 to 180 dph
("drift"); clipping ("clip"); 60 s that are not refreshed ("held"); nothing ("none"). 25 questions.

Limits: the cause of the fitted logs stays named (as itself or within its set) whatever the held-out log does, at least 15 of 16; no other
repeatable cause is named, none of 25; every jump is listed with its log, its time within 60 s and its size within 30 %; nothing is listed as
a jump where there is none; no disturbance passes in silence ("nothing detectable", "no gap", "explained");
a figure of shrinkage never exceeds by more than 0.12 what the true cause, taken away entirely, would remove without the disturbance.
"""
import numpy as np
import pytest

from asking import DIAGNOSE, axis_told, model_of, model_option, write_log
from asking import with_members as names

SEED = 60417
CAUSES = {"play": "thermal_hysteresis", "lag": "thermal_lag", "warm": "warm_up", "switch": "thermal_step", "none": None}
QUESTIONS = [(c, k) for c in CAUSES for k in ("jump", "pulse", "loud", "drift")] + [
    ("play", "none"), ("lag", "none"), ("none", "none"), ("switch", "clip"), ("warm", "held")]
REPEATABLE = {"temperature_rate", "thermal_creep", "thermal_hysteresis", "thermal_lag", "higher_order_polynomial", "rate_ramp", "warm_up",
              "temperature_sensor_quantization", "thermal_anomaly", "thermal_step", "run_to_run", "sinusoid", "bias_step",
              "thermal_memory", "function_of_temperature", "function_of_time"}


def low_pass(x, tau_s, start):
    """first-order low-pass of x (n,) at 1 Hz"""
    a, state, y = np.exp(-1 / tau_s), start, np.empty(len(x))
    for k, value in enumerate(x):
        state = a * state + (1 - a) * value
        y[k] = state
    return y


def temperature(rng, hot):
    """temperature (n,) of a device in a chamber that overshoots: to the other end of the range and back, with soaks"""
    low, high = -10 + rng.uniform(0, 3), 60 - rng.uniform(0, 3)
    first, last = (high, low) if hot else (low, high)
    middle, rates = rng.uniform(15, 35), rng.uniform(1.1, 2.0, 2)
    t, v = [0.0], [first]
    for to, rate, soak in ((first, 1, rng.uniform(400, 1000)), (middle, rates[0], rng.uniform(0, 800)),
                           (last, rates[0], rng.uniform(400, 1000)), (first, rates[1], rng.uniform(400, 1000))):
        t += [t[-1] + abs(to - v[-1]) / rate * 60 + 1e-6, t[-1] + abs(to - v[-1]) / rate * 60 + soak]
        v += [to, to]
    wanted = np.interp(np.arange(int(np.clip(t[-1], 6000, 10800))), t, v)
    damping, w = rng.uniform(.5, .75), 1 / rng.uniform(60, 120)
    x, speed, air = wanted[0], 0.0, np.empty(len(wanted))
    for k, value in enumerate(wanted):
        speed += w * w * (value - x) - 2 * damping * w * speed
        x += speed
        air[k] = x
    return low_pass(air, rng.uniform(60, 180), air[0])


def polynomial(d, temp):
    x = (temp - 25) / 35
    return d["c"][0] + d["c"][1] * x + d["c"][2] * x**2 + d["c"][3] * x**3


def device(rng, cause):
    sign = rng.choice([-1, 1], 4)
    return {"cause": cause, "arw": rng.uniform(.4, .8), "sigma": rng.uniform(10, 24), "tau": rng.uniform(60, 200),
            "c": [rng.uniform(-400, 400), sign[0] * rng.uniform(250, 500), sign[1] * rng.uniform(80, 200), sign[2] * rng.uniform(60, 150)],
            "a": sign[3] * {"play": rng.uniform(70, 120), "warm": rng.uniform(220, 350)}.get(cause, rng.uniform(100, 160)),
            "r": rng.uniform(3, 9), "lag": rng.uniform(220, 450), "settle": rng.uniform(400, 900),
            "at": rng.uniform(10, 40), "width": rng.uniform(0, 4)}


def effect(rng, d, temp):
    """what the cause adds (n,), from a random state of its memory"""
    if d["cause"] == "lag":
        return polynomial(d, low_pass(temp, d["lag"], temp[0] + rng.normal(0, 5))) - polynomial(d, temp)
    if d["cause"] == "warm":
        return d["a"] * rng.uniform(.95, 1.05) * np.exp(-np.arange(len(temp)) / d["settle"])
    y = np.zeros(len(temp))
    if d["cause"] == "play":
        state = temp[0] + rng.uniform(-d["r"], d["r"])
        for k, value in enumerate(temp):
            state = min(max(state, value - d["r"]), value + d["r"])
            y[k] = d["a"] * (state - value) / d["r"]
    if d["cause"] == "switch":
        on = temp[0] > d["at"] - rng.uniform(0, d["width"])
        for k, value in enumerate(temp):
            on = value > d["at"] or (on and value >= d["at"] - d["width"])
            y[k] = d["a"] * on
    return y


def run(rng, d, hot):
    temp = temperature(rng, hot)
    n, phi = len(temp), np.exp(-1 / d["tau"])
    slow, state = np.empty(n), rng.normal(0, d["sigma"])
    for k, kick in enumerate(rng.normal(0, d["sigma"] * np.sqrt(1 - phi**2), n)):
        slow[k] = state
        state = phi * state + kick
    return {"temp": temp, "seen": temp + rng.normal(0, .02, n), "bias": polynomial(d, temp) + rng.normal(0, 50),
            "effect": effect(rng, d, temp), "noise": slow + rng.normal(0, 60 * d["arw"], n)}


def disturb(rng, kind, log):
    """rates (n,) of the held-out log, and what was done to them"""
    rate = log["bias"] + log["effect"] + log["noise"]
    n, t, size = len(rate), np.arange(len(rate)), rng.choice([-1, 1]) * rng.uniform(120, 200)
    at = int(rng.uniform(.25, .75) * n)
    if kind == "jump":
        rate = rate + size * (t >= at)
    if kind == "pulse":
        back = at + int(rng.uniform(480, 1500))
        rate = rate + size * ((t >= at) & (t < back))
    if kind == "loud":
        rate = rate + log["noise"]
    if kind == "drift":
        size *= .9
        rate = rate + (size * t / n if rng.uniform() < .5 else size * np.exp(-.5 * ((t - at) / rng.uniform(400, 900))**2))
    if kind == "clip":
        limit = np.quantile(np.abs(rate), rng.uniform(.93, .98))
        rate = np.clip(rate, -limit, limit)
    if kind == "held":
        rate[at:at + 60] = rate[at]
    return rate, {"t_s": at + 1, "size_dph": size}


def minutes(x):
    x = x[:len(x) // 60 * 60].reshape(-1, 60).mean(axis=1)
    return x - x.mean()


def true_shrinkage(fitted, held):
    """part of the held-out mean square beyond noise that goes when the cause is taken away, without any disturbance"""
    power = np.vander((np.concatenate([x["temp"] for x in fitted]) - 25) / 35, 4)[:, :3]
    columns = np.hstack([power, np.repeat(np.eye(len(fitted)), [len(x["temp"]) for x in fitted], axis=0)])

    def left(share):
        y = np.concatenate([x["bias"] + x["noise"] + share * x["effect"] for x in fitted])
        b = np.linalg.lstsq(columns, y, rcond=None)[0][:3]
        y = held["bias"] + held["noise"] + share * held["effect"] - np.vander((held["temp"] - 25) / 35, 4)[:, :3] @ b
        return np.mean(minutes(y)**2)
    noise = np.mean(minutes(held["noise"])**2)
    return 1 - max(left(0) - noise, 0) / max(left(1) - noise, 1e-9)


def write(path, log, rate):
    return write_log(path, np.arange(1, len(rate) + 1), log["seen"], rate)


def ask(folder, place, cause, kinds):
    rng = np.random.default_rng([SEED, place])
    d = device(rng, cause)
    fitted = [run(rng, d, (k + place) % 2 == 1) for k in range(3)]
    held = run(rng, d, rng.uniform() < .5)
    logs = [write(folder / f"{cause}{k}.csv", log, log["bias"] + log["effect"] + log["noise"]) for k, log in enumerate(fitted)]
    model = {**model_of(1, (d["sigma"], d["tau"]), t0_degc=25, range_degc=35), "arw_deg_rt_h": d["arw"]}
    believed = model_option(folder / f"{cause}.json", model)
    for kind in kinds:
        rate, done = disturb(np.random.default_rng([SEED, place, sum(map(ord, kind))]), kind, held)
        path = write(folder / f"{cause}_{kind}.csv", held, rate)
        axis = axis_told(DIAGNOSE, believed, logs, [path], timeout_s=60, cache=folder / "cache")
        yield kind, done, axis, true_shrinkage(fitted, held)


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """{(cause, kind): (what was done, the axis of the answer, true shrinkage)}"""
    folder = tmp_path_factory.mktemp("held_out")
    return {(cause, kind): (done, axis, truth) for place, cause in enumerate(CAUSES)
            for kind, done, axis, truth in ask(folder, place, cause, [k for c, k in QUESTIONS if c == cause])}


def said(axis):
    return f"{axis['verdict']}: {axis['statement']}; left: {axis['gap']['remainder']}; notes: {axis['notes']}"


def test_the_cause_of_the_fitted_logs_stays_named(answers):
    asked = {q: a for q, a in answers.items() if q[0] != "none" and q[1] in ("jump", "pulse", "loud", "drift")}
    lost = [f"{q}: {said(axis)}" for q, (_, axis, _) in asked.items() if CAUSES[q[0]] not in names(axis)]
    assert len(asked) == 16 and len(lost) <= 1, "\n".join(lost)


def test_no_other_repeatable_cause_is_named(answers):
    wrong = []
    for q, (_, axis, _) in answers.items():
        for e in axis["effects"]:
            if e["name"] in REPEATABLE and CAUSES[q[0]] not in {e["name"]} | {s["name"] for s in e["set"]}:
                wrong.append(f"{q}: {e['name']}")
    assert not wrong, "\n".join(wrong)


def test_a_jump_of_the_held_out_log_is_listed(answers):
    missed = []
    for q, (done, axis, _) in answers.items():
        jumps = axis["gap"]["jumps_of_held_out_logs"]
        if q[1] == "jump" and not any(j["log"] == 0 and abs(j["t_s"] - done["t_s"]) <= 60 and
                                      abs(j["size_dph"] - done["size_dph"]) <= .3 * abs(done["size_dph"]) for j in jumps):
            missed.append(f"{q}: {done} but {jumps}; {said(axis)}")
    assert not missed, "\n".join(missed)


def test_nothing_is_called_a_jump_where_there_is_none(answers):
    wrong = [f"{q}: {axis['gap']['jumps_of_held_out_logs']}" for q, (_, axis, _) in answers.items()
             if q[1] not in ("jump", "pulse") and axis["gap"]["jumps_of_held_out_logs"]]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("kind", ["jump", "pulse", "loud", "drift"])
def test_a_disturbance_is_not_passed_over_in_silence(answers, kind):
    silent = [f"{q}: {said(axis)}" for q, (_, axis, _) in answers.items() if q[1] == kind and
              (axis["verdict"] in ("no_gap", "explained") or axis["gap"]["remainder"].startswith("nothing detectable"))]
    assert not silent, "\n".join(silent)


def test_what_the_recorder_did_is_named(answers):
    assert "saturation" in names(answers["switch", "clip"][1])
    assert "held_samples" in names(answers["warm", "held"][1])


def test_an_undisturbed_log_makes_no_news(answers):
    for cause in ("play", "lag", "none"):
        axis = answers[cause, "none"][1]
        assert axis["verdict"] == ("no_gap" if cause == "none" else "explained"), said(axis)
        assert axis["gap"]["remainder"].startswith("nothing detectable") and not axis["notes"], said(axis)


def test_no_more_is_claimed_than_the_cause_can_remove(answers):
    wrong = []
    for q, (_, axis, truth) in answers.items():
        claim = axis["gap"]["shrinkage"]
        if claim is not None and (q[0] == "none" or claim > truth + .12):
            wrong.append(f"{q}: {claim:.2f}, true {truth:.2f}")
    assert not wrong, "\n".join(wrong)
