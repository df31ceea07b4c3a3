"""What a camera of the twin reports: late, noisy, and without what is hidden from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modes.settings import require_count, require_number
from modes.twin.people import Person
from occupancy.body import MAX_POINTS
from occupancy.report import RawMeasurement, RawPerson
from robots.errors import SetupError

Array = NDArray[np.float64]
Hidden = Callable[[float, int], NDArray[np.bool_]]
"""From an instant [s] and the number of a person to which of the 20 points are hidden then."""


_LONGEST_S = 60.0


def nothing_hidden(_t: float, _person: int) -> NDArray[np.bool_]:
    """Return that no point is hidden."""
    return np.zeros(MAX_POINTS, dtype=bool)


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """How a camera sees; all of it made up.

    Attributes
    ----------
    rate_hz:
        How often.
    latency_s, latency_max_s:
        Bounds of the time from seeing to the arrival of the report.
    noise_m:
        Standard deviation of each coordinate.
    error_m:
        Stated error of a point; noise is cut off there.
    dropped:
        Share of the reports that never arrive.
    seed:
        Of noise, latency and losses.

    Raises
    ------
    SetupError
        A number is out of range, or the bounds of the latency are exchanged.
    """

    rate_hz: float = 30.0
    latency_s: float = 0.03
    latency_max_s: float = 0.05
    noise_m: float = 0.008
    error_m: float = 0.03
    dropped: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        require_number("camera: rate_hz", self.rate_hz, 0.1, 1000.0)
        require_number("camera: latency_s", self.latency_s, 0.0, 10.0)
        require_number("camera: latency_max_s", self.latency_max_s, 0.0, 10.0)
        require_number("camera: noise_m", self.noise_m, 0.0, 1.0)
        require_number("camera: error_m", self.error_m, 0.0, 10.0)
        require_number("camera: dropped", self.dropped, 0.0, 1.0)
        require_count("camera: seed", self.seed, 0, 2**63 - 1)
        if self.latency_max_s < self.latency_s:
            raise SetupError(
                f"camera: latency_max_s = {self.latency_max_s:g} should be at least latency_s, "
                f"{self.latency_s:g}"
            )


class Camera:
    """Looks at people at a fixed rate, and hands out reports when they arrive.

    Parameters
    ----------
    people:
        Whom it sees.
    settings:
        How.
    hidden:
        Which points it does not see.
    """

    def __init__(
        self,
        people: Sequence[Person],
        settings: CameraSettings | None = None,
        hidden: Hidden = nothing_hidden,
    ) -> None:
        self.settings = CameraSettings() if settings is None else settings
        self._people, self._hidden = tuple(people), hidden
        self._random = np.random.default_rng(self.settings.seed)
        self._looks = 0
        self._under_way: list[RawMeasurement] = []

    def arrived(self, t: float) -> list[RawMeasurement]:
        """Return the reports that have arrived by ``t`` [s] and were not handed out before, as they came.

        Where the clock jumped, it did not look until a minute before; where ``t`` is not finite, it does not.
        """
        if not math.isfinite(t):
            return []
        self._looks = max(self._looks, math.floor((t - _LONGEST_S) * self.settings.rate_hz))
        while self._looks / self.settings.rate_hz <= t:
            stamp = self._looks / self.settings.rate_hz
            self._looks += 1
            low, high = self.settings.latency_s, self.settings.latency_max_s
            arrival = stamp + self._random.uniform(low, high)
            report = self._look(stamp, arrival)
            if self._random.uniform() >= self.settings.dropped:
                self._under_way.append(report)
        here = sorted((each for each in self._under_way if each.arrived <= t), key=lambda each: each.arrived)
        self._under_way = [each for each in self._under_way if each.arrived > t]
        return here

    def _look(self, stamp: float, arrival: float) -> RawMeasurement:
        people = tuple(self._seen(stamp, number) for number in range(len(self._people)))
        return RawMeasurement(stamp, arrival, "world", True, people)

    def _seen(self, stamp: float, number: int) -> RawPerson:
        settings = self.settings
        noise = settings.noise_m * self._random.normal(size=(MAX_POINTS, 3))
        length = np.linalg.norm(noise, axis=1, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            noise = np.where(length > settings.error_m, noise * (settings.error_m / length), noise)
        xyz = self._people[number].at(stamp) + noise
        xyz[self._hidden(stamp, number)] = np.nan
        xyz[~np.isfinite(xyz).all(axis=1)] = np.nan
        measured = sum(1 << k for k in range(MAX_POINTS) if math.isfinite(xyz[k, 0]))
        return RawPerson(f"p{number + 1}", xyz, np.full(MAX_POINTS, settings.error_m), measured)
