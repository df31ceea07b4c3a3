"""The rows of the models of people by plain NumPy, for comparison: vectorised over slices, rows and points.

The same formulas as in docs/method.md, section 4, written as one writes them with arrays. Unlike the compiled
models they believe that everything was seen and that all numbers are finite.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from occupancy.body import ALL_PARTS
from occupancy.humans.arm_reach import ArmReach
from occupancy.humans.articulated import ArticulatedAcceleration
from occupancy.humans.options import OptionModel
from occupancy.humans.pedestrian import Pedestrian
from occupancy.humans.unobserved import UnobservedSpace
from robots.motion import Block

Array = NDArray[np.float64]
Occupy = Callable[[Block, Block, Block], None]


def occupy_with_numpy(model: object) -> Occupy:
    """Return what writes the rows of ``model`` by NumPy; what can be is computed here, once."""
    match model:
        case ArmReach():
            return (_PublishedArms if model._published else _SoundArms)(model).occupy
        case UnobservedSpace():
            return _Unobserved(model).occupy
        case ArticulatedAcceleration():
            return _MovingOptions(model).occupy
        case Pedestrian():
            return _Uprights(model).occupy
        case OptionModel():
            return _Options(model).occupy
    raise TypeError(f"no way for {model}")


def _instants(seen: np.void, plan: np.void) -> tuple[Array, Array]:
    """First and last instant (S,) [s] of every slice, errors of clock and stamp included."""
    t = plan["t"][: plan["n"] + 1]
    begin = t[:-1] + plan["delay"][0] - 2.0 * seen["stamp_error"] - seen["clock_error"]
    return begin, t[1:] + plan["delay"][1] + seen["clock_error"]


def _write(out: Block, slices: int, per_slice: int, **fields: object) -> None:
    """Write fields that have one value for each of the rows, for each row of a slice, or for all."""
    written, n = out[0], slices * per_slice
    written["n"], written["first"] = n, n
    written["first"][:slices] = per_slice * np.arange(slices)
    written["slice"][:n] = np.repeat(np.arange(slices), per_slice)
    for name, value in fields.items():
        written[name][:n].reshape(slices, per_slice)[...] = value


class _Options:
    """Rows that are hulls of a few points."""

    def __init__(self, model: OptionModel) -> None:
        table = model._table[0]
        rows, most = int(table["n_rows"]), int(table["n_options"].max())
        self.model, self.speed, self.speed_max = model.index, table["speed"], table["speed_max"]
        self.ageing, self.chain, self.needs = table["ageing"], table["chain"][:rows], table["needs"][:rows]
        self.radius, self.n_points = table["radius"][:rows], table["n_points"][:rows]
        place = np.arange(4)
        given = place < self.n_points[:, None]
        self.point = np.where(given, table["point"][:rows], table["point"][:rows, :1])
        there = np.arange(most) < table["n_options"][:, None]
        self.parts = np.arange(len(there))
        self.option = np.where(there, table["option"][:, :most], rows)  # one more: costs infinitely much

    def choose(self, present: int, t_obs: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return rows (R,) of the table and the masks of the parts that each covers."""
        seen = (present >> np.arange(len(t_obs))) & 1 == 1
        age = t_obs[seen].max() - t_obs[self.point].min(axis=1)
        cost = np.where(self.needs & present == self.needs, self.chain + self.ageing * age, np.inf)
        costs = np.append(cost, np.inf)[self.option]
        covers: dict[int, int] = {}
        for part, row in enumerate(self.option[self.parts, costs.argmin(axis=1)].tolist()):
            if row < len(cost) and cost[row] < np.inf:
                covers[row] = covers.get(row, 0) | 1 << part
        return np.array(list(covers)), np.array(list(covers.values()))

    def occupy(self, people: Block, slices: Block, out: Block) -> None:
        seen, plan = people[0], slices[0]
        picked = [self.choose(int(seen["present"][k]), seen["t_obs"][k]) for k in range(seen["n"])]
        row, covers = (np.concatenate([each[i] for each in picked]) for i in (0, 1))
        owner = np.repeat(np.arange(seen["n"]), [len(each[0]) for each in picked])
        at = owner[:, None], self.point[row]
        n, per_slice = int(plan["n"]), len(row)
        points = out["points"][0, : n * per_slice].reshape(n, per_slice, 4, 3)
        growth, n_points = self.place(seen, at, _instants(seen, plan), self.n_points[row], points)
        _write(
            out,
            n,
            per_slice,
            n_points=n_points,
            radius=self.radius[row] + growth,
            owner=owner,
            covers=covers,
            model=self.model,
            speed_max=self.speed_max,
        )

    def place(
        self, seen: np.void, at: tuple[Array, Array], span: tuple[Array, Array], count: Array, points: Array
    ) -> tuple[Array, object]:
        """Write ``points`` (S, R, 4, 3) [m]; return growth (S, R) [m] and number of points (R,)."""
        begin, end = (t[:, None, None] for t in span)
        points[...] = seen["xyz"][at]
        elapsed = np.maximum(end - seen["t_obs"][at], seen["t_obs"][at] - begin)
        return (seen["e_p"][at] + self.speed[at[1]] * elapsed).max(axis=2), count


class _MovingOptions(_Options):
    """Rows of points that move on with their velocity."""

    def __init__(self, model: ArticulatedAcceleration) -> None:
        super().__init__(model)
        self.acceleration = model._acceleration

    def place(
        self, seen: np.void, at: tuple[Array, Array], span: tuple[Array, Array], count: Array, points: Array
    ) -> tuple[Array, object]:
        at = at[0], at[1][:, :2]
        first, last = (t[:, None, None] - seen["t_obs"][at] for t in span)
        longest = np.maximum(abs(first), abs(last))
        x, v = seen["xyz"][at], seen["v"][at]
        ends = x + v * first[..., None], x + v * last[..., None]
        for n in (1, 2):
            rows = count == n
            points[:, rows, :n], points[:, rows, n : 2 * n] = (end[:, rows, :n] for end in ends)
        spread = seen["e_v"][at] + 0.5 * self.acceleration[at[1]] * longest
        return (seen["e_p"][at] + longest * spread).max(axis=2), 2 * count


class _Uprights(_Options):
    """Vertical lines."""

    def __init__(self, model: Pedestrian) -> None:
        super().__init__(model)
        self.heights = np.array(model._ends)

    def place(
        self, seen: np.void, at: tuple[Array, Array], span: tuple[Array, Array], count: Array, points: Array
    ) -> tuple[Array, object]:
        growth, _ = super().place(seen, at, span, count, points)
        points[..., :2, 2] = self.heights
        return growth, 2


class _Unobserved:
    """One row per face of a region."""

    def __init__(self, model: UnobservedSpace) -> None:
        self.faces, self.rule, self.model = model._faces, model._rule, model.index

    def occupy(self, people: Block, slices: Block, out: Block) -> None:
        seen, plan = people[0], slices[0]
        detection, constant, speed, _ = self.rule
        begin, end = _instants(seen, plan)
        growth = constant + speed * np.maximum(
            end - seen["t_complete"] + detection, seen["t_complete"] - begin
        )
        n, per_slice = int(plan["n"]), len(self.faces)
        out["points"][0, : n * per_slice].reshape(n, per_slice, 4, 3)[...] = self.faces
        _write(
            out,
            n,
            per_slice,
            n_points=4,
            radius=growth[:, None],
            owner=seen["n"],
            covers=ALL_PARTS,
            model=self.model,
            speed_max=speed,
        )


class _Arms(ABC):
    """Two rows per arm; axes of arrays: slices, arms (persons times two), points, coordinates."""

    def __init__(self, model: ArmReach) -> None:
        self.limits = model._table[0]

    def occupy(self, people: Block, slices: Block, out: Block) -> None:
        seen, plan, limits = people[0], slices[0], self.limits
        k = np.repeat(np.arange(seen["n"]), 2)[:, None]
        point = np.tile(limits["point"], (int(seen["n"]), 1))
        n, arms = int(plan["n"]), len(k)
        points = out["points"][0, : n * 2 * arms].reshape(n, arms, 2, -1, 3)
        first, last = (t[:, None] - seen["t_obs"][k, point][:, 0] for t in _instants(seen, plan))
        count, growth = self.hulls(seen, (k, point), (first, last), points)
        _write(
            out,
            n,
            2 * arms,
            n_points=np.repeat(count, 2, axis=1),
            radius=(limits["radius"] + growth[..., None]).reshape(n, -1),
            owner=np.repeat(k[:, 0], 2),
            covers=np.tile(limits["covers"].ravel(), arms // 2),
            model=limits["model"],
            speed_max=limits["speed_max"],
        )

    @abstractmethod
    def hulls(
        self, seen: np.void, at: tuple[Array, Array], span: tuple[Array, Array], points: Array
    ) -> tuple[Array, Array]:
        """Write ``points`` (S, A, 2, 32, 3) [m]; return their number and the growth (S, A) [m]."""


def _of_offset(values: Array) -> Array:
    """Offset (A, 3) of the forearm's middle from the shoulder, of values (A, 3, 3) of the three points."""
    return 0.5 * (values[:, 1] + values[:, 2]) - values[:, 0]


def _error_of_offset(errors: Array) -> Array:
    return errors[:, 0] + 0.5 * (errors[:, 1] + errors[:, 2])


def _length(vectors: Array) -> Array:
    length: Array = np.sqrt(np.einsum("...i,...i", vectors, vectors))
    return length


def _cross(a: Array, b: Array) -> Array:
    """Vector product: several times as fast as ``np.cross``."""
    product: Array = a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]
    return product


def _seen_angle(radius: Array, distance: Array) -> Array:
    inside = radius >= distance
    angle: Array = np.where(inside, np.pi, np.arcsin(np.where(inside, 0.0, radius / distance)))
    return angle


class _SoundArms(_Arms):
    AROUND = 2.0 * np.pi * np.arange(10) / 10
    BEYOND = 1.0 / np.cos(np.pi / 10)

    def hulls(
        self, seen: np.void, at: tuple[Array, Array], span: tuple[Array, Array], points: Array
    ) -> tuple[Array, Array]:
        shoulder, d = seen["xyz"][at][:, 0], _of_offset(seen["xyz"][at])
        most, angle = self.cones(d, seen, at, span)
        speed = np.tile(self.limits["shoulder_speed"], len(d) // 2)
        growth = seen["e_p"][at][:, 0] + speed * np.maximum(abs(span[0]), abs(span[1]))
        wide, three = angle > np.pi / 3.0, angle > np.pi / 6.0
        half = np.pi / 6.0
        touch = np.stack([0.0 * angle, np.where(three, half, angle), angle, angle], axis=-1)
        corner = np.stack([0.5 * (a + b) for a, b in pairwise(np.moveaxis(touch, -1, 0))], axis=-1)
        distance = most[..., None] / np.cos(touch[..., 1:] - corner)
        u = d / _length(d)[:, None]
        e = np.where(abs(u[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
        x = e - (e * u).sum(axis=1, keepdims=True) * u
        x /= _length(x)[:, None]
        ring = (
            np.cos(self.AROUND)[:, None] * x[:, None] + np.sin(self.AROUND)[:, None] * _cross(u, x)[:, None]
        )
        along = (distance * np.cos(corner))[..., None, None] * u[:, None, None]
        across = (self.BEYOND * distance * np.sin(corner))[..., None, None] * ring[:, None]
        points[:, :, :, 0] = shoulder[:, None]
        points[:, :, :, 1:31] = (shoulder[:, None] + (along + across).reshape(*most.shape, 30, 3))[:, :, None]
        return np.where(wide, 1, np.where(three, 31, 21)), growth + np.where(wide, 1.0623 * most, 0.0)

    def cones(
        self, d: Array, seen: np.void, at: tuple[Array, Array], span: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """Longest extension [m] and half-angle [rad] (S, A)."""
        limits, r = self.limits, _length(d)
        e_p, e_v = (_error_of_offset(seen[name][at]) for name in ("e_p", "e_v"))
        longest = np.maximum(abs(span[0]), abs(span[1]))
        stretched = e_p + min(limits["extension_speed"], limits["speed"]) * longest
        turned = _seen_angle(e_p, r) + limits["angular_speed"] * longest
        angle = np.minimum(turned, _seen_angle(e_p + limits["speed"] * longest, r))
        t = np.stack(span)
        centre = d + _of_offset(seen["v"][at]) * t[..., None]
        away = _length(centre)
        tilt = np.arctan2(_length(_cross(d, centre)), (d * centre).sum(axis=-1))
        grown = e_p + abs(t) * (e_v + 0.5 * limits["acceleration"] * abs(t))
        farthest, widest = (away + grown).max(axis=0), (tilt + _seen_angle(grown, away)).max(axis=0)
        most = np.minimum(limits["extension"][1], r + stretched)
        return np.minimum(most, farthest), np.minimum(angle, widest)


class _PublishedArms(_Arms):
    NODES = np.arange(31)

    def hulls(
        self, seen: np.void, at: tuple[Array, Array], span: tuple[Array, Array], points: Array
    ) -> tuple[Array, Array]:
        elapsed = np.maximum(abs(span[0]), abs(span[1]))
        frame = self.frames(seen, at)
        low, high = self.boxes(frame, seen, at, elapsed)
        most, (width, height) = high[2], (high - low)[:2]
        best, rows = np.full(most.shape, np.inf), np.full(most.shape, 2)
        for n in range(2, 16):
            steps = width / (31 // n - 1), height / (n - 1)
            error = sum(np.where(step <= np.pi, 1.0 - np.cos(0.5 * step), np.inf) for step in steps)
            better = error < best - 1e-9
            best, rows = np.where(better, error, best), np.where(better, n, rows)
        columns = 31 // rows
        i, j = np.divmod(self.NODES, columns[..., None])
        q1 = low[0][..., None] + width[..., None] * j / (columns[..., None] - 1)
        q2 = low[1][..., None] + height[..., None] * i / (rows[..., None] - 1)
        node = np.stack([np.cos(q2) * np.cos(q1), np.cos(q2) * np.sin(q1), np.sin(q2)], axis=-1)
        shoulder = seen["xyz"][at][:, :1]
        points[:, :, :, 0] = shoulder
        points[:, :, :, 1:] = (shoulder + most[..., None, None] * (node @ frame))[:, :, None]
        growth = most * best + seen["e_p"][at].max(axis=1) + self.limits["base_speed"] * elapsed
        return 1 + rows * columns, growth

    def frames(self, seen: np.void, at: tuple[Array, Array]) -> Array:
        """Unit vectors down, forward and outward (A, 3, 3)."""
        k, point = at[0][:, 0], at[1][:, 0]
        side = np.arange(len(k)) % 2
        outward = seen["xyz"][k, point] - seen["xyz"][k, point.reshape(-1, 2)[:, ::-1].ravel()]
        outward /= _length(outward)[:, None]
        lower, upper = self.limits["trunk"][0]
        down = seen["xyz"][k, lower] - seen["xyz"][k, upper]
        down -= (down * outward).sum(axis=1, keepdims=True) * outward
        down /= _length(down)[:, None]
        forward = np.where(side[:, None] == 0, 1.0, -1.0) * _cross(down, outward)
        return np.stack([down, forward, outward], axis=1)

    def boxes(
        self, frame: Array, seen: np.void, at: tuple[Array, Array], elapsed: Array
    ) -> tuple[Array, Array]:
        """Lower and upper ends (3, S, A) of the intervals of both angles [rad] and the extension [m]."""
        limits = self.limits
        d, v = (_of_offset(seen[name][at]) for name in ("xyz", "v"))
        e_p, e_v = (_error_of_offset(seen[name][at]) for name in ("e_p", "e_v"))
        (x, y, z), (dx, dy, dz) = ((frame @ each[..., None])[..., 0].T for each in (d, v))
        r, flat = _length(d), np.hypot(x, y)
        middle = 0.5 * (limits["low"][0] + limits["high"][0])
        q1 = middle + np.remainder(np.arctan2(y, x) - middle + np.pi, 2.0 * np.pi) - np.pi
        e2 = _seen_angle(e_p, r)
        e1 = np.where(e2 < 0.5 * np.pi, _seen_angle(np.sin(e2), flat / r), np.pi)
        radial = (v * d).sum(axis=1) / r
        q, e = np.stack([q1, np.arctan2(z, flat), r]), np.stack([e1, e2, e_p])
        rates = np.stack([(dy * x - dx * y) / flat**2, (dz * r - z * radial) / (r * flat), radial])
        e_rates = np.stack([e_v / flat, e_v / r, e_v])
        below, above = ((q + sign * e)[:, None] for sign in (-1.0, 1.0))
        lowest, highest, rate, change = (
            limits[name][:, None, None] for name in ("low", "high", "rate", "change")
        )
        moved = rates[:, None] * elapsed
        spread = elapsed * (e_rates[:, None] + 0.5 * change * elapsed)
        low = np.maximum(lowest, below + np.maximum(-rate * elapsed, np.minimum(0.0, moved - spread)))
        high = np.minimum(highest, above + np.minimum(rate * elapsed, np.maximum(0.0, moved + spread)))
        drift = np.array([limits["drift"], limits["drift"], 0.0])[:, None, None] * elapsed
        low, high = low - drift, high + drift
        high[0] = np.minimum(high[0], low[0] + 2.0 * np.pi)
        low[1], high[1] = np.maximum(low[1], -0.5 * np.pi), np.minimum(high[1], 0.5 * np.pi)
        return low, high
