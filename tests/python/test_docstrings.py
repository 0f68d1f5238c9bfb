# SPDX-License-Identifier: MIT
"""Docstrings and type stubs of what the package gives: complete, and the same names as the code."""
import ast
import inspect
import re
from pathlib import Path

import pytest

import imucal

PACKAGE = Path(imucal.__file__).parent
FUNCTIONS = {n: getattr(imucal, n) for n in imucal.__all__ if inspect.isfunction(getattr(imucal, n))}
METHODS = {f"ThermalCalibrator.{n}": f for n, f in vars(imucal.ThermalCalibrator).items() if inspect.isfunction(f) and not n.startswith("_")}
UNITS = ("_s", "_dph", "_degc", "_hz", "_degc_per_min", "_deg_rt_h", "_rate")
#: what is a number and has no unit, or is no number
NO_UNIT = {"order", "seed", "markov", "n_axes", "log_index", "n_logs", "threads", "min_fill", "intervals", "type", "nominal", "estimator", "detrend", "accept", "criterion", "model",
           "profile", "effects", "filter_model", "method", "axes", "axis", "without", "only", "logs", "holdout", "path", "log", "options", "settings", "channel",
           "value", "rate", "seconds", "shared_turn_on", "serial"}
#: called as the program's option; the description states the unit
AS_THE_OPTION = {"arw": "in deg/sqrt(h)", "white": "in mg/sqrt(Hz)", "instability": "in dph (accelerometers: mg) and its time constant in s"}


def section(text, title):
    """The lines of a numpydoc section, or None."""
    found = re.search(rf"^{title}\n-{{{len(title)}}}\n(.*?)(?=^\w[^\n]*\n---|\Z)", text, re.S | re.M)
    return found and found.group(1)


@pytest.mark.parametrize("name, function", {**FUNCTIONS, **METHODS}.items())
def test_every_parameter_is_described_with_its_unit(name, function):
    text = inspect.getdoc(function)
    wanted = [p for p in inspect.signature(function).parameters if p != "self"]
    described = []
    for line in re.findall(r"^(\w[\w, ]*?) :", section(text, "Parameters") or "", re.M):
        described += line.split(", ")
    assert described == wanted
    assert section(text, "Returns").strip()
    for parameter in wanted:
        stated = AS_THE_OPTION.get(parameter) and re.search(rf"^{parameter} : .*{re.escape(AS_THE_OPTION[parameter])}$", text, re.M)
        assert parameter.endswith(UNITS) or parameter in NO_UNIT or stated, f"{name}: {parameter} names no unit"


@pytest.mark.parametrize("name", ["compensate"])
def test_a_number_whose_unit_is_not_in_its_name_states_it(name):
    assert "in the channel's unit" in section(inspect.getdoc(FUNCTIONS[name]), "Parameters")


def test_stubs_name_what_the_package_and_its_compiled_part_have():
    stub = ast.parse((PACKAGE / "__init__.pyi").read_text())
    names = {a.asname for node in stub.body if isinstance(node, ast.ImportFrom) for a in node.names} | {"__version__"}
    assert names == set(imucal.__all__) | {"plot"}
    from imucal.native import core
    compiled = ast.parse((PACKAGE / "_core.pyi").read_text())
    found = {node.name: node for node in compiled.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    assert set(found) == {n for n in dir(core()) if not n.startswith("_")}
    for name in ("Filter", "Curve"):
        members = {getattr(n, "name", None) or n.target.id for n in found[name].body}
        assert members - {"__init__"} == {n for n in dir(getattr(core(), name)) if not n.startswith("_")}
    assert [a.arg for a in found["direct_predictor"].args.args] == re.findall(r"(\w+):", core().direct_predictor.__doc__.split("->")[0])


def test_stub_and_marker_are_installed_with_the_package():
    setup = (PACKAGE.parent / "pyproject.toml").read_text()
    assert "*.pyi" in setup and "py.typed" in setup and (PACKAGE / "py.typed").exists()
