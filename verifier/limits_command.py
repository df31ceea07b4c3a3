"""The command that answers how fast, how late and how near: limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import click

from verifier.barriers import Barrier
from verifier.command_options import ChosenCell, force_option, json_option, with_cell
from verifier.limits import ANSWERS, DEFAULT_DETECTION_S, LimitsSettings, find_limits
from verifier.opened import open_placed
from verifier.output import print_lines, progress, write_json
from verifier.targets import check_targets


@click.command()
@click.argument("recording")
@with_cell
@click.option("--only", multiple=True, metavar="ANSWER", help=f"Only {', '.join(ANSWERS)}; repeatable.")
@click.option("--from", "begin", type=float, default=0.0, metavar="S", help="First instant looked at [s].")
@click.option(
    "--to",
    "end",
    type=float,
    default=math.inf,
    metavar="S",
    help="Instant from which on nothing is looked at [s].",
)
@click.option(
    "--border", "borders", type=float, multiple=True, metavar="S", help="Begin of a segment [s]; repeatable."
)
@click.option("--fastest", type=float, default=2.0, show_default=True, help="Largest path speed tried.")
@click.option(
    "--latency-bound", type=float, default=0.5, show_default=True, help="Largest latency tried [s]."
)
@click.option(
    "--line",
    "angles",
    type=float,
    multiple=True,
    metavar="DEG",
    help="A line in place of a circle; repeatable.",
)
@click.option(
    "--barrier",
    type=click.Choice([str(each) for each in Barrier]),
    default=str(Barrier.SCANNER),
    show_default=True,
    help="What is at the circle or line.",
)
@click.option("--farthest", type=float, default=5.0, show_default=True, help="Largest distance tried [m].")
@click.option(
    "--detection-time",
    type=float,
    metavar="S",
    help=f"Of whoever watches the line [s].  [default: {DEFAULT_DETECTION_S:g}]",
)
@json_option
@force_option
def limits(
    recording: str,
    chosen: ChosenCell,
    only: Sequence[str],
    begin: float,
    end: float,
    borders: Sequence[float],
    fastest: float,
    latency_bound: float,
    angles: Sequence[float],
    barrier: str,
    farthest: float,
    detection_time: float | None,
    json_path: str | None,
    force: bool,
) -> int:
    """Find the largest path speeds and latency, and the nearest line, that verify all of RECORDING.

    Exit status: 0 every answer exists; 1 for one of them nothing that was tried is verified; 3 under waivers.
    """
    settings = LimitsSettings(
        answers=tuple(dict.fromkeys(only)) or ANSWERS,
        window_s=(begin, end),
        borders_s=tuple(borders),
        fastest=fastest,
        latency_bound_s=latency_bound,
        angles_deg=tuple(angles),
        barrier=Barrier(barrier),
        farthest_m=farthest,
        detection_time_s=detection_time,
    )
    inputs = [("recording", recording), *chosen.files]
    targets = check_targets([("--json", json_path)], inputs, force=force)
    source, cell = open_placed(recording, chosen.cell)
    with progress("trying (the first run on a machine compiles once)") as told:
        report = find_limits(source, cell, settings, progress=told)
    if json_path is not None:
        write_json(report.to_dict(), json_path, force=force)
    if json_path != "-":
        print_lines([*report.lines_of_text(), *targets.written])
    return report.exit_status
