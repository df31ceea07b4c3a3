"""The twin: drives hold and follow the arm, and distances are those of another engine."""

from __future__ import annotations

import sys
from collections.abc import Callable
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.planning.potential_field import Bodies, Field
from modes.twin.cell import CellTwin, Ur16eMade
from modes.twin.people import Stance, Standing
from occupancy.body import Point, load_profile
from robots.errors import SetupError
from robots.kernels import forward
from robots.model import RobotModel
from tests.source_files import ROOT

Array = NDArray[np.float64]
PROFILE = load_profile("iso")
BEGIN = np.array([0.5, -1.2, 1.4, -1.8, -1.5, 0.3])


@pytest.fixture
def ur16e(arm: Callable[[str], RobotModel]) -> RobotModel:
    return arm("ur16e")


def people(rng: np.random.Generator, count: int) -> Array:
    return np.array(
        [
            Standing(Stance(*rng.uniform(0.5, 1.5, 2), rng.uniform(-3.0, 3.0), -0.8)).at(0.0)
            for _ in range(count)
        ]
    )


def test_distances_are_those_of_the_field(
    ur16e: RobotModel, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """MuJoCo's own distances of its own geoms, against compiled capsules of another model."""
    field, seen = Field(ur16e), 0
    for _ in range(5 + count(100)):
        twin = CellTwin(ur16e, rng.uniform(-1.5, 1.5, 6), 2, PROFILE)
        points = people(rng, 2)
        if rng.uniform() < 0.5:
            points[0, [Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP, Point.HEAD]] = np.nan
        twin.put(points)
        expected = field.clearance(twin.q, Bodies.of_points([points], PROFILE))
        found = twin.nearest()
        if expected > 0.0:
            assert found.gap_m == pytest.approx(expected, abs=2e-6)
            seen += 1
        else:
            assert found.gap_m <= 1e-6
    assert seen > 0


def test_drives_hold_and_follow_the_arm(ur16e: RobotModel) -> None:
    twin = CellTwin(ur16e, BEGIN, 0, PROFILE)
    assert twin.q == pytest.approx(BEGIN, abs=1e-3)
    off = np.zeros(2)
    for k in range(1, 301):
        t = 0.01 * k
        q = BEGIN + 0.4 * (1.0 - np.cos(2.0 * t))
        dq = np.full(6, 0.8 * np.sin(2.0 * t))
        twin.go(q, dq)
        off = np.maximum(off, (np.abs(twin.q - q).max(), np.abs(twin.dq - dq).max()))
    assert twin.t == pytest.approx(3.0)
    assert off[0] < 0.002 and off[1] < 0.02, off  # what the scenario's cell declares


def test_speed_is_that_of_the_fastest_point_of_the_link(ur16e: RobotModel) -> None:
    """The base turns: points of the last link go round its axis."""
    twin = CellTwin(ur16e, BEGIN, 1, PROFILE)
    rate = 0.5
    for k in range(1, 101):
        speed = min(rate, 0.02 * k)
        twin.go(twin._wanted + 0.01 * speed * np.eye(6)[0], speed * np.eye(6)[0])
    rotations, positions = np.zeros((6, 3, 3)), np.zeros((6, 3))
    forward(ur16e.kinematics, twin.q, rotations, positions)
    place = Standing(Stance(0.0, 0.0)).at(0.0)
    place += positions[5] + (0.0, 0.0, 0.3) - place[Point.PELVIS]
    twin.put(place[None])
    found = twin.nearest()
    rows = ur16e.enclosure[0]
    row = int(np.flatnonzero(rows["joint"][: len(ur16e.links)] == found.link)[0])
    ends = [positions[found.link] + rotations[found.link] @ rows[e][row] for e in "ab"]
    radius = float(rows["radius"][row])
    least = rate * max(float(np.hypot(end[0], end[1])) for end in ends)
    assert least <= found.speed_m_s * 1.01 and found.speed_m_s <= 1.05 * (least + rate * radius)


def test_nobody_is_far_and_parts_that_are_not_there_are_nowhere(ur16e: RobotModel) -> None:
    twin = CellTwin(ur16e, BEGIN, 1, PROFILE)
    assert twin.nearest() == (10.0, -1, 0.0)
    nobody = np.full((1, 20, 3), np.nan)
    twin.put(nobody)
    assert twin.nearest(5.0) == (5.0, -1, 0.0)
    nobody[0, Point.HEAD] = 3.0, 0.0, 0.5
    twin.put(nobody)
    assert twin.nearest().gap_m < 3.0


def test_what_does_not_fit_is_refused_by_name(
    ur16e: RobotModel, arm: Callable[[str], RobotModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SetupError, match="panda is no chain of six revolute joints"):
        CellTwin(arm("panda"), np.zeros(7), 0, PROFILE)
    with pytest.raises(SetupError, match=r"0\.0105 should be a whole number of milliseconds"):
        CellTwin(ur16e, BEGIN, 0, PROFILE, 0.0105)
    with pytest.raises(SetupError, match="link_kg has 5 numbers"):
        Ur16eMade(link_kg=(1.0,) * 5)
    with pytest.raises(SetupError, match="stiffness_Nm, joint 2"):
        Ur16eMade(stiffness_Nm=(1.0, 0.0, 1.0, 1.0, 1.0, 1.0))
    twin = CellTwin(ur16e, BEGIN, 1, PROFILE)
    with pytest.raises(SetupError, match="2 people are put, the model was made for 1"):
        twin.put(np.zeros((2, 20, 3)))
    with pytest.raises(SetupError, match="twin: q"):
        twin.go(np.full(6, np.nan), np.zeros(6))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(SetupError, match=r"pip install 'stopproof\[twin\]'"):
        CellTwin(ur16e, BEGIN, 0, PROFILE)


def test_masses_are_those_of_the_catalogue() -> None:
    root = ElementTree.parse(ROOT / "robots/models/ur16e.urdf").getroot()
    masses = {
        str(link.get("name")): float(str(mass.get("value")))
        for link in root.iter("link")
        if (mass := link.find("inertial/mass")) is not None
    }
    links = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    assert tuple(masses[f"{each}_link"] for each in links) == tuple(Ur16eMade().link_kg)
