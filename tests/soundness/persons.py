"""Random people: where they truly are, what is measured of them, and what the brute-force checker is told."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from occupancy.body import ALL_PARTS, Part, Point
from occupancy.measurement import RawMeasurement, RawPerson
from tests.oracles.situation import Person, Segment

Array = NDArray[np.float64]

TRUNK = (Point.PELVIS, Point.THORAX, Point.NECK_BASE, Point.HEAD)
HANDS = (
    (Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP),
    (Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP),
)
SEEN_TOGETHER = HANDS
"""Points of one report or of none. The model takes a hand for a ball around any of its points:
mixtures of old and new points would show bodies that it excludes."""
LEGS = sum(1 << part for part in Part if part >= Part.L_THIGH)

TORSO_RADIUS, ARM_RADIUS, HAND_RADIUS, LEG_RADIUS, FOOT_RADIUS = 0.35, 0.1, 0.205, 0.1, 0.3


@dataclass(frozen=True)
class Truth:
    """One person at the instant of the last report.

    ``points`` (20, 3) [m]; ``moved`` (3,) [m] since the report before; ``errors`` (2, 20, 3) [m] and ``seen``
    (2, 20): what the first and the last report say; ``bounds`` (20,) [m] of the errors.
    """

    name: str
    points: Array
    moved: Array
    seen: NDArray[np.bool_]
    errors: Array
    bounds: Array

    def shifted(self, by: Array) -> Truth:
        """The same person elsewhere."""
        return replace(self, points=self.points + by)

    def turned(self, by: Array) -> Truth:
        """The same person turned by the rotation ``by`` (3, 3) about the origin."""
        turned = [each @ by.T for each in (self.points, self.moved, self.errors)]
        return replace(self, points=turned[0], moved=turned[1], errors=turned[2])

    def measured(self, report: int) -> Array:
        """Points (20, 3) of report 0 (the first) or 1 (the last), NaN where there are none."""
        points = self.points - (self.moved if report == 0 else 0.0) + self.errors[report]
        return np.where(self.seen[report][:, None], points, np.nan)

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Which points (20,) are known from some report."""
        return self.seen.any(axis=0)


def random_truth(rng: np.random.Generator, name: str, way: Array, error: float) -> Truth:
    """Return a person around the origin, seen in part, who may have moved by up to ``way`` (3,) [m] since."""
    bent = rng.random() < 0.4
    points = random_body(rng, bent)
    aside = rng.normal(size=3)
    aside *= np.linalg.norm(way) / np.linalg.norm(aside)
    moved = (way if rng.random() < 0.5 else aside) * rng.choice([0.0, rng.random(), 0.999])
    seen = random_visibility(rng)
    bounds = error * (np.ones(20) if rng.random() < 0.5 else rng.random(20))
    errors = rng.normal(size=(2, 20, 3))
    errors *= rng.choice([1.0, rng.random()]) * (1.0 - 1e-12) / np.linalg.norm(errors, axis=2, keepdims=True)
    return Truth(name, points, moved, seen, errors * bounds[:, None], bounds)


def random_visibility(rng: np.random.Generator) -> NDArray[np.bool_]:
    """Points (2, 20) that the first and the last report show; never none at all."""
    kind = rng.choice(["all", "wrists", "some", "few", "aged", "not again"], p=[0.2, 0.2, 0.2, 0.1, 0.2, 0.1])
    share = {"some": 0.75, "few": 0.25}.get(kind, 1.0)
    once = rng.random(20) < share
    if kind == "wrists" or rng.random() < 0.3:
        once[[p for hand in HANDS for p in hand[1:]]] = False
    if not once.any():
        once[list(TRUNK)] = True
    again = once.copy()
    if kind == "aged":
        again &= rng.random(20) < 0.6
        for group in SEEN_TOGETHER:
            again[list(group)] = once[list(group)] & (rng.random() < 0.6)
    elif kind == "not again":
        again[:] = False
    first = once if kind in ("aged", "not again") or rng.random() < 0.5 else np.zeros(20, dtype=bool)
    return np.stack([first, again])


def random_body(rng: np.random.Generator, bent: bool) -> Array:
    """Points (20, 3) [m] of a person of 1.5 to 1.9 m, the pelvis at the origin, limbs in any direction."""
    stature = rng.uniform(1.5, 1.9)
    up, side = lean(rng, np.array([0.0, 0.0, 1.0]), 0.7), lean(rng, np.array([0.0, 1.0, 0.0]), 0.5)
    chest = lean(rng, up, 1.2) if bent else up
    x = np.zeros((20, 3))
    x[Point.THORAX] = 0.17 * stature * up
    x[Point.NECK_BASE] = x[Point.THORAX] + 0.118 * stature * chest
    x[Point.HEAD] = x[Point.NECK_BASE] + rng.uniform(0.06, 0.18) * stature * (
        lean(rng, chest, 0.5) if bent else up
    )
    for sign, arm, leg in (
        (1.0, (Point.L_SHOULDER, Point.L_ELBOW, *HANDS[0]), (Point.L_HIP, Point.L_KNEE, Point.L_ANKLE)),
        (-1.0, (Point.R_SHOULDER, Point.R_ELBOW, *HANDS[1]), (Point.R_HIP, Point.R_KNEE, Point.R_ANKLE)),
    ):
        shoulder, elbow, wrist, hand, fingertip = arm
        x[shoulder] = x[Point.NECK_BASE] + sign * rng.uniform(0.101, 0.128) * stature * side
        x[elbow] = x[shoulder] + 0.186 * stature * lean(rng, side, 3.2)
        x[wrist] = x[elbow] + 0.146 * stature * lean(rng, side, 3.2)
        palm = lean(rng, x[wrist] - x[elbow], 1.0)
        x[hand] = x[wrist] + 0.04 * stature * palm
        x[fingertip] = x[hand] + 0.06 * stature * lean(rng, palm, 1.0)
        hip, knee, ankle = leg
        x[hip] = sign * rng.uniform(0.051, 0.095) * stature * side
        x[knee] = x[hip] + 0.245 * stature * lean(rng, -up, 1.2)
        x[ankle] = x[knee] + 0.246 * stature * lean(rng, -up, 1.2)
    yaw = rng.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    return x @ turn.T


def lean(rng: np.random.Generator, direction: Array, most: float) -> Array:
    """Unit vector (3,) at most ``most`` [rad] off ``direction``."""
    direction = direction / np.linalg.norm(direction)
    across = np.cross(direction, rng.normal(size=3))
    angle = rng.uniform(0.0, most)
    return np.cos(angle) * direction + np.sin(angle) * across / np.linalg.norm(across)


def report(people: tuple[Truth, ...], number: int, stamp: float, arrived: float) -> RawMeasurement:
    """Report 0 or 1 about everybody of whom it shows a point."""
    raw = []
    for truth in people:
        seen = truth.seen[number]
        if seen.any():
            mask = sum(1 << int(p) for p in np.flatnonzero(seen))
            raw.append(RawPerson(truth.name, truth.measured(number), truth.bounds, mask))
    return RawMeasurement(stamp, arrived, "world", False, tuple(raw))


def flesh(truth: Truth, parts: int, held: float) -> tuple[Segment, ...]:
    """Parts of the body around its points, for the parts in the mask.

    A hand fills the ball around its one measured point, or around the wrist if none was measured; otherwise
    what lies in the balls around all its points.
    """
    found = [
        Segment("head", Point.HEAD, Point.HEAD, TORSO_RADIUS),
        Segment("pelvis", Point.PELVIS, Point.PELVIS, TORSO_RADIUS),
    ]
    found.append(Segment("torso", Point.PELVIS, Point.NECK_BASE, TORSO_RADIUS))
    found.append(Segment("neck", Point.NECK_BASE, Point.HEAD, TORSO_RADIUS))
    for side, hand in zip("lr", HANDS, strict=True):
        shoulder, elbow = Point[f"{side.upper()}_SHOULDER"], Point[f"{side.upper()}_ELBOW"]
        found.append(Segment(f"{side}_upper_arm", shoulder, elbow, ARM_RADIUS))
        found.append(Segment(f"{side}_forearm", elbow, hand[0], ARM_RADIUS))
        known = [p for p in hand if truth.mask[p]] or [hand[0]]
        if len(known) == 1:
            found.append(Segment(f"{side}_hand", known[0], known[0], HAND_RADIUS + held))
        else:
            span = np.linalg.norm(truth.points[list(hand), None] - truth.points[list(hand)], axis=2).max()
            within = HAND_RADIUS - float(span) + held
            found += [
                Segment(f"{side}_hand", a, b, within) for a, b in ((hand[0], hand[1]), (hand[1], hand[2]))
            ]
        hip, knee, ankle = (Point[f"{side.upper()}_{joint}"] for joint in ("HIP", "KNEE", "ANKLE"))
        found.append(Segment(f"{side}_thigh", hip, knee, LEG_RADIUS))
        found.append(Segment(f"{side}_shank", knee, ankle, LEG_RADIUS))
        found.append(Segment(f"{side}_foot", ankle, ankle, FOOT_RADIUS))
    wanted = {part.name.lower() for part in Part if parts >> part & 1}
    return tuple(segment for segment in found if segment.name in wanted)


def told(
    truth: Truth, stamps: tuple[float, float], late: float, speed: float, parts: int, held: float
) -> Person:
    """What the brute-force checker is told.

    Points of the last report are within their error of what was measured, seen at the earliest instant that
    stamp and clock errors (together ``late`` [s]) allow. Points that it does not show are where they truly
    were, and so are those of a hand that shows more than one: measured apart, they could be farther from each
    other than any hand is long. Somebody whom only the first report shows is taken from there.
    """
    number = 1 if truth.seen[1].any() else 0
    seen = truth.seen[number].copy()
    for hand in HANDS:
        if truth.mask[list(hand)].sum() > 1:
            seen[list(hand)] = False
    true = truth.points - (truth.moved if number == 0 else 0.0)
    return Person(
        points=np.where(seen[:, None], truth.measured(number), true),
        slack=np.where(seen, truth.bounds, 0.0),
        seen=np.full(20, stamps[number] - late),
        speed=speed,
        parts=flesh(truth, parts, held),
    )


WHOLE_BODY = ALL_PARTS
