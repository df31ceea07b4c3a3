"""Heat maps of a grid as SVG: shares of speed down, of extension across, a block for each load."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from verifier.reports.html.chart import picture
from verifier.reports.html.elements import Node, node

_WIDTH, _HEIGHT, _LEFT, _TOP, _BETWEEN = 104.0, 46.0, 112.0, 46.0, 26.0
_FAINT, _STRONG = 0.06, 0.5
_LEAST = 960.0
"""Narrower maps would be drawn with larger letters than the others."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field: shares of load, speed and extension (``None``: there is none), lower and upper number
    (``None``: not bounded)."""

    load: float
    speed: float
    extension: float | None
    lower: float
    upper: float | None


def heat_map(title: str, unit: str, fields: Sequence[Field], loads: Sequence[float | None]) -> Node:
    """Return the map; ``loads``: of which blocks there are, ``None``: one for every load.

    The stronger the colour, the larger the upper number, or the lower one where there is no upper. The
    numbers are in the fields, so that nobody needs to tell colours apart.
    """
    if loads == [None]:
        fields = [each for each in fields if each.load == fields[0].load]
    speeds = sorted({each.speed for each in fields}, reverse=True)
    extensions = sorted({each.extension for each in fields}, key=lambda each: each or 0.0)
    most = max((_size(each) for each in fields), default=1.0) or 1.0
    block = _WIDTH * len(extensions) + _BETWEEN
    parts: list[Node] = [
        node("text", f"speed {100.0 * speed:.0f} %", x=_LEFT - 8.0, y=_TOP + _HEIGHT * (row + 0.5) + 4.0,
             text_anchor="end", class_="tick")
        for row, speed in enumerate(speeds)
    ]  # fmt: skip
    for k, load in enumerate(loads):
        left = _LEFT + k * block
        head = "every load" if load is None else f"load {100.0 * load:.0f} %"
        parts.append(node("text", head, x=left, y=14.0))
        for column, extension in enumerate(extensions):
            text = "any configuration" if extension is None else f"extension {100.0 * extension:.0f} %"
            parts.append(
                node(
                    "text",
                    text,
                    x=left + _WIDTH * (column + 0.5),
                    y=36.0,
                    text_anchor="middle",
                    class_="tick",
                )
            )
        for each in fields:
            if load in (None, each.load):
                row, column = speeds.index(each.speed), extensions.index(each.extension)
                parts += _field(each, left + _WIDTH * column, _TOP + _HEIGHT * row, _size(each) / most)
    described = "; ".join(
        f"load {100 * each.load:.0f} %, speed {100 * each.speed:.0f} %{_extended(each)}: {_text(each)} {unit}"
        for each in fields
    )
    width = _LEFT + block * len(loads) - _BETWEEN + 4.0
    size = max(width, _LEAST), _TOP + _HEIGHT * len(speeds) + 4.0
    return picture(f"{title} [{unit}]", described, size, parts)


def _extended(each: Field) -> str:
    return "" if each.extension is None else f", extension {100 * each.extension:.0f} %"


def _size(each: Field) -> float:
    return each.lower if each.upper is None else each.upper


def _text(each: Field) -> str:
    return f"at least {each.lower:.3f}" if each.upper is None else f"{each.lower:.3f} to {each.upper:.3f}"


def _field(each: Field, x: float, y: float, share: float) -> Iterator[Node]:
    opacity = _FAINT + (_STRONG - _FAINT) * share
    box = node(
        "rect", x=x, y=y, width=_WIDTH - 3.0, height=_HEIGHT - 3.0, class_="heat", fill_opacity=opacity
    )
    box.append(node("title", _text(each)))
    yield box
    middle = x + 0.5 * (_WIDTH - 3.0)
    if each.upper is None:
        yield node(
            "text", f"≥ {each.lower:.3f}", x=middle, y=y + 18.0, text_anchor="middle", class_="heat-value"
        )
        yield node("text", "not bounded", x=middle, y=y + 34.0, text_anchor="middle", class_="heat-reached")
        return
    yield node("text", f"≤ {each.upper:.3f}", x=middle, y=y + 18.0, text_anchor="middle", class_="heat-value")
    yield node(
        "text", f"reached {each.lower:.3f}", x=middle, y=y + 34.0, text_anchor="middle", class_="heat-reached"
    )
