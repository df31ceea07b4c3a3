"""Limits of people from what recordings show of them: a profile that allows every unmarked reading.

It says what these people did in these recordings, times a margin. For other people, or other tasks, it is no
limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from occupancy.body import LIMBS, Point, Profile
from occupancy.conformance_kernels import greatest_acceleration
from occupancy.hypotheses import HISTORY_DEPTH
from occupancy.recorded import Recorded, Track
from robots.assumption import Assumption, Certainty
from robots.errors import SetupError

Array = NDArray[np.float64]

MARGIN: Final = 1.2
LONGEST_S: Final = 0.6
"""Accelerations are looked for over pairs of intervals of which the later one is at most as long [s]."""
_POLE: Final = 0.2
"""Share of an arm's extension below which, across its axis, its first angle says nothing."""
_STILL: Final = 1e-3
"""Share of the base profile's number below which a motion was not in the recordings."""
_FRAME_M: Final = 0.05
"""Shoulders and trunk points nearer together than this [m] give no frame of the torso."""

SPEED: Final = "greatest distance between successive readings over the time between, noise included"
ACCELERATION: Final = "greatest acceleration that three readings show beyond their position errors"
OF_POINTS: Final = "acceleration of the shoulder, and half of those of elbow and wrist"
RANGE: Final = "greatest angle in a frame of the shoulders and the trunk"
LENGTH: Final = "greatest length, where longer than the base profile's"
SHORTEST: Final = "least length, where shorter than the base profile's"


class IdentificationError(SetupError):
    """Recordings or settings from which no limits can be found; the message names the rule."""


@dataclass(frozen=True)
class Found:
    """The greatest value of a limit, without margin, and how and in which recording it was found."""

    value: float
    estimator: str
    recording: str


def identify(
    recordings: Sequence[tuple[str, Recorded]], base: Profile, name: str, margin: float = MARGIN
) -> tuple[Assumption, ...]:
    """Return every number of a new profile in the order of the base profile.

    Parameters
    ----------
    recordings:
        Name and people of each.
    base:
        Gives what the recordings do not show, and all sizes but limbs longer or shorter than its own.
    name:
        Of the new profile.
    margin:
        Factor on speeds, accelerations and ranges.

    Returns
    -------
    Numbers named ``people.<name>.<table>.<key>``, with the recording in the source.

    Raises
    ------
    IdentificationError
        If the margin is below 1 or not finite, or no two readings of one point follow each other.
    """
    if not 1.0 <= margin < math.inf:
        raise IdentificationError(f"margin {margin}: must be finite and at least 1")
    found: dict[str, Found] = {}
    frames = 0
    for recording, recorded in recordings:
        for track in recorded.tracks.values():
            frames += int(np.count_nonzero(~track.marked))
            for place, value, estimator in _of_track(track):
                if math.isfinite(value) and (place not in found or _beyond(place, value, found[place].value)):
                    found[place] = Found(value, estimator, recording)
    if not any(place.startswith("speed.") for place in found):
        raise IdentificationError(
            "no recording has two successive readings of one point: nothing to identify"
        )
    files = ", ".join(recording for recording, _ in recordings)
    seen = f"identified from {frames} readings of {files}"
    stem, prefix = f"people.{base.name}.", f"people.{name}."
    stature = {end: _number(base, f"stature.{end}") for end in ("longest", "shortest")}
    numbers = {each.name.removeprefix(stem): each for each in base.assumptions}
    for place in found:
        table = place.split(".")[0]
        if place not in numbers and table in ("speed", "acceleration"):
            numbers[place] = replace(numbers[f"{table}.every_point"], name=stem + place)
    return tuple(
        replace(_chosen(place, number, found.get(place), stature, (margin, seen)), name=prefix + place)
        for place, number in sorted(numbers.items(), key=lambda item: _order(item[0]))
    )


def _order(place: str) -> tuple[int, bool]:
    tables = ("speed", "acceleration", "arm", "radius", "stature", "limit", "limb")
    return tables.index(place.split(".", maxsplit=1)[0]), not place.endswith("every_point")


def _beyond(place: str, value: float, before: float) -> bool:
    return value < before if place.endswith(".shortest") else value > before


def _number(base: Profile, place: str) -> float:
    wanted = f"people.{base.name}.{place}"
    return next(float(each.value) for each in base.assumptions if each.name == wanted)


def _chosen(
    place: str,
    base: Assumption,
    found: Found | None,
    stature: dict[str, float],
    how: tuple[float, str],
) -> Assumption:
    """Return the number of the new profile: what was found with the margin, else the base profile's."""
    margin, seen = how
    kept = replace(base, source=f"not in the recordings; {base.source}", certainty=_not_measured(base))
    if found is None:
        return kept
    if place.startswith("limb."):
        end = place.rpartition(".")[2]
        share = found.value / stature[end]
        if not _beyond(place, share, float(base.value)):
            return base
        value, factor = share, 1.0
    else:
        value, factor = margin * found.value, margin
    if not value > _STILL * float(base.value):
        return kept
    source = f"{seen}: {found.estimator}; most in {found.recording}; {found.value:.4g}, margin {factor:g}"
    if place.startswith("limb."):
        source = f"{seen}: {found.estimator}; in {found.recording}: {found.value:.4g} m"
    return replace(base, value=_up(place, value), source=source, certainty=Certainty.MEASURED)


def _up(place: str, value: float) -> float:
    """Round to six digits, to the side on which nothing is lost."""
    digits = 5 - math.floor(math.log10(value))
    ulp = 10.0**-digits
    rounded = math.floor(value / ulp) if place.endswith(".shortest") else math.ceil(value / ulp)
    return round(rounded * ulp, digits)


def _not_measured(base: Assumption) -> Certainty:
    return Certainty.ASSUMED if base.certainty is Certainty.MEASURED else base.certainty


def _of_track(track: Track) -> Iterator[tuple[str, float, str]]:
    """Yield place in a profile, greatest value seen, and estimator."""
    samples = track.samples
    for point in Point:
        xyz = samples.xyz[:, point]
        motion = _Motion(track, xyz, samples.e_p[:, point])
        yield f"speed.{point.name.lower()}", motion.speed(), SPEED
        yield f"acceleration.{point.name.lower()}", motion.acceleration(), ACCELERATION
    for limb, pairs in LIMBS.items():
        for a, b in pairs:
            length = np.linalg.norm(samples.xyz[:, a] - samples.xyz[:, b], axis=1)[~track.marked]
            if np.isfinite(length).any():
                yield f"limb.{limb}.longest", float(np.nanmax(length)), LENGTH
                yield f"limb.{limb}.shortest", float(np.nanmin(length)), SHORTEST
    frame = _torso(samples.xyz)
    yield "arm.torso_rate", _turning(track, frame), SPEED
    for side in ("L", "R"):
        yield from _of_arm(track, side, frame)


class _Motion:
    """A series (T, D) with errors (T,), where it was seen."""

    def __init__(self, track: Track, x: Array, error: Array) -> None:
        seen = np.isfinite(x).all(axis=1) & np.isfinite(error)
        before = track.marks_before
        self._t = np.ascontiguousarray(track.samples.t[seen])
        self._x = np.ascontiguousarray(x[seen])
        self._error = np.ascontiguousarray(error[seen])
        own = track.marked[seen]
        # a mark between two readings of this point counts as one of the later of them
        passed = np.diff(before[:-1][seen], prepend=0) - np.concatenate(([0], own[:-1])) > 0
        self._broken = own | passed
        self._marks = np.concatenate(([0], np.cumsum(self._broken))).astype(np.int64)

    def speed(self) -> float:
        """Greatest difference quotient of successive readings; NaN without any."""
        return self._fastest(np.linalg.norm(np.diff(self._x, axis=0), axis=1))

    def angular_speed(self) -> float:
        """Greatest angle [rad] between successive unit vectors over the time between; NaN without any."""
        chords = np.linalg.norm(np.diff(self._x, axis=0), axis=1)
        return self._fastest(2.0 * np.arcsin(np.clip(0.5 * chords, 0.0, 1.0)))

    def _fastest(self, steps: Array) -> float:
        whole = ~(self._broken[1:] | self._broken[:-1])
        return float((steps / np.diff(self._t))[whole].max()) if whole.any() else math.nan

    def acceleration(self) -> float:
        """Greatest acceleration beyond errors; NaN without three readings."""
        if len(self._t) < 3:
            return math.nan
        arrays = (self._t, self._x, self._error, self._marks)
        return float(greatest_acceleration(*arrays, HISTORY_DEPTH, LONGEST_S)[0])


def _torso(xyz: Array) -> Array:
    """Rotations (T, 3, 3) of the torso: rows down, forward and to the left; NaN where it was not seen."""
    left = xyz[:, Point.L_SHOULDER] - xyz[:, Point.R_SHOULDER]
    down = np.full_like(left, np.nan)
    for low, high in (
        (Point.PELVIS, Point.NECK_BASE),
        (Point.PELVIS, Point.THORAX),
        (Point.THORAX, Point.NECK_BASE),
    ):
        missing = np.isnan(down).any(axis=1)
        down[missing] = (xyz[:, low] - xyz[:, high])[missing]
    left = _unit(left)
    down = _unit(down - np.sum(down * left, axis=1, keepdims=True) * left)
    return np.stack([down, np.cross(down, left), left], axis=1)


def _unit(x: Array) -> Array:
    length = np.linalg.norm(x, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(length > _FRAME_M, x / length, np.nan), dtype=np.float64)


def _turning(track: Track, frame: Array) -> float:
    """Greatest angular speed [rad/s] of a frame between successive readings."""
    seen = np.isfinite(frame).all(axis=(1, 2)) & ~track.marked
    both = seen[1:] & seen[:-1]
    if not both.any():
        return math.nan
    trace = np.einsum("tij,tij->t", frame[1:][both], frame[:-1][both])
    angle = np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
    return float((angle / np.diff(track.samples.t)[both]).max())


def _of_arm(track: Track, side: str, torso: Array) -> Iterator[tuple[str, float, str]]:
    """Yield the limits of one arm about its shoulder, from the middle of the forearm."""
    shoulder, elbow, wrist = (Point[f"{side}_{name}"] for name in ("SHOULDER", "ELBOW", "WRIST"))
    xyz, e_p = track.samples.xyz, track.samples.e_p
    d = 0.5 * (xyz[:, elbow] + xyz[:, wrist]) - xyz[:, shoulder]
    error = e_p[:, shoulder] + 0.5 * (e_p[:, elbow] + e_p[:, wrist])
    r = np.linalg.norm(d, axis=1)
    u = _unit(d)
    extension = _Motion(track, r[:, None], error)
    with np.errstate(invalid="ignore", divide="ignore"):
        turning = _Motion(track, u, 2.0 * np.arcsin(np.clip(error / r, 0.0, 1.0)))
    yield "arm.angular_speed", turning.angular_speed(), SPEED
    yield "arm.angular_acceleration", turning.acceleration(), ACCELERATION
    yield "arm.extension_speed", extension.speed(), SPEED
    yield "arm.extension_acceleration", extension.acceleration(), ACCELERATION
    yield "arm.relative_speed", _Motion(track, d, error).speed(), SPEED
    points = (_Motion(track, xyz[:, p], e_p[:, p]).acceleration() for p in (shoulder, elbow, wrist))
    yield "arm.relative_acceleration", float(np.dot((1.0, 0.5, 0.5), list(points))), OF_POINTS
    upper, fore = _unit(xyz[:, elbow] - xyz[:, shoulder]), _unit(xyz[:, wrist] - xyz[:, elbow])
    bent = np.arccos(np.clip(np.sum(upper * fore, axis=1), -1.0, 1.0))
    yield "arm.elbow", _most(bent, track), RANGE
    outward = np.einsum("tij,tj->ti", torso, u) * (1.0, 1.0, 1.0 if side == "L" else -1.0)
    flat = np.hypot(outward[:, 0], outward[:, 1])
    raised = np.where(flat > _POLE, np.arctan2(outward[:, 1], outward[:, 0]), np.nan)
    raised = np.where(raised < -0.5 * math.pi, raised + 2.0 * math.pi, raised)
    aside = np.arctan2(outward[:, 2], flat)
    for place, angle in (
        ("flexion", raised),
        ("extension", -raised),
        ("abduction", aside),
        ("adduction", -aside),
    ):
        yield f"arm.{place}", _most(angle, track), RANGE


def _most(angle: Array, track: Track) -> float:
    """Greatest value of unmarked samples; NaN without any."""
    kept = angle[np.isfinite(angle) & ~track.marked]
    return float(kept.max()) if len(kept) else math.nan
