"""``/people``: reports about people in JSON, schema ``stopproof.People``, encoded and decoded.

::

    {"stamp": s, "frame": "world", "complete": bool, "unknown_points": ["nose"],
     "people": [{"id": "p1", "position_error_m": m,
                 "floor": {"xyz": [x, y, z], "error_m": m, "up": [0, 0, 1]},
                 "points": {"r_wrist": {"xyz": [x, y, z], "state": "measured"|"inferred", "error_m": m}}}]}

``stamp`` says when it was seen; the message time says when it arrived. ``position_error_m`` and ``error_m``
may be absent. ``complete`` says that nobody else is in the monitored regions; it may list those that it
speaks for. ``floor`` says where somebody stands of whom no more is known. ``unknown_points``, mostly absent,
are names that the source has and the writer did not know.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, POINT_NAMES
from occupancy.report import RawMeasurement, RawPerson
from verifier.recordings import json_text
from verifier.recordings.floor_position import pelvis_above

NANO = 1_000_000_000
MAX_STAMP_S = 2**63 / NANO
COLUMN = {name: column for column, name in enumerate(POINT_NAMES)}
STATES = ("measured", "inferred")
NAMELESS = "nameless"
WORLD = "world"
STAMP_NAME = "stamp"
PELVIS = "pelvis"
UNIT_ROUNDING = 1e-3
"""The length of a unit vector may be off by this from 1."""
MISSING = [math.nan] * 3
_STAMP_DIGITS = re.compile(rb'"stamp"\s*:\s*(-?)(\d{1,10})\.(\d{1,40})(?![\d.eE])')
NO_NAMES: Mapping[str, str] = {}


class ReportError(ValueError):
    """A message that is no report about people.

    Attributes
    ----------
    people:
        Who is named in it all the same.
    """

    def __init__(self, text: str, people: tuple[str, ...] = ()) -> None:
        self.people = people
        super().__init__(text)


class Flaw(NamedTuple):
    """Something in a report that was not taken: which person and point (``None``: all of it), and why."""

    stamp_ns: int
    person: str | None
    point: str | None
    reason: str


@dataclass(frozen=True, slots=True)
class ReportedPerson:
    """One person of a report.

    Attributes
    ----------
    id:
        The tracker's name for the person.
    xyz:
        Points in the order of :class:`occupancy.body.Point`, shape (20, 3) [m, frame of the report]; NaN:
        missing.
    error_m:
        Position error of each point, shape (20,) [m]; NaN: not stated.
    measured:
        Bit per point that was measured, not inferred.
    """

    id: str
    xyz: NDArray[np.float64]
    error_m: NDArray[np.float64]
    measured: int


@dataclass(frozen=True, slots=True)
class PeopleReport:
    """One message: when it was seen and arrived [ns], in which frame, who was seen, what was not taken.

    ``mapped_points``: names in it that the map from names of the recording to ours has.
    ``known_points`` says whether anybody in it has a point by a known name, be it readable or not;
    ``readable`` is false where nothing is known but who was in it.
    """

    stamp_ns: int
    arrived_ns: int
    frame: str
    complete: bool
    people: tuple[ReportedPerson, ...]
    flaws: tuple[Flaw, ...] = ()
    unknown_points: frozenset[str] = frozenset()
    known_points: bool = False
    mapped_points: frozenset[str] = frozenset()
    readable: bool = True

    @property
    def seen_by_ns(self) -> int:
        """Instant by which its people had been seen [ns]: a stamp may lie ahead of the arrival."""
        return min(self.stamp_ns, self.arrived_ns)

    def measurement(self, epoch_ns: int) -> RawMeasurement:
        """Return the report as the gate takes it, times in seconds since ``epoch_ns``."""
        return RawMeasurement(
            stamp=(self.stamp_ns - epoch_ns) / NANO,
            arrived=(self.arrived_ns - epoch_ns) / NANO,
            frame=self.frame,
            complete=self.complete,
            people=tuple(RawPerson(p.id, p.xyz, p.error_m, p.measured) for p in self.people),
        )


def unreadable(arrived_ns: int, people: Iterable[str]) -> PeopleReport:
    """Return what is left of a report that cannot be read: by when who was there, nobody knows where."""
    nothing = np.full(MAX_POINTS, math.nan)
    known = tuple(ReportedPerson(name, np.full((MAX_POINTS, 3), math.nan), nothing, 0) for name in people)
    return PeopleReport(arrived_ns, arrived_ns, WORLD, False, known, readable=False)


def encode(report: PeopleReport) -> bytes:
    """Encode one report; missing points are left out, errors that are not stated too."""
    people = [_person_to_json(person) for person in report.people]
    message: dict[str, Any] = {"frame": report.frame, "complete": report.complete, "people": people}
    if report.unknown_points:
        message["unknown_points"] = sorted(report.unknown_points)
    rest = json.dumps(message, separators=(",", ":"), allow_nan=False)
    return f'{{"stamp":{decimal(report.stamp_ns)},{rest[1:]}'.encode()


def decimal(time_ns: int) -> str:
    """Return seconds with all nine decimals: as a double, a stamp since 1970 would be 0.24 µs coarse."""
    whole, fraction = divmod(abs(time_ns), NANO)
    return f"{'-' if time_ns < 0 else ''}{whole}.{fraction:09d}"


def _person_to_json(person: ReportedPerson) -> dict[str, Any]:
    """The error that most points have in common stands once, with the person."""
    seen = np.isfinite(person.xyz).all(axis=1)
    errors = person.error_m[seen & np.isfinite(person.error_m)]
    common = float(errors[0]) if len(errors) == seen.sum() and len(errors) else None
    points: dict[str, Any] = {}
    for column in np.flatnonzero(seen):
        state = "measured" if person.measured >> int(column) & 1 else "inferred"
        point: dict[str, Any] = {"xyz": person.xyz[column].tolist(), "state": state}
        error = float(person.error_m[column])
        if math.isfinite(error) and error != common:
            point["error_m"] = error
        points[POINT_NAMES[column]] = point
    shared = {} if common is None else {"position_error_m": common}
    return {"id": person.id, **shared, "points": points}


def decode(
    data: bytes, arrived_ns: int, names: Mapping[str, str] = NO_NAMES, regions: Collection[str] = ()
) -> PeopleReport:
    """Decode one message; ``names`` maps the recording's point names to ours.

    ``regions``: names of the monitored regions, all of which a report must speak for to be complete.

    What is wrong with one person or point is listed in ``flaws``; the point is left out, the person stays,
    if need be without points. NaN, infinite and zero coordinates are kept: the gate judges
    them.

    Raises
    ------
    ReportError
        The message as a whole is no report; ``people`` says who is named in it.
    """
    try:
        return _decoded(data, arrived_ns, names, regions)
    except ReportError as error:
        raise ReportError(str(error), _named(data)) from error
    except RecursionError as error:
        raise ReportError("nested too deeply", _named(data)) from error


def _decoded(
    data: bytes, arrived_ns: int, names: Mapping[str, str], regions: Collection[str]
) -> PeopleReport:
    message = _parse(data)
    stamp_ns = stamp_of(message.get("stamp"), data)
    frame, complete, entries = message.get("frame"), message.get("complete", False), message.get("people")
    if not isinstance(frame, str):
        raise ReportError('"frame" must name the coordinate frame, e.g. "world"')
    spoken_for = _regions(complete, regions)
    if not isinstance(entries, list):
        raise ReportError('"people" must be a list')
    reader = _PersonReader(stamp_ns, names)
    people = [reader.read(entry) for entry in entries]
    return PeopleReport(
        stamp_ns,
        arrived_ns,
        frame,
        _is_complete(complete, spoken_for, regions),
        tuple(people),
        (*reader.flaws, *_unknown_regions(spoken_for, regions, stamp_ns)),
        frozenset(reader.unknown.union(_unknown_points(message.get("unknown_points")))),
        reader.known,
        frozenset(reader.mapped),
    )


def _regions(complete: object, regions: Collection[str]) -> set[str]:
    """Names of the regions that a report is complete for."""
    if isinstance(complete, bool):
        return set(regions) if complete else set()
    if not isinstance(complete, list) or not all(isinstance(name, str) for name in complete):
        raise ReportError('"complete" must be true or false, or the list of the regions that it speaks for')
    return set(complete)


def _is_complete(complete: object, spoken_for: set[str], regions: Collection[str]) -> bool:
    """Whether a report lists everybody in all regions; one that names regions says nothing of others."""
    if isinstance(complete, bool):
        return complete
    return bool(regions) and set(regions) <= spoken_for


def _unknown_points(names: object) -> Iterator[str]:
    """Yield the names that the writer did not know; nothing else rests on them."""
    if isinstance(names, list):
        yield from (name for name in names if isinstance(name, str))


def _unknown_regions(spoken_for: set[str], regions: Collection[str], stamp_ns: int) -> Iterator[Flaw]:
    """Yield that a report speaks for regions that the cell, which has some, does not have."""
    unknown = sorted(spoken_for - set(regions)) if regions else []
    if unknown:
        reason = f"complete for {_short(unknown)}: the cell monitors {', '.join(sorted(regions))}"
        yield Flaw(stamp_ns, None, None, reason)


def _parse(data: bytes) -> dict[str, Any]:
    try:
        message = json_text.loads(data)
    except json_text.JsonError as error:
        raise ReportError(str(error)) from error
    if not isinstance(message, dict):
        raise ReportError("not a JSON object")
    return message


def _named(data: bytes) -> tuple[str, ...]:
    """Everybody whom a message names that is no report; without an id, but listed as a person: nameless."""
    names: dict[str, None] = {}

    def note(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        for key, value in pairs:
            if key == "id" and isinstance(value, str):
                names[value or NAMELESS] = None
            elif key == "people" and value:
                entries = value if isinstance(value, list) else [value]
                if not all(isinstance(entry, dict) and isinstance(entry.get("id"), str) for entry in entries):
                    names[NAMELESS] = None
        return dict(pairs)

    with suppress(ValueError, RecursionError):
        json.loads(data, object_pairs_hook=note, parse_int=float)  # numbers of any length
        return tuple(names)
    return ()


def stamp_of(value: object, data: bytes) -> int:
    """Return a stamp [ns], from the number's own digits in ``data`` where these can be found.

    Raises
    ------
    ReportError
        It is no number of seconds.
    """
    seconds = _number(value)
    if seconds is None or not abs(seconds) < MAX_STAMP_S:
        raise ReportError(f'"stamp" must be a number of seconds, not {_short(value)}')
    for sign, whole, fraction in _STAMP_DIGITS.findall(data):
        exact = int(whole) * NANO + int(fraction[:9].ljust(9, b"0"))
        exact = -exact if sign else exact
        if exact / NANO == seconds:
            return int(exact)
    return round(seconds * NANO)


def _number(value: object) -> float | None:
    """A JSON number as float; ``None`` for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


class _PersonReader:
    """Reads the people of one report and notes what is wrong with them."""

    def __init__(self, stamp_ns: int, names: Mapping[str, str]) -> None:
        self.stamp_ns = stamp_ns
        self.names = names
        self.flaws: list[Flaw] = []
        self.unknown: set[str] = set()
        self.mapped: set[str] = set()
        self.known = False
        self._ids: set[str] = set()
        self._times: dict[str, int] = {}

    def read(self, entry: object) -> ReportedPerson:
        """Read one person; somebody of whom nothing can be read is still there, without points."""
        if not isinstance(entry, dict) or not isinstance(entry.get("id"), str):
            raise ReportError('a person must be an object with an "id" text')
        name = self._unique(entry["id"] or NAMELESS)
        points = entry.get("points", {} if "floor" in entry else None)
        if not isinstance(points, dict):
            self._refuse(name, None, '"points" must be an object')
            return self._person(name, {}, math.nan)
        unknown = {point for point in points if self.names.get(point, point) not in COLUMN}
        self.unknown |= unknown
        if self.names:
            self.mapped.update(points.keys() & self.names.keys())
        self.known = self.known or len(unknown) < len(points) or "floor" in entry
        try:
            error = _error(entry.get("position_error_m"))
        except ReportError as wrong:
            self._refuse(name, None, f'"position_error_m" {wrong}')
            return self._person(name, {}, math.nan)
        if len(unknown) == len(points) and "floor" not in entry:
            reason = f"no known point name among {_short(sorted(unknown))}" if points else '"points" are none'
            self._refuse(name, None, reason)
        person = self._person(name, points, math.nan if error is None else error)
        return self._on_floor(person, entry["floor"], points) if "floor" in entry else person

    def _on_floor(self, person: ReportedPerson, floor: object, points: dict[str, Any]) -> ReportedPerson:
        """Add the pelvis of somebody who stands somewhere."""
        if any(self.names.get(point, point) == PELVIS for point in points):
            person.xyz[COLUMN[PELVIS]] = MISSING
            self._refuse(person.id, PELVIS, "the point is given twice: as a point, and by the floor")
            return replace(person, measured=person.measured & ~(1 << COLUMN[PELVIS]))
        try:
            xyz, error_m = _read_floor(floor)
        except ReportError as wrong:
            self._refuse(person.id, None, f'"floor" {wrong}')
            return person
        person.xyz[COLUMN[PELVIS]], person.error_m[COLUMN[PELVIS]] = xyz, error_m
        return replace(person, measured=person.measured | 1 << COLUMN[PELVIS])

    def _unique(self, name: str) -> str:
        """An id that is given twice names two people: neither may vanish behind the other."""
        unique, n = name, self._times.get(name, 1)
        while unique in self._ids:
            n += 1
            unique = f"{name} ({n})"
        self._times[name] = n
        if n > 1:
            self._refuse(name, None, f"the id stands twice in one report: the second is kept as {unique!r}")
        self._ids.add(unique)
        return unique

    def _person(self, person: str, points: dict[str, Any], error: float) -> ReportedPerson:
        xyz, errors = [MISSING] * MAX_POINTS, [math.nan] * MAX_POINTS
        measured = taken = 0
        for given, entry in points.items():
            name = self.names.get(given, given)
            column = COLUMN.get(name)
            if column is None:
                continue
            if taken >> column & 1:
                xyz[column] = MISSING
                measured &= ~(1 << column)
                self._refuse(person, name, "the point is given twice under different names")
                continue
            taken |= 1 << column
            try:
                xyz[column], own = _read_point(entry)
            except ReportError as wrong:
                self._refuse(person, name, str(wrong))
                continue
            errors[column] = error if own is None else own
            measured |= (entry["state"] == "measured") << column
        return ReportedPerson(person, np.array(xyz), np.array(errors), measured)

    def _refuse(self, person: str | None, point: str | None, reason: str) -> None:
        self.flaws.append(Flaw(self.stamp_ns, person, point, reason))


def _error(value: object) -> float | None:
    """Read a position error [m]; ``None``: it is not stated."""
    if value is None:
        return None
    error = _number(value)
    if error is None or not 0.0 <= error < math.inf:
        raise ReportError(f"must be at least 0 m, not {_short(value)}")
    return error


def _read_floor(floor: object) -> tuple[NDArray[np.float64], float]:
    """Read where somebody stands as a pelvis [m] and its error [m]; NaN for a place that is missing."""
    if not isinstance(floor, dict) or "error_m" not in floor:
        raise ReportError('must be an object with "xyz" and "error_m"')
    place, error_m = _coordinates(floor.get("xyz")), _error(floor["error_m"])
    if error_m is None:
        raise ReportError('needs "error_m", a number')
    if not any(place):
        return np.array(MISSING), error_m
    if "up" not in floor:
        return pelvis_above(place, error_m)
    up = np.array(_coordinates(floor["up"]))
    length = float(np.linalg.norm(up))
    if not abs(length - 1.0) <= UNIT_ROUNDING:
        raise ReportError(f'has "up" {_short(floor["up"])}: it must be a unit vector')
    return pelvis_above(place, error_m, up / length)


def _read_point(entry: object) -> tuple[list[float], float | None]:
    """Read coordinates [m], NaN for null, and the point's own error [m]."""
    if not isinstance(entry, dict) or entry.get("state") not in STATES:
        raise ReportError('a point must be an object with "xyz" and "state": "measured" or "inferred"')
    xyz = _coordinates(entry.get("xyz"))
    try:
        return xyz, _error(entry.get("error_m"))
    except ReportError as error:
        raise ReportError(f'"error_m" {error}') from error


def _coordinates(values: object) -> list[float]:
    """Read three numbers; NaN for null."""
    if not isinstance(values, list) or len(values) != 3:
        raise ReportError(f'"xyz" must be three numbers, not {_short(values)}')
    xyz = []
    for value in values:
        number = math.nan if value is None else _number(value)
        if number is None:
            raise ReportError(f'"xyz" must be three numbers, not {_short(values)}')
        xyz.append(number)
    return xyz
