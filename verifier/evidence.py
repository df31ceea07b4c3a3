"""Evidence for a verdict: which pair decided, and where the metres go."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from operator import or_

import numpy as np
from numpy.typing import NDArray

from occupancy.body import Part
from occupancy.humans.model import HumanModel, Occupancy
from occupancy.humans.options import HANDS, SEGMENTS
from occupancy.humans.unobserved import UNOBSERVED, UnobservedSpace
from occupancy.ledger_kernels import count_people
from occupancy.separation import Nearest
from robots.motion import Block
from verifier.criteria import Scene
from verifier.cycle import CycleCheck
from verifier.verdict import Budget, CriterionKind, Witness

WHOLE_BODY = "whole body"
"""Stands in witnesses for the part of somebody whom nobody lists."""


@dataclass(frozen=True, slots=True)
class Judged:
    """What a cycle was judged with.

    Attributes
    ----------
    t:
        Instant t_k of the cycle [s].
    slices, people:
        The blocks that its check was given.
    ids:
        Person ids by the index in the people block.
    margin_m:
        What a gap must exceed [m].
    """

    t: float
    slices: Block
    people: Block
    ids: tuple[str, ...]
    margin_m: float


def deepest(check: CycleCheck, cycle: Judged) -> Nearest | None:
    """Return the blocking pair of the slice with the smallest gap of the last ``check.check(…)``.

    A check ends at the first slice that stays open; what would have to be gained until every slice is proven
    shows only in the worst one. ``None``: every slice is proven, or no pair was compared.
    """
    scene = check.scene(cycle.slices, cycle.people)
    book, worst = check.ledger[0], None
    check.open_obligations(cycle.slices, count_people(cycle.people)[1])
    if check.contact is not None:
        check.contact.clear(scene, check.ledger)
    opened = book["open"].copy()
    for i in range(int(book["n_slices"])):
        book["open"][...] = 0
        book["open"][i] = opened[i]
        for criterion in check.criteria:
            found = criterion.check(scene, check.ledger)
            if not found.separated and (worst is None or found.gap_m < worst.gap_m):
                worst = found
    return worst


def witness(check: CycleCheck, cycle: Judged, nearest: Nearest | None) -> Witness | None:
    """Describe the pair ``nearest`` of the last ``check.check(…)``; ``None`` if it compared no pair."""
    if nearest is None or nearest.slice < 0:
        return None
    t, slices, people, ids = cycle.t, cycle.slices, cycle.people, cycle.ids
    i, k = nearest.slice, nearest.person
    known = nearest.people_row >= 0
    listed = k < int(people["n"][0])
    lacking = 0 if listed else -1
    occupancy = check.occupancies[nearest.model if known else lacking]
    model = occupancy.model
    nan = math.nan
    points = (_triple(nearest.link_point), _triple(nearest.people_point))
    parts = int(occupancy.sets["covers"][0, nearest.people_row]) if known else nearest.parts
    unsaid = 0 if known or not listed else parts & ~_said(check)
    budget = (
        (_budget if listed else _front_budget)(check, occupancy, nearest, cycle)
        if known
        else Budget(nan, nan, nan, nan, cycle.margin_m, nan, nan)
    )
    inferred = listed and model.inferred_parts(int(people["present"][0, k]), people["t_obs"][0, k]) & parts
    return Witness(
        cycle_t=t,
        slice=(float(slices["t"][0, i]), float(slices["t"][0, i + 1])),
        link=check.robot.links[nearest.link],
        person=ids[int(people["person"][0, k])] if listed else UNOBSERVED,
        part=part_names(unsaid or parts) if listed else WHOLE_BODY,
        gap_m=nearest.gap_m,
        points=points,
        criterion=CriterionKind.SEPARATION.name.lower(),
        model=model.name,
        inferred=bool(inferred),
        age_s=_age(people[0], k, parts, t) if listed else math.nan,
        budget=budget,
        silent_models=tuple(each.model.name for each in check.occupancies) if unsaid else (),
        no_contact=_why_no_contact(check, cycle, nearest, parts) if listed else "",
    )


def robot_witness(check: CycleCheck, cycle: Judged) -> Witness | None:
    """Describe what the last ``check.check(…)`` found about the robot alone; ``None``: nothing."""
    found, rule = check.blocked, check.blocked_by
    if found is None or rule is None:
        return None
    i, slices, robot = found.slice, cycle.slices, check.robot
    row = i * int(robot.enclosure["n"][0]) + found.link
    link = float(robot.enclosure["radius"][0, found.link])
    swept = float(check.links["radius"][0, row])
    body, error = rule.terms(found, link, swept)
    return Witness(
        cycle_t=cycle.t,
        slice=(float(slices["t"][0, i]), float(slices["t"][0, i + 1])),
        link=robot.links[found.link],
        person="",
        part="",
        gap_m=found.gap_m,
        points=(_triple(found.link_point), _triple(found.other_point)),
        criterion=rule.kind.name.lower(),
        model="",
        inferred=False,
        age_s=math.nan,
        budget=Budget(0.0, 0.0, error, body, rule.margin_m, found.gap_m + link + body + error, link),
        other=found.other,
    )


def _why_no_contact(check: CycleCheck, cycle: Judged, nearest: Nearest, parts: int) -> str:
    """Say why the pair may not touch, where the cell declares that it may."""
    if check.contact is None:
        return ""
    scene = Scene(cycle.slices, check.links, cycle.people, check.occupancies)
    return check.contact.why_not(scene, nearest.link, parts)


def _said(check: CycleCheck) -> int:
    """Mask of the parts of somebody listed of which some model says something, given the right points."""
    models = (occupancy.model for occupancy in check.occupancies)
    return reduce(or_, (model.proves for model in models if not isinstance(model, UnobservedSpace)), 0)


def _age(people: np.void, k: int, parts: int, t: float) -> float:
    """Age [s] at ``t`` of the oldest part's own points in row k; of the newest point where none was seen."""
    seen: NDArray[np.float64] = people["t_obs"][k]
    oldest = []
    for part in (part for part in Part if parts >> part & 1):
        own = seen[list(HANDS.get(part, SEGMENTS[part]))]
        if np.isfinite(own).any():
            newest_matters = part in HANDS
            oldest.append(float(np.nanmax(own) if newest_matters else np.nanmin(own)))
    if not oldest:
        oldest = [max(filter(math.isfinite, seen.tolist()), default=math.nan)]
    return t - min(oldest) - float(people["stamp_error"])


def part_names(mask: int) -> str:
    """Return the names of the parts in a mask, joined by ``+``."""
    return "+".join(part.name.lower() for part in Part if mask >> part & 1)


def _budget(check: CycleCheck, occupancy: Occupancy, nearest: Nearest, cycle: Judged) -> Budget:
    """Split the gap into its terms by leaving them out one after the other.

    The person's row is rebuilt with the errors with which it was read, as if nobody could have exchanged left
    and right; without position error; then as if it had been observed at the decision, then at the end of
    the slice. Each difference of radii is one term, whatever the model's formula is.
    """
    i, row, slices, people = nearest.slice, nearest.people_row, cycle.slices, cycle.people
    model = occupancy.model
    end = float(slices["t"][0, i + 1]) + float(slices["delay"][0, 1])
    full = float(occupancy.sets["radius"][0, row])
    exact = people.copy()
    exact["e_p"] = np.fmin(people["e_p"], people["e_read"])
    as_read = _radius(model, exact, slices, row)
    exact["e_p"] = 0.0
    without_error = _radius(model, exact, slices, row)
    exact["clock_error"] = exact["stamp_error"] = 0.0
    exact["t_obs"] = np.where(np.isnan(exact["t_obs"]), np.nan, cycle.t)
    fresh = _radius(model, exact, slices, row)
    exact["t_obs"] = np.where(np.isnan(exact["t_obs"]), np.nan, end)
    instant = slices.copy()
    instant["t"][0, i : i + 2], instant["delay"] = end, 0.0
    body = _radius(model, exact, instant, row)
    link = float(check.robot.enclosure["radius"][0, nearest.link])
    n_links = int(check.robot.enclosure["n"][0])
    swept = float(check.links["radius"][0, i * n_links + nearest.link])
    return Budget(
        latency=without_error - fresh,
        stop=fresh - body,
        error=(as_read - without_error) + (swept - link),
        body=body,
        margin=cycle.margin_m,
        distance=nearest.gap_m + full + swept,
        link=link,
        sides=full - as_read,
    )


def _front_budget(check: CycleCheck, occupancy: Occupancy, nearest: Nearest, cycle: Judged) -> Budget:
    """Split the gap from the unobserved space: the front grows by its speed from the last complete report."""
    i, slices = nearest.slice, cycle.slices
    full = float(occupancy.sets["radius"][0, nearest.people_row])
    speed = float(occupancy.sets["speed_max"][0, nearest.people_row])
    stop = speed * (float(slices["t"][0, i + 1]) + float(slices["delay"][0, 1]) - cycle.t)
    error = _boundary_error(occupancy.model)
    link = float(check.robot.enclosure["radius"][0, nearest.link])
    n_links = int(check.robot.enclosure["n"][0])
    swept = float(check.links["radius"][0, i * n_links + nearest.link])
    return Budget(
        latency=full - error - stop,
        stop=stop,
        error=error + (swept - link),
        body=0.0,
        margin=cycle.margin_m,
        distance=nearest.gap_m + full + swept,
        link=link,
    )


def _boundary_error(model: HumanModel) -> float:
    return model.monitored.boundary_error_m if isinstance(model, UnobservedSpace) else 0.0


def _radius(model: HumanModel, people: Block, slices: Block, row: int) -> float:
    rows = model.new_sets()
    model.occupy(people, slices, rows)
    return float(rows["radius"][0, row])


def _triple(point: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float, float]:
    return float(point[0]), float(point[1]), float(point[2])
