# SPDX-License-Identifier: MIT
"""`imucal` and `imucal import` from outside: dispatch, real files of other programs, bad input."""
import json
import os
import shutil
import subprocess

import numpy as np
import pytest

import foreign
from where import BIN, DATA

NATIVE = DATA / "native"


def imucal(*arguments, expect=0, cwd=None, env=None):
    done = subprocess.run([str(BIN / "imucal"), *map(str, arguments)], capture_output=True, text=True, timeout=120, cwd=cwd,
                          env={**os.environ, **(env or {})})
    assert done.returncode == expect, f"{arguments}: exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


def native(name):
    if not (NATIVE / name).exists():
        pytest.skip(f"{name} is not beside the project (../shared/data/native)")
    return NATIVE / name


def test_one_command_answers_as_the_programs_do():
    for program in ("calibrate", "dp", "errormodel", "profile", "montecarlo", "gyrosim", "diagnose"):
        alone = subprocess.run([str(BIN / program), "--help"], capture_output=True, text=True)
        assert imucal(program, "--help").stdout == alone.stdout
    assert imucal("dp", "no such file", expect=3).stderr == subprocess.run([str(BIN / "dp"), "no such file"], capture_output=True, text=True).stderr


def test_help_lists_every_subcommand_and_unknown_ones_are_usage_errors():
    text = imucal("--help").stdout
    for name in ("look", "import", "export", "check", "example", "report", "plot", "calibrate", "dp", "diagnose"):
        assert f"\n  {name} " in text
    assert "no subcommand \"nothing\"" in imucal("nothing", expect=2).stderr


def test_command_finds_its_programs_through_a_link_of_another_name(tmp_path):
    (tmp_path / "thermal").symlink_to(BIN / "imucal")
    done = subprocess.run([str(tmp_path / "thermal"), "dp", "--version"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0 and done.stdout.startswith("dp ")


def test_program_reads_a_foreign_log_directly(tmp_path):
    rec = foreign.recording(duration_s=200)
    foreign.write_ulog(tmp_path / "flight.bin", [rec])  # by content, not by name
    imucal("dp", tmp_path / "flight.bin", "--type", "av", "--tau", "1:5", "--json", tmp_path / "direct.json", "--quiet")
    imucal("import", tmp_path / "flight.bin", "-o", tmp_path / "log.csv")
    imucal("dp", tmp_path / "log.csv", "--type", "av", "--tau", "1:5", "--json", tmp_path / "two.json", "--quiet")
    one, two = (json.loads((tmp_path / n).read_text())["curves"] for n in ("direct.json", "two.json"))
    assert [c["dp_dph"] for c in one] == [c["dp_dph"] for c in two]


def test_messages_and_results_name_the_user_s_file_not_the_imported_copy(tmp_path):
    foreign.write_ulog(tmp_path / "flight.ulg", [foreign.recording(duration_s=200)], temperature=False)
    result = json.loads(imucal("dp", tmp_path / "flight.ulg", "--tau", "1:5", "--json", "-").stdout)
    assert [c["log"] for c in result["curves"]] == 3 * ["flight.ulg"]
    done = imucal("calibrate", "fit", tmp_path / "flight.ulg", "--method", "poly", "-o", tmp_path / "t.json", expect=3)
    assert "calibrate: flight.ulg: column temp_degc is empty" in done.stderr and "imucal-" not in done.stderr
    assert not (tmp_path / "t.json").exists()


@pytest.mark.parametrize("kind", ["csv", "st", "blackbox", "hex"])
def test_program_reads_text_of_other_programs_directly(kind, tmp_path):
    path = foreign.write(kind, tmp_path, foreign.recording(duration_s=200))
    imucal("dp", path, "--type", "av", "--tau", "1:5", "--json", tmp_path / "direct.json", "--quiet")
    imucal("import", path, "-o", tmp_path / "imported.csv")
    imucal("dp", tmp_path / "imported.csv", "--type", "av", "--tau", "1:5", "--json", tmp_path / "two.json", "--quiet")
    one, two = (json.loads((tmp_path / n).read_text())["curves"] for n in ("direct.json", "two.json"))
    assert [c["dp_dph"] for c in one] == [c["dp_dph"] for c in two]


def test_own_logs_and_their_faults_are_the_program_s_own(tmp_path):
    """A log of ours is never led through the importer: the message names its line."""
    good = "# imucal-log = 1\r\n\r\nt_s, temp_degc, gx_dph\r\n1,20,3\r\n2,20,x\r\n"
    (tmp_path / "log.csv").write_text("\ufeff" + good)
    said = imucal("dp", tmp_path / "log.csv", expect=3).stderr
    assert said.startswith("dp: ") and "log.csv:5: column gx_dph: expected a number" in said
    for text in ("1,20,3\n2,20,4\n", "t_s\n1\n", "words, and more words, here\nno number\n", ""):
        (tmp_path / "log.csv").write_text(text)
        assert imucal("dp", tmp_path / "log.csv", expect=3).stderr.startswith("dp: ")


def test_a_table_whose_unit_is_unclear_says_the_option(tmp_path):
    (tmp_path / "board.csv").write_text("time_ms,gx,gy,gz,temp\n" + "".join(f"{100 * i},0.1,0.2,{0.3 + i % 3},20\n" for i in range(300)))
    said = imucal("calibrate", "fit", tmp_path / "board.csv", "--method", "poly", "-o", tmp_path / "table.json", expect=3).stderr
    assert "--unit" in said and not (tmp_path / "table.json").exists()


def test_import_json_has_the_fields_of_the_contract(tmp_path):
    foreign.write_ulog(tmp_path / "x.ulg", [foreign.recording(), foreign.recording(seed=2)])
    imucal("import", tmp_path / "x.ulg", "--instance", 1, "-o", tmp_path / "log.csv", "--json", tmp_path / "x.json")
    result = json.loads((tmp_path / "x.json").read_text())
    assert result["format"] == "px4-ulog" and result["chosen"] == 1 and result["moving_seconds"] == 5 and result["gaps"] == 2
    assert result["sensors"][0].keys() >= {"instance", "name", "axes", "rate_hz", "has_temperature"}
    assert result["sensors"][0]["rate_hz"] == pytest.approx(100, rel=0.03)
    assert result["source_sha256"] == subprocess.run(["sha256sum", tmp_path / "x.ulg"], capture_output=True, text=True).stdout.split()[0]


# --- real files; their traps stand in ../shared/data/README.md ---

def test_real_px4_log_at_rest_gives_each_sensor_its_own_temperature(tmp_path):
    path = native("px4_cubeorange_rest.ulg")
    means = []
    for i in range(3):
        done = imucal("import", path, "--instance", i, "-o", tmp_path / f"{i}.csv")
        rows = [line for line in (tmp_path / f"{i}.csv").read_text().splitlines() if line[0].isdigit()]
        assert len(rows) == 6
        means.append(np.mean([float(r.split(",")[1]) for r in rows]))
    assert np.round(means).tolist() == [40, 28, 30]
    assert "1.2 Hz" in done.stderr  # single samples, not means


@pytest.mark.parametrize("name, options, words", [
    ("px4_cubeorange_rest.ulg", [], ["3 sensors and none chosen", "--instance 0"]),
    ("px4_v6c_nan_temp.ulg", ["--instance", "0"], ["NaN", "--without-temp"]),
    ("px4_v6c_nan_temp.ulg", ["--instance", "1"], ["moves throughout", "--keep-moving"]),
    ("px4_v5_flight.ulg", ["--instance", "0"], ["moves throughout"]),
    ("px4_sitl_temp0.ulg", [], ["exactly 0 throughout", "--without-temp"]),
    ("ap_v382_1s.bin", [], ["2 sensors and none chosen"]),
])
def test_real_files_with_traps_are_refused_with_the_remedy(name, options, words, tmp_path):
    done = imucal("import", native(name), *options, "-o", tmp_path / "log.csv", expect=3)
    for word in words:
        assert word in done.stderr
    assert not list(tmp_path.iterdir())


def test_real_ardupilot_log_cut_short_is_read_to_its_last_whole_message(tmp_path):
    imucal("import", native("ap_v382_1s.bin"), "--instance", 0, "--keep-moving", "-o", tmp_path / "log.csv", "--json", tmp_path / "j")
    result = json.loads((tmp_path / "j").read_text())
    assert result["sensors"][0]["rate_hz"] == pytest.approx(50, rel=0.1) and result["has_temperature"]
    last = (tmp_path / "log.csv").read_text().splitlines()[-1].split(",")
    assert float(last[1]) == pytest.approx(44.4, abs=0.3)


@pytest.mark.parametrize("name, seconds", [("cxd5602_hex_000deg.txt", 29), ("cxd5602_hex_045deg_rollover.txt", 31)])
def test_real_hex_text_goes_on_over_the_counter_s_wrap(name, seconds, tmp_path):
    imucal("import", native(name), "-o", tmp_path / "log.csv", "--json", tmp_path / "j")
    result = json.loads((tmp_path / "j").read_text())
    assert result["seconds"] == seconds and result["steps_back"] == 0 and result["gaps"] == 1
    rows = [line.split(",") for line in (tmp_path / "log.csv").read_text().splitlines() if line[0].isdigit()]
    assert all(26.5 < float(r[1]) < 27.5 for r in rows)


# --- bad input: what was found, what is missing, what helps; status 3; no output file ---

def _bad_files(folder):
    rec = foreign.recording(duration_s=30)
    foreign.write_ulog(folder / "no_gyro.ulg", [rec], with_gyro=False)
    foreign.write_ulog(folder / "no_temp.ulg", [rec], temperature=False)
    foreign.write_ulog(folder / "whole.ulg", [rec])
    (folder / "header.ulg").write_bytes((folder / "whole.ulg").read_bytes()[:40])
    foreign.write_ardupilot(folder / "no_imu.bin", rec, with_imu=False)
    foreign.write_rosbag(folder / "no_imu.bag", rec, 1, with_imu=False)
    foreign.write_rosbag(folder / "cut", rec, 1)
    (folder / "cut.bag").write_bytes((folder / "cut").read_bytes()[:30000])
    foreign.write_table(folder / "whole.parquet", rec, "parquet")
    (folder / "cut.parquet").write_bytes((folder / "whole.parquet").read_bytes()[:20000])
    (folder / "photo.csv").write_bytes(b"\xff\xd8\xff\xe0\x00\x10JFIF" + bytes(range(256)))
    (folder / "words.csv").write_text("this is\na letter\nand no table\n")
    (folder / "empty.csv").write_text("")
    (folder / "model.json").write_text('{"imucal_model": 1}')
    (folder / "no_unit.csv").write_text("time_s,gx,gy,gz,temp\n" + "".join(f"{i / 10},1,2,3,20\n" for i in range(100)))
    (folder / "no_time.csv").write_text("gx_dps,gy_dps,gz_dps,temp\n" + "1,2,3,20\n" * 50)
    (folder / "no_gyro.csv").write_text("time_s,pressure,temp\n" + "".join(f"{i / 10},1013,20\n" for i in range(100)))
    (folder / "word.csv").write_text("time_s,gx_dps,gy_dps,gz_dps,temp\n" + "".join(f"{i / 10},1,2,{'x1' if i == 40 else 3},20\n" for i in range(100)))
    (folder / "box.bbl").write_bytes(b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n")
    (folder / "folder").mkdir()
    from scipy.io import savemat
    savemat(folder / "no_arrays.mat", {"note": "nothing"})


BAD = [("no_gyro.ulg", "without sensor_gyro", "SDLOG_PROFILE"), ("no_temp.ulg", "no temperature", "--without-temp"), ("header.ulg", "ends before its first gyro data", "copy it"),
       ("no_imu.bin", "without IMU", "LOG_BITMASK"), ("no_imu.bag", "/imu/temperature", "without sensor_msgs/Imu"), ("cut.bag", "cannot be read", "reindex"),
       ("cut.parquet", "cannot be read", "cut short"), ("photo.csv", "ff d8 ff e0", "PX4 ULog"), ("words.csv", "no table", "this is"),
       ("empty.csv", "empty", "empty"), ("model.json", "a JSON file", "imucal check"), ("no_unit.csv", "the unit of gx, gy, gz", "--unit"),
       ("no_time.csv", "no time column", "--rate HZ"), ("no_gyro.csv", "no gyro columns", "--gyro X,Y,Z"), ("word.csv", "word.csv:42", "x1"),
       ("box.bbl", "blackbox", "blackbox_decode"), ("folder", "metadata.yaml", "no ROS 2 bag"), ("no_arrays.mat", "without numeric arrays", "table2struct"),
       ("not there", "cannot open", "No such file")]


def test_bad_input_says_what_was_found_and_what_helps_and_leaves_no_file(tmp_path):
    """One process for all: the command line's own entry, as the dispatcher starts it."""
    from imucal.__main__ import main
    _bad_files(tmp_path)
    out = tmp_path / "out.csv"
    import contextlib
    import io
    for name, found, remedy in BAD:
        said = io.StringIO()
        with contextlib.redirect_stderr(said):
            status = main(["import", str(tmp_path / name), "-o", str(out)])
        assert status == 3, f"{name}: {status}: {said.getvalue()}"
        assert name in said.getvalue() and found in said.getvalue() and remedy in said.getvalue(), f"{name}: {said.getvalue()}"
        assert "Traceback" not in said.getvalue() and not list(tmp_path.glob("out.csv*"))


@pytest.mark.parametrize("library, write", [("pymavlink", foreign.write_ardupilot), ("rosbags", lambda p, r: foreign.write_rosbag(p, r, 1)),
                                            ("pyulog", lambda p, r: foreign.write_ulog(p, [r]))])
def test_without_the_optional_library_the_message_says_how_to_install_it(library, write, tmp_path):
    write(tmp_path / "log", foreign.recording(duration_s=30))
    hidden = tmp_path / "hidden"
    (hidden / library).mkdir(parents=True)
    (hidden / library / "__init__.py").write_text("raise ImportError('hidden by a test')")
    done = imucal("import", tmp_path / "log", "-o", tmp_path / "log.csv", expect=3, env={"PYTHONPATH": str(hidden)})
    assert f"pip install {library}" in done.stderr and not (tmp_path / "log.csv").exists()


def test_output_in_this_folder_is_not_overwritten_unasked(tmp_path):
    foreign.write_table(tmp_path / "a.parquet", foreign.recording(duration_s=30), "csv")
    shutil.move(tmp_path / "a.parquet", tmp_path / "a.txt")
    imucal("import", "a.txt", cwd=tmp_path)
    before = (tmp_path / "a.csv").read_bytes()
    assert "-o LOG.csv" in imucal("import", "a.txt", cwd=tmp_path, expect=3).stderr
    assert (tmp_path / "a.csv").read_bytes() == before


def table_of(path, temp=25.0):
    path.write_text("time,a,b,c,temp\n" + "".join(f"{k / 50:.2f},{k % 7},{k % 5},{k % 3},{temp + k * 1e-4:.4f}\n" for k in range(20000)))
    return [path, "--time", "time:s", "--gyro", "a,b,c", "--unit", "dph", "--temp", "temp"]


@pytest.mark.parametrize("extra, words", [
    (["--rate", "0"], "--rate 0: expected the samples per second"), (["--rate", "-5"], "--rate -5"), (["--rate", "nan"], "--rate nan"),
    (["--unit", "counts", "--scale", "0"], "--scale 0: expected the dph of one count"), (["--gyro", "a,a,a"], "column a is named twice"),
    (["--gyro", "time,b,c"], "column time is named twice"), (["--temp", "b"], "column b is named twice")])
def test_options_that_cannot_be_are_usage_errors_and_leave_no_file(extra, words, tmp_path):
    said = imucal("import", *table_of(tmp_path / "raw.csv"), *extra, "-o", tmp_path / "log.csv", expect=2).stderr
    assert words in said and not (tmp_path / "log.csv").exists()


def test_temperatures_in_kelvin_are_remarked(tmp_path):
    assert "kelvin" not in imucal("import", *table_of(tmp_path / "raw.csv"), "-o", tmp_path / "log.csv").stderr
    assert "are they in kelvin?" in imucal("import", *table_of(tmp_path / "raw.csv", 298), "-o", tmp_path / "hot.csv").stderr
