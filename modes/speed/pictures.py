"""Figures 3 to 9 and 11 of the paper drawn from our runs, and the scenes under the verifier."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from modes.drawing import new_figure, png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from modes.speed.report import SpeedReport
    from modes.speed.simulations import Method, Run

Array = NDArray[np.float64]

_COLOURS = {
    "proposed": "#1565c0", "genetic": "#00838f", "hwang": "#ef6c00", "hwang_corrected": "#c0a000",
    "morato": "#6a1b9a", "none": "#616161",
}  # fmt: skip
_WINDOWS = {1: (15, 20), 2: (8, 22)}
_CYCLE_S = 0.01


def draw(report: SpeedReport) -> Mapping[str, bytes]:
    """Return all pictures as PNG."""
    one, two = report.simulations[1], report.simulations[2]
    return {
        "figure_3.png": _positions(one["none"], report),
        "figure_4.png": _index_and_speed("Fig. 4: without the method", {"none": one["none"]}),
        **{
            f"figure_{number}.png": _index_and_speed(
                f"Fig. {number}: {name}",
                {f"{value:g}": report.sweeps[name, value] for value in (1.0, 10.0, 100.0)},
            )
            for number, name in ((5, "penalty"), (6, "closeness"), (7, "smoothness"))
        },
        "figure_8.png": _index_and_speed("Fig. 8: simulation 1", _compared(one)),
        "figure_9.png": _with_jerk("Fig. 9: simulation 1, enlarged", one, 1),
        "figure_11.png": _with_jerk("Fig. 11: simulation 2", two, 2),
        "under_the_verifier.png": _verifier(report, contact=False),
        "under_the_verifier_contact.png": _verifier(report, contact=True),
    }


_COMPARED: tuple[Method, ...] = ("proposed", "genetic", "hwang", "hwang_corrected", "morato")


def _compared(runs: Mapping[Method, Run]) -> dict[str, Run]:
    return {name: runs[name] for name in _COMPARED}


def _positions(run: Run, report: SpeedReport) -> bytes:
    figure, (left, right) = new_figure(1, 2, "Fig. 3: end effector and right hand, simulation 1")
    k = np.arange(1, len(run.place) + 1)
    hand = report.hands[1][: len(k)]
    for axes, places, title in ((left, run.place, "end effector's ball"), (right, hand, "hand")):
        for axis, name in enumerate("xyz"):
            axes.plot(k, 1e3 * places[:, axis], label=name)
        axes.set(xlabel="sample", ylabel="mm", title=title)
    _legend(figure, left)
    return png(figure)


def _legend(figure: Figure, axes: Axes) -> None:
    """Put the legend of one panel, which all of them share, below the picture."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize="small")


def _styles(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return colours and lines; the earlier ones are wider, so that what lies on one another is seen."""
    names = list(names)
    return {
        name: {"color": _COLOURS.get(name), "linewidth": 1.0 + 1.2 * (len(names) - 1 - i)}
        for i, name in enumerate(names)
    }


def _index(axes: Axes, runs: Mapping[str, Run], span: tuple[int, int] | None = None) -> None:
    styles = _styles(runs)
    for name, run in runs.items():
        k = np.arange(1, len(run.danger_index) + 1)
        axes.plot(k, run.danger_index, label=name, **styles[name])
    axes.axhline(1.0, color="black", linewidth=0.8, linestyle="--")
    axes.set(xlabel="sample", ylabel="danger index", xlim=span)


def _speed(axes: Axes, runs: Mapping[str, Run], span: tuple[int, int] | None = None) -> None:
    styles = _styles(runs)
    for name, run in runs.items():
        k = np.arange(1, len(run.speed) + 1)
        axes.step(k, 1e3 * run.speed, where="post", label=name, **styles[name])
    axes.set(xlabel="sample", ylabel="speed [mm/s]", xlim=span)


def _index_and_speed(title: str, runs: Mapping[str, Run]) -> bytes:
    figure, (left, right) = new_figure(1, 2, title)
    _index(left, runs)
    _speed(right, runs)
    _legend(figure, left)
    return png(figure)


def _with_jerk(title: str, runs: Mapping[Method, Run], number: int) -> bytes:
    """Index, speed, jerk over the window, its deviation, and how the genetic algorithm converges."""
    compared, (first, last) = _compared(runs), _WINDOWS[number]
    figure, panels = new_figure(3, 2, title)
    span = (first, last) if number == 1 else None
    _index(panels[0], compared, span)
    _speed(panels[1], compared, span)
    k = np.arange(first, last + 1)
    deviations, styles = {}, _styles(compared)
    for name, run in compared.items():
        jerk = run.jerk(first, last)
        deviations[name] = float(jerk.std(ddof=1))
        panels[2].plot(k, jerk, label=name, **styles[name])
    panels[2].set(xlabel="sample", ylabel="jerk [mm/s³]")
    panels[2].set_yscale("symlog", linthresh=100.0)
    bars = panels[3].bar(
        list(deviations), list(deviations.values()), color=[_COLOURS.get(n) for n in deviations]
    )
    panels[3].bar_label(bars, fmt="%.0f", fontsize="small")
    panels[3].set(ylabel="SD of jerk [mm/s³]")
    panels[3].set_yscale("symlog", linthresh=10.0)
    panels[3].tick_params(axis="x", labelsize="x-small")
    _legend(figure, panels[0])
    evolution = runs["genetic"].first_evolution
    if evolution is not None:
        generation = np.arange(len(evolution.track))
        panels[4].plot(generation, 1e3 * evolution.track[:, 0])
        panels[5].plot(generation, evolution.track[:, 1])
    panels[4].set(xlabel="generation", ylabel="best speed [mm/s]")
    panels[5].set(xlabel="generation", ylabel="objective")
    return png(figure)


def _verifier(report: SpeedReport, *, contact: bool) -> bytes:
    """Index, speed and gap of each scene under the supervisor, alone and with the mode.

    ``contact``: of those with power and force limiting for hands and arms, for which S_p does not hold.
    """
    those = [each for each in report.watched if each.contact == contact]
    scenes = list(dict.fromkeys(each.scene for each in those))
    what = (
        "hands and arms may be touched" if contact else "what moves keeps S_p, which the index does not know"
    )
    figure, panels = new_figure(len(scenes), 3, f"Under the verifier: {what}")
    gap = panels[2]
    for row, scene in enumerate(scenes):
        index, speed, gap = panels[3 * row : 3 * row + 3]
        for each in those:
            if each.scene != scene:
                continue
            t = _CYCLE_S * np.arange(len(each.speed_m_s))
            name, colour = ("with the mode", "#1565c0") if each.mode else ("alone", "#ef6c00")
            style: dict[str, Any] = {"color": colour, "linewidth": 1.0 if each.mode else 2.2}
            index.plot(t, each.danger_index, **style)
            speed.plot(t, 1e3 * each.speed_m_s, **style)
            gap.plot(t, each.separation_m, label=name if contact else f"{name} (gap)", **style)
            if not contact:
                gap.plot(t, each.required_m, linestyle=":", label=f"{name}: S_p", **style)
        index.set(ylabel="danger index", title=scene)
        speed.set(ylabel="speed [mm/s]", title=scene)
        gap.set(ylabel="gap [m]", title=scene, ylim=(-0.05, 1.5))
        for axes in (index, speed, gap):
            axes.set_xlabel("t [s]")
    _legend(figure, gap)
    return png(figure)
