"""What a stop took: time, angle of each joint, way of the tool, distance from the commanded path.

Every quantity has two numbers, between which the true one lies as far as samples can tell: from the first
sample that shows that the arm was told to stop to the last that moves, and from the last sample before it was
told to the first of standstill.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robots import kernels
from robots.model import RobotModel
from verifier.recordings.motion import RecordedMotion
from verifier.stops.finding import SLOWER, Stop
from verifier.stops.speeds import Speeds

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Between:
    """A quantity that lies between two numbers."""

    least: float
    most: float


@dataclass(frozen=True, slots=True)
class Measured:
    """A stop that was measured.

    Attributes
    ----------
    stop:
        Which one.
    time_s:
        From when it was told to standstill [s].
    reaction_s:
        From then until the fastest joint had begun to slow down [s].
    speed:
        Largest speed of each joint from the sample before it was told on, or from a window that reaches it
        [rad/s, m/s].
    angle:
        How far each joint went [rad, m]; ``None``: positions were not recorded.
    way_m:
        How far the tool point that moves most went along its way [m]; ``None``: no positions or no model.
    off_path_rad:
        Largest distance from the commanded path in joint space [rad, Euclidean]; ``None``: no command.
    off_path_m:
        … of the tool points in space [m]; ``None``: no command or no model.
    """

    stop: Stop
    time_s: Between
    reaction_s: Between
    speed: tuple[float, ...]
    angle: tuple[Between, ...] | None
    way_m: Between | None
    off_path_rad: float | None
    off_path_m: float | None


class ToolPoints:
    """The ends of the capsules that the last joint carries: flange, tool and payload."""

    def __init__(self, robot: RobotModel) -> None:
        self._robot = robot
        rows = robot.enclosure[0]
        n, last = int(rows["n"]), int(robot.kinematics[0]["n"]) - 1
        carried = np.flatnonzero(rows["joint"][:n] == last)
        self._last = last
        self._points = np.concatenate([rows["a"][carried], rows["b"][carried]])

    def along(self, q: FloatArray) -> FloatArray:
        """Return where they are in the world (T, P, 3) [m] at joint positions ``q`` (T, J)."""
        n = self._last + 1
        rotations, positions = np.zeros((n, 3, 3)), np.zeros((n, 3))
        out = np.zeros((len(q), len(self._points), 3))
        for row, each in enumerate(np.ascontiguousarray(q)):
            kernels.forward(self._robot.kinematics, each, rotations, positions)
            out[row] = self._points @ rotations[self._last].T + positions[self._last]
        return out


def measure(motion: RecordedMotion, seen: Speeds, stop: Stop, tool: ToolPoints | None) -> Measured:
    """Measure a stop; ``tool``: ``None`` where the arm has no model."""
    t = motion.t
    time_s = _since(stop, float(t[stop.rest - 1]), float(t[stop.rest]))
    first = _first_window(seen, stop.before)
    speed = tuple(map(float, np.abs(seen.v[first : stop.rest]).max(axis=0)))
    angle = way = off_rad = off_m = None
    if motion.q is not None:
        angle = _angles(motion.q, stop)
        commanded = _commanded(motion, stop)
        since = motion.q[stop.at : stop.rest + 1]
        off_rad = None if commanded is None else _farthest(since, commanded)
        if tool is not None:
            points = tool.along(motion.q[stop.before : stop.rest + 1])
            way = _way(points, stop)
            if commanded is not None:
                path = tool.along(commanded)
                off_m = max(
                    _farthest(points[stop.at - stop.before :, k], path[:, k]) for k in range(path.shape[1])
                )
    return Measured(stop, time_s, _reaction(t, seen, stop), speed, angle, way, off_rad, off_m)


def _first_window(seen: Speeds, before: int) -> int:
    """Return the first window that reaches a sample; where none ends there, the last one that ends earlier.

    Times are rounded: from one window to the next the end may move on by two samples.
    """
    reaching = int(np.searchsorted(seen.last, before))
    within = int(np.searchsorted(seen.last, before, side="right")) - 1
    return min(reaching, max(within, 0))


def _since(stop: Stop, after: float, by: float) -> Between:
    """Time from when the arm was told to something that happened after the one and by the other [s]."""
    return Between(max(0.0, after - stop.asked_by), by - stop.asked_after)


def _reaction(t: FloatArray, seen: Speeds, stop: Stop) -> Between:
    fastest = seen.fastest[stop.before : stop.rest + 1]
    last = stop.before + int(np.flatnonzero(fastest >= SLOWER * fastest.max())[-1])
    return _since(stop, float(t[last]), float(t[min(int(seen.last[last]) + 1, stop.rest)]))


def _angles(q: FloatArray, stop: Stop) -> tuple[Between, ...]:
    """How far each joint went at least, from sample to sample, and at most, turning points included."""
    q = q[stop.before : stop.rest + 1]
    least = np.abs(q[-1] - q[stop.at - stop.before])
    most = q.max(axis=0) - q.min(axis=0)
    return tuple(Between(float(low), float(high)) for low, high in zip(least, most, strict=True))


def _way(points: FloatArray, stop: Stop) -> Between:
    """Length of the way (T, P, 3) of the point that goes farthest, from sample to sample [m]."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=2)
    most = steps.sum(axis=0)
    least = steps[stop.at - stop.before :].sum(axis=0)
    k = int(np.argmax(most))
    return Between(float(least[k]), float(most[k]))


def _commanded(motion: RecordedMotion, stop: Stop) -> FloatArray | None:
    """What was commanded from a second before the stop to a second after it (T, J)."""
    if motion.command_q is None:
        return None
    first, last = np.searchsorted(motion.t, [motion.t[stop.before] - 1.0, motion.t[stop.rest] + 1.0])
    commanded: FloatArray = motion.command_q[first:last]
    return commanded


def _farthest(points: FloatArray, path: FloatArray) -> float:
    """Largest distance of ``points`` (N, D) from the line through ``path`` (M, D)."""
    begins, along = path[:-1], np.diff(path, axis=0)
    if not len(begins):
        begins, along = path, np.zeros_like(path)
    length = np.maximum((along**2).sum(axis=1), 1e-300)
    farthest = 0.0
    for point in points:
        share = np.clip(((point - begins) * along).sum(axis=1) / length, 0.0, 1.0)
        nearest = np.linalg.norm(begins + share[:, None] * along - point, axis=1).min()
        farthest = max(farthest, float(nearest))
    return farthest
