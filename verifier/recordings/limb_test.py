"""Are the joints of a skeleton those of its joint set? Held against the limbs of its first bodies."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from occupancy.body import LIMBS, MAX_POINTS, Point
from verifier.recordings.decoded import SourceError
from verifier.recordings.people_report import ReportedPerson

FloatArray = NDArray[np.float64]

BODIES = 50
"""So many bodies are looked at: those of the first second or two."""
FLAT_M = 1e-3
"""Points that all lie within this along one axis [m] are those of a picture."""
FEWEST_POINTS = 5
"""Bodies with fewer points may lie in a plane by chance."""
CENTRED_M = 0.005
"""Middles of the hips that are all nearer to the origin than this [m] are the origin."""
_UNITS = {"mm": 1e-3, "cm": 1e-2, "inches": 0.0254}
_FILE = Path(__file__).with_name("limb_lengths.toml")


@dataclass(frozen=True, slots=True)
class LimbLengths:
    """Shortest and longest length [m] of each limb of :data:`occupancy.body.LIMBS`, and the largest ratio of
    two that are left and right of each other."""

    limits: dict[str, tuple[float, float]]
    longest_ratio: float


@cache
def limb_lengths() -> LimbLengths:
    """Return the lengths of ``limb_lengths.toml``."""
    table = tomllib.loads(_FILE.read_text(encoding="utf-8"))
    limits = {name: (float(low), float(high)) for name, (low, high) in table["limb"].items()}
    return LimbLengths(limits, float(table["longest_ratio"]))


@dataclass(slots=True)
class LimbTest:
    """Collects the first bodies of one source, and refuses what cannot be theirs.

    Medians are compared, so that single glitches refuse nothing. Left and right as a whole cannot be told
    from each other by lengths: ``people.left_right`` of the cell says whether they may be exchanged.

    Attributes
    ----------
    title:
        What the joints are said to be.
    must_be_seen:
        Whether a source of which no limb is ever seen is refused: where indices are all that says what is
        what.
    bodies:
        How many have been looked at.
    """

    title: str
    must_be_seen: bool = True
    bodies: int = 0
    _xyz: list[FloatArray] = field(default_factory=list)

    def add(self, person: ReportedPerson) -> None:
        """Look at one body; those without a measured point, and those after the first 50, are passed over.

        Raises
        ------
        SourceError
            It was the last of them, and they do not fit.
        """
        if self.bodies >= BODIES or not person.measured:
            return
        measured = np.array([person.measured >> column & 1 for column in range(MAX_POINTS)], np.bool_)
        self._xyz.append(np.where(measured[:, None], person.xyz, np.nan))
        self.bodies += 1
        if self.bodies == BODIES:
            self._judge()

    def finish(self) -> None:
        """Judge a source that had fewer bodies, if it has not been judged yet.

        Raises
        ------
        SourceError
            They do not fit.
        """
        if self._xyz:
            self._judge()

    def _judge(self) -> None:
        xyz = np.array(self._xyz)
        self._xyz.clear()
        self._refuse_flat(xyz)
        self._refuse_centred(xyz)
        known = limb_lengths()
        tested = 0
        for limb, pairs in LIMBS.items():
            lengths = [_median(np.linalg.norm(xyz[:, a] - xyz[:, b], axis=1)) for a, b in pairs]
            for (a, b), length in zip(pairs, lengths, strict=True):
                self._refuse_length(_between(a, b), length, known.limits[limb])
            tested += int(np.isfinite(lengths).sum())
            ratio = max(lengths) / max(min(lengths), 1e-9)
            if known.limits[limb][0] > 0.0 and ratio > known.longest_ratio:
                which = (f"{_between(a, b)} is {d:.3g} m" for (a, b), d in zip(pairs, lengths, strict=True))
                self._refuse(f"{', '.join(which)} long")
        if self.must_be_seen and not tested:
            raise SourceError(
                f"no limb of anybody has both ends measured, so nothing tells that the joints are those of "
                f"{self.title}; at least one limb must be seen"
            )

    def _refuse_length(self, which: str, length: float, limits: tuple[float, float]) -> None:
        low, high = limits
        if low <= length <= high or np.isnan(length):
            return
        unit = next((u for u, scale in _UNITS.items() if low <= length * scale <= high and low > 0.0), "")
        like = f", as if in {unit}" if unit else ""
        self._refuse(f"{which} is {length:.4g} m long{like} (a person's: {low:g} to {high:g} m)")

    def _refuse(self, wrong: str) -> None:
        raise SourceError(
            f"the joints are not those of {self.title} in metres: {wrong}; give the set and the unit that "
            "were recorded"
        )

    def _refuse_flat(self, xyz: FloatArray) -> None:
        many = xyz[np.isfinite(xyz[..., 0]).sum(axis=1) >= FEWEST_POINTS]
        extent = np.nanmax(many, axis=1) - np.nanmin(many, axis=1) if len(many) else np.ones((1, 3))
        if (extent.max(axis=0) < FLAT_M).any():
            raise SourceError(
                f"the skeletons of {self.title} are flat, as in a picture; positions in 3-D are needed"
            )

    def _refuse_centred(self, xyz: FloatArray) -> None:
        middle = np.linalg.norm(0.5 * (xyz[:, Point.L_HIP] + xyz[:, Point.R_HIP]), axis=1)
        seen = middle[np.isfinite(middle)]
        if len(seen) and seen.max() < CENTRED_M:
            raise SourceError(
                f"the skeletons of {self.title} are centred at the hips and do not say where the person is; "
                "positions in the frame of a sensor are needed"
            )


def _median(lengths: FloatArray) -> float:
    """Median of the lengths that are known; NaN if none is."""
    known = lengths[np.isfinite(lengths)]
    return float(np.median(known)) if len(known) else float("nan")


def _between(a: Point, b: Point) -> str:
    return f"{a.name.lower()} to {b.name.lower()}"
