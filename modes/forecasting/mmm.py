"""Whole-body motions of KIT in the format of the Master Motor Map (``<id>_mmm.xml``), as points of a person.

The paper trained on KIT's motions, which were not at hand: nothing here was tried on one of their files, and
what follows is **unverified**. A file has ``Motion`` with ``JointOrder``, and ``MotionFrames`` that have
``Timestep`` [s], ``RootPosition`` [mm], ``RootRotation`` [rad] and ``JointPosition`` [rad]; the height of
the subject is in ``ModelProcessorConfig``. The model has z up, and the person at rest faces along y.

Taken as given, and to be checked with a real file before it is relied on: the rotation of the root is roll,
pitch and yaw about fixed axes; a joint turns about x, then the turned y, then the turned z, on both sides in
the same sense; lengths are shares of the height, after D. A. Winter, as others who read such files have them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.dataset import Recording
from modes.forecasting.skeleton import joints_of_points
from modes.settings import require_number
from occupancy.body import MAX_POINTS, Point
from robots.errors import SetupError

Array = NDArray[np.float64]

LICENCE = "KIT whole-body human motion database: see its terms of use"
_MM = 1e-3

_SEGMENTS: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("BP", "ROOT", (0.0, 0.0, 0.040)), ("BT", "BP", (0.0, 0.0, 0.060)), ("CS", "BT", (0.0, 0.0, 0.188)),
    ("BLN", "CS", (0.0, 0.0, 0.022)), ("BUN", "BLN", (0.0, 0.0, 0.030)),
    ("LS", "CS", (-0.110, 0.0, 0.0)), ("LE", "LS", (0.0, 0.0, -0.188)), ("LW", "LE", (0.0, 0.0, -0.145)),
    ("RS", "CS", (0.110, 0.0, 0.0)), ("RE", "RS", (0.0, 0.0, -0.188)), ("RW", "RE", (0.0, 0.0, -0.145)),
    ("LH", "ROOT", (-0.052, 0.0, 0.0)), ("LK", "LH", (0.0, 0.0, -0.245)), ("LA", "LK", (0.0, 0.0, -0.246)),
    ("RH", "ROOT", (0.052, 0.0, 0.0)), ("RK", "RH", (0.0, 0.0, -0.245)), ("RA", "RK", (0.0, 0.0, -0.246)),
)  # fmt: skip
"""Joint, the one before it, and the way from there at rest, for a height of 1."""
_POINTS: dict[Point, tuple[str, tuple[float, float, float]]] = {
    Point.PELVIS: ("ROOT", (0.0, 0.0, 0.0)), Point.THORAX: ("BT", (0.0, 0.0, 0.094)),
    Point.NECK_BASE: ("BLN", (0.0, 0.0, 0.0)), Point.HEAD: ("BUN", (0.0, 0.02, 0.06)),
    Point.L_SHOULDER: ("LS", (0.0, 0.0, 0.0)), Point.L_ELBOW: ("LE", (0.0, 0.0, 0.0)),
    Point.L_WRIST: ("LW", (0.0, 0.0, 0.0)), Point.L_HAND: ("LW", (0.0, 0.0, -0.050)),
    Point.L_FINGERTIP: ("LW", (0.0, 0.0, -0.108)), Point.R_SHOULDER: ("RS", (0.0, 0.0, 0.0)),
    Point.R_ELBOW: ("RE", (0.0, 0.0, 0.0)), Point.R_WRIST: ("RW", (0.0, 0.0, 0.0)),
    Point.R_HAND: ("RW", (0.0, 0.0, -0.050)), Point.R_FINGERTIP: ("RW", (0.0, 0.0, -0.108)),
    Point.L_HIP: ("LH", (0.0, 0.0, 0.0)), Point.L_KNEE: ("LK", (0.0, 0.0, 0.0)),
    Point.L_ANKLE: ("LA", (0.0, 0.0, 0.0)), Point.R_HIP: ("RH", (0.0, 0.0, 0.0)),
    Point.R_KNEE: ("RK", (0.0, 0.0, 0.0)), Point.R_ANKLE: ("RA", (0.0, 0.0, 0.0)),
}  # fmt: skip
"""Points of a measurement: the joint that carries it, and where from there; heads and thorax are guesses."""


def read_mmm(path: Path, height_m: float | None = None) -> Recording:
    """Return the motion of the person in a file, joints as the project has them; z up.

    Parameters
    ----------
    height_m:
        Of the subject [m]; None: as the file says.

    Raises
    ------
    SetupError
        It is no such file, it declares entities, has no height, or numbers are missing or not finite.
    """
    t, points = read_mmm_points(path, height_m)
    subject = path.stem.removesuffix("_mmm")
    return Recording(path.stem, f"kit_{subject}", LICENCE, t, joints_of_points(points))


def read_mmm_points(path: Path, height_m: float | None = None) -> tuple[Array, Array]:
    """Return the times ``(frames,)`` [s] and points ``(frames, 20, 3)`` [m]; as :func:`read_mmm`."""
    motion = _motion_of_person(path)
    names = [str(each.get("name")) for each in motion.findall("JointOrder/Joint")]
    height = _height(path, motion) if height_m is None else height_m
    require_number(f"{path.name}: height of the subject", height, 0.5, 2.6)
    frames = motion.findall("MotionFrames/MotionFrame")
    if len(frames) < 2:
        raise SetupError(f"{path.name}: {len(frames)} frames of motion, of which 2 are needed")
    t = _numbers(path, frames, "Timestep", 1)[:, 0]
    if not (np.diff(t) > 0.0).all():
        raise SetupError(f"{path.name}: time steps do not increase")
    root = _MM * _numbers(path, frames, "RootPosition", 3)
    turn = _numbers(path, frames, "RootRotation", 3)
    angles = dict(zip(names, _numbers(path, frames, "JointPosition", len(names)).T, strict=True))
    return t, points_of_model(root, turn, angles, height)


def points_of_model(root: Array, turn: Array, angles: dict[str, Array], height: float) -> Array:
    """Return points ``(frames, 20, 3)`` [m] of the model at joint angles ``(frames,)`` [rad] by their names.

    ``root``, ``turn``: ``(frames, 3)`` [m; rad]. Joints that are not named do not turn.
    """
    placed = {"ROOT": (root, _about(2, turn[:, 2]) @ _about(1, turn[:, 1]) @ _about(0, turn[:, 0]))}
    still = np.zeros(len(root))
    for joint, before, way in _SEGMENTS:
        place, rotation = placed[before]
        place = place + rotation @ (height * np.array(way))
        for axis, letter in enumerate("xyz"):
            angle = angles.get(f"{joint}{letter}_joint")
            rotation = rotation if angle is None else rotation @ _about(axis, still + angle)
        placed[joint] = place, rotation
    points = np.full((len(root), MAX_POINTS, 3), np.nan)
    for point, (joint, way) in _POINTS.items():
        place, rotation = placed[joint]
        points[:, point] = place + rotation @ (height * np.array(way))
    return points


def _motion_of_person(path: Path) -> ET.Element:
    """Return the first motion that turns joints of a person; others are objects."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SetupError(f"{path.name}: cannot be read as UTF-8: {error}") from error
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise SetupError(f"{path.name}: declares a document type or entities, which motions do not need")
    try:
        tree = ET.fromstring(text)
    except ET.ParseError as error:
        raise SetupError(f"{path.name}: no XML: {error}") from error
    for motion in tree.findall("Motion"):
        names = {each.get("name") for each in motion.findall("JointOrder/Joint")}
        if names & {"LSx_joint", "RSx_joint"}:
            return motion
    raise SetupError(f"{path.name}: no Motion whose JointOrder has LSx_joint; later formats are not read")


def _height(path: Path, motion: ET.Element) -> float:
    said = motion.findtext("ModelProcessorConfig/Height")
    try:
        return float(said or "")
    except ValueError as error:
        raise SetupError(
            f"{path.name}: height {said!r} of the subject is no number: give height_m"
        ) from error


def _numbers(path: Path, frames: list[ET.Element], name: str, count: int) -> Array:
    """Return ``(frames, count)`` numbers of one element of each frame."""
    rows = []
    for k, frame in enumerate(frames):
        words = (frame.findtext(name) or "").split()
        try:
            row = [float(word) for word in words]
        except ValueError as error:
            raise SetupError(f"{path.name}: {name} of frame {k}: {error}") from error
        if len(row) != count or not np.isfinite(row).all():
            raise SetupError(
                f"{path.name}: {name} of frame {k} has {len(row)} numbers, not {count} finite ones"
            )
        rows.append(row)
    return np.array(rows)


def _about(axis: int, angle: Array) -> Array:
    """Return rotations ``(frames, 3, 3)`` about an axis."""
    out = np.zeros((len(angle), 3, 3))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    out[:, axis, axis], out[:, a, a], out[:, b, b] = 1.0, c, c
    out[:, a, b], out[:, b, a] = -s, s
    return out
