"""Looks for contacts in a verified cycle with the brute-force checker."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.oracles.brute_force import Allowed, chase, lean_towards, nearest_approach
from tests.oracles.situation import Approach, Contact, Motion
from tests.soundness.cells import STANDSTILL_M_S, Cell
from tests.soundness.executions import executions
from tests.soundness.trials import Trial
from verifier.verdict import Status, Verdict


@dataclass(frozen=True)
class Found:
    """The closest that anybody can come, in which execution of the plan, and the contact if it is one."""

    approach: Approach
    motion: Motion
    contact: Contact | None


def closest(trial: Trial, distance: float, rng: np.random.Generator, executed: int) -> Found | None:
    """Search the plan with the people at ``distance`` [m]; None if nothing moves.

    The arm executes it without error and with the longest delay, with the errors that lean towards whoever is
    closest then, and in ``executed`` further ways.
    """
    motions = executions(trial.cell, trial.plan, rng, executed)
    return closest_of(motions, trial.cell, distance, STANDSTILL_M_S)


def closest_of(
    motions: list[Motion], cell: Cell, distance: float, allowed: Allowed, below: float = np.inf
) -> Found | None:
    """Search some motions, and one that leans towards whoever is closest in the first.

    None if nothing is faster than ``allowed`` while somebody might come within ``below`` [m].
    """
    people = cell.known_to_checker(distance)
    best: tuple[Approach, Motion] | None = None
    motions = list(motions)
    for number, motion in enumerate(motions):
        bound = below if best is None else best[0].slack
        approach = nearest_approach(cell.arm, motion, people, allowed, below=bound)
        if approach is None:
            continue
        best = approach, motion
        if number == 0 and cell.error.any():
            lean = lean_towards(cell.arm, motion, approach, cell.error)
            motions.append(Motion(motion.time, motion.q + lean, motion.free))
    if best is None:
        return None
    approach, motion = best
    contact = chase(cell.arm, motion, people[approach.person], approach, allowed)
    if (contact is None) != (approach.slack > 1e-9):
        raise AssertionError(f"search and simulation of the checker disagree: {approach}, {contact}")
    return Found(approach, motion, contact)


def touches(cell: Cell, trial: Trial, distance: float) -> Approach | None:
    """The contact, if there is one, with the longest delay and no joint error."""
    motion, *_ = executions(cell, trial.plan, np.random.default_rng(0), 0)
    return nearest_approach(cell.arm, motion, cell.known_to_checker(distance), STANDSTILL_M_S, below=0.0)


def verified(verdict: Verdict) -> bool:
    """Whether the cycle may be executed."""
    return verdict.status is Status.VERIFIED


def describe(found: Found, cell: Cell, distance: float, where: str) -> str:
    """One contact, in words that allow to find it again."""
    approach = found.approach
    return (
        f"{where}: {cell.robot.name}, people at {distance!r} m: {approach.part.name} of person "
        f"{approach.person} reaches {approach.link} {approach.time - cell.t:.4f} s after the check, "
        f"{-approach.slack:.6f} m deep; simulated: {found.contact}"
    )
