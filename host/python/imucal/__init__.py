# SPDX-License-Identifier: MIT
"""imucal: static thermal calibration of inertial sensors.

Rates are in degrees per hour (dph), accelerations in mg, temperatures in degrees Celsius, times in seconds; names carry
the unit.  Heavy parts are loaded when first used.
"""
import importlib
import os
import pathlib

from .version import VERSION as __version__

# In a source tree the compiled part lies in the build folder.
_tree = pathlib.Path(__file__).resolve().parents[3]
for _build in (os.environ.get("IMUCAL_BIN", ""), _tree / "build/bin"):
    if _build and (pathlib.Path(_build).parent / "python/_core.so").exists():
        __path__.append(str(pathlib.Path(_build).parent / "python"))

_HOMES = {
    "DataError": "errors", "DataWarning": "errors", "ImucalError": "errors", "UsageError": "errors", "Log": "log", "read_log": "log", "write_log": "log",
    "import_log": "importers", "read_table": "table", "ThermalCalibrator": "calibrator",
    **dict.fromkeys(["allan_deviation", "direct_predictor", "expect", "fit_error_model", "check_bound", "calibrate", "compensate", "calibration_error",
                     "optimize_profile", "simulate", "diagnose", "as_log"], "analysis"),
}
__all__ = [*_HOMES, "__version__"]


def __getattr__(name):
    if name in _HOMES:
        return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    if name == "plot":
        return importlib.import_module(".plot", __name__)
    raise AttributeError(f"module {__name__} has no attribute {name}")


def __dir__():
    return sorted(__all__ + ["plot"])
