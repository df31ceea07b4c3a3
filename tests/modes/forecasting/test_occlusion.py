"""What is filled in is said to be; what was measured stays; rigid people are filled in exactly."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modes.forecasting.errors import gaps
from modes.forecasting.occlusion import STANDING, Autoencoder, Carry, Filler, HoldPlace, Straight, carried
from modes.forecasting.skeleton import BONES, Joint, bones_of
from modes.forecasting.synthetic import person
from modes.forecasting.weights_file import Network
from robots.errors import SetupError

Array = NDArray[np.float64]
LEGS = [Joint.LHIP, Joint.RHIP, Joint.LKNE, Joint.RKNE, Joint.LHEE, Joint.RHEE]


def fillers() -> list[Filler]:
    pytest.importorskip("onnxruntime", reason="the autoencoder needs onnxruntime: the extra forecast")
    return [Carry(), HoldPlace(), Straight(), Autoencoder()]


def history(seed: int) -> Array:
    return person(3.0, 10.0, seed)


def test_other_skeletons_are_refused_in_a_line() -> None:
    for filler in fillers():
        with pytest.raises(SetupError, match=r"\(30, 14, 3\) should be \(frames, 15, 3\): CLAV"):
            filler.fill(np.zeros((30, 14, 3)))
    with pytest.raises(SetupError, match="autoencoder: 29 frames should be 30"):
        Autoencoder().fill(np.zeros((29, 15, 3)))


def test_what_was_measured_stays_and_the_rest_is_said_to_be_inferred(rng: np.random.Generator) -> None:
    for seed in range(20):
        truth, hidden = history(seed), gaps(30, rng)
        shown = np.where(hidden[..., None], np.nan, truth)
        for filler in fillers():
            found = filler.fill(shown)
            assert np.array_equal(found.inferred, hidden) and found.by == filler.name
            assert np.array_equal(found.joints[~hidden], truth[~hidden])
            assert np.isfinite(found.joints).all()


def test_a_joint_with_one_number_missing_was_not_seen() -> None:
    shown = history(0)
    shown[20:, Joint.RWPS, 1] = np.nan
    for filler in fillers():
        assert filler.fill(shown).inferred.sum() == 10


def test_whoever_is_carried_along_without_turning_is_filled_in_exactly(rng: np.random.Generator) -> None:
    for seed in range(10):
        place = history(seed)[0]
        truth = place + np.cumsum(rng.normal(0.0, 0.05, (30, 1, 3)), axis=0)
        for hidden in (gaps(30, rng), np.eye(30, 15, dtype=bool)):
            shown = np.where(hidden[..., None], np.nan, truth)
            assert np.allclose(Carry().fill(shown).joints, truth, atol=1e-9)
            assert np.allclose(carried(shown), truth, atol=1e-9)


def test_a_hidden_forearm_goes_with_the_elbow_and_not_with_the_legs() -> None:
    truth = history(1)[:1].repeat(30, axis=0)
    truth[:, LEGS] += 0.05 * np.arange(30)[:, None, None]
    shown = truth.copy()
    shown[10:, Joint.LWPS] = np.nan
    assert np.allclose(Carry().fill(shown).joints, truth, atol=1e-9)


def test_held_bones_keep_their_lengths(rng: np.random.Generator) -> None:
    for seed in range(10):
        truth, hidden = history(seed), gaps(30, rng)
        found = Carry().fill(np.where(hidden[..., None], np.nan, truth)).joints
        _, length = bones_of(found)
        ends = np.array([end for _begin, end in BONES])
        assert np.ptp(np.where(hidden[:, ends], length, length[:1]), axis=0).max() < 0.01


def test_straight_between_is_exact_for_straight_ways_and_needs_what_follows() -> None:
    truth = history(2)[:1] + 0.03 * np.arange(30)[:, None, None] * np.arange(15)[:, None]
    shown = truth.copy()
    shown[5:20, Joint.RAEL], shown[25:, Joint.LAEL] = np.nan, np.nan
    found = Straight().fill(shown).joints
    assert np.allclose(found[:25], truth[:25])
    assert np.array_equal(found[25:, Joint.LAEL], np.repeat(truth[24:25, Joint.LAEL], 5, axis=0))


def test_legs_that_were_never_seen_stand_below_whoever_stands(rng: np.random.Generator) -> None:
    """A person like the one who stands for all is filled in exactly, wherever and however turned."""
    for _ in range(20):
        turn = Rotation.from_euler("z", rng.uniform(-4.0, 4.0)).as_matrix()
        truth = (STANDING @ turn.T + rng.normal(size=3))[None].repeat(30, axis=0)
        shown = truth.copy()
        shown[:, LEGS] = np.nan
        found = Carry().fill(shown)
        assert np.allclose(found.joints, truth, atol=1e-9) and found.inferred[:, LEGS].all()
        shown[:, Joint.L3] = np.nan
        assert np.allclose(Carry().fill(shown).joints, truth, atol=1e-9)


def test_of_nobody_nothing_is_made_up() -> None:
    for filler in fillers():
        found = filler.fill(np.full((30, 15, 3), np.nan))
        assert np.isnan(found.joints).all() and found.inferred.all()


def test_a_correction_that_is_not_finite_is_left_out_and_said_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("onnxruntime", reason="the autoencoder needs onnxruntime: the extra forecast")
    filler, shown = Autoencoder(), history(0)
    shown[20:, Joint.RWPS] = np.nan
    assert filler.fill(shown).by == "autoencoder"
    monkeypatch.setattr(Network, "run", lambda _self, values: np.full((len(values), 30, 45), np.nan))
    found = filler.fill(shown)
    assert found.by == "carry" and np.array_equal(found.joints, Carry().fill(shown).joints)


def test_the_autoencoder_knows_neither_place_nor_heading(rng: np.random.Generator) -> None:
    pytest.importorskip("onnxruntime", reason="the autoencoder needs onnxruntime: the extra forecast")
    filler = Autoencoder()
    for seed in range(10):
        shown = np.where(gaps(30, rng)[..., None], np.nan, history(seed))
        turn = Rotation.from_euler("z", rng.uniform(-4.0, 4.0)).as_matrix()
        way = rng.normal(size=3)
        found = filler.fill(shown @ turn.T + way).joints
        assert np.allclose(found, filler.fill(shown).joints @ turn.T + way, atol=1e-4)
