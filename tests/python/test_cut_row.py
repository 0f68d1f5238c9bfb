# SPDX-License-Identifier: MIT
"""A last row without line end may be cut off inside its last number: it is left out and said, in logs and in tables of others."""
import numpy as np
import pytest

import foreign
import imucal
from imucal.importers import tail
from imucal.__main__ import main
from imucal.errors import DataError, DataWarning
from where import DATA

HEADER = "# imucal-log = 1\nt_s,temp_degc,gx_dph\n"
ROWS = "".join(f"{i},{20 + i / 100:.2f},{(i * 37) % 11}\n" for i in range(1, 301))


@pytest.mark.parametrize("last", ["301,26.00,3354", "301,26", "3", "301,26.00,33x"])
def test_read_log_leaves_it_out_with_a_warning(tmp_path, last):
    (tmp_path / "cut.csv").write_text(HEADER + ROWS + last)
    with pytest.warns(DataWarning, match=r"cut\.csv:303: the last row has no line end.*left out; end it with a line end"):
        log = imucal.read_log(tmp_path / "cut.csv")
    assert len(log.t_s) == 300 and log.t_s[-1] == 300


def test_whole_logs_give_no_warning_and_a_cut_comment_no_metadata(tmp_path, recwarn):
    (tmp_path / "whole.csv").write_text(HEADER + ROWS + "\n  ")
    assert len(imucal.read_log(tmp_path / "whole.csv").t_s) == 300
    (tmp_path / "comment.csv").write_text(HEADER + ROWS + "# serial = 12")
    assert "serial" not in imucal.read_log(tmp_path / "comment.csv").metadata
    assert not [w for w in recwarn if issubclass(w.category, DataWarning)]


def test_a_log_of_one_cut_row_is_empty(tmp_path):
    (tmp_path / "one.csv").write_text(HEADER + "1,20.00,3354")
    with pytest.warns(DataWarning), pytest.raises(DataError, match="no whole row"):
        imucal.read_log(tmp_path / "one.csv")


def test_check_says_it_and_finds_the_rest_valid(tmp_path, capsys):
    (tmp_path / "cut.csv").write_text(HEADER + ROWS + "301,26.00,3354")
    assert main(["check", str(tmp_path / "cut.csv")]) == 0
    out = capsys.readouterr()
    assert "a valid log" in out.out and out.err.startswith("imucal check: note: ") and "cut.csv:303: the last row" in out.err


@pytest.mark.parametrize("head, row", [
    ("time_ms,gx_dps,gy_dps,gz_dps,temp\n", "{},0.1,0.2,0.3,20.55"),
    ("some preface\n\ntime_ms;gx_dps;gy_dps;gz_dps;temp\n", "{};0.1;0.2;0.3;20.55"),
], ids=["plain", "with a preface"])
@pytest.mark.parametrize("cut", [1, 4, 12], ids="{} characters short".format)
def test_table_of_another_program_loses_its_cut_sample(tmp_path, head, row, cut):
    """Not 20.55 cut to 20: the means are those of the table without the row."""
    rows = "".join(row.format(100 * i) + "\n" for i in range(600))
    last = row.format(60000)
    (tmp_path / "whole.csv").write_text(head + rows)
    (tmp_path / "cut.csv").write_text(head + rows + last[:-cut])
    whole, result = (imucal.import_log(tmp_path / name, keep_moving=True) for name in ("whole.csv", "cut.csv"))
    np.testing.assert_array_equal(result.log.temp_degc, whole.log.temp_degc)
    np.testing.assert_array_equal(result.log.t_s, whole.log.t_s)
    line = head.count("\n") + 601
    assert [n for n in result.notes if f"line {line}: the last row has no line end" in n]
    assert not [n for n in whole.notes if "line end" in n]


def test_hex_text_trusts_a_last_line_of_full_length(tmp_path):
    words = [",".join(f"{w:08x}" for w in (i * 160000, 0x41A00000, 0x3C000000, 0x3C000000, 0x3C000000, 0, 0, 0x411CE80A)) for i in range(1200)]
    words[-1] = words[-1].replace("41a00000", "41f00000")  # 30 degC instead of 20: the mean of its second tells whether it was taken
    (tmp_path / "whole.txt").write_text("\n".join(words) + "\n")
    (tmp_path / "open.txt").write_text("\n".join(words))
    (tmp_path / "cut.txt").write_text("\n".join(words)[:-1])
    results = [imucal.import_log(tmp_path / f"{n}.txt", keep_moving=True) for n in ("whole", "open", "cut")]
    whole, open_, cut = (result.log for result in results)
    assert len(open_.t_s) == len(whole.t_s)
    np.testing.assert_array_equal(open_.temp_degc, whole.temp_degc)
    assert len(cut.t_s) <= len(whole.t_s)
    assert whole.temp_degc[-1] > 20 and cut.temp_degc[-1] == 20
    assert ["the last line is cut short and left out" in result.notes for result in results] == [False, False, True]


@pytest.mark.parametrize("kind", ["ulog", "bin"])
def test_recording_cut_off_in_a_message_is_taken_and_said(tmp_path, kind):
    path = foreign.write(kind, tmp_path, foreign.recording())
    whole = imucal.import_log(path)
    assert tail.CUT not in whole.notes
    data = path.read_bytes()
    for size in (len(data) - 1, len(data) - 5, len(data) * 2 // 3 + 7):
        path.write_bytes(data[:size])
        cut = imucal.import_log(path)
        assert tail.CUT in cut.notes and len(cut.log.t_s) <= len(whole.log.t_s), size


@pytest.mark.parametrize("name, options", [("px4_cubeorange_rest.ulg", {"instance": 0})])
def test_real_recording_that_is_whole_is_not_called_cut(name, options):
    path = DATA / "native" / name
    if not path.exists():
        pytest.skip(f"{name} is not beside the project (../shared/data/native)")
    assert tail.CUT not in imucal.import_log(path, **options).notes
