"""What a mode may propose. Nothing here is believed: what comes of a proposal is verified like any plan."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from failsafe.preparation import Refusal
from failsafe.trajectory import IntendedTrajectory
from occupancy.body import MAX_POINTS
from robots.motion import Block

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class NewTrajectory:
    """Another intended trajectory.

    Attributes
    ----------
    trajectory:
        Its path parameter at its begin is where it joins.
    join_s:
        Path parameter [s] of the present trajectory at which it goes over into the new one, with q, q', q''
        equal; beyond the end of the running plan's stop. ``None``: from standstill, where the robot rests.
    """

    trajectory: IntendedTrajectory
    join_s: float | None = None


@dataclass(frozen=True, slots=True)
class PathSpeed:
    """Go along the path at ``sdot`` times its own speed; 0 stops on the path, below 0 goes back along it.

    Above 1 as far as the limits allow. To go the other way, the robot first comes to rest on the path.
    """

    sdot: float


@dataclass(frozen=True, slots=True)
class Stop:
    """Stop on the path, and stay there until something else is proposed."""


@dataclass(frozen=True, slots=True, eq=False)
class JointVelocity:
    """Go over to joint velocities, and come to rest when nothing newer is proposed.

    Attributes
    ----------
    dq:
        ``(n,)`` [rad/s; m/s for prismatic joints]. A joint brakes earlier where it could not rest within its
        position limits otherwise.
    horizon_s:
        From this long after the joints leave the present path they brake [s].
    """

    dq: Array
    horizon_s: float


Proposal = NewTrajectory | PathSpeed | JointVelocity | Stop


@dataclass(frozen=True, slots=True, eq=False)
class SeenPerson:
    """What was measured last of a person; the same id twice: either may be true.

    Attributes
    ----------
    id:
        As reports name them.
    t:
        ``(20,)`` when each :class:`~occupancy.body.Point` was seen [s, cell's clock]; NaN: never.
    xyz:
        ``(20, 3)`` where [m, world]; NaN: never seen.
    error_m:
        ``(20,)`` of the position [m].
    """

    id: str
    t: Array
    xyz: Array
    error_m: Array


@dataclass(frozen=True, slots=True, eq=False)
class SceneView:
    """What a mode is shown: copies, made by the cycle before.

    Attributes
    ----------
    t:
        Instant of the command that was returned last [s, cell's clock].
    q, dq:
        Commanded ``(n,)`` [rad, rad/s; m, m/s].
    s, sdot:
        Where the robot is on its path, and how fast; NaN off the path.
    s_rest:
        Where the running plan comes to rest [s]: a new trajectory may join from there on.
    outcome:
        Name of the state of the supervisor.
    refusal:
        Why the last step that refused a proposal did so, a trajectory that joined too late for instance.
    dq_ds:
        ``(n,)`` joint motion per path parameter where the robot is: ``dq`` would be this at path speed 1; NaN
        off the path.
    people:
        Who is known.
    not_verified:
        Name of the :class:`~verifier.verdict.Reason` for which the last step did not verify its plan; empty:
        it did, or made none.
    """

    t: float
    q: Array
    dq: Array
    s: float
    sdot: float
    s_rest: float
    outcome: str
    refusal: Refusal | None = None
    dq_ds: Array = field(default_factory=lambda: np.empty(0))
    people: tuple[SeenPerson, ...] = ()
    not_verified: str = ""


def seen_people(people: Block, ids: tuple[str, ...], epoch: float) -> tuple[SeenPerson, ...]:
    """Return copies of a people block whose times count from ``epoch`` [s]."""
    rows, found = people[0], []
    bits = np.arange(MAX_POINTS, dtype=np.uint32)
    for k in range(int(rows["n"])):
        there = (rows["present"][k] >> bits) & 1 == 1
        t = np.where(there, rows["t_obs"][k] + rows["stamp_error"] + epoch, np.nan)
        xyz = np.where(there[:, None], rows["xyz"][k], np.nan)
        found.append(SeenPerson(ids[rows["person"][k]], t, xyz, np.where(there, rows["e_p"][k], np.nan)))
    return tuple(found)


class Mode(Protocol):
    """A plug-in of the entry-point group ``stopproof.modes``: it proposes, the supervisor disposes."""

    name: str

    def propose(self, view: SceneView) -> Proposal | None:
        """Return what the mode would like, or ``None``. Runs in a thread or process of its own."""
        ...
