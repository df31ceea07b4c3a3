"""What the links occupy while a plan runs: one sphere-swept volume per link and time slice.

Chord bound. A curve p on a slice of length h with ‖p̈‖ ≤ A stays within h²/8·A of the point that moves at
constant speed from p(t_i) to p(t_i+1) (each component of the difference vanishes at both ends and has second
derivative p̈; along the unit vector of the largest difference that is the interpolation error of a linear
interpolant). Every point of a link's axis is a fixed convex combination of the axis' end points, so the whole
axis stays within h²/8·A of the hull of its end points at t_i and t_i+1, and the link within that hull grown
by radius + h²/8·A.

Acceleration. Let joints 1 ... n carry the point, in the order of the chain, J_j = ∂p/∂q_j. For a revolute
joint J_j = z_j × (p - o_j), with ‖J_j‖ = distance from the axis ≤ ρ_j; for a prismatic joint J_j = z_j and
ρ_j = 1. Then

    p̈ = Σ_j J_j ddq_j + Σ_i Σ_j (∂J_j/∂q_i) dq_i dq_j.

J_j is a vector that is carried along by every joint i ≤ j that turns: for i < j, z_j, o_j and p all move
rigidly with joint i, and for i = j revolute z_j and o_j stay while p turns about the axis. So ∂J_j/∂q_i = z_i
× J_j if i ≤ j is revolute, and 0 if i ≤ j is prismatic, because a translation changes no vector. Second
derivatives are symmetric, which gives i > j. Therefore

    A = Σ_j ρ_j (ddq_j + dq_j² [j revolute] + 2 dq_j Σ_{i<j, i revolute} dq_i)

with the largest absolute values on the slice. A revolute joint before a prismatic one contributes the
Coriolis term 2 dq_i dq_j, a prismatic joint before a revolute one nothing. For revolute joints alone this is
Σ ρ_j ddq_j + Σ_i Σ_j dq_i dq_j ρ_max(i,j) of docs/method.md, section 3.

Tracking. The arm is at q + e with |e_j| ≤ q_error_j, up to Σ_j ρ_j e_j away: the mean value theorem along the
segment from q to q + e. Its velocity J(q + e)(dq + ė) differs from J(q) dq by Σ_j ρ_j ė_j *and* by (J(q + e)
- J(q)) dq, at most Σ_i Σ_j e_i dq_j ‖∂J_j/∂q_i‖, which the same rule bounds.

Speed. Each instant is within h/2 of a slice end, so ‖ṗ‖ ≤ max over both ends + A h/2 + the tracking terms. A
point of the link at distance ≤ r from the axis adds r‖ω‖, with ω = Σ z_j dq_j over the revolute joints, ‖ω̇‖
≤ Σ ddq_j + Σ_{i<j} dq_i dq_j and an error of Σ ė_j + Σ_{i<j} e_i dq_j.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from occupancy import kernels
from occupancy.sets import new_link_sets
from robots.enclosure import MAX_LINKS
from robots.errors import SetupError
from robots.kernels import forward
from robots.model import RobotModel
from robots.motion import MAX_JOINTS, MAX_SLICES, Block, new_slices

_FIXED: Final = np.dtype(
    [("chain", np.int8, (MAX_LINKS, MAX_JOINTS)), ("stroke", np.float64, (MAX_JOINTS, 2))]
)
_SCRATCH: Final = np.dtype(
    [
        ("rotation", np.float64, (MAX_JOINTS, 3, 3)),
        ("position", np.float64, (MAX_JOINTS, 3)),
        ("angular", np.float64, (MAX_JOINTS, 3)),
        ("linear", np.float64, (MAX_JOINTS, 3)),
        ("axis", np.float64, (MAX_SLICES + 1, MAX_LINKS, 2, 3)),
        ("speed", np.float64, (MAX_SLICES + 1, MAX_LINKS)),
        ("spin", np.float64, (MAX_SLICES + 1, MAX_LINKS)),
    ]
)


class SweepError(SetupError):
    """A robot model whose links cannot be swept."""


class LinkOccupancy:
    """Writes what the moving links, tool and payload of a robot occupy on each slice of a plan.

    Raises
    ------
    SweepError
        When there is no enclosure row, a joint comes before its parent, a row names no joint, has a radius or
        reach that is negative or not finite, or a prismatic joint that moves it has a reach below 1; or when
        compiled code is out of date.
    """

    def __init__(self, model: RobotModel) -> None:
        self.model = model
        self._fixed = chains_and_strokes(model)
        self._scratch = np.zeros(1, dtype=_SCRATCH)
        self._check_compiled_code()

    def occupy(self, slices: Block, out: Block) -> None:
        """Replace ``out`` (LINK_SETS) by one row per slice and enclosure row; never raises.

        A row holds over its whole slice, for every point of the link, while the arm is within ``q_error`` of
        what the slices command; ``speed_max`` while it is within ``dq_error`` as well. Where the slices make
        no sense (NaN, time running backwards, negative bounds, another number of joints) rows have no points.
        """
        model = self.model
        kernels.sweep(model.kinematics, model.enclosure, self._fixed, slices, out, self._scratch)

    @property
    def chain(self) -> NDArray[np.int8]:
        """Which joints carry each enclosure row: (L, J), not to be written to."""
        rows: NDArray[np.int8] = self._fixed["chain"][0]
        return rows

    def _check_compiled_code(self) -> None:
        """Compare one pose: a cached kernel does not notice when the kinematics in another file changes."""
        slices, out = new_slices(), new_link_sets()
        plan, tree, capsules = slices[0], self.model.kinematics[0], self.model.enclosure[0]
        plan["n"], plan["n_joints"] = 1, tree["n"]
        plan["q"][:] = 0.5 + 0.3 * np.arange(MAX_JOINTS)
        self.occupy(slices, out)
        rotation, position = np.zeros((MAX_JOINTS, 3, 3)), np.zeros((MAX_JOINTS, 3))
        forward(self.model.kinematics, plan["q"][0], rotation, position)
        for link in range(int(capsules["n"])):
            joint = capsules["joint"][link]
            expected = rotation[joint] @ capsules["a"][link] + position[joint]
            if out[0]["n_points"][link] == 0:
                raise SweepError(f"link {self.model.links[link]}: its capsule is too large to be used")
            if not np.allclose(out[0]["points"][link, 0], expected, rtol=0.0, atol=1e-9):
                raise SweepError(
                    "compiled code of occupancy does not match robots/kernels.py: delete __pycache__"
                )


def chains_and_strokes(model: RobotModel) -> Block:
    """Return which joints move which link (``chain``), and the strokes for which reaches hold (``stroke``).

    Raises
    ------
    SweepError
        As :class:`LinkOccupancy`.
    """
    tree, capsules = model.kinematics[0], model.enclosure[0]
    fixed = np.zeros(1, dtype=_FIXED)
    n = int(tree["n"])
    for joint in range(n):
        if not -1 <= tree["parent"][joint] < joint:
            raise SweepError(f"joint {model.joints[joint]} must come after its parent in the block")
    fixed[0]["stroke"][:n] = np.column_stack([model.limits.position_lower, model.limits.position_upper])
    if not capsules["n"] > 0:
        raise SweepError("a robot needs at least one capsule on a moving link")
    for link in range(int(capsules["n"])):
        ends = np.array([capsules["a"][link], capsules["b"][link]])
        if not (0.0 <= capsules["radius"][link] < np.inf and np.isfinite(ends).all()):
            raise SweepError(
                f"link {model.links[link]}: radius {capsules['radius'][link]} m must be finite and not "
                "negative, and the axis end points finite"
            )
        joint = int(capsules["joint"][link])
        if not 0 <= joint < n:
            raise SweepError(f"link {model.links[link]} hangs on joint {joint}, but there are {n} joints")
        while joint >= 0:
            least = 1.0 if tree["prismatic"][joint] else 0.0
            if not least <= capsules["reach"][link, joint] < np.inf:
                raise SweepError(
                    f"link {model.links[link]}: reach from joint {model.joints[joint]} must be finite and "
                    f"at least {least}, not {capsules['reach'][link, joint]}"
                )
            fixed[0]["chain"][link, joint] = 1
            joint = int(tree["parent"][joint])
    return fixed
