"""A page as a reader's browser takes it: parsed by the standard library, and held against rules."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from itertools import pairwise
from typing import Any

VOID = {"meta", "br", "hr", "img", "input", "link", "col", "source", "wbr", "base", "area", "embed", "track"}
LOADS = (
    "src",
    "srcset",
    "href",
    "xlink:href",
    "data",
    "poster",
    "action",
    "formaction",
    "background",
    "ping",
)
FETCHED = re.compile(r"@import|url\s*\(|image-set|https?:|//", re.IGNORECASE)


@dataclass
class Element:
    tag: str
    attributes: dict[str, str]
    parent: Element | None
    children: list[Element | str] = field(default_factory=list)

    @property
    def elements(self) -> list[Element]:
        return [child for child in self.children if isinstance(child, Element)]

    @property
    def text(self) -> str:
        return "".join(child if isinstance(child, str) else child.text for child in self.children)

    def all(self, *tags: str) -> Iterator[Element]:
        for child in self.elements:
            if not tags or child.tag in tags:
                yield child
            yield from child.all(*tags)

    def first(self, tag: str) -> Element:
        return next(self.all(tag))

    @property
    def classes(self) -> set[str]:
        return set(self.attributes.get("class", "").split())


class _Parser(HTMLParser):
    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.root = self.here = Element("", {}, None)
        self.faults: list[str] = []
        self.doctype = ""

    def handle_decl(self, decl: str) -> None:
        self.doctype = decl

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _value in attrs]
        if len(set(names)) != len(names):
            self.faults.append(f"<{tag}> has an attribute twice")
        made = Element(tag, {name: value or "" for name, value in attrs}, self.here)
        self.here.children.append(made)
        if tag not in VOID:
            self.here = made

    def handle_endtag(self, tag: str) -> None:
        if tag in VOID:
            return
        if self.here.tag != tag:
            self.faults.append(f"</{tag}> ends <{self.here.tag}>")
            return
        assert self.here.parent is not None
        self.here = self.here.parent

    def handle_data(self, data: str) -> None:
        self.here.children.append(data)


def parse(content: bytes) -> Element:
    """Parse a page; every element must be closed where it was opened."""
    parser = _Parser()
    parser.feed(content.decode("utf-8"))
    parser.close()
    assert parser.doctype == "DOCTYPE html"
    assert not parser.faults, parser.faults
    assert parser.here is parser.root, f"<{parser.here.tag}> is not closed"
    (page,) = parser.root.elements
    assert page.tag == "html" and page.attributes["lang"] == "en"
    return page


def fetched(page: Element) -> list[str]:
    """What a browser would load, run or send for this page; there should be nothing."""
    found = []
    for each in page.all():
        if each.tag in ("script", "iframe", "object", "embed", "form", "base", "link", "img", "image", "use"):
            found.append(f"<{each.tag}>")
        for name, value in each.attributes.items():
            if name in LOADS and not value.startswith(("#", "data:")):
                found.append(f"{name}={value!r}")
            if name.startswith("on") or (name == "style" and FETCHED.search(value)):
                found.append(f"{name}={value!r}")
        if each.tag == "style" and FETCHED.search(re.sub(r"/\*.*?\*/", "", each.text, flags=re.DOTALL)):
            found.append("style loads something")
    return found


def unreadable(page: Element) -> list[str]:
    """What somebody who does not see the page would miss."""
    found, ids = [], [each.attributes["id"] for each in page.all() if "id" in each.attributes]
    if len(ids) != len(set(ids)):
        found.append("an id stands twice")
    for link in page.all("a"):
        if link.attributes["href"].removeprefix("#") not in ids:
            found.append(f"link to {link.attributes['href']}, which is not there")
    for each in page.all():
        for name in ("aria-labelledby", "aria-describedby"):
            if name in each.attributes and each.attributes[name] not in ids:
                found.append(f"{name} of what is not there")
    levels = [int(each.tag[1]) for each in page.all("h1", "h2", "h3", "h4")]
    if levels.count(1) != 1 or levels[0] != 1 or any(b > a + 1 for a, b in pairwise(levels)):
        found.append(f"headings go {levels}")
    for svg in page.all("svg"):
        names = [child.tag for child in svg.elements][:2]
        if svg.attributes.get("role") != "img" or not svg.attributes.get("aria-label"):
            found.append("a picture without a name")
        if names != ["title", "desc"] or not all(child.text.strip() for child in svg.elements[:2]):
            found.append(f"a picture begins with {names}")
    for table in page.all("table"):
        if not [child for child in table.elements if child.tag == "caption" and child.text.strip()]:
            found.append("a table without a caption")
        if any(each.attributes.get("scope") not in ("col", "row") for each in table.all("th")):
            found.append("a head without scope")
        widths = {len(row.elements) for row in table.all("tr")}
        if len(widths) != 1:
            found.append(f"rows of {widths} cells: {table.text[:60]!r}")
    return found


def numbers(page: Element) -> list[tuple[str, Any, str]]:
    """Pointer, exact value and text of every number that says where it stands in the JSON."""
    return [
        (each.attributes["data-json"], json.loads(each.attributes["value"]), each.text)
        for each in page.all("data")
    ]


def resolve(value: Any, pointer: str) -> Any:
    """The value that a JSON pointer names (RFC 6901)."""
    for key in pointer.split("/")[1:]:
        key = key.replace("~1", "/").replace("~0", "~")
        value = value[int(key)] if isinstance(value, list) else value[key]
    return value


def path_boxes(path: str) -> list[tuple[float, float]]:
    """Begin and end of each rectangle of a lane."""
    return [(float(a), float(b)) for a, b in re.findall(r"M([\d.]+) [\d.]+H([\d.]+)v", path)]


def path_points(path: str) -> list[tuple[float, float]]:
    return [(float(a), float(b)) for a, b in re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", path)]
