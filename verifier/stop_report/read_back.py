"""A stop report, read back from the JSON that `stop-report --json` wrote."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from robots.errors import SetupError
from robots.files import printed
from verifier.result_file import Count, ReadFile, ResultFile, Stated, Table
from verifier.stop_report.as_json import FORMAT

WRITTEN_BY = "`stopproof stop-report --json`"
SCHEMA = "docs/stop-report.schema.json"
"""Lists the keys of a stop report."""
Number = Annotated[float, Field(ge=0.0)]
Stop = Literal["joint_space", "path_consistent", "measured", "brakes"]
"""The keys of :data:`verifier.stop_report.report.WORDS`."""


class Span(Table):
    """A worst case: reached at least, and not exceeded; ``upper`` is ``None`` where it is not bounded."""

    lower: Number
    upper: Number | None

    @model_validator(mode="after")
    def _not_the_wrong_way_round(self) -> Span:
        if self.upper is not None and self.upper < self.lower:
            raise ValueError("upper is less than lower")
        return self


class WorstCase(Span):
    """One bracket of the report."""

    quantity: str
    part: str
    unit: str
    stop: Stop
    over: str
    guessed: bool


class OfPart(Span):
    """The bracket of a joint, link or arm in a field of a grid."""

    part: str


class Braking(Table):
    """Brackets of a field; ``None``: not looked at there."""

    time_s: OfPart | None
    angles: list[OfPart]
    point_speed_m_s: OfPart | None
    way_m: OfPart | None


class FieldOfGrid(Table):
    """A field of a grid, by its shares."""

    extension: Number
    speed: Number
    load: Number
    braking: Braking


class Grid(Table):
    """Stops at shares of load, speed and extension."""

    stop: Stop
    guessed: bool
    load_matters: bool
    load_kg: Number | None
    complete: bool
    largest_extension_m: Span
    cells: list[FieldOfGrid]

    @model_validator(mode="after")
    def _no_field_twice(self) -> Grid:
        _once([(each.load, each.speed, each.extension) for each in self.cells], "a field of its cells")
        return self

    def extension(self, cell: FieldOfGrid) -> float | None:
        """Return the share of extension of a field; ``None``: the arm has no extension."""
        return None if self.largest_extension_m.upper is None else cell.extension


class Answer(Table):
    """The first page; ``time`` to ``way`` are places in ``worst_case``."""

    stop: Stop
    over: str
    total_s: Number | None
    time: Count | None
    angles: list[Count]
    point_speed: Count | None
    way: Count | None


class Reaction(Table):
    """Until the stop begins [s]."""

    seconds: Number


class Distance(Table):
    """A required distance [m]; ``None``: a term is missing."""

    stop: Stop
    over: str
    edition: str
    form: str
    distance_m: float | None


class Recorded(Table):
    """Cycles of a recording, by what their stop is."""

    cycles: Count
    looked_at: Count
    planned: Count
    without_stop: Count
    beyond_end: Count
    off_path: Count


class RequiredDistance(Table):
    """S_p [m]."""

    distance_m: float


class Room(Table):
    """The instant with the least room above S_p."""

    t: float
    link: str
    person: str
    separation_m: float
    required: RequiredDistance
    room_m: float


class Separation(Table):
    """S_p against the separation over a recording."""

    profile: str
    compared: Count
    too_close: Count
    worst: Room | None


class JointTorque(Table):
    """What braking asks of a drive, at least and at most."""

    joint: str
    unit: str
    lower: float
    upper: float | None


class Torque(Table):
    """How hard the drives can brake with a load."""

    load_kg: Number
    share_guaranteed: float
    share_found: float
    joint: str
    torques: list[JointTorque]


class Missing(Table):
    """What is not known."""

    what: str
    why: str


class StopReportResult(Table):
    """What `stop-report --json` has written; docs/stop-report.schema.json says what each key is."""

    version: str
    robot: str
    tool: str | None
    joints: Annotated[list[str], Field(min_length=1)]
    units: list[str]
    recording: str | None
    stop_model: str
    cell_hash: str
    interrupted: bool
    waived: list[str]
    speed: Number
    speeds: list[float]
    reaction: Reaction
    answer: Answer
    worst_case: list[WorstCase]
    grids: list[Grid]
    required_distances: list[Distance]
    recorded: Recorded | None
    protective_separation: Separation | None
    torques: list[Torque]
    missing: list[Missing]
    assumptions: list[Stated]
    inputs: list[ReadFile]

    @model_validator(mode="after")
    def _belongs_together(self) -> StopReportResult:
        _once(self.joints, "a joint")
        _once([each.stop for each in self.grids], "a grid of a stop")
        _once([(each.stop, each.over, each.edition, each.form) for each in self.required_distances],
              "a required distance")  # fmt: skip
        if not len(self.joints) == len(self.units) == len(self.speeds):
            raise ValueError("joints, units and speeds must be of one length")
        answer = self.answer
        places = (answer.time, answer.point_speed, answer.way, *answer.angles)
        if any(place is not None and place >= len(self.worst_case) for place in places):
            raise ValueError("answer names a place that worst_case does not have")
        for each in self.grids:
            for cell in each.cells:
                if [angle.part for angle in cell.braking.angles] not in ([], self.joints):
                    raise ValueError("the angles of a field of grids are not those of the joints")
        return self


def _once(items: Sequence[object], what: str) -> None:
    if len(set(items)) != len(items):
        raise ValueError(f"{what} is given twice")


def read_stop_report(path: str | Path) -> StopReportResult:
    """Read a result of `stop-report --json`.

    Raises
    ------
    SetupError
        The file cannot be read, or is no stop report in the format of this version, in one line.
    """
    return stop_report_result(ResultFile(path, WRITTEN_BY))


def is_stop_report(file: ResultFile) -> bool:
    """Whether a file says that it is a stop report, of whatever format."""
    return isinstance(file.format, str) and file.format.startswith("stopproof stop-report ")


def stop_report_result(file: ResultFile) -> StopReportResult:
    """Return the stop report that a file holds.

    Raises
    ------
    SetupError
        It holds none in the format of this version, in one line.
    """
    if file.format == FORMAT:
        return file.require(StopReportResult, SCHEMA)
    if is_stop_report(file):
        raise SetupError(
            f"{file}: is of the format {printed(str(file.format))}, this version compares {FORMAT!r}; make "
            "the report again"
        )
    raise SetupError(f"{file}: is no result of {WRITTEN_BY}")
