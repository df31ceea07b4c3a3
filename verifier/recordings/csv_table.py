"""CSV tables (``.csv``, ``.csv.gz``).

Joints: ``t,<joint>,…``, with ``<joint>_velocity`` and ``<joint>_command`` beside them; people:
``t,person,<point>_x,<point>_y,<point>_z,…``; ``person`` may be left away when there is only one. Comma,
semicolon, tab or blank between the columns, one header line.
"""

from __future__ import annotations

import csv
import gzip
import math
import zlib
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import NoReturn, TextIO

import numpy as np

from verifier.recordings.errors import RecordingError
from verifier.recordings.table import (
    MAX_JOINT_STEP_S,
    MAX_PEOPLE_STEP_S,
    MAX_TABLE_BYTES,
    FloatArray,
    JointTable,
    PeopleTable,
    Track,
    check_joints,
    check_unit,
    nanoseconds,
)

TIME = "t"
PERSON = "person"
AXES = ("_x", "_y", "_z")
MAX_LINE = 1 << 20
"""Characters of a line; a packed file may hold a line that does not fit into memory."""
DELIMITERS = (",", ";", "\t", " ")
JOINT_COLUMNS = "t,<joint>,…,<joint>_velocity,…,<joint>_command,…"
VELOCITY, COMMAND = "_velocity", "_command"
PEOPLE_COLUMNS = "t,person,<point>_x,<point>_y,<point>_z,…"


Reader = Callable[[Path, int, str, str], float]
"""Reads a cell: file, line, column, text -> number."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns that were read.

    Attributes
    ----------
    header:
        Every column of the file.
    values:
        Column -> its numbers, shape (T,).
    left_out:
        Rows that are not among them because a cell was empty.
    """

    header: tuple[str, ...]
    values: Mapping[str, FloatArray]
    left_out: int

    def table(self, columns: Sequence[str]) -> FloatArray | None:
        """Return columns beside each other (T, J); ``None``: they were not all read, or there are none."""
        if not columns or not set(columns) <= set(self.values):
            return None
        return np.column_stack([self.values[name] for name in columns])


def read_joints(path: str | Path) -> JointTable:
    """Read joint motion; every column is one of a joint.

    Raises
    ------
    RecordingError
        As :func:`read_joints_beside`.
    """
    return read_joints_beside(path, None, {})[0]


def read_joints_beside(
    path: str | Path, joints: Sequence[str] | None, states: Mapping[str, Reader]
) -> tuple[JointTable, Columns]:
    """Read joint motion, and what stands beside it.

    Parameters
    ----------
    joints:
        Joints that are wanted, in this order; ``None``: every one.
    states:
        Columns that are no joints, and how they are read.

    Raises
    ------
    RecordingError
        The file is not readable, has a wrong or double column, lacks a joint, has text in a number cell, NaN
        or infinite values, or times that do not increase.
    """
    path = Path(path)
    wanted: tuple[str, ...] = ()

    def choose(header: list[str]) -> dict[str, Reader]:
        nonlocal wanted
        _check_header(path, header, JOINT_COLUMNS)
        found = _joint_columns(header, states)
        wanted = tuple(found if joints is None else joints)
        if not found:
            _refuse(path, "line 1", "has no joint column", JOINT_COLUMNS)
        missing = [name for name in wanted if name not in found]
        if missing:
            wrong = f"lacks joint {', '.join(missing)} (it has {', '.join(found)})"
            right = f"choose the robot that was recorded; columns: {JOINT_COLUMNS}"
            _refuse(path, "line 1", wrong, right)
        beside = [name + ending for name in wanted for ending in (VELOCITY, COMMAND)]
        numbers = (TIME, *wanted, *(name for name in beside if name in header and name not in found))
        return {**dict.fromkeys(numbers, finite), **{k: v for k, v in states.items() if k in header}}

    columns = read_columns(path, choose)
    t, q = columns.values[TIME], columns.table(wanted)
    assert q is not None
    t_ns = nanoseconds(path, TIME, t, float(t[0]))
    check_joints(path, "", wanted, t, q)
    check_unit(path, TIME, t, MAX_JOINT_STEP_S, whole=True)
    dq, command = (columns.table([name + ending for name in wanted]) for ending in (VELOCITY, COMMAND))
    return JointTable(path, t_ns, wanted, q, dq, None, command, begins_s=float(t[0])), columns


def _joint_columns(header: Sequence[str], others: Mapping[str, Reader]) -> list[str]:
    """Columns that are joints: all but the time, ``others``, and what stands beside a joint."""
    names = [name for name in header if name != TIME and name not in others]
    return [
        name
        for name in names
        if not any(name.endswith(end) and name.removesuffix(end) in names for end in (VELOCITY, COMMAND))
    ]


def read_header(path: str | Path) -> tuple[str, ...]:
    """Read the names of the columns.

    Raises
    ------
    RecordingError
        The file is not readable, or has no header.
    """
    with _rows(Path(path)) as (header, _rows_of):
        return tuple(header)


def read_columns(
    path: str | Path, choose: Callable[[list[str]], Mapping[str, Reader]], *, skip_empty: bool = False
) -> Columns:
    """Read some columns; what is not wanted takes no memory.

    Parameters
    ----------
    choose:
        Told the header; returns the columns that are wanted, and how they are read.
    skip_empty:
        Rows in which a wanted cell is empty are left out and counted; else it is read like any other.

    Raises
    ------
    RecordingError
        The file is not readable or has no rows, or a cell is refused.
    """
    path = Path(path)
    left_out = 0
    with _rows(path) as (header, rows):
        wanted = choose(header)
        places = [(header.index(name), name, read) for name, read in wanted.items()]
        values = array("d")
        for line, row in rows(len(places)):
            if skip_empty and not all(row[place] for place, _name, _read in places):
                left_out += 1
            else:
                values.extend(read(path, line, name, row[place]) for place, name, read in places)
    table = np.frombuffer(values, np.float64).reshape(-1, len(places))
    if not len(table) and left_out:
        _refuse(path, "", f"no row has all of {', '.join(wanted)}", "fill them in")
    if not len(table):
        _refuse(path, "", "is empty", "there must be rows below the header")
    return Columns(tuple(header), dict(zip(wanted, table.T, strict=True)), left_out)


def read_people(path: str | Path) -> PeopleTable:
    """Read the points of people; an empty cell is a missing point.

    Raises
    ------
    RecordingError
        The file is not readable, has a wrong or double column, text in a number cell, or times of one person
        that do not increase.
    """
    path = Path(path)
    with _rows(path) as (header, rows):
        _check_header(path, header, PEOPLE_COLUMNS)
        names = _points(path, header)
        columns = [header.index(name + axis) for name in names for axis in AXES]
        time = header.index(TIME)
        person = header.index(PERSON) if PERSON in header else None
        values: dict[str | None, array[float]] = {}
        for line, row in rows(len(header)):
            if person is not None and not row[person]:
                _refuse(path, f"line {line}, column {PERSON}", "is empty", "name everybody, or leave it away")
            who = None if person is None else row[person]
            cells = values.setdefault(who, array("d"))
            cells.append(finite(path, line, TIME, row[time]))
            cells.extend(number(path, line, header[c], row[c]) if row[c] else math.nan for c in columns)
    if not values:
        _refuse(path, "", "is empty", "there must be rows below the header")
    tables = {
        who: np.frombuffer(cells, np.float64).reshape(-1, 1 + len(columns)) for who, cells in values.items()
    }
    start = min(float(table[0, 0]) for table in tables.values())
    tracks = tuple(_track(path, who, names, table, start) for who, table in tables.items())
    return PeopleTable(path, tracks, begins_s=start)


def _track(path: Path, who: str | None, names: tuple[str, ...], table: FloatArray, start: float) -> Track:
    place = TIME if who is None else f"{TIME} of person {who}"
    t_ns = nanoseconds(path, place, table[:, 0], start)
    check_unit(path, place, table[:, 0], MAX_PEOPLE_STEP_S)
    return Track(who, t_ns, names, table[:, 1:].reshape(-1, len(names), 3))


_RowsOf = Callable[[int], Iterator[tuple[int, list[str]]]]


@contextmanager
def _rows(path: Path) -> Iterator[tuple[list[str], _RowsOf]]:
    """The header, and the rows with their line numbers, of which so many columns are kept."""
    if path.is_dir():
        _refuse(path, "", "is a folder", "name a CSV file")
    try:
        with _opened(path) as stream:
            lines = _lines(path, stream)
            head = next(lines, "")
            delimiter = next((d for d in DELIMITERS if d in head.strip()), ",")
            header = [cell.strip() for cell in _reader([head], delimiter)[0]] if head.strip() else []
            if not header:
                _refuse(path, "", "is empty", "there must be a header line")
            yield header, lambda kept: _cells(path, lines, delimiter, header, kept)
    except FileNotFoundError as error:
        raise RecordingError(path, "", "does not exist", "name a CSV file") from error
    except UnicodeDecodeError as error:
        raise RecordingError(path, "", "is not a text file in UTF-8", "name a CSV file") from error
    except (OSError, EOFError, zlib.error, csv.Error) as error:
        raise RecordingError(path, "", f"cannot be read ({error})", "name a CSV file") from error


def _opened(path: Path) -> TextIO:
    if path.suffix == ".gz":
        return gzip.open(path, "rt", encoding="utf-8-sig", newline="")
    return path.open(encoding="utf-8-sig", newline="")


def _lines(path: Path, stream: TextIO) -> Iterator[str]:
    for number in count(1):
        line = stream.readline(MAX_LINE)
        if len(line) == MAX_LINE:
            _refuse(path, f"line {number}", f"has {MAX_LINE} characters or more", "a row is one line")
        if not line:
            return
        yield line


def _reader(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    return list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))


def _cells(
    path: Path, lines: Iterator[str], delimiter: str, header: list[str], kept: int
) -> Iterator[tuple[int, list[str]]]:
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    for number, row in enumerate(reader, 1):
        line = reader.line_num + 1
        if 8 * number * kept > MAX_TABLE_BYTES:
            _refuse(path, f"line {line}", f"goes on beyond {MAX_TABLE_BYTES // 8} numbers", "split the file")
        cells = [cell.strip() for cell in row]
        if not any(cells):
            continue
        if len(cells) != len(header):
            _refuse(path, f"line {line}", f"has {len(cells)} cells", f"the header has {len(header)} columns")
        if cells == header:
            _refuse(path, f"line {line}", "is the header again", "one recording a file: split it there")
        yield line, cells


def _check_header(path: Path, header: list[str], columns: str) -> None:
    if TIME not in header:
        shown = ",".join(header[:6]) + (",…" if len(header) > 6 else "")
        wrong = f"has no column {TIME} (it has {shown})"
        _refuse(path, "line 1", wrong, f"the columns must be {columns}, t in s")
    check_names(path, header, f"the columns must be {columns}")


def check_names(path: Path, header: Sequence[str], right: str = "name every column") -> None:
    """Refuse columns that have no name, or the same.

    Raises
    ------
    RecordingError
        A column is such a one.
    """
    for name in header:
        if not name:
            _refuse(path, "line 1", "has a column without a name", right)
        if header.count(name) > 1:
            _refuse(path, "line 1", f"has column {name} twice", "each column once")


def _points(path: Path, header: list[str]) -> tuple[str, ...]:
    names: dict[str, set[str]] = {}
    for column in header:
        if column in (TIME, PERSON):
            continue
        if column[-2:] not in AXES:
            _refuse(
                path, "line 1", f"has an unknown column {column}", f"the columns must be {PEOPLE_COLUMNS}"
            )
        names.setdefault(column[:-2], set()).add(column[-2:])
    if not names:
        _refuse(path, "line 1", "has no point", f"the columns must be {PEOPLE_COLUMNS}")
    for name, axes in names.items():
        lacking = [name + axis for axis in AXES if axis not in axes]
        if lacking:
            _refuse(path, "line 1", f"lacks column {lacking[0]}", f"the columns must be {PEOPLE_COLUMNS}")
    return tuple(names)


def number(path: Path, line: int, column: str, cell: str) -> float:
    """Return the number in a cell.

    Raises
    ------
    RecordingError
        There is none.
    """
    try:
        if "_" in cell:  # float() would read 1_000
            raise ValueError
        return float(cell)
    except ValueError:
        _refuse(
            path, f"line {line}, column {column}", f"{cell!r} is not a number", "write numbers with a point"
        )


def finite(path: Path, line: int, column: str, cell: str) -> float:
    """Return the finite number in a cell.

    Raises
    ------
    RecordingError
        There is none.
    """
    value = number(path, line, column, cell)
    if not math.isfinite(value):
        right = "every time and position must be a number"
        _refuse(path, f"line {line}, column {column}", f"is {value}", right)
    return value


def _refuse(path: Path, place: str, wrong: str, right: str) -> NoReturn:
    raise RecordingError(path, place, wrong, right)
