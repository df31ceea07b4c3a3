"""The shipped networks against plain NumPy; forecasts of points, and what becomes of bad input."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modes.forecasting.baselines import ConstantVelocity, Hold
from modes.forecasting.dataset import Windows, read_folder, windows_of
from modes.forecasting.errors import errors_by_horizon
from modes.forecasting.history import History
from modes.forecasting.model_card import CMU, read_card
from modes.forecasting.network import (
    DEFAULT,
    FORECASTERS,
    NETWORKS,
    Forecaster,
    NetworkForecaster,
    Outcome,
    forecast_points,
    load_forecaster,
)
from modes.forecasting.occlusion import Autoencoder, Carry
from modes.forecasting.skeleton import BONES, bones_of
from modes.forecasting.synthetic import person
from modes.forecasting.weights_file import SKELETON, WEIGHTS, Network
from modes.reaching_person import report_of
from occupancy.body import Point
from robots.errors import SetupError
from tests.modes.forecasting import onnx_numpy

pytest.importorskip("onnxruntime", reason="networks need onnxruntime: the extra forecast")

Array = NDArray[np.float64]


def points(frames: int = 30) -> Array:
    """Points (frames, 20, 3) of somebody whose hand goes on at 0.5 m/s."""
    hands = np.array([0.5, 0.1, 0.9]) + 0.05 * np.arange(frames)[:, None] * np.array([0.0, 1.0, 0.0])
    return np.stack([report_of(hand, 0.0, 0.0).people[0].xyz for hand in hands])


@dataclass(frozen=True)
class Broken:
    """Answers what it was told to."""

    answer: Array
    name: str = "broken"

    def forecast(self, history: Array) -> Array:
        assert np.isfinite(history).all()
        return self.answer


def test_unknown_names_and_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="forecaster = 'gru' should be one of hold, constant_velocity"):
        load_forecaster("gru")
    with pytest.raises(SetupError, match=r"bilstm\.onnx: no such file of weights"):
        load_forecaster("bilstm", tmp_path)
    (tmp_path / "bilstm.onnx").write_bytes(b"no network")
    with pytest.raises(SetupError, match=r"bilstm\.onnx: no network of ONNX") as refused:
        load_forecaster("bilstm", tmp_path)
    assert "\n" not in str(refused.value)


def test_weights_of_another_shape_or_skeleton_are_refused_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="weights of another shape: takes") as refused:
        NetworkForecaster("x", Network(WEIGHTS / "occlusion.onnx"))
    assert "\n" not in str(refused.value)
    with pytest.raises(SetupError, match="weights of another shape"):
        Autoencoder(Network(WEIGHTS / "dct_mlp.onnx"))
    bare = (WEIGHTS / "dct_mlp.onnx").read_bytes()
    assert bare.count(SKELETON.encode()) == 1
    (tmp_path / "dct_mlp.onnx").write_bytes(bare.replace(b"CLAV C7 LSHO", b"HEAD C7 LSHO"))
    with pytest.raises(SetupError, match="weights of another skeleton \\(HEAD C7"):
        load_forecaster("dct_mlp", tmp_path)


@pytest.mark.parametrize("name", FORECASTERS)
def test_other_skeletons_are_refused_in_a_line(name: str) -> None:
    forecaster = load_forecaster(name)
    with pytest.raises(SetupError, match=r"\(30, 14, 3\) should be \(frames, 15, 3\): CLAV") as refused:
        forecaster.forecast(np.zeros((30, 14, 3)))
    assert "\n" not in str(refused.value)
    if name in NETWORKS:
        with pytest.raises(SetupError, match="history of 29 frames should be 30"):
            forecaster.forecast(np.zeros((29, 15, 3)))


@pytest.mark.parametrize(
    ("name", "twin", "features"),
    [
        ("bilstm", onnx_numpy.bilstm, 45),
        ("dct_mlp", onnx_numpy.dct_mlp, 45),
        ("occlusion", onnx_numpy.occlusion, 60),
    ],
)
def test_shipped_weights_give_what_plain_numpy_gives(
    name: str, twin: Callable[[Array, onnx_numpy.Weights], Array], features: int, rng: np.random.Generator
) -> None:
    path = WEIGHTS / f"{name}.onnx"
    network, weights = Network(path), onnx_numpy.read_weights(path)
    x = rng.normal(0.0, 0.5, (4, 30, features))
    given = network.run(x)
    for k in range(len(x)):
        expected = twin(x[k], weights)
        assert given[k] == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())
        assert network.run(x[k : k + 1])[0] == pytest.approx(given[k], abs=1e-5)


@pytest.mark.parametrize("name", NETWORKS)
def test_networks_keep_bones_and_know_neither_place_nor_heading(name: str, rng: np.random.Generator) -> None:
    forecaster = load_forecaster(name)
    for seed in range(10):
        history = person(3.0, 10.0, seed)
        found = forecaster.forecast(history)
        assert found.shape == (10, 15, 3) and np.isfinite(found).all()
        _, length = bones_of(found)
        assert length == pytest.approx(np.broadcast_to(bones_of(history[-1])[1], (10, len(BONES))), abs=1e-9)
        turn, way = Rotation.from_euler("z", rng.uniform(-4.0, 4.0)).as_matrix(), rng.normal(size=3)
        assert forecaster.forecast(history @ turn.T + way) == pytest.approx(found @ turn.T + way, abs=2e-4)


@pytest.mark.parametrize("name", NETWORKS)
def test_of_whoever_stands_still_nothing_is_made_up(name: str) -> None:
    history = np.repeat(person(3.0, 10.0, 0)[:1], 30, axis=0)
    assert np.abs(load_forecaster(name).forecast(history) - history[:10]).max() < 0.005


def test_what_is_not_finite_is_held_and_said_to_be() -> None:
    history = points()
    for answer in (np.full((10, 15, 3), np.nan), np.full((10, 15, 3), np.inf), np.zeros((9, 15, 3))):
        found = forecast_points(history, Broken(answer))
        assert found.outcome is Outcome.HELD
        assert found.points == pytest.approx(np.repeat(history[-1:], 10, axis=0), abs=1e-9)
    assert forecast_points(history, Hold()).outcome is Outcome.FORECAST


def test_all_points_go_along_with_their_joints() -> None:
    """Whoever is moved as a whole at one velocity: every point is where it will be."""
    history = np.repeat(points(1), 30, axis=0) + 0.04 * np.arange(30)[:, None, None] * np.array(
        [1.0, -0.5, 0.0]
    )
    found = forecast_points(history, ConstantVelocity())
    step = 0.04 * np.arange(1, 11)[:, None, None] * np.array([1.0, -0.5, 0.0])
    assert found.outcome is Outcome.FORECAST and not found.inferred.any()
    assert found.now == pytest.approx(history[-1], abs=1e-9)
    assert found.points == pytest.approx(history[-1] + step, abs=1e-9)


@pytest.mark.parametrize("name", FORECASTERS)
def test_points_never_seen_stay_unknown_and_hidden_ones_are_inferred(name: str) -> None:
    history = points()
    legs = [Point.L_KNEE, Point.R_KNEE, Point.L_ANKLE, Point.R_ANKLE, Point.L_HIP, Point.R_HIP]
    history[:, [*legs, Point.L_FINGERTIP]] = np.nan
    history[20:, Point.R_WRIST] = np.nan
    for filler in (None, Carry(), Autoencoder()):
        found = forecast_points(history, load_forecaster(name), filler)
        assert found.outcome is Outcome.FORECAST and found.inferred.sum() == 7
        assert np.isnan(found.points[:, [*legs, Point.L_FINGERTIP]]).all()
        others = [point for point in Point if point not in (*legs, Point.L_FINGERTIP)]
        assert np.isfinite(found.points[:, others]).all() and np.isfinite(found.now[others]).all()
        reach = np.linalg.norm(found.points[:, Point.R_WRIST] - found.points[:, Point.R_ELBOW], axis=1)
        assert (reach < 0.6).all()


def test_without_a_trunk_there_is_no_forecast() -> None:
    for history in (np.full((30, 20, 3), np.nan), points()):
        history[:, Point.PELVIS] = np.nan
        found = forecast_points(history, load_forecaster(DEFAULT), Autoencoder())
        assert found.outcome is Outcome.NO_TRUNK and np.isnan(found.points).all()
    assert np.isfinite(found.now[Point.HEAD]).all()


def test_from_measurements_as_they_come_to_points_ahead(rng: np.random.Generator) -> None:
    """A hand that goes on at 0.5 m/s, seen at 30 Hz with jitter and drop-outs, is where it gets."""
    history, t = History(), 0.0
    still = points(1)[0]
    while t < 4.0:
        now = still + np.array([0.0, 0.5 * t, 0.0])
        if rng.random() < 0.2:
            now[int(rng.integers(20))] = np.nan
        history.add(t, now)
        t += float(rng.uniform(0.02, 0.045))
    end = still + np.array([0.0, 0.5 * history.newest, 0.0])
    found = forecast_points(history.points(), ConstantVelocity())
    ahead = end + 0.05 * np.arange(1, 11)[:, None, None] * np.array([0.0, 1.0, 0.0])
    seen = [point for point in Point if point not in (Point.HEAD, Point.THORAX)]
    assert found.points[:, seen] == pytest.approx(ahead[:, seen], abs=0.02)


def test_the_card_says_what_weights_are() -> None:
    card = read_card(WEIGHTS / "card.toml")
    assert card["acknowledgement"] == CMU
    assert card["subjects"] == ["cmu_02", "cmu_03"] and not any("GPL" in each for each in card["licences"])
    assert set(card["errors_mm"]) == set(FORECASTERS)
    assert sum(path.stat().st_size for path in WEIGHTS.glob("*.onnx")) < 3_000_000
    with pytest.raises(SetupError, match=r"absent\.toml: no card of weights"):
        read_card(WEIGHTS / "absent.toml")


@pytest.mark.real_data
def test_the_default_is_nearer_to_people_it_was_not_trained_on_than_constant_velocity(
    real_data: Path,
) -> None:
    card = read_card(WEIGHTS / "card.toml")
    groups: dict[str, list[Windows]] = {}
    for recording in read_folder(real_data, 15):
        if recording.subject not in card["subjects"]:
            groups.setdefault(recording.subject, []).append(windows_of(recording, 0.5))
    forecasters: list[Forecaster] = [load_forecaster(), ConstantVelocity()]
    assert len(groups) == 4
    for group, parts in groups.items():
        ours, plain = (errors_by_horizon(each, Windows.of(parts), (0.5, 1.0)) for each in forecasters)
        assert ours[1.0].mean < plain[1.0].mean, group
        assert ours[0.5].mean < 1.1 * plain[0.5].mean, group
    everybody = Windows.of(part for parts in groups.values() for part in parts)
    ours, plain = (errors_by_horizon(each, everybody, (0.5, 1.0)) for each in forecasters)
    for horizon in (0.5, 1.0):
        assert ours[horizon].mean < 0.9 * plain[horizon].mean, horizon
