"""``/robot_description``: the URDF that a robot was started with, as text in a message."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

from robots.errors import SetupError
from robots.identity import urdf_identity
from robots.urdf_rules import read_xml
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.robot_sources.joint_sample import field

TOPIC = "/robot_description"
SCHEMA = "std_msgs/msg/String"
LONGEST = 32 << 20
"""Bytes of a description."""


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """An arm as it describes itself.

    Attributes
    ----------
    name:
        Of the robot element.
    content:
        The file.
    joints:
        Names of the joints that move, in the order of the file.
    """

    name: str
    content: bytes
    joints: tuple[str, ...]

    @property
    def identity(self) -> str:
        """What a recording of this arm states, see :func:`robots.identity.urdf_identity`."""
        return urdf_identity(self.name, self.content)


def read_description(message: Decoded) -> RobotDescription:
    """Read a ``std_msgs/String`` with a URDF.

    Raises
    ------
    SourceError
        It holds no text, or the text is no URDF.
    """
    text = field(message, message.value, "data")
    if not isinstance(text, str):
        raise SourceError(f"its data are {type(text).__name__}; they must be the text of a URDF")
    return description(text.encode("utf-8", "surrogateescape"))


def description(content: bytes) -> RobotDescription:
    """Return what a URDF says of itself; whether it can be used is seen when it is loaded.

    Raises
    ------
    SourceError
        It is no URDF, or longer than 32 MiB.
    """
    if len(content) > LONGEST:
        raise SourceError(f"the description has {len(content)} bytes; at most {LONGEST}")
    try:
        root: ElementTree.Element = read_xml(content, TOPIC)
    except SetupError as error:
        raise SourceError(
            f"the description is no URDF ({error}); publish the URDF itself, not xacro"
        ) from error
    moving = tuple(
        joint.get("name", "")
        for joint in root.findall("joint")
        if joint.get("type") != "fixed" and joint.find("mimic") is None
    )
    return RobotDescription(root.get("name") or "unnamed", content, moving)
