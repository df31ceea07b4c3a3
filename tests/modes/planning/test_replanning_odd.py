"""The mode where something is odd: clocks, views, forecasts, ways that the supervisor did not take."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from failsafe.preparation import Objection, Refusal
from modes.planning.potential_field import Bodies, Fixtures
from modes.planning.replan_settings import ReplanSettings, Target
from modes.planning.replanning import Doing, ProactiveAvoidance
from modes.planning.trials import PICK, PLACE
from occupancy.body import MAX_POINTS
from robots.errors import SetupError
from robots.model import RobotModel
from tests.modes.planning.test_replanning import BLOCKING, FAR, PROFILE, Follower, Told, made
from verifier.proposal import NewTrajectory, PathSpeed, SceneView, SeenPerson, Stop

Array = NDArray[np.float64]


@pytest.fixture
def robot(arm: Callable[[str], RobotModel]) -> RobotModel:
    return arm("ur16e")


def odd_frames(rng: np.random.Generator) -> Sequence[Array]:
    """Frames of no use, or of people who cannot be."""
    n = MAX_POINTS
    kinds: tuple[Sequence[Array], ...] = (
        [], [np.zeros((n, 3))], [np.zeros((1, n, 3)), np.zeros((2, n, 3))], [np.zeros((1, 14, 3))],
        np.zeros((0, 1, n, 3)), [np.full((1, n, 3), np.inf)], [np.full((1, n, 3), np.nan)] * 11,
        [np.full((9, n, 3), 1e12)], [np.full((1, n, 3), -1e300), np.full((1, n, 3), 1e300)],
        [np.zeros((0, n, 3))], [np.zeros((9, n, 3))], [FAR[None]] * 3, rng.normal(size=(11, 2, n, 3)),
    )  # fmt: skip
    return kinds[int(rng.integers(len(kinds)))]


def odd_view(rng: np.random.Generator, view: SceneView, n: int) -> SceneView:
    """What a supervisor may show, and more."""
    number = float(rng.choice([math.nan, math.inf, -math.inf, -1.0, 0.0, 1e-12, 1e12, 1.0, 1e308]))
    person = SeenPerson(
        "p", np.full(MAX_POINTS, number), np.full((MAX_POINTS, 3), number), np.zeros(MAX_POINTS)
    )
    odd: tuple[dict[str, Any], ...] = (
        {"t": number}, {"s": number}, {"sdot": number, "s_rest": number}, {"outcome": "FAILSAFE"},
        {"outcome": "RECOVERING", "s": number}, {"outcome": "STOPPED", "s": number}, {"outcome": "?"},
        {"q": np.full(n, number)}, {"q": rng.uniform(-20.0, 20.0, n)}, {"q": np.zeros(n + 1)},
        {"people": (person,) * int(rng.integers(10))}, {},
    )  # fmt: skip
    return replace(view, **odd[int(rng.integers(len(odd)))])


@pytest.mark.parametrize("name", ["ur16e", "panda", "lwa4p"])
def test_nothing_that_it_is_shown_or_told_makes_it_raise(
    name: str, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    robot, told = arm(name), Told(FAR)
    n = len(robot.joints)
    low, high = (
        np.clip(each, -3.0, 3.0) for each in (robot.limits.position_lower, robot.limits.position_upper)
    )
    begin = 0.5 * (low + high)
    targets = [Target(tuple(begin + share * (high - begin))) for share in (0.5, 0.5, 0.2)]
    follower = Follower(ProactiveAvoidance(robot, targets, PROFILE, told), begin)
    refusal = Refusal(Objection.JUMP, "so", math.nan)
    for _ in range(100 + count(5000)):
        told.told = odd_frames(rng) if rng.uniform() < 0.5 else [FAR[None]]
        follower.mode.propose(odd_view(rng, follower.view, n))
        if rng.uniform() < 0.1:
            follower.mode.refused(refusal._replace(s=float(rng.choice([math.nan, math.inf, -1.0, 0.5, 1e9]))))
    told.told, follower.t = [FAR[None]], 1e9
    follower.run(15.0)
    assert follower.mode.reached == 3, "and it goes on as if nothing had been"


def test_it_stops_while_it_is_not_told_where_people_are(robot: RobotModel) -> None:
    told = Told(FAR)
    follower = made(robot, told)
    follower.run(0.5)
    told.told = []
    follower.step()
    assert isinstance(follower.proposals[-1], Stop) and follower.mode.decision.doing is Doing.HALTING
    assert math.isnan(follower.mode.decision.ahead_m)
    follower.run(2.0)
    assert len(follower.proposals) == 2
    told.say(FAR)
    follower.run(6.0)
    assert follower.mode.reached == 1


def test_it_does_not_set_out_while_it_is_not_told_where_people_are(robot: RobotModel) -> None:
    told = Told(FAR)
    told.told = [np.zeros((1, 3))]
    follower = made(robot, told)
    follower.run(1.0)
    assert not follower.proposals and follower.mode.decision.doing is Doing.WAITING
    told.say(FAR)
    follower.run(5.0)
    assert follower.mode.reached == 1


def test_a_stop_is_taken_back_though_there_was_no_view_meanwhile(robot: RobotModel) -> None:
    told = Told(FAR)
    follower = made(robot, told)
    follower.run(0.5)
    told.say(BLOCKING)
    follower.step()
    assert isinstance(follower.proposals[-1], Stop)
    assert follower.mode.propose(replace(follower.view, q=np.full(6, math.nan))) is None
    assert follower.mode.decision.doing is Doing.NOTHING
    told.say(FAR)
    follower.run(0.6)
    assert isinstance(follower.proposals[-1], PathSpeed)
    follower.run(5.0)
    assert follower.mode.reached == 1


@pytest.mark.parametrize("back_s", [0.05, 1e5])
def test_a_clock_that_goes_back_costs_no_more_than_what_is_waited_for_anew(
    robot: RobotModel, back_s: float
) -> None:
    told = Told(FAR)
    follower = made(robot, told, Target(PLACE, 0.5), Target(PICK))
    follower.t = 2e5
    follower.run(0.5)
    told.say(BLOCKING)
    follower.step()
    told.say(FAR)
    follower.step()
    follower.t -= back_s  # while it waits for a way to be clear for some time
    follower.run(0.6)
    assert isinstance(follower.proposals[-1], PathSpeed)
    while follower.mode.reached < 1:
        follower.step()
    follower.t -= back_s  # while it rests at a target
    follower.run(1.0)
    assert isinstance(follower.proposals[-1], NewTrajectory)


def test_targets_where_it_stands_are_reached_whoever_is_near(robot: RobotModel) -> None:
    told = Told(BLOCKING)
    turned = (*PICK[:-1], PICK[-1] + 2.0 * math.pi - 1e-9)
    touching = BLOCKING - (0.4, -0.4, 0.0)
    told.say(touching)
    follower = made(robot, told, *(Target(each, 0.0) for each in (PICK, PICK, turned, PICK)))
    follower.run(0.2)
    assert follower.mode.reached == 4 and not follower.proposals
    assert follower.mode.decision.doing is Doing.RESTING


def test_each_rest_on_the_way_is_waited_for_by_itself(robot: RobotModel) -> None:
    follower = made(robot, Told(FAR))
    follower.run(0.5)
    follower.held = True
    follower.run(0.2)
    follower.held = False
    follower.run(0.5)
    follower.held = True
    follower.run(0.2)
    assert follower.mode.decision.doing is Doing.HELD and follower.mode.decision.found is None
    assert len(follower.proposals) == 1, "it was held for 0.2 s only, twice"


def test_where_no_other_way_is_found_the_same_is_not_taken_again_and_again(robot: RobotModel) -> None:
    """Held back for ever where the way begins: what is proposed is another way each time, or nothing."""
    follower = made(robot, Told(FAR))
    follower.held = True
    follower.run(20.0)
    ways = [each.trajectory for each in follower.proposals if isinstance(each, NewTrajectory)]
    assert 2 <= len(ways) <= 8
    for one, other in pairwise(ways):
        places = np.linspace(0.0, max(one.s_end, other.s_end), 50)
        assert np.abs(one.sample(places)[0] - other.sample(places)[0]).max() > 0.05


def test_a_refused_stop_does_not_make_it_forget_its_way(robot: RobotModel) -> None:
    told = Told(FAR)
    follower = made(robot, told)
    follower.run(0.5)
    told.say(BLOCKING)
    follower.step()
    assert isinstance(follower.proposals[-1], Stop)
    follower.mode.refused(Refusal(Objection.LATCHED, "nothing is verified any more"))
    follower.step()
    assert follower.mode.decision.doing is Doing.HALTING


def test_on_a_way_that_is_not_its_own_it_says_nothing_and_plans_from_rest(robot: RobotModel) -> None:
    """A way that the supervisor did not take, while it went on along another one."""
    follower = made(robot, Told(FAR))
    follower.run(0.5)
    there = follower.q + np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    for s in (0.3, math.nan):
        moving = replace(follower.view, q=there, s=s)
        assert follower.mode.propose(moving) is None and follower.mode.decision.doing is Doing.NOTHING
    resting = replace(follower.view, q=there, s=0.3, outcome="STOPPED")
    again = follower.mode.propose(resting)
    assert isinstance(again, NewTrajectory) and np.allclose(again.trajectory.sample(0.0)[0], there)


def test_a_metre_of_a_linear_axis_is_no_angle(arm: Callable[[str], RobotModel]) -> None:
    follower = made(arm("ur16e"), Told(FAR), Target((*PICK[:-1], PICK[-1] - 2.0 * math.pi), 0.0))
    mode = follower.mode
    follower.run(0.1)
    assert mode.reached == 1, "a whole turn away it is the same"
    linear = made(arm("ur16e"), Told(FAR), Target((*PICK[:-1], PICK[-1] - 2.0 * math.pi), 0.0))
    linear.mode._turns = np.array([True] * 5 + [False])
    linear.run(0.1)
    assert linear.mode.reached == 0


def test_what_it_is_made_with_is_refused_by_name(robot: RobotModel) -> None:
    good: dict[str, Any] = {"robot": robot, "targets": [Target(PLACE)], "profile": PROFILE}
    for change, named in (
        ({"robot": None}, "robot = None should be the supervisor's robot"),
        ({"targets": 3}, "targets = 3 should be a list"),
        ({"targets": iter(())}, "targets = .* should be a list"),
        ({"profile": "iso"}, "profile = 'iso' should be radii of people"),
        ({"settings": {"clearance_m": 0.3}}, "settings = .* should be ReplanSettings"),
        ({"fixtures": []}, r"fixtures = \[\] should be Fixtures"),
        ({"foresight": 1.0}, "foresight = 1.0 should have a method frames"),
    ):
        with pytest.raises(SetupError, match=named):
            ProactiveAvoidance(**{**good, **change})
    for setting, named in (
        ({"margins_m": 0.1}, "margins_m = 0.1 should be a tuple"),
        ({"margins_m": (math.nan,)}, "margins_m, number 1"),
        ({"clearance_m": 4.9, "margins_m": (0.2,)}, "margins_m, number 1"),
        ({"sample_s": 1e-9}, "sample_s"),
        ({"ahead_s": math.inf}, "ahead_s"),
    ):
        with pytest.raises(SetupError, match=named):
            ReplanSettings(**setting)


def test_fixtures_may_be_lists_and_are_refused_by_name_otherwise() -> None:
    post = Fixtures([[0.5, 0.0, 0.0]], [[0.5, 0.0, 1.0]], [0.1])  # type: ignore[arg-type]  # lists will do
    there = Bodies(np.zeros((2, 0, 3)), np.zeros((2, 0, 3)), np.zeros(0)).beside(post, 0.25)
    assert there.frames == 2 and there.radius == pytest.approx([0.1 + 0.02 - 0.25])
    for a, radius, named in (
        ([[0.5, 0.0]], [0.1], "fixtures: a"),
        ([[0.5, 0.0, math.nan]], [0.1], "fixtures: a"),
        ([[0.5, 0.0, 0.0]], 0.1, "fixtures: radius"),
        ([[0.5, 0.0, 0.0]], [[0.1], [0.1, 0.2]], "fixtures: radius"),
        ([[0.5, 0.0, 0.0]], [-0.1], r"fixtures: radius -0\.1 m"),
    ):
        with pytest.raises(SetupError, match=named):
            Fixtures(a, [[0.5, 0.0, 1.0]], radius)  # type: ignore[arg-type]  # what is to be refused
