"""Opening the recording that a cell is about: which of its topics and joints are meant, the cell says."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from robots.catalog import joint_names, robot_names
from robots.errors import SetupError
from verifier.cell import Cell
from verifier.placing import place_frames
from verifier.recordings import Choice, Recording
from verifier.recordings.clock_offset import ClockOffsets, refuse_unstated_error
from verifier.recordings.frame_chain import read_frames
from verifier.recordings.people_sources import SourceOptions
from verifier.setup import require_cell


class OpenedRecording(NamedTuple):
    """A recording, and the cell with what the recording knows of it."""

    recording: Recording
    cell: Cell


def open_recording(path: str | Path, cell: Cell, *, everything: bool = False) -> Recording:
    """Open a recording of any kind (docs/recordings.md); ``everything``: with the topics that nobody reads.

    Raises
    ------
    RecordingError
        It is refused, it is not plain which topics and joints are meant, or its clocks are known less well
        than the cell says.
    """
    recording = Recording(path, choice_of(cell), everything=everything)
    refuse_unstated_error(recording.path, recording.metadata, cell.people.clock_error_s)
    return recording


def open_placed(path: str | Path, cell: Cell) -> OpenedRecording:
    """Open a recording as :func:`open_recording`, and put the poses of frames that it knows into the cell.

    Raises
    ------
    RecordingError
        As :func:`open_recording`; or a frame has no pose, or one that changes.
    CellError
        Cell and recording contradict each other about a frame.
    """
    require_cell(cell)
    recording = open_recording(path, cell)
    if cell.recording.base_frame is None or not cell.people.frames:
        return OpenedRecording(recording, cell)
    placed = place_frames(cell, read_frames(recording.path))
    recording.assumptions = (*recording.assumptions, *placed.assumptions)
    return OpenedRecording(recording, placed.cell)


def choice_of(cell: Cell) -> Choice:
    """Return what a cell says about the recording."""
    table = cell.recording
    people = SourceOptions(point_names=cell.people.point_names)
    clocks = ClockOffsets(table.time_offset_s, table.joints_time_offset_s, cell.people.clock_error_s)
    return Choice(table.joints_topic, table.people_topic, table.joint_prefix, _arm(cell), people, clocks)


def _arm(cell: Cell) -> tuple[str, ...]:
    """Joints of the arm; empty where the cell names none, or one that is refused when it is set up."""
    if cell.robot.joints:
        return cell.robot.joints
    arm = cell.robot.name or cell.robot.urdf
    if arm is None or (cell.robot.name is not None and arm not in robot_names()):
        return ()
    try:
        return joint_names(arm)[1]
    except SetupError:
        return ()
