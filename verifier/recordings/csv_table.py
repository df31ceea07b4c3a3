"""CSV tables (``.csv``, ``.csv.gz``).

Joints: ``t,<joint>,…``; people: ``t,person,<point>_x,<point>_y,<point>_z,…``; ``person`` may be left away
when there is only one. Comma, semicolon, tab or blank between the columns, one header line.
"""

from __future__ import annotations

import csv
import gzip
import math
import zlib
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
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
JOINT_COLUMNS = "t,<joint>,<joint>,…"
PEOPLE_COLUMNS = "t,person,<point>_x,<point>_y,<point>_z,…"


def read_joints(path: str | Path) -> JointTable:
    """Read joint motion.

    Raises
    ------
    RecordingError
        The file is not readable, has a wrong or double column, text in a number cell, NaN or infinite values,
        or times that do not increase.
    """
    path = Path(path)
    with _rows(path) as (header, rows):
        _check_header(path, header, JOINT_COLUMNS)
        joints = tuple(name for name in header if name != TIME)
        if not joints:
            _refuse(path, "line 1", "has no joint column", JOINT_COLUMNS)
        values = array("d")
        for line, row in rows:
            values.extend(_finite(path, line, name, cell) for name, cell in zip(header, row, strict=True))
    table = np.frombuffer(values, np.float64).reshape(-1, len(header))
    if not len(table):
        _refuse(path, "", "is empty", "there must be rows below the header")
    t = table[:, header.index(TIME)]
    q = table[:, [header.index(name) for name in joints]]
    t_ns = nanoseconds(path, TIME, t, float(t[0]))
    check_joints(path, "", joints, t, q)
    check_unit(path, TIME, t, MAX_JOINT_STEP_S, whole=True)
    return JointTable(path, t_ns, joints, q, begins_s=float(t[0]))


def read_text(path: str | Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Read the header, and the cells of all rows as text, each row with its line number.

    Raises
    ------
    RecordingError
        The file is not readable, is empty, or has rows of another length than its header.
    """
    path = Path(path)
    with _rows(path) as (header, rows):
        found = list(rows)
    if not found:
        _refuse(path, "", "is empty", "there must be rows below the header")
    return header, found


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
        for line, row in rows:
            who = None if person is None else row[person] or None
            cells = values.setdefault(who, array("d"))
            cells.append(_finite(path, line, TIME, row[time]))
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


@contextmanager
def _rows(path: Path) -> Iterator[tuple[list[str], Iterator[tuple[int, list[str]]]]]:
    """The header, and the rows with their line numbers."""
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
            yield header, _cells(path, lines, delimiter, len(header))
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


def _cells(path: Path, lines: Iterator[str], delimiter: str, columns: int) -> Iterator[tuple[int, list[str]]]:
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    for number, row in enumerate(reader, 1):
        line = reader.line_num + 1
        if 8 * number * columns > MAX_TABLE_BYTES:
            _refuse(path, f"line {line}", f"goes on beyond {MAX_TABLE_BYTES // 8} numbers", "split the file")
        cells = [cell.strip() for cell in row]
        if not any(cells):
            continue
        if len(cells) != columns:
            _refuse(path, f"line {line}", f"has {len(cells)} cells", f"the header has {columns} columns")
        yield line, cells


def _check_header(path: Path, header: list[str], columns: str) -> None:
    if TIME not in header:
        shown = ",".join(header[:6]) + (",…" if len(header) > 6 else "")
        _refuse(
            path, "line 1", f"has no column {TIME} (it has {shown})", f"the columns must be {columns}, t in s"
        )
    for name in header:
        if not name:
            _refuse(path, "line 1", "has a column without a name", f"the columns must be {columns}")
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


def _finite(path: Path, line: int, column: str, cell: str) -> float:
    value = number(path, line, column, cell)
    if not math.isfinite(value):
        right = "every time and position must be a number"
        _refuse(path, f"line {line}, column {column}", f"is {value}", right)
    return value


def _refuse(path: Path, place: str, wrong: str, right: str) -> NoReturn:
    raise RecordingError(path, place, wrong, right)
