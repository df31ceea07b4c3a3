"""From pixels with depth to the world: equations (1) to (4) of the paper, and what they leave open.

The frame of the camera is the paper's: X to the right of the image, Y along the optical axis, Z up. (2)
turns about X, so that its *roll* α tips the lens up (α > 0) or down; (3) turns about Y, so that its *pitch* β
lowers the right side of the image (β > 0) or lifts it. The paper gives no formula for either; :func:`tilt_of`
derives them from what an accelerometer at rest measures, which points up. Gravity does not tell the yaw, and
(4) no position: both belong to :class:`Mounting`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.settings import require_count, require_kind, require_number, require_numbers
from occupancy.report import SensorFrame
from robots.errors import SetupError

Array = NDArray[np.float64]
GRAVITY_M_S2 = 9.81
FEMTO_BOLT_IMU: Array = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Axes of the Femto Bolt's accelerometer -> frame of the camera: X points backwards, Y left and Z down in
Orbbec's page *Femto Bolt Coordinate Systems*. Its depth camera is tilted by 6° against the colour camera;
which of the two the accelerometer is parallel to has not been tried."""

_UPRIGHT_SHARE = 0.05


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole without distortion, for the image that landmarks and depth are both aligned to.

    Attributes
    ----------
    fx, fy:
        Focal lengths [px].
    cx, cy:
        Principal point [px]; the centre of the first pixel is (0, 0).
    width, height:
        Size of the image [px].
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            require_count(f"camera: {name}", getattr(self, name), 16, 20_000)
        for name in ("fx", "fy"):
            require_number(f"camera: {name}", getattr(self, name), 0.0, 1e6, above=True)
        require_number("camera: cx", self.cx, 0.0, float(self.width), above=True)
        require_number("camera: cy", self.cy, 0.0, float(self.height), above=True)

    @classmethod
    def of_table(cls, table: Mapping[str, Any]) -> Intrinsics:
        """Return the intrinsics of a table with exactly these keys, as a camera or a file states them.

        Raises
        ------
        SetupError
            A key is missing or unknown, or a number is none, or is not in its range.
        """
        known = ("fx", "fy", "cx", "cy", "width", "height")
        require_kind("camera: intrinsics", table, Mapping, written=f"a table of {', '.join(known)}")
        missing = [name for name in known if table.get(name) is None]
        if missing:
            raise SetupError(f"camera: {missing[0]} is missing; intrinsics are {', '.join(known)}")
        unknown = sorted(set(table) - set(known))
        if unknown:
            raise SetupError(f"camera: {unknown[0]!r} is not known; intrinsics are {', '.join(known)}")
        return cls(*(table[name] for name in known))

    def rays(self, uv: Array) -> Array:
        """Return what (1) multiplies by the depth, ``(..., 3)``, of pixels ``(..., 2)``."""
        u, v = uv[..., 0], uv[..., 1]
        return np.stack(((u - self.cx) / self.fx, np.ones_like(u), (self.cy - v) / self.fy), axis=-1)

    def pixels(self, xyz: Array) -> Array:
        """Return pixels ``(..., 2)`` of points ``(..., 3)`` [m] of the camera: (1) undone; NaN: behind it."""
        depth = np.where(xyz[..., 1] > 0.0, xyz[..., 1], np.nan)
        u = self.cx + self.fx * xyz[..., 0] / depth
        return np.stack((u, self.cy - self.fy * xyz[..., 2] / depth), axis=-1)


def points_of_pixels(uv: Array, depth_m: Array, camera: Intrinsics) -> Array:
    """Return points ``(..., 3)`` [m] of the camera by (1), of pixels ``(..., 2)`` with depths ``(...)`` [m].

    Depth is along the optical axis, as depth images have it, not along the ray.
    """
    return np.asarray(camera.rays(uv) * np.asarray(depth_m)[..., None])


class TiltOutcome(StrEnum):
    """Whether the tilt of a camera is known."""

    KNOWN = "known"
    NOT_READ = "the accelerometer gave no readings of three finite numbers"
    MOVING = "the accelerometer does not measure gravity alone: the camera moves"
    ON_ITS_SIDE = "the camera's X axis is vertical, so that gravity does not tell the roll about it"


class Tilt(NamedTuple):
    """Angles of (2) and (3) [rad]; NaN unless ``outcome`` is KNOWN."""

    outcome: TiltOutcome
    roll: float
    pitch: float

    @property
    def rotation(self) -> Array:
        """R_y(β) · R_x(α) of (4), (3, 3)."""
        return pitch_matrix(self.pitch) @ roll_matrix(self.roll)


LEVEL = Tilt(TiltOutcome.KNOWN, 0.0, 0.0)


def roll_matrix(angle: float) -> Array:
    """R_x(α) of (2)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def pitch_matrix(angle: float) -> Array:
    """R_y(β) of (3)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def yaw_matrix(angle: float) -> Array:
    """Rotation about the world's z axis, counter-clockwise seen from above."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def tilt_of(readings: object, imu: Array | None = None, *, tolerance_m_s2: float = 0.2) -> Tilt:
    """Return the tilt of a camera at rest from its accelerometer.

    At rest it measures g straight up: R_y(β) R_x(α) a = (0, 0, g). So a = g (-sin β, sin α cos β,
    cos α cos β), α = atan2(a_y, a_z) and β = atan2(-a_x, √(a_y² + a_z²)), with β from -90° to 90°.

    A camera that is carried can measure 9.81 m/s² in any direction: the length is necessary, and not enough.
    Readings over some time say more, because all of them must be within the tolerance of their mean.

    Parameters
    ----------
    readings:
        ``(3,)`` or ``(n, 3)`` [m/s²], in the axes of the accelerometer.
    imu:
        (3, 3) from these axes to the camera's, :data:`FEMTO_BOLT_IMU` for example; ``None``: they are the
        camera's.
    tolerance_m_s2:
        How far readings may be from gravity in length, and from their mean.

    Raises
    ------
    SetupError
        ``imu`` is no rotation, or the tolerance no positive number.
    """
    require_number("camera: tolerance_m_s2", tolerance_m_s2, 0.0, GRAVITY_M_S2, above=True)
    turn = np.eye(3) if imu is None else require_numbers("camera: imu", imu, (3, 3))
    if not (np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0.0):
        raise SetupError(f"camera: imu = {turn.tolist()} should be a rotation")
    try:
        found = np.atleast_2d(np.array(readings, dtype=np.float64))
    except (TypeError, ValueError):
        found = np.empty((0, 0))
    if found.ndim != 2 or found.shape[1:] != (3,) or not len(found) or not np.isfinite(found).all():
        return Tilt(TiltOutcome.NOT_READ, math.nan, math.nan)
    mean = found.mean(axis=0)
    off = np.abs(np.linalg.norm(found, axis=1) - GRAVITY_M_S2)
    apart = np.linalg.norm(found - mean, axis=1)
    if not max(off.max(), apart.max()) <= tolerance_m_s2:
        return Tilt(TiltOutcome.MOVING, math.nan, math.nan)
    x, y, z = (float(each) for each in turn @ mean)
    across = math.hypot(y, z)
    if across < _UPRIGHT_SHARE * GRAVITY_M_S2:
        return Tilt(TiltOutcome.ON_ITS_SIDE, math.nan, math.nan)
    return Tilt(TiltOutcome.KNOWN, math.atan2(y, z), math.atan2(-x, across))


@dataclass(frozen=True, eq=False)
class Mounting:
    """Where a camera is in the world, and how well that is known (assumption A6 of docs/method.md).

    Attributes
    ----------
    position_m:
        (3,) origin of the camera's frame [m].
    yaw_rad:
        About the world's z axis; at 0 the untilted camera looks along y, with x to its right.
    position_error_m, rotation_error_rad:
        Greatest error of the position, and of the whole rotation, tilt included.
    """

    position_m: Array = field(default_factory=lambda: np.zeros(3))
    yaw_rad: float = 0.0
    position_error_m: float = 0.0
    rotation_error_rad: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_m", require_numbers("mounting: position_m", self.position_m, (3,)))
        require_number("mounting: yaw_rad", self.yaw_rad, -2.0 * math.pi, 2.0 * math.pi)
        require_number("mounting: position_error_m", self.position_error_m, 0.0, 10.0)
        require_number("mounting: rotation_error_rad", self.rotation_error_rad, 0.0, math.pi)

    def to_world(self, xyz: Array, tilt: Tilt) -> Array:
        """Return points ``(..., 3)`` [m] in the world: (4), then yaw and position."""
        return np.asarray(xyz @ (yaw_matrix(self.yaw_rad) @ tilt.rotation).T + self.position_m)

    def error_m(self, xyz: Array) -> Array:
        """Return how far errors of the mounting move points ``(..., 3)`` of the camera, ``(...)`` [m]."""
        chord = 2.0 * math.sin(0.5 * self.rotation_error_rad)
        return np.asarray(self.position_error_m + chord * np.linalg.norm(xyz, axis=-1))

    def frame(self, tilt: Tilt) -> SensorFrame:
        """Return the same as a frame for a gate, for reports that stay in the frame of the camera.

        Raises
        ------
        SetupError
            The tilt is not known.
        """
        if tilt.outcome is not TiltOutcome.KNOWN:
            raise SetupError(f"mounting: tilt not known: {tilt.outcome.value}")
        return SensorFrame(
            yaw_matrix(self.yaw_rad) @ tilt.rotation,
            self.position_m,
            self.position_error_m,
            self.rotation_error_rad,
        )
