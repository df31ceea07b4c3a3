"""Names and texts of other people's files as they may go to a terminal: one line, nothing that acts on it."""

from __future__ import annotations

LONGEST_NAME = 60
LONGEST_VALUE = 200
LONGEST_NOTE = 1000
LONGEST_LINE = 4000
"""The lists of joints and of assumptions of an arm with 16 joints are well below."""


def shown(name: object, longest: int = LONGEST_NAME) -> str:
    """Return a name of a recording, tool, URDF or cell for a line of text; JSON has it in full.

    Line breaks, escape sequences and whatever else does not print become visible (``\\n``, ``\\x1b``); of a
    longer name head and tail are left. An empty one becomes ``''``.
    """
    text = str(name)
    if not text:
        return "''"
    head, tail = longest - longest // 4 - 1, longest // 4
    if len(text) > longest:
        return f"{escaped(text[:head])}…{escaped(text[-tail:])}"
    return escaped(text)


def with_unit(value: object, unit: str) -> str:
    """Return a value with its unit; where both are lists (``"1 2 90"``, ``"m m deg"``), each with its own."""
    text, name = shown(value, LONGEST_VALUE), shown(unit) if unit else ""
    numbers, units = text.split(), name.split()
    if len(numbers) == len(units) > 1 and "," not in text:
        return ", ".join(map(" ".join, zip(numbers, units, strict=True)))
    return f"{text} {name}".rstrip()


def one_line(text: str) -> str:
    """Return a line as it may be printed: what would end it or act on the terminal is made visible."""
    return shown(text, LONGEST_LINE) if text else ""


def escaped(text: str) -> str:
    """Return ``text`` with everything that does not print as Python would write it in a string."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
