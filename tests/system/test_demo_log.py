# SPDX-License-Identifier: MIT
"""`make demo LOG=...`: a recorded log replayed into the firmware in QEMU; a good one ends in a table and figures, a sick one is
refused with its rule and the way to insist."""
import json
import subprocess
import sys

import numpy as np
import pytest

import imucal
from reference import MODEL, soaked_ramp
from where import BIN, BUILD, ROOT

PROFILE = soaked_ramp(600, 1.2)


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A recording of two axes, another of the same device, and the first with an axis that jumps by 3000 dph in its middle."""
    path = tmp_path_factory.mktemp("demo_logs")
    (path / "model.json").write_text(json.dumps(MODEL))
    (path / "chamber.json").write_text(json.dumps(PROFILE))
    for index, name in enumerate(("good.csv", "other.csv")):
        subprocess.run([BIN / "gyrosim", "log", "--model", "model.json", "--profile", "chamber.json", "--axes", "2", "--log-index", str(index),
                        "-o", name, "-q"], cwd=path, check=True)
    lines = (path / "good.csv").read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("t_s"))
    for i in range(at + 1 + 2000, len(lines)):
        fields = lines[i].split(",")
        fields[2] = f"{float(fields[2]) + 3000:.4f}"
        lines[i] = ",".join(fields)
    (path / "jump.csv").write_text("\n".join(lines) + "\n")
    return path


def demo(tmp_path, *arguments):
    for name in ("bin", "firmware"):
        (tmp_path / name).symlink_to(BUILD / name)
    return subprocess.run([sys.executable, ROOT / "host/scripts/demo.py", "--build", tmp_path, *map(str, arguments)], capture_output=True, text=True,
                          timeout=300)


def figures(text):
    """{axis: [bias travel, rms before, rms after, …]}"""
    rows = [line.split() for line in text.splitlines() if line.startswith(("gx_dph ", "gy_dph "))]
    return {row[0]: [float(v) for v in row[1:] if v.replace(".", "").replace("-", "").isdigit()] for row in rows if len(row) > 4 and row[1][0].isdigit()}


def test_good_log_ends_in_a_table_and_its_figures(tmp_path, logs):
    out = demo(tmp_path, "--log", logs / "good.csv", "--check-log", logs / "other.csv")
    assert out.returncode == 0, out.stdout + out.stderr
    assert "flashed on DEMO-2, read back and verified" in out.stdout
    found = figures(out.stdout)
    assert set(found) == {"gx_dph", "gy_dph"}, out.stdout
    table = json.loads((tmp_path / "demo/table.json").read_text())
    for axis in table["axes"]:
        truth = MODEL["bias"]["coeff_dph"]
        assert abs(axis["coeff_dph"][1] - truth[1]) < 40, axis["coeff_dph"]
        travel, before, after = found[axis["axis"]][:3]
        assert travel > 300 and after < 30 < 100 < before, found
    assert (tmp_path / "demo/calibration.png").read_bytes()[:4] == b"\x89PNG"
    for run, recording in (("before.csv", "good.csv"), ("again_raw.csv", "other.csv")):  # learned from the one, shown on the other
        replayed, recorded = imucal.read_log(tmp_path / "demo" / run), imucal.read_log(logs / recording)
        for axis in found:  # ten samples a second of whole counts of 1 dph
            np.testing.assert_allclose(replayed.rates[axis], recorded.rates[axis], rtol=0, atol=0.1, err_msg=run)


def test_sick_log_is_refused_with_its_rule_and_the_way_to_insist(tmp_path, logs):
    out = demo(tmp_path, "--log", logs / "jump.csv")
    assert out.returncode == 1, out.stdout + out.stderr
    reasons = [r for r in json.loads((tmp_path / "demo/run.json").read_text())["judgement"]["reasons"] if not r.get("accepted")]
    rules = sorted({r["rule"] for r in reasons})
    assert rules and all(r["axis"] == "gx_dph" for r in reasons)
    assert f"make demo LOG=... ACCEPT=\"{' '.join(rules)}\"" in out.stderr
    assert any(rules[0] in line and "gx_dph" in line for line in (out.stdout + out.stderr).splitlines())
    assert "flashed on" not in out.stdout and not (tmp_path / "demo/table.json").exists()
    again = tmp_path / "again"
    again.mkdir()
    assert demo(again, "--log", logs / "jump.csv", "--accept", " ".join(rules)).returncode == 0
    assert (again / "demo/table.json").exists()


def test_log_that_cannot_be_replayed_is_refused_with_the_remedy(tmp_path, logs):
    (logs / "no_gyro.csv").write_text("t_s,temp_degc,ax_mg\n" + "".join(f"{i},{20 + i / 60:.2f},{1000 + i % 7}\n" for i in range(1200)))
    out = demo(tmp_path, "--log", logs / "no_gyro.csv")
    assert out.returncode == 3 and "no_gyro.csv: no column ending in _dph; imucal import" in out.stderr


def test_make_passes_on_what_the_reader_says():
    out = subprocess.run(["make", "-n", "demo", "LOG=mine.csv", "CHECK=other.csv", "ORDER=2", "ACCEPT=nis slow", "V=1"], cwd=ROOT, capture_output=True,
                         text=True, timeout=120)
    line = next(line for line in out.stdout.splitlines() if "demo.py" in line)
    for part in ("--log mine.csv", "--check-log other.csv", "--order 2", "nis slow"):
        assert part in line.replace('"', "").replace("'", ""), line
