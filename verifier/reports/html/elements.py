"""Elements of a page, as a tree: what is quoted cannot become markup, because markup is never a text."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any
from xml.etree import ElementTree

from verifier.reports.text import spaced
from verifier.shown import LONGEST_NOTE, LONGEST_VALUE, escaped, shown

Node = ElementTree.Element
Child = Node | str | None
"""``None``: nothing; a text stands as it is, with what does not print made visible."""


def node(tag: str, *children: Child, **attributes: str | float) -> Node:
    """Return an element; ``class_`` stands for ``class``, other underscores for hyphens."""
    made = Node(tag)
    for key, value in attributes.items():
        text = value if isinstance(value, str) else decimal(value)
        made.set(key.rstrip("_").replace("_", "-"), escaped(text))
    add(made, *children)
    return made


def add(parent: Node, *children: Child) -> None:
    """Append elements and texts to an element."""
    for child in children:
        if isinstance(child, str):
            text = escaped(child)
            if len(parent):
                parent[-1].tail = (parent[-1].tail or "") + text
            else:
                parent.text = (parent.text or "") + text
        elif child is not None:
            parent.append(child)


def decimal(value: float) -> str:
    """Return a coordinate with as many digits as a picture shows; never an exponent."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def section(title: str, *children: Child, anchor: str) -> Node:
    """Return a section with its heading."""
    head = node("h2", title, id=f"{anchor}-title")
    return node("section", head, *children, id=anchor, aria_labelledby=f"{anchor}-title")


def table(caption: str, heads: Sequence[str], rows: Iterable[Sequence[Child]], **attributes: str) -> Node:
    """Return a table; the first column names the rows. It can be scrolled where the page is narrow.

    Heads that end in ``#`` are those of numbers, which stand to the right.
    """
    numeric = [head.endswith("#") for head in heads]
    top = [
        node("th", head.removesuffix("#"), scope="col", **_side(right))
        for head, right in _with(heads, numeric)
    ]
    body = node("tbody")
    for row in rows:
        first, *others = row
        cells = [node("th", first, scope="row", **_side(numeric[0]))]
        cells += [node("td", cell, **_side(right)) for cell, right in _with(others, numeric[1:])]
        body.append(node("tr", *cells))
    head = node("thead", node("tr", *top))
    inner = node("table", node("caption", caption), head, body, **attributes)
    return node("div", inner, class_="wide", tabindex="0", role="region", aria_label=caption)


def _with(cells: Sequence[Any], numeric: Sequence[bool]) -> Iterable[tuple[Any, bool]]:
    return zip(cells, numeric, strict=True)


def _side(right: bool) -> dict[str, str]:
    return {"class_": "number"} if right else {}


def items(texts: Iterable[Child]) -> Node:
    """Return a list."""
    return node("ul", *(node("li", text) for text in texts))


def name(text: object) -> str:
    """Return a name out of somebody's file, shortened where it is endless."""
    return shown(text, LONGEST_VALUE)


def note(text: object) -> str:
    """Return a text that quotes names out of somebody's file."""
    return shown(text, LONGEST_NOTE) if text else ""


class Numbers:
    """Writes the numbers of a result, each with its exact value and its place in the JSON.

    Numbers in tables go through here, so that none is another one than that of ``--json``. The place is a
    JSON pointer (RFC 6901) in the attribute ``data-json``.

    Parameters
    ----------
    result:
        What ``--json`` writes.
    """

    def __init__(self, result: Any) -> None:
        self.result = result

    def at(self, *keys: str | int) -> Any:
        """Return the value at a place."""
        value = self.result
        for key in keys:
            value = value[key]
        return value

    def show(self, form: str, *keys: str | int, nothing: str = "–", times: float = 1.0) -> Node:
        """Return the number at a place in a format of ``str.format``; ``nothing`` where it is null.

        ``times``: what is shown is that many times the number, as in another unit.
        """
        value = self.at(*keys)
        pointer = "".join(f"/{str(key).replace('~', '~0').replace('/', '~1')}" for key in keys)
        if value is None or (isinstance(value, float) and not math.isfinite(value)):
            return node("data", nothing, value="null", data_json=pointer)
        text = spaced(value) if form == "count" else form.format(value if times == 1.0 else times * value)
        return node("data", text, value=repr(value), data_json=pointer)
