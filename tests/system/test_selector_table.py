# SPDX-License-Identifier: MIT
"""The table of the selector's constants in constants.md is that of the code: the same names and values."""
import re

from where import ROOT

ROOM = ROOT / "host/lib/analysis/diagnose"


def in_code():
    text = (ROOM / "evidence/constants.h").read_text(encoding="utf-8")
    text = text[text.index("struct SelectorConstants {"):text.index("};")]
    return {name: float(value) for name, value in re.findall(r"double (\w+) = ([-\d.e]+);", text)}


def in_table():
    rows = re.findall(r"^\| `(\w+)` \| ([-\d.e]+) \|(.*)\|$", (ROOM / "constants.md").read_text(encoding="utf-8"), re.M)
    return {name: (float(value), cells.split("|")) for name, value, cells in rows}


def test_table_lists_every_constant_with_its_value():
    code, table = in_code(), in_table()
    assert len(code) > 20
    assert set(table) == set(code)
    assert {n: v for n, (v, _) in table.items()} == code


def test_every_row_tells_meaning_source_half_and_double():
    for name, (_, cells) in in_table().items():
        assert len(cells) == 4 and all(c.strip() for c in cells), name
        for cell in cells[2:]:
            assert re.fullmatch(r" \d+ / \d+ / \d+, \d+ ", cell), (name, cell)
