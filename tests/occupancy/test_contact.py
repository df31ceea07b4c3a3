"""Power and force limiting: collisions integrated, sampled motion of made-up arms, and the numbers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from occupancy import workspace
from occupancy.body import ALL_PARTS, Part
from occupancy.contact import Contact, ContactRule
from occupancy.contact_limits import REGIONS_OF, ContactLimits, contact_limits_names, load_contact_limits
from occupancy.number_table import ProfileError
from occupancy.separation import new_ledger, open_obligations
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy
from occupancy.workspace import WorkspaceError
from robots.assumption import Certainty
from robots.errors import SetupError
from tests.occupancy.arms import Motion, arm, axis_points, place, random_motion
from tests.occupancy.test_self_collision import pair_gaps, slim

Array = NDArray[np.float64]
Count = Callable[[int], int]
LIMITS = load_contact_limits("ts15066")
TOUCHED = [part for part in Part if LIMITS.speed(part) > 0.0]


def largest_force(stiffness: float, mass: float, robot: float, speed: float) -> float:
    """Force [N] in the spring while a robot at ``speed`` hits a mass at rest, by integration."""
    push = 0.0 if math.isinf(robot) else 1.0 / robot

    def rates(_t: float, x: Array) -> list[float]:
        force = stiffness * (x[0] - x[2])
        return [x[1], -push * force, x[3], force / mass]

    period = 2.0 * math.pi * math.sqrt(mass / stiffness)
    found = solve_ivp(
        rates, (0.0, 0.5 * period), [0.0, speed, 0.0, 0.0], rtol=1e-10, atol=1e-13, max_step=period / 400
    )
    return float(stiffness * (found.y[0] - found.y[2]).max())


@pytest.mark.parametrize("robot", [math.inf, 30.0, 3.0])
@pytest.mark.parametrize("part", TOUCHED, ids=lambda part: part.name)
def test_the_limit_speed_loads_the_weakest_region_with_its_force(part: Part, robot: float) -> None:
    speed = LIMITS.speed(part, robot)
    share = []
    for region in REGIONS_OF[part]:
        force, k, m = (
            LIMITS.numbers[f"region.{region}.{key}"].value for key in ("force", "stiffness", "mass")
        )
        factor = LIMITS.numbers[f"region.{region}.transient_factor"].value
        share.append(largest_force(float(k), float(m), robot, speed) / (float(force) * float(factor)))
    assert max(share) == pytest.approx(1.0, abs=1e-3)


def test_numbers_against_others() -> None:
    """Energies (2F)²/2k that are published for the same table, and speeds worked out by hand."""
    for region, energy in (("upper_arm", 1.5), ("lower_arm", 1.28), ("hand", 0.523), ("chest", 1.57)):
        force, k = (LIMITS.numbers[f"region.{region}.{key}"].value for key in ("force", "stiffness"))
        assert (2.0 * float(force)) ** 2 / (2.0 * float(k)) == pytest.approx(energy, rel=5e-3)
    assert LIMITS._region_speed("chest", math.inf) == pytest.approx(0.28)
    assert LIMITS._region_speed("hand", math.inf) == pytest.approx(1.32, abs=5e-3)
    speeds = {part.name.lower(): round(LIMITS.speed(part), 3) for part in TOUCHED if part.name[:2] != "R_"}
    assert speeds == {
        "torso": 0.28, "pelvis": 0.227, "l_upper_arm": 0.355, "l_forearm": 1.0, "l_hand": 1.131,
        "l_thigh": 0.227, "l_shank": 0.123,
    }  # fmt: skip
    for part in (Part.HEAD, Part.NECK, Part.L_FOOT, Part.R_FOOT):
        assert LIMITS.speed(part) == -math.inf
    gaps = {LIMITS.gap(part) for part in Part}
    assert gaps == {0.5, 0.3, 0.18, 0.12, 0.1}


def test_every_number_says_that_nobody_has_verified_it() -> None:
    assert contact_limits_names() == ("ts15066",)
    assert LIMITS.unverified
    assert {item.certainty for item in LIMITS.numbers.values()} == {Certainty.UNVERIFIED}
    used = {item.name for item in LIMITS.used([Part.L_HAND])}
    assert "contact.ts15066.region.hand.force" in used and "contact.ts15066.region.chest.force" not in used


CHANGES: dict[str, tuple[Callable[[str], str], str]] = {
    "nothing": (lambda text: "", "missing name"),
    "no toml": (lambda text: "= 3", "not readable"),
    "no gap": (lambda text: text.replace('hand = { value = 0.1', 'thumb = { value = 0.1'), "missing hand"),
    "no region": (lambda text: text.replace("[region.chest]", "[region.breast]"), "missing chest"),
    "nan": (lambda text: text.replace("value = 130.0", "value = nan"), "finite"),
    "unit": (lambda text: text.replace('unit = "N"', 'unit = "kN"'), "unit 'kN' must be 'N'"),
    "sure": (lambda text: text.replace('"unverified"', '"true"'), "certainty"),
}  # fmt: skip


@pytest.mark.parametrize("case", CHANGES)
def test_files_of_limits_that_make_no_sense_are_refused(case: str, tmp_path: Path) -> None:
    change, message = CHANGES[case]
    path = tmp_path / "ours.toml"
    text = (Path(workspace.__file__).parent / "contact" / "ts15066.toml").read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    assert load_contact_limits(path).speed(Part.L_HAND) == LIMITS.speed(Part.L_HAND)
    path.write_text(change(text), encoding="utf-8")
    with pytest.raises(ProfileError, match=message):
        load_contact_limits(path)
    with pytest.raises(ProfileError, match="ts15066, or a file"):
        load_contact_limits("ts15067")


def surface_speed(model: object, motion: Motion, rng: np.random.Generator) -> Array:
    """Largest speed (L,) [m/s] of points on the links' capsules over the slice, by differences."""
    step = 1e-6
    axis = axis_points(model, np.array([0.0, 0.5, 1.0]))
    way = rng.normal(size=(*axis.shape[:2], 4, 3))
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    radius = model.enclosure[0]["radius"][: len(axis), None, None, None]
    points = (axis[:, :, None] + radius * way).reshape(len(axis), -1, 3)
    t = np.linspace(0.0, motion.h, 9)[:, None]
    moved = place(model, motion.actual(t + step), points) - place(model, motion.actual(t - step), points)
    found: Array = np.linalg.norm(moved, axis=-1).max(axis=(0, 2)) / (2.0 * step)
    return found


FLOOR_Z = -1.0


@pytest.mark.parametrize("name", ["six", "branches", "scara"])
def test_what_may_touch_is_slow_and_clamps_nothing(name: str, rng: np.random.Generator, count: Count) -> None:
    seen: Counter[str] = Counter()
    for _ in range(max(50, count(5_000))):
        model = slim(name, rng)
        motion = random_motion(model, rng)
        motion.coefficients[1:] *= rng.choice([0.03, 0.3, 1.0])
        slices, links, ledger = motion.slices(), new_link_sets(), new_ledger()
        LinkOccupancy(model).occupy(slices, links)
        touching = [str(link) for link in rng.choice(model.links, 2, replace=False)]
        person, mass = float(rng.choice([0.0, 0.05])), float(rng.choice([math.inf, 8.0]))
        rule = ContactRule(tuple(touching), tuple(TOUCHED), person, mass)
        floor = workspace.half_space("floor", (0, 0, FLOOR_Z), (0, 0, 1))
        contact = Contact(model, [floor], [rule], LIMITS)
        open_obligations(ledger, 1, len(model.links), [ALL_PARTS, ALL_PARTS])
        contact.clear(links, slices, ledger)
        cleared = ALL_PARTS & ~ledger[0]["open"][0, : len(model.links), :2]
        assert (cleared[:, 0] == cleared[:, 1]).all()
        fastest = surface_speed(model, motion, rng)
        q = motion.actual(np.linspace(0.0, motion.h, 33)[:, None])
        gaps = pair_gaps(model, q).min(axis=0)
        ends = place(model, q, axis_points(model, np.array([0.0, 1.0])))[..., 2].min(axis=(0, 2))
        left_out = {frozenset((each.a, each.b)) for each in contact.left_out}
        for k, link in enumerate(model.links):
            for part in Part:
                if not cleared[k, 0] >> part & 1:
                    seen["kept"] += 1
                    continue
                seen["cleared"] += 1
                assert link in touching and part in TOUCHED
                assert fastest[k] + person <= LIMITS.speed(part, mass) + 1e-6
                gap = LIMITS.gap(part)
                assert ends[k] - model.enclosure[0]["radius"][k] - FLOOR_Z > gap - 1e-9
                for other, third in enumerate(model.links):
                    if other != k and frozenset((link, third)) not in left_out:
                        assert gaps[k, other] > gap - 1e-9
    assert min(seen["cleared"], seen["kept"]) > 20, seen


def test_a_slow_link_far_from_everything_may_touch(rng: np.random.Generator) -> None:
    """And not any more with NaN, beside a fixture, beside another link, or as fast as the limit."""
    model = arm("planar", rng)
    model.enclosure[0]["radius"][:2] = 0.01
    zero = np.zeros(2)
    rule = ContactRule(("link_1",), (Part.L_HAND, Part.L_SHANK), 0.0)
    far = workspace.half_space("floor", (0, 0, -5.0), (0, 0, 1))
    near = workspace.half_space("table", (0, 0, -0.1), (0, 0, 1))
    hand, shank = 1 << Part.L_HAND, 1 << Part.L_SHANK

    def cleared(
        rate: float, fixture: workspace.Fixture, spoil: Callable[[np.void], None] | None = None
    ) -> int:
        c = np.zeros((4, 2))
        c[1, 0] = rate
        motion = Motion(0.01, c, zero, zero, zero)
        slices, links, ledger = motion.slices(), new_link_sets(), new_ledger()
        LinkOccupancy(model).occupy(slices, links)
        if spoil is not None:
            spoil(links[0])
        open_obligations(ledger, 1, 2, [ALL_PARTS])
        Contact(model, [fixture], [rule], LIMITS).clear(links, slices, ledger)
        assert ledger[0]["open"][0, 0, 0] == ALL_PARTS
        return int(ALL_PARTS & ~ledger[0]["open"][0, 1, 0])

    reach = 0.81
    assert cleared(0.1 / reach, far) == hand | shank
    assert cleared(0.13 / reach, far) == hand
    assert cleared(1.2 / reach, far) == 0
    assert cleared(0.1 / reach, near) == 0
    for field in ("speed_max", "points", "radius"):

        def spoil(rows: np.void, field: str = field) -> None:
            rows[field][1] = np.nan

        assert cleared(0.1 / reach, far, spoil) == 0


def test_beside_another_link_nothing_may_touch(rng: np.random.Generator) -> None:
    """The third link folds to a distance at which a hand, but not an arm, fits in between."""
    model = arm("six", rng)
    tree, capsules = model.kinematics[0], model.enclosure[0]
    tree["rotation"], tree["translation"], tree["axis"] = np.eye(3), 0.0, [0.0, 0.0, 1.0]
    capsules["a"] = capsules["b"] = [1.0, 0.0, 0.0]
    capsules["radius"] = 0.01
    capsules["reach"][:, :6] = 1.0
    zero = np.zeros(6)
    rule = ContactRule(("link_2",), (Part.L_HAND, Part.L_FOREARM), 0.0)
    others = [("link_2", f"link_{k}") for k in (4, 5)]
    floor = workspace.half_space("floor", (0, 0, -5.0), (0, 0, 1))
    for gap, parts in ((0.09, 0), (0.11, 1 << Part.L_HAND), (0.13, 1 << Part.L_HAND | 1 << Part.L_FOREARM)):
        c = np.zeros((4, 6))
        c[0, 2] = 2.0 * math.asin(0.5 * (gap + 0.02))
        slices, links, ledger = Motion(0.01, c, zero, zero, zero).slices(), new_link_sets(), new_ledger()
        LinkOccupancy(model).occupy(slices, links)
        for by_design, expected in (
            (others, parts),
            ([*others, ("link_0", "link_2")], 1 << Part.L_HAND | 1 << Part.L_FOREARM),
        ):
            open_obligations(ledger, 1, 6, [ALL_PARTS])
            Contact(model, [floor], [rule], LIMITS, by_design).clear(links, slices, ledger)
            assert int(ALL_PARTS & ~ledger[0]["open"][0, 2, 0]) == expected


def test_rules_that_make_no_sense_are_refused(rng: np.random.Generator) -> None:
    model = arm("six", rng)
    for rule, message in (
        (ContactRule(("hand",), (Part.L_HAND,), 0.0), "link hand is not known"),
        (ContactRule(("link_1",), (Part.L_HAND,), math.nan), "positive"),
        (ContactRule(("link_1",), (Part.L_HAND,), 0.0, math.nan), "positive"),
    ):
        with pytest.raises(WorkspaceError, match=message):
            Contact(model, [], [rule], LIMITS)
    with pytest.raises(SetupError, match="link_9"):
        Contact(model, [], [ContactRule(("link_1",), (Part.L_HAND,), 0.0)], LIMITS, [("link_1", "link_9")])


def test_of_two_rules_for_one_pair_the_stricter_holds(rng: np.random.Generator) -> None:
    model = arm("planar", rng)
    rules = [ContactRule(("link_1",), (Part.L_HAND,), speed) for speed in (0.0, 0.3, 0.1)]
    for order in (rules, rules[::-1]):
        speed = Contact(model, [], order, LIMITS).speed[1, Part.L_HAND]
        assert speed == pytest.approx(LIMITS.speed(Part.L_HAND) - 0.3)
    fast = ContactRule(("link_1",), (Part.L_HAND, Part.HEAD), 5.0)
    assert not (Contact(model, [], [*rules, fast], LIMITS).speed > 0.0).any()
    assert isinstance(LIMITS, ContactLimits)
