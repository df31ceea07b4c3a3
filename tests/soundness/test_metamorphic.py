"""Laws that hold between two answers of the cycle check, whatever the right answer is.

More speed, error, size, latency or delay with the same measurement never proves an obligation that was open
before: compared bit by bit, in every slice up to the first that stays open in the milder case (later slices
are not worked on there). Rotations about the first axis, shifts in time and the order of people change
nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from failsafe.trajectory import IntendedTrajectory
from occupancy.body import Point, Profile
from occupancy.humans.iso13855 import Iso13855
from occupancy.humans.model import Occupancy
from robots.motion import Block
from tests.oracles.arms import MESH_ARMS
from tests.soundness.cells import Bounds, Cell, human_model, random_cell
from tests.soundness.contacts import verified
from tests.soundness.persons import HANDS, TRUNK, Truth
from tests.soundness.trials import Trial, closest_verified
from verifier.cycle import CycleCheck
from verifier.verdict import Verdict

Open = NDArray[np.uint32]
EARLY, LATE = 0.98, 1.01
"""People stand this many times as far away as where the verdict changes."""


@dataclass
class Answer:
    """A verdict and what stayed open (S, L, K)."""

    verdict: Verdict
    open: Open
    first: int

    @classmethod
    def of(cls, verdict: Verdict, check: CycleCheck) -> Answer:
        book = check.ledger[0]
        left = book["open"][: book["n_slices"], : book["n_links"], : book["n_people"]].copy()
        slices = np.flatnonzero(left.any(axis=(1, 2)))
        return cls(verdict, left, int(slices[0]) if len(slices) else len(left))


def near(rng: np.random.Generator, bounds: Bounds | None = None) -> tuple[Cell, float]:
    """A cell and a distance of the people on either side of where the verdict changes."""
    while True:
        cell = random_cell(rng, bounds)
        distance = closest_verified(Trial(cell), 9)
        if distance is not None:
            return cell, distance * float(rng.choice([0.6, EARLY, LATE]))


def answer(
    cell: Cell,
    distance: float,
    *,
    slices: Callable[[Block], None] | None = None,
    people: Callable[[Block], None] | None = None,
    model: Iso13855 | None = None,
) -> Answer:
    trial = Trial(cell)
    known = trial.admit(distance)
    if slices is not None:
        slices(trial.planner.slices)
    if people is not None:
        people(known.people)
    if model is not None:
        trial.check.occupancies = (Occupancy(model),)
    return Answer.of(trial.check.check(cell.t, trial.plan, trial.planner.slices, known), trial.check)


def add(block: Block, name: str, amount: object) -> None:
    block[name] = block[name] + amount


def larger(profile: Profile, by: float) -> Profile:
    return replace(profile, radius=profile.radius + by)


def faster(cell: Cell) -> Iso13855:
    speed = 1.1 * float(cell.profile.speed.max())
    return Iso13855(cell.profile, approach_speed=speed, held_object_m=cell.held)


def later_end(slices: Block) -> None:
    slices["delay"][0, 1] += 0.03


def older(people: Block) -> None:
    people["t_obs"] -= 0.04


def less_exact(people: Block) -> None:
    people["stamp_error"] += 0.02
    people["t_obs"] -= 0.02


HARSHER: dict[str, Callable[[Cell, float], Answer]] = {
    "speed": lambda c, d: answer(c, d, model=faster(c)),
    "radius": lambda c, d: answer(c, d, model=Iso13855(larger(c.profile, 0.03), held_object_m=c.held)),
    "held object": lambda c, d: answer(c, d, model=human_model(c.profile, c.held + 0.05)),
    "position error": lambda c, d: answer(c, d, people=lambda block: add(block, "e_p", 0.03)),
    "latency": lambda c, d: answer(c, d, people=older),
    "clock error": lambda c, d: answer(c, d, people=lambda block: add(block, "clock_error", 0.02)),
    "stamp error": lambda c, d: answer(c, d, people=less_exact),
    "joint error": lambda c, d: answer(c, d, slices=lambda block: add(block, "q_error", 0.01)),
    "joint velocity error": lambda c, d: answer(c, d, slices=lambda block: add(block, "dq_error", 0.05)),
    "delay": lambda c, d: answer(c, d, slices=later_end),
    "acceleration": lambda c, d: answer(c, d, slices=lambda block: add(block, "ddq_max", 5.0)),
}


def never_proves_more(milder: Answer, harsher: Answer, what: str, *, any_part: bool = False) -> None:
    """Nothing that was open is proven; ``any_part``: no person of whom some part was open is proven whole."""
    assert verified(milder.verdict) or not verified(harsher.verdict), f"{what} verifies a cycle"
    shared = min(milder.first + 1, len(milder.open))
    before, after = milder.open[:shared], harsher.open[:shared]
    newly = (before != 0) & (after == 0) if any_part else before & ~after
    assert not newly.any(), f"{what} proves {np.argwhere(newly)[0]} in (slice, link, person)"


@pytest.mark.parametrize("what", HARSHER)
def test_more_of_it_never_verifies_more(what: str, seed: int, count: Callable[[int], int]) -> None:
    changed = refused = 0
    for number in range(count(2_000)):
        cell, distance = near(np.random.default_rng([seed, number, *what.encode()]))
        milder, harsher = answer(cell, distance), HARSHER[what](cell, distance)
        never_proves_more(milder, harsher, f"cell {number} of seed {seed}: more {what}")
        refused += verified(milder.verdict) and not verified(harsher.verdict)
        changed += int((milder.open != harsher.open).any()) if milder.open.shape == harsher.open.shape else 1
    print(f"\n{what}: {changed} answers changed, {refused} no longer verified")
    assert changed > 0, "vacuous: no answer depends on it"


def straight_and_exact(truth: Truth) -> Truth:
    """Every point but those of the hands behind the wrist seen once, exactly, all believed alike; a straight
    trunk."""
    points = truth.points.copy()
    pelvis, thorax, neck, head = (points[p] for p in TRUNK)
    up = (neck - pelvis) / np.linalg.norm(neck - pelvis)
    points[Point.THORAX] = pelvis + up * min(
        np.linalg.norm(thorax - pelvis), 0.6 * np.linalg.norm(neck - pelvis)
    )
    points[Point.HEAD] = neck + up * np.linalg.norm(head - neck)
    seen = np.ones((2, 20), dtype=bool)
    seen[0] = False
    seen[:, [p for hand in HANDS for p in hand[1:]]] = False
    alike = np.full(20, truth.bounds.max())
    return replace(truth, points=points, errors=np.zeros((2, 20, 3)), seen=seen, bounds=alike)


def test_a_point_less_never_verifies_more(seed: int, count: Callable[[int], int]) -> None:
    """Parts of which a point is missing are inferred from the others, and take at least the room they took.

    That holds for points at their true places on bodies of the profile's sizes: the inferred set contains
    every such body. It does not for points that measuring has put farther apart than any limb is long, nor
    for the inner points of a bent trunk and the points of a hand, where the model takes one shape for another
    of the same size, nor for points that are believed to different errors: a row grows with its worst point,
    so that without it less may be left. Persons are compared, not parts: one row for head and trunk becomes a
    smaller one for the trunk and a larger one for the head.
    """
    changed = 0
    for number in range(count(2_000)):
        rng = np.random.default_rng([seed, number, 77])
        cell, distance = near(rng, Bounds(visibility=straight_and_exact))
        milder = answer(cell, distance)
        gone, who = (
            int(rng.choice(np.flatnonzero(cell.people[0].seen[1]))),
            int(rng.integers(len(cell.people))),
        )
        truth = cell.people[who]
        seen = truth.seen.copy()
        seen[:, gone] = False
        people = (*cell.people[:who], replace(truth, seen=seen), *cell.people[who + 1 :])
        harsher = answer(replace(cell, people=people), distance)
        never_proves_more(
            milder, harsher, f"cell {number} of seed {seed}: {Point(gone).name} missing", any_part=True
        )
        changed += int((milder.open != harsher.open).any())
    assert changed > 0, "vacuous: no answer depends on it"


def same(one: Answer, other: Answer, what: str) -> None:
    assert one.verdict.reason is other.verdict.reason, what
    assert one.verdict.gap_m == pytest.approx(other.verdict.gap_m, abs=1e-7), what
    np.testing.assert_array_equal(one.open[: one.first + 1], other.open[: other.first + 1], err_msg=what)


def test_turning_first_joint_and_people_together_changes_nothing(
    seed: int, count: Callable[[int], int]
) -> None:
    reasons = set()
    for number in range(count(2_000)):
        rng = np.random.default_rng([seed, number, 78])
        cell, distance = near(rng, Bounds(robots=MESH_ARMS, mounted=0.0))
        cell = replace(cell, settings=replace(cell.settings, check_position_limits=False))
        angle = float(rng.uniform(-np.pi, np.pi))
        turn = np.array(
            [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
        )
        coefficients = cell.trajectory.coefficients.copy()
        coefficients[:, 0, 0] += angle
        turned = replace(
            cell,
            trajectory=IntendedTrajectory(cell.trajectory.breaks, coefficients),
            people=tuple(truth.turned(turn) for truth in cell.people),
            places=cell.places @ turn.T,
            ways=cell.ways @ turn.T,
        )
        one = answer(cell, distance)
        same(one, answer(turned, distance), f"cell {number} of seed {seed}")
        reasons.add(one.verdict.reason.name)
    assert {"SEPARATED", "REACHABLE"} <= reasons


def test_the_order_of_people_changes_nothing(seed: int, count: Callable[[int], int]) -> None:
    for number in range(count(2_000)):
        rng = np.random.default_rng([seed, number, 79])
        cell, distance = near(rng, Bounds(people=(2, 3)))
        order = rng.permutation(len(cell.people))
        other = replace(
            cell,
            people=tuple(cell.people[i] for i in order),
            places=cell.places[order],
            ways=cell.ways[order],
        )
        trials = Trial(cell), Trial(other)
        answers = [Answer.of(trial.judge(distance), trial.check) for trial in trials]
        columns = [
            [ids.index(truth.name) for truth in cell.people] for ids in (t.gate.person_ids for t in trials)
        ]
        for each, permuted in zip(answers, columns, strict=True):
            each.open = each.open[:, :, permuted] if each.open.shape[2] else each.open
        same(*answers, f"cell {number} of seed {seed}")


def test_the_epoch_of_the_clock_changes_nothing(seed: int, count: Callable[[int], int]) -> None:
    for number in range(count(2_000)):
        rng = np.random.default_rng([seed, number, 80])
        cell, distance = near(rng)
        by = float(rng.uniform(-1e3, 1e3))
        stamps = cell.stamps[0] + by, cell.stamps[1] + by
        later = replace(cell, t=cell.t + by, stamps=stamps)
        same(answer(cell, distance), answer(later, distance), f"cell {number} of seed {seed}")


def test_nobody_reported_again_is_nobody_gone(seed: int) -> None:
    """A person of whom nothing is said any more keeps growing: the same report is refused when it is old."""
    cell, distance = near(np.random.default_rng(seed))
    trial = Trial(cell)
    known = trial.admit(3.0 * distance)
    old = known._replace(people=known.people.copy())
    old.people["t_obs"] -= 60.0
    assert not verified(trial.check.check(cell.t, trial.plan, trial.planner.slices, old))
