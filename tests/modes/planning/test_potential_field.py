"""The potential and the clearance against dense sampling, another engine, and the formulas as printed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import coal
import numpy as np
import pytest
from numpy.typing import NDArray

from modes.planning.potential_field import Bodies, Field, FieldSettings, Fixtures
from modes.reaching_person import report_of
from occupancy.body import MAX_POINTS, Part, Point, load_profile
from robots.errors import SetupError
from robots.kernels import forward
from robots.model import RobotModel

Array = NDArray[np.float64]
PROFILE = load_profile("iso")


def somebody(hand: Array, frames: int = 4, step: Array | None = None) -> Bodies:
    """A person who reaches for ``hand`` (3,), and goes on by ``step`` (3,) each frame."""
    xyz = report_of(hand, 0.0, 0.0).people[0].xyz[None]
    way = np.array([0.0, 0.05, 0.0]) if step is None else step
    return Bodies.of_points([xyz + k * way for k in range(frames)], PROFILE)


def capsules(robot: RobotModel, q: Array) -> list[tuple[Array, Array, float]]:
    """Links as capsules in the world."""
    n, rows = len(robot.joints), robot.enclosure[0]
    rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
    forward(robot.kinematics, q, rotations, positions)
    found = []
    for i in range(len(robot.links)):
        j = rows["joint"][i]
        a, b = (positions[j] + rotations[j] @ rows[end][i] for end in "ab")
        found.append((a, b, float(rows["radius"][i])))
    return found


def coal_gap(first: tuple[Array, Array, float], second: tuple[Array, Array, float]) -> float:
    """The gap of two capsules' axes by coal, less both radii."""
    shapes, poses = [], []
    for a, b, _radius in (first, second):
        length = float(np.linalg.norm(b - a))
        axis = (b - a) / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
        other = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
        x = np.cross(other, axis)
        x /= np.linalg.norm(x)
        rotation = np.column_stack((x, np.cross(axis, x), axis))
        shapes.append(coal.Capsule(1e-9, length))
        poses.append(coal.Transform3s(rotation, 0.5 * (a + b)))
    result = coal.DistanceResult()
    coal.distance(shapes[0], poses[0], shapes[1], poses[1], coal.DistanceRequest(), result)
    return float(result.min_distance) - first[2] - second[2]


def configurations(robot: RobotModel, rng: np.random.Generator, count: int) -> Array:
    limits = robot.limits
    low, high = np.maximum(limits.position_lower, -3.0), np.minimum(limits.position_upper, 3.0)
    return np.asarray(rng.uniform(low, high, (count, len(low))))


@pytest.mark.parametrize("name", ["ur16e", "panda"])
def test_the_clearance_is_that_of_coal(
    name: str, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    robot = arm(name)
    field = Field(robot)
    for q in configurations(robot, rng, count(1000)):
        bodies = somebody(rng.uniform([-1.0, -1.0, 0.2], [1.0, 1.0, 1.2]), 2)
        found = field.clearance(q, bodies)
        gaps = [
            coal_gap(link, (bodies.a[f, k], bodies.b[f, k], float(bodies.radius[k])))
            for link in capsules(robot, q)
            for f in range(bodies.frames)
            for k in range(len(bodies.radius))
        ]
        assert found == pytest.approx(min(gaps), abs=1e-5)
        assert field.clearance(q, bodies, enough=0.1) == pytest.approx(min(0.1, *gaps), abs=1e-5)


@pytest.mark.parametrize("variant", ["surface", "as_printed"])
def test_the_potential_is_its_sum(
    variant: str, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """(5) and (6) in plain loops over points that are placed and measured here."""
    robot = arm("ur16e")
    settings = FieldSettings(variant=variant, decay=0.8, reach_m=0.6, spacing_m=0.1)  # type: ignore[arg-type]  # variants are plain texts here
    field = Field(robot, settings)
    for q in configurations(robot, rng, count(100)):
        bodies = somebody(rng.uniform([-0.8, -0.8, 0.2], [0.8, 0.8, 1.2]), 3)
        total = 0.0
        for (a, b, skin), f, k in itertools.product(
            capsules(robot, q), range(bodies.frames), range(len(bodies.radius))
        ):
            points = max(2, math.ceil(np.linalg.norm(b - a) / 0.1) + 1) if (a != b).any() else 1
            for share in np.linspace(0.0, 1.0, points):
                p, c, d = a + share * (b - a), bodies.a[f, k], bodies.b[f, k] - bodies.a[f, k]
                along = np.clip((p - c) @ d / (d @ d), 0.0, 1.0) if (d != 0.0).any() else 0.0
                gap = float(np.linalg.norm(p - c - along * d))
                if variant == "surface":
                    gap -= skin + float(bodies.radius[k])
                total += 0.8**f * _phi(gap, 0.6)
        assert field.potentials(q[None], bodies)[0] == pytest.approx(total, rel=1e-9, abs=1e-9)


def _phi(d: float, reach: float) -> float:
    if d < 0.0:
        return 2.0
    return math.cos(0.5 * math.pi * d / reach) if d <= reach else 0.0


def test_an_edge_that_is_said_to_be_clear_is(
    arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Dense samples of it never come nearer than the clearance less the slack; most near ones are refused."""
    robot = arm("ur16e")
    field = Field(robot, FieldSettings(clearance_m=0.1))
    clear = 0
    for _ in range(count(400)):
        a, b = configurations(robot, rng, 2)
        b = a + 0.3 * (b - a)
        bodies = somebody(rng.uniform([-1.0, -1.0, 0.2], [1.0, 1.0, 1.2]), 2)
        sampled = [field.clearance(a + s * (b - a), bodies) for s in np.linspace(0.0, 1.0, 200)]
        said = field.is_clear_between(a, b, bodies, 0.005)
        clear += said
        if said:
            assert min(sampled) >= 0.1 - 0.005 and min(sampled[0], sampled[-1]) >= 0.1
        if min(sampled) >= 0.1:
            assert said, "clear all the way, and refused"
    assert clear > 0


def test_points_that_a_later_frame_lacks_stay_where_they_were(arm: Callable[[str], RobotModel]) -> None:
    first = report_of(np.array([0.6, 0.0, 0.8]), 0.0, 0.0).people[0].xyz[None]
    later = first + 0.1
    later[0, 3] = np.nan
    both = Bodies.of_points([first, later], PROFILE)
    moved = np.linalg.norm(both.a[1] - both.a[0], axis=1)
    assert moved.max() == pytest.approx(math.sqrt(0.03)) and moved.min() == 0.0


def test_a_point_of_which_a_coordinate_is_missing_is_not_seen(arm: Callable[[str], RobotModel]) -> None:
    """Else it would be made of two frames. What is seen later only is taken to be there from the start."""
    first = report_of(np.array([0.6, 0.0, 0.8]), 0.0, 0.0).people[0].xyz[None]
    torn = first + 0.1
    torn[0, 3, 1] = np.nan
    whole = Bodies.of_points([first, torn], PROFILE)
    lacking = torn.copy()
    lacking[0, 3] = np.nan
    np.testing.assert_array_equal(whole.a, Bodies.of_points([first, lacking], PROFILE).a)
    unseen = np.full_like(first, np.nan)
    late = Bodies.of_points([unseen, first], PROFILE)
    np.testing.assert_array_equal(late.a, Bodies.of_points([first, first], PROFILE).a)


@pytest.mark.parametrize("q", [np.zeros(5), np.zeros((1, 6))])
def test_a_configuration_of_another_arm_is_refused_before_it_is_looked_at(
    q: Array, arm: Callable[[str], RobotModel]
) -> None:
    field, bodies = Field(arm("ur16e")), somebody(np.array([0.7, 0.1, 0.6]))
    for look in (
        lambda: field.clearance(q, bodies),
        lambda: field.is_clear_between(np.zeros(6), q, bodies),
        lambda: field.is_clear_between(q, np.zeros(6), bodies),
    ):
        with pytest.raises(SetupError, match="does not fit ur16e"):
            look()


@pytest.mark.parametrize("end", [np.inf, np.nan, 1e300])
def test_nothing_is_proven_of_a_line_without_an_end(end: float, arm: Callable[[str], RobotModel]) -> None:
    nobody = Bodies.of_points([np.full((1, MAX_POINTS, 3), np.nan)], PROFILE)
    for bodies in (nobody, somebody(np.array([3.0, 0.0, 1.0]))):
        assert not Field(arm("ur16e")).is_clear_between(np.zeros(6), np.full(6, end), bodies)


@pytest.mark.parametrize("slack", [0.0, -0.01, math.nan])
def test_a_slack_without_which_there_is_no_progress_is_refused(
    slack: float, arm: Callable[[str], RobotModel]
) -> None:
    bodies = somebody(np.array([3.0, 0.0, 1.0]))
    with pytest.raises(SetupError, match="clear between: slack_m"):
        Field(arm("ur16e")).is_clear_between(np.zeros(6), np.ones(6), bodies, slack)


def test_nobody_is_no_obstacle(arm: Callable[[str], RobotModel]) -> None:
    nobody = Bodies.of_points([np.full((1, MAX_POINTS, 3), np.nan)], PROFILE)
    field = Field(arm("ur16e"))
    assert (
        field.clearance(np.zeros(6), nobody) == 10.0 and field.potentials(np.zeros((1, 6)), nobody)[0] == 0.0
    )
    assert field.is_clear_between(np.zeros(6), np.ones(6), nobody)


def test_a_calibrated_sum_keeps_the_clearance(
    arm: Callable[[str], RobotModel], rng: np.random.Generator
) -> None:
    robot = arm("ur16e")
    field = Field(robot)
    bodies = somebody(np.array([0.7, 0.1, 0.6]))
    most = field.calibrated(bodies, draws=1500)
    assert 0.0 < most < math.inf
    for q in configurations(robot, rng, 200):
        if field.potentials(q[None], bodies)[0] < 0.5 * most:
            assert field.clearance(q, bodies) > 0.2


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: FieldSettings(clearance_m=-0.1), "clearance_m"),
        (lambda: FieldSettings(reach_m=0.0), "reach_m"),
        (lambda: FieldSettings(variant="other"), "variant"),  # type: ignore[arg-type]  # what is to be refused
        (lambda: Bodies.of_points([], PROFILE), "no frame"),
        (
            lambda: Bodies.of_points([np.zeros((1, 14, 3))], PROFILE),
            r"\(1, 14, 3\) should be \(people, 20, 3\)",
        ),
        (lambda: Bodies.of_points([np.zeros((1, 20, 3)), np.zeros((2, 20, 3))], PROFILE), "frames of shapes"),
        (lambda: Bodies(np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), np.zeros(3)), "do not fit 3 radii"),
        (lambda: Fixtures(np.zeros((1, 3)), np.zeros((1, 3)), np.array([-0.1])), "radius -0.1 m"),
        (lambda: Fixtures(np.zeros((2, 3)), np.zeros((1, 3)), np.array([0.1])), "fixtures: a"),
        (lambda: Fixtures(np.zeros((1, 3)), np.zeros((1, 3)), np.array([0.1]), -1.0), "gap_m"),
        (lambda: Bodies(np.full((1, 1, 3), np.nan), np.zeros((1, 1, 3)), np.zeros(1)), "not finite"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(make: Callable[[], object], named: str) -> None:
    with pytest.raises(SetupError, match=named):
        make()


def test_configurations_of_another_arm_are_refused(arm: Callable[[str], RobotModel]) -> None:
    bodies = Bodies.of_points([np.zeros((1, MAX_POINTS, 3))], PROFILE, (Part.HEAD,))
    with pytest.raises(SetupError, match=r"configurations of shape \(1, 7\) do not fit ur16e"):
        Field(arm("ur16e")).potentials(np.zeros((1, 7)), bodies)


def test_a_point_that_first_frames_lack_is_where_it_is_seen_first() -> None:
    frames = np.full((4, 1, MAX_POINTS, 3), np.nan)
    frames[1, 0, Point.HEAD], frames[3, 0, Point.HEAD] = (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)
    for each in (frames, list(frames)):
        assert Bodies.of_points(each, PROFILE).a[:, 0, 0].tolist() == [1.0, 1.0, 1.0, 2.0]
