"""Which topics of a recording are meant, and which joints: what a user says where it is not plain."""

from __future__ import annotations

from dataclasses import dataclass, field

from verifier.recordings.clock_offset import ONE_CLOCK, ClockOffsets
from verifier.recordings.people_sources import SourceOptions


@dataclass(frozen=True, slots=True)
class Choice:
    """What is said about a recording; ``None``: nothing.

    Attributes
    ----------
    joints_topic, people_topic:
        Where the arm's joints and the people are.
    joint_prefix:
        What stands before the names of the arm's joints.
    arm:
        Joints of the arm, as its model names them; empty where it is not known yet.
    people:
        What is said about the source of people.
    clocks:
        What is added to stamps.
    regions:
        Names of the monitored regions of the cell.
    """

    joints_topic: str | None = None
    people_topic: str | None = None
    joint_prefix: str | None = None
    arm: tuple[str, ...] = ()
    people: SourceOptions = field(default_factory=SourceOptions)
    clocks: ClockOffsets = ONE_CLOCK
    regions: tuple[str, ...] = ()


NOTHING_SAID = Choice()
