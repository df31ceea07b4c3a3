"""What a simulation is made of: people who obey their profile, a robot and sensors that obey the cell."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from failsafe.running_plan import Motion
from occupancy.body import MAX_POINTS, Part, Point, load_profile
from robots.limits import JointLimits
from tests.failsafe.motions import limits_of
from tests.occupancy.arms import place
from verifier.cell import Cell
from verifier.cell_tables import Tracking
from verifier.command import Running, State
from verifier.scripted_people import Goal, Place, ScriptedPeople
from verifier.setup import build_robot
from verifier.simulated_contacts import Distances
from verifier.simulated_robot import QUANTITIES, SimulatedRobot
from verifier.simulated_sensors import Sensors, SensorSettings

Array = NDArray[np.float64]
Count = Callable[[int], int]
PLACE = Place(np.array([0.2, -0.1]), -0.8, 1.0, 0.7)
WITHOUT = Tracking(position_error_rad=0.0)


def lived(people: ScriptedPeople, rng: np.random.Generator, dt: float, steps: int, finer: int) -> Array:
    """Points (T, persons, 20, 3) at even times, with goals and states that change at random."""
    rows, goals, state = [people.points(0.0)], [], State.EXECUTING
    for k in range(steps):
        if k % 20 == 0:
            state = State(int(rng.integers(4)))
            near = rng.uniform(0.0, 2.0)
            on_link = np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.5, 1.0)])
            goals = [Goal(near, on_link, xyz[rng.integers(MAX_POINTS)]) for xyz in rows[-1]]
        people.set_out(k * dt, dt, goals, state)
        rows += [people.points(dt * (i + 1) / finer) for i in range(finer)]
    return np.array(rows)


@pytest.mark.parametrize(("name", "used"), [("iso", 0.99), ("tum", 0.6), ("extreme", 0.6)])
def test_people_obey_the_profile(name: str, used: float, rng: np.random.Generator, count: Count) -> None:
    """Finite differences are means: no bound of the motion can be below them."""
    profile, finer = load_profile(name), 3
    fastest = np.zeros(MAX_POINTS)
    for _ in range(count(300)):
        dt = float(rng.choice([0.001, 0.004, 0.01]))
        people = ScriptedPeople(profile, 2, PLACE, rng)
        x = lived(people, rng, dt, 800, finer)
        h = dt / finer
        speed = np.linalg.norm(np.diff(x, axis=0), axis=-1) / h
        assert (speed <= profile.speed * (1.0 + 1e-9) + 1e-9).all()
        fastest = np.maximum(fastest, speed.max(axis=(0, 1)) / profile.speed)
        swing = np.linalg.norm(np.diff(x, n=2, axis=0), axis=-1) / h**2
        assert (swing <= profile.acceleration * (1.0 + 1e-9) + 1e-6).all()
        assert np.isfinite(x).all()
    assert fastest.max() > used, "nobody uses what the profile allows"


def test_people_who_are_faster_do_not_obey(rng: np.random.Generator) -> None:
    profile = load_profile("iso")
    x = lived(ScriptedPeople(profile, 1, PLACE, rng, faster=1.5), rng, 0.01, 500, 1)
    speed = np.linalg.norm(np.diff(x, axis=0), axis=-1) / 0.01
    assert 1.4 * profile.speed.max() < speed.max() <= 1.5 * profile.speed.max() * (1.0 + 1e-9)


@pytest.mark.parametrize("name", ["iso", "tum", "extreme"])
def test_limbs_keep_lengths_that_the_profile_knows(name: str, rng: np.random.Generator) -> None:
    profile = load_profile(name)
    body = profile.limits[0]
    for _ in range(20):
        x = lived(ScriptedPeople(profile, 8, PLACE, rng), rng, 0.01, 100, 1)
        for row in range(int(body["n_limbs"])):
            a, b = body["limb"][row]
            length = np.linalg.norm(x[:, :, a] - x[:, :, b], axis=-1)
            assert np.ptp(length, axis=0).max() < 1e-9
            assert (length >= body["limb_min"][row]).all() and (length <= profile.chain[a, b] + 1e-9).all()
        assert (x[:, :, [Point.L_ANKLE, Point.R_ANKLE], 2] > PLACE.floor_m).all()


def test_arms_stay_where_shoulders_let_them(rng: np.random.Generator) -> None:
    profile = load_profile("tum")
    people = ScriptedPeople(profile, 4, PLACE, rng)
    x = lived(people, rng, 0.01, 2000, 1)
    for shoulder, elbow in ((Point.L_SHOULDER, Point.L_ELBOW), (Point.R_SHOULDER, Point.R_ELBOW)):
        arm = x[:, :, elbow] - x[:, :, shoulder]
        down = -arm[..., 2] / np.linalg.norm(arm, axis=-1)
        assert (np.arccos(np.clip(down, -1.0, 1.0)) < 2.6).all()


def test_hands_lie_in_the_balls_around_their_points(rng: np.random.Generator) -> None:
    profile = load_profile("iso")
    people = ScriptedPeople(profile, 8, PLACE, rng, held_m=0.1)
    for p, xyz in enumerate(people.points(0.0)):
        flesh = people.flesh[p]
        for row in np.flatnonzero(flesh.part == Part.L_HAND):
            ends = xyz[[flesh.begin[row], flesh.end[row]]]
            for point in (Point.L_WRIST, Point.L_HAND, Point.L_FINGERTIP):
                reach = np.linalg.norm(ends - xyz[point], axis=1).max() + flesh.radius[row]
                assert reach <= profile.radius[Part.L_HAND] + 0.1 + 1e-12


def test_the_same_seed_gives_the_same_people() -> None:
    a, b = (
        lived(ScriptedPeople(load_profile("tum"), 3, PLACE, np.random.default_rng(seed)),
              np.random.default_rng(1), 0.01, 300, 1)
        for seed in (5, 5)
    )  # fmt: skip
    assert np.array_equal(a, b)


# The robot


class Swing:
    """A plan that moves along a sine from t = 0.1 s to 1.5 s, and rests before and after."""

    def __init__(self, size: float = 0.5, rate: float = 2.0 * np.pi / 0.7) -> None:
        self.size, self.rate = size, rate

    def motion(self, t: float) -> Motion:
        """q = size · sin²(rate (t - 0.1) / 2)² keeps q, dq, ddq continuous."""
        x = self.rate * (min(max(t, 0.1), 1.5) - 0.1)
        s, c = np.sin(0.5 * x), np.cos(0.5 * x)
        q, dq = s**4, 2.0 * self.rate * s**3 * c
        ddq = self.rate**2 * s**2 * (3.0 * c**2 - s**2)
        values = (np.array([self.size * v, -self.size * v]) for v in (q, dq, ddq))
        return Motion(*values)


def followed(plan: Swing, tracking: Tracking, seed: int, limits: JointLimits | None = None):
    """Times, true and commanded-velocity rows of a robot that follows a plan; and the robot."""
    wide = limits_of(np.full(2, 50.0), np.full(2, 500.0), np.full(2, 2e4), [-3.0, -3.0], [3.0, 3.0])
    robot = SimulatedRobot(limits or wide, tracking, 0.01, np.zeros(2), np.random.default_rng(seed))
    times, rows = [], []
    for k in range(200):
        robot.next_cycle(k)
        robot.hold(Running(plan, 0.0), (k + 1) * 0.01)
        for i in range(7):
            times.append(0.01 * (k + i / 7))
            rows.append(robot.at(times[-1]).q)
    return np.array(times), np.array(rows), robot


def test_the_robot_follows_within_delay_and_error(rng: np.random.Generator, count: Count) -> None:
    plan, errors, lags = Swing(), [], []
    for _ in range(count(200)):
        low, wide, error = rng.uniform(0.0, 0.01), rng.uniform(0.0, 0.02), float(rng.choice([0.0, 0.01]))
        tracking = Tracking(position_error_rad=error, delay_min_s=low, delay_max_s=low + wide)
        times, rows, _ = followed(plan, tracking, int(rng.integers(1000)))
        best = np.inf
        for lag in np.linspace(low, low + wide, 41):
            commanded = np.array([plan.motion(t - lag).q for t in times])
            best = min(best, float(np.abs(rows - commanded).max()))
        assert best <= error + 2e-3 * wide / 0.02 + 1e-5  # 41 lags: half a spacing at 8 rad/s
        errors.append(np.abs(rows[0]).max())
        offsets = rows - rows[0]
        assert np.ptp(offsets[:20], axis=0).max() == 0.0
        lags.append(best)
    assert max(errors) > 1e-3


def test_a_declared_velocity_error_is_used_and_kept() -> None:
    tracking = Tracking(position_error_rad=0.01, velocity_error_rad_s=0.05)
    plan = Swing()
    times, rows, _ = followed(plan, tracking, 3)
    error = rows - np.array([plan.motion(t).q for t in times])
    assert np.abs(error).max() <= 0.01 + 1e-6
    rate = np.abs(np.diff(error, axis=0)) / np.diff(times)[:, None]
    assert 0.03 < rate.max() <= 0.05 + 1e-3


def test_limits_that_are_exceeded_are_counted() -> None:
    _, _, robot = followed(Swing(), WITHOUT, 0)
    assert not any(robot.exceeded.values())
    at = [Swing().motion(t) for t in np.linspace(0.0, 1.6, 20_001)]
    top = [max(np.abs(m[i]).max() for m in at) for i in (1, 2)]
    narrow = limits_of(
        np.full(2, 0.9 * top[0]), np.full(2, 0.9 * top[1]), np.full(2, 10.0), [-0.4, -0.4], [0.4, 0.4]
    )
    _, _, robot = followed(Swing(), WITHOUT, 0, narrow)
    assert all(robot.exceeded[name] > 0 for name in QUANTITIES if name != "jump"), robot.exceeded
    assert robot.worst["velocity"] == pytest.approx(1.0 / 0.9, rel=0.01)
    assert robot.worst["acceleration"] == pytest.approx(1.0 / 0.9, rel=0.01)
    assert robot.worst["position"] == pytest.approx(0.5 / 0.4, rel=0.01)


def test_a_jump_is_counted() -> None:
    """By less than what anything else would show."""

    class Jumps(Swing):
        def motion(self, t: float) -> Motion:
            q, dq, ddq = super().motion(t)
            return Motion(q + (1e-4 if t > 0.5 else 0.0), dq, ddq)

    _, _, robot = followed(Jumps(), WITHOUT, 0)
    assert robot.exceeded == {**dict.fromkeys(QUANTITIES, 0), "jump": 1}


def test_what_is_not_a_number_exceeds_the_limits() -> None:
    plan = SimpleNamespace(motion=lambda t: Motion(*(np.full(2, np.nan) for _ in range(3))))
    _, _, robot = followed(plan, WITHOUT, 0)
    assert min(robot.exceeded.values()) > 0


# The sensors


def test_sensors_keep_to_what_is_declared(rng: np.random.Generator) -> None:
    settings = SensorSettings(30.0, 0.03, 0.01, 0.3, 0.02, 0.004)
    sensors = Sensors(settings, rng)
    speed, reports, cycle = 1.7, [], 0.01
    for k in range(2000):
        t = k * cycle
        sensors.look(t, cycle, lambda tau, t=t: np.full((2, MAX_POINTS, 3), speed * (t + tau)))
        reports += [(t, report) for report in sensors.arrived(t)]
    assert sensors.seen == 600 and 120 < sensors.lost < 240
    for now, report in reports:
        seen = round(report.stamp * 30.0) / 30.0
        assert abs(report.stamp - seen) <= 0.004 + 1e-12 and report.complete
        assert seen + 0.03 - 1e-12 <= report.arrived <= seen + 0.04 + 1e-12
        assert report.arrived <= now < report.arrived + cycle + 1e-12
        off = np.array([person.xyz - speed * seen for person in report.people])
        assert np.linalg.norm(off, axis=-1).max() <= 0.02
    assert len(reports) > 350


# Distances


def segments_apart(a: Array, b: Array, c: Array, d: Array) -> float:
    """Distance of the segments ab and cd [m]: least squares within bounds."""
    found = lsq_linear(np.column_stack([b - a, c - d]), c - a, bounds=(0.0, 1.0), tol=1e-14)
    return float(np.sqrt(2.0 * found.cost))


def test_distances_are_those_of_segments(rng: np.random.Generator, count: Count) -> None:
    robot = build_robot(Cell.from_table({"robot": {"name": "ur5", "bare_flange": True}}))
    rows, n = robot.enclosure[0], len(robot.links)
    people = ScriptedPeople(load_profile("iso"), 1, PLACE, rng)
    start = people.points(0.0)
    distances, flesh = Distances(robot, people.flesh, start), people.flesh[0]
    for _ in range(count(1000)):
        q, dq = rng.uniform(-2.0, 2.0, 6), rng.normal(size=6)
        xyz = (
            start[0] - start[0, Point.PELVIS] + np.array([*rng.uniform(-1.5, 1.5, 2), rng.uniform(-0.5, 0.5)])
        )
        pairs = rng.random((n, len(flesh.part))) < 0.3
        pairs[0, 0] = True
        arm = distances.arm(q, dq)
        found = distances.nearest(arm, 0, xyz, pairs)
        local = np.stack([rows["a"][:n], rows["b"][:n]], axis=1)
        ends = place(robot, q, local)
        np.testing.assert_allclose(np.stack([arm.a, arm.b], axis=1), ends, atol=1e-9)
        late = (place(robot, q + 1e-6 * dq, local) - place(robot, q - 1e-6 * dq, local)) / 2e-6
        assert (arm.speed >= np.linalg.norm(late, axis=-1).max(axis=1) - 1e-6).all()
        true = np.array(
            [
                [
                    segments_apart(*ends[i], xyz[flesh.begin[j]], xyz[flesh.end[j]])
                    - rows["radius"][i] - flesh.radius[j] if pairs[i, j] else np.inf
                    for j in range(len(flesh.part))
                ]
                for i in range(n)
            ]
        )  # fmt: skip
        assert found is not None
        if true.min() > -0.02:  # deeper, the axes may cross, and no distance of segments is left
            assert found.distance == pytest.approx(true.min(), abs=1e-5)
            apart = np.linalg.norm(found.on_link - found.on_body)
            assert apart == pytest.approx(abs(found.distance), abs=1e-5)
        else:
            assert found.distance < 0.0
        assert distances.nearest(arm, 0, xyz, pairs, true.min() - 1e-3) is None or true.min() < -0.02


def test_the_fastest_point_of_a_link_counts_its_surface() -> None:
    robot = build_robot(Cell.from_table({"robot": {"name": "ur5", "bare_flange": True}}))
    people = ScriptedPeople(load_profile("iso"), 0, PLACE, np.random.default_rng(0))
    distances = Distances(robot, people.flesh, people.points(0.0))
    last = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])  # the last wrist only turns about its own axis
    speed = distances.arm(np.zeros(6), last).speed
    assert speed[-1] > 0.03 and (speed[:-1] == 0.0).all()
