"""Motion capture as C3D (``.c3d``), parsed by the library c3d (extra ``c3d``).

The unit is what ``POINT:UNITS`` says, the rate ``POINT:RATE``; markers keep their labels, which the map of
point names translates. ``anna:LELB`` is the marker ``LELB`` of the person ``anna``; trajectories without a
name (``*12``) are left out. A marker is missing where its fourth word (residual and cameras) is negative, as
the format has it, and where it is 0, interpolated, in a file that has others above 0. Which half of the word
is which is not asked: libraries disagree.
"""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np

from robots.assumption import Assumption, Certainty
from verifier.recordings.errors import RecordingError
from verifier.recordings.table import MAX_TABLE_BYTES, FloatArray, PeopleTable, Track, nanoseconds

UNITS_M: Final = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_ERRORS = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    AssertionError,
    OSError,
    EOFError,
    struct.error,
    NameError,
    ArithmeticError,
)
"""What the library raises for files that are none, or damaged; names that it has not set are of processors
that it does not know."""
_HEADER = 512
_UNNAMED = "*"


def read_people(path: str | Path) -> PeopleTable:
    """Read the markers of a file in metres, axes as they are in it.

    Raises
    ------
    RecordingError
        The library c3d is not installed; the file is not there, no C3D file, damaged or shorter than it says;
        it states no known unit or no rate, has no named marker, one twice, or people with different markers.
    """
    path = Path(path)
    if not path.is_file():
        _refuse(path, "", "does not exist" if not path.exists() else "is no file", "name a C3D file")
    with warnings.catch_warnings(), path.open("rb") as stream:
        warnings.simplefilter("ignore")  # the library prints what it finds odd; what matters is checked here
        try:
            reader = _library(path).Reader(stream)
            labels, unit, rate = _labels(reader), _text(reader, "POINT:UNITS"), float(reader.point_rate)
            frames, points = int(reader.last_frame) - int(reader.first_frame) + 1, int(reader.point_used)
            scale, begins = float(reader.point_scale), int(reader.header.data_block - 1) * _HEADER
            _check(path, unit, rate, labels, points)
            per_frame = 4 * points * (4 if scale < 0.0 else 2)
            _check_size(path, frames, begins + frames * per_frame, 40 * frames * points)
            data = np.array([each for _, each, _ in reader.read_frames()], np.float64)
        except _ERRORS as error:
            raise RecordingError(
                path, "", f"is no C3D file, or damaged ({error})", "export it anew"
            ) from error
    if len(data) != frames or not frames:
        _refuse(path, "", f"has {len(data)} frames", f"its header says {frames}, and there must be some")
    return _table(path, labels, UNITS_M[unit] * _measured(data), rate)


def _library(path: Path) -> Any:
    try:
        import c3d
    except ImportError as error:
        raise RecordingError(
            path, "", "needs the library c3d, which is not installed", "pip install 'stopproof[c3d]'"
        ) from error
    return c3d


def _labels(reader: Any) -> list[str]:
    """Return the labels of all points; beyond 255 they go on in LABELS2, LABELS3, …"""
    labels: list[str] = []
    for number in ("", *range(2, 258)):
        parameter = reader.get(f"POINT:LABELS{number}")
        if parameter is None:
            break
        labels += [str(label).strip("\0 ") for label in parameter.string_array]
    return labels


def _text(reader: Any, name: str) -> str:
    parameter = reader.get(name)
    return "" if parameter is None else str(parameter.string_value).strip("\0 ")


def _check(path: Path, unit: str, rate: float, labels: list[str], points: int) -> None:
    if unit not in UNITS_M:
        _refuse(
            path, "POINT:UNITS", f"is {unit[:20]!r}", f"it must say {', '.join(UNITS_M)}: nothing is guessed"
        )
    if not 0.0 < rate < np.inf:
        _refuse(path, "POINT:RATE", f"is {rate}", "it must be a positive number of frames a second")
    if len(labels) < points or not points:
        _refuse(
            path, "POINT:LABELS", f"has {len(labels)} labels for {points} points", "each marker needs one"
        )


def _check_size(path: Path, frames: int, needed: int, memory: int) -> None:
    """Refuse what the header claims and the file cannot hold, before anything is read or reserved."""
    if needed > path.stat().st_size:
        _refuse(path, "", f"ends early: its header says {frames} frames", "copy or export it anew")
    if memory > MAX_TABLE_BYTES:
        _refuse(path, "", f"has {frames} frames, too many to read at once", "cut it into pieces")


def _measured(data: FloatArray) -> FloatArray:
    """Return points (T, P, 3), NaN where residual and cameras say that nothing was measured."""
    missing = data[..., 3] < 0.0
    seen = (data[..., 3:] > 0.0).any(axis=-1)
    if seen.any():
        missing |= ~seen
    return np.where(missing[..., None], np.nan, data[..., :3])


def _table(path: Path, labels: list[str], xyz: FloatArray, rate: float) -> PeopleTable:
    people: dict[str | None, dict[str, int]] = {}
    for column, label in enumerate(labels[: xyz.shape[1]]):
        subject, colon, own = label.partition(":")
        person, name = (subject, own) if colon else (None, label)
        if not name or name.startswith(_UNNAMED):
            continue
        markers = people.setdefault(person, {})
        if name in markers:
            _refuse(path, "POINT:LABELS", f"has {label} twice", "each marker must have a name of its own")
        markers[name] = column
    if not people:
        _refuse(path, "POINT:LABELS", "names no marker", "label the markers, then export the file anew")
    names = sorted(next(iter(people.values())))
    for person, markers in people.items():
        if sorted(markers) != names:
            wrong = f"has other markers for {person} than for {next(iter(people))}"
            _refuse(path, "POINT:LABELS", wrong, "write one file for each of them")
    t_ns = nanoseconds(path, "POINT:RATE", np.arange(len(xyz), dtype=np.float64) / rate, 0.0)
    tracks = tuple(
        Track(person, t_ns, tuple(names), xyz[:, [markers[name] for name in names]])
        for person, markers in people.items()
    )
    axes = Assumption(
        f"recording.axes.{path.name}",
        "z up",
        "",
        "a C3D does not say so: axes are as in the file",
        Certainty.ASSUMED,
    )
    return PeopleTable(path, tracks, None, (axes,))


def _refuse(path: Path, place: str, wrong: str, right: str) -> NoReturn:
    raise RecordingError(path, place, wrong, right)
