"""What a verdict rests on: one number, its unit, where it comes from and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Certainty(StrEnum):
    """How far a number can be relied upon; shown wherever the number is used."""

    SOURCED = "sourced"
    """Read in the named source."""
    COMPUTED = "computed"
    """Derived from other numbers; reproducible."""
    MEASURED = "measured"
    """Taken from the recording that is being verified, or those that a profile was identified from."""
    DECLARED = "declared"
    """Stated by the user in the cell file or on the command line."""
    DEFAULT = "default"
    """Nobody stated it; this software's default was used."""
    ASSUMED = "assumed"
    """An engineering choice without a source."""
    UNVERIFIED = "unverified"
    """Recalled or copied from a secondary source; nobody has checked it."""


@dataclass(frozen=True, slots=True)
class Assumption:
    """One assumption of a verdict.

    Attributes
    ----------
    name:
        Dotted lower-case identifier, e.g. ``robot.ur5.acceleration.elbow_joint``.
    value:
        The number, or a short text where the assumption is not a number.
    unit:
        Unit of ``value`` (``m``, ``rad/s``, …); ``""`` for text and for pure numbers.
    source:
        Where the value comes from, in words a reader can follow up.
    certainty:
        How sure it is.
    """

    name: str
    value: float | str
    unit: str
    source: str
    certainty: Certainty
