"""The paper's simulations against its own numbers (facts: Chan and Tsai 2020, section IV, Table 1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from modes.speed.comparison import hwang_speed, morato_speed
from modes.speed.objective import Goal, Weights
from modes.speed.simulations import Choice, mean_and_deviation, run, simulation
from robots.errors import SetupError

WINDOWS = {1: (15, 20), 2: (8, 22)}
METHODS = ["proposed", "genetic"]


def test_the_arithmetic_of_table_1() -> None:
    """Mean and sample standard deviation of what the two other methods' jerks must have been."""
    assert mean_and_deviation(np.array([5000.0, 0, 0, 0, 0, 0])) == pytest.approx(
        (833.333, 2041.241), abs=5e-4
    )
    six = np.array([5000.0, -5000.0] * 3 + [0.0] * 9)
    assert mean_and_deviation(six) == pytest.approx((0.0, 3273.268), abs=5e-4)
    flips = np.array([5e4, -1e5, 1e5, -1e5, 1e5, -5e4] + [0.0] * 9)
    assert mean_and_deviation(flips) == pytest.approx((0.0, 56694.670), abs=5e-3)


def test_hands_move_as_described() -> None:
    """620 to 700 mm in samples 1 to 9, held until 12, back by 20."""
    z = simulation(1).hands[:, 0, 2]
    assert z[0] == 0.62 and z[8] == pytest.approx(0.70) and (z[8:12] == z[8]).all()
    assert z[12] == pytest.approx(0.69) and z[19] == pytest.approx(0.62) and (z[19:] == z[19]).all()
    np.testing.assert_allclose(simulation(2).hands, simulation(1).hands * (1, -1, 1))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("number", [1, 2])
def test_the_pass_marks_of_the_proposed_method(number: int, method: str) -> None:
    """Paper: goal at sample 29, V(10) 10.79 mm/s, index 0.7596 at 20, below 1, jerk SD 216.2 and 1462.9."""
    found = run(simulation(number), Choice(method))
    assert found.goal_sample == 29
    assert found.danger_index.max() < 1.0
    assert found.danger_index[28] == pytest.approx(0.994, abs=5e-4)
    assert 9.5 < 1e3 * abs(found.speed[9]) < 11.5
    assert 0.70 < found.danger_index[19] < 0.80
    assert 167 < mean_and_deviation(found.jerk(15, 20))[1] < 293
    assert 1422 < mean_and_deviation(found.jerk(8, 22))[1] < 1576


def test_without_the_method_they_collide() -> None:
    """Facts: index up to 1.29 to 1.31 at sample 14, at least 1 from sample 11 on."""
    found = run(simulation(1), Choice("none"))
    assert 1.28 < found.danger_index.max() < 1.32 and found.danger_index.argmax() == 13
    assert int(np.argmax(found.danger_index >= 1.0)) == 10 and found.goal_sample == 25


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("weights", "collides"),
    [
        (Weights(penalty=1.0), True), (Weights(penalty=10.0), False), (Weights(penalty=100.0), False),
        (Weights(closeness=10.0), False), (Weights(closeness=100.0), True),
        (Weights(smoothness=10.0), False), (Weights(smoothness=100.0), True),
    ],
)  # fmt: skip
def test_the_sweeps_of_figures_5_to_7(weights: Weights, collides: bool, method: str) -> None:
    assert (run(simulation(1), Choice(method, weights)).danger_index.max() > 1.0) == collides


def test_moratos_numbers_are_the_papers() -> None:
    """Table 1 and the text: 833.333 and 2041.241 over samples 15 to 20, 0 and 3273.268 over 8 to 22."""
    one, two = run(simulation(1), Choice("morato")), run(simulation(2), Choice("morato"))
    assert mean_and_deviation(one.jerk(15, 20)) == pytest.approx((833.333, 2041.241), abs=5e-4)
    assert mean_and_deviation(two.jerk(8, 22)) == pytest.approx((0.0, 3273.268), abs=5e-4)


def test_the_printed_sign_of_hwangs_objective_rewards_deviation() -> None:
    """With V_p below 0 as printed: from one end of the cap to the other; corrected: the programmed speed."""
    printed = run(simulation(2), Choice("hwang"))
    assert set(np.round(1e3 * np.abs(printed.speed))) == {250.0} and printed.goal_sample is None
    corrected = run(simulation(2), Choice("hwang_corrected"))
    mirrored = run(simulation(1), Choice("hwang"))
    np.testing.assert_allclose(corrected.speed, -mirrored.speed)
    np.testing.assert_array_equal(mirrored.speed, 0.05, "docs: it never slows the arm")


def test_how_near_the_proposed_method_comes_to_the_papers_numbers() -> None:
    """docs/speed.md, *What deviates*: V(10) within 0.7 mm/s, both deviations of the jerk within 8 %."""
    one, two = run(simulation(1), Choice("proposed")), run(simulation(2), Choice("proposed"))
    assert 1e3 * two.speed[9] == pytest.approx(-10.79, abs=0.7)
    (mean, deviation), (other, wide) = (
        mean_and_deviation(each.jerk(*window)) for each, window in ((one, (15, 20)), (two, (8, 22)))
    )
    assert deviation == pytest.approx(216.218, rel=0.08) and wide == pytest.approx(1462.905, rel=0.08)
    assert abs(mean / -267.307 - 1.0) == pytest.approx(0.23, abs=0.005)
    assert abs(other / -1.533 - 1.0) == pytest.approx(0.79, abs=0.005)


def test_the_second_simulation_mirrors_the_first() -> None:
    one, two = run(simulation(1), Choice("proposed")), run(simulation(2), Choice("proposed"))
    np.testing.assert_allclose(one.speed, -two.speed, atol=1e-12)
    np.testing.assert_allclose(one.danger_index, two.danger_index, atol=1e-9)


def test_an_index_of_0_994_is_a_third_of_a_millimetre() -> None:
    """Two balls of 50 mm: √(1 / 0.994) · 100 mm - 100 mm = 0.30 mm; 0.9997 is 0.015 mm."""
    found = run(simulation(1), Choice("proposed"))
    np.testing.assert_allclose(found.gap, 0.1 / np.sqrt(found.danger_index) - 0.1, atol=1e-12)
    assert 0.1 / np.sqrt(0.994) - 0.1 == pytest.approx(0.30e-3, abs=0.005e-3)


def test_more_hands_are_all_looked_at() -> None:
    one = simulation(1)
    far = one.hands + np.array([5.0, 0.0, 0.0])
    both = replace(one, hands=np.concatenate((far, one.hands), axis=1))
    np.testing.assert_allclose(run(both).speed, run(one).speed, atol=1e-9)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: morato_speed(np.array([1.0]), 0.1, 0.0), "threshold of 0.0 m should be above 0"),
        (lambda: hwang_speed(np.ones((1, 3)), Goal(0.1, 0.1), "other"), "sign 'other' should be as_printed"),
        (lambda: replace(simulation(1), hands=np.zeros((5, 0, 3))), "scene simulation 1: hands of shape"),
        (
            lambda: replace(simulation(1), corners=np.zeros((2, 3))),
            "corners should be two or more, and apart",
        ),
    ],
)
def test_what_cannot_be_used_is_refused(make: Callable[[], object], text: str) -> None:
    with pytest.raises(SetupError, match=text):
        make()
