"""A worst case between two numbers: what is reached, and what is proven not to be exceeded."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from robots.errors import SetupError

Array = NDArray[np.float64]


class Ended(StrEnum):
    """Why the work on a bracket ended."""

    CLOSED_FORM = "closed form"
    NARROW = "as narrow as asked for"
    DEADLINE = "deadline"
    INTERRUPTED = "interrupted"
    FULL = "no room for more boxes"
    UNBOUNDED = "not bounded"


@dataclass(frozen=True, eq=False)
class Witness:
    """A state with that value: ``q, dq, ddq (n,)`` [rad, rad/s, rad/s²; m for prismatic joints]."""

    q: Array
    dq: Array
    ddq: Array


@dataclass(frozen=True, eq=False)
class Bracket:
    """Worst case of one quantity, in the model: ``lower`` is reached at ``witness``, ``upper`` never
    exceeded.

    Attributes
    ----------
    quantity, part, unit:
        What it is, of which joint or link, in which unit.
    method:
        How ``upper`` was found.
    ended:
        Why no more was done.
    reason:
        Why there is no upper bound (``upper`` = inf), else empty.
    seconds:
        How long it took; NaN where no clock was given.

    Raises
    ------
    SetupError
        If ``lower`` is not between 0 and ``upper``: one of the two is wrong then.
    """

    quantity: str
    part: str
    unit: str
    lower: float
    upper: float
    witness: Witness | None
    method: str
    ended: Ended
    reason: str = ""
    seconds: float = math.nan

    def __post_init__(self) -> None:
        if not 0.0 <= self.lower <= self.upper:
            raise SetupError(
                f"bracket of {self.quantity}, {self.part}: lower {self.lower:g} must be between 0 and upper "
                f"{self.upper:g}"
            )
        if not self.upper < math.inf and not self.reason:
            raise SetupError(f"bracket of {self.quantity}, {self.part}: no upper bound, and no reason for it")

    @property
    def gap(self) -> float:
        """Share of ``upper`` that is not known to be reached: 0 exact, 1 nothing is known from below."""
        if not self.upper < math.inf:
            return 1.0
        return 1.0 - self.lower / self.upper if self.upper > 0.0 else 0.0


@dataclass(frozen=True)
class Effort:
    """How much work a bracket is worth.

    Attributes
    ----------
    gap:
        Narrow enough: this share of the upper bound.
    clock, deadline_s:
        Seconds, and how many of them each search may take. Without a clock none is read.
    should_end:
        Asked again and again; true ends the work with what has been reached.
    progress:
        Told quantity, lower and upper bound now and then.
    max_boxes:
        Boxes that are kept at a time (300 bytes each). Where so many are open, a search with a deadline looks
        for a gap of 0.1, or of two thirds of what is reached, with the boxes at hand; one without a deadline
        ends.
    """

    gap: float = 0.01
    clock: Callable[[], float] | None = None
    deadline_s: float = math.inf
    should_end: Callable[[], bool] | None = None
    progress: Callable[[str, float, float], None] | None = None
    max_boxes: int = 1 << 20

    def __post_init__(self) -> None:
        if not 0.0 < self.gap < 1.0:
            raise SetupError(f"effort: gap {self.gap:g} must be between 0 and 1")
        if not self.deadline_s > 0.0:
            raise SetupError(f"effort: deadline of {self.deadline_s:g} s must be above zero")
        if self.deadline_s < math.inf and self.clock is None:
            raise SetupError("effort: a deadline needs a clock")
        if self.max_boxes < 2:
            raise SetupError(f"effort: {self.max_boxes} boxes are too few; at least 2")

    def now(self) -> float:
        """Return the time [s], NaN without a clock."""
        return self.clock() if self.clock is not None else math.nan

    def end(self, begun: float) -> Ended | None:
        """Return why the work has to end now, or None."""
        if self.should_end is not None and self.should_end():
            return Ended.INTERRUPTED
        return Ended.DEADLINE if self.now() - begun >= self.deadline_s else None
