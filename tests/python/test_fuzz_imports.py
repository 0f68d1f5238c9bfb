# SPDX-License-Identifier: MIT
"""Short form of `make fuzz-imports`: damaged files of every format are taken or refused by name, never anything else."""
import sys
from pathlib import Path

import pytest

import imucal
from imucal.errors import DataError

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/fuzz"))
import fuzz_imports  # noqa: E402


def test_damaged_files_are_taken_or_refused_by_name(tmp_path):
    counts = fuzz_imports.fuzz(150, 5, tmp_path / "found")
    assert [p.name + ": " + p.read_text() for p in sorted((tmp_path / "found").glob("*.txt"))] == []
    assert sum(sum(row) for row in counts.values()) == 150
    assert sum(row[fuzz_imports.STATUS_TAKEN] for row in counts.values()) > 10
    assert sum(row[fuzz_imports.STATUS_REFUSED] for row in counts.values()) > 10


def test_what_must_not_happen_is_found_and_kept(tmp_path, monkeypatch):
    """A reader that fails in another way, in the process of the test."""
    import imucal.check

    def broken(path):
        raise ValueError("not an error of ours")

    monkeypatch.setattr(imucal.check, "check_file", broken)
    path = tmp_path / "model.json"
    path.write_text("{}")
    status, text = fuzz_imports.try_one("model", path)
    assert status == fuzz_imports.STATUS_FOUND and "not an error of ours" in text


def test_findings_stay_mended(tmp_path):
    """What the campaign found: a quotation mark that swallows the file, a file of blanks."""
    table = tmp_path / "quote.csv"
    table.write_text("time_s,gyro_x,gyro_y,gyro_z,temp\n" + "0,1,2,3,20\n" * 3 + '1,"2,3,4,20\n' + "2,1,2,3,20\n" * 20000)
    blanks = tmp_path / "blanks.csv"
    blanks.write_bytes(b"\xef\xbb\xbf\n")
    for path, words in ((table, "quotation mark"), (blanks, "blanks")):
        with pytest.raises(DataError, match=words) as refused:
            imucal.import_log(path, unit="dps")
        assert path.name in str(refused.value)
