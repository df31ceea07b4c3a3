"""What stands in the cell besides people: fixtures and the floor, and the check of the arm against them.

A fixture is the union of convex pieces. A piece is the hull of its corners grown by a radius, or a
half-space; facets n·x <= d that contain the hull give the first directions in which both may be apart.
(docs/method.md, section 5.)
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from occupancy import workspace_kernels as kernels
from occupancy.kernels import ROUNDING
from occupancy.separation import new_scratch
from occupancy.sets import LINK_SETS
from robots.capsule import SLACK, extreme_balls
from robots.enclosure import MAX_LINKS
from robots.errors import SetupError
from robots.model import Mount
from robots.motion import Block
from robots.shapes import place, point_balls, simplified

Array = NDArray[np.float64]

MAX_FIXTURES: Final = 32
MAX_PIECES: Final = 64
"""Convex pieces of all fixtures together."""
MAX_FACETS: Final = 26
FLOOR: Final = "floor"
"""Name of the half-space below the floor."""
FARTHEST: Final = 1e6
"""Coordinates of fixtures are smaller than this [m]."""

_FIXTURES: Final = np.dtype(
    [
        ("n", np.int64),
        ("fixture", np.int32, (MAX_PIECES,)),
        ("first", np.int64, (MAX_PIECES + 1,)),
        ("n_facets", np.int32, (MAX_PIECES,)),
        ("facet", np.float64, (MAX_PIECES, MAX_FACETS, 4)),
        ("radius", np.float64, (MAX_PIECES,)),
        ("ball", np.float64, (MAX_PIECES, 5)),
        ("exempt", np.uint8, (MAX_LINKS, MAX_FIXTURES)),
    ]
)
"""``n`` pieces: corners ``first[p]`` to ``first[p+1] - 1`` of a list of their own (none: a half-space),
facets (n, d) with n·x <= d for all of them, ``radius`` [m] with the position error, ``ball`` as
:func:`occupancy.kernels.bound_rows` writes it. ``exempt[l, f]``: link l may touch fixture f."""

BLOCKED: Final = np.dtype(
    [
        ("slice", np.int64),
        ("link", np.int64),
        ("other", np.int64),
        ("gap", np.float64),
        ("other_radius", np.float64),
        ("lost", np.float64),
        ("direction", np.float64, (3,)),
        ("link_point", np.float64, (3,)),
        ("other_point", np.float64, (3,)),
    ]
)
"""A pair that is not proven apart, as kernels write it."""


class WorkspaceError(SetupError):
    """A fixture, or a pair that may touch, that cannot be used."""


class Blocked(NamedTuple):
    """The pair with the smallest gap of the first slice on which some pair is not proven apart.

    Attributes
    ----------
    slice, link:
        Slice and enclosure row.
    other:
        Name of the fixture, or of the other link.
    gap_m:
        Lower bound of the gap [m], at most the margin; ``-inf`` where a row is not usable.
    link_point, other_point:
        Close points (3,) [m]; NaN where unknown.
    other_radius_m, lost_m:
        Radius of the other side, position error included; what was subtracted for the time between the ends
        of the slice and for tracking, of two links.
    """

    slice: int
    link: int
    other: str
    gap_m: float
    link_point: Array
    other_point: Array
    other_radius_m: float
    lost_m: float


def new_blocked() -> Block:
    """Return a block that kernels write the pair into that is not proven."""
    return np.zeros(1, dtype=BLOCKED)


def blocked(nearest: Block, names: Sequence[str]) -> Blocked:
    """Return what a kernel has found; ``names``: what ``other`` counts."""
    found = nearest[0]
    other = int(found["other"])
    return Blocked(
        int(found["slice"]),
        max(int(found["link"]), 0),
        names[other] if other >= 0 else "",
        float(found["gap"]),
        found["link_point"].copy(),
        found["other_point"].copy(),
        float(found["other_radius"]),
        float(found["lost"]),
    )


@dataclass(frozen=True, eq=False)
class Piece:
    """A convex piece in the world: hull of ``points`` (P, 3) [m] grown by ``radius`` [m], within ``facets``.

    ``facets`` (F, 4): unit normals and offsets of half-spaces n·x <= d that contain all points; a piece
    without points is the intersection of its facets, which must be one.
    """

    points: Array
    radius: float
    facets: Array


@dataclass(frozen=True, eq=False)
class Fixture:
    """Something that does not move; no point of it is farther than ``position_error_m`` from its pieces."""

    name: str
    pieces: tuple[Piece, ...]
    position_error_m: float = 0.0

    def __post_init__(self) -> None:
        _length(self.name, "position_error_m", self.position_error_m)


def half_space(name: str, point: ArrayLike, normal: ArrayLike, error: float = 0.0) -> Fixture:
    """Everything on the side of a plane away from its ``normal`` (3,); ``point`` (3,) [m] lies on the plane.

    Raises
    ------
    WorkspaceError
        A number is not finite or too large, or the normal is no direction.
    """
    at, n = _place(name, "point_m", point), np.asarray(normal, dtype=np.float64)
    length = float(np.linalg.norm(n))
    if n.shape != (3,) or not 1e-6 < length < 1e6:
        raise WorkspaceError(f"fixture {name}: normal = {np.ravel(n).tolist()} is no direction")
    unit = n / length
    return Fixture(name, (Piece(np.empty((0, 3)), 0.0, np.array([[*unit, float(unit @ at)]])),), error)


def box(name: str, size: ArrayLike, pose: Mount, error: float = 0.0) -> Fixture:
    """Return a box with the edges ``size`` (3,) [m] along the axes of ``pose``, whose origin is its middle.

    Raises
    ------
    WorkspaceError
        An edge is not positive, or a number is not finite or too large.
    """
    edges = _place(name, "size_m", size)
    if not (edges > 0.0).all():
        raise WorkspaceError(f"fixture {name}: size_m = {edges.tolist()} must be above zero")
    signs = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5], indexing="ij"), -1).reshape(8, 3)
    corners = (signs * edges) @ pose.rotation.T + _place(name, "xyz_m", pose.translation)
    return Fixture(name, (_piece(corners, 0.0, np.vstack([pose.rotation.T, -pose.rotation.T])),), error)


def capsule(name: str, a: ArrayLike, b: ArrayLike, radius: float, error: float = 0.0) -> Fixture:
    """All points within ``radius`` [m] of the segment from ``a`` to ``b`` (3,) [m].

    Raises
    ------
    WorkspaceError
        A number is not finite or too large, or the radius negative.
    """
    ends = np.array([_place(name, "a_m", a), _place(name, "b_m", b)])
    _length(name, "radius_m", radius)
    return Fixture(name, (_piece(ends, float(radius), _around(ends[1] - ends[0])),), error)


def _around(axis: Array) -> Array:
    """Unit vectors (8, 3): along an axis and back, and six across it."""
    frame = np.linalg.svd(axis[None, :])[2]
    turns = np.arange(6) * np.pi / 3.0
    across = np.outer(np.cos(turns), frame[1]) + np.outer(np.sin(turns), frame[2])
    return np.vstack([frame[0], -frame[0], across])


def hull(name: str, vertices: Array, pose: Mount, error: float = 0.0) -> Fixture:
    """Convex hull of ``vertices`` (N, 3) [m] in the frame ``pose``.

    Raises
    ------
    WorkspaceError
        A coordinate is not finite or too large.
    """
    return Fixture(name, (_hull_piece(name, vertices, pose),), error)


def connected_hulls(
    name: str, vertices: Array, triangles: NDArray[np.int64], pose: Mount, error: float = 0.0
) -> Fixture:
    """One convex hull for each connected piece of a surface of ``triangles`` (M, 3), rows of ``vertices``.

    Every piece must be closed: the hull of a closed surface contains what it encloses.

    Raises
    ------
    WorkspaceError
        There is no triangle, a piece is open, or there are too many.
    """
    used = triangles[[len(set(corners)) == 3 for corners in triangles.tolist()]]
    edges = np.sort(np.vstack([used[:, [0, 1]], used[:, [1, 2]], used[:, [2, 0]]]), axis=1)
    _, sharing = np.unique(edges, axis=0, return_counts=True)
    if len(used) == 0 or (sharing % 2 != 0).any():
        raise WorkspaceError(
            f"fixture {name}: the surface is not closed, so that its pieces enclose nothing; use "
            'pieces = "hull", or close it'
        )
    owner = _components(len(vertices), edges)
    pieces = [vertices[owner == each] for each in np.unique(owner[used[:, 0]])]
    if len(pieces) > MAX_PIECES:
        raise WorkspaceError(f"fixture {name}: {len(pieces)} connected pieces; the maximum is {MAX_PIECES}")
    return Fixture(name, tuple(_hull_piece(name, each, pose) for each in pieces), error)


def _components(n: int, edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Smallest vertex (n,) that each vertex is connected with."""
    owner = np.arange(n)
    while True:
        low = np.minimum(owner[edges[:, 0]], owner[edges[:, 1]])
        lower = owner.copy()
        np.minimum.at(lower, edges[:, 0], low)
        np.minimum.at(lower, edges[:, 1], low)
        lower = lower[lower]
        if np.array_equal(lower, owner):
            return owner
        owner = lower


_DIRECTIONS: Final = np.array(
    [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], dtype=np.float64
)


def _hull_piece(name: str, vertices: Array, pose: Mount) -> Piece:
    if len(vertices) == 0:
        raise WorkspaceError(f"fixture {name}: there is no vertex")
    balls = extreme_balls(simplified(point_balls(_place(name, "the mesh", vertices))))
    corners = _place(name, "the mesh", place(balls, pose.rotation, pose.translation)[:, :3])
    normals = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)
    return _piece(corners, SLACK, normals @ pose.rotation.T)


def _piece(corners: Array, radius: float, normals: Array) -> Piece:
    along = (corners @ normals.T).max(axis=0)
    size = float(np.abs(corners).max())
    return Piece(corners, radius, np.column_stack([normals, along + ROUNDING * size]))


def _place(name: str, key: str, value: ArrayLike) -> Array:
    numbers = np.asarray(value, dtype=np.float64)
    if not (np.abs(numbers) <= FARTHEST).all():
        raise WorkspaceError(
            f"fixture {name}: {key} has a number that is not finite or beyond {FARTHEST:g} m"
        )
    return numbers


def _length(name: str, key: str, value: float) -> None:
    if not 0.0 <= value <= FARTHEST:
        raise WorkspaceError(f"fixture {name}: {key} = {value} must be finite and not negative")


class Workspace:
    """Checks the arm against fixtures.

    Parameters
    ----------
    fixtures:
        What stands there, each with a name of its own.
    links:
        Names of the enclosure rows.
    may_touch:
        Fixture -> links that are not held against it.
    margin:
        A pair counts as apart when its certified gap exceeds this [m].

    Raises
    ------
    WorkspaceError
        Too many fixtures or pieces, a name that stands twice or is not known, or a margin that is no length.
    """

    def __init__(
        self,
        fixtures: Sequence[Fixture],
        links: Sequence[str],
        may_touch: Mapping[str, Collection[str]],
        margin: float,
    ) -> None:
        self.fixtures = tuple(fixtures)
        self.names = tuple(fixture.name for fixture in fixtures)
        self.exempt = _exempt(self.names, links, may_touch)
        if not 0.0 <= margin < np.inf:
            raise WorkspaceError(f"the margin must be finite and not negative, not {margin} m")
        self._margin = float(margin)
        self._n_links = len(links)
        self._block, self._corners = _pack(fixtures)
        for link, fixture in self.exempt:
            self._block["exempt"][0, list(links).index(link), self.names.index(fixture)] = 1
        self._balls = np.zeros((LINK_SETS["radius"].shape[0], 5))
        self._scratch = new_scratch()
        self._nearest = new_blocked()

    @property
    def content_hash(self) -> str:
        """SHA-256 of all that a verdict about the workspace rests on."""
        text = repr((self.names, self.exempt, self._margin)).encode()
        return hashlib.sha256(text + self._block.tobytes() + self._corners.tobytes()).hexdigest()

    def check(self, links: Block, slices: Block, active: NDArray[np.uint8]) -> Blocked | None:
        """Return what keeps an active link from being proven apart from every fixture on every slice, if any.

        ``active`` (L,): links that are held against fixtures. Never raises; NaN proves nothing.
        """
        proven = kernels.check_fixtures(
            links,
            int(slices["n"][0]),
            self._n_links,
            active,
            self._block,
            self._corners,
            self._margin,
            self._balls,
            self._scratch,
            self._nearest,
        )
        return None if proven else blocked(self._nearest, self.names)


def _exempt(
    names: Sequence[str], links: Sequence[str], may_touch: Mapping[str, Collection[str]]
) -> tuple[tuple[str, str], ...]:
    if len(set(names)) != len(names):
        raise WorkspaceError(f"fixtures must have names of their own, not {', '.join(names)}")
    pairs = []
    for fixture, allowed in may_touch.items():
        if fixture not in names:
            raise WorkspaceError(f"fixture {fixture} is not known; there are: {', '.join(names)}")
        for link in allowed:
            if link not in links:
                known = ", ".join(links)
                raise WorkspaceError(
                    f"fixture {fixture}: may_touch: link {link} is not known; there are: {known}"
                )
            pairs.append((link, fixture))
    return tuple(dict.fromkeys(pairs))


def _pack(fixtures: Sequence[Fixture]) -> tuple[Block, Array]:
    """Return the block of all pieces and their corners (N, 3)."""
    pieces = [(f, piece) for f, fixture in enumerate(fixtures) for piece in fixture.pieces]
    for number, most, what in (
        (len(fixtures), MAX_FIXTURES, "fixtures"),
        (len(pieces), MAX_PIECES, "pieces"),
    ):
        if number > most:
            raise WorkspaceError(f"{number} {what} in the workspace; the maximum is {most}")
    block, corners = np.zeros(1, dtype=_FIXTURES), [np.empty((0, 3))]
    rows = block[0]
    rows["n"] = len(pieces)
    for p, (f, piece) in enumerate(pieces):
        radius = piece.radius + fixtures[f].position_error_m
        rows["fixture"][p], rows["radius"][p] = f, radius
        rows["n_facets"][p] = len(piece.facets)
        rows["facet"][p, : len(piece.facets)] = piece.facets
        rows["first"][p + 1 :] = rows["first"][p] + len(piece.points)
        corners.append(piece.points)
        rows["ball"][p] = _ball(piece, radius)
    return block, np.vstack(corners)


def _ball(piece: Piece, radius: float) -> Array:
    """Enclosing ball and magnitude of a piece; of a half-space the magnitude alone counts."""
    ball = np.zeros(5)
    if len(piece.points) == 0:
        ball[4] = float(np.abs(piece.facets[:, 3]).max()) + radius
        return ball
    ball[:3] = piece.points.mean(axis=0)
    ball[4] = float(np.abs(piece.points).max()) + radius
    around = float(np.linalg.norm(piece.points - ball[:3], axis=1).max())
    ball[3] = around + radius + ROUNDING * ball[4]
    return ball
