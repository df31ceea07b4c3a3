"""The sensor: weight and bias, base axes, and every fault that is named."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modes.contact.wrench import SensorFault, SensorLimits, SensorWatch, ToolLoad, identify_load
from robots.errors import SetupError

Array = NDArray[np.float64]
SWAPPED = np.array([1, 0, 2, 4, 3, 5])


def readings_of(load: ToolLoad, rotations: Array) -> Array:
    """What a sensor reads by statics: weight in its axes, moment of the weight, bias."""
    out = []
    for turn in rotations:
        weight = turn.T @ np.array([0.0, 0.0, -9.80665 * load.mass_kg])
        moment = np.array(
            [
                load.centre_m[1] * weight[2] - load.centre_m[2] * weight[1],
                load.centre_m[2] * weight[0] - load.centre_m[0] * weight[2],
                load.centre_m[0] * weight[1] - load.centre_m[1] * weight[0],
            ]
        )
        out.append(load.bias + np.concatenate((weight, moment)))
    return np.array(out)


LOAD = ToolLoad(0.8, np.array([0.01, -0.02, 0.06]), np.array([3.0, -2.0, 5.0, 0.1, -0.2, 0.05]))


def test_a_contact_comes_out_in_base_axes_whatever_the_orientation(rng: np.random.Generator) -> None:
    for turn in Rotation.random(50, random_state=3).as_matrix():
        force, moment = rng.normal(size=3) * 20.0, rng.normal(size=3)
        reading = readings_of(LOAD, turn[None])[0] + np.concatenate((turn.T @ force, turn.T @ moment))
        np.testing.assert_allclose(LOAD.contact(reading, turn), np.concatenate((force, moment)), atol=1e-9)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_load_and_bias_are_identified(noise: float, rng: np.random.Generator) -> None:
    turns = Rotation.random(12, random_state=5).as_matrix()
    readings = readings_of(LOAD, turns) + noise * rng.normal(size=(12, 6)) * (1, 1, 1, 0.02, 0.02, 0.02)
    found = identify_load(readings, turns)
    assert found.mass_kg == pytest.approx(0.8, abs=1e-9 + noise / 5.0)
    np.testing.assert_allclose(found.centre_m, LOAD.centre_m, atol=1e-9 + noise / 25.0)
    np.testing.assert_allclose(found.bias, LOAD.bias, atol=1e-9 + 2.0 * noise)


def test_a_swapped_axis_does_not_fit() -> None:
    turns = Rotation.random(12, random_state=5).as_matrix()
    readings = readings_of(LOAD, turns)[:, SWAPPED]
    with pytest.raises(SetupError, match=r"no load fits: .* check the axes of the sensor"):
        identify_load(readings, turns)


def test_orientations_that_do_not_tell_are_refused() -> None:
    upright = np.tile(np.eye(3), (12, 1, 1))
    about_one = Rotation.from_euler("z", np.arange(12.0)[:, None]).as_matrix()
    for turns in (upright, about_one, Rotation.random(3, random_state=1).as_matrix()):
        with pytest.raises(SetupError, match="orientations do not tell weight from bias"):
            identify_load(readings_of(LOAD, turns), turns)


class Feed:
    """A sensor at 1 kHz beside a loop of 12 ms."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.watch, self.rng, self.k = SensorWatch(), rng, 0

    def step(
        self, change: Callable[[Array, Array], tuple[Array, Array]] | None = None
    ) -> Array | SensorFault:
        self.k += 1
        now = 0.012 * self.k
        stamps = now - 0.001 * np.arange(12)[::-1]
        samples = 1.0 + 0.05 * self.rng.normal(size=(12, 6))
        if change is not None:
            stamps, samples = change(stamps, samples)
        return self.watch.take(now, stamps, samples)

    def until(self, change: Callable[[Array, Array], tuple[Array, Array]], steps: int) -> SensorFault | None:
        for _ in range(20):
            assert isinstance(self.step(), np.ndarray)
        for _ in range(steps):
            found = self.step(change)
            if isinstance(found, SensorFault):
                return found
        return None


def replaced(value: float) -> Callable[[Array, Array], tuple[Array, Array]]:
    def change(stamps: Array, samples: Array) -> tuple[Array, Array]:
        samples[7, 2] = value
        return stamps, samples

    return change


@pytest.mark.parametrize(
    ("change", "steps", "fault"),
    [
        (replaced(np.nan), 1, SensorFault.NOT_A_NUMBER),
        (replaced(np.inf), 1, SensorFault.NOT_A_NUMBER),
        (replaced(145.0), 1, SensorFault.SATURATED),
        (replaced(-200.0), 1, SensorFault.SATURATED),
        (lambda t, x: (t, np.full_like(x, 1.0)), 6, SensorFault.FROZEN),
        (lambda t, x: (t[:0], x[:0]), 3, SensorFault.DROPPED),
        (lambda t, x: (t - 5.0, x), 1, SensorFault.CLOCK),
        (lambda t, x: (t + 5.0, x), 1, SensorFault.CLOCK),
        (lambda t, x: (t[::-1].copy(), x), 1, SensorFault.CLOCK),
        (lambda t, x: (np.where(t > 0, np.nan, t), x), 1, SensorFault.NOT_A_NUMBER),
    ],
)
def test_every_fault_is_named_in_time(
    change: Callable[[Array, Array], tuple[Array, Array]],
    steps: int,
    fault: SensorFault,
    rng: np.random.Generator,
) -> None:
    assert Feed(rng).until(change, steps) is fault


def test_a_gap_that_was_filled_up_again_is_dropped_samples(rng: np.random.Generator) -> None:
    feed = Feed(rng)
    for _ in range(5):
        feed.step()
    feed.k += 4
    assert feed.step() is SensorFault.DROPPED


def test_one_late_packet_is_no_fault_and_the_last_reading_stands(rng: np.random.Generator) -> None:
    feed = Feed(rng)
    for _ in range(5):
        feed.step()
    kept = feed.step(lambda t, x: (t[:0], x[:0]))
    assert isinstance(kept, np.ndarray) and np.abs(kept - 1.0).max() < 0.5
    assert isinstance(feed.step(), np.ndarray)


def test_before_the_first_sample_there_is_no_reading() -> None:
    empty = np.empty(0), np.empty((0, 6))
    assert SensorWatch().take(0.0, *empty) is SensorFault.DROPPED


def test_the_mean_of_a_step_keeps_fast_vibration_out() -> None:
    """83.3 Hz of 5 N would be a constant force in the loop, by sampling alone: its mean over 12 ms is 0."""
    watch = SensorWatch()
    for k in range(1, 50):
        stamps = 0.012 * k - 0.001 * np.arange(12)[::-1]
        samples = np.zeros((12, 6))
        samples[:, 0] = 5.0 * np.cos(2.0 * np.pi * stamps / 0.012)
        samples[:, 1] = 1e-6 * np.arange(12)
        found = watch.take(0.012 * k, stamps, samples)
        assert isinstance(found, np.ndarray) and abs(found[0]) < 1e-9
        assert samples[-1, 0] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: ToolLoad(-1.0), "mass_kg = -1.0 should be a number at least 0"),
        (lambda: ToolLoad(1.0, np.zeros(2)), "centre_m = .* should be 3 finite numbers"),
        (lambda: ToolLoad(1.0, np.zeros(3), np.full(6, np.nan)), "bias = .* should be 6 finite numbers"),
        (lambda: SensorLimits(range_N=0.0), "range_N = 0.0"),
        (lambda: SensorLimits(silent_s=float("nan")), "silent_s = nan"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(make: Callable[[], object], text: str) -> None:
    with pytest.raises(SetupError, match=text):
        make()
