"""What is asked of a stop report: load, speed, brakes, protective device, and how much work it is worth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from robots.errors import SetupError
from robots.limits import LARGEST_LIMIT
from verifier.required_distance import COARSEST_M, HIGHEST_M

DEFAULT_DEADLINE_S = 10.0
"""Longest time of one search [s]."""
FARTHEST_M = 5.0
"""Of the centre of a payload from what it hangs on [m]: more is taken for millimetres."""
SLOWEST = 1e-6
"""Share of the velocity limits; with less, stops are as short as roundings."""
GAP = 0.02
"""Share of the upper bound at which a search is content."""


@dataclass(frozen=True, slots=True)
class StopReportSettings:
    """Numbers that neither the cell nor the recording has.

    Attributes
    ----------
    payload_kg:
        Tool and workpiece together [kg], at most the rated payload; ``None``: nobody said.
    payload_at_m:
        Its centre of mass (3,) in the frame that it hangs on [m]; ``None``: in the origin, shown as default.
    payload_frame:
        Link that it hangs on; ``None``: the flange of the model file.
    speed:
        100 % of speed in the report, as a share of the velocity limits.
    brake_torque:
        Of each joint, or of all [N m; N], while the brake slips or holds; ``None``: nobody said.
    brake_delay_s:
        From the loss of drive power until the brakes hold [s]; belongs to ``brake_torque``.
    resolution_m, height_m:
        Resolution d of the protective device, and height of its field above the floor [m].
    deadline_s:
        Longest time of one search [s].
    seed:
        Of the states that are looked at from below.

    Raises
    ------
    SetupError
        A number is not usable, or one that belongs to another is missing.
    """

    payload_kg: float | None = None
    payload_at_m: tuple[float, float, float] | None = None
    payload_frame: str | None = None
    speed: float = 1.0
    brake_torque: tuple[float, ...] | None = None
    brake_delay_s: float | None = None
    resolution_m: float | None = None
    height_m: float | None = None
    deadline_s: float = DEFAULT_DEADLINE_S
    seed: int = 0

    def __post_init__(self) -> None:
        self._in_range("--payload", self.payload_kg, 0.0, 1e5, "kg")
        for value in self.payload_at_m or ():
            self._in_range("--payload-at", value, -FARTHEST_M, FARTHEST_M, "m")
        self._in_range("--brake-delay", self.brake_delay_s, 0.0, 10.0, "s")
        self._in_range("--resolution", self.resolution_m, 0.0, COARSEST_M, "m (30 mm is 0.03)")
        self._in_range("--field-height", self.height_m, 0.0, HIGHEST_M, "m (300 mm is 0.3)")
        if not SLOWEST <= self.speed <= 1.0:
            raise SetupError(
                f"--speed {self.speed:g}: should be {SLOWEST:g} to 1, a share of the limits: 0.5 is 50 %"
            )
        if not 0.0 < self.deadline_s < math.inf:
            raise SetupError(f"--deadline {self.deadline_s:g}: should be above 0 s and finite")
        if not self.seed >= 0:
            raise SetupError(f"--seed {self.seed}: should be at least 0")
        self._brakes()
        if self.payload_kg is None and (self.payload_at_m is not None or self.payload_frame is not None):
            raise SetupError("--payload-at, --payload-frame: belong to a payload; give --payload KG too")

    @staticmethod
    def _in_range(option: str, value: float | None, least: float, most: float, unit: str) -> None:
        if value is not None and not least <= value <= most:
            raise SetupError(f"{option} {value:g}: should be {least:g} to {most:g} {unit}")

    def _brakes(self) -> None:
        if (self.brake_torque is None) != (self.brake_delay_s is None):
            raise SetupError("--brake-torque, --brake-delay: each needs the other one")
        if self.brake_torque is None:
            return
        for torque in self.brake_torque:
            if not 0.0 < torque <= LARGEST_LIMIT:
                raise SetupError(
                    f"--brake-torque {torque:g}: should be above 0, at most {LARGEST_LIMIT:g} for every joint"
                )
        if not self.brake_torque:
            raise SetupError("--brake-torque: should be one number, or one for each joint")
        if self.payload_kg is None:
            raise SetupError(
                "--brake-torque: needs --payload KG, 0 for nothing; an unknown mass is not assumed"
            )


@dataclass(frozen=True, slots=True)
class Work:
    """What goes on while a report is made.

    ``clock`` [s]; ``should_end`` is asked again and again, true ends the work with what has been reached;
    ``progress`` is told the share that is done.
    """

    clock: Callable[[], float]
    should_end: Callable[[], bool]
    progress: Callable[[float], None]
