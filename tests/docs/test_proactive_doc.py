"""docs/proactive.md against settings, states and files."""

from __future__ import annotations

import re
from dataclasses import fields

from modes.planning.arrt import PlannerSettings
from modes.planning.replan_settings import ReplanSettings
from modes.planning.replanning import Doing
from tests.docs.test_schemas import ROOT

DOC = (ROOT / "docs/proactive.md").read_text(encoding="utf-8")


def rows(below: str) -> dict[str, str]:
    table = DOC[DOC.index(below) :].split("\n\n")[0]
    return dict(re.findall(r"^\| `(\w+)` \| (.*?) \|", table, re.M))


def test_every_setting_is_described_with_its_default() -> None:
    table, made = rows("| setting of `ReplanSettings`"), ReplanSettings()
    assert list(table) == [each.name for each in fields(ReplanSettings)]
    assert table.pop("planner") == "`PlannerSettings(nodes=200)`"
    assert made.planner == PlannerSettings(nodes=200)
    for name, text in table.items():
        assert text == str(getattr(made, name)), name


def test_every_state_is_described() -> None:
    assert set(rows("| `mode.decision.doing`")) == {each.name for each in Doing}


def test_files_in_it_exist() -> None:
    paths = re.findall(r"`((?:tests|modes|examples)/[\w/]+\.py)`", DOC)
    assert len(paths) > 8 and all((ROOT / path).is_file() for path in paths)


def test_code_in_it_imports() -> None:
    for line in re.findall(r"^from .*$", DOC, re.M):
        exec(line, {})
