"""The networks as they are trained, in torch (extra ``train``): sizes are ours, the paper gives none.

``bilstm``: the paper's convolution and stacked bidirectional LSTMs. ``dct_mlp``: the frames' discrete cosine
transform and layers that mix frames, after W. Guo et al., *Back to MLP*, WACV 2023; all bones share them, so
that nothing is known by the posture or the person. Both add to a damped continuation of the last step, in
proportion to how much the person, or the bone, moved in the last second: of who stands still, nothing is made
up. ``occlusion``: an autoencoder of the slowest cosines of a window. Every network ends in a layer of zeros
before it is trained.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.baselines import DampedVelocity
from modes.forecasting.dataset import AHEAD, FEATURES, SEEN, WAY_UNIT_M
from modes.forecasting.skeleton import JOINTS
from modes.settings import require_count, require_number
from robots.errors import SetupError

Array = NDArray[np.float64]

_RECENT, _LIVELY = 10, 0.05
_CORRECTION_M = 0.05
"""What the autoencoder gives is in this unit."""
LEAST_MOTION = 1e-6
"""Is added to the mean square of motion."""

NAMES = ("bilstm", "dct_mlp", "occlusion")


@dataclass(frozen=True, slots=True)
class Sizes:
    """How large networks are.

    Attributes
    ----------
    channels, kernel, hidden, layers:
        Of ``bilstm``: features after the convolution, its frames, cells per direction, LSTMs on each other.
    width, blocks:
        Of ``dct_mlp``: numbers within, and layers.
    cosines, coded:
        Of ``occlusion``: cosines that are kept of a window, and numbers at its narrowest.
    dropout:
        Share of features that are left out in training, of ``bilstm`` and ``occlusion``.
    """

    channels: int = 64
    kernel: int = 3
    hidden: int = 64
    layers: int = 2
    width: int = 64
    blocks: int = 2
    cosines: int = 10
    coded: int = 48
    dropout: float = 0.1

    def __post_init__(self) -> None:
        for name in ("channels", "kernel", "hidden", "layers", "width", "blocks", "coded"):
            require_count(f"networks: {name}", getattr(self, name), 1, 4096)
        require_count("networks: cosines", self.cosines, 1, SEEN)
        require_number("networks: dropout", self.dropout, 0.0, 0.9)


@dataclass(frozen=True, slots=True)
class TorchNetwork:
    """Layers by their names, and what is done with them.

    Attributes
    ----------
    layers:
        A ``torch.nn.ModuleDict``.
    constants:
        Matrices that are not trained, by name.
    forward:
        From a tensor ``(n, frames, features)`` to one.
    """

    name: str
    layers: Any
    constants: dict[str, Array]
    forward: Callable[[Any], Any]


def torch_of() -> Any:
    """Return torch.

    Raises
    ------
    SetupError
        It is missing.
    """
    try:
        import torch
    except ImportError as error:
        raise SetupError("training needs torch and onnx: pip install 'stopproof[train]'") from error
    return torch


def cosines(count: int = SEEN) -> Array:
    """Return the slowest rows ``(count, 30)`` of the orthonormal discrete cosine transform (II)."""
    k, n = np.arange(SEEN)[:, None], np.arange(SEEN)
    rows = np.sqrt(2.0 / SEEN) * np.cos(np.pi * k * (2 * n + 1) / (2 * SEEN))
    rows[0] /= np.sqrt(2.0)
    return np.asarray(rows[:count])


def continuation() -> Array:
    """Return how a damped continuation follows from features of a window.

    ``(2, 10, 30)``, for bones and way: directions of bones go on as joints do in
    :class:`DampedVelocity`, ways shrink.
    """
    reach = DampedVelocity().reach()
    out = np.zeros((2, AHEAD, SEEN))
    out[0, :, -1], out[0, :, -2] = 1.0 + reach, -reach
    out[1, :, -1] = np.diff(reach, prepend=0.0)
    return out


def liveliness() -> Array:
    """Return what of features of a window is motion in the last second.

    ``(2, 10, 30)``, for bones and way, in units of 0.05 rad and 0.05 m per frame.
    """
    out = np.zeros((2, _RECENT, SEEN))
    rows, last = np.arange(_RECENT), np.arange(SEEN - _RECENT, SEEN)
    out[0, rows, last], out[0, rows, last - 1] = 1.0 / _LIVELY, -1.0 / _LIVELY
    out[1, rows, last] = WAY_UNIT_M / _LIVELY
    return out


def constants() -> dict[str, Array]:
    """Return the matrices that both forecasters have, and train not."""
    base, motion = continuation(), liveliness()
    return {"base_bones": base[0], "base_way": base[1], "motion_bones": motion[0], "motion_way": motion[1]}


def bilstm(sizes: Sizes) -> TorchNetwork:
    """Return the paper's network: convolution, then stacked bidirectional LSTMs."""
    torch = torch_of()
    nn = torch.nn
    layers = nn.ModuleDict({"conv": nn.Conv1d(FEATURES, sizes.channels, sizes.kernel, padding="same")})
    width = sizes.channels
    for k in range(sizes.layers):
        layers[f"lstm{k}"] = nn.LSTM(width, sizes.hidden, batch_first=True, bidirectional=True)
        width = 2 * sizes.hidden
    layers["out"] = _of_zeros(nn.Linear(width, AHEAD * FEATURES))
    drop, fixed = nn.Dropout(sizes.dropout), _fixed(torch, constants())
    layers["drop"] = drop

    def forward(x: Any) -> Any:
        y = torch.relu(layers["conv"](x.transpose(1, 2))).transpose(1, 2)
        for k in range(sizes.layers):
            y, _ = layers[f"lstm{k}"](drop(y))
        ends = torch.cat((y[:, -1, : sizes.hidden], y[:, 0, sizes.hidden :]), dim=1)
        motion = _motion(torch, fixed, x)
        lively = torch.sqrt((motion * motion).mean(dim=(1, 2), keepdim=True) + LEAST_MOTION)
        added = layers["out"](drop(ends)).reshape(-1, AHEAD, FEATURES)
        return _continued(torch, fixed, x) + lively * added

    return TorchNetwork("bilstm", layers, constants(), forward)


def changes() -> Array:
    """Return the cosines of how a window differs from its last frame, and of a window, ``(2, 30, 30)``."""
    away = np.eye(SEEN)
    away[:, -1] -= 1.0
    return np.stack((cosines() @ away, cosines()))


def same_part() -> Array:
    """Return what takes the mean over the three numbers of each bone, and of the way, ``(45, 45)``."""
    return np.kron(np.eye(FEATURES // 3), np.full((3, 3), 1.0 / 3.0))


def dct_mlp(sizes: Sizes) -> TorchNetwork:
    """Return cosines, then layers that mix frames; all bones share them, and none knows of another."""
    torch = torch_of()
    nn = torch.nn
    layers = nn.ModuleDict()
    for part in ("bones", "way"):
        widths = (SEEN, *[sizes.width] * sizes.blocks)
        for k in range(sizes.blocks):
            layers[f"{part}{k}"] = nn.Linear(widths[k], sizes.width)
        layers[f"{part}_out"] = _of_zeros(nn.Linear(sizes.width, AHEAD))
    matrices = {**constants(), "dct_bones": changes()[0], "dct_way": changes()[1], "same_part": same_part()}
    fixed = _fixed(torch, matrices)

    def forward(x: Any) -> Any:
        motion = _motion(torch, fixed, x)
        lively = torch.sqrt((motion * motion).mean(dim=1, keepdim=True) @ fixed["same_part"] + LEAST_MOTION)
        found = []
        for part, y, size in zip(("bones", "way"), _parts(x), _parts(lively), strict=True):
            y = ((fixed[f"dct_{part}"] @ y) / size).transpose(1, 2)
            for k in range(sizes.blocks):
                y = torch.relu(layers[f"{part}{k}"](y))
            found.append(layers[f"{part}_out"](y).transpose(1, 2))
        return _continued(torch, fixed, x) + lively * torch.cat(found, dim=-1)

    return TorchNetwork("dct_mlp", layers, matrices, forward)


def occlusion(sizes: Sizes) -> TorchNetwork:
    """Return an autoencoder of the slowest cosines: in joints and what was seen, out what is to be added."""
    torch = torch_of()
    nn = torch.nn
    kept, wide = sizes.cosines, 4 * sizes.coded
    layers = nn.ModuleDict(
        {
            "in": nn.Linear(kept * 4 * JOINTS, wide),
            "code": nn.Linear(wide, sizes.coded),
            "decode": nn.Linear(sizes.coded, wide),
            "out": _of_zeros(nn.Linear(wide, kept * 3 * JOINTS)),
            "drop": nn.Dropout(sizes.dropout),
        }
    )
    matrices = {"dct": cosines(kept), "dct_back": _CORRECTION_M * cosines(kept)}
    fixed = _fixed(torch, matrices)
    dct, dct_back = fixed["dct"], fixed["dct_back"]

    def forward(x: Any) -> Any:
        y = (dct @ x).reshape(-1, kept * 4 * JOINTS)
        for name in ("in", "code", "decode"):
            y = torch.relu(layers[name](y))
        return dct_back.T @ layers["out"](layers["drop"](y)).reshape(-1, kept, 3 * JOINTS)

    return TorchNetwork("occlusion", layers, matrices, forward)


def make(name: str, sizes: Sizes) -> TorchNetwork:
    """Return a network by its name, one of ``NAMES``."""
    return {"bilstm": bilstm, "dct_mlp": dct_mlp, "occlusion": occlusion}[name](sizes)


def _of_zeros(layer: Any) -> Any:
    for each in layer.parameters():
        each.data.zero_()
    return layer


def _fixed(torch: Any, matrices: dict[str, Array]) -> dict[str, Any]:
    return {name: torch.tensor(each, dtype=torch.float32) for name, each in matrices.items()}


def _parts(x: Any) -> tuple[Any, Any]:
    return x[..., :-3], x[..., -3:]


def _continued(torch: Any, fixed: dict[str, Any], x: Any) -> Any:
    """Return the damped continuation of ``x``."""
    bones, way = _parts(x)
    return torch.cat((fixed["base_bones"] @ bones, fixed["base_way"] @ way), dim=-1)


def _motion(torch: Any, fixed: dict[str, Any], x: Any) -> Any:
    """Return what of ``x`` is motion in the last second, ``(n, 10, 45)``."""
    bones, way = _parts(x)
    return torch.cat((fixed["motion_bones"] @ bones, fixed["motion_way"] @ way), dim=-1)
