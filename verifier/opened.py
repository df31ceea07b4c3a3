"""Opening the recording that a cell is about: which of its topics and joints are meant, the cell says."""

from __future__ import annotations

from pathlib import Path

from robots.assumption import Assumption, Certainty
from robots.catalog import joint_names, robot_names
from robots.errors import SetupError
from verifier.cell import Cell
from verifier.recordings import Choice, Recording, RecordingError
from verifier.recordings.people_sources import FieldState, FloorPositions, SourceOptions
from verifier.recordings.sources import JOINTS


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
        It is refused, or it is not plain which topics and joints are meant.
    """
    choice = choice_of(cell)
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
    return Choice(table.joints_topic, table.people_topic, table.joint_prefix, _arm(cell), people, regions)


def _tilted(cell: Cell) -> frozenset[str]:
    """Frames of the cell whose z does not point up."""
    return frozenset(name for name, frame in cell.people.frames.items() if any(frame.rpy_deg[:2]))


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
