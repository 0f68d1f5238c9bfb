# SPDX-License-Identifier: MIT
"""Does a calibration table keep the limits that a production line sets?  What is judged is the table alone: its span, its
predicted error (times the factor by which its maker saw it too small), and the size and slope of its bias inside the span.
A finding is an answer, not an error."""
import numpy as np

from .strict import read_json
from .table import read_table


def _largest(values, temp_degc):
    at = int(np.argmax(np.abs(values)))
    return abs(float(values[at])), float(temp_degc[at])


def _error_name(channel):
    if channel.error_factor <= 1:
        return "predicted error"
    return f"predicted error, {channel.error_factor:.3g} times what the table says ({', '.join(channel.accepted)} accepted),"


def _findings(channel, limits):
    """Sentences on one axis."""
    unit, found = channel.unit, []
    if "span_degc" in limits:
        lo, hi = limits["span_degc"]
        if channel.span_degc[0] > lo or channel.span_degc[1] < hi:
            found.append(f"valid from {channel.span_degc[0]:g} to {channel.span_degc[1]:g} degC, wanted {lo:g} to {hi:g}")
    grid = np.linspace(*channel.span_degc, 1001)
    curves = {"max_sigma": (_error_name(channel), channel.sigma * channel.error_factor, channel.temp_degc, unit), "max_bias": ("bias", channel.bias(grid), grid, unit),
              "max_slope_per_degc": ("slope", np.gradient(channel.bias(grid), grid), grid, f"{unit} per degC")}
    for key, (name, values, temp_degc, text) in curves.items():
        if key in limits and not len(values):
            found.append(f"no {name} in the table, limit {limits[key]:g}")
        elif key in limits:
            worst, at_degc = _largest(values, temp_degc)
            if worst > limits[key]:
                found.append(f"{name} {worst:.4g} {text} at {at_degc:.1f} degC, limit {limits[key]:g}")
    return found


def judge(table_path, limits_path):
    """What a table breaks.

    Parameters
    ----------
    table_path, limits_path : str    both checked against their schemas before

    Returns
    -------
    list of str : "axis: what, how much, where, limit"; empty: it keeps them all
    """
    limits, channels = read_json(limits_path), read_table(table_path).channels
    names = [c.axis for c in channels]
    found = [f"{name}: the table has no such axis (there are: {', '.join(names)})" for name in limits.get("axes", []) if name not in names]
    for channel in channels:
        if channel.axis in limits.get("axes", names):
            found += [f"{channel.axis}: {text}" for text in _findings(channel, limits)]
    return found
