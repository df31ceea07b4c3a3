"""Arm reach: laws, plain and exact twins, the published grid, input that is no number."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from flint import arb, ctx
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from occupancy.body import Point, load_profile
from occupancy.humans import arm_joint_kernels, arm_kernels
from occupancy.humans.arm_reach import ArmReach
from occupancy.sets import distance_to_hull
from robots.motion import Block
from tests.occupancy.arm_scenes import Row, person, rows, slices
from tests.occupancy.arm_twin import Twin
from tests.occupancy.moving_arms import PATHS, POINTS, TUM, random_case
from tests.occupancy.moving_people import unit
from tests.occupancy.people import standing

Array = NDArray[np.float64]
Count = Callable[[int], int]
PROFILES = (TUM, load_profile("extreme"))
FACES = ("sound", "as_published")


def random_person(rng: np.random.Generator, *, velocity: bool | None = None) -> Block:
    """Somebody in some attitude, arms in all directions, some of them along the axis of the first angle."""
    xyz = standing()
    for side in "LR":
        s, e, w = POINTS[side]
        u = unit(rng, 1)[0]
        if rng.random() < 0.3:
            u = (
                np.array([0.0, 1.0 if side == "L" else -1.0, 0.0])
                + 10.0 ** rng.uniform(-6, -1) * unit(rng, 1)[0]
            )
            u /= np.linalg.norm(u)
        xyz[e] = xyz[s] + rng.uniform(0.28, 0.34) * u
        xyz[w] = xyz[e] + 0.25 * (u + rng.choice([0.0, 0.7]) * unit(rng, 1)[0])
    xyz = Rotation.random(random_state=rng).apply(xyz) if rng.random() < 0.7 else xyz
    people = person(xyz)
    people["e_p"][0, 0] = rng.choice([0.0, 1.0]) * rng.uniform(0.0, 0.05, 20)
    people["clock_error"], people["stamp_error"] = rng.uniform(0.0, 0.01, 2)
    if rng.random() < 0.5 if velocity is None else velocity:
        people["v"][0, 0] = rng.normal(size=(20, 3))
        people["e_v"][0, 0] = rng.choice([0.0, 1.0]) * rng.uniform(0.0, 1.0, 20)
    return people


def random_plan(rng: np.random.Generator) -> Block:
    begin = float(rng.choice([-0.1, 0.0, 0.02, 0.1]))
    return slices(begin + np.cumsum(rng.uniform(0.0, 0.05, 4)), (0.001, float(rng.uniform(0.001, 0.02))))


# ---------------------------------------------------------------------------------------------------- laws


def support(row: Row, directions: Array) -> Array:
    points, radius, _ = row
    found: Array = (directions @ points.T).max(axis=1) + radius
    return found


GROWTHS = (
    "relative_speed", "relative_acceleration", "angular_speed", "extension_speed", "elbow",
    "e_p", "e_v", "clock_error", "stamp_error", "delay", "age", "held", "shoulder",
)  # fmt: skip


@pytest.mark.parametrize("what", GROWTHS)
def test_larger_limits_errors_or_age_never_shrink_a_set(
    rng: np.random.Generator, count: Count, what: str
) -> None:
    """In any direction, a set of larger numbers reaches at least as far; age: if no velocity is known."""
    compared, grew = 0, 0
    for _ in range(count(100_000) // len(GROWTHS) * 3):
        people, plan = random_person(rng, velocity=False if what == "age" else None), random_plan(rng)
        arm = replace(TUM.arm, **{k: getattr(TUM.arm, k) * rng.uniform(0.05, 2.0) for k in GROWTHS[:4]})
        profile = replace(TUM, arm=arm)
        base = rows(ArmReach(profile), people, plan, 2)
        more, later, amount, held = people.copy(), plan.copy(), 10.0 ** rng.uniform(-6.0, 0.0), 0.0
        if what in GROWTHS[:4]:
            profile = replace(profile, arm=replace(arm, **{what: getattr(arm, what) * (1.0 + amount)}))
        elif what == "elbow":
            profile = replace(profile, arm=replace(arm, elbow=arm.elbow + amount))
        elif what in ("e_p", "e_v"):
            more[what][0, 0] += 0.1 * amount * rng.random(20)
        elif what in ("clock_error", "stamp_error"):
            more[what] += 0.1 * amount
        elif what == "delay":
            later["delay"][0, 1] += amount
        elif what == "age":
            later["t"] += 0.2 + amount
            base = rows(ArmReach(profile), people, slices(plan["t"][0, :4] + 0.2, plan["delay"][0]), 2)
        elif what == "held":
            held = amount
        else:
            speed = profile.speed.copy()
            speed[[Point.L_SHOULDER, Point.R_SHOULDER]] += amount
            profile = replace(profile, speed=speed)
        grown = rows(ArmReach(profile, held_object_m=held), more, later, 2)
        by_parts = {covers: row for *_, covers in grown for row in grown if row[2] == covers}
        u = unit(rng, 200)
        for row in base:
            ways = np.vstack([u, [c - row[0][0] for c in row[0][1:]] or u[:1]])
            ways /= np.linalg.norm(ways, axis=1)[:, None]
            change = support(by_parts[row[2]], ways) - support(row, ways)
            assert (change >= -1e-12).all()
            compared, grew = compared + 1, grew + bool(change.max() > 1e-9)
    assert compared > 0 and (grew > 0 or what == "elbow")


def test_sets_grow_with_angle_and_extension(rng: np.random.Generator, count: Count) -> None:
    """Kernels alone, angles across every change of form; the ball contains all hulls and not by much."""
    limits, arm = ArmReach(TUM)._table[0].copy(), np.zeros(1, arm_kernels.ARM)[0]
    limits["extension"], limits["extension_speed"], limits["speed"] = (0.0, 10.0), 0.2, 100.0
    people = person(e_p=0.0)
    for p, x in zip(POINTS["L"], ([0.0, 0.0, 0.0], [0.3, -0.2, 0.1], [0.3, -0.2, 0.1]), strict=True):
        people["xyz"][0, 0, p] = x
    arm_kernels.read_arm(people[0], 0, limits["point"][0], arm)
    u, forms = unit(rng, 500), []

    def reach(angle: float) -> Array:
        limits["angular_speed"] = angle
        row = np.zeros(96)
        n, more = arm_kernels.sound_hull(arm, (0.0, 1.0), limits, row)
        forms.append(n)
        return (u @ row.reshape(-1, 3)[:n].T).max(axis=1) + more

    before = reach(0.0)
    for angle in np.sort(rng.uniform(0.0, 1.2, count(100_000))):
        now = reach(float(angle))
        assert (now >= before - 1e-13).all()
        before = now
    assert set(forms) == {1, 21, 31}
    attained = max(
        np.linalg.norm([rho * math.cos(t), rho * math.sin(t) * arm_kernels.BEYOND])
        for rho, t in (
            (1.0 / math.cos(math.pi / 12), math.pi / 12),
            (1.0 / math.cos(math.pi / 12), math.pi / 4),
            (1.0, math.pi / 3),
        )
    )
    assert attained < arm_kernels.WHOLE_BALL < attained + 1e-4


def test_arm_that_goes_through_its_shoulder_points_the_other_way(
    rng: np.random.Generator, count: Count
) -> None:
    """Straight back, known exactly: the angle is π, however products of lengths round."""
    limits, arm = ArmReach(TUM)._table[0].copy(), np.zeros(1, arm_kernels.ARM)[0]
    limits["extension"], limits["speed"], limits["angular_speed"] = (0.0, 10.0), 100.0, 100.0
    limits["acceleration"] = 0.0
    people = person(e_p=0.0, e_v=0.0)
    for _ in range(count(10_000)):
        d = 0.4 * unit(rng, 1)[0]
        for p, share in zip(POINTS["L"], (0.0, 1.0, 1.0), strict=True):
            people["xyz"][0, 0, p], people["v"][0, 0, p] = share * d, -4.0 * share * d
        arm_kernels.read_arm(people[0], 0, limits["point"][0], arm)
        _, half = arm_kernels.reach_cone(arm, (0.5, 0.5), limits)
        assert half == math.inf


def test_turning_everybody_about_the_vertical_turns_the_rows(rng: np.random.Generator) -> None:
    """Arms that do not hang: their corners turn with them."""
    turn = Rotation.from_rotvec([0.0, 0.0, float(rng.uniform(-3.0, 3.0))])
    plan, xyz = slices(np.array([0.0, 0.03])), standing()
    for side in "LR":
        s, e, w = POINTS[side]
        xyz[e], xyz[w] = xyz[s] + [0.25, 0.05, 0.1], xyz[s] + [0.5, 0.0, 0.1]
    for face in FACES:
        here = rows(ArmReach(TUM, face=face), person(xyz), plan)
        there = rows(ArmReach(TUM, face=face), person(turn.apply(xyz)), plan)
        for one, two in zip(here, there, strict=True):
            np.testing.assert_allclose(turn.apply(one[0]), two[0], atol=1e-12)
            assert one[1] == pytest.approx(two[1], abs=1e-12)


def test_left_and_right_are_alike(rng: np.random.Generator) -> None:
    plan, mirror = slices(np.array([0.0, 0.04])), np.array([1.0, -1.0, 1.0])
    for _ in range(30):
        left = random_person(rng)
        right = left.copy()
        for p in Point:
            other = {"L_": "R_", "R_": "L_"}.get(p.name[:2])
            q = Point[other + p.name[2:]] if other else p
            for field in ("xyz", "v"):
                right[field][0, 0, q] = left[field][0, 0, p] * mirror
            for field in ("e_p", "e_v"):
                right[field][0, 0, q] = left[field][0, 0, p]
        for face in FACES:
            here, there = (rows(ArmReach(TUM, face=face), people, plan) for people in (left, right))
            assert sorted(r for _, r, _ in here) == pytest.approx(sorted(r for _, r, _ in there))
            for points, radius, covers in here:
                [same] = [row for row in there if row[2] == (covers << 3 if covers < 1 << 7 else covers >> 3)]
                assert same[1] == pytest.approx(radius) and len(same[0]) == len(points)
                centre = points[0] * mirror
                np.testing.assert_allclose(centre, same[0][0])
                far = [
                    np.sort(np.linalg.norm(x, axis=1)) for x in (points * mirror - centre, same[0] - centre)
                ]
                np.testing.assert_allclose(*far, atol=1e-9)


# ----------------------------------------------------------------------------------------------------- twins


def close(row: Row, twin: tuple[list[list[float]], float], body: float, within: float) -> None:
    points, growth = twin
    np.testing.assert_allclose(row[0], np.array(points, dtype=float), rtol=0.0, atol=within)
    assert row[1] == pytest.approx(float(growth) + body, rel=0.0, abs=within)


@pytest.mark.parametrize("profile", PROFILES, ids=lambda profile: profile.name)
@pytest.mark.parametrize("face", FACES)
def test_rows_equal_those_of_a_plain_twin(rng: np.random.Generator, count: Count, face: str, profile) -> None:
    model, forms = ArmReach(profile, face=face), set()
    for _ in range(count(5_000)):
        people, plan = random_person(rng), random_plan(rng)
        for i in range(3):
            found = rows(model, people, plan, i)
            for side in range(2):
                own = [row for row in found if bool(row[2] >> 7) == bool(side)]
                twin = Twin(profile, people[0], plan[0], 0, side, float)
                expected = twin.sound(i) if face == "sound" else twin.published(i)
                assert len(own) == (2 if expected else 0)
                if expected:
                    forms.add(len(own[0][0]))
                    within = 1e-12 if face == "sound" else twin.rounding()
                    for row, body in zip(own, twin.radii(), strict=True):
                        close(row, expected, body, within)
    assert face != "sound" or forms == {1, 21, 31}


def test_cone_equals_that_of_a_plain_twin_however_wide(rng: np.random.Generator, count: Count) -> None:
    """Rows know no cone beyond 60°, but later samples are held against wider ones."""
    widths, contradicted = [], 0
    for _ in range(count(20_000)):
        people, plan, arm = random_person(rng), random_plan(rng), np.zeros(1, arm_kernels.ARM)[0]
        limits = {k: getattr(TUM.arm, k) * 10.0 ** rng.uniform(-2.0, 0.3) for k in GROWTHS[:4]}
        profile = replace(TUM, arm=replace(TUM.arm, **limits))
        table = ArmReach(profile)._table[0]
        for side in range(2):
            arm_kernels.read_arm(people[0], 0, table["point"][side], arm)
            for i in range(3):
                twin = Twin(profile, people[0], plan[0], 0, side, float)
                most, half = arm_kernels.reach_cone(arm, twin.span(i), table)
                cone = twin.cone(i)
                if cone is None:
                    contradicted += 1
                    assert math.isnan(most) and math.isnan(half)
                    continue
                widths.append(min(cone[1], math.pi))
                assert most == pytest.approx(cone[0], rel=0.0, abs=1e-12)
                assert 2.0 * math.atan(half) == pytest.approx(widths[-1], rel=0.0, abs=1e-7)
    counts, _ = np.histogram(widths, np.linspace(0.0, math.pi, 7))
    assert counts.min() > 0 and math.pi in widths and contradicted > 0


@pytest.mark.parametrize("face", FACES)
def test_rows_agree_with_ball_arithmetic(rng: np.random.Generator, count: Count, face: str) -> None:
    """At 200 bits, also with arms along the axis of the published first angle: ill-conditioned."""
    model, before, compared = ArmReach(TUM, face=face), ctx.prec, 0
    ctx.prec = 200
    try:
        for _ in range(count(20_000)):
            people, plan = random_person(rng), random_plan(rng)
            found = rows(model, people, plan, 1)
            for side in range(2):
                own = [row for row in found if bool(row[2] >> 7) == bool(side)]
                twin = Twin(TUM, people[0], plan[0], 0, side, arb)
                exact = twin.sound(1) if face == "sound" else twin.published(1)
                assert len(own) == (2 if exact else 0)
                for (points, radius, _), body in zip(own, twin.radii() if exact else (), strict=True):
                    assert exact is not None and len(points) == len(exact[0])
                    off = [
                        arb(float(x)) - y
                        for at, to in zip(points, exact[0], strict=True)
                        for x, y in zip(at, to, strict=True)
                    ]
                    off.append(arb(radius) - exact[1] - body)
                    within = 1e-14 if face == "sound" else twin.rounding()
                    assert all(abs(x) < within for x in off)
                    compared += 1
    finally:
        ctx.prec = before
    assert compared > 0


# -------------------------------------------------------------------------------------------- published grid


def test_grid_contains_every_direction_of_its_box(rng: np.random.Generator, count: Count) -> None:
    """Anywhere in the box, at any extension, across all cells; and near the middle of cells not by much."""
    least = math.inf
    for _ in range(count(20_000)):
        low = np.array([rng.uniform(-3.0, 3.0), rng.uniform(-1.5, 1.5), 0.2])
        size = (rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.0, 0.5 * math.pi - low[1]), 0.3)
        high = low + np.array(size)
        points, frame = np.zeros((32, 3)), Rotation.random(random_state=rng).as_matrix()
        n, sagitta = arm_joint_kernels.write_grid(points, frame, np.column_stack([low, high]))
        assert 0.0 <= sagitta < 0.5 and n <= 32
        for q1, q2, r in rng.uniform(low, high, (20, 3)):
            r = 0.5 if rng.random() < 0.5 else r
            joint = np.array([math.cos(q2) * math.cos(q1), math.cos(q2) * math.sin(q1), math.sin(q2)])
            far = distance_to_hull(points[:n], r * joint @ frame)
            assert far <= sagitta + 1e-12
            least = min(least, (sagitta - far) / max(sagitta, 1e-9))
    assert least < 0.35


def test_grid_does_not_grow_everywhere_with_its_box() -> None:
    """Why the sound face has none: towards a node that moves away, the set of a larger box falls back."""
    angles = np.linspace(-0.8, 0.8, 81)
    q1, q2 = (q.ravel() for q in np.meshgrid(angles, angles))
    ways = np.column_stack([np.cos(q2) * np.cos(q1), np.cos(q2) * np.sin(q1), np.sin(q2)])
    reaches = []
    for half in (0.5, 0.6):
        points, box = np.zeros((32, 3)), np.array([[-half, half], [-half, half], [0.2, 0.5]])
        n, sagitta = arm_joint_kernels.write_grid(points, np.eye(3), box)
        reaches.append((ways @ points[:n].T).max(axis=1) + sagitta)
    change = reaches[1] - reaches[0]
    assert change.max() > 0.01 and -0.01 < change.min() < -0.003


def test_published_box_contains_joint_motions_at_its_limits(rng: np.random.Generator, count: Count) -> None:
    """Constant rates, and constant accelerations from the rates that were seen, within the joint limits."""
    table = ArmReach(TUM, face="as_published")._table[0]
    for _ in range(count(50_000)):
        q = rng.uniform(table["low"] + [0, 0.1, 0], table["high"] - [0, 0.1, 0])
        t = float(rng.uniform(0.0, 0.3))
        rate, known = table["rate"] * rng.uniform(-1.0, 1.0, 3), rng.random() < 0.5
        c1, s1, c2, s2 = math.cos(q[0]), math.sin(q[0]), math.cos(q[1]), math.sin(q[1])
        u = np.array([c2 * c1, c2 * s1, s2])
        v = rate[2] * u + q[2] * (rate[0] * np.array([-c2 * s1, c2 * c1, 0]))
        v += q[2] * rate[1] * np.array([-s2 * c1, -s2 * s1, c2])
        arm, joints = np.zeros(1, arm_kernels.ARM)[0], np.zeros(1, arm_joint_kernels.JOINTS)[0]
        arm["offset"], arm["extension"], arm["velocity"] = q[2] * u, q[2], v
        arm["e_v"], joints["frame"] = 0.0 if known else np.inf, np.eye(3)
        arm_joint_kernels.write_joints(arm, table, joints)
        assert arm_joint_kernels.joint_box(joints, t, table)
        box = joints["box"]
        for part in (0.0, 0.5, 1.0):
            change = rng.choice([-1.0, 1.0], 3) * table["change"] if known else 0.0
            moved = q + part * t * rate + 0.5 * (part * t) ** 2 * change
            held_back = np.clip(moved, q - table["rate"] * t, q + table["rate"] * t)
            inside = np.clip(held_back, table["low"], table["high"])
            assert (inside >= box[:, 0] - 1e-9).all() and (inside <= box[:, 1] + 1e-9).all()


# ---------------------------------------------------------------------------------- input that is no number

BAD = [math.nan, math.inf, -math.inf, 1e300, -1e300]


@pytest.mark.parametrize("value", BAD)
@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize("point", ["SHOULDER", "ELBOW", "WRIST"])
@pytest.mark.parametrize("field", ["xyz", "e_p", "t_obs", "v", "e_v"])
def test_number_that_is_not_usable_in_an_arm_gives_it_no_row(
    field: str, point: str, face: str, value: float
) -> None:
    for axis in range(3 if field in ("xyz", "v") else 1):
        people = person(e_v=0.1)
        where = (0, 0, Point[f"L_{point}"], *((axis,) if field in ("xyz", "v") else ()))
        people[field][where] = value
        found = rows(ArmReach(TUM, face=face), people, slices(np.array([0.01, 0.02])))
        others = [covers for _, _, covers in found if covers >> 7]
        torso = face == "as_published" and point == "SHOULDER" and field in ("xyz", "t_obs")
        assert len(others) == (0 if torso else 2)
        if field == "e_v" and value in (math.inf, 1e300):
            continue
        assert len(found) == len(others)


@pytest.mark.parametrize("value", BAD)
@pytest.mark.parametrize("field", ["clock_error", "stamp_error", "t", "delay"])
@pytest.mark.parametrize("face", FACES)
def test_number_that_is_not_usable_in_times_gives_no_row(field: str, face: str, value: float) -> None:
    model = ArmReach(TUM, face=face)
    for place in (0, 1):
        people, plan = person(), slices(np.array([0.01, 0.02]))
        if field in ("t", "delay"):
            plan[field][0, place] = value
        else:
            people[field] = value
        assert rows(model, people, plan) == []


@pytest.mark.parametrize("face", FACES)
def test_negative_error_or_slice_that_ends_before_it_begins_gives_no_row(face: str) -> None:
    model = ArmReach(TUM, face=face)
    assert rows(model, person(), slices(np.array([0.2, 0.1]))) == []
    for field in ("e_p", "e_v"):
        people = person(e_v=0.1)
        people[field] = -0.01
        assert rows(model, people, slices(np.array([0.1, 0.2]))) == []


@pytest.mark.parametrize("face", FACES)
def test_points_in_one_place_give_no_row_of_numbers_that_are_not(face: str) -> None:
    """Shoulder, elbow and wrist in one place, or a torso without an axis: no row, or finite numbers."""
    for same in (
        POINTS["L"],
        (Point.L_SHOULDER, Point.R_SHOULDER),
        (Point.PELVIS, Point.NECK_BASE, Point.THORAX),
    ):
        xyz = standing()
        xyz[list(same)] = xyz[same[0]]
        for row in rows(ArmReach(TUM, face=face), person(xyz, e_p=0.3), slices(np.array([0.0, 0.1]))):
            assert np.isfinite(row[0]).all() and 0.0 < row[1] < 10.0


@pytest.mark.parametrize("kind", PATHS)
def test_velocity_helps_and_its_lack_does_not_hurt(rng: np.random.Generator, kind: str) -> None:
    """R3 is an intersection: without it, no direction is tighter."""
    for _ in range(40):
        case = random_case(rng, kind, aligned=False)
        if case is None:
            continue
        blind = case.people.copy()
        blind["e_v"] = math.inf
        model, u = ArmReach(case.profile), unit(rng, 100)
        seen, unseen = (rows(model, people, case.plan) for people in (case.people, blind))
        for seeing, not_seeing in zip(seen, unseen, strict=True):
            assert (support(seeing, u) <= support(not_seeing, u) + 1e-12).all()
