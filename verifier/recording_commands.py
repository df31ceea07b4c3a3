"""The commands about recordings, which judge nothing: inspect, init, import, conformance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import click

from occupancy.body import POINT_NAMES
from occupancy.identification import MARGIN
from robots.catalog import joint_names, robot_names
from robots.errors import SetupError
from robots.files import is_file, printed
from verifier.cell_filling import fill_in
from verifier.cell_template import BLANK
from verifier.command_options import (
    file_of,
    force_option,
    json_option,
    latency_option,
    package_dir_option,
    stated_offset,
    time_offset_option,
    topic_options,
)
from verifier.conformance import (
    bundled_profiles,
    conform,
    identified,
    open_profile,
    open_profiles,
    open_recordings,
)
from verifier.enclosure_size import remarks_on_urdf
from verifier.output import print_file, print_lines, progress, write_bytes, write_json
from verifier.recordings.choice import Choice
from verifier.recordings.clock_estimate import Latency, Quickest
from verifier.recordings.clock_offset import ONE_CLOCK, ClockOffsets, read_time_offset
from verifier.recordings.importing import ImportSettings, import_recording
from verifier.recordings.inspection import inspect_recording
from verifier.recordings.people_source import PeopleFile, Place
from verifier.recordings.people_sources import SourceOptions
from verifier.reports.conformance import conformance_lines, conformance_list, identified_lines
from verifier.reports.excess_picture import excess_picture
from verifier.reports.picture import kind_of, require_drawing
from verifier.reports.sets_picture import sets_picture
from verifier.reports.text import DISCLAIMER
from verifier.shown import LONGEST_NOTE, shown
from verifier.snapshot import choose_moment, take_snapshot
from verifier.targets import check_targets


@click.command()
@click.argument("recording")
@topic_options
@time_offset_option
@latency_option("--latency", "reports about people")
@latency_option("--joints-latency", "joint samples")
@json_option
@force_option
def inspect(
    recording: str,
    joints_topic: str | None,
    people_topic: str | None,
    joint_prefix: str | None,
    time_offset: str | None,
    latency: tuple[float, float] | None,
    joints_latency: tuple[float, float] | None,
    json_path: str | None,
    force: bool,
) -> int:
    """Show what RECORDING holds: topics, rates, gaps, names, clocks, and which robot it may be."""
    check_targets([("--json", json_path)], [("recording", recording)], force=force)
    stated = stated_offset(time_offset)
    clocks = ONE_CLOCK if stated is None else ClockOffsets(stated[0], error_s=stated[1])
    choice = Choice(joints_topic, people_topic, joint_prefix, clocks=clocks)
    quickest = Quickest(
        people=None if latency is None else Latency(*latency),
        joints=None if joints_latency is None else Latency(*joints_latency),
    )
    found = inspect_recording(recording, choice, quickest)
    if json_path is not None:
        write_json(found.to_dict(), json_path, force=force)
    if json_path != "-":
        print_lines(found.lines())
    return 0


@click.command()
@click.argument("recording", required=False)
@click.option("--robot", metavar="NAME|URDF", help="Arm, in place of a recording or of which it is.")
@package_dir_option
@click.option("--urdf", metavar="F.urdf", help="Write what the recording has on /robot_description.")
@click.option("--joint-limits", metavar="F.yaml", help="MoveIt's joint_limits.yaml: limits for the cell.")
@click.option("--out", metavar="CELL.toml", help="Write the file instead of printing it.")
@force_option
def init(
    recording: str | None,
    robot: str | None,
    package_dirs: Sequence[str],
    urdf: str | None,
    joint_limits: str | None,
    out: str | None,
    force: bool,
) -> int:
    """Print a commented cell file for RECORDING or --robot; what must be filled in is marked."""
    if recording is None and robot is None:
        raise SetupError("init: give a RECORDING or --robot NAME|URDF")
    if robot is not None and robot not in robot_names() and not is_file(Path(robot)):
        known = ", ".join(robot_names())
        raise SetupError(f"--robot {printed(robot)}: neither a file nor in the catalogue; known: {known}")
    if robot is not None and urdf is not None:
        raise SetupError("--urdf writes what the recording describes, --robot names an arm: give one of them")
    inputs = [
        ("recording", recording),
        ("--robot file", file_of(robot)),
        ("--joint-limits file", joint_limits),
    ]
    check_targets([("--out", out), ("--urdf", urdf)], inputs, force=force)
    filled = fill_in(recording, robot, urdf, joint_limits, package_dirs)
    if urdf is not None and filled.described is not None:
        write_bytes(filled.described.content, urdf, force=force)
    if out is None:
        print_file(filled.text)
    else:
        write_bytes(filled.text.encode(), out, force=force)
        remarks = [f"look at: {shown(remark, LONGEST_NOTE)}" for remark in filled.remarks]
        print_lines([f"wrote {out}: fill in every {BLANK}", *remarks])
    return 0


@click.command("import")
@click.argument("out")
@click.option("--robot", required=True, metavar="NAME|URDF", help="Arm that was recorded.")
@package_dir_option
@click.option("--joints", required=True, metavar="FILE", help="NPZ, CSV, MCAP or bag with joint positions.")
@click.option("--run", type=int, help="Which run of a file that numbers them.")
@click.option(
    "--people", "people", multiple=True, metavar="FILE", help="NPZ, CSV, MCAP, bag, BVH; repeatable."
)
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
@click.option(
    "--point-name",
    "point_names",
    multiple=True,
    metavar="THEIRS=OURS",
    help="Take points of another name as ours; repeatable.",
)
@click.option("--time-offset", metavar="S[±ERR]", help="How much later the people start, and its error [s].")
@topic_options
@force_option
def import_(
    out: str,
    robot: str,
    package_dirs: Sequence[str],
    joints: str,
    run: int | None,
    people: Sequence[str],
    places: Sequence[tuple[float, float, float, float]],
    position_error: float | None,
    point_names: Sequence[str],
    time_offset: str | None,
    joints_topic: str | None,
    people_topic: str | None,
    joint_prefix: str | None,
    force: bool,
) -> int:
    """Combine joint motion and people into the recording OUT (MCAP)."""
    inputs = [
        ("--joints file", joints),
        *(("--people file", path) for path in people),
        ("URDF", file_of(robot)),
    ]
    check_targets([("OUT", out)], inputs, force=force)
    if places and len(places) != len(people):
        raise SetupError(f"--place is given {len(places)} times, --people {len(people)} times: pair them")
    files = [PeopleFile(Path(path), Place(*places[i]) if places else None) for i, path in enumerate(people)]
    offset = None if time_offset is None else read_time_offset(time_offset)
    named = _point_names(point_names)
    folders = tuple(map(Path, package_dirs))
    name, robot_joints = joint_names(robot, folders)
    summary = import_recording(
        out,
        joints,
        files,
        ImportSettings(
            robot=name,
            robot_joints=robot_joints,
            run=run,
            position_error_m=position_error,
            time_offset_s=None if offset is None else offset.offset_s,
            time_offset_error_s=None if offset is None else offset.error_s,
            point_names=named,
            choice=Choice(joints_topic, people_topic, joint_prefix, people=SourceOptions(point_names=named)),
        ),
        force=force,
    )
    remarks = (*summary.remarks, *remarks_on_urdf(robot, folders))
    print_lines(replace(summary, remarks=remarks).lines())
    return 0


@click.command()
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


def _point_names(pairs: Sequence[str]) -> dict[str, str]:
    """Read ``--point-name THEIRS=OURS``; theirs may have a ``=`` in it, ours has none."""
    named: dict[str, str] = {}
    for pair in pairs:
        theirs, sign, ours = pair.rpartition("=")
        if not sign or not theirs or ours not in POINT_NAMES:
            known = ", ".join(POINT_NAMES)
            raise SetupError(f"--point-name {printed(pair)}: it must be THEIRS=OURS, where ours are {known}")
        if named.setdefault(theirs, ours) != ours:
            raise SetupError(f"--point-name {printed(theirs)}: is both {named[theirs]} and {ours}")
    return named


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
