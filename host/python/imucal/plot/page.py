# SPDX-License-Identifier: MIT
"""A page of many small panels, drawn straight by matplotlib's Agg renderer.

A page that is drawn once and then only looked at needs none of matplotlib's axes: their ticks, spines, labels and clip boxes
are more objects than all data, and take most of the time of loading, building and drawing.  A Panel answers the few calls of
an Axes that a first look makes, with the same margins, the same places of ticks (matplotlib.ticker) and the same dots and lines.
Lengths are points (1/72 inch), places of panels parts of the page, pixels count from the lower left corner.
"""
import io
from dataclasses import dataclass

import numpy as np

from .loading import load_renderer
from .marks import GRID, INK

TICK_PT, LABEL_PT, TITLE_PT, HEAD_PT = 7, 8, 9, 11
_MARGIN = 0.05           # of the data's span, as matplotlib leaves on each side
_N_STEPS = 5             # between ticks, at most
_FEW_DECADES = 2.5       # of a logarithmic scale: 1, 2 and 5 of each are ticks
_SAMPLE_PT, _BESIDE_PT, _APART_PT = 22, 5, 16  # of a legend: length of a sample, to its word, to the next


def log_locator(low, high):
    """Places of ticks of a logarithmic scale."""
    from matplotlib.ticker import LogLocator
    return LogLocator(subs=(1.0, 2.0, 5.0)) if np.log10(high / low) < _FEW_DECADES else LogLocator()


@dataclass
class Scale:
    """Limits of an axis, and the pixels that they stand at."""

    low: float
    high: float
    start_px: float
    end_px: float
    is_log: bool

    def px(self, values):
        """Pixels of values; NaN where a logarithm has none."""
        low, high, values = self.low, self.high, np.asarray(values, float)
        if self.is_log:
            low, high = np.log10([low, high])
            values = np.log10(np.where(values > 0, values, np.nan))
        return self.start_px + (values - low) * ((self.end_px - self.start_px) / (high - low))

    def ticks(self):
        """(places, their texts, what all texts are counted from or multiplied by, or "")."""
        from matplotlib.ticker import AutoLocator, ScalarFormatter
        locator = log_locator(self.low, self.high) if self.is_log else AutoLocator()
        if not self.is_log:
            locator.set_params(nbins=_N_STEPS)
        places = [p for p in locator.tick_values(self.low, self.high) if self.low <= p <= self.high]
        if self.is_log:
            return places, [f"{p:g}" for p in places], ""
        formatter = ScalarFormatter()
        formatter.create_dummy_axis()
        formatter.axis.set_view_interval(self.low, self.high)
        return places, formatter.format_ticks(places), formatter.get_offset()


def _limits(parts, is_log):
    """The finite values and a margin on both sides."""
    from matplotlib.ticker import Locator
    values = np.concatenate([np.ravel(part) for part in parts])
    values = values[np.isfinite(values)]
    if is_log:
        values = np.log10(values[values > 0])
    low, high = (values.min(), values.max()) if len(values) else (0.0, 1.0)
    low, high = Locator().nonsingular(low, high)  # two where all are one
    low, high = low - _MARGIN * (high - low), high + _MARGIN * (high - low)
    return (10.0 ** low, 10.0 ** high) if is_log else (float(low), float(high))


@dataclass
class Curve:
    """What plot() was asked for; line: "-", "--" or ""; marker: "o", "^", "v", "_" or ""."""

    x: np.ndarray
    y: np.ndarray
    line: str
    marker: str
    color: str
    width_pt: float
    size_pt: float
    is_filled: bool


def _curve_of(x, y, style, color, lw, ms, marker, ls, mfc):
    """A Curve of the words of matplotlib's plot()."""
    line = style.strip(".o^v_")
    if marker is None:
        marker = style.replace("-", "")
    if ls is not None:
        line = "" if ls == "none" else ls
    if marker == ".":  # matplotlib's point is a disc of half the size
        marker, ms = "o", ms / 2
    return Curve(np.asarray(x, float), np.asarray(y, float), line, marker, color, lw, ms, mfc != "none")


class Panel:
    """One plot: curves, bands, limits, ticks, names."""

    def __init__(self, page, box_px, twin_of=None):
        self.page, self.box_px, self.twin_of = page, box_px, twin_of
        self.curves, self.bands, self.levels, self.words, self.is_log, self.y_limits = [], [], [], [], False, None
        self.x_name = self.y_name = self.title = ""
        self.color = INK

    def plot(self, x, y, style="-", *, color, lw=1.0, ms=0.0, marker=None, ls=None, mfc=None, **_):
        """A curve: "-", "--", "." (dots) or "o-" (discs and a line); or marker and ls as matplotlib has them."""
        self.curves.append(_curve_of(x, y, style, color, lw, ms, marker, ls, mfc))

    def loglog(self, x, y, style="-", **how):
        """A curve; both axes are logarithmic from now on."""
        self.is_log = True
        self.plot(x, y, style, **how)

    def fill_between(self, x, low, high, *, color, alpha, lw=0, **_):
        """A band."""
        self.bands.append((np.asarray(x, float), np.asarray(low, float), np.asarray(high, float), color, alpha))

    def text(self, x, y, words, *, color, fontsize=TICK_PT, ha="left", va="top", **_):
        """Words at a point of the data."""
        self.words.append((x, y, words, color, fontsize, {"left": 0, "center": 0.5, "right": 1}[ha], 1 if va == "top" else 0))

    def set_ylim(self, low, high):
        """Limits that do not follow the curves."""
        self.y_limits = float(low), float(high)

    def axhline(self, y, *, color, lw):
        """A level from side to side."""
        self.levels.append((float(y), color, lw))

    def twinx(self):
        """Another panel in the same place, with its own scale on the right."""
        return self.page.add(Panel(self.page, self.box_px, self))

    def name(self, x, y, title=None, color=INK):
        """Words beside the axes and above."""
        self.x_name, self.y_name, self.title, self.color = x or "", y or "", title or "", color

    def scales(self):
        """(Scale of x, Scale of y)."""
        left, bottom, right, top = self.box_px
        x = _limits([curve.x for curve in self.curves] + [band[0] for band in self.bands], self.is_log)
        y = self.y_limits or _limits([curve.y for curve in self.curves] + [level[0] for level in self.levels]
                                     + [edge for band in self.bands for edge in band[1:3]], self.is_log)
        return Scale(*x, left, right, self.is_log), Scale(*y, bottom, top, self.is_log)


class Page:
    """Panels on white; width and height in inches."""

    def __init__(self, width_in, height_in, dpi=80):
        load_renderer()
        from matplotlib.backends.backend_agg import RendererAgg
        self._renderer = RendererAgg(round(width_in * dpi), round(height_in * dpi), dpi)
        self.width_px, self.height_px = self._renderer.width, self._renderer.height
        self.panels, self.title, self.legend, self._fonts, self._texts = [], "", [], {}, []

    def add(self, panel):
        """A panel that is drawn with the page."""
        self.panels.append(panel)
        return panel

    def panel(self, left, bottom, right, top):
        """A new panel between these parts of the page's width and height."""
        return self.add(Panel(self, (left * self.width_px, bottom * self.height_px, right * self.width_px, top * self.height_px)))

    def png(self):
        """The picture as the bytes of a PNG file."""
        from PIL import Image
        self._renderer.clear()
        self._texts.clear()
        for panel in self.panels:
            self._draw(panel)
        self._draw_head()
        drawn = Image.frombuffer("RGBA", (self.width_px, self.height_px), bytes(self._renderer.buffer_rgba()), "raw", "RGBA", 0, 1)
        picture = Image.new("RGB", drawn.size, "white")
        picture.paste(drawn, mask=drawn)
        self._write(picture)
        data = io.BytesIO()
        picture.save(data, "png", compress_level=1)
        return data.getvalue()

    # What is drawn with

    def _px(self, pt):
        return self._renderer.points_to_pixels(pt)

    def _pen(self, color, width_pt, clip=None):
        from matplotlib.transforms import Bbox
        pen = self._renderer.new_gc()
        pen.set_foreground(color)
        pen.set_linewidth(self._px(width_pt))
        pen.set_joinstyle("round")
        if clip:
            pen.set_clip_rectangle(Bbox.from_extents(*clip))
        return pen

    def _curve(self, points, pen):
        from matplotlib.path import Path
        from matplotlib.transforms import IdentityTransform
        self._renderer.draw_path(pen, Path(points), IdentityTransform())

    def _strokes(self, strokes, color, width_pt, clip=None):
        """Straight lines ((x, y), (x, y))."""
        if strokes:
            self._curve(np.array([(*stroke, (np.nan, np.nan)) for stroke in strokes], float).reshape(-1, 2), self._pen(color, width_pt, clip))

    def _markers(self, points, curve, clip):
        from matplotlib.colors import to_rgba
        from matplotlib.path import Path
        from matplotlib.transforms import Affine2D, IdentityTransform
        corners = {"^": [(-1, -1), (1, -1), (0, 1), (-1, -1)], "v": [(-1, 1), (1, 1), (0, -1), (-1, 1)], "_": [(-1, 0), (1, 0)]}
        path = Path(corners[curve.marker]) if curve.marker in corners else Path.unit_circle()
        pen = self._pen(curve.color, 1.0 if curve.is_filled else 0.6, clip)
        self._renderer.draw_markers(pen, path, Affine2D().scale(self._px(curve.size_pt) / 2), Path(points), IdentityTransform(),
                                    to_rgba(curve.color) if curve.is_filled else None)

    def _band(self, points, color, alpha, clip):
        from matplotlib.colors import to_rgba
        from matplotlib.path import Path
        from matplotlib.transforms import IdentityTransform
        pen = self._pen(color, 0.0, clip)
        self._renderer.draw_path(pen, Path(points), IdentityTransform(), to_rgba(color, alpha))

    def _font(self, size_pt):
        from matplotlib.font_manager import findfont
        from PIL import ImageFont
        if size_pt not in self._fonts:
            self._fonts[size_pt] = ImageFont.truetype(findfont("DejaVu Sans"), self._px(size_pt), layout_engine=ImageFont.Layout.BASIC)
        return self._fonts[size_pt]

    def _width(self, text, size_pt):
        return self._font(size_pt).getlength(text)

    def _text(self, x, y, text, size_pt, color, *, right=0.5, up=0.5, is_upright=True):
        """Text at a point, drawn when all else is.  right, up: the part of its width, and of its height (of a digit at 0.5, else of a
        line), before the point."""
        font = self._font(size_pt)
        _, above, _, below = font.getbbox("0" if up == 0.5 else "lp", anchor="ls")  # from the base line, down
        along = -right * self._width(text, size_pt)
        across = 0.5 * above if up == 0.5 else (1 - up) * below + up * above
        x, y = (x + along, y + across) if is_upright else (x - across, y + along)
        self._texts.append((round(x), round(self.height_px - y), text, font, color, is_upright))

    def _write(self, picture):
        """Texts by Pillow, which takes a twentieth of the renderer's time for them."""
        from PIL import Image, ImageDraw
        page = ImageDraw.Draw(picture)
        for x, y, text, font, color, is_upright in self._texts:
            if is_upright:
                page.text((x, y), text, fill=color, font=font, anchor="ls")
                continue
            left, top, right, bottom = font.getbbox(text, anchor="ls")
            mask = Image.new("L", (int(right) + 1, int(bottom - top) + 2))
            ImageDraw.Draw(mask).text((0, 1 - top), text, fill=255, font=font, anchor="ls")
            mask = mask.transpose(Image.Transpose.ROTATE_90)
            picture.paste(color, (x + int(top) - 1, y - mask.height), mask)

    # What is drawn

    def _draw(self, panel):
        x, y = (panel.twin_of or panel).scales()[0], panel.scales()[1]
        x_ticks, y_ticks = x.ticks(), y.ticks()
        if not panel.twin_of:
            self._draw_grid(panel.box_px, x.px(x_ticks[0]), y.px(y_ticks[0]))
        self._draw_curves(panel, x, y)
        if not panel.twin_of:
            self._draw_below(panel, x, x_ticks)
        self._draw_beside(panel, y, y_ticks)
        if panel.title:
            self._text(panel.box_px[0], panel.box_px[3] + self._px(6), panel.title, TITLE_PT, INK, right=0, up=0)

    def _draw_head(self):
        """The page's title, and the legend below it, at the upper edge."""
        top, now = self.height_px - self._px(6), self._px(12)
        if self.title:
            self._text(now, top, self.title, HEAD_PT, INK, right=0, up=1)
        middle = top - self._px(24)
        for word, how in self.legend:
            sample = _curve_of([0], [0], **{"style": "", "lw": 1.0, "ms": 0.0, "marker": None, "ls": None, "mfc": None, **how})
            ends = np.array([(now, middle), (now + self._px(_SAMPLE_PT), middle)])
            if sample.line:
                self._draw_curve(ends, Curve(**{**vars(sample), "marker": ""}), None)
            if sample.marker:
                self._markers(ends.mean(axis=0, keepdims=True), sample, None)
            self._text(ends[1, 0] + self._px(_BESIDE_PT), middle, word, LABEL_PT, INK, right=0)
            now = ends[1, 0] + self._px(_BESIDE_PT + _APART_PT) + self._width(word, LABEL_PT)

    def _draw_grid(self, box_px, x_px, y_px):
        left, bottom, right, top = box_px
        self._strokes([((x, bottom), (x, top)) for x in x_px] + [((left, y), (right, y)) for y in y_px], GRID, 0.6)

    def _draw_curve(self, points, curve, clip):
        if curve.line:
            pen = self._pen(curve.color, curve.width_pt, clip)
            if curve.line == "--":
                pen.set_dashes(0, [self._px(3.7 * curve.width_pt), self._px(1.6 * curve.width_pt)])
            self._curve(points, pen)
        if curve.marker:
            self._markers(points, curve, clip)

    def _draw_curves(self, panel, x_scale, y_scale):
        left, _, right, _ = panel.box_px
        for x, low, high, color, alpha in panel.bands:
            known = np.isfinite(low) & np.isfinite(high)
            if known.sum() > 1:
                across = np.concatenate([x_scale.px(x[known]), x_scale.px(x[known])[::-1]])
                up = np.concatenate([y_scale.px(low[known]), y_scale.px(high[known])[::-1]])
                self._band(np.column_stack([across, up]), color, alpha, panel.box_px)
        for curve in panel.curves:
            self._draw_curve(np.column_stack([x_scale.px(curve.x), y_scale.px(curve.y)]), curve, panel.box_px)
        for x, y, words, color, size_pt, right_part, up in panel.words:
            self._text(float(x_scale.px(x)), float(y_scale.px(y)), words, size_pt, color, right=right_part, up=up)
        for level, color, width_pt in panel.levels:
            height = float(y_scale.px(level))
            self._strokes([((left, height), (right, height))], color, width_pt, panel.box_px)

    def _draw_below(self, panel, scale, ticks):
        left, bottom, right, _ = panel.box_px
        places = scale.px(ticks[0])
        self._strokes([((left, bottom), (right, bottom))] + [((x, bottom), (x, bottom - self._px(3.5))) for x in places], INK, 0.8)
        for x, word in zip(places, ticks[1]):
            self._text(x, bottom - self._px(7), word, TICK_PT, INK, up=1)
        self._text((left + right) / 2, bottom - self._px(17), panel.x_name + _in_brackets(ticks[2]), LABEL_PT, INK, up=1)

    def _draw_beside(self, panel, scale, ticks):
        """Left; of a twin right."""
        left, bottom, right, top = panel.box_px
        side, sign = (right, 1) if panel.twin_of else (left, -1)
        places = scale.px(ticks[0])
        self._strokes([((side, bottom), (side, top))] + [((side, y), (side + sign * self._px(3.5), y)) for y in places], panel.color, 0.8)
        for y, word in zip(places, ticks[1]):
            self._text(side + sign * self._px(7), y, word, TICK_PT, panel.color, right=0 if panel.twin_of else 1)
        beyond = self._px(10) + max((self._width(word, TICK_PT) for word in ticks[1]), default=0)
        self._text(side + sign * beyond, (bottom + top) / 2, panel.y_name + _in_brackets(ticks[2]), LABEL_PT, panel.color, up=1 if panel.twin_of else 0,
                   is_upright=False)


def _in_brackets(offset):
    return f" ({offset})" if offset else ""
