"""Joints that the plan does not command: a recording shows whether they rest where they are enclosed."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from robots.model import LockedJoint, RobotModel
from verifier.hindsight import Finding
from verifier.recordings.windowed import Windowed
from verifier.verdict import Reason

MOVED = 1e-3
"""A joint that stays within this [rad or m] during a plan rests: a millimetre, a metre from its axis."""
AROUND_S = 0.05
"""So long before and after a plan it must rest too: a plan at rest is short, and slow motion little in it."""


class LockedMotion:
    """What was recorded of joints that are not commanded.

    Links on such a joint are enclosed for its whole range, and count as at rest where the arm rests. A joint
    that moves meanwhile, or leaves its range, contradicts that (A3, docs/method.md, section 3).

    Parameters
    ----------
    seen:
        Each joint, and times (T,) [s], increasing, and positions (T,) [rad or m] of its samples.
    """

    def __init__(
        self, seen: Sequence[tuple[LockedJoint, NDArray[np.float64], NDArray[np.float64]]] = ()
    ) -> None:
        self._seen = tuple(seen)

    def check(self, since: float, until: float) -> Finding | None:
        """Return what contradicts that all of them rest in their range from ``since`` to ``until`` [s]."""
        since, until = since - AROUND_S, until + AROUND_S
        for joint, t, q in self._seen:
            first = max(int(np.searchsorted(t, since, side="right")) - 1, 0)
            end = int(np.searchsorted(t, until, side="left")) + 1
            if first < len(t) and t[first] <= until and not _rests(joint, q[first:end]):
                return _finding(joint, t[first:end], q[first:end])
        return None


def _rests(joint: LockedJoint, q: NDArray[np.float64]) -> bool:
    inside = joint.lower - MOVED <= q.min() and q.max() <= joint.upper + MOVED
    return bool(inside and q.max() - q.min() <= MOVED)  # NaN is neither


def _finding(joint: LockedJoint, t: NDArray[np.float64], q: NDArray[np.float64]) -> Finding:
    unit = "m" if joint.prismatic else "rad"
    outside = np.flatnonzero(~((q >= joint.lower - MOVED) & (q <= joint.upper + MOVED)))
    if len(outside):
        at = int(outside[0])
        text = f"at {q[at]:.4g} {unit}, outside of its range, {joint.lower:.4g} to {joint.upper:.4g} {unit}"
    else:
        at = int(np.argmax(np.abs(q - q[0])))
        text = f"moved from {q[0]:.4g} to {q[at]:.4g} {unit}"
    text = f"{joint.name}, which is not commanded and believed to rest: {text}"
    return Finding(Reason.UNCOMMANDED_JOINT_MOVED, "A3 robot", text, float(t[at]))


def locked_motion(source: Windowed, robot: RobotModel) -> LockedMotion:
    """Read what a recording says of the joints that are not commanded.

    Raises
    ------
    RecordingError
        The file is damaged.
    """
    times = {joint.name: array("d") for joint in robot.locked}
    places = {joint.name: array("d") for joint in robot.locked}
    for name, t, q in source.positions_of(times):
        times[name].append(t)
        places[name].append(q)
    return LockedMotion(
        [(each, *_in_order(times[each.name], places[each.name])) for each in robot.locked if times[each.name]]
    )


def _in_order(t: array[float], q: array[float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Samples in order of time; nobody has looked at the stamps of these joints before."""
    times, places = np.array(t), np.array(q)
    if any(b < a for a, b in pairwise(t)):
        order = np.argsort(times, kind="stable")
        times, places = times[order], places[order]
    return times, places
