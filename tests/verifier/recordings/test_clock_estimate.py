"""The true offset is always within the bounds when what was stated holds; what cannot be is said."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from robots.errors import SetupError
from verifier.recordings.clock_estimate import DRIFT, STRETCH_S, ClockStretches, Latency, clock_facts
from verifier.recordings.clock_offset import read_time_offset

NANO = 1_000_000_000


def simulated(rng: np.random.Generator, latency: Latency, start_s: float, offset_s: float, drift: float):
    """True offsets, stamps and arrivals of messages [ns], exact; the recorder's clock is the truth.

    One message of every stretch takes a latency within the bounds, all others longer; they may overtake.
    The offset goes up and down at the slope ``drift``.
    """
    number = rng.integers(5, 400)
    sent = round(start_s * NANO) + rng.integers(0, round(rng.uniform(1.0, 60.0) * NANO), number)
    took = rng.exponential(rng.choice([0.001, 0.05, 0.5]), number) + latency.most_s
    took = np.ceil(took * NANO).astype(np.int64)
    arrived = sent + took
    stretch = arrived // round(STRETCH_S * NANO)
    for each in np.unique(stretch):
        quick = rng.choice(np.flatnonzero(stretch == each))
        took[quick] = rng.integers(round(latency.least_s * NANO), round(latency.most_s * NANO) + 1)
    sent = arrived - took
    period = round(rng.uniform(1.0, 200.0) * NANO)
    wave = np.abs((sent + rng.integers(0, period)) % period - period // 2)
    offset = round(offset_s * NANO) + np.rint(drift * wave).astype(np.int64)
    return offset, sent - offset, arrived


@pytest.mark.parametrize("start_s", [0.0, 1.7e9])
@pytest.mark.parametrize("drift", [0.0, 0.9 * DRIFT])
def test_the_true_offset_is_within_the_bounds(rng, count, start_s, drift):
    width = []
    for _ in range(count(2000)):
        least = rng.choice([0.0, 0.01])
        latency = Latency(least, least + rng.choice([0.0, 0.001, 0.02]))
        offset_s = rng.choice([0.0, -0.3, 5.0, 1.6e9]) * rng.uniform(0.5, 1.0)
        offset, stamps, arrived = simulated(rng, latency, start_s, offset_s, drift)
        seen = ClockStretches()
        for k in np.argsort(arrived, kind="stable"):
            seen.take(int(arrived[k]), int(stamps[k]))
        found = seen.bounds(latency)
        middle, error = Fraction(found.offset_s), Fraction(found.error_s)
        assert middle - error <= Fraction(int(offset.min()), NANO), "witness: the smallest offset"
        assert middle + error >= Fraction(int(offset.max()), NANO), "witness: the largest offset"
        assert found.contradiction is None
        least_possible = 0.5 * (latency.most_s - latency.least_s) + 0.5 * np.ptp(offset) / NANO
        width.append(found.error_s - least_possible)
    assert min(width) < 0.02, "bounds that are always wide show nothing"


def test_a_constant_offset_without_jitter_is_found_to_the_rounding():
    seen = ClockStretches()
    for k in range(1000):
        seen.take(k * 10_000_000 + 250_000_000 + 20_000_000, k * 10_000_000)
    found = seen.bounds(Latency(0.01, 0.03))
    assert found.offset_s == pytest.approx(0.25, abs=1e-6)
    # half the difference of the latencies, and the drift over a stretch: the quickest is the first of it
    assert 0.01 <= found.error_s <= 0.01 + DRIFT * STRETCH_S + 2e-6
    assert found.contradiction is None


def test_a_clock_that_was_set_is_found():
    seen = ClockStretches()
    for k in range(2000):
        seen.take(k * 10_000_000 + 20_000_000, k * 10_000_000 + (500_000_000 if k >= 1000 else 0))
    found = seen.bounds(Latency(0.01, 0.03))
    assert "comes 0.5 s sooner: a clock was set" in found.contradiction
    facts = clock_facts("people", 0.0, seen, Latency(0.01, 0.03))
    assert facts.offset_s is None, "nothing to take over"
    assert any("contradicted" in line for line in facts.lines())
    assert seen.bounds(Latency(0.0, 0.6)).contradiction is None, "such a latency explains it"


def test_nothing_stated_is_nothing_to_write():
    seen = ClockStretches()
    seen.take(1_700_000_000 * NANO, 12 * NANO)
    facts = clock_facts("people", 0.0, seen, None)
    text = "\n".join(facts.lines())
    assert facts.offset_s is None and "time_offset_s" not in text
    assert (
        "another one: a stamp is 12.000 s since a start, its message time 1700000000.000 s since 1970" in text
    )
    assert "at most 1699999988.000000 s" in text


def test_the_printed_offset_with_its_error_contains_what_was_found(rng, count):
    """Digits are cut outwards, also with an offset that was added before."""
    for _ in range(count(500)):
        seen, offset = ClockStretches(), float(rng.uniform(-10.0, 10.0))
        seen.take(round(2e9 + offset * NANO), 2 * NANO)
        added = float(rng.uniform(-1.0, 1.0))
        facts = clock_facts("people", added, seen, Latency(0.0, 0.0))
        (line,) = (line for line in facts.lines() if "--time-offset" in line)
        stated = read_time_offset(line.split("--time-offset ")[1].split(",")[0])
        assert abs(stated.offset_s - (offset + added)) <= stated.error_s + 1e-9


@pytest.mark.parametrize("bounds", [(0.02, 0.01), (-0.1, 0.1), (0.0, np.inf), (np.nan, 1.0), (0.0, 11.0)])
def test_latencies_that_are_none(bounds):
    with pytest.raises(SetupError, match="it must be two numbers of seconds"):
        Latency(*bounds)


@pytest.mark.parametrize(
    "text", ["12.5±0.25", "12.5+-0.25", "12.5+/-0.25", " 12.5 ± 0.25 ", "1.25e1+-2.5e-1"]
)
def test_an_offset_with_its_error(text):
    assert read_time_offset(text) == (12.5, 0.25)


@pytest.mark.parametrize("text", ["-0.5±0", "-0.5+-0", "-.5+/-0"])
def test_an_offset_may_be_negative(text):
    assert read_time_offset(text) == (-0.5, 0.0)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("", "must be S±ERR"),
        ("soon", "must be S±ERR"),
        ("1±", "must be S±ERR"),
        ("±0.1", "must be S±ERR"),
        ("1+-0.1+-0.2", "with one error"),
        ("nan±0.1", "must be within"),
        ("inf±0.1", "must be within"),
        ("5e9±0.1", "must be within"),
        ("1±nan", "from 0 to 10 s"),
        ("1±-0.1", "from 0 to 10 s"),
        ("1±11", "from 0 to 10 s"),
    ],
)
def test_offsets_that_are_none(text, rule):
    with pytest.raises(SetupError, match=rule):
        read_time_offset(text)


def test_without_an_error_none_is_made_up():
    assert read_time_offset("1.5") == (1.5, None)
