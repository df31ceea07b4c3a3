"""Motion capture as the mocap4r2 drivers publish it: markers, or rigid bodies, with names.

Which marker is which of our points is a matter of how people were dressed: ``people.point_names`` of the cell
says so. ``alice:r_wrist`` and ``alice/r_wrist`` are of the person ``alice``, who is there whether the name is
known or not; names without are all of one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from occupancy.body import MAX_POINTS, POINT_NAMES
from robots.assumption import Assumption
from verifier.recordings.decoded import Decoded, SourceError
from verifier.recordings.people_report import COLUMN, Flaw, ReportedPerson
from verifier.recordings.people_sources.source import (
    Header,
    ReportMaker,
    Reports,
    SourceOptions,
    field_of,
    header_of,
)

ONE_PERSON = "p1"
USE_INDEX = 1
"""``id_type`` of mocap4r2_msgs/msg/Marker.msg for markers that have a number and no name."""
SHOWN = 12

Named = tuple[str, Any]


class _NamedPoints:
    """People from named points; names are looked up whole, then without the person."""

    def __init__(self, options: SourceOptions, title: str) -> None:
        self._names: Mapping[str, str] = options.point_names
        self._maker = ReportMaker(title, must_be_seen=False)
        self._met: dict[str, None] = {}
        self._known = self._named = self._nameless = False
        self._not_said: set[str] = set()
        self._last: tuple[Decoded, Header] | None = None

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Nothing is assumed: the cell says which marker is which point."""
        return ()

    def finish(self) -> Reports:
        """Return the names that no report has said, and judge; see :class:`PeopleAdapter`."""
        if self._met and not self._known:
            names = list(self._met)
            shown = ", ".join(names[:SHOWN]) + (", …" if len(names) > SHOWN else "")
            raise SourceError(
                f"no marker has a known name (it has {shown}); people.point_names of the cell maps them to "
                f"{', '.join(POINT_NAMES)}"
            )
        if not self._not_said or self._last is None:
            return self._maker.finish()
        return (*self._say(*self._last, (), ()), *self._maker.finish())

    def _report(self, message: Decoded, named: Iterable[Named]) -> Reports:
        header = header_of(message.value)
        people: dict[str, dict[int, list[Any]]] = {}
        unknown = set()
        for name, position in named:
            self._met.setdefault(name, None)
            person, column = self._look_up(name)
            self._note(person, column)
            if column is not None:
                people.setdefault(person or ONE_PERSON, {}).setdefault(column, []).append(position)
                self._known = True
                continue
            unknown.add(name)
            if person is not None:
                people.setdefault(person or ONE_PERSON, {})
        self._not_said |= unknown
        self._last = message, header
        if not people and unknown:
            return ()
        flaws: list[Flaw] = []
        listed = [_person(name, points, header.stamp_ns, flaws) for name, points in people.items()]
        return self._say(message, header, listed, flaws)

    def _say(
        self, message: Decoded, header: Header, people: Iterable[ReportedPerson], flaws: Iterable[Flaw]
    ) -> Reports:
        unknown, self._not_said = self._not_said, set()
        return self._maker.report(message, header, people, flaws, unknown)

    def _note(self, person: str | None, column: int | None) -> None:
        """Two people must not become one: those who have no name share that of one who may have it."""
        self._named = self._named or person == ONE_PERSON
        self._nameless = self._nameless or (not person and column is not None)
        if self._named and self._nameless:
            raise SourceError(
                f"markers without a person would be of {ONE_PERSON}, who is there too; give all a person"
            )

    def _look_up(self, name: str) -> tuple[str | None, int | None]:
        """Return whom a name says, and our point; ``None``: it says none."""
        parts = re.split(r"[:/]", name, maxsplit=1)
        person, own = (parts[0], parts[1]) if len(parts) > 1 else (None, name)
        mapped = self._names.get(name, self._names.get(own, own))
        return person, COLUMN.get(mapped)


class Mocap4r2Markers(_NamedPoints):
    """Reads ``Markers``; one report per message. A marker without a name is called by its number."""

    schemas = ("mocap4r2_msgs/msg/Markers",)

    def __init__(self, options: SourceOptions) -> None:
        super().__init__(options, "the markers")

    def read(self, message: Decoded) -> Reports:
        """Return the report about the people of a message; see :class:`PeopleAdapter`."""
        markers = field_of(message.value, "markers")
        return self._report(message, [(_marker_name(m), field_of(m, "translation")) for m in markers])


class Mocap4r2RigidBodies(_NamedPoints):
    """Reads ``RigidBodies``; one report per message. A point is the origin of a body, as it was set up."""

    schemas = ("mocap4r2_msgs/msg/RigidBodies",)

    def __init__(self, options: SourceOptions) -> None:
        super().__init__(options, "the rigid bodies")

    def read(self, message: Decoded) -> Reports:
        """Return the report about the people of a message; see :class:`PeopleAdapter`."""
        bodies = field_of(message.value, "rigidbodies")
        named = [(str(field_of(b, "rigid_body_name")), field_of(b, "pose.position")) for b in bodies]
        return self._report(message, named)


def _marker_name(marker: Any) -> str:
    if int(field_of(marker, "id_type")) == USE_INDEX:
        return str(field_of(marker, "marker_index"))
    return str(field_of(marker, "marker_name"))


def _person(name: str, points: dict[int, list[Any]], stamp_ns: int, flaws: list[Flaw]) -> ReportedPerson:
    xyz = np.full((MAX_POINTS, 3), np.nan)
    measured = 0
    for column, positions in points.items():
        place = np.array([field_of(positions[0], axis) for axis in "xyz"], np.float64)
        if len(positions) > 1:
            flaws.append(Flaw(stamp_ns, name, POINT_NAMES[column], "the point is given twice"))
        elif np.isfinite(place).all() and place.any():
            xyz[column] = place
            measured |= 1 << column
    return ReportedPerson(name, xyz, np.full(MAX_POINTS, np.nan), measured)
