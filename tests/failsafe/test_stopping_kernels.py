"""Bounds over boxes of configurations: the tests' own kinematics, finite differences, samples in the box."""

from __future__ import annotations

import numpy as np
import pytest

from failsafe import box_kernels
from failsafe import stopping_kernels as kernels
from failsafe.box_search import arm_points
from robots.kernels import forward
from robots.motion import MAX_JOINTS
from tests.failsafe.arm_speeds import energies, extensions, jacobians, speeds
from tests.occupancy.arms import ARMS, STROKE, arm

SAMPLES = 300


def prepared(model, q, dq, point):
    """Work block after `columns` at q, and its arrays."""
    work = np.zeros(1, dtype=kernels.WORK)
    forward(model.kinematics, q, work["rotation"][0], work["position"][0])
    kernels.columns(model.kinematics, point, dq, work)
    return work


def random_box(rng: np.random.Generator, model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre, half-widths (0 for first joints) and speeds; strokes are kept."""
    tree = model.kinematics[0]
    n = int(tree["n"])
    sliding = tree["prismatic"][:n].astype(bool)
    half = 10.0 ** rng.uniform(-3.0, 0.5) * rng.random(n)
    half = np.where(sliding, np.minimum(half, STROKE), half)
    half[tree["parent"][:n] < 0] = 0.0
    room = np.where(sliding, STROKE - half, np.pi)
    dq = rng.choice([-1.0, 0.0, 1.0], n, p=[0.45, 0.1, 0.45]) * rng.uniform(0.5, 3.0, n)
    return rng.uniform(-1.0, 1.0, n) * room, half, dq


def inside(rng: np.random.Generator, centre, half) -> np.ndarray:
    """Configurations in a box, every third at a corner."""
    x = rng.uniform(-1.0, 1.0, (SAMPLES, len(centre)))
    x[::3] = np.sign(x[::3])
    return centre + x * half


def padded(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values, np.zeros(MAX_JOINTS - len(values))])


@pytest.mark.parametrize("name", ARMS)
def test_velocity_and_slopes_at_the_centre(name, rng, count):
    for _ in range(count(300)):
        model = arm(name, rng)
        n = len(model.joints)
        q, _, dq = random_box(rng, model)
        for point in arm_points(model)[0]:
            block = prepared(model, q, dq, point)
            kernels.slopes(point["m"], block)
            work = block[0]
            linear, angular = jacobians(model, q[None], int(point["joint"]), point["place"])
            chain = point["chain"][: point["m"]]
            assert np.allclose(work["column"][: point["m"]], linear[0].T[chain], atol=1e-12)
            assert np.allclose(work["tail"][0], linear[0] @ dq, atol=1e-12)
            assert np.allclose(work["twist"][point["m"]], angular[0] @ dq, atol=1e-12)
            h = 1e-6
            for k, j in enumerate(chain):
                step = h * np.eye(n)[j]
                ahead, behind = (
                    jacobians(model, (q + s * step)[None], int(point["joint"]), point["place"])
                    for s in (1, -1)
                )
                for field, index in (("slope", 0), ("turning", 1)):
                    if field == "turning" and k <= 0:
                        continue
                    slope = (ahead[index][0] - behind[index][0]) @ dq / (2.0 * h)
                    assert np.allclose(work[field][k], slope, atol=1e-7), (field, k)


@pytest.mark.parametrize("name", ARMS)
def test_no_speed_in_the_box_is_above_its_bound(name, rng, count):
    closest = 0.0
    for _ in range(count(3_000)):
        model = arm(name, rng)
        centre, half, dq = random_box(rng, model)
        points = arm_points(model)[0]
        point = points[rng.integers(len(points))]
        if rng.random() < 0.5:
            point["ball"] = 0.0
        value, bound, split = kernels.speed_bound(
            model.kinematics, point, padded(half), prepared(model, centre, dq, point)
        )
        q = inside(rng, centre, half)
        seen = speeds(model, q, np.tile(dq, (SAMPLES, 1)), point)
        assert value == pytest.approx(speeds(model, centre[None], dq[None], point)[0], abs=1e-12)
        assert seen.max() <= bound * (1.0 + 1e-12) + 1e-12
        assert split == -1 or half[split] > 0.0
        if bound > 0.0 and (half.max() > 0.1 or len(half) == 1):
            closest = max(closest, seen.max() / bound)
    assert closest > 0.9, "vacuous: no speed comes near to its bound"


@pytest.mark.parametrize("name", ARMS)
def test_bounds_of_lengths_and_second_derivatives(name, rng, count):
    largest = 0.0
    for _ in range(count(400)):
        model = arm(name, rng)
        n = len(model.joints)
        centre, half, dq = random_box(rng, model)
        points = arm_points(model)[0]
        point = points[rng.integers(len(points))]
        m, chain = int(point["m"]), point["chain"]
        work = prepared(model, centre, dq, point)
        kernels._largest(point, padded(half), work)
        box = work[0].copy()
        for q in inside(rng, centre, half)[:12]:
            here = prepared(model, q, dq, point)
            there = here[0]
            for k in range(m):
                assert np.linalg.norm(there["tail"][k]) <= box["fast"][k] + 1e-9
                assert np.linalg.norm(there["column"][k]) <= box["reach"][k] + 1e-9
                for i in range(k + 1):
                    turned = np.linalg.norm(there["twist"][k + 1] - there["twist"][i])
                    assert turned <= box["spin"][i, k + 1] + 1e-9
            h = 1e-6
            for k in range(1, m):
                step = h * np.eye(n)[chain[k]]
                ahead, behind = prepared(model, q + step, dq, point), prepared(model, q - step, dq, point)
                kernels.slopes(m, ahead)
                kernels.slopes(m, behind)
                for i in range(1, k + 1):
                    second = (ahead[0]["slope"][i] - behind[0]["slope"][i]) / (2.0 * h)
                    bend = kernels._bend(i, k, work)
                    assert np.linalg.norm(second) <= bend + 1e-6
                    largest = max(largest, np.linalg.norm(second) / max(bend, 1e-3))
    if sum(kind == "R" for kind in ARMS[name]) > 1 and name != "slide_then_turn":
        assert largest > 0.5, "vacuous: no second derivative comes near to its bound"


@pytest.mark.parametrize("name", ARMS)
def test_no_energy_in_the_box_is_above_its_bound(name, rng, count):
    for _ in range(count(1_500)):
        model = arm(name, rng)
        centre, half, dq = random_box(rng, model)
        points = arm_points(model)[0]
        points["mass"] = rng.uniform(0.1, 5.0, len(points))
        work = np.zeros(1, dtype=kernels.WORK)
        forward(model.kinematics, centre, work["rotation"][0], work["position"][0])
        value, bound, split = kernels.energy_bound(
            model.kinematics, points, dq, padded(half), len(centre), work
        )
        q = inside(rng, centre, half)
        seen = energies(model, q, np.tile(dq, (SAMPLES, 1)), points)
        assert value == pytest.approx(
            energies(model, centre[None], dq[None], points)[0], rel=1e-12, abs=1e-12
        )
        assert seen.max() <= bound * (1.0 + 1e-12) + 1e-12
        assert split == -1 or half[split] > 0.0
        if half.max() < 0.02:
            assert bound <= 1.2 * max(value, 0.1) + 1.0, "far too large for a small box"


@pytest.mark.parametrize("name", ARMS)
def test_extension_at_the_centre_and_least_in_the_box(name, rng, count):
    for _ in range(count(1_500)):
        model = arm(name, rng)
        centre, half, _ = random_box(rng, model)
        points = arm_points(model)[0]
        work = np.zeros(1, dtype=kernels.WORK)
        forward(model.kinematics, centre, work["rotation"][0], work["position"][0])
        here, least = kernels.extension(model.kinematics, points, padded(half), work)
        assert here == pytest.approx(extensions(model, centre[None], points)[0], abs=1e-12)
        assert least <= extensions(model, inside(rng, centre, half), points).min() + 1e-12
        if half.max() < 1e-2:
            assert least >= here - 0.2


def test_the_fastest_point_of_a_ball(rng, count):
    closest = 0.0
    for _ in range(count(20_000)):
        v, w, radius = rng.normal(size=3), rng.normal(size=3), rng.uniform(0.0, 1.0)
        away = rng.normal(size=(SAMPLES, 3))
        away *= radius / np.linalg.norm(away, axis=1)[:, None]
        seen = np.linalg.norm(v + np.cross(w, away), axis=1).max()
        bound = kernels.fastest_of_ball(v, w, radius)
        assert seen <= bound + 1e-12
        closest = max(closest, seen / bound)
    assert closest > 0.995
    assert kernels.fastest_of_ball(np.array([1.0, 2.0, 2.0]), np.zeros(3), 1.0) == 3.0
    assert kernels.fastest_of_ball(np.array([0.0, 0.0, 3.0]), np.array([0.0, 0.0, 4.0]), 1.0) == 5.0


def test_turning_that_only_its_second_derivative_bounds(rng):
    """Two axes along each other, run against each other at 2 and 1 rad/s, and a third across between them.

    Turned by x, ‖ω‖² = 5 - 4 cos x: least at the centre of the box, where its first derivative is 0.
    """
    model = arm("six", rng)
    tree = model.kinematics[0]
    tree["rotation"][:6], tree["translation"][:6] = np.eye(3), 0.0
    tree["axis"][:3] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    points = arm_points(model)[0]
    point = points[points["joint"] == 2][0]
    point["place"], point["ball"] = 0.0, 0.5
    dq, half = padded(np.array([2.0, 0.0, -1.0])), np.zeros(MAX_JOINTS)
    for half[1] in (0.01, 0.1, 0.5, 1.0):
        work = prepared(model, np.zeros(6), dq, point)
        value, bound, _ = kernels.speed_bound(model.kinematics, point, half, work)
        assert value == pytest.approx(0.5, rel=1e-12)
        assert 0.5 * np.sqrt(5.0 - 4.0 * np.cos(half[1])) <= bound <= 0.5 * 3.0 * (1.0 + 1e-6)


def test_energy_that_only_the_second_derivative_bounds(rng):
    """A mass on the first axis, which the second one, across it, moves along it: off it by L (1 - cos x)."""
    model = arm("six", rng)
    tree, length = model.kinematics[0], 0.4
    tree["rotation"][:6], tree["translation"][:6] = np.eye(3), 0.0
    tree["translation"][1] = [0.0, -length, 0.0]
    tree["axis"][:2] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    points = arm_points(model)[0]
    points = points[points["joint"] == 1][:1]
    points["place"], points["mass"], points["reach"] = [0.0, length, 0.0], 2.0, np.inf
    dq, half = padded(np.array([3.0])), np.zeros(MAX_JOINTS)
    for half[1] in (0.01, 0.1, 0.5, 1.0):
        work = np.zeros(1, dtype=kernels.WORK)
        forward(model.kinematics, np.zeros(6), work["rotation"][0], work["position"][0])
        value, bound, _ = kernels.energy_bound(model.kinematics, points, dq, half, 6, work)
        assert value == 0.0
        assert (3.0 * length * (1.0 - np.cos(half[1]))) ** 2 <= bound
        assert bound <= (3.0 * length * half[1] ** 2) ** 2 * (1.0 + 1e-6), "far too large"


def test_what_is_not_a_number_bounds_nothing(rng):
    model = arm("six", rng)
    points = arm_points(model)[0]
    task, state = np.zeros(1, dtype=box_kernels.TASK), np.zeros(1, dtype=box_kernels.STATE)
    task["n"], task["extension"], task["speed"] = 6, np.inf, 1.0
    nodes = np.zeros(1, dtype=box_kernels.NODES)
    nodes["bound"], nodes["half"] = np.inf, 0.1
    nodes["centre"][0, 3] = np.nan
    work = np.zeros(1, dtype=kernels.WORK)
    nodes["point"] = len(points) - 1
    box_kernels.evaluate(model.kinematics, points, task, nodes[0], work, state)
    assert nodes["bound"][0] == np.inf
    assert state["best"][0] == 0.0
