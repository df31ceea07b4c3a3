"""The model card: all that is known about an arm, with sources, for people to read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robots.assumption import Assumption, Certainty
from robots.enclosure import EnclosedPart
from robots.limits import Limit
from robots.model import RobotModel


@dataclass(frozen=True, slots=True)
class CapsuleEntry:
    """A capsule of the enclosure; ``hull_litres`` is the volume of the hull of what it contains, if known."""

    link: str
    joint: str
    length_m: float
    radius_m: float
    litres: float
    hull_litres: float | None
    largest_reach_m: float
    source: str
    certainty: Certainty


@dataclass(frozen=True)
class ModelCard:
    """An arm: joints, limits and capsules, each with source and certainty; what differs from the URDF."""

    name: str
    description: str
    joints: tuple[str, ...]
    limits: tuple[Limit, ...]
    enclosure: tuple[CapsuleEntry, ...]
    fixed_links: tuple[str, ...]
    statements: tuple[Assumption, ...]
    """What is believed and is no limit and no capsule: mount, tool, locked joints."""
    assumed: tuple[str, ...]
    """What is an engineering assumption: quantities, ``enclosure``."""
    content_hash: str

    @property
    def differences(self) -> tuple[Limit, ...]:
        """Limits for which the URDF says something else."""
        return tuple(limit for limit in self.limits if limit.differs_from_urdf)

    def to_dict(self) -> dict[str, object]:
        """Return the card as JSON types; a limit that does not exist (±inf) is None."""
        return {
            "name": self.name,
            "description": self.description,
            "joints": list(self.joints),
            "limits": [_limit_dict(limit) for limit in self.limits],
            "differences_from_urdf": [_limit_dict(limit) for limit in self.differences],
            "enclosure": [
                {name: getattr(entry, name) for name in CapsuleEntry.__dataclass_fields__}
                for entry in self.enclosure
            ],
            "fixed_links": list(self.fixed_links),
            "statements": [
                {"name": each.name, "value": each.value, "source": each.source, "certainty": each.certainty}
                for each in self.statements
            ],
            "assumed": list(self.assumed),
            "content_hash": self.content_hash,
        }

    def lines(self) -> list[str]:
        """Return the card as text."""
        rows = [f"{self.name}: {self.description}", "", "limits"]
        rows += _limit_lines(self.joints, self.limits)
        rows += ["", "enclosure (capsules of moving links)"]
        rows += [_capsule_line(entry) for entry in self.enclosure]
        rows += [f"  not checked against people: {', '.join(self.fixed_links) or 'nothing'}"]
        if self.differences:
            rows += ["", "where the URDF says something else"]
            for limit in self.differences:
                values = f"{limit.value:.6g}, URDF {limit.urdf_value:.6g} {limit.unit}"
                rows.append(f"  {limit.quantity} of {limit.joint}: {values}")
        rows += ["", "also believed"]
        rows += [f"  {each.name}: {each.value} [{each.certainty}]" for each in self.statements]
        rows += ["", f"engineering assumptions: {', '.join(self.assumed) or 'nothing'}"]
        rows += [f"content hash {self.content_hash}"]
        return rows


def incomplete_card(
    name: str, joints: Sequence[str], gaps: Mapping[str, Sequence[str]], parts: Sequence[EnclosedPart]
) -> list[str]:
    """Return as text what is known of an arm whose limits are not: its capsules, and which limits those are.

    ``gaps``: joint -> keys of the limits that nobody gave; ``parts`` refer to ``joints``.
    """
    rows = [f"{name}: no model yet: limits are missing", "", "limits"]
    rows += [f"  {joint}: not stated: {', '.join(keys)}" for joint, keys in gaps.items()]
    rows += ["", "enclosure (capsules of moving links)"]
    return rows + [_capsule_line(_capsule_entry(part, joints[part.joint], np.nan)) for part in parts]


def model_card(
    model: RobotModel, description: str, limits: Sequence[Limit], parts: Sequence[EnclosedPart]
) -> ModelCard:
    """Make the card of a model from the limits and parts that it was made of."""
    numbers = {f"robot.{model.name}.{limit.quantity}.{limit.joint}" for limit in limits}
    numbers |= {f"robot.{model.name}.enclosure.{part.name}.radius" for part in parts}
    assumed = (*model.assumed_limits, *(("enclosure",) if model.assumed_enclosure else ()))
    reach = model.enclosure[0]["reach"]
    return ModelCard(
        name=model.name,
        description=description,
        joints=model.joints,
        limits=tuple(limits),
        enclosure=tuple(
            _capsule_entry(part, model.joints[part.joint], float(reach[i].max()))
            for i, part in enumerate(parts)
        ),
        fixed_links=model.fixed_links,
        statements=tuple(each for each in model.assumptions if each.name not in numbers),
        assumed=assumed,
        content_hash=model.content_hash,
    )


def _capsule_entry(part: EnclosedPart, joint: str, largest_reach: float) -> CapsuleEntry:
    capsule = part.capsule
    return CapsuleEntry(
        link=part.name,
        joint=joint,
        length_m=float(np.linalg.norm(capsule.b - capsule.a)),
        radius_m=capsule.radius,
        litres=1e3 * capsule.volume,
        hull_litres=_hull_litres(part),
        largest_reach_m=largest_reach,
        source=part.source,
        certainty=part.certainty,
    )


def _capsule_line(entry: CapsuleEntry) -> str:
    hull = "" if entry.hull_litres is None else f", hull of the geometry {entry.hull_litres:.2f} l"
    return (
        f"  {entry.link} on {entry.joint}: length {entry.length_m:.3f} m, "
        f"radius {entry.radius_m:.4f} m, {entry.litres:.2f} l{hull} [{entry.certainty}]"
    )


def _hull_litres(part: EnclosedPart) -> float | None:
    """Volume of the hull of the corners [l]; None where there are none, or balls instead of points."""
    if not len(part.corners) or part.corners[:, 3].any():
        return None
    try:
        return 1e3 * float(ConvexHull(part.corners[:, :3]).volume)
    except QhullError:  # flat geometry
        return 0.0


def _limit_dict(limit: Limit) -> dict[str, object]:
    return {
        "joint": limit.joint,
        "quantity": limit.quantity,
        "value": _finite(limit.value),
        "unit": limit.unit,
        "source": limit.source,
        "certainty": limit.certainty,
        "urdf_value": _finite(limit.urdf_value),
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and np.isfinite(value) else None


def _limit_lines(joints: Sequence[str], limits: Sequence[Limit]) -> list[str]:
    """One line per quantity and source, values in joint order."""
    groups: dict[tuple[str, str, str, str], dict[str, float]] = {}
    for limit in limits:
        key = (limit.quantity, limit.unit, str(limit.certainty), limit.source)
        groups.setdefault(key, {})[limit.joint] = limit.value
    rows = [f"  joints: {', '.join(joints)}"]
    for (quantity, unit, certainty, source), values in groups.items():
        numbers = ", ".join(f"{values[joint]:.5g}" if joint in values else "-" for joint in joints)
        rows.append(f"  {quantity} [{unit}]: {numbers} [{certainty}: {source}]")
    return rows
