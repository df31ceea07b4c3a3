"""Recordings in which real stops are looked for, and what was found in each of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robots.catalog import robot_names
from robots.errors import SetupError
from robots.files import printed
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.inputs import input_file, recording_files
from verifier.opened import choice_of
from verifier.paths import same_file
from verifier.recordings.errors import RecordingError
from verifier.recordings.metadata import own_metadata
from verifier.recordings.motion import RecordedMotion
from verifier.recordings.motion_source import open_motion
from verifier.setup import build_robot
from verifier.stops.finding import Found, find_stops
from verifier.stops.measuring import Measured, ToolPoints, measure
from verifier.stops.speeds import STANDSTILL_RAD_S, Speeds, speeds

FASTEST_STANDSTILL = 1.0
"""Joints faster than this [rad/s, m/s] cannot be said to stand still."""


@dataclass(frozen=True, slots=True, eq=False)
class StopSettings:
    """How stops are looked for.

    Attributes
    ----------
    standstill:
        A joint below this speed stands still [rad/s, m/s].
    ends_of_motion:
        Measure also where the arm comes to rest and nothing that was recorded says why.
    run:
        Which run of an NPZ that numbers them.

    Raises
    ------
    SetupError
        The speed is not positive, or above 1.
    """

    standstill: float = STANDSTILL_RAD_S
    ends_of_motion: bool = False
    run: int | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.standstill <= FASTEST_STANDSTILL:
            raise SetupError(
                f"--standstill {self.standstill}: must be above 0 and at most {FASTEST_STANDSTILL:g} rad/s"
            )


@dataclass(frozen=True, slots=True, eq=False)
class StopsOf:
    """One recording, the speeds of its joints, and its stops, measured, in order of time."""

    motion: RecordedMotion
    seen: Speeds
    found: Found
    stops: tuple[Measured, ...]

    @property
    def told_by(self) -> tuple[str, ...]:
        """What was recorded that can tell of a stop: columns, topics, the command."""
        motion = self.motion
        commanded = ("the command",) if motion.command_q is not None or motion.command_dq is not None else ()
        return (*(channel.name for channel in motion.states), *commanded)

    @property
    def step_s(self) -> float:
        """Median time between samples [s]."""
        return float(np.median(np.diff(self.motion.t)))

    @property
    def longest_step_s(self) -> float:
        """Longest time between samples [s]."""
        return float(np.max(np.diff(self.motion.t)))


@dataclass(frozen=True, slots=True, eq=False)
class AllStops:
    """What was found in all recordings, how, and the arm, where it is known."""

    settings: StopSettings
    robot: RobotModel | None
    recordings: tuple[StopsOf, ...]

    @property
    def stops(self) -> tuple[tuple[StopsOf, Measured], ...]:
        """Every stop with the recording that it is from."""
        return tuple((each, stop) for each in self.recordings for stop in each.stops)


def stops_of_recordings(
    paths: Sequence[str],
    cell: Cell,
    settings: StopSettings,
    progress: Callable[[float], None] = lambda _share: None,
) -> AllStops:
    """Find and measure the stops of recordings of one arm.

    Raises
    ------
    SetupError
        A recording is refused, stands there twice, or is of another arm; none has a stop.
    """
    for number, path in enumerate(paths):
        if any(same_file(path, other) for other in paths[:number]):
            raise SetupError(f"{printed(path)}: stands there twice; name each recording once")
    robot = _robot(paths, cell)
    joints = None if robot is None else robot.joints
    tool = None if robot is None else ToolPoints(robot)
    done: list[StopsOf] = []
    contents: dict[str, str] = {}
    for number, path in enumerate(paths):
        motion = open_motion(Path(path), joints, settings.run, choice_of(cell))
        _check_content(path, contents)
        if done and sorted(motion.joints) == sorted(done[0].motion.joints) != list(motion.joints):
            motion = open_motion(Path(path), done[0].motion.joints, settings.run, choice_of(cell))
        if done and motion.joints != done[0].motion.joints:
            wrong = f"is of another arm than {done[0].motion.path.name}: joints {', '.join(motion.joints)}"
            raise RecordingError(motion.path, "", wrong, "give recordings of one arm")
        done.append(_measured(motion, settings, tool))
        progress((number + 1) / len(paths))
    found = AllStops(settings, robot, tuple(done))
    if not found.stops:
        raise _nothing_found(found)
    return found


def _check_content(path: str, contents: dict[str, str]) -> None:
    """Refuse a copy: its stops would be held against a model that was fitted on them."""
    files = recording_files(Path(path))
    digest = " ".join(input_file(what, Path(each)).sha256 for what, each in files if each is not None)
    if digest in contents:
        raise SetupError(f"{printed(path)}: is a copy of {printed(contents[digest])}; name one of them")
    contents[digest] = path


def _robot(paths: Sequence[str], cell: Cell) -> RobotModel | None:
    """The arm of cell and recordings; ``None``: neither says which it is."""
    stated = [name for path in paths if (name := _stated(path)) is not None]
    for name in dict.fromkeys(stated):
        if name != stated[0]:
            raise SetupError(f"the recordings are of different robots: {stated[0]} and {name}")
    chosen = cell.robot.name or cell.robot.urdf
    recorded = stated[0] if stated else None
    if chosen is None and recorded not in robot_names():
        if cell.robot.tool is not None:
            raise SetupError(
                f"tool {printed(cell.robot.tool)}: on which robot is it? name that with --robot, so that the "
                "way of the tool can be measured"
            )
        return None
    return build_robot(cell, recorded)


def _stated(path: str) -> str | None:
    """Which arm an MCAP says that it is of."""
    if not path.endswith(".mcap") or Path(path).is_dir():
        return None
    from verifier.recordings.mcap_file import McapFile

    return own_metadata(McapFile(path)).get("robot")


def _measured(motion: RecordedMotion, settings: StopSettings, tool: ToolPoints | None) -> StopsOf:
    seen = speeds(motion, settings.standstill)
    found = find_stops(motion, seen)
    wanted = [*found.stops, *(found.ends_of_motion if settings.ends_of_motion else ())]
    wanted.sort(key=lambda stop: stop.rest)
    return StopsOf(motion, seen, found, tuple(measure(motion, seen, stop, tool) for stop in wanted))


def _nothing_found(found: AllStops) -> RecordingError:
    """Say, in one line, why there is nothing to measure and what would help."""
    first = found.recordings[0]
    reasons = [
        f"{times(sum(each.found.unmeasured.get(why, 0) for each in found.recordings))} {why}"
        for why in dict.fromkeys(why for each in found.recordings for why in each.found.unmeasured)
    ]
    ends = sum(len(each.found.ends_of_motion) for each in found.recordings)
    told = dict.fromkeys(name for each in found.recordings for name in each.told_by)
    if ends and not found.settings.ends_of_motion:
        why = f"{', '.join(told)} tell of no stop" if told else "nothing recorded says that it was told to"
        reasons.append(f"the arm comes to rest {times(ends)}, and {why}")
    elif not ends and not reasons:
        reasons.append("the arm never comes to rest from motion")
    others = len(found.recordings) - 1
    also = f" (nor has any of the {others} others)" if others else ""
    right = [] if told else ["record the safety mode, a stop flag or the command"]
    if ends and not found.settings.ends_of_motion:
        right.append("--ends-of-motion measures any standstill")
    elif not ends:
        right.append("record from before the arm is told to stop until it has stood still for 0.1 s")
    wrong = f"has no stop that can be measured{also}: {'; '.join(reasons)}"
    return RecordingError(first.motion.path, "", wrong, "; ".join(right))


def times(number: int) -> str:
    """Return how often, in words."""
    return "once" if number == 1 else f"{number} times"
