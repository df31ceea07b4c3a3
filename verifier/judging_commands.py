"""The commands that judge motion: demo, verify, replay, simulate."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import click

from robots.errors import SetupError
from verifier.cell import Cell
from verifier.command_options import (
    ChosenCell,
    force_option,
    json_option,
    read_with,
    stated_offset,
    time_offset_option,
    with_cell,
)
from verifier.comparison import NOTES as COMPARED_NOTES
from verifier.comparison import compare as compare_beliefs
from verifier.comparison import table, waived_lines
from verifier.judged_recording import write_judged
from verifier.opened import open_placed
from verifier.output import print_lines, progress, write_bytes, write_json
from verifier.recordings.foxglove_scene import require_foxglove
from verifier.recordings.spool import Spool, new_spool
from verifier.replay import verify as verify_recording
from verifier.reports.html.verification import verification_page
from verifier.reports.picture import kind_of, require_drawing, verdict_picture
from verifier.reports.supervised import supervised_table
from verifier.reports.text import DISCLAIMER
from verifier.reports.verification import VerifyReport
from verifier.scene_recorder import SceneRecorder
from verifier.simulation import DEFAULT_S, SimulationSettings, simulate
from verifier.supervised import supervise, supervise_beliefs
from verifier.targets import Targets, check_targets, require_page
from verifier.tracking_note import tracking_notes


@click.command()
@click.option(
    "--out", "folder", default="out", show_default=True, help="Folder for JSON, picture and report."
)
@force_option
def demo(folder: str, force: bool) -> int:
    """Verify the bundled recording: a synthetic UR5 beside a synthetic worker."""
    data = Path(__file__).resolve().parent.parent / "data"
    recording, cell_path = data / "demo.mcap", data / "demo.toml"
    for path in (recording, cell_path):
        if not path.is_file():
            raise SetupError(f"{path}: the bundled recording is not here; run the demo from a checkout")
    out = Path(folder)
    if not folder or (out.exists() and not out.is_dir()):
        raise SetupError(f"--out {folder!r}: is not a folder; name one, it is made where it is missing")
    out.mkdir(parents=True, exist_ok=True)
    table, picture, page = (str(out / f"demo.{kind}") for kind in ("json", "png", "html"))
    targets = check_targets([("--out", path) for path in (table, picture, page)], [], force=force)
    require_drawing(("--out", picture))
    report = _verified(recording, Cell.from_toml(cell_path))
    write_json(report.to_dict(), table, force=force)
    write_bytes(verdict_picture(report, kind_of(picture)), picture, force=force)
    write_bytes(verification_page(report), page, force=force)
    print_lines(["synthetic recording, made by examples/make_demo_recording.py", *report.lines()])
    print_lines(targets.written)
    return 0


@click.command()
@click.argument("recording")
@with_cell
@time_offset_option
@click.option("--assume-nobody", is_flag=True, help="Waive the check against people.")
@click.option("--picture", metavar="F.png", help="Draw the verdict over time.")
@click.option("--report", "page", metavar="F.html", help="Write a page with all that was found.")
@click.option("--out", metavar="F.mcap", help="Copy the recording, with verdicts and a scene for Foxglove.")
@click.option("--compare", is_flag=True, help="Judge under every model of every profile, one row each.")
@json_option
@force_option
def verify(
    recording: str,
    chosen: ChosenCell,
    time_offset: str | None,
    assume_nobody: bool,
    picture: str | None,
    page: str | None,
    out: str | None,
    compare: bool,
    json_path: str | None,
    force: bool,
) -> int:
    """Judge every cycle of RECORDING: could the robot have stopped before anyone could have reached it?

    Exit status: 0 every cycle that was checked is verified; 1 one is not, or is contradicted, or none was
    checked; 3 verified under waivers. With --compare: of the cell as it is.
    """
    outputs = [("--json", json_path), ("--picture", picture), ("--report", page), ("--out", out)]
    cell = chosen.cell.with_options(time_offset=stated_offset(time_offset))
    inputs = [("recording", recording), *chosen.files]
    targets = check_targets(outputs, inputs, force=force)
    if compare:
        alone = {"--picture": picture, "--report": page, "--out": out}
        alone["--assume-nobody"] = "given" if assume_nobody else None
        for option, value in alone.items():
            if value is not None:
                raise SetupError(f"--compare: {option} is about one run; leave one of them away")
        return _compare(recording, cell, targets, json_path, force=force)
    require_drawing(("--picture", picture))
    require_page(("--report", page))
    with _drawn(cell, out) as (onlooker, spool):
        report = _verified(recording, cell, assume_nobody=assume_nobody, onlooker=onlooker)
        if out is not None and spool is not None:
            with progress(f"writing {Path(out).name}") as told:
                margin_m = cell.check.margin_m
                write_judged(recording, out, report, spool, margin_m, force=force, progress=told)
    if json_path is not None:
        write_json(report.to_dict(), json_path, force=force)
    if picture is not None:
        write_bytes(verdict_picture(report, kind_of(picture)), picture, force=force)
    if page is not None:
        write_bytes(verification_page(report), page, force=force)
    if json_path != "-":
        print_lines([*report.lines(), *targets.written])
    return report.exit_status


def _compare(recording: str, cell: Cell, targets: Targets, json_path: str | None, *, force: bool) -> int:
    """Print one row for each belief about people; the exit status is that of the cell as it is."""
    with progress("verifying under every model of every profile") as tell:
        rows = compare_beliefs(recording, cell, progress=tell)
    if json_path is not None:
        write_json([row.to_dict() for row in rows], json_path, force=force)
    if json_path != "-":
        print_lines([*table(rows), "", *waived_lines(rows), *COMPARED_NOTES, DISCLAIMER, *targets.written])
    return rows[0].exit_status


@click.command()
@click.argument("recording")
@with_cell
@time_offset_option
@click.option("--supervised", is_flag=True, help="Let the supervisor follow the recorded motion.")
@click.option("--compare", is_flag=True, help="Under every model of every profile, one row each.")
@json_option
@force_option
def replay(
    recording: str,
    chosen: ChosenCell,
    time_offset: str | None,
    supervised: bool,
    compare: bool,
    json_path: str | None,
    force: bool,
) -> int:
    """Let the supervisor follow the motion of RECORDING beside its people: stops, time lost, contacts.

    Exit status: 1 after a contact with a moving link, where an assumption is contradicted, or if no plan was
    ever adopted; 3 under waivers; else 0, however often the robot stopped. With --compare: of the first row.
    """
    if not supervised:
        raise SetupError("replay: give --supervised; to judge the recorded motion as it is: stopproof verify")
    cell = chosen.cell.with_options(time_offset=stated_offset(time_offset))
    inputs = [("recording", recording), *chosen.files]
    targets = check_targets([("--json", json_path)], inputs, force=force)
    with progress("replaying (the first run on a machine compiles once)") as told:
        reports = (
            supervise_beliefs(recording, cell, told)
            if compare
            else [supervise(recording, cell, progress=told)]
        )
    if json_path is not None:
        found = [report.to_dict() for report in reports]
        write_json(found if compare else found[0], json_path, force=force)
    if json_path != "-":
        lines = supervised_table(reports) if compare else reports[0].lines()
        print_lines([*lines, *targets.written])
    return reports[0].exit_status


@click.command("simulate")
@click.argument("cell_path", metavar="CELL.toml")
@click.option("--seconds", type=float, metavar="S", help="How long to simulate.  [default: 60]")
@click.option("--cycles", type=int, metavar="N", help="How many cycles, in place of --seconds.")
@click.option("--seed", type=int, default=0, show_default=True, help="Same seed, same result.")
@click.option("--people", type=int, default=1, show_default=True, help="How many there are, 0 to 8.")
@click.option(
    "--faster", type=float, default=1.0, show_default=True, help="Times as fast as the profile allows."
)
@click.option("--report-rate", type=float, default=30.0, show_default=True, help="Reports a second [Hz].")
@click.option(
    "--dropped", type=float, default=0.02, show_default=True, help="Share of reports that are lost."
)
@click.option(
    "--lost",
    type=float,
    default=0.0,
    show_default=True,
    help="Share of commands that the robot does not get.",
)
@json_option
@force_option
def simulate_(
    cell_path: str,
    seconds: float | None,
    cycles: int | None,
    seed: int,
    people: int,
    faster: float,
    report_rate: float,
    dropped: float,
    lost: float,
    json_path: str | None,
    force: bool,
) -> int:
    """Let the supervisor of CELL.toml run beside scripted people who obey the profile and go for the arm.

    Exit status: 1 after a contact with a moving link, an exceeded limit, a contradicted assumption, if the
    robot never moved or had to give up, or if nobody mattered to it; 3 under waivers; else 0.
    """
    cell = Cell.from_toml(cell_path)
    targets = check_targets([("--json", json_path)], [("cell", cell_path), *read_with(cell)], force=force)
    settings = SimulationSettings(
        seconds=_how_long(cell, seconds, cycles),
        seed=seed,
        people=people,
        faster=faster,
        rate_hz=report_rate,
        dropped=dropped,
        lost=lost,
    )
    with progress("simulating (the first run on a machine compiles once)") as told:
        report = simulate(cell, settings, progress=told)
    if json_path is not None:
        write_json(report.to_dict(), json_path, force=force)
    if json_path != "-":
        print_lines([*report.lines(), *targets.written])
    return report.exit_status


def _how_long(cell: Cell, seconds: float | None, cycles: int | None) -> float:
    """Return the time to simulate [s]."""
    if cycles is None:
        return DEFAULT_S if seconds is None else seconds
    if seconds is not None:
        raise SetupError("--cycles and --seconds both say how long; give one of them")
    if cycles < 1:
        raise SetupError(f"--cycles {cycles}: should be at least 1")
    return cycles * cell.cycle_s


@contextmanager
def _drawn(cell: Cell, out: str | None) -> Iterator[tuple[SceneRecorder | None, Spool | None]]:
    """What draws the scenes that ``--out`` asks for, and where they wait for it; nothing without it."""
    if out is None:
        yield None, None
        return
    require_foxglove()
    with new_spool(out) as spool:
        yield SceneRecorder(cell, spool), spool


def _verified(
    recording: str | Path, cell: Cell, *, assume_nobody: bool = False, onlooker: SceneRecorder | None = None
) -> VerifyReport:
    source, cell = open_placed(recording, cell, assume_nobody=assume_nobody)
    with progress("verifying (the first run on a machine compiles once)") as told:
        report = verify_recording(source, cell, assume_nobody=assume_nobody, progress=told, onlooker=onlooker)
    notes = tracking_notes(source, cell, report.assumptions)
    return replace(report, notes=(*report.notes, *notes))
