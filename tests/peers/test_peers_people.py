"""Wrong turns of such tools that concern what is known about people; the numbers are those of
docs/wrong_turns.md."""

from __future__ import annotations

import math

import numpy as np
import pytest

from occupancy.body import Part, Point, load_profile
from occupancy.humans.articulated import ArticulatedAcceleration, ArticulatedVelocity
from occupancy.humans.iso13855 import Iso13855
from occupancy.measurement import Gate
from occupancy.region import Monitored, Region
from occupancy.report import RawMeasurement, RefusalReason
from occupancy.sets import distance_to_hull
from robots.motion import Block, new_slices
from tests.occupancy.people import report, settings, standing
from tests.verifier.fault_rig import CYCLE, Rig
from tests.verifier.scenes import CELL, Scene, far, person_at
from tests.verifier.supervised import EPOCH, PANDA_HOME, panda, panda_supervisor, quintic
from tests.verifier.supervised import report as seen
from verifier import Cell, Status, verify
from verifier.command import Cause, State
from verifier.proposal import NewTrajectory
from verifier.verdict import Reason

TUM = load_profile("tum")
STEP_S = 0.01
"""Cycle of the supervisor that tests without a rig use [s]."""


def slice_of(begin: float, end: float) -> Block:
    plan = new_slices()
    plan["n"], plan["t"][0, :2] = 1, (begin, end)
    return plan


def test_peer_01_nan_position_is_not_absence(tmp_path):
    """Comparisons with NaN are false, so that a person at NaN meets nothing: full speed beside somebody."""
    rig = Rig()
    rig.until(State.EXECUTING)
    rig.spoil = lambda sound: sound._replace(
        people=tuple(who._replace(xyz=np.full_like(who.xyz, math.nan)) for who in sound.people)
    )
    commands = rig.steps(120)
    assert commands[-1].outcome is State.STOPPED and commands[-1].cause is Cause.NOT_VERIFIED
    # who walks at 2.0 m/s from 2.8 m away has reached the middle of the arm by then
    last = max(k for k, command in enumerate(commands) if command.cause is Cause.ADOPTED)
    assert last * CYCLE < 2.8 / 2.0
    nowhere = Scene(people={"p1": lambda _t: np.full((20, 3), math.nan), "p2": far})
    recorded = verify(nowhere.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    assert recorded.count(Status.VERIFIED) == 0 and recorded.count(Status.NOT_VERIFIED) > 0


@pytest.mark.parametrize("ahead", [0.004, 0.5, 1e3])
def test_peer_02_a_stamp_in_the_future_shrinks_nothing(ahead):
    """Age is now minus stamp: a stamp that lies ahead gives a set that is smaller than that of an instant."""
    gate = Gate(load_profile("iso"), settings(clock_error_s=0.005))
    now = 10.0
    admission = gate.admit(report(now, ("a", standing()))._replace(stamp=now + ahead), now)
    model = Iso13855(load_profile("iso"))
    out = model.new_sets()
    model.occupy(gate.people, slice_of(now + 0.1, now + 0.2), out)
    rows = out[0]
    if ahead > 0.01:
        assert [each.reason for each in admission.refusals] == [RefusalReason.STAMP_AHEAD]
        assert rows["n"] == 0 and gate.people["n"][0] == 1, "somebody is there, nobody knows where"
        return
    # whenever within the error of its clock it was seen, the head moved at 2 m/s since
    head = [i for i in range(rows["n"]) if rows["covers"][i] >> int(Part.HEAD) & 1]
    for direction in np.eye(3):
        reached = standing()[Point.HEAD] + 2.0 * (0.2 - ahead + 0.005) * direction
        for i in head:
            points = rows["points"][i, : rows["n_points"][i]]
            assert distance_to_hull(points, reached) <= rows["radius"][i] - 0.35 + 1e-12


@pytest.mark.parametrize("distance", [1.6, 2.2, 2.8])
def test_peer_03_silence_is_noticed(distance):
    """With the last report kept as it is, a sensor that has died looks like somebody who stands still."""
    rig = Rig()
    rig.x = distance
    rig.until(State.EXECUTING)
    rig.spoil = None
    silent = rig.k
    commands = rig.steps(120)
    last = max(k for k, command in enumerate(commands) if command.cause is Cause.ADOPTED)
    # the body of 0.35 m has reached the axis of the base after so long at 2.0 m/s
    assert (silent + last - silent + 1) * CYCLE < (distance - 0.35) / 2.0
    assert commands[-1].outcome is State.STOPPED and rig.robot.rests
    supervisor = panda_supervisor()
    supervisor.propose(NewTrajectory(quintic([PANDA_HOME, PANDA_HOME + 0.1], rig.limits)))
    first = supervisor.step(EPOCH)
    assert first.outcome is State.STOPPED and first.verdict.reason is Reason.NO_REPORT_YET


def test_peer_04_a_clock_that_stands_still_gives_no_velocity(rng, count):
    """Differences over a clock that does not advance tend to 0, and the bound of a filter is not used."""
    for _ in range(max(5, count(200))):
        gate = Gate(TUM, settings(position_error_m=0.004))
        v = rng.uniform(-0.5, 0.5, 3)
        for i in range(5):
            gate.admit(report(1.0, ("a", standing() + i * STEP_S * v)), 1.0 + i * STEP_S)
        assert np.isinf(gate.people["e_v"][0, 0]).all()
        for i in range(5, 10):
            t = 1.0 + i * STEP_S
            gate.admit(report(t, ("a", standing() + i * STEP_S * v)), t)
        off = np.linalg.norm(gate.people["v"][0, 0] - v, axis=1)
        bound = gate.people["e_v"][0, 0]
        assert (off <= bound + 1e-12).all() and np.isfinite(bound).all()


def test_peer_04_the_bound_of_the_velocity_is_part_of_the_set():
    """The velocity is wrong by as much as its bound says: without the bound the set is beside the person."""
    gate = Gate(TUM, settings(position_error_m=0.05))
    still = standing()[Point.HEAD]
    for t, off in ((0.0, -0.05), (0.05, 0.05)):  # as wrong as they may be: 2 m/s, and nobody moves
        gate.admit(report(t, ("a", standing() + np.array([off, 0.0, 0.0]))), t)
    model, out = ArticulatedAcceleration(TUM), ArticulatedAcceleration(TUM).new_sets()
    model.occupy(gate.people, slice_of(0.15, 0.16), out)
    rows, inside = out[0], 0
    for i in range(rows["n"]):
        if rows["covers"][i] == 1 << int(Part.HEAD):
            distance = distance_to_hull(rows["points"][i, : rows["n_points"][i]], still)
            assert distance <= rows["radius"][i] - TUM.radius[Part.HEAD]
            inside += 1
    assert inside > 0


@pytest.mark.parametrize("model", [Iso13855, ArticulatedVelocity, ArticulatedAcceleration])
def test_peer_06_balls_cover_the_whole_interval(model, rng, count):
    """A hand or head is one ball at the end of the interval: where it has been before is left out."""
    for _ in range(max(10, count(1000))):
        v = rng.normal(size=3)
        v *= rng.uniform(0.5, 1.9) / np.linalg.norm(v)
        gate = Gate(TUM, settings(position_error_m=0.004))
        for i in range(4):
            t = 0.02 * i
            gate.admit(report(t, ("a", standing() + t * v)), t)
        begin = 0.06 + rng.uniform(0.0, 0.1)
        end = begin + rng.uniform(0.05, 0.3)
        out = model(TUM).new_sets()
        model(TUM).occupy(gate.people, slice_of(begin, end), out)
        rows, looked = out[0], 0
        for i in range(rows["n"]):
            for part, point in ((Part.HEAD, Point.HEAD), (Part.L_HAND, Point.L_FINGERTIP)):
                if rows["covers"][i] != 1 << int(part):
                    continue
                for t in np.linspace(begin, end, 9):
                    truth = standing()[point] + t * v
                    distance = distance_to_hull(rows["points"][i, : rows["n_points"][i]], truth)
                    assert distance <= rows["radius"][i]
                    looked += 1
        assert looked > 0


def test_peer_14_nothing_of_before_is_kept_where_somebody_comes_back():
    """After a reset the old position is still there: the next difference is a leap across the room."""
    region = Region.box((-10.0, -10.0, -1.0), (10.0, 10.0, 4.0))
    gate = Gate(TUM, settings(position_error_m=0.004, monitored=(Monitored("room", region, 0.0, 0.0),)))
    for i in range(5):
        gate.admit(report(0.02 * i, ("a", standing(3.0))), 0.02 * i)
    assert np.isfinite(gate.people["e_v"][0, 0]).all()
    gate.admit(RawMeasurement(5.0, 5.0, "world", True, ()), 5.0)
    assert gate.people["n"][0] == 0
    back = gate.admit(report(9.0, ("a", standing(-3.0))), 9.0)
    assert not back.contradictions and np.isinf(gate.people["e_v"][0, 0]).all()
    for i in range(1, 4):
        t = 9.0 + 0.02 * i
        gate.admit(report(t, ("a", standing(-3.0))), t)
    v, e_v = gate.people["v"][0, 0], gate.people["e_v"][0, 0]
    assert (np.linalg.norm(v, axis=1) <= e_v).all() and np.abs(v).max() <= 1e-9


def test_peer_15_a_first_measurement_has_no_velocity():
    """One reading, and the velocity is 0: whoever runs in is expected to stand."""
    gate = Gate(TUM, settings(position_error_m=0.004))
    gate.admit(report(0.0, ("a", standing())), 0.0)
    assert np.isinf(gate.people["e_v"][0, 0]).all()
    out = ArticulatedAcceleration(TUM).new_sets()
    ArticulatedAcceleration(TUM).occupy(gate.people, slice_of(0.0, 0.1), out)
    assert out["n"][0] == 0, "the model that knows where somebody is going says nothing"
    out = ArticulatedVelocity(TUM).new_sets()
    ArticulatedVelocity(TUM).occupy(gate.people, slice_of(0.0, 0.1), out)
    rows = out[0]
    head = int(np.flatnonzero(rows["covers"][: rows["n"]] >> int(Part.HEAD) & 1)[0])
    assert rows["radius"][head] >= TUM.radius[Part.HEAD] + 0.1 * TUM.speed[Point.HEAD]


def test_peer_19_legs_have_bodies():
    """Legs are points without a body: a foot beside the base is no obstacle."""
    far = panda()[0]
    answers = {}
    for name, stretched in (("standing", False), ("a foot ahead", True)):
        low = PANDA_HOME + np.array([0.0, 1.0, 0.0, -0.6, 0.0, 0.0, 0.0])
        supervisor = panda_supervisor(low)
        path = quintic([low, low + np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])], far.robot.limits)
        assert supervisor.propose(NewTrajectory(path)) is None
        for k in range(5):
            now = EPOCH + k * STEP_S
            whole = seen(now, 1.5)
            points = person_at(1.5, 0.0, 0.0)
            if stretched:
                hip = points[Point.R_HIP]
                points[Point.R_KNEE], points[Point.R_ANKLE] = hip - (0.43, 0.0, 0.1), hip - (0.86, 0.0, 0.25)
            who = whole.people[0]._replace(xyz=points)
            command = supervisor.step(now, [whole._replace(people=(who,))])
        nearest = far.nearest
        answers[name] = command.verdict.reason
        if stretched:
            assert nearest is not None and nearest.parts & (
                1 << int(Part.R_FOOT) | 1 << int(Part.R_SHANK) | 1 << int(Part.R_THIGH)
            )
    assert answers == {"standing": Reason.SEPARATED, "a foot ahead": Reason.REACHABLE}
