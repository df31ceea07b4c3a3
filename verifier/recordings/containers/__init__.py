"""Containers of messages: MCAP, ROS 2 bags, ROS 1 bags; read as they are, nothing of them is executed."""

from __future__ import annotations

from pathlib import Path

from verifier.recordings.containers.container import Container
from verifier.recordings.containers.mcap_container import open_mcap
from verifier.recordings.containers.ros1_bag import Ros1Bag
from verifier.recordings.containers.ros2_folder import Ros2Folder
from verifier.recordings.containers.ros2_sqlite import Sqlite3Storage
from verifier.recordings.errors import RecordingError

__all__ = ["ENDINGS", "Container", "is_container", "open_container"]

ENDINGS = (".mcap", ".bag", ".db3")
"""Of files; a ROS 2 bag is a folder."""


def is_container(path: Path) -> bool:
    """Whether a name is that of a container: a folder, or a file with one of the endings."""
    return path.suffix in ENDINGS or path.name.endswith(".bag.active") or path.is_dir()


def open_container(path: Path) -> Container:
    """Open a file or folder by its ending; what is damaged is opened with what can be read of it.

    Raises
    ------
    RecordingError
        It is not there, is of no known kind, or is not what its ending says.
    """
    if not path.exists():
        raise RecordingError(
            path, "", "does not exist", "name an MCAP file, a ROS 1 bag or the folder of a ROS 2 bag"
        )
    if path.is_dir():
        return Ros2Folder(path)
    if not path.is_file():
        raise RecordingError(path, "", "is a pipe or device, not a file", "save it as a file first")
    if path.suffix == ".db3":
        return Sqlite3Storage(path)
    if path.name.endswith((".bag", ".bag.active")):
        return Ros1Bag(path)
    return open_mcap(path)
