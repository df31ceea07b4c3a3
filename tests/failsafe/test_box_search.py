"""Branch and bound: closed forms, a million random states of each arm, and every way in which it may end."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from failsafe import box_kernels
from failsafe.box_search import BoxSearch, arm_points
from failsafe.bracket import Bracket, Effort, Ended
from robots.catalog import RobotSetup, load_robot
from robots.enclosure import ENCLOSURE
from robots.errors import SetupError
from robots.limits import JointLimits
from robots.model import KINEMATICS, RobotModel
from robots.reach import reach
from tests.failsafe.arm_speeds import energies, extensions, fastest, speeds
from tests.occupancy.arms import ARMS, arm

CATALOGUE = ("ur3", "ur5", "ur10", "panda")
CHUNK = 5_000
ROUGH = Effort(gap=0.1)


@cache
def catalogue_arm(name: str):
    """An arm of the catalogue with a bare flange; always the same one."""
    return load_robot(name, setup=RobotSetup(bare_flange=True))


def random_states(rng, search: BoxSearch, number: int):
    """Random configurations in the box of the search, and random vertices of the speeds."""
    task = search.task[0]
    n = int(task["n"])
    q = rng.uniform(task["lower"][:n], task["upper"][:n], (number, n))
    return q, rng.choice([-1.0, 1.0], (number, n)) * task["speed"][:n]


def best_speed(rng, search: BoxSearch, number: int) -> float:
    """Largest speed of any point over random configurations, at the best vertex that alternation finds."""
    best = 0.0
    for done in range(0, number, CHUNK):
        q, dq = random_states(rng, search, min(CHUNK, number - done))
        speed = search.task[0]["speed"][: q.shape[1]]
        best = max(best, fastest(search.model, q, dq, search.points, speed))
    return best


def check(found, search: BoxSearch, seen: float) -> None:
    """The bound holds for what was seen, and the best value is the value of the state that is named."""
    assert seen <= found.bound
    assert found.best <= found.bound
    point = search.points[found.point]
    assert found.best == pytest.approx(
        speeds(search.model, found.q[None], found.dq[None], point)[0], rel=1e-9
    )
    assert (np.abs(found.dq) <= search.task[0]["speed"][: len(found.dq)] * (1.0 + 1e-12)).all()
    assert (found.q >= search.model.limits.position_lower - 1e-9).all()
    assert (found.q <= search.model.limits.position_upper + 1e-9).all()


@pytest.mark.parametrize("name", CATALOGUE)
def test_no_random_state_of_a_catalogue_arm_is_faster_than_its_bound(name, rng, count):
    model = catalogue_arm(name)
    search = BoxSearch(model, arm_points(model)[0], model.limits.velocity)
    found = search.run(Effort(gap=0.1, max_boxes=1 << 16) if name == "panda" else ROUGH)
    seen = best_speed(rng, search, count(1_000_000))
    check(found, search, seen)
    assert seen <= found.best * 1.001, "random states are faster than what was climbed to"
    assert seen > 0.6 * found.bound
    if name == "panda":
        assert found.ended is Ended.FULL and found.bound < 1.3 * found.best
    else:
        assert found.ended is Ended.NARROW and found.bound <= found.best / 0.9 * (1.0 + 1e-9)
    assert found.bound < search.reach_bound()


@pytest.mark.parametrize("name", ARMS)
def test_arms_of_every_kind(name, rng, count):
    for _ in range(count(100)):
        model = arm(name, rng)
        speed = rng.uniform(0.5, 3.0, len(model.joints))
        search = BoxSearch(model, arm_points(model)[0], speed)
        found = search.run(Effort(gap=0.2, max_boxes=1 << 15))
        check(found, search, best_speed(rng, search, 4_000))


def planar(radius: float = 0.05):
    """Two parallel axes, 0.4 m apart, capsules of 0.4 m."""
    model = arm("planar", np.random.default_rng(0))
    model.enclosure[0]["radius"][:2] = radius
    return model


def test_two_links_in_a_plane_have_a_closed_form():
    """Stretched, both turning the same way: V1 (0.8 + r) + V2 (0.4 + r)."""
    model, speed = planar(), np.array([1.5, 2.0])
    found = BoxSearch(model, arm_points(model)[0], speed).run(Effort(gap=0.005))
    exact = 1.5 * 0.85 + 2.0 * 0.45
    assert found.best == pytest.approx(exact, rel=1e-6)
    assert exact <= found.bound <= 1.006 * exact
    assert found.ended is Ended.NARROW


def test_speeds_of_different_signs_are_searched(monkeypatch):
    """Folded, a short second link adds to the speed when it turns the other way: V1 0.3 + V2 0.1.

    Without climbing first, which would find that state, and hide a bound that does not know it.
    """
    monkeypatch.setattr(BoxSearch, "_climb", lambda *_: None)
    model = planar(0.0)
    model.enclosure[0]["b"][1] = [0.1, 0.0, 0.0]
    folded = replace(
        model.limits, position_lower=np.array([-1.0, 3.0]), position_upper=np.array([1.0, math.tau - 3.0])
    )
    model = replace(model, limits=folded)
    exact = 1.5 * 0.3 + 2.0 * 0.1
    assert exact > 1.5 * 0.4, "faster than the elbow"
    found = BoxSearch(model, arm_points(model)[0], np.array([1.5, 2.0])).run(Effort(gap=0.005))
    assert exact <= found.bound <= 1.01 * exact


def test_a_bound_that_is_two_percent_too_small_is_noticed():
    """The checks of this file can fail: what is reached contradicts 0.98 times the bound."""
    model = planar()
    search = BoxSearch(model, arm_points(model)[0], np.array([1.5, 2.0]))
    found = search.run(Effort(gap=0.01))
    seen = best_speed(np.random.default_rng(1), search, 20_000)
    assert seen <= found.bound
    assert seen > 0.98 * found.bound
    with pytest.raises(SetupError, match=r"lower .* must be between 0 and upper"):
        Bracket("speed", "tip", "m/s", found.best, 0.98 * found.bound, None, "", Ended.NARROW)


def test_energy_of_two_links_in_a_plane():
    """Point masses at the ends, stretched, at full speed; by hand."""
    model, speed = planar(), np.array([1.5, 2.0])
    points = arm_points(model)[0]
    points["mass"] = [0.0, 2.0, 0.0, 3.0]
    search = BoxSearch(model, points, speed, energy=True)
    found = search.run(Effort(gap=0.01))
    exact = 0.5 * 2.0 * (1.5 * 0.4) ** 2 + 0.5 * 3.0 * (1.5 * 0.8 + 2.0 * 0.4) ** 2
    assert found.best == pytest.approx(exact, rel=1e-6)
    assert exact <= found.bound <= 1.02 * exact
    assert search.reach_bound() == pytest.approx(exact, rel=1e-6), "every point at its reach: exact here"


@pytest.mark.parametrize("name", ("scara", "six", "gantry"))
def test_no_random_state_has_more_energy_than_its_bound(name, rng, count):
    for _ in range(count(100)):
        model = arm(name, rng)
        points = arm_points(model)[0]
        points["mass"] = rng.uniform(0.1, 3.0, len(points))
        search = BoxSearch(model, points, rng.uniform(0.5, 3.0, len(model.joints)), energy=True)
        found = search.run(Effort(gap=0.3, max_boxes=1 << 15))
        q, dq = random_states(rng, search, 4_000)
        seen = energies(model, q, dq, points)
        assert seen.max() <= found.bound
        assert found.best == pytest.approx(
            energies(model, found.q[None], found.dq[None], points)[0], rel=1e-9
        )
        assert found.best >= 0.9 * seen.max()
        assert found.bound <= search.reach_bound()


@pytest.mark.parametrize("share", (0.33, 0.66))
def test_configurations_with_a_limited_extension(share, rng, count):
    model = catalogue_arm("ur5")
    points = arm_points(model)[0]
    largest = float(extensions(model, rng.uniform(-np.pi, np.pi, (20_000, 6)), points).max())
    limit = share * largest
    search = BoxSearch(model, points, model.limits.velocity, extension=limit)
    found = search.run(Effort(gap=0.2, max_boxes=1 << 14))
    everywhere = BoxSearch(model, points, model.limits.velocity).run(Effort(gap=0.2, max_boxes=1 << 14))
    assert extensions(model, found.q[None], points)[0] <= limit + 1e-12
    assert found.best < everywhere.best
    q, dq = random_states(rng, search, count(500_000))
    q = q[extensions(model, q, points) <= limit]
    assert len(q) > 20
    assert fastest(model, q, dq[: len(q)], points, model.limits.velocity) <= found.bound


def test_a_box_may_hold_admitted_configurations_although_its_centre_is_none(monkeypatch):
    """Two links in a plane, of which the second one alone decides how far the tip is: every angle of it.

    Without climbing first, which would hide a bound that has left some of them out.
    """
    monkeypatch.setattr(BoxSearch, "_climb", lambda *_: None)
    model, speed, limit = planar(), np.array([1.5, 2.0]), 0.5
    points = arm_points(model)[0]
    q = np.zeros((4_001, 2))
    q[:, 1] = np.linspace(-math.pi, math.pi, len(q))
    q = q[extensions(model, q, points) <= limit]
    seen = max(
        fastest(model, q, np.tile(signs * speed, (len(q), 1)), points, speed) for signs in ([1, 1], [1, -1])
    )
    found = BoxSearch(model, points, speed, extension=limit).run(Effort(gap=0.01))
    assert found.ended is Ended.NARROW
    assert seen <= found.bound <= 1.02 * seen
    assert found.best <= seen * (1.0 + 1e-3), "nor is anything found beyond the limit"
    assert extensions(model, found.q[None], points)[0] <= limit + 1e-12


def test_the_largest_bound_that_was_laid_aside_is_kept():
    """Of boxes near enough to the best value, and of one above it that has nothing to split."""
    nodes, state = np.zeros(3, dtype=box_kernels.NODES), np.zeros(1, dtype=box_kernels.STATE)
    heap, free = np.zeros(3, dtype=np.int64), np.zeros(3, dtype=np.int64)
    nodes["bound"], nodes["split"], state["best"], state["used"] = [1.004, 5.0, 1.002], [1, -1, 1], 1.0, 3
    for slot in range(3):
        box_kernels.keep(nodes, heap, free, slot, 1.01, state)
    assert (state["settled"][0], state["open"][0], state["free"][0]) == (5.0, 0, 3)


class Clock:
    """A clock that goes on by one second whenever it is looked at."""

    def __init__(self) -> None:
        self.t = 0.0

    def __call__(self) -> float:
        self.t += 1.0
        return self.t


def interrupt(*_: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("effort", "ended"),
    [
        (Effort(gap=1e-3, clock=Clock(), deadline_s=3.0), Ended.DEADLINE),
        (Effort(gap=1e-3, should_end=lambda: True), Ended.INTERRUPTED),
        (Effort(gap=1e-3, progress=interrupt), Ended.INTERRUPTED),
        (Effort(gap=1e-3, max_boxes=2), Ended.FULL),
    ],
)
def test_whatever_ends_the_search_leaves_a_bracket(effort, ended, rng):
    model = catalogue_arm("ur5")
    search = BoxSearch(model, arm_points(model)[0], model.limits.velocity)
    found = search.run(effort)
    assert found.ended is ended
    check(found, search, best_speed(rng, search, 2_000))
    assert 0.0 < found.best < found.bound < math.inf


def test_an_interrupt_before_the_first_box_leaves_the_closed_form(monkeypatch):
    model = planar()
    search = BoxSearch(model, arm_points(model)[0], np.ones(2))
    monkeypatch.setattr(search, "_climb", interrupt)
    found = search.run(ROUGH)
    assert (found.ended, found.best, found.point) == (Ended.INTERRUPTED, 0.0, -1)
    assert found.bound == search.reach_bound() == pytest.approx(0.85 + 0.45, rel=1e-6)


def test_an_interrupt_among_the_first_boxes_leaves_the_closed_form(monkeypatch):
    """What has been bounded by then says nothing about the others."""
    model = planar()
    search = BoxSearch(model, arm_points(model)[0], np.ones(2))
    for function in ("evaluate", "keep"):
        with monkeypatch.context() as patch:
            patch.setattr(box_kernels, function, interrupt)
            found = search.run(ROUGH)
        assert found.ended is Ended.INTERRUPTED and found.bound == search.reach_bound()


def test_a_small_table_bounds_what_a_large_one_does():
    """With a deadline: the same boxes in another order."""
    model = catalogue_arm("ur5e")
    search = BoxSearch(model, arm_points(model)[0], model.limits.velocity)
    large = search.run(ROUGH)
    small = search.run(Effort(gap=ROUGH.gap, max_boxes=2, clock=lambda: 0.0, deadline_s=1.0))
    assert len(search._nodes) == 1 << 14 < large.boxes / 10
    assert small.ended is large.ended is Ended.NARROW
    assert (small.best, small.bound, small.boxes) == (large.best, large.bound, large.boxes)


def test_what_is_laid_aside_to_make_room_counts_for_the_bound():
    model = catalogue_arm("ur5e")
    search = BoxSearch(model, arm_points(model)[0], model.limits.velocity)
    search._plant(search._roots(), 1e-3)
    state, nodes, heap, free = search._state, search._nodes, search._heap, search._free
    last, size, laid_aside = heap[int(state["open"][0]) - 1], int(state["open"][0]), int(state["free"][0])
    nodes["bound"][last], state["best"], state["settled"] = 7.0, 6.9, 0.0
    assert size > 1 and nodes["bound"][heap[0]] > 7.1
    more = box_kernels.expand(
        model.kinematics, search.points, search.task, nodes, heap, free, 1.02, 1, len(nodes), search._work,
        state,
    )  # fmt: skip
    assert more and (state["settled"][0], state["open"][0]) == (7.0, size - 1)
    assert state["free"][0] == laid_aside + 1 and free[laid_aside] == last


def test_a_full_table_and_a_deadline_give_the_gap_within_reach(rng):
    model = catalogue_arm("ur5e")
    search = BoxSearch(model, arm_points(model)[0], model.limits.velocity)
    without = search.run(Effort(gap=1e-3, max_boxes=2))
    found = search.run(Effort(gap=1e-3, max_boxes=2, clock=lambda: 0.0, deadline_s=1.0))
    assert found.ended is without.ended is Ended.FULL
    check(found, search, best_speed(rng, search, 20_000))
    reached, before = (1.0 - each.best / each.bound for each in (found, without))
    assert reached <= 0.1 and 0.6 * before < reached < 0.7 * before


def test_progress_is_told_and_only_narrows():
    model = catalogue_arm("ur3")
    told: list[tuple[str, float, float]] = []
    search = BoxSearch(model, arm_points(model)[0], model.limits.velocity)
    found = search.run(Effort(gap=0.1, progress=lambda *each: told.append(each)), "speed")
    assert len(told) > 3 and {name for name, _, _ in told} == {"speed"}
    lower, upper = np.array([each[1:] for each in told]).T
    assert (np.diff(lower) >= 0.0).all() and (np.diff(upper) <= 1e-12).all()
    assert found.bound <= upper[-1]


def test_too_many_joints_are_bounded_in_closed_form(rng):
    """15 joints have 2^14 vertices."""
    n = 15
    kinematics, enclosure = np.zeros(1, dtype=KINEMATICS), np.zeros(1, dtype=ENCLOSURE)
    tree = kinematics[0]
    tree["n"], tree["parent"][:n] = n, np.arange(-1, n - 1)
    tree["rotation"], tree["translation"][:n], tree["axis"] = np.eye(3), [0.1, 0.0, 0.0], [0.0, 0.0, 1.0]
    capsule = enclosure[0]
    capsule["n"], capsule["joint"][0], capsule["b"][0], capsule["radius"][0] = 1, n - 1, [0.1, 0, 0], 0.01
    ends = np.array([capsule["a"][0], capsule["b"][0]])
    limits = JointLimits(tuple(map(str, range(n))), *np.outer([-3.0, 3, 1, 1, 1, 1], np.ones(n)))
    capsule["reach"][0] = reach(kinematics, limits.position_lower, limits.position_upper, n - 1, ends)
    model = RobotModel("n", limits.joints, limits, kinematics, enclosure, ("l",), (), (), False, (), None)
    found = BoxSearch(model, arm_points(model)[0], np.ones(n)).run(ROUGH)
    assert found.ended is Ended.FULL
    assert found.best > 0.0
    assert found.bound == pytest.approx(0.1 * n * (n + 1) / 2 + 0.01 * n, rel=1e-6)


def test_a_joint_that_can_turn_round_is_searched_within_its_limits():
    """Its range is longer than a turn, and not about 0: what is named as the worst state is in it."""
    model = planar()
    lower, upper = np.array([1.0, 4.0]), np.array([8.0, 12.0])
    model = replace(model, limits=replace(model.limits, position_lower=lower, position_upper=upper))
    search = BoxSearch(model, arm_points(model)[0], np.array([1.5, 2.0]))
    low, high = search.task["lower"][0, :2], search.task["upper"][0, :2]
    assert (low >= lower).all() and (high <= upper).all()
    assert high - low == pytest.approx([math.tau, math.tau]), "a turn, so that nothing is left out"
    found = search.run(Effort(gap=0.01))
    check(found, search, 1.5 * 0.85 + 2.0 * 0.45 - 1e-6)


def test_what_cannot_be_searched_is_refused():
    model = planar()
    points = arm_points(model)[0]
    for speed in (np.array([1.0, -1.0]), np.array([1.0, math.nan]), np.array([1.0, math.inf]), np.ones(3)):
        with pytest.raises(SetupError, match="must be 2 finite numbers, none below zero"):
            BoxSearch(model, points, speed)
    with pytest.raises(SetupError, match="no point"):
        BoxSearch(model, points[:0], np.ones(2))
    sliding = arm("turn_then_slide", np.random.default_rng(0))
    object.__setattr__(sliding.limits, "position_upper", np.array([1.0, math.inf]))
    with pytest.raises(SetupError, match="joint joint_1 slides without end"):
        BoxSearch(sliding, arm_points(sliding)[0], np.ones(2))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"gap": 0.0}, "gap 0 must be"),
        ({"gap": 1.0}, "gap 1 must be"),
        ({"gap": math.nan}, "gap nan must be"),
        ({"deadline_s": 0.0, "clock": Clock()}, "deadline of 0 s"),
        ({"deadline_s": 1.0}, "a deadline needs a clock"),
        ({"max_boxes": 1}, "1 boxes are too few"),
    ],
)
def test_efforts_that_make_no_sense_are_refused(changes, said):
    with pytest.raises(SetupError, match=said):
        Effort(**changes)
