"""docs/clocks.md: numbers, keys and lines are those of the code."""

import re
import tomllib
from pathlib import Path

import pytest

from verifier.cell import Cell
from verifier.recordings.clock_estimate import DRIFT, STRETCH_S

ROOT = Path(__file__).resolve().parents[2]
DOC = (ROOT / "docs/clocks.md").read_text(encoding="utf-8")
SOURCES = ("verifier/placing.py", "verifier/cell.py", "verifier/cell_tables.py", "verifier/recordings/")


def test_numbers_are_those_of_the_code():
    assert f"a bound ρ = {DRIFT * 1e4:g}e-4 of the drift" in DOC
    assert f"one of every {STRETCH_S:g} s takes" in DOC
    assert f"In a stretch of {STRETCH_S:g} s" in DOC


def test_the_example_is_a_cell():
    (text,) = re.findall(r"```toml\n(.*?)```", DOC, re.DOTALL)
    cell = Cell.from_table(tomllib.loads(text))
    assert cell.people.frames["camera"].pose == "recorded"


@pytest.mark.parametrize(
    "line",
    re.findall(r"`([^`]+)`", "".join(re.findall(r"^\| .* \| (.*) \|$", DOC.split("## Frames")[1], re.M))),
)
def test_lines_that_are_quoted_are_printed(line):
    files = [ROOT / each for each in SOURCES if each.endswith(".py")]
    files += sorted((ROOT / SOURCES[-1]).rglob("*.py"))
    code = " ".join(re.sub(r'"\s+f?"', "", file.read_text(encoding="utf-8")) for file in files)
    plain = re.sub(r"/\{\w+\}", "/tf", code)
    assert line in plain
