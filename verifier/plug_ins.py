"""What other packages bring: entry points, found by group and name."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

from robots.errors import SetupError


def plug_in_names(group: str) -> tuple[str, ...]:
    """Return the names that are installed in a group."""
    return tuple(sorted(entry_points(group=group).names))


def find_plug_in(group: str, name: str, kind: str) -> EntryPoint:
    """Return the one entry point of that name; ``kind``: what messages call it.

    Raises
    ------
    SetupError
        There is none, or there are several.
    """
    found = tuple(entry_points(group=group, name=name))
    if len(found) != 1:
        known = ", ".join(plug_in_names(group)) or "none"
        how_many = f"{len(found)} are" if found else "none is"
        raise SetupError(f"{kind} {name!r}: {how_many} installed under this name; known: {known}")
    return found[0]
