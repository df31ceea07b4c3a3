"""The detector's process: real ones that answer, hang, crash and are killed; MediaPipe where it is there."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from modes.forecasting.camera import LEVEL, Intrinsics, Mounting
from modes.forecasting.detector import (
    Detect,
    Detection,
    DetectionOutcome,
    DetectorProcess,
    Image,
    MediaPipePose,
)
from modes.forecasting.landmarks import Landmark
from modes.forecasting.pose import Camera, FrameOutcome, report_of_detection
from occupancy.body import Point
from robots.errors import SetupError
from tests.modes.forecasting import scripted_detectors as scripted
from tests.source_files import ROOT

WIDTH, HEIGHT = scripted.SIZE


def image(order: int) -> Image:
    return np.full((HEIGHT, WIDTH, 3), order, dtype=np.uint8)


def process(make: Callable[[], Detect], timeout_s: float = 20.0, start_s: float = 60.0) -> DetectorProcess:
    return DetectorProcess(make, WIDTH, HEIGHT, timeout_s=timeout_s, start_s=start_s)


def local_to_a_test() -> Callable[[], Detect]:
    def make() -> Detect:
        return scripted.brightness()

    return make


@pytest.fixture(scope="module")
def patient() -> Iterator[DetectorProcess]:
    with process(scripted.brightness) as found:
        yield found


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and was not waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_each_answer_is_that_of_its_image(patient: DetectorProcess, rng: np.random.Generator) -> None:
    for order in rng.integers(1, 255, 30):
        found = patient.detect(image(int(order)))
        assert found.outcome is DetectionOutcome.FOUND
        assert found.landmarks is not None and (found.landmarks == order).all()
        assert found.landmarks.shape == (33, 3)
    assert patient.detect(image(0)) == Detection(DetectionOutcome.NOBODY)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (np.zeros((HEIGHT, WIDTH, 4), dtype=np.uint8), "(24, 32, 4) should be (24, 32, 3)"),
        (np.zeros((WIDTH, HEIGHT, 3), dtype=np.uint8), "should be (24, 32, 3)"),
        (np.zeros((HEIGHT, WIDTH, 3)), "image of float64"),
        (None, "image of NoneType"),
    ],
)
def test_an_image_of_another_kind_is_not_handed_over(patient: DetectorProcess, wrong: Any, says: str) -> None:
    found = patient.detect(wrong)
    assert found.outcome is DetectionOutcome.WRONG_IMAGE and says in found.detail and "\n" not in found.detail
    assert patient.detect(image(3)).outcome is DetectionOutcome.FOUND


def test_landmarks_of_another_number_are_refused_in_one_line() -> None:
    with process(scripted.obeying) as obeying:
        for order, says in ((5, "(17, 3)"), (6, "str"), (7, "(1000000, 3)")):
            found = obeying.detect(image(order))
            assert found.outcome is DetectionOutcome.WRONG_LANDMARKS
            assert says in found.detail and "\n" not in found.detail
            assert obeying.detect(image(9)).outcome is DetectionOutcome.FOUND


@pytest.mark.parametrize("order", [1, 2, 8])
def test_a_process_that_ends_is_an_outcome(order: int) -> None:
    with process(scripted.obeying) as obeying:
        started = time.monotonic()
        found = obeying.detect(image(order))
        assert found.outcome is DetectionOutcome.ENDED and "exit status" in found.detail
        assert obeying.detect(image(9)).outcome is DetectionOutcome.ENDED
        assert time.monotonic() - started < 15.0


def test_a_process_that_hangs_times_out_each_time_and_is_ended() -> None:
    obeying = process(scripted.obeying, timeout_s=0.2)
    started = time.monotonic()
    assert obeying.detect(image(3)).outcome is DetectionOutcome.TIMED_OUT
    assert obeying.detect(image(9)).outcome is DetectionOutcome.TIMED_OUT
    pid = obeying._process.pid
    assert pid is not None and is_alive(pid)
    obeying.close()
    assert time.monotonic() - started < 15.0
    assert not is_alive(pid)
    assert obeying.detect(image(9)) == Detection(DetectionOutcome.ENDED, detail="it was closed")
    obeying.close()


def test_a_process_that_was_stopped_times_out() -> None:
    with process(scripted.brightness, timeout_s=0.2) as stopped:
        os.kill(stopped._process.pid or 0, signal.SIGSTOP)
        assert stopped.detect(image(3)).outcome is DetectionOutcome.TIMED_OUT
        assert stopped.detect(image(4)).outcome is DetectionOutcome.TIMED_OUT


def test_a_late_answer_is_never_taken_for_that_of_the_next_image() -> None:
    with process(scripted.obeying, timeout_s=0.5 * scripted.SLOW_S) as obeying:
        assert obeying.detect(image(4)).outcome is DetectionOutcome.TIMED_OUT
        answers = [obeying.detect(image(9)) for _ in range(20)]
    found = [each.landmarks[0, 0] for each in answers if each.landmarks is not None]
    assert found and set(found) == {9.0}


@pytest.mark.parametrize(
    ("make", "start_s", "says"),
    [
        (scripted.refusing, 60.0, "no model here"),
        (scripted.crashing, 60.0, "ended before it began, exit status 1"),
        (scripted.never, 0.1, "did not begin within start_s = 0.1 s"),
        (local_to_a_test(), 60.0, "should be a function of a module"),
    ],
)
def test_what_does_not_begin_says_why(make: Callable[[], Detect], start_s: float, says: str) -> None:
    with pytest.raises(SetupError) as caught:
        process(make, start_s=start_s)
    assert says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "wrong",
    [{"width": 0}, {"height": 1.5}, {"timeout_s": 0.0}, {"timeout_s": float("inf")}, {"start_s": -1.0}],
)
def test_wrong_settings_are_refused_by_name(wrong: dict[str, Any]) -> None:
    (name,) = wrong
    with pytest.raises(SetupError, match=f"^detector: {name} = "):
        DetectorProcess(scripted.brightness, **({"width": WIDTH, "height": HEIGHT} | wrong))


OWNER = """
import time
import numpy as np
from modes.forecasting.detector import DetectorProcess
from tests.modes.forecasting import scripted_detectors as scripted
if __name__ == "__main__":
    width, height = scripted.SIZE
    image = np.ones((height, width, 3), dtype=np.uint8)
    detector = DetectorProcess(scripted.own_process, width, height, timeout_s=20.0)
    print(int(detector.detect(image).landmarks[0, 0]), detector._memory.name, flush=True)
    detector.detect(image)
"""


def test_the_process_ends_with_an_owner_that_is_killed(tmp_path: Path) -> None:
    """Even while the detector hangs; the memory of the image goes, too."""
    script = tmp_path / "owner.py"
    script.write_text(OWNER, encoding="utf-8")
    owner = subprocess.Popen(
        [sys.executable, str(script)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert owner.stdout is not None
        number, name = owner.stdout.readline().split()
        pid, memory = int(number), Path("/dev/shm") / name
        assert is_alive(pid) and memory.exists()
    finally:
        owner.kill()
        owner.wait()
    until = time.monotonic() + 20.0
    while (is_alive(pid) or memory.exists()) and time.monotonic() < until:
        time.sleep(0.02)
    assert not is_alive(pid) and not memory.exists()


def test_without_mediapipe_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mediapipe", None)
    with pytest.raises(SetupError, match=r"pip install 'stopproof\[pose\]'"):
        MediaPipePose()()


@pytest.mark.parametrize(
    "wrong", [{"complexity": 3}, {"detection_confidence": 1.5}, {"tracking_confidence": "1"}]
)
def test_wrong_settings_of_mediapipe_are_refused(wrong: dict[str, Any]) -> None:
    (name,) = wrong
    with pytest.raises(SetupError, match=f"MediaPipe Pose: {name} = "):
        MediaPipePose(**wrong)


def test_mediapipe_finds_an_astronaut() -> None:
    """A photograph of a woman's upper body, with a made-up depth: she is 1.2 m away, the wall 3 m.

    Where she is in the picture was read from it by eye: the nose, both shoulders of the suit.
    """
    reason = "mediapipe is not part of a usual run: with what it needs it takes 0.8 GB; pip install '.[pose]'"
    pytest.importorskip("mediapipe", reason=reason)
    photograph = pytest.importorskip("skimage.data", reason="the photograph is scikit-image's").astronaut()
    height, width = photograph.shape[:2]
    v, u = np.mgrid[0:height, 0:width]
    head, trunk = np.hypot(u - 220, v - 120) < 75, (v > 190) & (u > 60) & (u < 360)
    depth = np.where(head | trunk, 1200, 3000).astype(np.uint16)
    depth[v % 7 == 0] = 0
    camera = Camera(Intrinsics(600.0, 600.0, 256.0, 256.0, width, height), Mounting(), 0.001)
    with DetectorProcess(MediaPipePose(), width, height, timeout_s=20.0) as detector:
        assert detector.detect(np.zeros_like(photograph)).outcome is DetectionOutcome.NOBODY
        found = detector.detect(np.ascontiguousarray(photograph))
    assert found.outcome is DetectionOutcome.FOUND and found.landmarks is not None
    by_eye = {
        Landmark.NOSE: (222, 128),
        Landmark.LEFT_SHOULDER: (320, 255),
        Landmark.RIGHT_SHOULDER: (95, 250),
    }
    for landmark, place in by_eye.items():
        assert np.hypot(*(found.landmarks[landmark, :2] - place)) < 35.0, landmark.name
    out = report_of_detection(found, depth, LEVEL, 0.0, 0.1, camera)
    assert out.outcome is FrameOutcome.MEASURED and out.report is not None
    (person,) = out.report.people
    measured = {point for point in Point if person.measured >> point & 1}
    assert measured >= {Point.HEAD, Point.L_SHOULDER, Point.R_SHOULDER}
    assert not measured & {Point.L_KNEE, Point.R_KNEE, Point.L_ANKLE, Point.R_ANKLE}, "they are not in it"
    across = person.xyz[Point.L_SHOULDER] - person.xyz[Point.R_SHOULDER]
    assert across[0] == pytest.approx(225 * 1.26 / 600, abs=2 * 35 * 1.26 / 600) and abs(across[2]) < 0.08
