"""A result of `verify`, read back from the JSON that it wrote."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from robots.errors import SetupError
from robots.files import printed
from verifier.reports.verification import FORMAT
from verifier.result_file import Count, ReadFile, ResultFile, Stated, Table
from verifier.verdict import Status

WRITTEN_BY = "`stopproof verify --json`"
SCHEMA = "docs/verify.schema.json"
"""Lists the keys of a result."""
MOST_NS = 2**62
"""Of a clock [ns]: sums of two stay within 64 bits."""


class Pair(Table):
    """A witness: names, gap [m] and budget [m]."""

    cycle_t: float
    link: str
    person: str
    part: str
    other: str
    gap_m: float | None
    criterion: str
    model: str
    inferred: bool
    age_s: float | None
    budget_m: dict[str, float | str | None]


class Excess(Table):
    """The first joint limit that stood in the way."""

    t: float
    joint: str
    quantity: str
    value: float | None
    limit: float | None
    unit: str


class Against(Table):
    """A contradicted assumption."""

    reason: str
    assumption: str
    text: str
    first_t: float
    cycles: Count


class StopTime(Table):
    """Over all cycles with a stop [s]."""

    median: float | None
    max: float | None


class Rows(Table):
    """One entry per cycle in each list."""

    t: Annotated[list[float], Field(min_length=1)]
    status: list[Literal[0, 1, 2, 3]]
    reason: list[Count]
    gap_m: list[float | None]
    stop_time_s: list[float | None]

    @model_validator(mode="after")
    def _one_entry_each(self) -> Rows:
        lengths = {len(row) for row in (self.t, self.status, self.reason, self.gap_m, self.stop_time_s)}
        if len(lengths) != 1:
            raise ValueError("the lists must be of one length")
        if not (np.diff(self.t) > 0.0).all() or not abs(self.t[-1]) < 1e9 or self.t[0] < 0.0:
            raise ValueError("t must begin at 0 or later and increase")
        return self


class VerifyResult(Table):
    """What `verify --json` has written; docs/verify.schema.json says what each key is."""

    recording: str
    robot: str
    stop_model: str
    profile: str
    cell_hash: str
    version: str
    start_ns: Annotated[int, Field(ge=-MOST_NS, le=MOST_NS)]
    cycles: Count
    verified: Count
    not_verified: Count
    not_checked: Count
    contradicted: Count
    stops_in_joint_space: Count
    reasons: dict[str, dict[str, Count]]
    waived: list[str]
    criteria: list[str]
    criteria_not_checked: list[str]
    notes: list[str]
    refused_measurements_total: Count
    refused_measurements_by_reason: dict[str, Count]
    contradictions: list[Against]
    first_witness: Pair | None
    deepest: Pair | None
    tightest: Pair | None
    first_limit_excess: Excess | None
    stop_time_s: StopTime
    assumptions: list[Stated]
    inputs: list[ReadFile]
    reason_names: dict[str, str]
    per_cycle: Rows

    @model_validator(mode="after")
    def _counts_are_those_of_the_cycles(self) -> VerifyResult:
        for status in Status:
            name = status.name.lower()
            if getattr(self, name) != sum(each == status for each in self.per_cycle.status):
                raise ValueError(f"{name} is not the number of such cycles in per_cycle")
        if self.cycles != len(self.per_cycle.t):
            raise ValueError("cycles is not the length of per_cycle")
        unknown = {str(number) for number in self.per_cycle.reason} - self.reason_names.keys()
        if unknown:
            raise ValueError(f"reason {min(unknown)} of per_cycle is not in reason_names")
        return self

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """(N,) instants of the cycles since the start of the overlap [ns]."""
        return np.round(np.array(self.per_cycle.t) * 1e9).astype(np.int64)

    @property
    def step_s(self) -> float:
        """Length of a cycle [s]."""
        t = self.per_cycle.t
        return t[1] - t[0] if len(t) > 1 else 1.0

    def series(self, name: Literal["gap_m", "stop_time_s"]) -> NDArray[np.float64]:
        """Return (N,) values of the cycles; NaN: none."""
        return np.array(getattr(self.per_cycle, name), dtype=np.float64)

    def hash_of(self, what: str) -> str | None:
        """Return the hash of an input; ``None``: there is none of this kind."""
        return next((item.sha256 for item in self.inputs if item.what == what), None)


def read_result(path: str | Path) -> VerifyResult:
    """Read a result of `verify --json`.

    Raises
    ------
    SetupError
        The file cannot be read, or is no result of `verify` in the format of this version, in one line.
    """
    return verify_result(ResultFile(path, WRITTEN_BY))


def verify_result(file: ResultFile) -> VerifyResult:
    """Return the result of `verify` that a file holds.

    Raises
    ------
    SetupError
        It holds none in the format of this version, in one line.
    """
    if file.format != FORMAT:
        raise SetupError(f"{file}: {_no_result(file.value, file.format)}")
    return file.require(VerifyResult, SCHEMA)


def _no_result(value: object, stated: object) -> str:
    if isinstance(stated, str) and stated.startswith("stopproof verify "):
        return f"is of the format {printed(stated)}, this version compares {FORMAT!r}; verify again"
    if stated is None and isinstance(value, dict) and {"per_cycle", "cell_hash"} <= value.keys():
        return "names no format: an older version wrote it; verify again"
    return f"is no result of {WRITTEN_BY}"
