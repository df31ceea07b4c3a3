"""Capsules contain all link geometry wherever the arm is; what is kept between runs is checked again."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import robots.enclosure
import robots.geometry
from robots.assumption import Certainty
from robots.capsule import Capsule
from robots.catalog import RobotSetup, load_robot
from robots.enclosure import CERTAINTIES, MAX_LINKS, EnclosedPart, default_cache_dir, prove
from robots.errors import SetupError
from robots.geometry import locked_range
from robots.kernels import forward
from robots.mesh_rules import StatedPlaces
from robots.model import RobotModel, Tree, read_tree
from robots.urdf import parse_urdf
from tests.robots.made_up import full_limits, joint, link, random_tree, robot, shape
from tests.robots.pin_oracle import PinArm, urdf_of
from tests.robots.test_mesh_rules import written

Array = NDArray[np.float64]


def distance_to_segments(points: Array, a: Array, b: Array) -> Array:
    """(rows, N) distances of points (N, 3) from segments (rows, 3)."""
    axis = b - a
    length2 = np.maximum((axis * axis).sum(axis=1), 1e-300)
    along = np.clip(np.einsum("nrk,rk->rn", points[:, None] - a, axis) / length2[:, None], 0, 1)
    return np.asarray(np.linalg.norm(points - a[:, None] - along[..., None] * axis[:, None], axis=-1))


def surface(item: Any, rng: np.random.Generator) -> Array:
    """Points on a geometry object, in its own frame: all vertices, and points between them."""
    geometry = item.geometry
    if not hasattr(geometry, "vertices"):
        return primitive_points(geometry, rng)
    vertices = np.array(geometry.vertices())
    chosen = rng.choice(geometry.num_tris, min(200, geometry.num_tris), replace=False)
    corners = np.array([[geometry.tri_indices(int(i))[k] for k in range(3)] for i in chosen])
    weights = rng.dirichlet(np.ones(3), len(corners))
    inner = np.einsum("nk,nkj->nj", weights, vertices[corners])
    return np.vstack([vertices, inner])


def primitive_points(geometry: Any, rng: np.random.Generator) -> Array:
    around = rng.normal(size=(300, 3))
    around /= np.linalg.norm(around, axis=1)[:, None]
    kind = type(geometry).__name__
    if kind == "Box":
        return np.asarray(around / np.abs(around).max(axis=1)[:, None] * geometry.halfSide)
    if kind == "Sphere":
        return np.asarray(geometry.radius * around)
    assert kind == "Cylinder"
    rim = around[:, :2] / np.linalg.norm(around[:, :2], axis=1)[:, None] * geometry.radius
    return np.column_stack([rim, rng.choice([-1, 1], 300) * geometry.halfLength])


def check_geometry_inside(
    model: RobotModel, oracle: PinArm, rng: np.random.Generator, number: int
) -> dict[str, float]:
    """Every shape lies in one capsule of its joint, at random positions of all joints, locked ones included.

    Returns the slack by link: how far, at least, its points stayed below the radius.
    """
    rows, n = model.enclosure[0], len(model.joints)
    rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
    shapes = [
        (name, carrier(model, oracle, item.parentJoint), item, surface(item, rng))
        for name, item in oracle.shapes()
        if name not in model.fixed_links
    ]
    slack: dict[str, float] = {}
    for _ in range(number):
        full = dict(zip(list(oracle.model.names)[1:], random_positions(oracle, rng), strict=True))
        oracle.place(full)
        forward(model.kinematics, np.array([full[name] for name in model.joints]), rotations, positions)
        for name, own, item, local in shapes:
            on = np.flatnonzero(rows["joint"][: rows["n"]] == own)
            a, b = (rows[end][on] @ rotations[own].T + positions[own] for end in ("a", "b"))
            pose = oracle.mount * oracle.data.oMi[item.parentJoint] * item.placement
            points = local @ pose.rotation.T + pose.translation
            outside = distance_to_segments(points, a, b).max(axis=1) - rows["radius"][on]
            slack[name] = min(slack.get(name, np.inf), -float(outside.min()))
    return slack


def carrier(model: RobotModel, oracle: PinArm, joint_id: int) -> int:
    """The commanded joint, as the model counts, that moves what hangs on a joint, as pinocchio counts."""
    while oracle.model.names[joint_id] not in model.joints:
        joint_id = oracle.model.parents[joint_id]
    return model.joints.index(oracle.model.names[joint_id])


def random_positions(oracle: PinArm, rng: np.random.Generator) -> Iterator[float]:
    for i, entry in enumerate(list(oracle.model.joints)[1:], start=1):
        free = entry.nq == 2
        lower = -7.0 if free else oracle.model.lowerPositionLimit[entry.idx_q]
        upper = 7.0 if free else oracle.model.upperPositionLimit[entry.idx_q]
        assert i == entry.id
        yield float(rng.choice([lower, upper, rng.uniform(lower, upper)]))


@pytest.mark.parametrize("name", ["ur3", "ur5", "ur10", "panda"])
def test_all_meshes_of_an_arm_lie_in_its_capsules(
    name: str, arm: Callable[[str], RobotModel], rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    model, oracle = arm(name), PinArm(urdf_of(name))
    slack = check_geometry_inside(model, oracle, rng, count(300))
    assert set(slack) >= set(model.links)
    assert min(slack.values()) >= -1e-9, slack
    # Small: each capsule is touched by its link.
    assert all(slack[link] < 0.002 for link in model.links if "finger" not in link), slack


def test_made_up_trees_with_locked_joints_lie_in_their_capsules(
    write_urdf: Callable[[str], Path], cache_dir: Path, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    locked = 0
    for _ in range(max(4, count(100))):
        n = int(rng.integers(2, 6))
        path = write_urdf(random_tree(rng, n))
        oracle = PinArm(path)
        parent = {joint.id: oracle.model.parents[joint.id] for joint in list(oracle.model.joints)[1:]}
        commanded = {1, *(i for i in parent if parent[i] in (0, 1) and rng.random() < 0.5)}
        names = tuple(oracle.model.names[i] for i in sorted(commanded))
        slides = [f'name="{name}" type="prismatic"' in path.read_text() for name in names]
        limits = full_limits(names, slides)
        model = load_robot(path, setup=RobotSetup(commanded=names, limits=limits, cache_dir=cache_dir))
        assert model.joints == names
        locked += n - len(names)
        slack = check_geometry_inside(model, oracle, rng, 10)
        assert min(slack.values()) >= -1e-9, slack
    assert locked


@pytest.mark.rarely("test_made_up_trees_with_locked_joints_lie_in_their_capsules")
def test_an_arm_of_which_one_joint_is_commanded_is_enclosed_with_few_balls(
    cache_dir: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five endless joints in a row would make 33 times the balls each, and minutes of work."""
    fit, sizes = robots.enclosure.fit_capsule, list[int]()

    def counted(balls: Array) -> Capsule:
        sizes.append(len(balls))
        return fit(balls)

    monkeypatch.setattr(robots.enclosure, "fit_capsule", counted)
    setup = RobotSetup(commanded=("shoulder_pan_joint",), bare_flange=True, cache_dir=cache_dir)
    model, oracle = load_robot("ur5", setup=setup), PinArm(urdf_of("ur5"))
    assert model.joints == ("shoulder_pan_joint",) and 0 < max(sizes) < 20_000
    slack = check_geometry_inside(model, oracle, rng, 30)
    assert min(slack.values()) >= -1e-9, slack


def test_volumes_of_named_arms_stay_near_the_hulls(arm: Callable[[str], RobotModel]) -> None:
    """A ball around a cube has 2.7 times its volume; an arm's capsules are to stay below that."""
    from scipy.spatial import ConvexHull

    model, oracle = arm("ur5"), PinArm(urdf_of("ur5"))
    rows = model.enclosure[0]
    for i, name in enumerate(model.links):
        shapes = [item for owner, item in oracle.shapes() if owner == name]
        hull = ConvexHull(np.vstack([np.array(item.geometry.vertices()) for item in shapes])).volume
        capsule = Capsule(rows["a"][i], rows["b"][i], rows["radius"][i])
        assert hull < capsule.volume < 2.0 * hull, name


def test_a_capsule_that_is_too_small_is_not_accepted() -> None:
    corners = np.array([[0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.1]])
    good = Capsule(np.zeros(3), np.array([1.0, 0, 0]), 0.1 + 1e-9)
    prove(EnclosedPart("arm", 0, good, corners, Certainty.COMPUTED, ""))
    for capsule in (
        Capsule(good.a, good.b, 0.1 - 1e-6),
        Capsule(good.a, np.array([0.999, 0, 0]), good.radius),
        Capsule(good.a, good.b, np.nan),
    ):
        with pytest.raises(SetupError, match="link arm: geometry sticks out"):
            prove(EnclosedPart("arm", 0, capsule, corners, Certainty.COMPUTED, ""))


BOX = robot(
    link("base"), link("arm", shape('<box size="0.1 0.2 0.6"/>', (0, 0, 0.3))), joint("j", "base", "arm")
)
LIMITS = full_limits(["j"], [False])


def load(path: Path, cache: Path) -> RobotModel:
    return load_robot(path, setup=RobotSetup(limits=LIMITS, cache_dir=cache))


def forbid_fitting(monkeypatch: pytest.MonkeyPatch) -> None:
    def fit(_: object) -> None:
        raise AssertionError("fitted again")

    monkeypatch.setattr(robots.enclosure, "fit_capsule", fit)


def test_what_was_fitted_is_kept_and_read_again(
    write_urdf: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, cache = write_urdf(BOX), tmp_path / "new" / "folder"
    first = load(path, cache)
    forbid_fitting(monkeypatch)
    again = load(path, cache)
    assert again.content_hash == first.content_hash
    assert (again.enclosure == first.enclosure).all()
    path.write_text(path.read_text().replace("0.6", "0.7"))
    with pytest.raises(AssertionError, match="fitted again"):
        load(path, cache)


def test_another_mesh_under_the_same_name_is_fitted_again(
    write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    text = robot(link("base"), link("arm", shape('<mesh filename="arm.stl"/>')), joint("j", "base", "arm"))
    path, mesh = write_urdf(text), tmp_path / "arm.stl"
    lengths = []
    for size in (0.3, 0.5):
        mesh.write_bytes(tetrahedron(size))
        lengths.append(load(path, tmp_path / "cache").enclosure[0]["radius"][0])
    assert lengths[1] > 1.5 * lengths[0]


def tetrahedron(size: float) -> bytes:
    """Binary STL of a tetrahedron with corners at the origin and at ``size`` on each axis."""
    corners = np.vstack([np.zeros(3), size * np.eye(3)])
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *corners[list(face)].ravel(), 0) for face in faces)
    return bytes(80) + struct.pack("<I", len(faces)) + body


def test_mesh_scale_and_placement_count(write_urdf: Callable[[str], Path], tmp_path: Path) -> None:
    (tmp_path / "arm.stl").write_bytes(tetrahedron(1.0))
    geometry = '<mesh filename="arm.stl" scale="0.1 0.2 0.3"/>'
    arm_link = link("arm", shape(geometry, (1, 2, 3), (0, 0, np.pi / 2)))
    path = write_urdf(robot(link("base"), arm_link, joint("j", "base", "arm")))
    rows = load(path, tmp_path / "cache").enclosure[0]
    corners = np.array([[1, 2, 3], [1, 2.1, 3], [0.8, 2, 3], [1, 2, 3.3]])
    distance = distance_to_segments(corners, rows["a"][:1], rows["b"][:1])
    assert rows["radius"][0] - 0.01 < distance.max() <= rows["radius"][0]


def test_a_link_in_another_unit_is_refused(write_urdf: Callable[[str], Path], tmp_path: Path) -> None:
    written(tmp_path / "arm.dae", '<unit meter="0.001"/>')
    arm_link = link("arm", shape('<mesh filename="arm.dae"/>', (1, 2, 3), (0, 0, 0)))
    path = write_urdf(robot(link("base"), arm_link, joint("j", "base", "arm")))
    with pytest.raises(SetupError, match=r"arm\.dae: its <unit> is '0\.001' m"):
        load(path, tmp_path / "cache")


@pytest.mark.parametrize("scale", ["1 1 1", "0.1 -0.2 0.3"])
@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_a_link_of_which_a_part_is_left_out_is_refused_however_it_is_scaled(
    write_urdf: Callable[[str], Path], tmp_path: Path, scale: str, kind: str
) -> None:
    whole = "v 0 0 0\nv 0.5 0 0\nv 0 0.5 0\nv 5 5 5\nf 1 2 3\nf 1 2 4\n"
    arm_link = link("arm", shape(f'<mesh filename="a rm.obj" scale="{scale}"/>', (1, 2, 3), kind=kind))
    path, mesh = write_urdf(robot(link("base"), arm_link, joint("j", "base", "arm"))), tmp_path / "a rm.obj"
    mesh.write_text(whole, encoding="utf-8")
    assert load(path, tmp_path / "cache").enclosure[0]["n"] == 1
    mesh.write_text(whole.replace("f 1 2 4", "f 4"), encoding="utf-8")
    with pytest.raises(SetupError, match=r"a rm\.obj: 1 of the 4 places that it states"):
        load(path, tmp_path / "cache")


def test_a_mesh_is_held_against_its_file_when_it_is_fitted_and_not_again(
    write_urdf: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "arm.stl").write_bytes(tetrahedron(0.3))
    arm_link = link("arm", shape('<mesh filename="arm.stl"/>'))
    path, looked_at = write_urdf(robot(link("base"), arm_link, joint("j", "base", "arm"))), list[Path]()
    read = robots.geometry.stated_places

    def counted(file: Path) -> StatedPlaces:
        looked_at.append(file)
        return read(file)

    monkeypatch.setattr(robots.geometry, "stated_places", counted)
    hashes = {load(path, tmp_path / "cache").content_hash for _ in range(3)}
    assert looked_at == [tmp_path / "arm.stl"] and len(hashes) == 1


def spoil_text(content: str) -> str:
    return content[: len(content) // 2]


def widen_radius(content: str) -> str:
    entry = json.loads(content)
    entry["rows"][0]["radius"] *= 1.1
    return json.dumps(entry)


def spoil_radius(content: str) -> str:
    entry = json.loads(content)
    entry["rows"][0]["radius"] *= 0.9
    return json.dumps(entry)


def spoil_radius_and_digest(content: str) -> str:
    entry = json.loads(spoil_radius(content))
    entry["digest"] = robots.enclosure._digest(entry["rows"])
    return json.dumps(entry)


def spoil_corners(content: str) -> str:
    entry = json.loads(content)
    entry["rows"][0]["corners"] = base64.b64encode(b"").decode()
    entry["digest"] = robots.enclosure._digest(entry["rows"])
    return json.dumps(entry)


@pytest.mark.parametrize(
    "spoil",
    [
        spoil_text,
        widen_radius,
        spoil_radius,
        spoil_radius_and_digest,
        spoil_corners,
        lambda _: "[]",
        lambda _: "\0",
    ],
)
def test_a_spoilt_file_is_fitted_again(
    spoil: Callable[[str], str], write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    path, cache = write_urdf(BOX), tmp_path / "cache"
    first = load(path, cache)
    (file,) = cache.iterdir()
    good = file.read_text()
    file.write_text(spoil(good))
    assert load(path, cache).content_hash == first.content_hash
    assert file.read_text() == good


def test_a_cache_that_cannot_be_written_costs_only_time(
    write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    path, blocked = write_urdf(BOX), tmp_path / "file"
    blocked.write_text("not a folder")
    assert load(path, blocked).content_hash == load(path, tmp_path / "cache").content_hash
    assert blocked.read_text() == "not a folder"


def test_default_cache_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert default_cache_dir() == Path("/somewhere/stopproof")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/worker")
    assert default_cache_dir() == Path("/home/worker/.cache/stopproof")


def test_a_user_without_a_home_keeps_nothing(
    write_urdf: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    assert default_cache_dir() is None
    model = load_robot(write_urdf(BOX), setup=RobotSetup(limits=LIMITS))
    assert model.content_hash == load(tmp_path / "made_up.urdf", tmp_path / "cache").content_hash
    assert {file.name for file in tmp_path.iterdir()} == {"made_up.urdf", "cache"}


def test_geometry_too_far_away_to_be_enclosed_is_refused_by_its_link(
    write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    (tmp_path / "arm.stl").write_bytes(tetrahedron(1.0))
    mesh = shape('<mesh filename="arm.stl" scale="5000 1 1"/>')
    text = robot(link("base"), link("arm", mesh), joint("j", "base", "arm"))
    with pytest.raises(SetupError, match=r"made_up\.urdf: link arm: a mesh has .* beyond 1000 m"):
        load(write_urdf(text), tmp_path / "cache")
    far = shape('<box size="900 1 1"/>', xyz=(900, 0, 0))
    with pytest.raises(SetupError, match="link arm: geometry beyond 1000 m of its joint"):
        load(write_urdf(robot(link("base"), link("arm", far), joint("j", "base", "arm"))), tmp_path / "cache")
    rail = joint("k", "arm", "hand", kind="prismatic", inside='<limit lower="-1e308" upper="1e308"/>')
    parts = (link("base"), link("arm"), link("hand", shape('<box size="1 1 1"/>')), joint("j", "base", "arm"))
    setup = RobotSetup(limits=LIMITS, commanded=("j",), cache_dir=tmp_path / "cache")
    with pytest.raises(SetupError, match="joint k is not commanded: a sliding joint without finite limits"):
        load_robot(write_urdf(robot(*parts, rail)), setup=setup)


def test_a_mesh_that_is_none_is_refused_in_one_line(
    write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    (tmp_path / "arm.stl").write_text("this is no mesh")
    text = robot(link("base"), link("arm", shape('<mesh filename="arm.stl"/>')), joint("j", "base", "arm"))
    with pytest.raises(SetupError) as caught:
        load(write_urdf(text), tmp_path / "cache")
    assert "arm.stl" in str(caught.value) and "\n" not in str(caught.value)
    assert ".cpp" not in str(caught.value), "places in the source of a library help nobody"


def hand(fingers: int) -> str:
    """An arm with many small, far-apart links that are fixed to its only moving link."""
    parts = [link("base"), link("arm", shape('<box size="0.1 0.1 0.1"/>')), joint("j", "base", "arm")]
    for i in range(fingers):
        parts.append(link(f"f{i}", shape('<sphere radius="0.01"/>')))
        parts.append(joint(f"k{i}", "arm", f"f{i}", kind="fixed", xyz=(0.3 * i + 0.3, 0.1 * (i % 3), 0)))
    return robot(*parts)


def test_parts_far_apart_keep_their_own_capsules_while_there_is_room(
    write_urdf: Callable[[str], Path], tmp_path: Path
) -> None:
    assert load(write_urdf(hand(5)), tmp_path / "cache").enclosure[0]["n"] == 6
    crowded = load(write_urdf(hand(30)), tmp_path / "cache")
    assert crowded.enclosure[0]["n"] == MAX_LINKS == len(crowded.links)
    check = check_geometry_inside(crowded, PinArm(tmp_path / "made_up.urdf"), np.random.default_rng(0), 3)
    assert min(check.values()) >= -1e-9 and len(check) == 31


def test_rows_say_how_sure_they_are(arm: Callable[[str], RobotModel]) -> None:
    for name, certainty in (("ur5", Certainty.COMPUTED), ("lwa4p", Certainty.ASSUMED)):
        model = arm(name)
        rows = model.enclosure[0]
        assert {CERTAINTIES[i] for i in rows["certainty"][: rows["n"]]} == {certainty}
        assert model.assumed_enclosure == (certainty is Certainty.ASSUMED)
        assert not rows["radius"][rows["n"] :].any()


SHORT = '<limit lower="0" upper="0.1" velocity="1" effort="1"/>'


def finger_tree(inside: str, commanded: tuple[str, ...] = ("j",)) -> Tree:
    """Joint j carries k (-0.1 to 0.2) and m; ``inside`` says what m is."""
    own = '<limit lower="-0.1" upper="0.2" velocity="1" effort="1"/>'
    text = robot(
        *(link(name) for name in ("base", "arm", "left", "right")),
        joint("j", "base", "arm"),
        joint("k", "arm", "left", inside=own),
        joint("m", "arm", "right", inside=inside),
    )
    return read_tree(parse_urdf(text.encode(), Path("x.urdf")), commanded)


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        ('<limit lower="-1" upper="2" velocity="1" effort="1"/>', (-1.0, 2.0)),
        ("", (-np.inf, np.inf)),
        ('<limit lower="2" upper="-1" velocity="1" effort="1"/>', (-np.inf, np.inf)),
        ('<limit lower="0" upper="0" velocity="1" effort="1"/><mimic joint="k"/>', (-0.1, 0.2)),
        (
            f'{SHORT}<mimic joint="k" multiplier="-3" offset="1"/>',
            (0.0, 1.3),
        ),
        (
            f'{SHORT}<mimic joint="k" multiplier="0" offset="1"/>',
            (0.0, 1.0),
        ),
    ],
)
def test_a_locked_joint_may_be_wherever_its_own_or_the_mimicked_range_puts_it(
    inside: str, expected: tuple[float, float]
) -> None:
    assert locked_range(finger_tree(inside), "m") == pytest.approx(expected)


@pytest.mark.parametrize("other", ["m", "nobody"])
def test_a_joint_that_mimics_no_free_joint_is_refused(other: str) -> None:
    with pytest.raises(SetupError, match=f"joint m mimics '{other}'"):
        locked_range(finger_tree(f'<mimic joint="{other}"/>'), "m")


@pytest.mark.parametrize(("share", "first"), [(1.0 - 1e-9, "a"), (1.0 + 1e-9, "a"), (0.9, "a"), (1.1, "b")])
def test_a_shared_capsule_has_the_name_of_the_larger_link_and_of_equal_ones_that_of_the_first(
    share: float, first: str
) -> None:
    """Two fingers mirror each other; which one is larger by rounding depends on the processor."""
    ball = np.array([[0.0, 0.0, 0.0, 0.1]])
    group = robots.enclosure._Group
    ends = np.zeros(3), np.array([0.0, 0.0, 0.1])
    one, two = (group((name,), 0, ball, Capsule(*ends, r)) for name, r in (("a", 0.1), ("b", 0.1 * share)))
    assert one.merged(two).names[0] == first
