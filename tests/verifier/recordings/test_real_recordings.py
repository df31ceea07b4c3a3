"""Import of recordings of real arms and real people; compared with what numpy reads from the same files."""

from pathlib import Path

import numpy as np
import pytest

from occupancy.body import POINT_NAMES, Point
from verifier.recordings import (
    ImportSettings,
    PeopleFile,
    Place,
    Recording,
    RecordingError,
    import_recording,
    inspect_recording,
)
from verifier.recordings.csv_table import read_joints as csv_joints
from verifier.recordings.inspection import catalogue
from verifier.recordings.reading import Reading

pytestmark = pytest.mark.real_data

PANDA = tuple(f"panda_joint{n}" for n in range(1, 8))
SETTINGS = ImportSettings("panda", PANDA)


@pytest.fixture
def panda(real_data):
    return real_data / "robot/franka_panda_exciting_trajectory.npz"


def whole(path, joints, *, people=True):
    (window,) = Reading(Recording(path), joints, people=people).windows(1e6, 0.0, 0.0)
    return window


def test_panda_mcap_and_npz_hold_the_same_motion(tmp_path, real_data, panda):
    import_recording(tmp_path / "npz.mcap", panda, [], SETTINGS)
    from_npz = whole(tmp_path / "npz.mcap", PANDA, people=False)
    from_mcap = whole(panda.with_suffix(".mcap"), PANDA, people=False)
    assert len(from_npz.t) == 11815
    np.testing.assert_allclose(from_npz.t, from_mcap.t, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(from_npz.q, from_mcap.q)
    np.testing.assert_allclose(from_npz.t, np.load(panda)["t"], rtol=0.0, atol=1e-9)


def test_panda_mcap_is_recognised(real_data, panda):
    found = inspect_recording(panda.with_suffix(".mcap"))
    assert found.robot_guess == "panda"
    (joints,) = found.topics
    gaps = np.diff(np.load(panda)["t"])
    assert joints.largest_gap_s == pytest.approx(gaps.max(), abs=1e-9)
    assert joints.rate_hz == pytest.approx(1 / gaps.mean())


def test_panda_mcap_as_joints_of_an_import(tmp_path, real_data, panda):
    people = [PeopleFile(real_data / "human/cmu_02_05_punch_strike.npz")]
    summary = import_recording(tmp_path / "a.mcap", panda.with_suffix(".mcap"), people, SETTINGS)
    assert summary.joint_samples == 11815
    reading = Reading(Recording(tmp_path / "a.mcap"), PANDA)
    assert reading.overlap == pytest.approx((0.0, 11.9991), abs=1e-4)


@pytest.mark.parametrize("distance", [0.7, 5.0])
def test_handover_pair_keeps_its_geometry(tmp_path, real_data, panda, distance):
    files = [real_data / f"human/kth_handover_new_{who}.npz" for who in ("giver", "taker")]
    place = Place(distance, 0.3, -0.8, 90.0)
    summary = import_recording(
        tmp_path / "a.mcap", panda, [PeopleFile(path, place) for path in files], SETTINGS
    )
    assert summary.people == ("p1", "p2")
    assert summary.unknown_points == ("abdomen", "chest", "l_shoulder_blade", "r_shoulder_blade")
    window = whole(tmp_path / "a.mcap", PANDA)
    assert len(window.people) == 801
    raw = [np.load(path) for path in files]
    column = list(raw[0]["joints"]).index("r_wrist")
    apart = np.linalg.norm(raw[0]["xyz"][:, column] - raw[1]["xyz"][:, column], axis=1)
    ours = [
        np.linalg.norm(np.subtract(*(person.xyz[Point.R_WRIST] for person in report.people)))
        for report in window.people
    ]
    np.testing.assert_allclose(ours, apart, atol=1e-5)
    x, y, z = raw[0]["xyz"][100, column].astype(float)
    np.testing.assert_allclose(
        window.people[100].people[0].xyz[Point.R_WRIST], [distance - y, 0.3 + x, z - 0.8], atol=1e-6
    )


def test_every_person_of_the_set_can_be_imported(tmp_path, real_data, some):
    files = sorted(real_data.glob("human*/*.npz"))
    assert len(files) >= 18
    arm = tmp_path / "still.npz"
    np.savez(arm, t=np.arange(600) / 10, q=np.zeros((600, 7)), joints=np.array(PANDA))
    for path in some(files, 4):
        raw = np.load(path)
        summary = import_recording(tmp_path / "a.mcap", arm, [PeopleFile(path)], SETTINGS, force=True)
        known = [name for name in raw["joints"] if name in POINT_NAMES]
        assert set(summary.unknown_points) == set(raw["joints"]) - set(known)
        window = whole(tmp_path / "a.mcap", PANDA)
        assert len(window.people) == np.count_nonzero(raw["t"] - raw["t"][0] <= summary.duration_s + 1e-9)
        for number in (0, len(window.people) // 2, len(window.people) - 1):
            (person,) = window.people[number].people
            for name in known:
                point = raw["xyz"][number, list(raw["joints"]).index(name)]
                np.testing.assert_array_equal(person.xyz[POINT_NAMES.index(name)], point.astype(float))
            assert person.measured.bit_count() == len(known)


def test_schunk_runs_beside_a_live_person(tmp_path, real_data):
    joints = catalogue()["lwa4p"]
    path = real_data / "robot/schunk_lwa_250hz_100x_repeated_motion.npz"
    people = [PeopleFile(real_data / "human_robot/sara_exp_approaching.npz")]
    settings = ImportSettings("lwa4p", joints, run=7)
    summary = import_recording(tmp_path / "a.mcap", path, people, settings)
    assert summary.unknown_points == ("unused_7",)
    assert "recording.joint_order" in {a.name for a in summary.assumptions}
    window = whole(tmp_path / "a.mcap", joints)
    raw = np.load(path)
    rows = raw["run"] == 7
    np.testing.assert_array_equal(window.q, raw["q"][rows][: len(window.q)])
    assert len(window.q) > 0.99 * np.count_nonzero(rows)
    with pytest.raises(RecordingError, match=r"run: has 60 runs \(1 … 60\); choose one with --run N"):
        import_recording(tmp_path / "b.mcap", path, people, ImportSettings("lwa4p", joints))


@pytest.mark.parametrize(
    "name", ["ur3e_rad_rtde_L0L1.csv.gz", "ur3_cobotops_1hz.csv.gz", "stopping_and_reaction_tables.csv"]
)
def test_tables_of_other_makers_are_refused_in_one_line(real_data, name):
    path: Path = real_data / "robot" / name
    with pytest.raises(RecordingError, match="line 1: has no column t ") as caught:
        csv_joints(path)
    assert "\n" not in str(caught.value)


def test_bags_without_joints_are_refused_in_one_line(real_data):
    with pytest.raises(RecordingError, match="has no topic with joints"):
        Recording(real_data / "human_robot/original/exp_headbutt.bag")
