"""Force and torque at the end effector: the tool's weight, the contact, and when not to believe the sensor.

A sensor between flange and tool measures what acts on the tool: contact, weight, and a bias of its own. What
is left without weight and bias is turned into base axes, so that it can be filtered while the sensor turns.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from modes.contact import kernels
from modes.contact.filters import RATE_HZ
from modes.settings import require_number, require_numbers
from robots.errors import SetupError

Array = NDArray[np.float64]

GRAVITY = np.array([0.0, 0.0, -9.80665])
_LEAST_POSES = 4


class SensorFault(Enum):
    """Why a sensor is not believed."""

    NOT_A_NUMBER = "a sample is not six numbers with a stamp"
    SATURATED = "a sample is at the end of the sensor's range"
    FROZEN = "all samples have been the same"
    DROPPED = "samples have not come"
    CLOCK = "samples are stamped before those that came already, or in the future"
    WEIGHT = (
        "at rest and untouched it does not read the weight of its tool: a swapped axis, another tool, a drift"
    )


@dataclass(frozen=True, slots=True, eq=False)
class ToolLoad:
    """What hangs on the sensor, and its bias; sensor axes.

    Attributes
    ----------
    mass_kg, centre_m:
        Of all beyond the sensor: mass [kg], and where its centre is (3,) [m].
    bias:
        ``(6,)`` what the unloaded sensor reads: force [N], torque [N m].
    """

    mass_kg: float = 0.0
    centre_m: Array = field(default_factory=lambda: np.zeros(3))
    bias: Array = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        require_number("tool load: mass_kg", self.mass_kg, 0.0, 1e4)
        for name, shape in (("centre_m", (3,)), ("bias", (6,))):
            value = require_numbers(f"tool load: {name}", getattr(self, name), shape)
            object.__setattr__(self, name, value)

    def unloaded(self, rotation: Array) -> Array:
        """Return what the sensor reads without contact (6,), its axes being the columns of ``rotation``."""
        out = np.empty(6)
        kernels.unloaded(self.mass_kg, self.centre_m, self.bias, GRAVITY, rotation, out)
        return out

    def contact(self, reading: Array, rotation: Array) -> Array:
        """Return force and torque of the contact (6,) [N, N m], about the sensor, base axes."""
        out = np.empty(6)
        kernels.contact(self.mass_kg, self.centre_m, self.bias, GRAVITY, rotation, reading, out)
        return out


def identify_load(readings: Array, rotations: Array, tolerance_N: float = 1.0) -> ToolLoad:
    """Return load and bias from readings of an untouched sensor at rest, in several orientations.

    Parameters
    ----------
    readings, rotations:
        ``(N, 6)`` [N, N m]; ``(N, 3, 3)`` whose columns are the sensor's axes in the base.
    tolerance_N:
        By how much a force may differ from that of the load that fits best [N].

    Raises
    ------
    SetupError
        There are too few orientations, or no load fits: an axis is swapped, or somebody touched it.
    """
    readings = require_numbers("tool load: readings", readings, (-1, 6))
    rotations = require_numbers("tool load: rotations", rotations, (-1, 3, 3))
    n = len(readings)
    if len(rotations) != n:
        raise SetupError(f"tool load: {n} readings and {len(rotations)} rotations do not belong together")
    if np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max(initial=0.0) > 1e-6:
        raise SetupError("tool load: a rotation is none: its columns should be of size 1 and orthogonal")
    weights = np.einsum("nji,j->ni", rotations, GRAVITY)
    if n < _LEAST_POSES or np.linalg.matrix_rank(weights - weights.mean(axis=0), tol=1.0) < 2:
        raise SetupError(
            f"tool load: {n} orientations do not tell weight from bias: take {_LEAST_POSES} or more, "
            "tilted differently: a turn about the vertical tells nothing"
        )
    design = np.zeros((3 * n, 4))
    design[:, 0] = weights.ravel()
    design[:, 1:] = np.tile(np.eye(3), (n, 1))
    found, *_ = np.linalg.lstsq(design, readings[:, :3].ravel(), rcond=None)
    off = np.linalg.norm((design @ found).reshape(n, 3) - readings[:, :3], axis=1)
    if not off.max() <= tolerance_N or found[0] < 0.0:
        raise SetupError(
            f"tool load: no load fits: orientation {int(off.argmax()) + 1} is off by {off.max():.2f} N, more "
            f"than {tolerance_N:g} N allow; check the axes of the sensor, and that nobody touched it"
        )
    pull = found[0] * weights
    arms = np.zeros((3 * n, 6))
    arms[:, :3] = np.concatenate([-_cross(each) for each in pull])
    arms[:, 3:] = np.tile(np.eye(3), (n, 1))
    moments, *_ = np.linalg.lstsq(arms, readings[:, 3:].ravel(), rcond=None)
    bias: Array = np.concatenate((found[1:], moments[3:])).astype(np.float64)
    centre: Array = moments[:3].astype(np.float64)
    return ToolLoad(float(found[0]), centre, bias)


def _cross(v: Array) -> Array:
    """Return the matrix of v ×."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@dataclass(frozen=True, slots=True)
class SensorLimits:
    """When a sensor is not believed.

    Attributes
    ----------
    range_N, range_Nm:
        The end of its range; those of an ATI Mini45 with the smallest calibration [N; N m].
    frozen_s:
        So long all samples may be the same [s].
    silent_s:
        So long none may come [s].
    weight_N:
        By so much a reading at rest may differ from the weight of the tool [N].
    """

    range_N: float = 145.0
    range_Nm: float = 5.0
    frozen_s: float = 0.05
    silent_s: float = 0.03
    weight_N: float = 1.5

    def __post_init__(self) -> None:
        for name in self.__slots__:
            require_number(f"sensor limits: {name}", getattr(self, name), 0.0, 1e6, above=True)


class SensorWatch:
    """Looks at the samples of a sensor as they come, and averages those of each control step.

    The mean over a control step keeps what is faster than the loop from being taken for something slow: a
    mean of 12 samples at 1 kHz has its zeros at 83.3 Hz and its multiples.
    """

    def __init__(self, limits: SensorLimits | None = None, rate_hz: float = RATE_HZ) -> None:
        self.limits = SensorLimits() if limits is None else limits
        self._period = 1.0 / rate_hz
        least = self.limits
        self._limits = np.array((least.range_N, least.range_Nm, least.frozen_s, least.silent_s))
        self._seen, self._last = np.full(2, -np.inf), np.full(6, np.nan)

    def take(self, now: float, stamps: Array, samples: Array) -> Array | SensorFault:
        """Return the mean reading (6,), or why there is none.

        Parameters
        ----------
        now:
            Instant of this control step [s].
        stamps, samples:
            ``(m,)`` [s], ``(m, 6)`` [N, N m]: what has come since the last one.
        """
        if samples.shape != (len(stamps), 6):
            return SensorFault.NOT_A_NUMBER
        mean = np.empty(6)
        code = kernels.watch(now, self._period, stamps, samples, self._limits, self._seen, self._last, mean)
        return mean if code == kernels.BELIEVED else _FAULTS[code]


_FAULTS = {
    kernels.NOT_A_NUMBER: SensorFault.NOT_A_NUMBER,
    kernels.SATURATED: SensorFault.SATURATED,
    kernels.FROZEN: SensorFault.FROZEN,
    kernels.DROPPED: SensorFault.DROPPED,
    kernels.CLOCK: SensorFault.CLOCK,
}
