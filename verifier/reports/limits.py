"""What `limits` found: the brackets, their JSON and the text that the command line prints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from robots.assumption import Assumption
from verifier.bracket import Bracket, Failure
from verifier.protective_separation import ENCLOSURES, Instant, SeparationHistory
from verifier.reports.assumptions import assumption_dicts, assumption_lines
from verifier.reports.text import DISCLAIMER, whose_stop
from verifier.required_distance import RequiredDistance
from verifier.shown import LONGEST_VALUE, shown

_NOT_AT_REST = (
    "no path speed, not even 0: people are contradicted whatever the robot does, or tracking errors displace "
    "a link by more than check.standstill_error_m, so that the arm never counts as at rest"
)
_NOT_CLAIMED = (
    "each bracket: verified at the first number, not verified at the second; nothing is claimed of numbers "
    "that were not tried (--json lists all that were), nor of anything beyond the first that failed"
)


@dataclass(frozen=True, slots=True)
class Segment:
    """Cycles from ``begin_s`` on and before ``end_s``, and the path speeds with which they were judged."""

    begin_s: float
    end_s: float
    path_speed: Bracket


@dataclass(frozen=True, slots=True)
class Line:
    """A circle around the base, or a line in a direction from it, and its distances from the base [m].

    Attributes
    ----------
    angle_deg:
        Direction of the line; ``None``: a circle.
    base_m:
        x and y of the base in the world [m].
    barrier:
        What keeps people beyond it: *scanner* or *fence*.
    distance:
        Distances that were tried.
    """

    angle_deg: float | None
    base_m: tuple[float, float]
    barrier: str
    distance: Bracket


@dataclass(frozen=True, slots=True)
class LimitsReport:
    """Inverse answers for one recording; docs/limits.schema.json describes ``to_dict()``.

    What was not asked is ``None``.
    """

    recording: str
    robot: str
    stop_model: str
    profile: str
    cell_hash: str
    version: str
    waived: tuple[str, ...]
    segments: tuple[Segment, ...] | None
    latency: Bracket | None
    lines: tuple[Line, ...] | None
    separation: SeparationHistory | None
    assumptions: tuple[Assumption, ...]
    window_s: tuple[float, float | None]

    @property
    def _brackets(self) -> Iterator[Bracket]:
        yield from (each.path_speed for each in self.segments or ())
        if self.latency is not None:
            yield self.latency
        yield from (each.distance for each in self.lines or ())

    @property
    def exit_status(self) -> int:
        """0 every answer asked for exists and nothing is waived, 1 one does not, 3 under waivers.

        A segment that is verified at no path speed above 0 has no answer. S_p answers nothing: it is shown.
        """
        still = any(each.path_speed.verified_at == 0.0 for each in self.segments or ())
        if still or any(bracket.verified_at is None for bracket in self._brackets):
            return 1
        return 3 if self.waived else 0

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON."""
        return {
            "recording": self.recording,
            "robot": self.robot,
            "stop_model": self.stop_model,
            "profile": self.profile,
            "cell_hash": self.cell_hash,
            "version": self.version,
            "disclaimer": DISCLAIMER,
            "waived": list(self.waived),
            "window_s": list(self.window_s),
            "path_speed": None if self.segments is None else [_segment_dict(each) for each in self.segments],
            "latency_s": None if self.latency is None else _bracket_dict(self.latency),
            "lines": None if self.lines is None else [_line_dict(each) for each in self.lines],
            "protective_separation": None if self.separation is None else _history_dict(self.separation),
            "not_claimed": _NOT_CLAIMED,
            "assumptions": assumption_dicts(self.assumptions),
        }

    def lines_of_text(self) -> list[str]:
        """Return the report as text, one line each, most important first."""
        waived = "; ".join(shown(text, LONGEST_VALUE) for text in self.waived) if self.waived else "nothing"
        return [
            f"stop: {whose_stop(self.stop_model)} · profile: {self.profile} · waived: {waived}",
            *self._segment_lines(),
            *self._latency_lines(),
            *self._line_lines(),
            *self._separation_lines(),
            *self._notes(),
            *assumption_lines(self.assumptions),
            DISCLAIMER,
        ]

    def _notes(self) -> Iterator[str]:
        if any(answer is not None for answer in (self.segments, self.latency, self.lines)):
            yield f"note: {_NOT_CLAIMED}"

    def _segment_lines(self) -> Iterator[str]:
        if self.segments is None:
            return
        yield (
            "path speed (1: as recorded), the largest with which every cycle of a segment is verified in the "
            "model, people being where they were when the arm was there:"
        )
        for each in self.segments:
            still = each.path_speed.not_verified_at == 0.0
            what = _bracket_text(
                each.path_speed, "", _NOT_AT_REST if still else "no path speed that was tried"
            )
            yield f"  {each.begin_s:.2f} … {each.end_s:.2f} s: {what}"

    def _latency_lines(self) -> Iterator[str]:
        if self.latency is not None:
            what = _bracket_text(self.latency, " s", "no latency that was tried")
            yield f"largest people.latency_s with which every cycle is verified in the model: {what}"

    def _line_lines(self) -> Iterator[str]:
        for each in self.lines or ():
            x, y = each.base_m
            place = (
                f"circle around ({x:g}, {y:g}) m"
                if each.angle_deg is None
                else f"line at {each.angle_deg:g}°"
            )
            what = _bracket_text(each.distance, " m", "no distance that was tried")
            behind = "outside of which people may be, nobody inside"
            fenced = "closed by a fence, people outside of it"
            yield f"nearest {place} {fenced if each.barrier == 'fence' else behind}: {what}"

    def _separation_lines(self) -> Iterator[str]:
        found = self.separation
        if found is None:
            return
        if found.worst is None:
            yield "S_p (ISO/TS 15066:2016): no moving link could be held against anybody"
            return
        worst = found.worst
        required = worst.required
        yield (
            f"S_p ({required.edition}): the separation is below it in {found.too_close} of {found.compared} "
            f"cycles; least room at {worst.t:.3f} s: {shown(worst.link)} and {shown(worst.person)}, "
            f"{worst.separation_m:.3f} m between {ENCLOSURES}, S_p {required.distance_m:.3f} m"
        )
        terms = [item for item in required.terms if not isinstance(item.value, str)]
        yield "S_p there: " + ", ".join(f"{item.name} = {item.value:.4g} {item.unit}" for item in terms)


def _bracket_text(bracket: Bracket, unit: str, none: str) -> str:
    """Return a bracket in one clause."""
    why = "" if bracket.failure is None else f": {bracket.failure.text}"
    if bracket.verified_at is None:
        return f"{none}{why}"
    at = f"verified at {bracket.verified_at:g}{unit} ({bracket.cycles} cycles)"
    if bracket.not_verified_at is None:
        return f"{at}, the last that was to be tried"
    return f"{at}, not verified at {bracket.not_verified_at:g}{unit}{why}"


def _bracket_dict(bracket: Bracket) -> dict[str, Any]:
    return {
        "verified_at": bracket.verified_at,
        "not_verified_at": bracket.not_verified_at,
        "cycles": bracket.cycles,
        "failure": _failure_dict(bracket.failure),
        "tried": [
            {"value": each.value, "verified": each.verified, "failure": _failure_dict(each.failure)}
            for each in bracket.trials
        ],
    }


def _failure_dict(failure: Failure | None) -> dict[str, Any] | None:
    if failure is None:
        return None
    reason = "nothing_checked" if failure.reason is None else failure.reason.name.lower()
    return {"t": None if failure.t is None else round(failure.t, 9), "reason": reason}


def _segment_dict(each: Segment) -> dict[str, Any]:
    t = [round(each.begin_s, 9), round(each.end_s, 9)]
    return {"t": t, **_bracket_dict(each.path_speed)}


def _line_dict(each: Line) -> dict[str, Any]:
    kind = "circle" if each.angle_deg is None else "line"
    return {
        "kind": kind,
        "angle_deg": each.angle_deg,
        "base_m": list(each.base_m),
        "barrier": each.barrier,
        "distance_m": _bracket_dict(each.distance),
    }


def _history_dict(history: SeparationHistory) -> dict[str, Any]:
    return {
        "compared": history.compared,
        "too_close": history.too_close,
        "worst": None if history.worst is None else instant_dict(history.worst),
    }


def instant_dict(instant: Instant) -> dict[str, Any]:
    """Return a cycle of S_p as plain values."""
    return {
        "t": round(instant.t, 9),
        "link": instant.link,
        "person": instant.person,
        "separation_m": instant.separation_m,
        "required": required_dict(instant.required),
    }


def required_dict(required: RequiredDistance) -> dict[str, Any]:
    """Return a required distance with its terms as plain values."""
    return {
        "symbol": required.symbol,
        "edition": str(required.edition),
        "distance_m": required.distance_m,
        "terms": assumption_dicts((required.formula, *required.terms)),
    }
