# SPDX-License-Identifier: MIT
"""`calibrate fit`: logs in, table and result out; bad input ends with the right status and its reason."""
import json
import os
import pathlib
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
BIN = (ROOT / os.environ.get("BUILD", "build") / "bin").resolve()
BIAS = [80, 300, 150, -100]
MODEL = {
    "imucal_model": 1,
    "arw_deg_rt_h": 0.6,
    "markov": [{"sigma_dph": 20, "tau_s": 100}],
    "bias": {"t0_degc": 30, "range_degc": 30, "coeff_dph": BIAS},
}
PROFILE = {
    "imucal_profile": 1,
    "start_degc": 0,
    "segments": [
        {"rate_degc_per_min": 0, "duration_s": 1200},
        {"rate_degc_per_min": 0.6, "to_degc": 60},
        {"rate_degc_per_min": 0, "duration_s": 1200},
    ],
}


def run(*arguments):
    return subprocess.run([str(a) for a in arguments], capture_output=True, text=True, timeout=60)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("fit")
    (path / "model.json").write_text(json.dumps(MODEL))
    (path / "profile.json").write_text(json.dumps(PROFILE))
    for seed in (1, 2):
        result = run(BIN / "gyrosim", "log", "--model", path / "model.json", "--profile", path / "profile.json",
                     "--axes", 2, "--seed", seed, "-o", path / f"log{seed}.csv")
        assert result.returncode == 0, result.stderr
    return path


def truth(axis, temp):
    tn = (temp - 30) / 30
    return sum(b * tn**i for i, b in enumerate(BIAS))


@pytest.mark.parametrize("method", ["kf", "poly"])
@pytest.mark.parametrize("logs", [[1], [1, 2]])
def test_fit_gives_contract_fields_and_predicted_error(folder, method, logs):
    out, table = folder / "out.json", folder / "table.json"
    result = run(BIN / "calibrate", "fit", *[folder / f"log{i}.csv" for i in logs], "--method", method, "--order", 3,
                 "--model", folder / "model.json", "-o", table, "--json", out)
    assert result.returncode == 0, result.stderr
    axes = json.loads(out.read_text())["axes"]
    assert [a["axis"] for a in axes] == ["gx_dph", "gy_dph"]
    for axis in axes:
        assert (axis["order"], axis["t0_degc"], axis["range_degc"]) == (3, 30, 30)
        assert len(axis["coeff_dph"]) == 4 and len(axis["sigma_dph"]) == len(axis["temp_degc"])
        # design 2.3: 6.93 dph for one log; with a constant of its own per log the mean over two is 1/sqrt(2) of it
        assert max(axis["sigma_dph"]) == pytest.approx(6.93 / len(logs) ** 0.5, rel=0.03)
        assert axis["residual_rms_dph"] == pytest.approx(41.2, rel=0.06)
    written = json.loads(table.read_text())
    assert written["axes"][0]["coeff_dph"] == pytest.approx(axes[0]["coeff_dph"], rel=1e-6)


def test_both_methods_agree_below_3_dph(folder):  # paper, Fig. 14
    coefficients = {}
    for method in ("kf", "poly"):
        result = run(BIN / "calibrate", "fit", folder / "log1.csv", "--method", method, "--model", folder / "model.json", "--json", "-")
        coefficients[method] = json.loads(result.stdout)["axes"][0]["coeff_dph"]
    for k in range(61):
        tn = (k - 30) / 30
        difference = sum((a - b) * tn**i for i, (a, b) in enumerate(zip(coefficients["kf"], coefficients["poly"])))
        assert abs(difference) < 3


def edited(folder, name, change):
    lines = (folder / "log1.csv").read_text().splitlines()
    header = next(i for i, line in enumerate(lines) if line.startswith("t_s"))
    path = folder / name
    path.write_text("\n".join(change(lines, header)) + "\n")
    return path


def still(lines, header):
    return lines[: header + 1] + [f"{i},20,1,1" for i in range(1, 500)]


def with_text(lines, header):
    lines[header + 5] = "5,warm,1,1"
    return lines


def with_gap(lines, header):
    return lines[: header + 1000] + lines[header + 1600 :]


def test_bad_input_ends_with_status_3_and_its_reason(folder):
    model = ["--model", folder / "model.json"]
    cases = [
        ([edited(folder, "still.csv", still), *model], 3, "never moves"),
        ([edited(folder, "text.csv", with_text), *model], 3, "warm"),
        ([folder / "absent.csv", *model], 3, "absent.csv"),
        ([folder / "log1.csv"], 2, "--model"),
        ([folder / "log1.csv", "--order", 6, *model], 2, "order"),
        ([folder / "log1.csv", "--axis", "gq_dph", *model], 3, "gq_dph"),
        ([folder / "log1.csv", "--range", "60:0", *model], 2, "60:0"),
        ([folder / "log1.csv", "--serial", "two words", "-o", folder / "x.json", *model], 3, "two words"),
    ]
    for arguments, status, reason in cases:
        result = run(BIN / "calibrate", "fit", *arguments)
        assert result.returncode == status, (arguments, result.stderr)
        assert reason in result.stderr, result.stderr
    assert not (folder / "x.json").exists()


def test_a_gap_in_the_log_is_bridged(folder):
    result = run(BIN / "calibrate", "fit", edited(folder, "gap.csv", with_gap), "--model", folder / "model.json", "--json", "-")
    assert result.returncode == 0, result.stderr
    axis = json.loads(result.stdout)["axes"][0]
    assert axis["n_missing"] == 600
    for temp in range(0, 61, 5):
        got = sum(b * ((temp - 30) / 30) ** i for i, b in enumerate(axis["coeff_dph"]))
        assert abs(got - truth(axis, temp)) < 5 * max(axis["sigma_dph"])


def test_raw_log_is_decimated(folder):
    path = folder / "raw.csv"
    rows = ["# rate_hz = 10", "# gx_counts_scale_dph = 18", "t_s,temp_degc,gx_counts"]
    rows += [f"{k / 10 + 0.05:.2f},{k / 100:.2f},{round((100 + k / 10) / 18)}" for k in range(6000)]
    path.write_text("\n".join(rows) + "\n")
    result = run(BIN / "calibrate", "fit", path, "--method", "poly", "--order", 1, "--range", "0:60", "--json", "-")
    assert result.returncode == 0, result.stderr
    axis = json.loads(result.stdout)["axes"][0]
    assert axis["axis"] == "gx_dph" and axis["n_used"] == 600
    assert axis["coeff_dph"] == pytest.approx([400, 300], abs=1)
