"""docs/robots.md against the model files."""

from __future__ import annotations

import math
import re
import tomllib

import pytest

from robots.catalog import robot_names
from tests.docs.test_schemas import ROOT
from verifier import section

TEXT = (ROOT / "docs" / "robots.md").read_text(encoding="utf-8")
ROWS = {
    row[0]: row[1:]
    for row in re.findall(r"^\| `(\w+)` \| " + r" \| ".join(["(.*?)"] * 5) + r" \|$", TEXT, re.M)
}


def test_every_arm_has_a_row() -> None:
    assert tuple(sorted(ROWS)) == robot_names()
    assert "Twelve arms" in (ROOT / "README.md").read_text(encoding="utf-8") and len(ROWS) == 12


@pytest.mark.parametrize("name", robot_names())
def test_a_row_says_what_the_model_file_says(name: str) -> None:
    table = tomllib.loads((ROOT / "robots" / "models" / f"{name}.toml").read_text(encoding="utf-8"))
    arm, enclosure, limits, last, payload = ROWS[name]
    assert arm.startswith(table["description"])
    assert enclosure == ("assumed" if "enclosure" in table else "proven")
    assert {each["certainty"] for each in table.get("enclosure", [])} <= {"assumed"}
    assert {table["limits"][each]["certainty"] for each in ("acceleration", "jerk")} == {limits}
    upper = table["limits"]["position_upper"]
    end, unit = upper["values"][-1], {"deg": "°", "rad": " rad"}[upper["unit"]]
    assert last == ("endless" if math.isinf(end) else f"±{end:{'.2f' if unit == ' rad' else ''}}{unit}")
    rated = table.get("rated_payload")
    assert payload == ("not known" if rated is None else f"{rated['kg']:g} kg, {rated['certainty']}")


def test_what_is_quoted_stands_in_the_code() -> None:
    code = (ROOT / "verifier" / "section.py").read_text(encoding="utf-8")
    assert "an angle that wraps" in code and "an angle that wraps" in TEXT
    assert f"Farther than {section.FARTHEST:g} rad" in TEXT
    planner = (ROOT / "verifier" / "scripted_planner.py").read_text(encoding="utf-8")
    assert "_WIDEST_RAD = 2.4" in planner and "-2.4 to 2.4 rad" in TEXT
