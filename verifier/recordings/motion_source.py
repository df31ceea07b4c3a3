"""Opening what was recorded of an arm's motion, whichever file it comes from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from verifier.recordings.choice import NOTHING_SAID, Choice
from verifier.recordings.containers import is_container
from verifier.recordings.errors import RecordingError
from verifier.recordings.joint_source import KINDS
from verifier.recordings.joint_state import NANO
from verifier.recordings.likely_units import JointUnits
from verifier.recordings.motion import RecordedMotion
from verifier.recordings.motion_mcap import read_mcap
from verifier.recordings.motion_table import read_csv, read_npz


def open_motion(
    path: Path,
    robot_joints: tuple[str, ...] | None = None,
    run: int | None = None,
    choice: Choice = NOTHING_SAID,
) -> RecordedMotion:
    """Read a recording by its ending.

    Parameters
    ----------
    path:
        CSV, NPZ, MCAP, ROS 1 bag, ROS 2 storage file, or the folder of a ROS 2 bag.
    robot_joints:
        Joints of the arm that was recorded, in the order in which they are wanted; ``None``: whichever the
        file has.
    run:
        Which run of an NPZ that numbers them.
    choice:
        Which topics and joints of a bag are meant.

    Raises
    ------
    RecordingError
        The file is of no known kind, is refused, or is of another arm.
    """
    motion = _read(path, robot_joints, run, choice)
    if motion.q is None:
        return motion
    units = JointUnits(motion.joints)
    units.add(np.round(motion.t * NANO).astype(np.int64), motion.q)
    return replace(motion, notes=(*motion.notes, *units.remarks(path.name)))


def _read(
    path: Path, robot_joints: tuple[str, ...] | None, run: int | None, choice: Choice
) -> RecordedMotion:
    if path.suffix == ".npz":
        return read_npz(path, robot_joints, run)
    if run is not None:
        raise RecordingError(path, "", f"has no runs, so no run {run}", "leave --run away")
    if path.name.endswith((".csv", ".csv.gz")):
        return read_csv(path, robot_joints)
    if is_container(path):
        return read_mcap(path, robot_joints, choice)
    wrong = f"is no kind of file that holds joints ({path.suffix or 'no ending'})"
    raise RecordingError(path, "", wrong, KINDS)
