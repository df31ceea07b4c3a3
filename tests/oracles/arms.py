"""The arms of example-robot-data, and one of capsules, as the brute-force checker reads them."""

from __future__ import annotations

import sysconfig
from functools import cache
from pathlib import Path

import numpy as np

from tests.oracles.urdf_arm import Arm

UR_JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
PANDA_JOINTS = tuple(f"panda_joint{i}" for i in range(1, 8))
ARMS: dict[str, tuple[str, tuple[str, ...]]] = {
    "ur3": ("ur_description/urdf/ur3_robot.urdf", UR_JOINTS),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", UR_JOINTS),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", UR_JOINTS),
    "panda": ("panda_description/urdf/panda.urdf", PANDA_JOINTS),
    "made_up": ("", ("rail", "turn", "bend", "twist")),
}
MESH_ARMS = tuple(name for name in ARMS if name != "made_up")


def share_folder() -> Path:
    """The folder that ``package://example-robot-data`` stands for."""
    folder = Path(sysconfig.get_path("purelib")) / "cmeel.prefix" / "share" / "example-robot-data"
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: example-robot-data is not installed here")
    return folder


def urdf_file(name: str) -> Path:
    """The URDF of an arm by its name here."""
    if name == "made_up":
        return Path(__file__).parent / "made_up_arm.urdf"
    return share_folder() / "robots" / ARMS[name][0]


@cache
def arm(name: str) -> Arm:
    """An arm with points on its meshes; always the same points."""
    packages = {"example-robot-data": share_folder()} if name in MESH_ARMS else {}
    return Arm(urdf_file(name), packages, ARMS[name][1], np.random.default_rng(7))
