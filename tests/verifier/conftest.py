"""What tests of the command line share."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.verifier.scenes import Scene
from tests.verifier.shell import shell

__all__ = ["shell"]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return Scene(duration=1.0).write(tmp_path / "r.mcap")


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    path = tmp_path / "cell.toml"
    path.write_text('[robot]\nbare_flange = true\naccept_assumed = ["limits"]\n')
    return path
