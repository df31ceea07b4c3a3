"""The file of a stop model that was fitted on recordings, read for a cell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from failsafe.braking import Braking
from robots.errors import SetupError
from robots.files import printed, read_toml
from robots.model import RobotModel

_TEXTS = ("robot", "source")
_SINGLE = ("delay_s", "braking_time_s", "margin")
_OF_JOINTS = ("deceleration_rad_s2", "fastest_rad_s")
_KEYS = (*_TEXTS, "joints", *_SINGLE, *_OF_JOINTS)


@dataclass(frozen=True, slots=True, eq=False)
class StopModel:
    """A stop model of an arm, and where it comes from.

    ``robot``: name of the arm, ``""``: the recordings did not say; ``joints``: the order of its numbers.
    """

    robot: str
    joints: tuple[str, ...]
    braking: Braking
    margin: float
    source: str


def read_model(path: Path) -> StopModel:
    """Read a model file.

    Raises
    ------
    SetupError
        It is not there, is no TOML, lacks a key or has another one, or a value is not usable.
    """
    table = read_toml(path)
    where = printed(path)
    for key in table:
        if key not in _KEYS:
            raise SetupError(f"{where}: {printed(key)} is no key of a stop model; it has {', '.join(_KEYS)}")
    for key in _KEYS:
        if key not in table:
            raise SetupError(f"{where}: {key} is missing; `stopproof stops --model` writes a stop model")
    joints = _listed(table["joints"])
    if not joints or not all(isinstance(each, str) for each in (*joints, *(table[key] for key in _TEXTS))):
        raise SetupError(f"{where}: robot, source and joints must be text, and joints a list of it")
    single = {key: _number(table[key], where, key) for key in _SINGLE}
    of_joints = {
        key: np.array([_number(each, where, key) for each in _listed(table[key])]) for key in _OF_JOINTS
    }
    for key, values in of_joints.items():
        if len(values) != len(joints):
            raise SetupError(f"{where}: {key} has {len(values)} values for {len(joints)} joints")
    try:
        braking = Braking(single["delay_s"], single["braking_time_s"], *of_joints.values())
    except SetupError as error:
        raise SetupError(f"{where}: {error}") from error
    if not 0.0 <= single["margin"] < math.inf:
        raise SetupError(f"{where}: margin {single['margin']}: should be a finite share, not negative")
    names = tuple(str(each) for each in joints)
    return StopModel(table["robot"], names, braking, single["margin"], table["source"])


def _listed(value: object) -> Sequence[object]:
    return value if isinstance(value, list) else []


def _number(value: object, where: str, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SetupError(f"{where}: {key} must be a number, or a list of one for each joint")
    return float(value)


def braking_of(path: Path, robot: RobotModel) -> tuple[StopModel, Braking]:
    """Read a model file for an arm: with its braking in the order of the arm's joints.

    Raises
    ------
    SetupError
        As :func:`read_model`; or it is of another arm.
    """
    model = read_model(path)
    if model.robot not in ("", robot.name):
        raise SetupError(
            f"{printed(path)}: is of {printed(model.robot)}, and the robot is {robot.name}: they must agree"
        )
    if sorted(model.joints) != sorted(robot.joints):
        raise SetupError(
            f"{printed(path)}: is of joints {', '.join(map(printed, model.joints))}; the robot has "
            f"{', '.join(robot.joints)}: name it with --robot when the model is fitted"
        )
    order = [model.joints.index(joint) for joint in robot.joints]
    given = model.braking
    return model, Braking(
        given.delay_s, given.braking_time_s, given.deceleration[order], given.fastest[order]
    )
