"""The command about worst-case stops: stop-report."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import click

from robots.errors import SetupError
from verifier.command_options import ChosenCell, force_option, json_option, with_cell
from verifier.opened import open_placed
from verifier.output import print_lines, progress, write_bytes, write_json
from verifier.reports.html.stop_report import stop_report_page
from verifier.reports.stop_report import report_lines
from verifier.stop_report import StopReportSettings, stop_report
from verifier.stop_report.as_json import report_dict
from verifier.stop_report.settings import DEFAULT_DEADLINE_S, Work
from verifier.targets import check_targets, require_page


@click.command("stop-report")
@with_cell
@click.option("--recording", metavar="R", help="Look for the worst stop of its motion too.")
@click.option("--payload", type=float, metavar="KG", help="Tool and workpiece.  [default: the rated payload]")
@click.option(
    "--payload-at", type=float, nargs=3, metavar="X Y Z", help="Their centre of mass, in the flange [m]."
)
@click.option("--payload-frame", metavar="LINK", help="Link that they hang on, in place of the flange.")
@click.option("--speed", type=float, default=1.0, show_default=True, help="100 %, as share of the limits.")
@click.option("--brake-torque", metavar="N_M,...", help="Of each joint's brake, or one for all [N m; N].")
@click.option("--brake-delay", type=float, metavar="S", help="From loss of power until brakes hold [s].")
@click.option("--resolution", type=float, metavar="M", help="Of a field that is reached through: d [m].")
@click.option("--field-height", type=float, metavar="M", help="Of a field along the floor: H [m].")
@click.option(
    "--deadline",
    type=float,
    default=DEFAULT_DEADLINE_S,
    show_default=True,
    help="Longest time of a search [s].",
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of states looked at from below.")
@click.option("--out", required=True, metavar="F.html", help="The page to write.")
@json_option
@force_option
def stop_report_(
    chosen: ChosenCell,
    recording: str | None,
    payload: float | None,
    payload_at: tuple[float, float, float] | None,
    payload_frame: str | None,
    speed: float,
    brake_torque: str | None,
    brake_delay: float | None,
    resolution: float | None,
    field_height: float | None,
    deadline: float,
    seed: int,
    out: str,
    json_path: str | None,
    force: bool,
) -> int:
    """Write a page with worst-case stops of an arm: time, angle of each axis, way, required distances.

    Ctrl-C ends the work and writes what has been reached by then; a second one ends it without.

    Exit status: 0 nothing is waived; 1 ended before everything was looked at; 3 under waivers.
    """
    settings = StopReportSettings(
        payload_kg=payload,
        payload_at_m=payload_at,
        payload_frame=payload_frame,
        speed=speed,
        brake_torque=None if brake_torque is None else _numbers("--brake-torque", brake_torque),
        brake_delay_s=brake_delay,
        resolution_m=resolution,
        height_m=field_height,
        deadline_s=deadline,
        seed=seed,
    )
    require_page(("--out", out))
    inputs = [("recording", recording), *chosen.files]
    targets = check_targets([("--out", out), ("--json", json_path)], inputs, force=force)
    source, cell = None, chosen.cell
    if recording is not None:
        source, cell = open_placed(recording, cell)
    with (
        progress("searching (the first run on a machine compiles once)") as told,
        ended_by_interrupt() as should_end,
    ):
        report = stop_report(cell, source, settings, Work(time.perf_counter, should_end, told))
    page = stop_report_page(report)
    if json_path is not None:
        write_json(report_dict(report), json_path, force=force)
    write_bytes(page, out, force=force)
    if json_path != "-":
        print_lines([*report_lines(report), *targets.written])
    return report.exit_status


def _numbers(option: str, text: str) -> tuple[float, ...]:
    try:
        return tuple(float(each) for each in text.split(","))
    except ValueError:
        raise SetupError(f"{option} {text!r}: should be numbers with commas between them") from None


@contextmanager
def ended_by_interrupt() -> Iterator[_Flag]:
    """Let the first Ctrl-C end the work with what has been reached, and the second one end the program.

    Where whoever started the program has it ignore Ctrl-C, as ``nohup`` does, it goes on to do so.
    """
    flag = _Flag()
    before = signal.getsignal(signal.SIGINT)
    if not callable(before):
        yield flag
        return

    def interrupted(number: int, frame: FrameType | None) -> None:
        if flag.raised:
            before(number, frame)
        flag.raised = True

    signal.signal(signal.SIGINT, interrupted)
    try:
        yield flag
    finally:
        signal.signal(signal.SIGINT, before)


class _Flag:
    """Whether somebody wants the work to end."""

    def __init__(self) -> None:
        self.raised = False

    def __call__(self) -> bool:
        return self.raised
