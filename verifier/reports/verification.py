"""What `verify` found: the numbers, their JSON and the text that the command line prints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robots.assumption import Assumption
from verifier.inputs import InputFile
from verifier.reports.assumptions import assumption_dicts
from verifier.reports.stretches import Stretch, stretches
from verifier.reports.text import DISCLAIMER, text_lines
from verifier.still import Still
from verifier.verdict import Reason, Status, Witness

FORMAT = "stopproof verify 1"
"""What the JSON is: `stopproof diff` compares results of one format."""
MAX_STRETCHES = 1000
"""Stretches that the JSON lists; all are counted."""


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

    reason: Reason
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
    unit: str


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
    refused_for: tuple[tuple[str, int], ...]
    """Reasons and how often each, most frequent first; of what could not be decoded, the first thousand."""
    contradicted: tuple[Contradicted, ...]
    first_witness: Witness | None
    deepest: Witness | None
    """Of the cycle of ``first_witness``: the pair of the slice with the smallest gap."""
    tightest: Witness | None
    first_excess: LimitExcess | None
    assumptions: tuple[Assumption, ...]
    checked_criteria: tuple[str, ...]
    not_checked_criteria: tuple[str, ...]
    start_ns: int
    """Start of the overlap, on the recording's clock [ns]: t = 0 of ``per_cycle``."""
    notes: tuple[str, ...]
    inputs: tuple[InputFile, ...]
    stills: Mapping[str, Still]
    """What a picture of a witness shows, by its name here; in no JSON."""

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

    @property
    def failing(self) -> list[Stretch]:
        """Stretches of cycles that are not verified or contradicted, in order of time."""
        return stretches(self.per_cycle, (Status.NOT_VERIFIED, Status.CONTRADICTED))

    def reasons(self, status: Status) -> list[tuple[Reason, int]]:
        """List the reasons of the cycles with this status, most frequent first."""
        values, counts = np.unique(
            self.per_cycle.reason[self.per_cycle.status == int(status)], return_counts=True
        )
        order = np.argsort(-counts, kind="stable")
        return [(Reason(int(values[i])), int(counts[i])) for i in order]

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON; NaN becomes ``None``."""
        rows, failing = self.per_cycle, self.failing
        witness = self.first_witness or self.tightest
        return {
            "format": FORMAT,
            "recording": self.recording,
            "robot": self.robot,
            "stop_model": self.stop_model,
            "profile": self.profile,
            "cell_hash": self.cell_hash,
            "inputs": [asdict(item) for item in self.inputs],
            "version": self.version,
            "disclaimer": DISCLAIMER,
            "start_ns": self.start_ns,
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
            "criteria": list(self.checked_criteria),
            "criteria_not_checked": list(self.not_checked_criteria),
            "notes": list(self.notes),
            "refused_measurements": [asdict(item) for item in self.refused],
            "refused_measurements_total": self.refused_total,
            "refused_measurements_by_reason": dict(self.refused_for),
            "contradictions": [
                {**asdict(item), "reason": item.reason.name.lower()} for item in self.contradicted
            ],
            "stretches": [self._stretch_dict(each) for each in failing[:MAX_STRETCHES]],
            "stretches_total": len(failing),
            "first_witness": witness_dict(self.first_witness),
            "deepest": witness_dict(self.deepest),
            "tightest": witness_dict(self.tightest),
            "first_limit_excess": None if self.first_excess is None else _excess_dict(self.first_excess),
            "budget_m": None if witness is None else budget_dict(witness),
            "stop_time_s": _median_max(rows.stop_time_s),
            "assumptions": assumption_dicts(self.assumptions),
            "reason_names": {str(int(reason)): reason.name.lower() for reason in Reason},
            "per_cycle": {
                "t": [round(float(t), 9) for t in rows.t],
                "status": [int(status) for status in rows.status],
                "reason": [int(reason) for reason in rows.reason],
                "gap_m": [_number(float(gap)) for gap in rows.gap_m],
                "stop_time_s": [_number(float(stop)) for stop in rows.stop_time_s],
            },
        }

    def _stretch_dict(self, each: Stretch) -> dict[str, Any]:
        return {
            "t": [float(self.per_cycle.t[each.first]), float(self.per_cycle.t[each.last])],
            "status": int(each.status),
            "reason": each.reason.name.lower(),
            "cycles": each.cycles,
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
        return text_lines(self)


def budget_dict(witness: Witness) -> dict[str, Any]:
    """Return the budget of a witness and the term to shrink first."""
    terms = {key: _number(value) for key, value in asdict(witness.budget).items()}
    return {**terms, "shrink_first": witness.shrink_first or None}


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
        "other": witness.other,
        "gap_m": _number(witness.gap_m),
        "points": [[_number(x) for x in point] for point in witness.points],
        "criterion": witness.criterion,
        "model": witness.model,
        "inferred": witness.inferred,
        "age_s": _number(witness.age_s),
        "silent_models": list(witness.silent_models),
        "no_contact": witness.no_contact,
        "budget_m": budget_dict(witness),
    }


def _excess_dict(excess: LimitExcess) -> dict[str, Any]:
    return {key: _number(v) if isinstance(v, float) else v for key, v in asdict(excess).items()}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _median_max(values: NDArray[np.float32]) -> dict[str, float | None]:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return {"median": None, "max": None}
    return {"median": float(np.median(finite)), "max": float(np.max(finite))}
