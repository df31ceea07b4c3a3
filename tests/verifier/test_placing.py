"""Poses of sensor frames from /tf_static, against products of 4 x 4 matrices; what is refused of them."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robots.errors import SetupError
from robots.model import Mount
from tests.verifier.recordings.bags import ROS2, Item, all_items, in_time, write_foreign_mcap
from tests.verifier.recordings.samples import joint_states, reports
from tests.verifier.scenes import CELL, Scene
from verifier import Cell
from verifier.cell_reading import CellError
from verifier.limits import find_limits
from verifier.opened import open_placed
from verifier.protective_separation import separation_history
from verifier.recordings import Choice, RecordingError
from verifier.recordings.inspection import inspect_recording
from verifier.replay import verify
from verifier.reported import moving_frames
from verifier.setup import build_gate, build_profile
from verifier.stop_report.compute import stop_report
from verifier.supervised import supervise

TF = "tf2_msgs/msg/TFMessage"
START = 1_700_000_000_000_000_000
ERRORS = {"translation_error_m": 0.02, "rotation_error_deg": 1.0}
Edge = tuple[str, str, np.ndarray]
"""Parent, child, pose of the child in it (4, 4)."""


def pose(rng: np.random.Generator) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    made[:3, 3] = rng.uniform(-2.0, 2.0, 3)
    return made


def tf_item(topic: str, edges: list[Edge]) -> Item:
    def made(_store: Any) -> Any:
        t = ROS2.types
        zero = t["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
        return t[TF](
            [
                t["geometry_msgs/msg/TransformStamped"](
                    t["std_msgs/msg/Header"](stamp=zero, frame_id=parent),
                    child,
                    t["geometry_msgs/msg/Transform"](
                        t["geometry_msgs/msg/Vector3"](*at[:3, 3]),
                        t["geometry_msgs/msg/Quaternion"](*Rotation.from_matrix(at[:3, :3]).as_quat()),
                    ),
                )
                for parent, child, at in edges
            ]
        )

    return topic, TF, START, made


def recording(
    path: Path,
    static: list[Edge],
    moving: list[Edge] | None = None,
    frame: str = "world",
    later: list[Edge] | None = None,
) -> Path:
    seen = [replace(report, frame=frame) for report in reports(50.0, 0.5, START)]
    tf = [tf_item("/tf_static", static)] + [tf_item("/tf", each) for each in (moving, later) if each]
    return write_foreign_mcap(path, in_time([*all_items(joint_states(100.0, 0.5, START), seen), *tf]))


def cell(frame: dict[str, Any], **robot: Any) -> Cell:
    people = {"frames": {"camera": {**ERRORS, **frame}}}
    named = {"base_frame": "base", "people_topic": "/people"}
    return Cell.from_table({"people": people, "recording": named, "robot": robot})


def placed_pose(path: Path, stated: Cell) -> np.ndarray:
    frame = open_placed(path, stated).cell.people.frames["camera"]
    at = Mount.from_xyz_rpy(frame.xyz_m, frame.rpy_deg)
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = at.rotation, at.translation
    return made


@pytest.mark.filterwarnings("ignore:Gimbal lock")
def test_the_chain_is_the_product_of_its_transforms(tmp_path, rng, count):
    """world - stand - base on one side, world - wall - camera on the other; the arm is mounted somewhere."""
    for number in range(1 + count(100)):  # number 0 is a special case
        stand, base, wall, camera, mount = (pose(rng) for _ in range(5))
        if number % 3 == 0:
            camera[:3, :3] = Rotation.from_euler("xyz", [30.0, 90.0, 0.0], degrees=True).as_matrix()
            stand[:3, :3] = base[:3, :3] = wall[:3, :3] = mount[:3, :3] = np.eye(3)  # pitch of 90 degrees
        edges = [
            ("world", "stand", stand),
            ("stand", "base", base),
            ("world", "wall", wall),
            ("/wall", "/camera", camera),
        ]
        path = recording(tmp_path / f"{number}.mcap", edges)
        rpy = Rotation.from_matrix(mount[:3, :3]).as_euler("xyz", degrees=True)
        there = {"xyz_m": mount[:3, 3].tolist(), "rpy_deg": rpy.tolist()}
        expected = mount @ np.linalg.inv(stand @ base) @ wall @ camera
        found = placed_pose(path, cell({"pose": "recorded"}, mount=there))
        np.testing.assert_allclose(found, expected, atol=1e-7)
        # stated in the cell with that pose they agree, and one that is off by more than the errors is refused
        agree = Rotation.from_matrix(expected[:3, :3]).as_euler("xyz", degrees=True).tolist()
        near, far = (expected[:3, 3] + shift for shift in (0.019 * unit(rng), 0.021 * unit(rng)))
        placed_pose(path, cell({"xyz_m": near.tolist(), "rpy_deg": agree}, mount=there))
        with pytest.raises(
            CellError, match=r"people\.frames\.camera: xyz_m = .*, but by /tf_static of .* it is at"
        ):
            placed_pose(path, cell({"xyz_m": far.tolist(), "rpy_deg": agree}, mount=there))
        turned = Rotation.from_rotvec(np.deg2rad(1.1) * unit(rng)) * Rotation.from_matrix(expected[:3, :3])
        with pytest.raises(CellError, match="they must agree"):
            placed_pose(
                path,
                cell(
                    {"xyz_m": near.tolist(), "rpy_deg": turned.as_euler("xyz", degrees=True).tolist()},
                    mount=there,
                ),
            )


def unit(rng: np.random.Generator) -> np.ndarray:
    way = rng.normal(size=3)
    return way / np.linalg.norm(way)


@pytest.mark.parametrize("frame", [{"pose": "recorded"}, {"xyz_m": [0.0, 0.0, 0.0]}])
@pytest.mark.parametrize(
    ("static", "moving"),
    [
        ([("base", "mast")], [("mast", "camera")]),
        ([("mast", "camera")], [("base", "mast")]),
        ([("base", "mast"), ("mast", "camera")], [("mast", "camera")]),
        ([("mast", "camera"), ("world", "mast")], [("world", "base")]),
    ],
)
def test_what_moves_between_them_is_refused(tmp_path, static, moving, frame):
    """Also where the cell states a pose: it cannot be right for all of the recording."""
    still = [(*each, np.eye(4)) for each in static]
    path = recording(tmp_path / "a.mcap", still, [(*each, np.eye(4)) for each in moving])
    with pytest.raises(
        RecordingError, match=rf"frame {moving[0][1]} moves \(/tf\), and stands between camera and base"
    ):
        open_placed(path, cell(frame))


def test_what_moves_elsewhere_does_not_matter(tmp_path):
    still, arm = [("base", "camera", np.eye(4)), ("world", "base", np.eye(4))], [("base", "link", np.eye(4))]
    path = recording(tmp_path / "a.mcap", still, arm)
    np.testing.assert_allclose(placed_pose(path, cell({"pose": "recorded"})), np.eye(4), atol=1e-12)


RAISED = np.eye(4)
RAISED[2, 3] = 1e-3


@pytest.mark.parametrize(
    ("moving", "later", "moves"),
    [
        (("mast", "camera"), RAISED, True),
        (("wall", "/mast"), RAISED, True),
        (("wall", "mast"), np.eye(4), False),
        (("wall", "link"), RAISED, False),
    ],
)
def test_one_pose_that_is_stated_for_a_frame_that_moves_is_pointed_out(tmp_path, moving, later, moves):
    """Without a base frame nothing is known of where it stands, but that it does not stay there."""
    static = [] if moving[1] == "camera" else [("mast", "camera", np.eye(4))]
    motion = [[(*moving, np.eye(4))], [(*moving, later)]]
    path = recording(tmp_path / "a.mcap", static, motion[0], later=motion[1])
    frames = {name: {**ERRORS, "xyz_m": [0.0, 0.0, 0.0]} for name in ("/camera", "elsewhere")}
    table = {"people": {"frames": frames}, "recording": {"people_topic": "/people"}}
    opened = open_placed(path, Cell.from_table(table))
    assert opened.recording.moving_frames == (("/camera",) if moves else ())
    told = "\n".join(moving_frames(opened.recording))
    assert ("frame /camera moves by /tf of the recording" in told) is moves
    assert "elsewhere" not in told and ("recording.base_frame" in told) is moves


def test_verify_points_out_a_frame_that_moves(tmp_path):
    path = Scene(duration=0.5).write(tmp_path / "a.mcap")
    frames = {"camera": {**ERRORS, "xyz_m": [0.0, 0.0, 0.0]}}
    stated = Cell.from_table({**CELL, "people": {**CELL.get("people", {}), "frames": frames}})
    opened = open_placed(path, stated)
    assert not opened.recording.moving_frames
    opened.recording.moving_frames = ("camera",)
    (line,) = (line for line in verify(opened.recording, opened.cell).lines() if "moves by /tf" in line)
    assert line.startswith("note: frame camera moves by /tf of the recording")


def test_two_poses_of_one_frame_are_refused(tmp_path):
    other = np.eye(4)
    other[0, 3] = 0.001
    path = recording(tmp_path / "a.mcap", [("base", "camera", np.eye(4)), ("base", "camera", other)])
    with pytest.raises(RecordingError, match="a static frame stands in one place"):
        open_placed(path, cell({"pose": "recorded"}))


def test_circles_and_ends_are_refused(tmp_path):
    circle = [("a", "camera", np.eye(4)), ("camera", "a", np.eye(4))]
    with pytest.raises(RecordingError, match="stand in a circle"):
        open_placed(recording(tmp_path / "a.mcap", circle), cell({"pose": "recorded"}))
    with pytest.raises(
        RecordingError, match=r"no transform leads from frame camera to base .static are camera, wall"
    ):
        apart = [("wall", "camera", np.eye(4))]
        open_placed(recording(tmp_path / "b.mcap", apart), cell({"pose": "recorded"}))


def test_where_it_is_from_is_said(tmp_path):
    path = recording(tmp_path / "a.mcap", [("base", "mast", np.eye(4)), ("mast", "camera", np.eye(4))])
    noted = open_placed(path, cell({"pose": "recorded"})).recording.assumptions
    (frame,) = (each for each in noted if each.name == "recording.frame.camera")
    assert frame.source == "/tf_static of a.mcap: camera - mast - base; error declared in the cell"


@pytest.mark.parametrize(
    ("frame", "rule"),
    [
        ({"pose": "recorded"}, "does not say how well its transforms are known"),
        ({"pose": "recorded", "translation_error_m": 0.1}, "rotation_error_deg"),
        ({"pose": "recorded", "xyz_m": [1.0, 0.0, 0.0], **ERRORS}, "leave them away"),
        ({"pose": "recorded", **ERRORS}, "needs recording.base_frame"),
    ],
)
def test_a_recorded_pose_needs_its_error_and_a_base(frame, rule):
    with pytest.raises(SetupError, match=rule):
        Cell.from_table({"people": {"frames": {"camera": frame}}})


def test_a_pose_that_nobody_took_from_the_recording_is_none():
    """Somebody who passes cell and recording on their own must not get a frame at the origin."""
    stated = cell({"pose": "recorded"})
    with pytest.raises(SetupError, match="open_placed"):
        build_gate(stated, build_profile(stated))


@pytest.mark.parametrize("answer", [find_limits, separation_history, supervise, stop_report, verify])
def test_whoever_is_given_the_name_of_a_recording_takes_the_pose_from_it(tmp_path, monkeypatch, answer):
    class EnoughError(Exception):
        pass

    def built(placed: Cell, *_rest: object) -> None:
        frame = placed.people.frames["camera"]
        assert frame.pose != "recorded"
        np.testing.assert_allclose(frame.xyz_m, [3.0, 0.0, 0.0], atol=1e-9)
        raise EnoughError

    there = np.eye(4)
    there[0, 3] = 3.0
    path = recording(tmp_path / "a.mcap", [("base", "camera", there)])
    monkeypatch.setattr(sys.modules[answer.__module__], "build_robot", built)
    stated = cell({"pose": "recorded"})
    with pytest.raises(EnoughError):
        answer(stated, path) if answer is stop_report else answer(path, stated)


def test_inspect_names_the_frames_in_which_a_camera_stands_still(tmp_path):
    there = np.eye(4)
    edges = [
        ("world", "base", there),
        ("world", "wall", there),
        ("wall", "camera", there),
        ("rail", "cart", there),
    ]
    path = recording(tmp_path / "a.mcap", edges, [("map", "world", there)], "camera")
    found = inspect_recording(path, Choice(people_topic="/people"))
    assert found.static_frames == {"camera": ("base", "wall", "world")}
    (line,) = (line for line in found.lines() if "'camera'" in line)
    assert "/tf_static has it in base, wall, world" in line and 'pose = "recorded"' in line
    assert "recording.base_frame" in line


def test_inspect_says_what_is_wrong_with_transforms(tmp_path):
    there, elsewhere = np.eye(4), np.eye(4)
    elsewhere[0, 3] = 1.0
    path = recording(
        tmp_path / "a.mcap", [("base", "camera", there), ("base", "camera", elsewhere)], frame="camera"
    )
    found = inspect_recording(path, Choice(people_topic="/people"))
    assert found.static_frames == {}
    assert any("a static frame stands in one place" in remark for remark in found.remarks)
