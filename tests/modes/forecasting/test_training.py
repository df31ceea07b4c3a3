"""Training in small: the same seed gives the same weights, ONNX files are the networks, bones are kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from modes.forecasting import training
from modes.forecasting.dataset import Recording, canonical, joints_of_features, seen_from
from modes.forecasting.skeleton import ROOT, bones_of
from modes.forecasting.synthetic import PersonSettings, person
from modes.forecasting.torch_networks import NAMES, Sizes, continuation, cosines, liveliness, make
from modes.forecasting.training_samples import (
    TrainingSettings,
    in_other_postures,
    samples_of,
    training_windows,
)
from modes.forecasting.weights_file import Network
from robots.errors import SetupError

SMALL = TrainingSettings(
    epochs=1,
    occlusion_epochs=1,
    people=2,
    every_s=0.5,
    tempo=(1.0,),
    sizes=Sizes(channels=8, hidden=8, width=8, blocks=1, coded=4),
)


@pytest.mark.parametrize(
    ("setting", "value"),
    [("epochs", 0), ("rate", 0.0), ("batch", 1.5), ("legless", 2.0), ("noise_m", float("nan")), ("seed", -1)],
)
def test_settings_out_of_range_are_refused(setting: str, value: float) -> None:
    with pytest.raises(SetupError, match=f"training: {setting} = "):
        TrainingSettings(**{setting: value})  # type: ignore[arg-type]  # wrong on purpose


def test_the_cosine_transform_is_orthonormal_and_the_slowest_rows_come_first() -> None:
    from scipy.fft import dct

    assert cosines() @ cosines().T == pytest.approx(np.eye(30), abs=1e-12)
    x = np.random.default_rng(0).normal(size=30)
    assert cosines(10) @ x == pytest.approx(dct(x, norm="ortho")[:10], abs=1e-12)


def test_the_continuation_slows_down_and_whoever_stands_is_not_lively() -> None:
    """Of a direction that turns by 1 a frame: e-fold in 0.3 s, so 3 (1 - exp(-k / 3)) after k frames."""
    x = np.arange(30.0)
    k = np.arange(1, 11)
    assert continuation()[0] @ x == pytest.approx(29.0 + 3.0 * (1.0 - np.exp(-k / 3.0)))
    way = np.cumsum(continuation()[1] @ np.ones(30))
    assert way == pytest.approx(3.0 * (1.0 - np.exp(-k / 3.0)))
    assert liveliness()[0] @ np.full(30, 7.0) == pytest.approx(np.zeros(10))
    assert liveliness()[0] @ (0.05 * x) == pytest.approx(np.ones(10))
    assert liveliness()[1] @ np.full(30, 0.5) == pytest.approx(np.ones(10))


def test_other_postures_keep_bones_and_begin_where_one_is(rng: np.random.Generator) -> None:
    joints = np.stack([person(4.0, 10.0, seed, PersonSettings(still=0.0)) for seed in range(12)])
    found = in_other_postures(joints, rng, TrainingSettings(posture_rad=0.5))
    assert bones_of(found)[1] == pytest.approx(bones_of(joints)[1], abs=1e-9)
    assert found[:, 29, ROOT] == pytest.approx(joints[:, 29, ROOT])
    assert np.abs(found - joints).max() > 0.05
    way, was = (each[:, :, ROOT] - each[:, 29:30, ROOT] for each in (found, joints))
    extent = (way * was).sum(axis=(1, 2)) / np.maximum((was**2).sum(axis=(1, 2)), 1e-12)
    extent = np.where(extent == 0.0, 1.0, extent)
    assert way == pytest.approx(extent[:, None, None] * was, abs=1e-9)
    assert (extent >= 0.1).all() and (extent <= 1.0).all() and np.ptp(extent) > 0.1
    same = in_other_postures(joints, rng, TrainingSettings(posture_rad=0.0, least_extent=1.0))
    assert same == pytest.approx(joints, abs=1e-9)


def test_legs_that_are_stood_in_for_are_not_judged() -> None:
    windows = training_windows([], SMALL)
    samples = samples_of(windows, TrainingSettings(legless=0.5))
    legless = ~samples.judged.all(axis=1)
    assert 0.2 < legless.mean() < 0.8 and (~samples.judged).sum() == 6 * legless.sum()
    truth = seen_from(windows.history, *canonical(windows.history))
    assert samples.history[~legless] == pytest.approx(truth[~legless], abs=1e-5)
    assert np.isfinite(samples.history).all()


def test_joints_in_torch_are_those_in_numpy(rng: np.random.Generator) -> None:
    torch = pytest.importorskip("torch", reason="training needs torch: the extra train")
    history, values = rng.normal(size=(4, 30, 15, 3)), rng.normal(size=(4, 10, 45))
    found = training._decoded(torch, torch.as_tensor(values, dtype=torch.float32), history).numpy()
    expected = joints_of_features(values, history[:, -1, ROOT], bones_of(history[:, -1])[1])
    assert found == pytest.approx(expected, abs=1e-4)


def test_onnx_files_give_what_torch_gives(tmp_path: Path, rng: np.random.Generator) -> None:
    torch = pytest.importorskip("torch", reason="training needs torch: the extra train")
    pytest.importorskip("onnx", reason="weights are written by onnx: the extra train")
    from modes.forecasting.onnx_export import write_onnx

    for name in NAMES:
        network = make(name, Sizes(kernel=5, layers=3, blocks=2))
        for each in network.layers.parameters():
            each.data = torch.as_tensor(rng.normal(0.0, 0.1, each.shape), dtype=torch.float32)
        network.layers.eval()
        write_onnx(network, Sizes(kernel=5, layers=3, blocks=2), tmp_path / f"{name}.onnx", {"seed": "0"})
        x = rng.normal(size=(3, 30, 60 if name == "occlusion" else 45))
        with torch.no_grad():
            expected = network.forward(torch.as_tensor(x, dtype=torch.float32)).numpy()
        assert Network(tmp_path / f"{name}.onnx").run(x) == pytest.approx(expected, abs=1e-4)


def test_the_same_seed_gives_the_same_weights() -> None:
    pytest.importorskip("torch", reason="training needs torch: the extra train")
    joints = person(6.0, 30.0, 1)
    windows = training_windows(
        [Recording("a_b", "a_b", "made up", np.arange(len(joints)) / 30.0, joints)], SMALL
    )
    first, again = (training.train_all(windows, SMALL) for _ in range(2))
    other = training.train_all(windows, replace(SMALL, seed=1))
    for name in NAMES:
        states = [each[name].layers.state_dict() for each in (first, again, other)]
        assert all((states[0][key] == states[1][key]).all() for key in states[0])
        assert any((states[0][key] != states[2][key]).any() for key in states[0])
