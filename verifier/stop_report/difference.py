"""What changed between two stop reports: worst cases, fields of grids, numbers, assumptions, inputs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from verifier.changes import (
    TOLERANCE,
    AssumptionChange,
    Changed,
    InputChange,
    TextChange,
    Value,
    allowed,
    changed_assumptions,
    changed_inputs,
    changed_numbers,
    changed_texts,
    plain,
    same,
)
from verifier.stop_report.read_back import Grid, OfPart, Span, StopReportResult, WorstCase

_TIMES = (("time_s", "stop time", "s"), ("way_m", "way", "m"), ("point_speed_m_s", "point speed", "m/s"))


@dataclass(frozen=True, slots=True)
class Bounds:
    """A bracket: reached at least, and not exceeded (``None``: not bounded)."""

    lower: float
    upper: float | None

    def step_to(self, other: Bounds) -> float:
        """Return by how much the number grows that one would take: the upper one; infinite where it is lost.

        Where there is none on either side, it is the lower one.
        """
        if self.upper is None and other.upper is None:
            return other.lower - self.lower
        before, after = (math.inf if each.upper is None else each.upper for each in (self, other))
        return after - before


@dataclass(frozen=True, slots=True)
class WorstCaseChange:
    """A bracket that is another one in B; ``None``: it is not there.

    Attributes
    ----------
    stop, over, guessed, quantity, part, unit:
        Of what it is the worst case.
    a, b:
        Both brackets.
    apart:
        No number is in both: the worst case itself is another one. Else a search may have come farther.
    """

    stop: str
    over: str
    guessed: bool
    quantity: str
    part: str
    unit: str
    a: Bounds | None
    b: Bounds | None
    apart: bool


@dataclass(frozen=True, slots=True)
class FieldExtreme:
    """The field with the largest change of a grid, by its shares, and both brackets there.

    ``extension`` is ``None`` where the arm has none: the field is of every configuration.
    """

    load: float
    speed: float
    extension: float | None
    a: Bounds
    b: Bounds


@dataclass(frozen=True, slots=True)
class GridChange:
    """How a quantity changed over the fields of a grid.

    Attributes
    ----------
    stop, guessed, quantity, part, unit:
        Of which stop, and what; ``part`` is a joint, or empty where a quantity is the largest of all.
    compared, changed, apart:
        Fields that both have, those with another bracket, and those whose brackets share no number.
    only_in_a, only_in_b:
        Fields that only one has.
    fall, rise:
        Where the number that one would take became smaller, and larger, most.
    """

    stop: str
    guessed: bool
    quantity: str
    part: str
    unit: str
    compared: int
    changed: int
    apart: int
    only_in_a: int
    only_in_b: int
    fall: FieldExtreme | None
    rise: FieldExtreme | None


@dataclass(frozen=True, slots=True)
class StopReportDifference:
    """What changed from stop report A to stop report B."""

    compared: int
    worst_cases: tuple[WorstCaseChange, ...]
    grids: tuple[GridChange, ...]
    numbers: tuple[Changed, ...]
    assumptions: tuple[AssumptionChange, ...]
    inputs: tuple[InputChange, ...]
    texts: tuple[TextChange, ...]

    @property
    def changed(self) -> bool:
        """Whether anything did."""
        parts = (self.worst_cases, self.grids, self.numbers, self.assumptions, self.inputs, self.texts)
        return any(parts)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"changed": self.changed, **plain(asdict(self))}


def stop_report_difference(
    a: StopReportResult, b: StopReportResult, tolerance: float = TOLERANCE
) -> StopReportDifference:
    """Compare two stop reports.

    Parameters
    ----------
    a, b:
        The reports; what differs is stated from A to B.
    tolerance:
        Metres and seconds that count as no change; other numbers may differ by 1e-9 of their value. How long
        a search took, version, poses, and names and folders of files are not compared.
    """
    before, after = cases(a), cases(b)
    missing = ([f"{each.what}: {each.why}" for each in report.missing] for report in (a, b))
    return StopReportDifference(
        len(before.keys() & after.keys()),
        tuple(_worst_cases(before, after, tolerance)),
        tuple(_grids(a, b, tolerance)),
        tuple(changed_numbers(stop_facts(a), stop_facts(b), tolerance)),
        tuple(changed_assumptions(a.assumptions, b.assumptions)),
        tuple(changed_inputs(a.inputs, b.inputs)),
        (*changed_texts("waived", a.waived, b.waived), *changed_texts("missing", *missing)),
    )


Key = tuple[str, str, bool, str, str, str]
"""Stop, over what, whether its brakes are guessed, quantity, part, unit."""


def cases(report: StopReportResult) -> dict[Key, WorstCase]:
    """Return the worst cases by what they are of; the largest where two are of the same."""
    found: dict[Key, WorstCase] = {}
    for each in report.worst_case:
        key = (each.stop, each.over, each.guessed, each.quantity, each.part, each.unit)
        if key not in found or bounds(found[key]).step_to(bounds(each)) > 0.0:
            found[key] = each
    return found


def bounds(each: Span) -> Bounds:
    """Return a bracket alone."""
    return Bounds(each.lower, each.upper)


def alike(a: Bounds, b: Bounds, tolerance: float) -> bool:
    """Whether two brackets count as one."""
    return same(a.lower, b.lower, tolerance) and same(a.upper, b.upper, tolerance)


def apart(a: Bounds, b: Bounds) -> bool:
    """Whether no number is in both."""
    return (a.upper is not None and a.upper < b.lower) or (b.upper is not None and b.upper < a.lower)


def _worst_cases(
    before: dict[Key, WorstCase], after: dict[Key, WorstCase], tolerance: float
) -> Iterator[WorstCaseChange]:
    for key in dict.fromkeys((*before, *after)):
        old, new = before.get(key), after.get(key)
        stop, over, guessed, quantity, part, unit = key
        sides = [None if each is None else bounds(each) for each in (old, new)]
        a, b = sides
        if a is None or b is None:
            yield WorstCaseChange(stop, over, guessed, quantity, part, unit, a, b, apart=True)
        elif not alike(a, b, allowed(tolerance, unit)):
            yield WorstCaseChange(stop, over, guessed, quantity, part, unit, a, b, apart(a, b))


def stop_facts(report: StopReportResult) -> dict[str, tuple[str, Value]]:
    """Return unit and value of every number and name that is compared, by its place in the JSON."""
    units = dict(zip(report.joints, report.units, strict=True))
    found: dict[str, tuple[str, Value]] = {
        name: ("", getattr(report, name)) for name in ("robot", "tool", "recording", "stop_model")
    }
    found |= {"cell_hash": ("", report.cell_hash), "joints": ("", ", ".join(report.joints))}
    found |= {
        "answer.total_s": ("s", report.answer.total_s),
        "answer.stop": ("", report.answer.stop),
        "answer.over": ("", report.answer.over),
        "reaction.seconds": ("s", report.reaction.seconds),
        "speed": ("", report.speed),
        "interrupted": ("", str(report.interrupted).lower()),
    }
    for joint, speed in zip(report.joints, report.speeds, strict=True):
        found[f"units.{joint}"] = ("", units[joint])
        found[f"speeds.{joint}"] = (f"{units[joint]}/s", speed)
    for each in report.required_distances:
        place = f"required_distances.{each.stop}.{each.over}.{each.edition}.{each.form}"
        found[place] = ("m", each.distance_m)
    for grid in report.grids:
        found[f"grids.{grid.stop}.load_kg"] = ("kg", grid.load_kg)
        found[f"grids.{grid.stop}.load_matters"] = ("", str(grid.load_matters).lower())
        found[f"grids.{grid.stop}.complete"] = ("", str(grid.complete).lower())
    found |= _torque_facts(report)
    found |= _recorded_facts(report)
    return found


def _torque_facts(report: StopReportResult) -> Iterator[tuple[str, tuple[str, Value]]]:
    """Yield what drives allow, by the share of the load: another payload has other loads."""
    largest = max((each.load_kg for each in report.torques), default=0.0)
    for torque in report.torques:
        share = torque.load_kg / largest if largest > 0.0 else 1.0
        place = f"torques.{100.0 * share:.0f} % of the load"
        yield f"{place}.load_kg", ("kg", torque.load_kg)
        yield f"{place}.share_guaranteed", ("", torque.share_guaranteed)
        yield f"{place}.share_found", ("", torque.share_found)
        yield f"{place}.joint", ("", torque.joint)
        for each in torque.torques:
            yield f"{place}.{each.joint}.lower", (each.unit, each.lower)
            yield f"{place}.{each.joint}.upper", (each.unit, each.upper)


def _recorded_facts(report: StopReportResult) -> Iterator[tuple[str, tuple[str, Value]]]:
    if report.recorded is not None:
        for name in ("cycles", "looked_at", "planned", "without_stop", "beyond_end", "off_path"):
            yield f"recorded.{name}", ("cycles", getattr(report.recorded, name))
    separation = report.protective_separation
    if separation is None:
        return
    place = "protective_separation"
    yield f"{place}.profile", ("", separation.profile)
    yield f"{place}.compared", ("cycles", separation.compared)
    yield f"{place}.too_close", ("cycles", separation.too_close)
    if separation.worst is not None:
        for name, unit in (("t", "s"), ("separation_m", "m"), ("room_m", "m"), ("link", ""), ("person", "")):
            yield f"{place}.worst.{name}", (unit, getattr(separation.worst, name))
        yield f"{place}.worst.required.distance_m", ("m", separation.worst.required.distance_m)


Shares = tuple[float, float, float | None]
"""Of load, speed and extension; ``None``: the arm has no extension."""


@dataclass(frozen=True, slots=True)
class _Quantity:
    """What is compared over a grid: its fields' brackets."""

    name: str
    part: str
    unit: str
    fields: dict[Shares, Bounds]


def quantities(grid: Grid, report: StopReportResult) -> Iterator[_Quantity]:
    """Yield each quantity of a grid with the bracket of every field that has one."""
    for key, name, unit in _TIMES:
        yield _Quantity(name, "", unit, dict(_fields(grid, [getattr(c.braking, key) for c in grid.cells])))
    for j, (joint, unit) in enumerate(zip(report.joints, report.units, strict=True)):
        of_joint = [c.braking.angles[j] if j < len(c.braking.angles) else None for c in grid.cells]
        yield _Quantity("angle", joint, unit, dict(_fields(grid, of_joint)))


def _fields(grid: Grid, brackets: Sequence[OfPart | None]) -> Iterator[tuple[Shares, Bounds]]:
    for cell, each in zip(grid.cells, brackets, strict=True):
        if each is not None:
            yield (cell.load, cell.speed, grid.extension(cell)), bounds(each)


def _grids(a: StopReportResult, b: StopReportResult, tolerance: float) -> Iterator[GridChange]:
    """Yield the quantities that changed, of each grid that both or one has."""
    before, after = ({grid.stop: (grid, report) for grid in report.grids} for report in (a, b))
    for stop in dict.fromkeys((*before, *after)):
        sides = [
            {} if side is None else {(each.name, each.part, each.unit): each for each in quantities(*side)}
            for side in (before.get(stop), after.get(stop))
        ]
        guessed = any(side[stop][0].guessed for side in (before, after) if stop in side)
        for key in dict.fromkeys((*sides[0], *sides[1])):
            one = sides[0].get(key) or sides[1][key]
            pair = tuple(side[key].fields if key in side else {} for side in sides)
            change = _grid_change(stop, one, pair, allowed(tolerance, one.unit), guessed=guessed)
            if change.changed or change.only_in_a or change.only_in_b:
                yield change


def _grid_change(
    stop: str,
    what: _Quantity,
    sides: tuple[dict[Shares, Bounds], ...],
    tolerance: float,
    *,
    guessed: bool,
) -> GridChange:
    a, b = sides
    both = [key for key in a if key in b]
    moved = [key for key in both if not alike(a[key], b[key], tolerance)]
    steps = {key: a[key].step_to(b[key]) for key in moved}
    least, most = (choose(steps, key=steps.__getitem__, default=None) for choose in (min, max))
    return GridChange(
        stop=stop,
        guessed=guessed,
        quantity=what.name,
        part=what.part,
        unit=what.unit,
        compared=len(both),
        changed=len(moved),
        apart=sum(apart(a[key], b[key]) for key in moved),
        only_in_a=len(a.keys() - b.keys()),
        only_in_b=len(b.keys() - a.keys()),
        fall=None if least is None or steps[least] >= 0.0 else FieldExtreme(*least, a[least], b[least]),
        rise=None if most is None or steps[most] <= 0.0 else FieldExtreme(*most, a[most], b[most]),
    )
