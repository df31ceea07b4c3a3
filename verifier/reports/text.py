"""What `verify` prints: the report as text, one line each, most important first."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from occupancy.body import PART_NAMES
from occupancy.report import RefusalReason
from verifier.reports.assumptions import assumption_lines
from verifier.shown import LONGEST_NOTE, LONGEST_VALUE, shown
from verifier.verdict import Reason, Status, Witness

if TYPE_CHECKING:
    from verifier.reports.verification import VerifyReport

DISCLAIMER = (
    "Simulated. Not a manufacturer's declaration, not a safety function, no performance level claimed; "
    "validate by measurement."
)
_STRETCHES_SHOWN = 6
_WHOLE_BODY = "+".join(PART_NAMES)

_ADVICE = {
    "latency": "latency: a faster sensor chain, or one without gaps where the reading is old; a smaller "
    "latency_s and clock error if they are measured",
    "stop": "stop: a slower motion (`stopproof limits` says how slow) or a shorter cycle, so that the robot "
    "stops sooner",
    "body": "body: {part} was not measured but inferred; a sensor that reports it would enclose it closely",
    "error": "error: a better calibrated or less noisy measurement, a smaller tracking error",
    "sides": "sides: left and right may have been exchanged between two reports; faster reports tell them "
    'apart, and a source that never exchanges them may be declared: people.left_right = "trusted"',
    "region": "region: {link} is not inside of the monitored region {region}, at whose border the unobserved "
    "space begins: nothing else helps before people.monitored.{region} is larger and contains the arm with "
    "room for latency, stop and error",
}
_BORDER = (
    "; the border of the monitored region {region} is {room:.3f} m away: a larger region helps as well, and "
    "a shorter detection_time_s, which counts as latency"
)

REMEDY = {
    Reason.PERSON_OUTSIDE_PREDICTION: "look at the sample first (a glitch, a swapped id, a wrong unit or "
    "clock?); if people do move so fast, no verdict of this profile holds for them: choose "
    "people.profile so that it does (the fastest of the bundled ones is extreme; `stopproof conformance "
    "--identify` writes one from recordings of your people), or keep them away",
    Reason.ROBOT_OUTSIDE_TRACKING: "declare a larger robot.tracking.position_error_rad, or delay_max_s, that "
    "the robot keeps",
    Reason.UNCOMMANDED_JOINT_MOVED: "name the joint in robot.joints, so that its motion is checked; or hold "
    "it still while the arm may move",
    Reason.PEOPLE_STREAM_GAP: "find out why reports pause, or declare a longer people.max_report_gap_s",
    Reason.ROBOT_STREAM_GAP: "record joint positions without pauses, or declare a longer "
    "robot.max_sample_gap_s if the motion between samples is known to be smooth",
    Reason.INCONSISTENT_REPORTS: "look at the reports: swapped ids, a jump, an understated position error "
    "or stamp error, or people larger than the profile's sizes",
    Reason.UNREPORTED_PERSON: "a sensor that covers the approaches farther out; until then nothing can be "
    "shown for the time before somebody is seen",
}

_FIRST_OPEN = " in the first slice that is open, which says when it fails and not how much is missing"
_REASONS_SHOWN = 6
_UNSEEN = {Reason.PERSON_WITHOUT_BOUND, Reason.STALE_EMPTY_REPORT, Reason.NOT_OBSERVED}
"""Cycles in which nothing was known where something may have been reported."""
_WHOLE_REPORTS = {
    str(reason)
    for reason in (
        RefusalReason.STAMP_NOT_FINITE,
        RefusalReason.STAMP_TOO_FAR,
        RefusalReason.STAMP_AHEAD,
        RefusalReason.UNKNOWN_FRAME,
    )
}
"""Reasons for which nothing in a report is read: who is known only grows."""
REFUSED_HINT = {
    str(RefusalReason.TOO_FAR): ": are the coordinates in m?",
    str(RefusalReason.STAMP_AHEAD): ": see the note on people.clock_error_s",
    str(RefusalReason.UNKNOWN_FRAME): ": declare its pose in [people.frames] of the cell",
}


def text_lines(report: VerifyReport) -> list[str]:
    """Return the report as text, one line each, most important first."""
    waived = "; ".join(shown(text, LONGEST_VALUE) for text in report.waived) if report.waived else "nothing"
    return [
        f"stop: {whose_stop(report.stop_model)} · profile: {report.profile} · waived: {waived}",
        *_count_lines(report),
        *_stretch_lines(report),
        *_witness_lines("first witness", report.first_witness, _FIRST_OPEN),
        *_deepest_lines(report),
        *_denied_lines(report.first_witness),
        *_witness_lines("tightest pair", report.tightest),
        *_budget_lines("first witness", report.first_witness),
        *_budget_lines("tightest pair", report.tightest),
        *_excess_lines(report),
        *_contradiction_lines(report),
        *_refused_lines(report),
        *[f"note: {shown(note, LONGEST_NOTE)}" for note in report.notes],
        f"checked: {', '.join(report.checked_criteria)}",
        f"not checked: {', '.join(report.not_checked_criteria)}",
        *assumption_lines(report.assumptions),
        *_input_lines(report),
        f"real-time factor {report.real_time_factor:.1f} (recorded time / computing time, decoding apart; "
        "the first run on a machine compiles once)",
        DISCLAIMER,
    ]


def _input_lines(report: VerifyReport) -> list[str]:
    """Return which files the result rests on."""
    return [
        f"input: {shown(item.what)} {shown(item.file)}, {spaced(item.bytes)} bytes, sha256 {item.sha256}"
        for item in report.inputs
    ]


def whose_stop(model: str) -> str:
    """Return the stop model and whose it is."""
    whose = "the robot's own, fitted on recordings" if model == "measured" else "this software's"
    return f"{model.replace('_', '-')} ({whose})"


def _count_lines(report: VerifyReport) -> list[str]:
    verified, total = report.count(Status.VERIFIED), report.cycles
    under = "A1–A7 and the waivers above" if report.waived else "A1–A7"
    head = f"verified in the model: {spaced(verified)} of {spaced(total)} cycles, under {under}"
    lines = [head + _because_refused(report)]
    for status in (Status.VERIFIED, Status.NOT_VERIFIED, Status.CONTRADICTED, Status.NOT_CHECKED):
        reasons = report.reasons(status)
        if status is Status.VERIFIED and [reason for reason, _n in reasons] == [Reason.SEPARATED]:
            continue  # what everybody takes "verified" for
        label = status.name.lower().replace("_", " ")
        lines += [f"  {label:<13}{spaced(n):>9}  {reason.text}" for reason, n in reasons]
    stops = report.per_cycle.stop_time_s
    stops = stops[np.isfinite(stops)]
    if stops.size:
        lines.append(f"stop time: median {np.median(stops):.3f} s, longest {np.max(stops):.3f} s")
    if report.stops_in_joint_space:
        lines.append(
            f"  {spaced(report.stops_in_joint_space)} stops leave the path: no path-consistent stop "
            "within the joint limits was found"
        )
    return lines


def _stretch_lines(report: VerifyReport) -> list[str]:
    """Return when cycles failed: the longest stretches, in order of time."""
    failing, t = report.failing, report.per_cycle.t
    if not failing:
        return []
    shown = sorted(sorted(failing, key=lambda each: -each.cycles)[:_STRETCHES_SHOWN])
    more = "" if len(shown) == len(failing) else f", the {len(shown)} longest (the others: --json)"
    lines = [f"failing stretches: {spaced(len(failing))}{more}"]
    for each in shown:
        status = each.status.name.lower().replace("_", " ")
        when = f"{t[each.first]:.3f} – {t[each.last]:.3f} s"
        lines.append(f"  {when:<23} {status:<13}{cycles(each.cycles, 7)}  {each.reason.text}")
    return lines


def _deepest_lines(report: VerifyReport) -> list[str]:
    """Return the pair of the worst slice, where it is not that of the first witness."""
    first, deepest = report.first_witness, report.deepest
    if first is None or deepest is None or deepest.slice == first.slice:
        return []
    return [f"  deepest slice of that cycle: {pair_text(deepest)}"]


def _denied_lines(witness: Witness | None) -> list[str]:
    """Return why a declared contact is not admitted."""
    if witness is None or not witness.no_contact:
        return []
    why = shown(witness.no_contact, LONGEST_NOTE)
    return [f"  contact of {shown(witness.link)} is declared, but {why}"]


def _budget_lines(label: str, witness: Witness | None) -> list[str]:
    """Return where the metres go, for one witness."""
    if witness is None:
        return []
    budget = witness.budget
    if witness.other:
        return [
            f"where the metres go ({label}): distance {budget.distance:.3f} - link {budget.link:.3f} "
            f"- {shown(witness.other)} {budget.body:.3f} - error {budget.error:.3f} = {witness.gap_m:+.3f} m "
            f"(margin {budget.margin:.4f} m)"
        ]
    if math.isnan(budget.distance):
        return [f"where the metres go ({label}): {why_unbounded(witness)}"]
    terms = (
        f"distance {budget.distance:.3f} - link {budget.link:.3f} - body {budget.body:.3f} "
        f"- latency {budget.latency:.3f} - stop {budget.stop:.3f} - error {budget.error:.3f}"
    )
    if budget.sides > 0.0:
        terms += f" - sides {budget.sides:.3f}"
    grown = budget.latency + budget.stop + budget.error + budget.sides
    rest = budget.distance - budget.link - budget.body - grown
    return [
        f"where the metres go ({label}): {terms} = {rest:+.3f} m (margin {budget.margin:.4f} m)",
        f"  shrink first: {advice(witness)}",
    ]


def why_unbounded(witness: Witness) -> str:
    """Return why there are no metres to count."""
    part, silent = _part_text(witness), witness.silent_models
    if silent:
        says = "model {} says" if len(silent) == 1 else "models {} say"
        return f"{says.format(', '.join(silent))} nothing of {part}: combine with another model"
    return f"{part} cannot be enclosed from what was measured"


def advice(witness: Witness) -> str:
    """Return what can be done about a witness."""
    first, region = witness.shrink_first, witness.region
    named = {"part": witness.part, "link": shown(witness.link), "region": shown(region or "")}
    border = _BORDER if region is not None and first != "region" else ""
    return (_ADVICE[first] + border).format(**named, room=witness.room_m)


def _excess_lines(report: VerifyReport) -> list[str]:
    excess = report.first_excess
    if excess is None:
        return []
    what = f"{shown(excess.joint)} {excess.quantity} {excess.value:.4g}".strip()
    limit = f"{excess.limit:.4g} {excess.unit}".strip()
    measured = report.stop_model == "measured" and excess.quantity == "velocity"
    which = " (of the joint, or the fastest from which a stop was measured)" if measured else ""
    return [f"first limit in the way: t = {excess.t:.3f} s: {what}, limit {limit}{which}"]


def _contradiction_lines(report: VerifyReport) -> list[str]:
    if not report.contradicted:
        return []
    lines = ["contradicted assumptions:"]
    for item in report.contradicted:
        when = f"first at t = {item.first_t:.3f} s; {cycles(item.cycles)}"
        lines.append(f"  {item.assumption}: {item.text} ({when})")
        lines.append(f"    what can be done: {REMEDY[item.reason]}")
    return lines


def _because_refused(report: VerifyReport) -> str:
    """Return the main reason of refusals where that is most likely why cycles are not verified."""
    if not report.refused_for:
        return ""
    main, n = report.refused_for[0]
    found = {reason for reason, _n in report.reasons(Status.NOT_VERIFIED)}
    if not (found & _UNSEEN or (found and main in _WHOLE_REPORTS)):
        return ""
    mostly = 2 * n > report.refused_total
    why = f"mostly: {shown(main, LONGEST_VALUE)}" if mostly else "for several reasons (below)"
    return f"; {spaced(report.refused_total)} measurements refused, {why}"


def _refused_lines(report: VerifyReport) -> list[str]:
    """Return what was refused first, and how often for each reason."""
    if not report.refused_total:
        return []
    listed = report.refused_for[:_REASONS_SHOWN]
    rows = [
        f"  {spaced(n):>9} × {shown(reason, LONGEST_VALUE)}{REFUSED_HINT.get(reason, '')}"
        for reason, n in listed
    ]
    others = report.refused_total - sum(n for _reason, n in listed)
    if others:
        rows.append(f"  {spaced(others):>9} × other reasons, or not listed")
    first = report.refused[0]
    who = shown(first.person) if first.person else "the whole report"
    where = f"{who} {shown(first.point)}" if first.point else who
    return [
        f"refused measurements: {spaced(report.refused_total)}, first at t = {first.stamp:.3f} s: "
        f"{where}: {shown(first.reason, LONGEST_VALUE)} (the last good one keeps growing)",
        *rows,
    ]


def _witness_lines(label: str, witness: Witness | None, where: str = "") -> list[str]:
    if witness is None:
        return []
    return [f"{label}: cycle at t = {witness.cycle_t:.3f} s, {pair_text(witness)}{where}"]


def pair_text(witness: Witness) -> str:
    """Return slice, pair and gap of a witness."""
    gap = f"gap {witness.gap_m:+.3f} m" if math.isfinite(witness.gap_m) else "no gap can be stated"
    pair = f"slice {witness.slice[0]:.3f}–{witness.slice[1]:.3f} s: {shown(witness.link)} and"
    if witness.other:
        return f"{pair} {shown(witness.other)} ({witness.criterion.replace('_', ' ')}), {gap}"
    how = ", inferred" if witness.inferred else ""
    seen = f", seen {witness.age_s:.3f} s before" if math.isfinite(witness.age_s) else ""
    who = f"{shown(witness.person)} {_part_text(witness)} ({witness.model}{how}{seen})"
    return f"{pair} {who}, {gap}"


def _part_text(witness: Witness) -> str:
    """Return the names of the parts; those of a whole person as such."""
    return "whole body" if witness.part == _WHOLE_BODY else witness.part


def cycles(n: int, width: int = 0) -> str:
    """Return how many cycles; in a column of ``width`` digits what follows stands in line."""
    if width:
        return f"{spaced(n):>{width}} {'cycle ' if n == 1 else 'cycles'}"
    return f"{spaced(n)} {'cycle' if n == 1 else 'cycles'}"


def counted(n: int, what: str) -> str:
    """Return how many of what."""
    return f"{spaced(n)} {what}" if n == 1 else f"{spaced(n)} {what}s"


def spaced(n: int) -> str:
    """Return a count in groups of three digits."""
    return f"{n:,}".replace(",", " ")
