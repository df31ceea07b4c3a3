"""Seeded recordings as arrays: an arm that swings and pauses, people who walk, stop, vanish and run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from occupancy.body import Point
from tests.verifier.scenes import UR5_JOINTS, person_at
from verifier.recordings.arrays import JointSamples, PeoplePoints
from verifier.recordings.joint_state import JointState
from verifier.recordings.recording_writer import new_recording

Array = NDArray[np.float64]
EPOCH_S = 1000.0
"""Early enough for every nanosecond to be a number of seconds in double precision."""


@dataclass(frozen=True)
class ArrayScene:
    """A recording that can be verified as arrays and as a file."""

    joints: JointSamples
    people: PeoplePoints

    def write(self, path: Path) -> Path:
        """Write what the arrays hold as a recording."""
        joints = [
            (int(ns), JointState(int(ns), UR5_JOINTS, q))
            for ns, q in zip(self.joints.t_ns, self.joints.q, strict=True)
        ]
        reports = [(report.arrived_ns, report) for report in self.people.reports]
        with new_recording(path) as writer:
            writer.describe({"robot": "ur5"})
            for _time, message in sorted([*joints, *reports], key=lambda item: item[0]):
                if isinstance(message, JointState):
                    writer.joints(message)
                else:
                    writer.people(message)
        return path


def random_scene(
    rng: np.random.Generator, seconds: float, *, people: int = 2, faults: bool = True
) -> ArrayScene:
    """Return a scene in which, with ``faults``, trackers lose and invent points and people are too fast."""
    t = EPOCH_S + np.arange(int(seconds * 125.0) + 1) / 125.0
    return ArrayScene(JointSamples(t, _swing(rng, t)), _people(rng, seconds, people, faults))


def _swing(rng: np.random.Generator, t: Array) -> Array:
    """Sines about a posture on a clock that now and then stands still."""
    rate = np.clip(
        1.5 * np.sin(rng.uniform(0.3, 1.2) * (t - EPOCH_S) + rng.uniform(0.0, 6.0)) + 0.6, 0.0, 1.0
    )
    clock = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    middle = np.array([0.0, -1.2, 1.3, -0.4, 0.3, 0.0])
    swing = rng.uniform(0.05, 0.5, 6) * np.array([1.6, 0.6, 0.6, 1.0, 1.0, 1.0])
    q: Array = middle + swing * np.sin(rng.uniform(0.3, 2.0, 6) * clock[:, None] + rng.uniform(0.0, 6.0, 6))
    return q


def _people(rng: np.random.Generator, seconds: float, people: int, faults: bool) -> PeoplePoints:
    rate = rng.choice([20.0, 50.0, 60.0])
    t = EPOCH_S + np.arange(int(seconds * rate) + 1) / rate
    xyz = np.stack([_walk(rng, t - EPOCH_S, faults) for _ in range(people)], axis=1)
    xyz += rng.normal(0.0, 1e-4, xyz.shape)  # a point that does not move at all counts as passed on
    listed = np.ones((len(t), people), dtype=np.bool_)
    if faults:
        xyz[rng.random(xyz.shape[:3]) < 0.01] = np.nan
        listed[rng.random(listed.shape) < 0.1] = False
        away = rng.integers(0, len(t), 2)
        listed[away.min() : away.max(), -1] = False
    kept = rng.random(len(t)) > (0.1 if faults else 0.0)
    kept[0] = True
    late = rng.uniform(0.0, 0.03, len(t)) if faults else np.full(len(t), 0.02)
    arrived = np.maximum.accumulate(t + late)
    return PeoplePoints(
        t[kept],
        xyz[kept],
        arrived=arrived[kept],
        error_m=0.005,
        listed=listed[kept],
        complete=bool(rng.integers(2)),
    )


def _walk(rng: np.random.Generator, t: Array, faults: bool) -> Array:
    """Points (T, 20, 3) of somebody who walks to the arm and away, from a seeded side."""
    angle, phase = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 6.0)
    away = 2.0 + rng.uniform(0.2, 1.2) * np.sin(rng.uniform(0.3, 0.9) * t + phase)
    body = np.array([person_at(x, 0.0) for x in away])
    if faults and rng.random() < 0.5:
        lunge = rng.uniform(0.0, t[-1])
        body[:, int(Point.R_WRIST), 0] -= 0.4 * np.exp(-(((t - lunge) / 0.08) ** 2))
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
    walked: Array = np.round(body @ turn.T, 6)
    return walked
