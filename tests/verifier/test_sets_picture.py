"""``stopproof conformance --sets``: what a picture of one frame shows, and what is refused."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from occupancy.body import ALL_PARTS, LIMBS, MAX_POINTS, POINT_NAMES, Part, Point
from tests.occupancy.people import only, standing
from tests.verifier.shell import Shell, refused
from tests.verifier.test_snapshot import recording, snapshot, strike
from verifier.outline import inside
from verifier.reports.sets_panel import GROUPS, SEVERAL, Panel, bones, group_of, panel_of
from verifier.reports.sets_picture import sets_picture


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    xyz = strike(40, 2.5, samples=80)
    path = tmp_path / "clip.npz"
    np.savez(path, t=0.01 * np.arange(80), joints=np.array(POINT_NAMES), xyz=xyz, position_error_m=0.002)
    return path


def panels(folder: Path, profile: str, *models: str) -> list[list[Panel]]:
    xyz = strike(40, 3.5)
    xyz[:, Point.L_WRIST] = np.nan
    shot = snapshot(recording(folder, {"a": xyz}), profile, *models, at=0.36)
    return [[panel_of(shot, h, each) for each in row] for h, row in enumerate(shot.predicted)]


# ------------------------------------------------------------------------------------------- what panels show


def test_every_part_has_a_group_and_mixed_rows_have_their_own() -> None:
    assert sorted(part for parts in GROUPS.values() for part in parts) == sorted(Part)
    for name, parts in GROUPS.items():
        assert group_of(sum(1 << part for part in parts)) == name
        assert all(group_of(1 << part) == name for part in parts)
    assert group_of(ALL_PARTS) == group_of(1 << Part.L_HAND | 1 << Part.L_FOREARM) == SEVERAL


@pytest.mark.parametrize("profile", ["iso", "tum", "extreme"])
def test_points_inside_are_drawn_inside_of_an_outline(tmp_path: Path, profile: str) -> None:
    for row in panels(tmp_path, profile):
        for panel in row:
            drawn = [each for group in panel.outlines.values() for each in group]
            assert not (panel.inside & panel.outside).any() and panel.silent[Point.L_WRIST]
            for p in np.flatnonzero(panel.inside):
                assert any(inside(panel.points[[p]], each, -0.002).all() for each in drawn)
            for p in np.flatnonzero(panel.outside):
                assert Part(panel.part[p]) in panel.missed
            assert set(panel.missed) == {Part(part) for part in panel.part[panel.outside]}
            assert len(panel.corners) == sum(map(len, drawn))


def test_the_text_of_a_panel_names_what_is_outside_farthest_first() -> None:
    excess, part = np.full(20, np.nan), np.full(20, -1)
    panel = Panel("m", {}, {}, np.zeros((20, 2)), excess, part, np.zeros(20))
    assert panel.finding == "says nothing" and panel.corners.shape == (0, 2)
    excess[[Point.HEAD, Point.PELVIS, Point.R_KNEE]] = -0.3004, -0.0127, -0.5
    assert panel.finding == "inside, 13 mm deep or more"
    excess[Point.R_WRIST], part[Point.R_WRIST] = 0.0004, Part.R_HAND
    assert panel.finding == "+0.4 mm r_hand (r_wrist)"
    excess[Point.HEAD], part[Point.HEAD] = 0.0494, Part.HEAD
    excess[Point.PELVIS], part[Point.PELVIS] = 0.0061, Part.TORSO
    assert panel.finding == "+49 mm head\n+6.1 mm torso (pelvis)\n+0.4 mm r_hand (r_wrist)"
    excess[Point.R_KNEE], part[Point.R_KNEE] = 0.011, Part.R_SHANK
    excess[Point.L_KNEE], part[Point.L_KNEE] = 0.001, Part.L_SHANK
    assert panel.finding == "+49 mm head\n+11 mm r_shank (r_knee)\n+6.1 mm torso (pelvis)\nand 2 more"


def test_bones_join_neighbours_and_go_around_no_point_that_was_seen() -> None:
    every = list(bones(standing()))
    assert (Point.PELVIS, Point.NECK_BASE) not in every and (Point.PELVIS, Point.THORAX) in every
    assert (Point.R_WRIST, Point.R_FINGERTIP) not in every
    assert len(every) == len(set(every)) == sum(map(len, LIMBS.values())) - 3
    some = only(standing(), Point.PELVIS, Point.NECK_BASE, Point.R_WRIST, Point.R_FINGERTIP, Point.L_KNEE)
    assert set(bones(some)) == {(Point.PELVIS, Point.NECK_BASE), (Point.R_WRIST, Point.R_FINGERTIP)}
    assert not list(bones(np.full((MAX_POINTS, 2), np.nan)))


@pytest.mark.parametrize(
    ("profile", "models"),
    [("tum", ()), ("iso", ("iso13855", "pedestrian")), ("extreme", ("arm_reach",))],
)
def test_pictures_are_drawn(tmp_path: Path, profile: str, models: tuple[str, ...]) -> None:
    png = sets_picture(snapshot(recording(tmp_path, {"$x^$\\": strike(40, 2.5)}), profile, *models))
    (tmp_path / "p.png").write_bytes(png)
    high, wide, _ = matplotlib.image.imread(tmp_path / "p.png").shape
    assert 750 < wide < 1600 and 400 < high < 1700


@pytest.mark.filterwarnings("error")
def test_names_in_any_script_are_drawn_without_a_warning(tmp_path: Path) -> None:
    shot = snapshot(recording(tmp_path, {"日本 \u202e\t é": strike(40, 2.5)}), "iso", "iso13855")
    assert sets_picture(shot).startswith(b"\x89PNG")


def test_little_is_enough_for_a_picture(tmp_path: Path) -> None:
    """A head and nothing else; a model that says nothing of anybody."""
    xyz = np.stack([only(points, Point.HEAD) for points in strike(40, 2.5)])
    file = recording(tmp_path, {"a": xyz})
    assert sets_picture(snapshot(file, "tum")).startswith(b"\x89PNG")
    assert sets_picture(snapshot(file, "tum", "arm_reach")).startswith(b"\x89PNG")


# ---------------------------------------------------------------------------------------- on the command line


def test_the_command_writes_the_picture(shell: Shell, clip: Path, tmp_path: Path) -> None:
    target = tmp_path / "s.png"
    status, out, err = shell("conformance", clip, "--profile", "iso", "--every", 20, "--sets", target)
    assert (status, err) == (0, "") and f"wrote {target}" in out
    assert target.read_bytes().startswith(b"\x89PNG")
    more = ("--at", 0.2, "--person", "p1", "--human", "iso13855", "--force")
    before = target.read_bytes()
    assert shell("conformance", clip, "--profile", "iso", "--every", 20, "--sets", target, *more)[0] == 0
    assert target.read_bytes() != before


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--at", "9"), "--at 9: clip goes from 0 to 0.79 s"),
        (("--at", "-1"), "--at -1: clip goes from 0 to 0.79 s"),
        (("--at", "nan"), "--at nan: clip goes from 0 to 0.79 s"),
        (("--at", "0.7"), "--at 0.7: no sample lies 100 or 200 ms later"),
        (("--at", "soon"), "'soon' is not a valid float"),
        (("--person", "x\x1b[1m"), "--person x\\x1b[1m: is not in clip; these are: p1"),
        (("--human", "arm_reach"), "none of the models arm_reach follows from the profiles iso"),
        (("--profile", "tum"), "--sets: draws the models of one profile, not of 2; name one with --profile"),
        (("--identify", "n.toml"), "--sets: draws the models of one profile, not of 2"),
        (("--picture", "s.png"), "--sets s.png: --picture names the same file"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_one_line(
    shell: Shell,
    clip: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    options: tuple[str, ...],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refused(shell("conformance", clip, "--profile", "iso", "--sets", "s.png", *options))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clip.npz"]


def test_a_marked_frame_is_refused(shell: Shell, clip: Path, tmp_path: Path) -> None:
    with np.load(clip) as data:
        arrays = dict(data)
    arrays["xyz"][30, Point.HEAD, 0] += 0.5
    np.savez(clip, **arrays)
    command = ("conformance", clip, "--profile", "iso", "--sets", tmp_path / "s.png")
    assert "--at 0.25: a sample from there to 200 ms later is marked" in refused(
        shell(*command, "--at", 0.25)
    )


def test_one_recording_and_one_profile(shell: Shell, clip: Path, tmp_path: Path) -> None:
    target = tmp_path / "s.png"
    other = tmp_path / "other.npz"
    other.write_bytes(clip.read_bytes())
    two = shell("conformance", clip, other, "--profile", "iso", "--sets", target)
    assert "--sets: draws a frame of one recording, not of 2; name one file" in refused(two)
    assert "one profile, and none is named; name one with --profile" in refused(
        shell("conformance", clip, "--sets", target)
    )
    for option in (("--at", 0.2), ("--person", "p1")):
        assert f"{option[0]}: chooses what --sets draws" in refused(shell("conformance", clip, *option))
    target.write_text("mine")
    assert "exists already" in refused(shell("conformance", clip, "--profile", "iso", "--sets", target))
    assert target.read_text() == "mine"
    assert "is the file of people itself" in refused(
        shell("conformance", clip, "--profile", "iso", "--sets", clip, "--force")
    )


def test_without_matplotlib_nothing_is_begun(
    shell: Shell, clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("verifier.reports.picture.find_spec", lambda _name: None)
    monkeypatch.setattr(
        "verifier.recording_commands.open_recordings", lambda *_arguments: pytest.fail("begun")
    )
    command = ("conformance", clip, "--profile", "iso", "--sets", tmp_path / "s.png")
    assert "pictures need matplotlib" in refused(shell(*command))
