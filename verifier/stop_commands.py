"""The commands about real stops: stops."""

from __future__ import annotations

import json
from collections.abc import Sequence

import click

from robots.errors import SetupError
from verifier.cell import Cell
from verifier.command_options import force_option, json_option, read_with
from verifier.output import print_lines, progress, write_bytes, write_json
from verifier.reports.stops import MEASURED_DISCLAIMER, stops_json, stops_lines
from verifier.stops.fit import MARGIN, fit
from verifier.stops.model_file import model_text
from verifier.stops.recorded import StopSettings, stops_of_recordings
from verifier.stops.speeds import STANDSTILL_RAD_S
from verifier.targets import check_targets


@click.command()
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...")
@click.option("--cell", "cell_path", metavar="CELL.toml", help="Cell file: its [robot] is what was recorded.")
@click.option("--robot", metavar="NAME|URDF", help="Arm of the catalogue, or the path of a URDF.")
@click.option("--tool", metavar="FILE", help="Tool file (TOML): its farthest point is measured.")
@click.option("--run", type=int, help="Which run of an NPZ that numbers them.")
@click.option(
    "--standstill",
    type=float,
    default=STANDSTILL_RAD_S,
    show_default=True,
    metavar="RAD_S",
    help="A joint below this speed stands still [rad/s, m/s].",
)
@click.option("--ends-of-motion", is_flag=True, help="Measure also where nothing recorded says why it rests.")
@click.option("--fit", "fitting", is_flag=True, help="Fit a stop model, hold every second stop against it.")
@click.option("--model", metavar="F.toml", help="Fit it, and write it for [stop] of a cell.")
@click.option("--margin", type=float, help=f"Share added to every time of it.  [default: {MARGIN:g}]")
@json_option
@force_option
def stops(
    recordings: Sequence[str],
    cell_path: str | None,
    robot: str | None,
    tool: str | None,
    run: int | None,
    standstill: float,
    ends_of_motion: bool,
    fitting: bool,
    model: str | None,
    margin: float | None,
    json_path: str | None,
    force: bool,
) -> int:
    """Find and measure real stops in RECORDINGs of one arm (MCAP, CSV, NPZ).

    Exit status: 1 if a stop that was held out exceeds the fitted model, or recordings differ; else 0.
    """
    if margin is not None and not (fitting or model is not None):
        raise SetupError("--margin: belongs to a model; give --fit or --model too")
    if model is not None and not model.endswith(".toml"):
        raise SetupError(f"--model {model}: must end in .toml")
    settings = StopSettings(standstill, ends_of_motion, run)
    cell = Cell() if cell_path is None else Cell.from_toml(cell_path)
    cell = cell.with_options(robot=robot, tool=tool)
    inputs = [("recording", path) for path in recordings]
    targets = check_targets(
        [("--json", json_path), ("--model", model)],
        [*inputs, ("cell", cell_path), *read_with(cell)],
        force=force,
    )
    with progress("looking for stops") as told:
        found = stops_of_recordings(recordings, cell, settings, told)
        fitted = fit(found, MARGIN if margin is None else margin) if fitting or model is not None else None
    if json_path is not None:
        write_json(stops_json(found, fitted), json_path, force=force)
    if model is not None and fitted is not None:
        write_bytes(model_text(found, fitted).encode(), model, force=force)
    if json_path != "-":
        use = (
            [] if model is None else [f'in a cell: [stop] model = "measured", measured = {json.dumps(model)}']
        )
        print_lines([*stops_lines(found, fitted), *targets.written, *use, MEASURED_DISCLAIMER])
    return 1 if fitted is not None and fitted.in_doubt else 0
