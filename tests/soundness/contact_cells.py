"""Random cells in which some links may touch some parts of people, if slowly and where they clamp nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from occupancy import contact_limits
from occupancy.body import ALL_PARTS, Part, Point
from occupancy.contact import Contact, ContactRule
from occupancy.contact_limits import ContactLimits, load_contact_limits
from occupancy.workspace import Fixture, box, half_space
from robots.model import Mount, RobotModel
from tests.oracles.clamping import Box, Gaps, Surroundings
from tests.oracles.contact_rules import Limits, Rule, either_side
from tests.oracles.urdf_arm import Arm
from tests.soundness.cells import STANDSTILL_M_S, Bounds, Cell, random_cell
from tests.soundness.persons import LEGS
from verifier.criteria import ContactCriterion

Array = NDArray[np.float64]

TRUE_LIMITS = Limits(Path(contact_limits.__file__).parent / "contact" / "ts15066.toml")
SHARES_CAPSULE = {"ee_link": "wrist_3_link", "panda_rightfinger": "panda_leftfinger"}
"""Link -> the one whose name stands for both in a cell file."""
SIDES = ("l", "r")
DECLARED = (
    ("hand",), ("hand",), ("hand", "forearm"), ("hand", "forearm", "upper_arm"), ("torso", "hand"),
    ("forearm",), ("thigh", "shank", "hand"), ("pelvis", "torso", "upper_arm", "forearm", "hand"),
)  # fmt: skip
"""Parts that a rule names, on both sides of the body."""
POINTS = {
    "hand": ("wrist", "hand", "fingertip"), "forearm": ("elbow", "wrist"), "upper_arm": ("elbow", "shoulder"),
    "thigh": ("hip", "knee"), "shank": ("knee", "ankle"), "torso": ("thorax",), "pelvis": ("pelvis",),
}  # fmt: skip
SLOW = Bounds(
    speeds=(0.1, 0.4, 0.8, 1.6),
    latency_s=(0.0, 0.1),
    delay_s=(0.0, 0.02),
    q_error=(0.0, 0.003),
    error_m=(0.0, 0.02),
    clock_s=(0.0, 0.005),
    pace=(0.1, 1.0),
    strides=(0.3, 0.8, 1.5),
    people=(1, 1, 2),
    silence=0.15,
)
"""Arms that are now slow enough to touch somebody, now too fast."""
FAST = (0.4, 1.2)
"""The same where only hands and forearms may be touched, whose limits are higher."""


@dataclass(frozen=True)
class ContactBounds:
    """What random cells are drawn from.

    ``added``: share of rules that add the person's speed; ``links``: of those for all links; ``beside``:
    share of floors, and of boxes, that are near; ``by_design``: shares of pairs of links that do not count,
    of which a cell has one.
    """

    cell: Bounds = SLOW
    added: float = 0.2
    links: float = 0.7
    beside: float = 0.4
    by_design: tuple[float, ...] = (0.0, 0.5, 1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Declared:
    """What a cell says about contact. ``limits``: those that the verifier is given."""

    rules: tuple[Rule, ...]
    surroundings: Surroundings
    by_design: tuple[tuple[str, str], ...]
    limits: ContactLimits

    def criterion(self, robot: RobotModel) -> ContactCriterion:
        """Make the criterion of the verifier."""
        rules = [
            ContactRule(
                rule.links,
                tuple(Part[part.upper()] for part in rule.parts),
                rule.person_speed,
                rule.robot_mass,
            )
            for rule in self.rules
        ]
        return ContactCriterion(Contact(robot, self._fixtures(), rules, self.limits, self.by_design), ())

    def _fixtures(self) -> list[Fixture]:
        found = [half_space("floor", (0.0, 0.0, self.surroundings.floor), (0.0, 0.0, 1.0))]
        boxes = self.surroundings.boxes
        return found + [
            box(name, each.size, Mount(each.rotation, each.centre)) for name, each in boxes.items()
        ]


@dataclass(frozen=True)
class ContactCell:
    """A cell, and what it truly declares."""

    cell: Cell
    declared: Declared

    def allowed(self) -> dict[str, Array]:
        """How fast (L,) [m/s] the links of the brute-force checker may be that touch a part."""
        links = [row_of(link) for link in self.cell.arm.links]
        parts = [part.name.lower() for part in Part]
        return TRUE_LIMITS.allowed(self.declared.rules, links, parts, STANDSTILL_M_S)

    def others(self, link: str) -> list[str]:
        """Links that may clamp something together with ``link``, and are not declared not to."""
        exempt = {frozenset(pair) for pair in self.declared.by_design}
        return [
            other
            for other in gaps(self.cell.arm).beside(link)
            if frozenset((row_of(link), row_of(other))) not in exempt
        ]


def row_of(link: str) -> str:
    """The name by which a cell file declares a link."""
    return SHARES_CAPSULE.get(link, link)


@cache
def gaps(arm: Arm) -> Gaps:
    """Measure gaps of an arm; the same for all cells."""
    return Gaps(arm)


@cache
def bundled() -> ContactLimits:
    """The limits as the verifier reads them."""
    return load_contact_limits("ts15066")


def random_contact_cell(rng: np.random.Generator, bounds: ContactBounds) -> ContactCell:
    """Return a cell with one or two rules, a floor, and often a box near the arm."""
    kinds = DECLARED[int(rng.integers(len(DECLARED)))]
    parts = tuple(part.name.lower() for part in Part if either_side(part.name.lower()) in kinds)
    pace = FAST if set(kinds) <= {"hand", "forearm"} else bounds.cell.pace
    moving = replace(bounds.cell, pace=pace, busy=int(rng.random() < 0.7))
    cell = random_cell(rng, _with_people(rng, moving, kinds, parts))
    names = tuple(dict.fromkeys(row_of(link) for link in cell.arm.links))
    fastest = float(cell.profile.speed.max())
    rules = [_rule(rng, bounds, names, parts, fastest)]
    if rng.random() < 0.3:
        rules.append(_rule(rng, bounds, names, tuple(str(part) for part in rng.choice(parts, 1)), fastest))
    share = rng.choice(bounds.by_design)
    by_design = tuple(pair for pair in combinations(names, 2) if rng.random() < share)
    declared = Declared(tuple(rules), _surroundings(rng, cell, bounds.beside), by_design, bundled())
    return ContactCell(cell, declared)


def _with_people(
    rng: np.random.Generator, bounds: Bounds, kinds: tuple[str, ...], parts: tuple[str, ...]
) -> Bounds:
    """People with a point of a declared part near the arm; often nothing but such parts has to be proven."""
    stated = sum(1 << Part[part.upper()] for part in parts)
    arms = sum(
        1 << part for part in Part if either_side(part.name.lower()) in ("upper_arm", "forearm", "hand")
    )
    draw = rng.random()
    shown = stated if draw < 0.6 else stated | arms if draw < 0.8 else ALL_PARTS & ~LEGS | stated
    names = {point for kind in kinds for point in POINTS[kind]}
    nearest = tuple(point for point in Point if either_side(point.name.lower()) in names)
    return replace(bounds, legs=(True,), parts=shown, nearest=nearest)


def _rule(
    rng: np.random.Generator,
    bounds: ContactBounds,
    names: tuple[str, ...],
    parts: tuple[str, ...],
    fastest: float,
) -> Rule:
    links = names
    if rng.random() >= bounds.links:
        links = tuple(
            str(link) for link in rng.choice(names, int(rng.integers(1, len(names))), replace=False)
        )
    person = fastest if rng.random() < bounds.added else 0.0
    return Rule(links, parts, person, float(rng.choice([math.inf, math.inf, 10.0, 3.0])))


def _surroundings(rng: np.random.Generator, cell: Cell, beside: float) -> Surroundings:
    """A floor and perhaps a box, at most a little nearer to where the arm goes than matters."""
    s = cell.state[0]
    places = _places(cell.arm, cell.path(np.linspace(s, s + 0.3, 4)))
    floor = float(places[:, 2].min()) - (rng.uniform(-0.02, 0.6) if rng.random() < beside else 2.0)
    boxes = {}
    if rng.random() < beside:
        size = rng.uniform(0.05, 0.6, 3)
        way = rng.normal(size=3)
        away = 0.5 * float(np.linalg.norm(size)) + rng.uniform(-0.1, 0.7)
        centre = places[rng.integers(len(places))] + away * way / np.linalg.norm(way)
        pose = Mount.from_xyz_rpy(centre, rng.uniform(-180.0, 180.0, 3))
        boxes["box"] = Box(centre, pose.rotation, size)
    return Surroundings(floor, boxes)


def _places(arm: Arm, q: Array) -> Array:
    """Where some points of all links are (N, 3) [m] at positions ``q`` (T, n)."""
    rotations, positions = arm.poses(q)
    found = [
        (probes @ np.swapaxes(rotations[link], -1, -2) + positions[link][:, None]).reshape(-1, 3)
        for link, probes in enumerate(arm.probes)
    ]
    return np.concatenate(found)
