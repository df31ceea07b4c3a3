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
from tests.modes.planning.gaps import axis_gaps
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


def test_a_link_that_rests_deeper_in_somebody_hides_none_that_moves(ur16e: RobotModel) -> None:
    """Only the wrist turns: the upper arm rests, deep in somebody whose hand is beside the wrist."""
    twin = CellTwin(ur16e, BEGIN, 1, PROFILE)
    for k in range(1, 51):
        speed = min(0.5, 0.02 * k)
        twin.go(twin._wanted + 0.01 * speed * np.eye(6)[4], speed * np.eye(6)[4])
    moving = twin.moving(0.01)
    assert moving == {4, 5} and twin.moving(-1.0) == set(range(6)) and not twin.moving(10.0)
    rotations, positions = np.zeros((6, 3, 3)), np.zeros((6, 3))
    forward(ur16e.kinematics, twin.q, rotations, positions)
    row = int(np.flatnonzero(ur16e.enclosure[0]["joint"][: len(ur16e.links)] == 1)[0])
    ends = [positions[1] + rotations[1] @ ur16e.enclosure[0][e][row] for e in "ab"]
    body = np.full((20, 3), np.nan)
    body[Point.HEAD] = 0.5 * (ends[0] + ends[1])
    body[[Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP]] = positions[5]
    twin.put(body[None])
    both, rests, moves = (twin.nearest(1.0, links) for links in (range(6), set(range(6)) - moving, moving))
    assert both == rests and rests.link not in moving and rests.speed_m_s <= 0.01
    assert moves.link in moving and moves.gap_m < 0.0 and moves.speed_m_s > 0.01
    assert twin.nearest(1.0, ()) == (1.0, -1, 0.0)


def test_distances_are_exact_for_capsules_of_any_length_that_overlap_too(
    ur16e: RobotModel, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Closed form: of axes, less both radii. Parallel ones and balls are among them."""
    twin = CellTwin(ur16e, BEGIN, 1, PROFILE)
    rotations, positions = np.zeros((6, 3, 3)), np.zeros((6, 3))
    forward(ur16e.kinematics, twin.q, rotations, positions)
    rows, k = ur16e.enclosure[0], len(ur16e.links)
    joints = rows["joint"][:k]
    p, q = (positions[joints] + np.einsum("kij,kj->ki", rotations[joints], rows[e][:k]) for e in "ab")
    for _ in range(50 + count(5000)):
        one = int(rng.integers(k))
        a = p[one] + rng.normal(size=3) * rng.choice([0.02, 0.3])
        along = (q - p)[one] if rng.uniform() < 0.3 else rng.normal(size=3)
        b = a + along * rng.choice([0.0, 1e-9, 1e-3, 0.3])
        body = np.full((20, 3), np.nan)
        body[Point.L_ELBOW], body[Point.L_WRIST] = a, b
        twin.put(body[None])
        parts = Bodies.of_points([body[None]], PROFILE)
        gaps = (
            axis_gaps(p[:, None], q[:, None], parts.a[0], parts.b[0])
            - parts.radius
            - rows["radius"][:k, None]
        )
        assert twin.nearest().gap_m == pytest.approx(float(gaps.min()), abs=3e-6)


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
    for change, named in (
        ({"people": -1}, "twin: people = -1"),
        ({"people": 1.5}, r"twin: people = 1\.5"),
        ({"profile": "iso"}, "twin: profile = 'iso'"),
        ({"made": 3}, "twin: made = 3"),
        ({"robot": "ur16e"}, "twin: robot = 'ur16e'"),
        ({"q": np.zeros(7)}, "twin: q"),
    ):
        with pytest.raises(SetupError, match=named):
            CellTwin(**{"robot": ur16e, "q": BEGIN, "people": 0, "profile": PROFILE, **change})  # type: ignore[arg-type]  # what is to be refused
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
