"""Train the networks on recordings of people and made-up ones, and write them as ONNX, with their card.

    python -m modes.forecasting.training --recordings FOLDER --out FOLDER [--seed 0] [--epochs N]

Needs the extra ``train``. The same seed on the same machine gives the same weights; processors and versions of
torch differ in last digits, and so do weights. Subjects are split: nobody who is judged was trained on.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.dataset import (
    WAY_UNIT_M,
    Recording,
    Windows,
    canonical,
    faster,
    features,
    made_up,
    mirrored,
    read_folder,
    seen_from,
    split_by_subject,
    windows_of,
)
from modes.forecasting.errors import gaps
from modes.forecasting.occlusion import Carry, autoencoder_input
from modes.forecasting.skeleton import BONES, JOINTS, ROOT, Joint, bones_of
from modes.forecasting.synthetic import people
from modes.forecasting.torch_networks import NAMES, Sizes, TorchNetwork, make, torch_of
from modes.settings import require_count, require_number
from robots.errors import SetupError

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

TRAINED_ON = ("cmu_02", "cmu_03")
"""Subjects of the recordings that the shipped weights are trained on; all others are for judging."""
_LEGS = (Joint.LHIP, Joint.RHIP, Joint.LKNE, Joint.RKNE, Joint.LHEE, Joint.RHEE)


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """How it is trained.

    Attributes
    ----------
    seed:
        Of made-up people, of the weights at first, and of the order of windows.
    epochs:
        How often each window is seen.
    batch:
        Windows per step.
    rate:
        Step of AdamW at first; it falls to zero as a cosine.
    decay:
        Of weights.
    tempo:
        Recordings are played at these speeds.
    every_s:
        Windows end so often [s].
    people:
        How many are made up, 12 s each.
    noise_m:
        Standard deviation of what is added to joints that are seen [m], frame by frame.
    legless:
        Share of windows whose legs are stood in for, as of people behind tables.
    """

    seed: int = 0
    epochs: int = 12
    batch: int = 128
    rate: float = 2e-3
    decay: float = 0.02
    tempo: tuple[float, ...] = (0.6, 0.8, 1.0, 1.25)
    every_s: float = 0.05
    people: int = 120
    noise_m: float = 0.002
    legless: float = 0.2
    sizes: Sizes = field(default_factory=Sizes)

    def __post_init__(self) -> None:
        require_count("training: seed", self.seed, 0, 2**31)
        require_count("training: epochs", self.epochs, 1, 10_000)
        require_count("training: batch", self.batch, 1, 100_000)
        require_count("training: people", self.people, 0, 100_000)
        require_number("training: rate", self.rate, 0.0, 1.0, above=True)
        require_number("training: decay", self.decay, 0.0, 1.0)
        require_number("training: every_s", self.every_s, 0.01, 10.0)
        require_number("training: noise_m", self.noise_m, 0.0, 1.0)
        require_number("training: legless", self.legless, 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Windows looked at canonically, ``(n, 30, 15, 3)`` and ``(n, 10, 15, 3)`` [m]; ``(n, 15)`` to be judged."""

    history: Floats
    future: Floats
    judged: NDArray[np.bool_]


def training_windows(recordings: Sequence[Recording], settings: TrainingSettings) -> Windows:
    """Return windows of the recordings at all speeds, and of made-up people."""
    parts = [
        windows_of(faster(each, factor), settings.every_s, 0.5) for each in recordings for factor in settings.tempo
    ]
    parts += [windows_of(each, 0.2, 0.5) for each in made_up(people(settings.people, 12.0, 10.0, settings.seed), 10.0)]
    return Windows.of(parts)


def samples_of(windows: Windows, settings: TrainingSettings) -> Samples:
    """Return windows as they are trained on; some with legs that are stood in for."""
    rng, filler = np.random.default_rng(settings.seed), Carry()
    history = windows.history.copy()
    legless = rng.random(len(windows)) < settings.legless
    for k in np.flatnonzero(legless):
        history[k][:, _LEGS] = np.nan
        history[k] = filler.fill(history[k]).joints
    origin, turn = canonical(history)
    judged = np.ones((len(windows), JOINTS), dtype=bool)
    judged[np.ix_(legless, _LEGS)] = False
    return Samples(
        seen_from(history, origin, turn).astype(np.float32),
        seen_from(windows.future, origin, turn).astype(np.float32),
        judged,
    )


def train_forecaster(name: str, samples: Samples, settings: TrainingSettings) -> TorchNetwork:
    """Return ``bilstm`` or ``dct_mlp`` trained to be near to joints in the mean, and to their steps.

    The loss is the mean distance of joints, plus that of their steps from frame to frame.
    """
    torch = torch_of()
    network = _fresh(torch, name, settings)

    def loss_of(rows: NDArray[np.int64], rng: np.random.Generator) -> Any:
        history, future = _augmented(samples, rows, rng, settings)
        found = _decoded(torch, network.forward(_tensor(torch, features(history))), history)
        truth, judged = _tensor(torch, future), _tensor(torch, samples.judged[rows])[:, None]
        far = (torch.linalg.vector_norm(found - truth, dim=3) * judged).mean()
        steps = torch.linalg.vector_norm(torch.diff(found - truth, dim=1), dim=3)
        return far + (steps * judged).mean()

    _fit(torch, network, loss_of, len(samples.history), settings)
    return network


def train_occlusion(samples: Samples, settings: TrainingSettings) -> TorchNetwork:
    """Return the autoencoder trained to correct what was carried along where something is hidden."""
    torch = torch_of()
    network, filler = _fresh(torch, "occlusion", settings), Carry()
    whole = np.flatnonzero(samples.judged.all(axis=1))

    def loss_of(rows: NDArray[np.int64], rng: np.random.Generator) -> Any:
        history, _ = _augmented(samples, whole[rows], rng, settings)
        hidden = np.stack([gaps(history.shape[1], rng) for _ in rows])
        if rng.random() < settings.legless:
            hidden[:, :, _LEGS] = True
        base = np.stack([filler.fill(np.where(h[..., None], np.nan, x)).joints for h, x in zip(hidden, history, strict=True)])
        origin, turn = canonical(base)
        looked, truth = seen_from(base, origin, turn), seen_from(history, origin, turn)
        added = network.forward(_tensor(torch, autoencoder_input(looked, ~hidden)))
        found = _tensor(torch, looked) + added.reshape(looked.shape)
        far = torch.linalg.vector_norm(found - _tensor(torch, truth), dim=3)
        weight = _tensor(torch, hidden) * torch.linspace(0.5, 1.5, hidden.shape[1])[None, :, None]
        return (far * weight).sum() / weight.sum().clamp(min=1.0)

    _fit(torch, network, loss_of, len(whole), settings)
    return network


def _fresh(torch: Any, name: str, settings: TrainingSettings) -> TorchNetwork:
    torch.manual_seed(settings.seed)
    torch.use_deterministic_algorithms(True)
    torch.set_num_threads(1)  # sums of several threads differ in last digits
    return make(name, settings.sizes)


def _fit(torch: Any, network: TorchNetwork, loss_of: Any, count: int, settings: TrainingSettings) -> None:
    """Train on all rows, ``epochs`` times, in another order each."""
    rng = np.random.default_rng(settings.seed)
    optimiser = torch.optim.AdamW(network.layers.parameters(), lr=settings.rate, weight_decay=settings.decay)
    steps = settings.epochs * -(-count // settings.batch)
    falling = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    network.layers.train()
    for epoch in range(settings.epochs):
        began, total, order = time.monotonic(), 0.0, rng.permutation(count)
        for begin in range(0, count, settings.batch):
            loss = loss_of(order[begin : begin + settings.batch], rng)
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.layers.parameters(), 1.0)
            optimiser.step()
            falling.step()
            total += float(loss.detach()) * len(order[begin : begin + settings.batch])
        _say(f"{network.name}: epoch {epoch + 1}, loss {1e3 * total / count:.1f} mm, {time.monotonic() - began:.0f} s")
    network.layers.eval()


def _augmented(
    samples: Samples, rows: NDArray[np.int64], rng: np.random.Generator, settings: TrainingSettings
) -> tuple[Array, Array]:
    """Return windows, half of them mirrored, with a little noise on what was seen, looked at canonically again."""
    history, future = samples.history[rows].astype(float), samples.future[rows].astype(float)
    flip = (rng.random(len(rows)) < 0.5)[:, None, None, None]
    history = np.where(flip, mirrored(history), history)
    future = np.where(flip, mirrored(future), future)
    history = history + rng.normal(0.0, settings.noise_m, history.shape)
    origin, turn = canonical(history)
    return seen_from(history, origin, turn), seen_from(future, origin, turn)


def _decoded(torch: Any, values: Any, history: Array) -> Any:
    """Return joints ``(n, 10, 15, 3)`` of features; :func:`modes.forecasting.dataset.joints_of_features` in torch."""
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


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")


def train_all(recordings: Sequence[Recording], settings: TrainingSettings) -> dict[str, TorchNetwork]:
    """Return all networks by name, trained on these recordings."""
    samples = samples_of(training_windows(recordings, settings), settings)
    _say(f"{len(samples.history)} windows")
    found = {name: train_forecaster(name, samples, settings) for name in NAMES if name != "occlusion"}
    return {**found, "occlusion": train_occlusion(samples, settings)}
