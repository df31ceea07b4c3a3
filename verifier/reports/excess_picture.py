"""A picture of the worst excess of every model over the horizon (needs the extra ``plot``)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from occupancy.humans.catalog import MODEL_NAMES
from verifier.conformance import Result
from verifier.reports.picture import rendered, require_drawing
from verifier.shown import shown

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_LOOKS: Final = (
    ("#000000", "o", "-"),
    ("#e69f00", "s", "--"),
    ("#0072b2", "^", "-."),
    ("#009e73", "v", ":"),
    ("#d55e00", "D", (0, (5, 1, 1, 1, 1, 1))),
    ("#cc79a7", "p", (0, (1, 1))),
    ("#56b4e9", "h", (0, (3, 3))),
)
"""Colour (those of Okabe and Ito, which people with any colour vision tell apart), marker and line, one for
each model."""
STYLES: Final = dict(zip(MODEL_NAMES, _LOOKS, strict=False))
_LARGEST, _SMALLEST = 11.0, 4.5
"""Hollow markers of models that coincide stand one around the other, the first one's outermost [point]."""
_LEAST_DEPTH_M: Final = 0.3
"""Every panel reaches at least as deep."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One model of one profile over all recordings.

    Attributes
    ----------
    profile, model:
        Names.
    horizon_s, excess_m:
        (H,) the horizons, and the worst excess of each; NaN: nothing was tested.
    """

    profile: str
    model: str
    horizon_s: Array
    excess_m: Array


def curves(results: Sequence[Result]) -> list[Curve]:
    """Return the worst of all recordings for each profile and model, in the order of the results."""
    found: list[Curve] = []
    for profile, model in dict.fromkeys((result.profile, result.model) for result in results):
        own = [result for result in results if (result.profile, result.model) == (profile, model)]
        horizon = np.array([row.horizon_s for row in own[0].horizons])
        excess = np.array([[row.worst_excess_m for row in each.horizons] for each in own])
        found.append(Curve(profile, model, horizon, np.fmax.reduce(excess, axis=0)))
    return found


def lowest_shown(found: Sequence[Curve]) -> float:
    """Return how deep the panels reach [m]: how deep inside a point lies is of less interest."""
    return -max(_LEAST_DEPTH_M, 0.5 * highest_shown(found))


def highest_shown(found: Sequence[Curve]) -> float:
    """Return how high the panels reach [m]: nothing is cut off there."""
    return 1.05 * max([0.05, *(float(each) for curve in found for each in curve.excess_m if each > 0.0)])


def not_drawn(own: Sequence[Curve], lowest: float) -> Iterator[str]:
    """Yield what a panel does not show of its curves: what is cut off below, and models without any frame."""
    deep = [curve for curve in own if (curve.excess_m < lowest).any()]
    if deep:
        yield f"cut off below {lowest:.2f} m:"
    for curve in deep:
        left = "all" if not (curve.excess_m >= lowest).any() else "in part"
        yield f"{curve.model}: {left}, down to {np.nanmin(curve.excess_m):.2f} m"
    for curve in own:
        if not np.isfinite(curve.excess_m).any():
            yield f"{curve.model}: nothing was tested"


def excess_picture(results: Sequence[Result], kind: str = "png") -> bytes:
    """Return a picture: worst excess of every model over the horizon, one panel per profile.

    Raises
    ------
    SetupError
        It cannot be drawn: matplotlib is not installed.
    """
    require_drawing()
    found = curves(results)
    profiles = list(dict.fromkeys(curve.profile for curve in found))
    figure, panels = _sheet(len(profiles))
    for panel, profile in zip(panels, profiles, strict=True):
        own = [curve for curve in found if curve.profile == profile]
        panel.set_title(f"profile {shown(profile, 30)}", loc="left", fontsize=10, parse_math=False)
        _draw(panel, own)
        panel.set_ylim(lowest_shown(found), highest_shown(found))
        missing = [f"\n{line}" for line in not_drawn(own, lowest_shown(found))]
        panel.set_xlabel("".join(["horizon [ms]", *missing]), fontsize=8)
    panels[0].set_ylabel("worst excess [m], above 0: outside")
    models = [name for name in MODEL_NAMES if name in {curve.model for curve in found}]
    handles = [panels[0].plot([], [], label=name, **_style(name))[0] for name in models]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False, handlelength=4
    )
    return rendered(figure, kind)


def _sheet(columns: int) -> tuple[Figure, list[Axes]]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2 * columns + 1.0, 5.4), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(1, columns, sharey=True, squeeze=False)[0])


def _style(model: str) -> dict[str, Any]:
    """Return how the curve of a model is drawn."""
    order = MODEL_NAMES.index(model) / max(len(MODEL_NAMES) - 1, 1)
    colour, marker, line = STYLES[model]
    size = _LARGEST + (_SMALLEST - _LARGEST) * order
    hollow = {"marker": marker, "markersize": size, "markerfacecolor": "none", "markeredgewidth": 1.2}
    return {"color": colour, "linestyle": line, "linewidth": 1.4, **hollow}


def _draw(panel: Axes, own: Sequence[Curve]) -> None:
    for curve in own:
        panel.plot(1e3 * curve.horizon_s, curve.excess_m, **_style(curve.model))
    panel.axhline(0.0, color="#b71c1c", linewidth=0.8)
    at = 1e3 * own[0].horizon_s
    panel.set_xscale("log")
    panel.set_xticks(at, [f"{each:g}" for each in at])
    panel.minorticks_off()
    panel.grid(alpha=0.25)
    panel.spines[["top", "right"]].set_visible(False)
