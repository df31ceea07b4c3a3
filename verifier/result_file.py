"""Results that a command wrote as JSON, read back: what all kinds of them have in common."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from robots.errors import SetupError
from robots.files import printed, read_bytes
from verifier.cell_reading import first_problem
from verifier.recordings.json_text import JsonError, loads

Count = Annotated[int, Field(ge=0)]


class Table(BaseModel):
    """Part of a result; keys that are not compared are not looked at."""

    model_config = ConfigDict(extra="ignore", strict=True, frozen=True, allow_inf_nan=False)


class Stated(Table):
    """One assumption; ``value`` is ``None`` where the number is infinite."""

    name: str
    value: float | str | None
    unit: str
    source: str
    certainty: str


class ReadFile(Table):
    """One input file."""

    what: str
    file: str
    bytes: Count
    sha256: str


T = TypeVar("T", bound=Table)


class ResultFile:
    """A file with a result, not looked into yet.

    Attributes
    ----------
    value:
        What is written there.
    format:
        The kind of result and the number of its format; ``None``: it states none.

    Raises
    ------
    SetupError
        The file cannot be read, or is not JSON, in one line.
    """

    def __init__(self, path: str | Path, written_by: str) -> None:
        self.path = Path(path)
        try:
            self.value: Any = loads(read_bytes(self.path))
        except JsonError as error:
            raise SetupError(f"{self}: {error}; name a file that {written_by} wrote") from error
        stated = self.value.get("format") if isinstance(self.value, dict) else None
        self.format: object = stated

    def __str__(self) -> str:
        return str(printed(self.path))

    def require(self, model: type[T], schema: str) -> T:
        """Return what is written there as ``model``; ``schema`` lists its keys.

        Raises
        ------
        SetupError
            It is something else, in one line.
        """
        try:
            return model.model_validate(self.value)
        except ValidationError as error:
            raise SetupError(f"{self}: {first_problem(error, self.value, schema)}") from error
