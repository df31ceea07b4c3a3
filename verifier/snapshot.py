"""One frame of a recording of people: where a person was, is soon, and is predicted to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from occupancy.body import MAX_POINTS, Profile
from occupancy.containment import Prediction, later_samples, near_s, walk
from occupancy.humans.catalog import build_models
from occupancy.humans.options import HANDS
from occupancy.measurement import Gate
from occupancy.recorded import Track
from robots.errors import SetupError
from robots.motion import Block
from verifier.conformance import RecordedFile, models_of
from verifier.shown import shown

Array = NDArray[np.float64]

HORIZONS_S: Final = (0.1, 0.2)
"""How far a snapshot looks ahead [s]."""
_HAND_POINTS: Final = [point for hand in HANDS.values() for point in hand]


@dataclass(frozen=True, eq=False)
class Moment:
    """A sample of a person, the later ones that are held against it, and the direction of the motion.

    Attributes
    ----------
    person, sample:
        Id, and number of the sample in the person's track.
    later:
        (H,) numbers of the samples nearest to each horizon.
    along:
        (3,) unit vector, horizontal: where the fastest hand moves; the x axis if it moves up or down alone.
    """

    person: str
    sample: int
    later: NDArray[np.int64]
    along: Array


@dataclass(frozen=True, eq=False)
class Row:
    """The hull of ``points`` (P, 3) [m], grown by ``radius`` [m]; it contains the parts of a mask."""

    points: Array
    radius: float
    covers: int


@dataclass(frozen=True, eq=False)
class Predicted:
    """What a model says of one later instant, and how the sample of that instant lies in it.

    Attributes
    ----------
    model:
        Its name.
    rows:
        Those of the person, of every hypothesis about them, with the parts of which something is said.
    excess_m:
        (20,) by how much each point lies outside of the rows of one of its parts, the flesh around it
        included, the most of its parts; negative: inside of all; NaN: nothing is said of it.
    part, flesh_m:
        (20,) which part that is, -1: none; and the radius of the flesh around the point in it.
    """

    model: str
    rows: tuple[Row, ...]
    excess_m: Array
    part: NDArray[np.int64]
    flesh_m: Array


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One frame of a recording with the rows of each model of a profile.

    Attributes
    ----------
    recording, profile, person:
        Names.
    at_s:
        Time of the frame from the recording's first report [s].
    along:
        (3,) horizontal unit vector, from left to right in a picture.
    points:
        (20, 3) m, the person at the frame; NaN: not seen.
    after_s, later:
        (H,) s after the frame, and (H, 20, 3) m: the later samples.
    predicted:
        One entry per horizon, each with one per model.
    """

    recording: str
    profile: str
    person: str
    at_s: float
    along: Array
    points: Array
    after_s: Array
    later: Array
    predicted: tuple[tuple[Predicted, ...], ...]


def choose_moment(file: RecordedFile, at_s: float | None, person: str | None) -> Moment:
    """Choose the frame of a recording that is drawn: the one in which some hand is fastest.

    Only frames count that have a sample for each horizon, and none that is marked from the frame to the last
    of them. Where no hand was seen, the fastest of all points counts.

    Parameters
    ----------
    at_s:
        Take the sample nearest to this time [s] from the first report instead.
    person:
        Look at this one alone.

    Raises
    ------
    SetupError
        The person is not there, or not at that time, or no frame counts.
    """
    tracks = file.people.tracks
    if person is not None and person not in tracks:
        there = ", ".join(shown(name) for name in tracks)
        raise SetupError(f"--person {shown(person)}: is not in {shown(file.name)}; these are: {there}")
    motions = {name: _Motion(track) for name, track in tracks.items() if person in (None, name)}
    if at_s is None:
        frames = [(name, int(np.argmax(motion.speed))) for name, motion in motions.items()]
    else:
        frames = _seen_at(file, at_s, motions)
    name, j = max(frames, key=lambda frame: motions[frame[0]].speed[frame[1]])
    motion = motions[name]
    if not motion.speed[j] >= 0.0:
        if at_s is not None:
            raise SetupError(f"--at {at_s:g}: {motion.why_not(j)}")
        raise SetupError(f"--sets: {shown(file.name)} has no frame that can be drawn: {motion.why_not(j)}")
    return Moment(name, j, motion.later[j], motion.direction(j))


def take_snapshot(file: RecordedFile, profile: Profile, wanted: Sequence[str], moment: Moment) -> Snapshot:
    """Let each model of a profile predict a person from one frame, and hold what came later against it.

    Parameters
    ----------
    file, moment:
        The recording, and what :func:`choose_moment` has chosen in it.
    profile, wanted:
        Its models; those of some names only, if there are any.

    Raises
    ------
    SetupError
        No wanted model follows from the profile, or the gate has no room for the person.
    """
    models = build_models(profile, models_of(profile, wanted))
    gate = Gate(profile, file.people.settings)
    now = (moment.person, moment.sample)
    if not any((name, j) == now for _, name, j in walk(file.people, gate)):
        raise SetupError(f"--sets: there is no room for {shown(moment.person)} among so many people")
    samples = file.people.tracks[moment.person].samples
    instants = samples.t[moment.later]
    seen = (samples.xyz[moment.later], samples.e_p[moment.later])
    prediction = Prediction(gate, profile, models, len(instants))
    by_model = [
        _predicted(prediction, sets, model.name, moment.person, seen)
        for model, sets in zip(models, prediction.rows(instants), strict=True)
    ]
    return Snapshot(
        recording=file.name,
        profile=profile.name,
        person=moment.person,
        at_s=file.seconds(moment.person, moment.sample),
        along=moment.along,
        points=samples.xyz[moment.sample],
        after_s=instants - samples.t[moment.sample],
        later=seen[0],
        predicted=tuple(zip(*by_model, strict=True)),
    )


class _Motion:
    """How fast the hands of one person are, at the frames that can be drawn.

    Attributes
    ----------
    later:
        (T, H) numbers of the samples nearest to each horizon, -1: none.
    speed:
        (T,) m/s, of the fastest hand on the way to the next sample; -inf at frames that cannot be drawn.
    """

    def __init__(self, track: Track) -> None:
        t, xyz = track.samples.t, track.samples.xyz
        self._t = t
        self.later = later_samples(t, np.array(HORIZONS_S))
        self._complete = np.asarray((self.later >= 0).all(axis=1))
        marks = track.marks_before
        unmarked = marks[self.later[:, -1] + 1] == marks[:-1]
        self._step = np.diff(xyz, axis=0, append=np.nan * xyz[-1:])
        speeds = np.linalg.norm(self._step, axis=2) / np.diff(t, append=np.inf)[:, None]
        hands = np.isin(np.arange(MAX_POINTS), _HAND_POINTS)
        if np.isfinite(speeds[:, hands]).any():
            speeds[:, ~hands] = np.nan
        self._speeds = np.where(np.isfinite(speeds), speeds, 0.0)
        self.speed = np.where(self._complete & unmarked, self._speeds.max(axis=1), -np.inf)

    def nearest(self, stamp: float) -> int | None:
        """Return the number of the sample that stands for an instant [s], if one is near enough."""
        off = np.abs(self._t - stamp)
        j = int(np.argmin(off))
        return j if off[j] <= near_s(self._t) else None

    def direction(self, j: int) -> Array:
        """Return the horizontal direction (3,) in which the fastest hand moves from sample j to the next."""
        step = self._step[j, int(np.argmax(self._speeds[j]))] * (1.0, 1.0, 0.0)
        length = float(np.linalg.norm(step))
        return step / length if length > 0.0 else np.array([1.0, 0.0, 0.0])

    def why_not(self, j: int) -> str:
        """Say why sample j cannot be drawn."""
        ends = [f"{1e3 * horizon:g}" for horizon in HORIZONS_S]
        if not self._complete[j]:
            return f"no sample lies {' or '.join(ends)} ms later"
        return f"a sample from there to {ends[-1]} ms later is marked by the gate"


def _seen_at(file: RecordedFile, at_s: float, motions: dict[str, _Motion]) -> list[tuple[str, int]]:
    """Return who is seen at a time [s] from the first report, each with the sample nearest to it."""
    first, last = file.people.reports[0].stamp, file.people.reports[-1].stamp
    if not 0.0 <= at_s <= last - first:
        raise SetupError(f"--at {at_s:g}: {shown(file.name)} goes from 0 to {last - first:.6g} s")
    near = [(name, motion.nearest(first + at_s)) for name, motion in motions.items()]
    seen = [(name, j) for name, j in near if j is not None]
    if not seen:
        raise SetupError(f"--at {at_s:g}: {' and '.join(map(shown, motions))} not seen then")
    return seen


def _predicted(
    prediction: Prediction, sets: Block, model: str, person: str, seen: tuple[Array, Array]
) -> list[Predicted]:
    """Return rows and excesses of a model, one entry per horizon; ``seen``: the later samples and errors.

    The excess of one point is that of a sample that has no other.
    """
    points, errors = seen
    horizons = np.arange(len(points))
    excess, flesh = np.full((2, len(points), MAX_POINTS), np.nan)
    part = np.full((len(points), MAX_POINTS), -1)
    for p in range(MAX_POINTS):
        alone = np.full_like(points, np.nan)
        alone[:, p] = points[:, p]
        for h, found in enumerate(prediction.held(sets, person, horizons, (alone, errors))):
            if found["tested"]:
                excess[h, p], part[h, p] = found["excess"], found["part"]
                flesh[h, p] = prediction.depth(person, int(found["part"]), p)
    return [
        Predicted(model, _rows(prediction, sets, person, h), excess[h], part[h], flesh[h])
        for h in range(len(points))
    ]


def _rows(prediction: Prediction, sets: Block, person: str, h: int) -> tuple[Row, ...]:
    rows, said = sets[0], prediction.said(sets, person, h)
    return tuple(
        Row(rows["points"][r, : rows["n_points"][r]].copy(), float(rows["radius"][r]), covers)
        for r in prediction.rows_of(sets, person, h)
        if (covers := int(rows["covers"][r]) & said)
    )
