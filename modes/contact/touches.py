"""What touches a simulated arm, and how hard: blows, pushes that last, and a hand that holds the tool."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from modes.settings import require_number, require_numbers
from robots.errors import SetupError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Spot:
    """A place on an arm.

    Attributes
    ----------
    body:
        ``"tool"``, or the name of a link.
    local_m:
        Where it is touched, in the frame of that link's joint; of the tool: in the sensor's frame [m].
    """

    body: str
    local_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Touch(Protocol):
    """Somebody, or something, in contact with a simulated arm."""

    @property
    def spot(self) -> Spot:
        """Where."""
        ...

    @property
    def begin_s(self) -> float:
        """There is no contact before [s]."""
        ...

    @property
    def end_s(self) -> float:
        """There is none from then on [s]."""
        ...

    def force(self, t: float, place: Array, velocity: Array) -> Array:
        """Return the force (3,) on the arm [N, base axes] from ``begin_s`` to ``end_s``.

        Parameters
        ----------
        t:
            Instant [s].
        place, velocity:
            ``(3,)`` of the spot [m, m/s], base axes.
        """
        ...


def _checked(direction: tuple[float, float, float]) -> Array:
    """Return a direction with size 1."""
    size = math.hypot(*direction)
    if not 0.0 < size < math.inf:
        raise SetupError(f"touch: direction {direction} has no size")
    return np.array(direction) / size


def _require_span(name: str, begin_s: float, end_s: float) -> None:
    """Refuse a contact that does not end after it begins."""
    require_number(f"{name}: begin_s", begin_s, -1e9, 1e9)
    require_number(f"{name}: end_s", end_s, begin_s, 1e9, above=True)


@dataclass(frozen=True, slots=True)
class Blow:
    """Half a sine: something hits, and is gone.

    Attributes
    ----------
    spot, begin_s:
        Where, and when it begins.
    peak_N, lasts_s:
        How hard [N], how long [s].
    direction:
        Of the force, base axes; its size does not matter.
    """

    spot: Spot
    begin_s: float
    peak_N: float
    lasts_s: float = 0.04
    direction: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        require_number("blow: begin_s", self.begin_s, -1e9, 1e9)
        require_number("blow: peak_N", self.peak_N, 0.0, 1e4)
        require_number("blow: lasts_s", self.lasts_s, 1e-3, 10.0)
        _checked(self.direction)

    @property
    def end_s(self) -> float:
        """When it is gone [s]."""
        return self.begin_s + self.lasts_s

    def force(self, t: float, place: Array, velocity: Array) -> Array:
        """Return the force at ``t``."""
        share = (t - self.begin_s) / self.lasts_s
        return self.peak_N * math.sin(math.pi * share) * _checked(self.direction)


@dataclass(frozen=True, slots=True)
class Push:
    """A force that rises, lasts and falls, each softly.

    Attributes
    ----------
    spot, begin_s, end_s:
        Where, from when on, and when it has gone.
    force_N, rise_s:
        How hard [N]; how long it takes to rise, and to fall [s].
    direction:
        Of the force, base axes; its size does not matter.
    """

    spot: Spot
    begin_s: float
    end_s: float
    force_N: float
    rise_s: float = 0.5
    direction: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        require_number("push: force_N", self.force_N, 0.0, 1e4)
        _require_span("push", self.begin_s, self.end_s)
        require_number("push: rise_s", self.rise_s, 1e-3, 0.5 * (self.end_s - self.begin_s))
        _checked(self.direction)

    def force(self, t: float, place: Array, velocity: Array) -> Array:
        """Return the force at ``t``."""
        share = min(t - self.begin_s, self.end_s - t, self.rise_s) / self.rise_s
        return self.force_N * 0.5 * (1.0 - math.cos(math.pi * share)) * _checked(self.direction)


@dataclass(slots=True)
class Hand:
    """A hand that takes the tool, leads it away and lets go: a spring and a damper between tool and hand.

    Where the hand wants to be is the tool's place when it takes it, and from then on softly away from that.

    Attributes
    ----------
    spot, begin_s, end_s:
        Where; when the hand takes the tool, and when it has let go.
    away_m:
        Where it leads the tool, from there [m], base axes; it takes ``moving_s``.
    stiffness_N_m, damping_N_s_m:
        Of the arm and hand of a person.
    """

    spot: Spot
    begin_s: float
    end_s: float
    away_m: tuple[float, float, float]
    moving_s: float = 1.0
    stiffness_N_m: float = 300.0
    damping_N_s_m: float = 20.0
    _taken: Array | None = None

    def __post_init__(self) -> None:
        _require_span("hand", self.begin_s, self.end_s)
        require_numbers("hand: away_m", self.away_m, (3,))
        require_number("hand: moving_s", self.moving_s, 1e-3, self.end_s - self.begin_s)
        require_number("hand: stiffness_N_m", self.stiffness_N_m, 0.0, 1e5)
        require_number("hand: damping_N_s_m", self.damping_N_s_m, 0.0, 1e4)

    def force(self, t: float, place: Array, velocity: Array) -> Array:
        """Return the force at ``t``."""
        if self._taken is None:
            self._taken = place.copy()
        share = min((t - self.begin_s) / self.moving_s, 1.0)
        way = share**3 * (10.0 + share * (6.0 * share - 15.0))
        wanted = self._taken + way * np.array(self.away_m)
        grip = min(1.0, (t - self.begin_s) / 0.2, (self.end_s - t) / 0.2)
        pull: Array = grip * (self.stiffness_N_m * (wanted - place) - self.damping_N_s_m * velocity)
        return pull
