"""Frequency responses of the paper's filters against facts/admittance, sines that are run, and SciPy."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from modes.contact.filters import (
    RATE_HZ,
    VARIANTS,
    Filter,
    Stream,
    current_high_pass,
    current_low_pass,
    force_high_pass,
    force_low_pass,
)
from robots.errors import SetupError

Array = NDArray[np.float64]
ALL = (current_high_pass, current_low_pass, force_high_pass, force_low_pass)


def test_the_printed_current_high_pass_is_a_smoothed_difference() -> None:
    """Facts: DC 3e-7, Nyquist 0.774, peak 1.226 at 20 Hz, 0.894 at 10 Hz, 7.48, 9.60 and 11.7 Hz."""
    printed = current_high_pass("as_printed")
    assert printed.gain(0.0)[0] < 5e-7 and printed.gain(0.5 * RATE_HZ)[0] == pytest.approx(0.774, abs=5e-4)
    highest, at = printed.highest_gain()
    assert highest == pytest.approx(1.226, abs=5e-4) and at == pytest.approx(20.0, abs=0.1)
    assert printed.gain(10.0)[0] == pytest.approx(0.894, abs=5e-4)
    assert printed.gain(11.7)[0] == pytest.approx(1.0, abs=5e-3)
    assert printed.cut_off_hz() == pytest.approx(7.48, abs=0.01)
    assert printed.cut_off_hz(of_highest=True) == pytest.approx(9.60, abs=0.01)
    hann = np.sin(np.pi * np.arange(1, 5) / 5.0) ** 2 * (-1, -1, 1, 1)
    np.testing.assert_allclose(printed.b, 0.69237 * hann, rtol=2e-4)
    stepped = lfilter(printed.b, printed.a, np.ones(6))
    np.testing.assert_allclose(stepped[:4], [-0.239, -0.866, -0.239, 0.0], atol=1e-3)


def test_the_corrected_one_is_a_chebyshev_filter_with_feedback() -> None:
    """Facts: 0.4525 (1, -3, 3, -1) over 1 - 1.4996, 0.9667, -0.1532, half a decibel down at 10 Hz."""
    corrected = current_high_pass("corrected")
    np.testing.assert_allclose(corrected.b, 0.4525 * np.array([1.0, -3.0, 3.0, -1.0]), atol=3e-4)
    np.testing.assert_allclose(corrected.a, [1.0, -1.4996, 0.9667, -0.1532], atol=1e-4)
    assert 20.0 * math.log10(corrected.gain(10.0)[0]) == pytest.approx(-0.5, abs=1e-6)
    assert corrected.gain(0.0)[0] < 1e-12 and corrected.gain(0.5 * RATE_HZ)[0] == pytest.approx(1.0)


def test_the_force_high_pass_has_the_low_pass_coefficient_as_printed() -> None:
    """Facts: 0.5307 instead of 0.4693; an RC of 11.73 Hz; 7.89 Hz, 0.693 at high frequencies."""
    printed, corrected = force_high_pass("as_printed"), force_high_pass("corrected")
    assert printed.b[0] == pytest.approx(0.5307, abs=5e-5)
    assert corrected.b[0] == pytest.approx(0.4693, abs=5e-5)
    assert (1.0 / printed.b[0] - 1.0) * RATE_HZ / (2.0 * math.pi) == pytest.approx(11.73, abs=0.01)
    assert printed.cut_off_hz(of_highest=True) == pytest.approx(7.89, abs=0.01)
    assert printed.gain(0.5 * RATE_HZ)[0] == pytest.approx(0.693, abs=5e-4)
    assert math.isnan(printed.cut_off_hz()) and math.isnan(corrected.cut_off_hz())
    exact = force_high_pass("exact")
    assert exact.cut_off_hz() == pytest.approx(15.0) and exact.highest_gain()[0] == pytest.approx(1.0)


def test_the_low_passes() -> None:
    """Facts: 0.27378 and 4.28 Hz; 0.3141 from the pole; the mean of three: 12.9 Hz."""
    printed, corrected, exact = (force_low_pass(variant) for variant in VARIANTS)
    assert printed.b[0] == pytest.approx(0.27378, abs=5e-6)
    assert printed.cut_off_hz() == pytest.approx(4.28, abs=0.005)
    assert corrected.b[0] == pytest.approx(0.3141, abs=5e-5)
    assert exact.cut_off_hz() == pytest.approx(5.0)
    assert current_low_pass().cut_off_hz() == pytest.approx(12.9, abs=0.05)
    for design in (printed, corrected, exact, current_low_pass("as_printed"), current_low_pass()):
        assert design.gain(0.0)[0] == pytest.approx(1.0)


@pytest.mark.parametrize("rate", [83.333, 250.0, 1000.0])
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("make", ALL)
def test_a_sine_comes_out_with_the_gain_that_is_stated(
    make: Callable[..., Filter], variant: str, rate: float
) -> None:
    design = make(variant, rate)
    for frequency in (2.0, 7.0, 15.0, 30.0):
        stream, k = Stream(design, 2), np.arange(int(6.0 * rate))
        phase = 2.0 * math.pi * frequency * k / rate
        signal = np.column_stack((np.sin(phase), np.cos(phase)))
        out = np.array([stream.step(each) for each in signal])
        late = out[len(out) // 2 :]
        basis = np.column_stack((np.sin(phase), np.cos(phase)))[len(out) // 2 :]
        fit, *_ = np.linalg.lstsq(basis, late[:, 0], rcond=None)
        assert np.hypot(*fit) == pytest.approx(float(design.gain(frequency)[0]), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("rate", [250.0, 1000.0])
def test_corrected_filters_keep_their_frequencies_at_other_rates(rate: float) -> None:
    """The printed taps do not: their cut-off goes with the rate."""
    assert current_high_pass("corrected", rate).cut_off_hz() == pytest.approx(8.7, rel=0.05)
    assert current_high_pass("as_printed", rate).cut_off_hz() == pytest.approx(
        7.485 * rate / RATE_HZ, rel=1e-3
    )
    assert force_high_pass("exact", rate).cut_off_hz() == pytest.approx(15.0)
    assert force_low_pass("exact", rate).cut_off_hz() == pytest.approx(5.0)
    assert force_low_pass("corrected", rate).cut_off_hz() == pytest.approx(5.0, rel=0.02)
    assert current_low_pass("corrected", rate).cut_off_hz() == pytest.approx(12.9, rel=0.05)


@pytest.mark.parametrize("make", ALL)
def test_a_stream_is_lfilter_and_begins_settled(
    make: Callable[..., Filter], rng: np.random.Generator
) -> None:
    design, signal = make(), rng.normal(size=(300, 3)) + 5.0
    stream = Stream(design, 3)
    settled = np.concatenate((np.repeat(signal[:1], 2000, axis=0), signal))
    wanted = lfilter(design.b, design.a, settled, axis=0)[2000:]
    np.testing.assert_allclose([stream.step(each) for each in signal], wanted, atol=1e-9)
    stream.forget()
    np.testing.assert_allclose(stream.step(signal[0]), wanted[0], atol=1e-9)


@pytest.mark.parametrize(
    ("variant", "rate", "text"),
    [
        ("other", 83.3, "variant = 'other' should be one of as_printed, corrected, exact"),
        ("corrected", 20.0, "rate_hz = 20.0 should be a number at least 33"),
        ("corrected", math.nan, "rate_hz = nan"),
        ("corrected", "fast", "rate_hz = 'fast'"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(variant: str, rate: object, text: str) -> None:
    with pytest.raises(SetupError, match=text):
        force_high_pass(variant, rate)
