"""Random cells: an arm on a random path, people about it, and the cycle check that is to judge them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from math import factorial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from failsafe.plan import PlanOutcome, PlanResult, PlanSettings
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.silence import Silence
from failsafe.trajectory import FitSettings, IntendedTrajectory, fit_samples
from occupancy.body import ALL_PARTS, Point, Profile, load_profile
from occupancy.humans.iso13855 import Iso13855
from occupancy.measurement import GateSettings
from robots.catalog import RobotSetup, load_robot
from robots.model import Mount, RobotModel
from tests.oracles.arms import ARMS, MESH_ARMS, urdf_file
from tests.oracles.arms import arm as oracle_arm
from tests.oracles.situation import Person
from tests.oracles.urdf_arm import Arm
from tests.soundness.persons import LEGS, Truth, random_truth, told

Array = NDArray[np.float64]
Path = Callable[[Array], Array]

STANDSTILL_M_S = 1e-3
STEP_S = 0.5e-3
FAR_M = 9.0
SPEEDS = (0.4, 0.8, 1.6, 2.0)
MOUNT = Mount.from_xyz_rpy((0.3, -0.2, 0.5), (20.0, -15.0, 70.0))
MADE_UP_LIMITS = {
    "rail": {"acceleration_m_s2": 5.0, "jerk_m_s3": 80.0},
    "turn": {"acceleration_rad_s2": 10.0, "jerk_rad_s3": 200.0},
    "bend": {"acceleration_rad_s2": 12.0, "jerk_rad_s3": 300.0},
    "twist": {"acceleration_rad_s2": 20.0, "jerk_rad_s3": 500.0},
}


@dataclass(frozen=True)
class Cell:
    """Everything about one situation but how far away the people stand.

    ``trajectory`` is what the planner gets; ``path`` gives the positions (T, n) that the arm is commanded at
    path parameters (T,): the same, or what the trajectory was fitted to; the arm is within ``error`` (n,) of
    that, and no joint's velocity is farther from it than ``dq_error`` (n,).
    """

    robot: RobotModel
    arm: Arm
    trajectory: IntendedTrajectory
    path: Path
    error: Array
    dq_error: Array
    settings: PlanSettings
    leaves_path: bool
    state: tuple[float, float, float]
    profile: Profile
    held: float
    parts: int
    gate: GateSettings
    stamps: tuple[float, float]
    people: tuple[Truth, ...]
    places: Array
    ways: Array
    t: float = 100.0

    @property
    def late(self) -> float:
        """By how much a point may have been seen before its stamp [s]."""
        return self.gate.clock_error_s + self.gate.stamp_error_s

    def placed(self, distance: float) -> tuple[Truth, ...]:
        """The people, each with a body point ``distance`` [m] off a place on the arm, on its own way."""
        return tuple(
            truth.shifted(place + distance * way)
            for truth, place, way in zip(self.people, self.places, self.ways, strict=True)
        )

    def known_to_checker(self, distance: float) -> list[Person]:
        """What the brute-force checker is told about the people."""
        speed = float(self.profile.speed.max())
        return [
            told(truth, self.stamps, self.late, speed, self.parts, self.held)
            for truth in self.placed(distance)
        ]


@cache
def robot_model(name: str, mounted: bool) -> RobotModel:
    """An arm as the verifier knows it."""
    mount = MOUNT if mounted else Mount()
    if name in MESH_ARMS:
        return load_robot(name, setup=RobotSetup(bare_flange=True, mount=mount))
    return load_robot(urdf_file(name), setup=RobotSetup(bare_flange=True, mount=mount, limits=MADE_UP_LIMITS))


@cache
def brute_arm(name: str, mounted: bool) -> Arm:
    """An arm as the brute-force checker knows it."""
    if not mounted:
        return oracle_arm(name)
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = MOUNT.rotation, MOUNT.translation
    return oracle_arm(name).mounted(base)


@cache
def profile_of(speed: float) -> Profile:
    """The profile *iso* with another speed of all points."""
    return load_profile("iso").with_speed(speed)


@cache
def human_model(profile: Profile, held: float) -> Iso13855:
    """The model of people, made once per profile."""
    return Iso13855(profile, held_object_m=held)


@dataclass(frozen=True)
class Bounds:
    """What random cells are drawn from; ablations narrow it to where their term matters."""

    robots: tuple[str, ...] = tuple(ARMS)
    speeds: tuple[float, ...] = SPEEDS
    cycle_s: tuple[float, ...] = (0.01, 0.01, 0.02, 0.05, 0.1)
    slice_s: tuple[float, ...] = (0.004, 0.01, 0.02, 0.05, 0.2)
    latency_s: tuple[float, float] = (0.0, 0.2)
    delay_s: tuple[float, float] = (0.0, 0.05)
    q_error: tuple[float, float] = (0.0, 0.02)
    dq_error: tuple[float, ...] = (0.0, 0.02)
    error_m: tuple[float, float] = (0.0, 0.05)
    clock_s: tuple[float, float] = (0.0, 0.03)
    pace: tuple[float, float] = (0.3, 1.0)
    strides: tuple[float, ...] = (0.1, 0.3, 0.6)
    people: tuple[int, ...] = (1, 1, 1, 2, 3)
    legs: tuple[bool, ...] = (False, False, True)
    held: tuple[float, ...] = (0.0, 0.0, 0.1)
    joint_space: float = 0.15
    fitted: float = 0.25
    silence: float = 0.0
    mounted: float = 0.25
    behind: bool = False
    busy: int = 0
    """Derivative of the path that some joint has most of where the plan is made: 1 or 2; 0: anywhere."""
    parts: int = ALL_PARTS
    nearest: tuple[Point, ...] = tuple(Point)
    visibility: Callable[[Truth], Truth] = field(default=lambda truth: truth)


def random_cell(rng: np.random.Generator, bounds: Bounds | None = None) -> Cell:
    """Return a cell whose plan exists."""
    bounds = Bounds() if bounds is None else bounds
    while True:
        cell = _draw(rng, bounds)
        if planned(cell)[1].outcome is PlanOutcome.READY:
            return cell


def _draw(rng: np.random.Generator, bounds: Bounds) -> Cell:
    name, mounted = str(rng.choice(bounds.robots)), bool(rng.random() < bounds.mounted)
    robot = robot_model(name, mounted)
    n = len(robot.joints)
    spline = random_path(rng, robot, float(rng.uniform(*bounds.pace)), bounds.strides)
    path: Path = spline
    trajectory = exact(spline)
    error = q_error = np.full(n, rng.uniform(*bounds.q_error)) * rng.choice([0.0, 1.0, rng.random()])
    swing = dq_error = np.full(n, float(rng.choice(bounds.dq_error)))
    if rng.random() < bounds.fitted:
        t = np.arange(spline.t[spline.k], spline.t[-spline.k - 1], 4e-3)
        trajectory = fit_samples(t, spline(t), FitSettings(float(rng.uniform(0.05, 0.2)), 5)).trajectory
        dense = np.arange(t[0], t[-1], STEP_S)
        fitted = trajectory.sample(dense)
        q_error = q_error + 1.001 * np.abs(spline(dense) - fitted[0]).max(axis=0) + 1e-9
        dq_error = dq_error + 1.001 * np.abs(spline(dense, 1) - fitted[1]).max(axis=0) + 1e-9
    cycle = float(rng.choice(bounds.cycle_s))
    sdot = float(rng.choice([1.0, 1.0, rng.uniform(0.1, 1.0)]))
    sddot = (
        0.0 if sdot == 1.0 else float(rng.uniform(-1.0, 1.0) * min(1.0, (1.0 - sdot) / cycle, sdot / cycle))
    )
    speed = float(rng.choice(bounds.speeds))
    delay = np.sort(rng.uniform(*bounds.delay_s, 2)) * rng.choice([0.0, 1.0])
    latency, between = float(rng.uniform(*bounds.latency_s)), float(rng.uniform(0.02, 0.3))
    seen_within = float(rng.uniform(*bounds.error_m))
    number = int(rng.choice(bounds.people))
    parts = bounds.parts & (ALL_PARTS if rng.choice(bounds.legs) else ~LEGS)
    clock, stamp = rng.uniform(*bounds.clock_s, 2) * rng.choice([0.0, 1.0], 2)
    t, s = 100.0, float(rng.uniform(0.1, trajectory.s_end - 0.1))
    if bounds.busy:
        s = max(0.1, _busiest(spline, robot, bounds.busy) - 0.5 * cycle)
    beginning = path(np.array([s, s + 0.01]))
    stands = [_stand(rng, brute_arm(name, mounted), beginning, bounds.behind) for _ in range(number)]
    people = tuple(
        bounds.visibility(random_truth(rng, f"p{k}", -speed * between * way, seen_within))
        for k, (_, way) in enumerate(stands)
    )
    return Cell(
        robot=robot,
        arm=brute_arm(name, mounted),
        trajectory=trajectory,
        path=path,
        error=error,
        dq_error=swing,
        settings=PlanSettings(
            cycle_s=cycle,
            delay=(float(delay[0]), float(delay[1])),
            q_error=q_error,
            dq_error=dq_error,
            slice_s=float(rng.choice(bounds.slice_s)),
            silence=_silence(rng, robot) if bounds.silence and rng.random() < bounds.silence else None,
        ),
        leaves_path=bool(rng.random() < bounds.joint_space),
        state=(s, sdot, sddot),
        profile=profile_of(speed),
        held=float(rng.choice(bounds.held)),
        parts=parts,
        gate=GateSettings(float(clock), float(stamp), position_error_m=0.0, believe_repeats=True),
        stamps=(t - latency - between, t - latency),
        people=people,
        places=np.stack(
            [
                place - x.points[rng.choice(bounds.nearest)]
                for (place, _), x in zip(stands, people, strict=True)
            ]
        ),
        ways=np.stack([way * (rng.uniform(1.0, 1.5) if k else 1.0) for k, (_, way) in enumerate(stands)]),
        t=t,
    )


def _silence(rng: np.random.Generator, robot: RobotModel) -> Silence:
    """How an arm may stop by itself: from as hard as its limits allow down to a fifth of that."""
    hold = float(rng.choice([0.0, rng.uniform(0.0, 0.1)]))
    share = rng.uniform(0.2, 1.0, len(robot.joints))
    return Silence(hold, bool(rng.random() < 0.5), share * robot.limits.acceleration)


def _stand(rng: np.random.Generator, arm: Arm, q: Array, behind: bool) -> tuple[Array, Array]:
    """A place (3,) on a moving link at the first of the joint positions ``q`` (2, n), and a way.

    The way, a unit vector (3,), is mostly level; ``behind``: it leads where that place comes from.
    """
    rotations, positions = arm.poses(q)
    link = int(rng.integers(len(arm.links)))
    point = arm.points[link][rng.integers(len(arm.points[link]))]
    place, soon = rotations[link] @ point + positions[link]
    angle, height = rng.uniform(-np.pi, np.pi), rng.normal() * 0.3
    way = np.array([np.cos(angle), np.sin(angle), height])
    if behind:
        way = place - soon + 1e-9 * way
    return place, way / np.linalg.norm(way)


def random_path(
    rng: np.random.Generator, robot: RobotModel, pace: float, strides: tuple[float, ...]
) -> BSpline:
    """A spline of degree 5 through random postures, at ``pace`` times what the limits of the arm allow.

    From one posture to the next each joint goes about one of the ``strides`` [rad or m].
    """
    limits = robot.limits
    low, high = np.maximum(limits.position_lower, -np.pi), np.minimum(limits.position_upper, np.pi)
    middle, reach = 0.5 * (low + high), 0.4 * (high - low)
    postures = middle + reach * rng.uniform(-1.0, 1.0, (1, len(low)))
    steps = rng.normal(size=(9, len(low))) * rng.choice(strides, (1, len(low)))
    postures = np.clip(postures + np.cumsum(steps, axis=0), middle - reach, middle + reach)
    spline = make_interp_spline(np.arange(9.0), postures, k=5)
    fine = np.linspace(0.0, 8.0, 2001)
    worst = [
        (np.abs(spline(fine, d)).max(axis=0) / limit).max() ** (1.0 / d)
        for d, limit in ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk))
    ]
    stretch = max(worst) / (0.8 * pace)
    return BSpline(spline.t * stretch, spline.c, 5)


def _busiest(spline: BSpline, robot: RobotModel, derivative: int) -> float:
    """Where on the path some joint is fastest (1), or accelerates most (2)."""
    at = np.linspace(0.2, spline.t[-1] - 0.5, 1000)
    limit = robot.limits.velocity if derivative == 1 else robot.limits.acceleration
    share = np.abs(spline(at, derivative)) / limit
    return float(at[np.argmax(share.max(axis=1))])


def exact(spline: BSpline) -> IntendedTrajectory:
    """The spline as a trajectory of the planner."""
    breaks = np.unique(spline.t)
    powers = [spline(breaks[:-1], d) / factorial(d) for d in range(spline.k + 1)]
    return IntendedTrajectory(breaks, np.stack(powers, axis=1))


def planned(cell: Cell) -> tuple[ShortTermPlanner, PlanResult]:
    """Plan the cell's cycle."""
    planner = ShortTermPlanner(cell.robot.limits, cell.settings)
    if cell.leaves_path:
        planner._manoeuvre.search = _finds_nothing
    s, sdot, sddot = cell.state
    return planner, planner.plan(cell.trajectory, cell.t, s, sdot, sddot)


def _finds_nothing(*_: object) -> bool:
    """Stands for a search that found no stop on the path, as it hardly ever does: joints then stop singly."""
    return False
