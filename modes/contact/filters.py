"""The four filters of the paper, each as it is printed and corrected, at any sampling rate.

Mariotti, Magrini and De Luca, *Admittance control for human-robot interaction using an industrial robot
equipped with a F/T sensor*, (7), (9), (11) to (15). Cut-offs below are where the gain is 1/√2, at 83.3 Hz.

============================ ======================== ====================================================
filter                       variant                  what it really is
============================ ======================== ====================================================
currents, high-pass (7)      as printed               no Chebyshev filter of order 3, which would need
                                                      feedback, but four taps: a smoothed difference, with
                                                      a gain of 1.226 at its highest, near 20 Hz; 7.5 Hz
                                                      from a gain of 1, 9.6 Hz from its highest
currents, high-pass (7)      corrected                Chebyshev of order 3, type 1: -0.5 dB at 10 Hz, 8.7 Hz
currents, low-pass (9)       as printed               mean of three samples, whatever the rate; 12.9 Hz
currents, low-pass (9)       corrected                mean over 36 ms: the same three samples at 83.3 Hz
forces, high-pass (11), (12) as printed               "15 Hz" with the coefficient of a low-pass, 0.5307:
                                                      7.9 Hz from its highest gain, 0.693
forces, high-pass (11), (12) corrected                the coefficient that (11) needs, 0.4693: 9.2 Hz from
                                                      its highest gain, 0.639, which is below 1/√2
forces, high-pass (11), (12) exact                    15 Hz where it says, and a gain of 1 at the top
forces, low-pass (13), (15)  as printed               0.2738, right by (14); 4.3 Hz
forces, low-pass (13), (15)  corrected                0.3141, the pole of an analogue one: 5.1 Hz
forces, low-pass (13), (15)  exact                    5 Hz where it says
============================ ======================== ====================================================
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.signal import butter, cheby1, freqz, lfilter_zi

from modes.contact import kernels
from modes.settings import require_choice, require_number

Array = NDArray[np.float64]
Variant = Literal["as_printed", "corrected", "exact"]
VARIANTS: tuple[Variant, ...] = ("as_printed", "corrected", "exact")

RATE_HZ = 1.0 / 0.012
"""The paper's: one sample in 12 ms."""
_TAPS = (-0.239207, -0.6262528, 0.6262528, 0.2392073)
_WINDOW_S = 0.036
_HIGH_HZ, _LOW_HZ = 15.0, 5.0
_EDGE_HZ, _RIPPLE_DB = 10.0, 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Filter:
    """A digital filter a[0] y_k = Σ b[i] x_{k-i} - Σ a[i] y_{k-i}.

    Attributes
    ----------
    b, a:
        Coefficients, of one length; a[0] is 1.
    rate_hz:
        At which samples come [Hz].
    """

    b: Array
    a: Array
    rate_hz: float

    def gain(self, frequency_hz: Array | float) -> Array:
        """Return the gain at frequencies [Hz]."""
        at = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        return np.asarray(np.abs(freqz(self.b, self.a, worN=at, fs=self.rate_hz)[1]))

    def highest_gain(self) -> tuple[float, float]:
        """Return the highest gain, and where it is [Hz]."""
        at = np.linspace(0.0, 0.5 * self.rate_hz, 20_001)
        gains = self.gain(at)
        return float(gains.max()), float(at[gains.argmax()])

    def cut_off_hz(self, *, of_highest: bool = False) -> float:
        """Return where the gain is 1/√2, or 1/√2 of its highest [Hz]; NaN: nowhere.

        The lowest of such frequencies.
        """
        level = math.sqrt(0.5) * (self.highest_gain()[0] if of_highest else 1.0)
        at = np.linspace(0.0, 0.5 * self.rate_hz, 2001)
        over = self.gain(at) > level
        changes = np.flatnonzero(over[1:] != over[:-1])
        if not len(changes):
            return math.nan
        k = int(changes[0])
        return float(brentq(lambda f: float(self.gain(f)[0]) - level, at[k], at[k + 1], xtol=1e-9))


class Stream:
    """A filter that runs: sample after sample of some channels.

    Parameters
    ----------
    design:
        The filter.
    channels:
        How many.
    """

    def __init__(self, design: Filter, channels: int) -> None:
        self._b, self._a = design.b.copy(), design.a.copy()
        self._rest = lfilter_zi(design.b, design.a)
        self._state = np.zeros((len(design.b) - 1, channels))
        self._out = np.zeros(channels)
        self._begun = False

    def step(self, x: Array) -> Array:
        """Take a sample (channels,) and return what comes out; before the first one x has always been so."""
        self.settle(x)
        kernels.advance(self._b, self._a, self._state, x, self._out)
        return self._out.copy()

    def settle(self, x: Array) -> None:
        """Take what has not begun to have been at ``x`` (channels,) for ever."""
        if not self._begun:
            self._state[:] = self._rest[:, None] * x
            self._begun = True

    @property
    def parts(self) -> tuple[Array, Array, Array]:
        """Return coefficients b and a and the state, for a kernel that advances it."""
        return self._b, self._a, self._state

    def forget(self) -> None:
        """Begin anew with the next sample."""
        self._begun = False


def current_high_pass(variant: Variant = "corrected", rate_hz: float = RATE_HZ) -> Filter:
    """Return (7): what of a current changes fast; *exact* is *corrected*."""
    _check(variant, rate_hz, _EDGE_HZ)
    if variant == "as_printed":
        return Filter(np.array(_TAPS), np.array([1.0, 0.0, 0.0, 0.0]), rate_hz)
    b, a = cheby1(3, _RIPPLE_DB, _EDGE_HZ, "highpass", fs=rate_hz)
    return Filter(b, a, rate_hz)


def current_low_pass(variant: Variant = "corrected", rate_hz: float = RATE_HZ) -> Filter:
    """Return (9): the mean of the last samples; *exact* is *corrected*."""
    _check(variant, rate_hz, 0.0)
    n = 3 if variant == "as_printed" else max(1, round(_WINDOW_S * rate_hz))
    length = max(n, 2)  # one coefficient would have no state
    b = np.zeros(length)
    b[:n] = 1.0 / n
    return Filter(b, np.eye(1, length)[0], rate_hz)


def force_high_pass(variant: Variant = "corrected", rate_hz: float = RATE_HZ) -> Filter:
    """Return (11): what of a force changes fast."""
    _check(variant, rate_hz, _HIGH_HZ)
    if variant == "exact":
        b, a = butter(1, _HIGH_HZ, "highpass", fs=rate_hz)
        return Filter(b, a, rate_hz)
    share = _smoothing(_HIGH_HZ, rate_hz)
    alpha = share if variant == "as_printed" else 1.0 - share
    return Filter(np.array([alpha, -alpha]), np.array([1.0, -alpha]), rate_hz)


def force_low_pass(variant: Variant = "corrected", rate_hz: float = RATE_HZ) -> Filter:
    """Return (13): what of a force lasts."""
    _check(variant, rate_hz, _LOW_HZ)
    if variant == "as_printed":
        alpha = _smoothing(_LOW_HZ, rate_hz)
    elif variant == "corrected":
        alpha = -math.expm1(-2.0 * math.pi * _LOW_HZ / rate_hz)
    else:
        c = math.cos(2.0 * math.pi * _LOW_HZ / rate_hz)
        alpha = math.sqrt((1.0 - c) * (3.0 - c)) - (1.0 - c)
    return Filter(np.array([alpha, 0.0]), np.array([1.0, alpha - 1.0]), rate_hz)


def _smoothing(cut_off_hz: float, rate_hz: float) -> float:
    """Return (14): T_c / (T_c + T_co)."""
    period, constant = 1.0 / rate_hz, 1.0 / (2.0 * math.pi * cut_off_hz)
    return period / (period + constant)


def _check(variant: str, rate_hz: float, cut_off_hz: float) -> None:
    require_choice("filter: variant", variant, VARIANTS)
    require_number("filter: rate_hz", rate_hz, max(2.2 * cut_off_hz, 1.0), 1e6)
