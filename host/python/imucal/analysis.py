# SPDX-License-Identifier: MIT
"""Analyses on arrays.  Arrays have shape (n,), rates are in dph (accelerations in mg), times in s; results are small dataclasses.

allan_deviation and direct_predictor run in the compiled part; the others run the programs of the tool-chain through their
JSON contracts (imucal/programs.py), in a process of their own.  An option that is None is the program's own choice, and what
a program notes on the way is a DataWarning.
"""
import json
import os
from dataclasses import dataclass, field

import numpy as np

from .errors import DataError
from .log import Log, read_log
from .native import core
from .programs import Folder, model_text
from .units import unit_of_axis


@dataclass
class AllanDeviation:
    """tau_s, adev_dph: shape (m,); ci95_dph: shape (m, 2); n_windows: shape (m,)."""

    tau_s: np.ndarray
    adev_dph: np.ndarray
    ci95_dph: np.ndarray
    n_windows: np.ndarray


@dataclass
class DirectPredictor:
    """tau_s, dp_dph: shape (m,); ci95_dph: shape (m, 2); n_windows: shape (m,)."""

    tau_s: np.ndarray
    dp_dph: np.ndarray
    ci95_dph: np.ndarray
    n_windows: np.ndarray


@dataclass
class ErrorModelFit:
    """model: dict as in a model file; std_errors: dict; bounded, worst_excess, mean_excess; log_likelihood or None."""

    model: dict
    std_errors: dict
    bounded: bool
    worst_excess: float
    mean_excess: float
    log_likelihood: float = None
    details: dict = field(default_factory=dict)


@dataclass
class BoundCheck:
    """bounded: does the model bound the logs; worst_ratio: of model over data, at_tau_s."""

    bounded: bool
    worst_ratio: float
    at_tau_s: float
    details: dict = field(default_factory=dict)


@dataclass
class AxisCalibration:
    """B(T) = sum coeff_dph[i] Tn^i, Tn = (T - t0)/range, |Tn| <= 1; sigma_dph at temp_degc.

    `unit` is that of every member named _dph: "dph", or "mg" of an accelerometer (_mg, _ms2), whose b_0 holds gravity
    along the axis as it lay.
    """

    axis: str
    order: int
    t0_degc: float
    range_degc: float
    coeff_dph: np.ndarray
    temp_degc: np.ndarray
    sigma_dph: np.ndarray
    residual_rms_dph: float

    @property
    def unit(self):
        """"dph", or "mg" of an accelerometer."""
        return unit_of_axis(self.axis)

    def bias_dph(self, at_degc):
        """B(T)."""
        return np.polynomial.polynomial.polyval((np.asarray(at_degc, float) - self.t0_degc) / self.range_degc, self.coeff_dph)


@dataclass
class Calibration:
    """axes: dict name -> AxisCalibration; table: dict as in a table file; details: the program's JSON."""

    axes: dict
    table: dict
    details: dict = field(default_factory=dict)


@dataclass
class CalibrationError:
    """sigma_dph (truth) and believed_sigma_dph at temp_degc; worst, rms, the bound and the efficiency."""

    temp_degc: np.ndarray
    sigma_dph: np.ndarray
    believed_sigma_dph: np.ndarray
    worst_dph: float
    rms_dph: float
    bound_dph: float
    efficiency: float


@dataclass
class OptimizedProfile:
    """profile: dict as in a profile file; worst_dph, bound_dph, efficiency, duration_s."""

    profile: dict
    worst_dph: float
    bound_dph: float
    efficiency: float
    duration_s: float


def _array(values, name="rate_dph"):
    """Doubles of shape (n,), as they lie where they are doubles; NaN where missing or masked.  DataError: something else, or an infinity."""
    if isinstance(values, np.ma.MaskedArray):
        values = values.astype(np.float64).filled(np.nan)
    try:
        if np.iscomplexobj(values):
            raise TypeError
        values = np.ascontiguousarray(values, np.float64)
    except (TypeError, ValueError):
        raise DataError(f"{name}: expected numbers, found {np.asarray(values).dtype}") from None
    if values.ndim != 1:
        raise DataError(f"{name}: expected an array of shape (n,), found {values.shape}")
    with np.errstate(over="ignore", invalid="ignore"):
        is_finite = np.isfinite(values.sum())  # a tenth of the time of a look at each
    if not is_finite and np.isinf(values).any():
        at = int(np.argmax(np.isinf(values)))
        raise DataError(f"{name}[{at}] is {values[at]:g}; a missing value is NaN")
    return values


def _step(dt_s):
    """dt_s as a number above 0."""
    if not 0 < dt_s < np.inf:
        raise DataError(f"dt_s: {dt_s:g} is no time between samples; expected seconds, more than 0")
    return float(dt_s)


def _samples(rate_dph):
    """An array of two samples at least."""
    values = _array(rate_dph)
    if len(values) < 2 or np.isnan(values[:2]).any() and np.isfinite(values).sum() < 2:
        n = int(np.isfinite(values).sum())
        raise DataError(f"rate_dph has {n or 'no'} sample{'' if n == 1 else 's'}{' that is not NaN' if len(values) > n else ''}: two are the fewest")
    return values


def _tau_text(tau_s):
    """A text and None as they are, numbers as a text."""
    return tau_s if tau_s is None or isinstance(tau_s, str) else ",".join(f"{t:.15g}" for t in np.atleast_1d(tau_s))


def _taus(tau_s):
    """A text as it is, numbers as an array of doubles."""
    return tau_s if isinstance(tau_s, str) else np.ascontiguousarray(np.atleast_1d(tau_s), np.float64)


def direct_predictor(rate_dph, dt_s=1.0, tau_s="octave", type=None, nominal=None, estimation_s=20.0, estimator="rms", detrend="mean", min_fill=1.0,
                     intervals=True):
    """Direct Predictor curve: rms error of predicting the mean of the next tau seconds, over sqrt(2).

    Parameters
    ----------
    rate_dph : array (n,)        NaN or masked where missing
    dt_s : float                 between samples
    tau_s : array, or text       "octave", "2:600:2", "log:2:600" …
    type : str                   "av", "dp1", "dp2" or "dp3"; default: "dp2" with a nominal model, else "av", which needs none
    nominal : dict               model whose filter predicts (dp2, dp3)
    estimation_s : float         estimation time of dp1
    estimator : str              "rms", "max" or "p95"
    detrend : str                "none", "mean" or "time:N"
    min_fill : float             part of a window's samples that must be present
    intervals : bool             False: ci95_dph is NaN, which saves time on short records

    Returns
    -------
    DirectPredictor

    Raises
    ------
    DataError : what is wrong with the arguments or the record

    References
    ----------
    Z. Berman, "Inertial Sensors: Further Developments in Low-Cost Calibration and Testing", section II.
    """
    rates, step_s = _samples(rate_dph), _step(dt_s)
    if not 0 < min_fill <= 1:
        raise DataError(f"min_fill: {min_fill:g} is no part of a window; expected more than 0, at most 1")
    type = type or ("av" if nominal is None else "dp2")
    if type in ("dp2", "dp3") and nominal is None:
        raise DataError(f"type \"{type}\" needs nominal, the model whose filter predicts; the Allan deviation, type \"av\", needs none")
    try:
        curve = core().direct_predictor(rates, step_s, type, _taus(tau_s), estimator, None if nominal is None else model_text(nominal),
                                        float(estimation_s), detrend, float(min_fill), bool(intervals))
    except ValueError as error:
        raise DataError(str(error)) from None
    return DirectPredictor(curve.tau_s, curve.dp_dph, curve.ci95_dph, curve.n_windows)


def allan_deviation(rate_dph, dt_s=1.0, tau_s="octave", intervals=True):
    """Overlapping Allan deviation with 95 % intervals.

    Parameters
    ----------
    rate_dph : array (n,)        NaN or masked where missing: windows with a missing sample are left out
    dt_s : float                 between samples
    tau_s : array, or text       "octave", "2:600:2", "log:2:600" …
    intervals : bool             False: ci95_dph is NaN, which saves time on short records

    Returns
    -------
    AllanDeviation

    Raises
    ------
    DataError : a constant or too short record

    References
    ----------
    IEEE Std 952, annex C.

    Examples
    --------
    >>> import numpy as np
    >>> a = allan_deviation(np.random.default_rng(1).normal(0, 36, 100_000))
    >>> abs(a.adev_dph[0] - 36) < 1
    True
    """
    c = direct_predictor(rate_dph, dt_s, tau_s, type="av", intervals=intervals)
    return AllanDeviation(c.tau_s, c.dp_dph, c.ci95_dph, c.n_windows)


def expect(model, tau_s=None, type="dp2", nominal=None):
    """Closed-form curve of a model.

    Parameters
    ----------
    model : dict or path         error model
    tau_s : array, or text       "octave", "2:600:2", "log:2:600" …; default: "2:600"
    type : str                   "av", "dp1", "dp2" or "dp3"
    nominal : dict or path       model whose filter predicts (dp2, dp3); default: the model itself

    Returns
    -------
    DirectPredictor : without intervals (NaN) and windows (0)

    Raises
    ------
    DataError : a model that cannot be used

    References
    ----------
    Z. Berman, "Inertial Sensors: Further Developments in Low-Cost Calibration and Testing", section II.
    """
    with Folder() as folder:
        nominal = (nominal, "nominal") if nominal is not None else (model, "model")
        options = ["--nominal", folder.json(*nominal)] if type in ("dp2", "dp3") else []
        options += _option("--tau", _tau_text(tau_s))
        result = folder.run("errormodel", "expect", folder.json(model, "model"), "--type", type, *options)
    n = len(result["tau_s"])
    return DirectPredictor(np.array(result["tau_s"]), np.array(result["dp_dph"]), np.full((n, 2), np.nan), np.zeros(n, int))


def _many(values):
    """A list of them: several, none, or one by itself, which a name and a path are too."""
    if values is None:
        return []
    return list(values) if isinstance(values, (list, tuple, set, frozenset)) else [values]


def _logs(folder, logs):
    return [folder.log(as_log(log)) for log in _many(logs)]


def _models(folder, models):
    """An option for each model, or for one by itself."""
    return _given("--model", [folder.json(model, "model") for model in _many(models)])


def _option(name, value):
    """An option and its value; nothing of None: that is the program's own choice."""
    return [] if value is None else [name, value]


def _file(folder, name, value, called):
    """An option and the path of a model or the like; nothing of None."""
    return [] if value is None else [name, folder.json(value, called)]


def _given(name, values):
    """An option for each of some values, or for one by itself."""
    return [word for value in _many(values) for word in (name, os.fspath(value))]


def _curve_options(folder, axes, detrend, tau_s, type, nominal):
    """What errormodel fit and errormodel check take of axes and curves."""
    options = _option("--detrend", detrend) + _option("--tau", _tau_text(tau_s)) + _option("--type", type or None)
    return options + _file(folder, "--nominal", nominal, "nominal") + _given("--axis", axes)


def _span(range_degc):
    """--range LOW:HIGH; nothing of None."""
    if range_degc is None:
        return []
    try:
        low, high = (float(value) for value in range_degc)
    except (TypeError, ValueError):
        low = high = np.nan
    if not (np.isfinite(low) and np.isfinite(high)):
        raise DataError(f"range_degc: expected the lowest and the highest temperature, found {range_degc!r}")
    return ["--range", f"{low:.15g}:{high:.15g}"]


def as_log(value, temp_degc=None, dt_s=1.0, axis="gx_dph"):
    """A Log from an array; a path and a Log stay what they are.

    Parameters
    ----------
    value : array (n,), Log or path    rates in dph; NaN where missing
    temp_degc : array (n,)             default: no temperature
    dt_s : float                       between samples
    axis : str                         name of the axis

    Returns
    -------
    Log, or the path

    Raises
    ------
    DataError : arrays of different lengths or of another shape
    """
    if isinstance(value, (str, Log)) or hasattr(value, "__fspath__"):
        return value
    rate = _array(value)
    temp = np.full(len(rate), np.nan) if temp_degc is None else _array(temp_degc, "temp_degc")
    if len(temp) != len(rate):
        raise DataError(f"rate_dph has {len(rate)} samples, temp_degc {len(temp)}")
    return Log(_step(dt_s) * np.arange(1, len(rate) + 1), temp, {axis: rate}, {}, {}, "array")


def _judged(result):
    """A program's result; DataError where its judgement refuses the data, with every reason."""
    judgement = result.get("judgement") or {}
    if judgement.get("accepted", True):
        return result
    reasons = [f"{r.get('axis') or 'all axes'}: {r['rule']}: {r['text']}" for r in judgement["reasons"] if not r.get("accepted")]
    raise DataError("; ".join(reasons) + " (accept=[rule] insists)")


def fit_error_model(logs, markov=1, criterion="ml", axes=(), detrend=None, tau_s=None, type=None, nominal=None, accept=()):
    """Error model from logs: "ml" (maximum likelihood), "bound" (tightest bounding) or "ls" (least squares).

    Parameters
    ----------
    logs : path, Log or array (n,) in dph, or a list of them
    markov : int                 number of Gauss-Markov terms; None: chosen
    criterion : str              "ml", "bound" or "ls"
    axes : str, or list of str   default: all gyros (all axes where there is none)
    detrend : str                "none", "mean", "poly:3" (in temperature) …; default: "mean", or "poly:3" where the rate follows the temperature
    tau_s : array, or text       of the curves ("bound", "ls")
    type : str                   of the curves: "av", "dp1", "dp2" or "dp3"
    nominal : dict or path       model whose filter predicts (dp2, dp3)
    accept : str, or list of str    rules that may speak against the data: "repeated", "temp-jump" …

    Returns
    -------
    ErrorModelFit

    Raises
    ------
    DataError : a log or an option that cannot be used, or data of a sick sensor, with the rule

    References
    ----------
    Z. Berman, "Inertial Sensors: Further Developments in Low-Cost Calibration and Testing", section III.
    """
    with Folder() as folder:
        options = _curve_options(folder, axes, detrend, tau_s, type, nominal) + _given("--accept", accept) + _option("--markov", markov)
        r = folder.run("errormodel", "fit", *_logs(folder, logs), "--criterion", criterion, "-o", folder.new(".json"), *options)
    _judged(r)
    return ErrorModelFit(r["model"], r.get("std_errors", {}), r["bounded"], r["excess"]["worst"], r["excess"]["mean"], r.get("log_likelihood"), r)


def check_bound(logs, model, axes=(), detrend=None, tau_s=None, type=None, nominal=None):
    """Does a model bound these logs, and how tightly?

    Parameters
    ----------
    logs : path, Log or array (n,) in dph, or a list of them
    model : dict or path         error model
    axes : str, or list of str   default: all gyros (all axes where there is none)
    detrend : str                "none", "mean", "poly:3" (in temperature) …; default: "mean", or "poly:3" where the rate follows the temperature
    tau_s : array, or text       where they are compared
    type : str                   of the curves: "av", "dp1", "dp2" or "dp3"
    nominal : dict or path       model whose filter predicts (dp2, dp3)

    Returns
    -------
    BoundCheck

    Raises
    ------
    DataError : a log, a model or an option that cannot be used
    """
    with Folder() as folder:
        options = _curve_options(folder, axes, detrend, tau_s, type, nominal)
        r = folder.run("errormodel", "check", *_logs(folder, logs), "--model", folder.json(model, "model"), *options, negative_is_answer=True)
    return BoundCheck(r["bounded"], r["worst_ratio"], r["at_tau_s"], r)


def calibrate(logs, order=3, model=None, method=None, axes=(), accept=(), range_degc=None, shared_turn_on=False, max_error_dph=None,
              serial=None):
    """Thermal calibration of recorded logs: the C core's filter ("kf", needs a model) or least squares ("poly").

    The constant b_0 of an accelerometer's axis (_mg) holds gravity as it lay in the test.

    Parameters
    ----------
    logs : path or Log, or a list of them
    order : int                  of the polynomial in temperature
    model : dict or path         error model of the filter; or two: of the gyros, and of the accelerometers ("unit": "mg")
    method : str                 "kf" or "poly"; default: "kf" with a model, else "poly"
    axes : str, or list of str   default: the gyros; with a model of the accelerometers these
    accept : str, or list of str    rules that may speak against an axis: "span", "units" …
    range_degc : (float, float)  lowest and highest temperature, the scale of the polynomial; default: the model's, else what the logs span
    shared_turn_on : bool        the device was not switched off between the logs
    max_error_dph : float        largest predicted error to accept (accelerometers: mg); default: 100 dph, 10 mg
    serial : str                 of the device, for the table; default: the first log's

    Returns
    -------
    Calibration

    Raises
    ------
    DataError : a log that cannot be used, or that contradicts the model, with the rule
    """
    with Folder() as folder:
        table = folder.new(".json")
        models = _models(folder, model)
        options = models + _given("--axis", axes) + _given("--accept", accept) + _span(range_degc)
        options += ["--shared-turn-on"] if shared_turn_on else []
        options += _option("--max-error", max_error_dph) + _option("--serial", serial)
        r = folder.run("calibrate", "fit", *_logs(folder, logs), "--method", method or ("kf" if models else "poly"), "--order", order, "-o", table,
                       *options)
        _judged(r)
        with open(table, encoding="utf-8") as file:
            table = json.load(file)
    found = {}
    for a in r["axes"]:
        unit = a["axis"].rpartition("_")[2]
        found[a["axis"]] = AxisCalibration(a["axis"], a["order"], a["t0_degc"], a["range_degc"], np.array(a.get("coeff_dph", a.get(f"coeff_{unit}"))),
                                           np.array(a["temp_degc"]), np.array(a.get("sigma_dph", a.get(f"sigma_{unit}"))),
                                           a.get("residual_rms_dph", a.get(f"residual_rms_{unit}")))
    return Calibration(found, table, r)


def compensate(rate, temp_degc, channel):
    """Rates less B(T), with the scale factor over temperature where the channel has one.

    Parameters
    ----------
    rate : array (n,)            in the channel's unit
    temp_degc : array (n,)       clamped to the channel's span
    channel : table.Channel (of read_table) or AxisCalibration

    Of an accelerometer B(T) holds gravity as it lay in the test, and it is taken away with it: add bias(T_ref) back where
    only the drift with temperature shall go.

    Returns
    -------
    array (n,) : in the channel's unit

    Raises
    ------
    DataError : arrays of different lengths or of another shape
    """
    rate, temp = _array(rate, "rate"), _array(temp_degc, "temp_degc")
    if len(temp) != len(rate):
        raise DataError(f"rate has {len(rate)} samples, temp_degc {len(temp)}")
    if isinstance(channel, AxisCalibration):
        return rate - channel.bias_dph(np.clip(temp, channel.t0_degc - channel.range_degc, channel.t0_degc + channel.range_degc))
    return (rate - channel.bias(temp)) * channel.scale(temp)


def calibration_error(profile, model, order=3, filter_model=None, range_degc=None):
    """Predicted calibration error of a temperature profile over temperature (exact covariance).

    Parameters
    ----------
    profile : dict or path       of the chamber's temperature, or the path of a recorded log; or a list of them, each a run
    model : dict or path         error model of the sensor
    order : int                  of the polynomial in temperature
    filter_model : dict or path  what the filter believes; default: model
    range_degc : (float, float)  span that is judged; default: what the profile reaches

    Returns
    -------
    CalibrationError

    Raises
    ------
    DataError : a profile or a model that cannot be used
    """
    with Folder() as folder:
        options = _file(folder, "--filter-model", filter_model, "filter_model") + _span(range_degc)
        profiles = [folder.json(p, "profile") for p in _many(profile)]
        r = folder.run("profile", "error", *profiles, "--model", folder.json(model, "model"), "--order", order, *options)
    return CalibrationError(np.array(r["temp_degc"]), np.array(r["sigma_dph"]), np.array(r["believed_sigma_dph"]), r["worst_dph"], r["rms_dph"],
                            r["bound_dph"], r["efficiency"])


def optimize_profile(model, range_degc, max_rate_degc_per_min, duration_s=None, order=3, seed=1, required_error_dph=None):
    """The chamber profile with the smallest worst calibration error.

    Parameters
    ----------
    model : dict or path         error model of the sensor
    range_degc : (float, float)  lowest and highest temperature
    max_rate_degc_per_min : float    of the chamber
    duration_s : float           of the profile
    order : int                  of the polynomial in temperature
    seed : int                   of the search
    required_error_dph : float   instead of a duration: the shortest profile that reaches this error (accelerometers: mg)

    Returns
    -------
    OptimizedProfile

    Raises
    ------
    DataError : a range that cannot be reached in this time, or a model that cannot be used
    """
    with Folder() as folder:
        path = folder.new(".json")
        limit = _option("--duration-s", duration_s) + _option("--required-error", required_error_dph)
        r = folder.run("profile", "optimize", "--model", folder.json(model, "model"), "--order", order, *_span(range_degc),
                       "--max-rate", max_rate_degc_per_min, *limit, "--seed", seed, "-o", path)
        with open(path, encoding="utf-8") as file:
            profile = json.load(file)
    return OptimizedProfile(profile, r["worst_dph"], r["bound_dph"], r["efficiency"], r["duration_s"])


def simulate(model, profile, n_axes=None, seed=1, effects=None, log_index=0, n_logs=1):
    """A simulated test: chamber, gyros, noise, effects.

    Parameters
    ----------
    model : dict or path         error model of the sensors; or a list, one of each
    profile : dict or path       of the chamber's temperature
    n_axes : int                 gyros; default: one of each model
    seed : int                   of the noise
    effects : list or path       what the model leaves out: [{"name", "parameters"}, …]
    log_index : int              which test of a series, from 0
    n_logs : int                 tests of the series

    Returns
    -------
    Log

    Raises
    ------
    DataError : a model, a profile or an effect that cannot be used
    """
    with Folder() as folder:
        path = folder.new(".csv")
        options = _models(folder, model) + _file(folder, "--effects", effects, "effects") + _option("--axes", n_axes)
        folder.run("gyrosim", "log", "--profile", folder.json(profile, "profile"), "--seed", seed, "--log-index", log_index, "--n-logs", n_logs, "-o", path,
                   *options)
        return read_log(path)


def _data_sheet(arw, white, instability):
    """The options of a data sheet in the place of a model."""
    if instability is not None and not isinstance(instability, str):
        instability = ":".join(f"{value:.15g}" for value in instability)
    return _option("--arw", arw) + _option("--white", white) + _option("--instability", instability)


def diagnose(logs, model=None, holdout=(), axes=(), without=(), only=(), false_alarm_rate=0.01, seed=1, threads=0, arw=None, white=None, instability=None):
    """What the error model leaves out: where, which effect, how far the gap shrinks on held-out logs.

    Without a model the noise is estimated from the logs; a data sheet may stand in the place of a model.

    Parameters
    ----------
    logs : path, Log or array (n,) in dph, or a list of them
    model : dict or path         error model that is tested; None: the noise is estimated, which is the normal case
    holdout : as logs            logs the effect is judged on; default: each of the logs in turn
    axes : str, or list of str   default: all gyros; the accelerometers where the model is of one or there is no gyro
    without : str, or list of str    effects that are not tried
    only : str, or list of str   effects that are tried alone
    false_alarm_rate : float     probability of a finding where there is none
    seed : int                   of the reference draws
    threads : int                0: all processors
    arw : float                  data sheet: angle random walk in deg/sqrt(h)
    white : float                data sheet of an accelerometer: white noise in mg/sqrt(Hz)
    instability : (float, float) data sheet: bias instability in dph (accelerometers: mg) and its time constant in s

    Returns
    -------
    dict : as `diagnose --json` writes it (one entry of "axes" per axis; one with "refused" could not be judged)

    Raises
    ------
    DataError : a log or a model that cannot be used
    UsageError : a model and a data sheet, or an effect that is not in the library
    """
    with Folder() as folder:
        options = _file(folder, "--model", model, "model") + _data_sheet(arw, white, instability)
        options += _given("--axis", axes) + _given("--without", without) + _given("--only", only)
        options += _given("--log", _logs(folder, logs)) + _given("--holdout", _logs(folder, holdout))
        return folder.run("diagnose", *options, "--false-alarm-rate", false_alarm_rate, "--seed", seed, "--threads", threads, "--quiet",
                          negative_is_answer=True)
