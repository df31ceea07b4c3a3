"""Train the networks on recordings of people and made-up ones, and write them as ONNX, with their card.

    python -m modes.forecasting.training --recordings FOLDER --out FOLDER [--seed 0] [--epochs N]

Needs the extras ``train`` and ``forecast``. The same seed on the same machine gives the same
weights; processors and versions of torch differ in last digits, and so do weights. Subjects are split: nobody
who is judged was trained on.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modes.forecasting.dataset import (
    SEEN,
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
from modes.forecasting.errors import errors_by_horizon, gaps
from modes.forecasting.model_card import CMU, Judged, card_text
from modes.forecasting.network import FORECASTERS, load_forecaster
from modes.forecasting.occlusion import autoencoder_input, carried_joints
from modes.forecasting.onnx_export import write_onnx
from modes.forecasting.skeleton import BONES, JOINTS, ROOT, Joint, bones_of, joints_of_bones
from modes.forecasting.synthetic import people
from modes.forecasting.torch_networks import NAMES, Sizes, TorchNetwork, make, torch_of
from modes.settings import require_count, require_number
from robots.errors import SetupError

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

TRAINED_ON = ("cmu_02", "cmu_03")
"""Subjects of the recordings that the shipped weights are trained on; all others are for judging."""
_RECENT, _QUIET_M = 11, 0.1
_LEGS = (Joint.LHIP, Joint.RHIP, Joint.LKNE, Joint.RKNE, Joint.LHEE, Joint.RHEE)
_LIMBS = tuple(
    [k for k, (_begin, end) in enumerate(BONES) if end in ends]
    for ends in (
        (Joint.LAEL, Joint.LWPS), (Joint.RAEL, Joint.RWPS), (Joint.LWPS,), (Joint.RWPS,),
        (Joint.LKNE, Joint.LHEE), (Joint.RKNE, Joint.RHEE),
    )
)  # fmt: skip
"""Bones that are turned together."""


@dataclass(frozen=True, slots=True)
class TrainingSettings:
    """How it is trained.

    Attributes
    ----------
    seed:
        Of made-up people, of the weights at first, and of the order of windows.
    epochs, occlusion_epochs:
        How often each window is seen, by forecasters and by the autoencoder.
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
    posture_rad:
        Standard deviation of the rotation vector that each limb is turned by [rad].
    least_extent:
        Windows move to this extent at least of what they did.
    legless:
        Share of windows whose legs are stood in for, as of people behind tables.
    """

    seed: int = 0
    epochs: int = 8
    occlusion_epochs: int = 30
    batch: int = 128
    rate: float = 2e-3
    decay: float = 0.02
    tempo: tuple[float, ...] = (0.8, 1.0, 1.25)
    every_s: float = 0.1
    people: int = 120
    noise_m: float = 0.002
    posture_rad: float = 0.3
    least_extent: float = 0.1
    legless: float = 0.2
    sizes: Sizes = field(default_factory=Sizes)

    def __post_init__(self) -> None:
        require_count("training: seed", self.seed, 0, 2**31)
        require_count("training: epochs", self.epochs, 1, 10_000)
        require_count("training: occlusion_epochs", self.occlusion_epochs, 1, 10_000)
        require_count("training: batch", self.batch, 1, 100_000)
        require_count("training: people", self.people, 0, 100_000)
        require_number("training: rate", self.rate, 0.0, 1.0, above=True)
        require_number("training: decay", self.decay, 0.0, 1.0)
        require_number("training: every_s", self.every_s, 0.01, 10.0)
        require_number("training: noise_m", self.noise_m, 0.0, 1.0)
        require_number("training: posture_rad", self.posture_rad, 0.0, 3.0)
        require_number("training: least_extent", self.least_extent, 0.0, 1.0)
        require_number("training: legless", self.legless, 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Windows seen canonically, ``(n, 30, 15, 3)`` and ``(n, 10, 15, 3)`` [m]; ``(n, 15)`` to be judged."""

    history: Floats
    future: Floats
    judged: NDArray[np.bool_]


def training_windows(recordings: Sequence[Recording], settings: TrainingSettings) -> Windows:
    """Return windows of the recordings at all speeds, and of made-up people."""
    parts = [
        windows_of(faster(each, factor), settings.every_s, 0.5)
        for each in recordings
        for factor in settings.tempo
    ]
    parts += [
        windows_of(each, 0.2, 0.5)
        for each in made_up(people(settings.people, 12.0, 10.0, settings.seed), 10.0)
    ]
    return Windows.of(parts)


def samples_of(windows: Windows, settings: TrainingSettings) -> Samples:
    """Return windows as they are trained on; some with legs that are stood in for."""
    rng = np.random.default_rng(settings.seed)
    history = windows.history.copy()
    legless = rng.random(len(windows)) < settings.legless
    for joint in _LEGS:
        history[legless, :, joint] = np.nan
    history = carried_joints(history)
    origin, turn = canonical(history)
    judged = np.ones((len(windows), JOINTS), dtype=bool)
    for joint in _LEGS:
        judged[legless, joint] = False
    return Samples(
        seen_from(history, origin, turn).astype(np.float32),
        seen_from(windows.future, origin, turn).astype(np.float32),
        judged,
    )


def train_forecaster(name: str, samples: Samples, settings: TrainingSettings) -> TorchNetwork:
    """Return ``bilstm`` or ``dct_mlp`` trained to be near to joints in the mean, and to their steps.

    The loss is the mean distance of joints, plus that of their steps from frame to frame, over how far the
    person's joints moved in the last second, plus 0.1 m: else those who hardly move would hardly count.
    """
    torch = torch_of()
    network = _fresh(torch, name, settings)

    def loss_of(rows: NDArray[np.int64], rng: np.random.Generator) -> Any:
        history, future = _augmented(samples, rows, rng, settings)
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
        history, _ = _augmented(samples, whole[rows], rng, settings)
        hidden = np.stack([gaps(history.shape[1], rng) for _ in rows])
        if rng.random() < settings.legless:
            hidden[:, :, _LEGS] = True
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
        _say(f"{network.name}: epoch {epoch + 1}, loss {total / count:.4f}, {time.monotonic() - began:.0f} s")
    network.layers.eval()


def _augmented(
    samples: Samples, rows: NDArray[np.int64], rng: np.random.Generator, settings: TrainingSettings
) -> tuple[Array, Array]:
    """Return windows, half of them mirrored, in other postures and to another extent, with a little noise."""
    both = np.concatenate((samples.history[rows], samples.future[rows]), axis=1).astype(float)
    flip = (rng.random(len(rows)) < 0.5)[:, None, None, None]
    both = in_other_postures(np.where(flip, mirrored(both), both), rng, settings)
    history, future = both[:, :SEEN], both[:, SEEN:]
    history = history + rng.normal(0.0, settings.noise_m, history.shape)
    origin, turn = canonical(history)
    return seen_from(history, origin, turn), seen_from(future, origin, turn)


def in_other_postures(joints: Array, rng: np.random.Generator, settings: TrainingSettings) -> Array:
    """Return windows ``(n, 40, 15, 3)`` [m] whose limbs are turned by one rotation each, and which move less.

    Two subjects take few postures: a network would know motions by the posture they were made in.
    """
    unit, length = bones_of(joints)
    root = joints[:, :, ROOT]
    extent = rng.uniform(settings.least_extent, 1.0, (len(joints), 1, 1))
    now = SEEN - 1
    root = root[:, now : now + 1] + extent * (root - root[:, now : now + 1])
    unit = unit[:, now : now + 1] + extent[..., None] * (unit - unit[:, now : now + 1])
    for limb in _LIMBS:
        turn = Rotation.from_rotvec(rng.normal(0.0, settings.posture_rad, (len(joints), 3))).as_matrix()
        unit[:, :, limb] = unit[:, :, limb] @ np.swapaxes(turn, 1, 2)[:, None]
    return joints_of_bones(root, unit, length)


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


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")


def train_all(windows: Windows, settings: TrainingSettings) -> dict[str, TorchNetwork]:
    """Return all networks by name, trained on these windows."""
    samples = samples_of(windows, settings)
    _say(f"{len(samples.history)} windows")
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
