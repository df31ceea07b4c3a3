"""Figures 4 to 9 of the paper drawn from our run, the delays of detection, and how far a tool was led."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from modes.contact.experiments import EXPERIMENTS
from modes.contact.machine import Decision
from modes.drawing import new_figure, png

if TYPE_CHECKING:
    from modes.contact.course import Course
    from modes.contact.report import ContactReport

Array = NDArray[np.float64]

_PANEL = 5.5, 3.4
_SIGNAL, _LIMIT, _OTHER = "#1565c0", "#c62828", "#616161"
_HIGH_N, _LOW_N, _RESIDUAL_NM = 10.0, 7.0, 22.0


def draw(report: ContactReport) -> Mapping[str, bytes]:
    """Return all pictures as PNG."""
    course = report.course
    return {
        "figure_4.png": _forces(course, "Fig. 4: a hand guides the end effector", (15.0, 22.0)),
        "figure_5.png": _forces(course, "Fig. 5: a blow on the end effector", (22.0, 24.0)),
        "figure_6.png": _forces(course, "Fig. 6: a contact that lasts", (29.5, 36.0)),
        "figure_7.png": _currents(course, "Fig. 7: link 4 is hit, joint 1", 0),
        "figure_8.png": _currents(course, "Fig. 8: link 4 is hit, joint 2", 1),
        "figure_9.png": _residuals(course),
        "detection_delays.png": _delays(report),
        "guided_under_the_verifier.png": _guided(report),
    }


def _signal(
    course: Course, of: Callable[[Decision], float], span: tuple[float, float]
) -> tuple[Array, Array]:
    """Return instants and a number of each decision, in a span of time."""
    t = np.array(course.t)
    chosen = (t >= span[0]) & (t < span[1])
    values = np.array([of(each) for each, here in zip(course.decisions, chosen, strict=True) if here])
    return t[chosen], values


def _of_tool(name: str) -> Callable[[Decision], float]:
    return lambda each: np.nan if each.tool is None else float(getattr(each.tool, name))


def _of_body(name: str, joint: int) -> Callable[[Decision], float]:
    return lambda each: np.nan if each.body is None else float(getattr(each.body, name)[joint])


def _of_residual(joint: int) -> Callable[[Decision], float]:
    return lambda each: np.nan if each.residual is None else float(each.residual[joint])


def _forces(course: Course, title: str, span: tuple[float, float]) -> bytes:
    figure, axes = new_figure(1, 2, title, _PANEL)
    for each, name, limit in zip(axes, ("low_N", "high_N"), (_LOW_N, _HIGH_N), strict=True):
        t, values = _signal(course, _of_tool(name), span)
        each.plot(t, values, color=_SIGNAL)
        each.axhline(limit, color=_LIMIT, linestyle="--", label=f"threshold, {limit:g} N")
        kind = "low-pass filtered" if name == "low_N" else "high-pass filtered"
        each.set(xlabel="t [s]", ylabel="force [N]", title=kind)
        each.legend(loc="upper right", fontsize="small")
    return png(figure)


def _currents(course: Course, title: str, joint: int) -> bytes:
    figure, axes = new_figure(1, 2, title, _PANEL)
    hits = [each for each in EXPERIMENTS if "7" in each.figures]
    span = hits[0].begin_s - 1.0, hits[-1].end_s - 3.0
    for each, name in zip(axes, ("high", "low"), strict=True):
        t, values = _signal(course, _of_body(name, joint), span)
        _t, limits = _signal(course, _of_body(f"{name}_threshold", joint), span)
        each.plot(t, np.abs(values), color=_SIGNAL)
        each.plot(t, limits, color=_LIMIT, linestyle="--", label="threshold")
        each.set(xlabel="t [s]", ylabel="current [A]", title=f"{name}-pass filtered")
        each.legend(loc="upper right", fontsize="small")
    return png(figure)


def _residuals(course: Course) -> bytes:
    figure, (axes,) = new_figure(1, 1, "Fig. 9: residuals, a hand guides the tool and link 4 is hit", _PANEL)
    for joint in range(6):
        t, values = _signal(course, _of_residual(joint), (68.0, 73.0))
        axes.plot(t, values, label=f"joint {joint + 1}")
    axes.axhline(_RESIDUAL_NM, color=_LIMIT, linestyle="--", label=f"threshold, {_RESIDUAL_NM:g} N m")
    axes.set(xlabel="t [s]", ylabel="residual [N m]")
    axes.axvline(EXPERIMENTS[-1].hit_s, color=_OTHER, linestyle=":", label="link 4 is hit")
    axes.set(ylim=(0.0, 1.6 * _RESIDUAL_NM))
    axes.legend(loc="upper left", fontsize="small", ncols=3, title="until the arm is stopped")
    return png(figure)


def _delays(report: ContactReport) -> bytes:
    figure, (left, right) = new_figure(1, 2, "Blows of 40 ms: detected, and after how long", _PANEL)
    for colour, spot in zip(
        (_SIGNAL, _OTHER), dict.fromkeys(each.spot for each in report.hits), strict=False
    ):
        those = [each for each in report.hits if each.spot == spot]
        share = [100.0 * len(each.delays_s) / each.blows for each in those]
        left.plot([each.peak_N for each in those], share, "o-", color=colour, label=spot)
        for each in those:
            right.plot([each.peak_N] * len(each.delays_s), 1e3 * each.delays_s, ".", color=colour, alpha=0.6)
    left.set(xlabel="peak [N]", ylabel="detected [%]", ylim=(-3.0, 103.0))
    left.legend(loc="lower right", fontsize="small")
    right.set(xlabel="peak [N]", ylabel="delay [ms]", ylim=(0.0, None), title="of those that were told")
    return png(figure)


def _guided(report: ContactReport) -> bytes:
    figure, (axes,) = new_figure(1, 1, "The tool, held from 8 to 14 s, under the verifier", _PANEL)
    for number, each in enumerate(report.guided):
        declared = "may touch " + ", ".join(each.links) if each.links else "separation only"
        shown = (each.t >= 8.0) & (each.t < 18.0)
        away = 1e3 * np.linalg.norm(each.place_m[shown] - each.place_m[shown][0], axis=1)
        label = f"{declared}; reports within {1e3 * each.latency_s:.0f} ms"
        axes.plot(each.t[shown], away, label=label, linewidth=3.4 - 0.8 * number)
    axes.set(xlabel="t [s]", ylabel="from where it was taken [mm]", xlim=(8.0, 18.0))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", fontsize="small")
    return png(figure)
