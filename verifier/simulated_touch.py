"""How fast a link may be that touches a part of somebody, by what a cell declares, in a simulation."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from occupancy.body import PART_NAMES, Part
from verifier.cell import Cell
from verifier.scripted_people import Flesh
from verifier.setup import build_profile, contact_limits

Array = NDArray[np.float64]


def allowed_speeds(cell: Cell, links: Sequence[str], people: Sequence[Flesh]) -> list[Array]:
    """Return per person the greatest speed (links, rows of flesh) [m/s] of a link that may touch a row.

    ``-inf``: it must not touch while it moves; ``inf``: the cell leaves the part out. Of several rules for a
    pair the least holds.
    """
    fastest, limits = float(build_profile(cell).speed.max()), contact_limits(cell)
    by_part = np.full((len(links), len(PART_NAMES)), -math.inf)
    for rule in cell.criteria.contact:
        mass = math.inf
        if rule.moving_mass_kg is not None and rule.payload_kg is not None:
            mass = 0.5 * rule.moving_mass_kg + rule.payload_kg
        person = fastest if rule.person_speed == "added" else 0.0
        for part in (PART_NAMES.index(name) for name in rule.parts):
            limit = limits.speed(Part(part), mass) - person
            for link in (links.index(name) for name in rule.links):
                before = by_part[link, part]
                by_part[link, part] = limit if before == -math.inf else min(limit, before)
    for name in cell.people.ignored_parts:
        by_part[:, PART_NAMES.index(name)] = math.inf
    return [by_part[:, np.asarray(flesh.part, dtype=int)] for flesh in people]
