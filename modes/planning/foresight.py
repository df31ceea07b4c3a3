"""Where people are, and where they may be within a second, as far as a planner is told.

Nothing of this is believed by the supervisor, which knows no forecast (docs/method.md, section 7).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.dataset import AHEAD, RATE_HZ
from modes.forecasting.history import History
from modes.forecasting.network import Forecaster, forecast_points
from modes.forecasting.occlusion import Filler
from occupancy.body import MAX_POINTS
from robots.errors import SetupError
from verifier.proposal import SceneView, SeenPerson

Array = NDArray[np.float64]

FRAME_S = 1.0 / RATE_HZ
"""From one frame to the next [s]."""
OLD_S = 1.0
"""A point that was not seen for so long is not planned with."""


class Foresight(Protocol):
    """Tells a planner where people are and will be."""

    def frames(self, view: SceneView) -> Sequence[Array]:
        """Return points ``(people, 20, 3)`` [m] now, and every :data:`FRAME_S` after that; NaN: not known."""
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


class Forecasts:
    """People as they were seen last, and as they are forecast for the second that follows.

    Parameters
    ----------
    forecaster:
        From 3 s at 10 Hz to 1 s.
    filler:
        Of joints that are hidden; ``None``: they are carried along with the others.

    Raises
    ------
    SetupError
        The forecaster is none.
    """

    def __init__(self, forecaster: Forecaster, filler: Filler | None = None) -> None:
        if not callable(getattr(forecaster, "forecast", None)):
            raise SetupError(f"forecasts: {forecaster!r} should be a forecaster: load_forecaster()")
        self.forecaster, self._filler = forecaster, filler
        self._seen: dict[tuple[str, int], History] = {}
        self._t = -math.inf

    def frames(self, view: SceneView) -> Sequence[Array]:
        """Return eleven frames: as seen last, and 0.1 … 1.0 s after that.

        Somebody for whom there is no forecast stays where they were seen.
        """
        if view.t < self._t:  # another clock, or another supervisor
            self._seen = {}
        self._t = view.t
        now = last_seen(view)
        ahead = np.repeat(now[None], AHEAD, axis=0)
        rows, kept = Counter[str](), {}
        for k, person in enumerate(view.people):
            key = person.id, rows[person.id]
            rows[person.id] += 1
            kept[key] = history = self._seen.get(key, History())
            _take_in(history, person)
            if not (abs(view.t - history.newest) <= OLD_S):
                continue
            found = forecast_points(history.points(), self.forecaster, self._filler)
            now[k] = np.where(np.isfinite(now[k]), now[k], found.now)
            ahead[:, k] = np.where(np.isfinite(found.points), found.points, now[k])
        self._seen = kept
        return [now, *ahead]


def _take_in(history: History, person: SeenPerson) -> None:
    """Take in the points that were seen at the newest instant."""
    if np.isfinite(person.t).any():
        newest = float(np.nanmax(person.t))
        history.add(newest, np.where((person.t == newest)[:, None], person.xyz, np.nan))
