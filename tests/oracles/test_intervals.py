"""The interval oracle is outward where it must be, and leaves the processor as it was."""

from fractions import Fraction

from tests.oracles.intervals import Interval, outward


def rounds_to_nearest() -> bool:
    tiny = [2.0**-53, -(2.0**-54)]
    return all(1.0 + x == 1.0 for x in tiny)


def test_intervals_are_outward_inside_and_arithmetic_is_plain_outside():
    assert rounds_to_nearest()
    with outward():
        assert not rounds_to_nearest()
        total = Interval(0.1) + Interval(0.2)
        low, high = total.lb(), total.ub()
    assert Fraction(low) < Fraction(0.1) + Fraction(0.2) < Fraction(high)
    assert rounds_to_nearest()
