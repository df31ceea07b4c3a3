"""A number that is not finite, anywhere in what the cycle check reads, verifies nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from occupancy.swept import SweepError
from robots.motion import Block
from tests.soundness.cells import FAR_M, Bounds, Cell, random_cell
from tests.soundness.contacts import verified
from tests.soundness.persons import HANDS, Truth
from tests.soundness.trials import Trial
from verifier.criteria import Standstill
from verifier.cycle import Known
from verifier.verdict import Reason

BAD = (np.nan, np.inf, -np.inf)
NO_MATTER = {
    ("slices", "ddq"): BAD,
    ("slices", "dq"): BAD,
    ("slices", "dq_error"): (np.inf,),
    ("slices", "dq_spread"): (np.inf,),
    ("people", "v"): BAD,
    ("people", "e_v"): BAD,
    ("people", "t_obs"): (-np.inf,),
}
"""What the space that arm and people take up does not depend on: speeds at the ends of a slice only tell
whether a link moves, and one that cannot be compared does (tested below); ISO 13855 reads no velocities of
people; and what was seen an eternity ago is inferred from what was seen since."""


def whole(truth: Truth) -> Truth:
    """Everything seen once but hand and fingertip, so that every point is used."""
    seen = np.zeros((2, 20), dtype=bool)
    seen[1] = True
    seen[:, [p for hand in HANDS for p in hand[1:]]] = False
    return replace(truth, seen=seen)


@pytest.fixture
def trial(seed: int) -> tuple[Cell, Trial, Known]:
    """A cycle that is verified, with people far away and every joint moving."""
    for number in range(100):
        rng = np.random.default_rng([seed, number, 4])
        cell = random_cell(rng, Bounds(visibility=whole, legs=(True,), fitted=0.0, joint_space=0.0))
        trial = Trial(cell)
        if verified(trial.judge(FAR_M)):
            return cell, trial, trial.admit(FAR_M)
    raise AssertionError("no cycle is verified with people far away")


def entries(
    block: Block, used: Callable[[str, tuple[int, ...]], bool]
) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Every place of every field of floating-point numbers that is in use."""
    for name in block.dtype.names or ():
        if block[name].dtype.kind == "f":
            yield from ((name, index) for index in np.ndindex(block[name][0].shape) if used(name, index))


def test_bad_numbers_in_the_slices(trial: tuple[Cell, Trial, Known]) -> None:
    cell, each, known = trial
    slices = each.planner.slices
    n, joints = int(slices["n"][0]), int(slices["n_joints"][0])
    ends = ("t", "q", "dq", "ddq")

    def used(name: str, index: tuple[int, ...]) -> bool:
        if name in ("q_error", "dq_error"):
            return index[0] < joints
        if name == "delay":
            return True
        return index[0] < n + (name in ends) and all(i < joints for i in index[1:])

    def verdict() -> bool:
        return verified(each.check.check(cell.t, each.plan, slices, known))

    tried = try_all(slices, used, verdict, "slices")
    assert tried >= {"t", "delay", "q", "dq_max", "ddq_max", "q_error", "dq_error"}


def test_bad_numbers_in_the_people(trial: tuple[Cell, Trial, Known]) -> None:
    cell, each, known = trial
    people = known.people
    n = int(people["n"][0])

    def used(name: str, index: tuple[int, ...]) -> bool:
        if name in ("t_complete", "e_read"):
            return (
                False  # nobody is unlisted in these cells; e_read is what the next reading is compared with
            )
        if name in ("clock_error", "stamp_error"):
            return True
        return index[0] < n and bool(int(people["present"][0, index[0]]) >> index[1] & 1)

    def verdict() -> bool:
        return verified(each.check.check(cell.t, each.plan, each.planner.slices, known))

    tried = try_all(people, used, verdict, "people")
    assert tried >= {"clock_error", "stamp_error", "t_obs", "xyz", "e_p"}


@pytest.mark.parametrize("part", ["enclosure", "kinematics"])
def test_bad_numbers_in_the_arm(trial: tuple[Cell, Trial, Known], part: str) -> None:
    cell, each, known = trial
    robot = replace(
        cell.robot, enclosure=cell.robot.enclosure.copy(), kinematics=cell.robot.kinematics.copy()
    )
    block = getattr(robot, part)
    n = int(block["n"][0])

    def used(name: str, index: tuple[int, ...]) -> bool:
        return index[0] < n and (name != "reach" or index[1] <= robot.enclosure["joint"][0, index[0]])

    def verdict() -> bool:
        try:
            check = Trial(replace(cell, robot=robot)).check
        except SweepError:
            return False
        return verified(check.check(cell.t, each.plan, each.planner.slices, known))

    fields = {"enclosure": {"a", "b", "radius", "reach"}, "kinematics": {"rotation", "translation", "axis"}}
    assert try_all(block, used, verdict, part) >= fields[part]


def try_all(
    block: Block,
    used: Callable[[str, tuple[int, ...]], bool],
    verdict: Callable[[], bool],
    what: str,
) -> set[str]:
    """Put each bad number in each place in turn; return the fields that were tried."""
    assert verdict()
    tried = set()
    for name, index in entries(block, used):
        kept = float(block[name][(0, *index)])
        for bad in BAD:
            if bad in NO_MATTER.get((what, name), ()):
                continue
            tried.add(name)
            block[name][(0, *index)] = bad
            assert not verdict(), f"verified with {bad} in {name}{list(index)}"
        block[name][(0, *index)] = kept
    assert verdict()
    return tried


@pytest.mark.parametrize("speed", [np.nan, -np.inf, 0.0])
def test_a_link_whose_speed_cannot_be_compared_counts_as_moving(
    trial: tuple[Cell, Trial, Known], speed: float
) -> None:
    cell, each, _ = trial
    slices, n = each.planner.slices, int(each.planner.slices["n"][0])
    known = each.admit(0.0)
    each.check.settings = replace(each.check.settings, standstill=Standstill(1e3, 1e3))
    assert each.check.check(cell.t, each.plan, slices, known).reason is Reason.AT_REST
    for field in ("dq", "dq_error", "q_error"):
        kept = slices[field].copy()
        slices[field][0, n // 2 if field == "dq" else 0] = np.nan
        assert not verified(each.check.check(cell.t, each.plan, slices, known))
        slices[field] = kept
    for standstill in (Standstill(speed, 1e3), Standstill(1e3, min(speed, -1e-9))):
        each.check.settings = replace(each.check.settings, standstill=standstill)
        assert not verified(each.check.check(cell.t, each.plan, slices, known))


def test_a_plan_without_slices_verifies_nothing(trial: tuple[Cell, Trial, Known]) -> None:
    cell, each, known = trial
    for empty in (0, -1):
        each.planner.slices["n"] = empty
        assert not verified(each.check.check(cell.t, each.plan, each.planner.slices, known))


def test_an_arm_without_links_verifies_nothing(trial: tuple[Cell, Trial, Known]) -> None:
    cell, each, known = trial
    bare = cell.robot.enclosure.copy()
    bare["n"] = 0
    try:
        each.check = Trial(replace(cell, robot=replace(cell.robot, enclosure=bare, links=()))).check
    except SweepError:
        return
    assert not verified(each.check.check(cell.t, each.plan, each.planner.slices, known))


def test_nothing_known_verifies_nothing(trial: tuple[Cell, Trial, Known]) -> None:
    cell, each, known = trial
    nothing = known.people.copy()
    nothing["n"] = 0
    for reported, since in ((False, cell.t), (True, -np.inf), (True, np.nan), (True, cell.t - 10.0)):
        absent = known._replace(people=nothing, reported=reported, nobody_since=since)
        answer = each.check.check(cell.t, each.plan, each.planner.slices, absent)
        assert not verified(answer), f"verified with reported={reported}, nobody_since={since}"
    unseen = known.people.copy()
    unseen["present"][0, 0] = 0
    for less in (
        known._replace(people=unseen),
        known._replace(inconsistent=True),
        known._replace(overflow=True),
    ):
        assert not verified(each.check.check(cell.t, each.plan, each.planner.slices, less))
