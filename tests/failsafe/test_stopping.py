"""Worst-case stops: simulated stops from random states stay within the brackets, and their witnesses reach
them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from failsafe.axis_stop import AxisLimits, Start, motion_during, stop_axis
from failsafe.bracket import Bracket, Effort, Ended, Witness
from failsafe.stop_grid import SHARES, stop_grid
from failsafe.stopping import (
    POINT_SPEED,
    STOP_ANGLE,
    STOP_TIME,
    STOP_WAY,
    ArmSearch,
    ConstantDeceleration,
    ConstantRatioStop,
    JerkLimitedStop,
    PathConsistentStop,
    extends,
    of,
)
from robots.errors import SetupError
from tests.failsafe.arm_speeds import extensions, speeds
from tests.failsafe.test_axis_stop import random_state
from tests.failsafe.test_box_search import catalogue_arm, interrupt, planar
from tests.occupancy.arms import arm, poses

ROUGH = Effort(gap=0.2, max_boxes=1 << 15)
KINDS = ("planar", "scara", "six", "gantry", "branches")


def places(model, q, points):
    """Places (T, P, 3) of points by the tests' own kinematics."""
    rotations, positions = poses(model, q)
    joint = points["joint"]
    return positions[:, joint] + np.einsum("tpij,pj->tpi", rotations[:, joint], points["place"])


def simulated(rng, search, stop, number):
    """Displacements, times and ways of points in random stops; states steady or any, as the stop says."""
    model = search.model
    n = len(model.joints)
    lower, upper = search.box
    angles, times, way = np.zeros(n), np.zeros(n), 0.0
    for _ in range(number):
        q0 = rng.uniform(lower, upper)
        t = np.linspace(0.0, 1.01 * max(stop.time(j).value for j in range(n)), 300)
        moved = np.zeros((len(t), n))
        for j in range(n):
            limits = stop.axis(j)
            v, a = random_state(rng, limits)
            if stop.start is Start.STEADY:
                v, a = (rng.choice([-1.0, 1.0]) * limits.velocity if rng.random() < 0.8 else v), 0.0
            one = stop_axis(v, a, limits)
            moved[:, j] = motion_during(one, v, a, t)[0]
            times[j] = max(times[j], one.time)
            angles[j] = max(angles[j], -one.lowest, one.highest)
        chords = np.diff(places(model, q0 + moved, search.points), axis=0)
        way = max(way, float(np.linalg.norm(chords, axis=2).sum(axis=0).max()))
    return angles, times, way


@pytest.mark.parametrize("start", Start)
@pytest.mark.parametrize("name", KINDS)
def test_simulated_stops_stay_within_the_brackets(name, start, rng, count):
    model = arm(name, rng)
    search = ArmSearch(model, ROUGH)
    stop = JerkLimitedStop(model.limits, 0.7, start)
    found = stop.worst(search)
    angles, times, way = simulated(rng, search, stop, count(4_000))
    assert (times <= [each.upper * (1.0 + 1e-9) for each in of(found, STOP_TIME)]).all()
    assert (angles <= [each.upper * (1.0 + 1e-9) for each in of(found, STOP_ANGLE)]).all()
    longest = of(found, STOP_WAY)[0]
    assert way <= longest.upper
    assert longest.lower >= 0.5 * longest.upper or start is Start.ANY


@pytest.mark.parametrize("name", ("ur3", "ur10", "panda"))
def test_catalogue_arms(name, rng, count):
    model = catalogue_arm(name)
    search = ArmSearch(model, Effort(gap=0.25, max_boxes=1 << 15))
    stop = JerkLimitedStop(model.limits)
    found = stop.worst(search)
    for each in (*of(found, STOP_TIME), *of(found, STOP_ANGLE)):
        assert each.gap <= 1e-9 and each.ended is Ended.CLOSED_FORM
    fastest, longest = of(found, POINT_SPEED)[0], of(found, STOP_WAY)[0]
    assert fastest.gap < 0.3 and fastest.unit == "m/s" and fastest.part in model.links
    assert longest.gap < 0.5 and longest.unit == "m"
    _, _, way = simulated(rng, search, stop, count(2_000))
    assert way <= longest.upper
    at = fastest.witness
    seen = max(speeds(model, at.q[None], at.dq[None], point)[0] for point in search.points)
    assert seen == pytest.approx(fastest.lower, rel=1e-9)


def test_the_way_from_below_is_that_of_its_witness(rng):
    model = arm("six", rng)
    search = ArmSearch(model, ROUGH)
    stop = JerkLimitedStop(model.limits)
    longest = of(stop.worst(search), STOP_WAY)[0]
    at = longest.witness
    t = np.linspace(0.0, max(stop.time(j).value for j in range(6)), 20_000)
    moved = np.array([np.sign(at.dq[j]) * stop.way(j, t) for j in range(6)]).T
    chords = np.diff(places(model, at.q + moved, search.points), axis=0)
    exact = float(np.linalg.norm(chords, axis=2).sum(axis=0).max())
    assert longest.lower <= exact * (1.0 + 1e-12)
    assert longest.lower == pytest.approx(exact, rel=1e-3)


def test_joints_with_different_limits_are_counted_layer_by_layer():
    """Two links in a plane, stretched all the while: the way is the sum of two arcs, 0.85 θ1 + 0.45 θ2."""
    model = planar()
    search = ArmSearch(model, Effort(gap=0.002))
    stop = ConstantDeceleration(np.array([1.0, 3.0]), np.array([5.0, 5.0]), 0.1)
    found = stop.worst(search)
    assert [each.lower for each in of(found, STOP_TIME)] == pytest.approx([0.3, 0.7], rel=1e-12)
    assert [each.lower for each in of(found, STOP_ANGLE)] == pytest.approx([0.2, 1.2], rel=1e-12)
    upper = of(found, STOP_WAY)[0].upper
    exact = 0.85 * 0.2 + 0.45 * 1.2
    assert exact <= upper <= 1.01 * exact


def test_path_consistent_stops_have_no_bound_for_every_path():
    model = catalogue_arm("ur5")
    search = ArmSearch(model, ROUGH)
    found = PathConsistentStop(model.limits).worst(search)
    free = JerkLimitedStop(model.limits).worst(search)
    for each, other in zip(found, free, strict=True):
        if each.quantity == POINT_SPEED:
            assert each.upper == other.upper < math.inf
            continue
        assert each.upper == math.inf and each.ended is Ended.UNBOUNDED and each.gap == 1.0
        assert "look for the worst over a recording" in each.reason
        assert each.lower > 0.0
        if each.quantity != STOP_WAY:
            assert each.lower == other.lower


def test_extension_holds_when_the_stop_begins(rng):
    model = catalogue_arm("ur5")
    search = ArmSearch(model, ROUGH)
    largest = search.largest_extension()
    seen = extensions(model, rng.uniform(-np.pi, np.pi, (5_000, 6)), search.points).max()
    assert 0.9 * largest.bound < seen <= largest.bound
    near = 0.5 * largest.bound
    found = JerkLimitedStop(model.limits).worst(search, near)
    everywhere = JerkLimitedStop(model.limits).worst(search)
    fastest, longest = of(found, POINT_SPEED)[0], of(found, STOP_WAY)[0]
    assert extends(search, fastest.witness.q) <= near
    assert fastest.lower < of(everywhere, POINT_SPEED)[0].lower
    if longest.witness is not None:
        assert extends(search, longest.witness.q) <= near
        assert extends(search, longest.witness.q) == pytest.approx(
            extensions(model, longest.witness.q[None], search.points)[0], abs=1e-12
        )


def test_the_way_is_an_upper_sum(rng, count):
    """Never below the integral of F(s V) over the stop, which two links in a plane have in closed form."""
    search = ArmSearch(planar(), Effort(gap=0.002))
    for _ in range(count(300)):
        a = rng.uniform(1.0, 9.0, 2)
        upper = of(ConstantDeceleration(np.array([1.0, 3.0]), a).worst(search), STOP_WAY)[0].upper
        exact = 0.85 * 1.0 / (2.0 * a[0]) + 0.45 * 9.0 / (2.0 * a[1])
        assert exact <= upper <= 1.01 * exact


def test_a_stop_in_proportion_keeps_the_limits_of_every_joint(rng, count):
    """By differences of its way; as quick as its narrowest limits allow, which is a sum of two times."""
    model = arm("six", rng)
    for _ in range(count(500)):
        limits = replace(
            model.limits, acceleration=rng.uniform(2.0, 30.0, 6), jerk=rng.uniform(50.0, 900.0, 6)
        )
        stop = ConstantRatioStop(limits, 0.8)
        t = np.linspace(0.0, stop.time(0).value, 4_001)
        ways = np.array([stop.way(j, t) for j in range(6)])
        h, speed = t[1], 0.8 * limits.velocity
        for order, most in ((1, speed), (2, limits.acceleration), (3, limits.jerk)):
            seen = np.abs(np.diff(ways, order)).max(axis=1) / h**order
            assert (seen <= most * (1.0 + 1e-3)).all()
        a, j = float((limits.acceleration / speed).min()), float((limits.jerk / speed).min())
        shortest = 1.0 / a + a / j if a * a <= j else 2.0 / math.sqrt(j)
        assert t[-1] == pytest.approx(shortest, rel=1e-9)


@pytest.mark.parametrize(
    ("speed", "deceleration"),
    [([2.0, 2.0], [2.0 / 3.0, 2.0 / 3.0]), ([2.0, 8.0], [0.4, 8.0 * 8.0 / (2.0 * 1.9)])],
)
def test_an_arm_may_extend_while_it_stops(speed, deceleration):
    """Bent when the stop begins, stretched before it ends: by brute force, farther than if it stayed bent.

    In the first stop both joints brake alike; in the second the elbow has opened before the first joint is
    much slower.
    """
    model = planar()
    search = ArmSearch(model, Effort(gap=0.01))
    stop = ConstantDeceleration(np.array(speed), np.array(deceleration))
    near, bent = 0.5, -2.0 * math.acos(0.449 / 0.8)
    assert extends(search, np.array([0.0, bent])) <= near
    t = np.linspace(0.0, max(stop.time(j).value for j in range(2)), 2_000)
    q = np.array([stop.way(0, t), bent + stop.way(1, t)]).T
    way = np.linalg.norm(np.diff(places(model, q, search.points), axis=0), axis=2).sum(axis=0).max()
    fastest, longest = (of(stop.worst(search, near), each)[0] for each in (POINT_SPEED, STOP_WAY))
    bent_all_the_while = fastest.upper * float(np.trapezoid(stop.fastest(0, t), t)) / speed[0]
    assert longest.upper >= way
    assert way > bent_all_the_while or speed[1] > speed[0], "vacuous"


def test_ways_from_below_stay_within_the_position_limits(rng, count):
    """Where nothing else holds the arm back, a stop that is followed must not leave them either."""
    found = 0
    lower = rng.uniform(-3.0, 0.0, (count(400), 2))
    ranges = [*zip(lower, lower + rng.uniform(0.3, 3.0, lower.shape), strict=True)]
    for low, high in ((-0.2, math.tau), (-math.tau, 0.2)):
        # a whole turn brings the begin of the best way inside, and not its end
        ranges.append((np.array([-20.0, low]), np.array([20.0, high])))
    for low, high in ranges:
        model = planar()
        limits = replace(model.limits, position_lower=low, position_upper=high)
        model = replace(model, limits=limits)
        search = ArmSearch(model, Effort(gap=0.3))
        stop = ConstantDeceleration(np.array([1.0, 3.0]), np.array([2.0, 8.0]))
        at = of(stop.worst(search), STOP_WAY)[0].witness
        if at is None:
            continue
        found += 1
        end = at.q + np.sign(at.dq) * [stop.angle(j).value for j in range(2)]
        for q in (at.q, end):
            assert (q >= limits.position_lower - 1e-12).all() and (q <= limits.position_upper + 1e-12).all()
    assert found > 0


def test_speeds_in_nearly_the_same_proportion_are_searched_again():
    """What is remembered of the first pair of speeds must not stand for the second: 0.85 V1 + 0.45 V2."""
    search = ArmSearch(planar(), Effort(gap=0.002))
    for speed in ([1.5, 1.92], [1.5, 1.96], [3.0, 3.92]):
        found, exact = search.fastest(np.array(speed)), 0.85 * speed[0] + 0.45 * speed[1]
        assert found.best == pytest.approx(exact, rel=1e-6)
        assert exact <= found.bound <= 1.003 * exact
    near = search.fastest(np.array([1.5, 1.92]), 0.5)
    assert near.best < 0.9 * exact, "nor what is remembered of every extension"


def test_shares_of_the_extension_are_of_what_is_never_exceeded():
    """A configuration that counts as 33 % of the largest extension must not be left out of that cell."""
    model = catalogue_arm("ur5")
    search = ArmSearch(model, Effort(gap=0.3, max_boxes=1 << 14))
    stop = ConstantDeceleration(np.ones(6), np.ones(6))
    grid = stop_grid(search, lambda *_: stop, load_matters=False, shares=(0.5, 1.0))
    largest = grid.largest_extension
    assert largest.lower < largest.upper, "vacuous"
    for cell in grid.cells:
        assert cell.extension_m >= cell.extension * largest.upper * (1.0 - 1e-12)


def test_cells_of_the_grid_are_of_their_own_extension():
    """Two links of 0.4 m in a plane: with the tip d from the first axis, both turning the same way, it has
    √(V1² d² + V2² 0.4² + V1 V2 d²), and its ball of 0.05 m adds 0.05 (V1 + V2)."""
    speed, ball = np.array([1.5, 2.0]), 0.05
    search = ArmSearch(planar(ball), Effort(gap=0.02))

    def stop_at(share: float, _load: float) -> ConstantDeceleration:
        return ConstantDeceleration(share * speed, np.array([4.0, 4.0]))

    grid = stop_grid(search, stop_at, load_matters=False, shares=(0.6, 0.8, 1.0))
    for cell in grid.cells:
        d, (v1, v2) = min(cell.extension_m, 0.85) - ball, cell.speed * speed
        exact = math.sqrt((v1 * v1 + v1 * v2) * d * d + (0.4 * v2) ** 2) + ball * (v1 + v2)
        fastest, longest = (of(cell.brackets, each)[0] for each in (POINT_SPEED, STOP_WAY))
        assert 0.9 * exact <= fastest.lower <= exact * (1.0 + 1e-9), (cell.extension, cell.speed)
        assert exact * (1.0 - 1e-9) <= fastest.upper <= 1.03 * exact
        assert extends(search, fastest.witness.q) <= cell.extension_m
        assert longest.witness is None or extends(search, longest.witness.q) <= cell.extension_m


def test_grid_of_a_joint_space_stop():
    model = catalogue_arm("ur5")
    search = ArmSearch(model, Effort(gap=0.3, max_boxes=1 << 14))
    grid = stop_grid(search, lambda speed, load: JerkLimitedStop(model.limits, speed), load_matters=False)
    assert grid.complete and len(grid.cells) == 27 and grid.stop == "joint_space"
    assert [(c.load, c.speed, c.extension) for c in grid.cells] == [
        (load, speed, extension) for load in SHARES for speed in SHARES for extension in SHARES
    ]
    full, slow = grid.at(1.0, 1.0, 1.0), grid.at(1.0, 0.33, 1.0)
    assert full.extension_m == math.inf and grid.at(0.33, 1.0, 1.0).extension_m < 0.4
    assert of(slow.brackets, POINT_SPEED)[0].upper == pytest.approx(
        0.33 * of(full.brackets, POINT_SPEED)[0].upper, rel=1e-9
    )
    for quantity in (STOP_TIME, STOP_ANGLE, STOP_WAY):
        for a, b in zip(of(slow.brackets, quantity), of(full.brackets, quantity), strict=True):
            assert a.upper < b.upper
    assert grid.at(0.66, 0.66, 0.33).brackets is grid.at(0.66, 0.66, 1.0).brackets
    with pytest.raises(SetupError, match=r"no cell at extension 0\.5"):
        grid.at(0.5, 1.0, 1.0)
    for share in (0.0, 1.1, math.nan):
        with pytest.raises(SetupError, match=f"share {share:g} must be above 0 and at most 1"):
            stop_grid(search, lambda *_: JerkLimitedStop(model.limits), load_matters=False, shares=(share,))


def test_a_stop_that_does_not_fit_into_the_range_of_its_joint_is_not_reached():
    model = arm("planar", np.random.default_rng(0))
    lower, upper = model.limits.position_lower.copy(), model.limits.position_upper.copy()
    stop = ConstantDeceleration(np.array([1.0, 1.0]), np.array([2.0, 2.0]))  # 0.25 rad
    for room, reached in ((0.26, True), (0.24, False), (2e-4, False)):
        lower[1], upper[1] = 0.5, 0.5 + room
        short = replace(model, limits=replace(model.limits, position_lower=lower, position_upper=upper))
        for each in stop.worst(ArmSearch(short, Effort(gap=0.3))):
            if each.quantity not in (STOP_TIME, STOP_ANGLE):
                continue
            full = 0.25 if each.quantity == STOP_ANGLE else 0.5
            assert each.upper == pytest.approx(full)
            there = reached or each.part == model.joints[0]
            assert (each.lower, each.witness is not None) == ((pytest.approx(full) if there else 0.0), there)
            assert ("no joint position leaves room" in each.method) is not there


def test_a_way_tells_of_the_search_of_a_layer_that_ended_early(monkeypatch):
    """The fastest point was found as narrowly as asked for; joints on their own were not searched so far."""
    model = arm("planar", np.random.default_rng(0))
    search, whole = ArmSearch(model, Effort(gap=0.3)), ArmSearch.fastest

    def fastest(self, speed, extension_m=math.inf):
        found = whole(self, speed, extension_m)
        return found if np.all(speed > 0.0) else replace(found, ended=Ended.DEADLINE)

    stop = ConstantDeceleration(np.array([1.0, 1.0]), np.array([1.0, 5.0]))
    ended = {each.quantity: each.ended for each in stop.worst(search)}
    assert ended[POINT_SPEED] is ended[STOP_WAY] is Ended.NARROW
    monkeypatch.setattr(ArmSearch, "fastest", fastest)
    ended = {each.quantity: each.ended for each in stop.worst(search)}
    assert ended[POINT_SPEED] is Ended.NARROW and ended[STOP_WAY] is Ended.DEADLINE


def test_why_the_search_for_the_largest_extension_ended_is_said():
    search = ArmSearch(catalogue_arm("ur5"), Effort(gap=1e-4, max_boxes=2))
    grid = stop_grid(
        search, lambda *_: ConstantDeceleration(np.ones(6), np.ones(6)), load_matters=False, shares=(1.0,)
    )
    assert grid.complete and grid.largest_extension.ended is Ended.FULL


def test_an_interrupt_ends_the_grid_with_what_there_is():
    model = catalogue_arm("ur5")
    search = ArmSearch(model, Effort(gap=0.01, should_end=lambda: True))
    grid = stop_grid(search, lambda speed, load: JerkLimitedStop(model.limits, speed), load_matters=False)
    assert not grid.complete and len(grid.cells) == 1
    for each in grid.cells[0].brackets:
        assert 0.0 <= each.lower <= each.upper < math.inf
        if each.quantity in (POINT_SPEED, STOP_WAY):
            assert each.ended is Ended.INTERRUPTED


def test_what_is_asked_after_an_interrupt_is_bounded_in_closed_form():
    """0.85 V1 + 0.45 V2, which two links in a plane reach; nothing is said to have been found."""
    search = ArmSearch(planar(), Effort(progress=interrupt))
    assert search.fastest(np.array([1.0, 1.0])).ended is Ended.INTERRUPTED
    found = search.fastest(np.array([1.0, 3.0]))
    assert 0.85 + 3.0 * 0.45 <= found.bound <= (0.85 + 3.0 * 0.45) * (1.0 + 1e-6)
    assert (found.best, found.point, found.ended) == (0.0, -1, Ended.INTERRUPTED)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda m: JerkLimitedStop(m.limits, 0.0), "speed share 0 must be"),
        (lambda m: JerkLimitedStop(m.limits, math.nan), "speed share nan must be"),
        (lambda m: PathConsistentStop(m.limits, 1.1), "speed share 1.1 must be"),
        (lambda m: ConstantDeceleration(np.ones(2), np.array([1.0, 0.0])), "deceleration .* above zero"),
        (lambda m: ConstantDeceleration(np.array([1.0, math.inf]), np.ones(2)), "speed .* must be finite"),
        (lambda m: ConstantDeceleration(np.ones(2), np.ones(3)), "3 decelerations for 2 speeds"),
        (lambda m: ConstantDeceleration(np.ones(2), np.ones(2), -1.0), "delay of -1 s"),
        (lambda m: ConstantDeceleration(np.ones(3), np.ones(3)).worst(ArmSearch(m)), "3 joints, but there"),
    ],
)
def test_stops_that_make_no_sense_are_refused_in_one_line(make, said):
    model = arm("planar", np.random.default_rng(0))
    with pytest.raises(SetupError, match=said) as caught:
        make(model)
    assert "\n" not in str(caught.value)


def test_brackets_know_what_they_say():
    at = Witness(np.zeros(1), np.ones(1), np.array([3.0]))
    good = Bracket("q", "j", "m", 1.0, 2.0, at, "m", Ended.NARROW)
    assert good.gap == 0.5
    assert Bracket("q", "j", "m", 0.0, 0.0, None, "m", Ended.NARROW).gap == 0.0
    for lower, upper in ((2.0, 1.0), (-1.0, 1.0), (math.nan, 1.0), (0.0, math.nan)):
        with pytest.raises(SetupError, match="bracket of q, j"):
            Bracket("q", "j", "m", lower, upper, None, "m", Ended.NARROW)
    with pytest.raises(SetupError, match="no reason"):
        Bracket("q", "j", "m", 0.0, math.inf, None, "m", Ended.UNBOUNDED)
    assert AxisLimits(1.0, 2.0, 3.0).jerk == 3.0


def test_work_ends_at_its_deadline_and_not_before():
    now = [12.9]
    effort = Effort(clock=lambda: now[0], deadline_s=3.0)
    assert effort.end(10.0) is None and Effort(clock=lambda: now[0]).end(10.0) is None
    now[0] = 13.0
    assert effort.end(10.0) is Ended.DEADLINE
    assert replace(effort, should_end=lambda: True).end(10.0) is Ended.INTERRUPTED
    assert Effort().end(10.0) is None
