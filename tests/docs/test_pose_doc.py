"""docs/pose.md against settings, outcomes and files; its code runs."""

from __future__ import annotations

import re
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from modes.forecasting import detector
from modes.forecasting.depth import DepthSettings
from modes.forecasting.landmarks import PoseSettings
from modes.forecasting.pose import FrameOutcome
from tests.docs.test_schemas import ROOT
from tests.modes.forecasting import scripted_detectors

DOC = (ROOT / "docs/pose.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("kind", [DepthSettings, PoseSettings])
def test_every_setting_is_described_with_its_default(kind: type) -> None:
    below = DOC[DOC.index(f"| setting of `{kind.__name__}`") :]
    table = dict(re.findall(r"^\| `(\w+)` \| (.*?) \|", below.split("\n\n")[0], re.M))
    made = kind()
    assert list(table) == [each.name for each in fields(kind)]
    for name, text in table.items():
        assert text == ("`SKIN`" if name == "skin" else str(getattr(made, name))), name


def test_every_outcome_is_in_its_table() -> None:
    below = DOC[DOC.index("| outcome | report |") :].split("\n\n")[0]
    assert set(re.findall(r"`(\w+)`", below)) == {each.name for each in FrameOutcome}


def test_files_in_it_exist() -> None:
    for path in re.findall(r"`((?:tests|modes)/[\w/]+\.py)`", DOC):
        assert (ROOT / path).is_file(), path


def test_its_code_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a scripted detector in the place of MediaPipe: nobody in a black image."""
    monkeypatch.setattr(detector, "MediaPipePose", lambda: scripted_detectors.brightness)
    image, depth = np.zeros((480, 640, 3), dtype=np.uint8), np.full((480, 640), 1500, dtype=np.uint16)
    given: dict[str, Any] = {
        "readings": [(0.0, 0.0, -9.81)],
        "frames": [(1.0, image, depth), (1.1, image, depth)],
        "clock": lambda: 1.2,
        "reports": [],
    }
    code = re.search(r"```python\n(.*?)```", DOC, re.S)
    assert code is not None
    exec(code[1].replace("timeout_s=0.2", "timeout_s=20.0"), given)  # the documented code itself
    assert [report.stamp for report in given["reports"]] == [1.0, 1.1]
    assert all(report.people == () for report in given["reports"])
