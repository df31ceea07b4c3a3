"""The potential of many configurations at once by PyTorch, on CUDA where there is one."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from modes.planning.potential_field import Bodies, Field
from robots.errors import SetupError

if TYPE_CHECKING:
    from torch import Tensor

Array = NDArray[np.float64]

_AT_ONCE = 2_000_000
"""Distances that are computed at once, so that memory does not grow with the number of configurations."""


def potentials(field: Field, configurations: Array, bodies: Bodies, device: str = "cuda") -> Array:
    """Return U of (5) for each of ``configurations`` (B, n), as :meth:`Field.potentials`, in doubles.

    Raises
    ------
    SetupError
        PyTorch is not installed, has no such device, or configurations do not fit the arm.
    """
    torch = _torch(device)
    q = np.ascontiguousarray(configurations, dtype=float)
    if q.ndim != 2 or q.shape[1] != len(field.robot.joints):
        raise SetupError(f"potential field: configurations of shape {q.shape} do not fit {field.robot.name}")
    arm, settings = field.points, field.settings
    share = 0.0 if settings.variant == "as_printed" else 1.0

    def on(values: Any) -> Tensor:
        return torch.as_tensor(np.asarray(values, dtype=float), device=device)

    a, b, weight = on(bodies.a), on(bodies.b), on([settings.decay**k for k in range(bodies.frames)])
    taken = share * (on(bodies.radius)[None, :] + on(arm.skin)[:, None])
    local, joints = on(arm.local), torch.as_tensor(arm.joints, device=device)
    at_once = max(1, _AT_ONCE // max(1, len(arm.joints) * bodies.a.shape[0] * bodies.a.shape[1]))
    found = [np.zeros(0)]
    for begin in range(0, len(q), at_once):
        rotations, positions = _forward(torch, field, on(q[begin : begin + at_once]), on)
        points = positions[:, joints] + (rotations[:, joints] @ local[..., None])[..., 0]
        d = _axis_distances(torch, points, a, b) - taken[None, :, None, :]
        inside = torch.where(d >= 0.0, torch.cos(0.5 * torch.pi * d / settings.reach_m), 2.0)
        counted = torch.where(d <= settings.reach_m, inside, 0.0)
        counted = torch.where(torch.isnan(d), 2.0, counted)
        found.append((counted * weight[None, None, :, None]).sum(dim=(1, 2, 3)).cpu().numpy())
    return np.concatenate(found)


def _torch(device: str) -> Any:
    if find_spec("torch") is None:
        raise SetupError("potentials by PyTorch need torch: pip install 'stopproof[train]'")
    import torch

    if device.startswith("cuda") and not torch.cuda.is_available():
        raise SetupError(f"potentials by PyTorch: device {device!r}, but torch has no CUDA here")
    return torch


def _forward(torch: Any, field: Field, q: Tensor, on: Any) -> tuple[Tensor, Tensor]:
    """Return rotations (B, n, 3, 3) and positions (B, n, 3) of all joints."""
    tree, count = field.robot.kinematics[0], len(q)
    rotations: list[Tensor] = []
    positions: list[Tensor] = []
    for j in range(q.shape[1]):
        x, y, z = tree["axis"][j].tolist()
        K, eye = on([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]), on(np.eye(3))
        rotation = on(tree["rotation"][j]).expand(count, 3, 3)
        position = on(tree["translation"][j]).expand(count, 3)
        if tree["prismatic"][j]:
            position = position + (q[:, j, None] * on(tree["axis"][j])) @ on(tree["rotation"][j]).T
        else:
            angle = q[:, j, None, None]
            rotation = rotation @ (eye + torch.sin(angle) * K + (1.0 - torch.cos(angle)) * (K @ K))
        parent = int(tree["parent"][j])
        if parent >= 0:
            position = positions[parent] + (rotations[parent] @ position[..., None])[..., 0]
            rotation = rotations[parent] @ rotation
        rotations.append(rotation)
        positions.append(position)
    return torch.stack(rotations, dim=1), torch.stack(positions, dim=1)


def _axis_distances(torch: Any, points: Tensor, a: Tensor, b: Tensor) -> Tensor:
    """Return distances (B, m, frames, parts) of points (B, m, 3) from axes (frames, parts, 3)."""
    way = b - a
    square = (way * way).sum(-1)
    beside = points[:, :, None, None] - a
    along = (beside * way).sum(-1) / torch.where(square > 0.0, square, 1.0)
    share = torch.where(square > 0.0, along.clamp(0.0, 1.0), 0.0)
    return torch.linalg.vector_norm(beside - share[..., None] * way, dim=-1)
