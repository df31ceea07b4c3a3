"""The text of a cell file: from TOML to plain values, and how one that breaks a rule is refused."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from robots.errors import SetupError
from robots.files import LARGEST_TEXT, read_bytes
from verifier.cell_template import BLANK
from verifier.shown import LONGEST_VALUE, shown

_BLANK_VALUE = re.compile(rf"(?:^|[=\[,])\s*([\"']?){BLANK}\1\s*(?=[,\]#]|$)")
"""A blank where a value stands; within a longer word or path it is none."""
TOO_DEEP = "nested too deeply; a cell has tables of numbers and names"


class CellError(SetupError):
    """A cell that cannot be used; ``str()`` is one line: file, key, what is wrong, what would be right."""


def read_table(path: Path) -> dict[str, Any]:
    """Read a cell file as TOML.

    Raises
    ------
    CellError
        The file is not there, is not TOML, or has blanks.
    """
    try:
        text = read_bytes(path, LARGEST_TEXT).decode("utf-8-sig")
        _refuse_blanks(text, path)
        return tomllib.loads(text)
    except RecursionError as error:
        raise CellError(f"{path}: not a TOML file: {TOO_DEEP}") from error
    except SetupError as error:
        raise CellError(str(error)) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CellError(f"{path}: not a TOML file: {error}") from error
    except ValueError as error:  # Python reads no integer with more than 4300 digits
        raise CellError(f"{path}: not a TOML file: a number has thousands of digits") from error


def _refuse_blanks(text: str, path: Path) -> None:
    blanks = [
        f"line {number}: {line.split('#')[0].strip()}"
        for number, line in enumerate(text.splitlines(), 1)
        if _BLANK_VALUE.search(line)
    ]
    if blanks:
        raise CellError(f"{path}: fill in every {BLANK}: {'; '.join(blanks)}")


def plain(value: Any) -> Any:
    """Return TOML arrays as tuples: strict validation takes nothing else; integers stand for floats."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return tuple(plain(entry) for entry in value)
    if isinstance(value, int) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            return math.inf if value > 0 else -math.inf
    return value


DOCUMENT: Final = "docs/cell.md"
_LISTED: Final = "{document} lists the keys with their units"
_RULES: Final = {
    "missing": f"is missing; {_LISTED}",
    "extra_forbidden": f"unknown key; {_LISTED}",
    "invalid_key": "a key must be text",
    "float_type": "must be a number",
    "finite_number": "must be a finite number",
    "bool_type": "must be true or false",
    "string_type": "must be text in quotes",
    "tuple_type": "must be a list in brackets",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "too_long": "must have {max_length} entries, not {actual_length}",
    "greater_than": "must be above {gt:.9g}",
    "greater_than_equal": "must be at least {ge:.9g}",
    "less_than": "must be below {lt:.9g}",
    "less_than_equal": "must be at most {le:.9g}",
}
"""Kinds of errors of the library that validates -> the rule, in the words of a cell file."""
_WHOLE: Final = "cell"
"""What a rule about several tables is about."""
NOT_TAKEN: Final = "is nothing that this key takes; {document} says what it means"


def first_problem(error: ValidationError, table: Mapping[str, Any], document: str = DOCUMENT) -> str:
    """Return the first key that breaks a rule, an unknown one before others, its value and the rule;
    ``document``: what lists the keys."""
    problems = [(_key(each["loc"], each["type"], table), each) for each in error.errors(include_url=False)]
    # a key that is missing may be the one that is misspelt
    problems.sort(key=lambda problem: problem[1]["type"] != "extra_forbidden")
    key, first = problems[0]
    given = first.get("input")
    expected = [_expected(each) for other, each in problems if other == key]
    if len(expected) > 1 and not isinstance(given, float):
        text = f"must be {' or '.join(expected)}"
    else:
        text = _rule(first, document)
    others = len({key for key, _each in problems}) - 1
    more = f" (and {others} more)" if others else ""
    whole = first["type"] in ("missing", "value_error") and isinstance(given, dict | tuple)
    value = "" if whole else f" = {shown(_as_written(given), LONGEST_VALUE)}"
    place = "" if (key, value) == (_WHOLE, "") else f"{key}{value}: "
    return f"{place}{text}{more}"


def _rule(problem: Mapping[str, Any], document: str) -> str:
    """Return what the value of a key would have to be."""
    kind, details = str(problem["type"]), problem.get("ctx", {})
    if kind == "value_error":
        return str(problem["msg"]).removeprefix("Value error, ")
    if kind == "literal_error":
        return f"must be {_expected(problem)}"
    if kind == "missing" and isinstance(problem["loc"][-1], int):
        return "is missing: the list has too few entries"
    return _RULES.get(kind, NOT_TAKEN).format(document=document, **details)


def _as_written(value: object) -> str:
    """Return a value much as TOML has it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_as_written, value))}]"
    if isinstance(value, dict):
        return "{…}"
    return repr(value) if isinstance(value, int | float | str) else str(value)


def _key(steps: Sequence[int | str], kind: str, table: Mapping[str, Any]) -> str:
    """Return the place in the table, without the steps by which pydantic tells the types of a value apart."""
    keys: list[str] = []
    value: Any = table
    for step in steps:
        if isinstance(value, dict) and (step in value or kind == "missing"):
            value = value.get(step)
        elif isinstance(value, tuple | list) and isinstance(step, int):
            value = value[step] if step < len(value) else None
        else:
            break
        keys.append(shown(step))
    return ".".join(keys) or _WHOLE


def _expected(problem: Mapping[str, Any]) -> str:
    """Return what one of several types that a value may have would take."""
    if problem["type"] == "literal_error":
        return str(problem["ctx"]["expected"]).replace("'", '"')
    return "a number"
