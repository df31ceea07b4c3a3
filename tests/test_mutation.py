"""Mutants of the core: what changes, what is tried, what is told, and that lists are those of the tree."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from textwrap import dedent

import pytest

from tests.mutation import __main__ as command
from tests.mutation import equivalents
from tests.mutation.compiled import digest
from tests.mutation.mutants import Mutant, apply, changes
from tests.mutation.page import Tally, Tried, drawn_before, interval, page
from tests.mutation.table import JUDGES_RECORDINGS, TESTS, belonging_to
from tests.mutation.trial import Copy, Outcome, TrialError
from tests.source_files import CORE_PACKAGES, ROOT
from tests.test_architecture import TRUSTED_VERIFIER

SOURCE = '''\
"""Sums up to 3 + 4."""

import numpy as np

KIND = np.dtype([("x", np.float64, (3, 4))])


def total(numbers: list[int | float], least: float = 0.0) -> float | None:
    """Return 1 + 1, say."""
    if not numbers:
        raise ValueError(f"{1 + 1} numbers")
    found = least
    for number in numbers:
        found += number
    return max(found, least)


def first(block):
    record = block[0]
    return block["n"][0] + record["n"]
'''
TEST = """\
from small import total


def test_sum():
    assert total([1.0, 2.0]) == 3.0
"""


def plain(line: str) -> str:
    return " ".join(line.split())


def mutants(source: str) -> list[Mutant]:
    found = [apply("small.py", source, each) for each in changes(source)]
    return [each for each in found if each is not None]


def test_only_code_is_changed() -> None:
    assert {(each.before, each.after) for each in mutants(SOURCE)} == {
        ("if not numbers:", "if numbers:"),
        ("def total(numbers: list[int | float], least: float = 0.0) -> float | None:",
         "def total(numbers: list[int | float], least: float = 1.0) -> float | None:"),
        ("def total(numbers: list[int | float], least: float = 0.0) -> float | None:",
         "def total(numbers: list[int | float], least: float = -1.0) -> float | None:"),
        ("for number in numbers:", "for number in []:"),
        ("found += number", "found -= number"),
        ("return max(found, least)", "return min(found, least)"),
        ('return block["n"][0] + record["n"]', 'return block["n"][0] - record["n"]'),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("code", "changed"),
    [
        ("x *= 2", {"x /= 2", "x *= 3", "x *= 1"}),
        ("bits |= np.any(x)", {"bits &= np.any(x)", "bits |= np.all(x)"}),
        (
            "a = b if b < c else c",
            {"a = b if b <= c else c", "a = b if b >= c else c"},
        ),
        ("a = b if b in c else c", {"a = b if not b in c else c"}),
        ("a = b if b and c else c", {"a = b if not b and c else c", "a = b if b or c else c"}),
        ("x = -y", {"x = y"}),
        ("raise ValueError(3)", set()),
        ("a = np.zeros((3, 4), dtype=KIND)", set()),
        ("a = np.full(3, 4)", {"a = np.full(3, 5)", "a = np.full(3, 3)"}),
        ("def f(*args): return g(*args)", set()),
        ("if TYPE_CHECKING:\n    x = 3", set()),
        ("x: A | B = y", set()),
        ("@njit(cache=True)\ndef f(): pass", set()),
        ("a = b[1]", {"a = b[2]", "a = b[0]"}),
        ("a, b = self.c[0], d[0]", set()),
        ("a = b[0] + 1", {"a = b[1] + 1", "a = b[0] - 1", "a = b[0] + 2", "a = b[0] + 0"}),
        ("ω, x = 'ω', y + z", {"ω, x = 'ω', y - z"}),
    ],
)
def test_what_becomes_of_a_line(code: str, changed: set[str]) -> None:
    assert {each.after for each in mutants(code + "\n")} == changed


def test_a_changed_file_differs_in_the_line_that_is_named() -> None:
    for each in mutants(SOURCE):
        differing = [
            (i, a, b)
            for i, (a, b) in enumerate(zip(SOURCE.splitlines(), each.text.splitlines(), strict=True), 1)
            if a != b
        ]
        assert [(i, plain(a), plain(b)) for i, a, b in differing] == [(each.line, each.before, each.after)]


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Copy]:
    tree = tmp_path / "tree"
    (tree / "tests").mkdir(parents=True)
    (tree / "small.py").write_text(SOURCE, encoding="utf-8")
    (tree / "tests" / "test_small.py").write_text(TEST, encoding="utf-8")
    (tree / "tests" / "conftest.py").write_text("import sys\nsys.path.insert(0, '.')\n", encoding="utf-8")
    copy = Copy(tree, tmp_path / "copy", ())
    yield copy
    copy.close()


def mutant(after: str) -> Mutant:
    return next(each for each in mutants(SOURCE) if each.after == after)


def test_one_is_killed_one_survives_and_the_copy_is_as_before(small: Copy, tmp_path: Path) -> None:
    tests = ["tests/test_small.py"]
    assert 0.0 < small.time(tests[0]) < 60.0
    assert small.attempt(mutant("found -= number"), tests, 60.0) is Outcome.KILLED
    assert small.attempt(mutant("return min(found, least)"), tests, 60.0) is Outcome.KILLED
    unseen = 'return block["n"][0] - record["n"]'
    assert small.attempt(mutant(unseen), tests, 60.0) is Outcome.SURVIVED
    for tree in (small.root, tmp_path / "tree"):
        assert (tree / "small.py").read_text(encoding="utf-8") == SOURCE


@pytest.mark.rarely("test_one_is_killed_one_survives_and_the_copy_is_as_before")
def test_what_does_not_end_is_stopped(small: Copy) -> None:
    endless = SOURCE.replace("found += number", "found += number\n        while True: pass")
    change = Mutant("small.py", 1, "", "", endless)
    assert small.attempt(change, ["tests/test_small.py"], 5.0) is Outcome.TIMED_OUT


@pytest.mark.rarely("test_one_is_killed_one_survives_and_the_copy_is_as_before")
def test_what_cannot_be_imported_is_noticed(small: Copy) -> None:
    assert (
        small.attempt(Mutant("small.py", 1, "", "", "1 +"), ["tests/test_small.py"], 60.0) is Outcome.KILLED
    )


@pytest.mark.rarely("test_one_is_killed_one_survives_and_the_copy_is_as_before")
def test_tests_that_fail_without_a_change_or_are_not_there_are_told(small: Copy) -> None:
    (small.root / "tests" / "test_small.py").write_text("def test():\n    assert 1 == 2\n", encoding="utf-8")
    with pytest.raises(TrialError, match=r"does not pass without a change:\n(.*\n)*.*assert 1 == 2"):
        small.time("tests/test_small.py")
    with pytest.raises(TrialError, match="does not pass"):
        small.time("tests/test_none.py")
    (small.root / "tests" / "test_small.py").write_text("", encoding="utf-8")
    with pytest.raises(TrialError, match=r"no test ran for small\.py"):
        small.attempt(mutant("found -= number"), ["tests/test_small.py"], 60.0)


def test_a_sample_is_seeded_and_spread_over_all_mutants() -> None:
    files = ["robots/rounding.py", "verifier/tracking.py"]
    first, again, other = (command.draw(files, 12, seed, ROOT) for seed in (1, 1, 2))
    assert first == again != other
    for file in files:
        possible, drawn = first[file]
        assert possible == len(changes((ROOT / file).read_text(encoding="utf-8"))) >= len(drawn) > 0
        assert len({each.text for each in drawn}) == len(drawn)
    assert sum(len(drawn) for _, drawn in first.values()) == 12
    assert len(first["verifier/tracking.py"][1]) > len(first["robots/rounding.py"][1])


def test_interval_solves_its_equation() -> None:
    z = 1.959964
    for hits, tries in ((0, 7), (7, 7), (33, 40), (1, 1000)):
        low, high = interval(hits, tries)
        assert 0.0 <= low <= hits / tries <= high <= 1.0
        for p in (low, high):
            # (share - p)² = z² p (1 - p) / n, by definition
            assert (hits / tries - p) ** 2 == pytest.approx(z * z * p * (1.0 - p) / tries, abs=1e-9)
    assert interval(0, 0) == (0.0, 1.0)


def test_the_page_counts_and_names_and_keeps_what_stands_there() -> None:
    some = mutants(SOURCE)
    ends = (Outcome.KILLED, Outcome.SURVIVED, Outcome.TIMED_OUT)
    tally = Tally("small.py", 8, 1, tuple(Tried(each, end) for each, end in zip(some, ends, strict=False)))
    first = page([tally], ["0", "0.01", "abc", "today"])
    text = page([Tally("other.py", 5, 0, ())], ["1", "1", "def", "now"], first)
    low, high = (f"{100.0 * x:.1f}" for x in interval(2, 3))
    assert f"| small.py | 8 | 3 | 1 | 1 | 1 | 1 | 66.7 % ({low} to {high}) | 0 | 0.01 | abc | today |" in text
    assert "| other.py | 5 | 0 | 0 | 0 | 0 | 0 | - | 1 | 1 | def | now |" in text
    assert f"| all | 13 | 3 | 1 | 1 | 1 | 1 | 66.7 % ({low} to {high}) |" in text
    survivors = text.split("## Survivors")[1].strip().splitlines()
    assert survivors == [f"- small.py:{some[1].line}: `{some[1].before}` → `{some[1].after}`"]
    again = page([Tally("small.py", 8, 0, ())], ["2", "1", "ghi", "later"], text)
    assert again.split("## Survivors")[1].strip() == "" and "| all | 13 | 0 | 0 | 0 | 0 | 0 | - |" in again


def test_the_page_tells_what_a_run_that_was_ended_has_tried() -> None:
    some = [Tried(each, Outcome.KILLED) for each in mutants(SOURCE)[:3]]
    text = page([Tally("small.py", 8, 1, tuple(some))], ["0", "0.01", "abc", "today"])
    text = page([Tally("other.py", 5, 0, ())], ["0", "0.01", "def", "today"], text)
    assert drawn_before(text, ["0", "0.01", "abc", "now"]) == {"small.py": 4}
    assert drawn_before(text, ["0", "0.01", "def", "now"]) == {"other.py": 0}
    assert drawn_before(text, ["1", "0.01", "abc", "now"]) == drawn_before("", ["0", "1", "abc", "now"]) == {}


@pytest.mark.rarely("test_one_is_killed_one_survives_and_the_copy_is_as_before")
def test_compiled_functions_are_told_apart_by_what_they_call() -> None:
    file = ROOT / "occupancy" / "ledger_kernels.py"
    assert digest(file, "prove_apart") != digest(file, "_box_gap") == digest(file, "_box_gap")


def test_every_file_of_the_core_has_tests_that_are_there() -> None:
    core = {str(path.relative_to(ROOT)) for name in CORE_PACKAGES for path in (ROOT / name).rglob("*.py")}
    trusted = {each for each in core if not each.endswith("__init__.py")} | set(TRUSTED_VERIFIER)
    assert set(TESTS) == trusted | set(JUDGES_RECORDINGS) and not trusted & set(JUDGES_RECORDINGS)
    missing = {test for file in TESTS for test in belonging_to(file) if not (ROOT / test).is_file()}
    assert not missing


@pytest.mark.parametrize("each", equivalents.load(), ids=lambda each: f"{each.file}: {each.after}")
def test_what_is_called_equivalent_is_still_a_mutant(each: equivalents.Equivalent) -> None:
    assert len(each.reason.split()) >= 4
    made = mutants_of(each.file, each.before)
    assert any(one.after == each.after for one in made), "no mutant is like that"


def mutants_of(file: str, before: str) -> Iterator[Mutant]:
    """What a line can become, wherever it stands; of a file only the statements around it are changed."""
    for text in statements(file):
        lines = {i for i, line in enumerate(text.splitlines(), 1) if plain(line) == before}
        if lines:
            made = (apply(file, text, change) for change in changes_of(text) if change.line in lines)
            yield from filter(None, made)


@cache
def statements(file: str) -> list[str]:
    """Statements of a file, each for itself: of one that holds others its head, with nothing in it."""
    source = (ROOT / file).read_text(encoding="utf-8")
    whole = source.splitlines(keepends=True)
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.stmt):
            continue
        body = getattr(node, "body", None)
        end = node.end_lineno if body is None else max(node.lineno, body[0].lineno - 1)
        text = dedent("".join(whole[node.lineno - 1 : end]))
        # of a word like "else" alone nothing can become something else
        found.append(text if body is None or body[0].lineno == node.lineno else f"{text}    pass\n")
    return found


changes_of = cache(changes)


@pytest.mark.parametrize(
    "given",
    [["--sample", "0"], ["--jobs", "0"], ["--seed", "-1"], ["--only", "README.md"], ["--resume"]],
)
def test_bad_options_are_refused_in_one_line(given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        command.main(given)
    assert stop.value.code == 2
    assert "error: " in capsys.readouterr().err.splitlines()[-1]
