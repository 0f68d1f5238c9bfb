# SPDX-License-Identifier: MIT
"""Colours and markers of all pictures: one meaning each.

Rising, falling and resting temperature differ in marker and in lightness too, so that a grey print and an eye that sees no
red tell them apart."""
from dataclasses import dataclass

from ..direction import FALLING, RESTING, RISING

INK, MUTED, GRID = "#1d2733", "#66727f", "#dfe4ea"
CURVE = "#1d2733"          # a polynomial, a smoothed record: what was computed of the data
TEMPERATURE = "#4f8a6b"
LIKELIHOOD = "#8e4a9e"     # what a model expects
WARNING = "#b00020"        # a value that does not fit into the picture


@dataclass(frozen=True)
class Mark:
    """How a direction is drawn; size: of its marker, beside that of a dot."""

    word: str
    color: str
    marker: str
    is_filled: bool
    size: float

    def style(self, size):
        """Keywords of plot() on matplotlib's axes."""
        return {"marker": self.marker, "ls": "none", "color": self.color, "ms": size * self.size,
                "mew": 0 if self.is_filled else 0.6, "mfc": self.color if self.is_filled else "none"}


#: drawn in this order: rest below
DIRECTIONS = {RESTING: Mark("at rest", "#8a949e", "_", False, 1.0), FALLING: Mark("falling", "#15508f", "o", True, 0.75),
              RISING: Mark("rising", "#d9601a", "^", False, 1.1)}


def draw_directions(ax, x, y, direction, size=3.0, label=False, **more):
    """Points of a curve, each direction with its mark, on matplotlib's axes or a Panel."""
    for value, mark in DIRECTIONS.items():
        these = direction == value
        if these.any():
            ax.plot(x[these], y[these], label=mark.word if label else None, **mark.style(size), **more)
