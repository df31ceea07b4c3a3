"""What power and force limiting lets pass, by brute force: nobody is touched too fast, nothing is clamped.

In every random cell some links may touch some parts. People are moved into the arm as far as the verifier
lets them. There the plan is executed in several ways, and people who obey the assumptions try to touch a link
that is faster than it may be there; and links that somebody can touch must keep the gap that the part needs,
to fixtures and other links, on the whole plan.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
import pytest

from failsafe.plan import PlanResult
from occupancy.body import Part
from robots.motion import Block
from tests.oracles.arms import ARMS
from tests.oracles.clamping import Narrow, Surroundings, touched
from tests.oracles.situation import Motion
from tests.soundness.cells import STANDSTILL_M_S, brute_arm, robot_model
from tests.soundness.contact_cells import (
    SLOW,
    TRUE_LIMITS,
    ContactBounds,
    ContactCell,
    Declared,
    bundled,
    gaps,
    random_contact_cell,
    row_of,
)
from tests.soundness.contacts import closest_of, describe, verified
from tests.soundness.executions import executions, hurried
from tests.soundness.trials import Alteration, Trial, Unaltered, closest_verified
from verifier.verdict import Reason

CELLS = 300
HALVINGS, FEW_HALVINGS = 11, 8
NEAR_M = 0.1
EVERY = 8
"""Every so manieth instant is looked at for what somebody touches."""
INSTANTS = 6
"""Instants at which gaps are measured."""
MANY = 100
CONTACT = Reason.CONTACT_WITHIN_LIMITS.name
SHARES = {CONTACT: 0.2, "touched": 0.08, "too fast and near": 0.1}
"""Least shares of so many cells. *touched*: a link that moves can touch a part that it may; *too fast and
near*: somebody comes within ``NEAR_M`` of a link that is too fast to be touched."""


def ways(trial: Trial, rng: np.random.Generator, number: int) -> list[Motion]:
    """How the arm may execute the plan without a joint that is faster than its velocity error allows.

    Without error, in ``number`` other ways, some of which may be stops by itself, and in a hurry.
    """
    first, *others = executions(trial.cell, trial.plan, rng, number, drifting=0.0)
    chosen = rng.permutation(len(others))[:number]
    return [first, *(others[k] for k in chosen), hurried(trial.cell, trial.plan, rng)]


def clampings(given: ContactCell, motions: list[Motion], distance: float) -> tuple[list[Narrow], int]:
    """Gaps of links beside a declared part that can touch them, narrower than it needs; and how many touch.

    The gaps are those of the first motion and of another: the plan is the same.
    """
    cell, found = given.cell, []
    people, rules = cell.known_to_checker(distance), given.declared.rules
    touching = touched(cell.arm, motions[0], people, STANDSTILL_M_S, EVERY)
    needed: dict[str, float] = {}
    for link, part in touching:
        if any(part in rule.parts for rule in rules):
            needed[link] = max(needed.get(link, 0.0), TRUE_LIMITS.gap(part))
    for link, gap in needed.items():
        for motion in (motions[0], motions[-1]):
            samples = np.linspace(0, len(motion.time) - 1, INSTANTS).astype(np.int64)
            nearest = gaps(cell.arm).narrowest(
                motion, link, given.declared.surroundings, given.others(link), samples
            )
            if nearest.gap < gap:
                found.append(nearest)
    return found, len(needed)


@pytest.mark.parametrize("name", ARMS)
def test_contact_in_a_verified_cycle_is_slow_and_clamps_nobody(
    name: str, count: Callable[[int], int], seed: int, record_property: Callable[[str, object], None]
) -> None:
    judged: Counter[str] = Counter()
    bounds = ContactBounds(replace(SLOW, robots=(name,)))
    cells = max(10, count(600))
    for number in range(cells):
        where = f"cell {number} of seed {seed}"
        rng = np.random.default_rng([seed, number, *name.encode()])
        given = random_contact_cell(rng, bounds)
        trial = Trial(given.cell, contact=given.declared.criterion(given.cell.robot))
        nearest = closest_verified(trial, HALVINGS)
        if nearest is None:
            judged["never verified"] += 1
            continue
        verdict = trial.judge(nearest)
        judged[verdict.reason.name] += 1
        motions = ways(trial, rng, 2)
        narrow, touching = clampings(given, motions, nearest)
        assert not narrow, f"{where}, people at {nearest} m: {narrow}"
        judged["touched"] += touching > 0
        below = float(np.fmax(NEAR_M, verdict.gap_m))
        found = closest_of(motions, given.cell, nearest, given.allowed(), below)
        if found is not None:
            assert found.contact is None, describe(found, given.cell, nearest, where)
            slack = found.approach.slack
            assert not verdict.gap_m > slack + 1e-6, f"{where}: gap {verdict.gap_m} m is above {slack} m"
            judged["too fast and near"] += slack < NEAR_M
    record_property("judged", dict(judged))
    print(f"\n{name}: {cells} cells, {dict(judged)}")
    assert judged["never verified"] < 0.1 * cells + 1
    for what, share in SHARES.items():
        assert judged[what] > share * cells or cells < MANY, f"vacuous: too few cells are {what}"
    assert judged[CONTACT] > 0 and judged["touched"] + judged["too fast and near"] > 0, "vacuous"


def test_both_read_the_same_limits_from_the_file() -> None:
    """Written twice, apart from each other."""
    for part in Part:
        name = part.name.lower()
        assert TRUE_LIMITS.gap(name) == bundled().gap(part)
        for mass in (math.inf, 10.0, 3.0):
            assert TRUE_LIMITS.speed(name, mass) == pytest.approx(max(bundled().speed(part, mass), 0.0))


@pytest.mark.parametrize("name", ARMS)
def test_capsules_that_stand_for_two_links_say_so(name: str) -> None:
    arm, robot = brute_arm(name, False), robot_model(name, False)
    assert {row_of(link) for link in arm.links} == set(robot.links)
    for link in set(arm.links) - set(robot.links):
        said = [item.source for item in robot.assumptions if f".{row_of(link)}." in item.name]
        assert any(source.endswith(f"; with {link}") for source in said), said


class NoVelocityError(Unaltered):
    """Joints are believed to be exactly as fast as they are commanded."""

    def slices(self, slices: Block, plan: PlanResult) -> None:
        slices["dq_error"] = 0.0


def scaled(given: ContactCell, name: str, factor: float) -> Declared:
    """Numbers whose place in the file contains ``name`` are ``factor`` times as large."""
    limits = given.declared.limits
    numbers = {
        place: replace(item, value=factor * float(item.value)) if name in place else item
        for place, item in limits.numbers.items()
    }
    return replace(given.declared, limits=replace(limits, numbers=numbers))


def ruled(given: ContactCell, **changes: Any) -> Declared:
    """Every rule is changed in the same way."""
    return replace(given.declared, rules=tuple(replace(rule, **changes) for rule in given.declared.rules))


def no_gaps_in_the_arm(given: ContactCell) -> Declared:
    return replace(given.declared, by_design=tuple(combinations(given.cell.robot.links, 2)))


def nothing_around(given: ContactCell) -> Declared:
    return replace(given.declared, surroundings=Surroundings(-10.0, {}))


EXACT_CELL = replace(
    SLOW,
    latency_s=(0.0, 0.02),
    delay_s=(0.0, 0.0),
    q_error=(0.0, 0.0),
    dq_error=(0.0,),
    error_m=(0.0, 0.0),
    clock_s=(0.0, 0.0),
    fitted=0.0,
    silence=0.0,
    people=(1,),
)
"""Cells in which little but what is left out gives the verifier room."""
EXACT = ContactBounds(EXACT_CELL)


@dataclass(frozen=True)
class Ablation:
    """What the verifier is told instead of the truth; whether that clamps somebody, or touches too fast."""

    believed: Callable[[ContactCell], Declared]
    clamps: bool = False
    bounds: ContactBounds = EXACT
    alteration: Alteration | None = None


TOUCHABLE = tuple(part.name.lower() for part in Part if TRUE_LIMITS.speed(part.name.lower()) > 0.0)
ABLATIONS = {
    "forces doubled": Ablation(lambda given: scaled(given, ".force", 2.0)),
    "gaps left out": Ablation(lambda given: scaled(given, "gap.", 0.0), clamps=True),
    "more parts": Ablation(lambda given: ruled(given, parts=TOUCHABLE)),
    "more links": Ablation(lambda given: ruled(given, links=given.cell.robot.links)),
    "person's speed forgotten": Ablation(
        lambda given: ruled(given, person_speed=0.0), bounds=replace(EXACT, added=1.0)
    ),
    "a light robot": Ablation(lambda given: ruled(given, robot_mass=1.0)),
    "gaps in the arm left out": Ablation(
        no_gaps_in_the_arm, clamps=True, bounds=replace(EXACT, by_design=(0.0,))
    ),
    "fixtures left out": Ablation(nothing_around, clamps=True, bounds=replace(EXACT, beside=1.0)),
    "velocity error ignored": Ablation(
        lambda given: given.declared,
        bounds=ContactBounds(replace(EXACT_CELL, dq_error=(0.6,), q_error=(0.02, 0.04))),
        alteration=NoVelocityError(),
    ),
}


@pytest.mark.parametrize("name", ABLATIONS)
def test_leaving_something_out_lets_somebody_be_hurt(
    name: str, seed: int, record_property: Callable[[str, object], None]
) -> None:
    ablation = ABLATIONS[name]
    for number in range(CELLS):
        rng = np.random.default_rng([seed, number, *name.encode()])
        given = random_contact_cell(rng, ablation.bounds)
        robot = given.cell.robot
        weakened = Trial(given.cell, ablation.alteration, ablation.believed(given).criterion(robot))
        distance = closest_verified(weakened, FEW_HALVINGS)
        whole = Trial(given.cell, contact=given.declared.criterion(robot))
        if distance is None or verified(whole.judge(distance)):
            continue
        if hurt(given, ways(weakened, rng, 1), distance, clamped=ablation.clamps):
            record_property("cell", number)
            print(f"\n{name}: cell {number} of seed {seed}, people at {distance} m")
            return
    pytest.fail(
        f"{name}: nothing found in {CELLS} cells; the tests would not notice if the verifier left it out"
    )


def hurt(given: ContactCell, motions: list[Motion], distance: float, *, clamped: bool) -> bool:
    """Whether somebody is clamped, or touched too fast."""
    if clamped:
        return bool(clampings(given, motions, distance)[0])
    found = closest_of(motions, given.cell, distance, given.allowed())
    return found is not None and found.contact is not None
