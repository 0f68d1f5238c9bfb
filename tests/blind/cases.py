# SPDX-License-Identifier: MIT
"""Draws the cases of one group: effects at wanted strengths, two effects, unknown ones, gap-free ones."""
from __future__ import annotations

import os

import numpy as np

from . import oracle, simulate, strength, unknown
from .campaign import draw_bias
from .strength import Unreachable

STRENGTHS = (5, 10, 20, 40)
SINGLES = ("temperature_rate", "thermal_hysteresis", "thermal_lag", "thermal_anomaly", "higher_order_polynomial",
           "rate_ramp", "warm_up", "sinusoid", "bias_step", "run_to_run", "noise_parameters", "second_markov",
           "rate_random_walk", "flicker_noise", "white_noise_vs_temperature", "markov_sigma_vs_temperature",
           "markov_tau_vs_temperature", "outliers", "telegraph_noise")
PHYSICAL = {  # diagnosis.md section 6, "same physical effect everywhere"
    "temperature_rate": {"k_dph_per_degc_min": 15.0},
    "thermal_hysteresis": {"amplitude_dph": 20.0, "width_degc": 5.0},
    "thermal_lag": {"tau_s": 150.0},
}


def log_uniform(rng, a, b):
    return float(np.exp(rng.uniform(np.log(a), np.log(b))))


def draw_effect(name, rng, group):
    """An effect of random shape and unit size; sign at random where a sign makes sense."""
    sign = float(rng.choice([-1.0, 1.0]))
    lo = group.nominal.t0_degc - group.nominal.range_degc
    hi = group.nominal.t0_degc + group.nominal.range_degc
    n_runs = len(group.train) + len(group.hold)
    if name == "temperature_rate":
        p = {"k_dph_per_degc_min": sign}
    elif name == "thermal_hysteresis":
        p = {"amplitude_dph": sign, "width_degc": float(rng.uniform(1.5, 12))}
        if rng.random() < 0.5:  # a sensor need not have one single width
            p["_mixture"] = [[0.6, 0.8], [0.4, 1.3]]
    elif name == "thermal_lag":
        p = {"tau_s": 1.0}
    elif name == "thermal_anomaly":
        p = {"amplitude_dph": sign, "center_degc": float(rng.uniform(lo + 5, hi - 5)),
             "width_degc": log_uniform(rng, 1.0, 5.0)}
    elif name == "higher_order_polynomial":
        angle = rng.uniform(0, 2 * np.pi)
        p = {"p4_dph": float(np.cos(angle)), "p5_dph": float(np.sin(angle))}
    elif name == "rate_ramp":
        p = {"ramp_dph_per_h": sign}
    elif name == "warm_up":
        p = {"amplitude_dph": sign, "tau_s": log_uniform(rng, 100, 1200)}
    elif name == "sinusoid":
        p = {"amplitude_dph": 1.0, "frequency_hz": log_uniform(rng, 0.004, 0.45),
             "_phase": rng.uniform(0, 2 * np.pi, n_runs).tolist()}
    elif name == "bias_step":
        steps = []
        for _ in range(int(rng.integers(1, 3))):
            run = int(rng.integers(len(group.train)))
            t = float(int(rng.uniform(0.15, 0.85) * group.train[run].n))
            steps.append({"log": run, "t_s": t, "amplitude_dph": float(rng.choice([-1.0, 1.0]))})
        p = {"steps": steps}
    elif name == "run_to_run":
        p = {"sigma_dph": 1.0, "_draws": rng.standard_normal((n_runs, 2)).tolist()}
    elif name == "auxiliary_channel":
        p = {"channel": "supply_v", "gain": sign}
    elif name == "noise_parameters":
        direction = rng.standard_normal(3) * [0.4, 1.0, 1.0]
        p = simulate.mistuned({"_size": 0.5, "_direction": (direction / np.linalg.norm(direction)).tolist()}, group)
    elif name in ("second_markov", "telegraph_noise"):
        while True:  # a time constant of its own: at the nominal one it is the same model
            tau = log_uniform(rng, 4, 2000)
            if all(abs(np.log(tau / t)) > np.log(3) for _, t in group.nominal.markov):
                break
        p = {"sigma_dph" if name == "second_markov" else "amplitude_dph": 1.0, "tau_s": tau}
    elif name == "rate_random_walk":
        p = {"k_dph_per_rt_s": 1.0}
    elif name == "flicker_noise":
        p = {"b_dph": 1.0}
    elif name in ("white_noise_vs_temperature", "markov_sigma_vs_temperature", "markov_tau_vs_temperature"):
        p = {"slope": 0.5 * sign}
    elif name == "outliers":
        p = {"probability": log_uniform(rng, 5e-4, 0.02), "sigma_dph": 1.0}
    elif name == "unknown_function":
        p = {"_amplitude_dph": 1.0, **unknown.draw_function(rng)}
    elif name == "unknown_spectrum":
        p = {"_amplitude": 1.0, **unknown.draw_spectrum(rng)}
    elif name == "unknown_modulation":
        p = {"_amplitude": 0.5, "_of": str(rng.choice(["white", "markov"])), **unknown.draw_function(rng)}
    else:
        raise ValueError(name)
    return {"name": name, "parameters": p}


def draw_structural(name, rng, group, bias):
    """Deterministic marks of the output stage, sized so that they are there but do not rule the record."""
    white = group.nominal.white_dph
    if name == "quantization":
        return {"name": name, "parameters": {"lsb_dph": float(f"{rng.uniform(0.5, 3.0) * white:.3g}")}}
    if name == "held_samples":
        return {"name": name, "parameters": {"probability": log_uniform(rng, 0.005, 0.1)}}
    curve = np.concatenate([simulate.polynomial(bias, group.x(r.temp_degc)) for r in group.train])
    if name == "saturation":
        return {"name": name, "parameters": {"limit_dph": float(f"{np.quantile(np.abs(curve), rng.uniform(.9, .98)):.4g}")}}
    if name == "dead_band":
        return {"name": name, "parameters": {"width_dph": float(f"{rng.uniform(0.7, 2.5) * white:.3g}")}}
    raise ValueError(name)


class Case:
    """What is written (logs and model) and what is hidden (label)."""

    def __init__(self, group, case_id, kind, axes, label):
        self.group, self.case_id, self.kind, self.axes = group, case_id, kind, axes
        self.label = {"case": case_id, "kind": kind, "group": group.name, "family": group.family,
                      "noise_known": group.noise_known, **label}

    def write(self, folder):
        path = os.path.join(folder, self.case_id)
        os.makedirs(path, exist_ok=True)
        names = list(self.axes)
        for i, run in enumerate(self.group.train + self.group.hold):
            part = "train" if i < len(self.group.train) else "hold"
            aux = run.aux is not None
            columns = [run.t_s, run.shown_degc] + [self.axes[a][i] for a in names] + ([run.aux] if aux else [])
            table = np.stack(columns, 1)[run.keep]
            row = "%d,%.3f" + ",%.4f" * (table.shape[1] - 2)
            header = "t_s,temp_degc," + ",".join(names) + (",supply_v" if aux else "")
            with open(os.path.join(path, f"{part}{i}.csv"), "w", encoding="utf-8") as out:
                out.write(f"# imucal-log = 1\n# device = blind  serial = {self.case_id}  run = {part}{i}\n{header}\n")
                out.write("\n".join(row % tuple(v) for v in table.tolist()))
                out.write("\n")
        return path


def single(group, rng, name, target, case_id, kind="single"):
    """One effect at strength `target` on one axis; a few fresh shapes before it is called unreachable."""
    for _ in range(6):
        bias = draw_bias(rng, group)
        effect = draw_effect(name, rng, group)
        try:
            effect, d = strength.to_strength(group, effect, target, bias, int(rng.integers(2**31)))
            break
        except Unreachable:
            continue
    else:
        raise Unreachable(f"{name} at d={target} on {group.name}")
    label = {"effects": [effect], "d": [d], "target": target}
    if name in simulate.MEAN and name not in ("run_to_run", "sinusoid", "bias_step"):
        rival, rho2 = strength.most_confusable(group, effect, bias)
        label.update(rival=rival, rho2=rho2, separable=bool(d * np.sqrt(1 - rho2) >= 4))
    return finish(group, rng, {"gx_dph": (bias, [effect])}, case_id, kind, label)


def finish(group, rng, axes, case_id, kind, label, rotated=None):
    """Simulates, and works out what the true model is worth on the held-out runs."""
    series, gains = {}, {}
    for axis, (bias, effects) in axes.items():
        series[axis] = simulate.simulate_axis(group, bias, effects, rng, rotated=rotated and rotated[axis])
        gains[axis] = oracle.held_out_gain(group, effects, bias, series[axis])
    label = {**label, "bias_dph": {a: list(map(float, b)) for a, (b, _) in axes.items()}, "oracle": gains}
    return Case(group, case_id, kind, series, label)


def structural(group, rng, name, case_id):
    """Quantised, clipped, dead or held readings; dead bands need a reading that passes through zero."""
    bias = draw_bias(rng, group)
    if name == "dead_band":
        bias[0] = 0.0
    effect = draw_structural(name, rng, group, bias)
    series = simulate.simulate_axis(group, bias, [effect], rng, 20.0)
    label = {"effects": [effect], "d": [None], "target": None, "bias_dph": {"gx_dph": list(map(float, bias))},
             "oracle": {"gx_dph": None}}
    return Case(group, case_id, "structural", {"gx_dph": series}, label)


def pair(group, rng, names, target, case_id):
    """Two effects, each of strength `target` given the other."""
    for _ in range(6):
        bias = draw_bias(rng, group)
        first, second = (draw_effect(n, rng, group) for n in names)
        try:
            result = _pair_strengths(group, rng, first, second, target, bias)
        except Unreachable:
            continue
        if min(result[1]) < 0.8 * target:
            continue
        label = {"effects": result[0], "d": result[1], "target": target}
        return finish(group, rng, {"gx_dph": (bias, result[0])}, case_id, "pair", label)
    raise Unreachable(f"{names} at d={target} on {group.name}")


def _pair_strengths(group, rng, first, second, target, bias):
    mean = [e["name"] in simulate.MEAN for e in (first, second)]
    seed = int(rng.integers(2**31))
    if all(mean):
        for _ in range(3):  # thermal lag is not linear in its size: repeat
            first, d1 = strength.to_strength(group, first, target, bias, seed, against=[second])
            second, d2 = strength.to_strength(group, second, target, bias, seed, against=[first])
        d1 = strength.mean_strength(group, first, bias, against=[second])
        return [first, second], [d1, d2]
    if any(mean):
        noisy, steady = (second, first) if mean[0] else (first, second)
        noisy, d_noisy = strength.to_strength(group, noisy, target, bias, seed)
        from .whiten import Whitener

        model = strength.noise_model(group, group.train, [noisy])
        if noisy["name"] == "outliers":
            model.r = model.r + noisy["parameters"]["probability"] * min(noisy["parameters"]["sigma_dph"],
                                                                         3 * group.nominal.white_dph) ** 2
        whitener = Whitener(group, group.train, model)
        if steady["name"] == "run_to_run":
            raise Unreachable("run_to_run is drawn alone")
        steady, d_steady = strength.to_strength(group, steady, target, bias, seed, whitener)
        return ([steady, noisy], [d_steady, d_noisy]) if mean[0] else ([noisy, steady], [d_noisy, d_steady])
    first, _ = strength.to_strength(group, first, target, bias, seed)
    second, d2 = strength.to_strength(group, second, target, bias, seed, others=[first])
    d1 = float(strength.noise_strengths(group, first, [1.0], seed, 3, others=[second])[0])
    return [first, second], [d1, d2]


def unknown_case(group, rng, name, target, case_id):
    """An effect outside the library, with how much of it the nearest library effect leaves over."""
    case = single(group, rng, name, target, case_id, "unknown")
    label = case.label
    if name == "unknown_function":
        label["d_left"] = label["d"][0] * float(np.sqrt(1 - label["rho2"]))
    else:
        left = strength.library_noise_left(group, label["effects"][0])
        label["d_left"] = left * label["d"][0] if name == "unknown_modulation" else left
        label["rival"], label["separable"] = "library noise", bool(label["d_left"] >= 4)
    return case


def gap_free(group, rng, case_id):
    bias = draw_bias(rng, group)
    axes = {"gx_dph": simulate.simulate_axis(group, bias, [], rng)}
    return Case(group, case_id, "no_gap", axes, {"effects": [], "d": [], "target": 0,
                                                "bias_dph": {"gx_dph": list(map(float, bias))}, "oracle": None})


def physical(group, rng, name, case_id, kind):
    """The same physical effect on any profile (diagnosis.md section 6)."""
    bias = np.array([80.0, 300.0, 150.0, -100.0])
    effect = {"name": name, "parameters": dict(PHYSICAL[name])}
    d = strength.mean_strength(group, effect, bias)
    rival, rho2 = strength.most_confusable(group, effect, bias)
    label = {"effects": [effect], "d": [d], "target": None, "rival": rival, "rho2": rho2,
             "separable": bool(d * np.sqrt(1 - rho2) >= 4)}
    return finish(group, rng, {"gx_dph": (bias, [effect])}, case_id, kind, label)


def multi_axis(group, rng, name, target, case_id, n_axes=3):
    """The same cause on every axis, each with its own polynomial, sign and noise."""
    shape, axes, strengths = None, {}, []
    for axis in ("gx_dph", "gy_dph", "gz_dph")[:n_axes]:
        bias = draw_bias(rng, group)
        fresh = draw_effect(name, rng, group)
        if shape is not None:  # time constants and widths are of the sensor, not of the axis
            keys = simulate.AMPLITUDE[name]
            fresh["parameters"] = {**shape, **{k: fresh["parameters"][k] for k in keys}}
        shape = dict(fresh["parameters"])
        effect, d = strength.to_strength(group, fresh, target, bias, int(rng.integers(2**31)))
        axes[axis] = (bias, [effect])
        strengths.append(d)
    label = {"effects": axes["gx_dph"][1], "d": [float(np.mean(strengths))], "target": target,
             "effects_by_axis": {a: e for a, (_, e) in axes.items()}}
    return finish(group, rng, axes, case_id, "multi_axis", label)


def common_mode(group, rng, case_id):
    """Noise that two axes share while each alone is nominal: correlation rho of everything."""
    rho = float(rng.choice([-1, 1]) * rng.uniform(0.06, 0.3))
    names = ("gx_dph", "gy_dph")
    base = [[simulate.nominal_series(group, r, rng) for r in group.train + group.hold] for _ in range(2)]
    mixed = [rho * a + np.sqrt(1 - rho**2) * b for a, b in zip(base[0], base[1])]
    series = {}
    for name, noise in zip(names, (base[0], mixed)):
        series[name] = simulate.simulate_axis(group, draw_bias(rng, group), [], rng, rotated=noise)
    n = sum(r.n for r in group.train)
    effect = {"name": "common_mode", "parameters": {"correlation": rho, "sigma_dph": group.nominal.white_dph}}
    return Case(group, case_id, "between_axes", series,
                {"effects": [effect], "d": [float(np.sqrt(-n * np.log(1 - rho**2)))], "target": None,
                 "bias_dph": {}, "oracle": None})


def thermometer(group, rng, target, case_id):
    """Coarse thermometer: its step is the group's, the slope of B(T) sets the strength."""
    effect = {"name": "temperature_sensor_quantization", "parameters": {"lsb_degc": group.lsb_degc}}
    bias = draw_bias(rng, group)
    bias[1:] *= target / strength.mean_strength(group, effect, bias)
    rival, rho2 = strength.most_confusable(group, effect, bias)
    label = {"effects": [effect], "d": [float(target)], "target": target, "rival": rival, "rho2": rho2,
             "separable": bool(target * np.sqrt(1 - rho2) >= 4)}
    return finish(group, rng, {"gx_dph": (bias, [effect])}, case_id, "single", label)
