"""Does what was seen later lie in what a model predicted (docs/conformance.md).

Every sample of a recording is once the last known one. From it each model gives its rows for the very instant
of a later sample, and each measured point of that sample is held against the rows of its parts: a point on
the axis of a part must lie as deep as the flesh around it is thick, other points of the part must lie inside.
Whatever rows there are for one part, several hypotheses about the person included, count as one set.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import or_
from typing import Final

import numpy as np
from numpy.typing import NDArray

from occupancy.body import ALL_PARTS, MAX_PARTS, PART_NAMES, POINT_NAMES, Part, Point, Profile
from occupancy.conformance_kernels import body_depth, worst_points
from occupancy.humans.model import HumanModel
from occupancy.humans.options import HANDS, SEGMENTS
from occupancy.measurement import Gate
from occupancy.recorded import Recorded, Track
from occupancy.separation import new_scratch
from occupancy.volume import volume
from robots.errors import SetupError
from robots.motion import MAX_SLICES, Block, new_slices

HORIZONS_S: Final = (0.02, 0.05, 0.1, 0.2, 0.5)
NEAR_S: Final = 0.02
"""A sample further than this from t + horizon, or than 3/4 of the usual step, is not looked at [s]."""
VOLUMES: Final = 25
"""Frames per horizon of which the volume is taken."""

PARTS: Final = np.dtype(
    [
        ("point", np.int64, (MAX_PARTS, 3)),
        ("n_axis", np.int64, (MAX_PARTS,)),
        ("radius", np.float64, (MAX_PARTS,)),
    ]
)
"""``point``: points that lie in a part, those on its axis first, -1: no more; ``n_axis``: how many of them
are; ``radius`` [m] of the flesh around the axis."""
FOUND: Final = np.dtype(
    [("tested", np.int64), ("part", np.int64), ("point", np.int64), ("excess", np.float64)]
)

INSIDE: Final[dict[Part, tuple[Point, ...]]] = {**HANDS, Part.TORSO: (Point.THORAX,)}
"""Points of a part that are not the ends of its segment."""


class ContainmentError(SetupError):
    """Settings of a conformance run that cannot be used; the message names value and rule."""


@dataclass
class Containment:
    """How the later samples lay, for one model and horizon.

    Attributes
    ----------
    horizon_s:
        Time from the last known sample to the one held against it [s], nominal.
    frames, inside:
        Pairs of samples of which something was tested, and those with every point inside.
    apart:
        Pairs with a marked sample from one to the other; not among ``frames``.
    without_rows:
        Pairs for which the model said nothing; not among ``frames``.
    worst_excess_m:
        Greatest distance by which a point lay outside of its rows; negative: the least by which all were
        inside; NaN without frames.
    worst_frame, worst_person, worst_part, worst_point:
        Where: number of the last known sample of that person, from 0; -1 and empty without frames.
    volumes_m3:
        Sums of the volumes of all rows of a person, of some of the frames.
    """

    horizon_s: float
    frames: int = 0
    inside: int = 0
    apart: int = 0
    without_rows: int = 0
    worst_excess_m: float = float("nan")
    worst_frame: int = -1
    worst_person: str = ""
    worst_part: str = ""
    worst_point: str = ""
    volumes_m3: list[float] = field(default_factory=list)

    @property
    def volume_m3(self) -> float:
        """Median of ``volumes_m3``: the union takes at most as much; NaN without any."""
        return float(np.median(self.volumes_m3)) if self.volumes_m3 else float("nan")

    def add(self, found: np.void, frame: int, person: str) -> None:
        """Count one pair of samples."""
        if not found["tested"]:
            self.without_rows += 1
            return
        self.frames += 1
        excess = float(found["excess"])
        self.inside += excess <= 0.0
        if not excess <= self.worst_excess_m:
            self.worst_excess_m, self.worst_frame, self.worst_person = excess, frame, person
            self.worst_part, self.worst_point = PART_NAMES[found["part"]], POINT_NAMES[found["point"]]


def contain(
    recorded: Recorded,
    profile: Profile,
    models: Sequence[HumanModel],
    *,
    horizons_s: Sequence[float] = HORIZONS_S,
    every: int = 1,
    progress: Callable[[float], None] = lambda _share: None,
) -> list[list[Containment]]:
    """Hold a recording against the predictions of models that follow from one profile.

    Parameters
    ----------
    recorded:
        People and their marks.
    profile, models:
        The gate that knows the past believes this profile.
    horizons_s:
        How far to look ahead [s], increasing.
    every:
        Take only each so-manieth sample as the last known one; all are known.
    progress:
        Called with the share that is done.

    Returns
    -------
    For each model one entry per horizon.

    Raises
    ------
    ContainmentError
        If the horizons are not positive and increasing or too many, or ``every`` is below 1.
    """
    steps = np.array(horizons_s, dtype=np.float64)
    if not (len(steps) and (np.diff(steps, prepend=0.0) > 0.0).all() and 2 * len(steps) <= MAX_SLICES):
        raise ContainmentError(
            f"horizons {list(horizons_s)} s: must be 1 to {MAX_SLICES // 2}, positive, increasing"
        )
    if every < 1:
        raise ContainmentError(f"every {every}: must be at least 1")
    gate = Gate(profile, recorded.settings)
    run = _Run(Prediction(gate, profile, models, len(steps)), recorded.tracks, len(models), steps)
    for share, name, j in walk(recorded, gate):
        if j % every == 0:
            run.look(name, j)
        if j % 64 == 0:
            progress(share)
    return run.found


def later_samples(t: NDArray[np.float64], horizons: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the sample nearest to each horizon after each sample; -1: none that is later is near enough.

    Parameters
    ----------
    t:
        (T,) s, stamps of the samples, increasing.
    horizons:
        (H,) s, increasing.

    Returns
    -------
    (T, H) numbers of samples.
    """
    wanted = t[:, None] + horizons
    after = np.clip(np.searchsorted(t, wanted), 1, max(len(t) - 1, 1))
    nearer = np.abs(t[after - 1] - wanted) <= np.abs(t[np.minimum(after, len(t) - 1)] - wanted)
    later = np.minimum(np.where(nearer, after - 1, after), len(t) - 1)
    return np.where(
        (np.abs(t[later] - wanted) <= near_s(t)) & (later > np.arange(len(t))[:, None]), later, -1
    )


def near_s(t: NDArray[np.float64]) -> float:
    """How far from an instant the sample may be that stands for it [s]; ``t`` (T,) [s] are all samples."""
    return min(NEAR_S, 0.75 * float(np.median(np.diff(t)))) if len(t) > 1 else 0.0


def walk(recorded: Recorded, gate: Gate) -> Iterator[tuple[float, str, int]]:
    """Let a gate admit report after report, and yield whenever a sample of a person is the last known one.

    Yields
    ------
    Share of the reports before this one, id of the person, number of the sample in the person's track.
    """
    at = dict.fromkeys(recorded.tracks, -1)
    for number, report in enumerate(recorded.reports):
        gate.admit(report, report.stamp)
        for name in {person.id: None for person in report.people}:
            if name not in at or name not in gate.person_ids:
                continue
            t = recorded.tracks[name].samples.t
            if at[name] + 1 < len(t) and t[at[name] + 1] == report.stamp:
                at[name] += 1
                yield number / len(recorded.reports), name, at[name]


class Prediction:
    """What models predict of one person for the instants of later samples, and how far off those are.

    Parameters
    ----------
    gate, profile, models:
        The gate that knows the past believes the profile that the models follow from.
    horizons:
        Number of later samples, at most half of the slices of a block.
    """

    def __init__(self, gate: Gate, profile: Profile, models: Sequence[HumanModel], horizons: int) -> None:
        self._gate = gate
        self._models = [(model, model.new_sets()) for model in models]
        self._slices = new_slices()
        self._slices["n"] = 2 * horizons - 1
        self._tables = (parts_table(profile), new_scratch())
        self._found: Block = np.zeros(horizons, dtype=FOUND)

    def rows(self, instants: NDArray[np.float64]) -> Iterator[Block]:
        """Yield, for each model, its rows for ``instants`` (H,) [s, not decreasing]: slice 2 h is the h-th.

        The block is the same each time, and holds until the next one is asked for.
        """
        self._slices["t"][0, : 2 * len(instants)] = np.repeat(instants, 2)
        for model, sets in self._models:
            model.occupy(self._gate.people, self._slices, sets)
            yield sets

    def held(
        self, sets: Block, name: str, later: NDArray[np.int64], samples: tuple[NDArray[np.float64], ...]
    ) -> Block:
        """Return (H,) FOUND: how samples ``later`` (H,) of a person (-1: none) lie in rows of a model.

        ``samples``: points (T, 20, 3) [m], NaN where none, and position errors (T, 20) [m]. The block is the
        same each time.
        """
        points, errors = samples
        person = self._gate.person_ids.index(name)
        worst_points(sets, self._gate.people, person, later, (points, errors), self._tables, self._found)
        return self._found

    def depth(self, name: str, part: int, point: int) -> float:
        """How deep [m] a point of a part must lie in its rows: the most of every hypothesis on a person."""
        people, place = self._gate.people[0], self._tables[0]["point"][0, part].tolist().index(point)
        return max(
            float(body_depth(people, k, part, place, self._tables[0][0])) for k in self._hypotheses(name)
        )

    def said(self, sets: Block, name: str, h: int) -> int:
        """Mask of the parts that have rows for the h-th instant for every hypothesis about a person."""
        rows, own = sets[0], self.rows_of(sets, name, h)
        mask = ALL_PARTS
        for k in self._hypotheses(name):
            mask &= reduce(or_, (int(rows["covers"][r]) for r in own if rows["owner"][r] == k), 0)
        return mask

    def rows_of(self, sets: Block, name: str, h: int) -> list[int]:
        """Numbers of the rows of a person for the h-th instant, of every hypothesis about them."""
        rows, own, i = sets[0], self._hypotheses(name), 2 * h
        return [r for r in range(int(rows["first"][i]), int(rows["first"][i + 1])) if rows["owner"][r] in own]

    def _hypotheses(self, name: str) -> list[int]:
        """Rows of a person in the gate's block of people."""
        people, person = self._gate.people[0], self._gate.person_ids.index(name)
        return [k for k in range(int(people["n"])) if people["person"][k] == person]


class _Run:
    """Counts of one walk through a recording."""

    def __init__(
        self, prediction: Prediction, tracks: dict[str, Track], models: int, horizons: NDArray[np.float64]
    ) -> None:
        self._prediction = prediction
        self._tracks = {
            name: (track.samples, track.marks_before, later_samples(track.samples.t, horizons))
            for name, track in tracks.items()
        }
        self.found = [[Containment(float(h)) for h in horizons] for _ in range(models)]

    def look(self, name: str, j: int) -> None:
        """Hold the samples of a person that are later than the j-th against what is predicted now."""
        samples, marks, every_later = self._tracks[name]
        later = every_later[j]
        apart = (later >= 0) & (marks[later + 1] > marks[j])
        wanted = np.where(apart, -1, later)
        for rows in self.found:
            for h in np.flatnonzero(apart):
                rows[h].apart += 1
        if (wanted < 0).all():
            return
        instants = np.maximum.accumulate(np.where(wanted < 0, samples.t[j], samples.t[wanted]))
        stride = max(1, len(samples.t) // VOLUMES)
        for sets, rows in zip(self._prediction.rows(instants), self.found, strict=True):
            found = self._prediction.held(sets, name, wanted, (samples.xyz, samples.e_p))
            for h in np.flatnonzero(wanted >= 0):
                rows[h].add(found[h], j, name)
                if j % stride == 0 and found[h]["tested"]:
                    own = self._prediction.rows_of(sets, name, int(h))
                    rows[h].volumes_m3.append(_volume(sets[0], own))


def parts_table(profile: Profile) -> Block:
    """Return which points belong to which parts, with the radii of a profile."""
    table = np.zeros(1, dtype=PARTS)
    table["radius"] = profile.radius
    table["point"] = -1
    for part in Part:
        axis = tuple(dict.fromkeys(SEGMENTS[part]))
        points = tuple(dict.fromkeys((*axis, *INSIDE.get(part, ()))))
        table["n_axis"][0, part] = len(axis)
        table["point"][0, part, : len(points)] = points
    return table


def _volume(rows: np.void, numbers: Sequence[int]) -> float:
    """Sum of the volumes [m³] of some rows."""
    return sum(
        volume(rows["points"][row, : rows["n_points"][row]], float(rows["radius"][row])) for row in numbers
    )
