"""What a table of joint motion holds: CSV of our own columns, logs of arms, NPZ."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from verifier.recordings import csv_table
from verifier.recordings.errors import RecordingError
from verifier.recordings.inspection import GAP_FACTOR, Inspection, catalogue, guess_robots
from verifier.recordings.motion import RecordedMotion
from verifier.recordings.motion_source import open_motion
from verifier.recordings.recorded_tracking import tracking_of_motion
from verifier.recordings.robot_logs import kind_of
from verifier.recordings.survey import StreamFacts


def inspect_table(path: str | Path) -> Inspection:
    """Read a table of joint motion once and say what it holds.

    Raises
    ------
    RecordingError
        It is refused as ``import --joints`` refuses it, or it holds points of people.
    """
    path = Path(path)
    named, kind = _kind(path)
    motion = open_motion(path)
    facts = _facts(motion, kind)
    joints = motion.joints
    return Inspection(
        path=str(path),
        duration_s=float(motion.t[-1]),
        topics=(facts,),
        publishers=(),
        joints=joints if named else (),
        people={},
        points={},
        inferred_points=0,
        repeated_points=0.0,
        unknown_points=(),
        frames=(),
        position_error_m=None,
        robot=None,
        robot_candidates=_candidates(joints, named=named),
        assumptions=(),
        metadata={},
        choices={},
        remarks=tuple(_remarks(motion, facts)),
        tracking=tracking_of_motion(motion),
    )


def _kind(path: Path) -> tuple[bool, str]:
    """Whether the table names its joints, and what it is."""
    if path.suffix == ".npz":
        from verifier.recordings.npz import read_joints

        return read_joints(path, None).names is not None, "NPZ of joints"
    header = csv_table.read_header(path)
    kind = kind_of(header)
    if kind is None and csv_table.PERSON in header:
        wrong = "holds points of people, and no joints"
        raise RecordingError(path, "", wrong, "stopproof import --people, or stopproof conformance")
    return kind is None, "CSV of joints" if kind is None else kind.name


def _facts(motion: RecordedMotion, kind: str) -> StreamFacts:
    steps = np.diff(motion.t)
    longest = int(np.argmax(steps))
    length = float(motion.t[-1])
    rate = len(steps) / length if length > 0.0 else math.nan
    return StreamFacts(
        "joints",
        kind,
        "table",
        len(motion.t),
        rate,
        0.0,
        length,
        float(steps[longest]),
        float(motion.t[longest]),
        None,
    )


def _candidates(joints: tuple[str, ...], *, named: bool) -> tuple[str, ...]:
    """Arms that have these joints; of joints without names, as many."""
    arms = catalogue()
    if named:
        return guess_robots(set(joints), arms)
    return tuple(name for name, needed in arms.items() if len(needed) == len(joints))


def _remarks(motion: RecordedMotion, facts: StreamFacts) -> Iterator[str]:
    yield from motion.notes
    if facts.largest_gap_s * facts.rate_hz > GAP_FACTOR:
        yield (
            f"a gap of {facts.largest_gap_s:.3f} s after {facts.gap_at_s:.3f} s "
            f"(mean interval {1.0 / facts.rate_hz:.4f} s)"
        )
    if motion.q is None:
        yield "there are speeds and no positions: it can be read by `stopproof stops` alone"
    else:
        yield (
            "a table has no people: verify judges it with --robot and --assume-nobody, or with people after "
            "`stopproof import`"
        )
