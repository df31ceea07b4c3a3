"""docs/planning.md against settings and files."""

from __future__ import annotations

import re
from dataclasses import fields

import pytest

from modes.planning.arrt import NoPath, PlannerSettings
from modes.planning.potential_field import FieldSettings
from tests.docs.test_schemas import ROOT

DOC = (ROOT / "docs/planning.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("kind", [FieldSettings, PlannerSettings])
def test_every_setting_is_described_with_its_default(kind: type) -> None:
    below = DOC[DOC.index(f"| setting of `{kind.__name__}`") :]
    table = dict(re.findall(r"^\| `(\w+)` \| (.*?) \|", below.split("\n\n")[0], re.M))
    made = kind()
    assert list(table) == [each.name for each in fields(kind)]
    for name, text in table.items():
        value = getattr(made, name)
        assert text == (f'`"{value}"`' if isinstance(value, str) else str(value)), name


def test_files_and_reasons_in_it_exist() -> None:
    for path in re.findall(r"`((?:tests|modes)/[\w/]+\.py)`", DOC):
        assert (ROOT / path).is_file(), path
    assert "NODES_USED_UP" in DOC and NoPath.NODES_USED_UP.value
