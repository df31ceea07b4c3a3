"""How a recording is refused: one line that says file, place, what is wrong and what would be right."""

from __future__ import annotations

from pathlib import Path

from robots.errors import SetupError


def one_line(text: str) -> str:
    """Return ``text`` with everything that does not print (line breaks included) made visible or a blank."""
    return "".join(c if c.isprintable() else " " if c.isspace() else repr(c)[1:-1] for c in text)


class RecordingError(SetupError):
    """A recording, or a file to make one from, that cannot be used.

    Attributes
    ----------
    path:
        The file.
    place:
        Where in the file: topic, message, time, line or column; ``""`` for the whole file.
    wrong, right:
        What is wrong, and what would be right or how to mend it (``""`` when nothing helps).
    """

    def __init__(self, path: str | Path, place: str, wrong: str, right: str = "") -> None:
        self.path = Path(path)
        self.place = place
        self.wrong = wrong
        self.right = right
        text = ": ".join(part for part in (str(path), place, wrong) if part)
        super().__init__(one_line(f"{text}; {right}" if right else text))


class OutputExistsError(RecordingError):
    """A file that would be overwritten without having been told to."""

    def __init__(self, path: str | Path) -> None:
        super().__init__(path, "", "exists already", "choose another name, or overwrite it with --force")
