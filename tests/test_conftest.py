"""The choice of items that tests look at in a run: all of them at full counts, some of them otherwise."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import RARELY_BELOW, Some, share_of
from tests.source_files import ROOT

ITEMS = [f"item {k}" for k in range(40)]


def test_at_full_counts_all_items_are_chosen_in_their_order() -> None:
    assert share_of(ITEMS, 1, 1.0, 0) == ITEMS
    assert share_of(ITEMS, 1, 3.0, 5) == ITEMS


@pytest.mark.parametrize(
    ("scale", "least", "n"), [(0.01, 1, 1), (0.01, 3, 3), (0.1, 1, 4), (0.11, 1, 5), (0.01, 99, 40)]
)
def test_otherwise_a_share_but_never_fewer_than_asked_for(scale: float, least: int, n: int) -> None:
    chosen = share_of(ITEMS, least, scale, 0)
    assert len(set(chosen)) == len(chosen) == n
    assert chosen == sorted(chosen, key=ITEMS.index)
    assert share_of(ITEMS, least, scale, 0) == chosen, "the same seed, the same items"


def test_over_the_seeds_every_item_is_looked_at() -> None:
    seen = {share_of(ITEMS, 1, 0.01, seed)[0] for seed in range(400)}
    assert seen == set(ITEMS)


def test_of_nothing_nothing_is_chosen() -> None:
    assert share_of([], 1, 0.01, 0) == []


def test_the_fixture_has_the_scale_and_the_seed_of_this_run(
    some: Some, request: pytest.FixtureRequest
) -> None:
    scale, seed = float(request.config.getoption("--scale")), int(request.config.getoption("--seed"))
    assert some(ITEMS) == share_of(ITEMS, 1, scale, seed)
    assert len(some(ITEMS, 2)) == min(len(ITEMS), max(2, math.ceil(scale * len(ITEMS))))


RARE = """
import pytest

@pytest.mark.rarely("test_b")
def test_a(): pass

def test_b(): pass

@pytest.mark.real_data
@pytest.mark.parametrize("x", [1, pytest.param(2, marks=pytest.mark.rarely("1"))])
def test_c(x): pass
"""


def pytest_on(text: str, folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    (folder / "test_rare.py").write_text(text, encoding="utf-8")
    settings = ("-c", str(ROOT / "pyproject.toml"), "--rootdir", str(ROOT), "-p", "tests.conftest")
    command = [sys.executable, "-m", "pytest", str(folder), *settings, "-v", "-p", "no:cacheprovider"]
    return subprocess.run([*command, *options], cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("options", "ran"),
    [
        pytest.param((), ["test_b", "test_c[1]"], marks=pytest.mark.rarely("half of the least scale")),
        (("--scale", f"{RARELY_BELOW / 2}"), ["test_b", "test_c[1]"]),
        (("--scale", f"{RARELY_BELOW}"), ["test_a", "test_b", "test_c[1]", "test_c[2]"]),
        (("-m", "rarely"), ["test_a", "test_c[2]"]),
        pytest.param(("-m", "real_data"), ["test_c[1]"], marks=pytest.mark.rarely("-m rarely")),
    ],
)
def test_what_is_run_rarely_is_left_out_of_small_runs(
    tmp_path: Path, options: tuple[str, ...], ran: list[str]
) -> None:
    """And counted there by pytest as deselected."""
    done = pytest_on(RARE, tmp_path, *options)
    assert done.returncode == 0, done.stdout + done.stderr
    told = [line.split("::", 1)[1].split()[0] for line in done.stdout.splitlines() if " PASSED" in line]
    assert told == ran
    assert ("deselected" in done.stdout) == (len(ran) < 4)


def test_every_mark_must_say_what_is_run_instead(tmp_path: Path) -> None:
    done = pytest_on(RARE.replace('rarely("test_b")', "rarely"), tmp_path)
    assert done.returncode != 0
    assert "test_a: the mark rarely must say which test is run instead" in done.stdout + done.stderr
