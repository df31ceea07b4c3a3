"""Sensor frames whose pose the recording knows: taken from there, or held against what the cell says."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from robots.assumption import Assumption, Certainty
from robots.errors import SetupError
from robots.model import Mount
from verifier.cell import Cell
from verifier.cell_reading import CellError
from verifier.cell_tables import Frame
from verifier.recordings.frame_chain import Chain, RecordedFrames

SAME = 1e-6
"""Poses that differ by no more than rounding [m, rad] are the same."""


class Placed(NamedTuple):
    """A cell that states every pose, and where those that it did not state are from."""

    cell: Cell
    assumptions: tuple[Assumption, ...]


def place_frames(cell: Cell, frames: RecordedFrames) -> Placed:
    """Fill in the poses that the recording has; hold those that the cell states against it.

    Raises
    ------
    RecordingError
        Nothing leads from a frame to the base, or something between them moves.
    CellError
        The cell and the recording contradict each other by more than the errors that the cell states.
    """
    base, placed, noted = cell.recording.base_frame, dict(cell.people.frames), []
    if base is None:
        return Placed(cell, ())
    for name, frame in cell.people.frames.items():
        known = name.removeprefix("/")
        if frame.pose == "recorded":
            chain = frames.chain(known, base)
            placed[name] = _filled(frame, _in_world(cell, chain))
            way = f"/tf_static of {frames.path.name}: {' - '.join(chain.frames)}; error declared in the cell"
            pose = f"{_numbers(placed[name].xyz_m)} m, {_numbers(placed[name].rpy_deg)} deg"
            noted.append(Assumption(f"recording.frame.{name}", pose, "", way, Certainty.MEASURED))
        elif frames.knows(known, base):
            _compare(cell, name, frame, _in_world(cell, frames.chain(known, base)), frames)
    people = cell.people.model_copy(update={"frames": placed})
    return Placed(cell.model_copy(update={"people": people}), tuple(noted))


def _in_world(cell: Cell, chain: Chain) -> Mount:
    mount = Mount.from_xyz_rpy(cell.robot.mount.xyz_m, cell.robot.mount.rpy_deg)
    return Mount(mount.rotation @ chain.rotation, mount.rotation @ chain.xyz_m + mount.translation)


def _filled(frame: Frame, pose: Mount) -> Frame:
    x, y, z = pose.translation.tolist()
    matrix = pose.rotation
    # at a pitch of 90 degrees roll and yaw turn about one axis: all of it is yaw
    level = math.hypot(matrix[0, 0], matrix[1, 0])
    pitch = math.atan2(-matrix[2, 0], level)
    roll = math.atan2(matrix[2, 1], matrix[2, 2]) if level > SAME else 0.0
    yaw = math.atan2(matrix[1, 0], matrix[0, 0]) if level > SAME else math.atan2(-matrix[0, 1], matrix[1, 1])
    rpy = (math.degrees(roll), math.degrees(pitch), math.degrees(yaw))
    if not np.abs(Mount.from_xyz_rpy((x, y, z), rpy).rotation - matrix).max() < 10.0 * SAME:
        raise SetupError(f"roll, pitch, yaw {_numbers(rpy)} deg are not the rotation of /tf_static")
    return frame.model_copy(update={"pose": "stated", "xyz_m": (x, y, z), "rpy_deg": rpy})


def _compare(cell: Cell, name: str, frame: Frame, recorded: Mount, frames: RecordedFrames) -> None:
    stated = Mount.from_xyz_rpy(frame.xyz_m, frame.rpy_deg)
    apart_m = float(np.linalg.norm(stated.translation - recorded.translation))
    turned = float(Rotation.from_matrix(stated.rotation.T @ recorded.rotation).magnitude())
    allowed = frame.translation_error_m + SAME, math.radians(frame.rotation_error_deg) + SAME
    if apart_m <= allowed[0] and turned <= allowed[1]:
        return
    seen = _filled(frame, recorded)
    raise CellError(
        f"{cell.where}: people.frames.{name}: xyz_m = {_numbers(frame.xyz_m)}, "
        f"rpy_deg = {_numbers(frame.rpy_deg)}, but by /tf_static of {frames.path.name} it is at "
        f"{_numbers(seen.xyz_m)}, {_numbers(seen.rpy_deg)}: {apart_m:.4g} m and {math.degrees(turned):.4g} "
        'deg apart, more than the errors that the cell states; they must agree, or state pose = "recorded"'
    )


def _numbers(values: tuple[float, ...]) -> str:
    return f"[{', '.join(f'{value:.6g}' for value in values)}]"
