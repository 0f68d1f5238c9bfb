# SPDX-License-Identifier: MIT
"""Units of rates and accelerations; internal: degrees per hour (dph) and milli-g (mg)."""
import math
import re

DPH_PER_DPS = 3600.0
DPH_PER_RADPS = 3600.0 * 180.0 / math.pi
STANDARD_GRAVITY_MS2 = 9.80665
MG_PER_MS2 = 1000.0 / STANDARD_GRAVITY_MS2

#: unit name -> factor to dph
RATE_UNITS = {"dph": 1.0, "dps": DPH_PER_DPS, "mdps": DPH_PER_DPS / 1000, "radps": DPH_PER_RADPS}
#: unit name -> factor to mg
ACCEL_UNITS = {"mg": 1.0, "g": 1000.0, "ms2": MG_PER_MS2}
#: unit name -> microseconds
TIME_UNITS = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}

_SPELLINGS = [
    (r"mdps|mdeg/s|m°/s", "mdps"), (r"rad/s|rad s-1|rads|radps|rad/sec", "radps"), (r"dph|deg/h|deg/hr|°/h", "dph"),
    (r"dps|deg/s|deg/sec|°/s|degps|degrees/s", "dps"), (r"m/s2|m/s\^2|m/s²|m s-2|ms2", "ms2"), (r"mg", "mg"), (r"g", "g"),
]


def unit_in_name(name):
    """The unit a column's name states ("GYR_X [dps]", "G_x_mdps", "gx (rad/s)"), or None."""
    bracket = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$", name)
    texts = ([bracket.group(1)] if bracket else []) + ([name.rsplit("_", 1)[-1]] if "_" in name else [])
    for text in texts:
        for pattern, unit in _SPELLINGS:
            if re.fullmatch(pattern, text.strip(), re.I):
                return unit
    return None


def unit_of_axis(name):
    """The unit of an axis' rates inside, by its name: "dph", or "mg" of an accelerometer."""
    return "mg" if name.endswith(("_mg", "_ms2")) else "dph"


#: unit of temperature -> (what a degree is, what 0 is, its name)
TEMP_UNITS = {"C": (1.0, 0.0, "degrees Celsius"), "K": (1.0, -273.15, "kelvin"), "F": (1 / 1.8, -32 / 1.8, "degrees Fahrenheit")}


def temp_unit_in_name(name):
    """C, K or F as a column's name states it ("temp [K]", "Temperature (°F)", "temp_degf"), or None."""
    bracket = re.search(r"[\[(]([^\])]+)[\])]\s*$", name)
    text = bracket.group(1) if bracket else name.rsplit("_", 1)[-1] if "_" in name else ""
    found = re.fullmatch(r"(?:°|deg(?:rees)?)?[ _]?(c|celsius|k|kelvin|f|fahrenheit)", text.strip(), re.I)
    return found.group(1)[0].upper() if found else None
