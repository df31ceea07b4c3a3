"""Detectors that do what a test wants, made in the process of a detector."""

from __future__ import annotations

import os
import signal
import time

import numpy as np

from modes.forecasting.detector import Array, Detect, Image
from robots.errors import SetupError

SIZE = (32, 24)
SLOW_S = 0.6


def brightness() -> Detect:
    """33 landmarks that tell the first pixel of the image; nobody in a black one."""

    def detect(image: Image) -> Array | None:
        return None if not image.any() else np.full((33, 3), float(image[0, 0, 0]))

    return detect


def obeying() -> Detect:
    """Does what the first pixel says: 1 crash, 2 be killed, 3 hang, 4 be slow, 5 too few landmarks, 6 a text,
    7 very many landmarks, 8 an error of the system."""

    def detect(image: Image) -> Array | None:
        order = int(image[0, 0, 0])
        match order:
            case 1:
                raise RuntimeError("as the test wants it")
            case 2:
                os.kill(os.getpid(), signal.SIGKILL)
            case 3:
                time.sleep(600.0)
            case 4:
                time.sleep(SLOW_S)
            case 5:
                return np.zeros((17, 3))
            case 6:
                return "somebody"  # type: ignore[return-value]  # that is what is tested
            case 7:
                return np.zeros((1_000_000, 3))
            case 8:
                raise OSError("as the test wants it")
        return np.full((33, 3), float(order))

    return detect


def refusing() -> Detect:
    raise SetupError("no model here")


def crashing() -> Detect:
    raise RuntimeError("as the test wants it")


def never() -> Detect:
    time.sleep(600.0)
    raise AssertionError


def own_process() -> Detect:
    """33 landmarks that tell the number of the process; then hangs."""
    asked = []

    def detect(image: Image) -> Array | None:
        asked.append(image)
        if len(asked) > 1:
            time.sleep(600.0)
        return np.full((33, 3), float(os.getpid()))

    return detect
