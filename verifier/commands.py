"""The command line: its commands together, and how they are run."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping, Sequence
from importlib import import_module
from typing import NamedTuple

import click

from robots.errors import SetupError

NO_COMMAND = 2
"""A script that forgot the command must not read that everything is verified."""

_HELP = ("-h", "--help")
_ABOUT_ITSELF = frozenset((*_HELP, "--version"))


class Place(NamedTuple):
    """Where a command is, and what the help of the program says of it."""

    module: str
    name: str
    summary: str


COMMANDS = {
    "conformance": Place(
        "recording_commands",
        "conformance",
        "Measure how models and profiles hold on recorded PEOPLE (NPZ, CSV, MCAP, BVH); status 0 either way.",
    ),
    "demo": Place(
        "judging_commands",
        "demo",
        "Verify the bundled recording: a synthetic UR5 beside a synthetic worker.",
    ),
    "diff": Place(
        "diff_command",
        "diff",
        "Say what changed between results of `verify --json`, or stop reports; each is held against A.",
    ),
    "import": Place(
        "recording_commands",
        "import_",
        "Combine joint motion and people into the recording OUT (MCAP).",
    ),
    "init": Place(
        "recording_commands",
        "init",
        "Print a commented cell file for RECORDING or --robot; what must be filled in is marked.",
    ),
    "inspect": Place(
        "recording_commands",
        "inspect",
        "Show what RECORDING holds: topics, rates, gaps, names, clocks, and which robot it may be.",
    ),
    "limits": Place(
        "limits_command",
        "limits",
        "Find the largest path speeds and latency, and the nearest line, that verify all of RECORDING.",
    ),
    "replay": Place(
        "judging_commands",
        "replay",
        "Let the supervisor follow the motion of RECORDING beside its people: stops, time lost, contacts.",
    ),
    "robots": Place(
        "robots_command",
        "robots",
        "List the arms of the catalogue, or print the model card of one.",
    ),
    "scenario": Place(
        "scenario_command",
        "scenario",
        "Run the experiments of a paper, its numbers beside ours; without NAME: list what there is.",
    ),
    "simulate": Place(
        "judging_commands",
        "simulate_",
        "Let the supervisor of CELL.toml run beside scripted people who obey the profile and go for the arm.",
    ),
    "stop-report": Place(
        "stop_report_command",
        "stop_report_",
        "Write a page with worst-case stops of an arm: time, angle of each axis, way, required distances.",
    ),
    "stops": Place(
        "stop_commands",
        "stops",
        "Find and measure real stops in RECORDINGs of one arm (MCAP, CSV, NPZ).",
    ),
    "verify": Place(
        "judging_commands",
        "verify",
        "Judge every cycle of RECORDING: could the robot have stopped before anyone could have reached it?",
    ),
}
"""Name -> where it is."""


class _OnDemand(MutableMapping[str, click.Command]):
    """Commands by name. The module of one is imported when it is asked for: all of them take seconds."""

    def __init__(self, places: dict[str, Place]) -> None:
        self._places = places
        self._imported: dict[str, click.Command] = {}

    def __getitem__(self, name: str) -> click.Command:
        if name not in self._imported:
            place = self._places[name]
            self[name] = getattr(import_module(f"verifier.{place.module}"), place.name)
        return self._imported[name]

    def __setitem__(self, name: str, command: click.Command) -> None:
        self._imported[name] = command

    def __delitem__(self, name: str) -> None:
        raise TypeError(f"{name}: commands are not taken away")

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


class _Program(click.Group):
    """A group whose help imports no command."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name].summary) for name in self.list_commands(ctx)])


@click.group(
    cls=_Program,
    context_settings={"help_option_names": _HELP, "max_content_width": 100},
    invoke_without_command=True,
)
@click.version_option(package_name="stopproof", prog_name="stopproof")
@click.pass_context
def cli(context: click.Context) -> int:
    """Show, before a robot arm moves, that it can still stop in time: in the model, under assumptions."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help(), err=True)
    return NO_COMMAND


cli.commands = _OnDemand(COMMANDS)


def run(arguments: Sequence[str]) -> int:
    """Run the command line and return its exit status.

    Raises
    ------
    SetupError
        The command line, or what it names, cannot be used.
    """
    try:
        with cli.make_context("stopproof", list(arguments)) as context:
            status = cli.invoke(context)
    except click.exceptions.Exit as stop:
        return stop.exit_code
    except click.ClickException as error:
        raise SetupError(error.format_message()) from error
    except BrokenPipeError:
        if not _ABOUT_ITSELF.intersection(arguments):
            raise
        return 0  # of the help; what commands print sees to it by itself
    if not isinstance(status, int):
        raise TypeError(f"the command returned {status!r}, not an exit status")
    return status
