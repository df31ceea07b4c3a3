"""What a recording holds, for someone who sees it for the first time; what can be shown is not refused."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Any

from robots.assumption import Assumption
from verifier.cell_template import toml_string
from verifier.recordings.beside import tracking_lines
from verifier.recordings.choice import NOTHING_SAID, Choice
from verifier.recordings.clock_estimate import NOTHING_STATED, ClockFacts, Quickest, clock_facts
from verifier.recordings.clock_offset import ClockOffsets
from verifier.recordings.errors import RecordingError
from verifier.recordings.frame_chain import read_frames
from verifier.recordings.joint_prefix import prefixes
from verifier.recordings.measured_tracking import MeasuredTracking
from verifier.recordings.metadata import noted_assumptions
from verifier.recordings.people_report import WORLD
from verifier.recordings.streams import Streams, survey
from verifier.recordings.survey import MAX_REMARKS, StreamFacts
from verifier.recordings.table_joints import is_table
from verifier.recordings.translation import PREFIX_OPTION
from verifier.shown import LONGEST_NOTE, LONGEST_VALUE, shown, with_unit

GAP_FACTOR = 3.0
"""An interval this many times the mean one is worth a remark."""
CLOCK_REMARK_S = 0.2
"""So is a stamp this far from its message time [s]."""
_REPEATED = (
    "of the measured points; verify refuses them as passed on, not measured; if they were measured (a "
    'simulation, rounding): people.repeated_points = "measured" in the cell'
)


@dataclass(frozen=True, slots=True)
class Inspection:
    """What was found.

    Attributes
    ----------
    path, duration_s:
        The file, and the time between its first and last message [s].
    topics:
        Every topic.
    publishers:
        Messages on ``/joint_states`` by the joints that they hold; ``name`` lists these.
    joints:
        Joint names in order of appearance.
    people:
        Person -> number of reports that show them.
    points:
        Point -> share of the persons reported in which it was measured.
    inferred_points:
        Points that the tracker inferred, all in all.
    repeated_points:
        Measured points that stand exactly where they stood in the reading before, as a share of all measured.
    unknown_points:
        Point names that are not ours.
    frames:
        Coordinate frames of the reports.
    position_error_m:
        Smallest and largest stated position error [m]; ``None``: none is stated.
    robot:
        Name that the file states.
    robot_candidates:
        Arms of the catalogue all of whose joints are there.
    assumptions:
        What the import assumed.
    metadata:
        What else the record ``stopproof`` says.
    choices:
        Keys of ``[recording]`` of the cell that must be filled in, and what could be meant.
    remarks:
        What should be looked at.
    tracking:
        How far the joints were from their commands; ``None``: there are no commands beside positions.
    description:
        The arm as it describes itself on ``/robot_description``, as a recording of it states it
        (:func:`robots.identity.urdf_identity`); ``None``: it does not.
    clocks:
        What is known about the clocks of people and joints.
    static_frames:
        Frame of the reports that only a cell can place -> frames in which ``/tf_static`` places it.
    standing:
        Where people stand in the frames of the reports, in words.
    """

    path: str
    duration_s: float
    topics: tuple[StreamFacts, ...]
    publishers: tuple[StreamFacts, ...]
    joints: tuple[str, ...]
    people: dict[str, int]
    points: dict[str, float]
    inferred_points: int
    repeated_points: float
    unknown_points: tuple[str, ...]
    frames: tuple[str, ...]
    position_error_m: tuple[float, float] | None
    robot: str | None
    robot_candidates: tuple[str, ...]
    assumptions: tuple[Assumption, ...]
    metadata: dict[str, str]
    choices: dict[str, tuple[str, ...]]
    remarks: tuple[str, ...]
    tracking: MeasuredTracking | None = None
    description: str | None = None
    clocks: tuple[ClockFacts, ...] = ()
    static_frames: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    standing: tuple[str, ...] = ()

    @property
    def robot_guess(self) -> str | None:
        """The arm that the file states, else the only one of the catalogue that fits."""
        if self.robot is not None:
            return self.robot
        return self.robot_candidates[0] if len(self.robot_candidates) == 1 else None

    @property
    def foreign_frames(self) -> tuple[str, ...]:
        """Frames of the reports that only a cell can place: all but the world."""
        return tuple(frame for frame in self.frames if frame != WORLD)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON has it; NaN becomes null."""
        more = {"robot_guess": self.robot_guess, "tracking": self.tracking and self.tracking.to_dict()}
        plain = _without_nan(asdict(replace(self, tracking=None)) | more)
        assert isinstance(plain, dict)
        return plain

    def lines(self) -> list[str]:
        """Return everything as text."""
        lines = [f"{self.path}: {self.duration_s:.3f} s"]
        lines += [_topic_line(topic) for topic in self.topics]
        for publisher in self.publishers:
            names = shown(publisher.name, LONGEST_NOTE)
            lines.append(f"joints: {names} ({publisher.messages} samples, {publisher.rate_hz:.4g} Hz)")
        lines.append(f"robot: {self._robot_text()}")
        if self.description is not None:
            lines.append(
                f"described in the recording: {shown(self.description)}; `init --urdf FILE` writes it"
            )
        if self.tracking is not None:
            lines += tracking_lines(self.tracking)
        if self.people:
            people = ", ".join(f"{shown(name)} ({count} reports)" for name, count in self.people.items())
            lines.append(f"people: {people}, in frame {_listed(self.frames)}")
            points = ", ".join(f"{shown(name)} {share:.0%}" for name, share in self.points.items())
            lines.append(f"points: {points}")
            lines += self.standing
            lines.append(f"inferred by the tracker: {self.inferred_points} points")
            if self.repeated_points:
                lines.append(f"exactly where they stood before: {_share(self.repeated_points)} {_REPEATED}")
            lines.append(f"position error: {self._error_text()}")
        if self.unknown_points:
            lines.append(f"point names that are not known: {_listed(self.unknown_points)}")
        lines += [
            f"stated in the file: {shown(key)} = {shown(value, LONGEST_VALUE)}"
            for key, value in self.metadata.items()
        ]
        lines += [assumption_line(assumption) for assumption in self.assumptions]
        lines += [line for clock in self.clocks for line in clock.lines()]
        lines += [self._frame_line(frame) for frame in self.foreign_frames]
        lines += [f"look at: {shown(remark, LONGEST_NOTE)}" for remark in self.remarks]
        return lines

    def _frame_line(self, frame: str) -> str:
        table = f"[people.frames.{shown(toml_string(frame), LONGEST_VALUE)}]"
        line = f"look at: reports in frame '{shown(frame)}': declare its pose in {table} of the cell"
        known = self.static_frames.get(frame, ())
        if not known:
            return line
        return (
            f'{line}; /tf_static has it in {_listed(known)}: pose = "recorded" takes it from there, once '
            "recording.base_frame says which of these is the base of the arm"
        )

    def _robot_text(self) -> str:
        if self.robot is not None:
            return f"{shown(self.robot)}, as the file states"
        if not self.robot_candidates:
            return "no arm of the catalogue has these joints"
        return f"by its joints it may be {' or '.join(self.robot_candidates)}"

    def _error_text(self) -> str:
        if self.position_error_m is None:
            return "not stated"
        return " … ".join(f"{error:g}" for error in dict.fromkeys(self.position_error_m)) + " m"


def inspect_recording(
    path: str | Path, choice: Choice = NOTHING_SAID, quickest: Quickest = NOTHING_STATED
) -> Inspection:
    """Read a recording and say what it holds.

    ``choice``: which topics and joints are meant; ``quickest``: what is stated to bound its clocks.

    Raises
    ------
    RecordingError
        It is not there, or is not complete; or clocks are stated for a table, which has one.
    """
    from verifier.recordings.table_inspection import inspect_table  # it makes an Inspection itself

    if is_table(path):
        if choice.clocks.stated or quickest != NOTHING_STATED:
            wrong, right = "a table has no stamps beside its times", "state offset and latency for messages"
            raise RecordingError(path, "", wrong, right)
        return inspect_table(path)
    streams = survey(Path(path), choice)
    joints, people, metadata = streams.joints, streams.people, streams.metadata
    placed, misplaced = _placed(Path(path), tuple(frame for frame in people.frames if frame != WORLD))
    names = tuple(dict.fromkeys(name for names in joints.publishers for name in names))
    arms = catalogue()
    guessed = guess_robots(names, arms)
    facts = streams.facts()
    beside = streams.beside
    remarks = [
        *streams.unclear,
        *streams.likely.remarks(),
        *_prefix_remarks(names, arms, guessed),
        *_remarks(facts, streams),
        *streams.beside.remarks,
        *joints.units(),
        *people.units(),
        *joints.remarks,
        *people.remarks(),
        *misplaced,
    ]
    return Inspection(
        path=str(path),
        duration_s=streams.duration_s,
        topics=facts,
        publishers=tuple(stream.facts(streams.start) for stream in joints.publishers.values()),
        joints=names,
        people=dict(people.people),
        points=people.shares(),
        inferred_points=people.inferred,
        repeated_points=people.repeated / max(int(people.measured.sum()), 1),
        unknown_points=tuple(sorted(people.unknown)),
        frames=tuple(people.frames),
        position_error_m=people.errors(),
        robot=metadata.get("robot"),
        robot_candidates=guessed,
        assumptions=noted_assumptions(metadata),
        metadata={key: value for key, value in metadata.items() if key != "assumptions"},
        choices=streams.choices | _prefix_choice(names, arms, guessed),
        remarks=tuple(remarks[:MAX_REMARKS]),
        tracking=beside.tracking,
        description=None if beside.description is None else beside.description.identity,
        clocks=tuple(_clocks(streams, choice.clocks, quickest)),
        static_frames=placed,
        standing=tuple(people.standing.lines()),
    )


def _placed(path: Path, frames: Sequence[str]) -> tuple[dict[str, tuple[str, ...]], tuple[str, ...]]:
    """Return where static transforms place frames of reports, and what is wrong with these transforms."""
    if not frames:
        return {}, ()
    try:
        known = read_frames(path)
    except RecordingError as error:
        return {}, (str(error),)
    return {frame: still for frame in frames if (still := known.still(frame))}, ()


def _clocks(streams: Streams, stated: ClockOffsets, quickest: Quickest) -> Iterator[ClockFacts]:
    people = clock_facts("people", stated.people_s or 0.0, streams.people.clock, quickest.people)
    joints = clock_facts("joints", stated.joints_s or 0.0, streams.joints.clock, quickest.joints)
    yield from (facts for facts in (people, joints) if facts is not None)


def guess_robots(joints: Collection[str], arms: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return the arms all of whose joints are among ``joints``, as they are or behind a common prefix."""
    plain = tuple(name for name, needed in arms.items() if set(needed) <= set(joints))
    return plain or tuple(name for name, needed in arms.items() if prefixes(joints, needed))


def _prefix_remarks(
    names: Collection[str], arms: Mapping[str, tuple[str, ...]], guessed: Sequence[str]
) -> Iterator[str]:
    for arm in guessed[:1]:
        found = prefixes(names, arms[arm])
        if len(found) > 1:
            yield f"the joints stand there {len(found)} times, after {', '.join(found)}: {PREFIX_OPTION}"
        elif found != ("",):
            yield f"before the joints of the arm stands {found[0]}: it is taken off when the robot is named"


def _prefix_choice(
    names: Collection[str], arms: Mapping[str, tuple[str, ...]], guessed: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    found = prefixes(names, arms[guessed[0]]) if guessed else ()
    return {"joint_prefix": found} if len(found) > 1 else {}


def catalogue() -> dict[str, tuple[str, ...]]:
    """Return the joint names of every arm of the catalogue, read from its model file."""
    from robots.catalog import robot_names  # loads the kinematics library, which nothing else here needs

    models = resources.files("robots") / "models"
    arms = {name: tomllib.loads((models / f"{name}.toml").read_text("utf-8")) for name in robot_names()}
    return {name: tuple(arm["joints"]) for name, arm in arms.items()}


def assumption_line(item: Assumption) -> str:
    """Return an assumption, as the import noted it, for a line of text."""
    value = with_unit(item.value, item.unit)
    return f"{item.certainty}: {shown(item.name)} = {value} ({shown(item.source, LONGEST_VALUE)})"


def _listed(names: Iterable[str]) -> str:
    return ", ".join(map(shown, names))


def _share(value: float) -> str:
    return f"{value:.1%}" if value >= 0.001 else "less than 0.1%"


def _remarks(topics: tuple[StreamFacts, ...], streams: Streams) -> Iterator[str]:
    for topic in topics:
        if topic.messages > 1 and topic.largest_gap_s * topic.rate_hz > GAP_FACTOR:
            yield (
                f"{topic.name}: a gap of {topic.largest_gap_s:.3f} s after {topic.gap_at_s:.3f} s "
                f"(mean interval {1.0 / topic.rate_hz:.4f} s)"
            )
        if topic.stamp_age_s is not None:
            least, _mean, most = topic.stamp_age_s
            if least < 0.0:
                yield f"{topic.name}: stamps are up to {-least:.4f} s ahead of the message time"
            if most > CLOCK_REMARK_S:
                yield f"{topic.name}: stamps are up to {most:.6g} s older than the message time"
    for what, ours, messages in streams.numbers():
        if not messages and what not in streams.choices:
            yield f"there are no messages on {ours}"


def _topic_line(topic: StreamFacts) -> str:
    name = shown(topic.name)
    kind = f"{shown(topic.schema or 'no schema')} ({shown(topic.encoding)})"
    if topic.messages < 2:
        return f"{name}: {kind}, {topic.messages} messages"
    text = (
        f"{name}: {kind}, {topic.messages} messages, {topic.first_s:.3f} … {topic.last_s:.3f} s, "
        f"{topic.rate_hz:.4g} Hz, largest gap {topic.largest_gap_s:.4f} s"
    )
    if topic.stamp_age_s is None:
        return text
    least, mean, most = (1e3 * age for age in topic.stamp_age_s)
    return f"{text}, message time after stamp {least:.1f} / {mean:.1f} / {most:.1f} ms (least, mean, most)"


def _without_nan(value: object) -> object:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _without_nan(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(entry) for entry in value]
    return value
