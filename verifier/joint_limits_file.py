"""MoveIt's ``joint_limits.yaml``: limits of joints that a URDF does not give.

Source of the keys: moveit/moveit_tutorials, time parameterization: ``max_position``, ``min_position``,
``max_velocity``, ``max_acceleration``, switched on by ``has_velocity_limits`` and
``has_acceleration_limits``; jerk alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from ruamel.yaml import YAML
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import YAMLError

from robots.errors import SetupError
from robots.files import LARGEST_TEXT, printed, read_bytes
from verifier.cell_template import toml_string

LARGEST_FILE = 1 << 20
"""Bytes; every real one has a few thousand."""
LARGEST = 1e6

_SWITCHED = {
    "velocity": ("has_velocity_limits", "max_velocity"),
    "acceleration": ("has_acceleration_limits", "max_acceleration"),
    "jerk": ("has_jerk_limits", "max_jerk"),
}
_POSITION = ("min_position", "max_position")
_KEYS = {
    "revolute": {
        "position_lower": "position_lower_rad",
        "position_upper": "position_upper_rad",
        "velocity": "velocity_rad_s",
        "acceleration": "acceleration_rad_s2",
        "jerk": "jerk_rad_s3",
    },
    "prismatic": {
        "position_lower": "position_lower_m",
        "position_upper": "position_upper_m",
        "velocity": "velocity_m_s",
        "acceleration": "acceleration_m_s2",
        "jerk": "jerk_m_s3",
    },
}
"""Kind of joint -> quantity -> key of ``[robot.limits.<joint>]``."""

JointRows = Mapping[str, Mapping[str, float]]
"""Joint -> quantity -> number, in the units of the joint."""


def read_joint_limits(path: Path) -> JointRows:
    """Read the limits that are switched on.

    Raises
    ------
    SetupError
        The file is no YAML of this kind, or a limit is no positive number, or nobody says whether it counts.
    """
    content = read_bytes(path, LARGEST_TEXT)
    if len(content) > LARGEST_FILE:
        _refuse(path, f"has {len(content)} bytes", "a joint_limits.yaml has a few thousand")
    try:
        found = _loader().load(content)
    except (YAMLError, ValueError, TypeError, RecursionError, AttributeError) as error:
        why = str(error).splitlines()[0] if str(error) else type(error).__name__
        _refuse(path, f"is no YAML that can be read ({why})", "plain values without tags; angles in rad")
    joints = found.get("joint_limits") if isinstance(found, dict) else None
    if not isinstance(joints, dict) or not joints:
        _refuse(
            path, "has no table joint_limits", "MoveIt's joint_limits.yaml has one, with a table per joint"
        )
    return {str(name): _limits(path, str(name), table) for name, table in joints.items()}


def kinds_of_urdf(content: bytes) -> dict[str, str]:
    """Return joint -> kind of a URDF, without looking for its meshes.

    Raises
    ------
    SetupError
        It is no URDF.
    """
    from robots.urdf_rules import read_xml

    root = read_xml(content, "/robot_description")
    return {joint.get("name", ""): joint.get("type", "") for joint in root.findall("joint")}


def _loader() -> YAML:
    """A loader that makes plain values and nothing else."""
    loader = YAML(pure=True)
    loader.Constructor = SafeConstructor
    return loader


def _limits(path: Path, joint: str, table: object) -> Mapping[str, float]:
    if not isinstance(table, dict):
        _refuse(path, f"joint_limits.{joint} is no table", "one key a line, indented")
    limits = {}
    for quantity, (switch, key) in _SWITCHED.items():
        if key in table and switch not in table:
            _refuse(path, f"joint_limits.{joint} has {key} and no {switch}", f"say {switch}: true or false")
        on = table.get(switch, False)
        if not isinstance(on, bool):
            _refuse(path, f"joint_limits.{joint}.{switch} is {_named(on)}", "write true or false")
        if on:
            limits[quantity] = _number(path, joint, key, table, positive=True)
    ends = [key for key in _POSITION if key in table]
    if ends and table.get("has_position_limits", True) is not False:
        if len(ends) == 1:
            _refuse(path, f"joint_limits.{joint} has {ends[0]} alone", "give min_position and max_position")
        lower, upper = (_number(path, joint, key, table, positive=False) for key in _POSITION)
        if not lower < upper:
            _refuse(path, f"joint_limits.{joint}: min_position {lower:g} is not below {upper:g}", "swap them")
        limits |= {"position_lower": lower, "position_upper": upper}
    return limits


def _number(path: Path, joint: str, key: str, table: Mapping[str, Any], *, positive: bool) -> float:
    value = table.get(key)
    place = f"joint_limits.{joint}.{key}"
    if isinstance(value, bool) or not isinstance(value, int | float):
        _refuse(path, f"{place} is {_named(value)}", "write a number, in rad, s or m")
    if not (abs(value) <= LARGEST and (value > 0.0 or not positive)):  # NaN, and integers of any length
        _refuse(
            path,
            f"{place} is {str(value)[:40]}",
            "a limit is a finite number" + (" above 0" if positive else ""),
        )
    return float(value)


def _named(value: object) -> str:
    """A value for a line; of a list or table only what it is: those that refer to each other have no end."""
    return f"a {type(value).__name__}" if isinstance(value, list | dict | tuple | set) else repr(value)


def joint_limits_text(path: Path, rows: JointRows, kinds: Mapping[str, str]) -> str:
    """Return ``[robot.limits]`` of a cell, each line with its source; ``kinds``: of the arm's joints.

    Raises
    ------
    SetupError
        None of the arm's joints is among them.
    """
    moving = {name: kind for name, kind in kinds.items() if kind in ("revolute", "continuous", "prismatic")}
    named = [name for name in rows if name in moving and rows[name]]
    if not named:
        _refuse(
            path,
            f"has none of the joints {', '.join(moving)} (it has {', '.join(rows)})",
            "give the file of this arm, with joint names as in its URDF",
        )
    source = f"# declared in {toml_string(path.name)}"
    lines: list[str] = []
    for name in named:
        keys = _KEYS["prismatic" if moving[name] == "prismatic" else "revolute"]
        lines.append(f"[robot.limits.{toml_string(name)}]")
        lines += [f"{keys[quantity]} = {value!r}  {source}" for quantity, value in rows[name].items()]
        lines.append("")
    others = [name for name in rows if name not in moving]
    if others:
        lines.append(f"# not of this arm, left out: {', '.join(map(toml_string, others))}")
        lines.append("")
    return "\n".join(lines)


def _refuse(path: Path, wrong: str, right: str) -> NoReturn:
    raise SetupError(f"{printed(str(path))}: {' '.join(wrong.split())}; {right}")
