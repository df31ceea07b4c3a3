"""What users of such tools ask for, and what silently never worked: shown on the commands that come out."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from failsafe.scaling import PathState
from failsafe.trajectory import IntendedTrajectory
from occupancy.report import RawMeasurement
from tests.verifier.supervised import CYCLE, PANDA_HOME, panda, panda_supervisor, quintic, report
from verifier.command import Cause, Command, State
from verifier.proposal import NewTrajectory, PathSpeed
from verifier.safety_state import ProbeSettings, SafetyProbe, SafetyState, look

Array = NDArray[np.float64]

ONE_SIDE = PANDA_HOME + np.array([-1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
OTHER_SIDE = PANDA_HOME + np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
BESIDE = 1.2
"""Somebody stands in this direction [rad], where the arm points on the other side."""
LATENCY_S = 0.02


class Cycle(NamedTuple):
    """One cycle: the command, where it is on the path, and what a planner could have known then."""

    command: Command
    s: float
    state: SafetyState | None


@cache
def probe() -> SafetyProbe:
    return SafetyProbe.from_cell(panda()[2], ProbeSettings(horizon_s=0.1), panda()[0].robot)


def path(a: Array, b: Array) -> IntendedTrajectory:
    return quintic([a, b], panda()[0].robot.limits, 0.5)


def drive(
    way: IntendedTrajectory, far: float, *, obeys: bool, until: float = 1.0, each: int = 1
) -> list[Cycle]:
    """Along a share of the path with somebody ``far`` [m] away; the planner asks every so often, may obey."""
    supervisor = panda_supervisor(way.sample(way.s_begin)[0])
    assert supervisor.propose(NewTrajectory(way)) is None
    found: list[Cycle] = []
    resting = 0
    while resting < 20 and (not found or found[-1].s < until * way.s_end):
        k = len(found)
        command = supervisor.step(k * CYCLE, [seen(k * CYCLE, far)])
        state = probe().state(look(supervisor)) if k % each == 0 else None
        if obeys and state is not None:
            assert supervisor.propose(PathSpeed(state.allowed_path_speed)) is None
        resting = resting + 1 if command.outcome is State.STOPPED and k > 5 else 0
        found.append(Cycle(command, supervisor.view().s, state))
        assert k < 1000
    assert supervisor.fault is None
    return found


def seen(now: float, far: float, direction: float = BESIDE) -> RawMeasurement:
    """What is reported of somebody ``far`` [m] away."""
    return report(now - LATENCY_S, far * math.cos(direction), far * math.sin(direction), arrived=now)


def speed_at(way: IntendedTrajectory, cycles: list[Cycle], share: float) -> float:
    """How fast the joints are commanded there, against what the path asks for; 0: it never came so far."""
    s = share * way.s_end
    near = [c for c in cycles if abs(c.s - s) < 0.02 and c.command.outcome is not State.STOPPED]
    ratios = [np.linalg.norm(c.command.dq) / np.linalg.norm(way.sample(c.s)[1]) for c in near]
    return float(np.mean(ratios)) if ratios else 0.0


@pytest.mark.rarely("peer 22 and the examples of planners")
def test_peer_20_speed_scaling_by_distance_really_scales():
    """Measured on what comes out, not on what was asked for; there is nothing that has to be enabled."""
    way, distances = path(ONE_SIDE, OTHER_SIDE), (1.1, 1.2, 1.3, 1.5)
    slowed = [drive(way, d, obeys=True, until=0.62, each=2) for d in distances]
    speeds = [speed_at(way, cycles, 0.6) for cycles in slowed]
    print("\n" + ", ".join(f"{d} m: {v:.3f}" for d, v in zip(distances, speeds, strict=True)))
    assert speeds[0] < 0.01 and 0.05 < speeds[1] < speeds[2] - 0.1 and speeds[2] < 0.95
    assert speeds[3] == pytest.approx(1.0, abs=1e-6)
    ignored = drive(way, 1.2, obeys=False, each=1000)
    assert speed_at(way, ignored, 0.6) == pytest.approx(1.0, abs=1e-6)
    stops = [[c.command.outcome for c in cycles].count(State.FAILSAFE) for cycles in (slowed[1], ignored)]
    assert stops[0] == 0 and stops[1] > 10, "who slows down in time is not stopped"


def test_peer_22_who_moves_away_is_not_slowed():
    """The same place, speed and person: towards them the path speed is limited, away from them it is not."""
    limits = panda()[0].robot.limits
    way, back = (quintic(ends, limits) for ends in ([ONE_SIDE, OTHER_SIDE], [OTHER_SIDE, ONE_SIDE]))
    limited = []
    for far in np.arange(1.0, 1.6, 0.05).tolist():
        supervisor = panda_supervisor(ONE_SIDE)
        supervisor.step(0.0, [seen(0.0, far, 0.9)])
        towards, away = (
            probe().state(
                look(supervisor)._replace(
                    trajectory=each, start=PathState(0.5 * each.s_end, 1.0, 0.0), target=1.0
                )
            )
            for each in (way, back)
        )
        assert towards.nearest.opening_m_s < -0.1 and away.nearest.opening_m_s > 0.1
        assert towards.allowed_path_speed <= away.allowed_path_speed
        if away.allowed_path_speed == 1.0 > towards.allowed_path_speed:
            limited.append(towards.allowed_path_speed)
    print(f"\naway from somebody 1.0, towards them {limited}")
    assert len(limited) > 2 and min(limited) < 0.7


def test_peer_22_the_planner_is_told_who_is_near_and_how_much_latency_is_left():
    cycles = drive(path(ONE_SIDE, OTHER_SIDE), 1.2, obeys=False, until=0.8)
    refused = [c.state.refused for c in cycles if c.command.cause is Cause.NOT_VERIFIED]
    assert refused and all(r is not None for r in refused)
    assert all(
        r.lacking_m > 0.0 and r.link.startswith("panda_") and "p1" in r.other for r in refused if r.pair
    )
    assert any(r.pair for r in refused)
    coming = [c.state for c in cycles if c.command.outcome is State.EXECUTING]
    latency = np.array([s.tolerable_latency_s for s in coming])
    gaps = np.array([s.nearest.witness.gap_m for s in coming])
    inside = np.isfinite(latency)
    assert latency[inside][0] > 0.1 and latency[inside][-1] < 0.02
    # sets grow with the speed of the profile: that much gap is used up by so much latency
    assert (gaps[inside] >= 2.0 * latency[inside] - 1e-6).all()


def test_peer_22_the_stop_stays_on_the_path_and_ends_when_it_was_said_to():
    """From the first cycle that is not verified on the path speed falls, within the limits, until rest."""
    way, limits = path(ONE_SIDE, OTHER_SIDE), panda()[0].robot.limits
    supervisor = panda_supervisor(ONE_SIDE)
    supervisor.propose(NewTrajectory(way))
    stop, promised, k = [], math.nan, 0
    while len(stop) < 200:
        command = supervisor.step(k * CYCLE, [] if stop else [seen(k * CYCLE, 1.2)])
        if command.cause is Cause.ADOPTED and not stop:
            promised = supervisor.plan.stop_time_s
        elif command.cause is Cause.NOT_VERIFIED or stop:
            stop.append((command, supervisor.view()))
        k += 1
        assert k < 1000
    for command, view in stop:
        assert np.abs(command.q - way.sample(view.s)[0]).max() < 1e-12
        assert (np.abs(command.dq) <= limits.velocity * (1 + 1e-9)).all()
        assert (np.abs(command.ddq) <= limits.acceleration * (1 + 1e-6)).all()
    sdot = np.array([view.sdot for _, view in stop])
    assert (np.diff(sdot) <= 1e-12).all() and sdot[0] > 0.5 and sdot[-1] == 0.0
    lasted = (1 + int(np.argmax(sdot == 0.0))) * CYCLE
    assert promised > 3.0 * CYCLE and lasted <= promised + CYCLE
