"""What `stops` found: its JSON, the lines that the command line prints."""

from __future__ import annotations

import math
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

from verifier.shown import LONGEST_NOTE, shown
from verifier.stops.fit import SLOWEST, Fit, Held
from verifier.stops.measuring import Between, Measured
from verifier.stops.recorded import AllStops, StopsOf, times
from verifier.stops.speeds import SPAN_S

MEASURED_DISCLAIMER = (
    "Measured from recordings, at their rates and by their clocks. Not a manufacturer's declaration, not a "
    "safety function, no performance level claimed; validate by measurement."
)
_NOTES = (
    "each pair of numbers: the true value lies between them, as far as samples can tell; what happened "
    "between two samples was not seen",
    "time: from when the arm was told to stop, as it stands in the recording, to standstill; what it took to "
    "tell the arm is not in it",
)


def stops_json(found: AllStops, fitted: Fit | None) -> dict[str, Any]:
    """Return what stands in the JSON."""
    return {
        "version": version("stopproof"),
        "robot": None if found.robot is None else found.robot.name,
        "tool": None if found.robot is None else found.robot.tool,
        "standstill_rad_s": found.settings.standstill,
        "recordings": [_recording_json(each) for each in found.recordings],
        "fit": None if fitted is None else _fit_json(found, fitted),
    }


def _recording_json(each: StopsOf) -> dict[str, Any]:
    motion = each.motion
    return {
        "recording": motion.path.name,
        "joints": list(motion.joints),
        "samples": len(motion.t),
        "duration_s": float(motion.t[-1]),
        "step_s": each.step_s,
        "longest_step_s": each.longest_step_s,
        "has": _has(each),
        "told_by": list(each.told_by),
        "notes": list(motion.notes),
        "not_measured": [
            {"reason": str(why), "times": number} for why, number in sorted(each.found.unmeasured.items())
        ],
        "ends_of_motion": len(each.found.ends_of_motion),
        "stops": [_stop_json(stop) for stop in each.stops],
    }


def _has(each: StopsOf) -> list[str]:
    motion = each.motion
    given = {
        "positions": motion.q,
        "velocities": motion.dq,
        "commanded positions": motion.command_q,
        "commanded velocities": motion.command_dq,
    }
    return [name for name, values in given.items() if values is not None]


def _stop_json(measured: Measured) -> dict[str, Any]:
    stop = measured.stop
    return {
        "causes": list(stop.causes),
        "asked_s": [stop.asked_after, stop.asked_by],
        "time_s": _pair(measured.time_s),
        "reaction_s": _pair(measured.reaction_s),
        "speed_rad_s": list(measured.speed),
        "angle_rad": None if measured.angle is None else [_pair(each) for each in measured.angle],
        "way_m": None if measured.way_m is None else _pair(measured.way_m),
        "off_path_rad": measured.off_path_rad,
        "off_path_m": measured.off_path_m,
    }


def _fit_json(found: AllStops, fitted: Fit) -> dict[str, Any]:
    model, joints = fitted.model, found.recordings[0].motion.joints
    return {
        "delay_s": model.delay_s,
        "braking_time_s": model.braking_time_s,
        "deceleration_rad_s2": model.deceleration.tolist(),
        "fastest_rad_s": model.fastest.tolist(),
        "margin": fitted.margin,
        "stops": fitted.stops,
        "causes": list(fitted.causes),
        "faster_rad_s": list(fitted.faster),
        "held_out": [_held_json(held, joints) for held in fitted.held],
        "drift": [
            {
                "recording": each.recording,
                "joint": each.joint,
                "speed_rad_s": each.speed,
                "first_rad": each.first,
                "now_rad": each.now,
            }
            for each in fitted.drift
        ],
    }


def _held_json(held: Held, joints: tuple[str, ...]) -> dict[str, Any]:
    measured = held.measured
    return {
        "recording": held.each.motion.path.name,
        "asked_s": measured.stop.asked_by,
        "within": held.within,
        "worst_joint": joints[held.joint] if math.isfinite(held.excess) else None,
        "excess_rad_s": held.excess if math.isfinite(held.excess) else None,
        "time_s": _pair(measured.time_s),
        "predicted_time_s": held.time_s,
        "angle_rad": None if measured.angle is None else [_pair(each) for each in measured.angle],
        "predicted_angle_rad": list(held.way),
    }


def _pair(between: Between) -> list[float]:
    return [between.least, between.most]


def stops_lines(found: AllStops, fitted: Fit | None) -> list[str]:
    """Return the report as text, one line each."""
    stops, recordings = len(found.stops), len(found.recordings)
    speed = found.settings.standstill
    where = f"{recordings} recordings" if recordings > 1 else "1 recording"
    arm = "unknown, so no way of the tool" if found.robot is None else f"{found.robot.name}, {_tool(found)}"
    return [
        f"stop: the robot's own, as recorded · {stops} {'stop' if stops == 1 else 'stops'} in {where} · "
        f"robot: {arm}",
        f"standstill: every joint below {speed:g} rad/s (m/s), speeds that were not recorded over "
        f"{1e3 * SPAN_S:g} ms or one step",
        *(line for each in found.recordings for line in _recording_lines(each)),
        *_worst_lines(found),
        *([] if fitted is None else _fit_lines(found, fitted)),
        *_NOTES,
    ]


def _tool(found: AllStops) -> str:
    tool = found.robot.tool if found.robot is not None else None
    return "no tool declared" if tool is None else shown(tool)


def _recording_lines(each: StopsOf) -> Iterator[str]:
    motion = each.motion
    told = ", ".join(map(shown, each.told_by)) or "nothing recorded"
    yield (
        f"{shown(motion.path.name)}: {len(motion.t)} samples, {_span(each.step_s)} apart, at most "
        f"{_span(each.longest_step_s)}; {', '.join(_has(each))}; told to stop by: {told}"
    )
    for note in motion.notes:
        yield f"  note: {shown(note, LONGEST_NOTE)}"
    for why, number in sorted(each.found.unmeasured.items()):
        yield f"  not measured: {times(number)} {why}"
    if each.found.ends_of_motion:
        yield (
            f"  ends of motion: {times(len(each.found.ends_of_motion))} the arm comes to rest, and nothing "
            "recorded says that it was told to"
        )
    yield from _resolution_lines(each)
    for measured in each.stops:
        yield from _stop_lines(each, measured)


def _resolution_lines(each: StopsOf) -> Iterator[str]:
    """What the rate of the samples lets be known of its stops, and what not."""
    if not each.stops:
        return
    widths = sorted(stop.time_s.most - stop.time_s.least for stop in each.stops)
    within = " to ".join(dict.fromkeys(map(_span, (widths[0], widths[-1]))))
    line = f"  what the samples can show: times to within {within}"
    unseen = sum(stop.time_s.least == 0.0 for stop in each.stops)
    if unseen:
        of = f"{unseen} of {len(widths)} stops" if len(widths) > 1 else "the stop"
        line += f"; in {of} no sample shows motion after the arm was told, so that the least is 0"
    yield line


def _span(seconds: float) -> str:
    """A time between samples."""
    return f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.5g} s"


def _stop_lines(each: StopsOf, measured: Measured) -> Iterator[str]:
    stop = measured.stop
    line = (
        f"  {stop.asked_by:.3f} s {shown(', '.join(stop.causes), 80)}: time {_text(measured.time_s)} s, "
        f"reaction {_text(measured.reaction_s)} s"
    )
    if measured.way_m is not None:
        line += f", tool {_text(measured.way_m)} m"
    if measured.off_path_rad is not None:
        off = "" if measured.off_path_m is None else f", {measured.off_path_m:.4f} m"
        line += f", off the commanded path {measured.off_path_rad:.4f} rad{off}"
    yield line
    names = each.motion.joints
    if measured.angle is None:
        fastest = max(range(len(names)), key=lambda j: measured.speed[j])
        yield (
            f"    no positions, so no angles; fastest joint {shown(names[fastest])}, "
            f"{measured.speed[fastest]:.3g} rad/s"
        )
        return
    moved = [
        f"{shown(name)} {_text(angle)} from {speed:.3g} rad/s"
        for name, angle, speed in zip(names, measured.angle, measured.speed, strict=True)
        if angle.most > 0.0005
    ]
    yield f"    angles [rad]: {'; '.join(moved) or 'none above 0.0005'}"


def _worst_lines(found: AllStops) -> Iterator[str]:
    """The longest stop and the largest angle of each joint, over all recordings."""
    if len(found.stops) < 2:
        return
    each, longest = max(found.stops, key=lambda pair: pair[1].time_s.most)
    yield (
        f"longest: {_text(longest.time_s)} s, {shown(each.motion.path.name)} at "
        f"{longest.stop.asked_by:.3f} s, {shown(longest.stop.kind)}"
    )


COUNTED_FROM = (
    "times count from when the recording first says that the arm was told: what the controller reports later "
    "than it acts is missing in them; time one stop from outside"
)


def _fit_lines(found: AllStops, fitted: Fit) -> Iterator[str]:
    model, joints = fitted.model, found.recordings[0].motion.joints
    yield (
        f"stop model, worst of {fitted.stops} stops ({shown(', '.join(fitted.causes), 80)}), every time "
        f"{100.0 * fitted.margin:.3g} % longer: goes on for at most {model.delay_s:.3f} s, then brakes for "
        f"at most {model.braking_time_s:.3f} s or with at least"
    )
    for joint, brake, fastest in zip(joints, model.deceleration, model.fastest, strict=True):
        yield f"  {shown(joint)}: {brake:.3g} rad/s², found up to {fastest:.3g} rad/s"
    yield f"  {COUNTED_FROM}"
    if _unseen_braking(found, fitted):
        yield (
            "  no sample shows how it brakes: each joint is taken to go on at its speed until the first "
            "sample of standstill; record faster"
        )
    yield from _faster_lines(found, fitted)
    yield from _held_lines(fitted, joints, SLOWEST * found.settings.standstill)
    for each in fitted.drift:
        yield (
            f"  drift: {shown(each.joint)} from {each.speed:.3g} rad/s goes {each.now:.3f} rad by "
            f"{shown(each.recording)} alone, {each.first:.3f} rad by the first recording"
        )


def _unseen_braking(found: AllStops, fitted: Fit) -> bool:
    """Whether the model brakes for less than a sample, whatever the joint."""
    model = fitted.model
    longest = float(model.brakes_for(model.fastest).max())
    return longest < min(each.step_s for each in found.recordings)


def _faster_lines(found: AllStops, fitted: Fit) -> Iterator[str]:
    joints = found.recordings[0].motion.joints
    rises = [
        f"{shown(joint)} {rise:.3g} rad/s"
        for joint, rise in zip(joints, fitted.faster, strict=True)
        if rise > found.settings.standstill
    ]
    if rises:
        yield (
            f"  faster after it was told than just before, by up to: {', '.join(rises)}; what of that was "
            "not intended, velocity_error_rad_s of [robot.tracking] must cover"
        )


def _held_lines(fitted: Fit, joints: tuple[str, ...], slowest: float) -> Iterator[str]:
    if not fitted.held:
        yield "  validated: not at all, there is only one stop"
        return
    within = sum(held.within for held in fitted.held)
    spread = [held.time_s - held.measured.time_s.most for held in fitted.held]
    slow = f" (below 0: joints slower than {slowest:g} rad/s, which tell nothing, rest last)"
    yield (
        f"  validated: a model of every second stop ({fitted.fitted_on}), margin included, bounds {within} "
        f"of the {len(fitted.held)} others at every sample; predicted less measured time: "
        f"{_spread(spread)} s{slow if min(spread) < 0.0 and within == len(spread) else ''}"
    )
    for held in fitted.held:
        if not held.within:
            when = f"{shown(held.each.motion.path.name)} at {held.measured.stop.asked_by:.3f} s"
            yield (f"    not bounded: {when}: {shown(joints[held.joint])} is {held.excess:.3g} rad/s faster")
    if within < len(fitted.held):
        yield (
            "    what can be done: record more stops, with the speeds, loads and poses that count, and fit "
            "on all; or a larger --margin"
        )


def _spread(values: list[float]) -> str:
    return f"{min(values):+.3f} to {max(values):+.3f}"


def _text(between: Between) -> str:
    return f"{between.least:.3f}–{between.most:.3f}"
