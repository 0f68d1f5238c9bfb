# SPDX-License-Identifier: MIT
"""One case: device, cause, strength, axes, logs.  Drawn from (seed, index) alone, so that it can be drawn again."""
from __future__ import annotations

import json
import os
from dataclasses import dataclass, field

import numpy as np

from . import causes, gauge, noise, outside, sensor
from .gauge import Gauge, Unreachable

AXES = ("gx_dph", "gy_dph", "gz_dph", "hx_dph", "hy_dph", "hz_dph")
LARGEST = {"temperature_rate": 800, "thermal_hysteresis": 1500, "thermal_lag": 1500, "thermal_creep": 300, "thermal_anomaly": 1500,
           "thermal_step": 1500, "higher_order_polynomial": 1500, "rate_ramp": 4000, "warm_up": 4000, "sinusoid": 400,
           "bias_step": 1500, "run_to_run": 600, "auxiliary_channel": 8000, "second_markov": 600, "telegraph_noise": 600,
           "rate_random_walk": 40, "flicker_noise": 300, "white_noise_vs_temperature": 3, "markov_sigma_vs_temperature": 4,
           "markov_tau_vs_temperature": 2.5, "outliers": 8000, "noise_parameters": 1.6}
NUISANCE_D = 1.0  # what a coarse or displaced thermometer may add to a case that is about something else
REGIMES = ("exact", "times_3", "over_3", "fitted", "absent", "data_sheet")


@dataclass
class Case:
    """Everything of one case; `label` is what is hidden."""

    spec: dict
    device: sensor.Device
    base: noise.Noise
    bias: dict  # axis -> coefficients
    found: dict  # axis -> list of causes
    series: dict = field(default_factory=dict)  # axis -> list of runs
    label: dict = field(default_factory=dict)
    cross: float = 0.0


# ---- strength of any cause -------------------------------------------------------------------------------

def signature(cause, device, r, bias):
    if cause["name"] in outside.SIGNALS:
        return outside.signature(cause, device, r)
    return causes.signature(cause, device, r, bias)


def is_signal(cause):
    return cause["name"] in causes.MEAN or cause["name"] in outside.SIGNALS


def training_signals(cause, device, bias):
    return [signature(cause, device, r, bias) for r in range(len(device.train))]


def seconds(device):
    return [r.n for r in device.train]


def strength(cause, device, base, bias, meter):
    """d of a cause; `meter` is the Gauge of the true noise."""
    name, p, total = cause["name"], cause["p"], float(sum(seconds(device)))
    if name == "sinusoid":
        return gauge.of_tone(p["amplitude_dph"], p["frequency_hz"], base, total)
    if name == "drifting_tone":
        return gauge.of_tone(p["_size"], abs(p["_f_hz"]), base, total)
    if name == "run_to_run":
        return gauge.of_run_to_run(meter, p["sigma_dph"])
    if name == "outliers":
        return gauge.of_outliers(p, base.white_dph, total)
    if name == "bursts":
        return gauge.of_bursts(p, base.white_dph, total)
    if is_signal(cause):
        return float(np.linalg.norm(meter.signature(training_signals(cause, device, bias))))
    f, weight = noise.grid(seconds(device))
    truth = (base.density(f) + outside.density(cause)(f))[None] if name in outside.NOISES else gauge.local_density(cause, device, base, f)
    return float(np.sqrt(2 * noise.divergence(truth, base.density(f)[None], weight[None] / truth.shape[0])))


def to_strength(cause, target, device, base, bias, meter):
    """The cause at the size whose strength is `target`."""
    name = cause["name"]
    linear = is_signal(cause) and name not in ("thermal_lag", "run_to_run")
    if linear:
        now = strength(cause, device, base, bias, meter)
        if now < 1e-6:
            raise Unreachable(f"{name} leaves no mark here")
        factor = target / now
    else:
        of = lambda size: strength(causes.scaled(cause, size), device, base, bias, meter)
        low = {"thermal_lag": 2.0, "outliers": 0.5 * base.white_dph}.get(name, 1e-3)
        factor = gauge.solve_size(of, target, low, LARGEST.get(name, 100 * base.white_dph))
    if factor > LARGEST.get(name, np.inf):
        raise Unreachable(f"{name} would have size {factor:g}")
    return causes.scaled(cause, factor)


def told_apart(cause, d, device, base, bias, meter):
    """What of the cause no other explanation takes: label entries rho2_*, d_noise, can_tell_*; d_library of outside causes."""
    name = cause["name"]
    out = {"rho2_sibling": 0.0, "sibling": "none", "rho2_other": 0.0, "other": "none", "d_noise": d}
    if name in causes.REPEATABLE or name in outside.SIGNALS and name != "drifting_tone":
        signals = training_signals(cause, device, bias)
        near = gauge.nearest(meter, meter.signature(signals), bias, name)
        for kind in ("sibling", "other"):
            out[kind], out["rho2_" + kind] = near[kind]
        out["d_noise"] = min(d, gauge.left_by_noise(device, base, signals, meter.known))
        if name in outside.SIGNALS:
            out["d_library"] = min(out["d_noise"], gauge.left_by_library_noise(device, base, signals, meter.known))
    elif name in causes.SLOW + ("white_noise_vs_temperature", "noise_parameters") or name in outside.NOISES and name != "bursts":
        told_apart_noise(cause, d, device, base, out)
    elif name == "bursts":
        out["d_library"] = min(d, gauge.left_by_outliers(cause["p"], base.white_dph, float(sum(seconds(device)))))
    out["can_tell_member"] = bool(d * np.sqrt(1 - max(out["rho2_sibling"], out["rho2_other"])) >= gauge.TELL)
    taken = d if name in causes.SLOW + ("noise_parameters",) else out["d_noise"]  # re-tuned noise is of the family of slow noise itself
    out["can_tell_family"] = bool(d * np.sqrt(1 - out["rho2_other"]) >= gauge.TELL and taken >= gauge.TELL)
    if name in outside.KINDS:  # of which library members are no family
        out.setdefault("d_library", d)
        out["can_tell_library"] = bool(d * np.sqrt(1 - out["rho2_other"]) >= gauge.TELL and out["d_library"] >= gauge.TELL)
    return out


def told_apart_noise(cause, d, device, base, out):
    """The same for noise: nearest other noise of the library, re-tuned nominal noise among them."""
    name = cause["name"]
    f, weight = noise.grid(seconds(device))
    extra = outside.density(cause) if name in outside.NOISES else None
    truth = (base.density(f) + extra(f))[None] if extra else gauge.local_density(cause, device, base, f)
    out["d_noise"] = min(d, gauge.of_density(truth, f, weight, base))
    if name == "white_noise_vs_temperature":
        return
    if name == "noise_parameters":  # contained in every richer noise: the simplest name is right
        return
    left = {"noise_parameters": out["d_noise"]}
    left.update({k: gauge.of_density(truth, f, weight, base, k) for k in noise.FAMILY_FITS if k not in ("nominal", name)})
    if name == "telegraph_noise":
        left["second_markov"] = 0.0  # the same spectrum
    out["sibling"] = min(left, key=left.get)
    if extra:
        out["d_library"] = min(d, left[out["sibling"]])
    out["rho2_sibling"] = float(1 - min(left[out["sibling"]] / d, 1) ** 2)


# ---- building --------------------------------------------------------------------------------------------

def thermometer_error(bias, device):
    """What the shown temperature misses of B(T) [dph], per training run."""
    return [causes.polynomial(bias, device.x(r.temp_degc)) - causes.polynomial(bias, device.x(r.shown_degc)) for r in device.train]


def coarse_thermometer(spec, case, axis, rng, meter):
    """The thermometer's step as the cause: the slope of B(T) gives it the wanted strength."""
    bias = rng.standard_normal(4) * [100.0, 300.0, 150.0, 100.0]
    d = float(np.linalg.norm(meter.signature(thermometer_error(bias, case.device))))
    bias[1:] *= spec["target"] / max(d, 1e-9)
    if np.abs(bias).max() > 20000:
        raise Unreachable("the thermometer is too fine")
    case.bias[axis] = bias
    found = {"name": "temperature_sensor_quantization", "p": {"lsb_degc": case.device.lsb_degc}}
    near = gauge.nearest(meter, meter.signature(thermometer_error(bias, case.device)), bias, found["name"])
    told = {k: v for kind in near for k, v in ((kind, near[kind][0]), ("rho2_" + kind, near[kind][1]))}
    can = lambda rho2: bool(spec["target"] * np.sqrt(1 - rho2) >= gauge.TELL)
    told.update(d_noise=spec["target"], can_tell_member=can(max(told["rho2_sibling"], told["rho2_other"])), can_tell_family=can(told["rho2_other"]))
    return [found], [float(spec["target"])], [told]


def strength_of_steps(bias, device, meter, white_dph):
    """d of the steps of the thermometer, to who knows the temperature between them: block means, and what is faster against white noise.

    `draw_bias` keeps the means small and the variance of what is faster, not this.  Noise of the thermometer has its share of the
    error by its variance."""
    if device.profile == "constant":
        return 0.0
    error, step_degc = thermometer_error(bias, device), device.lsb_degc / np.sqrt(12)
    d = np.hypot(np.linalg.norm(meter.signature(error)), np.linalg.norm(faster(error)) / white_dph)
    return float(d * step_degc / np.hypot(step_degc, device.note["meter"]["noise_degc"]))


def faster(error):
    return np.concatenate([e - sensor.low_pass(e, gauge.BLOCK_S) for e in error])


def draw_bias(rng, device, meter, white_dph):
    """Thermal polynomial; made flatter where the thermometer would otherwise be the gap."""
    bias = rng.standard_normal(4) * [100.0, 300.0, 150.0, 100.0]
    if device.profile == "constant":
        return bias * [1, 0, 0, 0]
    error = thermometer_error(bias, device)
    slow = float(np.linalg.norm(meter.signature(error)))
    fast = faster(error)
    inflation = np.sqrt(fast.size / 2) * np.mean(fast**2) / white_dph**2  # d of a white variance that grew by this
    bias[1:] *= min(1.0, NUISANCE_D / max(slow, 1e-9), np.sqrt(NUISANCE_D / max(inflation, 1e-9)))
    return bias


def draw_counts(rng, name, spec):
    """Numbers of training and held-out runs."""
    n = int(rng.choice([1, 2, 3, 4, 5, 6], p=[0.12, 0.13, 0.2, 0.35, 0.1, 0.1]))
    if name == "run_to_run":
        n = max(n, 4)
    if spec["kind"] == "memory":
        n = int(rng.choice([1, 2, 3, 4, 6], p=[0.1, 0.2, 0.2, 0.4, 0.1]))
    if spec["kind"] == "constant":
        n = 2
    hold = 2 if rng.random() < 0.65 else 0
    return n, hold


def cause_of(name, rng, device):
    return outside.draw(name, rng, device) if name in outside.KINDS else causes.draw(name, rng, device)


def place(spec, rng):
    """Device, noise, sick axes and their causes; strengths go into the label."""
    names = spec.get("names", [])
    n_train, n_hold = draw_counts(rng, names[0] if names else "", spec)
    n_axes = spec.get("axes", 1)
    if n_axes > 1:  # six axes of six long runs would cost minutes
        n_train, n_hold = min(n_train, 3), min(n_hold, 1)
    lsb = float(rng.uniform(0.4, 1.5)) if names == ["temperature_sensor_quantization"] else None
    device = sensor.draw_device(rng, n_train, n_hold, spec.get("profile"), spec.get("seconds"), spec["kind"] == "constant", lsb)
    base = noise.draw_noise(rng)
    meter = Gauge(device, base.density)
    case = Case(spec, device, base, {}, {})
    for axis in AXES[:n_axes]:
        case.bias[axis], case.found[axis] = draw_bias(rng, device, meter, base.white_dph), []
    order = [AXES[i] for i in rng.permutation(n_axes)]
    sick = order if spec["kind"] == "pooled" else order[:1]
    shape, ds, told = None, {}, {}
    for axis in sick if names else []:
        found, d, apart = sick_axis(spec, names, case, axis, shape, rng, meter)
        case.found[axis], ds[axis], told[axis] = found, d, apart
        shape = shape or found[0]
    case.label = {"d": ds, "told": told, "sick": [a for a in sick if names], "n_train": n_train, "n_hold": n_hold,
                  "n_axes": n_axes, "profile": device.profile, "lsb_degc": device.lsb_degc, **device.note,
                  "d_steps": {a: strength_of_steps(b, device, meter, base.white_dph) for a, b in case.bias.items()}}
    return case


def sick_axis(spec, names, case, axis, shape, rng, meter):
    """Causes of one axis at their strengths; in pooled cases all axes share the first one's shape."""
    device, base, bias, target = case.device, case.base, case.bias[axis], spec["target"]
    if names == ["temperature_sensor_quantization"]:
        return coarse_thermometer(spec, case, axis, rng, meter)
    if shape is not None:
        first = {**shape, "p": dict(shape["p"])}
    else:
        first = cause_of(names[0], rng, device)
    if names[0] == "thermal_lag" and not np.any(bias[1:]):
        raise Unreachable("a flat polynomial shows no lag")
    first = to_strength(first, target, device, base, bias, meter) if shape is None or names[0] != "thermal_lag" else first
    if len(names) == 1:
        d = strength(first, device, base, bias, meter)
        return [first], [d], [told_apart(first, d, device, base, bias, meter)]
    second = cause_of(names[1], rng, device)
    second = to_strength(second, target, device, base, bias, meter)
    found, d = given_each_other([first, second], target, device, base, bias, meter)
    case.cross = float(rng.uniform(-0.12, 0.12)) if all(map(is_signal, found)) else 0.0
    told = [told_given(cause, other, device, base, bias, meter) for cause, other in (found, found[::-1])]
    return found, d, told


def given_each_other(found, target, device, base, bias, meter):
    """Two causes, each at least `target` strong with the other one known -> (causes, strengths)."""
    if not all(c["name"] in causes.REPEATABLE for c in found):
        return found, [float(target)] * 2  # noise and signature hardly share anything
    for _ in range(2):  # a lag does not grow in proportion
        z = [meter.signature(training_signals(c, device, bias)) for c in found]
        overlap = (z[0] @ z[1]) ** 2 / ((z[0] @ z[0]) * (z[1] @ z[1]))
        if overlap > 0.6:
            raise Unreachable("these two look alike on this profile")
        d = [float(np.linalg.norm(v) * np.sqrt(1 - overlap)) for v in z]
        if min(d) >= 0.95 * target:
            break
        found = [causes.scaled(c, max(target / v, 1.0)) for c, v in zip(found, d)]
    return found, d


def told_given(cause, other, device, base, bias, meter):
    """`told_apart` of a cause where another one is known to be there: its signature is taken out, its noise is part of the noise."""
    extra = causes.added_density(other)
    if is_signal(cause) and is_signal(other):
        meter = Gauge(device, base.density, training_signals(other, device, bias))
    elif is_signal(cause) and extra:
        base = noise.Noise(base.white_dph, base.markov, [extra])
        meter = Gauge(device, base.density)
    return told_apart(cause, strength(cause, device, base, bias, meter), device, base, bias, meter)


def clean_signal(case, axis, r, without=()):
    """Noise-free B(T) of a run, and the part that the causes (but for those named in `without`) add."""
    device, bias = case.device, case.bias[axis]
    parts = [signature(c, device, r, bias) for c in case.found[axis] if is_signal(c) and c["name"] not in without]
    extra = np.sum(parts, axis=0) if parts else np.zeros(device.runs[r].n)
    if len(parts) == 2 and case.cross and all(np.ptp(p) > 0 for p in parts):  # a constant has no cross term, and no scale
        size = max(np.sqrt(np.std(parts[0]) * np.std(parts[1])), 1e-9)
        extra = extra + case.cross * parts[0] * parts[1] / size
    return causes.polynomial(bias, device.x(device.runs[r].temp_degc)), extra


def read_out(case, rng):
    """Readings of every axis and run."""
    device = case.device
    for axis, found in case.found.items():
        noisy = [c for c in found if c["name"] in causes.NOISY]
        marks = [c for c in found if c["name"] in causes.OUTPUT]
        case.series[axis] = []
        for r, run in enumerate(device.runs):
            curve, extra = clean_signal(case, axis, r)
            rate = curve + extra + rng.normal(0, 100) + causes.noise_path(noisy, device, run, case.base, rng)
            for cause in found:
                if cause["name"] in outside.NOISES:
                    rate = rate + outside.path(cause, run.n, rng)
            for mark in marks:
                rate = causes.output_stage(mark, rate, rng)
            case.series[axis].append(rate)
        beside(case, axis, rng)


def beside(case, axis, rng):
    """A finding of the output stage beside a cause: drop-outs to zero, or 2 % clipped."""
    mark = case.spec.get("beside")
    if not mark or axis not in case.label["sick"]:
        return
    every = np.concatenate(case.series[axis])
    limit = np.quantile(np.abs(every), 0.98)
    for r, rate in enumerate(case.series[axis]):
        case.series[axis][r] = np.where(rng.random(rate.size) < 0.003, 0.0, rate) if mark == "drop_outs" else np.clip(rate, -limit, limit)


def add_marks(case, rng):
    """Structural causes of the spec."""
    for name in case.spec.get("structural", []):
        axis = AXES[0]
        curve = np.concatenate([causes.polynomial(case.bias[axis], case.device.x(r.temp_degc)) for r in case.device.train])
        case.found[axis].append(causes.draw_output(name, rng, case.base.white_dph, curve))
        case.label["sick"] = [axis]
        case.label["d"], case.label["told"] = {axis: [None]}, {axis: [{"can_tell_member": True, "can_tell_family": True}]}


def build(seed, index, spec):
    """Case `index` of a draw.  What no device can show at the wanted strength is drawn again, with another cause at last."""
    rng = np.random.default_rng([seed % 2**63, index])
    planned, spec = dict(spec), dict(spec)
    for attempt in range(40):
        try:
            case = place(spec, rng)
            break
        except Unreachable:
            if attempt % 8 == 7:
                spec["names"] = [str(n) for n in rng.permutation(spec["pool"])[: len(spec["names"])]]
    else:
        raise Unreachable(f"case {index}: nothing of {spec['pool']} reaches d = {spec['target']}")
    add_marks(case, rng)
    case.spec = spec
    read_out(case, rng)
    case.label.update({
        "kind": spec["kind"], "target": spec.get("target"), "regimes": spec["regimes"], "beside": spec.get("beside"),
        "truth": {a: [c["name"] for c in f] for a, f in case.found.items()}, "causes": case.found, "cross": case.cross,
        "families": {a: [c.get("families", [causes.FAMILY_OF.get(c["name"])]) for c in f] for a, f in case.found.items()},
        "bias_dph": {a: list(map(float, b)) for a, b in case.bias.items()},
        "noise": {"white_dph": case.base.white_dph, "markov": case.base.markov}, "seed": seed, "index": index, "planned": planned})
    return case


# ---- writing ---------------------------------------------------------------------------------------------

def write_log(path, case, r):
    run, keep = case.device.runs[r], case.device.runs[r].keep
    aux = any(c["name"] == "auxiliary_channel" for f in case.found.values() for c in f)
    names = ["t_s", "temp_degc", *case.series, *(["supply_v"] if aux else [])]
    columns = [run.t_s, run.shown_degc, *(s[r] for s in case.series.values()), *([run.aux] if aux else [])]
    forms = ["%d", "%.4f", *["%.3f"] * len(case.series), *(["%.4f"] if aux else [])]
    with open(path, "w", encoding="utf-8") as out:
        out.write(f"# imucal-log = 1\n# device = blind  run = {r}\n" + ",".join(names) + "\n")
        np.savetxt(out, np.stack(columns, 1)[keep], fmt=forms, delimiter=",")


def believed(case, regime, rng):
    """Model JSON and options of a regime; None as a model: none is given; "fit": the runner fits one to the logs."""
    device, base = case.device, case.base
    bias = rng.normal(0, 100, 4).round(2).tolist()  # a wrong polynomial is no gap
    to_json = lambda n: n.to_json(device.t0_degc, device.range_degc, bias)
    if regime == "exact":
        return to_json(base), []
    if regime in ("times_3", "over_3"):
        return to_json(base.wrong(3.0 if regime == "times_3" else 1 / 3)), []
    if regime == "data_sheet":
        sigma = base.markov[0][0] * sensor.log_uniform(rng, 0.5, 2)
        return None, ["--arw", f"{base.white_dph / 60 * rng.uniform(0.8, 1.3):.2g}", "--instability", f"{sigma:.2g}:100"]
    return ("fit" if regime == "fitted" else None), []


def write(case, folder, name):
    """Logs and what is believed, without any label: folder/name/{train*,hold*}.csv, ask<k>.json, model<k>.json."""
    path = os.path.join(folder, name)
    os.makedirs(path, exist_ok=True)
    n_train = len(case.device.train)
    for r in range(len(case.device.runs)):
        write_log(os.path.join(path, f"{'train' if r < n_train else 'hold'}{r}.csv"), case, r)
    rng = np.random.default_rng([case.label["seed"] % 2**63, case.label["index"], 1])
    for k, regime in enumerate(case.spec["regimes"]):
        model, options = believed(case, regime, rng)
        ask = {"options": options, "fit": model == "fit", "t0_degc": case.device.t0_degc, "range_degc": case.device.range_degc,
               "model": f"model{k}.json" if model else None}
        with open(os.path.join(path, f"ask{k}.json"), "w", encoding="utf-8") as out:
            json.dump(ask, out)
        if isinstance(model, dict):
            with open(os.path.join(path, f"model{k}.json"), "w", encoding="utf-8") as out:
                json.dump(model, out)
    return path
