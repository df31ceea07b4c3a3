"""BVH: kinematics by hand, units, axes and names, what is refused, and the NPZ of the same clip."""

from __future__ import annotations

import gzip
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from occupancy.body import POINT_NAMES
from verifier.recordings import RecordingError, bvh, npz
from verifier.recordings.people_source import Place, open_people

LEG = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Neck
  {
    OFFSET 0 50 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 10 0
    }
  }
  JOINT LeftHip
  {
    OFFSET 10 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT LeftKnee
    {
      OFFSET 0 -42 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      JOINT LeftAnkle
      {
        OFFSET 0 -42 0
        CHANNELS 3 Zrotation Xrotation Yrotation
      }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
"""
ZERO = "0 100 0  0 0 0  0 0 0  0 0 0  0 0 0  0 0 0"
BENT = "1 100 2  90 0 0  0 0 0  0 0 0  0 90 0  0 0 0"


def write(folder: Path, text: str, name: str = "a.bvh") -> Path:
    path = folder / name
    if name.endswith(".gz"):
        path.write_bytes(gzip.compress(text.encode()))
    else:
        path.write_text(text, encoding="utf-8")
    return path


def whole(*frames: str) -> str:
    return LEG.replace("Frames: 2", f"Frames: {len(frames)}") + "\n".join(frames) + "\n"


@pytest.mark.parametrize("name", ["a.bvh", "a.bvh.gz"])
def test_a_leg_by_hand(tmp_path: Path, name: str) -> None:
    """Centimetres, y up. Frame 1: the hip turns the body by 90° about z, then the knee bends about its x."""
    table = bvh.read_people(write(tmp_path, whole(ZERO, BENT), name))
    (track,) = table.tracks
    assert track.t_ns.tolist() == [0, 10_000_000]
    place = dict(zip(track.names, np.moveaxis(track.xyz, 1, 0), strict=True))
    assert set(place) == {"pelvis", "Neck", "l_hip", "l_knee", "l_ankle"}
    np.testing.assert_allclose(place["l_ankle"][0], (0.1, 0.0, 0.16), atol=1e-12)
    np.testing.assert_allclose(place["pelvis"][1], (0.01, -0.02, 1.0), atol=1e-12)
    np.testing.assert_allclose(place["l_hip"][1], (0.01, -0.02, 1.1), atol=1e-12)
    np.testing.assert_allclose(place["l_knee"][1], (0.43, -0.02, 1.1), atol=1e-12)
    np.testing.assert_allclose(place["l_ankle"][1], (0.43, 0.4, 1.1), atol=1e-12)
    unit, axes = table.assumptions
    assert (unit.value, axes.value) == (0.01, "y up in the file")
    assert "1.71 m tall" in unit.source


@pytest.mark.parametrize(
    ("factor", "unit"), [(1.0, 0.01), (0.01, 1.0), (10.0, 0.001), (0.45 / 2.54, 0.0254 / 0.45)]
)
def test_the_unit_follows_from_the_limbs(tmp_path: Path, factor: float, unit: float) -> None:
    text = whole(ZERO)
    for length in ("50", "-42"):
        text = text.replace(f"OFFSET 0 {length} 0", f"OFFSET 0 {float(length) * factor!r} 0")
    assert bvh.read_people(write(tmp_path, text)).assumptions[0].value == pytest.approx(unit)


def test_units_cannot_be_mistaken_for_each_other() -> None:
    units = sorted(bvh.UNITS_M.values())
    assert min(b / a for a, b in pairwise(units)) > bvh.STATURE_M[1] / bvh.STATURE_M[0]


def test_z_up_is_left_alone(tmp_path: Path) -> None:
    text = whole(ZERO).replace("OFFSET 0 50 0", "OFFSET 0 0 50").replace("JOINT Neck", "JOINT Head")
    table = bvh.read_people(write(tmp_path, text))
    assert table.assumptions[1].value == "z up in the file"
    np.testing.assert_allclose(table.tracks[0].xyz[0, 0], (0.0, 1.0, 0.0), atol=1e-12)


def test_names_of_other_programs(tmp_path: Path) -> None:
    text = whole(ZERO)
    for theirs, other in (("LeftHip", "LeftUpLeg"), ("LeftKnee", "LeftLeg"), ("LeftAnkle", "LeftFoot")):
        text = text.replace(f"JOINT {theirs}", f"JOINT mixamorig:{other}")
    text = text.replace("JOINT Neck", "JOINT mixamorig:LeftArm")
    names = bvh.read_people(write(tmp_path, text)).tracks[0].names
    assert names == ("pelvis", "l_shoulder", "l_hip", "l_knee", "l_ankle")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("HIERARCHY", "HIERARCHIE", "is no BVH file"),
        ("Frame Time: 0.01", "Frame Time: 0", "Frame Time: is 0"),
        ("Frame Time: 0.01", "Frame Time: nan", "Frame Time: is nan"),
        ("Frames: 2", "Frames: 3", "has 2 frames"),
        (BENT, "1 2 3", "frame 1: has 3 numbers"),
        (BENT, BENT.replace("100", "x"), "is not read"),
        (BENT, BENT.replace("100", "inf"), "not finite"),
        ("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 1 Zrotation", "has CHANNELS 1 Zrotation"),
        (
            "CHANNELS 3 Zrotation Xrotation Yrotation",
            "CHANNELS 3 Zrotation Zrotation Yrotation",
            "has CHANNELS",
        ),
        ("ROOT Hips", "JOINT Hips", "has not one ROOT"),
        ("OFFSET 0 -42 0", "OFFSET 0 -4.2 0", "units tall"),
        ("OFFSET 0 -42 0", "OFFSET 0 0 0", "units tall"),
        ("LeftKnee", "Somewhere", "has no leg or arm that is known"),
        ("    OFFSET 0 50 0\n", "", "is not read"),
        ("}\nMOTION", "MOTION", ""),
    ],
)
def test_bad_files_are_refused_or_read(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = whole(ZERO, BENT)
    assert old in text
    path = write(tmp_path, text.replace(old, new))
    if not said:
        bvh.read_people(path)
        return
    with pytest.raises(RecordingError, match=said) as refusal:
        bvh.read_people(path)
    assert "\n" not in str(refusal.value) and str(path) in str(refusal.value)


@pytest.mark.parametrize(
    ("old", "new"),
    [("OFFSET 0 -42 0", "CHANNELST 0 10 0"), ("JOINT Neck", "JOINT CHANNELS"), ("{", "OFFSETS {")],
)
def test_lines_that_the_library_would_take_for_others_are_refused(tmp_path: Path, old: str, new: str) -> None:
    assert old in LEG
    with pytest.raises(RecordingError, match="HIERARCHY: has a line"):
        bvh.read_people(write(tmp_path, whole(ZERO).replace(old, new, 1)))


def test_a_joint_outside_of_the_root_is_refused(tmp_path: Path) -> None:
    """Braces that are wrong twice, so that the library reads on."""
    text = whole(ZERO, BENT).replace("    {\n      OFFSET 0 10 0", "      }\n      OFFSET 0 10 0")
    text = text.replace(
        "Yrotation\n      }\n    }\n  }\n}\nMOTION", "Yrotation\n    {\n    }\n  }\n}\nMOTION"
    )
    assert text.count("{") == text.count("}") == 6
    with pytest.raises(RecordingError, match="has a joint that hangs on none, beside the root"):
        bvh.read_people(write(tmp_path, text))


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "cut.bvh.gz").write_bytes(gzip.compress(whole(ZERO).encode())[:-20])
    (tmp_path / "bytes.bvh").write_bytes(b"\xff\xfe\x00\x81")
    (tmp_path / "folder.bvh").mkdir()
    (tmp_path / "empty.bvh").touch()
    for name in ("cut.bvh.gz", "bytes.bvh", "folder.bvh", "empty.bvh", "missing.bvh"):
        with pytest.raises(RecordingError, match=name):
            bvh.read_people(tmp_path / name)


def test_an_endless_file_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bvh, "MAX_TEXT", 1000)
    with pytest.raises(RecordingError, match="longer than 1000"):
        bvh.read_people(write(tmp_path, whole(*[ZERO] * 100), "a.bvh.gz"))


def test_the_extra_is_named_where_it_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymotion.io.bvh", None)
    with pytest.raises(RecordingError, match=r"pip install 'stopproof\[bvh\]'"):
        bvh.read_people(write(tmp_path, whole(ZERO)))


@pytest.mark.real_data
def test_bvh_and_npz_of_the_same_clip_agree(real_data: Path) -> None:
    """The NPZ has single precision: coordinates up to 2 m are off by 1.2e-7 m at most, each axis apart."""
    clip = real_data / "human/original/cmu1_jumping_jacks.bvh.gz"
    (ours,) = bvh.read_people(clip).tracks
    (theirs,) = npz.read_people(real_data / "human/ad_cmu1_jumping_jacks.npz").tracks
    shared = [name for name in theirs.names if name in ours.names]
    assert set(shared) == set(theirs.names) and set(shared) <= set(POINT_NAMES)
    np.testing.assert_array_equal(ours.t_ns, theirs.t_ns)
    for name in shared:
        mine, other = ours.xyz[:, ours.names.index(name)], theirs.xyz[:, theirs.names.index(name)]
        np.testing.assert_allclose(mine, other, rtol=0.0, atol=2e-7)


@pytest.mark.real_data
def test_a_bvh_gives_reports_like_any_other_file(real_data: Path) -> None:
    source = open_people(real_data / "human/original/cmu1_jumping_jacks.bvh.gz", None, {})
    reports = list(source.reports(Place(), 0.004))
    assert len(reports) == 125 and reports[0].people[0].measured.bit_count() == 18
    assert "LeftToe" in source.counts.unknown_points
