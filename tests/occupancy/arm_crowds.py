"""Crowds of random arms that use up the limits of a profile: the truth, and what a sensor says about it.

Every crowd has 16 persons with two arms each, limits of its own that the arms keep, and a plan of three
slices. In an *aligned* crowd motion, shoulder, forearm and errors all lead out of the set at its last
instant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from occupancy.body import Part, Point, Profile, load_profile
from occupancy.sets import MAX_PEOPLE
from robots.motion import Block
from tests.occupancy.arm_motion_kernels import offsets, place_arms, turn_arms
from tests.occupancy.body_kernels import accelerate_points
from tests.occupancy.crowds import PIECES, Pieces, Watch, known, watch
from tests.occupancy.moving_people import unit

Array = NDArray[np.float64]

TUM = load_profile("tum")
N = 2 * MAX_PEOPLE
UPPER_ARM = (0.186 * 1.5, 0.196 * 1.9)
HALF_FOREARM = (0.073 * 1.5, 0.073 * 1.9)
"""Lengths [m] from the shortest to the longest person of the profiles, Drillis and Contini."""
POINTS = np.array([[Point[f"{s}_{name}"] for name in ("SHOULDER", "ELBOW", "WRIST")] for s in "LR"])
BITS = np.array([[Part[f"{s}_{name}"] for name in ("UPPER_ARM", "FOREARM", "HAND")] for s in "LR"])
KINDS = ("turn", "radial", "line", "bang")
TURNED = ("turn", "radial")
UNLIMITED = 1e9
"""An acceleration that corners of a path do not exceed in any time that matters [m/s²]."""


def across(u: Array, wish: Array) -> Array:
    """Unit vectors across ``u`` (n, 3) nearest to ``wish`` (n, 3)."""
    left = wish - np.einsum("ni,ni->n", u, wish)[:, None] * u
    size = np.linalg.norm(left, axis=1)[:, None]
    other = np.where(np.abs(u[:, :1]) < 0.6, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    other = other - np.einsum("ni,ni->n", u, other)[:, None] * u
    out: Array = np.where(
        size > 1e-6, left / np.maximum(size, 1e-6), other / np.linalg.norm(other, axis=1)[:, None]
    )
    return out


@dataclass(frozen=True)
class Limbs:
    """Upper arms ``a``, half forearms ``b`` (n,) [m], and which way wrists lean, ``wish`` (n, 3)."""

    a: Array
    b: Array
    wish: Array

    @classmethod
    def random(cls, rng: np.random.Generator, *, longest: bool) -> Limbs:
        lengths = [
            np.full(N, ends[1]) if longest else rng.uniform(*ends, N) for ends in (UPPER_ARM, HALF_FOREARM)
        ]
        return cls(lengths[0], lengths[1], unit(rng, N))

    def extensions(self, elbow: float) -> tuple[Array, Array]:
        """Least and greatest length (n,) of d with elbows that bend by up to ``elbow`` [rad]."""
        c = math.cos(min(elbow, math.pi))
        return np.sqrt(self.a**2 + self.b**2 + 2.0 * self.a * self.b * c), self.a + self.b

    def forearm(self, d: Array) -> Array:
        """From the forearm's middle to the wrist, for offsets ``d`` (n, m, 3): the triangle of a, b and d."""
        r = np.linalg.norm(d, axis=2)
        a, b = self.a[:, None], self.b[:, None]
        c = np.clip((r * r + b * b - a * a) / (2.0 * r * b), -1.0, 1.0)
        u = (d / r[..., None]).reshape(-1, 3)
        side = across(u, np.repeat(self.wish, d.shape[1], axis=0)).reshape(d.shape)
        out: Array = b[..., None] * (
            c[..., None] * u.reshape(d.shape) + np.sqrt(1.0 - c * c)[..., None] * side
        )
        return out


@dataclass(frozen=True)
class Arms:
    """Motions of 32 arms: offsets of forearms and places of shoulders; which of them are ``real``."""

    limbs: Limbs
    turned: bool
    path: Pieces
    shoulder: Pieces
    real: NDArray[np.bool_]

    def at(self, when: Array) -> tuple[Array, Array]:
        """Shoulder, elbow, wrist (n, m, 3, 3) [m] and their velocities [m/s] at ``when`` (n, m) [s]."""
        s, ds = self.shoulder.at(when)
        d, dd = self.offset(when)
        step = 1e-6
        limb = self.limbs.forearm(d)
        change = (self.limbs.forearm(d + step * dd) - self.limbs.forearm(d - step * dd)) / (2.0 * step)
        return (
            np.stack([s, s + d - limb, s + d + limb], axis=2),
            np.stack([ds, ds + dd - change, ds + dd + change], axis=2),
        )

    def offset(self, when: Array) -> tuple[Array, Array]:
        d, dd = np.empty((*when.shape, 3)), np.empty((*when.shape, 3))
        p = self.path
        offsets(self.turned, p.t, p.x, p.v, p.a, np.ascontiguousarray(when), d, dd)
        return d, dd


@dataclass(frozen=True)
class ArmCrowd:
    """What is known of 32 arms, the limits that they keep, a plan, and where they truly are on it.

    ``at`` (slices, instants, 16, 2, 3, 3) [m] at ``times`` (slices, instants) [s].
    """

    profile: Profile
    people: Block
    plan: Block
    at: Array
    times: Array
    kind: str


def arms(rng: np.random.Generator, *, aligned: bool) -> ArmCrowd:
    """32 arms that keep to limits of speed, turning, stretching and acceleration about the shoulder."""
    kind = str(rng.choice(KINDS))
    seen = _seen_at_once(watch(rng, aligned=aligned, lost=False, ages=not aligned, after=aligned))
    t = seen.breaks(rng)
    window = float(t[-1] - t[0])
    speed = float(rng.uniform(0.05, 0.4) / window * rng.choice([1.0, 0.3]))
    made = (_aligned if aligned else _random)(rng, kind, t, speed, seen)
    moving, limits, way = made
    spare = rng.choice([1.0, 1.0, 3.0, 100.0], 4)
    profile = replace(
        TUM,
        arm=replace(
            TUM.arm,
            relative_speed=limits["speed"] * spare[0],
            angular_speed=limits["turning"] * spare[1],
            extension_speed=limits["stretching"] * spare[2],
            relative_acceleration=limits["acceleration"] * spare[3],
        ),
    )
    flat = seen.times.ravel()
    x, _ = moving.at(np.tile(flat, (N, 1)))
    at = x.reshape(MAX_PEOPLE, 2, *seen.times.shape, 3, 3).transpose(2, 3, 0, 1, 4, 5)
    people = _known(rng, seen, moving, -way if aligned else None)
    return ArmCrowd(profile, people, seen.plan, np.ascontiguousarray(at), seen.times, kind)


Made = tuple[Arms, dict[str, float], Array]
"""Motions, the limits that they keep, and the direction (n, 3) that leads out of the set."""


def _random(rng: np.random.Generator, kind: str, t: Array, speed: float, seen: Watch) -> Made:
    """Bang-bang motions in all directions."""
    limbs = Limbs.random(rng, longest=rng.random() < 0.3)
    least, most = limbs.extensions(TUM.arm.elbow)
    least, most = least * (1.0 + 1e-9), most * (1.0 - 1e-9)
    limits = _limits(speed, float(least.min()))
    x, v, a = (np.zeros((N, PIECES, 3)) for _ in range(3))
    real = np.ones(N, bool)
    if kind in TURNED:
        limits["turning"] = speed / 0.3 * float(rng.uniform(0.2, 1.5))
        limits["stretching"] = speed * float(rng.uniform(0.2, 1.2))
        turn_arms(rng, t, (speed, limits["turning"], limits["stretching"]), least, most, x, v, a)
    else:
        if kind == "bang":
            limits["acceleration"] = speed / float(t[-1] - t[0]) * float(rng.uniform(0.5, 10.0))
            accelerate_points(
                rng, t, np.full(N, speed), np.full(N, limits["acceleration"]), np.zeros(3), x, v, a
            )
        else:
            x, v = _zigzag(rng, t, speed)
        times = np.concatenate([np.linspace(t[0], t[-1], 50), seen.times.ravel()])
        moved, _ = Pieces(t, x, v, a).at(times)
        start = np.empty((N, 3))
        real = place_arms(rng, moved, least, most, start)
        x += start[:, None]
    shoulder, moves = _zigzag(rng, t, float(TUM.speed[POINTS[0, 0]]))
    shoulder += rng.uniform(-2.0, 2.0, (N, 1, 3))
    path = Pieces(t, x, v, a)
    made = Arms(limbs, kind in TURNED, path, Pieces(t, shoulder, moves, np.zeros_like(moves)), real)
    return made, limits, np.zeros((N, 3))


def _aligned(rng: np.random.Generator, kind: str, t: Array, speed: float, seen: Watch) -> Made:
    """Motions that at the last instant have led out of the set for as long and as straight as possible."""
    limbs = Limbs.random(rng, longest=True)
    least, most = (float(each[0]) for each in limbs.extensions(TUM.arm.elbow))
    window, end = float(t[-1] - t[0]), float(seen.times.max())
    radial = kind == "radial"
    speed = min(speed, 0.9 * (most - least) / window) if radial else speed
    r = most * (1.0 - 1e-9) if radial else math.sqrt(limbs.a[0] ** 2 - limbs.b[0] ** 2)
    u = unit(rng, N) if rng.random() < 0.8 else _hanging(rng)
    side = across(u, unit(rng, N))
    way = u if radial else side
    limits = _limits(speed, least)
    first = speed
    if kind == "turn":
        limits["turning"] = speed / r
    elif kind == "bang":
        first = speed * float(rng.uniform(0.3, 0.7))  # velocities that point backwards would widen the set
        limits["acceleration"] = (speed - first) / window
    span, before = np.array([t[0], t[-1]]), t[0] - end
    path = _leading_out(kind, span, before, (first, speed), r, u, side)
    fast = float(TUM.speed[POINTS[0, 0]]) * (1.0 - 1e-12)
    place = rng.uniform(-2.0, 2.0, (N, 1, 3)) + fast * before * way[:, None]
    shoulder = Pieces(span, place, fast * way[:, None], np.zeros_like(place))
    made = Arms(replace(limbs, wish=way), kind in TURNED, path, shoulder, np.ones(N, bool))
    far = np.linalg.norm(made.offset(np.tile(np.linspace(t[0], end, 50), (N, 1)))[0], axis=2)
    made.real[:] = ((least <= far) & (far <= most * (1.0 + 1e-12))).all(axis=1)
    return made, limits, way


def _leading_out(
    kind: str, span: Array, before: float, speeds: tuple[float, float], r: float, u: Array, side: Array
) -> Pieces:
    """One piece over ``span`` (2,) [s] that is at r ``u`` (n, 3) when -``before`` [s] have passed since
    its begin.

    It turns towards ``side`` (n, 3), stretches, or moves that way, at the last of ``speeds`` [m/s], or with a
    speed that grows from the first to the last.
    """
    first, speed = speeds
    if kind == "turn":
        c, s = math.cos(speed / r * before), math.sin(speed / r * before)
        rates = np.tile([r, 0.0, speed / r], (len(u), 1, 1))
        return Pieces(span, (c * u + s * side)[:, None], (c * side - s * u)[:, None], rates)
    if kind == "radial":
        rates = np.tile([r + speed * before, speed, 0.0], (len(u), 1, 1))
        return Pieces(span, u[:, None], side[:, None], rates)
    change = (speed - first) / (span[1] - span[0])
    x = r * u + (first - 0.5 * change * before) * before * side
    return Pieces(span, x[:, None], first * side[:, None], change * side[:, None])


def _limits(speed: float, least: float) -> dict[str, float]:
    """What a motion at ``speed`` [m/s], no nearer to the shoulder than ``least`` [m], keeps in any case."""
    speed = speed * (1.0 + 1e-9)
    return {"speed": speed, "turning": speed / least, "stretching": speed, "acceleration": UNLIMITED}


def _hanging(rng: np.random.Generator) -> Array:
    u = np.array([0.0, 0.0, -1.0]) + 0.1 * rng.normal(size=(N, 3))
    out: Array = u / np.linalg.norm(u, axis=1)[:, None]
    return out


def _zigzag(rng: np.random.Generator, t: Array, speed: float) -> tuple[Array, Array]:
    """Pieces x and v (n, B, 3) from 0 on at full speed, or at rest, in directions that change at once."""
    share = rng.choice([1.0, 1.0, 0.5, 0.0], (N, 1, 1)) * (1.0 - 1e-12)
    v = share * speed * unit(rng, N * PIECES).reshape(N, PIECES, 3)
    same = rng.random(N) < 0.4
    v[same] = v[same, :1]
    x = np.zeros_like(v)
    x[:, 1:] = np.cumsum(v * np.diff(t)[:, None], axis=1)[:, :-1]
    return x, v


def _seen_at_once(seen: Watch) -> Watch:
    """Shoulder, elbow and wrist of an arm stand in the same report."""
    for each in (seen.instant, seen.t_obs):
        for points in POINTS:
            each[:, points] = each[:, points[1:2]]
    return seen


def _known(rng: np.random.Generator, seen: Watch, moving: Arms, push: Array | None) -> Block:
    """The people block: errors point along ``push`` (n, 3), of shoulders none, or anywhere."""
    shape = (MAX_PEOPLE, 2, 3)
    x, e_p, v, e_v, off = (np.zeros((MAX_PEOPLE, 20, *more)) for more in ((3,), (), (3,), (), (3,)))
    instant = seen.instant[:, POINTS[:, 1]].reshape(N, 1)
    place, velocity = (each.reshape(*shape, 3) for each in moving.at(instant))
    towards = unit(rng, N * 3).reshape(*shape, 3)
    errors = rng.uniform(0.0, 0.05, (2, *shape)) * rng.choice([0.0, 1.0, 1.0], (2, MAX_PEOPLE, 1, 1))
    if push is not None:
        towards = np.repeat(push.reshape(MAX_PEOPLE, 2, 1, 3), 3, axis=2)
        errors[..., 0] = 0.0
    unsure = (10.0 if push is None else 4.0) * errors[1]
    for into, values in ((x, place), (e_p, errors[0]), (v, velocity), (e_v, unsure), (off, towards)):
        into[:, POINTS] = values
    people = known(seen, x, e_p, off)
    record = people[0]
    there = np.zeros((MAX_PEOPLE, 20), bool)
    there[:, POINTS] = moving.real.reshape(MAX_PEOPLE, 2, 1)
    record["present"] = (there << np.arange(20)).sum(axis=1)
    record["v"] = v + e_v[..., None] * off
    record["e_v"] = np.where(rng.random((MAX_PEOPLE, 1)) < 0.6, e_v, math.inf)
    for name in ("xyz", "t_obs", "e_p"):
        record[name][~there] = math.nan
    return people
