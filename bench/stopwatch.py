"""Where the time of a cycle goes: the stages' own methods, timed while a recording is verified."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

from failsafe.manoeuvre import VelocityProfile
from failsafe.short_term_plan import ShortTermPlanner
from occupancy.humans.iso13855 import Iso13855
from occupancy.measurement import Gate
from occupancy.separation import Separation
from occupancy.swept import LinkOccupancy
from verifier import section
from verifier.cycle import CycleCheck
from verifier.hindsight import PeopleHindsight, RobotHindsight

PART_OF_PLAN = "of it ruckig"
Stages = dict[str, tuple[tuple[Any, str], ...]]
STAGES: Stages = {
    "fit of the path": ((section, "fit_samples"),),
    "gate": ((Gate, "admit"),),
    "short-term plan": ((ShortTermPlanner, "plan"),),
    PART_OF_PLAN: ((VelocityProfile, "calculate"),),
    "sweep of links": ((LinkOccupancy, "occupy"),),
    "occupancy of people": ((Iso13855, "occupy"),),
    "obligations": ((CycleCheck, "open_obligations"),),
    "separation": ((Separation, "check"),),
    "hindsight": ((PeopleHindsight, "check"), (RobotHindsight, "check"), (section, "sightings")),
}
"""Stages of a cycle in their order; none calls another, but the plan calls ruckig."""


@contextmanager
def processor_time() -> Iterator[None]:
    """Let the project's stopwatches count processor time, not elapsed time, while the block runs."""
    with patch.object(time, "perf_counter", time.process_time):
        yield


@contextmanager
def timed_stages(stages: Stages = STAGES) -> Iterator[dict[str, float]]:
    """Yield the seconds that each stage has taken, while the block runs."""
    seconds = dict.fromkeys(stages, 0.0)
    with ExitStack() as stack:
        for stage, targets in stages.items():
            for owner, name in targets:
                timed = _timed(getattr(owner, name), seconds, stage)
                stack.enter_context(patch.object(owner, name, timed))
        yield seconds


def _timed(function: Callable[..., Any], seconds: dict[str, float], stage: str) -> Callable[..., Any]:
    def call(*arguments: Any, **named: Any) -> Any:
        began = time.perf_counter()
        answer = function(*arguments, **named)
        seconds[stage] += time.perf_counter() - began
        return answer

    return call
