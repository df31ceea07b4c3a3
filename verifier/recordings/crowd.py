"""The people of one file of an import, put where and when they belong."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from robots.assumption import Assumption, Certainty
from verifier.recordings.errors import RecordingError
from verifier.recordings.import_summary import LeftOut
from verifier.recordings.joint_state import NANO
from verifier.recordings.likely_units import PeopleUnits
from verifier.recordings.people_report import WORLD, PeopleReport
from verifier.recordings.people_source import DEFAULT_POSITION_ERROR_M, PeopleFile, PeopleSource, Place
from verifier.recordings.people_sources.source import without_points
from verifier.recordings.standing import Standing
from verifier.shown import shown


class Crowd:
    """The reports of one file.

    Parameters
    ----------
    file, source:
        Where they come from.
    offset_ns:
        What makes times of the file times of the recording [ns].
    position_error_m:
        Of points whose file states none [m]; ``None``: nobody stated it.

    Attributes
    ----------
    people:
        Who is in the reports of the stretch, once these have been read.
    """

    def __init__(
        self, file: PeopleFile, source: PeopleSource, offset_ns: int, position_error_m: float | None
    ) -> None:
        self.file = file
        self.source = source
        self.people: dict[str, None] = {}
        self._offset_ns = offset_ns
        self._error = _position_error(file, source, position_error_m)
        self._units = PeopleUnits()
        self._standing = Standing()
        self._before: dict[str, None] = {}
        self._unplaced: dict[str, None] = {}
        self._written = self._outside = 0
        self._any_point = False

    @property
    def first_ns(self) -> int:
        """When the first report was seen [ns of the recording]."""
        return self.source.first_ns + self._offset_ns

    @property
    def last_ns(self) -> int:
        """When the last report was seen [ns of the recording]."""
        return self.source.last_ns + self._offset_ns

    @property
    def length_s(self) -> float:
        """Time from the first report to the last [s]."""
        return (self.last_ns - self.first_ns) / NANO

    @property
    def place(self) -> Assumption:
        """Where its frame stands."""
        place, name = self.file.place, f"recording.place.{self.file.path.name}"
        if place is None:
            source = "nobody stated it: the people's frame is taken to be the robot base"
            return Assumption(name, "0 0 0 0", "m m m deg", source, Certainty.DEFAULT)
        value = f"{place.x:g} {place.y:g} {place.z:g} {place.yaw_deg:g}"
        return Assumption(name, value, "m m m deg", "--place", Certainty.DECLARED)

    @property
    def error(self) -> Assumption:
        """Position error of points whose own is not stated."""
        return self._error

    @property
    def left_out(self) -> LeftOut:
        """The reports outside of the stretch that was asked for."""
        return LeftOut(self._outside, self._outside + self._written, "reports", self.file.path.name)

    def reports(self, first_ns: int, last_ns: int) -> Iterator[PeopleReport]:
        """Yield the reports that were seen in ``[first_ns, last_ns]``, once; read the others as well.

        Who was seen before, and is not in the first of them, is there all the same, nobody knows where.

        Raises
        ------
        RecordingError
            The file is refused; people are in the stretch, and no point of anybody could be read in it.
        """
        place, begun = self.file.place or Place(), False
        for report in self.source.reports(place, float(self._error.value)):
            self._units.add(report)
            stamp, arrived = report.stamp_ns + self._offset_ns, report.arrived_ns + self._offset_ns
            if not first_ns <= stamp <= last_ns:
                self._outside += 1
                if stamp < first_ns:
                    self._before |= dict.fromkeys(person.id for person in report.people)
                continue
            self._written += 1
            if not begun:
                yield from self._still_there(first_ns, {person.id for person in report.people})
            begun = True
            for person in report.people:
                self.people[person.id] = None
                if self.file.place is None:
                    self._standing.add(WORLD, person)
                self._any_point = self._any_point or bool(np.isfinite(person.xyz).any())
            yield PeopleReport(stamp, arrived, WORLD, False, report.people)
            yield from self._still_there(arrived)
        if not begun:
            yield from self._still_there(first_ns)
        if self.people.keys() - self._unplaced.keys() and not self._any_point:
            stretch = f"in the {(last_ns - first_ns) / NANO:.6g} s that all files cover"
            wrong = f"shows nobody {stretch}: no point of any person could be read"
            raise RecordingError(self.file.path, "", wrong, "coordinates must be numbers, and not 0, 0, 0")

    def _still_there(self, now_ns: int, named: Collection[str] = ()) -> Iterator[PeopleReport]:
        """Yield once that people are there who were seen before the stretch, but for the ``named``."""
        gone = [name for name in self._before if name not in self.people and name not in named]
        self._before = {}
        if gone:
            self.people |= dict.fromkeys(gone)
            self._unplaced |= dict.fromkeys(gone)
            yield PeopleReport(now_ns, now_ns, WORLD, False, tuple(map(without_points, gone)))

    def notes(self) -> Iterator[str]:
        """Yield where people stand if nobody said where their frame does, once the reports have been read."""
        frame = f"the frame of {shown(self.file.path.name)}"
        return self._standing.lines(f"the robot's base, as no --place says where {frame} stands")

    def remarks(self) -> Iterator[str]:
        """Yield what should be looked at, once the reports have been read."""
        yield from self._units.remarks(self.file.path.name)
        later = [name for name in self.source.counts.people if name not in self.people]
        where = f"{shown(self.file.path.name)}: seen"
        if later:
            names = ", ".join(map(shown, later))
            yield f"{where} only after the stretch that all files cover, and not in the recording: {names}"
        if self._unplaced:
            names = ", ".join(map(shown, self._unplaced))
            yield f"{where} before the stretch that all files cover, so there from its start on: {names}"


def _position_error(file: PeopleFile, source: PeopleSource, stated: float | None) -> Assumption:
    name = f"recording.position_error.{file.path.name}"
    if source.position_error_m is not None:
        return Assumption(name, source.position_error_m, "m", file.path.name, Certainty.DECLARED)
    if stated is not None:
        return Assumption(name, stated, "m", "--position-error", Certainty.DECLARED)
    return Assumption(
        name, DEFAULT_POSITION_ERROR_M, "m", "nobody stated it: default of this software", Certainty.DEFAULT
    )
