"""Arms for the tests of robots, loaded once, with their own folder for enclosures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from robots.catalog import RobotSetup, load_robot
from robots.model import RobotModel
from tests.robots.enclosures import cache_dir

__all__ = ["cache_dir"]


@pytest.fixture(scope="session")
def arm(cache_dir: Path) -> Callable[[str], RobotModel]:
    """Name -> arm of the catalogue with a bare flange."""
    return lambda name: load_robot(name, setup=RobotSetup(bare_flange=True, cache_dir=cache_dir))


@pytest.fixture
def write_urdf(tmp_path: Path) -> Callable[[str], Path]:
    """URDF text -> its path."""

    def write(text: str) -> Path:
        path = tmp_path / "made_up.urdf"
        path.write_text(text, encoding="utf-8")
        return path

    return write
