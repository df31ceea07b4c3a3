"""What must hold of everything that a reader let pass: no invalid number stands there as a valid one."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from verifier.recordings.joint_state import JointState
from verifier.recordings.joint_stream import JointStream
from verifier.recordings.people_report import PeopleReport, decode, encode
from verifier.recordings.people_stream import PeopleStream
from verifier.recordings.recording import Recording
from verifier.recordings.table import JointTable, PeopleTable
from verifier.recordings.topic import JOINT_TOPIC, PEOPLE_TOPIC


class QuietPassError(AssertionError):
    """Something invalid was read as if it were valid."""


def need(holds: object, what: str) -> None:
    """Raise QuietPassError unless something holds."""
    if not holds:
        raise QuietPassError(what)


def report(found: PeopleReport) -> None:
    """Check a report, and what our own format makes of it."""
    for person in found.people:
        stated = person.error_m[~np.isnan(person.error_m)]
        need(isinstance(person.id, str), "an id is no text")
        need(np.isfinite(stated).all() and (stated >= 0.0).all(), f"an error is {stated}")
    again = decode(encode(found), found.arrived_ns)
    need(len(again.people) == len(found.people), "people differ in number once written")
    need(again.stamp_ns == found.stamp_ns, "the stamp differs once written")
    for before, after in zip(found.people, again.people, strict=True):
        valid = np.isfinite(before.xyz).all(axis=1)
        need((np.isfinite(after.xyz).all(axis=1) == valid).all(), "a point that is none is one once written")
        need(np.array_equal(after.xyz[valid], before.xyz[valid]), "a point differs once written")


def state(found: JointState) -> None:
    """Check the joints of a message."""
    need(np.isfinite(found.position).all(), "a position is NaN or infinite")
    need(len(set(found.names)) == len(found.names), "a joint stands there twice")
    need(not found.names or len(found.names) == len(found.position), "names and positions differ in number")


def joint_table(found: JointTable) -> None:
    """Check a table of joints."""
    _times(found.t_ns)
    need(np.isfinite(found.q).all(), "a position is NaN or infinite")
    need(len(found.q) == len(found.t_ns), "times and positions differ in number")
    for other in (found.command, found.dq):
        need(other is None or other.shape == found.q.shape, "columns differ in number")
    need(found.command is None or np.isfinite(found.command).all(), "a command is NaN or infinite")


def people_table(found: PeopleTable) -> None:
    """Check a table of people; their points may be missing."""
    error = found.position_error_m
    need(error is None or (math.isfinite(error) and error >= 0.0), f"an error is {error}")
    for track in found.tracks:
        _times(track.t_ns)
        need(track.xyz.shape == (len(track.t_ns), len(track.names), 3), "times and points differ in number")


def _times(t_ns: Any) -> None:
    need(len(t_ns) and (np.diff(t_ns) > 0).all(), "times do not increase")


def recording(found: Recording) -> None:
    """Check a recording as verify reads it."""
    joints = found.joint_names
    if joints:
        stream = JointStream(found, joints)
        for message in found.file.messages([JOINT_TOPIC]):
            stream.take(message)
        t_ns, q = stream.drain()
        need(np.isfinite(q).all(), "a position is NaN or infinite")
        need((np.diff(t_ns) > 0).all(), "times do not increase")
    people = PeopleStream(found.file, {})
    for message in found.file.messages([PEOPLE_TOPIC]):
        read = people.report(message)
        if read is not None:
            report(read)


def finite(found: Any, where: str = "") -> None:
    """Check every number of nested tables."""
    if isinstance(found, dict):
        for key, value in found.items():
            finite(value, f"{where}.{key}")
    elif isinstance(found, Iterable) and not isinstance(found, str):
        for value in found:
            finite(value, where)
    elif isinstance(found, float):
        need(math.isfinite(found), f"{where} is {found}")
