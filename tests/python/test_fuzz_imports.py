# SPDX-License-Identifier: MIT
"""Short form of `make fuzz-imports`: damaged files of every format are taken or refused by name, never anything else."""
import pytest

import fuzz_imports
import imucal
from imucal.errors import DataError


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


TABLE = "time_s,gyro_x,gyro_y,gyro_z,temp\n" + "".join(f"{i},1,2,3,20\n" for i in range(5))
BLACKBOX = "loopIteration,time (us),gyroADC[0],gyroADC[1],gyroADC[2],IMUTemperature\n" + "".join(f"{i},{i}000,1,2,3,200\n" for i in range(5))
WORDS = ",".join(["00000001"] * 8) + "\n"


@pytest.mark.parametrize("text, words", [
    (TABLE + '5,"2,3,4,20\n' + "6,1,2,3,20\n" * 20000, "quotation mark"),
    ("\ufeff\n", "blanks"),
    (TABLE + "1e19,1,2,3,20\n", r":7: time 1e\+19 in column time_s is out of range"),
    (WORDS + WORDS.replace("00000001", "f" * 12, 1) + WORDS, ":2: expected 8 words of 8 hex digits"),
    (BLACKBOX + "5,5000,1,2,3,2x0\n", ":7: column IMUTemperature: expected a number"),
    (TABLE + "".join(f"{i},1,2,3,20\n" for i in range(5, 2505)) + "2505,x1,2,3,20\n", ':2507: column gyro_x: expected a number, found "x1"'),
    (BLACKBOX + "5,99999999999999999999999,1,2,3,200\n", "time .* is out of range"),
], ids=["quotation mark", "blanks", "far time", "long word", "text for a temperature", "text after many numbers", "integer of 128 bits"])
def test_findings_stay_mended(tmp_path, text, words):
    """What the campaign found is refused by name, line and reason."""
    path = tmp_path / "damaged.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=words) as refused:
        imucal.import_log(path, unit=None if text.startswith(WORDS) else "dps")
    assert path.name in str(refused.value)
