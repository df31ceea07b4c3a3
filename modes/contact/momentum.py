"""The generalised-momentum observer: torques of contact anywhere on an arm whose joint torques are measured.

De Luca and Mattone (ICRA 2005), the modern alternative to currents without a sign: r' = K (τ_contact - r), so
that r is the torque of the contact after a first-order lag of 1/K, without accelerations. It needs the
dynamics of the arm, with their friction: what the model lacks counts as contact.
"""

from __future__ import annotations

import numpy as np
import pinocchio
from numpy.typing import NDArray

from modes.settings import require_number
from robots.errors import SetupError

Array = NDArray[np.float64]


class MomentumObserver:
    """Follows the momentum p = M(q) q' of an arm.

    Parameters
    ----------
    model:
        Dynamics, one degree of freedom per joint.
    gain:
        K: 1/K is how long a torque takes to show [1/s].
    period_s:
        Between two samples [s].

    Raises
    ------
    SetupError
        K times the period is not below 1, or the model has joints of several degrees of freedom.
    """

    def __init__(self, model: pinocchio.Model, gain: float = 50.0, period_s: float = 0.001) -> None:
        require_number("momentum observer: period_s", period_s, 1e-6, 1.0)
        require_number("momentum observer: gain", gain, 1e-3, 1.0 / period_s)
        if model.nq != model.nv:
            raise SetupError(
                f"momentum observer: {model.nq} positions of {model.nv} speeds: joints turn endlessly"
            )
        self._model, self._data = model, model.createData()
        self._gain, self._period = gain, period_s
        self._sum = np.zeros(model.nv)
        self._first: Array | None = None
        self._before: Array | None = None
        self.residual: Array = np.zeros(model.nv)

    def step(self, q: Array, dq: Array, torque: Array) -> Array:
        """Take positions, speeds and motor torques (n,) [rad, rad/s, N m] and return r (n,) [N m].

        The torque is taken to have been constant since the sample before; the change of momentum that motion
        and gravity cause is that in the middle between both samples.
        """
        pinocchio.crba(self._model, self._data, q)
        inertia = np.triu(self._data.M) + np.triu(self._data.M, 1).T  # crba fills the upper half
        momentum = inertia @ dq
        coriolis = np.array(pinocchio.computeCoriolisMatrix(self._model, self._data, q, dq))
        drift = coriolis.T @ dq - pinocchio.computeGeneralizedGravity(self._model, self._data, q)
        if self._first is None or self._before is None:
            self._first = momentum
        else:
            own = torque + 0.5 * (drift + self._before)
            self._sum += (own + self.residual) * self._period
            self.residual = self._gain * (momentum - self._first - self._sum)
        self._before = drift
        return self.residual.copy()
