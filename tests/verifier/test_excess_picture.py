"""``stopproof conformance --picture``: models are told apart, and what is cut off is said."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.image import imread

from occupancy.containment import Containment
from occupancy.humans.catalog import MODEL_NAMES
from tests.occupancy.people import standing
from tests.verifier.shell import Shell, refused
from tests.verifier.test_snapshot import recording, strike
from verifier.conformance import Result
from verifier.reports.excess_picture import (
    STYLES,
    Curve,
    curves,
    excess_picture,
    highest_shown,
    lowest_shown,
    not_drawn,
)
from verifier.reports.picture import KINDS, kind_of

BEGINS = {
    "png": b"\x89PNG\r\n\x1a\n",
    "jpg": b"\xff\xd8\xff",
    "jpeg": b"\xff\xd8\xff",
    "pdf": b"%PDF-",
    "svg": b"<?xml ",
    "tif": b"II*\x00",
    "tiff": b"II*\x00",
    "webp": b"RIFF",
}
"""First bytes of files, as their formats define them."""


def curve(model: str, *excess: float) -> Curve:
    return Curve("p", model, 0.1 * np.arange(1, 1 + len(excess)), np.array(excess))


def results(folder: Path, *of: tuple[str, str, list[float]]) -> list[Result]:
    """Results of models and profiles with these excesses; NaN: no frames."""
    file = recording(folder, {"a": strike(40, 2.5)})
    return [
        Result(
            file,
            model,
            profile,
            tuple(
                Containment(0.1 * (h + 1), frames=int(math.isfinite(each)), worst_excess_m=each)
                for h, each in enumerate(excess)
            ),
        )
        for model, profile, excess in of
    ]


def test_every_model_has_a_colour_a_marker_and_a_line_of_its_own() -> None:
    assert set(STYLES) == set(MODEL_NAMES)
    for kind in zip(*STYLES.values(), strict=True):
        assert len(set(kind)) == len(MODEL_NAMES)


def test_what_is_cut_off_is_named_with_how_deep_it_goes() -> None:
    found = [
        curve("iso13855", 0.1, 0.2),
        curve("arm_reach", -0.2, -1.25),
        curve("pedestrian", -4.0, -7.5),
        curve("articulated_velocity", math.nan, math.nan),
        curve("articulated_position", math.nan, -0.9),
    ]
    assert list(not_drawn(found, -0.5)) == [
        "cut off below -0.50 m:",
        "arm_reach: in part, down to -1.25 m",
        "pedestrian: all, down to -7.50 m",
        "articulated_position: all, down to -0.90 m",
        "articulated_velocity: nothing was tested",
    ]
    assert list(not_drawn(found[:1], -0.5)) == []


def test_nothing_is_cut_off_above_and_little_depth_is_always_shown() -> None:
    for excess in ((-1.0, -2.0), (0.3, math.nan), (2.0, 1.0), (math.nan, math.nan)):
        found = [curve("iso13855", *excess)]
        assert highest_shown(found) > np.nanmax([0.0, *excess])
        assert lowest_shown(found) <= -0.3


def test_a_curve_has_the_worst_of_all_recordings(tmp_path: Path) -> None:
    found = curves(
        results(
            tmp_path,
            ("iso13855", "iso", [0.1, -0.3, math.nan]),
            ("iso13855", "tum", [9.0, 9.0, 9.0]),
            ("iso13855", "iso", [-0.2, 0.4, math.nan]),
        )
    )
    assert [(each.profile, each.model) for each in found] == [("iso", "iso13855"), ("tum", "iso13855")]
    np.testing.assert_array_equal(found[0].excess_m, [0.1, 0.4, math.nan])
    np.testing.assert_allclose(found[0].horizon_s, [0.1, 0.2, 0.3])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", KINDS)
def test_the_ending_says_what_is_written(tmp_path: Path, kind: str) -> None:
    assert kind in FigureCanvasBase.get_supported_filetypes()
    of = [(model, "$x^$", [0.1, -0.2, -3.0]) for model in MODEL_NAMES[:2]]
    drawn = excess_picture(results(tmp_path, *of, (MODEL_NAMES[2], "tum", [math.nan] * 3)), kind)
    assert drawn.startswith(BEGINS[kind])
    if kind == "png":
        high, wide, _ = imread(io.BytesIO(drawn)).shape
        assert wide > high > 400


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    xyz = np.repeat(standing()[None], 80, axis=0)
    xyz[:, :, 0] += 0.1 * np.sin(10.0 * 0.01 * np.arange(80))[:, None]
    np.savez(tmp_path / "c.npz", t=0.01 * np.arange(80), joints=np.array(["head", "r_wrist"]), xyz=xyz[:, :2])
    return tmp_path / "c.npz"


@pytest.mark.parametrize("name", ["x.txt", "x", "x.png.gz", "png", "x.gif"])
@pytest.mark.parametrize("option", ["--picture", "--sets"])
def test_other_endings_are_refused_before_the_work(
    shell: Shell, clip: Path, monkeypatch: pytest.MonkeyPatch, option: str, name: str
) -> None:
    monkeypatch.chdir(clip.parent)
    told = refused(shell("conformance", clip, "--profile", "iso", option, name))
    assert f"{option} {name}: a picture's name must end in one of .png, .jpg, .jpeg, .pdf, .svg" in told
    assert not Path(name).exists()


def test_verify_refuses_other_endings_too(shell: Shell, tmp_path: Path) -> None:
    told = refused(shell("verify", "nowhere.mcap", "--picture", tmp_path / "x.bmp"))
    assert "x.bmp: a picture's name must end in one of .png" in told


def test_both_pictures_are_of_the_kind_that_their_names_say(shell: Shell, clip: Path) -> None:
    picture, sets = clip.with_name("p.JPG"), clip.with_name("s.svg")
    named = ("--picture", picture, "--sets", sets)
    status, _out, err = shell("conformance", clip, "--profile", "iso", "--human", "iso13855", *named)
    assert status == 0, err
    assert kind_of(str(picture)) == "jpg" and picture.read_bytes().startswith(BEGINS["jpg"])
    assert sets.read_bytes().startswith(BEGINS["svg"])
