# SPDX-License-Identifier: MIT
"""`imucal look`: figures against simulated truth, the page, and what it says of sick logs."""
import io
import json
import os
import re
import resource
import struct
import subprocess
import sys

import numpy as np
import pytest

import foreign
from imucal.__main__ import main
from imucal.firstlook import allan_deviation_of, lattice_of, look_at_axis
from imucal.log import Log, write_log
from imucal.plot import _shown
from where import DATA, ROOT


def simulated(seed=1, n=8400, up_and_down=True, loop_dph=0.0, arw=0.6, sigma=20.0, tau_s=100.0):
    rng = np.random.default_rng(seed)
    t = np.arange(1, n + 1.0)
    phase = np.abs((2 * t / n) % 2 - 1) if up_and_down else 1 - t / n
    temp = 60 * (1 - phase)
    tn = (temp - 30) / 30
    phi = np.exp(-1 / tau_s)
    slow = np.zeros(n)
    drive = rng.standard_normal(n)
    slow[0] = sigma * drive[0]
    for k in range(1, n):
        slow[k] = phi * slow[k - 1] + sigma * np.sqrt(1 - phi ** 2) * drive[k]
    rate = 80 + 300 * tn + 150 * tn ** 2 - 100 * tn ** 3 + slow + 60 * arw * rng.standard_normal(n)
    rate += loop_dph * np.sign(np.gradient(temp)) * (1 - tn ** 2)
    return Log(t, temp, {"gx_dph": rate}, {}, {}, "simulated")


def test_noise_read_off_lies_near_the_truth():
    looks = [look_at_axis(simulated(seed), "gx_dph") for seed in range(8)]
    assert np.mean([k.arw_deg_rt_h for k in looks]) == pytest.approx(0.6, rel=0.02)
    assert np.mean([k.slow_sigma for k in looks]) == pytest.approx(18, rel=0.15)  # 61-s smoothing takes some of 20 dph
    assert 60 < np.mean([k.slow_tau_s for k in looks]) < 160


def test_allan_deviation_of_white_noise_falls_with_the_root_of_tau_and_leaves_gaps_out():
    rng = np.random.default_rng(3)
    grid = 10 * rng.standard_normal(20000)
    grid[5000:5300] = np.nan
    tau, adev, ci95 = allan_deviation_of(grid)
    np.testing.assert_allclose(adev[:7], 10 / np.sqrt(tau[:7]), rtol=0.06)
    brute = np.sqrt(0.5 * np.nanmean((grid[1:] - grid[:-1]) ** 2))
    assert adev[0] == pytest.approx(brute, rel=1e-3)
    assert np.all((ci95[:, 0] < adev) & (adev < ci95[:, 1])) and len(grid) / tau[-1] >= 9


@pytest.mark.parametrize("seed", range(3))
def test_loop_is_suspected_where_there_is_one_and_only_there(seed):
    assert look_at_axis(simulated(seed, loop_dph=60), "gx_dph").loop_share > 0.5
    assert look_at_axis(simulated(seed), "gx_dph").loop_share < 0.5
    assert look_at_axis(simulated(seed, up_and_down=False, loop_dph=60), "gx_dph").loop_share == 0


def test_lattice_is_the_step_of_a_coarse_value():
    rng = np.random.default_rng(1)
    assert lattice_of(0.25 * np.round(rng.normal(0, 3, 5000))) == pytest.approx(0.25)
    assert lattice_of(rng.normal(0, 3, 5000)) == 0
    with_a_hole = np.array([0, 1, 2, 3, 4, 9])
    assert lattice_of(0.25 * rng.choice(with_a_hole, 5000)) == pytest.approx(0.25)
    assert lattice_of(rng.choice(rng.normal(0, 3, 40), 5000)) == 0  # few values, and no step between them


@pytest.mark.parametrize("n", [8400, 20000])
def test_one_wrong_second_is_one_outlier_is_said_and_is_drawn(n, tmp_path, capsys):
    """Its size is 40 times the noise: a mean of nine seconds carries it to its neighbours."""
    log = simulated(2, n)
    assert len(look_at_axis(log, "gx_dph").outlier_rows) == 0
    for place, size in ((n // 3 + 1, 1500.0), (n // 2 + 2, -1500.0)):
        log.rates["gx_dph"][place] += size
        assert place in _shown(log.rates["gx_dph"])
    assert look_at_axis(log, "gx_dph").outlier_rows.tolist() == [n // 3 + 1, n // 2 + 2]
    path = tmp_path / "wrong.csv"
    write_log(path, log)
    assert main(["look", str(path), "-o", str(tmp_path / "page.png"), "--no-ml"]) == 0
    assert "gx_dph 2 outliers beyond 6 sigma" in capsys.readouterr().out


def test_page_is_a_png_and_the_text_has_the_lines(tmp_path, capsys):
    write_log(tmp_path / "run.csv", simulated())
    assert main(["look", str(tmp_path / "run.csv"), "-o", str(tmp_path / "page.png"), "--no-ml", "--json", str(tmp_path / "j")]) == 0
    text = capsys.readouterr().out
    head = (tmp_path / "page.png").read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n" and struct.unpack(">II", head[16:24])[0] > 1000
    for word in ("140 min", "0.00 to 60.00 °C", "ARW 0.6", "gaps: none", "resolution: no steps seen", "suspected",
                 "next: imucal calibrate fit"):
        assert word in text
    result = json.loads((tmp_path / "j").read_text())
    assert len(result["axes"][0]["coeff"]) == 4 and result["axes"][0]["arw_deg_rt_h"] == pytest.approx(0.6, rel=0.05)


def test_likelihood_of_an_accelerometer_stands_beside_what_is_read_off(tmp_path, capsys):
    log = simulated(arw=0.6, sigma=20.0, tau_s=100.0)
    write_log(tmp_path / "run.csv", Log(log.t_s, log.temp_degc, {"az_mg": 1000 + 0.01 * log.rates["gx_dph"]}, {}, {}, "simulated"))
    assert main(["look", str(tmp_path / "run.csv"), "-o", str(tmp_path / "p.png"), "--json", str(tmp_path / "j")]) == 0
    line = next(k for k in capsys.readouterr().out.splitlines() if k.startswith("az_mg: noise"))
    said = r"most likely: noise of a 1-s mean ([\d.]+) ± \S+ mg, slow noise ([\d.]+) ± \S+ mg, ([\d.]+) ± \S+ s"
    white, sigma, tau = (float(v) for v in re.search(said, line).groups())
    assert white == pytest.approx(0.36, rel=0.03) and sigma == pytest.approx(0.2, rel=0.25) and 50 < tau < 200
    axis = json.loads((tmp_path / "j").read_text())["axes"][0]
    assert axis["unit"] == "mg" and 60 * axis["likelihood"]["arw_deg_rt_h"] == pytest.approx(white, rel=0.01)


SLOW_TO_LOAD = ("matplotlib.pyplot", "matplotlib.figure", "matplotlib.axes", "mpl_toolkits.mplot3d.axes3d", "polars", "scipy", "pandas", "h5py", "rosbags", "pyulog", "jsonschema")


def test_look_loads_nothing_it_does_not_need_and_is_quick(tmp_path):
    """2 s for a log of 140 min on a quiet machine; here processor time, with room for a machine that others use."""
    log = simulated()
    write_log(tmp_path / "run.csv", Log(log.t_s, log.temp_degc, {f"g{a}_dph": log.rates["gx_dph"] for a in "xyz"}, {}, {}, "simulated"))
    command = ["from imucal.__main__ import main", "import json, sys", "assert main(['look', 'run.csv', '-o', 'p.png', '-q']) == 0",
               "print(json.dumps(sorted(sys.modules)))"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-c", "\n".join(command)], cwd=tmp_path, capture_output=True, text=True, timeout=120,
                          env={**os.environ, "PYTHONPATH": str(ROOT / "host/python")})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.returncode == 0, done.stderr
    assert not set(SLOW_TO_LOAD) & set(json.loads(done.stdout))
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 6


def far_from_zero():
    """(log, looks) with ticks that are counted from an offset, and a likelihood."""
    log = simulated()
    log.rates["gx_dph"] = log.rates["gx_dph"] + 5e6
    look = look_at_axis(log, "gx_dph")
    look.ml, look.expected = {"arw_deg_rt_h": 0.6, "sigma_dph": 20.0, "tau_s": 100.0}, 1.1 * look.allan
    return log, [look]


def test_panels_have_the_limits_and_ticks_of_matplotlibs_axes():
    from imucal.plot import draw_row, look_page, subplots
    log, looks = far_from_zero()
    figure, axes = subplots(1, 5, size=(17, 2.7), dpi=80)
    draw_row(axes, log, looks[0])
    figure.canvas.draw()
    panels = [panel for panel in look_page(log, looks).panels if not panel.twin_of]
    assert len(panels) == len(axes)
    for panel, ax in zip(panels, axes):
        for scale, axis, name in zip(panel.scales(), (ax.xaxis, ax.yaxis), (panel.x_name, panel.y_name)):
            places, texts, offset = scale.ticks()
            low, high = axis.get_view_interval()
            np.testing.assert_allclose([scale.low, scale.high], [low, high], rtol=1e-9)
            assert texts and texts == [t.label1.get_text() for t in axis.get_major_ticks() if low <= t.get_loc() <= high]
            assert offset == axis.get_offset_text().get_text() and name == axis.get_label_text()
            np.testing.assert_allclose(places, [t for t in axis.get_majorticklocs() if low <= t <= high])
        assert panel.title == ax.get_title(loc="left")
    assert "e6" in panels[0].scales()[1].ticks()[2]
    assert len(panels[-1].curves) == 3  # measured, white, expected


def pixels(page):
    from PIL import Image
    return np.asarray(Image.open(io.BytesIO(page.png()))).astype(int)


def test_page_leaves_no_word_over_its_edge():
    from imucal.plot import look_page
    log, looks = far_from_zero()
    without = Log(log.t_s, np.full(len(log.t_s), np.nan), {"gx_dph": log.rates["gx_dph"] - 5e6 - 40000}, {}, {}, "simulated")
    for log, looks in ((log, looks), (without, [look_at_axis(without, "gx_dph")])):
        for rows in (1, 3, 6):
            picture = pixels(look_page(log, looks * rows))
            assert picture.min() < 100
            for edge in (picture[0], picture[-1], picture[:, 0], picture[:, -1]):
                assert edge.min() == 255


def test_panel_draws_where_its_scale_says_and_leaves_a_gap_where_there_is_no_value():
    from imucal.plot.page import Page
    page = Page(4, 3)
    panel = page.panel(0.2, 0.2, 0.9, 0.9)
    panel.plot([0, 1, 2, 3, 4, 5], [1, 1, np.nan, np.nan, 1, 1], color="#ff0000", lw=3)
    panel.plot([2.5], [3], ".", color="#00ff00", ms=20)
    picture = pixels(page)
    left, bottom, right, top = (0.2 * 320, 0.2 * 240, 0.9 * 320, 0.9 * 240)  # 80 pixels an inch

    def colour_at(x_value, y_value):  # data from 0 to 5 and 1 to 3, and a twentieth on each side
        x, y = left + (x_value + 0.25) / 5.5 * (right - left), bottom + (y_value - 0.9) / 2.2 * (top - bottom)
        return list(picture[239 - int(y), int(x)])
    assert colour_at(0.5, 1) == colour_at(4.5, 1) == [255, 0, 0] and colour_at(2.5, 3) == [0, 255, 0]
    assert colour_at(2.5, 1) != [255, 0, 0]
    assert np.array_equal(pixels(page), picture)  # drawn again


@pytest.mark.parametrize("values", [[], [np.nan], [5.0], [0.0, 0.0]])
def test_panel_of_one_value_or_none_has_limits(values):
    from imucal.plot.page import Page
    for is_log in (False, True):
        panel = Page(2, 2).panel(0.1, 0.1, 0.9, 0.9)
        (panel.loglog if is_log else panel.plot)(values, values, color="k")
        assert all(scale.low < scale.high and np.isfinite([scale.low, scale.high]).all() for scale in panel.scales())
        panel.page.png()


def test_import_of_matplotlib_is_left_as_it_was():
    """What look leaves out while it loads is there for everybody else."""
    code = ["from imucal import plot", "plot.loading.load_renderer()", "plot.subplots()", "from matplotlib import artist, lines", "assert artist.kwdoc(lines.Line2D)",
            "import mpl_toolkits.mplot3d.axes3d, matplotlib.figure", "matplotlib.figure.Figure().add_subplot()"]
    done = subprocess.run([sys.executable, "-c", "\n".join(code)], capture_output=True, text=True, timeout=120,
                          env={**os.environ, "PYTHONPATH": str(ROOT / "host/python")})
    assert done.returncode == 0, done.stderr


def test_accelerometer_is_read_in_mg_with_gravity_stated(tmp_path, capsys):
    log = simulated()
    write_log(tmp_path / "run.csv", Log(log.t_s, log.temp_degc, {"az_mg": 1000 + 0.01 * log.rates["gx_dph"]}, {}, {}, "simulated"))
    assert main(["look", str(tmp_path / "run.csv"), "-o", str(tmp_path / "p.png")]) == 0
    text = capsys.readouterr().out
    assert "hold gravity as it lay" in text and "noise of a 1-s mean 0.3" in text
    assert "dph" not in text and "deg/" not in text


def test_look_at_a_foreign_log_without_temperature_leaves_the_thermal_panels_out(tmp_path, capsys):
    foreign.write_ulog(tmp_path / "f.ulg", [foreign.recording(duration_s=200)], temperature=False)
    assert main(["look", str(tmp_path / "f.ulg"), "-o", str(tmp_path / "p.html"), "--no-ml"]) == 0
    text = capsys.readouterr().out
    assert "px4-ulog" in text and "no temperature" in text and "moving: 5 s left out" in text and "imucal import" in text
    assert b"data:image/png;base64," in (tmp_path / "p.html").read_bytes()


def test_too_short_a_log_and_a_folder_that_is_not_there_are_refused(tmp_path, capsys):
    foreign.write_ulog(tmp_path / "f.ulg", [foreign.recording(duration_s=35)])
    assert main(["look", str(tmp_path / "f.ulg"), "-o", str(tmp_path / "p.png")]) == 3
    assert "too short" in capsys.readouterr().err
    write_log(tmp_path / "run.csv", simulated(n=400))
    assert main(["look", str(tmp_path / "run.csv"), "--no-ml", "-o", str(tmp_path / "none/p.png")]) == 3
    assert "none/p.png: cannot write: No such file or directory; does the folder exist?" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["page.jpg", "page", "-"])
def test_a_page_of_another_kind_than_its_name_says_is_a_usage_error(tmp_path, name, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_log("run.csv", simulated(n=400))
    assert main(["look", "run.csv", "--no-ml", "-o", name]) == 2
    assert f"-o {name}: expected a name that ends in .png, .html" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["run.csv"]


def test_an_axis_named_twice_is_looked_at_once(tmp_path, capsys):
    write_log(tmp_path / "run.csv", simulated(n=3000))
    assert main(["look", str(tmp_path / "run.csv"), "-o", str(tmp_path / "p.png"), "--axis", "gx_dph", "--axis", "gx_dph"]) == 0
    text = capsys.readouterr().out
    assert text.count("gx_dph: noise from the plots") == 1 and "taken twice" not in text and "refused" not in text


def test_axes_that_the_page_has_no_room_for_are_said(tmp_path, capsys):
    log = simulated(n=400)
    log.rates = {f"g{k}_dph": log.rates["gx_dph"] + 10 * np.random.default_rng(k).standard_normal(400) for k in range(8)}
    write_log(tmp_path / "run.csv", log)
    assert main(["look", str(tmp_path / "run.csv"), "-o", str(tmp_path / "p.png"), "--no-ml"]) == 0
    said = capsys.readouterr()
    assert "g5_dph: noise" in said.out and "g6_dph: noise" not in said.out
    assert "run.csv: a page has room for six axes: g6_dph, g7_dph left out; choose with --axis" in said.err


def test_recorded_loop_of_the_chamber_log_is_suspected(tmp_path, capsys):
    path = DATA / "chamber.csv"
    if not path.exists():
        pytest.skip("chamber.csv is not beside the project (../shared/data)")
    main(["look", str(path), "-o", str(tmp_path / "p.png"), "--no-ml", "--axis", "gx_dph"])
    text = capsys.readouterr().out
    assert "gx_dph a loop" in text and "imucal diagnose" in text


# --- sick logs ---

def looked(tmp_path, capsys, log, *options):
    """(lines, JSON) of a look at a Log."""
    write_log(tmp_path / "run.csv", log)
    assert main(["look", str(tmp_path / "run.csv"), "-o", str(tmp_path / "p.png"), "--no-ml", "--json", str(tmp_path / "j"), *options]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    return said.out.splitlines(), json.loads((tmp_path / "j").read_text())


def line_of(lines, head):
    """All lines with this head, as one."""
    return "; ".join(line for line in lines if line.startswith(head))


def with_axes(log, **rates):
    return Log(log.t_s, log.temp_degc, {f"{name}_dph": values for name, values in rates.items()}, {}, {}, "simulated")


@pytest.mark.parametrize("value", [12.5, 0.0, -1e6])
def test_axis_that_never_changes_is_said_and_nothing_is_read_off_it(tmp_path, capsys, value):
    log = simulated(n=2000)
    lines, result = looked(tmp_path, capsys, with_axes(log, gx=np.full(2000, value), gy=log.rates["gx_dph"]))
    assert f"gx_dph never changes: {value:g} dph in every second" in line_of(lines, "suspected")
    assert "gx_dph a" not in line_of(lines, "suspected") and not [line for line in lines if line.startswith("gx_dph: noise")]
    assert "--axis gy_dph" in line_of(lines, "next") and "gx_dph" not in line_of(lines, "next")
    assert result["axes"][0]["is_constant"] and not result["axes"][1]["is_constant"]
    lines, _ = looked(tmp_path, capsys, with_axes(log, gx=np.full(2000, value)))
    assert "never changes" in line_of(lines, "suspected") and "record again" in line_of(lines, "next") and "calibrate" not in line_of(lines, "next")


@pytest.mark.parametrize("lattice_dph", [0, 18, 200])
def test_axis_that_is_frozen_for_a_part_is_said(tmp_path, capsys, lattice_dph):
    """In steps of many times the noise a long run of one value is no wonder."""
    log = simulated(n=4000)
    rate = log.rates["gx_dph"] if not lattice_dph else lattice_dph * np.round(log.rates["gx_dph"] / lattice_dph)
    lines, result = looked(tmp_path, capsys, with_axes(log, gx=rate))
    assert "frozen" not in line_of(lines, "suspected") and result["axes"][0]["frozen_s"] == 0
    if lattice_dph == 200:
        return
    frozen = rate.copy()
    frozen[2000:3000] = frozen[2000]
    lines, result = looked(tmp_path, capsys, with_axes(log, gx=frozen))
    assert "gx_dph is frozen for 100" in line_of(lines, "suspected") and 1000 <= result["axes"][0]["frozen_s"] < 1020
    assert "record again" in line_of(lines, "next")


def test_temperatures_that_no_sensor_has_are_said(tmp_path, capsys):
    log = simulated(n=2000)
    swapped = Log(log.t_s, np.clip(log.rates["gx_dph"], -270, None), {"gx_dph": log.temp_degc}, {}, {}, "simulated")
    lines, _ = looked(tmp_path, capsys, swapped)
    assert "temp_degc" in line_of(lines, "suspected") and "swapped" in line_of(lines, "suspected") and "temp_degc" in line_of(lines, "next")
    kelvin = Log(log.t_s, log.temp_degc + 273.15, log.rates, {}, {}, "simulated")
    assert "kelvin" in line_of(looked(tmp_path, capsys, kelvin)[0], "suspected")
    assert "temp_degc" not in line_of(looked(tmp_path, capsys, log)[0], "suspected")


def test_two_axes_of_one_and_the_same_record_are_said(tmp_path, capsys):
    log = simulated(n=2000)
    lines, _ = looked(tmp_path, capsys, with_axes(log, gx=log.rates["gx_dph"], gy=log.rates["gx_dph"], gz=-log.rates["gx_dph"]))
    assert "gx_dph and gy_dph are the same in every second" in line_of(lines, "suspected") and "gz_dph" not in line_of(lines, "suspected")


def test_a_warm_up_is_of_a_size_that_the_rates_can_show(tmp_path, capsys):
    """Rounding of a polynomial through values that hardly change is none."""
    log = simulated(n=2000)
    lines, _ = looked(tmp_path, capsys, with_axes(log, gx=np.where(np.arange(2000) % 400 == 7, 12.5 + 1e-5, 12.5)))
    assert "warm-up" not in line_of(lines, "suspected") and "frozen" in line_of(lines, "suspected")
