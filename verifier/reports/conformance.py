"""What `conformance` found: its JSON, the tables that the command line prints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from itertools import groupby
from typing import Any

from occupancy.containment import Containment
from robots.assumption import Assumption, Certainty
from verifier.conformance import RecordedFile, Result
from verifier.shown import shown

NO_LIMIT = (
    "note: an identified profile says what these people did in these recordings; it is no limit for other "
    "people or tasks"
)
_NOTES = (
    "inside: share of the later samples whose every measured point lies in the rows of its parts, as deep as "
    "the flesh around it is thick; worst: the point that lies farthest out (+), or least deep (-), with the "
    "time in seconds from the first report that --at takes",
    "apart: pairs of samples with a reading between them that was refused or that no profile allows, in no "
    "share; no rows: pairs of which the model said nothing; both at the longest horizon",
    "volume: sum over the rows of one person at 200 ms, median; their union takes at most as much",
)
_SHOWN_VOLUME_S = 0.2


@dataclass(frozen=True, slots=True)
class _Line:
    """One line of a table: shares in percent, the worst point of all horizons, counts, volume."""

    profile: str
    model: str
    horizons: Sequence[Containment]
    where: str

    def text(self, widths: tuple[int, int]) -> str:
        """Return the line; ``widths``: of the columns of profile and model."""
        shares = "".join(f"{_percent(row):>9}" for row in self.horizons)
        last = self.horizons[-1]
        volume = next((r.volume_m3 for r in self.horizons if r.horizon_s == _SHOWN_VOLUME_S), math.nan)
        shown = f"{volume:.4g} m³" if math.isfinite(volume) else "-"
        counts = f"{last.frames:>7}{last.apart:>7}{last.without_rows:>8}"
        who = f"{self.profile:<{widths[0]}}{self.model:<{widths[1]}}"
        return f"  {who}{shares}{counts}{shown:>14}  {self.where}"


def conformance_list(results: Sequence[Result], every: int) -> list[dict[str, Any]]:
    """Return what stands in the JSON: one entry per recording, model, profile and horizon.

    Each entry says with what it was found: ``every`` so-manieth sample was once the last known one.
    """
    made_by = version("stopproof")
    return [
        {
            "recording": result.file.path.name,
            "model": result.model,
            "profile": result.profile,
            "horizon_s": row.horizon_s,
            "frames": row.frames,
            "inside": row.inside / row.frames if row.frames else None,
            "outside": row.frames - row.inside,
            "apart": row.apart,
            "without_rows": row.without_rows,
            "worst_excess_m": _finite(row.worst_excess_m),
            "worst_frame": row.worst_frame if row.frames else None,
            "worst_t_s": _worst_t_s(result.file, row) if row.frames else None,
            "worst_person": row.worst_person if row.frames else None,
            "worst_part": row.worst_part if row.frames else None,
            "worst_point": row.worst_point if row.frames else None,
            "volume_m3": _finite(row.volume_m3),
            "position_error_m": result.file.position_error_m,
            "position_error_source": result.file.stated,
            "every": every,
            "samples": result.file.samples,
            "marked": result.file.marked,
            "version": made_by,
        }
        for result in results
        for row in result.horizons
    ]


def conformance_lines(results: Sequence[Result], every: int) -> list[str]:
    """Return the tables as text, one per recording and one over all of them."""
    horizons = [row.horizon_s for row in results[0].horizons]
    widths = _width("profile  ", (r.profile for r in results)), _width("model", (r.model for r in results))
    sampled = "every sample" if every == 1 else f"every {every}th sample"
    head = (
        f"people as recorded against what was predicted of them, {sampled} once the last known one, in the "
        "model; no robot, no stop"
    )
    columns = "".join(f"{f'{1e3 * h:g} ms':>9}" for h in horizons)
    title = (
        f"  {'profile':<{widths[0]}}{'model':<{widths[1]}}{columns}{'frames':>7}{'apart':>7}{'no rows':>8}"
        f"{'volume':>14}  worst"
    )
    lines = [head]
    for file, group in groupby(results, key=lambda result: result.file):
        lines += [*_file_lines(file), title]
        lines += [_of_one(result).text(widths) for result in group]
    if len({id(result.file) for result in results}) > 1:
        lines += ["all recordings, inside:", title, *(line.text(widths) for line in _over_all(results))]
    return [*lines, *_NOTES]


def _width(head: str, texts: Iterable[str]) -> int:
    """Width of a column under ``head``, with a space behind its longest text."""
    return max(map(len, (head, *texts))) + 1


def _file_lines(file: RecordedFile) -> Iterator[str]:
    where = "" if file.stated == "stated by the file" else " where a reading states none"
    error = f"position error {file.position_error_m:g} m ({file.stated}){where}"
    marked = f"{file.marked} marked by the gate" if file.marked else "none marked by the gate"
    yield f"{shown(file.name)}: {file.samples} samples, {marked}, {error}; inside:"
    yield from (f"  refused: {n} points: {reason}" for reason, n in sorted(file.people.refused.items()))
    yield from (f"  note: {note}" for note in file.notes)


def _of_one(result: Result) -> _Line:
    return _Line(result.profile, result.model, result.horizons, _worst([("", result)]))


def _over_all(results: Sequence[Result]) -> Iterator[_Line]:
    """Add the counts of all files up, per profile and model."""
    keys = dict.fromkeys((result.profile, result.model) for result in results)
    for profile, model in keys:
        own = [result for result in results if (result.profile, result.model) == (profile, model)]
        total = [_sum([result.horizons[h] for result in own]) for h in range(len(own[0].horizons))]
        yield _Line(profile, model, total, _worst([(result.file.name, result) for result in own]))


def _sum(rows: Sequence[Containment]) -> Containment:
    total = Containment(rows[0].horizon_s)
    for row in rows:
        total.frames += row.frames
        total.inside += row.inside
        total.apart += row.apart
        total.without_rows += row.without_rows
        total.volumes_m3 += row.volumes_m3
    return total


def _worst(found: Sequence[tuple[str, Result]]) -> str:
    """Return excess, horizon, time, frame and part of the worst point of all horizons."""
    rows = [(name, of.file, row) for name, of in found for row in of.horizons if row.frames]
    if not rows:
        return "nothing was tested"
    name, file, row = max(rows, key=lambda each: each[2].worst_excess_m)
    point = "" if row.worst_point == row.worst_part else f" ({row.worst_point})"
    of = f" of {shown(name)}" if name else ""
    at = f"{shown(row.worst_person)} at {_worst_t_s(file, row):.4f} s (frame {row.worst_frame})"
    when = f"{1e3 * row.horizon_s:g} ms after {at}{of}"
    return f"{row.worst_excess_m:+.3f} m {row.worst_part}{point}, {when}"


def _worst_t_s(file: RecordedFile, row: Containment) -> float:
    return file.seconds(row.worst_person, row.worst_frame)


def _percent(row: Containment) -> str:
    """Share in percent, rounded down: 100 stands for all."""
    return f"{math.floor(1e4 * row.inside / row.frames) / 100:.2f} %" if row.frames else "-"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def identified_lines(path: str, numbers: Sequence[Assumption]) -> list[str]:
    """Return what was identified: the measured numbers, those of one table in a line."""
    tables: dict[tuple[str, str], list[str]] = {}
    for number in numbers:
        if number.certainty is Certainty.MEASURED:
            _, _, table, *key = number.name.split(".")
            tables.setdefault((table, number.unit), []).append(f"{'.'.join(key)} {number.value:g}")
    kept = sum(number.certainty is not Certainty.MEASURED for number in numbers)
    return [
        f"identified profile {shown(path)}:",
        *(f"  {table} [{unit}]: {', '.join(values)}" for (table, unit), values in tables.items()),
        f"  {kept} numbers are not in the recordings and stand as in the profile extreme",
        NO_LIMIT,
    ]
