"""Numbers that a caller gives, before anything is computed with them."""

from __future__ import annotations

import math
from numbers import Real


def as_float(value: object) -> float:
    """Return a real number of whatever type as Python's; NaN where it is none, or too large to be one.

    What is computed with other types keeps them: an instant in single precision makes all later ones so, and
    compiled functions are compiled anew for each of them.
    """
    if type(value) is float:
        return value
    if not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except (OverflowError, ValueError):
        return math.nan
