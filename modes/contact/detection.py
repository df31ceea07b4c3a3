"""Collisions and contacts told from motor currents, forces at the end effector, and the two together.

Mariotti et al., section III B and C. Currents are absolute values, as the KUKA interface gives them. A fast
change is a collision; what lasts is a contact that has not been removed, or, at the end effector and without
a fast change, the wish to collaborate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.contact import kernels
from modes.contact.filters import (
    RATE_HZ,
    Stream,
    Variant,
    current_high_pass,
    current_low_pass,
    force_high_pass,
    force_low_pass,
)
from modes.settings import require_choice, require_kind, require_number
from robots.errors import SetupError

Array = NDArray[np.float64]
ResidualVariant = Literal["as_printed", "corrected"]
RESIDUALS: tuple[ResidualVariant, ...] = ("as_printed", "corrected")


@dataclass(frozen=True, slots=True, eq=False)
class CurrentThresholds:
    """(8) and (10): thresholds that rise with the commanded speed and acceleration of a joint.

    Attributes
    ----------
    high_least, high_speed, high_acceleration:
        τ_Hmin, k_Hv, k_Ha, one per joint from the first on [A].
    low_least, low_speed, low_acceleration:
        τ_Lmin, k_Lv, k_La [A].
    speed, acceleration:
        v_max [rad/s], a_max [rad/s²]: what speeds are divided by; no limits of the robot.

    Raises
    ------
    SetupError
        Lengths differ, or a number is out of its range.
    """

    high_least: Sequence[float]
    high_speed: Sequence[float]
    high_acceleration: Sequence[float]
    low_least: Sequence[float]
    low_speed: Sequence[float]
    low_acceleration: Sequence[float]
    speed: Sequence[float]
    acceleration: Sequence[float]
    _high: Array = field(init=False, repr=False)
    _low: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in self.__slots__[:8]:
            require_kind(f"current thresholds: {name}", getattr(self, name), Sequence, written="a tuple")
        n = len(self.high_least)
        for name in self.__slots__[:8]:
            values = getattr(self, name)
            if len(values) != n or n == 0:
                raise SetupError(f"current thresholds: {name} has {len(values)} numbers, high_least has {n}")
            for joint, value in enumerate(values):
                divides, least = name in {"speed", "acceleration"}, name.endswith("least")
                low = 1e-6 if divides or least else 0.0
                require_number(f"current thresholds: {name}, joint {joint + 1}", value, low, 1e6)
        scales = self.speed, self.acceleration
        high = self.high_least, self.high_speed, self.high_acceleration, *scales
        low_ = self.low_least, self.low_speed, self.low_acceleration, *scales
        object.__setattr__(self, "_high", np.array(high, dtype=float))
        object.__setattr__(self, "_low", np.array(low_, dtype=float))

    @property
    def joints(self) -> int:
        """How many joints are looked at."""
        return len(self.high_least)

    @property
    def tables(self) -> tuple[Array, Array]:
        """Return both as rows (5, k), for kernels."""
        return self._high, self._low

    def high(self, dq: Array, ddq: Array) -> Array:
        """Return τ_HPF (k,) [A] at commanded speeds (≥ k,) [rad/s] and accelerations [rad/s²]."""
        return _of(self._high, dq, ddq)

    def low(self, dq: Array, ddq: Array) -> Array:
        """Return τ_LPF (k,) [A]."""
        return _of(self._low, dq, ddq)


def _of(table: Array, dq: Array, ddq: Array) -> Array:
    out = np.empty(table.shape[1])
    kernels.threshold(table, dq, ddq, out)
    return out


TABLE_1 = CurrentThresholds(
    high_least=(0.1, 0.18, 0.16),
    high_speed=(0.1, 0.35, 0.25),
    high_acceleration=(0.2, 0.2, 0.2),
    low_least=(0.1, 0.96, 0.99),
    low_speed=(1.6, 1.3, 1.3),
    low_acceleration=(0.0, 0.0, 0.0),
    speed=tuple(np.deg2rad([200.0, 125.0, 100.0]).tolist()),
    acceleration=tuple(np.deg2rad([1200.0, 1050.0, 900.0]).tolist()),
)
"""The paper's Table I, of a KUKA KR5 sixx R650, for its first three joints."""


class BodyContact(NamedTuple):
    """What currents say.

    Attributes
    ----------
    collision, lasts:
        A joint's high-passed, or low-passed, current is above its threshold.
    high, low:
        ``(k,)`` of all joints that are looked at [A].
    high_threshold, low_threshold:
        ``(k,)`` [A].
    """

    collision: bool
    lasts: bool
    high: Array
    low: Array
    high_threshold: Array
    low_threshold: Array


class BodyDetector:
    """Collision with the body of the robot, from absolute motor currents.

    Parameters
    ----------
    thresholds:
        Table I, or those of another robot.
    variant:
        Of the filters.
    rate_hz:
        At which currents come [Hz].
    """

    def __init__(
        self,
        thresholds: CurrentThresholds = TABLE_1,
        variant: Variant = "corrected",
        rate_hz: float = RATE_HZ,
    ) -> None:
        self.thresholds, self._rate = thresholds, rate_hz
        self._high = Stream(current_high_pass(variant, rate_hz), thresholds.joints)
        self._low = Stream(current_low_pass(variant, rate_hz), thresholds.joints)
        self._parts = *self._high.parts, *self._low.parts, *thresholds.tables
        self._before, self._begun = np.zeros(thresholds.joints), False

    def step(self, currents: Array, dq: Array) -> BodyContact:
        """Take currents (≥ k,) [A] and the commanded speeds (≥ k,) [rad/s] of a control step."""
        k = self.thresholds.joints
        if not self._begun:
            self._begun = True
            self._before[:] = dq[:k]
            self._high.settle(np.abs(currents[:k]))
            self._low.settle(np.abs(currents[:k]))
        out = np.empty((4, k))
        found = kernels.body(*self._parts, currents, dq, self._before, self._rate, out)
        return BodyContact(found & 1 != 0, found & 2 != 0, out[0], out[1], out[2], out[3])


class ToolContact(NamedTuple):
    """What forces at the end effector say.

    Attributes
    ----------
    collision:
        The high-passed force is above its threshold.
    lasts:
        The low-passed one is: the contact is still there, or, without a collision, wanted.
    high_N, low_N:
        The two sizes [N].
    """

    collision: bool
    lasts: bool
    high_N: float
    low_N: float


@dataclass(frozen=True, slots=True)
class ForceThresholds:
    """The paper's 10 N for collisions and 7 N for contacts.

    Raises
    ------
    SetupError
        A threshold is not above 0.
    """

    high_N: float = 10.0
    low_N: float = 7.0

    def __post_init__(self) -> None:
        require_number("force thresholds: high_N", self.high_N, 0.0, 1e6, above=True)
        require_number("force thresholds: low_N", self.low_N, 0.0, 1e6, above=True)


class ToolDetector:
    """Collision and contact at the end effector, from contact forces; any axes that do not turn."""

    def __init__(
        self,
        thresholds: ForceThresholds | None = None,
        variant: Variant = "corrected",
        rate_hz: float = RATE_HZ,
    ) -> None:
        self.thresholds = ForceThresholds() if thresholds is None else thresholds
        self._high = Stream(force_high_pass(variant, rate_hz), 3)
        self._low = Stream(force_low_pass(variant, rate_hz), 3)
        self._begun, self._parts = False, (*self._high.parts, *self._low.parts)

    def step(self, force: Array) -> ToolContact:
        """Take the contact force (3,) [N] of a control step."""
        if not self._begun:
            self._high.settle(force)
            self._low.settle(force)
            self._begun = True
        high, low = kernels.tool(*self._parts, force)
        return ToolContact(high > self.thresholds.high_N, low > self.thresholds.low_N, high, low)


@dataclass(frozen=True, slots=True, eq=False)
class Residual:
    """(18): what motor torques show beyond a force at the end effector, while somebody guides it.

    *as_printed*, | k_m (i - i_off) | - J'F: a size less a number with a sign, so that a force which a joint
    feels as negative raises a false alarm of twice its torque. *corrected*: the sizes of both are compared.
    Since currents have no sign, i - i_off is the change of the true current only where that keeps its sign.

    Attributes
    ----------
    gains_Nm_A:
        ``(n,)`` torque at the joint per current, k_m [N m/A].
    threshold_Nm:
        ε_r [N m]; the paper prints 22 N.
    variant:
        Which difference.

    Raises
    ------
    SetupError
        A number is out of its range, or the variant is not known.
    """

    gains_Nm_A: Sequence[float]
    threshold_Nm: float = 22.0
    variant: ResidualVariant = "corrected"
    _gains: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        require_choice("residual: variant", self.variant, RESIDUALS)
        require_number("residual: threshold_Nm", self.threshold_Nm, 0.0, 1e6, above=True)
        require_kind("residual: gains_Nm_A", self.gains_Nm_A, Sequence, written="one number per joint")
        if len(self.gains_Nm_A) == 0:
            raise SetupError("residual: gains_Nm_A is empty: one number per joint is needed")
        for joint, value in enumerate(self.gains_Nm_A):
            require_number(f"residual: gains_Nm_A, joint {joint + 1}", value, 0.0, 1e6, above=True)
        object.__setattr__(self, "_gains", np.array(self.gains_Nm_A, dtype=float))

    def of(self, currents: Array, offset: Array, torques: Array) -> Array:
        """Return r (n,) [N m].

        Parameters
        ----------
        currents, offset:
            ``(n,)`` absolute currents now, and of the last step before somebody began to guide [A].
        torques:
            ``(n,)`` J'F, of force and moment at the end effector, base axes [N m].
        """
        out = np.empty(len(self._gains))
        kernels.residual(self._gains, currents, offset, torques, self.variant == "as_printed", out)
        return out

    def alarms(self, residual: Array) -> bool:
        """Whether a joint's residual is above the threshold."""
        return bool(kernels.exceeds(residual, self.threshold_Nm))
