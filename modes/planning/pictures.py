"""The paper's figures 5 and 6 drawn from our runs, and what came of all trials."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from modes.drawing import new_figure, png
from modes.people_capsules import around_parts
from modes.planning.trials import END_S, POST
from occupancy.body import Part, load_profile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Circle

    from modes.planning.outcomes import Run
    from modes.planning.report import ProactiveReport

_ARM, _OTHER, _LIMIT = "#f9a825", "#1565c0", "#c62828"
_TITLES = {"fixed": "straight way", "present": "without forecasts", "forecast": "with forecasts"}


def draw(report: ProactiveReport) -> Mapping[str, bytes]:
    """Return all pictures as PNG."""
    return {
        "figures_5_and_6.png": _paths(report),
        "gaps_and_times.png": _trials(report),
        "forecast_errors.png": _errors(report),
    }


def _paths(report: ProactiveReport) -> bytes:
    """Draw the tool's way from above and from the front: nobody in the way, and somebody."""
    from modes.planning.report import PAPERS

    runs = report.of(PAPERS)
    free = min(runs, key=lambda run: (not run.arrived, run.halts, sum(run.corners), run.moving_m))
    around = max(runs, key=lambda run: (run.arrived, run.ways, sum(run.corners)))
    figure, axes = new_figure(2, 2, "The tool's way: start, goal, and who is there", (6.0, 4.5))
    for row, (name, run) in enumerate((("Fig. 5: nobody in the way", free), ("Fig. 6: another way", around))):
        for column, (i, j, side) in enumerate(((0, 1, "from above"), (1, 2, "from the front"))):
            panel = axes[2 * row + column]
            _scene(panel, report, run, (i, j))
            panel.set_title(f"{name}, trial {run.number}, {side}")
            panel.set_xlabel(f"{'xyz'[i]} [m]")
            panel.set_ylabel(f"{'xyz'[j]} [m]")
            panel.set_aspect("equal")
    axes[0].legend(loc="upper right")
    return png(figure)


def _scene(panel: Axes, report: ProactiveReport, run: Run, axes: tuple[int, int]) -> None:
    i, j = axes
    person = next(each.person for each in report.trials if each.number == run.number)
    profile = load_profile("iso")
    until = min(run.arrived_s, END_S)
    for t, colour in ((0.0, "#e0e0e0"), (0.5 * until, "#c2c2c2"), (until, "#9e9e9e")):
        body = around_parts(person.at(t)[None], tuple(Part), profile)
        for a, b, radius in zip(body.a, body.b, body.radius, strict=True):
            for share in np.linspace(0.0, 1.0, 8):
                middle = a + share * (b - a)
                panel.add_patch(_disc((middle[i], middle[j]), radius, colour))
    ends = np.array(POST[:2])
    panel.plot(ends[:, i], ends[:, j], color=_OTHER, linewidth=6, solid_capstyle="round", label="post")
    places = np.array(run.places)
    panel.plot(places[:, i], places[:, j], color=_ARM, linewidth=2, label="tool")
    panel.plot(*places[0, [i, j]], "o", color=_OTHER, label="start")
    panel.plot(*places[-1, [i, j]], "s", color=_LIMIT, label="goal")
    panel.set_xlim(-1.2, 1.9)
    panel.set_ylim((-1.3, 1.3) if j == 1 else (-0.9, 1.3))


def _disc(centre: tuple[float, float], radius: float, colour: str) -> Circle:
    from matplotlib.patches import Circle

    return Circle(centre, radius, facecolor=colour, linewidth=0)


def _trials(report: ProactiveReport) -> bytes:
    figure, axes = new_figure(2, 2, "Gap to moving links, and time until the goal, of each trial", (6.0, 3.4))
    for row, supervised in enumerate((False, True)):
        for setting in report.settings:
            if setting.supervised is not supervised:
                continue
            runs = report.of(setting)
            numbers = [run.number for run in runs]
            label = _TITLES[setting.proposer]
            gaps = [1e3 * min(run.moving_m, 1.0) for run in runs]
            axes[2 * row].plot(numbers, gaps, ".", label=label)
            axes[2 * row + 1].plot(numbers, [min(run.arrived_s, END_S) for run in runs], ".", label=label)
        axes[2 * row].axhline(1e3 * report.clearance_m, color=_LIMIT, linewidth=1)
        axes[2 * row].set_ylabel("least gap [mm]")
        axes[2 * row + 1].set_ylabel("arrived after [s]")
        for panel in axes[2 * row : 2 * row + 2]:
            panel.set_title("every motion verified" if supervised else "nothing verified")
            panel.set_xlabel("trial")
    axes[0].legend()
    return png(figure)


def _errors(report: ProactiveReport) -> bytes:
    figure, axes = new_figure(1, 1, "Mean error of forecasts of these people", (6.0, 3.4))
    for model in dict.fromkeys(each.model for each in report.errors):
        of = [each for each in report.errors if each.model == model]
        axes[0].plot([each.horizon_s for each in of], [1e3 * each.error_m for each in of], label=model)
    axes[0].set_xlabel("ahead [s]")
    axes[0].set_ylabel("error [mm]")
    axes[0].legend()
    return png(figure)
