"""The command ``robots``: the catalogue of arms and their model cards."""

from __future__ import annotations

import click

from robots.card import incomplete_card
from robots.catalog import describe_card, fitted_parts, joint_names, robot_names
from robots.files import printed
from robots.limits import MissingLimits
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
        try:
            card = describe_card(name)
            value, lines = card.to_dict(), card.lines()
        except MissingLimits as missing:
            if json_path is not None:
                raise
            joints, parts = joint_names(name)[1], fitted_parts(name)
            value, lines = None, incomplete_card(printed(name), joints, missing.gaps, parts)
    if json_path is not None:
        write_json(value, json_path, force=force)
    if json_path != "-":
        print_lines(lines)
    return 0
