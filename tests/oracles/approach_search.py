"""Best-first search for the smallest slack between surface points of an arm and parts of people."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.oracles.situation import Approach, Motion, Segment
from tests.oracles.urdf_arm import Arm

Array = NDArray[np.float64]

_FIRST_PORTION = 16
_LARGEST_PORTION = 1024


@dataclass(frozen=True)
class Body:
    """Where the points (T, P, 3) [m] of a person are, or are within ``growth`` (T, P) [m] of."""

    points: Array
    growth: Array
    parts: tuple[Segment, ...]


def in_order(bounds: Array, search: Search) -> Iterator[NDArray[np.int64]]:
    """Yield row numbers by rising bound, in growing portions, while the bounds are below the best found."""
    order = np.argsort(bounds, kind="stable")
    start, portion = 0, _FIRST_PORTION
    while start < len(order) and bounds[order[start]] < search.best:
        end = min(start + portion, int(np.searchsorted(bounds[order], search.best)))
        yield order[start:end]
        start, portion = end, min(2 * portion, _LARGEST_PORTION)


class Search:
    """The best approach found so far, and how to look at more places."""

    def __init__(self, arm: Arm, motion: Motion, bodies: Sequence[Body], below: float) -> None:
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
        for chosen in in_order(bounds, self):
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
