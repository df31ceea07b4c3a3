"""Where everything was on the slice of a witness: what a picture of it shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from occupancy.humans.unobserved import UNOBSERVED
from robots.motion import Block
from verifier.criteria import WorkspaceCriterion
from verifier.cycle import CycleCheck
from verifier.evidence import Judged, part_names
from verifier.verdict import Witness

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Body:
    """The hull of ``points`` (P, 3) [m, world] grown by ``radius`` [m].

    Attributes
    ----------
    name:
        Link, parts of a person joined by ``+``, or fixture.
    decides:
        It is one of the pair that the witness names.
    person:
        Id of the person; empty: it is none.
    """

    name: str
    points: Array
    radius: float
    decides: bool
    person: str = ""


@dataclass(frozen=True, eq=False)
class Still:
    """What was compared on the slice of a witness.

    Attributes
    ----------
    links, people, fixtures:
        Sets of every link, of the witness's model for everybody known, and of every fixture with corners.
    seen:
        Person id -> (20, 3) m, points as last admitted; NaN: never. One entry for each of their rows.
    points:
        (2, 3) m, the nearest points of the witness; NaN: unknown.
    """

    links: tuple[Body, ...]
    people: tuple[Body, ...] = ()
    fixtures: tuple[Body, ...] = ()
    seen: tuple[tuple[str, Array], ...] = field(default=())
    points: Array = field(default_factory=lambda: np.full((2, 3), np.nan))


def take_still(check: CycleCheck, cycle: Judged, found: Witness | None) -> Still | None:
    """Return what the last check compared on the slice of its witness; ``None``: there is no witness.

    To be called before anything else is checked: it reads the blocks of the check.
    """
    if found is None:
        return None
    begin = float(found.slice[0])
    slices = cycle.slices
    i = int(np.argmin(np.abs(slices["t"][0, : int(slices["n"][0])] - begin)))
    return Still(
        links=tuple(_links(check, i, found)),
        people=() if found.other else tuple(_people(check, cycle, i, found)),
        fixtures=tuple(_fixtures(check, found)),
        seen=tuple(_seen(cycle)),
        points=np.array(found.points),
    )


def _links(check: CycleCheck, i: int, found: Witness) -> Iterator[Body]:
    names = check.robot.links
    for name, points, radius, owner, _covers in _rows(check.links, i, names):
        yield Body(name, points, radius, names[owner] in (found.link, found.other))


def _people(check: CycleCheck, cycle: Judged, i: int, found: Witness) -> Iterator[Body]:
    listed = [cycle.ids[int(k)] for k in cycle.people["person"][0, : int(cycle.people["n"][0])]]
    for occupancy in check.occupancies:
        if occupancy.model.name != found.model:
            continue
        for _name, points, radius, owner, covers in _rows(occupancy.sets, i, ()):
            person = listed[owner] if owner < len(listed) else UNOBSERVED
            parts = part_names(covers)
            shared = set(parts.split("+")) >= set(found.part.split("+"))
            decides = person == found.person and (shared or person == UNOBSERVED)
            yield Body(parts, points, radius, decides, person)


def _rows(sets: Block, i: int, names: tuple[str, ...]) -> Iterator[tuple[str, Array, float, int, int]]:
    """Yield name, points, radius, owner and parts of the rows of slice i that say something."""
    record = sets[0]
    for row in range(int(record["first"][i]), int(record["first"][i + 1])):
        n, radius, owner = (
            int(record["n_points"][row]),
            float(record["radius"][row]),
            int(record["owner"][row]),
        )
        points = record["points"][row, :n].copy()
        if n and np.isfinite(points).all() and np.isfinite(radius):
            name = names[owner] if owner < len(names) else ""
            yield name, points, radius, owner, int(record["covers"][row])


def _fixtures(check: CycleCheck, found: Witness) -> Iterator[Body]:
    for criterion in check.robot_criteria:
        if isinstance(criterion, WorkspaceCriterion):
            for fixture in criterion.workspace.fixtures:
                for piece in fixture.pieces:
                    if len(piece.points):
                        yield Body(fixture.name, piece.points, piece.radius, fixture.name == found.other)


def _seen(cycle: Judged) -> Iterator[tuple[str, Array]]:
    people = cycle.people[0]
    for k in range(int(people["n"])):
        yield cycle.ids[int(people["person"][k])], people["xyz"][k].copy()
