# SPDX-License-Identifier: MIT
"""An error model as other programs state noise.

White rate noise of `a` deg/sqrt(h) has the density 60 a dph/sqrt(Hz).  A first-order Gauss-Markov bias (sigma, tau) moves, on
times short against tau, like a random walk of density K = sigma sqrt(2/tau) per sqrt(s); it is bounded, a random walk is
not.  Several terms add in power.
Of an accelerometer (unit "mg") the same members are in mg: 60 a mg/sqrt(Hz), sigma in mg (host/formats.md, Model).
"""
import math
import os
from dataclasses import dataclass

import numpy as np

from ..errors import DataError
from ..strict import read_valid
from ..table import gyro_names
from ..units import DPH_PER_RADPS, MG_PER_MS2

_FLAT = math.sqrt(2 * math.log(2) / math.pi)  # Allan deviation of flicker noise over its B: 0.664 (IEEE 952, C.1)


@dataclass
class Noise:
    """An error model's noise: arw_deg_rt_h, markov [(sigma_dph, tau_s)], turn_on_sigma_dph; in mg where unit is "mg"."""

    arw_deg_rt_h: float
    markov: list
    turn_on_sigma_dph: float
    bias: dict
    effects: list
    path: str
    unit: str = "dph"

    @property
    def is_accelerometer(self):
        """Figures in mg."""
        return self.unit == "mg"

    @property
    def per_si(self):
        """The unit's figures per rad/s, or per m/s^2."""
        return MG_PER_MS2 if self.is_accelerometer else DPH_PER_RADPS

    @property
    def density(self):
        """rad/s/sqrt(Hz), or m/s^2/sqrt(Hz)."""
        return 60 * self.arw_deg_rt_h / self.per_si

    @property
    def walk_dph(self):
        """Short-term random walk in dph per sqrt(s)."""
        return math.sqrt(sum(2 * s * s / tau for s, tau in self.markov))

    @property
    def walk(self):
        """rad/s^2/sqrt(Hz), or m/s^3/sqrt(Hz)."""
        return self.walk_dph / self.per_si

    def allan_dph(self, tau_s):
        """Allan deviation: white noise and Gauss-Markov terms (IEEE 952-1997, annex C: angle random walk, Markov noise)."""
        tau = np.asarray(tau_s, float)
        variance = (60 * self.arw_deg_rt_h) ** 2 / tau
        for sigma, corr in self.markov:
            x = tau / corr
            variance = variance + 2 * sigma ** 2 / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x))
        return np.sqrt(variance)


def read_noise(path):
    """Noise of a model file."""
    data = read_valid(path, "model", "imucal_model", "not an error model (no \"imucal_model\": 1)")
    unit = data.get("unit", "dph")
    if unit == "mg":
        data = gyro_names(data)
    markov = [(float(m["sigma_dph"]), float(m["tau_s"])) for m in data.get("markov", [])]
    return Noise(float(data["arw_deg_rt_h"]), markov, float(data.get("turn_on_sigma_dph", 0)), data.get("bias"), data.get("effects", []), os.fspath(path), unit)


def _not_held(noise, target):
    notes = []
    if noise.markov:
        terms = ", ".join(f"{s:g} {noise.unit} with {t:g} s" for s, t in noise.markov)
        notes.append(f"{target} knows a random walk only: the bounded instability ({terms}) is its short-term growth, too large beyond {max(t for _, t in noise.markov):g} s")
    if noise.effects:
        notes.append(f"effects are left out: {', '.join(e.get('name', '?') for e in noise.effects)}")
    if noise.bias:
        notes.append("the thermal polynomial is left out: export the table")
    return notes


def _kalibr_lines(noise):
    sensor, what = ("accelerometer", "m/s^2") if noise.is_accelerometer else ("gyroscope", "rad/s")
    rate_of = {"m/s^2": "m/s^3", "rad/s": "rad/s^2"}[what]
    return [f"{sensor}_noise_density: {noise.density:.9g}   # {what}/sqrt(Hz)", f"{sensor}_random_walk: {noise.walk:.9g}   # {rate_of}/sqrt(Hz)"]


_NO_ACCEL = ["# accelerometer: fill in its own figures; they are not in this model",
             "#accelerometer_noise_density:   # m/s^2/sqrt(Hz)", "#accelerometer_random_walk:     # m/s^3/sqrt(Hz)"]
_NO_GYRO = ["# gyroscope: fill in its own figures; they are not in this model",
            "#gyroscope_noise_density:   # rad/s/sqrt(Hz)", "#gyroscope_random_walk:     # rad/s^2/sqrt(Hz)"]


def _accel_beside(noise, options):
    """The model of --accel; None where there is none."""
    path = getattr(options, "accel", None)
    if not path:
        return None
    accel = read_noise(path)
    if noise.is_accelerometer or not accel.is_accelerometer:
        raise DataError(f"{path}: --accel is an accelerometer's model (\"unit\": \"mg\") beside a gyro's")
    return accel


def kalibr(noise, options):
    """Kalibr imu.yaml (kalibr wiki, "IMU Noise Model" and "YAML formats")."""
    rate = options.rate_hz or 200.0
    accel = _accel_beside(noise, options)
    head = ["# Kalibr imu.yaml from " + noise.path.rsplit("/", 1)[-1]]
    if accel:
        body = _kalibr_lines(accel) + _kalibr_lines(noise)
    else:
        body = _kalibr_lines(noise) + _NO_GYRO if noise.is_accelerometer else _NO_ACCEL + _kalibr_lines(noise)
    notes = _not_held(noise, "Kalibr") + (_not_held(accel, "Kalibr") if accel else [])
    if not accel:
        missing = "gyroscope" if noise.is_accelerometer else "accelerometer"
        notes.append(f"{missing} figures are not in {'an accelerometer' if noise.is_accelerometer else 'a gyro'}'s model: Kalibr wants them filled in"
                     + ("" if noise.is_accelerometer else ", or give --accel MODEL.json"))
    return "\n".join([*head, *body, "rostopic: /imu/data_raw", f"update_rate: {rate:g}   # Hz"]) + "\n", notes


def _ros_lines(noise, rate):
    variance = noise.density ** 2 * rate
    if noise.is_accelerometer:
        sensor, field, gtsam, unit, rate_unit = "accel", "linear_acceleration_covariance", ("accelerometerCovariance", "biasAccCovariance"), "m/s^2", "m/s^3"
    else:
        sensor, field, gtsam, unit, rate_unit = "gyro", "angular_velocity_covariance", ("gyroscopeCovariance", "biasOmegaCovariance"), "rad/s", "rad/s^2"
    lines = [f"{sensor}_noise_density: {noise.density:.9g}        # {unit}/sqrt(Hz)", f"{sensor}_bias_random_walk: {noise.walk:.9g}     # {rate_unit}/sqrt(Hz)",
             f"{field}: [{variance:.9g}, 0, 0, 0, {variance:.9g}, 0, 0, 0, {variance:.9g}]   # ({unit})^2 per sample at rate_hz",
             f"gtsam_{gtsam[0]}: {noise.density ** 2:.9g}   # ({unit})^2/Hz, continuous", f"gtsam_{gtsam[1]}: {noise.walk ** 2:.9g}   # ({rate_unit})^2/Hz"]
    name = "sigma_ms2" if noise.is_accelerometer else "sigma_radps"
    for i, (sigma, tau) in enumerate(noise.markov):
        lines.append(f"{sensor}_bias_markov_{i}: {{{name}: {sigma / noise.per_si:.9g}, tau_s: {tau:g}}}   # for filters with a first-order bias")
    return lines


def ros(noise, options):
    """Densities and covariances as ROS drivers, robot_localization and GTSAM take them."""
    rate = options.rate_hz or 100.0
    accel = _accel_beside(noise, options)
    lines = [f"# noise of {noise.path.rsplit('/', 1)[-1]} for ROS (sensor_msgs/Imu, robot_localization) and GTSAM", f"rate_hz: {rate:g}",
             *_ros_lines(noise, rate), *(_ros_lines(accel, rate) if accel else [])]
    what = "a ROS or GTSAM density"
    return "\n".join(lines) + "\n", _not_held(noise, what) + (_not_held(accel, what) if accel else [])


def _matlab_bias(noise, unit):
    at = (25 - noise.bias["t0_degc"]) / noise.bias["range_degc"]
    slope = np.polynomial.polynomial.polyval(at, np.polynomial.polynomial.polyder(noise.bias["coeff_dph"])) / noise.bias["range_degc"]
    constant = np.polynomial.polynomial.polyval(at, noise.bias["coeff_dph"])
    return [f"p.ConstantBias = {constant / noise.per_si:.9g};        % {unit} at 25 degC",
            f"p.TemperatureBias = {slope / noise.per_si:.9g};     % {unit} per degC, slope at 25 degC"]


def matlab(noise, options):
    """A script that makes gyroparams, or accelparams (Navigation, Sensor Fusion and UAV Toolboxes)."""
    rate = options.rate_hz or 100.0
    maker, unit = ("accelparams", "m/s^2") if noise.is_accelerometer else ("gyroparams", "rad/s")
    sigma = math.sqrt(sum(s * s for s, _ in noise.markov))
    tau = max((t for _, t in noise.markov), default=1.0)
    phi = math.exp(-1 / (rate * tau))
    lines = [f"% {maker} of {noise.path.rsplit('/', 1)[-1]}; SI units.  fs: sample rate of the imuSensor that takes it.", f"fs = {rate:g};",
             f"p = {maker};", f"p.NoiseDensity = {noise.density:.9g};        % {unit}/sqrt(Hz)", f"p.BiasInstability = {sigma / noise.per_si:.9g};     % {unit}, stationary",
             "if isprop(p, 'BiasInstabilityCoefficients')   % first-order Gauss-Markov instead of flicker noise",
             f"  phi = exp(-1/(fs*{tau:g}));                 % {phi:.9g} at {rate:g} Hz",
             "  p.BiasInstabilityCoefficients = struct('Numerator', sqrt(1 - phi^2), 'Denominator', [1, -phi]);", "end", "p.RandomWalk = 0;                           % the instability is bounded"]
    notes = [f"effects are left out: {', '.join(e.get('name', '?') for e in noise.effects)}"] if noise.effects else []
    if len(noise.markov) > 1:
        notes.append(f"{maker} has one instability: the terms are joined to one of their common variance with {tau:g} s")
    if noise.bias:
        lines += _matlab_bias(noise, unit)
        notes.append(f"{maker} is linear in temperature: TemperatureBias is the slope at 25 degC, the curvature is lost")
        if noise.is_accelerometer:
            notes.append("ConstantBias is b0 at 25 degC: gravity along the axis as it lay is part of it")
    return "\n".join(lines) + "\n", notes


def datasheet_figures(noise):
    """IEEE 952: angle random walk N, bias instability B (flat part over 0.664) with its tau, rate random walk K."""
    tau = np.geomspace(1, 1e5, 4001)
    adev = noise.allan_dph(tau)
    inner = np.flatnonzero((adev[1:-1] < adev[:-2]) & (adev[1:-1] <= adev[2:])) + 1
    at = int(inner[0]) if len(inner) else None
    return {"arw_deg_rt_h": noise.arw_deg_rt_h, "bias_instability_dph": float(adev[at] / _FLAT) if at is not None else None,
            "bias_instability_tau_s": float(tau[at]) if at is not None else None, "rate_random_walk_dph_rt_h": 60 * noise.walk_dph}


def _figure(value, factor, unit):
    return f"{factor * value:.3g} {unit}"


def datasheet(noise, options):
    """One line a data sheet can carry: of a gyro after IEEE 952, of an accelerometer after IEEE 1293 and makers' sheets (ug)."""
    f = datasheet_figures(noise)
    factor, unit = (1e3, "ug") if noise.is_accelerometer else (1, "deg/h")
    if noise.is_accelerometer:
        vrw = noise.density * 60  # m/s/sqrt(h): (m/s^2)/sqrt(Hz) is (m/s)/sqrt(s)
        parts = [f"velocity random walk {vrw:.3g} m/s/sqrt(h) (noise density {60e3 * noise.arw_deg_rt_h:.3g} ug/sqrt(Hz))"]
    else:
        parts = [f"ARW {f['arw_deg_rt_h']:.3g} deg/sqrt(h)"]
    if f["bias_instability_dph"] is not None:
        parts.append(f"bias instability {_figure(f['bias_instability_dph'], factor, unit)} (Allan minimum / 0.664, at {f['bias_instability_tau_s']:.0f} s)")
    if noise.markov and not noise.is_accelerometer:
        parts.append(f"rate random walk {f['rate_random_walk_dph_rt_h']:.3g} deg/h/sqrt(h) (short-term, of a bounded instability)")
    if noise.turn_on_sigma_dph:
        parts.append(f"turn-on repeatability {_figure(noise.turn_on_sigma_dph, factor, unit)}, 1 sigma")
    notes = _not_held(noise, "a data sheet's line" if noise.is_accelerometer else "a data sheet's rate random walk")
    if f["bias_instability_dph"] is None:
        notes.append("the Allan deviation has no minimum between 1 s and 1e5 s: no bias instability is stated")
    return ", ".join(parts) + ("\n" if noise.is_accelerometer else " (IEEE Std 952)\n"), notes


TARGETS = {"kalibr": kalibr, "ros": ros, "matlab": matlab, "datasheet": datasheet}

