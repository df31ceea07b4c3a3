"""How far away what a pixel shows is, and how well that is known; depth that is not there stays missing."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.settings import require_count, require_number

Array = NDArray[np.float64]
DepthImage = NDArray[np.uint16] | NDArray[np.float32] | NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DepthSettings:
    """How depth is read around a pixel, and its errors.

    ``bias_m``, ``bias_share`` and ``noise_m`` are those of Microsoft's data sheet of the Azure Kinect (less
    than 11 mm + 0.1 % of the depth; standard deviation up to 17 mm), whose kind of depth sensor the Femto
    Bolt has: recalled, not verified. All other numbers are made up.

    Attributes
    ----------
    window_px:
        Half the side of the window that is looked at [px]; as far as a landmark may be off, for every surface
        in it may be the one of the joint.
    least_share:
        Of the window's pixels that a surface must have.
    jump_m:
        Depths of a window that are farther apart belong to two surfaces [m].
    body_depth_m:
        No two visible places of one body differ more in depth [m]; a surface that is farther behind the
        nearest is background, and a point that is farther from the body's middle depth is none of it.
    nearest_m, farthest_m:
        Depths outside are no measurements [m].
    bias_m, bias_share:
        Greatest systematic error: bias_m + bias_share · z [m].
    noise_m, noise_per_m:
        Standard deviation at depth z: noise_m + noise_per_m · z² [m].
    sigmas:
        How many standard deviations an error covers.
    """

    window_px: int = 8
    least_share: float = 0.05
    jump_m: float = 0.08
    body_depth_m: float = 1.2
    nearest_m: float = 0.25
    farthest_m: float = 5.5
    bias_m: float = 0.011
    bias_share: float = 0.001
    noise_m: float = 0.017
    noise_per_m: float = 0.001
    sigmas: float = 3.0

    def __post_init__(self) -> None:
        require_count("depth: window_px", self.window_px, 1, 100)
        require_number("depth: least_share", self.least_share, 0.0, 0.5, above=True)
        require_number("depth: jump_m", self.jump_m, 0.0, 10.0, above=True)
        require_number("depth: body_depth_m", self.body_depth_m, self.jump_m, 10.0)
        require_number("depth: nearest_m", self.nearest_m, 0.0, 100.0, above=True)
        require_number("depth: farthest_m", self.farthest_m, self.nearest_m, 100.0, above=True)
        for name in ("bias_m", "bias_share", "noise_m", "noise_per_m"):
            require_number(f"depth: {name}", getattr(self, name), 0.0, 1.0)
        require_number("depth: sigmas", self.sigmas, 0.0, 10.0)

    def sigma_m(self, depth_m: Array | float) -> Array:
        """Return the standard deviation of the noise at a depth [m]."""
        return np.asarray(self.noise_m + self.noise_per_m * np.square(depth_m))

    def error_m(self, depth_m: Array | float) -> Array:
        """Return the greatest error of a depth, as far as the settings say it [m].

        Neighbouring pixels are not independent, so that no median of many makes it smaller.
        """
        z = np.asarray(depth_m, dtype=np.float64)
        return np.asarray(self.bias_m + self.bias_share * z + self.sigmas * self.sigma_m(z))


class DepthOutcome(StrEnum):
    """What came of a look at a window."""

    READ = "read"
    OUTSIDE = "the pixel is outside of the image"
    HOLE = "too few pixels around it have a depth, or they agree on none"


class Sample(NamedTuple):
    """Depth of the nearest surface [m], and what the window adds to its error [m]; NaN unless READ."""

    outcome: DepthOutcome
    depth_m: float
    spread_m: float


_OUTSIDE = Sample(DepthOutcome.OUTSIDE, np.nan, np.nan)
_HOLE = Sample(DepthOutcome.HOLE, np.nan, np.nan)


def sample(depth: DepthImage, metres_per_unit: float, u: float, v: float, settings: DepthSettings) -> Sample:
    """Return the depth around pixel (u, v): the median of the nearest surface in a window.

    0, NaN, infinite and what is out of range are holes. Depths of the window that are more than ``jump_m``
    apart are of two surfaces; those with few pixels are passed over. How far its middle half spreads is added
    to the error. Where a second surface may be of the same body, nobody knows on which of them the joint is:
    the gap between the two is added, too.
    """
    if not (np.isfinite(u) and np.isfinite(v)):
        return _OUTSIDE
    row, column, half = round(v), round(u), settings.window_px
    if not (0 <= row < depth.shape[0] and 0 <= column < depth.shape[1]):
        return _OUTSIDE
    window = depth[max(0, row - half) : row + half + 1, max(0, column - half) : column + half + 1]
    z = window.ravel().astype(np.float64) * metres_per_unit
    least = max(1.0, settings.least_share * z.size)
    z = np.sort(z[(z >= settings.nearest_m) & (z <= settings.farthest_m)])
    edges = [0, *(np.flatnonzero(np.diff(z) > settings.jump_m) + 1), len(z)]
    surfaces = [(a, b) for a, b in pairwise(edges) if b - a >= least]
    if not surfaces:
        return _HOLE
    nearest, *others = (float(z[(a + b) // 2]) for a, b in surfaces)
    begin, end = surfaces[0]
    spread = float(z[(begin + 3 * end) // 4] - z[(3 * begin + end) // 4])
    gaps = (each - nearest for each in others)
    spread += max((gap for gap in gaps if gap <= settings.body_depth_m), default=0.0)
    return Sample(DepthOutcome.READ, nearest, spread)
