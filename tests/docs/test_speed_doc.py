"""docs/speed.md against what the scenario prints and the mode's settings."""

from __future__ import annotations

import re
from dataclasses import fields

import pytest

from modes.speed.alteration import SpeedSettings
from modes.speed.report import SpeedReport
from modes.speed.scenario import run_scenario
from modes.speed.scenario import scenario as whole_scenario
from modes.speed.simulations import simulation
from tests.docs.test_schemas import ROOT
from verifier.supervisor import Supervisor

DOC = (ROOT / "docs/speed.md").read_text(encoding="utf-8")
PRINTED = re.search(r"```text\n(.*?)\n```", DOC, re.DOTALL)


def printed() -> list[str]:
    assert PRINTED is not None
    return PRINTED[1].splitlines()


def lines(report: SpeedReport) -> list[str]:
    return "\n".join(report.lines_of_text()).splitlines()


@pytest.mark.rarely("tests/modes/speed/test_scenario.py and test_simulations.py, the numbers of the text")
def test_the_text_shows_what_the_scenario_prints() -> None:
    """All of it but for the rows of scenes under the verifier that take long."""
    short = lines(run_scenario((simulation(1),), lambda share: None))
    left_out = [line for line in printed() if line not in short]
    assert left_out and all(re.match(r"  (simulation 2|experiment [12]) ", line) for line in left_out), (
        left_out
    )
    assert [line for line in printed() if line not in left_out] == short


@pytest.mark.rarely("the rest of the text, in every run")
def test_the_rows_of_all_scenes_are_those_that_are_printed() -> None:
    report = whole_scenario(lambda share: None)
    assert isinstance(report, SpeedReport) and printed() == lines(report)


def test_every_setting_is_described() -> None:
    rows = re.findall(r"^\| (`[^|]+) \| [^|]+ \| [^|]+ \|$", DOC, re.MULTILINE)
    named = set(re.findall(r"`(\w+)`", " ".join(rows)))
    known = {field.name for field in fields(SpeedSettings)} - {"genetic", "seed"}
    assert known == named and "`seed`" in DOC and "`GeneticSettings(polish=True)`" in DOC
    assert SpeedSettings().cap_m_s == 0.25 and SpeedSettings().interval_s == 0.1


def test_files_and_names_in_it_exist() -> None:
    for path in re.findall(r"`((?:tests|modes)/[\w/]+\.py)`", DOC):
        assert (ROOT / path).is_file(), path
    assert hasattr(Supervisor, "propose") and "supervisor.check.robot" in DOC
