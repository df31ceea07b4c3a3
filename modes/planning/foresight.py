"""Where people are, and where they may be within a second, as far as a planner is told.

Nothing of this is believed by the supervisor, which knows no forecast (docs/method.md, section 7).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS
from verifier.proposal import SceneView

Array = NDArray[np.float64]

OLD_S = 1.0
"""A point that was not seen for so long is not planned with."""


class Foresight(Protocol):
    """Tells a planner where people are and will be."""

    def frames(self, view: SceneView) -> Sequence[Array]:
        """Return points ``(people, 20, 3)`` [m] now and at later instants; NaN: not known."""
        ...


class Present:
    """People as they were seen last, and no forecast."""

    def frames(self, view: SceneView) -> Sequence[Array]:
        """Return one frame: where points were seen within the last second."""
        return (last_seen(view),)


def last_seen(view: SceneView) -> Array:
    """Return points ``(people, 20, 3)`` [m] where they were seen within the last second, NaN otherwise."""
    found = np.full((len(view.people), MAX_POINTS, 3), np.nan)
    for k, person in enumerate(view.people):
        with np.errstate(invalid="ignore"):
            recent = np.abs(view.t - person.t) <= OLD_S
        found[k] = np.where(recent[:, None], person.xyz, np.nan)
    return found
