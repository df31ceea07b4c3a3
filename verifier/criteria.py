"""The rules a plan is held against. A criterion can only prove obligations, never add or reopen one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from occupancy.separation import Nearest, Separation
from robots.assumption import Assumption, Certainty
from robots.motion import Block
from verifier.verdict import CriterionKind


@dataclass(frozen=True, slots=True)
class Scene:
    """What a criterion looks at: one plan's slices, the space links sweep, the space people may fill."""

    slices: Block
    links: Block
    people: Block
    people_sets: Block


class Criterion(Protocol):
    """A rule. ``check`` turns open obligations into proven ones and does nothing else."""

    kind: CriterionKind

    def assumptions(self) -> tuple[Assumption, ...]:
        """List what the rule rests on."""
        ...

    def check(self, scene: Scene, ledger: Block) -> Nearest:
        """Clear the bits of ``ledger.open`` that hold; return the pair that decided."""
        ...


class SeparationCriterion:
    """No moving link comes within ``margin`` of any body part (docs/method.md, section 5)."""

    kind = CriterionKind.SEPARATION

    def __init__(self, separation: Separation, margin_m: float, standstill_speed_m_s: float) -> None:
        self._separation = separation
        self._margin_m = margin_m
        self._standstill_speed_m_s = standstill_speed_m_s

    def assumptions(self) -> tuple[Assumption, ...]:
        """List margin and standstill speed."""
        return (
            Assumption("check.margin_m", self._margin_m, "m", "a gap must exceed this", Certainty.DECLARED),
            Assumption(
                "check.standstill_speed_m_s",
                self._standstill_speed_m_s,
                "m/s",
                "a link no point of which is faster counts as at rest and may be touched",
                Certainty.DECLARED,
            ),
        )

    def check(self, scene: Scene, ledger: Block) -> Nearest:
        """Prove the pairs whose certified gap exceeds the margin."""
        return self._separation.check(scene.links, scene.people_sets, ledger)


def open_obligations(scene: Scene, ledger: Block, parts: int, standstill_speed_m_s: float) -> int:
    """Open one obligation per slice, moving link, person and part; return how many pairs were opened.

    A link whose speed bound on a slice is NaN counts as moving. Fixed links have no rows and no obligations.

    Parameters
    ----------
    parts:
        Bit mask of the parts that must be proven.
    standstill_speed_m_s:
        Links that are nowhere faster than this on a slice count as at rest there [m/s].
    """
    slices, links, people, record = scene.slices[0], scene.links[0], scene.people[0], ledger[0]
    n_slices, n_people = int(slices["n"]), int(people["n"])
    n_links = int(links["n"]) // n_slices if n_slices > 0 else 0
    record["n_slices"], record["n_links"], record["n_people"] = n_slices, n_links, n_people
    speed = links["speed_max"][: n_slices * n_links].reshape(n_slices, n_links)
    moving = ~(speed <= standstill_speed_m_s)
    opened = record["open"][:n_slices, :n_links, :n_people]
    opened[...] = np.where(moving[:, :, None], np.uint32(parts), np.uint32(0))
    return int(np.count_nonzero(moving)) * n_people
