"""What the reports about people of a recording come to, for whoever reads a verdict that rests on them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from occupancy.measurement import Gate
from occupancy.report import RawMeasurement, RawPerson
from verifier.recordings import Recording
from verifier.recordings.people_stream import PeopleStream
from verifier.recordings.topic import PEOPLE_TOPIC
from verifier.shown import shown

QUICK_S = 0.1
"""Joint samples that are recorded within this time [s] of their stamps are no late ones."""
_NAMED = 3


class Reported:
    """Collects, window by window, what no single cycle shows.

    Attributes
    ----------
    somebody:
        Whether any report lists anybody, readable or not.
    default_error:
        Whether a point came without an error of its own, so that the default may have been used for it.

    ``monitored``: whether regions are watched, so that nobody comes in unnoticed.
    """

    def __init__(self, gate: Gate, *, monitored: bool) -> None:
        self._gate, self._monitored = gate, monitored
        self.somebody = False
        self.default_error = False
        self._ahead = 0
        self._most_ahead_s = 0.0

    def add(self, reports: Iterable[RawMeasurement]) -> None:
        """Take in reports, each once."""
        for report in reports:
            self.somebody = self.somebody or len(report.people) > 0
            self.default_error = self.default_error or lacks_errors((report,))
            if self._gate.is_ahead(report):
                self._ahead += 1
                self._most_ahead_s = max(self._most_ahead_s, report.stamp - report.arrived)

    def lines(self, unreadable: int) -> Iterator[str]:
        """Yield what a reader must know; ``unreadable``: how much of the reports could not be decoded."""
        if not self.somebody:
            report = "report that can be read" if unreadable else "report"
            why = "on A5, and on the proof that nobody comes in" if self._monitored else "on A5 alone"
            yield f"no {report} lists anybody: that nobody was there rests {why}"
        if self._ahead:
            yield (
                f"{self._ahead} reports were refused because they are stamped after they arrived, by up to "
                f"{self._most_ahead_s:.4g} s: if the sensors' clock may be so far from the robot's, declare "
                "people.clock_error_s"
            )


def not_looked_at(recording: Recording, point_names: Mapping[str, str]) -> Iterator[str]:
    """Yield how many reports of a recording list people, if any do; reads them all."""
    if not recording.has_people:
        return
    stream = PeopleStream(recording.file, recording.left_to_map(point_names))
    reports, who = 0, dict[str, None]()
    for message in recording.file.messages([PEOPLE_TOPIC]):
        report = stream.report(message)
        if report is not None and report.people:
            reports += 1
            who |= dict.fromkeys(person.id for person in report.people)
    if reports:
        names = ", ".join([*list(who)[:_NAMED], *(["…"] if len(who) > _NAMED else [])])
        yield f"the recording has {reports} reports that list people ({names}): not looked at"


def late_joints(behind_s: float, clock_error_s: float) -> Iterator[str]:
    """Yield by how much all joint samples are stamped before they were recorded, if that is much [s]."""
    if behind_s > clock_error_s + QUICK_S:
        yield (
            f"every joint sample was recorded {behind_s:.3g} s after its stamp, or later: if that is a clock "
            "which is slow, people were judged beside the arm of another instant; "
            "state joints_time_offset_s then"
        )


def not_read(recording: Recording) -> Iterator[str]:
    """Yield which topics of a recording speak of people and are not read: whoever is only there is nobody."""
    if recording.unread_people:
        names = ", ".join(f"{topic.name} ({topic.schema})" for topic in recording.unread_people)
        yield f"people on other topics were not read, and are nobody for the check: {names}"


def moving_frames(recording: Recording) -> Iterator[str]:
    """Yield for which frames a cell states one pose while the transforms of a recording move them."""
    for name in recording.moving_frames:
        yield (
            f"frame {shown(name)} moves by /tf of the recording, and people.frames states one pose for it: "
            "name recording.base_frame, and the pose is held against the transforms"
        )


def lacks_errors(reports: Iterable[RawMeasurement]) -> bool:
    """Whether a point in some report comes without an error of its own."""
    return any(_lacks_an_error(person) for report in reports for person in report.people)


def _lacks_an_error(person: RawPerson) -> bool:
    return bool((np.isnan(person.error_m) & np.isfinite(person.xyz[:, 0])).any())
