"""JSON that others have written: what one reader would see and another would not is refused."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any


class JsonError(ValueError):
    """Text that is no JSON, or says two things at once; ``str()`` says what is wrong."""


def loads(text: str | bytes) -> Any:
    """Parse JSON; in no object may a key be given twice, or the second would hide what the first says.

    Raises
    ------
    JsonError
        It is no JSON, is nested too deeply, holds a number of more digits than are read, or a key is given
        twice in one object.
    """
    try:
        return json.loads(text, object_pairs_hook=_object)
    except JsonError:
        raise
    except RecursionError as error:
        raise JsonError("not JSON: nested too deeply") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise JsonError(f"not JSON: {error}") from error
    except ValueError as error:
        raise JsonError("not JSON: a number has too many digits") from error


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        twice = next(key for key, n in Counter(key for key, _value in pairs).items() if n > 1)
        raise JsonError(f"key {twice[:40]!r} is given twice in one object")
    return found
