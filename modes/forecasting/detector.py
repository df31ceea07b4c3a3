"""A detector of landmarks in a process of its own: it may be slow, hang or crash, and nobody waits long.

Image and answer are handed over one at a time: the image in shared memory, the answer, a kilobyte, in a pipe.
Nothing is ever written before the other side waits for it, so that neither side can block the other. The
process ends with its owner, even one that was killed.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from enum import StrEnum
from multiprocessing import shared_memory
from multiprocessing.connection import Connection, wait
from pickle import PicklingError
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modes.forecasting.landmarks import wrong_landmarks
from modes.settings import require_count, require_number
from robots.errors import SetupError

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Detect = Callable[[Image], Array | None]
"""Image (height, width, 3) of red, green, blue -> (33, 3): u, v [px], visibility; ``None``: nobody."""

_END_S = 1.0


class DetectionOutcome(StrEnum):
    """What came of a detection."""

    FOUND = "somebody was found"
    NOBODY = "nobody was found"
    WRONG_IMAGE = "an image of another size or kind"
    WRONG_LANDMARKS = "landmarks of another number or kind"
    TIMED_OUT = "the detector did not answer in time"
    ENDED = "the process of the detector has ended"


class Detection(NamedTuple):
    """What came of a detection: (33, 3) landmarks where somebody was FOUND; in one line what is wrong."""

    outcome: DetectionOutcome
    landmarks: Array | None = None
    detail: str = ""


@dataclass(frozen=True)
class MediaPipePose:
    """Makes a detector of MediaPipe Pose, of at most one person; tried with mediapipe 0.10.14.

    Attributes
    ----------
    complexity:
        Its model: 0, 1 or 2. The package contains model 1 only, and fetches others from the network.
    detection_confidence, tracking_confidence:
        Its thresholds, with its own defaults.
    follow:
        Whether a person is followed from image to image, and only looked for when lost.
    """

    complexity: int = 1
    detection_confidence: float = 0.5
    tracking_confidence: float = 0.5
    follow: bool = True

    def __post_init__(self) -> None:
        require_count("MediaPipe Pose: complexity", self.complexity, 0, 2)
        for name in ("detection_confidence", "tracking_confidence"):
            require_number(f"MediaPipe Pose: {name}", getattr(self, name), 0.0, 1.0)

    def __call__(self) -> Detect:
        """Return the detector.

        Raises
        ------
        SetupError
            mediapipe is not installed.
        """
        try:
            import mediapipe
        except ImportError as error:
            raise SetupError(f"poses need mediapipe ({error}): pip install 'stopproof[pose]'") from error
        solutions = getattr(mediapipe, "solutions", None)
        if solutions is None:
            raise SetupError(
                f"mediapipe {mediapipe.__version__} has no solutions: pip install 'stopproof[pose]'"
            )
        pose = solutions.pose.Pose(
            static_image_mode=not self.follow,
            model_complexity=self.complexity,
            min_detection_confidence=self.detection_confidence,
            min_tracking_confidence=self.tracking_confidence,
        )

        def detect(image: Image) -> Array | None:
            found = pose.process(image).pose_landmarks
            if found is None:
                return None
            height, width = image.shape[:2]
            # shares of the image are from its rim; pixels are counted from the centre of the first
            rows = [(m.x * width - 0.5, m.y * height - 0.5, m.visibility) for m in found.landmark]
            return np.array(rows, dtype=np.float64)

        return detect


class DetectorProcess:
    """Runs a detector in a process of its own; a context that ends it.

    Parameters
    ----------
    make:
        Called in that process, returns the detector: a function of a module, or :class:`MediaPipePose`.
    width, height:
        Of the images [px].
    timeout_s:
        How long :meth:`detect` waits for an answer [s].
    start_s:
        How long it may take until the detector is made [s].

    Raises
    ------
    SetupError
        The process did not begin in time, ended, or says why it cannot make the detector.
    """

    def __init__(
        self,
        make: Callable[[], Detect],
        width: int,
        height: int,
        *,
        timeout_s: float = 0.5,
        start_s: float = 60.0,
    ) -> None:
        require_count("detector: width", width, 16, 20_000)
        require_count("detector: height", height, 16, 20_000)
        require_number("detector: timeout_s", timeout_s, 0.0, 60.0, above=True)
        require_number("detector: start_s", start_s, 0.0, 600.0, above=True)
        self._shape, self._timeout_s = (height, width, 3), timeout_s
        self._asked, self._answered = 1, 0  # the first question is whether it has begun
        self._memory = shared_memory.SharedMemory(create=True, size=height * width * 3)
        self._image: Image | None = np.ndarray(self._shape, dtype=np.uint8, buffer=self._memory.buf)
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process = context.Process(
            target=_run, args=(make, self._memory.name, self._shape, there), daemon=True
        )
        with ExitStack() as unless_begun:
            unless_begun.callback(self.close)
            try:
                self._process.start()
            except (AttributeError, TypeError, PicklingError) as error:
                raise SetupError(f"detector: make = {make!r} should be a function of a module") from error
            finally:
                there.close()  # from now on the pipe ends with the process
            self._begin(start_s)
            unless_begun.pop_all()

    def _begin(self, start_s: float) -> None:
        if not self._pipe.poll(start_s):
            raise SetupError(f"detector: did not begin within start_s = {start_s:g} s")
        try:
            said = self._pipe.recv()
        except (EOFError, OSError):
            self._process.join(_END_S)
            code = self._process.exitcode
            raise SetupError(f"detector: its process ended before it began, exit status {code}") from None
        if said != "ready":
            raise SetupError(str(said))
        self._answered = self._asked

    def detect(self, image: Image) -> Detection:
        """Return what the detector finds in an image (height, width, 3), or why there is no answer.

        Takes no longer than the time-out, and raises nothing. An answer that comes later is dropped; until it
        has come, the detector is not asked anew.
        """
        if self._image is None:
            return Detection(DetectionOutcome.ENDED, detail="it was closed")
        flaw = self._wrong_image(image)
        if flaw is not None:
            return Detection(DetectionOutcome.WRONG_IMAGE, detail=flaw)
        until = time.monotonic() + self._timeout_s
        try:
            while self._answered < self._asked:  # the answer to an image that took too long
                if not self._pipe.poll(max(0.0, until - time.monotonic())):
                    return self._late()
                self._answered = self._pipe.recv()[0]
            self._image[...] = image
            self._asked += 1
            self._pipe.send(self._asked)
            if not self._pipe.poll(max(0.0, until - time.monotonic())):
                return self._late()
            self._answered, found = self._pipe.recv()
        except (EOFError, OSError):
            self._process.join(_END_S)
            return Detection(DetectionOutcome.ENDED, detail=f"exit status {self._process.exitcode}")
        return _judged(found)

    def _late(self) -> Detection:
        return Detection(DetectionOutcome.TIMED_OUT, detail=f"no answer within {self._timeout_s:g} s")

    def _wrong_image(self, image: object) -> str | None:
        if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
            kind = image.dtype.name if isinstance(image, np.ndarray) else type(image).__name__
            return f"image of {kind} should be an array of uint8"
        if image.shape != self._shape:
            return f"image of shape {image.shape} should be {self._shape}"
        return None

    def close(self) -> None:
        """End the process; may be called again."""
        self._pipe.close()
        if self._process.pid is not None:
            self._process.join(_END_S if self._answered == self._asked else 0.0)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
        if self._image is not None:
            self._image = None
            self._memory.close()
            self._memory.unlink()

    def __enter__(self) -> DetectorProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _judged(found: Array | str | None) -> Detection:
    """Return the detection that an answer means; a text says what is wrong with it."""
    if found is None:
        return Detection(DetectionOutcome.NOBODY)
    if isinstance(found, str):
        return Detection(DetectionOutcome.WRONG_LANDMARKS, detail=found)
    return Detection(DetectionOutcome.FOUND, found)


def _run(make: Callable[[], Detect], memory: str, shape: tuple[int, int, int], pipe: Connection) -> None:
    """Body of the process: one answer to each number that comes, until the pipe is closed."""
    threading.Thread(target=_end_with_owner, daemon=True).start()
    shared = shared_memory.SharedMemory(memory)
    image: Image = np.ndarray(shape, dtype=np.uint8, buffer=shared.buf)
    try:
        detect = make()
    except SetupError as error:
        pipe.send(str(error))
        return
    said: object = "ready"
    while True:
        try:
            pipe.send(said)
            number = pipe.recv()
        except (EOFError, OSError):
            return  # the owner has closed the pipe, or has ended
        said = (number, _answer(detect(image.copy())))


def _answer(found: object) -> Array | str | None:
    """Return what fits through a pipe at once: landmarks, or what is wrong with them."""
    wrong = None if found is None else wrong_landmarks(found)
    if found is None or wrong is not None:
        return wrong
    return np.asarray(found, dtype=np.float64)


def _end_with_owner() -> None:
    """End this process when the one that began it has: a detector that hangs would not notice."""
    owner = multiprocessing.parent_process()
    if owner is not None:
        wait([owner.sentinel])
        os._exit(0)
