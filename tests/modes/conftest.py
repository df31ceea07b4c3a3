"""Arms for the tests of modes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from robots.catalog import RobotSetup, load_robot
from robots.model import RobotModel


@cache
def _loaded(name: str) -> RobotModel:
    return load_robot(name, setup=RobotSetup(bare_flange=True))


@pytest.fixture(scope="session")
def arm() -> Callable[[str], RobotModel]:
    return _loaded
