"""Options that several commands take, and the files that a choice of them brings along."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from verifier.inputs import file_of, read_with

__all__ = ["cell_options", "file_of", "force_option", "json_option", "read_with"]

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
