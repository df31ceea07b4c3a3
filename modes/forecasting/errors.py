"""How far forecasts are from what people did, and filled joints from where they were."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.dataset import AHEAD, RATE_HZ, Windows
from modes.forecasting.network import Forecaster
from modes.forecasting.occlusion import Carry, Filler
from modes.forecasting.skeleton import JOINTS

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

HORIZONS_S = (0.1, 0.2, 0.5, 1.0)


@dataclass(frozen=True, slots=True)
class Errors:
    """Distances of joints from where they were [m].

    Attributes
    ----------
    mean, p95, worst:
        Of the joints of all windows.
    """

    mean: float
    p95: float
    worst: float

    @staticmethod
    def of(distances: Array) -> Errors:
        """Return those of distances [m]; NaN where a joint was not recorded, NaN if none was."""
        known = distances[np.isfinite(distances)]
        if len(known) == 0:
            return Errors(np.nan, np.nan, np.nan)
        return Errors(float(known.mean()), float(np.percentile(known, 95.0)), float(known.max()))


def distances_ahead(forecaster: Forecaster, windows: Windows) -> Array:
    """Return how far joints are from their forecasts ``(windows, 10, 15)`` [m]; NaN: not recorded.

    Joints that a recording lacks are stood in for (``Carry`` of the occlusion), and not judged.
    """
    out, filler = np.full((len(windows), AHEAD, JOINTS), np.nan), Carry()
    for k in range(len(windows)):
        found = forecaster.forecast(filler.fill(windows.history[k]).joints)
        out[k] = np.linalg.norm(found - windows.future[k], axis=2)
    return out


def errors_by_horizon(
    forecaster: Forecaster, windows: Windows, horizons_s: tuple[float, ...] = HORIZONS_S
) -> dict[float, Errors]:
    """Return the errors of forecasts of each of ``horizons_s`` [s], multiples of 0.1."""
    far = distances_ahead(forecaster, windows)
    return {each: Errors.of(far[:, round(each * RATE_HZ) - 1]) for each in horizons_s}


def gaps(frames: int, rng: np.random.Generator) -> Bools:
    """Return which joints are hidden ``(frames, 15)``, somewhat as people and things hide them.

    A limb, a side or some joints from some frame on, to the end half of the time; made up.
    """
    hidden = np.zeros((frames, JOINTS), dtype=bool)
    for _ in range(int(rng.integers(1, 3))):
        length = int(rng.integers(2, 2 * frames // 3))
        begin = frames - length if rng.random() < 0.5 else int(rng.integers(0, frames - length))
        kind = rng.random()
        if kind < 0.7:
            chosen = list(_LIMBS[int(rng.integers(len(_LIMBS)))])
        else:
            chosen = list(rng.choice(JOINTS, int(rng.integers(1, 5)), replace=False))
        hidden[begin : begin + length, chosen] = True
    return hidden


_LIMBS: tuple[tuple[int, ...], ...] = (
    (4, 6), (5, 7), (2, 4, 6), (3, 5, 7), (11, 13), (12, 14), (9, 10, 11, 12, 13, 14), (13, 14),
    (2, 4, 6, 9, 11, 13), (3, 5, 7, 10, 12, 14), (6,), (7,), (6, 7),
)  # fmt: skip
"""Rows of joints that are hidden together: forearms, arms, legs, both of them, sides, wrists."""


def errors_of_filling(filler: Filler, windows: Windows, hidden: Bools) -> tuple[Errors, Errors]:
    """Return the errors of joints that were ``hidden (windows, 30, 15)``: in all frames, and in the last."""
    far = np.full(hidden.shape, np.nan)
    for k in range(len(windows)):
        shown = np.where(hidden[k, ..., None], np.nan, windows.history[k])
        found = np.linalg.norm(filler.fill(shown).joints - windows.history[k], axis=2)
        far[k] = np.where(hidden[k], found, np.nan)
    return Errors.of(far), Errors.of(far[:, -1])
