"""How near is too near for the mode, and how far ahead it looks: somebody of whom only the head is seen."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from modes.planning.arrt import Found
from modes.planning.potential_field import Bodies
from modes.planning.replanning import Doing, ProactiveAvoidance, _Way
from occupancy.body import MAX_POINTS, Point
from robots.model import RobotModel
from tests.modes.planning.gaps import least_gaps
from tests.modes.planning.test_replanning import FAR, PROFILE, STEP_S, Follower, Told, made
from verifier.proposal import NewTrajectory, PathSpeed, Stop

Array = NDArray[np.float64]


@pytest.fixture
def robot(arm: Callable[[str], RobotModel]) -> RobotModel:
    return arm("ur16e")


def head(place: Array) -> Array:
    points = np.full((MAX_POINTS, 3), np.nan)
    points[Point.HEAD] = place
    return points


def gaps_along(robot: RobotModel, way: IntendedTrajectory, s: Array, points: Array) -> Array:
    """By other means than the mode's (tests/modes/planning/gaps.py)."""
    q = way.sample(np.minimum(s, way.s_end))[0]
    return least_gaps(robot, q, Bodies.of_points([points[None]], PROFILE))


def beside(robot: RobotModel, way: IntendedTrajectory, s: Array, gap: float, azimuth: float) -> Array:
    """A head before the arm at that azimuth, whose least gap from the places ``s`` of a way is ``gap``."""
    along = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    low, high = 0.3, 3.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        near = gaps_along(robot, way, s, head(middle * along + (0.0, 0.0, 0.3))).min() < gap
        low, high = (middle, high) if near else (low, middle)
    return head(high * along + (0.0, 0.0, 0.3))


def under_way(robot: RobotModel, seconds: float = 0.5) -> tuple[Follower, Told, IntendedTrajectory]:
    told = Told(FAR)
    follower = made(robot, told)
    follower.run(seconds)
    assert follower.way is not None
    return follower, told, follower.way


@pytest.mark.parametrize(("gap", "stops"), [(0.25, True), (0.2785, True), (0.2835, False)])
def test_it_stops_where_the_gap_ahead_is_smaller_than_wanted_and_no_sooner(
    robot: RobotModel, gap: float, stops: bool
) -> None:
    follower, told, way = under_way(robot)
    ahead = np.linspace(follower.s, follower.s + 1.5, 300)
    told.say(beside(robot, way, ahead, gap, 0.0))
    follower.step()
    assert isinstance(follower.proposals[-1], Stop) == stops
    assert follower.mode.decision.ahead_m == pytest.approx(gap, abs=1e-3)


def test_it_looks_ahead_as_far_as_it_should_and_at_all_of_it(robot: RobotModel) -> None:
    """Somebody is near one second of the way only; until that is 1.5 s ahead, it goes on."""
    follower, told, way = under_way(robot, 0.1)
    there = beside(robot, way, np.linspace(0.0, way.s_end, 400), 0.24, -1.5)
    s = np.linspace(0.0, way.s_end, 2000)
    near = s[gaps_along(robot, way, s, there) < 0.28]
    assert near[0] - follower.s > 1.6
    told.say(there)
    while not isinstance(follower.proposals[-1], Stop):
        looked_from = follower.s
        follower.step()
    assert near[0] - 1.5 <= looked_from <= near[0] - 1.5 + STEP_S + 0.05
    follower, told, way = under_way(robot)
    middle = beside(robot, way, np.linspace(0.0, way.s_end, 400), 0.245, 0.25)
    near = s[gaps_along(robot, way, s, middle) < 0.28]
    assert near[-1] - near[0] < 1.2
    while follower.s < 0.5 * (near[0] + near[-1]) - 0.8:
        follower.step()
    assert follower.s < near[0] and near[-1] < follower.s + 1.5, "at neither end of what is looked at"
    told.say(middle)
    follower.step()
    assert isinstance(follower.proposals[-1], Stop)


def test_it_goes_on_only_with_the_gap_that_the_way_was_planned_with(robot: RobotModel) -> None:
    follower, told, way = under_way(robot)
    ahead = np.linspace(follower.s, follower.s + 1.5, 300)
    told.say(beside(robot, way, ahead, 0.2, 0.0))
    follower.step()
    assert follower.mode.decision.doing is Doing.HALTING
    told.say(beside(robot, way, np.linspace(follower.s, follower.s + 1.5, 300), 0.39, 0.0))
    follower.run(0.7)
    assert not any(isinstance(each, PathSpeed) for each in follower.proposals)


def test_the_largest_margin_is_taken_where_the_way_is_hardly_longer(robot: RobotModel) -> None:
    """Nobody near: 0.4 m. Else no more than 1.3 times as long as with the smallest margin."""
    follower, _told, way = under_way(robot)
    assert follower.mode._way is not None and follower.mode._way.gap_m == pytest.approx(0.4)
    gaps = set()
    for azimuth in (-0.5, 0.0, 0.4):
        for gap in (-0.05, 0.1, 0.3):
            there = beside(robot, way, np.linspace(0.0, way.s_end, 200), gap, azimuth)
            other, lean = made(robot, Told(there)), made(robot, Told(there))
            lean.mode._fields = lean.mode._fields[-1:]
            taken, least = other.mode.propose(other.view), lean.mode.propose(lean.view)
            if not isinstance(least, NewTrajectory):
                continue
            assert isinstance(taken, NewTrajectory) and other.mode._way is not None
            assert taken.trajectory.s_end <= 1.3 * least.trajectory.s_end + 1e-9
            gaps.add(round(other.mode._way.gap_m, 3))
    assert len(gaps) > 1, gaps


@pytest.mark.parametrize(
    ("lasting", "taken"),
    [((2.0, 2.5, 3.4), 1), ((2.0, 2.5, 2.55), 2), ((2.0, 2.7, 2.0), 0), ((2.0, None, 2.0), 0)],
)
def test_a_wider_margin_is_not_taken_whatever_it_costs(
    robot: RobotModel,
    monkeypatch: pytest.MonkeyPatch,
    lasting: tuple[float | None, ...],
    taken: int,
) -> None:
    """Ways of given durations, from the smallest margin on: each may take 1.3 times what the last did."""
    mode = made(robot, Told(FAR)).mode
    still = np.zeros((1, 6, 6))
    ways = [
        None if each is None else _Way(IntendedTrajectory([0.0, each], still, "rest"), 0.3 + 0.05 * k)
        for k, each in enumerate(lasting)
    ]
    asked = iter(ways)
    monkeypatch.setattr(ProactiveAvoidance, "_planned", lambda *_: (Found(None, None, 0), next(asked)))
    proposal = mode.propose(made(robot, Told(FAR)).view)
    assert isinstance(proposal, NewTrajectory)
    assert proposal.trajectory is ways[taken].trajectory  # type: ignore[union-attr]  # the one that is taken is there


def test_what_it_was_held_back_from_is_avoided_as_widely_as_most_of_the_way_there(robot: RobotModel) -> None:
    follower, _told, way = under_way(robot, 0.6)
    follower.held = True
    follower.run(0.6)
    (refused,) = follower.mode._refused
    assert np.allclose(refused.centre, way.sample(follower.s + 0.25)[0])
    far = float(np.linalg.norm(refused.centre - follower.q))
    assert refused.radius == pytest.approx(0.7 * far) and far > 0.1
    assert refused.until == pytest.approx(follower.mode.decision.t + 4.0, abs=0.3)
