"""Where somebody will be in 0.1 … 1.0 s: networks of the package, and forecasts of all points of a person.

A forecast shapes plans, and shows nothing: the verifier judges what may happen, and knows no forecast.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.baselines import ConstantVelocity, DampedVelocity, Hold
from modes.forecasting.dataset import (
    AHEAD,
    FEATURES,
    SEEN,
    back_in_world,
    canonical,
    features,
    joints_of_features,
    seen_from,
)
from modes.forecasting.occlusion import Carry, Filler, carried, require_history
from modes.forecasting.skeleton import JOINTS, ROOT, bones_of, joints_of_points, points_of_joints
from modes.forecasting.weights_file import WEIGHTS, Network, load_network
from modes.settings import require_choice
from occupancy.body import MAX_POINTS
from robots.errors import SetupError

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

NETWORKS = ("bilstm", "dct_mlp")
DEFAULT = "dct_mlp"
"""The least error in 0.5 s and in 1 s among people who were not trained on (docs/forecasting.md)."""


class Forecaster(Protocol):
    """Says where joints will be."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    def forecast(self, history: Array) -> Array:
        """Return joints ``(10, 15, 3)`` [m] in 0.1, 0.2 … 1.0 s.

        ``history``: ``(30, 15, 3)`` [m] at 10 Hz, newest last. It is finite; the answer need
        not be (:func:`forecast_points`).

        Raises
        ------
        SetupError
            It is another skeleton, or another number of frames.
        """
        ...


class NetworkForecaster:
    """A network that says how bones turn and where the root goes; lengths of bones are kept.

    Parameters
    ----------
    name:
        What it is called.
    network:
        From features ``(n, 30, 45)`` to those ahead ``(n, 10, 45)``
        (:func:`modes.forecasting.dataset.features`).

    Raises
    ------
    SetupError
        The weights are of another shape.
    """

    def __init__(self, name: str, network: Network) -> None:
        network.require_shapes((SEEN, FEATURES), (AHEAD, FEATURES))
        self.name, self._network = name, network

    def forecast(self, history: Array) -> Array:
        """Return joints ``(10, 15, 3)`` [m] of ``(30, 15, 3)`` [m]; not finite where the network is not.

        Raises
        ------
        SetupError
            It is another skeleton, or another number of frames.
        """
        require_history(history)
        if len(history) != SEEN:
            raise SetupError(f"{self.name}: history of {len(history)} frames should be {SEEN}, 3 s at 10 Hz")
        origin, turn = canonical(history)
        looked = seen_from(history, origin, turn)
        _, length = bones_of(looked[-1])
        found = self._network.run(features(looked)[None])[0]
        return back_in_world(joints_of_features(found, looked[-1, ROOT], length), origin, turn)


def load_forecaster(name: str = DEFAULT, folder: Path = WEIGHTS) -> Forecaster:
    """Return a forecaster by its name; networks are read from ``folder``, the package's own.

    Raises
    ------
    SetupError
        There is none of that name, onnxruntime is missing, or the weights are of another shape or skeleton.
    """
    require_choice("forecaster", name, FORECASTERS)
    if name in NETWORKS:
        return NetworkForecaster(name, load_network(name, (SEEN, FEATURES), (AHEAD, FEATURES), folder))
    return _PLAIN[name]()


_PLAIN: dict[str, Callable[[], Forecaster]] = {
    "hold": Hold,
    "constant_velocity": ConstantVelocity,
    "damped_velocity": DampedVelocity,
}
FORECASTERS = (*_PLAIN, *NETWORKS)


class Outcome(Enum):
    """What became of a forecast."""

    FORECAST = "forecast"
    HELD = "the forecaster's answer was not finite: everything is held where it is"
    NO_TRUNK = "the trunk was not seen for 3 s: no forecast"


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """Where somebody is, and will be.

    Attributes
    ----------
    outcome:
        Whether it is the forecaster's.
    now:
        ``(20, 3)`` points [m] as they are, those that were not seen just now filled in; NaN: never seen.
    points:
        ``(10, 20, 3)`` [m] in 0.1 … 1.0 s; NaN: never seen, or no forecast.
    inferred:
        ``(15,)``: joints that were not seen in the last frame.
    filled_by:
        The filler; empty: there is no forecast.
    """

    outcome: Outcome
    now: Array
    points: Array
    inferred: Bools
    filled_by: str


def forecast_points(history: Array, forecaster: Forecaster, filler: Filler | None = None) -> Forecast:
    """Return where the points of a person will be, of ``history (30, 20, 3)`` [m] at 10 Hz, newest last.

    Joints that were not seen are filled in, by ``filler`` (None: carried along with the others); those that
    were never seen are stood in for, and their points stay NaN. Raises nothing for arrays of that shape.
    """
    with np.errstate(invalid="ignore"):
        seen = joints_of_points(history)
    unseen = ~np.asarray(np.isfinite(seen).all(axis=2))
    now = carried(history)[-1]
    nothing = Forecast(Outcome.NO_TRUNK, now, np.full((AHEAD, MAX_POINTS, 3), np.nan), unseen[-1], "")
    if unseen[:, ROOT].all():
        return nothing
    filled = (filler or Carry()).fill(seen)
    if not np.isfinite(filled.joints).all():
        return nothing
    last, known = filled.joints[-1], joints_of_points(now)
    now = points_of_joints(last[None], now, np.where(np.isfinite(known), known, last))[0]
    ahead, outcome = forecaster.forecast(filled.joints), Outcome.FORECAST
    if ahead.shape != (AHEAD, JOINTS, 3) or not np.isfinite(ahead).all():
        ahead, outcome = Hold().forecast(filled.joints), Outcome.HELD
    return Forecast(outcome, now, points_of_joints(ahead, now, last), unseen[-1], filled.by)
