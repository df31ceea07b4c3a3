"""Every fault in every recording: no set ever loses a place that later motion needs."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from occupancy.measurement import RawMeasurement
from tests.conftest import Some
from tests.occupancy.people import clip, clips
from tests.soundness.gate_faults import FAULTS, Outcome, Scene, gate_settings, reports, run, scene

Count = Callable[[int], int]
TELLING = {
    "jump", "left and right", "arms exchanged, now and then", "merged", "merged parts", "left out",
    "names exchanged",
}  # fmt: skip
"""Faults that say what cannot be true, or lack what must be there."""
REFUSED = {"not a number", "zero", "inferred", "millimetres", "kilometres", "ahead", "frozen", "frozen arm"}
"""Faults that make no measurement."""


def recordings(folder: Path) -> list[Path]:
    found = [*clips(folder / "human"), *clips(folder / "human_robot")]
    assert len(found) >= 20
    return found


def scenes(path: Path, seed: int, n: int) -> list[Scene]:
    """Windows of a recording in which nothing goes wrong as it is."""
    rng = np.random.default_rng((seed, zlib.crc32(path.name.encode())))
    t, xyz = clip(path)
    found: list[Scene] = []
    for _ in range(20 * n):
        made = scene(rng, t, xyz)
        if made is not None and run(made, reports(rng, made)).contradicted == 0:
            found.append(made)
        if len(found) == n:
            break
    return found


@pytest.fixture(scope="module")
def windows(real_data: Path, request: pytest.FixtureRequest, some: Some) -> dict[str, list[Scene]]:
    seed, scale = int(request.config.getoption("--seed")), float(request.config.getoption("--scale"))
    n = max(1, int(5 * scale))
    return {path.name: scenes(path, seed, n) for path in some(recordings(real_data), 3)}


@pytest.mark.real_data
def test_every_recording_gives_windows(windows: dict[str, list[Scene]]) -> None:
    assert all(windows.values()), [name for name, found in windows.items() if not found]


@pytest.mark.real_data
@pytest.mark.parametrize("name", FAULTS)
def test_no_place_is_lost(windows: dict[str, list[Scene]], rng: np.random.Generator, name: str) -> None:
    told = refused = looked = blocked = 0
    for recording, found in windows.items():
        for each in found:
            outcome = run(each, FAULTS[name](rng, each, reports(rng, each)))
            assert outcome.worst <= 1e-9, f"{recording} at {each.t[0]:.3f} s: {outcome}"
            told += outcome.contradicted > 0
            refused += outcome.refused > 0
            looked, blocked = looked + outcome.looked, blocked + outcome.blocked
    n = sum(map(len, windows.values()))
    assert blocked < 0.5 * looked and looked > 20 * n
    assert told > 0.9 * (n - 1) or name not in TELLING
    assert refused > 0.9 * (n - 1) or name not in REFUSED
    assert told + refused == 0 or name != "none"


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("frozen", {"believe_repeats": True}),
        ("frozen arm", {"believe_repeats": True}),
    ],
)
def test_without_the_rule_places_are_lost(
    windows: dict[str, list[Scene]], rng: np.random.Generator, name: str, changes: dict[str, object]
) -> None:
    worst = max(
        run(each, FAULTS[name](rng, each, reports(rng, each)), gate_settings(each, **changes)).worst
        for found in windows.values()
        for each in found
    )
    assert worst > 1e-3


def exactly(of: Scene, i: int, report: RawMeasurement) -> RawMeasurement:
    """The report number i without errors."""
    people = zip(report.people, of.truth[:, i], strict=True)
    return report._replace(people=tuple(person._replace(xyz=xyz) for person, xyz in people))


@pytest.mark.real_data
def test_a_hand_faster_than_the_profile_is_a_contradiction_and_not_refused(
    windows: dict[str, list[Scene]], rng: np.random.Generator
) -> None:
    """Half the speed of the window's fastest wrist, and errors too small to explain it."""
    tried = 0
    for recording, found in windows.items():
        for each in found:
            wrists = [6, 11]
            fastest = float(each.profile.speed[wrists].max())
            exact = [exactly(each, i, report) for i, report in enumerate(reports(rng, each))]
            slow = each.profile.limits.copy()
            slow["speed"][0, wrists] = 0.5 * fastest
            believed = replace(each, profile=replace(each.profile, limits=slow))
            settings = gate_settings(each, position_error_m=1e-6, believe_repeats=True)
            outcome = run(believed, exact, settings)
            tried += 1
            assert outcome.refused == 0 and outcome.contradicted > 0, recording
    assert tried == sum(map(len, windows.values())) > 0


def test_outcomes_start_with_nothing() -> None:
    assert Outcome().worst == -np.inf and Outcome().looked == 0
