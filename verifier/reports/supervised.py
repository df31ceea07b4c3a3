"""What a recorded intention came to under the supervisor: numbers, JSON and text."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robots.assumption import Assumption
from verifier.command import State
from verifier.reports.assumptions import assumption_dicts, assumption_lines
from verifier.reports.text import DISCLAIMER
from verifier.shown import LONGEST_NOTE, LONGEST_VALUE, shown
from verifier.verdict import STATUS_OF_REASON, Reason, Status

REPLAYED = (
    "people move as recorded, beside an arm that moves otherwise than it was recorded: what they would have "
    "done beside this one is not known"
)


class Contact(NamedTuple):
    """A person whose measured points came so near that body and a moving link overlap.

    ``t`` [s since the start of the overlap]: first report of the series; ``depth_m``: deepest overlap.
    """

    person: str
    t: float
    depth_m: float


@dataclass(frozen=True, slots=True)
class SupervisedReport:
    """The result of a supervised replay; docs/supervised.schema.json describes ``to_dict()``.

    Attributes
    ----------
    status, states:
        Per cycle: status of the verdict on the new plan, and state of the supervisor.
    time_lost_s:
        Time since the first plan was adopted, minus the path time reached at the end [s]; NaN: none was.
    reached_s, path_s:
        Path time reached, and that of the whole path [s, as recorded].
    assumptions:
        Every number that the result rests on.
    slowed:
        Factor by which the recorded motion had to be slowed down to keep the limits, and why.
    """

    recording: str
    robot: str
    profile: str
    models: tuple[str, ...]
    waived: tuple[str, ...]
    assumptions: tuple[Assumption, ...]
    not_checked_criteria: tuple[str, ...]
    cycles: int
    status: NDArray[np.uint8]
    states: NDArray[np.uint8]
    reasons: Counter[Reason]
    cycle_s: float
    time_lost_s: float
    reached_s: float
    path_s: float
    contacts: tuple[Contact, ...]
    slowed: tuple[float, str]
    real_time_factor: float

    @property
    def stops(self) -> int:
        """How often a failsafe manoeuvre began; one that is over within a cycle counts."""
        failsafe = self.states == int(State.FAILSAFE)
        begun = int(np.count_nonzero(failsafe[1:] & ~failsafe[:-1])) + int(failsafe[:1].sum())
        return begun + self._over_at_once

    @property
    def standstills(self) -> int:
        """How often a failsafe manoeuvre came to rest."""
        before, after = self.states[:-1], self.states[1:]
        ended = (before == int(State.FAILSAFE)) & (after == int(State.STOPPED))
        return int(np.count_nonzero(ended)) + self._over_at_once

    @property
    def _over_at_once(self) -> int:
        """How many manoeuvres began and came to rest between two cycles."""
        moved = np.isin(self.states[:-1], [int(State.EXECUTING), int(State.RECOVERING)])
        rests = (self.states[1:] == int(State.STOPPED)) & (self.status[1:] != int(Status.VERIFIED))
        return int(np.count_nonzero(moved & rests))

    @property
    def recoveries(self) -> int:
        """How often the robot set out again."""
        recovering = self.states == int(State.RECOVERING)
        return int(np.count_nonzero(recovering[1:] & ~recovering[:-1])) + int(recovering[:1].sum())

    def share(self, state: State) -> float:
        """Return the share of cycles in a state."""
        return int(np.count_nonzero(self.states == int(state))) / self.cycles

    def count(self, status: Status) -> int:
        """Return how many cycles made a plan with this verdict."""
        return int(np.count_nonzero(self.status == int(status)))

    @property
    def exit_status(self) -> int:
        """0 no contact and nothing waived, 1 contact or an assumption contradicted, 3 under waivers."""
        if self.contacts or self.count(Status.CONTRADICTED) or not math.isfinite(self.time_lost_s):
            return 1
        return 3 if self.waived else 0

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON; NaN becomes ``None``."""
        return {
            "recording": self.recording,
            "robot": self.robot,
            "profile": self.profile,
            "models": list(self.models),
            "waived": list(self.waived),
            "assumptions": assumption_dicts(self.assumptions),
            "criteria_not_checked": list(self.not_checked_criteria),
            "disclaimer": DISCLAIMER,
            "cycles": self.cycles,
            "cycle_s": self.cycle_s,
            **{status.name.lower(): self.count(status) for status in Status},
            "reasons": {reason.name.lower(): n for reason, n in sorted(self.reasons.items())},
            "states": {state.name.lower(): self.share(state) for state in State},
            "contacts_while_moving": len(self.contacts),
            "contacts": [contact._asdict() for contact in self.contacts],
            "time_lost_s": self.time_lost_s if math.isfinite(self.time_lost_s) else None,
            "stops": self.stops,
            "standstills": self.standstills,
            "recoveries": self.recoveries,
            "reached_s": self.reached_s,
            "path_s": self.path_s,
            "slowed": {"factor": self.slowed[0], "reason": self.slowed[1]},
            "real_time_factor": self.real_time_factor,
        }

    def lines(self) -> list[str]:
        """Return the report as text, one line each, most important first."""
        waived = "; ".join(shown(text, LONGEST_VALUE) for text in self.waived) if self.waived else "nothing"
        return [
            f"stop: path-consistent (this software's) · profile: {self.profile} · "
            f"models: {', '.join(self.models)} · waived: {waived}",
            f"contacts while moving, in the model: {len(self.contacts)}",
            *(f"  {c.person} at {c.t:.3f} s, {c.depth_m:.3f} m deep" for c in self.contacts[:6]),
            self._time_line(),
            f"stops begun {self.stops}, to standstill {self.standstills} · recoveries {self.recoveries} · "
            + " · ".join(f"{state.name.lower()} {100.0 * self.share(state):.1f} %" for state in State),
            "verdicts on the plans that were made, cycle by cycle:",
            *self._reason_lines(),
            *self._contradicted_lines(),
            f"not checked: {', '.join(self.not_checked_criteria)}",
            *assumption_lines(self.assumptions),
            *self._slowed_lines(),
            f"note: {REPLAYED}",
            f"real-time factor {self.real_time_factor:.1f} (decoding and fit of the path apart)",
            DISCLAIMER,
        ]

    def _time_line(self) -> str:
        if not math.isfinite(self.time_lost_s):
            return "no plan was ever adopted: the robot stood still all the time"
        way = f"{self.reached_s:.2f} s of {self.path_s:.2f} s of the path"
        return f"time lost: {self.time_lost_s:.2f} s since the first plan was adopted; reached {way}"

    def _reason_lines(self) -> list[str]:
        return [
            f"  {STATUS_OF_REASON[reason].name.lower().replace('_', ' '):<13}{n:>9}  {reason.text}"
            for reason, n in self.reasons.most_common()
        ]

    def _contradicted_lines(self) -> list[str]:
        if not self.count(Status.CONTRADICTED):
            return []
        return [
            "note: the recording contradicts an assumption, so the exit status is 1; `stopproof verify` says "
            "which, by whom and when"
        ]

    def _slowed_lines(self) -> list[str]:
        factor, why = self.slowed
        if factor == 1.0:
            return []
        text = f"the recorded motion was slowed down to {100.0 / factor:.1f} %: as it is, {why}"
        return [f"note: {shown(text, LONGEST_NOTE)}"]


def supervised_table(reports: list[SupervisedReport]) -> list[str]:
    """Return several runs of one recording side by side as lines of text: caution against productivity."""
    heads = (
        "profile",
        "models",
        "time lost",
        "reached",
        "stops",
        "standstills",
        "contacts",
        "contradicted",
        "executing",
    )
    rows = [
        (
            report.profile,
            ", ".join(report.models),
            f"{report.time_lost_s:.2f} s" if math.isfinite(report.time_lost_s) else "all",
            f"{100.0 * report.reached_s / report.path_s:.0f} %",
            str(report.stops),
            str(report.standstills),
            str(len(report.contacts)),
            str(report.count(Status.CONTRADICTED)),
            f"{100.0 * report.share(State.EXECUTING):.1f} %",
        )
        for report in reports
    ]
    widths = [max(len(line[i]) for line in (heads, *rows)) for i in range(len(heads))]
    lines = [
        "  ".join(
            text.rjust(width) if i >= 2 else text.ljust(width)
            for i, (text, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in (heads, *rows)
    ]
    return [*lines, "", f"note: {REPLAYED}", DISCLAIMER]
