"""Crowds of random bodies that use up the limits of a profile: the truth, and what a sensor says about it.

Every crowd fills the people block with 16 persons and a plan of three slices. With an *aligned* crowd,
motions, errors and limbs all point one way, clocks and stamps are wrong by as much as they may, and bounds
are attained.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Point, Profile
from occupancy.humans.kernels import estimate_velocities, write_points
from occupancy.hypotheses import HISTORY, PEOPLE, READING
from occupancy.sets import MAX_PEOPLE
from robots.motion import Block, new_slices
from tests.occupancy.body_kernels import accelerate_points, move_bodies, places, shape_bodies
from tests.occupancy.moving_people import unit

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NOW = 10.0
"""Stamp of the newest report [s]."""
SLICES, INSTANTS = 3, 5
PIECES = 8
SHAPE = (MAX_PEOPLE, MAX_POINTS)
STILL = np.zeros(3)
BEGIN = (-0.4, -0.02, 0.0, 0.02, 0.1, 0.4)
"""Begin of a plan after the newest report [s]; before it, if that was very late."""


def _tree() -> Indices:
    """Points in the order in which they are placed, each with its parent, and what it lies towards."""
    order: list[tuple[int, int, int]] = [(Point.PELVIS, -1, -1)]
    order += [(Point.NECK_BASE, Point.PELVIS, -1), (Point.HEAD, Point.NECK_BASE, -1)]
    order.append((Point.THORAX, Point.NECK_BASE, Point.PELVIS))
    for side in "LR":
        s, e, w, h, f, hip, knee, ankle = (
            Point[f"{side}_{name}"]
            for name in ("SHOULDER", "ELBOW", "WRIST", "HAND", "FINGERTIP", "HIP", "KNEE", "ANKLE")
        )
        order += [(s, Point.NECK_BASE, -1), (e, s, -1), (w, e, -1), (f, w, -1), (h, w, f)]
        order += [(hip, Point.PELVIS, -1), (knee, hip, -1), (ankle, knee, -1)]
    return np.array(order, dtype=np.int64)


TREE = _tree()


@dataclass(frozen=True)
class Skeleton:
    """How bodies hang together, for a whole crowd.

    ``tables`` as kernels take them; ``speed`` (16, 20) [m/s]: what each point may use up without tearing a
    limb.
    """

    tables: tuple[Indices, Array, Array]
    speed: Array

    @classmethod
    def random(cls, rng: np.random.Generator, profile: Profile) -> Skeleton:
        """Bodies with limbs as long as the profile has them, turned anyhow."""
        tree, longest, between = TREE, np.full(SHAPE, np.inf), np.zeros(SHAPE)
        speed = np.tile(profile.speed, (MAX_PEOPLE, 1))
        for p, parent, other in tree:
            if parent >= 0 and other < 0:
                longest[:, p] = profile.chain[p, parent]
        between[:, Point.THORAX] = rng.choice([0.0, 0.5, 0.3], MAX_PEOPLE)
        for side in "LR":
            hand, tip = Point[f"{side}_HAND"], Point[f"{side}_FINGERTIP"]
            between[:, hand] = rng.choice([0.0, 1.0, 0.5], MAX_PEOPLE)
            speed[:, tip] = min(profile.speed[tip], profile.speed[hand])
        return cls((tree, longest, between), speed)

    def shape(self, rng: np.random.Generator, along: Array) -> Array:
        """Random bodies (16, 20, 3) [m], all limbs along ``along`` if it is not 0."""
        x = np.empty((*SHAPE, 3))
        shape_bodies(rng, self.tables, along, x)
        return x


@dataclass(frozen=True)
class Pieces:
    """Motions of n points: from ``t[i]`` [s] on, x + h v + a h² / 2; ``x``, ``v``, ``a`` (n, B, 3)."""

    t: Array
    x: Array
    v: Array
    a: Array

    def at(self, when: Array) -> tuple[Array, Array]:
        """Positions [m] and velocities [m/s] (n, m, 3) at ``when`` (n, m) or (m,) [s]."""
        instants = np.ascontiguousarray(np.broadcast_to(when, (len(self.x), np.shape(when)[-1])))
        place, velocity = np.empty((*instants.shape, 3)), np.empty((*instants.shape, 3))
        places(self.t, self.x, self.v, self.a, instants, place, velocity)
        return place, velocity


@dataclass(frozen=True)
class Watch:
    """When reports see people and when the robot moves: a plan, errors, and the instants that matter.

    ``along`` (3,): the direction of everything that is aligned, or 0; ``seen`` (16, 20): whether a report
    shows a point, ``instant`` (16, 20) [s]: when it truly was seen, ``t_obs`` (16, 20) [s]: what the block
    says; ``times`` (slices, instants) [s].
    """

    plan: Block
    stamp_error: float
    clock_error: float
    along: Array
    later: bool
    seen: NDArray[np.bool_]
    instant: Array
    t_obs: Array
    times: Array

    @property
    def aligned(self) -> bool:
        return bool(self.along.any())

    @property
    def push(self) -> Array:
        """Where errors of position point that lead out of the set."""
        return -self.along if self.later else self.along

    def breaks(self, rng: np.random.Generator, earlier: float = 0.0) -> Array:
        """Instants (PIECES + 1,) at which motions may change, from ``earlier`` [s] than all to after it."""
        used = self.instant[self.seen]
        low, high = min(used.min(), self.times.min()), max(used.max(), self.times.max())
        low, high = low - earlier - 1e-3, high + 1e-3
        inner = np.sort(rng.uniform(low, high, PIECES - 1))
        t = np.concatenate([[low], inner, [high]])
        return t if (np.diff(t) > 1e-6).all() else np.linspace(low, high, PIECES + 1)


def watch(
    rng: np.random.Generator,
    *,
    aligned: bool,
    along: Array | None = None,
    lost: bool = True,
    ages: bool = True,
    after: bool = False,
) -> Watch:
    """Draw reports and a plan.

    With ``lost``, points are missing, with ``ages``, some are older; with ``after``, the plan begins no
    earlier than the newest report.
    """
    along = (unit(rng, 1)[0] if along is None else along) if aligned else STILL
    errors = rng.uniform(0.0, 0.02, 2) * rng.choice([0.0, 1.0], 2)
    begin = NOW + float(rng.choice(BEGIN[2:5] if after else BEGIN))
    later = begin > NOW - 0.1
    plan = new_slices()
    record = plan[0]
    record["n"] = SLICES
    record["t"][: SLICES + 1] = begin + np.cumsum([0.0, *rng.uniform(0.002, 0.05, SLICES)])
    record["delay"] = np.sort(rng.uniform(0.0, 0.03, 2)) * rng.choice([0.0, 1.0])
    span = record["t"][:SLICES] + record["delay"][0], record["t"][1 : SLICES + 1] + record["delay"][1]
    share = np.sort(rng.random((SLICES, INSTANTS)), axis=1)
    share[:, 0], share[:, -1] = 0.0, 1.0
    times = span[0][:, None] + share * (span[1] - span[0])[:, None]
    stamps = NOW - np.cumsum([0.0, *rng.uniform(0.01, 0.3, 2)])
    off = rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], (MAX_PEOPLE, 3, 2))
    if aligned:
        off[:] = -1.0 if later else 1.0
    instant = stamps + off @ errors
    number = np.zeros(SHAPE, np.int64)
    if ages:
        newest = rng.choice([1.0, 0.7, 0.3], (MAX_PEOPLE, 1))
        number = np.where(rng.random(SHAPE) < newest, 0, rng.integers(1, 3, SHAPE))
    seen = np.ones(SHAPE, bool)
    if lost:
        seen = rng.random(SHAPE) >= rng.choice([0.0, 0.2, 0.8], (MAX_PEOPLE, 1))
        seen[np.arange(MAX_PEOPLE), rng.integers(MAX_POINTS, size=MAX_PEOPLE)] = True
    people = np.arange(MAX_PEOPLE)[:, None]
    return Watch(
        plan,
        errors[0],
        errors[1],
        along,
        later,
        seen,
        instant[people, number],
        stamps[number] - errors[0],
        times,
    )


@dataclass(frozen=True)
class Crowd:
    """What is known of 16 persons, a plan, and where all points truly are on it.

    ``at`` (slices, instants, 16, 20, 3) [m] at ``times`` (slices, instants) [s].
    """

    people: Block
    plan: Block
    at: Array
    times: Array


def known(seen: Watch, x: Array, e_p: Array, off: Array) -> Block:
    """The people block of points that truly were at ``x`` (16, 20, 3), seen ``e_p`` (16, 20) [m] ``off``."""
    people = np.zeros(1, dtype=PEOPLE)
    record = people[0]
    record["n"], record["stamp_error"], record["clock_error"] = MAX_PEOPLE, seen.stamp_error, seen.clock_error
    record["person"], record["t_complete"] = np.arange(MAX_PEOPLE), -math.inf
    record["present"] = (seen.seen << np.arange(MAX_POINTS)).sum(axis=1)
    there = seen.seen[..., None]
    record["xyz"] = np.where(there, x + e_p[..., None] * off, math.nan)
    record["e_p"], record["t_obs"] = (np.where(seen.seen, each, math.nan) for each in (e_p, seen.t_obs))
    record["e_v"] = math.inf
    return people


def _off(rng: np.random.Generator, seen: Watch, towards: Array | None = None) -> Array:
    """Directions (16, 20, 3) of errors: at random, or ``towards`` (3,), outwards if it is not given."""
    if not seen.aligned:
        return unit(rng, MAX_PEOPLE * MAX_POINTS).reshape(*SHAPE, 3)
    return np.tile(seen.push if towards is None else towards, (*SHAPE, 1))


def _errors(rng: np.random.Generator, *, aligned: bool, most: float = 0.05) -> Array:
    """Position errors (16, 20) [m]: of each point its own, or the same for all, or none."""
    e_p = np.tile(rng.uniform(0.0, most, (MAX_PEOPLE, 1)), (1, MAX_POINTS))
    if not aligned and rng.random() < 0.5:
        e_p = rng.uniform(0.0, most, SHAPE)
    return e_p * rng.choice([0.0, 1.0, 1.0], (MAX_PEOPLE, 1))


def _where(pieces: Pieces, times: Array) -> Array:
    """Points (slices, instants, 16, 20, 3) at ``times`` (slices, instants)."""
    x, _ = pieces.at(times.ravel())
    return np.ascontiguousarray(x.reshape(*SHAPE, *times.shape, 3).transpose(2, 3, 0, 1, 4))


def bodies(
    rng: np.random.Generator,
    profile: Profile,
    *,
    aligned: bool,
    along: Array | None = None,
) -> Crowd:
    """Bodies whose points keep to speeds and limbs, bang-bang in velocity."""
    seen = watch(rng, aligned=aligned, along=along)
    skeleton = Skeleton.random(rng, profile)
    t = seen.breaks(rng)
    x, v = (np.empty((MAX_PEOPLE, PIECES, MAX_POINTS, 3)) for _ in range(2))
    x[:, 0] = skeleton.shape(rng, seen.along)
    failed = move_bodies(rng, t, skeleton.tables, skeleton.speed, seen.along, x, v)
    assert failed == 0, "a child point that is slower than its parent may tear its limb"
    x, v = (np.ascontiguousarray(each.transpose(0, 2, 1, 3)).reshape(-1, PIECES, 3) for each in (x, v))
    pieces = Pieces(t, x, v, np.zeros_like(x))
    true, _ = pieces.at(seen.instant.reshape(-1, 1))
    people = known(seen, true.reshape(*SHAPE, 3), _errors(rng, aligned=aligned), _off(rng, seen))
    return Crowd(people, seen.plan, _where(pieces, seen.times), seen.times)


# ----------------------------------------------------------------------------------------------- acceleration


def flat(profile: Profile, speed: float, acceleration: float) -> Profile:
    """A profile with one speed [m/s] and one acceleration [m/s²] for every point."""
    limits = profile.limits.copy()
    limits["speed"], limits["acceleration"] = speed, acceleration
    points = np.ones(MAX_POINTS)
    return replace(profile, speed=speed * points, acceleration=acceleration * points, limits=limits)


def accelerating(rng: np.random.Generator, profile: Profile, *, aligned: bool, without: str = "") -> Crowd:
    """Bodies whose points keep to speeds and accelerations, bang-bang in acceleration.

    In some crowds every point moves on its own and all are seen, in others bodies move as a whole and
    points are missing. Velocities are stated within errors, or found from earlier reports, with a bound
    ``without`` what ``positions``, ``acceleration`` or ``times`` add to it.
    """
    own = rng.random() < 0.5
    seen = watch(rng, aligned=aligned, lost=not own, ages=not own, after=aligned)
    readings = int(rng.integers(1, 6)) if own and rng.random() < 0.5 else 0
    gap = float(rng.uniform(0.004, 0.05))
    t = seen.breaks(rng, earlier=readings * gap + 4.0 * (seen.stamp_error + seen.clock_error))
    n = MAX_PEOPLE * MAX_POINTS if own else MAX_PEOPLE
    speed, limit = (
        np.tile(each, MAX_PEOPLE) if own else np.full(n, each.min())
        for each in (profile.speed, profile.acceleration)
    )
    x, v, a = (np.zeros((n, PIECES, 3)) for _ in range(3))
    x[:, 0] = rng.uniform(-2.0, 2.0, (n, 3))
    accelerate_points(rng, t, speed, limit, seen.along, x, v, a)
    if own:
        _hold_hands_together(rng, profile, x, v, a)
    else:
        x, v, a = (np.repeat(each, MAX_POINTS, axis=0) for each in (x, v, a))
        shape = Skeleton.random(rng, profile).shape(rng, seen.along)
        x += (shape - shape[:, [Point.PELVIS]]).reshape(-1, 1, 3)
    pieces = Pieces(t, x, v, a)
    e_p = _errors(rng, aligned=aligned, most=0.03)
    if readings:
        people = _tracked(rng, seen, pieces, profile, e_p, gap * np.arange(readings, -1, -1), without)
    else:
        people = _stated(rng, seen, pieces, e_p)
    return Crowd(people, seen.plan, _where(pieces, seen.times), seen.times)


def _hold_hands_together(rng: np.random.Generator, profile: Profile, x: Array, v: Array, a: Array) -> None:
    """Let hand and fingertip move with the wrist, no farther from it than a hand is long."""
    for each in (x, v, a):
        persons = each.reshape(*SHAPE, PIECES, 3)
        for side in "LR":
            wrist, hand, tip = (Point[f"{side}_{name}"] for name in ("WRIST", "HAND", "FINGERTIP"))
            persons[:, [hand, tip]] = persons[:, [wrist]]
            if each is x:
                size = profile.chain[wrist, tip] * rng.random((MAX_PEOPLE, 1, 1))
                persons[:, tip] += size * unit(rng, MAX_PEOPLE)[:, None]


def _stated(rng: np.random.Generator, seen: Watch, pieces: Pieces, e_p: Array) -> Block:
    """The people block with velocities that are known within random errors, of some persons not at all."""
    place, velocity = (each.reshape(*SHAPE, 3) for each in pieces.at(seen.instant.reshape(-1, 1)))
    people = known(seen, place, e_p, _off(rng, seen))
    e_v = rng.uniform(0.0, 0.5, SHAPE) * rng.choice([0.0, 1.0], (MAX_PEOPLE, 1))
    wrong = velocity + e_v[..., None] * _off(rng, seen)
    people["v"][0] = np.where(seen.seen[..., None], wrong, 0.0)
    unknown = ~seen.seen | (rng.random((MAX_PEOPLE, 1)) < 0.1)
    people["e_v"][0] = np.where(unknown, math.inf, e_v)
    return people


IN_BOUND = {"acceleration": "acceleration", "times": "speed"}
"""Term of the bound of a velocity -> the limit that stands in it, and in no other."""


def _tracked(
    rng: np.random.Generator,
    seen: Watch,
    pieces: Pieces,
    profile: Profile,
    e_p: Array,
    before: Array,
    without: str,
) -> Block:
    """The people block after reports ``before`` (m,) [s] the newest, the last of them; all is seen."""
    history, limits, read = np.zeros(1, dtype=HISTORY), profile.limits.copy(), np.zeros(1, dtype=READING)[0]
    if without in IN_BOUND:
        limits[IN_BOUND[without]] = 0.0
    people = known(seen, np.zeros((*SHAPE, 3)), e_p, np.zeros((*SHAPE, 3)))
    people["present"] = 0
    for back in before:
        off = np.ones((MAX_PEOPLE, 2)) if seen.aligned else rng.choice([-1.0, 1.0, 0.0], (MAX_PEOPLE, 2))
        late = (off @ [seen.stamp_error, seen.clock_error])[:, None]
        instant = seen.instant if back == 0.0 else seen.t_obs + seen.stamp_error - back + late
        true = pieces.at(instant.reshape(-1, 1))[0].reshape(*SHAPE, 3)
        x = true + e_p[..., None] * _off(rng, seen, seen.along if back > 0.0 else None)
        for k in range(MAX_PEOPLE):
            read["present"], read["t_obs"] = (1 << MAX_POINTS) - 1, seen.t_obs[k, 0] - back
            read["xyz"], read["e_p"] = x[k], 0.0 if without == "positions" else e_p[k]
            belied = estimate_velocities(people[0], k, read, history[0], limits[0])
            assert belied < 0 or without, "an admissible motion must not belie itself"
            read["e_p"] = e_p[k]
            write_points(people[0], k, read)
    return people
