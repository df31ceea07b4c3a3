"""Wrong turns that concern distances, sweeps and what is compared; the numbers are those of
docs/wrong_turns.md."""

from __future__ import annotations

import numpy as np
import pytest

from occupancy import workspace
from occupancy.separation import Separation, open_obligations
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy
from occupancy.workspace import Workspace
from robots.catalog import RobotSetup, load_robot, robot_names
from robots.errors import SetupError
from robots.limits import JointLimits
from robots.model import Mount
from tests.occupancy.arms import ARMS, Motion, arm, axis_points, place, random_motion
from tests.occupancy.pairs import collinear, parallel
from tests.occupancy.scenes import blocks, write_row
from tests.occupancy.test_workspace import pose, tetrahedra_of_a_box
from tests.oracles.hulls import distance, exact_point_distance, pad, point_distance
from tests.verifier.scenes import CELL, Scene, at_rest
from tests.verifier.scenes import swing as swing_of
from verifier import Cell, Reason, Status, verify
from verifier.cell import Cell as CellOfSupervisor
from verifier.setup import build_supervised
from verifier.verdict import CriterionKind


@pytest.mark.parametrize("kind", [parallel, collinear], ids=lambda kind: kind.__name__)
def test_peer_05_parallel_and_collinear_segments_are_not_apart_by_more_than_they_are(kind, rng, count):
    """The formula for two lines divides by the sine of their angle: parallel ones come out metres too far."""
    drawn = [kind(rng) for _ in range(count(5_000))]
    between = np.array([[pad(a), pad(b)] for a, b in drawn])
    true = distance(between[:, 0], between[:, 1])
    separation = Separation(0.0)
    links, people, ledger = blocks(1, 1, [1])
    proven = 0
    for (a, b), apart in zip(drawn, true, strict=True):
        links["n"] = people["n"] = 0
        write_row(links, a, 0.01)
        write_row(people, b, 0.02)
        open_obligations(ledger, 1, 1, [1])
        answer = separation.check(links, people, ledger)
        assert answer.gap_m <= apart - 0.03 + 1e-12
        assert answer.separated == (ledger["open"][0, 0, 0, 0] == 0)
        assert not (answer.separated and apart <= 0.03)
        proven += answer.separated and apart > 0.03
    assert proven > 0


@pytest.mark.parametrize("name", ARMS)
def test_peer_11_the_allowance_for_curvature_is_a_bound(name, rng, count):
    """What a link leaves the chord by is a setting: too small for whatever turns fast on long slices."""
    for _ in range(count(2_000)):
        model = arm(name, rng)
        motion = random_motion(model, rng)
        out, n = new_link_sets(), int(model.enclosure[0]["n"])
        LinkOccupancy(model).occupy(motion.slices(), out)
        rows = out[0]
        room = rows["radius"][:n] - model.enclosure[0]["radius"][:n]
        t = np.linspace(0.0, motion.h, 9)[:, None]
        points = place(model, motion.actual(t), axis_points(model, np.array([0.0, 1.0])))
        apart = point_distance(points, rows["points"][:n, None, :, :])
        for i, link, k in np.argwhere(apart > room[None, :, None] + 1e-12):
            apart[i, link, k] = exact_point_distance(points[i, link, k], rows["points"][link])
        assert (apart <= room[None, :, None] + 1e-12).all()


@pytest.mark.parametrize("name", ARMS)
def test_peer_12_the_speed_of_a_link_is_that_of_the_whole_interval(name, rng, count):
    """Speed is taken where the interval begins, without what turning adds: who speeds up is faster."""
    faster = 0
    for _ in range(count(2_000)):
        model = arm(name, rng)
        drawn = random_motion(model, rng)
        motion = Motion(drawn.h, drawn.coefficients, np.zeros_like(drawn.error), drawn.frequency, drawn.phase)
        out, n = new_link_sets(), int(model.enclosure[0]["n"])
        LinkOccupancy(model).occupy(motion.slices(), out)
        t, h = np.linspace(0.0, motion.h, 9), 1e-6
        local = axis_points(model, np.array([0.0, 0.5, 1.0]))
        near = [place(model, motion.command(each[:, None])[0], local) for each in (t - h, t + h)]
        speed = np.linalg.norm((near[1] - near[0]) / (2.0 * h), axis=-1).max(axis=-1)
        bound = out[0]["speed_max"][:n]
        assert (speed.max(axis=0) <= bound + 1e-6).all()
        faster += (speed.max(axis=0) > 1.05 * speed[0] + 1e-3).any()
    assert faster > 0, "nothing was faster than at the begin of its interval"


def test_peer_13_a_box_is_no_farther_away_than_it_is(rng, count):
    """Distances to a box are wrong for capsules that lie along an edge, across a face or inside."""
    every = np.ones(24, dtype=np.uint8)
    proven = 0
    for _ in range(count(5_000)):
        model = arm("one_turning", rng)
        motion = Motion(0.01, np.zeros((4, 1)), *(np.zeros(1) for _ in range(3)))
        out = new_link_sets()
        LinkOccupancy(model).occupy(motion.slices(), out)
        axis = out[0]["points"][0, [0, 1]]
        size, there = rng.uniform(0.02, 1.0, 3), pose(rng)
        if rng.random() < 0.5:  # along a face or an edge of it
            along = axis[1] - axis[0]
            third = np.cross(along, rng.normal(size=3))
            x, z = along / np.linalg.norm(along), third / np.linalg.norm(third)
            turned = np.column_stack([x, np.cross(z, x), z])
            aside = (0.5 * size + rng.uniform(0.0, 0.4, 3)) * [0.0, 1.0, 1.0]
            there = Mount(turned, axis.mean(axis=0) + turned @ aside)
        solid = tetrahedra_of_a_box(size, there)
        gaps = distance(np.broadcast_to(pad(axis), solid.shape), solid)
        true = float(gaps.min()) - float(out[0]["radius"][0])
        fixture = workspace.box("box", size, there, 0.0)
        criterion = Workspace((fixture,), model.links, {}, 0.0)
        found = criterion.check(out, motion.slices(), every)
        assert found is not None or true > 0.0
        assert found is None or found.gap_m <= true + 1e-9
        proven += found is None
    assert proven > 0


def test_peer_16_what_is_switched_off_does_not_verify(tmp_path):
    """A shield that is switched off answers yes to everything, in the words of one that has looked."""
    path = Scene(duration=1.0).write(tmp_path / "r.mcap")
    checked = verify(path, Cell.from_table(CELL))
    waived = verify(path, Cell.from_table(CELL), assume_nobody=True)
    assert checked.exit_status == 0 and not checked.waived
    assert waived.exit_status == 3 and any("assume-nobody" in text for text in waived.waived)
    reasons = {Reason(int(each)) for each in waived.per_cycle.reason}
    assert Reason.SEPARATED not in reasons and Reason.NOBODY_ASSUMED in reasons
    assert "nobody is there" in "\n".join(waived.lines()[:3])
    # a supervisor cannot be told to look away, and says of every step what it does not look at
    table = {**CELL, "robot": {**CELL["robot"], "name": "ur5", "tracking": {"position_error_rad": 0.001}}}
    parts = build_supervised(CellOfSupervisor.from_table(table))
    assert not parts.check.settings.assume_nobody
    for kind in (CriterionKind.SELF_COLLISION, CriterionKind.WORKSPACE, CriterionKind.TORQUE):
        assert parts.check.not_checked >> kind & 1
    assert not parts.check.not_checked >> CriterionKind.SEPARATION & 1


def test_peer_18_every_joint_has_a_range(some):
    """One way of making limits filled the lower ones with the upper ones: no position is allowed, or all."""
    one = np.ones(1)
    for lower, upper in ((1.0, 1.0), (2.0, 1.0), (np.nan, 1.0), (0.0, np.nan)):
        with pytest.raises(SetupError, match="must be below"):
            JointLimits(("j",), lower * one, upper * one, one, one, one, one)
    for name in some(robot_names(), 5):
        limits = load_robot(name, setup=RobotSetup(bare_flange=True)).limits
        assert (limits.position_lower < limits.position_upper).all(), name


FLOOR = {"workspace": {"floor_z_m": 0.0}}
POST = {
    "workspace": {
        "fixtures": {
            "post": {"kind": "capsule", "a_m": [0.6, 0.0, -1.0], "b_m": [0.6, 0.0, 1.0], "radius_m": 0.3},
        },
    },
}
SELF = {"criteria": {"self_collision": True}}


def folding(t: float) -> np.ndarray:
    """The elbow closes until the forearm lies on the upper arm."""
    return np.array([0.0, -1.2, min(3.1, 1.3 + 2.5 * t), -0.4, 0.0, 0.0])


def ducking(t: float) -> np.ndarray:
    """Down to the plane that the arm stands on."""
    return np.array([0.0, -1.2 + 1.0 * t, 1.3, -0.4, 0.0, 0.0])


@pytest.mark.parametrize(
    ("table", "motion", "reason", "kind"),
    [
        (FLOOR, ducking, Reason.FIXTURE_IN_REACH, CriterionKind.WORKSPACE),
        (POST, swing_of, Reason.FIXTURE_IN_REACH, CriterionKind.WORKSPACE),
        (SELF, folding, Reason.LINKS_IN_REACH, CriterionKind.SELF_COLLISION),
    ],
    ids=["floor", "fixture", "self-collision"],
)
def test_peer_19_floor_fixtures_and_the_arm_itself_are_checked(table, motion, reason, kind, tmp_path):
    """Only people are looked at: the arm may drive into the floor, a post or itself."""
    path = Scene(motion=motion, duration=1.2).write(tmp_path / "r.mcap")
    with_it = verify(path, Cell.from_table(CELL | table))
    assert reason in {Reason(int(each)) for each in with_it.per_cycle.reason}
    without = verify(path, Cell.from_table(CELL))
    assert reason not in {Reason(int(each)) for each in without.per_cycle.reason}
    assert any(line.startswith("not checked:") and kind.name.lower() in line for line in without.lines())
    resting = verify(Scene(motion=at_rest, duration=0.5).write(tmp_path / "s.mcap"), Cell.from_table(CELL))
    assert resting.count(Status.VERIFIED) > 0
