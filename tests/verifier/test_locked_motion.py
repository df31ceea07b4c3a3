"""Joints that are not commanded: where a recording shows them move, or out of range, it contradicts."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from robots.errors import SetupError
from robots.model import LockedJoint
from tests.verifier.scenes import ALL_POINTS, CELL, UR5_JOINTS, Array, Scene, person_at, swing
from verifier import Cell, Status, verify
from verifier.batch import BatchVerifier
from verifier.locked_motion import MOVED, LockedMotion
from verifier.program_segments import Stretch
from verifier.recordings import Reading, Recording
from verifier.recordings.joint_state import NANO, JointState
from verifier.recordings.people_report import PeopleReport, ReportedPerson
from verifier.recordings.recording import LOOK_AHEAD
from verifier.recordings.recording_writer import new_recording
from verifier.setup import build_robot
from verifier.supervised import supervise
from verifier.trial_runs import Asked, TrialRuns
from verifier.verdict import Reason

PAN_ONLY = Cell.from_table(
    {**CELL, "robot": {**CELL["robot"], "name": "ur5", "joints": ["shoulder_pan_joint"]}}
)
SLIDES = LockedJoint("finger", 0.0, 0.04, True)


def elbow(by: float) -> object:
    """The pan joint rests; from 1 s on the elbow, which nobody commands, swings by so much [rad]."""

    def motion(t: float) -> Array:
        q = swing(0.3)
        q[2] += by * math.sin(3.0 * max(t - 1.0, 0.0))
        return q

    return motion


def scene(by: float) -> Scene:
    return Scene(duration=2.0, motion=elbow(by), people={"p1": lambda _t: person_at(0.6, 0.0)})


def test_a_joint_that_moves_though_nobody_commands_it_contradicts(tmp_path: Path) -> None:
    still = verify(scene(0.0).write(tmp_path / "still.mcap"), PAN_ONLY)
    assert still.count(Status.VERIFIED) > 100 and still.count(Status.CONTRADICTED) == 0
    moved = verify(scene(0.5).write(tmp_path / "moved.mcap"), PAN_ONLY)
    status, t = moved.per_cycle.status, moved.per_cycle.t
    fast = (t > 1.02) & (np.abs(np.cos(3.0 * (t - 1.0))) > 0.3) & (status != Status.NOT_CHECKED)
    assert fast.sum() > 50 and (status[fast] == Status.CONTRADICTED).all()
    assert (status[(t > 0.1) & (t < 0.9)] == Status.VERIFIED).all()
    first = moved.contradicted[0]
    assert first.reason is Reason.UNCOMMANDED_JOINT_MOVED and first.assumption == "A3 robot"
    assert "elbow_joint, which is not commanded and believed to rest: moved from" in first.text


def test_batch_and_limits_look_at_it_too(tmp_path: Path) -> None:
    path = scene(0.5).write(tmp_path / "moved.mcap")
    plain = verify(path, PAN_ONLY)
    found = BatchVerifier(PAN_ONLY).verify_recording(path)
    np.testing.assert_array_equal(found.status, plain.per_cycle.status)
    robot = build_robot(PAN_ONLY)
    runs = TrialRuns(Reading(Recording(path), robot.joints), PAN_ONLY, robot)
    (outcome,) = runs.run(PAN_ONLY, [Asked(Stretch(0, runs.cycles), 1.0)])
    assert outcome.failure is not None and 80 < outcome.verified < 100


@pytest.mark.parametrize(
    ("q", "told"),
    [
        ([0.01, 0.01, 0.01], None),
        ([0.01, 0.01 + 0.9 * MOVED, 0.01], None),
        ([0.01, 0.01 + 1.1 * MOVED, 0.01], "moved from 0.01 to 0.0111 m"),
        ([0.05, 0.05, 0.05], "at 0.05 m, outside of its range, 0 to 0.04 m"),
        ([-0.01, -0.01, -0.01], "outside of its range"),
        ([0.01, math.nan, 0.01], "at nan m, outside"),
    ],
)
def test_what_rests_and_what_does_not(q: list[float], told: str | None) -> None:
    seen = LockedMotion([(SLIDES, np.array([1.0, 2.0, 3.0]), np.array(q))])
    found = seen.check(1.5, 2.5)
    assert (found is None) is (told is None)
    assert found is None or (told is not None and told in found.text)


def test_samples_on_both_sides_of_a_plan_count_and_no_others() -> None:
    t, q = np.arange(6.0), np.array([0.0, 0.0, 0.0, 0.02, 0.02, 0.02])
    seen = LockedMotion([(SLIDES, t, q)])
    assert seen.check(2.2, 2.8) is not None, "it moves between the samples before and after"
    assert seen.check(0.5, 1.9) is None and seen.check(3.1, 4.0) is None
    assert seen.check(7.0, 8.0) is None and seen.check(-2.0, -1.0) is None
    steps = np.arange(0.0, 1.0, 0.01)
    creeps = LockedMotion([(SLIDES, steps, 0.012 * steps)])
    assert creeps.check(0.5, 0.502) is not None, "12 mm/s, in a plan of 2 ms"
    endless = replace_range(SLIDES)
    assert LockedMotion([(endless, t, np.full(6, 9.0))]).check(0.0, 5.0) is None


def replace_range(joint: LockedJoint) -> LockedJoint:
    return joint._replace(lower=-math.inf, upper=math.inf)


def test_a_publisher_of_them_may_begin_late(tmp_path: Path) -> None:
    """Of the messages at the begin, which say which joints there are, none has them."""
    pan, others = slice(0, 1), slice(1, None)
    plain = scene(0.5)
    with new_recording(tmp_path / "late.mcap") as writer:
        writer.describe({"robot": "ur5"})
        for k in range(LOOK_AHEAD + 200):
            t, stamp = k / 125.0, NANO + k * 8_000_000
            q = plain.motion(t)
            writer.joints(JointState(stamp, UR5_JOINTS[pan], q[pan]))
            if k >= LOOK_AHEAD:
                writer.joints(JointState(stamp + 1000, UR5_JOINTS[others], q[others]))
            if k % 5 == 0:
                person = ReportedPerson("p", person_at(4.0, 0.0), np.full(20, 0.005), ALL_POINTS)
                writer.people(PeopleReport(stamp + 2000, stamp + 3000, "world", False, (person,)))
    report = verify(tmp_path / "late.mcap", PAN_ONLY)
    seen = report.per_cycle.t > LOOK_AHEAD / 125.0
    assert (report.per_cycle.status[~seen][10:-20] == Status.VERIFIED).all()
    assert np.mean(report.per_cycle.status[seen] == Status.CONTRADICTED) > 0.7


def test_a_supervised_replay_refuses_it(tmp_path: Path) -> None:
    """It drives the arm at other times than those in which the elbow was seen to move."""
    path = scene(0.5).write(tmp_path / "moved.mcap")
    with pytest.raises(SetupError, match=r"moved\.mcap: elbow_joint, which .* name the joint in robot"):
        supervise(path, PAN_ONLY)
