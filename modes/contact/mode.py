"""Contact as a mode: what the machine wants, as joint velocities and stops for the supervisor.

It proposes. While a person guides the tool, separation cannot hold for the hand that does: the cell names
power and force limiting for the pair of tool and hand, and separation for everybody and everything else
(docs/contact.md).
"""

from __future__ import annotations

from collections.abc import Callable

from modes.contact.admittance import CyclicTask
from modes.contact.machine import ContactMachine, ContactSettings, Decision, Measured, State
from modes.settings import require_number
from robots.model import RobotModel
from verifier.proposal import JointVelocity, Proposal, SceneView, Stop

_WAITS = frozenset({State.CHECK, State.COLLISION, State.FAULT})


class ContactMode:
    """The mode: one step of the machine per call.

    Parameters
    ----------
    robot:
        The supervisor's.
    task:
        What the arm does while nobody is in contact.
    settings:
        Thresholds and gains; among them the time between two calls.
    read:
        Returns what was measured since the last call; ``None``: nothing has come, so that nothing is proposed
        and the arm comes to rest.
    horizon_s:
        From so long after each velocity the arm brakes, unless another one comes [s].

    Attributes
    ----------
    decision:
        The last one; ``None``: there was none.

    Raises
    ------
    SetupError
        Settings do not fit the arm, or the horizon is out of its range.
    """

    name = "contact"

    def __init__(
        self,
        robot: RobotModel,
        task: CyclicTask,
        settings: ContactSettings,
        read: Callable[[], Measured | None],
        horizon_s: float = 0.1,
    ) -> None:
        require_number("contact: horizon_s", horizon_s, settings.period_s, 1.0)
        self.machine = ContactMachine(robot, task, settings)
        self.decision: Decision | None = None
        self._read, self._horizon = read, horizon_s

    def propose(self, view: SceneView) -> Proposal | None:
        """Return the wanted velocity, or a stop where the arm is to wait; ``None``: nothing was measured."""
        measured = self._read()
        if measured is None:
            return None
        self.decision = decision = self.machine.step(view.q, measured, view.dq)
        if decision.state in _WAITS:
            return Stop()
        return JointVelocity(decision.dq, self._horizon)
