"""Small recordings for the tests of the verifier: a UR5 that swings, a person who stands or moves."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from occupancy.body import Point
from verifier.recordings.joint_state import JointState
from verifier.recordings.people_report import PeopleReport, ReportedPerson
from verifier.recordings.recording_writer import new_recording

Array = NDArray[np.float64]

UR5_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
EPOCH_NS = 1_700_000_000_000_000_000
ALL_POINTS = (1 << len(Point)) - 1

_STANDING = {
    Point.HEAD: (0.0, 0.0, 1.65), Point.NECK_BASE: (0.0, 0.0, 1.45), Point.THORAX: (0.0, 0.0, 1.25),
    Point.PELVIS: (0.0, 0.0, 0.95),
    Point.L_SHOULDER: (0.0, 0.18, 1.42), Point.L_ELBOW: (0.0, 0.22, 1.12), Point.L_WRIST: (0.0, 0.22, 0.87),
    Point.L_HAND: (0.0, 0.22, 0.79), Point.L_FINGERTIP: (0.0, 0.22, 0.69),
    Point.R_SHOULDER: (0.0, -0.18, 1.42), Point.R_ELBOW: (0.0, -0.22, 1.12),
    Point.R_WRIST: (0.0, -0.22, 0.87), Point.R_HAND: (0.0, -0.22, 0.79),
    Point.R_FINGERTIP: (0.0, -0.22, 0.69),
    Point.L_HIP: (0.0, 0.1, 0.92), Point.L_KNEE: (0.0, 0.1, 0.5), Point.L_ANKLE: (0.0, 0.1, 0.08),
    Point.R_HIP: (0.0, -0.1, 0.92), Point.R_KNEE: (0.0, -0.1, 0.5), Point.R_ANKLE: (0.0, -0.1, 0.08),
}  # fmt: skip


def person_at(x: float, y: float, z: float = -0.8) -> Array:
    """A standing person, points (20, 3) [m]; z = -0.8: the robot stands on a bench."""
    return np.array([_STANDING[point] for point in Point]) + np.array([x, y, z])


def swing(t: float) -> Array:
    """A smooth motion of the UR5 well within its limits."""
    return np.array(
        [0.5 * np.sin(1.5 * t), -1.2 + 0.2 * np.sin(1.1 * t), 1.3, -0.4, 0.3 * np.sin(0.7 * t), 0.0]
    )


def at_rest(_t: float) -> Array:
    return swing(0.3)


def far(_t: float) -> Array:
    return person_at(4.0, 0.0)


@dataclass(frozen=True)
class Scene:
    """What is recorded; functions of time [s]. ``people``: id -> points, or None while there is no report."""

    motion: Callable[[float], Array] = swing
    people: dict[str, Callable[[float], Array | None]] = field(default_factory=lambda: {"p1": far})
    duration: float = 2.0
    joint_rate: float = 125.0
    people_rate: float = 50.0
    people_from: float = 0.0
    delay: float = 0.03
    complete: bool = False
    frame: str = "world"
    robot: str | None = "ur5"
    error_m: float = 0.005

    def write(self, path: Path) -> Path:
        messages: list[tuple[int, JointState | PeopleReport]] = []
        for i in range(int(self.duration * self.joint_rate) + 1):
            t = i / self.joint_rate
            stamp = EPOCH_NS + round(t * 1e9)
            messages.append((stamp, JointState(stamp, UR5_JOINTS, np.asarray(self.motion(t)))))
        for i in range(int((self.duration - self.people_from) * self.people_rate) + 1):
            report = self._report(self.people_from + i / self.people_rate)
            if report is not None:
                messages.append((report.arrived_ns, report))
        with new_recording(path) as writer:
            writer.describe({} if self.robot is None else {"robot": self.robot})
            for _time, message in sorted(messages, key=lambda item: item[0]):
                if isinstance(message, JointState):
                    writer.joints(message)
                else:
                    writer.people(message)
        return path

    def _report(self, t: float) -> PeopleReport | None:
        seen = {name: points(t) for name, points in self.people.items()}
        if self.people and all(points is None for points in seen.values()):
            return None
        stamp = EPOCH_NS + round(t * 1e9)
        people = tuple(
            ReportedPerson(name, xyz, np.full(len(Point), self.error_m), ALL_POINTS)
            for name, xyz in seen.items()
            if xyz is not None
        )
        return PeopleReport(stamp, stamp + round(self.delay * 1e9), self.frame, self.complete, people)


Report = tuple[float, float, dict[str, Array | ReportedPerson]]
"""Stamp and arrival [s], and who is in it: points (20, 3), or a person as it stands in the report."""


def write_reports(
    path: Path,
    reports: Iterable[Report],
    *,
    motion: Callable[[float], Array] = swing,
    joint_times: Iterable[float] = tuple(i / 125.0 for i in range(251)),
    complete: bool = True,
    frames: Mapping[int, str] | None = None,
) -> Path:
    """Write a recording of the UR5 with reports one by one; ``frames``: frame by the number of a report."""
    frames = frames or {}
    messages: list[tuple[int, JointState | PeopleReport]] = []
    for t in joint_times:
        stamp = EPOCH_NS + round(t * 1e9)
        messages.append((stamp, JointState(stamp, UR5_JOINTS, np.asarray(motion(t)))))
    for number, (seen, arrived, who) in enumerate(reports):
        people = tuple(
            each
            if isinstance(each, ReportedPerson)
            else ReportedPerson(name, each, np.full(len(Point), 0.005), ALL_POINTS)
            for name, each in who.items()
        )
        stamp, arrival = (EPOCH_NS + round(t * 1e9) for t in (seen, arrived))
        frame = frames.get(number, "world")
        messages.append((arrival, PeopleReport(stamp, arrival, frame, complete, people)))
    with new_recording(path) as writer:
        writer.describe({"robot": "ur5"})
        for _time, message in sorted(messages, key=lambda item: item[0]):
            if isinstance(message, JointState):
                writer.joints(message)
            else:
                writer.people(message)
    return path


def at(rate: float, seconds: float) -> Iterator[float]:
    """Instants [s] of a steady stream."""
    return (i / rate for i in range(round(rate * seconds) + 1))


CELL: dict[str, dict[str, object]] = {
    "robot": {"bare_flange": True, "accept_assumed": ["limits"]},
    "people": {"latency_s": 0.03, "repeated_points": "measured"},
}
"""A cell without waivers."""
