"""Modes beside the loop: plug-ins of the entry-point group ``stopproof.modes``, each in a thread of its own.

A mode that raises, blocks, or proposes nonsense costs productivity only: what it proposes is prepared in its
own thread and verified like any plan. A mode that computes for long belongs into a process of its own, since
all threads of Python take turns (examples/planner_process.py).
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

from failsafe.preparation import Refusal
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.plug_ins import find_plug_in, plug_in_names
from verifier.proposal import Mode
from verifier.supervisor import Supervisor

GROUP = "stopproof.modes"


def mode_names() -> tuple[str, ...]:
    """Return the names of the modes that are installed."""
    return plug_in_names(GROUP)


def load_mode(name: str, robot: RobotModel | None = None) -> Mode:
    """Make the installed mode of that name.

    ``robot``: the supervisor's; a mode whose class has a true ``needs_robot`` is made with it.

    Raises
    ------
    SetupError
        There is none, or it cannot be made.
    """
    found = find_plug_in(GROUP, name, "mode")
    why = f"mode {name!r} cannot be made"
    try:
        factory = found.load()
    except Exception as error:
        raise SetupError(f"{why}: {type(error).__name__}: {error}") from error
    given = (robot,) if getattr(factory, "needs_robot", False) else ()
    if given == (None,):
        raise SetupError(f"{why}: it needs to know the robot: load_mode(name, robot)")
    try:
        mode: Mode = factory(*given)
    except Exception as error:
        raise SetupError(f"{why}: {type(error).__name__}: {error}") from error
    if not callable(getattr(mode, "propose", None)):
        raise SetupError(f"mode {name!r} has no method propose")
    if not isinstance(getattr(mode, "name", None), str):
        raise SetupError(f"mode {name!r} has no name: give its class a string `name`")
    return mode


@dataclass(slots=True)
class ModeReport:
    """What a mode has done: calls, what was handed on, refused, raised; the last refusal and exception.

    A proposal that is handed on may still be refused in the next step; ``Supervisor.refusal`` says so.
    """

    calls: int = 0
    handed_on: int = 0
    refused: int = 0
    faults: int = 0
    refusal: Refusal | None = None
    fault: Exception | None = None


class Proposals:
    """Lets several modes propose to one supervisor, one at a time."""

    def __init__(self, supervisor: Supervisor) -> None:
        self.supervisor = supervisor
        self._one_at_a_time = threading.Lock()

    def ask(self, mode: Mode, report: ModeReport) -> None:
        """Call a mode once and hand on what it proposes; never raises what the mode does."""
        report.calls += 1
        try:
            proposal = mode.propose(self.supervisor.view())
            if proposal is None:
                return
            with self._one_at_a_time:
                refusal = self.supervisor.propose(proposal)
            told = getattr(mode, "refused", None)
            if refusal is not None and callable(told):
                told(refusal)
        except Exception as error:
            report.faults += 1
            report.fault = error
            return
        if refusal is None:
            report.handed_on += 1
        else:
            report.refused += 1
            report.refusal = refusal


class ModeRunner:
    """Calls a mode again and again in a thread of its own.

    Parameters
    ----------
    proposals:
        Shared by all modes of a supervisor.
    mode:
        What is called.
    period_s:
        Time from the end of a call to the next one [s].

    Raises
    ------
    SetupError
        ``period_s`` is not above 0 and finite, or ``mode`` is none.
    """

    def __init__(self, proposals: Proposals, mode: Mode, period_s: float) -> None:
        if not 0.0 < period_s < math.inf:
            raise SetupError(f"period of {period_s} s of a mode should be above 0 and finite")
        if not (isinstance(getattr(mode, "name", None), str) and callable(getattr(mode, "propose", None))):
            kind = type(mode).__name__
            raise SetupError(f"{kind} is no mode: give it a `name` and a method `propose(view)`")
        self.report = ModeReport()
        self._proposals, self._mode, self._period = proposals, mode, period_s
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"mode {mode.name}", daemon=True)

    def start(self) -> None:
        """Begin; once only."""
        self._thread.start()

    def stop(self, wait_s: float = 1.0) -> bool:
        """Let the mode end; return whether it has within ``wait_s`` [s]. One that blocks is left behind."""
        self._end.set()
        self._thread.join(wait_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._end.is_set():
            self._proposals.ask(self._mode, self.report)
            self._end.wait(self._period)
