"""The command line: its commands together, and how they are run."""

from __future__ import annotations

from collections.abc import Sequence

import click

from robots.catalog import describe_card, robot_names
from robots.errors import SetupError
from verifier.command_options import file_of, force_option, json_option
from verifier.diff_command import diff
from verifier.judging_commands import demo, replay, simulate_, verify
from verifier.limits_command import limits
from verifier.output import print_lines, write_json
from verifier.recording_commands import conformance, import_, init, inspect
from verifier.stop_commands import stops
from verifier.stop_report_command import stop_report_
from verifier.targets import check_targets

NO_COMMAND = 2
"""A script that forgot the command must not read that everything is verified."""

_HELP = ("-h", "--help")
_ABOUT_ITSELF = frozenset((*_HELP, "--version"))


@click.group(
    context_settings={"help_option_names": _HELP, "max_content_width": 100}, invoke_without_command=True
)
@click.version_option(package_name="stopproof", prog_name="stopproof")
@click.pass_context
def cli(context: click.Context) -> int:
    """Show, before a robot arm moves, that it can still stop in time: in the model, under assumptions."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help(), err=True)
    return NO_COMMAND


@cli.command()
@click.argument("name", required=False)
@json_option
@force_option
def robots(name: str | None, json_path: str | None, force: bool) -> int:
    """List the arms of the catalogue, or print the model card of one."""
    check_targets([("--json", json_path)], [("URDF", file_of(name))], force=force)
    value: object
    if name is None:
        value = lines = list(robot_names())
    else:
        card = describe_card(name)
        value, lines = card.to_dict(), card.lines()
    if json_path is not None:
        write_json(value, json_path, force=force)
    if json_path != "-":
        print_lines(lines)
    return 0


_COMMANDS = (
    demo,
    verify,
    limits,
    replay,
    simulate_,
    inspect,
    init,
    import_,
    conformance,
    diff,
    stops,
    stop_report_,
)
for _command in _COMMANDS:
    cli.add_command(_command)


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
