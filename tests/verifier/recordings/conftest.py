"""Files that imports are tried with."""

import numpy as np
import pytest

from tests.verifier.recordings.imports import ROBOT, people_file


@pytest.fixture
def joints(tmp_path):
    """Two seconds at 100 Hz that start at 7 s."""
    t = np.arange(201) / 100
    q = np.sin(t[:, None] + [0.0, 1.0])
    np.savez(tmp_path / "joints.npz", t=7.0 + t, q=q, dq=q + 1, tau=q + 2, joints=np.array(ROBOT))
    return tmp_path / "joints.npz"


@pytest.fixture
def people(tmp_path):
    """Three seconds at 50 Hz that start at 100 s; a walk along x."""
    return people_file(tmp_path / "people.npz")
