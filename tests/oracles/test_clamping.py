"""Gaps, touches and limits of contact of the brute-force checker against coal and closed forms."""

from __future__ import annotations

import math
from pathlib import Path

import coal
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from occupancy import contact_limits
from tests.oracles.arms import arm
from tests.oracles.brute_force import nearest_approach
from tests.oracles.clamping import Box, Gaps, Surroundings, touched
from tests.oracles.contact_rules import REGIONS, Limits, Rule
from tests.oracles.hulls import segment_segment
from tests.oracles.situation import Motion
from tests.oracles.test_brute_force import random_motion, random_people, sliding_box

FILE = Path(contact_limits.__file__).parent / "contact" / "ts15066.toml"


def test_distances_of_points_from_a_box_against_coal(rng: np.random.Generator) -> None:
    for _ in range(200):
        box = Box(
            rng.uniform(-0.5, 0.5, 3), Rotation.random(random_state=rng).as_matrix(), rng.uniform(0.1, 1.0, 3)
        )
        points = rng.uniform(-1.5, 1.5, (5, 3))
        theirs = [
            coal.distance(
                coal.Box(*box.size), coal.Transform3s(box.rotation, box.centre),
                coal.Sphere(1e-6), coal.Transform3s(np.eye(3), point),
                coal.DistanceRequest(), coal.DistanceResult(),
            )
            for point in points
        ]  # fmt: skip
        np.testing.assert_allclose(box.distance(points), np.maximum(np.array(theirs) + 1e-6, 0.0), atol=1e-5)


def test_gaps_of_a_slider_in_closed_form(tmp_path: Path, rng: np.random.Generator) -> None:
    """A box of 0.1 m that slides 0.1 m along x, above a floor and towards a wall."""
    slider = sliding_box(tmp_path, rng)
    time = np.linspace(0.0, 0.1, 101)
    motion, samples = Motion(time, time[:, None].copy()), np.array([0, 50, 100])
    for floor, wall, gap, other, when in (
        (-0.25, 1.0, 0.2, "floor", 0.0),
        (-0.25, 0.25, 0.1, "wall", 0.1),
        (-0.04, 0.35, 0.0, "floor", 0.0),
    ):
        box = Box(np.array([wall + 0.1, 0.0, 0.0]), np.eye(3), np.array([0.2, 2.0, 2.0]))
        found = Gaps(slider).narrowest(motion, "box", Surroundings(floor, {"wall": box}), [], samples)
        assert found.gap == pytest.approx(gap, abs=1e-9)
        assert (found.link, found.other, found.time) == ("box", other, pytest.approx(when))


def test_gaps_between_capsules_against_their_axes(rng: np.random.Generator) -> None:
    """Of the made-up arm only the carriage is beside the lower link and the hand; points are 2 cm apart."""
    made_up, high = arm("made_up"), Surroundings(-100.0, {})
    known, axes = (
        Gaps(made_up, points_per_link=2000),
        {"carriage": (0, 0, 0.2, 0.08), "lower": (0, 0, 0.4, 0.05)},
    )
    for _ in range(30):
        motion = Motion(np.zeros(1), rng.uniform(-1.5, 1.5, (1, 4)))
        rotations, positions = made_up.poses(motion.q)
        ends = []
        for link, (*end, _) in axes.items():
            k = made_up.links.index(link)
            ends += [positions[k, 0], rotations[k, 0] @ end + positions[k, 0]]
        exact = segment_segment(*ends) - sum(radius for *_, radius in axes.values())
        found = known.narrowest(motion, "carriage", high, ["lower"], np.array([0]))
        assert found.other == "lower"
        if exact > 0.0:
            assert exact - 1e-6 <= found.gap < exact + 0.02


def test_links_beside_each_other() -> None:
    ur, panda, made_up = (Gaps(arm(name)) for name in ("ur5", "panda", "made_up"))
    wrists = ["wrist_1_link", "wrist_2_link", "wrist_3_link", "ee_link"]
    assert ur.beside("shoulder_link") == ["forearm_link", *wrists]
    assert ur.beside("ee_link") == [
        f"{name}_link" for name in ("shoulder", "upper_arm", "forearm", "wrist_1")
    ]
    assert panda.beside("panda_leftfinger") == [f"panda_link{k}" for k in range(1, 6)]
    assert made_up.beside("carriage") == ["lower", "hand"]
    assert made_up.beside("upper") == ["hand"]


def test_what_is_touched_is_within_reach(rng: np.random.Generator) -> None:
    small, seen = arm("ur3"), 0
    for _ in range(6):
        motion, people = random_motion(rng, 6, 40), random_people(rng, 1)
        names = [part.name for part in people[0].parts]
        allowed = {name: rng.choice([0.0, 0.2, 0.5, 9.0], 7) for name in names}
        for link, part in touched(small, motion, people, allowed, 4):
            alone = {name: np.full(7, 1e3) for name in names}
            alone[part][small.links.index(link)] = allowed[part][small.links.index(link)]
            found = nearest_approach(small, motion, people, alone)
            assert found is not None and found.slack <= 0.0
            seen += 1
        assert not touched(small, motion, people, {name: np.full(7, 9.0) for name in names}, 4)
    assert seen > 20


def test_limits_against_numbers_of_others() -> None:
    """Energies published for the same table, and speeds worked out by hand: a chest, a wrist hit by 6 kg."""
    limits = Limits(FILE)
    for region, energy, mass in (("upper_arm", 1.5, 3.0), ("lower_arm", 1.28, 2.0), ("hand", 0.523, 0.6)):
        speed = limits._speed_at(limits._regions[region], math.inf)
        assert 0.5 * mass * speed**2 == pytest.approx(energy, rel=5e-3)
    assert limits.speed("torso") == pytest.approx(0.28)
    assert limits.speed("l_hand", 6.0) == pytest.approx(320.0 / math.sqrt(40e3 * 1.5))
    for part in ("head", "neck", "l_foot"):
        assert limits.speed(part) == 0.0
    assert [limits.gap(part) for part in ("torso", "r_shank", "l_hand")] == [0.5, 0.18, 0.1]
    assert set(REGIONS) == {
        "head",
        "neck",
        "torso",
        "pelvis",
        "upper_arm",
        "forearm",
        "hand",
        "thigh",
        "shank",
        "foot",
    }


def test_of_several_rules_the_least_holds() -> None:
    limits = Limits(FILE)
    rules = [
        Rule(("a", "b"), ("l_hand",), 0.4),
        Rule(("b",), ("l_hand", "torso"), 1.0),
        Rule(("a",), ("torso",)),
    ]
    found = limits.allowed(rules, ("a", "b", "c"), ("l_hand", "torso", "head"), 0.001)
    hand = limits.speed("l_hand")
    np.testing.assert_allclose(found["l_hand"], [hand - 0.4, hand - 1.0, 0.001])
    np.testing.assert_allclose(found["torso"], [0.28, 0.001, 0.001])
    np.testing.assert_allclose(found["head"], 0.001)
