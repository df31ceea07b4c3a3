"""What inclusion tests rest on: distances from hulls, crowds that obey their limits and use them up."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest

from occupancy.body import Point, Profile, load_profile
from occupancy.sets import new_people_sets
from tests.occupancy.arm_crowds import HALF_FOREARM, KINDS, UPPER_ARM, ArmCrowd, arms
from tests.occupancy.crowds import Crowd, accelerating, bodies, flat
from tests.occupancy.entering import entering
from tests.occupancy.inclusion_kernels import (
    EXCESS,
    MOST_OPEN,
    OPEN_WIDTH,
    from_hull,
    hold,
)
from tests.oracles.hulls import pad, point_distance

Array = np.ndarray
Count = Callable[[int], int]
PROFILES = {name: load_profile(name) for name in ("iso", "tum", "extreme")}
GENTLE = flat(PROFILES["tum"], 3.0, 5.0)


# ---------------------------------------------------------------------------------------------------- hulls


def hull(rng: np.random.Generator) -> Array:
    """1 to 21 points; sometimes on a line, in a plane, twice the same, tiny, or hundreds of metres away."""
    n = int(rng.choice([1, 2, 3, 4, 4, 4, 6, 9, 21], p=[*[0.12] * 8, 0.04]))
    points = rng.normal(size=(n, 3))
    dimensions = int(rng.integers(4))
    if dimensions < 3:
        points = points[:, :dimensions] @ rng.normal(size=(dimensions, 3))
    if rng.random() < 0.3:
        points[int(rng.integers(n))] = points[0]
    out: Array = points * 10.0 ** rng.uniform(-3.0, 2.5) + rng.choice([0.0, 1.0, 100.0]) * rng.normal(size=3)
    return out


def by_tetrahedra(points: Array, x: Array) -> float:
    """Distance of a point from a hull: the nearest of all tetrahedra of its points (Carathéodory)."""
    if len(points) <= 4:
        return float(point_distance(x, pad(points)))
    return float(point_distance(x, points[np.array(list(combinations(range(len(points)), 4)))]).min())


def test_distance_is_attained_and_the_least_one(rng: np.random.Generator, count: Count) -> None:
    decided, cases = 0, count(20_000)
    for _ in range(cases):
        points = hull(rng)
        size = float(np.ptp(points, axis=0).max()) + 1e-3
        x = points.mean(axis=0) + size * rng.choice([0.0, 0.1, 1.0, 10.0]) * rng.normal(size=3)
        exact, rounding = by_tetrahedra(points, x), 1e-12 * (float(np.abs(points).max()) + size)
        for enough in (0.0, float(rng.uniform(0.0, 2.0)) * exact):
            found, least = from_hull(points, len(points), x, enough)
            assert found >= exact - 1e-8 * size - rounding
            assert found <= enough or not least or found <= exact + 1e-8 * size + rounding
            decided += least or found <= enough
    assert decided > 1.8 * cases


@pytest.mark.parametrize("n", [1, 2, 4, 21])
@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("where", ["x", "points", "radius", "n"])
def test_what_is_no_number_lies_outside(n: int, value: float, where: str, rng: np.random.Generator) -> None:
    out = (
        new_people_sets() if n <= 4 else np.zeros(1, [("points", "f8", (1, 32, 3)), ("n_points", "i4", (1,))])
    )
    rows, x, room = out[0], np.zeros(3), 10.0
    rows["points"][0, :n], rows["n_points"][0] = rng.normal(size=(n, 3)), n
    worst, open_cases = np.zeros(OPEN_WIDTH), np.zeros((MOST_OPEN, OPEN_WIDTH))
    worst[EXCESS] = -math.inf
    assert hold(rows, 0, x, room, np.zeros(4), worst, open_cases) == 0 and worst[EXCESS] < 0.0
    if where == "x":
        x[1] = value
    elif where == "points":
        rows["points"][0, :n, 1] = value
    elif where == "n":
        rows["n_points"][0] = 0
    else:
        room = math.nan
    hold(rows, 0, x, room, np.zeros(4), worst, open_cases)
    assert worst[EXCESS] == math.inf


# ------------------------------------------------------------------------------------------------ admissible


def limbs(profile: Profile) -> tuple[Array, Array]:
    limits = profile.limits[0]
    pairs = limits["limb"][: limits["n_limbs"]]
    return pairs, profile.chain[pairs[:, 0], pairs[:, 1]]


def in_order(crowd: Crowd | ArmCrowd) -> tuple[Array, Array]:
    """Instants (T,) [s] in their order, and what was where (T, …)."""
    times, at = crowd.times.ravel(), crowd.at.reshape(-1, *crowd.at.shape[2:])
    _, first = np.unique(times, return_index=True)
    apart = np.concatenate([[True], np.diff(times[first]) > 1e-7])
    return times[first][apart], at[first][apart]


def reports_are_true(crowd: Crowd, speed: Array) -> float:
    """What was seen lies as near to the first place as errors and speeds allow; greatest share of that."""
    record, (t, x) = crowd.people[0], in_order(crowd)
    slack = 2.0 * (record["stamp_error"] + record["clock_error"])
    allowed = record["e_p"] + speed * (np.abs(t[0] - record["t_obs"]) + slack)
    off = np.linalg.norm(x[0] - record["xyz"], axis=2)
    seen = np.isfinite(record["t_obs"])
    assert seen.any(axis=1).all() and (off[seen] <= allowed[seen] + 1e-9).all()
    return float((off[seen] / (allowed[seen] + 1e-9)).max())


@pytest.mark.parametrize("aligned", [False, True])
@pytest.mark.parametrize("name", PROFILES)
def test_bodies_keep_to_speeds_and_limbs(
    rng: np.random.Generator, count: Count, name: str, aligned: bool
) -> None:
    profile = PROFILES[name]
    pairs, longest = limbs(profile)
    fastest = stretched = told = 0.0
    for _ in range(max(20, count(2_000))):
        crowd = bodies(rng, profile, aligned=aligned)
        t, x = in_order(crowd)
        moved = np.linalg.norm(np.diff(x, axis=0), axis=3) / np.diff(t)[:, None, None]
        assert (moved <= profile.speed * (1.0 + 1e-6)).all()
        length = np.linalg.norm(x[:, :, pairs[:, 0]] - x[:, :, pairs[:, 1]], axis=3)
        assert (length <= longest + 1e-12).all()
        fastest = max(fastest, float((moved / profile.speed).max()))
        stretched = max(stretched, float((length / longest).max()))
        told = max(told, reports_are_true(crowd, profile.speed))
    assert fastest > 1.0 - 1e-6 and stretched > 1.0 - 1e-9 and told > 0.9


@pytest.mark.parametrize("aligned", [False, True])
@pytest.mark.parametrize(
    "profile", [PROFILES["tum"], PROFILES["extreme"], GENTLE], ids=("tum", "extreme", "gentle")
)
def test_accelerating_bodies_keep_to_speeds_and_accelerations(
    rng: np.random.Generator, count: Count, profile: Profile, aligned: bool
) -> None:
    """The second divided difference of a motion is at most half the acceleration."""
    fastest = hardest = 0.0
    for _ in range(max(20, count(2_000))):
        crowd = accelerating(rng, profile, aligned=aligned)
        t, x = in_order(crowd)
        moved = np.diff(x, axis=0) / np.diff(t)[:, None, None, None]
        speed = np.linalg.norm(moved, axis=3) / profile.speed
        bent = 2.0 * np.diff(moved, axis=0) / (t[2:] - t[:-2])[:, None, None, None]
        wide = (np.diff(t)[1:] > 1e-3) & (np.diff(t)[:-1] > 1e-3)
        acceleration = np.linalg.norm(bent[wide], axis=3) / profile.acceleration
        assert (speed <= 1.0 + 1e-6).all() and (acceleration <= 1.0 + 1e-6).all()
        reports_are_true(crowd, profile.speed)
        fastest, hardest = (
            max(fastest, float(speed.max())),
            max(hardest, float(acceleration.max(initial=0.0))),
        )
    assert fastest > 0.99 and hardest > 0.99


@pytest.mark.parametrize("aligned", [False, True])
def test_arms_keep_to_limits_about_the_shoulder(
    rng: np.random.Generator, count: Count, aligned: bool
) -> None:
    used, kinds = np.zeros(4), set()
    for _ in range(max(60, count(4_000))):
        crowd = arms(rng, aligned=aligned)
        real = np.isfinite(crowd.people["t_obs"][0][:, [Point.L_ELBOW, Point.R_ELBOW]])
        t, at = in_order(crowd)
        s, e, w = (at[:, real, j] for j in range(3))
        d, step = 0.5 * (e + w) - s, np.diff(t)[:, None]
        arm, r = crowd.profile.arm, np.linalg.norm(d, axis=2)
        v = np.diff(d, axis=0) / step[..., None]
        wide = (np.diff(t)[1:] > 1e-3) & (np.diff(t)[:-1] > 1e-3)
        bent = 2.0 * np.diff(v, axis=0)[wide] / (t[2:] - t[:-2])[wide, None, None]
        u = d / r[..., None]
        turned = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(np.diff(u, axis=0), axis=2), 1.0)) / step
        shares = [
            np.linalg.norm(v, axis=2).max(initial=0.0) / arm.relative_speed,
            turned.max(initial=0.0) / arm.angular_speed,
            np.abs(np.diff(r, axis=0) / step).max(initial=0.0) / arm.extension_speed,
            np.linalg.norm(bent, axis=2).max(initial=0.0) / arm.relative_acceleration,
        ]
        assert (np.array(shares) <= 1.0 + 1e-6).all(), crowd.kind
        used, kinds = np.maximum(used, shares), kinds | {crowd.kind}
        upper, lower = np.linalg.norm(e - s, axis=2), 0.5 * np.linalg.norm(w - e, axis=2)
        for length, (low, high) in ((upper, UPPER_ARM), (lower, HALF_FOREARM)):
            assert (low - 1e-9 <= length).all() and (length <= high + 1e-9).all()
        flexion = np.einsum("tni,tni->tn", e - s, w - e) / (2.0 * upper * lower)
        assert (flexion >= math.cos(arm.elbow) - 1e-6).all()
        moved = np.linalg.norm(np.diff(s, axis=0), axis=2) / step
        assert (moved <= crowd.profile.speed[Point.L_SHOULDER] * (1.0 + 1e-6)).all()
    assert kinds == set(KINDS) and (used > 0.99).all()


def test_who_enters_was_outside_and_is_no_faster_than_the_profile_says(
    rng: np.random.Generator, count: Count
) -> None:
    fastest = 0.0
    for k in range(max(20, count(500))):
        profile = list(PROFILES.values())[k % 3]
        made = entering(rng, profile, 200, aligned=bool(k % 2))
        assert made.at.shape[2] > 50
        speed, watched, record = float(profile.speed.max()), made.watched, made.people[0]
        t, x = in_order(made)
        moved = np.linalg.norm(np.diff(x, axis=0), axis=2) / np.diff(t)[:, None]
        fastest = max(fastest, float(moved.max() / speed))
        assert (moved <= speed * (1.0 + 1e-6)).all()
        slack = 2.0 * (record["stamp_error"] + record["clock_error"]) + watched.detection_time_s
        since = np.abs(t - record["t_complete"]) + slack
        depth = watched.region.depth(x) - watched.boundary_error_m - speed * since[:, None]
        assert (depth <= 1e-9).all()
    assert fastest > 1.0 - 1e-6
