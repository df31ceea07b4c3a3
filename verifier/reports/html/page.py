"""One self-contained page: nothing is loaded, and every printed page carries the footer.

Nothing runs, unless the page has a script of its own; then only that one may, which the policy names by its
hash, and the page can be read without it.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from xml.etree import ElementTree

from verifier.reports.html.elements import Node, node
from verifier.reports.text import DISCLAIMER

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
"""The page itself forbids the browser to load anything or to run a script."""
_OWN_SCRIPT = "; script-src 'sha256-{}'"


def page(title: str, head: Node, sections: Sequence[Node], script: str = "") -> bytes:
    """Return the file of a page.

    Parameters
    ----------
    title:
        Of the window.
    head:
        What stands at the top, with the heading ``h1`` in it.
    sections:
        Each with an ``id`` and a heading ``h2``, which the list of contents names.
    script:
        Of this package, no text of anybody else; runs when the page has been read. Empty: none.
    """
    style = node("style")
    style.text = files("verifier.reports.html").joinpath("page.css").read_text(encoding="utf-8")
    links = [node("li", node("a", _heading(each), href=f"#{each.get('id')}")) for each in sections]
    contents = node("nav", node("ol", *links), aria_label="Contents")
    whole = node(
        "html",
        node(
            "head",
            node("meta", charset="utf-8"),
            node("title", title),
            node("meta", name="viewport", content="width=device-width, initial-scale=1"),
            node("meta", name="color-scheme", content="light dark"),
            node("meta", http_equiv="Content-Security-Policy", content=_policy(script)),
            node("meta", name="referrer", content="no-referrer"),
            style,
        ),
        node(
            "body",
            node("div", head, contents, node("main", *sections), class_="sheet"),
            _footer(),
            _script(script),
        ),
        lang="en",
    )
    text: bytes = ElementTree.tostring(whole, encoding="utf-8", method="html")
    return b"<!DOCTYPE html>\n" + text + b"\n"


def _policy(script: str) -> str:
    if not script:
        return _POLICY
    digest = base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")
    return _POLICY + _OWN_SCRIPT.format(digest)


def _script(text: str) -> Node | None:
    if not text:
        return None
    made = node("script")
    made.text = text
    return made


def _footer() -> Node:
    """Return the footer; in print, it stands at the foot of every page."""
    return node("footer", node("p", DISCLAIMER))


def _heading(section: Node) -> str:
    found = section.find("h2")
    return "" if found is None else "".join(found.itertext())
