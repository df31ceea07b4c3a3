"""Where numba keeps compiled code; it gives up, before it compiles, where it finds no folder for it."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

_COMPILED = ("robots", "occupancy", "failsafe")
"""Packages with compiled functions."""


def choose_folder() -> None:
    """Name a folder to numba where neither the user's nor those beside the source will do.

    It is the user's cache folder, or else one that is removed when the program ends. It is called before
    numba is imported.

    Raises
    ------
    OSError
        There is no folder at all that can be written to.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen and _can_write(Path(chosen)):
        return
    source = Path(__file__).resolve().parent.parent
    if all(_can_write(source / name / "__pycache__") for name in _COMPILED):
        return
    with suppress(RuntimeError):  # there may be no home
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stopproof" / "numba"
        if _can_write(folder):
            os.environ["NUMBA_CACHE_DIR"] = str(folder)
            return
    temporary = tempfile.mkdtemp(prefix="stopproof-")
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = temporary


def _can_write(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True
