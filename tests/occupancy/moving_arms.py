"""Random arms that move as fast as their limits allow: the truth, and what a sensor says about it.

Independent of the model: a motion of the forearm's middle about the shoulder is chosen first, and the limits
of the profile are then those that the motion keeps, some of them with nothing to spare.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from occupancy.body import Part, Point, Profile, load_profile
from occupancy.hypotheses import PEOPLE
from occupancy.sets import distance_to_hull
from robots.motion import Block, new_slices
from tests.occupancy.moving_people import unit

Array = NDArray[np.float64]
Path = Callable[[Array], tuple[Array, Array, Array]]
"""Times (T,) [s] -> offset, velocity, acceleration (T, 3) of the forearm's middle from the shoulder."""
TUM = load_profile("tum")
UPPER_ARM = (0.186 * 1.5, 0.196 * 1.9)
HALF_FOREARM = (0.073 * 1.5, 0.073 * 1.9)
POINTS = {
    side: tuple(Point[f"{side}_{name}"] for name in ("SHOULDER", "ELBOW", "WRIST")) for side in ("L", "R")
}


def across(u: Array, wish: Array) -> Array:
    """Unit vector perpendicular to u (3,) nearest to ``wish`` (3,)."""
    vector = wish - (wish @ u) * u
    length = np.linalg.norm(vector)
    return vector / length if length > 1e-6 else across(u, np.roll(wish, 1) + np.array([0.3, 0.1, 0.2]))


def _stack(*columns: Array) -> tuple[Array, ...]:
    return tuple(np.array(column) for column in columns)


def radial(d: Array, way: Array, speed: float, change: float) -> Path:
    u = d / np.linalg.norm(d)
    return lambda t: (d + speed * t[:, None] * u, np.tile(speed * u, (len(t), 1)), np.zeros((len(t), 3)))


def circle(d: Array, way: Array, speed: float, change: float) -> Path:
    r = float(np.linalg.norm(d))
    u, rate = d / r, speed / r
    side = across(u, way)

    def path(t: Array) -> tuple[Array, Array, Array]:
        c, s = np.cos(rate * t)[:, None], np.sin(rate * t)[:, None]
        out = r * (c * u + s * side)
        return out, r * rate * (c * side - s * u), -rate * rate * out

    return path


def line(d: Array, way: Array, speed: float, change: float) -> Path:
    return lambda t: (d + speed * t[:, None] * way, np.tile(speed * way, (len(t), 1)), np.zeros((len(t), 3)))


def bang(d: Array, way: Array, speed: float, change: float) -> Path:
    """From half the speed with full acceleration until at full speed; backwards likewise."""
    start = 0.5 * speed
    until = (speed - start) / change

    def path(t: Array) -> tuple[Array, Array, Array]:
        ramp = np.clip(t, -2.0 * until, until)
        gone = start * ramp + 0.5 * change * ramp**2 + (start + change * ramp) * (t - ramp)
        now = start + change * ramp
        pushed = np.where(t == ramp, change, 0.0)
        return d + gone[:, None] * way, now[:, None] * way, pushed[:, None] * way

    return path


PATHS = {each.__name__: each for each in (radial, circle, line, bang)}


@dataclass(frozen=True)
class Limb:
    """An arm: upper arm ``a``, half the forearm ``b`` [m]."""

    a: float
    b: float

    def tilt(self, r: Array) -> Array:
        """Cosine of the angle between forearm and offset for extensions r (T,); beyond 1: impossible."""
        cosine: Array = (r * r + self.b**2 - self.a**2) / (2.0 * r * self.b)
        return cosine

    def wrist(self, d: Array, wish: Array) -> Array:
        """From the middle of the forearm to the wrist (3,), leaning towards ``wish``."""
        r = np.linalg.norm(d)
        u = d / r
        c = float(np.clip(self.tilt(r), -1.0, 1.0))
        return self.b * (c * u + math.sqrt(1.0 - c * c) * across(u, wish))

    def possible(self, r: Array, elbow: float) -> bool:
        cosine = self.tilt(r)
        flexion = (r * cosine - self.b) / self.a
        return bool((np.abs(cosine) <= 1.0).all() and (flexion >= math.cos(elbow)).all())


@dataclass(frozen=True)
class Case:
    """One trial: profile, what is known, the slice, and where the arm truly is at any instant."""

    profile: Profile
    people: Block
    plan: Block
    side: str
    limb: Limb
    path: Path
    seen_at: float
    shoulder: Array
    way: Array
    shoulder_speed: float

    def arm(self, t: float, wish: Array) -> tuple[Array, Array, Array]:
        """Shoulder, elbow, wrist (3,) at t."""
        elapsed = t - self.seen_at
        s = self.shoulder + self.shoulder_speed * elapsed * self.way
        d = self.path(np.array([elapsed]))[0][0]
        w = self.limb.wrist(d, wish)
        return s, s + d - w, s + d + w


def tightest(path: Path, t: Array) -> tuple[float, float, float, float]:
    """Greatest speed, acceleration, turning and stretching of a path, with a ten-thousandth to spare."""
    d, v, a = path(t)
    r = np.linalg.norm(d, axis=1)
    turn = np.linalg.norm(np.cross(d, v), axis=1) / r**2
    stretch = np.abs(np.einsum("ti,ti->t", d, v)) / r
    speed, change = np.linalg.norm(v, axis=1), np.linalg.norm(a, axis=1)
    most = [float(x.max()) * 1.0001 + 1e-9 for x in (speed, change, turn, stretch)]
    return most[0], most[1], most[2], most[3]


def random_case(rng: np.random.Generator, kind: str, *, aligned: bool) -> Case | None:
    """A random arm, its motion and its slice; ``None``: the motion is not one of an arm.

    With ``aligned``, errors and motions all point the way that leads out of the set.
    """
    longest = aligned or rng.random() < 0.3
    limb = Limb(*(ends[1] if longest else float(rng.uniform(*ends)) for ends in (UPPER_ARM, HALF_FOREARM)))
    gamma = float(rng.choice([0.0, math.pi / 2])) if aligned else float(rng.uniform(0.0, 2.2))
    gamma = {"radial": 0.4, "circle": math.pi / 2}.get(kind, gamma) if aligned else gamma
    r = limb.b * math.cos(gamma) + math.sqrt(limb.a**2 - (limb.b * math.sin(gamma)) ** 2)
    u = unit(rng, 1)[0]
    if rng.random() < 0.2:
        u = np.array([0.0, 0.0, -1.0]) + 0.1 * rng.normal(size=3)
        u /= np.linalg.norm(u)
    d = r * u
    way = u if kind == "radial" else across(u, rng.normal(size=3)) if aligned else unit(rng, 1)[0]
    horizon = float(rng.uniform(0.01, 0.25))
    speed = float(rng.uniform(0.05, 0.4)) / horizon * float(rng.choice([1.0, 0.3]))
    if kind == "radial":
        speed = min(speed, (limb.a + limb.b - r) / (horizon + 0.06) * 0.9)
    path = PATHS[kind](d, way, speed, float(rng.uniform(0.2, 3.0)) * speed / horizon)
    e_p = rng.choice([0.0, 1.0]) * rng.uniform(0.0, 0.05, 3)
    e_p[0] *= 0.0 if aligned else 1.0
    stamp, clock = rng.uniform(0.0, 0.01, 2) * rng.choice([0.0, 1.0])
    delay = (float(rng.uniform(0.0, 0.01)), float(rng.uniform(0.01, 0.03)))
    begin = 10.0 + horizon * float(rng.choice([-0.3, 0.0, 0.7, 0.99, 1.0]))
    seen_at = 10.0 + (-stamp - clock if aligned else float(rng.uniform(-stamp - clock, stamp + clock)))
    span = (min(seen_at, begin), 10.0 + max(horizon, 0.0) + 0.05)
    times = np.linspace(span[0] - seen_at, span[1] - seen_at, 400)
    if not limb.possible(np.linalg.norm(path(times)[0], axis=1), TUM.arm.elbow):
        return None
    most = tightest(path, times)
    spare = rng.choice([1.0, 1.0, 3.0, 100.0], 4)
    profile = replace(
        TUM,
        arm=replace(
            TUM.arm,
            relative_speed=most[0] * spare[0],
            relative_acceleration=most[1] * spare[1],
            angular_speed=most[2] * spare[2],
            extension_speed=most[3] * spare[3],
        ),
    )
    side, shoulder = str(rng.choice(["L", "R"])), rng.uniform(-2.0, 2.0, 3)
    points = POINTS[side]
    push = -way if aligned else None
    wrist = limb.wrist(d, way)
    true = (shoulder, shoulder + d - wrist, shoulder + d + wrist)
    velocity = path(np.zeros(1))[1][0]
    share = 1.0 if aligned else float(rng.choice([0.0, 0.5, 1.0]))
    shoulder_speed = share * float(profile.speed[points[0]])
    moves = (shoulder_speed * way, velocity + shoulder_speed * way, velocity + shoulder_speed * way)
    known = rng.random() < 0.6
    e_v = rng.choice([0.0, 1.0]) * rng.uniform(0.0, 0.5, 3)
    e_v[0] *= 0.0 if aligned else 1.0
    people = np.zeros(1, PEOPLE)
    people["n"], people["person"] = 1, 0
    people["stamp_error"], people["clock_error"] = stamp, clock
    people["t_obs"], people["xyz"], people["e_p"], people["e_v"] = math.nan, math.nan, math.nan, math.inf
    for j, p in enumerate(points):
        off = push if push is not None else unit(rng, 1)[0]
        people["present"][0, 0] |= 1 << p
        people["t_obs"][0, 0, p] = 10.0 - stamp
        people["xyz"][0, 0, p] = true[j] + e_p[j] * off
        people["e_p"][0, 0, p] = e_p[j] * 1.000001
        if known:
            people["v"][0, 0, p] = moves[j] + e_v[j] * off
            people["e_v"][0, 0, p] = e_v[j] * 1.000001
    plan = new_slices()
    plan["n"], plan["delay"] = 1, delay
    plan["t"][0, :2] = begin, max(begin, 10.0 + horizon + 0.05 - delay[1])
    return Case(profile, people, plan, side, limb, path, seen_at, shoulder, way, shoulder_speed)


def worst(case: Case, rows: list[tuple[Array, float, int]], rng: np.random.Generator, n: int) -> float:
    """Greatest distance [m] by which the arm lies outside of ``rows`` (points, radius, parts) on the slice.

    A ball lies in a hull grown by a larger ball iff its centre is within the difference of the hull.
    """
    begin, end = case.plan["t"][0, :2] + case.plan["delay"][0]
    side = case.side
    found = -math.inf
    for t in [begin, end, *rng.uniform(begin, end, n)]:
        for wish in (case.way, rng.normal(size=3)):
            s, e, w = case.arm(float(t), wish)
            for points, radius, covers in rows:
                if covers >> Part[f"{side}_HAND"] & 1:
                    inside = [(w, Part[f"{side}_HAND"])]
                else:
                    inside = [(x, Part[f"{side}_FOREARM"]) for x in (s, e, w)]
                for x, part in inside:
                    far = distance_to_hull(points, x) + float(case.profile.radius[part])
                    found = max(found, far - radius)
    return found
