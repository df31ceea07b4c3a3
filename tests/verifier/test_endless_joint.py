"""Joints that turn endlessly: any number of turns means the same, and an angle that wraps is refused."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from robots.errors import SetupError
from tests.verifier.scenes import CELL, Array, Scene, person_at, swing
from verifier import Cell, Status, verify
from verifier.section import require_joint_positions
from verifier.setup import build_robot
from verifier.supervised import supervise

UR3E = Cell.from_table({**CELL, "robot": {**CELL["robot"], "name": "ur3e"}})
WRAPPED = "an angle that wraps after a turn; angles must go on beyond ±π where the joint does"


def turning(
    by: float = 0.0, rate: float = 1.5, into: Callable[[float], float] = float
) -> Callable[[float], Array]:
    """The swing, with wrist 3 turning at ``rate`` [rad/s] from ``by`` [rad] on, brought ``into`` a range."""

    def motion(t: float) -> Array:
        q = swing(t)
        q[5] = into(by + rate * t)
        return q

    return motion


def into_half_turns(angle: float) -> float:
    """From -π to π."""
    return math.remainder(angle, math.tau)


def into_one_turn(angle: float) -> float:
    """From 0 to 2π."""
    return angle % math.tau


def write(path: Path, motion: Callable[[float], Array], **scene: float) -> Path:
    near = person_at(1.3, 0.2)
    return Scene(motion=motion, people={"p1": lambda _t: near}, robot="ur3e", **scene).write(path)


def test_turns_of_an_endless_joint_change_no_verdict(tmp_path: Path) -> None:
    """A recording of a real UR3e has wrist 3 at 12.6 rad."""
    plain = verify(write(tmp_path / "0.mcap", turning()), UR3E)
    assert plain.count(Status.VERIFIED) > 20 and plain.count(Status.CONTRADICTED) == 0
    for turns in (2, -7):
        turned = verify(write(tmp_path / f"{turns}.mcap", turning(turns * math.tau)), UR3E)
        np.testing.assert_array_equal(turned.per_cycle.status, plain.per_cycle.status)
        np.testing.assert_allclose(turned.per_cycle.gap_m, plain.per_cycle.gap_m, atol=1e-5)
        np.testing.assert_allclose(turned.per_cycle.stop_time_s, plain.per_cycle.stop_time_s, atol=1e-6)


def test_a_joint_with_limits_is_not_verified_beyond_them(tmp_path: Path) -> None:
    path = write(tmp_path / "r.mcap", turning(2.0 * math.tau))
    ur5e = Cell.from_table({**CELL, "robot": {**CELL["robot"], "name": "ur5e"}})
    with pytest.raises(SetupError, match="they must agree"):
        verify(path, ur5e)
    of_nobody = Scene(motion=turning(2.0 * math.tau), robot=None).write(tmp_path / "n.mcap")
    report = verify(of_nobody, ur5e)
    assert report.count(Status.VERIFIED) == 0 and report.count(Status.NOT_VERIFIED) > 20


@pytest.mark.parametrize("judge", [verify, supervise])
@pytest.mark.parametrize(
    ("motion", "before", "after"),
    [
        (turning(2.0, into=into_half_turns), 3.1, -3.1),
        (turning(-2.0, -1.5, into_half_turns), -3.1, 3.1),
        (turning(5.0, into=into_one_turn), 6.2, 0.0),
        (turning(0.5, -1.5, into_one_turn), 0.0, 6.2),
    ],
)
def test_an_angle_that_wraps_is_refused_where_it_does(
    motion: Callable[[float], Array],
    before: float,
    after: float,
    judge: Callable[[Path, Cell], object],
    tmp_path: Path,
) -> None:
    with pytest.raises(SetupError, match=re.escape(WRAPPED)) as refusal:
        judge(write(tmp_path / "r.mcap", motion), UR3E)
    found = re.search(r"wrist_3_joint jumps from (\S+) to (\S+) rad at (\S+) s", str(refusal.value))
    assert found is not None and "\n" not in str(refusal.value)
    assert [float(found[1]), float(found[2])] == pytest.approx([before, after], abs=0.1)
    when = float(found[3])
    assert abs(motion(when)[5] - motion(when - 0.008)[5]) > 6.0


@pytest.mark.parametrize("name", ["ur3e", "ur5"])
def test_a_wrapped_angle_is_refused_whatever_error_is_declared(tmp_path: Path, name: str) -> None:
    robot = {**CELL["robot"], "name": name, "tracking": {"position_error_rad": 0.05}}
    path = Scene(motion=turning(2.0, into=into_half_turns), robot=name).write(tmp_path / "r.mcap")
    with pytest.raises(SetupError, match="an angle that wraps"):
        verify(path, Cell.from_table({**CELL, "robot": robot}))


def test_another_turn_after_a_pause_is_no_jump(tmp_path: Path) -> None:
    """Nobody knows what the joint did meanwhile, and no cycle of a pause is verified."""
    path = write(tmp_path / "r.mcap", turning(2.9, into=into_half_turns), joint_rate=10.0)

    def with_gaps_of(longest_s: float) -> Cell:
        robot = {**CELL["robot"], "name": "ur3e", "max_sample_gap_s": longest_s}
        return Cell.from_table({**CELL, "robot": robot})

    report = verify(path, with_gaps_of(0.05))
    assert report.cycles > 100 and report.count(Status.VERIFIED) == 0
    with pytest.raises(SetupError, match="an angle that wraps"):
        verify(path, with_gaps_of(0.2))


def test_so_far_from_zero_an_endless_joint_is_refused_too(tmp_path: Path) -> None:
    path = write(tmp_path / "r.mcap", turning(2e4))
    with pytest.raises(SetupError, match="wrist_3_joint is 20000; beyond 1000 a path loses digits"):
        verify(path, UR3E)
    q = np.zeros((8, 6))
    q[3, 5] = 2e4
    with pytest.raises(SetupError, match="position is not limited, but so far from zero a path loses digits"):
        require_joint_positions(path, build_robot(UR3E), np.arange(8.0), q)
