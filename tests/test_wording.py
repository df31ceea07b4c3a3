"""Words that the output never uses: every string of the shipped packages and of their data files."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator

import pytest

from tests.source_files import PACKAGES, ROOT, Source, docstrings, sources

FORBIDDEN = {
    "certified": re.compile(r"\b(un)?certified\b", re.IGNORECASE),
    "compliant": re.compile(r"\b(non-?)?compliant\b", re.IGNORECASE),
    "ISO-approved": re.compile(r"\bISO[- ]?approved\b", re.IGNORECASE),
    "guaranteed safe": re.compile(r"\bguaranteed\s+(to\s+be\s+)?safe", re.IGNORECASE),
    "safe": re.compile(r"(?<!fail-)\bsafe\b(?!_load|guard)|\bsafely\b", re.IGNORECASE),
}
"""*failsafe* and the disclaimer's *not a safety function* are other words."""
COMMAND_LINE = tuple(
    path.relative_to(ROOT).as_posix() for path in sorted((ROOT / "verifier").glob("*command*.py"))
)


def output_strings(source: Source) -> Iterator[tuple[int, str]]:
    """Yield line and text of every string; docstrings only on the command line, where they are help."""
    skipped = set() if source.name in COMMAND_LINE else docstrings(source.tree)
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in skipped:
            yield node.lineno, node.value


def faults(where: str, text: str) -> list[str]:
    return [
        f"{where}: {word!r} in {text.strip()[:80]!r}" for word, rule in FORBIDDEN.items() if rule.search(text)
    ]


def test_no_string_of_the_packages_uses_these_words() -> None:
    found, read = [], 0
    for source in sources(*PACKAGES):
        for line, text in output_strings(source):
            read += 1
            found += faults(f"{source.name}:{line}", text)
    assert read > 1000
    assert not found, "\n" + "\n".join(found)


def test_no_text_of_the_data_files_uses_these_words() -> None:
    found, read = [], 0
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.toml")):
            for text in texts(tomllib.loads(path.read_text(encoding="utf-8"))):
                read += 1
                found += faults(path.relative_to(ROOT).as_posix(), text)
    assert read > 100
    assert not found, "\n" + "\n".join(found)


def texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for each in value.values():
            yield from texts(each)
    elif isinstance(value, list):
        for each in value:
            yield from texts(each)


@pytest.mark.parametrize(
    "text",
    [
        "this cell is safe",
        "Safe.",
        "safe: yes",
        "moves safely",
        "is certified",
        "a compliant cell",
        "ISO approved",
        "guaranteed safe",
        "guaranteed to be safe",
    ],
)
def test_the_words_are_found(text: str) -> None:
    planted = Source("verifier/x.py", ast.parse(f"def f(n):\n    return f'{{n}} {text}'"))
    assert any(faults("x", each) for _, each in output_strings(planted))


@pytest.mark.parametrize(
    "text",
    [
        "failsafe",
        "Not a manufacturer's declaration, not a safety function",
        "certificate",
        "verified in the model",
    ],
)
def test_other_words_are_left_alone(text: str) -> None:
    assert not faults("x", text)


def test_docstrings_count_on_the_command_line_only() -> None:
    tree = ast.parse('def f():\n    """Whether it is safe."""')
    assert not list(output_strings(Source("verifier/x.py", tree)))
    assert list(output_strings(Source(COMMAND_LINE[0], tree)))
