"""Robots that nobody built: random trees of joints with primitive shapes, as URDF text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Vector = Sequence[float] | NDArray[np.float64]
LIMITS = {
    "revolute": '<limit lower="-2.5" upper="2.5" velocity="2" effort="10"/>',
    "prismatic": '<limit lower="-0.2" upper="0.3" velocity="1" effort="10"/>',
    "continuous": '<limit velocity="2" effort="10"/>',
}


def numbers(values: Vector) -> str:
    return " ".join(f"{value:.17g}" for value in values)


def link(name: str, shapes: str = "") -> str:
    return f'<link name="{name}">{shapes}</link>'


def shape(geometry: str, xyz: Vector = (0, 0, 0), rpy: Vector = (0, 0, 0), kind: str = "visual") -> str:
    origin = f'<origin xyz="{numbers(xyz)}" rpy="{numbers(rpy)}"/>'
    return f"<{kind}>{origin}<geometry>{geometry}</geometry></{kind}>"


def joint(
    name: str,
    parent: str,
    child: str,
    *,
    kind: str = "revolute",
    xyz: Vector = (0, 0, 0),
    rpy: Vector = (0, 0, 0),
    axis: Vector = (0, 0, 1),
    inside: str | None = None,
) -> str:
    inside = LIMITS.get(kind, "") if inside is None else inside
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{numbers(xyz)}" rpy="{numbers(rpy)}"/><axis xyz="{numbers(axis)}"/>{inside}</joint>'
    )


def robot(*parts: str, name: str = "made_up") -> str:
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def random_shape(rng: np.random.Generator) -> str:
    a, b, c = rng.uniform(0.02, 0.2, 3)
    geometry = rng.choice(
        [f'<box size="{a} {b} {c}"/>', f'<sphere radius="{a}"/>', f'<cylinder radius="{a}" length="{b}"/>']
    )
    kind = str(rng.choice(["visual", "collision"]))
    return shape(str(geometry), rng.uniform(-0.1, 0.1, 3), rng.uniform(-3, 3, 3), kind)


def random_tree(rng: np.random.Generator, n: int, *, aligned: bool = False) -> str:
    """URDF of ``n`` joints of all kinds; ``aligned``: axes and placements turned by quarters only."""
    parts = [link("link_0")]
    for i in range(1, n + 1):
        parent = f"link_{rng.integers(max(0, i - 2), i)}"
        kind = str(rng.choice(["revolute", "continuous", "prismatic"], p=[0.5, 0.2, 0.3]))
        axis, rpy = rng.normal(size=3), rng.uniform(-3, 3, 3)
        if aligned:
            axis, rpy = np.eye(3)[rng.integers(3)], rng.integers(0, 4, 3) * np.pi / 2
        parts.append(link(f"link_{i}", random_shape(rng) + random_shape(rng)))
        xyz = rng.uniform(-0.5, 0.5, 3)
        parts.append(joint(f"joint_{i}", parent, f"link_{i}", kind=kind, xyz=xyz, rpy=rpy, axis=axis))
    return robot(*parts)


def full_limits(joints: Sequence[str], prismatic: Sequence[bool]) -> dict[str, dict[str, object]]:
    """Acceleration and jerk for every joint, as a user would declare them."""
    rows: dict[str, dict[str, object]] = {}
    for name, slides in zip(joints, prismatic, strict=True):
        unit = "m" if slides else "rad"
        rows[name] = {f"acceleration_{unit}_s2": 5.0, f"jerk_{unit}_s3": 100.0}
    return rows
