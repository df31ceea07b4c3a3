"""Whether times and lengths of a file look like another unit than s and m; nothing is refused for it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from occupancy.body import load_profile
from verifier.recordings.joint_state import NANO
from verifier.recordings.people_report import PeopleReport
from verifier.shown import shown

FloatArray = NDArray[np.float64]

SLOW_STEP_S: Final = 0.5
"""Samples that are mostly farther apart than this [s], and …"""
SLOW_MOTION: Final = 0.05
"""… between which everything mostly moves slower than this [rad/s or m/s] are more likely in ms."""
TIMES_A_PERSON: Final = 2.5
"""Limbs longer than a person's by this factor, or shorter by it, are more likely in another unit."""
FAR_M: Final = 100.0
"""Points that are mostly farther away than this [m] are beyond what sensors are taken to reach."""
DEGREES_ABOVE: Final = 20.0
"""Joint values beyond this are more likely degrees than rad: real wrists were seen at 12.6 rad."""
LOOKED_AT: Final = 1000
"""As many samples of a file are looked at."""
_UNITS: Final = {"mm": 1000.0, "cm": 100.0, "inches": 39.37, "feet": 3.281}
"""How many of them there are in a metre."""
_PROFILE: Final = "iso"


class Pace:
    """Time between the samples of one file, and how fast things move from one to the next."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[int, FloatArray]] = {}
        self._steps_s: list[float] = []
        self._speeds: list[float] = []

    @property
    def full(self) -> bool:
        """Whether enough samples were looked at."""
        return len(self._steps_s) >= LOOKED_AT

    def add(self, what: str, t_ns: int, x: FloatArray) -> None:
        """Take in values (…) [rad or m] of something at an instant [ns]; NaN: missing."""
        if self.full:
            return
        t_before, before = self._last.get(what, (t_ns, x))
        self._last[what] = (t_ns, x)
        if t_ns > t_before:
            step = (t_ns - t_before) / NANO
            self._steps_s.append(step)
            moved = np.abs(x - before)
            self._speeds.append(float(np.fmax.reduce(moved, axis=None, initial=0.0)) / step)

    def remarks(self, file: str, metre: float = 1.0) -> Iterator[str]:
        """Yield that times look like milliseconds, if they do; ``metre``: what one is in the file's unit."""
        if not self._steps_s:
            return
        step, speed = float(np.median(self._steps_s)), float(np.median(self._speeds))
        if step > SLOW_STEP_S and speed < SLOW_MOTION * metre:
            yield (
                f"{shown(file)}: samples are mostly {step:.4g} s apart, and hardly anything moves between: "
                "are its times in ms? they are read as s"
            )


class JointUnits:
    """How fast and how far the joints of one file go; ``names``: of all its joints (J,)."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._pace = Pace()
        self._largest = np.zeros(len(names))

    def add(self, t_ns: NDArray[np.int64], q: FloatArray) -> None:
        """Take in positions (T, J) [rad or m] at instants (T,) [ns], in their order."""
        if not self._pace.full:
            for time, position in zip(t_ns.tolist(), q, strict=True):
                self._pace.add("joints", time, position)
        size = np.abs(q)
        self._largest = np.max(size, axis=0, initial=0.0, where=np.isfinite(size)).clip(self._largest)

    def remarks(self, file: str) -> Iterator[str]:
        """Yield what looks like another unit."""
        yield from self._pace.remarks(file)
        worst = int(np.argmax(self._largest)) if len(self._names) else 0
        if len(self._names) and self._largest[worst] > DEGREES_ABOVE:
            yield (
                f"{shown(file)}: {shown(self._names[worst])} goes up to {self._largest[worst]:.4g}: are its "
                "positions in degrees? they are read as rad (m where a joint slides)"
            )


class LimbLengths:
    """Lengths of the limbs of the people of one file, as multiples of a person's."""

    def __init__(self) -> None:
        limits = load_profile(_PROFILE).limits[0]
        n = int(limits["n_limbs"])
        self._pairs = limits["limb"][:n]
        self._usual = 0.5 * (limits["limb_min"][:n] + limits["limb_max"][:n])
        self._times: list[float] = []

    def add(self, xyz: FloatArray) -> None:
        """Take in the points (20, 3) [m] of a person; NaN: missing."""
        if len(self._times) >= LOOKED_AT:
            return
        a, b = xyz[self._pairs[:, 0]], xyz[self._pairs[:, 1]]
        times = np.linalg.norm(a - b, axis=1) / self._usual
        seen = times[np.isfinite(times)]
        if len(seen):
            self._times.append(float(np.median(seen)))

    @property
    def times(self) -> float:
        """How many times as long as a person's they mostly are; 1 where there are none."""
        return float(np.median(self._times)) if self._times else 1.0

    def remarks(self, file: str) -> Iterator[str]:
        """Yield that coordinates look like another unit, if they do."""
        times = self.times
        if times > TIMES_A_PERSON:
            unit = min(_UNITS, key=lambda name: abs(math.log(_UNITS[name] / times)))
            asked = f"are its coordinates in {unit}?"
        elif 0.0 < times < 1.0 / TIMES_A_PERSON:
            asked = "what unit are its coordinates in?"
        else:
            return
        yield (
            f"{shown(file)}: limbs are about {_rounded(times)} times a person's: {asked} they are read as m, "
            "and verify refuses limbs that no person has"
        )


def _rounded(value: float) -> str:
    """Return a number with two digits that count, and no power of ten beside them."""
    return f"{float(f'{value:.2g}'):.15g}"


class PeopleUnits:
    """Both, of one file of people; where there is no limb, how far away the points are."""

    def __init__(self) -> None:
        self._pace, self._limbs = Pace(), LimbLengths()
        self._far_m: list[float] = []

    def add(self, report: PeopleReport) -> None:
        """Take in a report."""
        for person in report.people:
            if len(self._far_m) >= LOOKED_AT:
                return
            xyz = person.xyz.copy()
            xyz[~np.isfinite(xyz).all(axis=1) | ~xyz.any(axis=1)] = np.nan
            self._pace.add(person.id, report.stamp_ns, xyz)
            self._limbs.add(xyz)
            away = np.linalg.norm(xyz, axis=1)
            if not np.isnan(away).all():
                self._far_m.append(float(np.nanmedian(away)))

    def remarks(self, file: str) -> Iterator[str]:
        """Yield what looks like another unit."""
        yield from self._pace.remarks(file, self._limbs.times)
        lengths = list(self._limbs.remarks(file))
        yield from lengths
        far = float(np.median(self._far_m)) if self._far_m else 0.0
        if not lengths and far > FAR_M:
            yield (
                f"{shown(file)}: points are mostly {far:.4g} m from the origin, farther than {FAR_M:g} m: "
                "what unit are its coordinates in, and where is their frame? they are read as m"
            )
