"""A picture of one frame: what each model of people predicts, and where the person was then."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from verifier.outline import edge_of_union, project
from verifier.reports.picture import rendered, require_drawing
from verifier.reports.sets_panel import SEVERAL, Panel, bones, panel_of
from verifier.shown import shown
from verifier.snapshot import Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

Array = NDArray[np.float64]

_COLOURS: Final = {
    SEVERAL: "#7f7f7f",
    "trunk and head": "#0072b2",
    "legs": "#56b4e9",
    "arms": "#e69f00",
    "hands": "#009e73",
}
"""Of each group, in the order in which they are drawn: those of Okabe and Ito, which people with any colour
vision tell apart."""
_NOW, _LATER, _OUTSIDE = "#757575", "#000000", "#c1121f"
_FILL: Final = 0.2
_LEAST_MARGIN_M, _MOST_MARGIN_M = 0.3, 1.5
"""How far the panels go beyond the skeletons [m]; what goes farther is cut off."""
_LENGTHS_M = (0.1, 0.2, 0.5, 1.0)
"""Of the bar that shows the scale."""
_NARROW_IN, _WIDE_IN, _SHEET_IN = 2.4, 4.0, 7.5
"""Least width of a panel, most width and height of a wider one, least width of all together [inch]."""
_TOP_IN, _LEFT_IN, _GAP_IN, _LINE_IN = 1.12, 0.35, 0.08, 0.17
"""Room for the title, for the names of the rows, between panels, and for a line of text [inch]."""
_LEGEND_COLUMN_IN, _LEGEND_LINE_IN = 2.9, 0.23


def sets_picture(snapshot: Snapshot, kind: str = "png") -> bytes:
    """Return a picture: a row of panels for each horizon, a column for each model, seen from one side.

    Raises
    ------
    SetupError
        matplotlib is not installed.
    """
    require_drawing()
    rows = [[panel_of(snapshot, h, each) for each in models] for h, models in enumerate(snapshot.predicted)]
    now = project(snapshot.points, snapshot.along)
    legend = _legend([panel for row in rows for panel in row])
    figure, grid = _sheet(_window(now, rows), rows, legend)
    for h, row in enumerate(rows):
        for axes, panel in zip(grid[h], row, strict=True):
            _draw_sets(axes, panel)
            _draw_people(axes, panel, now)
            _write(axes, panel)
        grid[h][0].set_ylabel(f"{1e3 * snapshot.after_s[h]:.0f} ms later", fontsize=13)
    for axes, panel in zip(grid[0], rows[0], strict=True):
        axes.set_title(panel.model, fontsize=12, parse_math=False)
    _write_title(figure, snapshot)
    _draw_scale(figure, grid[0][-1])
    return rendered(figure, kind)


def _window(now: Array, rows: Sequence[Sequence[Panel]]) -> Array:
    """Lower left and upper right corner (2, 2) [m] of every panel.

    On each side there is room for the sets of half of the panels, within limits.
    """
    panels = [panel for row in rows for panel in row]
    skeletons = np.vstack([now, *(panel.points for panel in panels)])
    low, high = np.nanmin(skeletons, axis=0), np.nanmax(skeletons, axis=0)
    drawn = [np.vstack([low, high, panel.corners]) for panel in panels]
    beyond = np.array([[low - each.min(axis=0), each.max(axis=0) - high] for each in drawn])
    margin = np.clip(
        np.quantile(beyond, 0.5, axis=0, method="higher") + 0.05, _LEAST_MARGIN_M, _MOST_MARGIN_M
    )
    return np.array([low - margin[0], high + margin[1]])


def _sheet(
    window: Array, rows: Sequence[Sequence[Panel]], legend: Sequence[Patch | Line2D]
) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure with its legend, and axes of the shape of the window for each panel."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = len(rows[0])
    steep = float(window[1, 1] - window[0, 1]) / float(window[1, 0] - window[0, 0])
    wide = max(_NARROW_IN, min(_WIDE_IN, _WIDE_IN / steep, _SHEET_IN / columns))
    high = wide * steep
    panels_in = columns * (wide + _GAP_IN)
    width = _LEFT_IN + max(_SHEET_IN, panels_in)
    legend_columns = int(width / _LEGEND_COLUMN_IN)
    lines = [max(panel.finding.count("\n") + 1 for panel in row) for row in rows]
    tops = np.cumsum([_TOP_IN, *(high + 2 * _GAP_IN + _LINE_IN * n for n in lines)])
    height = float(tops[-1]) + _LEGEND_LINE_IN * (math.ceil(len(legend) / legend_columns) + 1)
    figure = Figure(figsize=(width, height), dpi=100)
    FigureCanvasAgg(figure)
    figure.legend(handles=legend, loc="lower center", ncols=legend_columns, frameon=False, fontsize=11)

    def axes_of(h: int, m: int) -> Axes:
        left = width - max(_SHEET_IN, panels_in) * 0.5 - panels_in * 0.5 + m * (wide + _GAP_IN)
        bottom = height - float(tops[h]) - high
        axes = figure.add_axes((left / width, bottom / height, wide / width, high / height))
        axes.set(xlim=window[:, 0], ylim=window[:, 1], xticks=[], yticks=[], aspect="equal")
        axes.spines[:].set_color("#bbbbbb")
        return axes

    return figure, [[axes_of(h, m) for m in range(columns)] for h in range(len(rows))]


def _draw_sets(axes: Axes, panel: Panel) -> None:
    """Fill what the outlines of each group cover together, and draw its edge."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    for group, colour in _COLOURS.items():
        if outlines := panel.outlines.get(group):
            covered = Path.make_compound_path(*(Path(np.vstack([o, o[:1]]), closed=True) for o in outlines))
            axes.add_patch(PathPatch(covered, facecolor=colour, alpha=_FILL, linewidth=0))
            for line in edge_of_union(outlines):
                axes.plot(*line.T, color=colour, linewidth=1.4)


def _draw_people(axes: Axes, panel: Panel, now: Array) -> None:
    """Draw the skeleton of the frame, and the later one with what is said of each of its points."""
    from matplotlib.patches import Circle

    for points, colour, width in ((now, _NOW, 1.0), (panel.points, _LATER, 1.6)):
        for a, b in bones(points):
            axes.plot(*points[[a, b]].T, color=colour, linewidth=width, solid_capstyle="round")
    for outlines in panel.missed.values():
        for line in edge_of_union(outlines):
            axes.plot(*line.T, "--", color=_OUTSIDE, linewidth=1.1)
    axes.plot(*panel.points[panel.inside].T, "o", color=_LATER, markersize=3.5)
    axes.plot(*panel.points[panel.silent].T, "o", color=_LATER, markerfacecolor="white", markersize=3.5)
    for p in np.flatnonzero(panel.outside):
        x, y = panel.points[p]
        axes.add_patch(Circle((x, y), panel.flesh_m[p], fill=False, edgecolor=_OUTSIDE, linewidth=1.2))
        axes.plot(x, y, "X", color=_OUTSIDE, markeredgecolor="white", markeredgewidth=0.5, markersize=7)


def _write(axes: Axes, panel: Panel) -> None:
    """Write below a panel what was found, and in it how wide is what its edge cuts off."""
    from matplotlib.patheffects import withStroke

    colour = _OUTSIDE if panel.outside.any() else "black"
    axes.set_xlabel(panel.finding, loc="left", labelpad=3.0, fontsize=9, color=colour)
    corners, (left, right), (low, high) = panel.corners, axes.get_xlim(), axes.get_ylim()
    if (corners < (left, low)).any() or (corners > (right, high)).any():
        axes.text(
            0.97, 0.025, f"{np.ptp(corners[:, 0]):.1f} m wide", fontsize=10, ha="right",
            transform=axes.transAxes, path_effects=[withStroke(linewidth=3.0, foreground="white")],
        )  # fmt: skip


def _draw_scale(figure: Figure, axes: Axes) -> None:
    """Draw a bar of a round length above the panel in the upper right corner, in the scale of all."""
    from matplotlib.lines import Line2D

    (left, right), (_, top) = axes.get_xlim(), axes.get_ylim()
    length = max(each for each in _LENGTHS_M if each <= max(0.4 * (right - left), _LENGTHS_M[0]))
    height = figure.get_size_inches()[1]
    on_paper = axes.transData + figure.transFigure.inverted()
    ends, y = on_paper.transform([(right - length, top), (right, top)]), 1.0 - 0.52 / height
    figure.add_artist(Line2D(ends[:, 0], [y, y], color="black", linewidth=3.0, solid_capstyle="butt"))
    figure.text(ends[:, 0].mean(), y + 0.05 / height, f"{length:g} m", fontsize=11, ha="center")


def _write_title(figure: Figure, snapshot: Snapshot) -> None:
    width, height = figure.get_size_inches()
    ends = " and ".join(f"{1e3 * after:.0f}" for after in snapshot.after_s)
    what = f"what each model predicts for {ends} ms later, and where the person was then"
    person, profile = _drawable(snapshot.person, 30), _drawable(snapshot.profile, 30)
    lines = (
        (_drawable(snapshot.recording, 60), 14, 0.08),
        (f"{person} at {snapshot.at_s:.3f} s, profile {profile}", 11, 0.35),
        (what, 11, 0.57),
    )
    for line, size, down in lines:
        figure.text(_LEFT_IN / width, 1.0 - down / height, line, fontsize=size, va="top", parse_math=False)


def _drawable(name: str, longest: int) -> str:
    """Return a name with its code for each character that the font does not have."""
    from matplotlib.font_manager import FontProperties, findfont, get_font

    font = get_font(findfont(FontProperties()))
    return "".join(
        c if font.get_char_index(ord(c)) else c.encode("unicode_escape").decode("ascii")
        for c in shown(name, longest)
    )


def _legend(panels: Sequence[Panel]) -> list[Patch | Line2D]:
    """Return what stands in the legend: what is in any of the panels."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    groups = {group for panel in panels for group in panel.outlines}
    entries: list[Patch | Line2D] = [
        Patch(facecolor=(colour, _FILL), edgecolor=colour, linewidth=1.4, label=group)
        for group, colour in reversed(_COLOURS.items())
        if group in groups
    ]
    entries += [
        Line2D([], [], color=_NOW, linewidth=1.0, label="the person at the frame"),
        Line2D([], [], color=_LATER, linewidth=1.6, marker="o", markersize=4, label="and then, inside"),
    ]
    if any((np.isfinite(panel.points[:, 0]) & panel.silent).any() for panel in panels):
        dot = Line2D([], [], color=_LATER, linewidth=0.0, marker="o", markersize=4, label="nothing is said")
        dot.set_markerfacecolor("white")
        entries.append(dot)
    if any(panel.outside.any() for panel in panels):
        text = "with its flesh (circle) outside of its part's rows (dashed)"
        entries.append(Line2D([], [], color=_OUTSIDE, linewidth=0.0, marker="X", markersize=7, label=text))
    return entries
