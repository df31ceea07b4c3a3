"""The enclosure: capsules that provably contain all link geometry, kept by content hash."""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray

from robots.assumption import Certainty
from robots.capsule import LARGEST, Capsule, extreme_balls, fit_capsule, rough_volume
from robots.errors import SetupError
from robots.files import read_bytes
from robots.geometry import moving_geometry, read_mesh
from robots.limits import Array
from robots.model import Mount, Tree
from robots.motion import MAX_JOINTS, Block
from robots.reach import reach
from robots.shapes import place

MAX_LINKS = 24
CERTAINTIES = tuple(Certainty)
"""Field ``certainty`` of an enclosure row is the index in this tuple."""

ENCLOSURE = np.dtype(
    [
        ("n", np.int64),
        ("joint", np.int32, (MAX_LINKS,)),
        ("a", np.float64, (MAX_LINKS, 3)),
        ("b", np.float64, (MAX_LINKS, 3)),
        ("radius", np.float64, (MAX_LINKS,)),
        ("reach", np.float64, (MAX_LINKS, MAX_JOINTS)),
        ("certainty", np.int8, (MAX_LINKS,)),
    ]
)
"""``n`` capsules of moving links. ``a``, ``b`` [m]: axis end points in the frame of joint ``joint``.
``reach`` [m]: bound on the distance of both end points from each joint's axis (:mod:`robots.reach`)."""

_WORTH_MERGING = 1.02
"""Links on one joint share a capsule if it has at most this share of the volume of their own capsules."""
_MAY_BE_WORTH_MERGING = 1.3
"""Pairs whose shared capsule is roughly larger than this share are not looked at more closely."""
_EQUAL = 1e-6
"""Share by which volumes differ that count as equal."""
_VERSION = 7
"""Part of the key of what is kept: raise it when reading or fitting changes."""


NO_CORNERS: Array = np.empty((0, 4))


@dataclass(frozen=True, eq=False)
class EnclosedPart:
    """A capsule in the frame of joint ``joint``, and the balls (N, 4) whose hull it was proven to contain.

    ``corners`` is empty where the capsule was declared instead of fitted.
    """

    name: str
    joint: int
    capsule: Capsule
    corners: Array
    certainty: Certainty
    source: str


def enclose(tree: Tree, cache_dir: Path | None) -> tuple[EnclosedPart, ...]:
    """Enclose the collision and visual geometry of every link that a commanded joint moves.

    What was fitted before for the same files is read from ``cache_dir``; a missing, broken or unwritable
    cache only costs time, and so does None. Containment is checked in either case.

    Raises
    ------
    SetupError
        If geometry cannot be read or enclosed, naming link and rule.
    """
    files = [(link, file) for link, file in tree.urdf.meshes if tree.carrier(link) is not None]
    key = _key([str(tree.joints), tree.urdf.content], files)
    return _kept(cache_dir, key, lambda: _fit(tree))


def enclose_mesh(
    name: str, file: Path, joint: int, placement: Mount, cache_dir: Path | None
) -> tuple[EnclosedPart, ...]:
    """Enclose one mesh that is fixed to ``joint``, placed by ``placement``; see :func:`enclose`."""

    def fit() -> tuple[EnclosedPart, ...]:
        balls = place(read_mesh(file), placement.rotation, placement.translation)
        group = _Group((name,), joint, balls, fit_capsule(balls))
        return (_proven(group, f"smallest capsule found around {file.name}"),)

    numbers = np.concatenate([placement.rotation.ravel(), placement.translation]).tobytes()
    return _kept(cache_dir, _key([f"{name} {joint}", numbers], [(name, file)]), fit)


def prove(part: EnclosedPart) -> None:
    """Check that the capsule contains all corners; being convex, it then contains all pieces between them.

    Raises
    ------
    SetupError
        If anything sticks out.
    """
    if len(part.corners) and not part.capsule.contains(part.corners):
        excess = part.capsule.excess(part.corners)
        if not max(float(np.abs(part.corners).max()), part.capsule.radius) <= LARGEST:
            raise SetupError(
                f"link {part.name}: geometry beyond {LARGEST:g} m of its joint cannot be enclosed"
            )
        raise SetupError(f"link {part.name}: geometry sticks out of its capsule by {excess:.3g} m")


def pack(parts: Sequence[EnclosedPart], kinematics: Block, lower: Array, upper: Array) -> Block:
    """Return the :data:`ENCLOSURE` block.

    Raises
    ------
    SetupError
        If there are more than 24 capsules.
    """
    if len(parts) > MAX_LINKS:
        raise SetupError(f"{len(parts)} capsules on moving links; the maximum is {MAX_LINKS}")
    block = np.zeros(1, dtype=ENCLOSURE)
    rows = block[0]
    rows["n"] = len(parts)
    for i, part in enumerate(parts):
        rows["joint"][i] = part.joint
        rows["a"][i], rows["b"][i] = part.capsule.a, part.capsule.b
        rows["radius"][i] = part.capsule.radius
        rows["certainty"][i] = CERTAINTIES.index(part.certainty)
        ends = np.array([part.capsule.a, part.capsule.b])
        rows["reach"][i] = reach(kinematics, lower, upper, part.joint, ends)
    return block


@dataclass(frozen=True, eq=False)
class _Group:
    """Links on one joint that share a capsule; the first name is the largest one's."""

    names: tuple[str, ...]
    joint: int
    balls: Array
    capsule: Capsule

    def merged(self, other: _Group) -> _Group:
        balls = np.vstack([self.balls, other.balls])
        # equal but for rounding: the first one of the tree, else the name would depend on the processor
        is_larger = other.capsule.volume > (1.0 + _EQUAL) * self.capsule.volume
        big, small = (other, self) if is_larger else (self, other)
        return _Group(big.names + small.names, self.joint, balls, fit_capsule(balls))

    def roughly(self, other: _Group) -> float:
        """Volume of a shared capsule over the volume of both, about; a little too large."""
        balls = np.vstack([extreme_balls(self.balls), extreme_balls(other.balls)])
        return rough_volume(balls) / (self.capsule.volume + other.capsule.volume)


def _fit(tree: Tree) -> tuple[EnclosedPart, ...]:
    source = f"smallest capsule found around collision and visual geometry, {tree.urdf.path.name}"
    groups = [
        _Group((link,), joint, balls, fit_capsule(balls))
        for (link, joint), balls in moving_geometry(tree).items()
    ]
    return tuple(_proven(group, source) for group in _merge(groups))


def _merge(groups: list[_Group]) -> list[_Group]:
    """Let links on one joint share a capsule where that hardly adds volume, or where there are too many."""
    rough: dict[tuple[tuple[str, ...], tuple[str, ...]], float] = {}
    while True:
        pairs = [(a, b) for a, b in combinations(groups, 2) if a.joint == b.joint]
        for a, b in pairs:
            if (a.names, b.names) not in rough:
                rough[a.names, b.names] = a.roughly(b)
        pairs.sort(key=lambda pair: rough[pair[0].names, pair[1].names])
        for a, b in pairs:
            crowded = len(groups) > MAX_LINKS
            if rough[a.names, b.names] > _MAY_BE_WORTH_MERGING and not crowded:
                return groups
            joined = a.merged(b)
            if crowded or joined.capsule.volume <= _WORTH_MERGING * (a.capsule.volume + b.capsule.volume):
                groups = [joined if group is a else group for group in groups if group is not b]
                break
            rough[a.names, b.names] = np.inf
        else:
            return groups


def _proven(group: _Group, source: str) -> EnclosedPart:
    """Check the capsule against all balls, then keep those that span their hull."""
    name, certainty = group.names[0], Certainty.COMPUTED
    prove(EnclosedPart(name, group.joint, group.capsule, group.balls, certainty, source))
    if len(group.names) > 1:
        source += f"; with {', '.join(group.names[1:])}"
    return EnclosedPart(name, group.joint, group.capsule, extreme_balls(group.balls), certainty, source)


def _key(content: Sequence[str | bytes], files: Sequence[tuple[str, Path]]) -> str:
    """Hash of all that a fit depends on."""
    digest = hashlib.sha256(f"{_VERSION} {pinocchio.__version__}".encode())
    for item in content:
        digest.update(hashlib.sha256(item.encode() if isinstance(item, str) else item).digest())
    for link, file in files:
        digest.update(hashlib.sha256(f"{link} {file.suffix.lower()}".encode()).digest())
        digest.update(hashlib.sha256(read_bytes(file)).digest())
    return digest.hexdigest()[:32]


def _kept(
    cache_dir: Path | None, key: str, fit: Callable[[], tuple[EnclosedPart, ...]]
) -> tuple[EnclosedPart, ...]:
    file = None if cache_dir is None else cache_dir / f"enclosure-{key}.json"
    parts = None if file is None else _read(file)
    if parts is None:
        parts = fit()
        if file is not None:
            _write(file, parts)
    for part in parts:
        prove(part)
    return parts


def default_cache_dir() -> Path | None:
    """Folder for what can be computed again: ``$XDG_CACHE_HOME/stopproof`` or ``~/.cache/stopproof``.

    None where the user has no home, as in some containers: nothing is kept then.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "stopproof"
    except RuntimeError:
        return None


def _write(file: Path, parts: Sequence[EnclosedPart]) -> None:
    rows = [
        {
            "name": part.name, "joint": part.joint,
            "a": part.capsule.a.tolist(), "b": part.capsule.b.tolist(),
            "radius": part.capsule.radius, "source": part.source,
            "corners": base64.b64encode(part.corners.tobytes()).decode(),
        }
        for part in parts
    ]  # fmt: skip
    text = json.dumps({"digest": _digest(rows), "rows": rows})
    temporary = file.with_suffix(f".{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(file)
    except OSError:  # nothing is lost but time
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _read(file: Path) -> tuple[EnclosedPart, ...] | None:
    """Parts from a cache file; None if it is not there, not whole or does not prove what it says."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        if content["digest"] != _digest(content["rows"]):
            return None
        parts = tuple(_part(row) for row in content["rows"])
        for part in parts:
            prove(part)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return parts


def _part(row: Mapping[str, Any]) -> EnclosedPart:
    capsule = Capsule(np.array(row["a"]), np.array(row["b"]), float(row["radius"]))
    corners: NDArray[np.float64] = np.frombuffer(base64.b64decode(row["corners"])).reshape(-1, 4)
    if not len(corners):
        raise SetupError("a fitted capsule without corners proves nothing")
    return EnclosedPart(row["name"], int(row["joint"]), capsule, corners, Certainty.COMPUTED, row["source"])


def _digest(rows: object) -> str:
    return hashlib.sha256(json.dumps(rows, sort_keys=True).encode()).hexdigest()
