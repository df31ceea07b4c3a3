"""Opening the recording that a cell is about: which of its topics and joints are meant, the cell says."""

from __future__ import annotations

from pathlib import Path

from robots.catalog import joint_names, robot_names
from robots.errors import SetupError
from verifier.cell import Cell
from verifier.recordings import Choice, Recording
from verifier.recordings.people_sources import SourceOptions


def open_recording(path: str | Path, cell: Cell, *, everything: bool = False) -> Recording:
    """Open a recording of any kind (docs/recordings.md); ``everything``: with the topics that nobody reads.

    Raises
    ------
    RecordingError
        It is refused, or it is not plain which topics and joints are meant.
    """
    return Recording(path, choice_of(cell), everything=everything)


def choice_of(cell: Cell) -> Choice:
    """Return what a cell says about the recording."""
    table = cell.recording
    people = SourceOptions(point_names=cell.people.point_names)
    return Choice(table.joints_topic, table.people_topic, table.joint_prefix, _arm(cell), people)


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
