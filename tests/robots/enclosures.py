"""Where enclosures of arms are kept in tests: made anew in every run, once for all of its processes."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def cache_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:  # each process has a folder of its own within that of the run
        base = base.parent
    folder = base / "enclosures"
    folder.mkdir(exist_ok=True)
    return folder
