"""The slice block: what a piece of motion is, for every reader.

``failsafe`` writes it; ``occupancy`` and the criteria read it. A plan is cut into at most
``MAX_SLICES`` time slices ``[t_i, t_i+1]``; on each, the joint positions and velocities at both
ends and bounds on velocity and acceleration over the whole slice are known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MAX_JOINTS = 16
MAX_SLICES = 64

Block = NDArray[np.void]
"""A structured array of length 1, allocated once; field ``n`` counts the rows in use."""

SLICES = np.dtype(
    [
        ("n", np.int64),
        ("n_joints", np.int64),
        ("delay", np.float64, (2,)),
        ("t", np.float64, (MAX_SLICES + 1,)),
        ("q", np.float64, (MAX_SLICES + 1, MAX_JOINTS)),
        ("dq", np.float64, (MAX_SLICES + 1, MAX_JOINTS)),
        ("ddq", np.float64, (MAX_SLICES + 1, MAX_JOINTS)),
        ("dq_max", np.float64, (MAX_SLICES, MAX_JOINTS)),
        ("ddq_max", np.float64, (MAX_SLICES, MAX_JOINTS)),
        ("q_error", np.float64, (MAX_JOINTS,)),
        ("dq_error", np.float64, (MAX_JOINTS,)),
        ("q_spread", np.float64, (MAX_SLICES, MAX_JOINTS)),
        ("dq_spread", np.float64, (MAX_SLICES, MAX_JOINTS)),
    ]
)
"""``t`` [s] on the cell's clock, the instants at which the plan *commands* the state; the robot is there
between ``delay[0]`` and ``delay[1]`` later, so people are to be considered on
``[t_i + delay[0], t_i+1 + delay[1]]``. ``q, dq, ddq`` [rad, rad/s, rad/s²; m for prismatic joints] at the
slice ends; ``dq_max, ddq_max`` bound the absolute values over the whole slice; ``q_error, dq_error`` bound
the tracking error. ``q_spread, dq_spread`` bound how far from what is commanded other motions are that the
slice stands for as well (:mod:`failsafe.silence`); 0 where there are none."""


def new_slices() -> Block:
    """Return an empty slice block."""
    return np.zeros(1, dtype=SLICES)
