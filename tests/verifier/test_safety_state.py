"""The safety state against the supervisor's own next steps, dense scans, and other ways to compute it."""

from __future__ import annotations

import math
import pickle
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest

from failsafe.manoeuvre import Quantity
from failsafe.plan import PlanOutcome, PlanResult
from failsafe.scaling import PathState
from failsafe.short_term_plan import ShortTermPlanner
from occupancy.body import ALL_PARTS
from occupancy.ledger_kernels import count_people
from occupancy.report import RawMeasurement
from robots.errors import SetupError
from robots.kernels import forward
from robots.motion import MAX_JOINTS, new_slices
from tests.oracles.arms import arm
from tests.oracles.brute_force import nearest_approach
from tests.oracles.hulls import distance, pad
from tests.oracles.optimal import hull_distance
from tests.oracles.situation import Motion
from tests.soundness.persons import Truth, told
from tests.verifier.scenes import person_at
from tests.verifier.supervised import (
    CYCLE,
    EPOCH,
    PANDA,
    PANDA_AWAY,
    PANDA_HOME,
    panda,
    panda_supervisor,
    quintic,
    report,
)
from tests.verifier.walks import LATENCY_S, Walk, fresh_check, plans_of, probe_of
from verifier.cell import Cell
from verifier.command import Cause
from verifier.constraint import closest
from verifier.outlook import Made, Outlook
from verifier.proposal import NewTrajectory, PathSpeed
from verifier.safety_state import ProbeSettings, SafetyProbe, look, older
from verifier.supervisor import Supervisor
from verifier.verdict import Reason, Status, Verdict

FINE = ProbeSettings(horizon_s=0.0, speed_step=1.0 / 256.0)
USUAL = ProbeSettings()
FAR_AHEAD = ProbeSettings(horizon_s=0.1)
MARGIN = 1e-4


def walks(rng, found: list, number: int, **how):
    """Scenes until ``number`` have been found; a test that does not find them is vacuous, and fails."""
    for tried in range(100 + 20 * number):
        if tried > 0 and len(found) >= number:
            return
        yield Walk.random(rng, **how)
    pytest.fail("vacuous")


# Bad input


@pytest.mark.parametrize("name", ["horizon_s", "speed_step", "latency_bound_s", "latency_step_s"])
@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_unusable_settings_are_refused(name, value):
    with pytest.raises(SetupError):
        ProbeSettings(**{name: value})


@pytest.mark.parametrize("change", [{"sdot": 0.0}, {"sdot": 1.1}, {"sdot": math.nan}, {"step_s": 0.0}])
def test_a_dry_run_is_along_the_path(change):
    walk = Walk.random(np.random.default_rng(0))
    with pytest.raises(SetupError):
        probe_of(False, USUAL).would_verify(look(walk.new_supervisor()), walk.path, **change)


# Nothing is known


def test_before_the_first_step_nothing_is_allowed():
    state = probe_of(False, USUAL).state(look(panda_supervisor()))
    assert math.isnan(state.t) and state.allowed_path_speed == 0.0 and math.isnan(state.tolerable_latency_s)
    assert state.nearest is None and state.refused is None and state.reports_to_spare(0.01) == 0


def test_without_a_report_nothing_is_allowed():
    supervisor = panda_supervisor()
    supervisor.propose(NewTrajectory(quintic([PANDA_HOME, PANDA_AWAY], panda()[0].robot.limits)))
    supervisor.step(0.0)
    state = probe_of(False, USUAL).state(look(supervisor))
    assert state.verdict.reason is Reason.NO_REPORT_YET
    assert math.isnan(state.tolerable_latency_s) and state.nearest is None


def test_after_a_fault_nothing_is_allowed():
    walk = Walk.random(np.random.default_rng(0))
    supervisor = walk.after(4)
    supervisor.step(4 * CYCLE, [None])
    supervisor.step(5 * CYCLE)
    state = probe_of(False, USUAL).state(look(supervisor))
    assert state.verdict.reason is Reason.FAULT and state.allowed_path_speed == 0.0


def test_who_rests_at_the_end_need_not_slow_down():
    supervisor = panda_supervisor()
    supervisor.step(0.0, [report(0.0, 0.8)])
    state = probe_of(False, USUAL).state(look(supervisor))
    assert state.verdict.reason is Reason.AT_REST and state.nearest is None
    assert state.tolerable_latency_s == USUAL.latency_bound_s


# What the next step says


def test_the_next_step_says_the_same(rng, count):
    reached: list[Outlook] = []
    for walk in walks(rng, reached, count(300)):
        probe, supervisor = probe_of(False, USUAL), walk.new_supervisor()
        for k in range(150):
            reports = walk.reports(k)
            outlook = look(supervisor) if k and not reports and k % 5 == 0 else None
            expected = None if outlook is None else probe.state(outlook)
            command = supervisor.step(k * CYCLE, reports)
            if expected is not None:
                said = command.verdict
                assert said._replace(t=0.0) == pytest.approx(expected.verdict._replace(t=0.0), nan_ok=True)
                if said.reason is Reason.REACHABLE:
                    reached.append(outlook)
        assert supervisor.fault is None


def test_the_allowed_path_speed_is_what_the_next_step_adopts_and_no_more(rng, count):
    slowed: list[float] = []
    for walk in walks(rng, slowed, count(100)):
        for k, outlook in walk.outlooks():
            if k % 3 == 0:
                continue  # a report arrives in that step
            allowed = probe_of(False, FINE).state(outlook).allowed_path_speed
            if not 0.0 < allowed < 1.0:
                continue
            causes = []
            for speed in (allowed, allowed + FINE.speed_step):
                twin = walk.after(k)
                assert twin.propose(PathSpeed(min(speed, 1.0))) is None
                causes.append(twin.step(k * CYCLE).cause)
            assert causes == [Cause.ADOPTED, Cause.NOT_VERIFIED]
            slowed.append(allowed)
            break


@pytest.mark.parametrize("settings", [FINE, USUAL, FAR_AHEAD])
def test_the_allowed_path_speed_against_a_dense_scan(settings, rng, count):
    inside, monotone = 0, list[float]()
    for walk in walks(rng, monotone, count(200)):
        plans, check = plans_of(walk), fresh_check(walk)
        horizon = CYCLE if settings.horizon_s is None else settings.horizon_s
        planners = [
            ShortTermPlanner(check.robot.limits, replace(plans, cycle_s=CYCLE + h)) for h in (0.0, horizon)
        ]

        def holds(outlook: Outlook, sdot: float, check=check, planners=planners) -> bool:
            for planner in planners:
                planner.memory = outlook.memory
                plan = planner.follow(outlook.trajectory, outlook.begin, outlook.start, sdot)
                answer = check.check_moving(outlook.now, plan, planner.slices, outlook.known)
                if answer.status is not Status.VERIFIED:
                    return False
            return True

        for _, outlook in walk.outlooks(each=7):
            if outlook.start.s >= walk.path.s_end:
                break
            allowed = probe_of(False, settings).state(outlook).allowed_path_speed
            assert allowed == 0.0 or holds(outlook, allowed)
            assert not any(holds(outlook, level / 8.0) for level in range(math.floor(8.0 * allowed) + 1, 9))
            if not 0.0 < allowed < 1.0:
                continue
            inside += 1
            assert not holds(outlook, allowed + settings.speed_step)
            scan = np.linspace(0.0, 1.0, 65)
            good = np.array([holds(outlook, float(v)) for v in scan])
            if not (np.diff(good.astype(int)) > 0).any():
                monotone.append(allowed)
                assert abs(scan[good].max() - allowed) <= settings.speed_step + 1.0 / 64.0
    assert len(monotone) > 0.3 * inside


# The tolerable latency


@pytest.mark.parametrize("models", [False, True])
def test_the_tolerable_latency_against_every_age(models, rng, count):
    """Brute force: the same plan, held against people whose points were all seen earlier, age by age."""
    compared, step = list[float](), USUAL.latency_step_s
    for walk in walks(rng, compared, count(400), models=models):
        check, planner = fresh_check(walk), ShortTermPlanner(panda()[0].robot.limits, plans_of(walk))
        for _, outlook in walk.outlooks(each=9):
            state = probe_of(models, USUAL).state(outlook)
            if outlook.start.s >= walk.path.s_end or state.verdict.status is not Status.VERIFIED:
                assert state.verdict.status is Status.VERIFIED or math.isnan(state.tolerable_latency_s)
                continue
            planner.memory = outlook.memory
            plan = planner.follow(outlook.trajectory, outlook.begin, outlook.start, outlook.target)
            found = state.tolerable_latency_s
            first = math.inf
            for age in np.arange(0.0, found + 4.0 * step, 0.5 * step):
                known = outlook.known._replace(people=outlook.known.people.copy())
                known.people["t_obs"] -= age
                if check.check(outlook.now, plan, planner.slices, known).status is not Status.VERIFIED:
                    first = float(age)
                    break
            assert found < first, "an age within it is not verified"
            if not models and found < USUAL.latency_bound_s:
                assert first <= found + 1.5 * step
            compared.append(found)


def test_reports_that_old_are_adopted_and_older_ones_are_not(rng, count):
    """The whole way: another supervisor gets all reports later by as much, and judges the same plan."""
    both: list[float] = []
    for walk in walks(rng, both, count(100)):
        for k, outlook in walk.outlooks():
            found = probe_of(False, USUAL).state(outlook).tolerable_latency_s
            if k % 3 == 0 or not 0.002 < found < 0.1:
                continue
            causes = []
            for shift in (found - 1e-4, found + 2.0 * USUAL.latency_step_s):
                twin = walk.after(k, shift)
                if look(twin).start != outlook.start or look(twin).memory != outlook.memory:
                    break  # it was stopped before
                causes.append(twin.step(k * CYCLE).cause)
            if len(causes) == 2:
                assert causes == [Cause.ADOPTED, Cause.NOT_VERIFIED]
                both.append(found)
                break


def test_older_is_anything_from_as_old_as_now_to_that_much_older():
    """The interval in which a point was seen (``occupancy.hypotheses.PEOPLE``) only grows, to the past."""
    known = look(Walk.random(np.random.default_rng(0)).after(4)).known
    known.people["stamp_error"], known.people["t_complete"] = 0.01, 0.03
    grown = older(known, 0.2)
    assert (known.people["t_obs"][0, 0] < 0.05).all() and known.people["stamp_error"][0] == 0.01
    for name in ("t_obs", "t_complete"):
        before, after = known.people[name][0], grown.people[name][0]
        assert np.allclose(after, before - 0.2, equal_nan=True)
        ends = before + 2 * known.people["stamp_error"][0], after + 2 * grown.people["stamp_error"][0]
        assert np.allclose(*ends, equal_nan=True)
    assert grown.nobody_since == known.nobody_since - 0.2


def test_reports_to_spare():
    state = probe_of(False, USUAL).state(look(panda_supervisor()))
    assert replace(state, tolerable_latency_s=0.1).reports_to_spare(0.03) == 3
    assert replace(state, tolerable_latency_s=0.1).reports_to_spare(0.2) == 0
    assert replace(state, tolerable_latency_s=math.nan).reports_to_spare(0.03) == 0
    assert replace(state, tolerable_latency_s=0.1).reports_to_spare(math.nan) == 0


# The nearest pair


def planned(outlook: Outlook, walk: Walk):
    """The next plan, its check, and the planner that made it."""
    check, planner = fresh_check(walk), ShortTermPlanner(panda()[0].robot.limits, plans_of(walk))
    planner.memory = outlook.memory
    plan = planner.follow(outlook.trajectory, outlook.begin, outlook.start, outlook.target)
    return plan, check, planner


def test_no_pair_is_nearer_than_the_nearest(rng, count):
    """All rows of links against all rows of people, by going through all features of their hulls."""
    compared: list[float] = []
    for walk in walks(rng, compared, count(300)):
        for _, outlook in walk.outlooks(each=13):
            state = probe_of(False, USUAL).state(outlook)
            if state.nearest is None or state.verdict.status is not Status.VERIFIED:
                continue
            plan, check, planner = planned(outlook, walk)
            check.check(outlook.now, plan, planner.slices, outlook.known)
            check.open_obligations(planner.slices, count_people(outlook.known.people)[1])
            links, rows = (
                check.links[0],
                check.scene(planner.slices, outlook.known.people).occupancies[0].sets[0],
            )
            best = math.inf
            for i in range(int(planner.slices["n"][0])):
                a = [r for r in range(links["first"][i], links["first"][i + 1])
                     if check.ledger[0]["open"][i, links["owner"][r], 0]]  # fmt: skip
                b = list(range(rows["first"][i], rows["first"][i + 1]))
                if not a:
                    continue
                one = np.array([pad(links["points"][r, : links["n_points"][r]]) for r in a])[:, None]
                other = np.array([pad(rows["points"][r, : rows["n_points"][r]]) for r in b])[None]
                radii = links["radius"][a][:, None] + rows["radius"][b][None]
                apart = distance(*np.broadcast_arrays(one, other)) - radii
                best = min(best, float(apart.min()))
            found = state.nearest.witness
            assert found.gap_m == pytest.approx(best, abs=1e-6)
            apart = np.subtract(found.points[1], found.points[0])
            assert np.linalg.norm(apart) == pytest.approx(best, abs=1e-6)
            assert apart / np.linalg.norm(apart) == pytest.approx(state.nearest.direction, abs=1e-3)
            compared.append(best)


def test_nobody_can_come_nearer_than_the_gap(rng, count):
    """Brute force with kinematics, meshes and bodies of its own: what is left between link and person."""
    slacks: list[float] = []
    for walk in walks(rng, slacks, count(300)):
        for k, outlook in walk.outlooks(each=17):
            state = probe_of(False, USUAL).state(outlook)
            if state.nearest is None or state.verdict.status is not Status.VERIFIED:
                continue
            plan, _, planner = planned(outlook, walk)
            last = (k - 1) // 3 * 3
            points = person_at(*walk.place(last), 0.0)
            truth = Truth(
                "p1", points, np.zeros(3), np.ones((2, 20), bool), np.zeros((2, 20, 3)), np.full(20, 0.01)
            )
            seen = last * CYCLE - LATENCY_S - outlook.epoch
            people = outlook.known.people[0]
            late = float(people["clock_error"] + people["stamp_error"])
            person = told(truth, (seen, seen), late, 2.0, ALL_PARTS, 0.0)
            lasts = plan.t_rest - outlook.begin
            tau = np.linspace(0.0, lasts, 1 + math.ceil(lasts / 5e-4))
            slices = planner.slices[0]
            q = positions(outlook, planner, plan, tau)
            delay = float(slices["delay"][1])
            found = nearest_approach(arm("panda"), Motion(outlook.begin + tau + delay, q), [person], 1e-3)
            assert found is not None
            slacks.append(found.slack - state.nearest.witness.gap_m)
    print(f"\n{len(slacks)} plans, slack minus gap {min(slacks):.4f} to {max(slacks):.4f} m")
    assert min(slacks) > -1e-3 and max(slacks) < 0.2


def positions(outlook: Outlook, planner: ShortTermPlanner, plan, tau):
    """Where the plan commands the joints (T, n), from its path segments integrated here."""
    path = planner.path[0]
    n = int(path["n"])
    k = np.clip(np.searchsorted(path["t"][: n + 1], tau, side="right") - 1, 0, n - 1)
    x = tau - path["t"][k]
    s = path["s"][k] + x * (path["v"][k] + x * (path["a"][k] / 2.0 + x * path["j"][k] / 6.0))
    return outlook.trajectory.sample(np.minimum(s, plan.s_rest))[0]


def test_the_opening_is_how_the_distance_changes_along_the_path(rng, count):
    """Central differences of the distance between the link's axis on the path and the part's hull."""
    compared, robot = list[float](), panda()[0].robot
    for walk in walks(rng, compared, count(600)):
        for _, outlook in walk.outlooks(each=11):
            pair = probe_of(False, USUAL).state(outlook).nearest
            if pair is None or not math.isfinite(pair.opening_m_s) or pair.witness.gap_m < 0.0:
                continue
            plan, check, planner = planned(outlook, walk)
            check.check(outlook.now, plan, planner.slices, outlook.known)
            slices = planner.slices[0]
            i = int(np.argmin(np.abs(slices["t"][: slices["n"]] + outlook.epoch - pair.witness.slice[0])))
            rows = check.scene(planner.slices, outlook.known.people).occupancies[0].sets[0]
            link = robot.links.index(pair.witness.link)
            gaps = [
                [axis_distance(robot, outlook, link, rows, r, pair.s + ds) for ds in (-1e-5, 0.0, 1e-5)]
                for r in range(rows["first"][i], rows["first"][i + 1])
                if part_mask(rows["covers"][r]) == pair.witness.part
            ]
            assert gaps
            low, _, high = min(gaps, key=lambda gap: gap[1])
            assert pair.opening_m_s == pytest.approx((high - low) / 2e-5, abs=2e-3)
            compared.append(high - low)


def part_mask(covers) -> str:
    from verifier.evidence import part_names

    return part_names(int(covers))


def axis_distance(robot, outlook, link, rows, r, s) -> float:
    q = np.zeros(MAX_JOINTS)
    q[:7] = outlook.trajectory.sample(s)[0]
    rotation, position = np.zeros((MAX_JOINTS, 3, 3)), np.zeros((MAX_JOINTS, 3))
    forward(robot.kinematics, q, rotation, position)
    capsule = robot.enclosure[0]
    joint = int(capsule["joint"][link])
    ends = np.array([rotation[joint] @ capsule[end][link] + position[joint] for end in ("a", "b")])
    part = rows["points"][r, : rows["n_points"][r]]
    return float(distance(pad(ends)[None], pad(part)[None])[0]) - float(capsule["radius"][link])


def test_the_closest_points_of_a_segment_and_a_hull(rng, count):
    cases = [
        (rng.normal(size=(2, 3)), rng.normal(size=(int(rng.integers(1, 5)), 3)) + 2.0)
        for _ in range(count(20_000))
    ]
    found = [closest(*case) for case in cases]
    exact = between(*zip(*cases, strict=True))
    assert [np.linalg.norm(toward) for _, toward in found] == pytest.approx(exact, abs=1e-9)
    there = [
        (axis[0] + share * (axis[1] - axis[0]) + toward)[None]
        for (axis, _), (share, toward) in zip(cases, found, strict=True)
    ]
    assert np.where(exact > 1e-6, between(there, [points for _, points in cases]), 0.0).max() < 1e-9


def test_the_closest_points_of_a_segment_and_a_hull_of_many_points(rng, count):
    for _ in range(count(5_000)):
        axis, points = rng.normal(size=(2, 3)), rng.normal(size=(int(rng.integers(5, 33)), 3))
        points += rng.normal(size=3) * rng.choice([0.0, 2.0, 5.0])
        share, toward = closest(axis, points)
        there = axis[0] + share * (axis[1] - axis[0])
        exact = hull_distance(axis, points)
        assert np.linalg.norm(toward) == pytest.approx(exact, abs=1e-9)
        assert hull_distance(there[None], points) == pytest.approx(exact, abs=1e-9)


def between(one, other):
    """Distances of hulls, pair by pair."""
    return distance(np.array([pad(points) for points in one]), np.array([pad(points) for points in other]))


# Constraints


def test_a_refused_plan_comes_with_link_time_and_metres(rng, count):
    """Somebody farther away by what is lacking is far enough for that pair."""
    found, helped = list[float](), 0
    for walk in walks(rng, found, count(200)):
        supervisor = walk.new_supervisor()
        for k in range(150):
            command = supervisor.step(k * CYCLE, walk.reports(k))
            if command.cause is Cause.NOT_VERIFIED and command.verdict.reason is Reason.REACHABLE:
                break
        else:
            continue
        probe, outlook = probe_of(False, USUAL), look(supervisor)
        state = probe.state(outlook)
        refused = state.refused
        assert refused.reason is command.verdict.reason and refused.pair is not None
        assert refused.link in panda()[0].robot.links and "p1" in refused.other
        assert refused.lacking_m > 0.0 and refused.path_speed == state.allowed_path_speed
        begin = command.deadline
        assert outlook.made.begin + outlook.epoch == pytest.approx(begin, abs=1e-9)
        assert begin <= refused.t[0] < refused.t[1] and outlook.start.s - 0.05 < refused.s <= walk.path.s_end
        assert refused.link in refused.text and f"{refused.lacking_m:.3f}" in refused.text
        farther = outlook.known._replace(people=outlook.known.people.copy())
        farther.people["xyz"] += (refused.lacking_m + 1e-3) * refused.pair.direction
        moved = probe._finder.find(outlook._replace(known=farther), outlook.made)
        assert moved.witness.gap_m > refused.pair.witness.gap_m
        helped += moved.witness.gap_m > MARGIN
        found.append(refused.lacking_m)
    assert helped > 0.5 * len(found)


def test_where_no_stop_keeps_the_limits_the_joint_is_named():
    outlook = look(Walk.random(np.random.default_rng(0)).after(30))
    plan = PlanResult(PlanOutcome.NO_STOP, joint=2, quantity=Quantity.VELOCITY, value=3.0, limit=2.0)
    verdict = outlook.command.verdict._replace(reason=Reason.NO_STOP_WITHIN_LIMITS)
    finder = probe_of(False, USUAL)._finder
    found = finder.constraint(outlook, Made(plan, new_slices(), None, 0.0), verdict, 0.5)
    assert found.joint == "panda_joint3" and (found.value, found.limit) == (3.0, 2.0)
    assert found.link == "" and math.isnan(found.lacking_m) and found.path_speed == 0.5
    assert "panda_joint3" in found.text


def refused_in(cell: Cell, reports) -> tuple[SafetyProbe, Outlook, Verdict]:
    """What is known after the first step that refused to go on from home to :data:`PANDA_AWAY`."""
    supervisor = Supervisor.from_cell(cell, PANDA_HOME)
    way = quintic([PANDA_HOME, PANDA_AWAY], supervisor.check.robot.limits)
    assert supervisor.propose(NewTrajectory(way)) is None
    for k in range(300):
        command = supervisor.step(k * CYCLE, reports(k * CYCLE))
        if command.cause is Cause.NOT_VERIFIED:
            probe = SafetyProbe.from_cell(cell, USUAL, supervisor.check.robot)
            return probe, look(supervisor), command.verdict
    pytest.fail("everything was verified")


def test_a_fixture_in_the_way_is_named():
    post = {"kind": "box", "size_m": (0.1, 0.1, 1.0), "xyz_m": (0.3, 0.6, 0.5), "position_error_m": 0.01}
    cell = Cell.from_table(PANDA | {"workspace": {"fixtures": {"post": post}}})
    probe, outlook, verdict = refused_in(cell, lambda now: [report(now, 4.0)])
    assert verdict.reason is Reason.FIXTURE_IN_REACH
    refused = probe.state(outlook).refused
    assert refused.reason is Reason.FIXTURE_IN_REACH and refused.other == "post"
    assert 0.0 < refused.lacking_m < 0.1 and refused.pair.witness.gap_m == pytest.approx(
        verdict.gap_m, abs=1e-6
    )
    assert math.isnan(refused.pair.opening_m_s) and 0.0 < refused.s < outlook.trajectory.s_end
    found = probe.would_verify(outlook, outlook.trajectory)
    assert not found.verified and found.constraint.other == "post"


def test_who_may_come_in_unseen_is_named():
    room = {"kind": "box", "min_m": (-1.2, -1.2, -1.0), "max_m": (1.2, 1.2, 2.0), "detection_time_s": 0.1}
    people = PANDA["people"] | {"monitored": {"room": room}, "empty_report_valid_s": 2.0}
    nobody = Cell.from_table(PANDA | {"people": people})
    probe, outlook, verdict = refused_in(
        nobody, lambda now: [RawMeasurement(now, now, "world", True, ())] if now < 0.1 else []
    )
    assert verdict.reason is Reason.REACHABLE
    refused = probe.state(outlook).refused
    assert "unobserved space" in refused.other and refused.lacking_m > 0.0
    assert math.isfinite(refused.pair.opening_m_s)


def test_where_nobody_is_known_to_be_the_latency_is_that_of_the_empty_report():
    supervisor = panda_supervisor()
    way = quintic([PANDA_HOME, PANDA_AWAY], panda()[0].robot.limits)
    supervisor.propose(NewTrajectory(way))
    for k in range(3):
        supervisor.step(
            k * CYCLE, [RawMeasurement(k * CYCLE, k * CYCLE, "world", True, ())] if k == 0 else []
        )
    valid = panda()[2].people.empty_report_valid_s
    state = probe_of(False, ProbeSettings(latency_bound_s=4.0 * valid)).state(look(supervisor))
    assert state.verdict.reason is Reason.NOBODY_REPORTED and state.nearest is None
    assert state.allowed_path_speed == 1.0
    assert state.tolerable_latency_s == pytest.approx(valid - 3 * CYCLE, abs=2e-3)


# Dry runs


def test_a_dry_run_finds_the_first_place_that_is_too_close(rng, count):
    verified, refused = 0, list[float]()
    for walk in walks(rng, refused, count(100)):
        probe = probe_of(False, USUAL)
        check, planner = fresh_check(walk), ShortTermPlanner(panda()[0].robot.limits, plans_of(walk))
        for _, outlook in walk.outlooks(each=40):
            other = Walk.random(rng).path
            found = probe.would_verify(outlook, other, step_s=0.05)
            first = math.nan
            for s in np.arange(other.s_begin, other.s_end, 0.05):
                plan = planner.plan(other, outlook.begin, float(s))
                answer = check.check(outlook.now, plan, planner.slices, outlook.known)
                if answer.status is not Status.VERIFIED:
                    first = float(s)
                    break
            assert found.s == pytest.approx(first, nan_ok=True) and found.verified == math.isnan(first)
            assert found.refusal is None
            verified += found.verified
            if not found.verified:
                refused.append(found.s)
                assert found.constraint.reason is answer.reason
                assert found.constraint.path_speed < 1.0
    assert verified > 0


def test_what_would_not_be_taken_over_is_said_at_once():
    walk = Walk.random(np.random.default_rng(0))
    supervisor = walk.after(3)
    fast = quintic([PANDA_HOME, PANDA_AWAY], panda()[0].robot.limits, 1.3)
    found = probe_of(False, USUAL).would_verify(look(supervisor), fast)
    assert not found.verified and found.refusal == supervisor.propose(NewTrajectory(fast))


def test_where_nothing_is_verified_any_more_nothing_would_be_either():
    walk = Walk.random(np.random.default_rng(0))
    outlook, probe = look(walk.after(3)), probe_of(False, USUAL)
    assert probe.would_verify(outlook, walk.path, step_s=0.5).places > 0
    found = probe.would_verify(outlook._replace(latched=True), walk.path, step_s=0.5)
    assert (found.verified, found.places, found.constraint, found.refusal) == (False, 0, None, None)


# Beside the loop


def test_who_asks_changes_nothing(rng):
    walk = Walk.random(rng)
    one, other = walk.new_supervisor(), walk.new_supervisor()
    probe = probe_of(False, USUAL)
    for k in range(60):
        a = one.step(k * CYCLE, walk.reports(k))
        if k % 4 == 0:
            probe.state(look(one))
            probe.would_verify(look(one), walk.path, step_s=0.5)
        b = other.step(k * CYCLE, walk.reports(k))
        assert (a.q == b.q).all() and a.cause is b.cause and a.verdict.reason is b.verdict.reason


def test_after_a_withdrawal_planners_are_answered_as_before(rng):
    """No step goes on then: what they get begins with the command that counts now."""
    walk = Walk.random(rng)
    supervisor = walk.new_supervisor()
    withdrawn = 0
    for k in range(40):
        command = supervisor.step(k * CYCLE, walk.reports(k))
        if k % 7 == 6 and command.cause is Cause.ADOPTED:
            withdrawn += 1
            assert supervisor.withdraw() is not command
        found = supervisor.outlook()
        assert found is not None and found.command is supervisor._last
    assert withdrawn > 0


def test_what_is_copied_beside_the_loop_belongs_together():
    """A thread asks without pause; whatever it gets is what the loop's own thread saw between two steps."""
    walk = Walk.random(np.random.default_rng(1))
    supervisor = walk.new_supervisor()
    supervisor.step(0.0, walk.reports(0))
    expected, seen, done = {}, [], threading.Event()

    def key(outlook: Outlook):
        return outlook.start, outlook.memory, outlook.begin, outlook.command.t, outlook.known.people.tobytes()

    def ask() -> None:
        while not done.is_set():
            found = supervisor.outlook()
            if found is not None:
                seen.append((found.now, key(found)))

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    thread = threading.Thread(target=ask, daemon=True)
    try:
        thread.start()
        for k in range(1, 400):
            supervisor.step(k * CYCLE, walk.reports(k))
            found = look(supervisor)
            expected[found.now] = key(found)
    finally:
        done.set()
        thread.join(10.0)
        sys.setswitchinterval(interval)
    compared = 0
    for now, what in seen:
        if now in expected:
            compared += 1
            assert what == expected[now]
    assert compared > 20 and supervisor.fault is None


def test_another_process_can_be_asked(rng):
    """What is copied can be sent: a planner's own process computes the same from it."""
    found = 0
    for _, outlook in Walk.random(rng).outlooks(each=3):
        sent = pickle.loads(pickle.dumps(outlook))
        here, there = (probe_of(False, USUAL).state(each) for each in (outlook, sent))
        assert str(replace(here, nearest=None, refused=None)) == str(
            replace(there, nearest=None, refused=None)
        )
        assert (here.refused is None) == (there.refused is None)
        found += here.nearest is not None and here.nearest.witness == there.nearest.witness
    assert found > 0


def test_nobody_waits_for_ever_for_a_step_that_hangs():
    supervisor = panda_supervisor()

    def hanging():
        with pytest.raises(TimeoutError, match=r"0\.01 s"):
            look(supervisor, 0.01)
        yield report(0.0, 4.0)

    supervisor.step(0.0, hanging())
    assert supervisor.fault is None and look(supervisor).command.cause is Cause.RESTING


def test_times_are_those_of_the_caller():
    walk = Walk.random(np.random.default_rng(3))
    supervisor = walk.new_supervisor()
    for k in range(20):
        now = EPOCH + k * CYCLE
        command = supervisor.step(now, [report(now - LATENCY_S, *walk.place(k), arrived=now)])
    state = SafetyProbe.from_cell(panda()[2], USUAL, panda()[0].robot).state(look(supervisor))
    assert state.t == pytest.approx(command.t, abs=1e-6)
    assert state.verdict.t == pytest.approx(EPOCH + 20 * CYCLE, abs=1e-6)
    assert state.t - 1e-6 <= state.nearest.witness.slice[0] < state.t + 2.0
    assert PathState(state.s, state.sdot, 0.0).s > 0.0
