"""The robot's own stop, as it was measured, at shares of the speeds up to which it is known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from failsafe.braking import Braking
from failsafe.stopping import ConstantDeceleration
from robots.errors import SetupError
from robots.limits import Array
from robots.model import RobotModel
from verifier.cell import Cell
from verifier.stop_model import braking_of
from verifier.stop_report.report import MEASURED


@dataclass(frozen=True, eq=False)
class OwnStop:
    """A stop of :mod:`failsafe.braking`.

    Attributes
    ----------
    braking:
        The bound that was fitted.
    intended:
        (n,) joint speeds at 100 % [rad/s; m/s], of what is intended.
    error:
        What no plan intends, and a joint may be faster by [rad/s; m/s].
    limited:
        Whether some joint can be intended to be faster than it was in any stop that was measured.
    """

    braking: Braking
    intended: Array
    error: float
    limited: bool

    def at(self, share: float) -> ConstantDeceleration:
        """Return the bound from a share of the intended speeds: V = share |dq| + error, b = min(a, V/T)."""
        speed = np.minimum(share * self.intended + self.error, self.braking.fastest)
        deceleration = self.braking.deceleration
        if self.braking.braking_time_s > 0.0:
            deceleration = np.minimum(deceleration, speed / self.braking.braking_time_s)
        return ConstantDeceleration(speed, deceleration, self.braking.delay_s, MEASURED)


def own_stop(cell: Cell, robot: RobotModel, share: float) -> OwnStop | None:
    """Return the stop that a cell names, at most at a share of the velocity limits; ``None``: it names none.

    Raises
    ------
    SetupError
        The model file cannot be used, or no joint speed is left below the declared error.
    """
    if cell.stop.measured_file is None:
        return None
    braking = braking_of(Path(cell.stop.measured_file), robot)[1]
    error = cell.robot.tracking.velocity_error_rad_s
    wanted, known = share * robot.limits.velocity, braking.fastest - error
    if not (known > 0.0).all():
        j = int(np.argmin(known))
        raise SetupError(
            f"robot.tracking.velocity_error_rad_s {error:g}: should be below {braking.fastest[j]:g}, up to "
            f"which stops of joint {robot.joints[j]} were measured"
        )
    return OwnStop(braking, np.minimum(wanted, known), error, bool((known < wanted).any()))
