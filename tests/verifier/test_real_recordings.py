"""Real recordings, read in place: arms and people that this project did not make."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Some
from verifier import Cell, Reason, Status, VerifyReport, verify
from verifier.recordings.importing import ImportSettings, import_recording
from verifier.recordings.people_source import PeopleFile, Place
from verifier.setup import build_robot

pytestmark = pytest.mark.real_data

CELL = Cell.from_table({"robot": {"bare_flange": True, "accept_assumed": ["limits", "enclosure"]}})
PANDA = "robot/franka_panda_exciting_trajectory"
SCHUNK = "robot/schunk_lwa_250hz_100x_repeated_motion.npz"
PUNCH = "human/cmu_02_05_punch_strike.npz"
SWORD = "human/cmu_02_08_swordplay.npz"
WALK = "human/cmu_02_01_walk.npz"
SLOW = "human/cmu_49_18_slow_arm_movement.npz"
GLITCH = "human/cmu_03_02_uneven_walk_with_tracking_glitch.npz"
RTDE = "robot/ur3e_rad_rtde_L0L1.csv.gz"
GIVER = "human/kth_handover_new_giver.npz"
TAKER = "human/kth_handover_new_taker.npz"


def judged(
    out: Path, robot: str, joints: Path, people: list[tuple[Path, tuple[float, ...]]], run: int | None = None
) -> VerifyReport:
    model = build_robot(CELL, robot)
    files = [PeopleFile(path, Place(*place)) for path, place in people]
    import_recording(out, joints, files, ImportSettings(robot, model.joints, run=run), force=True)
    return verify(out, CELL)


def panda(
    out: Path, real_data: Path, clips: list[str], place: tuple[float, ...], ending: str = ".npz"
) -> VerifyReport:
    people = [(real_data / clip, place) for clip in clips]
    return judged(out, "panda", real_data / f"{PANDA}{ending}", people)


@pytest.mark.rarely("both readers by themselves, tests/verifier/recordings")
def test_mcap_and_npz_give_the_same_verdicts(tmp_path: Path, real_data: Path) -> None:
    place = (1.7, 0.0, 0.0, 180.0)
    from_npz = panda(tmp_path / "a.mcap", real_data, [PUNCH], place)
    from_mcap = panda(tmp_path / "b.mcap", real_data, [PUNCH], place, ".mcap")
    assert from_npz.cycles == from_mcap.cycles > 1000
    assert np.array_equal(from_npz.per_cycle.status, from_mcap.per_cycle.status)
    assert np.array_equal(from_npz.per_cycle.reason, from_mcap.per_cycle.reason)
    statuses = set(np.unique(from_npz.per_cycle.status))
    assert {int(Status.NOT_VERIFIED), int(Status.VERIFIED)} <= statuses


@pytest.mark.rarely("the other real recordings of this file")
def test_near_gives_witnesses_and_far_gives_none(tmp_path: Path, real_data: Path, some: Some) -> None:
    for clips in some([[PUNCH], [SWORD], [GIVER, TAKER]]):
        shares, gaps = [], []
        for distance in (1.0, 2.0, 4.5):
            report = panda(tmp_path / "r.mcap", real_data, clips, (distance, 0.0, 0.0, 180.0))
            shares.append(report.count(Status.NOT_VERIFIED) / report.cycles)
            gaps.append(report.first_witness)
        assert shares[0] > 0.4 and gaps[0] is not None, clips
        assert gaps[0].gap_m < 0.0, clips
        assert shares[2] == 0.0 and gaps[2] is None, clips
        assert shares[0] >= shares[1] >= shares[2], clips


def test_fast_hands_contradict_the_iso_profile(tmp_path: Path, real_data: Path) -> None:
    report = panda(tmp_path / "r.mcap", real_data, [SWORD], (6.0, 0.0, 0.0, 0.0))
    assert report.count(Status.CONTRADICTED) > 100
    assert report.count(Status.NOT_VERIFIED) == 0
    assert Reason.PERSON_OUTSIDE_PREDICTION in dict(report.reasons(Status.CONTRADICTED))


def test_tracking_glitch_is_never_a_quiet_pass(tmp_path: Path, real_data: Path) -> None:
    """A wrist that jumps at 25 m/s: every cycle whose plan runs over the jump must say so."""
    report = panda(tmp_path / "r.mcap", real_data, [GLITCH], (5.0, 0.0, 0.0, 0.0))
    clip = np.load(real_data / GLITCH)
    t, wrists = clip["t"], clip["xyz"][:, [list(clip["joints"]).index(n) for n in ("l_wrist", "r_wrist")]]
    speed = np.linalg.norm(np.diff(wrists, axis=0), axis=2).max(axis=1) / np.diff(t)
    jump = float(t[int(np.argmax(speed)) + 1])
    assert speed.max() > 20.0
    rows = report.per_cycle
    over = (rows.t + 0.02 < jump) & (rows.t + 0.02 + np.nan_to_num(rows.stop_time_s) > jump)
    assert over.any()
    assert (rows.status[over] == Status.CONTRADICTED).all()


def test_slow_arms_far_away_are_verified(tmp_path: Path, real_data: Path) -> None:
    report = panda(tmp_path / "r.mcap", real_data, [SLOW], (6.0, 0.0, 0.0, 0.0))
    assert report.count(Status.NOT_VERIFIED) == 0
    assert report.count(Status.VERIFIED) > 0.8 * report.cycles


def test_even_an_ordinary_walk_contradicts_the_approach_speed(tmp_path: Path, real_data: Path) -> None:
    """A swinging foot is faster than 2 m/s: an approach speed is no limit of limb speed."""
    report = panda(tmp_path / "r.mcap", real_data, [WALK], (6.0, 0.0, 0.0, 0.0))
    assert report.count(Status.NOT_VERIFIED) == 0
    assert report.count(Status.CONTRADICTED) > 100


@pytest.mark.parametrize("name", ["approaching", "headbutt"])
def test_live_person_beside_a_schunk_arm(tmp_path: Path, real_data: Path, some: Some, name: str) -> None:
    for run in some([1, 25, 60]):
        person = real_data / f"human_robot/sara_exp_{name}.npz"
        near = judged(tmp_path / "n.mcap", "lwa4p", real_data / SCHUNK, [(person, (0.0, 0.0, 0.0, 0.0))], run)
        assert near.count(Status.NOT_VERIFIED) > 0
        assert near.first_witness is not None and near.first_witness.person == "p1"
        away = judged(
            tmp_path / "f.mcap", "lwa4p", real_data / SCHUNK, [(person, (0.0, -6.0, 0.0, 0.0))], run
        )
        assert away.count(Status.NOT_VERIFIED) == 0
        assert away.count(Status.VERIFIED) > 0
        assert sum(near.count(status) for status in Status) == near.cycles


def test_a_ur3e_whose_wrist_has_turned_twice(tmp_path: Path, real_data: Path) -> None:
    """A log of a controller at 25 Hz, 1.1 s long, with wrist 3 at 12.6 rad: it has no position limit."""
    with gzip.open(real_data / RTDE, "rt", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    t = np.array([float(row["timestamp"]) for row in rows])
    q = np.array([[float(row[f"actual_q_{j}"]) for j in range(6)] for row in rows])
    assert q[:, 5].min() > 12.6 and np.allclose(np.diff(t), 0.04, atol=1e-6)
    joints = tmp_path / "joints.npz"
    np.savez(joints, t=t - t[0], q=q)
    clip = real_data / SLOW
    away = judged(tmp_path / "a.mcap", "ur3e", joints, [(clip, (6.0, 0.0, 0.0, 0.0))])
    assert away.count(Status.VERIFIED) > 50 and away.count(Status.NOT_VERIFIED) == 0
    near = judged(tmp_path / "n.mcap", "ur3e", joints, [(clip, (0.8, 0.0, 0.0, 0.0))])
    assert near.count(Status.VERIFIED) == 0 and near.count(Status.NOT_VERIFIED) > 50


def test_glitches_of_the_live_stream_are_seen(tmp_path: Path, real_data: Path) -> None:
    """The headbutt stream swaps markers at 0.48 s: points that jump are refused or contradict."""
    person = real_data / "human_robot/sara_exp_headbutt.npz"
    report = judged(tmp_path / "r.mcap", "lwa4p", real_data / SCHUNK, [(person, (0.0, -6.0, 0.0, 0.0))], 1)
    assert report.count(Status.CONTRADICTED) > 0
    assert report.refused_total > 0
