"""How many points of rendered people are measured, how often their stated errors hold, and how long it takes.

    python -m bench.pose [--people N] [--images N] [--json -]

People of capsules and balls, 1.8 to 3.5 m away, before a wall; depth with the noise and bias that the
settings state, the same in squares of 16 px; landmarks off by up to 8 px; joints as deep in the flesh as
stated, up to 0.9 of the error of that. MediaPipe has a row where it is installed, on a photograph of
scikit-image where that is, too, else on an image of noise, in which it finds nobody. Elapsed time; medians.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.machine import describe_machine
from modes.forecasting.camera import LEVEL, Mounting
from modes.forecasting.depth import DepthSettings
from modes.forecasting.detector import DetectorProcess, MediaPipePose
from modes.forecasting.landmarks import MEASURED, Landmark
from modes.forecasting.pose import Camera, report_of_frame
from tests.modes.forecasting.rendered_person import CAMERA, noisy, render, scene

Image = NDArray[np.uint8]

WALLS_M = (2.0, 0.8, 0.3)
"""How far the wall is behind the person; 2 m is farther than the body is deep."""


def main() -> None:
    """Measure, and print tables or JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.pose")
    parser.add_argument("--people", type=int, default=300, help="rendered people before each wall")
    parser.add_argument("--images", type=int, default=100, help="images for MediaPipe")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    options = parser.parse_args()
    found: dict[str, Any] = {"machine": describe_machine(), "people": options.people}
    found["walls"] = [_covered(wall, options.people) for wall in WALLS_M]
    if find_spec("mediapipe") is not None:
        found["mediapipe"] = _mediapipe(options.images)
    if options.json == "-":
        json.dump(found, sys.stdout, indent=1)
    else:
        print(f"{found['machine']['processor']}, {options.people} people", "", *_lines(found), sep="\n")


def _covered(wall_m: float, people: int) -> dict[str, Any]:
    """Return shares of points before a wall, the median of stated errors, and the time of a report."""
    rng, settings = np.random.default_rng(1), DepthSettings()
    camera = Camera(CAMERA, Mounting(), 1.0)
    measured, within, worst = 0, 0, 0.0
    stated, off, times = [], [], []
    for _ in range(people):
        who = scene(rng, share=0.9, behind_m=wall_m, depth_m=rng.uniform(1.8, 3.5))
        clean = render(who)
        sigma = settings.sigma_m(clean)
        bias = settings.error_m(clean) - settings.sigmas * sigma
        depth, landmarks = noisy(clean, who.landmarks(), rng, sigma, bias, 8.0)
        began = time.perf_counter()
        frame = report_of_frame(landmarks, depth, LEVEL, 0.0, 0.0, camera)
        times.append(1e3 * (time.perf_counter() - began))
        assert frame.report is not None
        (person,) = frame.report.people
        for point in MEASURED:
            if person.measured >> point & 1:
                away = float(np.linalg.norm(person.xyz[point] - who.truth(point)))
                measured, within = measured + 1, within + int(away <= person.error_m[point])
                worst = max(worst, away)
                stated.append(float(person.error_m[point]))
                off.append(away)
    return {
        "wall_m": wall_m,
        "points": people * len(MEASURED),
        "measured": measured,
        "within": within,
        "stated_error_m": float(np.median(stated)),
        "error_m": float(np.median(off)),
        "worst_m": worst,
        "report_ms": float(np.median(times)),
    }


def _mediapipe(images: int) -> dict[str, Any]:
    """Return how long MediaPipe takes for an image, there and back through its process."""
    image, name = _photograph()
    height, width = image.shape[:2]
    times = []
    began = time.perf_counter()
    with DetectorProcess(MediaPipePose(), width, height, timeout_s=20.0) as detector:
        start = time.perf_counter() - began
        for _ in range(images):
            began = time.perf_counter()
            landmarks = detector.detect(image).landmarks
            times.append(1e3 * (time.perf_counter() - began))
    seen = [] if landmarks is None else landmarks[:, 2].round(2).tolist()
    middle, high = np.percentile(times, [50.0, 99.0])
    return {
        "image": name,
        "start_s": start,
        "median_ms": float(middle),
        "p99_ms": float(high),
        "visibility": dict(zip((each.name.lower() for each in Landmark), seen, strict=False)),
    }


def _photograph() -> tuple[Image, str]:
    if find_spec("skimage") is None:
        noise = np.random.default_rng(1).integers(0, 255, (480, 640, 3), dtype=np.uint8)
        return noise, "noise, 640 by 480"
    from skimage.data import astronaut

    return np.ascontiguousarray(astronaut()), "astronaut, 512 by 512"


def _lines(found: dict[str, Any]) -> list[str]:
    lines = [
        "| wall, m | points | measured | within errors | error, m | stated, m | worst, m | report, ms |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for each in found["walls"]:
        share, within = each["measured"] / each["points"], each["within"] / max(each["measured"], 1)
        lines.append(
            f"| {each['wall_m']:g} | {each['points']} | {share:.1%} | {within:.2%} | "
            f"{each['error_m']:.3f} | {each['stated_error_m']:.3f} | {each['worst_m']:.3f} | "
            f"{each['report_ms']:.2f} |"
        )
    if "mediapipe" in found:
        each = found["mediapipe"]
        lines += [
            "",
            "| MediaPipe | start, s | median, ms | 99 %, ms |",
            "|---|---|---|---|",
            f"| {each['image']} | {each['start_s']:.1f} | {each['median_ms']:.0f} | {each['p99_ms']:.0f} |",
        ]
    else:
        lines += ["", "No rows of MediaPipe: not installed (pip install 'stopproof[pose]')."]
    return lines


if __name__ == "__main__":
    main()
