"""The arm against fixtures and the floor: sampled motion, distances over all features of tetrahedra."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from occupancy import workspace
from occupancy.sets import new_link_sets
from occupancy.swept import LinkOccupancy
from occupancy.workspace import Fixture, Workspace, WorkspaceError
from occupancy.workspace_kernels import mark_commanded, mark_moving
from robots.errors import SetupError
from robots.geometry import read_triangles
from robots.model import Mount, RobotModel
from robots.motion import Block
from tests.occupancy.arms import ARMS, Motion, arm, axis_points, place, random_motion
from tests.oracles.hulls import distance, pad, segment_segment

Array = NDArray[np.float64]
Count = Callable[[int], int]
MARGIN = 1e-4
EVERY = np.ones(24, dtype=np.uint8)
NOBODY_EXEMPT: dict[str, tuple[str, ...]] = {}


def pose(rng: np.random.Generator) -> Mount:
    return Mount(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-1.5, 1.5, 3))


@dataclass(frozen=True)
class Solid:
    """What stands there, as the tests see it: tetrahedra (N, 4, 3), a segment or a plane, and a radius."""

    fixture: Fixture
    tetrahedra: Array | None = None
    segment: Array | None = None
    plane: tuple[Array, Array] | None = None
    radius: float = 0.0

    def gaps(self, axes: Array, radii: Array) -> Array:
        """Gaps (...) [m] of capsules with axes (..., 2, 3)."""
        if self.plane is not None:
            point, normal = self.plane
            between = ((axes - point) @ normal).min(axis=-1)
        elif self.segment is not None:
            start, end = (np.broadcast_to(each, axes[..., 0, :].shape) for each in self.segment)
            between = segment_segment(axes[..., 0, :], axes[..., 1, :], start, end)
        else:
            assert self.tetrahedra is not None
            between = distance(axes[..., None, [0, 1, 1, 1], :], self.tetrahedra).min(axis=-1)
        gaps: Array = between - radii - self.radius
        return gaps


def tetrahedra_of_a_box(size: Array, at: Mount) -> Array:
    """Six tetrahedra (6, 4, 3) along the paths from one corner to the opposite one."""
    paths = []
    for order in permutations(range(3)):
        corner, path = np.full(3, -0.5), [np.full(3, -0.5)]
        for axis in order:
            corner = corner.copy()
            corner[axis] = 0.5
            path.append(corner)
        paths.append(path)
    return np.array(paths) * size @ at.rotation.T + at.translation


def random_solid(rng: np.random.Generator, name: str) -> Solid:
    kind = rng.choice(["box", "capsule", "plane", "hull"])
    error = float(rng.choice([0.0, 0.03]))
    at = pose(rng)
    if kind == "box":
        size = rng.uniform(0.02, 1.0, 3)
        return Solid(workspace.box(name, size, at, error), tetrahedra_of_a_box(size, at), radius=error)
    if kind == "capsule":
        ends, radius = at.translation + rng.normal(size=(2, 3)) * 0.4, float(rng.uniform(0.01, 0.2))
        fixture = workspace.capsule(name, ends[0], ends[1], radius, error)
        return Solid(fixture, segment=ends, radius=radius + error)
    if kind == "plane":
        normal = rng.normal(size=3)
        unit, point = normal / np.linalg.norm(normal), rng.normal(size=3)
        point += (rng.uniform(-1.2, 0.2) - unit @ point) * unit
        return Solid(
            workspace.half_space(name, point, normal * 3.0, error), plane=(point, unit), radius=error
        )
    corners = rng.normal(size=(4, 3)) * 0.4
    there = (corners @ at.rotation.T + at.translation)[None]
    return Solid(workspace.hull(name, corners, at, error), there, radius=error)


@dataclass
class Scene:
    """An arm and a motion of it on one slice, swept."""

    model: RobotModel
    motion: Motion
    slices: Block
    links: Block

    def sampled(self, samples: int = 7) -> Array:
        """Axes (T, L, 2, 3) of the links at instants of the slice, tracking error included."""
        local = axis_points(self.model, np.array([0.0, 1.0]))
        return place(self.model, self.motion.actual(np.linspace(0.0, self.motion.h, samples)[:, None]), local)


def scene(name: str, rng: np.random.Generator, *, exact: bool = False) -> Scene:
    model = arm(name, rng)
    motion = random_motion(model, rng)
    if exact:
        motion = replace(motion, h=1e-4, error=np.zeros_like(motion.error))
    slices, links = motion.slices(), new_link_sets()
    LinkOccupancy(model).occupy(slices, links)
    return Scene(model, motion, slices, links)


def blocked(given: Scene, fixture: Fixture) -> bool:
    space = Workspace([fixture], given.model.links, NOBODY_EXEMPT, MARGIN)
    return space.check(given.links, given.slices, EVERY) is not None


def gaps(given: Scene, solid: Solid) -> Array:
    """Smallest gap (L,) of each link over the sampled instants."""
    n = len(given.model.links)
    found: Array = solid.gaps(given.sampled(), given.model.enclosure[0]["radius"][:n]).min(axis=0)
    return found


@pytest.mark.parametrize("name", ARMS)
def test_what_is_proven_apart_stays_apart(name: str, rng: np.random.Generator, count: Count) -> None:
    seen: Counter[str] = Counter()
    for _ in range(max(16, count(300))):
        given = scene(name, rng)
        solids = [random_solid(rng, f"f{k}") for k in range(int(rng.integers(1, 4)))]
        space = Workspace([s.fixture for s in solids], given.model.links, NOBODY_EXEMPT, MARGIN)
        found = space.check(given.links, given.slices, EVERY)
        closest = {solid.fixture.name: gaps(given, solid) for solid in solids}
        if found is None:
            assert min(each.min() for each in closest.values()) > MARGIN - 1e-9
            seen["apart"] += 1
        else:
            assert found.gap_m <= MARGIN
            assert found.gap_m <= closest[found.other][found.link] + 1e-9, "no lower bound of the gap"
            seen["blocked"] += 1
    assert min(seen["apart"], seen["blocked"]) >= 1, seen


@pytest.mark.parametrize("name", ["one_turning", "six", "branches"])
def test_what_is_apart_is_proven_so(name: str, rng: np.random.Generator, count: Count) -> None:
    """On tiny slices without errors hardly anything is lost, whatever the shape."""
    seen: Counter[str] = Counter()
    for _ in range(max(30, count(1_000))):
        given, solid = scene(name, rng, exact=True), random_solid(rng, "it")
        space = Workspace([solid.fixture], given.model.links, NOBODY_EXEMPT, MARGIN)
        found = space.check(given.links, given.slices, EVERY)
        smallest = gaps(given, solid).min()
        if found is not None:
            assert smallest < MARGIN + 5e-3
            if smallest > 1e-3 - solid.radius and np.isfinite(found.link_point).all():
                assert np.linalg.norm(found.other_point - found.link_point) == pytest.approx(
                    abs(found.gap_m), abs=5e-3
                )
        seen["blocked" if found else "apart"] += 1
    assert min(seen["apart"], seen["blocked"]) >= 1, seen


def test_the_floor_is_below_its_height(rng: np.random.Generator) -> None:
    given = scene("six", rng)
    low = given.links[0]["points"][:6, :, 2].min() - given.links[0]["radius"][:6].max()
    for height, apart in ((low - 1.0, True), (low + 0.5, False), (low + 100.0, False)):
        floor = workspace.half_space(workspace.FLOOR, (3.0, -2.0, height), (0, 0, 1))
        assert blocked(given, floor) != apart


def test_a_position_error_counts_in_full(rng: np.random.Generator) -> None:
    given = scene("planar", rng, exact=True)
    low = float((given.links[0]["points"][:2, :, 2].min(axis=1) - given.links[0]["radius"][:2]).min())
    for error, apart in ((0.0, True), (0.0499, True), (0.0501, False)):
        floor = workspace.half_space("floor", (0, 0, low - 0.05 - MARGIN), (0, 0, 1), error)
        assert blocked(given, floor) != apart


def test_only_links_that_may_touch_are_left_out(rng: np.random.Generator) -> None:
    given = scene("six", rng)
    everything = workspace.half_space("all", (0, 0, 100.0), (0, 0, 1))
    links = given.model.links
    assert (
        Workspace([everything], links, {"all": links}, MARGIN).check(given.links, given.slices, EVERY) is None
    )
    for k, link in enumerate(links):
        others = tuple(each for each in links if each != link)
        space = Workspace([everything], links, {"all": others}, MARGIN)
        found = space.check(given.links, given.slices, EVERY)
        assert found is not None and found.link == k and found.other == "all" and found.slice == 0
        idle = EVERY.copy()
        idle[k] = 0
        assert space.check(given.links, given.slices, idle) is None
        assert space.exempt == tuple((other, "all") for other in others)


def test_not_a_number_proves_nothing(rng: np.random.Generator) -> None:
    far = [
        workspace.half_space("floor", (0, 0, -50.0), (0, 0, 1)),
        workspace.box("box", (1, 1, 1), Mount(translation=np.array([30.0, 0, 0]))),
        workspace.capsule("capsule", (0, 40, 0), (0, 40, 1), 0.1),
    ]
    for fixture in far:
        given = scene("six", rng)
        space = Workspace([fixture], given.model.links, {}, MARGIN)
        assert space.check(given.links, given.slices, EVERY) is None
        for field in ("points", "radius"):
            for value in (np.nan, np.inf, -np.inf, 1e10):
                broken = given.links.copy()
                broken[0][field][4] = value
                found = space.check(broken, given.slices, EVERY)
                assert found is not None and found.link == 4 and not found.gap_m > MARGIN
        for field, bad in (("n_points", 0), ("n_points", 5), ("slice", 1), ("owner", 3)):
            broken = given.links.copy()
            broken[0][field][2] = bad
            assert space.check(broken, given.slices, EVERY) is not None
        for n in (0, 2, -1):
            fewer = given.slices.copy()
            fewer["n"] = n
            assert space.check(given.links, fewer, EVERY) is not None
        lacking = given.links.copy()
        lacking["n"] -= 1
        assert space.check(lacking, given.slices, EVERY) is not None


def test_every_slice_is_looked_at(rng: np.random.Generator) -> None:
    """The first slice that is blocked is named; NaN comes from no slice before."""
    given = scene("six", rng)
    slices, links = given.slices.copy(), given.links.copy()
    plan = slices[0]
    plan["n"] = 5
    for i in range(1, 6):
        plan["t"][i], plan["q"][i], plan["dq"][i] = 0.01 * i, plan["q"][0], 0.0
        plan["dq_max"][i - 1] = plan["ddq_max"][i - 1] = 0.0
    occupancy = LinkOccupancy(given.model)
    for blocked in range(5):
        moved = slices.copy()
        moved[0]["q"][blocked + 1 :, 0] += 2.0
        occupancy.occupy(moved, links)
        start, end = links[0]["points"][5, 0], links[0]["points"][6 * blocked + 5, 2]
        ball = workspace.capsule("ball", end, end, 0.01)
        free = np.linalg.norm(end - start) > 0.6
        found = Workspace([ball], given.model.links, {}, MARGIN).check(links, moved, EVERY)
        assert found is not None and found.slice <= blocked
        if free and found.link == 5:
            assert found.slice == blocked


@pytest.mark.parametrize("name", ["six", "scara", "gantry"])
def test_links_that_move_on_any_slice_are_marked(name: str, rng: np.random.Generator, count: Count) -> None:
    seen: Counter[bool] = Counter()
    for _ in range(max(50, count(1_000))):
        given = scene(name, rng)
        still = rng.choice([0.0, 1e-4, 1.0])
        slices = given.slices.copy()
        slices[0]["dq"] *= still
        slices[0]["dq_max"] *= still
        slices[0]["ddq_max"] *= still
        slices[0]["q_error"] *= rng.choice([0.0, 0.01, 1.0])
        links = new_link_sets()
        LinkOccupancy(given.model).occupy(slices, links)
        if rng.random() < 0.2:
            links[0]["speed_max"][int(rng.integers(3))] = np.nan
        active = np.zeros(24, dtype=np.uint8)
        moving_links = mark_moving(links, slices, given.model.enclosure, 1e-3, 2e-3, active)
        displaced = given.model.enclosure["reach"][0] @ slices["q_error"][0]
        n = int(links["n"][0])
        moving = ~((links["speed_max"][0, :n] <= 1e-3) & (displaced[:n] <= 2e-3))
        assert (active[: len(moving)] == moving).all() and moving_links == active.sum()
        seen.update(moving.tolist())
    assert min(seen.values()) > 5 and len(seen) == 2


@pytest.mark.parametrize("name", ["six", "scara", "gantry"])
def test_links_on_a_joint_that_is_commanded_are_marked(
    name: str, rng: np.random.Generator, count: Count
) -> None:
    """However slowly; a link hangs on the joints between it and the base."""
    seen: Counter[bool] = Counter()
    for _ in range(max(50, count(1_000))):
        given = scene(name, rng)
        plan, tree = given.slices.copy(), given.model.kinematics[0]
        n, joints = int(plan["n"][0]), int(tree["n"])
        fastest = rng.choice([0.0, 1e-300, 1.0, np.nan], (n, joints), p=[0.9, 0.05, 0.04, 0.01])
        plan["dq_max"][0, :n, :joints] = fastest
        plan["dq_max"][0, n:], plan["dq_max"][0, :, joints:] = 1.0, 1.0
        flags = np.full(24, 7, dtype=np.uint8)
        mark_commanded(plan, LinkOccupancy(given.model).chain, flags)
        for link in range(len(given.model.links)):
            joint, hangs = int(given.model.enclosure["joint"][0, link]), set()
            while joint >= 0:
                hangs.add(joint)
                joint = int(tree["parent"][joint])
            moves = any(not (fastest[:, each] == 0.0).all() for each in hangs)
            assert flags[link] == moves
            seen[moves] += 1
        assert not flags[len(given.model.links) :].any()
    assert min(seen.values()) > 5 and len(seen) == 2


CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
FACES = np.array(
    [
        *[(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)],
        *[(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)],
    ]
)


def write_stl(path: Path, triangles: Array) -> Path:
    lines = ["solid it"]
    for corners in triangles:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x!r} {y!r} {z!r}" for x, y, z in corners.tolist()]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid it"]))
    return path


def two_cubes() -> Array:
    """Triangles (24, 3, 3) of two unit cubes, the second 3 m along x from the first."""
    one = CUBE[FACES]
    return np.concatenate([one, one + np.array([3.0, 0.0, 0.0])])


def test_connected_pieces_leave_the_room_between_them_free(tmp_path: Path, rng: np.random.Generator) -> None:
    vertices, triangles = read_triangles(write_stl(tmp_path / "two.stl", two_cubes()))
    assert len(vertices) == 16 and len(triangles) == 24
    apart = workspace.connected_hulls("two", vertices, triangles, Mount())
    whole = workspace.hull("two", vertices, Mount())
    assert len(apart.pieces) == 2 and len(whole.pieces) == 1
    given = scene("one_turning", rng, exact=True)
    links = given.links.copy()
    for x, in_pieces, in_hull in (
        (0.5, True, True),
        (2.0, False, True),
        (3.5, True, True),
        (6.0, False, False),
    ):
        links[0]["points"][0, :4] = [x, 0.5, 0.5]
        for fixture, inside in ((apart, in_pieces), (whole, in_hull)):
            found = Workspace([fixture], given.model.links, {}, MARGIN).check(links, given.slices, EVERY)
            assert (found is not None) == inside, (x, fixture)


def test_the_hull_of_a_mesh_contains_it(rng: np.random.Generator) -> None:
    """Also where many points are replaced by fewer: a tiny link at any of them is blocked."""
    points = rng.normal(size=(3_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    at = pose(rng)
    space = Workspace([workspace.hull("ball", points, at)], ("link",), {}, MARGIN)
    given = scene("one_turning", rng, exact=True)
    links = given.links.copy()
    links[0]["radius"][0] = 0.0
    for point in points[rng.integers(0, 3_000, 50)] @ at.rotation.T + at.translation:
        links[0]["points"][0, :4] = point
        assert space.check(links, given.slices, EVERY) is not None
        links[0]["points"][0, :4] = at.translation + 1.2 * (point - at.translation)
        assert space.check(links, given.slices, EVERY) is None


def test_open_surfaces_enclose_nothing(tmp_path: Path) -> None:
    vertices, triangles = read_triangles(write_stl(tmp_path / "open.stl", two_cubes()[1:]))
    with pytest.raises(WorkspaceError, match="not closed"):
        workspace.connected_hulls("open", vertices, triangles, Mount())
    assert len(workspace.hull("open", vertices, Mount()).pieces) == 1


REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "normal": (lambda: workspace.half_space("x", (0, 0, 0), (0, 0, 0)), "no direction"),
    "nan": (lambda: workspace.half_space("x", (0, 0, np.nan), (0, 0, 1)), "not finite"),
    "nan normal": (lambda: workspace.half_space("x", (0, 0, 0), (0, np.nan, 1)), "no direction"),
    "flat box": (lambda: workspace.box("x", (1, 0, 1), Mount()), "above zero"),
    "far box": (lambda: workspace.box("x", (1, 1, 1), Mount(translation=np.full(3, 1e7))), "beyond"),
    "radius": (lambda: workspace.capsule("x", (0, 0, 0), (1, 0, 0), -1.0), "radius_m"),
    "error": (lambda: workspace.capsule("x", (0, 0, 0), (1, 0, 0), 1.0, np.nan), "position_error_m"),
    "empty": (lambda: workspace.hull("x", np.empty((0, 3)), Mount()), "no vertex"),
    "nan mesh": (lambda: workspace.hull("x", np.full((4, 3), np.nan), Mount()), "not finite"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_fixtures_that_make_no_sense_are_refused(case: str) -> None:
    make, message = REFUSED[case]
    with pytest.raises(WorkspaceError, match=message):
        make()


def test_names_and_numbers_of_fixtures_are_checked() -> None:
    one = workspace.box("one", (1, 1, 1), Mount())
    for fixtures, exempt, message in (
        ([one, one], {}, "names of their own"),
        ([one], {"two": ("link",)}, "fixture two is not known; there are: one"),
        ([one], {"one": ("hand",)}, "link hand is not known; there are: link"),
        ([replace(one, name=f"f{k}") for k in range(33)], {}, "33 fixtures"),
        ([replace(one, pieces=one.pieces * 65)], {}, "65 pieces"),
    ):
        with pytest.raises(SetupError, match=message):
            Workspace(fixtures, ("link",), exempt, MARGIN)
    with pytest.raises(WorkspaceError, match="margin"):
        Workspace([one], ("link",), {}, float("nan"))
    assert pad(np.zeros((2, 3))).shape == (4, 3)
