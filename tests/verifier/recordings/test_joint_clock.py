"""Joint samples whose stamps are on another clock than their message times, wherever they stand."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.verifier.recordings.samples import JOINTS, NANO, joint_states
from verifier.recordings import Reading, Recording, RecordingError, new_recording


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
