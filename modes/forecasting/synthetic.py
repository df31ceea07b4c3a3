"""Made-up people who walk, stop, turn, bend and reach, to train forecasts on beside recordings.

Nobody was measured. Lengths are Winter's shares of the height (D. A. Winter, *Biomechanics and Motor Control
of Human Movement*); speeds, pauses, steps and the swing of arms are guesses at what people do. Hands move by
minimum jerk (Flash and Hogan 1985). Feet of the standing slide a little, and nobody stumbles or hurries.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.skeleton import JOINTS, Joint
from modes.settings import require_number

Array = NDArray[np.float64]

_SHOULDER, _NECK, _HIP, _ANKLE = 0.818, 0.845, 0.53, 0.039
"""Heights of shoulders, base of the neck, hips and ankles, as shares of the height of the body."""
_HALF_SHOULDERS, _HALF_HIPS = 0.115, 0.052
_UPPER_ARM, _FOREARM, _THIGH, _SHANK = 0.186, 0.146, 0.245, 0.246
_BEFORE_NECK_M, _L3_SHARE = 0.06, 0.25
"""As in :mod:`modes.forecasting.skeleton`."""


@dataclass(frozen=True, slots=True)
class PersonSettings:
    """Who is made up, and how lively; every number is drawn evenly from between two.

    Attributes
    ----------
    height_m:
        Of the body [m].
    speed_m_s:
        Of walking [m/s].
    reach_s:
        Time that a hand takes from place to place [s].
    pause_s:
        Time that one stands between walks, and that a hand rests [s].
    still:
        Share of people who never walk.
    """

    height_m: tuple[float, float] = (1.5, 1.95)
    speed_m_s: tuple[float, float] = (0.4, 1.7)
    reach_s: tuple[float, float] = (0.5, 2.5)
    pause_s: tuple[float, float] = (0.1, 2.0)
    still: float = 0.4

    def __post_init__(self) -> None:
        bounds = {"height_m": 3.0, "speed_m_s": 5.0, "reach_s": 10.0, "pause_s": 60.0}
        for name, high in bounds.items():
            low, most = getattr(self, name)
            require_number(f"made-up person: {name}[0]", low, 0.0, high, above=True)
            require_number(f"made-up person: {name}[1]", most, low, high)
        require_number("made-up person: still", self.still, 0.0, 1.0)


def person(seconds: float, rate_hz: float, seed: int, settings: PersonSettings | None = None) -> Array:
    """Return joints ``(frames, 15, 3)`` [m] of somebody made up, z up, who begins near the origin.

    Raises
    ------
    SetupError
        A number is out of its range.
    """
    require_number("made-up person: seconds", seconds, 0.1, 3600.0)
    require_number("made-up person: rate_hz", rate_hz, 1.0, 1000.0)
    chosen, rng = settings or PersonSettings(), np.random.default_rng(seed)
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    h = float(rng.uniform(*chosen.height_m))
    speed, heading = _way(t, rng, chosen)
    lean = _moves(t, rng, chosen, lambda: 0.05 if rng.random() < 0.6 else rng.uniform(0.1, 0.9), pause=2.0)
    squat = _moves(t, rng, chosen, lambda: 0.0 if rng.random() < 0.75 else rng.uniform(0.05, 0.22), pause=2.0)
    lean, squat = lean * np.exp(-2.0 * speed), squat * np.exp(-2.0 * speed)
    step, phase = _steps(t, speed, float(rng.uniform(0.85, 1.15)))
    twist = 0.12 * step * np.sin(phase) + _moves(t, rng, chosen, lambda: rng.uniform(-0.5, 0.5), pause=1.5)
    body = _trunk(h, lean, twist, squat * h, step, phase)
    _put_arms(body, h, twist, step, phase, t, rng, chosen)
    _put_legs(body, h, step, phase)
    return _placed(body, t, speed, heading)


def people(count: int, seconds: float, rate_hz: float, seed: int) -> list[Array]:
    """Return so many made-up people; the same for the same seed."""
    seeds = np.random.SeedSequence(seed).generate_state(count)
    return [person(seconds, rate_hz, int(each)) for each in seeds]


def minimum_jerk(share: Array) -> Array:
    """Return how far along the way one is, ``share`` of the time, by minimum jerk; at rest outside 0 to 1."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s * s))


def _moves(
    t: Array,
    rng: np.random.Generator,
    chosen: PersonSettings,
    draw: Callable[[], float | Array],
    pause: float = 1.0,
) -> Array:
    """Return a number or place over time that goes from one draw to the next, and pauses there."""
    at = np.asarray(draw(), dtype=float)
    out, begin = np.broadcast_to(at, (len(t), *at.shape)).copy(), float(rng.uniform(-1.0, 1.0))
    while begin < t[-1]:
        begin += pause * float(rng.uniform(*chosen.pause_s))
        takes = float(rng.uniform(*chosen.reach_s))
        there = np.asarray(draw(), dtype=float)
        share = minimum_jerk((t - begin) / takes)
        out += share.reshape(-1, *[1] * at.ndim) * (there - at)
        at, begin = there, begin + takes
    return out


def _way(t: Array, rng: np.random.Generator, chosen: PersonSettings) -> tuple[Array, Array]:
    """Return speed [m/s] and heading [rad] over time."""
    heading = np.full(len(t), rng.uniform(-np.pi, np.pi))
    if rng.random() < chosen.still:
        return np.zeros(len(t)), heading + 0.3 * _moves(t, rng, chosen, lambda: rng.uniform(-1.0, 1.0), 3.0)

    def next_speed() -> float:
        return float(rng.uniform(*chosen.speed_m_s)) if rng.random() < 0.7 else 0.0

    speed = _moves(t, rng, chosen, next_speed, pause=2.0)
    turning = _moves(t, rng, chosen, lambda: rng.normal(0.0, 0.6) if rng.random() < 0.6 else 0.0)
    return speed, heading + np.cumsum(turning * np.minimum(speed, 1.0)) * (t[1] - t[0])


def _steps(t: Array, speed: Array, liveliness: float) -> tuple[Array, Array]:
    """Return how far steps go, 0 to about 1.3 of an ordinary one, and where in a double step one is [rad]."""
    step = liveliness * np.sqrt(np.clip(speed, 0.0, None) / 1.3)
    double_step_m = 0.5 + 0.8 * np.sqrt(np.clip(speed, 0.05, None) / 1.3)
    return step, np.cumsum(2.0 * np.pi * speed / double_step_m) * (t[1] - t[0])


def _trunk(h: float, lean: Array, twist: Array, down: Array, step: Array, phase: Array) -> Array:
    """Return joints with trunk, shoulders and hips set, x ahead, y left, origin below the pelvis."""
    body = np.zeros((len(lean), JOINTS, 3))
    pelvis = np.zeros((len(lean), 3))
    pelvis[:, 2] = _HIP * h - down - 0.02 * step - 0.015 * step * np.cos(2.0 * phase)
    pelvis[:, 0] = -0.25 * lean * h * 0.3
    pelvis[:, 1] = 0.02 * step * np.cos(phase)
    up = np.stack((np.sin(lean), np.zeros_like(lean), np.cos(lean)), axis=1)
    ahead = np.stack((np.cos(lean), np.zeros_like(lean), -np.sin(lean)), axis=1)
    left = np.broadcast_to((0.0, 1.0, 0.0), up.shape)
    forward, aside = _turned(ahead, left, twist)
    neck = pelvis + (_NECK - _HIP) * h * up
    body[:, Joint.L3] = pelvis + _L3_SHARE * (neck - pelvis)
    body[:, Joint.CLAV], body[:, Joint.C7] = neck + _BEFORE_NECK_M * forward, neck - _BEFORE_NECK_M * forward
    shoulders = pelvis + (_SHOULDER - _HIP) * h * up
    body[:, Joint.LSHO] = shoulders + _HALF_SHOULDERS * h * aside
    body[:, Joint.RSHO] = shoulders - _HALF_SHOULDERS * h * aside
    _, across = _turned(ahead * (1.0, 0.0, 0.0), left, -0.1 * step * np.sin(phase))
    body[:, Joint.LHIP], body[:, Joint.RHIP] = (
        pelvis + _HALF_HIPS * h * across,
        pelvis - _HALF_HIPS * h * across,
    )
    return body


def _turned(ahead: Array, left: Array, angle: Array) -> tuple[Array, Array]:
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return c * ahead + s * left, c * left - s * ahead


def _put_arms(
    body: Array,
    h: float,
    twist: Array,
    step: Array,
    phase: Array,
    t: Array,
    rng: np.random.Generator,
    chosen: PersonSettings,
) -> None:
    """Set elbows and wrists: hands go from place to place before the chest, or hang and swing."""
    reach = (_UPPER_ARM + _FOREARM) * h
    busy = rng.random(2) < (0.8, 0.5)
    for k, (shoulder, elbow, wrist) in enumerate(
        ((Joint.RSHO, Joint.RAEL, Joint.RWPS), (Joint.LSHO, Joint.LAEL, Joint.LWPS))
    ):
        side, hangs = (-1.0 if k == 0 else 1.0), float(rng.uniform(0.85, 0.98))

        def place(side: float = side, hangs: float = hangs, busy: bool = bool(busy[k])) -> Array:
            if not busy or rng.random() < 0.3:
                return np.array([0.1, 0.08 * side, -hangs])
            away = np.array([rng.uniform(0.3, 1.0), side * rng.uniform(-0.4, 0.7), rng.uniform(-0.7, 0.8)])
            return np.asarray(away / np.linalg.norm(away) * rng.uniform(0.45, 0.98))

        hand = reach * _around(_moves(t, rng, chosen, place))
        swing = (1.0 if k == 0 else -1.0) * 0.35 * step * np.sin(phase) * np.clip(-hand[:, 2] / reach, 0, 1)
        hand = np.stack(
            (
                np.cos(swing) * hand[:, 0] - np.sin(swing) * hand[:, 2],
                hand[:, 1],
                np.sin(swing) * hand[:, 0] + np.cos(swing) * hand[:, 2],
            ),
            axis=1,
        )
        hand[:, :2] = np.stack(_rotate(hand[:, 0], hand[:, 1], twist), axis=1)
        pole = np.array([-0.3, 1.0 * side, -0.6])
        body[:, elbow], body[:, wrist] = _bent(body[:, shoulder], hand, _UPPER_ARM * h, _FOREARM * h, pole)


def _around(hand: Array) -> Array:
    """Return ways of a hand, in arm lengths, that do not go through the shoulder but before it."""
    near = np.clip(0.5 - np.linalg.norm(hand, axis=1, keepdims=True), 0.0, None)
    return np.asarray(hand + near * np.array([1.0, 0.0, -0.3]))


def _put_legs(body: Array, h: float, step: Array, phase: Array) -> None:
    """Set knees and heels: feet go round below the hips, and stay at the floor in between."""
    for side, hip, knee, heel in (
        (1.0, Joint.LHIP, Joint.LKNE, Joint.LHEE),
        (-1.0, Joint.RHIP, Joint.RKNE, Joint.RHEE),
    ):
        foot = np.zeros((len(step), 3))
        foot[:, 0] = -0.3 * side * step * np.sin(phase)
        foot[:, 1] = 0.9 * side * _HALF_HIPS * h
        foot[:, 2] = _ANKLE * h + 0.16 * step * np.clip(-side * np.cos(phase), 0.0, None)
        body[:, knee], body[:, heel] = _bent(
            body[:, hip], foot - body[:, hip], _THIGH * h, _SHANK * h, np.array([1.0, 0.1 * side, 0.0])
        )


def _bent(root: Array, away: Array, upper: float, lower: float, pole: Array) -> tuple[Array, Array]:
    """Return middle and end of two bones from ``root``, bent towards ``pole``; never quite stretched."""
    far = np.linalg.norm(away, axis=1, keepdims=True)
    length = np.clip(far, abs(upper - lower) + 0.02, 0.995 * (upper + lower))
    along = away / np.maximum(far, 1e-9)
    aside = pole - (along @ pole)[:, None] * along
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-9)
    share = (length**2 + upper**2 - lower**2) / (2.0 * length)
    out = np.sqrt(np.maximum(upper**2 - share**2, 0.0))
    return root + share * along + out * aside, root + length * along


def _rotate(x: Array, y: Array, angle: Array) -> tuple[Array, Array]:
    return np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y


def _placed(body: Array, t: Array, speed: Array, heading: Array) -> Array:
    """Return the joints in the world, walked along the way."""
    out = body.copy()
    out[..., 0], out[..., 1] = _rotate(body[..., 0], body[..., 1], heading[:, None])
    dt = t[1] - t[0]
    out[..., 0] += (np.cumsum(speed * np.cos(heading)) * dt)[:, None]
    out[..., 1] += (np.cumsum(speed * np.sin(heading)) * dt)[:, None]
    return out
