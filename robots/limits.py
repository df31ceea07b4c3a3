"""Joint limits: position, velocity, acceleration, jerk, torque; validated, with a source for each number."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robots.assumption import Certainty
from robots.errors import SetupError
from robots.files import shown
from robots.urdf import UrdfJoint

Array = NDArray[np.float64]

QUANTITIES = ("position_lower", "position_upper", "velocity", "acceleration", "jerk", "torque")
LARGEST_LIMIT = 1e6
"""A finite limit beyond this (in its unit) is a slip, and what is computed with it overflows."""
_REVOLUTE_UNITS = dict(zip(QUANTITIES, ("rad", "rad", "rad_s", "rad_s2", "rad_s3", "Nm"), strict=True))
_PRISMATIC_UNITS = dict(zip(QUANTITIES, ("m", "m", "m_s", "m_s2", "m_s3", "N"), strict=True))
_UNIT_TEXT = {
    "rad": "rad", "rad_s": "rad/s", "rad_s2": "rad/s²", "rad_s3": "rad/s³", "Nm": "N m",
    "m": "m", "m_s": "m/s", "m_s2": "m/s²", "m_s3": "m/s³", "N": "N",
}  # fmt: skip
_TO_SI = {
    "rad": 1.0, "deg": math.pi / 180.0, "rad/s": 1.0, "deg/s": math.pi / 180.0, "rad/s²": 1.0, "rad/s³": 1.0,
    "N m": 1.0, "m": 1.0, "m/s": 1.0, "m/s²": 1.0, "m/s³": 1.0, "N": 1.0,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the commanded joints, in joint order; arrays of shape (n,).

    rad, rad/s, rad/s², rad/s³, N m; m, m/s, m/s², m/s³, N for prismatic joints. A joint that turns endlessly
    has position limits of ∓inf; an unknown torque limit is inf.

    Raises
    ------
    SetupError
        If a shape is wrong, a number is NaN, velocity, acceleration or jerk is not finite and positive,
        torque is not positive, or a lower position limit is not below the upper one.
    """

    joints: tuple[str, ...]
    position_lower: Array
    position_upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    torque: Array

    def __post_init__(self) -> None:
        for quantity in QUANTITIES:
            values = np.array(getattr(self, quantity), dtype=np.float64)
            if values.shape != (len(self.joints),):
                raise SetupError(
                    f"{quantity} limits have shape {values.shape}, not ({len(self.joints)},): one per joint"
                )
            values.setflags(write=False)
            object.__setattr__(self, quantity, values)
        for i, joint in enumerate(self.joints):
            self._validate(i, joint)

    def _validate(self, i: int, joint: str) -> None:
        lower, upper = float(self.position_lower[i]), float(self.position_upper[i])
        if not lower < upper:
            raise SetupError(
                f"joint {joint}: lower position limit {lower:g} must be below the upper one, {upper:g}"
            )
        for quantity in ("velocity", "acceleration", "jerk"):
            value = float(getattr(self, quantity)[i])
            if not (math.isfinite(value) and value > 0.0):
                raise SetupError(f"joint {joint}: {quantity} limit {value:g} must be finite and above zero")
        if not float(self.torque[i]) > 0.0:
            raise SetupError(f"joint {joint}: torque limit {float(self.torque[i]):g} must be above zero")


@dataclass(frozen=True, slots=True)
class Limit:
    """One limit of one joint: value (units as in :class:`JointLimits`), where it is from, how sure it is."""

    joint: str
    quantity: str
    value: float
    unit: str
    source: str
    certainty: Certainty
    urdf_value: float | None = None
    """What the URDF says, None if it says nothing."""

    @property
    def differs_from_urdf(self) -> bool:
        """Whether the URDF says something else (beyond 0.1 % of rounding)."""
        if self.urdf_value is None or self.urdf_value == self.value:
            return False
        return not math.isclose(self.value, self.urdf_value, rel_tol=1e-3, abs_tol=1e-9)


Known = dict[tuple[str, str], Limit]
"""(joint, quantity) -> limit."""


class MissingLimits(SetupError):  # noqa: N818 (named after what is missing)
    """Limits that nobody gave: ``gaps`` names them, ``table`` is the TOML that has to be filled in.

    ``where`` names the table of declared limits, ``robot`` the arm. TOML takes each table once, and that of a
    joint may be there already: so each value is named too.
    """

    def __init__(self, robot: str, gaps: Mapping[str, Sequence[str]], where: str = "limits") -> None:
        self.gaps = {joint: tuple(keys) for joint, keys in gaps.items()}
        self.table = "\n".join(
            f"[limits.{_toml_key(joint)}]\n" + "".join(f'{key} = "?"\n' for key in keys)
            for joint, keys in self.gaps.items()
        )
        inline = ", ".join(
            f"{_toml_key(joint)} = {{ " + ", ".join(f'{key} = "?"' for key in keys) + " }"
            for joint, keys in self.gaps.items()
        )
        named = ", ".join(
            f"robot.limits.{_toml_key(joint)}.{key} = ____"
            for joint, keys in self.gaps.items()
            for key in keys
        )
        super().__init__(
            f"{where}: limits of {robot} without a value, and none is assumed: {named}. Add each to the "
            "table [robot.limits.JOINT] of the cell file (`stopproof init --robot FILE` prints all blanks); "
            f"or, where it has none of these tables, in one line under [robot]: limits = {{ {inline} }}"
        )


def key_of(quantity: str, prismatic: bool) -> str:
    """Return the key of a quantity in a limits table, e.g. ``velocity_rad_s``."""
    if quantity == "torque" and prismatic:
        return "force_N"
    return f"{quantity}_{(_PRISMATIC_UNITS if prismatic else _REVOLUTE_UNITS)[quantity]}"


def unit_of(quantity: str, prismatic: bool) -> str:
    """Return the unit of a quantity as text, e.g. ``rad/s``."""
    return _UNIT_TEXT[(_PRISMATIC_UNITS if prismatic else _REVOLUTE_UNITS)[quantity]]


def declared_limits(
    table: Mapping[str, Mapping[str, object]],
    prismatic: Mapping[str, bool],
    source: str,
    where: str = "limits",
) -> Known:
    """Read a user's limits table: joint -> key -> number, keys as :func:`key_of` makes them.

    ``prismatic`` has the commanded joints and whether they are prismatic; ``where`` names the table in
    messages.

    Raises
    ------
    SetupError
        For a joint that is not commanded, an unknown key (a wrong unit, say), what is not a number or beyond
        reason.
    """
    declared: Known = {}
    for joint, row in table.items():
        if joint not in prismatic:
            raise SetupError(f"{where}.{joint}: no such commanded joint; there are: {', '.join(prismatic)}")
        if not isinstance(row, Mapping):
            raise SetupError(f"{where}.{joint} must be a table of limits, not {shown(row)}")
        keys = {key_of(quantity, prismatic[joint]): quantity for quantity in QUANTITIES}
        for key, value in row.items():
            if key not in keys:
                raise SetupError(f"{where}.{joint}.{key}: unknown key; possible are: {', '.join(keys)}")
            quantity, number = keys[key], _read_limit(value, f"{where}.{joint}.{key}")
            unit = unit_of(quantity, prismatic[joint])
            declared[joint, quantity] = Limit(joint, quantity, number, unit, source, Certainty.DECLARED)
    return declared


def _read_limit(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) >= 0:
        raise SetupError(f"{where} = {shown(value)} is not a number")
    if LARGEST_LIMIT < abs(value) != math.inf:
        raise SetupError(f"{where} = {shown(value)} is beyond {LARGEST_LIMIT:g}; state the true limit")
    return float(value)


def assemble(
    robot: str, prismatic: Mapping[str, bool], known: Known, where: str = "limits"
) -> tuple[JointLimits, tuple[Limit, ...]]:
    """Make :class:`JointLimits` of what is known; a torque limit that nobody gave is inf and listed as such.

    ``where`` names the table of declared limits in messages.

    Raises
    ------
    MissingLimits
        One error for all gaps.
    SetupError
        If a value is impossible.
    """
    gaps: dict[str, list[str]] = {}
    rows: list[Limit] = []
    for joint, slides in prismatic.items():
        for quantity in QUANTITIES:
            limit = known.get((joint, quantity))
            if limit is None and quantity == "torque":
                limit = Limit(
                    joint, quantity, math.inf, unit_of(quantity, slides), "no limit given, none is checked",
                    Certainty.UNVERIFIED,
                )  # fmt: skip
            if limit is None:
                gaps.setdefault(joint, []).append(key_of(quantity, slides))
            else:
                rows.append(limit)
    if gaps:
        raise MissingLimits(robot, gaps, where)
    for joint in prismatic:
        _check_limits([row for row in rows if row.joint == joint], robot, where)
    columns = {
        quantity: np.array([row.value for row in rows if row.quantity == quantity]) for quantity in QUANTITIES
    }
    return JointLimits(tuple(prismatic), **columns), tuple(rows)


def _check_limits(rows: Sequence[Limit], robot: str, where: str) -> None:
    """Refuse limits of one joint that are beyond reason or cross, and say who stated them."""
    lower, upper = (row for row in rows if row.quantity.startswith("position"))
    for row in rows:
        if LARGEST_LIMIT < abs(row.value) != math.inf:
            raise SetupError(
                f"{robot}: joint {row.joint}: {row.quantity} limit {row.value:g} {row.unit} ({row.source}) "
                f"is beyond {LARGEST_LIMIT:g}; state the true one"
            )
    if not lower.value < upper.value:
        declared = Certainty.DECLARED in (lower.certainty, upper.certainty)
        place = f"{where}.{lower.joint}" if declared else f"{robot}: joint {lower.joint}"
        raise SetupError(
            f"{place}: lower position limit {lower.value:g} ({lower.source}) "
            f"must be below the upper one, {upper.value:g} ({upper.source})"
        )


def urdf_limits(joints: Sequence[UrdfJoint], source: str) -> Known:
    """Limits that a URDF states in earnest: a velocity or effort of 0, or an empty range, is a gap."""
    known: Known = {}
    for joint in joints:
        found: dict[str, float] = {}
        if joint.kind == "continuous":
            found |= {"position_lower": -math.inf, "position_upper": math.inf}
        elif joint.lower is not None and joint.upper is not None and joint.lower < joint.upper:
            found |= {"position_lower": joint.lower, "position_upper": joint.upper}
        if joint.velocity is not None and 0.0 < joint.velocity < math.inf:
            found["velocity"] = joint.velocity
        if joint.effort is not None and joint.effort > 0.0:
            found["torque"] = joint.effort
        for quantity, value in found.items():
            unit = unit_of(quantity, joint.prismatic)
            known[joint.name, quantity] = Limit(
                joint.name, quantity, value, unit, source, Certainty.SOURCED, urdf_value=value
            )
    return known


def file_limits(
    table: Mapping[str, Mapping[str, Any]], listed: Sequence[str], prismatic: Mapping[str, bool]
) -> Known:
    """Limits from a model file: quantity -> unit, values (one per listed joint), source, certainty."""
    known: Known = {}
    for quantity, entry in table.items():
        factor, certainty = _TO_SI[entry["unit"]], Certainty(entry["certainty"])
        for joint, value in zip(listed, entry["values"], strict=True):
            if joint in prismatic:
                unit = unit_of(quantity, prismatic[joint])
                known[joint, quantity] = Limit(
                    joint, quantity, value * factor, unit, entry["source"], certainty
                )
    return known


def override(known: Known, stronger: Known) -> Known:
    """Let limits replace others, and remember what the URDF said."""
    merged = dict(known)
    for key, limit in stronger.items():
        merged[key] = replace(limit, urdf_value=known[key].urdf_value if key in known else None)
    return merged


def _toml_key(name: str) -> str:
    bare = name and all(c.isascii() and (c.isalnum() or c in "_-") for c in name)
    return name if bare else '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'
