"""The text of a stop report: what the command line prints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from failsafe.bracket import Bracket, Ended
from failsafe.stopping import POINT_SPEED, STOP_ANGLE, STOP_TIME, STOP_WAY
from robots.assumption import Certainty
from verifier.protective_separation import ENCLOSURES
from verifier.reports.assumptions import assumption_lines
from verifier.reports.text import DISCLAIMER
from verifier.shown import LONGEST_VALUE, shown
from verifier.stop_report.report import (
    ANY_MOTION,
    JOINT_SPACE,
    MEASURED,
    PATH_CONSISTENT,
    WORDS,
    Distance,
    StopCase,
    StopReport,
)

INTERRUPTED = (
    "ended before everything was looked at: brackets hold as they had been reached by then, and what was not "
    "begun is missing"
)
_UNSURE = (Certainty.ASSUMED, Certainty.DEFAULT, Certainty.UNVERIFIED)
NOT_CLAIMED = (
    "each bracket: the lower number is reached in the model, the upper one is not exceeded in the model; "
    "nothing is known between the two"
)

MEASURE_FIRST = (
    "drive the stops to be measured (in the page) on the real robot; no distance is to be taken from here "
    "before that"
)


def report_lines(report: StopReport) -> list[str]:
    """Return a report as text, one line each, most important first."""
    return [
        head_line(report),
        *([INTERRUPTED] if report.interrupted else []),
        *_case_lines(report, report.answer),
        *(line for case in others(report) for line in _case_lines(report, case)),
        *_guessed_lines(report),
        *total_lines(report),
        *distance_lines(report),
        *other_distance_lines(report),
        *rests_on_lines(report),
        *drive_lines(report),
        *_recorded_lines(report),
        *_separation_lines(report),
        *_missing_lines(report),
        f"note: {NOT_CLAIMED}",
        f"note: {MEASURE_FIRST}",
        *assumption_lines(report.assumptions),
        DISCLAIMER,
    ]  # fmt: skip


def head_line(report: StopReport) -> str:
    """Return whose stop, of which arm, over what, and what is waived."""
    waived = "; ".join(shown(text, LONGEST_VALUE) for text in report.waived) if report.waived else "nothing"
    any_motion = report.answer.over == ANY_MOTION
    moved = speed_text(report) if any_motion else f"recording: {shown(report.recording)}"
    parts = (whose(report.answer), f"robot: {shown(report.robot)}", moved, f"waived: {waived}")
    return f"stop: {' · '.join(parts)}"


def speed_text(report: StopReport) -> str:
    """Return up to which speeds."""
    if report.limited:
        share = report.speed * float(np.min(report.answer_speeds / report.speeds))
        return f"up to the speeds that were measured, of some joint {100.0 * share:.0f} % of its limit"
    return f"up to {100.0 * report.speed:g} % of the velocity limits"


def whose(case: StopCase) -> str:
    """Return whose stop a case is, and over what it is the worst."""
    return f"{case.stop}: {WORDS[case.stop]}, the worst over {case.over_text}"


def others(report: StopReport) -> list[StopCase]:
    """Return the cases besides the answer that nobody has guessed."""
    return [case for case in report.cases if case is not report.answer and not case.guessed]


def range_text(lower: float, upper: float | None, unit: str, digits: int = 3) -> str:
    """Return a bracket in as few words as it takes."""
    if upper is None or not math.isfinite(upper):
        return f"at least {lower:.{digits}f} {unit}, not bounded"
    low, high = f"{lower:.{digits}f}", f"{upper:.{digits}f}"
    return f"{high} {unit}" if low == high else f"{low} to {high} {unit}"


def bracket_text(each: Bracket) -> str:
    """Return a bracket with its unit; angles also in degrees."""
    if each.unit != "rad":
        return range_text(each.lower, each.upper, each.unit)
    if not math.isfinite(each.upper):
        return f"at least {each.lower:.3f} rad ({math.degrees(each.lower):.1f}°), not bounded"
    degrees = range_text(math.degrees(each.lower), math.degrees(each.upper), "°", 1).replace(" °", "°")
    return f"{range_text(each.lower, each.upper, each.unit)} ({degrees})"


def _case_lines(report: StopReport, case: StopCase) -> Iterator[str]:
    """Yield the numbers of a stop, shortest where there is no upper number of any."""
    yield f"{case.stop}, {case.over_text}:"
    for quantity in (STOP_TIME, POINT_SPEED, STOP_WAY):
        found = case.largest(quantity)
        if found is not None:
            how = f" ({found.reason})" if found.reason else _ended(found)
            yield f"  {quantity}: {bracket_text(found)}, {shown(found.part)}{how}"
    angles = case.of(STOP_ANGLE)
    if angles:
        yield "  angle: " + "; ".join(f"{shown(each.part)} {bracket_text(each)}" for each in angles)


def _ended(each: Bracket) -> str:
    """Say where a bracket is wider than was asked for."""
    wide = each.ended in (Ended.DEADLINE, Ended.INTERRUPTED, Ended.FULL)
    return f" (wider than asked for: {each.ended})" if wide else ""


def _guessed_lines(report: StopReport) -> Iterator[str]:
    if any(case.guessed for case in report.cases) or any(each.guessed for each in report.grids):
        yield "category 0: brakes are guessed, nobody has stated them: in the page and marked, not here"


def total_lines(report: StopReport) -> Iterator[str]:
    """Yield how long it takes from a report to rest."""
    longest = report.answer.largest(STOP_TIME)
    if report.total_s is not None and longest is not None:
        reaction = report.reaction.seconds
        yield f"T = {report.total_s:.3f} s: reaction {reaction:.3f} s, stop at most {longest.upper:.3f} s"


def rests_on_lines(report: StopReport) -> Iterator[str]:
    """Say what the answer rests on where nobody vouches for it, and what it is not about."""
    parts = [part for part in report.reaction.parts if part.certainty is Certainty.DEFAULT]
    if parts:
        made_of = ", ".join(f"{part.name} = {float(part.value):.3g} {part.unit}" for part in parts)
        yield (
            f"the reaction has defaults in it that nobody stated: {made_of}; state what it takes to detect, "
            "to decide and to begin the stop (people.latency_s, cycle_s, robot.tracking.delay_max_s)"
        )
    if report.answer.stop == MEASURED:
        sources = (item.source for item in report.assumptions if item.name == "stop.delay")
        yield from (f"the stop was measured: {shown(source, LONGEST_VALUE)}" for source in sources)
    if report.limited:
        joints = ", ".join(
            f"{shown(joint)} {configuration_text([most], [unit])}/s"
            for joint, most, full, unit in zip(
                report.joints, report.answer_speeds, report.speeds, report.units, strict=True
            )
            if most < full
        )
        yield (
            f"faster than {joints} no stop was measured: no number of this stop, and no distance from it, is "
            "about such motion"
        )
    if report.answer.stop in (JOINT_SPACE, PATH_CONSISTENT):
        unsure = sorted(
            {
                f"{kind} limits are {item.certainty}"
                for item in report.assumptions
                for kind in ("acceleration", "jerk")
                if item.name.startswith(f"robot.{report.robot}.{kind}.") and item.certainty in _UNSURE
            }
        )
        if unsure:
            yield f"the stop is made of limits that nobody vouches for: {', '.join(unsure)}"


def distance_lines(report: StopReport) -> Iterator[str]:
    """Yield the required distances of the answer."""
    for each in report.distances:
        if (each.stop, each.over) == (report.answer.stop, report.answer.over):
            yield f"required distance, {each.edition}: {distance_text(each)}"


def other_distance_lines(report: StopReport) -> Iterator[str]:
    """Yield the required distances of the other stops that are bounded."""
    for each in report.distances:
        if each.stop != report.answer.stop and each.required is not None:
            yield (
                f"if the protective device triggers the stop {each.stop}: S = "
                f"{each.required.distance_m:.3f} m ({each.edition})"
            )


def distance_text(each: Distance) -> str:
    """Return a required distance with its terms, or what is missing for it."""
    known = ", ".join(f"{item.name} = {float(item.value):.3f} {item.unit}" for item in each.known)
    if each.required is None:
        missing = ", ".join(item.what for item in each.missing)
        remedies = dict.fromkeys(item.remedy for item in each.missing if item.remedy.startswith("--"))
        how = f"; state it: {'; '.join(remedies)}" if remedies else ""
        return f"{each.form}: missing: {missing}{how} ({known})"
    terms = [item for item in each.required.terms if not isinstance(item.value, str)]
    listed = ", ".join(f"{item.name} = {item.value:.4g} {item.unit}" for item in terms)
    formula = each.required.formula
    return f"S = {each.required.distance_m:.3f} m, {formula.certainty} ({formula.value}; {listed})"


def drive_lines(report: StopReport) -> Iterator[str]:
    """Say so where torque limits do not allow the deceleration that the answer is made of."""
    if report.answer.stop == MEASURED:
        return
    worst = min(report.torques, key=lambda each: each.allowed.found, default=None)
    if worst is not None and worst.allowed.found < 1.0:
        what = "stops from there take longer than this says, and T, S, angles and ways are too small for them"
        if report.answer.over != ANY_MOTION:
            what = "whether states of this recording are among them was not looked at"
        share = worst.allowed.found
        allow = f"only {share:.2f}" if share >= 0.005 else "nothing"
        yield (
            f"drives: with {worst.load_kg:.3g} kg at full speed torque limits allow in some states {allow} "
            f"of the acceleration limits, all joints braking at once: {what}"
        )


def _recorded_lines(report: StopReport) -> Iterator[str]:
    found = report.recorded
    if found is None:
        return
    yield (
        f"recording {shown(report.recording)}: {found.planned} of {found.looked_at} cycles have a stop, "
        f"{found.off_path} of them leave the path; {found.without_stop} have none within the limits, "
        f"{found.beyond_end} end before their stop does"
    )


def _separation_lines(report: StopReport) -> Iterator[str]:
    found = report.separation
    if found is None:
        return
    if found.worst is None:
        yield "S_p (ISO/TS 15066:2016): no moving link could be held against anybody"
        return
    worst = found.worst
    yield (
        f"S_p ({worst.required.edition}): the separation is below it in {found.too_close} of "
        f"{found.compared} cycles; least room at {worst.t:.3f} s: {shown(worst.link)} and "
        f"{shown(worst.person)}, {worst.separation_m:.3f} m between {ENCLOSURES}, "
        f"S_p {worst.required.distance_m:.3f} m"
    )


def _missing_lines(report: StopReport) -> Iterator[str]:
    for each in report.missing:
        remedy = f"; state it: {each.remedy}" if each.remedy else ""
        yield f"missing: {shown(each.what)}: {shown(each.why, LONGEST_VALUE)}{remedy}"


def configuration_text(values: Sequence[float], units: Sequence[str]) -> str:
    """Return a configuration, angles in degrees."""
    return ", ".join(
        f"{math.degrees(value):.1f}°" if unit == "rad" else f"{value:.3f} m"
        for value, unit in zip(values, units, strict=True)
    )
