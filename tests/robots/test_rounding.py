"""The processor's rounding mode: only rounding to nearest is let through."""

from __future__ import annotations

import ctypes
import ctypes.util
import platform
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from robots.errors import SetupError
from robots.rounding import require_rounding_to_nearest

MODES = {
    "x86_64": {"downward": 0x400, "upward": 0x800, "toward zero": 0xC00},
    "aarch64": {"upward": 0x400000, "downward": 0x800000, "toward zero": 0xC00000},
}
"""What ``fenv.h`` calls FE_DOWNWARD, FE_UPWARD and FE_TOWARDZERO."""


@contextmanager
def rounding(mode: str) -> Iterator[None]:
    library = ctypes.CDLL(ctypes.util.find_library("m"))
    modes = MODES.get(platform.machine())
    if modes is None:
        pytest.skip(f"the numbers of the rounding modes of {platform.machine()} are not stated here")
    nearest = library.fegetround()
    assert library.fesetround(modes[mode]) == 0
    try:
        yield
    finally:
        library.fesetround(nearest)


def test_rounding_to_nearest_is_let_through() -> None:
    require_rounding_to_nearest()


@pytest.mark.parametrize("mode", ["upward", "downward", "toward zero"])
def test_any_other_rounding_is_refused(mode: str) -> None:
    with rounding(mode), pytest.raises(SetupError, match="not rounded to nearest"):
        require_rounding_to_nearest()
    require_rounding_to_nearest()
