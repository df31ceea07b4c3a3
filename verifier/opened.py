"""Opening the recording that a cell is about: which of its topics and joints are meant, the cell says."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from robots.assumption import Assumption, Certainty
from robots.catalog import joint_names, robot_names
from robots.errors import SetupError
from verifier.cell import Cell
from verifier.placing import place_frames
from verifier.recordings import Choice, Recording, RecordingError
from verifier.recordings.clock_offset import ClockOffsets, refuse_unstated_error
from verifier.recordings.frame_chain import frames_that_move, read_frames
from verifier.recordings.people_sources import FieldState, FloorPositions, SourceOptions
from verifier.recordings.sources import JOINTS
from verifier.recordings.table_joints import is_table
from verifier.setup import require_cell


class OpenedRecording(NamedTuple):
    """A recording, and the cell with what the recording knows of it."""

    recording: Recording
    cell: Cell


def open_recording(
    path: str | Path, cell: Cell, *, everything: bool = False, assume_nobody: bool = False
) -> Recording:
    """Open a recording of any kind (docs/recordings.md).

    Parameters
    ----------
    path:
        MCAP, bag, or table of joint motion.
    cell:
        What it is about.
    everything:
        With the topics that nobody reads.
    assume_nobody:
        Leave people out, and say so, where reading them refuses the recording.

    Raises
    ------
    RecordingError
        It is refused, it is not plain which topics and joints are meant, or its clocks are known less well
        than the cell says.
    """
    recording = _opened(path, choice_of(cell), everything=everything, assume_nobody=assume_nobody)
    refuse_unstated_error(recording.path, recording.metadata, cell.people.clock_error_s)
    return recording


def open_placed(
    recording: Recording | str | Path, cell: Cell, *, assume_nobody: bool = False
) -> OpenedRecording:
    """Open a recording as :func:`open_recording`, and put the poses of frames that it knows into the cell.

    One that is open already stays what it is, and so does the cell.

    Raises
    ------
    RecordingError
        As :func:`open_recording`; or a frame has no pose, or one that changes.
    CellError
        Cell and recording contradict each other about a frame.
    """
    require_cell(cell)
    if isinstance(recording, Recording):
        return OpenedRecording(recording, cell)
    recording = open_recording(recording, cell, assume_nobody=assume_nobody)
    if assume_nobody or not cell.people.frames:
        return OpenedRecording(recording, cell)
    if cell.recording.base_frame is None:
        if not is_table(recording.path):
            recording.moving_frames = frames_that_move(recording.path, cell.people.frames)
        return OpenedRecording(recording, cell)
    placed = place_frames(cell, read_frames(recording.path))
    recording.assumptions = (*recording.assumptions, *placed.assumptions)
    return OpenedRecording(recording, placed.cell)


def _opened(path: str | Path, choice: Choice, *, everything: bool, assume_nobody: bool) -> Recording:
    try:
        return Recording(path, choice, everything=everything)
    except RecordingError as refused:
        if not assume_nobody:
            raise
        noted = Assumption("recording.people_not_read", "all", "", str(refused), Certainty.DECLARED)
    return Recording(path, choice, everything=everything, wanted=(JOINTS,), noted=(noted,))


def choice_of(cell: Cell) -> Choice:
    """Return what a cell says about the recording."""
    table, regions = cell.recording, tuple(cell.people.monitored)
    floor, switch = table.floor, table.switch
    people = SourceOptions(
        point_names=cell.people.point_names,
        ros4hri_error_m=table.ros4hri_error_m,
        floor=None if floor is None else FloorPositions(floor.error_m, floor.floor_z_m, _tilted(cell)),
        field=None if switch is None else FieldState(switch.free_when, switch.age_s),
    )
    return Choice(
        joints_topic=table.joints_topic,
        people_topic=table.people_topic,
        joint_prefix=table.joint_prefix,
        arm=_arm(cell),
        people=people,
        clocks=ClockOffsets(table.time_offset_s, table.joints_time_offset_s, cell.people.clock_error_s),
        regions=regions,
    )


def _tilted(cell: Cell) -> frozenset[str]:
    """Frames of the cell whose z does not point up, or of which that is not known before they are read."""
    return frozenset(
        name
        for name, frame in cell.people.frames.items()
        if frame.pose == "recorded" or any(frame.rpy_deg[:2])
    )


def _arm(cell: Cell) -> tuple[str, ...]:
    """Joints of the arm; empty where the cell names none, or one that is refused when it is set up."""
    if cell.robot.joints:
        return cell.robot.joints
    arm = cell.robot.name or cell.robot.urdf
    if arm is None or (cell.robot.name is not None and arm not in robot_names()):
        return ()
    try:
        return joint_names(arm, tuple(map(Path, cell.robot.package_dirs)))[1]
    except SetupError:
        return ()
