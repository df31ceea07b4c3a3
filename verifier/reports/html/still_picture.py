"""A picture of a witness: the pair that decided, from the side and from above, as SVG."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verifier.reports.html.chart import picture
from verifier.reports.html.elements import Node, decimal, name, node
from verifier.reports.sets_panel import bones
from verifier.still import Body, Still

Array = NDArray[np.float64]

_SIDE, _HIGH = 460.0, 380.0
"""Width and greatest height of a view, in units of the picture."""
_MARGIN_M, _MOST_M = 0.15, 4.0
"""Around what is shown, and the most that a view shows [m]; what goes farther is cut off."""
_BAR_M = (2.0, 1.0, 0.5, 0.2, 0.1)
_RIM = 1.6


@dataclass(frozen=True, slots=True)
class _View:
    """From points (..., 3) [m] to places in the picture."""

    title: str
    along: Array
    up: Array
    low: Array
    scale: float
    height: float

    def flat(self, points: Array) -> Array:
        """Return points as seen from the side [m]: to the right, and up."""
        return np.stack([points @ self.along, points @ self.up], axis=-1)

    def place(self, points: Array) -> Array:
        """Return the places of points (N, 3)."""
        flat = (self.flat(points) - self.low) * self.scale
        return np.column_stack([flat[:, 0], self.height - flat[:, 1]])


def views(still: Still) -> list[Node]:
    """Return the view from the side, with one of the pair left of the other, and from above."""
    along = _direction(still)
    upright, north = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    return [
        _drawn(still, "Seen from the side", along, upright),
        _drawn(still, "Seen from above", np.array([1.0, 0.0, 0.0]), north),
    ]


def _direction(still: Still) -> Array:
    """Return the horizontal direction (3,) from the one of the pair to the other: both stand apart in it."""
    first, *others = [body.points.mean(axis=0) for body in _deciding(still)] or [np.zeros(3)]
    step = (others[-1] - first if others else first) * (1.0, 1.0, 0.0)
    length = float(np.linalg.norm(step))
    return step / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])


def _drawn(still: Still, title: str, along: Array, up: Array) -> Node:
    view = _fit(still, title, along, up)
    parts: list[Node] = []
    for kind, bodies in (("fixture", still.fixtures), ("person", still.people), ("link", still.links)):
        parts += [_shape(view, body, kind) for body in sorted(bodies, key=lambda each: each.decides)]
    parts += _skeletons(view, still)
    parts += _gap(view, still)
    parts += _scale_bar(view)
    pair = " and ".join(dict.fromkeys(_named(body) for body in _deciding(still)))
    described = f"The pair that decided is drawn in another colour: {pair or 'not known'}."
    return picture(title, described, (_SIDE, view.height), parts)


def _deciding(still: Still) -> list[Body]:
    return [body for body in (*still.links, *still.people, *still.fixtures) if body.decides]


def _named(body: Body) -> str:
    return name(f"{body.person} {body.name}".strip())


def _fit(still: Still, title: str, along: Array, up: Array) -> _View:
    """Choose what the view shows: the arm and whoever decides, at most a few metres around the pair."""
    view = _View(title, along, up, np.zeros(2), 1.0, 0.0)
    who = {body.person for body in still.people if body.decides}
    near = [*still.links, *(body for body in still.people if body.person in who)]
    near += [body for body in still.fixtures if body.decides]
    corners = [view.flat(body.points) + sign * body.radius for body in near for sign in (-1.0, 1.0)]
    every = np.vstack([*corners, view.flat(still.points[np.isfinite(still.points).all(axis=1)])])
    low, high = every.min(axis=0) - _MARGIN_M, every.max(axis=0) + _MARGIN_M
    deciding = _deciding(still)
    middle = (
        view.flat(np.vstack([body.points for body in deciding])).mean(axis=0)
        if deciding
        else (low + high) / 2
    )
    low, high = np.maximum(low, middle - _MOST_M / 2), np.minimum(high, middle + _MOST_M / 2)
    scale = min(_SIDE / float(high[0] - low[0]), _HIGH / float(high[1] - low[1]))
    spare = _SIDE / scale - float(high[0] - low[0])
    return _View(title, along, up, low - np.array([spare / 2.0, 0.0]), scale, float(high[1] - low[1]) * scale)


def _shape(view: _View, body: Body, kind: str) -> Node:
    """Return a set: its hull with a round line of twice its radius around it, which is its exact outline."""
    places = convex_hull(view.place(body.points))
    path = "M" + "L".join(f"{decimal(x)} {decimal(y)}" for x, y in places) + "z"
    width = 2.0 * body.radius * view.scale
    rim = node("path", d=path, class_="rim", stroke_width=width)
    fill = node("path", d=path, class_="fill", stroke_width=max(width - 2.0 * _RIM, 0.5))
    return node(
        "g", node("title", _named(body)), rim, fill, class_=f"{kind} decides" if body.decides else kind
    )


def convex_hull(points: Array) -> list[tuple[float, float]]:
    """Return the corners of the hull of points (N, 2), in order; one or two where they are in a line.

    Monotone chain: A. M. Andrew, Another efficient algorithm for convex hulls in two dimensions, 1979.
    """
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) <= 2:
        return ordered
    return [*_chain(ordered)[:-1], *_chain(ordered[::-1])[:-1]]


def _chain(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    out: list[tuple[float, float]] = []
    for x, y in points:
        while len(out) > 1:
            (ax, ay), (bx, by) = out[-2:]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                break
            out.pop()
        out.append((x, y))
    return out


def _skeletons(view: _View, still: Still) -> Iterator[Node]:
    for _person, points in still.seen:
        path = ""
        for a, b in bones(points):
            (ax, ay), (bx, by) = view.place(points[[a, b]])
            path += f"M{decimal(ax)} {decimal(ay)}L{decimal(bx)} {decimal(by)}"
        if path:
            yield node("path", d=path, class_="bone")


def _gap(view: _View, still: Still) -> Iterator[Node]:
    """Draw the nearest points of the two sets, and the way between them: the gap."""
    if not np.isfinite(still.points).all():
        return
    (ax, ay), (bx, by) = view.place(still.points)
    yield node("line", x1=ax, y1=ay, x2=bx, y2=by, class_="gap")
    for x, y in ((ax, ay), (bx, by)):
        yield node("circle", cx=x, cy=y, r=3.0, class_="gap-end")


def _scale_bar(view: _View) -> Iterator[Node]:
    length = next((each for each in _BAR_M if each * view.scale <= 0.3 * _SIDE), _BAR_M[-1])
    left, y = 10.0, view.height - 10.0
    yield node("line", x1=left, x2=left + length * view.scale, y1=y, y2=y, class_="scale")
    yield node("text", f"{length:g} m", x=left, y=y - 6.0)
