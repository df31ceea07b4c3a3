"""Tables of numbers with unit, source and certainty, as profile files have them."""

from __future__ import annotations

from dataclasses import dataclass

from robots.assumption import Assumption, Certainty
from robots.errors import SetupError

Table = dict[str, object]


class ProfileError(SetupError):
    """A profile file that cannot be used; the message names file, key, value and rule."""


_NUMBER = ("value", "unit", "source", "certainty")
_MAY_BE_ZERO = ".shortest"
_LARGEST = 1.7976931348623157e308
"""Of all numbers in double precision."""


@dataclass(frozen=True)
class NumberReader:
    """Reads tables of numbers into assumptions, refusing what is not a number with unit and source."""

    file: str
    prefix: str
    found: dict[str, Assumption]

    def read(self, table: Table, place: str, unit: str) -> None:
        """Read every number of a table whose numbers all have one unit."""
        for key in table:
            self._read_number(sub_table(table, self.file, key, place), f"{place}.{key}", unit)

    def value(self, place: str) -> float:
        """Return a number that was read."""
        return float(self.found[place].value)

    def _read_number(self, number: Table, place: str, unit: str) -> None:
        where = f"profile {self.file}: {place}"
        check_keys(number, self.file, place, required=_NUMBER)
        value, source, certainty = number["value"], number["source"], number["certainty"]
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST:
            raise ProfileError(f"{where}: value {value!r} must be a finite number")
        if value < 0.0 or (value == 0.0 and not place.endswith(_MAY_BE_ZERO)):
            raise ProfileError(f"{where}: value {value!r} must be positive")
        if number["unit"] != unit:
            raise ProfileError(f"{where}: unit {number['unit']!r} must be {unit!r}")
        if not (isinstance(source, str) and source.strip()):
            raise ProfileError(f"{where}: source must say where the value comes from")
        if certainty not in list(Certainty):
            raise ProfileError(f"{where}: certainty {certainty!r} must be one of {', '.join(Certainty)}")
        name = f"{self.prefix}.{place}"
        self.found[place] = Assumption(name, float(value), unit, source, Certainty(str(certainty)))


def sub_table(table: Table, file: str, key: str, place: str = "") -> Table:
    """Return a table within a table."""
    value = table[key]
    if not isinstance(value, dict):
        raise ProfileError(f"profile {file}: {place + '.' if place else ''}{key} must be a table")
    return value


def check_keys(
    table: Table, file: str, place: str, *, required: tuple[str, ...], optional: tuple[str, ...] = ()
) -> None:
    """Refuse a table with missing or unknown keys."""
    where = f"profile {file}: {place or 'file'}"
    missing = [key for key in required if key not in table]
    if missing:
        raise ProfileError(f"{where}: missing {', '.join(missing)}")
    unknown = [key for key in table if key not in required and key not in optional]
    if unknown:
        raise ProfileError(
            f"{where}: unknown key {', '.join(unknown)}; known are {', '.join(required + optional)}"
        )
