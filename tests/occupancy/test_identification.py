"""Limits from recordings: known motions, plain searches, and that what is identified misses nothing."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import Point, load_profile, profile_names
from occupancy.conformance_kernels import greatest_acceleration
from occupancy.identification import IdentificationError, identify
from occupancy.recorded import Recorded, read_people
from robots.assumption import Assumption, Certainty
from tests.conftest import Some
from tests.occupancy.people import only, report, standing

Array = np.ndarray
PROFILES = [load_profile(name) for name in profile_names()]
EXTREME = load_profile("extreme")
E_P = 0.001


def recorded(t: Array, xyz: Array) -> Recorded:
    reports = [report(float(stamp), ("a", points)) for stamp, points in zip(t, xyz, strict=True)]
    return read_people(reports, PROFILES, E_P, believe_repeats=True)


def numbers(t: Array, xyz: Array, margin: float = 1.0) -> dict[str, Assumption]:
    found = identify([("clip", recorded(t, xyz))], EXTREME, "new", margin)
    return {each.name.removeprefix("people.new."): each for each in found}


def still(samples: int = 200, step: float = 0.005) -> tuple[Array, Array]:
    return step * np.arange(samples), np.repeat(standing()[None], samples, axis=0)


def about(axis: str, angle: Array) -> Array:
    """Rotations (T, 3, 3) about an axis of the world."""
    cos, sin, one, nil = np.cos(angle), np.sin(angle), np.ones_like(angle), np.zeros_like(angle)
    rows = {
        "y": [[cos, nil, sin], [nil, one, nil], [-sin, nil, cos]],
        "z": [[cos, -sin, nil], [sin, cos, nil], [nil, nil, one]],
    }[axis]
    return np.moveaxis(np.array(rows), -1, 0)


def swung(xyz: Array, turn: Array, centre: Point, *points: Point) -> Array:
    """The same motion with some points turned about one of them."""
    moved = xyz.copy()
    for point in points:
        arm = xyz[:, point] - xyz[:, centre]
        moved[:, point] = xyz[:, centre] + np.einsum("tij,tj->ti", turn, arm)
    return moved


# ------------------------------------------------------------------------------------------ known motions


def test_speed_and_acceleration_of_a_sine() -> None:
    """0.1 m at 2 Hz: 1.26 m/s and 15.8 m/s², of which errors of 1 mm explain a little."""
    t, xyz = still(400)
    omega = 4.0 * math.pi
    xyz[:, Point.HEAD, 0] += 0.1 * np.sin(omega * t)
    found = numbers(t, xyz)
    assert found["speed.head"].value == pytest.approx(0.1 * omega, rel=1e-2)
    assert 0.75 < found["acceleration.head"].value / (0.1 * omega**2) < 1.0
    assert numbers(t, xyz, 1.5)["speed.head"].value == pytest.approx(1.5 * 0.1 * omega, rel=1e-2)


def test_an_arm_that_swings_forward_and_back() -> None:
    t, xyz = still(400)
    angle = -(0.4 + 0.9 * np.sin(2.0 * math.pi * t))
    arm = (Point.R_ELBOW, Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP)
    moved = swung(xyz, about("y", angle), Point.R_SHOULDER, *arm)
    found = numbers(t, moved)
    ahead, behind = found["arm.flexion"].value, found["arm.extension"].value
    # left is +y and down is -z, so forward = down x left is +x
    assert moved[np.argmin(angle), Point.R_WRIST, 0] > xyz[0, Point.R_WRIST, 0]
    assert (ahead, behind) == (pytest.approx(1.3, abs=0.02), pytest.approx(0.5, abs=0.02))
    assert found["arm.angular_speed"].value == pytest.approx(0.9 * 2.0 * math.pi, rel=0.02)
    r = np.linalg.norm(
        0.5 * (standing()[Point.R_ELBOW] + standing()[Point.R_WRIST]) - standing()[Point.R_SHOULDER]
    )
    assert found["arm.relative_speed"].value == pytest.approx(0.9 * 2.0 * math.pi * r, rel=0.02)
    assert found["arm.extension_speed"].certainty is Certainty.ASSUMED, "the arm never changed its length"


def test_a_torso_that_turns_carries_the_arms_along() -> None:
    t, xyz = still(400)
    moved = swung(xyz, about("z", 0.5 * np.sin(4.0 * t)), Point.PELVIS, *Point)
    found = numbers(t, moved)
    assert found["arm.torso_rate"].value == pytest.approx(2.0, rel=1e-2)
    assert found["arm.flexion"].certainty is Certainty.ASSUMED, (
        "in the frame of the torso the arm hangs still"
    )


def test_what_was_not_seen_stays_as_it_is_and_says_so() -> None:
    t, xyz = still()
    xyz[:, Point.L_WRIST, 0] += 0.05 * np.sin(9.0 * t)
    shown = np.array([only(points, Point.L_WRIST, Point.L_ELBOW, Point.L_SHOULDER) for points in xyz])
    found = numbers(t, shown)
    assert found["speed.l_wrist"].certainty is Certainty.MEASURED
    assert (
        "200 readings of clip" in found["speed.l_wrist"].source
        and "margin 1" in found["speed.l_wrist"].source
    )
    for place in ("speed.r_wrist", "acceleration.every_point", "arm.torso_rate", "radius.hand"):
        assert found[place].value == {a.name: a.value for a in EXTREME.assumptions}[f"people.extreme.{place}"]
        assert found[place].source.startswith("not in the recordings; ")
    assert "speed.thorax" not in found, "every_point stands for it"


def test_limbs_are_widened_by_those_that_are_longer_or_shorter() -> None:
    t, xyz = still()
    xyz[:, [Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP], 2] -= 0.1  # forearm 0.35 m: 0.184 of 1.9 m
    found = numbers(t, xyz)
    length = float(np.linalg.norm(xyz[0, Point.L_WRIST] - xyz[0, Point.L_ELBOW]))
    assert found["limb.forearm.longest"].value == pytest.approx(length / 1.9, rel=1e-5)
    assert found["limb.forearm.longest"].value >= length / 1.9
    assert found["limb.upper_arm.longest"].certainty is not Certainty.MEASURED


def test_marked_samples_do_not_count() -> None:
    t, xyz = still()
    xyz[100, Point.HEAD, 0] += 0.25  # 50 m/s
    found = numbers(t, xyz)
    assert found["speed.head"].value == 6.0 and found["speed.head"].certainty is Certainty.ASSUMED


@pytest.mark.parametrize("margin", [0.9, math.nan, math.inf])
def test_margins_refuse(margin: float) -> None:
    with pytest.raises(IdentificationError, match="margin"):
        numbers(*still(), margin=margin)


def test_a_single_sample_shows_no_motion() -> None:
    with pytest.raises(IdentificationError, match="nothing to identify"):
        numbers(np.zeros(1), standing()[None])


# ------------------------------------------------------------------------------------------ plain searches


def test_greatest_acceleration_equals_a_plain_search(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(3_000)):
        n, depth, longest = int(rng.integers(0, 14)), int(rng.integers(1, 5)), float(rng.uniform(0.05, 0.3))
        t = np.cumsum(rng.uniform(0.005, 0.05, n))
        x, e = rng.normal(scale=0.1, size=(n, 3)), rng.uniform(0.0, 0.05, n)
        marked = rng.random(n) < 0.1
        marks = np.concatenate(([0], np.cumsum(marked))).astype(np.int64)
        expected = 0.0
        for k in range(n):
            for j in range(max(0, k - depth), k):
                for m in range(k + 1, n):
                    tau, after = t[k] - t[j], t[m] - t[k]
                    if after > longest or marked[j : m + 1].any():
                        continue
                    off = np.linalg.norm(x[m] - x[k] - (x[k] - x[j]) * after / tau)
                    over = off - e[m] - e[k] - (e[j] + e[k]) * after / tau
                    expected = max(expected, float(over / (0.5 * after * (tau + after))))
        found, _where = greatest_acceleration(t, x, e, marks, depth, longest)
        assert found == pytest.approx(expected, rel=1e-9)


def test_admissible_motion_shows_no_more_than_its_acceleration(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Bang-bang with errors at their bound: never above a, and close to it without errors."""
    closest = 0.0
    for trial in range(count(2_000)):
        a, e = 30.0, 0.004 * (trial % 2)
        fine = 1e-3 * np.arange(400)
        switches = np.repeat(rng.choice([-1.0, 1.0], 20), 20)
        v = np.concatenate(([0.0], np.cumsum(1e-3 * a * switches)))[:-1]
        x = np.cumsum(1e-3 * v) + 0.5 * 1e-6 * a * np.cumsum(switches)
        x = np.concatenate(([0.0], x))[:-1]
        t, seen = fine[::8], x[::8, None] * (1.0, 0.0, 0.0)
        noise = rng.normal(size=seen.shape)
        seen = seen + e * noise / np.linalg.norm(noise, axis=1, keepdims=True)
        marks = np.zeros(len(t) + 1, np.int64)
        found, _ = greatest_acceleration(t, seen, np.full(len(t), e), marks, 16, 0.6)
        assert found <= a * (1.0 + 1e-6)
        closest = max(closest, found / a)
    assert closest > 0.99


@pytest.mark.real_data
def test_the_bundled_ranges_of_the_arm_hold_on_clean_clips(real_data: Path, some: Some) -> None:
    """And, looking at all of them, not with much to spare where they were widened for them."""
    from tests.occupancy.people import clip, clips

    seen: dict[str, float] = {}
    paths = list(clips(real_data / "human", lambda name: not name.startswith("cmu") or "glitch" in name))
    chosen = some(paths, 4)
    for path in chosen:
        for place, each in numbers(*clip(path)).items():
            if each.certainty is Certainty.MEASURED and each.unit == "rad":
                seen[place] = max(seen.get(place, 0.0), float(each.value))
    for name in ("tum", "extreme"):
        arm = load_profile(name).arm
        assert arm is not None
        for place, value in seen.items():
            assert value <= getattr(arm, place.removeprefix("arm.")), f"{name} {place}"
        assert len(chosen) < len(paths) or seen["arm.flexion"] > arm.flexion - 0.1
