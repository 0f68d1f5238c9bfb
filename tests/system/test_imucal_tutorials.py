# SPDX-License-Identifier: MIT
"""The tutorials' commands, run as they are printed, on files such as their readers have."""
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest

import foreign
from reference import NOISE as MODEL
from where import BIN, ROOT

PAGES = ROOT / "host/docs/tutorials"
TRUTH_DPH = np.array([[300.0, 40.0, -3.0], [-200.0, 25.0, 2.0], [90.0, -60.0, 1.0]])  # of T - 30 degC, per axis


def warm_up(duration_s=1500, rate_hz=10):
    """A board that warms from 5 to 40 degC on a table."""
    rng = np.random.default_rng(5)
    n = duration_s * rate_hz
    t = 20 + np.arange(n) / rate_hz
    temp = 42 - 37 * np.exp(-(t - 20) / 500)
    bias = np.stack([np.polynomial.polynomial.polyval(temp - 30, c) for c in TRUTH_DPH], axis=1)
    gyro = np.radians((bias + 36 * np.sqrt(rate_hz) * rng.standard_normal((n, 3))) / 3600)
    accel = np.array([0, 0, -9.8]) + 0.01 * rng.standard_normal((n, 3))
    return foreign.Recording(np.rint(t * 1e6).astype(np.int64), gyro.astype(np.float32), accel.astype(np.float32), temp.astype(np.float32), (0, 0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    import polars
    where = tmp_path_factory.mktemp("reader")
    rec = warm_up()
    foreign.write_ulog(where / "warmup.ulg", [rec])
    foreign.write_matlab(where / "log.mat", rec)
    dps = np.degrees(rec.gyro_radps.astype(float))
    table = polars.DataFrame({"time_ms": rec.t_us // 1000, "gx_dps": dps[:, 0], "gy_dps": dps[:, 1], "gz_dps": dps[:, 2], "temp": rec.temp_degc.astype(float)})
    table.write_csv(where / "freezer.csv")
    for name in ("model.json", "type.json"):
        (where / name).write_text(json.dumps(MODEL))
    for name in ("run.csv", "unit-0017.csv"):
        subprocess.run([BIN / "imucal", "import", "freezer.csv", "-o", name, "-q"], cwd=where, check=True)
    return where


def commands(page):
    """The shell commands of a page, as printed."""
    text = (PAGES / page).read_text()
    return [line for block in re.findall(r"```sh\n(.*?)```", text, re.S) for line in block.strip().splitlines()]


def follow(page, folder):
    printed = commands(page)
    assert 1 <= len(printed) <= 2
    for command in printed:
        done = subprocess.run(["sh", "-c", command], cwd=folder, capture_output=True, text=True,
                              env={**os.environ, "PATH": f"{BIN}:{os.environ['PATH']}"})
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"


def test_embedded_engineer_gets_a_header_that_knows_the_bias(folder):
    follow("embedded.md", folder)
    (folder / "main.c").write_text('#include <stdio.h>\n#include "cal.h"\nint main(void) { printf("%g %g", (double)cal_gx_bias(20.0f), '
                                   '(double)cal_gx_bias_fixed(20000) / (1 << CAL_GX_FRAC_BITS)); return 0; }\n')
    subprocess.run(["cc", "-std=c99", "-Wall", "-Werror", "-Wno-unused-function", "main.c", "-o", "main"], cwd=folder, check=True)
    values = [float(v) for v in subprocess.run([folder / "main"], capture_output=True, text=True, check=True).stdout.split()]
    truth = np.polynomial.polynomial.polyval(-10, TRUTH_DPH[0])
    assert abs(values[0] - values[1]) < 0.01 and abs(values[0] - truth) < 25


def test_drone_builder_gets_parameters_that_hold_the_bias(folder):
    follow("drone.md", folder)
    params = {r[2]: float(r[3]) for r in (line.split("\t") for line in (folder / "thermal.params").read_text().splitlines() if line[0] != "#")}
    assert params["TC_G0_ID"] == 1000 and params["TC_G_ENABLE"] == 1
    for axis in range(3):
        powers = [params[f"TC_G0_X{k}_{axis}"] for k in range(4)]
        for temp in (10, 25, 38):
            found = np.degrees(np.polynomial.polynomial.polyval(temp - params["TC_G0_TREF"], powers)) * 3600
            assert abs(found - np.polynomial.polynomial.polyval(temp - 30, TRUTH_DPH[axis])) < 25


def test_production_engineer_gets_a_valid_table_and_figures(folder):
    follow("production.md", folder)
    axes = json.loads((folder / "unit-0017.fit.json").read_text())["axes"]
    assert len(axes) == 3 and all(a["residual_rms_dph"] < 60 and max(a["sigma_dph"]) < 100 for a in axes)


def test_researcher_gets_the_noise_from_matlab_and_from_python(folder):
    follow("researcher.md", folder)
    assert json.loads((folder / "noise.json").read_text())["arw_deg_rt_h"] == pytest.approx(0.6, rel=0.1)
    code = re.search(r"```python\n(.*?)```", (PAGES / "researcher.md").read_text(), re.S).group(1)
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True,
                          env={**os.environ, "PYTHONPATH": str(ROOT / "host/python"), "IMUCAL_BIN": str(BIN)})
    assert done.returncode == 0, done.stderr
    assert abs(float(re.search(r"ARW ([0-9.]+)", done.stdout).group(1)) - 0.6) < 0.06


def test_maker_gets_a_page_and_a_table(folder):
    follow("maker.md", folder)
    assert b"data:image/png" in (folder / "freezer.html").read_bytes()
    axes = json.loads((folder / "table.json").read_text())["axes"]
    assert [a["order"] for a in axes] == [2, 2, 2]
