"""The arm against itself: pairs of capsules at the same instant.

Of two capsules only their motion *relative to each other* counts, and that is made by the joints between
them alone: joints below both, and tracking errors of those, move both as one body. Between two instants the
distance of two axes changes by no more than relative speed x time, hence from certified gaps g at both ends
of a slice of length h, with v >= |relative speed| on the slice and d >= |relative displacement by tracking|,

    gap >= (g_i + g_i+1 - v h) / 2 - d  with  v = Σ_j ρ_j dq_max,j  and  d = Σ_j ρ_j e_j  over joints between.

Both links follow with the same delay, so delays do not enter. (docs/method.md, section 5.)
"""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import combinations, product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from occupancy import workspace_kernels as kernels
from occupancy.kernels import segment_parameters
from occupancy.separation import new_scratch
from occupancy.swept import chains_and_strokes
from occupancy.workspace import Blocked, WorkspaceError, blocked, new_blocked
from robots.enclosure import MAX_LINKS
from robots.kernels import forward
from robots.model import RobotModel
from robots.motion import MAX_JOINTS, Block

Array = NDArray[np.float64]

MAX_PAIRS: Final = MAX_LINKS * (MAX_LINKS - 1) // 2
_PAIRS: Final = np.dtype(
    [
        ("n", np.int64),
        ("a", np.int32, (MAX_PAIRS,)),
        ("b", np.int32, (MAX_PAIRS,)),
        ("apart_a", np.uint8, (MAX_PAIRS, MAX_JOINTS)),
        ("apart_b", np.uint8, (MAX_PAIRS, MAX_JOINTS)),
    ]
)
"""``n`` pairs of enclosure rows, and the joints that move the one (``apart_a``) or the other but not both."""

_COARSE: Final = 16.0
"""Steps per joint of the grid that is looked at first."""
_MOST_POSTURES: Final = 40_000


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A pair that is not compared, and why: ``rigid``, ``adjacent``, ``never_apart`` or ``may_touch``."""

    a: str
    b: str
    why: str


WHY: Final = {
    "rigid": "moved by the same joint",
    "adjacent": "joined by one joint",
    "never_apart": "their capsules overlap in every posture",
    "may_touch": "declared",
}
"""Reason for which a pair is left out -> words."""


class SelfCollision:
    """Checks the moving links, tool and payload of a robot against each other.

    Pairs on one joint and on joints of which one carries the other are left out, and so are those whose
    capsules are *proven* to overlap in every posture: nothing could ever be shown about them.

    Parameters
    ----------
    model:
        The robot.
    may_touch:
        Pairs of links that the user leaves out.
    margin:
        A pair counts as apart when its certified gap exceeds this [m].

    Raises
    ------
    WorkspaceError
        A pair names a link that is not there, or the margin is no length.
    """

    def __init__(self, model: RobotModel, may_touch: Collection[tuple[str, str]], margin: float) -> None:
        if not 0.0 <= margin < np.inf:
            raise WorkspaceError(f"the margin must be finite and not negative, not {margin} m")
        self._model = model
        self._margin = float(margin)
        self._fixed = chains_and_strokes(model)
        self._pairs: Block = np.zeros(1, dtype=_PAIRS)
        self._scratch = new_scratch()
        self._nearest = new_blocked()
        named = {frozenset(pair) for pair in _known(may_touch, model.links)}
        self.left_out: tuple[LeftOut, ...] = tuple(self._choose(named))

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Names of the links of every pair that is compared."""
        rows, links = self._pairs[0], self._model.links
        return tuple((links[int(rows["a"][k])], links[int(rows["b"][k])]) for k in range(int(rows["n"])))

    def of_link(self, link: str, margin: float) -> SelfCollision:
        """Return the same check of the pairs of one link alone, with another margin [m]."""
        other = copy.copy(self)
        other._margin = float(margin)
        other._pairs, other._nearest = np.zeros(1, dtype=_PAIRS), new_blocked()
        rows, chosen = self._pairs[0], other._pairs[0]
        for k, pair in enumerate(self.pairs):
            if link in pair:
                for name in ("a", "b", "apart_a", "apart_b"):
                    chosen[name][chosen["n"]] = rows[name][k]
                chosen["n"] += 1
        return other

    def check(self, links: Block, slices: Block, active: NDArray[np.uint8]) -> Blocked | None:
        """Return what keeps a pair from being proven apart on every slice, if any.

        ``active`` (L,): links that move; pairs of which neither does are passed over. Never raises; NaN
        proves nothing.
        """
        model = self._model
        proven = kernels.check_pairs(
            links,
            slices,
            model.kinematics,
            model.enclosure,
            self._fixed,
            self._pairs,
            active,
            self._margin,
            self._scratch,
            self._nearest,
        )
        return None if proven else blocked(self._nearest, model.links)

    def _choose(self, named: Collection[frozenset[str]]) -> Iterator[LeftOut]:
        """Write the pairs that are compared; yield the others."""
        model, rows = self._model, self._pairs[0]
        joint, parent = model.enclosure["joint"][0], model.kinematics["parent"][0]
        chain = self._fixed["chain"][0]
        for a, b in combinations(range(len(model.links)), 2):
            link_a, link_b = model.links[a], model.links[b]
            if joint[a] == joint[b]:
                yield LeftOut(link_a, link_b, "rigid")
            elif parent[joint[b]] == joint[a] or parent[joint[a]] == joint[b]:
                yield LeftOut(link_a, link_b, "adjacent")
            elif frozenset((link_a, link_b)) in named:
                yield LeftOut(link_a, link_b, "may_touch")
            elif never_apart(model, chain, a, b):
                yield LeftOut(link_a, link_b, "never_apart")
            else:
                k = int(rows["n"])
                rows["n"], rows["a"][k], rows["b"][k] = k + 1, a, b
                rows["apart_a"][k] = chain[a] & ~chain[b] & 1
                rows["apart_b"][k] = chain[b] & ~chain[a] & 1


def _known(may_touch: Collection[tuple[str, str]], links: tuple[str, ...]) -> Collection[tuple[str, str]]:
    for pair in may_touch:
        for link in pair:
            if link not in links:
                raise WorkspaceError(
                    f"link {link} of {' and '.join(pair)}: is not known; there are: {', '.join(links)}"
                )
        if pair[0] == pair[1]:
            raise WorkspaceError(f"{pair[0]} is one link, not a pair")
    return may_touch


def never_apart(model: RobotModel, chain: NDArray[np.int8], a: int, b: int) -> bool:
    """Whether the capsules of enclosure rows a and b are proven to overlap in every posture.

    Only joints between the two matter. With postures on a grid with steps w_j, no posture is farther than
    w_j / 2 from the nearest one in any joint, and the distance of the axes changes by no more than half of
    Σ ρ_j w_j in between; distances are attained, so never too small. False where three joints or more are
    between, or one of them slides.
    """
    capsules, tree = model.enclosure[0], model.kinematics[0]
    between = np.flatnonzero(chain[a] != chain[b])
    if len(between) > 2 or tree["prismatic"][between].any():
        return False
    low, high = model.limits.position_lower[between], model.limits.position_upper[between]
    endless = ~(high - low < 2.0 * np.pi)
    low, high = np.where(endless, -np.pi, low), np.where(endless, np.pi, high)
    distance = _AxisDistance(model, between, a, b)
    radii = float(capsules["radius"][a] + capsules["radius"][b])
    rho = np.where(chain[a] > chain[b], capsules["reach"][a], capsules["reach"][b])[between]

    def largest(steps: NDArray[np.float64]) -> float:
        """Largest gap [m] on a grid of postures, or the first one that is not below 0."""
        grids = [
            start + (end - start) * (np.arange(n) + 0.5) / n
            for start, end, n in zip(low, high, steps, strict=True)
        ]
        found = -math.inf
        for q in product(*grids):
            gap = distance(np.array(q)) - radii
            if not gap < 0.0:
                return gap
            found = max(found, gap)
        return found

    coarse = largest(np.full(len(between), _COARSE))
    if not coarse < 0.0:
        return False
    steps = np.ceil((high - low) * rho * len(between) / -coarse) + 1.0
    if not np.prod(steps) <= _MOST_POSTURES:
        return False
    return bool(largest(steps) + float(rho @ ((high - low) / steps)) / 2.0 < 0.0)


class _AxisDistance:
    """Attained distance [m] of two capsules' axes at positions of the joints between them."""

    def __init__(self, model: RobotModel, between: NDArray[np.int64], a: int, b: int) -> None:
        self._model, self._between, self._rows = model, between, (a, b)
        self._q = np.zeros(MAX_JOINTS)
        self._rotation, self._position = np.zeros((MAX_JOINTS, 3, 3)), np.zeros((MAX_JOINTS, 3))

    def __call__(self, values: Array) -> float:
        capsules = self._model.enclosure[0]
        self._q[self._between] = values
        forward(self._model.kinematics, self._q, self._rotation, self._position)
        ends = []
        for row in self._rows:
            joint = capsules["joint"][row]
            local = np.array([capsules["a"][row], capsules["b"][row]])
            ends.append(local @ self._rotation[joint].T + self._position[joint])
        s, t = segment_parameters(*ends[0], *ends[1])
        first, second = (axis[0] + u * (axis[1] - axis[0]) for axis, u in zip(ends, (s, t), strict=True))
        return float(np.linalg.norm(second - first))
