"""Somebody who is larger than the profile has people: no verdict of that profile holds for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from occupancy.body import Point, load_profile
from tests.occupancy.people import only
from tests.verifier.scenes import CELL, Scene, far, person_at
from tests.verifier.supervised import CYCLE, EPOCH, PANDA_HOME, panda, panda_supervisor, quintic
from tests.verifier.supervised import report as one_person
from tests.verifier.test_hindsight import known
from tests.verifier.test_hindsight import seen as reported
from verifier import Cell, Reason, Status, verify
from verifier.batch import BatchVerifier
from verifier.hindsight import PeopleHindsight, sightings
from verifier.proposal import NewTrajectory

ISO = load_profile("iso")
LARGE_S, HIDDEN_S = 0.8, 1.2


def large(x: float) -> np.ndarray:
    """A right forearm of 0.35 m, 7 cm longer than that of a person of 1.90 m."""
    xyz = person_at(x, 0.0)
    down = xyz[Point.R_WRIST] - xyz[Point.R_ELBOW]
    longer = down * (0.35 / np.linalg.norm(down) - 1.0)
    xyz[[Point.R_WRIST, Point.R_HAND, Point.R_FINGERTIP]] += longer
    return xyz


def grows(t: float) -> np.ndarray:
    """Large from 0.8 s on; the arm is not seen any more after 1.2 s."""
    xyz = (large(6.0) if t >= LARGE_S else person_at(6.0, 0.0)) + 1e-4 * t
    return xyz if t < HIDDEN_S else only(xyz, Point.HEAD, Point.NECK_BASE, Point.PELVIS)


def test_no_cycle_is_verified_that_reaches_into_the_time_in_which_it_shows(tmp_path: Path) -> None:
    path, cell = Scene(people={"p1": grows}, duration=2.0).write(tmp_path / "r.mcap"), Cell.from_table(CELL)
    report = verify(path, cell)
    rows = report.per_cycle
    stops = rows.t + 0.02 + np.nan_to_num(rows.stop_time_s)
    known_by_then = stops > LARGE_S + 0.02
    assert known_by_then.any() and (rows.status[known_by_then] == Status.CONTRADICTED).all()
    assert (rows.status[stops < LARGE_S - 0.02] != Status.CONTRADICTED).all()
    assert report.count(Status.VERIFIED) > 0 and report.exit_status == 1
    reasons = {Reason(int(each)) for each in rows.reason[known_by_then]}
    assert reasons == {Reason.PERSON_OUTSIDE_PREDICTION, Reason.INCONSISTENT_REPORTS}
    texts = [item.text for item in report.contradicted]
    assert any("0.350 m from r_elbow" in text or "m from r_wrist" in text for text in texts), texts
    assert any("farther apart than the profile's sizes" in text for text in texts), texts


def test_batch_says_the_same(tmp_path: Path) -> None:
    path, cell = Scene(people={"p1": grows}, duration=1.2).write(tmp_path / "r.mcap"), Cell.from_table(CELL)
    one, many = verify(path, cell).per_cycle, BatchVerifier(cell, recorded="ur5").verify_recording(path)
    np.testing.assert_array_equal(many.status, one.status)
    np.testing.assert_array_equal(many.reason, one.reason)


@pytest.mark.parametrize(("until", "found"), [(1.9, False), (2.0, True)])
def test_hindsight_looks_up_to_the_end_of_the_stop(until: float, found: bool) -> None:
    of = known(reported(1.0, a=person_at(4.0, 0.0)))
    later = sightings(of, [reported(1.0, a=person_at(4.0, 0.0)), reported(2.0, a=large(4.01))])
    stamps = np.array([1.0, 2.0])
    finding = PeopleHindsight(ISO, None).check(of.people, of.person_ids, later, stamps, (1.5, until))
    assert (finding is not None) is found
    if finding is not None:
        assert finding.reason is Reason.PERSON_OUTSIDE_PREDICTION and finding.t == 2.0
        assert "larger people need another profile" in finding.text


def test_a_supervisor_does_not_move_beside_them() -> None:
    supervisor = panda_supervisor()
    path = quintic([PANDA_HOME, PANDA_HOME + 0.2], panda()[0].robot.limits)
    assert supervisor.propose(NewTrajectory(path)) is None
    answers = []
    for k in range(30):
        report = one_person(EPOCH + k * CYCLE, 6.0)
        if k in (2, 3):
            who = report.people[0]._replace(xyz=large(6.0) + np.array([0.0, 0.0, 0.8]))
            report = report._replace(people=(who,))
        answers.append(supervisor.step(EPOCH + k * CYCLE, [report]).verdict.reason)
    inconsistent = [reason is Reason.INCONSISTENT_REPORTS for reason in answers]
    assert inconsistent[:6] == [False, False, True, True, True, True], answers
    assert not inconsistent[-1], "the arm may have moved to where it is seen since"


def appears(t: float) -> np.ndarray | None:
    return None if t < LARGE_S else large(6.0) + 1e-4 * t


@pytest.mark.parametrize(("rate", "delay"), [(50.0, 0.03), (5.0, 0.2)])
def test_the_first_sighting_of_somebody_unknown_counts_too(tmp_path: Path, rate: float, delay: float) -> None:
    scene = Scene(people={"p1": far, "p2": appears}, people_rate=rate, delay=delay)
    cell = Cell.from_table({**CELL, "people": {**CELL["people"], "latency_s": delay}})
    rows = verify(scene.write(tmp_path / "r.mcap"), cell).per_cycle
    shows = (rows.t + 0.02 + np.nan_to_num(rows.stop_time_s) > LARGE_S + 0.001) & (rows.t < LARGE_S + delay)
    assert shows.any() and (rows.status[shows] == Status.CONTRADICTED).all()
