"""The potential of a configuration beside people, as they are and as they are forecast: (5) and (6).

The paper sums an influence Φ(d) over points of the arm, parts of people and frames of the forecast, and
takes d from the *axes* of both. No gap is below 0 then, and its hard penalty is never met. Here d is from
surface to surface; the printed sum is beside it. Its threshold of 20 means nothing without its weights, radii
and numbers of points, none of which are given. What a planner asks here is the least gap itself: 250 mm, the
clearance that the paper reports; :meth:`Field.calibrated` gives the sum that stands for it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.people_capsules import around_parts
from modes.planning import kernels
from modes.planning.polynomials import speed_bounds
from modes.settings import require_choice, require_number, require_numbers
from occupancy.body import Part, Profile
from robots.errors import SetupError
from robots.model import RobotModel

Array = NDArray[np.float64]
Variant = Literal["surface", "as_printed"]
VARIANTS: tuple[Variant, ...] = ("surface", "as_printed")

_FAR_M = 10.0
MOTION_SLACK_M = 0.01
"""By how much motion may come nearer than the clearance [m]: as edges may, and as much for its corners."""


@dataclass(frozen=True, slots=True)
class FieldSettings:
    """What the potential is made of.

    Attributes
    ----------
    clearance_m:
        Gap from every body part that is wanted [m]; the paper reports more than 250 mm.
    reach_m:
        d_th: beyond this gap nothing counts [m]; the paper does not give it.
    decay:
        Weight of each frame of a forecast over that of the frame before it; the paper does not give it.
    spacing_m:
        Points on the axes of links are no farther apart [m].
    variant:
        Gaps of surfaces, or as printed: distances of axes.
    """

    clearance_m: float = 0.25
    reach_m: float = 0.5
    decay: float = 0.9
    spacing_m: float = 0.05
    variant: Variant = "surface"

    def __post_init__(self) -> None:
        require_choice("potential field: variant", self.variant, VARIANTS)
        require_number("potential field: clearance_m", self.clearance_m, 0.0, 5.0)
        require_number("potential field: reach_m", self.reach_m, 0.0, 10.0, above=True)
        require_number("potential field: decay", self.decay, 0.0, 1.0)
        require_number("potential field: spacing_m", self.spacing_m, 1e-3, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Fixtures:
    """What stands in the cell, as capsules; planned around, and not believed by the supervisor.

    Attributes
    ----------
    a, b:
        ``(k, 3)`` ends of the axes [m].
    radius:
        ``(k,)`` [m].
    gap_m:
        That is kept from them [m].

    Raises
    ------
    SetupError
        Shapes do not fit, a number is not finite, or a radius is negative.
    """

    a: Array
    b: Array
    radius: Array
    gap_m: float = 0.02

    def __post_init__(self) -> None:
        radius = require_numbers("fixtures: radius", self.radius, (-1,))
        if (radius < 0.0).any():
            raise SetupError(f"fixtures: radius {radius.min():g} m should not be negative")
        object.__setattr__(self, "radius", radius)
        for name in ("a", "b"):
            ends = require_numbers(f"fixtures: {name}", getattr(self, name), (len(radius), 3))
            object.__setattr__(self, name, ends)
        require_number("fixtures: gap_m", self.gap_m, 0.0, 10.0)

    @classmethod
    def none(cls) -> Fixtures:
        """Return that nothing stands there."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class Bodies:
    """Capsules of people in one or more frames, the first of them as they are.

    Attributes
    ----------
    a, b:
        ``(frames, parts, 3)`` ends of the axes [m].
    radius:
        ``(parts,)`` [m]; below 0 where less than the clearance is kept (:meth:`beside`).
    balls:
        ``(frames + 1, parts, 5)`` centre and radius of a ball around each, the last row around all frames;
        last in it how far a part is at most from where it is in the frame in the middle [m].

    Raises
    ------
    SetupError
        Shapes do not fit, or a number is not finite.
    """

    a: Array
    b: Array
    radius: Array
    balls: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("a", "b", "radius"):  # kernels are compiled for this kind of array
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=float))
        frames, parts = len(self.a), len(self.radius)
        if not self.a.shape == self.b.shape == (frames, parts, 3) or frames == 0:
            raise SetupError(
                f"bodies: axes of shapes {self.a.shape} and {self.b.shape} do not fit {parts} radii"
            )
        if not all(np.isfinite(each).all() for each in (self.a, self.b, self.radius)):
            raise SetupError("bodies: a number is not finite; leave out parts that were not seen")
        object.__setattr__(self, "balls", _balls(self.a, self.b, self.radius))

    @classmethod
    def of_points(
        cls, frames: Sequence[Array], profile: Profile, parts: tuple[Part, ...] = tuple(Part)
    ) -> Bodies:
        """Return the capsules of people, ``(people, 20, 3)`` points [m] per frame, NaN: not seen.

        A point that a later frame lacks is taken to stay where the frame before has it; one that the first
        frames lack is taken to be where it is seen first. Of a point, all three coordinates count, or none.
        """
        if len(frames) == 0:
            raise SetupError("bodies: no frame")
        for frame in frames:
            if np.shape(frame) != np.shape(frames[0]):
                raise SetupError(f"bodies: frames of shapes {np.shape(frames[0])} and {np.shape(frame)}")
        known = np.full(np.shape(frames[0]), np.nan)
        for frame in reversed(frames):
            known = _where_seen(frame, known)
        places = []
        for frame in frames:
            known = _where_seen(frame, known)
            places.append(known)
        count, rows = len(frames), np.reshape(places, (-1, *known.shape[1:]))
        found = [around_parts(rows, (part,), profile) for part in parts]  # each has all frames of a part
        return cls(
            np.concatenate([each.a.reshape(count, -1, 3) for each in found], axis=1),
            np.concatenate([each.b.reshape(count, -1, 3) for each in found], axis=1),
            np.concatenate([each.radius.reshape(count, -1)[0] for each in found]),
        )

    @property
    def frames(self) -> int:
        """How many there are."""
        return len(self.a)

    def between(self, first: int, last: int) -> Bodies:
        """Return the frames ``first`` to ``last``, both among them."""
        return Bodies(self.a[first : last + 1], self.b[first : last + 1], self.radius)

    def beside(self, fixtures: Fixtures, clearance_m: float) -> Bodies:
        """Return these and what stands there, so that ``clearance_m`` from all of it is the gap of each.

        Whoever asks for ``clearance_m`` [m] asks for ``fixtures.gap_m`` from fixtures then.
        """
        frames, count = self.frames, len(fixtures.radius)
        a = np.broadcast_to(fixtures.a, (frames, count, 3))
        b = np.broadcast_to(fixtures.b, (frames, count, 3))
        return Bodies(
            np.concatenate((self.a, a), axis=1),
            np.concatenate((self.b, b), axis=1),
            np.concatenate((self.radius, fixtures.radius + (fixtures.gap_m - clearance_m))),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Arm:
    """Capsules and points of an arm, fixed to its joints."""

    joints: NDArray[np.int64]
    ends: Array
    skin: Array
    lever: Array
    point_joints: NDArray[np.int64]
    points: Array
    point_skin: Array


class Points(NamedTuple):
    """Points ``local`` (m, 3), each fixed to one of ``joints`` (m,); radii ``skin`` (m,) of links [m]."""

    joints: NDArray[np.int64]
    local: Array
    skin: Array


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """The potential of an arm's configurations.

    Attributes
    ----------
    robot:
        The arm.
    settings:
        Of the potential.
    """

    robot: RobotModel
    settings: FieldSettings = field(default_factory=FieldSettings)
    _arm: _Arm = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_arm", _arm_of(self.robot, self.settings.spacing_m))

    @property
    def points(self) -> Points:
        """Points on the axes of the links, of which the potential is the sum."""
        return Points(self._arm.point_joints, self._arm.points, self._arm.point_skin)

    def potentials(self, configurations: Array, bodies: Bodies) -> Array:
        """Return U of (5) for each of ``configurations`` (B, n) [rad; m]."""
        q = np.ascontiguousarray(configurations, dtype=float)
        if q.ndim != 2 or q.shape[1] != len(self.robot.joints):
            raise SetupError(
                f"potential field: configurations of shape {q.shape} do not fit {self.robot.name}"
            )
        arm, out = self._arm, np.empty(len(q))
        printed = self.settings.variant == "as_printed"
        skin, radius = (0.0 if printed else 1.0) * arm.point_skin, (0.0 if printed else 1.0) * bodies.radius
        weight = np.array([self.settings.decay**k for k in range(bodies.frames)])
        kernels.potentials(
            self.robot.kinematics, q.shape[1], q, arm.point_joints, arm.points, skin,
            bodies.a, bodies.b, radius, weight, self.settings.reach_m, out,
        )  # fmt: skip
        return out

    def clearance(self, q: Array, bodies: Bodies, enough: float = _FAR_M) -> float:
        """Return the least gap of a link from a body part in any frame at ``q`` (n,) [m]; negative: overlap.

        ``enough``: a larger one is said to be that large [m].

        Raises
        ------
        SetupError
            ``q`` has another shape.
        """
        arm = self._arm
        return float(
            kernels.clearance(
                self.robot.kinematics, len(self.robot.joints), self._fitting(q), arm.joints,
                arm.ends, arm.skin, bodies.a, bodies.b, bodies.radius, bodies.balls, enough,
                np.empty(len(arm.joints)),
            )
        )  # fmt: skip

    def is_clear(self, q: Array, bodies: Bodies) -> bool:
        """Whether the wanted clearance is kept at ``q`` (n,)."""
        return self.clearance(q, bodies) >= self.settings.clearance_m

    def is_clear_between(self, begin: Array, end: Array, bodies: Bodies, slack_m: float = 0.005) -> bool:
        """Whether it is kept, less ``slack_m`` [m], all the way straight from ``begin`` to ``end`` (n,).

        Proven by how far links can move, not sampled; both ends within the position limits. Ways of more than
        a kilometre are not proven.

        Raises
        ------
        SetupError
            ``begin`` or ``end`` has another shape, or ``slack_m`` is no number above 0.
        """
        require_number("clear between: slack_m", slack_m, 0.0, 1.0, above=True)
        arm = self._arm
        return bool(
            kernels.is_clear_between(
                self.robot.kinematics, len(self.robot.joints), self._fitting(begin),
                self._fitting(end), arm.lever, arm.joints, arm.ends, arm.skin,
                bodies.a, bodies.b, bodies.radius, bodies.balls, self.settings.clearance_m, slack_m,
            )
        )  # fmt: skip

    def is_clear_along(
        self, trajectory: IntendedTrajectory, bodies: Bodies, slack_m: float = MOTION_SLACK_M
    ) -> bool:
        """Whether the wanted clearance is kept, less ``slack_m`` [m], all along a trajectory.

        Proven like :meth:`is_clear_between`, by what bounds the speeds of joints on each of its pieces.

        Raises
        ------
        SetupError
            It is of another arm, or ``slack_m`` is no number above 0.
        """
        b = trajectory.breaks
        return self.clear_up_to(b, trajectory.coefficients, bodies, slack_m) >= float(b[-1])

    def clear_up_to(
        self, breaks: Array, coefficients: Array, bodies: Bodies, slack_m: float = MOTION_SLACK_M
    ) -> float:
        """Return up to which parameter a curve is proven to keep the wanted clearance less ``slack_m`` [m].

        ``breaks`` (M+1,), ``coefficients`` (M, 6, n): powers of what goes beyond each break, lowest first.
        Asked for everywhere that is looked at is the clearance less half of the slack, which is what straight
        lines of a :class:`~modes.planning.arrt.Planner` keep: what runs on them is proven.
        """
        require_number("clear along: slack_m", slack_m, 0.0, 1.0, above=True)
        n, arm, wanted = len(self.robot.joints), self._arm, self.settings.clearance_m
        c = np.ascontiguousarray(coefficients, dtype=float)
        if c.shape != (len(breaks) - 1, 6, n):
            raise SetupError(
                f"clear along: a curve of {c.shape[-1]} joints does not fit {self.robot.name}, {n} joints"
            )
        return float(
            kernels.clear_up_to(
                self.robot.kinematics, n, np.ascontiguousarray(breaks, dtype=float), c,
                speed_bounds(np.diff(breaks), c), arm.lever, arm.joints, arm.ends, arm.skin,
                bodies.a, bodies.b, bodies.radius, bodies.balls, wanted - 0.5 * slack_m, 0.5 * slack_m,
            )
        )  # fmt: skip

    def _fitting(self, q: Array) -> Array:
        found = np.ascontiguousarray(q, dtype=float)
        if found.shape != (len(self.robot.joints),):
            raise SetupError(f"configuration of shape {found.shape} does not fit {self.robot.name}")
        return found

    def calibrated(self, bodies: Bodies, draws: int = 2000, seed: int = 0) -> float:
        """Return the largest sum below which every drawn configuration keeps the wanted clearance.

        Configurations are drawn evenly from within the position limits. It belongs to these people and this
        arm: a sum over points and parts says how many are near, too.
        """
        random = np.random.default_rng(seed)
        limits = self.robot.limits
        low = np.maximum(limits.position_lower, -2.0 * math.pi)
        high = np.minimum(limits.position_upper, 2.0 * math.pi)
        q = random.uniform(low, high, (draws, len(low)))
        near = np.array([not self.is_clear(each, bodies) for each in q])
        return float(self.potentials(q[near], bodies).min(initial=np.inf)) if near.any() else math.inf


def _where_seen(frame: Array, known: Array) -> Array:
    """Return points of ``frame`` (..., 3) where all three coordinates are finite, else those of ``known``."""
    return np.where(np.isfinite(frame).all(axis=-1, keepdims=True), frame, known)


def _balls(a: Array, b: Array, radius: Array) -> Array:
    """Return balls around every part in each frame, and in all of them, ``(frames + 1, parts, 5)``."""
    out = np.zeros((len(a) + 1, len(radius), 5))
    out[:-1, :, :3] = 0.5 * (a + b)
    out[:-1, :, 3] = 0.5 * np.linalg.norm(b - a, axis=2) + radius
    out[-1, :, :3] = out[:-1, :, :3].mean(axis=0)
    away = np.linalg.norm(out[:-1, :, :3] - out[-1, :, :3], axis=2)
    out[-1, :, 3] = (away + out[:-1, :, 3]).max(axis=0)
    moved = [np.linalg.norm(each - each[len(a) // 2], axis=2).max(axis=0) for each in (a, b)]
    out[-1, :, 4] = np.maximum(*moved)
    return out


def _arm_of(robot: RobotModel, spacing: float) -> _Arm:
    rows, n = robot.enclosure[0], len(robot.links)
    joints, radius = rows["joint"][:n].astype(np.int64), rows["radius"][:n].copy()
    ends = np.stack((rows["a"][:n], rows["b"][:n]), axis=1)
    which, points = [], []
    for i in range(n):
        length = float(np.linalg.norm(ends[i, 1] - ends[i, 0]))
        shares = np.linspace(0.0, 1.0, max(2, math.ceil(length / spacing) + 1) if length > 0.0 else 1)
        which += [i] * len(shares)
        points += [ends[i, 0] + share * (ends[i, 1] - ends[i, 0]) for share in shares.tolist()]
    lever = np.ascontiguousarray(rows["reach"][:n, : len(robot.joints)])
    return _Arm(joints, ends, radius, lever, joints[which], np.array(points), radius[which])
