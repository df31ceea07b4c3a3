"""The same recording under other beliefs about people: models and profiles side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from occupancy.body import load_profile, profile_names
from occupancy.humans.catalog import MODEL_NAMES
from robots.assumption import Assumption, Certainty
from verifier.cell import Cell
from verifier.opened import open_placed
from verifier.replay import verify
from verifier.reports.verification import VerifyReport
from verifier.setup import require_cell
from verifier.verdict import Status

_WEAKEST_FIRST = (
    Certainty.UNVERIFIED,
    Certainty.ASSUMED,
    Certainty.DEFAULT,
    Certainty.MEASURED,
    Certainty.DECLARED,
    Certainty.SOURCED,
    Certainty.COMPUTED,
)
_MOTION = ("speed", "acceleration", "arm")


@dataclass(frozen=True, slots=True)
class Compared:
    """What one belief about people makes of a recording.

    Attributes
    ----------
    profile, models:
        The belief.
    verified, not_verified, contradicted, not_checked:
        Numbers of cycles.
    time_lost_s:
        Recorded time in cycles that are not verified or contradicted [s]: there the robot would not have been
        allowed to go on.
    weakest:
        What the belief rests on least firmly: an assumption that the recording contradicts, else the number
        about motion with the least certainty.
    exit_status, waived:
        As of a run of its own.
    """

    profile: str
    models: tuple[str, ...]
    verified: int
    not_verified: int
    contradicted: int
    not_checked: int
    time_lost_s: float
    weakest: str
    exit_status: int
    waived: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {**asdict(self), "models": list(self.models), "waived": list(self.waived)}


def beliefs(cell: Cell) -> Iterator[Cell]:
    """Yield the cell as it is, then with every profile: each of its models alone, and all of them.

    A profile file that the cell names comes before the bundled ones. An approach speed belongs to the profile
    of the cell.
    """
    require_cell(cell)
    yield cell
    table = cell.model_dump(exclude_unset=True)
    stated = table.get("people", {})
    of_others = {key: value for key, value in stated.items() if key != "approach_speed_m_s"}
    own = () if cell.people.profile in profile_names() else (cell.people.profile,)
    for profile in (*own, *profile_names()):
        known = _that_follow(profile)
        for models in (*((name,) for name in known), known):
            kept = stated if profile == cell.people.profile else of_others
            people = {**kept, "profile": profile, "models": models}
            other = Cell.from_table({**table, "people": people}, where="comparison")
            if _belief(other) != _belief(cell):
                yield other


def _belief(cell: Cell) -> tuple[str, frozenset[str]]:
    return cell.people.profile, frozenset(cell.people.models)


def _that_follow(profile: str) -> tuple[str, ...]:
    """Models that follow from a bundled profile or a profile file, in the order in which they are asked."""
    follow = load_profile(Path(profile) if profile.endswith(".toml") else profile).models
    return tuple(name for name in MODEL_NAMES if name in follow)


def compare(
    recording: str | Path,
    cell: Cell,
    *,
    progress: Callable[[float], None] | None = None,
    cache_dir: Path | None = None,
) -> list[Compared]:
    """Verify a recording under every belief; the first row is that of the cell itself.

    Raises
    ------
    SetupError
        As :func:`verifier.replay.verify`.
    """
    source, cell = open_placed(recording, cell)
    cells = list(beliefs(cell))
    rows = []
    for number, each in enumerate(cells):
        rows.append(_row(each, verify(source, each, cache_dir=cache_dir)))
        if progress is not None:
            progress((number + 1) / len(cells))
    return rows


NOTES = (
    "the first row is the cell as it is, then come a profile file of the cell and the bundled profiles; "
    "'all that follow': all models of the profile together",
    "time lost: recorded time in cycles that are not verified or contradicted",
    "weakest assumption: one that the recording contradicts, else the number about people's motion with the "
    "least certainty; sizes of bodies and limbs are listed by verify without --compare",
)
"""What a reader of the table must know."""


def waived_lines(rows: list[Compared]) -> list[str]:
    """Return what every row waives: it is the cell's, whatever is believed about people."""
    return [f"waived: {text}" for text in rows[0].waived]


def table(rows: list[Compared]) -> list[str]:
    """Return the comparison as lines of text."""
    heads = (
        "profile",
        "models",
        "verified",
        "not verified",
        "contradicted",
        "not checked",
        "time lost",
        "weakest assumption",
    )
    cells = [
        (
            row.profile,
            _names(row),
            str(row.verified),
            str(row.not_verified),
            str(row.contradicted),
            str(row.not_checked),
            f"{row.time_lost_s:.2f} s",
            row.weakest,
        )
        for row in rows
    ]
    widths = [max(len(line[i]) for line in (heads, *cells)) for i in range(len(heads))]
    return [
        "  ".join(
            text.rjust(width) if 2 <= i <= 6 else text.ljust(width)
            for i, (text, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in (heads, *cells)
    ]


def _names(row: Compared) -> str:
    """Name the models of a row."""
    together = set(row.models) == set(_that_follow(row.profile))
    return "all that follow" if together and len(row.models) > 1 else ", ".join(row.models)


def _row(cell: Cell, report: VerifyReport) -> Compared:
    lost = report.count(Status.NOT_VERIFIED) + report.count(Status.CONTRADICTED)
    return Compared(
        profile=cell.people.profile,
        models=cell.people.models,
        verified=report.count(Status.VERIFIED),
        not_verified=report.count(Status.NOT_VERIFIED),
        contradicted=report.count(Status.CONTRADICTED),
        not_checked=report.count(Status.NOT_CHECKED),
        time_lost_s=lost * cell.cycle_s,
        weakest=_weakest(report),
        exit_status=report.exit_status,
        waived=report.waived,
    )


def _weakest(report: VerifyReport) -> str:
    """Name the least firm thing that a report rests on, as far as people are concerned."""
    contradicted = [item for item in report.contradicted if item.assumption.startswith("A1")]
    if contradicted:
        return f"{contradicted[0].assumption}: contradicted by this recording"
    motion = [item for item in report.assumptions if _about_motion(item)]
    if not motion:
        return ""
    weakest = min(motion, key=lambda item: _WEAKEST_FIRST.index(item.certainty))
    place = weakest.name.split(".", 2)[-1]
    return f"{place} = {weakest.value:g} {weakest.unit} ({weakest.certainty})"


def _about_motion(item: Assumption) -> bool:
    places = item.name.split(".")
    return places[0] == "people" and len(places) > 2 and places[2] in _MOTION and item.value != ""
