"""The brute-force checker against pinocchio, coal, ruckig, an exhaustive search and closed forms."""

from __future__ import annotations

import ast
from pathlib import Path

import coal
import numpy as np
import pinocchio
import pytest
import ruckig

from tests.oracles import brute_force, clamping, contact_rules
from tests.oracles.approach_search import slack_of
from tests.oracles.arms import ARMS, MESH_ARMS, arm, share_folder, urdf_file
from tests.oracles.brute_force import chase, lean_towards, nearest_approach
from tests.oracles.mesh_points import box_triangles, read_triangles, surface_points
from tests.oracles.situation import Motion, Person, Segment
from tests.oracles.stop_profile import fastest_stop
from tests.oracles.urdf_arm import Arm

CORE = {"robots", "occupancy", "failsafe", "verifier", "modes"}
DATA_TYPES: set[str] = set()
"""Data types of the core that the checker imports: none."""

TREE = """<robot name="tree">
  <link name="base"/>
  <link name="slide">
    <collision><origin xyz="0.1 0 0" rpy="0.3 0 0"/><geometry><box size="0.1 0.2 0.3"/></geometry></collision>
  </link>
  <link name="wheel"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <link name="plate"><visual><geometry><box size="0.2 0.01 0.1"/></geometry></visual></link>
  <link name="echo"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <joint name="j_slide" type="prismatic">
    <parent link="base"/><child link="slide"/><origin xyz="0 0.1 0.4" rpy="0.1 0.2 0.3"/>
    <axis xyz="1 2 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="j_wheel" type="continuous">
    <parent link="slide"/><child link="wheel"/><origin xyz="0.2 0 0" rpy="1 0 -2"/><axis xyz="0 1 1"/>
  </joint>
  <joint name="j_plate" type="fixed">
    <parent link="wheel"/><child link="plate"/><origin xyz="0 0 0.2" rpy="0 0.5 0"/>
  </joint>
  <joint name="j_echo" type="revolute">
    <parent link="plate"/><child link="echo"/><origin xyz="0.1 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
    <mimic joint="j_slide" multiplier="-2" offset="0.25"/>
  </joint>
</robot>"""

SLIDER = """<robot name="slider">
  <link name="rail"/>
  <link name="box"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <joint name="x" type="prismatic"><parent link="rail"/><child link="box"/><axis xyz="1 0 0"/></joint>
</robot>"""


def modules(start: Path) -> list[Path]:
    """Files of this folder that ``start`` imports, directly or not."""
    found, queue = [], [start]
    while queue:
        file = queue.pop()
        if file not in found:
            found.append(file)
            queue += [
                start.parent / f"{name.rsplit('.', 1)[-1]}.py"
                for name in imports(file)
                if name.startswith("tests.")
            ]
    return found


def imports(file: Path) -> list[str]:
    names: list[str] = []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module is not None
            names.append(node.module)
            names += [f"{node.module}.{alias.name}" for alias in node.names if node.module == "tests.oracles"]
        elif isinstance(node, ast.Call):
            assert not (isinstance(node.func, ast.Name) and node.func.id in ("__import__", "eval", "exec"))
    return names


def test_checker_imports_nothing_of_the_core_but_data_types() -> None:
    starts = (brute_force, clamping, contact_rules)
    files = {file for start in starts for file in modules(Path(start.__file__))}
    assert {file.name for file in files} >= {
        "brute_force.py",
        "approach_search.py",
        "urdf_arm.py",
        "mesh_points.py",
        "clamping.py",
        "contact_rules.py",
    }
    for file in files:
        shared = {name for name in imports(file) if name.split(".")[0] in CORE}
        assert shared <= DATA_TYPES, f"{file.name} imports {shared - DATA_TYPES}"
        assert "importlib" not in imports(file)


@pytest.mark.parametrize("name", [*ARMS, "tree"])
def test_kinematics_agree_with_pinocchio(name: str, rng: np.random.Generator, tmp_path: Path) -> None:
    if name == "tree":
        file = tmp_path / "tree.urdf"
        file.write_text(TREE, encoding="utf-8")
        mine = Arm(file, {}, ["j_slide", "j_wheel"], rng)
        assert mine.links == ("slide", "wheel", "plate", "echo")
    else:
        file, mine = urdf_file(name), arm(name)
    model = (
        pinocchio.buildModelFromUrdf(str(file), mimic=True)
        if name == "tree"
        else pinocchio.buildModelFromUrdf(str(file))
    )
    data = model.createData()
    q = rng.uniform(-2.0, 2.0, (20, len(mine.joints)))
    free = {joint.name: rng.uniform(joint.lower, joint.upper) for joint in mine.free}
    rotations, positions = mine.poses(q, free)
    for sample in range(len(q)):
        full = pinocchio.neutral(model)
        for i, joint in enumerate(model.names):
            if i == 0 or model.joints[i].nq == 0:
                continue
            value = free.get(joint, q[sample, mine.joints.index(joint)] if joint in mine.joints else None)
            value = free["panda_finger_joint1"] if joint == "panda_finger_joint2" else value
            at = model.joints[i].idx_q
            if model.joints[i].nq == 2:
                full[at : at + 2] = np.cos(value), np.sin(value)
            elif joint != "j_echo":
                full[at] = value
        pinocchio.framesForwardKinematics(model, data, full)
        for index, link in enumerate(mine.links):
            placement = data.oMf[model.getFrameId(link)]
            np.testing.assert_allclose(rotations[index, sample], placement.rotation, atol=1e-12)
            np.testing.assert_allclose(positions[index, sample], placement.translation, atol=1e-12)


@pytest.mark.parametrize("name", MESH_ARMS)
def test_meshes_agree_with_the_loader_of_coal(name: str) -> None:
    text = urdf_file(name).read_text(encoding="utf-8")
    uris = {part.split('"')[0] for part in text.split('filename="package://example-robot-data/')[1:]}
    assert len(uris) > 10
    for uri in uris:
        file = share_folder() / uri
        corners = read_triangles(file).reshape(-1, 3)
        theirs = coal.MeshLoader().load(str(file), np.ones(3)).vertices()
        np.testing.assert_allclose(corners.min(axis=0), theirs.min(axis=0), atol=2e-6)
        np.testing.assert_allclose(corners.max(axis=0), theirs.max(axis=0), atol=2e-6)


def test_surface_points_are_spread_by_area(rng: np.random.Generator) -> None:
    size = np.array([0.1, 0.2, 0.4])
    points = surface_points(box_triangles(size), 20_000, rng)
    distance = np.abs(np.abs(points) - 0.5 * size)
    assert distance.min(axis=1).max() < 1e-12
    assert (np.abs(points) <= 0.5 * size + 1e-12).all()
    share = np.array([np.mean(distance[:, i] < 1e-9) for i in range(3)])
    faces = np.prod(size) / size
    np.testing.assert_allclose(share, faces / faces.sum(), atol=0.02)


def test_slack_is_the_minimum_along_the_part(rng: np.random.Generator) -> None:
    for _ in range(300):
        p, a, b = rng.uniform(-1.0, 1.0, (3, 3)) * rng.choice([1.0, 0.1], (3, 1))
        b = a if rng.random() < 0.1 else b
        ga, gb = rng.uniform(0.0, 0.5, 2) if rng.random() < 0.8 else (0.2, 0.2)
        slack, share = slack_of(p[None], a, b, np.array([ga]), np.array([gb]), np.array(0.1))
        grid = np.linspace(0.0, 1.0, 20_001)[:, None]
        reach = (1.0 - grid[:, 0]) * ga + grid[:, 0] * gb + 0.1
        exact = (np.linalg.norm(p - (1.0 - grid) * a - grid * b, axis=1) - reach).min()
        assert slack[0] == pytest.approx(exact, abs=1e-6)
        assert 0.0 <= share[0] <= 1.0


def random_people(rng: np.random.Generator, number: int) -> list[Person]:
    return [
        Person(
            points=rng.uniform(-0.4, 0.4, (6, 3)) + rng.uniform(0.3, 1.2) * np.array([1.0, 0.0, 0.5]),
            slack=np.full(6, 0.02) if rng.random() < 0.5 else rng.uniform(0.0, 0.1, 6),
            seen=np.full(6, -0.1) if rng.random() < 0.5 else rng.uniform(-0.3, 0.0, 6),
            speed=2.0,
            parts=tuple(Segment(f"part {i}", i, (i + 1) % 6 if i < 5 else i, 0.1) for i in range(6)),
        )
        for _ in range(number)
    ]


def random_motion(rng: np.random.Generator, joints: int, samples: int) -> Motion:
    time = 0.7e-3 * np.arange(samples)
    q = rng.uniform(-1.5, 1.5, joints) + 0.3 * np.sin(rng.uniform(1.0, 6.0, joints) * time[:, None])
    return Motion(time, q)


def test_search_finds_what_an_exhaustive_search_finds(rng: np.random.Generator) -> None:
    small = arm("ur3")
    for _ in range(6):
        motion, people = random_motion(rng, 6, 20), random_people(rng, 2)
        found = nearest_approach(small, motion, people, 1e-3)
        assert found is not None
        rotations, positions = small.poses(motion.q)
        exact = min(
            slack_of(
                np.einsum("tij,pj->tpi", rotations[link], points) + positions[link][:, None],
                person.points[part.start],
                person.points[part.end],
                person.growth(motion.time)[:, part.start, None],
                person.growth(motion.time)[:, part.end, None],
                np.array(part.radius),
            )[0].min()
            for link, points in enumerate(small.points)
            for person in people
            for part in person.parts
        )
        assert found.slack == pytest.approx(exact, abs=1e-12)


def test_links_at_rest_may_be_touched(rng: np.random.Generator) -> None:
    small, people = arm("ur3"), random_people(rng, 1)
    time = 1e-3 * np.arange(50)
    assert nearest_approach(small, Motion(time, np.ones((50, 6))), people, 1e-3) is None
    q = np.ones((50, 6))
    q[:, 5] += time
    found = nearest_approach(small, Motion(time, q), people, 1e-3)
    assert found is not None and found.link in ("wrist_3_link", "ee_link")


@pytest.mark.parametrize("field", ["q", "time", "points", "slack", "seen", "allowed"])
def test_numbers_that_are_not_finite_are_refused(field: str, rng: np.random.Generator) -> None:
    motion, person = random_motion(rng, 6, 5), random_people(rng, 1)[0]
    allowed = {part.name: np.full(7, 1e-3) for part in person.parts}
    holder = motion if field in ("q", "time") else person
    target = allowed["part 3"] if field == "allowed" else getattr(holder, field)
    target.flat[1] = np.nan
    with pytest.raises(ValueError, match="finite"):
        nearest_approach(arm("ur3"), motion, [person], allowed)


def sliding_box(tmp_path: Path, rng: np.random.Generator) -> Arm:
    file = tmp_path / "slider.urdf"
    file.write_text(SLIDER, encoding="utf-8")
    return Arm(file, {}, ["x"], rng, points_per_link=4000)


@pytest.mark.parametrize("distance", [0.5, 0.9])
def test_slider_towards_a_ball_in_closed_form(
    distance: float, tmp_path: Path, rng: np.random.Generator
) -> None:
    """Box front at 0.05 + t; ball of radius 0.1 seen at t = -0.1 within 0.02 and coming at 2 m/s."""
    slider = sliding_box(tmp_path, rng)
    time = np.linspace(0.0, 0.1, 101)
    motion = Motion(time, time[:, None].copy())
    ball = Person(
        np.array([[distance, 0.0, 0.0]]),
        np.array([0.02]),
        np.array([-0.1]),
        2.0,
        (Segment("ball", 0, 0, 0.1),),
    )
    found = nearest_approach(slider, motion, [ball], 1e-3)
    assert found is not None
    assert found.slack == pytest.approx(distance - 0.67, abs=2e-5)
    assert found.time == pytest.approx(0.1)
    contact = chase(slider, motion, ball, found, 1e-3)
    if distance > 0.67:
        assert contact is None
    else:
        assert contact is not None and contact.fastest_point <= 2.0 * (1 + 1e-6)


def test_a_part_is_compared_only_while_the_link_is_too_fast_for_it(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """Box front at 0.05 + t, from 0.05 s on at 0.2 m/s; two balls of radius 0.1 at rest in its way."""
    slider = sliding_box(tmp_path, rng)
    time = np.linspace(0.0, 0.1, 101)
    way = np.minimum(time, 0.05) + 0.2 * np.maximum(time - 0.05, 0.0)
    motion = Motion(time, way[:, None])
    near, far = Segment("near", 0, 0, 0.1), Segment("far", 1, 1, 0.1)
    balls = Person(np.array([[0.3, 0.0, 0.0], [0.4, 0.0, 0.0]]), np.zeros(2), np.zeros(2), 0.0, (near, far))
    for limits, part, left, last in (
        ((0.1, 0.1), "near", 0.09, 0.1),
        ((0.5, 0.1), "near", 0.101, 0.049),
        ((1.5, 0.1), "far", 0.19, 0.1),
        ((1.5, 0.5), "far", 0.201, 0.049),
    ):
        allowed = {"near": np.array([limits[0]]), "far": np.array([limits[1]])}
        found = nearest_approach(slider, motion, [balls], allowed)
        assert found is not None and found.part.name == part
        assert found.slack == pytest.approx(left, abs=2e-5) and found.time == pytest.approx(last)
        assert chase(slider, motion, balls, found, allowed) is None
    fast = {"near": np.array([1.5]), "far": np.array([1.1])}
    assert nearest_approach(slider, motion, [balls], fast) is None


def test_chase_brings_about_every_contact_that_is_reported(rng: np.random.Generator) -> None:
    small, seen = arm("ur3"), [0, 0]
    for _ in range(25):
        motion, people = random_motion(rng, 6, 60), random_people(rng, 1)
        found = nearest_approach(small, motion, people, 1e-3)
        assert found is not None
        contact = chase(small, motion, people[0], found, 1e-3)
        assert (contact is not None) == (found.slack <= 1e-9)
        seen[contact is not None] += 1
    assert min(seen) > 3


def test_joint_errors_lean_towards_the_person(rng: np.random.Generator) -> None:
    small, nearer = arm("ur3"), 0
    for _ in range(10):
        motion, people = random_motion(rng, 6, 10), random_people(rng, 1)
        found = nearest_approach(small, motion, people, 1e-3)
        assert found is not None
        error = lean_towards(small, motion, found, np.full(6, 0.01))
        np.testing.assert_array_equal(np.abs(error), 0.01)
        leaning = nearest_approach(small, Motion(motion.time, motion.q + error), people, 1e-3)
        assert leaning is not None
        nearer += leaning.slack < found.slack
    assert nearer == 10


def test_fastest_stop_against_ruckig(rng: np.random.Generator) -> None:
    generator, request, theirs = ruckig.Ruckig(1), ruckig.InputParameter(1), ruckig.Trajectory(1)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.current_position = [0.0]
    for _ in range(500):
        a_limit, j_limit = rng.uniform(0.5, 20.0), rng.uniform(1.0, 400.0)
        v, a = rng.uniform(-2.0, 2.0), rng.uniform(-a_limit, a_limit)
        mine = fastest_stop(0.0, v, a, a_limit, j_limit)
        _, velocity, acceleration = mine.sample(np.array([mine.duration]))
        assert abs(velocity[0]) < 1e-12 and abs(acceleration[0]) < 1e-10
        request.current_velocity, request.current_acceleration = [v], [a]
        request.max_acceleration, request.max_jerk = [a_limit], [j_limit]
        assert generator.calculate(request, theirs) >= 0
        assert mine.duration == pytest.approx(theirs.duration, abs=1e-9)
        at = rng.uniform(0.0, mine.duration)
        position, velocity, acceleration = theirs.at_time(at)
        np.testing.assert_allclose(
            [x[0] for x in mine.sample(np.array([at]))],
            [position[0], velocity[0], acceleration[0]],
            atol=1e-9,
        )
