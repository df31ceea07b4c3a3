"""The supervisor: whatever it commands is part of a verified plan (docs/supervisor.md).

At the instant t_k the plan P that was adopted before is being executed. A step makes the next one,

    N = [t_k+1, t_k+2] of the intended motion from P(t_k+1) on, then a stop to standstill,

checks it against what is known, and adopts it, or else leaves P, whose stop then begins at t_k+1. Either way
the command for t_k+2 belongs to a plan that was verified before it began (docs/method.md, section 1).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from failsafe.plan import PlanOutcome, PlanResult, PlanSettings
from failsafe.preparation import Objection, Refusal, Reserve
from failsafe.running_plan import Motion, RunningPlan
from failsafe.scaling import PathState
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory, TrajectoryError
from failsafe.waypoints import rest_to_rest
from occupancy.report import Admission, RawMeasurement
from robots.errors import SetupError
from robots.limits import JointLimits
from verifier.cell import Cell
from verifier.command import Cause, Command, Running, State
from verifier.cycle import CycleCheck
from verifier.grid import Grid
from verifier.known import PeopleWatch
from verifier.number import as_float
from verifier.outlook import Made, Outlook
from verifier.proposal import Proposal, SceneView, seen_people
from verifier.proposed import Prepared, Proposals, WayBack
from verifier.setting_out import SettingOut, Start
from verifier.setup import build_supervised
from verifier.tracking import Deviation, JointReading, TrackingMonitor, between_commands
from verifier.verdict import CriterionKind, Reason, Status, Verdict, verdict

Array = NDArray[np.float64]

_SAME_PLACE = 1e-9
"""A trajectory from standstill begins where the robot rests, up to rounding [rad; m]."""

_OF_RESERVE = 0.75
"""Share that a connector uses of what intended motion may use of the limits."""


class _Onwards(NamedTuple):
    """A way off the path, and where the robot goes on: on which path, from where [s], in what heading.

    ``onto``: the way leads to the path; otherwise it is that of one who has turned round, away from it.
    """

    way: IntendedTrajectory
    path: IntendedTrajectory
    s: float
    heading: int
    onto: bool = True

    def turned(self, way: IntendedTrajectory) -> _Onwards:
        """Return the same with the way in the other direction."""
        return self._replace(way=way, onto=not self.onto)


@dataclass(frozen=True, slots=True)
class SupervisorSettings:
    """How the loop runs.

    Attributes
    ----------
    early_s:
        A step may be called this much before its instant [s].
    reserve:
        What trajectories must leave to the manoeuvres that follow them.
    """

    early_s: float
    reserve: Reserve = field(default_factory=Reserve)

    def __post_init__(self) -> None:
        if not 0.0 <= self.early_s < math.inf:
            raise SetupError(f"early_s = {self.early_s} should be finite and not negative")


class Supervisor:
    """Turns an intended trajectory into commands that can always still be followed by a verified stop.

    Parameters
    ----------
    check:
        Robot, models of people and criteria.
    watch:
        The gate for reports about people; of no other supervisor, which counts time from another epoch.
    plans:
        What plans look like; its cycle is that of the loop.
    settings:
        How the loop runs.
    q:
        ``(n,)`` where the robot stands still when the first step is called [rad; m].

    Attributes
    ----------
    fault:
        The last exception inside a step.
    refusal:
        Why what was proposed last was not taken over in a step.
    deviation:
        Where the robot was outside of its tracking error in the last step.
    admission:
        What was made of the report that was taken in last: points, persons or the whole may be refused.
        Its stamps count from the supervisor's begin.
    plan:
        The plan that was made last.

    Raises
    ------
    SetupError
        ``q`` has another number of joints, is not finite or outside the position limits.
    """

    def __init__(
        self,
        check: CycleCheck,
        watch: PeopleWatch,
        plans: PlanSettings,
        settings: SupervisorSettings,
        q: Array,
    ) -> None:
        limits = check.robot.limits
        start = _standing_at(q, limits)
        self.check = check
        self.watch = watch
        self.fault: Exception | None = None
        self.refusal: Refusal | None = None
        self.deviation: Deviation | None = None
        self.admission: Admission | None = None
        self.plan = PlanResult(PlanOutcome.INVALID_STATE)
        self._planner = self._planned_by = ShortTermPlanner(limits, plans)
        self._setting_out = SettingOut(check, plans)
        self._cycle = plans.cycle_s
        self._epoch = math.nan
        self._grid = Grid(plans.cycle_s, settings.early_s)
        self._proposals = Proposals(limits, plans, settings.reserve, lambda: self._grid.k)
        self._running, self._spare = RunningPlan(start, 0.0), RunningPlan(start, 0.0)
        self._begin = self._spare_begin = 0
        self._adopted_last = False
        between = between_commands(limits.acceleration, limits.jerk, plans.cycle_s, plans.delay)
        self._tracking = TrackingMonitor(plans.q_error, plans.delay, plans.cycle_s, between)
        self._noted = -1
        self._wanted = self._target = 0.0
        self._heading = 1
        self._way_back: WayBack | None = None
        self._onwards: _Onwards | None = None
        self._rests_at: Array | None = None
        self._dynamic = settings.reserve.dynamic
        self._state = State.STOPPED
        self._latched = False
        self._why_latched = Reason.FAULT
        self._reacts_to_silence = plans.silence is not None
        self._turns = 0
        self._last = Command(
            math.nan, math.nan, *self._running.motion(0.0), State.STOPPED, Cause.RESTING,
            self._verdict(Reason.AT_REST, math.nan), 0,
        )  # fmt: skip
        self._before = self._last
        self._no_verdict = self._verdict(Reason.FAULT, math.nan)

    @classmethod
    def from_cell(cls, cell: Cell, q: Array) -> Self:
        """Set up everything that a cell names; ``q`` as above.

        Raises
        ------
        SetupError
            The cell or ``q`` cannot be used; one line that says what is wrong and what would be right.
        """
        parts = build_supervised(cell)
        return cls(parts.check, parts.watch, parts.plans, SupervisorSettings(0.25 * cell.cycle_s), q)

    # What others may call, from another thread than the loop's.

    def propose(self, proposal: Proposal) -> Refusal | None:
        """Hand over what is wanted next; return why it is refused, if that can already be said.

        Prepares in the caller's thread; from one thread at a time. Of several path speeds (a stop is path
        speed 0), and of several trajectories, the last one before a step counts; a trajectory alone is
        followed at its own speed. Whether it joins in time is seen in that step, and ``refusal`` says if it
        did not.
        """
        last = self._last
        if last.cause is Cause.LATCHED:
            return Refusal(Objection.LATCHED, "nothing is verified any more: a new supervisor is needed")
        rest = last.q if last.outcome is State.STOPPED else None
        return self._proposals.propose(proposal, self._running, self._heading, rest)

    @property
    def stops_by_itself(self) -> bool:
        """Whether a robot with ``[robot.silence]`` lacked a command while it moved, and stops on its own."""
        return self._latched and self._why_latched is Reason.SILENCE

    @property
    def cycle_s(self) -> float:
        """Return the time between two instants [s]."""
        return self._cycle

    @property
    def running(self) -> Running:
        """Return the plan to be handed over with the last command; valid until the next step."""
        return Running(self._running, self._instant(self._begin) + self._epoch)

    def view(self) -> SceneView:
        """Return copies of what a mode may know; people may be those of a step that is going on."""
        running, tau = self._running, self._since(self._grid.k + 2)
        state = running.path_state(tau)
        last, path = self._last, running.trajectory
        on_path = math.isfinite(state.s)
        dq_ds = path.sample(state.s)[1] if on_path else np.full(path.n_joints, math.nan)
        people = self.watch.known().people.copy()
        why_not = last.verdict.reason.name if last.cause is Cause.NOT_VERIFIED else ""
        return SceneView(
            last.t, last.q.copy(), last.dq.copy(), state.s, state.sdot, running.s_rest, last.outcome.name,
            self.refusal, dq_ds, seen_people(people, self.watch.gate.person_ids, self._epoch), why_not,
        )  # fmt: skip

    def outlook(self) -> Outlook | None:
        """Return copies of what the next step would begin with; ``None``: a step went on meanwhile.

        From any thread; it costs the loop no more than the time in which Python copies.
        """
        turns, running = self._turns, self._running
        known, plan, path, k = self.watch.known(), self.plan, running.trajectory, self._grid.k
        known = known._replace(people=known.people.copy())
        start = running.path_state(self._since(k + 2))
        last, made = self._last, None
        outside = last.verdict.reason is Reason.ROBOT_OUTSIDE_TRACKING
        if last.cause is Cause.NOT_VERIFIED and not outside:
            planner = self._planned_by
            made = Made(plan, planner.slices.copy(), None, self._instant(k + 1))
            if plan.outcome is PlanOutcome.READY:
                motion = RunningPlan(path, path.s_begin)
                motion.take(path, planner, plan)
                made = made._replace(motion=motion)
        found = Outlook(
            self._epoch, self._instant(k + 1), self._instant(k + 2), path, start, self._target,
            self._planner.memory, known, self.watch.gate.person_ids, last, self._latched, made,
        )  # fmt: skip
        return found if turns == self._turns and turns % 2 == 0 else None

    # The loop.

    def step(
        self,
        now: float,
        measurements: Iterable[RawMeasurement] = (),
        joints: JointReading | None = None,
    ) -> Command:
        """Take in what was measured, make, check and perhaps adopt the next plan; return the next command.

        Parameters
        ----------
        now:
            Instant of the call [s, the clock of all stamps].
        measurements:
            Reports about people that have arrived since the step before.
        joints:
            Measured joint positions, held against assumption A2.

        Never raises by itself: an exception inside leaves the running plan as it is, and the next command is
        one of its stop, or the last one again if not even that can be said. What ends a process (Ctrl-C) goes
        through; then nobody got a command, as if it had been withdrawn.
        """
        self._turns += 1  # odd while a step goes on, for :meth:`outlook`
        try:
            return self._step(now, measurements, joints)
        except BaseException:
            self._take_back()
            self._after_silence(self._last)
            raise
        finally:
            self._turns += 1

    def _step(
        self, now: float, measurements: Iterable[RawMeasurement], joints: JointReading | None
    ) -> Command:
        steps = 0
        if self._adopted_last:  # by now the robot side holds it, whatever becomes of this step
            self._adopted_last, self._rests_at = False, None
        try:
            now = self._since_epoch(as_float(now))
            steps = self._grid.advance(now)
            if steps > 1 or self._grid.went_back:
                self._after_silence(self._last)
            if steps > 0:
                self._before = self._last
                self._note_until(self._grid.k + 1)
            verdict = self._take_in(now, measurements, joints)
            if steps == 0:
                silent = self.stops_by_itself
                cause, why = (Cause.LATCHED, Reason.SILENCE) if silent else (Cause.CLOCK, Reason.CLOCK)
                again = self._verdict(why, now + self._epoch)
                return self._last._replace(cause=cause, verdict=again, missed=0)
            if verdict is None:
                cause, verdict = self._next_plan(now)
            else:
                cause = Cause.LATCHED if self._latched else Cause.NOT_VERIFIED
            status, reason, t, gap, stop, criterion, not_checked = verdict
            verdict = Verdict(status, reason, t + self._epoch, gap, stop, criterion, not_checked)
            return self._answer(cause, verdict, steps - 1)
        except Exception as error:
            return self._after_fault(error, steps)

    def _after_fault(self, error: Exception, steps: int) -> Command:
        """Go on with the plan that ran before this step; the last command again if that cannot be said."""
        self.fault = error
        if steps > 0:
            self._take_back()
            try:
                return self._answer(Cause.FAULT, self._no_verdict, steps - 1)
            except Exception as another:
                self.fault = another
                self._after_silence(self._last)  # the robot gets one for an instant that it has had
                self._last = self._again(self._last)
        return self._last._replace(cause=Cause.FAULT, verdict=self._no_verdict, missed=0)

    def _again(self, command: Command) -> Command:
        """Return an earlier command with the state that the running plan is in now."""
        ended = self._since(self._grid.k + 2) >= self._running.duration_s
        self._state = State.STOPPED if ended else State.FAILSAFE
        return command._replace(outcome=self._state, cause=Cause.FAULT, verdict=self._no_verdict, missed=0)

    def withdraw(self) -> Command:
        """Say that the last command was not handed over by its deadline: its plan is not adopted.

        To be called before the next step; one in which the clock does not advance is a step too: what was
        adopted before it counts as handed over. Returns the command for the same instant of the plan that
        the robot side holds; the last command again if that step adopted nothing. Never raises: where that
        command cannot be said, it is the one of the step before (``FAULT``).
        """
        self._after_silence(self._before)
        if not self._adopted_last:
            return self._last
        self._turns += 1
        try:
            self._take_back()
            self._answer(Cause.WITHDRAWN, self._last.verdict, self._last.missed)
        except Exception as error:
            self.fault = error
            self._last = self._again(self._before)
        finally:
            self._turns += 1
        return self._last

    def _after_silence(self, held: Command) -> None:
        """After a command that the robot did not get: verify nothing any more if it reacts to that by itself.

        ``held``: the last one that it got. Who rested then still does.
        """
        if self._reacts_to_silence and held.outcome is not State.STOPPED:
            self._latched, self._why_latched = True, Reason.SILENCE

    def _take_back(self) -> None:
        """Let the plan before be the running one again, if one was adopted in this step."""
        if not self._adopted_last:
            return
        self._running, self._spare = self._spare, self._running
        self._begin, self._spare_begin = self._spare_begin, self._begin
        self._adopted_last = False

    def _since_epoch(self, now: float) -> float:
        """Count from a near epoch, so that a large clock value costs no digits; NaN: no clock value."""
        if not math.isfinite(self._epoch):
            self._epoch = math.floor(now) if math.isfinite(now) else math.nan
        return now - self._epoch

    def _note_until(self, k: int) -> None:
        """Let the monitor know what the running plan commands up to t_k, in cycles without a step as well."""
        for missed in range(max(self._noted + 1, k + 1 - self._tracking.rows), k + 1):
            motion = self._running.motion(self._since(missed))
            self._tracking.note(self._instant(missed), motion.q, motion.dq)
        self._noted = k

    def _take_in(
        self, now: float, measurements: Iterable[RawMeasurement], joints: JointReading | None
    ) -> Verdict | None:
        """Admit reports, hold joints against commands; return a verdict if nothing can be verified."""
        if self._latched:
            return self._verdict(self._why_latched, now)
        self._latched = True  # an exception half way through a report may have lost somebody
        epoch = self._epoch
        for report in measurements:
            stamp, arrived, frame, complete, people = report
            stamp, arrived = as_float(stamp) - epoch, as_float(arrived) - epoch
            near = RawMeasurement(stamp, arrived, frame, complete, people)
            self.admission = self.watch.admit(near, now)
        self._latched = False
        t = math.nan if joints is None else as_float(joints.t) - epoch
        found = None if joints is None else self._tracking.check(joints._replace(t=t))
        self.deviation = found
        if joints is not None and found is not None:
            self.deviation = found._replace(t=joints.t)
            return self._verdict(Reason.ROBOT_OUTSIDE_TRACKING, now)
        return None

    def _since(self, k: int) -> float:
        """Time from the begin of the running plan to t_k [s]."""
        return (k - self._begin) * self._cycle

    def _instant(self, k: int) -> float:
        return self._grid.origin + k * self._cycle

    def _next_plan(self, now: float) -> tuple[Cause, Verdict]:
        """Make, check and perhaps adopt the plan that begins at t_k+1."""
        running, begin = self._running, self._grid.k + 1
        if running.rests_off_path(self._since(begin)):
            self._connect(running, begin)
        start = running.path_state(self._since(begin))
        before = running.trajectory, self._begin
        self._take_proposals(start)
        if before[0] is not running.trajectory or before[1] != self._begin:
            start = running.path_state(self._since(begin))
        if start.s >= running.trajectory.s_end:
            start = self._rest_at_the_end(running, begin)
        if self._is_done(running, start):
            return Cause.RESTING, self._verdict(Reason.AT_REST, now)
        wanted = Start(running.trajectory, self._instant(begin), start, self._target)
        plan, known = self._planner.follow(*wanted), self.watch.known()
        found = self._setting_out.decide(now, wanted, plan, self._planner, known)
        answer, self.plan, self._planned_by = found
        if answer.status is not Status.VERIFIED:
            return Cause.NOT_VERIFIED, answer
        self._adopt(running.trajectory, begin, start)
        return Cause.ADOPTED, answer

    def _connect(self, running: RunningPlan, begin: int) -> None:
        """After a stop that left the path: rest at the begin of a way from there to where it was left.

        One straight line in joint space: short enough to be made within the cycle. Its plans are checked like
        any. Where there is none, the robot rests, and may be given another trajectory.
        """
        path, s, heading = running.trajectory, running.s_left, self._heading
        onwards, limits = self._onwards, self.check.robot.limits
        if onwards is not None and onwards.way is path:  # from beside a connector to the path as well
            path, s, heading = onwards.path, onwards.s, onwards.heading
        here, there = running.motion(self._since(begin)).q, path.sample(s)[0]
        try:
            way = rest_to_rest(np.stack([here, there]), limits, share=_OF_RESERVE * self._dynamic)
        except TrajectoryError as error:
            text = f"the robot stays where its stop ended, off the path: {error}"
            self.refusal, self._onwards = Refusal(Objection.NO_CONNECTOR, text, s), None
            running.rest_at(IntendedTrajectory([0.0, 1.0], here[None, None, :], "rest"), 1.0)
        else:
            self._onwards = _Onwards(way, path, s, heading)
            running.rest_at(way, way.s_begin)
        self._begin, self._way_back = begin, None
        self._heading = 1 if self._wanted >= 0.0 else -1

    def _rest_at_the_end(self, running: RunningPlan, begin: int) -> PathState:
        """Rest at the end of the trajectory; at that of a connector, on the path, to go on there."""
        onwards, self._begin = self._onwards, begin
        path, s = running.trajectory, running.trajectory.s_end
        if onwards is not None and onwards.way is path and onwards.onto:
            path, s = onwards.path, onwards.s
            self._heading, self._onwards = onwards.heading, None
        running.rest_at(path, s)
        return PathState(s, 0.0, 0.0)

    def _is_done(self, running: RunningPlan, start: PathState) -> bool:
        at_rest = start.sdot == 0.0 and start.sddot == 0.0
        return at_rest and (self._target == 0.0 or start.s >= running.trajectory.s_end)

    def _adopt(self, trajectory: IntendedTrajectory, begin: int, start: PathState) -> None:
        """Let the plan that was made last be the running one; keep the old one for ``withdraw``."""
        self._spare.take(trajectory, self._planner, self.plan)
        self._running, self._spare = self._spare, self._running
        self._spare_begin, self._begin = self._begin, begin
        self._adopted_last = True
        steady = start.sdot == self._target and start.sddot == 0.0
        going_on = self._state is State.EXECUTING
        off_path = self._onwards is not None and self._onwards.way is trajectory
        self._state = State.EXECUTING if (steady or going_on) and not off_path else State.RECOVERING

    def _take_proposals(self, start: PathState) -> None:
        """Take over what was proposed, as far as the running plan stays what it is."""
        speed, back, prepared = self._proposals.take()
        if back is not None:
            self._way_back = back
        if speed is not None:
            self._wanted = speed
        if prepared is not None:
            self.refusal = self._why_not(prepared, start)
            if self.refusal is None:
                self._take_over(prepared, 1.0 if speed is None else speed)
        self._turn_round(start)

    def _take_over(self, prepared: Prepared, speed: float) -> None:
        if prepared.from_rest:
            self._running.rest_at(prepared.trajectory, prepared.trajectory.s_begin)
            self._begin = self._grid.k + 1
        else:
            self._running.trajectory = prepared.trajectory
        self._wanted, self._heading, self._way_back, self._onwards = speed, 1, None, None

    def _turn_round(self, start: PathState) -> None:
        """Set the path speed; where the other direction is wanted, stop, and take the way back from rest."""
        self._target = abs(self._wanted) if self._wanted * self._heading >= 0.0 else 0.0
        if self._wanted * self._heading >= 0.0 or not (start.sdot == 0.0 and start.sddot == 0.0):
            return
        running, back, onwards = self._running, self._way_back, self._onwards
        if onwards is not None and onwards.way is running.trajectory and onwards.onto and self._heading < 0:
            self._heading, self._target = 1, abs(self._wanted)  # the way to the path is the way forward too
            return
        s = min(start.s, running.trajectory.s_end)
        if back is None or back.of is not running.trajectory or not back.trajectory.s_begin <= -s:
            text = "another trajectory was taken over in the meantime: there is no way back along it yet"
            self.refusal = Refusal(Objection.OUTDATED, text)
            self._wanted = self._target = 0.0
            return
        if self._onwards is not None and self._onwards.way is running.trajectory:
            self._onwards = self._onwards.turned(back.trajectory)
        running.rest_at(back.trajectory, -s)
        self._begin, self._way_back = self._grid.k + 1, None
        self._heading, self._target = -self._heading, abs(self._wanted)

    def _why_not(self, prepared: Prepared, start: PathState) -> Refusal | None:
        running = self._running
        join = prepared.join_on(running.trajectory)
        if join is None:
            return Refusal(Objection.OUTDATED, "another trajectory was taken over in the meantime")
        if not prepared.from_rest:
            if not prepared.trajectory.s_begin <= running.path_state(0.0).s:
                return Refusal(Objection.OUTDATED, "it was prepared for a later place on the path")
            if running.s_rest <= join:
                return None
            text = f"it joins at s = {join:.4f} s, before the running stop ends"
            return Refusal(Objection.JOINS_TOO_EARLY, text, running.s_rest)
        if not (start.sdot == 0.0 and start.sddot == 0.0):
            text = "it begins from standstill, but the robot moves; give join_s, or stop first"
            return Refusal(Objection.NOT_AT_REST, text)
        if self._rests_at is None:  # where the last plan that was driven ended
            self._rests_at = running.motion(self._since(self._grid.k + 1)).q.copy()
        here = self._rests_at
        there = prepared.trajectory.sample(prepared.trajectory.s_begin)[0]
        jump = np.abs(here - there)
        if not jump.max() <= _SAME_PLACE:
            i = int(np.argmax(jump))
            text = (
                f"joint {self.check.robot.joints[i]} rests at {here[i]:.6g}, {jump[i]:.3g} from where the "
                f"trajectory begins; at most {_SAME_PLACE:g} is taken"
            )
            return Refusal(Objection.JUMP, text, prepared.trajectory.s_begin, i)
        return None

    def _answer(self, cause: Cause, verdict: Verdict, missed: int) -> Command:
        """Return the command for t_k+2, which belongs to the running plan."""
        k = self._grid.k + 2
        tau = self._since(k)
        motion: Motion = self._running.motion(tau)
        if tau >= self._running.duration_s:
            self._state = State.STOPPED
        elif cause is not Cause.ADOPTED:
            self._state = State.FAILSAFE
        t = self._instant(k)
        self._tracking.note(t, motion.q, motion.dq)
        self._noted = k
        deadline, t = self._instant(k - 1) + self._epoch, t + self._epoch
        self._last = Command(t, deadline, *motion, self._state, cause, verdict, missed)
        return self._last

    def _verdict(self, reason: Reason, now: float) -> Verdict:
        return verdict(
            reason, now, gap_m=math.nan, stop_time_s=math.nan, criterion=CriterionKind.SEPARATION,
            not_checked=self.check.not_checked,
        )  # fmt: skip


def _standing_at(q: Array, limits: JointLimits) -> IntendedTrajectory:
    """Return the trajectory that stays at ``q (n,)``."""
    n = len(limits.joints)
    try:
        if np.iscomplexobj(q):
            raise TypeError("complex numbers are no positions")
        place = np.array(q, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SetupError(f"q should be {n} numbers, one per joint: {error}") from error
    if place.shape != (n,):
        raise SetupError(f"q has shape {place.shape}, should be ({n},): one value per joint")
    for i, joint in enumerate(limits.joints):
        if not limits.position_lower[i] <= place[i] <= limits.position_upper[i]:
            raise SetupError(
                f"q of joint {joint} is {place[i]}, should be within {limits.position_lower[i]:g} and "
                f"{limits.position_upper[i]:g}"
            )
    return IntendedTrajectory([0.0, 1.0], place[None, None, :], "rest")
