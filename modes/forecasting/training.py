"""Train the networks on recordings of people and made-up ones, and write them as ONNX, with their card.

    python -m modes.forecasting.training --recordings FOLDER --out FOLDER [--seed 0] [--epochs N]

Needs the extras ``train`` and ``forecast``. The same seed on the same machine gives the same weights;
processors and versions of torch differ in last digits, and so do weights. Subjects are split: nobody who is
judged was trained on.
"""

from __future__ import annotations

import argparse
import logging
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.dataset import (
    WAY_UNIT_M,
    Recording,
    Windows,
    canonical,
    features,
    read_folder,
    seen_from,
    split_by_subject,
    windows_of,
)
from modes.forecasting.errors import errors_by_horizon, gaps
from modes.forecasting.model_card import CMU, Judged, card_text
from modes.forecasting.network import FORECASTERS, load_forecaster
from modes.forecasting.occlusion import autoencoder_input, carried_joints
from modes.forecasting.onnx_export import write_onnx
from modes.forecasting.skeleton import BONES, ROOT, Joint, bones_of
from modes.forecasting.torch_networks import NAMES, TorchNetwork, make, torch_of
from modes.forecasting.training_samples import (
    LEGS,
    Samples,
    TrainingSettings,
    augmented,
    samples_of,
    training_windows,
)
from robots.errors import SetupError

Array = NDArray[np.float64]

_LOG = logging.getLogger(__name__)

TRAINED_ON = ("cmu_02", "cmu_03")
"""Subjects of the recordings that the shipped weights are trained on; all others are for judging."""
_RECENT, _QUIET_M = 11, 0.1


def train_forecaster(name: str, samples: Samples, settings: TrainingSettings) -> TorchNetwork:
    """Return ``bilstm`` or ``dct_mlp`` trained to be near to joints in the mean, and to their steps.

    The loss is the mean distance of joints, plus that of their steps from frame to frame, over how far the
    person's joints moved in the last second, plus 0.1 m: else those who hardly move would hardly count.
    """
    torch = torch_of()
    network = _fresh(torch, name, settings)

    def loss_of(rows: NDArray[np.int64], rng: np.random.Generator) -> Any:
        history, future = augmented(samples, rows, rng, settings)
        found = _decoded(torch, network.forward(_tensor(torch, features(history))), history)
        truth, judged = _tensor(torch, future), _tensor(torch, samples.judged[rows])[:, None]
        recent = np.linalg.norm(np.diff(history[:, -_RECENT:], axis=1), axis=3).sum(axis=1).mean(axis=1)
        judged = judged * _tensor(torch, 1.0 / (_QUIET_M + recent))[:, None, None]
        far = (torch.linalg.vector_norm(found - truth, dim=3) * judged).mean()
        steps = torch.linalg.vector_norm(torch.diff(found - truth, dim=1), dim=3)
        return far + (steps * judged).mean()

    _fit(torch, network, loss_of, len(samples.history), settings.epochs, settings)
    return network


def train_occlusion(samples: Samples, settings: TrainingSettings) -> TorchNetwork:
    """Return the autoencoder trained to correct what was carried along where something is hidden."""
    torch = torch_of()
    network = _fresh(torch, "occlusion", settings)
    whole = np.flatnonzero(samples.judged.all(axis=1))

    def loss_of(rows: NDArray[np.int64], rng: np.random.Generator) -> Any:
        history, _ = augmented(samples, whole[rows], rng, settings)
        hidden = np.stack([gaps(history.shape[1], rng) for _ in rows])
        if rng.random() < settings.legless:
            hidden[:, :, LEGS] = True
        base = carried_joints(np.where(hidden[..., None], np.nan, history))
        origin, turn = canonical(base)
        looked, truth = seen_from(base, origin, turn), seen_from(history, origin, turn)
        added = network.forward(_tensor(torch, autoencoder_input(looked, ~hidden)))
        found = _tensor(torch, looked) + added.reshape(looked.shape)
        far = torch.linalg.vector_norm(found - _tensor(torch, truth), dim=3)
        weight = _tensor(torch, hidden) * torch.linspace(0.5, 1.5, hidden.shape[1])[None, :, None]
        return (far * weight).sum() / weight.sum().clamp(min=1.0)

    _fit(torch, network, loss_of, len(whole), settings.occlusion_epochs, settings)
    return network


def _fresh(torch: Any, name: str, settings: TrainingSettings) -> TorchNetwork:
    torch.manual_seed(settings.seed)
    torch.use_deterministic_algorithms(True)
    torch.set_num_threads(1)  # sums of several threads differ in last digits
    return make(name, settings.sizes)


def _fit(
    torch: Any, network: TorchNetwork, loss_of: Any, count: int, epochs: int, settings: TrainingSettings
) -> None:
    """Train on all rows, ``epochs`` times, in another order each."""
    rng = np.random.default_rng(settings.seed)
    optimiser = torch.optim.AdamW(network.layers.parameters(), lr=settings.rate, weight_decay=settings.decay)
    steps = epochs * -(-count // settings.batch)
    falling = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    network.layers.train()
    for epoch in range(epochs):
        began, total, order = time.monotonic(), 0.0, rng.permutation(count)
        for begin in range(0, count, settings.batch):
            loss = loss_of(order[begin : begin + settings.batch], rng)
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.layers.parameters(), 1.0)
            optimiser.step()
            falling.step()
            total += float(loss.detach()) * len(order[begin : begin + settings.batch])
        _LOG.info(
            f"{network.name}: epoch {epoch + 1}, loss {total / count:.4f}, {time.monotonic() - began:.0f} s"
        )
    network.layers.eval()


def _decoded(torch: Any, values: Any, history: Array) -> Any:
    """Return joints ``(n, 10, 15, 3)`` of features; ``joints_of_features`` of the dataset, in torch."""
    _, length = bones_of(history[:, -1])
    unit = values[..., :-3].reshape(*values.shape[:-1], len(BONES), 3)
    unit = unit / torch.linalg.vector_norm(unit, dim=-1, keepdim=True).clamp(min=1e-6)
    bones = unit * _tensor(torch, length)[:, None, :, None]
    start = _tensor(torch, history[:, -1, ROOT])
    places = {ROOT: start[:, None] + WAY_UNIT_M * torch.cumsum(values[..., -3:], dim=1)}
    for k, (begin, end) in enumerate(BONES):
        places[end] = places[begin] + bones[:, :, k]
    return torch.stack([places[joint] for joint in Joint], dim=2)


def _tensor(torch: Any, values: NDArray[Any]) -> Any:
    return torch.as_tensor(np.ascontiguousarray(values), dtype=torch.float32)


def train_all(windows: Windows, settings: TrainingSettings) -> dict[str, TorchNetwork]:
    """Return all networks by name, trained on these windows."""
    samples = samples_of(windows, settings)
    _LOG.info(f"{len(samples.history)} windows")
    found = {name: train_forecaster(name, samples, settings) for name in NAMES if name != "occlusion"}
    return {**found, "occlusion": train_occlusion(samples, settings)}


def judge(recordings: Sequence[Recording], folder: Path) -> Judged:
    """Return the errors of all forecasters by subject, networks from ``folder``.

    Raises
    ------
    SetupError
        onnxruntime is missing.
    """
    groups: dict[str, list[Windows]] = {}
    for each in recordings:
        groups.setdefault(each.subject, []).append(windows_of(each))
    forecasters = [load_forecaster(name, folder) for name in FORECASTERS]
    return {
        each.name: {group: errors_by_horizon(each, Windows.of(parts)) for group, parts in groups.items()}
        for each in forecasters
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Train, write weights and card, and say how it goes on standard error."""
    parser = argparse.ArgumentParser(prog="python -m modes.forecasting.training")
    parser.add_argument(
        "--recordings", type=Path, required=True, help="folder with recordings of people, NPZ"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for weights and their card")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--epochs", type=int, default=TrainingSettings().epochs)
    parser.add_argument("--subjects", nargs="+", default=list(TRAINED_ON), help="who is trained on")
    options = parser.parse_args(arguments)
    logging.basicConfig(stream=sys.stderr, format="%(message)s", level=logging.INFO)
    settings = TrainingSettings(seed=options.seed, epochs=options.epochs)
    trained, others = split_by_subject(read_folder(options.recordings), options.subjects)
    windows = training_windows(trained, settings)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, network in train_all(windows, settings).items():
        described = {"seed": str(settings.seed), "made_by": "modes/forecasting/training.py", "cmu": CMU}
        write_onnx(network, settings.sizes, options.out / f"{name}.onnx", described)
    subjects = "" if options.subjects == list(TRAINED_ON) else f" --subjects {' '.join(options.subjects)}"
    command = (
        "python -m modes.forecasting.training --recordings FOLDER --out FOLDER "
        f"--seed {settings.seed} --epochs {settings.epochs}{subjects}"
    )
    text = card_text(
        command, settings.seed, settings.epochs, trained, len(windows), judge(others, options.out),
        ", ".join(f"{name} {version(name)}" for name in ("torch", "onnx", "numpy")),
    )  # fmt: skip
    (options.out / "card.toml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    try:
        main()
    except SetupError as error:
        sys.exit(f"error: {error}")
