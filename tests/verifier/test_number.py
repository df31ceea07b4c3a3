"""Numbers of any type become Python's, and what is none becomes no number."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

from tests.verifier.supervised import CYCLE, PANDA_AWAY, PANDA_HOME, panda, panda_supervisor, quintic, report
from verifier.command import Cause, Command
from verifier.number import as_float
from verifier.proposal import JointVelocity, NewTrajectory, PathSpeed
from verifier.tracking import JointReading

Kind = Callable[[float], Any]


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        (0.1, 0.1), (-0.0, -0.0), (math.inf, math.inf), (3, 3.0), (True, 1.0), (Fraction(1, 4), 0.25),
        (np.float64(0.1), 0.1), (np.float32(0.5), 0.5), (np.float16(0.25), 0.25), (np.int64(-7), -7.0),
        (np.uint8(200), 200.0), (2**60 + 1, float(2**60)),
    ],
)  # fmt: skip
def test_real_numbers_keep_their_value(value: object, wanted: float) -> None:
    found = as_float(value)
    assert (
        type(found) is float and found == wanted and math.copysign(1.0, found) == math.copysign(1.0, wanted)
    )


@pytest.mark.parametrize(
    "value",
    [math.nan, np.float32(math.nan), None, "1.0", b"1", [1.0], np.array(1.0), np.ones(1), 1j, 10**400,
     Fraction(10**400), Decimal("1.5"), object()],
)  # fmt: skip
def test_what_is_no_real_number_is_none(value: object) -> None:
    found = as_float(value)
    assert type(found) is float and math.isnan(found)


def commands(kind: Kind) -> list[Command]:
    """Run with numbers of one type only; all are exact in any of them."""
    path = quintic([PANDA_HOME, PANDA_AWAY], panda()[0].robot.limits, 0.5)
    supervisor = panda_supervisor()
    assert supervisor.propose(NewTrajectory(path)) is None
    found = []
    for k in range(90):
        now = kind(round(64.0 * (1.0 + k * CYCLE)) / 64.0 if k else 1.0)
        if k in (20, 60):
            assert supervisor.propose(PathSpeed(kind(0.5 if k == 20 else 1.0))) is None
        if k == 75:
            assert supervisor.propose(JointVelocity(np.zeros(7), kind(0.25))) is None
        seen = report(now, 3.0)
        found.append(supervisor.step(now, [seen], JointReading(now, supervisor.view().q)))
        assert supervisor.fault is None
    return found


@pytest.mark.parametrize("kind", [np.float32, np.float64, Fraction])
def test_a_loop_does_the_same_whatever_type_its_numbers_have(kind: Kind) -> None:
    """Nor is anything compiled for another type."""
    plain = commands(float)
    functions = [each for each in gc.get_objects() if isinstance(each, CPUDispatcher)]
    compiled = [tuple(each.overloads) for each in functions]
    found = commands(kind)
    assert [tuple(each.overloads) for each in functions] == compiled
    assert sum(each.cause is Cause.ADOPTED for each in plain) > 10
    for each, wanted in zip(found, plain, strict=True):
        assert each.cause is wanted.cause and each.outcome is wanted.outcome
        assert type(each.t) is type(each.deadline) is type(each.verdict.t) is float
        np.testing.assert_array_equal([each.q, each.dq, each.ddq], [wanted.q, wanted.dq, wanted.ddq])
