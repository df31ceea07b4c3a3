"""The closed loop that tries to make the supervisor fail: whoever obeys the assumptions, and wants a contact.

The supervisor sees late and wrong reports and commands a robot that follows late and inexactly, all within
what the cell declares; the truth (`adversary_truth_kernels`) is computed beside it. Whatever is counted is
measured on the commands as they come out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from failsafe.preparation import Refusal, Reserve
from occupancy.report import RawMeasurement, RawPerson
from tests.soundness.adversary_arm import model, surface
from tests.soundness.adversary_kernels import FOUND, QUANTITIES, hold, let_go, note, robot_at
from tests.soundness.adversary_people_kernels import MAX_PEOPLE, see
from tests.soundness.adversary_planner import posture, trajectory
from tests.soundness.adversary_scene import (
    REGION_M,
    SILENCE_S,
    STANDSTILL_M_S,
    Crowd,
    Scene,
    crowd,
    random_scene,
    robot_block,
)
from tests.soundness.adversary_truth_kernels import BINS, TALLY, advance
from verifier.command import Cause, Command, State
from verifier.proposal import JointVelocity, NewTrajectory, PathSpeed, Proposal, Stop
from verifier.setup import Supervised, build_supervised
from verifier.supervisor import Supervisor, SupervisorSettings
from verifier.tracking import JointReading
from verifier.verdict import Status

Array = NDArray[np.float64]
Alteration = Callable[[Supervised, Scene], Supervised]

STEP_OF_PREPARATION_S = 0.1
"""Distance of the places at which a proposal is looked at: coarser than usual, to propose more often."""


@dataclass
class Total:
    """What many runs came to."""

    runs: int = 0
    cycles: int = 0
    moving: int = 0
    contacts: int = 0
    deepest: float = np.inf
    refused_by: float = 0.0
    vacuous: int = 0
    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(BINS), dtype=np.int64))
    nearest: list[float] = field(default_factory=list)
    excess: NDArray[np.int64] = field(default_factory=lambda: np.zeros(QUANTITIES, dtype=np.int64))
    worst: Array = field(default_factory=lambda: np.zeros(QUANTITIES))
    states: Counter[State] = field(default_factory=Counter)
    causes: Counter[Cause] = field(default_factory=Counter)
    events: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)

    def add(self, other: Total) -> None:
        """Take in the result of other runs."""
        for name in ("runs", "cycles", "moving", "contacts", "vacuous", "histogram", "excess"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.deepest = min(self.deepest, other.deepest)
        self.refused_by = max(self.refused_by, other.refused_by)
        self.worst = np.maximum(self.worst, other.worst)
        self.nearest += other.nearest
        self.failures += other.failures
        for name in ("states", "causes", "events"):
            getattr(self, name).update(getattr(other, name))

    def summary(self) -> str:
        """One line."""
        shares = ", ".join(f"{state.name} {self.share(state):.1%}" for state in State)
        near = f"{min(self.nearest) * 1e3:.1f} mm" if self.nearest else "never"
        return (
            f"{self.runs} runs, {self.cycles} cycles, {self.contacts} with contact, excess {self.excess}, "
            f"nearest {near}, {self.vacuous} runs without approach, {shares}, {dict(self.events)}"
        )

    def share(self, state: State) -> float:
        """Share of the cycles that a state had."""
        return self.states[state] / max(1, sum(self.states.values()))


def made(scene: Scene, q: Array, alteration: Alteration | None) -> Supervisor:
    """Make the supervisor of a scene as a cell does, with the arm from memory; ``alteration`` weakens it."""
    cell = scene.cell()
    robot = model(scene.robot, scene.mounted)
    with patch("verifier.setup.build_robot", lambda *_, **__: robot):
        parts = build_supervised(cell)
    if alteration is not None:
        parts = alteration(parts, scene)
    settings = SupervisorSettings(0.25 * cell.cycle_s, Reserve(step_s=STEP_OF_PREPARATION_S))
    return Supervisor(parts.check, parts.watch, parts.plans, settings, q)


class Run:
    """One scene from its begin on."""

    def __init__(self, scene: Scene, seed: list[int], alteration: Alteration | None = None) -> None:
        self.scene = scene
        self.rng = np.random.default_rng(seed)
        self.seed, self.name = seed, f"seed {seed}"
        self.arm = model(scene.robot, scene.mounted)
        self.surface = surface(scene.robot, scene.mounted, float(self.rng.uniform(0.0, 0.04)))
        q = posture(self.rng, self.arm.limits)
        self.supervisor = made(scene, q, alteration)
        self.held = robot_block(scene, q)
        self.plans, self.robot = self.held
        self.crowd: Crowd = crowd(scene, self.rng)
        self.near = np.zeros(MAX_PEOPLE, dtype=FOUND)
        self.near["distance"] = 1e3
        self.tally = np.zeros(1, dtype=TALLY)
        self.tally["nearest"] = self.tally["deepest"] = np.inf
        self.total = Total(runs=1)
        self.contradicted_at: list[int] = []
        self.first_contact = -1
        self._xyz = np.zeros((MAX_PEOPLE, 20, 3))
        self._names = [f"p{p}" for p in range(scene.persons)]
        # who is there at first has been there for long
        self._inside = np.where(self._who_is_inside(), -np.inf, np.inf)
        self._next_seen, self._post, self._last_arrival = 0.0, [], 0.0
        self._renamed = 0
        self._silent_until, self._talks = 0.0, 1.0
        self._next_idea = 0

    def until_contact(self, cycles: int) -> Total:
        """Run the loop for so many cycles, or until something is found."""
        return self.go(cycles, lambda: bool(self.tally[0]["contacts"] or self.robot[0]["excess"].any()))

    # What the sensors say.

    def _look(self, k: int) -> None:
        """Make the reports about what was seen in the cycle that has passed."""
        scene, h = self.scene, self.scene.cycle
        while self._next_seen < (k + 1) * h:
            seen = self._next_seen
            self._next_seen += scene.period
            self._note_who_is_inside(seen)
            if seen > self._silent_until + self._talks:
                self._silent_until = seen + scene.silent
                self._talks = self.rng.uniform(*SILENCE_S)
            if seen < self._silent_until or (scene.dropped and self.rng.random() < scene.dropped):
                continue
            self._post.append(self._report(seen, (seen - k * h) / h))

    def _note_who_is_inside(self, seen: float) -> None:
        """Since when some part of each person has been where complete reports list everybody."""
        self._inside = np.where(self._who_is_inside(), np.minimum(self._inside, seen), np.inf)

    def _who_is_inside(self) -> NDArray[np.bool_]:
        """Who has some part where complete reports list everybody."""
        points = self.crowd.block[0]["points"][: self.scene.persons]
        found: NDArray[np.bool_] = (np.abs(points[..., :2]).max(axis=2) < REGION_M + 0.4).any(axis=1)
        return found

    def _report(self, seen: float, x: float) -> RawMeasurement:
        scene, rng = self.scene, self.rng
        error = np.full(20, scene.position_error)
        see(self.crowd.block, self.near, x, scene.kind_error, error, self.crowd.bias, self._xyz)
        doubt = sum(scene.doubt)
        shift = (doubt, -doubt, doubt * (2.0 * rng.random() - 1.0))[scene.kind_stamp]
        arrived = seen + scene.latency[0] + scene.latency[1] * rng.random()
        if scene.in_order:
            arrived = max(arrived, self._last_arrival)
        self._last_arrival = arrived
        if scene.renamed and rng.random() < scene.renamed:
            self._rename()
        detected = seen - self._inside >= max(0.0, scene.detection - 2.0 * doubt)
        people = []
        for p in rng.permutation(scene.persons):
            if scene.complete and not detected[p]:
                continue
            xyz = self._xyz[p].copy()
            xyz[~self.crowd.shown] = np.nan
            if scene.missing:
                xyz[rng.random(20) < scene.missing] = np.nan
            stated = error if scene.stated else np.full(20, np.nan)
            people.append(RawPerson(self._names[p], xyz, stated, (1 << 20) - 1))
        base = scene.epoch
        return RawMeasurement(base + seen + shift, base + arrived, "world", scene.complete, tuple(people))

    def _rename(self) -> None:
        """Exchange the names of two people, or give one a new name."""
        self.total.events["renamed"] += 1
        if self.scene.persons > 1 and self.rng.random() < 0.5:
            a, b = self.rng.choice(self.scene.persons, 2, replace=False)
            self._names[a], self._names[b] = self._names[b], self._names[a]
        elif self._renamed < 4:
            self._renamed += 1
            self._names[int(self.rng.integers(self.scene.persons))] = f"n{self._renamed}"

    def _delivered(self, now: float) -> list[RawMeasurement]:
        due = [report for report in self._post if report.arrived <= now]
        if due:
            self._post = [report for report in self._post if report.arrived > now]
            due.sort(key=lambda report: report.arrived)
        return due

    # What a planner wants.

    def _propose(self, k: int, command: Command | None) -> None:
        """Now and then ask for something else."""
        rng, supervisor, limits = self.rng, self.supervisor, self.arm.limits
        state = State.STOPPED if command is None else command.outcome
        n = len(self.arm.joints)
        wait = rng.uniform(0.2, 2.0) if state is not State.STOPPED else rng.uniform(0.0, 0.3)
        self._next_idea = k + 1 + int(wait / self.scene.cycle)
        draw = rng.random()
        if state is State.STOPPED and (command is None or command.cause is Cause.RESTING or draw < 0.2):
            q = self.robot[0]["last"][0, :n] if command is None else command.q
            start = (q.copy(), np.zeros(n), np.zeros(n))
            new = trajectory(rng, limits, start, self.scene.load, int(rng.integers(1, 4)))
            self._hand_over(None if new is None else NewTrajectory(new))
        elif state is not State.STOPPED and draw < 0.5:
            view = supervisor.view()
            present = supervisor._running.trajectory
            join = view.s_rest + rng.uniform(0.001, 0.4)
            if join < present.s_end - 0.05 and present.s_end < 8.0:
                q, v, a, _ = present.sample(join)
                new = trajectory(rng, limits, (q, v, a), self.scene.load, int(rng.integers(1, 3)))
                self._hand_over(None if new is None else NewTrajectory(new, join))
        elif draw < 0.55:
            self._hand_over(JointVelocity(rng.normal(size=n) * 0.4 * limits.velocity, rng.uniform(0.0, 0.5)))
            self._next_idea = k + 1 + int(rng.uniform(0.0, 0.05) / self.scene.cycle)
        elif draw < 0.62:
            self._hand_over(PathSpeed(float(rng.choice([0.3, 1.0, 1.0, -1.0, -0.5]))))
        elif draw < 0.65:
            self._hand_over(Stop())
        else:
            supervisor.propose(PathSpeed(1.0))

    def _hand_over(self, proposal: Proposal | None) -> None:
        if proposal is None:
            self.total.events["no way found"] += 1
            return
        refusal: Refusal | None = self.supervisor.propose(proposal)
        kind = type(proposal).__name__
        if isinstance(proposal, NewTrajectory) and proposal.join_s is not None:
            kind = "spliced"
        self.total.events[f"{kind} refused" if refusal is not None else kind] += 1

    # The loop.

    def go(self, cycles: int, enough: Callable[[], bool] | None = None) -> Total:
        """Run the loop for so many cycles, or until there is ``enough``; return what came of it."""
        scene, rng, h = self.scene, self.rng, self.scene.cycle
        arm, clusters = self.surface.block, (self.surface.centre, self.surface.radius, self.surface.points)
        robot, people, parts = self.robot, self.crowd.block, self.crowd.parts
        supervisor, states, causes = self.supervisor, self.total.states, self.total.causes
        robot_at(arm, self.plans, robot, 0.0, 0.0)
        missing, state = 0, 0
        command: Command | None = None
        odd = np.random.default_rng([*self.seed, 1]).random((cycles, 4)).T.copy()
        for k in range(cycles):
            if missing == 0 and k > 2 and odd[0, k] < scene.missed:
                missing = int(rng.integers(1, 30))
            if missing > 0:
                missing -= 1
                if robot[0]["newest"] < k + 2:
                    note(self.plans, robot, *self._held(k + 2))
            else:
                if k >= self._next_idea or (command is not None and command.cause is Cause.RESTING):
                    self._propose(k, command)
                now = scene.epoch + k * h
                if k > 0 and scene.late and odd[1, k] < scene.late:
                    now += h * (rng.uniform(-0.2, 0.0) if rng.random() < 0.3 else rng.uniform(0.0, 0.95))
                due = self._delivered(now) if self._post else ()
                joints = self._joints(k, now) if odd[2, k] < scene.readings else None
                command = supervisor.step(now, due, joints)
                state = int(command.outcome)
                states[command.outcome] += 1
                causes[command.cause] += 1
                if command.verdict.status is Status.CONTRADICTED:
                    self.contradicted_at.append(k)
                if command.cause is not Cause.CLOCK:
                    command = self._take(command, withdrawn=bool(odd[3, k] < scene.withdrawn))
                if odd[2, k] < 0.02 or supervisor.fault is not None:
                    self._hold_against(command, now)
            advance(
                arm, clusters, self.held, people, parts, self.near, self.tally, (k, state, STANDSTILL_M_S)
            )
            if self._next_seen < (k + 1) * h:
                self._look(k)
            if self.tally[0]["contacts"] and self.first_contact < 0:
                self.first_contact = k
            if enough is not None and enough():
                break
        return self._closed()

    def _take(self, command: Command, *, withdrawn: bool) -> Command:
        """Hand a command to the robot, or withdraw it; instants in between are those of the plan it holds."""
        supervisor, robot = self.supervisor, self.robot
        place = round((command.t - self.scene.epoch) / self.scene.cycle)
        if not abs(command.t - self.scene.epoch - place * self.scene.cycle) < 2e-6:
            self._fail(f"t {command.t} is not on the grid")
        if command.cause is Cause.ADOPTED:
            running = supervisor._running
            b, c = running.trajectory.kernel_breaks, running.trajectory.kernel_coefficients
            if not hold(self.plans, robot, running._path, b, c, supervisor._begin):
                raise AssertionError("a plan over too many spans")
        if withdrawn:
            self.total.events["withdrawn"] += 1
            if command.cause is Cause.ADOPTED:
                let_go(robot)
            command = supervisor.withdraw()
        while robot[0]["newest"] < place - 1:
            note(self.plans, robot, *self._held(int(robot[0]["newest"]) + 1))
        note(self.plans, robot, command.q, command.dq, command.ddq)
        return command

    def _held(self, k: int) -> tuple[Array, Array, Array]:
        """What the plan that the robot side holds says for instant k."""
        return self.supervisor._running.motion(self.supervisor._since(k))

    def _joints(self, k: int, now: float) -> JointReading:
        """A reading of the joints at t_k."""
        n = len(self.arm.joints)
        return JointReading(self.scene.epoch + k * self.scene.cycle, self.robot[0]["q"][:n].copy())

    def _hold_against(self, command: Command, now: float) -> None:
        """Look for faults, and ask for the same instant again, which must change nothing."""
        supervisor, k = self.supervisor, int(self.tally[0]["cycles"])
        if supervisor.fault is not None:
            self._fail(f"cycle {k}: {supervisor.fault!r}")
            supervisor.fault = None
        if not abs(command.t - command.deadline - self.scene.cycle) < 2e-6:
            self._fail(f"cycle {k}: t {command.t}, deadline {command.deadline}")
        if supervisor.deviation is not None:
            self.total.events["reading refused"] += 1
            self.total.refused_by = max(self.total.refused_by, supervisor.deviation.by)
        again = supervisor.step(now)
        if again.cause is not Cause.CLOCK or again.t != command.t or (again.q != command.q).any():
            self._fail(f"cycle {k}: another answer to the same instant: {again}")

    def _fail(self, what: str) -> None:
        self.total.failures.append(f"{self.name}: {what}")

    def _closed(self) -> Total:
        """Sum up."""
        total, tally, robot = self.total, self.tally[0], self.robot[0]
        total.cycles, total.moving = int(tally["cycles"]), int(tally["moving"])
        total.contacts, total.deepest = int(tally["contacts"]), float(tally["deepest"])
        total.histogram = tally["histogram"].copy()
        total.excess, total.worst = robot["excess"].copy(), robot["worst"].copy()
        total.nearest = [float(tally["nearest"])]
        total.vacuous = int(not tally["nearest"] < 0.05)
        total.events["contradicted"] += len(self.contradicted_at)
        if total.contacts:
            where = f"cycle {tally['first']}, person {tally['person']}, link {tally['link']}"
            self._fail(
                f"contact: {where}, part {tally['part']}, depth {-tally['deepest']:.4f} m, {self.scene}"
            )
        if total.excess.any():
            self._fail(f"limits: excess {total.excess}, worst {total.worst}, {self.scene}")
        return total


CYCLES = 4_000
"""Cycles of one run."""
CYCLES_IN_ALL = 10_000_000
"""Cycles at full counts, of all arms together."""
SHARP: dict[str, Any] = {
    "persons": 1, "position_error": 0.0, "doubt": (0.0, 0.0), "latency": (0.0, 0.0), "period": 0.008,
    "dropped": 0.0, "silent": 0.0, "weights": (0.2, 0.5, 0.3, 0.0, 0.0, 0.0, 0.0),
}  # fmt: skip
"""Sensors that see well let people come near."""


def one_run(robot: str, seed: int, number: int, cycles: int = CYCLES) -> Total:
    """Run number so-and-so of an arm: its scene follows from the seed. Every third is a sharp one."""
    scene = random_scene(np.random.default_rng([seed, number, *robot.encode()]), robot)
    if number % 3 == 0:
        scene = replace(scene, **SHARP)
    return Run(scene, [seed, number, *robot.encode()]).go(cycles)
