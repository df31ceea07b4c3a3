"""The mode: it stops before anybody is near the way ahead, waits as long as it should, and goes around."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from failsafe.preparation import Objection, Refusal
from failsafe.trajectory import IntendedTrajectory
from modes.planning.arrt import NoPath, PlannerSettings
from modes.planning.potential_field import Bodies, Field, Fixtures
from modes.planning.replan_settings import ReplanSettings, Target
from modes.planning.replanning import Doing, ProactiveAvoidance
from modes.planning.trials import PICK, PLACE
from modes.twin.people import Stance, Standing
from occupancy.body import MAX_POINTS, load_profile
from robots.errors import SetupError
from robots.model import RobotModel
from verifier.proposal import NewTrajectory, PathSpeed, Proposal, SceneView, Stop

Array = NDArray[np.float64]
PROFILE = load_profile("iso")
STEP_S = 0.1
BLOCKING = Standing(Stance(1.05, 0.0, 3.14, -0.8)).at(0.0)
"""Somebody before the arm: the straight way from PICK to PLACE comes too near."""
FAR = Standing(Stance(3.0, 0.0, 3.14, -0.8)).at(0.0)
AT_GOAL = Standing(Stance(0.3, -1.0, 1.57, -0.8)).at(0.0)


class Told:
    """A foresight that says what a test wants."""

    def __init__(self, *frames: Array) -> None:
        self.told: Sequence[Array] = [each[None] for each in frames]

    def say(self, *frames: Array) -> None:
        self.told = [each[None] for each in frames]

    def frames(self, view: SceneView) -> Sequence[Array]:
        return self.told


class Follower:
    """An arm that does what is proposed, at once: an ideal supervisor."""

    def __init__(self, mode: ProactiveAvoidance, q: Array) -> None:
        self.mode, self.q, self.t, self.s, self.held = mode, q.copy(), 0.0, 0.0, False
        self.way: IntendedTrajectory | None = None
        self.sdot = 1.0
        self.proposals: list[Proposal] = []

    @property
    def view(self) -> SceneView:
        moving = self.way is not None and self.sdot > 0.0 and self.s < self.way.s_end and not self.held
        n = len(self.q)
        return SceneView(
            t=self.t, q=self.q.copy(), dq=np.zeros(n), s=self.s, sdot=self.sdot if moving else 0.0,
            s_rest=self.s, outcome="EXECUTING" if moving else "STOPPED", dq_ds=np.zeros(n),
            not_verified="REACHABLE" if self.held else "",
        )  # fmt: skip

    def step(self) -> Proposal | None:
        proposal = self.mode.propose(self.view)
        if isinstance(proposal, NewTrajectory):
            assert np.allclose(proposal.trajectory.sample(0.0)[0], self.q)
            assert self.view.outcome == "STOPPED", "from standstill only"
            self.way, self.s, self.sdot = proposal.trajectory, 0.0, 1.0
        elif isinstance(proposal, Stop):
            self.sdot = 0.0
        elif isinstance(proposal, PathSpeed):
            self.sdot = proposal.sdot
        if proposal is not None:
            self.proposals.append(proposal)
        self.t += STEP_S
        if self.way is not None and not self.held:
            self.s = min(self.s + self.sdot * STEP_S, self.way.s_end)
            self.q = self.way.sample(self.s)[0]
        return proposal

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.step()


@pytest.fixture
def robot(arm: Callable[[str], RobotModel]) -> RobotModel:
    return arm("ur16e")


def made(robot: RobotModel, told: Told, *targets: Target, fixtures: Fixtures | None = None) -> Follower:
    goals = targets or (Target(PLACE),)
    return Follower(ProactiveAvoidance(robot, goals, PROFILE, told, fixtures=fixtures), np.array(PICK))


def test_with_nobody_near_it_goes_straight_to_its_target(robot: RobotModel) -> None:
    follower = made(robot, Told(FAR))
    follower.run(5.0)
    assert len(follower.proposals) == 1
    assert follower.q == pytest.approx(PLACE) and follower.mode.reached == 1
    assert follower.mode.decision.doing is Doing.RESTING


def test_targets_are_reached_one_after_the_other_with_a_rest_at_each(robot: RobotModel) -> None:
    follower = made(robot, Told(FAR), Target(PLACE, 1.0), Target(PICK, 0.0), Target(PLACE))
    rested, began = 0.0, 0.0
    while follower.mode.reached < 3 and follower.t < 20.0:
        before = follower.mode.reached
        follower.step()
        if follower.mode.reached == 1 and before == 0:
            began = follower.t
        if len(follower.proposals) == 2 and not rested:
            rested = follower.t - began
    assert follower.mode.reached == 3 and rested == pytest.approx(1.0, abs=0.11)


def test_a_way_is_planned_around_who_stands_there(robot: RobotModel) -> None:
    follower, field = made(robot, Told(BLOCKING)), Field(robot)
    bodies = Bodies.of_points([BLOCKING[None]], PROFILE)
    straight = np.linspace(PICK, PLACE, 100)
    assert min(field.clearance(q, bodies) for q in straight) < 0.15
    follower.run(0.1)
    assert follower.way is not None
    gaps = [
        field.clearance(q, bodies) for q in follower.way.sample(np.linspace(0, follower.way.s_end, 300))[0]
    ]
    assert min(gaps) >= 0.25
    follower.run(8.0)
    assert follower.mode.reached == 1 and len(follower.proposals) == 1


def test_fixtures_are_planned_around_with_their_own_gap(robot: RobotModel) -> None:
    """A post nearer to the arm, where it is, than people may be."""
    field, beside = Field(robot), np.array([0.35, 1.0, 0.0])
    thin = Bodies(beside[None, None], beside[None, None] + (0.0, 0.0, 1.0), np.zeros(1))
    radius = field.clearance(np.array(PICK), thin) - 0.08
    assert radius > 0.05
    post = Fixtures(thin.a[0], thin.b[0], np.array([radius]))
    follower, there = made(robot, Told(FAR), fixtures=post), Bodies(thin.a, thin.b, post.radius)
    follower.run(0.1)
    assert follower.way is not None
    places = follower.way.sample(np.linspace(0.0, follower.way.s_end, 300))[0]
    assert post.gap_m - 0.011 <= min(field.clearance(q, there) for q in places) < 0.25


def test_it_stops_before_a_forecast_comes_near_and_goes_on_when_it_does_not(robot: RobotModel) -> None:
    told = Told(FAR)
    follower = made(robot, told)
    follower.run(0.5)
    told.say(FAR, FAR, BLOCKING)
    follower.step()
    assert isinstance(follower.proposals[-1], Stop) and follower.mode.decision.doing is Doing.HALTING
    assert follower.mode.decision.ahead_m < 0.25
    told.say(FAR)
    steps = 0
    while not isinstance(follower.proposals[-1], PathSpeed):
        follower.step()
        steps += 1
    assert 2 < steps < 6, "clear for some time first"
    follower.run(5.0)
    assert follower.mode.reached == 1


def test_it_waits_as_long_as_another_way_would_take_longer(robot: RobotModel) -> None:
    """The rule of ski rental: then it goes around."""
    told = Told(FAR)
    follower = made(robot, told)
    follower.run(0.2)
    first = follower.way
    assert first is not None
    told.say(BLOCKING)
    follower.step()
    stopped = follower.t
    while len(follower.proposals) < 3 and follower.t < 30.0:
        follower.step()
    taken = follower.proposals[-1]
    assert isinstance(taken, NewTrajectory)
    longer = taken.trajectory.s_end - (first.s_end - 0.2)
    assert follower.t - STEP_S - stopped == pytest.approx(max(longer, 0.3), abs=0.25)
    follower.run(12.0)
    assert follower.mode.reached == 1


def test_a_goal_in_collision_is_waited_for_and_said(robot: RobotModel) -> None:
    told = Told(AT_GOAL)
    follower = made(robot, told)
    follower.run(1.0)
    decision = follower.mode.decision
    assert not follower.proposals and decision.doing is Doing.WAITING
    assert decision.found is not None and decision.found.reason is NoPath.GOAL_NEAR
    told.say(FAR)
    follower.run(5.0)
    assert follower.mode.reached == 1


def test_where_the_supervisor_holds_it_back_it_finds_another_way(robot: RobotModel) -> None:
    told = Told(FAR)
    follower = made(robot, told)
    follower.run(0.6)
    first, here = follower.way, follower.q.copy()
    assert first is not None
    follower.held = True
    while len(follower.proposals) < 2 and follower.t < 20.0:
        follower.step()
        decision = follower.mode.decision
        assert decision.doing in (Doing.HELD, Doing.GOING)
        assert (decision.held_by == "REACHABLE") == (decision.doing is Doing.HELD)
    taken = follower.proposals[-1]
    assert isinstance(taken, NewTrajectory)
    ahead = first.sample(0.6 + 0.25)[0]
    radius = 0.7 * float(np.linalg.norm(ahead - here))
    way = taken.trajectory.sample(np.linspace(0.0, taken.trajectory.s_end, 400))[0]
    assert np.linalg.norm(way - ahead, axis=1).min() > 0.8 * radius, "rounded corners may cut it a little"
    follower.held = False
    follower.run(12.0)
    assert follower.mode.reached == 1


def test_what_the_supervisor_refuses_is_avoided(robot: RobotModel) -> None:
    follower = made(robot, Told(FAR))
    proposal = follower.mode.propose(follower.view)
    assert isinstance(proposal, NewTrajectory)
    middle = 0.5 * proposal.trajectory.s_end
    place = proposal.trajectory.sample(middle)[0]
    follower.mode.refused(Refusal(Objection.BEYOND_LIMITS, "so", middle))
    again = follower.mode.propose(replace(follower.view, t=0.1))
    assert isinstance(again, NewTrajectory)
    way = again.trajectory.sample(np.linspace(0.0, again.trajectory.s_end, 400))[0]
    assert np.linalg.norm(way - place, axis=1).min() > 0.15
    follower.mode.refused(Refusal(Objection.NO_REST, "nowhere in particular"))
    assert isinstance(follower.mode.propose(replace(follower.view, t=0.2)), NewTrajectory)


def test_views_of_something_else_are_answered_with_nothing(robot: RobotModel) -> None:
    follower = made(robot, Told(FAR))
    view = follower.view
    for other in (
        replace(view, q=np.zeros(7)), replace(view, q=np.full(6, math.nan)), replace(view, t=math.nan),
        replace(view, outcome="EXECUTING"),
    ):  # fmt: skip
        assert follower.mode.propose(other) is None
        assert follower.mode.decision.doing is Doing.NOTHING
    assert isinstance(follower.mode.propose(view), NewTrajectory)
    assert follower.mode.propose(replace(view, outcome="EXECUTING", s=math.nan)) is None


def test_people_without_a_point_are_nobody(robot: RobotModel) -> None:
    follower = made(robot, Told(np.full((MAX_POINTS, 3), math.nan)))
    follower.run(5.0)
    assert follower.mode.reached == 1


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"clearance_m": math.nan}, "proactive avoidance: clearance_m"),
        ({"margins_m": ()}, "margins_m"),
        ({"margins_m": (0.1, 0.2)}, "the largest first"),
        ({"margins_m": (-0.1,)}, "margins_m, number 1"),
        ({"patience_s": 0.0}, "patience_s"),
        ({"planner": None}, "planner"),
    ],
)
def test_settings_out_of_range_are_refused_by_name(change: dict[str, object], named: str) -> None:
    with pytest.raises(SetupError, match=named):
        ReplanSettings(**change)  # type: ignore[arg-type]  # what is to be refused


def test_targets_that_cannot_be_reached_are_refused_by_number(robot: RobotModel) -> None:
    for target, named in (
        (Target((0.0,) * 7), "target 2"),
        (Target((0.0, 0.0, 4.0, 0.0, 0.0, 0.0)), "target 2 has joint elbow_joint beyond its position limits"),
        (Target(PLACE, -1.0), "target 2, wait_s"),
        (PLACE, r"target 2 = .* should be Target\(q, wait_s\)"),
    ):
        with pytest.raises(SetupError, match=named):
            ProactiveAvoidance(robot, [Target(PICK), target], PROFILE)  # type: ignore[list-item]  # what is to be refused
    with pytest.raises(SetupError, match="no target"):
        ProactiveAvoidance(robot, [], PROFILE)


def test_a_search_that_finds_nothing_ends(robot: RobotModel) -> None:
    """People all around: no way, and no hang."""
    ring = np.array(
        [
            Standing(Stance(0.95 * math.cos(a), 0.95 * math.sin(a), a + math.pi, -0.8)).at(0.0)
            for a in np.linspace(-0.9, 0.2, 4)
        ]
    )
    told = Told(FAR)
    told.told = [ring]
    settings = ReplanSettings(planner=PlannerSettings(nodes=50))
    mode = ProactiveAvoidance(robot, [Target(PLACE)], PROFILE, told, settings)
    follower = Follower(mode, np.array(PICK))
    follower.run(1.0)
    assert not follower.proposals and mode.decision.doing is Doing.WAITING
