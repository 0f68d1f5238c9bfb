# SPDX-License-Identifier: MIT
"""What the autopilots share: three axes, cubic polynomials in degrees, a span of validity, single precision."""
import numpy as np

from ..errors import DataError

MAX_ORDER = 3


def single(value):
    """The float32 nearest to a value, as a Python float."""
    return float(np.float32(value))


def text(value):
    """A float32 with the digits that give it back."""
    return f"{single(value):.9g}"


def three_axes(table, letter, what):
    """The channels x, y, z of the gyro ("g") or the accelerometer ("a"); [] where the table has none."""
    found = {c.stem.lower()[-1:]: c for c in table.channels if c.stem.lower().startswith(letter) and c.stem.lower()[-1:] in "xyz"}
    if not found:
        return []
    missing = [a for a in "xyz" if a not in found]
    if missing:
        raise DataError(f"{table.path}: the table has no axis {', '.join(letter + a for a in missing)}; {what} needs all three "
                        f"(there are: {', '.join(c.axis for c in table.channels)})")
    return [found[a] for a in "xyz"]


def shared_span(spans, path):
    """The temperatures that several spans have in common; DataError where there are none."""
    lo, hi = max(s[0] for s in spans), min(s[1] for s in spans)
    if not lo < hi:
        raise DataError(f"{path}: the axes have no temperature in common ({', '.join(f'{s[0]:g} to {s[1]:g} degC' for s in spans)}); "
                        "calibrate them in the same test")
    return lo, hi


def common_span(channels, notes, path):
    """The span all axes share; a note where they differ."""
    lo, hi = shared_span([c.span_degc for c in channels], path)
    if any(c.span_degc != (lo, hi) for c in channels):
        notes.append(f"one span for three axes: only {lo:g} to {hi:g} degC, which all of them share")
    return lo, hi


def cubic_powers(channel, t_ref_degc, span, per_unit, notes):
    """Four coefficients in powers of (T - t_ref).  A higher order is replaced by its best cubic over the span, and the
    price is stated."""
    powers = channel.powers(t_ref_degc, per_unit)
    if channel.order > MAX_ORDER:
        temp = span[0] + (span[1] - span[0]) * (1 - np.cos(np.pi * (np.arange(200) + 0.5) / 200)) / 2
        powers = np.polynomial.Polynomial.fit(temp - t_ref_degc, channel.bias(temp), MAX_ORDER).convert().coef * per_unit
        grid = np.linspace(*span, 1001)
        worst = np.abs(np.polynomial.polynomial.polyval(grid - t_ref_degc, powers) / per_unit - channel.bias(grid)).max()
        notes.append(f"{channel.axis}: order {channel.order} does not fit into a cubic: the nearest one is up to {worst:.3g} {channel.unit} off the table")
    return np.pad(powers, (0, max(0, MAX_ORDER + 1 - len(powers))))


def note_scale(channels, notes):
    """The autopilots have no scale factor over temperature."""
    for channel in channels:
        if np.any(channel.scale_coeff):
            notes.append(f"{channel.axis}: its scale factor over temperature is left out: the target has none")
