"""The scenario: trials as the paper has them, what is printed, its JSON and pictures."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from modes.planning import scenario
from modes.planning.motion import motion_along
from modes.planning.outcomes import Errors, Run, Setting, Witness
from modes.planning.potential_field import Bodies
from modes.planning.report import PAPERS, ProactiveReport
from modes.planning.scenario import (
    SETTINGS,
    fixtures,
    profile_of_people,
    robot_of_cell,
    run_scenario,
    run_trial,
)
from modes.planning.trials import END_S, PICK, PLACE, Kind, Trial, trials
from modes.twin.camera import nothing_hidden
from modes.twin.people import Recorded, Stance, Standing, Walking
from occupancy.body import MAX_POINTS, POINT_NAMES, Point
from robots.errors import SetupError
from robots.kernels import forward
from tests.modes.planning.gaps import least_gaps
from tests.verifier.shell import shell
from verifier.scenario import load_scenario, scenario_names

__all__ = ["shell"]

ROOT = Path(__file__).parents[3]
SCHEMA: dict[str, Any] = json.loads((ROOT / "docs/scenario-proactive.schema.json").read_text("utf-8"))
ALL = trials(12)
BLOCKED = Trial(0, Kind.STANDING, Standing(Stance(1.0, 0.0, 3.14, -0.8)), nothing_hidden)
FREE = Trial(1, Kind.STANDING, Standing(Stance(3.0, 0.0, 3.14, -0.8)), nothing_hidden)
PIECES = "single trials in other settings, in every run"


@pytest.fixture(scope="module")
def witness() -> Witness:
    return Witness(robot_of_cell(), profile_of_people(), fixtures())


@pytest.fixture(scope="module")
def report() -> ProactiveReport:
    shares: list[float] = []
    found = run_scenario(ALL[:3], shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0
    return found


def test_trials_are_of_all_kinds_and_the_same_again() -> None:
    again = trials(12)
    assert [each.kind for each in ALL[:3]] == list(Kind)
    for one, other in zip(ALL, again, strict=True):
        assert np.array_equal(one.person.at(1.3), other.person.at(1.3))
    assert not np.array_equal(trials(1, seed=1)[0].person.at(0.0), ALL[0].person.at(0.0))
    hidden = np.array([ALL[2].hidden(t, 0) for t in np.arange(0.0, END_S, 0.1)])
    assert hidden.any() and not hidden.all(axis=1).any() and not hidden[-1].any()
    assert not ALL[0].hidden(1.0, 0).any()


def test_the_straight_way_touches_somebody_and_the_mode_goes_around(witness: Witness) -> None:
    straight = run_trial(BLOCKED, Setting(supervised=False, proposer="fixed"), witness)
    assert straight.contacts > 0 and straight.moving_m < 0.0
    around = run_trial(BLOCKED, PAPERS, witness)
    assert around.arrived and around.contacts == 0 and around.moving_m >= 0.25
    assert around.arrived_s > straight.arrived_s and around.ways >= 1
    assert witness.has_clear_way(BLOCKED)


def test_the_straight_way_is_verified_no_farther_than_it_may_be(witness: Witness) -> None:
    run = run_trial(BLOCKED, Setting(supervised=True, proposer="fixed"), witness)
    assert run.contacts == 0 and not run.arrived and run.moving_m > 0.0


def test_with_nobody_near_all_settings_take_the_straight_way(witness: Witness) -> None:
    runs = [run_trial(FREE, setting, witness) for setting in SETTINGS]
    for run in runs:
        assert run.arrived and run.halts == 0 and run.standstills == 0 and math.isinf(run.moving_m)
        assert np.allclose(run.places[-1], runs[0].places[-1], atol=2e-3)


def test_what_is_needed_is_judged_with_the_truth(witness: Witness) -> None:
    straight = motion_along(np.array([PICK, PLACE]), robot_of_cell().limits)
    assert witness.needed(BLOCKED.person, 0.0, straight, 0.0, 2.0)
    assert not witness.needed(BLOCKED.person, 0.0, straight, 0.0, 0.1)
    assert not witness.needed(FREE.person, 0.0, straight, 0.0, 2.0)


def test_a_trial_without_a_clear_way_is_none(witness: Witness) -> None:
    at_goal = Trial(2, Kind.STANDING, Standing(Stance(0.3, -1.0, 1.57, -0.8)), nothing_hidden)
    assert not witness.has_clear_way(at_goal)
    run = run_trial(at_goal, PAPERS, witness)
    assert not run.arrived and run.ways == 0 and run.moving_m == math.inf


def test_where_the_arm_may_not_rest_at_its_start_leaving_makes_no_clear_way(witness: Witness) -> None:
    leaving = Trial(0, Kind.WALKING, Walking((0.4, 0.9), (3.0, 3.0), floor_z_m=-0.8), nothing_hidden)
    arriving = Trial(1, Kind.WALKING, Walking((2.0, -3.0), (3.0, 3.0), floor_z_m=-0.8), nothing_hidden)
    assert not witness.has_clear_way(leaving) and witness.has_clear_way(arriving)


@pytest.mark.real_data
def test_somebody_who_was_recorded_walks_past_unharmed(witness: Witness, real_data: Path) -> None:
    with np.load(real_data / "human/cmu_02_01_walk.npz") as file:
        t, xyz = file["t"] - file["t"][0], np.full((len(file["t"]), MAX_POINTS, 3), np.nan)
        for column, name in enumerate(file["joints"].tolist()):
            xyz[:, POINT_NAMES.index(name)] = file["xyz"][:, column]
    x, y = (1.1, 0.0) - xyz[:, Point.PELVIS, :2].mean(axis=0)
    trial = Trial(3, Kind.WALKING, Recorded(t, xyz, (float(x), float(y), -0.8)), nothing_hidden)
    for setting in (PAPERS, Setting(supervised=True, proposer="forecast")):
        run = run_trial(trial, setting, witness)
        assert run.contacts == 0 and run.decisions_s


def test_settings_of_another_kind_are_refused() -> None:
    for count, seed, named in ((0, 0, "trials: count = 0"), (2.5, 0, "count"), (3, -1, "trials: seed = -1")):
        with pytest.raises(SetupError, match=named):
            trials(count, seed)  # type: ignore[arg-type]  # what is to be refused
    with pytest.raises(SetupError, match="there is no trial"):
        run_scenario([], lambda _share: None)
    with pytest.raises(
        SetupError, match="setting: proposer = 'best' should be one of fixed, present, forecast"
    ):
        Setting(supervised=True, proposer="best")


@pytest.mark.rarely(PIECES)
def test_the_json_is_what_the_schema_says(report: ProactiveReport) -> None:
    document = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    jsonschema.validate(document, SCHEMA)
    assert document["trials"] == 3 and document["violations"] == 0
    assert len(document["settings"]) == 6
    assert {each["model"] for each in document["forecast_error_m"]} >= {"hold", "constant_velocity"}
    assert document["planning_time_s"]["median"] <= document["planning_time_s"]["max"]
    assert 0 <= document["trials_with_clear_path"] <= 3


@pytest.mark.rarely(PIECES)
def test_what_is_printed_has_the_papers_table_beside_ours(report: ProactiveReport) -> None:
    text = "\n".join(report.lines_of_text())
    for words in ("0.6 to 5.0 s (GPU)", "275 mm", "73 (mean)", "below 200 ms", "made up", "time lost"):
        assert words in text
    assert text.count(", verified") == 3


@pytest.mark.rarely(PIECES)
def test_pictures_are_drawn(report: ProactiveReport) -> None:
    drawn = report.pictures()
    assert set(drawn) == {"figures_5_and_6.png", "gaps_and_times.png", "forecast_errors.png"}
    assert all(picture.startswith(b"\x89PNG") and len(picture) > 10_000 for picture in drawn.values())


def test_a_summary_counts_what_is_below_the_clearance() -> None:
    """Of three runs: one keeps it, one does not, and one has no clear way."""
    runs = [Run(k, PAPERS, arrived_s=3.0 + k, moving_m=gap) for k, gap in enumerate((0.4, 0.2, 0.1))]
    runs[1].halts, runs[1].needed, runs[2].contacts, runs[2].arrived_s = 3, 2, 5, math.inf
    report = ProactiveReport(tuple(ALL[:3]), tuple(runs), frozenset({0, 1}), 0.25, "hold", (), 2.0)
    found = report.summary(PAPERS)
    assert (found.trials, found.arrived, found.contacts, found.below) == (3, 2, 1, 1)
    assert (found.clearance_m, found.least_m) == (pytest.approx(0.3), 0.2)
    assert found.lost_s == (2.0, END_S - 2.0) and (found.halts, found.needed) == (3, 2)


def test_whatever_came_of_it_the_json_is_what_the_schema_says() -> None:
    """Nobody near, no clear way, nothing planned, no run at all, a forecast that is no number."""
    near = Run(0, SETTINGS[3], moving_m=-0.1, contacts=4)
    errors = (Errors(0.1, "hold", math.nan),)
    for runs, clear in ((), ()), ((Run(0, PAPERS), near), ()), ((Run(0, PAPERS), near), (0,)):
        report = ProactiveReport(tuple(ALL[:1]), runs, frozenset(clear), 0.25, "hold", errors, 2.0)
        document = json.loads(json.dumps(report.to_dict(), allow_nan=False))
        jsonschema.validate(document, SCHEMA)
        assert "nan" not in "\n".join(report.lines_of_text())
        assert document["violations"] == len(runs[1:]) and document["succeeded"] == 0
        assert document["clearance_m"] == {"min": None, "median": None}


def test_a_link_that_moves_is_judged_though_one_that_rests_is_deeper_in_somebody(
    witness: Witness, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only the wrist turns, in a hand of somebody whose head is in the upper arm, which rests."""
    monkeypatch.setattr(scenario, "PLACE", (*PICK[:4], PICK[4] + 1.0, PICK[5]))
    rotations, positions = np.zeros((6, 3, 3)), np.zeros((6, 3))
    forward(robot_of_cell().kinematics, np.array(PICK), rotations, positions)
    points = np.full((1, MAX_POINTS, 3), np.nan)
    points[0, Point.HEAD] = 0.5 * (positions[1] + positions[2]) + rotations[1] @ np.array([0.0, 0.0, 0.15])
    points[0, [Point.L_HAND, Point.L_FINGERTIP]] = positions[5]
    trial = Trial(0, Kind.STANDING, Recorded(np.zeros(1), points), nothing_hidden)
    run = run_trial(trial, Setting(supervised=False, proposer="fixed"), witness)
    assert run.contacts > 0 and run.resting_m < run.moving_m < 0.0


def test_what_is_needed_is_what_brute_force_finds(witness: Witness, rng: np.random.Generator) -> None:
    straight, found = motion_along(np.array([PICK, PLACE]), robot_of_cell().limits), []
    for trial in trials(4, seed=int(rng.integers(1000))):
        s, t = rng.uniform(0.0, straight.s_end), rng.uniform(0.0, 3.0)
        gaps = []
        for after in np.arange(0.0, 1.5, 0.03):
            bodies = Bodies.of_points([trial.person.at(t + after)[None]], profile_of_people())
            q = straight.sample(min(s + after, straight.s_end))[0]
            gaps.append(least_gaps(robot_of_cell(), q[None], bodies)[0])
        if abs(min(gaps) - 0.25) > 0.05:  # else the times in between decide
            found.append(min(gaps) < 0.25)
            assert witness.needed(trial.person, t, straight, s, 1.5) == found[-1]
    assert found


def test_it_is_installed() -> None:
    assert "proactive" in scenario_names() and callable(load_scenario("proactive"))
