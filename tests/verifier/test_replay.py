"""Replay: which cycle gets which status, and why."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import Point
from robots.errors import SetupError
from tests.verifier.scenes import CELL, Scene, at_rest, far, person_at, swing
from verifier import Cell, Reason, Status, VerifyReport, verify


def judged(
    tmp_path: Path, scene: Scene, changes: dict[str, object] | None = None, **options: bool
) -> VerifyReport:
    table = {key: dict(value) for key, value in CELL.items()}
    for key, value in (changes or {}).items():
        section, _, name = key.partition(".")
        if name:
            table.setdefault(section, {})[name] = value
        else:
            table[section] = value
    return verify(scene.write(tmp_path / "r.mcap"), Cell.from_table(table), **options)


def reasons(report: VerifyReport) -> set[Reason]:
    return {Reason(int(reason)) for reason in np.unique(report.per_cycle.reason)}


def test_somebody_far_away_is_verified(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene())
    rows = report.per_cycle
    assert report.cycles == 200
    assert report.count(Status.NOT_VERIFIED) == report.count(Status.CONTRADICTED) == 0
    # reports arrive 30 ms late: cycles 0 to 2 know nothing; a stop must fit before the last sample
    assert list(rows.reason[:3]) == [Reason.NO_REPORT_YET] * 3
    assert rows.reason[3] == Reason.SEPARATED
    assert rows.reason[-1] == Reason.BEYOND_END
    assert report.count(Status.VERIFIED) > 170
    assert report.exit_status == 0
    assert report.tightest is not None and report.tightest.gap_m > 1.0
    assert report.first_witness is None


def test_somebody_near_is_not_verified_and_the_budget_adds_up(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(people={"p1": lambda _t: person_at(0.9, 0.0)}))
    assert report.count(Status.VERIFIED) == 0
    assert report.exit_status == 1
    witness = report.first_witness
    assert witness is not None and witness.gap_m < 0.0
    budget = witness.budget
    grown = budget.latency + budget.stop + budget.error + budget.sides
    rest = budget.distance - budget.link - budget.body - grown
    assert rest == pytest.approx(witness.gap_m, abs=1e-9)
    # 2 m/s: the first cycle that knows somebody sees 30 ms old data
    assert budget.latency == pytest.approx(2.0 * 0.03, abs=1e-6)
    end = witness.slice[1]
    assert budget.stop == pytest.approx(2.0 * (end - witness.cycle_t), abs=1e-6)
    assert budget.error > 0.005
    assert budget.body >= 0.1


def test_counts_are_exclusive_and_complete(tmp_path: Path) -> None:
    def walk(t: float) -> np.ndarray:
        return person_at(3.0 - 1.3 * t, 0.0)

    report = judged(tmp_path, Scene(people={"p1": walk}))
    assert sum(report.count(status) for status in Status) == report.cycles
    first_bad = int(np.argmax(report.per_cycle.status == Status.NOT_VERIFIED))
    assert report.first_witness is not None
    assert report.first_witness.cycle_t == pytest.approx(report.per_cycle.t[first_bad])
    assert report.count(Status.VERIFIED) > 0


def test_standing_robot_may_be_touched(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(motion=at_rest, people={"p1": lambda _t: person_at(0.3, 0.0)}))
    assert Reason.AT_REST in reasons(report)
    assert report.count(Status.NOT_VERIFIED) == 0


def test_standstill_speed_zero_exempts_nothing_that_moves(tmp_path: Path) -> None:
    scene = Scene(people={"p1": lambda _t: person_at(0.6, 0.0)})
    assert Reason.AT_REST not in reasons(judged(tmp_path, scene, {"check.standstill_speed_m_s": 0.0}))


def test_person_whose_reports_stop_does_not_disappear(tmp_path: Path) -> None:
    def vanishing(t: float) -> np.ndarray | None:
        return person_at(2.5, 0.0) if t < 0.3 else None

    report = judged(tmp_path, Scene(people={"p1": vanishing}))
    status = report.per_cycle.status
    assert report.cycles == 200
    assert status[20] == Status.VERIFIED
    # 2.5 m at 2 m/s: by 1.6 s they could be at the arm
    assert status[160:180].tolist() == [Status.NOT_VERIFIED] * 20


def test_declared_report_gap_is_held_against_the_data(tmp_path: Path) -> None:
    def vanishing(t: float) -> np.ndarray | None:
        return person_at(4.0, 0.0) if t < 0.5 or t > 1.2 else None

    report = judged(tmp_path, Scene(people={"p1": vanishing}), {"people.max_report_gap_s": 0.3})
    assert Reason.PEOPLE_STREAM_GAP in reasons(report)
    assert report.exit_status == 1
    assert any(item.assumption == "A5 reports" for item in report.contradicted)


def test_hand_faster_than_the_profile_contradicts_earlier_cycles(tmp_path: Path) -> None:
    def punch(t: float) -> np.ndarray:
        points = person_at(4.0, 0.0)
        reach = 0.3 * (1 - math.cos(2 * math.pi * 2.5 * max(0.0, min(t - 1.0, 0.4)))) / 2 * 2.5
        arm = [Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP]
        points[arm] += (-reach, 0.0, 0.0)
        points[Point.R_ELBOW] += (-reach / 2, 0.0, 0.0)
        return points

    report = judged(tmp_path, Scene(people={"p1": punch}))
    assert Reason.PERSON_OUTSIDE_PREDICTION in reasons(report)
    first = int(np.argmax(report.per_cycle.status == Status.CONTRADICTED)) * 0.01
    assert 0.85 < first < 1.15
    text = next(item.text for item in report.contradicted)
    assert "p1 r_" in text and "allow" in text


def test_gap_in_the_joint_samples_is_contradicted(tmp_path: Path) -> None:
    scene = replace(Scene(), joint_rate=8.0)  # 125 ms between samples
    report = judged(tmp_path, scene, {"robot.max_sample_gap_s": 0.1, "robot.knot_spacing_s": 0.4})
    assert reasons(report) <= {Reason.ROBOT_STREAM_GAP}
    assert "0.125 s" in report.contradicted[0].text


def test_declared_tracking_error_is_held_against_the_data(tmp_path: Path) -> None:
    def bump(t: float) -> np.ndarray:
        return swing(t) + (0.02 if abs(t - 1.0) < 0.004 else 0.0)

    report = judged(tmp_path, Scene(motion=bump), {"robot": {
        "bare_flange": True, "accept_assumed": ["limits"], "tracking": {"position_error_rad": 0.003}
    }})  # fmt: skip
    assert Reason.ROBOT_OUTSIDE_TRACKING in reasons(report)
    assert "A2 robot" in {item.assumption for item in report.contradicted}


@pytest.mark.parametrize("delay_s", [0.0, 0.05])
def test_without_a_stop_data_count_up_to_the_end_of_the_piece(tmp_path: Path, delay_s: float) -> None:
    """Cycle k is about the piece up to t_k + 2 cycles, and the robot may be there later by its delay."""
    cycle_s, spike_s = 0.03, 0.4
    path = Scene(motion=lambda t: swing(t) + (0.1 if abs(t - spike_s) < 1e-6 else 0.0)).write(
        tmp_path / "r.mcap"
    )
    robot = {
        **CELL["robot"],
        "tracking": {"position_error_rad": 0.05, "delay_max_s": delay_s},
        "limits": {"shoulder_pan_joint": {"velocity_rad_s": 0.01}},
    }
    report = verify(path, Cell.from_table({**CELL, "cycle_s": cycle_s, "robot": robot}))
    rows = report.per_cycle
    about = (rows.t <= spike_s) & (spike_s <= rows.t + 2.0 * cycle_s + delay_s)
    assert np.isnan(rows.stop_time_s[about]).all() and about.sum() == (2 if delay_s == 0.0 else 4)
    np.testing.assert_array_equal(rows.reason == Reason.ROBOT_OUTSIDE_TRACKING, about)


def test_motion_beyond_the_limits_is_not_verified(tmp_path: Path) -> None:
    def fast(t: float) -> np.ndarray:
        return swing(0.0) + np.array([2.5 * math.sin(2.0 * t), 0, 0, 0, 0, 0])  # 5 rad/s; allowed 3.14

    report = judged(tmp_path, Scene(motion=fast))
    assert Reason.STATE_BEYOND_LIMITS in reasons(report)
    assert report.exit_status == 1


@pytest.mark.parametrize("complete", [True, False])
def test_reports_that_list_nobody(tmp_path: Path, complete: bool) -> None:
    report = judged(tmp_path, Scene(people={}, complete=complete))
    expected = Reason.NOBODY_REPORTED if complete else Reason.STALE_EMPTY_REPORT
    assert reasons(report) <= {expected, Reason.NO_REPORT_YET, Reason.BEYOND_END}
    assert expected in reasons(report)


def test_nobody_is_not_believed_for_long(tmp_path: Path) -> None:
    def late(t: float) -> np.ndarray | None:
        return person_at(4.0, 0.0) if t > 1.5 else None

    scene = Scene(people={"p1": late}, complete=True, people_from=0.0)
    report = judged(tmp_path, replace(scene, people={"p1": late, "ghost": lambda _t: None}))
    assert Reason.NO_REPORT_YET in reasons(report)
    assert report.count(Status.NOT_VERIFIED) == 0


def test_somebody_who_appears_within_reach_contradicts_the_cycles_before(tmp_path: Path) -> None:
    def appears(t: float) -> np.ndarray | None:
        return person_at(0.7, 0.0) if t > 1.0 else None

    report = judged(tmp_path, Scene(people={"p1": far, "ghost": appears}))
    reason = report.per_cycle.reason
    assert reason[50] == Reason.SEPARATED
    # first seen at 1.02 s, known 0.03 s later; plans that begin at t + 0.01 s run past that instant before
    assert (reason[96:104] == Reason.UNREPORTED_PERSON).all()
    assert (reason[106:150] == Reason.REACHABLE).all()
    assert any(item.text.startswith("ghost, first seen then") for item in report.contradicted)


def test_somebody_who_appears_far_away_contradicts_nothing(tmp_path: Path) -> None:
    def appears(t: float) -> np.ndarray | None:
        return person_at(4.0, 1.0) if t > 1.0 else None

    report = judged(tmp_path, Scene(people={"p1": far, "p2": appears}))
    assert report.count(Status.CONTRADICTED) == 0


def test_more_newcomers_than_a_check_can_hold_are_not_left_out(tmp_path: Path) -> None:
    def appears(t: float) -> np.ndarray | None:
        return person_at(40.0, 0.0) if t > 1.0 else None

    crowd = {f"ghost {i}": appears for i in range(16)}
    report = judged(tmp_path, Scene(people={"p1": far, **crowd}))
    reason = report.per_cycle.reason
    assert reason[50] == Reason.SEPARATED
    assert (reason[96:104] == Reason.UNREPORTED_PERSON).all()
    assert (reason[106:150] == Reason.NO_ROOM).all()
    assert any("more people than one check can hold" in item.text for item in report.contradicted)


def test_as_many_newcomers_as_a_check_can_hold_are_looked_at(tmp_path: Path) -> None:
    def appears(t: float) -> np.ndarray | None:
        return person_at(40.0, 0.0) if t > 1.0 else None

    report = judged(tmp_path, Scene(people={"p1": far, **{f"ghost {i}": appears for i in range(15)}}))
    assert report.count(Status.CONTRADICTED) == 0
    assert (report.per_cycle.reason[90:103] == Reason.SEPARATED).all()


def test_a_person_of_whom_nothing_can_be_read_is_still_there(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(people={"p1": far, "p2": lambda _t: np.full((20, 3), np.nan)}))
    assert report.count(Status.VERIFIED) == 0
    assert Reason.PERSON_WITHOUT_BOUND in reasons(report)
    assert any("cannot be enclosed" in line for line in report.lines())


def test_times_count_from_the_start_of_the_overlap(tmp_path: Path) -> None:
    scene = Scene(people={"p1": lambda _t: person_at(0.8, 0.0)}, people_from=0.7, duration=2.0)
    report = judged(tmp_path, scene)
    assert report.per_cycle.t[0] == 0.0
    assert report.first_witness is not None
    first = int(np.argmax(report.per_cycle.status == Status.NOT_VERIFIED))
    assert report.first_witness.cycle_t == pytest.approx(report.per_cycle.t[first])
    assert report.first_witness.cycle_t < 0.1


def test_limit_in_the_way_is_named(tmp_path: Path) -> None:
    def fast(t: float) -> np.ndarray:
        return swing(0.0) + np.array([2.5 * math.sin(2.0 * t), 0, 0, 0, 0, 0])

    report = judged(tmp_path, Scene(motion=fast))
    excess = report.first_excess
    assert excess is not None
    assert (excess.joint, excess.quantity) == ("shoulder_pan_joint", "velocity")
    assert excess.value > excess.limit == pytest.approx(math.pi, abs=1e-6)
    assert any(line.startswith("first limit in the way") for line in report.lines())


def test_assume_nobody_is_a_waiver(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(), assume_nobody=True)
    assert report.exit_status == 3
    assert any("assume-nobody" in text for text in report.waived)
    assert report.count(Status.VERIFIED) > 150


def test_what_nobody_declared_is_a_waiver(tmp_path: Path) -> None:
    cell = Cell.from_table({"people": {"repeated_points": "measured"}})
    report = verify(Scene().write(tmp_path / "r.mcap"), cell)
    assert report.exit_status == 3
    assert any("tool" in text for text in report.waived)
    assert any("limits" in text for text in report.waived)


def test_ignored_parts_are_a_waiver_and_open_no_obligation(tmp_path: Path) -> None:
    def only_legs_near(_t: float) -> np.ndarray:
        points = person_at(4.0, 0.0)
        points[[Point.L_KNEE, Point.L_ANKLE]] += (-0.2, 0.0, 0.0)
        return points

    legs = ["l_thigh", "l_shank", "l_foot", "r_thigh", "r_shank", "r_foot"]
    report = judged(tmp_path, Scene(people={"p1": only_legs_near}), {"people.ignored_parts": legs})
    assert any("body parts left out" in text for text in report.waived)
    assert report.exit_status == 3


def test_unknown_frame_is_refused_and_listed(tmp_path: Path) -> None:
    report = judged(tmp_path, Scene(frame="camera"))
    assert report.count(Status.VERIFIED) == 0
    assert report.refused_total > 0
    assert "frame" in report.refused[0].reason


def test_declared_frame_moves_people(tmp_path: Path) -> None:
    frames = {"camera": {"xyz_m": [3.0, 0.0, 0.0], "rotation_error_deg": 0.5}}
    scene = Scene(frame="camera", people={"p1": lambda _t: person_at(1.0, 0.0)})
    report = judged(tmp_path, scene, {"people.frames": frames})
    assert report.count(Status.VERIFIED) > 170
    assert report.tightest is not None
    chord = 2.0 * math.sin(math.radians(0.25))
    assert report.tightest.budget.error > 0.005 + 0.5 * chord  # at least 0.5 m from the camera


def test_recording_robot_and_cell_must_agree(tmp_path: Path) -> None:
    path = Scene().write(tmp_path / "r.mcap")
    with pytest.raises(SetupError, match="recording is of ur5"):
        verify(path, Cell.from_table({"robot": {"name": "ur10"}}))


def test_recording_without_people_is_refused(tmp_path: Path) -> None:
    path = replace(Scene(), people={"p1": lambda _t: None}).write(tmp_path / "r.mcap")
    with pytest.raises(SetupError, match="assume-nobody"):
        verify(path, Cell.from_table({}))


def test_windows_do_not_change_the_verdicts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene(duration=6.0, people={"p1": lambda t: person_at(2.2 - 0.2 * t, 0.3)})
    whole = judged(tmp_path, scene)
    (tmp_path / "r.mcap").unlink()
    monkeypatch.setattr("verifier.replay.WINDOW_S", 1.1)
    monkeypatch.setattr("verifier.replay.TAIL_S", 0.5)
    monkeypatch.setattr("verifier.section.TAIL_S", 0.5)
    cut = judged(tmp_path, scene)
    assert np.array_equal(whole.per_cycle.status, cut.per_cycle.status)
    both = np.isfinite(whole.per_cycle.gap_m) & np.isfinite(cut.per_cycle.gap_m)
    assert np.abs(whole.per_cycle.gap_m - cut.per_cycle.gap_m)[both].max() < 5e-3
