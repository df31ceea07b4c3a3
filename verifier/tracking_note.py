"""What `verify` says where the commands in a recording contradict the tracking error that it used (A2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robots.assumption import Assumption
from verifier.cell import Cell
from verifier.recordings.errors import RecordingError
from verifier.recordings.measured_tracking import LONGEST_DELAY_S, measure_blocks, outside_commands
from verifier.recordings.recorded_tracking import CommandedStretches
from verifier.recordings.recording import Recording
from verifier.recordings.topic import COMMAND_TOPIC
from verifier.shown import shown

_OF_JOINT = "robot.tracking."


def tracking_notes(recording: Recording, cell: Cell, assumptions: Sequence[Assumption]) -> tuple[str, ...]:
    """Return, as at most one note, that a joint was farther from its commands than was used.

    The rule is that of :class:`verifier.tracking.TrackingMonitor`: a reading agrees where it is within the
    joint error of some command within the delays of the cell. Used was what the cell declares, else the
    largest residual of the fit, which stands in ``assumptions``.
    """
    try:
        longest = max(LONGEST_DELAY_S, cell.robot.tracking.delay_max_s)
        stretches = CommandedStretches.of(recording, longest)
        return () if stretches is None else _contradicted(stretches, cell, assumptions)
    except RecordingError as error:
        return (f"commands on {COMMAND_TOPIC} were not looked at: {error.wrong}",)


def _contradicted(
    stretches: CommandedStretches, cell: Cell, assumptions: Sequence[Assumption]
) -> tuple[str, ...]:
    joints, tracking = stretches.joints, cell.robot.tracking
    declared = tracking.position_error_rad
    used = _used(joints, declared, assumptions)
    most, at_s, away_most, joint = 0.0, 0.0, 0.0, 0
    for measured, commanded in stretches:
        away = outside_commands(measured, commanded, (tracking.delay_min_s, tracking.delay_max_s))
        away = np.where(np.isfinite(away), away, 0.0)
        excess = away - used
        sample, worst = (int(each) for each in np.unravel_index(np.argmax(excess), excess.shape))
        if excess[sample, worst] > most:
            most, joint = float(excess[sample, worst]), worst
            at_s, away_most = float(measured.t[sample]), float(away[sample, worst])
    if not most > 0.0:
        return ()
    word = "used" if isinstance(declared, str) else "declared"
    text = (
        f"A2: {shown(joints[joint])} is {away_most:.3g} rad (m where it slides) from every command "
        f"on {COMMAND_TOPIC} of {tracking.delay_min_s:g} … {tracking.delay_max_s:g} s before, at "
        f"{at_s:.3f} s after the first sample; {word} were {used[joint]:.3g}"
    )
    fitted = measure_blocks(joints, lambda: stretches)
    if fitted is not None and fitted.delay_s is not None:
        text += f"; with a delay of {1e3 * fitted.delay_s:.1f} ms it is {fitted.error.max():.3g} at most"
    return (f"{text}: declare [robot.tracking] in the cell",)


def _used(
    joints: Sequence[str], declared: float | str, assumptions: Sequence[Assumption]
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """The joint errors (J,) that the verdicts rest on; infinite for joints that were not judged."""
    if not isinstance(declared, str):
        return np.full(len(joints), declared)
    residual = {item.name.removeprefix(_OF_JOINT): item.value for item in assumptions}
    return np.array([float(residual.get(name, np.inf)) for name in joints])
