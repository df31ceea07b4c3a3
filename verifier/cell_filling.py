"""Filling in a cell file from what a recording, a description or MoveIt's limits say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from robots.catalog import built_in_tool, robot_names
from robots.errors import SetupError
from robots.files import printed, read_bytes
from robots.identity import stated_hash, urdf_identity
from robots.urdf_rules import read_xml
from verifier.cell_template import BLANK, Filled, template, toml_string
from verifier.enclosure_size import remarks_on_urdf
from verifier.joint_limits_file import joint_limits_text, kinds_of_urdf, read_joint_limits
from verifier.recordings.beside import read_description
from verifier.recordings.clock_offset import LARGEST_ERROR_S, stated_error
from verifier.recordings.inspection import catalogue, inspect_recording
from verifier.recordings.measured_tracking import MeasuredTracking
from verifier.recordings.neutral import open_whole
from verifier.recordings.robot_sources.robot_description import RobotDescription, description
from verifier.recordings.table_joints import is_table
from verifier.shown import LONGEST_NOTE, shown


class FilledCell(NamedTuple):
    """A cell file that is filled in as far as it is known.

    Attributes
    ----------
    text:
        The file.
    described:
        The description of the arm that is to be written beside it, if one was asked for.
    remarks:
        What should be looked at; comments in the text say the same.
    """

    text: str
    described: RobotDescription | None
    remarks: tuple[str, ...]


def fill_in(
    recording: str | None,
    robot: str | None,
    urdf: str | None,
    limits: str | None,
    package_dirs: Sequence[str] = (),
) -> FilledCell:
    """Fill in what is known of a cell.

    Parameters
    ----------
    recording, robot:
        A recording; an arm of the catalogue or a URDF, in its place or of which it is.
    urdf:
        Where the description of the recording will be, if it is asked for.
    limits:
        File of MoveIt's joint limits.
    package_dirs:
        Where the meshes of ``robot`` are looked for.

    Raises
    ------
    SetupError
        The recording, a URDF or the limits are refused, there is no description to write, or nobody says of
        which arm the limits are.
    """
    found = None if recording is None else inspect_recording(recording)
    if found is not None and not found.topics:
        raise SetupError(f"{recording}: an empty recording: it has no message of anything; give --robot NAME")
    described = None
    if urdf is not None:
        described = _description(recording)
    if robot is not None and robot not in robot_names():
        described = _of_urdf(Path(robot))
    guess = robot or (None if found is None else found.robot_guess)
    arm = guess if guess in robot_names() or stated_hash(guess) is not None else None
    filled = Filled(
        choices={} if found is None else found.choices,
        contains=built_in_tool(arm) if arm in robot_names() else None,
    )
    remarks: tuple[str, ...] = ()
    if described is not None and urdf is not None:
        arm = urdf_identity(described.name, described.content)
        filled = replace(filled, arm=f"urdf = {toml_string(urdf)}  # as the recording describes it")
    elif described is not None and robot is not None:
        arm = urdf_identity(described.name, described.content)
        remarks = remarks_on_urdf(robot, tuple(map(Path, package_dirs)))
        table = "\n".join([f"urdf = {toml_string(robot)}", *map(_comment, remarks)])
        filled = replace(filled, arm=table, limits=_blank_limits(described, robot))
    if package_dirs:
        folders = f"package_dirs = [{', '.join(map(toml_string, package_dirs))}]"
        filled = replace(filled, package_dirs=folders)
    if found is not None:
        filled = replace(filled, clock_error=_clock_error(found.metadata))
    if found is not None and found.tracking is not None:
        filled = replace(filled, tracking=tracking_table(found.tracking, Path(found.path).name))
    if limits is not None:
        kinds = _kinds(arm, described)
        rows = read_joint_limits(Path(limits))
        filled = replace(filled, limits=joint_limits_text(Path(limits), rows, kinds))
    text = template(arm, () if found is None else found.foreign_frames, filled)
    return FilledCell(text, described, remarks)


def _comment(remark: str) -> str:
    return f"# look at: {shown(remark, LONGEST_NOTE)}"


def _clock_error(metadata: Mapping[str, str]) -> str | None:
    """Return ``clock_error_s`` of a recording that says how well its time offset is known."""
    error_s = stated_error(metadata)
    if not 0.0 < error_s <= LARGEST_ERROR_S:
        return None
    return f"clock_error_s = {error_s!r:<22} # error of the time offset that the recording was made with"


def _description(recording: str | None) -> RobotDescription:
    if recording is None:
        raise SetupError("--urdf: writes what a recording describes; give a RECORDING")
    found = None if is_table(recording) else read_description(open_whole(Path(recording)))
    if found is None:
        raise SetupError(f"{recording}: has no message on /robot_description; leave --urdf away")
    return found


def _of_urdf(file: Path) -> RobotDescription:
    content = read_bytes(file)
    read_xml(content, printed(file))
    return description(content)


def _blank_limits(described: RobotDescription, file: str) -> str:
    """Return ``[robot.limits]`` with a blank for all that a URDF cannot state, or does not."""
    lines = []
    for joint in read_xml(described.content, printed(file)).findall("joint"):
        kind, limit = joint.get("type"), joint.find("limit")
        if kind not in ("revolute", "continuous", "prismatic") or joint.find("mimic") is not None:
            continue
        unit = "m" if kind == "prismatic" else "rad"
        lines.append(f"[robot.limits.{toml_string(joint.get('name', ''))}]")
        if limit is None or limit.get("velocity") is None:
            lines.append(f"velocity_{unit}_s = {BLANK}")
        lines += [f"acceleration_{unit}_s2 = {BLANK}", f"jerk_{unit}_s3 = {BLANK}", ""]
    return "\n".join(["# no URDF states these", *lines])


def _kinds(arm: str | None, described: RobotDescription | None) -> Mapping[str, str]:
    """Joint -> its kind, of the arm whose limits are asked for."""
    if described is not None:
        return kinds_of_urdf(described.content)
    if arm in robot_names():
        return dict.fromkeys(catalogue()[arm], "revolute")
    raise SetupError(
        "--joint-limits: nobody says of which arm, and so which joints slide; give --robot NAME, a recording "
        "of an arm of the catalogue, or --urdf"
    )


def tracking_table(found: MeasuredTracking, file: str) -> str:
    """Return ``[robot.tracking]`` with what was measured, and from what."""
    error = _up(float(found.error.max()))
    source = f"|measured - commanded| of {toml_string(file)}"
    worst = toml_string(found.joints[found.worst])
    lines = [
        "[robot.tracking]                       # how well the robot follows the command (A2)",
        f"position_error_rad = {error:<18g}# measured: {worst} at {found.at_s[found.worst]:.3f} s, {source}",
        "# velocity_error_rad_s = 0.0",
        "# delay_min_s = 0.0                    # from command to motion",
    ]
    if found.delay_s is None:
        lines.append("# delay_max_s = 0.0                    # no one delay of all joints was found")
    else:
        delay = _up(found.delay_s)
        lines.append(
            f"delay_max_s = {delay:<25g}# measured: the delay of all joints that explains most of it"
        )
    return "\n".join(lines) + "\n"


def _up(value: float) -> float:
    """Round up to three digits."""
    if value <= 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.ceil(value / unit - 1e-9) * unit:.3g}")
