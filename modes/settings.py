"""Settings of modes: what is not a number of its range is refused by name, with what it should be."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral, Real

import numpy as np
from numpy.typing import NDArray

from robots.errors import SetupError


def require_number(name: str, value: object, low: float, high: float, *, above: bool = False) -> None:
    """Refuse what is no number from ``low`` to ``high``; ``above``: ``low`` itself is refused, too.

    Parameters
    ----------
    name:
        What messages call it: the mode, and the name of the setting.

    Raises
    ------
    SetupError
        It is something else; a text, a truth value and NaN are.
    """
    if isinstance(value, Real) and not isinstance(value, bool):
        number = float(value)
        if low <= number <= high and not (above and number == low):
            return
    least = f"above {low:g}" if above else f"at least {low:g}"
    raise SetupError(f"{name} = {value!r} should be a number {least} and at most {high:g}")


def require_count(name: str, value: object, low: int, high: int) -> None:
    """Refuse what is no whole number from ``low`` to ``high``.

    Raises
    ------
    SetupError
        It is something else; 3.0 is.
    """
    if isinstance(value, Integral) and not isinstance(value, bool) and low <= int(value) <= high:
        return
    raise SetupError(f"{name} = {value!r} should be a whole number from {low} to {high}")


def require_kind(name: str, value: object, kind: type, *, written: str) -> None:
    """Refuse what is not of a class; ``written``: how one writes it.

    Raises
    ------
    SetupError
        It is something else.
    """
    if not isinstance(value, kind):
        raise SetupError(f"{name} = {value!r} should be {written}")


def require_numbers(name: str, value: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return an array of that shape; refuse what has another one, or is not finite. -1: any length.

    Raises
    ------
    SetupError
        It is something else.
    """
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.empty(())
    fits = found.ndim == len(shape) and all(
        wanted in {-1, have} for wanted, have in zip(shape, found.shape, strict=True)
    )
    if not fits or not np.isfinite(found).all():
        wanted = " by ".join("any" if each < 0 else str(each) for each in shape)
        shown = " ".join(repr(value).split())
        shown = shown if len(shown) <= 80 else f"{shown[:77]}..."
        raise SetupError(f"{name} = {shown} should be {wanted} finite numbers")
    return found


def require_choice(name: str, value: object, known: Sequence[str]) -> None:
    """Refuse what is not among ``known``.

    Raises
    ------
    SetupError
        It is something else.
    """
    if not (isinstance(value, str) and value in known):
        raise SetupError(f"{name} = {value!r} should be one of {', '.join(known)}")
