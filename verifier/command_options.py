"""Options that several commands take, and the cell and the files that a choice of them brings along."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import click

from robots.errors import SetupError
from verifier.cell import Cell
from verifier.inputs import file_of, read_with
from verifier.recordings.clock_offset import read_time_offset
from verifier.targets import Named

__all__ = [
    "ChosenCell",
    "cell_options",
    "file_of",
    "force_option",
    "json_option",
    "package_dir_option",
    "read_with",
    "stated_offset",
    "time_offset_option",
    "topic_options",
    "with_cell",
]

_Command = Callable[..., Any]

force_option = click.option("--force", is_flag=True, help="Overwrite files that exist.")
json_option = click.option(
    "--json", "json_path", metavar="F", help="Write the result as JSON; - for standard output."
)


@dataclass(frozen=True, slots=True)
class ChosenCell:
    """The cell that the options of :func:`cell_options` choose, and the files that it is read from.

    Attributes
    ----------
    cell:
        The cell, with what the options say.
    files:
        What they are, and their paths.
    """

    cell: Cell
    files: tuple[Named, ...]


package_dir_option = click.option(
    "--package-dir",
    "package_dirs",
    multiple=True,
    metavar="DIR",
    help="Where package:// meshes of the URDF are looked for; repeatable.",
)
"""Folders for a URDF, as ``robot.package_dirs`` of a cell."""

time_offset_option = click.option(
    "--time-offset",
    metavar="S±ERR",
    help="Added to the stamps of people, and its error [s]; +- stands for ±.",
)
"""On which clock people are stamped."""


def latency_option(name: str, what: str) -> _Command:
    """Return the option that bounds how long the quickest messages took."""
    return click.option(
        name,
        nargs=2,
        type=float,
        metavar="LEAST MOST",
        help=f"What the quickest of the {what} took to be recorded [s].",
    )


def stated_offset(text: str | None) -> tuple[float, float] | None:
    """Read ``--time-offset`` of commands that judge.

    Raises
    ------
    SetupError
        It is none, or states no error.
    """
    if text is None:
        return None
    offset_s, error_s = read_time_offset(text)
    if error_s is None:
        raise SetupError(
            f"--time-offset {text}: states no error; {text}±ERR, in s, says how well it is known"
        )
    return offset_s, error_s


TOPIC_OPTIONS = (
    click.option("--joints-topic", metavar="T", help="Topic of the recording with the arm's joints."),
    click.option("--people-topic", metavar="T", help="Topic of the recording with the people."),
    click.option("--joint-prefix", metavar="P", help="What stands before the arm's joint names in it."),
)
"""Which topics and joints of a recording are meant, where that is not plain."""


def topic_options(command: _Command) -> _Command:
    """Options about the topics of a recording."""
    for option in reversed(TOPIC_OPTIONS):
        command = option(command)
    return command


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
        *TOPIC_OPTIONS,
    )
    for option in reversed(options):
        command = option(command)
    return command


def with_cell(command: _Command) -> _Command:
    """Give a command the options of :func:`cell_options`, and the cell that they choose as ``chosen``."""

    @functools.wraps(command)
    def read_first(
        cell_path: str | None,
        robot: str | None,
        tool: str | None,
        bare_flange: bool,
        models: Sequence[str],
        profile: str | None,
        stop_model: str | None,
        joints_topic: str | None,
        people_topic: str | None,
        joint_prefix: str | None,
        **others: Any,
    ) -> Any:
        cell = Cell() if cell_path is None else Cell.from_toml(cell_path)
        cell = cell.with_options(
            robot=robot,
            tool=tool,
            bare_flange=bare_flange,
            models=models,
            profile=profile,
            stop_model=stop_model,
            topics={
                "joints_topic": joints_topic,
                "people_topic": people_topic,
                "joint_prefix": joint_prefix,
            },
        )
        return command(chosen=ChosenCell(cell, (("cell", cell_path), *read_with(cell))), **others)

    return cell_options(read_first)
