"""Balls of configurations that a path must not enter, around what was refused before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modes.planning import kernels
from modes.settings import require_numbers
from robots.errors import SetupError

Array = NDArray[np.float64]

_INSIDE = 1e-9
"""A ball that is shrunk for a configuration ends by this share before it."""


@dataclass(frozen=True, slots=True, eq=False)
class Avoided:
    """Balls in joint space, joints of all kinds weighed alike; a turn more is another configuration.

    Attributes
    ----------
    centre:
        ``(k, n)`` configurations [rad; m].
    radius:
        ``(k,)`` [rad].

    Raises
    ------
    SetupError
        Shapes do not fit, a number is not finite, or a radius is negative.
    """

    centre: Array
    radius: Array

    def __post_init__(self) -> None:
        radius = require_numbers("avoided: radius", self.radius, (-1,))
        centre = require_numbers("avoided: centre", self.centre, (len(radius), -1))
        if not (radius >= 0.0).all():
            raise SetupError(f"avoided: radius {radius.min():g} rad should not be negative")
        object.__setattr__(self, "radius", radius)
        object.__setattr__(self, "centre", centre)

    @classmethod
    def nothing(cls, joints: int) -> Avoided:
        """Return no ball at all."""
        return cls(np.zeros((0, joints)), np.zeros(0))

    def without(self, q: Array) -> Avoided:
        """Return balls in none of which ``q`` (n,) is: those around it are shrunk until it is outside."""
        away = np.linalg.norm(self.centre - q, axis=1)
        return Avoided(self.centre, np.minimum(self.radius, (1.0 - _INSIDE) * away))

    def contains(self, q: Array) -> bool:
        """Whether ``q`` (n,) is in a ball."""
        return self.is_entered(q, q)

    def is_entered(self, begin: Array, end: Array) -> bool:
        """Whether the straight line from ``begin`` to ``end`` (n,) is nearer to a centre than its radius."""
        return bool(kernels.enters(begin, end, self.centre, self.radius))
