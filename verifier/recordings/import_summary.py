"""What an import did, and what of its files should be looked at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from occupancy.body import POINT_NAMES
from robots.assumption import Assumption
from verifier.recordings.inspection import assumption_line
from verifier.shown import LONGEST_VALUE, shown

NOT_COMPLETE = (
    'no imported report is marked "complete", because nobody said that nobody else was there: whoever was '
    "reported once never leaves, a report that lists nobody says nothing, and with a monitored region in the "
    'cell nothing is verified; if the source does list everybody, write "complete": true into its reports on '
    "/people (docs/recordings.md)"
)


class LeftOut(NamedTuple):
    """``number`` of ``total`` samples or reports of a file are outside of the stretch that all cover."""

    number: int
    total: int
    what: str
    file: str


@dataclass(frozen=True, slots=True)
class ImportSummary:
    """What an import did.

    Attributes
    ----------
    path:
        The new recording.
    joints, extra_joints:
        Joints of the robot, and joints of the file that the robot does not have (they are kept).
    people:
        Names given to the persons of the recording.
    unknown_points:
        Point names that are neither ours nor mapped; they are ignored.
    missing_points:
        Points that were NaN, infinite or exactly zero, and are left out.
    unreadable_reports:
        Reports of an MCAP of which only the names of the people in them could be taken, if any.
    refused, first_refused:
        Persons and points of other reports of an MCAP that could not be read, and the first of them.
    left_out:
        What of each file is outside of the stretch that all files cover, where anything is.
    joint_samples, reports:
        Messages written.
    duration_s:
        Length of the stretch that all files cover [s].
    assumptions:
        What was assumed; also written into the recording.
    notes:
        What follows from how the files were put together.
    remarks:
        What should be looked at.
    """

    path: Path
    joints: tuple[str, ...]
    extra_joints: tuple[str, ...]
    people: tuple[str, ...]
    unknown_points: tuple[str, ...]
    missing_points: int
    unreadable_reports: int
    refused: int
    first_refused: str
    left_out: tuple[LeftOut, ...]
    joint_samples: int
    reports: int
    duration_s: float
    assumptions: tuple[Assumption, ...]
    notes: tuple[str, ...]
    remarks: tuple[str, ...]

    def lines(self) -> list[str]:
        """Return everything as text."""
        lines = [
            f"{self.path}: {self.duration_s:.3f} s, {self.joint_samples} samples, {self.reports} reports",
            f"people: {', '.join(map(shown, self.people)) or 'none'}",
            *self._not_taken(),
            *map(assumption_line, self.assumptions),
            *(f"look at: {remark}" for remark in (*self._unknown_points(), *self.remarks)),
            *(f"note: {note}" for note in self.notes),
        ]
        return [*lines, f"note: {NOT_COMPLETE}"] if self.reports else lines

    def _unknown_points(self) -> list[str]:
        if not self.unknown_points:
            return []
        names, first = ", ".join(map(shown, self.unknown_points)), shown(self.unknown_points[0])
        return [
            f"point names that are not known and were ignored: {names}; --point-name {first}=OURS takes one "
            f"as ours, which are {', '.join(POINT_NAMES)}"
        ]

    def _not_taken(self) -> list[str]:
        lines = [
            f"outside of the stretch that all files cover and left out: {part.number} of {part.total} "
            f"{part.what} of {shown(part.file)}"
            for part in self.left_out
        ]
        if self.extra_joints:
            lines.append(
                f"joints of the file that the robot does not have: {', '.join(map(shown, self.extra_joints))}"
            )
        if self.missing_points:
            lines.append(f"points that were NaN, infinite or zero and were left out: {self.missing_points}")
        if self.unreadable_reports:
            lines.append(
                f"reports that could not be read but for the names in them: {self.unreadable_reports}"
            )
        if self.refused:
            lines.append(
                f"persons and points that could not be read and were left out: {self.refused}, "
                f"the first: {shown(self.first_refused, LONGEST_VALUE)}"
            )
        return lines
