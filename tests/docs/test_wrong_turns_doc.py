"""docs/wrong_turns.md: every line names the tests that there are."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOC = (ROOT / "docs/wrong_turns.md").read_text(encoding="utf-8")
FEATURES = "tests/verifier/test_peers_features.py"
SHOWN = {20, 22}
"""Lines that are features, not faults."""


def rows() -> dict[int, str]:
    found = re.findall(r"^\| (\d+) \| [^|]+ \| ([^|]+) \|$", DOC, re.MULTILINE)
    return {int(number): tests for number, tests in found}


def existing() -> dict[int, set[str]]:
    tests: dict[int, set[str]] = {}
    for path in sorted((ROOT / "tests/peers").glob("test_*.py")):
        for name, number in re.findall(
            r"^def (test_peer_(\d\d)_\w+)\(", path.read_text("utf-8"), re.MULTILINE
        ):
            tests.setdefault(int(number), set()).add(name)
    return tests


def test_every_line_is_there_once():
    assert list(rows()) == list(range(1, 23))


def test_every_line_names_its_tests_and_every_test_is_named():
    named = {number: set(re.findall(r"`(test_peer_\w+)`", tests)) for number, tests in rows().items()}
    assert {number: names for number, names in named.items() if names} == existing()


def test_lines_that_are_features_name_their_file():
    for number, tests in rows().items():
        assert (f"`{FEATURES}`" in tests) == (number in SHOWN)


def test_every_test_of_a_wrong_turn_says_what_it_is():
    for path in sorted((ROOT / "tests/peers").glob("test_*.py")):
        for name, doc in re.findall(
            r'^def (test_peer_\w+)\([^)]*\)[^:]*:\n    (""")?', path.read_text("utf-8"), re.MULTILINE
        ):
            assert doc, f"{path.name}: {name} does not say what goes wrong elsewhere"
