# SPDX-License-Identifier: MIT
"""The short form of `make sick`: every fault, and healthy runs of every kind."""
import pytest

from sick import device, healthy, offline
from sick.case import Bench
from where import BIN


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    return Bench(tmp_path_factory.mktemp("sick"), BIN)


def test_there_are_at_least_60_faults():
    assert len(offline.FAULTS) >= 60 and len({f.name for f in offline.FAULTS}) == len(offline.FAULTS)


@pytest.mark.parametrize("fault", offline.FAULTS, ids=lambda f: f"{f.area}: {f.name}")
def test_fault_is_found_and_makes_no_table(bench, fault):
    outcome = fault.inject(bench)
    assert fault.is_safe(outcome) and fault.is_found(outcome), (fault.found_by, outcome)
    assert "internal error" not in outcome.message and "out of memory" not in outcome.message


@pytest.fixture(scope="module")
def device_bench(tmp_path_factory):
    return device.DeviceBench(tmp_path_factory.mktemp("sick_devices"))


@pytest.mark.parametrize("fault", device.FAULTS, ids=lambda f: f"{f.area}: {f.name}")
def test_fault_is_found_by_the_device_and_flashes_nothing(device_bench, fault):
    outcome = fault.inject(device_bench)
    assert fault.is_safe(outcome) and fault.is_found(outcome), (fault.found_by, outcome)


def test_healthy_runs_on_the_device_pass(device_bench):
    assert device.campaign(device_bench, 3) == []


def test_healthy_runs_are_of_every_profile_of_make_validation(bench):
    names = [name for name, *_ in healthy.kinds(bench)]
    for profile in ("ramp", "ramp and 20-min soaks", "freezer warm-up", "up and down"):
        assert profile in names and f"{profile}, 1 degC thermometer" in names
    assert len(set(names)) == len(names) == 8 + len(healthy.OWN)


def test_healthy_runs_of_every_kind_pass(bench):
    runs = healthy.campaign(bench, 2 * len(healthy.kinds(bench)))
    assert len({kind for kind, _ in runs}) == len(runs) // 2
    assert [run for run in runs if run[1]] == []
