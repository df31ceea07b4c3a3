"""Who touched a moving link in a supervised replay: bodies as measured, nothing grown, nothing at rest."""

from __future__ import annotations

import numpy as np
import pytest

from occupancy.body import MAX_POINTS, Point
from occupancy.report import RawMeasurement, RawPerson
from tests.occupancy.arms import place
from tests.verifier.scenes import CELL
from verifier import Cell
from verifier.contacts import RecordedContacts
from verifier.criteria import Standstill
from verifier.setup import build_gate, build_profile, build_robot

Q = np.array([0.3, -1.2, 1.3, -0.4, 0.3, 0.0])
EVERY = np.full(6, 0.3)
HAND_M = 0.205


@pytest.fixture(scope="module")
def parts():
    cell = Cell.from_table({**CELL, "robot": {**CELL["robot"], "name": "ur5"}})
    robot, profile = build_robot(cell), build_profile(cell)
    return robot, RecordedContacts(robot, build_gate(cell, profile), profile, Standstill(0.001, 0.002))


def axis_middle(robot, link: int) -> np.ndarray:
    capsules, n = robot.enclosure[0], int(robot.enclosure["n"][0])
    local = 0.5 * (capsules["a"][:n] + capsules["b"][:n])[:, None]
    return place(robot, Q[None], local)[0, link, 0]


def somebody(name: str, wrist: np.ndarray, error: float = 0.0) -> RawPerson:
    """Of whom only a wrist was measured."""
    xyz = np.full((MAX_POINTS, 3), np.nan)
    xyz[Point.R_WRIST] = wrist
    return RawPerson(name, xyz, np.full(MAX_POINTS, error), 1 << Point.R_WRIST)


def report(*people: RawPerson) -> RawMeasurement:
    return RawMeasurement(5.0, 5.0, "world", False, people)


def nearest_gap(robot, wrist: np.ndarray, links: slice = slice(None)) -> float:
    """Gap of a hand to links as segments with radii."""
    capsules, n = robot.enclosure[0], int(robot.enclosure["n"][0])
    share = np.linspace(0.0, 1.0, 4000)[:, None]
    local = capsules["a"][:n, None] + share[None] * (capsules["b"] - capsules["a"])[:n, None]
    points = place(robot, Q[None], local)[0]
    apart = np.linalg.norm(points - wrist, axis=-1).min(axis=1) - capsules["radius"][:n] - HAND_M
    return float(apart[links].min())


@pytest.mark.parametrize("depth", [0.001, 0.05, 0.1])
def test_the_depth_is_that_of_the_hand_in_the_link(parts, depth):
    robot, contacts = parts
    tip = axis_middle(robot, int(robot.enclosure["n"][0]) - 1)
    out = tip / np.linalg.norm(tip)
    far, near = 2.0, 0.0
    for _ in range(60):
        middle = 0.5 * (far + near)
        near, far = (middle, far) if nearest_gap(robot, tip + middle * out) < -depth else (near, middle)
    ((name, found),) = contacts.touching(report(somebody("p", tip + far * out)), Q, EVERY)
    assert name == "p" and found == pytest.approx(depth, abs=1e-4)


@pytest.mark.parametrize("error", [0.0, 0.05, 0.3])
def test_errors_do_not_make_a_body_larger(parts, error):
    robot, contacts = parts
    tip = axis_middle(robot, int(robot.enclosure["n"][0]) - 1)
    out = tip / np.linalg.norm(tip)
    for away in (0.0, 0.3, 0.6):
        wrist = tip + away * out
        found = contacts.touching(report(somebody("p", wrist, error)), Q, EVERY)
        assert bool(found) is (nearest_gap(robot, wrist) < 0.0)


def test_everybody_is_looked_at_and_nobody_twice(parts):
    robot, contacts = parts
    tip = axis_middle(robot, int(robot.enclosure["n"][0]) - 1)
    people = [somebody("a", tip), somebody("b", tip + np.array([3.0, 0.0, 0.0])), somebody("c", tip)]
    assert [name for name, _ in contacts.touching(report(*people), Q, EVERY)] == ["a", "c"]


def test_only_links_that_move_touch(parts):
    """The last joint turns: the hand lies at the upper arm, which stands still."""
    robot, contacts = parts
    n = int(robot.enclosure["n"][0])
    wrist = axis_middle(robot, 1)
    assert nearest_gap(robot, wrist, slice(n - 1, n)) > 0.05
    last = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    assert contacts.touching(report(somebody("p", wrist)), Q, last) == []
    assert contacts.touching(report(somebody("p", wrist)), Q, -EVERY) != []


@pytest.mark.parametrize("spoilt", ["NaN", "inferred", "another frame"])
def test_who_cannot_be_read_touches_nobody(parts, spoilt):
    robot, contacts = parts
    tip = axis_middle(robot, int(robot.enclosure["n"][0]) - 1)
    who = somebody("p", tip * np.nan if spoilt == "NaN" else tip)
    if spoilt == "inferred":
        who = who._replace(measured=0)
    told = report(who)._replace(frame="elsewhere" if spoilt == "another frame" else "world")
    assert contacts.touching(told, Q, EVERY) == []
    assert contacts.touching(report(somebody("p", tip)), Q, EVERY) != []
