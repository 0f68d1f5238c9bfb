# SPDX-License-Identifier: MIT
"""Every example of host/formats.md is read by a program, and a field that is taken out of one is missed by name."""
import json
import re
import subprocess

import pytest

from where import BIN, ROOT

TEXT = (ROOT / "host" / "formats.md").read_text()
EXAMPLES = dict(re.findall(r"<!-- example: (\S+) -->\n```\w*\n(.*?)```", TEXT, re.S))


@pytest.fixture
def folder(tmp_path):
    for name, text in EXAMPLES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def run(folder, *words):
    return subprocess.run([BIN / words[0], *words[1:]], cwd=folder, capture_output=True, text=True, timeout=60)


READERS = {
    "run.csv": ("gyrosim", "replay", "run.csv", "--to", "feed.bin"),
    "raw.csv": ("gyrosim", "replay", "raw.csv", "--to", "feed.bin"),
    "model.json": ("profile", "bound", "--model", "model.json", "--order", "3", "--duration-s", "8400"),
    "accel.json": ("profile", "bound", "--model", "accel.json", "--order", "3", "--duration-s", "8400"),
    "chamber.json": ("profile", "error", "chamber.json", "--model", "model.json", "--order", "3"),
    "table.json": ("imucal", "export", "table.json", "--to", "c-header", "-o", "table.h"),
}


def test_every_format_has_an_example():
    assert set(EXAMPLES) == set(READERS)


@pytest.mark.parametrize("name", sorted(READERS))
def test_example_is_read(folder, name):
    result = run(folder, *READERS[name])
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("name, field", [("model.json", "imucal_model"), ("chamber.json", "segments"),
                                         ("table.json", "axes")])
def test_missing_field_is_named(folder, name, field):
    content = json.loads(EXAMPLES[name])
    del content[field]
    (folder / name).write_text(json.dumps(content))
    result = run(folder, *READERS[name])
    assert result.returncode == 3
    assert name in result.stderr and field in result.stderr, result.stderr


def test_result_example_has_the_verdicts_fields():
    example = json.loads(re.search(r"<!-- result: diagnosis.json -->\n```json\n(.*?)```", TEXT, re.S).group(1))
    assert example["imucal_diagnosis"] == 1 and example["axes"][0]["effects"][0]["family"] == "thermal_memory"
