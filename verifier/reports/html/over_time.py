"""Curves over time as SVG: panels on one axis, which the page's script can magnify; readable without."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verifier.reports.html.chart import LEFT, RIGHT, WIDTH, Mark, Scale, line_path, picture
from verifier.reports.html.elements import Node, decimal, name, node

Array = NDArray[np.float64]

_FINE = 6.0
"""Columns of points per unit of the picture: so far it can be magnified before corners are seen."""
_LEGEND, _GAP, _AXIS = 17.0, 16.0, 40.0
_PER_ROW = 3


@dataclass(frozen=True, slots=True)
class Series:
    """A curve: its name, instants (N,) [s] and values (N,); NaN: none there."""

    label: str
    t: Array
    values: Array


@dataclass(frozen=True, slots=True)
class Panel:
    """Curves of one quantity: label with unit, series, height."""

    label: str
    series: tuple[Series, ...]
    height: float = 150.0


def over_time(
    title: str, described: str, panels: Sequence[Panel], marks: Sequence[Mark] = (), *, anchor: str, axis: str
) -> Node:
    """Return a chart; ``anchor`` is its identity in the page, ``axis`` what its time is.

    Curves of the same place in each panel have one colour and one dash, which the legend names.
    """
    ends = [float(each.t[k]) for panel in panels for each in panel.series if len(each.t) for k in (0, -1)]
    begin, end = min(ends, default=0.0), max(ends, default=1.0)
    x = Scale(begin, max(end, begin + 1e-6), LEFT, WIDTH - RIGHT)
    legend = list(_legend([each.label for each in panels[0].series]))
    rows = (len(panels[0].series) + _PER_ROW - 1) // _PER_ROW
    top = 6.0 + _LEGEND * rows + 13.0 * len(marks)
    first = top
    fixed: list[Node] = []
    moving: list[Node] = []
    for panel in panels:
        y = _scale(panel, top)
        fixed += _frame(panel, x, y)
        moving += _curves(panel, x, y)
        top += panel.height + _GAP
    bottom = top - _GAP + 4.0
    moving += [
        node("line", x1=x(mark.t), x2=x(mark.t), y1=first - 8.0, y2=bottom, class_="mark") for mark in marks
    ]
    clip = node(
        "clipPath", node("rect", x=LEFT, y=0.0, width=x.end - x.start, height=bottom), id=f"{anchor}-clip"
    )
    drawn = node("g", node("g", *moving, class_="moves"), clip_path=f"url(#{anchor}-clip)")
    axes = node("g", *_time_axis(x, bottom), class_="ticks")
    labels = [_mark_label(mark, x, 6.0 + _LEGEND * rows + 13.0 * k + 8.0) for k, mark in enumerate(marks)]
    middle = (x.start + x.end) / 2.0
    caption = node("text", axis, x=middle, y=bottom + 33.0, text_anchor="middle", class_="tick")
    made = picture(
        title,
        described,
        (WIDTH, bottom + _AXIS - 4.0),
        [clip, *legend, *fixed, drawn, axes, *labels, caption],
    )
    for key, value in (
        ("begin", x.low),
        ("end", x.high),
        ("left", x.start),
        ("right", x.end),
        ("foot", bottom),
    ):
        made.set(f"data-{key}", repr(float(value)))
    made.set("class", "zooms")
    return made


def _legend(labels: Sequence[str]) -> Iterator[Node]:
    width = (WIDTH - LEFT - RIGHT) / _PER_ROW
    for k, label in enumerate(labels):
        x, y = LEFT + width * (k % _PER_ROW), 12.0 + _LEGEND * (k // _PER_ROW)
        yield node("path", d=f"M{decimal(x)} {decimal(y)}h34", class_=f"curve curve-{k + 1}")
        yield node("text", name(label), x=x + 40.0, y=y + 4.0)


def _scale(panel: Panel, top: float) -> Scale:
    shown = np.concatenate([np.zeros(1), *(each.values[np.isfinite(each.values)] for each in panel.series)])
    low, high = float(shown.min()), float(shown.max())
    room = max(0.05 * (high - low), 1e-6)
    return Scale(low - room, high + room, top + panel.height, top)


def _frame(panel: Panel, x: Scale, y: Scale) -> Iterator[Node]:
    for value in y.ticks(max(2, int(panel.height / 24))):
        yield node("line", x1=x.start, x2=x.end, y1=y(value), y2=y(value), class_="grid")
        yield node(
            "text", f"{value:.6g}", x=x.start - 8.0, y=y(value) + 4.0, text_anchor="end", class_="tick"
        )
    yield node("text", panel.label, x=4.0, y=(y.start + y.end) / 2.0 + 4.0)


def _curves(panel: Panel, x: Scale, y: Scale) -> Iterator[Node]:
    fine = Scale(x.low, x.high, x.start, x.start + _FINE * (x.end - x.start))
    for k, each in enumerate(panel.series):
        path = line_path(each.t, each.values, fine, y)
        if path:
            fitted = (
                f"translate({decimal(x.start)} 0) scale({1.0 / _FINE:.6f} 1) translate({decimal(-x.start)} 0)"
            )
            yield node("g", node("path", d=path, class_=f"curve curve-{k + 1}"), transform=fitted)


def _time_axis(x: Scale, y: float) -> Iterator[Node]:
    yield node("line", x1=x.start, x2=x.end, y1=y, y2=y, class_="frame")
    for value in x.ticks(10):
        yield node("line", x1=x(value), x2=x(value), y1=y, y2=y + 4.0, class_="frame")
        yield node("text", f"{value:.6g}", x=x(value), y=y + 17.0, text_anchor="middle", class_="tick")


def _mark_label(mark: Mark, x: Scale, y: float) -> Node:
    left = x(mark.t) > 0.75 * WIDTH
    anchor, aside = ("end", -4.0) if left else ("start", 4.0)
    made = node("text", mark.label, x=x(mark.t) + aside, y=y, text_anchor=anchor, class_="tick mark-label")
    made.set("data-t", repr(float(mark.t)))
    made.set("data-aside", repr(aside))
    return made
