"""What links touch, and how near they come to fixtures and to each other: distances between sampled points.

A distance between points on two surfaces is never below that of the surfaces: what is reported as too narrow
is too narrow. Links on one joint, or on two of which one carries the other, have no gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from tests.oracles.approach_search import slack_of
from tests.oracles.brute_force import Allowed, too_fast
from tests.oracles.situation import Motion, Person
from tests.oracles.urdf_arm import Arm

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Box:
    """A box with edges ``size`` (3,) [m] around ``centre`` (3,) [m], along the columns of ``rotation``."""

    centre: Array
    rotation: Array
    size: Array

    def distance(self, points: Array) -> Array:
        """Distances (N,) [m] of points (N, 3); 0 inside."""
        beyond = np.abs((points - self.centre) @ self.rotation) - 0.5 * self.size
        return np.asarray(np.linalg.norm(np.maximum(beyond, 0.0), axis=1))


@dataclass(frozen=True)
class Surroundings:
    """Everything below the height ``floor`` [m], and boxes by name."""

    floor: float
    boxes: dict[str, Box]

    def distances(self, points: Array) -> dict[str, float]:
        """Distance [m] of the nearest of points (N, 3) to each fixture by name; 0 inside."""
        found = {name: float(box.distance(points).min()) for name, box in self.boxes.items()}
        return found | {"floor": max(float(points[:, 2].min()) - self.floor, 0.0)}


@dataclass(frozen=True)
class Narrow:
    """The smallest gap [m] that was found of a link, what is on its other side, and when."""

    gap: float
    link: str
    other: str
    time: float


def touched(
    arm: Arm, motion: Motion, people: Sequence[Person], allowed: Allowed, every: int
) -> set[tuple[str, str]]:
    """Links and parts that may touch while the link is faster than ``allowed``.

    Looks at probes of links at each ``every``-th instant: it may miss some, and names none too many.
    """
    found = set()
    rotations, positions = arm.poses(motion.q, motion.free)
    for person in people:
        counts = too_fast(arm, motion, [part.name for part in person.parts], allowed)[:, :, ::every]
        growth = person.growth(motion.time)[::every, None]
        for link, probes in enumerate(arm.probes):
            places = probes @ np.swapaxes(rotations[link, ::every], -1, -2)
            places += positions[link, ::every, None]
            for k, part in enumerate(person.parts):
                slack, _ = slack_of(
                    places[counts[k, link]],
                    person.points[part.start],
                    person.points[part.end],
                    growth[counts[k, link], :, part.start],
                    growth[counts[k, link], :, part.end],
                    np.array(part.radius),
                )
                if slack.min(initial=np.inf) <= 0.0:
                    found.add((arm.links[link], part.name))
    return found


class Gaps:
    """Gaps of the links of one arm; keeps a tree of the points of each link in its own frame."""

    def __init__(self, arm: Arm, points_per_link: int = 400) -> None:
        self._arm = arm
        self._trees = [KDTree(points) for points in arm.points]
        self._few = [points[:: max(1, len(points) // points_per_link)] for points in arm.points]

    def beside(self, link: str) -> list[str]:
        """Links that may clamp something together with ``link``, by the joints that carry them."""
        own = self._arm.carried_by(link)
        return [
            other
            for other in self._arm.links
            for theirs in [self._arm.carried_by(other)]
            if own not in (theirs, theirs[:-1]) and theirs != own[:-1]
        ]

    def narrowest(
        self,
        motion: Motion,
        link: str,
        surroundings: Surroundings,
        others: Sequence[str],
        samples: NDArray[np.int64],
    ) -> Narrow:
        """Return the smallest gap of a link to fixtures and to ``others``, at some samples of a motion."""
        arm, own = self._arm, self._arm.links.index(link)
        rotations, positions = arm.poses(motion.q[samples], motion.free)
        best = Narrow(np.inf, link, "", 0.0)
        for at, sample in enumerate(samples):
            world = self._few[own] @ rotations[own, at].T + positions[own, at]
            gaps = surroundings.distances(world)
            for other in others:
                index = arm.links.index(other)
                local = (world - positions[index, at]) @ rotations[index, at]
                gaps[other] = float(self._trees[index].query(local, distance_upper_bound=best.gap)[0].min())
            name = min(gaps, key=lambda each: gaps[each])
            if gaps[name] < best.gap:
                best = Narrow(gaps[name], link, name, float(motion.time[sample]))
        return best
