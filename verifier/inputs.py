"""The files that a result rests on, and what was in them when it was made."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from robots.catalog import robot_names
from robots.errors import SetupError
from robots.files import is_file, printed, read_bytes, read_toml
from robots.tool import read_tool
from robots.urdf import parse_urdf
from verifier.cell import Cell
from verifier.targets import Named


@dataclass(frozen=True, slots=True)
class InputFile:
    """A file that was read.

    Attributes
    ----------
    what:
        What it is: recording, cell, tool file …
    file:
        Its name, without the folder: the same result on another machine names the same file.
    bytes:
        Its size.
    sha256:
        Of its content, in hexadecimal digits.
    """

    what: str
    file: str
    bytes: int
    sha256: str


def read_with(cell: Cell) -> list[Named]:
    """Name the files that a cell brings along."""
    limits, profile = cell.criteria.contact_limits, cell.people.profile
    own: list[Named] = [("limits of contact", limits)] if limits.endswith(".toml") else []
    own += [("profile", profile)] if profile.endswith(".toml") else []
    meshes: list[Named] = [(f"mesh of {name}", each.file) for name, each in cell.workspace.fixtures.items()]
    return [
        ("tool file", cell.robot.tool),
        ("stop model", cell.stop.measured_file),
        ("URDF", cell.robot.urdf or file_of(cell.robot.name)),
        *meshes,
        *own,
    ]


def file_of(robot: str | None) -> str | None:
    """Return the file that an arm is read from, if the user brings it."""
    return None if robot in robot_names() else robot


def input_files(recording: Path | None, cell: Cell) -> tuple[InputFile, ...]:
    """Return the files that a run rests on, over a recording if there is one, each with its hash.

    Arms, profiles and limits that come with this software are not among them: the hash of the cell covers
    their content.

    Raises
    ------
    SetupError
        A file cannot be read.
    """
    named: list[Named] = [
        *recording_files(recording), ("cell", cell.file), *read_with(cell), *_meshes(cell)
    ]  # fmt: skip
    return tuple(input_file(what, Path(path)) for what, path in named if path is not None)


def _meshes(cell: Cell) -> list[Named]:
    """Name the mesh files of a URDF and of a tool that the user brings, each once."""
    urdf, tool = cell.robot.urdf or file_of(cell.robot.name), cell.robot.tool
    files: dict[Path, str] = {}
    if urdf is not None:
        path = Path(urdf)
        packages = tuple(Path(each) for each in cell.robot.package_dirs)
        for link, file in parse_urdf(read_bytes(path), path, packages).meshes:
            files.setdefault(file, f"mesh {file.name} of {link}")
    if tool is not None:
        path = Path(tool)
        for mesh in read_tool(read_toml(path), path.parent, str(path)).meshes:
            files.setdefault(mesh.file, f"mesh {mesh.file.name} of the tool")
    return [(what, str(file)) for file, what in files.items()]


def recording_files(path: Path | None) -> list[Named]:
    """Name the files of a recording: of a folder all that lie in it."""
    if path is None or not path.is_dir():
        return [("recording", path)]
    return [("recording", each) for each in sorted(path.iterdir()) if each.is_file()]


def input_file(what: str, path: Path) -> InputFile:
    """Hash a file piece by piece: an hour's recording need not stand in memory.

    Raises
    ------
    SetupError
        The file cannot be read.
    """
    if not is_file(path):
        raise SetupError(f"{printed(path)}: is not there any more, or is no file; the {what} must stay there")
    try:
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
            return InputFile(what, path.name, stream.tell(), digest)
    except OSError as error:
        raise SetupError(f"{printed(path)}: cannot be read ({error.strerror})") from error
