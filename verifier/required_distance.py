"""Distances that standards require: S of ISO 13855, S_p of ISO/TS 15066; every term with where it comes from.

Nothing here has been compared with a licensed copy of a standard: each formula and constant says which
edition it is from and how sure it is, and a result is no surer than the least sure of its terms. Lengths are
in m, where the standards have mm. (docs/limits.md.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from robots.assumption import Assumption, Certainty
from robots.errors import SetupError

Array = NDArray[np.float64]


class DistanceError(SetupError):
    """A number from which no distance can be computed; one line that names it and the rule."""


class Edition(StrEnum):
    """The document, and its year, whose formula is used."""

    ISO_13855_2010 = "ISO 13855:2010"
    ISO_13855_2024 = "ISO 13855:2024"
    TS_15066_2016 = "ISO/TS 15066:2016"


_RECALLED: Final = f"{Edition.ISO_13855_2010}, recalled; check against a licensed copy"
_OF_2024: Final = f"{Edition.ISO_13855_2024} as described by gt-engineering; check against a licensed copy"
_BY_NIST: Final = f"{Edition.TS_15066_2016} as read by Marvel and Norcross (NIST, PMC5117641)"

FAST_M_S: Final = 2.0
WALK_M_S: Final = 1.6
LEAST_M: Final = 0.1
LEAST_WALK_M: Final = 0.5
"""ISO 13855:2010: K = 2.0 m/s up to S = 0.5 m, at least 0.1 m; K = 1.6 m/s beyond, then at least 0.5 m."""
FINEST_M: Final = 0.014
HANDS_UP_TO_M: Final = 0.04
COARSEST_M: Final = 0.07
"""ISO 13855:2010: resolutions d up to which fingers (C = 0) and hands are detected, and the largest one that
its rule of normal approach knows."""
ARM_M: Final = 0.85
"""ISO 13855:2010: the smallest C where hands are not detected, and of parallel approach."""
PARALLEL_M: Final = 1.2
HIGHEST_M: Final = 1.0
_ROUNDING_M: Final = 1e-9
PERSON_M_S: Final = 1.6
"""ISO/TS 15066:2016: v_h of a person whose speed is not monitored."""


def declared(name: str, value: float, unit: str, source: str = "stated by the user") -> Assumption:
    """Return a number that the user vouches for."""
    return Assumption(name, value, unit, source, Certainty.DECLARED)


@dataclass(frozen=True, slots=True)
class RequiredDistance:
    """A distance that a standard requires, and all that it was computed from.

    Attributes
    ----------
    symbol, edition:
        ``S`` or ``S_p``, and whose.
    distance_m:
        The distance [m].
    formula:
        As text, with its source and how sure it is.
    terms:
        Every number in it, in the order of the formula; what was given, what follows from that.
    """

    symbol: str
    edition: Edition
    distance_m: float
    formula: Assumption
    terms: tuple[Assumption, ...]

    def term(self, name: str) -> float:
        """Return the value of one term.

        Raises
        ------
        KeyError
            There is no number of that name.
        """
        for item in self.terms:
            if item.name == name and not isinstance(item.value, str):
                return item.value
        raise KeyError(name)


def _number(item: Assumption, unit: str, most: float = math.inf) -> float:
    """Return the number that was given, if it can be one."""
    value = item.value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DistanceError(f"{item.name} = {value!r} should be a number in {unit}")
    if item.unit != unit:
        raise DistanceError(f"{item.name} = {value:g} is in {item.unit or 'no unit'}, should be in {unit}")
    if not (math.isfinite(value) and 0.0 <= value <= most):
        rule = "" if math.isinf(most) else f" and at most {most:g} {unit}"
        raise DistanceError(f"{item.name} = {value:g} {unit} should be finite, not negative{rule}")
    return float(value)


def _computed(name: str, value: float, unit: str, how: str) -> Assumption:
    return Assumption(name, value, unit, how, Certainty.COMPUTED)


def _recalled(name: str, value: float, unit: str, what: str) -> Assumption:
    return Assumption(name, value, unit, f"{what}: {_RECALLED}", Certainty.UNVERIFIED)


def _response(parts: Sequence[Assumption]) -> tuple[float, tuple[Assumption, ...]]:
    """Return T and its terms: the parts as they were given, and their sum."""
    if not parts:
        raise DistanceError("T: no part of the response time is given; it is at least detection and stop")
    total = math.fsum(_number(part, "s") for part in parts)
    return total, (*parts, _computed("T", total, "s", f"sum of {', '.join(part.name for part in parts)}"))


def normal_approach(
    response: Sequence[Assumption], resolution: Assumption, reaching_over: Assumption | None = None
) -> RequiredDistance:
    """S = K T + C of ISO 13855:2010 for a detection field that people walk or reach through at right angles.

    With a resolution d of at most 40 mm: K = 2000 mm/s and C = 8 (d - 14 mm), not below 0; S is at least 100
    mm. Where that is above 500 mm, K = 1600 mm/s, and S is at least 500 mm. With 40 mm < d <= 70 mm: K = 1600
    mm/s, C = 850 mm.

    Parameters
    ----------
    response:
        Parts of the overall response time T [s]: detection, transmission, stop.
    resolution:
        d [m].
    reaching_over:
        C_RO [m] of the standard's table for reaching over the field, which is not reproduced here: whoever
        knows it states it. The larger one of C and C_RO counts. ``None``: nobody can reach over.

    Raises
    ------
    DistanceError
        A number is missing, negative, not finite, in another unit, or beyond the rule.
    """
    total, stated = _response(response)
    d = _number(resolution, "m", COARSEST_M)
    through = max(0.0, 8.0 * (d - FINEST_M)) if d <= HANDS_UP_TO_M else ARM_M
    over = 0.0 if reaching_over is None else _number(reaching_over, "m")
    intrusion = max(through, over)
    speed, least = (FAST_M_S, LEAST_M) if d <= HANDS_UP_TO_M else (WALK_M_S, 0.0)
    distance = max(speed * total + intrusion, least)
    if d <= HANDS_UP_TO_M and distance > LEAST_WALK_M:
        speed, least = WALK_M_S, LEAST_WALK_M
        distance = max(speed * total + intrusion, least)
    how = "8 (d - 14 mm), not below 0" if d <= HANDS_UP_TO_M else "850 mm, where hands are not detected"
    given = () if reaching_over is None else (reaching_over,)
    terms = (
        _recalled("K", speed, "m/s", "approach speed"), *stated, resolution,
        _recalled("C_RT", through, "m", how), *given,
        _computed("C", intrusion, "m", "the larger one of C_RT and C_RO"),
        _recalled("S_min", least, "m", f"least distance with K = {speed:g} m/s"),
    )  # fmt: skip
    return _required_2010("S = max(K T + C, S_min), normal approach", distance, terms)


def parallel_approach(
    response: Sequence[Assumption], height: Assumption, resolution: Assumption | None = None
) -> RequiredDistance:
    """S = K T + C of ISO 13855:2010 for a field along the floor, such as a scanner's or a mat's.

    K = 1600 mm/s, C = 1200 mm - 0.4 H, at least 850 mm; H from 0 to 1000 mm, and at least 15 (d - 50 mm).

    Parameters
    ----------
    response:
        Parts of the overall response time T [s].
    height:
        H, height of the field above the floor [m].
    resolution:
        d [m]; ``None``: not a matter of the device, as with a mat.

    Raises
    ------
    DistanceError
        A number is missing, negative, not finite, in another unit, or beyond the rule.
    """
    total, stated = _response(response)
    h = _number(height, "m", HIGHEST_M)
    if resolution is not None:
        lowest = 15.0 * (_number(resolution, "m") - 0.05)
        if not h >= lowest - _ROUNDING_M:
            d = f"a resolution of {resolution.value:g} m"
            raise DistanceError(
                f"{height.name} = {h:g} m should be at least {lowest:.3f} m, 15 (d - 50 mm), with {d}: "
                "legs would not be detected"
            )
    intrusion = max(PARALLEL_M - 0.4 * h, ARM_M)
    terms = (
        _recalled("K", WALK_M_S, "m/s", "approach speed"), *stated, height,
        *(() if resolution is None else (resolution,)),
        _recalled("C", intrusion, "m", "1200 mm - 0.4 H, not below 850 mm"),
    )  # fmt: skip
    return _required_2010("S = K T + C, parallel approach", WALK_M_S * total + intrusion, terms)


def _required_2010(formula: str, distance: float, terms: tuple[Assumption, ...]) -> RequiredDistance:
    stated = Assumption("S.formula", formula, "", _RECALLED, Certainty.UNVERIFIED)
    return RequiredDistance("S", Edition.ISO_13855_2010, distance, stated, terms)


def separation_2024(
    response: Sequence[Assumption], speed: Assumption, device: Assumption, supplement: Assumption
) -> RequiredDistance:
    """S = K T + D_DS + Z of ISO 13855:2024.

    Only the form is known here, none of its numbers: K [m/s], the reach distance D_DS [m] that belongs to the
    device, and the supplement Z [m] must be stated. Running, jumping and falling are outside of the standard.

    Raises
    ------
    DistanceError
        A number is missing, negative, not finite, or in another unit.
    """
    total, stated = _response(response)
    k = _number(speed, "m/s")
    distance = k * total + _number(device, "m") + _number(supplement, "m")
    formula = Assumption("S.formula", "S = K T + D_DS + Z", "", _OF_2024, Certainty.SOURCED)
    terms = (speed, *stated, device, supplement)
    return RequiredDistance("S", Edition.ISO_13855_2024, distance, formula, terms)


@dataclass(frozen=True, slots=True)
class Allowances:
    """What S_p has besides motion.

    Attributes
    ----------
    intrusion:
        C [m]: how far a body part comes in before it is detected (ISO 13855).
    person_error:
        Z_d [m]: uncertainty of the person's position.
    robot_error:
        Z_r [m]: uncertainty of the robot's position.
    """

    intrusion: Assumption
    person_error: Assumption
    robot_error: Assumption


@dataclass(frozen=True, slots=True)
class Times:
    """T_r [s], from t0 until the stop begins, and T_s [s], from there until the robot rests."""

    reaction: Assumption
    stopping: Assumption


@dataclass(frozen=True, slots=True)
class Lengths:
    """What person and robot may come towards each other [m], and the numbers that it was found from.

    Attributes
    ----------
    person:
        S_h, until the robot rests.
    reacting, stopping:
        S_r and S_s of the robot, before its stop begins and during it.
    given:
        What they were computed from.
    """

    person: Assumption
    reacting: Assumption
    stopping: Assumption
    given: tuple[Assumption, ...]


@dataclass(frozen=True, eq=False)
class SpeedBound:
    """A speed that nothing exceeds, as steps.

    Attributes
    ----------
    t:
        (N+1,) s, increasing.
    speed:
        (N,) m/s: the bound on each interval between two of these instants.

    Raises
    ------
    DistanceError
        Shapes do not agree, times do not increase, a speed is negative or not finite.
    """

    t: Array
    speed: Array

    def __post_init__(self) -> None:
        t, speed = np.array(self.t, np.float64), np.array(self.speed, np.float64)
        if t.ndim != 1 or speed.ndim != 1 or len(t) != len(speed) + 1 or not len(speed):
            raise DistanceError(
                f"a speed over time needs t (N+1,) and speed (N,), not {t.shape} and {speed.shape}"
            )
        if not (np.isfinite(t).all() and (np.diff(t) > 0.0).all()):
            raise DistanceError("the times of a speed over time should be finite and increase")
        if not (speed >= 0.0).all() or not np.isfinite(speed).all():
            raise DistanceError(
                f"a bound of speed should be finite and not negative, not {speed.min():g} m/s"
            )
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "speed", speed)

    @classmethod
    def constant(cls, speed: float, begin: float, end: float) -> Self:
        """Return the same bound [m/s] from ``begin`` to ``end`` [s]."""
        return cls(np.array([begin, end]), np.array([speed]))

    def length(self, begin: float, end: float) -> float:
        """Return the most that is travelled between two instants [m]: the integral of the steps.

        Raises
        ------
        DistanceError
            ``end`` is before ``begin``, or there is no bound for some of the time between them.
        """
        if not self.t[0] <= begin <= end <= self.t[-1]:
            raise DistanceError(
                f"no speed is known for all of {begin:g} s … {end:g} s, only for "
                f"{self.t[0]:g} s … {self.t[-1]:g} s"
            )
        inside: Array = np.diff(np.clip(self.t, begin, end))
        return float(inside @ self.speed)


def unmonitored_person() -> Assumption:
    """Return v_h of ISO/TS 15066:2016 for a person whose speed is not monitored."""
    return Assumption("v_h", PERSON_M_S, "m/s", f"speed not monitored: {_BY_NIST}", Certainty.SOURCED)


def constant_lengths(
    times: Times, person_speed: Assumption, robot_speed: Assumption, stopping: Assumption
) -> Lengths:
    """Return S_h = v_h (T_r + T_s), S_r = v_r T_r, and S_s for speeds that are constant.

    Parameters
    ----------
    times:
        T_r and T_s.
    person_speed, robot_speed:
        v_h and v_r [m/s].
    stopping:
        S_s [m] if it is a length, or v_s [m/s], largest speed during the stop: then S_s = v_s T_s.

    Raises
    ------
    DistanceError
        A number is negative, not finite, or in another unit.
    """
    reaction, stop = _number(times.reaction, "s"), _number(times.stopping, "s")
    v_h, v_r = _number(person_speed, "m/s"), _number(robot_speed, "m/s")
    given: tuple[Assumption, ...] = (times.reaction, times.stopping, person_speed, robot_speed)
    if stopping.unit == "m":
        s_s = replace(stopping, name="S_s")
    else:
        s_s = _computed("S_s", _number(stopping, "m/s") * stop, "m", f"{stopping.name} T_s")
        given = (*given, stopping)
    return Lengths(
        _computed("S_h", v_h * (reaction + stop), "m", "v_h (T_r + T_s)"),
        _computed("S_r", v_r * reaction, "m", "v_r T_r"),
        s_s,
        given,
    )


def varying_lengths(t0: float, times: Times, person: SpeedBound, robot: SpeedBound) -> Lengths:
    """Return S_h, S_r and S_s as integrals of speeds over time from ``t0`` [s] on.

    S_h = ∫ v_h dt over [t0, t0 + T_r + T_s], S_r = ∫ v_r dt over [t0, t0 + T_r], S_s = ∫ v_s dt over [t0 +
    T_r, t0 + T_r + T_s]. The directed speeds of the technical specification are replaced by bounds of their
    magnitude, which are not smaller.

    Raises
    ------
    DistanceError
        A time is negative or not finite, or a speed is not known for all of it.
    """
    begin = t0 + _number(times.reaction, "s")
    rest = begin + _number(times.stopping, "s")
    return Lengths(
        _computed("S_h", person.length(t0, rest), "m", "∫ v_h dt until the robot rests"),
        _computed("S_r", robot.length(t0, begin), "m", "∫ v_r dt until its stop begins"),
        _computed("S_s", robot.length(begin, rest), "m", "∫ v_s dt during its stop"),
        (times.reaction, times.stopping),
    )


def protective_separation(lengths: Lengths, allowances: Allowances) -> RequiredDistance:
    """S_p = S_h + S_r + S_s + C + Z_d + Z_r of ISO/TS 15066:2016, speed and separation monitoring.

    Raises
    ------
    DistanceError
        A term is negative, not finite, or not in m.
    """
    terms = (
        lengths.person, lengths.reacting, lengths.stopping,
        allowances.intrusion, allowances.person_error, allowances.robot_error,
    )  # fmt: skip
    distance = math.fsum(_number(term, "m") for term in terms)
    formula = Assumption(
        "S_p.formula", "S_p = S_h + S_r + S_s + C + Z_d + Z_r", "", _BY_NIST, Certainty.SOURCED
    )
    return RequiredDistance("S_p", Edition.TS_15066_2016, distance, formula, (*terms, *lengths.given))


def least_sure(required: RequiredDistance) -> Certainty:
    """Return the weakest certainty of a formula and of its terms.

    Nothing computed is surer than what it was computed from.
    """
    return min((item.certainty for item in (required.formula, *required.terms)), key=_WEAKEST_FIRST.index)


_WEAKEST_FIRST: Final = (
    Certainty.UNVERIFIED, Certainty.ASSUMED, Certainty.DEFAULT, Certainty.MEASURED, Certainty.DECLARED,
    Certainty.SOURCED, Certainty.COMPUTED,
)  # fmt: skip
