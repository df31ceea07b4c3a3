"""The bundled recording, verified, and its tightest cycles once more by brute force from the raw messages.

Nothing but the plans comes from the verifier: path acceleration and jerk of each stop. Where the arm goes is
taken from the recorded samples, where the people are from the JSON of the reports that had arrived, both
decoded here. The gripper is left out: the checker knows the arm's meshes only.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from failsafe.plan import PlanResult, StopKind
from occupancy.body import ALL_PARTS, POINT_NAMES
from robots.motion import Block
from tests.oracles.arms import ARMS, arm
from tests.oracles.brute_force import chase, nearest_approach
from tests.oracles.situation import Motion, Person
from tests.oracles.stop_profile import fastest_stop
from tests.soundness.cells import STANDSTILL_M_S, STEP_S
from tests.soundness.persons import Truth, told
from verifier import Cell, verify
from verifier.cycle import CycleCheck, Known
from verifier.verdict import Status, Verdict

Array = NDArray[np.float64]
DATA = Path(__file__).resolve().parents[2] / "data"
SPEED_M_S, LATENCY_S, CLOCK_ERROR_S, CYCLE_S, DELAY_MAX_S = 2.0, 0.03, 0.001, 0.01, 0.008
"""As data/demo.toml says."""


@dataclass(frozen=True)
class Raw:
    """What the recording holds: samples (T,), (T, n), and reports with the time of their arrival."""

    time: Array
    q: Array
    reports: list[tuple[float, dict[str, object]]]


def joint_state(data: bytes) -> tuple[list[str], list[float]]:
    """Names and positions of a sensor_msgs/msg/JointState in little-endian CDR."""
    assert data[:4] == b"\x00\x01\x00\x00"
    body, at = data[4:], 8

    def number(kind: str, size: int) -> float | int:
        nonlocal at
        at += -at % size
        (value,) = struct.unpack_from("<" + kind, body, at)
        at += size
        return value

    def text() -> str:
        nonlocal at
        length = int(number("I", 4))
        value = body[at : at + length - 1].decode()
        at += length
        return value

    text()
    names = [text() for _ in range(int(number("I", 4)))]
    return names, [float(number("d", 8)) for _ in range(int(number("I", 4)))]


@pytest.fixture(scope="module")
def raw() -> Raw:
    times, positions, reports = [], [], []
    with (DATA / "demo.mcap").open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            if channel.topic == "/joint_states":
                names, values = joint_state(message.data)
                times.append(message.log_time * 1e-9)
                positions.append([values[names.index(joint)] for joint in ARMS["ur5"][1]])
            elif channel.topic == "/people":
                report = json.loads(message.data)
                reports.append((max(message.log_time * 1e-9, report["stamp"] + LATENCY_S), report))
    return Raw(np.array(times), np.array(positions), reports)


@dataclass(frozen=True)
class Judged:
    """One call of the cycle check."""

    t: float
    plan: PlanResult
    verdict: Verdict


@pytest.fixture(scope="module")
def cycles() -> list[Judged]:
    """Every cycle that the replay of the recording judged first as verified."""
    seen: list[Judged] = []
    original = CycleCheck.check

    def check(self: CycleCheck, t: float, plan: PlanResult, slices: Block, known: Known) -> Verdict:
        verdict = original(self, t, plan, slices, known)
        seen.append(Judged(t, plan, verdict))
        return verdict

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CycleCheck, "check", check)
        report = verify(DATA / "demo.mcap", Cell.from_toml(DATA / "demo.toml"))
    first = {round(each.t, 6): each for each in reversed(seen)}
    status = dict(zip(np.round(report.per_cycle.t, 6), report.per_cycle.status, strict=True))
    start = min(first)
    assert start == pytest.approx(0.4), "times count from the recording's zero; the first report is at 0.4 s"
    return [each for t, each in sorted(first.items()) if status[round(t - start, 6)] == Status.VERIFIED]


def by_gap(cycles: list[Judged]) -> list[Judged]:
    """Cycles with a stop on the path in which somebody was compared with the arm, the tightest first."""
    compared = [c for c in cycles if c.plan.stop is StopKind.PATH_CONSISTENT and np.isfinite(c.verdict.gap_m)]
    return sorted(compared, key=lambda cycle: cycle.verdict.gap_m)


def people_known_at(raw: Raw, t: float) -> list[Person]:
    """Who had been reported by ``t`` [s]."""
    latest: dict[str, tuple[float, dict[str, object]]] = {}
    for arrived, report in raw.reports:
        if arrived <= t + 1e-9:
            for person in report["people"]:
                latest[person["id"]] = report["stamp"], person
    return [person_of(*each) for each in latest.values()]


def person_of(stamp: float, said: dict[str, object]) -> Person:
    points = np.full((20, 3), np.nan)
    for name, point in said["points"].items():
        points[POINT_NAMES.index(name)] = point["xyz"]
    seen = np.isfinite(points).all(axis=1)
    assert seen.all(), "this test reads whole people only"
    once, exact, bounds = np.stack([seen, seen]), np.zeros((2, 20, 3)), np.full(20, said["position_error_m"])
    truth = Truth(said["id"], points, np.zeros(3), once, exact, bounds)
    return told(truth, (stamp, stamp), CLOCK_ERROR_S, SPEED_M_S, ALL_PARTS, 0.0)


def executed(raw: Raw, plan: PlanResult, t: float) -> Motion:
    """The recorded motion over the piece [t + cycle, t + 2 cycles], then on its path until it has stopped."""
    path = CubicSpline(raw.time, raw.q)
    begin = t + CYCLE_S
    stop = fastest_stop(begin + CYCLE_S, 1.0, 0.0, plan.a_s, plan.j_s)
    time = np.linspace(0.0, CYCLE_S + stop.duration, int((CYCLE_S + stop.duration) / STEP_S) + 2)
    s = np.where(time <= CYCLE_S, begin + time, stop.sample(np.maximum(time - CYCLE_S, 0.0))[0])
    return Motion(begin + time + DELAY_MAX_S, path(s))


def test_no_contact_in_the_tightest_verified_cycles(
    raw: Raw, cycles: list[Judged], count: Callable[[int], int], seed: int
) -> None:
    compared = by_gap(cycles)
    assert len(compared) > 100
    others = np.random.default_rng(seed).permutation(len(compared))[: count(1_000)]
    slacks = []
    for each in [*compared[: count(2_000)], *(compared[i] for i in others)]:
        people = people_known_at(raw, each.t)
        motion = executed(raw, each.plan, each.t)
        found = nearest_approach(arm("ur5"), motion, people, STANDSTILL_M_S)
        if found is None:
            continue
        contact = chase(arm("ur5"), motion, people[found.person], found, STANDSTILL_M_S)
        assert contact is None and found.slack > 0.0, f"cycle at {each.t} s: {found}, {contact}"
        slacks.append(found.slack - each.verdict.gap_m)
    print(f"\n{len(slacks)} cycles, slack minus certified gap {min(slacks):.4f} to {max(slacks):.4f} m")
    assert len(slacks) > 10
    assert min(slacks) > -1e-3, "the certified gap is above what brute force finds"


def test_the_search_sees_people_who_are_faster(raw: Raw, cycles: list[Judged]) -> None:
    """With people twice as fast it finds contacts in cycles that were verified for 2 m/s."""
    for each in by_gap(cycles)[:20]:
        people = [replace(person, speed=2.0 * SPEED_M_S) for person in people_known_at(raw, each.t)]
        motion = executed(raw, each.plan, each.t)
        found = nearest_approach(arm("ur5"), motion, people, STANDSTILL_M_S)
        if found is not None and found.slack < 0.0:
            return
    pytest.fail("the search finds nothing even with people twice as fast")
