"""Numbers of a stop report in cells: brackets, angles in degrees, and the mark of what is guessed."""

from __future__ import annotations

import math
from collections.abc import Sequence

from verifier.reports.html.elements import Child, Node, Numbers, node

DEGREES = 180.0 / math.pi
GUESSED = "guessed brakes"


def pair(numbers: Numbers, form: str, unit: str, *keys: str | int | None, times: float = 1.0) -> Child:
    """Return lower and upper number of the bracket at a place, one where both look the same.

    A key ``None`` stands for a bracket that there is not.
    """
    if any(key is None for key in keys):
        return "–"
    places = [key for key in keys if key is not None]
    ends = [
        numbers.show(form, *places, end, nothing="not bounded", times=times) for end in ("lower", "upper")
    ]
    texts = ["".join(end.itertext()) for end in ends]
    after = unit if unit == "°" else f" {unit}" if unit else ""
    if numbers.at(*places, "upper") is None:
        return node("span", "at least ", ends[0], after, ", ", ends[1], class_="bracket")
    if texts[0] == texts[1]:
        return node("span", ends[1], after, class_="bracket")
    return node("span", ends[0], " – ", ends[1], after, class_="bracket")


def angle(numbers: Numbers, unit: str, *keys: str | int) -> Child:
    """Return the bracket of a displacement, in degrees or metres."""
    if unit == "rad":
        return pair(numbers, "{:.1f}", "°", *keys, times=DEGREES)
    return pair(numbers, "{:.3f}", "m", *keys)


def both_lines(numbers: Numbers, unit: str, *keys: str | int) -> Child:
    """Return a bracket with its unit, angles in degrees."""
    return angle(numbers, unit, *keys) if unit == "rad" else pair(numbers, "{:.3f}", unit, *keys)


def configuration(numbers: Numbers, unit: str, *keys: str | int) -> Node:
    """Return the position or speed of a joint, in degrees or metres."""
    if unit == "rad":
        return numbers.show("{:z.0f}", *keys, times=DEGREES)
    return numbers.show("{:z.3f}", *keys)


def joint_values(numbers: Numbers, units: Sequence[str], *keys: str | int) -> Node:
    """Return positions or speeds of all joints in one cell."""
    children: list[Child] = []
    for j, unit in enumerate(units):
        children += [", " if children else None, configuration(numbers, unit, *keys, j)]
    return node("span", *children)


def mark(*, guessed: bool) -> str:
    """Return what a caption says of brakes that nobody has declared."""
    return f"; {GUESSED}" if guessed else ""


def watermark(*children: Child) -> Node:
    """Return what rests on brakes that nobody has declared, marked as such on screen and paper."""
    text = (
        "Guessed brakes: nobody has declared their torques. An example of what they would do, not an answer."
    )
    marks = [node("p", GUESSED, class_="watermark", aria_hidden="true") for _ in range(3)]
    return node("div", node("p", text, class_="missing"), *marks, *children, class_="guessed")
