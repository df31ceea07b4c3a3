"""In tests an arm of the catalogue is read once by each process, however many cells name it.

Reading it takes most of the time in which a cell becomes a supervisor, and some thousand tests make one.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from robots.catalog import RobotSetup, load_robot, robot_names
from robots.model import RobotModel


def loaded_once() -> Iterator[None]:
    """While this goes on, cells of the command line and of supervisors get copies of what was read before."""
    known: dict[tuple[str, bytes, str | None], RobotModel] = {}

    def load(name: str | Path, setup: RobotSetup) -> RobotModel:
        if name not in robot_names() or setup.tool is not None:  # a file, which a test may write anew
            return load_robot(name, setup=setup)
        key = str(name), pickle.dumps(setup), os.environ.get("XDG_CACHE_HOME")
        if key not in known:
            known[key] = load_robot(name, setup=setup)
        model = known[key]
        return replace(model, kinematics=model.kinematics.copy(), enclosure=model.enclosure.copy())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("verifier.setup.load_robot", load)
        yield
