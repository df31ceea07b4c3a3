"""What the mode that plans anew is told: where to go, when to plan anew, and how."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from modes.planning.arrt import PlannerSettings
from modes.settings import require_kind, require_number, require_numbers
from robots.errors import SetupError
from robots.model import RobotModel


@dataclass(frozen=True, slots=True)
class Target:
    """Where the arm is wanted.

    Attributes
    ----------
    q:
        ``(n,)`` configuration [rad].
    wait_s:
        How long it rests there [s].
    """

    q: Sequence[float]
    wait_s: float = 0.5


@dataclass(frozen=True, slots=True)
class ReplanSettings:
    """When the way is planned anew, and how.

    Attributes
    ----------
    clearance_m:
        Gap from people that is wanted [m]; the paper reports more than 250 mm.
    margins_m:
        Gaps beyond it that are tried one after the other when a way is planned [m].
    slack_m:
        A way is planned anew when the gap ahead is smaller than wanted, by no more than this [m].
    ahead_s:
        How far ahead on its trajectory it is looked [s].
    sample_s:
        Spacing of the places that are looked at [s].
    patience_s:
        How long the arm rests on its way before another one is planned [s].
    clear_s:
        How long a way must have been clear again before the arm goes on along it [s].
    forget_s:
        How long places where it was held back are avoided [s].
    planner:
        How ways are planned.

    Raises
    ------
    SetupError
        A setting cannot be used; it names it.
    """

    clearance_m: float = 0.25
    margins_m: tuple[float, ...] = (0.15, 0.1, 0.05)
    slack_m: float = 0.02
    ahead_s: float = 1.5
    sample_s: float = 0.05
    patience_s: float = 0.3
    clear_s: float = 0.25
    forget_s: float = 4.0
    planner: PlannerSettings = field(default_factory=lambda: PlannerSettings(nodes=200))

    def __post_init__(self) -> None:
        name = "proactive avoidance:"
        require_number(f"{name} clearance_m", self.clearance_m, 0.0, 5.0)
        require_kind(f"{name} margins_m", self.margins_m, tuple, written="a tuple of numbers")
        for k, each in enumerate(self.margins_m):
            require_number(f"{name} margins_m, number {k + 1}", each, 0.0, 5.0 - self.clearance_m)
        require_number(f"{name} slack_m", self.slack_m, 0.0, 1.0)
        require_number(f"{name} sample_s", self.sample_s, 1e-3, 60.0)
        for key in ("ahead_s", "patience_s", "clear_s", "forget_s"):
            require_number(f"{name} {key}", getattr(self, key), 0.0, 60.0, above=True)
        require_kind(f"{name} planner", self.planner, PlannerSettings, written="PlannerSettings(...)")
        if not self.margins_m or list(self.margins_m) != sorted(self.margins_m, reverse=True):
            raise SetupError(
                f"{name} margins_m = {self.margins_m!r} should be one or more, the largest first"
            )


def checked_target(robot: RobotModel, k: int, target: Target) -> Target:
    """Return a target that the arm can reach."""
    require_kind(f"proactive avoidance: target {k + 1}", target, Target, written="Target(q, wait_s)")
    q = require_numbers(f"proactive avoidance: target {k + 1}", target.q, (len(robot.joints),))
    require_number(f"proactive avoidance: target {k + 1}, wait_s", target.wait_s, 0.0, 3600.0)
    outside = (q < robot.limits.position_lower) | (q > robot.limits.position_upper)
    if outside.any():
        joint = robot.joints[int(np.argmax(outside))]
        raise SetupError(f"proactive avoidance: target {k + 1} has joint {joint} beyond its position limits")
    return Target(tuple(q.tolist()), target.wait_s)
