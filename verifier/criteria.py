"""The rules a plan is held against. A criterion can only prove obligations, never add or reopen one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from occupancy.humans.model import Occupancy
from occupancy.separation import Nearest, Separation
from robots.assumption import Assumption, Certainty
from robots.motion import Block
from verifier.verdict import CriterionKind


@dataclass(frozen=True, slots=True)
class Scene:
    """What a criterion looks at: one plan's slices, the space links sweep, the space people may fill.

    ``occupancies``: one for each model of people, the one to be asked first in front.
    """

    slices: Block
    links: Block
    people: Block
    occupancies: Sequence[Occupancy]


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

    def __init__(self, separation: Separation, margin_m: float) -> None:
        self._separation = separation
        self._margin_m = margin_m

    def assumptions(self) -> tuple[Assumption, ...]:
        """List the margin."""
        source = "a gap must exceed this"
        return (Assumption("check.margin_m", self._margin_m, "m", source, Certainty.DECLARED),)

    def check(self, scene: Scene, ledger: Block) -> Nearest:
        """Prove the pairs whose certified gap exceeds the margin, model after model while any is open.

        Returns the tightest pair that proved something when nothing is left open; else what blocks the first
        slice that is open, by the model that comes closest to proving it.
        """
        tightest: Nearest | None = None
        found: Nearest | None = None
        for occupancy in scene.occupancies:
            found = self._separation.check(scene.links, occupancy.sets, ledger)
            proven = found if found.separated else self._separation.proven()
            if tightest is None or proven.gap_m < tightest.gap_m:
                tightest = proven
            if found.separated:
                return tightest
        assert found is not None, "a scene has at least one model of people"
        return found if len(scene.occupancies) == 1 else self._blocking(scene, ledger)

    def _blocking(self, scene: Scene, ledger: Block) -> Nearest:
        """Ask every model once more about the first slice that is open."""
        rest = ledger.copy()
        opened = rest[0]["open"][: rest[0]["n_slices"], : rest[0]["n_links"], : rest[0]["n_people"]]
        first = int(np.flatnonzero(opened.any(axis=(1, 2)))[0])
        opened[:first] = 0
        opened[first + 1 :] = 0
        answers = [
            self._separation.check(scene.links, occupancy.sets, rest) for occupancy in scene.occupancies
        ]
        return max(answers, key=lambda answer: answer.gap_m)


class Standstill(NamedTuple):
    """When a link counts as at rest on a slice, and may be touched there.

    Attributes
    ----------
    speed_m_s:
        No point of it can be faster [m/s].
    error_m:
        Tracking errors displace no point of its axis by more [m]: what a smooth path through the samples
        leaves out may be a vibration.
    """

    speed_m_s: float
    error_m: float

    def moving(self, links: Block, n_slices: int, displaced: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each link moves on each slice (S, L); what is NaN counts as moving.

        ``displaced`` (L,) [m]: what tracking errors displace each link by.
        """
        n_links = int(links["n"][0]) // n_slices
        speed = links["speed_max"][0, : n_slices * n_links].reshape(n_slices, n_links)
        moving: NDArray[np.bool_] = ~((speed <= self.speed_m_s) & (displaced[:n_links] <= self.error_m))
        return moving


def open_obligations(ledger: Block, moving: NDArray[np.bool_], n_people: int, parts: int) -> int:
    """Open one obligation per slice, moving link, person and part; return how many pairs were opened.

    Parameters
    ----------
    moving:
        Links (S, L) that move; fixed links have no rows and no obligations.
    n_people:
        Rows of the people block.
    parts:
        Bit mask of the parts that must be proven.
    """
    n_slices, n_links = moving.shape
    record = ledger[0]
    record["n_slices"], record["n_links"], record["n_people"] = n_slices, n_links, n_people
    opened = record["open"][:n_slices, :n_links, :n_people]
    opened[...] = np.where(moving[:, :, None], np.uint32(parts), np.uint32(0))
    return int(np.count_nonzero(moving)) * n_people
