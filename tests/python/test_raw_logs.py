# SPDX-License-Identifier: MIT
"""Raw logs of counts: `imucal check`, `import` and `look` take what the programs take, with the same seconds, and refuse what they refuse."""
import re
import subprocess

import numpy as np
import pytest

import imucal
from imucal.__main__ import main
from programs_say import DP, check_all_name_the_field, dp_says

N, RATE_HZ = 4000, 4
META = {"rate_hz": "4", "gx_counts_scale_dph": "18"}
HEAD = "t_s,temp_degc,gx_counts"


def rows():
    rng = np.random.default_rng(3)
    counts = np.rint((300 + rng.normal(0, 72, N)) / 18).astype(int)
    return [f"{i / RATE_HZ:.2f},{20 + 0.001 * i:.2f},{counts[i]}" for i in range(N)]


def text(lines=None, head=HEAD, **meta):
    stated = {**META, **meta}
    return "# imucal-log = 1\n" + "".join(f"# {k} = {v}\n" for k, v in stated.items() if v is not None) + "\n".join([head, *(lines or rows())]) + "\n"


def put(value, row=100):
    lines = rows()
    lines[row] = lines[row].rsplit(",", 1)[0] + "," + value
    return text(lines)


R = rows()
LOGS = {
    "healthy": (text(), 0), "a count missing": (put(""), 0), "a gap": (text(R[:1000] + R[1400:]), 0),
    "out of order": (text(R[2000:] + R[:2000]), 3), "each row twice": (text(list(np.repeat(R, 2))), 3), "a piece again": (text(R[:2000] + R[1800:]), 3),
    "no rate": (text(rate_hz=None), 3), "rate of words": (text(rate_hz="fast"), 3), "rate zero": (text(rate_hz="0"), 3),
    "no scale": (text(gx_counts_scale_dph=None), 3), "scale zero": (text(gx_counts_scale_dph="0"), 3), "scale below zero": (text(gx_counts_scale_dph="-18"), 3),
    "decimal comma": (text(gx_counts_scale_dph="18,5"), 3), "scale nan": (text(gx_counts_scale_dph="nan"), 3),
    "counts in parts": (put("387.7"), 3), "counts beyond 32 bits": (put("99999999999"), 3),
    "counts and rates": (text([row + ",5" for row in R], head=HEAD + ",gy_dph"), 3),
    "time below zero": (text(["-1,20,5", *R]), 3),
}


@pytest.mark.parametrize("name", LOGS)
def test_check_import_look_and_the_programs_agree_on_a_raw_log(tmp_path, name, capsys):
    content, status = LOGS[name]
    path, out, page = tmp_path / "raw.csv", tmp_path / "log.csv", tmp_path / "page.png"
    path.write_text(content)
    dp_status, words = dp_says(path)
    assert dp_status == status, words
    for command in (["check", str(path)], ["import", str(path), "-o", str(out)], ["look", str(path), "-o", str(page), "--no-ml"]):
        assert main(command) == status, command
        said = capsys.readouterr()
        if status:
            assert words.strip().partition(": ")[2] in said.err, (command, said.err, words)
            assert "Traceback" not in said.err
    assert out.exists() == page.exists() == (status == 0)


@pytest.mark.parametrize("row", [3, 3000])
def test_byte_of_another_coding_in_a_row_is_named_as_by_the_programs(tmp_path, row, capsys):
    path = tmp_path / "raw.csv"
    path.write_bytes(put("\0", row).encode().replace(b"\0", b"3\xff7"))
    check_all_name_the_field(path, row + 5, "gx_counts", r"3\xff7", capsys)


def test_imported_raw_log_gives_the_curve_of_the_raw_log(tmp_path):
    path = tmp_path / "raw.csv"
    path.write_text(LOGS["a gap"][0])
    assert main(["import", str(path), "-o", str(tmp_path / "log.csv"), "-q"]) == 0
    curves = [subprocess.run([DP, p, "--no-ratios", "--tau", "1,10", "--json", "-"], capture_output=True, text=True, timeout=60).stdout
              for p in (path, tmp_path / "log.csv")]
    one, two = (re.search(r'"dp_dph": \[([^\]]*)\]', c)[1].split(",") for c in curves)
    np.testing.assert_allclose(np.array(one, float), np.array(two, float), rtol=1e-6)


@pytest.mark.parametrize("bits", [1, 4])
def test_flags_of_samples_and_of_seconds_are_kept(tmp_path, bits):
    """A saturated or faulty second has no rate in any program; an import that forgot its flag would give it one."""
    lines = [f"{row},{bits if 400 <= i < 440 else 0}" for i, row in enumerate(R)]
    path, log = tmp_path / "raw.csv", tmp_path / "log.csv"
    path.write_text(text(lines, head=HEAD + ",gx_flags"))
    read = imucal.read_log(path)
    marked = (read.t_s > 100) & (read.t_s <= 110)
    assert marked.sum() == 10
    np.testing.assert_array_equal(read.flags["gx_dph"] & bits, np.where(marked, bits, 0))
    assert main(["import", str(path), "-o", str(log), "-q", "--keep-moving"]) == 0
    np.testing.assert_array_equal(imucal.read_log(log).flags["gx_dph"], read.flags["gx_dph"])
    assert main(["import", str(log), "-o", str(tmp_path / "again.csv"), "-q", "--keep-moving"]) == 0
    np.testing.assert_array_equal(imucal.read_log(tmp_path / "again.csv").flags["gx_dph"], read.flags["gx_dph"])


def test_last_row_without_line_end_is_left_out_of_a_raw_log_with_a_warning(tmp_path):
    path = tmp_path / "cut.csv"
    path.write_text(text() + "1000.00,24,2")
    with pytest.warns(imucal.errors.DataWarning, match=r"cut\.csv:\d+: the last row has no line end"):
        assert len(imucal.read_log(path).t_s) == N // RATE_HZ
