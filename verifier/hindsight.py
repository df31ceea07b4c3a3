"""What the rest of a recording says about a cycle: did people and robot keep to what was assumed?

A prediction is held against later samples of the same recording. A sample that lies outside although
profile and errors are all granted contradicts an assumption (docs/method.md, section 1); the cycle is then
*contradicted*, whatever its check had answered.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from occupancy.body import POINT_NAMES, Profile
from occupancy.conformance import LaterSamples, Outside, later_outside, later_too_large
from occupancy.humans.model import HumanModel
from occupancy.hypotheses import PLACES
from occupancy.measurement import Gate
from occupancy.report import LARGEST_S, RawMeasurement, Reading
from occupancy.sets import MAX_PEOPLE
from robots.motion import Block
from verifier.verdict import Reason

Array = NDArray[np.float64]

NOBODY: Mapping[str, float] = MappingProxyType({})


class Finding(NamedTuple):
    """An assumption that data contradict: the reason, what exactly, and when [s, cell's clock]."""

    reason: Reason
    assumption: str
    text: str
    t: float


class Sightings(NamedTuple):
    """Who was seen when.

    Attributes
    ----------
    listed:
        By when each report that lists the person, whatever could be read of them, was made, increasing [s]:
        its stamp, or its arrival where that is earlier.
    samples:
        What was read, in order of time; more than one series where reports of one stamp show the person more
        than once.
    late:
        Of each series what came after something that was seen later, and when it came ``(T,)`` [s].
    """

    listed: tuple[float, ...]
    samples: tuple[LaterSamples, ...]
    late: tuple[tuple[LaterSamples, Array], ...] = ()

    @property
    def since(self) -> float:
        """Stamp of the first report that lists the person [s]."""
        return self.listed[0]

    def after(self, t: float) -> Sightings | None:
        """Return what was seen after ``t`` [s]; ``None``: nothing."""
        listed = tuple(stamp for stamp in self.listed if stamp > t)
        later = [(each, each.t > t) for each in self.samples]
        samples = tuple(
            LaterSamples(each.t[new], each.xyz[new], each.e_p[new]) for each, new in later if new.any()
        )
        return Sightings(listed, samples) if listed else None

    @property
    def first(self) -> LaterSamples | None:
        """The series with the earliest sample; ``None``: nothing was read."""
        return min(self.samples, key=lambda each: float(each.t[0]), default=None)


def seen_by(report: RawMeasurement) -> float:
    """Instant by which the people of a report had been seen [s]: a stamp may lie ahead of the arrival."""
    return min(report.stamp, report.arrived)


class _Seen(NamedTuple):
    """What a report shows of a person, and when it arrived [s]."""

    reading: Reading
    arrived: float


def sightings(gate: Gate, reports: Iterable[RawMeasurement]) -> dict[str, Sightings]:
    """Read every report for its own sake, without admitting it; by person."""
    listed: dict[str, set[float]] = {}
    series: dict[str, list[dict[float, _Seen]]] = {}
    for report in reports:
        if not abs(report.stamp) <= LARGEST_S:
            continue
        for person in report.people:
            listed.setdefault(person.id, set()).add(seen_by(report))
            reading = None if gate.is_ahead(report) else gate.read(report, person)
            if reading is not None and np.isfinite(reading.seen).any():
                _keep(series.setdefault(person.id, []), report.stamp, _Seen(reading, report.arrived))
    found: dict[str, Sightings] = {}
    for name, stamps in listed.items():
        own = [_samples(each, gate.believes_repeats) for each in series.get(name, ()) if _any(each)]
        found[name] = Sightings(tuple(sorted(stamps)), tuple(each for each, _ in own), _late(own))
    return found


def _keep(series: list[dict[float, _Seen]], stamp: float, seen: _Seen) -> None:
    """Put what was seen into the first series that has none of this stamp."""
    for each in series:
        if stamp not in each:
            each[stamp] = seen
            return
    series.append({stamp: seen})


def _any(found: dict[float, _Seen]) -> bool:
    """Whether anything was read at all."""
    return any(seen.reading.present for seen in found.values())


def _samples(found: dict[float, _Seen], believe_repeats: bool) -> tuple[LaterSamples, Array]:
    """Put readings in order, with when they arrived [s].

    Points that stand exactly where they stood before, in one of the sixteen readings before, were not
    measured anew.
    """
    stamps = np.array(sorted(found))
    readings = [found[stamp].reading for stamp in stamps]
    xyz = np.array([reading.xyz for reading in readings])
    if not believe_repeats:
        seen = np.array([reading.seen for reading in readings])
        for before in range(1, min(PLACES + 1, len(seen))):
            xyz[before:][(seen[before:] == seen[:-before]).all(axis=2)] = np.nan
    read = np.array([reading.present != 0 for reading in readings])
    arrived = np.array([found[stamp].arrived for stamp in stamps])
    e_p = np.array([reading.e_p for reading in readings])
    return LaterSamples(stamps[read], xyz[read], e_p[read]), arrived[read]


def _late(series: Sequence[tuple[LaterSamples, Array]]) -> tuple[tuple[LaterSamples, Array], ...]:
    """Return of each series what came no earlier than something that was seen as late or later.

    Only these may be unknown to a cycle that knows something newer.
    """
    found = []
    for number, (samples, arrived) in enumerate(series):
        behind = np.zeros(len(samples.t), dtype=bool)
        for other, (others, came) in enumerate(series):
            earliest = np.minimum.accumulate(came[::-1])[::-1]  # of what was seen as late or later
            place = others.t.searchsorted(samples.t, side="right" if other == number else "left")
            newer = place < len(others.t)
            behind[newer] |= earliest[place[newer]] <= arrived[newer]
        if behind.any():
            found.append(
                (LaterSamples(samples.t[behind], samples.xyz[behind], samples.e_p[behind]), arrived[behind])
            )
    return tuple(found)


class PeopleHindsight:
    """Holds what a cycle knew about people against what was seen of them until the robot had stopped."""

    def __init__(
        self, profile: Profile, max_report_gap_s: float | None, models: Sequence[HumanModel] = ()
    ) -> None:
        self._profile = profile
        self._models = tuple(models)
        self._max_gap = max_report_gap_s

    def check(
        self,
        people: Block,
        ids: tuple[str, ...],
        later: dict[str, Sightings],
        stamps: Array,
        window: tuple[float, float],
    ) -> Finding | None:
        """Return what was seen, and was not known, contradicts, if anything does.

        Parameters
        ----------
        people, ids:
            People block as the cycle knew it, and person ids by index.
        later:
            Who was seen when.
        stamps:
            Instants (M,) [s] of all reports, increasing.
        window:
            What had arrived by its begin [s] was known; what was seen up to its end [s] is looked at.
        """
        now, until = window
        for k in range(int(people["n"][0])):
            person = ids[int(people["person"][0, k])]
            if person not in later or not people["present"][0, k]:
                continue
            newest = _newest(people, k)
            for samples in later[person].samples:
                found = self._outside(people, k, person, samples, (newest, until))
                found = found or self._belied(people, k, person, samples, (newest, until))
                if found is not None:
                    return found
            for samples, arrived in later[person].late:
                unknown = arrived > now
                if unknown.any():
                    rest = LaterSamples(samples.t[unknown], samples.xyz[unknown], samples.e_p[unknown])
                    found = self._outside(people, k, person, rest, (-math.inf, min(newest, until)))
                    if found is not None:
                        return found
        return self._gap(people, stamps, until)

    def too_large(
        self, new: Sequence[str], later: Mapping[str, Sightings], left: Mapping[str, float], until: float
    ) -> Finding | None:
        """Return which size of the profile somebody contradicts who was unknown and seen by ``until`` [s].

        ``left``: id -> stamp [s], of those who had left and came back; what was seen before counts no more.
        """
        for person in new:
            after = left.get(person, -math.inf)
            for samples in later[person].samples:
                found = later_too_large(samples, self._profile, after=after, until=until)
                if found is not None:
                    t, text = float(samples.t[found.sample]), _too_large_text(person, found)
                    return Finding(Reason.PERSON_OUTSIDE_PREDICTION, "A1 people", text, t)
        return None

    def _outside(
        self, people: Block, k: int, person: str, samples: LaterSamples, window: tuple[float, float]
    ) -> Finding | None:
        """Return which speeds or sizes of the profile a series contradicts, if any."""
        (after, until), reason = window, Reason.PERSON_OUTSIDE_PREDICTION
        found = later_outside(people, k, samples, self._profile, after=after, until=until)
        if found is not None:
            t = float(samples.t[found.sample])
            elapsed = abs(t - float(people["t_obs"][0, k, found.earlier]))
            return Finding(reason, "A1 people", _outside_text(person, found, elapsed), t)
        found = later_too_large(samples, self._profile, after=after, until=until)
        if found is not None:
            text = _too_large_text(person, found)
            return Finding(reason, "A1 people", text, float(samples.t[found.sample]))
        return None

    def _belied(
        self, people: Block, k: int, person: str, samples: LaterSamples, window: tuple[float, float]
    ) -> Finding | None:
        """Return what a series contradicts of what the models assume besides speeds and sizes."""
        reason = Reason.PERSON_OUTSIDE_PREDICTION
        arrays = (samples.t, samples.xyz, samples.e_p)
        for model in self._models:
            belied = model.belied(people, k, arrays, window)
            if belied is not None:
                where = f"{belied.excess_m:.3f} m outside of where {model.name} has it"
                text = f"{person} {POINT_NAMES[belied.point]} was {where}"
                return Finding(reason, "A1 people", text, float(samples.t[belied.sample]))
        return None

    def _gap(self, people: Block, stamps: Array, until: float) -> Finding | None:
        if self._max_gap is None or not len(stamps) or not int(people["n"][0]):
            return None
        newest = max(_newest(people, k) for k in range(int(people["n"][0])))
        if not np.isfinite(newest):
            return None
        first = int(np.searchsorted(stamps, newest))
        last = int(np.searchsorted(stamps, until, side="right"))
        edges = np.concatenate(([newest], stamps[first:last], [until]))
        gaps = np.diff(edges)
        i = int(np.argmax(gaps))
        if not gaps[i] > self._max_gap:
            return None
        text = f"no report for {gaps[i]:.3f} s; declared: at most {self._max_gap:.3f} s"
        return Finding(Reason.PEOPLE_STREAM_GAP, "A5 reports", text, float(edges[i]))


class Newcomers(NamedTuple):
    """People block and ids with everybody who was seen later; ``overflow``: there was no room for all."""

    people: Block
    ids: tuple[str, ...]
    overflow: bool


def with_newcomers(
    people: Block,
    ids: tuple[str, ...],
    later: dict[str, Sightings],
    until: float,
    left: Mapping[str, float] = NOBODY,
) -> Newcomers | None:
    """Return people as they would have been known, had everybody been reported who was seen later.

    Whoever is first listed by ``until`` [s] and was unknown gets a row with the first sighting of which
    something could be read, which bounds where they had been before as well: profile speeds hold in both
    directions of time. Where nothing was read, the row claims nothing. Those of ``ids`` who have ``left``
    (id -> stamp [s]) are as unknown as others from then on. ``None``: nobody new.
    """
    unknown = {person: seen for person, seen in later.items() if person not in ids}
    for person, stamp in left.items():
        back = later[person].after(stamp) if person in later else None
        if back is not None:
            unknown[person] = back
    new = {person: seen.first for person, seen in unknown.items() if seen.since <= until}
    if not new:
        return None
    wider = people.copy()
    rows = wider[0]
    room = MAX_PEOPLE - int(rows["n"])
    for number, samples in enumerate(list(new.values())[:room], len(ids)):
        k = int(rows["n"])
        rows["person"][k], rows["present"][k] = number, 0
        rows["t_obs"][k], rows["v"][k], rows["e_v"][k] = np.nan, 0.0, np.inf
        if samples is not None:
            seen = np.isfinite(samples.xyz[0]).all(axis=1)
            rows["present"][k] = sum(1 << int(p) for p in np.flatnonzero(seen))
            rows["xyz"][k], rows["e_p"][k] = samples.xyz[0], samples.e_p[0]
            rows["t_obs"][k][seen] = samples.t[0] - float(rows["stamp_error"])
        rows["n"] = k + 1
    return Newcomers(wider, (*ids, *new), len(new) > room)


def _newest(people: Block, k: int) -> float:
    """Stamp [s] of the newest point of a row; -inf if it has none."""
    seen: list[float] = people["t_obs"][0, k].tolist()
    return max(filter(math.isfinite, seen), default=-math.inf) + float(people["stamp_error"][0])


def _outside_text(person: str, found: Outside, elapsed: float) -> str:
    name, earlier = POINT_NAMES[found.point], POINT_NAMES[found.earlier]
    moved = f"moved {found.distance_m:.3f} m"
    if name != earlier:
        moved = f"was {found.distance_m:.3f} m from where {earlier} had been"
    return (
        f"{person} {name} {moved} in {elapsed:.3f} s; profile and position errors allow "
        f"{found.allowed_m:.3f} m"
    )


def _too_large_text(person: str, found: Outside) -> str:
    name, other = POINT_NAMES[found.point], POINT_NAMES[found.earlier]
    return (
        f"{person} {name} was {found.distance_m:.3f} m from {other}; the profile and position errors "
        f"allow {found.allowed_m:.3f} m: larger people need another profile"
    )


class RobotHindsight:
    """Holds the plan's tracking bound against the recorded joint positions, and the sampling against its gap.

    Parameters
    ----------
    t:
        Sample times (T,) [s].
    covers:
        First and last instant [s] of the stretch that the samples should cover; infinite: where they begin
        or end.
    residual:
        Recorded minus fitted joint positions (T, J).
    q_error:
        Bound (J,) that the plans assumed.
    joints:
        Joint names.
    max_gap_s:
        Samples further apart than this leave the motion between them unknown [s].
    """

    def __init__(
        self,
        t: Array,
        covers: tuple[float, float],
        residual: Array,
        q_error: Array,
        joints: tuple[str, ...],
        max_gap_s: float,
    ) -> None:
        self._residual = residual
        self._q_error = q_error
        self._joints = joints
        self._max_gap = max_gap_s
        self._outside = np.flatnonzero(~(np.abs(residual) <= q_error).all(axis=1))
        self._outside_t = t[self._outside]
        edges = np.concatenate((covers[:1], t, covers[1:]))
        edges = edges[np.isfinite(edges)]
        gaps = np.flatnonzero(~(np.diff(edges) <= max_gap_s))
        self._gap_begins, self._gap_ends = edges[gaps], edges[gaps + 1]

    def check(self, since: float, until: float) -> Finding | None:
        """Return what samples of [since, until] [s] contradict, if anything."""
        gap = int(self._gap_ends.searchsorted(since))
        if gap < len(self._gap_ends) and self._gap_begins[gap] <= until:
            begin = float(self._gap_begins[gap])
            text = f"no joint sample for {self._gap_ends[gap] - begin:.3f} s; allowed: {self._max_gap:.3f} s"
            return Finding(Reason.ROBOT_STREAM_GAP, "A2 robot", text, begin)
        first = int(self._outside_t.searchsorted(since))
        if first < len(self._outside) and self._outside_t[first] <= until:
            row = int(self._outside[first])
            joint = int(np.argmax(np.abs(self._residual[row]) - self._q_error))
            text = (
                f"{self._joints[joint]} was {abs(self._residual[row, joint]):.4f} rad off the path; "
                f"declared: at most {self._q_error[joint]:.4f} rad"
            )
            return Finding(Reason.ROBOT_OUTSIDE_TRACKING, "A2 robot", text, float(self._outside_t[first]))
        return None
