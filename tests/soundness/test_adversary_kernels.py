"""The kernels of the adversary against plain twins, and against laws that bodies and commands must keep."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from failsafe.plan import PlanOutcome, PlanSettings
from failsafe.short_term_plan import ShortTermPlanner
from failsafe.trajectory import IntendedTrajectory
from occupancy.body import LIMBS
from robots.kernels import forward
from tests.oracles.arms import MESH_ARMS
from tests.oracles.arms import arm as oracle_arm
from tests.soundness.adversary_arm import MAX_JOINTS, MOUNTS, ROBOTS, model, surface
from tests.soundness.adversary_kernels import (
    CONTINUITY,
    FOUND,
    JERK,
    VELOCITY,
    commanded,
    go_on,
    hold,
    nearest,
    note,
    on_plan,
    pose,
    which_move,
)
from tests.soundness.adversary_people_kernels import LAST_LIMB, advance_people, see, step_body
from tests.soundness.adversary_planner import posture, trajectory
from tests.soundness.adversary_scene import crowd, random_scene, robot_block

Array = NDArray[np.float64]
Block = NDArray[np.void]


def standing(name: str, q: Array, rng: np.random.Generator) -> Block:
    """A robot block at ``q``, its pose computed."""
    _, robot = robot_block(random_scene(rng, name), q)
    pose(surface(name, 1).block, robot)
    return robot


@pytest.mark.parametrize("name", ROBOTS)
def test_the_arm_is_where_oracle_and_model_have_it(
    name: str, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    shape, robot_model = surface(name, 1), model(name, 1)
    n = len(robot_model.joints)
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = MOUNTS[1].rotation, MOUNTS[1].translation
    for _ in range(count(1_000)):
        q = rng.uniform(-3.0, 3.0, n)
        robot = standing(name, q, rng)[0]
        turns, places = np.zeros((n, 3, 3)), np.zeros((n, 3))
        forward(robot_model.kinematics, q, turns, places)
        assert np.allclose(robot["turn"][:n], turns, rtol=0.0, atol=1e-9)
        assert np.allclose(robot["place"][:n], places, rtol=0.0, atol=1e-9)
        if name not in MESH_ARMS:
            continue
        arm = oracle_arm(name).mounted(base)
        rotations, positions = arm.poses(q[None])
        for link in range(len(arm.links)):
            joint, (low, high) = shape.block[0]["joint"][link], shape.block[0]["first"][link : link + 2]
            mine = shape.points[low:high].reshape(-1, 3) @ robot["turn"][joint].T + robot["place"][joint]
            theirs = arm.points[link] @ rotations[link, 0].T + positions[link, 0]
            assert np.allclose(mine.min(axis=0), theirs.min(axis=0), rtol=0.0, atol=1e-9)
            assert np.allclose(mine.max(axis=0), theirs.max(axis=0), rtol=0.0, atol=1e-9)


def plain_distance(shape: object, robot: np.void, body: Array, parts: tuple, links: list[int]) -> float:
    """Smallest distance of all points of all links from all parts."""
    rec, best = shape.block[0], np.inf
    for link in links:
        joint, (low, high) = rec["joint"][link], rec["first"][link : link + 2]
        points = shape.points[low:high].reshape(-1, 3) @ robot["turn"][joint].T + robot["place"][joint]
        for begin, end, radius in zip(*parts, strict=True):
            a, d = body[begin], body[end] - body[begin]
            share = np.clip((points - a) @ d / max(d @ d, 1e-300), 0.0, 1.0)
            off = np.linalg.norm(points - a - share[:, None] * d, axis=1)
            best = min(best, float(off.min()) - radius - rec["thickness"][link])
    return best


@pytest.mark.parametrize("name", ["ur5", "panda", "lwa4p"])
def test_the_nearest_pair_is_the_nearest_of_all(
    name: str, rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    shape = surface(name, 1)
    clusters = (shape.centre, shape.radius, shape.points)
    n_links = int(shape.block[0]["links"])
    for _ in range(count(2_000)):
        robot = standing(name, rng.uniform(-3.0, 3.0, len(model(name, 1).joints)), rng)
        people = crowd(random_scene(rng, name), rng)
        begin, end, flesh = people.parts
        body = people.block[0]["points"][0] * rng.uniform(0.2, 1.0)
        robot[0]["moving"][:n_links] = rng.random(n_links) < 0.6
        for only_moving in (False, True):
            links = [k for k in range(n_links) if robot[0]["moving"][k] or not only_moving]
            found = np.zeros(1, dtype=FOUND)
            found["distance"] = np.inf
            parts = (begin, end, np.ascontiguousarray(flesh[0]))
            nearest(shape.block, clusters, robot, body, parts, only_moving, found)
            wanted = plain_distance(shape, robot[0], body, parts, links)
            assert found["distance"][0] == pytest.approx(wanted, abs=1e-9)
            if links:
                link, part = int(found["link"][0]), int(found["part"][0])
                apart = np.linalg.norm(found["on_link"][0] - found["on_body"][0])
                less = flesh[0, part] + shape.block[0]["thickness"][link]
                assert link in links and apart - less == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_links_move_that_have_a_fast_point(name: str, rng: np.random.Generator) -> None:
    shape, n = surface(name, 1), len(model(name, 1).joints)
    for _ in range(50):
        q, dq = rng.uniform(-3.0, 3.0, n), rng.normal(size=n) * (rng.random(n) < 0.5) * 3e-3
        here, there = standing(name, q, rng), standing(name, q + 1e-4 * dq, rng)
        here[0]["dq"][:n] = dq
        assert which_move(shape.block, here, shape.centre, 1e-3) == here[0]["moving"].any()
        for link in range(int(shape.block[0]["links"])):
            joint, (low, high) = shape.block[0]["joint"][link], shape.block[0]["first"][link : link + 2]
            ends = [
                shape.centre[low:high] @ robot[0]["turn"][joint].T + robot[0]["place"][joint]
                for robot in (here, there)
            ]
            speed = np.linalg.norm(ends[1] - ends[0], axis=1).max() / 1e-4
            if abs(speed - 1e-3) > 1e-5:
                assert bool(here[0]["moving"][link]) == (speed > 1e-3)


def test_a_plan_is_executed_as_it_was_made(rng: np.random.Generator) -> None:
    """Own evaluation against scipy's, along path and stop; commands off the plan, or jumping, are noticed."""
    arm, h = model("panda", 0), 0.004
    start = (posture(rng, arm.limits), np.zeros(7), np.zeros(7))
    way: IntendedTrajectory | None = trajectory(rng, arm.limits, start, 0.7, 3)
    assert way is not None
    planner = ShortTermPlanner(arm.limits, PlanSettings(h, (0.0, 0.0), np.zeros(7), np.zeros(7)))
    path = PPoly(np.moveaxis(way.coefficients, 1, 0)[::-1], way.breaks)
    for s in np.linspace(0.1, way.s_end - 0.5, 10):
        plan = planner.plan(way, 0.0, float(s))
        assert plan.outcome is PlanOutcome.READY
        plans, robot = robot_block(random_scene(rng, "panda"), start[0])
        robot[0]["cycle"] = h
        robot[0]["limits"][:3, :7] = arm.limits.velocity, arm.limits.acceleration, arm.limits.jerk
        assert hold(plans, robot, planner.path, way.kernel_breaks, way.kernel_coefficients, 0)
        go_on(plans, robot, 0)
        states = []
        for tau in np.arange(0.0, h + plan.stop_time_s + 0.1, 1e-3):
            on_plan(plans, robot, int(robot[0]["slot"]), float(tau))
            states.append([robot[0][key][:7].copy() for key in ("q", "dq", "ddq")])
            if tau <= h:
                assert np.allclose(states[-1][0], path(s + tau), rtol=0.0, atol=1e-10)
                assert np.allclose(states[-1][1], path(s + tau, 1), rtol=0.0, atol=1e-9)
                assert np.allclose(states[-1][2], path(s + tau, 2), rtol=0.0, atol=1e-8)
        q, dq, ddq = (np.array(column) for column in zip(*states, strict=True))
        assert np.allclose(q[-1], path(plan.s_rest), rtol=0.0, atol=1e-9) and not dq[-1].any()
        room = float(arm.limits.jerk.max()) * 1e-6
        assert np.abs(np.diff(q, axis=0) / 1e-3 - 0.5 * (dq[1:] + dq[:-1])).max() < room
        assert np.abs(np.diff(dq, axis=0) / 1e-3 - 0.5 * (ddq[1:] + ddq[:-1])).max() < 1e3 * room
        commanded(plans, robot, 3e-3)
        assert np.allclose(robot[0]["q"][:7], q[3], rtol=0.0, atol=1e-12)
        robot[0]["newest"] = 0
        robot[0]["last"][:, :7] = q[0], dq[0], ddq[0]
        for k in (4, 8, 12):
            note(plans, robot, q[k], dq[k], ddq[k])
        assert not robot[0]["excess"].any()
        note(plans, robot, q[16] + 1e-5, dq[16], ddq[16])
        assert robot[0]["excess"][CONTINUITY] >= 7
        assert robot[0]["excess"].sum() == robot[0]["excess"][CONTINUITY]
        note(plans, robot, q[20], dq[20] + 10.0, ddq[20] + 50.0)
        assert robot[0]["excess"][VELOCITY] and robot[0]["excess"][JERK]
        before = robot[0]["excess"].sum()
        note(plans, robot, np.full(7, np.nan), dq[24], ddq[24])
        assert robot[0]["excess"].sum() >= 7 + before


def test_nobody_is_faster_than_the_profile_or_changes_limbs(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    pairs = np.array([pair for pairs in LIMBS.values() for pair in pairs])
    fastest = 0.0
    for _ in range(count(2_000)):
        scene = random_scene(rng, "ur5")
        people = crowd(scene, rng).block
        near = np.zeros(3, dtype=FOUND)
        near["distance"] = rng.uniform(0.0, 2.0, 3)
        first = people[0]["points"].copy()
        for k in range(20):
            for p in range(scene.persons):
                near["on_body"][p] = people[0]["points"][p, rng.integers(20)]
                near["on_link"][p] = near["on_body"][p] + rng.normal(size=3)
            advance_people(people, near, scene.cycle, k * 0.2, int(rng.integers(4)))
            went = np.linalg.norm(people[0]["points"] - people[0]["before"], axis=2).max() / scene.cycle
            assert went <= scene.speed
            fastest = max(fastest, went / scene.speed)
            for p in range(scene.persons):
                a, b = (np.linalg.norm(x[p, pairs[:, 0]] - x[p, pairs[:, 1]], axis=1) for x in
                        (first, people[0]["points"]))  # fmt: skip
                assert np.allclose(a, b, rtol=0.0, atol=1e-9)
    assert fastest > 0.98, "vacuous: nobody is fast"


def test_a_step_is_never_too_long(rng: np.random.Generator) -> None:
    body, out = rng.normal(size=(20, 3)), np.empty((20, 3))
    for limb in range(LAST_LIMB + 1):
        for spin in (np.zeros(3), rng.normal(size=3), rng.normal(size=3) * 1e3):
            for far in (0.0, 1e-6, 0.04):
                step_body(body, limb, spin, rng.normal(size=3), far, out)
                assert np.linalg.norm(out - body, axis=1).max() <= far


@pytest.mark.parametrize("kind", range(4))
def test_what_is_reported_is_within_the_error(kind: int, rng: np.random.Generator) -> None:
    scene = random_scene(rng, "ur5")
    people = crowd(scene, rng)
    near = np.zeros(3, dtype=FOUND)
    near["on_link"] = rng.normal(size=(3, 3))
    people.block[0]["before"] += rng.normal(size=3)
    error, out = rng.uniform(0.0, 0.05, 20), np.zeros((3, 20, 3))
    for x in (0.0, 0.3, 1.0):
        see(people.block, near, x, kind, error, people.bias, out)
        rec = people.block[0]
        true = (1.0 - x) * rec["before"] + x * rec["points"]
        off = np.linalg.norm(out - true, axis=2)[: scene.persons]
        assert (off <= error).all()
        assert kind == 3 or (off >= 0.999 * error).all()


def test_arms_have_room_in_the_blocks() -> None:
    assert all(len(model(name, 0).joints) <= MAX_JOINTS for name in ROBOTS)
