"""Which pair decides a plan and which way the path moves it; why a plan is not verified, as a constraint."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from failsafe.plan import PlanOutcome, PlanResult
from occupancy.separation import Nearest
from occupancy.sets import nearest_weights
from robots.kernels import forward, velocities
from robots.model import RobotModel
from robots.motion import MAX_JOINTS
from verifier.cycle import CycleCheck
from verifier.evidence import Judged, deepest, robot_witness, witness
from verifier.outlook import Made, Outlook
from verifier.verdict import Reason, Status, Verdict, Witness

Array = NDArray[np.float64]

_NOWHERE = math.nan, math.nan


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """The pair that decides a plan: the tightest if it is verified, else the one that lacks most.

    Attributes
    ----------
    witness:
        Link, person, part, gap [m], the two nearest points, slice; times on the caller's clock.
    direction:
        ``(3,)`` unit vector from the link to the part; NaN where there is none.
    s:
        Path parameter [s] in the middle of the slice.
    opening_m_s:
        By how much the gap grows per second of path there, the part's set held still: the speed of the
        nearest point of the link away from the part at path speed 1 [m/s]. Negative: the path goes towards
        the part. NaN where unknown, or where it is not a person.
    """

    witness: Witness
    direction: Array
    s: float
    opening_m_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Constraint:
    """Why a plan is not verified, in numbers for a planner.

    Attributes
    ----------
    reason:
        As in the verdict.
    link, other:
        Names of the link and of what is in its way (part and person, fixture, or another link); empty where
        no two things were compared.
    t, s:
        Slice [s, caller's clock] and path parameter [s] of the pair that lacks most; NaN without one.
    lacking_m:
        How much farther away the part or fixture would have to be for this pair to be verified [m]; infinite
        where no distance helps, NaN where it is not a matter of distance.
    path_speed:
        Path speed that would be verified, as :class:`~verifier.safety_state.SafetyState` says; 0: none.
    joint, quantity, value, limit:
        Where no stop keeps the limits: which joint (empty: the path itself), what of it, and how much.
    pair:
        The pair in full.
    """

    reason: Reason
    link: str
    other: str
    t: tuple[float, float]
    s: float
    lacking_m: float
    path_speed: float
    joint: str
    quantity: str
    value: float
    limit: float
    pair: Pair | None

    @property
    def text(self) -> str:
        """One clause for people."""
        if self.link:
            slower = (
                f"there a path speed of {self.path_speed:.3f} is verified"
                if self.path_speed > 0.0
                else "stop"
            )
            why = "" if self.pair is None else self.pair.witness.no_contact
            declared = f"; contact is declared, but {why}" if why else ""
            return (
                f"{self.link} lacks {self.lacking_m:.3f} m from {self.other} at s = {self.s:.3f} s; {slower}"
                f"{declared}"
            )
        if self.quantity:
            who = f"joint {self.joint}" if self.joint else "the path"
            return f"{self.quantity} of {who} would be {self.value:.4g}, limit {self.limit:.4g}"
        return self.reason.text


class PairFinder:
    """Looks for the pair that decides a plan.

    Parameters
    ----------
    check:
        A check of its own without a limit on distance calls, so that every pair is resolved.
    margin_m:
        What a gap must exceed [m].
    """

    def __init__(self, check: CycleCheck, margin_m: float) -> None:
        self._check = check
        self._margin = margin_m
        self._motion = _LinkMotion(check.robot)

    def find(self, outlook: Outlook, made: Made) -> Pair | None:
        """Return the pair that decides a plan with what is known; ``None``: no two things were compared."""
        check, known = self._check, outlook.known
        judge = check.check_moving if outlook.target > 0.0 else check.check
        answer = judge(outlook.now, made.result, made.slices, known)
        cycle = Judged(outlook.now, made.slices, known.people, outlook.ids, self._margin)
        blocked = robot_witness(check, cycle)
        if blocked is not None:
            toward = np.subtract(blocked.points[1], blocked.points[0])
            length = float(np.linalg.norm(toward))
            direction = toward / length if blocked.gap_m > 0.0 and length > 0.0 else np.full(3, math.nan)
            return Pair(_since(blocked, outlook.epoch), direction, _path_parameter(blocked, made), math.nan)
        nearest = check.nearest
        if nearest is not None and answer.status is not Status.VERIFIED:
            nearest = deepest(check, cycle) or nearest
        found = witness(check, cycle, nearest)
        if found is None or nearest is None:
            return None
        s = _path_parameter(found, made)
        opening = self._opening(nearest, outlook, s)
        return Pair(_since(found, outlook.epoch), nearest.direction.copy(), s, opening)

    def constraint(self, outlook: Outlook, made: Made, verdict: Verdict, path_speed: float) -> Constraint:
        """Say why the verdict on a plan is not *verified*; ``path_speed``: what would be instead."""
        plan = made.result
        pair = self.find(outlook, made) if plan.outcome is PlanOutcome.READY else None
        if pair is None:
            return Constraint(
                verdict.reason, "", "", _NOWHERE, math.nan, math.nan, path_speed, *self._excess(plan), None
            )
        found = pair.witness
        lacking = self._margin - found.gap_m
        lacking = 0.0 if lacking < 0.0 else lacking
        other = found.other or f"{found.part} of {found.person}"
        return Constraint(
            verdict.reason, found.link, other, found.slice, pair.s, lacking, path_speed, "", "",
            math.nan, math.nan, pair,
        )  # fmt: skip

    def _excess(self, plan: PlanResult) -> tuple[str, str, float, float]:
        if plan.outcome is PlanOutcome.READY:
            return "", "", math.nan, math.nan
        joint = self._check.robot.joints[plan.joint] if plan.joint >= 0 else ""
        return joint, plan.quantity.name.lower(), plan.value, plan.limit

    def _opening(self, nearest: Nearest, outlook: Outlook, s: float) -> float:
        if nearest.people_row < 0 or not math.isfinite(s):
            return math.nan
        rows = self._check.occupancies[nearest.model].sets[0]
        part = rows["points"][nearest.people_row, : rows["n_points"][nearest.people_row]]
        q, dq, _, _ = outlook.trajectory.sample(s)
        self._motion.place(q, dq)
        axis, carried = self._motion.axis(nearest.link)
        share, toward = closest(axis, part)
        if not float(np.linalg.norm(toward)) > 0.0:
            toward = nearest.direction  # the hulls meet
            share = float(np.argmax(axis @ toward))
        speed = (1.0 - share) * carried[0] + share * carried[1]
        return -float(speed @ toward / np.linalg.norm(toward))


class _LinkMotion:
    """The axis of a link, and how fast its ends are carried along."""

    def __init__(self, robot: RobotModel) -> None:
        self._kinematics, self._enclosure = robot.kinematics, robot.enclosure
        self._q, self._dq = np.zeros(MAX_JOINTS), np.zeros(MAX_JOINTS)
        self._rotation = np.zeros((MAX_JOINTS, 3, 3))
        self._position, self._angular, self._linear = (np.zeros((MAX_JOINTS, 3)) for _ in range(3))

    def place(self, q: Array, dq: Array) -> None:
        """Take joint positions and velocities ``(n,)``."""
        self._q[: len(q)], self._dq[: len(q)] = q, dq
        forward(self._kinematics, self._q, self._rotation, self._position)
        velocities(self._kinematics, self._dq, self._rotation, self._position, self._angular, self._linear)

    def axis(self, link: int) -> tuple[Array, Array]:
        """Return the ends of the axis of an enclosure row ``(2, 3)`` [m] and their velocities [m/s]."""
        row = self._enclosure[0]
        joint = int(row["joint"][link])
        offset = np.stack([row["a"][link], row["b"][link]]) @ self._rotation[joint].T
        carried = self._linear[joint] + np.cross(self._angular[joint], offset)
        return self._position[joint] + offset, carried


def closest(axis: Array, points: Array) -> tuple[float, Array]:
    """Return where a segment ``(2, 3)`` is nearest to the hull of points ``(P, 3)``, and the way there (3,).

    The place is 0 at the first end and 1 at the second. The weights of the nearest difference of the two
    belong to pairs of points.
    """
    offset = (points[None] - axis[:, None]).reshape(-1, 3)
    weights = nearest_weights(offset)
    return float(weights[len(points) :].sum()), weights @ offset


def _path_parameter(found: Witness, made: Made) -> float:
    if made.motion is None:
        return math.nan
    return made.motion.path_state(0.5 * sum(found.slice) - made.begin).s


def _since(found: Witness, epoch: float) -> Witness:
    """Count the times of a witness from the caller's zero."""
    begin, end = found.slice
    return replace(found, cycle_t=found.cycle_t + epoch, slice=(begin + epoch, end + epoch))
