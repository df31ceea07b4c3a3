"""What networks are trained on: windows of recordings and of made-up people, mirrored, in other postures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modes.forecasting.dataset import (
    SEEN,
    Recording,
    Windows,
    canonical,
    faster,
    made_up,
    mirrored,
    seen_from,
    windows_of,
)
from modes.forecasting.occlusion import carried_joints
from modes.forecasting.skeleton import BONES, JOINTS, ROOT, Joint, bones_of, joints_of_bones
from modes.forecasting.synthetic import people
from modes.forecasting.torch_networks import Sizes
from modes.settings import require_count, require_number

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

LEGS = (Joint.LHIP, Joint.RHIP, Joint.LKNE, Joint.RKNE, Joint.LHEE, Joint.RHEE)
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
    for joint in LEGS:
        history[legless, :, joint] = np.nan
    history = carried_joints(history)
    origin, turn = canonical(history)
    judged = np.ones((len(windows), JOINTS), dtype=bool)
    for joint in LEGS:
        judged[legless, joint] = False
    return Samples(
        seen_from(history, origin, turn).astype(np.float32),
        seen_from(windows.future, origin, turn).astype(np.float32),
        judged,
    )


def augmented(
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
