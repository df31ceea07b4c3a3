"""Recordings of stops that are known: what was asked for when, and how each joint then braked."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.records import Schema

from verifier.recordings import joint_state
from verifier.recordings.joint_state import JointState
from verifier.recordings.mcap_file import McapWriter
from verifier.recordings.motion import RecordedMotion, StateChannel
from verifier.recordings.recording_writer import new_file

NANO = 1_000_000_000


@dataclass(frozen=True)
class KnownStop:
    """At constant speed until ``asked`` [s] and ``delay`` [s] beyond, then braking.

    ``speed, brake (n,)``: of each joint [rad/s, rad/s²]. The joints start at rest at ``begin`` [s] with 4
    rad/s² and go on where they stopped when another one follows.
    """

    asked: float
    delay: float
    speed: np.ndarray
    brake: np.ndarray
    begin: float = 0.0

    @property
    def rest(self) -> float:
        return self.asked + self.delay + float((np.abs(self.speed) / self.brake).max())

    @property
    def angle(self) -> np.ndarray:
        """From when it was asked for to standstill, exactly."""
        return np.abs(self.speed) * self.delay + self.speed**2 / (2.0 * self.brake)

    def velocity(self, t: np.ndarray) -> np.ndarray:
        up = np.clip(4.0 * (t[:, None] - self.begin), 0.0, np.abs(self.speed))
        down = np.abs(self.speed) - self.brake * (t[:, None] - self.asked - self.delay)
        return np.sign(self.speed) * np.clip(np.minimum(up, down), 0.0, None)

    def moved(self, t: np.ndarray) -> np.ndarray:
        """How far each joint has gone since ``begin``, in closed form (T, n)."""
        speed, x = np.abs(self.speed), t[:, None] - self.begin
        accelerating = np.clip(x, 0.0, speed / 4.0)
        braking_from = self.asked + self.delay - self.begin
        steady = np.clip(np.minimum(x, braking_from) - speed / 4.0, 0.0, None)
        y = np.clip(x - braking_from, 0.0, speed / self.brake)
        return np.sign(self.speed) * (2.0 * accelerating**2 + speed * (steady + y) - 0.5 * self.brake * y**2)


@dataclass
class Motion:
    """Several stops one after another, sampled."""

    stops: Sequence[KnownStop]
    t: np.ndarray
    q0: np.ndarray
    q: np.ndarray = field(init=False)
    dq: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.q = self.q0 + sum(stop.moved(self.t) for stop in self.stops)
        self.dq = sum(stop.velocity(self.t) for stop in self.stops)

    def flag(self, t: np.ndarray, held: float = 0.2) -> np.ndarray:
        """Whether the arm is told to stop: from when it is asked for until ``held`` [s] after standstill."""
        return np.any([(t >= stop.asked) & (t < stop.rest + held) for stop in self.stops], axis=0)

    def recorded(self, joints: Sequence[str], path: str = "made_up", **beside) -> RecordedMotion:
        """The motion with a flag as it stands in a table."""
        channel = StateChannel("stop", self.t, tuple("stop" if each else "" for each in self.flag(self.t)))
        given = {"q": self.q, "dq": None, "states": (channel,)} | beside
        return RecordedMotion(Path(path), None, tuple(joints), self.t, **given)


def random_stops(rng: np.random.Generator, n_joints: int, count: int) -> list[KnownStop]:
    """Stops far enough apart, of joints of which at least one is fast; some may not move."""
    stops, begin = [], 0.3
    for _ in range(count):
        speed = rng.uniform(-2.0, 2.0, n_joints) * rng.choice([0.0, 1.0, 1.0], n_joints)
        speed[rng.integers(n_joints)] = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 2.0)
        asked = begin + 0.6 + rng.uniform(0.0, 0.5)
        stop = KnownStop(asked, rng.uniform(0.0, 0.15), speed, rng.uniform(2.0, 20.0, n_joints), begin)
        stops.append(stop)
        begin = stop.rest + 0.6
    return stops


def sampled(rng: np.random.Generator, stops: Sequence[KnownStop], step: float, q0: np.ndarray) -> Motion:
    """Samples at a rate, the first at an instant of its own, until a while after the last stop."""
    t = np.arange(rng.uniform(0.0, step), stops[-1].rest + 0.5, step)
    return Motion(stops, t, q0)


def write_csv(path: Path, columns: dict[str, Sequence[object]]) -> Path:
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(map(_cell, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _cell(value: object) -> str:
    return repr(float(value)) if isinstance(value, np.floating | float) else str(value)


def write_mcap(
    path: Path,
    motion: Motion,
    joints: Sequence[str],
    *,
    robot: str | None = None,
    topics: Sequence[tuple[str, str, Sequence[tuple[float, bytes]]]] = (),
    commands: np.ndarray | None = None,
) -> Path:
    """Joint states with message times from 1 s on; ``topics``: name, schema, (time [s], CDR without head)."""
    messages: list[tuple[int, int, bytes]] = []
    with new_file(path, force=True) as stream:
        out = McapWriter(stream)
        schema = Schema(id=0, name=joint_state.SCHEMA_NAME, encoding="ros2msg", data=joint_state.SCHEMA)
        for topic, values in (("/joint_states", motion.q), ("/joint_commands", commands)):
            if values is not None:
                channel = out.channel(topic, schema, "cdr")
                for at, q in zip(_stamps(motion.t), values, strict=True):
                    messages.append((at, channel, joint_state.encode(JointState(at, tuple(joints), q))))
        for topic, name, values in topics:
            channel = out.channel(topic, Schema(id=0, name=name, encoding="ros2msg", data=b""), "cdr")
            for (_, body), at in zip(values, _stamps(np.array([t for t, _ in values])), strict=True):
                messages.append((at, channel, b"\0\1\0\0" + body))
        for at, channel, data in sorted(messages, key=lambda each: each[0]):
            out.write(channel, at, data)
        if robot is not None:
            out.metadata("stopproof", {"format": "1", "robot": robot})
        out.finish()
    return path


def _stamps(t: np.ndarray) -> list[int]:
    return [round(float(each) * NANO) + NANO for each in t]


def byte(value: int) -> bytes:
    return struct.pack("<B", value)


def double(value: float) -> bytes:
    return struct.pack("<d", value)
