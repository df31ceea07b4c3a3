"""The mode: goes from target to target, and plans anew before anybody is near the way ahead.

The paper (section III.B.4) evaluates its potential where the arm is and along its trajectory; where it
exceeds the threshold, the trajectory is halted and planned anew. Here the least gap of the way ahead to
people, as they are and as they are forecast, is what counts, and the arm stops on its path, as the supervisor
stops it.

What the supervisor does not let the arm do comes back as a constraint: configurations on the way where it was
held back are avoided for some seconds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from failsafe.preparation import Refusal
from failsafe.trajectory import IntendedTrajectory
from modes.planning.arrt import Found, Planner
from modes.planning.avoided import Avoided
from modes.planning.clear_motion import plan_motion
from modes.planning.foresight import FRAME_S, Foresight, Present
from modes.planning.potential_field import Bodies, Field, FieldSettings, Fixtures
from modes.planning.replan_settings import ReplanSettings, Target, checked_target
from modes.settings import require_kind
from occupancy.body import MAX_POINTS, Profile
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.proposal import NewTrajectory, PathSpeed, Proposal, SceneView, Stop

Array = NDArray[np.float64]

_AT = 1e-3
"""This near to a target it is reached [rad]."""
_AROUND_RAD = 0.2
"""So much around a place that was refused is avoided [rad]."""
_ON_TIME = 0.95
"""An arm with this path speed is where its trajectory says."""
_ABOUT_S = 0.3
"""So much earlier or later people may be where they are forecast to be, and the arm where it should be."""
_FARTHEST_M = 1e9
"""Nobody is farther away: with larger numbers, lengths lose their digits, and overflow."""
_ON_IT = 0.05
"""This far from where its way has it the arm is on another one [rad; m]."""
_LONGER = 1.3
"""A way with a larger margin may take this many times as long as one with a smaller."""


class Doing(Enum):
    """What the mode is doing."""

    NOTHING = "what it is shown is no view of its arm on its way"
    RESTING = "rests at a target"
    GOING = "on its way"
    HALTING = "has stopped, or stops: somebody is, or will be, near the way ahead, or it is not told where"
    HELD = "the supervisor holds the arm back"
    WAITING = "no way is known; waits"


class Decision(NamedTuple):
    """What was decided, and why.

    Attributes
    ----------
    t:
        Instant of the view [s].
    doing:
        What the mode is doing.
    ahead_m:
        Least gap of the way ahead to people, now and forecast [m]; NaN: not looked at, or not told.
    found:
        What came of planning; ``None``: nothing was planned.
    held_by:
        Why the supervisor holds the arm back, by the name of the reason of its verdict; empty: it does not.
    """

    t: float
    doing: Doing
    ahead_m: float = math.nan
    found: Found | None = None
    held_by: str = ""


class _Refused(NamedTuple):
    """A ball in joint space [rad] that is avoided until an instant [s]."""

    centre: Array
    radius: float
    until: float


@dataclass(slots=True)
class _Way:
    """What the arm was sent along, and the gap that it was planned with [m]."""

    trajectory: IntendedTrajectory
    gap_m: float


class ProactiveAvoidance:
    """The mode: one decision per call.

    Parameters
    ----------
    robot:
        The supervisor's.
    targets:
        Where it goes, one after the other, once.
    profile:
        Radii of people.
    foresight:
        Where people will be; without it only where they are.
    settings:
        When it plans anew.
    fixtures:
        What else stands there, and is planned around.

    Attributes
    ----------
    decision:
        The last one.

    Raises
    ------
    SetupError
        Something that it is made with cannot be used.
    """

    name = "proactive-avoidance"

    def __init__(
        self,
        robot: RobotModel,
        targets: Sequence[Target],
        profile: Profile,
        foresight: Foresight | None = None,
        settings: ReplanSettings | None = None,
        fixtures: Fixtures | None = None,
    ) -> None:
        name = "proactive avoidance:"
        self.settings = settings = ReplanSettings() if settings is None else settings
        self._fixtures = Fixtures.none() if fixtures is None else fixtures
        require_kind(f"{name} robot", robot, RobotModel, written="the supervisor's robot")
        require_kind(f"{name} targets", targets, Sequence, written="a list of Target(q, wait_s)")
        require_kind(
            f"{name} profile", profile, Profile, written="radii of people, as load_profile gives them"
        )
        require_kind(f"{name} settings", settings, ReplanSettings, written="ReplanSettings(...)")
        require_kind(f"{name} fixtures", self._fixtures, Fixtures, written="Fixtures(...)")
        if foresight is not None and not callable(getattr(foresight, "frames", None)):
            raise SetupError(f"{name} foresight = {foresight!r} should have a method frames(view)")
        self._robot, self._profile = robot, profile
        self._turns = ~robot.kinematics[0]["prismatic"][: len(robot.joints)].astype(bool)
        self._targets = tuple(checked_target(robot, k, each) for k, each in enumerate(targets))
        if not self._targets:
            raise SetupError("proactive avoidance: there is no target")
        self._foresight = Present() if foresight is None else foresight
        gaps = [settings.clearance_m + each for each in settings.margins_m]
        self._fields = [Field(robot, FieldSettings(clearance_m=gap)) for gap in gaps]
        self._searches = 0
        self._next, self._arrived = 0, math.nan
        self._way: _Way | None = None
        self._halted = False  # the supervisor was told to stop, and not yet to go on
        self._proposed: Proposal | None = None
        self._newest = -math.inf
        self._refused: list[_Refused] = []
        self._rests_since = self._clear_since = math.nan
        self.decision = Decision(-math.inf, Doing.NOTHING)

    @property
    def reached(self) -> int:
        """How many targets have been reached."""
        return self._next + (not math.isnan(self._arrived))

    def propose(self, view: SceneView) -> Proposal | None:
        """Return what the arm should do; ``None``: go on, or the view is none of this arm."""
        n = len(self._robot.joints)
        known = view.q.shape == (n,) and np.isfinite(view.q).all() and math.isfinite(view.t)
        if not known:
            self.decision = Decision(view.t, Doing.NOTHING)
            return None
        self._keep_time(view.t)
        bodies = self._bodies(view)
        self._proposed = (
            self._from_rest(view, bodies) if view.outcome == "STOPPED" else self._under_way(view, bodies)
        )
        return self._proposed

    def _keep_time(self, t: float) -> None:
        """Forget what is over; and, where the clock went back, all instants of before."""
        if t < self._newest:
            self._refused, self._rests_since, self._clear_since = [], math.nan, math.nan
            self._arrived = math.nan if math.isnan(self._arrived) else t
        self._newest = t
        self._refused = [each for each in self._refused if each.until > t]

    def _bodies(self, view: SceneView) -> Bodies | None:
        """Return people as they are and will be; ``None``: what the foresight says is of no use."""
        frames = [np.asarray(each, dtype=float) for each in self._foresight.frames(view)]
        shapes = {each.shape for each in frames}
        if len(shapes) != 1 or frames[0].ndim != 3 or frames[0].shape[1:] != (MAX_POINTS, 3):
            return None
        if any((np.abs(each[np.isfinite(each)]) > _FARTHEST_M).any() for each in frames):
            return None
        return Bodies.of_points(frames, self._profile)

    def refused(self, refusal: Refusal) -> None:
        """Be told that the supervisor refused what was proposed last: its place is avoided for some time.

        Which a supervisor says when it is proposed; otherwise the mode sees that the arm does not move.
        """
        if not isinstance(self._proposed, NewTrajectory):
            return
        way, self._way = self._way, None
        if way is not None and math.isfinite(refusal.s):
            q = way.trajectory.sample(min(max(refusal.s, 0.0), _lasts(way)))[0]
            until = self.decision.t + self.settings.forget_s
            self._refused.append(_Refused(q, _AROUND_RAD, until))

    def _under_way(self, view: SceneView, bodies: Bodies | None) -> Proposal | None:
        """Stop where somebody is near the way ahead; go on where nobody is any more."""
        way, self._rests_since = self._way, math.nan
        s = math.nan if way is None else _place(view, way)
        if way is None or math.isnan(s):
            self.decision = Decision(view.t, Doing.NOTHING)
            return None
        ahead = self._ahead(view, way, s, bodies)
        if self._halted:
            return self._go_on(view, way, ahead)
        if not ahead >= self._least(way):
            return self._halt(view, ahead)
        self.decision = Decision(view.t, Doing.GOING, ahead)
        return None

    def _halt(self, view: SceneView, ahead: float) -> Proposal:
        self._halted, self._clear_since = True, math.nan
        self.decision = Decision(view.t, Doing.HALTING, ahead)
        return Stop()

    def _go_on(self, view: SceneView, way: _Way, ahead: float) -> Proposal | None:
        """Go on along the way when it has been clear for some time."""
        self.decision = Decision(view.t, Doing.HALTING, ahead)
        if not ahead >= way.gap_m:
            self._clear_since = math.nan
            return None
        if math.isnan(self._clear_since):
            self._clear_since = view.t
        if view.t - self._clear_since < self.settings.clear_s:
            return None
        self.decision, self._rests_since = Decision(view.t, Doing.GOING, ahead), math.nan
        self._halted = False
        return PathSpeed(1.0)

    def _from_rest(self, view: SceneView, bodies: Bodies | None) -> Proposal | None:
        target = self._target(view)
        if target is None:
            self.decision = Decision(view.t, Doing.RESTING)
            return None
        s = math.nan if self._way is None else _place(view, self._way)
        if self._way is None or math.isnan(s):
            return self._take(view, *self._plan(view, bodies, target))
        return self._on_the_way(view, self._way, s, bodies, target)

    def _target(self, view: SceneView) -> Target | None:
        """Return where to go from rest; ``None``: it rests at a target for now, or for good."""
        while True:
            target = self._targets[self._next]
            if float(np.abs(self._away(view.q, target)).max()) >= _AT:
                return target
            if math.isnan(self._arrived):
                self._arrived = view.t
            if view.t - self._arrived < target.wait_s or self._next + 1 == len(self._targets):
                return None
            self._next, self._arrived, self._way = self._next + 1, math.nan, None

    def _away(self, q: Array, target: Target) -> Array:
        """Return how far joints are from a target, within ±π: whole turns away it is reached, too."""
        away = q - np.array(target.q)
        return np.asarray(np.where(self._turns, (away + math.pi) % (2.0 * math.pi) - math.pi, away))

    def _on_the_way(
        self, view: SceneView, way: _Way, s: float, bodies: Bodies | None, target: Target
    ) -> Proposal | None:
        """The arm rests on its way: go on, wait, or take another way.

        It waits as long as the other way would take longer than the rest of this one: the rule of ski rental
        (Karlin, Manasse, Rudolph and Sleator 1988).
        """
        ahead, doing = self._ahead(view, way, s, bodies), Doing.HALTING if self._halted else Doing.HELD
        if math.isnan(self._rests_since):
            self._rests_since = view.t
        if self._halted:
            again = self._go_on(view, way, ahead)
            if again is not None:
                return again
        elif not ahead >= self._least(way):  # else the arm would move as soon as the supervisor lets it
            return self._halt(view, ahead)
        waited = view.t - self._rests_since
        self.decision = Decision(view.t, doing, ahead, held_by=view.not_verified)
        if waited < self.settings.patience_s or bodies is None:
            return None
        if doing is Doing.HELD and not self._refused:
            self._refuse(view, way, s)
        found, other = self._plan(view, bodies, target)
        doing = Doing.WAITING if self._halted and other is None else doing
        self.decision = Decision(view.t, doing, ahead, found, view.not_verified)
        if other is None or waited < _lasts(other) - (_lasts(way) - s) or _is_rest_of(other, way, s):
            return None
        return self._take(view, found, other)

    def _take(self, view: SceneView, found: Found | None, way: _Way | None) -> Proposal | None:
        """Go along a way, where there is one."""
        self._rests_since = math.nan
        if way is None:
            self.decision = Decision(view.t, Doing.WAITING, math.nan, found)
            return None
        self._way, self._halted = way, False  # a trajectory is followed at its own speed
        self.decision = Decision(view.t, Doing.GOING, math.nan, found)
        return NewTrajectory(way.trajectory)

    def _refuse(self, view: SceneView, way: _Way, s: float) -> None:
        """Avoid, for some time, where the arm was held back from going."""
        s_end = float(way.trajectory.breaks[-1])
        for ahead in (0.25, 0.5, 1.0):
            q = way.trajectory.sample(min(s + ahead, s_end))[0]
            far = float(np.linalg.norm(q - view.q))
            if far > 0.1:
                until = view.t + self.settings.forget_s
                self._refused.append(_Refused(q, 0.7 * far, until))
                return

    def _plan(
        self, view: SceneView, bodies: Bodies | None, target: Target
    ) -> tuple[Found | None, _Way | None]:
        """Plan with the smallest margin; take a larger one where the way is hardly longer.

        Each time with another seed: a short search that is repeated finds what one long search would.
        """
        if bodies is None:
            return None, None
        self._searches += 1
        found, best = self._planned(self._fields[-1], view.q, target, bodies)
        for each in self._fields[-2::-1]:
            if best is None:
                break
            _found, wider = self._planned(each, view.q, target, bodies)
            if wider is None or _lasts(wider) > _LONGER * _lasts(best):
                break
            best = wider
        return found, best

    def _planned(self, field: Field, q: Array, target: Target, bodies: Bodies) -> tuple[Found, _Way | None]:
        gap, settings = field.settings.clearance_m, self.settings.planner
        planner = Planner(field, replace(settings, seed=settings.seed + self._searches))
        all_of_it = bodies.beside(self._fixtures, gap)
        found = planner.plan(q, np.array(target.q), all_of_it, self._avoided())
        if found.path is None:
            return found, None
        motion = plan_motion(field, found.path, all_of_it).trajectory
        return found, None if motion is None else _Way(motion, gap)

    def _avoided(self) -> Avoided:
        n = len(self._robot.joints)
        centres = np.array([each.centre for each in self._refused]).reshape(-1, n)
        return Avoided(centres, np.array([each.radius for each in self._refused]))

    def _ahead(self, view: SceneView, way: _Way, s: float, bodies: Bodies | None) -> float:
        """Return the least gap of where the arm is, and of the way ahead, to people [m].

        Each place is held against where people are about the time when the arm is there; against all frames
        where that is not known, because it rests or is held back.
        """
        if bodies is None:
            return math.nan
        until = min(s + self.settings.ahead_s, _lasts(way))
        places = np.append(np.arange(s, until, self.settings.sample_s), until)
        on_time = view.outcome != "STOPPED" and view.sdot > _ON_TIME
        found = way.gap_m + 0.05
        for after, q in zip((places - s).tolist(), way.trajectory.sample(places)[0], strict=True):
            found = min(
                found, self._fields[0].clearance(q, _then(bodies, after) if on_time else bodies, found)
            )
        return found

    def _least(self, way: _Way) -> float:
        """Return the gap ahead below which the way is planned anew [m]."""
        return min(self.settings.clearance_m + self.settings.margins_m[-1], way.gap_m) - self.settings.slack_m


def _then(bodies: Bodies, after: float) -> Bodies:
    """Return people about ``after`` [s] from now; for later than the last frame, those of the last."""
    last = bodies.frames - 1
    first = min(max(math.floor((after - _ABOUT_S) / FRAME_S), 0), last)
    return bodies.between(first, min(max(math.ceil((after + _ABOUT_S) / FRAME_S), 0), last))


def _lasts(way: _Way) -> float:
    return float(way.trajectory.breaks[-1])


def _place(view: SceneView, way: _Way) -> float:
    """Return where on its way the arm is [s]; NaN: the supervisor has it on another one."""
    for s in (min(view.s, _lasts(way)), 0.0):  # 0: the way has not been taken over yet
        if np.abs(way.trajectory.sample(s)[0] - view.q).max() <= _ON_IT:  # NaN is not
            return s
    return math.nan


def _is_rest_of(other: _Way, way: _Way, s: float) -> bool:
    """Whether another way is what is left of one from ``s`` [s] on: nothing is won by taking it."""
    places = np.linspace(0.0, max(_lasts(other), _lasts(way) - s), 20)
    away = other.trajectory.sample(places)[0] - way.trajectory.sample(s + places)[0]
    return bool(np.abs(away).max() <= _ON_IT)
