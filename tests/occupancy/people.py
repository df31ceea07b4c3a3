"""People for tests: a standing person, random admissible persons, reports of them, clips."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, POINT_NAMES, Point
from occupancy.measurement import Gate, GateSettings, RawMeasurement, RawPerson

Array = NDArray[np.float64]
ALL_POINTS = (1 << MAX_POINTS) - 1
UNSTATED = np.full(MAX_POINTS, np.nan)

STANDING: dict[str, tuple[float, float, float]] = {
    "head": (0.0, 0.0, 1.65), "neck_base": (0.0, 0.0, 1.42), "thorax": (0.0, 0.0, 1.25),
    "pelvis": (0.0, 0.0, 0.95),
    "l_shoulder": (0.0, 0.18, 1.40), "l_elbow": (0.0, 0.22, 1.10), "l_wrist": (0.0, 0.24, 0.85),
    "l_hand": (0.0, 0.24, 0.77), "l_fingertip": (0.0, 0.24, 0.68), "l_hip": (0.0, 0.10, 0.90),
    "l_knee": (0.0, 0.10, 0.48), "l_ankle": (0.0, 0.10, 0.08),
}  # fmt: skip
"""A person of 1.75 m; the right side mirrors the left."""


def standing(x: float = 2.0, y: float = 0.0) -> Array:
    """Points (20, 3) of a person who stands at (x, y) [m]."""
    points = np.empty((MAX_POINTS, 3))
    for column, name in enumerate(POINT_NAMES):
        mirrored = name.startswith("r_")
        own = STANDING[name.replace("r_", "l_", 1) if mirrored else name]
        points[column] = (x + own[0], y + (-own[1] if mirrored else own[1]), own[2])
    return points


def mask(*points: Point) -> int:
    """Bit mask of points."""
    return sum(1 << point for point in points)


def report(
    stamp: float, *people: tuple[str, Array], frame: str = "world", measured: int = ALL_POINTS
) -> RawMeasurement:
    """A report that arrives at once; NaN points count as measured only if ``measured`` says so."""
    persons = []
    for name, xyz in people:
        finite = sum(1 << int(p) for p in np.flatnonzero(np.isfinite(xyz).all(axis=1)))
        persons.append(RawPerson(name, xyz, UNSTATED, measured & finite))
    return RawMeasurement(stamp, stamp, frame, True, tuple(persons))


def only(xyz: Array, *points: Point) -> Array:
    """The same points, all others missing."""
    kept = np.full_like(xyz, np.nan)
    kept[list(points)] = xyz[list(points)]
    return kept


def settings(**changes: object) -> GateSettings:
    """Exact clocks and stamps, 1 cm position error, people who may stand perfectly still, with changes."""
    values: dict[str, object] = {
        "clock_error_s": 0.0,
        "stamp_error_s": 0.0,
        "position_error_m": 0.01,
        "believe_repeats": True,
    }
    return GateSettings(**(values | changes))


def rows_of(gate: Gate, person: str) -> list[int]:
    """Rows of a person in the people block."""
    record = gate.people[0]
    number = gate.person_ids.index(person)
    return [k for k in range(int(record["n"])) if record["person"][k] == number]


def clip(path: Path) -> tuple[Array, Array]:
    """Stamps (T,) and points (T, 20, 3) of an NPZ recording; points that it lacks are NaN."""
    with np.load(path) as data:
        names, xyz = [str(name) for name in data["joints"]], data["xyz"]
        points = np.full((len(xyz), MAX_POINTS, 3), np.nan)
        for column, name in enumerate(names):
            if name in POINT_NAMES:
                points[:, POINT_NAMES.index(name)] = xyz[:, column]
        return data["t"].astype(np.float64), points


def clips(folder: Path, unwanted: Callable[[str], bool] = lambda name: False) -> Iterator[Path]:
    """Recordings of a folder."""
    yield from (path for path in sorted(folder.glob("*.npz")) if not unwanted(path.name))
