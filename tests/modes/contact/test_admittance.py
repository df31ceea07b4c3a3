"""Admittance and task control: closed forms, passivity, pseudoinverses, and a task that comes to rest."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from modes.contact.admittance import Admittance, CyclicTask, joint_speeds, task_velocity
from robots.errors import SetupError

Array = NDArray[np.float64]
T = 0.012
CORNERS = ((0.3, 0.0, 0.5), (0.3, 0.1, 0.5), (0.3, 0.1, 0.4), (0.3, 0.0, 0.4))


def test_static_gain_and_time_constant() -> None:
    """Facts: 3.33 mm/N, 0.417 s, a pole of 0.9712 at 12 ms; 7 N begin with 56 mm/s, 31.25 N with 250 mm/s."""
    law, place = Admittance(), np.zeros(1)
    assert law.velocity(np.array([7.0]), place, place)[0] == pytest.approx(0.056)
    assert law.velocity(np.array([31.25]), place, place)[0] == pytest.approx(0.250)
    ways = [place[0]]
    for _ in range(500):
        place = place + T * law.velocity(np.array([1.0]), np.zeros(1), place)
        ways.append(place[0])
    assert ways[-1] == pytest.approx(1.0 / 300.0, rel=1e-5)
    to_go = 1.0 / 300.0 - np.array(ways)
    assert to_go[11] / to_go[10] == pytest.approx(0.9712, abs=1e-5)
    continuous = -1.0 / (0.008 * 300.0)
    assert -continuous == pytest.approx(0.4167, abs=1e-4)


def test_without_a_force_it_returns_to_where_it_began() -> None:
    law, begin = Admittance(), np.array([0.3, 0.1, 0.4])
    place = begin + np.array([0.05, -0.02, 0.03])
    for _ in range(500):
        place = place + T * law.velocity(np.zeros(3), begin, place)
    np.testing.assert_allclose(place, begin, atol=1e-6)


def energies(law: Admittance, spring: float, damper: float, begin: tuple[float, float]) -> Array:
    """Energy of the robot's spring and the arm's, step by step, while an arm of a person holds on.

    The arm, a spring to where the person is and a damper, acts on the tool with what it does in this step.
    """
    place, person = begin
    found = []
    for _ in range(400):
        found.append(0.5 * law.stiffness * place**2 + 0.5 * spring * (place - person) ** 2)
        free = float(law.velocity(np.array([-spring * (place - person)]), np.zeros(1), np.array([place]))[0])
        v = free / (1.0 + law.compliance * damper)
        place += T * v
    return np.array(found)


def test_the_closed_loop_is_passive_with_any_arm_of_a_person(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    """Springs of 10 to 10 000 N/m, from soft to far stiffer than any arm: the energy never rises."""
    law = Admittance()
    for _ in range(count(2_000)):
        begin = rng.uniform(-0.1, 0.1), rng.uniform(-0.2, 0.2)
        found = energies(law, 10.0 ** rng.uniform(1.0, 4.0), 10.0 ** rng.uniform(-1.0, 2.0), begin)
        assert (np.diff(found) <= 1e-12).all()


def test_against_something_as_stiff_as_a_wall_it_is_not() -> None:
    """Bound: 2 / (C T) - K = 20 533 N/m. Beyond it the tool hammers, more with every step."""
    bound = 2.0 / (0.008 * T) - 300.0
    assert bound == pytest.approx(20_533, abs=1.0)
    below, above = (energies(Admittance(), bound * factor, 0.0, (0.01, 0.0)) for factor in (0.98, 1.02))
    assert below[-1] < below[0] and above[-1] > 10.0 * above[0]


def test_in_a_cycle_it_takes_in_at_least_what_it_stores(rng: np.random.Generator) -> None:
    """f v T - ΔS = T v² (1/C - K T / 2), S = K e² / 2: not below 0 for every force and place."""
    law = Admittance()
    for _ in range(10_000):
        force, place = rng.normal() * 100.0, rng.normal() * 0.2
        v = float(law.velocity(np.array([force]), np.zeros(1), np.array([place]))[0])
        stored = 0.5 * law.stiffness * ((place + T * v) ** 2 - place**2)
        lost = T * v**2 * (1.0 / law.compliance - 0.5 * law.stiffness * T)
        assert force * v * T - stored == pytest.approx(lost, abs=1e-9) and lost >= 0.0


def test_speeds_are_next_to_the_wanted_ones(rng: np.random.Generator) -> None:
    """Against NumPy's pseudoinverse, both forms of (5)."""
    for n in (6, 7):
        for _ in range(200):
            jacobian, velocity, wanted = rng.normal(size=(3, n)), rng.normal(size=3), rng.normal(size=n)
            found = joint_speeds(jacobian, velocity, wanted)
            inverse = np.linalg.pinv(jacobian)
            np.testing.assert_allclose(found, wanted + inverse @ (velocity - jacobian @ wanted), atol=1e-8)
            first = inverse @ velocity + (np.eye(n) - inverse @ jacobian) @ wanted
            np.testing.assert_allclose(found, first, atol=1e-8)
            np.testing.assert_allclose(jacobian @ found, velocity, atol=1e-8)


def test_at_a_singularity_speeds_stay_bounded() -> None:
    """The tool cannot move along x: the more it is wanted to, the more joints would turn."""
    for small in (0.0, 1e-9, 1e-6, 1e-4, 1e-3):
        jacobian = np.diag([small, 0.5, 0.5]) @ np.eye(3, 6)
        speeds = joint_speeds(jacobian, np.array([0.25, 0.1, 0.0]), np.zeros(6))
        assert np.isfinite(speeds).all() and np.abs(speeds).max() < 5.0, small


def test_the_error_of_the_task_is_taken_back() -> None:
    np.testing.assert_allclose(
        task_velocity(np.array([0.1, 0.0, 0.0]), np.zeros(3), np.array([0.0, 0.02, 0.0]), 2.0),
        [0.1, 0.04, 0.0],
    )


def test_the_task_goes_round_its_corners_and_rests_there() -> None:
    task = CyclicTask(CORNERS, leg_s=2.0)
    for k in range(9):
        place, speed = task.at(2.0 * k)
        np.testing.assert_allclose(place, CORNERS[k % 4], atol=1e-12)
        np.testing.assert_allclose(speed, 0.0, atol=1e-12)
    for t in np.linspace(0.01, 15.99, 333):
        quotient = (task.at(t + 1e-6)[0] - task.at(t - 1e-6)[0]) / 2e-6
        np.testing.assert_allclose(task.at(t)[1], quotient, atol=1e-6)
        leg = int(t // 2.0) % 4
        here, there = np.array(CORNERS[leg]), np.array(CORNERS[(leg + 1) % 4])
        aside = np.cross(task.at(t)[0] - here, there - here)
        assert np.linalg.norm(aside) < 1e-12


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Admittance(compliance=0.0), "compliance = 0.0 should be a number above 0"),
        (lambda: Admittance(stiffness=-1.0), "stiffness = -1.0"),
        (lambda: Admittance(period_s=math.nan), "period_s = nan"),
        (lambda: Admittance(0.5, 300.0), "compliance 0.5 times stiffness 300 should be below 1 / period_s"),
        (lambda: CyclicTask(np.zeros((1, 3))), "1 corner, two or more are needed"),
        (lambda: CyclicTask(np.zeros((4, 2))), "corners = .* should be any by 3 finite numbers"),
        (lambda: CyclicTask(np.full((4, 3), np.nan)), "corners = .* should be any by 3 finite numbers"),
        (lambda: CyclicTask(CORNERS, leg_s=0.0), "leg_s = 0.0"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(make: Callable[[], object], text: str) -> None:
    with pytest.raises(SetupError, match=text):
        make()
