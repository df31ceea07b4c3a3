"""What changed between two results, whatever they are results of: numbers, assumptions, inputs, texts."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from verifier.result_file import ReadFile, Stated

TOLERANCE = 1e-6
"""Metres and seconds that count as no change: gaps are kept with 24 bits."""
_RELATIVE = 1e-9
"""Of other numbers."""
_ENDING = r"\.(?:toml|urdf|xml|stl|obj|dae|ply)\b"
_PART = rf"(?:(?!{_ENDING})[^/:;,])+/"
_FOLDERS = tuple(
    re.compile(pattern, re.IGNORECASE)
    for pattern in (
        rf"^/?(?:{_PART})+(?=[^/:;,]+{_ENDING}(?:$|:))",
        rf"(?<!\S)/(?:{_PART})*(?=[^/:;,]+?{_ENDING})",
        rf"(?<!\S)\S*/(?=[^/\s]+{_ENDING})",
    )
)
"""In front of the name of a file that a user brings, whose content is in the inputs: where a text begins with
its path, where the path begins with a slash (both may have blanks in them), and any other without blanks."""
Value = float | str | None
Facts = Mapping[str, tuple[str, Value]]
"""Unit and value of each number and name, by its place in the JSON."""


@dataclass(frozen=True, slots=True)
class Changed:
    """A number or name that is another one in B; ``None``: it is not there."""

    name: str
    unit: str
    a: Value
    b: Value


@dataclass(frozen=True, slots=True)
class AssumptionChange:
    """An assumption that only one result has, or that both have differently."""

    name: str
    a: Mapping[str, Any] | None
    b: Mapping[str, Any] | None


@dataclass(frozen=True, slots=True)
class InputChange:
    """An input whose content is another one, or that only one result has; a name alone is no change."""

    what: str
    a: Mapping[str, Any] | None
    b: Mapping[str, Any] | None


@dataclass(frozen=True, slots=True)
class TextChange:
    """A text of ``kind``, as a waiver or a note, that only one result has."""

    kind: str
    text: str
    only_in: Literal["a", "b"]


class ChangedStatements(Protocol):
    """What changed besides what is measured over cycles or configurations, of whatever kind of result."""

    @property
    def numbers(self) -> Sequence[Changed]:
        """Return numbers and names."""

    @property
    def assumptions(self) -> Sequence[AssumptionChange]:
        """Return what is stated differently."""

    @property
    def inputs(self) -> Sequence[InputChange]:
        """Return files of another content."""

    @property
    def texts(self) -> Sequence[TextChange]:
        """Return waivers, notes and what is missing."""


def changed_numbers(before: Facts, after: Facts, tolerance: float) -> Iterator[Changed]:
    """Yield what is another one; metres and seconds may differ by ``tolerance``. 1 m is not 1 rad."""
    for name in dict.fromkeys((*before, *after)):
        (unit_a, old), (unit_b, new) = before.get(name, ("", None)), after.get(name, ("", None))
        if None not in (old, new) and unit_a != unit_b:
            yield Changed(name, unit_a, old, None)
            yield Changed(name, unit_b, None, new)
        elif not same(old, new, allowed(tolerance, unit_a, unit_b)):
            yield Changed(name, unit_b or unit_a, old, new)


def allowed(tolerance: float, *units: str) -> float:
    """Return by how much a number may differ that has one of ``units``."""
    return tolerance if "m" in units or "s" in units else 0.0


def same(a: Value, b: Value, tolerance: float = 0.0) -> bool:
    """Whether two values count as one; texts and missing ones must be equal."""
    if isinstance(a, str) or isinstance(b, str) or a is None or b is None:
        return a == b
    return math.isclose(a, b, rel_tol=_RELATIVE, abs_tol=max(tolerance, 1e-12))


def changed_assumptions(a: Sequence[Stated], b: Sequence[Stated]) -> Iterator[AssumptionChange]:
    """Yield what is stated differently; a name may stand twice, as that of a limit and of its cell's row."""
    before, after = _by_name(a), _by_name(b)
    for name in dict.fromkeys((*before, *after)):
        old, new = before.get(name), after.get(name)
        if old is None or new is None or not _stated_alike(old, new):
            yield AssumptionChange(
                name[0], None if old is None else _stated(old), None if new is None else _stated(new)
            )


def _by_name(items: Sequence[Stated]) -> dict[tuple[str, int], Stated]:
    seen: dict[str, int] = {}
    found = {}
    for item in items:
        seen[item.name] = seen.get(item.name, -1) + 1
        found[item.name, seen[item.name]] = item
    return found


def _stated_alike(a: Stated, b: Stated) -> bool:
    """Whether two say the same, wherever the files lie that they name."""
    old, new = (without_folders(item.value) if isinstance(item.value, str) else item.value for item in (a, b))
    sources = without_folders(a.source) == without_folders(b.source)
    return same(old, new) and sources and (a.unit, a.certainty) == (b.unit, b.certainty)


def without_folders(text: str) -> str:
    """Return a text with the folders of the files that it names left out."""
    for folder in _FOLDERS:
        text = folder.sub("", text)
    return text


def _stated(item: Stated) -> dict[str, Any]:
    return {"value": item.value, "unit": item.unit, "source": item.source, "certainty": item.certainty}


def changed_inputs(a: Sequence[ReadFile], b: Sequence[ReadFile]) -> Iterator[InputChange]:
    """Yield inputs of another content."""
    before, after = ({item.what: item for item in inputs} for inputs in (a, b))
    for what in dict.fromkeys((*before, *after)):
        old, new = before.get(what), after.get(what)
        if old is None or new is None or old.sha256 != new.sha256:
            sides = (None if one is None else {"file": one.file, "sha256": one.sha256} for one in (old, new))
            yield InputChange(what, *sides)


def changed_texts(kind: str, a: Sequence[str], b: Sequence[str]) -> Iterator[TextChange]:
    """Yield the texts of a kind that stand on one side alone."""
    before, after = set(a), set(b)
    yield from (TextChange(kind, text, "a") for text in a if text not in after)
    yield from (TextChange(kind, text, "b") for text in b if text not in before)


def plain(value: Any) -> Any:
    """Return tuples as lists, at any depth."""
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, tuple | list):
        return [plain(each) for each in value]
    return value
