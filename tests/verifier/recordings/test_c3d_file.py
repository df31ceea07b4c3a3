"""C3D: files written by another library (ezc3d), units, people, residuals, and what is refused."""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from verifier.recordings import RecordingError, c3d_file
from verifier.recordings.people_report import COLUMN
from verifier.recordings.people_source import Place, open_people

pytest.importorskip("c3d")
ezc3d = pytest.importorskip("ezc3d")

LABELS = ("LWRB", "LELB", "l_knee", "*12")


def write(
    folder: Path,
    xyz: Any,
    labels: Any = LABELS,
    unit: str | None = "mm",
    rate: float = 100.0,
    residuals: Any = None,
):
    """xyz (T, P, 3) in the unit of the file."""
    data = np.moveaxis(np.asarray(xyz, np.float64), -1, 0).swapaxes(1, 2)
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [rate]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(labels)
    if unit is not None:
        file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    else:
        file["parameters"]["POINT"].pop("UNITS", None)
    file["data"]["points"] = np.vstack([data, np.ones((1, *data.shape[1:]))])
    if residuals is not None:
        file["data"]["meta_points"] = {
            "residuals": np.asarray(residuals, np.float64).T[None],
            "camera_masks": np.zeros((7, *data.shape[1:]), bool),
        }
    path = folder / "a.c3d"
    file.write(str(path))
    return path


def walk(rng: np.random.Generator, frames: int = 20, points: int = 4) -> np.ndarray:
    return rng.uniform(-2.0, 2.0, (frames, points, 3))


@pytest.mark.parametrize(("unit", "metre"), [("mm", 1e3), ("cm", 1e2), ("m", 1.0)])
def test_markers_are_read_in_metres(tmp_path: Path, rng, unit: str, metre: float) -> None:
    xyz = walk(rng)
    table = c3d_file.read_people(write(tmp_path, metre * xyz, unit=unit, rate=120.0))
    (track,) = table.tracks
    assert track.person is None and track.names == ("LELB", "LWRB", "l_knee")
    np.testing.assert_allclose(track.xyz, xyz[:, [1, 0, 2]], atol=1e-6)
    np.testing.assert_array_equal(track.t_ns, np.rint(np.arange(20) / 120 * 1e9).astype(np.int64))
    assert table.assumptions[0].value == "z up"


def test_names_are_mapped_and_people_told_apart(tmp_path: Path, rng) -> None:
    xyz = walk(rng)
    path = write(tmp_path, 1e3 * xyz, ("anna:LWRB", "anna:LELB", "bert:LELB", "bert:LWRB"))
    source = open_people(path, None, {"LWRB": "l_wrist", "LELB": "l_elbow"})
    reports = list(source.reports(Place(), 0.02))
    assert len(reports) == 20
    for report, row in zip(reports, xyz, strict=True):
        assert [each.id for each in report.people] == ["anna", "bert"]
        np.testing.assert_allclose(report.people[0].xyz[COLUMN["l_wrist"]], row[0], atol=1e-6)
        np.testing.assert_allclose(report.people[1].xyz[COLUMN["l_wrist"]], row[3], atol=1e-6)
        np.testing.assert_allclose(report.people[1].xyz[COLUMN["l_elbow"]], row[2], atol=1e-6)


def test_what_was_not_measured_is_missing(tmp_path: Path, rng) -> None:
    xyz = walk(rng, 4)
    xyz[0, 0] = np.nan
    residuals = np.full((4, 4), 3.0)
    residuals[1, 1], residuals[2, 2] = -1.0, 0.0
    (track,) = c3d_file.read_people(write(tmp_path, 1e3 * xyz, residuals=residuals)).tracks
    missing = np.isnan(track.xyz[..., 0])
    assert missing[0, track.names.index("LWRB")] and missing[1, track.names.index("LELB")]
    assert missing[2, track.names.index("l_knee")]
    assert missing.sum() == 3


def test_residuals_that_are_all_0_say_nothing(tmp_path: Path, rng) -> None:
    (track,) = c3d_file.read_people(write(tmp_path, 1e3 * walk(rng), residuals=np.zeros((20, 4)))).tracks
    assert np.isfinite(track.xyz).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"unit": "inch"}, "POINT:UNITS: is 'inch'; it must say m, cm, mm"),
        ({"unit": ""}, "POINT:UNITS: is ''"),
        ({"labels": ("A", "B", "A", "C")}, "has A twice"),
        ({"labels": ("*1", "*2", "*3", "*4")}, "names no marker"),
        ({"labels": ("a:A", "a:B", "b:A", "b:C")}, "has other markers for b than for a"),
    ],
)
def test_what_is_not_stated_is_refused(tmp_path: Path, rng, change: dict[str, Any], says: str) -> None:
    path = write(tmp_path, walk(rng), **change)
    with pytest.raises(RecordingError) as error:
        c3d_file.read_people(path)
    assert says in str(error.value) and "\n" not in str(error.value)


def test_a_rate_of_0_is_refused(tmp_path: Path, rng) -> None:
    path = write(tmp_path, walk(rng), rate=100.0)
    path.write_bytes(path.read_bytes().replace(struct.pack("<f", 100.0), struct.pack("<f", 0.0)))
    with pytest.raises(RecordingError, match=r"POINT:RATE: is 0\.0"):
        c3d_file.read_people(path)


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    for name, data, says in (
        ("a", None, "does not exist"),
        ("b", b"", "no C3D file"),
        ("c", b"x" * 5000, "no C3D file"),
    ):
        path = tmp_path / f"{name}.c3d"
        if data is not None:
            path.write_bytes(data)
        with pytest.raises(RecordingError, match=says):
            c3d_file.read_people(path)
    with pytest.raises(RecordingError, match="is no file"):
        c3d_file.read_people(tmp_path)


def test_without_the_library_the_extra_is_named(tmp_path: Path, rng, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, walk(rng))
    monkeypatch.setitem(sys.modules, "c3d", None)
    with pytest.raises(RecordingError, match=r"pip install 'stopproof\[c3d\]'"):
        c3d_file.read_people(path)


def test_truncated_and_damaged_files_are_read_or_refused(tmp_path: Path, rng, count) -> None:
    """No other exception; a truncated file is never read as a shorter one."""
    whole = write(tmp_path, 1e3 * walk(rng, 200)).read_bytes()
    path = tmp_path / "b.c3d"
    for k in range(1, 50):
        path.write_bytes(whole[: len(whole) * k // 50])
        try:
            frames = len(c3d_file.read_people(path).tracks[0].t_ns)
        except RecordingError:
            continue
        assert frames == 200 and k == 49, "only the padding of the last block is gone"
    for _ in range(count(3000)):
        data = bytearray(whole)
        for place in rng.integers(0, min(len(data), 3000), rng.integers(1, 6)):
            data[place] = rng.integers(256)
        path.write_bytes(data)
        try:
            table = c3d_file.read_people(path)
            assert all(len(track.t_ns) == len(track.xyz) for track in table.tracks)
        except RecordingError as error:
            assert "\n" not in str(error)
