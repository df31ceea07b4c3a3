"""Contacts in recordings: external joint torques of a collision, and forces of a hand that guides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.contact.detection import ForceThresholds, ToolDetector
from modes.contact.filters import Stream, Variant, force_high_pass
from modes.settings import require_number
from robots.errors import SetupError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class TorqueThresholds:
    """What the high-passed external torque of each joint may reach without being a collision.

    Attributes
    ----------
    torque_Nm:
        ``(n,)`` [N m].
    rate_hz:
        At which torques come [Hz].

    Raises
    ------
    SetupError
        A threshold is not above 0.
    """

    torque_Nm: Array
    rate_hz: float

    def __post_init__(self) -> None:
        for joint, value in enumerate(self.torque_Nm):
            require_number(f"torque thresholds: joint {joint + 1}", float(value), 0.0, 1e6, above=True)

    @classmethod
    def from_quiet(cls, quiet: list[Array], rate_hz: float, factor: float = 1.5) -> TorqueThresholds:
        """Return ``factor`` times the most that recordings ``(T, n)`` [N m] without contact reach.

        Raises
        ------
        SetupError
            There is none, or one has what is not a number.
        """
        if not quiet or not all(len(each) and np.isfinite(each).all() for each in quiet):
            raise SetupError("torque thresholds: give recordings without contact, all of numbers")
        most = np.max([np.abs(_high_passed(each, rate_hz)).max(axis=0) for each in quiet], axis=0)
        return cls(factor * most, rate_hz)

    def alarms(self, torque: Array) -> Mask:
        """Return which samples ``(T,)`` of torques ``(T, n)`` [N m] are called a collision."""
        return np.asarray((np.abs(_high_passed(torque, self.rate_hz)) > self.torque_Nm).any(axis=1))


def _high_passed(torque: Array, rate_hz: float) -> Array:
    stream = Stream(force_high_pass("exact", rate_hz), torque.shape[1])
    return np.array([stream.step(each) for each in np.asarray(torque, dtype=float)])


class Detected(NamedTuple):
    """What became of a recording with one contact.

    Attributes
    ----------
    delay_s:
        From the contact to the first alarm after it [s]; NaN: there was none.
    false_alarms:
        Samples with an alarm before the contact; all of them where there was no contact.
    """

    delay_s: float
    false_alarms: int


def detect(alarms: Mask, t: Array, contact_s: float) -> Detected:
    """Hold alarms ``(T,)`` at ``t (T,)`` [s] against when the contact began [s]; NaN: there was none."""
    after = alarms & (t >= contact_s)
    delay = float(t[after.argmax()] - contact_s) if after.any() else float("nan")
    return Detected(delay, int((alarms & ~(t >= contact_s)).sum()))


class Intention(NamedTuple):
    """How much of a recording of forces is taken for the wish to collaborate, and for collisions.

    Attributes
    ----------
    held:
        ``(T,)`` when somebody is taken to hold the tool.
    collisions:
        Samples that are taken for a collision.
    mean_N, highest_N:
        Of the force [N].
    """

    held: Mask
    collisions: int
    mean_N: float
    highest_N: float


def intention(
    force: Array, rate_hz: float, thresholds: ForceThresholds | None = None, variant: Variant = "corrected"
) -> Intention:
    """Run the detector of the end effector over forces ``(T, 3)`` [N]."""
    detector = ToolDetector(thresholds, variant, rate_hz)
    found = [detector.step(each) for each in np.asarray(force, dtype=float)]
    size = np.linalg.norm(force, axis=1)
    held = np.array([each.lasts for each in found])
    return Intention(held, sum(each.collision for each in found), float(size.mean()), float(size.max()))
