"""What a report says besides its counts: when cycles failed, how deep, and what can be done."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import Point
from tests.verifier.scenes import CELL, Scene, far, person_at, swing
from verifier import Cell, verify
from verifier.reports.stretches import stretches
from verifier.reports.text import REMEDY, cycles
from verifier.reports.verification import PerCycle, VerifyReport
from verifier.verdict import STATUS_OF_REASON, Reason, Status


def rows(reasons: list[Reason]) -> PerCycle:
    n = len(reasons)
    nothing = np.full(n, np.nan, np.float32)
    status = np.array([STATUS_OF_REASON[reason] for reason in reasons], np.uint8)
    return PerCycle(0.01 * np.arange(n), status, np.array(reasons, np.uint8), nothing, nothing)


def test_stretches_are_the_groups_of_a_plain_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(200):
        reasons = [Reason(int(k)) for k in rng.integers(0, len(Reason), rng.integers(0, 40))]
        wanted = (Status.NOT_VERIFIED, Status.CONTRADICTED)
        expected, first = [], 0
        for status, group in itertools.groupby(STATUS_OF_REASON[reason] for reason in reasons):
            n = len(list(group))
            if status in wanted:
                expected.append((first, first + n - 1, status))
            first += n
        found = stretches(rows(reasons), wanted)
        assert [each[:3] for each in found] == expected
        for each in found:
            within = reasons[each.first : each.last + 1]
            assert within.count(each.reason) == max(map(within.count, within))


def test_every_reason_of_a_contradiction_has_a_remedy() -> None:
    contradictions = {reason for reason, status in STATUS_OF_REASON.items() if status is Status.CONTRADICTED}
    assert set(REMEDY) == contradictions


def walking_up(t: float) -> np.ndarray:
    return person_at(2.6 - 1.2 * t, 0.0)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> VerifyReport:
    recording = Scene(people={"p1": walking_up}).write(tmp_path_factory.mktemp("report") / "r.mcap")
    return verify(recording, Cell.from_table(CELL))


def test_text_and_json_name_the_stretches(report: VerifyReport) -> None:
    failing = np.flatnonzero(report.per_cycle.status == Status.NOT_VERIFIED)
    listed = report.to_dict()["stretches"]
    assert sum(each["cycles"] for each in listed) == len(failing) > 0
    assert listed[0]["t"][0] == pytest.approx(report.per_cycle.t[failing[0]])
    lines = report.lines()
    head = next(i for i, line in enumerate(lines) if line.startswith("failing stretches"))
    assert f"{report.per_cycle.t[failing[0]]:.3f} – " in lines[head + 1]


def test_text_says_what_a_gap_tells_and_how_old_a_reading_is(report: VerifyReport) -> None:
    """With two decimals of the age nobody could compute the latency term of the budget again."""
    first = report.first_witness
    assert first is not None
    (line,) = [line for line in report.lines() if line.startswith("first witness")]
    assert "slice that is open, which says when it fails and not how much is missing" in line
    assert f", seen {first.age_s:.3f} s before)" in line


@pytest.mark.parametrize(
    ("n", "told"), [(1, "1 cycle"), (2, "2 cycles"), (0, "0 cycles"), (1234, "1 234 cycles")]
)
def test_one_cycle_is_told_as_one(n: int, told: str) -> None:
    assert cycles(n) == told
    assert cycles(n, 7).strip() == told and len(cycles(n, 7)) == 14


def test_the_deepest_slice_is_that_of_the_whole_stop(tmp_path: Path) -> None:
    """A person well within reach: the sets grow from slice to slice, so the last one that moves is worst."""
    recording = Scene(people={"p1": lambda _t: person_at(1.1, 0.0)}).write(tmp_path / "r.mcap")
    report = verify(recording, Cell.from_table(CELL))
    first, deepest = report.first_witness, report.deepest
    assert first is not None and deepest is not None
    assert deepest.cycle_t == first.cycle_t
    assert deepest.slice[0] > first.slice[0]
    assert deepest.gap_m < first.gap_m
    budget = deepest.budget
    grown = budget.latency + budget.stop + budget.error + budget.sides
    rest = budget.distance - budget.link - budget.body - grown
    assert rest == pytest.approx(deepest.gap_m, abs=1e-9)
    # 2 m/s towards the arm from the first open slice on, while the arm hardly moves
    grown = first.gap_m - deepest.gap_m
    elapsed = deepest.slice[1] - first.slice[1]
    assert grown == pytest.approx(2.0 * elapsed, abs=0.25 * 2.0 * elapsed + 0.01)


def test_nothing_is_deeper_than_all_verified(tmp_path: Path) -> None:
    recording = Scene(duration=0.5).write(tmp_path / "r.mcap")
    report = verify(recording, Cell.from_table(CELL))
    assert report.first_witness is None and report.deepest is None and report.failing == []


def test_a_person_without_bound_is_named_as_a_whole(tmp_path: Path) -> None:
    scene = Scene(duration=0.5, people={"p1": far, "p2": lambda _t: np.full((20, 3), np.nan)})
    report = verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    line = next(line for line in report.lines() if line.startswith("first witness"))
    assert "p2 whole body" in line and "inf" not in line.replace("inferred", "")
    assert report.deepest is None


def judged_with(tmp_path: Path, scene: Scene, **people: object) -> VerifyReport:
    table = {**CELL, "people": {**CELL["people"], **people}}
    tmp_path.mkdir(exist_ok=True)
    return verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(table))


def stretching_out(t: float) -> np.ndarray:
    """Both arms towards the robot, hands 0.36 m apart."""
    points = person_at(2.4, 1e-4 * t)
    for side, y in (("L", 0.18), ("R", -0.18)):
        for name, forward in (("ELBOW", 0.3), ("WRIST", 0.55), ("HAND", 0.63), ("FINGERTIP", 0.73)):
            points[Point[f"{side}_{name}"]] = (2.4 - forward, y + 1e-4 * t, 0.6)
    return points


def test_what_exchanged_sides_cost_is_a_term_of_its_own(tmp_path: Path) -> None:
    """At 2 m/s, read to 0.1 m every 0.1 s, either hand may be where the other one was, 0.36 m away."""
    scene = Scene(people={"p1": stretching_out}, people_rate=10.0, error_m=0.1)
    doubted, trusted = (
        judged_with(tmp_path / name, scene, models=["articulated_velocity"], left_right=name)
        for name in ("may_be_exchanged", "trusted")
    )
    with_doubt, without = doubted.tightest, trusted.tightest
    assert with_doubt is not None and without is not None
    assert without.budget.sides == 0.0 and without.shrink_first != "sides"
    assert with_doubt.budget.sides == pytest.approx(0.36, abs=1e-9)
    assert with_doubt.budget.error == pytest.approx(without.budget.error, abs=2e-3)  # the arm moves meanwhile
    assert with_doubt.shrink_first == "sides"
    text = "\n".join(doubted.lines())
    assert " - sides 0.360 = " in text and 'people.left_right = "trusted"' in text
    assert "sides" not in "\n".join(line for line in trusted.lines() if line.startswith("where"))


def test_models_that_say_nothing_of_a_part_are_named(tmp_path: Path) -> None:
    arms = judged_with(tmp_path, Scene(duration=0.5), profile="tum", models=["arm_reach"])
    assert arms.count(Status.VERIFIED) == 0
    assert arms.first_witness is not None and arms.first_witness.silent_models == ("arm_reach",)
    (line,) = (line for line in arms.lines() if line.startswith("where the metres go"))
    assert "model arm_reach says nothing of " in line and line.endswith(": combine with another model")
    assert "torso" in line and "forearm" not in line
    assert not any(line.startswith("  shrink first") for line in arms.lines())


def test_a_person_of_whom_nothing_is_known_is_no_fault_of_the_models(tmp_path: Path) -> None:
    scene = Scene(duration=0.5, people={"p1": lambda _t: np.full((20, 3), np.nan), "p2": far})
    unknown = judged_with(tmp_path, scene)
    assert unknown.first_witness is not None
    assert unknown.first_witness.silent_models == () and unknown.first_witness.shrink_first == ""
    assert any("whole body cannot be enclosed from what was measured" in line for line in unknown.lines())


def test_a_contradiction_says_what_can_be_done(tmp_path: Path) -> None:
    jump = Scene(people={"p1": lambda t: person_at(4.0 if t < 1.0 else 2.5, 0.0)})
    report = verify(jump.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    assert report.count(Status.CONTRADICTED) > 0
    assert sum("what can be done" in line for line in report.lines()) == len(report.contradicted)


def test_reasons_of_cycles_are_those_of_the_counts(report: VerifyReport) -> None:
    printed = report.to_dict()
    names = [printed["reason_names"][str(number)] for number in printed["per_cycle"]["reason"]]
    counted = {name: n for of in printed["reasons"].values() for name, n in of.items()}
    assert {name: names.count(name) for name in set(names)} == counted


def test_a_gap_of_minus_infinity_is_not_printed_as_a_number(report: VerifyReport) -> None:
    assert report.first_witness is not None
    odd = replace(report, first_witness=replace(report.first_witness, gap_m=-math.inf))
    assert any("no gap can be stated" in line for line in odd.lines())


# ------------------------------------------------------------------------------------------ plausibility


def turned(points: np.ndarray, axis: int) -> np.ndarray:
    """The person on their side: z and another axis exchanged."""
    out = points.copy()
    out[:, [axis, 2]] = points[:, [2, axis]]
    return out


def test_it_says_where_people_were(tmp_path: Path) -> None:
    report = verify(Scene(duration=0.5).write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    heights = person_at(4.0, 0.0)[:, 2]
    assert any(
        f"p1 in the world: heights {heights.min():.2f} to {heights.max():.2f} m, nearest" in note
        for note in report.notes
    )
    assert not any("rpy_deg" in note or "never nearer" in note for note in report.notes)


def test_of_many_people_only_the_nearest_are_placed(tmp_path: Path) -> None:
    """A tracker that gives everybody a new name every 0.1 s; the later, the nearer."""
    named = {f"p{n}": (0.1 * n, person_at(6.0 - 0.1 * n, 0.0)) for n in range(18)}

    def motion(name: str) -> Callable[[float], np.ndarray | None]:
        begin, points = named[name]
        return lambda t: points if begin <= t < begin + 0.1 else None

    scene = Scene(people={name: motion(name) for name in named})
    report = verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    found = [note for note in report.notes if " in the world: " in note]
    assert [note.split()[0] for note in found] == ["p17", "p16", "p15", "p14", "p13"]
    assert report.notes[report.notes.index(found[-1]) + 1].startswith("… and 13 more ")


@pytest.mark.parametrize("axis", [0, 1])
def test_somebody_on_their_side_is_pointed_out(tmp_path: Path, axis: int) -> None:
    scene = Scene(duration=0.5, people={"p1": lambda _t: turned(far(0.0), axis)})
    report = verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    assert any("head is not above pelvis" in note and "rpy_deg in degrees" in note for note in report.notes)


def test_somebody_far_off_is_pointed_out(tmp_path: Path) -> None:
    table = {**CELL, "robot": {**CELL["robot"], "mount": {"xyz_m": [500.0, 0.0, 0.0]}}}
    report = verify(Scene(duration=0.5).write(tmp_path / "r.mcap"), Cell.from_table(table))
    assert any("never nearer than 496 m; are all poses in m" in note for note in report.notes)


def test_degrees_are_pointed_out_and_limits_have_units(tmp_path: Path) -> None:
    scene = Scene(motion=lambda t: np.rad2deg(swing(t)))
    tracking = {"position_error_rad": 1.0}
    table = {**CELL, "robot": {**CELL["robot"], "tracking": tracking}}
    report = verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(table))
    assert any("these look like degrees" in note for note in report.notes)
    line = next(line for line in report.lines() if line.startswith("first limit in the way"))
    assert line.endswith((" rad", " rad/s", " rad/s²", " rad/s³"))


def test_a_witness_says_how_old_its_reading_is(tmp_path: Path) -> None:
    def lost(t: float) -> np.ndarray:
        return person_at(2.2, 0.0) if t < 0.4 else np.full((20, 3), np.nan)

    fresh = verify(
        Scene(people={"p1": lambda _t: person_at(1.1, 0.0)}).write(tmp_path / "a.mcap"), Cell.from_table(CELL)
    )
    # reports every 20 ms, 30 ms late: at 0.03 s the one of 0 s has just arrived
    assert fresh.first_witness is not None
    assert fresh.first_witness.age_s == pytest.approx(0.03, abs=1e-9)
    old = verify(Scene(people={"p1": lost}).write(tmp_path / "b.mcap"), Cell.from_table(CELL))
    assert old.first_witness is not None
    assert old.first_witness.age_s == pytest.approx(old.first_witness.cycle_t - 0.38, abs=1e-6)
    assert old.first_witness.age_s > 0.2
    assert any(f"seen {old.first_witness.age_s:.3f} s before" in line for line in old.lines())


def trembling(t: float) -> np.ndarray:
    return person_at(4.0, 0.0) + 1e-4 * math.sin(50.0 * t)


def held(t: float) -> np.ndarray:
    points = trembling(t)
    if 0.3 < t < 1.2:
        points[Point.R_WRIST] = person_at(4.0, 0.0)[Point.R_WRIST]
    return points


@pytest.mark.parametrize(
    ("motion", "told"),
    [
        (trembling, None),
        (far, "p1: every point stood exactly where it had stood up to 2.00 s before; is the stream frozen"),
        (held, "p1: r_wrist stood exactly where it had stood up to 0.86 s before; held by the tracker"),
    ],
)
def test_coordinates_that_never_change_are_pointed_out(
    tmp_path: Path, motion: Callable[[float], np.ndarray], told: str | None
) -> None:
    report = verify(Scene(people={"p1": motion}).write(tmp_path / "r.mcap"), Cell.from_table(CELL))
    found = [note for note in report.notes if "exactly where" in note]
    assert [note.startswith(told) for note in found] == ([] if told is None else [True])
