# SPDX-License-Identifier: MIT
"""imucal: static thermal calibration of inertial sensors.

Rates are in degrees per hour (dph), accelerations in mg, temperatures in degrees Celsius, times in seconds; names carry
the unit.  Heavy parts are loaded when first used.
"""
import importlib

from .ingest import VERSION as __version__

_HOMES = {
    "DataError": "errors", "ImucalError": "errors", "UsageError": "errors", "Log": "log", "read_log": "log", "write_log": "log",
    "import_log": "importers", "read_table": "table",
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
