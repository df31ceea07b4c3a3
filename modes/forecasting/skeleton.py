"""The paper's 15 joints, between the 20 points of measurements and the bones that a network sees.

Names are those of the markers of the KIT whole-body set. CLAV and C7 lie before and behind the base of the
neck, L3 on the way from pelvis to neck; none of them is among the points of a measurement, so they are put
where :func:`joints_of_points` says. Heads, hands and the middle of the trunk are no joints: they go where
the joints carry them (:func:`points_of_joints`).
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Point
from robots.errors import SetupError

Array = NDArray[np.float64]


class Joint(IntEnum):
    """The joints that the paper tracks; the value is the row in arrays."""

    CLAV = 0
    C7 = 1
    LSHO = 2
    RSHO = 3
    LAEL = 4
    RAEL = 5
    LWPS = 6
    RWPS = 7
    L3 = 8
    LHIP = 9
    RHIP = 10
    LKNE = 11
    RKNE = 12
    LHEE = 13
    RHEE = 14


JOINTS = len(Joint)
ROOT = Joint.L3
BONES: tuple[tuple[Joint, Joint], ...] = (
    (Joint.L3, Joint.C7), (Joint.C7, Joint.CLAV), (Joint.C7, Joint.LSHO), (Joint.C7, Joint.RSHO),
    (Joint.LSHO, Joint.LAEL), (Joint.RSHO, Joint.RAEL), (Joint.LAEL, Joint.LWPS), (Joint.RAEL, Joint.RWPS),
    (Joint.L3, Joint.LHIP), (Joint.L3, Joint.RHIP), (Joint.LHIP, Joint.LKNE), (Joint.RHIP, Joint.RKNE),
    (Joint.LKNE, Joint.LHEE), (Joint.RKNE, Joint.RHEE),
)  # fmt: skip
"""From the joint nearer to the root to the one farther away; every joint but the root ends one of them."""

_SAME: dict[Joint, Point] = {
    Joint.LSHO: Point.L_SHOULDER, Joint.RSHO: Point.R_SHOULDER, Joint.LAEL: Point.L_ELBOW,
    Joint.RAEL: Point.R_ELBOW, Joint.LWPS: Point.L_WRIST, Joint.RWPS: Point.R_WRIST, Joint.LHIP: Point.L_HIP,
    Joint.RHIP: Point.R_HIP, Joint.LKNE: Point.L_KNEE, Joint.RKNE: Point.R_KNEE, Joint.LHEE: Point.L_ANKLE,
    Joint.RHEE: Point.R_ANKLE,
}  # fmt: skip
_CARRIED: dict[Point, tuple[Joint, ...]] = {
    Point.HEAD: (Joint.C7, Joint.CLAV), Point.NECK_BASE: (Joint.C7, Joint.CLAV),
    Point.THORAX: (Joint.C7, Joint.L3), Point.PELVIS: (Joint.LHIP, Joint.RHIP, Joint.L3),
}  # fmt: skip
"""Points that move as the mean of some joints does."""
_HANDS: tuple[tuple[Point, Joint, Joint], ...] = (
    (Point.L_HAND, Joint.LAEL, Joint.LWPS), (Point.L_FINGERTIP, Joint.LAEL, Joint.LWPS),
    (Point.R_HAND, Joint.RAEL, Joint.RWPS), (Point.R_FINGERTIP, Joint.RAEL, Joint.RWPS),
)  # fmt: skip
"""Points that turn with the forearm between two joints."""
_BEFORE_NECK_M = 0.06
_L3_SHARE = 0.25
"""Of the way from the pelvis to the base of the neck; the paper says *interpolated*, and no share."""


def joints_of_points(xyz: Array) -> Array:
    """Return joints ``(..., 15, 3)`` [m] of points ``(..., 20, 3)`` [m]; NaN: not known.

    CLAV and C7 are 60 mm before and behind the base of the neck, level with it across the line of the
    shoulders; L3 is a quarter of the way up from the pelvis. The heel is taken to be the ankle.

    Raises
    ------
    SetupError
        The shape is another one.
    """
    points = np.asarray(xyz, dtype=float)
    if points.ndim < 2 or points.shape[-2:] != (MAX_POINTS, 3):
        raise SetupError(f"points of shape {points.shape} should be (..., 20, 3)")
    out = np.full((*points.shape[:-2], JOINTS, 3), np.nan)
    for joint, point in _SAME.items():
        out[..., joint, :] = points[..., point, :]
    neck, pelvis = points[..., Point.NECK_BASE, :], points[..., Point.PELVIS, :]
    across = points[..., Point.L_SHOULDER, :] - points[..., Point.R_SHOULDER, :]
    ahead = np.cross(across, neck - pelvis)
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = _BEFORE_NECK_M * ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
    out[..., Joint.CLAV, :], out[..., Joint.C7, :] = neck + ahead, neck - ahead
    out[..., Joint.L3, :] = pelvis + _L3_SHARE * (neck - pelvis)
    return out


def points_of_joints(joints: Array, last: Array, before: Array | None = None) -> Array:
    """Return points ``(frames, 20, 3)`` [m] of joints ``(frames, 15, 3)``, from where points were ``last``.

    ``before``: where joints (15, 3) were then; None: :func:`joints_of_points` says.

    Points that are joints are where these are. Others go as the joints next to them do: hands turn with their
    forearms, head and trunk move along. NaN where ``last`` (20, 3) is, or joints are.

    Raises
    ------
    SetupError
        A shape is another one.
    """
    _require_joints(joints, 3)
    before = joints_of_points(last) if before is None else before
    out = np.full((len(joints), MAX_POINTS, 3), np.nan)
    for point, carriers in _CARRIED.items():
        out[:, point] = last[point] + (joints[:, carriers] - before[list(carriers)]).mean(axis=1)
    for point, elbow, wrist in _HANDS:
        turn = _turns(before[wrist] - before[elbow], joints[:, wrist] - joints[:, elbow])
        out[:, point] = joints[:, wrist] + turn @ (last[point] - before[wrist])
    for joint, point in _SAME.items():
        known = np.isfinite(last[point]).all()
        out[:, point] = joints[:, joint] if known else np.nan
    return out


def bones_of(joints: Array) -> tuple[Array, Array]:
    """Return unit vectors ``(..., 14, 3)`` and lengths ``(..., 14)`` [m] of bones between ``(..., 15, 3)``.

    A bone of no length points up.

    Raises
    ------
    SetupError
        The shape is another one.
    """
    _require_joints(joints, None)
    begins, ends = (list(each) for each in zip(*BONES, strict=True))
    away = joints[..., ends, :] - joints[..., begins, :]
    length = np.linalg.norm(away, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = np.where(length[..., None] == 0.0, (0.0, 0.0, 1.0), away / length[..., None])
    return unit, length


def joints_of_bones(root: Array, unit: Array, length: Array) -> Array:
    """Return joints ``(..., 15, 3)`` [m] along bones from the root ``(..., 3)`` [m]: :func:`bones_of` undone.

    Directions need not have length 1: they are made so.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = unit / np.linalg.norm(unit, axis=-1, keepdims=True)
    out = np.empty((*root.shape[:-1], JOINTS, 3))
    out[..., ROOT, :] = root
    for k, (begin, end) in enumerate(BONES):
        out[..., end, :] = out[..., begin, :] + length[..., k, None] * unit[..., k, :]
    return out


def _require_joints(joints: Array, ndim: int | None) -> None:
    fits = joints.ndim >= 2 and joints.shape[-2:] == (JOINTS, 3) and ndim in {None, joints.ndim}
    if not fits:
        raise SetupError(
            f"skeleton: joints of shape {joints.shape} should end with (15, 3): "
            f"{', '.join(each.name for each in Joint)}"
        )


def _turns(before: Array, after: Array) -> Array:
    """Return the least rotations ``(frames, 3, 3)`` that turn ``before`` (3,) to ``after`` (frames, 3)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        a = before / np.linalg.norm(before)
        b = after / np.linalg.norm(after, axis=1, keepdims=True)
        v, c = np.cross(a, b), b @ a
        skew = np.zeros((len(b), 3, 3))
        skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
        skew -= skew.transpose(0, 2, 1)
        turn = np.eye(3) + skew + skew @ skew / (1.0 + c)[:, None, None]
    turn[c < -1.0 + 1e-9] = np.eye(3)  # folded back onto itself: any half turn would do
    return np.asarray(turn)
