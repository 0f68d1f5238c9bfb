# SPDX-License-Identifier: MIT
"""gzip and standard input ("-") in the package's commands and readers, as in the programs: the same answer, the user's file in every word."""
import gzip
import io
import json
import os
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import foreign
import imucal
from imucal.__main__ import main
from where import ROOT

EXAMPLES = dict(re.findall(r"<!-- example: (\S+) -->\n```\w*\n(.*?)```", (ROOT / "host/formats.md").read_text(encoding="utf-8"), re.S))
OWN = "# imucal-log = 1\nt_s,temp_degc,gx_dph\n" + "".join(f"{i},{20 + i / 100:.2f},{(i * 37) % 11}\n" for i in range(1, 301))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """{name: content} as logs, tables and models come."""
    folder, rec = tmp_path_factory.mktemp("packed"), foreign.recording(duration_s=120)
    found = {"own.csv": OWN.encode(), "raw.csv": EXAMPLES["raw.csv"].encode()}
    for kind in ("ulog", "csv", "bag1", "parquet", "blackbox"):
        found[f"log.{'bag' if kind == 'bag1' else kind}"] = foreign.write(kind, folder, rec).read_bytes()
    return found


def give(monkeypatch, data):
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(data)))


def body(path):
    """A log without what tells where it comes from."""
    return [line for line in path.read_text().splitlines() if not line.startswith(("# source", "# device"))]


NAMES = ["own.csv", "raw.csv", "log.ulog", "log.csv", "log.bag", "log.parquet", "log.blackbox"]


@pytest.mark.parametrize("way", ["gzip", "standard input", "gzip in standard input"])
@pytest.mark.parametrize("name", NAMES)
def test_import_gives_the_same_log(files, name, way, tmp_path, monkeypatch, capsys):
    if name == "log.bag" and way != "gzip":
        pytest.skip("a bag is known to its library by its name too")
    data = files[name]
    (tmp_path / name).write_bytes(data)
    assert main(["import", str(tmp_path / name), "-o", str(tmp_path / "plain.out"), "--json", str(tmp_path / "plain.json")]) == 0
    plain_notes = capsys.readouterr().err
    packed = gzip.compress(data) if "gzip" in way else data
    source = tmp_path / f"{name}.gz"
    if way == "gzip":
        source.write_bytes(packed)
    else:
        give(monkeypatch, packed)
    assert main(["import", str(source) if way == "gzip" else "-", "-o", str(tmp_path / "packed.out"), "--json", str(tmp_path / "packed.json")]) == 0
    notes = capsys.readouterr().err
    assert body(tmp_path / "plain.out") == body(tmp_path / "packed.out")
    assert plain_notes.count("note:") == notes.count("note:") and "imucal-" not in notes
    result = json.loads((tmp_path / "packed.json").read_text())
    import hashlib
    assert result["source_sha256"] == hashlib.sha256(packed).hexdigest()
    text = (tmp_path / "packed.out").read_text()
    assert f"# source = {source.name if way == 'gzip' else 'standard input'}\n" in text


@pytest.mark.parametrize("name", ["own.csv", "log.csv"])
def test_look_reads_both(files, name, tmp_path, monkeypatch, capsys):
    (tmp_path / f"{name}.gz").write_bytes(gzip.compress(files[name]))
    monkeypatch.chdir(tmp_path)
    assert main(["look", f"{name}.gz"]) == 0
    packed = capsys.readouterr()
    give(monkeypatch, files[name])
    assert main(["look", "-", "-o", "p.png"]) == 0
    piped = capsys.readouterr()
    assert f"{name}.gz: " in packed.out and "standard input: " in piped.out and "imucal-" not in packed.out + packed.err + piped.out + piped.err
    assert packed.out.splitlines()[1:-2] == piped.out.splitlines()[1:-2]
    assert (tmp_path / f"{name.split('.')[0]}.look.png").exists()


@pytest.mark.parametrize("name, text", [("own.csv", OWN), ("raw.csv", EXAMPLES["raw.csv"]), *((n, t) for n, t in EXAMPLES.items() if n.endswith(".json"))])
def test_check_takes_and_refuses_both(name, text, tmp_path, monkeypatch, capsys):
    broken = text.replace("imucal_", "imucal-") if name.endswith("json") else text + "5,20,x\n"
    for content, status in ((text, 0), (broken, 3)):
        path = tmp_path / f"{name}.gz"
        path.write_bytes(gzip.compress(content.encode()))
        assert main(["check", str(path)]) == status
        packed = capsys.readouterr()
        give(monkeypatch, content.encode())
        assert main(["check", "-"]) == status
        piped = capsys.readouterr()
        assert (packed.out + packed.err).replace(str(path), "standard input") == piped.out + piped.err
        assert f"{name}.gz" in packed.out + packed.err and "standard input" in piped.out + piped.err


def test_export_and_readers_take_gzip(tmp_path, monkeypatch, capsys):
    for name in ("table.json", "model.json"):
        (tmp_path / name).write_text(EXAMPLES[name])
        (tmp_path / f"{name}.gz").write_bytes(gzip.compress(EXAMPLES[name].encode()))
        target = "c-header" if name == "table.json" else "ros"
        outputs = []
        for source in (tmp_path / name, tmp_path / f"{name}.gz", "-"):
            give(monkeypatch, EXAMPLES[name].encode())
            assert main(["export", str(source), "--to", target, "-o", str(tmp_path / "out")]) == 0
            outputs.append([line for line in (tmp_path / "out").read_text().splitlines() if not line.startswith("# noise of")])
        assert outputs[0] == outputs[1] == outputs[2]
    assert imucal.read_table(tmp_path / "table.json.gz").channels[0].axis == "gx_dph"
    (tmp_path / "own.csv.gz").write_bytes(gzip.compress(OWN.encode()))
    log = imucal.read_log(tmp_path / "own.csv.gz")
    assert len(log.t_s) == 300 and log.path == str(tmp_path / "own.csv.gz")
    np.testing.assert_array_equal(imucal.import_log(tmp_path / "own.csv.gz").log.t_s, log.t_s)


def test_limits_are_judged_of_a_packed_table_and_of_one_from_standard_input(tmp_path, monkeypatch, capsys):
    (tmp_path / "limits.json").write_text('{"imucal_limits": 1, "max_sigma": 1}')
    give(monkeypatch, EXAMPLES["table.json"].encode())
    assert main(["check", "-", "--limits", str(tmp_path / "limits.json")]) == 1
    assert "limit 1" in capsys.readouterr().out


@pytest.mark.parametrize("command", [["check"], ["import", "-o", "out"], ["look", "-o", "out"], ["export", "--to", "json", "-o", "out"]])
def test_damaged_gzip_is_said(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    good = gzip.compress(OWN.encode())
    for data in (good[:len(good) // 2], good[:20] + b"\xff" * 30 + good[50:]):
        (tmp_path / "log.csv.gz").write_bytes(data)
        assert main([command[0], "log.csv.gz", *command[1:]]) == 3
        said = capsys.readouterr().err
        assert "log.csv.gz" in said and "gzip" in said and "Traceback" not in said and not os.path.exists("out")


def test_last_row_that_was_cut_off_is_said_of_the_user_s_file(tmp_path):
    (tmp_path / "cut.csv.gz").write_bytes(gzip.compress((OWN + "301,26.00,3354").encode()))
    with pytest.warns(imucal.errors.DataWarning, match=r"cut\.csv\.gz:303: the last row has no line end"):
        imucal.read_log(tmp_path / "cut.csv.gz")


def test_import_of_standard_input_wants_a_name(monkeypatch, capsys):
    give(monkeypatch, OWN.encode())
    assert main(["import", "-"]) == 2
    assert "-o LOG.csv" in capsys.readouterr().err


def test_report_takes_both_and_refuses_a_page_that_cannot_be_written(tmp_path):
    import subprocess
    text = re.search(r"<!-- result: diagnosis.json -->\n```json\n(.*?)```", (ROOT / "host/formats.md").read_text(encoding="utf-8"), re.S).group(1).encode()
    (tmp_path / "d.json").write_bytes(text)
    (tmp_path / "d.json.gz").write_bytes(gzip.compress(text))

    def report(source, page, data=b""):
        return subprocess.run([sys.executable, "-m", "imucal", "report", source, "-o", page], cwd=tmp_path, input=data, capture_output=True, timeout=60)
    pages = []
    for source, data in (("d.json", b""), ("d.json.gz", b""), ("-", text), ("-", gzip.compress(text))):
        assert report(source, "page.html", data).returncode == 0
        text_of = re.sub(r"<[^>]*>", " ", (tmp_path / "page.html").read_text()).replace("d.json.gz", "d.json").replace("standard input", "d.json")
        pages.append([word for word in text_of.split() if not re.match(r"[\d:-]+$|UTC|written", word)])
    assert all(words == pages[0] for words in pages[1:2]) and "explained" in pages[3] and pages[2] == pages[3]
    (tmp_path / "cut.gz").write_bytes(gzip.compress(text)[:-20])
    for source, page, words in (("cut.gz", "new.html", b"cut.gz: cannot be read: the gzip data end too early"), ("d.json", "no/such/folder.html", b"cannot write")):
        done = report(source, page)
        assert done.returncode == 3 and words in done.stderr and b"Traceback" not in done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cut.gz", "d.json", "d.json.gz", "page.html"]
