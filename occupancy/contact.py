"""Power and force limiting: which links may touch which body parts, and where nothing can be clamped.

A link may touch a part on a slice if, relative to it, no point of the link is faster than the part's limit,
and if on the whole plan the link keeps the part's clamping gap from every fixture and from every other link.
(docs/method.md, section 5.)
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_PARTS, Part
from occupancy.contact_kernels import clear_slow
from occupancy.contact_limits import ContactLimits
from occupancy.self_collision import SelfCollision
from occupancy.workspace import Blocked, Fixture, Workspace, WorkspaceError
from robots.enclosure import MAX_LINKS
from robots.model import RobotModel
from robots.motion import Block

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContactRule:
    """Links that may touch body parts.

    Attributes
    ----------
    links, parts:
        Names of enclosure rows, and parts.
    person_speed_m_s:
        How fast the part itself may come; subtracted from the limit.
    robot_mass_kg:
        Mass that arrives; infinite for a robot that keeps its position.
    """

    links: tuple[str, ...]
    parts: tuple[Part, ...]
    person_speed_m_s: float
    robot_mass_kg: float = math.inf


class Contact:
    """Clears obligations of links that are slow enough and cannot clamp.

    Parameters
    ----------
    model, fixtures:
        The robot, and everything that stands around it.
    rules:
        Which links may touch which parts.
    limits:
        Speeds and gaps of the parts.
    by_design:
        Pairs of links in whose gap nothing can be clamped, declared by the user.

    Raises
    ------
    WorkspaceError
        A link is not known, or a number is not usable.
    """

    def __init__(
        self,
        model: RobotModel,
        fixtures: Sequence[Fixture],
        rules: Sequence[ContactRule],
        limits: ContactLimits,
        by_design: Collection[tuple[str, str]] = (),
    ) -> None:
        for rule in rules:
            for link in rule.links:
                if link not in model.links:
                    known = ", ".join(model.links)
                    raise WorkspaceError(f"contact: link {link} is not known; there are: {known}")
            if not (rule.person_speed_m_s >= 0.0 and rule.robot_mass_kg > 0.0):
                raise WorkspaceError("contact: speed of a person and mass of a robot must be positive")
        self._names = model.links
        self._stated = _speeds(model.links, rules, limits)
        self.speed = np.where(self._stated > 0.0, self._stated, -math.inf)
        self._allowed = np.full_like(self.speed, -math.inf)
        pairs = SelfCollision(model, by_design, 0.0)
        self.left_out = pairs.left_out
        self._traps = tuple(self._traps_of(model, fixtures, pairs, limits))

    def _traps_of(
        self, model: RobotModel, fixtures: Sequence[Fixture], pairs: SelfCollision, limits: ContactLimits
    ) -> list[_Trap]:
        """For each link that may touch something, and each gap that matters: what may not come nearer."""
        found = []
        for link, name in enumerate(model.links):
            parts = [part for part in Part if self.speed[link, part] > 0.0]
            for gap in sorted({limits.gap(part) for part in parts}):
                active = np.zeros(MAX_LINKS, dtype=np.uint8)
                active[link] = 1
                found.append(
                    _Trap(
                        link,
                        [int(part) for part in parts if limits.gap(part) == gap],
                        active,
                        Workspace(fixtures, model.links, {}, gap),
                        pairs.of_link(name, gap),
                        gap,
                    )
                )
        return found

    def clear(self, links: Block, slices: Block, ledger: Block) -> bool:
        """Clear the bits of ``ledger`` of parts that may be touched; whether any was. Never raises."""
        self._allowed[...] = -math.inf
        for trap in self._traps:
            if trap.is_open(links, slices):
                self._allowed[trap.link, trap.parts] = self.speed[trap.link, trap.parts]
        return bool(clear_slow(links, ledger, self._allowed))

    def why_not(self, link: int, parts: int, links: Block, slices: Block) -> str:
        """Say why ``clear`` leaves a link and one of some parts (mask) open; empty: nobody declared them.

        To be asked about a plan that was looked at; not for the cycle.
        """
        declared = [part for part in Part if parts >> part & 1 and self._stated[link, part] > -math.inf]
        for part in declared:
            if not self._stated[link, part] > 0.0:
                return f"the person's speed leaves none to the link, by the limit of the {_name(part)}"
        for trap in self._traps:
            clamped = [part for part in declared if part in trap.parts]
            found = trap.narrow(links, slices) if trap.link == link and clamped else None
            if found is not None:
                other = found.other if found.link == link else self._names[found.link]
                return (
                    f"between link and {other} the {_name(clamped[0])} needs {trap.gap:g} m not to be clamped"
                )
        if not declared:
            return ""
        least = min(declared, key=lambda part: float(self._stated[link, part]))
        return f"the {_name(least)} may be touched at no more than {self._stated[link, least]:.3g} m/s"


@dataclass(frozen=True)
class _Trap:
    """Gaps of one link that must stay wide for some parts."""

    link: int
    parts: list[int]
    active: NDArray[np.uint8]
    workspace: Workspace
    others: SelfCollision
    gap: float

    def narrow(self, links: Block, slices: Block) -> Blocked | None:
        """Return what is not proven far enough from the link on the whole plan; ``None``: everything is."""
        found = self.workspace.check(links, slices, self.active)
        return self.others.check(links, slices, self.active) if found is None else found

    def is_open(self, links: Block, slices: Block) -> bool:
        """Whether all gaps of the link are proven wide enough on the whole plan."""
        return self.narrow(links, slices) is None


def _speeds(links: Sequence[str], rules: Sequence[ContactRule], limits: ContactLimits) -> Array:
    """Greatest speed (L, P) [m/s] at which each link may touch each part; ``-inf``: not declared, or never.

    Where several rules name a pair, the least holds; not above 0 where the person's own speed uses it up.
    """
    speed = np.full((MAX_LINKS, MAX_PARTS), -math.inf)
    for rule in rules:
        for part in rule.parts:
            limit = limits.speed(part, rule.robot_mass_kg) - rule.person_speed_m_s
            for link in rule.links:
                at = links.index(link), int(part)
                speed[at] = min(limit, speed[at]) if speed[at] > -math.inf else limit
    return speed


def _name(part: Part) -> str:
    return part.name.lower().replace("_", " ")
