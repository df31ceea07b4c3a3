"""docs/reports.md and the sample of a page against what the commands do."""

from __future__ import annotations

import hashlib
import html
import json
import math
import re
import shlex
from typing import Any

import pytest

from tests.docs.test_schemas import ROOT
from tests.verifier.html_page import Element, fetched, numbers, parse, resolve, unreadable
from verifier import Cell, verify
from verifier.changes import TOLERANCE
from verifier.commands import cli
from verifier.reports.assumptions import OF_THE_MODEL
from verifier.reports.difference import MOST_RESULTS
from verifier.reports.html.verification import verification_page
from verifier.reports.text import DISCLAIMER
from verifier.reports.verification import FORMAT

DOC = (ROOT / "docs/reports.md").read_text(encoding="utf-8")
SAMPLE = ROOT / "docs/samples/verify.html"


@pytest.fixture(scope="module")
def sample() -> Element:
    return parse(SAMPLE.read_bytes())


@pytest.fixture(scope="module")
def fresh() -> tuple[Element, dict[str, Any]]:
    """Page and JSON of the bundled recording, made now."""
    report = verify(ROOT / "data/demo.mcap", Cell.from_toml(ROOT / "data/demo.toml"))
    return parse(verification_page(report)), json.loads(json.dumps(report.to_dict()))


def outline(page: Element) -> list[tuple[str, str]]:
    """Headings, captions without their counts, heads of tables, pictures: what a page consists of."""
    found = []
    for each in page.all("h1", "h2", "h3", "caption", "thead", "figcaption", "svg"):
        text = each.attributes["aria-label"].split(".")[0] if each.tag == "svg" else each.text
        found.append((each.tag, re.sub(r"[\d.]+", "n", text)))
    return found


def test_the_sample_is_a_page_like_any_other(sample: Element) -> None:
    assert fetched(sample) == [] and unreadable(sample) == []
    assert DISCLAIMER in sample.first("footer").text
    assert SAMPLE.stat().st_size < 300_000


def test_the_sample_is_up_to_date(sample: Element, fresh: tuple[Element, dict[str, Any]]) -> None:
    """Same parts, and every number of it is that of a run now; how long computing took may differ.

    The smallest capsules that are found differ by parts in a thousand between processors, and so does all
    that rests on them.
    """
    page, printed = fresh
    assert outline(sample) == outline(page)
    shown = {pointer: value for pointer, value, _text in numbers(sample)}
    assert shown.keys() == {pointer for pointer, *_ in numbers(page)}
    for pointer, value in shown.items():
        now = resolve(printed, pointer)
        if pointer != "/real_time_factor" and value != now:
            assert math.isclose(value, now, rel_tol=0.02, abs_tol=2e-3), pointer


def test_the_sample_names_the_files_as_they_are(sample: Element) -> None:
    for name in ("demo.mcap", "demo.toml", "gripper.toml"):
        content = (ROOT / "data" / name).read_bytes()
        assert name in sample.text and hashlib.sha256(content).hexdigest() in sample.text


def test_the_document_lists_the_sections(sample: Element) -> None:
    headings = [each.text for each in sample.all("h2")]
    rows = re.findall(r"^\| ([^|]+) \| [^|]+\|$", DOC.split("**One file")[0], re.MULTILINE)
    listed = [row for row in rows if row not in ("section", "---", "head")]
    assert len(listed) == len(headings)
    assert all(heading.startswith(row) for row, heading in zip(listed, headings, strict=True))


def test_what_the_document_quotes() -> None:
    flat = " ".join(DOC.split())
    assert DISCLAIMER in flat and f"`{FORMAT}`" in flat
    assert f"`--tolerance` ({TOLERANCE:g};".replace("1e-06", "1e-6") in flat
    assert MOST_RESULTS == 6 and "Two to six results" in flat
    (example,) = re.findall(r"```html\n(<data .*</data>)\n```", DOC)
    assert example in html.unescape(SAMPLE.read_text(encoding="utf-8"))


def test_commands_and_options_are_there() -> None:
    commands = re.findall(r"^stopproof (.+)$", DOC, re.MULTILINE)
    assert {shlex.split(command)[0] for command in commands} == {"verify", "diff", "stop-report"}
    for command in commands:
        name, *words = shlex.split(command)
        known = {option for each in cli.commands[name].params for option in each.opts}
        assert {word for word in words if word.startswith("--")} <= known


def test_the_assumptions_of_the_model_are_those_of_the_method() -> None:
    """Word for word, without its marks."""
    method = (ROOT / "docs/method.md").read_text(encoding="utf-8")
    flat = re.sub(r"[*`]", "", " ".join(method.split()))
    for number, text in OF_THE_MODEL:
        assert f"- {number} {text}" in flat, number
    assert [number for number, _ in OF_THE_MODEL] == [f"A{k}" for k in range(1, 8)]
