"""Arm reach: set-up, plain cases, inclusion of random admissible arms, terms left out, the turning torso."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from occupancy.body import Part, Point, load_profile
from occupancy.humans.arm_reach import ArmReach, extensions
from occupancy.humans.options import ModelError
from occupancy.measurement import Gate
from occupancy.sets import MAX_PEOPLE, MAX_REACH_POINTS
from robots.assumption import Certainty
from robots.motion import MAX_SLICES, Block
from tests.occupancy.arm_scenes import buffer, parts, person, rows, slices, twin_rows
from tests.occupancy.arm_twin import Twin
from tests.occupancy.left_out import TERMS
from tests.occupancy.moving_arms import HALF_FOREARM, PATHS, POINTS, TUM, UPPER_ARM, Case, random_case, worst
from tests.occupancy.moving_people import unit
from tests.occupancy.people import ALL_POINTS, report, settings, standing

Array = np.ndarray
Count = Callable[[int], int]
ARM = {side: {Part[f"{side}_{name}"] for name in ("UPPER_ARM", "FOREARM", "HAND")} for side in "LR"}


# ------------------------------------------------------------------------------------------------- set-up


@pytest.mark.parametrize("face", ["sound", "as_published"])
def test_profile_without_limits_of_the_arm_is_refused(face: str) -> None:
    with pytest.raises(ModelError, match="no limits of the arm"):
        ArmReach(load_profile("iso"), face=face)


@pytest.mark.parametrize("held", [math.nan, math.inf, -0.1])
def test_held_object_must_have_a_length(held: float) -> None:
    with pytest.raises(ModelError, match="held_object_m"):
        ArmReach(TUM, held_object_m=held)


@pytest.mark.parametrize("index", [-1, 8])
def test_index_must_fit_into_a_row(index: int) -> None:
    with pytest.raises(ModelError, match="index"):
        ArmReach(TUM, index=index)


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
@pytest.mark.parametrize("limit", ["angular_speed", "angular_acceleration", "relative_speed", "elbow"])
def test_rates_whose_intervals_lack_0_are_refused(limit: str, value: float) -> None:
    """R2 and R3 contain what lies between only if rates may be 0."""
    with pytest.raises(ModelError, match=f"arm.{limit}"):
        ArmReach(replace(TUM, arm=replace(TUM.arm, **{limit: value})))


def test_face_must_be_known() -> None:
    with pytest.raises(ModelError, match="face"):
        ArmReach(TUM, face="other")


def test_names_parts_and_assumptions() -> None:
    sound, published = ArmReach(TUM), ArmReach(TUM, face="as_published", held_object_m=0.2)
    assert (sound.name, published.name) == ("arm_reach", "arm_reach_as_published")
    assert sound.proves == sum(1 << part for arm in ARM.values() for part in arm)
    assert sound.inferred_parts(ALL_POINTS) == sound.inferred_parts(0) == 0
    stated = [{a.name: a for a in model.assumptions()} for model in (sound, published)]
    assert [len(s) for s in stated] == [len(model.assumptions()) for model in (sound, published)]
    assert "people.tum.arm.angular_speed" in stated[0]
    assert stated[0]["people.held_object"].certainty is Certainty.DEFAULT
    assert stated[1]["people.held_object"].value == 0.2
    assert {n: a.value for n, a in stated[1].items() if "arm_reach" in n} == {
        "people.arm_reach.base_turning": 0.1,
        "people.arm_reach.base_speed": 2.0,
    }
    assert not any("arm_reach" in name for name in stated[0])


def test_extensions_are_those_of_all_arms(rng: np.random.Generator) -> None:
    for elbow in (0.3, 1.2, 1.6, 2.0, 2.618, 3.0, 4.0):
        low, high = extensions(TUM, elbow)
        a, b = np.meshgrid(np.linspace(*UPPER_ARM, 200), np.linspace(*HALF_FOREARM, 200))
        tried = [
            np.sqrt(a * a + b * b + 2 * a * b * np.cos(f)) for f in np.linspace(0, min(elbow, np.pi), 60)
        ]
        assert np.min(tried) >= low - 1e-12 and np.max(tried) <= high + 1e-12
        assert np.min(tried) <= low + 1e-5 and np.max(tried) >= high - 1e-12


# --------------------------------------------------------------------------------------------- plain cases


def test_arm_seen_as_a_whole_has_two_rows() -> None:
    """T to the end of the slice; half of 0.146 of 1.90 m, flesh, e_S, 2 m/s; angle by 4.46 m/s over r."""
    people = person(e_p=0.004)
    people["clock_error"], people["stamp_error"] = 0.001, 0.002
    found = rows(ArmReach(TUM, held_object_m=0.3), people, slices(np.array([0.0, 0.02]), (0.004, 0.007)))
    assert [covers for _, _, covers in found] == [
        sum(1 << p for p in group)
        for side in "LR"
        for group in ((Part[f"{side}_UPPER_ARM"], Part[f"{side}_FOREARM"]), (Part[f"{side}_HAND"],))
    ]
    growth = 0.5 * 0.146 * 1.9 + 0.004 + 2.0 * 0.028
    for (points, radius, _), body in zip(found, (0.1, 0.505, 0.1, 0.505), strict=True):
        assert radius == pytest.approx(growth + body)
        assert len(points) == 21
    [left, right] = (found[j][0] for j in (0, 2))
    np.testing.assert_array_equal(left[0], standing()[Point.L_SHOULDER])
    np.testing.assert_array_equal(right[0], standing()[Point.R_SHOULDER])
    d = 0.5 * (standing()[Point.L_ELBOW] + standing()[Point.L_WRIST]) - standing()[Point.L_SHOULDER]
    r = float(np.linalg.norm(d))
    most, angle = r + 0.008 + 2.46 * 0.028, math.asin((0.008 + 4.46 * 0.028) / r)
    assert most < (0.196 + 0.5 * 0.146) * 1.9, "an arm is longer than that"
    edge = left[11:] - left[0]
    np.testing.assert_allclose(edge @ d / r, most * math.cos(angle))
    lateral = np.linalg.norm(edge - np.outer(edge @ d, d) / r**2, axis=1)
    np.testing.assert_allclose(lateral, most * math.sin(angle) / math.cos(math.pi / 10))


@pytest.mark.parametrize("face", ["sound", "as_published"])
@pytest.mark.parametrize("lost", ["SHOULDER", "ELBOW", "WRIST"])
@pytest.mark.parametrize("side", ["L", "R"])
@pytest.mark.parametrize("how", ["missing", "older", "newer"])
def test_arm_of_which_a_point_is_missing_or_of_another_age_is_not_covered(
    face: str, lost: str, side: str, how: str
) -> None:
    people = person()
    p = Point[f"{side}_{lost}"]
    if how == "missing":
        people["present"][0, 0] &= ~np.uint32(1 << p)
    else:
        people["t_obs"][0, 0, p] += 0.01 if how == "newer" else -0.01
    found = parts(rows(ArmReach(TUM, face=face), people, slices(np.array([0.1, 0.2]))))
    assert not found & {part.name.lower() for part in ARM[side]}
    other = {part.name.lower() for part in ARM["R" if side == "L" else "L"]}
    assert found == (other if face == "sound" or lost != "SHOULDER" else set())


def test_published_face_needs_a_torso_seen_with_the_arm() -> None:
    model, plan = ArmReach(TUM, face="as_published"), slices(np.array([0.1, 0.2]))
    for lost, there in (
        ((Point.PELVIS,), True),
        ((Point.THORAX,), True),
        ((Point.NECK_BASE,), True),
        ((Point.PELVIS, Point.THORAX), False),
        ((Point.NECK_BASE, Point.THORAX), False),
        ((Point.PELVIS, Point.NECK_BASE), False),
    ):
        for how in ("missing", "older"):
            people = person()
            for p in lost:
                if how == "missing":
                    people["present"][0, 0] &= ~np.uint32(1 << p)
                else:
                    people["t_obs"][0, 0, p] -= 0.01
            assert len(rows(model, people, plan)) == (4 if there else 0)


def test_measurement_that_contradicts_the_limits_gives_no_row() -> None:
    """An extended arm longer than the longest, and an elbow bent too far."""
    plan = slices(np.array([0.0, 0.01]))
    for stretch, there in ((1.0, True), (0.3, False), (2.5, False)):
        xyz = standing()
        for side in "LR":
            s, *others = POINTS[side]
            for p in others:
                xyz[p] = xyz[s] + stretch * (xyz[p] - xyz[s])
        for face in ("sound", "as_published"):
            assert len(rows(ArmReach(TUM, face=face), person(xyz), plan)) == (4 if there else 0)


def test_readings_of_the_gate_give_rows() -> None:
    gate = Gate(TUM, settings())
    for stamp in (0.0, 0.02):
        gate.admit(report(stamp, ("a", standing())), stamp)
    assert np.isfinite(gate.people["e_v"][0, 0, Point.L_WRIST])
    for face in ("sound", "as_published"):
        found = rows(ArmReach(TUM, face=face), gate.people, slices(np.array([0.03, 0.05])))
        assert parts(found) == {part.name.lower() for arm in ARM.values() for part in arm}


def test_most_rows_fit_into_the_block() -> None:
    people = person()
    people["n"] = MAX_PEOPLE
    people["present"], people["xyz"] = ALL_POINTS, standing()
    out = buffer()
    out.view(np.uint8)[:] = 255
    ArmReach(TUM, index=5).occupy(people, slices(np.linspace(0.0, 1.0, MAX_SLICES + 1)), out)
    assert out["n"] == MAX_SLICES * MAX_PEOPLE * 4 == len(out["radius"][0])
    np.testing.assert_array_equal(np.diff(out["first"][0]), MAX_PEOPLE * 4)
    np.testing.assert_array_equal(out["slice"][0], np.repeat(np.arange(MAX_SLICES), MAX_PEOPLE * 4))
    np.testing.assert_array_equal(out["owner"][0], np.tile(np.repeat(np.arange(MAX_PEOPLE), 4), MAX_SLICES))
    assert (out["model"][0] == 5).all() and (out["speed_max"][0] == 2.46).all()
    assert out["n_points"][0].max() <= MAX_REACH_POINTS


# ----------------------------------------------------------------------------------------------- inclusion


@pytest.mark.parametrize("aligned", [False, True])
@pytest.mark.parametrize("kind", PATHS)
def test_random_admissible_arms_stay_inside(
    rng: np.random.Generator, count: Count, kind: str, aligned: bool
) -> None:
    """With limits that each motion just keeps; a million motions are in test_inclusion."""
    nearest, made, cones = -math.inf, 0, 0
    wanted = max(30, count(2_000))
    for _ in range(20 * wanted):
        case = random_case(rng, kind, aligned=aligned)
        if case is None:
            continue
        found = rows(ArmReach(case.profile), case.people, case.plan)
        assert len(found) == 2
        excess = worst(case, found, rng, 3)
        assert excess <= 1e-9
        nearest, made, cones = max(nearest, excess), made + 1, cones + (len(found[0][0]) > 1)
        if made == wanted:
            break
    assert made == wanted and cones > 0.3 * made
    if aligned:
        assert nearest > -0.01, "nothing came near the boundary: the test shows nothing"


KINDS = {
    "e_p": ("radial", "circle"),
    "e_v": ("bang",),
    "acceleration": ("bang",),
    "corners": ("circle", "line"),
    "ik": ("circle",),
    "turn": ("circle",),
    "speed": ("line",),
}
"""Motions that use up a term of the twin; others: radial ones."""


@pytest.mark.parametrize("name", [name for name, left in TERMS["arm_reach"].items() if left.twin])
def test_every_term_is_needed(rng: np.random.Generator, name: str) -> None:
    term = TERMS["arm_reach"][name].twin
    kinds = KINDS.get(term, ("radial",))
    out, tried = -math.inf, 0
    while out <= 1e-3 and tried < 4_000:
        tried += 1
        case = random_case(rng, str(rng.choice(kinds)), aligned=True)
        if case is None:
            continue
        found = rows(ArmReach(case.profile), case.people, case.plan)
        side = 0 if case.side == "L" else 1
        ablated = Twin(case.profile, case.people[0], case.plan[0], 0, side, float, frozenset({term}))
        out = max(out, worst(case, twin_rows(ablated, found), rng, 2))
    assert out > 1e-3


@pytest.mark.parametrize(
    ("limit", "kind"),
    [
        ("relative_speed", "line"),
        ("relative_acceleration", "bang"),
        ("angular_speed", "circle"),
        ("extension_speed", "radial"),
    ],
)
def test_arm_that_exceeds_a_limit_gets_out(rng: np.random.Generator, limit: str, kind: str) -> None:
    """The rows obey half of what the arm does."""
    out, tried = -math.inf, 0
    while out <= 1e-3 and tried < 4_000:
        tried += 1
        case = random_case(rng, kind, aligned=True)
        if case is not None:
            arm = replace(case.profile.arm, **{limit: 0.5 * getattr(case.profile.arm, limit)})
            found = rows(ArmReach(replace(case.profile, arm=arm)), case.people, case.plan)
            out = max(out, worst(case, found, rng, 2)) if found else out
    assert out > 1e-3


def turning_case(rng: np.random.Generator) -> tuple[Block, Case]:
    """An arm held still on a torso that turns as fast as the profile lets torso, shoulder and arm."""
    xyz, axis = standing(), unit(rng, 1)[0]
    s, e, w = POINTS["L"]
    lever = xyz[s] - xyz[Point.THORAX]
    middle = rng.uniform(0.3, 0.45)
    d = middle * unit(rng, 1)[0]
    limb_wrist = HALF_FOREARM[0] * d / middle
    xyz[e], xyz[w] = xyz[s] + d - limb_wrist, xyz[s] + d + limb_wrist
    moved = float(np.linalg.norm(np.cross(axis, lever)))
    rate = min(TUM.arm.torso_rate, TUM.arm.angular_speed, 4.46 / middle, 2.0 / max(moved, 1e-3))
    people = person(xyz, e_p=0.002)
    plan = slices(np.array([0.0, float(rng.uniform(0.05, 0.3))]))

    def turned(v: Array, t: float) -> Array:
        c, sn = math.cos(rate * t), math.sin(rate * t)
        return c * v + sn * np.cross(axis, v) + (1 - c) * (axis @ v) * axis

    class Turning(Case):
        def arm(self, t: float, wish: Array) -> tuple[Array, Array, Array]:
            s_now = xyz[Point.THORAX] + turned(lever, t)
            d_now, w_now = turned(d, t), turned(limb_wrist, t)
            return s_now, s_now + d_now - w_now, s_now + d_now + w_now

    case = Turning(TUM, people, plan, "L", None, None, 0.0, xyz[s], axis, 0.0)
    return people, case


def test_turning_torso_leaves_the_published_set_and_not_the_sound_one(
    rng: np.random.Generator, count: Count
) -> None:
    sound, published = ArmReach(TUM), ArmReach(TUM, face="as_published")
    left = 0
    for _ in range(count(20_000)):
        people, case = turning_case(rng)
        left_arm = sum(1 << part for part in ARM["L"])
        found, as_published = (
            [row for row in rows(model, people, case.plan) if row[2] & left_arm]
            for model in (sound, published)
        )
        assert len(found) == 2
        assert worst(case, found, rng, 0) <= 1e-9
        if as_published:
            left += worst(case, as_published, rng, 0) > 0.01
    assert left > 0
