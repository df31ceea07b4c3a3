"""Random admissible people: a true body, what a sensor says about it, and where the body is later.

Independent of the model: a body is a set of capsules around segments between points, each point moves at most
at the profile's speed, neighbouring points are never farther apart than the profile's longest limbs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Part, Point, Profile
from occupancy.sets import distance_to_hull

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

H, N, T, P = Point.HEAD, Point.NECK_BASE, Point.THORAX, Point.PELVIS
SEGMENTS: dict[Part, tuple[Point, Point]] = {
    Part.HEAD: (H, H), Part.NECK: (N, H), Part.TORSO: (P, N), Part.PELVIS: (P, P),
    Part.L_UPPER_ARM: (Point.L_SHOULDER, Point.L_ELBOW), Part.L_FOREARM: (Point.L_ELBOW, Point.L_WRIST),
    Part.R_UPPER_ARM: (Point.R_SHOULDER, Point.R_ELBOW), Part.R_FOREARM: (Point.R_ELBOW, Point.R_WRIST),
    Part.L_THIGH: (Point.L_HIP, Point.L_KNEE), Part.L_SHANK: (Point.L_KNEE, Point.L_ANKLE),
    Part.R_THIGH: (Point.R_HIP, Point.R_KNEE), Part.R_SHANK: (Point.R_KNEE, Point.R_ANKLE),
    Part.L_FOOT: (Point.L_ANKLE, Point.L_ANKLE), Part.R_FOOT: (Point.R_ANKLE, Point.R_ANKLE),
}  # fmt: skip
HANDS = {
    Part.L_HAND: (Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP),
    Part.R_HAND: (Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP),
}
TREE = [
    (P, N), (N, H), (N, Point.L_SHOULDER), (N, Point.R_SHOULDER), (P, Point.L_HIP), (P, Point.R_HIP),
    *[pair for part, pair in SEGMENTS.items() if pair[0] != pair[1] and part not in (Part.NECK, Part.TORSO)],
    (Point.L_WRIST, Point.L_FINGERTIP), (Point.R_WRIST, Point.R_FINGERTIP),
]  # fmt: skip
"""Limbs from the pelvis outwards, as far as they make no loop."""


def unit(rng: np.random.Generator, n: int) -> Array:
    """Random directions (n, 3)."""
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


@dataclass(frozen=True)
class Limbs:
    """Neighbouring points ``a``, ``b`` (E,) and their longest distance (E,) [m]."""

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    longest: Array

    @classmethod
    def of(cls, profile: Profile) -> Limbs:
        limits = profile.limits[0]
        pairs = limits["limb"][: limits["n_limbs"]]
        return cls(pairs[:, 0], pairs[:, 1], profile.chain[pairs[:, 0], pairs[:, 1]])


def satisfy(points: Array, limbs: Limbs, centres: Array, reach: Array) -> bool:
    """Move points (20, 3) until no limb is too long and each is within ``reach`` of its centre.

    Alternating projections; ``reach`` (20,) [m] may be infinite. False: no such points were found.
    """
    for _ in range(100):
        off = points - centres
        far = np.linalg.norm(off, axis=1)
        beyond = far > reach
        shrink = reach[beyond] / far[beyond] * (1.0 - 1e-12)
        points[beyond] = centres[beyond] + off[beyond] * shrink[:, None]
        gap = points[limbs.b] - points[limbs.a]
        length = np.linalg.norm(gap, axis=1)
        wrong = length > limbs.longest
        if not wrong.any():
            return True
        share = 1.0 - limbs.longest[wrong] * (1.0 - 1e-9) / length[wrong]
        pull = 0.5 * gap[wrong] * share[:, None]
        np.add.at(points, limbs.a[wrong], pull)
        np.add.at(points, limbs.b[wrong], -pull)
    return False


@dataclass(frozen=True)
class Sensor:
    """Greatest errors: position [m], stamp [s], clock [s]."""

    e_p: float
    stamp_error: float
    clock_error: float


@dataclass
class Known:
    """Where each point was, ``points`` (20, 3) [m], when it was last seen, ``t`` (20,) [s], if it was."""

    points: Array
    t: Array
    seen: Flags


@dataclass(frozen=True)
class Trial:
    """Random choices of one trial.

    With ``along`` (3,), position error, motion and surface all point the same way: the bounds are attained.
    """

    rng: np.random.Generator
    profile: Profile
    sensor: Sensor
    along: Array | None

    def directions(self, n: int, sign: float = 1.0) -> Array:
        """Directions (n, 3)."""
        return unit(self.rng, n) if self.along is None else np.tile(sign * self.along, (n, 1))

    def admissible(self) -> Array:
        """Points (20, 3) of a random body, limbs often at their longest, but not too short for the gate."""
        points = np.zeros((MAX_POINTS, 3))
        points[P] = self.rng.uniform(-1.0, 1.0, 3)
        for a, b in TREE:
            length = self.profile.chain[a, b] * self.rng.choice([1.0, self.rng.uniform(0.7, 1.0)])
            points[b] = points[a] + length * unit(self.rng, 1)[0]
        down = points[P] - points[N]
        points[T] = points[N] + down * min(1.0, self.profile.chain[T, N] / np.linalg.norm(down))
        for wrist, hand, tip in HANDS.values():
            points[hand] = points[wrist] + self.rng.random() * (points[tip] - points[wrist])
        return points

    def report(self, true: Array, stamp: float) -> tuple[Array, float]:
        """What a sensor says of ``true`` (20, 3), and the instant [s, cell's clock] at which it saw it."""
        share = 1.0 if self.along is not None else self.rng.random()
        off, tick = (
            self.rng.choice([-1.0, 1.0], 2) if self.rng.random() < 0.5 else self.rng.uniform(-1.0, 1.0, 2)
        )
        xyz = true + share * self.sensor.e_p * self.directions(MAX_POINTS, -1.0)
        return xyz, stamp + off * self.sensor.stamp_error + tick * self.sensor.clock_error

    def later(self, known: Known, t: float) -> Array | None:
        """Points (20, 3) of the body at ``t``, moved mostly at full speed; ``None``: none was found."""
        share = 1.0 if self.along is not None else self.rng.choice([0.0, 0.5, 1.0])
        reach = np.where(known.seen, self.profile.speed * np.abs(t - known.t), np.inf)
        anchors, free = np.flatnonzero(known.seen), ~known.seen
        points = known.points + share * np.where(free, 0.0, reach)[:, None] * self.directions(MAX_POINTS)
        start = points[self.rng.choice(anchors, int(free.sum()))]
        points[free] = start + self.rng.choice([0.2, 3.0]) * self.directions(int(free.sum()))
        return points if satisfy(points, Limbs.of(self.profile), known.points, reach) else None

    def surface(self, points: Array, used: set[Point], part: Part, held: float) -> Array:
        """Points (6, 3) on the surface of a part whose row stands on the points ``used``."""
        if part in HANDS:
            return self._hand(points[list(HANDS[part])], self.profile.radius[part] + held)
        inner = _trunk(used, part)
        places = self.rng.choice(len(inner) - 1, 6)
        begin, end = points[inner[places]], points[inner[places + 1]]
        share = np.array([0.0, 1.0, 0.5, *self.rng.random(3)])[:, None]
        return begin + share * (end - begin) + self.profile.radius[part] * self.directions(6)

    def _hand(self, of: Array, radius: float) -> Array:
        """All of a hand and of what it holds lies within one radius of each of its points (3, 3)."""
        body = of[self.rng.integers(3, size=6)] + radius * self.directions(6)
        for _ in range(20):
            for centre in of:
                off = body - centre
                far = np.linalg.norm(off, axis=1)
                body = centre + off * np.minimum(1.0, radius * (1.0 - 1e-12) / np.maximum(far, 1e-9))[:, None]
        inside = (np.linalg.norm(body[:, None] - of[None], axis=2) <= radius).all(axis=1)
        kept: Array = body[inside]
        return kept


def _trunk(used: set[Point], part: Part) -> NDArray[np.int64]:
    """Points that a part runs through; neck and torso: through all that were used between used ends."""
    low = {Part.NECK: {P, T, N}, Part.TORSO: {P}}.get(part, set())
    high = {Part.NECK: {H}, Part.TORSO: {N, H}}.get(part, set())
    if used & low and used & high:
        return np.array([p for p in (P, T, N, H) if p in used])
    return np.array(SEGMENTS[part])


def outside(points: Array, row_points: Array, radius: float) -> float:
    """Greatest distance [m] by which points (n, 3) lie outside of a row; -inf for no points."""
    return float(each_outside(points, row_points, radius).max(initial=-np.inf))


def each_outside(points: Array, row_points: Array, radius: float) -> Array:
    """Distances (n,) [m] by which points (n, 3) lie outside of a row.

    The distance from the segments between the row's points is one bound; only where it exceeds the radius,
    that from the hull is needed.
    """
    first, second = np.triu_indices(len(row_points))
    a = row_points[first]
    along, off = row_points[second] - a, points[:, None] - a
    square = np.maximum((along * along).sum(axis=-1), 1e-30)
    share = np.clip((off * along).sum(axis=-1) / square, 0.0, 1.0)[..., None]
    far = np.sqrt(((off - share * along) ** 2).sum(axis=-1)).min(axis=-1, initial=np.inf)
    if len(row_points) > 2:
        for i in np.flatnonzero(far > radius):
            far[i] = distance_to_hull(row_points, points[i])
    return np.asarray(far - radius)
