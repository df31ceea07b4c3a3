"""Kernels of arm reach on the very bounds that they state, and later arms against a plain twin."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from occupancy.body import Part, Point
from occupancy.humans import arm_joint_kernels, arm_kernels
from occupancy.humans.arm_reach import ArmReach
from robots.motion import Block
from tests.occupancy.arm_scenes import Row, buffer, person, rows, slices
from tests.occupancy.arm_twin import Twin
from tests.occupancy.moving_arms import POINTS, TUM
from tests.occupancy.people import standing
from tests.occupancy.test_arm_reach_laws import random_person

Array = NDArray[np.float64]
Count = Callable[[int], int]
FACES = ("sound", "as_published")
LARGEST_M, SMALLEST_M = 1e6, 1e-6
"""From where on a number is not usable, and up to where a length gives no direction [m]."""
AT_ONCE = np.zeros(2)
LEFT = POINTS["L"]


def below(x: float) -> float:
    return math.nextafter(x, 0.0)


def above(x: float) -> float:
    return math.nextafter(x, math.inf)


def at_once(model: ArmReach, people: Block) -> list[Row]:
    """Rows on a slice without length at 0 s; the block was full of something else."""
    buffer().view(np.uint8)[:] = 255
    found = rows(model, people, slices(AT_ONCE))
    assert (buffer()["first"][0, 1:] == len(found)).all() and buffer()["n"] == len(found)
    return found


def straight(offset: Array, side: str = "L") -> Array:
    """A standing person; the middle of a forearm is ``offset`` [m] from the shoulder."""
    xyz = standing()
    s, e, w = POINTS[side]
    xyz[e] = xyz[w] = xyz[s] + offset
    return xyz


def read(people: Block, side: int = 0) -> np.void:
    """An arm as the kernels know it."""
    arm = np.zeros(1, arm_kernels.ARM)[0]
    arm_kernels.read_arm(people[0], 0, ArmReach(TUM)._table[0]["point"][side], arm)
    return arm


def free(**changes: object) -> np.void:
    """Limits that allow everything but what is given."""
    table = ArmReach(TUM)._table.copy()
    free = {"extension": (0.0, 10.0), "speed": 100.0, "angular_speed": 100.0, "extension_speed": 100.0}
    for name, value in (free | {"acceleration": 100.0} | changes).items():
        table[name] = value
    return table[0]


# ------------------------------------------------------------------------------------------------ no length


@pytest.mark.parametrize("e_v", [0.0, math.inf])
@pytest.mark.parametrize("face", FACES)
def test_an_arm_without_error_at_the_instant_of_seeing_is_where_it_was_seen(face: str, e_v: float) -> None:
    """Every interval is a single number, which is no contradiction; radii are those of the body alone."""
    model, xyz = ArmReach(TUM, face=face, held_object_m=0.1), standing()
    found = at_once(model, person(xyz, e_p=0.0, e_v=e_v))
    assert len(found) == 4
    for side, (s, e, w) in enumerate(POINTS.values()):
        for points, radius, _ in found[2 * side : 2 * side + 2]:
            np.testing.assert_array_equal(points[0], xyz[s])
            np.testing.assert_allclose(points[1:], np.tile(0.5 * (xyz[e] + xyz[w]), (len(points) - 1, 1)))
            assert radius in model._table["radius"][0]


@pytest.mark.parametrize("face", FACES)
def test_only_the_time_since_an_arm_was_seen_counts(face: str, rng: np.random.Generator) -> None:
    """Everything two seconds earlier or later: the same rows; a power of two, so that times stay exact."""
    model = ArmReach(TUM, face=face, index=5)
    for later in (2.0, -2.0):
        people, plan = (
            random_person(rng, velocity=True),
            slices(np.array([-0.125, 0.0, 0.0625]), (0.0, 0.03125)),
        )
        people["clock_error"], people["stamp_error"] = 0.0078125, 0.00390625
        for i in range(2):
            now = rows(model, people, plan, i)
            moved, then = people.copy(), slices(plan["t"][0, :3] + later, (0.0, 0.03125))
            moved["t_obs"] += later
            for one, two in zip(now, rows(model, moved, then, i), strict=True):
                np.testing.assert_array_equal(one[0], two[0])
                assert one[1:] == two[1:]
            n = int(buffer()["n"][0])
            assert (buffer()["model"][0, :n] == 5).all() and (buffer()["speed_max"][0, :n] == 2.46).all()


# -------------------------------------------------------------------------------------------- largest numbers


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("point", LEFT)
@pytest.mark.parametrize("field", ["e_p", "xyz", "v"])
def test_numbers_of_an_arm_are_usable_below_a_thousand_kilometres(
    field: str, point: Point, sign: float
) -> None:
    for value, usable in ((below(LARGEST_M), True), (LARGEST_M, False)):
        for axis in range(1 if field == "e_p" else 3):
            people = person(e_p=0.0)
            if field == "e_p":
                people["e_p"][0, 0, point] = value
            else:
                people[field][0, 0, point, axis] = sign * value
            arm = read(people)
            assert (arm["e_p"] >= 0.0) == usable


@pytest.mark.parametrize("held", [0.0, 0.5])
@pytest.mark.parametrize("face", FACES)
def test_both_radii_are_below_a_thousand_kilometres_or_there_is_no_row(face: str, held: float) -> None:
    """They grow as the error of the shoulder does, from where the whole ball is taken on."""
    model, people = ArmReach(TUM, face=face, held_object_m=held), person(e_p=0.0)

    def found(e_p: float) -> list[Row]:
        people["e_p"][0, 0, LEFT[0]] = e_p
        return [row for row in at_once(model, people) if not row[2] >> Part.R_UPPER_ARM]

    largest, first = LARGEST_M - 10.0, LARGEST_M
    while largest < 0.5 * (largest + first) < first:
        middle = 0.5 * (largest + first)
        largest, first = (middle, first) if found(middle) else (largest, middle)
    assert first == above(largest) and not found(first)
    assert LARGEST_M - 1e-9 < max(radius for _, radius, _ in found(largest)) < LARGEST_M


def test_an_arm_that_was_seen_too_long_ago_has_no_row() -> None:
    """A shoulder that hardly moves, so that nothing else becomes too large; before the slice and after it."""
    table = ArmReach(TUM)._table.copy()
    table["shoulder_speed"], out = 0.1, buffer()
    for ends, usable in (
        ((0.0, below(LARGEST_M)), True), ((0.0, LARGEST_M), False),
        ((-below(LARGEST_M), 0.0), True), ((-LARGEST_M, 0.0), False),
    ):  # fmt: skip
        arm_kernels.occupy_arms(person(e_p=0.0), slices(np.array(ends)), table, False, out)
        assert out["n"] == (4 if usable else 0)


@pytest.mark.parametrize("point", [Point.PELVIS, Point.NECK_BASE, Point.R_SHOULDER])
def test_a_torso_is_made_of_points_within_a_thousand_kilometres(point: Point) -> None:
    """One point of it is far in front: the axis points there, or another pair of points gives it."""
    for value, usable in ((below(LARGEST_M), True), (LARGEST_M, False)):
        for sign in (1.0, -1.0):
            xyz = standing()
            xyz[point, 0] = sign * value
            found = joints(person(xyz))
            if point is Point.R_SHOULDER:
                assert found["usable"] == usable
                continue
            assert found["usable"] == 1
            ahead = sign if point is Point.PELVIS else -sign
            along = [ahead, 0.0, 0.0] if usable else [0.0, 0.0, -1.0]
            np.testing.assert_allclose(found["frame"][0], along, atol=1e-5)


def joints(people: Block, side: int = 0) -> np.void:
    """Joint values as the published face reads them."""
    out = np.zeros(1, arm_joint_kernels.JOINTS)[0]
    out["usable"] = 7
    table = ArmReach(TUM, face="as_published")._table[0]
    arm_joint_kernels.read_joints(people[0], 0, side, read(people, side), table, out)
    return out


# ------------------------------------------------------------------------------------------------------ torso


@pytest.mark.parametrize("how", ["in one place", "across"])
def test_a_pair_of_points_that_gives_no_axis_gives_way_to_the_next(how: str) -> None:
    """Pelvis and neck in one place, or side by side as the shoulders are; the thorax is where it was."""
    xyz = standing()
    xyz[Point.NECK_BASE] = xyz[Point.PELVIS] + [0.0, 0.0 if how == "in one place" else 0.3, 0.0]
    for side in range(2):
        found = joints(person(xyz), side)
        assert found["usable"] == 1
        np.testing.assert_allclose(found["frame"][0], [0.0, 0.0, -1.0], atol=1e-9)


def test_a_torso_is_upright_and_looks_ahead() -> None:
    for side, outward in ((0, 1.0), (1, -1.0)):
        found = joints(person(e_v=0.1), side)
        assert (found["usable"], found["with_rates"]) == (1, 1)
        np.testing.assert_allclose(found["frame"], [[0, 0, -1], [1, 0, 0], [0, outward, 0]], atol=1e-12)
        assert joints(person(), side)["with_rates"] == 0


@pytest.mark.parametrize("width", [0.0, 0.5 * SMALLEST_M, SMALLEST_M, above(SMALLEST_M), 2.0 * SMALLEST_M])
@pytest.mark.parametrize("what", ["shoulders", "trunk", "arm"])
def test_what_has_no_length_gives_no_direction(what: str, width: float) -> None:
    """One end is at 0, so that the length is exact."""
    xyz = standing()
    if what == "shoulders":
        xyz[[Point.L_SHOULDER, Point.R_SHOULDER], 1] = width, 0.0
    elif what == "trunk":
        xyz[[Point.PELVIS, Point.THORAX]] = 0.0
        xyz[Point.NECK_BASE] = 0.0, 0.0, width
    else:
        xyz[list(LEFT)] = 0.0
        xyz[list(LEFT[1:]), 2] = -width
    assert joints(person(xyz))["usable"] == (width > SMALLEST_M)


# ----------------------------------------------------------------------------------------------------- angles


@pytest.mark.parametrize("r", [1e-3, 0.3, 1.0])
def test_a_ball_around_its_apex_is_seen_in_every_direction(r: float) -> None:
    """From where its radius is the distance on; before that, in less than a half-space."""
    for radius, angle in ((below(r), 0.5 * math.pi), (r, math.pi), (above(r), math.pi), (math.nan, math.pi)):
        assert arm_joint_kernels.seen_angle(radius, r) == pytest.approx(angle, abs=1e-7)
        half = arm_kernels.tangent_of_sum(arm_kernels.seen_half(radius, r), (1.0, 0.0))
        assert 2.0 * math.atan(half) == pytest.approx(angle, abs=1e-7)
    assert arm_joint_kernels.seen_angle(0.0, 0.0) == math.pi
    assert arm_kernels.tangent_of_sum(arm_kernels.seen_half(0.0, 0.0), (1.0, 0.0)) == math.inf


def test_an_arm_that_comes_to_its_shoulder_may_point_anywhere() -> None:
    """Exactly there at the end of the time, where it has no direction."""
    d = np.array([0.5, -0.25, 0.125])
    people = person(straight(d), e_p=0.0, e_v=0.0)
    people["xyz"][0, 0, LEFT[0]] = 0.0
    people["xyz"][0, 0, list(LEFT[1:])], people["v"][0, 0, list(LEFT[1:])] = d, -4.0 * d
    arm = read(people)
    for span in ((0.0, 0.25), (0.25, 0.25)):
        _, half = arm_kernels.reach_cone(arm, span, free(acceleration=0.0))
        assert half == math.inf


@pytest.mark.parametrize("blur", [(1.0, 0.0), (1.0, 0.1), (1.0, 1.0), (0.1, 1.0)])
def test_an_arm_that_may_have_turned_by_more_than_half_a_turn_may_point_anywhere(
    blur: tuple[float, float],
) -> None:
    arm = read(person(straight(np.array([0.3, 0.1, 0.2])), e_p=0.0))
    arm["blur"] = blur
    for turned in np.linspace(math.pi + 1e-6, 40.0, 1000):
        _, half = arm_kernels.reach_cone(arm, (0.0, 1.0), free(angular_speed=turned))
        assert half == math.inf


@pytest.mark.parametrize("limits", [(-1.0, 3.9), (-3.9, 1.0), (-0.5, 0.5), (-3.1, 3.1)])
def test_the_first_angle_is_the_one_nearest_to_the_middle_of_its_limits(
    limits: tuple[float, float], rng: np.random.Generator
) -> None:
    """Of all that differ by whole turns; its direction is that of the arm."""
    table, middle = ArmReach(TUM, face="as_published")._table[0].copy(), 0.5 * sum(limits)
    table["low"][0], table["high"][0] = limits
    for angle in rng.uniform(-math.pi, math.pi, 50):
        people = person(straight(0.4 * np.array([math.sin(angle), 0.3, -math.cos(angle)])), e_p=0.0)
        out = np.zeros(1, arm_joint_kernels.JOINTS)[0]
        arm_joint_kernels.read_joints(people[0], 0, 0, read(people), table, out)
        assert abs(out["q"][0] - middle) <= math.pi
        assert math.remainder(out["q"][0] - angle, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("tangent", "points"),
    [
        (arm_kernels.TOUCH, 21),
        (above(arm_kernels.TOUCH), 31),
        (arm_kernels.WIDEST_CONE, 31),
        (above(arm_kernels.WIDEST_CONE), 1),
    ],
)
def test_form_changes_beyond_thirty_and_beyond_sixty_degrees(tangent: float, points: int) -> None:
    arm = read(person(straight(np.array([0.3, 0.1, 0.2])), e_p=0.0))
    arm["blur"] = 1.0, tangent
    limits, row = free(angular_speed=0.0), np.zeros(96)
    most, half = arm_kernels.reach_cone(arm, (0.0, 1.0), limits)
    assert half == tangent and most == 10.0
    count, growth = arm_kernels.sound_hull(arm, (0.0, 1.0), limits, row)
    assert count == points and growth == (arm_kernels.WHOLE_BALL * most if points == 1 else 0.0)


@pytest.mark.parametrize(("far", "points"), [(0.0, 1), (SMALLEST_M, 1), (above(SMALLEST_M), 21), (0.3, 21)])
def test_an_arm_without_length_has_no_direction(far: float, points: int) -> None:
    """Which does not move, and is known without an error: a ball, or a cone that is a line."""
    people = person(e_p=0.0)
    people["xyz"][0, 0, list(LEFT)] = 0.0
    people["xyz"][0, 0, list(LEFT[1:]), 0] = far
    row, still = np.full(96, np.nan), free(speed=0.0, angular_speed=0.0)
    count, growth = arm_kernels.sound_hull(read(people), (0.0, 1.0), still, row)
    assert count == points and growth == (arm_kernels.WHOLE_BALL * far if points == 1 else 0.0)
    corners = row[3 : 3 * count].reshape(-1, 3)
    np.testing.assert_allclose(corners, np.tile([far, 0.0, 0.0], (count - 1, 1)), atol=1e-12)


# ---------------------------------------------------------------------------------------------- later samples


@dataclass(frozen=True)
class Later(Twin):
    """A twin that is asked for times since the arm was seen."""

    instants: tuple[float, float] = (0.0, 0.0)

    def span(self, i: int) -> tuple[float, float]:
        return self.instants


def excess(people: Block, side: int, t: float, xyz: Array, e_p: Array) -> float:
    """How far [m] a later arm lies outside of its sector; NaN: nothing is claimed."""
    record, points = people[0], POINTS["LR"[side]]
    usable = all(int(record["present"][0]) >> p & 1 for p in points)
    if not usable or len({float(record["t_obs"][0, p]) for p in points}) > 1:
        return math.nan
    slack = 2.0 * float(record["stamp_error"] + record["clock_error"])
    elapsed = t - float(record["stamp_error"] + record["t_obs"][0, points[0]])
    twin = Later(TUM, record, record, 0, side, float, instants=(elapsed - slack, elapsed + slack))
    cone = twin.cone(0)
    if cone is None:
        return math.nan
    s, e, w = points
    offset, before = 0.5 * (xyz[e] + xyz[w]) - xyz[s], np.array(twin.offset("xyz"))
    far = float(np.linalg.norm(offset))
    turned = math.atan2(float(np.linalg.norm(np.cross(before, offset))), float(before @ offset))
    beyond = min(max(turned - cone[1], 0.0), 0.5 * math.pi)
    error = e_p[s] + 0.5 * (e_p[e] + e_p[w])
    return float(max(far - cone[0], far * math.sin(beyond)) - error - 1e-9)


def test_the_first_arm_outside_is_that_of_a_plain_twin(rng: np.random.Generator, count: Count) -> None:
    """Points missing, before and after; arms of which some points are older."""
    found, none, sides = 0, 0, set()
    for _ in range(max(200, count(20_000))):
        people = random_person(rng)
        record = people[0]
        if rng.random() < 0.2:
            record["present"][0] &= ~np.uint32(1 << int(rng.choice([*POINTS["L"], *POINTS["R"]])))
        record["t_obs"][0] = rng.uniform(-0.05, 0.05)
        record["t_obs"][0, int(rng.choice([*POINTS["L"], *POINTS["R"]]))] -= rng.choice([0.0, 0.0, 0.01])
        stamps = np.sort(rng.uniform(0.0, 0.1, int(rng.integers(1, 4))))
        noise = rng.normal(scale=rng.choice([0.02, 0.1, 0.3]), size=(len(stamps), 20, 3))
        xyz, e_p = record["xyz"][0] + noise, rng.uniform(0.0, 0.02, (len(stamps), 20))
        xyz[rng.random((len(stamps), 20)) < 0.1] = np.nan
        ends = sorted(float(rng.choice([*stamps, t])) for t in (-0.01, 0.2))
        expected = next(
            (
                (i, side, out)
                for i, t in enumerate(stamps)
                for side in range(2)
                if ends[0] < t <= ends[1]
                for out in [excess(people, side, float(t), xyz[i], e_p[i])]
                if out > 0.0
            ),
            None,
        )
        table = ArmReach(TUM)._table
        result = arm_kernels.first_arm_outside(people, 0, (stamps, xyz, e_p), (ends[0], ends[1]), table)
        if expected is None:
            none += 1
            assert result == (-1, -1, 0.0)
        else:
            found, sides = found + 1, sides | {expected[1]}
            assert result[:2] == expected[:2] and result[2] == pytest.approx(expected[2], abs=1e-9)
    assert found > 0 < none and sides == {0, 1}
