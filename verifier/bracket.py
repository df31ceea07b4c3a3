"""How far a number can be taken before something is not verified: coarse steps, then bisection.

Nothing is assumed about what lies between the values that were tried, nor beyond the first one that failed: a
bracket says what was tried and how it went. The value that it answers with was tried itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from robots.errors import SetupError
from verifier.verdict import Reason

_DIGITS = 9
"""Decimals of the values that are tried, so that they can be written down as they were."""


@dataclass(frozen=True, slots=True)
class Scale:
    """The values that may be tried, evenly spaced.

    Attributes
    ----------
    easiest, hardest:
        The value that asks least of the robot, which is tried first, and the one that asks most.
    step:
        Distance of two values, above 0; ``hardest`` is left out where no whole number of steps leads to it.
    coarse:
        So many steps are taken at once until a value fails.

    Raises
    ------
    SetupError
        A number is not finite, the step is not positive, or the two ends are less than a step apart.
    """

    easiest: float
    hardest: float
    step: float
    coarse: int

    def __post_init__(self) -> None:
        ends = f"{self.easiest:g} … {self.hardest:g}"
        if not (math.isfinite(self.easiest) and math.isfinite(self.hardest)):
            raise SetupError(f"values to try, {ends}, should be finite")
        if not (0.0 < self.step < math.inf and self.coarse >= 1):
            raise SetupError(f"steps of {self.step:g}, {self.coarse} at once: should be positive")
        if not self.steps >= 1:
            raise SetupError(f"values to try, {ends}, should be at least a step of {self.step:g} apart")

    @property
    def steps(self) -> int:
        """Number of steps from the easiest value to the hardest."""
        return math.floor(abs(self.hardest - self.easiest) / self.step + 1e-6)

    @property
    def most_trials(self) -> int:
        """No search takes more trials."""
        return 2 + math.ceil(self.steps / self.coarse) + math.ceil(math.log2(min(self.coarse, self.steps)))

    def value(self, number: int) -> float:
        """Return value ``number``, 0 for the easiest."""
        return round(self.easiest + math.copysign(self.step, self.hardest - self.easiest) * number, _DIGITS)


@dataclass(frozen=True, slots=True)
class Failure:
    """The first cycle that is not verified: its instant [s], and why. ``None``: no cycle was checked."""

    t: float | None
    reason: Reason | None

    @property
    def text(self) -> str:
        """One clause for people."""
        if self.t is None or self.reason is None:
            return "no cycle was checked"
        return f"at {self.t:.3f} s {self.reason.text}"


@dataclass(frozen=True, slots=True)
class Trial:
    """One value, how many cycles were verified with it, and the first that was not; ``None``: all were."""

    value: float
    verified: int
    failure: Failure | None


@dataclass(frozen=True, slots=True)
class Bracket:
    """What a search has found.

    Attributes
    ----------
    verified_at:
        The hardest value with which every cycle that was checked is verified, no easier one that was tried
        having failed; ``None``: there is none.
    not_verified_at:
        The next value that was tried beyond it, with which some cycle is not; ``None``: none harder was to be
        tried.
    cycles:
        How many cycles were verified at ``verified_at``.
    failure:
        Why not at ``not_verified_at``.
    trials:
        Everything that was tried, in this order.
    """

    verified_at: float | None
    not_verified_at: float | None
    cycles: int
    failure: Failure | None
    trials: tuple[Trial, ...]


class Search:
    """Looks for the hardest value of a scale that holds: ask for ``next``, try it, ``tell``."""

    def __init__(self, scale: Scale) -> None:
        self._scale = scale
        self._holds, self._fails = -1, scale.steps + 1
        self._trials: list[Trial] = []
        self._found: dict[int, Trial] = {}

    @property
    def _next(self) -> int | None:
        """Number of the next value; ``None``: the search is over."""
        if self._holds < 0:
            return None if self._fails == 0 else 0
        if self._fails > self._scale.steps:
            further = min(self._scale.steps, self._holds + self._scale.coarse)
            return further if further > self._holds else None
        return None if self._fails - self._holds == 1 else (self._holds + self._fails) // 2

    @property
    def next(self) -> float | None:
        """The value to try next; ``None``: the search is over."""
        number = self._next
        return None if number is None else self._scale.value(number)

    def tell(self, verified: int, failure: Failure | None) -> None:
        """Say how the value asked for went: cycles that are verified, and the first that is not.

        A value with which no cycle was checked does not hold.
        """
        number = self._next
        assert number is not None, "a search that is over asks for nothing"
        if failure is None and verified == 0:
            failure = Failure(None, None)
        trial = Trial(self._scale.value(number), verified, failure)
        self._trials.append(trial)
        self._found[number] = trial
        if failure is None:
            self._holds = number
        else:
            self._fails = number

    @property
    def bracket(self) -> Bracket:
        """What has been found so far."""
        holds, fails = self._found.get(self._holds), self._found.get(self._fails)
        return Bracket(
            None if holds is None else holds.value,
            None if fails is None else fails.value,
            0 if holds is None else holds.verified,
            None if fails is None else fails.failure,
            tuple(self._trials),
        )
