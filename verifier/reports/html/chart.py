"""Charts over time as SVG: the ribbon of verdicts and curves below it, on one axis of time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verifier.reports.html.elements import Node, add, decimal, node
from verifier.reports.stretches import runs
from verifier.verdict import Status

Array = NDArray[np.float64]

WIDTH, LEFT, RIGHT = 960.0, 118.0, 12.0
"""Of every chart, its left and right margin, in units of the picture (pixels on a wide screen)."""
_LANE, _LANE_GAP, _AXIS = 15.0, 4.0, 40.0
_LEAST_WIDTH = 1.2
"""One cycle of an hour would be invisible: each stretch is drawn at least so wide."""
LANES = (Status.VERIFIED, Status.NOT_VERIFIED, Status.CONTRADICTED, Status.NOT_CHECKED)
"""A lane for each status, so that nobody needs to tell colours apart."""


@dataclass(frozen=True, slots=True)
class Scale:
    """A linear scale from values ``low`` … ``high`` to places ``start`` … ``end``."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        """Return the place of a value."""
        return float(self.start + (self.end - self.start) * (value - self.low) / (self.high - self.low))

    def ticks(self, most: int = 8) -> list[float]:
        """Return round values within the scale, at most about ``most``."""
        step = _round_up((self.high - self.low) / most)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [k * step for k in range(first, last + 1)]


def _round_up(step: float) -> float:
    """Return the next of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= step * (1 - 1e-9))


@dataclass(frozen=True, slots=True)
class Curve:
    """What is drawn over time below the ribbon.

    Attributes
    ----------
    label:
        Quantity and unit.
    series:
        Each (N,) values of one result; NaN: none there.
    zero:
        A line is drawn at zero.
    height:
        Of the panel.
    """

    label: str
    series: tuple[Array, ...]
    zero: bool = False
    height: float = 150.0


@dataclass(frozen=True, slots=True)
class Track:
    """The verdicts of one result: label, instants (N,) [s], status (N,), and the length of a cycle [s]."""

    label: str
    t: Array
    status: NDArray[np.uint8]
    step: float


@dataclass(frozen=True, slots=True)
class Mark:
    """An instant [s] that a vertical line shows, and what it is."""

    t: float
    label: str


def timeline(
    title: str,
    described: str,
    tracks: Sequence[Track],
    curves: Sequence[Curve],
    marks: Sequence[Mark] = (),
    window: tuple[float, float] | None = None,
) -> Node:
    """Return a chart: a ribbon for each track, then the curves, over recorded time [s].

    Parameters
    ----------
    title, described:
        For whoever does not see it: what it is, and what it shows.
    curves:
        Series k of each is that of track k.
    window:
        Begin and end of the axis [s]; ``None``: all of it.
    """
    begin = min((float(track.t[0]) for track in tracks if len(track.t)), default=0.0)
    end = max((float(track.t[-1]) + track.step for track in tracks if len(track.t)), default=1.0)
    x = Scale(*(window or (begin, max(end, begin + 1e-3))), LEFT, WIDTH - RIGHT)
    parts: list[Node] = []
    marks = [mark for mark in marks if x.low <= mark.t <= x.high]
    top = 6.0 + 13.0 * len(marks)
    for track in tracks:
        if track.label:
            parts.append(node("text", track.label, x=LEFT, y=top + 10.0))
            top += 15.0
        parts += _ribbon(track, x, top)
        top += len(LANES) * (_LANE + _LANE_GAP) + 6.0
    for curve in curves:
        parts += _panel(curve, [track.t for track in tracks], x, top)
        top += curve.height + 14.0
    bottom = top - 14.0 + 4.0
    parts += _time_axis(x, bottom)
    for row, mark in enumerate(marks):
        parts += _mark(mark, x, 13.0 * row + 10.0, bottom)
    return picture(title, described, (WIDTH, bottom + _AXIS - 4.0), parts)


def _mark(mark: Mark, x: Scale, y: float, bottom: float) -> Iterator[Node]:
    """Draw an instant, with its name above everything else, each in a line of its own."""
    place = x(mark.t)
    left = place > 0.75 * WIDTH
    yield node("line", x1=place, x2=place, y1=y - 8.0, y2=bottom, class_="mark")
    anchor, aside = ("end", -4.0) if left else ("start", 4.0)
    yield node("text", mark.label, x=place + aside, y=y, text_anchor=anchor, class_="tick")


def picture(title: str, described: str, size: tuple[float, float], parts: Sequence[Node]) -> Node:
    """Return an SVG with a name and a description for whoever does not see it."""
    width, height = size
    svg = node("svg", viewBox=f"0 0 {decimal(width)} {decimal(height)}", role="img")
    svg.set("aria-label", f"{title}. {described}")
    add(svg, node("title", title), node("desc", described), *parts)
    return svg


def words(status: Status) -> str:
    """Return the name of a status for people."""
    return status.name.lower().replace("_", " ")


def css_class(status: Status) -> str:
    """Return the class of a status."""
    return status.name.lower().replace("_", "-")


def _ribbon(track: Track, x: Scale, top: float) -> Iterator[Node]:
    ends = np.append(track.t, track.t[-1] + track.step) if len(track.t) else np.zeros(1)
    for lane, status in enumerate(LANES):
        y = top + lane * (_LANE + _LANE_GAP)
        yield node("text", words(status), x=LEFT - 8.0, y=y + 12.0, text_anchor="end", class_="tick")
        yield node("line", x1=LEFT, x2=WIDTH - RIGHT, y1=y + _LANE, y2=y + _LANE, class_="grid")
        pieces = _merged(
            (max(x(ends[i]), x.start), min(x(ends[j]), x.end))
            for i, j in runs(track.status == int(status))
            if ends[j] > x.low and ends[i] < x.high
        )
        path = "".join(
            f"M{decimal(a)} {decimal(y)}H{decimal(b)}v{decimal(_LANE)}H{decimal(a)}z" for a, b in pieces
        )
        if path:
            yield node("path", d=path, class_=css_class(status))


def _merged(pieces: Iterator[tuple[float, float]]) -> list[tuple[float, float]]:
    """Widen what would not be seen, and join what touches: an hour is no larger than its pixels."""
    out: list[tuple[float, float]] = []
    for a, b in pieces:
        b = max(b, a + _LEAST_WIDTH)
        if out and a <= out[-1][1]:
            out[-1] = (out[-1][0], max(b, out[-1][1]))
        else:
            out.append((a, b))
    return out


def _panel(curve: Curve, times: Sequence[Array], x: Scale, top: float) -> Iterator[Node]:
    low, high = _range(curve, times, x)
    y = Scale(low, high, top + curve.height, top)
    for value in y.ticks(max(2, int(curve.height / 22))):
        yield node("line", x1=x.start, x2=x.end, y1=y(value), y2=y(value), class_="grid")
        yield node(
            "text", f"{value:.6g}", x=x.start - 8.0, y=y(value) + 4.0, text_anchor="end", class_="tick"
        )
    yield node("text", curve.label, x=4.0, y=top + curve.height / 2.0 + 4.0)
    if curve.zero and low <= 0.0 <= high:
        yield node("line", x1=x.start, x2=x.end, y1=y(0.0), y2=y(0.0), class_="zero")
    drawn = False
    for k, (t, values) in enumerate(zip(times, curve.series, strict=True)):
        path = line_path(t, values, x, y)
        drawn |= bool(path)
        if path:
            yield node("path", d=path, class_=f"curve curve-{k + 1}")
    if not drawn:
        middle = (x.start + x.end) / 2.0
        yield node("text", "nothing to draw", x=middle, y=top + curve.height / 2.0, text_anchor="middle")


def _range(curve: Curve, times: Sequence[Array], x: Scale) -> tuple[float, float]:
    """Return the least and the greatest value that is drawn, with some room."""
    shown = [
        values[np.isfinite(values) & (t >= x.low) & (t <= x.high)]
        for t, values in zip(times, curve.series, strict=True)
    ]
    every = np.concatenate([np.zeros(1 if curve.zero else 0), *shown])
    if not len(every):
        return 0.0, 1.0
    low, high = float(every.min()), float(every.max())
    room = max(0.06 * (high - low), 1e-6, 1e-3 * abs(high))
    return low - room, high + room


def line_path(t: Array, values: Array, x: Scale, y: Scale) -> str:
    """Return the path of a curve: of each column of pixels first, least, greatest and last value.

    It looks as if every value were drawn, and stays small for an hour of cycles.
    """
    seen = np.flatnonzero((t >= x.low) & (t <= x.high) & np.isfinite(values))
    columns = np.floor((t[seen] - x.low) / (x.high - x.low) * (x.end - x.start)).astype(np.int64)
    # a gap that is narrower than a column cannot be seen, and may come as often as every other cycle
    cuts = np.flatnonzero((np.diff(seen) > 1) & (np.diff(columns) > 1)) + 1
    path: list[str] = []
    for some, column in zip(np.split(seen, cuts), np.split(columns, cuts), strict=True):
        if not len(some):
            continue
        edges: list[int] = np.flatnonzero(np.diff(column, prepend=-1)).tolist()
        kept: list[int] = []
        for a, b in zip(edges, [*edges[1:], len(some)], strict=True):
            own = values[some[a:b]]
            kept += sorted({a, a + int(own.argmin()), a + int(own.argmax()), b - 1})
        points = [(x(float(t[some[i]])), y(float(values[some[i]]))) for i in kept]
        if len(points) == 1:
            points.append((points[0][0] + 0.01, points[0][1]))
        path.append("M" + "L".join(f"{decimal(a)} {decimal(b)}" for a, b in points))
    return "".join(path)


def _time_axis(x: Scale, y: float) -> Iterator[Node]:
    yield node("line", x1=x.start, x2=x.end, y1=y, y2=y, class_="frame")
    for value in x.ticks(10):
        yield node("line", x1=x(value), x2=x(value), y1=y, y2=y + 4.0, class_="frame")
        yield node("text", f"{value:.6g}", x=x(value), y=y + 17.0, text_anchor="middle", class_="tick")
    middle = (x.start + x.end) / 2.0
    yield node("text", "recorded time [s]", x=middle, y=y + 33.0, text_anchor="middle", class_="tick")
