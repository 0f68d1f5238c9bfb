# SPDX-License-Identifier: MIT
"""Calibration tables and error models as their JSON files hold them."""
import os
from dataclasses import dataclass, field

import numpy as np

from .strict import N_TEMPERATURES, read_valid


@dataclass
class Channel:
    """One axis of a table: B(T) = sum coeff[i] Tn^i with Tn = (T - t0)/range, valid inside the span.

    Attributes
    ----------
    axis, unit : str             "gx_dph", "dph" ("ax_mg", "mg")
    coeff : float array (order + 1,)   in `unit`
    scale_coeff : float array    rate = (raw - B(T)) (1 + M(T)), M(T) = sum scale_coeff[i] Tn^i
    sigma : float array (9,)     one-sigma calibration error at temp_degc
    accepted : list of str       rules that spoke against the axis and were accepted (calibrate --accept)
    error_factor : float         how many times sigma is too small by what its maker saw; 1: nothing is known against it
    """

    axis: str
    unit: str
    t0_degc: float
    range_degc: float
    coeff: np.ndarray
    scale_coeff: np.ndarray
    span_degc: tuple
    temp_degc: np.ndarray
    sigma: np.ndarray
    unit_per_count: float
    accepted: list = field(default_factory=list)
    error_factor: float = 1.0

    @property
    def order(self):
        """Degree of B(T)."""
        return len(self.coeff) - 1

    @property
    def stem(self):
        """The axis' name without its unit."""
        return self.axis.rpartition("_")[0]

    def bias(self, temp_degc):
        """B(T) in `unit`; the temperature is clamped to the span, as the core does."""
        tn = (np.clip(temp_degc, *self.span_degc) - self.t0_degc) / self.range_degc
        return np.polynomial.polynomial.polyval(tn, self.coeff)

    def scale(self, temp_degc):
        """1 + M(T)."""
        tn = (np.clip(temp_degc, *self.span_degc) - self.t0_degc) / self.range_degc
        return 1 + np.polynomial.polynomial.polyval(tn, self.scale_coeff)

    def powers(self, t_ref_degc, per_unit=1.0):
        """Coefficients of B in powers of (T - t_ref), times per_unit."""
        shift = np.polynomial.Polynomial([(t_ref_degc - self.t0_degc) / self.range_degc, 1 / self.range_degc])
        result = np.polynomial.Polynomial(self.coeff)(shift).coef * per_unit
        return np.pad(result, (0, len(self.coeff) - len(result)))


@dataclass
class Table:
    """A calibration table."""

    serial: str
    sequence: int
    created: str
    degc_per_count: float
    degc_at_zero: float
    channels: list
    path: str = ""


def gyro_names(model):
    """A model, or an axis of a table, of unit "mg" under the names that a gyro's has: sigma_mg is called sigma_dph, and so on;
    white_mg_rt_hz over 60 is called arw_deg_rt_h."""
    if not isinstance(model, dict):
        return model
    named = {}
    for key, value in model.items():
        if key == "white_mg_rt_hz":
            named["arw_deg_rt_h"] = value / 60
        elif key in ("turn_on_sigma_mg", "sigma_mg", "coeff_mg"):
            named[key[:-3] + "_dph"] = value
        else:
            named[key] = [gyro_names(v) for v in value] if key == "markov" else gyro_names(value) if key == "bias" else value
    return named


def _channel(axis):
    name = axis["axis"]
    unit = name.rpartition("_")[2] or "dph"
    return Channel(name, unit, float(axis["t0_degc"]), float(axis["range_degc"]), np.array(axis[f"coeff_{unit}"], float),
                   np.array(axis.get("scale_coeff", [0]), float), tuple(map(float, axis["span_degc"])),
                   np.array(axis.get("temp_degc", np.linspace(*axis["span_degc"], N_TEMPERATURES)), float),
                   np.array(axis[f"sigma_{unit}"], float),
                   float(axis[f"{unit}_per_count"]), list(axis.get("accepted", [])), float(axis.get("error_factor", 1)))


def read_table(path):
    """Read a table (JSON).

    Parameters
    ----------
    path : str

    Returns
    -------
    Table

    Raises
    ------
    DataError : names file, line and field: a table that the programs refuse, or that contradicts itself
    """
    data = read_valid(path, "table", "imucal_table", "not a calibration table (no \"imucal_table\": 1)")
    return Table(data["serial"], data["sequence"], data["created"], float(data["degc_per_count"]), float(data["degc_at_zero"]),
                 [_channel(axis) for axis in data["axes"]], os.fspath(path))
