# SPDX-License-Identifier: MIT
"""A table as JSON for MATLAB and Python: powers of degrees, polyval's order too, and the curve itself."""
import json

import numpy as np


def export(table, options):
    """(text, notes)."""
    axes = []
    for c in table.channels:
        grid = np.linspace(*c.span_degc, 61)
        centred = c.powers(c.t0_degc)
        axes.append({"axis": c.axis, "unit": c.unit, "valid_degc": list(c.span_degc), "t_ref_degc": c.t0_degc,
                     "powers_of_t_minus_t_ref": centred.tolist(), "matlab_polyval": centred[::-1].tolist(),
                     "scale_powers": (np.asarray(c.scale_coeff) / c.range_degc ** np.arange(len(c.scale_coeff))).tolist(), "temp_degc": grid.tolist(), "bias": c.bias(grid).tolist(),
                     "sigma_temp_degc": c.temp_degc.tolist(), "sigma": c.sigma.tolist()})
    result = {"imucal_export": 1, "serial": table.serial, "sequence": table.sequence, "created": table.created,
              "formula": "compensated = (raw - polyval(matlab_polyval, clip(T, valid_degc) - t_ref_degc)) * (1 + sum scale_powers[i] (T - t_ref)^i)", "axes": axes}
    return json.dumps(result, indent=2) + "\n", []
