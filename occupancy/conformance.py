"""Does recorded motion stay inside of what was predicted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Point, Profile
from occupancy.humans.kernels import first_outside, first_too_large
from robots.motion import Block


@dataclass(frozen=True, eq=False)
class LaterSamples:
    """What was measured of one person over a stretch of a recording.

    Attributes
    ----------
    t:
        (T,) s, stamps on the cell's clock, strictly increasing.
    xyz:
        (T, 20, 3) m, world frame; NaN: not measured.
    e_p:
        (T, 20) m, position errors; any value where ``xyz`` is NaN.

    Raises
    ------
    ValueError
        If shapes do not agree, or stamps are not finite and increasing.
    """

    t: NDArray[np.float64]
    xyz: NDArray[np.float64]
    e_p: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = len(self.t)
        if self.xyz.shape != (n, MAX_POINTS, 3) or self.e_p.shape != (n, MAX_POINTS):
            raise ValueError(
                f"later samples: {n} stamps need points ({n}, {MAX_POINTS}, 3) and errors "
                f"({n}, {MAX_POINTS}), not {self.xyz.shape} and {self.e_p.shape}"
            )
        if not (np.isfinite(self.t).all() and (np.diff(self.t) > 0.0).all()):
            raise ValueError("later samples: stamps must be finite and strictly increasing")
        for name in ("t", "xyz", "e_p"):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))


class Outside(NamedTuple):
    """A measured point that the profile does not allow, given an earlier row of the people block.

    ``point`` of sample number ``sample`` was ``distance_m`` from where ``earlier`` had been (the same point,
    unless the row did not have it), and could have been ``allowed_m`` away at most, position errors included.
    """

    sample: int
    point: Point
    earlier: Point
    distance_m: float
    allowed_m: float


def later_outside(
    people: Block, row: int, samples: LaterSamples, profile: Profile, *, after: float, until: float
) -> Outside | None:
    """Return the first later measurement that contradicts the speeds and sizes assumed for a row.

    Looks at the samples with ``after`` < t <= ``until`` [s] of the same person. Distances are compared
    without body radii: what is contradicted is assumption A1 (docs/method.md, section 1), for point p by more
    than speed · Δt + both position errors, with Δt widened by stamp and clock errors.
    """
    arrays = (samples.t, samples.xyz, samples.e_p)
    sample, p, q, distance, allowed = first_outside(people, row, arrays, (after, until), profile.limits)
    return None if sample < 0 else Outside(sample, Point(p), Point(q), distance, allowed)


def later_too_large(samples: LaterSamples, profile: Profile, *, after: float, until: float) -> Outside | None:
    """Return the first sample with ``after`` < t <= ``until`` [s] of a person whom the profile has not.

    Two of its points are farther apart than the profile's sizes and both position errors allow; ``earlier``
    is the other one, of the same sample.
    """
    arrays = (samples.t, samples.xyz, samples.e_p)
    sample, p, q, distance, allowed = first_too_large(arrays, (after, until), profile.limits)
    return None if sample < 0 else Outside(sample, Point(p), Point(q), distance, allowed)
