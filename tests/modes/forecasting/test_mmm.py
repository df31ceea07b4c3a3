"""Motions of KIT's format that are written here; real ones could not be had."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from modes.forecasting.mmm import read_mmm, read_mmm_points
from modes.forecasting.skeleton import Joint
from occupancy.body import Point
from robots.errors import SetupError

NAMES = [
    *(f"{joint}{axis}_joint" for joint in ("BLN", "BP", "BT", "BUN", "LA") for axis in "xyz"),
    "LEx_joint", "LEz_joint", "LHx_joint", "LHy_joint", "LHz_joint", "LKx_joint", "LSx_joint", "LSy_joint",
    "LSz_joint", "LWx_joint", "LWy_joint", "REx_joint", "REz_joint", "RHx_joint", "RHy_joint", "RHz_joint",
    "RKx_joint", "RSx_joint", "RSy_joint", "RSz_joint", "RWx_joint", "RWy_joint", "RMrot_joint",
]  # fmt: skip
HEIGHT = 1.8


def text_of(
    frames: int = 5, height: str = str(HEIGHT), angles: dict[str, float] | None = None,
    root: str = "100 200 954", turn: str = "0 0 0", times: str = "{}", names: list[str] | None = None,
    head: str = "",
) -> str:  # fmt: skip
    """A file with an object first, and then a person who does not move."""
    chosen = NAMES if names is None else names
    positions = " ".join(str((angles or {}).get(name, 0.0)) for name in chosen)
    rows = "".join(
        f"<MotionFrame><Timestep>{times.format(0.01 * k)}</Timestep><RootPosition>{root}</RootPosition>"
        f"<RootRotation>{turn}</RootRotation><JointPosition>{positions} </JointPosition></MotionFrame>"
        for k in range(frames)
    )
    order = "".join(f'<Joint name="{name}"/>' for name in chosen)
    thing = '<Motion name="cup"><MotionFrames/></Motion>'
    config = (
        f"<ModelProcessorConfig type='Winter'><Height>{height}</Height><Mass>70</Mass></ModelProcessorConfig>"
    )
    moved = f"<JointOrder>{order}</JointOrder><MotionFrames>{rows}</MotionFrames>"
    person = f"<Motion name='p'>{config}{moved}</Motion>"
    return f"<?xml version='1.0'?>{head}<MMM>{thing}{person}</MMM>"


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "00042_mmm.xml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<MMM><Motion>", "no XML"),
        ("<MMM></MMM>", "no Motion whose JointOrder has LSx_joint"),
        (text_of(head='<!DOCTYPE m [<!ENTITY a "b">]>'), "declares a document type or entities"),
        (text_of(height="tall"), "height 'tall' of the subject is no number: give height_m"),
        (text_of(height="18"), "height of the subject = 18"),
        (text_of(height="nan"), "height of the subject = nan"),
        (text_of(frames=1), "1 frames of motion"),
        (text_of(times="0.5"), "time steps do not increase"),
        (text_of(times="x{}"), "Timestep of frame 0: could not convert"),
        (text_of(root="1 2"), "RootPosition of frame 0 has 2 numbers, not 3 finite ones"),
        (text_of(turn="0 inf 0"), "RootRotation of frame 0"),
        (text_of().replace("0.0 </Joint", "</Joint"), "JointPosition of frame 0 has"),
    ],
)
def test_what_is_no_motion_is_refused_in_a_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SetupError, match=message) as refused:
        read_mmm(written(tmp_path, text))
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there_or_not_utf_8_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SetupError, match="cannot be read as UTF-8"):
        read_mmm(tmp_path / "absent.xml")
    path = tmp_path / "wide.xml"
    path.write_bytes(text_of(head='<!DOCTYPE m [<!ENTITY a "b">]>').encode("utf-16"))
    with pytest.raises(SetupError, match="cannot be read as UTF-8"):
        read_mmm(path)


def test_at_rest_one_stands_upright_and_has_winters_lengths(tmp_path: Path) -> None:
    t, points = read_mmm_points(written(tmp_path, text_of()))
    assert np.allclose(t, 0.01 * np.arange(5)) and points.shape == (5, 20, 3) and np.isfinite(points).all()
    now = points[0] / HEIGHT - np.array([0.1, 0.2, 0.954]) / HEIGHT
    assert np.allclose(now[Point.PELVIS], 0.0)
    assert np.allclose(now[Point.NECK_BASE], (0.0, 0.0, 0.31))
    assert np.allclose(now[Point.L_WRIST], (-0.11, 0.0, 0.288 - 0.333))
    assert np.allclose(now[Point.R_ANKLE], (0.052, 0.0, -0.491))
    assert points[0, Point.R_ANKLE, 2] == pytest.approx(0.954 - 0.491 * HEIGHT)


def test_joints_of_the_paper_come_out_facing_along_y(tmp_path: Path) -> None:
    found = read_mmm(written(tmp_path, text_of()))
    assert found.subject == "kit_00042" and found.joints.shape == (5, 15, 3)
    ahead = found.joints[0, Joint.CLAV] - found.joints[0, Joint.C7]
    assert np.allclose(ahead / np.linalg.norm(ahead), (0.0, 1.0, 0.0))
    assert found.joints[0, Joint.LSHO, 0] < found.joints[0, Joint.RSHO, 0]


def test_the_height_can_be_given(tmp_path: Path) -> None:
    path = written(tmp_path, text_of(height=""))
    _, points = read_mmm_points(path, 1.6)
    arm = np.linalg.norm(points[0, Point.R_SHOULDER] - points[0, Point.R_ELBOW])
    assert arm == pytest.approx(0.188 * 1.6)


def test_joints_turn_as_a_chain_of_rotations(tmp_path: Path, rng: np.random.Generator) -> None:
    """Against SciPy's rotations, put together by hand for one arm and one leg."""
    for k in range(10):
        angles = dict(zip(NAMES, rng.uniform(-1.5, 1.5, len(NAMES)).tolist(), strict=True))
        rpy = rng.uniform(-1.5, 1.5, 3)
        text = text_of(angles=angles, turn=" ".join(map(str, rpy)))
        _, points = read_mmm_points(written(tmp_path, text))

        def turned(joint: str, angles: dict[str, float] = angles) -> Rotation:
            return Rotation.from_euler("XYZ", [angles.get(f"{joint}{axis}_joint", 0.0) for axis in "xyz"])

        root, place = Rotation.from_euler("xyz", rpy), np.array([0.1, 0.2, 0.954])
        back = root * turned("BP")
        chest = back * turned("BT")
        spine = place + HEIGHT * (
            root.apply((0, 0, 0.04)) + back.apply((0, 0, 0.06)) + chest.apply((0, 0, 0.188))
        )
        shoulder = spine + HEIGHT * chest.apply((0.11, 0, 0))
        upper = chest * turned("RS")
        elbow = shoulder + HEIGHT * upper.apply((0, 0, -0.188))
        wrist = elbow + HEIGHT * (upper * turned("RE")).apply((0, 0, -0.145))
        assert np.allclose(points[k % 5, Point.R_WRIST], wrist, atol=1e-9)
        hip = place + HEIGHT * root.apply((-0.052, 0, 0))
        thigh = root * turned("LH")
        knee = hip + HEIGHT * thigh.apply((0, 0, -0.245))
        ankle = knee + HEIGHT * (thigh * turned("LK")).apply((0, 0, -0.246))
        assert np.allclose(points[k % 5, Point.L_ANKLE], ankle, atol=1e-9)


def test_the_order_of_joints_is_that_of_the_file(tmp_path: Path) -> None:
    angles = {"RSx_joint": 0.5, "LKx_joint": -0.3}
    first = read_mmm_points(written(tmp_path, text_of(angles=angles)))[1]
    other = read_mmm_points(written(tmp_path, text_of(angles=angles, names=NAMES[::-1])))[1]
    assert np.array_equal(first, other)
