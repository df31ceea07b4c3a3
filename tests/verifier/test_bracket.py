"""The search for the hardest value that holds: what it tries, and what it may claim."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from robots.errors import SetupError
from verifier.bracket import Bracket, Failure, Scale, Search
from verifier.verdict import Reason

WHY = Failure(1.5, Reason.REACHABLE)


def searched(scale: Scale, holds: Callable[[float], bool], cycles: int = 7) -> Bracket:
    search = Search(scale)
    while (value := search.next) is not None:
        search.tell(cycles, None if holds(value) else WHY)
    return search.bracket


@pytest.mark.parametrize(
    "numbers",
    [
        (0.0, float("nan"), 0.1, 1), (float("inf"), 0.0, 0.1, 1), (0.0, 1.0, 0.0, 1), (0.0, 1.0, -0.1, 1),
        (0.0, 1.0, float("nan"), 1), (0.0, 1.0, 0.1, 0), (0.0, 0.05, 0.1, 1), (1.0, 1.0, 0.1, 1),
    ],
)  # fmt: skip
def test_scales_without_values_are_refused(numbers: tuple[float, float, float, int]) -> None:
    with pytest.raises(SetupError):
        Scale(*numbers)


def test_values_are_decimal_numbers_in_both_directions() -> None:
    assert [Scale(0.0, 0.5, 0.001, 9).value(i) for i in (0, 1, 41, 500)] == [0.0, 0.001, 0.041, 0.5]
    assert [Scale(5.0, 0.1, 0.01, 9).value(i) for i in (0, 1, 490)] == [5.0, 4.99, 0.1]
    assert Scale(5.0, 0.1, 0.01, 9).steps == 490
    assert Scale(0.0, 0.25, 0.1, 1).steps == 2


def test_the_bracket_of_a_threshold_is_a_step_wide(
    rng: np.random.Generator, count: Callable[[int], int]
) -> None:
    for _ in range(count(20_000)):
        a, b = rng.uniform(-5.0, 5.0, 2)
        step = abs(a - b) / rng.uniform(1.0, 300.0)
        scale = Scale(float(a), float(b), float(step), int(rng.integers(1, 80)))
        threshold = int(rng.integers(0, scale.steps + 2))  # so many values hold
        values = [scale.value(i) for i in range(scale.steps + 1)]
        holding = set(values[:threshold])
        found = searched(scale, holding.__contains__)
        assert found.verified_at == (values[threshold - 1] if threshold else None)
        assert found.not_verified_at == (values[threshold] if threshold <= scale.steps else None)
        assert len(found.trials) <= scale.most_trials
        assert len({trial.value for trial in found.trials}) == len(found.trials)


def test_gaps_are_not_jumped_over_unseen(rng: np.random.Generator, count: Callable[[int], int]) -> None:
    """Whatever holds and whatever does not: both ends were tried, nothing that was tried below has failed."""
    for _ in range(count(20_000)):
        scale = Scale(0.0, 1.0, 0.01, int(rng.integers(1, 50)))
        holding = {scale.value(i) for i in np.flatnonzero(rng.uniform(size=101) < 0.8).tolist()}
        found = searched(scale, holding.__contains__)
        tried = {trial.value: trial.failure is None for trial in found.trials}
        if found.verified_at is None:
            assert tried == {0.0: False}
            continue
        assert tried[found.verified_at]
        assert all(ok for value, ok in tried.items() if value <= found.verified_at)
        if found.not_verified_at is None:
            assert found.verified_at == 1.0
            continue
        assert not tried[found.not_verified_at]
        assert found.not_verified_at - found.verified_at == pytest.approx(0.01)
        assert found.failure == WHY


def test_nothing_checked_does_not_hold() -> None:
    found = searched(Scale(0.0, 1.0, 0.1, 1), lambda _value: True, cycles=0)
    assert found.verified_at is None and found.failure is not None
    assert found.failure.text == "no cycle was checked"
    assert WHY.text == "at 1.500 s a person could reach a link before it has stopped"


def test_the_end_of_a_scale_is_the_last_value() -> None:
    found = searched(Scale(0.0, 1.0, 0.1, 4), lambda _value: True)
    assert (found.verified_at, found.not_verified_at, found.failure) == (1.0, None, None)
    assert [trial.value for trial in found.trials] == [0.0, 0.4, 0.8, 1.0]
    with pytest.raises(AssertionError):
        search = Search(Scale(0.0, 0.1, 0.1, 1))
        search.tell(1, WHY)
        search.tell(1, WHY)
