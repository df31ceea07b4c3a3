"""Options that several commands take, and the files that a choice of them brings along."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from robots.catalog import robot_names
from verifier.cell import Cell
from verifier.targets import Named

_Command = Callable[..., Any]

force_option = click.option("--force", is_flag=True, help="Overwrite files that exist.")
json_option = click.option(
    "--json", "json_path", metavar="F", help="Write the result as JSON; - for standard output."
)


def cell_options(command: _Command) -> _Command:
    """Options that choose or change a cell."""
    options = (
        click.option("--cell", "cell_path", metavar="CELL.toml", help="Cell file; see `stopproof init`."),
        click.option("--robot", metavar="NAME|URDF", help="Arm of the catalogue, or the path of a URDF."),
        click.option("--tool", metavar="FILE", help="Tool file (TOML)."),
        click.option("--bare-flange", is_flag=True, help="State that there is no tool."),
        click.option(
            "--human", "models", multiple=True, metavar="MODEL", help="Model of people; repeatable."
        ),
        click.option("--profile", metavar="P", help="Profile of people's limits."),
        click.option("--stop-model", metavar="M", help="Whose stop is assumed."),
    )
    for option in reversed(options):
        command = option(command)
    return command


def read_with(cell: Cell) -> list[Named]:
    """Name the files that a cell brings along."""
    limits = cell.criteria.contact_limits
    own = [("limits of contact", limits)] if limits.endswith(".toml") else []
    meshes: list[Named] = [(f"mesh of {name}", each.file) for name, each in cell.workspace.fixtures.items()]
    return [
        ("tool file", cell.robot.tool),
        ("URDF", cell.robot.urdf or file_of(cell.robot.name)),
        *meshes,
        *own,
    ]


def file_of(robot: str | None) -> str | None:
    """Return the file that an arm is read from, if the user brings it."""
    return None if robot in robot_names() else robot
