"""What a result rests on, as text and as JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from robots.assumption import Assumption, Certainty
from verifier.shown import shown, with_unit

OF_THE_MODEL = (
    ("A1", "every person's body moves and is shaped within the limits of the chosen profile"),
    (
        "A2",
        "the robot follows what is commanded with a delay in [δ_min, δ_max], a joint error of at most e_j "
        "and a joint velocity error of at most ė_j",
    ),
    ("A3", "links, tool and payload lie in their enclosures"),
    (
        "A4",
        "the robot would have begun the stop at t_k+2 and driven it as planned, or at any time from then on "
        "have stopped by itself as [robot.silence] declares",
    ),
    (
        "A5",
        "everyone in the monitored region is reported: with [people.monitored] tables, whoever had some part "
        "in a region throughout its detection time is listed in a report marked complete; without, everyone "
        "there is",
    ),
    (
        "A6",
        "base, sensors and fixtures are calibrated: each reported point is within its position error e_p of "
        "the true point (sensor, joint centre against marker, filter lag, translation and rotation of the "
        "sensor frame)",
    ),
    ("A7", "clocks agree within ε, stamps are right within σ"),
)
"""What every verdict rests on, as docs/method.md, section 1, states it."""

_SHOWN = (Certainty.DEFAULT, Certainty.MEASURED, Certainty.ASSUMED, Certainty.UNVERIFIED)
"""What a reader must know without asking; sourced, computed and declared numbers are in the JSON."""


def assumption_lines(stated: Sequence[Assumption]) -> list[str]:
    """Return what a result rests on but no source vouches for, one line for each degree of certainty."""
    lines: list[str] = []
    for certainty in _SHOWN:
        items = [item for item in stated if item.certainty is certainty]
        sizes = [item for item in items if _is_body_size(item)]
        texts = _grouped([item for item in items if not _is_body_size(item)])
        texts += [f"{len(sizes)} body sizes of the profile (listed in --json)"] if sizes else []
        if texts:
            lines.append(f"{certainty}: {', '.join(texts)}")
    return lines


def assumption_dicts(stated: Sequence[Assumption]) -> list[dict[str, Any]]:
    """Return assumptions as plain values for JSON; a number that is not finite becomes ``None``."""
    return [
        {
            "name": item.name,
            "value": item.value if isinstance(item.value, str) or math.isfinite(item.value) else None,
            "unit": item.unit,
            "source": item.source,
            "certainty": str(item.certainty),
        }
        for item in stated
    ]


def _is_body_size(item: Assumption) -> bool:
    return item.name.startswith("people.") and item.name.split(".")[2:3] in (["limb"], ["limit"], ["stature"])


def _grouped(items: list[Assumption]) -> list[str]:
    """Return assumptions as short texts; those of several joints or limbs with one value become one."""
    groups: dict[tuple[str, str], list[str]] = {}
    for item in items:
        value = with_unit(item.value if isinstance(item.value, str) else f"{item.value:g}", item.unit)
        stem, dot, last = item.name.removeprefix("cell.").rpartition(".")
        groups.setdefault((shown(stem) if dot else "", value), []).append(shown(last))
    return [
        f"{stem}.{names[0]} = {value}".lstrip(".")
        if len(names) == 1
        else f"{stem}.{{{', '.join(names)}}} = {value}"
        for (stem, value), names in groups.items()
    ]
