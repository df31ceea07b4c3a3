"""The command line; the only place that prints.

Exit status: 0 all verified and nothing waived · 1 something not verified or contradicted · 2 input refused,
one line · 3 verified under waivers, which are listed · 70 internal error.
"""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import click

from robots.catalog import describe_card, joint_names, robot_names
from robots.errors import SetupError
from robots.identity import stated_hash
from verifier.cell import Cell
from verifier.cell_template import BLANK, template
from verifier.recordings import Recording, new_file
from verifier.recordings.importing import ImportSettings, import_recording
from verifier.recordings.inspection import inspect_recording
from verifier.recordings.people_source import PeopleFile, Place
from verifier.recordings.recording_writer import copy_with_verdicts
from verifier.replay import verify as verify_recording
from verifier.reports.picture import verdict_picture
from verifier.reports.verification import VerifyReport

INPUT_REFUSED = 2
INTERNAL_ERROR = 70
INTERRUPTED = 130
"""128 + SIGINT, as shells have it."""

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


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="stopproof", prog_name="stopproof")
def cli() -> None:
    """Show, before a robot arm moves, that it can still stop in time: in the model, under assumptions."""


@cli.command()
@click.option("--out", "folder", default="out", show_default=True, help="Folder for JSON and picture.")
@force_option
def demo(folder: str, force: bool) -> int:
    """Verify the bundled recording: a synthetic UR5 beside a synthetic worker."""
    data = Path(__file__).resolve().parent.parent / "data"
    recording, cell_path = data / "demo.mcap", data / "demo.toml"
    for path in (recording, cell_path):
        if not path.is_file():
            raise SetupError(f"{path}: the bundled recording is not here; run the demo from a checkout")
    report = _verified(recording, Cell.from_toml(cell_path))
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    picture = verdict_picture(report)
    _write_json(report.to_dict(), str(out / "demo.json"), force=force)
    _write_bytes(picture, out / "demo.png", force=force)
    _print_lines(["synthetic recording, made by examples/make_demo_recording.py", *report.lines()])
    _print_lines(_written([str(out / "demo.json"), str(out / "demo.png")]))
    return 0


@cli.command()
@click.argument("recording")
@cell_options
@click.option("--assume-nobody", is_flag=True, help="Waive the check against people.")
@click.option("--picture", metavar="F.png", help="Draw the verdict over time.")
@click.option("--out", metavar="F.mcap", help="Copy the recording and add the topic /verdict.")
@json_option
@force_option
def verify(
    recording: str,
    assume_nobody: bool,
    picture: str | None,
    out: str | None,
    json_path: str | None,
    force: bool,
    **chosen: Any,
) -> int:
    """Judge every cycle of RECORDING: could the robot have stopped before anyone could have reached it?"""
    if out is not None and Path(out).resolve() == Path(recording).resolve():
        raise SetupError(f"--out {out}: is the recording itself; name another file")
    outputs = [path for path in (json_path, picture, out) if path is not None and path != "-"]
    _refuse_existing(outputs, force=force)
    report = _verified(recording, _cell(**chosen), assume_nobody=assume_nobody)
    if json_path is not None:
        _write_json(report.to_dict(), json_path, force=force)
    if picture is not None:
        _write_bytes(verdict_picture(report), Path(picture), force=force)
    if out is not None:
        copy_with_verdicts(Recording(recording), out, report.verdicts(), force=force)
    if json_path != "-":
        _print_lines([*report.lines(), *_written(outputs)])
    return report.exit_status


@cli.command()
@click.argument("recording")
@json_option
@force_option
def inspect(recording: str, json_path: str | None, force: bool) -> int:
    """Show what RECORDING holds: topics, rates, gaps, names, clocks, and which robot it may be."""
    found = inspect_recording(recording)
    if json_path is not None:
        _write_json(found.to_dict(), json_path, force=force)
    if json_path != "-":
        _print_lines(found.lines())
    return 0


@cli.command()
@click.argument("recording", required=False)
@click.option("--robot", metavar="NAME", help="Arm of the catalogue, in place of a recording.")
@click.option("--out", metavar="CELL.toml", help="Write the file instead of printing it.")
@force_option
def init(recording: str | None, robot: str | None, out: str | None, force: bool) -> int:
    """Print a commented cell file for RECORDING or --robot; what must be filled in is marked."""
    if (recording is None) == (robot is None):
        raise SetupError("init: give either a RECORDING or --robot NAME")
    if robot is not None and robot not in robot_names():
        raise SetupError(f"--robot {robot}: not in the catalogue; known: {', '.join(robot_names())}")
    if recording is None:
        text = template(robot)
    else:
        found = inspect_recording(recording)
        guess = found.robot_guess
        known = guess in robot_names() or stated_hash(guess) is not None
        text = template(guess if known else None, found.foreign_frames)
    if out is None:
        _print_lines([text.rstrip("\n")])
    else:
        _write_bytes(text.encode(), Path(out), force=force)
        _print_lines([f"wrote {out}: fill in every {BLANK}"])
    return 0


@cli.command("import")
@click.argument("out")
@click.option("--robot", required=True, metavar="NAME|URDF", help="Arm that was recorded.")
@click.option("--joints", required=True, metavar="FILE", help="NPZ, CSV or MCAP with joint positions.")
@click.option("--run", type=int, help="Which run of a file that numbers them.")
@click.option("--people", "people", multiple=True, metavar="FILE", help="NPZ, CSV or MCAP; repeatable.")
@click.option(
    "--place",
    "places",
    multiple=True,
    nargs=4,
    type=float,
    metavar="X Y Z YAW",
    help="People's frame in the robot base [m, m, m, deg]; repeatable, paired with --people in order.",
)
@click.option("--position-error", type=float, metavar="M", help="Of the points, where the file states none.")
@click.option("--time-offset", type=float, metavar="S", help="How much later the people start.")
@force_option
def import_(
    out: str,
    robot: str,
    joints: str,
    run: int | None,
    people: Sequence[str],
    places: Sequence[tuple[float, float, float, float]],
    position_error: float | None,
    time_offset: float | None,
    force: bool,
) -> int:
    """Combine joint motion and people into the recording OUT (MCAP)."""
    if places and len(places) != len(people):
        raise SetupError(f"--place is given {len(places)} times, --people {len(people)} times: pair them")
    files = [PeopleFile(Path(path), Place(*places[i]) if places else None) for i, path in enumerate(people)]
    name, robot_joints = joint_names(robot)
    summary = import_recording(
        out,
        joints,
        files,
        ImportSettings(
            robot=name,
            robot_joints=robot_joints,
            run=run,
            position_error_m=position_error,
            time_offset_s=time_offset,
        ),
        force=force,
    )
    _print_lines(summary.lines())
    return 0


@cli.command()
@click.argument("name", required=False)
@json_option
@force_option
def robots(name: str | None, json_path: str | None, force: bool) -> int:
    """List the arms of the catalogue, or print the model card of one."""
    if name is None:
        _print_lines(robot_names())
        return 0
    card = describe_card(name)
    if json_path is not None:
        _write_json(card.to_dict(), json_path, force=force)
    if json_path != "-":
        _print_lines(card.lines())
    return 0


def _cell(
    *,
    cell_path: str | None = None,
    robot: str | None = None,
    tool: str | None = None,
    bare_flange: bool = False,
    models: Sequence[str] = (),
    profile: str | None = None,
    stop_model: str | None = None,
) -> Cell:
    """Read the cell and let the options of the command line speak where it is silent."""
    cell = Cell() if cell_path is None else Cell.from_toml(cell_path)
    return cell.with_options(
        robot=robot, tool=tool, bare_flange=bare_flange, models=models, profile=profile, stop_model=stop_model
    )


def _verified(recording: str | Path, cell: Cell, *, assume_nobody: bool = False) -> VerifyReport:
    source = Recording(recording)
    with _progress("verifying (the first run on a machine compiles once)") as progress:
        return verify_recording(source, cell, assume_nobody=assume_nobody, progress=progress)


@contextmanager
def _progress(text: str) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on a terminal, nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda _share: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def _written(paths: Sequence[str]) -> list[str]:
    return [f"wrote {' and '.join(paths)}"] if paths else []


def _refuse_existing(paths: Sequence[str], *, force: bool) -> None:
    """Refuse before long work what could not be written after it."""
    for path in paths:
        if Path(path).exists() and not force:
            raise SetupError(f"{path}: exists already; choose another name, or overwrite it with --force")


def _write_json(value: dict[str, Any], path: str, *, force: bool) -> None:
    """Write piece by piece: the text of an hour's recording need not stand in memory."""
    if path == "-":
        with _reader_may_stop():
            json.dump(value, sys.stdout, indent=1, allow_nan=False)
            sys.stdout.write("\n")
            sys.stdout.flush()
        return
    with new_file(Path(path), force=force) as stream:
        text = io.TextIOWrapper(stream, encoding="utf-8", write_through=True)
        json.dump(value, text, indent=1, allow_nan=False)
        text.write("\n")
        text.detach()


def _write_bytes(data: bytes, path: Path, *, force: bool) -> None:
    with new_file(path, force=force) as stream:
        stream.write(data)


def _print_lines(lines: Sequence[str]) -> None:
    with _reader_may_stop():
        for line in lines:
            print(line)
        sys.stdout.flush()


@contextmanager
def _reader_may_stop() -> Iterator[None]:
    """Whoever reads may stop reading (``| head``): the exit status stays that of the result."""
    try:
        yield
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> NoReturn:
    """Run the command line and exit with its status; bad input never shows a traceback."""
    try:
        status = cli.main(prog_name="stopproof", standalone_mode=False)
    except click.exceptions.Abort:
        _fail("stopped by the user", INTERRUPTED)
    except click.ClickException as error:
        _fail(error.format_message(), INPUT_REFUSED)
    except SetupError as error:
        _fail(str(error), INPUT_REFUSED)
    except Exception as error:
        _fail(f"internal error: {type(error).__name__}: {error}", INTERNAL_ERROR)
    sys.exit(status if isinstance(status, int) else 0)


def _fail(text: str, status: int) -> NoReturn:
    print(f"stopproof: {' '.join(text.split())}", file=sys.stderr)
    sys.exit(status)


if __name__ == "__main__":
    main()
