"""What `verify` found: the numbers, their JSON and the text that the command line prints."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robots.assumption import Assumption, Certainty
from verifier.verdict import Reason, Status, Witness

DISCLAIMER = (
    "Simulated. Not a manufacturer's declaration, not a safety function, no performance level claimed; "
    "validate by measurement."
)


@dataclass(frozen=True, slots=True)
class PerCycle:
    """One row per cycle: instant since the start of the overlap [s], status, gap [m], stop time [s]."""

    t: NDArray[np.float64]
    status: NDArray[np.uint8]
    reason: NDArray[np.uint8]
    gap_m: NDArray[np.float32]
    stop_time_s: NDArray[np.float32]

    def count(self, status: Status) -> int:
        """Return how many cycles have this status."""
        return int(np.count_nonzero(self.status == int(status)))


@dataclass(frozen=True, slots=True)
class Refused:
    """A measurement that was not used; the last good one kept growing."""

    stamp: float
    person: str
    point: str | None
    reason: str


@dataclass(frozen=True, slots=True)
class Contradicted:
    """An assumption that the data of the same run contradict, with the first place where they do."""

    assumption: str
    text: str
    first_t: float
    cycles: int


@dataclass(frozen=True, slots=True)
class LimitExcess:
    """The first joint limit that stood in the way of a plan; units as the limit has them."""

    t: float
    joint: str
    quantity: str
    value: float
    limit: float


@dataclass(frozen=True, slots=True)
class VerifyReport:
    """The result of verifying one recording offline; docs/verify.schema.json describes ``to_dict()``."""

    recording: str
    robot: str
    stop_model: str
    profile: str
    cell_hash: str
    version: str
    per_cycle: PerCycle
    stops_in_joint_space: int
    real_time_factor: float
    waived: tuple[str, ...]
    refused: tuple[Refused, ...]
    refused_total: int
    contradicted: tuple[Contradicted, ...]
    first_witness: Witness | None
    tightest: Witness | None
    first_excess: LimitExcess | None
    assumptions: tuple[Assumption, ...]
    not_checked_criteria: tuple[str, ...]
    start_ns: int
    """Start of the overlap, on the recording's clock [ns]: t = 0 of ``per_cycle``."""
    notes: tuple[str, ...]

    @property
    def cycles(self) -> int:
        """Number of cycles judged or listed as not checked."""
        return len(self.per_cycle.t)

    def count(self, status: Status) -> int:
        """Return how many cycles have this status."""
        return self.per_cycle.count(status)

    @property
    def exit_status(self) -> int:
        """0 all verified and nothing waived, 1 not verified or contradicted, 3 verified under waivers."""
        bad = self.count(Status.NOT_VERIFIED) + self.count(Status.CONTRADICTED)
        if bad > 0 or self.count(Status.VERIFIED) == 0:
            return 1
        return 3 if self.waived else 0

    def reasons(self, status: Status) -> list[tuple[Reason, int]]:
        """List the reasons of the cycles with this status, most frequent first."""
        values, counts = np.unique(
            self.per_cycle.reason[self.per_cycle.status == int(status)], return_counts=True
        )
        order = np.argsort(-counts, kind="stable")
        return [(Reason(int(values[i])), int(counts[i])) for i in order]

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON; NaN becomes ``None``."""
        rows = self.per_cycle
        witness = self.first_witness or self.tightest
        return {
            "recording": self.recording,
            "robot": self.robot,
            "stop_model": self.stop_model,
            "profile": self.profile,
            "cell_hash": self.cell_hash,
            "version": self.version,
            "disclaimer": DISCLAIMER,
            "cycles": self.cycles,
            "verified": self.count(Status.VERIFIED),
            "not_verified": self.count(Status.NOT_VERIFIED),
            "not_checked": self.count(Status.NOT_CHECKED),
            "contradicted": self.count(Status.CONTRADICTED),
            "stops_in_joint_space": self.stops_in_joint_space,
            "reasons": {
                status.name.lower(): {reason.name.lower(): n for reason, n in self.reasons(status)}
                for status in Status
            },
            "real_time_factor": _number(self.real_time_factor),
            "waived": list(self.waived),
            "criteria_not_checked": list(self.not_checked_criteria),
            "notes": list(self.notes),
            "refused_measurements": [asdict(item) for item in self.refused],
            "refused_measurements_total": self.refused_total,
            "contradictions": [asdict(item) for item in self.contradicted],
            "first_witness": witness_dict(self.first_witness),
            "tightest": witness_dict(self.tightest),
            "first_limit_excess": None if self.first_excess is None else _excess_dict(self.first_excess),
            "budget_m": None if witness is None else budget_dict(witness),
            "stop_time_s": _median_max(rows.stop_time_s),
            "assumptions": [
                {
                    "name": item.name,
                    "value": item.value if isinstance(item.value, str) else _number(item.value),
                    "unit": item.unit,
                    "source": item.source,
                    "certainty": str(item.certainty),
                }
                for item in self.assumptions
            ],
            "per_cycle": {
                "t": [round(float(t), 9) for t in rows.t],
                "status": [int(status) for status in rows.status],
                "gap_m": [_number(float(gap)) for gap in rows.gap_m],
                "stop_time_s": [_number(float(stop)) for stop in rows.stop_time_s],
            },
        }

    def verdicts(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield time [ns, the recording's clock] and verdict of every cycle, for the topic ``/verdict``."""
        rows = self.per_cycle
        for t, status, reason, gap, stop in zip(
            rows.t, rows.status, rows.reason, rows.gap_m, rows.stop_time_s, strict=True
        ):
            yield (
                self.start_ns + round(float(t) * 1e9),
                {
                    "status": Status(int(status)).name.lower(),
                    "reason": Reason(int(reason)).name.lower(),
                    "gap_m": _number(float(gap)),
                    "stop_time_s": _number(float(stop)),
                },
            )

    def lines(self) -> list[str]:
        """Return the report as text, one line each, most important first."""
        waived = "; ".join(self.waived) if self.waived else "nothing"
        stop = self.stop_model.replace("_", "-")
        return [
            f"stop: {stop} (this software's) · profile: {self.profile} · waived: {waived}",
            *self._count_lines(),
            *_witness_lines("first witness", self.first_witness),
            *_witness_lines("tightest pair", self.tightest),
            *self._budget_lines(),
            *self._excess_lines(),
            *self._contradiction_lines(),
            *self._refused_lines(),
            *[f"note: {note}" for note in self.notes],
            f"not checked: {', '.join(self.not_checked_criteria)}",
            *self._assumption_lines(),
            f"real-time factor {self.real_time_factor:.1f} (recorded time / computing time, decoding apart)",
            DISCLAIMER,
        ]

    def _count_lines(self) -> list[str]:
        verified, total = self.count(Status.VERIFIED), self.cycles
        head = f"verified in the model: {_spaced(verified)} of {_spaced(total)} cycles, under A1–A7"
        lines = [head]
        for status in (Status.NOT_VERIFIED, Status.CONTRADICTED, Status.NOT_CHECKED):
            for reason, n in self.reasons(status):
                label = status.name.lower().replace("_", " ")
                lines.append(f"  {label:<13}{_spaced(n):>9}  {reason.text}")
        stop = _median_max(self.per_cycle.stop_time_s)
        if stop["median"] is not None:
            lines.append(f"stop time: median {stop['median']:.3f} s, longest {stop['max']:.3f} s")
        if self.stops_in_joint_space:
            lines.append(
                f"  {_spaced(self.stops_in_joint_space)} stops leave the path: no path-consistent stop "
                "within the joint limits was found"
            )
        return lines

    def _budget_lines(self) -> list[str]:
        witness = self.first_witness or self.tightest
        if witness is None:
            return []
        budget = witness.budget
        which = "first witness" if self.first_witness is not None else "tightest pair"
        if math.isnan(budget.distance):
            return [
                f"where the metres go ({which}): {witness.part} cannot be enclosed from what was measured"
            ]
        terms = (
            f"distance {budget.distance:.3f} - link {budget.link:.3f} - body {budget.body:.3f} "
            f"- latency {budget.latency:.3f} - stop {budget.stop:.3f} - error {budget.error:.3f}"
        )
        rest = budget.distance - budget.link - budget.body - budget.latency - budget.stop - budget.error
        return [
            f"where the metres go ({which}): {terms} = {rest:+.3f} m (margin {budget.margin:.4f} m)",
            f"  shrink first: {_ADVICE[witness.shrink_first].format(part=witness.part)}",
        ]

    def _excess_lines(self) -> list[str]:
        excess = self.first_excess
        if excess is None:
            return []
        what = f"{excess.joint} {excess.quantity} {excess.value:.4g}".strip()
        return [f"first limit in the way: t = {excess.t:.3f} s: {what}, limit {excess.limit:.4g}"]

    def _contradiction_lines(self) -> list[str]:
        if not self.contradicted:
            return []
        lines = ["contradicted assumptions:"]
        lines += [
            f"  {item.assumption}: {item.text} "
            f"(first at t = {item.first_t:.3f} s; {_spaced(item.cycles)} cycles)"
            for item in self.contradicted
        ]
        return lines

    def _refused_lines(self) -> list[str]:
        if not self.refused_total:
            return []
        first = self.refused[0]
        where = f"{first.person} {first.point}" if first.point else first.person
        return [
            f"refused measurements: {_spaced(self.refused_total)}, first at t = {first.stamp:.3f} s: "
            f"{where}: {first.reason} (the last good one keeps growing)"
        ]

    def _assumption_lines(self) -> list[str]:
        lines: list[str] = []
        for certainty in _SHOWN:
            items = [item for item in self.assumptions if item.certainty is certainty]
            sizes = [item for item in items if _is_body_size(item)]
            texts = _grouped([item for item in items if not _is_body_size(item)])
            texts += [f"{len(sizes)} body sizes of the profile (listed in --json)"] if sizes else []
            if texts:
                lines.append(f"{certainty}: {', '.join(texts)}")
        return lines


_SHOWN = (Certainty.DEFAULT, Certainty.MEASURED, Certainty.ASSUMED, Certainty.UNVERIFIED)
"""What a reader must know without asking; sourced, computed and declared numbers are in the JSON."""

_ADVICE = {
    "latency": "latency: a faster sensor chain, or a smaller declared latency_s and clock error",
    "stop": "stop: a slower motion or a shorter cycle, so that the robot stops sooner",
    "body": "body: {part} was not measured but inferred; a sensor that reports it would enclose it closely",
    "error": "error: a better calibrated or less noisy measurement, a smaller tracking error",
}


def budget_dict(witness: Witness) -> dict[str, Any]:
    """Return the budget of a witness and the term to shrink first."""
    terms = {key: _number(value) for key, value in asdict(witness.budget).items()}
    return {**terms, "shrink_first": witness.shrink_first}


def witness_dict(witness: Witness | None) -> dict[str, Any] | None:
    """Return a witness as plain values."""
    if witness is None:
        return None
    return {
        "cycle_t": witness.cycle_t,
        "slice": list(witness.slice),
        "link": witness.link,
        "person": witness.person,
        "part": witness.part,
        "gap_m": _number(witness.gap_m),
        "points": [[_number(x) for x in point] for point in witness.points],
        "criterion": witness.criterion,
        "model": witness.model,
        "inferred": witness.inferred,
        "budget_m": budget_dict(witness),
    }


def _excess_dict(excess: LimitExcess) -> dict[str, Any]:
    return {key: _number(v) if isinstance(v, float) else v for key, v in asdict(excess).items()}


def _witness_lines(label: str, witness: Witness | None) -> list[str]:
    if witness is None:
        return []
    how = ", inferred" if witness.inferred else ""
    when = f"slice {witness.slice[0]:.3f}–{witness.slice[1]:.3f} s"
    pair = f"{witness.link} and {witness.person} {witness.part} ({witness.model}{how})"
    return [f"{label}: cycle at t = {witness.cycle_t:.3f} s, {when}: {pair}, gap {witness.gap_m:+.3f} m"]


def _is_body_size(item: Assumption) -> bool:
    return item.name.startswith("people.") and item.name.split(".")[2:3] in (["limb"], ["limit"], ["stature"])


def _grouped(items: list[Assumption]) -> list[str]:
    """Return assumptions as short texts; those of several joints or limbs with one value become one."""
    groups: dict[tuple[str, str], list[str]] = {}
    for item in items:
        value = item.value if isinstance(item.value, str) else f"{item.value:g}"
        stem, _, last = item.name.removeprefix("cell.").rpartition(".")
        groups.setdefault((stem, f"{value} {item.unit}".rstrip()), []).append(last)
    return [
        f"{stem}.{names[0]} = {value}".lstrip(".")
        if len(names) == 1
        else f"{stem}.{{{', '.join(names)}}} = {value}"
        for (stem, value), names in groups.items()
    ]


def _spaced(n: int) -> str:
    return f"{n:,}".replace(",", " ")


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _median_max(values: NDArray[np.float32]) -> dict[str, float | None]:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return {"median": None, "max": None}
    return {"median": float(np.median(finite)), "max": float(np.max(finite))}
