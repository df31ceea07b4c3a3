"""The table of terms: what makes it works, and the one in the documents is complete and true."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import full, terms
from tests.occupancy.inclusion import TRIALS, Outcome
from tests.occupancy.left_out import TERMS, LeftOut
from tests.source_files import ROOT

PAGE = ROOT / "docs" / "results" / "terms.md"
WORDS, NUMBER = r" ([^|]+?) \|", r" ([\d.e+-]+) \|"
ROW = re.compile(rf"^\|{WORDS}{WORDS}{WORDS} (\d+) \|{NUMBER} (\d+) \|{WORDS}$", re.MULTILINE)
TABLE = {(row[0], row[1]): row for row in ROW.findall(PAGE.read_text(encoding="utf-8"))}
ALL = [(model, term) for model in TERMS for term in TERMS[model]]


def test_every_model_has_a_trial_and_every_trial_terms() -> None:
    assert set(TRIALS) == set(TERMS)


def test_the_page_names_every_term_and_no_other() -> None:
    assert list(TABLE) == ALL
    assert [row[2] for row in TABLE.values()] == [TERMS[model][term].what for model, term in ALL]


@pytest.mark.parametrize(("model", "term"), ALL)
def test_a_seed_of_the_page_fails_alone(model: str, term: str) -> None:
    seed, by = int(TABLE[model, term][3]), float(TABLE[model, term][4])
    found = terms.find(model, term, seed, 1)
    assert found.as_it_should_be and (found.seed, found.tries) == (seed, 1)
    assert found.without.excess_m == pytest.approx(by, rel=1e-2)


def test_the_command_writes_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "made" / "page.md"
    model = "frame of a sensor"
    assert terms.main(["--tries", "50", "--only", model, "--out", str(page)]) == 0
    written, printed = page.read_text(encoding="utf-8"), capsys.readouterr()
    assert [row[:2] for row in ROW.findall(written)] == [(model, term) for term in TERMS[model]]
    assert ROW.findall(printed.out) == ROW.findall(written) and not printed.err
    assert "python -m tests.terms --seed 0 --tries 50 --only" in written and "- commit: " in written


def test_a_term_that_is_not_needed_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(TERMS, "frame of a sensor", {"idle": LeftOut("nothing at all")})
    assert terms.main(["--tries", "3", "--only", "frame of a sensor"]) == 1
    printed = capsys.readouterr()
    assert "| idle | nothing at all | none | - | 3 |" in printed.out
    assert "frame of a sensor, idle: no failing seed" in printed.err


def test_who_is_outside_with_the_term_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(TRIALS, "iso13855", lambda seed, aligned, left: Outcome(0.1, 1, f"seed {seed}"))
    assert terms.main(["--seed", "7", "--tries", "3", "--only", "iso13855"]) == 1
    assert "iso13855, e_p: with the term, outside (seed 7)" in capsys.readouterr().err


@pytest.mark.parametrize("main", [terms.main, full.main])
def test_a_seed_below_zero_is_refused_in_one_line(
    main: Callable[[list[str]], int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(full, "GROUPS", ())
    monkeypatch.setattr(terms, "TERMS", {})
    with pytest.raises(SystemExit) as stop:
        main(["--seed", "-1"])
    assert stop.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith("error: --seed -1: must be at least 0")
