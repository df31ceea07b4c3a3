"""Reach bounds: never below the distance that random configurations show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from robots.errors import SetupError
from robots.kernels import forward
from robots.model import KINEMATICS, Mount, RobotModel, read_tree
from robots.reach import _about_axis, _Drum, _slid, reach
from robots.urdf import parse_urdf
from tests.robots.made_up import random_tree

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """Points (P, 3) fixed to ``joint`` of a tree, and the range of every joint."""

    kinematics: NDArray[np.void]
    lower: Array
    upper: Array
    joint: int
    points: Array

    @property
    def chain(self) -> list[int]:
        """Joints that move the points, the nearest one first."""
        chain, joint = [], self.joint
        while joint >= 0:
            chain.append(joint)
            joint = int(self.kinematics[0]["parent"][joint])
        return chain


def largest_distances(case: Case, rng: np.random.Generator, number: int) -> Array:
    """(joints of the chain,) distance of any point from each joint's axis, largest over configurations."""
    tree, n = case.kinematics[0], len(case.lower)
    lower, upper = np.maximum(case.lower, -10.0), np.minimum(case.upper, 10.0)
    rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
    chain, seen = case.chain, np.zeros(len(case.chain))
    for _ in range(number):
        q = np.where(
            rng.random(n) < 0.3, rng.choice([0, 1], n) * (upper - lower) + lower, rng.uniform(lower, upper)
        )
        forward(case.kinematics, q, rotations, positions)
        points = case.points @ rotations[case.joint].T + positions[case.joint]
        axes = np.einsum("kij,kj->ki", rotations[chain], tree["axis"][chain])
        levers = np.cross(axes[:, None, :], points[None, :, :] - positions[chain][:, None, :])
        seen = np.maximum(seen, np.linalg.norm(levers, axis=-1).max(axis=1))
    return seen


def sum_of_lengths(case: Case) -> Array:
    """The plain bound: all placements and strokes between joint and point, added."""
    tree, bound = case.kinematics[0], []
    length = float(np.linalg.norm(case.points, axis=1).max())
    for k in case.chain:
        if tree["prismatic"][k]:
            length += max(abs(case.lower[k]), abs(case.upper[k]))
        bound.append(length)
        length += float(np.linalg.norm(tree["translation"][k]))
    return np.array(bound)


def check(case: Case, bound: Array, rng: np.random.Generator, number: int) -> tuple[Array, Array]:
    """Compare a bound (16,) with what configurations show; return both for the turning joints."""
    slides = case.kinematics[0]["prismatic"][case.chain].astype(bool)
    assert (np.delete(bound, case.chain) == 0.0).all()
    along = bound[case.chain]
    assert (along[slides] == 1.0).all()
    seen = largest_distances(case, rng, number)
    assert (seen <= along)[~slides].all(), (seen - along)[~slides]
    assert (along <= sum_of_lengths(case) + 2e-9)[~slides].all()
    return seen[~slides], along[~slides]


@pytest.mark.parametrize(
    "name", ["ur3", "ur5", "ur10", "panda", "lwa4p", "kr5_sixx", "ra605", "ur3e", "ur16e", "fr3"]
)
def test_no_configuration_of_an_arm_reaches_farther(
    name: str, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    model = arm(name)
    rows, limits = model.enclosure[0], model.limits
    ratios: list[float] = []
    for i in range(rows["n"]):
        ends = np.array([rows["a"][i], rows["b"][i]])
        case = Case(
            model.kinematics, limits.position_lower, limits.position_upper, int(rows["joint"][i]), ends
        )
        seen, bound = check(case, rows["reach"][i], rng, count(20_000))
        ratios.extend(seen / np.maximum(bound, 1e-3))
    assert np.median(ratios) > 0.7, "so loose that nothing would be tested"
    assert not rows["reach"][rows["n"] :].any()


@pytest.mark.parametrize("aligned", [True, False])
def test_no_configuration_of_a_made_up_tree_reaches_farther(
    aligned: bool,
    write_urdf: Callable[[str], Path],
    rng: np.random.Generator,
    count: Callable[[int], int],
) -> None:
    slid = 0
    for _ in range(count(1_500)):
        n = int(rng.integers(2, 8))
        path = write_urdf(random_tree(rng, n, aligned=aligned))
        tree = read_tree(parse_urdf(path.read_bytes(), path), None)
        slides = np.array(list(tree.prismatic.values()))
        lower, upper = np.where(slides, -0.2, -np.inf), np.where(slides, 0.3, np.inf)
        kinematics = tree.kinematics(Mount.from_xyz_rpy(rng.normal(size=3), rng.normal(size=3)))
        for joint in range(n):
            case = Case(kinematics, lower, upper, joint, rng.uniform(-0.4, 0.4, (2, 3)))
            bound = reach(kinematics, lower, upper, joint, case.points)
            slid += bool(case.kinematics[0]["prismatic"][case.chain].any())
            check(case, bound, rng, 50)
    assert slid


def two_joints(second_axis: Array, offset: Array, *, slides: bool = False) -> NDArray[np.void]:
    block = np.zeros(1, dtype=KINEMATICS)
    tree = block[0]
    tree["n"] = 2
    tree["parent"][:2] = (-1, 0)
    tree["prismatic"][1] = slides
    tree["rotation"][:2] = np.eye(3)
    tree["translation"][1] = offset
    tree["axis"][:2] = [[0, 0, 1], second_axis]
    return block


def test_parallel_axes_add_their_levers_exactly() -> None:
    tree = two_joints(np.array([0, 0, 1.0]), np.array([0.4, 0, 0.7]))
    bound = reach(tree, np.full(2, -np.inf), np.full(2, np.inf), 1, np.array([[0.3, 0.4, 9.0]]))
    np.testing.assert_allclose(bound[:2], [0.4 + 0.5, 0.5], atol=2e-9)
    assert (bound[:2] > [0.4 + 0.5, 0.5]).all() and not bound[2:].any()


def test_several_points_are_reached_by_the_farthest_one() -> None:
    tree, endless = two_joints(np.array([0, 0, 1.0]), np.array([0.4, 0, 0])), np.full(2, np.inf)
    points = np.array([[0.1, 0.0, 0.0], [0.3, 0.4, 0.0], [0.2, 0.0, 0.0]])
    np.testing.assert_allclose(reach(tree, -endless, endless, 1, points)[:2], [0.9, 0.5], atol=2e-9)


def test_orthogonal_axes_that_meet_give_the_exact_distance() -> None:
    """A point at lever 0.5, height 0.2 on an axis along x: farthest from z when the lever lies along y."""
    tree = two_joints(np.array([1.0, 0, 0]), np.zeros(3))
    bound = reach(tree, np.full(2, -np.inf), np.full(2, np.inf), 1, np.array([[0.2, 0.3, 0.4]]))
    np.testing.assert_allclose(bound[:2], [np.hypot(0.2, 0.5), 0.5], atol=2e-9)


def test_a_stroke_counts_where_it_is_across_the_axis_before() -> None:
    tree = two_joints(np.array([1.0, 0, 0]), np.array([0.1, 0, 0]), slides=True)
    limits = np.array([-9.0, -0.3]), np.array([9.0, 0.8])
    bound = reach(tree, *limits, 1, np.array([[0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(bound[:2], [0.9, 1.0], atol=2e-9)


@pytest.mark.parametrize(
    ("lower", "upper"), [(-np.inf, np.inf), (-np.inf, 1.0), (-1.0, np.inf), (np.nan, 1.0), (-1.0, np.nan)]
)
def test_an_endless_stroke_is_refused(lower: float, upper: float) -> None:
    tree = two_joints(np.array([1.0, 0, 0]), np.zeros(3), slides=True)
    with pytest.raises(SetupError, match="finite position limits"):
        reach(tree, np.full(2, lower), np.full(2, upper), 1, np.zeros((1, 3)))


def unit(rng: np.random.Generator) -> Array:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def random_drum(rng: np.random.Generator) -> tuple[_Drum, Array]:
    """A drum with a ball that cuts it or holds all of it, and an axis: parallel, orthogonal or oblique."""
    low, high = np.sort(rng.uniform(-0.5, 0.5, 2))
    axis, origin, radius = unit(rng), rng.uniform(-0.5, 0.5, 3) * rng.choice([0.0, 1.0]), rng.uniform(0, 0.4)
    side = np.cross(axis, unit(rng))
    side /= np.linalg.norm(side)
    angle = rng.choice([0.0, np.pi / 2, np.pi, rng.uniform(0, np.pi)])
    farthest = np.hypot(radius, max(-low, high))
    drum_axis = np.cos(angle) * axis + np.sin(angle) * side
    if rng.random() < 0.5:
        return _Drum(origin, drum_axis, radius, low, high, origin, rng.uniform(0.2, 1.0) * farthest), axis
    centre = origin + rng.normal(size=3) * 0.1
    return _Drum(origin, drum_axis, radius, low, high, centre, 9.0), axis


def drum_about(drum: _Drum, axis: Array) -> tuple[float, float, float, float]:
    """Radius, low, high and ball of the drum about ``axis``, in the plane across it: what the rules say."""
    cosine, centre = float(drum.axis @ axis), drum.centre
    along = np.cross(drum.axis, axis)
    if not np.linalg.norm(along) > 1e-3:  # parallel: any direction across will do
        along = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    along /= np.linalg.norm(along)
    across, sine = np.cross(axis, along), np.sqrt(max(0.0, 1.0 - cosine**2))
    radii, ends, balls = [], [], []
    for z in (drum.low, drum.high):
        rim = drum.origin + z * drum.axis
        x, y, height = abs(rim @ along), abs(rim @ across), rim @ axis
        box = np.hypot(x + drum.radius, y + abs(cosine) * drum.radius)
        radii.append(min(np.hypot(x, y) + drum.radius, box))
        ends += [height - sine * drum.radius, height + sine * drum.radius]
        beside = np.sqrt(max(0.0, rim @ rim - (rim @ drum.axis) ** 2))
        balls.append(np.hypot(rim @ drum.axis, beside + drum.radius))
    ball = min(max(balls), np.linalg.norm(centre) + drum.ball)
    lever, height = np.hypot(centre @ along, centre @ across), centre @ axis
    radius = min(max(radii), ball, lever + drum.ball)
    low, high = max(min(ends), -ball, height - drum.ball), min(max(ends), ball, height + drum.ball)
    return float(radius), float(low), float(max(low, high)), float(ball)


def test_a_drum_about_another_axis_is_what_circle_box_and_ball_allow(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Also that it holds what it should: points of the drum that lie in its ball."""
    for _ in range(count(20_000)):
        drum, axis = random_drum(rng)
        with np.errstate(all="raise"):
            found = _about_axis(drum, axis)
        numbers = [found.radius, found.low, found.high, found.ball]
        np.testing.assert_allclose(numbers, drum_about(drum, axis), atol=1e-7)
        assert (found.axis == axis).all() and not found.origin.any() and not found.centre.any()
        beside = np.cross(drum.axis, rng.normal(size=(200, 3)))
        beside *= drum.radius / np.linalg.norm(beside, axis=1)[:, None]
        points = drum.origin + rng.choice([drum.low, drum.high], 200)[:, None] * drum.axis + beside
        points = points[np.linalg.norm(points - drum.centre, axis=1) <= drum.ball]
        height = points @ axis
        assert (np.linalg.norm(points - height[:, None] * axis, axis=1) <= found.radius + 1e-9).all()
        assert ((found.low - 1e-9 <= height) & (height <= found.high + 1e-9)).all()
        assert (np.linalg.norm(points, axis=1) <= found.ball + 1e-9).all()


@pytest.mark.parametrize(("lower", "upper"), [(-0.3, 0.8), (-0.8, 0.3), (0.2, 0.3), (-0.3, -0.2)])
def test_sliding_moves_both_ends_of_a_drum_and_widens_its_ball(lower: float, upper: float) -> None:
    drum = _Drum(np.zeros(3), np.array([1.0, 0, 0]), 0.1, -0.2, 0.5, np.zeros(3), 0.6)
    slid = _slid(drum, lower, upper)
    assert (slid.radius, slid.origin is drum.origin, slid.axis is drum.axis) == (0.1, True, True)
    farther = 0.3 if upper < 0.4 and lower > -0.4 else 0.8
    np.testing.assert_allclose([slid.low, slid.high, slid.ball], [lower - 0.2, upper + 0.5, 0.6 + farther])
