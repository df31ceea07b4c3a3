"""The intended trajectory: a piecewise polynomial per joint on the path parameter; its fit to samples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline
from scipy.linalg import LinAlgError, solveh_banded

from failsafe.trajectory_kernels import accumulate_normal_equations
from robots.errors import SetupError

Array = NDArray[np.float64]
End = Literal["cut", "rest"]

DEGREE = 5
"""Coefficients are stored up to this power."""
LATEST_S = 1e6
"""Times beyond this are refused: a double would resolve them coarser than 1e-10 s."""
_CONTINUITY = 1e-9
"""Relative difference of q, q', q'' between neighbouring polynomials that counts as rounding."""
_MOST_JUMPED = 1e-6
"""All such differences of q together [rad or m]: velocities are bounded piece by piece, so that what is moved
between pieces is seen by no bound."""


class TrajectoryError(SetupError):
    """A trajectory, samples or fit settings that cannot be used; one line that names value and rule.

    ``joint``: number of the joint concerned, -1: none or several.
    """

    def __init__(self, text: str, joint: int = -1) -> None:
        super().__init__(text)
        self.joint = joint


_FACTORS = [[float(math.perm(k, d)) for k in range(d, DEGREE + 1)] for d in range(4)]
"""Of the d-th derivative of x^k, for k = d and up."""


def _derivative_rows(x: Array) -> Array:
    """Return factors ``(..., 4, 6)`` that turn coefficients into q, q', q'', q''' at the offsets ``x``."""
    rows = np.zeros((*np.shape(x), 4, DEGREE + 1))
    powers = [x**k for k in range(DEGREE + 1)]
    for d in range(4):
        for k in range(d, DEGREE + 1):
            rows[..., d, k] = _FACTORS[d][k - d] * powers[k - d]
    return rows


class IntendedTrajectory:
    """What the planner wants: q_d(s), a C2 piecewise polynomial of degree <= 5 per joint.

    Parameters
    ----------
    breaks:
        ``(M+1,)`` strictly increasing values of the path parameter s [s].
    coefficients:
        ``(M, k<=6, J)``: powers of ``s - breaks[m]``, lowest first [rad/s^p; m/s^p for prismatic joints].
    end:
        ``"rest"``: the motion ends at rest and is constant beyond the last break; ``"cut"``: nothing is known
        beyond it, and no plan may run past it.

    Raises
    ------
    TrajectoryError
        Wrong shapes, values that are not finite, breaks not increasing, q, q' or q'' not continuous (q also
        in sum over all breaks), or
        ``end="rest"`` with q' or q'' different from 0 at the end.
    """

    def __init__(self, breaks: ArrayLike, coefficients: ArrayLike, end: End = "cut") -> None:
        b = np.array(breaks, dtype=np.float64)
        c = np.array(coefficients, dtype=np.float64)
        _check_shapes(b, c)
        if end not in ("cut", "rest"):
            raise TrajectoryError(f"end of a trajectory is {end!r}, should be 'cut' or 'rest'")
        c = np.concatenate([c, np.zeros((c.shape[0], DEGREE + 1 - c.shape[1], c.shape[2]))], axis=1)
        at_end = np.einsum("mdk,mkj->mdj", _derivative_rows(np.diff(b)), c)
        allowed = _CONTINUITY * (1.0 + np.einsum("mdk,mkj->mdj", _derivative_rows(np.diff(b)), np.abs(c)))
        _check_continuity(b, c, at_end, allowed)
        self.end: End = end
        if end == "rest":
            _check_rest(b, at_end[-1], allowed[-1])
            beyond = np.zeros((1, *c.shape[1:]))
            beyond[0, 0] = at_end[-1, 0]
            b, c = np.append(b, np.inf), np.concatenate([c, beyond])
        self.kernel_breaks: Array = np.ascontiguousarray(b)
        self.kernel_coefficients: Array = np.ascontiguousarray(c)
        self.spans = b.shape[0] - (2 if end == "rest" else 1)
        self.n_joints: int = c.shape[2]
        self.s_begin = float(b[0])
        self.s_end = float(b[self.spans])
        self.s_max = np.inf if end == "rest" else self.s_end
        """Largest path parameter for which q is known."""
        self._fix()

    def _fix(self) -> None:
        self.kernel_breaks.setflags(write=False)
        self.kernel_coefficients.setflags(write=False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Fix the arrays of a copy too: for arrays that can be written, kernels would be compiled again."""
        self.__dict__.update(state)
        self._fix()

    @property
    def breaks(self) -> Array:
        """Return the breaks ``(M+1,)`` [s]."""
        return self.kernel_breaks[: self.spans + 1]

    @property
    def coefficients(self) -> Array:
        """Return the coefficients ``(M, 6, J)``, lowest power first."""
        return self.kernel_coefficients[: self.spans]

    def stretched(self, factor: float) -> IntendedTrajectory:
        """Return the same path, each piece taking ``factor`` times as long: slower for factors above 1.

        Raises
        ------
        TrajectoryError
            The factor is not positive and finite, or the path parameter would become too large.
        """
        if not 0.0 < factor < np.inf:
            raise TrajectoryError(f"factor {factor} of a slower trajectory should be positive and finite")
        powers = factor ** -np.arange(DEGREE + 1.0)
        breaks = self.s_begin + factor * (self.breaks - self.s_begin)
        return IntendedTrajectory(breaks, self.coefficients * powers[:, None], self.end)

    def backwards(self) -> IntendedTrajectory:
        """Return the same path in the other direction: at the path parameter -s it is where this one is at s.

        Where this one does not begin at rest, its end is cut.
        """
        length = np.diff(self.breaks)
        rows = _derivative_rows(length)
        powers = np.einsum("mdk,mkj->mdj", rows, self.coefficients)
        turned = np.zeros_like(self.coefficients)
        for d in range(4):
            turned[:, d] = powers[:, d] * (-1.0) ** d / (1.0, 1.0, 2.0, 6.0)[d]
        c4, c5 = self.coefficients[:, 4], self.coefficients[:, 5]
        turned[:, 4], turned[:, 5] = c4 + 5.0 * length[:, None] * c5, -c5
        still = np.abs(self.coefficients[0, 1:3]) <= _CONTINUITY
        return IntendedTrajectory(-self.breaks[::-1], turned[::-1], "rest" if still.all() else "cut")

    def since(self, s: float) -> IntendedTrajectory:
        """Return it without the pieces that end before ``s``."""
        first = int(np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, self.spans - 1))
        if first == 0:
            return self
        return IntendedTrajectory(self.breaks[first:], self.coefficients[first:], self.end)

    def lasting(self, s: float) -> IntendedTrajectory:
        """Return it with a break at ``s`` at the earliest as its end, at rest where it rests already.

        Raises
        ------
        TrajectoryError
            It is cut before ``s``.
        """
        if s <= self.s_end:
            return self
        if self.end != "rest":
            raise TrajectoryError(f"nothing is known of the trajectory at {s} s, it ends at {self.s_end:g} s")
        still = self.kernel_coefficients[-1:]
        return IntendedTrajectory(
            np.append(self.breaks, s), np.concatenate([self.coefficients, still]), "rest"
        )

    def sample(self, s: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """Return q, q', q'', q''' at ``s (...)``, each ``(..., J)``; NaN where q is not known."""
        at = np.asarray(s, dtype=np.float64)
        known = (at >= self.s_begin) & (at <= self.s_max)
        inside = np.where(known, at, self.s_begin)
        b = self.kernel_breaks
        m = np.clip(np.searchsorted(b, inside, side="right") - 1, 0, b.shape[0] - 2)
        values = np.einsum("...dk,...kj->...dj", _derivative_rows(inside - b[m]), self.kernel_coefficients[m])
        values[~known] = np.nan
        return values[..., 0, :], values[..., 1, :], values[..., 2, :], values[..., 3, :]


def _check_shapes(b: Array, c: Array) -> None:
    if b.ndim != 1 or b.shape[0] < 2:
        raise TrajectoryError(f"breaks of a trajectory have shape {b.shape}, should be (M+1,) with M >= 1")
    if c.ndim != 3 or c.shape[0] != b.shape[0] - 1 or not 1 <= c.shape[1] <= DEGREE + 1 or c.shape[2] < 1:
        raise TrajectoryError(
            f"coefficients of a trajectory have shape {c.shape},"
            f" should be ({b.shape[0] - 1}, 1..{DEGREE + 1}, J)"
        )
    if not np.isfinite(b).all() or not np.isfinite(c).all():
        raise TrajectoryError("breaks and coefficients of a trajectory should be finite")
    if not np.abs(b).max() <= LATEST_S:
        raise TrajectoryError(
            f"path parameter {np.abs(b).max():g} s is above {LATEST_S:g} s; count from a near epoch"
        )
    if not (np.diff(b) > 0.0).all():
        i = int(np.argmin(np.diff(b) > 0.0))
        raise TrajectoryError(
            f"breaks of a trajectory should increase, but {b[i]:g} s is followed by {b[i + 1]:g} s"
        )


def _check_continuity(b: Array, c: Array, at_end: Array, allowed: Array) -> None:
    begin = np.stack([c[1:, 0], c[1:, 1], 2.0 * c[1:, 2]], axis=1)
    jump = np.abs(at_end[:-1, :3] - begin)
    bad = ~(jump <= allowed[:-1, :3])
    if bad.any():
        m, d, j = (int(i) for i in np.argwhere(bad)[0])
        raise TrajectoryError(
            f"{'q' + chr(39) * d} of joint {j} jumps by {jump[m, d, j]:.3g} at s = {b[m + 1]:g} s,"
            " an intended trajectory should be twice continuously differentiable",
            int(j),
        )
    relative = (jump[:, 1:] * (_CONTINUITY / allowed[:-1, 1:3])).sum(axis=0)
    if relative.size and not relative.max() <= _MOST_JUMPED:
        d, j = (int(i) for i in np.unravel_index(int(np.argmax(relative)), relative.shape))
        raise TrajectoryError(
            f"{'q' + chr(39) * (d + 1)} of joint {j} jumps by {jump[:, d + 1, j].sum():.3g} in all between"
            f" {len(b) - 1} pieces: that is more than rounding",
            j,
        )
    moved = jump[:, 0].sum(axis=0)
    if moved.size and not moved.max() <= _MOST_JUMPED:
        j = int(np.argmax(moved))
        raise TrajectoryError(
            f"q of joint {j} jumps by {moved[j]:.3g} in all between {len(b) - 1} pieces,"
            f" an intended trajectory should be continuous: at most {_MOST_JUMPED:g} of rounding",
            j,
        )


def _check_rest(b: Array, final: Array, allowed: Array) -> None:
    for d in (1, 2):
        bad = ~(np.abs(final[d]) <= allowed[d])
        if bad.any():
            j = int(np.argmax(bad))
            raise TrajectoryError(
                f"{'q' + chr(39) * d} of joint {j} is {final[d, j]:.3g} at the end s = {b[-1]:g} s,"
                " a trajectory that ends at rest should have 0 there"
            )


@dataclass(frozen=True, slots=True)
class FitSettings:
    """How samples become a spline.

    Attributes
    ----------
    knot_spacing_s:
        Distance of the knots [s] where samples are dense; wider where they are not.
    degree:
        3, 4 or 5. With 5 the jerk is continuous and piecewise quadratic.
    """

    knot_spacing_s: float = 0.05
    degree: int = 5

    def __post_init__(self) -> None:
        if not 0.0 < self.knot_spacing_s < np.inf:
            raise TrajectoryError(
                f"knot spacing {self.knot_spacing_s} s of a fit should be positive and finite"
            )
        if self.degree not in (3, 4, 5):
            raise TrajectoryError(f"degree {self.degree} of a fit should be 3, 4 or 5")


@dataclass(frozen=True, slots=True)
class Fit:
    """A spline through samples, and how far it is from them.

    Attributes
    ----------
    trajectory:
        The spline, cut at the first and last sample.
    residual:
        ``(J,)`` largest absolute difference to a sample [rad; m]. To be added to the tracking error.
    residual_rms:
        ``(J,)`` root of the mean squared difference [rad; m].
    residual_samples:
        ``(T, J)`` sample minus spline [rad; m].
    longest_gap_s:
        Longest time between two samples [s]; nothing is measured in between.
    """

    trajectory: IntendedTrajectory
    residual: Array
    residual_rms: Array
    residual_samples: Array
    longest_gap_s: float


_GRADING = 0.5
"""Neighbouring spans differ in length by this share of their distance: keeps the fit well conditioned."""
_GAP_IN_SPAN = 1.3
"""A span is at least this many times as long as any sample interval in it."""
_END_SPANS = 3
_CHUNK = 8192


def fit_breaks(t: Array, settings: FitSettings) -> Array:
    """Return breaks ``(M+1,)`` [s] for samples at ``t (T,)``: knot spacing, or wider around gaps.

    The wanted length h(x) is the smallest function above the knot spacing, 1.3 times each sample interval and
    each run of three of them that changes by no more than half the distance; the breaks divide ∫dx/h evenly.
    The first and the last three spans are merged ("not a knot"), or derivatives at the ends would be noise.
    """
    gap = np.maximum(_GAP_IN_SPAN * np.diff(t), settings.knot_spacing_s)
    gap[1:-1] = np.maximum(gap[1:-1], t[3:] - t[:-3])
    at_sample = np.maximum(np.append(gap, 0.0), np.append(0.0, gap))
    forward = np.maximum.accumulate(at_sample + _GRADING * t) - _GRADING * t
    backward = np.maximum.accumulate((at_sample - _GRADING * t)[::-1])[::-1] + _GRADING * t
    h = np.maximum(forward, backward)
    spans = np.append(0.0, np.cumsum(np.diff(t) / np.minimum(h[1:], h[:-1])))
    most = max(1, (t.shape[0] - settings.degree - 1) // 2)
    m = min(max(1, round(spans[-1])), most)
    breaks = np.interp(np.linspace(0.0, spans[-1], m + 1), spans, t)
    breaks[0], breaks[-1] = t[0], t[-1]
    if m >= 2 * _END_SPANS + 1:
        breaks = np.concatenate([breaks[:1], breaks[_END_SPANS:-_END_SPANS], breaks[-1:]])
    return np.asarray(breaks, dtype=np.float64)


def _check_samples(t: Array, q: NDArray[np.floating], degree: int) -> None:
    if t.ndim != 1 or q.ndim != 2 or q.shape[0] != t.shape[0] or q.shape[1] < 1:
        raise TrajectoryError(f"samples have shapes {t.shape} and {q.shape}, should be (T,) and (T, J)")
    if t.shape[0] <= degree:
        raise TrajectoryError(
            f"{t.shape[0]} samples are too few for a fit of degree {degree}: at least {degree + 1}"
        )
    if not np.isfinite(t).all():
        raise TrajectoryError(f"sample time {int(np.argmin(np.isfinite(t)))} is not finite")
    if not np.abs(t).max() <= LATEST_S:
        raise TrajectoryError(
            f"sample time {np.abs(t).max():g} s is above {LATEST_S:g} s; count from a near epoch"
        )
    if not (np.diff(t) > 0.0).all():
        i = int(np.argmin(np.diff(t) > 0.0))
        raise TrajectoryError(
            f"sample times should increase, but {t[i]:.9g} s is followed by {t[i + 1]:.9g} s"
        )
    for begin in range(0, t.shape[0], _CHUNK):
        finite = np.isfinite(q[begin : begin + _CHUNK])
        if not finite.all():
            row, joint = (int(i) for i in np.argwhere(~finite)[0])
            raise TrajectoryError(f"joint {joint} at {t[begin + row]:.9g} s is not finite")


def fit_samples(t: ArrayLike, q: ArrayLike, settings: FitSettings | None = None) -> Fit:
    """Fit a spline of degree <= 5 to samples ``t (T,)`` [s], ``q (T, J)`` by least squares.

    Banded normal equations, accumulated in chunks, with one step of refinement (the residual of the first
    solution is fitted again). Beside samples and residuals, memory grows with the number of knots only.

    Raises
    ------
    TrajectoryError
        Wrong shapes, values that are not finite, times that do not increase, or too few samples.
    """
    settings = FitSettings() if settings is None else settings
    times = np.ascontiguousarray(t, dtype=np.float64)
    values = np.asarray(q)
    if not np.issubdtype(values.dtype, np.floating):
        values = values.astype(np.float64)
    k = settings.degree
    _check_samples(times, values, k)
    breaks = fit_breaks(times, settings)
    knots = np.concatenate([np.repeat(breaks[0], k), breaks, np.repeat(breaks[-1], k)])
    columns = knots.shape[0] - k - 1
    coefficients = np.zeros((columns, values.shape[1]))
    residuals = np.empty(values.shape)
    for _ in range(2):
        band = np.zeros((k + 1, columns))
        right = np.zeros(coefficients.shape)
        _residuals(times, values, knots, coefficients, residuals, k, band, right)
        try:
            coefficients += solveh_banded(band, right, lower=True, check_finite=False)
        except LinAlgError:
            raise TrajectoryError(
                f"samples do not determine a spline with knots every {settings.knot_spacing_s:g} s;"
                " choose a larger spacing"
            ) from None
    _residuals(times, values, knots, coefficients, residuals, k, band, right)
    trajectory = IntendedTrajectory(breaks, _local_powers(breaks, knots, coefficients, k))
    return Fit(
        trajectory=trajectory,
        residual=np.abs(residuals).max(axis=0),
        residual_rms=np.sqrt(np.mean(residuals**2, axis=0)),
        residual_samples=residuals,
        longest_gap_s=float(np.diff(times).max()),
    )


def _residuals(
    t: Array,
    q: NDArray[np.floating],
    knots: Array,
    coefficients: Array,
    residuals: Array,
    k: int,
    band: Array,
    right: Array,
) -> None:
    """Write sample minus spline and accumulate the normal equations of the residuals."""
    for begin in range(0, t.shape[0], _CHUNK):
        part = slice(begin, begin + _CHUNK)
        design = BSpline.design_matrix(t[part], knots, k)
        residuals[part] = q[part] - design @ coefficients
        first = np.ascontiguousarray(design.indices[:: k + 1], dtype=np.int64)
        basis = np.ascontiguousarray(design.data, dtype=np.float64).reshape(-1, k + 1)
        accumulate_normal_equations(basis, first, residuals[part], band, right)


def _local_powers(breaks: Array, knots: Array, coefficients: Array, k: int) -> Array:
    spline = BSpline(knots, coefficients, k)
    out = np.zeros((breaks.shape[0] - 1, DEGREE + 1, coefficients.shape[1]))
    factorial = 1.0
    for d in range(k + 1):
        factorial *= max(d, 1)
        out[:, d] = spline(breaks[:-1], nu=d) / factorial
    return out
