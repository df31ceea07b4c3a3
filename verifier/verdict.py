"""What a cycle's check answers: a status, its reason, and the evidence.

There is no default verdict: every field must be given, and ``VERIFIED`` is reached only through
:meth:`verifier.cycle.CycleCheck.check`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple


class Status(IntEnum):
    """The four outcomes (docs/method.md, section 1). Their numbers stand in ``per_cycle.status``."""

    NOT_CHECKED = 0
    NOT_VERIFIED = 1
    VERIFIED = 2
    CONTRADICTED = 3


class Reason(IntEnum):
    """Why a cycle has its status."""

    SEPARATED = 0
    AT_REST = 1
    NOBODY_ASSUMED = 2
    REACHABLE = 3
    UNRESOLVED = 4
    NO_STOP_WITHIN_LIMITS = 5
    STATE_BEYOND_LIMITS = 6
    PERSON_WITHOUT_BOUND = 7
    NO_REPORT_YET = 8
    BEYOND_END = 9
    PERSON_OUTSIDE_PREDICTION = 10
    ROBOT_OUTSIDE_TRACKING = 11
    PEOPLE_STREAM_GAP = 12
    ROBOT_STREAM_GAP = 13
    INCONSISTENT_REPORTS = 14
    NOBODY_REPORTED = 15
    STALE_EMPTY_REPORT = 16
    EMPTY_PLAN = 17
    UNREPORTED_PERSON = 18
    NO_ROOM = 19
    STOP_NOT_FOLLOWED = 20
    NOT_OBSERVED = 21
    CLOCK = 22
    FAULT = 23
    FIXTURE_IN_REACH = 24
    LINKS_IN_REACH = 25
    CONTACT_WITHIN_LIMITS = 26
    SILENCE = 27
    UNCOMMANDED_JOINT_MOVED = 28

    @property
    def text(self) -> str:
        """One clause for people."""
        return _REASON_TEXT[self]


_REASON_TEXT: dict[Reason, str] = {
    Reason.SEPARATED: "every link stays apart from every body part until the robot has stopped",
    Reason.AT_REST: "the robot stands still",
    Reason.NOBODY_ASSUMED: "nobody is there by assumption",
    Reason.REACHABLE: "a person could reach a link before it has stopped",
    Reason.UNRESOLVED: "the limit of distance calls was reached before every pair was resolved",
    Reason.NO_STOP_WITHIN_LIMITS: "no stop stays within the joint limits",
    Reason.STATE_BEYOND_LIMITS: "the motion before the stop exceeds a joint limit by itself",
    Reason.PERSON_WITHOUT_BOUND: "none of the models encloses some body part from what was measured",
    Reason.NO_REPORT_YET: "no report about people has arrived yet",
    Reason.BEYOND_END: "the stop would end after the last sample",
    Reason.STOP_NOT_FOLLOWED: "the stop takes longer than stops are followed",
    Reason.PERSON_OUTSIDE_PREDICTION: "a person was later seen outside the predicted set",
    Reason.ROBOT_OUTSIDE_TRACKING: "the robot left its declared tracking error",
    Reason.UNCOMMANDED_JOINT_MOVED: "a joint that is not commanded moved, or left its range",
    Reason.PEOPLE_STREAM_GAP: "the reports about people paused for longer than allowed",
    Reason.ROBOT_STREAM_GAP: "the joint samples paused for longer than allowed",
    Reason.NOBODY_REPORTED: "a complete report listed nobody",
    Reason.STALE_EMPTY_REPORT: "the last report listed nobody, but is incomplete or too old",
    Reason.UNREPORTED_PERSON: "somebody not yet reported could have reached a link before it had stopped",
    Reason.NO_ROOM: "more people, or more reports that contradict each other, than there is room for",
    Reason.NOT_OBSERVED: "nothing is known about who is in the monitored region: no complete report, or none "
    "for too long",
    Reason.CONTACT_WITHIN_LIMITS: "what links do not stay apart from, they may touch: declared parts, slowly",
    Reason.FIXTURE_IN_REACH: "a link could touch a fixture or the floor before it has stopped",
    Reason.LINKS_IN_REACH: "two links of the robot could touch each other before it has stopped",
    Reason.EMPTY_PLAN: "the plan has no slices, or not one row for every link and slice",
    Reason.INCONSISTENT_REPORTS: "reports about one person contradict each other or the profile",
    Reason.CLOCK: "the clock did not advance, or is not a number",
    Reason.FAULT: "an internal fault: nothing was checked",
    Reason.SILENCE: "a command was not handed over: the robot stops by itself, nobody knows where",
}

STATUS_OF_REASON: dict[Reason, Status] = {
    Reason.SEPARATED: Status.VERIFIED,
    Reason.AT_REST: Status.VERIFIED,
    Reason.NOBODY_ASSUMED: Status.VERIFIED,
    Reason.NOBODY_REPORTED: Status.VERIFIED,
    Reason.STALE_EMPTY_REPORT: Status.NOT_VERIFIED,
    Reason.UNREPORTED_PERSON: Status.CONTRADICTED,
    Reason.STOP_NOT_FOLLOWED: Status.NOT_VERIFIED,
    Reason.NO_ROOM: Status.NOT_VERIFIED,
    Reason.NOT_OBSERVED: Status.NOT_VERIFIED,
    Reason.EMPTY_PLAN: Status.NOT_VERIFIED,
    Reason.CONTACT_WITHIN_LIMITS: Status.VERIFIED,
    Reason.FIXTURE_IN_REACH: Status.NOT_VERIFIED,
    Reason.LINKS_IN_REACH: Status.NOT_VERIFIED,
    Reason.REACHABLE: Status.NOT_VERIFIED,
    Reason.UNRESOLVED: Status.NOT_VERIFIED,
    Reason.NO_STOP_WITHIN_LIMITS: Status.NOT_VERIFIED,
    Reason.STATE_BEYOND_LIMITS: Status.NOT_VERIFIED,
    Reason.PERSON_WITHOUT_BOUND: Status.NOT_VERIFIED,
    Reason.NO_REPORT_YET: Status.NOT_CHECKED,
    Reason.BEYOND_END: Status.NOT_CHECKED,
    Reason.PERSON_OUTSIDE_PREDICTION: Status.CONTRADICTED,
    Reason.ROBOT_OUTSIDE_TRACKING: Status.CONTRADICTED,
    Reason.UNCOMMANDED_JOINT_MOVED: Status.CONTRADICTED,
    Reason.PEOPLE_STREAM_GAP: Status.CONTRADICTED,
    Reason.ROBOT_STREAM_GAP: Status.CONTRADICTED,
    Reason.INCONSISTENT_REPORTS: Status.CONTRADICTED,
    Reason.CLOCK: Status.NOT_CHECKED,
    Reason.FAULT: Status.NOT_CHECKED,
    Reason.SILENCE: Status.NOT_CHECKED,
}
"""Each reason belongs to exactly one status; a verdict cannot pair them otherwise."""


class CriterionKind(IntEnum):
    """The rules a plan can be held against; the value is the bit in ``Verdict.not_checked``."""

    SEPARATION = 0
    POWER_AND_FORCE_LIMITING = 1
    JOINT_LIMITS = 2
    SELF_COLLISION = 3
    WORKSPACE = 4
    TORQUE = 5


CRITERION_OF_REASON: dict[Reason, CriterionKind] = {
    Reason.NO_STOP_WITHIN_LIMITS: CriterionKind.JOINT_LIMITS,
    Reason.STATE_BEYOND_LIMITS: CriterionKind.JOINT_LIMITS,
    Reason.FIXTURE_IN_REACH: CriterionKind.WORKSPACE,
    Reason.LINKS_IN_REACH: CriterionKind.SELF_COLLISION,
    Reason.CONTACT_WITHIN_LIMITS: CriterionKind.POWER_AND_FORCE_LIMITING,
}
"""Which rule decided, where it was not separation."""


def criterion_names(mask: int) -> tuple[str, ...]:
    """Names of the criteria in a mask, such as :attr:`Verdict.not_checked`."""
    return tuple(kind.name.lower() for kind in CriterionKind if mask >> kind & 1)


class Verdict(NamedTuple):
    """The answer for one cycle.

    Attributes
    ----------
    status, reason:
        What is claimed, and why; built together by :func:`verdict`.
    t:
        Instant t_k at which the cycle was judged [s, cell's clock].
    gap_m:
        Certified gap of the tightest pair of link and person [m] when verified; estimated gap of the nearest
        pair in the first open slice when not verified (negative: overlap), also of a link and a fixture or
        of two links; NaN when no pair was compared.
    stop_time_s:
        Duration of the failsafe manoeuvre [s]; NaN without one.
    criterion:
        ``CriterionKind`` that decided.
    not_checked:
        Bit mask of criteria that were not looked at.
    """

    status: Status
    reason: Reason
    t: float
    gap_m: float
    stop_time_s: float
    criterion: int
    not_checked: int


def verdict(
    reason: Reason,
    t: float,
    *,
    gap_m: float,
    stop_time_s: float,
    not_checked: int,
    criterion: CriterionKind = CriterionKind.SEPARATION,
) -> Verdict:
    """Build the verdict that ``reason`` stands for; ``criterion`` where the reason does not name its own."""
    criterion = CRITERION_OF_REASON.get(reason, criterion)
    return Verdict(STATUS_OF_REASON[reason], reason, t, gap_m, stop_time_s, int(criterion), not_checked)


def not_followed(answer: Verdict) -> Verdict:
    """Return the verdict on a plan that goes on beyond the samples at hand, where more samples follow."""
    reason = Reason.STOP_NOT_FOLLOWED
    return answer._replace(status=STATUS_OF_REASON[reason], reason=reason)


@dataclass(frozen=True, slots=True)
class Witness:
    """The pair that decided a cycle.

    Attributes
    ----------
    cycle_t:
        Instant t_k of the cycle [s, cell's clock].
    slice:
        Start and end of the time slice [s, cell's clock].
    link, person, part:
        Names; ``part`` lists several parts joined by ``+`` when one set encloses them. Both are empty where
        ``other`` is not.
    other:
        Name of the fixture or of the second link that ``link`` could touch; empty: it is a person.
    gap_m:
        As in :class:`Verdict`.
    points:
        Nearest points on link and body part, shape (2, 3) [m, world]; NaN where unknown.
    criterion, model:
        Names of the rule and of the model of people.
    inferred:
        The part was not measured; its set was inferred from measured points.
    age_s:
        How long before ``cycle_t`` the points were seen that the part's set rests on [s]; NaN: never.
    silent_models:
        The models that were asked, where none of them says anything of the part, whatever is measured.
    no_contact:
        Why the link may not touch the part, where the cell declares that it may: a speed, or a gap.
    """

    cycle_t: float
    slice: tuple[float, float]
    link: str
    person: str
    part: str
    gap_m: float
    points: tuple[tuple[float, float, float], tuple[float, float, float]]
    criterion: str
    model: str
    inferred: bool
    age_s: float
    budget: Budget
    other: str = ""
    silent_models: tuple[str, ...] = ()
    no_contact: str = ""

    @property
    def region(self) -> str | None:
        """Monitored region from beyond whose border somebody may come; ``None``: somebody who is listed."""
        kind, _, name = self.model.partition(":")
        return name if kind == "unobserved" else None

    @property
    def room_m(self) -> float:
        """Distance of the link from the bare body points or the bare border of the region [m]."""
        return self.budget.distance - self.budget.link

    @property
    def shrink_first(self) -> str:
        """Term of the budget to work on first; *region* where the link is not inside of the monitored one.

        Empty where no metres can be counted, because the part cannot be enclosed.
        """
        if self.region is not None and self.room_m <= self.budget.margin:
            return "region"
        if self.other:
            return "error"
        return self.budget.shrink_first(inferred=self.inferred)


@dataclass(frozen=True, slots=True)
class Budget:
    """Where the metres go: what the gap of a witness is made of, each term in metres.

    Attributes
    ----------
    latency:
        Growth of the person's set between observation and decision: speed x age, clock error included.
    stop:
        Growth between decision and the end of the slice: two cycles, the stop so far, the robot's delay.
    error:
        Position error of the measurement or the fixture, tracking error and curvature of the robot's sweep;
        of two links, what may happen between the ends of the slice.
    body:
        Radius of the body part around its measured points, of the second link, or of a fixture's capsule.
    margin:
        What the gap must exceed.
    distance:
        Distance between the bare link axis sweep and the bare body points, before anything is subtracted.
    link:
        Radius of the link's capsule.
    sides:
        Growth because left and right may have been exchanged (``people.left_right``).
    """

    latency: float
    stop: float
    error: float
    body: float
    margin: float
    distance: float
    link: float
    sides: float = 0.0

    def shrink_first(self, *, inferred: bool) -> str:
        """Name the largest term that an engineer can work on; a body radius only where it was inferred.

        Empty where there are no terms.
        """
        terms = {"latency": self.latency, "stop": self.stop, "error": self.error, "sides": self.sides}
        if inferred:
            terms["body"] = self.body
        if not all(map(math.isfinite, terms.values())):
            return ""
        return max(terms, key=lambda name: terms[name])
