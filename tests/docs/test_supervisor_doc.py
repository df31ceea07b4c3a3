"""docs/supervisor.md: its table of transitions is what a supervisor does, its names are those of the code."""

import dataclasses
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from failsafe.preparation import Objection
from failsafe.waypoints import rest_to_rest
from occupancy.report import RawMeasurement, RawPerson
from tests.verifier.supervised import (
    AWAY,
    AWAY_AND_BACK,
    CYCLE,
    PANDA,
    PANDA_AWAY,
    PANDA_HOME,
    panda_supervisor,
    quintic,
    report,
    scripted,
)
from verifier.cell import Cell
from verifier.command import Cause, Command, State
from verifier.proposal import NewTrajectory, PathSpeed, Stop
from verifier.safety_state import ProbeSettings, SafetyState
from verifier.supervisor import Supervisor
from verifier.tracking import JointReading
from verifier.verdict import Reason

ROOT = Path(__file__).resolve().parents[2]
DOC = (ROOT / "docs/supervisor.md").read_text(encoding="utf-8")
RAISING = RawMeasurement(0.0, 0.0, "raise", True, ())

Transition = tuple[str, str, str]


def section(title: str) -> str:
    (found,) = re.findall(rf"^## {title}\n(.*?)(?=^## |\Z)", DOC, re.MULTILINE | re.DOTALL)
    return found


def table(title: str) -> list[list[str]]:
    rows = [line for line in section(title).splitlines() if line.startswith("| `")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in rows]


def documented() -> set[Transition]:
    found = set()
    for before, cause, after, _when in table("Transitions"):
        for a in re.findall(r"`(\w+)`", before):
            for c in re.findall(r"`(\w+)`", cause):
                for b in re.findall(r"`(\w+)`", after):
                    assert (a, c, b) not in found, f"stands there twice: {a} {c} {b}"
                    found.add((a, c, b))
    return found


def verdicts(verified: bool):
    return lambda: Reason.SEPARATED if verified else Reason.REACHABLE


def without_stop_on_the_path(supervisor: Supervisor) -> None:
    """Let it find no stop along its path: then it leaves the path, where that is allowed."""
    manoeuvre = supervisor._planner._manoeuvre
    search = manoeuvre.search
    manoeuvre.search = lambda *args, **more: args[3] != 0.0 and search(*args, **more)
    manoeuvre.steady_then = lambda *_: False


LIVES = 60
"""After 53 of this seed every transition has been met."""


class Driven:
    """Drives a supervisor at random through everything that moves it from state to state."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.found = rng, set()
        self.k = -1

    def note(self, before: State, command: Command) -> None:
        self.found.add((before.name, command.cause.name, command.outcome.name))

    def one_life(self) -> None:
        rng = self.rng
        supervisor = scripted(joint_space=bool(rng.random() < 0.4))
        supervisor.propose(NewTrajectory(AWAY if rng.random() < 0.3 else AWAY_AND_BACK))
        self.k, latch = -1, int(rng.integers(20, 400))
        for number in range(400):
            self.cycle(supervisor, number == latch)

    def go(self, supervisor: Supervisor, k: int, reports: list[RawMeasurement] | None = None) -> None:
        before = supervisor._last.outcome
        self.note(before, supervisor.step(k * CYCLE, reports or []))

    def what_is_rare(self) -> None:
        """Reports that raise while the clock stands, and a stop off the path that nobody looks at."""
        for begun in (1, 60):
            for missed in (1, 60):
                supervisor = scripted()
                supervisor.propose(NewTrajectory(AWAY_AND_BACK))
                for k in range(begun):
                    self.go(supervisor, k)
                self.go(supervisor, begun - 1, [RAISING])
                self.go(supervisor, begun - 1 + missed)
        for begun in (2, 60):
            supervisor = scripted(joint_space=True)
            supervisor.propose(NewTrajectory(AWAY_AND_BACK))
            search = supervisor._planner._manoeuvre.search
            for k in range(begun):
                self.go(supervisor, k)
            without_stop_on_the_path(supervisor)
            self.go(supervisor, begun)
            supervisor._planner._manoeuvre.search = search
            vars(supervisor._planner._manoeuvre).pop("steady_then", None)
            self.go(supervisor, begun + 60)

    def cycle(self, supervisor: Supervisor, raising: bool) -> None:
        rng = self.rng
        mood = rng.random()
        if mood < 0.03:
            supervisor.propose(PathSpeed(float(rng.choice([0.0, 0.05, 0.5, 1.0, -0.5]))))
        elif mood < 0.04:
            supervisor.propose(Stop())
        if rng.random() < 0.05:
            self.verified = rng.random() < 0.7
            supervisor.check.reason = lambda good=self.verified: (
                Reason.SEPARATED if good else Reason.REACHABLE
            )
        before = supervisor._last.outcome
        step = int(rng.choice([1, 1, 1, 1, 1, 1, 0, 2, 5], p=[0.15] * 6 + [0.06, 0.02, 0.02]))
        self.k += max(step, 1) if self.k < 0 else step
        follow = supervisor._planner.follow
        if rng.random() < 0.02:
            supervisor._planner.follow = None
        manoeuvre = supervisor._planner._manoeuvre
        search = manoeuvre.search
        if rng.random() < 0.05:
            without_stop_on_the_path(supervisor)
        now = None if rng.random() < 0.02 else self.k * CYCLE
        command = supervisor.step(now, [RAISING] if raising else [])
        supervisor._planner.follow = follow
        manoeuvre.search = search
        vars(manoeuvre).pop("steady_then", None)
        self.note(before, command)
        if rng.random() < 0.1 and command.cause is Cause.ADOPTED:
            self.note(command.outcome, supervisor.withdraw())


@pytest.fixture(scope="module")
def driven() -> set[Transition]:
    walk = Driven(np.random.default_rng(0))
    for _ in range(LIVES):
        walk.one_life()
    walk.what_is_rare()
    return walk.found


def test_every_transition_that_happens_is_documented(driven):
    assert driven <= documented(), sorted(driven - documented())


def test_every_transition_that_is_documented_happens(driven):
    assert documented() <= driven, sorted(documented() - driven)


def test_states_and_causes_are_those_of_the_code():
    assert [row[0] for row in table("States")] == [f"`{state.name}`" for state in State]
    assert [row[0] for row in table("Causes")] == [f"`{cause.name}`" for cause in Cause]


def test_fields_are_those_of_the_code():
    assert [row[0] for row in table("What a command says")] == [f"`{name}`" for name in Command._fields]


def test_objections_are_those_of_the_code():
    named = {row[0].strip("`") for row in table("Proposals, and why one is refused")}
    assert named == {each.name for each in Objection if each is not Objection.NONE}


def test_every_assumption_is_there():
    rows = re.findall(r"^\| (A\d) \|", section("What the integrator provides"), re.MULTILINE)
    assert rows == [f"A{i}" for i in range(1, 8)]


def test_names_of_files_and_calls_exist():
    for name in set(re.findall(r"`((?:verifier|failsafe|examples)/[\w/]+\.py)`", DOC)):
        assert (ROOT / name).is_file(), name
    for call in set(re.findall(r"`Supervisor\.(\w+)", DOC)):
        assert hasattr(scripted(), call), call


def test_the_table_of_the_safety_state_names_its_fields():
    fields = [field.name for field in dataclasses.fields(SafetyState)]
    assert [row[0].strip("`") for row in table("The safety state")] == fields[fields.index("verdict") :]
    text, settings = section("The safety state"), ProbeSettings()
    assert settings.speed_step == 1 / 64 and "1/64 (`speed_step`)" in text
    assert settings.latency_step_s == 0.001 and "1 ms (`latency_step_s`)" in text
    assert settings.latency_bound_s == 0.5 and "0.5 s (`latency_bound_s`)" in text


def test_it_names_every_field_of_what_a_step_is_given():
    rows = [row[0].split("`")[1] for row in table("What a step is given")]
    expected = []
    for kind in (RawMeasurement, RawPerson, JointReading):
        expected += [kind.__name__, *kind._fields]
    assert rows == expected


def test_the_lines_about_the_safety_state_run():
    """With a supervisor that executes, nobody near: it may go on as it does."""
    supervisor = panda_supervisor()
    supervisor.propose(NewTrajectory(quintic([PANDA_HOME, PANDA_AWAY], supervisor.check.robot.limits)))
    for k in range(20):
        supervisor.step(k * CYCLE, [report(k * CYCLE - 0.005, 5.0, arrived=k * CYCLE)])
    (lines,) = re.findall(r"```python\n(.*?)```", section("The safety state"), re.DOTALL)
    names = {"cell": Cell.from_table(PANDA), "supervisor": supervisor}
    exec(lines, names)
    assert names["state"].allowed_path_speed == 1.0
    assert supervisor.step(20 * CYCLE).outcome is State.EXECUTING


def test_the_first_loop_drives_its_path(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    loop, refusals = re.findall(r"```python\n(.*?)```", section("A first loop"), re.DOTALL)
    names = {}
    exec(loop, names)
    assert names["refusal"] is None and names["supervisor"].fault is None
    goal = names["home"] + [1.2, 0.3, -0.3, 0.0, 0.0, 0.0]
    assert names["command"].outcome is State.STOPPED and np.allclose(names["command"].q, goal)
    exec(refusals, names)
    assert capsys.readouterr().out == ""
    names["supervisor"].step(names["now"] + CYCLE, [names["report"]._replace(frame="camera")])
    exec(refusals, names)
    assert "coordinate frame is not declared" in capsys.readouterr().out


def test_after_a_lost_command_the_lines_about_it_go_on():
    """A robot that stops by itself as the document says: lost, latched, a new supervisor, at the goal."""
    (said,) = re.findall(r"```toml\n(.*?)```", section("The robot side"), re.DOTALL)
    (lines,) = re.findall(r"```python\n(.*?)```", section("The robot side"), re.DOTALL)
    silence = tomllib.loads(said)["robot"]["silence"]
    cell = Cell.from_table(PANDA | {"robot": PANDA["robot"] | {"silence": silence}})
    nobody = [RawMeasurement(0.0, 0.0, "world", True, ())]

    def driven(supervisor: Supervisor, begin: int, cycles: int) -> Command:
        for k in range(begin, begin + cycles):
            now = k * CYCLE
            command = supervisor.step(now, [nobody[0]._replace(stamp=now, arrived=now)])
        return command

    first = Supervisor.from_cell(cell, PANDA_HOME)
    path = rest_to_rest([PANDA_HOME, PANDA_AWAY], first.check.robot.limits)
    assert first.propose(NewTrajectory(path)) is None
    assert driven(first, 0, 20).outcome is State.EXECUTING
    first.withdraw()
    assert first.propose(NewTrajectory(path)) is None
    lost = driven(first, 20, 300)
    assert (lost.cause, lost.verdict.reason, lost.outcome) == (Cause.LATCHED, Reason.SILENCE, State.STOPPED)
    names = {"cell": cell, "q": lost.q, "goal": PANDA_AWAY, "rest_to_rest": rest_to_rest}
    exec(lines, names | {"Supervisor": Supervisor, "NewTrajectory": NewTrajectory}, names)
    assert names["refusal"] is None and np.abs(lost.q - PANDA_AWAY).max() > 0.1
    assert np.allclose(driven(names["supervisor"], 400, 600).q, PANDA_AWAY)
