"""The same arms through pinocchio alone: placements, velocities and geometry in the world."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import numpy as np
import pinocchio
from numpy.typing import NDArray

Array = NDArray[np.float64]

FILES = {
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "panda": "panda_description/urdf/panda.urdf",
}
MODELS = Path(__file__).parents[2] / "robots" / "models"
OWN = ("fr3", "kr5_sixx", "lwa4p", "ra605", "ur10e", "ur16e", "ur3e", "ur5e")
"""Arms whose URDF comes with this project."""


def urdf_of(name: str) -> Path:
    if name in OWN:
        return MODELS / f"{name}.urdf"
    files = [file for file in metadata.files("example-robot-data") or [] if str(file).endswith(FILES[name])]
    return Path(str(files[0].locate()))


class PinArm:
    """An arm as pinocchio reads it."""

    def __init__(self, urdf: Path, mount: pinocchio.SE3 | None = None) -> None:
        self.urdf = urdf
        self.model = pinocchio.buildModelFromUrdf(str(urdf))
        self.data = self.model.createData()
        self.mount = pinocchio.SE3.Identity() if mount is None else mount

    def configuration(self, positions: dict[str, float]) -> Array:
        """Pinocchio's q: (cos, sin) for joints that turn endlessly."""
        q = pinocchio.neutral(self.model)
        for name, value in positions.items():
            entry = self.model.joints[self.model.getJointId(name)]
            q[entry.idx_q : entry.idx_q + entry.nq] = (
                [value] if entry.nq == 1 else [np.cos(value), np.sin(value)]
            )
        return np.asarray(q)

    def place(self, positions: dict[str, float], speeds: dict[str, float] | None = None) -> None:
        v = np.zeros(self.model.nv)
        for name, value in (speeds or {}).items():
            v[self.model.joints[self.model.getJointId(name)].idx_v] = value
        pinocchio.forwardKinematics(self.model, self.data, self.configuration(positions), v)

    def pose(self, joint: str) -> pinocchio.SE3:
        return self.mount * self.data.oMi[self.model.getJointId(joint)]

    def velocity(self, joint: str) -> tuple[Array, Array]:
        """Angular and linear velocity of the joint frame, world axes."""
        motion = pinocchio.getVelocity(
            self.model, self.data, self.model.getJointId(joint), pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        rotation = self.mount.rotation
        return rotation @ motion.angular, rotation @ motion.linear

    def shapes(self) -> list[tuple[str, pinocchio.GeometryObject]]:
        """(link, geometry) of all collision and visual geometry."""
        folders = [str(folder) for folder in self.urdf.parents]
        found = []
        for kind in (pinocchio.GeometryType.COLLISION, pinocchio.GeometryType.VISUAL):
            geometry = pinocchio.buildGeomFromUrdf(self.model, str(self.urdf), kind, package_dirs=folders)
            for item in geometry.geometryObjects:
                found.append((str(self.model.frames[item.parentFrame].name), item))
        return found
