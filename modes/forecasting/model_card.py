"""What is said beside weights: what they were trained on, under which licences, how far off they are."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from modes.forecasting.dataset import Recording
from modes.forecasting.errors import Errors
from robots.errors import SetupError

CMU = (
    "The data used in this project was obtained from mocap.cs.cmu.edu. "
    "The database was created with funding from NSF EIA-0196217."
)
Judged = Mapping[str, Mapping[str, Mapping[float, Errors]]]
"""Forecaster -> group of recordings -> horizon [s] -> errors [m]."""


def card_text(
    command: str,
    seed: int,
    epochs: int,
    trained: Sequence[Recording],
    windows: int,
    judged: Judged,
    versions: str,
) -> str:
    """Return the card as TOML."""
    licences = sorted({each.licence for each in trained})
    lines = [
        "# What the weights beside this file are. Written by modes/forecasting/training.py.",
        f'command = "{command}"',
        f"seed = {seed}",
        f"epochs = {epochs}",
        f"windows = {windows}",
        f'versions = "{versions}"',
        f"recordings = [{', '.join(_quoted(each.name) for each in trained)}]",
        f"subjects = [{', '.join(sorted({_quoted(each.subject) for each in trained}))}]",
        'made_up = "people who walk, stop, bend and reach, modes/forecasting/synthetic.py"',
        f"licences = [{', '.join(_quoted(each) for each in licences)}]",
        f"acknowledgement = {_quoted(CMU)}",
        'not_trained_on = "recordings under the GPL"',
        'limits = "two subjects of motion capture: no measure of what others will do; certifies nothing"',
    ]
    for name, groups in judged.items():
        for group, errors in groups.items():
            lines += ["", f"[errors_mm.{name}.{group}]"]
            for horizon, each in errors.items():
                lines.append(
                    f'"{horizon:g}" = {{ mean = {1e3 * each.mean:.1f}, p95 = {1e3 * each.p95:.1f}, '
                    f"worst = {1e3 * each.worst:.1f} }}"
                )
    return "\n".join(lines) + "\n"


def read_card(path: Path) -> dict[str, Any]:
    """Return the card of weights.

    Raises
    ------
    SetupError
        It is missing or no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise SetupError(f"{path.name}: no card of weights: {error}") from error


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
