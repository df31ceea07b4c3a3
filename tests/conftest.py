"""Options and fixtures that every test may use."""

from __future__ import annotations

import gc
import math
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
import pytest

T = TypeVar("T")


class Some(Protocol):
    """Chooses from items: all at full counts, else a seeded share of them, but ``least`` at least."""

    def __call__(self, items: Sequence[T], least: int = 1) -> list[T]: ...


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seed", type=int, default=0, help="seed of all randomised tests")
    parser.addoption(
        "--scale", type=float, default=0.01, help="share of the full counts of randomised tests (1.0: all)"
    )


def pytest_configure(config: pytest.Config) -> None:
    if hasattr(config, "workerinput"):  # one of several processes of pytest-xdist
        from tests import compile_once

        compile_once.install()
    if not config.getoption("--seed") >= 0:
        raise pytest.UsageError(f"--seed {config.getoption('--seed')}: must be at least 0")


RARELY_BELOW = 0.1


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is run rarely, unless there is time for larger counts or somebody asks by ``-m``."""
    marks = {item: item.get_closest_marker("rarely") for item in items}
    for item, mark in marks.items():
        if mark is not None and not mark.args:
            raise pytest.UsageError(f"{item.name}: the mark rarely must say which test is run instead")
    if float(config.getoption("--scale")) >= RARELY_BELOW or "rarely" in config.getoption("markexpr"):
        return
    config.hook.pytest_deselected(items=[item for item in items if marks[item] is not None])
    items[:] = [item for item in items if marks[item] is None]


def pytest_collection_finish() -> None:
    """Some thousand tests live until the end: they are not looked through for garbage again and again.

    Compiling makes many short-lived objects, and in a fresh clone most functions are compiled once.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 50, 50)


@pytest.fixture(autouse=True)
def rounding_to_nearest() -> Iterator[None]:
    """A library that leaves the processor rounding another way would change every number of later tests."""
    yield
    tiny = float(np.ldexp(1.0, -53))
    assert 1.0 + tiny == 1.0 and 1.0 - 0.5 * tiny == 1.0, "the processor does not round to nearest any more"


@pytest.fixture(autouse=True, scope="session")
def arms_of_the_catalogue_are_read_once() -> Iterator[None]:
    from tests.arms_once import loaded_once

    yield from loaded_once()


@pytest.fixture
def seed(request: pytest.FixtureRequest) -> int:
    return int(request.config.getoption("--seed"))


@pytest.fixture
def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.fixture
def count(request: pytest.FixtureRequest) -> Callable[[int], int]:
    """Full count of a randomised test -> count for this run."""
    scale = float(request.config.getoption("--scale"))
    return lambda full: max(1, int(full * scale))


@pytest.fixture(scope="session")
def some(request: pytest.FixtureRequest) -> Some:
    """Items of a test, recordings for example -> those for this run, in their order."""
    scale, seed = float(request.config.getoption("--scale")), int(request.config.getoption("--seed"))
    return lambda items, least=1: share_of(items, least, scale, seed)


def share_of(items: Sequence[T], least: int, scale: float, seed: int) -> list[T]:
    """Return a seeded share of ``items``, in their order: ``scale`` of them, but ``least`` if there are."""
    n = min(len(items), max(least, math.ceil(scale * len(items))))
    chosen = np.random.default_rng([seed, len(items)]).choice(len(items), n, replace=False)
    return [items[k] for k in sorted(chosen)]


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real recordings; tests that need it are skipped, saying so, where it is not there."""
    folder = os.environ.get("STOPPROOF_REAL_DATA")
    if not folder:
        pytest.skip("STOPPROOF_REAL_DATA is not set: real recordings are not available here")
    path = Path(folder)
    if not path.is_dir():
        pytest.fail(f"STOPPROOF_REAL_DATA names {path}, which is not a folder")
    return path
