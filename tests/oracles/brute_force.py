"""Can anybody touch a moving link? Brute force over time, surface points and people who run at their fastest.

Shares nothing with the checked software: its arm, meshes, kinematics and bodies are its own, and only arrays
come in. It never says that something is impossible, only that it found nothing; every contact it reports is
one that a person within the assumptions can bring about, and :func:`chase` shows it by moving that person.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tests.oracles.urdf_arm import Arm

Array = NDArray[np.float64]

_FIRST_PORTION = 16
_LARGEST_PORTION = 1024


@dataclass(frozen=True)
class Segment:
    """A body part: all within ``radius`` [m] of the straight line between points ``start`` and ``end``."""

    name: str
    start: int
    end: int
    radius: float


@dataclass(frozen=True)
class Person:
    """What is true about one person.

    At the instant ``seen`` (P,) [s], point i was within ``slack[i]`` (P,) [m] of ``points[i]`` (P, 3) [m]; no
    point is ever faster than ``speed`` [m/s].
    """

    points: Array
    slack: Array
    seen: Array
    speed: float
    parts: tuple[Segment, ...]

    def growth(self, time: Array) -> Array:
        """How far (T, P) [m] each point may be from ``points`` at the instants ``time`` (T,) [s]."""
        return self.slack + self.speed * np.maximum(time[:, None] - self.seen, 0.0)


@dataclass(frozen=True)
class Motion:
    """What the arm does: joint positions ``q`` (T, n) at the instants ``time`` (T,) [s], at most 1 ms apart.

    ``free``: positions of joints that nobody commands.
    """

    time: Array
    q: Array
    free: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Approach:
    """The closest that anybody can come to a moving link.

    ``slack`` [m]: what is left between the link's surface and the farthest that a body part can get; if it is
    not positive, there is contact. ``sample``: row of the motion; ``share``: place on the part, 0 its start,
    1 its end; ``body_point`` (3,) [m]: where that place was measured.
    """

    slack: float
    sample: int
    time: float
    link: str
    link_point: Array
    person: int
    part: Segment
    share: float
    body_point: Array


@dataclass(frozen=True)
class Contact:
    """A contact that happened in a simulated motion of one person."""

    time: float
    link: str
    part: str
    depth: float
    fastest_point: float
    """Greatest speed of any body point in the simulation [m/s]."""


def moving(arm: Arm, motion: Motion, standstill_speed: float) -> NDArray[np.bool_]:
    """Whether (L, T) some point of a link is faster than ``standstill_speed`` [m/s] just before or after."""
    rotations, positions = arm.poses(motion.q, motion.free)
    step = np.diff(motion.time)
    faster = np.zeros((len(arm.links), len(motion.time)), dtype=bool)
    for link, probes in enumerate(arm.probes):
        places = np.einsum("tij,pj->tpi", rotations[link], probes) + positions[link][:, None]
        speed = np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=1) / step > standstill_speed
        faster[link, :-1] |= speed
        faster[link, 1:] |= speed
    return faster


def nearest_approach(
    arm: Arm, motion: Motion, people: Sequence[Person], standstill_speed: float, *, below: float = np.inf
) -> Approach | None:
    """Search all moving links, surface points, instants, people and parts for the smallest slack.

    Groups of points, then the clusters in them, then the points are taken in the order of a lower bound of
    their slack, until the bound exceeds the best found. None if nothing moves or nothing is below ``below``
    [m].

    Raises
    ------
    ValueError
        If a number is not finite: nothing can be found then, and that must not look like a result.
    """
    _check_finite(motion, people)
    bodies = [
        _Body(np.broadcast_to(p.points, (len(motion.time), *p.points.shape)), p.growth(motion.time), p.parts)
        for p in people
    ]
    return _search(arm, motion, bodies, standstill_speed, below)


@dataclass(frozen=True)
class _Body:
    """Where the points (T, P, 3) [m] of a person are, or are within ``growth`` (T, P) [m] of."""

    points: Array
    growth: Array
    parts: tuple[Segment, ...]


def _search(
    arm: Arm, motion: Motion, bodies: Sequence[_Body], standstill_speed: float, below: float
) -> Approach | None:
    search = _Search(arm, motion, bodies, below)
    active = moving(arm, motion, standstill_speed)
    groups, samples = np.nonzero(active[arm.clusters.group_link])
    if len(groups) == 0:
        return None
    bounds = search.group_bounds(groups, samples)
    groups, samples, parts = (
        np.repeat(groups, bounds.shape[1]),
        np.repeat(samples, bounds.shape[1]),
        np.tile(np.arange(bounds.shape[1]), len(groups)),
    )
    bounds = bounds.ravel()
    for chosen in _in_order(bounds, search):
        search.open_groups(groups[chosen], samples[chosen], parts[chosen])
    return search.found


def _check_finite(motion: Motion, people: Sequence[Person]) -> None:
    used = [
        p
        for person in people
        for part in person.parts
        for p in (person.points[part.start], person.points[part.end])
    ]
    arrays = [
        motion.time,
        motion.q,
        *used,
        *(person.slack for person in people),
        *(person.seen for person in people),
    ]
    if not all(np.isfinite(array).all() for array in arrays):
        raise ValueError("times, joint positions and people must be finite")
    if np.diff(motion.time).max(initial=0.0) > 1.001e-3:
        raise ValueError("a motion must be sampled at least once a millisecond")


def _in_order(bounds: Array, search: _Search) -> Iterator[NDArray[np.int64]]:
    """Yield row numbers by rising bound, in growing portions, while the bounds are below the best found."""
    order = np.argsort(bounds, kind="stable")
    start, portion = 0, _FIRST_PORTION
    while start < len(order) and bounds[order[start]] < search.best:
        end = min(start + portion, int(np.searchsorted(bounds[order], search.best)))
        yield order[start:end]
        start, portion = end, min(2 * portion, _LARGEST_PORTION)


class _Search:
    """The best approach found so far, and how to look at more places."""

    def __init__(self, arm: Arm, motion: Motion, bodies: Sequence[_Body], below: float) -> None:
        self._arm, self._motion = arm, motion
        self._rotations, self._positions = arm.poses(motion.q, motion.free)
        self.parts = [(who, part) for who, body in enumerate(bodies) for part in body.parts]
        self._radius = np.array([part.radius for _, part in self.parts])
        self._start, self._end, self._growth_start, self._growth_end = (
            np.stack([values(bodies[who])[:, index(part)] for who, part in self.parts], axis=1)
            for values in (lambda body: body.points, lambda body: body.growth)
            for index in (lambda part: part.start, lambda part: part.end)
        )
        self.best = below
        self.found: Approach | None = None

    def slack(
        self, places: Array, links: NDArray[np.int64], samples: NDArray[np.int64], parts: NDArray[np.int64]
    ) -> tuple[Array, Array, Array]:
        """Slack (N, P), share (N, P) and world places (N, P, 3) of link points ``places`` (N, P, 3)."""
        world = places @ np.swapaxes(self._rotations[links, samples], -1, -2)
        world += self._positions[links, samples][:, None]
        slack, share = slack_of(
            world,
            self._start[samples, parts][:, None],
            self._end[samples, parts][:, None],
            self._growth_start[samples, parts][:, None],
            self._growth_end[samples, parts][:, None],
            self._radius[parts][:, None],
        )
        return slack, share, world

    def group_bounds(self, groups: NDArray[np.int64], samples: NDArray[np.int64]) -> Array:
        """Lower bounds (N, parts) of the slack of groups at instants (samples), (N,) each."""
        known = self._arm.clusters
        links = known.group_link[groups]
        centre = (self._rotations[links, samples] @ known.group_centre[groups][..., None])[..., 0]
        centre += self._positions[links, samples]
        slack, _ = slack_of(
            centre[:, None],
            self._start[samples],
            self._end[samples],
            self._growth_start[samples],
            self._growth_end[samples],
            self._radius,
        )
        bounds: Array = slack - known.group_radius[groups][:, None]
        return bounds

    def open_groups(
        self, groups: NDArray[np.int64], samples: NDArray[np.int64], parts: NDArray[np.int64]
    ) -> None:
        """Look into groups at instants (samples) and parts, (N,) each."""
        members = [self._arm.clusters.members[group] for group in groups]
        lengths = [len(each) for each in members]
        clusters = np.concatenate(members)
        samples, parts = np.repeat(samples, lengths), np.repeat(parts, lengths)
        known = self._arm.clusters
        bounds = self.slack(known.centre[clusters][:, None], known.link[clusters], samples, parts)[0][:, 0]
        bounds -= known.radius[clusters]
        for chosen in _in_order(bounds, self):
            self._open_clusters(clusters[chosen], samples[chosen], parts[chosen])

    def _open_clusters(
        self, clusters: NDArray[np.int64], samples: NDArray[np.int64], parts: NDArray[np.int64]
    ) -> None:
        known = self._arm.clusters
        links = known.link[clusters]
        slack, share, world = self.slack(known.points[clusters], links, samples, parts)
        row, point = np.unravel_index(np.argmin(slack), slack.shape)
        if slack[row, point] < self.best:
            self.best = float(slack[row, point])
            sample, column = samples[row], parts[row]
            who, part = self.parts[column]
            self.found = Approach(
                slack=self.best,
                sample=int(sample),
                time=float(self._motion.time[sample]),
                link=self._arm.links[links[row]],
                link_point=world[row, point].copy(),
                person=who,
                part=part,
                share=(at := float(share[row, point])),
                body_point=(1.0 - at) * self._start[sample, column] + at * self._end[sample, column],
            )


def slack_of(
    points: Array, start: Array, end: Array, growth_start: Array, growth_end: Array, radius: Array
) -> tuple[Array, Array]:
    """Distance minus reach (…,) of ``points`` (…, 3) from parts whose ends grow differently; and the share.

    Minimises |p - a - λ (b - a)| - (1 - λ) g_a - λ g_b over λ in [0, 1]. With x along and h across the axis
    of length l and k = g_b - g_a, the derivative vanishes where x - λ l = -(k / l) h / sqrt(1 - (k / l)²).
    For |k| >= l one end swallows the other.
    """
    axis = end - start
    length = np.sqrt(np.einsum("...i,...i->...", axis, axis))
    offset = points - start
    extent = np.maximum(length, 1e-12)
    along = np.einsum("...i,...i->...", offset, axis) / extent
    square = np.einsum("...i,...i->...", offset, offset)
    lean = growth_end - growth_start
    if np.any(lean):
        slope = lean / extent
        inside = np.abs(slope) < 1.0
        slope = np.where(inside, slope, 0.0)
        across = np.sqrt(np.maximum(square - along**2, 0.0))
        share = np.clip((along + across * slope / np.sqrt(1.0 - slope**2)) / extent, 0.0, 1.0)
        share = np.where(inside, share, np.where(lean > 0.0, 1.0, 0.0))
    else:
        share = np.clip(along / extent, 0.0, 1.0)
    distance = np.sqrt(np.maximum(square - 2.0 * share * length * along + (share * length) ** 2, 0.0))
    return distance - (1.0 - share) * growth_start - share * growth_end - radius, share


def lean_towards(arm: Arm, motion: Motion, approach: Approach, error: Array) -> Array:
    """Joint error (n,), ``error`` (n,) with signs, that brings the found link point nearest to the body."""
    person_side = approach.body_point - approach.link_point
    link = arm.links.index(approach.link)
    q = motion.q[[approach.sample]]
    rotation, position = arm.poses(q, motion.free)
    local = rotation[link, 0].T @ (approach.link_point - position[link, 0])
    signs = np.empty(q.shape[1])
    for joint in range(q.shape[1]):
        moved = q.copy()
        moved[0, joint] += 1e-6
        rotation, position = arm.poses(moved, motion.free)
        step = rotation[link, 0] @ local + position[link, 0] - approach.link_point
        signs[joint] = 1.0 if step @ person_side >= 0.0 else -1.0
    return signs * error


def chase(
    arm: Arm, motion: Motion, person: Person, approach: Approach, standstill_speed: float
) -> Contact | None:
    """Move the person straight to where ``approach`` says that a link can be met; report the deepest contact.

    From the start, every point is off its measured place by at most its slack; then it runs at full speed
    towards the meeting point and halts where the part's surface gets there. Contact means that a surface
    point of a moving link lies within the flesh of a part at the same instant.
    """
    part, share = approach.part, approach.share
    direction = approach.link_point - approach.body_point
    distance = float(np.linalg.norm(direction))
    direction = direction / distance if distance > 0.0 else np.array([1.0, 0.0, 0.0])
    reach = person.growth(np.array([approach.time]))[0]
    needed = max(distance - part.radius, 0.0)
    available = (1.0 - share) * reach[part.start] + share * reach[part.end]
    stop = reach * min(1.0, needed / available) if available > 0.0 else np.zeros_like(reach)
    travelled = np.minimum(person.growth(motion.time), stop)
    step = np.diff(motion.time)[:, None]
    fastest = float((np.diff(travelled, axis=0) / step).max(initial=0.0))
    if (np.diff(travelled, axis=0) > person.speed * step + 1e-9).any():
        raise AssertionError(f"the simulated person moves at {fastest} m/s, faster than {person.speed} m/s")
    ends = person.points + travelled[..., None] * direction
    body = _Body(ends, np.zeros(ends.shape[:2]), person.parts)
    met = _search(arm, motion, [body], standstill_speed, 1e-9)
    return None if met is None else Contact(met.time, met.link, met.part.name, -met.slack, fastest)
