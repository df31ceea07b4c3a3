"""The rules a plan is held against. A criterion can only prove obligations, never add or reopen one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from occupancy.contact import Contact
from occupancy.humans.model import Occupancy
from occupancy.self_collision import WHY, SelfCollision
from occupancy.separation import Nearest, Separation
from occupancy.workspace import Blocked, Workspace
from robots.assumption import Assumption, Certainty
from robots.motion import Block
from verifier.verdict import CriterionKind


class Scene(NamedTuple):
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
        self._scene: Scene | None = None

    def assumptions(self) -> tuple[Assumption, ...]:
        """List the margin."""
        source = "a gap must exceed this"
        return (Assumption("check.margin_m", self._margin_m, "m", source, Certainty.DECLARED),)

    def check(self, scene: Scene, ledger: Block) -> Nearest:
        """Prove the pairs whose certified gap exceeds the margin, model after model while any is open.

        Returns the tightest pair that proved something when nothing is left open; else what blocks the first
        slice that is open, by the model that comes closest to proving it.
        """
        if scene is not self._scene:  # a limit on calls is one per plan, however often it is looked at
            self._separation.renew()
            self._scene = scene
        tightest: Nearest | None = None
        found: Nearest | None = None
        for occupancy in scene.occupancies:
            found = self._separation.check(scene.links, occupancy.sets, ledger)
            proven = found if found.separated else self._separation.proven()
            if tightest is None or proven.gap_m < tightest.gap_m:
                tightest = proven
            if found.separated:
                return tightest._replace(separated=True)  # of an earlier model it was not all
        assert found is not None, "a scene has at least one model of people"
        return found if len(scene.occupancies) == 1 else self._blocking(scene, ledger)

    def _blocking(self, scene: Scene, ledger: Block) -> Nearest:
        """Ask every model once more about the first slice that is open."""
        rest = ledger.copy()
        opened = rest[0]["open"][: rest[0]["n_slices"], : rest[0]["n_links"], : rest[0]["n_people"]]
        first = int(np.flatnonzero(opened.any(axis=(1, 2)))[0])
        opened[first + 1 :] = 0
        answers = [
            self._separation.check(scene.links, occupancy.sets, rest) for occupancy in scene.occupancies
        ]
        return max(answers, key=lambda answer: answer.gap_m)


class RobotCriterion(Protocol):
    """A rule about the robot alone: it is checked whoever is there, and also when nobody is."""

    kind: CriterionKind
    margin_m: float

    def assumptions(self) -> tuple[Assumption, ...]:
        """List what the rule rests on."""
        ...

    def check(self, links: Block, slices: Block, active: NDArray[np.uint8]) -> Blocked | None:
        """Return the pair that is not proven apart on some slice, or None if all are.

        ``active`` (L,): links that move on some slice of the plan.
        """
        ...

    def terms(self, found: Blocked, link: float, swept: float) -> tuple[float, float]:
        """Return radius of the other side, and errors [m]: what was subtracted besides the link's radius.

        ``link``, ``swept``: radius [m] of the link's capsule, and of its row with curvature and tracking.
        """
        ...


class WorkspaceCriterion:
    """No link that moves comes within the margin of a fixture or the floor (docs/method.md, section 5)."""

    kind = CriterionKind.WORKSPACE

    def __init__(self, workspace: Workspace, margin_m: float) -> None:
        self.workspace = workspace
        self.margin_m = margin_m

    def assumptions(self) -> tuple[Assumption, ...]:
        """List the position errors of the fixtures, and what may touch them."""
        source = "A6: no point of the fixture is farther from where it is declared"
        errors = tuple(
            Assumption(f"workspace.{each.name}.error", each.position_error_m, "m", source, Certainty.DECLARED)
            for each in self.workspace.fixtures
        )
        source = "declared in the cell: not held against each other"
        return errors + tuple(
            Assumption(f"workspace.{fixture}.may_touch.{link}", link, "", source, Certainty.DECLARED)
            for link, fixture in self.workspace.exempt
        )

    def check(self, links: Block, slices: Block, active: NDArray[np.uint8]) -> Blocked | None:
        """Return the link and fixture that are not proven apart, if any."""
        return self.workspace.check(links, slices, active)

    def terms(self, found: Blocked, link: float, swept: float) -> tuple[float, float]:
        """Return radius of the fixture's piece, and its position error with curvature and tracking [m]."""
        error = next(each.position_error_m for each in self.workspace.fixtures if each.name == found.other)
        return found.other_radius_m - error, error + swept - link


class SelfCollisionCriterion:
    """No two links, of which one moves, come within the margin of each other (docs/method.md, section 5)."""

    kind = CriterionKind.SELF_COLLISION

    def __init__(self, pairs: SelfCollision, margin_m: float) -> None:
        self.pairs = pairs
        self.margin_m = margin_m

    def assumptions(self) -> tuple[Assumption, ...]:
        """List the pairs that are not compared, with the reason."""
        found = [
            Assumption(
                f"self_collision.left_out.{each.a}",
                each.b,
                "",
                WHY[each.why],
                Certainty.DECLARED if each.why == "may_touch" else Certainty.COMPUTED,
            )
            for each in self.pairs.left_out
        ]
        source = "the same for all joints, so that links at one instant are compared"
        return (*found, Assumption("self_collision.delay", "one", "", source, Certainty.ASSUMED))

    def check(self, links: Block, slices: Block, active: NDArray[np.uint8]) -> Blocked | None:
        """Return the two links that are not proven apart, if any."""
        return self.pairs.check(links, slices, active)

    def terms(self, found: Blocked, link: float, swept: float) -> tuple[float, float]:
        """Return radius of the other link, and what may happen between the ends of the slice [m]."""
        return found.other_radius_m, found.lost_m


class ContactCriterion:
    """Declared links may touch declared body parts, if slowly and where they cannot clamp them."""

    kind = CriterionKind.POWER_AND_FORCE_LIMITING

    def __init__(self, contact: Contact, assumptions: Sequence[Assumption]) -> None:
        self._contact = contact
        self._assumptions = tuple(assumptions)

    def assumptions(self) -> tuple[Assumption, ...]:
        """List limits with their sources, what is neglected, and the pairs whose gap is not looked at."""
        left_out = (
            Assumption(f"contact.gap_not_checked.{each.a}", each.b, "", WHY[each.why], Certainty.ASSUMED)
            for each in self._contact.left_out
        )
        return (*self._assumptions, *left_out)

    def clear(self, scene: Scene, ledger: Block) -> bool:
        """Clear the obligations of links that may touch a part on a slice; whether there were any."""
        return self._contact.clear(scene.links, scene.slices, ledger)

    def why_not(self, scene: Scene, link: int, parts: int) -> str:
        """Say why a link may not touch some parts (mask) in a plan; empty: nobody declared that it may."""
        return self._contact.why_not(link, parts, scene.links, scene.slices)


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
