"""The picture of `verify` says by itself what it rests on: it is passed on alone."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.verifier.scenes import CELL, Scene
from verifier import Cell, verify
from verifier.reports.picture import verdict_picture
from verifier.reports.text import DISCLAIMER
from verifier.reports.verification import VerifyReport
from verifier.verdict import Reason, Status


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> VerifyReport:
    path = Scene(duration=0.5).write(tmp_path_factory.mktemp("picture") / "r.mcap")
    return verify(path, Cell.from_table(CELL))


@pytest.fixture(autouse=True)
def text_as_text(monkeypatch: pytest.MonkeyPatch) -> None:
    import matplotlib as mpl

    monkeypatch.setitem(mpl.rcParams, "svg.fonttype", "none")


def written(report: VerifyReport) -> str:
    """All text of the picture, its lines joined."""
    svg = verdict_picture(report, "svg").decode()
    return (
        " ".join(re.findall(r"<text[^>]*>([^<]*)</text>", svg)).replace("&#39;", "'").replace("&apos;", "'")
    )


def test_it_says_under_what_it_was_verified(report: VerifyReport) -> None:
    text = written(report)
    assert f"profile {report.profile}" in text and "r.mcap · waived: nothing" in text
    verified = f"verified in the model: {int((report.per_cycle.status == 2).sum())} of {report.cycles} cycles"
    assert f"{verified}, under A1–A7 " in text and "waivers below" not in text
    assert DISCLAIMER in text
    assert "to draw" not in text


def test_it_lists_the_waivers_shortened(report: VerifyReport) -> None:
    waived = ("nobody is there (--assume-nobody)", "x" * 500, *(f"waiver {n}" for n in range(7)))
    text = written(replace(report, waived=waived))
    assert "under A1–A7 and the waivers below" in text
    assert "waived: nobody is there (--assume-nobody); xxx" in text and "x" * 100 not in text
    assert "; waiver 1; and 5 more" in text and "waiver 2" not in text


def test_where_there_is_no_gap_it_says_why(tmp_path: Path) -> None:
    path = Scene(duration=0.5).write(tmp_path / "r.mcap")
    text = written(verify(path, Cell.from_table(CELL), assume_nobody=True))
    assert "no gap to draw: nobody is there by assumption" in text and "no stop to draw" not in text


def test_gaps_of_cycles_that_are_not_verified_are_told_apart(report: VerifyReport) -> None:
    """Theirs says when they fail: beside the others it would look like the little that is missing."""
    kinds = (
        "least gap of the cycle",
        "not verified: gap in the first slice that is open; later ones may lack",
    )
    assert [kind in written(report) for kind in kinds] == [True, False]
    reason, status = report.per_cycle.reason.copy(), report.per_cycle.status.copy()
    some = np.flatnonzero(np.isfinite(report.per_cycle.gap_m))[:3]
    reason[some], status[some] = int(Reason.REACHABLE), int(Status.NOT_VERIFIED)
    failing = replace(report, per_cycle=replace(report.per_cycle, reason=reason, status=status))
    assert all(kind in written(failing) for kind in kinds)


def test_where_there_is_no_stop_it_says_so(report: VerifyReport) -> None:
    nothing = np.full(report.cycles, np.nan, np.float32)
    rows = replace(report.per_cycle, stop_time_s=nothing, gap_m=np.full_like(nothing, -np.inf))
    text = written(replace(report, per_cycle=rows))
    assert "no stop to draw" in text and "no gap to draw: every link stays apart" in text


def test_names_from_files_stay_text(report: VerifyReport) -> None:
    """A dollar sign would begin a formula, a line break would hide what follows."""
    text = written(replace(report, recording="a$\\frac$b\nc", robot="$x$", waived=("$y$",)))
    assert "a$\\frac$b\\nc" in text and "$x$" in text and "waived: $y$" in text
