"""The cell: robot, tool, mount, people, clocks, criteria. Read from TOML, validated, then frozen.

Every key carries its unit in its name; docs/cell.md lists them all. A key that is not known, a value of the
wrong sign or type, NaN and infinity are refused with the place and the rule.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, PrivateAttr, ValidationError, model_validator

from robots.assumption import Assumption, Certainty
from verifier.cell_reading import TOO_DEEP, CellError, first_problem, plain, read_table
from verifier.cell_tables import (
    CheckTable,
    CriteriaTable,
    PeopleTable,
    RecordingTable,
    RobotTable,
    StopTable,
    Table,
    WorkspaceTable,
)
from verifier.paths import same_file
from verifier.shown import shown

NO_TOPICS: Mapping[str, str | None] = {}


class Cell(Table):
    """Everything that a verdict depends on besides the recording."""

    cycle_s: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.01
    robot: RobotTable = RobotTable()
    stop: StopTable = StopTable()
    people: PeopleTable = PeopleTable()
    workspace: WorkspaceTable = WorkspaceTable()
    criteria: CriteriaTable = CriteriaTable()
    check: CheckTable = CheckTable()
    recording: RecordingTable = RecordingTable()
    _where: str = PrivateAttr("cell")
    _file: Path | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _contact_is_bounded(self) -> Cell:
        if not self.criteria.contact:
            return self
        if self.workspace.floor_z_m is None and not self.workspace.fixtures:
            raise ValueError(
                "criteria.contact needs [workspace]: floor and all against which somebody could be clamped"
            )
        if "velocity_error_rad_s" not in self.robot.tracking.model_fields_set:
            raise ValueError(
                "criteria.contact rests on speeds: state robot.tracking.velocity_error_rad_s, their error"
            )
        return self

    @model_validator(mode="after")
    def _one_switch(self) -> Cell:
        switch = self.recording.switch
        if switch is not None and set(switch.regions) != set(self.people.monitored):
            raise ValueError(
                f"recording.switch.regions = {', '.join(switch.regions)}: the switch must speak for all of "
                f"people.monitored ({', '.join(self.people.monitored) or 'there is none'}) and no others"
            )
        return self

    @model_validator(mode="after")
    def _measured_stop(self) -> Cell:
        if self.stop.model == "measured" and self.robot.silence is not None:
            raise ValueError('stop.model = "measured" is the robot\'s own stop: leave robot.silence away')
        if self.stop.model == "measured" and self.robot.tracking.delay_max_s > 0.0:
            raise ValueError(
                'stop.model = "measured" counts from where the robot is: robot.tracking.delay_max_s must be 0'
            )
        return self

    @model_validator(mode="after")
    def _offsets_have_errors(self) -> Cell:
        stated = {"time_offset_s", "joints_time_offset_s"} & self.recording.model_fields_set
        if stated and "clock_error_s" not in self.people.model_fields_set:
            raise ValueError(
                f"recording.{min(stated)} is known with an error: state it as people.clock_error_s"
            )
        return self

    @model_validator(mode="after")
    def _recorded_frames_have_a_base(self) -> Cell:
        recorded = [name for name, frame in self.people.frames.items() if frame.pose == "recorded"]
        if recorded and self.recording.base_frame is None:
            raise ValueError(
                f'people.frames.{shown(recorded[0])}: pose = "recorded" needs recording.base_frame, the '
                "frame of the recording that is the base of the arm's model"
            )
        return self

    @property
    def where(self) -> str:
        """The file, or what else the cell is called in messages."""
        return self._where

    @property
    def file(self) -> Path | None:
        """The file that the cell was read from; ``None``: it was given as a table, or by options alone."""
        return self._file

    @classmethod
    def from_toml(cls, path: str | Path) -> Cell:
        """Read a cell file; relative paths in it are taken from its folder.

        Raises
        ------
        CellError
            The file is not there, is not TOML, or a key or value breaks a rule.
        """
        path = Path(path)
        cell = cls.from_table(read_table(path), where=str(path), folder=path.parent)
        cell._file = path
        return cell

    @classmethod
    def from_table(cls, table: dict[str, Any], *, where: str = "cell", folder: Path | None = None) -> Cell:
        """Validate a cell given as a table; ``where`` names it in messages.

        Raises
        ------
        CellError
            A key or value breaks a rule.
        """
        try:
            values = plain(table)
            cell = cls.model_validate(values, strict=True)
        except ValidationError as error:
            raise CellError(f"{where}: {first_problem(error, values)}") from error
        except RecursionError as error:
            raise CellError(f"{where}: {TOO_DEEP}") from error
        cell._where = where
        if folder is None:
            return cell
        files = {
            key: str(folder / value)
            for key in ("urdf", "tool")
            if (value := getattr(cell.robot, key)) is not None and not Path(value).is_absolute()
        }
        dirs = tuple(str(folder / entry) for entry in cell.robot.package_dirs)
        robot = cell.robot.model_copy(update={**files, "package_dirs": dirs})
        people = cell.people
        if people.profile.endswith(".toml"):
            people = people.model_copy(update={"profile": str(folder / people.profile)})
        fixtures = {
            name: each if each.file is None else each.model_copy(update={"file": str(folder / each.file)})
            for name, each in cell.workspace.fixtures.items()
        }
        workspace = cell.workspace.model_copy(update={"fixtures": fixtures})
        criteria = cell.criteria
        if criteria.contact_limits.endswith(".toml"):
            limits = str(folder / criteria.contact_limits)
            criteria = criteria.model_copy(update={"contact_limits": limits})
        stop = cell.stop
        if stop.measured is not None:
            stop = stop.model_copy(update={"measured": str(folder / stop.measured)})
        tables = {
            "stop": stop,
            "robot": robot,
            "people": people,
            "workspace": workspace,
            "criteria": criteria,
        }
        return cell.model_copy(update=tables)

    def with_options(
        self,
        *,
        robot: str | None = None,
        tool: str | None = None,
        bare_flange: bool = False,
        models: Sequence[str] = (),
        profile: str | None = None,
        stop_model: str | None = None,
        topics: Mapping[str, str | None] = NO_TOPICS,
        time_offset: tuple[float, float] | None = None,
    ) -> Cell:
        """Return this cell with options of the command line added; what is not given stays as it is.

        ``topics``: of ``[recording]``, by key; ``time_offset``: of people's stamps, and its error [s].

        Raises
        ------
        CellError
            An option contradicts the cell, or breaks a rule.
        """
        table = self.model_dump(exclude_unset=True, exclude_none=True)
        arm, people, stop = (table.setdefault(key, {}) for key in ("robot", "people", "stop"))
        if robot is not None:
            key = "urdf" if robot.endswith((".urdf", ".xml")) or "/" in robot else "name"
            stated = "urdf" if "urdf" in arm else "name" if "name" in arm else key
            _agree("--robot", robot, arm.setdefault(stated, robot), is_file=stated == "urdf")
        if tool is not None:
            _agree("--tool", tool, arm.setdefault("tool", tool), is_file=True)
        if bare_flange and not arm.setdefault("bare_flange", True):
            raise CellError("--bare-flange: the cell says bare_flange = false; they must agree")
        if models:
            _agree("--human", sorted({*models}), sorted({*people.setdefault("models", tuple(models))}))
        if profile is not None:
            _agree("--profile", profile, people.setdefault("profile", profile))
        if stop_model is not None:
            _agree("--stop-model", stop_model, stop.setdefault("model", stop_model))
        for key, value in topics.items():
            if value is not None:
                stated = table.setdefault("recording", {}).setdefault(key, value)
                _agree(f"--{key.replace('_', '-')}", value, stated)
        if time_offset is not None:
            _take_time_offset(table, *time_offset)
        together = Cell.from_table(table, where="cell and command line together")
        together._where, together._file = self._where, self._file
        return together

    def content_hash(self, *content: str) -> str:
        """Return a hash of every value that this cell resolves to, and of the ``content`` of its files."""
        values = self.model_dump(mode="json")
        for key in ("urdf", "tool", "package_dirs"):
            values["robot"].pop(key)
        for fixture in values["workspace"]["fixtures"].values():
            fixture.pop("file")
        values["criteria"].pop("contact_limits")
        values["stop"].pop("measured")
        if self.recording == RecordingTable():
            values.pop("recording")
        text = json.dumps([values, *content], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def assumptions(self) -> tuple[Assumption, ...]:
        """List every number of the cell, with whether it was declared or left to its default."""
        return tuple(_walk(self, "cell"))


def _take_time_offset(table: dict[str, Any], offset_s: float, error_s: float) -> None:
    """Put an offset and its error into the table of a cell."""
    stated = table.setdefault("recording", {}).setdefault("time_offset_s", offset_s)
    _agree("--time-offset", offset_s, stated)
    clock_error_s = table.setdefault("people", {}).setdefault("clock_error_s", error_s)
    if clock_error_s < error_s:
        raise CellError(
            f"--time-offset {offset_s:.15g}±{error_s:g}: the cell says people.clock_error_s = "
            f"{clock_error_s:g}, which must be at least the error of the offset"
        )


def _agree(option: str, given: object, stated: object, *, is_file: bool = False) -> None:
    """Refuse an option that the cell contradicts; a file may be named in two ways."""
    if given == stated or (is_file and same_file(str(given), str(stated))):
        return
    raise CellError(f"{option} {_text(given)}: the cell says {_text(stated)}; they must agree")


_UNITS = {
    "_rad_s3": "rad/s³",
    "_rad_s2": "rad/s²",
    "_rad_s": "rad/s",
    "_m_s3": "m/s³",
    "_m_s2": "m/s²",
    "_m_s": "m/s",
    "_rad": "rad",
    "_deg": "deg",
    "_Nm": "N m",
    "_N": "N",
    "_kg": "kg",
    "_m": "m",
    "_s": "s",
}


def _walk(table: BaseModel, prefix: str) -> Iterator[Assumption]:
    for key in type(table).model_fields:
        value = getattr(table, key)
        if isinstance(value, BaseModel):
            yield from _walk(value, f"{prefix}.{key}")
        elif isinstance(value, dict):
            for name, entry in value.items():
                if isinstance(entry, BaseModel):
                    yield from _walk(entry, f"{prefix}.{key}.{name}")
                else:
                    yield Assumption(f"{prefix}.{key}.{name}", str(entry), "", "cell", Certainty.DECLARED)
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            for number, entry in enumerate(value):
                yield from _walk(entry, f"{prefix}.{key}.{number}")
        elif value is not None and value not in ((), ""):
            declared = key in table.model_fields_set
            number = isinstance(value, float) and not isinstance(value, bool)
            unit = next((unit for ending, unit in _UNITS.items() if key.endswith(ending)), "")
            yield Assumption(
                f"{prefix}.{key}",
                float(value) if number else _text(value),
                "" if isinstance(value, str) else unit,  # a word in place of a number, as "measured"
                "cell" if declared else "default of this software",
                Certainty.DECLARED if declared else Certainty.DEFAULT,
            )


def _text(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, tuple | list) else str(value)
