# SPDX-License-Identifier: MIT
"""A calibration as one figure: raw and compensated bias against temperature, before and after, and the error of the
polynomial that was learned against the error the filter predicted.

A report is {"title", "subtitle", "axes": [axis...]}, one axis with
    axis                        name
    before: {temp_degc, rate_dph}   one-minute means of the uncompensated device, in the order of time
    after:  {temp_degc, rate_dph}   the same of the compensating device, profile run again
    table:  {temp_degc, bias_dph, sigma_dph}      learned polynomial and its predicted one-sigma error
    noise_alone_dph                 standard deviation of a one-minute mean by the noise of the model alone
    constant_dph                    taken off the raw rate in the plot (recorded logs)
    truth_error_dph                 learned minus true polynomial at table.temp_degc; absent for a recorded log

Rising, falling and resting temperature have their own colours and their own means: what depends on the direction shows as
a loop that no mean over both hides.
"""
import numpy as np

from ..direction import directions
from . import subplots
from .marks import DIRECTIONS, GRID, INK

COMPENSATED, TRUTH = "#2a7f9e", "#1d3557"
BIN_DEGC, FEWEST_IN_BIN = 5.0, 3
DOTS = {"ms": 4.5, "alpha": 0.7, "mew": 0}
STYLE = {
    "font.size": 10, "axes.edgecolor": "#9aa7b1", "axes.labelcolor": INK, "text.color": INK,
    "xtick.color": INK, "ytick.color": INK, "axes.grid": True, "grid.color": GRID, "axes.axisbelow": True,
    "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False, "figure.facecolor": "white",
}


def by_direction(temp_degc):
    """{1, -1, 0 (as imucal.direction says it): mask} of one-minute means in the order of time."""
    moves = directions(60.0 * np.arange(len(temp_degc)), temp_degc)
    return {value: moves == value for value in DIRECTIONS}


def means_per_temperature(temp_degc, rate_dph):
    """Mean temperature and rate in cells of BIN_DEGC that hold enough points."""
    cell = np.floor(temp_degc / BIN_DEGC)
    kept = [cell == c for c in np.unique(cell) if np.sum(cell == c) >= FEWEST_IN_BIN]
    return [np.mean(temp_degc[k]) for k in kept], [np.mean(rate_dph[k]) for k in kept]


def draw_directions(ax, minutes, constant=0, means=False, dots=True):
    """One-minute means, and their means per temperature, each direction in its colour."""
    temp, rate = np.asarray(minutes["temp_degc"], float), np.asarray(minutes["rate_dph"], float) - constant
    known = np.isfinite(temp) & np.isfinite(rate)
    temp, rate = temp[known], rate[known]
    for value, mask in by_direction(temp).items():
        mark = DIRECTIONS[value]
        if dots and mask.any():
            ax.plot(temp[mask], rate[mask], label=mark.word, alpha=0.7, **mark.style(3.6))
        if means and value:
            at, mean = means_per_temperature(temp[mask], rate[mask])
            ax.plot(at, mean, color=mark.color, lw=1.4, marker=mark.marker, ms=4.5, mec="white", mew=0.6,
                    label=f"mean, {mark.word}" if len(at) else None)


def draw_bias(ax, axis):
    """Upper panel: what the device says before and after, and what it learned."""
    constant = axis.get("constant_dph", 0)
    draw_directions(ax, axis["before"], constant)
    ax.plot(axis["table"]["temp_degc"], np.subtract(axis["table"]["bias_dph"], constant), color=INK, lw=1.2,
            label="polynomial learned")
    if constant:
        ax.text(0.98, 0.97, f"less {constant:.0f} deg/h", transform=ax.transAxes, va="top", ha="right", color="#5b6a75", fontsize=9)
    ax.plot(axis["after"]["temp_degc"], axis["after"]["rate_dph"], ".", color=COMPENSATED, label="after: compensated", zorder=1.5,
            **DOTS)
    ax.axhline(0, color=INK, lw=0.6)


def draw_compensated(ax, axis):
    """Middle panel: the compensated output, magnified."""
    noise = axis.get("noise_alone_dph")
    if noise:
        ax.axhspan(-noise, noise, color=GRID, lw=0, label="noise alone, one sigma")
    draw_directions(ax, axis["after"], means=True)
    ax.axhline(0, color=INK, lw=0.6)


def draw_predicted(ax, temp_degc, sigma_dph):
    """One and two of the sigmas that are predicted of a polynomial's error."""
    sigma = np.asarray(sigma_dph)
    ax.fill_between(temp_degc, -2 * sigma, 2 * sigma, color=COMPENSATED, alpha=0.10, lw=0, label="predicted two sigma")
    ax.fill_between(temp_degc, -sigma, sigma, color=COMPENSATED, alpha=0.22, lw=0, label="predicted one sigma")


def draw_error(ax, axis):
    """Lower panel: error of the polynomial against what the filter predicted of it."""
    draw_predicted(ax, axis["table"]["temp_degc"], axis["table"]["sigma_dph"])
    if axis.get("truth_error_dph"):
        ax.plot(axis["table"]["temp_degc"], axis["truth_error_dph"], color=TRUTH, lw=1.8, label="learned minus true polynomial")
    else:
        draw_directions(ax, axis["after"], means=True, dots=False)
    ax.axhline(0, color=INK, lw=0.6)


PANELS = (
    (draw_bias, "Before and after", "rate at rest [deg/h]"),
    (draw_compensated, "What is left, magnified", "compensated [deg/h]"),
    (draw_error, "Error of the polynomial", "error [deg/h]"),
)


def symmetric(axes_row):
    """One scale for a row of panels, symmetric about zero."""
    limit = max(abs(value) for ax in axes_row for value in ax.get_ylim())
    for ax in axes_row:
        ax.set_ylim(-limit, limit)


def calibration_figure(report):
    """The figure of a report (see the top of this file)."""
    axes = report["axes"]
    from matplotlib import rc_context
    with rc_context(STYLE):
        figure, grid = subplots(3, len(axes), size=(4.3 * len(axes) + 0.6, 9.8), squeeze=False, sharex=True, sharey="row",
                                height_ratios=[1.25, 1, 1])
        for column, axis in enumerate(axes):
            for row, (draw, _, label) in enumerate(PANELS):
                draw(grid[row][column], axis)
                if column == 0:
                    grid[row][column].set_ylabel(label)
                grid[row][column].text(0.02, 0.97, axis["axis"].rsplit("_", 1)[0], transform=grid[row][column].transAxes,
                                       va="top", fontweight="bold", color="#5b6a75")
            grid[2][column].set_xlabel("temperature [°C]")
        for row in (1, 2):
            symmetric(grid[row])
        figure.align_ylabels()
        figure.suptitle(report["title"], x=0.012, y=0.988, ha="left", fontsize=15, fontweight="bold")
        figure.text(0.012, 0.95, report["subtitle"], ha="left", va="center", fontsize=10, color="#5b6a75")
        figure.tight_layout(rect=(0, 0, 1, 0.925), h_pad=3.2)
        for row, (_, caption, _) in enumerate(PANELS):
            first, last = grid[row][0].get_position(), grid[row][-1].get_position()
            figure.text(first.x0, first.y1 + 0.010, caption, ha="left", va="bottom", fontsize=12, fontweight="bold")
            handles, labels = grid[row][0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="lower right", bbox_to_anchor=(last.x1, last.y1 + 0.004), ncol=len(handles),
                          fontsize=9.5, borderaxespad=0.2, handlelength=1.5, columnspacing=1.8)
    return figure
