"""Joint samples whose stamps are on another clock than their message times, wherever they stand."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

from robots.errors import SetupError
from tests.verifier.recordings.samples import JOINTS, NANO, joint_states
from tests.verifier.scenes import CELL, Scene
from verifier import Cell, verify
from verifier.batch import BatchVerifier
from verifier.limits import LimitsSettings, find_limits
from verifier.protective_separation import separation_history
from verifier.recordings import Reading, Recording, RecordingError, new_recording
from verifier.recordings.joint_state import JointState
from verifier.recordings.recording_writer import RecordingWriter
from verifier.reports.verification import VerifyReport
from verifier.supervised import supervise


def recorded(path: Path, lag_s: float, first: int) -> Path:
    """A recording in which the stamps of the samples from number ``first`` on lag behind by ``lag_s``."""
    with new_recording(path) as writer:
        write, late = writer._out.write, 0
        writer._out.write = lambda channel, time, data: write(channel, time + late, data)
        for number, state in enumerate(joint_states(seconds=40.0, start_ns=NANO)):
            late = round(lag_s * NANO) if number >= first else 0
            writer.joints(state)
    return path


@pytest.mark.parametrize("first", [0, 2000, 4000])
def test_stamps_and_message_times_are_on_one_clock(tmp_path: Path, first: int) -> None:
    reading = Reading(Recording(recorded(tmp_path / "a.mcap", 9.99, first)), JOINTS, people=False)
    assert len(list(reading.windows(10.0, 0.0, 0.0))) == 4
    path = recorded(tmp_path / "b.mcap", 10.01, first)
    with pytest.raises(RecordingError, match=r"10\.01 s apart: .*; both must be on one clock, at most 10 s"):
        list(Reading(Recording(path), JOINTS, people=False).windows(10.0, 0.0, 0.0))


def judged_by(path: Path, clock_error_s: float) -> list[Callable[[], object]]:
    """Everything that judges a recording, with a declared error of the clocks."""
    robot, people = {**CELL["robot"], "name": "ur5"}, {**CELL["people"], "clock_error_s": clock_error_s}
    cell = Cell.from_table({**CELL, "robot": robot, "people": people})
    return [
        lambda: verify(path, cell),
        lambda: BatchVerifier(cell).verify_recording(path),
        lambda: supervise(path, cell),
        lambda: separation_history(path, cell),
        lambda: find_limits(path, cell, LimitsSettings(answers=("latency",))),
    ]


def recorded_later(by_s: Callable[[int], float], path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording whose joint sample number k is recorded so long after the instant of its stamp."""
    plain, numbers = RecordingWriter.joints, count()

    def later(writer: RecordingWriter, state: JointState) -> None:
        write, by_ns = writer._out.write, round(by_s(next(numbers)) * NANO)
        writer._out.write = lambda channel, time, data: write(channel, time + by_ns, data)
        plain(writer, state)
        writer._out.write = write

    monkeypatch.setattr(RecordingWriter, "joints", later)
    return Scene(duration=1.0).write(path)


@pytest.fixture
def ahead(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording whose joint samples are recorded 0.2 s before the instants that they are stamped with."""
    return recorded_later(lambda _number: -0.2, tmp_path / "r.mcap", monkeypatch)


def test_a_sample_is_not_recorded_before_the_instant_of_its_stamp(ahead: Path) -> None:
    """By a clock that is 6 s fast, somebody who had come and gone stood far away when the arm moved."""
    for judge in judged_by(ahead, 0.199):
        with pytest.raises(SetupError, match=r"r\.mcap: the joint sample .* was recorded 0\.2 s before that"):
            judge()
    assert judged_by(ahead, 0.201)[0]().cycles > 50


@pytest.mark.parametrize(
    ("by_s", "clock_error_s", "said"),
    [
        (lambda number: 0.3, 0.01, "0.3 s"),
        (lambda number: 0.3 + 0.001 * number, 0.19, "0.3 s"),
        (lambda number: 0.3, 0.21, None),
        (lambda number: 0.09, 0.0, None),
        (lambda number: 0.0 if number < 20 else 0.3, 0.01, None),
    ],
)
def test_samples_that_are_late_or_of_a_slow_clock_are_pointed_out(
    by_s, clock_error_s, said, tmp_path, monkeypatch
) -> None:
    path = recorded_later(by_s, tmp_path / "r.mcap", monkeypatch)
    report = judged_by(path, clock_error_s)[0]()
    assert isinstance(report, VerifyReport)
    found = [note for note in report.notes if "every joint sample was recorded" in note]
    assert len(found) == (said is not None)
    assert said is None or f"recorded {said} after its stamp" in found[0]
    assert report.cycles > 50
