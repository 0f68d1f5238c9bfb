# SPDX-License-Identifier: MIT
"""A C header with the table and ready functions, for firmware without imucal's core.

Float form: B(T), and compensation with the scale factor, by Horner in Tn.  Integer form: B from millidegrees, in units of
2^-FRAC_BITS of the channel's unit: Tn in Q30, Horner with 64-bit products rounded at each step; each of the order + 1
roundings and the rounding of Tn add less than one unit of the last place, weighed by the slope: see max_error below.
"""
import math
import re

import numpy as np

from ..errors import DataError
from .cubic import text

_PRELUDE = """/* Thermal calibration of {serial}, table {sequence}, {created}; made by imucal export.
 * B(T) = sum b_i Tn^i, Tn = (T - t0)/range, T clamped to the valid span; compensated = (raw - B(T)) (1 + M(T)).
 *   float   {prefix}_<axis>_bias(float temp_degc)                     in the axis' unit
 *   float   {prefix}_<axis>_compensate(float raw, float temp_degc)
 *   int32_t {prefix}_<axis>_bias_fixed(int32_t temp_mdegc)            in 2^-{upper}_<AXIS>_FRAC_BITS of the unit
 * The integer form holds the bias only, not the scale factor.  No heap, no library calls. */
#ifndef {upper}_H
#define {upper}_H

#include <stdint.h>

"""


def _frac_bits(channel):
    """Most fractional bits with sum |b_i| below 2^29: no intermediate value of Horner leaves 31 bits."""
    total = float(np.abs(channel.coeff).sum())
    return max(0, min(24, 29 - (math.ceil(math.log2(total)) if total > 1 else 0)))


def _float(value):
    digits = text(value)
    return digits + ("f" if any(c in digits for c in ".en") else ".0f")


def _horner(values):
    result = values[-1]
    for value in values[-2::-1]:
        result = f"{value} + tn * ({result})"
    return result


def _float_form(prefix, name, channel):
    lo, hi = channel.span_degc
    coeff = [_float(c) for c in channel.coeff]
    scale = [_float(c) for c in channel.scale_coeff]
    return f"""static inline float {prefix}_{name}_tn(float temp_degc) {{
  if (!(temp_degc > {_float(lo)})) temp_degc = {_float(lo)};
  if (temp_degc > {_float(hi)}) temp_degc = {_float(hi)};
  return (temp_degc - {_float(channel.t0_degc)}) / {_float(channel.range_degc)};
}}
static inline float {prefix}_{name}_bias(float temp_degc) {{
  const float tn = {prefix}_{name}_tn(temp_degc);
  return {_horner(coeff) if len(coeff) > 1 else f'{coeff[0]} + 0.0f * tn'};
}}
static inline float {prefix}_{name}_compensate(float raw_{channel.unit}, float temp_degc) {{
  const float tn = {prefix}_{name}_tn(temp_degc);
  return (raw_{channel.unit} - {prefix}_{name}_bias(temp_degc)) * (1.0f + ({_horner(scale) if len(scale) > 1 else f'{scale[0]} + 0.0f * tn'}));
}}
"""


def _fixed_form(prefix, name, channel):
    """Tn_q30 = ((temp - mid) gain) >> 20 + tn_mid, with temp in millidegrees: |temp - mid| < 2^19, gain < 2^43."""
    lo, hi = (round(t * 1000) for t in channel.span_degc)
    mid = (lo + hi) // 2
    bits = _frac_bits(channel)
    gain = round(2 ** 50 / (channel.range_degc * 1000))
    tn_mid = round((mid / 1000 - channel.t0_degc) / channel.range_degc * 2 ** 30)
    steps = [f"  b = {round(c * 2 ** bits)} + ((b * tn + (INT64_C(1) << 29)) >> 30);" for c in channel.coeff[-2::-1]]
    return f"""#define {prefix.upper()}_{name.upper()}_FRAC_BITS {bits}
static inline int32_t {prefix}_{name}_bias_fixed(int32_t temp_mdegc) {{
  if (temp_mdegc < {lo}) temp_mdegc = {lo};
  if (temp_mdegc > {hi}) temp_mdegc = {hi};
  const int64_t tn = ((((int64_t)temp_mdegc - ({mid})) * INT64_C({gain}) + (INT64_C(1) << 19)) >> 20) + INT64_C({tn_mid});
  int64_t b = {round(channel.coeff[-1] * 2 ** bits)};
  (void)tn;
{chr(10).join(steps)}
  return (int32_t)b;
}}
"""


def _names(table):
    """What each channel is called in C; DataError where two would be called the same, as macros in capitals too."""
    names, owners = [], {}
    for channel in table.channels:
        name = re.sub(r"\W", "_", channel.stem, flags=re.ASCII)
        other = owners.setdefault(name.lower(), channel.axis)
        if other != channel.axis:
            raise DataError(f"{table.path}: {other} and {channel.axis} would both be called {name.lower()} in C: rename one")
        names.append(name)
    return names


def _in_comment(text):
    """A text that neither ends the comment it stands in nor begins another."""
    return text.replace("*/", "* /").replace("/*", "/ *")


def export(table, options):
    """(text, notes) of the header."""
    prefix, names = options.prefix or "imucal_table", _names(table)
    parts = [_PRELUDE.format(serial=_in_comment(table.serial), sequence=table.sequence, created=table.created, prefix=prefix,
                             upper=prefix.upper())]
    for name, channel in zip(names, table.channels):
        lo, hi = channel.span_degc
        parts.append(f"/* {_in_comment(channel.axis)}: order {channel.order}, {lo:g} to {hi:g} degC */\n")
        parts.append(_float_form(prefix, name, channel) + _fixed_form(prefix, name, channel) + "\n")
    notes = [f"{c.axis} is called {name} in C" for name, c in zip(names, table.channels) if name != c.stem]
    notes += [f"{c.axis}: the integer form leaves its scale factor out" for c in table.channels if np.any(c.scale_coeff)]
    return "".join(parts) + "#endif\n", notes
