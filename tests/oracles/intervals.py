"""Outward-rounded intervals by codac, without what it does to everybody else's arithmetic.

Importing codac makes the processor round upward, for the whole process and for good; its intervals are
outward only while it does. Here the mode is put back after the import, and switched on within a
``with outward():``.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from collections.abc import Iterator
from contextlib import contextmanager

_LIBM = ctypes.CDLL(ctypes.util.find_library("m"))
_NEAREST = _LIBM.fegetround()

from codac import Interval  # noqa: E402  (the mode before the import is needed)

_UPWARD = _LIBM.fegetround()
_LIBM.fesetround(_NEAREST)

__all__ = ["Interval", "outward"]


@contextmanager
def outward() -> Iterator[None]:
    """Round as codac needs it."""
    _LIBM.fesetround(_UPWARD)
    try:
        yield
    finally:
        _LIBM.fesetround(_NEAREST)
