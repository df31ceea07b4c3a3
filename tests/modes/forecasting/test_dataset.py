"""Windows against plain loops, and what a turn, a way or a mirror must not change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modes.forecasting import dataset
from modes.forecasting.dataset import (
    Recording,
    Windows,
    back_in_world,
    canonical,
    features,
    joints_of_features,
    mirrored,
    read_folder,
    read_people,
    resampled,
    seen_from,
    split_by_subject,
    windows_of,
)
from modes.forecasting.skeleton import ROOT, Joint, bones_of
from modes.forecasting.synthetic import person
from robots.errors import SetupError

Array = NDArray[np.float64]


def recording(seed: int = 0, seconds: float = 8.0, rate: float = 40.0, licence: str = "made up") -> Recording:
    joints = person(seconds, rate, seed)
    return Recording(f"some_body_{seed}", "some_body", licence, 5.0 + np.arange(len(joints)) / rate, joints)


def written(path: Path, **arrays: object) -> Path:
    np.savez(path, **arrays)  # type: ignore[arg-type]  # arrays of any kind are tried
    return path


POINTS = ("pelvis", "neck_base", "l_shoulder", "r_shoulder", "elsewhere")


def test_a_file_that_is_none_is_refused_in_a_line(tmp_path: Path) -> None:
    t, xyz = np.arange(3.0), np.zeros((3, 5, 3))
    (tmp_path / "text.npz").write_text("no")
    wrong = [
        (tmp_path / "text.npz", "no NPZ of people"),
        (tmp_path / "absent.npz", "no NPZ of people"),
        (written(tmp_path / "a.npz", t=t, xyz=xyz), "no NPZ of people"),
        (written(tmp_path / "b.npz", t=t[::-1], joints=np.array(POINTS), xyz=xyz), "increasing times"),
        (written(tmp_path / "c.npz", t=t, joints=np.array(POINTS), xyz=xyz[:2]), "does not fit 3"),
        (written(tmp_path / "d.npz", t=t, joints=np.array(POINTS), xyz=np.full_like(xyz, np.nan)), "trunk"),
        (
            written(tmp_path / "e.npz", t=t, joints=np.array(POINTS, dtype=object), xyz=xyz),
            "no NPZ of people",
        ),
    ]
    for path, message in wrong:
        with pytest.raises(SetupError, match=message) as refused:
            read_people(path)
        assert "\n" not in str(refused.value)


def test_points_of_other_names_are_passed_over(tmp_path: Path) -> None:
    xyz = np.zeros((4, 5, 3))
    xyz[:, 0], xyz[:, 1], xyz[:, 2], xyz[:, 3] = (0, 0, 1), (0, 0, 1.5), (0, 0.2, 1.4), (0, -0.2, 1.4)
    path = written(
        tmp_path / "ab_12_x.npz", t=np.arange(4.0), joints=np.array(POINTS), xyz=xyz, licence="GPL-3.0"
    )
    found = read_people(path)
    assert found.subject == "ab_12" and not found.may_train
    assert np.allclose(found.joints[:, ROOT], (0.0, 0.0, 1.125))
    assert np.isnan(found.joints[:, Joint.LHEE]).all()
    assert [each.name for each in read_folder(tmp_path)] == ["ab_12_x"]
    with pytest.raises(SetupError, match="1 recordings of people, of which 2"):
        read_folder(tmp_path, 2)


def test_between_samples_it_is_straight(rng: np.random.Generator) -> None:
    t = np.cumsum(rng.uniform(0.01, 0.1, 200))
    values = rng.normal(size=(200, 3))
    at = rng.uniform(t[0], t[-1], 500)
    expected = np.stack([np.interp(at, t, values[:, k]) for k in range(3)], axis=1)
    assert np.allclose(resampled(t, values, at), expected, atol=1e-12)
    assert np.array_equal(resampled(t, values, t), values)
    assert np.isnan(resampled(t, values, np.array([t[0] - 0.1, t[-1] + 0.1]))).all()
    values[100] = np.nan
    found = resampled(t, values, np.array([t[99], 0.5 * (t[99] + t[100]), t[101]]))
    assert np.isfinite(found[[0, 2]]).all() and np.isnan(found[1]).all()


def test_windows_are_what_was_before_and_after_and_hold_the_first_frame() -> None:
    one = recording()
    found = windows_of(one, 0.3, 1.0)
    assert len(found) == int((8.0 - 1.0 / 40.0 - 1.0 - 1.0) / 0.3 + 1e-9) + 1
    for k in range(len(found)):
        end = 6.0 + 0.3 * k
        for i in range(30):
            at = max(end - 0.1 * (29 - i), 5.0)
            for axis in range(3):
                expected = np.interp(at, one.t, one.joints[:, Joint.RWPS, axis])
                assert found.history[k, i, Joint.RWPS, axis] == pytest.approx(expected, abs=1e-9)
        for i in range(10):
            expected = np.interp(end + 0.1 * (i + 1), one.t, one.joints[:, Joint.LHEE, 0])
            assert found.future[k, i, Joint.LHEE, 0] == pytest.approx(expected, abs=1e-9)
    assert np.array_equal(found.history[0, 0], one.joints[0])
    assert len(windows_of(recording(seconds=1.9))) == 0 and len(Windows.of([])) == 0


def test_looked_at_canonically_a_turn_about_z_and_a_way_change_nothing(rng: np.random.Generator) -> None:
    history = windows_of(recording()).history
    origin, turn = canonical(history)
    looked = seen_from(history, origin, turn)
    assert np.allclose(back_in_world(looked, origin, turn), history, atol=1e-12)
    assert np.allclose(looked[:, -1, ROOT], 0.0, atol=1e-12)
    left = (
        looked[:, -1, Joint.LSHO]
        - looked[:, -1, Joint.RSHO]
        + looked[:, -1, Joint.LHIP]
        - looked[:, -1, Joint.RHIP]
    )
    assert np.allclose(left[:, 0], 0.0, atol=1e-12) and (left[:, 1] > 0.0).all()
    for _ in range(10):
        moved = history @ Rotation.from_euler("z", rng.uniform(-4.0, 4.0)).as_matrix().T + rng.normal(size=3)
        assert np.allclose(seen_from(moved, *canonical(moved)), looked, atol=1e-9)


def test_who_lies_on_the_side_faces_along_x() -> None:
    history = np.zeros((30, 15, 3))
    history[:, Joint.LSHO, 2] = 1.0
    assert np.array_equal(canonical(history)[1], np.eye(3))


def test_features_there_and_back() -> None:
    windows = windows_of(recording())
    origin, turn = canonical(windows.history)
    both = np.concatenate((windows.history, windows.future), axis=1)
    looked = seen_from(both, origin, turn)
    seen = features(looked)
    assert np.allclose(np.linalg.norm(seen[..., :42].reshape(-1, 14, 3), axis=2), 1.0)
    assert np.allclose(seen[:, 0, 42:], 0.0)
    assert np.allclose(seen[:, 5, 42:], 10.0 * (looked[:, 5, ROOT] - looked[:, 4, ROOT]))
    _, length = bones_of(looked[:, 29])
    found = joints_of_features(
        3.0 * seen[:, 30:] * ([1.0] * 42 + [1.0 / 3.0] * 3), looked[:, 29, ROOT], length
    )
    assert np.abs(found - looked[:, 30:]).max() < 0.01, (
        "only the bones between hips change their lengths a little"
    )


def test_a_mirror_swaps_left_and_right() -> None:
    joints = person(2.0, 10.0, 3)
    seen = mirrored(joints)
    assert np.array_equal(mirrored(seen), joints)
    assert np.array_equal(seen[:, Joint.LWPS], joints[:, Joint.RWPS] * (1.0, -1.0, 1.0))
    assert np.array_equal(seen[:, Joint.L3], joints[:, Joint.L3] * (1.0, -1.0, 1.0))
    _, was = bones_of(joints)
    _, length = bones_of(seen)
    assert np.allclose(np.sort(length, axis=1), np.sort(was, axis=1))


def test_faster_is_the_same_way_in_less_time() -> None:
    one = recording()
    quick = dataset.faster(one, 2.0)
    assert np.array_equal(quick.joints, one.joints) and np.allclose(np.diff(quick.t), 0.5 * np.diff(one.t))


def test_nobody_who_is_judged_is_trained_on() -> None:
    first, second = (
        recording(0),
        Recording("other_one_1", "other_one", "GPL-3.0", np.arange(3.0), np.zeros((3, 15, 3))),
    )
    train, rest = split_by_subject([first, second], ["some_body"])
    assert [each.name for each in train] == ["some_body_0"] and rest == [second]
    with pytest.raises(SetupError, match="'nobody' is not among other_one, some_body"):
        split_by_subject([first, second], ["nobody"])
    with pytest.raises(SetupError, match="other_one_1: weights are not trained on recordings under GPL"):
        split_by_subject([first, second], ["other_one"])


@pytest.mark.real_data
def test_recordings_are_read_and_have_windows(real_data: Path) -> None:
    found = read_folder(real_data, 15)
    names = {each.name for each in found}
    assert {"cmu_02_01_walk", "ad_cmu1_jumping_jacks", "kth_handover_new_giver"} <= names
    assert "icl_assembly_Task4_Human1_trial1" not in names, "it has arms only"
    assert {each.subject for each in found if not each.may_train} == {"sara_exp"}
    for each in found:
        _, length = bones_of(each.joints)
        assert np.nanmedian(length[:, 6]) == pytest.approx(0.25, abs=0.1), "forearms"
        if each.subject.startswith("cmu"):
            assert len(windows_of(each)) > 0
