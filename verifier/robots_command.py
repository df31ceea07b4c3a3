"""The command ``robots``: the catalogue of arms and their model cards."""

from __future__ import annotations

import click

from robots.catalog import describe_card, robot_names
from verifier.command_options import file_of, force_option, json_option
from verifier.output import print_lines, write_json
from verifier.targets import check_targets


@click.command()
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
