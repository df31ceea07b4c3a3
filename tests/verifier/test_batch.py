"""Many cycles in one call: the answers of ordinary replay, cycle by cycle, however the work is divided."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from robots.errors import SetupError
from robots.motion import MAX_SLICES
from tests.conftest import Some
from tests.verifier.array_scenes import EPOCH_S, ArrayScene, random_scene
from tests.verifier.scenes import person_at
from verifier import Cell, Reason, Status, VerifyReport, verify
from verifier.batch import CHUNK, BatchResult, BatchVerifier, verify_batch
from verifier.recordings.arrays import ArraySource, JointSamples, PeoplePoints
from verifier.recordings.importing import ImportSettings, import_recording
from verifier.recordings.people_source import PeopleFile, Place
from verifier.setup import build_robot
from verifier.verdict import STATUS_OF_REASON

Count = Callable[[int], int]

CELL: dict[str, object] = {
    "cycle_s": 0.01,
    "robot": {"name": "ur5", "bare_flange": True, "accept_assumed": ["limits"]},
    "people": {"latency_s": 0.01, "clock_error_s": 0.001},
}
BOX = {"min_m": [-4, -4, -2], "max_m": [4, 4, 3]}
CELLS: dict[str, dict[str, object]] = {
    "iso": {},
    "1 kHz": {"cycle_s": 0.001},
    "delay": {"robot": {"tracking": {"delay_min_s": 0.002, "delay_max_s": 0.02}}},
    "declared error": {"robot": {"tracking": {"position_error_rad": 0.01}}},
    "short slices": {"stop": {"slice_s": 0.0005}},
    "reports pause": {"people": {"max_report_gap_s": 0.05}},
    "own stop": {"robot": {"silence": {"hold_s": 0.01, "deceleration_rad_s2": 5.0}}},
    "velocities": {"people": {"profile": "tum", "models": ["articulated_velocity", "arm_reach"]}},
    "accelerations": {"people": {"profile": "tum", "models": ["articulated_acceleration"]}},
    "floor": {"workspace": {"floor_z_m": -0.9}},
    "post": {
        "workspace": {
            "fixtures": {
                "post": {"kind": "capsule", "a_m": [0.5, 0.4, -1], "b_m": [0.5, 0.4, 1], "radius_m": 0.1}
            }
        }
    },
    "self-collision": {"criteria": {"self_collision": True}},
    "monitored": {"people": {"monitored": {"all": {"kind": "box", **BOX, "detection_time_s": 0.1}}}},
}


def cell(changes: dict[str, object]) -> Cell:
    table = {key: dict(value) if isinstance(value, dict) else value for key, value in CELL.items()}
    for key, value in changes.items():
        table[key] = {**table.get(key, {}), **value} if isinstance(value, dict) else value
    return Cell.from_table(table)


def assert_same(batch: BatchResult, report: VerifyReport) -> None:
    """Everything is the same, but for gaps that are lower bounds."""
    rows, alone = report.per_cycle, ~batch.bounded
    assert np.array_equal(batch.t, rows.t)
    assert np.array_equal(batch.status, rows.status)
    assert np.array_equal(batch.reason, rows.reason)
    assert np.array_equal(batch.stop_time_s, rows.stop_time_s, equal_nan=True)
    assert np.array_equal(batch.gap_m[alone], rows.gap_m[alone], equal_nan=True)
    assert (batch.reason[batch.bounded] == int(Reason.SEPARATED)).all()
    # 1e-6 m: gaps are kept in single precision
    assert (batch.gap_m[batch.bounded] <= rows.gap_m[batch.bounded] + 1e-6).all()
    assert (batch.gap_m[batch.bounded] > 0.0).all()


@pytest.mark.parametrize("name", CELLS)
def test_answers_are_those_of_ordinary_replay(
    name: str, tmp_path: Path, rng: np.random.Generator, count: Count
) -> None:
    chosen, found = cell(CELLS[name]), set()
    verifier = BatchVerifier(chosen)
    together = 0
    for trial in range(count(40)):
        scene = random_scene(rng, 4.0, people=1 + trial % 3, faults=trial % 4 != 3)
        batch = verifier.verify(scene.joints, scene.people)
        assert_same(batch, verify(scene.write(tmp_path / f"{trial}.mcap"), chosen))
        lasts = chosen.cycle_s + batch.stop_time_s[batch.bounded]
        assert (lasts <= MAX_SLICES * chosen.stop.slice_s * (1.0 + 1e-6)).all(), "longer slices than wanted"
        together += int(batch.bounded.sum())
        found |= set(np.unique(batch.status))
    possible = name not in ("accelerations", "self-collision", "monitored", "own stop")
    assert (together > 0) == possible
    assert len(found) >= 2


_MIDDLE = (0.0, -1.2, 1.3, -0.4, 0.3, 0.0)


def quiet(seconds: float, away: float = 4.0) -> ArrayScene:
    """An arm that swings all the time, and somebody who stands ``away`` [m]."""
    t = EPOCH_S + np.arange(int(seconds * 125.0) + 1) / 125.0
    q = np.column_stack([0.5 * np.sin(1.5 * t + k) + at for k, at in enumerate(_MIDDLE)])
    seen = EPOCH_S + np.arange(int(seconds * 50.0) + 1) / 50.0
    xyz = np.array([[person_at(away + 0.01 * np.sin(each), 0.0)] for each in seen])
    return ArrayScene(JointSamples(t, q), PeoplePoints(seen, xyz))


def test_what_is_far_away_is_proven_together() -> None:
    scene = quiet(3.0)
    batch = verify_batch(scene.joints, scene.people, cell({}))
    verified = batch.status == int(Status.VERIFIED)
    assert verified.mean() > 0.8
    assert batch.bounded[verified].mean() > 0.9


def test_a_recording_is_answered_as_its_arrays(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = random_scene(rng, 3.0)
    verifier = BatchVerifier(cell({}))
    from_arrays = verifier.verify(scene.joints, scene.people)
    assert_equal(from_arrays, verifier.verify_recording(scene.write(tmp_path / "r.mcap")))


def assert_equal(a: BatchResult, b: BatchResult) -> None:
    for name in ("t", "status", "reason", "gap_m", "stop_time_s", "bounded"):
        assert np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True), name


@pytest.mark.real_data
def test_real_recordings_are_answered_as_by_ordinary_replay(
    tmp_path: Path, real_data: Path, some: Some
) -> None:
    chosen = Cell.from_table({"robot": {"bare_flange": True, "accept_assumed": ["limits", "enclosure"]}})
    path, joints = tmp_path / "r.mcap", real_data / "robot" / "franka_panda_exciting_trajectory.npz"
    clips = [real_data / "human" / f"kth_handover_new_{who}.npz" for who in ("giver", "taker")]
    settings = ImportSettings("panda", build_robot(chosen, "panda").joints)
    verifier = BatchVerifier(chosen, recorded="panda")
    for distance in some([1.2, 2.0, 4.5]):
        people = [PeopleFile(clip, Place(distance, 0.0, 0.0, 180.0)) for clip in clips]
        import_recording(path, joints, people, settings, force=True)
        batch = verifier.verify_recording(path)
        assert_same(batch, verify(path, chosen))
        assert batch.bounded.any() or distance < 4.0


@pytest.mark.rarely("test_answers_are_those_of_ordinary_replay")
def test_windows_and_stretches_of_a_long_recording_change_nothing(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    scene = random_scene(rng, 40.0)
    verifier = BatchVerifier(cell({}))
    alone = verifier.verify(scene.joints, scene.people)
    assert len(alone.t) > 3 * CHUNK
    assert_same(alone, verify(scene.write(tmp_path / "r.mcap"), cell({})))
    for jobs in (2, 3):
        assert_equal(alone, verifier.verify(scene.joints, scene.people, jobs=jobs))


@pytest.mark.parametrize("after", [-0.02, 0.0, 0.04])
def test_what_is_seen_behind_a_border_contradicts_cycles_before_it(after: float, tmp_path: Path) -> None:
    """Somebody is elsewhere at once, when a window of 30 s has ended: the stops before had not."""
    scene = quiet(35.0)
    jump = EPOCH_S + 30.0 + after
    scene.people.xyz[scene.people.t >= jump - 1e-6] += [0.0, 6.0, 0.0]
    batch = verify_batch(scene.joints, scene.people, cell({}))
    assert_same(batch, verify(scene.write(tmp_path / "r.mcap"), cell({})))
    contradicted = batch.t[batch.status == int(Status.CONTRADICTED)]
    assert contradicted.min() < min(30.0, 30.0 + after) - 0.02


def test_stretches_know_the_reports_before_them(rng: np.random.Generator) -> None:
    scene = random_scene(rng, 35.0)
    verifier = BatchVerifier(cell({}))
    whole = verifier.verify(scene.joints, scene.people)
    source = ArraySource(scene.joints, scene.people, verifier.robot.joints)
    late = verifier.stretch(source, 3 * CHUNK, len(whole.t))
    assert np.array_equal(whole.reason[3 * CHUNK :], late.reason)
    assert np.array_equal(whole.gap_m[3 * CHUNK :], late.gap_m, equal_nan=True)


def test_many_motions_against_one_scene(rng: np.random.Generator) -> None:
    scenes = [random_scene(rng, 1.5) for _ in range(5)]
    people = scenes[0].people
    verifier = BatchVerifier(cell({}))
    motions = [scene.joints for scene in scenes]
    one_by_one = [verifier.verify(motion, people) for motion in motions]
    for jobs in (1, 2):
        together = list(verifier.verify_each(iter(motions), people, jobs=jobs))
        for a, b in zip(one_by_one, together, strict=True):
            assert_equal(a, b)


def test_a_single_report_lets_people_grow_until_they_are_everywhere() -> None:
    scene = quiet(3.0)
    first = PeoplePoints(scene.people.t[:1], scene.people.xyz[:1])
    batch = verify_batch(scene.joints, first, cell({}))
    verified = np.flatnonzero(batch.status == int(Status.VERIFIED))
    # 4 m at 2 m/s, less reach, sizes and the time to stop
    assert 0.3 < batch.t[verified[-1]] < 2.0
    later = batch.reason[(batch.t > batch.t[verified[-1]]) & (batch.status == int(Status.NOT_VERIFIED))]
    assert len(later) and (later == int(Reason.REACHABLE)).all()


def test_statuses_belong_to_reasons(rng: np.random.Generator) -> None:
    scene = random_scene(rng, 6.0, people=3)
    batch = verify_batch(scene.joints, scene.people, cell({}))
    for reason in np.unique(batch.reason):
        of = batch.status[batch.reason == reason]
        assert (of == int(STATUS_OF_REASON[Reason(int(reason))])).all()
    assert sum(batch.count(status) for status in Status) == len(batch.t)


# Bad input

T, Q = np.arange(20) / 100.0, np.zeros((20, 6))
SEEN, XYZ = np.array([0.0, 0.1]), np.zeros((2, 1, 20, 3))


def at(values: np.ndarray, index: object, value: float) -> np.ndarray:
    changed = values.astype(float)
    changed[index] = value
    return changed


@pytest.mark.parametrize(
    ("t", "q", "message"),
    [
        (T[:1], Q[:1], "1 samples; a motion takes at least two"),
        (T[:0], Q[:0], "0 samples"),
        (T, Q[:-1], r"t \(20,\) and q \(19, 6\)"),
        (T, Q[:, 0], r"q \(20,\) should be"),
        (T[:, None], Q, r"t \(20, 1\)"),
        (at(T, 3, np.nan), Q, r"t\[3\] is nan s"),
        (at(T, 3, np.inf), Q, r"t\[3\] is inf s"),
        (at(T, 3, 1e12), Q, r"t\[3\] is 1000000000000.0 s"),
        (T[::-1], Q, "t should increase, but 0.19 s is followed by 0.18 s"),
        (at(T, 4, T[3]), Q, "t should increase, but 0.03 s is followed by 0.03 s"),
        (T, at(Q, (2, 5), np.nan), r"q\[2, 5\] is nan"),
        (T, at(Q, (2, 5), np.inf), r"q\[2, 5\] is inf"),
        (["a"], Q, "t should be an array of numbers"),
    ],
)
def test_joint_samples_that_are_no_motion_are_refused(t, q, message) -> None:
    with pytest.raises(SetupError, match=message) as caught:
        JointSamples(t, q)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": SEEN[:0], "xyz": XYZ[:0]}, "there is no report"),
        ({"t": SEEN[:1]}, r"t \(1,\) and xyz \(2, 1, 20, 3\)"),
        ({"xyz": XYZ[:, :, :19]}, r"xyz \(2, 1, 19, 3\)"),
        ({"xyz": XYZ[:, 0]}, r"xyz \(2, 20, 3\)"),
        ({"xyz": at(XYZ, (1, 0, 7, 2), np.inf)}, r"xyz\[1, 0, 7\] is infinite"),
        ({"t": at(SEEN, 1, np.nan)}, r"arrived\[1\] is nan|t\[1\] is nan"),
        ({"arrived": SEEN[:1]}, r"arrived \(1,\) should be \(2,\)"),
        ({"arrived": SEEN[::-1]}, "arrived should not decrease"),
        ({"arrived": SEEN + 11.0}, "more than 10 s apart"),
        ({"error_m": np.zeros((2, 20))}, r"error_m \(2, 20\)"),
        ({"measured": np.zeros((2, 2), int)}, r"measured \(2, 2\)"),
        ({"listed": np.zeros(2, bool)}, r"listed \(2,\)"),
        ({"complete": "no"}, r"complete, <U2 \(\), should be True or False"),
        ({"complete": np.nan}, "complete, float64"),
        ({"complete": np.ones(3, bool)}, r"complete, bool \(3,\)"),
        ({"complete": np.ones((2, 1), bool)}, r"complete, bool \(2, 1\)"),
        ({"measured": np.ones((2, 1), bool)}, "measured is an array of bool, should be integers"),
        ({"measured": np.nan}, "measured is an array of float64"),
        ({"listed": np.array([[np.nan], [1.0]])}, "listed is an array of float64, should be truth values"),
        ({"ids": ("a", "b")}, "1 different names"),
        ({"ids": ("",)}, "1 different names"),
    ],
)
def test_reports_that_are_none_are_refused(changes, message) -> None:
    with pytest.raises(SetupError, match=message) as caught:
        PeoplePoints(**{"t": SEEN, "xyz": XYZ, **changes})
    assert "\n" not in str(caught.value)


def test_arrays_must_fit_the_robot_and_one_another() -> None:
    people = PeoplePoints(SEEN, XYZ)
    with pytest.raises(SetupError, match="q has 5 columns, the robot has 6 joints"):
        verify_batch(JointSamples(T, Q[:, :5]), people, cell({}))
    with pytest.raises(SetupError, match="do not overlap in time"):
        verify_batch(JointSamples(T + 100.0, Q), people, cell({}))
    with pytest.raises(SetupError, match="jobs = 0 should be at least 1"):
        verify_batch(JointSamples(T, Q), people, cell({}), jobs=0)
    with pytest.raises(SetupError, match="0 cycles"):
        verify_batch(JointSamples(T, Q), people, cell({"cycle_s": 0.5}))


def test_nan_points_prove_nothing() -> None:
    scene = quiet(2.0)
    unseen = PeoplePoints(scene.people.t, np.full_like(scene.people.xyz, np.nan))
    batch = verify_batch(scene.joints, unseen, cell({}))
    assert batch.count(Status.VERIFIED) == 0
    assert Reason.PERSON_WITHOUT_BOUND in {Reason(int(reason)) for reason in np.unique(batch.reason)}
