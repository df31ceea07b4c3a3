"""Routes of the paper's two experiments (section V), with hands that are made up.

What the camera saw is a picture in the paper and no data. The hands here come into sight when the paper's do,
at samples 42 and 87, are in the robot's way when those are, at 151 and 105, and leave. The paper's numbers at
these samples are therefore no pass marks: that the robot collides without the method, and not with it, is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modes.speed.simulations import Scene

Array = NDArray[np.float64]

_UP = 0.4049
_DOWN = 0.105
_GRAB_SAMPLES = 5
"""From sample 32 to 36 the gripper closes."""


def experiment(number: int) -> Scene:
    """Return experiment 1, to and fro on a line, or 2, picking and placing."""
    return _to_and_fro() if number == 1 else _pick_and_place()


def _through(samples: int, stations: tuple[tuple[int, tuple[float, float, float]], ...]) -> Array:
    """Return a hand ``(samples, 1, 3)``, at places at samples, straight between; unseen before and after."""
    k = np.arange(1, samples + 1)
    at = np.array([sample for sample, _ in stations])
    places = np.array([place for _, place in stations])
    hand = np.column_stack([np.interp(k, at, places[:, axis]) for axis in range(3)])
    hand[(k < at[0]) | (k > at[-1])] = np.nan
    return hand[:, None]


def _to_and_fro() -> Scene:
    """100 to -100 mm and back at 50 mm/s, three times: 40 samples a line."""
    ends = np.array([[0.368, 0.1, 0.6685], [0.368, -0.1, 0.6685]])
    hand = _through(
        330,
        (
            (42, (1.40, 0.30, 0.50)), (100, (0.80, 0.20, 0.60)), (135, (0.50, 0.08, 0.73)),
            (146, (0.440, 0.07, 0.73)), (165, (0.440, 0.07, 0.73)), (185, (0.70, 0.15, 0.65)),
            (260, (1.40, 0.30, 0.50)),
        ),
    )  # fmt: skip
    return Scene("experiment 1", ends[[0, 1, 0, 1, 0, 1, 0]], -0.05, hand)


def _pick_and_place() -> Scene:
    """Down to the object, up, across to the basket, down and up, at 100 mm/s."""
    here, there = (0.5945, -0.266), (0.5945, 0.174)
    corners = np.array([
        (*here, _UP), (*here, _DOWN), (*here, _UP), (*there, _UP), (*there, _DOWN), (*there, _UP),
    ])  # fmt: skip
    hand = _through(
        260,
        (
            (87, (1.30, 0.50, 0.60)), (98, (0.80, 0.20, 0.50)), (104, (0.675, 0.15, 0.48)),
            (112, (0.675, 0.15, 0.48)), (125, (0.80, 0.25, 0.50)), (150, (1.30, 0.50, 0.60)),
        ),
    )  # fmt: skip
    return Scene("experiment 2", corners, 0.1, hand, {1: _GRAB_SAMPLES})
