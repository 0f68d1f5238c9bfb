# SPDX-License-Identifier: MIT
"""What the package writes: whole or not at all, through a link its target, into a pipe as it is, never over its own input."""
import json
import os
import stat
import threading

import pytest

from imucal.__main__ import main
from imucal.log import write_text

RAW = "time,gx,gy,gz,temp\n" + "".join(f"{0.01 * i:.2f},0.0{i % 7},0.0{i % 5},0.0{i % 3},{25 + 1e-4 * i:.3f}\n" for i in range(3000))
TAKE = ["--gyro", "gx,gy,gz", "--unit", "dps", "--time", "time"]


def test_a_pipe_stays_a_pipe_and_gets_the_text(tmp_path):
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_text()), daemon=True)
    reader.start()
    write_text(str(pipe), "words\n")
    assert stat.S_ISFIFO(os.stat(pipe).st_mode)  # a device as well: root would have lost /dev/null
    reader.join(5)
    assert got == ["words\n"]


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "target").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "target")
    write_text(str(tmp_path / "link"), "new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "target").read_text() == "new"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link", "target"]


@pytest.mark.parametrize("command", [["import", "{in}", *TAKE, "-o", "{to}"], ["import", "{in}", *TAKE, "-o", "{in}.log", "--json", "{to}"],
                                     ["look", "{in}", *TAKE, "--no-ml", "-o", "{in}.png", "--json", "{to}"],
                                     ["export", "{in}", "--to", "json", "-o", "{to}"]])
@pytest.mark.parametrize("by", ["its name", "a link"])
def test_the_input_is_never_written_over(tmp_path, command, by, capsys):
    source = tmp_path / "raw.csv"
    source.write_text(RAW)
    to = source
    if by == "a link":
        to = tmp_path / "result"
        to.symlink_to(source)
    assert main([word.replace("{in}", str(source)).replace("{to}", str(to)) for word in command]) == 3
    assert source.read_text() == RAW and "give another name" in capsys.readouterr().err


@pytest.mark.parametrize("range_degc", [0, -30])
def test_a_table_without_a_range_is_refused_by_its_field(tmp_path, range_degc, capsys):
    table = {"imucal_table": 1, "serial": "S", "sequence": 1, "created": "2026-11-21T06:22:00Z", "degc_per_count": 0.01, "degc_at_zero": 25,
             "axes": [{"axis": "gx_dph", "t0_degc": 30, "range_degc": range_degc, "coeff_dph": [1, 2], "order": 1, "span_degc": [0, 60], "sigma_dph": [5] * 9,
                       "model": {"arw_deg_rt_h": 0.6}, "dph_per_count": 18, "full_scale_counts": 32767, "n_seconds": 100}]}
    (tmp_path / "table.json").write_text(json.dumps(table, indent=1))
    assert main(["export", str(tmp_path / "table.json"), "--to", "c-header", "-o", str(tmp_path / "cal.h")]) == 3
    said = capsys.readouterr().err
    assert "table.json:12: axes[0] (gx_dph) range" in said and not (tmp_path / "cal.h").exists()
