"""The check of one cycle, on its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from failsafe.plan import PlanOutcome, PlanResult
from occupancy.humans.unobserved import ARENA_M
from occupancy.separation import Nearest
from occupancy.sets import MAX_PEOPLE
from occupancy.workspace import Blocked
from robots.enclosure import ENCLOSURE
from robots.errors import SetupError
from robots.motion import MAX_SLICES, SLICES
from tests.oracles.intervals import outward
from verifier.cell import Cell
from verifier.criteria import Standstill
from verifier.cycle import CycleCheck, CycleSettings, Known
from verifier.setup import build_check, build_profile, build_robot
from verifier.verdict import CriterionKind, Reason, Verdict

NAN = math.nan


def test_a_processor_that_rounds_upward_is_refused() -> None:
    cell = Cell.from_table({"robot": {"name": "ur5", "bare_flange": True}})
    robot, profile = build_robot(cell), build_profile(cell)
    build_check(cell, robot, profile, assume_nobody=False)
    with outward(), pytest.raises(SetupError, match="rounded to nearest"):
        build_check(cell, robot, profile, assume_nobody=False)


# What is asked first, and what answers: everything around the check is made up


READY = PlanResult(PlanOutcome.READY, stop_time_s=0.75)
NOWHERE = np.full(3, NAN)
NOBODY_THERE = Nearest(True, -1, -1, -1, -1, -1, 0, 1.5, NOWHERE, NOWHERE, NOWHERE, 0, 0, NAN)
LINKS, SLICES_OF_PLAN = 2, 3


@dataclass
class Rig:
    """A check whose surroundings answer what a test wants."""

    monkeypatch: pytest.MonkeyPatch
    listed: int = 1
    unlisted: int = 0
    opened: int = 5
    moving: int = 1
    left: list[bool] = field(default_factory=lambda: [False])
    nearest: Nearest = NOBODY_THERE
    blocked: Blocked | None = None
    contact: bool | None = None
    n_links: int = LINKS
    known: dict[str, Any] = field(default_factory=dict)
    assume_nobody: bool = False
    going_on: bool = False
    n_slices: int = SLICES_OF_PLAN
    rows: int | None = None
    at: float = 1.0
    radius: float = 0.25
    now: float = 10.0
    plan: PlanResult = READY
    log: dict[str, Any] = field(default_factory=dict)

    def asked(self, name: str) -> Callable[..., None]:
        return lambda *given: self.log.update({name: given}) or self.moving

    def check(self) -> CycleCheck:
        def opens(*given: Any) -> int:
            assert given[-3:-1] == (self.listed + self.unlisted, 0b101)
            return self.opened

        left = iter(self.left)
        for name, made_up in (
            ("LinkOccupancy", lambda _: SimpleNamespace(occupy=lambda *_: None, chain=None)),
            ("Occupancy", lambda model: SimpleNamespace(model=model, begin=self.asked("begin"))),
            ("mark_moving", self.asked("mark_moving")),
            ("mark_commanded", self.asked("mark_commanded")),
            ("count_people", lambda _: (self.listed, self.listed + self.unlisted)),
            ("open_moving", opens),
            ("anything_open", lambda _: next(left)),
        ):
            self.monkeypatch.setattr(f"verifier.cycle.{name}", made_up)
        enclosure = np.zeros(1, dtype=ENCLOSURE)
        enclosure["n"] = self.n_links
        rule = SimpleNamespace(kind=CriterionKind.SEPARATION, check=lambda *_: self.nearest)
        fixtures = SimpleNamespace(kind=CriterionKind.WORKSPACE, check=lambda *_: self.blocked)
        contact = None
        if self.contact is not None:
            kind = CriterionKind.POWER_AND_FORCE_LIMITING
            contact = SimpleNamespace(kind=kind, clear=lambda *_: self.contact)
        settings = CycleSettings(0b101, Standstill(0.01, 0.001), 0.5, self.assume_nobody)
        check: Any = CycleCheck(
            SimpleNamespace(enclosure=enclosure),
            [None], [rule], settings, [fixtures], contact,
        )  # fmt: skip
        rows = self.n_slices * self.n_links if self.rows is None else self.rows
        check.links["n"] = rows
        check.links["points"][0, max(rows - 1, 0), 0, 2] = self.at
        check.links["radius"][0, : max(rows, 1)] = 0.01
        check.links["radius"][0, max(rows - 1, 0)] = self.radius
        made: CycleCheck = check
        return made

    def answer(self) -> Verdict:
        slices = np.zeros(1, dtype=SLICES)
        slices["n"] = self.n_slices
        people = np.zeros(1, dtype=[("n", np.int64)])
        people["n"] = self.listed
        known = {"reported": True, "nobody_since": -math.inf, "inconsistent": False, "overflow": False}
        self.made = self.check()
        judge = self.made.check_moving if self.going_on else self.made.check
        return judge(self.now, self.plan, slices, Known(people, **(known | self.known)))


BLOCKED = Blocked(0, 0, "wall", 0.125, np.zeros(3), np.zeros(3), 0.0, 0.0)


def near(row: int, person: int, unresolved: int = 0) -> Nearest:
    return NOBODY_THERE._replace(separated=False, people_row=row, person=person, unresolved=unresolved)


@pytest.mark.parametrize(
    ("how", "reason", "gap"),
    [
        ({}, Reason.SEPARATED, 1.5),
        ({"listed": 0, "unlisted": 1, "known": {"nobody_since": 9.5}}, Reason.NOBODY_REPORTED, 1.5),
        ({"listed": 0, "known": {"nobody_since": 9.5}}, Reason.NOBODY_REPORTED, NAN),
        ({"listed": 0, "known": {"nobody_since": 9.49}}, Reason.STALE_EMPTY_REPORT, NAN),
        ({"listed": 0, "unlisted": 1, "known": {"nobody_since": 9.49}}, Reason.STALE_EMPTY_REPORT, NAN),
        ({"listed": 0, "known": {"nobody_since": NAN}}, Reason.STALE_EMPTY_REPORT, NAN),
        ({"listed": 0}, Reason.STALE_EMPTY_REPORT, NAN),
        ({"known": {"reported": False}}, Reason.NO_REPORT_YET, NAN),
        ({"known": {"overflow": True}}, Reason.NO_ROOM, NAN),
        ({"listed": MAX_PEOPLE}, Reason.SEPARATED, 1.5),
        ({"listed": MAX_PEOPLE, "unlisted": 1}, Reason.NO_ROOM, NAN),
        ({"listed": MAX_PEOPLE + 1}, Reason.NO_ROOM, NAN),
        ({"known": {"inconsistent": True}}, Reason.INCONSISTENT_REPORTS, NAN),
        ({"known": {"inconsistent": True}, "assume_nobody": True}, Reason.NOBODY_ASSUMED, NAN),
        ({"assume_nobody": True}, Reason.NOBODY_ASSUMED, NAN),
        ({"assume_nobody": True, "blocked": BLOCKED}, Reason.FIXTURE_IN_REACH, 0.125),
        ({"blocked": BLOCKED, "known": {"reported": False}}, Reason.FIXTURE_IN_REACH, 0.125),
        ({"opened": 0}, Reason.AT_REST, NAN),
        ({"opened": 1}, Reason.SEPARATED, 1.5),
        ({"left": [True], "nearest": near(3, 0)}, Reason.REACHABLE, 1.5),
        ({"left": [True], "nearest": near(0, 0)}, Reason.REACHABLE, 1.5),
        ({"left": [True], "nearest": near(3, 0, unresolved=1)}, Reason.UNRESOLVED, 1.5),
        ({"left": [True], "nearest": near(-1, 0)}, Reason.PERSON_WITHOUT_BOUND, 1.5),
        ({"left": [True], "nearest": near(-1, 1), "unlisted": 1}, Reason.NOT_OBSERVED, 1.5),
        ({"left": [True, True], "contact": False, "nearest": near(3, 0)}, Reason.REACHABLE, 1.5),
        ({"left": [True, False], "contact": True, "nearest": near(3, 0)}, Reason.CONTACT_WITHIN_LIMITS, NAN),
        ({"left": [True, True, True], "contact": True, "nearest": near(3, 0)}, Reason.REACHABLE, 1.5),
        ({"left": [True, True, False], "contact": True, "nearest": near(3, 0)}, Reason.SEPARATED, 1.5),
        ({"left": [False], "contact": True}, Reason.SEPARATED, 1.5),
        ({"n_slices": 0}, Reason.EMPTY_PLAN, NAN),
        ({"n_slices": 1}, Reason.SEPARATED, 1.5),
        ({"n_slices": MAX_SLICES}, Reason.SEPARATED, 1.5),
        ({"n_slices": MAX_SLICES + 1}, Reason.EMPTY_PLAN, NAN),
        ({"n_links": 0}, Reason.EMPTY_PLAN, NAN),
        ({"n_links": 1}, Reason.SEPARATED, 1.5),
        ({"rows": LINKS * SLICES_OF_PLAN - 1}, Reason.EMPTY_PLAN, NAN),
        ({"rows": LINKS * SLICES_OF_PLAN + 1}, Reason.EMPTY_PLAN, NAN),
        ({"n_slices": 0, "blocked": BLOCKED}, Reason.EMPTY_PLAN, NAN),
        ({"unlisted": 1, "at": (ARENA_M - 0.26) / 3**0.5}, Reason.SEPARATED, 1.5),
        ({"unlisted": 1, "at": -(ARENA_M - 0.24) / 3**0.5}, Reason.NOT_OBSERVED, NAN),
        ({"unlisted": 1, "at": NAN}, Reason.NOT_OBSERVED, NAN),
        ({"unlisted": 1, "at": 0.0, "radius": ARENA_M}, Reason.SEPARATED, 1.5),
        ({"at": ARENA_M}, Reason.SEPARATED, 1.5),
    ],
)
def test_what_is_asked_first_answers(
    how: dict[str, Any], reason: Reason, gap: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(monkeypatch, **how)
    answer = rig.answer()
    assert (answer.reason, answer.t, answer.stop_time_s) == (reason, 10.0, 0.75)
    assert answer.gap_m == pytest.approx(gap, nan_ok=True)
    known = {CriterionKind.SEPARATION, CriterionKind.JOINT_LIMITS, CriterionKind.WORKSPACE}
    known |= {CriterionKind.POWER_AND_FORCE_LIMITING} if rig.contact is not None else set()
    assert answer.not_checked == sum(2**kind for kind in CriterionKind if kind not in known)
    assert (rig.made.blocked is None) == (reason is not Reason.FIXTURE_IN_REACH)


@pytest.mark.parametrize("outcome", [each for each in PlanOutcome if each is not PlanOutcome.READY])
def test_a_plan_that_is_not_ready_answers_before_anything_else(
    outcome: PlanOutcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = Rig(monkeypatch, plan=PlanResult(outcome, stop_time_s=0.75), blocked=BLOCKED).answer()
    own = {
        PlanOutcome.BEYOND_END: Reason.BEYOND_END,
        PlanOutcome.STATE_BEYOND_LIMITS: Reason.STATE_BEYOND_LIMITS,
    }
    assert answer.reason is own.get(outcome, Reason.NO_STOP_WITHIN_LIMITS)
    assert math.isnan(answer.stop_time_s) and math.isnan(answer.gap_m)


def test_contact_within_limits_leaves_no_nearest_pair(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(monkeypatch, left=[True, False], contact=True, nearest=near(3, 0))
    rig.answer()
    assert rig.made.nearest is None


def test_a_check_needs_a_model_of_people(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SetupError, match="at least one model"):
        CycleCheck(SimpleNamespace(), [], [], CycleSettings(1, Standstill(0.0, 0.0), 0.0, False))


@pytest.mark.parametrize("contact", [None, True])
def test_a_check_rests_on_what_all_its_parts_rest_on(
    contact: bool | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    check: Any = Rig(monkeypatch, contact=contact).check()
    check.robot.assumptions = ("robot",)
    check.occupancies[0].model = SimpleNamespace(assumptions=lambda: ("model",))
    check.criteria[0].assumptions = lambda: ("separation",)
    check.robot_criteria[0].assumptions = lambda: ("workspace",)
    if contact:
        check.contact.assumptions = lambda: ("contact",)
    *parts, speed, error = check.assumptions()
    assert parts == ["robot", "model", "separation", "workspace", *(("contact",) if contact else ())]
    assert (speed.name, speed.value, speed.unit) == ("check.standstill_speed_m_s", 0.01, "m/s")
    assert (error.name, error.value, error.unit) == ("check.standstill_error_m", 0.001, "m")


def test_sets_of_people_and_links_that_move_are_found_before_they_are_compared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = Rig(monkeypatch)
    rig.answer()
    links, slices, enclosure, *rest, active = rig.log["mark_moving"]
    assert (links is rig.made.links, enclosure is rig.made.robot.enclosure, rest) == (
        True,
        True,
        [0.01, 0.001],
    )
    people, same = rig.log["begin"]
    assert same is slices and people["n"][0] == rig.listed and not active.any()


@pytest.mark.parametrize("moving", [0, 1, 2])
@pytest.mark.parametrize("going_on", [False, True])
def test_a_plan_is_a_rest_where_no_link_is_faster(
    moving: int, going_on: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(monkeypatch, moving=moving, going_on=going_on)
    assert rig.answer().reason is Reason.SEPARATED
    assert rig.made.at_rest == (moving == 0)
    assert ("mark_commanded" in rig.log) == going_on
    if going_on:
        slices, _, flags = rig.log["mark_commanded"]
        assert slices["n"][0] == rig.n_slices and flags is rig.made._commanded


@pytest.mark.parametrize(
    "how", [{"plan": PlanResult(PlanOutcome.BEYOND_END)}, {"n_slices": 0}, {"known": {"inconsistent": True}}]
)
def test_what_was_not_looked_at_is_no_rest(how: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(monkeypatch, moving=0, **how)
    rig.answer()
    assert not rig.made.at_rest
