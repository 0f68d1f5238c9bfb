# SPDX-License-Identifier: MIT
"""The predicted calibration error of reference figures A, tests/README.md (paper, Figs. 7-9), learned by the filter on an emulated Cortex-M4F
and reported by `calibrate run`: within 1 %.  The figures come from an exact covariance in double, not from this code."""
import pytest

from imu import Imu, QemuImu
from reference import BASIC

RAMP = [13.09, 7.47, 6.20, 6.45, 6.29, 5.75, 5.43, 5.75, 6.29, 6.45, 6.20, 7.47, 13.09]  # at 0, 5, .. 60 degC


def soaked(minutes):
    soak = [{"rate_degc_per_min": 0, "duration_s": 60 * minutes}] if minutes else []
    return {"imucal_profile": 1, "start_degc": 0, "segments": [*soak, {"rate_degc_per_min": 0.6, "to_degc": 60}, *soak]}


def alternating(n):
    """The basic profile n times, up and down in turn."""
    soak = {"rate_degc_per_min": 0, "duration_s": 1200}
    ends = [60, 0] * n
    return {"imucal_profile": 1, "start_degc": 0,
            "segments": [s for end in ends[:n] for s in (soak, {"rate_degc_per_min": 0.6, "to_degc": end}, soak)]}


@pytest.fixture(scope="module")
def m4f(tmp_path_factory):
    # The covariance does not depend on data or rate: ten samples a second will do.
    device = QemuImu(tmp_path_factory.mktemp("m4f"), options=["rate=10", "channels=1"])
    yield device
    device.close()


def predicted(imu, profile):
    """{temperature: sigma} of the run, at every degree."""
    imu.sense(profile, axes=1, options=["--rate-hz", "10"])
    axis = imu.run("--range", "0:60")["axes"][0]
    return dict(zip((round(t, 6) for t in axis["curve"]["temp_degc"]), axis["curve"]["sigma_dph"]))


def test_m4f_ramp_only_figure_7(m4f):
    sigma = predicted(m4f, soaked(0))
    assert [sigma[t] for t in range(0, 61, 5)] == pytest.approx(RAMP, rel=0.01)


@pytest.mark.parametrize("minutes, worst", [(5, 10.18), (10, 8.64), (20, 6.93), (30, 6.28)])
def test_m4f_soaks_figure_8(m4f, minutes, worst):
    assert max(predicted(m4f, soaked(minutes)).values()) == pytest.approx(worst, rel=0.01)


@pytest.mark.parametrize("cycles, worst", [(1, 6.93), (2, 5.03)])
def test_m4f_cycles_figure_9(m4f, cycles, worst):
    assert max(predicted(m4f, alternating(cycles)).values()) == pytest.approx(worst, rel=0.01)


def test_m4f_and_posix_learn_the_same_bits(m4f, tmp_path):
    """The whole chain from raw samples to the flashed table, on both: the same table, byte for byte of its content."""
    posix = Imu(tmp_path, options=["--rate", "10", "--channels", "1"])
    try:
        tables = []
        for imu in (m4f, posix):
            imu.sense(BASIC, axes=1, options=["--rate-hz", "10", "--jitter-s", "0.01", "--missing", "0.01"])
            imu.run("--range", "0:60")
            tables.append(imu.json("table.json")["axes"])
        assert tables[0] == tables[1]
    finally:
        posix.close()
