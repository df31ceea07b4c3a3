"""The distances that standards require with the stops of a report, or what is missing for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from failsafe.stopping import STOP_TIME
from robots.assumption import Assumption, Certainty
from verifier.cell import Cell
from verifier.required_distance import (
    Edition,
    RequiredDistance,
    declared,
    normal_approach,
    parallel_approach,
)
from verifier.stop_report.report import Distance, Missing, Reaction, StopCase
from verifier.stop_report.settings import StopReportSettings

FORM_2010, FORM_2024 = "S = K T + C", "S = K T + D_DS + Z"
_OF_2024 = "only the form of this edition is known here"


_NO_DEVICE = Missing(
    "C",
    "depends on the protective device, and nobody has stated it",
    "--resolution M (field that is reached through), --field-height M (field along the floor)",
)


def reaction_of(cell: Cell) -> Reaction:
    """Return the times that pass until a stop begins: report, two periods of the cycle, delay."""
    stated = {item.name: item for item in cell.assumptions()}
    rows = (
        ("detection", "people.latency_s", 1.0, ""),
        ("decision", "cycle_s", 2.0, "two periods, to compute and to hand over, of "),
        ("actuation", "robot.tracking.delay_max_s", 1.0, ""),
    )
    parts = []
    for name, key, times, how in rows:
        item = stated[f"cell.{key}"]
        parts.append(
            Assumption(name, times * float(item.value), "s", f"{how}{key}: {item.source}", item.certainty)
        )
    return Reaction(tuple(parts))


def check_device(settings: StopReportSettings) -> None:
    """Refuse, before any work, a protective device that no formula knows.

    Raises
    ------
    SetupError
        As the functions of :mod:`verifier.required_distance`.
    """
    _device((declared("T", 0.0, "s"),), settings)


def distances_of(
    cases: Sequence[StopCase], reaction: Reaction, settings: StopReportSettings
) -> tuple[Distance, ...]:
    """Return S of every stop that is bounded and not guessed, in every form that is known."""
    return tuple(each for case in cases if not case.guessed for each in _of_case(case, reaction, settings))


def _of_case(case: StopCase, reaction: Reaction, settings: StopReportSettings) -> Iterator[Distance]:
    longest = case.largest(STOP_TIME)
    parts: tuple[Assumption, ...] = reaction.parts
    unknown: tuple[Missing, ...] = ()
    if longest is not None and longest.method != "none":
        how = f"upper number of {longest.quantity}, {longest.method}"
        parts = (*parts, Assumption("stop", longest.upper, "s", how, Certainty.COMPUTED))
    else:
        reason = "no stop" if longest is None else longest.reason
        unknown = (Missing("T", f"the stop has no upper number: {reason}"),)
    device = _device(parts, settings) if not unknown else None
    stated = settings.resolution_m is not None or settings.height_m is not None
    lacking = unknown if stated else (*unknown, _NO_DEVICE)
    yield Distance(case.stop, case.over, str(Edition.ISO_13855_2010), FORM_2010, parts, device, lacking)
    if unknown:
        return
    later = tuple(
        Missing(term, _OF_2024, "verifier.required_distance.separation_2024") for term in ("K", "D_DS", "Z")
    )
    yield Distance(case.stop, case.over, str(Edition.ISO_13855_2024), FORM_2024, parts, None, later)


def _device(parts: Sequence[Assumption], settings: StopReportSettings) -> RequiredDistance | None:
    """Return S for the device that was stated; ``None``: none was."""
    resolution = None
    if settings.resolution_m is not None:
        resolution = declared("d", settings.resolution_m, "m")
    if settings.height_m is not None:
        return parallel_approach(parts, declared("H", settings.height_m, "m"), resolution)
    return None if resolution is None else normal_approach(parts, resolution)
