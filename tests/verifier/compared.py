"""What tests of `diff` have in common, whatever is compared."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from tests.docs.test_schemas import faults
from tests.test_wording import faults as words_never_used
from tests.verifier.html_page import Element, fetched, numbers, parse, resolve, unreadable
from verifier.reports.side_by_side import Comparison

Json = dict[str, Any]


def put(place: str, value: Any) -> Callable[[Json], Json]:
    """A change that sets what is at a place, appends to the list there (``+``), or takes it away (``-``)."""
    *way, last = place.rstrip("+-").split("/")

    def change(result: Json) -> Json:
        here: Any = result
        for key in way:
            here = here[int(key)] if isinstance(here, list) else here[key]
        key = int(last) if isinstance(here, list) else last
        if place.endswith("+"):
            here[key].append({**here[key][0], **value} if isinstance(value, dict) and here[key] else value)
        elif place.endswith("-"):
            del here[key]
        else:
            here[key] = value
        return result

    return change


def complete_page(made: bytes, comparison: Comparison[Any, Any], title: str, least: int) -> Element:
    """A page that loads nothing, says what the text says, and has at least ``least`` numbers of the JSON."""
    page = parse(made)
    assert fetched(page) == [] and unreadable(page) == []
    printed, found = json.loads(json.dumps(comparison.to_dict())), numbers(page)
    assert len(found) >= least
    assert all(resolve(printed, pointer) == value for pointer, value, _text in found)
    text = page.text
    assert title in text and all(f"From A to {letter}" in text for letter in comparison.letters[1:])
    assert page.first("pre").text.split("\n") == comparison.lines()
    assert words_never_used("page", text) == []
    assert all(item.name in text for change in comparison.changes for item in change.numbers)
    return page


def marked(page: Element) -> list[Element]:
    """What is marked as another one than in A."""
    return [each for each in page.all("span") if "changed" in each.classes]


def nothing_changed(made: bytes) -> None:
    """A page of results that are alike says so, and marks nothing."""
    page = parse(made)
    assert not marked(page) and "Nothing changed." in page.text and unreadable(page) == []


def in_schema(name: str, comparison: Comparison[Any, Any]) -> None:
    """The JSON is what the schema says, and a key more or less is not."""
    printed = json.loads(json.dumps(comparison.to_dict(), allow_nan=False))
    assert not faults(name, printed)
    for key in printed:
        assert faults(name, {other: value for other, value in printed.items() if other != key}), key
    assert faults(name, {**printed, "grade": 1})
