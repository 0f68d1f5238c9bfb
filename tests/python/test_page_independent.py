# SPDX-License-Identifier: MIT
"""`imucal look` seen from outside: its words against numpy and the definition of the Allan deviation, its page pixel by pixel.

A dot's place follows from the finite values alone: a margin of a twentieth on each side, linear between (logarithmic for the
Allan deviation).  The page's panels tell which box is theirs; everything else here is computed anew."""
import base64
import io
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from imucal.__main__ import main
from imucal.firstlook import look_at_axis
from imucal.log import Log
from imucal.plot import look_page

WHITE_LEVEL = 250


def sensor(n=3000, seed=1, offset=400.0):
    rng = np.random.default_rng(seed)
    temp = np.round(30 - 28 * np.cos(2 * np.pi * np.arange(n) / n), 3)
    x = (temp - 30) / 28
    return np.arange(1.0, n + 1), temp, np.round(offset + 300 * x + 100 * x ** 2 + 36 * rng.standard_normal(n), 3)


def write(path, t, temp, axes, flags=None):
    columns = [t, temp, *axes.values(), *(flags or {}).values()]
    lines = [",".join("" if v != v else repr(float(v)) if i < 2 + len(axes) else str(int(v)) for i, v in enumerate(row)) for row in zip(*columns)]
    path.write_text("# imucal-log = 1\n" + ",".join(["t_s", "temp_degc", *axes, *(flags or {})]) + "\n" + "\n".join(lines) + "\n")
    return path


def look(path, *arguments, page="page.png", expect=0):
    folder = path.parent
    status = main(["look", str(path), "-o", str(folder / page), "--no-ml", "--json", str(folder / "look.json"), *arguments])
    assert status == expect
    return json.loads((folder / "look.json").read_text()) if status == 0 else None


def residual_of(temp, rate, order):
    there = np.isfinite(rate) & np.isfinite(temp)
    z = (temp - temp[there].min()) / max(np.ptp(temp[there]), 1e-9) * 2 - 1
    columns = np.polynomial.chebyshev.chebvander(z, order)
    fitted = columns @ np.linalg.lstsq(columns[there], rate[there], rcond=None)[0]
    return rate - fitted, np.ptp(fitted[there])


def allan(t, values, n):
    """The definition, window by window; a window may miss a tenth of its seconds."""
    grid = np.full(int(t[-1] - t[0]) + 1, np.nan)
    grid[(t - t[0]).astype(int)] = values

    def mean(window):
        there = np.isfinite(window)
        return window[there].mean() if there.sum() >= 0.9 * n else np.nan
    steps = np.array([mean(grid[i + n:i + 2 * n]) - mean(grid[i:i + n]) for i in range(len(grid) - 2 * n + 1)])
    steps = steps[np.isfinite(steps)]
    return np.sqrt(np.mean(steps ** 2) / 2)


@pytest.mark.parametrize("kind", ["whole", "an hour missing", "rows missing", "fields empty", "far from zero"])
def test_words_and_figures_are_those_of_numpy(tmp_path, kind, capsys):
    t, temp, rate = sensor(offset=1e5 if kind == "far from zero" else 400)
    keep = np.ones(len(t), bool)
    if kind == "an hour missing":
        t[1400:] += 3600
    if kind == "rows missing":
        keep = np.random.default_rng(2).random(len(t)) > 0.02
    if kind == "fields empty":
        rate[np.random.default_rng(2).random(len(t)) < 0.02] = np.nan
    t, temp, rate = t[keep], temp[keep], rate[keep]
    found = look(write(tmp_path / "log.csv", t, temp, {"gx_dph": rate}))["axes"][0]
    left, travel = residual_of(temp, rate, 3)
    for tau, adev in zip(found["allan"]["tau_s"], found["allan"]["adev"]):
        assert adev == pytest.approx(allan(t, left, int(tau)), rel=1e-7)
    assert len(found["allan"]["tau_s"]) >= 5
    line = next(text for text in capsys.readouterr().out.splitlines() if text.startswith("gx_dph: mean"))
    mean, said_travel = (float(v) for v in re.search(r"mean (\S+) dph, bias travels (\S+) with", line).groups())
    assert mean == pytest.approx(np.nanmean(rate), rel=6e-5)
    assert said_travel == pytest.approx(travel, rel=6e-3)
    assert "no clear lowest point" in line, "white noise alone has none"


def picture_of(page):
    from PIL import Image
    return np.asarray(Image.open(io.BytesIO(page.png())).convert("L")).astype(int)


def place(values, low_px, high_px, is_log=False):
    """Pixels of values: a twentieth of the span is left on both sides."""
    values = np.log10(values) if is_log else np.asarray(values, float)
    low, high = np.nanmin(values), np.nanmax(values)
    margin = 0.05 * (high - low)
    return low_px + (values - low + margin) / (high - low + 2 * margin) * (high_px - low_px)


def with_room(used, values, low_px, high_px):
    """Pixels where the scale follows `used` and leaves a fifth of their span on both sides for arrows."""
    low, high = np.nanmin(used), np.nanmax(used)
    margin = 0.2 * (high - low)
    return low_px + (values - low + margin) / (high - low + 2 * margin) * (high_px - low_px)


def is_inked(picture, x, y, reach=2):
    """Is there ink within `reach` pixels of a place counted from the lower left?"""
    row, column = int(round(picture.shape[0] - 1 - y)), int(round(x))
    return picture[max(row - reach, 0):row + reach + 1, max(column - reach, 0):column + reach + 1].min() < WHITE_LEVEL


def page_of(t, temp, axes):
    log = Log(t, temp, axes, {}, {}, "log.csv")
    looks = [look_at_axis(log, axis) for axis in axes]
    page = look_page(log, looks)
    return page, [panel for panel in page.panels if not panel.twin_of], picture_of(page), looks


def columns_with_ink(picture, box, margin=2):
    left, bottom, right, top = (int(round(v)) for v in box)
    part = picture[picture.shape[0] - top + margin:picture.shape[0] - bottom - margin, left + margin:right - margin]
    return part.min(axis=0) < 200  # the grid is paler


def test_dots_stand_where_the_data_are(tmp_path):
    t, _, rate = sensor(n=900)
    rate[400] = 6000.0  # far above all others
    none = np.full(len(t), np.nan)
    _, panels, picture, _ = page_of(t, none, {"gx_dph": rate})
    left, bottom, right, top = panels[0].box_px
    xs, ys = place((t - t[0]) / 60, left, right), with_room(np.delete(rate, 400), rate, bottom, top)
    assert all(is_inked(picture, x, y) for x, y in zip(np.delete(xs, 400), np.delete(ys, 400)))
    # the one is no dot: an arrow at the edge, with its value
    assert ys[400] > top and is_inked(picture, xs[400], top - 0.2 / 1.4 * 0.2 * (top - bottom), 3)
    assert any("6000" in words[2] for words in panels[0].words)


@pytest.mark.parametrize("n", [900, 8400, 30000])
def test_no_lone_value_is_lost(n):
    """A second alone among missing ones, and one far off, at places that no regular thinning meets."""
    t, _, rate = sensor(n=n)
    lone, far = int(0.6123 * n), int(0.2717 * n)
    rate[int(0.5 * n):int(0.7 * n)] = np.nan
    rate[lone], rate[far], rate[-1] = 420.0, 3000.0, -2000.0
    _, panels, picture, _ = page_of(t, np.full(n, np.nan), {"gx_dph": rate})
    left, bottom, right, top = panels[0].box_px
    usual = rate.copy()
    usual[[far, -1]] = np.nan
    xs, ys = place((t - t[0]) / 60, left, right), with_room(usual, rate, bottom, top)
    edge = 0.04 / 1.4 * (top - bottom)
    assert is_inked(picture, xs[far], top - edge, 3), "the far one"
    assert is_inked(picture, xs[-1], bottom + edge, 3), "the last one"
    assert is_inked(picture, xs[lone], ys[lone]), "the lone one"
    assert not is_inked(picture, xs[int(0.55 * n)], ys[lone], 1)


def test_nothing_is_drawn_in_a_gap_of_hours():
    t, _, rate = sensor(n=4000)
    t[2000:] += 4 * 3600
    _, panels, picture, _ = page_of(t, np.full(len(t), np.nan), {"gx_dph": rate})
    left, _, right, _ = panels[0].box_px
    inked = columns_with_ink(picture, panels[0].box_px)
    ends = place((t - t[0]) / 60, 0, right - left)
    first, last = int(ends[1999]), int(ends[2000])
    assert inked[:first].any() and inked[last:].any() and not inked[first + 4:last - 4].any()


def test_the_allan_deviation_is_drawn_where_it_is():
    t, temp, rate = sensor(n=3000)
    _, panels, picture, looks = page_of(t, temp, {"gx_dph": rate})
    left, residual = residual_of(temp, rate, 3)[0], panels[-1]
    tau = np.array([1, 2, 4, 8, 16, 32, 64, 128, 256])
    adev = np.array([allan(t, left, n) for n in tau])
    white = looks[0].white / np.sqrt(looks[0].allan_tau_s)
    low_x, low_y, high_x, high_y = residual.box_px
    assert len(looks[0].allan_tau_s) == len(tau) or len(looks[0].allan_tau_s) == len(tau) + 1
    taus = looks[0].allan_tau_s
    more = np.array([allan(t, left, int(n)) for n in taus])
    xs = place(taus, low_x, high_x, True)
    ys = place(np.concatenate([more, white, looks[0].allan_ci95.ravel()]), low_y, high_y, True)[:len(taus)]
    assert all(is_inked(picture, x, y, 1) for x, y in zip(xs, ys))
    np.testing.assert_allclose(more[:len(tau)], adev)


def test_names_and_ticks_say_what_is_drawn():
    t, temp, rate = sensor(n=3000)
    _, panels, _, _ = page_of(t, temp, {"gx_dph": rate})
    expected = [("time, min", (t - t[0]) / 60, rate), ("temperature, °C", temp, rate), ("temperature, °C", temp, None),
                ("time, min", (t - t[0]) / 60, None), ("averaging time, s", None, None)]
    assert len(panels) == 5
    for panel, (name, x, y) in zip(panels, expected):
        assert panel.x_name == name and "dph" in panel.y_name
        for scale, values, (low_px, high_px) in zip(panel.scales(), (x, y), (panel.box_px[0::2], panel.box_px[1::2])):
            places, texts, offset = scale.ticks()
            assert len(places) == len(texts) >= (1 if values is None and x is None else 2)
            for at, text in zip(places, texts):
                number = text.replace("\u2212", "-").replace("$", "").replace("\\mathdefault{", "").replace("}", "")
                if re.fullmatch(r"-?[\d.]+", number) and not offset:
                    assert float(number) == pytest.approx(at, rel=1e-6, abs=1e-9)
            if values is not None:
                inside = [v for v in places if np.min(values) <= v <= np.max(values)]
                span = np.max(values) - np.min(values)
                want = low_px + (np.array(inside) - np.min(values) + 0.05 * span) / (1.1 * span) * (high_px - low_px)
                np.testing.assert_allclose(scale.px(inside), want, atol=1)


@pytest.mark.parametrize("count", range(1, 8))
def test_every_axis_up_to_six_has_a_row(tmp_path, count):
    t, temp, _ = sensor(n=600)
    axes = {f"g{k}_dph": sensor(n=600, seed=k, offset=1000.0 * k)[2] for k in range(count)}
    found = look(write(tmp_path / "log.csv", t, temp, axes))
    shown = min(count, 6)
    assert [axis["axis"] for axis in found["axes"]] == [f"g{k}_dph" for k in range(shown)]
    from PIL import Image
    height = Image.open(tmp_path / "page.png").size[1]
    assert height == pytest.approx((shown * 2.7 + 0.6) * 80, abs=shown)


def test_an_axis_without_values_is_left_out_and_said(tmp_path, capsys):
    t, temp, rate = sensor(n=600)
    found = look(write(tmp_path / "log.csv", t, temp, {"gx_dph": rate, "gy_dph": np.full(600, np.nan)}))
    assert [axis["axis"] for axis in found["axes"]] == ["gx_dph"]
    assert "log.csv: axis gy_dph has 0 usable seconds: left out" in capsys.readouterr().err


@pytest.mark.parametrize("kind, words", [("empty", "0 usable seconds"), ("faulty", "0 usable seconds"), ("every 10 s", "10 s apart"),
                                         ("every 0.1 s", "0.1 s apart"), ("milliseconds", "milliseconds")])
def test_what_cannot_be_looked_at_is_refused_in_words(tmp_path, kind, words, capsys):
    t, temp, rate = sensor(n=600)
    flags = {"gx_flags": np.full(600, 4)} if kind == "faulty" else None
    step = {"every 10 s": 10, "every 0.1 s": 0.1, "milliseconds": 1000}.get(kind, 1)
    axes = {"gx_dph": np.full(600, np.nan) if kind == "empty" else rate}
    look(write(tmp_path / "log.csv", np.round(t * step, 3), temp, axes, flags), expect=3)
    said = capsys.readouterr().err
    assert "log.csv" in said and words in said and "Traceback" not in said
    assert not (tmp_path / "page.png").exists()


def test_flagged_seconds_have_no_part_in_the_figures(tmp_path, capsys):
    t, temp, rate = sensor(n=2000)
    flags = (np.arange(2000) % 50 == 7) * 1
    wrong = np.where(flags, 30000.0, rate)
    look(write(tmp_path / "log.csv", t, temp, {"gx_dph": wrong}, {"gx_flags": flags}))
    mean = float(re.search(r"gx_dph: mean (\S+) dph", capsys.readouterr().out)[1])
    assert mean == pytest.approx(rate[flags == 0].mean(), rel=6e-5)


def test_seconds_that_never_stand_side_by_side_have_no_allan_deviation(tmp_path, capsys):
    t, temp, rate = sensor(n=600)
    rate[::2] = np.nan
    found = look(write(tmp_path / "log.csv", t, temp, {"gx_dph": rate}))
    assert found["axes"][0]["allan"]["tau_s"] == []
    assert "no seconds stand side by side" in capsys.readouterr().out


@pytest.mark.parametrize("step", [12.0, 37.5])
def test_a_lattice_is_said_with_its_step(tmp_path, step, capsys):
    t, temp, rate = sensor(n=3000)
    look(write(tmp_path / "log.csv", t, temp, {"gx_dph": step * np.round(rate / step)}))
    text = capsys.readouterr().out
    said = re.search(r"gx_dph in steps of (\S+) dph", text)
    assert said and float(said[1]) == step
    look(write(tmp_path / "fine.csv", t, temp, {"gx_dph": rate}))
    assert "gx_dph in steps" not in capsys.readouterr().out


def test_a_constant_rate_has_a_page_and_its_mean(tmp_path, capsys):
    t, temp, _ = sensor(n=600)
    look(write(tmp_path / "log.csv", t, temp, {"gx_dph": np.full(600, 12.5)}))
    assert "gx_dph: mean 12.5 dph" in capsys.readouterr().out
    assert (tmp_path / "page.png").read_bytes()[:4] == b"\x89PNG"


class Tags(HTMLParser):
    """Open elements; elements and texts seen."""

    VOID = {"meta", "img", "br", "link", "hr"}

    def __init__(self):
        super().__init__()
        self.open, self.seen, self.texts = [], [], []

    def handle_starttag(self, tag, attributes):
        self.seen.append((tag, dict(attributes)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open.pop() == tag, f"</{tag}> closes nothing"

    def handle_data(self, data):
        self.texts.append(data)


@pytest.mark.parametrize("name", ["log.csv", "a & b <i>.csv", "it's.csv"])
def test_html_is_well_formed_and_holds_the_words_and_a_picture(tmp_path, name, capsys):
    t, temp, rate = sensor(n=600)
    found = look(write(tmp_path / name, t, temp, {"gx_dph": rate}), page="page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    tags = Tags()
    tags.feed(text)
    tags.close()
    assert tags.open == [] and text.lower().startswith("<!doctype html>")
    assert {tag for tag, _ in tags.seen} <= {"meta", "title", "style", "h1", "pre", "img", "html", "head", "body"}
    words = "".join(tags.texts)
    assert all(line in words for line in found["text"])
    image = next(attributes for tag, attributes in tags.seen if tag == "img")
    assert name in image["alt"] and image["src"].startswith("data:image/png;base64,")
    assert base64.b64decode(image["src"].split(",")[1], validate=True)[:4] == b"\x89PNG"
