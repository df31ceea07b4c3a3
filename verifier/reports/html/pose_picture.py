"""A configuration of the arm, seen from several sides, as SVG; the page's script can turn the last view.

A capsule seen along any direction is a line with round ends of its radius: nothing is approximated.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from verifier.reports.html.chart import picture
from verifier.reports.html.elements import Node, decimal, name, node
from verifier.stop_report.report import Array, Pose

_SIDE = 400.0
_MARGIN_M, _BAR_M = 0.08, (1.0, 0.5, 0.2, 0.1, 0.05)
_ARROW_S = 0.05
"""The arrow is as long as the way of the point in this time."""
MARKS = (
    "Red: the link with the fastest point, and that point; the line leads to where it would be "
    f"{_ARROW_S:g} s later. Cross: the first joint."
)
_RIM = 1.4
VIEWS = (
    ("From the front: x to the right, z up.", 0.0, 0.0),
    ("From the side: y to the right, z up.", 90.0, 0.0),
    ("From above: x to the right, y up.", 0.0, 90.0),
    ("From a corner, above; drag or use the arrow keys to turn it.", 35.0, 25.0),
)
"""What it is, turned about z and raised by so many degrees."""


@dataclass(frozen=True, slots=True)
class _Camera:
    """Rows right, up and towards the eye (3, 3); middle of the picture (3,) [m], and its scale."""

    axes: Array
    middle: Array
    scale: float

    def place(self, points: Array) -> Array:
        """Return places (..., 2) in the picture, and depth (..., 1), the nearer the larger."""
        seen = (points - self.middle) @ self.axes.T * self.scale
        return np.stack([0.5 * _SIDE + seen[..., 0], 0.5 * _SIDE - seen[..., 1], seen[..., 2]], axis=-1)


def pose_views(pose: Pose) -> list[tuple[Node, str]]:
    """Return the views of a pose, each with its caption."""
    low = (pose.ends - pose.radius[:, None, None]).min(axis=(0, 1))
    high = (pose.ends + pose.radius[:, None, None]).max(axis=(0, 1))
    tip = pose.fastest + _ARROW_S * pose.velocity
    low, high = (
        np.minimum(np.minimum(low, tip), pose.axes[0]),
        np.maximum(np.maximum(high, tip), pose.axes[0]),
    )
    middle = 0.5 * (low + high)
    found = []
    for k, (caption, turned, raised) in enumerate(VIEWS):
        turns = k == len(VIEWS) - 1
        size = float(np.linalg.norm(high - low) if turns else (high - low).max()) + 2.0 * _MARGIN_M
        camera = _Camera(_axes(turned, raised), middle, _SIDE / size)
        found.append((_drawn(pose, camera, caption, turns=turns), caption))
    return found


def clearest(pose: Pose) -> int:
    """Return which of the three straight views shows the arm the least foreshortened."""
    tip = pose.fastest + _ARROW_S * pose.velocity
    points = np.vstack([pose.ends.reshape(-1, 3), pose.fastest, tip])
    x, y, z = points.max(axis=0) - points.min(axis=0)
    return int(np.argmax([x * z, y * z, x * y]))


def _axes(turned_deg: float, raised_deg: float) -> Array:
    """Return right, up and towards the eye, which looks along y, then is turned about z and raised."""
    a, b = math.radians(turned_deg), math.radians(raised_deg)
    right = np.array([math.cos(a), math.sin(a), 0.0])
    back = np.array([math.sin(a), -math.cos(a), 0.0])
    eye = math.cos(b) * back + math.sin(b) * np.array([0.0, 0.0, 1.0])
    return np.array([right, np.cross(eye, right), eye])


def _drawn(pose: Pose, camera: _Camera, caption: str, *, turns: bool) -> Node:
    parts = [node("g", *_capsules(pose, camera), class_="arm"), *_base(pose, camera), *_fastest(pose, camera)]
    speed = float(np.linalg.norm(pose.velocity))
    described = (
        f"The capsules of the arm; {name(pose.link)} has the fastest point, marked with a dot and an arrow: "
        f"{speed:.3f} m/s"
    )
    made = picture(f"{pose.title}. {caption}", described, (_SIDE, _SIDE), [*parts, *_scale_bar(camera)])
    if turns:
        made.set("class", "turns")
        made.set("tabindex", "0")
        made.set("data-middle", json.dumps(camera.middle.round(5).tolist()))
        made.set("data-scale", repr(round(camera.scale, 4)))
        made.set("data-angles", json.dumps(VIEWS[-1][1:]))
    return made


def _capsules(pose: Pose, camera: _Camera) -> Iterator[Node]:
    """Yield the capsules, the farthest first; the script finds their ends in ``data-ends``."""
    places = camera.place(pose.ends)
    for k in np.argsort(places[:, :, 2].mean(axis=1)):
        (ax, ay, _), (bx, by, _) = places[k]
        width = 2.0 * float(pose.radius[k]) * camera.scale
        ends = {"x1": float(ax), "y1": float(ay), "x2": float(bx), "y2": float(by)}
        if abs(ax - bx) + abs(ay - by) < 0.02:
            ends["x2"] += 0.02  # a line without length is not drawn by every browser
        drawn = node(
            "g",
            node("title", name(pose.links[k])),
            node("line", **ends, class_="rim", stroke_width=width),
            node("line", **ends, class_="fill", stroke_width=max(width - 2.0 * _RIM, 0.5)),
            class_="link decides" if pose.links[k] == pose.link else "link",
        )
        drawn.set("data-ends", json.dumps(pose.ends[k].round(5).tolist()))
        yield drawn


def _base(pose: Pose, camera: _Camera) -> Iterator[Node]:
    x, y, _ = camera.place(pose.axes[0])
    d = f"M{decimal(x - 12)} {decimal(y)}h24M{decimal(x)} {decimal(y - 12)}v24"
    made = node("path", node("title", "where the first joint is"), d=d, class_="frame base")
    made.set("data-at", json.dumps(pose.axes[0].round(5).tolist()))
    yield made


def _fastest(pose: Pose, camera: _Camera) -> Iterator[Node]:
    tip = pose.fastest + _ARROW_S * pose.velocity
    (ax, ay, _), (bx, by, _) = camera.place(pose.fastest), camera.place(tip)
    arrow = node("line", x1=ax, y1=ay, x2=bx, y2=by, class_="arrow")
    arrow.set("data-ends", json.dumps(np.array([pose.fastest, tip]).round(5).tolist()))
    yield arrow
    speed = float(np.linalg.norm(pose.velocity))
    dot = node(
        "circle", node("title", f"fastest point, {speed:.3f} m/s"), cx=ax, cy=ay, r=5.0, class_="fastest"
    )
    dot.set("data-at", json.dumps(pose.fastest.round(5).tolist()))
    yield dot


def _scale_bar(camera: _Camera) -> Iterator[Node]:
    length = next((each for each in _BAR_M if each * camera.scale <= 0.3 * _SIDE), _BAR_M[-1])
    yield node(
        "line", x1=10.0, x2=10.0 + length * camera.scale, y1=_SIDE - 10.0, y2=_SIDE - 10.0, class_="scale"
    )
    yield node("text", f"{length:g} m", x=10.0, y=_SIDE - 16.0)
