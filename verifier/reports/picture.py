"""A picture of a verdict over time (needs the extra ``plot``)."""

from __future__ import annotations

from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from robots.errors import SetupError
from verifier.reports.stretches import runs
from verifier.reports.text import DISCLAIMER
from verifier.reports.verification import VerifyReport
from verifier.shown import shown
from verifier.verdict import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOT_INSTALLED = "pictures need matplotlib, which is not installed: pip install 'stopproof[plot]'"
KINDS: Final = ("png", "jpg", "jpeg", "pdf", "svg", "tif", "tiff", "webp")
"""Endings of the files that a picture can be written to."""
_UNDATED: Final = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
_LINE_LENGTH, _LINE_IN = 170, 0.14
"""Of the text below the panels: characters, and height [inch]."""
_WAIVERS_SHOWN, _LONGEST_WAIVER = 4, 100
COLOURS: dict[Status, str] = {
    Status.VERIFIED: "#2e7d32",
    Status.NOT_VERIFIED: "#ef6c00",
    Status.CONTRADICTED: "#6a1b9a",
    Status.NOT_CHECKED: "#9e9e9e",
}


def require_drawing(*files: tuple[str, str | None]) -> None:
    """Refuse, before long work, what could not be drawn or written after it.

    Parameters
    ----------
    files:
        Options and the pictures that they name; ``None``: not given. Without any, matplotlib is looked for.

    Raises
    ------
    SetupError
        A file has an ending that no picture has, or matplotlib is not installed.
    """
    named = [(option, path) for option, path in files if path is not None]
    for option, path in named:
        if kind_of(path) not in KINDS:
            endings = ", ".join(f".{kind}" for kind in KINDS)
            raise SetupError(f"{option} {path}: a picture's name must end in one of {endings}")
    if (named or not files) and find_spec("matplotlib") is None:
        raise SetupError(NOT_INSTALLED)


def kind_of(path: str) -> str:
    """Return the ending of a file, which says what kind of picture is written."""
    return Path(path).suffix.lower().removeprefix(".")


def rendered(figure: Figure, kind: str) -> bytes:
    """Return the file of a figure, of one of ``KINDS``; the same figure gives the same PNG or PDF."""
    buffer = BytesIO()
    options: dict[str, Any] = {"pil_kwargs": {"optimize": True}} if kind == "png" else {}
    figure.savefig(buffer, format=kind, metadata=_UNDATED.get(kind), **options)
    return buffer.getvalue()


def verdict_picture(report: VerifyReport, kind: str = "png") -> bytes:
    """Return a picture: status of every cycle as a band, gap and stop time below it, over recorded time.

    Raises
    ------
    SetupError
        matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise SetupError(NOT_INSTALLED) from error
    footer = _footer(report)
    figure = Figure(figsize=(10.0, 4.6 + _LINE_IN * len(footer)), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    band, gap, stop = figure.subplots(3, 1, sharex=True, height_ratios=(0.7, 2.0, 1.0))
    _status_band(band, report)
    rows = report.per_cycle
    _gaps(gap, report)
    stop.plot(rows.t, rows.stop_time_s, ".", markersize=1.6, color="#37474f", rasterized=True)
    stop.set_ylabel("stop time [s]")
    stop.set_ylim(bottom=0.0)
    stop.set_xlabel("recorded time [s]")
    for axes in (gap, stop):
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    if not _is_empty(gap, rows.gap_m, f"no gap to draw: {_usual_reason(report)}"):
        gap.axhline(0.0, color="#b71c1c", linewidth=0.8)
    _is_empty(stop, rows.stop_time_s, "no stop to draw")
    figure.align_ylabels((gap, stop))
    figure.supxlabel("\n".join(footer), x=0.01, ha="left", fontsize=7.5, parse_math=False)
    return rendered(figure, kind)


def _gaps(axes: Axes, report: VerifyReport) -> None:
    """Draw the gaps; that of a cycle that is not verified says when it fails, not how much is missing."""
    rows = report.per_cycle
    open_ = rows.status == int(Status.NOT_VERIFIED)
    kinds = (
        ("least gap of the cycle", ~open_, "#1565c0"),
        ("not verified: gap in the first slice that is open; later ones may lack more", open_, "#9e9e9e"),
    )
    for label, chosen, colour in kinds:
        if np.isfinite(rows.gap_m[chosen]).any():
            at, gap = rows.t[chosen], rows.gap_m[chosen]
            axes.plot(at, gap, ".", markersize=1.6, color=colour, label=label, rasterized=True)
    axes.set_ylabel("gap [m]")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="lower left",
            bbox_to_anchor=(0.0, 0.97),
            ncols=2,
            frameon=False,
            fontsize=7.5,
            markerscale=5.0,
        )


def _footer(report: VerifyReport) -> list[str]:
    """Return what must stay with the picture: a picture is passed on alone."""
    waived = [shown(text, _LONGEST_WAIVER) for text in report.waived[:_WAIVERS_SHOWN]]
    if len(report.waived) > _WAIVERS_SHOWN:
        waived.append(f"and {len(report.waived) - _WAIVERS_SHOWN} more")
    texts = (f"{shown(report.recording)} · waived: {'; '.join(waived) or 'nothing'}", DISCLAIMER)
    return [line for text in texts for line in wrap(text, _LINE_LENGTH)]


def _is_empty(axes: Axes, values: NDArray[np.float32], text: str) -> bool:
    """Write ``text`` where there is nothing to draw; return whether that is so."""
    if np.isfinite(values).any():
        return False
    axes.set_yticks([])
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color="#616161")
    return True


def _usual_reason(report: VerifyReport) -> str:
    """Return the reason of most cycles."""
    counts = [pair for status in Status for pair in report.reasons(status)]
    return max(counts, key=lambda pair: pair[1])[0].text if counts else "there are no cycles"


def _status_band(axes: Axes, report: VerifyReport) -> None:
    rows = report.per_cycle
    ends = np.append(rows.t, rows.t[-1] + _step(rows.t)) if len(rows.t) else np.zeros(1)
    handles: list[Any] = []
    for status, colour in COLOURS.items():
        spans = [(ends[i], ends[j] - ends[i]) for i, j in runs(rows.status == int(status))]
        label = f"{status.name.lower().replace('_', ' ')}: {report.count(status)}"
        handles.append(axes.broken_barh(spans, (0.0, 1.0), facecolors=colour, label=label))
    axes.set_yticks([])
    axes.spines[["top", "right", "left"]].set_visible(False)
    stop = report.stop_model.replace("_", "-")
    under = "A1–A7 and the waivers below" if report.waived else "A1–A7"
    axes.set_title(
        f"{shown(report.robot)} · {stop} stop · profile {shown(report.profile)}\n"
        f"verified in the model: {report.count(Status.VERIFIED)} of {report.cycles} cycles, under {under}",
        loc="left",
        fontsize=10,
        parse_math=False,
    )
    axes.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.0, -0.75), ncols=4, frameon=False, fontsize=8
    )


def _step(t: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    return float(t[1] - t[0]) if len(t) > 1 else 1.0
