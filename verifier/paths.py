"""Whether two paths name one file."""

from __future__ import annotations

import os
from pathlib import Path


def same_file(one: str | Path, other: str | Path) -> bool:
    """Return whether both paths lead to one file, also where it is not there yet."""
    try:
        return Path(one).samefile(other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)
