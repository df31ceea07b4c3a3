"""Recordings to measure with: stretches of the bundled one with more people, and a long synthetic one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.machine import ROOT
from occupancy.body import MAX_POINTS, Point
from verifier.recordings import Recording, RecordingWriter, new_recording
from verifier.recordings.joint_state import NANO, JointState
from verifier.recordings.mcap_file import Message
from verifier.recordings.people_report import PeopleReport, ReportedPerson, decode
from verifier.recordings.topic import PEOPLE_TOPIC

DEMO, DEMO_CELL = ROOT / "data" / "demo.mcap", ROOT / "data" / "demo.toml"
ENCOUNTER_S = 8.0
"""About when the worker of the bundled recording is nearest to the arm [s]."""
ALL_MEASURED = (1 << MAX_POINTS) - 1


def write_stretch(out: Path, people: int, seconds: float) -> None:
    """Write ``seconds`` [s] around the encounter of the bundled recording, its worker ``people`` times.

    The further workers do the same at the same time from other sides: turned about the base by equal angles.
    """
    source = Recording(DEMO)
    start_ns = min(message.log_time for message in source.file.messages())
    begin = start_ns + round(max(0.0, ENCOUNTER_S - 0.5 * seconds) * NANO)
    end = begin + round(seconds * NANO)
    with new_recording(out) as writer:
        writer.describe(dict(source.metadata))
        for message in source.file.messages():
            if begin <= message.log_time <= end:
                if message.channel.topic == PEOPLE_TOPIC:
                    writer.people(_multiplied(message, people))
                else:
                    writer.copy(message, source.file.schemas[message.channel.schema_id])


def _multiplied(message: Message, people: int) -> PeopleReport:
    report = decode(message.data, message.log_time)
    persons = []
    for person in report.people:
        for number in range(people):
            angle = 2.0 * np.pi * number / people
            turn = np.array(
                [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
            )
            persons.append(replace(person, id=f"{person.id} {number + 1}", xyz=person.xyz @ turn.T))
    return replace(report, people=tuple(persons))


JOINT_RATE_HZ, PEOPLE_RATE_HZ, PERIOD_S = 1000, 60, 20
JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
DELAY_S = 0.03


def write_long(out: Path, seconds: float) -> None:
    """Write a synthetic recording of ``seconds`` [s]: UR5 at 1 kHz, a person at 60 Hz; always the same bytes.

    The arm swings and the person steps to and fro, both with a period of 20 s.
    """
    with new_recording(out) as writer:
        writer.describe({"robot": "ur5", "note": "synthetic, bench/recordings.py"})
        _write_messages(writer, seconds)


def _write_messages(writer: RecordingWriter, seconds: float) -> None:
    q, xyz = _arm_period(), _person_period()
    error = np.full(MAX_POINTS, 0.01)
    reports = iter(range(round(seconds * PEOPLE_RATE_HZ)))
    report = next(reports, None)
    for sample in range(round(seconds * JOINT_RATE_HZ) + 1):
        now = sample * (NANO // JOINT_RATE_HZ)
        while report is not None and _stamp_ns(report) + round(DELAY_S * NANO) <= now:
            person = ReportedPerson("p1", xyz[report % len(xyz)], error, ALL_MEASURED)
            arrived = _stamp_ns(report) + round(DELAY_S * NANO)
            writer.people(PeopleReport(_stamp_ns(report), arrived, "world", True, (person,)))
            report = next(reports, None)
        writer.joints(JointState(now, JOINTS, q[sample % len(q)]))


def _stamp_ns(report: int) -> int:
    return report * NANO // PEOPLE_RATE_HZ


def _arm_period() -> NDArray[np.float64]:
    """Joint positions of one period, shape (T, 6) [rad]: sines of whole numbers of periods."""
    phase = 2.0 * np.pi * np.arange(PERIOD_S * JOINT_RATE_HZ) / (PERIOD_S * JOINT_RATE_HZ)
    middle = np.array([0.0, -1.4, 1.5, -1.7, -1.57, 0.0])
    swing = np.array([0.8, 0.2, 0.3, 0.3, 0.2, 0.5])
    times = np.array([2, 3, 3, 4, 5, 3])
    q: NDArray[np.float64] = middle + swing * np.sin(phase[:, None] * times + np.arange(6))
    return q


def _person_period() -> NDArray[np.float64]:
    """Points of the person over one period, shape (T, 20, 3) [m]; nearest 1.2 m, farthest 3.2 m away."""
    share = np.arange(PERIOD_S * PEOPLE_RATE_HZ) / (PERIOD_S * PEOPLE_RATE_HZ)
    body = standing()
    place = np.zeros((len(share), 1, 3))
    place[:, 0, 0] = 2.2 - np.cos(2.0 * np.pi * share)
    place[:, 0, 2] = -0.8
    return np.round(body + place, 4)


def standing() -> NDArray[np.float64]:
    """Points (20, 3) [m] of somebody who stands at the origin."""
    return np.array([_BODY[point] for point in Point])


def _mirrored() -> Iterator[tuple[Point, tuple[float, float, float]]]:
    for name, (x, y, z) in {
        "SHOULDER": (0.0, 0.19, 1.42), "ELBOW": (0.0, 0.22, 1.13), "WRIST": (-0.1, 0.22, 0.89),
        "HAND": (-0.13, 0.22, 0.81), "FINGERTIP": (-0.16, 0.22, 0.73), "HIP": (0.0, 0.10, 0.92),
        "KNEE": (0.0, 0.10, 0.50), "ANKLE": (0.0, 0.10, 0.08),
    }.items():  # fmt: skip
        yield Point[f"L_{name}"], (x, y, z)
        yield Point[f"R_{name}"], (x, -y, z)


_BODY = {
    Point.PELVIS: (0.0, 0.0, 0.95),
    Point.THORAX: (0.0, 0.0, 1.25),
    Point.NECK_BASE: (0.0, 0.0, 1.47),
    Point.HEAD: (0.0, 0.0, 1.63),
    **dict(_mirrored()),
}
