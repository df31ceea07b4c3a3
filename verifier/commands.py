"""The commands and their options."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from occupancy.identification import MARGIN
from robots.catalog import describe_card, joint_names, robot_names
from robots.errors import SetupError
from robots.identity import stated_hash
from verifier.cell import Cell
from verifier.cell_template import BLANK, template
from verifier.comparison import NOTES as COMPARED_NOTES
from verifier.comparison import compare as compare_beliefs
from verifier.comparison import table, waived_lines
from verifier.conformance import (
    bundled_profiles,
    conform,
    identified,
    open_profile,
    open_profiles,
    open_recordings,
)
from verifier.output import print_file, print_lines, progress, write_bytes, write_json
from verifier.recordings import Recording
from verifier.recordings.importing import ImportSettings, import_recording
from verifier.recordings.inspection import inspect_recording
from verifier.recordings.people_source import PeopleFile, Place
from verifier.recordings.recording_writer import copy_with_verdicts
from verifier.replay import verify as verify_recording
from verifier.reports.conformance import conformance_lines, conformance_list, identified_lines
from verifier.reports.excess_picture import excess_picture
from verifier.reports.picture import kind_of, require_drawing, verdict_picture
from verifier.reports.sets_picture import sets_picture
from verifier.reports.supervised import supervised_table
from verifier.reports.text import DISCLAIMER
from verifier.reports.verification import VerifyReport
from verifier.simulation import DEFAULT_S, SimulationSettings, simulate
from verifier.snapshot import choose_moment, take_snapshot
from verifier.supervised import supervise, supervise_beliefs
from verifier.targets import Named, Targets, check_targets

NO_COMMAND = 2
"""A script that forgot the command must not read that everything is verified."""

_HELP = ("-h", "--help")
_ABOUT_ITSELF = frozenset((*_HELP, "--version"))
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
@click.option("--out", "folder", default="out", show_default=True, help="Folder for JSON and picture.")
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
    table, picture = str(out / "demo.json"), str(out / "demo.png")
    targets = check_targets([("--out", table), ("--out", picture)], [], force=force)
    require_drawing(("--out", picture))
    report = _verified(recording, Cell.from_toml(cell_path))
    write_json(report.to_dict(), table, force=force)
    write_bytes(verdict_picture(report, kind_of(picture)), picture, force=force)
    print_lines(["synthetic recording, made by examples/make_demo_recording.py", *report.lines()])
    print_lines(targets.written)
    return 0


@cli.command()
@click.argument("recording")
@cell_options
@click.option("--assume-nobody", is_flag=True, help="Waive the check against people.")
@click.option("--picture", metavar="F.png", help="Draw the verdict over time.")
@click.option("--out", metavar="F.mcap", help="Copy the recording and add the topic /verdict.")
@click.option("--compare", is_flag=True, help="Judge under every model of every profile, one row each.")
@json_option
@force_option
def verify(
    recording: str,
    cell_path: str | None,
    robot: str | None,
    tool: str | None,
    bare_flange: bool,
    models: Sequence[str],
    profile: str | None,
    stop_model: str | None,
    assume_nobody: bool,
    picture: str | None,
    out: str | None,
    compare: bool,
    json_path: str | None,
    force: bool,
) -> int:
    """Judge every cycle of RECORDING: could the robot have stopped before anyone could have reached it?

    Exit status: 0 every cycle that was checked is verified; 1 one is not, or is contradicted, or none was
    checked; 3 verified under waivers. With --compare: of the cell as it is.
    """
    outputs = [("--json", json_path), ("--picture", picture), ("--out", out)]
    inputs = [("recording", recording), ("cell", cell_path)]
    cell = Cell() if cell_path is None else Cell.from_toml(cell_path)
    cell = cell.with_options(
        robot=robot, tool=tool, bare_flange=bare_flange, models=models, profile=profile, stop_model=stop_model
    )
    targets = check_targets(outputs, [*inputs, *_read_with(cell)], force=force)
    if compare:
        alone = {"--picture": picture, "--out": out, "--assume-nobody": assume_nobody or None}
        for option, value in alone.items():
            if value is not None:
                raise SetupError(f"--compare: {option} is about one run; leave one of them away")
        return _compare(recording, cell, targets, json_path, force=force)
    require_drawing(("--picture", picture))
    report = _verified(recording, cell, assume_nobody=assume_nobody)
    if json_path is not None:
        write_json(report.to_dict(), json_path, force=force)
    if picture is not None:
        write_bytes(verdict_picture(report, kind_of(picture)), picture, force=force)
    if out is not None:
        copy_with_verdicts(Recording(recording), out, report.verdicts(), force=force)
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


@cli.command()
@click.argument("recording")
@cell_options
@click.option("--supervised", is_flag=True, help="Let the supervisor follow the recorded motion.")
@click.option("--compare", is_flag=True, help="Under every model of every profile, one row each.")
@json_option
@force_option
def replay(
    recording: str,
    cell_path: str | None,
    robot: str | None,
    tool: str | None,
    bare_flange: bool,
    models: Sequence[str],
    profile: str | None,
    stop_model: str | None,
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
    cell = Cell() if cell_path is None else Cell.from_toml(cell_path)
    cell = cell.with_options(
        robot=robot, tool=tool, bare_flange=bare_flange, models=models, profile=profile, stop_model=stop_model
    )
    inputs = [("recording", recording), ("cell", cell_path), *_read_with(cell)]
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


@cli.command("simulate")
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
    targets = check_targets([("--json", json_path)], [("cell", cell_path), *_read_with(cell)], force=force)
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


@cli.command()
@click.argument("recording")
@json_option
@force_option
def inspect(recording: str, json_path: str | None, force: bool) -> int:
    """Show what RECORDING holds: topics, rates, gaps, names, clocks, and which robot it may be."""
    check_targets([("--json", json_path)], [("recording", recording)], force=force)
    found = inspect_recording(recording)
    if json_path is not None:
        write_json(found.to_dict(), json_path, force=force)
    if json_path != "-":
        print_lines(found.lines())
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
    check_targets([("--out", out)], [("recording", recording)], force=force)
    if recording is None:
        text = template(robot)
    else:
        found = inspect_recording(recording)
        guess = found.robot_guess
        known = guess in robot_names() or stated_hash(guess) is not None
        text = template(guess if known else None, found.foreign_frames)
    if out is None:
        print_file(text)
    else:
        write_bytes(text.encode(), out, force=force)
        print_lines([f"wrote {out}: fill in every {BLANK}"])
    return 0


@cli.command("import")
@click.argument("out")
@click.option("--robot", required=True, metavar="NAME|URDF", help="Arm that was recorded.")
@click.option("--joints", required=True, metavar="FILE", help="NPZ, CSV or MCAP with joint positions.")
@click.option("--run", type=int, help="Which run of a file that numbers them.")
@click.option("--people", "people", multiple=True, metavar="FILE", help="NPZ, CSV, MCAP or BVH; repeatable.")
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
    inputs = [
        ("--joints file", joints),
        *(("--people file", path) for path in people),
        ("URDF", _file_of(robot)),
    ]
    check_targets([("OUT", out)], inputs, force=force)
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
    print_lines(summary.lines())
    return 0


@cli.command()
@click.argument("people", nargs=-1, required=True)
@click.option("--human", "models", multiple=True, metavar="MODEL", help="Model of people; repeatable.")
@click.option("--profile", "profiles", multiple=True, metavar="P", help="Name or .toml file; repeatable.")
@click.option("--position-error", type=float, metavar="M", help="Of the points, where the file states none.")
@click.option("--every", type=int, default=1, show_default=True, help="Take each N-th sample as last known.")
@click.option("--identify", metavar="NAME.toml", help="Write a profile that allows what the files show.")
@click.option("--margin", type=float, help=f"Factor on what is identified.  [default: {MARGIN:g}]")
@click.option("--picture", metavar="F.png", help="Draw the worst excess over the horizon.")
@click.option("--sets", metavar="F.png", help="Draw one frame with each model's sets at 100 and 200 ms.")
@click.option("--at", type=float, metavar="S", help="Frame of --sets; else that of the fastest hand.")
@click.option("--person", metavar="ID", help="Whom --sets shows; else who has the fastest hand.")
@json_option
@force_option
def conformance(
    people: Sequence[str],
    models: Sequence[str],
    profiles: Sequence[str],
    position_error: float | None,
    every: int,
    identify: str | None,
    margin: float | None,
    picture: str | None,
    sets: str | None,
    at: float | None,
    person: str | None,
    json_path: str | None,
    force: bool,
) -> int:
    """Measure how models and profiles hold on recorded PEOPLE (NPZ, CSV, MCAP, BVH); status 0 either way."""
    outputs = [("--identify", identify), ("--json", json_path), ("--picture", picture), ("--sets", sets)]
    inputs = [("file of people", path) for path in people] + [("profile", name) for name in profiles]
    targets = check_targets(outputs, inputs, force=force)
    require_drawing(("--picture", picture), ("--sets", sets))
    _check_one_frame(sets, at, person, len(people), len(profiles) + (identify is not None))
    if margin is not None and identify is None:
        raise SetupError("--margin: is a factor on what --identify finds; give --identify too")
    chosen = open_profiles(profiles, identify)
    files = open_recordings(people, chosen, position_error)
    moment = None if sets is None else choose_moment(files[0], at, person)
    lines: list[str] = []
    if identify is not None:
        text, numbers = identified(files, identify, MARGIN if margin is None else margin)
        write_bytes(text.encode(), identify, force=force)
        lines = identified_lines(identify, numbers)
        chosen.append(open_profile(identify))
    with progress("comparing (the first run on a machine compiles once)") as told:
        results = conform(files, chosen or bundled_profiles(), models, every=every, progress=told)
    if json_path is not None:
        write_json(conformance_list(results, every), json_path, force=force)
    if picture is not None:
        write_bytes(excess_picture(results, kind_of(picture)), picture, force=force)
    if sets is not None and moment is not None:
        shot = take_snapshot(files[0], chosen[0], models, moment)
        write_bytes(sets_picture(shot, kind_of(sets)), sets, force=force)
    if json_path != "-":
        print_lines([*conformance_lines(results, every), *lines, *targets.written, DISCLAIMER])
    return 0


@cli.command()
@click.argument("name", required=False)
@json_option
@force_option
def robots(name: str | None, json_path: str | None, force: bool) -> int:
    """List the arms of the catalogue, or print the model card of one."""
    check_targets([("--json", json_path)], [("URDF", _file_of(name))], force=force)
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


def _check_one_frame(
    sets: str | None, at: float | None, person: str | None, recordings: int, profiles: int
) -> None:
    """Refuse, before any work, options that do not go together with a picture of one frame."""
    if sets is None:
        for option, value in (("--at", at), ("--person", person)):
            if value is not None:
                raise SetupError(f"{option}: chooses what --sets draws; give --sets too")
        return
    if recordings != 1:
        raise SetupError(f"--sets: draws a frame of one recording, not of {recordings}; name one file")
    if profiles != 1:
        given = f"not of {profiles}" if profiles else "and none is named"
        raise SetupError(f"--sets: draws the models of one profile, {given}; name one with --profile")


def _how_long(cell: Cell, seconds: float | None, cycles: int | None) -> float:
    """Return the time to simulate [s]."""
    if cycles is None:
        return DEFAULT_S if seconds is None else seconds
    if seconds is not None:
        raise SetupError("--cycles and --seconds both say how long; give one of them")
    if cycles < 1:
        raise SetupError(f"--cycles {cycles}: should be at least 1")
    return cycles * cell.cycle_s


def _read_with(cell: Cell) -> list[Named]:
    """Name the files that a cell brings along."""
    limits = cell.criteria.contact_limits
    own = [("limits of contact", limits)] if limits.endswith(".toml") else []
    meshes: list[Named] = [(f"mesh of {name}", each.file) for name, each in cell.workspace.fixtures.items()]
    return [
        ("tool file", cell.robot.tool),
        ("URDF", cell.robot.urdf or _file_of(cell.robot.name)),
        *meshes,
        *own,
    ]


def _file_of(robot: str | None) -> str | None:
    """Return the file that an arm is read from, if the user brings it."""
    return None if robot in robot_names() else robot


def _verified(recording: str | Path, cell: Cell, *, assume_nobody: bool = False) -> VerifyReport:
    source = Recording(recording)
    with progress("verifying (the first run on a machine compiles once)") as told:
        return verify_recording(source, cell, assume_nobody=assume_nobody, progress=told)
