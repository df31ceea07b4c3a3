"""A person of capsules and balls before a wall, as a depth camera would see them: rays in plain NumPy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.camera import LEVEL, Intrinsics, Mounting, Tilt
from modes.forecasting.depth import DepthSettings
from modes.forecasting.landmarks import LANDMARKS, MEASURED, SKIN, Landmark, PoseSettings
from modes.forecasting.pose import Camera, Frame, report_of_frame
from occupancy.body import Point

Array = NDArray[np.float64]

CAMERA = Intrinsics(fx=400.0, fy=405.0, cx=241.5, cy=178.0, width=480, height=360)
EXACT = DepthSettings(bias_m=0.0, bias_share=0.0, noise_m=0.0, noise_per_m=0.0, window_px=1)
BARE = Camera(CAMERA, Mounting(), 1.0, EXACT, PoseSettings(landmark_error_px=0.0))
USUAL = Camera(CAMERA, Mounting(), 1.0)

_STANDING: dict[str, tuple[float, float, float]] = {
    "shoulder": (0.19, 0.0, 0.45), "elbow": (0.36, -0.05, 0.22), "wrist": (0.50, -0.12, 0.05),
    "index": (0.55, -0.15, -0.02), "pinky": (0.52, -0.14, -0.03), "hip": (0.13, 0.0, -0.05),
    "knee": (0.17, -0.03, -0.45), "ankle": (0.2, 0.02, -0.83), "heel": (0.2, 0.02, -0.9),
}  # fmt: skip
"""The left side [m], facing the camera: right, forward, up; from the middle of the body."""
_BONES = (("shoulder", "elbow"), ("elbow", "wrist"), ("shoulder", "hip"), ("hip", "knee"), ("knee", "ankle"))
_SIDES = (("LEFT", 1.0), ("RIGHT", -1.0))


@dataclass(frozen=True)
class Scene:
    """Landmarks' true places (33, 3) [m], NaN: none; balls (n, 4) and capsules (n, 7); the wall's depth."""

    places: Array
    balls: Array
    capsules: Array
    wall_m: float

    @property
    def head(self) -> Array:
        return np.asarray(self.places[[Landmark.LEFT_EAR, Landmark.RIGHT_EAR]].mean(axis=0))

    def truth(self, point: Point) -> Array:
        """Where a point that can be measured is (3,) [m]."""
        return np.asarray(self.places[list(MEASURED[point].landmarks)].mean(axis=0))

    def landmarks(self, camera: Intrinsics = CAMERA) -> Array:
        """What a detector without errors would say (33, 3)."""
        seen = np.isfinite(self.places).all(axis=1)
        out = np.full((LANDMARKS, 3), np.nan)
        out[:, :2], out[:, 2] = camera.pixels(self.places), np.where(seen, 1.0, 0.0)
        return out


def scene(
    rng: np.random.Generator,
    *,
    depth_m: float = 2.4,
    behind_m: float = 2.0,
    share: float = 0.0,
    sway_m: float = 0.03,
) -> Scene:
    """A person about the optical axis; the flesh is as thick as stated, up to a share of its error."""
    radius = {
        name: skin.behind_m + share * skin.error_m * rng.uniform(-1.0, 1.0) for name, skin in SKIN.items()
    }
    middle = np.array([rng.uniform(-0.2, 0.2), depth_m, rng.uniform(-0.05, 0.1)])
    places = np.full((LANDMARKS, 3), np.nan)
    balls, capsules = [], []
    for side, sign in _SIDES:
        at = {}
        for name, (right, ahead, up) in _STANDING.items():
            at[name] = middle + np.array([sign * right, ahead, up]) + rng.uniform(-sway_m, sway_m, 3)
            places[Landmark[f"{side}_{name.upper()}"]] = at[name]
            balls.append((*at[name], radius[name if name in SKIN else "knuckle"]))
        for begin, end in _BONES:
            capsules.append((*at[begin], *at[end], 0.75 * min(radius[begin], radius[end])))
    head = middle + np.array([0.0, -0.02, 0.66])
    for side, sign in _SIDES:
        places[Landmark[f"{side}_EAR"]] = head + np.array([0.075 * sign, 0.0, 0.0])
    balls.append((*head, radius["head"]))
    return Scene(places, np.array(balls), np.array(capsules), depth_m + behind_m)


def render(found: Scene, camera: Intrinsics = CAMERA) -> Array:
    """Depth image [m]: a ray is t (x, 1, z), so that t is the depth; nearest of the roots, else the wall."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(float)
    d = np.stack(((u - camera.cx) / camera.fx, np.ones_like(u), (camera.cy - v) / camera.fy), axis=-1)
    depth = np.full(u.shape, found.wall_m)
    balls = np.concatenate([found.balls, found.capsules[:, [0, 1, 2, 6]], found.capsules[:, [3, 4, 5, 6]]])
    for *centre, radius in balls:
        c = np.array(centre)
        part = _box(c, radius, camera)
        depth[part] = np.minimum(depth[part], _root((d[part] ** 2).sum(-1), d[part] @ c, c @ c - radius**2))
    for row in found.capsules:
        a, b, radius = row[:3], row[3:6], row[6]
        part = _box(0.5 * (a + b), radius + 0.5 * float(np.linalg.norm(b - a)), camera)
        axis, length = (b - a) / np.linalg.norm(b - a), np.linalg.norm(b - a)
        across = d[part] - (d[part] @ axis)[..., None] * axis
        m = a - (a @ axis) * axis
        t = _root((across**2).sum(-1), across @ m, m @ m - radius**2)
        with np.errstate(invalid="ignore"):
            along = t * (d[part] @ axis) - a @ axis
            depth[part] = np.minimum(depth[part], np.where((along >= 0) & (along <= length), t, np.inf))
    return depth


def _root(a: Array, b: Array, c: float) -> Array:
    """The lesser root of a t² - 2 b t + c; infinite: none."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.nan_to_num((b - np.sqrt(b**2 - a * c)) / a, nan=np.inf))


def _box(centre: Array, radius: float, camera: Intrinsics) -> tuple[slice, slice]:
    """Rows and columns that a ball may be seen in."""
    reach = 1.1 * radius / (centre[1] - radius) + 0.02
    u = camera.cx + camera.fx * (centre[0] / centre[1] + np.array([-reach, reach]))
    v = camera.cy - camera.fy * (centre[2] / centre[1] + np.array([reach, -reach]))
    rows = slice(max(0, int(v[0])), max(0, int(v[1]) + 2))
    return rows, slice(max(0, int(u[0])), max(0, int(u[1]) + 2))


def noisy(
    depth: Array, landmarks: Array, rng: np.random.Generator, sigma: Array, bias: Array, off_px: float
) -> tuple[Array, Array]:
    """Depth and landmarks with errors: noise that is the same in squares of 16 px, so that no median of a
    window makes it smaller; a bias at its bound; landmarks off by up to ``off_px``."""
    rows, columns = depth.shape
    cells = rng.normal(size=(rows // 16 + 1, columns // 16 + 1)).repeat(16, axis=0).repeat(16, axis=1)
    sign = rng.choice([-1.0, 1.0])
    out = landmarks.copy()
    angle, length = rng.uniform(0.0, 2 * np.pi, len(out)), off_px * np.sqrt(rng.uniform(0.0, 1.0, len(out)))
    out[:, 0] += length * np.cos(angle)
    out[:, 1] += length * np.sin(angle)
    return depth + sign * bias + sigma * cells[:rows, :columns], out


def frame(landmarks: object, depth: Any, camera: Camera = USUAL, tilt: Tilt = LEVEL) -> Frame:
    return report_of_frame(landmarks, depth, tilt, 5.0, 5.1, camera)


def measured(found: Frame) -> list[Point]:
    assert found.report is not None
    (person,) = found.report.people
    return [point for point in Point if person.measured >> point & 1]
