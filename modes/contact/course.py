"""A simulated arm in the loop with the machine, and what happened in each control step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.contact.machine import ContactMachine, Decision, Measured, Reason, State
from modes.contact.touches import Touch
from modes.contact.twin import Twin
from robots.errors import SetupError

Array = NDArray[np.float64]
Touches = Sequence[Touch]
Spoil = Callable[[Measured], Measured]
"""Does to what was measured whatever a broken sensor would."""


def believe(measured: Measured) -> Measured:
    """Leave what was measured as it is."""
    return measured


class Change(NamedTuple):
    """The machine went over to ``state`` at ``t`` [s]."""

    t: float
    state: State
    reason: Reason


@dataclass(slots=True)
class Course:
    """What happened, control step by control step.

    Attributes
    ----------
    decisions:
        Of the machine.
    t:
        Instants [s].
    """

    decisions: list[Decision] = field(default_factory=list)
    t: list[float] = field(default_factory=list)

    def note(self, t: float, decision: Decision) -> None:
        """Note a control step."""
        self.decisions.append(decision)
        self.t.append(t)

    def changes(self, begin: float = 0.0, end: float = np.inf) -> list[Change]:
        """Return the states that were entered between two instants."""
        found: list[Change] = []
        before: State | None = None
        for t, decision in zip(self.t, self.decisions, strict=True):
            if decision.state is not before and before is not None and begin <= t < end:
                found.append(Change(t, decision.state, decision.reason))
            before = decision.state
        return found

    def place(self, t: float) -> Array:
        """Return where the tool is at ``t`` (3,) [m], or at the last step before it."""
        return self.decisions[max(0, int(np.searchsorted(self.t, t, side="right")) - 1)].place

    def wanders(self, begin: float, end: float) -> float:
        """Return how far the tool goes from where it is at ``begin``, until ``end`` [m]."""
        places = [d.place for t, d in zip(self.t, self.decisions, strict=True) if begin <= t < end]
        return max((float(np.linalg.norm(each - places[0])) for each in places), default=0.0)


class Loop:
    """Twin and machine without anybody in between: what the machine wants is what the drives get.

    Parameters
    ----------
    twin, machine:
        Of one arm.
    spoil:
        What becomes of each measurement on its way.

    Raises
    ------
    SetupError
        Their control steps differ.
    """

    def __init__(self, twin: Twin, machine: ContactMachine, spoil: Spoil = believe) -> None:
        wanted = machine.settings.period_s
        if abs(twin.period_s - wanted) > 1e-12:
            raise SetupError(
                f"loop: a control step of the twin is {twin.period_s:g} s, of the machine {wanted:g} s"
            )
        self.twin, self.machine, self.spoil = twin, machine, spoil
        self.measured = twin.follow(np.zeros(len(twin.q)))

    def step(self, touches: Touches = ()) -> Decision:
        """Let the machine decide on what was measured, and the arm move for a control step."""
        decision = self.machine.step(self.twin.q, self.spoil(self.measured))
        self.measured = self.twin.follow(decision.dq, touches)
        return decision

    def run(self, end_s: float, touches: Touches = (), note: Callable[[float], None] | None = None) -> Course:
        """Run until ``end_s`` of the twin's time; ``note`` is told each instant."""
        course, period = Course(), self.machine.settings.period_s
        while self.twin.t < end_s - 0.5 * period:
            t = self.measured.t
            course.note(t, self.step(touches))
            if note is not None:
                note(t)
        return course
