"""Whatever is called, in whatever order: what is commanded was verified before it began, and ends at rest."""

from __future__ import annotations

import math

import hypothesis.strategies as st
import numpy as np
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from failsafe.plan import PlanSettings
from failsafe.preparation import Reserve
from failsafe.trajectory import IntendedTrajectory
from occupancy.report import RawMeasurement
from tests.failsafe.motions import path_of
from tests.verifier.robot_side import Plan, Recorder
from tests.verifier.supervised import CYCLE, EPOCH, PANDA_AWAY, PANDA_HOME, panda, quintic, report
from verifier.command import Cause, Command, State
from verifier.known import PeopleWatch
from verifier.proposal import JointVelocity, NewTrajectory, PathSpeed, Stop
from verifier.setup import build_gate
from verifier.supervisor import Supervisor, SupervisorSettings
from verifier.tracking import JointReading
from verifier.verdict import Status

NAN = math.nan


class Calls(RuleBasedStateMachine):
    """Every call that a supervisor has, with good and bad arguments."""

    def __init__(self) -> None:
        super().__init__()
        check, profile, cell = panda()
        self.limits = check.robot.limits
        self.recorder = Recorder(check)
        plans = PlanSettings(
            CYCLE, (0.0, 0.004), np.full(7, 0.001), np.zeros(7), slice_s=0.02, allow_joint_space=False
        )
        watch = PeopleWatch(build_gate(cell, profile), 0.0)
        chosen = SupervisorSettings(0.25 * CYCLE, Reserve(step_s=0.25))
        self.supervisor = Supervisor(self.recorder, watch, plans, chosen, PANDA_HOME)
        self.recorder.supervisor = self.supervisor
        self.now = EPOCH
        self.held: Plan | None = None
        self.before: Plan | None = None
        self.command: Command | None = None
        self.stream: dict[float, Command] = {}
        self.person = 3.0
        self.latched = False

    # What the robot side holds, told from outside.

    def place(self, plan: Plan | None, t: float):
        if plan is None:
            return PANDA_HOME, np.zeros(7), np.zeros(7)
        return plan.motion(t - self.supervisor._epoch)

    def take(self, command: Command, now: float) -> None:
        found = self.recorder.found
        if command.cause is Cause.ADOPTED:
            assert command.verdict.status is Status.VERIFIED
            assert found is not None, "adopted without a check"
            near = now - self.supervisor._epoch
            assert found.found <= near + 1e-9 and near < found.begin <= command.t - self.supervisor._epoch
            self.before, self.held = self.held, found
        self.recorder.found = None
        self.command = command
        if math.isfinite(command.t):
            self.stream[command.t] = command

    @rule(
        cycles=st.sampled_from([1] * 12 + [0, -3, 2, 3, 6, 1.7, 0.8, NAN, math.inf]),
        people=st.sampled_from(
            ["none", "far", "far", "far", "near", "nobody", "stale", "ahead", "nan", "frame", "twice"]
        ),
        joints=st.sampled_from(["none", "none", "follows", "off", "nan", "shape"]),
        plant=st.sampled_from([""] * 12 + ["check", "follow", "take", "joints"]),
    )
    def step(self, cycles: float, people: str, joints: str, plant: str) -> None:
        self.step_with(cycles, people, joints, plant)

    def step_with(self, cycles: float, people: str, joints: str, plant: str) -> None:
        now = self.now + cycles * CYCLE
        if math.isfinite(now):
            self.now = max(self.now, now)
        supervisor, planner = self.supervisor, self.supervisor._planner
        kept = planner.follow, supervisor._spare.take
        self.recorder.fail = plant == "check"
        if plant == "follow":
            planner.follow = None
        spare = supervisor._spare
        if plant == "take":
            spare.take = None
        reading = object() if plant == "joints" else self.joints(joints)
        command = supervisor.step(now, self.people(people), reading)
        planner.follow = kept[0]
        if plant == "take":
            spare.take = kept[1]
        self.recorder.fail = False
        last = self.command
        self.take(command, now)
        if command.cause is Cause.CLOCK and last is not None:
            assert np.array_equal(command.q, last.q) and command.outcome is last.outcome

    def people(self, kind: str) -> list[RawMeasurement]:
        now = self.now
        far = report(now - 0.02, self.person, arrived=now)
        bad = far.people[0]._replace(xyz=np.full((20, 3), NAN))
        return {
            "none": [],
            "far": [far],
            "near": [report(now - 0.02, 0.9, arrived=now)],
            "nobody": [far._replace(people=())],
            "stale": [far._replace(stamp=now - 5.0)],
            "ahead": [far._replace(stamp=now + 5.0)],
            "nan": [far._replace(people=(bad,))],
            "frame": [far._replace(frame="nowhere")],
            "twice": [far, far],
        }[kind]

    def joints(self, kind: str) -> JointReading | None:
        t = self.now - 2 * CYCLE
        q = self.place(self.held, t)[0] if self.held is None or t >= self.begin() else None
        if kind == "none" or q is None:
            return None
        return {
            "follows": JointReading(t, q + 1e-3),
            "off": JointReading(t, q + 0.5),
            "nan": JointReading(t, np.full(7, NAN)),
            "shape": JointReading(t, np.zeros(3)),
        }[kind]

    def begin(self) -> float:
        return self.held.begin + self.supervisor._epoch

    @rule(n=st.integers(1, 40), every=st.sampled_from([1, 2, 4, 9]))
    def go_on(self, n: int, every: int) -> None:
        """As it should be, for a while."""
        for k in range(n):
            self.step_with(1, "far" if k % every == 0 else "none", "none", "")
            self.the_last_command_is_of_the_plan_that_is_held()
            self.commands_are_one_curve_within_the_limits()

    @rule()
    def raise_while_reports_are_taken_in(self) -> None:
        if len(self.stream) < 200:  # rarely: nothing is verified after it
            return
        self.now += CYCLE
        command = self.supervisor.step(self.now, (1 / 0 for _ in range(1)))
        self.latched = True
        self.take(command, self.now)
        assert command.cause in (Cause.FAULT, Cause.LATCHED)

    @rule()
    def withdraw(self) -> None:
        adopted = self.command is not None and self.supervisor._adopted_last
        command = self.supervisor.withdraw()
        if adopted:
            self.held = self.before
            assert command.cause is Cause.WITHDRAWN
        self.take(command._replace(cause=Cause.WITHDRAWN), self.now)

    @rule(
        kind=st.sampled_from(["path", "path", "join", "join", "jump", "joints", "fast"]),
        load=st.floats(0.2, 0.75),
    )
    def propose_a_trajectory(self, kind: str, load: float) -> None:
        view = self.supervisor.view()
        here = self.command.q if self.command is not None else PANDA_HOME
        goal = PANDA_HOME if np.abs(here - PANDA_HOME).max() > 0.3 else PANDA_AWAY
        proposal = {
            "path": lambda: NewTrajectory(quintic([here, goal, PANDA_HOME], self.limits, load)),
            "join": lambda: NewTrajectory(self.branch(view.s_rest + 0.05, load), view.s_rest + 0.05),
            "jump": lambda: NewTrajectory(quintic([here + 0.01, goal], self.limits, load)),
            "joints": lambda: NewTrajectory(IntendedTrajectory([0.0, 1.0], np.zeros((1, 1, 3)))),
            "fast": lambda: NewTrajectory(quintic([here, goal], self.limits, 1.5)),
        }[kind]()
        refusal = self.supervisor.propose(proposal)
        assert refusal is not None or kind in ("path", "join", "jump")

    def branch(self, join: float, load: float) -> IntendedTrajectory:
        """From where the running trajectory is at ``join`` to rest."""
        old = self.supervisor._running.trajectory
        join = min(max(join, old.s_begin), old.s_end)
        q, v, a, _ = old.sample(join)
        T = 2.0 / load
        rows = np.array([[T**3, T**4, T**5], [3 * T**2, 4 * T**3, 5 * T**4], [6 * T, 12 * T**2, 20 * T**3]])
        right = np.stack([0.1 - v * T / 2 - a * T**2 / 2, -v - a * T, -a])
        c = np.concatenate([np.stack([q, v, a / 2]), np.linalg.solve(rows, right)])
        return IntendedTrajectory([5.0, 5.0 + T], c[None], "rest")

    @rule(
        share=st.floats(0.0, 1.1),
        number=st.integers(0, 99),
        horizon=st.sampled_from([0.0, 0.1, 0.1, 0.5, -1.0, NAN]),
    )
    def propose_a_joint_velocity(self, share: float, number: int, horizon: float) -> None:
        direction = np.random.default_rng(number).uniform(-1.0, 1.0, 7)
        self.supervisor.propose(JointVelocity(share * direction * self.limits.velocity, horizon))

    @rule(n=st.integers(1, 15), number=st.integers(0, 99))
    def be_guided(self, n: int, number: int) -> None:
        """A stream of joint velocities, one a cycle."""
        rng = np.random.default_rng(number)
        for _ in range(n):
            dq = rng.uniform(-0.4, 0.4, 7)
            self.supervisor.propose(JointVelocity(dq, 0.1))
            self.step_with(1, "far", "none", "")
            self.the_last_command_is_of_the_plan_that_is_held()
            self.commands_are_one_curve_within_the_limits()

    @rule(sdot=st.one_of(st.floats(-1.0, 1.0), st.sampled_from([NAN, -1.0, -1.0, 2.0, 1.0, 0.0])))
    def propose_a_path_speed(self, sdot: float) -> None:
        self.supervisor.propose(PathSpeed(sdot))

    @rule()
    def propose_a_stop(self) -> None:
        self.supervisor.propose(Stop())

    @rule(by=st.floats(-0.02, 0.02))
    def walk(self, by: float) -> None:
        self.person = min(max(self.person + by, 0.5), 4.0)

    @invariant()
    def the_last_command_is_of_the_plan_that_is_held(self) -> None:
        command = self.command
        if command is None or not math.isfinite(command.t):
            return
        q, dq, ddq = self.place(self.held, command.t)
        # a double since 1970 is 2.4e-7 s coarse
        assert np.abs(command.q - q).max() <= 1e-9 + 5e-7 * np.abs(dq).max()
        assert np.abs(command.dq - dq).max() <= 1e-6 * (1.0 + np.abs(ddq).max())
        assert np.isfinite(command.ddq).all()
        if command.outcome is State.STOPPED:
            assert not command.dq.any() and not command.ddq.any()

    @invariant()
    def commands_are_one_curve_within_the_limits(self) -> None:
        """Trapezoid rule: with a jerk of at most J the error is at most J h³/12 in q and J h²/4 in dq."""
        newest = sorted(self.stream)[-2:]
        limits, slack = self.limits, 1.0 + 1e-6
        for t in newest:
            assert (np.abs(self.stream[t].dq) <= limits.velocity * slack).all()
            assert (np.abs(self.stream[t].ddq) <= limits.acceleration * slack).all()
        if len(newest) == 2:
            a, b = (self.stream[t] for t in newest)
            h = b.t - a.t
            assert (np.abs(b.q - a.q - h * (a.dq + b.dq) / 2) <= limits.jerk * h**3 / 12 + 2e-7).all()
            assert (np.abs(b.dq - a.dq - h * (a.ddq + b.ddq) / 2) <= limits.jerk * h**2 / 4 + 2e-5).all()

    @precondition(lambda self: self.latched)
    @invariant()
    def nothing_is_adopted_after_a_fault_in_the_reports(self) -> None:
        assert self.command.cause is not Cause.ADOPTED

    def teardown(self) -> None:
        """After the last plan that is verified the robot comes to rest, and stays there."""
        self.recorder.refuse = True
        for _ in range(400):
            self.now += CYCLE
            self.take(self.supervisor.step(self.now), self.now)
            self.the_last_command_is_of_the_plan_that_is_held()
            self.commands_are_one_curve_within_the_limits()
            if self.command.outcome is State.STOPPED:
                break
        rest = self.command
        assert rest.outcome is State.STOPPED
        if self.held is not None:
            end = float(self.held.record["t"][self.held.record["n"]])
            tau = rest.t - self.begin()
            s = float(path_of(self.held.record, np.array([min(tau, end)]))[0][0])
            # beyond the end of the path the robot rests, whatever the path speed is
            assert tau >= end - 1e-6 or s >= self.held.trajectory.s_end - 1e-6
        self.now += 50 * CYCLE
        later = self.supervisor.step(self.now)
        assert later.outcome is State.STOPPED and not later.dq.any()
        # turned round, its place is that of another polynomial
        assert np.abs(later.q - rest.q).max() <= 1e-12


def test_whatever_is_called_the_robot_does_what_was_verified_and_comes_to_rest(count, request):
    chosen = settings(
        max_examples=max(20, count(1_000)), stateful_step_count=60, deadline=None,
        suppress_health_check=list(HealthCheck), database=None, print_blob=False, phases=[Phase.generate],
    )  # fmt: skip
    machine = seed(int(request.config.getoption("--seed")))(Calls)
    run_state_machine_as_test(machine, settings=chosen)
