# SPDX-License-Identifier: MIT
"""Recorded logs: the judge on made-up answers (always), and with IMUCAL_RECORDED=1 the rows that must hold on the built program."""
import os

import pytest

from recorded import __main__ as command
from recorded import judge, table
from where import BIN

ROW = {r.row: r for r in table.ROWS}


def answer(axis, *effects, verdict="explained", gap=None, indistinguishable=()):
    """effects: (name, members of its set)."""
    out = [{"name": n, "set": [{"name": m} for m in members]} for n, members in effects]
    return {"status": 0, "diagnosis": {"axes": [{"axis": axis, "verdict": verdict, "effects": out, "gap": gap or {},
                                                "indistinguishable": list(indistinguishable)}]}}


@pytest.mark.parametrize("effects, holds", [
    ([("thermal_memory", ["thermal_hysteresis", "thermal_lag"])], True), ([("thermal_hysteresis", ["thermal_hysteresis"])], True),
    ([("telegraph_noise", ["telegraph_noise"])], False), ([], False),
    ([("thermal_hysteresis", ["thermal_hysteresis"]), ("temperature_rate", [])], False)])
def test_loop_needs_a_memory_and_no_rate(effects, holds):
    assert judge.judge(ROW["gx-loop"], {"a": answer("gx_dph", *effects)})["holds"] is holds


@pytest.mark.parametrize("said, holds", [
    (answer("gy_dph", ("slow_noise", ["flicker_noise", "thermal_hysteresis"])), True),
    (answer("gy_dph", indistinguishable=[["thermal_memory", "slow_noise"]], verdict="unexplained"), True),
    (answer("gy_dph", ("outliers", []), ("slow_noise", ["slow_noise", "thermal_hysteresis"])), False),
    (answer("gy_dph", ("thermal_hysteresis", ["thermal_hysteresis"])), False), (answer("gy_dph", verdict="no_gap"), False)])
def test_what_a_log_cannot_tell_must_be_left_open(said, holds):
    assert judge.judge(ROW["gy-open"], {"a": said})["holds"] is holds


def test_invariance_looks_at_the_first_cause_and_not_at_retuned_noise():
    memory = ("thermal_hysteresis", [])
    same = {"a": answer("gx_dph", memory), "b": answer("gx_dph", ("noise_parameters", []), memory)}
    other = {**same, "c": answer("gx_dph", ("thermal_lag", []))}
    assert judge.judge(ROW["gx-invariant"], same)["holds"]
    assert not judge.judge(ROW["gx-invariant"], other)["holds"]


@pytest.mark.parametrize("shrinkage, before, after, holds", [(1.0, 210, 1875, False), (0.98, 190, 190, False), (0.9, 200, 60, True), (None, 200, 300, True)])
def test_a_claim_must_show_in_the_residual(shrinkage, before, after, holds):
    gap = {"shrinkage": shrinkage, "residual_rms_dph": {"before": before, "after": after}}
    assert judge.judge(ROW["gx-honest"], {"a": answer("gx_dph", ("thermal_lag", []), gap=gap)})["holds"] is holds


def test_a_failed_run_fails_its_rows():
    assert not judge.judge(ROW["gx-loop"], {"a": {"status": 3, "error": "no"}})["holds"]


def test_missing_data_is_a_loud_skip(tmp_path, capsys):
    tool = tmp_path / "tool"
    tool.write_text("#!/bin/sh\n")
    tool.chmod(0o755)
    status = command.main(["--data", str(tmp_path), "--diagnose", str(tool), "--errormodel", str(tool), "--out", str(tmp_path / "out")])
    said = capsys.readouterr()
    assert status == 0 and said.err.count("SKIP") == 3 and "0 of 0 rows hold" in said.out


def test_every_row_that_must_hold_exists():
    assert set(table.MUST_HOLD) <= set(ROW)


def failing(tmp_path, *options):
    args = command.arguments(["--diagnose", f"{BIN}/diagnose", "--errormodel", f"{BIN}/errormodel", "--out", str(tmp_path), *options])
    results, _ = command.run(args)
    if not results:
        pytest.skip(f"SKIP: no recorded logs in {args.data}")
    return {r["row"]: r["complaints"] for r in results if r["row"] in table.MUST_HOLD and not r["holds"]}


def test_chamber_log_without_any_believed_noise(tmp_path):
    """The short form that always runs: one diagnosis of one log."""
    assert failing(tmp_path, "--rows", "g", "--quick") == {}


@pytest.mark.skipif(os.environ.get("IMUCAL_RECORDED") != "1", reason="SKIP: set IMUCAL_RECORDED=1 to hold the program to recorded logs")
def test_rows_that_must_hold_on_the_built_program(tmp_path):
    assert failing(tmp_path) == {}
