"""How the processor rounds: every bound here rests on rounding to nearest."""

from __future__ import annotations

import numpy as np

from robots.errors import SetupError


def require_rounding_to_nearest() -> None:
    """Some libraries leave the processor rounding upward for the whole process, which no bound allows for.

    Raises
    ------
    SetupError
        Floating-point numbers are not rounded to nearest.
    """
    half_ulp = np.ldexp(np.ones(2), [-53, -54])
    if not (1.0 + half_ulp[0] == 1.0 and 1.0 - half_ulp[1] == 1.0):
        raise SetupError(
            "floating-point numbers are not rounded to nearest: another library of this process has changed "
            "the processor's rounding mode (interval libraries do); run the check in a process of its own"
        )
