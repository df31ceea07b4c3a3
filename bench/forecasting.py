"""How far forecasts of people and filled joints are off, and how long they take, beside baselines.

    python -m bench.forecasting --recordings FOLDER [--repeats N] [--json -]

People are those of the recordings that the shipped weights were not trained on; windows end every 0.1 s, of
which 1 s at least was recorded. Joints that a recording lacks are stood in for, and not counted. Gaps are
made up, and seeded. Times are elapsed, on one core; *all* is from 3 s of measurements of 20 points to points
ahead, with hidden joints filled in.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from bench.machine import describe_machine, keep_to_one_core
from modes.forecasting.dataset import Recording, Windows, read_folder, windows_of
from modes.forecasting.errors import Errors, errors_by_horizon, errors_of_filling, gaps
from modes.forecasting.history import History
from modes.forecasting.model_card import read_card
from modes.forecasting.network import FORECASTERS, Forecaster, forecast_points, load_forecaster
from modes.forecasting.occlusion import Autoencoder, Carry, Filler, HoldPlace, Straight
from modes.forecasting.skeleton import joints_of_points
from modes.forecasting.weights_file import WEIGHTS
from modes.reaching_person import report_of
from robots.errors import SetupError

_WHOLE = "all"
_SEED = 0


def main() -> None:
    """Measure, and print the tables or JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.forecasting")
    parser.add_argument(
        "--recordings", type=Path, required=True, help="folder with recordings of people, NPZ"
    )
    parser.add_argument("--repeats", type=int, default=500, help="forecasts that are timed")
    parser.add_argument("--json", choices=["-"], help="write JSON to standard output")
    options = parser.parse_args()
    keep_to_one_core()
    trained = read_card(WEIGHTS / "card.toml")["subjects"]
    groups = _groups([each for each in read_folder(options.recordings) if each.subject not in trained])
    found: dict[str, Any] = {
        "machine": describe_machine(),
        "windows": {group: len(windows) for group, windows in groups.items()},
        "forecasts": _forecasts(groups),
        "filling": _filling(groups),
        "times": _times(options.repeats),
    }
    sys.stdout.write((json.dumps(found, indent=1) if options.json else "\n".join(_lines(found))) + "\n")


def _groups(recordings: list[Recording]) -> dict[str, Windows]:
    """Return windows by subject, and all of them."""
    parts: dict[str, list[Windows]] = {}
    for each in recordings:
        parts.setdefault(each.subject, []).append(windows_of(each))
    groups = {subject: Windows.of(each) for subject, each in sorted(parts.items())}
    return {**groups, _WHOLE: Windows.of(groups.values())}


def _forecasts(groups: Mapping[str, Windows]) -> dict[str, Any]:
    forecasters = [load_forecaster(name) for name in FORECASTERS]
    return {
        group: {each.name: _plain(errors_by_horizon(each, windows)) for each in forecasters}
        for group, windows in groups.items()
    }


def _plain(errors: Mapping[float, Errors]) -> dict[str, dict[str, float]]:
    return {f"{horizon:g}": asdict(each) for horizon, each in errors.items()}


def _filling(groups: Mapping[str, Windows]) -> dict[str, Any]:
    """Return errors of filled joints among people with all joints."""
    whole = {
        group: windows
        for group, windows in groups.items()
        if np.isfinite(windows.history).all() and len(windows)
    }
    fillers: list[Filler] = [HoldPlace(), Carry(), Autoencoder(), Straight()]
    found: dict[str, Any] = {}
    for group, windows in whole.items():
        rng = np.random.default_rng(_SEED)
        hidden = np.stack([gaps(windows.history.shape[1], rng) for _ in range(len(windows))])
        for filler in fillers:
            inside, newest = errors_of_filling(filler, windows, hidden)
            found.setdefault(group, {})[filler.name] = {"inside": asdict(inside), "newest": asdict(newest)}
    return found


def _times(repeats: int) -> dict[str, dict[str, float]]:
    history = _measured()
    joints = Carry().fill(joints_of_points(history.points())).joints
    ways: dict[str, Callable[[], Any]] = {}
    for name in FORECASTERS:
        forecaster = load_forecaster(name)
        ways[f"{name}, joints"] = lambda each=forecaster: each.forecast(joints)
    filler = Autoencoder()
    for name in FORECASTERS:
        forecaster = load_forecaster(name)
        ways[f"{name}, all"] = lambda each=forecaster: _everything(history, each, filler)
    return {way: _timed(call, repeats) for way, call in ways.items()}


def _everything(history: History, forecaster: Forecaster, filler: Filler) -> Any:
    return forecast_points(history.points(), forecaster, filler)


def _measured() -> History:
    """Return 3 s of measurements at 30 Hz of somebody who reaches, one hand hidden at last."""
    history, rng = History(), np.random.default_rng(_SEED)
    for k in range(100):
        hand = np.array([0.6, 0.3 * np.sin(0.05 * k), 0.9])
        points = report_of(hand, 0.0, 0.0).people[0].xyz + rng.normal(0.0, 0.003, (20, 3))
        if k > 80:
            points[5:9] = np.nan
        history.add(k / 30.0 + float(rng.uniform(0.0, 0.01)), points)
    return history


def _timed(call: Callable[[], Any], repeats: int) -> dict[str, float]:
    times = []
    for _ in range(repeats + 20):
        began = time.perf_counter()
        call()
        times.append(1e3 * (time.perf_counter() - began))
    middle, high = np.percentile(times[20:], [50.0, 99.0])
    return {"median_ms": float(middle), "p99_ms": float(high), "worst_ms": float(max(times[20:]))}


def _lines(found: Mapping[str, Any]) -> list[str]:
    lines = []
    for group, forecasters in found["forecasts"].items():
        horizons = list(next(iter(forecasters.values())))
        lines += [
            f"{group}, {found['windows'][group]} windows: mean (95 %, worst) distance of joints, mm",
            "",
            f"| forecast | {' | '.join(f'{each} s' for each in horizons)} |",
            "|---" * (len(horizons) + 1) + "|",
        ]
        for name, errors in forecasters.items():
            cells = [_cell(errors[each]) for each in horizons]
            lines.append(f"| `{name}` | {' | '.join(cells)} |")
        lines.append("")
    lines += [
        "| hidden joints | filled | in the gap, mm | newest frame, mm |",
        "|---|---|---|---|",
    ]
    for group, fillers in found["filling"].items():
        for name, errors in fillers.items():
            lines.append(f"| {group} | {name} | {_cell(errors['inside'])} | {_cell(errors['newest'])} |")
    lines += ["", "| forecast | median, ms | 99 %, ms | worst, ms |", "|---|---|---|---|"]
    for way, each in found["times"].items():
        lines.append(f"| {way} | {each['median_ms']:.2f} | {each['p99_ms']:.2f} | {each['worst_ms']:.2f} |")
    machine = found["machine"]
    return [*lines, "", f"{machine['processor']}; {machine['software']}; {machine['date']}"]


def _cell(errors: Mapping[str, float]) -> str:
    return " ".join(
        (f"{1e3 * errors['mean']:.0f}", f"({1e3 * errors['p95']:.0f}, {1e3 * errors['worst']:.0f})")
    )


if __name__ == "__main__":
    try:
        main()
    except SetupError as error:
        sys.exit(f"error: {error}")
